//! Isogeometric analysis on a spline surface: the functions that shape it carry the solution (Hughes, Cottrell and
//! Bazilevs 2005).
//!
//! Finite elements approximate the shape by triangles and the solution by other functions. Here both are of one basis, so that
//! the shape is exact and the solution smooth: with the functions N_i of the surface, stiffness and mass are
//! `K_ij = ∫ ∇N_i · ∇N_j dA` and `M_ij = ∫ N_i N_j dA`, integrated patch by patch with Gauss's rule.
//!
//! ```
//! use tspline::geom_core::{Cpu, Run, mesh::shapes};
//! use tspline::{Basis, Surface, TMesh, TMeshOptions, analysis};
//!
//! let quads = shapes::quad_sphere(1.0, 8);
//! let mesh = TMesh::build(&quads, &vec![0; quads.quads().len()], &TMeshOptions::default())?;
//! let surface = Surface::new(mesh, Basis::default(), Run::on(&Cpu))?;
//! let matrices = analysis::matrices(&surface)?;
//! // Of a sphere of radius R the first eigenvalue but 0 is 2 / R², three times; control points on the unit sphere make a
//! // surface a little inside of it.
//! let pairs = analysis::eigenpairs(&matrices, 4, Run::on(&Cpu))?;
//! assert!(pairs.values[0].abs() < 1e-8);
//! assert!(pairs.values[1..4].iter().all(|value| (2.0..2.2).contains(value)));
//! # Ok::<(), tspline::Error>(())
//! ```

use geom_core::algebra::eigen::{self, EigenPairs, SpectralBackend};
use geom_core::algebra::quadrature::gauss;
use geom_core::algebra::{Cholesky, Mass, SparseMatrix, iterate};
use geom_core::compute::parallel;
use geom_core::options::require;
use geom_core::{Point3, Run};
use rayon::prelude::*;

use crate::surface::bezier::bernstein;
use crate::surface::{Jet, Local, POINTS};
use crate::{Error, Surface};

/// Gauss points per direction and patch.
pub const QUADRATURE: usize = 5;

/// The matrices of the Laplace–Beltrami operator.
#[derive(Clone, Debug, PartialEq)]
pub struct Matrices {
    /// `∫ ∇Rᵢ · ∇Rⱼ dA`.
    pub stiffness: SparseMatrix,
    /// `∫ Rᵢ Rⱼ dA`, Å².
    pub mass: SparseMatrix,
}

/// A quadrature point of a patch.
struct Point {
    jet: Jet,
    /// The functions that patches have in place of Bernstein's, and their derivatives by both parameters.
    values: [f64; POINTS],
    slopes: [[f64; POINTS]; 2],
    /// Its share of the area, Å².
    area: f64,
}

/// The quadrature points of a patch; those without area are left out.
fn points(surface: &Surface, patch: usize, rule: &[(f64, f64)]) -> Vec<Point> {
    let shape = &surface.patches()[patch];
    let mut out = Vec::with_capacity(rule.len() * rule.len());
    for &(t, wt) in rule {
        for &(s, ws) in rule {
            let jet = Jet::of(shape, [s, t]);
            let (a, b) = (bernstein(s), bernstein(t));
            let product = |i: usize, j: usize| -> [f64; POINTS] {
                std::array::from_fn(|k| a[i][k % 4] * b[j][k / 4])
            };
            let (mut values, mut slopes) = (product(0, 0), [product(1, 0), product(0, 1)]);
            if surface.extraction().is_rational() {
                let weight =
                    |b: &[f64; POINTS]| -> f64 { shape.iter().zip(b).map(|(p, b)| p[3] * b).sum() };
                let w = weight(&values);
                values = values.map(|v| v / w);
                for slope in &mut slopes {
                    let change = weight(slope);
                    *slope = std::array::from_fn(|k| (slope[k] - values[k] * change) / w);
                }
            }
            let area = ws * wt * jet.area_vector().norm();
            if area > 0.0 {
                out.push(Point {
                    jet,
                    values,
                    slopes,
                    area,
                });
            }
        }
    }
    out
}

/// Stiffness and mass of the functions of a surface, by 5 × 5 Gauss points per patch.
///
/// Both are as large as there are functions, with some fifty entries per row. 5 × 5 points integrate products of two
/// bicubic polynomials exactly where a patch is a parallelogram; elsewhere the integrands are no polynomials, and the
/// error falls with the size of elements.
///
/// # Errors
/// [`Error::Matrix`] for a surface that is degenerate or not finite.
pub fn matrices(surface: &Surface) -> Result<Matrices, Error> {
    let rule = gauss(QUADRATURE);
    let (stiffness, mass): (Vec<Local>, Vec<Local>) = (0..surface.patches().len())
        .into_par_iter()
        .with_min_len(16)
        .map(|patch| {
            let mut both = ([[0.0; POINTS]; POINTS], [[0.0; POINTS]; POINTS]);
            for point in points(surface, patch, &rule) {
                let [xs, xt] = &point.jet.first;
                let [e, f, g] = [xs.dot(xs), xs.dot(xt), xt.dot(xt)];
                let scale = point.area / (e * g - f * f);
                let [s, t] = &point.slopes;
                for i in 0..POINTS {
                    let (u, v) = (scale * (g * s[i] - f * t[i]), scale * (e * t[i] - f * s[i]));
                    let m = point.area * point.values[i];
                    for j in i..POINTS {
                        both.0[i][j] += u * s[j] + v * t[j];
                        both.1[i][j] += m * point.values[j];
                    }
                }
            }
            // Both are symmetric.
            for i in 0..POINTS {
                for j in 0..i {
                    both.0[i][j] = both.0[j][i];
                    both.1[i][j] = both.1[j][i];
                }
            }
            both
        })
        .unzip();
    Ok(Matrices {
        stiffness: surface.extraction().gram(&stiffness)?,
        mass: surface.extraction().gram(&mass)?,
    })
}

/// The smallest eigenpairs of the Laplace–Beltrami operator, zeros of the components included; values in Å⁻², one
/// coefficient per function and vector.
///
/// Vectors are coefficients: [`value`] evaluates what they stand for.
///
/// # Errors
/// [`Error::Spectral`].
pub fn eigenpairs<B: SpectralBackend + ?Sized>(
    matrices: &Matrices,
    count: usize,
    run: Run<'_, B>,
) -> Result<EigenPairs, Error> {
    let mass = Mass::Consistent(matrices.mass.clone());
    let options = eigen::Options {
        tolerance: 1e-10,
        ..eigen::Options::default()
    };
    Ok(eigen::eigenpairs(
        &matrices.stiffness,
        &mass,
        count,
        &options,
        run,
    )?)
}

/// The smallest eigenvalue of the mass scaled to a diagonal of ones: how far the functions are from dependence (1: they
/// are orthogonal, 0: dependent).
///
/// # Errors
/// [`Error::Spectral`].
pub fn independence<B: SpectralBackend + ?Sized>(
    matrices: &Matrices,
    run: Run<'_, B>,
) -> Result<f64, Error> {
    let mass = Mass::Lumped(matrices.mass.diagonal());
    let options = eigen::Options {
        tolerance: 1e-4,
        method: eigen::Method::ShiftInvert,
        shift: Some(-1e-3),
        ..eigen::Options::default()
    };
    let pairs = eigen::eigenpairs(&matrices.mass, &mass, 1, &options, run)?;
    Ok(pairs.values[0])
}

/// Integrals of `f` times each function and of each function, one pair per function.
fn loads(surface: &Surface, f: &(dyn Fn(&Point3) -> f64 + Sync)) -> Result<Vec<f64>, Error> {
    let rule = gauss(QUADRATURE);
    let locals: Vec<[[f64; 2]; POINTS]> = parallel::map(surface.patches().len(), |patch| {
        let mut local = [[0.0; 2]; POINTS];
        for point in points(surface, patch, &rule) {
            let value = f(&point.jet.point);
            for (out, v) in local.iter_mut().zip(point.values) {
                out[0] += point.area * value * v;
                out[1] += point.area * v;
            }
        }
        local
    });
    let sums = surface.extraction().gather(&locals);
    let finite = sums.iter().all(|x| x.is_finite());
    require(finite, "f", "NaN", "be finite everywhere on the surface")?;
    Ok(sums)
}

/// The coefficients of the combination of functions nearest to `f`, in the mean of squares over the surface.
///
/// # Errors
/// [`Error::Option`] for an `f` that is not finite; [`Error::Matrix`], [`Error::NotSolved`].
pub fn projection(
    surface: &Surface,
    matrices: &Matrices,
    f: &(dyn Fn(&Point3) -> f64 + Sync),
) -> Result<Vec<f64>, Error> {
    let right: Vec<f64> = (loads(surface, f)?.chunks_exact(2)).map(|x| x[0]).collect();
    let factor = Cholesky::of(&matrices.mass)?;
    let options = iterate::Options::default();
    solved(iterate::refine(
        &matrices.mass,
        &factor,
        &right,
        1,
        &options,
    )?)
}

/// The coefficients of the solution of `−Δu = f` on a connected surface, of mean zero; the mean of `f` is left out. On a
/// boundary its normal derivative is zero.
///
/// # Errors
/// [`Error::Option`] for an `f` that is not finite; [`Error::Matrix`] or [`Error::NotSolved`] on a surface of several components.
pub fn poisson(
    surface: &Surface,
    matrices: &Matrices,
    f: &(dyn Fn(&Point3) -> f64 + Sync),
) -> Result<Vec<f64>, Error> {
    let sums = loads(surface, f)?;
    let area: f64 = sums.chunks_exact(2).map(|x| x[1]).sum();
    let mean = sums.chunks_exact(2).map(|x| x[0]).sum::<f64>() / area;
    // The functions sum to one, so that the solution is known up to a number: the first coefficient is zero.
    let rest = |x: usize| (x > 0).then(|| x as u32 - 1);
    let stiffness = &matrices.stiffness;
    let rows = stiffness.rows();
    let entries: Vec<(u32, u32, f64)> = (1..rows)
        .flat_map(|i| {
            let row = stiffness.row(i);
            row.filter_map(move |(j, a)| Some((rest(i)?, rest(j)?, a)))
        })
        .collect();
    let reduced = SparseMatrix::from_triplets(rows - 1, rows - 1, &entries)?;
    let right: Vec<f64> = (sums.chunks_exact(2).skip(1))
        .map(|x| x[0] - mean * x[1])
        .collect();
    let factor = Cholesky::of(&reduced)?;
    let options = iterate::Options::default();
    let found = solved(iterate::refine(&reduced, &factor, &right, 1, &options)?)?;
    let mut solution = vec![0.0];
    solution.extend(found);
    let integral: f64 = (solution.iter().zip(sums.chunks_exact(2)))
        .map(|(u, x)| u * x[1])
        .sum();
    solution.iter_mut().for_each(|u| *u -= integral / area);
    Ok(solution)
}

/// The value of a combination of functions at a place of an element, like [`Surface::evaluate`].
///
/// # Panics
/// If there are fewer coefficients than functions, or there is no such element.
pub fn value(surface: &Surface, coefficients: &[f64], element: usize, at: [f64; 2]) -> f64 {
    let size = surface.mesh().elements()[element].size;
    let (patch, [s, t]) = surface.extraction().locate(element, at, size);
    let (a, b) = (bernstein(s)[0], bernstein(t)[0]);
    let basis = surface.functions_at(patch, &std::array::from_fn(|k| a[k % 4] * b[k / 4]));
    let extraction = surface.extraction();
    let rows = extraction
        .on(patch)
        .iter()
        .zip(extraction.coefficients(patch));
    rows.map(|(&f, c)| {
        let function: f64 = c.iter().zip(&basis).map(|(c, b)| c * b).sum();
        coefficients[f as usize] * function
    })
    .sum()
}

/// Of equations that have a solution the residual falls to rounding.
fn solved(solution: iterate::Solution) -> Result<Vec<f64>, Error> {
    let residual = solution.residuals.iter().copied().fold(0.0, f64::max);
    if solution.converged || residual < 1e-8 {
        return Ok(solution.values);
    }
    Err(Error::NotSolved { residual })
}
