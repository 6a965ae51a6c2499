//! The nearest point of a surface: a tree of triangles says where to start, Newton's method goes on, across seams where
//! it must.
//!
//! The nearest point x(s, t) to a point p satisfies `(x − p) · x_s = (x − p) · x_t = 0`, two equations that Newton's method solves in
//! a few steps from a place nearby, and that have many other solutions far away. So the start decides: it is the nearest point of
//! a triangulation. Where a step leaves the unit square of its patch it goes on in the neighbour's, whose parameters are turned.

use geom_core::compute::parallel;
use geom_core::search::bvh::TriangleTree;
use geom_core::{Cpu, Point3, Run};

use super::seams::Seams;
use super::tessellate::{Tessellation, tessellate_on};
use super::{Jet, Surface};
use crate::Error;
use crate::backend::SplineBackend;

/// Steps along a side of a patch in the triangles that are searched.
const STEPS: u32 = 3;
/// Most steps of Newton's method in a patch.
const NEWTON: usize = 20;
/// Most patches that a search crosses.
const CROSSINGS: usize = 6;

/// The point of a surface nearest to another.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Nearest {
    /// The patch.
    pub patch: u32,
    /// The parameters in it.
    pub at: [f64; 2],
    /// The point.
    pub point: Point3,
    /// Its distance, Å.
    pub distance: f64,
}

/// Finds nearest points on a surface; made once, asked often.
#[derive(Clone, Debug)]
pub struct Search<'a> {
    surface: &'a Surface,
    seams: Seams,
    /// With parameters at the corners of its triangles, which are where a search starts.
    tessellation: Tessellation,
    tree: TriangleTree,
}

impl<'a> Search<'a> {
    /// Over a surface.
    ///
    /// A triangulation of about 18 triangles per patch and a tree over them: n log n for n patches.
    ///
    /// # Errors
    /// [`Error::Mesh`] if the surface has no finite triangles.
    pub fn new(surface: &'a Surface) -> Result<Self, Error> {
        let seams = Seams::of(surface);
        let tessellation =
            tessellate_on(surface, &seams, STEPS, Run::on(&Cpu as &dyn SplineBackend))?;
        let tree = TriangleTree::new(&tessellation.mesh)?;
        Ok(Self {
            surface,
            seams,
            tessellation,
            tree,
        })
    }

    /// Its triangles.
    pub fn tessellation(&self) -> &Tessellation {
        &self.tessellation
    }

    /// The nearest point: exact to rounding where the surface is flatter than `1 / distance`, as near a point as the
    /// triangles tell where several are equally near.
    ///
    /// About the time of one question to the tree and a few evaluations of the surface. Nothing of the surface is
    /// changed, so that many may ask at a time.
    pub fn nearest(&self, to: &Point3) -> Nearest {
        let start = self.tree.closest(to);
        let triangle = start.triangle as usize;
        let corners = self.tessellation.parameters[triangle];
        let mut at = [0.0; 2];
        for (corner, weight) in corners.iter().zip(start.barycentric) {
            at[0] += corner[0] * weight;
            at[1] += corner[1] * weight;
        }
        let mut best = self.newton(self.tessellation.patches[triangle], at, to);
        for _ in 0..CROSSINGS {
            let Some(better) = self
                .across(&best, to)
                .map(|(patch, at)| self.newton(patch, at, to))
                .filter(|found| found.distance < best.distance * (1.0 - 1e-12))
                .min_by(|a, b| a.distance.total_cmp(&b.distance))
            else {
                break;
            };
            best = better;
        }
        best
    }

    /// The nearest points to many; parallel.
    pub fn nearest_to_all(&self, to: &[Point3]) -> Vec<Nearest> {
        parallel::map_each(to, |p| self.nearest(p))
    }

    /// Where the patches go on that lie across the sides on which a point is and beyond which the distance falls.
    /// Of sides without a neighbour, and of places inside of the patch, there is nothing.
    fn across(&self, from: &Nearest, to: &Point3) -> impl Iterator<Item = (u32, [f64; 2])> {
        let [s, t] = from.at;
        let patch = from.patch as usize;
        let jet = Jet::of(&self.surface.patches()[patch], from.at);
        let off = jet.point - to;
        let [to_s, to_t] = jet.first.map(|d| d.dot(&off));
        let sides = [
            (t <= 0.0 && to_t > 0.0, 0, s),
            (s >= 1.0 && to_s < 0.0, 1, t),
            (t >= 1.0 && to_t < 0.0, 2, 1.0 - s),
            (s <= 0.0 && to_s > 0.0, 3, 1.0 - t),
        ];
        let on = sides.into_iter().filter(|side| side.0);
        on.flat_map(move |(_, side, u)| {
            self.seams
                .side(patch, side)
                .iter()
                .filter_map(move |&(number, forward)| {
                    let segment = &self.seams.segments[number as usize];
                    let other = segment.other?;
                    let (own, beyond) = if forward {
                        (segment.owner, other)
                    } else {
                        (other, segment.owner)
                    };
                    let [a, b] = own.range;
                    let share = (u - a) / (b - a);
                    (-1e-9..=1.0 + 1e-9)
                        .contains(&share)
                        .then(|| (beyond.patch, beyond.at(share.clamp(0.0, 1.0))))
                })
        })
    }

    /// Newton's method for the distance in one patch, kept within it.
    /// Every step that is taken brings the point nearer; steps that do not are halved, down to a hundredth.
    fn newton(&self, patch: u32, mut at: [f64; 2], to: &Point3) -> Nearest {
        let points = &self.surface.patches()[patch as usize];
        let found = |at: [f64; 2], jet: &Jet| Nearest {
            patch,
            at,
            point: jet.point,
            distance: (jet.point - to).norm(),
        };
        at = at.map(|x| x.clamp(0.0, 1.0));
        let mut jet = Jet::of(points, at);
        let mut best = found(at, &jet);
        for _ in 0..NEWTON {
            let off = jet.point - to;
            let gradient = jet.first.map(|d| d.dot(&off));
            // A parameter at its end stays there while the distance falls outwards.
            let free = [0, 1].map(|k| {
                !((at[k] <= 0.0 && gradient[k] > 0.0) || (at[k] >= 1.0 && gradient[k] < 0.0))
            });
            let step = step(&jet, &off, gradient, free);
            let length = step[0].abs().max(step[1].abs());
            if length < 1e-12 {
                break;
            }
            let mut scale = 1.0;
            let moved = loop {
                let next = [0, 1].map(|k| (at[k] + scale * step[k]).clamp(0.0, 1.0));
                let there = Jet::of(points, next);
                let candidate = found(next, &there);
                if candidate.distance < best.distance {
                    let moved = (next[0] - at[0]).abs().max((next[1] - at[1]).abs());
                    (at, jet, best) = (next, there, candidate);
                    break moved;
                }
                scale *= 0.5;
                if scale < 1e-2 {
                    break 0.0;
                }
            };
            // The error is squared in each step: the next one would be lost in rounding.
            if moved < 1e-9 {
                break;
            }
        }
        best
    }
}

/// The step of Newton's method over the free parameters, of Gauss and Newton's where that does not descend.
///
/// A parameter that is not free keeps its value. Gauss and Newton's equations leave the second derivatives out, and
/// always descend.
fn step(jet: &Jet, off: &geom_core::Vector3, gradient: [f64; 2], free: [bool; 2]) -> [f64; 2] {
    let [xs, xt] = &jet.first;
    let metric = [xs.dot(xs), xs.dot(xt), xt.dot(xt)];
    let curved: [f64; 3] = std::array::from_fn(|k| metric[k] + jet.second[k].dot(off));
    let solve = |[a, b, c]: [f64; 3]| match free {
        [true, true] => {
            let det = a * c - b * b;
            let positive = a > 0.0 && det > 1e-12 * a * c;
            let [g, h] = gradient;
            positive.then(|| [(b * h - c * g) / det, (b * g - a * h) / det])
        }
        [true, false] => (a > 0.0).then(|| [-gradient[0] / a, 0.0]),
        [false, true] => (c > 0.0).then(|| [0.0, -gradient[1] / c]),
        [false, false] => None,
    };
    solve(curved).or_else(|| solve(metric)).unwrap_or_default()
}
