//! Where the wanted edges are too long for the surface, and shorter ones there.
//!
//! Only what is seen counts: a triangle below the angle, or a place beyond the distance, asks for shorter edges around
//! it, and rounds follow there. Where nothing is missed nothing is shortened, and lengths stay as asked for.

use crate::compute::parallel;
use crate::nalgebra::center;
use crate::search::bvh::TriangleTree;
use crate::search::crossing::crossing_pairs;
use crate::{Point3, TriMesh};

use super::mesh::{FACING, Kind, Mesh, NONE, Vertex, facing, previous};
use super::reference::{Reference, centroid};
use super::report::{Cause, Exception};
use crate::mesh::quality::angles;

/// Finds triangles whose angles and places whose distances miss the goals, and asks for shorter edges
/// there. How many places are new? Lengths never grow again.
pub(super) fn shorten(
    mesh: &mut Mesh,
    reference: &mut Reference<'_>,
    points: &[Point3],
    least_angle: f64,
) -> usize {
    let mut places = narrow(mesh, least_angle);
    if reference.allowed.is_finite() {
        places.extend(far(mesh, reference, points));
    }
    parallel::for_each(&mut places, |_, (p, length)| {
        *length = length.max(reference.shortest_near(p));
    });
    places.extend(knotted(mesh, reference));
    let mut spots = std::mem::take(&mut reference.spots);
    let added = spots.add(places, |p| reference.wanted_near(p));
    reference.spots = spots;
    if added > 0 {
        apply(mesh, reference);
    }
    added
}

/// Gives the vertices the lengths that are wanted now.
pub(super) fn apply(mesh: &mut Mesh, reference: &Reference<'_>) {
    parallel::for_each(&mut mesh.vertices, |_, vertex| {
        (vertex.size, vertex.active) = reference.spots.at(&vertex.position, vertex.wanted);
    });
}

/// Between two kept edges the input has the angle at the start of `h`, and nothing opens it.
pub(super) fn is_given(mesh: &Mesh, h: u32) -> bool {
    mesh.is_feature(h)
        && mesh.is_feature(previous(h))
        && mesh.vertices[mesh.from(h) as usize].kind == Kind::Corner
}

/// The living triangles with smaller angles, and why they are left.
pub(super) fn exceptions(
    mesh: &Mesh,
    reference: &Reference<'_>,
    least_angle: f64,
) -> Vec<Exception> {
    let living =
        (0..mesh.triangles.len() as u32).filter(|&t| mesh.triangles[t as usize][0] != NONE);
    let judge = |(number, t): (usize, u32)| {
        let vertices = mesh.triangles[t as usize].map(|v| &mesh.vertices[v as usize]);
        let angles = angles(vertices.map(|v| v.position));
        let smallest = (0..3).min_by(|&i, &j| angles[i].total_cmp(&angles[j]))?;
        if angles[smallest] >= least_angle {
            return None;
        }
        let floor = |v: &Vertex| v.size <= 1.05 * reference.shortest_near(&v.position);
        let cause = if is_given(mesh, 3 * t + smallest as u32) {
            Cause::KeptEdges
        } else if reference.has_level() && vertices.iter().any(|v| reference.is_off_level(v)) {
            Cause::OffLevel
        } else if facing(vertices) < FACING {
            Cause::Fold
        } else if vertices.into_iter().any(floor) {
            Cause::Narrow
        } else {
            Cause::NothingHelped
        };
        Some(Exception {
            triangle: number as u32,
            angle_deg: angles[smallest].to_degrees(),
            cause,
        })
    };
    living.enumerate().filter_map(judge).collect()
}

/// The places of triangles with smaller angles: their shortest edges tell how narrow the surface is. They are asked for
/// a fifth more than that, but for no less than 0.4 and no more than 3/4 of what is wanted there now.
fn narrow(mesh: &Mesh, least_angle: f64) -> Vec<(Point3, f64)> {
    let mut places = Vec::new();
    for t in 0..mesh.triangles.len() as u32 {
        let corners = mesh.triangles[t as usize];
        if corners[0] == NONE {
            continue;
        }
        let vertices = corners.map(|v| &mesh.vertices[v as usize]);
        let angles = angles(vertices.map(|v| v.position));
        let small = |k: u32| angles[k as usize] < least_angle && !is_given(mesh, 3 * t + k);
        if !(0..3).any(small) {
            continue;
        }
        let shortest = (3 * t..3 * t + 3)
            .map(|h| mesh.length(h))
            .fold(f64::INFINITY, f64::min);
        for vertex in vertices {
            let length = (1.2 * shortest).clamp(0.4 * vertex.size, 0.75 * vertex.size);
            places.push((vertex.position, length));
        }
    }
    places
}

/// The pairs of triangles that cross each other, as they may where parts of a surface are nearer to each other than edges
/// are long; none if some of the input do.
fn crossing(mesh: &Mesh, reference: &Reference<'_>) -> Vec<[u32; 2]> {
    let pairs = crossing_pairs(&mesh.surface());
    if pairs.is_empty() || reference.crosses_itself() {
        return Vec::new();
    }
    pairs
}

/// Do triangles cross each other, and none of the input?
pub(super) fn crosses(mesh: &Mesh, reference: &Reference<'_>) -> bool {
    !crossing(mesh, reference).is_empty()
}

/// The corners of triangles that cross each other: what is asked for are edges a third shorter, down to a third of what was
/// asked for also where those of the input are longer: sheets may be near to each other whose triangles are large.
fn knotted(mesh: &Mesh, reference: &Reference<'_>) -> Vec<(Point3, f64)> {
    let living: Vec<&[u32; 3]> = mesh.triangles.iter().filter(|t| t[0] != NONE).collect();
    let pairs = crossing(mesh, reference);
    let corners = pairs.into_iter().flatten().flat_map(|t| living[t as usize]);
    let vertices = corners.map(|&v| &mesh.vertices[v as usize]);
    let least = |v: &Vertex| (v.wanted / 3.0).min(reference.shortest_near(&v.position));
    vertices
        .map(|v| (v.position, (0.7 * v.size).max(least(v))))
        .collect()
}

/// Places of the mesh that are too far from the surface, and of the surface from the mesh. Both ways: from middles of
/// the mesh to the surface, and from samples of the input to the mesh.
fn far(mesh: &Mesh, reference: &Reference<'_>, points: &[Point3]) -> Vec<(Point3, f64)> {
    let farthest = reference.allowed;
    let first = reference.spots.is_empty();
    // Distances of chords shrink with the square of their lengths.
    let shorter = |size: f64, distance: f64| {
        (distance > farthest).then(|| (0.8 * farthest / distance).sqrt().clamp(0.5, 0.75) * size)
    };
    let asked = |t: &u32| {
        let corners = mesh.triangles[*t as usize];
        corners[0] != NONE
            && (first
                || corners.iter().any(|&v| {
                    let v = &mesh.vertices[v as usize];
                    v.size < v.wanted
                }))
    };
    let mut places: Vec<(Point3, f64)> = parallel::flat_map(mesh.triangles.len(), |t| {
        let asked = Some(t as u32).filter(asked);
        asked.into_iter().flat_map(|t| {
            let corners = mesh.triangles[t as usize].map(|v| &mesh.vertices[v as usize]);
            let size = corners.iter().map(|v| v.size).fold(f64::INFINITY, f64::min);
            let [a, b, c] = corners.map(|v| v.position);
            [
                center(&a, &b),
                center(&b, &c),
                center(&c, &a),
                centroid([a, b, c]),
            ]
            .into_iter()
            .filter_map(move |p| Some((p, shorter(size, reference.distance(&p, farthest))?)))
        })
    });
    // Later only what has changed needs to be seen again.
    let part = if first {
        mesh.surface()
    } else {
        shortened(mesh)
    };
    let Ok(tree) = TriangleTree::new(&part) else {
        return places;
    };
    places.append(&mut parallel::flat_map(points.len(), |i| {
        let p = &points[i];
        if !first && !reference.spots.reach(p) {
            return None;
        }
        let wanted = reference.wanted_near(p);
        let size = reference.spots.at(p, wanted).0;
        // Beyond this the nearest triangle may be one that is left out.
        if !first && size > 0.8 * wanted || tree.closest_within(p, farthest).is_some() {
            return None;
        }
        let p = reference.on_surface(p, size).map_or(*p, |v| v.position);
        Some((p, shorter(size, tree.closest(&p).distance)?))
    }));
    places
}

/// The triangles with edges that are wanted shorter than asked for.
fn shortened(mesh: &Mesh) -> TriMesh {
    let mut positions = Vec::new();
    for &corners in mesh.triangles.iter().filter(|t| t[0] != NONE) {
        let vertices = corners.map(|v| &mesh.vertices[v as usize]);
        if vertices.iter().any(|v| v.size < v.wanted) {
            positions.extend(vertices.map(|v| v.position));
        }
    }
    let triangles = (0..positions.len() as u32 / 3)
        .map(|t| [3 * t, 3 * t + 1, 3 * t + 2])
        .collect();
    TriMesh::new(positions, triangles).expect("corners are finite")
}

/// From the points of the input to the result, straight or after their way to the level set, whichever
/// is nearer: the largest.
pub(super) fn farthest_from(result: &TriMesh, reference: &Reference<'_>, points: &[Point3]) -> f64 {
    let tree = TriangleTree::new(result).expect("a remeshed surface has triangles");
    let parts = parallel::fold_chunks(points.len(), |range| {
        points[range].iter().fold(0.0f64, |largest, p| {
            // What is near enough as it is needs no way to the level set.
            if tree.closest_within(p, largest).is_some() {
                return largest;
            }
            let size = reference.wanted_near(p);
            let there = reference.on_surface(p, size).map_or(*p, |v| v.position);
            let nearer = tree.closest(p).distance.min(tree.closest(&there).distance);
            largest.max(nearer)
        })
    });
    parts.into_iter().fold(0.0, f64::max)
}
