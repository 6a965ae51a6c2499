//! Disjoint sets of numbers.

/// Disjoint sets of `0..n`; the lowest member names a set (union–find with path halving).
///
/// ```
/// let mut sets = geom_core::compute::sets::DisjointSets::new(4);
/// sets.join(3, 1);
/// assert_eq!([0, 1, 2, 3].map(|x| sets.find(x)), [0, 1, 2, 1]);
/// ```
#[derive(Clone, Debug)]
pub struct DisjointSets(Vec<u32>);

impl DisjointSets {
    /// Every number alone. At most 2³² of them have names.
    pub fn new(n: usize) -> Self {
        Self((0..n as u32).collect())
    }

    /// The lowest member of the set of `x`. Panics unless `x` is one of the numbers.
    pub fn find(&mut self, mut x: u32) -> u32 {
        while self.0[x as usize] != x {
            let up = self.0[self.0[x as usize] as usize];
            self.0[x as usize] = up;
            x = up;
        }
        x
    }

    /// Makes one set of those of `a` and `b`. Panics unless both are among the numbers.
    pub fn join(&mut self, a: u32, b: u32) {
        let (a, b) = (self.find(a), self.find(b));
        self.0[a.max(b) as usize] = a.min(b);
    }

    /// The lowest member of the set of every number.
    pub fn into_roots(mut self) -> Vec<u32> {
        // What a number points to is lower, so that one pass suffices.
        for i in 0..self.0.len() {
            self.0[i] = self.0[self.0[i] as usize];
        }
        self.0
    }
}
