//! What lies near a point: [`bvh`], the triangles of a surface; [`nearest`], points (feature `search`).

pub mod bvh;
#[cfg(feature = "search")]
pub mod nearest;
