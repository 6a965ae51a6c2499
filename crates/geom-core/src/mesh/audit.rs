//! Closed, manifold, oriented, conforming? Reports that count faults and name the first element.
//!
//! Where a mesh is refused somewhere, the audit says why: each kind of fault is counted, and the first element that has it is named,
//! so that it can be looked at. Nothing is repaired here ([`surface::repair`](crate::surface) does that), and nothing is assumed:
//! the audits sort edges and faces, and need no connectivity that faults would have broken.
//!
//! An audit never fails and never panics on a valid mesh type, whatever its connectivity. Time is that of sorting edges
//! or faces; the memory about 100 bytes per face or tetrahedron while it runs. Printed, an audit is one line of counts
//! and a line per kind of fault.

use std::fmt;

use crate::compute::parallel::{self, sorted_by_number};
use rayon::prelude::*;

use super::{FACES, QuadMesh, Region, TetMesh, TriMesh, is_even, six_volume, sorted};
use crate::compute::sets::{DisjointSets, Sets};
use crate::{Point3, Vector3};

/// Below this multiple of the longest edge to the power of the dimension, an area or a volume is as
/// good as zero: only rounding is left.
const FLAT: f64 = 1e-14;

/// How many elements have a fault, and which is the first.
///
/// First is first by number: the lowest vertex, face or tetrahedron. Edges and faces of tetrahedra, which have no
/// number, go by their vertices, in a [`BoundaryComparison`] by their tetrahedra.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Faults<T> {
    /// Number of elements with the fault.
    pub count: usize,
    /// The first of them.
    pub first: Option<T>,
}

impl<T> Default for Faults<T> {
    fn default() -> Self {
        Self {
            count: 0,
            first: None,
        }
    }
}

impl<T> Faults<T> {
    /// Is there none?
    pub fn none(&self) -> bool {
        self.count == 0
    }

    fn add(&mut self, element: T) {
        self.count += 1;
        self.first.get_or_insert(element);
    }
}

impl<T> FromIterator<T> for Faults<T> {
    fn from_iter<I: IntoIterator<Item = T>>(elements: I) -> Self {
        elements.into_iter().fold(Self::default(), |mut all, e| {
            all.add(e);
            all
        })
    }
}

/// One connected piece of a surface: faces that share a vertex belong together.
///
/// Counts are as in [`SurfaceAudit`], so that sums over all components are those of the surface.
#[derive(Clone, Debug, PartialEq)]
pub struct Component {
    /// Its lowest face.
    pub first_face: u32,
    /// Number of vertices.
    pub vertices: usize,
    /// Number of edges.
    pub edges: usize,
    /// Number of faces.
    pub faces: usize,
    /// Number of edges with one face.
    pub boundary_edges: usize,
    /// Area, Å².
    pub area: f64,
    /// Enclosed volume, Å³: negative for the wall of a cavity. Meaningful if the piece is closed.
    pub volume: f64,
}

impl Component {
    /// Vertices − edges + faces.
    pub fn euler_characteristic(&self) -> i64 {
        self.vertices as i64 - self.edges as i64 + self.faces as i64
    }
    /// Number of handles; `None` for a piece with a boundary, or one whose odd Euler characteristic
    /// shows that it is no oriented 2-manifold.
    pub fn genus(&self) -> Option<i64> {
        let doubled = 2 - self.euler_characteristic();
        (self.boundary_edges == 0 && doubled >= 0 && doubled % 2 == 0).then_some(doubled / 2)
    }
}

/// What kind of surface a mesh of triangles or quads is.
///
/// ```
/// use geom_core::mesh::{SurfaceAudit, shapes};
/// let audit = SurfaceAudit::of(&shapes::torus(3.0, 1.0, 24, 12));
/// assert!(audit.is_closed_manifold());
/// assert_eq!(audit.components[0].genus(), Some(1));
/// ```
///
/// Edges are given by their two vertices, the lower one first. An edge is counted under one heading only, by how many
/// faces use it: one is a boundary, two may conflict, more are not manifold.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SurfaceAudit {
    /// Vertices that a face uses.
    pub vertices: usize,
    /// Edges.
    pub edges: usize,
    /// Faces.
    pub faces: usize,
    /// Vertices that no face uses.
    pub unused_vertices: Faults<u32>,
    /// Edges with one face.
    pub boundary_edges: Faults<[u32; 2]>,
    /// Edges with more than two faces.
    pub nonmanifold_edges: Faults<[u32; 2]>,
    /// Edges that two faces run in the same direction.
    pub orientation_conflicts: Faults<[u32; 2]>,
    /// Vertices whose faces form more than one fan.
    pub nonmanifold_vertices: Faults<u32>,
    /// Faces with the same vertices as an earlier one.
    pub duplicate_faces: Faults<u32>,
    /// Faces without area. Area is compared with 10⁻¹⁴ of the longest edge's square: what is called flat is so but for
    /// rounding, whatever the unit.
    pub flat_faces: Faults<u32>,
    /// The connected pieces, by their lowest face.
    pub components: Vec<Component>,
}

impl SurfaceAudit {
    /// Examines a triangle mesh.
    pub fn of(mesh: &TriMesh) -> Self {
        examine(mesh.positions(), mesh.triangles())
    }

    /// Examines a quad mesh. Area and volume of a quad are those of its two triangles at the diagonal
    /// from the first corner.
    pub fn of_quads(mesh: &QuadMesh) -> Self {
        examine(mesh.positions(), mesh.quads())
    }

    /// Every edge has one or two faces, which run it in opposite directions, and the faces around
    /// every vertex form one fan. Faces without area and unused vertices do no harm to that.
    pub fn is_manifold(&self) -> bool {
        self.nonmanifold_edges.none()
            && self.nonmanifold_vertices.none()
            && self.orientation_conflicts.none()
            && self.duplicate_faces.none()
    }

    /// Manifold, without boundary, and not empty.
    pub fn is_closed_manifold(&self) -> bool {
        self.is_manifold() && self.boundary_edges.none() && self.faces > 0
    }

    /// Vertices − edges + faces, over all components.
    pub fn euler_characteristic(&self) -> i64 {
        self.vertices as i64 - self.edges as i64 + self.faces as i64
    }

    /// Area, Å².
    pub fn area(&self) -> f64 {
        self.components.iter().map(|c| c.area).sum()
    }

    /// Enclosed volume, Å³; cavities count negative. Meaningful if the surface is closed.
    pub fn volume(&self) -> f64 {
        self.components.iter().map(|c| c.volume).sum()
    }
}

/// The counts in one line, then a line per kind of fault with its first element.
impl fmt::Display for SurfaceAudit {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "{} vertices, {} edges, {} faces, {} components, Euler characteristic {}",
            self.vertices,
            self.edges,
            self.faces,
            self.components.len(),
            self.euler_characteristic()
        )?;
        fault(f, "boundary edges", &self.boundary_edges)?;
        fault(f, "non-manifold edges", &self.nonmanifold_edges)?;
        fault(f, "non-manifold vertices", &self.nonmanifold_vertices)?;
        fault(f, "orientation conflicts", &self.orientation_conflicts)?;
        fault(f, "duplicate faces", &self.duplicate_faces)?;
        fault(f, "faces without area", &self.flat_faces)?;
        fault(f, "unused vertices", &self.unused_vertices)
    }
}

fn fault<T: fmt::Debug>(f: &mut fmt::Formatter<'_>, what: &str, faults: &Faults<T>) -> fmt::Result {
    match &faults.first {
        None => Ok(()),
        Some(first) => write!(f, "\n{} {what}, first {first:?}", faults.count),
    }
}

/// Corner `k` of every face starts the edge to corner `k + 1`: all of them, sorted by the edge's
/// vertices (lower one in the high bits), then by face.
pub(super) fn sorted_edges<const N: usize>(faces: &[[u32; N]]) -> Vec<(u64, u32)> {
    let side = |i: usize| {
        let (f, k) = (i / N, i % N);
        let (a, b) = (faces[f][k], faces[f][(k + 1) % N]);
        (u64::from(a.min(b)) << 32 | u64::from(a.max(b)), f as u32)
    };
    sorted_by_number(N * faces.len(), side, |side| ends(side.0)[0])
}

fn ends(edge: u64) -> [u32; 2] {
    [(edge >> 32) as u32, edge as u32]
}

/// Components first, then edges in groups of equal ends, then fans, then duplicates. Corners are the elements of the
/// sets of fans: two faces that share an edge join their corners at both ends of it, and a vertex whose corners stay in
/// two sets joins two fans. That needs no walk around the vertex, which faults could lead astray.
fn examine<const N: usize>(positions: &[Point3], faces: &[[u32; N]]) -> SurfaceAudit {
    let edges = sorted_edges(faces);
    let mut audit = SurfaceAudit {
        faces: faces.len(),
        ..SurfaceAudit::default()
    };

    // Components by their vertices; a vertex without a face belongs to none.
    let mut pieces = DisjointSets::new(positions.len());
    let mut used = vec![false; positions.len()];
    for face in faces {
        for &v in face {
            used[v as usize] = true;
            pieces.join(face[0], v);
        }
    }
    audit.vertices = used.iter().filter(|&&u| u).count();
    audit.unused_vertices = (0..positions.len() as u32)
        .filter(|&v| !used[v as usize])
        .collect();

    // Components are numbered by their lowest face.
    let mut number = vec![u32::MAX; positions.len()];
    // Areas and volumes about the middle of the bounds, so that coordinates far from the origin lose no digits.
    let measures: Vec<(f64, f64, bool)> = {
        let origin = crate::Aabb::of_points(positions).center();
        parallel::map_each(faces, |f| {
            measure(f.map(|v| positions[v as usize] - origin))
        })
    };
    for (f, (face, &(area, volume, flat))) in faces.iter().zip(&measures).enumerate() {
        let root = pieces.find(face[0]) as usize;
        if number[root] == u32::MAX {
            number[root] = audit.components.len() as u32;
            audit.components.push(Component {
                first_face: f as u32,
                vertices: 0,
                edges: 0,
                faces: 0,
                boundary_edges: 0,
                area: 0.0,
                volume: 0.0,
            });
        }
        let component = &mut audit.components[number[root] as usize];
        component.faces += 1;
        component.area += area;
        component.volume += volume;
        if flat {
            audit.flat_faces.add(f as u32);
        }
    }
    for v in (0..positions.len() as u32).filter(|&v| used[v as usize]) {
        let component = number[pieces.find(v) as usize];
        audit.components[component as usize].vertices += 1;
    }

    // Corners of one vertex that an edge joins form a fan. A corner's number is N · face + k.
    let corner = |f: u32, v: u32| {
        let k = faces[f as usize].iter().position(|&c| c == v);
        N * f as usize + k.expect("the edge belongs to the face")
    };
    let mut fans = Sets::<usize>::new(N * faces.len());
    for group in edges.chunk_by(|a, b| a.0 == b.0) {
        let edge = ends(group[0].0);
        let component = number[pieces.find(edge[0]) as usize];
        let component = &mut audit.components[component as usize];
        component.edges += 1;
        audit.edges += 1;
        let ascends = |f: u32| {
            let face = &faces[f as usize];
            let k = corner(f, edge[0]) % N;
            face[(k + 1) % N] == edge[1]
        };
        // One face: boundary. Two that run it the same way: a conflict. More: not manifold.
        match *group {
            [_] => {
                component.boundary_edges += 1;
                audit.boundary_edges.add(edge);
            }
            [(_, f), (_, g)] => {
                if ascends(f) == ascends(g) {
                    audit.orientation_conflicts.add(edge);
                }
            }
            _ => audit.nonmanifold_edges.add(edge),
        }
        for pair in group.windows(2) {
            for v in edge {
                fans.join(corner(pair[0].1, v), corner(pair[1].1, v));
            }
        }
    }
    // A vertex with several fans is where sheets touch in a point.
    let mut fans_of = vec![0u32; positions.len()];
    for (c, &v) in faces.as_flattened().iter().enumerate() {
        if fans.is_lowest(c) {
            fans_of[v as usize] += 1;
        }
    }
    audit.nonmanifold_vertices = (0..positions.len() as u32)
        .filter(|&v| fans_of[v as usize] > 1)
        .collect();

    // Faces with the same corners, in whatever order.
    let key = |f: usize| {
        let mut key = faces[f];
        key.sort_unstable();
        (key, f as u32)
    };
    let keys = sorted_by_number(faces.len(), key, |key| key.0[0]);
    let mut duplicates: Vec<u32> = keys
        .windows(2)
        .filter(|pair| pair[0].0 == pair[1].0)
        .map(|pair| pair[1].1)
        .collect();
    duplicates.sort_unstable();
    audit.duplicate_faces = duplicates.into_iter().collect();
    audit
}

/// Area, volume of the cone to the origin, and whether the area is only rounding. Vertices are relative to the middle
/// of the bounds, so the cones of a closed surface sum to its volume.
fn measure<const N: usize>(p: [Vector3; N]) -> (f64, f64, bool) {
    let (mut area, mut volume, mut longest) = (0.0, 0.0, 0.0f64);
    for k in 1..N - 1 {
        area += 0.5 * (p[k] - p[0]).cross(&(p[k + 1] - p[0])).norm();
        volume += p[0].cross(&p[k]).dot(&p[k + 1]) / 6.0;
    }
    for k in 0..N {
        longest = longest.max((p[(k + 1) % N] - p[k]).norm_squared());
    }
    (area, volume, area <= FLAT * longest)
}

/// The tetrahedra of one region. Only regions that have one are listed.
#[derive(Clone, Debug, PartialEq)]
pub struct RegionAudit {
    /// The region.
    pub region: Region,
    /// Number of tetrahedra.
    pub tets: usize,
    /// Pieces connected through faces inside of the region.
    pub components: usize,
    /// Sum of the signed volumes, Å³.
    pub volume: f64,
}

/// Whether a tetrahedral mesh is positive and conforming, and what its regions are.
///
/// Conforming means here what can be seen from the connectivity: no face has more than two
/// tetrahedra, and the two lie on different sides. That no vertex hangs in the middle of a face is
/// seen by comparing the boundary with the surface that it should be
/// ([`BoundaryComparison`]), and the sum of the volumes with what that surface encloses.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct VolumeAudit {
    /// Tetrahedra.
    pub tets: usize,
    /// Vertices that a tetrahedron uses.
    pub vertices: usize,
    /// Faces.
    pub faces: usize,
    /// Faces with one tetrahedron.
    pub boundary_faces: usize,
    /// Faces between two regions.
    pub interface_faces: usize,
    /// Vertices that no tetrahedron uses.
    pub unused_vertices: Faults<u32>,
    /// Tetrahedra of negative volume. Those without volume are not among them.
    pub inverted_tets: Faults<u32>,
    /// Tetrahedra without volume. Of either sign, and at most 10⁻¹⁴ of the longest edge's cube.
    pub flat_tets: Faults<u32>,
    /// Faces with more than two tetrahedra.
    pub overfull_faces: Faults<[u32; 3]>,
    /// Faces whose two tetrahedra lie on the same side.
    pub folded_faces: Faults<[u32; 3]>,
    /// Pieces connected through faces, regardless of region.
    pub components: usize,
    /// What each region has, by its number.
    pub regions: Vec<RegionAudit>,
}

impl VolumeAudit {
    /// Examines a tetrahedral mesh.
    pub fn of(mesh: &TetMesh) -> Self {
        let tets = mesh.tets();
        let mut audit = Self {
            tets: tets.len(),
            ..Self::default()
        };
        // Vertices that no tetrahedron uses.
        let mut used = vec![false; mesh.positions().len()];
        for &v in tets.as_flattened() {
            used[v as usize] = true;
        }
        audit.vertices = used.iter().filter(|&&u| u).count();
        audit.unused_vertices = (0..used.len() as u32)
            .filter(|&v| !used[v as usize])
            .collect();

        // Faces in groups of equal corners: one tetrahedron is a boundary, two must run it opposite ways, more overlap.
        let faces = sorted_faces(tets);
        let mut pieces = DisjointSets::new(tets.len());
        let mut region_pieces = DisjointSets::new(tets.len());
        for group in faces.chunk_by(|a, b| a.0 == b.0) {
            audit.faces += 1;
            let tet = |i: usize| (group[i].1 / 4) as u32;
            match *group {
                [_] => audit.boundary_faces += 1,
                [(key, first), (_, second)] => {
                    let side = |slot| is_even(face(tets, slot));
                    if side(first) == side(second) {
                        audit.folded_faces.add(key);
                    }
                    if mesh.regions()[tet(0) as usize] == mesh.regions()[tet(1) as usize] {
                        region_pieces.join(tet(0), tet(1));
                    } else {
                        audit.interface_faces += 1;
                    }
                }
                _ => audit.overfull_faces.add(group[0].0),
            }
            for i in 1..group.len() {
                pieces.join(tet(i - 1), tet(i));
            }
        }

        // Six volumes, and whether they are only rounding beside the longest edge.
        let volumes: Vec<(f64, bool)> = parallel::map(tets.len(), |t| {
            let corners = mesh.corners(t);
            let six = six_volume(corners);
            let longest = super::EDGES
                .iter()
                .map(|&[a, b]| (corners[b] - corners[a]).norm_squared())
                .fold(0.0, f64::max);
            (six / 6.0, six.abs() <= FLAT * longest * longest.sqrt())
        });
        // Sums in the order of the tetrahedra, whatever the threads did.
        let mut by_region: Vec<Option<RegionAudit>> = vec![None; usize::from(Region::MAX) + 1];
        for (t, &(volume, flat)) in volumes.iter().enumerate() {
            let region = mesh.regions()[t];
            let of_region = by_region[usize::from(region)].get_or_insert(RegionAudit {
                region,
                tets: 0,
                components: 0,
                volume: 0.0,
            });
            of_region.tets += 1;
            of_region.volume += volume;
            of_region.components += usize::from(region_pieces.find(t as u32) == t as u32);
            audit.components += usize::from(pieces.find(t as u32) == t as u32);
            if flat {
                audit.flat_tets.add(t as u32);
            } else if volume < 0.0 {
                audit.inverted_tets.add(t as u32);
            }
        }
        audit.regions = by_region.into_iter().flatten().collect();
        audit
    }

    /// No face has more than two tetrahedra or two on the same side.
    pub fn is_conforming(&self) -> bool {
        self.overfull_faces.none() && self.folded_faces.none()
    }

    /// Every tetrahedron has a positive volume.
    pub fn is_positive(&self) -> bool {
        self.inverted_tets.none() && self.flat_tets.none()
    }

    /// Conforming, positive, without unused vertices, and not empty.
    pub fn is_valid(&self) -> bool {
        self.is_conforming() && self.is_positive() && self.unused_vertices.none() && self.tets > 0
    }

    /// Sum of the signed volumes of all regions, Å³.
    pub fn volume(&self) -> f64 {
        self.regions.iter().map(|r| r.volume).sum()
    }

    /// What a region has; `None` if no tetrahedron is in it.
    pub fn region(&self, region: Region) -> Option<&RegionAudit> {
        self.regions.iter().find(|r| r.region == region)
    }
}

/// The counts in one line, then a line per region and per kind of fault with its first element.
impl fmt::Display for VolumeAudit {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "{} vertices, {} faces, {} tetrahedra, {} components",
            self.vertices, self.faces, self.tets, self.components
        )?;
        for r in &self.regions {
            write!(
                f,
                "\nregion {}: {} tetrahedra, {} components, {} Å³",
                r.region, r.tets, r.components, r.volume
            )?;
        }
        fault(f, "inverted tetrahedra", &self.inverted_tets)?;
        fault(f, "tetrahedra without volume", &self.flat_tets)?;
        fault(
            f,
            "faces with more than two tetrahedra",
            &self.overfull_faces,
        )?;
        fault(
            f,
            "faces with two tetrahedra on one side",
            &self.folded_faces,
        )?;
        fault(f, "unused vertices", &self.unused_vertices)
    }
}

/// All faces of all tetrahedra: sorted corners, and 4 · tetrahedron + face; sorted by both.
pub(super) fn sorted_faces(tets: &[[u32; 4]]) -> Vec<([u32; 3], u64)> {
    let side = |slot: usize| (sorted(face(tets, slot as u64)), slot as u64);
    sorted_by_number(4 * tets.len(), side, |side| side.0[0])
}

/// The face of slot 4 · tetrahedron + face, seen from outside of the tetrahedron.
pub(super) fn face(tets: &[[u32; 4]], slot: u64) -> [u32; 3] {
    FACES[(slot % 4) as usize].map(|c| tets[(slot / 4) as usize][c])
}

/// How the boundary of a region of a tetrahedral mesh compares with a surface. Vertices are matched
/// by their exact positions, so the two may number them differently. A mesher that was given a surface is held to it
/// so: `missing` are triangles that it did not keep.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct BoundaryComparison {
    /// Triangles of the surface that are boundary faces and point out of the region, too.
    pub equal: usize,
    /// Triangles of the surface that are boundary faces but point into the region: those of the
    /// molecule's surface, seen from the exterior.
    pub reversed: usize,
    /// Triangles of the surface that are no boundary faces of the region.
    pub missing: Faults<u32>,
    /// Boundary faces of the region, by their vertices in the tetrahedral mesh, that are not in the
    /// surface: for the exterior, those of its outer boundary.
    pub extra: Faults<[u32; 3]>,
}

impl BoundaryComparison {
    /// Compares the boundary of `region`, against other regions and the outside, with `surface`.
    ///
    /// Positions are compared by their bits (0 and −0 are equal), not within a tolerance: a mesh that went through a
    /// file with fewer digits has no vertex in common with its source. Two vertices at one place count as one.
    pub fn of(mesh: &TetMesh, region: Region, surface: &TriMesh) -> Self {
        // The region's boundary, counter-clockwise from outside of it.
        let boundary: Vec<[u32; 3]> = mesh
            .interfaces()
            .iter()
            .filter_map(|face| {
                let [a, b, c] = face.triangle;
                if face.inside == region {
                    Some([a, b, c])
                } else if face.outside == region {
                    Some([a, c, b])
                } else {
                    None
                }
            })
            .collect();
        // Vertices are the same if their places are, bit for bit.
        let (of_volume, of_surface) = common_numbers(mesh.positions(), surface.positions());
        let keys = |faces: &[[u32; 3]], number: &[u32]| {
            let key = |i: usize| {
                let mut key = faces[i].map(|v| number[v as usize]);
                let ascending = is_even(key);
                key.sort_unstable();
                (key, ascending, i as u32)
            };
            sorted_by_number(faces.len(), key, |key| key.0[0])
        };
        // Both sorted by their corners, and merged: what only one has, and what both have, perhaps reversed.
        let ours = keys(&boundary, &of_volume);
        let theirs = keys(surface.triangles(), &of_surface);
        let mut comparison = Self::default();
        let (mut missing, mut extra) = (Vec::new(), Vec::new());
        let (mut i, mut j) = (0, 0);
        while i < ours.len() || j < theirs.len() {
            let order = match (ours.get(i), theirs.get(j)) {
                (Some(a), Some(b)) => a.0.cmp(&b.0),
                (Some(_), None) => std::cmp::Ordering::Less,
                _ => std::cmp::Ordering::Greater,
            };
            match order {
                std::cmp::Ordering::Less => {
                    extra.push(ours[i].2);
                    i += 1;
                }
                std::cmp::Ordering::Greater => {
                    missing.push(theirs[j].2);
                    j += 1;
                }
                std::cmp::Ordering::Equal => {
                    if ours[i].1 == theirs[j].1 {
                        comparison.equal += 1;
                    } else {
                        comparison.reversed += 1;
                    }
                    i += 1;
                    j += 1;
                }
            }
        }
        missing.sort_unstable();
        extra.sort_unstable();
        comparison.missing = missing.into_iter().collect();
        comparison.extra = extra.iter().map(|&i| boundary[i as usize]).collect();
        comparison
    }

    /// Is the surface the whole boundary, pointing out?
    pub fn is_equal(&self) -> bool {
        self.reversed == 0 && self.missing.none() && self.extra.none()
    }
}

/// Numbers for the vertices of two meshes, equal where the positions are. Equal numbers mean equal places, also within
/// one mesh. By sorting: no hashing, so that nothing depends on the order of a table.
fn common_numbers(first: &[Point3], second: &[Point3]) -> (Vec<u32>, Vec<u32>) {
    // −0 and 0 are the same place.
    let bits = |p: &Point3| [p.x, p.y, p.z].map(|c| (c + 0.0).to_bits());
    let mut all: Vec<([u64; 3], usize)> = parallel::map(first.len() + second.len(), |i| {
        let of_second = || &second[i - first.len()];
        (bits(first.get(i).unwrap_or_else(of_second)), i)
    });
    all.par_sort_unstable();
    let mut numbers = vec![0; all.len()];
    for (number, group) in all.chunk_by(|a, b| a.0 == b.0).enumerate() {
        for &(_, i) in group {
            numbers[i] = number as u32;
        }
    }
    let of_second = numbers.split_off(first.len());
    (numbers, of_second)
}
