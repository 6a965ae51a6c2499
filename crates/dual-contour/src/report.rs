//! What happened on the way.

/// Counts of a run; never times.
#[derive(Clone, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Report {
    /// Edge of the finest cells, Å.
    pub spacing: f64,
    /// Leaves of the octree.
    pub leaves: usize,
    /// Leaves that carry a surface.
    pub surface_cells: usize,
    /// Leaves whose labels are ambiguous and that were cut into twelve tetrahedra.
    pub split_cells: usize,
    /// Dual vertices that were held back from their place to keep all volumes positive.
    pub held_back: usize,
    /// Vertices added on edges where no fan of triangles keeps all volumes positive, and on the box.
    pub added_vertices: usize,
    /// Triangles of the surface.
    pub triangles: usize,
    /// Tetrahedra.
    pub tets: usize,
}
