//! All tests of the crate as one program: each program links and compiles what it uses anew.

mod backends;
mod details;
mod exact;
mod laws;
mod morph;
