//! Every backend follows the specification; the comparisons can fail.

use geom_core::{Cpu, Vector3};
use proptest::prelude::*;
use tspline::backend::{CORNER_DISTORTION, Corner, CornerDistortion};
use tspline::{SplineBackend, specification};

fn corners() -> impl Strategy<Value = Vec<Corner>> {
    let vector = || [-1.0..1.0f64, -1.0..1.0f64, -0.2..0.2f64];
    let ideal = [0.7..1.5f64, -0.4..0.4f64, -0.4..0.4f64, 0.7..1.5f64];
    prop::collection::vec((vector(), vector(), ideal), 1..60).prop_map(|all| {
        all.into_iter()
            .map(|(a, b, [p, q, r, s])| Corner {
                edges: [
                    Vector3::x() + Vector3::from(a),
                    Vector3::y() + Vector3::from(b),
                ],
                normal: Vector3::new(0.1, -0.2, 1.0).normalize(),
                inverse: [[p, q], [r, s]],
            })
            .collect()
    })
}

/// Energies and areas, and derivatives over the energy.
fn corner_numbers(all: &[CornerDistortion]) -> Vec<f64> {
    let numbers = |d: &CornerDistortion| {
        let [a, b] = d.gradient.map(|g| g / d.energy);
        [d.energy, d.area, a.x, a.y, a.z, b.x, b.y, b.z]
    };
    all.iter().flat_map(numbers).collect()
}

proptest! {
    #![proptest_config(geom_core::testing::cases(32))]

    #[test]
    fn cpu_is_the_specification(corners in corners()) {
        let mut out = Vec::new();
        Cpu.corner_distortion(&corners, 0.1, &mut out).unwrap();
        let expected: Vec<_> =
            corners.iter().map(|c| specification::corner_distortion(c, 0.1)).collect();
        prop_assert_eq!(out, expected);
    }

    /// The derivatives of the specification are those of its energy.
    #[test]
    fn derivatives_follow_differences(corners in corners(), at in 0usize..6) {
        const STEP: f64 = 1e-5;
        for corner in &corners {
            for epsilon in [0.0, 0.1] {
                let here = specification::corner_distortion(corner, epsilon);
                if epsilon == 0.0 && here.area < 0.2 {
                    // Beyond the barrier.
                    continue;
                }
                let energy = |by: f64| {
                    let mut corner = *corner;
                    corner.edges[at / 3][at % 3] += by;
                    specification::corner_distortion(&corner, epsilon).energy
                };
                // Of fourth order.
                let near = (energy(STEP) - energy(-STEP)) / (2.0 * STEP);
                let far = (energy(2.0 * STEP) - energy(-2.0 * STEP)) / (4.0 * STEP);
                let difference = (4.0 * near - far) / 3.0;
                let slope = here.gradient[at / 3][at % 3];
                let size = here.energy * (1.0 + here.energy);
                prop_assert!((slope - difference).abs() < 1e-7 * size * (1.0 + size), "{} {}", slope, difference);
            }
        }
    }

    /// The comparisons can fail: one altered value is found, at its place.
    #[test]
    fn a_wrong_value_is_caught(corners in corners(), place in any::<prop::sample::Index>()) {
        let mut out = Vec::new();
        Cpu.corner_distortion(&corners, 0.1, &mut out).unwrap();
        let reference = corner_numbers(&out);
        let (mut wrong, i) = (reference.clone(), place.index(reference.len()));
        wrong[i] = wrong[i] * 1.01 + 3e-3 * wrong[i].signum();
        let caught = CORNER_DISTORTION.first_break(&reference, &wrong);
        prop_assert_eq!(caught.map(|b| b.index), Some(i));
    }
}

#[test]
fn an_ideal_corner_has_distortion_one() {
    let corner = Corner {
        edges: [Vector3::new(2.0, 0.0, 0.0), Vector3::new(1.0, 3.0, 0.0)],
        normal: Vector3::z(),
        inverse: [[0.5, -1.0 / 6.0], [0.0, 1.0 / 3.0]],
    };
    let of = specification::corner_distortion(&corner, 0.0);
    assert!((of.energy - 1.0).abs() < 1e-15 && (of.area - 1.0).abs() < 1e-15);
    assert!(of.gradient.iter().all(|g| g.norm() < 1e-15));
}

#[cfg(feature = "wgpu")]
mod gpu {
    use geom_core::mesh::shapes;
    use geom_core::testing::gpu_or_skip;
    use geom_core::{Run, nalgebra};
    use tspline::{QualityOptions, TMesh, TMeshOptions, improve};

    use super::*;

    #[test]
    fn distortions_follow_cpu() {
        let Some(gpu) = gpu_or_skip() else { return };
        let config = geom_core::testing::cases(24);
        proptest!(config, |(corners in corners(), epsilon in 0.03..1.0f64)| {
            let (mut reference, mut candidate) = (Vec::new(), Vec::new());
            Cpu.corner_distortion(&corners, epsilon, &mut reference).unwrap();
            gpu.corner_distortion(&corners, epsilon, &mut candidate).unwrap();
            let numbers = [&reference, &candidate].map(|d| corner_numbers(d));
            prop_assert_eq!(CORNER_DISTORTION.first_break(&numbers[0], &numbers[1]), None);
        });
    }

    #[test]
    fn whole_improvements_obey_the_same_laws() {
        let Some(gpu) = gpu_or_skip() else { return };
        let fine = shapes::quad_sphere(1.0, 8);
        let mesh = TMesh::build(&fine, &[1; 384], &TMeshOptions::default()).unwrap();
        let surface = shapes::ellipsoid(nalgebra::vector![1.0, 0.8, 0.6], 3);
        let out = improve(mesh, &surface, &QualityOptions::default(), Run::on(&gpu)).unwrap();
        assert!(out.report.backend.starts_with("wgpu"));
        assert!(out.report.after.min >= out.report.before.min);
        assert!(out.mesh.audit().is_valid());
    }
}
