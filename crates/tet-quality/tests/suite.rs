//! All tests of the crate as one program: each program links and compiles what it uses anew.

mod backends;
mod groups;
mod laws;
mod parts;
mod thesis;
