//! Ranks as processes, by MPI.
//!
//! For one machine or many. An error of MPI itself ends all processes, as is its default; what ends a rank otherwise is
//! told to the others by nobody, so that a program that fails must call [`Mpi::abort`].

use mpi::collective::CommunicatorCollectives as _;
use mpi::topology::{Communicator as _, SimpleCommunicator};
use mpi::traits::{Destination as _, Source as _};

use super::exchange::{Exchange, Lost};

/// Most bytes in one message: counts of MPI have 31 bits.
const MESSAGE: usize = 1 << 30;

/// One of the processes that `mpirun` has started. A rank that fails ends all: see [`Mpi::abort`].
///
/// One per process. Dropped, it ends MPI for this process.
pub struct Mpi {
    world: SimpleCommunicator,
    // After the communicator, which must not outlive it.
    _universe: mpi::environment::Universe,
}

impl Mpi {
    /// Joins the others; `None` if this process has done so before. All that is asked of MPI is asked by this thread.
    pub fn start() -> Option<Self> {
        let universe = mpi::initialize()?;
        Some(Self {
            world: universe.world(),
            _universe: universe,
        })
    }

    /// Ends all ranks.
    ///
    /// With exit status 1, from any rank; nothing is put in order.
    pub fn abort(&self) -> ! {
        self.world.abort(1)
    }
}

impl Exchange for Mpi {
    fn ranks(&self) -> usize {
        self.world.size() as usize
    }
    fn rank(&self) -> usize {
        self.world.rank() as usize
    }
    fn all_to_all(&self, to: Vec<Vec<u8>>) -> Result<Vec<Vec<u8>>, Lost> {
        let ranks = self.ranks();
        let lengths: Vec<u64> = to.iter().map(|bytes| bytes.len() as u64).collect();
        let mut coming = vec![0u64; ranks];
        self.world.all_to_all_into(&lengths[..], &mut coming[..]);
        let mut out: Vec<Vec<u8>> = coming.iter().map(|&n| vec![0; n as usize]).collect();
        // In rounds, each with one to send to and one to hear from, so that no rank is asked by all at once.
        for round in 0..ranks {
            let (next, last) = (
                (self.rank() + round) % ranks,
                (self.rank() + ranks - round) % ranks,
            );
            if round == 0 {
                out[last].copy_from_slice(&to[next]);
                continue;
            }
            let mut send = to[next].chunks(MESSAGE);
            let mut take = out[last].chunks_mut(MESSAGE);
            loop {
                match (send.next(), take.next()) {
                    (None, None) => break,
                    (sent, taken) => mpi::request::scope(|scope| {
                        let target = self.world.process_at_rank(next as i32);
                        let source = self.world.process_at_rank(last as i32);
                        let going = sent.map(|part| target.immediate_send(scope, part));
                        let coming = taken.map(|part| source.immediate_receive_into(scope, part));
                        going.into_iter().for_each(|request| {
                            request.wait();
                        });
                        coming.into_iter().for_each(|request| {
                            request.wait();
                        });
                    }),
                }
            }
        }
        Ok(out)
    }
}
