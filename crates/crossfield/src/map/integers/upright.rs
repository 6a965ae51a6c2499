//! The triangles of a decimated map as conditions on its integers.
//!
//! Corners are integers, so that twice the area of a triangle is one: it is upright if that is 1 or more, and by how
//! much it falls short of 1 is an integer as well. Rounding adds these shortages up and walks downhill until the sum
//! vanishes. A step changes one integer or two, on which few triangles hang, so that it costs time for these alone.

use crate::map::transition::Sum;

/// Two sides of a triangle, two components each.
pub(in crate::map) type Sides = [i64; 4];

/// A move by one, or of two integers at once.
pub(in crate::map) type Pair = [(usize, f64); 2];

/// A sum of integers that shall not be less than a number.
#[derive(Clone, Debug)]
pub(crate) struct AtLeast {
    pub(super) sum: Sum,
    pub(super) bound: i64,
}

#[cfg(feature = "testing")]
impl AtLeast {
    /// The sum, of numbers that need not be integers.
    pub(crate) fn value(&self, z: &[f64]) -> f64 {
        self.sum
            .iter()
            .map(|&(k, c)| c as f64 * z[k as usize])
            .sum()
    }
}

/// Triangles whose sides are integer sums of integers, which shall be upright.
pub(in crate::map) struct Upright {
    /// The sides of all triangles where all integers are 0.
    zero: Vec<Sides>,
    /// Per integer, the triangles that depend on it and what one more of it adds to their sides; ascending.
    of: Vec<Vec<(u32, Sides)>>,
    /// Per triangle, the integers that it depends on.
    on: Vec<Vec<u32>>,
    /// What the first triangles are in the relaxed map. Conditions that are none have no shape.
    shapes: Vec<Shape>,
}

/// A triangle of the relaxed map.
#[derive(Clone, Copy)]
struct Shape {
    /// The inverse of the matrix whose columns are its sides, row after row.
    inverse: [[f64; 2]; 2],
    area: f64,
}

impl Shape {
    fn of([p, q]: &[[f64; 2]; 2]) -> Self {
        let doubled = p[0] * q[1] - p[1] * q[0];
        Self {
            inverse: [[q[1], -q[0]], [-p[1], p[0]]].map(|row| row.map(|x| x / doubled)),
            area: 0.5 * doubled,
        }
    }

    /// The matrix that takes the triangle to one with these sides.
    fn to(&self, &[px, py, qx, qy]: &Sides) -> [f64; 4] {
        let [a, b] = self.inverse;
        let row = |p: i64, q: i64| [0, 1].map(|c| p as f64 * a[c] + q as f64 * b[c]);
        let ([ux, uy], [vx, vy]) = (row(px, qx), row(py, qy));
        [ux, uy, vx, vy]
    }

    /// How much a triangle with these sides is another: `area · |J − 1|²`.
    fn strain(&self, sides: &Sides) -> f64 {
        let [a, b, c, d] = self.to(sides);
        self.area * [a - 1.0, b, c, d - 1.0].map(|x| x * x).iter().sum::<f64>()
    }
}

impl Upright {
    /// Of the sides from the first corner of each triangle to the second and the third, and what they are in the relaxed map.
    pub(super) fn new(triangles: &[[[Sum; 2]; 2]], relaxed: &[[[f64; 2]; 2]]) -> Self {
        let mut of: Vec<Vec<(u32, Sides)>> = Vec::new();
        let mut on = vec![Vec::new(); triangles.len()];
        for (t, sides) in (0u32..).zip(triangles) {
            for (slot, form) in sides.as_flattened().iter().enumerate() {
                for &(k, c) in form {
                    let k = k as usize;
                    if of.len() <= k {
                        of.resize(k + 1, Vec::new());
                    }
                    if of[k].last().is_none_or(|last| last.0 != t) {
                        of[k].push((t, [0; 4]));
                        on[t as usize].push(k as u32);
                    }
                    let last = of[k].len() - 1;
                    of[k][last].1[slot] = c;
                }
            }
        }
        Self {
            zero: vec![[0; 4]; triangles.len()],
            of,
            on,
            shapes: relaxed.iter().map(Shape::of).collect(),
        }
    }

    /// More conditions, each as a triangle of height 1 whose base falls short of 1 as the sum does of its bound.
    pub(in crate::map) fn add(&mut self, conditions: &[AtLeast]) {
        for AtLeast { sum, bound } in conditions {
            let t = self.zero.len() as u32;
            self.zero.push([1 - bound, 0, 0, 1]);
            self.on.push(sum.iter().map(|t| t.0).collect());
            for &(k, c) in sum {
                let k = k as usize;
                if self.of.len() <= k {
                    self.of.resize(k + 1, Vec::new());
                }
                self.of[k].push((t, [c, 0, 0, 0]));
            }
        }
    }

    /// The sides of all triangles.
    pub(super) fn sides(&self, z: &[f64]) -> Vec<Sides> {
        let mut sides = self.zero.clone();
        for (k, z) in z.iter().enumerate() {
            self.shift(&mut sides, k, *z);
        }
        sides
    }

    /// The integers that a triangle depends on.
    pub(super) fn on(&self, t: usize) -> &[u32] {
        &self.on[t]
    }

    /// The triangles that depend on an integer, and what one more of it adds to their sides; ascending.
    pub(super) fn of(&self, k: usize) -> &[(u32, Sides)] {
        self.of.get(k).map_or(&[], Vec::as_slice)
    }

    /// Adds to one integer.
    pub(super) fn shift(&self, sides: &mut [Sides], k: usize, by: f64) {
        for (t, sum) in self.of(k) {
            added(&mut sides[*t as usize], sum, by);
        }
    }

    /// Does a move change none of the triangles that others have changed? Then its own are from now on.
    pub(super) fn is_apart(&self, pair: &Pair, changed: &mut [bool]) -> bool {
        let own = || {
            let moved = pair.iter().filter(|(_, by)| *by != 0.0);
            let all = moved.flat_map(|(k, _)| self.of(*k));
            all.map(|entry| entry.0 as usize)
        };
        let is_apart = own().all(|t| !changed[t]);
        if is_apart {
            own().for_each(|t| changed[t] = true);
        }
        is_apart
    }

    /// 0 where all triangles are upright.
    /// The sum over all triangles, in 128 bits, as products of two sides of 64 bits need them.
    pub(super) fn shortages(&self, sides: &[Sides]) -> i128 {
        sides.iter().map(shortage).sum()
    }

    /// How much more a move makes triangles differ from those of the relaxed map.
    pub(super) fn strain(&self, pair: &Pair, sides: &[Sides]) -> f64 {
        let mut strain = 0.0;
        changed(
            sides,
            pair,
            |k| self.of(k),
            |t, before, after| {
                if let Some(shape) = self.shapes.get(t) {
                    strain += shape.strain(after) - shape.strain(before);
                }
                true
            },
        );
        strain
    }

    /// The integers of which there are so many that have triangles in common with one, and half the second derivative of the strain by both.
    pub(super) fn coupled(&self, k: usize, integers: usize) -> Vec<(usize, f64)> {
        let mut couplings = vec![0.0; integers];
        for (t, own) in self.of(k) {
            let Some(shape) = self.shapes.get(*t as usize) else {
                continue;
            };
            let own = shape.to(own);
            for &other in &self.on[*t as usize] {
                let all = &self.of[other as usize];
                let at = all.partition_point(|entry| entry.0 < *t);
                let product = own.iter().zip(shape.to(&all[at].1));
                let product: f64 = product.map(|(a, b)| a * b).sum();
                couplings[other as usize] += shape.area * product;
            }
        }
        let all = couplings.into_iter().enumerate();
        all.filter(|&(other, coupling)| other != k && coupling != 0.0)
            .collect()
    }

    /// Are all upright?
    pub(in crate::map) fn holds(&self, z: &[f64]) -> bool {
        self.shortages(&self.sides(z)) == 0
    }

    /// The integers of the triangles that are not upright, with what one more of each adds to the sides of these.
    pub(super) fn short(&self, sides: &[Sides]) -> Short {
        let is_short = |&t: &usize| shortage(&sides[t]) > 0;
        let mut entries: Vec<(u32, u32)> = (0..sides.len())
            .filter(is_short)
            .flat_map(|t| self.on[t].iter().map(move |&k| (k, t as u32)))
            .collect();
        entries.sort_unstable();
        let mut short = Short {
            integers: Vec::new(),
            place: vec![None; self.of.len()],
            of: Vec::new(),
        };
        for (k, t) in entries {
            let all = &self.of[k as usize];
            if short.integers.last() != Some(&(k as usize)) {
                short.place[k as usize] = Some(short.integers.len() as u32);
                short.integers.push(k as usize);
                short.of.push(Vec::new());
            }
            let at = all.partition_point(|entry| entry.0 < t);
            let last = short.of.len() - 1;
            short.of[last].push(all[at]);
        }
        short
    }

    /// Those that are not upright weigh one more.
    pub(super) fn weigh_short(&self, sides: &[Sides], weights: &mut [i128]) {
        for (weight, sides) in weights.iter_mut().zip(sides) {
            *weight += i128::from(shortage(sides) > 0);
        }
    }
}

/// The part of [`Upright`] that is about triangles which are not upright: few of all, so that what a move may gain at most is
/// known before what it costs.
pub(super) struct Short {
    /// Ascending.
    pub(super) integers: Vec<usize>,
    /// Of all integers, their places among these.
    place: Vec<Option<u32>>,
    /// Per place, triangles and what one more adds to their sides; ascending.
    of: Vec<Vec<(u32, Sides)>>,
}

impl Short {
    fn of(&self, k: usize) -> &[(u32, Sides)] {
        let place = self.place.get(k).copied().flatten();
        place.map_or(&[], |place| &self.of[place as usize])
    }
}

/// How much each triangle counts that falls short of upright.
#[derive(Clone, Copy)]
pub(super) struct Weighed<'a> {
    pub(super) upright: &'a Upright,
    /// As they are before the move.
    pub(super) sides: &'a [Sides],
    /// 1 or more, per triangle.
    pub(super) weights: &'a [i128],
}

impl Weighed<'_> {
    /// What a move changes of the shortages.
    pub(super) fn change(&self, pair: &Pair) -> i128 {
        self.sum(pair, |k| self.upright.of(k))
    }

    /// The same of triangles that are not upright alone: all others can only fall short.
    pub(super) fn least_change(&self, pair: &Pair, short: &Short) -> i128 {
        self.sum(pair, |k| short.of(k))
    }

    /// The sum over the triangles that are given for each integer.
    fn sum<'s>(&self, pair: &Pair, of: impl Fn(usize) -> &'s [(u32, Sides)]) -> i128 {
        let mut change = 0;
        changed(self.sides, pair, of, |t, before, after| {
            change += self.weights[t] * (shortage(after) - shortage(before));
            true
        });
        change
    }
}

/// Tells the triangles that a move changes, of those given for each integer, with their sides before and after it, until it
/// is told to stop.
fn changed<'s>(
    sides: &[Sides],
    [(i, d), (j, e)]: &Pair,
    of: impl Fn(usize) -> &'s [(u32, Sides)],
    mut goes_on: impl FnMut(usize, &Sides, &Sides) -> bool,
) {
    let list = |k: usize, by: f64| if by == 0.0 { &[] } else { of(k) };
    let (mut first, mut second) = (list(*i, *d), list(*j, *e));
    // Both lists ascend: triangles in either, each once.
    loop {
        let t = match (first.first(), second.first()) {
            (None, None) => return,
            (Some(a), None) => a.0,
            (None, Some(b)) => b.0,
            (Some(a), Some(b)) => a.0.min(b.0),
        };
        let before = sides[t as usize];
        let mut after = before;
        for (list, by) in [(&mut first, *d), (&mut second, *e)] {
            if let Some((head, rest)) = list.split_first()
                && head.0 == t
            {
                added(&mut after, &head.1, by);
                *list = rest;
            }
        }
        if !goes_on(t as usize, &before, &after) {
            return;
        }
    }
}

/// Which moves turn a triangle over, of triangles that are upright and stay so. What was found holds until one of the
/// move's triangles changes: of ten thousand moves that a step may ask for, few have to be looked at again.
pub(super) struct Guard<'a> {
    upright: &'a Upright,
    sides: Vec<Sides>,
    /// Per move the step in which it was found to turn one over, from 1; 0 if it was not.
    found: Vec<u32>,
    /// Per integer the last step that changed a triangle of its.
    changed: Vec<u32>,
    step: u32,
}

impl<'a> Guard<'a> {
    /// Of so many moves, from these integers on.
    pub(super) fn new(upright: &'a Upright, z: &[f64], moves: usize) -> Self {
        Self {
            upright,
            sides: upright.sides(z),
            found: vec![0; moves],
            changed: vec![0; z.len()],
            step: 1,
        }
    }

    /// Is a move, by its number, known to turn one over?
    pub(super) fn knows(&self, number: usize, [(i, _), (j, _)]: &Pair) -> bool {
        self.found[number] > self.changed[*i].max(self.changed[*j])
    }

    /// Does it turn one over?
    pub(super) fn forbids(&mut self, number: usize, pair: &Pair) -> bool {
        let mut turns = false;
        changed(
            &self.sides,
            pair,
            |k| self.upright.of(k),
            |_, _, after| {
                turns = shortage(after) > 0;
                !turns
            },
        );
        if turns {
            self.found[number] = self.step;
        }
        turns
    }

    /// Makes a move, which ends a step.
    pub(super) fn make(&mut self, pair: &Pair) {
        for &(k, d) in pair.iter().filter(|(_, d)| *d != 0.0) {
            self.upright.shift(&mut self.sides, k, d);
            for (t, _) in self.upright.of(k) {
                for &other in &self.upright.on[*t as usize] {
                    self.changed[other as usize] = self.step;
                }
            }
        }
        self.step += 1;
    }
}

/// `by` holds a whole number.
pub(super) fn added(sides: &mut Sides, sum: &Sides, by: f64) {
    for (side, c) in sides.iter_mut().zip(sum) {
        *side += c * by.round() as i64;
    }
}

/// By how much twice the area falls short of 1.
pub(super) fn shortage([px, py, qx, qy]: &Sides) -> i128 {
    let product = |a: i64, b: i64| i128::from(a) * i128::from(b);
    (1 - (product(*px, *qy) - product(*py, *qx))).max(0)
}

/// See `testing::guarded`: what the [`Guard`] says, which remembers, and what the conditions say.
#[cfg(feature = "testing")]
pub(crate) fn guarded(
    count: usize,
    conditions: &[Vec<(u32, i64)>],
    moves: &[[usize; 2]],
) -> Vec<[bool; 2]> {
    let all = conditions.iter().map(|sum| AtLeast {
        sum: sum.clone(),
        bound: -1,
    });
    let conditions: Vec<AtLeast> = all.collect();
    let mut upright = Upright::new(&[], &[]);
    upright.add(&conditions);
    let mut z = vec![0.0; count];
    let mut guard = Guard::new(&upright, &z, 4 * count * count);
    let by_one = |at: usize| (at / 2, [-1.0, 1.0][at % 2]);
    let judge = |&[first, second]: &[usize; 2]| {
        let (number, mut pair) = (2 * count * first + second, [first, second].map(by_one));
        if pair[0].0 == pair[1].0 {
            pair[1].1 = 0.0;
        }
        let may = !guard.knows(number, &pair) && !guard.forbids(number, &pair);
        let mut moved = z.clone();
        pair.iter().for_each(|&(k, by)| moved[k] += by);
        let holds = conditions.iter().all(|c| c.value(&moved) >= c.bound as f64);
        if may {
            guard.make(&pair);
            z = moved;
        }
        [may, holds]
    };
    moves.iter().map(judge).collect()
}
