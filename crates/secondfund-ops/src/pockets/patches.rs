//! Patches of a surface on which the modes of the secondary Laplace operator with Ψ = e^{−H} change little: those that hold
//! most of a pocket's burial are the pocket.
//!
//! Burial is taken a probe's radius above each vertex, and patches are compared by the score per area, since large ones
//! gather much that is hardly deep.

use geom_core::search::nearest::PointTree;
use geom_core::{Point3, Structure, TriMesh};

use super::measure::REACH;
use super::shell::burial;
use super::sites::Pocket;
use crate::Error;
use crate::backend::On;
use crate::forms::{Normals, centroid};
use crate::operators::{Element, spectrum};
use crate::options::OutlineOptions;
use crate::segment::{Faces, segment};

/// The share of vertices that are not deep enough to count for a patch.
const SHALLOW: f64 = 0.88;
/// A neighbouring patch that the pocket's points touch belongs to it if the lower of the two scores per area is
/// this share of the higher: a shallow pocket does not swallow the deep one beside it.
const ALIKE: f64 = 0.5;

/// The surface in patches, each with its burial.
pub(super) struct Patches {
    faces: Faces,
    labels: Vec<u32>,
    /// `Σ m max(c − q, 0)²` over area, per patch.
    density: Vec<f64>,
    /// A face of each vertex.
    face_of: Vec<u32>,
    /// Mean curvature per vertex, Å⁻¹.
    pub(super) mean: Vec<f64>,
}

impl Patches {
    /// The modes, the patches and the burial of the surface: what does not depend on which pockets are asked for.
    pub(super) fn of(
        surface: &TriMesh,
        structure: &Structure,
        options: &OutlineOptions,
        run: On<'_>,
    ) -> Result<Self, Error> {
        let normals = Normals::OfMesh {
            rounds: options.normal_rounds,
        };
        let spectrum = spectrum(
            &Element::Triangles(surface, &normals),
            &options.spectrum(),
            run,
        )?;
        let faces = Faces::from(surface);
        let segments = segment(&spectrum, &faces, &options.segments(), run)?;
        let probes: Vec<Point3> = surface
            .positions()
            .iter()
            .zip(surface.vertex_normals())
            .map(|(p, n)| p + n * options.probe)
            .collect();
        let deep = burial(&probes, structure, options.radius, options.foreign)?;
        let mut face_of = vec![u32::MAX; surface.positions().len()];
        for (f, corners) in surface.triangles().iter().enumerate() {
            corners.iter().for_each(|&v| face_of[v as usize] = f as u32);
        }
        Ok(Self {
            density: densities(&faces, &segments.labels, &deep),
            labels: segments.labels,
            faces,
            face_of,
            mean: spectrum.mean.iter().map(|h| h / spectrum.scale).collect(),
        })
    }

    /// The patch to which most of the pocket's points are nearest, and those of its neighbours to which some are
    /// and that are as deep.
    /// Empty where no point of the pocket is within reach of the surface.
    fn of_pocket(&self, pocket: &Pocket, tree: &PointTree<3>) -> Vec<u32> {
        let mut votes = vec![0usize; self.density.len()];
        for p in &pocket.points {
            let nearest = tree.nearest(&[p.x, p.y, p.z], 1);
            for near in nearest.into_iter().filter(|n| n.distance <= REACH) {
                let face = self.face_of[near.index as usize];
                if face != u32::MAX {
                    votes[self.labels[face as usize] as usize] += 1;
                }
            }
        }
        let Some(first) = (0..votes.len()).max_by_key(|&l| (votes[l], std::cmp::Reverse(l))) else {
            return Vec::new();
        };
        if votes[first] == 0 {
            return Vec::new();
        }
        let mut chosen = vec![first as u32];
        for f in (0..self.faces.len()).filter(|&f| self.labels[f] as usize == first) {
            for link in self.faces.links(f) {
                let other = self.labels[link.face as usize];
                let (a, b) = (self.density[other as usize], self.density[first]);
                let alike = a.min(b) > ALIKE * a.max(b);
                if votes[other as usize] > 0 && alike && !chosen.contains(&other) {
                    chosen.push(other);
                }
            }
        }
        chosen
    }

    /// The pocket of each triangle: the one that claims its patch, or of several the one with the nearest point.
    pub(super) fn owners(
        &self,
        surface: &TriMesh,
        pockets: &[Pocket],
    ) -> Result<Vec<Option<u32>>, Error> {
        let tree = PointTree::of_positions(surface.positions())?;
        let claims: Vec<Vec<u32>> = pockets
            .iter()
            .map(|pocket| self.of_pocket(pocket, &tree))
            .collect();
        let mut claimants: Vec<Vec<u32>> = vec![Vec::new(); self.density.len()];
        for (pocket, claimed) in claims.iter().enumerate() {
            for &patch in claimed {
                claimants[patch as usize].push(pocket as u32);
            }
        }
        let trees: Vec<PointTree<3>> = pockets
            .iter()
            .map(|pocket| PointTree::of_positions(&pocket.points))
            .collect::<Result<_, _>>()?;
        let distance = |pocket: u32, p: &Point3| {
            let found = trees[pocket as usize].nearest(&[p.x, p.y, p.z], 1);
            found.first().map_or(f64::INFINITY, |near| near.distance)
        };
        let owner = |f: usize| {
            let all = &claimants[self.labels[f] as usize];
            if all.len() < 2 {
                return all.first().copied();
            }
            let middle = centroid(surface.positions(), &surface.triangles()[f]);
            // Ranks settle what is equally near.
            let nearer = |a: &u32, b: &u32| distance(*a, &middle).total_cmp(&distance(*b, &middle));
            all.iter().copied().min_by(nearer)
        };
        Ok((0..self.labels.len()).map(owner).collect())
    }
}

/// The threshold is a quantile over the vertices of the whole surface.
fn densities(faces: &Faces, labels: &[u32], deep: &[f64]) -> Vec<f64> {
    let mut sorted = deep.to_vec();
    sorted.sort_by(f64::total_cmp);
    let at = (SHALLOW * sorted.len() as f64) as usize;
    let threshold = sorted.get(at).copied().unwrap_or(f64::INFINITY);
    let count = labels.iter().max().map_or(0, |&l| l as usize + 1);
    let (mut scores, mut areas) = (vec![0.0; count], vec![0.0; count]);
    for (f, &label) in labels.iter().enumerate() {
        let corners = faces.corners(f);
        let mean: f64 = corners
            .iter()
            .map(|&v| (deep[v as usize] - threshold).max(0.0).powi(2))
            .sum::<f64>()
            / corners.len() as f64;
        scores[label as usize] += mean * faces.areas()[f];
        areas[label as usize] += faces.areas()[f];
    }
    scores
        .iter()
        .zip(&areas)
        .map(|(s, a)| if *a > 0.0 { s / a } else { 0.0 })
        .collect()
}
