//! Rational bicubic Bézier elements, as T-splines and other splines are exchanged: functions of nodes by their Bernstein
//! coefficients on each element (Bézier extraction: Scott, Borden, Verhoosel, Sederberg and Hughes, 2011).
//!
//! Nothing here knows how the spline was made: T-meshes, knots and blending functions have become, per element, a
//! matrix from Bernstein polynomials to functions of nodes. The element is then a patch like those of Catmull–Clark
//! surfaces, but each with a basis of its own, so that no two share a task and all are computed on the CPU.

use geom_core::Point3;
use geom_core::algebra::quadrature::gauss;
use geom_core::compute::parallel;
use geom_core::compute::sets::DisjointSets;

use super::patch;
use super::pattern::Matrices;
use super::quads::{gathered, joined};
use super::scale::UnitScale;
use crate::backend::{PatchMatrices, PatchTask};
use crate::catmull::{Jet, ROWS, jet};
use crate::forms::Conductor;
use crate::options::Quadrature;
use crate::{Error, SpectrumOptions};

/// An element over the unit square.
/// Elements need not be neighbours in any order; they meet where they share nodes.
#[derive(Clone, Debug, PartialEq)]
pub struct BezierElement {
    /// The nodes whose functions live here, each once.
    pub nodes: Vec<u32>,
    /// Per node the Bernstein coefficients of its function: number `a + 4 b` belongs to `B_a(u) B_b(v)`.
    pub rows: Vec<[f64; 16]>,
}

impl AsRef<[u32]> for BezierElement {
    fn as_ref(&self) -> &[u32] {
        &self.nodes
    }
}

/// A surface of such elements. Its normals, `x_u × x_v`, point outwards.
#[derive(Clone, Debug, PartialEq)]
pub struct BezierSurface {
    positions: Vec<Point3>,
    weights: Vec<f64>,
    elements: Vec<BezierElement>,
}

impl BezierSurface {
    /// A surface of nodes, x, y, z (Å) and weight, and elements.
    ///
    /// An element over the unit square whose control points are its nodes:
    ///
    /// ```
    /// use secondfund_ops::{BezierElement, BezierSurface};
    /// let third = |k: u8| f64::from(k) / 3.0;
    /// let nodes: Vec<[f64; 4]> = (0..16).map(|k| [third(k % 4), third(k / 4), 0.0, 1.0]).collect();
    /// let rows: Vec<[f64; 16]> = (0..16).map(|k| std::array::from_fn(|c| f64::from(u8::from(c == k)))).collect();
    /// let surface = BezierSurface::new(&nodes, vec![BezierElement { nodes: (0..16).collect(), rows }])?;
    /// // Control points in even steps: x is u itself.
    /// let x: Vec<f64> = nodes.iter().map(|n| n[0]).collect();
    /// assert!((surface.value(0, [0.3, 0.8], &x) - 0.3).abs() < 1e-12);
    /// # Ok::<(), secondfund_ops::Error>(())
    /// ```
    ///
    /// # Errors
    /// [`Error::Element`] names what cannot be evaluated, [`Error::Node`] a node without place or weight.
    pub fn new(nodes: &[[f64; 4]], elements: Vec<BezierElement>) -> Result<Self, Error> {
        let bad = |n: &[f64; 4]| n.iter().any(|x| !x.is_finite()) || n[3] <= 0.0;
        if let Some(node) = nodes.iter().position(bad) {
            return Err(Error::Node { node });
        }
        for (element, e) in elements.iter().enumerate() {
            let refused = |must| Err(Error::Element { element, must });
            let mut sorted = e.nodes.clone();
            sorted.sort_unstable();
            if sorted.windows(2).any(|w| w[0] == w[1]) {
                return refused("name each node once");
            }
            if sorted.last().is_none_or(|&n| n as usize >= nodes.len()) {
                return refused("name nodes that there are, at least one");
            }
            if e.rows.len() != e.nodes.len() {
                return refused("have a row of coefficients per node");
            }
            if e.rows.as_flattened().iter().any(|c| !c.is_finite()) {
                return refused("have finite coefficients");
            }
        }
        Ok(Self {
            positions: nodes
                .iter()
                .map(|n| Point3::new(n[0], n[1], n[2]))
                .collect(),
            weights: nodes.iter().map(|n| n[3]).collect(),
            elements,
        })
    }

    /// The number of nodes: degrees of freedom of a function.
    pub fn nodes(&self) -> usize {
        self.positions.len()
    }

    /// The elements.
    pub fn elements(&self) -> &[BezierElement] {
        &self.elements
    }

    /// A function of coefficients per node, at a place of an element.
    ///
    /// # Panics
    /// If there is no such element, or a node of it has no coefficient.
    pub fn value(&self, element: usize, [u, v]: [f64; 2], coefficients: &[f64]) -> f64 {
        let e = &self.elements[element];
        let rows = self.rows(e, u, v);
        let parts = e.nodes.iter().zip(&rows);
        parts.map(|(&n, r)| r * coefficients[n as usize]).sum()
    }

    /// The points of the quadrature of all elements with their weights, as [`Surface::jets`](crate::Surface::jets).
    ///
    /// # Errors
    /// A quadrature out of range.
    pub fn jets(&self, quadrature: Quadrature) -> Result<Vec<(Jet, f64)>, Error> {
        quadrature.check()?;
        let points = points(quadrature);
        let all = self.elements.iter().flat_map(|e| {
            let corners = self.points_of(e, &self.positions);
            let at = |&([u, v], w): &([f64; 2], f64)| (jet(&self.rows(e, u, v), &corners), w);
            points.iter().map(at).collect::<Vec<_>>()
        });
        Ok(all.collect())
    }

    /// The places of an element's nodes, from positions of all nodes.
    fn points_of(&self, element: &BezierElement, positions: &[Point3]) -> Vec<Point3> {
        let nodes = element.nodes.iter();
        nodes.map(|&n| positions[n as usize]).collect()
    }

    /// Value and derivatives u, v, uu, uv, vv of the functions of an element, row after row: `R = w N / Σ w N`.
    /// Derivatives of the quotient by the rule of the product: from `N w = R W` follow R' and R'' without powers of W.
    fn rows(&self, element: &BezierElement, u: f64, v: f64) -> Vec<f64> {
        let (a, b) = (bernstein(u), bernstein(v));
        let orders = [(0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2)];
        let m = element.nodes.len();
        let mut rows = vec![0.0; ROWS * m];
        for (k, (i, j)) in orders.into_iter().enumerate() {
            for (l, (row, &node)) in element.rows.iter().zip(&element.nodes).enumerate() {
                let sum = |s: f64, c: usize| s + row[c] * a[i][c % 4] * b[j][c / 4];
                rows[k * m + l] = self.weights[node as usize] * (0..16).fold(0.0, sum);
            }
        }
        let [w, wu, wv, wuu, wuv, wvv]: [f64; ROWS] =
            std::array::from_fn(|k| rows[k * m..(k + 1) * m].iter().sum());
        for l in 0..m {
            let [n, nu, nv, nuu, nuv, nvv]: [f64; ROWS] = std::array::from_fn(|k| rows[k * m + l]);
            let r = n / w;
            let (ru, rv) = ((nu - r * wu) / w, (nv - r * wv) / w);
            let second = [
                (nuu - 2.0 * ru * wu - r * wuu) / w,
                (nuv - ru * wv - rv * wu - r * wuv) / w,
                (nvv - 2.0 * rv * wv - r * wvv) / w,
            ];
            let [ruu, ruv, rvv] = second;
            for (k, x) in [r, ru, rv, ruu, ruv, rvv].into_iter().enumerate() {
                rows[k * m + l] = x;
            }
        }
        rows
    }

    /// From the corners of the elements, which lie on the surface; nodes may lie far from it.
    fn scale(&self) -> Result<UnitScale, Error> {
        let corners = [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]];
        let ends = self.elements.iter().flat_map(|e| {
            let points = self.points_of(e, &self.positions);
            corners.map(|[u, v]| jet(&self.rows(e, u, v), &points).position)
        });
        UnitScale::of(&ends.collect::<Vec<_>>())
    }
}

/// Values, first and second derivatives of the four cubic Bernstein polynomials.
/// Values sum to 1, derivatives to 0.
fn bernstein(t: f64) -> [[f64; 4]; 3] {
    let s = 1.0 - t;
    [
        [s * s * s, 3.0 * s * s * t, 3.0 * s * t * t, t * t * t],
        [
            -3.0 * s * s,
            3.0 * s * (s - 2.0 * t),
            3.0 * t * (2.0 * s - t),
            3.0 * t * t,
        ],
        [6.0 * s, 6.0 * (t - 2.0 * s), 6.0 * (s - 2.0 * t), 6.0 * t],
    ]
}

/// Gauss points of the unit square with their weights.
fn points(quadrature: Quadrature) -> Vec<([f64; 2], f64)> {
    let rule = gauss(quadrature.points);
    let rows = rule.iter().flat_map(|&(v, wv)| {
        let row = rule.iter().map(move |&(u, wu)| ([u, v], wu * wv));
        row.collect::<Vec<_>>()
    });
    rows.collect()
}

/// The matrices of an operator on a surface, per node.
/// Components hang together by nodes: elements that share none are apart, though they may touch.
pub(crate) fn matrices(
    surface: &BezierSurface,
    conductor: &Conductor,
    factors: &[f64],
    options: &SpectrumOptions,
) -> Result<Matrices, Error> {
    let scale = surface.scale()?;
    let positions: Vec<Point3> = surface.positions.iter().map(|p| scale.apply(p)).collect();
    let points = points(options.quadrature);
    let elements = &surface.elements;
    // A billionth of the area that an element would have if all were alike on the unit cube.
    let least = 1e-9 / elements.len().max(1) as f64;
    let weights: Vec<f64> = points.iter().map(|p| p.1).collect();
    let of_element = |e: &BezierElement| {
        let rows = points.iter().map(|&([u, v], _)| surface.rows(e, u, v));
        let basis: Vec<f64> = rows.flatten().collect();
        let factors: Vec<f64> = match factors {
            [] => Vec::new(),
            f => e.nodes.iter().map(|&n| f[n as usize]).collect(),
        };
        let task = PatchTask {
            functions: e.nodes.len(),
            weights: &weights,
            basis: &basis,
            points: &surface.points_of(e, &positions),
            factors: &factors,
            conductor: *conductor,
            least,
            mass: true,
        };
        let mut out = PatchMatrices::default();
        patch::matrices(&task, &mut out);
        out
    };
    let parts: Vec<PatchMatrices> = parallel::map_each(elements, of_element);
    let all = joined(parts, points.len() * elements.len(), elements)?;
    let mut sets = DisjointSets::new(surface.nodes());
    for e in elements {
        e.nodes.windows(2).for_each(|w| {
            sets.join(w[0], w[1]);
        });
    }
    let components = sets.into_roots();
    let known = (scale.length, components);
    gathered(surface.nodes(), elements, &all, known)
}
