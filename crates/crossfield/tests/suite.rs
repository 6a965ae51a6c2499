//! All tests of the crate as one program: each program links and compiles what it uses anew.

mod anisotropy;
mod backends;
mod details;
mod laws;
mod mending;
mod thesis;
