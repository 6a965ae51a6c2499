//! How a computation runs: backend, progress, cancellation.

use std::ops::ControlFlow;

/// The watcher asked to stop.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("cancelled by the caller")]
pub struct Cancelled;

/// Is told of progress and may stop the work. Asked between batches, on the calling thread.
///
/// Closures implement it.
pub trait Monitor: Sync {
    /// `done` of `total` units of `stage` are finished; `Break` cancels.
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
/// `pool.install(|| …)`.
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
