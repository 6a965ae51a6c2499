//! Ways to level sets: crossings of segments, projections along gradients.

use geom_core::compute::random::SplitMix64;
use geom_core::field::{End, Guard, Precision, Tangent, crossing, crossings, project, projections};
use geom_core::{ImplicitField, Point3, Vector3};

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

/// Many at a time find what each finds alone, bit for bit, and ask for nothing else.
#[test]
fn many_at_a_time_are_as_each_alone() {
    let precision = Precision {
        place: 1e-4,
        value: 0.0,
    };
    for shape in &Shape::ALL {
        let segments = segments(shape, 9);
        let height = |i: usize, t: f64| {
            let [a, b] = segments[i];
            shape.value(&(a + (b - a) * t)) - 1.0
        };
        let ends: Vec<[f64; 2]> = (0..segments.len())
            .map(|i| [0.0, 1.0].map(|t| height(i, t)))
            .collect();
        let (mut alone_asked, mut most_asked, mut asked, mut calls) = (0, 0, 0, 0);
        let together = crossings(&ends, precision, |places, out| {
            (asked, calls) = (asked + places.len(), calls + 1);
            out.extend(places.iter().map(|&(i, t)| height(i, t)));
            Ok::<(), ()>(())
        });
        for (i, t) in together.unwrap().into_iter().enumerate() {
            let mut times = 0;
            let alone = crossing(ends[i], precision, |t| {
                times += 1;
                height(i, t)
            });
            assert_eq!(t.to_bits(), alone.to_bits(), "{i}");
            (alone_asked, most_asked) = (alone_asked + times, most_asked.max(times));
        }
        assert_eq!((asked, calls), (alone_asked, most_asked));

        let starts: Vec<Tangent> = segments
            .iter()
            .map(|[a, _]| Tangent::new(shape, 1.0, *a))
            .collect();
        let look = |x: Point3| (x.z < 1.4).then(|| Tangent::new(shape, 1.0, x));
        let guard = Guard::within(0.6);
        let together = projections(&starts, &guard, |places, out| {
            out.extend(places.iter().map(|&(_, x)| look(x)));
            Ok::<(), ()>(())
        });
        for (start, found) in starts.iter().zip(together.unwrap()) {
            assert_eq!(found, project(*start, &guard, look));
        }
        assert_eq!(crossings(&ends, precision, |_, _| Err(7)), Err(7));
        assert_eq!(projections(&starts, &guard, |_, _| Err(7)), Err(7));
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
