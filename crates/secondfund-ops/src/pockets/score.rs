//! How well pockets are found, where ligands are known, and what other fields are in them.

use geom_core::{Aabb, ImplicitField, Point3, TriMesh};

use super::literal::mean_over;
use super::measure::Outline;
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
/// The measure DCA of the literature on pockets; 4 Å is its usual bound.
pub fn distance_to_ligand(center: &Point3, ligand: &[Point3]) -> f64 {
    ligand
        .iter()
        .map(|p| (p - center).norm())
        .fold(f64::INFINITY, f64::min)
}

/// The ranks that find each ligand, given by its atoms.
/// One score per ligand, in order. One without atoms is nowhere, and nothing finds it.
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
                rank_by_centroid: rank(&|p| {
                    !ligand.is_empty() && (p.center - centroid).norm() <= BY_CENTROID
                }),
            }
        })
        .collect()
}

/// What a field is in a pocket, in its own unit: a ligand's Gaussian density (Eq. 7.27), a potential.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct FieldScore {
    /// Its mean over the pocket's points; `None` if none lies within the field's bounds.
    pub points: Option<f64>,
    /// The lowest and the highest value there.
    pub range: Option<[f64; 2]>,
    /// Its mean over the outline, by area; `None` for an outline without triangles or not within the bounds.
    pub surface: Option<f64>,
}

/// The values of a field in a pocket. `bounds`: where the field is known, if not everywhere.
/// The field is evaluated at each point of the pocket and at each corner of the outline, in its own coordinates, Å.
pub fn field_in<F: ImplicitField + ?Sized>(
    pocket: &Pocket,
    outline: &Outline,
    surface: &TriMesh,
    field: &F,
    bounds: Option<&Aabb>,
) -> FieldScore {
    let known = |p: &Point3| bounds.is_none_or(|b| b.contains(p));
    let values: Vec<f64> = pocket
        .points
        .iter()
        .filter(|p| known(p))
        .map(|p| field.value(p))
        .collect();
    let mut of_vertices = vec![0.0; surface.positions().len()];
    let mut whole = !outline.triangles.is_empty();
    for &f in &outline.triangles {
        for v in surface.triangles()[f as usize] {
            let p = &surface.positions()[v as usize];
            whole &= known(p);
            of_vertices[v as usize] = field.value(p);
        }
    }
    let extremes = |ends: [f64; 2], v: &f64| [ends[0].min(*v), ends[1].max(*v)];
    let some = !values.is_empty();
    FieldScore {
        points: some.then(|| values.iter().sum::<f64>() / values.len() as f64),
        range: some.then(|| {
            values
                .iter()
                .fold([f64::INFINITY, f64::NEG_INFINITY], extremes)
        }),
        surface: whole.then(|| mean_over(surface, outline, &of_vertices)),
    }
}
