//! Ranks as threads of one process.
//!
//! For tests and for one machine with room for several tiles. A turn of the exchange has two halves: all put their
//! messages on a table, then all take theirs; nobody puts for the next turn before everybody has taken.

use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};

use super::exchange::{Exchange, Lost};

/// What lies between the ranks.
struct Table {
    state: Mutex<State>,
    turned: Condvar,
}

/// `put` counts up to the number of ranks, then `taken` does, then both begin again.
struct State {
    /// What rank `r` gets from each other.
    boxes: Vec<Vec<Vec<u8>>>,
    /// Ranks that have put theirs on the table, and that have taken theirs from it.
    put: usize,
    taken: usize,
    /// The first rank that failed.
    failed: Option<usize>,
}

impl Table {
    /// A rank that panicked while it had the lock does not matter: `failed` says that it did.
    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Failure comes first, even if what is waited for is there: ranks end as early as they can.
    fn wait_until<'a>(
        &self,
        mut state: MutexGuard<'a, State>,
        ready: impl Fn(&State) -> bool,
    ) -> Result<MutexGuard<'a, State>, Lost> {
        loop {
            if let Some(rank) = state.failed {
                return Err(Lost::Rank { rank });
            }
            if ready(&state) {
                return Ok(state);
            }
            state = (self.turned.wait(state)).unwrap_or_else(PoisonError::into_inner);
        }
    }
}

/// One of several ranks of [`Threads::run`].
pub struct Threads<'a> {
    table: &'a Table,
    rank: usize,
    ranks: usize,
}

/// Marks a rank as failed unless it has finished: by an error, or by a panic.
struct Watch<'a> {
    table: &'a Table,
    rank: usize,
    finished: bool,
}

impl Drop for Watch<'_> {
    fn drop(&mut self) {
        if !self.finished {
            self.table.lock().failed.get_or_insert(self.rank);
            self.table.turned.notify_all();
        }
    }
}

impl Threads<'_> {
    /// Runs a program on so many ranks, and gives what each returns. Where one fails, the others end with
    /// [`Lost::Rank`] at their next exchange; a panic goes on in the caller.
    ///
    /// ```
    /// use geom_core::tiles::{Exchange, Lost, Threads};
    /// let sums = Threads::run(3, |rank| rank.scan(10 + rank.rank() as u64));
    /// assert_eq!(sums, [Ok((0, 33)), Ok((10, 33)), Ok((21, 33))]);
    /// let lost = Threads::run(2, |rank| match rank.rank() {
    ///     0 => rank.scan(1).map_err(|lost| lost.to_string()),
    ///     _ => Err("the disk is full".to_owned()),
    /// });
    /// assert_eq!(lost[0], Err("rank 1 has failed, so the others stop".to_owned()));
    /// ```
    ///
    /// `program` is called once per rank, each in a thread of its own; the results are in the order of ranks. Loops
    /// that run in parallel within it share the threads of the process. No ranks give no results.
    pub fn run<T: Send, E: Send>(
        ranks: usize,
        program: impl Fn(&Threads<'_>) -> Result<T, E> + Sync,
    ) -> Vec<Result<T, E>> {
        let table = Table {
            state: Mutex::new(State {
                boxes: vec![Vec::new(); ranks],
                put: 0,
                taken: 0,
                failed: None,
            }),
            turned: Condvar::new(),
        };
        let one = |rank: usize| {
            let table = &table;
            let mut watch = Watch {
                table,
                rank,
                finished: false,
            };
            let result = program(&Threads { table, rank, ranks });
            watch.finished = result.is_ok();
            result
        };
        std::thread::scope(|scope| {
            let one = &one;
            let started: Vec<_> = (0..ranks)
                .map(|rank| scope.spawn(move || one(rank)))
                .collect();
            let ended: Vec<_> = started.into_iter().map(|thread| thread.join()).collect();
            let unwound = |panic| std::panic::resume_unwind(panic);
            ended
                .into_iter()
                .map(|r| r.unwrap_or_else(unwound))
                .collect()
        })
    }
}

impl Exchange for Threads<'_> {
    fn ranks(&self) -> usize {
        self.ranks
    }
    fn rank(&self) -> usize {
        self.rank
    }
    fn all_to_all(&self, to: Vec<Vec<u8>>) -> Result<Vec<Vec<u8>>, Lost> {
        let (table, n) = (self.table, self.ranks);
        // Those of the last turn have been taken first.
        let mut state = table.wait_until(table.lock(), |state| state.put < n)?;
        for (r, bytes) in to.into_iter().enumerate().take(n) {
            state.boxes[r].resize(n, Vec::new());
            state.boxes[r][self.rank] = bytes;
        }
        state.put += 1;
        table.turned.notify_all();
        let mut state = table.wait_until(state, |state| state.put == n)?;
        let own = std::mem::take(&mut state.boxes[self.rank]);
        state.taken += 1;
        if state.taken == n {
            (state.put, state.taken) = (0, 0);
            table.turned.notify_all();
        }
        Ok(own)
    }
}
