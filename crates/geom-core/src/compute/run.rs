//! How a computation runs: backend, progress, cancellation.
//!
//! Verbs that may take long have a [`Run`] as their last argument. The example watches one and stops it:
//!
//! ```
//! use std::ops::ControlFlow;
//! use geom_core::{Cancelled, Cpu, Run};
//! let patience = |_stage: &'static str, done: u64, _total: u64| match done {
//!     0..3 => ControlFlow::Continue(()),
//!     _ => ControlFlow::Break(()),
//! };
//! let run = Run::on(&Cpu).watched_by(&patience);
//! assert_eq!(run.progress("steps", 2, 10), Ok(()));
//! assert_eq!(run.progress("steps", 3, 10), Err(Cancelled));
//! ```

use std::ops::ControlFlow;

/// The watcher asked to stop. Errors of the verbs carry it as one of their variants; what was computed so far is
/// dropped.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("cancelled by the caller")]
pub struct Cancelled;

/// Is told of progress and may stop the work. Asked between batches, on the calling thread.
///
/// Closures implement it. Between two questions a verb does not stop, so that cancelling takes as long as a batch.
pub trait Monitor: Sync {
    /// `done` of `total` units of `stage` are finished, 0 where nobody knows how many there will be; `Break` cancels.
    ///
    /// Stages have names that a user may read; `done` counts from 0 within a stage, which may come more than once, and
    /// units of different stages have nothing to do with each other. A verb need not report `done = total`.
    fn progress(&self, stage: &'static str, done: u64, total: u64) -> ControlFlow<()>;
}

impl<F: Fn(&'static str, u64, u64) -> ControlFlow<()> + Sync> Monitor for F {
    fn progress(&self, stage: &'static str, done: u64, total: u64) -> ControlFlow<()> {
        self(stage, done, total)
    }
}

/// Says nothing and never stops.
#[derive(Clone, Copy, Debug, Default)]
pub struct Silent;

impl Monitor for Silent {
    fn progress(&self, _: &'static str, _: u64, _: u64) -> ControlFlow<()> {
        ControlFlow::Continue(())
    }
}

/// How to compute: on which backend, watched by whom. Threads are the caller's:
/// `pool.install(|| …)`. It is two references, to be copied freely.
pub struct Run<'a, B: ?Sized + 'a> {
    /// Where the kernels run.
    pub backend: &'a B,
    /// Who watches.
    pub monitor: &'a dyn Monitor,
}

impl<'a, B: ?Sized> Run<'a, B> {
    /// On this backend, watched by nobody.
    pub fn on(backend: &'a B) -> Self {
        Self {
            backend,
            monitor: &Silent,
        }
    }

    /// Watched by `monitor`.
    pub fn watched_by(self, monitor: &'a dyn Monitor) -> Self {
        Self { monitor, ..self }
    }

    /// The same watcher, another backend.
    pub fn with<C: ?Sized>(self, backend: &'a C) -> Run<'a, C> {
        Run {
            backend,
            monitor: self.monitor,
        }
    }

    /// Reports progress; `Err` when the watcher asks to stop.
    ///
    /// # Errors
    /// [`Cancelled`], to be handed on with `?`.
    pub fn progress(&self, stage: &'static str, done: u64, total: u64) -> Result<(), Cancelled> {
        match self.monitor.progress(stage, done, total) {
            ControlFlow::Continue(()) => Ok(()),
            ControlFlow::Break(()) => Err(Cancelled),
        }
    }
}

impl<B: ?Sized> Clone for Run<'_, B> {
    fn clone(&self) -> Self {
        *self
    }
}
impl<B: ?Sized> Copy for Run<'_, B> {}
