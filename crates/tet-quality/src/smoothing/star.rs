//! The star of one vertex: the tetrahedra around it, ready to be judged at many positions of that vertex.
//!
//! A search asks for the worst tetrahedron at some fifteen places a round, and most of these places fail. So what does
//! not depend on the place is computed once per face, the objective is compared as a square, which needs neither roots
//! nor arc functions, and the face at which the last candidate failed is asked first.

use geom_core::{Point3, Vector3};

use crate::measure::metrics::{JOE_LIU, SHAPE_WEIGHT};
use crate::mesh::editable::GAIN;
use geom_core::compute::lanes::{Lanes, Scalar, Simd, Vectors, WithSimd, cross, dot, vectorized};

/// The face opposite the vertex: what does not change when the vertex moves.
/// Corners in the order in which they are counter-clockwise from outside; `square` is that of the normal, `ab`, `bc`
/// and `ca` are squared lengths.
#[derive(Clone, Copy)]
struct Face {
    a: Vector3,
    b: Vector3,
    c: Vector3,
    /// Doubled area normal, away from the vertex.
    normal: Vector3,
    square: f64,
    ab: f64,
    bc: f64,
    ca: f64,
}

/// The opposite faces of the tetrahedra around one vertex. Values are *signed squares* of the
/// objective of [`quality`](crate::measure::metrics::quality), which order like it and need no root.
///
/// A value of `sin² 20°` thus says that the worst tetrahedron has the objective `sin 20°`, and one of −0.01 that an
/// inverted one has a Joe–Liu measure of −0.1. A star without faces has the value +∞ everywhere.
#[derive(Default)]
pub(crate) struct Star {
    faces: Vec<Face>,
    /// The order in which the faces are asked: first those at which candidates fail.
    order: Vec<u32>,
}

impl Star {
    pub(crate) fn clear(&mut self) {
        self.faces.clear();
        self.order.clear();
    }

    /// The tetrahedra of the vertex with these faces, and no others.
    pub(crate) fn load(&mut self, positions: &[Point3], faces: &[[u32; 3]]) {
        self.clear();
        for &[a, b, c] in faces {
            self.push([a, b, c].map(|v| positions[v as usize]));
        }
    }

    /// Adds the tetrahedron `(vertex, a, b, c)`.
    pub(crate) fn push(&mut self, [a, b, c]: [Point3; 3]) {
        let (a, b, c) = (a.coords, b.coords, c.coords);
        let (ab, ca, bc) = (b - a, c - a, c - b);
        let normal = ab.cross(&ca);
        self.order.push(self.faces.len() as u32);
        self.faces.push(Face {
            a,
            b,
            c,
            normal,
            square: normal.norm_squared(),
            ab: ab.norm_squared(),
            bc: bc.norm_squared(),
            ca: ca.norm_squared(),
        });
    }

    /// The mean of the corners of the faces: a corner counts once per face.
    pub(crate) fn centroid(&self) -> Vector3 {
        let sum = self
            .faces
            .iter()
            .fold(Vector3::zeros(), |s, f| s + f.a + f.b + f.c);
        sum / (3 * self.faces.len()) as f64
    }

    /// Mean length of the edges from `x`.
    /// An edge counts once per face at its end, as in the kernels of all backends: steps and reaches are measured in
    /// it.
    pub(crate) fn mean_edge(&self, x: &Vector3) -> f64 {
        let sum: f64 = self
            .faces
            .iter()
            .map(|f| (f.a - x).norm() + (f.b - x).norm() + (f.c - x).norm())
            .sum();
        sum / (3 * self.faces.len()) as f64
    }

    /// How deep `x` lies inside all faces.
    /// Faces without area are left out. Concave in `x`, as the smallest of linear functions.
    pub(crate) fn depth(&self, x: &Vector3) -> Depth {
        let mut least = Depth {
            depth: f64::INFINITY,
            inward: Vector3::zeros(),
        };
        for f in &self.faces {
            let area = f.square.sqrt();
            if area > 0.0 {
                let depth = f.normal.dot(&(f.a - x)) / area;
                if depth < least.depth {
                    let inward = f.normal / -area;
                    least = Depth { depth, inward };
                }
            }
        }
        least
    }

    /// The smallest value with the vertex at `x`. The worst face is asked first from now on: there the
    /// next candidate most likely fails.
    pub(crate) fn value(&mut self, x: &Vector3) -> f64 {
        let (mut worst, mut at) = (f64::INFINITY, 0);
        for (i, &face) in self.order.iter().enumerate() {
            let value = self.faces[face as usize].value(x);
            if value < worst {
                (worst, at) = (value, i);
            }
        }
        if at > 0 {
            self.order.swap(0, at);
        }
        worst
    }

    /// Is every tetrahedron with the vertex at `x` `good`, or its value at least `enough`?
    /// The value is asked first, since it is known for little; `good` may measure.
    pub(crate) fn all_good(
        &self,
        x: &Vector3,
        enough: f64,
        good: &impl Fn([Point3; 4]) -> bool,
    ) -> bool {
        self.faces
            .iter()
            .all(|f| f.value(x) >= enough || good([*x, f.a, f.b, f.c].map(Point3::from)))
    }

    /// The smallest value with the vertex at `x` if it is above `bound`.
    /// Stops at the first face that fails and moves it half of the way to the front of the order: those at which many
    /// fail come to stand first, while one that fails once does not push the others away.
    pub(crate) fn value_above(&mut self, x: &Vector3, bound: f64) -> Option<f64> {
        let mut worst = f64::INFINITY;
        for i in 0..self.order.len() {
            let value = self.faces[self.order[i] as usize].value(x);
            // So far away that squares overflow, there is no value.
            if value <= bound || value.is_nan() {
                self.order.swap(i, i / 2);
                return None;
            }
            worst = worst.min(value);
        }
        Some(worst)
    }

    /// The candidate that is above `best` and by more than [`GAIN`] above those before it, the last such
    /// one.
    /// "The last such one" is what one after the other would have found: candidates are read in order, and each must
    /// beat the best before it.
    pub(crate) fn best_of(&mut self, candidates: &Candidates, best: f64) -> Option<Best> {
        vectorized(Judge {
            faces: &self.faces,
            order: &mut self.order,
            candidates,
            best,
        })
    }
}

/// How deep a point lies inside the faces of a star.
pub(crate) struct Depth {
    /// Negative outside.
    pub(crate) depth: f64,
    /// The unit direction away from the nearest face.
    pub(crate) inward: Vector3,
}

/// Most candidates that are judged together: the directions of a search and the neighbours' mean.
pub(crate) const CANDIDATES: usize = 16;

/// Positions of one vertex to be judged side by side.
pub(crate) struct Candidates {
    x: [[f64; CANDIDATES]; 3],
    count: usize,
}

impl Candidates {
    /// No candidates yet; `from` fills the lanes that stay empty.
    /// A lane that stays empty never wins: only `count` of them are read.
    pub(crate) fn none(from: &Vector3) -> Self {
        Self {
            x: [from.x, from.y, from.z].map(|x| [x; CANDIDATES]),
            count: 0,
        }
    }

    /// At most [`CANDIDATES`].
    pub(crate) fn push(&mut self, x: &Vector3) {
        for (row, x) in self.x.iter_mut().zip(x.iter()) {
            row[self.count] = *x;
        }
        self.count += 1;
    }

    pub(crate) fn at(&self, i: usize) -> Vector3 {
        Vector3::new(self.x[0][i], self.x[1][i], self.x[2][i])
    }
}

/// The best of some candidates.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Best {
    /// Which.
    pub(crate) number: usize,
    /// Its smallest value.
    pub(crate) value: f64,
}

/// A group of lanes is given up as soon as none of its candidates can win any more.
struct Judge<'a> {
    faces: &'a [Face],
    order: &'a mut [u32],
    candidates: &'a Candidates,
    best: f64,
}

impl WithSimd for Judge<'_> {
    type Output = Option<Best>;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Self::Output {
        let Self {
            faces,
            order,
            candidates,
            mut best,
        } = self;
        let mut chosen = None;
        let mut values = [0.0; CANDIDATES];
        for g in 0..candidates.count.div_ceil(S::F64_LANES) {
            let mut x = [Lanes(simd, simd.splat_f64s(0.0)); 3];
            for (lanes, row) in x.iter_mut().zip(&candidates.x) {
                lanes.1 = S::as_simd_f64s(row).0[g];
            }
            let mut worst = x[0].all(f64::INFINITY);
            let bound = worst.all(best + GAIN);
            let mut failed = None;
            for (i, &face) in order.iter().enumerate() {
                worst = value_at(&faces[face as usize], &x).min(worst);
                // No lane can come back.
                if !worst.any_above(bound) {
                    failed = Some(i);
                    break;
                }
            }
            if let Some(i) = failed {
                order.swap(i, i / 2);
                continue;
            }
            S::as_mut_simd_f64s(&mut values).0[g] = worst.1;
            let lanes = g * S::F64_LANES..((g + 1) * S::F64_LANES).min(candidates.count);
            for i in lanes {
                if values[i] > best + GAIN {
                    best = values[i];
                    chosen = Some(Best {
                        number: i,
                        value: best,
                    });
                }
            }
        }
        chosen
    }
}

impl Face {
    #[inline]
    fn value(&self, x: &Vector3) -> f64 {
        let one = Scalar::new();
        value_at(self, &[Lanes(one, x.x), Lanes(one, x.y), Lanes(one, x.z)]).1
    }
}

/// `p` seen from each lane's position.
#[inline(always)]
fn from<S: Simd>(p: &Vector3, x: &Vectors<S>) -> Vectors<S> {
    [
        x[0].all(p.x) - x[0],
        x[1].all(p.y) - x[1],
        x[2].all(p.z) - x[2],
    ]
}

/// The values of one face with the vertex at each lane's position.
///
/// With `v6 = 6V`: for a positive tetrahedron `v6²` times the smaller of `min e² n_i² n_j² / Π n²` and
/// `(1.14 · 20.78)² / (Σ e²)³`, for others `−(20.78 v6)² / (Σ e²)³`.
#[inline(always)]
fn value_at<S: Simd>(f: &Face, x: &Vectors<S>) -> Lanes<S> {
    const SHAPE: f64 = SHAPE_WEIGHT * SHAPE_WEIGHT * JOE_LIU * JOE_LIU;
    let number = x[0];
    let (zero, tiny) = (number.all(0.0), number.all(f64::MIN_POSITIVE));
    let (a, b, c) = (from(&f.a, x), from(&f.b, x), from(&f.c, x));
    let n = &f.normal;
    let v6 = dot([number.all(n.x), number.all(n.y), number.all(n.z)], a);
    let (aa, bb, cc) = (dot(a, a), dot(b, b), dot(c, c));
    let (ab, bc, ca) = (number.all(f.ab), number.all(f.bc), number.all(f.ca));
    let nv = number.all(f.square);
    let sum = aa + bb + cc + ab + bc + ca;
    let cube = (sum * sum * sum).max(tiny);
    let (na, nb, nc) = (cross(b, c), cross(c, a), cross(a, b));
    let (na, nb, nc) = (dot(na, na), dot(nb, nb), dot(nc, nc));
    // sin² at edge ij is 36 V² e² n_i² n_j² / Π n².
    let least = ((aa * na).min(bb * nb).min(cc * nc) * nv)
        .min(ab * na * nb)
        .min(bc * nb * nc)
        .min(ca * nc * na);
    let product = na * nb * nc * nv;
    // The smaller of two quotients, or that of an inverted one, by one division.
    let shape = number.all(SHAPE);
    let (sine, other) = (least * cube, shape * product);
    let flatter = other.below(sine, shape, least);
    let against = other.below(sine, cube, product.max(tiny));
    let above = zero.below(v6, flatter, zero - number.all(JOE_LIU * JOE_LIU));
    let below = zero.below(v6, against, cube);
    v6 * v6 * (above / below)
}

/// The objective from its signed square.
pub(crate) fn objective(value: f64) -> f64 {
    value.abs().sqrt().copysign(value)
}
