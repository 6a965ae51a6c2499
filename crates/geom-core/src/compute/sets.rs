//! Disjoint sets of numbers (union–find).
//!
//! Components of meshes, sheets of audits and tasks of solvers are found by it. Sets only ever grow together: what is
//! to be parted again is begun anew.

/// A number that can name an element of a set.
pub trait Name: Copy + Ord {
    /// The name of the `i`-th element.
    fn name(i: usize) -> Self;
    /// The place of the element of this name.
    fn place(self) -> usize;
}

impl Name for u32 {
    fn name(i: usize) -> Self {
        i as Self
    }
    fn place(self) -> usize {
        self as usize
    }
}

impl Name for usize {
    fn name(i: usize) -> Self {
        i
    }
    fn place(self) -> usize {
        self
    }
}

/// Disjoint sets of `0..n`; the lowest member names a set (union–find with path halving: Tarjan and van Leeuwen,
/// J. ACM 31, 1984). See [`DisjointSets`] for up to 2³² elements.
///
/// One number per element. Roots are chosen by number and not by size, so that names do not depend on the order of the
/// calls; a question then takes `O(log n)` in the mean over many.
#[derive(Clone, Debug)]
pub struct Sets<I>(Vec<I>);

/// Disjoint sets of at most 2³² numbers.
///
/// ```
/// let mut sets = geom_core::compute::sets::DisjointSets::new(4);
/// sets.join(3, 1);
/// assert_eq!([0, 1, 2, 3].map(|x| sets.find(x)), [0, 1, 2, 1]);
/// ```
pub type DisjointSets = Sets<u32>;

impl<I: Name> Sets<I> {
    /// Every number alone. Panics if there are more than their type can name.
    pub fn new(n: usize) -> Self {
        assert!(
            n == 0 || I::name(n - 1).place() == n - 1,
            "more elements than names"
        );
        Self((0..n).map(I::name).collect())
    }

    /// The lowest member of the set of `x`. Panics unless `x` is one of the numbers.
    pub fn find(&mut self, mut x: I) -> I {
        while self.0[x.place()] != x {
            let up = self.0[self.0[x.place()].place()];
            self.0[x.place()] = up;
            x = up;
        }
        x
    }

    /// Makes one set of those of `a` and `b`. Panics unless both are among the numbers. Joining a set with itself does
    /// nothing.
    pub fn join(&mut self, a: I, b: I) {
        let (a, b) = (self.find(a), self.find(b));
        self.0[a.max(b).place()] = a.min(b);
    }

    /// Is `x` the lowest member of its set? Panics unless it is one of the numbers. One look, which changes nothing:
    /// after all joins it counts the sets.
    pub fn is_lowest(&self, x: I) -> bool {
        self.0[x.place()] == x
    }

    /// The lowest member of the set of every number. Linear time.
    pub fn into_roots(mut self) -> Vec<I> {
        // What a number points to is lower, so that one pass suffices.
        for i in 0..self.0.len() {
            self.0[i] = self.0[self.0[i].place()];
        }
        self.0
    }
}
