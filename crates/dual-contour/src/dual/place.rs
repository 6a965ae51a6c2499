//! Where the point of a cell belongs.
//!
//! The mean of the points where edges of the cell cross the surface is always inside the cell and near the surface, but not
//! on it: on a sphere of radius r it lies about h²/8r too far inside. Newton steps `x ← x − (G(x) − c) ∇G / |∇G|²` bring it onto the
//! level set, of the field if one is given and of the trilinear interpolant of the cell's corners otherwise. A step that
//! leaves the cell is cut off at its walls, so that neighbours keep their order.

use geom_core::compute::BackendError;
use geom_core::compute::parallel;
use geom_core::field::in_batches;
use geom_core::mesh::INTERIOR;
use geom_core::{FieldAtMany, Point3, Vector3};

use super::probe::{Probe, Room, Sample, Start, mean_of_crossings, sample_corner};
use crate::backend::ContourBackend;
use crate::complex::{Cell, Complex, Corner, Frame, frame_of_corners};
use crate::kernel::INSET;
use crate::octree::{Samples, corner_of, exact};
use crate::{Error, Placement};

/// Newton steps of the kernel: more change nothing that a picture could show.
/// On the trilinear interpolant; a field is followed until the point is near enough.
const STEPS: u32 = 4;

/// The dual vertices of leaves: finest ones in a density grid by the backend's kernel.
/// One per leaf, in order. The kernel sees signs only, so cells of more than two labels, and those without the
/// molecule, are placed here, from their labels.
///
/// # Errors
/// What the backend or a field on a device says, and an answer of another length.
pub(super) fn leaf_points(
    complex: &Complex<'_>,
    probe: &Probe<'_>,
    leaves: &[u32],
    backend: &dyn ContourBackend,
) -> Result<Vec<Point3>, Error> {
    let samples = complex.samples;
    let kernel = probe.field.is_none() && probe.placement == Placement::Newton;
    // Where the molecule meets one other region, labels are signs.
    let by_kernel = |id: u32| {
        kernel && complex.leaf(id).log == 0 && {
            let labels = complex.corner_labels(complex.leaf(id));
            let other = labels.iter().find(|&&l| l != INTERIOR);
            labels.contains(&INTERIOR) && labels.iter().all(|l| *l == INTERIOR || Some(l) == other)
        }
    };
    let judged = parallel::map_each(leaves, |&id| by_kernel(id));
    let (mut fine, mut rest) = (Vec::new(), Vec::new());
    for (&id, is_fine) in leaves.iter().zip(judged) {
        if is_fine { &mut fine } else { &mut rest }.push(id);
    }
    let cells: Vec<[f32; 8]> = parallel::map_each(&fine, |&id| {
        samples.corners_over_level(complex.leaf(id).origin())
    });
    let fine_points = dual_vertices(backend, &cells)?;
    let rest_points = rest_points(complex, probe, &rest)?;
    // Both lists are in order: merge them.
    let mut fine = fine.iter().zip(fine_points).peekable();
    let mut rest = rest_points.into_iter();
    let next = |id: &u32| match fine.next_if(|(other, _)| *other == id) {
        Some((_, x)) => within(complex.leaf(*id).origin(), x),
        None => rest.next().expect("one point per leaf"),
    };
    Ok(leaves.iter().map(next).collect())
}

/// The dual vertices of leaves that the processor places; those of finest ones on a field that takes many points with
/// one call together.
fn rest_points(
    complex: &Complex<'_>,
    probe: &Probe<'_>,
    leaves: &[u32],
) -> Result<Vec<Point3>, Error> {
    let Some(field) = at_many(probe) else {
        return Ok(parallel::map_each(leaves, |&id| {
            leaf_point(complex, probe, id)
        }));
    };
    let start = |&id: &u32| {
        let (low, size) = (complex.leaf(id).origin(), complex.leaf(id).size());
        let (samples, frame) = (complex.samples, complex.frame(id));
        let cell = Room {
            low,
            size: f64::from(size),
        };
        let crossings = cell_crossings(samples, probe, &cell, &frame);
        match probe.start(&cell, &crossings) {
            Start::From(x) if size > 1 => (cell, Start::There(probe.sink(&cell, x))),
            start => (cell, start),
        }
    };
    in_batches(field, leaves.len(), |some| {
        sunk(probe, field, leaves[some].iter().map(start).collect())
    })
}

/// The dual vertices of finest cells, by Newton steps of all of them at a time.
/// Those that are there already keep their place in the order.
fn sunk(
    probe: &Probe<'_>,
    field: &dyn FieldAtMany,
    starts: Vec<(Room, Start)>,
) -> Result<Vec<Point3>, Error> {
    let from: Vec<(Room, Point3)> = starts
        .iter()
        .filter_map(|(cell, start)| match start {
            Start::From(x) => Some((*cell, *x)),
            Start::There(_) => None,
        })
        .collect();
    let mut sunk = probe.sink_at_once(field, &from)?.into_iter();
    let points = starts.into_iter().map(|(cell, start)| match start {
        Start::There(x) => cell.in_domain(&x),
        Start::From(_) => cell.in_domain(&sunk.next().expect("one point per start")),
    });
    Ok(points.collect())
}

/// The points of finest cells of plain labels, given with the place of their block among the stored.
pub(crate) fn finest_points(
    samples: &Samples<'_>,
    probe: &Probe<'_>,
    cells: &[(u32, [i32; 3])],
    backend: &dyn ContourBackend,
    out: &mut [Point3],
) -> Result<(), Error> {
    debug_assert_eq!(out.len(), cells.len());
    if probe.field.is_none() && probe.placement == Placement::Newton {
        let values: Vec<[f32; 8]> = parallel::map_each(cells, |&(slot, cell)| {
            samples.corners_in(slot as usize, cell)
        });
        let points = dual_vertices(backend, &values)?;
        parallel::for_each(out, |i, out| *out = within(cells[i].1, points[i]));
    } else if let Some(field) = at_many(probe) {
        let start = |&(_, low): &(u32, [i32; 3])| {
            let frame = frame_of_corners(&samples.corner_labels(low, 1));
            let cell = Room { low, size: 1.0 };
            let crossings = cell_crossings(samples, probe, &cell, &frame);
            (cell, probe.start(&cell, &crossings))
        };
        out.copy_from_slice(&in_batches(field, cells.len(), |some| {
            sunk(probe, field, cells[some].iter().map(start).collect())
        })?);
    } else {
        parallel::for_each(out, |i, out| {
            let cell = cells[i].1;
            let labels = samples.corner_labels(cell, 1);
            *out = cell_point(samples, probe, cell, 1, &frame_of_corners(&labels));
        });
    }
    Ok(())
}

/// The field, where Newton steps are taken on it and it takes many points with one call.
fn at_many<'a>(probe: &Probe<'a>) -> Option<&'a dyn FieldAtMany> {
    let field = probe.field.filter(|_| probe.placement == Placement::Newton);
    field.and_then(|field| field.at_many())
}

/// The dual vertex of one leaf, of any size.
fn leaf_point(complex: &Complex<'_>, probe: &Probe<'_>, id: u32) -> Point3 {
    let leaf = complex.leaf(id);
    let frame = complex.frame(id);
    cell_point(complex.samples, probe, leaf.origin(), leaf.size(), &frame)
}

/// The dual vertex of a cell from the labels on its half lattice.
fn cell_point(
    samples: &Samples<'_>,
    probe: &Probe<'_>,
    o: [i32; 3],
    s: i32,
    frame: &Frame,
) -> Point3 {
    let cell = Room {
        low: o,
        size: f64::from(s),
    };
    let x = probe.place(&cell, &cell_crossings(samples, probe, &cell, frame));
    cell.in_domain(&x)
}

/// Where labels change on the edges of a cell, seen from its lowest corner, and whether they do on the level.
/// All edges of the frame count alike, halves of edges too, so the mean leans towards finer neighbours. Crossings are
/// linear in the values, not sharpened on a field: Newton steps follow.
fn cell_crossings(
    samples: &Samples<'_>,
    probe: &Probe<'_>,
    cell: &Room,
    frame: &Frame,
) -> Vec<(Point3, bool)> {
    let size = cell.size as i32;
    let sample = |i: usize| {
        let p = [i % 3, i / 3 % 3, i / 9].map(|c| c as i32);
        let p = [0, 1, 2].map(|k| cell.low[k] + p[k] * size / 2);
        Sample::at(samples, p, frame.labels[i])
    };
    let mut crossings = Vec::with_capacity(12);
    frame.edges(|i, j| {
        if frame.labels[i] != frame.labels[j] {
            let (a, b) = (sample(i), sample(j));
            let x = cell.relative(&a.x) + (b.x - a.x) * probe.crossing(&a, &b);
            crossings.push((x, Probe::on_level(a.label, b.label)));
        }
    });
    crossings
}

/// One point per cell, or an error: a backend from outside may answer anything.
fn dual_vertices(backend: &dyn ContourBackend, cells: &[[f32; 8]]) -> Result<Vec<[f32; 3]>, Error> {
    let mut points = Vec::with_capacity(cells.len());
    backend.dual_vertices(cells, STEPS, &mut points)?;
    let (found, of) = (points.len(), cells.len());
    BackendError::unless(found == of, &backend.name(), || {
        format!("{found} dual vertices for {of} cells")
    })?;
    Ok(points)
}

/// A point of the unit cube as a point of space, in cells; one outside, or none, is brought back.
/// A backend that answers nonsense so gives a bad mesh, but a valid one.
fn within(low: [i32; 3], x: [f32; 3]) -> Point3 {
    let x = x.map(|x| if x.is_nan() { 0.5 } else { f64::from(x) });
    let cell = Room { low, size: 1.0 };
    cell.in_domain(&cell.off_bulged_walls(Point3::from(x)))
}

/// The mean of the crossings of a face on the box.
/// In the plane of the face, kept off its sides: ghosts of neighbouring faces must not meet.
pub(super) fn ghost_point(complex: &Complex<'_>, probe: &Probe<'_>, id: u32, half: u8) -> Point3 {
    let base = complex.base_position(&Cell::Ghost(id, half));
    if !complex.is_interface(id) {
        return base;
    }
    let leaf = complex.leaf(id);
    let (o, s) = (leaf.origin(), leaf.size());
    if complex.is_split(id) {
        let split = &complex.splits[complex.split_of(id) as usize];
        let labels = complex.corner_labels(leaf);
        let corners: Vec<Sample> = split
            .triangle(half as usize)
            .iter()
            .map(|&i| {
                let p = corner_of(i);
                sample_corner(
                    complex,
                    Corner::Point([0, 1, 2].map(|k| o[k] + p[k])),
                    labels[i],
                )
            })
            .collect();
        return mean_of_crossings(probe, &corners).unwrap_or(base);
    }
    let (axis, side) = (usize::from(half / 4), 2 * usize::from(half / 2 % 2));
    let frame = complex.frame(id);
    let place = |i: usize| [i % 3, i / 3 % 3, i / 9];
    let (mut sum, mut n) = (Vector3::zeros(), 0.0);
    frame.edges(|i, j| {
        if place(i)[axis] == side && place(j)[axis] == side && frame.labels[i] != frame.labels[j] {
            let [a, b] = [i, j].map(|i| {
                let p = place(i).map(|c| c as i32);
                sample_corner(
                    complex,
                    Corner::Point([0, 1, 2].map(|k| o[k] + p[k] * s / 2)),
                    frame.labels[i],
                )
            });
            sum += (a.x - base) + (b.x - a.x) * probe.crossing(&a, &b);
            n += 1.0;
        }
    });
    if n == 0.0 {
        return base;
    }
    let reach = (0.5 - INSET) * f64::from(s);
    let mut off = (sum / n).map(|c| exact(c.clamp(-reach, reach)));
    off[axis] = 0.0;
    base + off
}
