//! How a finest cell is cut into twelve tetrahedra.
//!
//! Each part is a tetrahedron, and a tetrahedron is simple for every pattern of labels. So a cell that one point could
//! not serve is served by up to twelve, and the complex stays conforming as long as both sides of a face take the same
//! diagonal.

use geom_core::Point3;
use geom_core::mesh::{INTERIOR, Region};

use super::cube::{MIDDLE, face_corners, half_of, triangle_of};
use crate::octree::{Samples, corner_of, local};

/// A finest cell cut into twelve tetrahedra: its middle and the triangles of its faces.
#[derive(Clone, Debug)]
pub(crate) struct Split {
    /// What the middle of the cell belongs to.
    pub(crate) label: Region,
    /// Value at the middle.
    pub(crate) value: f64,
    /// Bit `face`: the diagonal joins the corners 1 and 3 of the face, not 0 and 2.
    pub(crate) diagonals: u8,
}

impl Split {
    /// How the finest cell at `o` is cut. What its middle belongs to follows from its corners alone, so
    /// that a field that also tells the value there moves vertices but joins or parts nothing.
    pub(crate) fn new(samples: &Samples<'_>, o: [i32; 3], labels: &[Region; 8]) -> Self {
        let level = samples.labels.level;
        let values: [f64; 8] = std::array::from_fn(|i| {
            let p = corner_of(i);
            samples.value([0, 1, 2].map(|k| o[k] + p[k])) - level
        });
        let value = values.iter().sum::<f64>() / 8.0 + level;
        let mut diagonals = 0;
        for face in 0..6 {
            let f = face_corners(face);
            diagonals |= u8::from(joins_one_and_three(samples, o, f, labels, &values)) << face;
        }
        let middle = samples.domain.world(&(MIDDLE + local(o).coords));
        Self {
            label: samples.labels.at(value, &middle),
            value,
            diagonals,
        }
    }

    /// The corners of a half of a face.
    pub(crate) fn triangle(&self, part: usize) -> [usize; 3] {
        triangle_of(self.diagonals, part)
    }

    /// The half of a face that has both corners.
    pub(super) fn half(&self, face: usize, p: usize, q: usize) -> u8 {
        half_of(self.diagonals, face, p, q)
    }
}

/// Which diagonal cuts a face: decided by the face alone, so that both sides agree.
/// Where the labels of the face alternate, the diagonal joins the pair that its middle belongs to: of the molecule by
/// the saddle of the bilinear interpolant (the asymptotic decider of Nielson and Hamann 1991), of materials by their
/// shapes. Else it joins two corners of one label where it can.
fn joins_one_and_three(
    samples: &Samples<'_>,
    o: [i32; 3],
    f: [usize; 4],
    labels: &[Region; 8],
    values: &[f64; 8],
) -> bool {
    let l = f.map(|i| labels[i]);
    if l[0] == l[2] && l[1] == l[3] && l[0] != l[1] {
        if l.contains(&INTERIOR) {
            // The value at the saddle of the bilinear interpolant joins the pair of its sign.
            let v = f.map(|i| values[i]);
            let saddle = (v[0] * v[2] - v[1] * v[3]) / (v[0] + v[2] - v[1] - v[3]);
            return (saddle >= 0.0) != (v[0] >= 0.0);
        }
        let middle = f.iter().fold(Point3::origin(), |m, &i| {
            let p = corner_of(i);
            m + local([0, 1, 2].map(|k| o[k] + p[k])).coords * 0.25
        });
        let mean = f.iter().map(|&i| values[i]).sum::<f64>() / 4.0 + samples.labels.level;
        return samples.labels.at(mean, &samples.domain.world(&middle)) == l[1];
    }
    l[0] != l[2] && l[1] == l[3]
}
