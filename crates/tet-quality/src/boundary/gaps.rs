//! The self-intersection guard of narrow gaps. Where the space between two parts of the boundary is not
//! meshed, no tetrahedron there keeps them apart: each may go its way in valid steps and come through
//! the other. So the parts that face each other across a gap are looked for now and then, and no change
//! there may let more triangles cross.
//!
//! Testing all pairs of boundary triangles at each step would cost more than the improvement. Two facts make it cheap: only
//! triangles that face each other, their normals opposite, and lie within a reach can cross soon; and vertices that have moved less than
//! half the room between them cannot have met. So cells as wide as the reach find who faces whom, and each vertex remembers
//! where it was and how much room it had there.

use geom_core::compute::parallel;
use geom_core::mesh::{FACES, sorted};
use geom_core::search::crossing::BoxedTriangle;
use geom_core::{Aabb, Point3, Vector3};
use rayon::prelude::*;

use crate::mesh::editable::{EditableMesh, Freedom};
use crate::mesh::incidence::NONE;
use crate::mesh::link::hull;
use crate::mesh::proposal::{Operation, Proposal};

/// Distance between the middles of triangles that face each other, in spacings.
/// Wider finds more pairs and costs more; narrower would miss walls that meet before they are looked for again.
const REACH: f64 = 1.25;
/// Largest cosine between the normals of triangles that face each other.
/// Generous: normals 53° apart are enough, since the walls of a wedge are in danger, too.
const FACING: f64 = 0.6;

/// Which vertices face each other across a gap.
///
/// It is a snapshot: found before a sweep, true until vertices have moved by half their room. Without any pair it is
/// empty and costs nothing.
#[derive(Clone, Default)]
pub(crate) struct SelfIntersectionGuard {
    /// Vertex `v` faces the triangles around `facing[starts[v]..starts[v + 1]]`; later vertices are
    /// missing.
    starts: Vec<u32>,
    facing: Vec<u32>,
    /// Per vertex: where it was, and how much room it had there.
    clearances: Vec<Clearance>,
    /// The triangles of the boundary, by vertex.
    stars: Vec<(u32, [u32; 3])>,
}

/// Positions and room of one vertex when gaps were last looked for.
#[derive(Clone)]
struct Clearance {
    at: Point3,
    /// Least distance of the triangles around the vertex from those that they face, or less.
    distance: f64,
    /// Where its triangles start in [`SelfIntersectionGuard::stars`], and how many there are; [`NONE`] where they have
    /// changed.
    star: [u32; 2],
}

impl SelfIntersectionGuard {
    /// What the vertex faces: one corner of each triangle.
    fn faced_by(&self, v: u32) -> &[u32] {
        match self.starts.get(v as usize..v as usize + 2) {
            Some(&[from, to]) => &self.facing[from as usize..to as usize],
            _ => &[],
        }
    }

    /// Is the vertex younger than what is known?
    fn misses(&self, v: u32) -> bool {
        v as usize + 1 >= self.starts.len()
    }
}

/// A triangle of the boundary.
struct Side {
    cell: [i32; 3],
    corners: [u32; 3],
    middle: Point3,
    normal: Vector3,
}

/// The middle of a triangle, by which it stands in a cell.
fn middle_of([a, b, c]: [Point3; 3]) -> Point3 {
    Point3::from((a.coords + b.coords + c.coords) / 3.0)
}

/// The cell of a point; cells are as wide as the reach.
/// The last coordinate comes first, so that cells in order of their arrays are rows along x.
fn cell_of(x: &Point3, reach: f64) -> [i32; 3] {
    [2, 1, 0].map(|k| (x[k] / reach).floor() as i32)
}

/// The cells of some points and all that are at most two away, in order: triangles around the points have their middles
/// there, and so has what they face.
fn cells_around(points: &[Point3], reach: f64) -> Vec<[i32; 3]> {
    let own = distinct(points.iter().map(|x| cell_of(x, reach)));
    let steps = || -2..=2;
    let around = own.iter().flat_map(|c| {
        let shift = move |d: [i32; 3]| [0, 1, 2].map(|k| c[k].saturating_add(d[k]));
        let row = move |a| steps().flat_map(move |b| steps().map(move |d| shift([a, b, d])));
        steps().flat_map(row)
    });
    distinct(around)
}

impl Side {
    fn new(corners: [u32; 3], x: &[Point3], reach: f64) -> Self {
        let [a, b, c] = corners.map(|v| x[v as usize]);
        let middle = middle_of([a, b, c]);
        Self {
            cell: cell_of(&middle, reach),
            corners,
            middle,
            normal: (b - a)
                .cross(&(c - a))
                .try_normalize(0.0)
                .unwrap_or_default(),
        }
    }

    /// Do they face each other: near by, turned to each other, and at least one in front of the other?
    fn faces(&self, other: &Self, reach: f64) -> bool {
        let d = other.middle - self.middle;
        d.norm_squared() < reach * reach
            && self.normal.dot(&other.normal) < FACING
            && (self.normal.dot(&d) > 0.0 || other.normal.dot(&d) < 0.0)
    }

    /// A lower bound of the distance: the widest of the gaps along some directions.
    /// By the separating axis theorem any axis gives a bound; these are the likely ones. 0 where none separates them.
    fn clear_of(&self, other: &Self, x: &[Point3]) -> f64 {
        let corners = [self, other].map(|s| s.corners.map(|v| x[v as usize] - self.middle));
        let along = other.middle - self.middle;
        [
            self.normal,
            -other.normal,
            self.normal - other.normal,
            along,
        ]
        .into_iter()
        .filter_map(|axis| axis.try_normalize(0.0))
        .map(|axis| {
            let [from, to] = corners.map(|c| c.map(|p| axis.dot(&p)));
            let last = from[0].max(from[1]).max(from[2]);
            to[0].min(to[1]).min(to[2]) - last
        })
        .fold(0.0, f64::max)
    }
}

/// Rows of cells, each pair of neighbouring ones once: the own one comes first.
const ROWS: [[i32; 2]; 5] = [[0, 0], [0, 1], [1, -1], [1, 0], [1, 1]];

/// A vertex and a triangle across a gap.
#[derive(Clone, Copy)]
struct Facing {
    vertex: u32,
    /// A corner of the triangle that it faces.
    corner: u32,
    /// The distance between, or less.
    distance: f64,
}

impl Facing {
    fn key(&self) -> [u32; 2] {
        [self.vertex, self.corner]
    }
}

/// All that face each other within `reach`, by vertex and corner; `sides` are sorted by cell.
/// Each pair is met once, from the side that comes first, and noted for the corners of both: six entries.
fn all_facing(sides: &[Side], x: &[Point3], reach: f64) -> Vec<Facing> {
    let mut all: Vec<Facing> = parallel::flat_map(sides.len(), |i| {
        // Cells are as wide as the reach: what a side faces lies in its own cell or the next ones.
        let side = &sides[i];
        let [cz, cy, cx] = side.cell;
        ROWS.into_iter().flat_map(move |row| {
            let [z, y] = [cz.saturating_add(row[0]), cy.saturating_add(row[1])];
            let (from, to) = ([z, y, cx.saturating_sub(1)], [z, y, cx.saturating_add(1)]);
            let first = if row == ROWS[0] {
                i + 1
            } else {
                sides.partition_point(|s| s.cell < from)
            };
            sides[first..]
                .iter()
                .take_while(move |s| s.cell <= to)
                .filter(move |other| side.faces(other, reach))
                .flat_map(move |other| {
                    let distance = side.clear_of(other, x);
                    let [a, b] = [side.corners, other.corners];
                    // One corner leads to the triangle.
                    let of = |s: [u32; 3], [a, b, c]: [u32; 3]| {
                        let corner = a.min(b).min(c);
                        s.map(|vertex| Facing {
                            vertex,
                            corner,
                            distance,
                        })
                    };
                    of(a, b).into_iter().chain(of(b, a))
                })
        })
    });
    all.par_sort_unstable_by(|p, q| {
        let order = p.key().cmp(&q.key());
        order.then(p.distance.total_cmp(&q.distance))
    });
    all.dedup_by_key(|p| p.key());
    all
}

/// Each of them once, in order.
fn distinct<T: Ord>(items: impl Iterator<Item = T>) -> Vec<T> {
    let mut items: Vec<T> = items.collect();
    items.sort_unstable();
    items.dedup();
    items
}

/// The boundary around a change: the triangles that it makes and those that it takes away or moves.
struct BoundaryChange {
    new: Vec<[u32; 3]>,
    removed: Vec<[u32; 3]>,
}

impl BoundaryChange {
    /// Of triangles that stay but move.
    fn moved(star: Vec<[u32; 3]>) -> Self {
        Self {
            new: star.clone(),
            removed: star,
        }
    }

    /// The corners of all of them.
    fn corners(&self) -> Vec<u32> {
        distinct(self.new.iter().chain(&self.removed).flatten().copied())
    }
}

/// The triangles of the boundary that may come to face others, by cell; those in some `cells`, if any are given.
/// Triangles without a vertex of the isosurface are left out, and so are those between tetrahedra.
fn sides_of(mesh: &EditableMesh, reach: f64, cells: Option<&[[i32; 3]]>) -> Vec<Side> {
    // Cheap beside the search for what is beyond.
    let wanted = |corners: [u32; 3]| {
        cells.is_none_or(|cells| {
            let cell = cell_of(&middle_of(corners.map(|v| mesh.x[v as usize])), reach);
            cells.binary_search(&cell).is_ok()
        })
    };
    let mut sides: Vec<Side> = parallel::flat_map(mesh.tets.len(), |t| {
        let living = Some(t as u32).filter(|&t| !mesh.is_empty_slot(t));
        living.into_iter().flat_map(|t| {
            let tet = mesh.tets[t as usize];
            let free = tet.map(|v| mesh.freedom[v as usize] == Freedom::Free);
            let field = tet.map(|v| mesh.freedom[v as usize].on_field());
            (0..4)
                .filter(move |&k| {
                    // The others stay in their planes.
                    !FACES[k].iter().any(|&i| free[i])
                        && FACES[k].iter().any(|&i| field[i])
                        && wanted(FACES[k].map(|i| tet[i]))
                        && mesh.beyond(t, k).is_none()
                })
                .map(move |k| Side::new(FACES[k].map(|i| tet[i]), &mesh.x, reach))
        })
    });
    sides.par_sort_unstable_by_key(|s| (s.cell, s.corners));
    sides
}

/// The triangles of the boundary around a vertex, in order, their corners sorted.
fn boundary_around(mesh: &EditableMesh, v: u32) -> Vec<[u32; 3]> {
    let tets = mesh.incidence.of(v).iter().map(|&t| mesh.tets[t as usize]);
    let faces = hull(tets).into_iter().map(sorted);
    faces.filter(|f| f.contains(&v)).collect()
}

impl SelfIntersectionGuard {
    /// Looks for the parts of the boundary that face each other; only around the points of `near`, if there are such.
    pub(crate) fn of(mesh: &EditableMesh, spacing: f64, near: Option<&[Point3]>) -> Self {
        let reach = REACH * spacing;
        let cells = near.map(|points| cells_around(points, reach));
        let sides = sides_of(mesh, reach, cells.as_deref());
        let facing = all_facing(&sides, &mesh.x, reach);
        if facing.is_empty() {
            return Self::default();
        }
        // Where what each vertex faces starts, and how much room it has.
        let mut starts = vec![0u32; mesh.x.len() + 1];
        let anywhere = |&at: &Point3| Clearance {
            at,
            distance: f64::INFINITY,
            star: [0, 0],
        };
        let mut clearances: Vec<Clearance> = mesh.x.iter().map(anywhere).collect();
        for pair in &facing {
            starts[pair.vertex as usize + 1] += 1;
            let known = &mut clearances[pair.vertex as usize].distance;
            *known = known.min(pair.distance);
        }
        for v in 0..mesh.x.len() {
            starts[v + 1] += starts[v];
        }
        // The triangles around those that face any.
        let near = |v: u32| starts[v as usize] < starts[v as usize + 1];
        let mut stars: Vec<(u32, [u32; 3])> = sides
            .iter()
            .flat_map(|s| s.corners.map(|v| (v, sorted(s.corners))))
            .filter(|s| near(s.0))
            .collect();
        stars.par_sort_unstable();
        let mut start = 0;
        for star in stars.chunk_by(|a, b| a.0 == b.0) {
            clearances[star[0].0 as usize].star = [start, star.len() as u32];
            start += star.len() as u32;
        }
        Self {
            starts,
            facing: facing.into_iter().map(|p| p.corner).collect(),
            clearances,
            stars,
        }
    }

    /// The triangles of the boundary around a vertex at a gap, their corners sorted.
    fn star(&self, mesh: &EditableMesh, v: u32) -> impl Iterator<Item = [u32; 3]> {
        let (known, fresh) = match self.clearances.get(v as usize).map(|c| c.star) {
            Some([start, count]) if start != NONE => {
                let range = start as usize..(start + count) as usize;
                (&self.stars[range], Vec::new())
            }
            _ => (&[][..], boundary_around(mesh, v)),
        };
        known.iter().map(|s| s.1).chain(fresh)
    }

    /// Would a triangle around the vertex `v` cross another one if it went to `x`?
    /// Folds of the star itself count as well. Boxes are compared first, triangles by exact predicates only where boxes
    /// meet.
    fn star_crosses(&self, mesh: &EditableMesh, v: u32, x: Point3) -> bool {
        let at = |u: u32| if u == v { x } else { mesh.x[u as usize] };
        let star: Vec<BoxedTriangle> = self
            .star(mesh, v)
            .map(|t| BoxedTriangle::new(t, &at))
            .collect();
        let all = star.iter().fold(Aabb::EMPTY, |all, t| all.union(&t.bounds));
        let folds = (0..star.len()).any(|i| star[..i].iter().any(|t| star[i].crosses(t)));
        folds
            || self
                .faced_by(v)
                .iter()
                .flat_map(|&u| self.star(mesh, u))
                .filter(|t| !t.contains(&v))
                .map(|t| BoxedTriangle::new(t, &at))
                .any(|t| t.bounds.intersects(&all) && star.iter().any(|s| s.crosses(&t)))
    }

    /// How many triangles of the boundary cross those of `new`, which have taken the place of `removed`,
    /// both sorted; only what `near` face counts.
    fn crossings(
        &self,
        mesh: &EditableMesh,
        near: &[u32],
        new: &[[u32; 3]],
        removed: &[[u32; 3]],
        at: impl Fn(u32) -> Point3,
    ) -> usize {
        let new: Vec<BoxedTriangle> = new.iter().map(|&t| BoxedTriangle::new(t, &at)).collect();
        let all = new.iter().fold(Aabb::EMPTY, |all, t| all.union(&t.bounds));
        let around = distinct(near.iter().flat_map(|&v| self.faced_by(v)).copied());
        let others = around.into_iter().flat_map(|u| self.star(mesh, u));
        let others: Vec<BoxedTriangle> =
            distinct(others.filter(|t| removed.binary_search(t).is_err()))
                .into_iter()
                .map(|t| BoxedTriangle::new(t, &at))
                .filter(|t| t.bounds.intersects(&all) && new.iter().all(|n| n.ids != t.ids))
                .collect();
        (0..new.len())
            .map(|i| {
                let both = new[..i].iter().chain(&others);
                both.filter(|t| new[i].crosses(t)).count()
            })
            .sum()
    }

    /// Do no more triangles cross once those of the change lie where `then` says?
    /// What crosses already in the input may go on doing so; the count before is taken only if any crosses after.
    fn crosses_no_more(
        &self,
        mesh: &EditableMesh,
        near: &[u32],
        change: &BoundaryChange,
        then: impl Fn(u32) -> Point3,
    ) -> bool {
        let BoundaryChange { new, removed } = change;
        let after = self.crossings(mesh, near, new, removed, then);
        let now = |v: u32| mesh.x[v as usize];
        after == 0 || after <= self.crossings(mesh, near, removed, removed, now)
    }

    /// Does a vertex that goes to `x` stay so near to where the gaps were looked for that it meets
    /// nothing?
    fn stays_clear(&self, mesh: &EditableMesh, v: u32, x: Point3) -> bool {
        if mesh.freedom[v as usize] == Freedom::Free {
            return true;
        }
        let Some(&[from, to]) = self.starts.get(v as usize..v as usize + 2) else {
            return false;
        };
        let known = &self.clearances[v as usize];
        from == to || (x - known.at).norm() < 0.5 * known.distance
    }

    /// May the vertex move as far as the gaps are concerned?
    ///
    /// Three questions, from cheap to dear: is it still within half of its room; does nothing around it cross anything
    /// it faces; do no more cross than before. A vertex that is younger than the snapshot is judged by what its
    /// neighbours face.
    pub(crate) fn allows_move(&self, mesh: &EditableMesh, v: u32, x: Point3) -> bool {
        if self.starts.is_empty() || self.stays_clear(mesh, v, x) {
            return true;
        }
        let missing = self.misses(v);
        if !missing && !self.star_crosses(mesh, v, x) {
            return true;
        }
        let star = boundary_around(mesh, v);
        let near = if missing { star.concat() } else { vec![v] };
        let then = |u: u32| if u == v { x } else { mesh.x[u as usize] };
        self.crosses_no_more(mesh, &near, &BoundaryChange::moved(star), then)
    }

    /// Does the change let no more triangles cross?
    pub(crate) fn allows(&self, mesh: &EditableMesh, proposal: &Proposal) -> bool {
        if self.starts.is_empty() {
            return true;
        }
        let moves = proposal.moves.iter();
        let moved: Vec<u32> = moves
            .filter(|m| !self.stays_clear(mesh, m.vertex, m.to))
            .map(|m| m.vertex)
            .collect();
        let change = if self.changes_boundary(mesh, proposal) {
            change_of_boundary(mesh, proposal, &moved)
        } else {
            let star = moved.iter().flat_map(|&v| boundary_around(mesh, v));
            BoundaryChange::moved(distinct(star))
        };
        let then = |v: u32| proposal.position_after(mesh, v);
        self.crosses_no_more(mesh, &change.corners(), &change, then)
    }

    /// Does the change replace triangles of the boundary near a gap?
    /// Operations inside leave the boundary as it is, and are not asked.
    fn changes_boundary(&self, mesh: &EditableMesh, proposal: &Proposal) -> bool {
        let on_surface = match proposal.operation {
            Operation::EdgeRemoval | Operation::FaceSwap | Operation::Projection => false,
            Operation::SurfaceFlip => true,
            Operation::Contraction => proposal.edge.is_some_and(|e| e.on_surface),
            Operation::Insertion => proposal.vertex.is_some_and(|v| v.freedom != Freedom::Free),
        };
        let near = |v: u32| self.misses(v) || !self.faced_by(v).is_empty();
        let mut corners = proposal.remove.iter().flat_map(|&t| mesh.tets[t as usize]);
        on_surface && corners.any(|v| mesh.freedom[v as usize] != Freedom::Free && near(v))
    }

    /// A change is made: around it the gaps are to be looked at, however little moves there.
    pub(crate) fn record(&mut self, mesh: &EditableMesh, proposal: &Proposal) {
        if self.starts.is_empty() || !self.changes_boundary(mesh, proposal) {
            return;
        }
        let removed = proposal.remove.iter();
        for v in removed.flat_map(|&t| mesh.tets[t as usize]) {
            if let Some(known) = self.clearances.get_mut(v as usize) {
                known.distance = 0.0;
                known.star[0] = NONE;
            }
        }
    }
}

/// The triangles of the boundary after a change that were not before, and those that vanish or move.
/// Triangles with sorted corners, in order: only these are tested against what is near.
fn change_of_boundary(mesh: &EditableMesh, proposal: &Proposal, moved: &[u32]) -> BoundaryChange {
    let around = moved.iter().flat_map(|&v| mesh.incidence.of(v));
    let patch = distinct(proposal.remove.iter().chain(around).copied());
    let tet_of = |&t: &u32| mesh.tets[t as usize];
    let faces = |tets: &mut dyn Iterator<Item = [u32; 4]>| -> Vec<[u32; 3]> {
        hull(tets).into_iter().map(sorted).collect()
    };
    // What lies between the patch and other tetrahedra stays.
    let (inner, removed): (Vec<_>, Vec<_>) = faces(&mut patch.iter().map(tet_of))
        .into_iter()
        .partition(|face| {
            let tets = mesh.incidence.of(face[0]).iter();
            let mut others = tets.filter(|t| patch.binary_search(t).is_err());
            others.any(|t| face.iter().all(|v| tet_of(t).contains(v)))
        });
    let kept = patch.iter().filter(|t| !proposal.remove.contains(t));
    let inserted = proposal.insert.iter().map(|tet| tet.corners);
    let mut new = faces(&mut kept.map(tet_of).chain(inserted));
    new.retain(|f| inner.binary_search(f).is_err());
    let same = |f: &[u32; 3], other: &[[u32; 3]]| {
        other.binary_search(f).is_ok() && !f.iter().any(|v| moved.contains(v))
    };
    BoundaryChange {
        new: new.iter().filter(|f| !same(f, &removed)).copied().collect(),
        removed: removed.iter().filter(|f| !same(f, &new)).copied().collect(),
    }
}
