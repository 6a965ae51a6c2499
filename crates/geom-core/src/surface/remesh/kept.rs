//! Which edges and vertices of the surface stay: creases, boundaries, lines between labels, and their corners.
//!
//! Marks come from the options, once; afterwards they travel with the edges. Kinds of vertices follow from the marks
//! around them: none, two (a curve), or anything else (a corner), and a curve has corners where it bends.

use super::mesh::{Kind, Mark, Mesh};
use super::options::{Error, Features};
use super::sizes::Sizes;
use crate::{TriMesh, Vector3};

/// A kept curve that turns by more than this within a wanted edge has a corner there: cos 45°.
const CORNER: f64 = std::f64::consts::FRAC_1_SQRT_2;
/// Where a kept curve runs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Course {
    /// Where the surface ends: it stays where the input has it.
    Boundary,
    /// Across a smooth surface, which it follows.
    Within,
    /// Along a crease of the input; there is no normal.
    Crease,
}

impl Course {
    pub(super) fn of_edge(mesh: &Mesh, h: u32) -> Self {
        match (mesh.mark(h), mesh.twin(h)) {
            (Mark::Crease, _) => Self::Crease,
            (_, None) => Self::Boundary,
            _ => Self::Within,
        }
    }

    pub(super) fn of_vertex(mesh: &Mesh, v: u32) -> Self {
        if on_crease(mesh, v) {
            Self::Crease
        } else if mesh.on_boundary(v) {
            Self::Boundary
        } else {
            Self::Within
        }
    }
}

/// Marks the edges that the options ask to keep.
pub(super) fn mark_features(
    work: &mut Mesh,
    input: &TriMesh,
    features: &Features,
    sizes: &Sizes,
) -> Result<(), Error> {
    match features {
        Features::None => {}
        Features::Angle(degrees) => {
            let least = degrees.to_radians().cos();
            let normal = |h: u32| input.doubled_area_normal((h / 3) as usize).normalize();
            let sharp: Vec<u32> = work
                .edges()
                .filter(|&h| {
                    work.twin(h)
                        .is_some_and(|g| normal(h).dot(&normal(g)) < least)
                })
                .collect();
            for h in sharp {
                work.mark_crease(h);
            }
            for v in 0..work.vertices.len() as u32 {
                drop_spur(work, v, sizes.at(v));
            }
        }
        Features::Edges(edges) => {
            for (feature, &[from, to]) in edges.iter().enumerate() {
                let missing = Error::NoSuchEdge { feature, from, to };
                if from as usize >= work.vertices.len() || to as usize >= work.vertices.len() {
                    return Err(missing);
                }
                let leaving = work.fan(from).find(|&h| work.to(h) == to);
                let h = leaving.or_else(|| work.fan(to).find(|&h| work.to(h) == from));
                work.mark_crease(h.ok_or(missing)?);
            }
        }
    }
    Ok(())
}

/// Does a crease pass through the vertex?
pub(super) fn on_crease(work: &Mesh, v: u32) -> bool {
    work.fan(v).any(|h| work.mark(h) == Mark::Crease)
}

/// Takes away a crease that begins at `v` and ends, or meets others, before a wanted edge is over: it
/// is noise. Angles at single edges of rough surfaces exceed any bound somewhere; what is a feature goes on.
fn drop_spur(work: &mut Mesh, v: u32, length: f64) {
    let creases = |work: &Mesh, v: u32| -> Vec<u32> {
        work.fan(v)
            .filter(|&h| work.mark(h) == Mark::Crease)
            .collect()
    };
    if work.on_boundary(v) {
        return;
    }
    let [mut h] = creases(work, v)[..] else {
        return;
    };
    let (mut chain, mut way) = (vec![h], work.length(h));
    while way < length {
        let w = work.to(h);
        let onward: Vec<u32> = creases(work, w)
            .into_iter()
            .filter(|&g| Some(g) != work.twin(h))
            .collect();
        let [next] = onward[..] else { break };
        if work.on_boundary(w) {
            break;
        }
        h = next;
        chain.push(h);
        way += work.length(h);
    }
    if way < length {
        for h in chain {
            work.unmark_crease(h);
        }
    }
}

/// What holds each vertex. A vertex on no kept edge is smooth, one where one, three or more end or meet is a corner. On
/// curves the bend is seen over a wanted edge to both sides, so that fine zigzag is no row of corners.
pub(super) fn kinds(work: &Mesh, sizes: &Sizes) -> Vec<Kind> {
    let vertices = 0..work.vertices.len() as u32;
    let neighbours: Vec<Option<[u32; 2]>> = vertices
        .clone()
        .map(|v| {
            let ends: Vec<u32> = work.curve_ring(v).collect();
            <[u32; 2]>::try_from(ends).ok()
        })
        .collect();
    // The cosine by which a curve turns at a vertex, seen from a wanted edge away on both sides, and
    // the vertices within half of that.
    let turn = |v: u32| -> Option<(f64, Vec<u32>)> {
        let ends = neighbours[v as usize]?;
        let (p, length) = (work.position(v), sizes.at(v));
        let mut passed = Vec::new();
        let [u, w] = ends.map(|first| {
            let (mut before, mut here, mut way) = (v, first, 0.0);
            loop {
                let (a, b) = (work.position(before), work.position(here));
                let step = (b - a).norm();
                if way + step >= length {
                    return a + (b - a) * ((length - way) / step) - p;
                }
                way += step;
                if way <= 0.5 * length {
                    passed.push(here);
                }
                match neighbours[here as usize] {
                    Some([x, y]) if here != v => {
                        (before, here) = (here, if x == before { y } else { x });
                    }
                    _ => return b - p,
                }
            }
        });
        let cosine = -u.dot(&w) / (u.norm() * w.norm()).max(f64::MIN_POSITIVE);
        Some((cosine, passed))
    };
    // Where labels meet, the line follows the input's edges in zigzag: no corners.
    let turns: Vec<Option<(f64, Vec<u32>)>> = vertices
        .clone()
        .map(|v| match neighbours[v as usize] {
            Some(_) if Course::of_vertex(work, v) != Course::Within => turn(v),
            _ => None,
        })
        .collect();
    vertices
        .map(|v| {
            if neighbours[v as usize].is_none() {
                let inside = work.curve_ring(v).next().is_none();
                return if inside { Kind::Smooth } else { Kind::Corner };
            }
            let Some((cosine, passed)) = &turns[v as usize] else {
                return Kind::Curve;
            };
            // Of a bend that several vertices see, the sharpest is the corner.
            let sharpest = passed.iter().all(|&w| match &turns[w as usize] {
                Some((other, _)) => (*cosine, v) < (*other, w),
                None => true,
            });
            if *cosine < CORNER && sharpest {
                Kind::Corner
            } else {
                Kind::Curve
            }
        })
        .collect()
}

/// Per corner the mean normal of the triangles around the vertex up to the next creases, weighted
/// by their angles. A vertex on a crease has thus several, one per sector.
pub(super) fn corner_normals(work: &Mesh, input: &TriMesh) -> Vec<[Vector3; 3]> {
    let weighted = |h: u32| {
        let (t, k) = ((h / 3) as usize, (h % 3) as usize);
        let p = input.corners(t);
        let (u, w) = (p[(k + 1) % 3] - p[k], p[(k + 2) % 3] - p[k]);
        input.doubled_area_normal(t).normalize() * u.angle(&w)
    };
    let mut normals = vec![[Vector3::zeros(); 3]; input.triangles().len()];
    for v in 0..work.vertices.len() as u32 {
        let mut fan: Vec<u32> = work.fan(v).collect();
        // Lets the fan start at a crease or boundary, so that sectors do not wrap around.
        let ends = |h: u32| work.mark(h) == Mark::Crease || work.twin(h).is_none();
        let start = fan.iter().position(|&h| ends(h)).unwrap_or(0);
        fan.rotate_left(start);
        let mut first = 0;
        while first < fan.len() {
            let end = (first + 1..fan.len())
                .find(|&i| ends(fan[i]))
                .unwrap_or(fan.len());
            let sum: Vector3 = fan[first..end].iter().map(|&h| weighted(h)).sum();
            for &h in &fan[first..end] {
                let own = input.doubled_area_normal((h / 3) as usize).normalize();
                normals[(h / 3) as usize][(h % 3) as usize] =
                    sum.try_normalize(1e-9).unwrap_or(own);
            }
            first = end;
        }
    }
    normals
}
