//! Meshes for tests and benches.
//!
//! The meshes are simple enough to count on paper: lattices of Kuhn's six tetrahedra per cube, shaken by noise, with a
//! ball inside.

use geom_core::compute::random::SplitMix64;
use geom_core::mesh::{Region, VertexKind};
use geom_core::{ImplicitField, Point3, TetMesh, Vector3};

/// A ball as a level set: `2 − |x − c| / r`, which is 1 on the sphere.
/// Its gradient has the length `1 / r` everywhere, so that first-order distances are exact; at the centre, where there
/// is no direction, it is zero.
#[derive(Clone, Copy, Debug)]
pub struct Ball {
    /// Centre, Å.
    pub center: Point3,
    /// Radius, Å.
    pub radius: f64,
}

impl ImplicitField for Ball {
    fn value(&self, x: &Point3) -> f64 {
        2.0 - (x - self.center).norm() / self.radius
    }
    fn value_gradient(&self, x: &Point3) -> (f64, Vector3) {
        let d = x - self.center;
        let unit = d.try_normalize(0.0).unwrap_or_else(Vector3::zeros);
        (self.value(x), -unit / self.radius)
    }
}

/// Numbers in −1…1 that depend on the seed only.
/// Each call of the result gives the next number of the sequence.
pub fn noise(seed: u64) -> impl FnMut() -> f64 {
    let mut random = SplitMix64::new(seed);
    move || random.symmetric()
}

/// The box `[0, n·h]` on each axis in cubes of six tetrahedra each (Kuhn); the region of a
/// tetrahedron is that of its centroid; vertices on the box have box kinds where one region reaches
/// it, and are fixed elsewhere.
///
/// There are `(n₀ + 1)(n₁ + 1)(n₂ + 1)` vertices, x fastest, then y, then z, and `6 n₀ n₁ n₂` tetrahedra in the same
/// order of cubes, all positive, of volume `h³ / 6`. They are conforming: all share the same diagonal direction.
/// Vertices between two regions are of kind `Surface`.
pub fn lattice(n: [usize; 3], h: f64, region: impl Fn(&Point3) -> Region) -> TetMesh {
    let at = |i: [usize; 3]| ((i[2] * (n[1] + 1) + i[1]) * (n[0] + 1) + i[0]) as u32;
    // The vertices, with kinds as of one region.
    let mut positions = Vec::new();
    let mut kinds = Vec::new();
    for k in 0..=n[2] {
        for j in 0..=n[1] {
            for i in 0..=n[0] {
                let c = [i, j, k];
                positions.push(Point3::new(i as f64, j as f64, k as f64) * h);
                let on: Vec<usize> = (0..3).filter(|&a| c[a] == 0 || c[a] == n[a]).collect();
                kinds.push(match on.as_slice() {
                    [] => VertexKind::Interior,
                    &[axis] => VertexKind::BoxFace { axis: axis as u8 },
                    &[a, b] => VertexKind::BoxEdge {
                        axis: (3 - a - b) as u8,
                    },
                    _ => VertexKind::Fixed,
                });
            }
        }
    }
    let mut tets = Vec::new();
    let mut regions = Vec::new();
    for k in 0..n[2] {
        for j in 0..n[1] {
            for i in 0..n[0] {
                // A tetrahedron per order of the axes: from the low corner along them to the high one.
                for (order, even) in [
                    ([0, 1, 2], true),
                    ([1, 2, 0], true),
                    ([2, 0, 1], true),
                    ([0, 2, 1], false),
                    ([2, 1, 0], false),
                    ([1, 0, 2], false),
                ] {
                    let mut c = [i, j, k];
                    let mut tet = [at(c); 4];
                    for (corner, axis) in order.into_iter().enumerate() {
                        c[axis] += 1;
                        tet[corner + 1] = at(c);
                    }
                    if !even {
                        tet.swap(2, 3);
                    }
                    let sum = tet
                        .iter()
                        .fold(Vector3::zeros(), |s, &v| s + positions[v as usize].coords);
                    tets.push(tet);
                    regions.push(region(&Point3::from(sum / 4.0)));
                }
            }
        }
    }
    let mesh = TetMesh::with_regions(positions, tets, regions).expect("a lattice is valid");
    // Vertices between two regions lie on a surface, or are held where that meets the box.
    let mut mixed = vec![false; kinds.len()];
    for face in mesh.interfaces() {
        for v in face.triangle {
            mixed[v as usize] |= face.outside != geom_core::mesh::OUTSIDE;
        }
    }
    for (kind, mixed) in kinds.iter_mut().zip(mixed) {
        *kind = match *kind {
            VertexKind::Interior if mixed => VertexKind::Surface,
            _ if mixed => VertexKind::Fixed,
            kind => kind,
        };
    }
    let (positions, tets, regions, _) = mesh.into_parts();
    TetMesh::with_kinds(positions, tets, regions, kinds).expect("a lattice is valid")
}

/// The mesh with its interior vertices moved by up to `amount` on each axis, box vertices within
/// their face or edge.
/// Three numbers are drawn per vertex, whether it may move or not. Nothing keeps tetrahedra positive: with amounts that
/// are not small against the edges some are inverted.
pub fn shaken(mesh: TetMesh, amount: f64, seed: u64) -> TetMesh {
    let (mut positions, tets, regions, kinds) = mesh.into_parts();
    let mut noise = noise(seed);
    for (x, kind) in positions.iter_mut().zip(&kinds) {
        let mut d = Vector3::new(noise(), noise(), noise()) * amount;
        match *kind {
            VertexKind::Interior => {}
            VertexKind::BoxFace { axis } => d[usize::from(axis)] = 0.0,
            VertexKind::BoxEdge { axis } => {
                let along = d[usize::from(axis)];
                d = Vector3::zeros();
                d[usize::from(axis)] = along;
            }
            VertexKind::Surface | VertexKind::Fixed => d = Vector3::zeros(),
        }
        *x += d;
    }
    TetMesh::with_kinds(positions, tets, regions, kinds).expect("noise is finite")
}

/// A ball in a box of `n³` cubes of edge `h`, its surface vertices pulled to the sphere of radius
/// `radius` about the middle as far as no tetrahedron inverts.
/// Region 1 is inside, region 0 outside; tetrahedra go by their centroids. The ball comes along as the field to improve
/// with.
pub fn ball_in_box(n: usize, h: f64, radius: f64) -> (TetMesh, Ball) {
    let center = Point3::from(Vector3::repeat(0.5 * n as f64 * h));
    let ball = Ball { center, radius };
    let inside = |x: &Point3| Region::from(ball.value(x) >= 1.0);
    let mesh = lattice([n; 3], h, inside);
    let (mut positions, tets, regions, kinds) = mesh.into_parts();
    let mut incidence: Vec<Vec<usize>> = vec![Vec::new(); positions.len()];
    for (t, tet) in tets.iter().enumerate() {
        for &v in tet {
            incidence[v as usize].push(t);
        }
    }
    for v in 0..positions.len() {
        if kinds[v] != VertexKind::Surface {
            continue;
        }
        let start = positions[v];
        let foot = center + (start - center).normalize() * radius;
        for share in [1.0, 0.8, 0.6, 0.4, 0.2, 0.0] {
            positions[v] = start + (foot - start) * share;
            let positive = incidence[v].iter().all(|&t| {
                let corners = tets[t].map(|u| positions[u as usize]);
                geom_core::mesh::six_volume(corners) > 1e-3 * h * h * h
            });
            if positive {
                break;
            }
        }
    }
    let mesh = TetMesh::with_kinds(positions, tets, regions, kinds).expect("still finite");
    (mesh, ball)
}

/// The task of one smoothing sweep over all vertices that may move.
/// As without a field: vertices of curved interfaces are left out. Those of free ones are the axes of the coordinates.
pub fn relaxation(mesh: &TetMesh, rounds: u32) -> crate::backend::Relaxation<'_> {
    let edited = crate::boundary::input::prepare(mesh.clone(), &[], None)
        .expect("meshes of tests are complexes")
        .mesh;
    let all: Vec<u32> = (0..mesh.positions().len() as u32).collect();
    crate::smoothing::smooth::task(&edited, mesh.positions(), &all, rounds, None)
}
