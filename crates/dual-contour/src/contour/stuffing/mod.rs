//! The second mesher: isosurface stuffing (Labelle & Shewchuk 2007) of the base tetrahedra.
//!
//! Corners and cell points stay where they are and carry labels; base tetrahedra with more than one
//! label are cut where labels change along their edges. A vertex with a cut close by is snapped onto
//! it, which keeps angles away from 0° and 180°, but only where the interface stays a manifold.

use std::sync::atomic::{AtomicU8, Ordering::Relaxed};

use geom_core::Point3;
use geom_core::mesh::{FACES, INTERIOR, Region};
use rayon::prelude::*;

use super::raw::Raw;
use crate::complex::collect::{distinct, kinds, seen};
use crate::complex::cube::{corner_of, corners_of};
use crate::complex::{Cell, Complex, Numbering, Vertex};
use crate::dual::{Probe, Sample};
use crate::octree::local;

mod cut;
mod near;
mod snap;

use near::Near;

/// A base tetrahedron and the labels of its corners.
type Labelled = ([u32; 4], [Region; 4]);

/// Meshes by stuffing, always up to the box: what is snapped shall not depend on what is wanted. The
/// molecule may meet the box if `clipped`. `keep` says which regions are wanted; the molecule's surface
/// comes in any case.
pub(crate) fn mesh(
    complex: &Complex<'_>,
    probe: &Probe<'_>,
    clipped: bool,
    keep: impl Fn(Region) -> bool + Sync,
) -> (Raw, Counts) {
    let ghosts = complex.ghosts();
    let numbering = Numbering::new(complex, &ghosts, |_| true);
    let labels = cell_labels(complex, probe, &numbering, clipped);
    // Where the box cuts the molecule, its pieces close the surface.
    let needed = |r: Region| keep(r) || clipped && r == INTERIOR;
    let all = base_tets(complex, &numbering, &labels);
    // Vertices of tetrahedra with more than one label; whatever touches them may change.
    let hot: Vec<AtomicU8> = (0..numbering.len()).map(|_| AtomicU8::new(0)).collect();
    all.par_iter().with_min_len(4096).for_each(|(tet, labels)| {
        if labels.iter().any(|&l| l != labels[0]) {
            for &v in tet {
                hot[v as usize].store(1, Relaxed);
            }
        }
    });
    let hot: Vec<bool> = hot.into_iter().map(|h| h.into_inner() == 1).collect();
    let (near, far): (Vec<Labelled>, Vec<Labelled>) = all
        .into_par_iter()
        .with_min_len(4096)
        .filter(|(tet, labels)| needed(labels[0]) || tet.iter().any(|&v| hot[v as usize]))
        .partition(|(tet, _)| tet.iter().any(|&v| hot[v as usize]));
    let vertices: Vec<Vertex> = numbering.vertices().collect();
    let mut positions: Vec<Point3> = vertices
        .par_iter()
        .map(|v| match v {
            Vertex::Cell(cell) => complex.base_position(cell),
            Vertex::Corner(corner) => complex.corner_position(*corner),
        })
        .collect();
    let (mut near, ids) = Near::new(complex, probe, &vertices, &near, &hot, clipped);
    let counts = near.snap();
    for (sample, &id) in near.samples.iter().zip(&ids) {
        positions[id as usize] = sample.x;
    }
    let first = positions.len() as u32;
    let (cut, added) = near.cut(&ids, &mut positions);
    let mut on_surface = vec![false; first as usize];
    let mut meeting = vec![1; first as usize];
    for (zero, &id) in near.zero.iter().zip(&ids) {
        if let Some((a, b)) = zero {
            on_surface[id as usize] = true;
            meeting[id as usize] = distinct([*a, *b].map(|l| seen(l, &keep)));
        }
    }
    meeting.extend(
        added
            .iter()
            .map(|labels| distinct(labels.iter().map(|&l| seen(l, &keep)))),
    );

    let cells = complex.tree.cells;
    let mut out = Raw {
        kinds: kinds(&positions, &meeting, cells),
        added: added.len(),
        ..Raw::default()
    };
    // Faces that may belong to the surface: those of the molecule that no other tetrahedron of it has.
    let mut faces: Vec<([u32; 3], [u32; 3])> = Vec::new();
    let mut take = |tet: [u32; 4], region: Region, near: bool| {
        if region == INTERIOR && (near || clipped) {
            for face in FACES.map(|f| f.map(|k| tet[k])) {
                let surface = near && face.iter().all(|&v| v >= first || on_surface[v as usize]);
                let planes = |v: u32| planes_of(&positions[v as usize], cells);
                if surface || clipped && face.iter().fold(!0, |m, &v| m & planes(v)) != 0 {
                    let mut key = face;
                    key.sort_unstable();
                    faces.push((key, face));
                }
            }
        }
        if keep(region) {
            out.tets.push(tet);
            out.regions.push(region);
        }
    };
    for (tet, labels) in far {
        take(tet, labels[0], false);
    }
    for (tet, region) in cut {
        take(tet, region, true);
    }
    faces.par_sort_unstable();
    out.triangles = faces
        .chunk_by(|a, b| a.0 == b.0)
        .filter(|group| group.len() == 1)
        .map(|group| group[0].1)
        .collect();
    out.positions = positions;
    (out, counts)
}

/// The planes of the box that hold a point: bit `2 · axis + side`.
fn planes_of(p: &Point3, cells: [i32; 3]) -> u8 {
    (0..3).fold(0, |m, k| {
        m | u8::from(p[k] == 0.0) << (2 * k) | u8::from(p[k] == f64::from(cells[k])) << (2 * k + 1)
    })
}

/// The middle of a leaf, or of a face on the box, with its label and value. Where all corners have one
/// label, so has the middle.
fn cell_sample(complex: &Complex<'_>, probe: &Probe<'_>, cell: &Cell, clipped: bool) -> Sample {
    let samples = complex.samples;
    let x = complex.base_position(cell);
    let (id, face) = match *cell {
        Cell::Leaf(id) => (id, None),
        Cell::Ghost(id, half) => (id, Some(usize::from(half / 2))),
        Cell::Part(..) => unreachable!("the lattice method splits no leaf"),
    };
    let leaf = complex.leaf(id);
    let (o, s) = (leaf.origin(), leaf.size());
    if s > 1 {
        // The middle is a lattice point; it has a value where a boundary is near.
        let p = [0, 1, 2].map(|k| x[k].round() as i32);
        let label = samples.label(if complex.is_interface(id) { p } else { o });
        let value = samples.value(p);
        return Sample { x, label, value };
    }
    let corners = corners_of(face);
    let points = corners
        .iter()
        .map(|&c| [0, 1, 2].map(|k| o[k] + corner_of(c)[k]));
    let first = samples.label(o);
    let (mut same, mut label, mut mean, mut n) = (true, None, 0.0, 0.0);
    for p in points {
        let l = samples.label(p);
        same &= *label.get_or_insert(l) == l;
        mean += samples.value(p);
        n += 1.0;
    }
    mean /= n;
    if same {
        let label = label.unwrap_or(first);
        return Sample {
            x,
            label,
            value: mean,
        };
    }
    let point = samples.domain.world(&x);
    let value = probe.value(&point).unwrap_or(mean);
    let label = samples.labels.at(value, &point);
    if label == INTERIOR && !clipped && complex.is_on_box(id) {
        // The surface stays off the box.
        let on_box = |c: &usize| {
            let p = [0, 1, 2].map(|k| o[k] + corner_of(*c)[k]);
            (planes_of(&local(p), complex.tree.cells) != 0).then_some(p)
        };
        let p = corners
            .iter()
            .find_map(on_box)
            .expect("a leaf on the box has a corner there");
        let (label, value) = (samples.label(p), samples.value(p));
        return Sample { x, label, value };
    }
    Sample { x, label, value }
}

/// Labels of leaves and ghosts, by vertex number.
fn cell_labels(
    complex: &Complex<'_>,
    probe: &Probe<'_>,
    numbering: &Numbering<'_>,
    clipped: bool,
) -> Vec<Region> {
    let leaves = complex.tree.leaves.len() as u32;
    (0..leaves)
        .into_par_iter()
        .with_min_len(1024)
        .map(|id| {
            if complex.is_interface(id) {
                cell_sample(complex, probe, &Cell::Leaf(id), clipped).label
            } else {
                complex.samples.label(complex.leaf(id).origin())
            }
        })
        .chain(numbering.ghosts().par_iter().map(|&(id, half)| {
            if complex.is_interface(id) {
                cell_sample(complex, probe, &Cell::Ghost(id, half), clipped).label
            } else {
                complex.samples.label(complex.leaf(id).origin())
            }
        }))
        .collect()
}

/// All base tetrahedra with the labels of their corners.
fn base_tets(complex: &Complex<'_>, numbering: &Numbering<'_>, labels: &[Region]) -> Vec<Labelled> {
    (0..complex.tree.leaves.len() as u32)
        .into_par_iter()
        .with_min_len(1024)
        .flat_map_iter(|id| {
            let mut tets: Vec<Labelled> = Vec::new();
            complex.rings_of(
                id,
                |_, _| true,
                |ring| {
                    let [a, b] = [ring.a.0, ring.b.0].map(|c| numbering.corner(c));
                    let n = ring.cells.len();
                    for i in 0..if ring.open { n - 1 } else { n } {
                        let [c, d] = [i, (i + 1) % n].map(|i| numbering.cell(&ring.cells[i]));
                        let [lc, ld] = [c, d].map(|c| labels[c as usize]);
                        tets.push(([a, b, c, d], [ring.a.1, ring.b.1, lc, ld]));
                    }
                },
            );
            tets
        })
        .collect()
}
