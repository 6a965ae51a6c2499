//! A part of a lattice sampled alone has the bits of the whole.

use gauss_density::testing::globule;
use gauss_density::{Copies, Levels, Model, Options, sample_band, sample_window};
use geom_core::grid::lattice::Window;
use geom_core::nalgebra::Rotation3;
use geom_core::structure::Transform;
use geom_core::{Cpu, LatticeValues, Run, Vector3};

/// Copies of a globule along a bent line, and the same as one model.
fn copies(levels: &Levels) -> (Copies, Model) {
    let unit = globule(2, 12, 5);
    let places: Vec<(usize, Transform)> = (0..4)
        .map(|i| {
            let turn = Rotation3::from_euler_angles(0.3 * f64::from(i), 0.2, 0.7 * f64::from(i));
            let transform = Transform {
                rotation: turn.into_inner(),
                translation: Vector3::new(19.0 * f64::from(i), f64::from(i * i), -3.0),
            };
            (0, transform)
        })
        .collect();
    let all = vec![vec![true; unit.residues().len()]];
    let whole = unit.copies(&all, &places, usize::MAX).unwrap();
    let unit = Model::uniform(&unit, levels).unwrap();
    let places = places.into_iter().map(|p| p.1).collect();
    let whole = Model::uniform(&whole, levels).unwrap();
    (Copies::new(&unit, places).unwrap(), whole)
}

#[test]
fn a_window_has_the_bits_of_the_whole() {
    let gentle = Levels::default();
    let plain = Levels {
        residue_power: 1.0,
        ..gentle
    };
    let nested = Levels {
        residue_power: 0.7,
        chain_power: 1.5,
        domain_power: 0.8,
        decay: 0.5,
    };
    // So blurred that kernels leave the range of f32: the culls of boxes.
    let blurred = Levels {
        residue_power: 0.05,
        ..gentle
    };
    for (levels, spacing) in [(gentle, 0.7), (plain, 1.0), (nested, 0.9), (blurred, 1.5)] {
        let (copies, model) = copies(&levels);
        assert_eq!(copies.atoms(), model.atoms() as u64);
        let options = Options {
            spacing,
            ..Options::default()
        };
        let whole = sample_band(&model, &options, Run::on(&Cpu)).unwrap().grid;
        let lattice = copies.lattice(&options).unwrap();
        assert_eq!(&lattice, whole.lattice(), "{levels:?}");
        let [nx, ny, nz] = lattice.cells();
        let mut stored = 0;
        for (low, high) in [
            ([0, 0, 0], [nx, ny, nz]),
            ([0, 0, 0], [24, 16, 24]),
            ([8, 8, 0], [48, 24, 32]),
            ([40, 0, 8], [nx, 32, nz]),
        ] {
            let window = Window::around(lattice, low, high, 0);
            let part = sample_window(&copies, &options, &window, Run::on(&Cpu)).unwrap();
            stored += part.stored_bricks();
            for b in 0..part.bricks().iter().product() {
                let own = part.brick_coordinates(b);
                let there = [0, 1, 2].map(|k| own[k] + window.low[k] / 8);
                match (part.brick(own), whole.brick(there)) {
                    (geom_core::grid::Brick::Stored(s), geom_core::grid::Brick::Stored(t)) => {
                        let [s, t] = [part.stored(s), whole.stored(t)];
                        let same = s.iter().zip(t).all(|(s, t)| s.to_bits() == t.to_bits());
                        assert!(same, "{levels:?}: brick {there:?}");
                    }
                    (own, theirs) => assert_eq!(own, theirs, "{levels:?}: brick {there:?}"),
                }
            }
        }
        assert!(stored > 50, "{stored} bricks");
    }
}

#[test]
fn windows_beside_the_bricks_are_refused() {
    let (copies, _) = copies(&Levels::default());
    let options = Options::default();
    let lattice = copies.lattice(&options).unwrap();
    let window = Window::around(lattice, [4; 3], [16; 3], 0);
    let error = sample_window(&copies, &options, &window, Run::on(&Cpu)).unwrap_err();
    assert!(error.to_string().contains("window"), "{error}");
}
