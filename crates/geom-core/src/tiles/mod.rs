//! Bodies that do not fit into one piece of memory: in tiles, one after another or side by side.
//!
//! A tile is a box of cells of a lattice that all tiles share ([`partition`]). What a tile computes depends on that
//! lattice and on samples within a stated distance alone, so each computes what it needs beyond its border itself, bit
//! for bit as its neighbours do; what travels are the names of border vertices, not values.
//!
//! - [`partition`]: Morton ranges of root cells, one per tile, about equally heavy
//! - [`exchange`]: ranks and what they send each other: alone, in threads ([`threads`]), by MPI (feature `mpi`)
//! - [`piece`]: the elements of a tile and the vertices that others may share; a digest of a mesh in pieces
//! - [`spill`]: pieces on disk while others are worked on
//! - [`border`]: who shares which vertex, global numbers by an exclusive scan, ghost elements
//! - [`patches`]: balls around what needs another look, each whole in one tile
//! - [`parts`]: connected surfaces across all tiles, by union–find on border pairs
//!
//! The order of work, as in `examples/20_tiles.rs`: [`Tiles::new`] cuts the lattice; each rank makes the [`Piece`] of
//! each of its tiles, puts it aside by [`Spill`] and keeps a [`border::Border`] of it; [`border::number`] gives every
//! vertex its number in the whole; [`border::ghosts`] tells each tile what lies beyond; [`parts::closed`] counts the
//! surfaces. Only pieces are large, and only one of a rank is in memory at a time; borders grow as surfaces do, not as
//! volumes.
//!
//! All functions that take an [`Exchange`] are collective: every rank must call them, in the same order. What those of
//! [`border`] and [`parts`] give does not depend on how many ranks there are.

pub mod border;
pub mod exchange;
#[cfg(feature = "mpi")]
pub mod mpi;
pub mod partition;
pub mod parts;
pub mod patches;
pub mod piece;
pub mod spill;
pub mod threads;

pub use exchange::{Counted, Exchange, Lost, Solo};
pub use partition::Tiles;
pub use patches::Patches;
pub use piece::Piece;
pub use spill::{Spill, SpillError};
pub use threads::Threads;
