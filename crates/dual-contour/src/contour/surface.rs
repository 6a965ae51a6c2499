//! The triangle surface.

use geom_core::{ImplicitField, LatticeValues, Run, TriMesh};

use super::report::Report;
use super::resolution::resolved;
use super::setup::{Purpose, sampled};
use super::{is_uniform, mesh as mesh_of, uniform};
use crate::backend::ContourBackend;
use crate::complex::collect::compact;
use crate::dual::Probe;
use crate::octree::Domain;
use crate::{Error, Options};

/// A surface and how it came about.
#[derive(Clone, Debug, PartialEq)]
pub struct Surface {
    /// The boundary of the molecule: closed, oriented outwards, every edge with two triangles and
    /// every vertex with one fan.
    pub mesh: TriMesh,
    /// Counts.
    pub report: Report,
}

/// The surface of the molecule: where the values reach the level.
///
/// `field`, if given, is the function that the values sample; vertices are then placed on its level
/// set instead of on the trilinear one. A [resolution](crate::Resolution) in tetrahedra gives the
/// surface of the volume mesh that has about as many.
///
/// The backend places the dual vertices of finest cells if no field is given. A field that takes many points with one
/// call ([`ImplicitField::at_many`]) is asked for all cells, or all edges that are cut, at a time; the rest runs on the
/// processor.
///
/// Besides one reading of the values, of which a sparse grid spares the mesher its constant bricks, time and memory go
/// with the number of cells at the surface, `A / h²` for an area A and a spacing h. A surface of cells of one size is
/// made without an octree.
///
/// ```
/// use dual_contour::geom_core::{Aabb, Cpu, Run};
/// use dual_contour::{FieldSamples, Options, surface};
/// # use dual_contour::geom_core::{ImplicitField, Point3, Vector3};
/// # struct Ball;
/// # impl ImplicitField for Ball {
/// #     fn value(&self, x: &Point3) -> f64 {
/// #         4.0 - x.coords.norm()
/// #     }
/// #     fn value_gradient(&self, x: &Point3) -> (f64, Vector3) {
/// #         (self.value(x), -x.coords.normalize())
/// #     }
/// # }
/// # fn main() -> Result<(), dual_contour::Error> {
/// // The field `Ball` has the value 1 on a sphere of radius 3 Å.
/// let bounds = Aabb::new(Point3::new(-4.0, -4.0, -4.0), Point3::new(4.0, 4.0, 4.0));
/// let values = FieldSamples::new(&Ball, &bounds, 0.5);
/// let made = surface(&values, Some(&Ball), &Options::default(), Run::on(&Cpu))?;
/// assert_eq!(made.mesh.euler_characteristic(), 2);
/// // On the sphere, but for cells that it only grazes: their points stay a hundredth of the cell inside.
/// let off = |p: &Point3| (p.coords.norm() - 3.0).abs();
/// assert!(made.mesh.positions().iter().all(|p| off(p) < 0.01));
/// # Ok(())
/// # }
/// ```
///
/// # Errors
///
/// No surface at the level, a surface that meets the box ([`AtBox`](crate::AtBox)), options out of range, values that
/// are not finite, too much memory, or what the backend or the watcher says.
pub fn surface<V: LatticeValues + ?Sized, B: ContourBackend + ?Sized>(
    values: &V,
    field: Option<&dyn ImplicitField>,
    options: &Options,
    run: Run<'_, B>,
) -> Result<Surface, Error> {
    let run = run.with(run.backend.as_contour());
    let options = resolved(values, field, options, run)?;
    let (samples, mut report) = sampled(values, field, &options, Purpose::Surface, run)?;
    let probe = Probe::new(&samples, field, &options);
    let mesh = if is_uniform(&options) {
        run.progress("triangles", 0, 1)?;
        uniform::surface(
            &samples,
            &probe,
            run.backend,
            options.max_memory,
            &mut report,
        )?
    } else {
        let purpose = Purpose::Surface;
        let made = mesh_of(&samples, &probe, &options, purpose, report, run)?;
        report = made.report;
        surface_mesh(&made.raw.positions, made.raw.triangles, &made.domain)
    };
    run.progress("triangles", 1, 1)?;
    Ok(Surface { mesh, report })
}

/// The triangles with the vertices that they use, in Å.
pub(crate) fn surface_mesh(
    positions: &[geom_core::Point3],
    mut triangles: Vec<[u32; 3]>,
    domain: &Domain,
) -> TriMesh {
    let kept = compact(positions.len(), &mut triangles);
    let positions = kept
        .iter()
        .map(|&v| domain.world(&positions[v as usize]))
        .collect();
    TriMesh::new(positions, triangles).expect("emitted triangles name emitted vertices")
}
