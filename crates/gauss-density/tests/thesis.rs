//! Real structures: the bundled ones, and larger ones where they are at hand.

use gauss_density::specification::nested_sum;
use gauss_density::thesis::{self, Cut};
use gauss_density::{Levels, Model, Options, sample, sample_band};
use geom_core::io::structure::{ReadOptions, read};
use geom_core::{Cpu, LatticeValues, Run, ScalarGrid, Structure};

fn levels(residue_power: f64, chain_power: f64, decay: f64) -> Levels {
    Levels {
        residue_power,
        chain_power,
        decay,
        ..Levels::default()
    }
}

/// Signs of the band are those of the dense grid at every point, and both ends of every edge that crosses
/// the surface have the same values. Gives the number of crossings.
fn band_is_dense(structure: &Structure, levels: &Levels, spacing: f64) -> usize {
    let model = Model::uniform(structure, levels).unwrap();
    let options = Options {
        spacing,
        floor: Some(0.5),
        ..Options::default()
    };
    let dense = sample(&model, &options, Run::on(&Cpu)).unwrap().grid;
    let band = sample_band(&model, &options, Run::on(&Cpu)).unwrap().grid;
    let lattice = *dense.lattice();
    let mut crossings = 0;
    for i in 0..lattice.len() {
        let p = lattice.coordinates(i);
        let inside = dense.at(p) >= 1.0;
        assert_eq!(inside, band.at(p) >= 1.0, "sign at {p:?}");
        for k in 0..3 {
            let mut q = p;
            q[k] += 1;
            if q[k] < lattice.counts[k] && (dense.at(q) >= 1.0) != inside {
                assert_eq!((dense.at(p), dense.at(q)), (band.at(p), band.at(q)));
                crossings += 1;
            }
        }
    }
    crossings
}

#[test]
fn the_band_of_bundled_structures_is_that_of_the_dense_grid() {
    for name in ["1AJJ.pdb", "1orc.pdb"] {
        let structure = read(fixtures::path(name), &ReadOptions::default())
            .unwrap()
            .structure;
        for (pr, pc) in [(0.5, 1.0), (0.25, 1.0), (0.05, 0.5)] {
            let crossings = band_is_dense(&structure, &levels(pr, pc, 1.0), 0.6);
            assert!(crossings > 3000, "{name}: {crossings}");
        }
    }
}

#[test]
fn the_band_of_larger_structures_is_that_of_the_dense_grid() {
    for (file, spacing, assembly) in [
        ("pdb/1a63.pqr", 0.5, None),
        ("pdb/2nwl_opm.pdb.gz", 1.0, None),
        ("large/4v8r_h36.pdb.gz", 4.0, None),
        ("large/1fha.pdb", 2.0, Some("1".to_owned())),
    ] {
        let Some(path) = fixtures::shared_or_skip(file) else {
            continue;
        };
        let options = ReadOptions {
            assembly,
            ..ReadOptions::default()
        };
        let structure = read(&path, &options).unwrap().structure;
        let mut sets = vec![(0.25, 1.0, 0.5)];
        if file.starts_with("pdb/") {
            sets.extend([(0.5, 1.0, 1.0), (0.05, 0.5, 1.0)]);
        }
        for (residue, chain, decay) in sets {
            let crossings = band_is_dense(&structure, &levels(residue, chain, decay), spacing);
            assert!(crossings > 3000, "{file}: {crossings}");
        }
    }
}

/// Ferritin is a shell: its cavity is found, although nothing leads there from the outside.
#[test]
fn the_cavity_of_a_shell_is_found() {
    let Some(path) = fixtures::shared_or_skip("large/1fha.pdb") else {
        return;
    };
    let options = ReadOptions {
        assembly: Some("1".to_owned()),
        ..ReadOptions::default()
    };
    let structure = read(&path, &options).unwrap().structure;
    let model = Model::uniform(&structure, &levels(0.25, 1.0, 0.2)).unwrap();
    let options = Options {
        spacing: 2.5,
        ..Options::default()
    };
    let grid = sample_band(&model, &options, Run::on(&Cpu)).unwrap().grid;
    let lattice = *grid.lattice();
    let mut seen = vec![false; lattice.len()];
    let mut sizes = Vec::new();
    for start in 0..lattice.len() {
        let outside = |i: usize| grid.at(lattice.coordinates(i)) < 1.0;
        if seen[start] || !outside(start) {
            continue;
        }
        let (mut open, mut size) = (vec![start], 0);
        seen[start] = true;
        while let Some(i) = open.pop() {
            size += 1;
            let p = lattice.coordinates(i);
            for k in 0..3 {
                for up in [false, true] {
                    let mut q = p;
                    q[k] = if up { q[k] + 1 } else { q[k].wrapping_sub(1) };
                    if q[k] < lattice.counts[k] {
                        let j = lattice.index(q);
                        if !seen[j] && outside(j) {
                            seen[j] = true;
                            open.push(j);
                        }
                    }
                }
            }
        }
        sizes.push(size);
    }
    sizes.sort_unstable();
    let second = sizes.len().checked_sub(2).map_or(0, |i| sizes[i]);
    // A ball of 35 Å radius holds 1.8e5 Å³; half of it, in points of 15.6 Å³.
    assert!(second > 5000, "regions of the outside: {sizes:?}");
}

/// The thesis's cut equals the model for powers from 1/2, and is another surface for small ones.
#[test]
fn the_bare_cut_is_another_model_for_small_powers() {
    let structure = read(fixtures::path("1AJJ.pdb"), &ReadOptions::default())
        .unwrap()
        .structure;
    let share_inside = |pr: f64, pc: f64, kappa: f64| {
        let model = Model::uniform(&structure, &levels(pr, pc, kappa)).unwrap();
        let options = Options {
            spacing: 1.5,
            margin: Some(14.0),
            ..Options::default()
        };
        let bare = thesis::hierarchy(&model, &options, Cut::Bare(1e-6)).unwrap();
        let usual = sample(&model, &options, Run::on(&Cpu)).unwrap();
        let inside = |grid: &ScalarGrid| grid.values().iter().filter(|&&g| g >= 1.0).count();
        inside(&bare.grid) as f64 / inside(&usual.grid) as f64
    };
    assert!((share_inside(0.5, 1.0, 1.0) - 1.0).abs() < 2e-3);
    assert!((share_inside(1.0, 1.0, 1.0) - 1.0).abs() < 1e-9);
    assert!(share_inside(0.25, 1.0, 1.0) > 0.95);
    // Much of the body lies beyond the reach of every kernel above 1e-6.
    assert!(share_inside(0.05, 0.5, 1.0) < 0.85);
}

/// The default margin is wide enough for every set of powers.
#[test]
fn the_default_margin_never_cuts_the_body() {
    let structure = read(fixtures::path("1AJJ.pdb"), &ReadOptions::default())
        .unwrap()
        .structure;
    for (pr, pc, kappa) in [(0.5, 1.0, 1.0), (0.05, 0.5, 1.0), (0.25, 1.0, 0.1)] {
        let model = Model::uniform(&structure, &levels(pr, pc, kappa)).unwrap();
        let options = Options {
            spacing: 2.0,
            ..Options::default()
        };
        let sampled = sample_band(&model, &options, Run::on(&Cpu)).unwrap();
        assert!(!sampled.report.touches_any_side());
        // Density below the band on the box.
        let corner = sampled.grid.lattice().bounds().min;
        assert!(nested_sum(&model, &corner) < 0.5);
    }
}

/// Near the surface, where all of them look.
#[test]
fn every_search_of_the_thesis_gives_the_same_density_near_the_surface() {
    let structure = read(fixtures::path("1AJJ.pdb"), &ReadOptions::default())
        .unwrap()
        .structure;
    let model = Model::uniform(&structure, &Levels::default()).unwrap();
    let options = Options {
        spacing: 1.5,
        ..Options::default()
    };
    let all = thesis::all_atoms(&model, &options).unwrap();
    assert_eq!(all.report.pairs as f64, all.report.brute_force_pairs);
    for search in [thesis::single_seed, thesis::kd_tree, thesis::hierarchy] {
        let found = search(&model, &options, Cut::AfterPowers).unwrap();
        assert!(found.report.pairs < all.report.pairs);
        let values = all.grid.values().iter().zip(found.grid.values());
        let near = values.filter(|(a, _)| (0.9..1.1).contains(*a));
        let mut compared = 0;
        for (a, b) in near {
            assert!((a - b).abs() < 2e-3, "{b} instead of {a}");
            compared += 1;
        }
        assert!(compared > 50, "{compared} points near the surface");
    }
}
