//! What several segmentations agree on: the partition that differs least from all of them.
//!
//! The mean Rand difference of a partition to given ones is a sum over pairs of points: a pair that is together costs
//! the share of the segmentations that part it, a pair apart the share of those that do not. Its minimum is a
//! correlation clustering (Bansal, Blum and Chawla, 2004; Gionis, Mannila and Tsaparas, *Clustering aggregation*, 2007),
//! and the number of parts comes out of it.

use geom_core::options::require;

use super::faces::Faces;
use super::metrics::dense;
use crate::Error;

/// Cells that all segmentations leave whole, by falling area; smaller ones follow these.
const CELLS: usize = 400;
/// Most rounds of moves.
const ROUNDS: usize = 50;

/// One label per face: the partition that differs least, by the mean Rand difference over area, from the labelings;
/// found by merging and moving the pieces that all of them leave whole. Parts may be of several pieces.
///
/// ```
/// use secondfund_ops::{Faces, geom_core::mesh::shapes, segment::consensus};
/// let faces = Faces::from(&shapes::icosphere(1.0, 0));
/// let half = |at: u32| (0..20).map(|f| u32::from(f < at)).collect::<Vec<_>>();
/// let common = consensus(&faces, &[half(10), half(10), half(13)])?;
/// assert!((0..20).all(|f| (common[f] == common[0]) == (f < 10)));
/// # Ok::<(), secondfund_ops::Error>(())
/// ```
///
/// # Errors
/// No labelings, or one of another number of faces.
pub fn consensus(faces: &Faces, labelings: &[Vec<u32>]) -> Result<Vec<u32>, Error> {
    let count = labelings.len();
    require(count > 0, "labelings", count, "be at least 1")?;
    for labels in labelings {
        let (found, expected) = (labels.len(), faces.len());
        if found != expected {
            let what = "a labeling";
            return Err(Error::Length {
                what,
                found,
                expected,
            });
        }
    }
    let cells = Cells::of(faces, labelings);
    let taken = cells.areas.len().min(CELLS);
    let agreement = cells.agreement(taken);
    let mut groups = merged(&agreement, &cells.areas[..taken]);
    moved(&agreement, &cells.areas[..taken], &mut groups);
    let of_cells = cells.follow(&groups);
    Ok(cells.of_faces.iter().map(|&c| of_cells[c]).collect())
}

/// Faces that all labelings keep together, the largest cell first.
struct Cells {
    of_faces: Vec<usize>,
    areas: Vec<f64>,
    /// The labels of a cell, one per labeling.
    labels: Vec<Vec<u32>>,
}

impl Cells {
    fn of(faces: &Faces, labelings: &[Vec<u32>]) -> Self {
        let labelings: Vec<Vec<u32>> = labelings.iter().map(|l| dense(l)).collect();
        let labels = |f: usize| labelings.iter().map(move |l| l[f]);
        let mut order: Vec<usize> = (0..faces.len()).collect();
        order.sort_by(|&f, &g| labels(f).cmp(labels(g)).then(f.cmp(&g)));
        let mut cells: Vec<(f64, &[usize])> = order
            .chunk_by(|&f, &g| labels(f).eq(labels(g)))
            .map(|cell| (cell.iter().map(|&f| faces.areas()[f]).sum(), cell))
            .collect();
        cells.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1[0].cmp(&b.1[0])));
        let mut of_faces = vec![0; faces.len()];
        for (c, (_, members)) in cells.iter().enumerate() {
            members.iter().for_each(|&f| of_faces[f] = c);
        }
        Self {
            of_faces,
            areas: cells.iter().map(|c| c.0).collect(),
            labels: cells.iter().map(|c| labels(c.1[0]).collect()).collect(),
        }
    }

    /// Of the first cells, pair by pair: by how many more labelings keep them together than part them, over all.
    fn agreement(&self, taken: usize) -> Vec<Vec<f64>> {
        let one = |a: &Vec<u32>, b: &Vec<u32>| {
            let together = a.iter().zip(b).filter(|(x, y)| x == y).count();
            2.0 * together as f64 / a.len() as f64 - 1.0
        };
        let row = |a| self.labels[..taken].iter().map(|b| one(a, b)).collect();
        self.labels[..taken].iter().map(row).collect()
    }

    /// The group of every cell: that with which it agrees most, by the groups of the first ones.
    fn follow(&self, groups: &[usize]) -> Vec<u32> {
        let count = groups.iter().max().map_or(0, |g| g + 1);
        let mut areas = vec![0.0; count];
        // Per labeling and label the area of each group.
        let mut tables: Vec<Vec<f64>> = Vec::new();
        for (c, &g) in groups.iter().enumerate() {
            areas[g] += self.areas[c];
            tables.resize(self.labels[c].len(), Vec::new());
            for (table, &l) in tables.iter_mut().zip(&self.labels[c]) {
                let slot = l as usize * count + g;
                table.resize(table.len().max((l as usize + 1) * count), 0.0);
                table[slot] += self.areas[c];
            }
        }
        let best = |labels: &Vec<u32>| {
            let score = |g: usize| {
                let slots = tables.iter().zip(labels);
                let together: f64 = slots
                    .map(|(t, &l)| t.get(l as usize * count + g).copied().unwrap_or(0.0))
                    .sum();
                2.0 * together - labels.len() as f64 * areas[g]
            };
            let scores: Vec<f64> = (0..count).map(score).collect();
            first_largest(&scores) as u32
        };
        let followers = self.labels[groups.len()..].iter().map(best);
        groups.iter().map(|&g| g as u32).chain(followers).collect()
    }
}

/// Cells merged by the largest mean agreement, as long as it is positive.
fn merged(agreement: &[Vec<f64>], areas: &[f64]) -> Vec<usize> {
    let n = areas.len();
    let mut sums: Vec<Vec<f64>> = (0..n)
        .map(|a| {
            (0..n)
                .map(|b| agreement[a][b] * areas[a] * areas[b])
                .collect()
        })
        .collect();
    let mut sizes = areas.to_vec();
    let mut group: Vec<usize> = (0..n).collect();
    let mut alive = group.clone();
    loop {
        let mut best = (0.0, 0, 0);
        for (i, &a) in alive.iter().enumerate() {
            for &b in &alive[i + 1..] {
                // Agreement of nothing with something counts nothing.
                let mean = sums[a][b] / (sizes[a] * sizes[b]).max(f64::MIN_POSITIVE);
                if mean > best.0 {
                    best = (mean, a, b);
                }
            }
        }
        let (mean, a, b) = best;
        if mean <= 0.0 {
            break;
        }
        for &c in &alive {
            let sum = sums[a][c] + sums[b][c];
            (sums[a][c], sums[c][a]) = (sum, sum);
        }
        sizes[a] += sizes[b];
        alive.retain(|&c| c != b);
        group.iter_mut().filter(|g| **g == b).for_each(|g| *g = a);
    }
    group
}

/// Moves each cell to the group with which it agrees most, until none gains.
fn moved(agreement: &[Vec<f64>], areas: &[f64], groups: &mut [usize]) {
    let total: f64 = areas.iter().sum();
    for _ in 0..ROUNDS {
        let mut any = false;
        for c in 0..groups.len() {
            let mut sums = vec![0.0; groups.len()];
            for (d, &area) in areas.iter().enumerate().filter(|&(d, _)| d != c) {
                sums[groups[d]] += area * agreement[c][d];
            }
            let best = first_largest(&sums);
            if sums[best] > sums[groups[c]] + 1e-9 * total {
                groups[c] = best;
                any = true;
            }
        }
        if !any {
            break;
        }
    }
}

/// Where the largest value stands first.
pub(super) fn first_largest(values: &[f64]) -> usize {
    let better = |best: usize, i: usize| {
        if values[i] > values[best] { i } else { best }
    };
    (1..values.len()).fold(0, better)
}
