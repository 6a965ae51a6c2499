//! Before the work: is the mesh a complex, which way round are its tetrahedra, and how may each
//! vertex move?
//!
//! Meshes come from anywhere. A *complex* has at most two tetrahedra on a face; where there are three, nothing can say which of
//! them overlap, and the mesh is refused with the face. Files of other programs order corners
//! as they like: all tetrahedra of a connected part get one orientation, that in which its volume is positive, and what is negative
//! afterwards is truly inverted, work for [`untangle`](crate::operations::untangle). Kinds of vertices that the caller does not know
//! follow from regions: inner ones are free, those on an interface slide along it, and those where interfaces meet stay, unless
//! a plane and the isosurface do: see [`curves`](crate::boundary::curves).

use geom_core::compute::parallel::{self, fold_chunks};
use geom_core::mesh::{FACES, Region, VertexKind};
use geom_core::{Point3, TetMesh, Vector3};

use crate::boundary::curves::join_curves;
use crate::boundary::fans::{InterfaceFace, InterfaceFaces, is_disk};
use crate::boundary::field::Isosurface;
use crate::boundary::own::SMOOTH;
use crate::error::Error;
use crate::mesh::editable::{EditableMesh, Freedom};
use crate::mesh::incidence::NONE;

/// Vertices of a bubble of the lattice's size, at most.
const BUBBLE: usize = 100;

/// Sine between the normals of triangles that still count as one plane.
const PLANE: f64 = 1e-9;

/// What the preparation found.
pub(crate) struct Input {
    pub(crate) mesh: EditableMesh,
    /// Tetrahedra whose corners were reordered because all around them said so.
    pub(crate) reoriented: usize,
    /// Vertices around which the interface is not one disk: surfaces touch or meet there.
    pub(crate) junctions: Vec<u32>,
}

/// Checks the mesh, orients its tetrahedra alike, and says how each vertex may move.
///
/// # Errors
///
/// More than two tetrahedra on a face; neighbours that cannot be oriented alike; a field that is no number at a surface
/// vertex.
pub(crate) fn prepare(
    mesh: TetMesh,
    held: &[bool],
    field: Option<&Isosurface<'_>>,
) -> Result<Input, Error> {
    let mut mesh = EditableMesh::new(mesh);
    let Adjacency { beyond, flipped } = adjacency(&mesh)?;
    let reoriented = if flipped || mesh.q.iter().any(|&q| q <= 0.0) {
        let count = orient(&mut mesh, &beyond)?;
        mesh.measure_all();
        count
    } else {
        0
    };
    let junctions = set_freedoms(&mut mesh, &beyond, field)?;
    for (freedom, _) in mesh.freedom.iter_mut().zip(held).filter(|h| *h.1) {
        *freedom = Freedom::Held;
    }
    Ok(Input {
        mesh,
        reoriented,
        junctions,
    })
}

/// Says anew how each vertex may move, after a flow that has bent plane surfaces.
pub(crate) fn free_again(
    mesh: &mut EditableMesh,
    field: Option<&Isosurface<'_>>,
) -> Result<(), Error> {
    let Adjacency { beyond, .. } = adjacency(mesh)?;
    set_freedoms(mesh, &beyond, field).map(|_| ())
}

/// Gives the vertices where surfaces touch or meet.
/// Each vertex by itself, in parallel; then those that the field has lost are asked for again by their neighbours.
fn set_freedoms(
    mesh: &mut EditableMesh,
    beyond: &[[u32; 4]],
    field: Option<&Isosurface<'_>>,
) -> Result<Vec<u32>, Error> {
    let faces = InterfaceFaces::new(mesh, beyond);
    let state = &*mesh;
    let sides = match field {
        Some(field) if !field.own => Sides::of(mesh, field)?,
        _ => Sides::unknown(),
    };
    let judged = parallel::map(state.x.len(), |v| {
        judge(state, v as u32, &faces, field, &sides)
    });
    let judged: Vec<Judged> = judged.into_iter().collect::<Result<_, _>>()?;
    let junctions = (0..judged.len() as u32)
        .filter(|&v| judged[v as usize].junction)
        .collect();
    mesh.freedom = judged.into_iter().map(|j| j.freedom).collect();
    if let Some(field) = field.filter(|field| !field.own) {
        join_field(mesh, &faces, &sides);
        join_curves(mesh, &faces, field, |pair| sides.may_differ(pair))?;
    }
    Ok(junctions)
}

/// On which side of the isosurface each region lies. Two regions on one side, such as a membrane and the exterior, meet on
/// a surface of their own, however near to the isosurface that passes.
struct Sides([Option<bool>; 256]);

impl Sides {
    /// Most tetrahedra of a region that are asked.
    const ASKED: usize = 256;

    fn unknown() -> Self {
        Self([None; 256])
    }

    /// As three quarters of the middles of some tetrahedra of each have it, evenly spread over their numbers.
    ///
    /// # Errors
    /// Those of the field.
    fn of(mesh: &EditableMesh, field: &Isosurface<'_>) -> Result<Self, Error> {
        let living = || (0..mesh.tets.len()).filter(|&t| !mesh.is_empty_slot(t as u32));
        let mut counts = [0usize; 256];
        living().for_each(|t| counts[usize::from(mesh.regions[t])] += 1);
        let mut met = [0usize; 256];
        let asked: Vec<usize> = living()
            .filter(|&t| {
                let region = usize::from(mesh.regions[t]);
                met[region] += 1;
                (met[region] - 1) % counts[region].div_ceil(Self::ASKED) == 0
            })
            .collect();
        let middle = |&t: &usize| {
            let sum: Vector3 = mesh.corners(mesh.tets[t]).iter().map(|x| x.coords).sum();
            Point3::from(0.25 * sum)
        };
        let middles: Vec<Point3> = asked.iter().map(middle).collect();
        let mut above = [[0usize; 2]; 256];
        for (&t, found) in asked.iter().zip(field.tangents(&middles)?) {
            if found.height.is_nan() {
                continue;
            }
            above[usize::from(mesh.regions[t])][usize::from(found.height >= 0.0)] += 1;
        }
        Ok(Self(above.map(|[below, above]| {
            let clear = below.max(above) > 3 * below.min(above);
            clear.then_some(above > below)
        })))
    }

    /// May the isosurface part the two, as far as is known?
    fn may_differ(&self, pair: [Region; 2]) -> bool {
        let [a, b] = pair.map(|r| self.0[usize::from(r)]);
        a.is_none() || b.is_none() || a != b
    }
}

/// At pinches and where the mesh is too coarse for the isosurface, some of its vertices lie far from
/// it. They belong to it where what is around them along the interface does; where nothing else is
/// around them, as in a bubble of the lattice's size, where the interface of the same two regions
/// does everywhere else. An outer sphere around an exterior without its molecule is no bubble.
fn join_field(mesh: &mut EditableMesh, faces: &InterfaceFaces, sides: &Sides) {
    let lost: Vec<bool> = parallel::map(mesh.x.len(), |v| {
        let v = v as u32;
        mesh.freedom[v as usize] == Freedom::Fixed
            && mesh.kinds[v as usize] != VertexKind::Fixed
            && is_disk(faces.of(v))
            && sides.may_differ(faces.of(v)[0].pair)
    });
    let mut joined = Vec::new();
    for cluster in clusters(mesh, faces, &lost) {
        let belongs = if cluster.on + cluster.off == 0 {
            cluster.vertices.len() <= BUBBLE
                && most_are_on_field(mesh, faces, &lost, faces.of(cluster.vertices[0])[0].pair)
        } else {
            cluster.on > cluster.off
        };
        if belongs {
            joined.extend(cluster.vertices);
        }
    }
    for v in joined {
        mesh.freedom[v as usize] = Freedom::Field;
    }
}

/// Lost vertices that hang together along the interface.
struct Cluster {
    vertices: Vec<u32>,
    /// How often a neighbour of one lies on the isosurface.
    on: usize,
    /// How often a neighbour of one does not.
    off: usize,
}

/// Breadth first, from the lowest number on. Around a disk each neighbour is met once, as the first of the other two
/// corners.
fn clusters(mesh: &EditableMesh, faces: &InterfaceFaces, lost: &[bool]) -> Vec<Cluster> {
    let mut seen = vec![false; lost.len()];
    let mut clusters = Vec::new();
    for seed in (0..lost.len() as u32).filter(|&v| lost[v as usize]) {
        if seen[seed as usize] {
            continue;
        }
        seen[seed as usize] = true;
        let mut cluster = Cluster {
            vertices: vec![seed],
            on: 0,
            off: 0,
        };
        let mut next = 0;
        while let Some(&v) = cluster.vertices.get(next) {
            next += 1;
            for u in faces.of(v).iter().map(|f| f.others[0]) {
                if lost[u as usize] {
                    if !seen[u as usize] {
                        seen[u as usize] = true;
                        cluster.vertices.push(u);
                    }
                } else if mesh.freedom[u as usize] == Freedom::Field {
                    cluster.on += 1;
                } else if is_disk(faces.of(u)) {
                    // Where surfaces touch, a vertex says nothing: it stays in any case.
                    cluster.off += 1;
                }
            }
        }
        clusters.push(cluster);
    }
    clusters
}

/// Do most of the vertices between two regions that are not lost lie on the isosurface?
fn most_are_on_field(
    mesh: &EditableMesh,
    faces: &InterfaceFaces,
    lost: &[bool],
    pair: [Region; 2],
) -> bool {
    let others = parallel::flat_map(lost.len(), |v| {
        let fan = faces.of(v as u32);
        let counts = fan.first().is_some_and(|f| f.pair == pair)
            && is_disk(fan)
            && !lost[v]
            && matches!(mesh.kinds[v], VertexKind::Interior | VertexKind::Surface);
        counts.then(|| mesh.freedom[v] == Freedom::Field)
    });
    let on = others.iter().filter(|&&on_field| on_field).count();
    2 * on > others.len()
}

/// Which tetrahedra are neighbours.
/// Only for the preparation: afterwards neighbours are found by [`EditableMesh::beyond`].
struct Adjacency {
    /// The tetrahedron beyond each face, [`NONE`] on the boundary.
    beyond: Vec<[u32; 4]>,
    /// Do two neighbours disagree on the side of their common face?
    flipped: bool,
}

/// Sorting the faces of each vertex by themselves keeps lists short and lets threads work alone; the third tetrahedron
/// on a face is an error.
fn adjacency(mesh: &EditableMesh) -> Result<Adjacency, Error> {
    // Each face at its lowest corner, around which both of its tetrahedra lie.
    let met = fold_chunks(mesh.x.len(), |vertices| {
        let (mut met, mut sides) = (Vec::new(), Vec::new());
        for v in vertices {
            sides.clear();
            sides.extend(sides_at(mesh, v as u32));
            sides.sort_unstable();
            for both in sides.chunk_by(|a, b| a.others == b.others) {
                match *both {
                    [_] => {}
                    [a, b] => met.push([a, b]),
                    _ => {
                        let [b, c] = [(both[0].others >> 32) as u32, both[0].others as u32];
                        return Err(Error::NonManifoldFace {
                            element: both[2].tet as usize,
                            face: [v as u32, b, c],
                        });
                    }
                }
            }
        }
        Ok(met)
    });
    let (mut beyond, mut flipped) = (vec![[NONE; 4]; mesh.tets.len()], false);
    for met in met {
        for [a, b] in met? {
            beyond[a.tet as usize][a.face as usize] = b.tet;
            beyond[b.tet as usize][b.face as usize] = a.tet;
            flipped |= a.ascending == b.ascending;
        }
    }
    Ok(Adjacency { beyond, flipped })
}

/// A face of a tetrahedron, seen from its lowest corner.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Side {
    /// The other corners, the lower one in the high bits.
    others: u64,
    tet: u32,
    /// Opposite which corner of the tetrahedron.
    face: u8,
    /// Are the others in ascending order as seen from outside?
    ascending: bool,
}

/// The faces of which `v` is the lowest corner.
fn sides_at(mesh: &EditableMesh, v: u32) -> impl Iterator<Item = Side> {
    mesh.incidence.of(v).iter().flat_map(move |&tet| {
        let corners = mesh.tets[tet as usize];
        (0..4).filter_map(move |face| {
            let [a, b, c] = FACES[usize::from(face)].map(|i| corners[i]);
            let [next, last] = match v {
                _ if v == a => [b, c],
                _ if v == b => [c, a],
                _ if v == c => [a, b],
                _ => return None,
            };
            (v < next && v < last).then(|| Side {
                others: u64::from(next.min(last)) << 32 | u64::from(next.max(last)),
                tet,
                face,
                ascending: next < last,
            })
        })
    })
}

/// Does `other` have this face in the same direction? Neighbours on opposite sides have it in
/// opposite directions.
fn same_side(face: [u32; 3], other: [u32; 4]) -> bool {
    FACES.iter().any(|corners| {
        let [a, b, c] = corners.map(|i| other[i]);
        [[a, b, c], [b, c, a], [c, a, b]].contains(&face)
    })
}

/// Gives all tetrahedra of a connected part the same orientation, the one in which its volume is
/// positive. What is negative after that is truly inverted. Files of other programs order corners
/// as they like.
/// Breadth first over each part, `O(n)`. A part whose volume is exactly zero keeps the orientation of its first
/// tetrahedron.
fn orient(mesh: &mut EditableMesh, beyond: &[[u32; 4]]) -> Result<usize, Error> {
    let n = mesh.tets.len();
    let mut flip: Vec<Option<bool>> = vec![None; n];
    let mut queue = Vec::new();
    let mut count = 0;
    for seed in 0..n {
        if flip[seed].is_some() {
            continue;
        }
        // Each neighbour as the one through which it was reached says.
        flip[seed] = Some(false);
        queue.clear();
        queue.push(seed as u32);
        let mut next = 0;
        while next < queue.len() {
            let t = queue[next] as usize;
            next += 1;
            for (k, corners) in FACES.iter().enumerate() {
                let o = beyond[t][k];
                if o == NONE {
                    continue;
                }
                let face = corners.map(|i| mesh.tets[t][i]);
                let disagree = same_side(face, mesh.tets[o as usize]);
                let wanted = flip[t].expect("queued tetrahedra are decided") ^ disagree;
                match flip[o as usize] {
                    None => {
                        flip[o as usize] = Some(wanted);
                        queue.push(o);
                    }
                    Some(has) if has != wanted => {
                        let (element, neighbour) = (t.min(o as usize), t.max(o as usize));
                        return Err(Error::NotOrientable { element, neighbour });
                    }
                    Some(_) => {}
                }
            }
        }
        // All of the part so, or all the other way round: whichever has a positive volume.
        let volume: f64 = queue
            .iter()
            .map(|&t| {
                let v6 = geom_core::mesh::six_volume(mesh.corners(mesh.tets[t as usize]));
                if flip[t as usize] == Some(true) {
                    -v6
                } else {
                    v6
                }
            })
            .sum();
        for &t in &queue {
            let turn = (flip[t as usize] == Some(true)) ^ (volume < 0.0);
            if turn {
                mesh.tets[t as usize].swap(0, 1);
                count += 1;
            }
        }
    }
    Ok(count)
}

/// What is found of a vertex.
struct Judged {
    freedom: Freedom,
    /// Do surfaces touch or meet there?
    junction: bool,
}

/// How a vertex may move, and whether surfaces touch or meet there.
fn judge(
    mesh: &EditableMesh,
    v: u32,
    faces: &InterfaceFaces,
    field: Option<&Isosurface<'_>>,
    sides: &Sides,
) -> Result<Judged, Error> {
    let fan = faces.of(v);
    let kind = mesh.kinds[v as usize];
    if fan.is_empty() {
        // A vertex that is said to lie on a surface but does not: leave it.
        let freedom = if kind == VertexKind::Interior {
            Freedom::Free
        } else {
            Freedom::Fixed
        };
        return Ok(Judged {
            freedom,
            junction: false,
        });
    }
    if !is_disk(fan) {
        return Ok(Judged {
            freedom: Freedom::Fixed,
            junction: true,
        });
    }
    let x = mesh.x[v as usize];
    let axis = |axis: u8| Vector3::ith(usize::from(axis).min(2), 1.0);
    let freedom = match kind {
        VertexKind::Fixed => Freedom::Fixed,
        VertexKind::BoxFace { axis: a } => Freedom::Plane(axis(a)),
        VertexKind::BoxEdge { axis: a } => Freedom::Line(axis(a)),
        VertexKind::Interior | VertexKind::Surface => {
            let edge = fan
                .iter()
                .map(|f| (mesh.x[f.others[0] as usize] - x).norm())
                .sum::<f64>()
                / fan.len() as f64;
            match field {
                // Plane parts and sharp edges of the input's own surface stay exact.
                Some(field) if field.own => match flat(mesh, x, fan) {
                    Freedom::Fixed if is_smooth(mesh, x, fan) => Freedom::Field,
                    exact => exact,
                },
                Some(field) if sides.may_differ(fan[0].pair) && field.holds(v, &x, edge)? => {
                    Freedom::Field
                }
                _ => flat(mesh, x, fan),
            }
        }
    };
    Ok(Judged {
        freedom,
        junction: false,
    })
}

/// Do all faces turn by less than 40° from their mean?
fn is_smooth(mesh: &EditableMesh, x: Point3, fan: &[InterfaceFace]) -> bool {
    let normals: Option<Vec<Vector3>> = normals(mesh, x, fan).collect();
    normals.is_some_and(|normals| {
        let mean: Vector3 = normals.iter().sum();
        let least = SMOOTH * mean.norm();
        normals.iter().all(|n| n.dot(&mean) >= least)
    })
}

/// The unit normals of the faces around a vertex; `None` for one without area.
fn normals(
    mesh: &EditableMesh,
    x: Point3,
    fan: &[InterfaceFace],
) -> impl Iterator<Item = Option<Vector3>> {
    fan.iter().map(move |f| {
        let [a, b] = f.others.map(|u| mesh.x[u as usize] - x);
        a.cross(&b).try_normalize(0.0)
    })
}

/// The directions that keep the given surface as it is: along a plane, or along the crease of two.
/// Exact to a sine of 1e-9, since nothing would bring a vertex back that has left its plane.
fn flat(mesh: &EditableMesh, x: Point3, fan: &[InterfaceFace]) -> Freedom {
    let Some(normals) = normals(mesh, x, fan).collect::<Option<Vec<Vector3>>>() else {
        return Freedom::Fixed;
    };
    let first = normals[0];
    let (most, crease) = normals
        .iter()
        .map(|n| first.cross(n))
        .map(|c| (c.norm(), c))
        .fold(
            (0.0, Vector3::zeros()),
            |m, c| if c.0 > m.0 { c } else { m },
        );
    if most <= PLANE {
        let level = normals.iter().all(|n| n.dot(&first) > 0.0);
        return if level {
            Freedom::Plane(first)
        } else {
            Freedom::Fixed
        };
    }
    let along = crease / most;
    if normals.iter().all(|n| n.dot(&along).abs() <= PLANE) {
        Freedom::Line(along)
    } else {
        Freedom::Fixed
    }
}

/// The vertices around which the triangles of an interface close or end at the border as those of a disk do, for tests.
#[cfg(feature = "testing")]
pub(crate) fn disks(mesh: &EditableMesh) -> Result<Vec<u32>, Error> {
    let Adjacency { beyond, .. } = adjacency(mesh)?;
    let faces = InterfaceFaces::new(mesh, &beyond);
    let vertices = 0..mesh.x.len() as u32;
    Ok(vertices.filter(|&v| is_disk(faces.of(v))).collect())
}
