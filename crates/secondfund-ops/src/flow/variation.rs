//! The total-variation filter of normals.

use geom_core::Vector3;
use geom_core::algebra::{Cholesky, SparseMatrix};

use super::sheet::Sheet;
use crate::Error;
use crate::backend::On;

/// Penalty r of jumps that are not those of the normals.
const PENALTY: f64 = 2.0;
/// Rounds end when no normal turns by more than this, in radians.
const SETTLED: f64 = 1e-4;
/// Faces count at least this area, in squared mean edges: one without area takes the normal of its neighbours.
const LEAST_AREA: f64 = 1e-6;

/// The normals with the least `Σ w l |N_f − N_g| + α/2 Σ s |N_f − N⁰_f|²`, l the length of the edge between two faces,
/// s the area of a face and `w = e^{−|N_f − N_g|⁴}`, so that real creases cost little (Zhang, Wu, Zhang and Deng,
/// *Variational mesh denoising using total variation and piecewise constant function space*, 2015). By the augmented
/// Lagrangian method: the jumps are variables of their own, shrunk one by one; one factor serves every solution for
/// the normals, which are made unit vectors after each.
pub(super) fn filtered(
    sheet: &Sheet,
    rounds: usize,
    fidelity: f64,
    run: On<'_>,
) -> Result<Vec<Vector3>, Error> {
    let weights: Vec<f64> = sheet
        .areas
        .iter()
        .map(|a| fidelity * a.max(LEAST_AREA))
        .collect();
    let factor = Cholesky::of(&matrix(sheet, &weights)?)?;
    let mut normals = sheet.normals.clone();
    let mut duals = vec![Vector3::zeros(); sheet.hinges.len()];
    for round in 0..rounds {
        run.progress("normals", round as u64, rounds as u64)?;
        let jump = |normals: &[Vector3], h: usize| {
            let [f, g] = sheet.hinges[h].faces.map(|f| f as usize);
            normals[g] - normals[f]
        };
        let jumps: Vec<Vector3> = (0..duals.len())
            .map(|h| {
                let real = jump(&normals, h);
                let weight = (-real.norm_squared().powi(2)).exp();
                shrunk(real + duals[h] / PENALTY, weight / PENALTY)
            })
            .collect();
        let mut block: Vec<f64> = sheet
            .normals
            .iter()
            .zip(&weights)
            .flat_map(|(n, w)| [n.x * w, n.y * w, n.z * w])
            .collect();
        for ((hinge, jump), dual) in sheet.hinges.iter().zip(&jumps).zip(&duals) {
            let pull = (jump * PENALTY - dual) * hinge.length;
            for (f, sign) in hinge.faces.into_iter().zip([-1.0, 1.0]) {
                let row = &mut block[3 * f as usize..3 * f as usize + 3];
                row.iter_mut().zip(&pull).for_each(|(b, p)| *b += sign * p);
            }
        }
        factor.solve_in_place(&mut block, 3)?;
        let mut turned = 0.0f64;
        for (normal, new) in normals.iter_mut().zip(block.chunks_exact(3)) {
            let new = Vector3::new(new[0], new[1], new[2]).try_normalize(0.0);
            let new = new.unwrap_or(*normal);
            turned = turned.max((new - *normal).norm());
            *normal = new;
        }
        for (h, dual) in duals.iter_mut().enumerate() {
            *dual += (jump(&normals, h) - jumps[h]) * PENALTY;
        }
        if turned < SETTLED {
            break;
        }
    }
    Ok(normals)
}

/// `α S + r Dᵀ L D` with the differences D across the edges.
fn matrix(sheet: &Sheet, weights: &[f64]) -> Result<SparseMatrix, Error> {
    let own = weights.iter().zip(0..).map(|(&w, f)| (f, f, w));
    let of_hinges = sheet.hinges.iter().flat_map(|hinge| {
        let ([f, g], k) = (hinge.faces, PENALTY * hinge.length);
        [(f, f, k), (g, g, k), (f, g, -k), (g, f, -k)]
    });
    let entries: Vec<_> = own.chain(of_hinges).collect();
    Ok(SparseMatrix::from_triplets(
        weights.len(),
        weights.len(),
        &entries,
    )?)
}

/// The vector made shorter by `length`, down to nothing.
fn shrunk(v: Vector3, length: f64) -> Vector3 {
    let norm = v.norm();
    if norm > length {
        v * (1.0 - length / norm)
    } else {
        Vector3::zeros()
    }
}
