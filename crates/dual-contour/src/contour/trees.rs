//! The octrees that the two methods need.
//!
//! Both begin with what values and options ask for and add what the method needs. A tree is made anew from all that has
//! been asked for: that is one pass, and changing one in place would be slower.

use super::memory;
use crate::complex::{Interfaces, Kinds};
use crate::octree::{Octree, Samples, Splits, TooManyLeaves};
use crate::{Error, Options};
use geom_core::compute::parallel;

/// Where interfaces are: labels that follow from signs alone make all cells with a surface finest, unless these
/// may be coarser.
fn interfaces(samples: &Samples<'_>, options: &Options) -> Interfaces {
    if samples.labels.plain() && options.has_one_size() {
        Interfaces::OfFinest
    } else {
        Interfaces::OfAnySize
    }
}

/// The octree, unless its leaves are more than memory or numbers allow.
fn octree(cells: [i32; 3], splits: &Splits, options: &Options) -> Result<Octree, Error> {
    let most = memory::most_leaves(options.max_memory);
    Octree::new(cells, splits, most)
        .map_err(|TooManyLeaves(leaves)| memory::too_many_leaves(leaves, most))
}

/// The octree with cells of one size around the surface, as snapping needs it.
/// Finest cells with an interface stand among finest ones, so that near the surface base tetrahedra are those of the
/// body-centred lattice, for which the limits of snapping are known. Ambiguous cells are not cut: tetrahedra have no
/// ambiguity.
pub(super) fn even(
    samples: &Samples<'_>,
    options: &Options,
    splits: &mut Splits,
) -> Result<(Octree, Kinds), Error> {
    let cells = samples.domain.cells;
    let interfaces = interfaces(samples, options);
    let tree = octree(cells, splits, options)?;
    for id in Kinds::of(samples, &tree, interfaces).interfaces() {
        let leaf = &tree.leaves[id as usize];
        if leaf.log == 0 {
            splits.surround(cells, leaf.origin());
        }
    }
    let tree = octree(cells, splits, options)?;
    let kinds = Kinds::of(samples, &tree, interfaces).unsplit();
    Ok((tree, kinds))
}

/// The octree in which ambiguous cells are finest, and stand among finest ones.
/// To the end: a leaf that is split may leave ambiguous ones, and balance may hang corners on others. Every round makes
/// cells smaller, so it ends.
pub(super) fn adapted(
    samples: &Samples<'_>,
    options: &Options,
    splits: &mut Splits,
) -> Result<(Octree, Kinds), Error> {
    let domain = samples.domain;
    let interfaces = interfaces(samples, options);
    let mut tree = octree(domain.cells, splits, options)?;
    let mut kinds = Kinds::of(samples, &tree, interfaces);
    loop {
        let large = kinds.large(&tree);
        for &id in &large {
            splits.split(domain.blocks, &tree.leaves[id as usize]);
        }
        // Cut cells stand among finest ones, so that surfaces do not hang on what lies off them.
        let cut = kinds.cut(&tree);
        let is_bare = |id: &u32| {
            let mut touching = tree.touching(*id);
            touching.any(|other| tree.leaves[other as usize].log > 0)
        };
        let bare = parallel::flat_map(cut.len(), |i| Some(cut[i]).filter(is_bare));
        for &id in &bare {
            splits.surround(domain.cells, tree.leaves[id as usize].origin());
        }
        if large.is_empty() && bare.is_empty() {
            return Ok((tree, kinds));
        }
        tree = octree(domain.cells, splits, options)?;
        kinds = Kinds::of(samples, &tree, interfaces);
    }
}
