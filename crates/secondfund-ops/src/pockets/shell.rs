//! Points in the shell around a molecule where a ligand's atoms can lie, and how deep in it they are.

use geom_core::{Point3, Structure};
use rayon::prelude::*;

use super::atoms::Atoms;
use crate::Error;
use crate::options::PocketOptions;

/// How deep each point lies in the molecule: the heavy polymer atoms within `radius` (Å), those of the chain that
/// has most of them in full, of the others `foreign` each. About 400 on the surface of a globular protein and 600
/// in a pocket, for 10 Å. With `foreign` = 1 the clefts between chains, where two surfaces meet, are deeper than
/// most pockets within a chain.
///
/// # Errors
/// [`Error::NoAtoms`].
pub fn burial(
    points: &[Point3],
    structure: &Structure,
    radius: f64,
    foreign: f64,
) -> Result<Vec<f64>, Error> {
    let atoms = Atoms::of(structure)?;
    Ok(points
        .par_iter()
        .with_min_len(64)
        .map_init(Vec::new, |counts, p| {
            atoms.burial(&atoms.frame.enter(p), radius, foreign, counts)
        })
        .collect())
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

/// The lattice points whose distance from the nearest atom's surface lies within the shell.
pub(crate) fn shell(atoms: &Atoms, options: &PocketOptions) -> Vec<ShellPoint> {
    let [near, far] = options.shell;
    let h = options.spacing;
    let bounds = atoms.bounds().inflated(far + 2.0);
    let low: [i32; 3] = [0, 1, 2].map(|k| (bounds.min[k] / h).floor() as i32);
    let high: [i32; 3] = [0, 1, 2].map(|k| (bounds.max[k] / h).ceil() as i32);
    let plane = |k: i32| -> Vec<ShellPoint> {
        let mut counts = Vec::new();
        let row = move |j: i32| (low[0]..=high[0]).map(move |i| [i, j, k]);
        (low[1]..=high[1])
            .flat_map(row)
            .filter_map(|place| {
                let position = Point3::from(place.map(|c| f64::from(c) * h));
                let (gap, atom) = atoms.gap(&position, far)?;
                (gap > near).then(|| ShellPoint {
                    place,
                    position,
                    chain: atoms.chain[atom as usize],
                    burial: atoms.burial(&position, options.radius, options.foreign, &mut counts),
                })
            })
            .collect()
    };
    let planes: Vec<_> = (low[2]..=high[2]).into_par_iter().map(plane).collect();
    planes.concat()
}
