//! Connected groups.

/// Disjoint sets; the root of a set is its lowest member.
pub(crate) struct Groups {
    parent: Vec<u32>,
}

impl Groups {
    pub(crate) fn new(n: usize) -> Self {
        Self {
            parent: (0..n as u32).collect(),
        }
    }
    fn root(&mut self, mut i: usize) -> usize {
        while self.parent[i] as usize != i {
            let next = self.parent[self.parent[i] as usize];
            self.parent[i] = next;
            i = next as usize;
        }
        i
    }
    /// The root of every member.
    pub(crate) fn roots(mut self) -> Vec<u32> {
        // Parents come before their children, so one pass flattens.
        for i in 0..self.parent.len() {
            self.parent[i] = self.parent[self.parent[i] as usize];
        }
        self.parent
    }
    pub(crate) fn join(&mut self, i: usize, j: usize) {
        let (i, j) = (self.root(i), self.root(j));
        self.parent[i.max(j)] = i.min(j) as u32;
    }
}
