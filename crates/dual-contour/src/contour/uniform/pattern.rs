//! What follows from the diagonals of a cut cell's faces alone: its tetrahedra as its parts' points see them.
//!
//! Six bits, so 64 patterns, made once when the first cut cell asks. A part's twelve tetrahedra stand in lanes side by
//! side, in the unit cube; four lanes stay empty.

use std::sync::LazyLock;

use geom_core::Point3;
use geom_core::mesh::six_volume;

use crate::complex::cube::{APEX, CORNERS, MIDDLE, diagonal_of, part_base, triangle_of};
use crate::dual::room::LEAST_VOLUME;
use crate::kernel::{self, Rows};

/// Edge tetrahedra of a part, [`PART`] of them, in twos of eight lanes.
pub(super) const LANES_OF_PART: usize = 16;
pub(super) const PART: usize = 12;
/// Edge tetrahedra of a face, of both of its parts, in eight lanes.
pub(super) const LANES_OF_FACE: usize = 8;
pub(super) const FACE: usize = 6;

/// Edge tetrahedra between a part and what stands beyond one of its faces, and what they must keep.
pub(super) struct GuardedTets<const N: usize> {
    shape: kernel::EdgeTets<N>,
    /// Their least volumes: beyond stands a whole cell, or a part. Exact in f32 but for the factor.
    pub(super) least: [[f64; N]; 2],
}

/// What the diagonals of a cut cell say.
pub(super) struct Pattern {
    /// Of each part: the edges of its triangle, then those of the faces between it and its mates.
    pub(super) parts: [GuardedTets<LANES_OF_PART>; 12],
    /// Of the triangles of both parts at each face.
    pub(super) faces: [GuardedTets<LANES_OF_FACE>; 6],
    /// The parts beyond the three inner faces.
    pub(super) mates: [[u8; 3]; 12],
}

/// By the six diagonals.
pub(super) static PATTERNS: LazyLock<Vec<Pattern>> =
    LazyLock::new(|| (0..64).map(Pattern::new).collect());

/// An edge `a → b` between a part and what is beyond: whether the part comes first, counter-clockwise about the
/// edge, and six times the volume with both at their base, for a whole cell and for a part beyond.
#[derive(Clone, Copy)]
struct EdgeTet {
    edge: [usize; 2],
    first: bool,
    base: [f64; 2],
}

impl<const N: usize> GuardedTets<N> {
    /// Lanes beyond these tetrahedra never lack volume.
    fn new(tets: &[EdgeTet]) -> Self {
        let mut out = Self {
            shape: kernel::EdgeTets {
                a: [[0.0; N]; 3],
                b: [[0.0; N]; 3],
                first: [0.0; N],
            },
            least: [[f64::NEG_INFINITY; N]; 2],
        };
        for (i, tet) in tets.iter().enumerate() {
            let [a, b] = tet.edge.map(|i| CORNERS[i]);
            for k in 0..3 {
                (out.shape.a[k][i], out.shape.b[k][i]) = (a[k], b[k]);
            }
            out.shape.first[i] = f64::from(u8::from(tet.first));
            for (least, base) in out.least.iter_mut().zip(tet.base) {
                least[i] = LEAST_VOLUME * base;
            }
        }
        out
    }

    /// The volume margins of the tetrahedra, six times what they have above their least, with parts at `x` and what is beyond at `y`.
    pub(super) fn margins(
        &self,
        origin: [i32; 3],
        x: &Rows<N>,
        y: &Rows<N>,
        least: &[f64; N],
    ) -> [f64; N] {
        self.shape.margins(origin.map(f64::from), x, y, least)
    }
}

/// Does none of them lack volume?
pub(super) fn is_positive(margins: &[f64]) -> bool {
    margins.iter().all(|&s| s > 0.0)
}

/// Six times the volumes of the edge tetrahedron `edge` with a part and what is beyond it at their bases.
fn edge_tet([a, b]: [usize; 2], part: Point3, beyond: [Point3; 2]) -> EdgeTet {
    let volume = beyond.map(|x| six_volume([CORNERS[a], CORNERS[b], part, x]) as f32);
    EdgeTet {
        edge: [a, b],
        first: volume[0] > 0.0,
        base: volume.map(|v| f64::from(v.abs())),
    }
}

impl Pattern {
    fn new(diagonals: u8) -> Self {
        let base = |part: usize| part_base(diagonals, [0; 3], part);
        let mut tets: [Vec<EdgeTet>; 12] = Default::default();
        let mut mates = [[0; 3]; 12];
        for part in 0..12 {
            let t = triangle_of(diagonals, part);
            let outer = bases_beyond(diagonals, part);
            let mut inner = Vec::new();
            for i in 0..3 {
                let (p, q) = (t[i], t[(i + 1) % 3]);
                let edge = directed(diagonals, part / 2, p, q);
                let mate = mate_of(diagonals, part, p, q);
                mates[part][i] = mate as u8;
                tets[part].push(edge_tet(edge, base(part), outer));
                let edges = [edge, [APEX, p], [APEX, q]];
                inner.extend(edges.map(|e| edge_tet(e, base(part), [base(mate); 2])));
            }
            tets[part].extend(inner);
        }
        Self {
            parts: std::array::from_fn(|part| GuardedTets::new(&tets[part])),
            faces: std::array::from_fn(|face| {
                let [p, q] = [0, 1].map(|half| &tets[2 * face + half][..FACE / 2]);
                GuardedTets::new(&[p, q].concat())
            }),
            mates,
        }
    }
}

/// Where the point beyond the outer triangle of a part has its base: that of a whole cell, or of a part.
fn bases_beyond(diagonals: u8, part: usize) -> [Point3; 2] {
    let face = part / 2;
    let mut middle = MIDDLE;
    middle[face / 2] += if face % 2 == 1 { 1.0 } else { -1.0 };
    let corners = triangle_of(diagonals, part).map(|i| CORNERS[i].coords);
    let sum = corners.iter().fold(middle.coords, |s, c| s + c);
    [middle, Point3::from(sum / 4.0)]
}

/// The edge between two corners of a face, directed along its axis, or as the ring of the diagonal goes.
fn directed(diagonals: u8, face: usize, p: usize, q: usize) -> [usize; 2] {
    let diagonal = diagonal_of(diagonals, face);
    if diagonal.contains(&p) && diagonal.contains(&q) {
        diagonal
    } else {
        [p.min(q), p.max(q)]
    }
}

/// The other part whose triangle has the edge between two corners.
fn mate_of(diagonals: u8, part: usize, p: usize, q: usize) -> usize {
    let has = |other: &usize| {
        let t = triangle_of(diagonals, *other);
        *other != part && t.contains(&p) && t.contains(&q)
    };
    (0..12)
        .find(has)
        .expect("two triangles of a cube's surface meet in an edge")
}
