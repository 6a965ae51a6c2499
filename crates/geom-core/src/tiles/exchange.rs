//! Ranks, and what they send each other.
//!
//! A rank is a program of its own, be it a thread or a process; there is no leader. [`Exchange::all_to_all`] is the
//! only way to speak, and everybody takes part in it, so that no message can be waited for that nobody sends: either
//! all ranks make as many exchanges, or one has failed and the others hear of it.

use std::sync::atomic::{AtomicU64, Ordering};

/// Why an exchange ended.
///
/// After it a rank can only end: the ranks are no longer at the same point.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum Lost {
    /// Another rank has failed; what it says itself is the reason.
    #[error("rank {rank} has failed, so the others stop")]
    Rank {
        /// The first that failed.
        rank: usize,
    },
    /// What came is not what was sent.
    #[error("rank {rank} sent {bytes} bytes that are no whole number of records of {record}")]
    Broken {
        /// Who sent it.
        rank: usize,
        /// What came.
        bytes: usize,
        /// Bytes per record.
        record: usize,
    },
}

/// Ranks that run the same program side by side and speak at the same points of it. All that they say goes through
/// [`all_to_all`](Exchange::all_to_all), so that a form of exchange is one function.
///
/// An implementation owes no more than [`ranks`](Exchange::ranks), [`rank`](Exchange::rank) and `all_to_all`; the rest
/// is made of these, and may be replaced by what a library does faster.
pub trait Exchange {
    /// How many there are.
    ///
    /// At least 1, and the same for all.
    fn ranks(&self) -> usize;

    /// Which one this is.
    ///
    /// Below [`ranks`](Exchange::ranks), and different for each.
    fn rank(&self) -> usize;

    /// Sends `to[r]` to every rank `r` (this one included) and gives what each has sent to this one. All ranks call it
    /// equally often.
    ///
    /// `to` has one entry per rank, of any length and also empty; so has the answer. What is told to itself comes back.
    ///
    /// # Errors
    /// [`Lost::Rank`] if a rank has failed, be it before or meanwhile. A form of exchange may end all ranks instead.
    fn all_to_all(&self, to: Vec<Vec<u8>>) -> Result<Vec<Vec<u8>>, Lost>;

    /// What every rank says, by rank.
    ///
    /// Each rank holds what all have said: for what is short.
    fn gather(&self, own: &[u8]) -> Result<Vec<Vec<u8>>, Lost> {
        self.all_to_all(vec![own.to_vec(); self.ranks()])
    }

    /// The sum of the numbers of all ranks before this one, and of all.
    ///
    /// An exclusive prefix sum: where this rank's elements begin if those of all are counted in the order of ranks.
    fn scan(&self, own: u64) -> Result<(u64, u64), Lost> {
        let all = gathered::<u64>(self, &[own])?;
        let before = all[..self.rank()].iter().flatten().sum();
        Ok((before, all.iter().flatten().sum()))
    }
}

/// What every rank says, as records.
///
/// [`Exchange::gather`], for slices of plain records in the byte order of the machine: all ranks must run on one kind
/// of it.
///
/// # Errors
/// [`Lost::Rank`], and [`Lost::Broken`] if what comes is no whole number of records.
pub fn gathered<T: bytemuck::AnyBitPattern + bytemuck::NoUninit>(
    exchange: &(impl Exchange + ?Sized),
    own: &[T],
) -> Result<Vec<Vec<T>>, Lost> {
    records(exchange.gather(bytemuck::cast_slice(own))?)
}

/// Records for every rank, against those for this one, by rank.
///
/// [`Exchange::all_to_all`], for plain records; `to` has one list per rank.
///
/// # Errors
/// [`Lost::Rank`], and [`Lost::Broken`] if what comes is no whole number of records.
pub fn exchanged<T: bytemuck::AnyBitPattern + bytemuck::NoUninit>(
    exchange: &(impl Exchange + ?Sized),
    to: &[Vec<T>],
) -> Result<Vec<Vec<T>>, Lost> {
    let bytes = to
        .iter()
        .map(|records| bytemuck::cast_slice(records).to_vec());
    records(exchange.all_to_all(bytes.collect())?)
}

/// Bytes need not be aligned as records are.
fn records<T: bytemuck::AnyBitPattern + bytemuck::NoUninit>(
    lists: Vec<Vec<u8>>,
) -> Result<Vec<Vec<T>>, Lost> {
    let record = size_of::<T>();
    let whole = |(rank, bytes): (usize, Vec<u8>)| {
        if !bytes.len().is_multiple_of(record) {
            let bytes = bytes.len();
            return Err(Lost::Broken {
                rank,
                bytes,
                record,
            });
        }
        Ok(bytemuck::pod_collect_to_vec(&bytes))
    };
    lists.into_iter().enumerate().map(whole).collect()
}

/// One rank that has all tiles.
///
/// For tiles one after another: whatever is said is heard at once and by itself.
#[derive(Clone, Copy, Debug, Default)]
pub struct Solo;

impl Exchange for Solo {
    fn ranks(&self) -> usize {
        1
    }
    fn rank(&self) -> usize {
        0
    }
    fn all_to_all(&self, to: Vec<Vec<u8>>) -> Result<Vec<Vec<u8>>, Lost> {
        Ok(to)
    }
}

/// An exchange that counts the bytes that this rank sends to others.
///
/// What a rank says to itself does not count, for it does not travel.
pub struct Counted<'a, E: ?Sized> {
    inner: &'a E,
    sent: AtomicU64,
}

impl<'a, E: Exchange + ?Sized> Counted<'a, E> {
    /// Counts from now on.
    pub fn new(inner: &'a E) -> Self {
        let sent = AtomicU64::new(0);
        Self { inner, sent }
    }

    /// Bytes sent so far.
    pub fn sent(&self) -> u64 {
        self.sent.load(Ordering::Relaxed)
    }
}

impl<E: Exchange + ?Sized> Exchange for Counted<'_, E> {
    fn ranks(&self) -> usize {
        self.inner.ranks()
    }
    fn rank(&self) -> usize {
        self.inner.rank()
    }
    fn all_to_all(&self, to: Vec<Vec<u8>>) -> Result<Vec<Vec<u8>>, Lost> {
        let others = to.iter().enumerate().filter(|(r, _)| *r != self.rank());
        let bytes = others.map(|(_, bytes)| bytes.len() as u64).sum();
        self.sent.fetch_add(bytes, Ordering::Relaxed);
        self.inner.all_to_all(to)
    }
}

/// Which rank has which tiles: each so many that follow each other.
///
/// Numbers of tiles differ by one at most. With fewer tiles than ranks some have none.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Deal {
    /// All tiles.
    pub tiles: usize,
    /// All ranks.
    pub ranks: usize,
}

impl Deal {
    /// The tiles of a rank.
    ///
    /// Ascending with the ranks, so that what is gathered by rank is in the order of tiles. Panics without ranks.
    pub fn of(&self, rank: usize) -> std::ops::Range<usize> {
        let first = |rank: usize| rank * self.tiles / self.ranks;
        first(rank)..first(rank + 1)
    }

    /// The most tiles that a rank has.
    ///
    /// As often must all ask where each asks for its tiles one by one.
    pub fn most(&self) -> usize {
        self.tiles.div_ceil(self.ranks)
    }

    /// The rank that has a tile.
    ///
    /// Of tiles that do not exist it says nothing. Panics without tiles.
    pub fn rank_of(&self, tile: usize) -> usize {
        ((tile + 1) * self.ranks).div_ceil(self.tiles) - 1
    }
}
