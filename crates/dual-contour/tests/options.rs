//! What the options say is done; what they cannot mean is refused by name.

use std::collections::BTreeSet;

use crate::common::*;
use dual_contour::geom_core::io::View;
use dual_contour::geom_core::mesh::{EXTERIOR, INTERIOR, VertexKind};
use dual_contour::geom_core::testing::cases;
use dual_contour::geom_core::{
    Aabb, Cpu, ImplicitField, Lattice, LatticeValues, Point3, Run, ScalarGrid, TetMesh, Vector3,
};
use dual_contour::{
    AtBox, Error, Extent, FieldSamples, Material, Method, Options, Outer, Placement, Resolution,
    Shape, Zone, surface, volume,
};
use proptest::prelude::*;

#[test]
fn regions_of_a_volume_are_named() {
    let grid = sample(&ball(Point3::origin(), 2.0), 3.0, 12);
    let v = volume(&grid, None, &both(Options::default()), Run::on(&Cpu)).unwrap();
    let names = v.names();
    for (region, name) in [(INTERIOR, "molecule"), (EXTERIOR, "exterior")] {
        assert!(v.mesh.regions().contains(&region));
        assert!(names.contains(&(region, name.to_owned())), "{names:?}");
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

/// Off the box, vertices move on interfaces and where they meet, and are free within a region.
fn assert_kinds(mesh: &TetMesh) {
    let mut regions = vec![BTreeSet::new(); mesh.positions().len()];
    for (t, &region) in mesh.tets().iter().zip(mesh.regions()) {
        t.iter().for_each(|&v| {
            regions[v as usize].insert(region);
        });
    }
    let bounds = mesh.bounds();
    let off_box =
        |p: &Point3| (0..3).all(|k| p[k] > bounds.min[k] + 1e-9 && p[k] < bounds.max[k] - 1e-9);
    let mut found = [0; 3];
    for (v, p) in mesh
        .positions()
        .iter()
        .enumerate()
        .filter(|(_, p)| off_box(p))
    {
        let expected = match regions[v].len() {
            1 => VertexKind::Interior,
            _ => VertexKind::Surface,
        };
        assert_eq!(
            mesh.kinds()[v],
            expected,
            "vertex {v} at {p} of regions {:?}",
            regions[v]
        );
        found[regions[v].len().min(3) - 1] += 1;
    }
    assert!(found.iter().all(|&n| n > 10), "{found:?}");
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
            assert_kinds(&v.mesh);
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
            matches!(&error, Error::Option(wrong) if wrong.option == name),
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
    (sizes, places, any::<bool>()).prop_map(|(sizes, places, stuffing)| Options {
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
        ..by(METHODS[usize::from(stuffing)])
    })
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..cases(200) })]

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

/// Cells whose volume is no number are refused: they were made, and were neither positive nor conforming.
#[test]
fn cells_larger_than_numbers_are_refused() {
    let field = ball(Point3::new(0.1, -0.2, 0.3), 2.0);
    let grid = sample(&field, 3.0, 12);
    let options = Options {
        resolution: Resolution::Spacing(1e300),
        level: 0.0,
        ..by(Method::DualContour)
    };
    let error = volume(&grid, None, &options, Run::on(&Cpu)).unwrap_err();
    assert!(
        matches!(&error, Error::Option(o) if o.option == "resolution"),
        "{error}"
    );
}

/// A lattice that no coordinates or memory can hold is refused before one of its values is asked for.
#[test]
fn a_lattice_too_fine_is_refused_unread() {
    struct Unread(Lattice);
    impl LatticeValues for Unread {
        fn lattice(&self) -> &Lattice {
            &self.0
        }
        fn at(&self, _: [usize; 3]) -> f32 {
            panic!("a value was asked for");
        }
    }
    for counts in [[60_000; 3], [usize::MAX, 9, 9], [1 << 40, 1 << 40, 1 << 40]] {
        let lattice = Lattice {
            origin: Point3::origin(),
            spacing: 1e-3,
            counts,
        };
        let values = Unread(lattice);
        let options = Options::default();
        let error = surface(&values, None, &options, Run::on(&Cpu)).unwrap_err();
        assert!(
            matches!(&error, Error::TooLarge { .. })
                || matches!(&error, Error::Option(o) if o.option == "resolution"),
            "{error}"
        );
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
    for spacing in [0.0, -1.0, f64::NAN] {
        let field = ball(Point3::origin(), 2.0);
        let bounds = sample(&field, 3.0, 12).lattice().bounds();
        let lazy = FieldSamples::new(&field, &bounds, spacing);
        let error = surface(&lazy, None, &Options::default(), run).unwrap_err();
        assert!(error.to_string().contains("option spacing is"), "{error}");
    }
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
                ..by(Method::Stuffing)
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
            Error::Option(wrong) => {
                assert_eq!(wrong.option, name);
                assert!(!wrong.must.is_empty());
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
