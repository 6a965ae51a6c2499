//! Patches: which control points shape a quad's part of the limit surface.

use geom_core::mesh::Halfedges;
use geom_core::{FaceId, HalfedgeId, Vector3, VertexId, id::Id};

use super::ghosts::{Combination, Extended};
use super::tables::{Corner, MOST_VALENCE};
use crate::Error;

/// The control points of a quad, in the order of its table.
#[derive(Clone, Debug)]
pub(crate) struct Patch {
    /// Its extraordinary corner.
    pub(crate) corner: Corner,
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

impl Patch {
    /// What vertices have, at the control points of the table.
    pub(crate) fn values_of(&self, values: &[f64]) -> Vec<f64> {
        let own = self.ids.iter().map(|&v| values[v as usize]);
        let Some(fold) = &self.fold else {
            return own.collect();
        };
        let own: Vec<f64> = own.collect();
        let rows = fold.chunks(own.len());
        rows.map(|row| row.iter().zip(&own).map(|(w, x)| w * x).sum())
            .collect()
    }

    /// Adds what the control points of the table have to the vertices.
    pub(crate) fn give(&self, of_points: &[Vector3], vertices: &mut [Vector3]) {
        let Some(fold) = &self.fold else {
            for (&v, x) in self.ids.iter().zip(of_points) {
                vertices[v as usize] += x;
            }
            return;
        };
        for (row, x) in fold.chunks(self.ids.len()).zip(of_points) {
            for (&v, w) in self.ids.iter().zip(row) {
                vertices[v as usize] += x * *w;
            }
        }
    }
}

/// The patch of every quad of the mesh.
pub(crate) fn patches(extended: &Extended, count: usize) -> Result<Vec<Patch>, Error> {
    let vertices = extended.real + extended.ghosts.len();
    let edges = Halfedges::<4>::new(vertices, &extended.quads)?;
    let valences: Vec<u32> = (0..vertices)
        .map(|v| edges.around(VertexId(v as u32)).count() as u32)
        .collect();
    // A vertex on the boundary of more than two quads has ghosts on both sides, but stays on the boundary.
    let on_rim = |v: usize| edges.on_boundary(VertexId(v as u32));
    for (vertex, &valence) in valences[..extended.real].iter().enumerate() {
        let rim = on_rim(vertex);
        // Without its two ghosts.
        let quads = valence as usize - if rim { 2 } else { 0 };
        let must = if rim {
            "a vertex on the boundary must have 1…32"
        } else {
            "a vertex inside the surface must have 3…32"
        };
        if quads > MOST_VALENCE || (!rim && quads != 0 && quads < 3) {
            return Err(Error::Valence {
                vertex,
                quads,
                must,
            });
        }
    }
    (0..count)
        .map(|f| {
            let vertex = |k: usize| edges.from(edges.of_face(FaceId(f as u32), k)).index();
            let odd = (0..4).find(|&k| valences[vertex(k)] != 4);
            let start = edges.of_face(FaceId(f as u32), odd.unwrap_or(0));
            let (corner, points) = match odd.map(vertex) {
                None => (Corner::Regular, grid(&edges, start)),
                Some(v) if on_rim(v) => {
                    let (place, fan) = fan_of_rim(&edges, start);
                    let quads = valences[v] as usize - 2;
                    (
                        Corner::Rim { quads, place },
                        around_corner(&edges, start, fan),
                    )
                }
                Some(v) => {
                    let fan = fan_inside(&edges, start);
                    let points = around_corner(&edges, start, fan);
                    (Corner::Inside(valences[v] as usize), points)
                }
            };
            assert_eq!(points.len(), corner.points(), "the walk closes");
            Ok(folded(extended, corner, &points))
        })
        .collect()
}

/// Vertices all of whose corners are extraordinary but one cannot be walked: is a quad of the mesh such?
pub(crate) fn has_two_odd_corners(edges: &Halfedges<4>, quads: usize) -> bool {
    let odd = |v: VertexId| {
        let count = edges.around(v).count();
        if edges.on_boundary(v) {
            count > 2
        } else {
            count != 4
        }
    };
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

/// The neighbours along edges and then across quads of the corner inside the surface from which `h` starts, from it on.
fn fan_inside(edges: &Halfedges<4>, h: HalfedgeId) -> Vec<u32> {
    let ring: Vec<HalfedgeId> = std::iter::successors(Some(h), |&g| {
        let turned = across(edges, edges.previous(g));
        (turned != h).then_some(turned)
    })
    .collect();
    let mut fan: Vec<u32> = ring.iter().map(|&g| edges.to(g).0).collect();
    fan.extend(ring.iter().map(|&g| edges.to(edges.next(g)).0));
    fan
}

/// The same of a corner on the boundary, from the boundary edge that leaves it on, and the place of the quad of `h`.
fn fan_of_rim(edges: &Halfedges<4>, h: HalfedgeId) -> (usize, Vec<u32>) {
    // The first and the last quad are ghosts.
    let ring: Vec<HalfedgeId> = edges.around(edges.from(h)).skip(1).collect();
    let place = ring.iter().position(|&g| g == h);
    let mut fan: Vec<u32> = ring.iter().map(|&g| edges.to(g).0).collect();
    let real = &ring[..ring.len() - 1];
    fan.extend(real.iter().map(|&g| edges.to(edges.next(g)).0));
    (place.expect("a quad of the mesh is no ghost"), fan)
}

/// The points of a quad whose first corner, from which `h` starts, is extraordinary and has this fan.
fn around_corner(edges: &Halfedges<4>, h: HalfedgeId, fan: Vec<u32>) -> Vec<u32> {
    let mut points = vec![edges.from(h).0];
    points.extend(fan);
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
fn folded(extended: &Extended, corner: Corner, points: &[u32]) -> Patch {
    if points.iter().all(|&p| (p as usize) < extended.real) && all_differ(points) {
        return Patch {
            corner,
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
        corner,
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
