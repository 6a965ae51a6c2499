//! Scalar fields with values and gradients at any point, and the ways to their level sets: to a root on a
//! segment ([`crossing`]) and along the gradient ([`project`]).

use crate::{Point3, Vector3};

/// A scalar field whose level set is a surface; large inside.
///
/// Implemented by [`ScalarGrid`](crate::ScalarGrid) and [`BrickGrid`](crate::BrickGrid) (trilinear)
/// and by the point sampler of `gauss-density` (analytic). `dual-contour` uses it for roots and
/// projection, `tet-quality` for the motion of surface vertices.
pub trait ImplicitField: Sync {
    /// The value at `x`.
    fn value(&self, x: &Point3) -> f64;

    /// The value and the gradient (per Å) at `x`.
    fn value_gradient(&self, x: &Point3) -> (f64, Vector3);
}

impl<F: ImplicitField + ?Sized> ImplicitField for &F {
    fn value(&self, x: &Point3) -> f64 {
        (**self).value(x)
    }
    fn value_gradient(&self, x: &Point3) -> (f64, Vector3) {
        (**self).value_gradient(x)
    }
}

/// How near to the root [`crossing`] goes: until one of the two is met.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Precision {
    /// Change of the place, in units of the segment, that no longer matters; 0 to go by the value alone.
    pub place: f64,
    /// Values below this, in magnitude, are 0; 0 to go by the place alone.
    pub value: f64,
}

/// Most values that [`crossing`] asks for.
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
    let Precision {
        place: margin,
        value: small,
    } = precision;
    // Places and the values there; `before` was the last end of the bracket to go.
    let (mut low, mut high, mut before) = ((0.0, ends[0]), (1.0, ends[1]), None);
    let mut t = 0.5;
    for round in 0..ROUNDS {
        let curved = before.and_then(|before| interpolated(&[low, high, before]));
        // The guess is better than the place whose value is known, and costs nothing. (One by the two ends would not
        // do: where one value is huge, it hardly leaves the other end, however far the root.)
        if let Some(next) = curved.filter(|next| (next - t).abs() < margin) {
            return next.clamp(low.0, high.0);
        }
        let within = |t: &f64| *t > low.0 && *t < high.0;
        let straight = || {
            let t = interpolated(&[low, high])?;
            Some(t.max(low.0 + 0.5 * margin).min(high.0 - 0.5 * margin))
        };
        let guess = curved.filter(within).or_else(|| straight().filter(within));
        t = guess
            .filter(|_| round < SMOOTH || round % 2 == 0)
            .unwrap_or(0.5 * (low.0 + high.0));
        let f = value(t);
        if f.abs() < small || f == 0.0 {
            break;
        }
        let gone = if (f >= 0.0) == (low.1 >= 0.0) {
            std::mem::replace(&mut low, (t, f))
        } else {
            std::mem::replace(&mut high, (t, f))
        };
        before = Some(gone);
        if high.0 - low.0 < margin {
            break;
        }
    }
    t
}

/// Where a function is 0, given places and its values there, by the polynomial that has the places as its values;
/// `None` if two values are the same.
fn interpolated(known: &[(f64, f64)]) -> Option<f64> {
    let weighted = known.iter().enumerate().map(|(i, (place, own))| {
        let others = known.iter().enumerate().filter(|(j, _)| *j != i);
        let weights = others.map(|(_, (_, f))| f / (f - own));
        place * weights.product::<f64>()
    });
    Some(weighted.sum()).filter(|t: &f64| t.is_finite())
}

/// A field at a point to first order: its height above a level and its gradient.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tangent {
    /// The point.
    pub at: Point3,
    /// The value less the level.
    pub height: f64,
    /// The gradient.
    pub gradient: Vector3,
}

impl Tangent {
    /// The field at `x` against a level.
    pub fn new(field: &(impl ImplicitField + ?Sized), level: f64, x: Point3) -> Self {
        let (value, gradient) = field.value_gradient(&x);
        Self {
            at: x,
            height: value - level,
            gradient,
        }
    }

    /// First-order signed distance to the level set, positive where the field is above the level; infinite where
    /// there is no direction to go. Where the gradient is tiny (at saddles) it is far too large.
    pub fn distance(&self) -> f64 {
        let slope = self.gradient.norm();
        if self.has_direction() {
            self.height / slope
        } else {
            f64::INFINITY
        }
    }

    /// The unit gradient, into the inside; zero where there is none.
    pub fn normal(&self) -> Vector3 {
        if self.has_direction() {
            self.gradient / self.gradient.norm()
        } else {
            Vector3::zeros()
        }
    }

    /// Newton's step along the gradient, to the level set to first order; `None` where there is no direction.
    pub fn step(&self) -> Option<Vector3> {
        self.has_direction()
            .then(|| self.gradient * (-self.height / self.gradient.norm_squared()))
    }

    /// The point after that step, or this one where there is none.
    pub fn foot(&self) -> Point3 {
        self.step().map_or(self.at, |step| self.at + step)
    }

    fn has_direction(&self) -> bool {
        let square = self.gradient.norm_squared();
        square > 0.0 && square.is_finite() && self.height.is_finite()
    }
}

/// How [`project`] goes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Guard {
    /// Most steps.
    pub steps: u32,
    /// How often a step that leads away from the level is halved before the way is lost; 0 to take every step and
    /// keep the best place.
    pub halvings: u32,
    /// Longest step, Å.
    pub longest: f64,
    /// Farthest from the start, Å.
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

/// How the way of [`project`] ended.
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

/// The place that [`project`] found.
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
    let (mut here, mut best) = (start, start);
    let ended = |best: Tangent, end: End| Projection { best, end };
    for _ in 0..guard.steps {
        let Some(step) = here.step() else {
            return ended(best, End::Lost);
        };
        let length = step.norm();
        if length <= guard.near {
            return ended(best, End::Near);
        }
        let mut share = (guard.longest / length).min(1.0);
        let mut halvings = 0;
        let next = loop {
            let Some(next) = look(here.at + step * share) else {
                return ended(best, End::Lost);
            };
            if next.height.abs() < best.height.abs() {
                best = next;
                break next;
            }
            if guard.halvings == 0 {
                break next;
            }
            if halvings == guard.halvings {
                return ended(best, End::Lost);
            }
            halvings += 1;
            share *= 0.5;
        };
        // It was held where it is: the level set does not come nearer.
        let moved = (next.at - here.at).norm();
        if moved <= guard.near && share * length > guard.near {
            return ended(best, End::Lost);
        }
        here = next;
        if (here.at - start.at).norm() > guard.reach {
            return ended(best, End::Away);
        }
    }
    let end = if best.step().is_some_and(|s| s.norm() <= guard.near) {
        End::Near
    } else {
        End::Tired
    };
    ended(best, end)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::compute::random::SplitMix64;

    /// Fields whose level set 1 is a sphere, a torus, and two spheres that meet in a kink.
    enum Shape {
        Sphere,
        Torus,
        Kink,
    }

    fn ball(x: &Point3, centre: Vector3) -> (f64, Vector3) {
        let d = x.coords - centre;
        let value = (1.0 - d.norm_squared()).exp();
        (value, d * (-2.0 * value))
    }

    impl ImplicitField for Shape {
        fn value(&self, x: &Point3) -> f64 {
            self.value_gradient(x).0
        }
        fn value_gradient(&self, x: &Point3) -> (f64, Vector3) {
            match self {
                Self::Sphere => ball(x, Vector3::zeros()),
                Self::Torus => {
                    let round = x.x.hypot(x.y);
                    let value = (0.09 - (round - 1.0).powi(2) - x.z * x.z).exp();
                    let pull = -2.0 * value * (round - 1.0) / round;
                    let gradient = Vector3::new(pull * x.x, pull * x.y, -2.0 * value * x.z);
                    (value, gradient)
                }
                Self::Kink => {
                    let [a, b] = [-0.6, 0.6].map(|c| ball(x, Vector3::x() * c));
                    if a.0 > b.0 { a } else { b }
                }
            }
        }
    }

    impl Shape {
        const ALL: [Self; 3] = [Self::Sphere, Self::Torus, Self::Kink];

        /// The distance to the level set, exactly; at the kink, from outside of it.
        fn distance(&self, x: &Point3) -> f64 {
            match self {
                Self::Sphere => x.coords.norm() - 1.0,
                Self::Torus => (x.x.hypot(x.y) - 1.0).hypot(x.z) - 0.3,
                Self::Kink => (x.coords - Vector3::x() * 0.6f64.copysign(x.x)).norm() - 1.0,
            }
        }
    }

    fn random_point(random: &mut SplitMix64, size: f64) -> Point3 {
        Point3::from([(); 3].map(|()| size * random.symmetric()))
    }

    /// Segments with an end on either side of the level set of a shape.
    fn segments(shape: &Shape, seed: u64) -> Vec<[Point3; 2]> {
        let mut random = SplitMix64::new(seed);
        let mut found = Vec::new();
        while found.len() < 500 {
            let a = random_point(&mut random, 1.5);
            let b = a + random_point(&mut random, 0.5).coords;
            let inside = |x: &Point3| shape.value(x) >= 1.0;
            if inside(&a) != inside(&b) {
                found.push([a, b]);
            }
        }
        found
    }

    /// False position with the kept end halved (Illinois), to 10⁻⁴: what a crossing must not be dearer than.
    fn illinois(ends: [f64; 2], mut value: impl FnMut(f64) -> f64) -> f64 {
        let (mut low, mut high) = ((0.0, ends[0]), (1.0, ends[1]));
        let (mut t, mut last) = (ends[0] / (ends[0] - ends[1]), None);
        for _ in 0..16 {
            let f = value(t);
            let is_low = (f >= 0.0) == (ends[0] >= 0.0);
            let (moved, kept) = if is_low {
                (&mut low, &mut high)
            } else {
                (&mut high, &mut low)
            };
            *moved = (t, f);
            if last == Some(is_low) {
                kept.1 *= 0.5;
            }
            last = Some(is_low);
            let next = low.0 - low.1 * (high.0 - low.0) / (high.1 - low.1);
            if !next.is_finite() || (next - t).abs() < 1e-4 {
                break;
            }
            t = next.clamp(low.0, high.0);
        }
        t
    }

    #[test]
    fn crossings_lie_on_the_level_set_and_cost_no_more_than_false_position() {
        let precision = Precision {
            place: 1e-4,
            value: 0.0,
        };
        for shape in &Shape::ALL {
            let (mut asked, mut asked_by_illinois) = (0, 0);
            for [a, b] in segments(shape, 5) {
                let height = |t: f64| shape.value(&(a + (b - a) * t)) - 1.0;
                let ends = [height(0.0), height(1.0)];
                let t = crossing(ends, precision, |t| {
                    asked += 1;
                    height(t)
                });
                // Between the places so near, the sign changes.
                let low = height((t - 2e-4).max(0.0)) >= 0.0;
                assert!(low != (height((t + 2e-4).min(1.0)) >= 0.0), "{a} {b} {t}");
                illinois(ends, |t| {
                    asked_by_illinois += 1;
                    height(t)
                });
            }
            assert!(asked <= asked_by_illinois, "{asked} {asked_by_illinois}");
            assert!(asked <= 500 * 5, "{asked}");
        }
    }

    #[test]
    fn crossings_to_a_value_are_as_near_as_asked() {
        let precision = Precision {
            place: 0.0,
            value: 1e-9,
        };
        for shape in &Shape::ALL {
            for [a, b] in segments(shape, 6) {
                let height = |t: f64| shape.value(&(a + (b - a) * t)).ln();
                let t = crossing([height(0.0), height(1.0)], precision, height);
                assert!(height(t).abs() < 1e-9, "{a} {b} {t}");
            }
        }
    }

    #[test]
    fn a_crossing_is_found_where_interpolation_fails() {
        let precision = Precision {
            place: 1e-6,
            value: 0.0,
        };
        let functions: [(&dyn Fn(f64) -> f64, f64); 5] = [
            // A step, a cliff, a flat start, a root at an end, values that are no numbers on one side.
            (&|t| if t < 0.7 { -1.0 } else { 1.0 }, 0.7),
            (&|t| (40.0 * (t - 0.9)).exp() - 1.0, 0.9),
            (&|t| t.powi(9) - 0.5f64.powi(9), 0.5),
            (&|t| t, 0.0),
            (&|t| if t < 0.3 { f64::NAN } else { t }, 0.3),
        ];
        for (k, (f, root)) in functions.into_iter().enumerate() {
            let t = crossing([-1.0, f(1.0)], precision, f);
            let allowed = if k == 0 || k == 4 { 1e-3 } else { 2e-6 };
            assert!((t - root).abs() < allowed, "function {k}: {t} for {root}");
        }
    }

    #[test]
    fn projections_end_at_the_level_set() {
        for shape in &Shape::ALL {
            let mut random = SplitMix64::new(7);
            let (mut asked, mut starts) = (0, 0);
            while starts < 500 {
                let x = random_point(&mut random, 1.6);
                let start = Tangent::new(shape, 1.0, x);
                if shape.distance(&x).abs() > 0.25 {
                    continue;
                }
                starts += 1;
                let found = project(start, &Guard::within(1.0), |x| {
                    asked += 1;
                    Some(Tangent::new(shape, 1.0, x))
                });
                assert_eq!(found.end, End::Near, "{x}");
                let foot = found.best.foot();
                assert!(shape.distance(&foot).abs() < 1e-6, "{x} {foot}");
                assert!((foot - x).norm() < 0.4, "{x} {foot}");
            }
            assert!(asked <= 3 * starts, "{asked}");
        }
    }

    #[test]
    fn projections_say_how_they_ended() {
        let look = |x: Point3| Some(Tangent::new(&Shape::Sphere, 1.0, x));
        let from = |x: f64| Tangent::new(&Shape::Sphere, 1.0, Point3::new(x, 0.0, 0.0));
        let far = Guard::within(0.5);
        // Beyond reach; no gradient in the middle; nowhere to look; a cell that must not be left.
        assert_eq!(project(from(2.0), &far, look).end, End::Away);
        assert_eq!(project(from(0.0), &far, look).end, End::Lost);
        assert_eq!(project(from(0.9), &far, |_| None).end, End::Lost);
        let held = project(from(0.7), &far, |x| {
            look(Point3::new(x.x.min(0.8), x.y, x.z))
        });
        assert_eq!((held.end, held.best.at.x), (End::Lost, 0.8));
        // Steps that overshoot: a level far above a steep field is never reached, but the best place is kept.
        let impossible = |x: Point3| Some(Tangent::new(&Shape::Sphere, 3.0, x));
        let start = Tangent::new(&Shape::Sphere, 3.0, Point3::new(0.5, 0.0, 0.0));
        let free = Guard {
            halvings: 0,
            reach: f64::INFINITY,
            ..Guard::within(1.0)
        };
        let found = project(start, &free, impossible);
        assert!(found.end != End::Near && found.best.height.abs() <= start.height.abs());
        let none = Tangent::new(&Shape::Sphere, 1.0, Point3::origin());
        assert_eq!(none.distance(), f64::INFINITY);
        assert_eq!((none.normal(), none.foot()), (Vector3::zeros(), none.at));
    }
}
