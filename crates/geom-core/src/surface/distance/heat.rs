//! Geodesic distance by the heat method (Crane, Weischedel and Wardetzky, *Geodesics in heat*, 2013).

use crate::compute::parallel;
use rayon::prelude::*;

use super::{DistanceError, Graph, NONE, shortest_paths};
use crate::TriMesh;
use crate::algebra::{Cholesky, SparseMatrix, Symbolic};
use crate::compute::sets::DisjointSets;
use crate::options::require;
use crate::surface::laplace::Intrinsic;

/// How often heat may fall to 1/e before an f64 loses it: from [`START`] down to the smallest numbers about 1280
/// times, some of which are spared for the entries of the factor.
const RANGE: f64 = 1100.0;
/// Heat put in at the sources.
const START: f64 = 1e250;

/// How the heat flows.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct HeatOptions {
    /// The heat flows for `smoothing` times the square of the mean edge length. Below 1 the front
    /// follows the edges of long triangles; above 4 the distance is rounded off where fronts meet.
    /// A constant leaves 0.2 % of error on a sphere, however short the edges are; doubled when edges
    /// become half as long, the error halves with them.
    pub smoothing: f64,
}

impl Default for HeatOptions {
    fn default() -> Self {
        Self { smoothing: 2.0 }
    }
}

impl HeatOptions {
    /// Are all numbers in their ranges? [`Heat::new`] asks it first.
    pub fn check(&self) -> Result<(), DistanceError> {
        let holds = self.smoothing.is_finite() && self.smoothing > 0.0;
        require(holds, "smoothing", self.smoothing, "be a positive number")?;
        Ok(())
    }
}

/// Distances along a surface, across its triangles: factored once, asked for any number of sources.
///
/// Heat that flows from the sources for a short time falls along the shortest ways, so its gradient
/// has their directions; the function whose gradient comes nearest to those of length one is the
/// distance. On a sphere of a thousand triangles it is half a percent off in the mean, two where they
/// are bad, and less with shorter edges. At borders the heat is the mean of an insulated and of a cooled border's.
///
/// Heat flows over the triangles of [`laplace::robust`](crate::surface::laplace::robust()): Delaunay in the
/// surface, whatever the triangles of the mesh are, so that long, obtuse and flat ones do no harm
/// (Sharp, Soliman and Crane, *Navigating intrinsic triangulations*, 2019), and edges may have any
/// number of triangles.
///
/// ```
/// use geom_core::mesh::shapes;
/// use geom_core::surface::distance::{Heat, HeatOptions};
/// let sphere = shapes::icosphere(1.0, 4);
/// let pole = sphere.positions()[0].coords;
/// let distance = Heat::new(&sphere, &HeatOptions::default())?.from(&[0])?;
/// let errors = sphere.positions().iter().zip(&distance);
/// let sum: f64 = errors.map(|(p, d)| (d - p.coords.angle(&pole)).abs()).sum();
/// assert!(sum / (sphere.positions().len() as f64) < 0.005);
/// # Ok::<(), geom_core::surface::distance::DistanceError>(())
/// ```
///
/// It keeps up to three factors and the triangles: about `n log n` numbers for n vertices. They are no metric, since
/// `d(a, b)` and `d(b, a)` differ by the error of the method.
#[derive(Clone, Debug)]
pub struct Heat {
    surface: Intrinsic,
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
    /// [`DistanceError::Operator`] when all triangles are points, [`DistanceError::Factor`] says when
    /// memory does not suffice; [`DistanceError::Option`] if an option is out of its range, [`DistanceError::Length`]
    /// if an edge is too long for a number.
    pub fn new(mesh: &TriMesh, options: &HeatOptions) -> Result<Self, DistanceError> {
        options.check()?;
        let surface = Intrinsic::of(mesh)?;
        let (stiffness, mut mass) = surface.operators(mesh.positions().len())?;
        let (component, pinned) = components(mesh);
        // Unused vertices have an equation of their own.
        for (m, c) in mass.iter_mut().zip(&component) {
            if *c == NONE {
                *m = 1.0;
            }
        }
        let time = time(mesh, &pinned, options.smoothing)?;
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
            surface,
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
    ///
    /// # Errors
    /// [`DistanceError::NoSource`] for an empty list, [`DistanceError::NoSuchNode`] for a number that is no vertex.
    pub fn from(&self, sources: &[u32]) -> Result<Vec<f64>, DistanceError> {
        let mut all = self.from_each(&[sources])?;
        Ok(all.pop().expect("one set, one answer"))
    }

    /// The same for several sets of sources at once, which takes less time than one by one. Sets are solved 32 at a
    /// time, which bounds the memory.
    ///
    /// # Errors
    /// Those of [`Heat::from`]; [`DistanceError::NoSource`] says which set it is.
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

    /// Three steps: heat by one backward Euler step, unit directions against its gradient, and the Poisson equation of
    /// their divergence (Crane and others, 2013, Alg. 1).
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
        let columns: Vec<Vec<f64>> = parallel::map(k, |j| self.sources_of_ways(&heat, j, k));
        let mut distance = vec![0.0; n * k];
        for (j, column) in columns.into_iter().enumerate() {
            for (v, d) in column.into_iter().enumerate() {
                distance[v * k + j] = d;
            }
        }
        self.poisson.solve_in_place(&mut distance, k)?;
        Ok(parallel::map(k, |j| {
            self.shifted(&distance, j, k, sets[j].as_ref())
        }))
    }

    /// `−div X` for the unit directions X against the gradient of the heat of one set. In a triangle
    /// X is `−∇u / |∇u|`, so its share is that of `−u / |∇u|` in the stiffness.
    fn sources_of_ways(&self, heat: &[f64], j: usize, k: usize) -> Vec<f64> {
        let surface = &self.surface;
        let mut right = vec![0.0; self.mass.len()];
        for ((corners, w), area) in surface
            .triangles
            .iter()
            .zip(&surface.weights)
            .zip(&surface.areas)
        {
            let u = corners.map(|v| heat[v as usize * k + j]);
            // Only ratios matter: brought near 1, their squares stay in range.
            let largest = u.iter().fold(0.0, |m: f64, u| m.max(u.abs()));
            let [a, b, c] = u.map(|u| u / largest);
            let flow = [w[0] * (c - b), w[1] * (a - c), w[2] * (b - a)];
            let energy = flow[0] * (c - b) + flow[1] * (a - c) + flow[2] * (b - a);
            // A triangle of one temperature shows no way; NaN where nothing is warm.
            if energy > 0.0 {
                let scale = (area / energy).sqrt();
                for i in 0..3 {
                    let (on, back) = ((i + 1) % 3, (i + 2) % 3);
                    right[corners[i] as usize] -= scale * (flow[on] - flow[back]);
                }
            }
        }
        for (v, r) in right.iter_mut().enumerate() {
            let c = self.component[v];
            if c == NONE || self.pinned[c as usize] == v as u32 {
                *r = 0.0;
            }
        }
        right
    }

    /// Distances, which the Poisson equation gives up to a constant per component. At a source they
    /// have a point that no linear function on triangles has, so its own value is too large; around it
    /// they are right in their differences. So that constant is taken which makes the vertices beside
    /// the sources as far away as their edges are long, in the mean.
    fn shifted(&self, all: &[f64], j: usize, k: usize, sources: &[u32]) -> Vec<f64> {
        let mut is_source = vec![false; self.mass.len()];
        sources.iter().for_each(|&v| is_source[v as usize] = true);
        // Vertices and their distances: 0 for sources, the shortest edge to one for those beside them.
        let mut known: Vec<(u32, f64)> = Vec::new();
        let surface = &self.surface;
        for (t, corners) in surface.triangles.iter().enumerate() {
            for i in 0..3 {
                for other in [(i + 1) % 3, (i + 2) % 3] {
                    let v = corners[other];
                    if is_source[corners[i] as usize] && !is_source[v as usize] {
                        let opposite = 3 - i - other;
                        known.push((v, surface.length(t, opposite)));
                    }
                }
            }
        }
        known.sort_unstable_by(|a, b| a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)));
        known.dedup_by_key(|e| e.0);
        let mut constants = vec![(0.0, 0u32); self.pinned.len()];
        let count = |v: u32, distance: f64, constants: &mut Vec<(f64, u32)>| {
            let c = self.component[v as usize];
            if c != NONE {
                constants[c as usize].0 += all[v as usize * k + j] - distance;
                constants[c as usize].1 += 1;
            }
        };
        for &(v, distance) in &known {
            count(v, distance, &mut constants);
        }
        // Where all vertices of a component are sources.
        let mut alone = vec![(0.0, 0u32); self.pinned.len()];
        for &v in sources {
            count(v, 0.0, &mut alone);
        }
        let mut out: Vec<f64> = (0..self.mass.len())
            .map(|v| match self.component[v] {
                NONE => f64::INFINITY,
                c => match (constants[c as usize], alone[c as usize]) {
                    (_, (_, 0)) => f64::INFINITY,
                    ((_, 0), (sum, count)) | ((sum, count), _) => {
                        (all[v * k + j] - sum / f64::from(count)).max(0.0)
                    }
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
    let mut sets = DisjointSets::new(n);
    let mut used = vec![false; n];
    for &[a, b, c] in mesh.triangles() {
        for [v, w] in [[a, b], [b, c]] {
            sets.join(v, w);
        }
        for v in [a, b, c] {
            used[v as usize] = true;
        }
    }
    let mut lowest = Vec::new();
    let mut component = vec![NONE; n];
    for v in 0..n as u32 {
        if used[v as usize] {
            let r = sets.find(v);
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
/// as exp(−d / √t), and no vertex is farther from another than twice as far as from the lowest. Along edges, which is
/// no shorter than along the surface: the bound is on the safe side.
fn time(mesh: &TriMesh, lowest: &[u32], smoothing: f64) -> Result<f64, DistanceError> {
    let graph = Graph::of_edges(mesh)?;
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
    let paths = shortest_paths(&graph, &sources, f64::INFINITY)?;
    let farthest = paths
        .distance
        .into_iter()
        .filter(|d| d.is_finite())
        .fold(0.0, f64::max);
    Ok((smoothing * mean * mean).max((2.0 * farthest / RANGE).powi(2)))
}

/// The vertices of edges with one triangle.
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
/// same if those right sides are 0. The pattern stays, so that one analysis serves the matrix with and without.
fn fix(matrix: &SparseMatrix, fixed: impl Fn(usize) -> bool + Sync) -> SparseMatrix {
    matrix.map(|i, j, value| match (fixed(i) || fixed(j), i == j) {
        (true, true) => 1.0,
        (true, false) => 0.0,
        (false, _) => value,
    })
}
