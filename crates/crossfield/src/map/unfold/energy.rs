//! What is minimized of a part of a map, and its slopes.

use geom_core::compute::lists::Lists;
use geom_core::compute::{BackendError, parallel};

use super::monotone::shortage;
use super::scope::Scope;
use crate::Error;
use crate::backend::{ChartDistortion, CrossfieldBackend, On};
use crate::map::spacing::Chart;
use crate::map::system::System;
use crate::specification::chart_distortion;

/// The least area that counts, in units of the mean.
const LEAST_AREA: f64 = 0.25;
/// The smallest regularization: determinants below it are as good as none.
pub(super) const LEAST: f64 = 1e-6;

/// What triangles shall be.
#[derive(Clone, Copy)]
pub(super) enum Wish {
    /// Upright, and as little distorted as they can be, for an ε.
    Upright(f64),
    /// Monotone.
    Monotone,
}

/// The energy of the triangles of a scope as a function of the values that move. Its memory is used again: it is asked
/// hundreds of times.
pub(super) struct Energy<'a> {
    system: &'a System<'a>,
    scope: &'a Scope,
    /// Of the triangles of the scope, with areas raised to [`LEAST_AREA`], unlike those of the system.
    charts: Vec<Chart>,
    backend: &'a (dyn CrossfieldBackend + 'a),
    /// All values: those that do not move as they are, the others as they were asked for last.
    w: &'a mut [f64],
    /// Places of held triangles among those of the scope. Their distortion is always taken with the smallest ε, whose barrier
    /// is too high for any step to cross, and on the CPU, whatever the backend: in f32 the barrier would have holes.
    held: Vec<usize>,
    /// What is asked of them in this round.
    pub(super) wish: Wish,
    /// Where the copies are, and the corners of the triangles.
    places: Vec<[f64; 2]>,
    corners: Vec<[[f64; 2]; 3]>,
    /// What the last evaluation found, per triangle, and per copy.
    out: Vec<ChartDistortion>,
    slopes: Vec<[f64; 2]>,
    /// Per copy the corners that it is at, as `3 · triangle + corner`.
    at_corners: Lists<u32>,
    /// Per value that moves the coordinates that hang on it, as `2 · copy + component`, and how often.
    in_rows: Lists<(u32, i32)>,
}

impl<'a> Energy<'a> {
    /// Of a scope, with `held` triangles of the system, ascending, among its own.
    pub(super) fn new(
        system: &'a System<'a>,
        scope: &'a Scope,
        held: &[usize],
        w: &'a mut [f64],
        run: On<'a>,
    ) -> Self {
        // A triangle hardly there shall not stay folded because it counts for nothing.
        let charts = scope.faces.iter().map(|&f| {
            let chart = system.charts[f];
            let area = chart.area.max(LEAST_AREA);
            Chart { area, ..chart }
        });
        let is_held = |f: &usize| held.binary_search(f).is_ok();
        let faces = scope.faces.iter().enumerate();
        let corners = || scope.corners.as_flattened().iter().copied().zip(0..);
        let values = w.len();
        let place = scope.places(values);
        let moved = match scope.moves_integers {
            true => values,
            false => scope.unknowns.len(),
        };
        let copies = scope.copies.iter().copied();
        Self {
            system,
            scope,
            charts: charts.collect(),
            backend: run.backend,
            w,
            held: faces.filter(|(_, f)| is_held(f)).map(|(k, _)| k).collect(),
            wish: Wish::Upright(0.0),
            places: vec![[0.0; 2]; scope.copies.len()],
            corners: vec![[[0.0; 2]; 3]; scope.corners.len()],
            out: Vec::new(),
            slopes: vec![[0.0; 2]; scope.copies.len()],
            at_corners: Lists::of(scope.copies.len(), corners),
            in_rows: system.seams.by_value(copies, |k| place[k], moved),
        }
    }

    /// Triangles of the scope.
    pub(super) fn triangles(&self) -> usize {
        self.charts.len()
    }

    /// All values, with these of the scope.
    pub(super) fn all(&mut self, x: &[f64]) -> &[f64] {
        self.scope.put(x, self.w);
        if self.scope.moves_integers {
            self.system.seams.add_up(self.w);
        }
        self.w
    }

    /// Puts the corners of the triangles of the scope where these values have them.
    fn lay(&mut self, x: &[f64]) {
        self.all(x);
        let (seams, scope, w) = (self.system.seams, self.scope, &*self.w);
        parallel::for_each(&mut self.places, |c, place| {
            *place = seams.copy(w, scope.copies[c]);
        });
        let places = &self.places;
        parallel::for_each(&mut self.corners, |t, corners| {
            *corners = scope.corners[t].map(|c| places[c as usize]);
        });
    }

    /// Distortions at x, from the backend, which must answer one per triangle. What falls short of monotone is measured
    /// here: backends owe distortions alone.
    fn evaluate(&mut self, x: &[f64]) -> Result<(), Error> {
        self.lay(x);
        let (charts, corners) = (&self.charts, &self.corners);
        let Wish::Upright(epsilon) = self.wish else {
            self.out.resize(charts.len(), ChartDistortion::default());
            parallel::for_each(&mut self.out, |t, out| {
                *out = shortage(&charts[t], &corners[t])
            });
            return Ok(());
        };
        self.backend
            .chart_distortion(charts, corners, epsilon, &mut self.out)?;
        let (found, of) = (self.out.len(), corners.len());
        BackendError::unless(found == of, &self.backend.name(), || {
            format!("{found} distortions for {of} triangles")
        })?;
        for &f in &self.held {
            self.out[f] = chart_distortion(&charts[f], &corners[f], LEAST);
        }
        Ok(())
    }

    /// Triangles that are not as they shall be.
    pub(super) fn count_not(
        &mut self,
        x: &[f64],
        is: impl Fn(&Chart, &[[f64; 2]; 3]) -> bool,
    ) -> usize {
        self.lay(x);
        let all = self.charts.iter().zip(&self.corners);
        all.filter(|(chart, uv)| !is(chart, uv)).count()
    }

    /// The smallest determinant.
    pub(super) fn worst(&mut self, x: &[f64]) -> f64 {
        self.lay(x);
        let all = self.charts.iter().zip(&self.corners);
        all.map(|(chart, uv)| chart.determinant(uv))
            .fold(f64::INFINITY, f64::min)
    }

    /// Energy and gradient with respect to the unknowns that move: from triangles to copies, from there to values, from sums of
    /// integers to these.
    pub(super) fn gradient(&mut self, x: &[f64]) -> Result<(f64, Vec<f64>), Error> {
        self.evaluate(x)?;
        let (out, at_corners, in_rows) = (&self.out, &self.at_corners, &self.in_rows);
        let value = parallel::sum(out.len(), |t| out[t].energy);
        parallel::for_each(&mut self.slopes, |copy, sum| {
            *sum = at_corners.list(copy).iter().fold([0.0; 2], |sum, &at| {
                let slope = out[at as usize / 3].gradient[at as usize % 3];
                [sum[0] + slope[0], sum[1] + slope[1]]
            });
        });
        let slopes = self.slopes.as_flattened();
        let mut gradient = vec![0.0; in_rows.count()];
        parallel::for_each(&mut gradient, |k, sum| {
            let rows = in_rows.list(k).iter();
            let slopes = rows.map(|&(at, p)| f64::from(p) * slopes[at as usize]);
            *sum = slopes.sum();
        });
        if self.scope.moves_integers {
            self.system.seams.fold(&mut gradient);
        }
        Ok((value, gradient))
    }
}
