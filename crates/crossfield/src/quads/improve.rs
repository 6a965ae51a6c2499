//! Better quads: vertices move on the surface until corners are right angles.

use geom_core::compute::BackendError;
use geom_core::surface::ground::{Freedom, Ground};
use geom_core::{Point3, QuadMesh, Vector3};

use super::quality::{mean_sides, scaled_jacobian};
use crate::Error;
use crate::backend::{Corner, CornerDistortion, On};

/// Steps of the flow.
const STEPS: usize = 100;
/// The flow stands still when the energy falls by less, relatively.
const STILL: f64 = 1e-5;
/// Quads below this are worked on one by one after the flow.
const GOAL: f64 = 0.6;
/// Rounds of that.
const ROUNDS: usize = 24;

/// Moves vertices down the gradient of the corners' distortion (Eqs. 5.5–5.7, signed), back onto the surface after each
/// step, and then those of the worst quads to where these are best. Quads keep the proportions of their sides where
/// these are above `narrowest`, which is 1 for squares. Where the flow ends with a smallest scaled Jacobian below 0.6
/// and below the largest that it met, it goes back to that before the worst are moved.
pub(crate) fn improve(
    mesh: QuadMesh,
    narrowest: f64,
    ground: &Ground<'_>,
    freedom: &[Freedom],
    run: On<'_>,
) -> Result<QuadMesh, Error> {
    let mut flow = Flow::new(mesh, narrowest, ground, freedom, run);
    flow.run()?;
    flow.lift_the_worst();
    Ok(QuadMesh::new(flow.positions, flow.quads)?)
}

/// Vertices on the surface, as near as possible to where they were.
pub(crate) fn settled(
    mesh: QuadMesh,
    ground: &Ground<'_>,
    freedom: &[Freedom],
    run: On<'_>,
) -> Result<QuadMesh, Error> {
    let flow = Flow::new(mesh, 1.0, ground, freedom, run);
    Ok(QuadMesh::new(flow.positions, flow.quads)?)
}

struct Flow<'a> {
    quads: Vec<[u32; 4]>,
    positions: Vec<Point3>,
    normals: Vec<Vector3>,
    /// What the first and third side of each quad shall be long, and the others.
    lengths: Vec<[f64; 2]>,
    ground: &'a Ground<'a>,
    freedom: &'a [Freedom],
    run: On<'a>,
    out: Vec<CornerDistortion>,
    around: Vec<Vec<u32>>,
}

impl<'a> Flow<'a> {
    fn new(
        mesh: QuadMesh,
        narrowest: f64,
        ground: &'a Ground<'a>,
        freedom: &'a [Freedom],
        run: On<'a>,
    ) -> Self {
        let (positions, quads) = mesh.into_parts();
        let mut around = vec![Vec::new(); positions.len()];
        for (q, quad) in (0u32..).zip(&quads) {
            for &v in quad {
                around[v as usize].push(q);
            }
        }
        let of = |q: &[u32; 4]| lengths(&q.map(|v| positions[v as usize]), narrowest);
        let lengths = quads.iter().map(of).collect();
        let mut flow = Self {
            quads,
            normals: vec![Vector3::zeros(); positions.len()],
            positions,
            lengths,
            ground,
            freedom,
            run,
            out: Vec::new(),
            around,
        };
        flow.settle();
        flow
    }

    /// Everything back onto the surface.
    fn settle(&mut self) {
        use rayon::prelude::*;
        let (ground, freedom) = (self.ground, self.freedom);
        let settled: Vec<(Point3, Vector3)> = self
            .positions
            .par_iter()
            .zip(freedom)
            .map(|(p, &freedom)| ground.pulled(p, freedom))
            .collect();
        (self.positions, self.normals) = settled.into_iter().unzip();
    }

    fn distortions(&mut self, epsilon: f64) -> Result<(), Error> {
        let corners: Vec<Corner> = self
            .quads
            .iter()
            .zip(&self.lengths)
            .flat_map(|(quad, &lengths)| {
                let p = quad.map(|v| self.positions[v as usize]);
                let normals = &self.normals;
                (0..4).map(move |k| Corner {
                    sides: [0, 1].map(|s| (p[(k + 1 + 2 * s) % 4] - p[k]) / lengths[(k + s) % 2]),
                    normal: normals[quad[k] as usize],
                })
            })
            .collect();
        self.run
            .backend
            .corner_distortion(&corners, epsilon, &mut self.out)?;
        let (found, of) = (self.out.len(), corners.len());
        Ok(BackendError::unless(
            found == of,
            &self.run.backend.name(),
            || format!("{found} distortions for {of} corners"),
        )?)
    }

    fn energy(&self) -> f64 {
        self.out.iter().map(|c| c.energy).sum()
    }

    fn smallest_area(&self) -> f64 {
        self.out
            .iter()
            .map(|c| c.area)
            .fold(f64::INFINITY, f64::min)
    }

    /// Displacements for a step of one: down the gradient, in units of the sides.
    fn descent(&self) -> Vec<Vector3> {
        let mut gradient = vec![Vector3::zeros(); self.positions.len()];
        let mut scale = vec![0.0; self.positions.len()];
        for (q, quad) in self.quads.iter().enumerate() {
            let lengths = self.lengths[q];
            let side = lengths[0].min(lengths[1]);
            for k in 0..4 {
                let of = &self.out[4 * q + k];
                let [to_next, to_previous] = [0, 1].map(|s| of.gradient[s] / lengths[(k + s) % 2]);
                gradient[quad[(k + 1) % 4] as usize] += to_next;
                gradient[quad[(k + 3) % 4] as usize] += to_previous;
                gradient[quad[k] as usize] -= to_next + to_previous;
                scale[quad[k] as usize] += side * side / self.around[quad[k] as usize].len() as f64;
            }
        }
        (0..gradient.len())
            .map(|v| {
                if self.freedom[v] == Freedom::Fixed {
                    return Vector3::zeros();
                }
                let n = self.normals[v];
                let tangential = gradient[v] - n * n.dot(&gradient[v]);
                let step = -tangential * scale[v];
                // No vertex jumps over its neighbours.
                let most = 0.3 * scale[v].sqrt();
                if step.norm() > most {
                    step * (most / step.norm())
                } else {
                    step
                }
            })
            .collect()
    }

    fn run(&mut self) -> Result<(), Error> {
        let mut best = (self.smallest_jacobian(), self.positions.clone());
        let mut tau = 0.1;
        for step in 0..STEPS {
            self.run.progress("improve", step as u64, STEPS as u64)?;
            self.distortions(0.0)?;
            let smallest = self.smallest_area();
            let epsilon = if smallest <= 1e-3 {
                (0.5 * smallest.abs()).max(1e-2)
            } else {
                0.0
            };
            if epsilon > 0.0 {
                self.distortions(epsilon)?;
            }
            let before = self.energy();
            let direction = self.descent();
            let start = (self.positions.clone(), self.normals.clone());
            let mut after = None;
            for _ in 0..12 {
                for (v, p) in self.positions.iter_mut().enumerate() {
                    *p = start.0[v] + direction[v] * tau;
                }
                self.settle();
                self.distortions(epsilon)?;
                let energy = self.energy();
                let upright = epsilon > 0.0 || self.smallest_area() > 0.0;
                if energy < before && upright {
                    after = Some(energy);
                    break;
                }
                tau *= 0.5;
            }
            let Some(after) = after else {
                (self.positions, self.normals) = start;
                break;
            };
            let smallest = self.smallest_jacobian();
            if smallest > best.0 {
                best = (smallest, self.positions.clone());
            }
            if before - after < STILL * before && epsilon == 0.0 {
                break;
            }
            tau = (tau * 1.5).min(1.0);
        }
        // The sum may fall while the worst corner does: keep the best of both unless the worst is fine.
        if self.smallest_jacobian() < best.0.min(GOAL) {
            self.positions = best.1;
            self.settle();
        }
        Ok(())
    }

    fn jacobian(&self, q: u32) -> f64 {
        let quad = self.quads[q as usize];
        let normal: Vector3 = quad.iter().map(|&v| self.normals[v as usize]).sum();
        scaled_jacobian(&quad.map(|v| self.positions[v as usize]), &normal)
    }

    fn smallest_jacobian(&self) -> f64 {
        let all = (0..self.quads.len() as u32).map(|q| self.jacobian(q));
        all.fold(f64::INFINITY, f64::min)
    }

    fn worst_around(&self, v: usize) -> f64 {
        let all = self.around[v].iter().map(|&q| self.jacobian(q));
        all.fold(f64::INFINITY, f64::min)
    }

    /// Vertices of bad quads search the directions of a compass for a place where the worst quad around them is
    /// better.
    fn lift_the_worst(&mut self) {
        let mut step = 0.25;
        for _ in 0..ROUNDS {
            let mut bad: Vec<(f64, u32)> = (0..self.quads.len() as u32)
                .map(|q| (self.jacobian(q), q))
                .filter(|&(j, _)| j < GOAL)
                .collect();
            if bad.is_empty() {
                return;
            }
            bad.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
            let mut moved = false;
            for (_, q) in bad {
                for v in self.quads[q as usize] {
                    moved |= self.search(v as usize, step);
                }
            }
            if !moved {
                step *= 0.5;
            }
        }
    }

    fn search(&mut self, v: usize, step: f64) -> bool {
        if self.freedom[v] == Freedom::Fixed {
            return false;
        }
        let start = (self.positions[v], self.normals[v]);
        let before = self.worst_around(v);
        let length = self.around[v].iter().map(|&q| self.lengths[q as usize]);
        let length = step * length.flatten().fold(f64::INFINITY, f64::min);
        let (ground, freedom) = (self.ground, self.freedom[v]);
        let found = ground.best_around(start, [length, 0.0], freedom, before, |&place| {
            (self.positions[v], self.normals[v]) = place;
            self.worst_around(v)
        });
        (self.positions[v], self.normals[v]) = found.unwrap_or(start);
        found.is_some()
    }
}

/// What the first and third side of a quad shall be long, and the others: the mean of all four, in the proportion that they have,
/// but not farther apart than `narrowest`.
pub(crate) fn lengths(p: &[Point3; 4], narrowest: f64) -> [f64; 2] {
    let sides = (0..4).map(|k| (p[(k + 1) % 4] - p[k]).norm());
    let mean = sides.sum::<f64>() / 4.0;
    let [first, second] = mean_sides(p).map(|s| s.norm());
    let ratio = if first > 0.0 { first / second } else { 1.0 };
    let ratio = ratio.clamp(narrowest, narrowest.recip());
    [2.0 * ratio, 2.0].map(|part| mean * (part / (1.0 + ratio)))
}
