//! The whole way from modes to segments.
//!
//! One search serves all that is asked of a spectrum: rows of the modes, a sample drawn by area, the distances of all
//! its pairs (the one kernel of a backend here). Numbers of groups are tried on the sample; the best of several starts
//! is chosen by the loss over all vertices. What comes out are medoids, by which faces are labelled, and `clean` makes
//! segments of these.

use geom_core::Run;
use geom_core::compute::{BackendError, parallel};
use geom_core::options::{OutOfRange, require};
use rayon::prelude::*;

use super::clean::clean;
use super::cluster::{Medoids, davies_bouldin, medoid_silhouette, medoids};
use super::embed::{Rows, squared};
use super::faces::Faces;
use crate::Error;
use crate::backend::{On, OperatorBackend};
use crate::operators::Spectrum;
use crate::options::{Groups, LEAST_MODES, MOST_MODES, Modes, SEARCH_MODES, SegmentOptions};
use geom_core::compute::random::SplitMix64;

/// The modes in the rows for a number of groups.
/// Never more than there are.
fn modes_of(options: &SegmentOptions, groups: usize, spectrum: &Spectrum) -> usize {
    let wanted = match options.modes {
        Modes::EigenGap => eigen_gap(&spectrum.values),
        Modes::Count(count) => count,
        Modes::Auto => groups.clamp(LEAST_MODES, MOST_MODES),
    };
    wanted.min(spectrum.values.len())
}

/// The number of groups as asked, and the numbers that were tried.
fn number_of_groups(
    spectrum: &Spectrum,
    options: &SegmentOptions,
    run: On<'_>,
) -> Result<(usize, Vec<GroupChoice>), Error> {
    let (Groups::DaviesBouldin { most } | Groups::Silhouette { most }) = options.groups else {
        let Groups::Count(count) = options.groups else {
            unreachable!("all other groups are sought");
        };
        return Ok((count, Vec::new()));
    };
    let count = match options.modes {
        Modes::Auto => SEARCH_MODES.min(spectrum.values.len()),
        _ => modes_of(options, most, spectrum),
    };
    let search = Search::of(spectrum, count, *options, run)?;
    let choices = search.choices(most, run)?;
    let best = match options.groups {
        Groups::Silhouette { .. } => sought(&choices, NEARLY),
        _ => choices
            .iter()
            .min_by(|a, b| a.davies_bouldin.total_cmp(&b.davies_bouldin))
            .map_or(1, |c| c.groups),
    };
    Ok((best, choices))
}

/// Of the numbers whose silhouette is at least this share of the largest the smallest is taken.
const NEARLY: f64 = 0.99;

/// The modes before the gap; all of them where there are fewer than two.
fn eigen_gap(values: &[f64]) -> usize {
    let ratio = |k: usize| values[k] / values[k - 1].max(f64::MIN_POSITIVE);
    (1..values.len().min(MOST_MODES))
        .reduce(|a, b| if ratio(b) > ratio(a) { b } else { a })
        .unwrap_or(values.len())
}

/// A number of groups that was tried.
/// Both indices are of the sample, before groups fall into connected patches.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct GroupChoice {
    /// The number.
    pub groups: usize,
    /// Its index of Davies and Bouldin.
    pub davies_bouldin: f64,
    /// Its medoid silhouette.
    pub silhouette: f64,
}

/// A segmentation.
#[derive(Clone, Debug, PartialEq)]
pub struct Segments {
    /// The segment of each face, from 0 by decreasing area.
    pub labels: Vec<u32>,
    /// The area of each segment, in the unit of the faces.
    pub areas: Vec<f64>,
    /// Groups of rows, before they fell into connected patches.
    pub groups: usize,
    /// Modes in the rows.
    pub modes: usize,
    /// The numbers of groups that were tried.
    /// Empty where the number was given.
    pub choices: Vec<GroupChoice>,
    /// The vertices in the middle of the groups.
    pub medoids: Vec<u32>,
}

/// Segments of the faces on which the modes of `spectrum` live.
///
/// The faces may be those of the mesh of the spectrum or coarser and finer ones, as long as their corners are its
/// vertices: of a limit surface, those of [`Surface::limit_mesh`](crate::Surface::limit_mesh). Labels are by face, in
/// the order of `faces`.
///
/// # Errors
/// Options out of range, faces of another mesh.
pub fn segment<B: OperatorBackend + ?Sized>(
    spectrum: &Spectrum,
    faces: &Faces,
    options: &SegmentOptions,
    run: Run<'_, B>,
) -> Result<Segments, Error> {
    segment_on(
        spectrum,
        faces,
        options,
        run.with(run.backend.as_operators()),
    )
}

fn segment_on(
    spectrum: &Spectrum,
    faces: &Faces,
    options: &SegmentOptions,
    run: On<'_>,
) -> Result<Segments, Error> {
    options.check()?;
    let has = spectrum.values.len();
    require(has > 0, "modes", has, "be at least 1 in the spectrum")?;
    match options.modes {
        Modes::Count(count) if count > has => {
            let must = format!("be at most the {has} of the spectrum");
            return Err(OutOfRange::new("modes", count, must).into());
        }
        _ => {}
    }
    check_vertices(spectrum, faces)?;
    let (groups, choices) = number_of_groups(spectrum, options, run)?;
    let count = modes_of(options, groups, spectrum);
    let search = Search::of(spectrum, count, *options, run)?;
    let medoids = search.medoids(groups);
    let rows = search.rows;
    let labels = label_faces(faces, &rows, &medoids);
    let labels = clean(faces, &labels, spectrum.scale, options.smooth)?;
    Ok(Segments {
        areas: areas_of(faces, &labels),
        labels,
        groups: medoids.len(),
        modes: rows.width,
        choices,
        medoids,
    })
}

/// Refuses faces with corners that have no modes.
pub(super) fn check_vertices(spectrum: &Spectrum, faces: &Faces) -> Result<(), Error> {
    let vertices = spectrum.areas.len();
    match faces
        .all_corners()
        .iter()
        .find(|&&v| v as usize >= vertices)
    {
        Some(&beyond) => Err(Error::Length {
            what: "the modes",
            found: vertices,
            expected: beyond as usize + 1,
        }),
        None => Ok(()),
    }
}

/// The area of each label.
pub(super) fn areas_of(faces: &Faces, labels: &[u32]) -> Vec<f64> {
    let count = labels.iter().max().map_or(0, |&l| l as usize + 1);
    let mut areas = vec![0.0; count];
    for (&label, area) in labels.iter().zip(faces.areas()) {
        areas[label as usize] += area;
    }
    areas
}

/// The smallest number of groups whose silhouette is at least this share of the largest; 1 if none was tried.
/// Choices stand in the order of their numbers.
pub(super) fn sought(choices: &[GroupChoice], nearly: f64) -> usize {
    let largest = choices.iter().map(|c| c.silhouette).fold(0.0, f64::max);
    let good = choices.iter().find(|c| c.silhouette >= nearly * largest);
    good.map_or(1, |c| c.groups)
}

/// One vertex per stratum of equal area, at a random place of it; vertices of large area may come twice.
/// All of them if there are no more than asked for. Vertices without area are never drawn.
fn draw(areas: &[f64], count: usize, seed: u64) -> Vec<u32> {
    let used: Vec<u32> = (0..areas.len() as u32)
        .filter(|&v| areas[v as usize] > 0.0)
        .collect();
    if used.len() <= count {
        return used;
    }
    let total: f64 = used.iter().map(|&v| areas[v as usize]).sum();
    let mut random = SplitMix64::new(seed);
    let mut drawn = Vec::with_capacity(count);
    let (mut at, mut reached) = (0, areas[used[0] as usize]);
    for stratum in 0..count {
        let place = total * (stratum as f64 + random.unit()) / count as f64;
        while reached < place && at + 1 < used.len() {
            at += 1;
            reached += areas[used[at] as usize];
        }
        drawn.push(used[at]);
    }
    drawn
}

/// Nearest medoid of each face's mean row; of equally near ones the first.
pub(super) fn label_faces(faces: &Faces, rows: &Rows, medoids: &[u32]) -> Vec<u32> {
    parallel::map_init(faces.len(), Vec::new, |mean, f| {
        rows.mean(faces.corners(f), mean);
        nearest(rows, medoids, mean).0
    })
}

/// The group whose medoid is nearest to a row, and the distance.
fn nearest(rows: &Rows, medoids: &[u32], row: &[f32]) -> (u32, f32) {
    let mut best = (0, f32::INFINITY);
    for (group, &m) in medoids.iter().enumerate() {
        let d = squared(rows.row(m as usize), row);
        if d < best.1 {
            best = (group as u32, d);
        }
    }
    (best.0, best.1.sqrt())
}

/// What the search for groups reads.
/// Distances take `4 n²` bytes for n drawn vertices; all numbers of groups are tried on the same ones.
pub(super) struct Search<'a> {
    pub(super) rows: Rows,
    drawn: Rows,
    sample: Vec<u32>,
    areas: &'a [f64],
    distances: Vec<f32>,
    options: SegmentOptions,
}

impl<'a> Search<'a> {
    /// The rows of `modes` modes, a sample of them and its distances.
    pub(super) fn of(
        spectrum: &'a Spectrum,
        modes: usize,
        options: SegmentOptions,
        run: On<'_>,
    ) -> Result<Self, Error> {
        let rows = Rows::of(spectrum, modes);
        let sample = draw(&spectrum.areas, options.sample, options.seed);
        let drawn = rows.of_sample(&sample);
        let mut distances = Vec::new();
        run.backend
            .distances(&drawn.values, drawn.width, &mut distances)?;
        let (found, of) = (distances.len(), sample.len() * sample.len());
        BackendError::unless(found == of, &run.backend.name(), || {
            format!("{found} distances for {of} pairs")
        })?;
        Ok(Self {
            rows,
            drawn,
            sample,
            areas: &spectrum.areas,
            distances,
            options,
        })
    }

    /// Every number of groups from 2 to `most` with its indices.
    pub(super) fn choices(&self, most: usize, run: On<'_>) -> Result<Vec<GroupChoice>, Error> {
        let n = self.sample.len();
        let mut choices = Vec::new();
        for groups in 2..=most.min(n) {
            run.progress("groups", groups as u64 - 1, most as u64)?;
            let found = self.best(groups);
            choices.push(GroupChoice {
                groups,
                davies_bouldin: davies_bouldin(&self.drawn.values, self.drawn.width, &found.group),
                silhouette: medoid_silhouette(&self.distances, n, &found.medoids),
            });
        }
        Ok(choices)
    }

    /// The vertices in the middle of this many groups, fewer if there are fewer vertices.
    pub(super) fn medoids(&self, groups: usize) -> Vec<u32> {
        let found = self.best(groups.min(self.sample.len()));
        let vertices = found.medoids.iter().map(|&m| self.sample[m as usize]);
        vertices.collect()
    }

    /// The best of the restarts, by the loss over all vertices (CLARA with our sample: Kaufman and
    /// Rousseeuw, 1990).
    fn best(&self, groups: usize) -> Medoids {
        let n = self.sample.len();
        let seeds: Vec<u64> = (0..self.options.restarts as u64)
            .map(|r| self.options.seed.wrapping_add(1 + r))
            .collect();
        let found: Vec<(f64, Medoids)> = seeds
            .into_par_iter()
            .map(|seed| {
                let found = medoids(&self.distances, n, groups, seed);
                (self.loss_over_all(&found), found)
            })
            .collect();
        found
            .into_iter()
            .min_by(|a, b| a.0.total_cmp(&b.0))
            .expect("at least one restart")
            .1
    }

    /// Weighted by area: a sample is only a guess of it.
    fn loss_over_all(&self, found: &Medoids) -> f64 {
        let vertices: Vec<u32> = found
            .medoids
            .iter()
            .map(|&m| self.sample[m as usize])
            .collect();
        parallel::sum(self.rows.len(), |v| {
            self.areas[v] * f64::from(nearest(&self.rows, &vertices, self.rows.row(v)).1)
        })
    }
}
