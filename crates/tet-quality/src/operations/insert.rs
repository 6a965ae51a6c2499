//! Insertion of a vertex: an edge is split, and the new vertex goes to where it is best.
//!
//! All tetrahedra around the edge are cut in two. In the middle of the edge the new vertex makes nothing better: each half has
//! an angle of the whole. What helps is the freedom that it brings, so it is judged at the place that a search finds for it.

use geom_core::field;
use geom_core::mesh::VertexKind;
use geom_core::nalgebra::center;

use crate::boundary::field::{Isosurface, distance_within};
use crate::mesh::editable::{EditableMesh, Freedom};
use crate::mesh::link::EdgeLink;
use crate::mesh::proposal::{Floor, NEW, NewTet, NewVertex, Operation, Proposal};
use crate::smoothing::search::{Compass, search};
use crate::smoothing::smooth::axes_of;
use crate::smoothing::star::{Star, objective};

/// Rounds of the search for the place of the new vertex.
const ROUNDS: u32 = 5;
/// Distance from the isosurface from which one step leads close enough to it, in lengths of the edge.
const NEAR: f64 = 0.05;
/// Longest step to the isosurface, in lengths of the edge.
const STEP: f64 = 0.15;

/// Split of the edge `ab`. On the isosurface the new vertex is put onto it; other interface edges are
/// not split.
///
/// `None` where the tetrahedra around the edge are no fan or inverted, or the best place is not above `floor`. The link
/// condition needs no check: a split never changes the topology.
pub(crate) fn edge_split(
    mesh: &EditableMesh,
    a: u32,
    b: u32,
    surface: Option<&Isosurface<'_>>,
    floor: Floor,
    star: &mut Star,
) -> Option<Proposal> {
    let around = EdgeLink::new(mesh, a, b)?;
    let old = around
        .tets
        .iter()
        .map(|&t| mesh.q[t as usize])
        .fold(f64::INFINITY, f64::min);
    if old <= 0.0 {
        return None;
    }
    let mut x = center(&mesh.x[a as usize], &mesh.x[b as usize]);
    let (kind, freedom) = if around.interior() {
        (VertexKind::Interior, Freedom::Free)
    } else {
        let on_field = [a, b]
            .iter()
            .all(|&v| mesh.freedom[v as usize] == Freedom::Field);
        let surface = surface.filter(|_| on_field)?;
        let reach = (mesh.x[a as usize] - mesh.x[b as usize]).norm();
        // One step, and another one where that did not lead close enough.
        let way = field::Guard {
            steps: 1,
            halvings: 0,
            longest: STEP * reach,
            reach,
            near: NEAR * reach,
        };
        let look = |x| Some(surface.tangent(&x));
        let best = field::project(surface.tangent(&x), &way, look).best;
        x = best.at - best.normal() * distance_within(&best, STEP * reach);
        (VertexKind::Surface, Freedom::Field)
    };
    star.clear();
    let mut insert = Vec::with_capacity(2 * around.tets.len());
    for (i, w) in around.vertices.windows(2).enumerate() {
        // (a, b, u, v) becomes (new, b, u, v) and (a, new, u, v) = (new, a, v, u).
        for tet in [[NEW, b, w[0], w[1]], [NEW, a, w[1], w[0]]] {
            star.push([tet[1], tet[2], tet[3]].map(|v| mesh.x[v as usize]));
            insert.push(NewTet {
                corners: tet,
                region: around.regions[i],
            });
        }
    }
    if let Some(axes) = axes_of(freedom, None) {
        x = search(star, x.coords, &Compass::along(&axes), ROUNDS).into();
    }
    let worst = objective(star.value(&x.coords));
    if worst <= floor.above(old) {
        return None;
    }
    let gain = worst - old;
    let mut proposal = Proposal::swap(Operation::Insertion, gain, around.tets, insert);
    proposal.vertex = Some(NewVertex {
        position: x,
        kind,
        freedom,
    });
    Some(proposal)
}
