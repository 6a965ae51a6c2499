//! `X ← L⁻ᴴ L⁻¹ X` with a supernodal factor: dense trapezoids, several right-hand sides at once, and
//! independent subtrees of the elimination tree side by side.
//!
//! Forward substitution goes from the leaves of the elimination tree to its root, backward the other way. A node needs what its
//! children left, so that subtrees that do not contain each other are independent; there are many near the leaves and one at the
//! root, where the dense trapezoid itself is what is worked on in parallel. Sums are taken in a fixed order, so that the bits do not
//! depend on the number of threads.

use std::ops::Range;

use rayon::prelude::*;

use super::tree::{Forest, Supernode};
use crate::algebra::Scalar;
use crate::compute::lanes;

/// Rows (columns) of a trapezoid that are handled together.
const TILE: usize = 4;
/// Which supernodes are solved in which task, and in which order. It does not depend on the number of
/// threads. Two kinds of parallel work meet here: tasks of one level, and parts of a block that are solved at the same
/// time; neither changes a sum.
pub(super) struct Schedule {
    pub(super) tasks: Vec<Task>,
    /// Tasks whose children are all in the levels before.
    pub(super) levels: Vec<Range<usize>>,
    /// Task of each row of the matrix, and its place there.
    pub(super) places: Vec<(u32, u32)>,
}

/// Some supernodes. Their rows are numbered from zero in the order of the factor, and then come the
/// rows of other tasks that they reach. While it is solved it has a vector of its own for both: what it would subtract
/// from rows of others waits there until the task above takes it over, so that no two tasks write to one place.
#[derive(Default)]
pub(super) struct Task {
    supernodes: Vec<Local>,
    /// Rows of the rectangles, one supernode after the other.
    rows: Vec<u32>,
    /// Rows of the matrix that belong to this task.
    pub(super) own: Vec<u32>,
    /// The task that all the other rows belong to or pass through, and their places there.
    parent: u32,
    pub(super) reached: Vec<u32>,
    pub(super) children: Vec<u32>,
}

/// A supernode in the numbers of its task: its columns, where its rows begin and end in [`Task::rows`], and its values
/// in the factor.
struct Local {
    columns: Range<usize>,
    rows: Range<usize>,
    values: Range<usize>,
}

/// A supernode in the numbers of its task: its columns, the rows below them, and where its values are in the factor.
pub(super) struct Supernodal<'a> {
    pub(super) columns: Range<usize>,
    pub(super) rows: &'a [u32],
    pub(super) values: Range<usize>,
}

impl Task {
    /// In the order of the factor.
    #[inline(always)]
    pub(super) fn supernodes(&self) -> impl DoubleEndedIterator<Item = Supernodal<'_>> {
        self.supernodes.iter().map(
            #[inline(always)]
            |s| Supernodal {
                columns: s.columns.clone(),
                rows: &self.rows[s.rows.clone()],
                values: s.values.clone(),
            },
        )
    }

    /// Its columns whose roots of pivots are negative.
    pub(super) fn negative(&self, values: &[f64]) -> Vec<u32> {
        let of = |s: Supernodal<'_>| {
            let height = s.columns.len() + s.rows.len();
            let first = s.values.start;
            let columns = s.columns.enumerate();
            let negative = columns.filter(move |(c, _)| values[first + c * (height + 1)] < 0.0);
            negative.map(|(_, row)| row as u32)
        };
        self.supernodes().flat_map(of).collect()
    }
}

impl Schedule {
    /// Supernodes in the order of the factor; `original` tells the row of the matrix that became a row
    /// of the factor.
    pub(super) fn of(
        supernodes: &[Supernode<'_>],
        forest: &Forest,
        original: impl Fn(usize) -> usize,
    ) -> Self {
        let (owner, task_of) = (&forest.owner, &forest.task_of);
        let (n, count) = (owner.len(), forest.tasks.len());
        // From the top down: rows that a task reaches have a place in the task above.
        let mut tasks: Vec<Task> = (0..count).map(|_| Task::default()).collect();
        let mut places = vec![(0u32, 0u32); n];
        let mut local = vec![u32::MAX; n];
        let mut reached: Vec<Vec<u32>> = vec![Vec::new(); count];
        for t in (0..count).rev() {
            let parent = forest.above[t];
            let mut task = Task {
                parent: parent.unwrap_or(0) as u32,
                ..Task::default()
            };
            let mut next = 0;
            for &s in &forest.tasks[t] {
                for row in supernodes[s].columns.clone() {
                    local[row] = next;
                    places[original(row)] = (t as u32, next);
                    task.own.push(original(row) as u32);
                    next += 1;
                }
            }
            // Rows that the task adds to, but that others own.
            let mut outside: Vec<u32> = forest.tasks[t]
                .iter()
                .flat_map(|&s| supernodes[s].rows)
                .copied()
                .filter(|&row| task_of[owner[row as usize] as usize] != t)
                .collect();
            outside.sort_unstable();
            outside.dedup();
            // Places in the task above, before this one's numbers replace them.
            if let Some(p) = parent {
                let start = tasks[p].own.len() as u32;
                let own = |row: u32| task_of[owner[row as usize] as usize] == p;
                task.reached = outside
                    .iter()
                    .map(|&row| {
                        if own(row) {
                            places[original(row as usize)].1
                        } else {
                            let at = reached[p].binary_search(&row);
                            start + at.expect("the task above reaches what this one does") as u32
                        }
                    })
                    .collect();
                tasks[p].children.push(t as u32);
            }
            for (i, &row) in outside.iter().enumerate() {
                local[row as usize] = next + i as u32;
            }
            // Its supernodes, in the task's own numbers.
            let mut first = 0;
            for &s in &forest.tasks[t] {
                let supernode = &supernodes[s];
                let width = supernode.columns.len();
                let at = task.rows.len();
                let rows = supernode.rows.iter().map(|&row| local[row as usize]);
                task.rows.extend(rows);
                task.supernodes.push(Local {
                    columns: first..first + width,
                    rows: at..task.rows.len(),
                    values: supernode.values.clone(),
                });
                first += width;
            }
            reached[t] = outside;
            tasks[t] = task;
        }
        Self {
            tasks,
            levels: forest.levels.clone(),
            places,
        }
    }

    /// The solutions for some columns of a block, `C` of them row after row (the last ones zero),
    /// task by task, by a sweep over the supernodes of each, given by its number. Twice over the levels: up, each task adds what
    /// its children left and eliminates its own rows (L⁻¹); down, each first reads the rows that the tasks above have solved,
    /// then solves its own (L⁻ᴴ).
    pub(super) fn solve_by<T: Scalar, const C: usize>(
        &self,
        block: &[T],
        columns: usize,
        range: Range<usize>,
        run: impl Fn(usize, &mut [[T; C]], Direction) + Sync,
    ) -> Solved<T, C> {
        let mut solved: Solved<T, C> = self.tasks.iter().map(|_| Vec::new()).collect();
        for level in &self.levels {
            let new: Vec<Vec<[T; C]>> = level
                .clone()
                .into_par_iter()
                .with_max_len(1)
                .map(|t| {
                    let task = &self.tasks[t];
                    let mut x = vec![[T::default(); C]; task.own.len() + task.reached.len()];
                    for (x, &row) in x.iter_mut().zip(&task.own) {
                        let row = &block[row as usize * columns..][range.clone()];
                        x[..row.len()].copy_from_slice(row);
                    }
                    for &child in &task.children {
                        let child = child as usize;
                        let below = &self.tasks[child];
                        let rows = &solved[child][below.own.len()..];
                        for (&at, row) in below.reached.iter().zip(rows) {
                            plus(&mut x[at as usize], row);
                        }
                    }
                    run(t, &mut x, Direction::Down);
                    x
                })
                .collect();
            for (t, x) in level.clone().zip(new) {
                solved[t] = x;
            }
        }
        for level in self.levels.iter().rev() {
            let (below, above) = solved.split_at_mut(level.end);
            below[level.clone()]
                .par_iter_mut()
                .with_max_len(1)
                .zip(level.clone())
                .for_each(|(x, t)| {
                    let task = &self.tasks[t];
                    let (_, rows) = x.split_at_mut(task.own.len());
                    if !rows.is_empty() {
                        let parent = &above[task.parent as usize - level.end];
                        for (row, &at) in rows.iter_mut().zip(&task.reached) {
                            *row = parent[at as usize];
                        }
                    }
                    run(t, x, Direction::Up);
                });
        }
        solved
    }

    /// `|L⁻¹ b|²` of up to `C` sparse vectors b, each given by rows and values: that is `bᴴ A⁻¹ b` without the backward half.
    ///
    /// L⁻¹ b vanishes but on the way from b's entries to the root of the elimination tree (Gilbert and Peierls, *Sparse
    /// partial pivoting in time proportional to arithmetic operations*, 1988), so that only tasks there are visited, and in
    /// them the supernodes with something to eliminate.
    pub(super) fn norms<const C: usize>(
        &self,
        values: &[f64],
        vectors: &[Vec<(usize, f64)>],
    ) -> [f64; C] {
        let blank = |task: &Task| vec![[0.0; C]; task.own.len() + task.reached.len()];
        let mut open: Vec<Vec<[f64; C]>> = vec![Vec::new(); self.tasks.len()];
        for (c, vector) in vectors.iter().enumerate() {
            for &(row, value) in vector {
                let (task, place) = self.places[row];
                let x = &mut open[task as usize];
                if x.is_empty() {
                    *x = blank(&self.tasks[task as usize]);
                }
                x[place as usize][c] += value;
            }
        }
        let mut norms = [0.0; C];
        // A task is numbered before the one above it.
        for (t, task) in self.tasks.iter().enumerate() {
            let mut x = std::mem::take(&mut open[t]);
            if x.is_empty() {
                continue;
            }
            run(task, values, &mut x, Direction::Down);
            let (own, rows) = x.split_at(task.own.len());
            for x in own {
                (0..C).for_each(|c| norms[c] += x[c] * x[c]);
            }
            if !rows.is_empty() {
                let above = &mut open[task.parent as usize];
                if above.is_empty() {
                    *above = blank(&self.tasks[task.parent as usize]);
                }
                for (&at, row) in task.reached.iter().zip(rows) {
                    plus(&mut above[at as usize], row);
                }
            }
        }
        norms
    }

    /// One row of what was solved.
    pub(super) fn row<'a, T, const C: usize>(
        &self,
        solved: &'a Solved<T, C>,
        row: usize,
    ) -> &'a [T; C] {
        let (task, place) = self.places[row];
        &solved[task as usize][place as usize]
    }
}

/// The rows of each task, those that it reaches at the end.
pub(super) type Solved<T, const C: usize> = Vec<Vec<[T; C]>>;

/// Down the columns, which is the forward substitution, or up.
#[derive(Clone, Copy, PartialEq)]
pub(super) enum Direction {
    Down,
    Up,
}

/// One sweep over the supernodes of a task, compiled for the vector registers that the machine has.
pub(super) fn run<T: Scalar, const C: usize>(
    task: &Task,
    values: &[T],
    x: &mut [[T; C]],
    direction: Direction,
) {
    T::sweep(Sweep {
        task,
        values,
        x,
        direction,
    });
}

/// A task, the values of the factor, and the unknowns of some right-hand sides.
pub struct Sweep<'a, T, const C: usize> {
    pub(super) task: &'a Task,
    pub(super) values: &'a [T],
    pub(super) x: &'a mut [[T; C]],
    pub(super) direction: Direction,
}

impl<T: Scalar, const C: usize> lanes::WithSimd for Sweep<'_, T, C> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: lanes::Simd>(self, _: S) {
        match lanes::fuses::<S>() {
            true => self.run::<true>(),
            false => self.run::<false>(),
        }
    }
}

impl<T: Scalar, const C: usize> Sweep<'_, T, C> {
    /// The same loops twice: with fused products, and without for processors that would have to call a function for
    /// each.
    #[inline(always)]
    fn run<const FUSED: bool>(self) {
        let (task, values) = (self.task, self.values);
        if self.direction == Direction::Down {
            for s in &task.supernodes {
                let block = Block::of(s, task, values, self.x);
                // Of sparse right-hand sides most is zero still.
                if block.own.as_flattened().iter().any(|x| *x != T::default()) {
                    forward::<T, C, FUSED>(block);
                }
            }
        } else {
            for s in task.supernodes.iter().rev() {
                backward::<T, C, FUSED>(Block::of(s, task, values, self.x));
            }
        }
    }
}

/// A supernode with the unknowns that it solves for and those that follow them. Columns of a supernode end in the same
/// rows: with the sums over its rows tiled, each value of the factor is read once for all right-hand sides.
struct Block<'a, T, const C: usize> {
    /// Its columns of the factor, each from the diagonal block down.
    columns: &'a [T],
    /// The unknowns of the rows below the diagonal block.
    rows: &'a [u32],
    own: &'a mut [[T; C]],
    /// The unknowns from `end` on.
    below: &'a mut [[T; C]],
    end: usize,
}

impl<'a, T, const C: usize> Block<'a, T, C> {
    #[inline(always)]
    fn of(s: &Local, task: &'a Task, values: &'a [T], x: &'a mut [[T; C]]) -> Self {
        let (head, below) = x.split_at_mut(s.columns.end);
        Self {
            columns: &values[s.values.clone()],
            rows: &task.rows[s.rows.clone()],
            own: &mut head[s.columns.clone()],
            below,
            end: s.columns.end,
        }
    }

    /// Columns, and rows of each: those of the triangle and those below it.
    #[inline(always)]
    fn shape(&self) -> (usize, usize) {
        (self.own.len(), self.own.len() + self.rows.len())
    }
}

/// Solves with the triangle, column by column, then takes the product of the rectangle off the rows below, tile by
/// tile. The diagonal is real and positive, so one division serves all right-hand sides.
#[inline(always)]
fn forward<T: Scalar, const C: usize, const FUSED: bool>(block: Block<'_, T, C>) {
    let (width, height) = block.shape();
    for c in 0..width {
        let column = &block.columns[c * height..][..width];
        let mut xc = block.own[c];
        let scale = 1.0 / column[c].real_part();
        for v in &mut xc {
            *v = *v * scale;
        }
        block.own[c] = xc;
        for v in &mut xc {
            *v = -*v;
        }
        for (x, &l) in block.own[c + 1..].iter_mut().zip(&column[c + 1..]) {
            add::<T, C, FUSED>(x, l, &xc);
        }
    }
    let mut at = width;
    let (tiles, rest) = block.rows.as_chunks::<TILE>();
    for tile in tiles {
        let mut sums = [[T::default(); C]; TILE];
        for (xc, column) in block.own.iter().zip(block.columns.chunks_exact(height)) {
            let l = &column[at..at + TILE];
            for q in 0..TILE {
                add::<T, C, FUSED>(&mut sums[q], l[q], xc);
            }
        }
        for q in 0..TILE {
            take(&mut block.below[tile[q] as usize - block.end], &sums[q]);
        }
        at += TILE;
    }
    for &row in rest {
        let mut sum = [T::default(); C];
        for (xc, column) in block.own.iter().zip(block.columns.chunks_exact(height)) {
            add::<T, C, FUSED>(&mut sum, column[at], xc);
        }
        take(&mut block.below[row as usize - block.end], &sum);
        at += 1;
    }
}

/// The mirror image: first the product of the rectangle's conjugate transpose with the rows below, then the triangle
/// from its last column up.
#[inline(always)]
fn backward<T: Scalar, const C: usize, const FUSED: bool>(block: Block<'_, T, C>) {
    let (width, height) = block.shape();
    let (tiles, rest) = block.own.as_chunks_mut::<TILE>();
    let mut c = 0;
    for tile in tiles {
        let mut sums = [[T::default(); C]; TILE];
        let below = &block.columns[c * height..(c + TILE) * height];
        let (l0, below) = below.split_at(height);
        let (l1, below) = below.split_at(height);
        let (l2, l3) = below.split_at(height);
        let l = [&l0[width..], &l1[width..], &l2[width..], &l3[width..]];
        for (p, &row) in block.rows.iter().enumerate() {
            let x = &block.below[row as usize - block.end];
            for q in 0..TILE {
                add::<T, C, FUSED>(&mut sums[q], l[q][p].conjugate(), x);
            }
        }
        for q in 0..TILE {
            take(&mut tile[q], &sums[q]);
        }
        c += TILE;
    }
    for x in rest {
        let column = &block.columns[c * height + width..(c + 1) * height];
        let mut sum = [T::default(); C];
        for (&l, &row) in column.iter().zip(block.rows) {
            add::<T, C, FUSED>(
                &mut sum,
                l.conjugate(),
                &block.below[row as usize - block.end],
            );
        }
        take(x, &sum);
        c += 1;
    }
    for c in (0..width).rev() {
        let column = &block.columns[c * height..][..width];
        let mut sum = [T::default(); C];
        for (x, &l) in block.own[c + 1..].iter().zip(&column[c + 1..]) {
            add::<T, C, FUSED>(&mut sum, l.conjugate(), x);
        }
        take(&mut block.own[c], &sum);
        let scale = 1.0 / column[c].real_part();
        for v in &mut block.own[c] {
            *v = *v * scale;
        }
    }
}

/// `sum += l · x` for all right-hand sides; fused where the processor has the instruction.
#[inline(always)]
fn add<T: Scalar, const C: usize, const FUSED: bool>(sum: &mut [T; C], l: T, x: &[T; C]) {
    for i in 0..C {
        sum[i] = if FUSED {
            l.fused(x[i], sum[i])
        } else {
            sum[i] + l * x[i]
        };
    }
}

/// Takes over what a child has left.
#[inline(always)]
fn plus<T: Scalar, const C: usize>(x: &mut [T; C], sum: &[T; C]) {
    for i in 0..C {
        x[i] += sum[i];
    }
}

/// Subtracts a sum when it is complete.
#[inline(always)]
fn take<T: Scalar, const C: usize>(x: &mut [T; C], sum: &[T; C]) {
    for i in 0..C {
        x[i] -= sum[i];
    }
}

/// How many tasks solve with a factor of one column per supernode, each given by its rows below the diagonal and where its
/// values are, and `[x, y]` of each row of the matrix for two right-hand sides; for tests. A subtree of at most `sizes[0]`
/// entries is one task, one of at most `sizes[1]` none of its own.
#[cfg(feature = "testing")]
pub fn solved(
    columns: &[(&[u32], Range<usize>)],
    original: impl Fn(usize) -> usize,
    sizes: [usize; 2],
    values: &[f64],
    block: &[f64],
) -> (usize, Vec<[f64; 2]>) {
    let supernodes: Vec<_> = columns
        .iter()
        .enumerate()
        .map(|(j, (rows, values))| Supernode {
            columns: j..j + 1,
            rows,
            values: values.clone(),
        })
        .collect();
    let forest = Forest::with(&supernodes, sizes[0], sizes[1]);
    let schedule = Schedule::of(&supernodes, &forest, original);
    let solved: Solved<f64, 2> = schedule.solve_by(block, 2, 0..2, |t, x, direction| {
        run(&schedule.tasks[t], values, x, direction);
    });
    let rows = 0..columns.len();
    let rows = rows.map(|row| *schedule.row(&solved, row)).collect();
    (schedule.tasks.len(), rows)
}
