//! The orientation energy (Eq. 4.10) over independent unknowns.
//!
//! Let x be the coordinates of all copies, u and v of each. As if no conditions held, Eq. 4.10 is `½ xᵀ K x − kᵀ x`
//! with K the stiffness matrix of linear elements, anisotropic where the spacing is ([`Chart`]). The conditions are
//! `x = P w` with the sparse integer matrix P of [`Seams`] and values w: real unknowns, integer unknowns, and sums of
//! these. So the energy over the values has the matrix `A = Pᵀ K P` and the right-hand side `b = Pᵀ k`.
//!
//! Written over the unknowns alone, A would be dense where many integers add up. Instead the sums are values of their own, and
//! what ties them to the integers are equations `C w = 0`, the closings around the nodes of the cut, with a few terms each. The
//! factor of `A + Cᵀ R C` with large weights R is sparse, and serves for everything in which all unknowns move: its inverse,
//! restricted to the unknowns, is that of the energy's matrix up to 1 / R. It is the largest thing in memory, and kept in single
//! precision: enough for steps and for what integers are worth. Where more digits are wanted, the method of multipliers (Hestenes 1969,
//! Powell 1969) has them, its steps by conjugate gradients that the factor preconditions: one iteration each, or a few.

use std::borrow::Cow;
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError};

use geom_core::algebra::{
    LinearMap, SingleFactor, SparseMatrix, Symbolic, conjugate_gradients, iterate,
};
use geom_core::compute::lists::Lists;
use geom_core::compute::parallel;

use super::cut::Cut;
use super::spacing::Chart;
use super::transition::Seams;
use crate::Error;

/// How much a closing weighs, in units of the largest diagonal entry of A among its values: what integers are worth is off by less
/// than a tenth of its inverse, and single precision has room for it.
const STIFF: f64 = (1u64 << 12) as f64;
/// Steps of the method of multipliers. Each gains about four digits.
const MULTIPLIERS: usize = 4;
/// Conjugate gradients within a step.
const WITHIN: iterate::Options = iterate::Options {
    tolerance: 1e-5,
    max_iterations: 20,
};
/// A step, as a share of the largest value, after which none is worth taking.
const SETTLED: f64 = 1e-8;

/// `½ wᵀ A w − bᵀ w` under `C w = 0`.
pub(crate) struct System<'a> {
    /// Which copy each corner is.
    pub(crate) cut: &'a Cut,
    /// The rows of P and of C.
    pub(crate) seams: &'a Seams,
    /// What each triangle contributes to K.
    pub(crate) charts: &'a [Chart],
    /// The wanted Jacobians: at first the field's, the identity.
    pub(crate) wanted: Vec<[[f64; 2]; 2]>,
    patterns: Arc<Patterns>,
}

/// Patterns of matrices and the orders of their elimination, which weights do not change.
#[derive(Default)]
struct Patterns {
    whole: OnceLock<Symbolic>,
    /// Of the part over the reals: without the integers, which hang together with everything, its factor has fewer entries.
    reals: OnceLock<Symbolic>,
}

/// The system for one choice of weights.
pub(crate) struct Weighted<'a> {
    seams: &'a Seams,
    /// `A + Cᵀ R C`.
    matrix: SparseMatrix,
    /// b.
    right: Vec<f64>,
    /// R.
    stiff: Vec<f64>,
    patterns: Arc<Patterns>,
    /// The factors of its part over the reals and of all of it.
    factors: [Mutex<Option<Arc<SingleFactor>>>; 2],
}

/// What hangs on each value: P and C by their columns.
struct Hanging {
    /// Coordinates, as `2 · copy + component`, and how often.
    in_coordinates: Lists<(u32, i32)>,
    /// The same of closings.
    in_closings: Lists<(u32, i32)>,
    /// Per copy the corners that it is at, as `3 · triangle + corner`.
    at_corners: Lists<u32>,
}

impl Hanging {
    fn of(system: &System<'_>) -> Self {
        let (seams, cut) = (system.seams, system.cut);
        let copies = 0..seams.copies() as u32;
        let closings = || {
            (0..seams.closings.len()).flat_map(|closing| {
                let row = seams.closings.row(closing);
                row.map(move |(k, p)| (k as u32, (closing as u32, p)))
            })
        };
        let corners = || cut.copy.iter().copied().zip(0..);
        Self {
            in_coordinates: seams.by_value(copies, |k| Some(k as u32), seams.values()),
            in_closings: Lists::of(seams.values(), closings),
            at_corners: Lists::of(seams.copies(), corners),
        }
    }
}

impl<'a> System<'a> {
    /// With the identity wanted in every triangle.
    pub(crate) fn new(cut: &'a Cut, seams: &'a Seams, charts: &'a [Chart]) -> Self {
        Self {
            cut,
            seams,
            charts,
            wanted: vec![[[1.0, 0.0], [0.0, 1.0]]; charts.len()],
            patterns: Arc::default(),
        }
    }

    /// Assembles, triangle f counting `weights[f]` times.
    ///
    /// `Pᵀ K P` is summed row by row, each over its triangles in their order: a list of what all of them contribute would be several
    /// times as large as the matrix.
    pub(crate) fn weighted(&self, weights: &[f64]) -> Result<Weighted<'a>, Error> {
        let values = self.seams.values();
        let hanging = Hanging::of(self);
        // Closings stay together whatever the triangles pull.
        let stiff = self.stiffness_of_closings(&hanging, weights);
        let closings = &self.seams.closings;
        let matrix = SparseMatrix::from_rows(values, values, |i, row| {
            self.add_row(&hanging, i, weights, row);
            for &(closing, p) in hanging.in_closings.list(i) {
                let stiff = stiff[closing as usize];
                let terms = closings.row(closing as usize);
                row.extend(terms.map(|(j, q)| (j as u32, stiff * f64::from(p * q))));
            }
        })?;
        Ok(Weighted {
            seams: self.seams,
            right: self.right(weights),
            stiff,
            patterns: self.patterns.clone(),
            matrix,
            factors: Default::default(),
        })
    }

    /// Adds what the triangles contribute to row `i` of A.
    ///
    /// In a triangle u and v do not know of each other. Seams alone mix them, through P.
    fn add_row(&self, hanging: &Hanging, i: usize, weights: &[f64], row: &mut Vec<(u32, f64)>) {
        let coordinates = hanging.in_coordinates.list(i).iter();
        let corners = coordinates.flat_map(|&(at, p)| {
            let (copy, component) = (at as usize / 2, at as usize % 2);
            let corners = hanging.at_corners.list(copy).iter();
            corners.map(move |&h| (h as usize / 3, component, h as usize % 3, p))
        });
        let mut corners: Vec<(usize, usize, usize, i32)> = corners.collect();
        // A value may be in coordinates far apart, and which integers are taken is a matter of last digits.
        corners.sort_unstable();
        for (f, component, k, p) in corners {
            let chart = &self.charts[f];
            let weight = weights[f] * chart.area;
            let stiffness = chart.stiffness()[component][k];
            for (l, stiffness) in stiffness.into_iter().enumerate() {
                let value = weight * stiffness * f64::from(p);
                let terms = self.seams.row(self.cut.copy[3 * f + l], component);
                row.extend(terms.map(|(j, q)| (j as u32, value * f64::from(q))));
            }
        }
    }

    /// Adds what a triangle contributes to A, for the values that have a place: where few triangles are.
    pub(crate) fn stiffness(
        &self,
        f: usize,
        place: impl Fn(usize) -> Option<u32>,
        entries: &mut Vec<(u32, u32, f64)>,
    ) {
        let chart = &self.charts[f];
        let copies = [0, 1, 2].map(|k| self.cut.copy[3 * f + k]);
        let row = |copy: u32, component: usize| {
            let terms = self.seams.row(copy, component);
            terms.filter_map(|(k, p)| place(k).map(|place| (place, f64::from(p))))
        };
        for (component, stiffness) in chart.stiffness().iter().enumerate() {
            for (k, l) in (0..9).map(|kl| (kl / 3, kl % 3)) {
                let value = chart.area * stiffness[k][l];
                for (i, p) in row(copies[k], component) {
                    let others = row(copies[l], component);
                    entries.extend(others.map(|(j, q)| (i, j, value * p * q)));
                }
            }
        }
    }

    /// Is the matrix, all triangles counting once, to the bit that of a list of what they contribute, one after the other?
    #[cfg(feature = "testing")]
    pub(crate) fn is_that_of_a_list(&self) -> Result<bool, Error> {
        let weighted = self.weighted(&vec![1.0; self.charts.len()])?;
        let mut entries = Vec::new();
        for f in 0..self.charts.len() {
            self.stiffness(f, |k| Some(k as u32), &mut entries);
        }
        let closings = &self.seams.closings;
        for (row, stiff) in weighted.stiff.iter().enumerate() {
            for (i, p) in closings.row(row) {
                let others = closings.row(row);
                entries.extend(others.map(|(j, q)| (i as u32, j as u32, stiff * f64::from(p * q))));
            }
        }
        let values = self.seams.values();
        Ok(SparseMatrix::from_triplets(values, values, &entries)? == weighted.matrix)
    }

    /// b: what the wanted Jacobians pull at.
    fn right(&self, weights: &[f64]) -> Vec<f64> {
        let mut right = vec![0.0; self.seams.values()];
        for (f, chart) in self.charts.iter().enumerate() {
            let weight = weights[f] * chart.area;
            for (component, hats) in [chart.along_u, chart.along_v].iter().enumerate() {
                let wanted = self.wanted[f][component];
                for (k, hat) in hats.iter().enumerate() {
                    let pull = weight * (hat[0] * wanted[0] + hat[1] * wanted[1]);
                    for (i, p) in self.seams.row(self.cut.copy[3 * f + k], component) {
                        right[i] += f64::from(p) * pull;
                    }
                }
            }
        }
        right
    }

    /// R, for the diagonal of A.
    fn stiffness_of_closings(&self, hanging: &Hanging, weights: &[f64]) -> Vec<f64> {
        let diagonal = parallel::map_init(self.seams.values(), Vec::new, |row, i| {
            row.clear();
            self.add_row(hanging, i, weights, row);
            let own = row.iter().filter(|e| e.0 as usize == i);
            own.fold(0.0, |sum, e| sum + e.1)
        });
        let mean = diagonal.iter().sum::<f64>() / diagonal.len().max(1) as f64;
        let closings = &self.seams.closings;
        let of = |row| {
            let own = closings.row(row).map(|(k, _)| diagonal[k]);
            STIFF * own.fold(mean, f64::max)
        };
        (0..closings.len()).map(of).collect()
    }

    /// The coordinates of the corners of all triangles.
    /// In units of lines, from all values.
    pub(crate) fn corners(&self, w: &[f64]) -> Vec<[[f64; 2]; 3]> {
        let (seams, corners) = (self.seams, &self.cut.copy);
        let copies = parallel::map(seams.copies(), |copy| seams.copy(w, copy as u32));
        parallel::map(corners.len() / 3, |t| {
            [0, 1, 2].map(|k| copies[corners[3 * t + k] as usize])
        })
    }

    /// How far the map is from the field: Σ area · |J − 1|², over the number of triangles.
    /// The mean of the areas is 1, so that this is a mean over the surface; 0 if the map follows the field exactly.
    pub(crate) fn energy(&self, corners: &[[[f64; 2]; 3]]) -> f64 {
        let of = |(chart, uv): (&Chart, &[[f64; 2]; 3])| {
            let j = chart.jacobian(uv);
            let off = [j[0][0] - 1.0, j[0][1], j[1][0], j[1][1] - 1.0];
            chart.area * off.iter().map(|x| x * x).sum::<f64>()
        };
        let total: f64 = self.charts.iter().zip(corners).map(of).sum();
        total / self.charts.len().max(1) as f64
    }
}

impl Weighted<'_> {
    /// The matrix, or its part over the reals, and its analysis.
    fn part(&self, with_integers: bool) -> Result<(&Symbolic, Cow<'_, SparseMatrix>), Error> {
        let (cell, matrix) = match with_integers {
            true => (&self.patterns.whole, Cow::Borrowed(&self.matrix)),
            false => {
                let reals = self.matrix.leading(self.seams.reals);
                (&self.patterns.reals, Cow::Owned(reals))
            }
        };
        let symbolic = kept(cell, || Ok(Symbolic::of(&*matrix)?))?;
        Ok((symbolic, matrix))
    }

    /// # Errors
    /// [`Error::Matrix`] if the matrix is not positive definite: the map could be shifted or a part of it hangs on nothing.
    fn factor(&self, with_integers: bool) -> Result<Arc<SingleFactor>, Error> {
        let kept = || locked(&self.factors[usize::from(with_integers)]);
        if let Some(factor) = kept().clone() {
            return Ok(factor);
        }
        let (symbolic, matrix) = self.part(with_integers)?;
        let factor = Arc::new(symbolic.factor_single(&matrix)?);
        *kept() = Some(factor.clone());
        Ok(factor)
    }

    /// From now on integers are held: the factor in which they move is large, and not needed any more.
    pub(crate) fn forget_free(&mut self) {
        *locked(&self.factors[1]) = None;
    }

    /// The same of the factor in which the integers are held, until it is asked for again.
    pub(crate) fn forget_held(&mut self) {
        *locked(&self.factors[0]) = None;
    }

    /// `A⁻¹ g` over the unknowns that move, for a gradient with respect to them: all of them, or the reals alone. It bends steps
    /// and need not be exact: up to `1 / R`, and what single precision has.
    pub(crate) fn inverse(&self, gradient: &[f64], with_integers: bool) -> Result<Vec<f64>, Error> {
        let factor = self.factor(with_integers)?;
        let mut x = gradient.to_vec();
        x.resize(factor.rows(), 0.0);
        x = factor.solve(&x)?;
        x.truncate(gradient.len());
        Ok(x)
    }

    /// The values at the minimum, with real numbers in place of integers.
    pub(crate) fn optimum(&self) -> Result<Vec<f64>, Error> {
        let nothing = vec![None; self.seams.integers];
        self.minimum(&*self.factor(true)?, &self.seams.all_of(&nothing))
    }

    /// All values for given integers: the reals follow to the minimum for these, which need not be integers.
    pub(crate) fn values_for(&self, integers: &[f64]) -> Result<Vec<f64>, Error> {
        let all: Vec<Option<f64>> = integers.iter().copied().map(Some).collect();
        self.minimum(&*self.factor(false)?, &self.seams.all_of(&all))
    }

    /// The minimum while some integers are held, and the factor of what moves.
    pub(crate) fn holding(&self, integers: &[Option<f64>]) -> Result<Holding, Error> {
        let held = self.seams.all_of(integers);
        // The pattern is that of the whole matrix, so that it needs no analysis of its own: ones on the diagonal for what is held.
        let own = |i: usize, j: usize, a: f64| match held[i].is_some() || held[j].is_some() {
            true => f64::from(u8::from(i == j)),
            false => a,
        };
        let (symbolic, matrix) = self.part(true)?;
        let factor = symbolic.factor_single(&matrix.map(own))?;
        let w = self.minimum(&factor, &held)?;
        let integers = self.seams.reals..self.seams.unknowns();
        Ok(Holding {
            factor,
            first: self.seams.reals,
            integers: w[integers].to_vec(),
        })
    }

    /// The values at the minimum under the closings, those that are held where they are; `factor` is that of the others, which are
    /// the first values if it has fewer rows.
    fn minimum(&self, factor: &SingleFactor, held: &[Option<f64>]) -> Result<Vec<f64>, Error> {
        let closings = &self.seams.closings;
        // Closings of what is held hold by themselves.
        let is_open = |&row: &usize| closings.row(row).any(|(k, _)| held[k].is_none());
        let open: Vec<usize> = (0..closings.len()).filter(is_open).collect();
        let mut multipliers = vec![0.0; open.len()];
        let mut w: Vec<f64> = held.iter().map(|held| held.unwrap_or(0.0)).collect();
        let moving = Moving {
            matrix: &self.matrix,
            held: &held[..factor.rows()],
        };
        for _ in 0..MULTIPLIERS {
            let mut missing = self.matrix.multiply(&w, 1);
            for (missing, right) in missing.iter_mut().zip(&self.right) {
                *missing = right - *missing;
            }
            for (&row, multiplier) in open.iter().zip(&multipliers) {
                for (k, c) in closings.row(row) {
                    missing[k] -= f64::from(c) * multiplier;
                }
            }
            missing.truncate(factor.rows());
            moving.hold(&mut missing, 1);
            let step = conjugate_gradients(&moving, factor, &missing, 1, &WITHIN)?;
            w.iter_mut().zip(&step.values).for_each(|(w, s)| *w += s);
            for (&row, multiplier) in open.iter().zip(&mut multipliers) {
                let gap: f64 = closings.row(row).map(|(k, c)| f64::from(c) * w[k]).sum();
                *multiplier += self.stiff[row] * gap;
            }
            if largest(&step.values) <= SETTLED * largest(&w) {
                break;
            }
        }
        self.seams.add_up(&mut w);
        Ok(w)
    }

    /// `S⁻¹`, row after row, with S the Schur complement of the energy's matrix: what the energy is as a function of the
    /// integers alone, the reals following. Up to `1 / R`; `integers²` numbers in memory.
    ///
    /// It is the part of the inverse of the whole matrix that belongs to the integers. On the way to the root of the
    /// elimination tree an integer meets few of the reals: far less than a substitution per integer.
    pub(crate) fn inverse_schur(&self) -> Result<Vec<f64>, Error> {
        let integers = self.seams.reals..self.seams.unknowns();
        inverse_of(&*self.factor(true)?, integers)
    }
}

/// A minimum while some integers are held.
pub(crate) struct Holding {
    /// Of what is not held.
    factor: SingleFactor,
    /// The number of the first integer among all values.
    first: usize,
    /// All of them, at the minimum.
    pub(crate) integers: Vec<f64>,
}

impl Holding {
    /// What [`Weighted::inverse_schur`] is for a few integers that are not held, all others that are not following.
    pub(crate) fn inverse_schur(&self, integers: &[usize]) -> Result<Vec<f64>, Error> {
        inverse_of(&self.factor, integers.iter().map(|k| self.first + k))
    }
}

/// A matrix over the first values, those that are held left out.
struct Moving<'a> {
    matrix: &'a SparseMatrix,
    held: &'a [Option<f64>],
}

impl Moving<'_> {
    fn hold(&self, x: &mut [f64], columns: usize) {
        for (x, held) in x.chunks_exact_mut(columns).zip(self.held) {
            if held.is_some() {
                x.fill(0.0);
            }
        }
    }
}

impl LinearMap<f64> for Moving<'_> {
    fn shape(&self) -> [usize; 2] {
        [self.held.len(); 2]
    }

    /// Of a vector that is zero where values are held.
    fn multiply(&self, x: &[f64], columns: usize) -> Vec<f64> {
        let mut whole = x.to_vec();
        whole.resize(self.matrix.rows() * columns, 0.0);
        let mut image = self.matrix.multiply(&whole, columns);
        image.truncate(x.len());
        self.hold(&mut image, columns);
        image
    }
}

/// The part of the inverse that belongs to some rows, row after row.
fn inverse_of(factor: &SingleFactor, rows: impl Iterator<Item = usize>) -> Result<Vec<f64>, Error> {
    let units: Vec<Vec<(usize, f64)>> = rows.map(|k| vec![(k, 1.0)]).collect();
    Ok(factor.inverse_gram(&units)?)
}

fn largest(values: &[f64]) -> f64 {
    values.iter().fold(0.0, |most, x| f64::max(most, x.abs()))
}

fn locked<T>(cell: &Mutex<T>) -> MutexGuard<'_, T> {
    cell.lock().unwrap_or_else(PoisonError::into_inner)
}

/// What is in a cell, made now if it is empty.
fn kept<T>(cell: &OnceLock<T>, make: impl FnOnce() -> Result<T, Error>) -> Result<&T, Error> {
    match cell.get() {
        Some(kept) => Ok(kept),
        None => {
            let made = make()?;
            Ok(cell.get_or_init(|| made))
        }
    }
}
