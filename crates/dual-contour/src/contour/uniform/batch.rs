//! Triangles of a part of the surface.

use geom_core::Point3;

use crate::complex::collect::ADDED;

/// Triangles of one batch; numbers with [`ADDED`] are points of the batch itself.
#[derive(Default)]
pub(super) struct Batch {
    pub(super) triangles: Vec<[u32; 3]>,
    pub(super) added: Vec<Point3>,
}

impl Batch {
    /// Takes a triangle counter-clockwise about an edge, given whether its lower end is `inside`.
    #[inline]
    pub(super) fn push(&mut self, t: [u32; 3], inside: bool) {
        self.triangles
            .push(if inside { t } else { [t[0], t[2], t[1]] });
    }

    /// The number of a new point.
    pub(super) fn add(&mut self, x: Point3) -> u32 {
        self.added.push(x);
        ADDED | (self.added.len() - 1) as u32
    }
}
