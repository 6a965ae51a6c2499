//! The tetrahedra around one vertex, ready to be judged at many positions of that vertex.

use geom_core::{Point3, Vector3};

use crate::metrics::{JOE_LIU, SHAPE_WEIGHT};

/// The objective counts as raised only by more than this: sweeps end.
pub(crate) const GAIN: f64 = 1e-9;

/// The face opposite the vertex: what does not change when the vertex moves.
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
/// objective of [`quality`](crate::quality), which order like it and need no root.
#[derive(Default)]
pub(crate) struct Ring {
    faces: Vec<Face>,
}

impl Ring {
    pub(crate) fn clear(&mut self) {
        self.faces.clear();
    }

    /// Adds the tetrahedron `(vertex, a, b, c)`.
    pub(crate) fn push(&mut self, [a, b, c]: [Point3; 3]) {
        let (a, b, c) = (a.coords, b.coords, c.coords);
        let (ab, ca, bc) = (b - a, c - a, c - b);
        let normal = ab.cross(&ca);
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
    pub(crate) fn mean_edge(&self, x: &Vector3) -> f64 {
        let sum: f64 = self
            .faces
            .iter()
            .map(|f| (f.a - x).norm() + (f.b - x).norm() + (f.c - x).norm())
            .sum();
        sum / (3 * self.faces.len()) as f64
    }

    /// How deep `x` lies inside all faces, negative outside, and the unit direction away from the
    /// nearest one.
    pub(crate) fn depth(&self, x: &Vector3) -> (f64, Vector3) {
        let mut least = (f64::INFINITY, Vector3::zeros());
        for f in &self.faces {
            let area = f.square.sqrt();
            if area > 0.0 {
                let depth = f.normal.dot(&(f.a - x)) / area;
                if depth < least.0 {
                    least = (depth, f.normal / -area);
                }
            }
        }
        least
    }

    /// The smallest value with the vertex at `x`. The worst face moves to the front, where the next
    /// candidate most likely fails.
    pub(crate) fn value(&mut self, x: &Vector3) -> f64 {
        let (mut worst, mut at) = (f64::INFINITY, 0);
        for (i, face) in self.faces.iter().enumerate() {
            let value = face.value(x);
            if value < worst {
                (worst, at) = (value, i);
            }
        }
        if at > 0 {
            self.faces.swap(0, at);
        }
        worst
    }

    /// Is every tetrahedron with the vertex at `x` `good`, or its value at least `enough`?
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
    pub(crate) fn value_above(&mut self, x: &Vector3, bound: f64) -> Option<f64> {
        let mut worst = f64::INFINITY;
        for i in 0..self.faces.len() {
            let value = self.faces[i].value(x);
            if value <= bound {
                if i > 0 {
                    self.faces.swap(i, i / 2);
                }
                return None;
            }
            worst = worst.min(value);
        }
        Some(worst)
    }
}

impl Face {
    #[inline]
    fn value(&self, x: &Vector3) -> f64 {
        let (a, b, c) = (self.a - x, self.b - x, self.c - x);
        let v6 = self.normal.dot(&a);
        let (aa, bb, cc) = (a.norm_squared(), b.norm_squared(), c.norm_squared());
        let sum = aa + bb + cc + self.ab + self.bc + self.ca;
        let cube = sum * sum * sum;
        if v6 <= 0.0 {
            let shape = if cube > 0.0 {
                JOE_LIU * JOE_LIU * v6 * v6 / cube
            } else {
                0.0
            };
            return -shape;
        }
        let na = b.cross(&c).norm_squared();
        let nb = c.cross(&a).norm_squared();
        let nc = a.cross(&b).norm_squared();
        let nv = self.square;
        // sin² at edge ij is 36 V² e² n_i² n_j² / Π n².
        let least = ((aa * na).min(bb * nb).min(cc * nc) * nv)
            .min(self.ab * na * nb)
            .min(self.bc * nb * nc)
            .min(self.ca * nc * na);
        let product = na * nb * nc * nv;
        if product <= 0.0 {
            return 0.0;
        }
        const SHAPE: f64 = SHAPE_WEIGHT * SHAPE_WEIGHT * JOE_LIU * JOE_LIU;
        v6 * v6 * (least / product).min(SHAPE / cube)
    }
}

/// The objective from its signed square.
pub(crate) fn objective(value: f64) -> f64 {
    value.abs().sqrt().copysign(value)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::metrics::quality;
    use proptest::prelude::*;

    fn point() -> impl Strategy<Value = Point3> {
        [-1.0..1.0, -1.0..1.0, -1.0..1.0].prop_map(Point3::from)
    }

    proptest! {
        #[test]
        fn the_ring_judges_like_the_definition(p in [point(), point(), point(), point()]) {
            let mut ring = Ring::default();
            ring.push([p[1], p[2], p[3]]);
            let value = objective(ring.value(&p[0].coords));
            prop_assert!((value - quality(p)).abs() < 1e-9);
        }
    }
}
