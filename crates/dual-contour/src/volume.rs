//! Tetrahedra.

use geom_core::mesh::{OUTSIDE, VertexKind};
use geom_core::{ImplicitField, LatticeValues, Run, TetMesh, TriMesh};

use crate::backend::ContourBackend;
use crate::build::{self, Purpose, build, caps};
use crate::complex::{Complex, Outcome};
use crate::dual::Duals;
use crate::emit::{Emitter, Want, compact};
use crate::{Error, Options, Report};

/// Tetrahedra, the surface of the molecule, and how they came about.
#[derive(Clone, Debug, PartialEq)]
pub struct Volume {
    /// Positive, conforming tetrahedra with a region each.
    pub mesh: TetMesh,
    /// The boundary of the molecule, with vertices of its own.
    pub surface: TriMesh,
    /// Counts.
    pub report: Report,
}

/// Tetrahedra inside or outside of the molecule, or both, conforming across all interfaces.
pub fn volume<V: LatticeValues + ?Sized, B: ContourBackend + ?Sized>(
    values: &V,
    field: Option<&dyn ImplicitField>,
    options: &Options,
    run: Run<'_, B>,
) -> Result<Volume, Error> {
    let built = build(values, field, options, Purpose::Volume(options.region), run)?;
    run.progress("dual vertices", 0, 1)?;
    let centre = build::centre_value(field, values.lattice().bounds());
    let Outcome::Ready(complex) = Complex::build(&built.samples, &built.tree, centre) else {
        unreachable!("the build splits all larger leaves that are not simple");
    };
    let probe = build::probe(&built.samples, field, options);
    let duals = Duals::new(&complex, &probe, built.boxed);
    run.progress("tetrahedra", 0, 1)?;
    let region = |r| options.region.holds(r);
    let emitter = Emitter::new(&complex, &duals, &probe, |r| {
        region(r) || caps(built.boxed, r)
    });
    let mut emission = emitter.emit(&Want { tets: true, region });
    let mut report = Report::default();
    build::describe(&mut report, &built.samples, &complex, &duals);
    report.added_vertices = emission.added.len();

    let (positions, kinds) = emitter.all_vertices(&emission);
    let mut triangles = std::mem::take(&mut emission.triangles);
    let mut tets = std::mem::take(&mut emission.tets);
    let to_world = |kept: &[u32]| {
        kept.iter()
            .map(|&v| built.samples.domain.world(&positions[v as usize]))
            .collect()
    };
    let on_surface = compact(positions.len(), &mut triangles);
    let surface = TriMesh::new(to_world(&on_surface), triangles)
        .expect("emitted triangles name emitted vertices");
    let kept = compact(positions.len(), &mut tets);
    let kinds: Vec<VertexKind> = kept.iter().map(|&v| kinds[v as usize]).collect();
    let mesh = TetMesh::with_kinds(to_world(&kept), tets, emission.regions, kinds)
        .expect("emitted tetrahedra name emitted vertices");
    let mesh = with_interface_kinds(mesh);
    report.triangles = surface.triangles().len();
    report.tets = mesh.tets().len();
    run.progress("tetrahedra", 1, 1)?;
    Ok(Volume {
        mesh,
        surface,
        report,
    })
}

/// Kinds from what lies around each vertex: on an interface, on the box, at a junction.
fn with_interface_kinds(mesh: TetMesh) -> TetMesh {
    let faces = mesh.interfaces();
    let (positions, tets, regions, mut kinds) = mesh.into_parts();
    // The pair of regions of the first interface seen at a vertex.
    let mut pair = vec![None; positions.len()];
    for face in &faces {
        let on_box = face.triangle.iter().all(|&v| {
            matches!(
                kinds[v as usize],
                VertexKind::BoxFace { .. } | VertexKind::BoxEdge { .. } | VertexKind::Fixed
            )
        });
        if face.outside == OUTSIDE && on_box {
            continue;
        }
        for v in face.triangle.map(|v| v as usize) {
            let here = (face.inside, face.outside);
            match pair[v] {
                None => pair[v] = Some((here, false)),
                Some((other, false)) if other != here => pair[v] = Some((other, true)),
                _ => {}
            }
        }
    }
    for (kind, pair) in kinds.iter_mut().zip(&pair) {
        *kind = match (*kind, pair) {
            (VertexKind::Interior | VertexKind::Surface, None) => VertexKind::Interior,
            (VertexKind::Interior | VertexKind::Surface, Some((_, false))) => VertexKind::Surface,
            (_, Some(_)) => VertexKind::Fixed,
            (boxed, None) => boxed,
        };
    }
    TetMesh::with_kinds(positions, tets, regions, kinds).expect("only kinds have changed")
}
