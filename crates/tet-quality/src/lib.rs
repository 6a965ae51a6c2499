#![doc = include_str!("../README.md")]

pub use geom_core;

pub mod surface;
