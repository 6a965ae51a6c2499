//! Points that a small probe reaches and a large one does not cover: a second source of what belongs to a pocket.

use geom_core::search::nearest::PointTree;
use geom_core::{Point3, Structure};
use rayon::prelude::*;

use super::atoms::Atoms;
use super::shell::lattice;
use super::sites::Pocket;
use crate::Error;
use crate::options::ProbeOptions;

/// The places where the centre of a small probe fits between the polymer's atoms, but which no large probe outside of
/// them covers (Kleywegt and Jones, *Detection, delineation, measurement and display of cavities*, 1994; Kawabata and
/// Go, 2007), Å. Hollows and closed cavities alike, on a lattice along the molecule's principal axes.
///
/// # Errors
/// Options out of range, [`Error::NoAtoms`].
pub fn between_probes(structure: &Structure, options: &ProbeOptions) -> Result<Vec<Point3>, Error> {
    options.check()?;
    let atoms = Atoms::of(structure)?;
    // Where the large probe fits, lattice points two steps farther out are enough to tell what it covers.
    let far = options.outer + 2.0 * options.spacing;
    let near = lattice(&atoms, [options.inner, far], options.spacing, |p, _| {
        (p.position, p.gap >= options.outer)
    });
    let centers: Vec<Point3> = near.iter().filter(|p| p.1).map(|p| p.0).collect();
    let tree = PointTree::of_positions(&centers)?;
    let uncovered = |p: &Point3| {
        let center = tree.nearest(&[p.x, p.y, p.z], 1);
        center.first().is_none_or(|c| c.distance > options.outer)
    };
    Ok(near
        .into_par_iter()
        .filter(|(p, outside)| !outside && uncovered(p))
        .map(|(p, _)| atoms.frame.leave(&p))
        .collect())
}

/// The points that belong to each pocket: to that with the nearest point of its own, within reach.
pub(super) fn shared_out(
    points: &[Point3],
    pockets: &[Pocket],
    reach: f64,
) -> Result<Vec<Vec<Point3>>, Error> {
    let own: Vec<Point3> = pockets.iter().flat_map(|p| &p.points).copied().collect();
    let owners: Vec<u32> = pockets
        .iter()
        .zip(0..)
        .flat_map(|(p, i)| std::iter::repeat_n(i, p.points.len()))
        .collect();
    let tree = PointTree::of_positions(&own)?;
    let mut shares = vec![Vec::new(); pockets.len()];
    for p in points {
        // Equally near ones: the lowest index, which is the better rank.
        let nearest = tree.nearest(&[p.x, p.y, p.z], 1);
        if let Some(near) = nearest.first().filter(|near| near.distance <= reach) {
            shares[owners[near.index as usize] as usize].push(*p);
        }
    }
    Ok(shares)
}
