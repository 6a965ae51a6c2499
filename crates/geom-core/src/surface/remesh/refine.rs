//! Where the wanted edges are too long for the surface, and shorter ones there.

use std::collections::BTreeMap;

use crate::compute::parallel;
use crate::nalgebra::center;
use crate::search::bvh::TriangleTree;
use crate::{Point3, TriMesh};
use rayon::prelude::*;

use super::mesh::{Kind, Mesh, NONE, Vertex, previous};
use super::reference::Reference;
use super::steps::{FACING, facing};
use super::{Cause, Exception};
use crate::mesh::quality::angles;

/// Places with a wanted length of their own, which grows with the distance from them.
#[derive(Default)]
pub(super) struct Spots {
    /// Growth of the length per Å.
    slope: f64,
    /// Edge of the cubes that the spots are looked up by; at least as long as any spot reaches.
    cell: f64,
    spots: Vec<(Point3, f64)>,
    /// Spots from here on are new.
    fresh: usize,
    /// Every place is new.
    everywhere: bool,
    cells: BTreeMap<[i64; 3], Vec<u32>>,
}

impl Spots {
    pub(super) fn new(slope: f64, longest: f64) -> Self {
        Self {
            slope,
            cell: longest / slope,
            spots: Vec::new(),
            fresh: 0,
            everywhere: true,
            cells: BTreeMap::new(),
        }
    }

    fn key(&self, p: &Point3) -> [i64; 3] {
        [p.x, p.y, p.z].map(|c| (c / self.cell).floor() as i64)
    }

    /// Lets every place be new, for a start from the input.
    pub(super) fn renew(&mut self) {
        self.everywhere = true;
    }

    /// May any spot have a say at `p`?
    fn reach(&self, p: &Point3) -> bool {
        self.cells.contains_key(&self.key(p))
    }

    /// The length at `p` where `wanted` is asked for, and whether the newest spots have a say in it.
    pub(super) fn at(&self, p: &Point3, wanted: f64) -> (f64, bool) {
        if self.spots.is_empty() {
            return (wanted, self.everywhere);
        }
        let (mut old, mut new) = (wanted, wanted);
        for &i in self.cells.get(&self.key(p)).into_iter().flatten() {
            let (spot, length) = &self.spots[i as usize];
            let length = length + self.slope * (p - spot).norm();
            if (i as usize) < self.fresh {
                old = old.min(length);
            } else {
                new = new.min(length);
            }
        }
        (old.min(new), self.everywhere || new < old)
    }

    /// Takes up the places where the length is to be shorter than it is; how many are new?
    fn add(&mut self, mut places: Vec<(Point3, f64)>, reference: &Reference<'_>) -> usize {
        // The shortest first; what they cover needs no spot of its own.
        places.sort_by(|(p, s), (q, t)| {
            let order = |a: &Point3, b: &Point3| {
                a.x.total_cmp(&b.x)
                    .then(a.y.total_cmp(&b.y))
                    .then(a.z.total_cmp(&b.z))
            };
            s.total_cmp(t).then_with(|| order(p, q))
        });
        self.fresh = self.spots.len();
        self.everywhere = false;
        for (p, length) in places {
            let wanted = reference.wanted_near(&p);
            if length >= 0.95 * self.at(&p, wanted).0 {
                continue;
            }
            let number = self.spots.len() as u32;
            self.spots.push((p, length));
            let [x, y, z] = self.key(&p);
            for k in 0..27 {
                let near = [x + k % 3 - 1, y + k / 3 % 3 - 1, z + k / 9 - 1];
                self.cells.entry(near).or_default().push(number);
            }
        }
        self.spots.len() - self.fresh
    }
}

/// Finds triangles whose angles and places whose distances miss the goals, and asks for shorter edges
/// there. How many places are new?
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
    places
        .par_iter_mut()
        .for_each(|(p, length)| *length = length.max(reference.shortest_near(p)));
    let mut spots = std::mem::take(&mut reference.spots);
    let added = spots.add(places, reference);
    reference.spots = spots;
    if added > 0 {
        apply(mesh, reference);
    }
    added
}

/// Gives the vertices the lengths that are wanted now.
pub(super) fn apply(mesh: &mut Mesh, reference: &Reference<'_>) {
    mesh.vertices.par_iter_mut().for_each(|vertex| {
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

/// The places of triangles with smaller angles: their shortest edges tell how narrow the surface is.
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

/// Places of the mesh that are too far from the surface, and of the surface from the mesh.
fn far(mesh: &Mesh, reference: &Reference<'_>, points: &[Point3]) -> Vec<(Point3, f64)> {
    let farthest = reference.allowed;
    let first = reference.spots.spots.is_empty();
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
    let mut places: Vec<(Point3, f64)> = (0..mesh.triangles.len() as u32)
        .into_par_iter()
        .filter(asked)
        .flat_map_iter(|t| {
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
        .collect();
    // Later only what has changed needs to be seen again.
    let part = if first {
        mesh.surface()
    } else {
        shortened(mesh)
    };
    let Ok(tree) = TriangleTree::new(&part) else {
        return places;
    };
    places.par_extend(points.par_iter().filter_map(|p| {
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

fn centroid([a, b, c]: [Point3; 3]) -> Point3 {
    Point3::from((a.coords + b.coords + c.coords) / 3.0)
}

/// The middles of the edges and the centroids of the triangles.
pub(super) fn middles(mesh: &TriMesh) -> Vec<Point3> {
    let mut points = Vec::with_capacity(5 * mesh.triangles().len() / 2);
    for (t, corners) in mesh.triangles().iter().enumerate() {
        let p = mesh.corners(t);
        for k in 0..3 {
            // Of an edge between two triangles, once.
            if corners[k] < corners[(k + 1) % 3] {
                points.push(center(&p[k], &p[(k + 1) % 3]));
            }
        }
        points.push(centroid(p));
    }
    points
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
