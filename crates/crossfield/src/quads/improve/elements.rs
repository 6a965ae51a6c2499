//! Quads as a flow moves them.

use geom_core::compute::parallel;
use geom_core::mesh::quality::{highest_jacobian, scaled_jacobian, upright_jacobian};
use geom_core::surface::flow::{Elements, Places, Vertices, Wedge, facing, least};
use geom_core::{Point3, Vector3};

use super::super::quality::mean_sides;
use crate::Error;

/// Sides below this share of what they shall be long are bad however straight their corners are.
const SHORT: f64 = 0.3;

pub(super) struct Quads {
    pub(super) quads: Vec<[u32; 4]>,
    /// The least proportion of sides, 1 for squares.
    pub(super) narrowest: f64,
    /// What the first and third side of each quad shall be long, and the others.
    lengths: Vec<[f64; 2]>,
    wedges: Vec<Wedge>,
    scale: Vec<f64>,
    around: Vec<Vec<u32>>,
}

impl Quads {
    /// Their sides shall be as long as they are here, as square as they may be.
    pub(super) fn new(quads: Vec<[u32; 4]>, positions: &[Point3], narrowest: f64) -> Self {
        let mut around = vec![Vec::new(); positions.len()];
        for (q, quad) in (0u32..).zip(&quads) {
            for &v in quad {
                around[v as usize].push(q);
            }
        }
        let mut made = Self {
            quads,
            narrowest,
            lengths: Vec::new(),
            wedges: Vec::new(),
            scale: Vec::new(),
            around,
        };
        made.renew(positions);
        made
    }

    /// The scaled Jacobian of one.
    pub(super) fn jacobian(&self, q: usize, places: &Places<'_>) -> f64 {
        self.on_quad(q, places, scaled_jacobian)
    }

    fn on_quad(
        &self,
        q: usize,
        places: &Places<'_>,
        of: impl Fn(&[Point3; 4], &Vector3) -> f64,
    ) -> f64 {
        let corners = self.corners(q, places);
        of(&corners, &self.surface_normal(q, &corners, places))
    }

    /// Of its sides, in what they shall be long.
    fn shortest(&self, q: usize, p: &[Point3; 4]) -> f64 {
        let length = |k: usize| (p[(k + 1) % 4] - p[k]).norm() / self.lengths[q][k % 2];
        least((0..4).map(length))
    }

    fn corners(&self, q: usize, places: &Places<'_>) -> [Point3; 4] {
        self.quads[q].map(|v| places.position(v))
    }

    fn surface_normal(&self, q: usize, at: &[Point3; 4], places: &Places<'_>) -> Vector3 {
        let normals = self.quads[q].map(|v| places.normal(v));
        places.ground(self.quads[q][0]).normal_over(at, &normals)
    }
}

impl Elements for Quads {
    type Error = Error;
    type Rim = [u32; 4];

    fn count(&self) -> usize {
        self.quads.len()
    }

    fn rim(&self, q: usize) -> [u32; 4] {
        self.quads[q]
    }

    fn around(&self, v: usize) -> &[u32] {
        &self.around[v]
    }

    fn wedges(&self) -> &[Wedge] {
        &self.wedges
    }

    fn renew(&mut self, positions: &[Point3]) {
        let of = |q: &[u32; 4]| lengths(&q.map(|v| positions[v as usize]), self.narrowest);
        self.lengths = self.quads.iter().map(of).collect();
        self.wedges.clear();
        self.scale = vec![0.0; positions.len()];
        for (quad, &[first, second]) in self.quads.iter().zip(&self.lengths) {
            let side = first.min(second);
            for k in 0..4 {
                let ideal = if k % 2 == 0 {
                    [first, second]
                } else {
                    [second, first]
                };
                self.wedges.push(Wedge::of_quad(quad, k, ideal));
                let v = quad[k] as usize;
                self.scale[v] += side * side / self.around[v].len() as f64;
            }
        }
    }

    fn part(&self, elements: &[usize], vertices: &[u32], positions: &[Point3]) -> Self {
        let place = |v: u32| vertices.partition_point(|&u| u < v) as u32;
        let quads = elements.iter().map(|&q| self.quads[q].map(place));
        Self::new(quads.collect(), positions, self.narrowest)
    }

    fn seen(&self, vertices: &Vertices<'_>) -> Vec<Vector3> {
        let places = Places::of(vertices);
        parallel::flat_map(self.quads.len(), |q| {
            let at = self.corners(q, &places);
            let of_surface = self.surface_normal(q, &at, &places);
            let first = vertices.normals[self.quads[q][0] as usize];
            [facing(&at, &of_surface).unwrap_or(first); 4]
        })
    }

    /// Rising also where a quad lies on its back, and no more than its shortest side is long.
    fn merit(&self, q: usize, places: &Places<'_>) -> f64 {
        let merit = self.on_quad(q, places, upright_jacobian);
        merit.min(self.shortest(q, &self.corners(q, places)) / SHORT)
    }

    fn merit_at_most(&self, q: usize, places: &Places<'_>) -> f64 {
        let corners = self.corners(q, places);
        highest_jacobian(&corners).min(self.shortest(q, &corners) / SHORT)
    }

    fn scale(&self, v: usize) -> f64 {
        self.scale[v]
    }

    /// The shortest that a side there shall be.
    fn reach(&self, v: usize) -> f64 {
        let lengths = self.around[v].iter().map(|&q| self.lengths[q as usize]);
        least(lengths.flatten())
    }
}

/// What the first and third side of a quad shall be long, and the others: the mean of all four, in the proportion that they have,
/// but not farther apart than `narrowest`.
pub(crate) fn lengths(p: &[Point3; 4], narrowest: f64) -> [f64; 2] {
    let sides = (0..4).map(|k| (p[(k + 1) % 4] - p[k]).norm());
    let mean = sides.sum::<f64>() / 4.0;
    let [first, second] = mean_sides(p).map(|s| s.norm());
    let ratio = if first > 0.0 { first / second } else { 1.0 };
    let ratio = ratio.clamp(narrowest, narrowest.recip());
    [2.0 * ratio, 2.0].map(|part| mean * (part / (1.0 + ratio)))
}
