//! Inputs, and an independent judge of meshes, for the tests of this crate.
#![allow(dead_code, reason = "each test file uses its part")]

use dual_contour::geom_core::compute::parallel;
use dual_contour::geom_core::mesh::{INTERIOR, Region, six_volume};
use dual_contour::geom_core::{
    Cpu, ImplicitField, Lattice, Point3, Run, ScalarGrid, TetMesh, TriMesh, Vector3,
};
use dual_contour::{Extent, Method, Options, surface, volume};

/// A field from a closure; gradients by central differences.
pub(crate) struct Field<F>(pub(crate) F);

impl<F: Fn(&Point3) -> f64 + Sync> ImplicitField for Field<F> {
    fn value(&self, x: &Point3) -> f64 {
        (self.0)(x)
    }
    fn value_gradient(&self, x: &Point3) -> (f64, Vector3) {
        let h = 1e-5;
        let d = |v: Vector3| ((self.0)(&(x + v * h)) - (self.0)(&(x - v * h))) / (2.0 * h);
        (
            self.value(x),
            Vector3::new(d(Vector3::x()), d(Vector3::y()), d(Vector3::z())),
        )
    }
}

/// 1 + (radius − |x − c|): 1 on the sphere, slope 1 everywhere.
pub(crate) fn ball(center: Point3, radius: f64) -> Field<impl Fn(&Point3) -> f64 + Sync + Copy> {
    Field(move |x: &Point3| 1.0 + radius - (x - center).norm())
}

/// A torus about the z axis.
pub(crate) fn torus(major: f64, minor: f64) -> Field<impl Fn(&Point3) -> f64 + Sync + Copy> {
    Field(move |x: &Point3| {
        let ring = (x.x * x.x + x.y * x.y).sqrt() - major;
        1.0 + minor - (ring * ring + x.z * x.z).sqrt()
    })
}

/// Samples of a field on `n` cells per axis of the cube `[−half, half]³`.
pub(crate) fn sample(field: &impl ImplicitField, half: f64, n: usize) -> ScalarGrid {
    let lattice = Lattice {
        origin: Point3::new(-half, -half, -half),
        spacing: 2.0 * half / n as f64,
        counts: [n + 1; 3],
    };
    let values = (0..lattice.len())
        .map(|i| field.value(&lattice.point(lattice.coordinates(i))) as f32)
        .collect();
    ScalarGrid::new(lattice, values).unwrap()
}

/// White noise: each point inside with the given probability, values at random distance from the
/// level; `margin` layers of exterior around.
pub(crate) fn noise(n: usize, density: f64, margin: usize, seed: u64) -> ScalarGrid {
    let lattice = Lattice {
        origin: Point3::origin(),
        spacing: 0.5,
        counts: [n + 1; 3],
    };
    let mut state = seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1;
    let mut random = move || {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        (state >> 11) as f64 / (1u64 << 53) as f64
    };
    let values = (0..lattice.len())
        .map(|i| {
            let p = lattice.coordinates(i);
            let (side, depth) = (random(), random());
            let within = p.iter().all(|&c| c >= margin && c + margin <= n);
            (1.0 + (0.05 + 0.9 * depth) * if within && side < density { 1.0 } else { -1.0 }) as f32
        })
        .collect();
    ScalarGrid::new(lattice, values).unwrap()
}

/// What is wrong with a surface: edges that are not shared by two triangles in opposite direction,
/// and vertices with more than one fan.
#[derive(Debug, Default, PartialEq, Eq)]
pub(crate) struct Faults {
    pub(crate) edges: usize,
    pub(crate) vertices: usize,
}

pub(crate) fn faults(triangles: &[[u32; 3]]) -> Faults {
    let corners = || triangles.iter().flat_map(|t| (0..3).map(move |k| (t, k)));
    let directed = corners().map(|(t, k)| (t[k], t[(k + 1) % 3]));
    let mut directed: Vec<(u32, u32)> = directed.collect();
    directed.sort_unstable();
    let times = |edge: (u32, u32)| {
        let first = directed.partition_point(|e| *e < edge);
        directed[first..].iter().take_while(|e| **e == edge).count()
    };
    let edges = directed
        .chunk_by(|a, b| a == b)
        .filter(|same| same.len() != 1 || times((same[0].1, same[0].0)) != 1)
        .count();
    // Corners by their vertex, each with the side across.
    let around = corners().map(|(t, k)| (t[k], t[(k + 1) % 3], t[(k + 2) % 3]));
    let mut around: Vec<(u32, u32, u32)> = around.collect();
    around.sort_unstable();
    let vertices = around
        .chunk_by(|a, b| a.0 == b.0)
        .filter(|links| {
            let next = |from: u32| {
                let found = links.binary_search_by_key(&from, |link| link.1);
                found.ok().map(|i| links[i].2)
            };
            let first = links[0].1;
            let (mut at, mut steps) = (first, 0);
            while let Some(to) = next(at) {
                at = to;
                steps += 1;
                if at == first || steps > links.len() {
                    break;
                }
            }
            steps != links.len() || at != first
        })
        .count();
    Faults { edges, vertices }
}

pub(crate) fn assert_closed(mesh: &TriMesh) {
    assert_eq!(
        faults(mesh.triangles()),
        Faults::default(),
        "closed, oriented, 2-manifold"
    );
}

/// Groups of elements that share vertices.
pub(crate) fn components<const N: usize>(elements: &[[u32; N]]) -> usize {
    let n = elements
        .iter()
        .flatten()
        .map(|&v| v as usize + 1)
        .max()
        .unwrap_or(0);
    let mut group: Vec<usize> = (0..n).collect();
    fn root(g: &mut [usize], mut i: usize) -> usize {
        while g[i] != i {
            g[i] = g[g[i]];
            i = g[i];
        }
        i
    }
    for e in elements {
        for v in &e[1..] {
            let (a, b) = (
                root(&mut group, e[0] as usize),
                root(&mut group, *v as usize),
            );
            group[a] = b;
        }
    }
    let used = elements.iter().flatten();
    distinct(used.map(|&v| root(&mut group, v as usize)))
}

/// How many there are when each is counted once.
fn distinct<T: Ord>(of: impl Iterator<Item = T>) -> usize {
    let mut of: Vec<T> = of.collect();
    of.sort_unstable();
    of.dedup();
    of.len()
}

/// Vertices − edges + faces − cells.
pub(crate) fn euler_of_tets(tets: &[[u32; 4]]) -> i64 {
    let sorted = || {
        tets.iter().map(|t| {
            let mut t = *t;
            t.sort_unstable();
            t
        })
    };
    let vertices = distinct(tets.iter().flatten());
    let edges = distinct(
        sorted().flat_map(|[a, b, c, d]| [(a, b), (a, c), (a, d), (b, c), (b, d), (c, d)]),
    );
    let faces =
        distinct(sorted().flat_map(|[a, b, c, d]| [(a, b, c), (a, b, d), (a, c, d), (b, c, d)]));
    vertices as i64 - edges as i64 + faces as i64 - tets.len() as i64
}

/// The faces of tetrahedra, seen from outside, in the order of their sorted corners, which come first.
fn faces_of<'a>(tets: impl Iterator<Item = &'a [u32; 4]>) -> Vec<((u32, u32, u32), [u32; 3])> {
    let faces = tets.flat_map(|t| {
        [[1, 2, 3], [0, 3, 2], [0, 1, 3], [0, 2, 1]].map(|[i, j, k]| {
            let face = [t[i], t[j], t[k]];
            let mut key = face;
            key.sort_unstable();
            ((key[0], key[1], key[2]), face)
        })
    });
    let mut faces: Vec<_> = faces.collect();
    faces.sort_unstable();
    faces
}

/// Positive volumes; every face on at most two tetrahedra, from opposite sides.
pub(crate) fn assert_conforming(mesh: &TetMesh) {
    for (i, t) in mesh.tets().iter().enumerate() {
        let v = six_volume(mesh.corners(i));
        assert!(
            v > 0.0,
            "tetrahedron {i} {t:?} of region {} has volume {}",
            mesh.regions()[i],
            v / 6.0
        );
    }
    let is_even = |((a, b, c), face): &((u32, u32, u32), [u32; 3])| {
        [[*a, *b, *c], [*b, *c, *a], [*c, *a, *b]].contains(face)
    };
    for sides in faces_of(mesh.tets().iter()).chunk_by(|a, b| a.0 == b.0) {
        assert!(
            sides.len() == 1 || sides.len() == 2 && is_even(&sides[0]) != is_even(&sides[1]),
            "face {:?} is on {} tetrahedra",
            sides[0].0,
            sides.len()
        );
    }
}

/// The boundary of the tetrahedra of a region, seen from outside of it.
pub(crate) fn boundary_of(mesh: &TetMesh, region: Region) -> Vec<[u32; 3]> {
    let tets = mesh.tets().iter().zip(mesh.regions());
    let faces = faces_of(tets.filter(|(_, r)| **r == region).map(|(t, _)| t));
    faces
        .chunk_by(|a, b| a.0 == b.0)
        .filter(|sides| sides.len() == 1)
        .map(|sides| sides[0].1)
        .collect()
}

/// Triangles as positions, in an order that does not depend on numbering.
pub(crate) fn geometry(positions: &[Point3], triangles: &[[u32; 3]]) -> Vec<[[u64; 3]; 3]> {
    let turned = triangles.iter().map(|t| {
        let p = t.map(|v| [0, 1, 2].map(|k| positions[v as usize][k].to_bits()));
        let first = (0..3).min_by_key(|&i| p[i]).unwrap();
        [0, 1, 2].map(|i| p[(first + i) % 3])
    });
    let mut turned: Vec<_> = turned.collect();
    turned.sort_unstable();
    turned.dedup();
    turned
}

pub(crate) fn volume_of(mesh: &TetMesh, region: Region) -> f64 {
    (0..mesh.tets().len())
        .filter(|&t| mesh.regions()[t] == region)
        .map(|t| six_volume(mesh.corners(t)) / 6.0)
        .sum()
}

/// Smallest and largest dihedral angle, degrees.
pub(crate) fn dihedral_range(mesh: &TetMesh) -> (f64, f64) {
    let (mut low, mut high) = (180.0f64, 0.0f64);
    for i in 0..mesh.tets().len() {
        let p = mesh.corners(i);
        for [a, b, c, d] in [
            [0, 1, 2, 3],
            [0, 2, 1, 3],
            [0, 3, 1, 2],
            [1, 2, 0, 3],
            [1, 3, 0, 2],
            [2, 3, 0, 1],
        ] {
            let e = p[b] - p[a];
            let (m, n) = (e.cross(&(p[c] - p[a])), e.cross(&(p[d] - p[a])));
            let angle = m.angle(&n).to_degrees();
            low = low.min(angle);
            high = high.max(angle);
        }
    }
    (low, high)
}

pub(crate) fn both(options: Options) -> Options {
    Options {
        region: Extent::Both,
        ..options
    }
}

/// Everything that must hold for a mesh of inside and outside, by either method.
pub(crate) fn check_all(grid: &ScalarGrid, options: &Options) {
    check_method(grid, options);
    if options.tolerance == 0.0 {
        let method = Method::Stuffing;
        check_method(
            grid,
            &Options {
                method,
                ..options.clone()
            },
        );
    }
}

pub(crate) fn check_method(grid: &ScalarGrid, options: &Options) {
    let run = Run::on(&Cpu);
    let v = volume(grid, None, &both(options.clone()), run).unwrap();
    assert_conforming(&v.mesh);
    assert_closed(&v.surface);
    let bounds = v.mesh.bounds();
    let total = bounds.extent().product();
    let sum = v.mesh.volume();
    assert!(
        (sum / total - 1.0).abs() < 1e-12,
        "{sum} of a box of {total}"
    );
    let inside = boundary_of(&v.mesh, INTERIOR);
    assert!(
        geometry(v.mesh.positions(), &inside)
            == geometry(v.surface.positions(), v.surface.triangles()),
        "the surface is the boundary of the inner tetrahedra"
    );
    let alone = surface(grid, None, options, run).unwrap();
    assert!(alone.mesh == v.surface, "the surface alone is the same");
    let inner = volume(grid, None, options, run).unwrap();
    let outer = volume(
        grid,
        None,
        &Options {
            region: Extent::Exterior,
            ..options.clone()
        },
        run,
    )
    .unwrap();
    assert_eq!(
        inner.mesh.tets().len() + outer.mesh.tets().len(),
        v.mesh.tets().len()
    );
    assert!(inner.surface == v.surface);
    assert!(outer.surface == v.surface);
    let tets: Vec<[u32; 4]> = v
        .mesh
        .tets()
        .iter()
        .zip(v.mesh.regions())
        .filter(|(_, r)| **r == INTERIOR)
        .map(|(t, _)| *t)
        .collect();
    assert_eq!(v.surface.euler_characteristic(), 2 * euler_of_tets(&tets));
}

pub(crate) const METHODS: [Method; 2] = [Method::DualContour, Method::Stuffing];

pub(crate) fn by(method: Method) -> Options {
    Options {
        method,
        ..Options::default()
    }
}

/// Values on so many points, outside but for the given ones; distances from the level vary.
pub(crate) fn few(
    counts: [usize; 3],
    inside: impl Fn([usize; 3]) -> bool,
    seed: u64,
) -> ScalarGrid {
    let lattice = Lattice {
        origin: Point3::origin(),
        spacing: 1.0,
        counts,
    };
    let values = (0..lattice.len())
        .map(|i| {
            let p = lattice.coordinates(i);
            let depth = 0.1 + 0.85 * scatter(i as u64 + 1000 * seed);
            1.0 + if inside(p) { depth } else { -depth }
        })
        .map(|v| v as f32)
        .collect();
    ScalarGrid::new(lattice, values).unwrap()
}

/// A number in [0, 1) that looks random.
pub(crate) fn scatter(i: u64) -> f64 {
    let x = (i ^ 0x5555).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    let x = (x ^ x >> 29).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    (x >> 11) as f64 / (1u64 << 53) as f64
}

/// Closed, conforming, filling the box.
pub(crate) fn check_quickly(grid: &ScalarGrid, options: &Options) {
    // Loops over so few cells take less than to wake a thread.
    let volume = || volume(grid, None, &both(options.clone()), Run::on(&Cpu));
    let v = parallel::alone(volume).unwrap();
    assert_conforming(&v.mesh);
    assert_closed(&v.surface);
    let total = v.mesh.bounds().extent().product();
    assert!((v.mesh.volume() / total - 1.0).abs() < 1e-12);
}

/// A smooth field with many bumps.
pub(crate) fn bumps(seed: u64) -> Field<impl Fn(&Point3) -> f64 + Sync + Copy> {
    let k: [f64; 6] = std::array::from_fn(|i| 0.9 + scatter(10 * seed + i as u64));
    Field(move |x: &Point3| {
        1.2 + (k[0] * x.x).sin() * (k[1] * x.y).cos()
            + (k[2] * x.y).sin() * (k[3] * x.z).cos()
            + (k[4] * x.z).sin() * (k[5] * x.x).cos()
            - 0.1 * x.coords.norm_squared()
    })
}
