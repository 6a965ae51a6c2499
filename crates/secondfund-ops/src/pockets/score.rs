//! How well pockets are found, where ligands are known.

use geom_core::Point3;

use super::sites::Pocket;

/// Which ranks find a ligand.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct SiteScore {
    /// The first rank whose centre lies within 4 Å of an atom of the ligand (DCA), from 1.
    pub rank_by_atom: Option<usize>,
    /// The first rank whose centre lies within 12 Å of the ligand's centroid (DCC).
    pub rank_by_centroid: Option<usize>,
}

/// The distance at which a centre counts as found by atoms, and by centroids, Å.
const BY_ATOM: f64 = 4.0;
const BY_CENTROID: f64 = 12.0;

/// The distance from a centre to the nearest atom of a ligand, Å; infinite for none.
pub fn distance_to_ligand(center: &Point3, ligand: &[Point3]) -> f64 {
    ligand
        .iter()
        .map(|p| (p - center).norm())
        .fold(f64::INFINITY, f64::min)
}

/// The ranks that find each ligand, given by its atoms.
pub fn site_ranks(pockets: &[Pocket], ligands: &[Vec<Point3>]) -> Vec<SiteScore> {
    let rank = |near: &dyn Fn(&Pocket) -> bool| pockets.iter().find(|p| near(p)).map(|p| p.rank);
    ligands
        .iter()
        .map(|ligand| {
            let n = ligand.len().max(1) as f64;
            let centroid = Point3::from(
                ligand
                    .iter()
                    .map(|p| p.coords / n)
                    .sum::<geom_core::Vector3>(),
            );
            SiteScore {
                rank_by_atom: rank(&|p| distance_to_ligand(&p.center, ligand) <= BY_ATOM),
                rank_by_centroid: rank(&|p| (p.center - centroid).norm() <= BY_CENTROID),
            }
        })
        .collect()
}
