//! How far two segmentations differ: the measures of the Princeton benchmark (Chen, Golovinskiy and
//! Funkhouser, *A benchmark for 3D mesh segmentation*, 2009). All are errors: 0 is best.

use geom_core::surface::distance::{Graph, shortest_paths};
use geom_core::{TriMesh, Vector3};

use crate::Error;

/// The differences of a segmentation from a reference.
///
/// Rand difference and consistency errors count faces, the Hamming distance counts area.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct Difference {
    /// The share of pairs of faces that one puts together and the other apart (1 − Rand index).
    pub rand: f64,
    /// Hamming distance over area: the mean of `missing` and `false_alarm`.
    pub hamming: f64,
    /// The share of area that the best fitting segments do not cover.
    pub missing: f64,
    /// The share of area that the best fitting segments cover too much.
    pub false_alarm: f64,
    /// Global consistency error: 0 also where one refines the other.
    pub global_consistency: f64,
    /// Local consistency error: at most the global one.
    pub local_consistency: f64,
}

/// How often labels of both meet, by faces and by area.
/// Everything but the cut discrepancy follows from it, in time of the number of cells.
struct Contingency {
    /// `(a, b, faces, area)`, ascending.
    cells: Vec<(u32, u32, f64, f64)>,
    of_first: Vec<f64>,
    of_second: Vec<f64>,
    faces: f64,
    area: f64,
}

impl Contingency {
    fn of(first: &[u32], second: &[u32], areas: &[f64]) -> Result<Self, Error> {
        for (what, found) in [("the reference", second.len()), ("the areas", areas.len())] {
            if found != first.len() {
                let expected = first.len();
                return Err(Error::Length {
                    what,
                    found,
                    expected,
                });
            }
        }
        let (first, second) = (dense(first), dense(second));
        let mut pairs: Vec<(u32, u32, usize)> =
            (0..first.len()).map(|f| (first[f], second[f], f)).collect();
        pairs.sort_unstable();
        let cells: Vec<_> = pairs
            .chunk_by(|a, b| (a.0, a.1) == (b.0, b.1))
            .map(|cell| {
                let area: f64 = cell.iter().map(|c| areas[c.2]).sum();
                (cell[0].0, cell[0].1, cell.len() as f64, area)
            })
            .collect();
        let mut table = Self {
            cells,
            of_first: vec![0.0; first.iter().max().map_or(0, |&m| m as usize + 1)],
            of_second: vec![0.0; second.iter().max().map_or(0, |&m| m as usize + 1)],
            faces: first.len() as f64,
            area: areas.iter().sum(),
        };
        for &(a, b, faces, _) in &table.cells {
            table.of_first[a as usize] += faces;
            table.of_second[b as usize] += faces;
        }
        Ok(table)
    }

    /// Counted from the sizes of cells and labels, not from pairs: with `C(n) = n(n−1)/2` pairs among n faces it is
    /// `Σ C(a) + Σ C(b) − 2 Σ C(ab)` over all pairs.
    fn rand(&self) -> f64 {
        let pairs = |n: f64| 0.5 * n * (n - 1.0);
        let all = pairs(self.faces);
        if all <= 0.0 {
            return 0.0;
        }
        let sum = |values: &[f64]| values.iter().map(|&n| pairs(n)).sum::<f64>();
        let together: f64 = self.cells.iter().map(|c| pairs(c.2)).sum();
        (sum(&self.of_first) + sum(&self.of_second) - 2.0 * together) / all
    }

    /// The area that the best fitting cell of each label does not cover; `by` picks the label.
    fn uncovered(&self, labels: usize, by: impl Fn(&(u32, u32, f64, f64)) -> u32) -> f64 {
        if self.area <= 0.0 {
            return 0.0;
        }
        let mut best = vec![0.0f64; labels];
        for cell in &self.cells {
            let slot = &mut best[by(cell) as usize];
            *slot = slot.max(cell.3);
        }
        (self.area - best.iter().sum::<f64>()) / self.area
    }

    /// Global and local consistency errors.
    fn consistency(&self) -> [f64; 2] {
        let (mut first, mut second, mut local) = (0.0, 0.0, 0.0);
        for &(a, b, faces, _) in &self.cells {
            let e1 = 1.0 - faces / self.of_first[a as usize];
            let e2 = 1.0 - faces / self.of_second[b as usize];
            first += faces * e1;
            second += faces * e2;
            local += faces * e1.min(e2);
        }
        let n = self.faces.max(1.0);
        [f64::min(first, second) / n, local / n]
    }
}

/// Labels renumbered from 0 in the order of their values.
pub(super) fn dense(labels: &[u32]) -> Vec<u32> {
    let mut used = labels.to_vec();
    used.sort_unstable();
    used.dedup();
    labels
        .iter()
        .map(|l| used.partition_point(|u| u < l) as u32)
        .collect()
}

/// All differences that need no mesh; one label and one area per face. Labels are names only.
///
/// ```
/// let d = secondfund_ops::segment::metrics::difference(&[0, 0, 1, 1], &[0, 1, 1, 1], &[1.0; 4])?;
/// assert_eq!((d.rand, d.hamming, d.global_consistency, d.local_consistency), (0.5, 0.25, 0.25, 0.125));
/// # Ok::<(), secondfund_ops::Error>(())
/// ```
///
/// # Errors
/// [`Error::Length`] if there is not one label of the reference and one area per label.
pub fn difference(labels: &[u32], reference: &[u32], areas: &[f64]) -> Result<Difference, Error> {
    let table = Contingency::of(labels, reference, areas)?;
    let missing = table.uncovered(table.of_second.len(), |c| c.1);
    let false_alarm = table.uncovered(table.of_first.len(), |c| c.0);
    let [global_consistency, local_consistency] = table.consistency();
    Ok(Difference {
        rand: table.rand(),
        hamming: f64::midpoint(missing, false_alarm),
        missing,
        false_alarm,
        global_consistency,
        local_consistency,
    })
}

/// Cut discrepancy: the mean distance along edges from the vertices on the cuts of one segmentation to
/// those of the other, both ways, over the mean distance of the vertices from their centroid. `None` if
/// one of them has no cut. One mean over the cut vertices of both, as the benchmark's evaluator takes it.
///
/// # Errors
/// [`Error::Length`] if there is not one label per triangle, and what refuses the edges as a graph.
pub fn cut_discrepancy(
    mesh: &TriMesh,
    labels: &[u32],
    reference: &[u32],
) -> Result<Option<f64>, Error> {
    let expected = mesh.triangles().len();
    for found in [labels.len(), reference.len()] {
        if found != expected {
            let what = "the labels";
            return Err(Error::Length {
                what,
                found,
                expected,
            });
        }
    }
    let cuts = [labels, reference].map(|l| cut_vertices(mesh, l));
    if cuts.iter().any(Vec::is_empty) {
        return Ok(None);
    }
    let graph = Graph::of_edges(mesh)?;
    let mut sum = 0.0;
    let mut count = 0usize;
    for (from, to) in [(&cuts[0], &cuts[1]), (&cuts[1], &cuts[0])] {
        let sources: Vec<(u32, f64)> = to.iter().map(|&v| (v, 0.0)).collect();
        let paths = shortest_paths(&graph, &sources, f64::INFINITY)?;
        let reached = from.iter().map(|&v| paths.distance[v as usize]);
        for d in reached.filter(|d| d.is_finite()) {
            sum += d;
            count += 1;
        }
    }
    Ok((count > 0).then(|| sum / count as f64 / mean_radius(mesh)))
}

/// The ends of the edges between faces of different labels, ascending.
fn cut_vertices(mesh: &TriMesh, labels: &[u32]) -> Vec<u32> {
    let mut sides: Vec<([u32; 2], u32)> = mesh
        .triangles()
        .iter()
        .zip(labels)
        .flat_map(|(&[a, b, c], &l)| {
            [[a, b], [b, c], [c, a]].map(|[a, b]| ([a.min(b), a.max(b)], l))
        })
        .collect();
    sides.sort_unstable();
    let cut = |edge: &&[([u32; 2], u32)]| edge.iter().any(|s| s.1 != edge[0].1);
    let mut vertices: Vec<u32> = sides
        .chunk_by(|a, b| a.0 == b.0)
        .filter(cut)
        .flat_map(|edge| edge[0].0)
        .collect();
    vertices.sort_unstable();
    vertices.dedup();
    vertices
}

/// The mean distance of the vertices from their mean.
fn mean_radius(mesh: &TriMesh) -> f64 {
    let p = mesh.positions();
    let n = p.len().max(1) as f64;
    let center = p.iter().map(|x| x.coords).sum::<Vector3>() / n;
    p.iter().map(|x| (x.coords - center).norm()).sum::<f64>() / n
}
