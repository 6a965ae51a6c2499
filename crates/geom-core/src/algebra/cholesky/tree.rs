//! The elimination tree of supernodes, cut into tasks that factor and substitute side by side.

use std::ops::Range;

/// A subtree with at most this share of the factor is one task.
const LARGE: usize = 24;
/// A subtree with at most this share of the factor is no task of its own.
const SMALL: usize = 400;
/// Entries of a factor, or of a subtree, that are not worth a task.
const ENTRIES: usize = 1 << 14;

/// The columns of one supernode: a lower triangle over a rectangle, column after column.
pub(super) struct Supernode<'a> {
    /// Columns in the order of the factor, which are the rows of the triangle.
    pub(super) columns: Range<usize>,
    /// Rows of the rectangle, ascending.
    pub(super) rows: &'a [u32],
    /// Where its values are.
    pub(super) values: Range<usize>,
}

impl Supernode<'_> {
    /// Where a row of the factor is in its columns. It must be one that they have.
    pub(super) fn place(&self, row: u32) -> u32 {
        let width = self.columns.len() as u32;
        if (row as usize) < self.columns.end {
            row - self.columns.start as u32
        } else {
            width + self.rows.partition_point(|&r| r < row) as u32
        }
    }
}

/// Supernodes and the tasks that they are put together to. It does not depend on the number of threads.
pub(super) struct Forest {
    /// Supernode of each column of the factor.
    pub(super) owner: Vec<u32>,
    /// The supernode that waits for each one: that of its first row below.
    pub(super) parents: Vec<Option<usize>>,
    /// Task of each supernode.
    pub(super) task_of: Vec<usize>,
    /// Supernodes of each task, ascending.
    pub(super) tasks: Vec<Vec<usize>>,
    /// The task above each one, which has a higher number.
    pub(super) above: Vec<Option<usize>>,
    /// Tasks whose children are all in the levels before: a level is worked on in parallel.
    pub(super) levels: Vec<Range<usize>>,
}

impl Forest {
    /// Supernodes in the order of the factor.
    pub(super) fn of(supernodes: &[Supernode<'_>]) -> Self {
        let total: usize = supernodes.iter().map(|s| s.values.len()).sum();
        let large = (total / LARGE).max(ENTRIES);
        let small = (total / SMALL).max(ENTRIES);
        Self::with(supernodes, large, small)
    }

    /// With subtrees of more than `large` entries divided, and none of up to `small` a task of its own.
    pub(super) fn with(supernodes: &[Supernode<'_>], large: usize, small: usize) -> Self {
        let n = supernodes.last().map_or(0, |s| s.columns.end);
        let mut owner = vec![0u32; n];
        for (s, supernode) in supernodes.iter().enumerate() {
            owner[supernode.columns.clone()].fill(s as u32);
        }
        let parents: Vec<Option<usize>> = supernodes
            .iter()
            .map(|s| s.rows.first().map(|&row| owner[row as usize] as usize))
            .collect();
        let task_of = assign(supernodes, &parents, large, small);

        // Tasks by height, so that levels are ranges.
        let count = task_of.iter().max().map_or(0, |&t| t + 1);
        let mut above: Vec<Option<usize>> = vec![None; count];
        for (s, &parent) in parents.iter().enumerate() {
            if let Some(p) = parent.filter(|&p| task_of[p] != task_of[s]) {
                above[task_of[s]] = Some(task_of[p]);
            }
        }
        // A task is numbered before those below it.
        let mut height = vec![0usize; count];
        for t in (0..count).rev() {
            if let Some(p) = above[t] {
                height[p] = height[p].max(height[t] + 1);
            }
        }
        let mut order: Vec<usize> = (0..count).collect();
        order.sort_by_key(|&t| (height[t], t));
        let mut number = vec![0; count];
        for (new, &old) in order.iter().enumerate() {
            number[old] = new;
        }
        let top = height.iter().max().map_or(0, |h| h + 1);
        let levels = (0..top)
            .map(|level| {
                let place = |h| order.partition_point(|&t| height[t] < h);
                place(level)..place(level + 1)
            })
            .collect();
        let mut tasks: Vec<Vec<usize>> = vec![Vec::new(); count];
        for (s, &t) in task_of.iter().enumerate() {
            tasks[number[t]].push(s);
        }
        Self {
            owner,
            parents,
            task_of: task_of.iter().map(|&t| number[t]).collect(),
            tasks,
            above: order.iter().map(|&t| above[t].map(|p| number[p])).collect(),
            levels,
        }
    }
}

/// A number per supernode; a task above another has the lower number. From the root down. A subtree of up to `large`
/// entries stays together; above that each branch of more than `small` becomes a task, and a chain without branches is
/// not cut, since its parts would wait for each other.
fn assign(
    supernodes: &[Supernode<'_>],
    parents: &[Option<usize>],
    large: usize,
    small: usize,
) -> Vec<usize> {
    let mut weights: Vec<usize> = supernodes.iter().map(|s| s.values.len()).collect();
    for (s, parent) in parents.iter().enumerate() {
        if let &Some(p) = parent {
            weights[p] += weights[s];
        }
    }
    let mut branches = vec![0; supernodes.len()];
    for (s, parent) in parents.iter().enumerate() {
        if let &Some(p) = parent {
            branches[p] += usize::from(weights[s] > large);
        }
    }
    let mut task_of = vec![0; supernodes.len()];
    let mut count = 0;
    // The small trees of a forest share one task.
    let mut rest = None;
    for s in (0..supernodes.len()).rev() {
        let joins = match parents[s] {
            Some(p) => {
                let alone = weights[p] > large
                    && weights[s] > small
                    && (weights[s] <= large || branches[p] > 1);
                (!alone).then(|| task_of[p])
            }
            None if weights[s] <= small => rest,
            None => None,
        };
        task_of[s] = joins.unwrap_or_else(|| {
            count += 1;
            count - 1
        });
        if parents[s].is_none() && weights[s] <= small {
            rest = Some(task_of[s]);
        }
    }
    task_of
}
