//! `Bᵀ A⁻¹ B` of many sparse columns: what eliminating the unknowns of A takes off those that hang on them.
//!
//! It is `Wᵀ W` with `W = L⁻¹ B`, which has entries on the way from those of B to the root of the elimination tree alone (Gilbert and
//! Peierls, *Sparse partial pivoting in time proportional to arithmetic operations*, 1988). W is never whole: each task of the
//! substitution eliminates its rows for the columns that reach it, adds their products to the result, and leaves the task above
//! what is to be subtracted there. So memory is that of the result and of the rows of a few tasks.

use super::substitution::{Direction, Schedule, run};
use crate::algebra::tall::{self, Tall};
use crate::compute::parallel;

/// Columns that go side by side.
const LANES: usize = 8;

/// Rows of a task for some columns.
type Rows = Vec<[f64; LANES]>;

/// What a task leaves to the one above.
#[derive(Default)]
struct Left {
    /// The columns that reach it, ascending.
    columns: Vec<u32>,
    /// Of [`LANES`] of them each, the rows that the task reaches.
    groups: Vec<Rows>,
}

/// `Bᵀ A⁻¹ B`, row after row and into zeros, with the values of the factor of A. Columns that are neighbours in the list are cheapest where they
/// are neighbours in the matrix.
pub(super) fn inverse_gram(
    schedule: &Schedule,
    values: &[f64],
    columns: &[Vec<(usize, f64)>],
    mut gram: Vec<f64>,
) -> Vec<f64> {
    let n = columns.len();
    // Entries of each task: column, place and value.
    let mut entries: Vec<Vec<(u32, u32, f64)>> = vec![Vec::new(); schedule.tasks.len()];
    for (column, vector) in (0..).zip(columns) {
        for &(row, value) in vector {
            let (task, place) = schedule.places[row];
            entries[task as usize].push((column, place, value));
        }
    }
    let mut left: Vec<Left> = (0..schedule.tasks.len()).map(|_| Left::default()).collect();
    for level in &schedule.levels {
        let reaching: Vec<Vec<u32>> = level
            .clone()
            .map(|t| {
                let own = entries[t].iter().map(|entry| entry.0);
                let children = schedule.tasks[t].children.iter();
                let below = children.flat_map(|&c| left[c as usize].columns.iter().copied());
                let mut columns: Vec<u32> = own.chain(below).collect();
                columns.sort_unstable();
                columns.dedup();
                columns
            })
            .collect();
        let groups: Vec<(usize, &[u32])> = level
            .clone()
            .zip(&reaching)
            .flat_map(|(t, columns)| columns.chunks(LANES).map(move |group| (t, group)))
            .collect();
        let eliminated: Vec<Rows> = parallel::map(groups.len(), |k| {
            let (t, group) = groups[k];
            eliminated(schedule, values, (t, group), &entries[t], &left)
        });
        let mut eliminated = eliminated.into_iter();
        for (t, columns) in level.clone().zip(reaching) {
            let task = &schedule.tasks[t];
            let mut groups: Vec<Rows> = eliminated
                .by_ref()
                .take(columns.len().div_ceil(LANES))
                .collect();
            add(&mut gram, n, &columns, &groups, task.own.len());
            for rows in &mut groups {
                rows.drain(..task.own.len());
                rows.shrink_to_fit();
            }
            for &child in &task.children {
                left[child as usize] = Left::default();
            }
            left[t] = Left { columns, groups };
        }
    }
    gram
}

/// The rows of a task for some of the columns that reach it, those of its own eliminated.
fn eliminated(
    schedule: &Schedule,
    values: &[f64],
    (t, group): (usize, &[u32]),
    entries: &[(u32, u32, f64)],
    left: &[Left],
) -> Rows {
    let task = &schedule.tasks[t];
    let lanes = || group.iter().enumerate();
    let mut x = vec![[0.0; LANES]; task.own.len() + task.reached.len()];
    for (lane, &column) in lanes() {
        let first = entries.partition_point(|entry| entry.0 < column);
        let own = entries[first..].iter().take_while(|e| e.0 == column);
        own.for_each(|&(_, place, value)| x[place as usize][lane] += value);
    }
    for &child in &task.children {
        let (below, reached) = (
            &left[child as usize],
            &schedule.tasks[child as usize].reached,
        );
        for (lane, column) in lanes() {
            let Ok(at) = below.columns.binary_search(column) else {
                continue;
            };
            let rows = &below.groups[at / LANES];
            for (&to, row) in reached.iter().zip(rows) {
                x[to as usize][lane] += row[at % LANES];
            }
        }
    }
    run(task, values, &mut x, Direction::Down);
    x
}

/// Adds the products of the first `own` rows of all columns with each other.
fn add(gram: &mut [f64], n: usize, columns: &[u32], groups: &[Rows], own: usize) {
    let tall = |g: usize| Tall::of(groups[g][..own].as_flattened(), LANES);
    let products: Vec<Vec<f64>> = parallel::map(groups.len(), |g| {
        let mut products = vec![0.0; (g + 1) * LANES * LANES];
        let blocks = products.chunks_exact_mut(LANES * LANES);
        for (other, block) in blocks.enumerate() {
            tall::add_gram(block, tall(g), tall(other));
        }
        products
    });
    let ids = |g: usize| columns[g * LANES..].iter().take(LANES).enumerate();
    for (g, products) in products.iter().enumerate() {
        for (h, block) in products.chunks_exact(LANES * LANES).enumerate() {
            for (i, &row) in ids(g) {
                for (j, &column) in ids(h) {
                    let value = block[i * LANES + j];
                    gram[row as usize * n + column as usize] += value;
                    if g != h {
                        gram[column as usize * n + row as usize] += value;
                    }
                }
            }
        }
    }
}
