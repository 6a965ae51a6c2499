//! How large a map wants to be where.
//!
//! The field says how far a map turns around each vertex. Among the metrics `e^2φ g` that scale the surface by place, one is
//! flat with just these cones, and to first order `L φ = K̂ − K`, with L the cotangents, K the angle that is missing around a
//! vertex on the surface and K̂ the one that shall be missing in the map (Ben-Chen, Gotsman and Bunin, *Conformal flattening by
//! curvature prescription and metric scaling*, 2008).
//!
//! A map of one size everywhere, which the energy of Eq. 4.10 asks for, has to squeeze where cones are close together, and
//! folds there. In the sizes of the flat metric hardly any triangle folds, but they are far from one size. So maps are
//! unfolded from halfway, where few fold, in small places.

use geom_core::algebra::{Cholesky, SparseMatrix};
use geom_core::compute::parallel;

use super::cones::wanted_angle;
use super::spacing::Chart;
use crate::Error;
use crate::field::CrossField;
use crate::field::frames::Frames;

/// The share of φ that is taken. With less of it more triangles fold, with more what comes out is further from one size.
const SHARE: f64 = 0.5;
/// No triangle is wanted larger or smaller than by this factor.
const MOST: f64 = 16.0;
/// What holds φ, in cotangents: a constant more changes nothing but the size.
const HELD: f64 = 1e-9;

/// How many times as long as they are the sides of each triangle want to be, in the mean as they are.
pub(super) fn scales(
    charts: &[Chart],
    frames: &Frames,
    field: &CrossField,
) -> Result<Vec<f64>, Error> {
    let phi = logarithms(charts, frames, field)?;
    let at = |f: usize| {
        let corners = (0..3).map(|k| phi[frames.from(3 * f + k)]);
        SHARE * corners.sum::<f64>() / 3.0
    };
    let all = (0..charts.len()).map(|f| charts[f].area * at(f));
    let mean = all.sum::<f64>() / charts.len() as f64;
    Ok(parallel::map(charts.len(), |f| {
        (at(f) - mean).exp().clamp(MOST.recip(), MOST)
    }))
}

/// φ per vertex.
fn logarithms(charts: &[Chart], frames: &Frames, field: &CrossField) -> Result<Vec<f64>, Error> {
    let count = field.index.len();
    let is_used = |v: usize| frames.around(v).next().is_some();
    // K̂ − K is what the angles add up to, less what they shall add up to.
    let missing = |v: usize| match is_used(v) {
        true => -wanted_angle(frames, field, v),
        false => 0.0,
    };
    let mut excess: Vec<f64> = (0..count).map(missing).collect();
    let mut entries = Vec::with_capacity(12 * charts.len() + count);
    for (f, chart) in charts.iter().enumerate() {
        let corners = [0, 1, 2].map(|k| frames.from(3 * f + k) as u32);
        for k in 0..3 {
            let [a, b] = chart.sides(k);
            let (dot, cross) = (a[0] * b[0] + a[1] * b[1], a[0] * b[1] - a[1] * b[0]);
            excess[corners[k] as usize] += cross.atan2(dot);
            let weight = 0.5 * dot / cross;
            let (i, j) = (corners[(k + 1) % 3], corners[(k + 2) % 3]);
            entries.extend([(i, i, weight), (j, j, weight)]);
            entries.extend([(i, j, -weight), (j, i, -weight)]);
        }
    }
    entries.extend((0..count).map(|v| (v as u32, v as u32, if is_used(v) { HELD } else { 1.0 })));
    let matrix = SparseMatrix::from_triplets(count, count, &entries)?;
    Ok(Cholesky::of(&matrix)?.solve(&excess)?)
}
