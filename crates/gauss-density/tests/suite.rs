//! All tests of the crate as one program: each program links and compiles what it uses anew.

mod backends;
mod bounds;
mod gpu;
mod kernels;
mod laws;
mod models;
mod options;
mod samples;
mod thesis;
mod windows;
