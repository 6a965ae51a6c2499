//! Quads of any surface: the last resort.
//!
//! Needs neither field nor map, only a manifold: a polygon of n sides cut at its centre becomes n quads, whatever its
//! shape. Pairing triangles first leaves fewer irregular vertices: the centre of a triangle has three quads, that of a
//! pair four.

use geom_core::id::Id;
use geom_core::mesh::Halfedges;
use geom_core::{HalfedgeId, Point3, QuadMesh, TriMesh, VertexId};

use super::quality::scaled_jacobian;
use crate::Error;

/// Pairs of triangles whose quad is worse stay triangles.
const WORST_PAIR: f64 = 0.3;

/// Triangles paired to quads as far as they make good ones and leave no vertex with two, the best first; then every
/// triangle and quad is cut at its centre and the midpoints of its sides (one step of Catmull–Clark topology). The result is all quads, and a
/// manifold with the input's topology whatever the input. `keep` names half-edges that must stay.
pub(crate) fn split_quads(mesh: &TriMesh, keep: &[bool]) -> Result<QuadMesh, Error> {
    let edges = Halfedges::of(mesh)?;
    let partner = pairs(mesh, &edges, keep);
    let mut positions: Vec<Point3> = mesh.positions().to_vec();
    let mut midpoint = vec![u32::MAX; edges.len()];
    let twin = |h: u32| edges.twin(HalfedgeId(h)).map(|t| t.0);
    let mut mid = |h: u32, positions: &mut Vec<Point3>| -> u32 {
        let rep = twin(h).map_or(h, |t| t.min(h)) as usize;
        if midpoint[rep] == u32::MAX {
            let id = HalfedgeId(h);
            let [a, b] = [edges.from(id), edges.to(id)].map(|v| mesh.positions()[v.index()]);
            midpoint[rep] = positions.len() as u32;
            positions.push(geom_core::nalgebra::center(&a, &b));
        }
        midpoint[rep]
    };
    let mut quads = Vec::new();
    for f in 0..mesh.triangles().len() as u32 {
        let sides: Vec<u32> = match partner[f as usize] {
            None => (3 * f..3 * f + 3).collect(),
            Some(h) => {
                let t = twin(h).expect("pairs share an edge");
                if t / 3 < f {
                    continue;
                }
                let next = |h: u32| edges.next(HalfedgeId(h)).0;
                vec![next(h), next(next(h)), next(t), next(next(t))]
            }
        };
        let corner = |h: u32| edges.from(HalfedgeId(h)).0;
        let sum = sides.iter().fold(geom_core::Vector3::zeros(), |sum, &h| {
            sum + mesh.positions()[corner(h) as usize].coords
        });
        let centre = positions.len() as u32;
        positions.push(Point3::from(sum / sides.len() as f64));
        for k in 0..sides.len() {
            let before = sides[(k + sides.len() - 1) % sides.len()];
            let (a, b) = (mid(sides[k], &mut positions), mid(before, &mut positions));
            quads.push([corner(sides[k]), a, centre, b]);
        }
    }
    Ok(QuadMesh::new(positions, quads)?)
}

/// Per triangle, the half-edge it shares with its partner.
///
/// Greedy, by the scaled Jacobian that a pair would have: not the most pairs, but the best ones first. A vertex inside
/// keeps three faces at least.
fn pairs(mesh: &TriMesh, edges: &Halfedges<3>, keep: &[bool]) -> Vec<Option<u32>> {
    let mut candidates: Vec<(f64, u32, u32)> = edges
        .edges()
        .filter_map(|h| edges.twin(h).map(|t| (h.0, t.0)))
        .filter(|&(h, t)| !keep[h as usize] && !keep[t as usize])
        .map(|(h, t)| {
            let (f, g) = (h as usize / 3, t as usize / 3);
            let at = |h: u32| mesh.positions()[edges.from(HalfedgeId(h)).index()];
            let opposite = |h: u32| at(edges.previous(HalfedgeId(h)).0);
            let corners = [at(t), opposite(h), at(h), opposite(t)];
            let normal = mesh.doubled_area_normal(f) + mesh.doubled_area_normal(g);
            (scaled_jacobian(&corners, &normal), h, t)
        })
        .filter(|c| c.0 > WORST_PAIR)
        .collect();
    candidates.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
    let vertices = (0..edges.vertices() as u32).map(VertexId);
    let mut faces: Vec<usize> = vertices.clone().map(|v| edges.around(v).count()).collect();
    let inside: Vec<bool> = vertices.map(|v| !edges.on_boundary(v)).collect();
    let mut partner = vec![None; mesh.triangles().len()];
    for (_, h, t) in candidates {
        let (f, g) = (h as usize / 3, t as usize / 3);
        let ends = [h, t].map(|h| edges.from(HalfedgeId(h)).index());
        // Two quads around a vertex would share two sides, and one of them could not be upright.
        let doublet = ends.iter().any(|&v| inside[v] && faces[v] == 3);
        if partner[f].is_none() && partner[g].is_none() && !doublet {
            partner[f] = Some(h);
            partner[g] = Some(t);
            for v in ends {
                faces[v] -= 1;
            }
        }
    }
    partner
}
