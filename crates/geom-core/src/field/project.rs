//! The way along the gradient to a level set.
//!
//! Newton's method knows how far to go only where the field is nearly linear. Far from the level, or across kinks, its
//! steps are too long or lead astray: hence the bounds of [`Guard`], and hence the way ends with a reason, which its
//! caller must look at.

use std::ops::ControlFlow;

use super::Tangent;
use crate::{Point3, Vector3};

/// How [`project`] goes.
///
/// [`Guard::within`] is a good start; change single fields for a place that is known better. Looser bounds find more,
/// and may find another sheet of the level set than the one that was meant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Guard {
    /// Most steps.
    pub steps: u32,
    /// How often a step that leads away from the level is halved before the way is lost; 0 to take every step and
    /// keep the best place.
    pub halvings: u32,
    /// Longest step, Å. Short steps keep to the sheet that the start is near; too short ones use up all the steps.
    pub longest: f64,
    /// Farthest from the start, Å. Measured straight from the start. A place beyond it may still be
    /// [`Projection::best`].
    pub reach: f64,
    /// First-order distance at which the level set is reached, Å: the error after one more step
    /// ([`Tangent::foot`]) is about its square times the curvature.
    pub near: f64,
}

impl Guard {
    /// A way of at most `reach`, in steps of at most half of it, to within 10⁻⁴ of it.
    pub fn within(reach: f64) -> Self {
        Self {
            steps: 12,
            halvings: 9,
            longest: 0.5 * reach,
            reach,
            near: 1e-4 * reach,
        }
    }
}

/// How the way of [`project`] ended. Only after [`End::Near`] is the place certain to be near a level set.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum End {
    /// At the level set, up to one more step.
    Near,
    /// After the last step allowed: kinked fields are followed slowly.
    Tired,
    /// Where there is no direction, no better place along it, or no place to ask.
    Lost,
    /// Out of reach.
    Away,
}

/// The place that [`project`] found. It may be the start.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Projection {
    /// The place on the way whose height is least, with the field there.
    pub best: Tangent,
    /// How the way ended.
    pub end: End,
}

/// Goes to the level set along the gradient by Newton's method, guarded: steps are at most so long, those that lead
/// away from the level are halved, and the best place is kept.
///
/// `look` gives the field at a point, or `None` where there is none; it may move the point, e.g. back into a cell
/// that must not be left, and says by [`Tangent::at`] where it looked. It is called once per step and halving; the
/// start has been looked at already.
///
/// ```
/// use geom_core::field::{End, Guard, ImplicitField, Tangent, project};
/// use geom_core::{Point3, Vector3};
/// struct Ball;
/// impl ImplicitField for Ball {
///     fn value(&self, x: &Point3) -> f64 {
///         (1.0 - x.coords.norm_squared()).exp()
///     }
///     fn value_gradient(&self, x: &Point3) -> (f64, Vector3) {
///         let value = self.value(x);
///         (value, x.coords * (-2.0 * value))
///     }
/// }
/// let look = |x: Point3| Some(Tangent::new(&Ball, 1.0, x));
/// let start = Tangent::new(&Ball, 1.0, Point3::new(0.9, 0.9, 0.0));
/// let found = project(start, &Guard::within(1.0), look);
/// assert_eq!(found.end, End::Near);
/// assert!((found.best.foot().coords.norm() - 1.0).abs() < 1e-6);
/// ```
pub fn project(
    start: Tangent,
    guard: &Guard,
    mut look: impl FnMut(Point3) -> Option<Tangent>,
) -> Projection {
    let mut walk = Walk::from(start);
    let mut next = walk.stride(guard);
    loop {
        match next {
            ControlFlow::Break(projection) => return projection,
            ControlFlow::Continue(x) => next = walk.arrive(look(x), guard),
        }
    }
}

/// Many ways to the level set, each as [`project`] goes, where a call for many points costs little more than one for a
/// single point. `look` is handed which ways ask, and where, and pushes one answer for each; its error ends all.
///
/// # Panics
///
/// If `look` gives another number of answers.
///
/// # Errors
/// That of `look`.
pub fn projections<E>(
    starts: &[Tangent],
    guard: &Guard,
    mut look: impl FnMut(&[(usize, Point3)], &mut Vec<Option<Tangent>>) -> Result<(), E>,
) -> Result<Vec<Projection>, E> {
    let mut walks: Vec<Walk> = starts.iter().map(|&start| Walk::from(start)).collect();
    let mut ended: Vec<Option<Projection>> = vec![None; starts.len()];
    let mut asked = Vec::new();
    let take = |asked: &mut Vec<_>, ended: &mut [Option<Projection>], i, next| match next {
        ControlFlow::Break(projection) => ended[i] = Some(projection),
        ControlFlow::Continue(x) => asked.push((i, x)),
    };
    for (i, walk) in walks.iter_mut().enumerate() {
        take(&mut asked, &mut ended, i, walk.stride(guard));
    }
    let (mut now, mut found) = (Vec::new(), Vec::new());
    while !asked.is_empty() {
        std::mem::swap(&mut now, &mut asked);
        asked.clear();
        found.clear();
        look(&now, &mut found)?;
        assert_eq!(found.len(), now.len(), "one answer for each place");
        for (&(i, _), &answer) in now.iter().zip(&found) {
            take(&mut asked, &mut ended, i, walks[i].arrive(answer, guard));
        }
    }
    let all = ended.into_iter();
    Ok(all.map(|end| end.expect("every way has ended")).collect())
}

/// A way to the level set that is told what is at the points it asks for.
///
/// Halving is a line search by `|height|` alone: a step is taken if it lowers the least so far, else its share is
/// halved, from `here` again. Without halvings every step is taken, and only the best place is remembered.
struct Walk {
    start: Point3,
    here: Tangent,
    best: Tangent,
    /// Newton's step from here, and the share of it that is tried.
    step: Vector3,
    share: f64,
    halvings: u32,
    steps: u32,
}

impl Walk {
    fn from(start: Tangent) -> Self {
        Self {
            start: start.at,
            here: start,
            best: start,
            step: Vector3::zeros(),
            share: 1.0,
            halvings: 0,
            steps: 0,
        }
    }

    fn end(&self, end: End) -> ControlFlow<Projection, Point3> {
        ControlFlow::Break(Projection {
            best: self.best,
            end,
        })
    }

    /// The point that the next step leads to, or how the way ended.
    #[inline]
    fn stride(&mut self, guard: &Guard) -> ControlFlow<Projection, Point3> {
        if self.steps == guard.steps {
            let near = |s: Vector3| s.norm() <= guard.near;
            let reached = self.best.step().is_some_and(near);
            return self.end(if reached { End::Near } else { End::Tired });
        }
        self.steps += 1;
        let Some(step) = self.here.step() else {
            return self.end(End::Lost);
        };
        let length = step.norm();
        if length <= guard.near {
            return self.end(End::Near);
        }
        (self.step, self.halvings) = (step, 0);
        self.share = (guard.longest / length).min(1.0);
        ControlFlow::Continue(self.here.at + step * self.share)
    }

    /// Takes what is at the point that was asked for; then the next one, or how the way ended.
    #[inline]
    fn arrive(&mut self, next: Option<Tangent>, guard: &Guard) -> ControlFlow<Projection, Point3> {
        let Some(next) = next else {
            return self.end(End::Lost);
        };
        if next.height.abs() < self.best.height.abs() {
            self.best = next;
        } else if guard.halvings > 0 {
            if self.halvings == guard.halvings {
                return self.end(End::Lost);
            }
            self.halvings += 1;
            self.share *= 0.5;
            return ControlFlow::Continue(self.here.at + self.step * self.share);
        }
        // It was held where it is: the level set does not come nearer.
        let moved = (next.at - self.here.at).norm();
        if moved <= guard.near && self.share * self.step.norm() > guard.near {
            return self.end(End::Lost);
        }
        self.here = next;
        if (next.at - self.start).norm() > guard.reach {
            return self.end(End::Away);
        }
        self.stride(guard)
    }
}
