//! Every backend follows the specification; the comparison can fail; threads do not matter.

use crossfield::backend::{CHART_DISTORTION, ChartDistortion};
use crossfield::map::Chart;
use crossfield::testing::monotone;
use crossfield::{CrossfieldBackend, Options, Size, quadrangulate, specification};
use geom_core::mesh::shapes;
use geom_core::testing::same_on_any_threads;
use geom_core::{Cpu, Run};
use proptest::prelude::*;

#[test]
fn threads_do_not_matter() {
    let mesh = shapes::torus(1.0, 0.4, 40, 20);
    let options = Options {
        size: Size::Quads(300),
        ..Options::default()
    };
    same_on_any_threads(|| quadrangulate(&mesh, &options, Run::on(&Cpu)).unwrap());
}

/// Triangles with sides of about one, mapped with noise, some inverted.
fn charts() -> impl Strategy<Value = (Vec<Chart>, Vec<[[f64; 2]; 3]>)> {
    let point = || [-0.4..0.4f64, -0.4..0.4f64];
    let one = (
        [point(), point(), point()],
        [point(), point(), point()],
        0.3..2.0f64,
    );
    prop::collection::vec(one, 1..40).prop_map(|all| {
        all.into_iter()
            .map(|(shake, map, area)| {
                let corner = |k: usize, by: &[[f64; 2]; 3]| {
                    let base = [[0.0, 0.0], [1.0, 0.0], [0.3, 1.0]][k];
                    [base[0] + 0.5 * by[k][0], base[1] + 0.5 * by[k][1]]
                };
                let p = [0, 1, 2].map(|k| corner(k, &shake));
                let uv = [0, 1, 2].map(|k| corner(k, &map).map(|x| 2.0 * x + 5.0));
                (chart(&p, area), uv)
            })
            .unzip()
    })
}

fn chart(p: &[[f64; 2]; 3], area: f64) -> Chart {
    let side = |a: usize, b: usize| [p[b][0] - p[a][0], p[b][1] - p[a][1]];
    let (a, b) = (side(0, 1), side(0, 2));
    let doubled = a[0] * b[1] - a[1] * b[0];
    let hats = [0, 1, 2].map(|k| {
        let [x, y] = side((k + 1) % 3, (k + 2) % 3);
        [-y / doubled, x / doubled]
    });
    Chart {
        along_u: hats,
        along_v: hats.map(|g| g.map(|x| 0.5 * x)),
        area,
    }
}

/// Energies, and derivatives over the energy.
fn chart_numbers(all: &[ChartDistortion]) -> Vec<f64> {
    let numbers = |d: &ChartDistortion| {
        let g = d.gradient.as_flattened().iter().map(|g| g / d.energy);
        std::iter::once(d.energy).chain(g).collect::<Vec<_>>()
    };
    all.iter().flat_map(numbers).collect()
}

proptest! {
    #![proptest_config(geom_core::testing::cases(32))]

    #[test]
    fn cpu_is_the_specification((charts, uv) in charts()) {
        let mut out = Vec::new();
        Cpu.chart_distortion(&charts, &uv, 0.1, &mut out).unwrap();
        let expected: Vec<_> = charts
            .iter()
            .zip(&uv)
            .map(|(c, uv)| specification::chart_distortion(c, uv, 0.1))
            .collect();
        prop_assert_eq!(out, expected);
    }

    /// The derivatives of the specification are those of its energy.
    #[test]
    fn derivatives_follow_differences((charts, uv) in charts(), at in 0usize..6) {
        const STEP: f64 = 1e-6;
        for (chart, uv) in charts.iter().zip(&uv) {
            let energy = |by: f64| {
                let mut uv = *uv;
                uv[at / 2][at % 2] += by;
                specification::chart_distortion(chart, &uv, 0.1).energy
            };
            let here = specification::chart_distortion(chart, uv, 0.1);
            let difference = (energy(STEP) - energy(-STEP)) / (2.0 * STEP);
            let slope = here.gradient[at / 2][at % 2];
            let size = here.energy + here.gradient.as_flattened().iter().map(|g| g.abs()).sum::<f64>();
            prop_assert!((slope - difference).abs() < 1e-4 * size * (1.0 + size), "{slope} {difference}");
        }
    }

    /// What is monotone is upright and turned by less than a quarter; what falls short of it has the slopes of its energy, which
    /// is convex.
    #[test]
    fn monotone_maps_are_upright_and_convex((charts, uv) in charts(), at in 0usize..6, share in 0.0..1.0f64) {
        const STEP: f64 = 1e-6;
        // As few of them are turned away from the field, all are turned about.
        let (sin, cos) = (share * std::f64::consts::TAU).sin_cos();
        for (k, (chart, uv)) in charts.iter().zip(&uv).enumerate() {
            let uv = &uv.map(|[x, y]| [cos * x - sin * y, sin * x + cos * y]);
            let [[a, b], [c, d]] = chart.jacobian(uv);
            let (least, short) = monotone(chart, uv);
            // The least of xᵀ J x over a fine circle of unit vectors.
            let products = (0..720).map(|i| (f64::from(i) * std::f64::consts::PI / 720.0).sin_cos());
            let products = products.map(|(y, x)| a * x * x + (b + c) * x * y + d * y * y);
            let lowest = products.fold(f64::INFINITY, f64::min);
            prop_assert!(lowest >= least - 1e-12 && lowest - least < 1e-4 * (1.0 + a.abs() + b.abs() + c.abs() + d.abs()));
            prop_assert!(least <= 0.0 || a * d - b * c > 0.0 && a + d > 0.0);
            let energy = |uv: &[[f64; 2]; 3]| monotone(chart, uv).1.energy;
            let moved = |by: f64| {
                let mut uv = *uv;
                uv[at / 2][at % 2] += by;
                energy(&uv)
            };
            let difference = (moved(STEP) - moved(-STEP)) / (2.0 * STEP);
            let slope = short.gradient[at / 2][at % 2];
            let size = short.energy + short.gradient.as_flattened().iter().map(|g| g.abs()).sum::<f64>();
            prop_assert!((slope - difference).abs() < 1e-4 * (1e-3 + size), "{slope} {difference}");
            // Of another triangle's map.
            let other = &charts[(k + 1) % charts.len()];
            let other = [0, 1, 2].map(|v| [other.along_u[v][0], other.along_v[v][1]].map(|x| 3.0 * x));
            let between = |s: f64| [0, 1, 2].map(|v| [0, 1].map(|i| (1.0 - s) * uv[v][i] + s * other[v][i]));
            let chord = (1.0 - share) * energy(uv) + share * energy(&other);
            prop_assert!(energy(&between(share)) <= chord + 1e-9 * (1.0 + chord));
        }
    }

    /// The comparison can fail: one altered value is found, at its place.
    #[test]
    fn a_wrong_value_is_caught((charts, uv) in charts(), place in any::<prop::sample::Index>()) {
        let mut out = Vec::new();
        Cpu.chart_distortion(&charts, &uv, 0.1, &mut out).unwrap();
        let reference = chart_numbers(&out);
        let (mut wrong, i) = (reference.clone(), place.index(reference.len()));
        wrong[i] = wrong[i] * 1.01 + 3e-3 * wrong[i].signum();
        let caught = CHART_DISTORTION.first_break(&reference, &wrong);
        prop_assert_eq!(caught.map(|b| b.index), Some(i));
    }
}

#[cfg(feature = "wgpu")]
mod gpu {
    use geom_core::testing::gpu_or_skip;

    use super::*;

    #[test]
    fn distortions_follow_cpu() {
        let Some(gpu) = gpu_or_skip() else { return };
        let config = geom_core::testing::cases(24);
        proptest!(config, |((charts, uv) in charts(), epsilon in 0.03..1.0f64)| {
            let (mut reference, mut candidate) = (Vec::new(), Vec::new());
            Cpu.chart_distortion(&charts, &uv, epsilon, &mut reference).unwrap();
            gpu.chart_distortion(&charts, &uv, epsilon, &mut candidate).unwrap();
            let numbers = [&reference, &candidate].map(|d| chart_numbers(d));
            prop_assert_eq!(CHART_DISTORTION.first_break(&numbers[0], &numbers[1]), None);
        });
    }

    #[test]
    fn whole_quadrangulations_obey_the_same_laws() {
        let Some(gpu) = gpu_or_skip() else { return };
        let mesh = shapes::icosphere(1.0, 3);
        let made = quadrangulate(&mesh, &Options::default(), Run::on(&gpu)).unwrap();
        assert!(made.report.backend.starts_with("wgpu"));
        assert_eq!(made.mesh.euler_characteristic(), 2);
        assert_eq!(made.report.valences.irregular(), 8);
        assert!(made.report.scaled_jacobian.min > 0.3);
    }
}
