//! Down the gradient of the distortion.
//!
//! The distortion of a corner with the sides P and S and the normal n is `(|P|² + |S|²) / 2 n·(P × S)`: 1 for equal sides at a right
//! angle, and infinite where the corner is flat (Eqs. 5.5–5.7). Summed over all corners it is a function of the vertices, which
//! move down its gradient within the tangent planes and are put back onto the surface. A corner is seen along the normal of its
//! quad, as the scaled Jacobian sees it: at a sharp edge or a thin rim the surface's normal at the vertex may be that of another
//! side, along which the best corner looks inverted, and all others would be spoiled for its sake.

use geom_core::compute::BackendError;
use geom_core::surface::ground::{Freedom, Ground};
use geom_core::{Point3, Vector3};
use rayon::prelude::*;

use super::cells::{Cells, Wedge};
use crate::backend::{Corner, CornerDistortion, On};
use crate::options::Method;
use crate::{Error, QualityOptions, TMesh};

/// Powers of the distortions whose sum is lowered, one after the other: the first is Eq. 5.6, the second heeds the worse
/// corners more.
const POWERS: [i32; 2] = [1, 4];
/// No vertex moves farther in a step than this share of the elements' size.
const LONGEST: f64 = 0.3;

/// Positions, and the surface's normals there.
pub(super) type State = (Vec<Point3>, Vec<Vector3>);

pub(super) struct Flow<'a> {
    pub(super) cells: Cells,
    pub(super) positions: Vec<Point3>,
    pub(super) normals: Vec<Vector3>,
    pub(super) freedom: Vec<Freedom>,
    pub(super) ground: &'a Ground<'a>,
    pub(super) options: &'a QualityOptions,
    pub(super) run: On<'a>,
    /// The normal along which each wedge is seen.
    seen: Vec<Vector3>,
    corners: Vec<Corner>,
    out: Vec<CornerDistortion>,
}

impl<'a> Flow<'a> {
    pub(super) fn new(
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
            seen: Vec::new(),
            corners: Vec::new(),
            out: Vec::new(),
        }
    }

    /// Along which corners are seen from now on: the surface's normals there for triangles, those of their quads for corners.
    pub(super) fn look(&mut self) {
        let normals = self.cells.normals(&self.normals);
        self.seen = match self.options.method {
            Method::Triangles => {
                let of = |wedge: &Wedge| normals[wedge.nodes[0] as usize];
                self.cells.wedges.iter().map(of).collect()
            }
            Method::Corners => {
                let of_quads = self
                    .cells
                    .upright(&self.cells.nodes(&self.positions), &normals);
                of_quads.into_iter().flat_map(|n| [n; 4]).collect()
            }
        };
    }

    pub(super) fn distortions(&mut self, epsilon: f64) -> Result<(), Error> {
        let nodes = self.cells.nodes(&self.positions);
        let seen = &self.seen;
        self.cells
            .wedges
            .par_iter()
            .enumerate()
            .with_min_len(1024)
            .map(|(w, wedge)| {
                let [o, a, b] = wedge.nodes.map(|n| n as usize);
                Corner {
                    edges: [nodes[a] - nodes[o], nodes[b] - nodes[o]],
                    normal: seen[w],
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

    pub(super) fn energy(&self, power: i32) -> f64 {
        self.out.iter().map(|c| c.energy.powi(power)).sum()
    }

    fn smallest_area(&self) -> f64 {
        let areas = self.out.iter().map(|c| c.area);
        areas.fold(f64::INFINITY, f64::min)
    }

    /// ε of the distortion: 0, an infinite barrier, once no corner is inverted or nearly so.
    pub(super) fn epsilon(&self) -> f64 {
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
    pub(super) fn run(&mut self, least: f64, kept: &mut State) -> Result<(usize, [f64; 2]), Error> {
        let before = self.mean_distortion()?;
        let mut steps = 0;
        for power in POWERS {
            steps += self.flow(power, least, kept)?;
        }
        Ok((steps, [before, self.mean_distortion()?]))
    }

    fn mean_distortion(&mut self) -> Result<f64, Error> {
        self.look();
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
            self.look();
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
    pub(super) fn step(
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
}

/// Everything back onto the surface.
fn settled(positions: &[Point3], freedom: &[Freedom], ground: &Ground<'_>) -> State {
    let both = positions.par_iter().zip(freedom);
    both.map(|(p, &freedom)| ground.pulled(p, freedom)).unzip()
}
