//! Where patches meet: every side of a patch as the segments between corners of patches that lie on it.
//!
//! Elements of different levels, and patches of one element, share parts of sides only. A segment is the largest piece
//! that no corner of a patch lies in: it belongs to one side of one patch, or to one of each of two. Who evaluates a
//! curve on one of them and uses it for both has no gaps, whatever rounding does: so tessellation and STEP files go
//! through segments. All of it is found by the numbers of fine vertices; positions are never compared.

use geom_core::Point3;

use super::Surface;
use crate::mesh::NONE;

/// A piece of a side between neighbouring corners of patches: one curve, seen by one patch or two.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Segment {
    /// Corners of patches at its ends: numbers of [`Seams::corners`].
    pub ends: [u32; 2],
    /// The patch that evaluates it.
    pub owner: Side,
    /// The one on the other side, none on a boundary.
    pub other: Option<Side>,
}

/// A part of a side of a patch.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Side {
    /// The patch.
    pub patch: u32,
    /// Its side: 0 along `s`, 1 along `t`, 2 back along `s`, 3 back along `t`.
    pub side: u8,
    /// Where on the side the segment begins and ends, as shares of it; the second patch sees it backwards.
    pub range: [f64; 2],
}

impl Side {
    /// The parameters of the patch at a share of the segment, counted from its first end.
    pub fn at(&self, share: f64) -> [f64; 2] {
        let [a, b] = self.range;
        // Ends exactly, so that corners are met.
        let u = if share == 1.0 { b } else { a + (b - a) * share };
        match self.side {
            0 => [u, 0.0],
            1 => [1.0, u],
            2 => [1.0 - u, 1.0],
            _ => [0.0, 1.0 - u],
        }
    }
}

/// How the patches of a surface meet.
#[derive(Clone, Debug, PartialEq)]
pub struct Seams {
    /// Fine vertices at the corners of patches, ascending.
    pub corners: Vec<u32>,
    /// The segments.
    pub segments: Vec<Segment>,
    /// The corners of each patch, counter-clockwise.
    pub of_patch: Vec<[u32; 4]>,
    /// Segments of all sides, side after side, and whether they run with the side; where those of side k of patch p
    /// begin, at `4 p + k`.
    sides: Vec<(u32, bool)>,
    starts: Vec<u32>,
}

impl Seams {
    /// The segments along side `side` of a patch in order, and whether each runs with it.
    pub fn side(&self, patch: usize, side: usize) -> &[(u32, bool)] {
        let at = 4 * patch + side;
        &self.sides[self.starts[at] as usize..self.starts[at + 1] as usize]
    }

    /// Of a surface.
    ///
    /// In the time that sorting the segments takes.
    pub fn of(surface: &Surface) -> Self {
        let paths = paths(surface);
        let mut is_corner = vec![false; surface.mesh().fine().positions().len()];
        for path in &paths {
            is_corner[path[0] as usize] = true;
        }
        let corners: Vec<u32> = (0..is_corner.len() as u32)
            .filter(|&v| is_corner[v as usize])
            .collect();
        let number = |v: u32| corners.partition_point(|&c| c < v) as u32;
        // A segment is known by its first step: two of them may have the same ends.
        let mut known: Vec<([u32; 2], u32)> = Vec::new();
        let mut pieces = Vec::new();
        let mut starts = vec![0];
        for (at, path) in paths.iter().enumerate() {
            let length = (path.len() - 1) as f64;
            let mut begin = 0;
            for end in 1..path.len() {
                if !is_corner[path[end] as usize] {
                    continue;
                }
                let (first, last) = ([path[begin], path[begin + 1]], [path[end], path[end - 1]]);
                let side = Side {
                    patch: (at / 4) as u32,
                    side: (at % 4) as u8,
                    range: [begin as f64 / length, end as f64 / length],
                };
                known.push((first.min(last), pieces.len() as u32));
                pieces.push((side, [number(first[0]), number(last[0])]));
                begin = end;
            }
            starts.push(pieces.len() as u32);
        }
        known.sort_unstable();
        let mut segments = Vec::new();
        let mut sides = vec![(NONE, true); pieces.len()];
        // In the order of the pieces that see them first.
        let mut groups: Vec<&[([u32; 2], u32)]> = known.chunk_by(|a, b| a.0 == b.0).collect();
        groups.sort_unstable_by_key(|g| g[0].1);
        for group in groups {
            let (side, ends) = pieces[group[0].1 as usize];
            sides[group[0].1 as usize] = (segments.len() as u32, true);
            let second = group.get(1).map(|&(_, piece)| {
                sides[piece as usize] = (segments.len() as u32, false);
                let [a, b] = pieces[piece as usize].0.range;
                Side {
                    range: [b, a],
                    ..pieces[piece as usize].0
                }
            });
            segments.push(Segment {
                ends,
                owner: side,
                other: second,
            });
        }
        let of_patch = paths
            .chunks_exact(4)
            .map(|four| [0, 1, 2, 3].map(|k| number(four[k][0])))
            .collect();
        Self {
            corners,
            segments,
            of_patch,
            sides,
            starts,
        }
    }

    /// Where the surface is at each corner, as the first of its patches says; the others differ by rounding.
    pub fn positions(&self, surface: &Surface) -> Vec<Point3> {
        let mut at = vec![None; self.corners.len()];
        for (points, corners) in surface.patches().iter().zip(&self.of_patch) {
            for (&corner, b) in corners.iter().zip([0, 3, 15, 12]) {
                let [x, y, z, w] = points[b];
                at[corner as usize].get_or_insert(Point3::new(x / w, y / w, z / w));
            }
        }
        at.into_iter().map(Option::unwrap_or_default).collect()
    }
}

/// The fine vertices along the four sides of every patch.
fn paths(surface: &Surface) -> Vec<Vec<u32>> {
    let mesh = surface.mesh();
    let mut paths = Vec::with_capacity(4 * surface.patches().len());
    for (e, element) in mesh.elements().iter().enumerate() {
        let grid = mesh.fine_vertices(e);
        let width = element.size + 1;
        for patch in &surface.extraction().patches()[surface.extraction().of_element(e)] {
            let at = |i: u32, j: u32| grid[(i + j * width) as usize];
            let ([i0, j0], [i1, j1]) = (patch.from, patch.to);
            paths.push((i0..=i1).map(|i| at(i, j0)).collect());
            paths.push((j0..=j1).map(|j| at(i1, j)).collect());
            paths.push((i0..=i1).rev().map(|i| at(i, j1)).collect());
            paths.push((j0..=j1).rev().map(|j| at(i0, j)).collect());
        }
    }
    paths
}
