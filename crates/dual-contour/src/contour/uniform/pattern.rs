//! What follows from the diagonals of a cut cell's faces alone: its tetrahedra as its parts' points see them.

use std::sync::LazyLock;

use geom_core::Point3;
use geom_core::mesh::six_volume;

use crate::complex::cube::{APEX, CORNERS, MIDDLE, diagonal_of, part_base, triangle_of};
use crate::dual::room::LEAST_VOLUME;
use crate::kernel::{self, Rows};

/// Umbrellas of a part, [`PART`] of them, in twos of eight lanes.
pub(super) const LANES_OF_PART: usize = 16;
pub(super) const PART: usize = 12;
/// Umbrellas of a face, of both of its parts, in eight lanes.
pub(super) const LANES_OF_FACE: usize = 8;
pub(super) const FACE: usize = 6;

/// Tetrahedra of an edge, a part and what stands beyond one of its faces.
pub(super) struct Umbrellas<const N: usize> {
    shape: kernel::Umbrellas<N>,
    /// Their least volumes: beyond stands a whole cell, or a part. Exact in f32 but for the factor.
    pub(super) least: [[f64; N]; 2],
}

/// What the diagonals of a cut cell say.
pub(super) struct Pattern {
    /// Of each part: the edges of its triangle, then those of the faces between it and its mates.
    pub(super) parts: [Umbrellas<LANES_OF_PART>; 12],
    /// Of the triangles of both parts at each face.
    pub(super) faces: [Umbrellas<LANES_OF_FACE>; 6],
    /// The parts beyond the three inner faces.
    pub(super) mates: [[u8; 3]; 12],
}

/// By the six diagonals.
pub(super) static PATTERNS: LazyLock<Vec<Pattern>> =
    LazyLock::new(|| (0..64).map(Pattern::new).collect());

/// An edge `a → b`, and what [`Umbrellas`] say of it.
#[derive(Clone, Copy)]
struct Umbrella {
    edge: [usize; 2],
    first: bool,
    base: [f64; 2],
}

impl<const N: usize> Umbrellas<N> {
    /// Lanes beyond these umbrellas never lack volume.
    fn new(umbrellas: &[Umbrella]) -> Self {
        let mut out = Self {
            shape: kernel::Umbrellas {
                a: [[0.0; N]; 3],
                b: [[0.0; N]; 3],
                first: [0.0; N],
            },
            least: [[f64::NEG_INFINITY; N]; 2],
        };
        for (i, umbrella) in umbrellas.iter().enumerate() {
            let [a, b] = umbrella.edge.map(|i| CORNERS[i]);
            for k in 0..3 {
                (out.shape.a[k][i], out.shape.b[k][i]) = (a[k], b[k]);
            }
            out.shape.first[i] = f64::from(u8::from(umbrella.first));
            for (least, base) in out.least.iter_mut().zip(umbrella.base) {
                least[i] = LEAST_VOLUME * base;
            }
        }
        out
    }
}

impl<const N: usize> Umbrellas<N> {
    /// What the tetrahedra have above their least volumes with parts at `x` and what is beyond at `y`.
    pub(super) fn spare(
        &self,
        origin: [i32; 3],
        x: &Rows<N>,
        y: &Rows<N>,
        least: &[f64; N],
    ) -> [f64; N] {
        self.shape.spare(origin.map(f64::from), x, y, least)
    }
}

pub(super) fn is_positive(spares: &[f64]) -> bool {
    spares.iter().all(|&s| s > 0.0)
}

impl Pattern {
    fn new(diagonals: u8) -> Self {
        let base = |part: usize| part_base(diagonals, [0; 3], part);
        let mut umbrellas: [Vec<Umbrella>; 12] = Default::default();
        let mut mates = [[0; 3]; 12];
        for part in 0..12 {
            let t = triangle_of(diagonals, part);
            let face = part / 2;
            let diagonal = diagonal_of(diagonals, face);
            let mut over = MIDDLE;
            over[face / 2] += if face % 2 == 1 { 1.0 } else { -1.0 };
            let sum = t.iter().fold(over.coords, |s, &i| s + CORNERS[i].coords);
            let outer = [over, Point3::from(sum / 4.0)];
            let umbrella = |[a, b]: [usize; 2], beyond: [Point3; 2]| {
                let volume =
                    beyond.map(|x| six_volume([CORNERS[a], CORNERS[b], base(part), x]) as f32);
                Umbrella {
                    edge: [a, b],
                    first: volume[0] > 0.0,
                    base: volume.map(|v| f64::from(v.abs())),
                }
            };
            let mut inner = Vec::new();
            for i in 0..3 {
                let (p, q) = (t[i], t[(i + 1) % 3]);
                // Along the axis, or as the ring of the diagonal goes.
                let edge = if diagonal.contains(&p) && diagonal.contains(&q) {
                    diagonal
                } else {
                    [p.min(q), p.max(q)]
                };
                umbrellas[part].push(umbrella(edge, outer));
                let has = |other: &usize| {
                    let t = triangle_of(diagonals, *other);
                    *other != part && t.contains(&p) && t.contains(&q)
                };
                let mate = (0..12).find(has).expect("two triangles meet in an edge");
                mates[part][i] = mate as u8;
                let edges = [edge, [APEX, p], [APEX, q]];
                inner.extend(edges.map(|e| umbrella(e, [base(mate); 2])));
            }
            umbrellas[part].extend(inner);
        }
        Self {
            parts: std::array::from_fn(|part| Umbrellas::new(&umbrellas[part])),
            faces: std::array::from_fn(|face| {
                let [p, q] = [0, 1].map(|half| &umbrellas[2 * face + half][..FACE / 2]);
                Umbrellas::new(&[p, q].concat())
            }),
            mates,
        }
    }
}
