//! What happened on the way.

/// Counts of a run; never times.
#[derive(Clone, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Report {
    /// Edge of the finest cells, Å.
    pub spacing: f64,
    /// Leaves of the octree; where none is made, the cells that carry the surface.
    pub leaves: usize,
    /// Leaves that carry a surface.
    pub surface_cells: usize,
    /// Leaves whose labels are ambiguous and that were cut into twelve tetrahedra.
    /// More than one in a hundred of `surface_cells` says that the lattice is too coarse for the density. 0 with
    /// stuffing, which cuts none.
    pub split_cells: usize,
    /// Vertices that were clamped on the way to their place: dual vertices to keep all volumes positive,
    /// vertices of stuffing to keep the surface a manifold.
    /// Points of the mesh beside them lie off the surface; an improvement that knows the field can bring these there.
    #[cfg_attr(feature = "serde", serde(alias = "held_back"))]
    pub clamped: usize,
    /// Stuffing: vertices snapped onto an interface.
    pub snapped: usize,
    /// Vertices beside those of cells and corners: where edges are cut.
    /// With stuffing the cuts of edges, which beside the snapped vertices are those of the surface; with dual
    /// contouring the few edges around which no fan is positive, and those in the box where it clips.
    pub added_vertices: usize,
    /// Groups of lattice points that were too small ([`Options::prune`](crate::Options)).
    pub pruned_groups: usize,
    /// Lattice points that changed sides with them.
    pub pruned_points: u64,
    /// Triangles of the surface.
    pub triangles: usize,
    /// Tetrahedra.
    pub tets: usize,
}
