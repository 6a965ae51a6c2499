//! What a mesh falls short in after the improvement, and why.
//!
//! A mesh that misses its goals raises a question: is the improvement weak, or is it impossible? On a boundary
//! triangle that is a needle and may not move stands a tetrahedron that is no better, whatever lies inside. So the causes are looked for in an
//! order, from what surely forbids the goals to "nothing helped", and an element has the first that holds.

use geom_core::compute::parallel;
use geom_core::mesh::{EDGES, FACES};
use geom_core::{Point3, Vector3};

use crate::boundary::field::Isosurface;
use crate::measure::block::measures;
use crate::measure::metrics::Measures;
use crate::measure::report::Element;
use crate::mesh::editable::{EditableMesh, Freedom};
use crate::mesh::incidence::NONE;
use crate::mesh::link::{EdgeLink, InterfaceLink};
use crate::options::Goals;
use crate::smoothing::smooth::{foot, load};

/// How many elements and vertices a report names.
pub const NAMED: usize = 100;

/// Why a tetrahedron does not meet the goals.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[non_exhaustive]
pub enum Cause {
    /// The boundary forbids it: a boundary triangle that may not move is itself too slender, or lies
    /// with another such triangle on the two sides of too sharp a wedge. No tetrahedra inside can meet
    /// the goals there.
    Boundary,
    /// Surfaces touch or meet in one of its corners, which therefore stays, or moves along a curve at most.
    Junction,
    /// None of its corners may move.
    Fixed,
    /// All its corners lie on surfaces: the body, or the gap, is one tetrahedron wide.
    Narrow,
    /// It shares a corner with one of [`Cause::Boundary`] that is no better: smoothing attends to the worst
    /// around a vertex.
    Beside,
    /// No smoothing and no operation makes it better, or the passes were used up.
    Unsolved,
}

/// A tetrahedron that does not meet the goals.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct UnmetElement {
    /// Which, numbered as in the result.
    pub element: Element,
    /// Why.
    pub cause: Cause,
}

/// Why a surface vertex is farther from the isosurface than allowed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[non_exhaustive]
pub enum FarCause {
    /// The isosurface is not where the density's slope says: a pinch, a neck or a gap that is
    /// narrower than the tetrahedra.
    Pinch,
    /// On the isosurface the tetrahedra around it would miss the goals.
    Tetrahedra,
}

/// A surface vertex far from the isosurface.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct FarVertex {
    /// Which, numbered as in the result.
    pub vertex: u32,
    /// Where it lies, Å.
    pub position: Point3,
    /// First-order distance from the isosurface, Å.
    pub distance: f64,
    /// Why.
    pub cause: FarCause,
}

/// How well the surface vertices lie on the isosurface; empty without a field, and where
/// [`SurfaceMotion::Fixed`](crate::SurfaceMotion::Fixed) holds them.
#[derive(Clone, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct SurfaceFit {
    /// Vertices that belong to the isosurface.
    pub vertices: usize,
    /// How many are farther from it than [`Options::deviation`](crate::Options::deviation) allows.
    pub far: usize,
    /// Largest first-order distance, Å.
    pub largest: f64,
    /// The farthest ones, at most [`NAMED`].
    pub farthest: Vec<FarVertex>,
}

/// What falls short.
#[derive(Clone, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Unmet {
    /// Tetrahedra that do not meet the goals, by cause; causes without any are left out.
    pub counts: Vec<(Cause, usize)>,
    /// The worst of them, at most [`NAMED`].
    pub worst: Vec<UnmetElement>,
}

/// The tetrahedra that do not meet the goals, and why.
/// Numbers are those of the result, which has no empty slots. The worst come first, equal ones by number.
pub(crate) fn unmet(mesh: &EditableMesh, goals: &Goals, junctions: &[u32]) -> Unmet {
    let enough = goals.objective();
    let alive: Vec<u32> = (0..mesh.tets.len() as u32)
        .filter(|&t| !mesh.is_empty_slot(t))
        .collect();
    let mut all: Vec<(f64, UnmetElement)> = parallel::flat_map(alive.len(), |number| {
        let t = alive[number];
        let q = mesh.q[t as usize];
        // Most are good enough to meet whatever is asked for.
        if q >= enough {
            return None;
        }
        let corners = mesh.corners(mesh.tets[t as usize]);
        let m = measures(corners);
        if goals.met_by(&m) {
            return None;
        }
        let sum = corners.iter().fold(Vector3::zeros(), |s, p| s + p.coords);
        Some((
            q.min(enough),
            UnmetElement {
                element: Element {
                    tet: number as u32,
                    centroid: Point3::from(sum / 4.0),
                    measures: m,
                },
                cause: cause(mesh, t, &m, goals, junctions),
            },
        ))
    });
    all.sort_by(|a, b| {
        a.0.total_cmp(&b.0)
            .then(a.1.element.tet.cmp(&b.1.element.tet))
    });
    let mut counts: Vec<(Cause, usize)> = Vec::new();
    for (_, e) in &all {
        match counts.iter_mut().find(|c| c.0 == e.cause) {
            Some(c) => c.1 += 1,
            None => counts.push((e.cause, 1)),
        }
    }
    counts.sort_unstable();
    Unmet {
        counts,
        worst: all.into_iter().take(NAMED).map(|e| e.1).collect(),
    }
}

fn cause(mesh: &EditableMesh, t: u32, m: &Measures, goals: &Goals, junctions: &[u32]) -> Cause {
    let tet = mesh.tets[t as usize];
    let freedom = |v: u32| mesh.freedom[v as usize];
    if forbidden(mesh, t, m, goals) {
        Cause::Boundary
    } else if tet.iter().any(|v| junctions.binary_search(v).is_ok()) {
        Cause::Junction
    } else if tet.iter().all(|&v| freedom(v).is_fixed()) {
        Cause::Fixed
    } else if tet.iter().all(|&v| freedom(v) != Freedom::Free) {
        Cause::Narrow
    } else if beside_forbidden(mesh, t, goals) {
        Cause::Beside
    } else {
        Cause::Unsolved
    }
}

/// Does the boundary forbid that the tetrahedron, which misses the goals, meets them?
fn forbidden(mesh: &EditableMesh, t: u32, m: &Measures, goals: &Goals) -> bool {
    let tet = mesh.tets[t as usize];
    let region = mesh.regions[t as usize];
    let mut walls = (0..4)
        .filter(|&k| mesh.region_beyond(t, k) != region)
        .map(|k| FACES[k].map(|i| tet[i]))
        .filter(|f| f.iter().all(|&v| mesh.freedom[v as usize].is_fixed()));
    walls.any(|f| slender(mesh, f, goals))
        || (m.min_dihedral < goals.min_dihedral && in_sharp_wedge(mesh, t, goals))
}

/// Does a corner of the tetrahedron also belong to one that is no better and that the boundary forbids to
/// meet the goals?
fn beside_forbidden(mesh: &EditableMesh, t: u32, goals: &Goals) -> bool {
    let tet = mesh.tets[t as usize];
    let around = tet.iter().flat_map(|&v| mesh.incidence.of(v));
    around.copied().any(|o| {
        let m = measures(mesh.corners(mesh.tets[o as usize]));
        mesh.q[o as usize] <= mesh.q[t as usize]
            && !goals.met_by(&m)
            && forbidden(mesh, o, &m, goals)
    })
}

/// Can no tetrahedron on this triangle meet the goals? The best Joe–Liu measure on a base of area `A`
/// and squared edges of sum `s` is `4 √3 A / s`, with the apex above its centroid.
fn slender(mesh: &EditableMesh, f: [u32; 3], goals: &Goals) -> bool {
    let [a, b, c] = f.map(|v| mesh.x[v as usize]);
    let edges = [(b - a), (c - b), (a - c)].map(|e| e.norm_squared());
    let longest = edges.iter().copied().fold(0.0, f64::max);
    let shortest = edges.iter().copied().fold(f64::INFINITY, f64::min);
    let sum: f64 = edges.iter().sum();
    let area = (b - a).cross(&(c - a)).norm() / 2.0;
    longest > goals.edge_ratio * goals.edge_ratio * shortest
        || 4.0 * 3f64.sqrt() * area < goals.joe_liu * sum
}

/// Does an edge of the tetrahedron lie in a wedge between two boundary triangles that may not move and
/// that meet, inside its region, at less than the smallest angle? However many share the wedge, none
/// can have more.
fn in_sharp_wedge(mesh: &EditableMesh, t: u32, goals: &Goals) -> bool {
    let (tet, region) = (mesh.tets[t as usize], mesh.regions[t as usize]);
    let fixed = |v: u32| mesh.freedom[v as usize].is_fixed();
    EDGES.iter().any(|&[i, j]| {
        let (a, b) = (tet[i], tet[j]);
        if !fixed(a) || !fixed(b) {
            return false;
        }
        // Alone in its wedge, wherever that lies.
        let others = [0, 1, 2, 3].into_iter().filter(|&k| k != i && k != j);
        let mut own = others.clone().map(|k| tet[k]);
        if let (Some(u), Some(v)) = (own.next(), own.next())
            && fixed(u)
            && fixed(v)
            && others
                .into_iter()
                .all(|k| mesh.region_beyond(t, k) != region)
        {
            let [x, y, u, v] = [a, b, u, v].map(|p| mesh.x[p as usize]);
            return angle_at(x, y, u, v) < goals.min_dihedral;
        }
        let at_interface = EdgeLink::new(mesh, a, b).and_then(EdgeLink::at_interface);
        let Some(InterfaceLink { link, first }) = at_interface else {
            return false;
        };
        let at = link.tets.iter().position(|&o| o == t);
        let side = if at.is_some_and(|at| at < first) {
            0..first
        } else {
            first..link.tets.len()
        };
        let walls = [side.start, side.end].map(|k| link.vertices[k]);
        let angle: f64 = side
            .map(|k| [link.vertices[k], link.vertices[k + 1]].map(|v| mesh.x[v as usize]))
            .map(|[u, v]| angle_at(mesh.x[a as usize], mesh.x[b as usize], u, v))
            .sum();
        walls.iter().all(|&v| fixed(v)) && angle < goals.min_dihedral
    })
}

/// The angle at the edge `ab` from `u` to `v`, degrees.
fn angle_at(a: Point3, b: Point3, u: Point3, v: Point3) -> f64 {
    let along = b - a;
    let (n, m) = (along.cross(&(u - a)), along.cross(&(v - a)));
    n.cross(&m).norm().atan2(n.dot(&m)).to_degrees()
}

/// How well the surface vertices lie on the isosurface.
pub(crate) fn surface_fit(
    mesh: &EditableMesh,
    field: Option<&Isosurface<'_>>,
    tolerance: f64,
) -> SurfaceFit {
    let Some(field) = field else {
        return SurfaceFit::default();
    };
    // Numbers as of the result, which leaves out vertices that have vanished.
    let mut numbers = vec![NONE; mesh.x.len()];
    let mut next = 0;
    for (v, number) in numbers.iter_mut().enumerate() {
        if mesh.keeps(v as u32) {
            *number = next;
            next += 1;
        }
    }
    let on: Vec<u32> = (0..mesh.x.len() as u32)
        .filter(|&v| mesh.freedom[v as usize] == Freedom::Field && !mesh.incidence.of(v).is_empty())
        .collect();
    let distances: Vec<f64> = parallel::map_each(&on, |&v| mesh.tangent(v, field).distance().abs());
    // The farthest first; equal ones by number.
    let mut far: Vec<(f64, u32)> = distances
        .iter()
        .zip(&on)
        .filter(|d| *d.0 > tolerance)
        .map(|(&d, &v)| (d, v))
        .collect();
    far.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
    let mut star = crate::smoothing::star::Star::default();
    SurfaceFit {
        vertices: on.len(),
        far: far.len(),
        largest: distances.iter().copied().fold(0.0, f64::max),
        farthest: far
            .iter()
            .take(NAMED)
            .map(|&(distance, v)| {
                let position = mesh.x[v as usize];
                load(mesh, v, &mut star);
                let edge = star.mean_edge(&position.coords);
                // Where the steps do arrive, only the tetrahedra can have held it back.
                let reached = foot(mesh.tangent(v, field), edge, field, tolerance)
                    .is_some_and(|f| f.distance().abs() <= tolerance);
                FarVertex {
                    vertex: numbers[v as usize],
                    position,
                    distance,
                    cause: if reached {
                        FarCause::Tetrahedra
                    } else {
                        FarCause::Pinch
                    },
                }
            })
            .collect(),
    }
}
