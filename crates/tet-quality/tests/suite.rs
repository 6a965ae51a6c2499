//! All tests of the crate as one program: each program links and compiles what it uses anew.

mod backends;
mod cavities;
mod groups;
mod inside;
mod laws;
mod metrics;
mod parts;
mod thesis;
