//! Geodesic distance by the heat method (Crane, Weischedel and Wardetzky, *Geodesics in heat*, 2013).

use rayon::prelude::*;

use super::{DistanceError, Graph, NONE, shortest_paths};
use crate::linalg::{Cholesky, SparseMatrix, Symbolic};
use crate::{TriMesh, laplace};

/// Decades that heat may fall before an f64 loses it: from [`START`] down to the smallest numbers,
/// with some to spare for the entries of the factor.
const RANGE: f64 = 1100.0;
/// Heat put in at the sources.
const START: f64 = 1e250;

/// How the heat flows.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct HeatOptions {
    /// The heat flows for `smoothing` times the square of the mean edge length. 1 is the most
    /// accurate on good triangles; larger values round off the distance where fronts meet.
    pub smoothing: f64,
}

impl Default for HeatOptions {
    fn default() -> Self {
        Self { smoothing: 1.0 }
    }
}

impl HeatOptions {
    /// Are all numbers in their ranges?
    pub fn check(&self) -> Result<(), DistanceError> {
        if self.smoothing.is_finite() && self.smoothing > 0.0 {
            Ok(())
        } else {
            Err(DistanceError::Smoothing(self.smoothing))
        }
    }
}

/// Distances along a surface, across its triangles: factored once, asked for any number of sources.
///
/// Heat that flows from the sources for a short time falls along the shortest ways, so its gradient
/// has their directions; the function whose gradient comes nearest to those of length one is the
/// distance. On surfaces of ten thousand good triangles it is 1–2 % off in the mean, and less with
/// shorter edges. At borders the heat is the mean of an insulated and of a cooled border's.
///
/// ```
/// use geom_core::{distance::{Heat, HeatOptions}, mesh::shapes};
/// let sphere = shapes::icosphere(1.0, 4);
/// let pole = sphere.positions()[0].coords;
/// let distance = Heat::new(&sphere, &HeatOptions::default())?.from(&[0])?;
/// let errors = sphere.positions().iter().zip(&distance);
/// let sum: f64 = errors.map(|(p, d)| (d - p.coords.angle(&pole)).abs()).sum();
/// assert!(sum / (sphere.positions().len() as f64) < 0.02);
/// # Ok::<(), geom_core::distance::DistanceError>(())
/// ```
#[derive(Clone, Debug)]
pub struct Heat {
    mesh: TriMesh,
    mass: Vec<f64>,
    /// One number per component of the surface, per vertex; [`NONE`] at unused vertices.
    component: Vec<u32>,
    insulated: Cholesky,
    /// With a border at zero; `None` for a surface without border.
    cooled: Option<(Cholesky, Vec<bool>)>,
    poisson: Cholesky,
    /// One vertex per component, whose value the Poisson equation leaves open.
    pinned: Vec<u32>,
}

impl Heat {
    /// Factors the heat and the Poisson equation of `mesh`.
    ///
    /// # Errors
    /// [`DistanceError::Operator`] names a triangle without area, [`DistanceError::Factor`] says when
    /// memory does not suffice.
    pub fn new(mesh: &TriMesh, options: &HeatOptions) -> Result<Self, DistanceError> {
        options.check()?;
        let stiffness = laplace::stiffness(mesh)?;
        let laplace::Mass::Lumped(mut mass) = laplace::lumped_mass(mesh) else {
            unreachable!("lumped mass is lumped")
        };
        let (component, pinned) = components(mesh);
        // Unused vertices have an equation of their own.
        for (m, c) in mass.iter_mut().zip(&component) {
            if *c == NONE {
                *m = 1.0;
            }
        }
        let time = time(mesh, &pinned, options.smoothing);
        let heat = SparseMatrix::diagonal_of(&mass).plus(time, &stiffness)?;
        let symbolic = Symbolic::of(&heat)?;
        let insulated = symbolic.factor(&heat)?;
        let border = on_border(mesh);
        let cooled = if border.contains(&true) {
            let fixed = fix(&heat, |v| border[v]);
            Some((symbolic.factor(&fixed)?, border))
        } else {
            None
        };
        // The pattern of the heat equation, so that one analysis serves all.
        let poisson = SparseMatrix::diagonal_of(&mass)
            .map(|_, _, _| 0.0)
            .plus(1.0, &stiffness)?;
        let poisson = fix(&poisson, |v| {
            component[v] == NONE || pinned[component[v] as usize] == v as u32
        });
        let poisson = symbolic.factor(&poisson)?;
        Ok(Self {
            mesh: mesh.clone(),
            mass,
            component,
            insulated,
            cooled,
            poisson,
            pinned,
        })
    }

    /// The distance of every vertex from the nearest of these vertices, Å; infinite on components
    /// without a source.
    pub fn from(&self, sources: &[u32]) -> Result<Vec<f64>, DistanceError> {
        let mut all = self.from_each(&[sources])?;
        Ok(all.pop().expect("one set, one answer"))
    }

    /// The same for several sets of sources at once, which takes less time than one by one.
    pub fn from_each<S: AsRef<[u32]> + Sync>(
        &self,
        sets: &[S],
    ) -> Result<Vec<Vec<f64>>, DistanceError> {
        let nodes = self.mass.len();
        for (set, sources) in sets.iter().enumerate() {
            if sources.as_ref().is_empty() {
                return Err(DistanceError::NoSource { set });
            }
            for (source_index, &node) in sources.as_ref().iter().enumerate() {
                if node as usize >= nodes {
                    return Err(DistanceError::NoSuchNode {
                        source_index,
                        node,
                        nodes,
                    });
                }
            }
        }
        // A few at a time: each takes some numbers per vertex.
        let mut out = Vec::with_capacity(sets.len());
        for part in sets.chunks(32) {
            out.extend(self.solve(part)?);
        }
        Ok(out)
    }

    fn solve<S: AsRef<[u32]> + Sync>(&self, sets: &[S]) -> Result<Vec<Vec<f64>>, DistanceError> {
        let (n, k) = (self.mass.len(), sets.len());
        let mut heat = vec![0.0; n * k];
        for (j, sources) in sets.iter().enumerate() {
            for &v in sources.as_ref() {
                heat[v as usize * k + j] = START * self.mass[v as usize];
            }
        }
        if let Some((cooled, border)) = &self.cooled {
            let mut cold = heat.clone();
            for (v, row) in cold.chunks_mut(k).enumerate() {
                if border[v] {
                    row.fill(0.0);
                }
            }
            cooled.solve_in_place(&mut cold, k)?;
            self.insulated.solve_in_place(&mut heat, k)?;
            for (u, c) in heat.iter_mut().zip(cold) {
                *u = f64::midpoint(*u, c);
            }
        } else {
            self.insulated.solve_in_place(&mut heat, k)?;
        }
        let columns: Vec<Vec<f64>> = (0..k)
            .into_par_iter()
            .map(|j| self.sources_of_ways(&heat, j, k))
            .collect::<Result<_, _>>()?;
        let mut distance = vec![0.0; n * k];
        for (j, column) in columns.into_iter().enumerate() {
            for (v, d) in column.into_iter().enumerate() {
                distance[v * k + j] = d;
            }
        }
        self.poisson.solve_in_place(&mut distance, k)?;
        Ok((0..k)
            .into_par_iter()
            .map(|j| self.shifted(&distance, j, k, sets[j].as_ref()))
            .collect())
    }

    /// `−div X` for the unit directions X against the gradient of the heat of one set.
    fn sources_of_ways(&self, heat: &[f64], j: usize, k: usize) -> Result<Vec<f64>, DistanceError> {
        // In each triangle only ratios matter: brought near 1, their squares stay in range.
        let ways: Vec<_> = self
            .mesh
            .triangles()
            .par_iter()
            .enumerate()
            .map(|(t, corners)| {
                let u = corners.map(|v| heat[v as usize * k + j]);
                let largest = u.iter().fold(0.0, |m: f64, u| m.max(u.abs()));
                if largest == 0.0 {
                    return crate::Vector3::zeros();
                }
                let u = u.map(|u| u / largest);
                let hats = laplace::hat_gradients(&self.mesh, t);
                let gradient = hats[0] * u[0] + hats[1] * u[1] + hats[2] * u[2];
                -gradient.try_normalize(0.0).unwrap_or_default()
            })
            .collect();
        let mut right = laplace::divergence(&self.mesh, &ways)?;
        for (v, r) in right.iter_mut().enumerate() {
            let c = self.component[v];
            *r = if c == NONE || self.pinned[c as usize] == v as u32 {
                0.0
            } else {
                -*r
            };
        }
        Ok(right)
    }

    /// Distances that are zero at the sources, in the mean of each component, and never below.
    fn shifted(&self, all: &[f64], j: usize, k: usize, sources: &[u32]) -> Vec<f64> {
        let mut sums = vec![(0.0, 0u32); self.pinned.len()];
        for &v in sources {
            let c = self.component[v as usize];
            if c != NONE {
                sums[c as usize].0 += all[v as usize * k + j];
                sums[c as usize].1 += 1;
            }
        }
        let mut out: Vec<f64> = (0..self.mass.len())
            .map(|v| match self.component[v] {
                NONE => f64::INFINITY,
                c => match sums[c as usize] {
                    (_, 0) => f64::INFINITY,
                    (sum, count) => (all[v * k + j] - sum / f64::from(count)).max(0.0),
                },
            })
            .collect();
        for &v in sources {
            out[v as usize] = 0.0;
        }
        out
    }
}

/// The component of each vertex, numbered by their lowest vertices, and those.
fn components(mesh: &TriMesh) -> (Vec<u32>, Vec<u32>) {
    let n = mesh.positions().len();
    let mut root: Vec<u32> = (0..n as u32).collect();
    let find = |root: &mut Vec<u32>, mut v: u32| {
        while root[v as usize] != v {
            root[v as usize] = root[root[v as usize] as usize];
            v = root[v as usize];
        }
        v
    };
    let mut used = vec![false; n];
    for &[a, b, c] in mesh.triangles() {
        for [v, w] in [[a, b], [b, c]] {
            let (v, w) = (find(&mut root, v), find(&mut root, w));
            root[v.max(w) as usize] = v.min(w);
        }
        for v in [a, b, c] {
            used[v as usize] = true;
        }
    }
    let mut lowest = Vec::new();
    let mut component = vec![NONE; n];
    for v in 0..n as u32 {
        if used[v as usize] {
            let r = find(&mut root, v);
            if r == v {
                component[v as usize] = lowest.len() as u32;
                lowest.push(v);
            } else {
                component[v as usize] = component[r as usize];
            }
        }
    }
    (component, lowest)
}

/// How long the heat flows: the wanted time, or longer where it would not get everywhere. It falls
/// as exp(−d / √t), and no vertex is farther from another than twice as far as from the lowest.
fn time(mesh: &TriMesh, lowest: &[u32], smoothing: f64) -> f64 {
    let graph = Graph::of_edges(mesh);
    let (mut sum, mut count) = (0.0, 0);
    for v in 0..graph.len() as u32 {
        for &(w, length) in graph.links(v) {
            if v < w {
                sum += length;
                count += 1;
            }
        }
    }
    let mean = if count > 0 {
        sum / f64::from(count)
    } else {
        1.0
    };
    let sources: Vec<(u32, f64)> = lowest.iter().map(|&v| (v, 0.0)).collect();
    let paths = shortest_paths(&graph, &sources, f64::INFINITY).expect("vertices of the mesh");
    let farthest = paths
        .distance
        .into_iter()
        .filter(|d| d.is_finite())
        .fold(0.0, f64::max);
    (smoothing * mean * mean).max((2.0 * farthest / RANGE).powi(2))
}

fn on_border(mesh: &TriMesh) -> Vec<bool> {
    let mut edges: Vec<[u32; 2]> = mesh
        .triangles()
        .iter()
        .flat_map(|&[a, b, c]| [[a, b], [b, c], [c, a]])
        .map(|[a, b]| [a.min(b), a.max(b)])
        .collect();
    edges.par_sort_unstable();
    let mut border = vec![false; mesh.positions().len()];
    for group in edges.chunk_by(|a, b| a == b) {
        if let [[a, b]] = *group {
            border[a as usize] = true;
            border[b as usize] = true;
        }
    }
    border
}

/// The matrix with the equations of some rows replaced by `x = right side`, and symmetric all the
/// same if those right sides are 0.
fn fix(matrix: &SparseMatrix, fixed: impl Fn(usize) -> bool + Sync) -> SparseMatrix {
    matrix.map(|i, j, value| match (fixed(i) || fixed(j), i == j) {
        (true, true) => 1.0,
        (true, false) => 0.0,
        (false, _) => value,
    })
}
