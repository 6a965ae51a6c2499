//! Grouping around medoids: FasterPAM, and the Davies–Bouldin index.
//!
//! Means of points of the space of modes are points of no surface; a medoid is a vertex, the one with the least sum of distances
//! to its group. The loss is the sum of the distances of all points to their medoids. A swap of a medoid with another point
//! changes it by terms that are known from the two nearest medoids of each point, so that all swaps of one candidate are judged in
//! one pass over the points. Every improving swap is done at once (that is what *eager* means), until none is left.

use geom_core::compute::random::SplitMix64;

/// Groups around medoids.
#[derive(Clone, Debug, PartialEq)]
pub struct Medoids {
    /// The points in the middle of the groups.
    pub medoids: Vec<u32>,
    /// The group of each point.
    pub group: Vec<u32>,
    /// Sum of the distances to the medoids.
    pub loss: f64,
    /// The loss at the start and after each swap.
    pub history: Vec<f64>,
}

/// A swap must gain more than this share of the loss: less is rounding.
const GAIN: f64 = 1e-9;

/// The nearest and the second nearest medoid of a point.
#[derive(Clone, Copy)]
struct Near {
    group: u32,
    first: f32,
    second: f32,
}

/// Partitioning around medoids by eager swaps (FasterPAM: Schubert and Rousseeuw, *Fast and eager
/// k-medoids clustering*, 2021) of `n` points whose distances stand row after row in `distances`, from
/// `groups` random points on. A local minimum of the loss: try several seeds.
///
/// # Panics
/// If there are not `n²` distances, or groups not between 1 and n.
///
/// ```
/// use secondfund_ops::segment::medoids;
/// // Five points on a line, in two groups.
/// let at = [0.0f32, 1.0, 2.0, 10.0, 11.0];
/// let distances: Vec<f32> = at.iter().flat_map(|a| at.map(|b| (a - b).abs())).collect();
/// let found = medoids(&distances, 5, 2, 0);
/// assert_eq!(found.group[0], found.group[2]);
/// assert_ne!(found.group[0], found.group[3]);
/// assert!((found.loss - 3.0).abs() < 1e-6);
/// ```
pub fn medoids(distances: &[f32], n: usize, groups: usize, seed: u64) -> Medoids {
    assert_eq!(distances.len(), n * n, "all distances");
    assert!((1..=n).contains(&groups), "groups between 1 and n");
    let mut medoids = distinct(n, groups, seed);
    let mut near = nearest(distances, n, &medoids);
    let mut loss = total(&near);
    let mut history = vec![loss];
    let mut since = 0;
    for candidate in (0..n).cycle() {
        if since == n {
            break;
        }
        since += 1;
        if medoids.contains(&(candidate as u32)) {
            continue;
        }
        let row = &distances[candidate * n..(candidate + 1) * n];
        let (out, change) = best_swap(row, &near, groups);
        if change < -GAIN * loss {
            medoids[out] = candidate as u32;
            near = nearest(distances, n, &medoids);
            loss = total(&near);
            history.push(loss);
            since = 0;
        }
    }
    Medoids {
        medoids,
        group: near.iter().map(|p| p.group).collect(),
        loss,
        history,
    }
}

/// `count` different numbers below `n` (Floyd's sampling).
fn distinct(n: usize, count: usize, seed: u64) -> Vec<u32> {
    let mut random = SplitMix64::new(seed);
    let mut chosen: Vec<u32> = Vec::with_capacity(count);
    for last in n - count..n {
        let pick = random.below(last + 1) as u32;
        chosen.push(if chosen.contains(&pick) {
            last as u32
        } else {
            pick
        });
    }
    chosen
}

fn nearest(distances: &[f32], n: usize, medoids: &[u32]) -> Vec<Near> {
    let mut near = vec![
        Near {
            group: 0,
            first: f32::INFINITY,
            second: f32::INFINITY,
        };
        n
    ];
    for (group, &m) in medoids.iter().enumerate() {
        let row = &distances[m as usize * n..(m as usize + 1) * n];
        for (p, &d) in near.iter_mut().zip(row) {
            if d < p.first {
                p.second = p.first;
                p.first = d;
                p.group = group as u32;
            } else if d < p.second {
                p.second = d;
            }
        }
    }
    // With one group there is no second: removing it costs whatever the candidate costs.
    if medoids.len() == 1 {
        near.iter_mut().for_each(|p| p.second = f32::MAX);
    }
    near
}

fn total(near: &[Near]) -> f64 {
    near.iter().map(|p| f64::from(p.first)).sum()
}

/// Which medoid to give up for the candidate with these distances, and by how much the loss changes.
fn best_swap(row: &[f32], near: &[Near], groups: usize) -> (usize, f64) {
    if groups == 1 {
        let change = row.iter().map(|&d| f64::from(d)).sum::<f64>() - total(near);
        return (0, change);
    }
    // What giving a medoid up costs if the candidate takes nothing …
    let mut change = vec![0.0f64; groups];
    let mut gained = 0.0;
    for (p, &d) in near.iter().zip(row) {
        // One by one: `map` of an array is a call here, and three times as long as the rest, unless all of it is inlined.
        let (d, first, second) = (f64::from(d), f64::from(p.first), f64::from(p.second));
        // … and what the candidate takes: points nearer to it than to their medoid whoever goes, and
        // points nearer to it than to their second if their first goes.
        change[p.group as usize] += if d < first {
            gained += d - first;
            0.0
        } else {
            d.min(second) - first
        };
    }
    let best = (0..groups)
        .reduce(|a, b| if change[b] < change[a] { b } else { a })
        .expect("at least one group");
    (best, change[best] + gained)
}

/// The mean medoid silhouette `1 − d₁/d₂` with the distances to the nearest and the second nearest medoid: 1 for
/// compact groups far apart, 0 where every point lies between two (Lenssen and Schubert, 2022). Points on both
/// medoids count 0; 0 for a single group.
pub(crate) fn medoid_silhouette(distances: &[f32], n: usize, medoids: &[u32]) -> f64 {
    if medoids.len() < 2 || n == 0 {
        return 0.0;
    }
    let near = nearest(distances, n, medoids);
    let one = |p: &Near| {
        if p.second > 0.0 {
            1.0 - f64::from(p.first) / f64::from(p.second)
        } else {
            0.0
        }
    };
    near.iter().map(one).sum::<f64>() / n as f64
}

/// The index of Davies and Bouldin (1979): the mean over the groups of the worst `(sᵢ + sⱼ) / |cᵢ − cⱼ|`
/// with the centroids c and the mean distances s from them. Small for compact groups far apart; empty
/// groups are left out; infinite where two centroids coincide.
///
/// 0 for a single group. `rows` holds `width` numbers per point, `group` the group of each.
///
/// ```
/// let index = secondfund_ops::segment::davies_bouldin(&[0.0, 2.0, 10.0, 12.0], 1, &[0, 0, 1, 1]);
/// assert!((index - 0.2).abs() < 1e-6);
/// ```
pub fn davies_bouldin(rows: &[f32], width: usize, group: &[u32]) -> f64 {
    let groups = group.iter().max().map_or(0, |&g| g as usize + 1);
    let mut counts = vec![0usize; groups];
    let mut centers = vec![0.0f64; groups * width];
    let row = |i: usize| &rows[i * width..(i + 1) * width];
    for (i, &g) in group.iter().enumerate() {
        counts[g as usize] += 1;
        for (c, &x) in centers[g as usize * width..].iter_mut().zip(row(i)) {
            *c += f64::from(x);
        }
    }
    for (c, &count) in centers.chunks_mut(width.max(1)).zip(&counts) {
        c.iter_mut().for_each(|x| *x /= count.max(1) as f64);
    }
    let center = |g: usize| &centers[g * width..(g + 1) * width];
    let mut spread = vec![0.0; groups];
    for (i, &g) in group.iter().enumerate() {
        let squares = center(g as usize)
            .iter()
            .zip(row(i))
            .map(|(c, &x)| (c - f64::from(x)).powi(2));
        spread[g as usize] += squares.sum::<f64>().sqrt() / counts[g as usize] as f64;
    }
    let used: Vec<usize> = (0..groups).filter(|&g| counts[g] > 0).collect();
    let ratio = |a: usize, b: usize| {
        let squares = center(a)
            .iter()
            .zip(center(b))
            .map(|(x, y)| (x - y).powi(2));
        let apart = squares.sum::<f64>().sqrt();
        if apart > 0.0 {
            (spread[a] + spread[b]) / apart
        } else {
            f64::INFINITY
        }
    };
    let worst = |&a: &usize| {
        let others = used.iter().filter(|&&b| b != a);
        others.map(|&b| ratio(a, b)).fold(0.0, f64::max)
    };
    used.iter().map(worst).sum::<f64>() / used.len().max(1) as f64
}
