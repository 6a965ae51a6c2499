//! Points go to their place only as far as all edge tetrahedra around cut cells stay positive.
//!
//! What the octree's mesher does for every leaf is needed here near cut cells only: points of cells of one size stay within their
//! convex cells, and an edge with two of these that share a face spans a positive tetrahedron wherever they are.
//!
//! The order in which points move is part of the result: whole cells before cut ones, by the parity of their
//! coordinates, as the colours of the octree's mesher have it.

use std::ops::Range;

use geom_core::Point3;
use geom_core::compute::parallel;
use rayon::prelude::*;

use super::cut_cells::{CellState, CutCells, beyond};
use super::pattern::{FACE, LANES_OF_FACE, LANES_OF_PART, PART, is_positive};
use crate::complex::cube::{MIDDLE, part_base};
use crate::dual::room::{ROUNDS, longest};
use crate::octree::{along, local};

/// A face between a cell that is not cut and a cut one. In order: by the parity of the first, then by its vertex.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Beside {
    parity: usize,
    vertex: u32,
    /// Number of the cut cell, and which of its faces it is.
    cut: u32,
    face: u8,
}

/// A cell that is not cut beside cut ones.
struct Neighbour {
    vertex: u32,
    cell: [i32; 3],
    target: Point3,
    share: f64,
    /// Its faces with cut cells.
    beside: Range<usize>,
}

impl Neighbour {
    fn base(&self) -> Point3 {
        MIDDLE + local(self.cell).coords
    }

    /// Its point at a share of the way to its place.
    fn at(&self, t: f64) -> Point3 {
        along(self.base(), self.target, t)
    }
}

/// The parts of a cut cell on their way.
#[derive(Clone, Copy)]
struct Parts {
    points: [Point3; 12],
    shares: [f64; 12],
}

/// A number that two cut cells, or two others, with a common face share only if they are one.
fn parity(cell: [i32; 3]) -> usize {
    (0..3).map(|k| ((cell[k] & 1) << k) as usize).sum()
}

/// Lets the points of parts, and of the cells that share a face with a cut one, go from their base to their place
/// as far as all edge tetrahedra stay positive: in the order of [`crate::dual::Duals`], whose bits these are.
/// `points` are those of the cells that are not cut. Returns how many points are clamped.
pub(super) fn clamp(cut: &mut CutCells<'_>, points: &mut [Point3]) -> usize {
    let beside = faces_beside(cut);
    let mut neighbours = neighbours(cut, &beside, points);
    for n in &neighbours {
        points[n.vertex as usize] = n.at(0.0);
    }
    let mut of_parity: [Vec<u32>; 8] = Default::default();
    for (k, cell) in cut.cells.iter().enumerate() {
        of_parity[parity(cell.origin)].push(k as u32);
    }
    for _ in 0..ROUNDS {
        // No two of a parity share a tetrahedron: each group moves at once, whole cells before cut ones.
        for group in neighbours.chunk_by_mut(|n, m| parity(n.cell) == parity(m.cell)) {
            parallel::for_each(group, |_, n| {
                if n.share < 1.0 {
                    n.share = neighbour_share(cut, n, &beside[n.beside.clone()]);
                }
            });
            for n in group {
                points[n.vertex as usize] = n.at(n.share);
            }
        }
        for group in &of_parity {
            let moved: Vec<_> = parallel::flat_map(group.len(), |i| {
                let k = group[i];
                let short = cut.cells[k as usize].shares.iter().any(|&s| s < 1.0);
                short.then(|| (k, moved(cut, k as usize, points)))
            });
            for (k, parts) in moved {
                cut.parts[k as usize] = parts.points;
                cut.cells[k as usize].shares = parts.shares;
            }
        }
    }
    let short = |shares: &[f64]| shares.iter().filter(|&&s| s < 1.0).count();
    let parts: usize = cut.cells.iter().map(|c| short(&c.shares)).sum();
    let whole = neighbours.iter().filter(|n| n.share < 1.0);
    parts + whole.count()
}

/// The faces between whole and cut cells, in order.
fn faces_beside(cut: &CutCells<'_>) -> Vec<Beside> {
    let mut beside: Vec<Beside> = parallel::flat_map(cut.cells.len(), |k| {
        let cell = &cut.cells[k];
        (0..6).filter_map(move |face| match cell.sides[face] {
            CellState::Whole(vertex) => Some(Beside {
                parity: parity(beyond(cell.origin, face)),
                vertex,
                cut: k as u32,
                face: face as u8,
            }),
            _ => None,
        })
    });
    beside.par_sort_unstable();
    beside
}

/// The whole cells beside cut ones, by parity as their faces are.
fn neighbours(cut: &CutCells<'_>, beside: &[Beside], points: &[Point3]) -> Vec<Neighbour> {
    let is_first = |i: &usize| *i == 0 || beside[i - 1].vertex != beside[*i].vertex;
    let starts: Vec<usize> = parallel::flat_map(beside.len(), |i| Some(i).filter(is_first));
    parallel::map(starts.len(), |i| {
        let end = starts.get(i + 1).map_or(beside.len(), |&end| end);
        let first = beside[starts[i]];
        let origin = cut.cells[first.cut as usize].origin;
        Neighbour {
            vertex: first.vertex,
            cell: beyond(origin, usize::from(first.face)),
            target: points[first.vertex as usize],
            share: 0.0,
            beside: starts[i]..end,
        }
    })
}

/// How far a cell that is not cut may go beside the cut ones.
/// Six edge tetrahedra per face between them: three edges of the triangles of each half.
fn neighbour_share(cut: &CutCells<'_>, n: &Neighbour, beside: &[Beside]) -> f64 {
    let margins = |b: &Beside, y: &Point3| {
        let cell = &cut.cells[b.cut as usize];
        let tets = &cell.pattern().faces[usize::from(b.face)];
        let mut x = [[0.0; LANES_OF_FACE]; 3];
        for (half, of_half) in [0..FACE / 2, FACE / 2..FACE].into_iter().enumerate() {
            let part = &cut.parts[b.cut as usize][2 * usize::from(b.face) + half];
            (0..3).for_each(|c| x[c][of_half.clone()].fill(part[c]));
        }
        let y = [y.x, y.y, y.z].map(|c| [c; LANES_OF_FACE]);
        tets.margins(cell.origin, &x, &y, &tets.least[0])
    };
    if beside.iter().all(|b| is_positive(&margins(b, &n.target))) {
        return 1.0;
    }
    let base = n.base();
    let margins = beside.iter().flat_map(|b| {
        let (first, last) = (margins(b, &base), margins(b, &n.target));
        (0..FACE).map(move |i| [first[i], last[i]])
    });
    longest(n.share, margins)
}

/// The parts of a cell after each has gone as far as it may, one after the other.
/// A part has twelve edge tetrahedra: three with what lies beyond its outer triangle, and three with each of its mates.
fn moved(cut: &CutCells<'_>, k: usize, points: &[Point3]) -> Parts {
    let cell = &cut.cells[k];
    let pattern = cell.pattern();
    let mut out = Parts {
        points: cut.parts[k],
        shares: cell.shares,
    };
    for part in 0..12 {
        let base = part_base(cell.split.diagonals, cell.origin, part);
        let target = cell.targets[part];
        if out.shares[part] >= 1.0 || target == base {
            out.shares[part] = 1.0;
            continue;
        }
        let face = part / 2;
        let outer = match cell.sides[face] {
            CellState::Beyond => None,
            CellState::Plain => Some((MIDDLE + local(beyond(cell.origin, face)).coords, 0)),
            CellState::Whole(v) => Some((points[v as usize], 0)),
            // The two halves of a face have the same numbers on both sides.
            CellState::Cut(j) => Some((cut.parts[j as usize][part ^ 2], 1)),
        };
        let mates = pattern.mates[part].map(|mate| out.points[usize::from(mate)]);
        let tets = &pattern.parts[part];
        let mut least = tets.least[outer.map_or(0, |(_, kind)| kind)];
        if outer.is_none() {
            // Nothing beyond: the three tetrahedra of the outer triangle are none.
            least[..3].fill(f64::NEG_INFINITY);
        }
        let outer = outer.map_or(base, |(x, _)| x);
        let mut y = [[0.0; LANES_OF_PART]; 3];
        for (beyond, x) in [outer, mates[0], mates[1], mates[2]].iter().enumerate() {
            (0..3).for_each(|c| y[c][3 * beyond..3 * beyond + 3].fill(x[c]));
        }
        let margins = |x: &Point3| {
            let x = [x.x, x.y, x.z].map(|c| [c; LANES_OF_PART]);
            tets.margins(cell.origin, &x, &y, &least)
        };
        let last = margins(&target);
        out.shares[part] = if is_positive(&last) {
            1.0
        } else {
            let first = margins(&base);
            longest(out.shares[part], (0..PART).map(|i| [first[i], last[i]]))
        };
        out.points[part] = along(base, target, out.shares[part]);
    }
    out
}
