//! Generated structures and proptest strategies for models.
//!
//! For the tests of this crate and of those that build on it; under the feature `testing`, since it brings proptest
//! along.

use geom_core::Point3;
use geom_core::compute::random::SplitMix64;
use geom_core::structure::{Atom, Element, Name, Structure, StructureBuilder};
use proptest::prelude::*;

use crate::backend::{Prepared, SampleCell};
use crate::model::Model;
use crate::specification;

/// A compact, protein-like structure: `chains` random walks of residues with seven atoms each, folded into a
/// ball. The same numbers give the same structure.
/// Atoms have elements and their van der Waals radii; steps are at most 1.5 Å along each axis, and nothing keeps atoms
/// apart, so it is about as dense as a protein but has no bonds.
pub fn globule(chains: usize, residues: usize, seed: u64) -> Structure {
    let mut random = SplitMix64::new(seed);
    let mut uniform = move || random.unit();
    let ball =
        (chains as f64 * residues as f64 * 130.0 * 3.0 / (4.0 * std::f64::consts::PI)).cbrt();
    let elements = [7, 6, 6, 8, 6, 6, 16].map(Element);
    let mut builder = StructureBuilder::new();
    builder.domain(1, 1);
    for chain in 0..chains {
        builder.chain(Name::new(&format!("{chain}")).expect("short and plain"));
        let mut at = Point3::origin();
        for k in 0..3 {
            at[k] = (uniform() - 0.5) * ball;
        }
        for number in 0..residues {
            builder.residue(
                Name::new("GEN").expect("plain"),
                number as i32 + 1,
                Name::default(),
            );
            for element in elements {
                loop {
                    let mut next = at;
                    for k in 0..3 {
                        next[k] += (uniform() - 0.5) * 3.0;
                    }
                    // Pulled back when it leaves the ball.
                    if next.coords.norm() < ball {
                        at = next;
                        break;
                    }
                    at.coords *= 0.95;
                }
                builder.atom(Atom {
                    position: at,
                    radius: element.vdw_radius(),
                    charge: 0.0,
                    b_factor: 0.0,
                    name: Name::default(),
                    element,
                    hetero: false,
                });
            }
        }
    }
    builder.build()
}

/// A sample cell of all atoms of a model at given points; the target is the density there.
pub fn sample_cell(model: &Prepared<'_>, points: Vec<Point3>) -> SampleCell {
    let atoms = (0..model.model().atoms() as u32).collect();
    let mut cell = SampleCell::new(atoms, model.levels.clone(), points);
    let density = |x| specification::nested_sum(model.model(), x);
    cell.exact = cell.points.iter().map(density).collect();
    cell.target = cell.exact.clone();
    cell
}

/// Models of random trees: depth 0 to 5, 1 to 24 atoms, per-node powers in [0.05, 3], decays in [0.1, 2],
/// radii from 0.
/// Within 6 Å of the origin along each axis, so that all of them matter to each other, which is the hard case for every
/// bound.
pub fn models() -> impl Strategy<Value = Model> {
    (1usize..25, 0usize..6).prop_flat_map(|(atoms, depth)| {
        let atom = (
            prop::array::uniform3(-6.0..6.0f64),
            0.0..2.2f64,
            0.1..2.0f64,
        );
        let cuts = prop::collection::vec(
            prop::collection::vec((any::<bool>(), power()), atoms),
            depth,
        );
        (prop::collection::vec(atom, atoms), cuts).prop_map(move |(atoms, cuts)| {
            let mut below = atoms.len();
            let tree = cuts
                .iter()
                .map(|cuts| {
                    let mut first = vec![0u32];
                    first.extend((1..below).filter(|&i| cuts[i].0).map(|i| i as u32));
                    let powers = (0..first.len()).map(|i| cuts[i].1).collect::<Vec<_>>();
                    first.push(below as u32);
                    below = powers.len();
                    (first, powers)
                })
                .collect();
            let centers = atoms.iter().map(|a| Point3::from(a.0)).collect();
            let radii = atoms.iter().map(|a| a.1).collect();
            let decays = atoms.iter().map(|a| a.2).collect();
            Model::new(centers, radii, decays, tree).expect("numbers in range")
        })
    })
}

fn power() -> impl Strategy<Value = f64> {
    prop_oneof![4 => 0.05..3.0f64, 1 => Just(1.0), 1 => Just(0.5)]
}
