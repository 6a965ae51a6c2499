//! What lies near a point: [`bvh`], the triangles of a surface; [`crossing`], those that go through each other;
//! `nearest`, points (feature `search`, kiddo).
//!
//! ```
//! use geom_core::search::bvh::TriangleTree;
//! use geom_core::{Point3, mesh::shapes};
//! let tree = TriangleTree::new(&shapes::icosphere(1.0, 3))?;
//! let foot = tree.closest(&Point3::new(3.0, 0.0, 0.0));
//! assert!((foot.distance - 2.0).abs() < 0.01);
//! # Ok::<(), geom_core::search::bvh::TreeError>(())
//! ```

pub mod bvh;
pub mod crossing;
#[cfg(feature = "search")]
pub mod nearest;
