//! Roots on segments.

use std::ops::ControlFlow;

/// How near to the root [`crossing`] goes: until one of the two is met.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Precision {
    /// Change of the place, in units of the segment, that no longer matters; 0 to go by the value alone.
    pub place: f64,
    /// Values below this, in magnitude, are 0; 0 to go by the place alone.
    pub value: f64,
}

/// Most values that [`crossing`] asks for. Fourteen of them halve the bracket at least, down to 2⁻¹⁴ of the segment
/// where every guess was useless; what has not been found by then is given as it stands.
const ROUNDS: u32 = 32;
/// Guesses that a smooth function needs at most; thereafter every second round halves the bracket.
const SMOOTH: u32 = 5;

/// Where a function of the place on a segment, from 0 to 1, has a root: inverse interpolation through the last
/// three places, within a bracket that is halved where the interpolation fails (the manner of Brent, *Algorithms
/// for Minimization without Derivatives*, 1973, ch. 4).
///
/// `ends` are the values at 0 and 1; one of them is negative and the other is not. They may be rough (a sample of
/// the function); only their signs are trusted. The place that is found lies between the ends; a root that is nearer
/// to one of them than the precision may be placed right there. Values are taken to be expensive: for a precision of 10⁻⁴ of the segment a smooth function is asked three or four times.
/// Exponentials are better given as their logarithms.
///
/// ```
/// use geom_core::field::{Precision, crossing};
/// let fine = Precision { place: 1e-6, value: 0.0 };
/// let t = crossing([-1.0, 7.0], fine, |t| (1.0 + t).powi(3) - 2.0);
/// assert!((t - (2f64.cbrt() - 1.0)).abs() < 1e-6);
/// ```
pub fn crossing(ends: [f64; 2], precision: Precision, mut value: impl FnMut(f64) -> f64) -> f64 {
    let mut search = Search::between(ends, precision);
    loop {
        match search.ask() {
            ControlFlow::Break(root) => return root,
            ControlFlow::Continue(t) => search.learn(t, value(t)),
        }
    }
}

/// The roots of many functions, each as [`crossing`] finds it, where a call for many values costs little more than one
/// for a single value. `values` is handed which functions are asked for, and where, and pushes one value for each; its
/// error ends the search.
///
/// # Panics
///
/// If `values` gives another number of values.
///
/// # Errors
/// That of `values`.
pub fn crossings<E>(
    ends: &[[f64; 2]],
    precision: Precision,
    mut values: impl FnMut(&[(usize, f64)], &mut Vec<f64>) -> Result<(), E>,
) -> Result<Vec<f64>, E> {
    let start = |&ends: &[f64; 2]| Search::between(ends, precision);
    let mut searches: Vec<Search> = ends.iter().map(start).collect();
    let mut roots = vec![0.0; ends.len()];
    let mut open: Vec<usize> = (0..ends.len()).collect();
    let (mut asked, mut found) = (Vec::new(), Vec::new());
    loop {
        asked.clear();
        open.retain(|&i| match searches[i].ask() {
            ControlFlow::Break(root) => {
                roots[i] = root;
                false
            }
            ControlFlow::Continue(t) => {
                asked.push((i, t));
                true
            }
        });
        if asked.is_empty() {
            return Ok(roots);
        }
        found.clear();
        values(&asked, &mut found)?;
        assert_eq!(found.len(), asked.len(), "one value for each place");
        for (&(i, t), &value) in asked.iter().zip(&found) {
            searches[i].learn(t, value);
        }
    }
}

/// A search for a root that is told the values it asks for.
///
/// Invariant: `low` and `high` have values of different sign, and a new place replaces the one of its own sign. The
/// place that is replaced is kept as the third for interpolation.
struct Search {
    precision: Precision,
    /// Places and the values there: the bracket, and its last end to go.
    low: (f64, f64),
    high: (f64, f64),
    before: Option<(f64, f64)>,
    /// The place asked for last.
    t: f64,
    round: u32,
    done: bool,
}

impl Search {
    fn between(ends: [f64; 2], precision: Precision) -> Self {
        Self {
            precision,
            low: (0.0, ends[0]),
            high: (1.0, ends[1]),
            before: None,
            t: 0.5,
            round: 0,
            done: false,
        }
    }

    /// The next place to look at, or the root.
    #[inline]
    fn ask(&mut self) -> ControlFlow<f64, f64> {
        let (low, high, margin) = (self.low, self.high, self.precision.place);
        if self.done || self.round == ROUNDS {
            return ControlFlow::Break(self.t);
        }
        let curved = self
            .before
            .and_then(|before| interpolated(&[low, high, before]));
        // The guess is better than the place whose value is known, and costs nothing. (One by the two ends would not
        // do: where one value is huge, it hardly leaves the other end, however far the root.)
        if let Some(next) = curved.filter(|next| (next - self.t).abs() < margin) {
            return ControlFlow::Break(next.clamp(low.0, high.0));
        }
        let within = |t: &f64| *t > low.0 && *t < high.0;
        let straight = || {
            let t = interpolated(&[low, high])?;
            Some(t.max(low.0 + 0.5 * margin).min(high.0 - 0.5 * margin))
        };
        let guess = curved.filter(within).or_else(|| straight().filter(within));
        self.t = guess
            .filter(|_| self.round < SMOOTH || self.round.is_multiple_of(2))
            .unwrap_or(0.5 * (low.0 + high.0));
        self.round += 1;
        ControlFlow::Continue(self.t)
    }

    /// Takes the value at the place that it asked for.
    #[inline]
    fn learn(&mut self, t: f64, f: f64) {
        if f.abs() < self.precision.value || f == 0.0 {
            self.done = true;
            return;
        }
        let end = if (f >= 0.0) == (self.low.1 >= 0.0) {
            &mut self.low
        } else {
            &mut self.high
        };
        self.before = Some(std::mem::replace(end, (t, f)));
        self.done = self.high.0 - self.low.0 < self.precision.place;
    }
}

/// Where a function is 0, given places and its values there, by the polynomial that has the places as its values;
/// `None` if two values are the same. Inverse interpolation (Lagrange), of degree one less than the number of places:
/// straight by two, a sideways parabola by three.
fn interpolated(known: &[(f64, f64)]) -> Option<f64> {
    let weighted = known.iter().enumerate().map(|(i, (place, own))| {
        let others = known.iter().enumerate().filter(|(j, _)| *j != i);
        let weights = others.map(|(_, (_, f))| f / (f - own));
        place * weights.product::<f64>()
    });
    Some(weighted.sum()).filter(|t: &f64| t.is_finite())
}
