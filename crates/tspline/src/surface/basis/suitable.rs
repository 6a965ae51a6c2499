//! T-meshes that are analysis-suitable: no extension of a T-junction meets one that runs across it.
//!
//! The extension of a T-junction goes on into the element on whose side it lies until it has met two edges across, and back
//! until it has met one. Where none of the one direction touches one of the other, the T-spline functions of the mesh sum to
//! one, are linearly independent, and contain all bicubics (Li, Zheng, Sederberg, Hughes and Scott 2012; Beirão da Veiga,
//! Buffa, Cho and Sangalli 2012). Extensions lie along fine quads, so that they meet in vertices of the fine mesh: nothing
//! is measured.
//!
//! Cutting the elements that T-junctions lie on ends in a suitable mesh, at the latest when all are fine. Squares are a poor
//! means to it: each corner of a finer part has two extensions that meet, and moves on when an element there is cut. It costs
//! little where finer parts end along whole lines of quads, and [`suitable`] refuses where it costs more than allowed.

use geom_core::options::require;
use geom_core::{HalfedgeId, VertexId};

use super::knots::ahead;
use crate::{Error, TMesh, TMeshOptions, VertexKind};

/// How much larger a T-mesh may become by default: beyond, the hierarchical basis is the better choice.
pub const GROWTH: f64 = 1.3;

/// The T-mesh with elements cut until it is analysis-suitable.
///
/// Where extensions meet, the larger of the two elements that the T-junctions lie on is cut, with whatever else the rules of
/// T-meshes ask for, and so on. `most` is how many times as many elements there may be in the end, at least 1.
///
/// ```
/// use tspline::geom_core::{Point3, mesh::shapes};
/// use tspline::surface::suitable::{GROWTH, meetings, suitable};
/// use tspline::{TMesh, TMeshOptions, levels::centres};
/// let (fine, rules) = (shapes::quad_sphere(1.0, 16), TMeshOptions::default());
/// let of = |level: fn(Point3) -> u8| {
///     let levels: Vec<u8> = centres(&fine).into_iter().map(level).collect();
///     TMesh::build(&fine, &levels, &rules)
/// };
/// // Half of a sphere, along a line of quads, is suitable as it is; an oblique cap would become fine all over.
/// assert_eq!(meetings(&of(|p| u8::from(p.x < -0.01))?), 0);
/// let oblique = of(|p| u8::from(p.z + 0.4 * p.x < 0.8))?;
/// assert!(meetings(&oblique) > 0 && suitable(oblique, GROWTH, &rules).is_err());
/// # Ok::<(), tspline::Error>(())
/// ```
///
/// # Errors
/// [`Error::NotSuitable`] if it would become larger; [`Error::Open`] on an open surface, for which there are no T-splines
/// here; [`Error::Option`].
pub fn suitable(mesh: TMesh, most: f64, rules: &TMeshOptions) -> Result<TMesh, Error> {
    require(most >= 1.0, "most", most, "be at least 1")?;
    closed(&mesh)?;
    let before = mesh.elements().len();
    let (mut met, mut mesh) = (pairs(&mesh), mesh);
    let first = met.len();
    while !met.is_empty() {
        let mut cut: Vec<usize> = met.iter().map(|pair| larger(&mesh, pair)).collect();
        cut.sort_unstable();
        cut.dedup();
        mesh = mesh.cut(&cut, rules)?;
        let elements = mesh.elements().len();
        if elements as f64 > most * before as f64 {
            return Err(Error::NotSuitable {
                meetings: first,
                elements,
                before,
            });
        }
        met = pairs(&mesh);
    }
    Ok(mesh)
}

/// In how many vertices of the fine mesh extensions of T-junctions meet others across, or end at an extraordinary vertex: none
/// if the T-mesh is analysis-suitable.
pub fn meetings(mesh: &TMesh) -> usize {
    pairs(mesh).len()
}

/// Refuses what is not suitable as it is.
pub(super) fn check(mesh: &TMesh) -> Result<(), Error> {
    closed(mesh)?;
    let (meetings, elements) = (meetings(mesh), mesh.elements().len());
    match meetings {
        0 => Ok(()),
        _ => Err(Error::NotSuitable {
            meetings,
            elements,
            before: elements,
        }),
    }
}

/// Refuses a boundary, beyond which knots would have to be made up.
pub(super) fn closed(mesh: &TMesh) -> Result<(), Error> {
    let edges = mesh.fine_edges();
    match edges.iter().any(|h| edges.twin(h).is_none()) {
        true => Err(Error::Open {
            what: "a basis of T-splines",
        }),
        false => Ok(()),
    }
}

/// The T-junctions whose extensions meet, a pair per fine vertex where that happens; twice the same where its extension touches
/// an extraordinary vertex.
fn pairs(mesh: &TMesh) -> Vec<[u32; 2]> {
    let mut met = vec![[None; 2]; mesh.fine().positions().len()];
    let mut found = Vec::new();
    for v in 0..mesh.positions().len() as u32 {
        let Some(rays) = rays(mesh, v) else { continue };
        for (ray, knots) in [(rays[0], 1), (rays[1], 0)] {
            for (place, line) in visited(mesh, ray, ahead(mesh, ray)[knots]) {
                let of: &mut [Option<u32>; 2] = &mut met[place as usize];
                match (line, of[line.unwrap_or(0)]) {
                    (None, _) => found.push([v, v]),
                    (Some(line), None) => {
                        of[line] = Some(v);
                        found.extend(of[1 - line].map(|other| [other, v]));
                    }
                    (Some(_), Some(_)) => {}
                }
            }
        }
    }
    found
}

/// The fine half-edges that leave a T-junction into the element on whose side it lies, and the other way; `None` for any other
/// vertex.
fn rays(mesh: &TMesh, vertex: u32) -> Option<[HalfedgeId; 2]> {
    if mesh.kind(vertex as usize) != VertexKind::TJunction {
        return None;
    }
    let edges = mesh.fine_edges();
    let fine = VertexId(mesh.fine_of_vertex(vertex as usize));
    let around: Vec<HalfedgeId> = edges.around(fine).collect();
    let element = |h: HalfedgeId| mesh.element_of(edges.face(h).0 as usize);
    let inside = |&h: &HalfedgeId| edges.twin(h).is_some_and(|g| element(g) == element(h));
    let on = around.iter().position(inside)?;
    Some([around[on], around[(on + 2) % 4]])
}

/// The fine vertices along a ray of so many sides of quads, both ends included, and along which of its two lines it goes
/// through each; none at an extraordinary vertex, where it ends.
fn visited(mesh: &TMesh, start: HalfedgeId, length: i64) -> Vec<(u32, Option<usize>)> {
    let edges = mesh.fine_edges();
    let (mut h, mut out) = (Some(start), Vec::new());
    for _ in 0..=length {
        let Some(leaving) = h else { break };
        let place = edges.from(leaving);
        if mesh.is_extraordinary(place.0) {
            out.push((place.0, None));
            break;
        }
        let line = edges.around(place).position(|g| g == leaving);
        out.push((place.0, line.map(|k| k % 2)));
        // Straight on from its end.
        h = edges.twin(edges.next(leaving)).map(|g| edges.next(g));
    }
    out
}

/// Of the elements that two T-junctions lie on the larger one, or else the first.
fn larger(mesh: &TMesh, pair: &[u32; 2]) -> usize {
    let edges = mesh.fine_edges();
    let host = |&v: &u32| {
        let [on, _] = rays(mesh, v).expect("pairs are of T-junctions");
        mesh.element_of(edges.face(on).0 as usize) as usize
    };
    let [a, b] = [host(&pair[0]), host(&pair[1])];
    let level = |e: usize| mesh.elements()[e].level;
    match level(a).cmp(&level(b)) {
        std::cmp::Ordering::Greater => a,
        std::cmp::Ordering::Less => b,
        std::cmp::Ordering::Equal => a.min(b),
    }
}
