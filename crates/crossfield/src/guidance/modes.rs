//! Eigenfunctions of the surface, and which of them guide.

use geom_core::algebra::eigen::{self, eigenpairs};
use geom_core::surface::laplace;
use geom_core::{Cpu, Run, TriMesh};

use super::Modes;
use crate::Error;

/// Most modes that are chosen without a person.
const MOST: usize = 6;
/// Directions need no more digits.
const TOLERANCE: f64 = 1e-6;

/// An eigenfunction with its eigenvalue, Å⁻².
pub(super) struct Mode {
    pub(super) value: f64,
    pub(super) function: Vec<f64>,
}

/// The wanted eigenfunctions of a connected surface, of modes that are checked; computed on the CPU: the factor of shift and
/// invert is there.
///
/// Numbers that the surface does not have, with as many vertices or fewer, are left out. Shift and invert needs one
/// factorization of a matrix with a row per vertex, and some solves per function.
pub(super) fn eigenfunctions(mesh: &TriMesh, modes: &Modes) -> Result<Vec<Mode>, Error> {
    let highest = match modes {
        Modes::Auto => MOST + 1,
        Modes::Numbers(numbers) => numbers.iter().copied().fold(0, usize::max),
    };
    let options = eigen::Options {
        tolerance: TOLERANCE,
        ..eigen::Options::default()
    };
    let stiffness = laplace::stiffness(mesh)?;
    let mass = laplace::lumped_mass(mesh);
    let pairs = eigenpairs(&stiffness, &mass, highest + 1, &options, Run::on(&Cpu))?;
    let numbers = match modes {
        Modes::Auto => (1..=standing_apart(&pairs.values)).collect(),
        Modes::Numbers(numbers) => numbers.clone(),
    };
    let (values, mut vectors) = (pairs.values, pairs.vectors);
    Ok(numbers
        .into_iter()
        .filter(|&n| n < values.len())
        .map(|n| Mode {
            value: values[n],
            function: std::mem::take(&mut vectors[n]),
        })
        .collect())
}

/// How many of the lowest modes to take: the number before the largest ratio of neighbouring eigenvalues, at most
/// [`MOST`]. A cluster of nearly equal ones, of which only the space is defined, is taken whole or not at all; the first
/// mode of an elongated body stands alone.
pub(crate) fn standing_apart(values: &[f64]) -> usize {
    let most = MOST.min(values.len().saturating_sub(2));
    (1..=most)
        .max_by(|&a, &b| {
            let ratio = |k: usize| values[k + 1] / values[k].max(f64::MIN_POSITIVE);
            // Of equal gaps the first.
            ratio(a).total_cmp(&ratio(b)).then(b.cmp(&a))
        })
        .unwrap_or(values.len().saturating_sub(1))
}
