//! The lattice points inside a closed triangle mesh.
//!
//! Parity along lines needs neither normals nor an orientation of the mesh, and sees several bodies and cavities at
//! once. Every row of lattice points is by itself; a row that crosses the mesh an odd number of times proves a hole.

use geom_core::compute::parallel;
use geom_core::{Aabb, Lattice, Point3, TriMesh};

use crate::Error;

/// Bytes per row of lattice points: its count, its first triangle, its next one.
const BYTES_PER_ROW: u128 = 20;

/// The lattice around a mesh with a margin of two spacings, and which of its points lie inside: those from which a
/// line along the first axis leaves the mesh an odd number of times. Lines are moved off the lattice by a millionth of
/// a spacing, so that they pass no vertex or edge of a mesh that was made on a lattice.
///
/// # Errors
/// [`Error::Spacing`], [`Error::Empty`] for a mesh without vertices, [`Error::TooLarge`] before anything large is
/// allocated, [`Error::Open`] with the first row that proves it.
pub(super) fn inside(
    mesh: &TriMesh,
    spacing: f64,
    limit: u64,
) -> Result<(Lattice, Vec<bool>), Error> {
    if !(spacing > 0.0 && spacing.is_finite()) {
        return Err(Error::Spacing { spacing });
    }
    let bounds = Aabb::of_points(mesh.positions());
    if bounds.is_empty() {
        return Err(Error::Empty { largest: 0.0 });
    }
    let lattice = Lattice::covering(&bounds.inflated(2.0 * spacing), spacing);
    super::check_memory(&lattice, super::BYTES_PER_POINT, limit)?;
    let [nx, ny, nz] = lattice.counts;
    let shift = [1.3e-6 * spacing, 0.7e-6 * spacing];

    // Which triangles each row of lattice points may cross: counted first, so that no more is held than allowed.
    let rows_of = |t: usize| {
        let corners = mesh.corners(t);
        let span = |axis: usize, count: usize| {
            let values = corners.map(|c| (c[axis] - lattice.origin[axis]) / spacing);
            let low = values.iter().copied().fold(f64::INFINITY, f64::min);
            let high = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
            let last = high.ceil().min((count - 1) as f64);
            low.floor().max(0.0) as usize..=last.max(0.0) as usize
        };
        let (js, ks) = (span(1, ny), span(2, nz));
        ks.flat_map(move |k| js.clone().map(move |j| j + ny * k))
    };
    let triangles = mesh.triangles().len();
    let mut counts = vec![0u32; ny * nz];
    (0..triangles)
        .flat_map(rows_of)
        .for_each(|row| counts[row] += 1);
    let entries: u128 = counts.iter().map(|&c| u128::from(c)).sum();
    let table = 4 * entries + BYTES_PER_ROW * counts.len() as u128;
    let points = lattice.points();
    super::refuse_above(limit, points, super::BYTES_PER_POINT * points + table)?;
    let starts = parallel::starts_of(&counts);
    let mut next = starts.clone();
    let mut crossed = vec![0u32; starts[counts.len()]];
    for t in 0..triangles {
        for row in rows_of(t) {
            crossed[next[row]] = t as u32;
            next[row] += 1;
        }
    }
    drop((counts, next));
    let mut inside = vec![false; lattice.len()];
    let mut rows: Vec<_> = inside.chunks_mut(nx).map(|flags| (flags, Ok(()))).collect();
    parallel::for_each(&mut rows, |row, (flags, found)| {
        let [j, k] = [row % ny, row / ny];
        let start = lattice.point([0, j, k]);
        let at = [start.y + shift[0], start.z + shift[1]];
        let mut crossings: Vec<f64> = crossed[starts[row]..starts[row + 1]]
            .iter()
            .filter_map(|&t| crossing(mesh.corners(t as usize), at))
            .collect();
        crossings.sort_unstable_by(f64::total_cmp);
        if crossings.len() % 2 == 1 {
            let crossings = crossings.len();
            *found = Err(Error::Open { j, k, crossings });
            return;
        }
        for pair in crossings.chunks_exact(2) {
            let local = |x: f64| (x - start.x) / spacing;
            let first = local(pair[0]).ceil().max(0.0) as usize;
            let last = (local(pair[1]).ceil().max(0.0) as usize).min(nx);
            flags[first.min(last)..last].fill(true);
        }
    });
    // The first in order, whichever was found first.
    rows.into_iter().try_for_each(|(_, found)| found)?;
    Ok((lattice, inside))
}

/// Where the line along x through `[y, z]` crosses a triangle.
/// `None` beside it, and for one that stands along the line.
fn crossing(corners: [Point3; 3], [y, z]: [f64; 2]) -> Option<f64> {
    // Of both triangles at an edge exactly one has the line: the sign of an edge does not depend on its direction.
    let side = |a: &Point3, b: &Point3| {
        let turned = (a.y, a.z) > (b.y, b.z);
        let (p, q) = if turned { (b, a) } else { (a, b) };
        let area = (q.y - p.y) * (z - p.z) - (q.z - p.z) * (y - p.y);
        if turned { -area } else { area }
    };
    let [a, b, c] = &corners;
    let areas = [side(b, c), side(c, a), side(a, b)];
    // A line through an edge belongs to the triangle that has the edge in order.
    let ordered = |a: &Point3, b: &Point3| (a.y, a.z) <= (b.y, b.z);
    let edges = [(b, c), (c, a), (a, b)];
    let positive =
        [0, 1, 2].map(|k| areas[k] > 0.0 || (areas[k] == 0.0 && ordered(edges[k].0, edges[k].1)));
    if positive[0] != positive[1] || positive[1] != positive[2] {
        return None;
    }
    let total: f64 = areas.iter().sum();
    let x: f64 = areas
        .iter()
        .zip(&corners)
        .map(|(s, p)| s / total * p.x)
        .sum();
    x.is_finite().then_some(x)
}
