//! Narrow gaps. Where the space between two parts of the boundary is not meshed, no tetrahedron there
//! keeps them apart: each may go its way in valid steps and come through the other. So the parts that
//! face each other across a gap are looked for now and then, and no change there may let more
//! triangles cross.

use geom_core::mesh::{FACES, six_volume};
use geom_core::{Aabb, Point3, Vector3};
use rayon::prelude::*;

use crate::mesh::editable::{Freedom, Work};
use crate::mesh::incidence::NONE;
use crate::mesh::link::hull;
use crate::mesh::proposal::{NEW, Operation, Proposal};

/// Distance between the middles of triangles that face each other, in spacings.
const REACH: f64 = 1.25;
/// Largest cosine between the normals of triangles that face each other.
const FACING: f64 = 0.6;

/// Which vertices face each other across a gap.
#[derive(Default)]
pub(crate) struct Gaps {
    /// Vertex `v` faces the triangles around `facing[starts[v]..starts[v + 1]]`; later vertices are
    /// missing.
    starts: Vec<u32>,
    facing: Vec<u32>,
    /// Per vertex: where it was, and how much room it had there.
    places: Vec<Place>,
    /// The triangles of the boundary, by vertex.
    stars: Vec<(u32, [u32; 3])>,
}

struct Place {
    at: Point3,
    /// Least distance of the triangles around the vertex from those that they face, or less.
    clear: f64,
    /// Where its triangles start in [`Gaps::stars`], and how many there are; [`NONE`] where they have
    /// changed.
    star: [u32; 2],
}

impl Gaps {
    fn of(&self, v: u32) -> &[u32] {
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

impl Side {
    fn new(corners: [u32; 3], x: &[Point3], reach: f64) -> Self {
        let [a, b, c] = corners.map(|v| x[v as usize]);
        let middle = Point3::from((a.coords + b.coords + c.coords) / 3.0);
        let cell = |k: usize| (middle[k] / reach).floor() as i32;
        Self {
            cell: [cell(2), cell(1), cell(0)],
            corners,
            middle,
            normal: (b - a)
                .cross(&(c - a))
                .try_normalize(0.0)
                .unwrap_or_default(),
        }
    }

    fn faces(&self, other: &Self, reach: f64) -> bool {
        let d = other.middle - self.middle;
        d.norm_squared() < reach * reach
            && self.normal.dot(&other.normal) < FACING
            && (self.normal.dot(&d) > 0.0 || other.normal.dot(&d) < 0.0)
    }

    /// A lower bound of the distance: the widest of the gaps along some directions.
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

/// A vertex, a corner of a triangle that it faces, and the distance between, or less.
type Pair = (u32, u32, f64);

/// All pairs, by vertex and corner.
fn pairs(sides: &[Side], x: &[Point3], reach: f64) -> Vec<Pair> {
    let mut pairs: Vec<Pair> = (0..sides.len())
        .into_par_iter()
        .with_min_len(256)
        .flat_map_iter(|i| {
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
                        let clear = side.clear_of(other, x);
                        let [a, b] = [side.corners, other.corners];
                        // One corner leads to the triangle.
                        let of = |s: [u32; 3], [a, b, c]: [u32; 3]| {
                            s.map(|v| (v, a.min(b).min(c), clear))
                        };
                        of(a, b).into_iter().chain(of(b, a))
                    })
            })
        })
        .collect();
    let key = |p: &Pair| (p.0, p.1);
    pairs.par_sort_unstable_by(|p, q| key(p).cmp(&key(q)).then(p.2.total_cmp(&q.2)));
    pairs.dedup_by_key(|p| key(p));
    pairs
}

/// Does the segment go through the triangle?
fn pierces([p, q]: [Point3; 2], [a, b, c]: [Point3; 3]) -> bool {
    if six_volume([a, b, c, p]) * six_volume([a, b, c, q]) >= 0.0 {
        return false;
    }
    let turns = [[a, b], [b, c], [c, a]].map(|[s, t]| six_volume([p, q, s, t]));
    turns.iter().all(|&v| v >= 0.0) || turns.iter().all(|&v| v <= 0.0)
}

/// A triangle and the box around it.
struct Boxed {
    ids: [u32; 3],
    corners: [Point3; 3],
    bounds: Aabb,
}

impl Boxed {
    fn new(ids: [u32; 3], at: &impl Fn(u32) -> Point3) -> Self {
        let corners @ [a, b, c] = ids.map(at);
        let bounds = Aabb::new(a.inf(&b).inf(&c), a.sup(&b).sup(&c));
        Self {
            ids,
            corners,
            bounds,
        }
    }

    /// Do triangles cross outside of their common corner? Those with a common edge do not.
    fn crosses(&self, other: &Self) -> bool {
        if !self.bounds.intersects(&other.bounds) {
            return false;
        }
        let common = self.ids.iter().filter(|v| other.ids.contains(v)).count();
        common < 2 && (self.goes_through(other) || other.goes_through(self))
    }

    fn goes_through(&self, other: &Self) -> bool {
        (0..3).any(|i| {
            let ends = [i, (i + 1) % 3];
            !ends.iter().any(|&k| other.ids.contains(&self.ids[k]))
                && pierces(ends.map(|k| self.corners[k]), other.corners)
        })
    }
}

/// Each of them once, in order.
fn distinct<T: Ord>(items: impl Iterator<Item = T>) -> Vec<T> {
    let mut items: Vec<T> = items.collect();
    items.sort_unstable();
    items.dedup();
    items
}

fn sorted(mut face: [u32; 3]) -> [u32; 3] {
    face.sort_unstable();
    face
}

impl Work {
    /// Looks for the parts of the boundary that face each other.
    pub(crate) fn look_across(&mut self, spacing: f64) {
        let reach = REACH * spacing;
        self.gaps = Gaps::default();
        let state = &*self;
        let mut sides: Vec<Side> = (0..state.tets.len() as u32)
            .into_par_iter()
            .with_min_len(1024)
            .filter(|&t| !state.is_empty_slot(t))
            .flat_map_iter(|t| {
                let tet = state.tets[t as usize];
                let free = tet.map(|v| state.freedom[v as usize] == Freedom::Free);
                let field = tet.map(|v| state.freedom[v as usize] == Freedom::Field);
                (0..4)
                    .filter(move |&k| {
                        // The others stay in their planes.
                        !FACES[k].iter().any(|&i| free[i])
                            && FACES[k].iter().any(|&i| field[i])
                            && state.beyond(t, k).is_none()
                    })
                    .map(move |k| Side::new(FACES[k].map(|i| tet[i]), &state.x, reach))
            })
            .collect();
        sides.par_sort_unstable_by_key(|s| (s.cell, s.corners));
        let pairs = pairs(&sides, &self.x, reach);
        if pairs.is_empty() {
            return;
        }
        let mut starts = vec![0u32; self.x.len() + 1];
        let place = |&at: &Point3| Place {
            at,
            clear: f64::INFINITY,
            star: [0, 0],
        };
        let mut places: Vec<Place> = self.x.iter().map(place).collect();
        for &(v, _, clear) in &pairs {
            starts[v as usize + 1] += 1;
            let place = &mut places[v as usize];
            place.clear = place.clear.min(clear);
        }
        for v in 0..self.x.len() {
            starts[v + 1] += starts[v];
        }
        let near = |v: u32| starts[v as usize] < starts[v as usize + 1];
        let mut stars: Vec<(u32, [u32; 3])> = sides
            .iter()
            .flat_map(|s| s.corners.map(|v| (v, sorted(s.corners))))
            .filter(|s| near(s.0))
            .collect();
        stars.par_sort_unstable();
        let mut start = 0;
        for star in stars.chunk_by(|a, b| a.0 == b.0) {
            places[star[0].0 as usize].star = [start, star.len() as u32];
            start += star.len() as u32;
        }
        self.gaps = Gaps {
            starts,
            facing: pairs.into_iter().map(|p| p.1).collect(),
            places,
            stars,
        };
    }

    /// The triangles of the boundary around a vertex, in order, their corners sorted.
    fn boundary_around(&self, v: u32) -> Vec<[u32; 3]> {
        let tets = self.rings.of(v).iter().map(|&t| self.tets[t as usize]);
        let faces = hull(tets).into_iter().map(sorted);
        faces.filter(|f| f.contains(&v)).collect()
    }

    /// The triangles of the boundary around a vertex at a gap, their corners sorted.
    fn star(&self, v: u32) -> impl Iterator<Item = [u32; 3]> {
        let (known, fresh) = match self.gaps.places.get(v as usize).map(|p| p.star) {
            Some([start, count]) if start != NONE => {
                let range = start as usize..(start + count) as usize;
                (&self.gaps.stars[range], Vec::new())
            }
            _ => (&[][..], self.boundary_around(v)),
        };
        known.iter().map(|s| s.1).chain(fresh)
    }

    /// Would a triangle around the vertex `v` cross another one if it went to `x`?
    fn star_crosses(&self, v: u32, x: Point3) -> bool {
        let at = |u: u32| if u == v { x } else { self.x[u as usize] };
        let star: Vec<Boxed> = self.star(v).map(|t| Boxed::new(t, &at)).collect();
        let all = star.iter().fold(Aabb::EMPTY, |all, t| all.union(&t.bounds));
        let folds = (0..star.len()).any(|i| star[..i].iter().any(|t| star[i].crosses(t)));
        folds
            || self
                .gaps
                .of(v)
                .iter()
                .flat_map(|&u| self.star(u))
                .filter(|t| !t.contains(&v))
                .map(|t| Boxed::new(t, &at))
                .any(|t| t.bounds.intersects(&all) && star.iter().any(|s| s.crosses(&t)))
    }

    /// How many triangles of the boundary cross those of `new`, which have taken the place of `gone`,
    /// both sorted; only what `near` face counts.
    fn crossings(
        &self,
        near: &[u32],
        new: &[[u32; 3]],
        gone: &[[u32; 3]],
        at: impl Fn(u32) -> Point3,
    ) -> usize {
        let new: Vec<Boxed> = new.iter().map(|&t| Boxed::new(t, &at)).collect();
        let all = new.iter().fold(Aabb::EMPTY, |all, t| all.union(&t.bounds));
        let around = distinct(near.iter().flat_map(|&v| self.gaps.of(v)).copied());
        let others = around.into_iter().flat_map(|u| self.star(u));
        let others: Vec<Boxed> = distinct(others.filter(|t| gone.binary_search(t).is_err()))
            .into_iter()
            .map(|t| Boxed::new(t, &at))
            .filter(|t| t.bounds.intersects(&all) && new.iter().all(|n| n.ids != t.ids))
            .collect();
        (0..new.len())
            .map(|i| {
                let both = new[..i].iter().chain(&others);
                both.filter(|t| new[i].crosses(t)).count()
            })
            .sum()
    }

    /// Does a vertex that goes to `x` stay so near to where the gaps were looked for that it meets
    /// nothing?
    fn stays_clear(&self, v: u32, x: Point3) -> bool {
        if self.freedom[v as usize] == Freedom::Free {
            return true;
        }
        let Some(&[from, to]) = self.gaps.starts.get(v as usize..v as usize + 2) else {
            return false;
        };
        let place = &self.gaps.places[v as usize];
        from == to || (x - place.at).norm() < 0.5 * place.clear
    }

    /// May the vertex move as far as the gaps are concerned?
    pub(crate) fn gap_bears_move(&self, v: u32, x: Point3) -> bool {
        if self.gaps.starts.is_empty() || self.stays_clear(v, x) {
            return true;
        }
        let missing = self.gaps.misses(v);
        if !missing && !self.star_crosses(v, x) {
            return true;
        }
        let star = self.boundary_around(v);
        let near = if missing { star.concat() } else { vec![v] };
        let then = |u: u32| if u == v { x } else { self.x[u as usize] };
        self.crosses_no_more(&near, &star, &star, then)
    }

    fn crosses_no_more(
        &self,
        near: &[u32],
        new: &[[u32; 3]],
        gone: &[[u32; 3]],
        then: impl Fn(u32) -> Point3,
    ) -> bool {
        let after = self.crossings(near, new, gone, then);
        let now = |v: u32| self.x[v as usize];
        after == 0 || after <= self.crossings(near, gone, gone, now)
    }

    /// Does the change let no more triangles cross?
    pub(crate) fn gaps_bear(&self, proposal: &Proposal) -> bool {
        if self.gaps.starts.is_empty() {
            return true;
        }
        let moves = proposal.moves.iter();
        let moved: Vec<u32> = moves
            .filter(|&&(v, x)| !self.stays_clear(v, x))
            .map(|m| m.0)
            .collect();
        let then = |v: u32| match proposal.vertex {
            Some((x, ..)) if v == NEW => x,
            _ => {
                let to = proposal.moves.iter().find(|m| m.0 == v);
                to.map_or_else(|| self.x[v as usize], |m| m.1)
            }
        };
        let (new, gone) = if self.changes_boundary(proposal) {
            self.change_of_boundary(proposal, &moved)
        } else {
            let stars = distinct(moved.iter().flat_map(|&v| self.boundary_around(v)));
            (stars.clone(), stars)
        };
        let near = distinct(new.iter().chain(&gone).flatten().copied());
        self.crosses_no_more(&near, &new, &gone, then)
    }

    /// Does the change replace triangles of the boundary near a gap?
    fn changes_boundary(&self, proposal: &Proposal) -> bool {
        let on_surface = match proposal.operation {
            Operation::EdgeRemoval | Operation::FaceSwap | Operation::Push => false,
            Operation::SurfaceFlip => true,
            Operation::Contraction => proposal.edge.is_some_and(|e| e.2),
            Operation::Insertion => proposal.vertex.is_some_and(|v| v.2 != Freedom::Free),
        };
        let near = |v: u32| self.gaps.misses(v) || !self.gaps.of(v).is_empty();
        let mut corners = proposal.remove.iter().flat_map(|&t| self.tets[t as usize]);
        on_surface && corners.any(|v| self.freedom[v as usize] != Freedom::Free && near(v))
    }

    /// The triangles of the boundary after a change that were not before, and those that vanish or
    /// move.
    fn change_of_boundary(
        &self,
        proposal: &Proposal,
        moved: &[u32],
    ) -> (Vec<[u32; 3]>, Vec<[u32; 3]>) {
        let around = moved.iter().flat_map(|&v| self.rings.of(v));
        let patch = distinct(proposal.remove.iter().chain(around).copied());
        let tet_of = |&t: &u32| self.tets[t as usize];
        let faces = |tets: &mut dyn Iterator<Item = [u32; 4]>| -> Vec<[u32; 3]> {
            hull(tets).into_iter().map(sorted).collect()
        };
        // What lies between the patch and other tetrahedra stays.
        let (inner, gone): (Vec<_>, Vec<_>) = faces(&mut patch.iter().map(tet_of))
            .into_iter()
            .partition(|face| {
                let tets = self.rings.of(face[0]).iter();
                let mut others = tets.filter(|t| patch.binary_search(t).is_err());
                others.any(|t| face.iter().all(|v| tet_of(t).contains(v)))
            });
        let kept = patch.iter().filter(|t| !proposal.remove.contains(t));
        let inserted = proposal.insert.iter().map(|i| i.0);
        let mut new = faces(&mut kept.map(tet_of).chain(inserted));
        new.retain(|f| inner.binary_search(f).is_err());
        let same = |f: &[u32; 3], other: &[[u32; 3]]| {
            other.binary_search(f).is_ok() && !f.iter().any(|v| moved.contains(v))
        };
        (
            new.iter().filter(|f| !same(f, &gone)).copied().collect(),
            gone.iter().filter(|f| !same(f, &new)).copied().collect(),
        )
    }

    /// A change is made: around it the gaps are to be looked at, however little moves there.
    pub(crate) fn unclear(&mut self, proposal: &Proposal) {
        if self.gaps.starts.is_empty() || !self.changes_boundary(proposal) {
            return;
        }
        let removed = proposal.remove.iter();
        let corners: Vec<u32> = removed.flat_map(|&t| self.tets[t as usize]).collect();
        for v in corners {
            if let Some(place) = self.gaps.places.get_mut(v as usize) {
                place.clear = 0.0;
                place.star[0] = NONE;
            }
        }
    }
}
