//! Curves in which plane walls meet the isosurface.
//!
//! A mesher that puts one vertex into a cell, or one cut on an edge, cannot put it onto the plane of a membrane and onto the
//! molecule wherever both pass. What it misses is known, though: the rest of the wall lies in its plane exactly, and the
//! isosurface is that of the field. So planes are read off the flat parts of walls, and vertices where a wall, the isosurface
//! and three regions meet may move along the curve of both.

use geom_core::Point3;
use geom_core::compute::parallel;
use geom_core::mesh::{Region, VertexKind};

use super::fans::{InterfaceFaces, is_disk, pages};
use super::field::Isosurface;
use super::plane::{Plane, PlaneFit};
use crate::error::Error;
use crate::mesh::editable::{EditableMesh, Freedom};

/// Most planes that are told apart: a wall of more is taken for curved.
const PLANES: usize = 64;
/// Farthest from its plane, and from the isosurface to first order, that a vertex of a curve may lie, in longest edges of the
/// interfaces around it.
const REACH: f64 = 2.0;

/// Distance from a plane up to which what a mesher left of a wall counts as plane, in the same.
const NEAR: f64 = 0.5;
/// How many edges away from a vertex the wall is asked whether it is plane.
const RINGS: usize = 3;

/// A plane that a part of the wall between two regions lies in.
struct WallPlane {
    pair: [Region; 2],
    plane: Plane,
}

/// Frees the vertices on curves in which walls meet the isosurface, and those of walls beside them. A wall is an
/// interface between two regions that the isosurface cannot part: `may_differ` says whether it may.
///
/// # Errors
/// A field that is no number at such a vertex.
pub(super) fn join_curves(
    mesh: &mut EditableMesh,
    faces: &InterfaceFaces,
    field: &Isosurface<'_>,
    may_differ: impl Fn([Region; 2]) -> bool + Sync,
) -> Result<(), Error> {
    let planes = planes_of(mesh, faces, &may_differ);
    if planes.is_empty() {
        return Ok(());
    }
    let state = &*mesh;
    let found = parallel::map(state.x.len(), |v| {
        let v = v as u32;
        match curve_at(state, v, faces, &planes, &may_differ) {
            Some(plane) => {
                let reach = REACH * longest(state, v, faces);
                let holds = field.holds(v, &state.x[v as usize], reach)?;
                Ok(holds.then_some(plane))
            }
            None => Ok(None),
        }
    });
    let found: Vec<Option<Plane>> = found.into_iter().collect::<Result<_, Error>>()?;
    for (freedom, plane) in mesh.freedom.iter_mut().zip(found) {
        if let Some(plane) = plane {
            *freedom = Freedom::Curve(plane);
        }
    }
    let state = &*mesh;
    let beside = parallel::map(state.x.len(), |v| {
        plane_beside(state, v as u32, faces, &planes)
    });
    for (freedom, plane) in mesh.freedom.iter_mut().zip(beside) {
        if let Some(plane) = plane {
            *freedom = Freedom::Plane(plane.normal);
        }
    }
    Ok(())
}

/// The planes of walls, fitted to all vertices around which they are flat.
/// Meshers find each of them by a search of its own, or round it, to a billionth of an edge or so: a single fan would tilt
/// the plane.
fn planes_of(
    mesh: &EditableMesh,
    faces: &InterfaceFaces,
    may_differ: impl Fn([Region; 2]) -> bool,
) -> Vec<WallPlane> {
    let mut fits: Vec<([Region; 2], PlaneFit)> = Vec::new();
    for (v, freedom) in mesh.freedom.iter().enumerate() {
        let (Freedom::Plane(normal), true) = (*freedom, off_box(mesh.kinds[v])) else {
            continue;
        };
        let (fan, x) = (faces.of(v as u32), &mesh.x[v]);
        let pair = fan[0].pair;
        if may_differ(pair) {
            continue;
        }
        let known = fits
            .iter()
            .position(|(of, fit)| *of == pair && fit.takes(x, &normal));
        let at = known.unwrap_or(fits.len());
        if at == PLANES {
            return Vec::new();
        }
        if known.is_none() {
            fits.push((pair, PlaneFit::at(*x, normal)));
        }
        let around = fan.iter().map(|f| &mesh.x[f.others[0] as usize]);
        around.for_each(|x| fits[at].1.add(x));
    }
    let wall = |(pair, fit): &([Region; 2], PlaneFit)| WallPlane {
        pair: *pair,
        plane: fit.plane(),
    };
    fits.iter().map(wall).collect()
}

fn off_box(kind: VertexKind) -> bool {
    matches!(kind, VertexKind::Interior | VertexKind::Surface)
}

/// The longest edge of the interfaces around a vertex.
fn longest(mesh: &EditableMesh, v: u32, faces: &InterfaceFaces) -> f64 {
    let at = |u: u32| mesh.x[u as usize];
    let lengths = faces.of(v).iter().map(|f| (at(f.others[0]) - at(v)).norm());
    lengths.fold(0.0, f64::max)
}

/// The plane of the wall that ends in a vertex where it meets what the isosurface parts from two others: the nearest one,
/// unless most of the wall near by leads away from it, as that of a cylinder does beside its ends.
fn curve_at(
    mesh: &EditableMesh,
    v: u32,
    faces: &InterfaceFaces,
    planes: &[WallPlane],
    may_differ: impl Fn([Region; 2]) -> bool,
) -> Option<Plane> {
    let fan = faces.of(v);
    if fan.is_empty() || !off_box(mesh.kinds[v as usize]) {
        return None;
    }
    let pages = pages(fan)?;
    let mut walls = pages.iter().filter(|page| !may_differ(page.pair));
    let (wall, None) = (walls.next()?, walls.next()) else {
        return None;
    };
    let height = |plane: &Plane| plane.height(&mesh.x[v as usize]).abs();
    let own = planes.iter().filter(|known| known.pair == wall.pair);
    let nearest = own
        .map(|known| known.plane)
        .min_by(|a, b| height(a).total_cmp(&height(b)))?;
    let wall = wall_around(v, wall.pair, faces);
    let edge = longest(mesh, v, faces);
    let near = |&&u: &&u32| nearest.height(&mesh.x[u as usize]).abs() <= NEAR * edge;
    let plane = 2 * wall.iter().filter(near).count() >= wall.len();
    (plane && height(&nearest) <= REACH * edge).then_some(nearest)
}

/// The vertices within a wall that are a few edges from one where it ends.
fn wall_around(v: u32, pair: [Region; 2], faces: &InterfaceFaces) -> Vec<u32> {
    let mut met = vec![v];
    let mut last = 0;
    for _ in 0..RINGS {
        let ring = met.len();
        for i in last..ring {
            let own = faces.of(met[i]).iter().filter(|f| f.pair == pair);
            for u in own.flat_map(|f| f.others) {
                if !met.contains(&u) {
                    met.push(u);
                }
            }
        }
        last = ring;
    }
    met.retain(|&u| is_disk(faces.of(u)));
    met
}

/// The plane in which a vertex of a wall may move, all around which the wall is plane or has yet to become so.
fn plane_beside(
    mesh: &EditableMesh,
    v: u32,
    faces: &InterfaceFaces,
    planes: &[WallPlane],
) -> Option<Plane> {
    let fan = faces.of(v);
    let fixed = mesh.freedom[v as usize] == Freedom::Fixed && off_box(mesh.kinds[v as usize]);
    if !fixed || !is_disk(fan) {
        return None;
    }
    let plane = |known: &&WallPlane| {
        let on = |x: &Point3| known.plane.holds(x);
        let ends = |u: u32| mesh.freedom[u as usize] == Freedom::Curve(known.plane);
        known.pair == fan[0].pair
            && on(&mesh.x[v as usize])
            && fan
                .iter()
                .map(|f| f.others[0])
                .all(|u| on(&mesh.x[u as usize]) || ends(u))
    };
    planes.iter().find(plane).map(|known| known.plane)
}
