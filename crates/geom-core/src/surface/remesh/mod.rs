//! Isotropic remeshing of triangle surfaces: edges of a wanted length, triangles near equilateral.
//!
//! [`remesh`] repeats four steps (Botsch and Kobbelt, *A remeshing approach to multiresolution
//! modeling*, 2004): split edges longer than 4/3 of the wanted length, contract edges shorter than
//! 4/5 of it, flip edges towards even valences and larger angles, and move each vertex within its
//! tangent plane and back to the surface. It follows the level set of a field where one is given,
//! else the input mesh. The wanted length is the same everywhere or adapts to the curvature
//! (Dunyach et al., *Adaptive remeshing for real-time mesh deformation*, 2013).
//!
//! Every step is tested before it is done: the surface stays a manifold of the same topology (link
//! condition), no triangle turns away from the surface's normal, and features, boundaries and
//! their corners stay. Topology changes run in a fixed order and moves colour by colour, so the
//! result has the same bits for any number of threads.

mod mesh;
mod reference;
mod refine;
mod steps;
#[cfg(test)]
mod tests;

use crate::mesh::TriangleReport;
use crate::mesh::quality::edge_lengths;
use crate::options::{OutOfRange, require};
use crate::surface::distance::DistanceError;
use crate::{Backend, Cancelled, ImplicitField, MeshError, Run, TriMesh};

use mesh::Mesh;
use reference::Reference;

/// How often the work begins anew where parts of the surface were lost.
const RESTARTS: usize = 1;

/// How long the edges shall be.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[non_exhaustive]
pub enum Sizing {
    /// The same everywhere.
    Uniform {
        /// Edge length, Å; `None` for the mean of the input's edges.
        edge_length: Option<f64>,
    },
    /// As long as the chords may be: an edge of length √(6 ε/κ − 3 ε²) stays within ε of a surface
    /// of curvature κ.
    Curvature {
        /// Allowed distance ε between triangles and surface, Å.
        tolerance: f64,
        /// Shortest wanted edge, Å.
        min_edge: f64,
        /// Longest wanted edge, Å.
        max_edge: f64,
        /// Growth of the wanted length per Å of way along the surface; 0.2…0.5 keeps triangles good.
        gradation: f64,
    },
}

/// Which edges stay, besides the boundary.
#[derive(Clone, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[non_exhaustive]
pub enum Features {
    /// None: the surface is smooth, and what looks like an edge is noise.
    #[default]
    None,
    /// Those where the normals of the two triangles differ by more than this many degrees.
    Angle(f64),
    /// These, as pairs of vertices of the input.
    Edges(Vec<[u32; 2]>),
}

/// What surface to make.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Options {
    /// Wanted edge lengths.
    pub sizing: Sizing,
    /// Edges to keep. Boundaries are always kept.
    pub features: Features,
    /// A label per triangle of the input, or empty. The lines where labels meet are kept, zigzags
    /// shorter than the edges excepted, and the result's triangles have the labels of those they
    /// come from.
    pub labels: Vec<u32>,
    /// The surface is where the field has this value; without a field it is not used.
    pub level: f64,
    /// Most rounds of split, contract, flip and move; fewer when nothing changes any more.
    pub iterations: usize,
    /// After the rounds, triangles with a smaller angle than this many degrees are worked on.
    pub min_angle_deg: f64,
    /// Largest distance between the result and the surface, both ways, Å. `None` for 0.3 of a uniform
    /// edge length or twice the tolerance of [`Sizing::Curvature`]; infinite for no bound.
    pub max_deviation: Option<f64>,
    /// Where angles or distances miss these goals after the rounds, the surface is too narrow or too
    /// curved for the wanted edges: this often they become shorter there, down to 1/16 of a uniform
    /// length or to `min_edge`. 0 for edges as wanted everywhere.
    pub refinements: usize,
    /// More triangles than this are refused before the work starts.
    pub max_triangles: usize,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            sizing: Sizing::Uniform { edge_length: None },
            features: Features::None,
            labels: Vec::new(),
            level: 1.0,
            iterations: 10,
            min_angle_deg: 30.0,
            max_deviation: None,
            refinements: 6,
            max_triangles: 50_000_000,
        }
    }
}

impl Options {
    /// Are all numbers in their ranges?
    pub fn check(&self) -> Result<(), Error> {
        let positive = |option, value: f64| {
            let holds = value.is_finite() && value > 0.0;
            require(holds, option, value, "be a positive number")
        };
        match self.sizing {
            Sizing::Uniform {
                edge_length: Some(length),
            } => positive("edge_length", length)?,
            Sizing::Uniform { edge_length: None } => {}
            Sizing::Curvature {
                tolerance,
                min_edge,
                max_edge,
                gradation,
            } => {
                positive("tolerance", tolerance)?;
                positive("min_edge", min_edge)?;
                positive("gradation", gradation)?;
                let holds = max_edge.is_finite() && max_edge >= min_edge;
                require(
                    holds,
                    "max_edge",
                    max_edge,
                    "be a number that is not below min_edge",
                )?;
                // A length is spread as the way along which it would grow from nothing.
                let holds = (max_edge / gradation).is_finite();
                let must = "be so large that max_edge / gradation is a finite number";
                require(holds, "gradation", gradation, must)?;
            }
        }
        if let Features::Angle(angle) = self.features {
            let holds = angle > 0.0 && angle <= 180.0;
            require(
                holds,
                "features",
                angle,
                "be an angle above 0° and at most 180°",
            )?;
        }
        require(
            self.level.is_finite(),
            "level",
            self.level,
            "be a finite number",
        )?;
        if let Some(value) = self.max_deviation {
            let must = "be a positive number, or infinite for no bound";
            require(value > 0.0, "max_deviation", value, must)?;
        }
        let holds = (0.0..60.0).contains(&self.min_angle_deg);
        let must = "be an angle from 0° to below 60°";
        require(holds, "min_angle_deg", self.min_angle_deg, must)?;
        Ok(())
    }
}

/// Why a surface cannot be remeshed.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The mesh has no triangles.
    #[error("the mesh has no triangles")]
    Empty,
    /// The mesh is no oriented manifold.
    #[error("{0}; geom_core::surface::repair::repair can cure that")]
    NotManifold(#[from] MeshError),
    /// A triangle without area has no normal to follow.
    #[error(
        "triangle {triangle} has no area; geom_core::surface::repair::repair drops such triangles"
    )]
    Degenerate {
        /// The first such triangle.
        triangle: usize,
    },
    /// The square of a triangle's area is no finite number.
    #[error("triangle {triangle} is too large to be measured; scale the mesh down")]
    TooLarge {
        /// The first such triangle.
        triangle: usize,
    },
    /// The wanted lengths cannot be spread over the surface.
    #[error(transparent)]
    Distance(#[from] DistanceError),
    /// An option is out of its range.
    #[error(transparent)]
    Option(#[from] OutOfRange),
    /// An edge to keep is no edge of the mesh.
    #[error("feature {feature} joins vertices {from} and {to}, which no edge of the mesh does")]
    NoSuchEdge {
        /// Which of [`Features::Edges`].
        feature: usize,
        /// One vertex.
        from: u32,
        /// The other.
        to: u32,
    },
    /// Not one label per triangle.
    #[error("{labels} labels for {triangles} triangles; give one per triangle or none")]
    Labels {
        /// Number of labels.
        labels: usize,
        /// Number of triangles.
        triangles: usize,
    },
    /// The wanted edges are too short for the memory granted.
    #[error(
        "the wanted edges make about {estimate} triangles, more than max_triangles = {limit}; \
         ask for longer edges or allow more"
    )]
    TooMany {
        /// Expected number of triangles.
        estimate: u64,
        /// [`Options::max_triangles`].
        limit: usize,
    },
    /// The watcher asked to stop.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
}

/// How long the edges are, in units of what [`Options::sizing`] wants there. Each edge counts once.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct RelativeLengths {
    /// Shortest.
    pub min: f64,
    /// One in a hundred is shorter.
    pub percent_1: f64,
    /// Half are shorter.
    pub median: f64,
    /// One in a hundred is longer.
    pub percent_99: f64,
    /// Longest.
    pub max: f64,
    /// Share of the edges from 4/5 to 4/3, which are neither split nor contracted.
    pub within: f64,
}

/// Distances from the surface to follow, Å.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Deviation {
    /// Mean.
    pub mean: f64,
    /// Largest.
    pub max: f64,
}

/// Why a triangle stays below [`Options::min_angle_deg`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[non_exhaustive]
pub enum Cause {
    /// The angle lies between two kept edges that the input has so.
    KeptEdges,
    /// The level set and the input disagree here, as on necks and tunnels that only one of them has.
    OffLevel,
    /// The surface is folded so sharply that the triangle cannot face as its corners do.
    Fold,
    /// The surface is narrower than the shortest edges allowed here.
    Narrow,
    /// Nothing that was tried helped.
    NothingHelped,
}

/// A triangle below [`Options::min_angle_deg`].
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Exception {
    /// Which triangle of the result.
    pub triangle: u32,
    /// Its smallest angle, degrees.
    pub angle_deg: f64,
    /// Why.
    pub cause: Cause,
}

/// What was done, and what came of it.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Report {
    /// The input.
    pub before: TriangleReport,
    /// The result.
    pub after: TriangleReport,
    /// Rounds done.
    pub iterations: usize,
    /// Edges split.
    pub splits: usize,
    /// Edges contracted.
    pub contractions: usize,
    /// Edges flipped.
    pub flips: usize,
    /// How often edges were made shorter where a goal was missed.
    pub refinements: usize,
    /// Share of the result's vertices where edges are now wanted shorter than [`Options::sizing`] says.
    pub shortened: f64,
    /// Lengths of the result's edges.
    pub lengths: RelativeLengths,
    /// Edges of the result that are kept: features and boundaries.
    pub feature_edges: usize,
    /// From the result's vertices to the level set, or to the input mesh where that is nearer.
    pub vertex_deviation: Deviation,
    /// From the middles of the result's edges and triangles to the same.
    pub inner_deviation: Deviation,
    /// From the surface to the result: the largest distance of the input's vertices and middles of edges
    /// and triangles, after their way to the level set.
    pub reverse_deviation: f64,
    /// What [`Options::max_deviation`] allowed.
    pub allowed_deviation: f64,
    /// Vertices farther from the level set than a hundredth of the wanted edge length: they lie on
    /// necks, tunnels and pieces of the input that the level set has not, and follow the input there.
    pub off_level: usize,
    /// The triangles below [`Options::min_angle_deg`], with the cause.
    pub exceptions: Vec<Exception>,
    /// Did the last round change less than one edge in a hundred, are all angles at least
    /// [`Options::min_angle_deg`] and all distances within what is allowed?
    pub converged: bool,
}

/// A remeshed surface.
#[derive(Clone, Debug, PartialEq)]
pub struct Remeshed {
    /// The surface.
    pub mesh: TriMesh,
    /// The label of each triangle, if the input had labels.
    pub labels: Vec<u32>,
    /// Measures before and after.
    pub report: Report,
}

/// A surface of good triangles in place of `mesh`, with edges as `options` want them. Vertices lie
/// on the level set of `field` where one is given, else on `mesh`; also there where the level set is
/// farther than an edge or faces another way, since the topology is that of `mesh`.
///
/// ```
/// use geom_core::{Cpu, Run, mesh::shapes};
/// use geom_core::surface::remesh::{Options, Sizing, remesh};
/// let torus = shapes::torus(3.0, 1.0, 40, 12);
/// let options = Options {
///     sizing: Sizing::Uniform { edge_length: Some(0.3) },
///     ..Options::default()
/// };
/// let result = remesh(torus, None, &options, Run::on(&Cpu))?;
/// assert_eq!(result.mesh.euler_characteristic(), 0);
/// assert!(result.report.after.min_angle_deg > 25.0);
/// # Ok::<(), geom_core::surface::remesh::Error>(())
/// ```
///
/// # Errors
/// [`Error`] names the option or the element that is at fault.
pub fn remesh(
    mesh: TriMesh,
    field: Option<&dyn ImplicitField>,
    options: &Options,
    run: Run<'_, impl Backend + ?Sized>,
) -> Result<Remeshed, Error> {
    options.check()?;
    if mesh.triangles().is_empty() {
        return Err(Error::Empty);
    }
    for triangle in 0..mesh.triangles().len() {
        let doubled_area = mesh.doubled_area_normal(triangle).norm_squared();
        if doubled_area == 0.0 {
            return Err(Error::Degenerate { triangle });
        }
        let longest = edge_lengths(mesh.corners(triangle))
            .into_iter()
            .fold(0.0, f64::max);
        if !(doubled_area.is_finite() && longest.is_finite()) {
            return Err(Error::TooLarge { triangle });
        }
    }
    let before = TriangleReport::of(&mesh);
    let triangles = mesh.triangles().len();
    let labels = match options.labels.len() {
        0 => vec![0; triangles],
        n if n == triangles => options.labels.clone(),
        labels => return Err(Error::Labels { labels, triangles }),
    };
    let mut work = Mesh::new(&mesh, labels)?;
    let mut reference = Reference::new(mesh, field, options, &mut work)?;
    let goal = options.min_angle_deg.to_radians();
    let points = reference.points();
    let (mut counts, mut settled, mut iterations, mut refinements) = <_>::default();
    let start = work.clone();
    for attempt in 0..=RESTARTS {
        (settled, iterations) = rounds(&mut work, &reference, options, run, &mut counts)?;
        counts += steps::lift(&mut work, &reference, goal);
        for stage in 0..options.refinements {
            run.progress("refine", stage as u64, options.refinements as u64)?;
            if refine::shorten(&mut work, &mut reference, &points, goal) == 0 {
                break;
            }
            refinements += 1;
            counts += steps::round(&mut work, &reference);
            counts += steps::round(&mut work, &reference);
            counts += steps::round(&mut work, &reference);
            steps::settle(&mut work, &reference);
            counts += steps::lift(&mut work, &reference, goal);
        }
        // What has been cut off does not grow again, but now it is known where edges must be short.
        let lost = || {
            let farthest = refine::farthest_from(&work.surface(), &reference, &points);
            farthest > reference.allowed
        };
        if attempt == RESTARTS || refinements == 0 || !lost() {
            break;
        }
        work = start.clone();
        reference.spots.renew();
        refine::apply(&mut work, &reference);
        counts = steps::Counts::default();
    }
    let feature_edges = work.edges().filter(|&h| work.is_feature(h)).count();
    let lengths = relative_lengths(&work);
    let alive = (0..work.vertices.len() as u32).filter(|&v| work.is_alive(v));
    let shorter = alive.clone().filter(|&v| {
        let vertex = &work.vertices[v as usize];
        vertex.size < vertex.wanted
    });
    let shortened = shorter.count() as f64 / alive.count() as f64;
    let exceptions = refine::exceptions(&work, &reference, goal);
    let mesh = work.surface();
    let labels = if options.labels.is_empty() {
        Vec::new()
    } else {
        work.living_labels()
    };
    let (vertex_deviation, inner_deviation) = reference.deviations(&mesh);
    let reverse_deviation = refine::farthest_from(&mesh, &reference, &points);
    let allowed_deviation = reference.allowed;
    let off_level = reference.off_level(&mesh);
    let after = TriangleReport::of(&mesh);
    let largest = inner_deviation.max.max(reverse_deviation);
    let converged =
        settled && after.min_angle_deg >= options.min_angle_deg && largest <= allowed_deviation;
    let report = Report {
        before,
        after,
        iterations,
        splits: counts.splits,
        contractions: counts.contractions,
        flips: counts.flips,
        refinements,
        shortened,
        lengths,
        feature_edges,
        vertex_deviation,
        inner_deviation,
        reverse_deviation,
        allowed_deviation,
        off_level,
        exceptions,
        converged,
    };
    Ok(Remeshed {
        mesh,
        labels,
        report,
    })
}

fn relative_lengths(work: &Mesh) -> RelativeLengths {
    let wanted = |v: u32| work.vertices[v as usize].wanted;
    let mut lengths: Vec<f64> = work
        .edges()
        .map(|h| work.length(h) / wanted(work.from(h)).min(wanted(work.to(h))))
        .collect();
    lengths.sort_by(f64::total_cmp);
    let last = lengths.len() - 1;
    let inside = lengths
        .iter()
        .filter(|&&l| (steps::SHORT..=steps::LONG).contains(&l));
    RelativeLengths {
        min: lengths[0],
        percent_1: lengths[last / 100],
        median: lengths[last / 2],
        percent_99: lengths[last - last / 100],
        max: lengths[last],
        within: inside.count() as f64 / lengths.len() as f64,
    }
}

/// The rounds at the lengths wanted now; did they settle, and how many were they?
fn rounds(
    work: &mut Mesh,
    reference: &Reference<'_>,
    options: &Options,
    run: Run<'_, impl Backend + ?Sized>,
    counts: &mut steps::Counts,
) -> Result<(bool, usize), Error> {
    let (mut settled, mut done) = (false, 0);
    while done < options.iterations && !settled {
        run.progress("remesh", done as u64, options.iterations as u64)?;
        let changes = steps::round(work, reference);
        settled = 100 * changes.total() < work.edges().count();
        *counts += changes;
        done += 1;
    }
    steps::settle(work, reference);
    Ok((settled, done))
}
