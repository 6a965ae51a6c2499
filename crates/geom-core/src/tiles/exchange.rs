//! Ranks, and what they send each other.

use std::sync::atomic::{AtomicU64, Ordering};

/// Why an exchange ended.
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
pub trait Exchange {
    /// How many there are.
    fn ranks(&self) -> usize;

    /// Which one this is.
    fn rank(&self) -> usize;

    /// Sends `to[r]` to every rank `r` (this one included) and gives what each has sent to this one. All ranks call it
    /// equally often.
    fn all_to_all(&self, to: Vec<Vec<u8>>) -> Result<Vec<Vec<u8>>, Lost>;

    /// What every rank says, by rank.
    fn gather(&self, own: &[u8]) -> Result<Vec<Vec<u8>>, Lost> {
        self.all_to_all(vec![own.to_vec(); self.ranks()])
    }

    /// The sum of the numbers of all ranks before this one, and of all.
    fn scan(&self, own: u64) -> Result<(u64, u64), Lost> {
        let all = gathered::<u64>(self, &[own])?;
        let before = all[..self.rank()].iter().flatten().sum();
        Ok((before, all.iter().flatten().sum()))
    }
}

/// What every rank says, as records.
pub fn gathered<T: bytemuck::AnyBitPattern + bytemuck::NoUninit>(
    exchange: &(impl Exchange + ?Sized),
    own: &[T],
) -> Result<Vec<Vec<T>>, Lost> {
    records(exchange.gather(bytemuck::cast_slice(own))?)
}

/// Records for every rank, against those for this one, by rank.
pub fn exchanged<T: bytemuck::AnyBitPattern + bytemuck::NoUninit>(
    exchange: &(impl Exchange + ?Sized),
    to: &[Vec<T>],
) -> Result<Vec<Vec<T>>, Lost> {
    let bytes = to
        .iter()
        .map(|records| bytemuck::cast_slice(records).to_vec());
    records(exchange.all_to_all(bytes.collect())?)
}

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
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Deal {
    /// All tiles.
    pub tiles: usize,
    /// All ranks.
    pub ranks: usize,
}

impl Deal {
    /// The tiles of a rank.
    pub fn of(&self, rank: usize) -> std::ops::Range<usize> {
        let first = |rank: usize| rank * self.tiles / self.ranks;
        first(rank)..first(rank + 1)
    }

    /// The rank that has a tile.
    pub fn rank_of(&self, tile: usize) -> usize {
        ((tile + 1) * self.ranks).div_ceil(self.tiles) - 1
    }
}
