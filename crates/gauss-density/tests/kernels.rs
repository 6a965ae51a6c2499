//! What the kernels of the CPU are made of: culls and their bounds, exponentials, sums at a point.

use gauss_density::backend::Prepared;
use gauss_density::testing::models;
use gauss_density::{Model, inside};
use geom_core::compute::random::SplitMix64;
use geom_core::grid::{BRICK, BRICK_POINTS};
use geom_core::{Aabb, Point3, Vector3};
use proptest::prelude::*;
use proptest::test_runner::{Config, RngSeed, TestRunner};

/// Points of a box: its corners, its centre, and some in between.
fn points_in(cell: &Aabb) -> Vec<Point3> {
    let shares = [
        [0.5, 0.5, 0.5],
        [0.31, 0.77, 0.12],
        [0.83, 0.24, 0.61],
        [0.05, 0.48, 0.93],
    ];
    let corners = (0..8).map(|i| [i & 1, i >> 1 & 1, i >> 2].map(f64::from));
    corners
        .chain(shares)
        .map(|s| {
            let e = cell.extent();
            cell.min + Vector3::new(s[0] * e.x, s[1] * e.y, s[2] * e.z)
        })
        .collect()
}

/// The bound that everything rests on: `(1 − ε) G ≤ G̃ ≤ G` wherever `G` reaches the floor, for 10,000
/// random trees, boxes and budgets; and bounds of a box are above what is in it.
#[test]
fn culls_never_break_their_bound() {
    let cases = (
        models(),
        prop::array::uniform3(-9.0..9.0f64),
        prop::array::uniform3(0.3..5.0f64),
        -4.0..-1.0f64,
        -3.0..0.0f64,
    );
    let worst = std::cell::Cell::new((0.0f64, 0u64, 0u64));
    let config = Config {
        cases: 10_000,
        failure_persistence: None,
        // The same trees every time: this test is a measurement too.
        rng_seed: RngSeed::Fixed(3),
        ..Config::default()
    };
    TestRunner::new(config)
        .run(&cases, |(model, corner, extent, ln_eps, ln_floor)| {
            let (eps, floor) = (10f64.powf(ln_eps), 10f64.powf(ln_floor));
            let tree = Prepared::new(&model);
            let all: Vec<u32> = (0..model.atoms() as u32).collect();
            let low = Point3::from(corner);
            let cell = Aabb::new(low, low + Vector3::from(extent));
            let (up, kept) = inside::culled(&tree, &cell, eps, floor);
            // The single radius, on the same footing.
            let radius = inside::reach(&tree, eps, floor);
            let near: Vec<u32> = all
                .iter()
                .copied()
                .filter(|&a| cell.distance_squared(&model.centers()[a as usize]) <= radius * radius)
                .collect();
            for x in points_in(&cell) {
                let exact = inside::plain_value(&tree, all.iter().copied(), &x);
                // Denormal numbers have no logarithm to speak of.
                let normal = exact > 1e-300;
                prop_assert!(!normal || exact.ln() <= up + 1e-9, "up {up}, {exact:e}");
                for atoms in [&kept, &near] {
                    let got = inside::plain_value(&tree, atoms.iter().copied(), &x);
                    prop_assert!(got <= exact * (1.0 + 1e-12));
                    if exact >= floor {
                        let share = (1.0 - got / exact) / eps;
                        prop_assert!(share <= 1.0 + 1e-9, "lost {share} of what is allowed");
                        let (most, checks, dropped) = worst.get();
                        let fewer = u64::from(atoms.len() < all.len());
                        worst.set((most.max(share), checks + 1, dropped + fewer));
                    }
                }
            }
            Ok(())
        })
        .unwrap();
    let (most, checks, dropped) = worst.get();
    #[expect(
        clippy::print_stdout,
        reason = "the margin of the bound is worth seeing"
    )]
    {
        println!(
            "cull: worst observed/allowed {most:.3} over {checks} points, {dropped} with atoms dropped"
        );
    }
    assert!(checks > 50_000 && dropped > 20_000 && most > 0.01);
}

/// The logarithm of the kernel of an atom, `κ (r² − |x − c|²)`.
fn ln_kernel(model: &Model, atom: usize, x: &Point3) -> f64 {
    let r = model.radii()[atom];
    model.decays()[atom] * (r * r - (x - model.centers()[atom]).norm_squared())
}

/// The maximum of a difference of power distances over a box is above samples of it, and is reached.
#[test]
fn brackets_are_exact() {
    let case = (
        prop::array::uniform2((
            prop::array::uniform3(-4.0..4.0f64),
            0.0..2.0f64,
            0.1..2.0f64,
        )),
        0.05..3.0f64,
        prop::array::uniform3(0.2..3.0f64),
    );
    proptest!(ProptestConfig { failure_persistence: None, rng_seed: RngSeed::Fixed(7), ..ProptestConfig::with_cases(2000) },
        |((atoms, w, extent) in case)| {
        let centers = atoms.iter().map(|a| Point3::from(a.0)).collect();
        let radii = atoms.iter().map(|a| a.1).collect();
        let decays = atoms.iter().map(|a| a.2).collect();
        let model = Model::new(centers, radii, decays, vec![]).unwrap();
        let tree = Prepared::new(&model);
        let cell = Aabb::new(Point3::origin(), Point3::from(extent));
        let bound = inside::bracket(&tree, &cell, [0, 1], w);
        let mut most = f64::NEG_INFINITY;
        for i in 0..17usize.pow(3) {
            let s = [i % 17, i / 17 % 17, i / 289].map(|k| k as f64 / 16.0);
            let x = Point3::new(s[0] * extent[0], s[1] * extent[1], s[2] * extent[2]);
            let difference = -w * ln_kernel(&model, 1, &x) + ln_kernel(&model, 0, &x);
            prop_assert!(difference <= bound + 1e-6);
            most = most.max(difference);
        }
        // Curvature times the square of half a step of the samples.
        let step = extent.iter().copied().fold(0.0, f64::max) / 32.0;
        prop_assert!(bound - most <= 3.0 * 8.0 * step * step + 1e-6);
    });
}

/// The bound by which one atom outweighs another all over a brick is above their difference at every point of
/// it, for decays that differ by a factor of up to 20.
#[test]
fn no_difference_of_two_atoms_in_a_brick_is_above_its_bound() {
    let mut random = SplitMix64::new(11);
    let mut bent = 0;
    for _ in 0..2000 {
        let spacing = (0.2 + random.unit()) as f32;
        let mut atom = || {
            let offset = [(); 3].map(|()| 8.0 * random.symmetric() as f32);
            let decay = (0.1 + 1.9 * random.unit()) as f32;
            let top = 3.0 * random.unit() as f32;
            (offset, decay, top)
        };
        let both = [atom(), atom()];
        let middles = inside::middles(spacing);
        let exponent = |(offset, decay, top): ([f32; 3], f32, f32), x: [f32; 3]| {
            let squares = [0, 1, 2].map(|k| (x[k] - offset[k]) * (x[k] - offset[k]));
            top - decay * (squares[0] + squares[1] + squares[2])
        };
        let at_middles = both
            .map(|atom| std::array::from_fn(|l| exponent(atom, [0, 1, 2].map(|k| middles[k][l]))));
        let of_both = [0, 1].map(|i| (both[i].0, both[i].1, at_middles[i]));
        let bound = inside::most_beside(of_both, spacing);
        for (lane, bound) in bound.into_iter().enumerate() {
            let mut most = f32::NEG_INFINITY;
            for p in 0..BRICK_POINTS {
                let at = [p % BRICK, p / BRICK % BRICK, p / (BRICK * BRICK)];
                let x = [0, 1, 2].map(|k| middles[k][lane] + (at[k] as f32 - 3.5) * spacing);
                most = most.max(exponent(both[0], x) - exponent(both[1], x));
            }
            let slack = 1e-3 + 1e-5 * most.abs();
            assert!(bound >= most - slack, "{bound} below {most}");
            // Without the bend of unequal decays the bound would fail here.
            let straight = bound - 3.0 * (3.5 * spacing).powi(2) * (both[1].1 - both[0].1).max(0.0);
            bent += u32::from(straight < most - slack);
        }
    }
    assert!(bent > 1000, "{bent} bricks in which the bend decides");
}

#[test]
fn exponentials_and_logarithms_are_accurate_in_single_precision() {
    let mut worst: [f64; 2] = [0.0; 2];
    for i in -1_250_000..1_250_000 {
        let x = i as f32 * 1e-4;
        let exact = f64::from(x).exp2();
        worst[0] = worst[0].max((f64::from(inside::exp2(x)) / exact - 1.0).abs());
        let y = inside::exp2(x);
        let exact = f64::from(y).log2();
        let off = (f64::from(inside::log2(y)) - exact).abs();
        worst[1] = worst[1].max(off / (1.0 + exact.abs()));
    }
    assert!(worst[0] < 3e-7 && worst[1] < 3e-7, "{worst:?}");
}

#[test]
fn exponentials_and_logarithms_are_accurate_in_double_precision() {
    let mut worst: f64 = 0.0;
    for i in -699_000..699_000 {
        let x = f64::from(i) * 1e-3 + 0.1 / f64::from(i).abs().max(1.0);
        let mut got = [x];
        inside::exp_all(&mut got);
        worst = worst.max((got[0] / x.exp() - 1.0).abs());
    }
    assert!(worst < 5e-16, "{worst:e}");
    let mut worst: f64 = 0.0;
    for i in -699_000..699_000 {
        let x = (f64::from(i) * 1e-3).exp();
        let mut got = [x];
        inside::ln_all(&mut got);
        worst = worst.max((got[0] - x.ln()).abs() / x.ln().abs().max(1.0));
    }
    assert!(worst < 1e-15, "{worst:e}");
    let mut ends = [-1e9, -700.5, 0.0];
    inside::exp_all(&mut ends);
    assert_eq!(ends, [0.0, 0.0, 1.0]);
}

/// The same as the specification, for random trees.
#[test]
fn follows_the_plain_density() {
    let config = ProptestConfig {
        failure_persistence: None,
        rng_seed: proptest::test_runner::RngSeed::Fixed(11),
        ..ProptestConfig::with_cases(2000)
    };
    proptest!(config, |((model, x) in (models(), prop::array::uniform3(-9.0..9.0f64)))| {
        let tree = Prepared::new(&model);
        let all: Vec<u32> = (0..model.atoms() as u32).collect();
        let x = Point3::from(x);
        let (g, slope) = inside::plain_value_gradient(&tree, all.iter().copied(), &x);
        let (got, got_slope) = inside::value_gradient(&tree, &all, &x);
        prop_assert!((got - g).abs() <= 1e-12 * g + 1e-290, "{got:e} for {g:e}");
        prop_assert!((got_slope - slope).norm() <= 1e-11 * (slope.norm() + g) + 1e-290);
        prop_assert_eq!(inside::value(&tree, &all, &x).to_bits(), got.to_bits());
    });
}
