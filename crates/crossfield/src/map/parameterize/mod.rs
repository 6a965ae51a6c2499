//! From a cross field to an integer-grid map.
//!
//! [`parameterize`] is for callers who want a map or nothing; the ladder of the whole program calls [`parameterized`],
//! which may come back with a decimated map instead, and stops early where that is of no use. Both go through
//! [`Making`]: relaxation ([`relaxed`]), integers ([`quantized`]), unfolding, and at last the check in [`fixed`].

#[cfg(feature = "testing")]
mod probes;
mod quantized;
mod relaxed;

use geom_core::options::require;
use geom_core::{Run, TriMesh};

#[cfg(feature = "testing")]
pub use self::probes::{OfIntegers, Settled, Unfolded};
#[cfg(feature = "testing")]
pub(crate) use self::probes::{
    aligned, decimated, of_integers, parameterized_within, settled, sizes, unfolded_places,
    unfolding_costs, untangling_cost,
};
use self::quantized::Rounded;
pub(crate) use self::relaxed::{Relaxation, relaxation};
use super::cones::has_wrong_angle;
use super::cut::Cut;
use super::exact::{GridMap, MapReport, fixed};
use super::integers::{AtLeast, MOST_DENSE, Spread};
use super::spacing::{Chart, Spacing, charts};
use super::system::{System, Weighted};
use super::transition::{Seams, without_corners};
use super::unfold::{Unfolder, Unfolding};
use crate::Error;
use crate::backend::{CrossfieldBackend, On};
use crate::field::CrossField;
use crate::field::frames::Frames;

/// With a decimated map to fall back on, that of all triangles is mended where no more than one vertex in so many is not right:
/// of more, mending rarely comes to an end, and what it comes to is squeezed.
const MENDABLE: usize = 500;
/// Or no more than these.
const FEW: usize = 16;
/// Unfolding without integers leaves one in so many parts of the effort.
const RESERVE: u64 = 4;

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
/// The surface is cut open, all conditions of seams, singular vertices and lines are eliminated exactly. A map that folds
/// before anything is an integer starts anew from the sizes that the field's cones ask for (Ben-Chen et al. 2008), goes
/// towards a convex set of upright maps (Lipman 2012), is unfolded place by place, or with all unknowns free (Garanzha et
/// al. 2021), and what comes out is what is wanted from then on. The integers are rounded one by one with the rest following to its
/// optimum, where they are thousands region by region. What folds then is unfolded place by place, or untangled as a whole. The result is checked in integers.
///
/// `frames` and `field` are those of `mesh`, and hold one entry per triangle. The module's page has an example.
///
/// # Errors
/// [`Error::Folded`] says where what came out is no integer-grid map: a triangle is inverted, or lines turn too far around a
/// vertex. A smaller spacing, finer triangles or another field may help, which is what [`quadrangulate`](crate::quadrangulate)
/// tries by itself. [`Error::Integers`] for more of these than so many triangles are worth. [`Error::Option`] names a spacing or
/// a half-edge that makes no sense.
pub fn parameterize<B: CrossfieldBackend + ?Sized>(
    mesh: &TriMesh,
    frames: &Frames,
    field: &CrossField,
    options: &MapOptions,
    run: Run<'_, B>,
) -> Result<GridMap, Error> {
    let run = run.with(run.backend.as_crossfield());
    whole_map(mesh, frames, field, options, MOST_DENSE, run)
}

/// The same with so many integers at most whose energy is known in full.
pub(crate) fn whole_map(
    mesh: &TriMesh,
    frames: &Frames,
    field: &CrossField,
    options: &MapOptions,
    most_dense: usize,
    run: On<'_>,
) -> Result<GridMap, Error> {
    let (effort, ends) = Unfolding::alone(mesh.triangles().len());
    let unfolding = Unfolding {
        effort: &effort,
        ends: &ends,
        most_dense,
    };
    match parameterized(mesh, frames, field, options, unfolding, None, run)? {
        Laid::Whole(map) => Ok(map),
        Laid::Decimated(_, error) => Err(error),
        Laid::Vain(_) => unreachable!("no map is called vain"),
    }
}

/// Where the quads of a decimated map are no mesh.
#[derive(Debug, Default)]
pub(crate) struct Narrow {
    /// Is there such a place?
    pub(crate) anywhere: bool,
    /// What would widen the handles and necks there, as far as that can be said in integers.
    pub(crate) wider: Vec<AtLeast>,
}

/// How such places are found, and what then.
#[derive(Clone, Copy)]
pub(crate) struct Widening<'a> {
    pub(crate) narrow: &'a dyn Fn(&Spread) -> Narrow,
    /// Is a map that keeps such places worth no more work, because lines will be laid closer there?
    pub(crate) may_be_vain: bool,
}

/// What came of a field.
pub(crate) enum Laid {
    /// A map that is upright in every triangle.
    Whole(GridMap),
    /// One that is so as a decimated map only, and what is wrong in the triangles of the surface.
    Decimated(Spread, Error),
    /// A decimated map that is of no use.
    Vain(Spread),
}

/// The same for not more than so much work, with handles and necks made wider as far as that can be, if asked for. A decimated
/// map that is vain then is not made one of all triangles.
pub(crate) fn parameterized(
    mesh: &TriMesh,
    frames: &Frames,
    field: &CrossField,
    options: &MapOptions,
    unfolding: Unfolding<'_>,
    widening: Option<Widening<'_>>,
    run: On<'_>,
) -> Result<Laid, Error> {
    let laid = |pinned: Vec<usize>| {
        let prepared = prepared(mesh, frames, field, options, pinned, unfolding.most_dense)?;
        laid(mesh, frames, field, &prepared, unfolding, widening, run)
    };
    match laid(Vec::new())? {
        Some(laid) => Ok(laid),
        None => Ok(laid(without_corners(frames, field))?.expect("nothing more can be pinned")),
    }
}

/// The same of what has been prepared. `None` where a decimated map is looked for, and one with pinned vertices would help.
fn laid(
    mesh: &TriMesh,
    frames: &Frames,
    field: &CrossField,
    (cut, seams, charts): &(Cut, Seams, Vec<Chart>),
    unfolding: Unfolding<'_>,
    widening: Option<Widening<'_>>,
    run: On<'_>,
) -> Result<Option<Laid>, Error> {
    let system = System::new(cut, seams, charts);
    let mut making = Making::new(mesh, frames, field, system, unfolding, run);
    run.progress("map", 0, 3)?;
    // What integers fold is to be unfolded, too.
    let reserve = unfolding.effort.share(RESERVE);
    let relaxed = making.relaxed();
    unfolding.effort.give_back(&reserve);
    let mut relaxed = relaxed?;
    run.progress("map", 1, 3)?;
    let Some(Rounded {
        mut w,
        stage,
        spread,
        is_narrow,
    }) = making.quantized(&mut relaxed, widening)?
    else {
        return Ok(None);
    };
    run.progress("map", 2, 3)?;
    let may_be_vain = is_narrow && widening.is_some_and(|w| w.may_be_vain);
    let spread = match spread {
        Some(spread) if may_be_vain => return Ok(Some(Laid::Vain(spread))),
        spread => spread,
    };
    // With a decimated map to fall back on, no more than a little.
    let share = unfolding.effort.share(if spread.is_some() { 8 } else { 1 });
    making.unfolding.effort = &share;
    making.unfold(&relaxed.weighted, spread.is_some(), &mut w)?;
    unfolding.effort.give_back(&share);
    making.report.energy = making.system.energy(&making.system.corners(&w));
    let laid = match (
        fixed(frames, field, cut, seams, &w, stage, making.report),
        spread,
    ) {
        (Ok(map), _) => Laid::Whole(map),
        (Err(error), Some(mut spread)) => {
            spread.map.report = MapReport {
                decimated: true,
                ..making.report
            };
            Laid::Decimated(spread, error)
        }
        (Err(error), None) => return Err(error),
    };
    Ok(Some(laid))
}

/// The cut, its conditions with some vertices pinned to integers, and what is wanted in each triangle.
fn prepared(
    mesh: &TriMesh,
    frames: &Frames,
    field: &CrossField,
    options: &MapOptions,
    pinned: Vec<usize>,
    most_dense: usize,
) -> Result<(Cut, Seams, Vec<Chart>), Error> {
    let spacing = &options.spacing;
    spacing.check(frames.faces())?;
    let mut lines: Vec<usize> = options.lines.iter().map(|&h| h as usize).collect();
    let known = lines.iter().all(|&h| h < frames.edges().len());
    require(known, "lines", lines.len(), "name half-edges of the mesh")?;
    lines.extend((0..frames.edges().len()).filter(|&h| frames.twin(h).is_none()));
    lines.sort_unstable();
    lines.dedup();
    let cut = Cut::of(mesh, frames, field)?;
    let seams = Seams::of(frames, field, &cut, &lines, pinned, most_dense);
    let charts = charts(mesh, frames, field, &cut, spacing);
    Ok((cut, seams, charts))
}

/// What is made of a field by itself, no other map of it before or after.
fn alone<T>(
    mesh: &TriMesh,
    frames: &Frames,
    field: &CrossField,
    options: &MapOptions,
    run: On<'_>,
    make: impl FnOnce(Making<'_>) -> Result<T, Error>,
) -> Result<T, Error> {
    let (cut, seams, charts) = prepared(mesh, frames, field, options, Vec::new(), MOST_DENSE)?;
    let (effort, ends) = Unfolding::alone(charts.len());
    let unfolding = Unfolding {
        effort: &effort,
        ends: &ends,
        most_dense: MOST_DENSE,
    };
    let system = System::new(&cut, &seams, &charts);
    make(Making::new(mesh, frames, field, system, unfolding, run))
}

/// A map on its way.
struct Making<'a> {
    mesh: &'a TriMesh,
    frames: &'a Frames,
    field: &'a CrossField,
    system: System<'a>,
    /// How much each triangle counts.
    weights: Vec<f64>,
    report: MapReport,
    unfolding: Unfolding<'a>,
    run: On<'a>,
}

impl<'a> Making<'a> {
    fn new(
        mesh: &'a TriMesh,
        frames: &'a Frames,
        field: &'a CrossField,
        system: System<'a>,
        unfolding: Unfolding<'a>,
        run: On<'a>,
    ) -> Self {
        Self {
            mesh,
            frames,
            field,
            weights: vec![1.0; system.charts.len()],
            report: MapReport {
                integers: system.seams.integers,
                ..MapReport::default()
            },
            system,
            unfolding,
            run,
        }
    }

    fn unfolder(&self) -> Unfolder<'_> {
        Unfolder {
            system: &self.system,
            frames: self.frames,
            field: self.field,
            effort: self.unfolding.effort,
            run: self.run,
        }
    }

    /// The same as [`faults`] for the triangles of this map.
    fn faults(&self, corners: &[[[f64; 2]; 3]]) -> Vec<usize> {
        faults(self.frames, self.field, self.system.charts, corners)
    }

    /// Unfolds place by place, the integers held; then as a whole, unless there is a decimated map to fall back on: what folds in
    /// no place of its own is rarely worth what that takes. Nor is what folds in too many.
    ///
    /// What comes out may still be folded: the check afterwards says so, and counts.
    fn unfold(
        &mut self,
        weighted: &Weighted<'_>,
        may_fall_back: bool,
        w: &mut [f64],
    ) -> Result<(), Error> {
        self.report.folded = self.faults(&self.system.corners(w)).len();
        if self.report.folded == 0 {
            return Ok(());
        }
        if may_fall_back {
            let bad = self.unfolder().bad(&self.system.corners(w)).len();
            if bad <= FEW.max(self.frames.edges().vertices() / MENDABLE) {
                self.report.untangled = true;
                self.unfolder().mended(weighted, false, w)?;
            }
            return Ok(());
        }
        self.report.untangled = true;
        let mut by_places = w.to_vec();
        if self.is_mended(weighted, false, &mut by_places)? {
            w.copy_from_slice(&by_places);
        } else {
            self.unfolder().untangled(weighted, false, w)?;
        }
        Ok(())
    }
}

/// Triangles that are inverted or turned away, and triangles around vertices whose angles in the map do not add up to
/// what the field says.
///
/// A triangle counts as turned away if its Jacobian has a trace of at most 0: its lines run backwards though its area
/// is positive. What is at fault here gets stiffer; whether a map is valid is decided by areas and angles alone.
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
        if has_wrong_angle(frames, field, |f| corners[f], v) {
            faults.extend(frames.around(v).map(|h| h / 3));
        }
    }
    faults.sort_unstable();
    faults.dedup();
    faults
}
