//! Down the gradient of the corners' distortion.
//!
//! A corner is seen along the vector area of its quad, as the scaled Jacobian sees it: at a thin rim or in a narrow tunnel the
//! surface's normal at the vertex may be that of another side, along which the best corner looks inverted.

use geom_core::compute::{BackendError, parallel};
use geom_core::mesh::quality::{scaled_jacobian, upright_jacobian};
use geom_core::surface::ground::{Freedom, Ground};
use geom_core::{Point3, QuadMesh, Vector3};

use super::super::quality::mean_sides;
use crate::Error;
use crate::backend::{Corner, CornerDistortion, On};

/// The flow stands still when the energy falls by less, relatively.
const STILL: f64 = 1e-5;
/// No vertex moves farther in a step than this share of the sides around it.
const LONGEST: f64 = 0.3;
/// Sides below this share of what they shall be long are bad however straight their corners are.
const SHORT: f64 = 0.3;

/// Positions, and the surface's normals there.
pub(super) type State = (Vec<Point3>, Vec<Vector3>);

/// Quads on their way.
pub(super) struct Flow<'a> {
    pub(super) quads: Vec<[u32; 4]>,
    pub(super) positions: Vec<Point3>,
    pub(super) normals: Vec<Vector3>,
    /// What the first and third side of each quad shall be long, and the others.
    lengths: Vec<[f64; 2]>,
    /// The least proportion of these.
    narrowest: f64,
    pub(super) ground: &'a Ground<'a>,
    pub(super) freedom: Vec<Freedom>,
    pub(super) run: On<'a>,
    /// Along which the corners of each quad are seen.
    seen: Vec<Vector3>,
    out: Vec<CornerDistortion>,
    /// The quads around each vertex.
    pub(super) around: Vec<Vec<u32>>,
}

impl<'a> Flow<'a> {
    /// Everything put onto the surface.
    pub(super) fn new(
        mesh: QuadMesh,
        narrowest: f64,
        ground: &'a Ground<'a>,
        freedom: Vec<Freedom>,
        run: On<'a>,
    ) -> Self {
        let (positions, quads) = mesh.into_parts();
        let mut flow = Self {
            quads: Vec::new(),
            normals: Vec::new(),
            positions,
            lengths: Vec::new(),
            narrowest,
            ground,
            freedom,
            run,
            seen: Vec::new(),
            out: Vec::new(),
            around: Vec::new(),
        };
        flow.set(quads);
        flow
    }

    /// A flow of other quads on the same surface.
    pub(super) fn part<'b>(&self, mesh: QuadMesh, freedom: Vec<Freedom>, run: On<'b>) -> Flow<'b>
    where
        'a: 'b,
    {
        Flow::new(mesh, self.narrowest, self.ground, freedom, run)
    }

    /// Other quads of the vertices, which are put onto the surface.
    pub(super) fn set(&mut self, quads: Vec<[u32; 4]>) {
        self.around = vec![Vec::new(); self.positions.len()];
        for (q, quad) in (0u32..).zip(&quads) {
            for &v in quad {
                self.around[v as usize].push(q);
            }
        }
        self.quads = quads;
        self.measure();
        (self.positions, self.normals) = self.settled(&self.positions);
    }

    /// The sides shall be as long as they are, as square as they may be.
    pub(super) fn measure(&mut self) {
        let of = |q: &[u32; 4]| lengths(&q.map(|v| self.positions[v as usize]), self.narrowest);
        self.lengths = self.quads.iter().map(of).collect();
    }

    /// Places on the surface, and its normals there.
    fn settled(&self, positions: &[Point3]) -> State {
        let pulled = parallel::map(positions.len(), |v| {
            self.ground.pulled(&positions[v], self.freedom[v])
        });
        pulled.into_iter().unzip()
    }

    /// Along which corners are seen from now on.
    fn look(&mut self) {
        let of = |quad: &[u32; 4]| {
            let corners = quad.map(|v| self.positions[v as usize]);
            let of_surface = self.surface_normal(quad, &corners);
            let own = (corners[2] - corners[0]).cross(&(corners[3] - corners[1]));
            // One that lies on its back shall turn over.
            let own = own.try_normalize(0.0).filter(|n| n.dot(&of_surface) > 0.0);
            own.or_else(|| of_surface.try_normalize(1e-9))
                .unwrap_or(self.normals[quad[0] as usize])
        };
        self.seen = parallel::map_each(&self.quads, of);
    }

    fn distortions(&mut self, epsilon: f64) -> Result<(), Error> {
        let corners: Vec<Corner> = self
            .quads
            .iter()
            .zip(&self.lengths)
            .zip(&self.seen)
            .flat_map(|((quad, &lengths), &normal)| {
                let p = quad.map(|v| self.positions[v as usize]);
                (0..4).map(move |k| Corner {
                    sides: [0, 1].map(|s| (p[(k + 1 + 2 * s) % 4] - p[k]) / lengths[(k + s) % 2]),
                    normal,
                })
            })
            .collect();
        let backend = self.run.backend;
        backend.corner_distortion(&corners, epsilon, &mut self.out)?;
        let (found, of) = (self.out.len(), corners.len());
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

    /// Displacements for a step of one: down the gradient, in units of the sides.
    fn descent(&self, power: i32) -> Vec<Vector3> {
        let mut gradient = vec![Vector3::zeros(); self.positions.len()];
        let mut scale = vec![0.0; self.positions.len()];
        for (q, quad) in self.quads.iter().enumerate() {
            let lengths = self.lengths[q];
            let side = lengths[0].min(lengths[1]);
            for k in 0..4 {
                let of = &self.out[4 * q + k];
                let steep = of.energy.powi(power - 1);
                let [to_next, to_previous] =
                    [0, 1].map(|s| of.gradient[s] * steep / lengths[(k + s) % 2]);
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
                let most = LONGEST * scale[v].sqrt();
                if step.norm() > most {
                    step * (most / step.norm())
                } else {
                    step
                }
            })
            .collect()
    }

    /// Steps down the sum of a power of all corners' distortions; with `anew`, sides shall be as long as they are at each of
    /// them. Answers the state with the largest smallest scaled Jacobian that was met, and that value.
    pub(super) fn descend(
        &mut self,
        power: i32,
        steps: usize,
        anew: bool,
    ) -> Result<(f64, State), Error> {
        let mut best = (
            self.smallest_jacobian(),
            (self.positions.clone(), self.normals.clone()),
        );
        let mut tau = 0.1;
        for step in 0..steps {
            self.run.progress("improve", step as u64, steps as u64)?;
            if anew {
                self.measure();
            }
            self.look();
            self.distortions(0.0)?;
            let smallest = self.smallest_area();
            // 0 is an infinite barrier, once no corner is inverted or nearly so.
            let epsilon = if smallest <= 1e-3 {
                (0.5 * smallest.abs()).max(1e-2)
            } else {
                0.0
            };
            if epsilon > 0.0 {
                self.distortions(epsilon)?;
            }
            let before = self.energy(power);
            let Some(after) = self.step(power, before, epsilon, &mut tau)? else {
                break;
            };
            let smallest = self.smallest_jacobian();
            if smallest > best.0 {
                best = (smallest, (self.positions.clone(), self.normals.clone()));
            }
            if before - after < STILL * before && epsilon == 0.0 {
                break;
            }
        }
        Ok(best)
    }

    /// One step that lowers the energy, and what it is then; `None` where none does.
    fn step(
        &mut self,
        power: i32,
        before: f64,
        epsilon: f64,
        tau: &mut f64,
    ) -> Result<Option<f64>, Error> {
        let direction = self.descent(power);
        let start = (self.positions.clone(), self.normals.clone());
        for _ in 0..12 {
            let moved = start.0.iter().zip(&direction).map(|(p, d)| p + d * *tau);
            let moved: Vec<Point3> = moved.collect();
            let (positions, normals) = self.settled(&moved);
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

    fn on_quad(&self, q: u32, of: impl Fn(&[Point3; 4], &Vector3) -> f64) -> f64 {
        let quad = &self.quads[q as usize];
        let corners = quad.map(|v| self.positions[v as usize]);
        of(&corners, &self.surface_normal(quad, &corners))
    }

    fn surface_normal(&self, quad: &[u32; 4], corners: &[Point3; 4]) -> Vector3 {
        let normals = quad.map(|v| self.normals[v as usize]);
        self.ground.normal_over(corners, &normals)
    }

    /// The scaled Jacobian of each quad.
    pub(super) fn jacobians(&self) -> Vec<f64> {
        parallel::map(self.quads.len(), |q| {
            self.on_quad(q as u32, scaled_jacobian)
        })
    }

    pub(super) fn smallest_jacobian(&self) -> f64 {
        self.jacobians().into_iter().fold(f64::INFINITY, f64::min)
    }

    /// What a search raises: the scaled Jacobian, rising also where a quad lies on its back, and no more than its shortest side is
    /// long.
    pub(super) fn merit(&self, q: u32) -> f64 {
        let merit = self.on_quad(q, upright_jacobian);
        let p = self.quads[q as usize].map(|v| self.positions[v as usize]);
        let wanted = self.lengths[q as usize];
        let length = |k: usize| (p[(k + 1) % 4] - p[k]).norm() / wanted[k % 2];
        let shortest = (0..4).map(length).fold(f64::INFINITY, f64::min);
        merit.min(shortest / SHORT)
    }

    pub(super) fn merits(&self) -> Vec<f64> {
        parallel::map(self.quads.len(), |q| self.merit(q as u32))
    }

    pub(super) fn worst_around(&self, v: usize) -> f64 {
        let all = self.around[v].iter().map(|&q| self.merit(q));
        all.fold(f64::INFINITY, f64::min)
    }

    /// The shortest that a side at a vertex shall be.
    pub(super) fn side_at(&self, v: usize) -> f64 {
        let lengths = self.around[v].iter().map(|&q| self.lengths[q as usize]);
        lengths.flatten().fold(f64::INFINITY, f64::min)
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
