//! Every option has an effect, and no input ends in a panic.

use gauss_density::testing::globule;
use gauss_density::thesis::{self, Cut};
use gauss_density::{
    Cutoff, Elimination, Error, Interior, Levels, LowPass, Model, Options, PointSampler, Refit,
    Shape, Stop, compare, eliminate, low_pass, refit, sample, sample_band,
};
use geom_core::options::OutOfRange;
use geom_core::{Aabb, Cpu, ImplicitField, LatticeValues, Point3, Run};
use proptest::prelude::*;

fn body(levels: Levels) -> Model {
    Model::uniform(&globule(2, 8, 3), &levels).unwrap()
}

fn blurred() -> Model {
    body(Levels {
        residue_power: 0.25,
        chain_power: 0.8,
        decay: 0.5,
        ..Levels::default()
    })
}

#[test]
fn every_option_of_sampling_counts() {
    let model = Model::uniform(&globule(3, 12, 7), &Levels::default()).unwrap();
    let base = Options {
        spacing: 0.6,
        ..Options::default()
    };
    let dense = |options: &Options| sample(&model, options, Run::on(&Cpu)).unwrap();
    let usual = dense(&base);
    let with = |change: fn(&mut Options)| {
        let mut options = base.clone();
        change(&mut options);
        options
    };
    assert!(dense(&with(|o| o.spacing = 0.5)).report.points > usual.report.points);
    assert!(dense(&with(|o| o.margin = Some(30.0))).report.points > usual.report.points);
    let coarse = dense(&with(|o| o.cutoff = Cutoff(0.2)));
    assert!(coarse.grid != usual.grid && coarse.report.pairs < usual.report.pairs);
    assert!(dense(&with(|o| o.floor = Some(0.5))).report.pairs < usual.report.pairs);
    let small = |o: &mut Options| {
        o.bounds = Some(Aabb::new(Point3::origin(), Point3::new(3.0, 4.0, 5.0)));
    };
    assert_eq!(dense(&with(small)).grid.lattice().counts, [6, 8, 10]);
    let wide = |band| {
        let fine = Options {
            spacing: 0.3,
            band,
            ..Options::default()
        };
        sample_band(&model, &fine, Run::on(&Cpu)).unwrap().report
    };
    let narrow = wide([0.5, 2.0]);
    assert!(wide([0.5, 40.0]).stored_points > narrow.stored_points);
    assert!(wide([0.01, 2.0]).pairs > narrow.pairs);
    let little = with(|o| o.max_memory = 1 << 10);
    for error in [
        sample(&model, &little, Run::on(&Cpu)).unwrap_err(),
        sample_band(&model, &little, Run::on(&Cpu)).unwrap_err(),
    ] {
        assert!(
            matches!(error, Error::GridTooLarge { limit: 1024, .. }),
            "{error}"
        );
    }
}

#[test]
fn every_power_and_the_decay_count() {
    let x = Point3::new(2.0, 1.0, -3.0);
    let at = |levels: Levels| {
        let model = body(levels);
        PointSampler::new(&model, Cutoff::default())
            .unwrap()
            .value(&x)
    };
    let usual = Levels {
        domain_power: 0.9,
        chain_power: 0.8,
        ..Levels::default()
    };
    let value = at(usual);
    for changed in [
        Levels {
            residue_power: 0.3,
            ..usual
        },
        Levels {
            chain_power: 0.6,
            ..usual
        },
        Levels {
            domain_power: 0.7,
            ..usual
        },
        Levels {
            decay: 0.4,
            ..usual
        },
    ] {
        assert!((at(changed) / value - 1.0).abs() > 1e-3, "{changed:?}");
    }
}

#[test]
fn every_option_of_elimination_counts() {
    let model = blurred();
    let base = Elimination {
        spacing: 1.0,
        epsilon: 0.05,
        ..Elimination::default()
    };
    let with = |change: fn(&mut Elimination)| {
        let mut options = base.clone();
        change(&mut options);
        eliminate(&model, &options, Run::on(&Cpu)).unwrap().report
    };
    let usual = with(|_| ());
    assert!(with(|o| o.epsilon = 0.2).remaining < usual.remaining);
    assert!(with(|o| o.spacing = 0.7).samples > usual.samples);
    assert!(with(|o| o.band = [0.5, 2.0]).samples > usual.samples);
    assert!(with(|o| o.stop = Stop::FirstFailure).remaining > usual.remaining);
    assert!(with(|o| o.interior = Interior::Hollow).samples < usual.samples);
    let little = Elimination {
        max_memory: 1 << 10,
        ..base
    };
    assert!(eliminate(&model, &little, Run::on(&Cpu)).is_err());
    assert_eq!(
        Elimination::thesis(0.03),
        Elimination {
            epsilon: 0.03,
            spacing: 1.0,
            stop: Stop::FirstFailure,
            interior: Interior::Hollow,
            ..Elimination::default()
        }
    );
}

#[test]
fn every_option_of_the_refit_counts() {
    let model = blurred();
    let options = Elimination {
        spacing: 1.0,
        epsilon: 0.1,
        ..Elimination::default()
    };
    let reduced = eliminate(&model, &options, Run::on(&Cpu)).unwrap().model;
    let base = Refit {
        spacing: 1.0,
        iterations: 12,
        ..Refit::default()
    };
    let with = |change: fn(&mut Refit)| {
        let mut options = base.clone();
        change(&mut options);
        refit(&reduced, &model, &options, Run::on(&Cpu)).unwrap()
    };
    let usual = with(|_| ());
    assert_eq!(usual.report.iterations, 12);
    assert!(with(|o| o.spacing = 0.8).report.samples > usual.report.samples);
    assert!(with(|o| o.band = [0.5, 2.0]).report.samples > usual.report.samples);
    assert_eq!(
        with(|o| o.max_shift = 0.0).model.centers(),
        reduced.centers()
    );
    assert_eq!(
        with(|o| o.max_radius_change = 0.0).model.radii(),
        reduced.radii()
    );
    assert_eq!(
        with(|o| o.max_decay_change = 0.0).model.decays(),
        reduced.decays()
    );
    assert!(usual.model.decays().iter().any(|&k| k < 0.5));
    assert!(
        with(|o| o.min_decay = 0.5)
            .model
            .decays()
            .iter()
            .all(|&k| k >= 0.5)
    );
    assert_eq!(with(|o| o.iterations = 3).report.iterations, 3);
    assert!(with(|o| o.tolerance = 0.2).report.iterations < 12);
    // A step that goes nowhere is not tried.
    let fixed = with(|o| (o.max_shift, o.max_radius_change, o.max_decay_change) = (0.0, 0.0, 0.0));
    assert_eq!(
        (fixed.report.iterations, fixed.report.accepted),
        (0, 0),
        "nothing may change"
    );
    let little = Refit {
        max_memory: 1 << 10,
        ..base
    };
    assert!(refit(&reduced, &model, &little, Run::on(&Cpu)).is_err());
    let none = Refit {
        min_decay: 0.0,
        ..Refit::default()
    };
    assert!(matches!(
        none.check(),
        Err(OutOfRange {
            option: "min_decay",
            ..
        })
    ));
}

/// Ends of long edges lie so far out that no atom matters around them.
#[test]
fn samples_without_an_atom_end_no_refit() {
    for decay in [0.5, 2.0] {
        let model = body(Levels {
            decay,
            ..Levels::default()
        });
        let options = Refit {
            spacing: 2.0,
            iterations: 2,
            ..Refit::default()
        };
        let fit = refit(&model, &model, &options, Run::on(&Cpu)).unwrap();
        assert!(fit.report.samples > 0 && fit.report.worst[0] < 1e-3);
        // Nothing of the reduced model is near most of the samples: all of their density is missing.
        let corner = Model::new(vec![model.centers()[0]], vec![1.0], vec![2.0], vec![]).unwrap();
        let fit = refit(&corner, &model, &options, Run::on(&Cpu)).unwrap();
        assert!(fit.report.worst[0] > 0.9);
    }
}

/// The option that is wrong is the one that is named.
#[test]
fn what_is_out_of_range_is_named() {
    let base = Options::default();
    let named = |options: Options| {
        let error = options.check().unwrap_err();
        (error.option, error.value)
    };
    let no_band = Options {
        band: [f64::NAN, 2.0],
        floor: Some(0.1),
        ..base.clone()
    };
    assert_eq!(named(no_band).0, "band[0]");
    let within = |min: f64, max: f64| Options {
        bounds: Some(Aabb {
            min: Point3::from([min; 3]),
            max: Point3::from([max; 3]),
        }),
        ..base.clone()
    };
    assert_eq!(
        named(within(-2e8, 0.0)),
        ("bounds", "-200000000".to_owned())
    );
    assert_eq!(named(within(0.0, 2e8)), ("bounds", "200000000".to_owned()));
    assert_eq!(named(within(1.0, 0.0)), ("bounds", "-1".to_owned()));
    assert!(within(-1e8, 1e8).check().is_ok());
}

#[test]
fn the_floor_counts_for_the_search_from_one_seed() {
    let model = body(Levels::default());
    let pairs = |floor| {
        let options = Options {
            spacing: 1.0,
            cutoff: Cutoff(0.1),
            floor,
            ..Options::default()
        };
        let done = thesis::single_seed(&model, &options, Cut::AfterPowers).unwrap();
        done.report.pairs
    };
    assert!(pairs(Some(0.5)) < pairs(Some(1e-3)));
    assert_eq!(pairs(None), pairs(Some(1e-3)));
}

/// The fast path in f32 against the closed form: a single atom, at every power and decay.
#[test]
fn one_atom_is_a_sphere_for_the_fast_path_too() {
    for decay in [0.1, 1.0, 5.0] {
        for power in [0.05, 0.5, 1.0, 3.0] {
            let tree = vec![(vec![0, 1], vec![power]); 2];
            let center = Point3::new(0.3, -0.2, 0.1);
            let model = Model::new(vec![center], vec![1.7], vec![decay], tree).unwrap();
            let options = Options {
                spacing: 0.4,
                margin: Some(4.0),
                ..Options::default()
            };
            let grid = sample(&model, &options, Run::on(&Cpu)).unwrap().grid;
            for (i, &got) in grid.values().iter().enumerate() {
                let x = grid.lattice().point(grid.lattice().coordinates(i));
                let square = (x - center).norm_squared() - 1.7 * 1.7;
                let exact = (-decay * square * power * power).exp();
                if exact > 1e-3 && exact < 1e30 {
                    let off = (f64::from(got) / exact - 1.0).abs();
                    assert!(
                        off <= 3e-5,
                        "{got} for {exact} at {:?}, decay {decay}, power {power}",
                        x - center
                    );
                }
            }
        }
    }
}

#[test]
fn a_tree_that_is_none_is_refused() {
    let model = |radii: usize, tree: Vec<(Vec<u32>, Vec<f64>)>| {
        let decays = vec![1.0; 3];
        Model::new(vec![Point3::origin(); 3], vec![1.0; radii], decays, tree).unwrap_err()
    };
    let fine = (vec![0, 3], vec![1.0]);
    assert!(matches!(
        model(2, vec![]),
        Error::Length {
            what: "radii",
            found: 2,
            atoms: 3
        }
    ));
    for (tree, bad) in [
        (vec![(vec![], vec![])], 0),
        (vec![(vec![0, 3], vec![])], 0),
        (vec![(vec![1, 3], vec![1.0])], 0),
        (vec![(vec![0, 2], vec![1.0])], 0),
        (vec![(vec![0, 2, 2, 3], vec![1.0; 3])], 0),
        (vec![(vec![0, 3, 2, 3], vec![1.0; 3])], 0),
        (vec![fine.clone(), (vec![0, 3], vec![1.0])], 1),
    ] {
        let error = model(3, tree.clone());
        assert!(
            matches!(error, Error::BadTree { level, .. } if level == bad),
            "{tree:?}: {error}"
        );
    }
    assert!(matches!(
        model(3, vec![(vec![0, 3], vec![f64::NAN])]),
        Error::Option(OutOfRange {
            option: "power",
            ..
        })
    ));
}

/// Numbers as users mistype them, and as large and small as f64 holds.
fn odd() -> impl Strategy<Value = f64> {
    prop_oneof![
        4 => -3.0..3.0f64,
        1 => Just(0.0),
        1 => Just(-0.0),
        1 => Just(f64::NAN),
        1 => Just(f64::INFINITY),
        1 => Just(f64::MIN_POSITIVE),
        1 => prop_oneof![Just(1e7), Just(-1e7), Just(1e300), Just(-1e300)],
        1 => (-9.0..9.0f64).prop_map(|e| 10f64.powf(e)),
    ]
}

proptest! {
    // The same cases every time: a gate must not depend on luck.
    #![proptest_config(ProptestConfig {
        failure_persistence: None,
        rng_seed: proptest::test_runner::RngSeed::Fixed(0x0b10_9e04),
        ..ProptestConfig::with_cases(300)
    })]

    /// Results or typed errors: never a panic, never more memory than allowed.
    #[test]
    fn no_input_ends_in_a_panic(
        atoms in prop::collection::vec((prop::array::uniform3(odd()), odd(), odd()), 0..5),
        power in odd(),
        spacing in odd(),
        eps in odd(),
        bare in any::<bool>(),
        margin in prop::option::of(odd()),
        corners in prop::option::of(prop::array::uniform2(prop::array::uniform3(odd()))),
        band in prop::array::uniform2(odd()),
        floor in prop::option::of(odd()),
        search in 0..4usize,
        usual in prop::array::uniform6(any::<bool>()),
    ) {
        let n = atoms.len() as u32;
        let (mut centers, mut radii, mut decays) = (Vec::new(), Vec::new(), Vec::new());
        for (x, radius, decay) in atoms {
            centers.push(Point3::from(x));
            radii.push(if usual[0] { radius.abs() } else { radius });
            decays.push(if usual[1] { 1.0 } else { decay });
        }
        let power = if usual[2] { 0.5 } else { power };
        let tree = vec![(vec![0, n], vec![power])];
        let Ok(model) = Model::new(centers, radii, decays, tree) else { return Ok(()) };
        let defaults = Options::default();
        let options = Options {
            spacing: if usual[3] { 1.0 } else { spacing },
            cutoff: if usual[4] || bare { defaults.cutoff } else { Cutoff(eps) },
            margin,
            bounds: corners.map(|[a, b]| Aabb { min: a.into(), max: b.into() }),
            band: if usual[5] { defaults.band } else { band },
            floor,
            max_memory: 1 << 16,
        };
        let cut = if bare && !usual[4] { Cut::Bare(eps) } else { Cut::AfterPowers };
        let searched = match search {
            0 => thesis::all_atoms(&model, &options),
            1 => thesis::single_seed(&model, &options, cut),
            2 => thesis::kd_tree(&model, &options, cut),
            _ => thesis::hierarchy(&model, &options, cut),
        };
        for done in [sample(&model, &options, Run::on(&Cpu)), searched].into_iter().flatten() {
            prop_assert!(done.grid.values().len() <= 1 << 14);
            prop_assert!(done.grid.values().iter().all(|v| v.is_finite() && *v >= 0.0));
        }
        if let Ok(done) = sample_band(&model, &options, Run::on(&Cpu)) {
            prop_assert!(done.grid.values().iter().all(|v| v.is_finite() && *v >= 0.0));
        }
        let _ = compare(&model, &model, &options, Run::on(&Cpu));
        if let Ok(field) = PointSampler::new(&model, options.cutoff) {
            // Squares of distances would be infinite here.
            let far = Point3::new(1e300, 0.0, -1e200);
            let (value, gradient, hessian) = field.value_gradient_hessian(&far);
            prop_assert!(value == 0.0 && gradient.norm() == 0.0 && hessian.norm() == 0.0);
            prop_assert!(field.mean_curvature(&far).is_nan());
            prop_assert!(field.parameter_gradient(&far).is_empty());
            for x in [Point3::origin(), Point3::new(spacing, eps, power)] {
                let (value, _) = field.value_gradient(&x);
                prop_assert!(value >= 0.0 || x.iter().any(|c| !c.is_finite()), "{value} at {x}");
                let _ = field.mean_curvature(&x);
                let _ = field.parameter_gradient(&x);
            }
        }
        let elimination = Elimination {
            epsilon: eps,
            spacing: options.spacing,
            band: options.band,
            max_memory: 1 << 16,
            ..Elimination::default()
        };
        let _ = eliminate(&model, &elimination, Run::on(&Cpu));
        let fit = Refit {
            spacing: options.spacing,
            band: options.band,
            max_shift: eps,
            tolerance: power,
            iterations: 3,
            max_memory: 1 << 16,
            ..Refit::default()
        };
        let _ = refit(&model, &model, &fit, Run::on(&Cpu));
    }

    #[test]
    fn no_filter_ends_in_a_panic(
        cutoff_length in odd(),
        shape in prop::sample::select(vec![Shape::Ideal, Shape::Butterworth, Shape::Gaussian]),
        values in prop::collection::vec(prop_oneof![0.0..3.0f32, Just(f32::MAX), Just(-1.0f32)], 60),
    ) {
        let lattice = geom_core::Lattice { origin: Point3::origin(), spacing: 0.5, counts: [3, 4, 5] };
        let grid = geom_core::ScalarGrid::new(lattice, values).unwrap();
        let options = LowPass { cutoff_length, shape, max_memory: 1 << 20 };
        if let Ok(smooth) = low_pass(&grid, &options) {
            prop_assert!(smooth.values().iter().all(|v| v.is_finite()));
        }
    }
}
