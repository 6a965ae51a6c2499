//! Analytic surfaces for tests and examples.
//!
//! Their vertices lie on the shape itself, so that areas and volumes approach the exact ones from inside, with the square of the
//! edges:
//!
//! ```
//! use std::f64::consts::PI;
//! use geom_core::mesh::shapes;
//! let missing = |levels| 4.0 / 3.0 * PI - shapes::icosphere(1.0, levels).volume();
//! let ratio = missing(3) / missing(4);
//! assert!((ratio - 4.0).abs() < 0.1);
//! ```
//!
//! Wanted are shapes whose numbers are known without a mesher: what a test asserts of an operator, a distance or an
//! audit is then a closed form. Surfaces are oriented outward, tetrahedra are positive.

use std::collections::HashMap;
use std::f64::consts::TAU;

use super::{EXTERIOR, INTERIOR, QuadMesh, TetMesh, TriMesh, VertexKind};
use crate::{Point3, Vector3};

/// A sphere about the origin: the icosahedron with `levels` 1-to-4 subdivisions, vertices on the
/// sphere. `20 · 4^levels` triangles.
///
/// `10 · 4^levels + 2` vertices: the first twelve are the corners of the icosahedron, which keep five triangles; all
/// others have six. Vertices of fewer levels come first, at the same places, so that results on two levels can be
/// compared number by number.
pub fn icosphere(radius: f64, levels: u32) -> TriMesh {
    // Corners of three golden rectangles.
    let phi = f64::midpoint(1.0, 5f64.sqrt());
    let mut directions: Vec<Vector3> = [
        [-1.0, phi, 0.0],
        [1.0, phi, 0.0],
        [-1.0, -phi, 0.0],
        [1.0, -phi, 0.0],
        [0.0, -1.0, phi],
        [0.0, 1.0, phi],
        [0.0, -1.0, -phi],
        [0.0, 1.0, -phi],
        [phi, 0.0, -1.0],
        [phi, 0.0, 1.0],
        [-phi, 0.0, -1.0],
        [-phi, 0.0, 1.0],
    ]
    .iter()
    .map(|&v| Vector3::from(v).normalize())
    .collect();
    // Five around the first corner, five beside them, five around the opposite one, five beside those.
    let mut triangles: Vec<[u32; 3]> = vec![
        [0, 11, 5],
        [0, 5, 1],
        [0, 1, 7],
        [0, 7, 10],
        [0, 10, 11],
        [1, 5, 9],
        [5, 11, 4],
        [11, 10, 2],
        [10, 7, 6],
        [7, 1, 8],
        [3, 9, 4],
        [3, 4, 2],
        [3, 2, 6],
        [3, 6, 8],
        [3, 8, 9],
        [4, 9, 5],
        [2, 4, 11],
        [6, 2, 10],
        [8, 6, 7],
        [9, 8, 1],
    ];
    // Each triangle in four, by the middles of its edges, pushed out to the sphere.
    for _ in 0..levels {
        let mut middles: HashMap<[u32; 2], u32> = HashMap::new();
        let mut middle = |a: u32, b: u32| {
            *middles.entry([a.min(b), a.max(b)]).or_insert_with(|| {
                let m = (directions[a as usize] + directions[b as usize]).normalize();
                directions.push(m);
                directions.len() as u32 - 1
            })
        };
        triangles = triangles
            .iter()
            .flat_map(|&[a, b, c]| {
                let (ab, bc, ca) = (middle(a, b), middle(b, c), middle(c, a));
                [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]
            })
            .collect();
    }
    let positions = directions
        .iter()
        .map(|d| Point3::from(d * radius))
        .collect();
    TriMesh::new(positions, triangles).expect("a subdivided icosahedron is valid")
}

/// An ellipsoid about the origin with these semi-axes along x, y and z: the [`icosphere`] of radius 1,
/// stretched. Its vertices lie on the ellipsoid, its numbering is that of the sphere. One negative semi-axis turns it
/// inside out.
pub fn ellipsoid(semi_axes: Vector3, levels: u32) -> TriMesh {
    let (positions, triangles) = icosphere(1.0, levels).into_parts();
    let positions = positions
        .iter()
        .map(|p| Point3::from(p.coords.component_mul(&semi_axes)));
    TriMesh::new(positions.collect(), triangles).expect("a stretched sphere is valid")
}

/// A closed cylinder about the z axis between `z = 0` and `z = height`: a prism of `around` sides,
/// edges on the cylinder, cut into `along` layers, with a fan of triangles as each end.
/// `2 · around · (along + 1)` triangles; `around ≥ 3`, `along ≥ 1`.
///
/// The enclosed volume is that of the prism, `around / 2 · sin(2π / around) · radius² · height`, exactly but for
/// rounding. Its two rims are right-angled edges: what features and sharp edges are tried on.
///
/// # Panics
/// With fewer sides or layers.
pub fn cylinder(radius: f64, height: f64, around: u32, along: u32) -> TriMesh {
    assert!(
        around >= 3 && along >= 1,
        "{around} sides and {along} layers enclose nothing"
    );
    let mut positions: Vec<Point3> = (0..=along)
        .flat_map(|j| (0..around).map(move |i| (i, j)))
        .map(|(i, j)| {
            let u = TAU * f64::from(i) / f64::from(around);
            let z = height * f64::from(j) / f64::from(along);
            Point3::new(radius * u.cos(), radius * u.sin(), z)
        })
        .collect();
    let at = |i: u32, j: u32| j * around + i % around;
    let mut triangles: Vec<[u32; 3]> = (0..along)
        .flat_map(|j| (0..around).map(move |i| (i, j)))
        .flat_map(|(i, j)| {
            let (a, b, c, d) = (at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1));
            [[a, b, c], [a, c, d]]
        })
        .collect();
    let bottom = positions.len() as u32;
    positions.extend([Point3::origin(), Point3::new(0.0, 0.0, height)]);
    for i in 0..around {
        triangles.push([bottom, at(i + 1, 0), at(i, 0)]);
        triangles.push([bottom + 1, at(i, along), at(i + 1, along)]);
    }
    TriMesh::new(positions, triangles).expect("a prism of at least three sides is valid")
}

/// A sphere about the origin: the cube of `n × n` quads per side, mapped to the sphere so that edges of
/// the cube become great circles. `6 n²` quads, `n ≥ 1`. `6 n² + 2` vertices, of which eight, the corners of the cube,
/// have three quads, and all others four. The valences of any sphere of quads miss four by eight in all.
pub fn quad_sphere(radius: f64, n: u32) -> QuadMesh {
    let (mut positions, mut number) = (Vec::new(), HashMap::new());
    let mut vertex = |lattice: [i64; 3]| {
        *number.entry(lattice).or_insert_with(|| {
            // Equal angles along each edge of the cube.
            let side = lattice.map(|c| (c as f64 / f64::from(n) * (TAU / 8.0)).tan());
            positions.push(Point3::from(Vector3::from(side).normalize() * radius));
            positions.len() as u32 - 1
        })
    };
    let n = i64::from(n);
    let mut quads = Vec::new();
    for (axis, side) in [(0, -1), (0, 1), (1, -1), (1, 1), (2, -1), (2, 1)] {
        for i in 0..n {
            for j in 0..n {
                // Counter-clockwise seen from the positive side of the axis.
                let mut corners = [[0, 0], [1, 0], [1, 1], [0, 1]].map(|[di, dj]| {
                    let mut p = [0; 3];
                    p[axis] = side * n;
                    p[(axis + 1) % 3] = 2 * (i + di) - n;
                    p[(axis + 2) % 3] = 2 * (j + dj) - n;
                    vertex(p)
                });
                if side < 0 {
                    corners.reverse();
                }
                quads.push(corners);
            }
        }
    }
    QuadMesh::new(positions, quads).expect("a mapped cube is valid")
}

/// A torus about the z axis as in [`torus`], of `around · along` quads. All vertices have four quads. Both counts must
/// be at least 3.
pub fn quad_torus(major: f64, minor: f64, around: u32, along: u32) -> QuadMesh {
    let (positions, triangles) = torus(major, minor, around, along).into_parts();
    let (pairs, _) = triangles.as_chunks::<2>();
    let quads = pairs.iter().map(|&[[a, b, c], [_, _, d]]| [a, b, c, d]);
    QuadMesh::new(positions, quads.collect()).expect("a torus grid of at least 3 × 3 is valid")
}

/// A torus about the z axis: tube radius `minor` around a circle of radius `major`, with
/// `around × along` vertices; `2 · around · along` triangles.
///
/// Vertex `i · along + j` is at the angle `2π i / around` about the axis and `2π j / along` about the tube, from its
/// outermost circle upward. Both counts must be at least 3. With `minor > major` the tube goes through itself.
pub fn torus(major: f64, minor: f64, around: u32, along: u32) -> TriMesh {
    let positions = (0..around)
        .flat_map(|i| (0..along).map(move |j| (i, j)))
        .map(|(i, j)| {
            let u = TAU * f64::from(i) / f64::from(around);
            let v = TAU * f64::from(j) / f64::from(along);
            let r = major + minor * v.cos();
            Point3::new(r * u.cos(), r * u.sin(), minor * v.sin())
        })
        .collect();
    let at = |i: u32, j: u32| (i % around) * along + j % along;
    let triangles = (0..around)
        .flat_map(|i| (0..along).map(move |j| (i, j)))
        .flat_map(|(i, j)| {
            let (a, b, c, d) = (at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1));
            [[a, b, c], [a, c, d]]
        })
        .collect();
    TriMesh::new(positions, triangles).expect("a torus grid of at least 3 × 3 is valid")
}

/// A ball of tetrahedra about the origin: the cube of `2 n` cells per side, six tetrahedra per cell,
/// mapped so that concentric cubes become concentric spheres. `48 n³` tetrahedra, all positive,
/// boundary vertices on the sphere. `n ≥ 1`. `(2 n + 1)³` vertices. The boundary has `48 n²` triangles.
pub fn ball(radius: f64, n: u32) -> TetMesh {
    let (positions, tets) = cube_tets(n);
    let positions = positions.iter().map(|p| Point3::from(to_ball(*p) * radius));
    TetMesh::new(positions.collect(), tets).expect("a mapped cube is valid")
}

/// The tetrahedra between two spheres about the origin, of region [`EXTERIOR`]: the outer `n` layers of a
/// ball of `2 n`. `336 n³` tetrahedra; the outer side and the inner one are both boundaries of the mesh.
pub fn shell(inner: f64, outer: f64, n: u32) -> TetMesh {
    let (positions, tets) = cube_tets(2 * n);
    let tets: Vec<_> = tets
        .into_iter()
        .filter(|t| middle(t, &positions).amax() > 0.5)
        .collect();
    let place = |p: &Vector3| {
        // From the cube of half the size on, distances grow from `inner` to `outer`.
        let t = 2.0 * p.amax() - 1.0;
        Point3::from(to_ball(*p).try_normalize(0.0).unwrap_or(*p) * (inner + t * (outer - inner)))
    };
    let positions: Vec<_> = positions.iter().map(place).collect();
    let (positions, tets) = super::compact(&positions, tets);
    let regions = vec![EXTERIOR; tets.len()];
    TetMesh::with_regions(positions, tets, regions).expect("a mapped cube is valid")
}

/// A ball of region [`INTERIOR`] and around it, of region [`EXTERIOR`], the rest of the cube
/// `[−half, half]³`; `n` layers of cells in each. Vertices know of the sides and edges of the cube. `384 n³`
/// tetrahedra. The vertices on the sphere are of kind [`VertexKind::Surface`].
///
/// # Panics
/// Unless `radius < half`.
pub fn ball_in_box(radius: f64, half: f64, n: u32) -> TetMesh {
    assert!(radius < half, "the ball lies in the box");
    let (positions, tets) = cube_tets(2 * n);
    let regions = tets
        .iter()
        .map(|t| match middle(t, &positions).amax() < 0.5 {
            true => INTERIOR,
            false => EXTERIOR,
        })
        .collect();
    let place = |p: &Vector3| {
        let s = p.amax();
        // A ball up to the cube of half the size, then from its sphere straight to the cube.
        if s <= 0.5 {
            return Point3::from(to_ball(*p) * (2.0 * radius));
        }
        let t = 2.0 * s - 1.0;
        let (sphere, cube) = (p.normalize() * radius, p * (half / s));
        Point3::from(sphere.lerp(&cube, t))
    };
    let kinds = positions
        .iter()
        .map(|p| {
            let on: Vec<u8> = (0..3u8).filter(|&k| p[k as usize].abs() == 1.0).collect();
            match on[..] {
                [] if p.amax() == 0.5 => VertexKind::Surface,
                [] => VertexKind::Interior,
                [axis] => VertexKind::BoxFace { axis },
                [a, b] => VertexKind::BoxEdge { axis: 3 - a - b },
                _ => VertexKind::Fixed,
            }
        })
        .collect();
    let positions = positions.iter().map(place).collect();
    TetMesh::with_kinds(positions, tets, regions, kinds).expect("a mapped cube is valid")
}

/// A box `[0, extent]` of `counts` cells, six tetrahedra each, of region [`INTERIOR`].
///
/// Vertex `(k (ny + 1) + j) (nx + 1) + i` is lattice point `(i, j, k)`. `6 nx ny nz` tetrahedra, all of the same
/// volume.
pub fn box_tets(extent: Vector3, counts: [u32; 3]) -> TetMesh {
    let (positions, tets) = grid_tets(counts);
    let cell = Vector3::from_fn(|k, _| extent[k] / f64::from(counts[k]));
    let positions = positions
        .iter()
        .map(|p| Point3::from(p.component_mul(&cell)));
    TetMesh::new(positions.collect(), tets).expect("a box of at least one cell is valid")
}

fn middle(tet: &[u32; 4], positions: &[Vector3]) -> Vector3 {
    tet.iter().map(|&v| positions[v as usize]).sum::<Vector3>() / 4.0
}

/// The cube `[−1, 1]³` of `2 n` cells per side, six tetrahedra each, symmetric in all three axes so
/// that no cell is cut across the direction in which it is bent to a ball.
fn cube_tets(n: u32) -> (Vec<Vector3>, Vec<[u32; 4]>) {
    let (positions, mut tets) = grid_tets([2 * n; 3]);
    let side = 2 * n + 1;
    let coordinates = |v: u32| [v % side, v / side % side, v / (side * side)];
    let number = |[i, j, k]: [u32; 3]| (k * side + j) * side + i;
    // Each octant is the mirror image of the one away from the origin, whose diagonals point outward.
    for tet in &mut tets {
        let low = tet.iter().map(|&v| coordinates(v));
        let low = low
            .reduce(|a, b| [0, 1, 2].map(|k| a[k].min(b[k])))
            .expect("four corners");
        let mirrored = low.map(|c| c < n);
        for v in tet.iter_mut() {
            let p = coordinates(*v);
            // A mirror of the cell itself: its diagonal then points outward.
            *v = number([0, 1, 2].map(|k| match mirrored[k] {
                true => 2 * low[k] + 1 - p[k],
                false => p[k],
            }));
        }
        if mirrored.iter().filter(|&&m| m).count() % 2 == 1 {
            tet.swap(2, 3);
        }
    }
    let scale = 1.0 / f64::from(n);
    let positions = positions.iter().map(|p| (p * scale).add_scalar(-1.0));
    (positions.collect(), tets)
}

/// Cubes `max |x| = s` to spheres `|x| = s`. The largest coordinate becomes the distance from the origin: continuous,
/// and linear along each ray from there.
fn to_ball(p: Vector3) -> Vector3 {
    let length = p.norm();
    if length > 0.0 {
        p * (p.amax() / length)
    } else {
        p
    }
}

/// Unit cells `counts`, each cut into six tetrahedra around its diagonal from (0, 0, 0): conforming
/// across cells. The triangulation of Freudenthal and Kuhn: neighbouring cells cut their common square along the same
/// diagonal, since both cut it from its lowest corner to its highest.
fn grid_tets(counts: [u32; 3]) -> (Vec<Vector3>, Vec<[u32; 4]>) {
    let [nx, ny, nz] = counts.map(|n| n + 1);
    let at = |p: [u32; 3]| (p[2] * ny + p[1]) * nx + p[0];
    let mut positions = Vec::new();
    let mut tets = Vec::new();
    for k in 0..nz {
        for j in 0..ny {
            for i in 0..nx {
                positions.push(Vector3::new(f64::from(i), f64::from(j), f64::from(k)));
                if i + 1 == nx || j + 1 == ny || k + 1 == nz {
                    continue;
                }
                // One tetrahedron per order of the axes along which the diagonal is walked.
                for [a, b, c] in [
                    [0, 1, 2],
                    [1, 2, 0],
                    [2, 0, 1],
                    [0, 2, 1],
                    [2, 1, 0],
                    [1, 0, 2],
                ] {
                    let mut corner = [i, j, k];
                    let mut tet = [at(corner); 4];
                    for (slot, axis) in [(1, a), (2, b), (3, c)] {
                        corner[axis] += 1;
                        tet[slot] = at(corner);
                    }
                    // Odd orders are left-handed.
                    if (b + 3 - a) % 3 == 2 {
                        tet.swap(1, 2);
                    }
                    tets.push(tet);
                }
            }
        }
    }
    (positions, tets)
}
