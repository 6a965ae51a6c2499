//! The sparse solver face against dense arithmetic and itself.

use geom_core::algebra::eigen::{self, eigenpairs};
use geom_core::algebra::iterate::Options;
use geom_core::algebra::{
    Cholesky, Error, Jacobi, Scalar, SparseMatrix, Symbolic, conjugate_gradients, refine,
    substitution,
};
use geom_core::compute::lists::Lists;
use geom_core::compute::random::SplitMix64;
use geom_core::mesh::shapes;
use geom_core::nalgebra::{Complex, DMatrix};
use geom_core::surface::laplace::{self, EdgeWeights};
use geom_core::testing::same_on_any_threads;
use geom_core::{Cpu, Run};
use proptest::prelude::*;

/// Numbers in −1…1.
fn values(count: usize, seed: u64) -> Vec<f64> {
    let mut random = SplitMix64::new(seed);
    (0..count).map(|_| random.symmetric()).collect()
}

/// `K + s M` of a torus.
fn screened(s: f64) -> SparseMatrix {
    let mesh = shapes::torus(3.0, 1.0, 60, 33);
    let laplace::Mass::Lumped(mass) = laplace::lumped_mass(&mesh) else {
        unreachable!()
    };
    let stiffness = laplace::stiffness(&mesh).unwrap();
    stiffness
        .plus(s, &SparseMatrix::diagonal_of(&mass))
        .unwrap()
}

/// The connection form of crosses on a torus, with a little of the identity.
fn hermitian() -> SparseMatrix<Complex<f64>> {
    let mesh = shapes::torus(3.0, 1.0, 40, 21);
    let form = laplace::connection(&mesh, 4, EdgeWeights::Shape).unwrap();
    let one = vec![Complex::from(1e-3); form.areas.len()];
    form.matrix
        .plus(1.0, &SparseMatrix::diagonal_of(&one))
        .unwrap()
}

fn largest<T: Scalar>(a: &[T], b: &[T]) -> f64 {
    a.iter()
        .zip(b)
        .fold(0.0, |m, (&a, &b)| (a - b).norm_squared().sqrt().max(m))
}

fn solves<T: Scalar>(matrix: &SparseMatrix<T>, exact: &[T], columns: usize) {
    let b = matrix.multiply(exact, columns);
    let factor = Cholesky::of(matrix).unwrap();
    let mut x = b.clone();
    factor.solve_in_place(&mut x, columns).unwrap();
    assert!(largest(&x, exact) < 1e-8, "{}", largest(&x, exact));
    // Each column is what it is by itself, to the last bits.
    for j in 0..columns {
        let one: Vec<T> = b.iter().skip(j).step_by(columns).copied().collect();
        let of_block: Vec<T> = x.iter().skip(j).step_by(columns).copied().collect();
        assert!(largest(&factor.solve(&one).unwrap(), &of_block) < 1e-10);
    }
    let refined = refine(matrix, &factor, &b, columns, &Options::default()).unwrap();
    assert!(refined.converged, "{:?}", refined.residuals);
    assert!(largest(&refined.values, exact) <= largest(&x, exact) + 1e-12);
    let cg = conjugate_gradients(matrix, &factor, &b, columns, &Options::default()).unwrap();
    assert!(cg.converged && cg.iterations <= 3, "{}", cg.iterations);
    assert!(largest(&cg.values, exact) < 1e-8);
}

#[test]
fn many_right_hand_sides_real_and_hermitian() {
    let real = screened(1e-3);
    for columns in [1, 2, 3, 4, 7, 8, 17] {
        solves(&real, &values(real.rows() * columns, 3), columns);
    }
    let complex = hermitian();
    for columns in [1, 5, 9] {
        let both = values(2 * complex.rows() * columns, 4);
        let exact: Vec<_> = both
            .as_chunks::<2>()
            .0
            .iter()
            .map(|&[re, im]| Complex::new(re, im))
            .collect();
        solves(&complex, &exact, columns);
    }
}

proptest! {
    #![proptest_config(geom_core::testing::cases(40))]
    /// Small matrices with any pattern, against dense LU.
    #[test]
    fn any_small_matrix(n in 1usize..30, seed in any::<u64>(), dense in 0.05f64..0.9) {
        let chance = values(n * n, seed);
        let mut entries = Vec::new();
        for i in 0..n {
            entries.push((i as u32, i as u32, n as f64));
            for j in 0..i {
                let v = chance[i * n + j];
                if v.abs() < dense {
                    entries.extend([(i as u32, j as u32, v), (j as u32, i as u32, v)]);
                }
            }
        }
        let matrix = SparseMatrix::from_triplets(n, n, &entries).unwrap();
        let b = values(n, seed ^ 77);
        let x = Cholesky::of(&matrix).unwrap().solve(&b).unwrap();
        let full = DMatrix::from_fn(n, n, |i, j| matrix.get(i, j));
        let reference = full.lu().solve(&DMatrix::from_column_slice(n, 1, &b)).unwrap();
        prop_assert!(largest(&x, reference.as_slice()) < 1e-10);
    }
}

#[test]
fn one_analysis_serves_many_matrices() {
    let matrix = screened(1.0);
    let symbolic = Symbolic::of(&matrix).unwrap();
    let b = values(matrix.rows(), 9);
    for shift in [1e-3, 0.1, 10.0] {
        let matrix = screened(shift);
        let x = symbolic.factor(&matrix).unwrap().solve(&b).unwrap();
        let reference = Cholesky::of(&matrix).unwrap().solve(&b).unwrap();
        assert_eq!(x, reference);
    }
    // As many eigenvalues below zero as the shift says.
    assert_eq!(
        symbolic.negative_eigenvalues(&screened(1.0)).unwrap(),
        Some(0)
    );
    assert_eq!(
        symbolic.negative_eigenvalues(&screened(-1e-3)).unwrap(),
        Some(1)
    );
    let other = screened(1.0)
        .plus(
            1.0,
            &SparseMatrix::from_triplets(
                matrix.rows(),
                matrix.rows(),
                &[(0, 900, 0.1), (900, 0, 0.1)],
            )
            .unwrap(),
        )
        .unwrap();
    assert_eq!(symbolic.factor(&other).unwrap_err(), Error::OtherPattern);
}

#[test]
fn conjugate_gradients_with_the_factor_of_a_similar_matrix() {
    let factor = Cholesky::of(&screened(0.1)).unwrap();
    let matrix = screened(0.02);
    let exact = values(matrix.rows() * 3, 2);
    let b = matrix.multiply(&exact, 3);
    let cg = conjugate_gradients(&matrix, &factor, &b, 3, &Options::default()).unwrap();
    assert!(cg.converged && cg.iterations < 30, "{}", cg.iterations);
    assert!(largest(&cg.values, &exact) < 1e-8);
    // A zero column stays zero; too few iterations are said to be too few.
    let zero = vec![0.0; matrix.rows()];
    let nothing = conjugate_gradients(&matrix, &factor, &zero, 1, &Options::default()).unwrap();
    assert_eq!((nothing.values, nothing.iterations), (zero, 0));
    let few = Options {
        max_iterations: 2,
        ..Options::default()
    };
    let short = conjugate_gradients(&matrix, &factor, &b, 3, &few).unwrap();
    assert!(!short.converged && short.residuals.iter().all(|&r| r > 1e-12));
}

/// The diagonal does where it weighs much; one that is not positive is named.
#[test]
fn conjugate_gradients_with_the_diagonal() {
    let matrix = screened(0.5);
    let exact = values(matrix.rows() * 3, 4);
    let b = matrix.multiply(&exact, 3);
    let diagonal = Jacobi::of(&matrix).unwrap();
    let cg = conjugate_gradients(&matrix, &diagonal, &b, 3, &Options::default()).unwrap();
    assert!(cg.converged && largest(&cg.values, &exact) < 1e-8);
    // Of a diagonal matrix it is the inverse.
    let scales = SparseMatrix::diagonal_of(&[4.0, 3.0]);
    let diagonal = Jacobi::of(&scales).unwrap();
    let usual = Options::default();
    let one = conjugate_gradients(&scales, &diagonal, &[2.0, 6.0], 1, &usual).unwrap();
    assert!(one.iterations == 1 && largest(&one.values, &[0.5, 2.0]) < 1e-15);
    for entry in [0.0, -1.0] {
        let refused = Jacobi::of(&SparseMatrix::diagonal_of(&[1.0, entry]));
        assert_eq!(refused, Err(Error::NotPositiveDefinite { row: 1 }));
    }
}

/// A residual that is no number closes no column.
#[test]
fn what_leaves_the_range_of_numbers_has_not_converged() {
    // The products of the first step overflow, so that its residual is no number.
    let matrix = SparseMatrix::diagonal_of(&[1e200, 1e200]);
    let factor = Cholesky::of(&SparseMatrix::diagonal_of(&[1e-10, 1e-10])).unwrap();
    let once = Options {
        max_iterations: 1,
        ..Options::default()
    };
    for options in [once, Options::default()] {
        let found = conjugate_gradients(&matrix, &factor, &[1e149, 1e149], 1, &options);
        assert!(!found.is_ok_and(|solution| solution.converged));
    }
}

#[test]
fn bad_input_is_named() {
    let matrix = screened(1.0);
    let factor = Cholesky::of(&matrix).unwrap();
    assert_eq!(
        factor.solve(&[1.0]).unwrap_err(),
        Error::RightHandSide {
            found: 1,
            expected: matrix.rows()
        }
    );
    let indefinite = screened(-1.0);
    assert!(matches!(
        Cholesky::of(&indefinite),
        Err(Error::NotPositiveDefinite { .. })
    ));
    assert!(matches!(
        conjugate_gradients(
            &indefinite,
            &factor,
            &values(matrix.rows(), 1),
            1,
            &Options::default()
        ),
        Err(Error::NotPositiveDefinite { .. })
    ));
    // Finite, but not its norm: nothing would be missing relative to that.
    let huge = vec![1e160; matrix.rows()];
    let usual = Options::default();
    for found in [
        refine(&matrix, &factor, &huge, 1, &usual),
        conjugate_gradients(&matrix, &factor, &huge, 1, &usual),
    ] {
        assert_eq!(found, Err(Error::RightHandSideTooLarge { column: 0 }));
    }
    let mut b = vec![1.0; matrix.rows()];
    b[5] = f64::NAN;
    assert_eq!(
        refine(&matrix, &factor, &b, 1, &Options::default()).unwrap_err(),
        Error::NotFinite { row: 5, column: 0 }
    );
    let nan = Options {
        tolerance: f64::NAN,
        ..Options::default()
    };
    assert!(matches!(
        nan.check(),
        Err(Error::Option(out)) if out.option == "tolerance"
    ));
    let not_finite = SparseMatrix::from_triplets(2, 2, &[(0, 0, 1.0), (1, 1, f64::INFINITY)]);
    assert_eq!(
        not_finite.unwrap_err(),
        Error::NotFinite { row: 1, column: 1 }
    );
    let outside = SparseMatrix::from_triplets(2, 2, &[(0, 2, 1.0)]);
    assert!(matches!(outside, Err(Error::OutOfRange { column: 2, .. })));
    let small = SparseMatrix::diagonal_of(&[1.0, 2.0]);
    assert!(matches!(
        conjugate_gradients(&small, &factor, &[1.0, 1.0], 1, &Options::default()),
        Err(Error::Shape { .. })
    ));
}

/// `bᵀ A⁻¹ b` and `bᵀ A⁻¹ c` of vectors of a few rows, against full solves: in blocks that are not full, with rows named twice,
/// and empty.
#[test]
fn energies_of_sparse_vectors_are_those_of_solves() {
    let path: Vec<(u32, u32, f64)> = (0..40u32)
        .flat_map(|i| {
            let next = (i + 1).min(39);
            [(i, i, 2.5), (i, next, -0.5), (next, i, -0.5)]
        })
        .collect();
    let path = SparseMatrix::from_triplets(40, 40, &path).unwrap();
    for matrix in [path, screened(1e-3)] {
        let factor = Cholesky::of(&matrix).unwrap();
        let n = matrix.rows();
        let mut random = SplitMix64::new(5);
        let mut sparse: Vec<Vec<(usize, f64)>> = (0..21)
            .map(|count| {
                let row = |_| (random.below(n), 1.0);
                let rows: Vec<(usize, f64)> = (0..count).map(row).collect();
                let value = |&(row, _): &(usize, f64)| (row, random.symmetric());
                rows.iter().map(value).collect()
            })
            .collect();
        sparse.push(vec![(n - 1, 0.25), (0, 2.0), (n - 1, 0.5)]);
        let energies = same_on_any_threads(|| factor.inverse_energies(&sparse).unwrap());
        assert_eq!(energies.len(), sparse.len());
        assert_eq!(energies[0], 0.0);
        let gram = same_on_any_threads(|| factor.inverse_gram(&sparse).unwrap());
        let rows = gram.chunks_exact(sparse.len());
        for ((b, energy), row) in sparse.iter().zip(energies).zip(rows) {
            let mut full = vec![0.0; n];
            b.iter().for_each(|&(row, value)| full[row] += value);
            let x = factor.solve(&full).unwrap();
            let exact: f64 = full.iter().zip(&x).map(|(b, x)| b * x).sum();
            assert!(
                (energy - exact).abs() <= 1e-10 * exact.max(1.0),
                "{energy} {exact}"
            );
            for (c, product) in sparse.iter().zip(row) {
                let exact: f64 = c.iter().map(|&(row, value)| value * x[row]).sum();
                assert!((product - exact).abs() <= 1e-10, "{product} {exact}");
            }
        }
        let outside = factor.inverse_energies(&[vec![], vec![(0, 1.0), (n, 1.0)]]);
        assert!(matches!(outside, Err(Error::OutOfRange { row, .. }) if row == n));
        let outside = factor.inverse_gram(&[vec![(n, 1.0)]]);
        assert!(matches!(outside, Err(Error::OutOfRange { row, .. }) if row == n));
    }
}

/// Half of the memory, the same analysis: close to the right inverse, symmetric, and refused where the whole one is.
#[test]
fn a_factor_in_single_precision_is_close_and_symmetric() {
    let matrix = screened(1e-2);
    let n = matrix.rows();
    let symbolic = Symbolic::of(&matrix).unwrap();
    let whole = symbolic.factor(&matrix).unwrap();
    let [b, c] = [7, 8].map(|seed| values(n, seed));
    let [x, y] = same_on_any_threads(|| {
        let single = symbolic.factor_single(&matrix).unwrap();
        [&b, &c].map(|b| single.solve(b).unwrap())
    });
    let exact = whole.solve(&b).unwrap();
    let size = exact.iter().fold(0.0, |m: f64, x| m.max(x.abs()));
    let off = largest(&x, &exact) / size;
    // Rounded, by what f32 has.
    assert!(off > 1e-9 && off < 1e-6, "{off}");
    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    let (one, other) = (dot(&x, &c), dot(&b, &y));
    assert!((one - other).abs() < 1e-15 * size * n as f64);

    // Its inverse is one map, however it is asked for.
    let single = symbolic.factor_single(&matrix).unwrap();
    let rows: Vec<usize> = (0..n).step_by(n / 19).collect();
    let units: Vec<Vec<(usize, f64)>> = rows.iter().map(|&row| vec![(row, 1.0)]).collect();
    let gram = same_on_any_threads(|| single.inverse_gram(&units).unwrap());
    for (&row, products) in rows.iter().zip(gram.chunks(rows.len())) {
        let mut unit = vec![0.0; n];
        unit[row] = 1.0;
        let column = single.solve(&unit).unwrap();
        for (&other, product) in rows.iter().zip(products) {
            assert!((product - column[other]).abs() < 1e-12 * column[row]);
        }
    }
    // What it lacks, conjugate gradients have in a few steps.
    let both: Vec<f64> = b.iter().zip(&c).flat_map(|(&b, &c)| [b, c]).collect();
    let options = Options::default();
    let found = conjugate_gradients(&matrix, &single, &both, 2, &options).unwrap();
    assert!(found.converged && found.iterations <= 3);

    let indefinite = matrix.map(|i, j, a| if i == j && i == 40 { -a } else { a });
    let row = |error| match error {
        Error::NotPositiveDefinite { row } => row,
        other => panic!("{other}"),
    };
    assert_eq!(
        row(symbolic.factor_single(&indefinite).unwrap_err()),
        row(symbolic.factor(&indefinite).unwrap_err())
    );
    // Kept as it is: beyond f32, and too small to gain anything.
    let large = matrix.map(|_, _, a| a * 1e90);
    for matrix in [large, matrix.leading(3)] {
        let b = &b[..matrix.rows()];
        let symbolic = Symbolic::of(&matrix).unwrap();
        let exact = symbolic.factor(&matrix).unwrap().solve(b).unwrap();
        let kept = symbolic.factor_single(&matrix).unwrap();
        assert_eq!(kept.solve(b).unwrap(), exact);
    }
}

#[test]
fn bits_do_not_depend_on_threads() {
    let matrix = screened(1e-2);
    let b = values(matrix.rows() * 11, 6);
    same_on_any_threads(|| {
        let factor = Cholesky::of(&matrix).unwrap();
        let mut x = b.clone();
        factor.solve_in_place(&mut x, 11).unwrap();
        (
            x,
            conjugate_gradients(&matrix, &factor, &b, 11, &Options::default()).unwrap(),
        )
    });
}

/// Found by `cargo xtask fuzz` (smooth, case 20; distances, case 796): faer counts pivots from 1 where a factor has no
/// supernodes, and the last of them was beyond the rows.
#[test]
fn the_row_whose_pivot_is_not_positive_is_named() {
    for row in 0..3 {
        let mut diagonal = [1.0; 3];
        diagonal[row] = -1.0;
        let found = Cholesky::of(&SparseMatrix::diagonal_of(&diagonal)).unwrap_err();
        assert_eq!(found, Error::NotPositiveDefinite { row });
    }
    // A factor with supernodes: all minors without the row are positive.
    let matrix = screened(1.0);
    let row = matrix.rows() / 2;
    let spoilt = matrix.map(|i, j, a| if (i, j) == (row, row) { -1e6 } else { a });
    let found = Cholesky::of(&spoilt).unwrap_err();
    assert_eq!(found, Error::NotPositiveDefinite { row });
}

/// A full matrix is one front of several slabs, whose updates are handed out in pieces.
#[test]
fn wide_fronts() {
    let n = 300u32;
    let value = |i: u32, j: u32| f64::from(i.min(j) * 7 % 13 + i.max(j) * 5 % 11) / 12.0 - 1.0;
    let entry = |i, j| {
        (
            i,
            j,
            if i == j {
                2.0 * f64::from(n)
            } else {
                value(i, j)
            },
        )
    };
    let entries: Vec<_> = (0..n)
        .flat_map(|i| (0..n).map(move |j| entry(i, j)))
        .collect();
    let matrix = SparseMatrix::from_triplets(n as usize, n as usize, &entries).unwrap();
    solves(&matrix, &values(n as usize * 3, 8), 3);
    let b = values(n as usize, 9);
    same_on_any_threads(|| Cholesky::of(&matrix).unwrap().solve(&b).unwrap());
    for row in [0, 70, 299] {
        let spoilt = matrix.map(|i, j, a| if (i, j) == (row, row) { -a } else { a });
        let found = Cholesky::of(&spoilt).unwrap_err();
        assert_eq!(found, Error::NotPositiveDefinite { row });
    }
}

/// Of a matrix that is not definite: solutions, and as many negative pivots as eigenvalues.
#[test]
fn signs_of_pivots() {
    let solves = |matrix: &SparseMatrix, below: usize| {
        let n = matrix.rows();
        let symbolic = Symbolic::of(matrix).unwrap();
        let factor = symbolic.factor_signed(matrix).unwrap().unwrap();
        assert_eq!(factor.negative(), below);
        assert_eq!(symbolic.negative_eigenvalues(matrix).unwrap(), Some(below));
        for columns in [1, 3, 8, 17] {
            let exact = values(n * columns, 5);
            let b = matrix.multiply(&exact, columns);
            let x = factor.solve(&b, columns).unwrap();
            assert!(largest(&x, &exact) < 1e-7, "{}", largest(&x, &exact));
            same_on_any_threads(|| {
                let factor = symbolic.factor_signed(matrix).unwrap().unwrap();
                factor.solve(&b, columns).unwrap()
            });
        }
        let one = Error::RightHandSide {
            found: n + 1,
            expected: n,
        };
        assert_eq!(factor.solve(&vec![0.0; n + 1], 1).unwrap_err(), one);
        assert!(factor.solve(&[], 0).unwrap().is_empty());
    };
    // In fronts of many sizes; eigenvalues by searches from below.
    let mesh = shapes::torus(3.0, 1.0, 60, 33);
    let (stiffness, mass) = (
        laplace::stiffness(&mesh).unwrap(),
        laplace::lumped_mass(&mesh),
    );
    let from_below = eigen::Options {
        shift: Some(-0.01),
        ..eigen::Options::default()
    };
    let pairs = eigenpairs(&stiffness, &mass, 40, &from_below, Run::on(&Cpu)).unwrap();
    for count in [1, 9, 21, 40] {
        // The middle of a gap behind so many.
        let gap = (count..40).find(|&k| pairs.values[k] > 1.01 * pairs.values[k - 1]);
        let (shift, below) = match gap {
            Some(k) => (f64::midpoint(pairs.values[k - 1], pairs.values[k]), k),
            None => (-1.0, 0),
        };
        solves(&screened(-shift), below);
    }
    // In one front of several slabs.
    let n = 200;
    let chance = values(n * n, 6);
    let entry = |i: usize, j: usize| {
        let diagonal = if i.is_multiple_of(3) { -60.0 } else { 60.0 };
        let off = chance[i.min(j) * n + i.max(j)];
        (i as u32, j as u32, if i == j { diagonal } else { off })
    };
    let entries: Vec<_> = (0..n).flat_map(|i| (0..n).map(move |j| (i, j))).collect();
    let entries: Vec<_> = entries.into_iter().map(|(i, j)| entry(i, j)).collect();
    solves(
        &SparseMatrix::from_triplets(n, n, &entries).unwrap(),
        n.div_ceil(3),
    );
    // Small, without fronts.
    let small = [(0, 0, 1.0), (0, 1, 2.0), (1, 0, 2.0), (1, 1, 1.0)];
    solves(&SparseMatrix::from_triplets(2, 2, &small).unwrap(), 1);
}

#[test]
fn a_pivot_that_vanishes_is_no_factor() {
    for n in [2, 200] {
        let pairs = (0..n).flat_map(|i| (0..n).map(move |j| (i, j)));
        let entries: Vec<_> = pairs.map(|(i, j)| (i, j, f64::from(i != j))).collect();
        let matrix = SparseMatrix::from_triplets(n as usize, n as usize, &entries).unwrap();
        let symbolic = Symbolic::of(&matrix).unwrap();
        assert!(symbolic.factor_signed(&matrix).unwrap().is_none());
        assert_eq!(symbolic.negative_eigenvalues(&matrix).unwrap(), None);
    }
}

/// Fronts of many sizes in many tasks: the surface of a body that is not symmetric.
#[test]
fn many_tasks_with_the_same_bits() {
    let mesh = shapes::torus(3.0, 1.0, 170, 60);
    let stiffness = laplace::stiffness(&mesh).unwrap();
    let one = SparseMatrix::diagonal_of(&values(stiffness.rows(), 10));
    let matrix = stiffness.plus(1.0, &one.map(|_, _, a| 1.5 + a)).unwrap();
    solves(&matrix, &values(matrix.rows() * 3, 11), 3);
    let b = values(matrix.rows() * 8, 12);
    same_on_any_threads(|| {
        let mut x = b.clone();
        let factor = Cholesky::of(&matrix).unwrap();
        factor.solve_in_place(&mut x, 8).unwrap();
        x
    });
}

/// A factor whose tree has two long branches and many short ones: solved in one task and in many.
#[test]
fn tasks_solve_what_one_sweep_solves() {
    // Column j of a binary tree in postorder has the rows of all its ancestors.
    let depth = 9;
    let mut parents = Vec::new();
    fn build(depth: usize, parents: &mut Vec<Option<usize>>) -> usize {
        let children: Vec<usize> = if depth == 0 {
            Vec::new()
        } else {
            (0..2).map(|_| build(depth - 1, parents)).collect()
        };
        parents.push(None);
        let own = parents.len() - 1;
        children.into_iter().for_each(|c| parents[c] = Some(own));
        own
    }
    build(depth, &mut parents);
    let n = parents.len();
    let rows: Vec<Vec<u32>> = (0..n)
        .map(|j| {
            std::iter::successors(parents[j], |&p| parents[p])
                .map(|p| p as u32)
                .collect()
        })
        .collect();
    let mut values = Vec::new();
    let mut columns = Vec::new();
    for (j, rows) in rows.iter().enumerate() {
        let first = values.len();
        values.push(2.0 + (j % 7) as f64);
        values.extend((0..rows.len()).map(|i| ((3 * i + j) % 5) as f64 / 10.0 - 0.2));
        columns.push((rows.as_slice(), first..values.len()));
    }
    let original = |i: usize| (i * 5 + 3) % n;
    let b: Vec<f64> = (0..2 * n).map(|i| ((i * 37) % 101) as f64 - 50.0).collect();
    // By the definition, column after column.
    let mut x: Vec<[f64; 2]> = (0..n)
        .map(|i| [b[2 * original(i)], b[2 * original(i) + 1]])
        .collect();
    let axpy = |x: &mut [f64; 2], l: f64, y: [f64; 2]| {
        x.iter_mut().zip(y).for_each(|(x, y)| *x -= l * y);
    };
    for j in 0..n {
        let column = &values[columns[j].1.clone()];
        x[j] = x[j].map(|x| x / column[0]);
        let own = x[j];
        for (&row, &l) in rows[j].iter().zip(&column[1..]) {
            axpy(&mut x[row as usize], l, own);
        }
    }
    for j in (0..n).rev() {
        let column = &values[columns[j].1.clone()];
        for (&row, &l) in rows[j].iter().zip(&column[1..]) {
            let other = x[row as usize];
            axpy(&mut x[j], l, other);
        }
        x[j] = x[j].map(|x| x / column[0]);
    }
    for (large, small) in [(usize::MAX, usize::MAX), (2000, 100), (60, 1), (1, 0)] {
        let sizes = [large, small];
        let (tasks, solved) = substitution::solved(&columns, original, sizes, &values, &b);
        let alone = large == usize::MAX;
        assert_eq!(tasks == 1, alone);
        for (i, x) in x.iter().enumerate() {
            for (found, x) in solved[original(i)].iter().zip(x) {
                assert!((found - x).abs() < 1e-9 * (1.0 + x.abs()), "{i} {large}");
            }
        }
    }
}

/// Triplets are sorted piece by piece, and rows made block by block: sums are those of adding in the given order, bit for bit, and the
/// error that of the first at fault. Rows that are written one by one are the same.
#[test]
fn triplets_of_many_pieces_are_added_in_their_order() {
    const ROWS: usize = 5000;
    let mut random = SplitMix64::new(5);
    let mut below = |n: usize| (random.unit() * n as f64) as usize;
    // Near the diagonal, so that many meet.
    let mut entries: Vec<(u32, u32, f64)> = Vec::new();
    for k in 0..300_000 {
        let row = below(ROWS);
        let column = (row + below(7)) % ROWS;
        entries.push((row as u32, column as u32, (k as f64).sin()));
    }
    let mut sums = std::collections::BTreeMap::new();
    for &(i, j, x) in &entries {
        *sums.entry((i as usize, j as usize)).or_insert(0.0) += x;
    }
    let matrix = SparseMatrix::from_triplets(ROWS, ROWS, &entries).unwrap();
    let all = (0..ROWS).flat_map(|i| matrix.row(i).map(move |(j, x)| ((i, j), x)));
    assert!(all.eq(sums), "not the sums in the given order");

    // The same row by row.
    let of_row = Lists::of(ROWS, || entries.iter().map(|&(i, j, x)| (i, (j, x))));
    let by_rows = |columns| {
        SparseMatrix::from_rows(ROWS, columns, |i, row| {
            row.extend_from_slice(of_row.list(i));
        })
    };
    assert_eq!(by_rows(ROWS).unwrap(), matrix);
    let (row, column) = (0..ROWS)
        .flat_map(|i| matrix.row(i).map(move |e| (i, e.0)))
        .find(|e| e.1 >= ROWS - 7)
        .unwrap();
    let refused = by_rows(ROWS - 7).unwrap_err();
    assert!(
        matches!(refused, Error::OutOfRange { row: r, column: c, .. } if (r, c) == (row, column)),
        "{refused}"
    );
    let flawed = SparseMatrix::from_rows(2, 2, |i, row| {
        row.push((1, [1.0, f64::NAN][i]));
    });
    assert_eq!(flawed.unwrap_err(), Error::NotFinite { row: 1, column: 1 });
    let wide = SparseMatrix::<f64>::from_rows(0, u32::MAX as usize, |_, _| {});
    assert!(matches!(wide, Err(Error::TooLarge { .. })), "{wide:?}");

    entries[290_000].2 = f64::NAN;
    entries[150_000].0 = ROWS as u32;
    let refused = SparseMatrix::from_triplets(ROWS, ROWS, &entries);
    assert!(matches!(refused, Err(Error::OutOfRange { row: ROWS, .. })));
}
