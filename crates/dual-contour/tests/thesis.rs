//! How near the surface is, and how cells grow: what section 3.3 of the thesis and its sources promise.

use crate::common::*;
use dual_contour::geom_core::{Cpu, ImplicitField, LatticeValues, Point3, Run, Vector3};
use dual_contour::{ErrorNorm, Extent, Method, Options, Outer, Placement, Zone, surface, volume};

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
        // Stuffing leaves a few cuts off the surface where snapping is not safe.
        let allowed = if method == Method::Stuffing {
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

/// Large leaves whose points would be clamped on their way to the surface are split instead.
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
