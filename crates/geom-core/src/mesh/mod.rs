//! Triangle, quad and tetrahedral meshes: valid by construction, positions in Å.
//!
//! - the meshes, with regions of tetrahedra and kinds of their vertices
//! - [`Halfedges`]: who is whose neighbour
//! - areas, volumes, bounds; [`six_volume`]
//! - [`quality`]: angles and radius ratios of triangles, [`TriangleReport`]
//! - [`SurfaceAudit`], [`VolumeAudit`], [`BoundaryComparison`]: is it closed, manifold, oriented, positive, filled?
//! - [`shapes`]: spheres, tori and boxes of exact properties
//!
//! ```
//! use geom_core::mesh::{SurfaceAudit, TriangleReport, shapes};
//! let torus = shapes::torus(3.0, 1.0, 40, 16);
//! let audit = SurfaceAudit::of(&torus);
//! assert!(audit.is_closed_manifold());
//! assert!(TriangleReport::of(&torus).min_angle_deg > 20.0);
//! ```

mod audit;
mod halfedge;
mod measure;
pub mod quality;
pub mod shapes;

pub use audit::{BoundaryComparison, Component, Faults, RegionAudit, SurfaceAudit, VolumeAudit};
pub use halfedge::Halfedges;
pub use measure::six_volume;
pub use quality::TriangleReport;

use crate::Point3;
use crate::compute::parallel;
use crate::id::MAX_ELEMENTS;

/// Why a mesh cannot be made.
///
/// Where several elements are at fault, the first by number is named. Constructors of meshes look at counts first, then
/// at positions, then at the corners of one element after the other.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum MeshError {
    /// A coordinate is NaN or infinite.
    #[error("vertex {vertex} has a coordinate that is not a finite number")]
    NotFinite {
        /// The vertex.
        vertex: usize,
    },
    /// An element names a vertex that does not exist.
    #[error("element {element} names vertex {vertex}, but there are only {vertices} vertices")]
    OutOfRange {
        /// The triangle, quad or tetrahedron.
        element: usize,
        /// The vertex it names.
        vertex: u32,
        /// Number of vertices.
        vertices: usize,
    },
    /// An element names one vertex twice.
    #[error("element {element} names vertex {vertex} twice")]
    Repeated {
        /// The triangle, quad or tetrahedron.
        element: usize,
        /// The vertex.
        vertex: u32,
    },
    /// More elements than an index can name.
    #[error("{count} elements, more than the {MAX_ELEMENTS} that an index can name")]
    TooMany {
        /// Number of elements.
        count: usize,
    },
    /// Per-element values and elements differ in number.
    #[error("{values} {what} for {elements} elements")]
    Length {
        /// What the values are.
        what: &'static str,
        /// Number of values.
        values: usize,
        /// Number of elements.
        elements: usize,
    },
    /// A tetrahedron has the region that stands for what is outside the mesh.
    #[error("tetrahedron {element} is of region {OUTSIDE}, which stands for what is outside")]
    Outside {
        /// The tetrahedron.
        element: usize,
    },
    /// Two or more faces use an edge in the same direction, or more than two use it.
    #[error(
        "edge {from}–{to} of face {face} is used by more than two faces or twice in one direction"
    )]
    NonManifoldEdge {
        /// The later face.
        face: usize,
        /// Start of the edge in that face.
        from: u32,
        /// End of the edge in that face.
        to: u32,
    },
    /// The faces around a vertex form more than one fan.
    #[error("the faces around vertex {vertex} form more than one fan")]
    NonManifoldVertex {
        /// The vertex.
        vertex: u32,
    },
}

/// Refuses counts beyond what an index can name, positions that are not finite and corners that do not fit, in this
/// order. Parallel, and the element that is named is the first all the same.
fn check<const N: usize>(positions: &[Point3], elements: &[[u32; N]]) -> Result<(), MeshError> {
    for count in [positions.len(), elements.len()] {
        if count > MAX_ELEMENTS {
            return Err(MeshError::TooMany { count });
        }
    }
    let broken = |v: usize| positions[v].iter().any(|c| !c.is_finite());
    if let Some(vertex) = parallel::first(positions.len(), broken) {
        return Err(MeshError::NotFinite { vertex });
    }
    check_corners(positions.len(), elements)
}

/// Every corner lies below `vertices`, and those of one element differ.
fn check_corners<const N: usize>(vertices: usize, elements: &[[u32; N]]) -> Result<(), MeshError> {
    let bad = |element: usize| {
        let corners = &elements[element];
        let differ = (1..N).all(|k| !corners[..k].contains(&corners[k]));
        !differ || corners.iter().any(|&v| v as usize >= vertices)
    };
    let Some(element) = parallel::first(elements.len(), bad) else {
        return Ok(());
    };
    let corners = &elements[element];
    for (k, &vertex) in corners.iter().enumerate() {
        if vertex as usize >= vertices {
            return Err(MeshError::OutOfRange {
                element,
                vertex,
                vertices,
            });
        }
        if corners[..k].contains(&vertex) {
            return Err(MeshError::Repeated { element, vertex });
        }
    }
    Ok(())
}

/// A surface of triangles, counter-clockwise seen from outside. Corners are in range and differ;
/// positions are finite. Nothing is promised of manifoldness: see [`SurfaceAudit`]. Vertices that no triangle uses and
/// triangles without area are allowed.
///
/// Index conventions: vertex `v` is `positions()[v]`; triangle `[a, b, c]` has the normal `(b − a) × (c − a)`, which
/// points out of the body that the surface bounds. The default is the empty mesh. Positions and triangles cannot be
/// changed in place, so that what was checked stays true: take them out by [`TriMesh::into_parts`], and make a new
/// mesh.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TriMesh {
    positions: Vec<Point3>,
    triangles: Vec<[u32; 3]>,
}

impl TriMesh {
    /// A mesh of these vertices and triangles; refuses what is out of range or not finite.
    ///
    /// # Errors
    /// [`MeshError::TooMany`], [`MeshError::NotFinite`], [`MeshError::OutOfRange`] or [`MeshError::Repeated`], in this
    /// order. One parallel pass over both arrays; nothing is copied.
    pub fn new(positions: Vec<Point3>, triangles: Vec<[u32; 3]>) -> Result<Self, MeshError> {
        check(&positions, &triangles)?;
        Ok(Self {
            positions,
            triangles,
        })
    }
    /// Vertex positions, Å.
    pub fn positions(&self) -> &[Point3] {
        &self.positions
    }
    /// Corners per triangle.
    pub fn triangles(&self) -> &[[u32; 3]] {
        &self.triangles
    }
    /// The three corner positions of a triangle.
    ///
    /// # Panics
    /// If there is no such triangle.
    pub fn corners(&self, triangle: usize) -> [Point3; 3] {
        self.triangles[triangle].map(|v| self.positions[v as usize])
    }
    /// Gives positions and triangles away.
    pub fn into_parts(self) -> (Vec<Point3>, Vec<[u32; 3]>) {
        (self.positions, self.triangles)
    }

    /// The mesh without the vertices of no triangle, and the number here of each of its vertices. Triangles keep their order.
    pub fn without_unused(&self) -> (Self, Vec<u32>) {
        let mut number = vec![u32::MAX; self.positions.len()];
        let all = self.triangles.as_flattened();
        all.iter().for_each(|&v| number[v as usize] = 0);
        let is_used = |v: &u32| number[*v as usize] == 0;
        let used: Vec<u32> = (0..self.positions.len() as u32).filter(is_used).collect();
        for (new, &v) in used.iter().enumerate() {
            number[v as usize] = new as u32;
        }
        let corners = |t: &[u32; 3]| t.map(|v| number[v as usize]);
        let mesh = Self {
            positions: used.iter().map(|&v| self.positions[v as usize]).collect(),
            triangles: self.triangles.iter().map(corners).collect(),
        };
        (mesh, used)
    }

    /// The connected components, the one of the largest area first; vertices without a triangle belong
    /// to none.
    ///
    /// Triangles belong together if they share a vertex, an edge is not needed: two cones that touch with their tips
    /// are one component. Vertices and triangles keep their order within each, equal areas the order of their first
    /// triangles. `O(n log n)`.
    pub fn components(&self) -> Vec<TriMesh> {
        let mut sets = crate::compute::sets::DisjointSets::new(self.positions.len());
        for &[a, b, c] in &self.triangles {
            sets.join(a, b);
            sets.join(b, c);
        }
        let mut number = vec![usize::MAX; self.positions.len()];
        let mut components: Vec<Vec<[u32; 3]>> = Vec::new();
        for &triangle in &self.triangles {
            let set = sets.find(triangle[0]) as usize;
            if number[set] == usize::MAX {
                number[set] = components.len();
                components.push(Vec::new());
            }
            components[number[set]].push(triangle);
        }
        let without_vertices = |triangles| TriMesh {
            positions: Vec::new(),
            triangles,
        };
        let mut meshes: Vec<(f64, TriMesh)> = components
            .into_iter()
            .map(|triangles| (0.0, without_vertices(triangles)))
            .collect();
        parallel::for_each(&mut meshes, |_, (area, mesh)| {
            let mut vertices = mesh.triangles.as_flattened().to_vec();
            vertices.sort_unstable();
            vertices.dedup();
            for v in mesh.triangles.as_flattened_mut() {
                *v = vertices.partition_point(|u| u < v) as u32;
            }
            let position = |&v: &u32| self.positions[v as usize];
            mesh.positions = vertices.iter().map(position).collect();
            *area = mesh.area();
        });
        meshes.sort_by(|a, b| b.0.total_cmp(&a.0));
        meshes.into_iter().map(|m| m.1).collect()
    }
}

/// A surface of quads, counter-clockwise seen from outside. Valid like [`TriMesh`].
///
/// Quads need not be flat. Where one is taken for two triangles, the cut runs from its first corner to its third; other
/// codes cut otherwise, so that volumes under bent quads differ by that of the tetrahedron of the four corners.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct QuadMesh {
    positions: Vec<Point3>,
    quads: Vec<[u32; 4]>,
}

impl QuadMesh {
    /// A mesh of these vertices and quads; refuses what is out of range or not finite.
    ///
    /// # Errors
    /// Those of [`TriMesh::new`].
    pub fn new(positions: Vec<Point3>, quads: Vec<[u32; 4]>) -> Result<Self, MeshError> {
        check(&positions, &quads)?;
        Ok(Self { positions, quads })
    }
    /// Vertex positions, Å.
    pub fn positions(&self) -> &[Point3] {
        &self.positions
    }
    /// Corners per quad.
    pub fn quads(&self) -> &[[u32; 4]] {
        &self.quads
    }
    /// Gives positions and quads away.
    pub fn into_parts(self) -> (Vec<Point3>, Vec<[u32; 4]>) {
        (self.positions, self.quads)
    }
    /// Each quad cut in two along its first diagonal. Triangles `2 q` and `2 q + 1` are the halves of quad `q`, and
    /// vertices keep their numbers.
    pub fn into_triangles(self) -> TriMesh {
        let halves = |&[a, b, c, d]: &[u32; 4]| [[a, b, c], [a, c, d]];
        TriMesh {
            triangles: self.quads.iter().flat_map(halves).collect(),
            positions: self.positions,
        }
    }
}

/// The number of a material of a [`TetMesh`]. [`EXTERIOR`], [`INTERIOR`] and any numbers between that and [`OUTSIDE`]:
/// up to 253 bodies beside the molecule.
pub type Region = u8;
/// The region around the molecule.
pub const EXTERIOR: Region = 0;
/// The molecule.
pub const INTERIOR: Region = 1;
/// Beyond the mesh: what lies on the other side of its outer boundary. No tetrahedron has it.
pub const OUTSIDE: Region = u8::MAX;

/// How a vertex of a [`TetMesh`] may move.
///
/// Smoothers ask for it before they move a vertex, and move it only so. The meshers of boxes set all five kinds; meshes
/// from files know of [`VertexKind::Interior`] and [`VertexKind::Surface`] only, as [`TetMesh::with_regions`] finds
/// them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum VertexKind {
    /// Inside of a region: freely.
    #[default]
    Interior,
    /// On the surface between two regions, or between a region and [`OUTSIDE`]: along it. Where several of these meet, along
    /// all of them, which may be nowhere.
    Surface,
    /// On a face of the bounding box: in that plane. Axis 0…2.
    BoxFace {
        /// The axis along which it must not move.
        axis: u8,
    },
    /// On an edge of the bounding box: along that edge. Axis 0…2.
    BoxEdge {
        /// The axis along which it may move.
        axis: u8,
    },
    /// Not at all: box corners, junctions of surfaces with the box.
    Fixed,
}

/// A volume of tetrahedra `(a, b, c, d)` with a region each. Valid like [`TriMesh`]; the sign of the
/// volumes is not checked here: see [`VolumeAudit`].
///
/// `(b − a, c − a, d − a)` of a good tetrahedron is right-handed ([`six_volume`] is positive), and [`FACES`] lists its
/// faces as seen from outside. The default is the empty mesh.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TetMesh {
    positions: Vec<Point3>,
    tets: Vec<[u32; 4]>,
    regions: Vec<Region>,
    kinds: Vec<VertexKind>,
}

impl TetMesh {
    /// A mesh of these vertices and tetrahedra, all of region [`INTERIOR`], with every boundary
    /// vertex of kind [`VertexKind::Surface`].
    ///
    /// # Errors
    /// Those of [`TetMesh::with_kinds`].
    pub fn new(positions: Vec<Point3>, tets: Vec<[u32; 4]>) -> Result<Self, MeshError> {
        let regions = vec![INTERIOR; tets.len()];
        Self::with_regions(positions, tets, regions)
    }

    /// A mesh with a region per tetrahedron; every vertex between two regions or on the boundary is
    /// of kind [`VertexKind::Surface`].
    ///
    /// # Errors
    /// Those of [`TetMesh::with_kinds`].
    pub fn with_regions(
        positions: Vec<Point3>,
        tets: Vec<[u32; 4]>,
        regions: Vec<Region>,
    ) -> Result<Self, MeshError> {
        let kinds = vec![VertexKind::Interior; positions.len()];
        let mut mesh = Self::with_kinds(positions, tets, regions, kinds)?;
        for face in mesh.interfaces() {
            for v in face.triangle {
                mesh.kinds[v as usize] = VertexKind::Surface;
            }
        }
        Ok(mesh)
    }

    /// A mesh with a region per tetrahedron and a kind per vertex. Kinds are believed: whether a vertex of kind
    /// [`VertexKind::Interior`] lies on the boundary is not looked at.
    ///
    /// # Errors
    /// Those of [`TriMesh::new`], [`MeshError::Length`] if regions or kinds are not as many as their elements, and
    /// [`MeshError::Outside`] if a region is [`OUTSIDE`].
    pub fn with_kinds(
        positions: Vec<Point3>,
        tets: Vec<[u32; 4]>,
        regions: Vec<Region>,
        kinds: Vec<VertexKind>,
    ) -> Result<Self, MeshError> {
        check(&positions, &tets)?;
        if regions.len() != tets.len() {
            let (values, elements) = (regions.len(), tets.len());
            return Err(MeshError::Length {
                what: "regions",
                values,
                elements,
            });
        }
        if kinds.len() != positions.len() {
            let (values, elements) = (kinds.len(), positions.len());
            return Err(MeshError::Length {
                what: "vertex kinds",
                values,
                elements,
            });
        }
        // Its faces would count as the mesh's boundary on both sides.
        if let Some(element) = regions.iter().position(|&r| r == OUTSIDE) {
            return Err(MeshError::Outside { element });
        }
        Ok(Self {
            positions,
            tets,
            regions,
            kinds,
        })
    }

    /// Vertex positions, Å.
    pub fn positions(&self) -> &[Point3] {
        &self.positions
    }
    /// Corners per tetrahedron.
    pub fn tets(&self) -> &[[u32; 4]] {
        &self.tets
    }
    /// Region per tetrahedron.
    pub fn regions(&self) -> &[Region] {
        &self.regions
    }
    /// Kind per vertex.
    pub fn kinds(&self) -> &[VertexKind] {
        &self.kinds
    }
    /// The four corner positions of a tetrahedron.
    ///
    /// # Panics
    /// If there is no such tetrahedron.
    pub fn corners(&self, tet: usize) -> [Point3; 4] {
        self.tets[tet].map(|v| self.positions[v as usize])
    }
    /// Gives positions, tetrahedra, regions and vertex kinds away.
    pub fn into_parts(self) -> (Vec<Point3>, Vec<[u32; 4]>, Vec<Region>, Vec<VertexKind>) {
        (self.positions, self.tets, self.regions, self.kinds)
    }

    /// The faces between different regions and on the boundary, by the lower-numbered tetrahedron's
    /// number, then by face. Faces with more than two tetrahedra are left out: see [`VolumeAudit`]. The faces of all
    /// tetrahedra are sorted for it: about 100 bytes per tetrahedron while it runs.
    pub fn interfaces(&self) -> Vec<Interface> {
        use rayon::prelude::*;
        let faces = audit::sorted_faces(&self.tets);
        let mut out: Vec<(u64, Interface)> = faces
            .chunk_by(|a, b| a.0 == b.0)
            .filter_map(|group| {
                let side = |slot: u64| {
                    let region = self.regions[(slot / 4) as usize];
                    (region, audit::face(&self.tets, slot))
                };
                match *group {
                    [(_, only)] => {
                        let (inside, triangle) = side(only);
                        Some((
                            only,
                            Interface {
                                triangle,
                                inside,
                                outside: OUTSIDE,
                            },
                        ))
                    }
                    [(_, first), (_, second)] => {
                        let ((a, first_face), (b, second_face)) = (side(first), side(second));
                        if a == b {
                            return None;
                        }
                        // Seen from the region of the higher number, e.g. out of the molecule.
                        let (triangle, inside, outside) = if a > b {
                            (first_face, a, b)
                        } else {
                            (second_face, b, a)
                        };
                        Some((
                            first,
                            Interface {
                                triangle,
                                inside,
                                outside,
                            },
                        ))
                    }
                    _ => None,
                }
            })
            .collect();
        out.par_sort_unstable_by_key(|&(slot, _)| slot);
        out.into_iter().map(|(_, face)| face).collect()
    }

    /// The boundary of a region as a surface that points out of it: against other regions and
    /// against the outside. Vertices keep their order; those off the boundary are dropped. Of a conforming mesh it is
    /// closed, since it bounds a volume, but not manifold where the region touches itself in an edge or a vertex only;
    /// empty for a region without tetrahedra.
    pub fn region_surface(&self, region: Region) -> TriMesh {
        let triangles = self.interfaces().into_iter().filter_map(|face| {
            let [a, b, c] = face.triangle;
            if face.inside == region {
                Some([a, b, c])
            } else if face.outside == region {
                Some([a, c, b])
            } else {
                None
            }
        });
        let (positions, triangles) = compact(&self.positions, triangles.collect());
        TriMesh {
            positions,
            triangles,
        }
    }
}

/// Drops the vertices that no element uses; the others keep their order.
fn compact<const N: usize>(
    positions: &[Point3],
    mut elements: Vec<[u32; N]>,
) -> (Vec<Point3>, Vec<[u32; N]>) {
    let mut number = vec![u32::MAX; positions.len()];
    for &v in elements.as_flattened() {
        number[v as usize] = 0;
    }
    let mut kept = Vec::new();
    for (p, n) in positions.iter().zip(&mut number) {
        if *n == 0 {
            *n = kept.len() as u32;
            kept.push(*p);
        }
    }
    for v in elements.as_flattened_mut() {
        *v = number[*v as usize];
    }
    (kept, elements)
}

/// Do the corners, from the lowest on, run lowest, middle, highest? It tells the two senses of a face apart, whichever
/// corner comes first.
pub(crate) fn is_even([a, b, c]: [u32; 3]) -> bool {
    (a < b) as u8 + (b < c) as u8 + (c < a) as u8 == 2
}

/// The corners of the faces of a positive tetrahedron, seen from outside; face `k` lies opposite
/// corner `k`.
pub const FACES: [[usize; 3]; 4] = [[1, 2, 3], [0, 3, 2], [0, 1, 3], [0, 2, 1]];
/// The corners of a face in ascending order: the same for all that share it.
pub fn sorted(mut face: [u32; 3]) -> [u32; 3] {
    face.sort_unstable();
    face
}

/// The corners of the edges of a tetrahedron. Edge `k` and edge `5 − k` lie opposite each other: they share no corner.
pub const EDGES: [[usize; 2]; 6] = [[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]];

/// A face between two regions of a [`TetMesh`], or on its boundary.
///
/// Of regions `a > b` the face is seen from `b`, so that the surface of the molecule points out of it into the
/// exterior. On the boundary of the mesh it points away from the mesh.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Interface {
    /// Corners, counter-clockwise seen from the outer side.
    pub triangle: [u32; 3],
    /// Region on the inner side: the higher number of the two; on the boundary the only one.
    pub inside: Region,
    /// Region on the outer side, or [`OUTSIDE`].
    pub outside: Region,
}
