//! The cavity volume guard. Where the other side of a boundary is not meshed, no tetrahedron there
//! keeps a small cavity from being pulled through itself: many small steps, each of them valid, can
//! turn its wall inside out. So the volume that each wall encloses is kept up to date, and no change
//! may take more than a share of it.

use geom_core::Point3;
use geom_core::compute::sets::DisjointSets;
use geom_core::mesh::{EDGES, VertexKind, six_volume};

use crate::mesh::editable::EditableMesh;
use crate::mesh::incidence::NONE;
use crate::mesh::link::hull;
use crate::mesh::proposal::{NEW, Proposal};

/// Share of its volume that a cavity keeps.
/// Enough that it does not turn inside out, little enough that its wall may still be smoothed.
const KEPT: f64 = 0.25;
/// The wall of a vertex where several parts of the boundary touch.
const SEVERAL: u32 = NONE - 1;

/// The walls of cavities: the closed parts of the boundary that enclose a negative volume, since what
/// they enclose is not meshed.
///
/// Volumes are kept up by differences: a move adds what the tetrahedra around it gain. A vertex where several parts of
/// the boundary touch is a junction, which stays.
#[derive(Clone, Default)]
pub(crate) struct CavityGuard {
    /// Per vertex: the number of its wall, [`NONE`] or [`SEVERAL`]. Later vertices may be missing.
    pub(crate) labels: Vec<u32>,
    pub(crate) all: Vec<Wall>,
}

/// Both are negative. `most` is a quarter of the volume at the start.
#[derive(Clone)]
pub(crate) struct Wall {
    /// Six times the signed volume that it encloses.
    pub(crate) volume: f64,
    /// What that may not exceed.
    pub(crate) most: f64,
}

/// What a change takes from a cavity.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Rise {
    wall: usize,
    /// By how much six times the signed volume of the wall rises.
    volume: f64,
}

impl CavityGuard {
    /// The walls of a mesh, from the faces of its boundary, counter-clockwise from outside.
    fn new(x: &[Point3], faces: &[[u32; 3]]) -> Self {
        // Faces with a common edge belong together.
        let mut sets = DisjointSets::new(faces.len());
        let mut edges: Vec<([u32; 2], u32)> = (0u32..)
            .zip(faces)
            .flat_map(|(f, &[a, b, c])| {
                [[a, b], [b, c], [c, a]].map(|[u, v]| ([u.min(v), u.max(v)], f))
            })
            .collect();
        edges.sort_unstable();
        for pair in edges.windows(2).filter(|p| p[0].0 == p[1].0) {
            sets.join(pair[0].1, pair[1].1);
        }
        // A part goes by its first face.
        let parts = sets.into_roots();
        let mut volumes = vec![0.0; faces.len()];
        for (face, &part) in faces.iter().zip(&parts) {
            let about = x[faces[part as usize][0] as usize];
            volumes[part as usize] += cone(about, face.map(|v| x[v as usize]));
        }
        let mut walls = Self::default();
        let numbers: Vec<u32> = volumes
            .into_iter()
            .map(|volume| {
                if volume >= 0.0 {
                    return NONE;
                }
                let most = KEPT * volume;
                walls.all.push(Wall { volume, most });
                walls.all.len() as u32 - 1
            })
            .collect();
        if walls.all.is_empty() {
            return walls;
        }
        // To which part a vertex belongs, walls or not.
        let mut part_of = vec![NONE; x.len()];
        for (face, &part) in faces.iter().zip(&parts) {
            for &v in face {
                let known = &mut part_of[v as usize];
                *known = match *known {
                    NONE => part,
                    p if p == part => part,
                    _ => SEVERAL,
                };
            }
        }
        walls.labels = part_of
            .into_iter()
            .map(|part| match part {
                NONE | SEVERAL => part,
                part => numbers[part as usize],
            })
            .collect();
        walls
    }

    /// The label of a vertex: a number of `all`, [`NONE`] or [`SEVERAL`].
    pub(crate) fn at(&self, v: u32) -> u32 {
        self.labels.get(v as usize).copied().unwrap_or(NONE)
    }

    /// The wall that things with these corners lie on.
    /// `None` if any of them lies on no wall, or two on different ones; corners where several parts touch fit any.
    fn common<const N: usize>(labels: [u32; N]) -> Option<usize> {
        let mut wall = SEVERAL;
        for label in labels {
            match label {
                NONE => return None,
                SEVERAL => {}
                label if wall == SEVERAL || wall == label => wall = label,
                _ => return None,
            }
        }
        (wall != SEVERAL).then_some(wall as usize)
    }

    /// Looks for the cavities of a mesh.
    pub(crate) fn of(mesh: &EditableMesh) -> Self {
        Self::new(&mesh.x, &mesh.boundary_faces())
    }

    /// By how much a vertex that goes to `x` would take from its cavity; `None` without one.
    /// Linear in the number of tetrahedra around `v`.
    pub(crate) fn rise_of_move(&self, mesh: &EditableMesh, v: u32, x: Point3) -> Option<Rise> {
        let wall = Self::common([self.at(v)])?;
        // What the mesh gains is what the cavity loses.
        let volume = mesh
            .incidence
            .of(v)
            .iter()
            .map(|&t| {
                let tet = mesh.tets[t as usize];
                let before = mesh.corners(tet);
                let mut after = before;
                let corner = tet.iter().position(|&u| u == v).expect("a corner");
                after[corner] = x;
                six_volume(after) - six_volume(before)
            })
            .sum();
        Some(Rise { wall, volume })
    }

    /// By how much the volumes of walls rise with a change. Only the hull of what changes counts;
    /// what of it is not boundary is the same before and after.
    pub(crate) fn rises(&self, mesh: &EditableMesh, proposal: &Proposal) -> Vec<Rise> {
        if self.all.is_empty() {
            return Vec::new();
        }
        let mut patch = proposal.remove.clone();
        patch.extend(
            proposal
                .moves
                .iter()
                .flat_map(|m| mesh.incidence.of(m.vertex)),
        );
        patch.sort_unstable();
        patch.dedup();
        let tet_of = |&t: &u32| mesh.tets[t as usize];
        let on_wall = |v: u32| self.at(v) != NONE;
        if !patch.iter().flat_map(tet_of).any(on_wall) {
            return Vec::new();
        }
        let about = mesh.x[tet_of(&patch[0])[0] as usize];
        let new = self.label_of_new(mesh, proposal);
        let label = |v: u32| if v == NEW { new } else { self.at(v) };
        let mut rises: Vec<Rise> = Vec::new();
        let mut add = |face: [u32; 3], volume: f64| {
            let Some(wall) = Self::common(face.map(label)) else {
                return;
            };
            match rises.iter_mut().find(|r| r.wall == wall) {
                Some(rise) => rise.volume += volume,
                None => rises.push(Rise { wall, volume }),
            }
        };
        for face in hull(patch.iter().map(tet_of)) {
            add(face, -cone(about, face.map(|v| mesh.x[v as usize])));
        }
        let kept = patch.iter().filter(|t| !proposal.remove.contains(t));
        let inserted = proposal.insert.iter().map(|new| new.corners);
        for face in hull(kept.map(tet_of).chain(inserted)) {
            let after = face.map(|v| proposal.position_after(mesh, v));
            add(face, cone(about, after));
        }
        rises
    }

    /// May the volume of a wall rise so much? A cavity that is too small already may only grow.
    pub(crate) fn allows(&self, rise: &Rise) -> bool {
        let wall = &self.all[rise.wall];
        rise.volume <= 0.0 || wall.volume + rise.volume <= wall.most
    }

    /// A change that takes so much is made.
    pub(crate) fn record(&mut self, rise: &Rise) {
        self.all[rise.wall].volume += rise.volume;
    }

    /// Keeps the labels of vertices up to date; to be called before the change is made.
    pub(crate) fn record_new_vertex(&mut self, mesh: &EditableMesh, proposal: &Proposal) {
        if proposal.vertex.is_some() && !self.all.is_empty() {
            let label = self.label_of_new(mesh, proposal);
            self.labels.resize(mesh.x.len(), NONE);
            self.labels.push(label);
        }
    }

    /// The wall that the new vertex of a change comes to lie on: that of the edge which it splits.
    fn label_of_new(&self, mesh: &EditableMesh, proposal: &Proposal) -> u32 {
        let on_surface = proposal
            .vertex
            .is_some_and(|new| new.kind == VertexKind::Surface);
        if !on_surface {
            return NONE;
        }
        // Its ends are the corners that have been together and no longer are.
        let tet = mesh.tets[proposal.remove[0] as usize];
        EDGES
            .into_iter()
            .map(|e| e.map(|i| tet[i]))
            .find(|[a, b]| {
                let mut inserted = proposal.insert.iter().map(|new| new.corners);
                !inserted.any(|t| t.contains(a) && t.contains(b))
            })
            .and_then(|ends| Self::common(ends.map(|v| self.at(v))))
            .map_or(NONE, |wall| wall as u32)
    }
}

/// Six times the signed volume between a point and a triangle.
/// Summed over a closed surface, the same for any point, six times its volume.
fn cone(about: Point3, [a, b, c]: [Point3; 3]) -> f64 {
    six_volume([about, a, b, c])
}
