//! What must hold for all inputs.

mod common;

use common::*;
use dual_contour::geom_core::grid::Brick;
use dual_contour::geom_core::io::View;
use dual_contour::geom_core::mesh::{EXTERIOR, INTERIOR, VertexKind};
use dual_contour::geom_core::testing::same_on_any_threads;
use dual_contour::geom_core::{
    Aabb, BrickGrid, Cpu, ImplicitField, Lattice, LatticeValues, Point3, Run, ScalarGrid, Vector3,
};
use dual_contour::{
    AtBox, Error, ErrorNorm, Extent, FieldSamples, Material, Method, Options, Outer, Placement,
    Resolution, Shape, Zone, surface, volume,
};
use proptest::prelude::*;

fn both(options: Options) -> Options {
    Options {
        region: Extent::Both,
        ..options
    }
}

/// Everything that must hold for a mesh of inside and outside, by either method.
fn check_all(grid: &ScalarGrid, options: &Options) {
    check_method(grid, options);
    if options.tolerance == 0.0 {
        let method = Method::Lattice;
        check_method(
            grid,
            &Options {
                method,
                ..options.clone()
            },
        );
    }
}

fn check_method(grid: &ScalarGrid, options: &Options) {
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

#[test]
fn a_ball_is_a_ball() {
    let field = ball(Point3::origin(), 3.0);
    let grid = sample(&field, 4.0, 24);
    check_all(&grid, &Options::default());
    let mesh = surface(&grid, Some(&field), &Options::default(), Run::on(&Cpu))
        .unwrap()
        .mesh;
    assert_eq!(mesh.euler_characteristic(), 2);
    let worst = mesh
        .positions()
        .iter()
        .map(|p| (p.coords.norm() - 3.0).abs())
        .fold(0.0, f64::max);
    assert!(
        worst < 0.02 * grid.lattice().spacing,
        "vertices lie on the sphere, worst {worst}"
    );
}

#[test]
fn white_noise_gives_manifold_conforming_meshes() {
    for (i, density) in [0.1, 0.2, 0.3, 0.4, 0.5].into_iter().enumerate() {
        check_all(&noise(12, density, 1, i as u64 + 1), &Options::default());
    }
}

#[test]
fn white_noise_may_touch_the_box() {
    for (i, density) in [0.15, 0.5].into_iter().enumerate() {
        let grid = noise(11, density, 0, i as u64 + 11);
        for at_box in [AtBox::Cap, AtBox::Clip] {
            check_all(
                &grid,
                &Options {
                    at_box,
                    ..Options::default()
                },
            );
        }
    }
}

#[test]
fn adaptive_noise_is_manifold_too() {
    for (i, tolerance) in [0.2, 1.0, 3.0].into_iter().enumerate() {
        let field = Field(move |x: &Point3| {
            1.0 + (1.7 * x.x + i as f64).sin() * (1.3 * x.y).cos()
                + (2.1 * x.z).sin() * (0.9 * x.x).cos()
                - 0.1 * x.coords.norm_squared()
        });
        let grid = sample(&field, 5.0, 24);
        check_all(
            &grid,
            &Options {
                tolerance,
                ..Options::default()
            },
        );
    }
}

#[test]
fn regions_of_a_volume_are_named() {
    let grid = sample(&ball(Point3::origin(), 2.0), 3.0, 12);
    let v = volume(&grid, None, &both(Options::default()), Run::on(&Cpu)).unwrap();
    assert!(v.mesh.regions().contains(&INTERIOR) && v.mesh.regions().contains(&EXTERIOR));
}

const METHODS: [Method; 2] = [Method::DualContour, Method::Lattice];

fn by(method: Method) -> Options {
    Options {
        method,
        ..Options::default()
    }
}

/// Values on 5 × 5 × 5 points, outside but for the given ones; distances from the level vary.
fn few(inside: impl Fn([usize; 3]) -> bool, seed: u64) -> ScalarGrid {
    let lattice = Lattice {
        origin: Point3::origin(),
        spacing: 1.0,
        counts: [6, 6, 6],
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
fn scatter(i: u64) -> f64 {
    let x = (i ^ 0x5555).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    let x = (x ^ x >> 29).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    (x >> 11) as f64 / (1u64 << 53) as f64
}

/// Closed, conforming, filling the box.
fn check_quickly(grid: &ScalarGrid, options: &Options) {
    let v = volume(grid, None, &both(options.clone()), Run::on(&Cpu)).unwrap();
    assert_conforming(&v.mesh);
    assert_closed(&v.surface);
    let total = v.mesh.bounds().extent().product();
    assert!((v.mesh.volume() / total - 1.0).abs() < 1e-12);
}

#[test]
fn every_pattern_of_a_cell_is_meshed() {
    for mask in 1..256usize {
        // Two sets of values, which decide saddles and split or not differently.
        for seed in 0..2 {
            let grid = few(
                |p| {
                    p.iter().all(|c| (2..4).contains(c)) && {
                        mask >> ((p[0] - 2) + 2 * (p[1] - 2) + 4 * (p[2] - 2)) & 1 == 1
                    }
                },
                seed,
            );
            for method in METHODS {
                check_quickly(&grid, &by(method));
            }
        }
    }
}

#[test]
fn every_pattern_of_two_cells_is_meshed() {
    for mask in 1..4096usize {
        let grid = few(
            |p| {
                (1..4).contains(&p[0]) && (2..4).contains(&p[1]) && (2..4).contains(&p[2]) && {
                    mask >> ((p[0] - 1) + 3 * (p[1] - 2) + 6 * (p[2] - 2)) & 1 == 1
                }
            },
            mask as u64,
        );
        check_quickly(&grid, &by(METHODS[mask % 2]));
    }
}

#[test]
fn patterns_of_three_cells_are_meshed() {
    for seed in 0..400u64 {
        let mask = (scatter(seed) * 65536.0) as usize;
        let grid = few(
            |p| {
                (1..5).contains(&p[0]) && (2..4).contains(&p[1]) && (2..4).contains(&p[2]) && {
                    mask >> ((p[0] - 1) + 4 * (p[1] - 2) + 8 * (p[2] - 2)) & 1 == 1
                }
            },
            seed,
        );
        if mask != 0 {
            check_quickly(&grid, &by(METHODS[seed as usize % 2]));
        }
    }
}

#[test]
fn noise_on_large_leaves_is_manifold_too() {
    for seed in 0..3 {
        // Noise on every second point, linear between: leaves of size 2 stay unless they are ambiguous.
        let coarse = noise(8, 0.4, 1, seed + 31);
        let fine = FieldSamples::new(&coarse, &coarse.lattice().bounds(), 0.25);
        let values = (0..fine.lattice().len())
            .map(|i| fine.at(fine.lattice().coordinates(i)))
            .collect();
        let grid = ScalarGrid::new(*fine.lattice(), values).unwrap();
        let options = Options {
            tolerance: 0.3,
            ..Options::default()
        };
        check_all(&grid, &options);
        let wild = Options {
            tolerance: 1e6,
            ..Options::default()
        };
        check_all(&noise(16, 0.5, 1, seed + 77), &wild);
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]
    #[test]
    fn random_signs_are_meshed(
        n in 3..9usize,
        density in 0.05..0.95f64,
        seed in any::<u64>(),
        lattice in any::<bool>(),
        clip in any::<bool>(),
    ) {
        let grid = noise(n, density, 0, seed);
        let options = Options {
            at_box: if clip { AtBox::Clip } else { AtBox::Cap },
            ..by(METHODS[usize::from(lattice)])
        };
        match volume(&grid, None, &both(options.clone()), Run::on(&Cpu)) {
            Ok(_) => check_method(&grid, &options),
            Err(Error::NoSurface { .. }) => {}
            Err(other) => panic!("{other}"),
        }
    }
}

/// Errors of volume and area of the unit ball's surface at a spacing.
fn ball_errors(n: usize, method: Method) -> (f64, f64) {
    let field = ball(Point3::new(0.013, -0.021, 0.007), 1.0);
    let grid = sample(&field, 1.5, n);
    let mesh = surface(&grid, Some(&field), &by(method), Run::on(&Cpu))
        .unwrap()
        .mesh;
    let four_pi = 4.0 * std::f64::consts::PI;
    (
        (mesh.volume() - four_pi / 3.0).abs(),
        (mesh.area() - four_pi).abs(),
    )
}

#[test]
fn volume_and_area_converge_with_the_square_of_the_spacing() {
    for method in METHODS {
        let (coarse, fine) = (ball_errors(24, method), ball_errors(48, method));
        for (name, ratio) in [("volume", coarse.0 / fine.0), ("area", coarse.1 / fine.1)] {
            assert!(
                (3.6..4.4).contains(&ratio),
                "{method:?}: halving the spacing divides the error of the {name} by {ratio:.2}"
            );
        }
    }
}

#[test]
fn vertices_lie_on_the_surface() {
    let field = ball(Point3::origin(), 3.0);
    let grid = sample(&field, 4.0, 24);
    for method in METHODS {
        let mesh = surface(&grid, Some(&field), &by(method), Run::on(&Cpu))
            .unwrap()
            .mesh;
        let off = |p: &Point3| (p.coords.norm() - 3.0).abs() / grid.lattice().spacing;
        let n = mesh.positions().len();
        let far = mesh.positions().iter().filter(|p| off(p) > 0.02).count();
        // The lattice method leaves a few cuts off the surface where snapping is not safe.
        let allowed = if method == Method::Lattice {
            n / 100
        } else {
            0
        };
        assert!(
            far <= allowed,
            "{method:?}: {far} of {n} vertices are off the sphere"
        );
    }
}

#[test]
fn placements_differ_as_they_should() {
    // A cube with sharp edges.
    let cube = Field(|x: &Point3| 2.0 - x.iter().fold(0.0f64, |m, c| m.max(c.abs())));
    let grid = sample(&cube, 2.1, 17);
    let corner = |placement| {
        let options = Options {
            placement,
            ..Options::default()
        };
        let mesh = surface(&grid, Some(&cube), &options, Run::on(&Cpu))
            .unwrap()
            .mesh;
        let distance = |p: &Point3| (p.map(f64::abs) - Point3::new(1.0, 1.0, 1.0)).norm();
        mesh.positions()
            .iter()
            .map(distance)
            .fold(f64::INFINITY, f64::min)
    };
    let [mass, newton, qef] = [Placement::Mass, Placement::Newton, Placement::Qef].map(corner);
    assert!(qef < 1e-6, "the tangent planes meet in the corner: {qef}");
    assert!(mass > 0.05, "the mean of the crossings misses it: {mass}");
    assert!(newton < mass, "{newton}");
}

#[test]
fn topology_is_that_of_the_body() {
    for method in METHODS {
        let run = Run::on(&Cpu);
        let ring = sample(&torus(2.0, 0.8), 3.4, 32);
        let ring = volume(&ring, None, &by(method), run).unwrap();
        assert_eq!(ring.surface.euler_characteristic(), 0);
        assert_eq!(euler_of_tets(ring.mesh.tets()), 0, "a solid torus");

        let shell = Field(|x: &Point3| 1.5 - (x.coords.norm() - 2.0).abs());
        let grid = sample(&shell, 3.4, 30);
        let inner = volume(&grid, None, &by(method), run).unwrap();
        assert_eq!(
            components(inner.surface.triangles()),
            2,
            "outside and cavity"
        );
        assert_eq!(components(inner.mesh.tets()), 1);
        let outer = Options {
            region: Extent::Exterior,
            separate_exterior: true,
            ..by(method)
        };
        let outer = volume(&grid, None, &outer, run).unwrap();
        assert_eq!(components(outer.mesh.tets()), 2, "around and cavity");
        assert_eq!(outer.exterior_parts, [2]);
        let cavity = volume_of(&outer.mesh, 2);
        let exact = 4.0 / 3.0 * std::f64::consts::PI * 1.5f64.powi(3);
        assert!((cavity / exact - 1.0).abs() < 0.03, "{cavity} for {exact}");
        assert!(outer.names().contains(&(2, "exterior_2".to_owned())));
    }
}

/// Components of the points on each side, connected by lattice edges.
fn lattice_components(grid: &ScalarGrid, inside: bool) -> usize {
    let lattice = grid.lattice();
    let is = |p: [usize; 3]| (grid.at(p) >= 1.0) == inside;
    let edges: Vec<[u32; 2]> = (0..lattice.len())
        .flat_map(|i| {
            let p = lattice.coordinates(i);
            (0..3).filter_map(move |k| {
                let mut q = p;
                q[k] += 1;
                (q[k] < lattice.counts[k] && is(p) && is(q))
                    .then(|| [i as u32, lattice.index(q) as u32])
            })
        })
        .collect();
    components(&edges)
}

/// A smooth field with many bumps.
fn bumps(seed: u64) -> Field<impl Fn(&Point3) -> f64 + Sync + Copy> {
    let k: [f64; 6] = std::array::from_fn(|i| 0.9 + scatter(10 * seed + i as u64));
    Field(move |x: &Point3| {
        1.2 + (k[0] * x.x).sin() * (k[1] * x.y).cos()
            + (k[2] * x.y).sin() * (k[3] * x.z).cos()
            + (k[4] * x.z).sin() * (k[5] * x.x).cos()
            - 0.1 * x.coords.norm_squared()
    })
}

#[test]
fn components_and_tunnels_are_those_of_the_labels() {
    for seed in 0..3 {
        let at = [0, 1, 2].map(|k| scatter(3 * seed + k) - 0.5);
        let grid = sample(&bodies(Vector3::from(at)), 6.4, 48);
        for method in METHODS {
            let v = volume(&grid, None, &both(by(method)), Run::on(&Cpu)).unwrap();
            for (inside, region) in [(true, INTERIOR), (false, EXTERIOR)] {
                let tets: Vec<[u32; 4]> = (0..v.mesh.tets().len())
                    .filter(|&t| v.mesh.regions()[t] == region)
                    .map(|t| v.mesh.tets()[t])
                    .collect();
                assert_eq!(components(&tets), lattice_components(&grid, inside));
                if inside {
                    assert_eq!(v.surface.euler_characteristic(), 2 * euler_of_tets(&tets));
                    // Tunnels: the Euler characteristic of the cubes' vertices, edges, faces and cells.
                    assert_eq!(euler_of_tets(&tets), euler_of_cubes(&grid));
                }
            }
        }
    }
}

/// Two rings, a shell and a ball, apart from each other.
fn bodies(shift: Vector3) -> Field<impl Fn(&Point3) -> f64 + Sync> {
    Field(move |x: &Point3| {
        let x = x.coords - shift;
        let ring = |d: Vector3| {
            let out = (d.x * d.x + d.y * d.y).sqrt() - 1.7;
            0.6 - (out * out + d.z * d.z).sqrt()
        };
        let rings =
            ring(x - Vector3::new(-2.8, 0.0, 1.0)).max(ring(x - Vector3::new(2.7, -0.4, -1.0)));
        let shell = 0.5 - ((x - Vector3::new(0.3, 3.9, 0.0)).norm() - 1.2).abs();
        let ball = 1.0 - (x - Vector3::new(0.0, -4.0, 1.0)).norm();
        1.0 + rings.max(shell).max(ball)
    })
}

/// Vertices − edges + faces − cubes of the complex of all-inside lattice cells.
fn euler_of_cubes(grid: &ScalarGrid) -> i64 {
    let lattice = grid.lattice();
    let counts = lattice.counts;
    let inside = |p: [usize; 3]| (0..3).all(|k| p[k] < counts[k]) && grid.at(p) >= 1.0;
    (0..lattice.len())
        .map(|i| {
            let p = lattice.coordinates(i);
            (0..8usize)
                .filter(|span| {
                    (0..8usize)
                        .filter(|c| c & !span == 0)
                        .all(|c| inside([0, 1, 2].map(|k| p[k] + (c >> k & 1))))
                })
                .map(|span| if span.count_ones() % 2 == 0 { 1 } else { -1 })
                .sum::<i64>()
        })
        .sum()
}

/// Noise between whose points, but at none of them, something swells.
struct Swollen(ScalarGrid);

impl ImplicitField for Swollen {
    fn value(&self, x: &Point3) -> f64 {
        let wave = |c: f64| (std::f64::consts::PI * c / self.0.lattice().spacing).sin();
        self.0.value(x) + (2.0 * wave(x.x) * wave(x.y) * wave(x.z)).powi(2)
    }
    fn value_gradient(&self, x: &Point3) -> (f64, Vector3) {
        Field(|x: &Point3| self.value(x)).value_gradient(x)
    }
}

/// What is joined follows from the values on the lattice; a field moves vertices, even where it says
/// otherwise between them.
#[test]
fn a_field_does_not_change_topology() {
    for seed in 0..4 {
        let grid = noise(9, 0.35, 1, 70 + seed);
        let field = Swollen(grid.clone());
        let options = both(Options::default());
        let run = Run::on(&Cpu);
        let without = volume(&grid, None, &options, run).unwrap();
        let with = volume(&grid, Some(&field), &options, run).unwrap();
        assert_conforming(&with.mesh);
        assert_closed(&with.surface);
        let topology = |v: &dual_contour::Volume| {
            let inside = |wanted| -> Vec<[u32; 4]> {
                let all = v.mesh.tets().iter().zip(v.mesh.regions());
                all.filter(|(_, r)| **r == wanted)
                    .map(|(t, _)| *t)
                    .collect()
            };
            [INTERIOR, EXTERIOR].map(|r| {
                let tets = inside(r);
                (components(&tets), euler_of_tets(&tets))
            })
        };
        assert_eq!(topology(&with), topology(&without), "seed {seed}");
        let alone = surface(&grid, Some(&field), &options, run).unwrap();
        assert!(alone.mesh == with.surface);
        assert_eq!(
            alone.mesh.euler_characteristic(),
            without.surface.euler_characteristic()
        );
    }
}

#[test]
fn sparse_grids_give_the_same_mesh_as_dense_ones() {
    let field = ball(Point3::origin(), 9.0);
    let grid = sample(&field, 12.0, 48);
    let bricks = grid.lattice().counts.map(|n| n.div_ceil(8));
    let (mut kinds, mut values, mut stored) = (Vec::new(), Vec::new(), 0);
    for b in 0..bricks.iter().product::<usize>() {
        let at = [
            b % bricks[0],
            b / bricks[0] % bricks[1],
            b / (bricks[0] * bricks[1]),
        ];
        let brick: Vec<f32> = (0..512)
            .map(|i| {
                let p = [0, 1, 2].map(|k| at[k] * 8 + [i % 8, i / 8 % 8, i / 64][k]);
                let p = [0, 1, 2].map(|k| p[k].min(grid.lattice().counts[k] - 1));
                grid.at(p)
            })
            .collect();
        // Far bricks are constants, as a narrow band stores them.
        if brick.iter().all(|&v| v < 0.0) {
            kinds.push(Brick::Exterior);
        } else if brick.iter().all(|&v| v > 2.0) {
            kinds.push(Brick::Interior);
        } else {
            kinds.push(Brick::Stored(stored));
            stored += 1;
            values.extend(brick);
        }
    }
    assert!((stored as usize) < kinds.len());
    let sparse = BrickGrid::new(*grid.lattice(), &kinds, values, 0.0, 2.5).unwrap();
    for method in METHODS {
        let run = Run::on(&Cpu);
        let [a, b] = [Extent::Interior, Extent::Both].map(|region| {
            let options = Options {
                region,
                ..by(method)
            };
            (
                volume(&grid, None, &options, run).unwrap(),
                volume(&sparse, None, &options, run).unwrap(),
            )
        });
        assert!(a.0 == a.1 && b.0 == b.1);
        // Another spacing, from the trilinear values and from the field itself.
        let options = Options {
            resolution: Resolution::Spacing(0.83),
            ..by(method)
        };
        let dense = surface(&grid, Some(&field), &options, run).unwrap();
        assert!(dense == surface(&sparse, Some(&field), &options, run).unwrap());
        let lazy = FieldSamples::new(&field, &grid.lattice().bounds(), 0.83);
        let options = by(method);
        let lazy = surface(&lazy, Some(&field), &options, run).unwrap();
        assert!((lazy.mesh.volume() / dense.mesh.volume() - 1.0).abs() < 0.01);
    }
}

#[test]
fn a_number_of_tetrahedra_can_be_asked_for() {
    let field = ball(Point3::origin(), 9.0);
    let grid = sample(&field, 12.0, 24);
    for (tets, region) in [(20_000, Extent::Interior), (60_000, Extent::Both)] {
        for method in METHODS {
            let options = Options {
                resolution: Resolution::Tets(tets),
                region,
                ..by(method)
            };
            let v = volume(&grid, Some(&field), &options, Run::on(&Cpu)).unwrap();
            let ratio = v.report.tets as f64 / tets as f64;
            assert!((0.8..1.25).contains(&ratio), "{ratio} of {tets}");
            assert_conforming(&v.mesh);
        }
    }
}

/// Large leaves whose points would be held back on their way to the surface are split instead.
#[test]
fn nothing_sticks_out_of_a_surface_of_large_cells() {
    let field = Field(|x: &Point3| {
        let ripple = (2.2 * x.x).sin() * (2.2 * x.y).sin() * (2.2 * x.z).sin();
        1.0 + 5.0 + 0.35 * ripple - x.coords.norm()
    });
    let grid = sample(&field, 7.0, 64);
    let h = grid.lattice().spacing;
    for tolerance in [2.0 * h, 4.0 * h, 8.0 * h] {
        let options = Options {
            tolerance,
            ..Options::default()
        };
        let v = volume(&grid, Some(&field), &options, Run::on(&Cpu)).unwrap();
        assert_conforming(&v.mesh);
        let off = |p: &Point3| {
            let (f, g) = field.value_gradient(p);
            (f - 1.0).abs() / g.norm()
        };
        let worst = v.surface.positions().iter().map(off).fold(0.0, f64::max);
        assert!(worst < 0.6 * h, "a vertex is {} h off", worst / h);
    }
}

#[test]
fn coarser_tolerances_give_fewer_tetrahedra_within_the_tolerance() {
    let field = Field(|x: &Point3| {
        // A large ball with a small bump.
        let ball = 5.0 - x.coords.norm();
        let bump = 1.2 - (x - Point3::new(5.0, 0.0, 0.0)).norm();
        1.0 + ball.max(bump) + 0.2 * (-(ball - bump).abs()).exp()
    });
    let grid = sample(&field, 8.0, 64);
    let h = grid.lattice().spacing;
    let mut last = usize::MAX;
    for tolerance in [0.0, 0.5 * h, 1.5 * h, 4.0 * h, 8.0 * h] {
        let options = Options {
            tolerance,
            ..Options::default()
        };
        let v = volume(&grid, Some(&field), &options, Run::on(&Cpu)).unwrap();
        assert!(v.report.tets <= last, "{} after {last}", v.report.tets);
        last = v.report.tets;
        assert_closed(&v.surface);
        let mut off: Vec<f64> = (0..v.surface.triangles().len())
            .map(|t| {
                let c = v.surface.corners(t);
                let middle = Point3::from(c.iter().map(|p| p.coords).sum::<Vector3>() / 3.0);
                let (f, g) = field.value_gradient(&middle);
                (f - 1.0).abs() / g.norm()
            })
            .collect();
        off.sort_by(f64::total_cmp);
        let p99 = off[off.len() * 99 / 100];
        assert!(p99 <= tolerance.max(0.1 * h), "{p99} for {tolerance}");
    }
}

#[test]
fn zones_are_finer() {
    let field = ball(Point3::origin(), 6.0);
    let grid = sample(&field, 8.0, 64);
    let coarse = Options {
        tolerance: 4.0,
        ..Options::default()
    };
    let zoned = Options {
        zones: vec![Zone {
            center: Point3::new(6.0, 0.0, 0.0),
            radius: 2.0,
            tolerance: 0.0,
        }],
        ..coarse.clone()
    };
    let count = |options: &Options, near: bool| {
        let mesh = surface(&grid, None, options, Run::on(&Cpu)).unwrap().mesh;
        let at = Point3::new(6.0, 0.0, 0.0);
        let is = |p: &&Point3| ((**p - at).norm() < 2.0) == near;
        mesh.positions().iter().filter(is).count()
    };
    let fine = Options::default();
    assert_eq!(count(&zoned, true), count(&fine, true));
    assert!(count(&zoned, true) > 4 * count(&coarse, true));
    assert!(2 * count(&zoned, false) < count(&fine, false));
    // The ball as many, in any order, among others that the surface does not meet.
    let mut many = zoned.clone();
    for i in 0..100 {
        let x = 4.0 - 0.08 * f64::from(i);
        many.zones.push(Zone {
            center: Point3::new(x, 0.0, 0.0),
            radius: 0.2 * f64::from(i % 2),
            tolerance: 0.0,
        });
        many.zones.insert(0, zoned.zones[0]);
    }
    many.zones
        .retain(|z| z.center.x.abs() < 3.5 || z.radius == 2.0);
    for near in [true, false] {
        assert_eq!(count(&many, near), count(&zoned, near));
    }
}

#[test]
fn a_membrane_parts_the_exterior() {
    // A body through a slab: molecule, membrane, above and below.
    let field = Field(|x: &Point3| 1.0 + 4.0 - (x.x * x.x + x.y * x.y + x.z * x.z / 4.0).sqrt());
    let grid = sample(&field, 10.0, 40);
    for method in METHODS {
        for outer in [Outer::Grid, Outer::Box { scale: 1.5 }] {
            let options = Options {
                region: Extent::Both,
                outer,
                materials: vec![
                    Material {
                        region: 7,
                        shape: Shape::Sphere {
                            center: Point3::new(0.0, 4.5, 0.0),
                            radius: 1.5,
                        },
                    },
                    Material {
                        region: 2,
                        shape: Shape::Slab {
                            normal: Vector3::z(),
                            low: -2.6,
                            high: 2.1,
                        },
                    },
                ],
                separate_exterior: true,
                ..by(method)
            };
            let v = volume(&grid, Some(&field), &options, Run::on(&Cpu)).unwrap();
            assert_conforming(&v.mesh);
            assert_closed(&v.surface);
            assert_eq!(v.exterior_parts, [3], "above and below");
            let total = v.mesh.bounds().extent().product();
            assert!((v.mesh.volume() / total - 1.0).abs() < 1e-12);
            let parts = [0, 1, 2, 3, 7].map(|r| volume_of(&v.mesh, r));
            assert!(parts.iter().all(|&p| p > 0.0), "{parts:?}");
            assert!((parts.iter().sum::<f64>() / total - 1.0).abs() < 1e-10);
            let inside = boundary_of(&v.mesh, INTERIOR);
            assert!(
                geometry(v.mesh.positions(), &inside)
                    == geometry(v.surface.positions(), v.surface.triangles())
            );
            // The slab is a slab: its volume outside of the body and the ball.
            let area = v.mesh.bounds().extent().x * v.mesh.bounds().extent().y;
            let slab = area * 4.7;
            assert!(
                parts[2] < slab && parts[2] > 0.7 * slab,
                "{} of {slab}",
                parts[2]
            );
            // Where three regions meet, vertices stay.
            assert!(v.mesh.kinds().contains(&VertexKind::Fixed));
            let view = View::of_tets(&v.mesh, &[(2, "membrane")]);
            let names: Vec<&str> = view.groups.iter().map(|g| g.name.as_str()).collect();
            for name in [
                "molecule",
                "membrane",
                "exterior",
                "membrane|molecule",
                "box_zmax",
            ] {
                let flipped = name.split('|').rev().collect::<Vec<_>>().join("|");
                assert!(
                    names.contains(&name) || names.contains(&flipped.as_str()),
                    "{name} in {names:?}"
                );
            }
        }
    }
}

#[test]
fn cylinders_and_boxes_are_materials_too() {
    let field = ball(Point3::origin(), 3.0);
    let grid = sample(&field, 6.0, 24);
    let cylinder = Shape::Cylinder {
        start: Point3::new(0.0, 0.0, -4.4),
        end: Point3::new(0.0, 0.0, 4.4),
        radius: 1.6,
    };
    let cuboid = Shape::Cuboid(Aabb::new(
        Point3::new(1.3, 1.3, -1.2),
        Point3::new(4.3, 4.3, 1.7),
    ));
    for method in METHODS {
        let options = Options {
            region: Extent::Both,
            materials: vec![
                Material {
                    region: 5,
                    shape: cylinder,
                },
                Material {
                    region: 6,
                    shape: cuboid,
                },
            ],
            ..by(method)
        };
        let v = volume(&grid, Some(&field), &options, Run::on(&Cpu)).unwrap();
        assert_conforming(&v.mesh);
        assert_closed(&v.surface);
        let total = v.mesh.bounds().extent().product();
        assert!((v.mesh.volume() / total - 1.0).abs() < 1e-12);
        // Two caps of the cylinder stick out of the ball.
        let inside = 3.0f64.powi(2) - 1.6f64.powi(2);
        let exact = std::f64::consts::PI * 1.6 * 1.6 * 8.8
            - 4.0 / 3.0 * std::f64::consts::PI * (27.0 - inside.powf(1.5));
        let ours = volume_of(&v.mesh, 5);
        assert!((ours / exact - 1.0).abs() < 0.1, "{ours} for {exact}");
        assert!(volume_of(&v.mesh, 6) > 0.0);
    }
}

#[test]
fn the_exterior_may_end_at_a_sphere() {
    let field = ball(Point3::origin(), 3.0);
    let grid = sample(&field, 4.0, 16);
    let radius = 2.0 * 0.5 * grid.lattice().bounds().diagonal();
    for method in METHODS {
        for region in [Extent::Exterior, Extent::Both] {
            let options = Options {
                region,
                outer: Outer::Sphere { scale: 2.0 },
                ..by(method)
            };
            let v = volume(&grid, Some(&field), &options, Run::on(&Cpu)).unwrap();
            assert_conforming(&v.mesh);
            let ball = 4.0 / 3.0 * std::f64::consts::PI;
            let hole = if region == Extent::Both { 0.0 } else { 27.0 };
            let exact = ball * (radius.powi(3) - hole);
            assert!(
                (v.mesh.volume() / exact - 1.0).abs() < 0.03,
                "{}",
                v.mesh.volume() / exact
            );
            let outer: Vec<[u32; 3]> = boundary_of(&v.mesh, EXTERIOR)
                .into_iter()
                .filter(|t| {
                    t.iter()
                        .all(|&c| v.mesh.positions()[c as usize].coords.norm() > 6.0)
                })
                .collect();
            assert_eq!(
                faults(&outer),
                Faults::default(),
                "the outer boundary is closed"
            );
            let off = outer
                .iter()
                .flatten()
                .map(|&c| (v.mesh.positions()[c as usize].coords.norm() - radius).abs())
                .fold(0.0, f64::max);
            assert!(off < 0.6 * grid.lattice().spacing, "{off}");
            // Graded: few tetrahedra for the far volume.
            assert!(v.mesh.tets().len() < 400_000);
        }
    }
}

#[test]
fn an_enlarged_box_is_graded() {
    let field = ball(Point3::origin(), 3.0);
    let grid = sample(&field, 4.0, 32);
    for method in METHODS {
        let count = |scale| {
            let options = Options {
                region: Extent::Exterior,
                outer: Outer::Box { scale },
                ..by(method)
            };
            let v = volume(&grid, Some(&field), &options, Run::on(&Cpu)).unwrap();
            let size = v.mesh.bounds().extent();
            assert!(size.x >= scale * 8.0 - 1e-9 && size.x < scale * 8.0 + 9.0);
            v.mesh.tets().len()
        };
        let (small, large) = (count(1.0), count(4.0));
        assert!(
            large < 2 * small,
            "64 times the volume for {large} instead of {small}"
        );
    }
}

#[test]
fn the_surface_does_not_hang_on_where_the_mesh_ends() {
    let grid = noise(24, 0.4, 7, 5);
    for method in METHODS {
        let alone = surface(&grid, None, &by(method), Run::on(&Cpu))
            .unwrap()
            .mesh;
        for outer in [Outer::Box { scale: 1.5 }, Outer::Sphere { scale: 1.3 }] {
            let options = Options {
                outer,
                ..both(by(method))
            };
            let v = volume(&grid, None, &options, Run::on(&Cpu)).unwrap();
            let [ours, theirs] = [v.surface.triangles().len(), alone.triangles().len()];
            assert_eq!(ours, theirs, "{method:?} {outer:?}");
            assert!((v.surface.volume() / alone.volume() - 1.0).abs() < 1e-9);
        }
    }
}

#[test]
fn largest_cells_can_be_limited() {
    let grid = sample(&ball(Point3::origin(), 6.0), 8.0, 64);
    let count = |max_cell| {
        let options = Options {
            max_cell,
            ..Options::default()
        };
        volume(&grid, None, &options, Run::on(&Cpu))
            .unwrap()
            .mesh
            .tets()
            .len()
    };
    assert!(count(0.25) > 2 * count(0.5) && count(0.5) > count(f64::INFINITY));
}

#[test]
fn small_groups_are_pruned_and_reported() {
    // A ball, a bubble in it, and a speck beside it.
    let field = Field(|x: &Point3| {
        let bubble = (x - Point3::new(0.5, 0.0, 0.0)).norm() - 0.6;
        let ball = (4.0 - x.coords.norm()).min(bubble);
        1.0 + ball.max(0.6 - (x - Point3::new(5.5, 0.0, 0.0)).norm())
    });
    let grid = sample(&field, 7.0, 28);
    for method in METHODS {
        let parts = |prune| {
            let options = Options {
                prune,
                ..by(method)
            };
            let s = surface(&grid, None, &options, Run::on(&Cpu)).unwrap();
            assert_closed(&s.mesh);
            (
                components(s.mesh.triangles()),
                s.report.pruned_groups,
                s.report.pruned_points,
            )
        };
        assert_eq!(parts(0), (3, 0, 0));
        assert_eq!(parts(5), (3, 0, 0));
        let (parts, groups, points) = parts(40);
        assert_eq!((parts, groups), (1, 2));
        assert!((2..80).contains(&points));
    }
}

#[test]
fn threads_do_not_matter() {
    let field = bumps(5);
    let grid = sample(&field, 6.0, 32);
    for method in METHODS {
        for tolerance in [0.0, 1.0] {
            if tolerance > 0.0 && method == Method::Lattice {
                continue;
            }
            let options = Options {
                region: Extent::Both,
                outer: Outer::Box { scale: 1.2 },
                materials: vec![Material {
                    region: 2,
                    shape: Shape::Slab {
                        normal: Vector3::z(),
                        low: -1.0,
                        high: 1.3,
                    },
                }],
                separate_exterior: true,
                tolerance,
                prune: 3,
                at_box: AtBox::Cap,
                ..by(method)
            };
            let run = Run::on(&Cpu);
            same_on_any_threads(|| volume(&grid, Some(&field), &options, run).unwrap());
            same_on_any_threads(|| surface(&grid, None, &options, run).unwrap());
        }
    }
}

#[test]
fn nothing_to_mesh_is_an_error() {
    for value in [0.25f32, 3.0] {
        let lattice = Lattice {
            origin: Point3::origin(),
            spacing: 1.0,
            counts: [9, 5, 4],
        };
        let grid = ScalarGrid::new(lattice, vec![value; lattice.len()]).unwrap();
        let options = Options {
            at_box: AtBox::Clip,
            ..Options::default()
        };
        let error = surface(&grid, None, &options, Run::on(&Cpu)).unwrap_err();
        let (min, max) = (f64::from(value), f64::from(value));
        assert_eq!(
            error,
            Error::NoSurface {
                level: 1.0,
                min,
                max
            }
        );
        assert!(error.to_string().contains("choose a level between"));
    }
}

/// The range in the message is that of the values, and what hides the surface is named.
#[test]
fn the_reason_for_no_surface_is_told() {
    let grid = sample(&ball(Point3::origin(), 2.0), 3.0, 12);
    let (low, high) = grid.range().unwrap();
    let fail = |options: &Options| surface(&grid, None, options, Run::on(&Cpu)).unwrap_err();
    for level in [1e30, f64::from(high) + 0.1] {
        let expected = Error::NoSurface {
            level,
            min: f64::from(low),
            max: f64::from(high),
        };
        assert_eq!(
            fail(&Options {
                level,
                ..Options::default()
            }),
            expected
        );
    }
    let named = |options: Options, name: &str| {
        let error = fail(&options);
        assert!(
            matches!(error, Error::InvalidOption { option, .. } if option == name),
            "{error}"
        );
    };
    for spacing in [50.0, 1e9, 1e300] {
        let resolution = Resolution::Spacing(spacing);
        named(
            Options {
                resolution,
                ..Options::default()
            },
            "resolution",
        );
    }
    named(
        Options {
            prune: 300,
            ..Options::default()
        },
        "prune",
    );
    named(
        Options {
            prune: u32::MAX,
            ..Options::default()
        },
        "prune",
    );
}

#[test]
fn the_norm_of_the_error_counts() {
    let field = bumps(2);
    let grid = sample(&field, 5.0, 32);
    let tets = |error_norm| {
        let options = Options {
            tolerance: 0.5,
            error_norm,
            ..Options::default()
        };
        volume(&grid, None, &options, Run::on(&Cpu))
            .unwrap()
            .report
            .tets
    };
    // The largest of the terms is at most their sum.
    assert!(tets(ErrorNorm::Max) < tets(ErrorNorm::Sum));
}

/// Numbers as users mistype them, and as large and small as f64 holds.
fn odd() -> impl Strategy<Value = f64> {
    prop_oneof![
        4 => -3.0..3.0f64,
        1 => Just(0.0),
        1 => Just(f64::NAN),
        1 => Just(f64::INFINITY),
        1 => prop_oneof![Just(1e300), Just(-1e300), Just(f64::MIN_POSITIVE), Just(1e-5), Just(1e5)],
    ]
}

fn odd_point() -> impl Strategy<Value = Point3> {
    prop::array::uniform3(odd()).prop_map(Point3::from)
}

fn odd_shape() -> impl Strategy<Value = Shape> {
    prop_oneof![
        (odd_point(), odd(), odd()).prop_map(|(n, low, high)| Shape::Slab {
            normal: n.coords,
            low,
            high
        }),
        (odd_point(), odd_point(), odd()).prop_map(|(start, end, radius)| Shape::Cylinder {
            start,
            end,
            radius
        }),
        (odd_point(), odd()).prop_map(|(center, radius)| Shape::Sphere { center, radius }),
        (odd_point(), odd_point()).prop_map(|(min, max)| Shape::Cuboid(Aabb { min, max })),
    ]
}

/// Usually the first, sometimes anything.
fn usually<T: Clone + std::fmt::Debug + 'static>(
    usual: T,
    other: impl Strategy<Value = T> + 'static,
) -> impl Strategy<Value = T> {
    prop_oneof![2 => Just(usual), 1 => other]
}

fn odd_options() -> impl Strategy<Value = Options> {
    let resolution = prop_oneof![
        odd().prop_map(Resolution::Spacing),
        (0..5000u64).prop_map(Resolution::Tets)
    ];
    let outer = prop_oneof![
        odd().prop_map(|scale| Outer::Box { scale }),
        odd().prop_map(|scale| Outer::Sphere { scale })
    ];
    let zone = (odd_point(), odd(), odd()).prop_map(|(center, radius, tolerance)| Zone {
        center,
        radius,
        tolerance,
    });
    let material = (0..5u8, odd_shape()).prop_map(|(region, shape)| Material { region, shape });
    let sizes = (
        usually(Resolution::Lattice, resolution),
        usually(0.0, odd()),
        usually(f64::INFINITY, odd()),
        prop::collection::vec(zone, 0..2),
        usually(0, 0..200u32),
    );
    let places = (
        usually(1.0, odd()),
        prop::sample::select(vec![AtBox::Refuse, AtBox::Cap, AtBox::Clip]),
        prop::sample::select(vec![Placement::Mass, Placement::Newton, Placement::Qef]),
        prop::sample::select(vec![Extent::Interior, Extent::Exterior, Extent::Both]),
        usually(Outer::Grid, outer),
        usually(Vec::new(), prop::collection::vec(material, 1..3)),
        any::<bool>(),
    );
    (sizes, places, any::<bool>()).prop_map(|(sizes, places, lattice)| Options {
        resolution: sizes.0,
        tolerance: sizes.1,
        max_cell: sizes.2,
        zones: sizes.3,
        prune: sizes.4,
        level: places.0,
        at_box: places.1,
        placement: places.2,
        region: places.3,
        outer: places.4,
        materials: places.5,
        separate_exterior: places.6,
        max_memory: 1 << 24,
        ..by(METHODS[usize::from(lattice)])
    })
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(200) })]

    /// A sound mesh or a typed error, whatever the options.
    #[test]
    fn no_options_end_in_a_panic(options in odd_options(), given in any::<bool>()) {
        let field = ball(Point3::new(0.1, -0.2, 0.3), 2.0);
        let grid = sample(&field, 3.0, 12);
        let field: Option<&dyn ImplicitField> = if given { Some(&field) } else { None };
        if let Ok(made) = volume(&grid, field, &options, Run::on(&Cpu)) {
            assert_conforming(&made.mesh);
            prop_assert!(made.mesh.positions().iter().all(|p| p.iter().all(|c| c.is_finite())));
        }
        if let Ok(made) = surface(&grid, field, &options, Run::on(&Cpu)) {
            prop_assert_eq!(faults(made.mesh.triangles()), Faults::default());
        }
    }
}

#[test]
fn bad_input_is_named() {
    let run = Run::on(&Cpu);
    let flat = Lattice {
        origin: Point3::origin(),
        spacing: 1.0,
        counts: [1, 1, 9],
    };
    let flat = ScalarGrid::new(flat, vec![0.0; 9]).unwrap();
    let error = surface(&flat, None, &Options::default(), run).unwrap_err();
    assert!(
        matches!(error, Error::NoCells { counts: [1, 1, 9] }),
        "{error}"
    );

    /// A grid that lies about its values.
    struct Broken(ScalarGrid);
    impl LatticeValues for Broken {
        fn lattice(&self) -> &Lattice {
            self.0.lattice()
        }
        fn at(&self, p: [usize; 3]) -> f32 {
            if p == [4, 5, 6] {
                f32::NAN
            } else {
                self.0.at(p)
            }
        }
    }
    let grid = sample(&ball(Point3::origin(), 2.0), 3.0, 12);
    let error = surface(&Broken(grid.clone()), None, &Options::default(), run).unwrap_err();
    assert!(
        matches!(
            error,
            Error::NotFinite {
                index: [4, 5, 6],
                ..
            }
        ),
        "{error}"
    );

    let touching = sample(&ball(Point3::new(1.5, 0.0, 0.0), 2.0), 3.0, 12);
    let error = surface(&touching, None, &Options::default(), run).unwrap_err();
    assert!(
        matches!(error, Error::SurfaceTouchesBox { side: 1, points } if points > 0),
        "{error}"
    );
    assert!(error.to_string().contains("high x"));

    let lattice = Lattice {
        origin: Point3::origin(),
        spacing: 1.0,
        counts: [40, 3, 3],
    };
    let values = (0..lattice.len()).map(|i| {
        if lattice.coordinates(i) == [20, 1, 1] {
            2.0
        } else {
            0.0
        }
    });
    let long = ScalarGrid::new(lattice, values.collect()).unwrap();
    check_all(&long, &Options::default());

    let bad: [(&str, Options); 12] = [
        (
            "level",
            Options {
                level: f64::NAN,
                ..Options::default()
            },
        ),
        (
            "resolution",
            Options {
                resolution: Resolution::Spacing(-1.0),
                ..Options::default()
            },
        ),
        (
            "resolution",
            Options {
                resolution: Resolution::Tets(3),
                ..Options::default()
            },
        ),
        (
            "resolution",
            Options {
                resolution: Resolution::Spacing(1e-5),
                ..Options::default()
            },
        ),
        (
            "tolerance",
            Options {
                tolerance: f64::INFINITY,
                ..Options::default()
            },
        ),
        (
            "tolerance",
            Options {
                tolerance: 1.0,
                ..by(Method::Lattice)
            },
        ),
        (
            "max_cell",
            Options {
                max_cell: 0.0,
                ..Options::default()
            },
        ),
        (
            "outer",
            Options {
                outer: Outer::Box { scale: 0.5 },
                ..Options::default()
            },
        ),
        (
            "outer",
            Options {
                outer: Outer::Box { scale: 1.5 },
                ..Options::default()
            },
        ),
        (
            "separate_exterior",
            Options {
                separate_exterior: true,
                ..Options::default()
            },
        ),
        (
            "materials",
            Options {
                materials: vec![Material {
                    region: 1,
                    shape: Shape::Sphere {
                        center: Point3::origin(),
                        radius: 1.0,
                    },
                }],
                ..Options::default()
            },
        ),
        (
            "zones",
            Options {
                zones: vec![Zone {
                    center: Point3::origin(),
                    radius: -1.0,
                    tolerance: 0.0,
                }],
                ..Options::default()
            },
        ),
    ];
    for (name, options) in bad {
        match volume(&grid, None, &options, run).unwrap_err() {
            Error::InvalidOption { option, reason } => {
                assert_eq!(option, name);
                assert!(!reason.is_empty());
            }
            other => panic!("{name}: {other}"),
        }
    }
    let small = Options {
        resolution: Resolution::Spacing(6.0 / 60_000.0),
        max_memory: 1 << 20,
        ..Options::default()
    };
    assert!(matches!(
        volume(&grid, None, &small, run),
        Err(Error::TooLarge { .. })
    ));
}
