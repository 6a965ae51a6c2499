//! Down the gradient of the distortion, and then the worst one by one.
//!
//! The distortion of a corner with the sides P and S and the normal n is `(|P|² + |S|²) / 2 n·(P × S)`: 1 for equal sides at a right
//! angle, and infinite where the corner is flat (Eqs. 5.5–5.7). Summed over all corners it is a function of the vertices, which
//! move down its gradient within the tangent planes and are put back onto the surface. Where the mean is good and single corners
//! are not, vertices of the worst elements then search for better places one by one.

use geom_core::compute::BackendError;
use geom_core::surface::ground::{Freedom, Ground};
use geom_core::{Point3, TriMesh, Vector3};
use rayon::prelude::*;

use super::cells::Cells;
use super::jacobian::{self, JacobianSummary};
use super::lines::{Lines, freedoms};
use super::{Improved, QualityReport};
use crate::backend::{Corner, CornerDistortion, On};
use crate::options::Method;
use crate::{Error, QualityOptions, TMesh, VertexKind};

/// Elements below this are worked on one by one after the flow.
const GOAL: f64 = 0.9;
/// Powers of the distortions whose sum is lowered, one after the other: the first is Eq. 5.6, the second heeds the worse
/// corners more.
const POWERS: [i32; 2] = [1, 4];
/// No vertex moves farther in a step than this share of the elements' size.
const LONGEST: f64 = 0.3;
/// Where a search for a better place begins and where it ends, in the elements' size.
const COMPASS: [f64; 2] = [0.25, 0.003];

pub(crate) fn improve(
    mut mesh: TMesh,
    surface: &TriMesh,
    options: &QualityOptions,
    run: On<'_>,
) -> Result<Improved, Error> {
    let open = (0..mesh.positions().len()).any(|v| mesh.kind(v) == VertexKind::Boundary);
    let lines = Lines::of(surface, options.crease, open)?;
    let freedom = freedoms(&mesh, &lines);
    let ground = Ground::new(surface, lines.all)?;
    let mut flow = Flow::new(&mesh, &freedom, &ground, options, run);
    let before = flow.jacobians();
    let least = before.iter().copied().fold(f64::INFINITY, f64::min);
    let mut kept = (flow.positions.clone(), flow.normals.clone());
    let (steps, distortion) = flow.run(least, &mut kept)?;
    let mut lifted = flow.lift_the_worst()?;
    // The sum may fall while the worst corner does, beyond repair: back to where that was no worse than at the start.
    if options.method == Method::Corners && flow.smallest_jacobian() < least {
        (flow.positions, flow.normals) = kept;
        lifted = flow.lift_the_worst()?;
    }
    let jacobians = flow.jacobians();
    let positions = flow.positions;
    let onto = |v: u32, p: &Point3| ground.pulled(p, freedom[v as usize]).0;
    mesh.move_to(positions, onto)?;
    let report = QualityReport {
        steps,
        distortion,
        lifted,
        before: JacobianSummary::of(&before),
        after: JacobianSummary::of(&jacobians),
        backend: run.backend.name(),
    };
    Ok(Improved {
        mesh,
        jacobians,
        report,
    })
}

/// Positions, and the surface's normals there.
type State = (Vec<Point3>, Vec<Vector3>);

struct Flow<'a> {
    cells: Cells,
    positions: Vec<Point3>,
    normals: Vec<Vector3>,
    freedom: Vec<Freedom>,
    ground: &'a Ground<'a>,
    options: &'a QualityOptions,
    run: On<'a>,
    corners: Vec<Corner>,
    out: Vec<CornerDistortion>,
}

impl<'a> Flow<'a> {
    fn new(
        mesh: &TMesh,
        fine: &[Freedom],
        ground: &'a Ground<'a>,
        options: &'a QualityOptions,
        run: On<'a>,
    ) -> Self {
        let of = |v: usize| fine[mesh.fine_of_vertex(v) as usize];
        let freedom: Vec<Freedom> = (0..mesh.positions().len()).map(of).collect();
        let (positions, normals) = settled(mesh.positions(), &freedom, ground);
        Self {
            cells: Cells::new(mesh, &positions, options.method),
            positions,
            normals,
            freedom,
            ground,
            options,
            run,
            corners: Vec::new(),
            out: Vec::new(),
        }
    }

    fn distortions(&mut self, epsilon: f64) -> Result<(), Error> {
        let nodes = self.cells.nodes(&self.positions);
        let normals = self.cells.normals(&self.normals);
        self.cells
            .wedges
            .par_iter()
            .with_min_len(1024)
            .map(|wedge| {
                let [o, a, b] = wedge.nodes.map(|n| n as usize);
                Corner {
                    edges: [nodes[a] - nodes[o], nodes[b] - nodes[o]],
                    normal: normals[o],
                    inverse: wedge.inverse,
                }
            })
            .collect_into_vec(&mut self.corners);
        let backend = self.run.backend;
        backend.corner_distortion(&self.corners, epsilon, &mut self.out)?;
        let (found, of) = (self.out.len(), self.corners.len());
        Ok(BackendError::unless(found == of, &backend.name(), || {
            format!("{found} distortions for {of} corners")
        })?)
    }

    fn energy(&self, power: i32) -> f64 {
        self.out.iter().map(|c| c.energy.powi(power)).sum()
    }

    fn smallest_area(&self) -> f64 {
        let areas = self.out.iter().map(|c| c.area);
        areas.fold(f64::INFINITY, f64::min)
    }

    /// ε of the distortion: 0, an infinite barrier, once no corner is inverted or nearly so.
    fn epsilon(&self) -> f64 {
        let smallest = self.smallest_area();
        match self.options.method {
            // 2 δ of Eq. 5.9.
            Method::Triangles => (-2.0 * smallest).max(2e-3),
            Method::Corners if smallest <= 1e-3 => (0.5 * smallest.abs()).max(1e-2),
            Method::Corners => 0.0,
        }
    }

    /// Displacements for a step of one: down the gradient within the surface, in units of the elements.
    fn descent(&self, power: i32) -> Vec<Vector3> {
        let mut gradient = vec![Vector3::zeros(); self.normals.len()];
        gradient.resize(self.cells.nodes(&self.positions).len(), Vector3::zeros());
        for (wedge, of) in self.cells.wedges.iter().zip(&self.out) {
            let [o, a, b] = wedge.nodes.map(|n| n as usize);
            // Of the power, but for a factor.
            let [first, second] = of.gradient.map(|g| g * of.energy.powi(power - 1));
            gradient[a] += first;
            gradient[b] += second;
            gradient[o] -= first + second;
        }
        let mut descent = self.cells.to_vertices(gradient);
        for (v, g) in descent.iter_mut().enumerate() {
            let n = self.normals[v];
            let scale = self.cells.scale[v];
            let step = -(*g - n * n.dot(g)) * scale;
            let most = LONGEST * scale.sqrt();
            *g = match self.freedom[v] {
                Freedom::Fixed => Vector3::zeros(),
                _ if step.norm() > most => step * (most / step.norm()),
                _ => step,
            };
        }
        descent
    }

    /// Steps until the distortion stands still; how many there were, and the mean distortion before and after. The last state
    /// whose smallest scaled Jacobian is `least` or more is kept.
    fn run(&mut self, least: f64, kept: &mut State) -> Result<(usize, [f64; 2]), Error> {
        let before = self.mean_distortion()?;
        let mut steps = 0;
        for power in POWERS {
            steps += self.flow(power, least, kept)?;
        }
        Ok((steps, [before, self.mean_distortion()?]))
    }

    fn mean_distortion(&mut self) -> Result<f64, Error> {
        self.distortions(0.0)?;
        let epsilon = self.epsilon();
        self.distortions(epsilon)?;
        Ok(self.energy(1) / self.out.len() as f64)
    }

    /// Steps down the gradient of the sum of one power.
    fn flow(&mut self, power: i32, least: f64, kept: &mut State) -> Result<usize, Error> {
        let mut tau = 0.2;
        let most = self.options.steps;
        for step in 0..most {
            self.run.progress("quality", step as u64, most as u64)?;
            self.distortions(0.0)?;
            let epsilon = self.epsilon();
            if epsilon > 0.0 {
                self.distortions(epsilon)?;
            }
            let before = self.energy(power);
            let Some(after) = self.step(power, before, epsilon, &mut tau)? else {
                return Ok(step);
            };
            if self.smallest_jacobian() >= least {
                kept.0.clone_from(&self.positions);
                kept.1.clone_from(&self.normals);
            }
            let still = before - after < self.options.tolerance * before;
            if still && (epsilon == 0.0 || self.options.method == Method::Triangles) {
                return Ok(step + 1);
            }
        }
        Ok(most)
    }

    /// One step that lowers the energy, at most; its energy.
    fn step(
        &mut self,
        power: i32,
        before: f64,
        epsilon: f64,
        tau: &mut f64,
    ) -> Result<Option<f64>, Error> {
        let descent = self.descent(power);
        let start = (self.positions.clone(), self.normals.clone());
        for _ in 0..12 {
            let moved = start.0.iter().zip(&descent).map(|(p, d)| p + d * *tau);
            let moved: Vec<Point3> = moved.collect();
            // Normals are those of the start, as for the gradient: on a surface of large triangles they change faster than
            // anything else.
            let (positions, normals) = settled(&moved, &self.freedom, self.ground);
            self.positions = positions;
            self.distortions(epsilon)?;
            let energy = self.energy(power);
            let upright = epsilon > 0.0 || self.smallest_area() > 0.0;
            if energy < before && upright {
                self.normals = normals;
                *tau = (*tau * 1.5).min(1.0);
                return Ok(Some(energy));
            }
            *tau *= 0.5;
        }
        (self.positions, self.normals) = start;
        Ok(None)
    }

    fn jacobian(&self, e: usize) -> f64 {
        jacobian::of_element(&self.cells, e, &self.positions, &self.normals)
    }

    fn jacobians(&self) -> Vec<f64> {
        let elements = 0..self.cells.elements();
        let of = |e| self.jacobian(e);
        elements.into_par_iter().with_min_len(256).map(of).collect()
    }

    fn smallest_jacobian(&self) -> f64 {
        self.jacobians().into_iter().fold(f64::INFINITY, f64::min)
    }

    fn worst_around(&self, v: usize) -> f64 {
        let all = self.cells.around(v).iter();
        all.map(|&e| self.jacobian(e as usize))
            .fold(f64::INFINITY, f64::min)
    }

    /// Vertices of bad elements search the directions of a compass for a place where the worst element around them is
    /// better, nearer and nearer until something around them moves. How many moved.
    fn lift_the_worst(&mut self) -> Result<usize, Error> {
        let [longest, least] = COMPASS;
        let mut steps = vec![longest; self.positions.len()];
        let mut lifted = vec![false; self.positions.len()];
        for round in 0..self.options.rounds {
            let rounds = self.options.rounds as u64;
            self.run.progress("worst elements", round as u64, rounds)?;
            let jacobians = self.jacobians();
            let mut bad: Vec<usize> = (0..jacobians.len())
                .filter(|&e| jacobians[e] < GOAL)
                .collect();
            bad.sort_by(|&a, &b| jacobians[a].total_cmp(&jacobians[b]).then(a.cmp(&b)));
            let mut searched = false;
            for e in bad {
                for v in self.rim(e) {
                    let (v, step) = (v as usize, steps[v as usize]);
                    if step < least {
                        continue;
                    }
                    searched = true;
                    if !self.search(v, step) {
                        steps[v] = 0.5 * step;
                        continue;
                    }
                    lifted[v] = true;
                    for &near in self.cells.around(v) {
                        for w in self.rim(near as usize) {
                            steps[w as usize] = step.max(steps[w as usize]);
                        }
                    }
                }
            }
            if !searched {
                break;
            }
        }
        Ok(lifted.iter().filter(|&&l| l).count())
    }

    /// The vertices of an element, ascending.
    fn rim(&self, e: usize) -> Vec<u32> {
        let mut rim: Vec<u32> = self.cells.of_element(e).concat();
        rim.retain(|&n| (n as usize) < self.positions.len());
        rim.sort_unstable();
        rim.dedup();
        rim
    }

    fn search(&mut self, v: usize, step: f64) -> bool {
        if self.freedom[v] == Freedom::Fixed {
            return false;
        }
        let (start, normal) = (self.positions[v], self.normals[v]);
        let before = self.worst_around(v);
        let length = step * self.cells.scale[v].sqrt();
        let mut best = (before + 1e-6, start, normal);
        for (to, normal) in self.ground.around((start, normal), length, self.freedom[v]) {
            (self.positions[v], self.normals[v]) = (to, normal);
            let after = self.worst_around(v);
            if after > best.0 {
                best = (after, to, normal);
            }
        }
        (self.positions[v], self.normals[v]) = (best.1, best.2);
        best.0 > before + 1e-6
    }
}

/// Everything back onto the surface.
fn settled(positions: &[Point3], freedom: &[Freedom], ground: &Ground<'_>) -> State {
    let both = positions.par_iter().zip(freedom);
    both.map(|(p, &freedom)| ground.pulled(p, freedom)).unzip()
}
