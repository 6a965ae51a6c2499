//! Sums over patches: symmetric matrices in Bernstein polynomials become those of the functions.
//!
//! The integral of two functions over a patch is a combination of the integrals of its 16 Bernstein polynomials, which
//! depend on the shape of the patch alone; the extraction says which combination. So mass, stiffness and the equations
//! of a fit are all sums of small dense matrices, whichever basis it is.

use geom_core::algebra::{self, SparseMatrix};
use geom_core::compute::parallel;

use super::extraction::{Extraction, POINTS};

/// A symmetric matrix in the Bernstein polynomials of a patch.
pub(crate) type Local = [[f64; POINTS]; POINTS];

impl Extraction {
    /// `Σ Cᵀ G C` over patches with matrices `G` and coefficients `C`.
    ///
    /// Row by row in parallel: each row sums over the patches of its function in a fixed order, so that the digits do
    /// not depend on the number of threads, and the matrix is symmetric to the last of them.
    pub(crate) fn gram(&self, locals: &[Local]) -> Result<SparseMatrix, algebra::Error> {
        let mut counts = vec![0u32; self.functions()];
        for &f in self.all_functions() {
            counts[f as usize] += 1;
        }
        let starts = parallel::starts_of(&counts);
        let mut next = starts.clone();
        // Per function the patches on which it lives, and which of their functions it is.
        let mut places = vec![(0u32, 0u32); starts[self.functions()]];
        for patch in 0..self.patches().len() {
            for (k, &f) in self.on(patch).iter().enumerate() {
                places[next[f as usize]] = (patch as u32, k as u32);
                next[f as usize] += 1;
            }
        }
        let rows: Vec<Vec<(u32, u32, f64)>> = parallel::map(self.functions(), |f| {
            let mut row: Vec<(u32, f64)> = Vec::new();
            for &(patch, k) in &places[starts[f]..starts[f + 1]] {
                let patch = patch as usize;
                let coefficients = self.coefficients(patch);
                let own = &coefficients[k as usize];
                let mut image = [0.0; POINTS];
                for (x, g) in own.iter().zip(&locals[patch]) {
                    for (out, g) in image.iter_mut().zip(g) {
                        *out += x * g;
                    }
                }
                let dot = |c: &[f64; POINTS]| c.iter().zip(&image).map(|(a, b)| a * b).sum();
                let others = self.on(patch).iter().zip(coefficients);
                row.extend(others.map(|(&other, c)| (other, dot(c))));
            }
            row.sort_by_key(|e| e.0);
            let runs = row.chunk_by(|a, b| a.0 == b.0);
            runs.map(|run| (f as u32, run[0].0, run.iter().map(|e| e.1).sum()))
                .collect()
        });
        // The sums on both sides of the diagonal run over the same patches in other roundings: one of them is taken.
        let matrix =
            SparseMatrix::from_triplets(self.functions(), self.functions(), &rows.concat())?;
        Ok(matrix.map(|i, j, value| if i <= j { value } else { matrix.get(j, i) }))
    }

    /// `Σ Cᵀ r` over patches with vectors `r` of `K` columns: a block of rows per function.
    pub(crate) fn gather<const K: usize>(&self, locals: &[[[f64; K]; POINTS]]) -> Vec<f64> {
        let mut out = vec![0.0; self.functions() * K];
        for (patch, local) in locals.iter().enumerate() {
            for (&f, c) in self.on(patch).iter().zip(self.coefficients(patch)) {
                let row = &mut out[f as usize * K..(f as usize + 1) * K];
                for (x, r) in c.iter().zip(local) {
                    row.iter_mut().zip(r).for_each(|(o, r)| *o += x * r);
                }
            }
        }
        out
    }
}
