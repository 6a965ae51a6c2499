//! The steps of a round. Each change is tested first and undone by not being done.
//!
//! | step | is done to an edge that | and refused where |
//! |---|---|---|
//! | split | is longer than 4/3 of the wanted length, the longest first | never; where the new vertex would fold the surface it stays on the edge |
//! | contract | is shorter than 4/5 of it, the shortest first | the link condition fails, a triangle turns over, or an edge becomes too long |
//! | flip | brings valences nearer to six, or angles up | the new edge is there already, or triangles turn over |
//! | move | (vertices) within the tangent plane to the mean of the neighbours, back to the surface | a triangle turns over |

use std::ops::AddAssign;

use crate::compute::coloring::Coloring;
use crate::compute::parallel;
use crate::nalgebra::center;
use crate::search::bvh::closest_in_triangle;
use crate::{Point3, Vector3};

use super::kept::Course;
use super::mesh::{FACING, Kind, Mark, Mesh, NONE, Vertex, doubled_normal, facing, next, previous};
use super::reference::{EXACT, Reference};
use crate::mesh::quality::{edge_lengths, radius_ratio};

/// Edges longer than this, in units of the wanted length, are split. Its halves are then as much too short as it was
/// too long, by a third (Botsch and others, *Polygon Mesh Processing*, 2010, ch. 6).
pub(super) const LONG: f64 = 4.0 / 3.0;
/// Edges shorter than this are contracted. A neighbour of the same length grows by half then, to 6/5: as much too long
/// as both were too short (the same).
pub(super) const SHORT: f64 = 4.0 / 5.0;
/// No flip, and no work on small angles, makes edges longer than this.
const STRETCHED: f64 = 1.1 * LONG;
/// Least cosine between the normals of a triangle before and after, where a crease leaves the
/// surface without a normal.
const TURN: f64 = 0.5;
/// How near to the level set vertices come while they still move, as a share of their edges.
const NEAR: f64 = 0.03;
/// Shorter ways, as a share of the edges, are not worth going.
const STILL: f64 = 0.01;
/// A change may lower the least quality around it only as far as this.
const FAIR: f64 = 0.4;

/// Changes of the topology.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Counts {
    pub(super) splits: usize,
    pub(super) contractions: usize,
    pub(super) flips: usize,
}

impl Counts {
    pub(super) fn total(&self) -> usize {
        self.splits + self.contractions + self.flips
    }
}

impl AddAssign for Counts {
    fn add_assign(&mut self, other: Self) {
        self.splits += other.splits;
        self.contractions += other.contractions;
        self.flips += other.flips;
    }
}

/// What a change must not make worse: the least quality and the least facing of some triangles. Measured before the
/// change, so that places which are bad already may be worked on.
#[derive(Clone, Copy)]
struct Worst {
    quality: f64,
    facing: f64,
}

impl Worst {
    const NONE: Self = Self {
        quality: f64::INFINITY,
        facing: f64::INFINITY,
    };

    fn include(&mut self, corners: [&Vertex; 3]) {
        self.quality = self.quality.min(radius_ratio(corners.map(|v| v.position)));
        self.facing = self.facing.min(facing(corners));
    }

    fn of_fan(mesh: &Mesh, v: u32) -> Self {
        let mut worst = Self::NONE;
        for h in mesh.fan(v) {
            worst.include(of_triangle(mesh, h / 3));
        }
        worst
    }

    /// May a triangle of these corners take part in the place of those measured?
    fn admits(&self, corners: [&Vertex; 3], fair: f64) -> bool {
        facing(corners) >= self.facing.min(FACING)
            && radius_ratio(corners.map(|v| v.position)) >= self.quality.min(fair)
    }
}

fn of_triangle(mesh: &Mesh, t: u32) -> [&Vertex; 3] {
    mesh.triangles[t as usize].map(|v| &mesh.vertices[v as usize])
}

/// Does a triangle keep its sense when one corner moves? Asked where the surface has no normal. Corners on creases have
/// no normal, so there the triangle is compared with itself before.
fn keeps_sense(before: [&Vertex; 3], after: [&Vertex; 3]) -> bool {
    if after.iter().all(|v| v.normal != Vector3::zeros()) {
        return true;
    }
    let normals = [before, after].map(|c| doubled_normal(c.map(|v| v.position)));
    normals[0].dot(&normals[1]) >= TURN * normals[0].norm() * normals[1].norm()
}

/// One round of all steps. Topology on one thread, in the order of lengths or numbers; places of vertices in parallel.
pub(super) fn round(mesh: &mut Mesh, reference: &Reference<'_>) -> Counts {
    let mut done = split_long(mesh, reference);
    done += contract_short(mesh, reference);
    done += flip_for_valence(mesh);
    relax(mesh, reference);
    done += flip_for_angle(mesh);
    done
}

/// Splits edges that are too long, the longest first, until none is left or none may be.
fn split_long(mesh: &mut Mesh, reference: &Reference<'_>) -> Counts {
    let mut counts = Counts::default();
    // Each pass halves the longest edges; 2²⁴ times too long is more than an index can name.
    for _ in 0..24 {
        let mut long: Vec<(u64, u32)> = mesh
            .edges()
            .filter(|&h| mesh.is_active(h))
            .filter_map(|h| {
                let length = mesh.relative_length(h);
                // Positive numbers sort like their bits.
                (length > LONG).then(|| (!length.to_bits(), h))
            })
            .collect();
        long.sort_unstable();
        // The new places depend on the ends only: all at once.
        let new: Vec<Vertex> = parallel::map_each(&long, |&(_, h)| middle(mesh, reference, h));
        let ends: Vec<(u32, u32)> = long
            .iter()
            .map(|&(_, h)| (mesh.from(h), mesh.to(h)))
            .collect();
        let before = counts.splits;
        for ((&(_, h), vertex), (from, to)) in long.iter().zip(new).zip(ends) {
            // Another split may have moved the half-edge away.
            if (mesh.from(h), mesh.to(h)) == (from, to) && try_split(mesh, h, vertex) {
                counts.splits += 1;
            }
        }
        if counts.splits == before {
            break;
        }
    }
    counts
}

/// The vertex to put into the middle of an edge: on the surface or curve if that is near.
fn middle(mesh: &Mesh, reference: &Reference<'_>, h: u32) -> Vertex {
    let [a, b] = [mesh.from(h), mesh.to(h)].map(|v| &mesh.vertices[v as usize]);
    let p = center(&a.position, &b.position);
    let reach = 0.5 * (b.position - a.position).norm();
    let found = if mesh.is_feature(h) {
        reference.on_curve(&p, reach, Course::of_edge(mesh, h))
    } else {
        reference.about_on_surface(&p, reach, NEAR)
    };
    found.unwrap_or_else(|| {
        let normal = if mesh.mark(h) == Mark::Crease {
            Vector3::zeros()
        } else {
            (a.normal + b.normal)
                .try_normalize(1e-6)
                .unwrap_or_else(Vector3::zeros)
        };
        let kind = if mesh.is_feature(h) {
            Kind::Curve
        } else {
            Kind::Smooth
        };
        reference.vertex(p, normal, f64::midpoint(a.wanted, b.wanted), kind)
    })
}

/// Splits at the place found, or in the middle of the straight edge if that would turn a triangle away.
fn try_split(mesh: &mut Mesh, h: u32, vertex: Vertex) -> bool {
    let straight = center(&mesh.position(mesh.from(h)), &mesh.position(mesh.to(h)));
    // A vertex that would fold the surface stays on the edge instead, which never folds.
    for position in [vertex.position, straight] {
        let vertex = Vertex { position, ..vertex };
        let fits = [Some(h), mesh.twin(h)].into_iter().flatten().all(|h| {
            let old = of_triangle(mesh, h / 3);
            let [a, b, c] =
                [mesh.from(h), mesh.to(h), mesh.opposite(h)].map(|v| &mesh.vertices[v as usize]);
            let least = facing(old).min(FACING);
            [[a, &vertex, c], [&vertex, b, c]]
                .into_iter()
                .all(|new| facing(new) >= least && keeps_sense(old, new))
        });
        if fits || position == straight {
            mesh.split(h, vertex);
            return true;
        }
    }
    false
}

/// Contracts edges that are too short, the shortest first, as long as that makes no edge too long.
fn contract_short(mesh: &mut Mesh, reference: &Reference<'_>) -> Counts {
    let mut counts = Counts::default();
    // Where many edges are short, their neighbours must wait for the next pass.
    for _ in 0..24 {
        let mut short: Vec<(u64, u32)> = mesh
            .edges()
            .filter(|&h| mesh.is_active(h))
            .filter_map(|h| {
                let length = mesh.relative_length(h);
                (length < SHORT).then(|| (length.to_bits(), h))
            })
            .collect();
        short.sort_unstable();
        let before = counts.contractions;
        for (_, h) in short {
            if mesh.from(h) != NONE
                && mesh.relative_length(h) < SHORT
                && try_contract(mesh, reference, h, LONG)
            {
                counts.contractions += 1;
            }
        }
        // The last few are worth no pass.
        if counts.contractions - before <= mesh.triangles.len() / 1000 {
            break;
        }
    }
    counts
}

/// Contracts the edge to its middle or to one of its ends if that keeps the surface, leaves no edge
/// longer than `long`, no triangle worse than fair, and neither end far from the new triangles.
fn try_contract(mesh: &mut Mesh, reference: &Reference<'_>, h: u32, long: f64) -> bool {
    let [a, b] = [mesh.from(h), mesh.to(h)].map(|v| mesh.vertices[v as usize]);
    // Where both ends are held, they stay; along a feature only a corner holds.
    let held = |kind: Kind| {
        kind > if mesh.is_feature(h) {
            Kind::Curve
        } else {
            Kind::Smooth
        }
    };
    if held(a.kind) && held(b.kind) || !mesh.may_contract(h) {
        return false;
    }
    // To the end that is held; else to the middle if that fits, or to an end.
    let mut candidates = Vec::with_capacity(3);
    match (held(a.kind), held(b.kind)) {
        (true, _) => candidates.push(a),
        (_, true) => candidates.push(b),
        _ => candidates.extend([middle(mesh, reference, h), b, a]),
    }
    let mut worst = Worst::of_fan(mesh, mesh.from(h));
    for g in mesh.fan(mesh.to(h)) {
        worst.include(of_triangle(mesh, g / 3));
    }
    // No edge becomes too long, no triangle turns away or becomes worse than those there were.
    for vertex in candidates {
        let fits = [mesh.from(h), mesh.to(h)].into_iter().all(|end| {
            mesh.ring(end).all(|v| {
                let other = &mesh.vertices[v as usize];
                let length = (other.position - vertex.position).norm();
                v == mesh.from(h) || v == mesh.to(h) || length <= long * other.size.min(vertex.size)
            }) && mesh.fan(end).all(|g| {
                let gone = g == h
                    || next(g) == h
                    || previous(g) == h
                    || mesh.twin(h).is_some_and(|t| g / 3 == t / 3);
                gone || {
                    let old = of_triangle(mesh, g / 3);
                    let mut new = old;
                    new[(g % 3) as usize] = &vertex;
                    worst.admits(new, FAIR) && keeps_sense(old, new)
                }
            })
        });
        // Both ends must stay as near to the new triangles as is allowed.
        let stays_near = |end: u32| {
            let p = mesh.position(end);
            let most = reference.allowed * reference.allowed;
            [mesh.from(h), mesh.to(h)]
                .into_iter()
                .flat_map(|v| mesh.fan(v))
                .filter(|&g| {
                    let wing = |w: u32| g / 3 == w / 3;
                    !wing(h) && mesh.twin(h).is_none_or(|t| !wing(t))
                })
                .any(|g| {
                    let mut new = of_triangle(mesh, g / 3);
                    new[(g % 3) as usize] = &vertex;
                    let (_, q) = closest_in_triangle(&p, &new.map(|v| v.position));
                    (q - p).norm_squared() <= most
                })
        };
        if fits && stays_near(mesh.from(h)) && stays_near(mesh.to(h)) {
            mesh.contract(h, vertex);
            return true;
        }
    }
    false
}

/// The two triangles of an edge, and the two that a flip makes of them.
fn flip_pairs(mesh: &Mesh, h: u32, g: u32) -> ([[&Vertex; 3]; 2], [[&Vertex; 3]; 2]) {
    let [a, b, c, d] = [mesh.from(h), mesh.to(h), mesh.opposite(h), mesh.opposite(g)]
        .map(|v| &mesh.vertices[v as usize]);
    ([[a, b, c], [b, a, d]], [[a, d, c], [d, b, c]])
}

/// Grows with the least angle of the triangles: minus its cosine. By the law of cosines, without an arccosine: only
/// comparisons are made. 1 for none, −1 for a triangle with a vanishing edge.
fn openness(triangles: &[[&Vertex; 3]]) -> f64 {
    let of_one = |t: &[&Vertex; 3]| {
        // The smallest angle is opposite to the shortest edge.
        let mut edges = edge_lengths(t.map(|v| v.position));
        edges.sort_by(f64::total_cmp);
        let [a, b, c] = edges;
        if a <= 0.0 {
            return -1.0;
        }
        (a * a - b * b - c * c) / (2.0 * b * c)
    };
    triangles.iter().map(of_one).fold(1.0, f64::min)
}

/// Does the flip keep the surface where it is?
fn flip_keeps_surface(old: &[[&Vertex; 3]; 2], new: &[[&Vertex; 3]; 2]) -> bool {
    let least = facing(old[0]).min(facing(old[1])).min(FACING);
    new.iter()
        .all(|&n| facing(n) >= least && old.iter().all(|&o| keeps_sense(o, n)))
        && {
            // The new edge must not be sharper than the old one, or than a right angle.
            let sharpness = |t: &[[&Vertex; 3]; 2]| {
                let [m, n] = t.map(|c| doubled_normal(c.map(|v| v.position)));
                m.dot(&n) / (m.norm() * n.norm()).max(f64::MIN_POSITIVE)
            };
            sharpness(new) >= sharpness(old).min(0.5)
        }
}

/// Flips an edge that is not kept, if `wanted` says so, connectivity allows it, it makes no long edge longer, and the
/// surface stays.
fn flip_if(mesh: &mut Mesh, h: u32, wanted: impl Fn(&Mesh, u32, u32) -> bool) -> bool {
    let Some(g) = mesh.twin(h) else { return false };
    if mesh.is_feature(h) || !wanted(mesh, h, g) || !mesh.may_flip(h) {
        return false;
    }
    let (old, new) = flip_pairs(mesh, h, g);
    let [c, d] = [new[0][2], new[0][1]];
    let length = (d.position - c.position).norm();
    if length > mesh.length(h) && length > STRETCHED * c.size.min(d.size) {
        return false;
    }
    if !flip_keeps_surface(&old, &new) {
        return false;
    }
    mesh.flip(h);
    true
}

/// Flips edges where that brings the numbers of neighbours nearer to six, or four on a boundary,
/// without spoiling the angles. An angle may become smaller by it as long as it stays above 20°, about: rounds that
/// follow open it again.
fn flip_for_valence(mesh: &mut Mesh) -> Counts {
    let mut valence: Vec<i32> = (0..mesh.vertices.len() as u32)
        .map(|v| mesh.ring(v).count() as i32)
        .collect();
    let ideal: Vec<i32> = (0..mesh.vertices.len() as u32)
        .map(|v| if mesh.on_boundary(v) { 4 } else { 6 })
        .collect();
    let mut flips = 0;
    for h in 0..3 * mesh.triangles.len() as u32 {
        if !mesh.is_first(h) || !mesh.is_active(h) {
            continue;
        }
        let Some(g) = mesh.twin(h) else { continue };
        let around = [mesh.from(h), mesh.to(h), mesh.opposite(h), mesh.opposite(g)];
        let excess = |v: u32, change: i32| {
            let e = valence[v as usize] + change - ideal[v as usize];
            e * e
        };
        let now: i32 = around.iter().map(|&v| excess(v, 0)).sum();
        let then: i32 = around
            .iter()
            .zip([-1, -1, 1, 1])
            .map(|(&v, c)| excess(v, c))
            .sum();
        if then >= now {
            continue;
        }
        let fair = |mesh: &Mesh, h, g| {
            let (old, new) = flip_pairs(mesh, h, g);
            openness(&new) >= openness(&old).min(-0.94)
        };
        if flip_if(mesh, h, fair) {
            for (v, c) in around.into_iter().zip([-1, -1, 1, 1]) {
                valence[v as usize] += c;
            }
            flips += 1;
        }
    }
    Counts {
        flips,
        ..Counts::default()
    }
}

/// Flips edges where that makes the least angle of the two triangles larger.
fn flip_for_angle(mesh: &mut Mesh) -> Counts {
    let mut flips = 0;
    for h in 0..3 * mesh.triangles.len() as u32 {
        if mesh.is_first(h) && mesh.is_active(h) && flip_if(mesh, h, larger_angle) {
            flips += 1;
        }
    }
    Counts {
        flips,
        ..Counts::default()
    }
}

/// Would the least angle of both triangles grow? For all edges of a plane that is Delaunay's criterion.
fn larger_angle(mesh: &Mesh, h: u32, g: u32) -> bool {
    let (old, new) = flip_pairs(mesh, h, g);
    openness(&new) > openness(&old) + 1e-6
}

/// Moves every vertex towards the middle of its triangles within its tangent plane, then back to the
/// surface; colour by colour.
fn relax(mesh: &mut Mesh, reference: &Reference<'_>) {
    move_each(mesh, |mesh, v| relaxed(mesh, reference, v));
}

/// Brings every vertex to the surface exactly.
pub(super) fn settle(mesh: &mut Mesh, reference: &Reference<'_>) {
    move_each(mesh, |mesh, v| {
        let old = &mesh.vertices[v as usize];
        if old.kind != Kind::Smooth {
            return None;
        }
        let new = reference.on_surface(&old.position, old.size)?;
        fits_fan(mesh, v, &new, &Worst::of_fan(mesh, v), FAIR).then_some(new)
    });
}

/// Vertices of one colour have no common triangle: all of them move by what they see before any has moved, so that
/// threads do not matter. Dead ones, and those where wanted lengths did not change, stay.
fn move_each(mesh: &mut Mesh, to: impl Fn(&Mesh, u32) -> Option<Vertex> + Sync) {
    let colors = Coloring::greedy(mesh.vertices.len(), |v| mesh.ring(v));
    for group in &colors.groups {
        let moved: Vec<Option<Vertex>> = parallel::map_each(group, |&v| {
            let moves = mesh.is_alive(v) && mesh.vertices[v as usize].active;
            moves.then(|| to(mesh, v)).flatten()
        });
        for (&v, vertex) in group.iter().zip(moved) {
            if let Some(vertex) = vertex {
                mesh.vertices[v as usize] = vertex;
            }
        }
    }
}

/// Where `v` shall go: smooth vertices to the centre of area of their triangles (in units of wanted areas, which lets
/// lengths adapt), those on curves to the middle of their two neighbours. The whole way, half or a quarter of it,
/// whichever first spoils no triangle.
fn relaxed(mesh: &Mesh, reference: &Reference<'_>, v: u32) -> Option<Vertex> {
    let old = mesh.vertices[v as usize];
    let goal = match old.kind {
        Kind::Corner => return None,
        Kind::Curve => {
            let ends: Vec<Point3> = mesh.curve_ring(v).map(|w| mesh.position(w)).collect();
            center(&ends[0], &ends[1])
        }
        Kind::Smooth => {
            // Triangles count by their area in units of the wanted one, so that lengths adapt.
            let (mut sum, mut total) = (Vector3::zeros(), 0.0);
            for h in mesh.fan(v) {
                let corners = of_triangle(mesh, h / 3);
                let [a, b, c] = corners.map(|c| c.position);
                let size = corners.iter().map(|c| c.size).sum::<f64>() / 3.0;
                let weight = doubled_normal([a, b, c]).norm() / (size * size);
                sum +=
                    ((a - old.position) + (b - old.position) + (c - old.position)) * (weight / 3.0);
                total += weight;
            }
            if total <= 0.0 {
                return None;
            }
            let shift = sum / total;
            old.position + (shift - old.normal * old.normal.dot(&shift))
        }
    };
    if (goal - old.position).norm() < STILL * old.size {
        return None;
    }
    let worst = Worst::of_fan(mesh, v);
    let course = Course::of_vertex(mesh, v);
    for part in [1.0, 0.5, 0.25] {
        let p = old.position + (goal - old.position) * part;
        let reach = old.size;
        let found = match old.kind {
            Kind::Curve => reference.on_curve(&p, reach, course),
            _ => reference.about_on_surface(&p, reach, NEAR),
        };
        let Some(new) = found else { continue };
        if fits_fan(mesh, v, &new, &worst, FAIR) {
            return Some(new);
        }
    }
    None
}

/// May `v` become `new`, as far as its triangles are concerned?
fn fits_fan(mesh: &Mesh, v: u32, new: &Vertex, worst: &Worst, fair: f64) -> bool {
    mesh.fan(v).all(|h| {
        let before = of_triangle(mesh, h / 3);
        let mut after = before;
        after[(h % 3) as usize] = new;
        worst.admits(after, fair) && keeps_sense(before, after)
    })
}

/// Works on triangles whose least angle is below the goal: flips or contracts their edges, and moves their corners so
/// that the least angle around them grows. The worst first. Flips and moves are tried on every pass; contractions from
/// the third on, since they change most.
pub(super) fn lift(mesh: &mut Mesh, reference: &Reference<'_>, goal: f64) -> Counts {
    let goal = -goal.cos();
    let mut counts = Counts::default();
    for pass in 0..12 {
        let mut bad: Vec<(f64, u32)> = (0..mesh.triangles.len() as u32)
            .filter(|&t| mesh.triangles[t as usize][0] != NONE)
            .filter_map(|t| {
                let angle = openness(&[of_triangle(mesh, t)]);
                (angle < goal).then_some((angle, t))
            })
            .collect();
        if bad.is_empty() {
            break;
        }
        bad.sort_by(|(a, s), (b, t)| a.total_cmp(b).then(s.cmp(t)));
        let mut changed = false;
        for (_, t) in bad {
            if mesh.triangles[t as usize][0] == NONE || openness(&[of_triangle(mesh, t)]) >= goal {
                continue;
            }
            let mut edges = [3 * t, 3 * t + 1, 3 * t + 2];
            // Longest first: the flip of that edge helps most.
            edges.sort_by(|&g, &h| mesh.length(h).total_cmp(&mesh.length(g)).then(g.cmp(&h)));
            if edges.into_iter().any(|h| flip_if(mesh, h, larger_angle)) {
                counts.flips += 1;
                changed = true;
                continue;
            }
            let moved = mesh.triangles[t as usize].map(|v| spread(mesh, reference, v));
            changed |= moved.contains(&true);
            if openness(&[of_triangle(mesh, t)]) >= goal || pass < 2 {
                continue;
            }
            if try_contract(mesh, reference, edges[2], STRETCHED) {
                counts.contractions += 1;
                changed = true;
            }
        }
        if !changed {
            break;
        }
    }
    counts
}

/// Moves one vertex along the surface to where the least angle around it is largest, by a search in
/// eight directions with shrinking steps. Did it move?
fn spread(mesh: &mut Mesh, reference: &Reference<'_>, v: u32) -> bool {
    let start = mesh.vertices[v as usize];
    if start.kind == Kind::Corner {
        return false;
    }
    let course = Course::of_vertex(mesh, v);
    // From the level set a small step must not lead away to the input.
    let anywhere = reference.is_off_level(&start);
    // Along the curve, or in eight directions of the tangent plane.
    let directions: Vec<Vector3> = if start.kind == Kind::Curve {
        let ends: Vec<u32> = mesh.curve_ring(v).collect();
        let along = (mesh.position(ends[1]) - mesh.position(ends[0])).normalize();
        vec![along, -along]
    } else {
        let n = start.normal;
        let u = n.cross(&Vector3::ith(n.iamin(), 1.0)).normalize();
        let w = n.cross(&u);
        (0..8)
            .map(|k| {
                let t = std::f64::consts::FRAC_PI_4 * f64::from(k);
                u * t.cos() + w * t.sin()
            })
            .collect()
    };
    let worst = Worst {
        quality: 0.0,
        ..Worst::of_fan(mesh, v)
    };
    // What is to grow: the smallest angle around the vertex.
    let angle_with = |mesh: &Mesh, new: &Vertex| {
        mesh.fan(v)
            .map(|h| {
                let mut corners = of_triangle(mesh, h / 3);
                corners[(h % 3) as usize] = new;
                openness(&[corners])
            })
            .fold(f64::INFINITY, f64::min)
    };
    let (mut best, mut angle) = (start, angle_with(mesh, &start));
    let edge = mesh
        .fan(v)
        .map(|h| mesh.length(h))
        .fold(f64::INFINITY, f64::min);
    // Pattern search: the best direction that helps, else a shorter step.
    let mut step = 0.3 * edge;
    while step > 0.01 * edge {
        let mut better = None;
        for d in &directions {
            let p = best.position + d * step;
            let found = if start.kind == Kind::Curve {
                reference.on_curve(&p, step, course)
            } else if anywhere {
                reference.on_surface(&p, step)
            } else {
                reference.on_level(&p, step, EXACT)
            };
            let Some(new) = found else { continue };
            let reached = angle_with(mesh, &new);
            if reached > angle + 1e-6 && fits_fan(mesh, v, &new, &worst, 0.0) {
                angle = reached;
                better = Some(new);
            }
        }
        match better {
            Some(new) => best = new,
            None => step *= 0.4,
        }
    }
    mesh.vertices[v as usize] = best;
    best != start
}
