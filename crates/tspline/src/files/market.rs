//! Sparse matrices as Matrix Market files, which SciPy, MATLAB and PETSc read.

use std::io::{self, Write};

use geom_core::algebra::SparseMatrix;

/// Writes the lower half of a symmetric matrix.
///
/// Rows and columns are counted from 1 on, as the format has it. What stands above the diagonal is not looked at.
///
/// # Errors
/// Those of `out`.
pub fn write_symmetric(out: &mut dyn Write, matrix: &SparseMatrix) -> io::Result<()> {
    let rows = matrix.rows();
    let lower = |i: usize| matrix.row(i).filter(move |&(j, _)| j <= i);
    let entries: usize = (0..rows).map(|i| lower(i).count()).sum();
    writeln!(out, "%%MatrixMarket matrix coordinate real symmetric")?;
    writeln!(out, "{rows} {rows} {entries}")?;
    for i in 0..rows {
        for (j, value) in lower(i) {
            writeln!(out, "{} {} {value:.16e}", i + 1, j + 1)?;
        }
    }
    Ok(())
}
