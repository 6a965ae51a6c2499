#![doc = include_str!("../README.md")]
//!
//! # What the programs share
//!
//! Arguments, a session (threads, backend, progress, outputs that appear together or not at all,
//! `report.json`), and pictures, so that each program shows only its crate's own calls.

pub mod args;
pub mod batch;
#[cfg(feature = "analysis")]
pub mod crosses;
pub mod device;
pub mod input;
mod page;
pub mod picture;
pub mod products;
pub mod scripts;
pub mod session;
pub mod steps;
pub mod words;

pub use batch::run_each;
pub use session::{Failure, Session, run};

#[doc = include_str!("../../README.md")]
#[cfg(doctest)]
pub struct FrontDoor;
