//! From groups to patches: connected, not tiny, with smooth borders; and to parts, which do not blur into each other.
//!
//! Groups of points in the space of the modes know nothing of the surface: a group may have two patches on both sides of the body,
//! and islands of a few faces where two groups are equally near. What people call a segment is connected, not tiny, and has a short
//! border where no crease gives it another.

use std::collections::BTreeMap;
use std::f64::consts::TAU;

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

/// Joins the two neighbours that blur into each other the most, as long as there are such, and renumbers by decreasing
/// area; where one part would be left nothing is joined. Each of `all_rows` has a say.
///
/// Groups around medoids have much the same area each, so that a large part falls into several. Pieces of one part blur
/// into each other: their spreads together are more than the distance of their middles, a ratio of Davies and Bouldin above
/// 1, in the mean over the rows. A border that is short beside the smaller of the two is a neck, though, where people cut
/// (the short-cut rule: Singh, Seyranian and Hoffman, *Parsing silhouettes*, 1999), and what is beyond it may lie as near
/// as it likes: the ratio counts by [`Place::neck`]. What is joined spreads farther and is judged anew.
pub(super) fn join_blurred(faces: &Faces, all_rows: &[Rows], labels: &[u32]) -> Vec<u32> {
    let mut parts = by_area(faces, labels);
    while let Some((kept, joined)) = most_blurred(faces, all_rows, &parts) {
        if parts.iter().all(|p| [kept, joined].contains(p)) {
            return by_area(faces, labels);
        }
        for part in parts.iter_mut().filter(|p| **p == joined) {
            *part = kept;
        }
        parts = by_area(faces, &parts);
    }
    parts
}

/// The pair of neighbours whose ratio is the largest above 1; of equal ones the first.
fn most_blurred(faces: &Faces, all_rows: &[Rows], parts: &[u32]) -> Option<(u32, u32)> {
    let places: Vec<Vec<Place>> = all_rows
        .iter()
        .map(|rows| Place::of_parts(faces, rows, parts))
        .collect();
    let ratio = |&((a, b), border): &((u32, u32), f64)| {
        let of_rows = places.iter().map(|places| {
            let (a, b) = (&places[a as usize], &places[b as usize]);
            a.over_distance(b) * a.neck(b, border)
        });
        of_rows.sum::<f64>() / places.len() as f64
    };
    let mut best = (1.0, None);
    for pair in borders(faces, parts) {
        let ratio = ratio(&pair);
        if ratio > best.0 {
            best = (ratio, Some(pair.0));
        }
    }
    best.1
}

/// Pairs of neighbours, the lower number first, and the lengths of their borders.
fn borders(faces: &Faces, parts: &[u32]) -> BTreeMap<(u32, u32), f64> {
    let mut lengths = BTreeMap::new();
    for (f, &a) in parts.iter().enumerate() {
        for link in faces.links(f) {
            let b = parts[link.face as usize];
            if a < b {
                *lengths.entry((a, b)).or_insert(0.0) += link.length;
            }
        }
    }
    lengths
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

    /// The length of a common border over that of a half sphere as large as the smaller of the two, at most 1: halves of a
    /// sphere have no neck between them.
    fn neck(&self, other: &Self, border: f64) -> f64 {
        let area = self.area.min(other.area);
        (border / (TAU * area).sqrt()).min(1.0)
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
        let parts = |middles: [f32; 4]| row_of_squares(middles, 6);
        let [a, b, c, d] = parts([0.0, 0.1, 3.0, 0.0]);
        assert!(a == b && c != a && d != a && d != c, "{:?}", [a, b, c, d]);
        let [a, b, c, d] = parts([0.0, 3.0, 6.0, 0.0]);
        assert!(a != b && b != c && c != d && a != d);
        // Where nothing is apart, nothing is joined.
        let mut rest = parts([0.0; 4]);
        rest.sort_unstable();
        assert_eq!(rest, [0, 1, 2, 3]);
    }

    /// Rows that blur across the whole width of a strip do not across a neck of a sixth of it.
    pub fn necks_keep_parts_apart() {
        let middles = [0.0, 0.1, 3.0, 6.0];
        let [a, b, c, d] = row_of_squares(middles, 6);
        assert!(a == b && b != c && c != d, "{:?}", [a, b, c, d]);
        let [a, b, c, d] = row_of_squares(middles, 1);
        assert!(a != b && b != c && c != d, "{:?}", [a, b, c, d]);
    }

    /// The parts of four squares of six sides each in a row, of which neighbours share `width` sides, where the rows of each
    /// lie around a number of its own, in one of eight coordinates.
    fn row_of_squares(middles: [f32; 4], width: u32) -> [u32; 4] {
        let (long, wide) = (24u32, 6u32);
        let at = |i: u32, j: u32| j * (long + 1) + i;
        let positions = (0..=wide)
            .flat_map(|j| (0..=long).map(move |i| Point3::new(f64::from(i), f64::from(j), 0.0)));
        let mut positions: Vec<Point3> = positions.collect();
        let mut triangles = Vec::new();
        let mut square = Vec::new();
        for q in 0..wide * long {
            let (i, j) = (q % long, q / long);
            let [mut a, b] = [at(i, j), at(i + 1, j)];
            let [c, mut d] = [at(i + 1, j + 1), at(i, j + 1)];
            // Above the common sides a square has corners of its own.
            if i > 0 && i % 6 == 0 {
                for corner in [&mut a, &mut d] {
                    if *corner / (long + 1) > width {
                        positions.push(positions[*corner as usize]);
                        *corner = positions.len() as u32 - 1;
                    }
                }
            }
            triangles.extend([[a, b, c], [a, c, d]]);
            square.extend([i / 6; 2]);
        }
        let mesh = TriMesh::new(positions, triangles).unwrap();
        let faces = Faces::from(&mesh);
        let mut of_vertices = vec![0; mesh.positions().len()];
        for (triangle, &s) in mesh.triangles().iter().zip(&square) {
            triangle.iter().for_each(|&v| of_vertices[v as usize] = s);
        }
        let mut random = SplitMix64::new(3);
        let rows = of_vertices.iter().flat_map(|&s: &u32| {
            let noise: Vec<f32> = (0..7).map(|_| random.unit() as f32).collect();
            [vec![middles[s as usize]], noise].concat()
        });
        let rows = Rows {
            width: 8,
            values: rows.collect(),
        };
        let joined = join_blurred(&faces, &[rows], &square);
        [0, 12, 24, 36].map(|f: usize| joined[f])
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
