//! `Bᵀ A⁻¹ B` of many sparse columns: what eliminating the unknowns of A takes off those that hang on them.
//!
//! It is `Wᵀ W` with `W = L⁻¹ B`, which has entries on the way from those of B to the root of the elimination tree alone (Gilbert and
//! Peierls, *Sparse partial pivoting in time proportional to arithmetic operations*, 1988). W is never whole: each task of the
//! substitution eliminates its rows for the columns that reach it, adds their products to the result, and leaves the task above
//! what is to be subtracted there. So memory is that of the result and of the rows of a few tasks.

use super::multifrontal::Kept;
use super::real::Forward;
use super::substitution::Schedule;
use crate::algebra::tall::{self, Tall};
use crate::compute::{lanes, parallel};

/// Columns that go side by side.
const LANES: usize = 8;

/// A row of a task for some columns.
type Row = [f64; LANES];

/// A column that reaches a task, and the first of the task's rows in which it may have an entry.
type Reaching = (u32, u32);

/// Rows of a task for [`LANES`] columns.
struct Group {
    /// The first of them; all before are zero.
    from: usize,
    rows: Vec<Row>,
}

/// What a task leaves to the one above.
#[derive(Default)]
struct Left {
    /// The columns that reach it, ascending, and which lane of all groups each one is.
    columns: Vec<(u32, u32)>,
    /// The rows that the task reaches.
    groups: Vec<Vec<Row>>,
}

impl Left {
    /// All but the task's own rows.
    fn of(columns: Vec<Reaching>, groups: Vec<Group>, own: usize) -> Self {
        let lanes = columns.into_iter().zip(0..);
        let mut columns: Vec<(u32, u32)> = lanes.map(|(c, lane)| (c.0, lane)).collect();
        columns.sort_unstable();
        let reached = |mut group: Group| {
            group.rows.drain(..own - group.from);
            group.rows.shrink_to_fit();
            group.rows
        };
        Self {
            columns,
            groups: groups.into_iter().map(reached).collect(),
        }
    }

    /// A column's rows, and its lane of these.
    fn column(&self, column: u32) -> Option<(&[Row], usize)> {
        let at = self.columns.binary_search_by_key(&column, |c| c.0).ok()?;
        let lane = self.columns[at].1 as usize;
        Some((&self.groups[lane / LANES], lane % LANES))
    }
}

/// `Bᵀ A⁻¹ B`, row after row and into zeros, with the values of the factor of A.
pub(super) fn inverse_gram<V: Kept>(
    schedule: &Schedule,
    values: &[V],
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
        let reaching: Vec<Vec<Reaching>> = level
            .clone()
            .map(|t| reaching(schedule, t, &entries[t], &left))
            .collect();
        let groups: Vec<(usize, &[Reaching])> = level
            .clone()
            .zip(&reaching)
            .flat_map(|(t, columns)| columns.chunks(LANES).map(move |group| (t, group)))
            .collect();
        let eliminated: Vec<Group> = parallel::map(groups.len(), |k| {
            let (t, group) = groups[k];
            eliminated(schedule, values, (t, group), &entries[t], &left)
        });
        let mut eliminated = eliminated.into_iter();
        for (t, columns) in level.clone().zip(reaching) {
            let task = &schedule.tasks[t];
            let groups: Vec<Group> = eliminated
                .by_ref()
                .take(columns.len().div_ceil(LANES))
                .collect();
            add(&mut gram, n, &columns, &groups, task.own.len());
            for &child in &task.children {
                left[child as usize] = Left::default();
            }
            left[t] = Left::of(columns, groups, task.own.len());
        }
    }
    gram
}

/// The columns that reach a task, those that do so in its first rows first: neighbours have about the same rows.
fn reaching(
    schedule: &Schedule,
    t: usize,
    entries: &[(u32, u32, f64)],
    left: &[Left],
) -> Vec<Reaching> {
    let children = schedule.tasks[t].children.iter().map(|&c| c as usize);
    let below = children.flat_map(|child| {
        let first = schedule.tasks[child].reached.iter().min();
        let columns = left[child].columns.iter();
        columns.filter_map(move |&(column, _)| Some((column, *first?)))
    });
    let own = entries.iter().map(|&(column, place, _)| (column, place));
    let mut columns: Vec<Reaching> = own.chain(below).collect();
    columns.sort_unstable();
    columns.dedup_by_key(|c| c.0);
    columns.sort_by_key(|c| c.1);
    columns
}

/// The rows of a task for some of the columns that reach it, those of its own eliminated.
fn eliminated<V: Kept>(
    schedule: &Schedule,
    values: &[V],
    (t, group): (usize, &[Reaching]),
    entries: &[(u32, u32, f64)],
    left: &[Left],
) -> Group {
    let task = &schedule.tasks[t];
    let lanes = || group.iter().map(|c| c.0).enumerate();
    let mut rows = vec![[0.0; LANES]; task.own.len() + task.reached.len()];
    for (lane, column) in lanes() {
        let first = entries.partition_point(|entry| entry.0 < column);
        let own = entries[first..].iter().take_while(|e| e.0 == column);
        own.for_each(|&(_, place, value)| rows[place as usize][lane] += value);
    }
    for &child in &task.children {
        let reached = &schedule.tasks[child as usize].reached;
        for (lane, column) in lanes() {
            let Some((below, from)) = left[child as usize].column(column) else {
                continue;
            };
            for (&to, row) in reached.iter().zip(below) {
                rows[to as usize][lane] += row[from];
            }
        }
    }
    lanes::vectorized(Forward {
        task,
        values,
        x: &mut rows,
    });
    let first = group.iter().map(|c| c.1 as usize).min();
    let from = first.map_or(0, |first| first.min(task.own.len()));
    rows.drain(..from);
    rows.shrink_to_fit();
    Group { from, rows }
}

/// Adds the products of the first `own` rows of all columns with each other.
fn add(gram: &mut [f64], n: usize, columns: &[Reaching], groups: &[Group], own: usize) {
    let tall = |g: usize, from: usize| {
        let group = &groups[g];
        let rows = &group.rows[from - group.from..own - group.from];
        Tall::of(rows.as_flattened(), LANES)
    };
    let products: Vec<Vec<f64>> = parallel::map(groups.len(), |g| {
        let mut products = vec![0.0; (g + 1) * LANES * LANES];
        let blocks = products.chunks_exact_mut(LANES * LANES);
        for (other, block) in blocks.enumerate() {
            let both = groups[g].from.max(groups[other].from);
            tall::add_gram(block, &[tall(g, both)], tall(other, both));
        }
        products
    });
    let ids = |g: usize| columns[g * LANES..].iter().take(LANES).enumerate();
    for (g, products) in products.iter().enumerate() {
        for (h, block) in products.chunks_exact(LANES * LANES).enumerate() {
            for (i, &(row, _)) in ids(g) {
                for (j, &(column, _)) in ids(h) {
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
