//! The octrees that the two methods need.

use rayon::prelude::*;

use super::setup::Purpose;
use crate::complex::{Complex, Interfaces, Kinds};
use crate::octree::{Octree, Samples, Splits};
use crate::{Error, Options};

/// Where interfaces are: labels that follow from signs alone make all cells with a surface finest, unless these
/// may be coarser.
fn interfaces(samples: &Samples<'_>, options: &Options) -> Interfaces {
    if samples.labels.plain() && options.has_one_size() {
        Interfaces::OfFinest
    } else {
        Interfaces::OfAnySize
    }
}

/// The octree with cells of one size around the surface, as snapping needs it.
pub(super) fn even(
    samples: &Samples<'_>,
    options: &Options,
    splits: &mut Splits,
) -> (Octree, Kinds) {
    let cells = samples.domain.cells;
    let interfaces = interfaces(samples, options);
    let tree = Octree::new(cells, splits);
    for id in Kinds::of(samples, &tree, interfaces).interfaces() {
        let leaf = &tree.leaves[id as usize];
        if leaf.log == 0 {
            splits.surround(cells, leaf.origin());
        }
    }
    let tree = Octree::new(cells, splits);
    let kinds = Kinds::of(samples, &tree, interfaces).unsplit();
    (tree, kinds)
}

/// The octree in which ambiguous cells are finest, and stand among finest ones.
pub(super) fn adapted(
    samples: &Samples<'_>,
    options: &Options,
    splits: &mut Splits,
) -> (Octree, Kinds) {
    let domain = samples.domain;
    let interfaces = interfaces(samples, options);
    let mut tree = Octree::new(domain.cells, splits);
    let mut kinds = Kinds::of(samples, &tree, interfaces);
    loop {
        let large = kinds.large(&tree);
        for &id in &large {
            splits.split(domain.blocks, &tree.leaves[id as usize]);
        }
        // Cut cells stand among finest ones, so that surfaces do not hang on what lies off them.
        let bare: Vec<u32> = kinds
            .cut(&tree)
            .into_par_iter()
            .filter(|&id| {
                tree.touching(id)
                    .any(|other| tree.leaves[other as usize].log > 0)
            })
            .collect();
        for &id in &bare {
            splits.surround(domain.cells, tree.leaves[id as usize].origin());
        }
        if large.is_empty() && bare.is_empty() {
            return (tree, kinds);
        }
        tree = Octree::new(domain.cells, splits);
        kinds = Kinds::of(samples, &tree, interfaces);
    }
}

/// Refuses what vertex and element numbers could not name: fewer than 24 tetrahedra per leaf and 4
/// vertices, with 4 more per surface leaf for cuts.
pub(super) fn check_counts(complex: &Complex<'_>, purpose: Purpose) -> Result<(), Error> {
    let leaves = complex.tree.leaves.len() as u128;
    let elements = match purpose {
        Purpose::Surface => 12 * leaves,
        Purpose::Volume(_) => 24 * leaves,
    };
    let limit = u128::from(u32::MAX - 2);
    if elements > 4 * limit || 8 * leaves > limit {
        return Err(Error::TooLarge {
            what: "the mesh",
            bytes: elements * 17,
            limit: limit * 17,
            cure: "take a larger spacing",
        });
    }
    Ok(())
}
