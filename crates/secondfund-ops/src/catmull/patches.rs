//! Patches: which control points shape a quad's part of the limit surface.

use geom_core::mesh::Halfedges;
use geom_core::{FaceId, HalfedgeId, VertexId, id::Id};

use super::ghosts::{Combination, Extended};
use super::tables::{MOST_VALENCE, control_points};
use crate::Error;

/// The control points of a quad, in the order of its table.
#[derive(Clone, Debug)]
pub(crate) struct Patch {
    /// The valence of its extraordinary corner, 4 for none.
    pub(crate) valence: usize,
    /// Vertices of the mesh, each once.
    pub(crate) ids: Vec<u32>,
    /// At a boundary: the points of the table as rows of combinations of `ids`.
    pub(crate) fold: Option<Vec<f64>>,
}

impl AsRef<[u32]> for Patch {
    fn as_ref(&self) -> &[u32] {
        &self.ids
    }
}

/// The patch of every quad of the mesh.
pub(crate) fn patches(extended: &Extended, count: usize) -> Result<Vec<Patch>, Error> {
    let vertices = extended.real + extended.ghosts.len();
    let edges = Halfedges::<4>::new(vertices, &extended.quads)?;
    let valences: Vec<u32> = (0..vertices)
        .map(|v| edges.around(VertexId(v as u32)).count() as u32)
        .collect();
    if let Some(vertex) = (0..extended.real).find(|&v| {
        let n = valences[v] as usize;
        n != 0 && !(3..=MOST_VALENCE).contains(&n)
    }) {
        return Err(Error::Valence {
            vertex,
            quads: valences[vertex] as usize,
            must: "a vertex inside the surface must have 3…32",
        });
    }
    (0..count)
        .map(|f| {
            let corner = |k: usize| edges.from(edges.of_face(FaceId(f as u32), k)).index();
            let odd = (0..4).find(|&k| valences[corner(k)] != 4);
            let start = edges.of_face(FaceId(f as u32), odd.unwrap_or(0));
            let points = match odd {
                None => grid(&edges, start),
                Some(_) => around_corner(&edges, start),
            };
            let valence = valences[edges.from(start).index()] as usize;
            assert_eq!(points.len(), control_points(valence), "the walk closes");
            Ok(folded(extended, valence, &points))
        })
        .collect()
}

/// Vertices all of whose corners are extraordinary but one cannot be walked: is a quad of the mesh such?
pub(crate) fn has_two_odd_corners(edges: &Halfedges<4>, quads: usize) -> bool {
    let odd = |v: VertexId| !edges.on_boundary(v) && edges.around(v).count() != 4;
    (0..quads).any(|f| {
        let corners = (0..4).map(|k| edges.from(edges.of_face(FaceId(f as u32), k)));
        corners.filter(|&v| odd(v)).count() > 1
    })
}

/// Across the edge, and onwards in the face beyond.
fn across(edges: &Halfedges<4>, h: HalfedgeId) -> HalfedgeId {
    edges.twin(h).expect("ghosts surround the mesh")
}

/// The far corners of the quad beyond edge `h`, seen from inside: beyond its start, beyond its end.
fn beyond(edges: &Halfedges<4>, h: HalfedgeId) -> [u32; 2] {
    let t = across(edges, h);
    // t runs from the end of h to its start.
    let far = edges.next(edges.next(t));
    [edges.from(far).0, edges.to(far).0]
}

/// The corner diagonally beyond the corner from which `h` starts, in the quad that shares only it.
fn diagonal(edges: &Halfedges<4>, h: HalfedgeId) -> u32 {
    let side = across(edges, edges.previous(h));
    let opposite = across(edges, edges.previous(side));
    edges.to(edges.next(opposite)).0
}

/// The 4 × 4 grid of a regular quad that starts with half-edge `h`.
fn grid(edges: &Halfedges<4>, h: HalfedgeId) -> Vec<u32> {
    let sides = [
        h,
        edges.next(h),
        edges.next(edges.next(h)),
        edges.previous(h),
    ];
    let [a, b, c, d] = sides.map(|s| edges.from(s).0);
    let [south, east, north, west] = sides.map(|s| beyond(edges, s));
    let [sw, se, ne, nw] = sides.map(|s| diagonal(edges, s));
    vec![
        sw, south[0], south[1], se, //
        west[1], a, b, east[0], //
        west[0], d, c, east[1], //
        nw, north[1], north[0], ne,
    ]
}

/// The points of a quad whose first corner, from which `h` starts, is extraordinary.
fn around_corner(edges: &Halfedges<4>, h: HalfedgeId) -> Vec<u32> {
    let ring: Vec<HalfedgeId> = std::iter::successors(Some(h), |&g| {
        let turned = across(edges, edges.previous(g));
        (turned != h).then_some(turned)
    })
    .collect();
    let mut points = vec![edges.from(h).0];
    points.extend(ring.iter().map(|&g| edges.to(g).0));
    points.extend(ring.iter().map(|&g| edges.to(edges.next(g)).0));
    let (east, north) = (edges.next(h), edges.next(edges.next(h)));
    let [e0, e1] = beyond(edges, east);
    let [n0, n1] = beyond(edges, north);
    points.extend([
        diagonal(edges, east),
        e0,
        e1,
        diagonal(edges, north),
        n0,
        n1,
        diagonal(edges, edges.previous(h)),
    ]);
    points
}

/// Ghosts replaced by what they are made of.
fn folded(extended: &Extended, valence: usize, points: &[u32]) -> Patch {
    if points.iter().all(|&p| (p as usize) < extended.real) && all_differ(points) {
        return Patch {
            valence,
            ids: points.to_vec(),
            fold: None,
        };
    }
    let combinations: Vec<Combination> = points
        .iter()
        .map(|&p| {
            let mut combination = Combination::new();
            extended.add(p, 1.0, &mut combination);
            combination
        })
        .collect();
    let mut ids: Vec<u32> = combinations.iter().flatten().map(|c| c.0).collect();
    ids.sort_unstable();
    ids.dedup();
    let mut fold = vec![0.0; points.len() * ids.len()];
    for (row, combination) in fold.chunks_mut(ids.len()).zip(&combinations) {
        for &(v, w) in combination {
            row[ids.partition_point(|&id| id < v)] += w;
        }
    }
    Patch {
        valence,
        ids,
        fold: Some(fold),
    }
}

/// On meshes of few quads (a cube, a torus of 3 × 3) a patch meets a vertex twice.
fn all_differ(points: &[u32]) -> bool {
    let mut sorted = points.to_vec();
    sorted.sort_unstable();
    sorted.windows(2).all(|w| w[0] != w[1])
}
