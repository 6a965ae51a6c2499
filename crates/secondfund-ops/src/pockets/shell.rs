//! Points in the shell around a molecule where a ligand's atoms can lie, and how deep in it they are.
//!
//! Depth is counted, not measured: a point on a plane has half a ball of atoms around it, one in a hollow more, one on a knob
//! less. Counting needs no surface, no normals and no probe, and changes little when atoms move a little.

use geom_core::compute::parallel;
use geom_core::{Aabb, Point3, Structure};
use rayon::prelude::*;

use super::atoms::Atoms;
use crate::Error;
use crate::options::{PocketOptions, check_burial};

/// How deep each point lies in the molecule: the heavy polymer atoms within `radius` (Å), those of the chain that
/// has most of them in full, of the others `foreign` each. About 400 on the surface of a globular protein and 600
/// in a pocket, for 10 Å. With `foreign` = 1 the clefts between chains, where two surfaces meet, are deeper than
/// most pockets within a chain.
///
/// # Errors
/// A radius or share out of its range, [`Error::NoAtoms`].
pub fn burial(
    points: &[Point3],
    structure: &Structure,
    radius: f64,
    foreign: f64,
) -> Result<Vec<f64>, Error> {
    check_burial(radius, foreign)?;
    let atoms = Atoms::of(structure)?;
    Ok(parallel::map_each_init(points, Vec::new, |counts, p| {
        atoms.burial(&atoms.frame.enter(p), radius, foreign, counts)
    }))
}

/// A point of the shell.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ShellPoint {
    /// On the lattice of the molecule's frame.
    pub(crate) place: [i32; 3],
    /// In the molecule's frame, Å.
    pub(crate) position: Point3,
    /// The chain of the nearest atom.
    pub(crate) chain: u32,
    /// Atoms around it.
    pub(crate) burial: f64,
}

/// The lattice points whose distance from the nearest atom's surface lies within the shell, by z, then y, then x.
pub(crate) fn shell(atoms: &Atoms, options: &PocketOptions) -> Vec<ShellPoint> {
    let burial = |p: &Near, counts: &mut Vec<(u32, u32)>| ShellPoint {
        place: p.place,
        position: p.position,
        chain: atoms.chain[p.atom as usize],
        burial: atoms.burial(&p.position, options.radius, options.foreign, counts),
    };
    lattice(atoms, options.shell, options.spacing, burial)
}

/// A lattice point near the atoms.
pub(super) struct Near {
    place: [i32; 3],
    /// In the molecule's frame, Å.
    pub(super) position: Point3,
    /// From the surface of the nearest atom, Å.
    pub(super) gap: f64,
    atom: u32,
}

/// What `of` makes of the lattice points whose gap lies between `near` and `far`, by z, then y, then x; it is handed
/// scratch of its thread.
pub(super) fn lattice<T: Send>(
    atoms: &Atoms,
    [near, far]: [f64; 2],
    spacing: f64,
    of: impl Fn(&Near, &mut Vec<(u32, u32)>) -> T + Sync,
) -> Vec<T> {
    // Lattice points from the lower side of a box to its upper one, which is the next box's lower.
    let first = |x: f64| (x / spacing).ceil() as i32;
    let of_box = |scratch: &mut Vec<(u32, u32)>, bounds: Aabb| -> Vec<([i32; 3], T)> {
        let along = |k: usize| first(bounds.min[k])..first(bounds.max[k]);
        let row = |k: i32, j: i32| along(0).map(move |i| [i, j, k]);
        let places = along(2).flat_map(|k| along(1).flat_map(move |j| row(k, j)));
        places
            .filter_map(|place| {
                let position = Point3::from(place.map(|c| f64::from(c) * spacing));
                let (gap, atom) = atoms.gap(&position, far)?;
                let point = Near {
                    place,
                    position,
                    gap,
                    atom,
                };
                (gap > near).then(|| (place, of(&point, scratch)))
            })
            .collect()
    };
    let mut points: Vec<([i32; 3], T)> = atoms
        .boxes_within(far)
        .into_par_iter()
        .map_init(Vec::new, of_box)
        .flatten_iter()
        .collect();
    points.sort_unstable_by_key(|(p, _)| [p[2], p[1], p[0]]);
    points.into_iter().map(|(_, made)| made).collect()
}
