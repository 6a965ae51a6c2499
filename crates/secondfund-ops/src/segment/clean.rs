//! From groups to patches: connected, not tiny, with smooth borders; and to parts, which do not blur into each other.
//!
//! Groups of points in the space of the modes know nothing of the surface: a group may have two patches on both sides of the body,
//! and islands of a few faces where two groups are equally near. What people call a segment is connected, not tiny, and has a short
//! border where no crease gives it another.

use geom_core::algebra::{Cholesky, SparseMatrix};
use geom_core::compute::sets::DisjointSets;

use super::consensus::first_largest;
use super::embed::Rows;
use super::faces::Faces;
use crate::Error;

/// Patches smaller than this share of the area join a neighbour.
const TINY: f64 = 0.005;
/// Rounds of border smoothing.
const ROUNDS: usize = 3;
/// How far labels diffuse in a round, in sides of a mean face.
/// Larger ones make borders straighter and let narrow segments vanish.
const REACH: f64 = 4.0;
/// Curvature across an edge, in unit scale, that halves the diffusion: borders along it are wanted.
const CREASE: f64 = 4.0;

/// Splits labels into connected patches, joins tiny ones to their neighbours, smooths borders if asked,
/// and renumbers by decreasing area. `scale` is the length of the unit.
pub(crate) fn clean(
    faces: &Faces,
    labels: &[u32],
    scale: f64,
    smooth: bool,
) -> Result<Vec<u32>, Error> {
    let mut patches = join_tiny(faces, split(faces, labels));
    if smooth {
        patches = straighten(faces, &patches, scale)?;
        patches = join_tiny(faces, split(faces, &patches));
    }
    Ok(by_area(faces, &patches))
}

/// A label of its own for each connected part of a label: the lowest face of it.
fn split(faces: &Faces, labels: &[u32]) -> Vec<u32> {
    let mut sets = DisjointSets::new(faces.len());
    for f in 0..faces.len() {
        for link in faces.links(f) {
            if labels[f] == labels[link.face as usize] {
                sets.join(f as u32, link.face);
            }
        }
    }
    sets.into_roots()
}

/// Joins patches below [`TINY`], the smallest first, to the neighbour with the longest common border.
/// Labels are faces.
fn join_tiny(faces: &Faces, patches: Vec<u32>) -> Vec<u32> {
    let total: f64 = faces.areas().iter().sum();
    let mut members: Vec<Vec<u32>> = vec![Vec::new(); faces.len()];
    let mut areas = vec![0.0; faces.len()];
    for (f, &p) in patches.iter().enumerate() {
        members[p as usize].push(f as u32);
        areas[p as usize] += faces.areas()[f];
    }
    let mut patches = patches;
    let mut tiny: Vec<u32> = (0..faces.len() as u32)
        .filter(|&p| !members[p as usize].is_empty() && areas[p as usize] < TINY * total)
        .collect();
    tiny.sort_by(|&a, &b| {
        areas[a as usize]
            .total_cmp(&areas[b as usize])
            .then(a.cmp(&b))
    });
    for p in tiny {
        // It may have grown by what joined it.
        if areas[p as usize] >= TINY * total {
            continue;
        }
        let Some(into) = longest_border(faces, &members[p as usize], &patches) else {
            continue;
        };
        let moved = std::mem::take(&mut members[p as usize]);
        for &f in &moved {
            patches[f as usize] = into;
        }
        areas[into as usize] += areas[p as usize];
        members[into as usize].extend(moved);
    }
    patches
}

/// By length, not by number of edges; none for a whole component.
fn longest_border(faces: &Faces, members: &[u32], patches: &[u32]) -> Option<u32> {
    let own = patches[members[0] as usize];
    let mut lengths: Vec<(u32, f64)> = Vec::new();
    for &f in members {
        for link in faces.links(f as usize) {
            let other = patches[link.face as usize];
            if other != own {
                add(&mut lengths, other, link.length);
            }
        }
    }
    largest(&lengths)
}

/// A short list of sums by label: segments have few neighbours.
fn add(sums: &mut Vec<(u32, f64)>, label: u32, value: f64) {
    match sums.iter_mut().find(|s| s.0 == label) {
        Some(sum) => sum.1 += value,
        None => sums.push((label, value)),
    }
}

/// The label of the largest sum; of equal ones the lowest.
fn largest(sums: &[(u32, f64)]) -> Option<u32> {
    let better = |a: &(u32, f64), b: &(u32, f64)| a.1.total_cmp(&b.1).then(b.0.cmp(&a.0));
    sums.iter().copied().max_by(better).map(|s| s.0)
}

/// Threshold dynamics (Merriman, Bence and Osher, 1992): the indicators of the labels diffuse, slowly across
/// creases, and each face takes the label of the largest. Borders become shorter until creases hold them; nothing
/// moves in a flat neighbourhood of straight borders.
/// One factor serves all rounds and labels. `M + t L` is one implicit step of diffusion over the time t.
fn straighten(faces: &Faces, labels: &[u32], scale: f64) -> Result<Vec<u32>, Error> {
    let mut names = labels.to_vec();
    names.sort_unstable();
    names.dedup();
    if names.len() < 2 {
        return Ok(labels.to_vec());
    }
    let (factor, masses) = diffusion(faces, scale)?;
    let mut at: Vec<usize> = labels
        .iter()
        .map(|l| names.partition_point(|n| n < l))
        .collect();
    let width = names.len();
    for _ in 0..ROUNDS {
        let mut block = vec![0.0; at.len() * width];
        for (f, &l) in at.iter().enumerate() {
            block[f * width + l] = masses[f];
        }
        factor.solve_in_place(&mut block, width)?;
        at = block.chunks(width).map(first_largest).collect();
    }
    Ok(at.into_iter().map(|l| names[l]).collect())
}

/// The factor of `M + t L` over the faces, and M. The weight of an edge is its length over the distance of the
/// centroids, less where the faces turn.
fn diffusion(faces: &Faces, scale: f64) -> Result<(Cholesky<f64>, Vec<f64>), Error> {
    let mean = faces.areas().iter().sum::<f64>() / faces.len().max(1) as f64;
    let time = REACH * REACH * mean;
    // A face without area follows its neighbours.
    let masses: Vec<f64> = faces.areas().iter().map(|a| a + 1e-9 * mean).collect();
    let mut entries = Vec::with_capacity(4 * faces.len());
    for (f, &mass) in masses.iter().enumerate() {
        let mut diagonal = mass;
        for link in faces.links(f) {
            let crease = link.turn * scale / CREASE;
            let apart = link.apart.max(1e-3 * link.length);
            let weight =
                time * link.length / apart.max(f64::MIN_POSITIVE) / (1.0 + crease * crease);
            diagonal += weight;
            entries.push((f as u32, link.face, -weight));
        }
        entries.push((f as u32, f as u32, diagonal));
    }
    let matrix = SparseMatrix::from_triplets(masses.len(), masses.len(), &entries)?;
    Ok((Cholesky::of(&matrix)?, masses))
}

/// Joins neighbours that the rows do not tell apart, those that blur the most first, as long as more parts than `least` are
/// left, and renumbers by decreasing area; nothing is joined where one part would be left. Each of `all_rows` has a say.
///
/// Groups around medoids have much the same area each, so that a large part falls into several. Pieces of one part blur
/// into each other: their spreads together are more than the distance of their middles, a ratio of Davies and Bouldin above
/// 1, here in the mean over the rows. All pairs are judged as they are at first: what is joined spreads farther, and would
/// take in the rest.
pub(super) fn join_blurred(
    faces: &Faces,
    all_rows: &[Rows],
    labels: &[u32],
    least: usize,
) -> Vec<u32> {
    let places: Vec<Vec<Place>> = all_rows
        .iter()
        .map(|rows| Place::of_parts(faces, rows, labels))
        .collect();
    let ratio = |(a, b): (u32, u32)| {
        let ratios = places
            .iter()
            .map(|place| place[a as usize].over_distance(&place[b as usize]));
        ratios.sum::<f64>() / places.len() as f64
    };
    let count = labels.iter().max().map_or(0, |&l| l as usize + 1);
    let neighbours = (0..faces.len()).flat_map(|f| {
        let links = faces.links(f).iter();
        links.map(move |link| (labels[f], labels[link.face as usize]))
    });
    let mut neighbours: Vec<(u32, u32)> = neighbours.filter(|(a, b)| a < b).collect();
    neighbours.sort_unstable();
    neighbours.dedup();
    let judged = neighbours.into_iter().map(|pair| (ratio(pair), pair));
    let mut blurred: Vec<_> = judged.filter(|(ratio, _)| *ratio > 1.0).collect();
    blurred.sort_by(|x, y| y.0.total_cmp(&x.0).then(x.1.cmp(&y.1)));
    let (mut sets, mut left) = (DisjointSets::new(count), count);
    for (_, (a, b)) in blurred {
        if left > least && sets.find(a) != sets.find(b) {
            sets.join(a, b);
            left -= 1;
        }
    }
    if left == 1 {
        return by_area(faces, labels);
    }
    let roots = sets.into_roots();
    let joined: Vec<u32> = labels.iter().map(|&l| roots[l as usize]).collect();
    by_area(faces, &joined)
}

/// Where the rows of a part lie.
#[derive(Clone)]
struct Place {
    area: f64,
    middle: Vec<f64>,
    /// The mean distance from the middle, by area.
    spread: f64,
}

impl Place {
    /// Those of all parts, by label. A face without area counts next to nothing.
    fn of_parts(faces: &Faces, rows: &Rows, labels: &[u32]) -> Vec<Self> {
        let count = labels.iter().max().map_or(0, |&l| l as usize + 1);
        let none = Self {
            area: f64::MIN_POSITIVE,
            middle: vec![0.0; rows.width],
            spread: 0.0,
        };
        let mut parts = vec![none; count];
        let mut row = Vec::new();
        for (f, (&l, &area)) in labels.iter().zip(faces.areas()).enumerate() {
            rows.mean(faces.corners(f), &mut row);
            let part = &mut parts[l as usize];
            part.area += area;
            let slots = part.middle.iter_mut().zip(&row);
            slots.for_each(|(m, &x)| *m += area * f64::from(x));
        }
        for part in &mut parts {
            part.middle.iter_mut().for_each(|m| *m /= part.area);
        }
        for (f, (&l, &area)) in labels.iter().zip(faces.areas()).enumerate() {
            rows.mean(faces.corners(f), &mut row);
            let part = &mut parts[l as usize];
            let off = part.middle.iter().zip(&row);
            let squares = off.map(|(m, &x)| (f64::from(x) - m).powi(2));
            part.spread += area * squares.sum::<f64>().sqrt() / part.area;
        }
        parts
    }

    /// The ratio of Davies and Bouldin of the two.
    fn over_distance(&self, other: &Self) -> f64 {
        let middles = self.middle.iter().zip(&other.middle);
        let squares = middles.map(|(a, b)| (a - b).powi(2));
        (self.spread + other.spread) / squares.sum::<f64>().sqrt().max(f64::MIN_POSITIVE)
    }
}

/// Labels 0, 1, … by decreasing area.
fn by_area(faces: &Faces, patches: &[u32]) -> Vec<u32> {
    let mut areas = vec![0.0; faces.len()];
    for (f, &p) in patches.iter().enumerate() {
        areas[p as usize] += faces.areas()[f];
    }
    let mut used: Vec<u32> = patches.to_vec();
    used.sort_unstable();
    used.dedup();
    used.sort_by(|&a, &b| {
        areas[b as usize]
            .total_cmp(&areas[a as usize])
            .then(a.cmp(&b))
    });
    let mut number = vec![0; faces.len()];
    for (new, &old) in used.iter().enumerate() {
        number[old as usize] = new as u32;
    }
    patches.iter().map(|&p| number[p as usize]).collect()
}

/// What holds here, for the tests.
#[cfg(feature = "testing")]
pub(crate) mod laws {
    use super::*;
    use geom_core::compute::random::SplitMix64;
    use geom_core::{Point3, TriMesh};

    /// Four squares in a row: the first two are places of much the same rows, the last has the rows of the first. The
    /// first two are one part, the last is none of theirs.
    pub fn neighbours_that_blur_are_joined() {
        let (long, wide) = (24u32, 6u32);
        let at = |i: u32, j: u32| j * (long + 1) + i;
        let positions = (0..=wide)
            .flat_map(|j| (0..=long).map(move |i| Point3::new(f64::from(i), f64::from(j), 0.0)));
        let triangles = (0..wide * long).flat_map(|q| {
            let (i, j) = (q % long, q / long);
            let [a, b] = [at(i, j), at(i + 1, j)];
            let [c, d] = [at(i + 1, j + 1), at(i, j + 1)];
            [[a, b, c], [a, c, d]]
        });
        let mesh = TriMesh::new(positions.collect(), triangles.collect()).unwrap();
        let faces = Faces::from(&mesh);
        let square = |f: usize| f as u32 / 2 % long / 6;
        let labels: Vec<u32> = (0..faces.len()).map(square).collect();
        let parts = |middles: [f32; 4], least: usize| {
            let mut random = SplitMix64::new(3);
            let vertices = mesh.positions().len();
            let row = |v: usize| {
                let column = (v as u32 % (long + 1)).min(long - 1);
                let noise: Vec<f32> = (0..7).map(|_| random.unit() as f32).collect();
                [vec![middles[column as usize / 6]], noise].concat()
            };
            let rows = Rows {
                width: 8,
                values: (0..vertices).flat_map(row).collect(),
            };
            let joined = join_blurred(&faces, &[rows], &labels, least);
            [0, 12, 24, 36].map(|f: usize| joined[f])
        };
        let [a, b, c, d] = parts([0.0, 0.3, 9.0, 0.0], 1);
        assert!(a == b && c != a && d != a && d != c, "{:?}", [a, b, c, d]);
        let [a, b, c, d] = parts([0.0, 5.0, 9.0, 0.0], 1);
        assert!(a != b && b != c && c != d && a != d);
        // Where nothing is apart, nothing is joined.
        let mut rest = parts([0.0; 4], 1);
        rest.sort_unstable();
        assert_eq!(rest, [0, 1, 2, 3]);
        // Of three that blur the two nearest are joined if three parts are wanted.
        let [a, b, c, d] = parts([0.6, 0.0, 0.1, 9.0], 3);
        assert!(b == c && a != b && d != a && d != b, "{:?}", [a, b, c, d]);
    }

    /// On a folded sheet a border beside the fold goes to it; on a flat one a straight border stays.
    pub fn borders_go_to_creases() {
        let (long, wide) = (24u32, 16u32);
        let at = |i: u32, j: u32| j * (long + 1) + i;
        for folded in [true, false] {
            let place = |i: u32, j: u32| {
                let x = f64::from(i) - 11.0;
                let up = if folded { x.max(0.0) } else { 0.0 };
                Point3::new(x - up, f64::from(j), up)
            };
            let positions = (0..=wide).flat_map(|j| (0..=long).map(move |i| place(i, j)));
            let quads = (0..long * wide).map(|q| (q % long, q / long));
            let triangles = quads.flat_map(|(i, j)| {
                let [a, b] = [at(i, j), at(i + 1, j)];
                let [c, d] = [at(i + 1, j + 1), at(i, j + 1)];
                [[a, b, c], [a, c, d]]
            });
            let mesh = TriMesh::new(positions.collect(), triangles.collect()).unwrap();
            let column = |face: usize| face as u32 / 2 % long;
            let labels: Vec<u32> = (0..mesh.triangles().len())
                .map(|f| u32::from(column(f) >= 12))
                .collect();
            let cleaned = clean(&Faces::from(&mesh), &labels, 24.0, true).unwrap();
            let before = cleaned.iter().filter(|&&l| l == cleaned[0]).count();
            let border = before as f64 / f64::from(2 * wide);
            let expected = if folded { 11.0 } else { 12.0 };
            assert!(
                (border - expected).abs() < 0.2,
                "{border}, folded: {folded}"
            );
        }
    }
}
