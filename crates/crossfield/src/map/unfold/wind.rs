//! Stars of triangles laid out by hand, where a vertex turns full turns too far or not far enough.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use crate::field::CrossField;
use crate::field::frames::{Frames, next, previous};
use crate::map::cones::{has_wrong_angle, wanted_angle};
use crate::map::system::System;

/// A star counts as upright when its triangles' determinants are above this.
const UPRIGHT: f64 = 1e-3;

/// No angle of a star is made wider that cannot be laid out in proportion.
const WIDEST: f64 = 0.8 * PI;

/// Where the angle around a vertex is full turns off, no energy that only keeps triangles upright mends it: they would have to
/// fold first. So the neighbours of these vertices are laid as they lie on the surface, with angles that add up, whatever
/// that does to the triangles around. Returns which triangles have to stay upright from then on: those of all singular
/// vertices of five or more quads, and of the vertices laid, whose angles are right.
///
/// `w` are the values of the system and change for the neighbours of the vertices laid. What has its right angle
/// already stays as it is, so that vertices laid one after the other share neighbours; where that leaves one of them
/// wrong, it takes what it needs from the others.
pub(super) fn wound(
    system: &System<'_>,
    frames: &Frames,
    field: &CrossField,
    vertices: &[usize],
    w: &mut [f64],
) -> Vec<usize> {
    let fan = |v: usize| frames.around(v).collect::<Vec<usize>>();
    let is_right = |fan: &[usize], corners: &[[[f64; 2]; 3]], v: usize| {
        let upright = |h: &usize| system.charts[h / 3].determinant(&corners[h / 3]) > UPRIGHT;
        !has_wrong_angle(frames, field, |f| corners[f], v) && fan.iter().all(upright)
    };
    let mut held = Vec::new();
    let mut placed = vec![false; field.index.len()];
    let mut hold = |v: usize, fan: &[usize], placed: &mut [bool]| {
        placed[v] = true;
        for &h in fan {
            placed[frames.from(next(h))] = true;
            held.push(h / 3);
        }
    };
    let mut corners = system.corners(w);
    let mut wrong: Vec<usize> = Vec::new();
    for v in (0..field.index.len()).filter(|&v| !frames.on_boundary(v)) {
        let fan = fan(v);
        let is_wanted = vertices.binary_search(&v).is_ok();
        match is_right(&fan, &corners, v) {
            true if field.index[v] < 0 || is_wanted => hold(v, &fan, &mut placed),
            false if is_wanted => wrong.push(v),
            _ => {}
        }
    }
    for v in wrong {
        let fan = fan(v);
        let before = w.to_vec();
        let mut lay = |widest: f64, stays: Stays<'_>| {
            w.copy_from_slice(&before);
            let laid = lay(
                system,
                wanted_angle(frames, field, v),
                &fan,
                &corners,
                widest,
                stays,
                w,
            );
            let laid = laid.then(|| system.corners(w));
            laid.filter(|laid| is_right(&fan, laid, v))
        };
        let is_placed = |h: usize| placed[frames.from(next(h))];
        let stays = [Stays::Placed(&is_placed), Stays::Bound, Stays::Nothing];
        // Angles in their proportions have smoother maps, where they are those of upright triangles.
        let laid = [f64::INFINITY, WIDEST]
            .into_iter()
            .find_map(|widest| stays.into_iter().find_map(|stays| lay(widest, stays)));
        match laid {
            Some(laid) => {
                corners = laid;
                hold(v, &fan, &mut placed);
            }
            None => w.copy_from_slice(&before),
        }
    }
    held.sort_unstable();
    held.dedup();
    // What one vertex was given another may have taken.
    held.retain(|&f| system.charts[f].determinant(&corners[f]) > UPRIGHT);
    held
}

/// Which neighbours the others are laid between.
#[derive(Clone, Copy)]
enum Stays<'a> {
    /// Those that were laid before, by their half-edges, and those that cannot move: on lines, and singular vertices.
    Placed(&'a dyn Fn(usize) -> bool),
    /// Those that cannot move.
    Bound,
    /// None, as if all could move.
    Nothing,
}

/// Lays the neighbours of a vertex around it: at their lengths, at angles stretched to add up, turned to fit the field best.
/// False if there is no such way.
///
/// On the surface the angles around the vertex may add up to anything, in the map they must add up to `total`.
fn lay(
    system: &System<'_>,
    total: f64,
    fan: &[usize],
    corners: &[[[f64; 2]; 3]],
    widest: f64,
    stays: Stays<'_>,
    w: &mut [f64],
) -> bool {
    let star = Star::of(system, total, fan, widest);
    let is_placed = |h: usize| matches!(stays, Stays::Placed(placed) if placed(h));
    let free: Vec<Option<[Free; 2]>> = fan
        .iter()
        .map(|&h| (!is_placed(h)).then(|| free(system, next(h))).flatten())
        .collect();
    let fixed: Vec<usize> = (0..fan.len()).filter(|&k| free[k].is_none()).collect();
    let directions = match stays {
        Stays::Placed(_) | Stays::Bound if !fixed.is_empty() => {
            star.directions_between(&fixed, corners)
        }
        _ => Some(star.directions()),
    };
    let Some(directions) = directions else {
        return false;
    };
    for (k, free) in free.iter().enumerate() {
        let Some(free) = free else { continue };
        let h = fan[k];
        let centre = corners[h / 3][h % 3];
        let length = star.spokes[k][0][0].hypot(star.spokes[k][0][1]);
        let (sine, cosine) = (directions[k] - star.turned[k]).sin_cos();
        let wanted = [centre[0] + length * cosine, centre[1] + length * sine];
        for (component, wanted) in wanted.into_iter().enumerate() {
            let Free { unknown, factor } = free[component];
            let row = system.seams.row(system.cut.copy[next(h)], component);
            let rest: f64 = row
                .filter(|&(l, _)| l != unknown)
                .map(|(l, c)| f64::from(c) * w[l])
                .sum();
            w[unknown] = (wanted - rest) / factor;
        }
    }
    true
}

/// The triangles around a vertex, unrolled.
struct Star<'a> {
    fan: &'a [usize],
    /// Per triangle its two sides from the vertex, as the field would have them.
    spokes: Vec<[[f64; 2]; 2]>,
    /// The angles between these.
    openings: Vec<f64>,
    /// Where 0 of the chart of each triangle is in that of the first.
    turned: Vec<f64>,
    /// What the angles in the map must add up to.
    total: f64,
    /// No angle is made wider, where that can be.
    widest: f64,
}

impl<'a> Star<'a> {
    fn of(system: &System<'_>, total: f64, fan: &'a [usize], widest: f64) -> Self {
        let spokes: Vec<[[f64; 2]; 2]> = fan
            .iter()
            .map(|&h| system.charts[h / 3].sides(h % 3))
            .collect();
        let opening = |&[a, b]: &[[f64; 2]; 2]| (angle(b) - angle(a)).rem_euclid(TAU);
        let mut turned = vec![0.0; fan.len()];
        for k in 1..fan.len() {
            let turn = system.cut.turn[previous(fan[k - 1])];
            turned[k] = turned[k - 1] + FRAC_PI_2 * f64::from(turn);
        }
        Self {
            fan,
            openings: spokes.iter().map(opening).collect(),
            spokes,
            turned,
            total,
            widest,
        }
    }

    /// Of the sides to the neighbours, if all of these may move: angles are [`stretched`], and all directions turned to those
    /// of the field.
    fn directions(&self) -> Vec<f64> {
        let angles = stretched(&self.openings, self.total, self.widest);
        let (mut at, mut sine, mut cosine) = (0.0, 0.0, 0.0);
        let mut directions = Vec::with_capacity(self.fan.len());
        for (k, opening) in angles.into_iter().enumerate() {
            directions.push(at);
            let off = angle(self.spokes[k][0]) + self.turned[k] - at;
            (sine, cosine) = (sine + off.sin(), cosine + off.cos());
            at += opening;
        }
        let first = sine.atan2(cosine);
        directions.iter_mut().for_each(|d| *d += first);
        directions
    }

    /// The same if some stay: the angles between each two of them are stretched, and full turns that are missing go where angles
    /// have shrunk most. `None` if there are turns too many.
    fn directions_between(&self, fixed: &[usize], corners: &[[[f64; 2]; 3]]) -> Option<Vec<f64>> {
        let count = self.fan.len();
        let actual = |k: usize| {
            let (uv, at) = (&corners[self.fan[k] / 3], self.fan[k] % 3);
            let to = next(self.fan[k]) % 3;
            angle([uv[to][0] - uv[at][0], uv[to][1] - uv[at][1]]) + self.turned[k]
        };
        // From each that stays to the next one, which may be itself.
        let gap = |(i, &from): (usize, &usize)| {
            let to = fixed[(i + 1) % fixed.len()];
            let steps = (to + count - from - 1) % count + 1;
            let around = if from + steps >= count {
                self.total
            } else {
                0.0
            };
            Gap {
                from,
                steps,
                natural: (0..steps).map(|s| self.openings[(from + s) % count]).sum(),
                angle: (actual(to) + around - actual(from)).rem_euclid(TAU),
            }
        };
        let mut gaps: Vec<Gap> = fixed.iter().enumerate().map(gap).collect();
        let missing = (self.total - gaps.iter().map(|g| g.angle).sum::<f64>()) / TAU;
        if missing.round() < 0.0 {
            return None;
        }
        for _ in 0..missing.round() as usize {
            let most = gaps
                .iter_mut()
                .max_by(|a, b| a.shrunk().total_cmp(&b.shrunk()));
            most?.angle += TAU;
        }
        let mut directions = vec![0.0; count];
        for gap in gaps {
            let mut direction = actual(gap.from);
            let openings: Vec<f64> = (gap.from..gap.from + gap.steps)
                .map(|s| self.openings[s % count])
                .collect();
            let angles = stretched(&openings, gap.angle, self.widest);
            for (s, angle) in (gap.from..gap.from + gap.steps - 1).zip(angles) {
                direction += angle;
                // Past the first spoke all is a turn around the vertex further on.
                let around = if s + 1 >= count { self.total } else { 0.0 };
                directions[(s + 1) % count] = direction - around;
            }
        }
        Some(directions)
    }
}

/// Angles that add up to a total: all multiplied by the same number, but for those that would be wider than the widest, since beyond
/// half a turn a triangle is not upright. All are equal where there are too few for that.
fn stretched(openings: &[f64], total: f64, widest: f64) -> Vec<f64> {
    let most = widest.max(total / openings.len() as f64);
    let mut is_widest = vec![false; openings.len()];
    loop {
        let (mut left, mut natural) = (total, 0.0);
        for (&opening, &is_widest) in openings.iter().zip(&is_widest) {
            if is_widest {
                left -= most;
            } else {
                natural += opening;
            }
        }
        let of = |(&opening, &is_widest): (&f64, &bool)| match is_widest {
            true => most,
            false => opening * left / natural,
        };
        let angles: Vec<f64> = openings.iter().zip(&is_widest).map(of).collect();
        let mut is_done = true;
        for (angle, is_widest) in angles.iter().zip(&mut is_widest) {
            if *angle > most * (1.0 + 1e-12) {
                (*is_widest, is_done) = (true, false);
            }
        }
        if is_done {
            return angles;
        }
    }
}

fn angle(p: [f64; 2]) -> f64 {
    p[1].atan2(p[0])
}

/// Neighbours of a vertex between two that stay where they are.
struct Gap {
    /// The spoke to the first that stays.
    from: usize,
    /// Triangles between the two.
    steps: usize,
    /// The angle on the surface, as the field would have it.
    natural: f64,
    /// The angle in the map.
    angle: f64,
}

impl Gap {
    fn shrunk(&self) -> f64 {
        self.natural - self.angle
    }
}

/// The real unknown that a coordinate hangs on.
struct Free {
    unknown: usize,
    factor: f64,
}

/// Those of both coordinates of a corner; `None` if it cannot move freely.
fn free(system: &System<'_>, corner: usize) -> Option<[Free; 2]> {
    let of = |component| {
        let row = system.seams.row(system.cut.copy[corner], component);
        let mut free = row.filter(|&(k, _)| k < system.seams.reals);
        match (free.next(), free.next()) {
            (Some((unknown, c)), None) => Some(Free {
                unknown,
                factor: f64::from(c),
            }),
            _ => None,
        }
    };
    Some([of(0)?, of(1)?])
}
