//! The hot kernels, and what each backend owes.

use geom_core::{Backend, Cpu};

/// Where the kernels of this crate run.
pub trait ContourBackend: Backend {}

impl ContourBackend for Cpu {}
