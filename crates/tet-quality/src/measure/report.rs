//! Statistics of a mesh: extremes, histograms, the worst elements, per region.

use geom_core::compute::parallel;
use geom_core::mesh::Region;
use geom_core::{Cpu, Point3, TetMesh};

use crate::backend::QualityBackend;
use crate::measure::metrics::{Measures, aspect_ratio, radius_ratio};

/// Width of a bin of [`Summary::min_dihedral_histogram`] and [`Summary::max_dihedral_histogram`],
/// degrees.
pub const BIN_DEGREES: f64 = 5.0;
/// Bounds, in degrees, below which [`Summary::min_dihedral_below`] counts.
pub const LOW_ANGLES: [f64; 4] = [10.0, 15.0, 20.0, 30.0];
/// Bounds, in degrees, above which [`Summary::max_dihedral_above`] counts.
pub const HIGH_ANGLES: [f64; 2] = [155.0, 165.0];
/// How many of the worst elements a report names.
pub const WORST: usize = 10;

/// Smallest, mean and largest value of a measure.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Spread {
    /// Smallest value.
    pub min: f64,
    /// Mean value.
    pub mean: f64,
    /// Largest value.
    pub max: f64,
}

/// Statistics of a set of tetrahedra.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Summary {
    /// Number of tetrahedra.
    pub tets: usize,
    /// How many are inverted or flat (volume ≤ 0).
    pub inverted: usize,
    /// Sum of the signed volumes, Å³.
    pub volume: f64,
    /// Smallest dihedral angle per tetrahedron, degrees.
    pub min_dihedral: Spread,
    /// Largest dihedral angle per tetrahedron, degrees.
    pub max_dihedral: Spread,
    /// Joe–Liu measure.
    pub joe_liu: Spread,
    /// Longest over shortest edge.
    pub edge_ratio: Spread,
    /// Radius ratio: see [`radius_ratio`].
    pub radius_ratio: Spread,
    /// Longest edge over shortest altitude: see [`aspect_ratio`].
    pub aspect_ratio: Spread,
    /// Tetrahedra per 5° of smallest dihedral angle: `[0°, 5°)`, `[5°, 10°)`, …; 36 bins.
    pub min_dihedral_histogram: Vec<usize>,
    /// Tetrahedra per 5° of largest dihedral angle; 36 bins, the last one closed.
    pub max_dihedral_histogram: Vec<usize>,
    /// Tetrahedra per 0.05 of Joe–Liu measure from 0 to 1; 20 bins, the last one closed. Inverted ones
    /// count in the first.
    pub joe_liu_histogram: Vec<usize>,
    /// Tetrahedra per 0.05 of radius ratio from 0 to 1; 20 bins, the last one closed.
    pub radius_ratio_histogram: Vec<usize>,
    /// Tetrahedra per 0.5 of aspect ratio from 1 on; 20 bins, the last one open to above.
    pub aspect_ratio_histogram: Vec<usize>,
    /// How many have a smallest dihedral angle below each of [`LOW_ANGLES`].
    pub min_dihedral_below: [usize; 4],
    /// How many have a largest dihedral angle above each of [`HIGH_ANGLES`].
    pub max_dihedral_above: [usize; 2],
    /// How many have a Joe–Liu measure below 0.3.
    pub joe_liu_below_0_3: usize,
}

/// An element that a report names.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Element {
    /// Its number.
    pub tet: u32,
    /// Its centroid, Å.
    pub centroid: Point3,
    /// Its measures.
    pub measures: Measures,
}

/// Quality of a tetrahedral mesh. An empty mesh has an empty report: no tetrahedra, all spreads 0.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct QualityReport {
    /// All tetrahedra.
    pub all: Summary,
    /// The tetrahedra of each region that occurs, by number.
    pub regions: Vec<(Region, Summary)>,
    /// The ten worst elements: smallest sine of a dihedral angle first, inverted ones before all.
    pub worst: Vec<Element>,
}

/// Measures a mesh, on the CPU; [`report_of`] takes the measures of any backend.
///
/// ```
/// use tet_quality::{geom_core::{Point3, TetMesh}, quality_report};
/// let corners = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
/// let mesh = TetMesh::new(corners.map(Point3::from).to_vec(), vec![[0, 1, 2, 3]])?;
/// let report = quality_report(&mesh);
/// assert!((report.all.volume - 1.0 / 6.0).abs() < 1e-12);
/// assert!((report.all.max_dihedral.max - 90.0).abs() < 1e-9);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn quality_report(mesh: &TetMesh) -> QualityReport {
    let mut measures = Vec::new();
    Cpu.measure(mesh.positions(), mesh.tets(), &mut measures)
        .expect("the CPU kernel has no way to fail");
    report_of(mesh, &measures)
}

/// The report of a mesh whose elements have been measured, by any [`QualityBackend`]. The radius and aspect
/// ratios, which no backend measures, are added on the CPU.
///
/// ```
/// use tet_quality::geom_core::{Cpu, Point3, TetMesh};
/// use tet_quality::{QualityBackend, measure::report::report_of};
/// let corners = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
/// let mesh = TetMesh::new(corners.map(Point3::from).to_vec(), vec![[0, 1, 2, 3]])?;
/// let mut measures = Vec::new();
/// Cpu.measure(mesh.positions(), mesh.tets(), &mut measures)?;
/// assert_eq!(report_of(&mesh, &measures), tet_quality::quality_report(&mesh));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// # Panics
///
/// If there is not one [`Measures`] per tetrahedron.
pub fn report_of(mesh: &TetMesh, measures: &[Measures]) -> QualityReport {
    assert_eq!(measures.len(), mesh.tets().len(), "one value per element");
    // One pass over fixed chunks: a partial summary per region each, joined in order.
    let parts = parallel::fold_chunks(measures.len(), |range| {
        let mut regions: Vec<(Region, Partial)> = Vec::new();
        let mut worst: Vec<(f64, u32)> = Vec::new();
        for t in range {
            let region = mesh.regions()[t];
            let at = regions.iter().position(|r| r.0 == region);
            let at = at.unwrap_or_else(|| {
                regions.push((region, Partial::default()));
                regions.len() - 1
            });
            regions[at].1.add(&measures[t], mesh.corners(t));
            keep_worst(&mut worst, (badness(&measures[t]), t as u32));
        }
        (regions, worst)
    });
    // In the order of the chunks, so that sums do not depend on threads.
    let mut regions: Vec<(Region, Partial)> = Vec::new();
    let mut worst: Vec<(f64, u32)> = Vec::new();
    for (part, part_worst) in parts {
        for (region, partial) in part {
            match regions.iter_mut().find(|r| r.0 == region) {
                Some((_, sum)) => sum.join(&partial),
                None => regions.push((region, partial)),
            }
        }
        for w in part_worst {
            keep_worst(&mut worst, w);
        }
    }
    regions.sort_by_key(|r| r.0);
    let mut all = Partial::default();
    for (_, partial) in &regions {
        all.join(partial);
    }
    QualityReport {
        all: all.finish(),
        regions: regions.into_iter().map(|(r, p)| (r, p.finish())).collect(),
        worst: worst
            .into_iter()
            .map(|(_, tet)| {
                let sum = mesh
                    .corners(tet as usize)
                    .iter()
                    .fold(geom_core::Vector3::zeros(), |s, c| s + c.coords);
                Element {
                    tet,
                    centroid: Point3::from(sum / 4.0),
                    measures: measures[tet as usize],
                }
            })
            .collect(),
    }
}

/// Orders elements: the smallest first.
fn badness(m: &Measures) -> f64 {
    if m.six_volume > 0.0 {
        let (low, high) = (m.min_dihedral.to_radians(), m.max_dihedral.to_radians());
        low.sin().min(high.sin())
    } else {
        m.joe_liu
    }
}

/// Sorted, at most [`WORST`] of them; of equal ones the earlier stays, so that joined chunks give what one pass would.
fn keep_worst(worst: &mut Vec<(f64, u32)>, candidate: (f64, u32)) {
    if worst.len() == WORST && worst.last().is_some_and(|w| w.0 <= candidate.0) {
        return;
    }
    let at = worst.partition_point(|w| w.0 <= candidate.0);
    worst.insert(at, candidate);
    worst.truncate(WORST);
}

/// Empty until something is added: then its ends are infinite the wrong way round.
struct Range {
    min: f64,
    sum: f64,
    max: f64,
}

impl Default for Range {
    fn default() -> Self {
        Self {
            min: f64::INFINITY,
            sum: 0.0,
            max: f64::NEG_INFINITY,
        }
    }
}

impl Range {
    fn add(&mut self, value: f64) {
        self.min = self.min.min(value);
        self.sum += value;
        self.max = self.max.max(value);
    }
    fn join(&mut self, other: &Self) {
        self.min = self.min.min(other.min);
        self.sum += other.sum;
        self.max = self.max.max(other.max);
    }
    fn spread(&self, count: usize) -> Spread {
        if count == 0 {
            return Spread {
                min: 0.0,
                mean: 0.0,
                max: 0.0,
            };
        }
        Spread {
            min: self.min,
            mean: self.sum / count as f64,
            max: self.max,
        }
    }
}

/// Sums that become a [`Summary`].
#[derive(Default)]
struct Partial {
    tets: usize,
    inverted: usize,
    six_volume: f64,
    min_dihedral: Range,
    max_dihedral: Range,
    joe_liu: Range,
    edge_ratio: Range,
    radius_ratio: Range,
    aspect_ratio: Range,
    histograms: Histograms,
    below: [usize; 4],
    above: [usize; 2],
    poor: usize,
}

struct Histograms {
    min: [usize; 36],
    max: [usize; 36],
    joe_liu: [usize; 20],
    radius_ratio: [usize; 20],
    aspect_ratio: [usize; 20],
}

impl Default for Histograms {
    fn default() -> Self {
        Self {
            min: [0; 36],
            max: [0; 36],
            joe_liu: [0; 20],
            radius_ratio: [0; 20],
            aspect_ratio: [0; 20],
        }
    }
}

impl Partial {
    fn add(&mut self, m: &Measures, corners: [Point3; 4]) {
        self.tets += 1;
        self.inverted += usize::from(m.six_volume <= 0.0);
        self.six_volume += m.six_volume;
        self.min_dihedral.add(m.min_dihedral);
        self.max_dihedral.add(m.max_dihedral);
        self.joe_liu.add(m.joe_liu);
        self.edge_ratio.add(m.edge_ratio);
        let bin = |angle: f64| ((angle / BIN_DEGREES) as usize).min(35);
        self.histograms.min[bin(m.min_dihedral)] += 1;
        self.histograms.max[bin(m.max_dihedral)] += 1;
        // The conversion of what is below 0 gives 0.
        let part = |share: f64| ((share * 20.0) as usize).min(19);
        self.histograms.joe_liu[part(m.joe_liu)] += 1;
        let (radii, aspect) = (radius_ratio(corners), aspect_ratio(corners));
        self.radius_ratio.add(radii);
        self.aspect_ratio.add(aspect);
        self.histograms.radius_ratio[part(radii)] += 1;
        self.histograms.aspect_ratio[((2.0 * (aspect - 1.0)) as usize).min(19)] += 1;
        for (count, bound) in self.below.iter_mut().zip(LOW_ANGLES) {
            *count += usize::from(m.min_dihedral < bound);
        }
        for (count, bound) in self.above.iter_mut().zip(HIGH_ANGLES) {
            *count += usize::from(m.max_dihedral > bound);
        }
        self.poor += usize::from(m.joe_liu < 0.3);
    }

    fn join(&mut self, other: &Self) {
        self.tets += other.tets;
        self.inverted += other.inverted;
        self.six_volume += other.six_volume;
        self.min_dihedral.join(&other.min_dihedral);
        self.max_dihedral.join(&other.max_dihedral);
        self.joe_liu.join(&other.joe_liu);
        self.edge_ratio.join(&other.edge_ratio);
        self.radius_ratio.join(&other.radius_ratio);
        self.aspect_ratio.join(&other.aspect_ratio);
        let add = |a: &mut [usize], b: &[usize]| a.iter_mut().zip(b).for_each(|(a, b)| *a += b);
        add(&mut self.histograms.min, &other.histograms.min);
        add(&mut self.histograms.max, &other.histograms.max);
        add(&mut self.histograms.joe_liu, &other.histograms.joe_liu);
        add(
            &mut self.histograms.radius_ratio,
            &other.histograms.radius_ratio,
        );
        add(
            &mut self.histograms.aspect_ratio,
            &other.histograms.aspect_ratio,
        );
        add(&mut self.below, &other.below);
        add(&mut self.above, &other.above);
        self.poor += other.poor;
    }

    fn finish(self) -> Summary {
        let n = self.tets;
        Summary {
            tets: n,
            inverted: self.inverted,
            volume: self.six_volume / 6.0,
            min_dihedral: self.min_dihedral.spread(n),
            max_dihedral: self.max_dihedral.spread(n),
            joe_liu: self.joe_liu.spread(n),
            edge_ratio: self.edge_ratio.spread(n),
            radius_ratio: self.radius_ratio.spread(n),
            aspect_ratio: self.aspect_ratio.spread(n),
            min_dihedral_histogram: self.histograms.min.to_vec(),
            max_dihedral_histogram: self.histograms.max.to_vec(),
            joe_liu_histogram: self.histograms.joe_liu.to_vec(),
            radius_ratio_histogram: self.histograms.radius_ratio.to_vec(),
            aspect_ratio_histogram: self.histograms.aspect_ratio.to_vec(),
            min_dihedral_below: self.below,
            max_dihedral_above: self.above,
            joe_liu_below_0_3: self.poor,
        }
    }
}
