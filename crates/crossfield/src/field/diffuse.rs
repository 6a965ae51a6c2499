//! The start: diffusion of unit crosses, made unit again after each step.
//!
//! A cross is one complex number: its four arms are the four fourth roots of `z = e^{4iθ}`, and θ is known from z up to
//! quarter turns, which is all that a cross has. In the frame of a neighbour across a half-edge with transport κ it is
//! `e^{4iκ} z`. So neither integers nor branches appear, and the smoothest z is that of least
//! `Σ w |z_j − e^{4iκ} z_i|²`: the connection Laplacian L, Hermitian and positive semi-definite (Knöppel et al.,
//! *Globally optimal direction fields*, 2013).
//!
//! Minimized under one condition on the norm of all z together, as eigenvector, crosses fade where they disagree, and a
//! field that has faded costs nothing however it turns: singularities gather there. Made unit again after each short
//! diffusion, none can fade.

use geom_core::algebra::{Cholesky, SparseMatrix, Symbolic};
use geom_core::nalgebra::Complex;

use super::field::Guide;
use super::frames::Frames;
use crate::Error;
use crate::backend::On;

type C = Complex<f64>;

/// Weight of a guide that must be followed, in edges: the exact angle is set after each step anyway.
const HARD: f64 = 1e3;
/// Length of a step, in units of the slowest decay.
/// A longer step forgets where it started, a shorter one comes nearer to a minimum; the descent afterwards evens that out.
const STEP: f64 = 0.3;
/// Most steps: three times as many of three lengths gave fields of no less energy and no fewer singularities.
const MOST: usize = 20;
/// The crosses stand still when they change by less, root of the mean square.
const STILL: f64 = 1e-3;

/// Angles of a smooth cross field by diffusion and renormalization of `z = e^{4iθ}`, the gradient flow of a
/// Ginzburg–Landau energy (Viertel and Osting, *An approach to quad meshing based on harmonic
/// cross-valued maps*, 2019). Local minima remain: the descent afterwards leaves some of them.
///
/// Two factorizations of one pattern, analysed once, each for some tens of solves. The result depends on mesh and guides alone:
/// no random start.
pub(super) fn diffused(frames: &Frames, guides: &[Guide], run: On<'_>) -> Result<Vec<f64>, Error> {
    let matrices = Matrices::of(frames, guides)?;
    let Start { mut z, tau, factor } = matrices.start()?;
    for count in 0..MOST {
        run.progress("field", count as u64, MOST as u64)?;
        let before = z.clone();
        matrices.diffuse(&factor, tau, &mut z)?;
        if matrices.change(&before, &z) < STILL {
            break;
        }
    }
    Ok(z.iter().map(|z| z.arg() / 4.0).collect())
}

/// Directions to begin with, the length of a step from there, Å², and its factor.
struct Start {
    z: Vec<C>,
    tau: f64,
    factor: Cholesky<C>,
}

struct Matrices<'a> {
    areas: &'a [f64],
    /// The connection Laplacian plus the weights of the guides.
    stiffness: SparseMatrix<C>,
    symbolic: Symbolic,
    /// Weight and `e^{4iγ}` per guided triangle.
    pulls: Vec<(usize, f64, C)>,
    hard: Vec<(usize, C)>,
}

impl<'a> Matrices<'a> {
    /// L plus the weights of the guides on its diagonal. A guide counts as much as an edge of that weight to a
    /// neighbour that stands still.
    fn of(frames: &'a Frames, guides: &[Guide]) -> Result<Self, Error> {
        let faces = frames.faces();
        let mut entries: Vec<(u32, u32, C)> = Vec::new();
        entries.extend((0..faces as u32).map(|f| (f, f, C::from(0.0))));
        for (h, t) in frames.interior() {
            let (i, j, w) = ((h / 3) as u32, (t / 3) as u32, frames.weight(h));
            let turned = C::from_polar(w, 4.0 * frames.transport(h));
            entries.extend([(i, i, C::from(w)), (j, j, C::from(w))]);
            entries.extend([(j, i, -turned), (i, j, -turned.conj())]);
        }
        let (mut pulls, mut hard) = (Vec::new(), Vec::new());
        for guide in guides {
            let (face, z) = (
                guide.face as usize,
                C::from_polar(1.0, 4.0 * guide.angle(frames)),
            );
            let weight = if guide.is_hard() {
                hard.push((face, z));
                HARD
            } else {
                guide.weight
            };
            entries.push((guide.face, guide.face, C::from(weight)));
            pulls.push((face, weight, z));
        }
        let stiffness = SparseMatrix::from_triplets(faces, faces, &entries)?;
        Ok(Self {
            areas: frames.areas(),
            symbolic: Symbolic::of(&stiffness)?,
            stiffness,
            pulls,
            hard,
        })
    }

    /// The factor of `A + τ (L + G)`.
    fn step(&self, tau: f64) -> Result<Cholesky<C>, Error> {
        let matrix = self
            .stiffness
            .map(|i, j, x| x * tau + C::from(if i == j { self.areas[i] } else { 0.0 }));
        Ok(self.symbolic.factor(&matrix)?)
    }

    /// Directions that do not depend on a seed, and a step for how fast the slowest of them decays: what the guides spread over the
    /// surface, at the scale of the surface; without any, what inverse iteration makes of a constant, and its Rayleigh quotient.
    fn start(&self) -> Result<Start, Error> {
        /// Most steps of inverse iteration, and by what part the decay changes when no more are needed: it sets a length.
        const STEPS: usize = 30;
        const NEAR: f64 = 1e-2;
        let area: f64 = self.areas.iter().sum();
        let scale = 4.0 * std::f64::consts::PI / area;
        let mut z = vec![C::from(1.0); self.areas.len()];
        if !self.pulls.is_empty() {
            // Far enough that every triangle hears of a guide. Each factor is made on one thread: both at a time.
            let tau = STEP / scale;
            let (first, factor) = rayon::join(|| self.step(area), || self.step(tau));
            self.diffuse(&first?, area, &mut z)?;
            let factor = factor?;
            return Ok(Start { z, tau, factor });
        }
        let tau = 1e6 / scale;
        let factor = self.step(tau)?;
        let mut decay = f64::INFINITY;
        for _ in 0..STEPS {
            let mut next: Vec<C> = z.iter().zip(self.areas).map(|(z, &a)| z * a).collect();
            factor.solve_in_place(&mut next, 1)?;
            let norm = self.norm(&next);
            next.iter_mut().for_each(|x| *x /= norm);
            z = next;
            let applied = self.stiffness.multiply(&z, 1);
            let all = z.iter().zip(&applied);
            let last = std::mem::replace(&mut decay, all.map(|(z, l)| (z.conj() * l).re).sum());
            if (last - decay).abs() <= NEAR * decay {
                break;
            }
        }
        self.normalize(&mut z, None);
        // A flat torus has parallel fields.
        let decay = if decay > 1e-6 * scale { decay } else { scale };
        let tau = STEP / decay;
        let factor = self.step(tau)?;
        Ok(Start { z, tau, factor })
    }

    /// One implicit step of length τ, Å², of the heat equation of crosses: `(A + τ (L + G)) z' = A z + τ G e^{4iγ}`,
    /// then unit length. Implicit steps are stable however long they are.
    fn diffuse(&self, factor: &Cholesky<C>, tau: f64, z: &mut Vec<C>) -> Result<(), Error> {
        let mut next: Vec<C> = z.iter().zip(self.areas).map(|(z, &a)| z * a).collect();
        for &(face, weight, target) in &self.pulls {
            next[face] += target * (tau * weight);
        }
        factor.solve_in_place(&mut next, 1)?;
        self.normalize(&mut next, Some(z));
        *z = next;
        Ok(())
    }

    /// Unit length again; where nothing is left, the phase before.
    fn normalize(&self, z: &mut [C], before: Option<&[C]>) {
        for (i, z) in z.iter_mut().enumerate() {
            let length = z.norm();
            *z = if length > 1e-12 {
                *z / length
            } else {
                before.map_or(C::from(1.0), |b| b[i])
            };
        }
        for &(face, target) in &self.hard {
            z[face] = target;
        }
    }

    /// Over the surface: `√(Σ A |z|²)`, Å.
    fn norm(&self, z: &[C]) -> f64 {
        let sum: f64 = z
            .iter()
            .zip(self.areas)
            .map(|(z, a)| z.norm_sqr() * a)
            .sum();
        sum.sqrt()
    }

    /// The root of the mean square difference, weighted by area: 0 for the same crosses, 2 for opposite z, which are
    /// crosses an eighth of a turn apart.
    fn change(&self, before: &[C], after: &[C]) -> f64 {
        let area: f64 = self.areas.iter().sum();
        let difference: Vec<C> = before.iter().zip(after).map(|(a, b)| a - b).collect();
        self.norm(&difference) / area.sqrt()
    }
}
