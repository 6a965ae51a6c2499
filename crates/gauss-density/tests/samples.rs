//! Samples on lattices: bricks that are crossed, roots on edges, points of refits, what a filter pads.

use std::collections::BTreeMap;

use gauss_density::testing::globule;
use gauss_density::{
    Cutoff, Error, Levels, LowPass, Model, Options, PointSampler, inside, low_pass, sample_band,
};
use geom_core::grid::{BRICK, BRICK_POINTS, Brick, LatticeValues};
use geom_core::{Aabb, Cpu, ImplicitField, Lattice, Point3, Run, ScalarGrid, Vector3};

/// Interior bricks that the surface crosses, as masks by block, of two bricks along an axis, a stored one and an interior one, with one value below 1 in a layer of the stored one.
fn crossed(axis: usize, interior_is_upper: bool, layer: usize) -> BTreeMap<[usize; 3], u64> {
    let mut bricks = [1; 3];
    bricks[axis] = 2;
    let mut kinds = vec![Brick::Stored(0), Brick::Interior];
    if !interior_is_upper {
        kinds.reverse();
    }
    let mut values = [1.5; BRICK_POINTS];
    let mut at = [3, 4, 5];
    at[axis] = layer;
    values[(at[2] * BRICK + at[1]) * BRICK + at[0]] = 0.9;
    inside::crossed(bricks, kinds, values)
}

#[test]
fn an_interior_brick_is_crossed_from_either_side_on_every_axis() {
    for axis in 0..3 {
        for (interior_is_upper, facing, bit) in [(true, BRICK - 1, 2), (false, 0, 1)] {
            let found = crossed(axis, interior_is_upper, facing);
            assert_eq!(found, BTreeMap::from([([0; 3], bit)]), "axis {axis}");
            // A value below 1 that does not face it is no crossing of an edge between them.
            for layer in (0..BRICK).filter(|&l| l != facing) {
                let beside = crossed(axis, interior_is_upper, layer);
                assert!(beside.is_empty(), "axis {axis}, layer {layer}");
            }
        }
    }
}

/// Where the density is 1, within what the cut-offs of grid and sampler allow.
#[test]
fn roots_lie_on_the_surface() {
    let structure = globule(2, 40, 5);
    for residue_power in [1.0, 0.25] {
        let levels = Levels {
            residue_power,
            decay: 0.5,
            ..Levels::default()
        };
        let model = Model::uniform(&structure, &levels).unwrap();
        let cutoff = Cutoff(1e-7);
        let sampler = inside::sampler_above(0.25, &model, cutoff).unwrap();
        let options = Options {
            spacing: 1.0,
            cutoff,
            ..Options::default()
        };
        let grid = sample_band(&model, &options, Run::on(&Cpu)).unwrap().grid;
        let (mut roots, counts) = (0, grid.lattice().counts);
        for i in 0..grid.lattice().len() {
            let p = grid.lattice().coordinates(i);
            for axis in 0..3 {
                let mut q = p;
                q[axis] += 1;
                if q[axis] < counts[axis] && (grid.at(p) >= 1.0) != (grid.at(q) >= 1.0) {
                    let root = inside::root_on_edge(&sampler, &grid, p, q);
                    let off = sampler.value(&root).ln().abs();
                    assert!(off < 1e-6, "{off:e} between {p:?} and {q:?}");
                    roots += 1;
                }
            }
        }
        assert!(roots > 1000, "{roots} roots");
    }
}

/// However far the atoms reach: slow decays and small powers push the surface far out.
#[test]
fn no_point_of_the_surface_sums_all_atoms() {
    let near = globule(1, 12, 3);
    let levels = Levels {
        residue_power: 0.05,
        decay: 0.3,
        ..Levels::default()
    };
    let one = Model::uniform(&near, &levels).unwrap();
    // The same twice, so far apart that neither matters on the surface of the other.
    let shift = Vector3::new(400.0, 0.0, 0.0);
    let both = |of: &[f64]| [of, of].concat();
    let moved = one.centers().iter().map(|x| x + shift);
    let centers = one.centers().iter().copied().chain(moved).collect();
    let [first, second] = [0, 1].map(|half| {
        let level = &one.levels()[0];
        let shift = half * one.atoms() as u32;
        inside::first_child(level)[..level.len()]
            .iter()
            .map(move |c| c + shift)
            .collect::<Vec<u32>>()
    });
    let ends = [first, second, vec![2 * one.atoms() as u32]].concat();
    let tree = vec![(ends, both(one.levels()[0].powers()))];
    let model = Model::new(centers, both(one.radii()), both(one.decays()), tree).unwrap();
    let sampler = PointSampler::new(&model, Cutoff(1e-3)).unwrap();
    let middle = one.center_bounds().center();
    let mut beyond = 0;
    for direction in 0..200 {
        let z = 1.0 - f64::from(direction) / 100.0;
        let turn = 2.4 * f64::from(direction);
        let across = (1.0 - z * z).max(0.0).sqrt();
        let d = Vector3::new(across * turn.cos(), across * turn.sin(), z);
        // Outwards to the first place where the density is below 1.
        let steps = (0..4000).map(|step| middle + d * (0.02 * f64::from(step)));
        let at = steps.into_iter().find(|x| sampler.value(x) < 1.0).unwrap();
        assert!(
            sampler.atoms_at(&at) <= one.atoms(),
            "all are summed at {at}"
        );
        let inner = model.center_bounds().inflated(4.0);
        beyond += usize::from(!inner.contains(&at));
    }
    assert!(beyond > 20, "{beyond} of the points lie far out");
}

/// A sample right on the surface counts as inside, and is the root.
#[test]
fn roots_may_be_samples() {
    let mut exact = 0;
    for decay in [0.3, 0.5, 0.7, 1.0, 1.3] {
        let mut structure = globule(1, 1, 5).filter(|atom| atom == 0);
        for atom in structure.atoms_mut() {
            (atom.position, atom.radius) = (Point3::origin(), 2.0);
        }
        let levels = Levels {
            decay,
            ..Levels::default()
        };
        let model = Model::uniform(&structure, &levels).unwrap();
        let [min, max] = [-6.0, 6.0].map(|x| Point3::from([x; 3]));
        let options = Options {
            spacing: 1.0,
            bounds: Some(Aabb::new(min, max)),
            ..Options::default()
        };
        let sampler = inside::sampler_above(0.25, &model, options.cutoff).unwrap();
        let sampled = sample_band(&model, &options, Run::on(&Cpu));
        let grid = sampled.unwrap().grid;
        let [p, q] = [[8, 6, 6], [9, 6, 6]];
        if grid.at(p) >= 1.0 {
            let root = inside::root_on_edge(&sampler, &grid, p, q);
            assert!((root - Point3::new(2.0, 0.0, 0.0)).norm() < 1e-5, "{root}");
            exact += usize::from(grid.at(p) == 1.0);
        }
    }
    assert!(exact > 0, "no sample is right on the surface");
}

#[test]
fn every_crossing_of_a_lattice_edge_is_a_sample_on_every_axis() {
    let model = Model::uniform(&globule(2, 20, 5), &Levels::default()).unwrap();
    let sampler = inside::sampler_above(0.25, &model, Cutoff::default()).unwrap();
    let options = Options {
        spacing: 1.0,
        ..Options::default()
    };
    let grid = sample_band(&model, &options, Run::on(&Cpu)).unwrap().grid;
    let cells = inside::samples(&sampler, &grid, [0.9, 1.1], 1e-5).unwrap();
    let lattice = *grid.lattice();
    // Samples per lattice edge: those that lie on a line of the lattice, between two of its points.
    let mut on_edges = std::collections::BTreeMap::new();
    for x in cells.iter().flatten() {
        let place = (x - lattice.origin) / lattice.spacing;
        let off = |k: usize| (place[k] - place[k].round()).abs() > 1e-9;
        let axes: Vec<usize> = (0..3).filter(|&k| off(k)).collect();
        assert!(
            axes.len() < 2,
            "{x} is neither a lattice point nor on an edge"
        );
        if let [axis] = axes[..] {
            let mut p = [0, 1, 2].map(|k| place[k].round() as usize);
            p[axis] = place[axis].floor() as usize;
            *on_edges.entry((axis, p)).or_insert(0) += 1;
        }
    }
    let mut crossings = [0; 3];
    for i in 0..lattice.len() {
        let p = lattice.coordinates(i);
        for axis in 0..3 {
            let mut q = p;
            q[axis] += 1;
            if q[axis] < lattice.counts[axis] && (grid.at(p) >= 1.0) != (grid.at(q) >= 1.0) {
                assert_eq!(on_edges.get(&(axis, p)), Some(&1), "axis {axis} at {p:?}");
                crossings[axis] += 1;
            }
        }
    }
    assert_eq!(crossings.iter().sum::<usize>(), on_edges.len());
    assert!(crossings.iter().all(|&n| n > 200), "{crossings:?}");
}

#[test]
fn sizes_have_small_factors() {
    assert_eq!(
        [1, 7, 11, 127, 513].map(inside::good_size),
        [1, 8, 12, 128, 540]
    );
    let smooth = |n: &u128| {
        let mut rest = *n;
        for p in [2, 3, 5] {
            while rest.is_multiple_of(p) {
                rest /= p;
            }
        }
        rest == 1
    };
    for n in 1..3000 {
        assert_eq!(Some(inside::good_size(n)), (n..).find(smooth));
    }
    assert!((1 << 60..1 << 61).contains(&inside::good_size(1 << 60)));
}

#[test]
fn what_is_too_large_is_counted_and_what_is_empty_stays() {
    let grid = |spacing, counts: [usize; 3]| {
        let origin = Point3::origin();
        let lattice = Lattice {
            origin,
            spacing,
            counts,
        };
        ScalarGrid::new(lattice, vec![1.0; lattice.len()]).unwrap()
    };
    // Eight thousand million points of padding per axis.
    let error = low_pass(&grid(1e-9, [2; 3]), &LowPass::default()).unwrap_err();
    let Error::TooLargeToFilter { bytes, .. } = error else {
        panic!("{error}");
    };
    assert!(bytes >= 8 * 8_000_000_000u128.pow(3), "{bytes}");
    assert!(low_pass(&grid(1e-300, [2; 3]), &LowPass::default()).is_err());
    let none = grid(1.0, [3, 0, 4]);
    assert_eq!(low_pass(&none, &LowPass::default()).unwrap(), none);
}

#[test]
fn a_spacing_that_fits_is_never_rounded_down() {
    let cases = [
        (0.010_003, 0.010_1),
        (0.623_9, 0.624),
        (12.34, 12.4),
        (5.0, 5.0),
    ];
    for (value, shown) in cases {
        assert_eq!(inside::rounded_up(value), shown);
    }
}
