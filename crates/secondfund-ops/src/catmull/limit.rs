//! Limit positions of vertices, and control points from them.
//!
//! The limit of a vertex is a fixed combination of the control points around it, so that all limits are one sparse
//! matrix times the control points, for places and for functions alike; its inverse, by iteration, finds the net of a
//! surface through given points.

use geom_core::algebra::SparseMatrix;
use geom_core::mesh::Halfedges;
use geom_core::{Point3, VertexId};
use rayon::prelude::*;

use super::ghosts::{Combination, Extended};
use crate::Error;

/// The limit mask of every vertex, `(n² V + 4 Σ E + Σ D) / (n (n + 5))` with the neighbours E along edges
/// and D across quads (Halstead, Kass and DeRose, 1993). At a boundary, by its ghosts,
/// `(l + 4 V + r) / 6`. A vertex of no quad stays.
/// Rows sum to 1. Where ghosts take part, their combinations are put in, so that columns are vertices of the mesh only.
pub(crate) fn mask(extended: &Extended) -> Result<SparseMatrix, Error> {
    let vertices = extended.real + extended.ghosts.len();
    let edges = Halfedges::<4>::new(vertices, &extended.quads)?;
    let mut entries = Vec::new();
    for v in 0..extended.real {
        let mut row = Combination::new();
        let around: Vec<_> = edges.around(VertexId(v as u32)).collect();
        let n = around.len() as f64;
        if around.is_empty() {
            row.push((v as u32, 1.0));
        } else if edges.on_boundary(VertexId(v as u32)) {
            // Of more than two quads: the first and the last around it are ghosts.
            let ends = [around[1], around[around.len() - 1]];
            extended.add(v as u32, 4.0 / 6.0, &mut row);
            ends.iter()
                .for_each(|&h| extended.add(edges.to(h).0, 1.0 / 6.0, &mut row));
        } else {
            let unit = 1.0 / (n * (n + 5.0));
            extended.add(v as u32, n * n * unit, &mut row);
            for h in around {
                extended.add(edges.to(h).0, 4.0 * unit, &mut row);
                extended.add(edges.to(edges.next(h)).0, unit, &mut row);
            }
        }
        entries.extend(row.into_iter().map(|(w, x)| (v as u32, w, x)));
    }
    Ok(SparseMatrix::from_triplets(
        extended.real,
        extended.real,
        &entries,
    )?)
}

/// Most steps, and the relative residual to reach.
/// A residual of 1e-14 is what f64 has to give.
const STEPS: usize = 600;
const TOLERANCE: f64 = 1e-14;

/// Control points whose limit positions are `samples`: conjugate gradients on the normal equations, whose
/// condition (81 on a regular net) does not depend on the number of vertices.
///
/// The start is the samples themselves, which are near where the surface bends little. The three coordinates are solved
/// side by side, each with steps of its own, and one that is done waits for the others.
pub(crate) fn interpolate(mask: &SparseMatrix, samples: &[Point3]) -> Vec<Point3> {
    let transposed = mask.transposed();
    let block =
        |points: &[Point3]| -> Vec<f64> { points.iter().flat_map(|p| [p.x, p.y, p.z]).collect() };
    let dots = |a: &[f64], b: &[f64]| -> [f64; 3] {
        let mut sums = [0.0; 3];
        a.iter()
            .zip(b)
            .enumerate()
            .for_each(|(i, (x, y))| sums[i % 3] += x * y);
        sums
    };
    let mut x = block(samples);
    let image = mask.multiply(&x, 3);
    let mut rest: Vec<f64> = block(samples)
        .iter()
        .zip(&image)
        .map(|(b, a)| b - a)
        .collect();
    let mut gradient = transposed.multiply(&rest, 3);
    let mut direction = gradient.clone();
    let mut size = dots(&gradient, &gradient);
    let start = size;
    for _ in 0..STEPS {
        let image = mask.multiply(&direction, 3);
        let curvature = dots(&image, &image);
        let open: [bool; 3] = std::array::from_fn(|k| {
            size[k] > TOLERANCE * TOLERANCE * start[k] && curvature[k] > 0.0
        });
        if open == [false; 3] {
            break;
        }
        let step: [f64; 3] =
            std::array::from_fn(|k| if open[k] { size[k] / curvature[k] } else { 0.0 });
        x.par_iter_mut()
            .zip(&direction)
            .enumerate()
            .with_min_len(4096)
            .for_each(|(i, (x, d))| *x += step[i % 3] * d);
        rest.iter_mut()
            .zip(&image)
            .enumerate()
            .for_each(|(i, (r, a))| *r -= step[i % 3] * a);
        gradient = transposed.multiply(&rest, 3);
        let next = dots(&gradient, &gradient);
        let turn: [f64; 3] = std::array::from_fn(|k| if open[k] { next[k] / size[k] } else { 0.0 });
        direction
            .iter_mut()
            .zip(&gradient)
            .enumerate()
            .for_each(|(i, (d, g))| *d = g + turn[i % 3] * *d);
        size = next;
    }
    x.chunks_exact(3)
        .map(|p| Point3::new(p[0], p[1], p[2]))
        .collect()
}
