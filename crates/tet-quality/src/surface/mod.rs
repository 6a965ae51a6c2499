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
mod metrics;
mod reference;
mod steps;
#[cfg(test)]
mod tests;

pub use metrics::{TriangleReport, angles, edge_lengths, radius_ratio};

use geom_core::{Backend, Cancelled, ImplicitField, MeshError, Run, TriMesh};

use mesh::Mesh;
use reference::Reference;

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
            max_triangles: 50_000_000,
        }
    }
}

impl Options {
    /// Are all numbers in their ranges?
    pub fn check(&self) -> Result<(), Error> {
        let positive = |name, value: f64| {
            if value.is_finite() && value > 0.0 {
                Ok(())
            } else {
                Err(Error::Option {
                    name,
                    value,
                    needs: "a positive number",
                })
            }
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
                if !(max_edge.is_finite() && max_edge >= min_edge) {
                    let needs = "a number that is not below min_edge";
                    return Err(Error::Option {
                        name: "max_edge",
                        value: max_edge,
                        needs,
                    });
                }
            }
        }
        if let Features::Angle(angle) = self.features
            && !(angle > 0.0 && angle <= 180.0)
        {
            let needs = "an angle above 0° and at most 180°";
            return Err(Error::Option {
                name: "features",
                value: angle,
                needs,
            });
        }
        if !self.level.is_finite() {
            let needs = "a finite number";
            return Err(Error::Option {
                name: "level",
                value: self.level,
                needs,
            });
        }
        if !(0.0..60.0).contains(&self.min_angle_deg) {
            let (value, needs) = (self.min_angle_deg, "an angle from 0° to below 60°");
            return Err(Error::Option {
                name: "min_angle_deg",
                value,
                needs,
            });
        }
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
    #[error("{0}; geom_core::repair::repair can cure that")]
    NotManifold(#[from] MeshError),
    /// A triangle without area has no normal to follow.
    #[error("triangle {triangle} has no area; geom_core::repair::repair drops such triangles")]
    Degenerate {
        /// The first such triangle.
        triangle: usize,
    },
    /// An option is out of its range.
    #[error("option {name} is {value}, but must be {needs}")]
    Option {
        /// The field.
        name: &'static str,
        /// Its value.
        value: f64,
        /// What it must be.
        needs: &'static str,
    },
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

/// Distances from the surface to follow, Å.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Deviation {
    /// Mean.
    pub mean: f64,
    /// Largest.
    pub max: f64,
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
    /// Edges of the result that are kept: features and boundaries.
    pub feature_edges: usize,
    /// From the result's vertices to the level set, to first order, or to the input mesh.
    pub vertex_deviation: Deviation,
    /// From the result's triangle centroids to the same.
    pub centroid_deviation: Deviation,
    /// Vertices farther from the level set than a hundredth of the wanted edge length: they lie on
    /// necks, tunnels and pieces of the input that the level set has not, and follow the input there.
    pub off_level: usize,
    /// Did the last round change less than one edge in a hundred, and are all angles at least
    /// [`Options::min_angle_deg`]?
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
/// use tet_quality::surface::{Options, Sizing, remesh};
/// let torus = shapes::torus(3.0, 1.0, 40, 12);
/// let options = Options {
///     sizing: Sizing::Uniform { edge_length: Some(0.3) },
///     ..Options::default()
/// };
/// let result = remesh(torus, None, &options, Run::on(&Cpu))?;
/// assert_eq!(result.mesh.euler_characteristic(), 0);
/// assert!(result.report.after.min_angle_deg > 25.0);
/// # Ok::<(), tet_quality::surface::Error>(())
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
    let flat = |t: &usize| mesh.doubled_area_normal(*t).norm_squared() == 0.0;
    if let Some(triangle) = (0..mesh.triangles().len()).find(flat) {
        return Err(Error::Degenerate { triangle });
    }
    let before = TriangleReport::of(&mesh);
    let triangles = mesh.triangles().len();
    let labels = match options.labels.len() {
        0 => vec![0; triangles],
        n if n == triangles => options.labels.clone(),
        labels => return Err(Error::Labels { labels, triangles }),
    };
    let mut work = Mesh::new(&mesh, labels)?;
    let reference = Reference::new(mesh, field, options, &mut work)?;
    let mut counts = steps::Counts::default();
    let mut settled = false;
    let mut iterations = 0;
    for round in 0..options.iterations {
        run.progress("remesh", round as u64, options.iterations as u64)?;
        let mut done = steps::split_long(&mut work, &reference);
        done += steps::contract_short(&mut work, &reference);
        done += steps::flip_for_valence(&mut work);
        steps::relax(&mut work, &reference);
        done += steps::flip_for_angle(&mut work);
        counts += done;
        iterations = round + 1;
        settled = 100 * done.total() < work.edges().count();
        if settled {
            break;
        }
    }
    counts += steps::lift(&mut work, &reference, options.min_angle_deg);
    run.progress(
        "remesh",
        options.iterations as u64,
        options.iterations as u64,
    )?;
    let feature_edges = work.edges().filter(|&h| work.is_feature(h)).count();
    let (mesh, mut labels) = work.finish();
    if options.labels.is_empty() {
        labels.clear();
    }
    let (vertex_deviation, centroid_deviation) = reference.deviations(&mesh);
    let off_level = reference.off_level(&mesh);
    let after = TriangleReport::of(&mesh);
    let converged = settled && after.min_angle_deg >= options.min_angle_deg;
    let report = Report {
        before,
        after,
        iterations,
        splits: counts.splits,
        contractions: counts.contractions,
        flips: counts.flips,
        feature_edges,
        vertex_deviation,
        centroid_deviation,
        off_level,
        converged,
    };
    Ok(Remeshed {
        mesh,
        labels,
        report,
    })
}
