//! Map and quads of one field, and what is done where a handle or neck is too narrow for its lines.

use geom_core::mesh::Halfedges;
use geom_core::search::bvh::TriangleTree;
use geom_core::surface::distance::{Graph, shortest_paths};
use geom_core::{Point3, QuadMesh, TriMesh};

use super::super::extract::{SurfacePoint, lines, tangled};
use super::super::narrow::narrow;
use super::super::parts::Part;
use super::super::quality::scaled_jacobians;
use super::super::smooth::Smooth;
use super::{FOLDED, OFF_TARGET, Rungs, least};
use crate::anisotropy::Metric;
use crate::error::Error;
use crate::field::CrossField;
use crate::map::{
    Ends, Laid, MOST_DENSE, MapOptions, MapReport, Spread, Unfolding, Widening, parameterized,
};
use crate::options::Size;

/// How far the number of quads may be from a third of the triangles, which nobody has asked for.
const FAR_OFF: f64 = 0.25;
/// How many times more quads than wanted are refused, unless they are few.
const MOST: f64 = 4.0;
const FEW: usize = 400;
/// How often lines are laid closer where quads are no mesh.
const CLOSER: usize = 6;
/// How much closer, where one quad goes around the surface, and where two do.
const RATIO: [f64; 2] = [0.4, 0.55];
/// How much closer then.
const NEARER: f64 = 0.6;
/// How often.
const AGAIN: usize = 3;

/// Map and quads of a field, checked against the surface, and how often lines were laid closer to each other.
pub(super) type Mapped = (QuadMesh, usize, MapReport);

/// What a map is made of.
pub(super) struct Mapping<'a> {
    pub(super) part: &'a Part,
    pub(super) smooth: &'a Smooth,
    pub(super) field: &'a CrossField,
    pub(super) metric: Option<&'a Metric>,
    /// See [`Unfolding::ends`].
    pub(super) ends: Ends,
}

impl<'a> Mapping<'a> {
    /// Nothing of it has been unfolded yet.
    pub(super) fn of(
        part: &'a Part,
        smooth: &'a Smooth,
        field: &'a CrossField,
        metric: Option<&'a Metric>,
    ) -> Self {
        Self {
            part,
            smooth,
            field,
            metric,
            ends: Ends::of(part.mesh.triangles().len()),
        }
    }

    /// Area over that of a quad with two long sides of 1: as the field has them, and if it followed the gradient everywhere.
    fn stretched(&self) -> [f64; 2] {
        let mesh = &self.part.mesh;
        let Some(metric) = self.metric else {
            return [mesh.area(); 2];
        };
        let area = |f: usize| mesh.doubled_area_normal(f).norm() / 2.0;
        let sum = |density: &dyn Fn(usize) -> f64| {
            let faces = 0..mesh.triangles().len();
            faces.map(|f| area(f) * density(f)).sum()
        };
        let theta = &self.field.theta;
        [
            sum(&|f| metric.density(f, theta[f])),
            sum(&|f| metric.aligned_density(f)),
        ]
    }
}

/// Once more where rounding made the quads larger or smaller than wanted, with that allowed for.
pub(super) fn as_many(
    ground: &Mapping<'_>,
    spacing: f64,
    rungs: &Rungs<'_>,
) -> Result<Mapped, Error> {
    let [made, asked] = ground.stretched();
    let counted = !matches!(rungs.options.size, Size::Spacing(_));
    // A field that does not follow the gradient asks for more quads than were counted on.
    let stretch = if counted { made / asked } else { 1.0 };
    let nested = f64::from(1u32 << (2 * rungs.options.nested));
    let area = if counted { asked } else { made };
    let wanted = area / (spacing * spacing) * nested;
    let spacing = spacing * stretch.sqrt();
    let most = area / rungs.spacing.powi(2) * nested;
    let first = mapped(ground, spacing, most, rungs)?;
    let share = |made: &Mapped| made.0.quads().len() as f64 / wanted;
    let off = |made: &Mapped| (share(made) - 1.0).abs();
    let tolerance = match rungs.options.size {
        Size::Quads(_) => OFF_TARGET,
        Size::Triangles => FAR_OFF,
        Size::Spacing(_) => f64::INFINITY,
    };
    if off(&first) > tolerance {
        match mapped(ground, spacing * share(&first).sqrt(), most, rungs) {
            Ok(second) if off(&second) < off(&first) => return Ok(second),
            Err(error @ Error::Cancelled(_)) => return Err(error),
            _ => {}
        }
    }
    Ok(first)
}

/// Map and improved quads of a field. Where some are folded, the lines there are laid closer to each other, as long as fewer
/// are. `wanted` quads are asked for; far more are refused.
fn mapped(
    ground: &Mapping<'_>,
    spacing: f64,
    wanted: f64,
    rungs: &Rungs<'_>,
) -> Result<Mapped, Error> {
    let mut lay = Lay {
        closer: vec![1.0; ground.part.mesh.triangles().len()],
        tried: 0,
    };
    let mut best = lay.mapped(ground, spacing, wanted, rungs)?;
    if !rungs.options.improve {
        return Ok(best);
    }
    let (mut folded, mut least) = folded(&best.0, &rungs.finish.whole.mesh)?;
    for _ in 0..AGAIN {
        // What has been hard to come by is not made anew for quads that are upright.
        if folded.is_empty() || least > 0.0 && !rungs.has_half() {
            break;
        }
        let tree = TriangleTree::new(&ground.part.mesh)?;
        let places = tree.closest_to_all(&folded)?;
        let places: Vec<SurfacePoint> = places.iter().map(SurfacePoint::of).collect();
        lay_closer(ground.part, &places, spacing, NEARER, &mut lay.closer)?;
        lay.tried += 1;
        let next = match lay.mapped(ground, spacing, wanted, rungs) {
            Err(error @ Error::Cancelled(_)) => return Err(error),
            Err(_) => break,
            Ok(next) => next,
        };
        let (left, now) = self::folded(&next.0, &rungs.finish.whole.mesh)?;
        if left.len() >= folded.len() {
            break;
        }
        (best, folded, least) = (next, left, now);
    }
    Ok(best)
}

/// The corners of the quads that face the wrong way, or nearly; and the smallest scaled Jacobian.
fn folded(quads: &QuadMesh, surface: &TriMesh) -> Result<(Vec<Point3>, f64), Error> {
    let jacobians = scaled_jacobians(quads, surface)?;
    let all = jacobians.iter().enumerate().filter(|(_, j)| **j < FOLDED);
    let corners = all.flat_map(|(q, _)| quads.corners(q)).collect();
    Ok((corners, least(&jacobians)))
}

/// How close lines are laid to each other.
struct Lay {
    /// Per triangle, in the spacing asked for.
    closer: Vec<f64>,
    /// How often they were laid closer.
    tried: usize,
}

impl Lay {
    /// Map and improved quads of a field. Where the quads are no mesh because a handle or neck is too narrow for them, the
    /// lines are laid closer to each other.
    fn mapped(
        &mut self,
        ground: &Mapping<'_>,
        spacing: f64,
        wanted: f64,
        rungs: &Rungs<'_>,
    ) -> Result<Mapped, Error> {
        let part = ground.part;
        let last_try = self.tried + CLOSER;
        loop {
            let may_retry = self.tried < last_try;
            let map = self.laid(ground, spacing, may_retry, rungs)?;
            // The map of the smoothed triangles is one of those that they were, too.
            let (frames, nested) = (&ground.smooth.frames, rungs.options.nested);
            let (sources, quads, report) = lines(&map, frames, nested)?;
            let tangled = tangled(&quads);
            if quads.len() > FEW.max((MOST * wanted) as usize) {
                return Err(Error::TooMany {
                    quads: quads.len(),
                    wanted: wanted as usize,
                });
            }
            if tangled.is_empty() || !may_retry {
                let positions = sources.iter().map(|p| p.position(&part.mesh)).collect();
                let quads = QuadMesh::new(positions, quads)?;
                check(&quads, &part.mesh)?;
                let quads = rungs.finish.finished(quads, part)?;
                return Ok((quads, self.tried, report));
            }
            // One quad around a tube needs closer lines than two.
            self.tried += 1;
            for (around, ratio) in (1..).zip(RATIO) {
                let near = tangled.iter().filter(|t| t.1 == around);
                let near: Vec<SurfacePoint> = near.map(|t| sources[t.0 as usize]).collect();
                lay_closer(part, &near, spacing, ratio, &mut self.closer)?;
            }
        }
    }

    /// The map of the field with lines as close as they are to be laid now. If lines may be laid closer after it, one whose
    /// quads would be no mesh is not made whole.
    fn laid(
        &self,
        ground: &Mapping<'_>,
        spacing: f64,
        may_retry: bool,
        rungs: &Rungs<'_>,
    ) -> Result<Laid, Error> {
        let Mapping {
            part,
            smooth,
            field,
            metric,
            ends,
        } = ground;
        let Smooth { mesh, frames, .. } = smooth;
        let options = MapOptions {
            spacing: smooth.spacing(spacing, &self.closer, *metric, field),
            lines: part.lines.iter().map(|&h| h as u32).collect(),
        };
        let narrow = |spread: &Spread| narrow(spread, rungs.options.nested);
        // The other half is for closer lines and other fields; what is left of one map to unfold is worth less.
        let effort = rungs.effort.share(if ends.is_folded() { 8 } else { 2 });
        let unfolding = Unfolding {
            effort: &effort,
            ends,
            most_dense: MOST_DENSE,
        };
        let widening = Some(Widening {
            narrow: &narrow,
            may_be_vain: may_retry,
        });
        let run = rungs.run;
        let map = parameterized(mesh, frames, field, &options, unfolding, widening, run);
        rungs.effort.give_back(&effort);
        map
    }
}

/// Makes the spacing of lines near some points smaller, from a quad's side away on less and less.
fn lay_closer(
    part: &Part,
    points: &[SurfacePoint],
    spacing: f64,
    ratio: f64,
    closer: &mut [f64],
) -> Result<(), Error> {
    const FAR: f64 = 3.0;
    if points.is_empty() {
        return Ok(());
    }
    let triangles = part.mesh.triangles();
    let mut sources: Vec<(u32, f64)> = points
        .iter()
        .flat_map(|p| triangles[p.triangle as usize])
        .map(|v| (v, 0.0))
        .collect();
    sources.sort_by_key(|s| s.0);
    sources.dedup_by_key(|s| s.0);
    let graph = Graph::of_edges(&part.mesh)?;
    let distance = shortest_paths(&graph, &sources, 2.0 * FAR * spacing)?.distance;
    for (closer, corners) in closer.iter_mut().zip(triangles) {
        let nearest = corners.iter().map(|&v| distance[v as usize]);
        let nearest = nearest.fold(f64::INFINITY, f64::min) / spacing;
        *closer *= ratio + (1.0 - ratio) * ((nearest - 1.0) / (FAR - 1.0)).clamp(0.0, 1.0);
    }
    Ok(())
}

/// A manifold with the surface's Euler characteristic and boundary loops, or an error.
fn check(quads: &QuadMesh, surface: &TriMesh) -> Result<(), Error> {
    let euler = quads.euler_characteristic();
    let loops = Halfedges::of_quads(quads)?.boundary_loops().len();
    let wanted_euler = surface.euler_characteristic();
    let wanted_loops = Halfedges::of(surface)?.boundary_loops().len();
    if euler == wanted_euler && loops == wanted_loops {
        return Ok(());
    }
    Err(Error::Topology {
        euler,
        loops,
        wanted_euler,
        wanted_loops,
    })
}
