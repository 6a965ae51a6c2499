//! The part of a surface that is a pocket: patches on which the modes of the secondary Laplace operator with
//! Ψ = e^{−H} change little, those that hold most of the burial.

use geom_core::search::nearest::PointTree;
use geom_core::{Point3, Run, Structure, TriMesh, Vector3};

use super::shell::burial;
use super::sites::Pocket;
use crate::Error;
use crate::backend::OperatorBackend;
use crate::forms::{Normals, Operator, Weight};
use crate::operators::{Element, spectrum};
use crate::options::{Groups, Modes, OutlineOptions, SegmentOptions, SpectrumOptions};
use crate::segment::{Faces, segment};

/// The share of vertices that are not deep enough to count for a patch.
const SHALLOW: f64 = 0.88;
/// A neighbouring patch that the pocket's points touch belongs to it if its score per area is this share of the
/// first one's.
const ALIKE: f64 = 0.5;

/// A pocket as a part of the surface.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct Outline {
    /// The pocket's rank.
    pub rank: usize,
    /// Triangles of the surface, ascending.
    pub triangles: Vec<u32>,
    /// Their area, Å².
    pub area: f64,
    /// Area-weighted mean curvature, Å⁻¹: negative where concave.
    pub mean_curvature: f64,
    /// Area of the mouth: of the fan over the border, Å².
    pub mouth: f64,
    /// The largest distance of the patch below the mouth, Å.
    pub depth: f64,
    /// Volume between the patch and its mouth, Å³.
    pub volume: f64,
}

/// The outlines of pockets on the molecule's surface; a pocket that no part of the surface is near has no
/// triangles.
///
/// # Errors
/// Those of [`spectrum`] and [`segment`].
pub fn outline<B: OperatorBackend + ?Sized>(
    surface: &TriMesh,
    structure: &Structure,
    pockets: &[Pocket],
    options: &OutlineOptions,
    run: Run<'_, B>,
) -> Result<Vec<Outline>, Error> {
    let patches = Patches::of(surface, structure, options, run)?;
    let tree = PointTree::of_positions(surface.positions())?;
    Ok(pockets
        .iter()
        .map(|pocket| {
            let chosen = patches.of_pocket(pocket, &tree);
            patches.measured(pocket.rank, surface, &chosen)
        })
        .collect())
}

/// The surface in patches, each with its burial.
struct Patches {
    faces: Faces,
    labels: Vec<u32>,
    /// `Σ m max(c − q, 0)²` over area, per patch.
    density: Vec<f64>,
    /// A face of each vertex.
    face_of: Vec<u32>,
    /// Mean curvature per vertex, Å⁻¹.
    mean: Vec<f64>,
}

impl Patches {
    fn of<B: OperatorBackend + ?Sized>(
        surface: &TriMesh,
        structure: &Structure,
        options: &OutlineOptions,
        run: Run<'_, B>,
    ) -> Result<Self, Error> {
        let normals = Normals::OfMesh {
            rounds: options.normal_rounds,
        };
        let asked = SpectrumOptions {
            operator: Operator::Slo(Weight::ExpMinusH),
            modes: options.modes,
            regularization: options.regularization,
            ..SpectrumOptions::default()
        };
        let spectrum = spectrum(&Element::Triangles(surface, &normals), &asked, run)?;
        let faces = Faces::from(surface);
        let groups = SegmentOptions {
            modes: Modes::Count(options.modes),
            groups: Groups::Count(options.groups),
            restarts: 1,
            ..SegmentOptions::default()
        };
        let segments = segment(&spectrum, &faces, &groups, run)?;
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
    fn of_pocket(&self, pocket: &Pocket, tree: &PointTree<3>) -> Vec<u32> {
        let mut votes = vec![0usize; self.density.len()];
        for p in &pocket.points {
            for near in tree.nearest(&[p.x, p.y, p.z], 1) {
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
                let alike = self.density[other as usize] > ALIKE * self.density[first];
                if votes[other as usize] > 0 && alike && !chosen.contains(&other) {
                    chosen.push(other);
                }
            }
        }
        chosen
    }

    fn measured(&self, rank: usize, surface: &TriMesh, chosen: &[u32]) -> Outline {
        let inside = |f: usize| chosen.contains(&self.labels[f]);
        let triangles: Vec<u32> = (0..self.faces.len())
            .filter(|&f| inside(f))
            .map(|f| f as u32)
            .collect();
        let area: f64 = triangles
            .iter()
            .map(|&f| self.faces.areas()[f as usize])
            .sum();
        let curved = triangles.iter().map(|&f| {
            let corners = surface.triangles()[f as usize];
            let mean = corners.map(|v| self.mean[v as usize]).iter().sum::<f64>() / 3.0;
            mean * self.faces.areas()[f as usize]
        });
        let mean_curvature = if area > 0.0 {
            curved.sum::<f64>() / area
        } else {
            0.0
        };
        let cap = Cap::of(surface, &triangles);
        Outline {
            rank,
            area,
            mean_curvature,
            mouth: cap.normal.norm(),
            depth: cap.depth(surface, &triangles),
            volume: cap.volume(surface, &triangles),
            triangles,
        }
    }
}

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

/// The fan of triangles from the middle of a patch's border over its edges.
struct Cap {
    middle: Point3,
    /// Its area times its mean normal, out of the pocket.
    normal: Vector3,
    /// The border's edges, as the patch's own triangles run along them.
    edges: Vec<[u32; 2]>,
}

impl Cap {
    fn of(surface: &TriMesh, triangles: &[u32]) -> Self {
        let mut sides: Vec<([u32; 2], [u32; 2])> = triangles
            .iter()
            .flat_map(|&f| {
                let [a, b, c] = surface.triangles()[f as usize];
                [[a, b], [b, c], [c, a]]
            })
            .map(|[a, b]| ([a.min(b), a.max(b)], [a, b]))
            .collect();
        sides.sort_unstable();
        let edges: Vec<[u32; 2]> = sides
            .chunk_by(|a, b| a.0 == b.0)
            .filter(|side| side.len() == 1)
            .map(|side| side[0].1)
            .collect();
        let at = |v: u32| surface.positions()[v as usize];
        let (mut sum, mut length) = (Vector3::zeros(), 0.0);
        for &[a, b] in &edges {
            let l = (at(b) - at(a)).norm();
            sum += (at(a).coords + at(b).coords) * (0.5 * l);
            length += l;
        }
        let middle = Point3::from(if length > 0.0 { sum / length } else { sum });
        // The patch runs along its border with itself on the left; seen from outside so does its lid.
        let fan = edges
            .iter()
            .map(|&[a, b]| (at(a) - middle).cross(&(at(b) - middle)) * 0.5);
        Self {
            middle,
            normal: fan.sum(),
            edges,
        }
    }

    fn depth(&self, surface: &TriMesh, triangles: &[u32]) -> f64 {
        let Some(up) = self.normal.try_normalize(0.0) else {
            return 0.0;
        };
        triangles
            .iter()
            .flat_map(|&f| surface.corners(f as usize))
            .map(|p| up.dot(&(self.middle - p)))
            .fold(0.0, f64::max)
    }

    /// Enclosed by the lid, turned outwards, and the patch, turned inwards: what lies between them. Negative
    /// volumes, of patches that bulge out, count as none.
    fn volume(&self, surface: &TriMesh, triangles: &[u32]) -> f64 {
        if self.edges.is_empty() {
            return 0.0;
        }
        let six = |[a, b, c]: [Point3; 3]| {
            let o = self.middle;
            (a - o).cross(&(b - o)).dot(&(c - o))
        };
        // The lid's own tetrahedra have their tip in its plane point: only the patch counts.
        let patch: f64 = triangles
            .iter()
            .map(|&f| six(surface.corners(f as usize)))
            .sum();
        (-patch / 6.0).max(0.0)
    }
}
