//! Maps from features: each node goes to the node of the other shape with the nearest row.
//!
//! A feature is a row of numbers per node that does not care where the body stands. Modes are such rows, but each is known only up
//! to its sign, and the order of two only where their eigenvalues are apart. So signs and swaps are tried: all signs of the first
//! few modes, then one mode more at a time, and the combination whose map distorts least goes on. A node of the one shape
//! goes to that of the other whose row is nearest, which is right in general and wrong in places; what follows has to clean it.

use geom_core::Point3;

use super::{Boundary, Candidate, Judge};
use crate::Error;
use crate::backend::{Kernels, On, Rows};
use crate::options::HistogramOptions;

/// How many modes the spectral starts take.
const COUNTS: [usize; 6] = [1, 2, 3, 4, 5, 8];
/// All signs of this many modes are tried; further ones one after the other.
const ALL_SIGNS: usize = 4;
/// Neighbours in order are swapped if their eigenvalues differ by less than this share.
const SWAP: f64 = 0.1;

/// The thesis's start (Eq. 6.7) with both signs of the first mode.
/// Candidates are images of the spread nodes of the first shape, with their distortion as score.
pub(crate) fn of_histograms(
    a: &Boundary<'_>,
    b: &Boundary<'_>,
    options: &HistogramOptions,
    judge: &Judge,
    run: On<'_>,
) -> Result<Vec<Candidate>, Error> {
    let bars = options.bars;
    // The weight of the mode, in standard deviations: without it the mode silently rules.
    let spread: f64 = (0..bars)
        .map(|bar| variance(a.histograms[bar..].iter().step_by(bars)))
        .sum();
    let mode = variance(a.modes[0].iter());
    let weight = options.mode * (spread / mode.max(f64::MIN_POSITIVE)).sqrt();
    let rows = |of: &Boundary<'_>, nodes: &[u32], sign: f64| -> Vec<f64> {
        let row = |&n: &u32| {
            let n = n as usize;
            let bars = of.histograms[n * bars..][..bars].iter().copied();
            bars.chain([sign * weight * of.modes[0][n]])
                .collect::<Vec<_>>()
        };
        nodes.iter().flat_map(row).collect()
    };
    let all: Vec<u32> = (0..b.side.points.len() as u32).collect();
    let queries = rows(a, &a.spread, 1.0);
    [("+", 1.0), ("−", -1.0)]
        .into_iter()
        .map(|(name, sign)| {
            let targets = rows(b, &all, sign);
            let images = nearest_points(&queries, &targets, bars + 1, b, run)?;
            Ok(Candidate {
                name: format!("histograms{name}"),
                score: judge.score(&images, run)?,
                images,
            })
        })
        .collect()
}

/// The mean square from the mean.
fn variance<'a>(values: impl Iterator<Item = &'a f64> + Clone) -> f64 {
    let count = values.clone().count().max(1) as f64;
    let mean = values.clone().sum::<f64>() / count;
    values.map(|v| (v - mean) * (v - mean)).sum::<f64>() / count
}

/// Where the nodes with the nearest rows are.
/// Of each query in order; several may go to one node.
fn nearest_points(
    queries: &[f64],
    targets: &[f64],
    width: usize,
    b: &Boundary<'_>,
    run: On<'_>,
) -> Result<Vec<Point3>, Error> {
    let rows = |values| Rows { values, width };
    let mut found = Vec::new();
    run.nearest(rows(queries), rows(targets), &mut found)?;
    Ok(found
        .iter()
        .map(|n| b.side.points[n.index as usize])
        .collect())
}

/// The first modes of both shapes, matched in order: all signs of the first four, further signs one after the other,
/// and swaps of neighbours whose eigenvalues are close.
/// What is tried is scored on as many nodes as the judge looks at; the best twelve become candidates.
pub(crate) fn of_modes(
    a: &Boundary<'_>,
    b: &Boundary<'_>,
    judge: &Judge,
    run: On<'_>,
) -> Result<Vec<Candidate>, Error> {
    let most = a.modes.len().min(b.modes.len());
    let search = Search {
        a,
        b,
        judge,
        run,
        all: (0..b.side.points.len() as u32).collect(),
    };
    let mut out = Vec::new();
    for order in orders(&b.values, most) {
        // All signs of the first modes, the best first; of those some go on to more modes.
        for count in COUNTS.into_iter().filter(|&c| c <= most) {
            let order = &order[..count];
            let swapped = order.iter().enumerate().any(|(i, &o)| i != o);
            if !swapped && out.iter().any(|t: &Tried| t.order == order) {
                continue;
            }
            run.progress("modes", out.len() as u64, 0)?;
            for signs in search.signs(order)? {
                let images = search.images(&signs, order, judge.nodes())?;
                let score = judge.score(&images, run)?;
                out.push(Tried {
                    score,
                    signs,
                    order: order.to_vec(),
                });
            }
        }
    }
    // Only the best are worth all of their nodes.
    out.sort_by(|a, b| a.score.total_cmp(&b.score));
    out.truncate(3 * super::KEPT);
    out.into_iter()
        .map(|tried| {
            Ok(Candidate {
                name: tried.name(),
                images: search.images(&tried.signs, &tried.order, a.spread.len())?,
                score: tried.score,
            })
        })
        .collect()
}

/// A map by modes.
/// Kept without its images, which are made again for the few that go on.
struct Tried {
    score: f64,
    signs: Vec<f64>,
    order: Vec<usize>,
}

impl Tried {
    /// As in "3 modes +−+, 2 and 3 swapped": for reports.
    fn name(&self) -> String {
        let sign = |s: &f64| if *s > 0.0 { '+' } else { '−' };
        let signs: String = self.signs.iter().map(sign).collect();
        let swap = match self.order.iter().enumerate().find(|&(i, &o)| i != o) {
            Some((i, _)) => format!(", {} and {} swapped", i + 1, i + 2),
            None => String::new(),
        };
        format!("{} modes {signs}{swap}", self.signs.len())
    }
}

/// What does not change while signs are tried.
struct Search<'a> {
    a: &'a Boundary<'a>,
    b: &'a Boundary<'a>,
    judge: &'a Judge,
    run: On<'a>,
    all: Vec<u32>,
}

impl Search<'_> {
    /// The signs that are worth trying: all of a few modes; the best of those go on to more, whose signs are chosen one
    /// after the other.
    fn signs(&self, order: &[usize]) -> Result<Vec<Vec<f64>>, Error> {
        let few = order.len().min(ALL_SIGNS);
        let sign = |bits: u32, i: usize| if bits >> i & 1 == 0 { 1.0 } else { -1.0 };
        let all = (0..1u32 << few).map(|bits| (0..few).map(|i| sign(bits, i)).collect());
        let all: Vec<Vec<f64>> = all.collect();
        if order.len() == few {
            return Ok(all);
        }
        let score = |signs: &[f64]| {
            let images = self.images(signs, order, self.judge.nodes())?;
            self.judge.score(&images, self.run)
        };
        let mut ranked = Vec::new();
        for signs in all {
            ranked.push((score(&signs)?, signs));
        }
        ranked.sort_by(|a, b| a.0.total_cmp(&b.0));
        ranked.truncate(super::KEPT);
        let longer = |mut signs: Vec<f64>| {
            while signs.len() < order.len() {
                let with = |sign| [&signs[..], &[sign]].concat();
                let (plus, minus) = (with(1.0), with(-1.0));
                signs = if score(&minus)? < score(&plus)? {
                    minus
                } else {
                    plus
                };
            }
            Ok(signs)
        };
        ranked.into_iter().map(|(_, signs)| longer(signs)).collect()
    }

    /// Images of the first spread nodes by these modes.
    fn images(&self, signs: &[f64], order: &[usize], nodes: usize) -> Result<Vec<Point3>, Error> {
        debug_assert!(nodes >= self.judge.nodes());
        let rows =
            |modes: &[Vec<f64>], nodes: &[u32], order: &[usize], signs: &[f64]| -> Vec<f64> {
                let row = |&n: &u32| {
                    let values = order.iter().zip(signs);
                    values
                        .map(move |(&m, s)| s * modes[m][n as usize])
                        .collect::<Vec<_>>()
                };
                nodes.iter().flat_map(row).collect()
            };
        let plain: Vec<usize> = (0..signs.len()).collect();
        let ones = vec![1.0; signs.len()];
        let queries = rows(&self.a.modes, &self.a.spread[..nodes], &plain, &ones);
        let targets = rows(&self.b.modes, &self.all, &order[..signs.len()], signs);
        nearest_points(&queries, &targets, signs.len(), self.b, self.run)
    }
}

/// The order of the modes as they are, and with each pair of neighbours swapped whose eigenvalues are close.
/// Only of the second shape: swapping both would change nothing.
fn orders(values: &[f64], most: usize) -> Vec<Vec<usize>> {
    let plain: Vec<usize> = (0..most).collect();
    let mut out = vec![plain.clone()];
    for i in 1..most {
        if values[i] - values[i - 1] < SWAP * values[i] {
            let mut swapped = plain.clone();
            swapped.swap(i - 1, i);
            out.push(swapped);
        }
    }
    out
}
