//! What a mesh will take, from counts, before it is made.
//!
//! The numbers are bytes at the peak, by the lists that the code holds at one time and confirmed within a factor of
//! two by `tests/memory.rs`; they do not know what the allocator adds.
//!
//! Whoever changes a list of the meshers changes a number here: the constants are sums of sizes of items, per leaf,
//! cell or tetrahedron.

use super::setup::{Purpose, refused};
use crate::complex::Kinds;
use crate::octree::Octree;
use crate::{Error, Extent, Method};

/// A leaf with its kind, its point and the place of it.
const LEAF: u64 = 40;
/// A tetrahedron of the mesh while it is emitted: in the list of its batch and in the joined one, with its region
/// and its share of the vertices.
const TET: u64 = 60;
/// A base tetrahedron per leaf, and of a cut leaf: three edges of eight parts, three diagonals of four, and 36 around
/// the edges to the middle.
const TETS_OF_LEAF: u64 = 12;
const TETS_OF_CUT: u64 = 72;
/// An edge tetrahedron that may lose its volume, while those of all leaves are put together.
const EDGE_TET: u64 = 144;
/// Stuffing: a leaf away from interfaces has its base tetrahedra with their labels, one at an interface those near it
/// too, with neighbours, edges and pieces.
const STUFFED_LEAF: u64 = 500;
const STUFFED_INTERFACE: u64 = 2600;
/// A surface alone without an octree: a cell with its point and two triangles, and a cut one with its twelve parts
/// and their polygons.
const SURFACE_CELL: u64 = 100;
const SURFACE_CUT: u64 = 1800;

/// Most leaves whose corners, parts and tetrahedra have numbers: eight vertices each, with cuts.
const NAMED_LEAVES: u64 = (u32::MAX as u64 - 2) / 8;

/// Most leaves that numbers and memory allow.
pub(super) fn most_leaves(max_memory: u64) -> u64 {
    NAMED_LEAVES.min(max_memory / LEAF)
}

/// Said in bytes, also where it is numbers that do not suffice.
pub(super) fn too_many_leaves(leaves: u64, most: u64) -> Error {
    refused("the octree", leaves * LEAF, most * LEAF)
}

/// Refuses a mesh that would take more than is allowed beside what is `held` already.
pub(super) fn check_mesh(
    tree: &Octree,
    kinds: &Kinds,
    method: Method,
    purpose: Purpose,
    held: u64,
    max_memory: u64,
) -> Result<(), Error> {
    let leaves = tree.leaves.len() as u64;
    let cut = kinds.cut(tree).len() as u64;
    let peak = match method {
        Method::Stuffing => {
            let interfaces = kinds.interfaces().count() as u64;
            STUFFED_LEAF * leaves + STUFFED_INTERFACE * interfaces
        }
        // What may lose its volume is looked at, and forgotten, before tetrahedra are emitted.
        Method::DualContour => {
            let all = TETS_OF_LEAF * (leaves - cut) + TETS_OF_CUT * cut;
            let emitted = match purpose {
                Purpose::Surface => 0,
                // Which part is inside is not known without a look at all corners.
                Purpose::Volume(Extent::Interior | Extent::Exterior) => all / 2,
                Purpose::Volume(Extent::Both) => all,
            };
            LEAF * leaves + (TETS_OF_CUT * cut * EDGE_TET).max(emitted * TET)
        }
    };
    let bytes = held + peak;
    if bytes > max_memory {
        return Err(refused("the mesh", bytes, max_memory));
    }
    Ok(())
}

/// The same for a surface without an octree, of so many cells of which some are cut.
pub(super) fn check_surface(
    cells: usize,
    cut: usize,
    held: u64,
    max_memory: u64,
) -> Result<(), Error> {
    let bytes = held + SURFACE_CELL * cells as u64 + SURFACE_CUT * cut as u64;
    // Twelve parts per cut cell, and a point on each edge, must have numbers.
    let named = 40 * cut as u64 + 4 * cells as u64;
    if bytes > max_memory || named > u64::from(u32::MAX) / 2 {
        return Err(refused("the surface", bytes, max_memory));
    }
    Ok(())
}

/// What holds here, for the tests.
#[cfg(feature = "testing")]
#[expect(missing_docs, reason = "the names of the laws say it")]
pub(crate) mod laws {
    use super::*;

    pub fn leaves_without_numbers_are_refused_whatever_the_memory() {
        assert_eq!(most_leaves(u64::MAX), NAMED_LEAVES);
        assert_eq!(most_leaves(4000), 100);
        let error = check_surface(1, 60_000_000, 0, u64::MAX).unwrap_err();
        assert!(matches!(error, Error::TooLarge { .. }));
    }
}
