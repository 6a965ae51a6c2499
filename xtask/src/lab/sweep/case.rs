//! One case: mesh, improve, audit.

use std::time::Instant;

use dual_contour::{Extent, Method};
use gauss_density::PointSampler;
use geom_core::mesh::{BoundaryComparison, EXTERIOR, INTERIOR, SurfaceAudit, VolumeAudit};
use geom_core::{BrickGrid, Cpu, LatticeValues, Run, TetMesh, TriMesh};
use serde_json::{Value, json};
use tet_quality::{Goals, Summary, SurfaceFit, quality_report};

use super::labels::{Cells, Lattice, Topology};

/// Volumes that should be equal agree within this share.
const VOLUME: f64 = 1e-9;
/// Least share of the surface vertices that lie within 0.1 spacings of the isosurface.
const ON_SURFACE: f64 = 0.999;

/// What every tetrahedron shall reach.
fn targets(method: Method) -> Goals {
    Goals {
        min_dihedral: match method {
            Method::Stuffing => 25.0,
            Method::DualContour => 20.0,
        },
        max_dihedral: 155.0,
        joe_liu: 0.3,
        edge_ratio: 6.0,
    }
}

/// The topology of the molecule as the labels have it, in the complex of a mesher.
pub(super) fn expected(
    grid: &BrickGrid,
    field: &PointSampler<'_>,
    method: Method,
) -> Result<Topology, String> {
    use geom_core::ImplicitField;
    let lattice = *grid.lattice();
    let values: Vec<f64> = (0..lattice.len())
        .map(|i| f64::from(grid.at(lattice.coordinates(i))) - 1.0)
        .collect();
    let half = geom_core::Vector3::repeat(0.5 * lattice.spacing);
    let of_field = |p: [usize; 3]| field.value(&(lattice.point(p) + half)) - 1.0;
    let of_corners = |p: [usize; 3]| {
        let corner = |c: usize| [0, 1, 2].map(|k| p[k] + (c >> k & 1));
        let index = |[x, y, z]: [usize; 3]| x + lattice.counts[0] * (y + lattice.counts[1] * z);
        (0..8).map(|c| values[index(corner(c))]).sum::<f64>() / 8.0
    };
    // Dual contouring joins by the values on the lattice alone; the middles of cells are points of the
    // lattice of the other mesher.
    let (middle, cells): (&dyn Fn([usize; 3]) -> f64, _) = match method {
        Method::DualContour => (&of_corners, Cells::Cubes),
        Method::Stuffing => (&of_field, Cells::Centred),
    };
    Lattice {
        counts: lattice.counts,
        values: &values,
        middle,
    }
    .topology(cells)
}

/// What came of a case.
pub(super) struct Outcome {
    /// Figures for the results file; `faults` and `misses` among them.
    pub(super) row: Value,
    /// The improved mesh and its molecular surface; `None` where an error came instead.
    pub(super) mesh: Option<(TetMesh, TriMesh)>,
}

/// Runs a case through the libraries, as the program `00_pipeline` does, and audits the mesh before and
/// after its improvement.
pub(super) fn run(
    grid: &BrickGrid,
    field: &PointSampler<'_>,
    method: Method,
    region: Extent,
    expected: Result<Topology, String>,
) -> Outcome {
    let mut row = json!({ "faults": [], "misses": [] });
    let mesh = figures(grid, field, method, region, expected, &mut row);
    let mesh = mesh
        .map_err(|error| push(&mut row, "faults", vec![error]))
        .ok();
    Outcome { row, mesh }
}

fn push(row: &mut Value, list: &str, items: Vec<String>) {
    if let Some(all) = row[list].as_array_mut() {
        all.extend(items.into_iter().map(Value::from));
    }
}

fn figures(
    grid: &BrickGrid,
    field: &PointSampler<'_>,
    method: Method,
    region: Extent,
    expected: Result<Topology, String>,
    row: &mut Value,
) -> Result<(TetMesh, TriMesh), String> {
    let expected = expected?;
    row["topology"] = json!([expected.components, expected.tunnels, expected.cavities]);
    let h = grid.lattice().spacing;
    let start = Instant::now();
    let options = dual_contour::Options {
        method,
        region,
        ..Default::default()
    };
    let volume = dual_contour::volume(grid, Some(field), &options, Run::on(&Cpu))
        .map_err(|e| format!("meshing: {e}"))?;
    row["mesh_s"] = start.elapsed().as_secs_f64().into();
    row["split_cells"] = volume.report.split_cells.into();
    row["clamped"] = volume.report.clamped.into();
    // Before the improvement too: else it could hide, or be blamed for, what the mesher did.
    let faults = audit(&volume.mesh, region, &expected).0;
    push(row, "faults", named("raw", faults));
    push(row, "faults", named("raw", compare(&volume, region)));

    let start = Instant::now();
    // The lattice's spacing, not a median edge: deviations count in it.
    let options = tet_quality::Options {
        spacing: Some(h),
        ..Default::default()
    };
    let improved = tet_quality::improve(volume.mesh, Some(field), &options, Run::on(&Cpu))
        .map_err(|e| format!("improvement: {e}"))?;
    row["improve_s"] = start.elapsed().as_secs_f64().into();
    let (mesh, report) = (improved.mesh, improved.report);
    let (faults, surface) = audit(&mesh, region, &expected);
    push(row, "faults", named("improved", faults));

    // Measured anew on what came out: the report is not its own witness.
    let q = quality_report(&mesh).all;
    let fit = &report.surface;
    row["tets"] = q.tets.into();
    row["vertices"] = mesh.positions().len().into();
    row["raw_min_dihedral"] = report.before.all.min_dihedral.min.into();
    row["raw_max_dihedral"] = report.before.all.max_dihedral.max.into();
    row["min_dihedral"] = q.min_dihedral.min.into();
    row["max_dihedral"] = q.max_dihedral.max.into();
    row["joe_liu"] = q.joe_liu.min.into();
    row["edge_ratio"] = q.edge_ratio.max.into();
    row["surface_vertices"] = fit.vertices.into();
    row["far_vertices"] = fit.far.into();
    row["largest_deviation"] = (fit.largest / h).into();
    row["unmet"] = format!("{:?}", report.unmet.counts).into();
    row["volume"] = q.volume.into();
    push(row, "misses", misses(&q, fit, method));
    Ok((mesh, surface))
}

/// The targets that are missed, by name.
fn misses(q: &Summary, fit: &SurfaceFit, method: Method) -> Vec<String> {
    let t = targets(method);
    let missed = [
        (q.min_dihedral.min < t.min_dihedral, "min dihedral"),
        (q.max_dihedral.max > t.max_dihedral, "max dihedral"),
        (q.joe_liu.min < t.joe_liu, "Joe–Liu"),
        (q.edge_ratio.max > t.edge_ratio, "edge ratio"),
        (
            fit.far as f64 > (1.0 - ON_SURFACE) * fit.vertices as f64,
            "deviation",
        ),
    ];
    missed
        .iter()
        .filter(|m| m.0)
        .map(|m| m.1.to_owned())
        .collect()
}

fn named(stage: &str, faults: Vec<String>) -> Vec<String> {
    faults
        .into_iter()
        .map(|f| format!("{stage}: {f}"))
        .collect()
}

/// Do two volumes agree, measured by the box?
fn close(a: f64, b: f64, whole: f64) -> bool {
    (a - b).abs() <= VOLUME * whole
}

/// Everything that must hold for a mesh, and the surface of its molecule.
fn audit(mesh: &TetMesh, region: Extent, expected: &Topology) -> (Vec<String>, TriMesh) {
    let mut faults = Vec::new();
    let mut require = |holds: bool, what: &dyn Fn() -> String| {
        if !holds {
            faults.push(what());
        }
    };
    let volume = VolumeAudit::of(mesh);
    require(volume.is_valid(), &|| {
        volume.to_string().replace('\n', "; ")
    });
    let surface = match region {
        Extent::Exterior => seen_from_outside(mesh),
        Extent::Interior | Extent::Both => mesh.region_surface(INTERIOR),
    };
    // The exterior's boundary on its own: the molecule's may be closed while it is not.
    let outside = (region != Extent::Interior).then(|| mesh.region_surface(EXTERIOR));
    let audit = SurfaceAudit::of(&surface);
    require(audit.is_closed_manifold(), &|| {
        format!(
            "the surface is no closed manifold: {}",
            audit.to_string().replace('\n', "; ")
        )
    });
    if let Some(outside) = &outside {
        let audit = SurfaceAudit::of(outside);
        require(audit.is_closed_manifold(), &|| {
            format!(
                "the exterior's boundary is no closed manifold: {}",
                audit.to_string().replace('\n', "; ")
            )
        });
    }
    // Outer surfaces enclose a positive volume, walls of cavities a negative one.
    let walls = audit.components.iter().filter(|c| c.volume < 0.0).count() as i64;
    let found = Topology {
        components: audit.components.len() as i64 - walls,
        tunnels: audit.components.iter().filter_map(|c| c.genus()).sum(),
        cavities: walls,
    };
    require(found == *expected, &|| {
        format!("the surface has {found:?}, the labels {expected:?}")
    });
    // From the tetrahedra alone: a right surface may stand around wrong volumes.
    let pieces = |r| volume.region(r).map_or(0, |r| r.components as i64);
    let chi = expected.components - expected.tunnels + expected.cavities;
    // χ(box) = χ(inside) + χ(outside) − χ(surface); a closed surface has twice the χ of its body.
    let (inside, around, euler) = match region {
        Extent::Interior => (expected.components, 0, chi),
        Extent::Exterior => (0, 1 + expected.cavities, 1 + chi),
        Extent::Both => (expected.components, 1 + expected.cavities, 1),
    };
    let (found_in, found_out) = (pieces(INTERIOR), pieces(EXTERIOR));
    require((found_in, found_out) == (inside, around), &|| {
        format!("{found_in} pieces inside and {found_out} outside, not {inside} and {around}")
    });
    let found = mesh.euler_characteristic();
    require(found == euler, &|| {
        format!("Euler characteristic {found} of the tetrahedra, not {euler}")
    });
    // Surface and tetrahedra must tell one volume; measured by the box, in which the sums round.
    let whole: f64 = mesh.bounds().extent().iter().product();
    let enclosed = audit.volume();
    let sum = volume.volume();
    let should = match region {
        Extent::Interior => enclosed,
        Extent::Exterior => whole - enclosed,
        Extent::Both => whole,
    };
    require(close(sum, should, whole), &|| {
        format!("the volumes sum to {sum}, not {should}")
    });
    (faults, surface)
}

/// The surface of the molecule where only the exterior is meshed: its boundary without the box, turned.
fn seen_from_outside(mesh: &TetMesh) -> TriMesh {
    let bounds = mesh.bounds();
    let (positions, triangles) = mesh.region_surface(EXTERIOR).into_parts();
    let mut number = vec![u32::MAX; positions.len()];
    let mut kept = Vec::new();
    let triangles = triangles
        .into_iter()
        .filter(|t| {
            let on = |k: usize, plane: f64| t.iter().all(|&v| positions[v as usize][k] == plane);
            !(0..3).any(|k| on(k, bounds.min[k]) || on(k, bounds.max[k]))
        })
        .map(|[a, b, c]| {
            [a, c, b].map(|v| {
                if number[v as usize] == u32::MAX {
                    number[v as usize] = kept.len() as u32;
                    kept.push(positions[v as usize]);
                }
                number[v as usize]
            })
        })
        .collect();
    TriMesh::new(kept, triangles).expect("the triangles name kept vertices")
}

/// Is the surface that came with the tetrahedra their boundary?
fn compare(volume: &dual_contour::Volume, region: Extent) -> Vec<String> {
    let (mesh, surface) = (&volume.mesh, &volume.surface);
    let fine = match region {
        Extent::Interior | Extent::Both => {
            BoundaryComparison::of(mesh, INTERIOR, surface).is_equal()
        }
        Extent::Exterior => {
            let found = BoundaryComparison::of(mesh, EXTERIOR, surface);
            let boundary = mesh.region_surface(EXTERIOR).triangles().len();
            let triangles = surface.triangles().len();
            found.reversed == triangles
                && found.missing.none()
                && found.equal == 0
                && found.extra.count + triangles == boundary
                && seen_from_outside(mesh).triangles().len() == triangles
        }
    };
    if fine {
        Vec::new()
    } else {
        vec!["the surface is not the boundary of the tetrahedra".to_owned()]
    }
}
