//! What must hold for all inputs.

use gauss_density::specification::nested_sum;
use gauss_density::testing::globule;
use gauss_density::thesis::{self, Cut};
use gauss_density::{
    Cutoff, Elimination, Error, Interior, Levels, LowPass, Model, Options, PointSampler, Refit,
    RootDensity, Shape, Stop, eliminate, low_pass, refit, sample, sample_band,
};
use geom_core::grid::Brick;
use geom_core::testing::same_on_any_threads;
use geom_core::{Aabb, Cpu, ImplicitField, LatticeValues, Point3, Run, ScalarGrid};

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
            cutoff: Cutoff(eps),
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

/// How far chords of the lattice's values cross 1 beside the density itself, outwards: in the mean and in size, in edges.
#[test]
fn the_root_crosses_nearly_where_the_density_does() {
    fn off(model: &Model, values: &impl LatticeValues) -> [f64; 2] {
        let (mut sum, mut size, mut count) = (0.0, 0.0, 0.0);
        let lattice = *values.lattice();
        let mut row = vec![0.0; lattice.counts[0]];
        for line in 0..lattice.counts[1] * lattice.counts[2] {
            let start = [0, line % lattice.counts[1], line / lattice.counts[1]];
            values.read_row(start, &mut row);
            let origin = lattice.point(start);
            for (i, ends) in row.windows(2).enumerate() {
                let [a, b] = [ends[0], ends[1]].map(f64::from);
                assert_eq!(a, f64::from(values.at([i, start[1], start[2]])));
                if (a - 1.0) * (b - 1.0) >= 0.0 {
                    continue;
                }
                let at = |t: f64| {
                    let along = (i as f64 + t) * lattice.spacing;
                    nested_sum(model, &(origin + geom_core::Vector3::x() * along)) - 1.0
                };
                let (mut low, mut high) = (0.0, 1.0);
                for _ in 0..40 {
                    let middle = f64::midpoint(low, high);
                    if at(middle) * (a - 1.0) > 0.0 {
                        low = middle;
                    } else {
                        high = middle;
                    }
                }
                let outwards = ((1.0 - a) / (b - a) - low) * (a - b).signum();
                sum += outwards;
                size += outwards.abs();
                count += 1.0;
            }
        }
        [sum / count, size / count]
    }
    for (spacing, decay) in [(1.0, 0.5), (2.0, 0.2)] {
        let model = model(0.5, 1.0, decay);
        let options = Options {
            spacing,
            ..Options::default()
        };
        let grid = sample(&model, &options, Run::on(&Cpu)).unwrap().grid;
        let (density, root) = (off(&model, &grid), off(&model, &RootDensity(&grid)));
        assert!(density[0] > 0.02, "{density:?}");
        assert!(root[0].abs() < 0.3 * density[0], "{root:?} {density:?}");
        assert!(root[1] < 0.6 * density[1], "{root:?} {density:?}");
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

/// Against brute force, which has no floor, no band and no culls: a wrong exterior brick would be wrong in dense
/// sampling too.
#[test]
fn the_band_is_that_of_brute_force() {
    for (pr, pc, kappa) in SETS {
        for spacing in [0.45, 1.3] {
            let model = model(pr, pc, kappa);
            let options = Options {
                spacing,
                ..Options::default()
            };
            let all = thesis::all_atoms(&model, &options).unwrap().grid;
            let band = sample_band(&model, &options, Run::on(&Cpu)).unwrap().grid;
            let lattice = *all.lattice();
            // What the cut-off may leave out, and the rounding of both.
            let off = 1e-4 + 2.0 * 2e-4;
            let near_one = |p| (f64::from(all.at(p)) - 1.0).abs() < off;
            let mut crossings = 0;
            for i in 0..lattice.len() {
                let p = lattice.coordinates(i);
                let inside = all.at(p) >= 1.0;
                assert!(
                    near_one(p) || inside == (band.at(p) >= 1.0),
                    "sign at {p:?}"
                );
                for k in 0..3 {
                    let mut q = p;
                    q[k] += 1;
                    let crosses = q[k] < lattice.counts[k] && (all.at(q) >= 1.0) != inside;
                    if !crosses || near_one(p) || near_one(q) {
                        continue;
                    }
                    for end in [p, q] {
                        let (exact, got) = (f64::from(all.at(end)), f64::from(band.at(end)));
                        let brick = band.brick(end.map(|c| c / 8));
                        assert!(matches!(brick, Brick::Stored(_)), "no values at {end:?}");
                        let least = if exact >= 0.5 {
                            exact * (1.0 - off)
                        } else {
                            0.0
                        };
                        assert!(
                            got >= least && got <= exact * (1.0 + off),
                            "{got} for {exact}"
                        );
                    }
                    crossings += 1;
                }
            }
            assert!(crossings > 300, "{crossings} crossings");
        }
    }
}

#[test]
fn the_sampler_is_the_density_and_its_gradient_the_difference_quotient() {
    for (pr, pc, kappa) in SETS {
        let model = model(pr, pc, kappa);
        let sampler = PointSampler::new(&model, Cutoff(1e-9)).unwrap();
        let mut x = Point3::new(-14.0, 3.0, 1.0);
        while x.x < 14.0 {
            let exact = nested_sum(&model, &x);
            let (value, gradient) = sampler.value_gradient(&x);
            assert!(value <= exact * (1.0 + 1e-12));
            if exact >= 1e-9 {
                assert!(value >= exact * (1.0 - 2e-9));
            } else {
                x.x += 0.37;
                continue;
            }
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

#[test]
fn elimination_keeps_its_bound_at_every_sample_recomputed_by_brute_force() {
    for (pr, pc, kappa) in SETS {
        let model = model(pr, pc, kappa);
        for (stop, interior) in [
            (Stop::SkipFailing, Interior::KeepSolid),
            (Stop::FirstFailure, Interior::Hollow),
        ] {
            let epsilon = 0.02;
            let options = Elimination {
                epsilon,
                spacing: 0.9,
                stop,
                interior,
                ..Elimination::default()
            };
            let done = eliminate(&model, &options, Run::on(&Cpu)).unwrap();
            assert_eq!(done.kept.len(), done.model.atoms());
            assert!(done.report.worst_loss <= epsilon);
            // Lattice points of the band, and of the interior where it counts.
            let dense = Options {
                spacing: 0.9,
                band: done.report.band,
                bounds: None,
                cutoff: Cutoff(1e-5),
                ..Options::default()
            };
            let grid = sample(&model, &dense, Run::on(&Cpu)).unwrap().grid;
            let lattice = *grid.lattice();
            let [low, high] = done.report.band;
            let mut checked = 0;
            for i in 0..lattice.len() {
                let p = lattice.coordinates(i);
                let g = f64::from(grid.values()[i]);
                let inner = g >= high;
                let solid = interior == Interior::KeepSolid;
                if (g > low && g < high) || (inner && solid) {
                    let x = lattice.point(p);
                    let target = match solid {
                        true => nested_sum(&model, &x).min(high),
                        false => nested_sum(&model, &x),
                    };
                    let left = nested_sum(&done.model, &x);
                    // The grid's own rounding decides what is in the band.
                    let edge = (g - high).abs() < 1e-3 || (g - low).abs() < 1e-3;
                    let loss = (target - left) / target;
                    assert!(loss <= epsilon || edge, "{loss} lost at {p:?}");
                    checked += 1;
                }
            }
            assert!(checked > 50, "{checked} samples");
            if interior == Interior::KeepSolid {
                assert_eq!(done.report.comparison.lost_interior, 0.0);
            }
        }
    }
}

/// Samples of the interior lie two lattice steps apart, and a body of many small atoms could open between them: what
/// would, comes back.
#[test]
fn a_solid_body_opens_nowhere_between_its_samples() {
    let steps = -5..=5;
    let places: Vec<Point3> = steps
        .clone()
        .flat_map(|i| steps.clone().map(move |j| (i, j)))
        .flat_map(|(i, j)| steps.clone().map(move |k| [i, j, k]))
        .map(|p| Point3::from(p.map(|c| 1.1 * f64::from(c))))
        .filter(|p| p.coords.norm() < 5.6)
        .collect();
    let count = places.len();
    let model = Model::new(places, vec![0.8; count], vec![2.0; count], vec![]).unwrap();
    let options = Elimination {
        epsilon: 0.2,
        spacing: 0.5,
        ..Elimination::default()
    };
    let done = eliminate(&model, &options, Run::on(&Cpu)).unwrap();
    let report = done.report;
    assert!(
        report.put_back > 0 && report.remaining < count,
        "{report:?}"
    );
    assert_eq!(report.comparison.lost_interior, 0.0);
    assert!(report.worst_loss <= 0.2);
    let dense = Options {
        spacing: 0.5,
        ..Options::default()
    };
    let grid = sample(&model, &dense, Run::on(&Cpu)).unwrap().grid;
    let lattice = *grid.lattice();
    let cap = report.band[1];
    let inside = (0..lattice.len()).filter(|&i| f64::from(grid.values()[i]) >= cap);
    for x in inside.map(|i| lattice.point(lattice.coordinates(i))) {
        let left = nested_sum(&done.model, &x);
        assert!(left >= 0.8 * cap * (1.0 - 1e-4), "{left} at {x}");
    }
}

/// With samples half an Å apart, and crossings of lattice edges among them, the error of the new surface is
/// the bound itself, where the thesis has twice as much.
#[test]
fn the_error_on_the_new_surface_is_near_the_bound() {
    let model = model(0.5, 1.0, 0.4);
    for epsilon in [0.01, 0.05] {
        let options = Elimination {
            epsilon,
            spacing: 0.5,
            ..Elimination::default()
        };
        let report = eliminate(&model, &options, Run::on(&Cpu)).unwrap().report;
        assert!(report.remaining < report.atoms && report.first_failure.is_some());
        assert!(report.comparison.points > 1000);
        let error = report.comparison.surface_max;
        assert!(error > 0.2 * epsilon && error < 1.2 * epsilon, "{report:?}");
    }
}

#[test]
fn elimination_of_nothing_and_of_protected_atoms() {
    let mut model = model(0.5, 1.0, 0.5);
    let off = Elimination {
        epsilon: 0.0,
        ..Elimination::default()
    };
    let done = eliminate(&model, &off, Run::on(&Cpu)).unwrap();
    assert_eq!(done.model, model);

    let first_chain = 0..84;
    let options = Elimination {
        epsilon: 0.1,
        spacing: 1.0,
        ..Elimination::default()
    };
    let plain = eliminate(&model, &options, Run::on(&Cpu)).unwrap();
    assert!(plain.kept.len() < 200, "{} kept", plain.kept.len());
    assert!(first_chain.clone().any(|a| !plain.kept.contains(&a)));
    model
        .protect(first_chain.clone().map(|a| a as usize))
        .unwrap();
    let kept = eliminate(&model, &options, Run::on(&Cpu)).unwrap();
    assert_eq!(kept.report.protected, 84);
    assert!(first_chain.clone().all(|a| kept.kept.contains(&a)));
    assert!(kept.kept.len() < 252);

    // And the refit leaves them alone.
    let quick = Refit {
        spacing: 1.0,
        iterations: 15,
        ..Refit::default()
    };
    let fit = refit(&kept.model, &model, &quick, Run::on(&Cpu)).unwrap();
    for (i, _) in kept.kept.iter().enumerate().filter(|k| *k.1 < 84) {
        assert_eq!(fit.model.centers()[i], kept.model.centers()[i]);
        assert_eq!(fit.model.decays()[i], kept.model.decays()[i]);
    }
    assert!(fit.report.objective[1] < fit.report.objective[0]);
}

#[test]
fn the_refit_lowers_the_error_within_its_bounds() {
    for (pr, kappa) in [(0.5, 0.5), (0.25, 0.5)] {
        let model = model(pr, 1.0, kappa);
        let options = Elimination {
            epsilon: 0.02,
            spacing: 0.7,
            ..Elimination::default()
        };
        let done = eliminate(&model, &options, Run::on(&Cpu)).unwrap();
        let options = Refit {
            spacing: 0.7,
            iterations: 60,
            ..Refit::default()
        };
        let fit = refit(&done.model, &model, &options, Run::on(&Cpu)).unwrap();
        let report = &fit.report;
        assert!(
            report.objective[1] < 0.1 * report.objective[0],
            "{report:?}"
        );
        assert!(report.worst[1] < 0.7 * report.worst[0], "{report:?}");
        let [before, after] = report.comparison;
        assert!(after.surface_rms < 0.6 * before.surface_rms, "{report:?}");
        for a in 0..fit.model.atoms() {
            let moved = fit.model.centers()[a] - done.model.centers()[a];
            assert!(moved.amax() <= 0.5 + 1e-12);
            assert!((fit.model.radii()[a] - done.model.radii()[a]).abs() <= 0.5 + 1e-12);
            assert!((fit.model.decays()[a] - kappa).abs() <= 0.2 + 1e-12);
            assert!(fit.model.decays()[a] >= 0.05 && fit.model.radii()[a] >= 0.0);
        }
    }
}

#[test]
fn results_do_not_depend_on_the_number_of_threads() {
    let model = model(0.25, 0.8, 0.5);
    let options = Options {
        spacing: 0.8,
        ..Options::default()
    };
    let dense = same_on_any_threads(|| sample(&model, &options, Run::on(&Cpu)).unwrap());
    same_on_any_threads(|| sample_band(&model, &options, Run::on(&Cpu)).unwrap());
    let elimination = Elimination {
        spacing: 1.0,
        ..Elimination::default()
    };
    let done = same_on_any_threads(|| eliminate(&model, &elimination, Run::on(&Cpu)).unwrap());
    let quick = Refit {
        spacing: 1.0,
        iterations: 10,
        ..Refit::default()
    };
    same_on_any_threads(|| refit(&done.model, &model, &quick, Run::on(&Cpu)).unwrap());
    same_on_any_threads(|| low_pass(&dense.grid, &LowPass::default()).unwrap());
}

#[test]
fn every_search_of_the_thesis_finds_the_same_density() {
    let model = model(0.3, 0.8, 0.5);
    let options = Options {
        spacing: 1.2,
        cutoff: Cutoff(1e-3),
        ..Options::default()
    };
    let all = thesis::all_atoms(&model, &options).unwrap();
    let lattice = *all.grid.lattice();
    assert_eq!(all.report.pairs, 252 * lattice.len() as u64);
    for (i, &got) in all.grid.values().iter().enumerate().step_by(11) {
        let exact = nested_sum(&model, &lattice.point(lattice.coordinates(i)));
        assert!((f64::from(got) - exact).abs() <= 2e-4 * exact + 1e-19);
    }
    let trees = [thesis::kd_tree, thesis::hierarchy]
        .map(|search| search(&model, &options, Cut::AfterPowers).unwrap());
    let blocks = sample(&model, &options, Run::on(&Cpu)).unwrap();
    for other in trees.iter().chain([&blocks]) {
        assert!(other.report.pairs < all.report.pairs);
        for (&a, &b) in all.grid.values().iter().zip(other.grid.values()) {
            if a >= 1e-3 {
                assert!((a - b).abs() <= 1.2e-3 * a, "{b} for {a}");
            }
        }
    }
    assert_eq!(trees[0].grid, trees[1].grid);
}

#[test]
fn searches_of_the_thesis_heed_the_cut_and_refuse_nonsense() {
    let model = model(0.5, 1.0, 1.0);
    let options = |eps| Options {
        spacing: 0.6,
        cutoff: Cutoff(eps),
        ..Options::default()
    };
    let pairs = |eps, cut| {
        let seeded = thesis::single_seed(&model, &options(eps), cut);
        seeded.unwrap().report.pairs
    };
    assert!(pairs(1e-2, Cut::AfterPowers) < pairs(1e-6, Cut::AfterPowers));
    assert!(pairs(1e-4, Cut::Bare(1e-2)) < pairs(1e-4, Cut::Bare(1e-6)));
    let wide = thesis::all_atoms(&model, &options(1e-2)).unwrap();
    let blocks = sample(&model, &options(1e-2), Run::on(&Cpu)).unwrap();
    assert!(wide.report.pairs > blocks.report.pairs);
    for eps in [0.0, 0.25, f64::NAN] {
        let error = thesis::hierarchy(&model, &options(1e-4), Cut::Bare(eps)).unwrap_err();
        assert!(error.to_string().contains("option cut"), "{error}");
    }
    let little = Options {
        max_memory: 1 << 10,
        ..options(1e-4)
    };
    let error = thesis::all_atoms(&model, &little).unwrap_err();
    assert!(
        matches!(error, Error::GridTooLarge { limit: 1024, .. }),
        "{error}"
    );
}

/// Kernels below ε count as zero, point by point, before the powers; points at which a kernel is near ε are left
/// out.
#[test]
fn the_bare_cut_leaves_out_kernels_point_by_point() {
    let (eps, mut compared, mut changed) = (1e-3f64, 0, 0);
    for (pr, pc, kappa) in SETS {
        let model = model(pr, pc, kappa);
        let options = Options {
            spacing: 2.1,
            ..Options::default()
        };
        let searches = [thesis::kd_tree, thesis::hierarchy];
        let [a, b] = searches.map(|search| search(&model, &options, Cut::Bare(eps)).unwrap());
        assert_eq!(a.grid, b.grid);
        let lattice = *a.grid.lattice();
        for (i, &got) in a.grid.values().iter().enumerate() {
            let x = lattice.point(lattice.coordinates(i));
            let ln = |atom: usize| {
                let squared = (x - model.centers()[atom]).norm_squared();
                model.decays()[atom] * (model.radii()[atom].powi(2) - squared)
            };
            if (0..252).any(|atom| (ln(atom) - eps.ln()).abs() < 1e-9) {
                continue;
            }
            // As the equations read, with sums that hold: 252 atoms, seven to a residue, twelve residues to a chain.
            let residue = |r: usize| {
                let kept = (7 * r..7 * r + 7).map(ln).filter(|ln| *ln >= eps.ln());
                kept.map(f64::exp).sum::<f64>().powf(pr)
            };
            let chain = |c: usize| (12 * c..12 * c + 12).map(residue).sum::<f64>().powf(pc);
            let exact: f64 = (0..3).map(chain).sum();
            assert!(
                (f64::from(got) - exact).abs() <= 1e-6 * exact,
                "{got} for {exact}"
            );
            compared += 1;
            changed += usize::from(exact < 0.99 * nested_sum(&model, &x));
        }
    }
    assert!(
        compared > 5000 && changed > 1000,
        "{compared} compared, {changed} changed"
    );
}

/// Two balls far off the centre line and a hollow shell: the tiles find every component and the cavity, the
/// thesis's search from one seed does not.
#[test]
fn no_component_and_no_cavity_is_missed_unless_it_is_searched_from_one_seed() {
    let mut centers = vec![
        Point3::new(-14.0, 13.0, 12.0),
        Point3::new(14.0, -12.0, -13.0),
    ];
    // A shell of radius 7 with a cavity of radius 5.
    for i in 0..600 {
        let z: f64 = 1.0 - 2.0 * (f64::from(i) + 0.5) / 600.0;
        let (r, phi) = ((1.0 - z * z).sqrt(), f64::from(i) * 2.399_963);
        centers.push(Point3::new(r * phi.cos(), r * phi.sin(), z) * 7.0);
    }
    let n = centers.len();
    let model = Model::new(centers, vec![1.7; n], vec![2.0; n], vec![]).unwrap();
    let options = Options {
        spacing: 0.7,
        ..Options::default()
    };
    let components = |values: &dyn LatticeValues| {
        let lattice = *values.lattice();
        let inside: Vec<bool> = (0..lattice.len())
            .map(|i| values.at(lattice.coordinates(i)) >= 1.0)
            .collect();
        let count = |of: bool| {
            let mut seen = vec![false; lattice.len()];
            let mut found = 0;
            for start in 0..lattice.len() {
                if seen[start] || inside[start] != of {
                    continue;
                }
                found += 1;
                let mut open = vec![start];
                seen[start] = true;
                while let Some(i) = open.pop() {
                    let p = lattice.coordinates(i);
                    for k in 0..3 {
                        for up in [false, true] {
                            let mut q = p;
                            if up {
                                q[k] += 1;
                            } else if q[k] > 0 {
                                q[k] -= 1;
                            }
                            if q[k] < lattice.counts[k] {
                                let j = lattice.index(q);
                                if !seen[j] && inside[j] == of {
                                    seen[j] = true;
                                    open.push(j);
                                }
                            }
                        }
                    }
                }
            }
            found
        };
        (count(true), count(false))
    };
    let band = sample_band(&model, &options, Run::on(&Cpu)).unwrap();
    assert_eq!(components(&band.grid), (3, 2));
    let dense = sample(&model, &options, Run::on(&Cpu)).unwrap();
    assert_eq!(components(&dense.grid), (3, 2));
    let seeded = thesis::single_seed(&model, &options, Cut::AfterPowers).unwrap();
    assert_eq!(components(&seeded.grid), (1, 1));
}

#[test]
fn two_atoms_merge_at_the_distance_of_the_closed_form() {
    let (r, kappa, power) = (1.7f64, 1.0f64, 0.5f64);
    for in_one_residue in [true, false] {
        let gain = 2.0f64.ln() / if in_one_residue { kappa } else { kappa * power };
        let merge = 2.0 * (r * r + gain).sqrt();
        for (factor, joined) in [(0.98, true), (1.02, false)] {
            let a = merge * factor;
            let starts = if in_one_residue {
                vec![0, 2]
            } else {
                vec![0, 1, 2]
            };
            let nodes = starts.len() - 1;
            let model = Model::new(
                vec![Point3::origin(), Point3::new(a, 0.0, 0.0)],
                vec![r; 2],
                vec![kappa; 2],
                vec![(starts, vec![power; nodes])],
            )
            .unwrap();
            let middle = nested_sum(&model, &Point3::new(a / 2.0, 0.0, 0.0));
            assert_eq!(middle >= 1.0, joined);
            if joined {
                // The neck.
                let rho = (r * r - a * a / 4.0 + gain).sqrt();
                let neck = nested_sum(&model, &Point3::new(a / 2.0, rho, 0.0));
                assert!((neck - 1.0).abs() < 1e-12);
            }
            let options = Options {
                spacing: 0.1,
                ..Options::default()
            };
            let grid = sample_band(&model, &options, Run::on(&Cpu)).unwrap().grid;
            let lattice = *grid.lattice();
            let at = |x: f64| {
                let p = ((Point3::new(x, 0.0, 0.0) - lattice.origin) / 0.1).map(|c| c.round());
                grid.at([p.x as usize, p.y as usize, p.z as usize]) >= 1.0
            };
            assert!(at(0.0) && at(a));
            let along = (0..=100).all(|i| at(a * f64::from(i) / 100.0));
            assert_eq!(along, joined);
        }
    }
}

#[test]
fn order_of_atoms_and_whole_cells_do_not_matter() {
    let structure = globule(2, 8, 5);
    let atoms = structure.atoms();
    let levels = [0.3, 0.8];
    let build = |order: &[usize]| {
        let centers = order.iter().map(|&a| atoms[a].position).collect();
        let radii = order.iter().map(|&a| atoms[a].radius).collect();
        let residues: Vec<u32> = (0..=16).map(|r| 7 * r).collect();
        let tree = vec![
            (residues, vec![levels[0]; 16]),
            (vec![0, 8, 16], vec![levels[1]; 2]),
        ];
        Model::new(centers, radii, vec![0.7; 112], tree).unwrap()
    };
    let straight: Vec<usize> = (0..112).collect();
    // Chains swapped, residues backwards, atoms rotated within theirs.
    let turned: Vec<usize> = (0..112)
        .map(|i| {
            let (residue, atom) = (i / 7, i % 7);
            (15 - residue) * 7 + (atom + 3) % 7
        })
        .collect();
    let (a, b) = (build(&straight), build(&turned));
    for i in 0..200 {
        let t = f64::from(i);
        let x = Point3::new((t * 0.7).sin(), (t * 1.1).cos(), (t * 1.9).sin()) * 12.0;
        let (ga, gb) = (nested_sum(&a, &x), nested_sum(&b, &x));
        assert!((ga - gb).abs() <= 1e-13 * ga.max(1e-300), "{ga} {gb}");
    }
    // A shift by whole cells of a spacing and coordinates that are exact.
    let shift = geom_core::Vector3::new(32.0, -16.0, 8.0);
    let exact = |p: Point3| (p * 1024.0).map(|c| c.round()) / 1024.0;
    let moved = |by: geom_core::Vector3| {
        let centers = atoms.iter().map(|a| exact(a.position) + by).collect();
        let tree = vec![((0..=16).map(|r| 7 * r).collect(), vec![0.3; 16])];
        Model::new(
            centers,
            atoms.iter().map(|a| a.radius).collect(),
            vec![0.7; 112],
            tree,
        )
        .unwrap()
    };
    let options = |by: geom_core::Vector3| Options {
        spacing: 0.5,
        bounds: Some(Aabb::new(
            Point3::new(-20.0, -20.0, -20.0) + by,
            Point3::new(20.0, 20.0, 20.0) + by,
        )),
        ..Options::default()
    };
    let zero = geom_core::Vector3::zeros();
    let here = sample(&moved(zero), &options(zero), Run::on(&Cpu)).unwrap();
    let there = sample(&moved(shift), &options(shift), Run::on(&Cpu)).unwrap();
    assert_eq!(here.grid.values(), there.grid.values());
}

/// The derivative at 0 from four values: its error falls with the fourth power of the step, so that the step
/// can be wide enough for rounding not to matter.
fn quotient(step: f64, f: impl Fn(f64) -> f64) -> f64 {
    let between = |by: f64| f(by * step) - f(-by * step);
    (8.0 * between(1.0) - between(2.0)) / (12.0 * step)
}

#[test]
fn derivatives_are_difference_quotients() {
    let model = model(0.25, 0.7, 0.6);
    let sampler = PointSampler::new(&model, Cutoff(1e-12)).unwrap();
    let mut checked = 0;
    for i in 0..40 {
        let t = f64::from(i);
        let x = Point3::new((t * 0.7).sin(), (t * 1.1).cos(), (t * 1.9).sin()) * 11.0;
        let (g, gradient, hessian) = sampler.value_gradient_hessian(&x);
        for k in 0..3 {
            let at = |by: f64| {
                let mut x = x;
                x[k] += by;
                sampler.value_gradient(&x)
            };
            let slope = quotient(1e-3, |by| at(by).0);
            assert!((slope - gradient[k]).abs() <= 1e-7 * (gradient.norm() + g));
            let scale = hessian.norm() + gradient.norm();
            for row in 0..3 {
                let slope = quotient(1e-3, |by| at(by).1[row]);
                assert!(
                    (slope - hessian[(row, k)]).abs() <= 1e-7 * scale,
                    "{hessian}"
                );
            }
        }
        for of in sampler.parameter_gradient(&x) {
            let a = of.atom as usize;
            let with = |change: [f64; 5], by: f64| {
                let mut centers = model.centers().to_vec();
                let mut radii = model.radii().to_vec();
                let mut decays = model.decays().to_vec();
                for k in 0..3 {
                    centers[a][k] += change[k] * by;
                }
                radii[a] += change[3] * by;
                decays[a] += change[4] * by;
                let tree = model
                    .levels()
                    .iter()
                    .map(|l| {
                        let mut starts: Vec<u32> =
                            (0..l.len()).map(|v| l.children(v).start as u32).collect();
                        starts.push(l.children(l.len() - 1).end as u32);
                        (starts, l.powers().to_vec())
                    })
                    .collect();
                nested_sum(&Model::new(centers, radii, decays, tree).unwrap(), &x)
            };
            let analytic = [of.center.x, of.center.y, of.center.z, of.radius, of.decay];
            let scale = analytic.iter().fold(0.0f64, |m, v| m.max(v.abs()));
            if scale < 1e-6 * g || g < 1e-6 {
                continue;
            }
            for p in 0..5 {
                let mut change = [0.0; 5];
                change[p] = 1.0;
                // A decay acts with the square of the distance, 100 Å² and more.
                let step = if p == 4 { 1e-4 } else { 1e-3 };
                let slope = quotient(step, |by| with(change, by));
                assert!(
                    (slope - analytic[p]).abs() <= 1e-7 * scale + 1e-10 * g,
                    "parameter {p}"
                );
                checked += 1;
            }
        }
    }
    assert!(checked > 200, "{checked} derivatives");
}

/// Spheres have the mean curvature 1/r, positive.
#[test]
fn mean_curvature_of_one_atom() {
    let model = Model::new(vec![Point3::origin()], vec![1.7], vec![0.8], vec![]).unwrap();
    let sampler = PointSampler::new(&model, Cutoff(1e-6)).unwrap();
    let x = Point3::new(1.0, 1.2, -0.6);
    let expected = 1.0 / x.coords.norm();
    assert!((sampler.mean_curvature(&x) - expected).abs() < 1e-12);
}

#[test]
fn the_low_pass_filter_smooths_without_new_surfaces() {
    let model = model(0.5, 1.0, 1.0);
    let options = Options {
        spacing: 0.7,
        margin: Some(9.0),
        floor: Some(1e-3),
        ..Options::default()
    };
    let grid = sample(&model, &options, Run::on(&Cpu)).unwrap().grid;
    let volume = |grid: &ScalarGrid| grid.values().iter().filter(|&&v| v >= 1.0).count() as f64;
    let crossings = |grid: &ScalarGrid| {
        let counts = grid.lattice().counts;
        (0..grid.lattice().len())
            .filter(|&i| {
                let mut p = grid.lattice().coordinates(i);
                p[0] += 1;
                p[0] < counts[0] && (grid.at(p) >= 1.0) != (grid.values()[i] >= 1.0)
            })
            .count() as f64
    };
    // A cut-off below the spacing changes nothing that a lattice can see.
    let same = low_pass(
        &grid,
        &LowPass {
            cutoff_length: 1e-3,
            ..LowPass::default()
        },
    )
    .unwrap();
    for (&a, &b) in grid.values().iter().zip(same.values()) {
        let phi = |g: f32| g / (1.0 + g);
        assert!((phi(a) - phi(b)).abs() < 2e-4);
    }
    let mut last = crossings(&grid);
    for cutoff_length in [2.0, 4.0] {
        for shape in [Shape::Ideal, Shape::Butterworth, Shape::Gaussian] {
            let smooth = low_pass(
                &grid,
                &LowPass {
                    cutoff_length,
                    shape,
                    ..LowPass::default()
                },
            )
            .unwrap();
            let share = volume(&smooth) / volume(&grid);
            assert!(
                (0.8..1.1).contains(&share),
                "{shape:?} at {cutoff_length}: volume {share}"
            );
            assert!(crossings(&smooth) < crossings(&grid));
        }
        let smooth = low_pass(
            &grid,
            &LowPass {
                cutoff_length,
                ..LowPass::default()
            },
        )
        .unwrap();
        assert!(crossings(&smooth) < last);
        last = crossings(&smooth);
    }
    let little = LowPass {
        max_memory: 1 << 10,
        ..LowPass::default()
    };
    assert!(
        low_pass(&grid, &little)
            .unwrap_err()
            .to_string()
            .contains("bytes")
    );
}

#[test]
fn bad_input_is_named() {
    let one = |x: f64, radius: f64, decay: f64| {
        Model::new(
            vec![Point3::new(x, 0.0, 0.0)],
            vec![radius],
            vec![decay],
            vec![],
        )
    };
    assert!(matches!(
        Model::new(vec![], vec![], vec![], vec![]),
        Err(Error::NoAtoms)
    ));
    assert!(matches!(
        one(f64::NAN, 1.0, 1.0),
        Err(Error::BadAtom {
            atom: 0,
            field: "x",
            ..
        })
    ));
    assert!(matches!(
        one(0.0, -1.0, 1.0),
        Err(Error::BadAtom {
            field: "radius",
            ..
        })
    ));
    assert!(matches!(
        one(0.0, 1.0, 0.0),
        Err(Error::BadAtom {
            atom: 0,
            field: "decay",
            ..
        })
    ));
    assert!(matches!(
        one(0.0, 1.0, f64::NAN),
        Err(Error::BadAtom { .. })
    ));
    let model = one(0.0, 1.7, 1.0).unwrap();
    let refused = |options: Options| {
        let dense = sample(&model, &options, Run::on(&Cpu)).unwrap_err();
        let band = sample_band(&model, &options, Run::on(&Cpu)).unwrap_err();
        assert_eq!(dense.to_string(), band.to_string());
        assert!(matches!(dense, Error::Option(_)));
    };
    for spacing in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        refused(Options {
            spacing,
            ..Options::default()
        });
    }
    refused(Options {
        cutoff: Cutoff(0.25),
        ..Options::default()
    });
    refused(Options {
        cutoff: Cutoff(0.0),
        ..Options::default()
    });
    refused(Options {
        band: [1.1, 2.0],
        ..Options::default()
    });
    let huge = Options {
        spacing: 1e-3,
        ..Options::default()
    };
    let error = sample(&model, &huge, Run::on(&Cpu)).unwrap_err();
    let Error::GridTooLarge {
        spacing, points, ..
    } = error
    else {
        panic!("{error}")
    };
    assert!(points > 1 << 30);
    let fits = Options { spacing, ..huge };
    assert!(sample_band(&model, &fits, Run::on(&Cpu)).is_ok());
    // A band that turns out too large on the way says what fits, too, not what would fit if that were all of it.
    let narrow = Options {
        spacing: 0.03,
        max_memory: 4 << 20,
        ..Options::default()
    };
    let Err(Error::GridTooLarge { spacing, bytes, .. }) =
        sample_band(&model, &narrow, Run::on(&Cpu))
    else {
        panic!("4 MB are not enough");
    };
    assert!(bytes > 4 << 20);
    let fits = Options { spacing, ..narrow };
    assert!(sample_band(&model, &fits, Run::on(&Cpu)).is_ok());
    let endless = Options {
        spacing: 1e-6,
        ..Options::default()
    };
    assert!(matches!(
        sample(&model, &endless, Run::on(&Cpu)),
        Err(Error::GridTooLarge { .. })
    ));
    let wrong = Elimination {
        epsilon: -0.1,
        ..Elimination::default()
    };
    assert!(eliminate(&model, &wrong, Run::on(&Cpu)).is_err());
}

/// A radius of 0 is a kernel of height 1 that touches 1 in a point; coincident atoms and one atom are fine.
#[test]
fn borderline_input_is_fine() {
    let point = Model::new(vec![Point3::origin()], vec![0.0], vec![1.0], vec![]).unwrap();
    let sampled = sample_band(&point, &Options::default(), Run::on(&Cpu)).unwrap();
    assert!(!sampled.report.touches_any_side());
    let lattice = *sampled.grid.lattice();
    let inside = (0..lattice.len())
        .filter(|&i| sampled.grid.at(lattice.coordinates(i)) >= 1.0)
        .count();
    assert!(inside <= 1);
    let cut = Options {
        bounds: Some(Aabb::new(Point3::origin(), Point3::new(8.0, 8.0, 8.0))),
        ..Options::default()
    };
    let ball = Model::new(
        vec![Point3::origin(); 3],
        vec![1.7; 3],
        vec![1.0; 3],
        vec![],
    )
    .unwrap();
    let report = sample(&ball, &cut, Run::on(&Cpu)).unwrap().report;
    assert_eq!(report.touches_box, [[true, false]; 3]);
}

#[test]
fn powers_are_set_by_selector() {
    let structure = globule(3, 4, 1);
    let mut model = Model::uniform(&structure, &Levels::default()).unwrap();
    let strong = Levels {
        residue_power: 1.0,
        chain_power: 2.0,
        decay: 3.0,
        ..Levels::default()
    };
    model
        .emphasize_selected(&structure, &"1".parse().unwrap(), &strong)
        .unwrap();
    assert_eq!(model.levels()[1].powers(), [1.0, 2.0, 1.0]);
    assert_eq!(
        model.levels()[0].powers()[..8],
        [0.5, 0.5, 0.5, 0.5, 1.0, 1.0, 1.0, 1.0]
    );
    assert!((28..56).all(|a| model.is_protected(a) && model.decays()[a] == 3.0));
    assert!(!model.is_protected(27) && model.decays()[56] == 1.0);
    model
        .emphasize_selected(&structure, &"2:2-3".parse().unwrap(), &strong)
        .unwrap();
    assert_eq!(model.levels()[0].powers()[8..], [0.5, 1.0, 1.0, 0.5]);
    assert_eq!(
        model.levels()[1].powers()[2],
        1.0,
        "not all of the chain is selected"
    );
    let none = model.emphasize_selected(&structure, &"X".parse().unwrap(), &strong);
    assert!(matches!(none, Err(Error::Select(_))));
    let other = globule(1, 4, 1);
    let error = model.selected(&other, &"1".parse().unwrap()).unwrap_err();
    assert!(error.to_string().contains("28 atoms"), "{error}");
}

/// A lattice that goes on far beyond an atom costs no more pairs and says the same near it.
#[test]
fn pairs_do_not_grow_with_empty_space() {
    let model = Model::new(vec![Point3::origin()], vec![1.7], vec![1.0], vec![]).unwrap();
    let up_to = |x: f64| {
        let low = Point3::new(-8.0, -8.0, -8.0);
        let options = Options {
            spacing: 0.5,
            bounds: Some(Aabb::new(low, Point3::new(x, 8.0, 8.0))),
            ..Options::default()
        };
        [
            sample(&model, &options, Run::on(&Cpu)).unwrap().report,
            sample_band(&model, &options, Run::on(&Cpu)).unwrap().report,
        ]
    };
    let (near, far) = (up_to(30.0), up_to(600.0));
    for (near, far) in near.iter().zip(&far) {
        assert!(far.points > 10 * near.points && near.pairs > 0);
        assert_eq!(near.pairs, far.pairs);
    }
    assert_eq!(near[1].stored_points, far[1].stored_points);
}
