//! What tests look at in the middle of a map's making.

use geom_core::TriMesh;

use super::relaxed::Optimum;
use super::{Making, MapOptions, alone, parameterized, prepared};
use crate::Error;
use crate::backend::On;
use crate::field::CrossField;
use crate::field::frames::Frames;
use crate::map::conformal;
use crate::map::integers::{Energy, MOST_DENSE};
use crate::map::spacing::Spacing;
use crate::map::system::System;
use crate::map::unfold::{Effort, Ends, Unfolding, monotone};

/// The triangles that are left of a map without integers when all its regular vertices are taken out; `None` if one of them
/// cannot be, or a corner that stays is no integer.
pub(crate) fn decimated(
    mesh: &TriMesh,
    frames: &Frames,
    field: &CrossField,
    options: &MapOptions,
    run: On<'_>,
) -> Result<Option<usize>, Error> {
    alone(mesh, frames, field, options, run, |mut making| {
        let relaxed = making.relaxed()?;
        let decimated = making.decimated(relaxed.corners);
        Ok(decimated.map(|decimated| decimated.triangles()))
    })
}

/// The sizes that a map starts to unfold from.
pub(crate) fn sizes(
    mesh: &TriMesh,
    frames: &Frames,
    field: &CrossField,
) -> Result<Vec<f64>, Error> {
    let options = MapOptions {
        spacing: Spacing::Uniform(1.0),
        lines: Vec::new(),
    };
    let (_, _, charts) = prepared(mesh, frames, field, &options, Vec::new(), MOST_DENSE)?;
    conformal::scales(&charts, frames, field)
}

/// See `testing::aligned`.
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

/// See [`Unfolded`]: of so many rings around what the best map without integers folds.
pub(crate) fn unfolded_places(
    rings: usize,
    mesh: &TriMesh,
    frames: &Frames,
    field: &CrossField,
    options: &MapOptions,
    run: On<'_>,
) -> Result<Unfolded, Error> {
    alone(mesh, frames, field, options, run, |mut making| {
        let Optimum { w, corners, .. } = making.optimum()?;
        let unfolder = making.unfolder();
        let places = unfolder.places(&unfolder.bad(&corners), rings);
        let (mut together, mut in_turn) = (w.clone(), w.clone());
        unfolder.unfold_places(&places, &[], &mut together)?;
        for place in &places {
            unfolder.unfold_places(std::slice::from_ref(place), &[], &mut in_turn)?;
        }
        Ok(Unfolded {
            places: places.len(),
            folded: [&w, &together].map(|w| unfolder.bad(&making.system.corners(w)).len()),
            together,
            in_turn,
        })
    })
}

/// See [`Settled`]: of a map between the best one without integers and what it unfolds to, as near to the first as triangles are
/// barely upright; `None` where there is none. It may cost so many evaluations of each triangle.
pub(crate) fn settled(
    evaluations: usize,
    mesh: &TriMesh,
    frames: &Frames,
    field: &CrossField,
    options: &MapOptions,
    run: On<'_>,
) -> Result<Option<Settled>, Error> {
    const FLAT: f64 = 0.005;
    alone(mesh, frames, field, options, run, |mut making| {
        let Optimum {
            weighted,
            w: folded,
            ..
        } = making.optimum()?;
        let (unfolder, effort) = (making.unfolder(), making.unfolding.effort);
        let least = |w: &[f64]| {
            let corners = making.system.corners(w);
            let all = making.system.charts.iter().zip(&corners);
            all.map(|(chart, uv)| chart.determinant(uv))
                .fold(f64::INFINITY, f64::min)
        };
        let mut upright = folded.clone();
        if least(&folded) > 0.0 || !unfolder.untangled(&weighted, true, &mut upright)? {
            return Ok(None);
        }
        let between = |t: f64| -> Vec<f64> {
            let pairs = upright.iter().zip(&folded);
            pairs.map(|(u, f)| u + t * (f - u)).collect()
        };
        let (mut low, mut high) = (0.0, 1.0);
        for _ in 0..40 {
            let t = 0.5 * (low + high);
            let is_upright = least(&between(t)) > FLAT;
            *(if is_upright { &mut low } else { &mut high }) = t;
        }
        let mut w = between(low);
        if !unfolder.is_valid(&w) {
            return Ok(None);
        }
        let before = least(&w);
        let worth = evaluations * making.system.charts.len();
        effort.spend(effort.left() as usize - worth);
        unfolder.settle(&weighted, true, &mut w)?;
        Ok(Some(Settled {
            least: [before, least(&w)],
            is_valid: unfolder.is_valid(&w),
        }))
    })
}

/// See `testing::parameterized_within`.
pub(crate) fn parameterized_within(
    evaluations: [u64; 2],
    mesh: &TriMesh,
    frames: &Frames,
    field: &CrossField,
    options: &MapOptions,
    run: On<'_>,
) -> Result<(), Error> {
    let (effort, ends) = Unfolding::alone(mesh.triangles().len());
    for (effort, evaluations) in [&effort, &ends.integers].into_iter().zip(evaluations) {
        effort.spend(effort.left().saturating_sub(evaluations) as usize);
    }
    let unfolding = Unfolding {
        effort: &effort,
        ends: &ends,
        most_dense: MOST_DENSE,
    };
    parameterized(mesh, frames, field, options, unfolding, None, run).map(drop)
}

/// What became of an upright map with a triangle that is nearly flat, for tests.
#[derive(Debug)]
pub struct Settled {
    /// The smallest determinant before and after.
    pub least: [f64; 2],
    /// Is it upright, with the field's angles?
    pub is_valid: bool,
}

/// A map whose folded places were unfolded, for tests.
#[derive(Debug, PartialEq)]
pub struct Unfolded {
    /// How many places there are.
    pub places: usize,
    /// Vertices that are not right before and after.
    pub folded: [usize; 2],
    /// With all at once,
    pub together: Vec<f64>,
    /// and one after the other.
    pub in_turn: Vec<f64>,
}

/// What each of several maps of a field costs to unfold without integers, in evaluations of all triangles; `None` for one that
/// stays folded.
pub(crate) fn unfolding_costs(
    mesh: &TriMesh,
    frames: &Frames,
    field: &CrossField,
    options: &[MapOptions],
    run: On<'_>,
) -> Result<Vec<Option<f64>>, Error> {
    let ends = Ends::of(mesh.triangles().len());
    let of = |options: &MapOptions| {
        let (cut, seams, charts) = prepared(mesh, frames, field, options, Vec::new(), MOST_DENSE)?;
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
pub struct OfIntegers {
    /// How much more energy than the best map with real numbers that with rounded ones has, by the Schur complement.
    pub by_schur: f64,
    /// The same measured on the two maps.
    pub measured: f64,
    /// What would keep the sides of the decimated map from turning: their sums at the real minimum, where none has turned.
    pub unturned: Vec<f64>,
    /// Is the matrix to the bit that of a list of what the triangles contribute?
    pub is_that_of_a_list: bool,
}

/// See [`OfIntegers`]; of a map that does not fold.
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
        let measured = energy(&rounded) - energy(&corners);
        let all: Vec<usize> = (0..frames.edges().vertices()).collect();
        let decimated = making.decimated(corners);
        let unturned = decimated.map_or(Vec::new(), |decimated| decimated.unturned(&all));
        Ok(OfIntegers {
            by_schur: quadratic.above(&z) / charts.len() as f64,
            measured,
            is_that_of_a_list: making.system.is_that_of_a_list()?,
            unturned: unturned.iter().map(|side| side.value(real)).collect(),
        })
    })
}
