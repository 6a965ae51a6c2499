//! What must hold for all inputs.

use geom_core::mesh::{OUTSIDE, Region, SurfaceAudit, VertexKind, VolumeAudit};
use geom_core::testing::same_on_any_threads;
use geom_core::{Aabb, Cpu, ImplicitField, Lattice, Point3, Run, ScalarGrid, TetMesh, Vector3};
use proptest::prelude::*;
use tet_quality::measure::metrics::quality;
use tet_quality::testing::{Ball, ball_in_box, lattice, noise, shaken};
use tet_quality::{
    Cause, Error, Goals, Improved, Operations, Options, QualityBackend, SurfaceMotion,
    aspect_ratio, improve, measures, quality_report, radius_ratio,
};

fn improved(mesh: TetMesh, field: Option<&dyn ImplicitField>, options: &Options) -> Improved {
    improve(mesh, field, options, Run::on(&Cpu)).unwrap()
}

fn worst(mesh: &TetMesh) -> f64 {
    (0..mesh.tets().len())
        .map(|t| quality(mesh.corners(t)))
        .fold(f64::INFINITY, f64::min)
}

fn moved(mesh: TetMesh, mut shift: impl FnMut(usize, VertexKind, Point3) -> Point3) -> TetMesh {
    let (mut x, tets, regions, kinds) = mesh.into_parts();
    for v in 0..x.len() {
        x[v] = shift(v, kinds[v], x[v]);
    }
    TetMesh::with_kinds(x, tets, regions, kinds).unwrap()
}

/// Volume per region, and whether the mesh is one that a solver takes.
fn sound(mesh: &TetMesh) -> Vec<(Region, f64)> {
    let audit = VolumeAudit::of(mesh);
    assert!(audit.is_valid(), "{audit:?}");
    audit.regions.iter().map(|r| (r.region, r.volume)).collect()
}

#[test]
fn a_shaken_lattice_is_healed() {
    let mesh = shaken(lattice([8; 3], 1.0, |_| 1), 0.28, 7);
    assert!(quality_report(&mesh).all.min_dihedral.min < 1.0);
    let improved = improved(mesh, None, &Options::default());
    let after = &improved.report.after.all;
    assert_eq!(after.inverted, 0);
    assert!((after.volume - 512.0).abs() < 1e-9);
    assert!(after.min_dihedral.min >= 20.0 && improved.report.converged);
    assert_eq!(improved.report.unmet.counts, []);
}

#[test]
fn a_report_has_all_measures_of_every_element() {
    let (mesh, _) = ball_in_box(8, 1.0, 2.6);
    let report = quality_report(&mesh);
    let of = |value: fn([Point3; 4]) -> f64| -> Vec<f64> {
        (0..mesh.tets().len())
            .map(|t| value(mesh.corners(t)))
            .collect()
    };
    let (radii, aspects) = (of(radius_ratio), of(aspect_ratio));
    let all = &report.all;
    for (values, spread) in [(&radii, all.radius_ratio), (&aspects, all.aspect_ratio)] {
        let n = values.len() as f64;
        assert_eq!(
            spread.min,
            values.iter().copied().fold(f64::INFINITY, f64::min)
        );
        assert_eq!(spread.max, values.iter().copied().fold(0.0, f64::max));
        assert!((spread.mean - values.iter().sum::<f64>() / n).abs() < 1e-9 * spread.mean);
    }
    let within = |values: &[f64], from: f64, to: f64| {
        let inside = |x: &&f64| (from..to).contains(*x);
        values.iter().filter(inside).count()
    };
    for bin in 0..19 {
        let at = bin as f64;
        let found = (
            all.radius_ratio_histogram[bin],
            all.aspect_ratio_histogram[bin],
        );
        let expected = (
            within(&radii, at / 20.0, (at + 1.0) / 20.0),
            within(&aspects, 1.0 + at / 2.0, 1.5 + at / 2.0),
        );
        assert_eq!(found, expected, "bin {bin}");
    }
    for histogram in [&all.radius_ratio_histogram, &all.aspect_ratio_histogram] {
        assert_eq!(histogram.iter().sum::<usize>(), all.tets);
    }
    let of_regions = report.regions.iter().map(|r| r.1.aspect_ratio.max);
    assert_eq!(of_regions.fold(0.0, f64::max), all.aspect_ratio.max);
}

#[test]
fn bad_angles_are_counted_below_and_above_their_bounds() {
    let mesh = shaken(lattice([8; 3], 1.0, |_| 1), 0.45, 5);
    let angles: Vec<[f64; 2]> = (0..mesh.tets().len())
        .map(|t| tet_quality::measures(mesh.corners(t)))
        .map(|m| [m.min_dihedral, m.max_dihedral])
        .collect();
    let low = [10.0, 15.0, 20.0, 30.0].map(|b| angles.iter().filter(|a| a[0] < b).count());
    let high = [155.0, 165.0].map(|b| angles.iter().filter(|a| a[1] > b).count());
    // Some in each step, so that no other bounds give the same counts.
    assert!(low[0] > 0 && low.windows(2).all(|w| w[0] < w[1]));
    assert!(high[1] > 0 && high[1] < high[0]);
    let all = quality_report(&mesh).all;
    assert_eq!(
        (all.min_dihedral_below, all.max_dihedral_above),
        (low, high)
    );
}

#[test]
fn the_reserve_is_what_the_passes_aim_at() {
    let mesh = shaken(lattice([6; 3], 1.0, |_| 1), 0.25, 3);
    for goals in [
        Goals::default(),
        Goals {
            min_dihedral: 12.0,
            joe_liu: 0.4,
            ..Goals::default()
        },
    ] {
        let (reserve, target) = (goals.reserve(), goals.objective());
        assert!((reserve.objective() - target).abs() < 1e-12);
        assert!(reserve.min_dihedral >= goals.min_dihedral && reserve.joe_liu >= goals.joe_liu);
        assert!(reserve.max_dihedral <= goals.max_dihedral);
        let (mut met, mut missed) = (0, 0);
        for t in 0..mesh.tets().len() {
            let corners = mesh.corners(t);
            let measures = measures(corners);
            if measures.edge_ratio > goals.edge_ratio || (quality(corners) - target).abs() < 1e-9 {
                continue;
            }
            assert_eq!(reserve.met_by(&measures), quality(corners) > target, "{t}");
            *if quality(corners) > target {
                &mut met
            } else {
                &mut missed
            } += 1;
        }
        assert!(met > 100 && missed > 10, "{met} {missed}");
    }
}

#[test]
fn a_ball_in_a_box_is_healed() {
    let (mesh, ball) = ball_in_box(12, 1.0, 4.3);
    let faces = mesh.interfaces().len();
    let improved = improved(mesh, Some(&ball), &Options::default());
    let report = &improved.report;
    let (before, after) = (&report.before.all, &report.after.all);
    assert!((after.volume - 1728.0).abs() < 1e-9);
    assert!(before.min_dihedral.min < 1.0);
    assert!(report.converged, "{:?}", report.unmet.counts);
    assert_eq!(report.after, quality_report(&improved.mesh));
    // The sphere is where it was, and whole.
    let surface = SurfaceAudit::of(&improved.mesh.region_surface(1));
    assert!(surface.is_closed_manifold() && surface.euler_characteristic() == 2);
    // Its triangles are inscribed, with edges of a third of the radius.
    let share = surface.volume() / (4.0 / 3.0 * std::f64::consts::PI * 4.3f64.powi(3));
    assert!((0.85..1.0).contains(&share), "{share}");
    let fit = &report.surface;
    assert!(fit.vertices > 100 && fit.far == 0, "{fit:?}");
    assert_eq!(fit.far.min(100), fit.farthest.len());
    assert!(improved.mesh.interfaces().len() < 2 * faces);
    let volumes = sound(&improved.mesh);
    assert!((volumes.iter().map(|v| v.1).sum::<f64>() - 1728.0).abs() < 1e-9);
}

#[test]
fn a_good_mesh_stays_untouched() {
    let (mesh, ball) = ball_in_box(10, 1.0, 3.3);
    let good = improved(mesh, Some(&ball), &Options::default()).mesh;
    let relaxed = Options {
        goals: Goals {
            min_dihedral: 15.0,
            max_dihedral: 165.0,
            joe_liu: 0.2,
            ..Goals::default()
        },
        ..Options::default()
    };
    let again = improved(good.clone(), Some(&ball), &relaxed);
    assert_eq!(again.mesh, good);
    assert!(again.report.passes.is_empty() && again.report.converged);
    let nothing = Options {
        passes: 0,
        ..Options::default()
    };
    let bad = ball_in_box(8, 1.0, 2.6).0;
    assert_eq!(improved(bad.clone(), None, &nothing).mesh, bad);
}

#[test]
fn an_empty_mesh_is_an_empty_result() {
    let empty = TetMesh::new(Vec::new(), Vec::new()).unwrap();
    let improved = improved(empty.clone(), None, &Options::default());
    assert_eq!(improved.mesh, empty);
    assert!(improved.report.converged && improved.report.after.all.tets == 0);
    // Vertices without tetrahedra stay.
    let points = TetMesh::new(vec![Point3::origin(); 3], Vec::new()).unwrap();
    let again = improve(points.clone(), None, &Options::default(), Run::on(&Cpu)).unwrap();
    assert_eq!(again.mesh, points);
}

#[test]
fn box_faces_stay_plane_and_edges_straight() {
    let (mesh, ball) = ball_in_box(10, 0.7, 2.3);
    let mesh = shaken(mesh, 0.1, 5);
    let side = 7.0;
    let improved = improved(mesh, Some(&ball), &Options::default());
    for (x, kind) in improved.mesh.positions().iter().zip(improved.mesh.kinds()) {
        let off = |c: f64| c.abs().min((c - side).abs());
        match *kind {
            VertexKind::BoxFace { axis } => assert!(off(x[usize::from(axis)]) < 1e-12),
            VertexKind::BoxEdge { axis } => {
                let others = (0..3).filter(|&a| a != usize::from(axis));
                assert!(others.into_iter().all(|a| off(x[a]) < 1e-12));
            }
            _ => {}
        }
    }
    assert!((improved.report.after.all.volume - side.powi(3)).abs() < 1e-9);
    assert!(improved.report.converged);
}

#[test]
fn plane_and_cornered_interfaces_keep_their_shape_without_a_field() {
    // Three materials that meet along lines and in points.
    let region = |p: &Point3| -> Region {
        match (p.x < 2.0, p.y < 3.0, p.z < 3.0) {
            (true, _, _) => 1,
            (false, true, _) => 2,
            (false, false, true) => 3,
            (false, false, false) => 0,
        }
    };
    let mesh = shaken(lattice([6; 3], 1.0, region), 0.25, 11);
    let before = sound(&mesh);
    let improved = improved(mesh, None, &Options::default());
    let after = sound(&improved.mesh);
    assert_eq!(before.len(), after.len());
    for (b, a) in before.iter().zip(&after) {
        assert!(b.0 == a.0 && (b.1 - a.1).abs() < 1e-9, "{b:?} {a:?}");
    }
    assert!(!improved.report.junctions.is_empty());
    assert!(improved.report.after.all.min_dihedral.min >= 20.0);
}

#[test]
fn each_operation_can_be_switched_off_and_does_something() {
    let (mesh, ball) = ball_in_box(8, 1.0, 2.6);
    let none = Operations {
        swap: false,
        flip: false,
        contract: false,
        insert: false,
    };
    let run = |operations| {
        let options = Options {
            operations,
            passes: 6,
            ..Options::default()
        };
        let report = improved(mesh.clone(), Some(&ball), &options).report;
        let sum = |count: fn(&tet_quality::Pass) -> usize| -> usize {
            report.passes.iter().map(count).sum()
        };
        [
            sum(|p| p.edges_removed + p.faces_swapped),
            sum(|p| p.surface_flips),
            sum(|p| p.contracted),
            sum(|p| p.inserted),
        ]
    };
    assert_eq!(run(none), [0; 4]);
    for (i, operations) in [
        Operations { swap: true, ..none },
        Operations { flip: true, ..none },
        Operations {
            contract: true,
            ..none
        },
        Operations {
            insert: true,
            ..none
        },
    ]
    .into_iter()
    .enumerate()
    {
        let counts = run(operations);
        for (j, count) in counts.into_iter().enumerate() {
            assert_eq!(count > 0, i == j, "{operations:?}: {counts:?}");
        }
    }
}

#[test]
fn fixed_surfaces_do_not_move() {
    let (mesh, ball) = ball_in_box(10, 1.0, 3.3);
    let options = Options {
        surface: SurfaceMotion::Fixed,
        ..Options::default()
    };
    let on = |mesh: &TetMesh| -> Vec<Point3> {
        let pairs = mesh.positions().iter().zip(mesh.kinds());
        pairs
            .filter(|p| *p.1 == VertexKind::Surface)
            .map(|p| *p.0)
            .collect()
    };
    let improved = improved(mesh.clone(), Some(&ball), &options);
    assert_eq!(on(&improved.mesh), on(&mesh));
    assert!(
        improved
            .report
            .passes
            .iter()
            .all(|p| p.slid == 0 && p.projected == 0)
    );
}

#[test]
fn vertices_slide_along_the_surface_of_a_mesh_of_which_nothing_else_is_known() {
    // A box with a ball cut out, by dual contouring, as from a file: regions and nothing else.
    let ball = Ball {
        center: Point3::new(0.1, 0.2, 0.3),
        radius: 4.3,
    };
    let lattice = Lattice {
        origin: Point3::new(-8.0, -8.0, -8.0),
        spacing: 1.0,
        counts: [17; 3],
    };
    let value = |i: usize| ball.value(&lattice.point(lattice.coordinates(i))) as f32;
    let grid = ScalarGrid::new(lattice, (0..lattice.len()).map(value).collect()).unwrap();
    let contour = dual_contour::Options {
        method: dual_contour::Method::DualContour,
        region: dual_contour::Extent::Exterior,
        ..Default::default()
    };
    let made = dual_contour::volume(&grid, Some(&ball), &contour, Run::on(&Cpu)).unwrap();
    let (positions, tets, regions, _) = made.mesh.into_parts();
    let mesh = TetMesh::with_regions(positions, tets, regions).unwrap();
    let along = Options {
        surface: SurfaceMotion::AlongInput,
        ..Options::default()
    };
    let [stays, slides] =
        [&Options::default(), &along].map(|options| improved(mesh.clone(), None, options));
    let worst = |i: &Improved| i.report.after.all.min_dihedral.min;
    assert!(worst(&stays) < 20.0 && !stays.report.converged);
    assert!(slides.report.converged, "{:?}", slides.report.unmet);
    // What stays is exact; what slides is near: to the input and to the ball it stands for.
    let volume = |i: &Improved| i.report.after.all.volume;
    assert!((volume(&stays) - stays.report.before.all.volume).abs() < 1e-9);
    let change = volume(&slides) / volume(&stays) - 1.0;
    assert!(change.abs() < 3e-3, "{change}");
    let fit = &slides.report.surface;
    assert!(fit.vertices > 100 && fit.far == 0, "{fit:?}");
    let bounds = |mesh: &TetMesh| Aabb::of_points(mesh.positions());
    assert_eq!(bounds(&slides.mesh), bounds(&mesh));
    for face in slides.mesh.interfaces() {
        for v in face.triangle {
            let x = slides.mesh.positions()[v as usize];
            let off = (x - ball.center).norm() - ball.radius;
            let plane = bounds(&mesh);
            let on_box = (0..3).any(|k| x[k] == plane.min[k] || x[k] == plane.max[k]);
            assert!(on_box || off.abs() < 0.2, "{x}: {off}");
        }
    }
    sound(&slides.mesh);
    // With a field there is something better to follow.
    let refused = improve(mesh, Some(&ball), &along, Run::on(&Cpu)).unwrap_err();
    assert!(matches!(refused, Error::Option(o) if o.option == "surface"));
}

#[test]
fn the_averaged_flow_takes_noise_and_keeps_the_volume() {
    let (mesh, ball) = ball_in_box(11, 1.0, 3.7);
    let mesh = improved(mesh, Some(&ball), &Options::default()).mesh;
    let mut noise = noise(9);
    let noisy = moved(mesh, |_, kind, x| match kind {
        VertexKind::Surface => {
            let d = (x - ball.center).normalize();
            x + d * (0.12 * noise())
        }
        _ => x,
    });
    let roughness = |mesh: &TetMesh| {
        let radii: Vec<f64> = mesh
            .positions()
            .iter()
            .zip(mesh.kinds())
            .filter(|p| *p.1 == VertexKind::Surface)
            .map(|p| (p.0 - ball.center).norm())
            .collect();
        let mean = radii.iter().sum::<f64>() / radii.len() as f64;
        (radii.iter().map(|r| (r - mean).powi(2)).sum::<f64>() / radii.len() as f64).sqrt()
    };
    let inner = |mesh: &TetMesh| sound(mesh).iter().find(|r| r.0 == 1).unwrap().1;
    // Without the field nothing but the flow moves the surface.
    let options = Options {
        surface: SurfaceMotion::AveragedMeanCurvature {
            steps: 20,
            step: 0.05,
        },
        operations: Operations {
            flip: false,
            contract: false,
            ..Operations::default()
        },
        ..Options::default()
    };
    let flowed = improved(noisy.clone(), None, &options);
    assert!(flowed.report.flowed > 1000);
    assert!(
        roughness(&flowed.mesh) < 0.5 * roughness(&noisy),
        "{} {}",
        roughness(&flowed.mesh),
        roughness(&noisy)
    );
    assert!((inner(&flowed.mesh) / inner(&noisy) - 1.0).abs() < 0.01);
    // With it, the vertices end on the isosurface.
    let free = Options {
        operations: Operations::default(),
        ..options
    };
    let back = improved(noisy, Some(&ball), &free);
    assert!(back.report.flowed > 1000);
    assert_eq!(back.report.surface.far, 0);
}

#[test]
fn inverted_elements_are_untangled() {
    let mesh = lattice([7; 3], 1.0, |_| 1);
    for (amount, seed) in [(0.45, 1), (0.6, 2), (0.8, 3)] {
        let tangled = shaken(mesh.clone(), amount, seed);
        let inverted = quality_report(&tangled).all.inverted;
        assert!(inverted > 0);
        let improved = improved(tangled.clone(), None, &Options::default());
        assert_eq!(improved.report.untangled, inverted);
        assert_eq!(improved.report.after.all.inverted, 0);
        assert!(improved.report.after.all.min_dihedral.min >= 20.0);
        assert!((improved.report.after.all.volume - 343.0).abs() < 1e-9);
        let off = Options {
            untangle: false,
            ..Options::default()
        };
        let Err(Error::StillInverted { elements }) = improve(tangled, None, &off, Run::on(&Cpu))
        else {
            panic!("inverted elements were accepted");
        };
        assert_eq!(elements.len(), inverted);
    }
}

#[test]
fn what_cannot_be_untangled_is_named() {
    // A flat element between fixed vertices.
    let x = [
        [0.0, 0.0, 0.0],
        [1.0, 0.0, 0.0],
        [0.0, 1.0, 0.0],
        [1.0, 1.0, 0.0],
        [0.3, 0.3, 1.0],
    ];
    let mesh = TetMesh::new(
        x.map(Point3::from).to_vec(),
        vec![[0, 1, 2, 4], [1, 3, 2, 0]],
    )
    .unwrap();
    let error = improve(mesh, None, &Options::default(), Run::on(&Cpu)).unwrap_err();
    assert_eq!(error, Error::StillInverted { elements: vec![1] });
    assert!(error.to_string().contains("the first is 1"));
}

#[test]
fn overlaps_are_named() {
    let p = |x, y, z| Point3::new(x, y, z);
    let x = vec![
        p(0.0, 0.0, 0.0),
        p(1.0, 0.0, 0.0),
        p(0.0, 1.0, 0.0),
        p(0.0, 0.0, 1.0),
        p(0.0, 0.0, -1.0),
        p(0.2, 0.2, 2.0),
    ];
    let three = TetMesh::new(x.clone(), vec![[0, 1, 2, 3], [0, 2, 1, 4], [0, 1, 2, 5]]).unwrap();
    let error = improve(three, None, &Options::default(), Run::on(&Cpu)).unwrap_err();
    assert!(
        matches!(error, Error::NonManifoldFace { element: 2, .. }),
        "{error}"
    );
    // The same element twice.
    let twice = TetMesh::new(x, vec![[0, 1, 2, 3], [0, 1, 2, 3]]).unwrap();
    let error = improve(twice, None, &Options::default(), Run::on(&Cpu)).unwrap_err();
    assert!(
        matches!(
            error,
            Error::StillInverted { .. } | Error::NotOrientable { .. }
        ),
        "{error}"
    );
}

#[test]
fn corners_in_any_order_are_oriented_alike() {
    let mesh = shaken(lattice([5; 3], 1.0, |_| 1), 0.2, 3);
    let expected = improved(mesh.clone(), None, &Options::default())
        .report
        .after
        .all;
    let (x, mut tets, regions, kinds) = mesh.into_parts();
    for tet in tets.iter_mut().step_by(3) {
        tet.swap(1, 2);
    }
    let mesh = TetMesh::with_kinds(x, tets, regions, kinds).unwrap();
    let again = improved(mesh, None, &Options::default());
    assert!(again.report.reoriented > 0 && again.report.converged);
    assert_eq!(
        again.report.after.all.volume.round(),
        expected.volume.round()
    );
}

/// A ball of tetrahedra: `n` triangles of a fan around each pole, so that the poles have valence `n`.
fn spindle(n: usize) -> TetMesh {
    let mut x = vec![Point3::new(0.0, 0.0, -2.0), Point3::new(0.0, 0.0, 2.0)];
    for i in 0..n {
        let angle = std::f64::consts::TAU * i as f64 / n as f64;
        x.push(Point3::new(angle.cos(), angle.sin(), 0.0));
    }
    let tets = (0..n)
        .map(|i| [0, 1, 2 + i as u32, 2 + ((i + 1) % n) as u32])
        .collect();
    TetMesh::new(x, tets).unwrap()
}

#[test]
fn adversaries_end_in_improvement_or_a_named_element() {
    // A vertex of valence 100, whose surface forbids good elements.
    let mesh = spindle(100);
    let before = worst(&mesh);
    let result = improved(mesh.clone(), None, &Options::default());
    assert!(worst(&result.mesh) >= before && result.report.after.all.inverted == 0);
    assert!(!result.report.converged);
    let causes = &result.report.unmet.counts;
    assert!(causes.iter().any(|c| c.0 == Cause::Boundary), "{causes:?}");
    let outside: f64 = result.report.after.all.volume;
    assert!((outside - quality_report(&mesh).all.volume).abs() < 1e-9);

    // Needles, caps and slivers inside: a lattice squeezed near one vertex.
    let squeezed = moved(lattice([6; 3], 1.0, |_| 1), |_, kind, x| {
        let middle = Point3::new(3.0, 3.0, 3.0);
        match kind {
            VertexKind::Interior => middle + (x - middle) * 0.02,
            _ => x,
        }
    });
    let before = worst(&squeezed);
    let result = improved(squeezed, None, &Options::default());
    assert!(
        before < 0.05 && result.report.converged,
        "{:?}",
        result.report.after.all.min_dihedral
    );

    // Two vertices at one place, joined by an edge: flat elements.
    let doubled = lattice([5; 3], 1.0, |_| 1);
    let interior: Vec<usize> = (0..doubled.positions().len())
        .filter(|&v| doubled.kinds()[v] == VertexKind::Interior)
        .collect();
    let tet = doubled
        .tets()
        .iter()
        .find(|t| {
            t.iter()
                .filter(|&&v| interior.contains(&(v as usize)))
                .count()
                >= 2
        })
        .unwrap();
    let pair: Vec<u32> = tet
        .iter()
        .copied()
        .filter(|&v| interior.contains(&(v as usize)))
        .take(2)
        .collect();
    let target = doubled.positions()[pair[0] as usize];
    let doubled = moved(
        doubled,
        |v, _, x| if v == pair[1] as usize { target } else { x },
    );
    assert!(quality_report(&doubled).all.inverted > 0);
    let result = improved(doubled, None, &Options::default());
    assert!(result.report.converged && result.report.untangled > 0);
}

#[test]
fn regions_that_touch_in_a_vertex_stay_whole() {
    // Two cubes of region 1 that share one corner only.
    let region = |p: &Point3| {
        let low = [p.x, p.y, p.z].iter().all(|c| (1.0..3.0).contains(c));
        let high = [p.x, p.y, p.z].iter().all(|c| (3.0..5.0).contains(c));
        Region::from(low || high)
    };
    let mesh = shaken(lattice([6; 3], 1.0, region), 0.2, 4);
    let touching = mesh
        .positions()
        .iter()
        .position(|x| *x == Point3::new(3.0, 3.0, 3.0))
        .unwrap() as u32;
    let result = improved(mesh, None, &Options::default());
    assert!(result.report.junctions.contains(&touching));
    let volumes = sound(&result.mesh);
    assert!((volumes[1].1 - 16.0).abs() < 1e-9 && (volumes[0].1 - 200.0).abs() < 1e-9);
    assert!(
        result
            .mesh
            .positions()
            .contains(&Point3::new(3.0, 3.0, 3.0))
    );
}

#[test]
fn the_boundary_that_forbids_is_told_from_the_rest() {
    // A wedge of 8°: no elements in its edge can have more.
    let angle = 8f64.to_radians();
    let x = [
        [0.0, 0.0, 0.0],
        [0.0, 0.0, 1.0],
        [1.0, 0.0, 0.5],
        [angle.cos(), angle.sin(), 0.5],
    ];
    let mesh = TetMesh::new(x.map(Point3::from).to_vec(), vec![[0, 1, 2, 3]]).unwrap();
    let result = improved(mesh.clone(), None, &Options::default());
    assert_eq!(result.mesh, mesh);
    assert_eq!(result.report.unmet.counts, [(Cause::Boundary, 1)]);
    assert_eq!(result.report.unmet.worst[0].element.tet, 0);

    // A wedge of 19.5° that two share: the wider one, whose own triangles allow the goals, cannot have
    // more either.
    let outer = |degrees: f64| {
        let angle = degrees.to_radians();
        Point3::new(angle.cos(), angle.sin(), 0.5)
    };
    let mut x = mesh.positions()[..2].to_vec();
    x.extend([outer(0.0), outer(14.5), outer(19.5)]);
    let mesh = TetMesh::new(x, vec![[0, 1, 2, 3], [0, 1, 3, 4]]).unwrap();
    let result = improved(mesh.clone(), None, &Options::default());
    assert_eq!(result.mesh, mesh);
    assert_eq!(result.report.unmet.counts, [(Cause::Boundary, 2)]);

    // An interface that ends on the boundary, and leaves 8° on one side.
    let mut x = mesh.positions()[..2].to_vec();
    x.extend([outer(0.0), outer(8.0), outer(58.0)]);
    let mesh = TetMesh::with_regions(x, vec![[0, 1, 2, 3], [0, 1, 3, 4]], vec![1, 2]).unwrap();
    let result = improved(mesh.clone(), None, &Options::default());
    assert_eq!(result.mesh, mesh);
    assert_eq!(result.report.unmet.counts, [(Cause::Boundary, 1)]);
}

#[test]
fn what_a_ragged_boundary_forbids_is_named_with_what_lies_beside() {
    // A cube whose boundary is far from plane, so that it stays as it is; two neighbours in each of
    // its faces nearly touch.
    let close = |x: Point3| match x.coords.as_slice() {
        [2.0, 2.0, z] if *z == 0.0 || *z == 6.0 => x + Vector3::x() * 0.85,
        [2.0, y, 2.0] if *y == 0.0 || *y == 6.0 => x + Vector3::z() * 0.85,
        [x0, 2.0, 2.0] if *x0 == 0.0 || *x0 == 6.0 => x + Vector3::y() * 0.85,
        _ => x,
    };
    let ragged = moved(lattice([6; 3], 1.0, |_| 1), |v, kind, x| match kind {
        VertexKind::Interior => x,
        _ => {
            let part = |k: usize| ((v * (2 * k + 7) * 7919 + 13) % 101) as f64 / 101.0 - 0.5;
            close(x) + Vector3::new(part(0), part(1), part(2)) * 0.3
        }
    });
    // No box: what is not plane stays.
    let (x, tets, ..) = ragged.into_parts();
    let ragged = TetMesh::new(x, tets).unwrap();
    let result = improved(ragged, None, &Options::default());
    let unmet = &result.report.unmet;
    assert!(!result.report.converged);
    let causes: Vec<Cause> = unmet.counts.iter().map(|c| c.0).collect();
    assert_eq!(causes, [Cause::Boundary, Cause::Beside]);
    // Each of the latter shares a corner with one of the former.
    let of = |cause: Cause| {
        let named = unmet.worst.iter().filter(move |e| e.cause == cause);
        named.map(|e| result.mesh.tets()[e.element.tet as usize])
    };
    for tet in of(Cause::Beside) {
        assert!(of(Cause::Boundary).any(|o| o.iter().any(|v| tet.contains(v))));
    }
}

#[test]
fn options_out_of_range_are_refused() {
    let check = |change: fn(&mut Options)| {
        let mut options = Options::default();
        change(&mut options);
        let error = options.check().unwrap_err();
        assert_eq!(Error::from(error.clone()), Error::Option(error.clone()));
        error.to_string()
    };
    assert!(check(|o| o.goals.min_dihedral = 71.0).contains("goals.min_dihedral"));
    assert!(check(|o| o.goals.max_dihedral = f64::NAN).contains("goals.max_dihedral"));
    assert!(check(|o| o.goals.joe_liu = -0.1).contains("goals.joe_liu"));
    assert!(check(|o| o.goals.edge_ratio = 1.0).contains("goals.edge_ratio"));
    assert!(check(|o| o.level = f64::INFINITY).contains("level"));
    assert!(check(|o| o.spacing = Some(0.0)).contains("spacing"));
    assert!(check(|o| o.deviation = 2.0).contains("deviation"));
    assert!(
        check(|o| o.surface = SurfaceMotion::AveragedMeanCurvature {
            steps: 1,
            step: 0.5
        })
        .contains("step")
    );
}

/// A plane between two regions outside of a ball passes near it: its vertices are not the ball's, and stay in the plane.
/// Those near the ball were drawn onto it.
#[test]
fn a_plane_beside_the_isosurface_stays_plane() {
    let (mesh, ball) = ball_in_box(12, 1.0, 3.6);
    let (positions, tets, mut regions, mut kinds) = mesh.into_parts();
    let height = |z: f64| z - 11.0;
    for (tet, region) in tets.iter().zip(&mut regions) {
        let middle = tet.iter().map(|&v| positions[v as usize].z).sum::<f64>() / 4.0;
        if *region == 0 && height(middle) > 0.0 {
            *region = 2;
        }
    }
    // What is inside of the box slides along its interface.
    let is_on_plane = |x: &Point3| height(x.z) == 0.0;
    for (x, kind) in positions.iter().zip(&mut kinds) {
        if is_on_plane(x) && *kind == VertexKind::Interior {
            *kind = VertexKind::Surface;
        } else if is_on_plane(x) {
            *kind = VertexKind::Fixed;
        }
    }
    let mesh = TetMesh::with_kinds(positions, tets, regions, kinds).unwrap();
    let options = Options {
        level: 1.0,
        ..Options::default()
    };
    let better = improved(mesh, Some(&ball), &options).mesh;
    let mut met = 0;
    for face in better.interfaces() {
        if [face.inside, face.outside] == [0, 2] || [face.inside, face.outside] == [2, 0] {
            met += 1;
            for v in face.triangle {
                let z = better.positions()[v as usize].z;
                assert!(height(z).abs() < 1e-9, "{z}");
            }
        }
    }
    assert!(met > 100, "{met}");
}

/// Where the plane of a wall meets the isosurface, vertices come to lie on both, for any number of threads, though the mesh
/// that comes in has them off the plane. Regions keep their topology, and no angle gets worse.
#[test]
fn vertices_where_a_plane_meets_the_isosurface_lie_on_both() {
    const HEIGHT: f64 = 8.0;
    let (mesh, ball) = ball_in_box(12, 1.0, 3.5);
    let (positions, tets, mut regions, mut kinds) = mesh.into_parts();
    // The same lattice, before vertices of the ball moved.
    let above = lattice([12; 3], 1.0, |x| Region::from(x.z > HEIGHT));
    for (region, above) in regions.iter_mut().zip(above.regions()) {
        if *region == 0 && *above == 1 {
            *region = 2;
        }
    }
    for (x, kind) in positions.iter().zip(&mut kinds) {
        *kind = match *kind {
            kind if x.z != HEIGHT => kind,
            VertexKind::Interior | VertexKind::Surface => VertexKind::Surface,
            _ => VertexKind::Fixed,
        };
    }
    let mesh = TetMesh::with_kinds(positions, tets, regions, kinds).unwrap();
    let off = |met: &[Point3]| {
        let heights = met.iter().map(|x| (x.z - HEIGHT).abs());
        heights.fold(0.0, f64::max)
    };
    let before = where_three_meet(&mesh);
    assert!(before.len() >= 20 && off(&before) > 0.3);
    let better = same_on_any_threads(|| improved(mesh.clone(), Some(&ball), &Options::default()));
    sound(&better.mesh);
    assert!(better.report.converged, "{:?}", better.report.unmet);
    assert!(worst(&better.mesh) > worst(&mesh));
    let after = where_three_meet(&better.mesh);
    assert!(after.len() > 10 && off(&after) < 1e-6, "{}", off(&after));
    for x in &after {
        let distance = (x - ball.center).norm() - ball.radius;
        // Cells have the length 1.
        assert!(distance.abs() <= Options::default().deviation, "{distance}");
    }
}

/// The vertices in which regions 0, 1 and 2 meet.
fn where_three_meet(mesh: &TetMesh) -> Vec<Point3> {
    let mut met = vec![0u8; mesh.positions().len()];
    for (tet, region) in mesh.tets().iter().zip(mesh.regions()) {
        tet.iter().for_each(|&v| met[v as usize] |= 1 << region);
    }
    let all = mesh.positions().iter().zip(met);
    all.filter(|m| m.1 == 0b111).map(|(x, _)| *x).collect()
}

/// Of an exterior alone both of its boundaries part it from the outside, and the field knows of one.
#[test]
fn an_outer_sphere_is_no_isosurface() {
    let mesh = geom_core::mesh::shapes::shell(1.0, 3.0, 4);
    let field = Ball {
        center: Point3::origin(),
        radius: 1.0,
    };
    // Off the field enough to be moved, so that it is the field that is followed.
    let mesh = moved(
        mesh,
        |_, _, p| if p.coords.norm() < 1.01 { p * 1.05 } else { p },
    );
    let options = Options {
        level: 1.0,
        ..Options::default()
    };
    let better = improved(mesh, Some(&field), &options).mesh;
    let radii = better.interfaces();
    let radii = radii.iter().flat_map(|face| face.triangle);
    let (mut inner, mut outer) = (0, 0);
    for r in radii.map(|v| better.positions()[v as usize].coords.norm()) {
        match r < 2.0 {
            true => {
                inner += 1;
                assert!((r - 1.0).abs() < 0.02, "{r}");
            }
            false => {
                outer += 1;
                assert!((r - 3.0).abs() < 1e-9, "{r}");
            }
        }
    }
    assert!(inner > 300 && outer > 300, "{inner} {outer}");
}

#[test]
fn a_field_that_is_not_finite_is_named() {
    struct Hole;
    impl ImplicitField for Hole {
        fn value(&self, _: &Point3) -> f64 {
            f64::NAN
        }
        fn value_gradient(&self, _: &Point3) -> (f64, Vector3) {
            (f64::NAN, Vector3::zeros())
        }
    }
    let (mesh, _) = ball_in_box(8, 1.0, 2.6);
    let error = improve(mesh, Some(&Hole), &Options::default(), Run::on(&Cpu)).unwrap_err();
    assert!(matches!(error, Error::FieldNotFinite { .. }));
}

proptest! {
    #![proptest_config(geom_core::testing::cases(16))]

    /// Noise on a lattice: with no field there is nothing to project to, and no pass makes the worst
    /// element worse.
    #[test]
    fn the_worst_never_gets_worse(seed: u64, amount in 0.0..0.3, seam in 1.0..4.0) {
        let mesh = shaken(lattice([5; 3], 1.0, |p| Region::from(p.x > seam)), amount, seed);
        prop_assume!(quality_report(&mesh).all.inverted == 0);
        let volumes = sound(&mesh);
        let mut last = worst(&mesh);
        let improved = improved(mesh, None, &Options { seed, ..Options::default() });
        for pass in &improved.report.passes {
            prop_assert!(pass.worst >= last);
            last = pass.worst;
        }
        prop_assert!((worst(&improved.mesh) - last).abs() < 1e-15);
        for (b, a) in volumes.iter().zip(sound(&improved.mesh)) {
            prop_assert!((b.1 - a.1).abs() < 1e-9 && b.0 != OUTSIDE);
        }
    }

    /// Joe–Liu bounds the edge ratio, and the bound is reached.
    #[test]
    fn joe_liu_bounds_the_edge_ratio(
        p in prop::array::uniform4(prop::array::uniform3(-1.0..1.0f64)), s in 0.01..1.0f64,
    ) {
        let [a, b, c, d] = p.map(Point3::from);
        // The shorter a side, the closer such shapes come to the bound.
        for corners in [[a, b, c, d], [a, a + (b - a) * s, c, d]] {
            let m = tet_quality::measures(corners);
            prop_assert!(m.joe_liu.abs() <= Goals::joe_liu_for_edge_ratio(m.edge_ratio) * (1.0 + 1e-9));
        }
        // Edges s and 1 across each other, the four others equal, at the best distance.
        let h = 0.5 * (1.0 + s * s).sqrt();
        let best = tet_quality::measures([
            Point3::new(-s / 2.0, 0.0, 0.0), Point3::new(s / 2.0, 0.0, 0.0),
            Point3::new(0.0, -0.5, h), Point3::new(0.0, 0.5, h),
        ]);
        let bound = Goals::joe_liu_for_edge_ratio(best.edge_ratio);
        prop_assert!((best.joe_liu.abs() - bound).abs() <= 1e-12, "{} {bound}", best.joe_liu);
    }

    /// Memory that is used again is what new memory would be, whether it was longer or shorter.
    #[test]
    fn used_memory_does_not_matter(seed: u64, length in 0usize..4000) {
        let mesh = shaken(lattice([4; 3], 1.0, |_| 1), 0.2, seed);
        let mut reference = Vec::new();
        Cpu.measure(mesh.positions(), mesh.tets(), &mut reference).unwrap();
        let mut again = vec![reference[0]; length];
        Cpu.measure(mesh.positions(), mesh.tets(), &mut again).unwrap();
        prop_assert_eq!(again, reference);
    }

    /// The measures do not depend on place, turn, mirror pair and size.
    #[test]
    fn measures_are_functions_of_the_shape(
        p in prop::array::uniform4(prop::array::uniform3(-1.0..1.0f64)),
        axis in prop::array::uniform3(-1.0..1.0f64), angle in 0.0..6.0, scale in 1e-6..1e6, shift in -1e3..1e3,
    ) {
        let corners = p.map(Point3::from);
        let m = tet_quality::measures(corners);
        prop_assume!(m.joe_liu.abs() > 1e-3);
        let turn = geom_core::nalgebra::Rotation3::new(Vector3::from(axis) * angle);
        let image = corners.map(|c| (turn * c + Vector3::repeat(shift)) * scale);
        let i = tet_quality::measures(image);
        let close = |a: f64, b: f64| (a - b).abs() <= 1e-6 * a.abs().max(1.0);
        prop_assert!(close(m.joe_liu, i.joe_liu) && close(m.edge_ratio, i.edge_ratio));
        prop_assert!(close(m.min_dihedral, i.min_dihedral) && close(m.max_dihedral, i.max_dihedral));
        prop_assert!(close(m.six_volume, i.six_volume / scale.powi(3)));
        let [a, b, c, d] = corners;
        prop_assert!(close(m.joe_liu, tet_quality::measures([b, c, a, d]).joe_liu));
        prop_assert!(close(m.joe_liu, -tet_quality::measures([b, a, c, d]).joe_liu));
    }
}
