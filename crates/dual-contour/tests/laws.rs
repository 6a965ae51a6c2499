//! What must hold for all inputs.

use crate::common::*;
use dual_contour::geom_core::grid::Brick;
use dual_contour::geom_core::mesh::{EXTERIOR, INTERIOR};
use dual_contour::geom_core::testing::same_on_any_threads;
use dual_contour::geom_core::{
    BrickGrid, Cpu, ImplicitField, Lattice, LatticeValues, Point3, Run, ScalarGrid, TetMesh,
    TriMesh, Vector3,
};
use dual_contour::{
    AtBox, Error, Extent, FieldSamples, Material, Method, Options, Outer, Resolution, Shape,
    surface, volume,
};
use proptest::prelude::*;
use std::collections::BTreeSet;

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
        for seed in [0, 10] {
            let grid = noise(13, density, 1, i as u64 + 1 + seed);
            check_all(&grid, &Options::default());
        }
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
fn every_pattern_of_a_cell_is_meshed() {
    for mask in 1..256usize {
        // Two sets of values, which decide saddles and split or not differently.
        for seed in 0..2 {
            let grid = few(
                [5; 3],
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

/// Of patterns that mirror each other one, by both methods.
#[test]
fn every_pattern_of_two_cells_is_meshed() {
    let place = |p: [usize; 3]| p[0] + 3 * p[1] + 6 * p[2];
    let points = || (0..12).map(|i| [i % 3, i / 3 % 2, i / 6]);
    let mirrored = |mask: usize, axes: usize| -> usize {
        let image = |p: [usize; 3]| {
            let across = |k: usize| [2, 1, 1][k] - p[k];
            place([0, 1, 2].map(|k| if axes >> k & 1 == 1 { across(k) } else { p[k] }))
        };
        points().map(|p| (mask >> place(p) & 1) << image(p)).sum()
    };
    let is_first = |&mask: &usize| (1..8).all(|axes| mask <= mirrored(mask, axes));
    let patterns: Vec<usize> = (1..4096).filter(is_first).collect();
    // Burnside: the average of how many of the 4,096 each of the eight mirrorings leaves as they are, without the empty one.
    assert_eq!(patterns.len(), (4096 + 256 + 6 * 64) / 8 - 1);
    for mask in patterns {
        let grid = few(
            [5; 3],
            |p| {
                (1..4).contains(&p[0]) && (2..4).contains(&p[1]) && (2..4).contains(&p[2]) && {
                    mask >> place([p[0] - 1, p[1] - 2, p[2] - 2]) & 1 == 1
                }
            },
            mask as u64,
        );
        for method in METHODS {
            check_quickly(&grid, &by(method));
        }
    }
}

#[test]
fn patterns_of_three_cells_are_meshed() {
    for seed in 0..400u64 {
        let mask = (scatter(seed) * 65536.0) as usize;
        let grid = few(
            [6, 5, 5],
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
    #![proptest_config(geom_core::testing::cases(24))]
    #[test]
    fn random_signs_are_meshed(
        n in 3..9usize,
        density in 0.05..0.95f64,
        seed in any::<u64>(),
        stuffing in any::<bool>(),
        clip in any::<bool>(),
    ) {
        let grid = noise(n, density, 0, seed);
        let options = Options {
            at_box: if clip { AtBox::Clip } else { AtBox::Cap },
            ..by(METHODS[usize::from(stuffing)])
        };
        match volume(&grid, None, &both(options.clone()), Run::on(&Cpu)) {
            Ok(_) => check_method(&grid, &options),
            Err(Error::NoSurface { .. }) => {}
            Err(other) => panic!("{other}"),
        }
    }
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

/// Where a cell has corners of three regions, those of two of them together may fall apart though each is
/// connected: the boundary of the third must stay a manifold all the same.
#[test]
fn molecules_of_noise_in_materials_have_closed_surfaces() {
    let slab = |region: u8, normal: Vector3, low: f64, high: f64| Material {
        region,
        shape: Shape::Slab { normal, low, high },
    };
    for (seed, method) in (0..8).flat_map(|seed| METHODS.map(|method| (seed, method))) {
        let options = Options {
            materials: vec![
                slab(2, Vector3::z(), 1.3, 2.2),
                slab(3, Vector3::new(1.0, 1.0, 0.0), 2.0, 3.1),
            ],
            tolerance: if method == Method::DualContour && seed % 2 == 1 {
                1.0
            } else {
                0.0
            },
            ..by(method)
        };
        let grid = noise(9, 0.5, 1, seed);
        check_quickly(&grid, &options);
        let v = volume(&grid, None, &both(options), Run::on(&Cpu)).unwrap();
        for region in [INTERIOR, EXTERIOR, 2, 3] {
            let triangles = boundary_of(&v.mesh, region);
            let found = faults(&triangles);
            assert_eq!(
                found,
                Faults::default(),
                "region {region}, seed {seed}, {method:?}"
            );
        }
    }
}

/// The planes of a membrane through a molecule, on lattice planes, beside them and between. Off the molecule the
/// boundary lies on them, but for a vertex here and there that has no place to step aside to; without that one in three
/// is up to half a cell off. Where it meets the molecule, it comes nearer than the mean of the crossings does.
#[test]
fn planes_of_materials_are_plane() {
    let field = bumps(5);
    let grid = sample(&field, 6.0, 32);
    let cell = grid.lattice().spacing;
    for method in METHODS {
        for high in [1.5, 1.5003, 1.4997, 1.59, 1.66] {
            let low = -0.9;
            let options = Options {
                region: Extent::Both,
                outer: Outer::Box { scale: 1.4 },
                materials: vec![Material {
                    region: 2,
                    shape: Shape::Slab {
                        normal: Vector3::z(),
                        low,
                        high,
                    },
                }],
                ..by(method)
            };
            let mesh = volume(&grid, Some(&field), &options, Run::on(&Cpu))
                .unwrap()
                .mesh;
            let regions = regions_at(&mesh);
            let off = |z: f64| (z - low).abs().min((z - high).abs()) / cell;
            let of = |wanted: &[u8]| -> Vec<f64> {
                let places = mesh.positions().iter().zip(&regions);
                let mut off: Vec<f64> = places
                    .filter(|(_, regions)| regions.iter().eq(wanted))
                    .map(|(x, _)| off(x.z))
                    .collect();
                off.sort_unstable_by(f64::total_cmp);
                off
            };
            let plane = of(&[EXTERIOR, 2]);
            let junctions = of(&[EXTERIOR, INTERIOR, 2]);
            assert!(plane.len() > 500 && junctions.len() > 30, "{method:?}");
            // Dual vertices keep off the sides of their cells by a hundredth of them, and those of large cells stop on their
            // way where a tetrahedron would invert.
            let (near, least, most) = match method {
                Method::Stuffing => (1e-7, 0.97, 0.26),
                Method::DualContour => (0.05, 0.88, 0.55),
            };
            let on = plane.iter().filter(|&&off| off < near).count();
            let (share, worst) = (on as f64 / plane.len() as f64, plane[plane.len() - 1]);
            assert!(share > least, "{method:?} {high}: {share} are on a plane");
            assert!(worst < most, "{method:?} {high}: {worst} cells off");
            let median = junctions[junctions.len() / 2];
            assert!(median < 0.2, "{method:?} {high}: junctions {median}");
        }
    }
}

/// Balls and cylinders of water beside the molecule: vertices lie on them, off their edges, by either method. The mean of the
/// crossings, which dual contouring took, lies within a ball.
#[test]
fn curved_boundaries_of_materials_are_met() {
    let field = ball(Point3::new(-2.0, 0.0, 0.0), 2.0);
    let grid = sample(&field, 6.0, 32);
    let water = Shape::Sphere {
        center: Point3::new(3.1, 0.2, 0.1),
        radius: 1.9,
    };
    for method in METHODS {
        let options = Options {
            materials: vec![Material {
                region: 2,
                shape: water,
            }],
            ..both(by(method))
        };
        let made = volume(&grid, Some(&field), &options, Run::on(&Cpu)).unwrap();
        let places = made.mesh.positions().iter().zip(regions_at(&made.mesh));
        let on: Vec<&Point3> = places
            .filter(|(_, regions)| regions.iter().eq(&[EXTERIOR, 2]))
            .map(|(x, _)| x)
            .collect();
        assert!(on.len() > 200);
        let off: Vec<f64> = on.iter().map(|x| water.depth(x).abs()).collect();
        let mean = off.iter().sum::<f64>() / off.len() as f64;
        let most = off.iter().copied().fold(0.0, f64::max);
        // Dual vertices keep off the sides of their cells.
        let bounds = match method {
            Method::Stuffing => [1e-7, 1e-6],
            Method::DualContour => [3e-4, 0.02 * grid.lattice().spacing],
        };
        assert!(
            mean < bounds[0] && most < bounds[1],
            "{method:?}: {mean} and {most} Å off"
        );
    }
}

/// The regions of the tetrahedra around each vertex.
fn regions_at(mesh: &TetMesh) -> Vec<BTreeSet<u8>> {
    let mut regions = vec![BTreeSet::new(); mesh.positions().len()];
    for (tet, &region) in mesh.tets().iter().zip(mesh.regions()) {
        for &v in tet {
            regions[v as usize].insert(region);
        }
    }
    regions
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
fn threads_do_not_matter() {
    let field = bumps(5);
    let grid = sample(&field, 6.0, 32);
    for method in METHODS {
        for tolerance in [0.0, 1.0] {
            if tolerance > 0.0 && method == Method::Stuffing {
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

/// On an ambiguous face the pair of corners is joined whose sign the value at the saddle of the bilinear interpolant
/// has; the middles of the cells beside it say nothing here.
#[test]
fn ambiguous_faces_are_joined_by_the_sign_at_their_saddle() {
    // Two points inside across a face: depth `own` for them, `others` for all around. The saddle is at
    // (own − others) / 2; the middle of a cell at (2 own − 6 others) / 8, outside in both cases.
    for (own, others, parts) in [
        (0.2f32, 0.1f32, 1),
        (0.1, 0.2, 2),
        (0.29, 0.1, 1),
        (0.15, 0.16, 2),
    ] {
        for (u, v) in [(0, 1), (1, 2), (2, 0)] {
            for turned in [false, true] {
                let mut pair = [[2; 3]; 2];
                pair[1][u] = 3;
                pair[usize::from(!turned)][v] = 3;
                let lattice = Lattice {
                    origin: Point3::origin(),
                    spacing: 1.0,
                    counts: [6; 3],
                };
                let values = (0..lattice.len())
                    .map(|i| {
                        1.0 + if pair.contains(&lattice.coordinates(i)) {
                            own
                        } else {
                            -others
                        }
                    })
                    .collect();
                let grid = ScalarGrid::new(lattice, values).unwrap();
                let made = surface(&grid, None, &Options::default(), Run::on(&Cpu)).unwrap();
                assert_closed(&made.mesh);
                let found = components(made.mesh.triangles());
                assert_eq!(found, parts, "{own} among {others}, {pair:?}");
                let volume = volume(&grid, None, &both(Options::default()), Run::on(&Cpu)).unwrap();
                assert!(volume.surface == made.mesh);
            }
        }
    }
}

/// Points of the molecule that hardly are: all crossings around them are held off the ends of their edges, and all points of
/// cells off the walls. Held alike they would stand in planes of the lattice, and triangles that meet in one vertex lie in
/// one plane, which is a crossing to whoever decides by signs alone.
#[test]
fn points_that_are_held_are_not_in_one_plane() {
    let mut random = (1u64..).map(|i| {
        let mixed = i.wrapping_mul(0x9e37_79b9_7f4a_7c15);
        ((mixed ^ mixed >> 29).wrapping_mul(0xbf58_476d_1ce4_e5b9) >> 40) as f32
            / (1u64 << 24) as f32
    });
    let lattice = Lattice {
        origin: Point3::origin(),
        spacing: 1.0,
        counts: [20; 3],
    };
    let values = (0..lattice.len()).map(|i| {
        let p = lattice.coordinates(i);
        let within = p.iter().all(|&c| (2..18).contains(&c));
        let (side, depth) = (random.next().unwrap(), random.next().unwrap());
        if within && side < 0.3 {
            1.0 + 0.02 * depth
        } else {
            0.5 * depth
        }
    });
    let noise = ScalarGrid::new(lattice, values.collect()).unwrap();
    let check = |grid: &ScalarGrid, field: Option<&dyn ImplicitField>, options: &Options| {
        let made = surface(grid, field, options, Run::on(&Cpu)).unwrap();
        let [flat, all] = flat_meetings(&made.mesh);
        let method = options.method;
        assert!(all > 5_000 && flat == 0, "{method:?}: {flat} of {all}");
    };
    for method in METHODS {
        check(&noise, None, &by(method));
    }
    for seed in 1..8 {
        let field = bumps(seed);
        let grid = sample(&field, 6.0, 32);
        for method in METHODS {
            check(&grid, None, &by(method));
            check(&grid, Some(&field), &by(method));
        }
        let graded = Options {
            tolerance: 0.1,
            ..by(Method::DualContour)
        };
        check(&grid, Some(&field), &graded);
    }
}

/// How many pairs of triangles that meet in one vertex alone lie in one plane, and how many pairs there are.
fn flat_meetings(mesh: &TriMesh) -> [usize; 2] {
    let x = |v: u32| mesh.positions()[v as usize];
    let triangles = mesh.triangles();
    let mut around = vec![Vec::new(); mesh.positions().len()];
    for t in triangles {
        t.iter().for_each(|&v| around[v as usize].push(*t));
    }
    let (mut flat, mut all) = (0, 0);
    for (v, fan) in around.iter().enumerate() {
        for (i, a) in fan.iter().enumerate() {
            for b in &fan[i + 1..] {
                let others = || b.iter().filter(|w| **w as usize != v);
                if others().any(|w| a.contains(w)) {
                    continue;
                }
                all += 1;
                let [p, q, r] = a.map(x);
                let normal = (q - p).cross(&(r - p));
                flat += usize::from(others().all(|&w| normal.dot(&(x(w) - p)) == 0.0));
            }
        }
    }
    [flat, all]
}
