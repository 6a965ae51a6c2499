//! From a cross field to an integer-grid map.
//!
//! [`parameterize`] is for callers who want a map or nothing; the ladder of the whole program calls [`parameterized`],
//! which may come back with a decimated map instead, and stops early where that is of no use. Both go through
//! [`Making`]: relaxation, integers, unfolding, and at last the check in [`fixed`].

use geom_core::options::require;
use geom_core::{Point3, Run, TriMesh};

use super::cones::has_wrong_angle;
use super::conformal;
use super::cut::Cut;
use super::exact::{BITS, GridMap, MapReport, fixed, wrong_cones};
use super::integers::{
    AtLeast, Coarse, Energy, MOST_DENSE, Means, Quadratic, Regions, Spread, Upright, cube,
};
use super::spacing::{Chart, Spacing, charts, determinant};
use super::system::{System, Weighted};
use super::transition::Seams;
#[cfg(feature = "testing")]
use super::unfold::{Effort, Ends, monotone};
use super::unfold::{Folded, Unfolder, Unfolding};
use crate::Error;
use crate::backend::{CrossfieldBackend, On};
use crate::field::CrossField;
use crate::field::frames::Frames;

/// Unfolding without integers leaves one in so many parts of the effort.
const RESERVE: u64 = 4;
/// How often conditions for wider handles and necks are added.
const WIDENINGS: usize = 30;

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
/// tries by itself. [`Error::Integers`] for more of these than the work that is left is enough for. [`Error::Option`] names a spacing or
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
    Decimated(Box<Spread>, Error),
    /// A decimated map that is of no use.
    Vain(Box<Spread>),
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
    let (cut, seams, charts) = prepared(mesh, frames, field, options, unfolding.most_dense)?;
    let system = System::new(&cut, &seams, &charts);
    let mut making = Making::new(mesh, frames, field, system, unfolding, run);
    run.progress("map", 0, 3)?;
    // What is upright shall have its integers.
    let reserve = unfolding.effort.share(RESERVE);
    let relaxed = making.relaxed();
    unfolding.effort.give_back(&reserve);
    let mut relaxed = relaxed?;
    run.progress("map", 1, 3)?;
    let Rounded {
        mut w,
        stage,
        spread,
        is_narrow,
    } = making.quantized(&mut relaxed, widening)?;
    run.progress("map", 2, 3)?;
    let may_be_vain = is_narrow && widening.is_some_and(|w| w.may_be_vain);
    let spread = match spread {
        Some(spread) if may_be_vain => return Ok(Laid::Vain(spread)),
        spread => spread,
    };
    // With a decimated map to fall back on, no more than a little.
    let share = unfolding.effort.share(if spread.is_some() { 8 } else { 1 });
    making.unfolding.effort = &share;
    making.unfold(&relaxed.weighted, spread.is_some(), &mut w)?;
    unfolding.effort.give_back(&share);
    making.report.energy = making.system.energy(&making.system.corners(&w));
    match (
        fixed(frames, field, &cut, &seams, &w, stage, making.report),
        spread,
    ) {
        (Ok(map), _) => Ok(Laid::Whole(map)),
        (Err(error), Some(mut spread)) => {
            spread.map.report = MapReport {
                decimated: true,
                ..making.report
            };
            Ok(Laid::Decimated(spread, error))
        }
        (Err(error), None) => Err(error),
    }
}

/// The cut, its conditions and what is wanted in each triangle.
fn prepared(
    mesh: &TriMesh,
    frames: &Frames,
    field: &CrossField,
    options: &MapOptions,
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
    let seams = Seams::of(frames, field, &cut, &lines, most_dense);
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
    let (cut, seams, charts) = prepared(mesh, frames, field, options, MOST_DENSE)?;
    let (effort, ends) = Unfolding::alone(charts.len());
    let unfolding = Unfolding {
        effort: &effort,
        ends: &ends,
        most_dense: MOST_DENSE,
    };
    let system = System::new(&cut, &seams, &charts);
    make(Making::new(mesh, frames, field, system, unfolding, run))
}

/// The triangles that are left of a map without integers when all its regular vertices are taken out; `None` if one of them
/// cannot be.
#[cfg(feature = "testing")]
pub(crate) fn decimated(
    mesh: &TriMesh,
    frames: &Frames,
    field: &CrossField,
    options: &MapOptions,
    run: On<'_>,
) -> Result<Option<usize>, Error> {
    alone(mesh, frames, field, options, run, |mut making| {
        let relaxed = making.relaxed()?;
        Ok(making
            .decimated(&relaxed.corners)
            .map(|coarse| coarse.triangles()))
    })
}

/// The sizes that a map starts to unfold from.
#[cfg(feature = "testing")]
pub(crate) fn sizes(
    mesh: &TriMesh,
    frames: &Frames,
    field: &CrossField,
) -> Result<Vec<f64>, Error> {
    let options = MapOptions {
        spacing: Spacing::Uniform(1.0),
        lines: Vec::new(),
    };
    let (_, _, charts) = prepared(mesh, frames, field, &options, MOST_DENSE)?;
    conformal::scales(&charts, frames, field)
}

/// See `testing::aligned`.
#[cfg(feature = "testing")]
pub(crate) fn aligned(
    mesh: &TriMesh,
    frames: &Frames,
    field: &CrossField,
    options: &MapOptions,
    run: On<'_>,
) -> Result<[usize; 2], Error> {
    alone(mesh, frames, field, options, run, |mut making| {
        let Optimum {
            weighted, mut w, ..
        } = making.optimum()?;
        let left = |w: &[f64]| {
            let corners = making.system.corners(w);
            let all = making.system.charts.iter().zip(&corners);
            all.filter(|(chart, uv)| monotone(chart, uv).0 <= 0.0)
                .count()
        };
        let before = left(&w);
        making.unfolder().align(&weighted, &mut w)?;
        Ok([before, left(&w)])
    })
}

/// See `testing::untangling_cost`.
#[cfg(feature = "testing")]
pub(crate) fn untangling_cost(
    mesh: &TriMesh,
    frames: &Frames,
    field: &CrossField,
    options: &MapOptions,
    run: On<'_>,
) -> Result<Option<f64>, Error> {
    alone(mesh, frames, field, options, run, |mut making| {
        let Optimum {
            weighted, mut w, ..
        } = making.optimum()?;
        let effort = making.unfolding.effort;
        let all = effort.left();
        let is_upright = making.unfolder().untangled(&weighted, true, &mut w)?;
        let spent = (all - effort.left()) as f64 / making.system.charts.len() as f64;
        Ok(is_upright.then_some(spent))
    })
}

/// See `testing::parameterized_within`.
#[cfg(feature = "testing")]
pub(crate) fn parameterized_within(
    evaluations: u64,
    mesh: &TriMesh,
    frames: &Frames,
    field: &CrossField,
    options: &MapOptions,
    run: On<'_>,
) -> Result<(), Error> {
    let (effort, ends) = Unfolding::alone(mesh.triangles().len());
    effort.spend((effort.left() - evaluations) as usize);
    let unfolding = Unfolding {
        effort: &effort,
        ends: &ends,
        most_dense: MOST_DENSE,
    };
    parameterized(mesh, frames, field, options, unfolding, None, run).map(drop)
}

/// What each of several maps of a field costs to unfold without integers, in evaluations of all triangles; `None` for one that
/// stays folded.
#[cfg(feature = "testing")]
pub(crate) fn unfolding_costs(
    mesh: &TriMesh,
    frames: &Frames,
    field: &CrossField,
    options: &[MapOptions],
    run: On<'_>,
) -> Result<Vec<Option<f64>>, Error> {
    let ends = Ends::default();
    let of = |options: &MapOptions| {
        let (cut, seams, charts) = prepared(mesh, frames, field, options, MOST_DENSE)?;
        let effort = Effort::of(charts.len());
        let unfolding = Unfolding {
            effort: &effort,
            ends: &ends,
            most_dense: MOST_DENSE,
        };
        let all = effort.left();
        let system = System::new(&cut, &seams, &charts);
        match Making::new(mesh, frames, field, system, unfolding, run).relaxed() {
            Ok(_) => Ok(Some((all - effort.left()) as f64 / charts.len() as f64)),
            Err(Error::Folded { .. }) => Ok(None),
            Err(error) => Err(error),
        }
    };
    options.iter().map(of).collect()
}

/// What is made of a field's integers, for tests.
#[cfg(feature = "testing")]
pub struct OfIntegers {
    /// How much more energy than the best map with real numbers that with rounded ones has, by the Schur complement.
    pub by_schur: f64,
    /// The same measured on the two maps.
    pub measured: f64,
    /// What would keep the sides of the decimated map from turning: their sums at the real minimum, where none has turned.
    pub unturned: Vec<f64>,
}

/// See [`OfIntegers`]; of a map that does not fold.
#[cfg(feature = "testing")]
pub(crate) fn of_integers(
    mesh: &TriMesh,
    frames: &Frames,
    field: &CrossField,
    options: &MapOptions,
    run: On<'_>,
) -> Result<OfIntegers, Error> {
    alone(mesh, frames, field, options, run, |mut making| {
        let Optimum {
            mut weighted,
            w,
            corners,
        } = making.optimum()?;
        let System { seams, charts, .. } = making.system;
        let quadratic = making.quadratic(&mut weighted, &w)?;
        let z = (&quadratic as &dyn Energy).rounded(run)?;
        let energy = |corners: &[[[f64; 2]; 3]]| making.system.energy(corners) / 2.0;
        let rounded = making.system.corners(&weighted.values_for(&z)?);
        let real = &w[seams.reals..seams.unknowns()];
        let coarse = making.decimated(&corners);
        let judged = coarse.and_then(|coarse| making.judged(&coarse, &z, &corners));
        let all: Vec<usize> = (0..frames.edges().vertices()).collect();
        let unturned = judged.map_or(Vec::new(), |(spread, _)| spread.unturned(&all));
        Ok(OfIntegers {
            by_schur: quadratic.above(&z) / charts.len() as f64,
            measured: energy(&rounded) - energy(&corners),
            unturned: unturned.iter().map(|side| side.value(real)).collect(),
        })
    })
}

/// What the best map without integers is like, folded or not.
pub(crate) struct Relaxation {
    /// `[h_u ∇u; h_v ∇v]` of each triangle in the basis of the field's arms, up to quarter turns of both.
    pub(crate) jacobians: Vec<[[f64; 2]; 2]>,
    /// Triangles inverted, turned away from the field or at a wrong angle.
    pub(crate) faults: usize,
    /// Mean of `|J − 1|²` over the area.
    pub(crate) energy: f64,
}

/// The optimum of Eq. 4.10 with real numbers in place of integers.
pub(crate) fn relaxation(
    mesh: &TriMesh,
    frames: &Frames,
    field: &CrossField,
    options: &MapOptions,
    run: On<'_>,
) -> Result<Relaxation, Error> {
    alone(mesh, frames, field, options, run, |mut making| {
        let Optimum { corners, .. } = making.optimum()?;
        let of = |(chart, uv): (&Chart, &[[f64; 2]; 3])| chart.jacobian(uv);
        Ok(Relaxation {
            jacobians: making.system.charts.iter().zip(&corners).map(of).collect(),
            faults: making.report.relaxed_folded,
            energy: making.report.relaxed_energy,
        })
    })
}

/// Integers, and the real numbers that follow them.
struct Rounded {
    /// All values.
    w: Vec<f64>,
    /// What to say if the map folds.
    stage: &'static str,
    /// The decimated map with them, where one was needed and turns right around all vertices.
    spread: Option<Box<Spread>>,
    /// Are its quads no mesh?
    is_narrow: bool,
}

/// Integers that make handles and necks wider.
struct Widened {
    z: Vec<f64>,
    spread: Option<Box<Spread>>,
    is_narrow: bool,
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

/// The best map with real numbers in place of integers, folded or not.
struct Optimum<'a> {
    weighted: Weighted<'a>,
    w: Vec<f64>,
    corners: Vec<[[f64; 2]; 3]>,
}

/// The best map without integers.
struct Relaxed<'a> {
    weighted: Weighted<'a>,
    w: Vec<f64>,
    corners: Vec<[[f64; 2]; 3]>,
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

    fn means(&self) -> Means<'_> {
        Means {
            effort: self.unfolding.effort,
            run: self.run,
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

    /// The optimum of Eq. 4.10 with real numbers in place of integers.
    ///
    /// One sparse factorization and a few substitutions.
    fn optimum(&mut self) -> Result<Optimum<'a>, Error> {
        let weighted = self.system.weighted(&self.weights)?;
        let w = weighted.optimum()?;
        let corners = self.system.corners(&w);
        self.report.relaxed_energy = self.system.energy(&corners);
        self.report.relaxed_folded = self.faults(&corners).len();
        Ok(Optimum {
            weighted,
            w,
            corners,
        })
    }

    /// The optimum, unfolded where it folds: no rounding could mend that, and the integers of a folded map are wrong ones.
    ///
    /// From where the last map of the same field ended, if there was one, else from the optimum. What is still folded
    /// then is an error that no other spacing would mend; where it is so is left for those who have finer triangles.
    fn relaxed(&mut self) -> Result<Relaxed<'a>, Error> {
        let start = self.unfolding.ends.folded.take();
        let is_resumed = start.is_some();
        if let Some(Folded { jacobians, .. }) = start {
            // The optimum of what the last map is wanted to be is that map.
            self.system.wanted = self.combed(&jacobians);
        }
        let optimum = self.optimum()?;
        if is_resumed {
            self.system.wanted.fill([[1.0, 0.0], [0.0, 1.0]]);
            self.report.relaxed_energy = self.system.energy(&optimum.corners);
        }
        if self.report.relaxed_folded == 0 {
            return Ok(Relaxed {
                weighted: optimum.weighted,
                w: optimum.w,
                corners: optimum.corners,
            });
        }
        let w = self.unfolded_optimum(optimum, is_resumed)?;
        let corners = self.system.corners(&w);
        let (triangles, cones) = self.unfolder().invalid(&corners);
        if triangles + cones > 0 {
            self.leave_folded(&corners);
            return Err(Error::Folded {
                triangles,
                cones,
                stage: "unfolding",
                relaxed: true,
            });
        }
        self.unfolding.ends.upright.replace(Some(w.clone()));
        // Rounding starts from here, and has to keep what unfolding has reached.
        self.want(&corners);
        Ok(Relaxed {
            weighted: self.system.weighted(&self.weights)?,
            w,
            corners,
        })
    }

    /// Leaves a map that has stayed folded for those who have finer triangles.
    fn leave_folded(&self, corners: &[[[f64; 2]; 3]]) {
        let all = self.system.charts.iter().zip(corners);
        let jacobians: Vec<_> = all.map(|(chart, uv)| chart.jacobian(uv)).collect();
        self.unfolding.ends.folded.replace(Some(Folded {
            jacobians: self.combed(&jacobians),
            vertices: self.unfolder().bad(corners),
        }));
    }

    /// Jacobians in the basis of the chosen arms for those in the basis of the field's, or the other way around: quarter turns
    /// of both bases, of which two are none.
    fn combed(&self, jacobians: &[[[f64; 2]; 2]]) -> Vec<[[f64; 2]; 2]> {
        let of = |(&[[a, b], [c, d]], comb): (&[[f64; 2]; 2], &u8)| match comb % 2 {
            0 => [[a, b], [c, d]],
            _ => [[d, -c], [-b, a]],
        };
        jacobians
            .iter()
            .zip(&self.system.cut.comb)
            .map(of)
            .collect()
    }

    /// The unknowns of an unfolded map without integers that has as many quads as asked for. One that is resumed folds in few places.
    fn unfolded_optimum(
        &mut self,
        optimum: Optimum<'a>,
        is_resumed: bool,
    ) -> Result<Vec<f64>, Error> {
        let Optimum {
            mut weighted,
            mut w,
            ..
        } = optimum;
        // Unfolding place by place does without its factor, and the next ones are as large.
        weighted.forget_free();
        if is_resumed {
            self.unfolder().mended(&weighted, true, &mut w)?;
            return Ok(self.sized(w));
        }
        // A map upright at one spacing is so at any, and only has to settle.
        let last = self.unfolding.ends.upright.take().map(|w| self.sized(w));
        if let Some(mut last) = last.filter(|w| self.unfolder().is_valid(w))
            && self.unfolder().untangled(&weighted, true, &mut last)?
        {
            return Ok(self.sized(last));
        }
        // Where triangles may be of the sizes that the cones ask for, few fold.
        match self.conformal_optimum() {
            Ok(of_cones) => w = of_cones,
            // Needles may be beyond the digits of their cotangents.
            Err(Error::Matrix(_)) => {}
            Err(error) => return Err(error),
        }
        // A convex problem turns most of these upright, and the rest unfolds where it is.
        self.unfolder().align(&weighted, &mut w)?;
        if !self.is_mended(&weighted, true, &mut w)? {
            self.unfolder().untangled(&weighted, true, &mut w)?;
        }
        Ok(self.sized(w))
    }

    /// Unfolds place by place, for half of the effort that is left; is the map upright now?
    fn is_mended(
        &self,
        weighted: &Weighted<'_>,
        with_integers: bool,
        w: &mut [f64],
    ) -> Result<bool, Error> {
        let reserve = self.unfolding.effort.share(2);
        let is_upright = self.unfolder().mended(weighted, with_integers, w);
        self.unfolding.effort.give_back(&reserve);
        is_upright
    }

    /// The optimum for triangles of the sizes that the field's cones ask for.
    fn conformal_optimum(&mut self) -> Result<Vec<f64>, Error> {
        let charts = self.system.charts;
        let scales = conformal::scales(charts, self.frames, self.field)?;
        // Errors count in what is wanted there.
        let weights = scales.iter().map(|s| (s * s).recip()).collect();
        let sizes = scales.iter().map(|&s| [[s, 0.0], [0.0, s]]).collect();
        let of_field = std::mem::replace(&mut self.system.wanted, sizes);
        let w = self.least_folded(weights);
        self.system.wanted = of_field;
        Ok(self.sized(w?))
    }

    /// The optimum with these weights, or with more of them around what folds, if less of it does then.
    fn least_folded(&self, mut weights: Vec<f64>) -> Result<Vec<f64>, Error> {
        const STIFFER: f64 = 4.0;
        let first = self.system.weighted(&weights)?.optimum()?;
        let bad = self.unfolder().bad(&self.system.corners(&first));
        if bad.is_empty() {
            return Ok(first);
        }
        let near = self.frames.within(&bad, 1);
        for (f, weight) in weights.iter_mut().enumerate() {
            if (3 * f..3 * f + 3).any(|h| near[self.frames.from(h)]) {
                *weight *= STIFFER;
            }
        }
        let second = self.system.weighted(&weights)?.optimum()?;
        let left = self.unfolder().bad(&self.system.corners(&second));
        Ok(if left.len() < bad.len() {
            second
        } else {
            first
        })
    }

    /// The same map at the size that has as many quads as asked for.
    fn sized(&self, mut w: Vec<f64>) -> Vec<f64> {
        let all = self.system.charts.iter().zip(self.system.corners(&w));
        let area: f64 = all
            .map(|(chart, uv)| chart.area * chart.determinant(&uv))
            .sum();
        if area > 0.0 {
            let scale = (self.system.charts.len() as f64 / area).sqrt();
            w.iter_mut().for_each(|w| *w *= scale);
        }
        w
    }

    /// Makes a map the optimum: its gradients are wanted in place of the field's, the more strictly the narrower it is.
    ///
    /// A second optimum with the old wishes would fold again. The weights are those under which the smaller singular
    /// value counts relative to itself: where lines are close together in the unfolded map, rounding has to leave them
    /// so.
    fn want(&mut self, corners: &[[[f64; 2]; 3]]) {
        const MOST: f64 = 100.0;
        for (f, uv) in corners.iter().enumerate() {
            let j = self.system.charts[f].jacobian(uv);
            self.system.wanted[f] = j;
            let [_, least] = singular_values(&j);
            self.weights[f] = (least * least).recip().clamp(1.0, MOST);
        }
    }

    /// Integers and the reals that follow them. Where rounding lays singular vertices onto each other, other integers are
    /// found, on a denser grid if need be and brought back, that hold the decimated map upright.
    ///
    /// Three outcomes: the rounded integers, where nothing folds, or the decimated map is upright with them, or there is no
    /// decimated map to judge them by; those found under the conditions of the decimated map; and an error, if there are
    /// none on denser grids either. The first two are made wider where quads would meet themselves, if asked for.
    fn quantized(
        &mut self,
        relaxed: &mut Relaxed<'a>,
        widening: Option<Widening<'_>>,
    ) -> Result<Rounded, Error> {
        let Relaxed {
            weighted,
            w,
            corners,
        } = relaxed;
        let energy = self.energy_of_integers(weighted, w)?;
        let rounded = energy.rounded(self.run)?;
        let direct = Rounded {
            w: weighted.values_for(&rounded)?,
            stage: "rounding",
            spread: None,
            is_narrow: false,
        };
        if self.faults(&self.system.corners(&direct.w)).is_empty() {
            return Ok(direct);
        }
        // Whether integers can hold the map upright is said by the few triangles between singular vertices.
        let decimated = self
            .decimated(corners)
            .and_then(|coarse| coarse.upright().map(|upright| (coarse, upright)));
        let Some((coarse, mut upright)) = decimated else {
            let stage = "rounding without a decimated map";
            return Ok(Rounded { stage, ..direct });
        };
        // Those at hand may do, with the reals of other places; else others are looked for.
        let mut z = rounded;
        let turned = |z: &[f64]| self.turned(&coarse, z, corners);
        if !upright.holds(&z) || turned(&z).is_some_and(|wrong| !wrong.is_empty()) {
            let other = energy.rounded_within(&mut upright, &turned, self.means())?;
            let Some(other) = other else {
                // No real numbers can mend what the integers fold.
                let (triangles, cones) = self.unfolder().invalid(&self.system.corners(&direct.w));
                return Err(Error::Folded {
                    triangles,
                    cones,
                    stage: "rounding, on denser grids too",
                    relaxed: false,
                });
            };
            self.report.respaced = true;
            z = other;
        }
        // Only upright integers say around what quads would meet themselves.
        let narrow = widening.map(|w| w.narrow);
        let Widened {
            z: wider,
            mut spread,
            is_narrow,
        } = self.widened(&coarse, upright, &z, &*energy, corners, narrow)?;
        self.report.respaced |= wider != z;
        if let Some(spread) = &mut spread {
            spread.map.report = self.report;
        }
        Ok(Rounded {
            w: weighted.values_for(&wider)?,
            stage: match self.report.respaced {
                true => "rounding to other integers",
                false => "rounding",
            },
            spread,
            is_narrow,
        })
    }

    /// The triangles between singular vertices and corners, of a map without integers.
    fn decimated(&self, corners: &[[[f64; 2]; 3]]) -> Option<Coarse> {
        let System { cut, seams, .. } = self.system;
        Coarse::of(self.frames, self.field, cut, seams, corners)
    }

    /// What is known of the energy over the integers alone, around its minimum: all of it by dense matrices, n² numbers and n³ operations
    /// for n integers, or what rounding region by region takes. They are about twice as many as the singular vertices, and four for each
    /// handle.
    fn energy_of_integers(
        &self,
        weighted: &mut Weighted<'_>,
        w: &[f64],
    ) -> Result<Box<dyn Energy>, Error> {
        /// What a sparse factor costs, in evaluations of the energy of all triangles.
        const FACTOR: usize = 20;
        let integers = self.system.seams.integers;
        let most_dense = self.unfolding.most_dense;
        let regions = integers.div_ceil(most_dense.max(1));
        let is_dense = integers <= most_dense;
        // Asked for before it is begun.
        let cost = match is_dense {
            true => cube(integers),
            false => regions * (cube(most_dense) + FACTOR * self.system.charts.len()),
        };
        if !self.unfolding.effort.spend(cost) {
            return Err(Error::Integers { integers });
        }
        if is_dense {
            let quadratic = self.quadratic(weighted, w)?;
            return Ok(Box::new(quadratic));
        }
        weighted.forget_free();
        let regions = Regions::of(weighted, &self.homes(), most_dense, self.run)?;
        Ok(Box::new(regions))
    }

    /// Where each integer is at home on the surface: of the places whose coordinates it is a part of, one with the fewest others.
    fn homes(&self) -> Vec<Point3> {
        let System { cut, seams, .. } = self.system;
        let positions = self.mesh.positions();
        let mut homes = vec![(usize::MAX, positions[0]); seams.integers];
        for (copy, &vertex) in cut.vertex.iter().enumerate() {
            for component in [0, 1] {
                let terms = seams.integers_of(copy as u32, component);
                let terms = seams.written_out(&terms);
                for &k in terms.keys() {
                    if terms.len() < homes[k as usize].0 {
                        homes[k as usize] = (terms.len(), positions[vertex as usize]);
                    }
                }
            }
        }
        homes.into_iter().map(|home| home.1).collect()
    }

    /// The energy as a function of the integers alone, from its minimum.
    fn quadratic(&self, weighted: &mut Weighted<'_>, w: &[f64]) -> Result<Quadratic, Error> {
        let seams = self.system.seams;
        let relaxed = &w[seams.reals..seams.unknowns()];
        let indefinite = geom_core::algebra::Error::NotPositiveDefinite { row: 0 };
        let inverse = weighted.inverse_schur()?;
        // The factor in which they move is large, and has done its part.
        weighted.forget_free();
        Ok(Quadratic::new(inverse, relaxed).ok_or(indefinite)?)
    }

    /// Makes handles and necks wider where quads would meet themselves around them: each is a condition more on the integers.
    fn widened(
        &self,
        coarse: &Coarse,
        mut upright: Upright,
        z: &[f64],
        energy: &dyn Energy,
        corners: &[[[f64; 2]; 3]],
        narrow: Option<&dyn Fn(&Spread) -> Narrow>,
    ) -> Result<Widened, Error> {
        let spread = |z: &[f64]| self.spread(coarse, z, corners).map(Box::new);
        let mut now = Widened {
            z: z.to_vec(),
            spread: spread(z),
            is_narrow: false,
        };
        for round in 0..=WIDENINGS {
            let (Some(narrow), Some(last)) = (narrow, &now.spread) else {
                break;
            };
            let found = narrow(last);
            now.is_narrow = found.anywhere;
            if found.wider.is_empty() || round == WIDENINGS {
                break;
            }
            upright.add(&found.wider);
            let turned = |z: &[f64]| self.turned(coarse, z, corners);
            let Some(z) = energy.mended(&now.z, &mut upright, &turned, self.means())? else {
                break;
            };
            let Some(wider) = spread(&z) else {
                break;
            };
            (now.z, now.spread) = (z, Some(wider));
        }
        Ok(now)
    }

    /// The decimated map with these integers; `None` where the angles around a vertex are wrong with them.
    fn spread(&self, coarse: &Coarse, z: &[f64], corners: &[[[f64; 2]; 3]]) -> Option<Spread> {
        let (spread, wrong) = self.judged(coarse, z, corners)?;
        wrong.is_empty().then_some(spread)
    }

    /// What would keep the triangles around vertices from turning as far as these integers turn them.
    fn turned(
        &self,
        coarse: &Coarse,
        z: &[f64],
        corners: &[[[f64; 2]; 3]],
    ) -> Option<Vec<AtLeast>> {
        let (spread, wrong) = self.judged(coarse, z, corners)?;
        Some(spread.unturned(&wrong))
    }

    /// The decimated map with these integers, and the vertices around which it turns wrong.
    fn judged(
        &self,
        coarse: &Coarse,
        z: &[f64],
        corners: &[[[f64; 2]; 3]],
    ) -> Option<(Spread, Vec<usize>)> {
        let turn = self.system.cut.turn.clone();
        let spread = coarse.spread(z, BITS, corners.to_vec(), turn, self.report)?;
        let wrong = wrong_cones(&spread.net, &self.field.index, &spread.map);
        Some((spread, wrong))
    }

    /// Unfolds place by place, the integers held; then as a whole, unless there is a decimated map to fall back on: what folds in
    /// no place of its own is rarely worth what that takes.
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
        self.report.untangled = true;
        if may_fall_back {
            self.unfolder().mended(weighted, false, w)?;
            return Ok(());
        }
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

/// The larger and the smaller.
/// Both are 0 or more, their product is |det J|.
fn singular_values(j: &[[f64; 2]; 2]) -> [f64; 2] {
    let sum = j.iter().flatten().map(|x| x * x).sum::<f64>();
    let determinant = determinant(j);
    let root = (sum * sum - 4.0 * determinant * determinant)
        .max(0.0)
        .sqrt();
    [
        ((sum + root) / 2.0).sqrt(),
        ((sum - root).max(0.0) / 2.0).sqrt(),
    ]
}
