//! The mesh while it is being changed: tetrahedra with slots that may be empty, and for each vertex
//! the tetrahedra around it.
//!
//! Operations take tetrahedra out and put others in, thousands of times, so nothing is renumbered meanwhile: a slot that has
//! become empty is marked (its objective is infinite) and used again. Beside the mesh stands what would cost too much to find anew
//! each time: the objective of every tetrahedron, the star of every vertex, colours of which no two neighbours have the same, and
//! when something around a vertex last changed. They are kept up by every change, all of which go through one gate.

use geom_core::compute::parallel;
use geom_core::field::Tangent;
use geom_core::mesh::{FACES, OUTSIDE, Region, VertexKind};
use geom_core::{Point3, TetMesh, Vector3};
use rayon::prelude::*;

use crate::boundary::field::{Isosurface, UNKNOWN};
use crate::boundary::plane::Plane;
use crate::error::Error;
use crate::measure::metrics::quality;
use crate::mesh::incidence::{Incidence, NONE};

/// The objective counts as raised only by more than this: sweeps end.
pub(crate) const GAIN: f64 = 1e-9;

/// In which directions a vertex may move.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Freedom {
    /// Anywhere.
    Free,
    /// Along the isosurface of the field.
    Field,
    /// Along the curve in which the isosurface of the field and this plane meet.
    Curve(Plane),
    /// In the plane across this unit normal.
    Plane(Vector3),
    /// Along this unit direction.
    Line(Vector3),
    /// Nowhere.
    Fixed,
    /// Nowhere, nor may an edge between two such vertices go: it belongs to another mesh as well.
    Held,
}

impl Freedom {
    /// May it move nowhere?
    pub(crate) fn is_fixed(self) -> bool {
        matches!(self, Self::Fixed | Self::Held)
    }

    /// Does it move along the isosurface, or a curve on it?
    pub(crate) fn on_field(self) -> bool {
        matches!(self, Self::Field | Self::Curve(_))
    }

    /// The plane of a curve.
    pub(crate) fn plane(self) -> Option<Plane> {
        match self {
            Self::Curve(plane) => Some(plane),
            _ => None,
        }
    }

    /// What of an isosurface it moves along.
    pub(crate) fn part_of<'a>(self, field: &Isosurface<'a>) -> Isosurface<'a> {
        let plane = self.plane();
        Isosurface { plane, ..*field }
    }
}

/// A tetrahedral mesh that operations change in place.
///
/// Numbers of tetrahedra are slots: they outlast operations elsewhere, but the one that was `t` may be another
/// tetrahedron later, which [`EditableMesh::changed_since`] tells. Numbers of vertices only grow.
#[derive(Clone)]
pub(crate) struct EditableMesh {
    pub(crate) x: Vec<Point3>,
    pub(crate) kinds: Vec<VertexKind>,
    pub(crate) freedom: Vec<Freedom>,
    pub(crate) tets: Vec<[u32; 4]>,
    pub(crate) regions: Vec<Region>,
    /// The objective per tetrahedron; +∞ in empty slots.
    pub(crate) q: Vec<f64>,
    pub(crate) incidence: Incidence,
    /// Classes of vertices that share no tetrahedron; kept up by [`EditableMesh::insert`].
    pub(crate) colours: Vec<Colour>,
    /// When something around a vertex last changed: see [`EditableMesh::tick`].
    pub(crate) changed: Vec<u32>,
    /// The isosurface at a vertex when it was last asked for: see [`EditableMesh::tangent`].
    tangents: Vec<Tangent>,
    clock: u32,
    empty: Vec<u32>,
    /// Vertices that the input had without a tetrahedron: they stay.
    unused: Vec<bool>,
}

/// Number of a class of vertices.
/// With about 14 neighbours per vertex some ten classes occur; what 255 do not suffice for stays uncoloured.
pub(crate) type Colour = u8;
/// Not in any class: such a vertex has neighbours of all classes, or no tetrahedron, and stays.
pub(crate) const NO_COLOUR: Colour = Colour::MAX;

impl EditableMesh {
    /// Every vertex is free at first: [`prepare`](crate::boundary::input::prepare) says what holds which.
    pub(crate) fn new(mesh: TetMesh) -> Self {
        let (x, tets, regions, kinds) = mesh.into_parts();
        let incidence = Incidence::new(x.len(), &tets);
        let freedom = vec![Freedom::Free; x.len()];
        let mut mesh = Self {
            x,
            kinds,
            freedom,
            q: vec![0.0; tets.len()],
            tets,
            regions,
            incidence,
            colours: Vec::new(),
            changed: Vec::new(),
            tangents: Vec::new(),
            clock: 1,
            empty: Vec::new(),
            unused: Vec::new(),
        };
        mesh.unused = (0..mesh.x.len() as u32)
            .map(|v| mesh.incidence.of(v).is_empty())
            .collect();
        mesh.colours = vec![NO_COLOUR; mesh.x.len()];
        mesh.changed = vec![mesh.clock; mesh.x.len()];
        mesh.tangents = vec![UNKNOWN; mesh.x.len()];
        for v in 0..mesh.x.len() as u32 {
            mesh.colours[v as usize] = mesh.free_colour(v);
        }
        mesh.measure_all();
        mesh
    }

    /// The lowest class that no neighbour of `v` is in.
    /// Greedy, in the order of numbers: the lowest of a bit set of those that are taken around it.
    fn free_colour(&self, v: u32) -> Colour {
        let star = self.incidence.of(v);
        if star.is_empty() {
            return NO_COLOUR;
        }
        let mut used = [0u64; 4];
        for &t in star {
            for u in self.tets[t as usize] {
                let c = self.colours[u as usize];
                if u != v && c != NO_COLOUR {
                    used[usize::from(c / 64)] |= 1 << (c % 64);
                }
            }
        }
        let word = used.iter().position(|&w| w != u64::MAX);
        word.map_or(NO_COLOUR, |w| {
            (w as u32 * 64 + (!used[w]).trailing_zeros()) as Colour
        })
    }

    /// Starts a new step of the clock that [`EditableMesh::changed`] shows, and gives the time.
    pub(crate) fn tick(&mut self) -> u32 {
        self.clock += 1;
        self.clock
    }

    /// Something changed around these vertices.
    fn touch(&mut self, vertices: [u32; 4]) {
        for v in vertices {
            self.changed[v as usize] = self.clock;
        }
    }

    /// Did something change around a corner of `t` after `time`?
    pub(crate) fn changed_since(&self, t: u32, time: u32) -> bool {
        let tet = self.tets[t as usize];
        tet.iter().any(|&v| self.changed[v as usize] > time)
    }

    /// Has something changed around `v` in this step of the clock?
    pub(crate) fn changed_now(&self, v: u32) -> bool {
        self.changed[v as usize] == self.clock
    }

    /// Fills `q` anew.
    /// In parallel, each for itself.
    pub(crate) fn measure_all(&mut self) {
        let (x, tets) = (&self.x, &self.tets);
        parallel::for_each(&mut self.q, |i, q| {
            let t = &tets[i];
            *q = if t[0] == NONE {
                f64::INFINITY
            } else {
                let &[a, b, c, d] = t;
                quality([x[a as usize], x[b as usize], x[c as usize], x[d as usize]])
            };
        });
    }

    /// Empty slots have [`NONE`] for corners: to be asked before any corner is used.
    pub(crate) fn is_empty_slot(&self, t: u32) -> bool {
        self.tets[t as usize][0] == NONE
    }

    pub(crate) fn corners(&self, tet: [u32; 4]) -> [Point3; 4] {
        let [a, b, c, d] = tet;
        [
            self.x[a as usize],
            self.x[b as usize],
            self.x[c as usize],
            self.x[d as usize],
        ]
    }

    pub(crate) fn quality_of(&self, tet: [u32; 4]) -> f64 {
        quality(self.corners(tet))
    }

    /// The tetrahedron beyond the face of `t` opposite its corner `k`, if there is one.
    /// Found by the tetrahedra around one corner, some twenty of them, instead of a table of neighbours that each
    /// operation would have to keep up.
    pub(crate) fn beyond(&self, t: u32, k: usize) -> Option<u32> {
        let [a, b, c] = FACES[k].map(|i| self.tets[t as usize][i]);
        self.incidence.of(a).iter().copied().find(|&o| {
            let tet = &self.tets[o as usize];
            o != t && tet.contains(&b) && tet.contains(&c)
        })
    }

    /// The faces beyond which there is no tetrahedron, counter-clockwise from outside.
    pub(crate) fn boundary_faces(&self) -> Vec<[u32; 3]> {
        let of_tet = |t: u32| {
            let tet = self.tets[t as usize];
            // What moves freely lies inside a region; most faces have such a corner, and need no search.
            let inner = tet.map(|v| v == NONE || matches!(self.freedom[v as usize], Freedom::Free));
            (0..4)
                .filter(move |&k| {
                    !FACES[k].iter().any(|&i| inner[i]) && self.beyond(t, k).is_none()
                })
                .map(move |k| FACES[k].map(|i| tet[i]))
        };
        parallel::flat_map(self.tets.len(), |t| of_tet(t as u32))
    }

    /// The region beyond the face of `t` opposite its corner `k`; [`OUTSIDE`] beyond the mesh.
    pub(crate) fn region_beyond(&self, t: u32, k: usize) -> Region {
        self.beyond(t, k)
            .map_or(OUTSIDE, |o| self.regions[o as usize])
    }

    /// Is `ab` an edge of the mesh?
    pub(crate) fn edge_exists(&self, a: u32, b: u32) -> bool {
        self.incidence
            .of(a)
            .iter()
            .any(|&t| self.tets[t as usize].contains(&b))
    }

    /// Is `abc` a face of the mesh?
    pub(crate) fn face_exists(&self, a: u32, b: u32, c: u32) -> bool {
        self.incidence.of(a).iter().any(|&t| {
            let tet = &self.tets[t as usize];
            tet.contains(&b) && tet.contains(&c)
        })
    }

    /// Empties a slot.
    /// A vertex without tetrahedra loses its colour; its number stays until [`EditableMesh::finish`].
    pub(crate) fn remove(&mut self, t: u32) {
        self.touch(self.tets[t as usize]);
        for v in self.tets[t as usize] {
            self.incidence.remove(v, t);
            if self.incidence.of(v).is_empty() {
                self.colours[v as usize] = NO_COLOUR;
            }
        }
        self.tets[t as usize] = [NONE; 4];
        self.q[t as usize] = f64::INFINITY;
        self.empty.push(t);
    }

    /// Fills a slot.
    /// In the slot that became empty last, or at the end. Two of its corners may have had the same colour while they
    /// were no neighbours: the later one gets another.
    pub(crate) fn insert(&mut self, tet: [u32; 4], region: Region) {
        let q = self.quality_of(tet);
        let t = match self.empty.pop() {
            Some(t) => {
                (self.tets[t as usize], self.regions[t as usize]) = (tet, region);
                self.q[t as usize] = q;
                t
            }
            None => {
                self.tets.push(tet);
                self.regions.push(region);
                self.q.push(q);
                self.tets.len() as u32 - 1
            }
        };
        for v in tet {
            self.incidence.push(v, t);
        }
        self.touch(tet);
        for (i, &v) in tet.iter().enumerate() {
            let c = self.colours[v as usize];
            if c == NO_COLOUR || tet[..i].iter().any(|&u| self.colours[u as usize] == c) {
                self.colours[v as usize] = self.free_colour(v);
            }
        }
    }

    /// A new vertex without tetrahedra.
    pub(crate) fn add_vertex(&mut self, x: Point3, kind: VertexKind, freedom: Freedom) -> u32 {
        self.x.push(x);
        self.kinds.push(kind);
        self.freedom.push(freedom);
        self.incidence.add_vertex();
        self.colours.push(NO_COLOUR);
        self.changed.push(self.clock);
        self.tangents.push(UNKNOWN);
        self.x.len() as u32 - 1
    }

    /// The isosurface at a vertex.
    /// What is known is valid only where the vertex lies bit by bit; else the field is asked, without keeping the
    /// answer.
    pub(crate) fn tangent(&self, v: u32, field: &Isosurface<'_>) -> Tangent {
        let known = self.tangents[v as usize];
        if known.at == self.x[v as usize] {
            known
        } else {
            let part = self.freedom[v as usize].part_of(field);
            part.tangent(&self.x[v as usize])
        }
    }

    /// Asks for the isosurface at those of the vertices that lie on it and have moved since.
    /// With one call for all of them, if the field takes many points.
    pub(crate) fn know_tangents(
        &mut self,
        vertices: &[u32],
        field: &Isosurface<'_>,
    ) -> Result<(), Error> {
        let stale: Vec<u32> = vertices
            .iter()
            .copied()
            .filter(|&v| {
                let v = v as usize;
                self.freedom[v].on_field() && self.tangents[v].at != self.x[v]
            })
            .collect();
        let at: Vec<Point3> = stale.iter().map(|&v| self.x[v as usize]).collect();
        for (v, tangent) in stale.into_iter().zip(field.tangents(&at)?) {
            let plane = self.freedom[v as usize].plane();
            self.tangents[v as usize] = plane.map_or(tangent, |plane| plane.restrict(tangent));
        }
        Ok(())
    }

    /// Keeps what is known of the isosurface where a vertex now lies.
    pub(crate) fn set_tangent(&mut self, v: u32, tangent: Tangent) {
        self.tangents[v as usize] = tangent;
    }

    /// Moves a vertex and measures its tetrahedra anew.
    /// For single moves within a change; sweeps write positions themselves and call [`EditableMesh::refresh`] once.
    pub(crate) fn set_position(&mut self, v: u32, x: Point3) {
        self.x[v as usize] = x;
        for i in 0..self.incidence.of(v).len() {
            let t = self.incidence.of(v)[i];
            self.q[t as usize] = self.quality_of(self.tets[t as usize]);
            self.touch(self.tets[t as usize]);
        }
    }

    /// Vertices have moved: measures the tetrahedra around them anew.
    pub(crate) fn refresh(&mut self, moved: &[u32]) {
        // Each tetrahedron has four corners: with many moved ones it is cheaper to measure all once.
        let all = moved.len() * 24 > self.tets.len();
        if all {
            self.measure_all();
            self.changed.fill(self.clock);
            return;
        }
        let state = &*self;
        let fresh: Vec<(u32, f64)> = parallel::flat_map(moved.len(), |i| {
            let around = state.incidence.of(moved[i]).iter();
            around.map(|&t| (t, state.quality_of(state.tets[t as usize])))
        });
        for (t, q) in fresh {
            self.q[t as usize] = q;
            self.touch(self.tets[t as usize]);
        }
    }

    /// The smallest objective; +∞ for an empty mesh.
    pub(crate) fn worst(&self) -> f64 {
        let of_chunk = |chunk: std::ops::Range<usize>| {
            self.q[chunk].iter().copied().fold(f64::INFINITY, f64::min)
        };
        let of_chunks = parallel::fold_chunks(self.q.len(), of_chunk);
        of_chunks.into_iter().fold(f64::INFINITY, f64::min)
    }

    /// Tetrahedra with `q < bound`, worst first, equal ones by number.
    /// The order of work, and of what is named in reports: it does not depend on threads.
    pub(crate) fn below(&self, bound: f64) -> Vec<u32> {
        self.below_and(bound, |_| true)
    }

    /// Those of [`EditableMesh::below`] that are also `fit`.
    pub(crate) fn below_and(&self, bound: f64, fit: impl Fn(u32) -> bool + Sync) -> Vec<u32> {
        let mut bad: Vec<(f64, u32)> = parallel::flat_map(self.tets.len(), |t| {
            let (q, t) = (self.q[t], t as u32);
            (q < bound && fit(t)).then_some((q, t))
        });
        bad.par_sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        bad.into_iter().map(|b| b.1).collect()
    }

    /// Is the vertex part of the result? Those whose tetrahedra have all vanished are not.
    pub(crate) fn keeps(&self, v: u32) -> bool {
        !self.incidence.of(v).is_empty() || self.unused.get(v as usize) == Some(&true)
    }

    /// The mesh without empty slots and vanished vertices. Order is kept.
    /// Vertices that the input had without a tetrahedron stay, since callers may count on them.
    pub(crate) fn finish(self) -> TetMesh {
        let used: Vec<bool> = (0..self.x.len() as u32).map(|v| self.keeps(v)).collect();
        let mut new = vec![NONE; self.x.len()];
        let places = new.iter_mut().zip(&used).filter(|p| *p.1);
        for (count, (place, _)) in places.enumerate() {
            *place = count as u32;
        }
        let pick = |v: &usize| used[*v];
        let positions = (0..used.len()).filter(pick).map(|v| self.x[v]).collect();
        let kinds = (0..used.len())
            .filter(pick)
            .map(|v| self.kinds[v])
            .collect();
        let alive = || (0..self.tets.len()).filter(|&t| self.tets[t][0] != NONE);
        let tets = alive()
            .map(|t| self.tets[t].map(|v| new[v as usize]))
            .collect();
        let regions = alive().map(|t| self.regions[t]).collect();
        TetMesh::with_kinds(positions, tets, regions, kinds)
            .expect("the operations keep the mesh valid")
    }
}
