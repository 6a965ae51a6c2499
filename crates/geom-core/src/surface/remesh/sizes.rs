//! How long the edges shall be where: the lengths asked for, and spots where they became shorter.

use std::collections::BTreeMap;

use super::options::{Error, Sizing};
use crate::compute::parallel;
use crate::mesh::quality::edge_lengths;
use crate::surface::distance::{Graph, shortest_paths};
use crate::{Point3, TriMesh};

/// Wanted lengths at the vertices of the input.
pub(super) enum Sizes {
    Same(f64),
    PerVertex(Vec<f64>),
}

impl Sizes {
    pub(super) fn at(&self, v: u32) -> f64 {
        match self {
            Self::Same(size) => *size,
            Self::PerVertex(sizes) => sizes[v as usize],
        }
    }

    /// The longest that is a finite number.
    pub(super) fn longest(&self) -> f64 {
        match self {
            Self::Same(size) => *size,
            Self::PerVertex(sizes) => sizes
                .iter()
                .copied()
                .filter(|s| s.is_finite())
                .fold(0.0, f64::max),
        }
    }
}

/// The lengths that the options ask for. By curvature: the length of Dunyach and others at each vertex, then the
/// largest function below it whose slope along edges is at most the gradation, which is one run of Dijkstra from all
/// vertices at once, each starting at its own length.
pub(super) fn sizes(input: &TriMesh, sizing: &Sizing) -> Result<Sizes, Error> {
    Ok(match *sizing {
        Sizing::Uniform {
            edge_length: Some(length),
        } => Sizes::Same(length),
        Sizing::Uniform { edge_length: None } => {
            let n = input.triangles().len();
            let sum = parallel::sum(n, |t| edge_lengths(input.corners(t)).iter().sum());
            Sizes::Same(sum / (3 * n) as f64)
        }
        Sizing::Curvature {
            tolerance,
            min_edge,
            max_edge,
            gradation,
        } => {
            let curvature = crate::surface::curvature::principal(input, 2);
            let wanted = curvature.iter().map(|c| {
                let largest = c.max.abs().max(c.min.abs());
                // For κ → 0 the root grows without bound, and for κ ε > 2 there is none.
                let squared = 6.0 * tolerance / largest - 3.0 * tolerance * tolerance;
                squared.max(0.0).sqrt().clamp(min_edge, max_edge)
            });
            // The largest lengths that grow no faster along edges than allowed.
            let sources: Vec<(u32, f64)> = (0..)
                .zip(wanted)
                .map(|(v, length)| (v, length / gradation))
                .collect();
            let paths = shortest_paths(&Graph::of_edges(input)?, &sources, f64::INFINITY)?;
            Sizes::PerVertex(paths.distance.iter().map(|d| d * gradation).collect())
        }
    })
}

/// Equilateral triangles of the wanted edge lengths on the area of the input.
pub(super) fn expected_triangles(input: &TriMesh, sizes: &Sizes) -> f64 {
    parallel::sum(input.triangles().len(), |t| {
        let length = match sizes {
            Sizes::Same(length) => *length,
            Sizes::PerVertex(sizes) => {
                input.triangles()[t]
                    .iter()
                    .map(|&v| sizes[v as usize])
                    .sum::<f64>()
                    / 3.0
            }
        };
        let area = 0.5 * input.doubled_area_normal(t).norm();
        area / (3f64.sqrt() / 4.0 * length * length)
    })
}

/// Places with a wanted length of their own, which grows with the distance from them.
///
/// A spot of length s wants `s + slope · d` at the distance d, and has no say where that is longer than what is asked
/// for anyway, so that 27 cells around it are all that it can reach. The least of all spots counts.
#[derive(Default)]
pub(super) struct Spots {
    /// Growth of the length per Å.
    slope: f64,
    /// Edge of the cubes that the spots are looked up by; at least as long as any spot reaches.
    cell: f64,
    spots: Vec<(Point3, f64)>,
    /// Spots from here on are new.
    fresh: usize,
    /// Every place is new.
    everywhere: bool,
    cells: BTreeMap<[i64; 3], Vec<u32>>,
}

impl Spots {
    pub(super) fn new(slope: f64, longest: f64) -> Self {
        Self {
            slope,
            cell: longest / slope,
            spots: Vec::new(),
            fresh: 0,
            everywhere: true,
            cells: BTreeMap::new(),
        }
    }

    fn key(&self, p: &Point3) -> [i64; 3] {
        [p.x, p.y, p.z].map(|c| (c / self.cell).floor() as i64)
    }

    /// Lets every place be new, for a start from the input.
    pub(super) fn renew(&mut self) {
        self.everywhere = true;
    }

    /// Is there none yet?
    pub(super) fn is_empty(&self) -> bool {
        self.spots.is_empty()
    }

    /// May any spot have a say at `p`?
    pub(super) fn reach(&self, p: &Point3) -> bool {
        self.cells.contains_key(&self.key(p))
    }

    /// The length at `p` where `wanted` is asked for, and whether the newest spots have a say in it.
    pub(super) fn at(&self, p: &Point3, wanted: f64) -> (f64, bool) {
        if self.spots.is_empty() {
            return (wanted, self.everywhere);
        }
        let (mut old, mut new) = (wanted, wanted);
        for &i in self.cells.get(&self.key(p)).into_iter().flatten() {
            let (spot, length) = &self.spots[i as usize];
            let length = length + self.slope * (p - spot).norm();
            if (i as usize) < self.fresh {
                old = old.min(length);
            } else {
                new = new.min(length);
            }
        }
        (old.min(new), self.everywhere || new < old)
    }

    /// Takes up the places where the length is to be shorter than it is; how many are new?
    pub(super) fn add(
        &mut self,
        mut places: Vec<(Point3, f64)>,
        wanted_near: impl Fn(&Point3) -> f64,
    ) -> usize {
        // The shortest first; what they cover needs no spot of its own.
        places.sort_by(|(p, s), (q, t)| {
            let order = |a: &Point3, b: &Point3| {
                a.x.total_cmp(&b.x)
                    .then(a.y.total_cmp(&b.y))
                    .then(a.z.total_cmp(&b.z))
            };
            s.total_cmp(t).then_with(|| order(p, q))
        });
        self.fresh = self.spots.len();
        self.everywhere = false;
        for (p, length) in places {
            let wanted = wanted_near(&p);
            if length >= 0.95 * self.at(&p, wanted).0 {
                continue;
            }
            let number = self.spots.len() as u32;
            self.spots.push((p, length));
            let [x, y, z] = self.key(&p);
            for k in 0..27 {
                let near = [x + k % 3 - 1, y + k / 3 % 3 - 1, z + k / 9 - 1];
                self.cells.entry(near).or_default().push(number);
            }
        }
        self.spots.len() - self.fresh
    }
}
