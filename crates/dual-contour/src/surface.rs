//! The triangle surface.

use geom_core::{ImplicitField, LatticeValues, Run, TriMesh};

use crate::backend::ContourBackend;
use crate::build::{self, Purpose, build, caps};
use crate::complex::{Complex, Outcome};
use crate::dual::Duals;
use crate::emit::{Emission, Emitter, Want, compact};
use crate::{Error, Options, Report};

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
/// set instead of on the trilinear one.
pub fn surface<V: LatticeValues + ?Sized, B: ContourBackend + ?Sized>(
    values: &V,
    field: Option<&dyn ImplicitField>,
    options: &Options,
    run: Run<'_, B>,
) -> Result<Surface, Error> {
    let built = build(values, field, options, Purpose::Surface, run)?;
    run.progress("dual vertices", 0, 1)?;
    let centre = build::centre_value(field, values.lattice().bounds());
    let Outcome::Ready(complex) = Complex::build(&built.samples, &built.tree, centre) else {
        unreachable!("the build splits all larger leaves that are not simple");
    };
    let probe = build::probe(&built.samples, field, options);
    let duals = Duals::new(&complex, &probe, built.boxed);
    run.progress("triangles", 0, 1)?;
    let emitter = Emitter::new(&complex, &duals, &probe, |region| caps(built.boxed, region));
    let emission = emitter.emit(&Want {
        tets: false,
        region: |_| false,
    });
    let mut report = Report::default();
    build::describe(&mut report, &built.samples, &complex, &duals);
    report.added_vertices = emission.added.len();
    let mesh = surface_mesh(&emitter, emission, &built);
    report.triangles = mesh.triangles().len();
    run.progress("triangles", 1, 1)?;
    Ok(Surface { mesh, report })
}

fn surface_mesh(emitter: &Emitter<'_>, mut emission: Emission, built: &build::Built) -> TriMesh {
    let mut triangles = std::mem::take(&mut emission.triangles);
    let (positions, _) = emitter.all_vertices(&emission);
    let kept = compact(positions.len(), &mut triangles);
    let positions = kept
        .iter()
        .map(|&v| built.samples.domain.world(&positions[v as usize]))
        .collect();
    TriMesh::new(positions, triangles).expect("emitted triangles name emitted vertices")
}
