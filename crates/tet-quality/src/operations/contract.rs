//! Contraction of an edge: one end moves onto the other, and the tetrahedra between them vanish.

use geom_core::mesh::VertexKind;
use geom_core::{Point3, Vector3};

use crate::boundary::field::Isosurface;
use crate::measure::metrics::quality;
use crate::mesh::editable::{Freedom, Work};
use crate::mesh::link::{EdgeRing, Link, keeps_topology};
use crate::mesh::proposal::{Floor, Operation, Proposal};

/// Cosine between the normals of a surface triangle before and after.
const TURN: f64 = 0.5;

/// May `a` vanish into `b` as far as the geometry of boundary and interfaces is concerned? Gives
/// whether the edge lies on the interface.
fn allowed(work: &Work, a: u32, b: u32, ring: &EdgeRing) -> Option<bool> {
    let freedom = work.freedom[a as usize];
    if freedom == Freedom::Free {
        return Some(false);
    }
    // The edge must lie on an interface; `a` lies on only one.
    if ring.interior() || freedom == Freedom::Fixed {
        return None;
    }
    let along = work.x[b as usize] - work.x[a as usize];
    let stays = match freedom {
        Freedom::Line(d) => along.cross(&d).norm() <= 1e-9 * along.norm(),
        Freedom::Plane(n) => along.dot(&n).abs() <= 1e-9 * along.norm(),
        _ => true,
    };
    // A vertex of a box edge goes only to another one of it, or to its end.
    let kinds_fit = match work.kinds[a as usize] {
        VertexKind::BoxEdge { .. } => matches!(
            work.kinds[b as usize],
            VertexKind::BoxEdge { .. } | VertexKind::Fixed
        ),
        _ => true,
    };
    (stays && kinds_fit).then_some(true)
}

/// Contraction of `a` into `b`. `tolerance`: largest distance of the middle of a new surface triangle
/// from the isosurface.
pub(crate) fn contraction(
    work: &Work,
    a: u32,
    b: u32,
    field: Option<&Isosurface<'_>>,
    tolerance: f64,
    floor: Floor,
) -> Option<Proposal> {
    if work.freedom[a as usize] == Freedom::Fixed {
        return None;
    }
    let star = work.rings.of(a);
    let old = star
        .iter()
        .map(|&t| work.q[t as usize])
        .fold(f64::INFINITY, f64::min);
    if old <= 0.0 {
        return None;
    }
    let target = work.x[b as usize];
    let mut worst = f64::INFINITY;
    let mut insert = Vec::new();
    for &t in star {
        let tet = work.tets[t as usize];
        if tet.contains(&b) {
            continue;
        }
        let corners = tet.map(|v| if v == a { target } else { work.x[v as usize] });
        worst = worst.min(quality(corners));
        if worst <= floor.above(old) {
            return None;
        }
        insert.push((
            tet.map(|v| if v == a { b } else { v }),
            work.regions[t as usize],
        ));
    }
    if insert.is_empty() {
        return None;
    }
    let ring = EdgeRing::new(work, a, b)?;
    let on_surface = allowed(work, a, b, &ring)?;
    if !keeps_topology(work, a, b, &ring, on_surface) {
        return None;
    }
    if on_surface && !surface_stays(work, a, b, field, tolerance) {
        return None;
    }
    let remove = star.to_vec();
    let mut proposal = Proposal::swap(Operation::Contraction, worst - old, remove, insert);
    proposal.edge = Some((a, b, on_surface));
    Some(proposal)
}

/// Do the surface triangles around `a` keep their direction, and stay near the isosurface?
fn surface_stays(
    work: &Work,
    a: u32,
    b: u32,
    field: Option<&Isosurface<'_>>,
    tolerance: f64,
) -> bool {
    let at = |v: u32| work.x[v as usize];
    let normal = |p: Point3, q: Point3, r: Point3| -> Option<Vector3> {
        (q - p).cross(&(r - p)).try_normalize(0.0)
    };
    let field = field.filter(|_| work.freedom[a as usize] == Freedom::Field);
    Link::of(work, a).surface.iter().all(|&[u, v]| {
        if u == b || v == b {
            return true;
        }
        let (Some(before), Some(after)) =
            (normal(at(a), at(u), at(v)), normal(at(b), at(u), at(v)))
        else {
            return false;
        };
        let middle = Point3::from((at(b).coords + at(u).coords + at(v).coords) / 3.0);
        before.dot(&after) >= TURN && field.is_none_or(|f| f.distance(&middle) <= tolerance)
    })
}
