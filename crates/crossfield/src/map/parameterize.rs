//! From a cross field to an integer-grid map.

use geom_core::options::require;
use geom_core::{Run, TriMesh};

use super::coarse::Coarse;
use super::cut::Cut;
use super::exact::{GridMap, MapReport, axes_in, doubled_area, sector};
use super::round::Quadratic;
use super::spacing::Spacing;
use super::spacing::{Chart, charts};
use super::system::{System, Weighted};
use super::transition::Seams;
use super::untangle::untangle;
use crate::Error;
use crate::backend::CrossfieldBackend;
use crate::field::CrossField;
use crate::field::frames::Frames;

/// Solves with stiffer triangles before the map is untangled.
const STIFFENINGS: usize = 8;
/// Binary digits after the point: coordinates stay below 2³⁸, products in 128 bits.
const BITS: u32 = 24;

/// What the map should be like.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct MapOptions {
    /// How far apart neighbouring lines shall be.
    pub spacing: Spacing,
    /// Half-edges (3 × triangle + side) that must be lines, e.g. sharp edges; the field has to be parallel to them. Of the
    /// two of an edge one is enough. Boundaries always are lines.
    pub lines: Vec<u32>,
}

/// The map whose gradients are closest to the field, with integers on the seams (Eq. 4.10); `mesh` is connected.
///
/// The surface is cut open, all conditions of seams, singular vertices and lines are eliminated exactly, and the integers are
/// rounded one by one with the rest following to its optimum. Triangles that fold get stiffer (Bommes et al. 2009); what is
/// folded then is untangled (Garanzha et al. 2021). The result is checked in integers: [`Error::Folded`] says where it is no
/// integer-grid map.
pub fn parameterize<B: CrossfieldBackend + ?Sized>(
    mesh: &TriMesh,
    frames: &Frames,
    field: &CrossField,
    options: &MapOptions,
    run: Run<'_, B>,
) -> Result<GridMap, Error> {
    let spacing = &options.spacing;
    spacing.check(frames.faces())?;
    let mut lines: Vec<usize> = options.lines.iter().map(|&h| h as usize).collect();
    let known = lines.iter().all(|&h| h < frames.edges().len());
    require(known, "lines", lines.len(), "name half-edges of the mesh")?;
    lines.extend((0..frames.edges().len()).filter(|&h| frames.twin(h).is_none()));
    lines.sort_unstable();
    lines.dedup();
    let cut = Cut::of(mesh, frames, field)?;
    let seams = Seams::of(frames, field, &cut, &lines);
    let charts = charts(mesh, frames, field, &cut, spacing);
    let mut system = System::new(&cut, &seams, &charts);
    let mut report = MapReport {
        integers: seams.integers,
        ..MapReport::default()
    };
    run.progress("map", 0, 3)?;
    let mut weights = vec![1.0; charts.len()];
    let mut weighted = system.weighted(&weights)?;
    let mut y = quantized(frames, field, &system, &weighted, &mut report)?;
    let mut corners = system.corners(&y);
    run.progress("map", 1, 3)?;
    report.folded = faults(frames, field, &charts, &corners).len();
    for _ in 0..STIFFENINGS {
        let faults = faults(frames, field, &charts, &corners);
        if faults.is_empty() {
            break;
        }
        stiffen(frames, &charts, &corners, &faults, &mut weights);
        weighted = system.weighted(&weights)?;
        let reals = weighted.reals_for(&y[seams.reals..])?;
        y[..seams.reals].copy_from_slice(&reals);
        corners = system.corners(&y);
        report.stiffenings += 1;
    }
    run.progress("map", 2, 3)?;
    if !faults(frames, field, &charts, &corners).is_empty() {
        report.untangled = true;
        untangle(&system, &mut y, run.backend)?;
        corners = system.corners(&y);
    }
    report.energy = system.energy(&corners);
    fixed(frames, field, &cut, &seams, &y, report)
}

/// Integers and the reals that follow them. Where rounding lays singular vertices onto each other, the integers are found
/// on a denser grid and brought back while the decimated map stays upright.
fn quantized(
    frames: &Frames,
    field: &CrossField,
    system: &System<'_>,
    weighted: &Weighted,
    report: &mut MapReport,
) -> Result<Vec<f64>, Error> {
    let (s, right) = weighted.schur()?;
    let quadratic = Quadratic::new(&s, &right);
    let indefinite = geom_core::algebra::Error::NotPositiveDefinite { row: 0 };
    let with_reals = |z: &[f64]| -> Result<Vec<f64>, Error> {
        let mut y = weighted.reals_for(z)?;
        y.extend_from_slice(z);
        Ok(y)
    };
    let relaxed = quadratic.relaxed().ok_or(indefinite.clone())?;
    let corners = system.corners(&with_reals(&relaxed)?);
    report.relaxed_energy = system.energy(&corners);
    let rounded = quadratic.rounded().ok_or(indefinite)?;
    let y = with_reals(&rounded)?;
    if faults(frames, field, system.charts, &system.corners(&y)).is_empty() {
        return Ok(y);
    }
    let Some(coarse) = Coarse::of(frames, field, system.cut, system.seams, &corners) else {
        return Ok(y);
    };
    if coarse.is_upright(&rounded) {
        return Ok(y);
    }
    match quadratic.rounded_within(|z| coarse.is_upright(z)) {
        Some(z) => {
            report.respaced = true;
            with_reals(&z)
        }
        None => Ok(y),
    }
}

/// Triangles that are inverted or turned away, and triangles around vertices whose angles in the map do not add up to
/// what the field says.
fn faults(
    frames: &Frames,
    field: &CrossField,
    charts: &[Chart],
    corners: &[[[f64; 2]; 3]],
) -> Vec<usize> {
    let mut faults: Vec<usize> = (0..charts.len())
        .filter(|&f| charts[f].is_bad(&corners[f]))
        .collect();
    for v in 0..frames.edges().vertices() {
        let fan: Vec<usize> = frames.around(v).collect();
        if fan.is_empty() {
            continue;
        }
        let angle: f64 = fan
            .iter()
            .map(|&h| corner_angle(&corners[h / 3], h % 3))
            .sum();
        let quarters = if frames.on_boundary(v) { 2 } else { 4 } - field.index[v];
        let wanted = f64::from(quarters) * std::f64::consts::FRAC_PI_2;
        if (angle - wanted).abs() > std::f64::consts::FRAC_PI_4 {
            faults.extend(fan.iter().map(|&h| h / 3));
        }
    }
    faults.sort_unstable();
    faults.dedup();
    faults
}

fn corner_angle(uv: &[[f64; 2]; 3], k: usize) -> f64 {
    let side = |l: usize| [uv[l][0] - uv[k][0], uv[l][1] - uv[k][1]];
    let (a, b) = (side((k + 1) % 3), side((k + 2) % 3));
    (a[0] * b[1] - a[1] * b[0]).atan2(a[0] * b[0] + a[1] * b[1])
}

/// Local stiffening (Bommes, Zimmer and Kobbelt, 2009): weights grow where the distortion is uneven, and around faults.
fn stiffen(
    frames: &Frames,
    charts: &[Chart],
    corners: &[[[f64; 2]; 3]],
    faults: &[usize],
    weights: &mut [f64],
) {
    const MOST: f64 = 5.0;
    const AT_FAULTS: f64 = 2.0;
    let distortion: Vec<f64> = charts
        .iter()
        .zip(corners)
        .map(|(chart, uv)| {
            let j = chart.jacobian(uv);
            let determinant = j[0][0] * j[1][1] - j[0][1] * j[1][0];
            let sum = j.iter().flatten().map(|x| x * x).sum::<f64>();
            let root = (sum * sum - 4.0 * determinant * determinant)
                .max(0.0)
                .sqrt();
            let (large, small) = (
                ((sum + root) / 2.0).sqrt(),
                ((sum - root).max(0.0) / 2.0).sqrt(),
            );
            let sign = determinant.signum();
            (large * sign - 1.0).abs() + (small * sign - 1.0).abs()
        })
        .collect();
    for f in 0..charts.len() {
        let uneven: f64 = (3 * f..3 * f + 3)
            .filter_map(|h| frames.twin(h))
            .map(|t| distortion[f] - distortion[t / 3])
            .sum();
        weights[f] += uneven.abs().min(MOST);
    }
    let mut near: Vec<usize> = faults
        .iter()
        .flat_map(|&f| 3 * f..3 * f + 3)
        .flat_map(|h| frames.around(frames.from(h)))
        .map(|h| h / 3)
        .collect();
    near.sort_unstable();
    near.dedup();
    for f in near {
        weights[f] += AT_FAULTS;
    }
}

/// The map in fixed point, checked exactly.
fn fixed(
    frames: &Frames,
    field: &CrossField,
    cut: &Cut,
    seams: &Seams,
    y: &[f64],
    report: MapReport,
) -> Result<GridMap, Error> {
    let unit = (1i64 << BITS) as f64;
    let values: Vec<i64> = y
        .iter()
        .enumerate()
        .map(|(k, &y)| {
            if k < seams.reals {
                (y * unit).round() as i64
            } else {
                (y.round() as i64) << BITS
            }
        })
        .collect();
    let at = |copy: u32, component: usize| -> i64 {
        seams
            .row(copy, component)
            .map(|(k, c)| i64::from(c) * values[k])
            .sum()
    };
    let corners: Vec<[[i64; 2]; 3]> = cut
        .copy
        .chunks_exact(3)
        .map(|c| [0, 1, 2].map(|k| [at(c[k], 0), at(c[k], 1)]))
        .collect();
    let triangles = corners.iter().filter(|uv| doubled_area(uv) <= 0).count();
    let map = GridMap {
        corners,
        turn: cut.turn.clone(),
        bits: BITS,
        report,
    };
    let cones = wrong_cones(frames, field, &map);
    if triangles + cones > 0 {
        let stage = if report.untangled {
            "untangling"
        } else {
            "rounding"
        };
        return Err(Error::Folded {
            triangles,
            cones,
            stage,
        });
    }
    Ok(map)
}

/// Vertices around which the axis directions do not number `4 − 4 I` (inside) or `3 − 4 I` (on a boundary), counted
/// exactly.
fn wrong_cones(frames: &Frames, field: &CrossField, map: &GridMap) -> usize {
    (0..frames.edges().vertices())
        .filter(|&v| {
            let fan: Vec<usize> = frames.around(v).collect();
            if fan.is_empty() {
                return false;
            }
            let on_boundary = frames.on_boundary(v);
            let last = fan.len() - 1;
            let count: usize = fan
                .iter()
                .enumerate()
                .map(|(i, &h)| {
                    let [a, b] = sector(map, h);
                    axes_in(a, b, on_boundary && i == last).count()
                })
                .sum();
            let whole = if on_boundary { 3 } else { 4 };
            count as i32 != whole - field.index[v]
        })
        .count()
}
