//! The labels on the half lattice of a leaf, and whether they are simple.
//!
//! Dual contouring puts one point into a cell. That is right if the surface passes once: the corners of each label hang
//! together along the edges of the cell, and so do all others. Two corners inside that share no edge, the rest outside,
//! are the smallest case where it does not hold. One point for two sheets would join them, and the vertex would be no manifold's; such a
//! leaf is *not simple*, is split, and at the finest size is cut into twelve tetrahedra, each of which is simple for every
//! pattern of labels at its four corners.
//!
//! Simple cells give a manifold. A face of one has at most two changes of label along its edges, if there are two
//! labels: with four, its corners of either label would be joined through the rest of the cell on both sides, and on
//! the surface of the cell two such ways would have to cross (Jordan's curve theorem). So each edge of the surface,
//! which stands for such a face, has two polygons, and those around the point of a cell close to one ring.

use geom_core::mesh::Region;

/// The labels on the half lattice of a leaf: 27 points, of which the eight corners and the hanging
/// ones are used. The middle never is.
pub(crate) struct Frame {
    /// Bit `i` is set where the point of that index is used.
    pub(crate) used: u32,
    /// Of points that are not used they mean nothing.
    pub(crate) labels: [Region; 27],
}

/// Index of a half-lattice point from its three coordinates in 0…2.
pub(super) const fn half_index(p: [usize; 3]) -> usize {
    p[0] + 3 * p[1] + 9 * p[2]
}

impl Frame {
    /// The edges between used points on the boundary of the leaf: neighbours on the half lattice, or
    /// the ends of an edge whose middle is not used.
    pub(crate) fn edges(&self, mut f: impl FnMut(usize, usize)) {
        let used = |i: usize| self.used >> i & 1 == 1;
        for axis in 0..3 {
            let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
            for j in 0..3 {
                for k in 0..3 {
                    if j == 1 && k == 1 {
                        continue;
                    }
                    let at = |i: usize| {
                        let mut p = [0; 3];
                        (p[axis], p[u], p[v]) = (i, j, k);
                        half_index(p)
                    };
                    let (low, middle, high) = (at(0), at(1), at(2));
                    if used(middle) {
                        if used(low) {
                            f(low, middle);
                        }
                        if used(high) {
                            f(middle, high);
                        }
                    } else if j != 1 && k != 1 {
                        f(low, high);
                    }
                }
            }
        }
    }

    /// Is the set of points of every label connected, and that of all others?
    /// Connected along the edges of the leaf. With k labels that is k questions, one for two labels, each answered by
    /// union and find over at most 26 points.
    pub(super) fn is_simple(&self) -> bool {
        let mut labels = [self.labels[0]; 27];
        let mut n = 1;
        for i in (1..27).filter(|i| self.used >> i & 1 == 1) {
            if !labels[..n].contains(&self.labels[i]) {
                labels[n] = self.labels[i];
                n += 1;
            }
        }
        // Of two labels, the others of each are the other.
        let labels = if n == 2 { &labels[..1] } else { &labels[..n] };
        labels.iter().all(|&label| self.parts(label) <= 2)
    }

    /// Into how many connected parts one label divides the points: its own, and those of all others.
    fn parts(&self, label: Region) -> usize {
        let mut group: [u8; 27] = std::array::from_fn(|i| i as u8);
        fn root(group: &mut [u8; 27], mut i: usize) -> usize {
            while group[i] as usize != i {
                group[i] = group[group[i] as usize];
                i = group[i] as usize;
            }
            i
        }
        self.edges(|a, b| {
            if (self.labels[a] == label) == (self.labels[b] == label) {
                let (a, b) = (root(&mut group, a), root(&mut group, b));
                group[a.max(b)] = a.min(b) as u8;
            }
        });
        (0..27)
            .filter(|&i| self.used >> i & 1 == 1 && usize::from(group[i]) == i)
            .count()
    }

    /// Have all used points one label?
    pub(super) fn is_uniform(&self) -> bool {
        (0..27)
            .filter(|i| self.used >> i & 1 == 1)
            .all(|i| self.labels[i] == self.labels[0])
    }
}

/// For each pattern of corner signs of a cube: are the corners of each sign connected?
/// A flood over the bits of a mask: two corners are neighbours where their numbers differ in one bit. No corner at all
/// counts as connected.
pub(crate) fn simple_masks() -> [bool; 256] {
    std::array::from_fn(|mask| {
        let connected = |set: usize| {
            let mut reached = set & set.wrapping_neg();
            loop {
                let mut next = reached;
                for i in (0..8).filter(|i| reached >> i & 1 == 1) {
                    next |= set & (1 << (i ^ 1) | 1 << (i ^ 2) | 1 << (i ^ 4));
                }
                if next == reached {
                    return reached == set;
                }
                reached = next;
            }
        };
        connected(mask) && connected(!mask & 255)
    })
}

/// The frame of a leaf without hanging corners, as all finest ones are.
pub(crate) fn frame_of_corners(corners: &[Region; 8]) -> Frame {
    let mut frame = Frame {
        used: 0,
        labels: [0; 27],
    };
    for (i, &label) in corners.iter().enumerate() {
        let j = half_index([2 * (i & 1), 2 * (i >> 1 & 1), 2 * (i >> 2)]);
        frame.used |= 1 << j;
        frame.labels[j] = label;
    }
    frame
}
