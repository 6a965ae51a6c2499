//! Lists of different lengths, one after the other in one piece of memory.

use super::parallel::starts_of;

/// Lists by their numbers: the faces of each vertex, the terms of each row (compressed sparse rows).
///
/// ```
/// use geom_core::compute::lists::Lists;
/// let triangles = [[0, 1, 2], [2, 1, 3]];
/// let corners = || triangles.as_flattened().iter().copied();
/// let of_vertex = Lists::of(4, || corners().zip((0..).map(|corner| corner / 3)));
/// assert_eq!(of_vertex.list(1), [0, 1]);
/// assert_eq!(of_vertex.list(3), [1]);
/// ```
///
/// Eight bytes per list besides the items.
#[derive(Clone, Debug)]
pub struct Lists<T> {
    starts: Vec<usize>,
    items: Vec<T>,
}

impl<T: Copy + Default> Lists<T> {
    /// Of `n` lists, each item with the number of its list, which is below `n`; in the order in which they come. They are asked
    /// for twice, to be counted and to be put, and must be the same each time.
    ///
    /// # Panics
    /// For a list of a number that is not below `n`.
    pub fn of<I: Iterator<Item = (u32, T)>>(n: usize, items: impl Fn() -> I) -> Self {
        let mut counts = vec![0u32; n];
        items().for_each(|(list, _)| counts[list as usize] += 1);
        let starts = starts_of(&counts);
        let mut next = starts.clone();
        let mut all = vec![T::default(); starts[n]];
        for (list, item) in items() {
            let next = &mut next[list as usize];
            all[*next] = item;
            *next += 1;
        }
        Self { starts, items: all }
    }
}

impl<T> Lists<T> {
    /// How many lists there are.
    pub fn count(&self) -> usize {
        self.starts.len() - 1
    }

    /// The items of a list.
    pub fn list(&self, i: usize) -> &[T] {
        &self.items[self.starts[i]..self.starts[i + 1]]
    }
}
