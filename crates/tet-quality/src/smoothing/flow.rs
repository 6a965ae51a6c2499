//! The averaged mean curvature flow of the thesis (section 3.4): it takes noise from a surface and
//! nearly keeps the volume that it encloses.
//!
//! Mean curvature flow alone, `dx/dt = −H n`, shrinks a sphere to a point. The volume changes by `−∫ H` per time; taken less
//! its mean over the surface, `dx/dt = (H̄ − H) n`, that is nothing: bumps go, the body stays. In steps of finite length it
//! drifts a little, which is why "nearly".

use geom_core::mesh::{FACES, Region, VertexKind};
use geom_core::{Point3, Vector3};

use crate::boundary::guard::GuardedMesh;
use crate::mesh::editable::EditableMesh;
use crate::smoothing::smooth::{load, sweep};
use crate::smoothing::star::Star;

/// Objective that tetrahedra keep where they had it.
const FLOOR: f64 = 0.01;

/// What the triangles around a surface vertex say.
#[derive(Clone, Copy)]
struct Around {
    /// Integral of the curvature normal: half the sum of cotangent-weighted edges.
    bend: Vector3,
    /// Area vector, from the lower region to the higher one.
    normal: Vector3,
    /// A third of the area.
    area: f64,
    /// Area-weighted sum of the centroids.
    centre: Vector3,
    pair: [Region; 2],
}

/// `steps` steps of `x += τ h² (H̄ − H) n + τ (m − x)ₜ`: towards the mean `H̄` of the mean curvature of
/// each interface along the normal, and along the surface to the centre of mass `m` of the
/// surrounding triangles. `τ` is `step`, `h` the spacing. Vertices of boxes, `junctions` and fixed
/// ones stay. Gives how many moves were made.
///
/// The step is explicit. A vertex takes it in full, in half, in a quarter or not at all: its tetrahedra must keep what
/// they had, or the objective 0.01 if they had more.
pub(crate) fn flow(
    guarded: &mut GuardedMesh,
    junctions: &[u32],
    spacing: f64,
    steps: u32,
    step: f64,
) -> usize {
    let mut moved = 0;
    for _ in 0..steps {
        let mesh = &guarded.mesh;
        let around = gather(mesh);
        let averages = averages(&around);
        let displacements: Vec<Vector3> = around
            .iter()
            .enumerate()
            .map(|(v, a)| {
                let movable = matches!(mesh.kinds[v], VertexKind::Interior | VertexKind::Surface)
                    && junctions.binary_search(&(v as u32)).is_err();
                let Some((a, n)) = a
                    .filter(|a| movable && a.area > 0.0)
                    .and_then(|a| Some((a, a.normal.try_normalize(0.0)?)))
                else {
                    return Vector3::zeros();
                };
                let mean = averages.iter().find(|m| m.0 == a.pair).map_or(0.0, |m| m.1);
                let bend = mean - curvature(&a, &n);
                let centre = a.centre / (3.0 * a.area) - mesh.x[v].coords;
                let along = centre - n * n.dot(&centre);
                n * (step * spacing * spacing * bend) + along * step
            })
            .collect();
        let vertices: Vec<u32> = (0..mesh.x.len() as u32)
            .filter(|&v| displacements[v as usize] != Vector3::zeros())
            .collect();
        moved += sweep(
            guarded,
            &vertices,
            |_| true,
            |guarded, v, star| shift(&guarded.mesh, v, displacements[v as usize], star),
            GuardedMesh::move_vertex,
        );
    }
    moved
}

/// The place to which a vertex goes, if any: the longest share of the step that its tetrahedra take.
fn shift(mesh: &EditableMesh, v: u32, d: Vector3, star: &mut Star) -> Option<Point3> {
    load(mesh, v, star);
    let x = mesh.x[v as usize];
    let floor = star.value(&x.coords).min(FLOOR * FLOOR) - 1e-12;
    [1.0, 0.5, 0.25].into_iter().find_map(|share| {
        let candidate = x + d * share;
        star.value_above(&candidate.coords, floor)
            .map(|_| candidate)
    })
}

/// Mean curvature, positive where the surface is convex towards the higher region.
fn curvature(a: &Around, n: &Vector3) -> f64 {
    -a.bend.dot(n) / (2.0 * a.area)
}

/// The mean of the mean curvature over the interface of each pair of regions.
/// Weighted by area.
fn averages(around: &[Option<Around>]) -> Vec<([Region; 2], f64)> {
    let mut sums: Vec<([Region; 2], f64, f64)> = Vec::new();
    for a in around.iter().flatten().filter(|a| a.area > 0.0) {
        let Some(n) = a.normal.try_normalize(0.0) else {
            continue;
        };
        let at = match sums.iter().position(|s| s.0 == a.pair) {
            Some(at) => at,
            None => {
                sums.push((a.pair, 0.0, 0.0));
                sums.len() - 1
            }
        };
        sums[at].1 += curvature(a, &n) * a.area;
        sums[at].2 += a.area;
    }
    sums.into_iter().map(|(p, h, a)| (p, h / a)).collect()
}

/// Per vertex; `None` off the interfaces. At a junction, where interfaces of several pairs meet, the sums mix them, and
/// the vertex is to stay.
fn gather(mesh: &EditableMesh) -> Vec<Option<Around>> {
    let mut out: Vec<Option<Around>> = vec![None; mesh.x.len()];
    for t in 0..mesh.tets.len() as u32 {
        if mesh.is_empty_slot(t) {
            continue;
        }
        let region = mesh.regions[t as usize];
        for (k, corners) in FACES.iter().enumerate() {
            let other = mesh.region_beyond(t, k);
            if region >= other {
                continue;
            }
            let face = corners.map(|i| mesh.tets[t as usize][i]);
            let p = face.map(|v| mesh.x[v as usize].coords);
            let double = (p[1] - p[0]).cross(&(p[2] - p[0]));
            let area = double.norm() / 2.0;
            if area <= 0.0 {
                continue;
            }
            for i in 0..3 {
                let (a, b, c) = (p[i], p[(i + 1) % 3], p[(i + 2) % 3]);
                // The edge ab is weighted by the cotangent at c, ac by the one at b.
                let cot_b = (a - b).dot(&(c - b)) / (2.0 * area);
                let cot_c = (a - c).dot(&(b - c)) / (2.0 * area);
                let entry = out[face[i] as usize].get_or_insert(Around {
                    bend: Vector3::zeros(),
                    normal: Vector3::zeros(),
                    area: 0.0,
                    centre: Vector3::zeros(),
                    pair: [region, other],
                });
                entry.bend += ((b - a) * cot_c + (c - a) * cot_b) / 2.0;
                entry.normal += double;
                entry.area += area / 3.0;
                entry.centre += (a + b + c) / 3.0 * area;
            }
        }
    }
    out
}
