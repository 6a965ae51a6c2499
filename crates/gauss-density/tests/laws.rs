//! What must hold for all inputs.

use gauss_density::testing::globule;
use gauss_density::{
    Cutoff, Levels, Model, Options, PointSampler, nested_sum, sample, sample_band,
};
use geom_core::{Cpu, ImplicitField, LatticeValues, Point3, Run};

fn model(residue_power: f64, chain_power: f64, decay: f64) -> Model {
    let levels = Levels {
        residue_power,
        chain_power,
        decay,
        ..Levels::default()
    };
    Model::uniform(&globule(3, 12, 7), &levels).unwrap()
}

/// The parameters of the thesis.
const SETS: [(f64, f64, f64); 5] = [
    (0.5, 1.0, 1.0),
    (0.25, 1.0, 0.3),
    (0.05, 0.5, 1.0),
    (1.0, 1.0, 1.0),
    (0.3, 0.8, 0.5),
];

#[test]
fn dense_values_are_within_the_cut_off() {
    for (pr, pc, kappa) in SETS {
        let model = model(pr, pc, kappa);
        let eps = 1e-3;
        let options = Options {
            spacing: 1.1,
            cutoff: Cutoff::AfterPowers(eps),
            ..Options::default()
        };
        let sampled = sample(&model, &options, Run::on(&Cpu)).unwrap();
        assert!(!sampled.report.touches_any_side());
        let lattice = *sampled.grid.lattice();
        for i in (0..lattice.len()).step_by(7) {
            let x = lattice.point(lattice.coordinates(i));
            let exact = nested_sum(&model, &x);
            let got = f64::from(sampled.grid.values()[i]);
            assert!(got <= exact * (1.0 + 1e-4) + 1e-30, "{got} above {exact}");
            if exact >= 1e-3 {
                assert!(got >= exact * (1.0 - eps - 1e-4), "{got} below {exact}");
            }
        }
    }
}

#[test]
fn the_band_has_the_signs_of_the_dense_grid_and_its_values_at_crossings() {
    for (pr, pc, kappa) in SETS {
        for spacing in [0.45, 1.3] {
            let model = model(pr, pc, kappa);
            let options = Options {
                spacing,
                floor: Some(0.5),
                ..Options::default()
            };
            let dense = sample(&model, &options, Run::on(&Cpu)).unwrap().grid;
            let band = sample_band(&model, &options, Run::on(&Cpu)).unwrap();
            assert!(spacing > 1.0 || band.report.stored_share < 0.9);
            let band = band.grid;
            let lattice = *dense.lattice();
            assert_eq!(&lattice, band.lattice());
            for i in 0..lattice.len() {
                let p = lattice.coordinates(i);
                assert_eq!(dense.at(p) >= 1.0, band.at(p) >= 1.0, "sign at {p:?}");
                for k in 0..3 {
                    let mut q = p;
                    q[k] += 1;
                    if q[k] < lattice.counts[k] && (dense.at(p) >= 1.0) != (dense.at(q) >= 1.0) {
                        assert_eq!(dense.at(p), band.at(p));
                        assert_eq!(dense.at(q), band.at(q));
                    }
                }
            }
        }
    }
}

#[test]
fn the_sampler_is_the_density_and_its_gradient_the_difference_quotient() {
    for (pr, pc, kappa) in SETS {
        let model = model(pr, pc, kappa);
        let sampler = PointSampler::new(&model, Cutoff::AfterPowers(1e-9)).unwrap();
        let mut x = Point3::new(-14.0, 3.0, 1.0);
        while x.x < 14.0 {
            let exact = nested_sum(&model, &x);
            let (value, gradient) = sampler.value_gradient(&x);
            assert!((value - exact).abs() <= 2e-9 * exact);
            for k in 0..3 {
                let (mut a, mut b) = (x, x);
                a[k] -= 1e-4;
                b[k] += 1e-4;
                let slope = (nested_sum(&model, &b) - nested_sum(&model, &a)) / 2e-4;
                assert!((slope - gradient[k]).abs() <= 1e-6 * (gradient.norm() + value));
            }
            x.x += 0.37;
            x.y -= 0.05;
        }
    }
}
