//! Shapes between two shapes (Section 6.5).
//!
//! A morph moves the nodes of the first shape. Some of them, the landmarks, are led to their images; the others follow
//! as rigidly as the graph allows. Each frame is a set of lattice points again, of a volume between those of both
//! shapes, and a grid whose level set is its surface; as those points lie on either side of it, the volume it encloses may
//! differ by some percent, and by more in thin bodies. It is the first shape moved forwards and the second one moved
//! backwards, the nearer the more, so that a morph ends at the second shape itself.

mod landmarks;
mod raster;
mod solve;

#[cfg(feature = "testing")]
#[doc(hidden)]
pub use solve::{distortion, rotations};

use geom_core::algebra::graph::VoxelGraph;
use geom_core::compute::parallel;
use geom_core::nalgebra::{Matrix3, Rotation3};
use geom_core::{Aabb, Lattice, LatticeValues, Point3, Run, ScalarGrid, Vector3};

use crate::Error;
use crate::backend::CorrespBackend;
use crate::correspond::{Correspondence, Embedding};
use crate::fit::{nearest_rotation, superpose};
use crate::options::{Landmarks, MorphOptions, Paths};
use crate::shape::{Parts, ROOT, VoxelShape};
use solve::Solver;

/// Rounds of the as-rigid-as-possible method where all of the boundary is led, and where few nodes are.
const ROUNDS: [usize; 2] = [10, 60];
/// Relative fall of its energy that ends it.
const SETTLED: f64 = 1e-4;
/// How much the rotation of a neighbour counts where a neighbourhood leaves its own open.
/// Small enough that it decides only where nothing else does.
const LEAN: f64 = 1e-2;

/// A way from one shape to another.
///
/// ```
/// use spectral_corresp::geom_core::{Cpu, Lattice, Point3, Run};
/// use spectral_corresp::{MatchOptions, Morph, MorphOptions, ShapeOptions, Start, VoxelShape, correspond};
/// let lattice = Lattice { origin: Point3::origin(), spacing: 1.5, counts: [10, 6, 6] };
/// let body = VoxelShape::of_flags(&lattice, vec![true; 360], &ShapeOptions::default(), Run::on(&Cpu))?;
/// let itself = (0..body.boundary().len() as u32).collect();
/// let options = MatchOptions { start: Start::Given(itself), ..MatchOptions::default() };
/// let run = Run::on(&Cpu);
/// let found = correspond(&body, &body, &options, run)?;
/// let morph = Morph::new(&body, &body, &found, &MorphOptions::default(), run)?;
/// let frame = morph.frame(0.5, run)?;
/// assert_eq!(frame.flags.iter().filter(|f| **f).count(), 360);
/// # Ok::<(), spectral_corresp::Error>(())
/// ```
pub struct Morph {
    lattice: Lattice,
    graph: VoxelGraph,
    rest: Vec<Point3>,
    target: Vec<Point3>,
    /// Volumes of both shapes, Å³.
    volumes: [f64; 2],
    landmarks: Vec<u32>,
    ways: Ways,
    /// From the second shape to the first.
    back: Option<Box<Morph>>,
    options: MorphOptions,
    report: MorphReport,
}

/// What a frame is made with.
enum Ways {
    Linear(Solver),
    Rotating(Box<Rotating>),
}

/// All that a frame needs but its time: one system with one node held in each part serves all frames.
struct Rotating {
    parts: Parts,
    solver: Solver,
    /// Logarithms of the nodes' rotations.
    logarithms: Vec<Vector3>,
    rotations: Vec<Matrix3<f64>>,
}

impl Rotating {
    fn of(
        graph: &VoxelGraph,
        parts: Parts,
        rest: &[Point3],
        target: &[Point3],
        solver: Solver,
    ) -> Self {
        let logarithms = logarithms(graph, &parts, rest, target);
        let rotation = |l: &Vector3| Rotation3::new(*l).into_inner();
        Self {
            rotations: logarithms.iter().map(rotation).collect(),
            logarithms,
            solver,
            parts,
        }
    }
}

/// How the images of all nodes were found.
#[derive(Clone, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct MorphReport {
    /// Nodes that are led.
    pub landmarks: usize,
    /// Nodes that follow.
    pub followers: usize,
    /// Rounds of the as-rigid-as-possible method for the images.
    pub rounds: usize,
    /// Were all systems solved by factors?
    pub factored: bool,
}

/// A shape on the way.
#[derive(Clone, Debug, PartialEq)]
pub struct Frame {
    /// Where the nodes of the first shape are, Å.
    pub positions: Vec<Point3>,
    /// A grid, larger inside.
    pub grid: ScalarGrid,
    /// The value on the surface.
    pub level: f64,
    /// Which points of the grid lie inside.
    pub flags: Vec<bool>,
    /// Measures.
    pub report: FrameReport,
}

/// Measures of a frame.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct FrameReport {
    /// The time: 0 at the first shape, 1 at the second.
    pub time: f64,
    /// The volume of the points inside, Å³.
    pub volume: f64,
    /// The volume that was asked for: between those of the shapes, beyond them that of the nearer one, Å³.
    pub wanted_volume: f64,
    /// The longest an edge of the graph has become, over its length at rest.
    pub largest_stretch: f64,
    /// The shortest.
    pub smallest_stretch: f64,
    /// The share of edges that are longer or shorter by more than 30 %.
    pub strained: f64,
    /// The share of nodes that lie where others do that were far from them.
    pub self_overlap: f64,
}

impl Morph {
    /// From `a` to `b` by their correspondence. Stays on the CPU; `run` watches.
    ///
    /// # Errors
    /// [`Error::Direction`] and [`Error::Length`] for a correspondence of other shapes, [`Error::NotFinite`] for an
    /// image that is no place, [`Error::Landmark`], options out of range, systems that are not solved.
    pub fn new<B: CorrespBackend + ?Sized>(
        a: &VoxelShape,
        b: &VoxelShape,
        found: &Correspondence,
        options: &MorphOptions,
        run: Run<'_, B>,
    ) -> Result<Self, Error> {
        options.check()?;
        check(a, b, found)?;
        run.progress("images", 0, 2)?;
        let there = Led {
            images: found.images.clone(),
            rotations: found.rotations.clone(),
        };
        let mut morph = Self::led(a, b, &there, options)?;
        run.progress("images", 1, 2)?;
        if options.two_way {
            let mut turned = options.clone();
            if let Landmarks::Custom(given) = &mut turned.landmarks {
                *given = landmarks::turned(given, a, b)?;
            }
            let back = Self::led(b, a, &turned_round(b, found, a), &turned)?;
            morph.back = Some(Box::new(back));
        }
        run.progress("images", 2, 2)?;
        Ok(morph)
    }

    /// One way of it: images of all nodes by the boundary, landmarks, and what frames are made with.
    fn led(
        a: &VoxelShape,
        b: &VoxelShape,
        found: &Led,
        options: &MorphOptions,
    ) -> Result<Self, Error> {
        let graph = a.graph().clone();
        let rest: Vec<Point3> = (0..a.nodes()).map(|i| a.position(i)).collect();
        let parts = Parts::of(&graph);
        let (mut target, mut rounds, mut factored) = dense_images(a, found, &rest, options)?;
        let leading = |landmarks: &[u32]| {
            Solver::new(&graph, &held(rest.len(), landmarks), options.direct_nodes)
        };
        // Of all nodes but one in each part, where only the shape of the motion is asked for.
        let loose = || {
            let roots: Vec<u32> = parts.roots().collect();
            leading(&roots)
        };

        // By default the boundary leads, and its images are known. Fewer landmarks lead the rest anew.
        let mut all_free = None;
        let landmarks = match &options.landmarks {
            Landmarks::Boundary => a.boundary().to_vec(),
            Landmarks::Harmonic { radius } => {
                let solver = all_free.insert(loose()?);
                factored &= solver.direct;
                let found = landmarks::harmonic(&graph, &rest, &parts, *radius, solver)?;
                completed(found, &parts)
            }
            Landmarks::Custom(given) => completed(custom(given, &mut target)?, &parts),
        };
        let mut led = None;
        if options.landmarks != Landmarks::Boundary {
            let solver = led.insert(leading(&landmarks)?);
            rounds += solver.relax(&graph, &rest, &mut target, ROUNDS[1], SETTLED)?;
            factored &= solver.direct;
        }

        // Straight ways need the places of the landmarks; turning ones the rotation of every node.
        let ways = match options.paths {
            Paths::Linear => Ways::Linear(led.map_or_else(|| leading(&landmarks), Ok)?),
            Paths::Rotating => {
                let solver = all_free.map_or_else(loose, Ok)?;
                factored &= solver.direct;
                let turning = Rotating::of(&graph, parts, &rest, &target, solver);
                Ways::Rotating(Box::new(turning))
            }
        };
        let report = MorphReport {
            landmarks: landmarks.len(),
            followers: rest.len() - landmarks.len(),
            rounds,
            factored,
        };
        Ok(Self {
            lattice: *a.lattice(),
            volumes: [a.volume(), b.volume()],
            graph,
            rest,
            target,
            landmarks,
            ways,
            back: None,
            options: options.clone(),
            report,
        })
    }

    /// Where all nodes of the first shape are in the second, Å.
    pub fn target(&self) -> &[Point3] {
        &self.target
    }

    /// The nodes that are led, ascending.
    pub fn landmarks(&self) -> &[u32] {
        &self.landmarks
    }

    /// How the images of all nodes were found.
    pub fn report(&self) -> &MorphReport {
        &self.report
    }

    /// Where all nodes of the first shape are at a time, Å; before 0 and after 1 the motion goes on.
    /// The ends are exact.
    ///
    /// # Errors
    /// [`Error::Time`] for a time that is no number or beyond ±10, [`Error::NotSolved`].
    pub fn at(&self, t: f64) -> Result<Vec<Point3>, Error> {
        if t == 0.0 {
            return Ok(self.rest.clone());
        }
        if t == 1.0 {
            return Ok(self.target.clone());
        }
        // Ten times the way from one shape to the other: numbers stay far from where lattices overflow.
        const FARTHEST: f64 = 10.0;
        if !(-FARTHEST..=FARTHEST).contains(&t) {
            return Err(Error::Time { time: t });
        }
        let between = self.rest.iter().zip(&self.target);
        let mut positions: Vec<Point3> = between.map(|(a, b)| a + (b - a) * t).collect();
        match &self.ways {
            Ways::Linear(solver) => {
                let most = ROUNDS[usize::from(self.options.landmarks != Landmarks::Boundary)];
                solver.relax(&self.graph, &self.rest, &mut positions, most, SETTLED)?;
            }
            Ways::Rotating(way) => self.rotated(way, t, &mut positions)?,
        }
        Ok(positions)
    }

    /// Each node turns its edges by the share `t` of its rotation and stretches them by the share `t` of what is left:
    /// at the ends this is exact, and a rigid motion stays one.
    fn rotated(&self, way: &Rotating, t: f64, positions: &mut [Point3]) -> Result<(), Error> {
        let turn = |l: &Vector3| Rotation3::new(l * t).into_inner();
        let turned: Vec<Matrix3<f64>> = parallel::map_each(&way.logarithms, turn);
        let rhs = |i: usize| {
            let edge = |(j, w): (usize, f64)| {
                let (p, x) = (self.rest[i] - self.rest[j], self.target[i] - self.target[j]);
                let own = |k: usize| turned[k] * (p * (1.0 - t) + way.rotations[k].tr_mul(&x) * t);
                (own(i) + own(j)) * (0.5 * w)
            };
            self.graph.around(i).map(edge).sum()
        };
        way.solver.solve(&self.graph, rhs, positions)?;
        way.parts.center(positions, &self.rest, &self.target, t);
        Ok(())
    }

    /// The shape at a time as lattice points and as a grid in step with that of the nearer shape. Of the low-passed marks of nodes and edges, the largest are
    /// inside, as many as the volume at that time takes.
    ///
    /// # Errors
    /// Those of [`at`](Self::at), and [`Error::TooLarge`] for a lattice that takes more than
    /// [`MorphOptions::max_memory`].
    pub fn frame<B: CorrespBackend + ?Sized>(
        &self,
        t: f64,
        run: Run<'_, B>,
    ) -> Result<Frame, Error> {
        run.progress("frame", 0, 2)?;
        let positions = self.at(t)?;
        run.progress("frame", 1, 2)?;
        // Exact at both ends: in step with the shape that is nearer.
        let (share, back) = match &self.back {
            Some(back) => (t.clamp(0.0, 1.0), back.as_ref()),
            None => (0.0, self),
        };
        let behind = if share > 0.0 {
            back.at(1.0 - t)?
        } else {
            Vec::new()
        };
        let step = if share < 0.5 { self } else { back };
        let limit = self.options.max_memory;
        let lattice = raster::lattice_of(&step.lattice, &[&positions, &behind], limit)?;
        let mut marks = vec![0.0; lattice.len()];
        raster::mark(&lattice, &self.graph, &positions, 1.0 - share, &mut marks);
        raster::mark(&lattice, &back.graph, &behind, share, &mut marks);
        let values = raster::low_passed(&lattice, marks, self.options.sigma);
        let grid = ScalarGrid::new(lattice, values)?;
        let [from, to] = self.volumes;
        let wanted_volume = from + (to - from) * t.clamp(0.0, 1.0);
        let cell = lattice.spacing.powi(3);
        let (flags, level) = raster::largest(&grid, (wanted_volume / cell).round() as usize);
        let inside = flags.iter().filter(|f| **f).count();
        let report = FrameReport {
            time: t,
            volume: inside as f64 * cell,
            wanted_volume,
            ..raster::measured(&lattice, &self.graph, &self.rest, &positions)
        };
        run.progress("frame", 2, 2)?;
        Ok(Frame {
            positions,
            grid,
            level,
            flags,
            report,
        })
    }
}

impl Frame {
    /// How far the points inside are from those of the real shape, on the frame's lattice continued over `bounds`, which hold
    /// the real shape. `inside` says which of some points lie in it. Bounds that reach over more than 4 GiB of lattice points, at
    /// 32 bytes each, are an error.
    pub fn overlap<E: From<Error>>(
        &self,
        bounds: &Aabb,
        inside: impl FnOnce(&[Point3]) -> Result<Vec<bool>, E>,
    ) -> Result<Overlap, E> {
        let lattice = self.grid.lattice();
        let low = lattice
            .local(&bounds.min)
            .map(|c| (c.floor() as i64).min(0));
        let high = lattice.local(&bounds.max).map(|c| c.ceil() as i64);
        let high = [0, 1, 2].map(|a| high[a].max(lattice.counts[a] as i64 - 1));
        const LIMIT: u64 = 4 << 30;
        let count = |a: usize| (i128::from(high[a]) - i128::from(low[a]) + 1) as u128;
        let count = (0..3).fold(1u128, |all, a| all.saturating_mul(count(a)));
        let bytes = count.saturating_mul(32);
        if bytes > u128::from(LIMIT) {
            let limit = LIMIT;
            return Err(Error::TooLarge {
                points: count,
                bytes,
                limit,
            }
            .into());
        }
        let (mut points, mut ours) = (Vec::new(), Vec::new());
        for k in low[2]..=high[2] {
            for j in low[1]..=high[1] {
                for i in low[0]..=high[0] {
                    let p = [i, j, k];
                    let at = [0, 1, 2].map(|a| lattice.origin[a] + lattice.spacing * p[a] as f64);
                    points.push(Point3::from(at));
                    let within = (0..3).all(|a| p[a] >= 0 && p[a] < lattice.counts[a] as i64);
                    ours.push(within && self.flags[lattice.index(p.map(|c| c as usize))]);
                }
            }
        }
        Ok(Overlap::of(&inside(&points)?, &ours)?)
    }
}

fn check(a: &VoxelShape, b: &VoxelShape, found: &Correspondence) -> Result<(), Error> {
    found.backward.check(b, a)?;
    let expected = a.boundary().len();
    let lengths = [
        ("images in the correspondence", found.images.len()),
        ("rotations in the correspondence", found.rotations.len()),
    ];
    for (what, found) in lengths {
        if found != expected {
            return Err(Error::Length {
                what,
                found,
                expected,
            });
        }
    }
    match found
        .images
        .iter()
        .position(|p| !p.iter().all(|c| c.is_finite()))
    {
        Some(point) => Err(Error::NotFinite { point }),
        None => Ok(()),
    }
}

/// Where the boundary of a shape goes.
struct Led {
    images: Vec<Point3>,
    rotations: Vec<Matrix3<f64>>,
}

/// The same for the second shape: a node goes with the one of the first that met it.
fn turned_round(b: &VoxelShape, found: &Correspondence, a: &VoxelShape) -> Led {
    let met = b.boundary_points().iter().zip(&found.backward);
    let led = met.map(|(y, &i)| {
        let i = i as usize;
        let turn = found.rotations[i].transpose();
        (a.boundary_points()[i] + turn * (y - found.images[i]), turn)
    });
    let (images, rotations) = led.unzip();
    Led { images, rotations }
}

fn held(nodes: usize, landmarks: &[u32]) -> Vec<bool> {
    let mut held = vec![false; nodes];
    landmarks.iter().for_each(|&i| held[i as usize] = true);
    held
}

/// Where all nodes go if all of the boundary goes to its images; how many rounds that took, and whether by a factor.
fn dense_images(
    a: &VoxelShape,
    found: &Led,
    rest: &[Point3],
    options: &MorphOptions,
) -> Result<(Vec<Point3>, usize, bool), Error> {
    let embedding = Embedding::new(a.boundary_points(), &found.images, &found.rotations)?;
    let mut images = embedding.of(rest);
    for (&node, image) in a.boundary().iter().zip(&found.images) {
        images[node as usize] = *image;
    }
    let held = held(rest.len(), a.boundary());
    let solver = Solver::new(a.graph(), &held, options.direct_nodes)?;
    let rounds = solver.relax(a.graph(), rest, &mut images, ROUNDS[0], SETTLED)?;
    Ok((images, rounds, solver.direct))
}

/// Puts given landmarks to their images.
fn custom(given: &[(u32, Point3)], target: &mut [Point3]) -> Result<Vec<u32>, Error> {
    for &(node, image) in given {
        let count = target.len();
        let place = target
            .get_mut(node as usize)
            .filter(|_| image.iter().all(|c| c.is_finite()));
        *place.ok_or(Error::Landmark { node, count })? = image;
    }
    let mut nodes: Vec<u32> = given.iter().map(|g| g.0).collect();
    nodes.sort_unstable();
    nodes.dedup();
    Ok(nodes)
}

/// With the first node of each part that has no landmark.
fn completed(mut landmarks: Vec<u32>, parts: &Parts) -> Vec<u32> {
    let led = held(parts.order.len(), &landmarks);
    let bare = parts
        .each()
        .filter(|part| !part.iter().any(|&i| led[i as usize]));
    landmarks.extend(bare.map(|part| part[0]));
    landmarks.sort_unstable();
    landmarks
}

/// The logarithm of each node's rotation: of those that differ by whole turns, the one nearest to that of the node it
/// was reached from. A neighbourhood that leaves its rotation open, such as one on a line, turns with that node.
fn logarithms(
    graph: &VoxelGraph,
    parts: &Parts,
    rest: &[Point3],
    target: &[Point3],
) -> Vec<Vector3> {
    let own = |i: usize| solve::covariance(graph, rest, target, i);
    let single: Vec<Matrix3<f64>> = parallel::map(rest.len(), own);
    let mut logarithms = vec![Vector3::zeros(); rest.len()];
    let mut rotations = vec![Matrix3::identity(); rest.len()];
    for part in parts.each() {
        let pairs: Vec<(Point3, Point3)> = part
            .iter()
            .map(|&i| (rest[i as usize], target[i as usize]))
            .collect();
        let whole = superpose(&pairs).rotation;
        for &node in part {
            let i = node as usize;
            let parent = parts.parent[i];
            let (turn, logarithm) = if parent == ROOT {
                (whole, Rotation3::from_matrix_unchecked(whole).scaled_axis())
            } else {
                (rotations[parent as usize], logarithms[parent as usize])
            };
            // With its neighbours' own, so that rotations change little from node to node.
            let s: Matrix3<f64> = single[i]
                + graph
                    .around(i)
                    .map(|(j, w)| single[j] * w)
                    .sum::<Matrix3<f64>>();
            rotations[i] = nearest_rotation(&(s + turn * (LEAN * s.norm())));
            logarithms[i] = nearest_logarithm(&rotations[i], &logarithm);
        }
    }
    logarithms
}

/// Without an axis of its own, as near the identity, it takes that of the other.
fn nearest_logarithm(rotation: &Matrix3<f64>, to: &Vector3) -> Vector3 {
    let least = Rotation3::from_matrix_unchecked(*rotation).scaled_axis();
    let axis = least
        .try_normalize(1e-12)
        .or_else(|| to.try_normalize(1e-12));
    let Some(axis) = axis else { return least };
    let turn = std::f64::consts::TAU;
    let more = ((to - least).dot(&axis) / turn).round();
    least + axis * (more * turn)
}

/// How two sets of lattice points differ.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct Overlap {
    /// ε_V: points in one of them only, over points of the real one (Eq. 6.17).
    pub epsilon: f64,
    /// Dice's coefficient: twice the common points over those of both.
    pub dice: f64,
    /// Points of the approximated one over those of the real one.
    pub volume_ratio: f64,
}

impl Overlap {
    /// Of flags on one lattice.
    ///
    /// ```
    /// use spectral_corresp::morph::Overlap;
    /// let found = Overlap::of(&[true, true, false], &[false, true, true])?;
    /// assert_eq!((found.epsilon, found.dice, found.volume_ratio), (1.0, 0.5, 1.0));
    /// # Ok::<(), spectral_corresp::Error>(())
    /// ```
    pub fn of(real: &[bool], approximated: &[bool]) -> Result<Self, Error> {
        if real.len() != approximated.len() {
            return Err(Error::Length {
                what: "flags of the approximated shape",
                found: approximated.len(),
                expected: real.len(),
            });
        }
        let count = |of: &dyn Fn(bool, bool) -> bool| {
            let pairs = real.iter().zip(approximated);
            pairs.filter(|&(&r, &a)| of(r, a)).count() as f64
        };
        let (inside, other) = (count(&|r, _| r), count(&|_, a| a));
        if inside == 0.0 {
            return Err(Error::Empty { largest: 0.0 });
        }
        Ok(Self {
            epsilon: count(&|r, a| r != a) / inside,
            dice: 2.0 * count(&|r, a| r && a) / (inside + other),
            volume_ratio: other / inside,
        })
    }
}
