//! The factor L S Lᵀ of a real symmetric matrix that need not be definite, S the signs of its pivots.
//!
//! Such matrices are `K − σM` with σ among the eigenvalues: the signs count those below it (Sylvester's law of inertia), and
//! shift–invert finds more of them from there (Ericsson and Ruhe, *The spectral transformation Lanczos method*, 1980).

use faer::Side;
use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::cholesky::ldlt::factor::LdltRegularization;
use faer::sparse::linalg::cholesky::LdltRef;
use faer::{Conj, MatMut, Par};

use super::{Job, Plan, Symbolic, factor_into};
use crate::algebra::{Error, SparseMatrix};

/// The factor L S Lᵀ of a symmetric matrix, from [`Symbolic::factor_signed`].
#[derive(Clone, Debug)]
pub struct SignedFactor {
    symbolic: Symbolic,
    values: Values,
}

#[derive(Clone, Debug)]
enum Values {
    /// With supernodes: the values, and which columns of each task have negative pivots.
    Fronts(Vec<f64>, Vec<Vec<u32>>),
    /// Small or nearly diagonal: faer's L D Lᵀ.
    Plain(Vec<f64>),
}

/// [`Symbolic::factor_signed`].
pub(super) fn factor(
    symbolic: &Symbolic,
    matrix: &SparseMatrix<f64>,
) -> Result<Option<SignedFactor>, Error> {
    let values = match &symbolic.inner.plan {
        Some(plan) => match factor_into::<f64, true>(symbolic, plan, matrix) {
            Ok(values) => {
                let negative = plan
                    .schedule
                    .tasks
                    .iter()
                    .map(|task| task.negative(&values));
                let negative = negative.collect();
                Values::Fronts(values, negative)
            }
            Err(Error::NotPositiveDefinite { .. }) => return Ok(None),
            Err(error) => return Err(error),
        },
        None => match plain(symbolic, matrix)? {
            Some(values) => Values::Plain(values),
            None => return Ok(None),
        },
    };
    let symbolic = symbolic.clone();
    Ok(Some(SignedFactor { symbolic, values }))
}

/// L D Lᵀ without supernodes.
fn plain(symbolic: &Symbolic, matrix: &SparseMatrix<f64>) -> Result<Option<Vec<f64>>, Error> {
    let upper = symbolic.values_of(matrix)?;
    let inner = &symbolic.inner.symbolic;
    let scratch = inner.factorize_numeric_ldlt_scratch::<f64>(Par::Seq, Default::default());
    let (mut values, mut memory) = symbolic.memory::<f64>(scratch)?;
    let factored = inner
        .factorize_numeric_ldlt::<f64>(
            &mut values,
            symbolic.lower(&upper),
            Side::Lower,
            LdltRegularization::default(),
            Par::Seq,
            MemStack::new(&mut memory),
            Default::default(),
        )
        .is_ok();
    let pivots = symbolic.pivots(&values);
    let vanishes = pivots.iter().any(|&d| d == 0.0 || !d.is_finite());
    Ok((factored && !vanishes).then_some(values))
}

impl SignedFactor {
    /// How many pivots are negative, and so how many eigenvalues of the matrix.
    pub fn negative(&self) -> usize {
        match &self.values {
            Values::Fronts(_, negative) => negative.iter().map(Vec::len).sum(),
            Values::Plain(values) => {
                let pivots = self.symbolic.pivots(values);
                pivots.iter().filter(|&&d| d < 0.0).count()
            }
        }
    }

    /// Rows of the matrix.
    pub fn rows(&self) -> usize {
        self.symbolic.rows()
    }

    /// Entries of the factor.
    pub fn factor_entries(&self) -> usize {
        self.symbolic.factor_entries()
    }

    /// The solutions for a block of `columns` right-hand sides, row after row, as
    /// [`Cholesky::solve_in_place`](super::Cholesky::solve_in_place) finds them.
    ///
    /// ```
    /// use geom_core::algebra::{SparseMatrix, Symbolic};
    /// let entries = [(0, 0, 1.0), (0, 1, 2.0), (1, 0, 2.0), (1, 1, 1.0)];
    /// let matrix = SparseMatrix::from_triplets(2, 2, &entries)?;
    /// let factor = Symbolic::of(&matrix)?.factor_signed(&matrix)?.expect("no pivot vanishes");
    /// // Its eigenvalues are 3 and -1.
    /// assert_eq!(factor.negative(), 1);
    /// let x = factor.solve(&[5.0, 4.0], 1)?;
    /// assert!((x[0] - 1.0).abs() < 1e-14 && (x[1] - 2.0).abs() < 1e-14);
    /// # Ok::<(), geom_core::algebra::Error>(())
    /// ```
    ///
    /// # Errors
    /// [`Error::RightHandSide`] for a block of other size, [`Error::OutOfMemory`].
    pub fn solve(&self, block: &[f64], columns: usize) -> Result<Vec<f64>, Error> {
        let n = self.rows();
        let (found, expected) = (block.len(), n * columns);
        if found != expected {
            return Err(Error::RightHandSide { found, expected });
        }
        if expected == 0 {
            return Ok(Vec::new());
        }
        match (&self.values, &self.symbolic.inner.plan) {
            (Values::Fronts(factor, negative), Some(Plan { schedule, .. })) => {
                let mut x = vec![0.0; expected];
                let job = Job {
                    schedule,
                    factor,
                    negative,
                    block,
                    columns,
                };
                job.solve(&mut x);
                Ok(x)
            }
            (Values::Fronts(values, _) | Values::Plain(values), _) => {
                let symbolic = &self.symbolic.inner.symbolic;
                let scratch = symbolic.solve_in_place_scratch::<f64>(columns, Par::Seq);
                let memory = MemBuffer::try_new(scratch);
                let mut memory = memory.map_err(|_| Error::OutOfMemory { entries: 0 })?;
                let mut x = block.to_vec();
                LdltRef::new(symbolic, values).solve_in_place_with_conj(
                    Conj::No,
                    MatMut::from_row_major_slice_mut(&mut x, n, columns),
                    Par::Seq,
                    MemStack::new(&mut memory),
                );
                Ok(x)
            }
        }
    }
}
