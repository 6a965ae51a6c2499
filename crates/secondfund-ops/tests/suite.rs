//! All tests of the crate as one program: each program links and compiles what it uses anew.

mod backends;
mod details;
mod disk;
mod inside;
mod laws;
mod patches;
mod thesis;
