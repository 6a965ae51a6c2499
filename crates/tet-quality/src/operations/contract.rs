//! Contraction of an edge: one end moves onto the other, and the tetrahedra between them vanish.
//!
//! It is the operation that takes a vertex away, for slivers between vertices that are too near to each other. What lies around the
//! vanishing vertex is joined to the other one. Two things can go wrong. The body may change its topology, as a handle does
//! whose loop of three edges loses one: the *link condition* forbids it, by which what lies around both ends is exactly what lies
//! around the edge, in the volume, on every interface and on junctions (Dey et al. 1999). And the shape may change: a vertex of
//! an interface vanishes into one of the same interface only, if the triangles there keep their direction and stay near
//! the isosurface.

use geom_core::mesh::VertexKind;
use geom_core::{Point3, Vector3};

use crate::boundary::field::Isosurface;
use crate::measure::metrics::quality;
use crate::mesh::editable::{EditableMesh, Freedom};
use crate::mesh::link::{ContractedEdge, EdgeLink, VertexLink, keeps_topology};
use crate::mesh::proposal::{Floor, NewTet, Operation, Proposal};

/// Cosine between the normals of a surface triangle before and after.
/// They may turn by 60° at most: folds are refused, and the field judges the rest.
const TURN: f64 = 0.5;

/// The edge, if `a` may vanish into `b` as far as the geometry of boundary and interfaces is concerned.
/// Into which vertex matters: a free one may vanish into any, one of an interface only along it, one that is fixed
/// never.
fn allowed(mesh: &EditableMesh, a: u32, b: u32, link: &EdgeLink) -> Option<ContractedEdge> {
    let edge = |on_surface| ContractedEdge {
        from: a,
        to: b,
        on_surface,
    };
    let freedom = mesh.freedom[a as usize];
    if freedom == Freedom::Free {
        return Some(edge(false));
    }
    // The edge must lie on an interface; `a` lies on only one.
    if link.interior() || freedom.is_fixed() {
        return None;
    }
    let along = mesh.x[b as usize] - mesh.x[a as usize];
    let stays = match freedom {
        Freedom::Line(d) => along.cross(&d).norm() <= 1e-9 * along.norm(),
        Freedom::Plane(n) => along.dot(&n).abs() <= 1e-9 * along.norm(),
        // Into the next vertex of the same curve.
        Freedom::Curve(_) => mesh.freedom[b as usize] == freedom && link.wings().len() == 3,
        _ => true,
    };
    // A vertex of a box edge goes only to another one of it, or to its end.
    let kinds_fit = match mesh.kinds[a as usize] {
        VertexKind::BoxEdge { .. } => matches!(
            mesh.kinds[b as usize],
            VertexKind::BoxEdge { .. } | VertexKind::Fixed
        ),
        _ => true,
    };
    (stays && kinds_fit).then(|| edge(true))
}

/// Contraction of `a` into `b`. `tolerance`: largest distance of the middle of a new surface triangle
/// from the isosurface.
///
/// All tetrahedra around `a` are removed and those without `b` inserted again, with `b` in place of `a`. Questions come
/// in the order of their cost: quality, link condition, shape of the surface.
pub(crate) fn contraction(
    mesh: &EditableMesh,
    a: u32,
    b: u32,
    field: Option<&Isosurface<'_>>,
    tolerance: f64,
    floor: Floor,
) -> Option<Proposal> {
    if mesh.freedom[a as usize].is_fixed() {
        return None;
    }
    let star = mesh.incidence.of(a);
    let old = star
        .iter()
        .map(|&t| mesh.q[t as usize])
        .fold(f64::INFINITY, f64::min);
    if old <= 0.0 {
        return None;
    }
    // The cheapest question first: are the tetrahedra that stay good enough?
    let target = mesh.x[b as usize];
    let mut worst = f64::INFINITY;
    let mut insert = Vec::new();
    for &t in star {
        let tet = mesh.tets[t as usize];
        if tet.contains(&b) {
            continue;
        }
        let corners = tet.map(|v| if v == a { target } else { mesh.x[v as usize] });
        worst = worst.min(quality(corners));
        if worst <= floor.above(old) {
            return None;
        }
        insert.push(NewTet {
            corners: tet.map(|v| if v == a { b } else { v }),
            region: mesh.regions[t as usize],
        });
    }
    if insert.is_empty() {
        return None;
    }
    let link = EdgeLink::new(mesh, a, b)?;
    let edge = allowed(mesh, a, b, &link)?;
    if !keeps_topology(mesh, edge, &link) {
        return None;
    }
    if edge.on_surface && !surface_stays(mesh, a, b, field, tolerance) {
        return None;
    }
    let remove = star.to_vec();
    let mut proposal = Proposal::swap(Operation::Contraction, worst - old, remove, insert);
    proposal.edge = Some(edge);
    Some(proposal)
}

/// Do the surface triangles around `a` keep their direction, and stay near the isosurface?
fn surface_stays(
    mesh: &EditableMesh,
    a: u32,
    b: u32,
    field: Option<&Isosurface<'_>>,
    tolerance: f64,
) -> bool {
    let at = |v: u32| mesh.x[v as usize];
    let normal = |p: Point3, q: Point3, r: Point3| -> Option<Vector3> {
        (q - p).cross(&(r - p)).try_normalize(0.0)
    };
    let freedom = mesh.freedom[a as usize];
    let field = field.filter(|_| freedom.on_field());
    // Beside a curve some triangles are of the wall.
    let plane = freedom.plane();
    let wall =
        |corners: [u32; 3]| plane.is_some_and(|plane| corners.iter().all(|&u| plane.holds(&at(u))));
    VertexLink::of(mesh, a).surface.iter().all(|&[u, v]| {
        if u == b || v == b {
            return true;
        }
        let (Some(before), Some(after)) =
            (normal(at(a), at(u), at(v)), normal(at(b), at(u), at(v)))
        else {
            return false;
        };
        let middle = Point3::from((at(b).coords + at(u).coords + at(v).coords) / 3.0);
        let on_field = |f: &Isosurface<'_>| f.distance(&middle) <= tolerance;
        before.dot(&after) >= TURN && (wall([b, u, v]) || field.is_none_or(on_field))
    })
}
