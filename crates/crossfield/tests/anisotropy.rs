//! Quads that are narrower along a gradient (Eqs. 4.11–4.13).

use crossfield::anisotropy::{Adaptation, Anisotropy, Function, Metric, steepest};
use crossfield::field::Frames;
use crossfield::map::{MapOptions, Spacing, parameterize};
use crossfield::quads::Rung;
use crossfield::quads::quality::ratio_along;
use crossfield::testing::plate;
use crossfield::{Error, FieldOptions, Options, Quadrangulation, Size, cross_field, quadrangulate};
use geom_core::mesh::shapes;
use geom_core::surface::laplace::{self, EdgeWeights};
use geom_core::testing::same_on_any_threads;
use geom_core::{Cpu, Point3, Run, TriMesh, Vector3, algebra::eigen};

use crate::laws::obeys;

fn body() -> TriMesh {
    shapes::ellipsoid(Vector3::new(3.0, 1.2, 1.0), 4)
}

fn along(mesh: &TriMesh, f: impl Fn(&Point3) -> f64) -> Anisotropy {
    let values = mesh.positions().iter().map(f).collect();
    Anisotropy::of(Function::Values(values))
}

fn quads(mesh: &TriMesh, size: Size, anisotropy: Anisotropy) -> Quadrangulation {
    let options = Options {
        size,
        anisotropy: Some(anisotropy),
        ..Options::default()
    };
    let made = quadrangulate(mesh, &options, Run::on(&Cpu)).unwrap();
    obeys(&made, mesh);
    made
}

fn median(mut all: Vec<f64>) -> f64 {
    all.sort_by(f64::total_cmp);
    all[all.len() / 2]
}

/// Of the quads where a function is at least so steep, the length along its gradient over that across.
fn ratios(made: &Quadrangulation, mesh: &TriMesh, values: &[f64], from: f64) -> Vec<f64> {
    let gradient = laplace::gradient(mesh, values).unwrap();
    let most = steepest(mesh, &gradient);
    let steep = |q: &usize| gradient[made.origins[*q] as usize].norm() >= from * most;
    (0..made.mesh.quads().len())
        .filter(steep)
        .filter_map(|q| {
            let g = gradient[made.origins[q] as usize];
            ratio_along(&made.mesh.corners(q), &g)
        })
        .collect()
}

/// The first eigenfunction of the body, its map, and where that is steep: the distance of lines along the gradient over that of
/// lines across, and how far, in degrees, the nearest gradient of the map is from that of the function.
fn mapped(ramp: [f64; 2]) -> (Vec<f64>, Vec<f64>) {
    let mesh = body();
    let frames = Frames::of(&mesh, EdgeWeights::One).unwrap();
    let stiffness = laplace::stiffness(&mesh).unwrap();
    let mass = laplace::lumped_mass(&mesh);
    let options = eigen::Options::default();
    let mut pairs = eigen::eigenpairs(&stiffness, &mass, 2, &options, Run::on(&Cpu)).unwrap();
    let mode = pairs.vectors.swap_remove(1);
    let gradient = laplace::gradient(&mesh, &mode).unwrap();
    let most = steepest(&mesh, &gradient);
    let options = Anisotropy {
        ramp,
        ..Anisotropy::of(Function::Mode(1))
    };
    let metric = Metric::of(&mesh, &frames, &mode, most, &options).unwrap();
    let guides: Vec<_> = metric.guides().collect();
    let field = cross_field(&mesh, &guides, &FieldOptions::default(), Run::on(&Cpu)).unwrap();
    let map_options = MapOptions {
        spacing: metric.spacings(&field, 0.4),
        lines: Vec::new(),
    };
    // An error if a single triangle folds.
    let map = parameterize(&mesh, &frames, &field, &map_options, Run::on(&Cpu)).unwrap();
    let (mut ratios, mut off) = (Vec::new(), Vec::new());
    for f in (0..frames.faces()).filter(|&f| gradient[f].norm() > 0.5 * most) {
        let uv = map.coordinates(f);
        let normal = mesh.doubled_area_normal(f);
        let p = mesh.corners(f);
        let slope = |axis: usize| -> Vector3 {
            let of = |k: usize| {
                normal.cross(&(p[(k + 2) % 3] - p[(k + 1) % 3])) * uv[k][axis]
                    / normal.norm_squared()
            };
            (0..3).map(of).sum()
        };
        let g = gradient[f].normalize();
        let (u, v) = (slope(0), slope(1));
        let cosine = |s: &Vector3| s.normalize().dot(&g).abs();
        let (near, far) = if cosine(&u) > cosine(&v) {
            (u, v)
        } else {
            (v, u)
        };
        if gradient[f].norm() > 0.9 * most {
            ratios.push(far.norm() / near.norm());
        }
        off.push(cosine(&near).min(1.0).acos().to_degrees());
    }
    (ratios, off)
}

#[test]
fn lines_on_an_ellipsoid_lie_five_times_closer_along_its_axis() {
    let (ratios, mut ramp) = mapped([0.3, 0.9]);
    let ratio = median(ratios);
    assert!((0.12..0.25).contains(&ratio), "{ratio}");
    let (_, mut step) = mapped([0.5, 0.5]);
    let percentile_95 = |off: &mut Vec<f64>| {
        off.sort_by(f64::total_cmp);
        off[off.len() * 95 / 100]
    };
    let [ramp, step] = [percentile_95(&mut ramp), percentile_95(&mut step)];
    assert!(ramp < 4.5 && ramp < step, "{ramp}, {step}");
}

/// Where F is a coordinate of a plate, quads are rectangles with a closed form: lines along F and across it, or all of them at 45°.
#[test]
fn plates_have_the_rectangles_of_the_equation() {
    let mesh = plate(20, 0.2, |_, _| false);
    let narrow = quads(&mesh, Size::Spacing(0.25), along(&mesh, |p| p.x));
    assert_eq!(narrow.mesh.quads().len(), 80);
    assert_eq!(narrow.report.valences.irregular(), 0);
    for q in 0..80 {
        let ratio = ratio_along(&narrow.mesh.corners(q), &Vector3::x()).unwrap();
        assert!((ratio - 0.2).abs() < 0.02, "{ratio}");
    }
    assert!(narrow.report.scaled_jacobian.min > 0.99);
    let summary = narrow.report.aspect_ratio;
    assert!(
        (summary.median - 5.0).abs() < 0.3 && summary.max < 6.0,
        "{summary:?}"
    );
    // Along the rim, at 45° to a gradient that is not followed: 0.25 √(2 / (1 + 0.2⁻²)) = 0.0693, 1/14 rounded.
    let unguided = Anisotropy {
        weight: 0.0,
        ..along(&mesh, |p| p.x + p.y)
    };
    let diagonal = quads(&mesh, Size::Spacing(0.25), unguided);
    assert_eq!(diagonal.mesh.quads().len(), 14 * 14);
    assert!(diagonal.report.aspect_ratio.max < 1.2);
}

#[test]
fn quads_of_an_ellipsoid_are_narrow_where_it_is_steep() {
    let mesh = body();
    let x: Vec<f64> = mesh.positions().iter().map(|p| p.x).collect();
    for adaptation in [None, Some(Adaptation::default())] {
        let anisotropy = Anisotropy {
            adaptation,
            ..along(&mesh, |p| p.x)
        };
        let made = quads(&mesh, Size::Quads(1200), anisotropy);
        let report = &made.report;
        assert!(report.rung() < Rung::Split, "{:?}", report.parts);
        let share = made.mesh.quads().len() as f64 / 1200.0;
        assert!((share - 1.0).abs() < 0.12, "{share}");
        assert!(
            report.scaled_jacobian.min > 0.3,
            "{:?}",
            report.scaled_jacobian
        );
        let steep = median(ratios(&made, &mesh, &x, 0.9));
        assert!((0.12..0.25).contains(&steep), "{steep}");
        let misalignment = report.parts[0].misalignment.unwrap();
        assert!(
            misalignment.triangles > 500 && misalignment.percentile_95 < 10.0,
            "{misalignment:?}"
        );
        assert_eq!(report.parts[0].adapted > 0, adaptation.is_some());
    }
}

/// The first eigenfunction of an elongated body rises along it; with a ratio of 1 nothing changes.
#[test]
fn modes_are_those_of_the_surface_and_a_ratio_of_one_is_none() {
    let mesh = body();
    let x: Vec<f64> = mesh.positions().iter().map(|p| p.x).collect();
    let made = quads(&mesh, Size::Quads(900), Anisotropy::of(Function::Mode(1)));
    let steep = median(ratios(&made, &mesh, &x, 0.9));
    assert!((0.12..0.3).contains(&steep), "{steep}");
    let square = Anisotropy {
        ratio: 1.0,
        weight: 0.0,
        ..Anisotropy::of(Function::Mode(1))
    };
    let square = quads(&mesh, Size::Spacing(0.2), square);
    let options = Options {
        size: Size::Spacing(0.2),
        ..Options::default()
    };
    let plain = quadrangulate(&mesh, &options, Run::on(&Cpu)).unwrap();
    assert!(square.mesh == plain.mesh);
}

/// Many triangles go through a coarser copy; the function is carried there.
#[test]
fn functions_go_with_remeshed_copies_and_parts() {
    let fine = shapes::ellipsoid(Vector3::new(2.0, 1.0, 1.0), 5);
    let x: Vec<f64> = fine.positions().iter().map(|p| p.x).collect();
    let made = quads(&fine, Size::Quads(300), along(&fine, |p| p.x));
    let steep = median(ratios(&made, &fine, &x, 0.9));
    assert!(steep < 0.4, "{steep}");
    // Of two parts the one where the function is flat has squares.
    let (mut positions, mut triangles) = body().into_parts();
    let first = positions.len() as u32;
    let (others, more) = shapes::icosphere(1.0, 3).into_parts();
    positions.extend(others.iter().map(|p| p + Vector3::new(0.0, 9.0, 0.0)));
    triangles.extend(more.iter().map(|t| t.map(|v| v + first)));
    let both = TriMesh::new(positions, triangles).unwrap();
    let made = quads(
        &both,
        Size::Spacing(0.5),
        along(&both, |p| if p.y < 5.0 { p.x } else { 0.0 }),
    );
    assert_eq!(made.report.parts.len(), 2);
    let first = made.report.parts[0].quads;
    let aspects = |range: std::ops::Range<usize>| {
        let of = |q| crossfield::quads::quality::aspect_ratio(&made.mesh.corners(q));
        median(range.map(of).collect())
    };
    assert!(aspects(0..first) > 2.0);
    assert!(aspects(first..made.mesh.quads().len()) < 1.3);
}

#[test]
fn spacings_of_crosses_are_those_of_the_metric() {
    let mesh = body();
    let frames = Frames::of(&mesh, EdgeWeights::One).unwrap();
    let x: Vec<f64> = mesh.positions().iter().map(|p| p.x).collect();
    let gradient = laplace::gradient(&mesh, &x).unwrap();
    let options = along(&mesh, |p| p.x);
    let metric = Metric::of(&mesh, &frames, &x, 1.0, &options).unwrap();
    let field = cross_field(&mesh, &[], &FieldOptions::default(), Run::on(&Cpu)).unwrap();
    let Spacing::PerFace(made) = metric.spacings(&field, 0.5) else {
        panic!("spacings differ");
    };
    for f in (0..frames.faces()).step_by(37) {
        let g = gradient[f];
        let part = ((g.norm() - 0.3) / 0.6).clamp(0.0, 1.0);
        let r = 0.2f64.powf(part);
        let arms = field.arms(&frames, f);
        for (made, arm) in made[f].iter().zip(arms) {
            let cosine = arm.dot(&g) / g.norm();
            let wanted = 0.5 / (1.0 + (r.powi(-2) - 1.0) * cosine * cosine).sqrt();
            assert!((made - wanted).abs() < 1e-9, "{made} {wanted}");
        }
    }
}

/// A spike that is one sliver's does not make everything else flat.
#[test]
fn slivers_do_not_decide_what_is_steep() {
    let mesh = plate(10, 0.0, |_, _| false);
    let x: Vec<f64> = mesh.positions().iter().map(|p| 3.0 * p.x).collect();
    let mut gradient = laplace::gradient(&mesh, &x).unwrap();
    assert!((steepest(&mesh, &gradient) - 3.0).abs() < 1e-12);
    gradient[77] = Vector3::new(12.0, 0.0, 0.0);
    assert!((steepest(&mesh, &gradient) - 3.0).abs() < 1e-12);
    // Four of two hundred triangles are more than a hundredth.
    gradient[100..103].fill(Vector3::new(12.0, 0.0, 0.0));
    assert_eq!(steepest(&mesh, &gradient), 12.0);
}

#[test]
fn threads_do_not_matter() {
    let mesh = shapes::ellipsoid(Vector3::new(2.0, 1.0, 1.0), 3);
    let options = Options {
        size: Size::Quads(300),
        anisotropy: Some(Anisotropy {
            adaptation: Some(Adaptation {
                rounds: 4,
                ..Adaptation::default()
            }),
            ..Anisotropy::of(Function::Mode(1))
        }),
        ..Options::default()
    };
    same_on_any_threads(|| quadrangulate(&mesh, &options, Run::on(&Cpu)).unwrap());
}

#[test]
fn wrong_wishes_are_named() {
    let mesh = shapes::icosphere(1.0, 2);
    let good = along(&mesh, |p| p.x);
    let wrong = [
        (
            "anisotropy.ratio",
            Anisotropy {
                ratio: 0.0,
                ..good.clone()
            },
        ),
        (
            "anisotropy.ratio",
            Anisotropy {
                ratio: f64::NAN,
                ..good.clone()
            },
        ),
        (
            "anisotropy.ratio",
            Anisotropy {
                ratio: 1.5,
                ..good.clone()
            },
        ),
        (
            "anisotropy.ramp",
            Anisotropy {
                ramp: [0.9, 0.3],
                ..good.clone()
            },
        ),
        (
            "anisotropy.ramp",
            Anisotropy {
                ramp: [0.5, f64::NAN],
                ..good.clone()
            },
        ),
        (
            "anisotropy.weight",
            Anisotropy {
                weight: f64::NAN,
                ..good.clone()
            },
        ),
        ("anisotropy.function", Anisotropy::of(Function::Mode(0))),
        (
            "anisotropy.function",
            Anisotropy::of(Function::Values(vec![0.0; 3])),
        ),
        ("anisotropy.function", along(&mesh, |_| 4.0)),
        (
            "anisotropy.function",
            along(&mesh, |p| if p.x > 0.9 { f64::NAN } else { 0.0 }),
        ),
        (
            "anisotropy.rate",
            Anisotropy {
                adaptation: Some(Adaptation {
                    rate: 0.0,
                    rounds: 3,
                }),
                ..good.clone()
            },
        ),
    ];
    for (name, anisotropy) in wrong {
        let options = Options {
            anisotropy: Some(anisotropy),
            ..Options::default()
        };
        match quadrangulate(&mesh, &options, Run::on(&Cpu)) {
            Err(Error::Option(error)) => assert_eq!(error.option, name),
            other => panic!("{name}: {other:?}"),
        }
    }
}
