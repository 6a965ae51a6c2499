//! Unfolding of a map.
//!
//! The energy of Eq. 4.10 does not know that a triangle is upside down: its determinant may change sign at a finite cost.
//! Here the distortion of a triangle with Jacobian J is `(|J|² + λ (det² + 1)) / 2 det`, which is infinite where det J = 0, so that
//! no step leads from upright to folded. To get *into* the upright region from outside, det is replaced by
//! `χ = (det + √(ε² + det²)) / 2`, which is positive everywhere, close to det above ε and close to 0 below −ε. With ε large a
//! folded triangle costs little; as ε falls, unfolding it is what pays (Garanzha et al., 2021).

use std::cell::{Cell, RefCell};

use geom_core::Cancelled;
use geom_core::compute::BackendError;

use super::scope::Scope;
use crate::Error;
use crate::backend::{ChartDistortion, CrossfieldBackend, On};
use crate::map::spacing::Chart;
use crate::map::system::System;
use crate::specification::chart_distortion;

/// Steps remembered by the minimizer.
const HISTORY: usize = 10;
/// Steps per regularization.
const STEPS: usize = 30;
/// Regularizations.
const ROUNDS: usize = 60;
/// A folded map stays so when its worst triangle is not better after so many.
const STALLED: usize = 20;
/// Below this ε upright triangles do not fold again: the mean determinant is 1.
const FIRM: f64 = 1.0;
/// The smallest regularization: determinants below it are as good as none.
const LEAST: f64 = 1e-6;
/// The least area that counts, in units of the mean.
const LEAST_AREA: f64 = 0.25;
/// An upright map is settled when a round lowers its energy by less, relatively.
const SETTLED: f64 = 1e-2;

/// How much work may still be done, in triangles times evaluations of their energy: what makes unfolding, and the ladder that
/// calls it, end in a time that the number of triangles bounds, on any machine after the same steps.
#[derive(Debug)]
pub(crate) struct Effort(Cell<u64>);

impl Effort {
    /// What a surface of so many triangles is worth: fifteen hundred evaluations, and as many of ten thousand triangles.
    pub(crate) fn of(triangles: usize) -> Self {
        const EVALUATIONS: u64 = 1500;
        const FEW: u64 = 10_000;
        Self(Cell::new(EVALUATIONS * (triangles as u64 + FEW)))
    }

    /// Takes one of so many parts of what is left, so that something remains for another try.
    pub(crate) fn share(&self, parts: u64) -> Self {
        let share = self.0.get() / parts;
        self.0.set(self.0.get() - share);
        Self(Cell::new(share))
    }

    /// What was not spent of a share comes back.
    pub(crate) fn give_back(&self, share: &Self) {
        self.0.set(self.0.get() + share.0.take());
    }

    /// Takes from it; false if there was not as much.
    pub(crate) fn spend(&self, amount: usize) -> bool {
        let left = self.0.get().checked_sub(amount as u64);
        self.0.set(left.unwrap_or(0));
        left.is_some()
    }

    /// What is left.
    pub(crate) fn left(&self) -> u64 {
        self.0.get()
    }

    /// Is nothing left?
    pub(crate) fn is_spent(&self) -> bool {
        self.left() == 0
    }
}

/// Where unfolding without integers has led with the maps of a field.
#[derive(Debug, Default)]
pub(crate) struct Ends {
    /// The unknowns of the last map that came out upright.
    pub(crate) upright: RefCell<Option<Vec<f64>>>,
    /// The last that did not, or where the next one starts.
    pub(crate) folded: RefCell<Option<Folded>>,
}

impl Ends {
    /// Does the next map start from a folded one?
    pub(crate) fn is_folded(&self) -> bool {
        self.folded.borrow().is_some()
    }
}

/// A map without integers that stays folded.
#[derive(Clone, Debug)]
pub(crate) struct Folded {
    /// `[h_u ∇u; h_v ∇v]` of each triangle in the basis of the field's arm θ and the next one.
    pub(crate) jacobians: Vec<[[f64; 2]; 2]>,
    /// Vertices at a wrong angle or of triangles that are not upright.
    pub(crate) vertices: Vec<usize>,
}

/// Says something of a map by all its unknowns.
pub(crate) type Judge<'a> = &'a dyn Fn(&[f64]) -> bool;

/// What unfolding may use.
#[derive(Clone, Copy)]
pub(crate) struct Unfolding<'a> {
    pub(crate) effort: &'a Effort,
    /// Of the same field: what is upright at one spacing is so at any, and is where the next map starts.
    pub(crate) ends: &'a Ends,
}

impl Unfolding<'_> {
    /// What a single map of so many triangles may use.
    pub(crate) fn alone(triangles: usize) -> (Effort, Ends) {
        (Effort::of(triangles), Ends::default())
    }
}

/// How it moves.
pub(crate) struct Moves<'a> {
    /// What moves.
    pub(crate) scope: &'a Scope,
    /// The inverse of the quadratic energy, which bends the steps (Kovalsky, Galun and Lipman, *Accelerated quadratic proxy for
    /// geometric optimization*, 2016): a mesh of any fineness takes about as many.
    pub(crate) bend: Bend<'a>,
    /// Triangles that are upright, and stay so; ascending.
    pub(crate) held: Vec<usize>,
    /// What unfolding may cost.
    pub(crate) effort: &'a Effort,
    /// Is this a map from which none with the right angles is reached once ε is small?
    pub(crate) is_lost: Judge<'a>,
}

/// Solves with the matrix of a quadratic energy over the unknowns that move.
pub(crate) type Bend<'a> = &'a dyn Fn(&[f64]) -> Result<Vec<f64>, Error>;

/// Minimizes the regularized distortion `Σ A ((|J|² + λ (det² + 1)) / 2χ + |J − 1|²)`, `χ = (det + √(ε² + det²)) / 2`
/// (Garanzha et al., *Foldover-free maps in 50 lines of code*, 2021), by L-BFGS. ε falls as theirs does, by what a round has
/// gained and by the worst determinant, and to twice that at once. A map that cannot be unfolded comes out folded.
///
/// `w` are all values; the unknowns of the scope move, and sums with the integers. With ε above 0 the energy is finite
/// everywhere, so that any map may be the start. A round is a minimization for one ε, of at most [`STEPS`] steps, and there are at most [`ROUNDS`] of them. A map that is still folded is given up
/// when the effort is spent, when its worst determinant has not risen for [`STALLED`] rounds, or when it is lost. Of an
/// upright one ε falls on until a round gains less than [`SETTLED`], so that what comes out is also smooth.
pub(crate) fn untangle(
    system: &System<'_>,
    w: &mut [f64],
    moves: &Moves<'_>,
    run: On<'_>,
) -> Result<(), Error> {
    let mut energy = Energy::new(system, moves, w, run);
    let mut x: Vec<f64> = moves.scope.unknowns.iter().map(|&k| w[k]).collect();
    let worst = energy.worst(&x);
    energy.epsilon = first_epsilon(worst);
    let (mut best, mut stalled) = (worst, 0);
    for round in 0..ROUNDS {
        // A step of a large map takes a good part of a second, a round half a minute.
        let watch = |step: usize| {
            let done = round * STEPS + step;
            run.progress("untangle", done as u64, (ROUNDS * STEPS) as u64)
        };
        let (before, after) = minimize(&mut energy, moves, &mut x, &watch)?;
        let worst = energy.worst(&x);
        let positive = worst > 0.0;
        // Folds that hold each other do not open however long they are pushed.
        if worst > best + 1e-2 * best.abs() {
            (best, stalled) = (worst, 0);
        } else {
            stalled += 1;
        }
        if !positive && (stalled >= STALLED || moves.effort.is_spent()) {
            break;
        }
        if energy.epsilon < FIRM && (moves.is_lost)(energy.all(&x)) {
            break;
        }
        let gained = 1.0 - after / before;
        if positive && gained < SETTLED {
            break;
        }
        // ε follows what was gained: too fast a fall freezes the folds, too slow a one takes forever.
        let share = gained.max(0.5);
        let root = worst.hypot(energy.epsilon);
        let falls = if positive {
            share
        } else {
            share * root / (worst.abs() + root)
        };
        // Far above the worst determinant ε only takes time.
        let most = (2.0 * worst.abs()).max(0.4);
        energy.epsilon = (energy.epsilon * (1.0 - falls)).clamp(LEAST, most);
    }
    w.copy_from_slice(energy.all(&x));
    Ok(())
}

/// The ε that a map with this worst determinant begins with: the smallest where nothing is folded, and nothing shall be.
fn first_epsilon(worst: f64) -> f64 {
    if worst > 0.0 {
        LEAST
    } else {
        (0.5 * worst.abs()).max(0.1)
    }
}

struct Energy<'a> {
    system: &'a System<'a>,
    scope: &'a Scope,
    /// Of the triangles of the scope, with areas raised to [`LEAST_AREA`], unlike those of the system.
    charts: Vec<Chart>,
    backend: &'a (dyn CrossfieldBackend + 'a),
    /// All values: those that do not move as they are, the others as they were asked for last.
    w: Vec<f64>,
    /// Per value, its place among those that move.
    place: Vec<Option<u32>>,
    /// Places of held triangles among those of the scope. Their distortion is always taken with the smallest ε, whose barrier
    /// is too high for any step to cross, and on the CPU, whatever the backend: in f32 the barrier would have holes.
    held: Vec<usize>,
    /// ε of the round.
    epsilon: f64,
    /// What the last evaluation found, per triangle.
    out: Vec<ChartDistortion>,
}

impl<'a> Energy<'a> {
    fn new(system: &'a System<'a>, moves: &Moves<'a>, w: &[f64], run: On<'a>) -> Self {
        let scope = moves.scope;
        // A triangle hardly there shall not stay folded because it counts for nothing.
        let charts = scope.faces.iter().map(|&f| {
            let chart = system.charts[f];
            let area = chart.area.max(LEAST_AREA);
            Chart { area, ..chart }
        });
        let is_held = |f: &usize| moves.held.binary_search(f).is_ok();
        let faces = scope.faces.iter().enumerate();
        Self {
            system,
            scope,
            charts: charts.collect(),
            backend: run.backend,
            w: w.to_vec(),
            place: scope.places(w.len()),
            held: faces.filter(|(_, f)| is_held(f)).map(|(k, _)| k).collect(),
            epsilon: 0.0,
            out: Vec::new(),
        }
    }

    /// All values, with these of the scope.
    fn all(&mut self, x: &[f64]) -> &[f64] {
        for (&k, &x) in self.scope.unknowns.iter().zip(x) {
            self.w[k] = x;
        }
        if self.scope.moves_integers {
            self.system.seams.add_up(&mut self.w);
        }
        &self.w
    }

    /// Of the triangles of the scope.
    fn corners(&mut self, x: &[f64]) -> Vec<[[f64; 2]; 3]> {
        self.all(x);
        let copies = self.scope.copies.iter();
        let copies: Vec<[f64; 2]> = copies.map(|&c| self.system.copy(&self.w, c)).collect();
        let of = |corners: &[u32; 3]| corners.map(|c| copies[c as usize]);
        self.scope.corners.iter().map(of).collect()
    }

    /// Distortions at x, from the backend, which must answer one per triangle.
    fn evaluate(&mut self, x: &[f64]) -> Result<(), Error> {
        let corners = self.corners(x);
        self.backend
            .chart_distortion(&self.charts, &corners, self.epsilon, &mut self.out)?;
        let (found, of) = (self.out.len(), corners.len());
        BackendError::unless(found == of, &self.backend.name(), || {
            format!("{found} distortions for {of} triangles")
        })?;
        for &f in &self.held {
            self.out[f] = chart_distortion(&self.charts[f], &corners[f], LEAST);
        }
        Ok(())
    }

    /// The smallest determinant.
    fn worst(&mut self, x: &[f64]) -> f64 {
        let corners = self.corners(x);
        let all = self.charts.iter().zip(&corners);
        all.map(|(chart, uv)| chart.determinant(uv))
            .fold(f64::INFINITY, f64::min)
    }

    /// Energy and gradient with respect to the unknowns that move.
    fn gradient(&mut self, x: &[f64]) -> Result<(f64, Vec<f64>), Error> {
        self.evaluate(x)?;
        let mut value = 0.0;
        let mut of_copies = vec![[0.0; 2]; self.scope.copies.len()];
        for (of, copies) in self.out.iter().zip(&self.scope.corners) {
            value += of.energy;
            for (&copy, slope) in copies.iter().zip(&of.gradient) {
                let sum = &mut of_copies[copy as usize];
                *sum = [sum[0] + slope[0], sum[1] + slope[1]];
            }
        }
        let moved = match self.scope.moves_integers {
            true => self.w.len(),
            false => x.len(),
        };
        let mut gradient = vec![0.0; moved];
        for (&copy, slope) in self.scope.copies.iter().zip(&of_copies) {
            for (component, slope) in slope.iter().enumerate() {
                for (k, p) in self.system.seams.row(copy, component) {
                    if let Some(place) = self.place[k] {
                        gradient[place as usize] += f64::from(p) * slope;
                    }
                }
            }
        }
        if self.scope.moves_integers {
            self.system.seams.fold(&mut gradient);
        }
        Ok((value, gradient))
    }
}

/// A step and what it changed.
/// L-BFGS keeps the last few of these in place of a matrix of second derivatives.
struct Step {
    /// Of the unknowns.
    moved: Vec<f64>,
    /// Of the gradient.
    turned: Vec<f64>,
    /// `P⁻¹ turned`, with P the matrix of the quadratic energy.
    bent: Vec<f64>,
    /// `1 / moved · turned`.
    rho: f64,
    /// `moved · turned` over `turned · bent`.
    scale: f64,
}

/// L-BFGS (Nocedal and Wright, *Numerical Optimization*, algorithm 7.5) with backtracking; the energy before and after.
///
/// It ends after [`STEPS`], when a step gains less than 1e-8 of the energy, when no step along the direction lowers it,
/// or when the effort is spent. A pair that shows no curvature is not remembered; a direction that does not descend
/// makes it forget all others.
fn minimize(
    energy: &mut Energy<'_>,
    moves: &Moves<'_>,
    x: &mut Vec<f64>,
    watch: &dyn Fn(usize) -> Result<(), Cancelled>,
) -> Result<(f64, f64), Error> {
    let (mut value, mut gradient) = energy.gradient(x)?;
    let first = value;
    // The only solve of a step: all else that P⁻¹ has to be known of is a sum of such.
    let mut bent = (moves.bend)(&gradient)?;
    let mut history: Vec<Step> = Vec::new();
    for step in 0..STEPS {
        watch(step)?;
        if !moves.effort.spend(energy.charts.len()) {
            break;
        }
        let mut direction = two_loops(&gradient, &bent, &history);
        let mut slope = dot(&direction, &gradient);
        if slope >= 0.0 && !history.is_empty() {
            history.clear();
            direction = two_loops(&gradient, &bent, &history);
            slope = dot(&direction, &gradient);
        }
        if slope.is_nan() || slope >= -1e-14 * (1.0 + value.abs()) {
            break;
        }
        let Some(found) = searched(energy, x, &direction, value, slope)? else {
            break;
        };
        let moved = minus(&found.at, x);
        let turned = minus(&found.gradient, &gradient);
        let curvature = dot(&moved, &turned);
        let next = (moves.bend)(&found.gradient)?;
        if curvature > 1e-12 * (dot(&moved, &moved) * dot(&turned, &turned)).sqrt() {
            let bent = minus(&next, &bent);
            if history.len() == HISTORY {
                history.remove(0);
            }
            history.push(Step {
                rho: 1.0 / curvature,
                scale: curvature / dot(&turned, &bent),
                moved,
                turned,
                bent,
            });
        }
        bent = next;
        let gain = value - found.value;
        (*x, value, gradient) = (found.at, found.value, found.gradient);
        if gain < 1e-8 * value.abs() {
            break;
        }
    }
    Ok((first, value))
}

/// Where a search along a line has ended, with energy and gradient there.
struct Found {
    at: Vec<f64>,
    value: f64,
    gradient: Vec<f64>,
}

/// The first of ever shorter steps that lowers the energy enough, with energy and gradient there.
///
/// Enough is 1e-4 of what the slope promises (Armijo's condition). Steps that meet a number that is not finite are too
/// long. `None` after thirty tries.
fn searched(
    energy: &mut Energy<'_>,
    x: &[f64],
    direction: &[f64],
    value: f64,
    slope: f64,
) -> Result<Option<Found>, Error> {
    let mut step = 1.0;
    for _ in 0..30 {
        let at: Vec<f64> = x.iter().zip(direction).map(|(x, d)| x + step * d).collect();
        let (there, gradient) = energy.gradient(&at)?;
        if there.is_finite() && there <= value + 1e-4 * step * slope {
            let value = there;
            return Ok(Some(Found {
                at,
                value,
                gradient,
            }));
        }
        step *= 0.5;
    }
    Ok(None)
}

/// Minus the gradient, bent by the curvature met so far.
///
/// In place of a multiple of the identity, as in the textbook, the inverse of the quadratic energy stands in the
/// middle, scaled to the curvature of the last step. `bent` is that inverse times the gradient.
fn two_loops(gradient: &[f64], bent: &[f64], history: &[Step]) -> Vec<f64> {
    let mut q: Vec<f64> = gradient.iter().map(|g| -g).collect();
    let mut inverse: Vec<f64> = bent.iter().map(|b| -b).collect();
    let mut alphas = Vec::new();
    for step in history.iter().rev() {
        let alpha = step.rho * dot(&step.moved, &q);
        add(&mut q, -alpha, &step.turned);
        add(&mut inverse, -alpha, &step.bent);
        alphas.push(alpha);
    }
    if let Some(last) = history.last() {
        for q in &mut inverse {
            *q *= last.scale;
        }
    }
    for (step, alpha) in history.iter().zip(alphas.into_iter().rev()) {
        let beta = step.rho * dot(&step.turned, &inverse);
        add(&mut inverse, alpha - beta, &step.moved);
    }
    inverse
}

/// `x ← x + a y`.
fn add(x: &mut [f64], a: f64, y: &[f64]) {
    for (x, y) in x.iter_mut().zip(y) {
        *x += a * y;
    }
}

fn minus(a: &[f64], b: &[f64]) -> Vec<f64> {
    a.iter().zip(b).map(|(a, b)| a - b).collect()
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}
