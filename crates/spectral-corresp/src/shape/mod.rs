//! Shapes as sets of lattice points: their graph, boundary, depth, skeleton and diameters (Sections 6.1 and 6.3.2).
//!
//! Made in this order: flags on a lattice, cavities filled if asked, the graph of what is inside, its parts, of which
//! those that are kept make a new graph, the boundary with its normals, distances to the outside, and from these
//! skeleton and diameters. Modes are found when they are asked for, and not kept.

pub(crate) mod distance;
mod map;
mod mesh;
mod parts;

use std::ops::Range;

use geom_core::algebra::Mass;
use geom_core::algebra::eigen::{self, EigenPairs, eigenpairs};
use geom_core::algebra::graph::{Laplacian, VoxelGraph};
use geom_core::compute::parallel;
use geom_core::options::require;
use geom_core::search::nearest::PointTree;
use geom_core::{Lattice, LatticeValues, Point3, Run, ScalarGrid, TriMesh, Vector3};

use crate::Error;
use crate::backend::{CorrespBackend, Kernels, On};
use crate::options::{Components, ShapeOptions};

pub use map::Map;
pub(crate) use parts::{Parts, ROOT};

/// Fewest boundary nodes of a shape: with fewer there is nothing to tell its parts by.
const LEAST_BOUNDARY: usize = 50;
/// Bytes per lattice point while a shape is made, if all lie inside: its value, its flag, its node and its place, the order
/// of the parts, from where each node was reached, and whether. Two passes of distances take less, later.
const BYTES_PER_POINT: u128 = 22;
/// What a shape is made in: points, graph, boundary, distances.
const STEPS: u64 = 4;
/// Half the width of the ball in which the normal of a boundary node is taken, in spacings.
const NORMAL_REACH: i64 = 3;
/// Residual of the modes, relative to the first eigenvalue: the features need no more, and closer ones do not match
/// better.
const MODE_TOLERANCE: f64 = 1e-3;
/// Eigenvalues that differ by at most this share form a cluster.
const CLUSTER_GAP: f64 = 1e-2;

/// The lattice points inside a shape, as nodes of a weighted graph.
///
/// Nodes are numbered as their points lie in the lattice, the first axis fastest. A *boundary node* is a node with a
/// point outside across one of its six faces; most of this crate speaks of boundary nodes by their place in
/// [`boundary`](Self::boundary).
///
/// ```
/// use spectral_corresp::geom_core::{Cpu, Lattice, Point3, Run};
/// use spectral_corresp::{ShapeOptions, VoxelShape};
/// let lattice = Lattice { origin: Point3::origin(), spacing: 1.5, counts: [12, 10, 9] };
/// let box_ = VoxelShape::of_flags(&lattice, vec![true; lattice.len()], &ShapeOptions::default(), Run::on(&Cpu))?;
/// assert_eq!(box_.nodes(), 1080);
/// assert_eq!(box_.boundary().len(), 1080 - 10 * 8 * 7);
/// # Ok::<(), spectral_corresp::Error>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct VoxelShape {
    lattice: Lattice,
    graph: VoxelGraph,
    boundary: Vec<u32>,
    points: Vec<Point3>,
    normals: Vec<Vector3>,
    skeleton: Vec<u32>,
    diameters: Vec<f64>,
    report: ShapeReport,
    /// For maps, to know it again.
    identity: u64,
}

/// What became of the points inside.
#[derive(Clone, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct ShapeReport {
    /// Nodes of the parts that were left out, the largest first.
    pub left_out: Vec<usize>,
    /// Points of cavities that were filled.
    pub filled: usize,
    /// Boundary nodes over nodes. Above one half the shape is porous, and its inside says little: a smaller spacing or a
    /// smoother density mends that.
    pub boundary_share: f64,
    /// The largest distance of a node to the outside, Å.
    pub depth: f64,
}

/// A lattice larger than allowed is refused before it is allocated.
pub(crate) fn check_memory(lattice: &Lattice, per_point: u128, limit: u64) -> Result<(), Error> {
    let points = lattice.points();
    refuse_above(limit, points, points.saturating_mul(per_point))
}

/// [`Error::TooLarge`] above the limit.
fn refuse_above(limit: u64, points: u128, bytes: u128) -> Result<(), Error> {
    if bytes > u128::from(limit) {
        return Err(Error::TooLarge {
            points,
            bytes,
            limit,
        });
    }
    Ok(())
}

impl VoxelShape {
    /// The points of a grid at which the value is at least `level`.
    ///
    /// The level must lie within the values; normals follow the gradient of the grid.
    ///
    /// # Errors
    /// [`Error::Empty`] and [`Error::Full`] for a level beyond the values, [`Error::NotFinite`], and those of
    /// [`of_flags`](Self::of_flags).
    pub fn of_grid<B: CorrespBackend + ?Sized>(
        grid: &ScalarGrid,
        level: f64,
        options: &ShapeOptions,
        run: Run<'_, B>,
    ) -> Result<Self, Error> {
        options.check()?;
        check_memory(grid.lattice(), BYTES_PER_POINT, options.max_memory)?;
        let values = grid.values();
        if let Some(point) = values.iter().position(|v| !v.is_finite()) {
            return Err(Error::NotFinite { point });
        }
        let inside: Vec<bool> = parallel::map_each(values, |&v| f64::from(v) >= level);
        let extremes = grid
            .range()
            .map_or((0.0, 0.0), |(a, b)| (a.into(), b.into()));
        if !inside.contains(&true) {
            return Err(Error::Empty {
                largest: extremes.1,
            });
        }
        if !inside.contains(&false) {
            return Err(Error::Full {
                smallest: extremes.0,
            });
        }
        let mut shape = Self::of_flags(grid.lattice(), inside, options, run)?;
        shape.take_normals(grid);
        Ok(shape)
    }

    /// Normals against the gradient of a grid, which are better than those of lattice points.
    fn take_normals(&mut self, grid: &ScalarGrid) {
        let counts = grid.lattice().counts;
        let along = |mut p: [usize; 3], axis: usize| {
            let here = p[axis];
            let mut at = |to: usize| {
                p[axis] = to.min(counts[axis] - 1);
                f64::from(grid.values()[grid.lattice().index(p)])
            };
            at(here + 1) - at(here.saturating_sub(1))
        };
        let graph = &self.graph;
        let boundary = &self.boundary;
        parallel::for_each(&mut self.normals, |i, normal| {
            let p = graph.point(boundary[i] as usize);
            let gradient = Vector3::from([0, 1, 2].map(|axis| along(p, axis)));
            *normal = (-gradient).try_normalize(0.0).unwrap_or(*normal);
        });
    }

    /// The lattice points inside a closed mesh.
    /// The lattice reaches two spacings beyond the mesh. Inside is what an odd number of triangles lies before along the
    /// first axis: holes that no row of lattice points passes count as closed, and a body listed twice as none.
    ///
    /// # Errors
    /// [`Error::Open`] where a row of lattice points shows that the mesh is not closed, [`Error::Spacing`], [`Error::TooLarge`], and those of
    /// [`of_flags`](Self::of_flags).
    pub fn of_mesh<B: CorrespBackend + ?Sized>(
        mesh: &TriMesh,
        spacing: f64,
        options: &ShapeOptions,
        run: Run<'_, B>,
    ) -> Result<Self, Error> {
        options.check()?;
        run.progress("shape", 0, STEPS)?;
        let (lattice, inside) = mesh::inside(mesh, spacing, options.max_memory)?;
        Self::of_flags(&lattice, inside, options, run)
    }

    /// The points of a lattice whose flag is set; what lies beyond the lattice is outside.
    ///
    /// # Errors
    /// [`Error::Flags`] if there is not one flag per point, [`Error::Empty`], [`Error::Spacing`], [`Error::TooLarge`],
    /// [`Error::TooSmall`] with fewer than 50 boundary nodes.
    pub fn of_flags<B: CorrespBackend + ?Sized>(
        lattice: &Lattice,
        inside: Vec<bool>,
        options: &ShapeOptions,
        run: Run<'_, B>,
    ) -> Result<Self, Error> {
        Self::of_flags_on(lattice, inside, options, run.with(run.backend.as_corresp()))
    }

    fn of_flags_on(
        lattice: &Lattice,
        mut inside: Vec<bool>,
        options: &ShapeOptions,
        run: On<'_>,
    ) -> Result<Self, Error> {
        options.check()?;
        let spacing = lattice.spacing;
        if !(spacing > 0.0 && spacing.is_finite()) {
            return Err(Error::Spacing { spacing });
        }
        check_memory(lattice, BYTES_PER_POINT, options.max_memory)?;
        let bounds = lattice.bounds();
        if let Some(point) = [bounds.min, bounds.max]
            .iter()
            .position(|p| p.iter().any(|c| !c.is_finite()))
        {
            return Err(Error::NotFinite { point });
        }
        let (found, expected) = (inside.len(), lattice.points());
        if found as u128 != expected {
            return Err(Error::Flags { found, expected });
        }
        if !inside.contains(&true) {
            return Err(Error::Empty { largest: 0.0 });
        }
        let mut report = ShapeReport::default();
        if options.fill_cavities {
            report.filled = fill_cavities(lattice.counts, &mut inside);
        }
        run.progress("shape", 1, STEPS)?;
        let weights = options.weights.of(spacing);
        // In single precision, which kernels take, there would be no edges.
        require(
            weights[0] >= f64::from(f32::MIN_POSITIVE),
            "weights",
            "Angstrom",
            "be Lattice for a spacing as large as this",
        )?;
        let make =
            |inside: &[bool]| VoxelGraph::new(lattice.counts, inside, options.neighbours, weights);
        let mut graph = make(&inside)?;
        let parts = Parts::of(&graph);
        let sizes: Vec<usize> = parts.each().map(<[u32]>::len).collect();
        let keep = kept(&sizes, options.components);
        for (part, _) in parts.each().zip(&keep).filter(|(_, keep)| !**keep) {
            for &node in part {
                inside[lattice.index(graph.point(node as usize))] = false;
            }
        }
        drop(parts);
        if keep.contains(&false) {
            graph = make(&inside)?;
            let sizes = sizes.iter().zip(&keep).filter(|(_, keep)| !**keep);
            report.left_out = sizes.map(|(&size, _)| size).collect();
            report.left_out.sort_unstable_by(|a, b| b.cmp(a));
        }
        Self::of_graph(*lattice, &inside, graph, report, run)
    }

    /// Boundary, depths, skeleton and diameters of a graph.
    fn of_graph(
        lattice: Lattice,
        inside: &[bool],
        graph: VoxelGraph,
        mut report: ShapeReport,
        run: On<'_>,
    ) -> Result<Self, Error> {
        run.progress("shape", 2, STEPS)?;
        let counts = lattice.counts;
        let is_inside = |[i, j, k]: [i64; 3]| {
            let within = |x: i64, n: usize| x >= 0 && x < n as i64;
            within(i, counts[0])
                && within(j, counts[1])
                && within(k, counts[2])
                && inside[lattice.index([i as usize, j as usize, k as usize])]
        };
        // A node is of the boundary if it has a side to the outside.
        let boundary: Vec<u32> = parallel::flat_map(graph.nodes(), |node| {
            let p = graph.point(node).map(|c| c as i64);
            let faces_out = FACES.iter().any(|d| !is_inside(sum(p, *d)));
            faces_out.then_some(node as u32)
        });
        if boundary.len() < LEAST_BOUNDARY {
            return Err(Error::TooSmall {
                boundary: boundary.len(),
                least: LEAST_BOUNDARY,
            });
        }
        let normals = parallel::map_each(&boundary, |&node| {
            normal(graph.point(node as usize).map(|c| c as i64), &is_inside)
        });
        run.progress("shape", 3, STEPS)?;
        // How far the outside is; where that is most around lies the skeleton, and from there to the boundary go diameters.
        let squares = run.squared_distances(counts, inside)?;
        let depth = |point: [usize; 3]| squares[lattice.index(point)];
        let skeleton = skeleton(&graph, &depth, &is_inside);
        let position = |node: &u32| lattice.point(graph.point(*node as usize));
        let points: Vec<Point3> = boundary.iter().map(position).collect();
        let axes = PointTree::of_positions(&skeleton.iter().map(position).collect::<Vec<_>>())?;
        let diameters =
            parallel::map_each(&points, |p| axes.nearest(&[p.x, p.y, p.z], 1)[0].distance);
        let deepest = skeleton
            .iter()
            .map(|&n| depth(graph.point(n as usize)))
            .max();
        report.depth = f64::from(deepest.unwrap_or(0)).sqrt() * lattice.spacing;
        report.boundary_share = boundary.len() as f64 / graph.nodes() as f64;
        Ok(Self {
            lattice,
            graph,
            boundary,
            points,
            normals,
            skeleton,
            diameters,
            report,
            identity: 0,
        }
        .identified())
    }

    /// The lattice.
    pub fn lattice(&self) -> &Lattice {
        &self.lattice
    }

    /// The graph of the nodes.
    pub fn graph(&self) -> &VoxelGraph {
        &self.graph
    }

    /// Number of nodes.
    pub fn nodes(&self) -> usize {
        self.graph.nodes()
    }

    /// Where a node is, Å.
    pub fn position(&self, node: usize) -> Point3 {
        self.lattice.point(self.graph.point(node))
    }

    /// The boundary nodes, ascending.
    pub fn boundary(&self) -> &[u32] {
        &self.boundary
    }

    /// Where each boundary node is, Å.
    pub fn boundary_points(&self) -> &[Point3] {
        &self.points
    }

    /// The outward unit normal of each boundary node.
    pub fn normals(&self) -> &[Vector3] {
        &self.normals
    }

    /// The nodes that are at least as far from the outside as their 26 neighbours, and at least two spacings; the
    /// deepest nodes if there are none.
    pub fn skeleton(&self) -> &[u32] {
        &self.skeleton
    }

    /// The distance of each boundary node to the nearest node of the skeleton, Å: the "shape diameter" of Section
    /// 6.3.2, which is a radius.
    pub fn diameters(&self) -> &[f64] {
        &self.diameters
    }

    /// The volume of the nodes' cells, Å³.
    pub fn volume(&self) -> f64 {
        self.nodes() as f64 * self.lattice.spacing.powi(3)
    }

    /// What became of the points inside.
    pub fn report(&self) -> &ShapeReport {
        &self.report
    }

    /// The first `count` modes after the constant one (Eq. 6.2, see "Reading the thesis"): `(D − W) φ = λ D φ`. Of a shape
    /// in several parts the next ones are constant on each.
    ///
    /// # Errors
    /// [`Error::TooManyModes`], and what the solver says.
    pub fn modes<B: CorrespBackend + ?Sized>(
        &self,
        count: usize,
        run: Run<'_, B>,
    ) -> Result<Modes, Error> {
        self.modes_on(count, run.with(run.backend.as_corresp()))
    }

    pub(crate) fn modes_on(&self, count: usize, run: On<'_>) -> Result<Modes, Error> {
        let laplacian = Laplacian::of_voxels(self.graph.clone());
        let mut modes = modes(&laplacian, count, run)?;
        modes.vectors.iter_mut().for_each(|v| normalize(&mut [v]));
        Ok(modes)
    }

    /// The values of a mode at the boundary nodes.
    pub(crate) fn on_boundary(&self, mode: &[f64]) -> Vec<f64> {
        self.boundary.iter().map(|&n| mode[n as usize]).collect()
    }
}

/// Modes of a graph.
#[derive(Clone, Debug, PartialEq)]
pub struct Modes {
    /// Eigenvalues λ of the normalized Laplacian, ascending, in 0…2.
    pub values: Vec<f64>,
    /// A number per node; the largest in magnitude is 1. Within a cluster only the space is defined.
    pub vectors: Vec<Vec<f64>>,
    /// Runs of two or more modes whose eigenvalues differ by at most 1 %; the last one may go on beyond the last mode, as
    /// the report says.
    pub clusters: Vec<Range<usize>>,
    /// How they were found, and in how many connected parts the graph is.
    pub report: eigen::Report,
}

/// The first modes of a graph that are not constant on it.
pub(crate) fn modes(laplacian: &Laplacian, count: usize, run: On<'_>) -> Result<Modes, Error> {
    let nodes = laplacian.nodes();
    if count >= nodes {
        return Err(Error::TooManyModes {
            asked: count,
            nodes,
        });
    }
    let options = eigen::Options {
        tolerance: MODE_TOLERANCE,
        cluster_gap: CLUSTER_GAP,
        ..eigen::Options::default()
    };
    let mass: Mass = laplacian.degree_mass();
    let spectral = run.with(run.backend.as_spectral());
    let EigenPairs {
        mut values,
        mut vectors,
        clusters,
        report,
        ..
    } = eigenpairs(laplacian, &mass, count + 1, &options, spectral)?;
    // Nodes without neighbours have no part in any.
    if values.len() <= count {
        return Err(Error::TooManyModes {
            asked: count,
            nodes: nodes - report.isolated,
        });
    }
    values.remove(0);
    vectors.remove(0);
    // Without the constant, which may belong to a cluster of constants on parts.
    let shifted = clusters
        .into_iter()
        .map(|c| c.start.saturating_sub(1)..c.end - 1);
    Ok(Modes {
        values,
        vectors,
        clusters: shifted.filter(|c| c.len() > 1).collect(),
        report,
    })
}

/// Divides parts of one mode by their common largest magnitude.
pub(crate) fn normalize(parts: &mut [&mut Vec<f64>]) {
    let largest = parts.iter().flat_map(|p| p.iter());
    let largest = largest.fold(0.0f64, |m, x| m.max(x.abs()));
    if largest > 0.0 {
        let values = parts.iter_mut().flat_map(|p| p.iter_mut());
        values.for_each(|x| *x /= largest);
    }
}

/// The steps to the six neighbours across a face.
const FACES: [[i64; 3]; 6] = [
    [-1, 0, 0],
    [1, 0, 0],
    [0, -1, 0],
    [0, 1, 0],
    [0, 0, -1],
    [0, 0, 1],
];

fn sum(a: [i64; 3], b: [i64; 3]) -> [i64; 3] {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}

/// Which parts are kept.
fn kept(sizes: &[usize], components: Components) -> Vec<bool> {
    let largest = sizes.iter().copied().max().unwrap_or(0);
    match components {
        Components::All => vec![true; sizes.len()],
        Components::Largest => {
            let first = sizes.iter().position(|&s| s == largest);
            (0..sizes.len()).map(|i| Some(i) == first).collect()
        }
        Components::MinFraction(share) => {
            let enough = |&s: &usize| s as f64 >= share * largest as f64;
            sizes.iter().map(enough).collect()
        }
    }
}

/// Sets the flags of points outside that no path across faces joins to the border of the lattice, and counts them.
/// By a flood from the border inwards, in time of the number of points.
fn fill_cavities(counts: [usize; 3], inside: &mut [bool]) -> usize {
    let [nx, ny, nz] = counts;
    let at = |[i, j, k]: [usize; 3]| (k * ny + j) * nx + i;
    let mut open = inside.to_vec();
    let mut stack = Vec::new();
    for index in 0..open.len() {
        let p = [index % nx, index / nx % ny, index / (nx * ny)];
        let border = p[0] == 0 || p[1] == 0 || p[2] == 0;
        let border = border || p[0] + 1 == nx || p[1] + 1 == ny || p[2] + 1 == nz;
        if border && !open[index] {
            open[index] = true;
            stack.push(p);
        }
        while let Some(p) = stack.pop() {
            for axis in 0..3 {
                for step in [usize::MAX, 1] {
                    let mut q = p;
                    q[axis] = q[axis].wrapping_add(step);
                    if q[axis] < counts[axis] && !open[at(q)] {
                        open[at(q)] = true;
                        stack.push(q);
                    }
                }
            }
        }
    }
    let mut filled = 0;
    for (inside, open) in inside.iter_mut().zip(open) {
        if !open {
            *inside = true;
            filled += 1;
        }
    }
    filled
}

/// Away from the centroid of the nodes in a ball around a point; where that is the point itself (a sheet seen from its
/// middle), towards the faces that are outside.
fn normal(p: [i64; 3], is_inside: &impl Fn([i64; 3]) -> bool) -> Vector3 {
    let reach = -NORMAL_REACH..=NORMAL_REACH;
    let mut away = [0i64; 3];
    for dk in reach.clone() {
        for dj in reach.clone() {
            for di in reach.clone() {
                let d = [di, dj, dk];
                let near = di * di + dj * dj + dk * dk <= NORMAL_REACH * NORMAL_REACH;
                if near && is_inside(sum(p, d)) {
                    away = [0, 1, 2].map(|a| away[a] - d[a]);
                }
            }
        }
    }
    if away == [0; 3] {
        for d in FACES {
            if !is_inside(sum(p, d)) {
                away = sum(away, d);
            }
        }
    }
    let away = Vector3::from(away.map(|a| a as f64));
    // Outside on two opposite faces: any of them.
    away.try_normalize(0.0).unwrap_or_else(|| {
        let free = FACES.iter().find(|d| !is_inside(sum(p, **d)));
        free.map_or(Vector3::x(), |d| Vector3::from(d.map(|c| c as f64)))
    })
}

/// The nodes at least as deep as their 26 neighbours and at least two spacings deep; without any, the deepest ones.
fn skeleton(
    graph: &VoxelGraph,
    depth: &(impl Fn([usize; 3]) -> u32 + Sync),
    is_inside: &(impl Fn([i64; 3]) -> bool + Sync),
) -> Vec<u32> {
    let nodes = graph.nodes() as u32;
    let is_axis = |node: &u32| {
        let point = graph.point(*node as usize);
        let here = depth(point);
        here >= 4 && {
            let p = point.map(|c| c as i64);
            (0..27).all(|d: i64| {
                let q = sum(p, [d % 3 - 1, d / 3 % 3 - 1, d / 9 - 1]);
                !is_inside(q) || depth(q.map(|c| c as usize)) <= here
            })
        }
    };
    let found: Vec<u32> =
        parallel::flat_map(graph.nodes(), |node| Some(node as u32).filter(is_axis));
    if !found.is_empty() {
        return found;
    }
    let deep = |n: u32| depth(graph.point(n as usize));
    let deepest = (0..nodes).map(deep).max();
    (0..nodes).filter(|&n| Some(deep(n)) == deepest).collect()
}
