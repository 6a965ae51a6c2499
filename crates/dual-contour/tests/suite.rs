//! All tests of the crate as one program: each program links and compiles what it uses anew.

mod backends;
mod common;
mod inside;
mod laws;
mod options;
mod thesis;
mod tiles;
