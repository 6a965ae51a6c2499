//! The connected parts of the input, made ready one by one.

use geom_core::compute::sets::DisjointSets;
use geom_core::id::Id;
use geom_core::mesh::Halfedges;
use geom_core::surface::remesh::{self, remesh};
use geom_core::{Cancelled, Cpu, HalfedgeId, Point3, Run, TriMesh, VertexId};

use crate::Error;
use crate::backend::On;

/// A connected surface, ready for a field: no triangle has two sides that must be lines.
#[derive(Clone, Debug)]
pub(super) struct Part {
    pub(super) mesh: TriMesh,
    /// Half-edges along boundaries and sharp edges; both of a sharp one.
    pub(super) lines: Vec<usize>,
}

/// The connected parts, in the order of their lowest triangles, and the triangles of each.
pub(super) fn split(mesh: &TriMesh) -> Vec<(TriMesh, Vec<u32>)> {
    let mut sets = DisjointSets::new(mesh.positions().len());
    for &[a, b, c] in mesh.triangles() {
        sets.join(a, b);
        sets.join(b, c);
    }
    let root = sets.into_roots();
    let mut number = vec![usize::MAX; root.len()];
    let mut parts: Vec<Vec<u32>> = Vec::new();
    for (t, corners) in (0u32..).zip(mesh.triangles()) {
        let slot = &mut number[root[corners[0] as usize] as usize];
        if *slot == usize::MAX {
            *slot = parts.len();
            parts.push(Vec::new());
        }
        parts[*slot].push(t);
    }
    parts
        .into_iter()
        .map(|faces| (restricted(mesh, &faces), faces))
        .collect()
}

/// Some triangles with the vertices that they use, both in their order.
fn restricted(mesh: &TriMesh, faces: &[u32]) -> TriMesh {
    let corners = faces.iter().map(|&f| mesh.triangles()[f as usize]);
    let mut vertices: Vec<u32> = corners.clone().flatten().collect();
    vertices.sort_unstable();
    vertices.dedup();
    let place = |v: u32| vertices.partition_point(|&u| u < v) as u32;
    let positions = vertices
        .iter()
        .map(|&v| mesh.positions()[v as usize])
        .collect();
    let triangles = corners.map(|t| t.map(place)).collect();
    TriMesh::new(positions, triangles).expect("a part of a valid mesh")
}

impl Part {
    /// Finds the sharp edges (normals differing by more than `crease` degrees), cuts edges from line to line in two, and
    /// triangles with two lines at their centres.
    pub(super) fn of(mesh: TriMesh, crease: Option<f64>) -> Result<Self, Error> {
        let edges = Halfedges::of(&mesh)?;
        let is_line: Vec<bool> = edges
            .iter()
            .map(|h| match (edges.twin(h), crease) {
                (None, _) => true,
                (Some(t), Some(degrees)) => {
                    let normal = |h: HalfedgeId| mesh.doubled_area_normal(edges.face(h).0 as usize);
                    normal(h).angle(&normal(t)).to_degrees() > degrees
                }
                (Some(_), None) => false,
            })
            .collect();
        let (mesh, is_line) = cut_between(mesh, is_line)?;
        let (mesh, is_line) = cut_corners(mesh, is_line)?;
        let lines = (0..is_line.len()).filter(|&h| is_line[h]).collect();
        Ok(Self { mesh, lines })
    }

    /// Every triangle cut into four at the midpoints of its sides: where the triangles are as large as the quads, a map has
    /// too little freedom.
    pub(super) fn refined(&self) -> Result<Self, Error> {
        let all = vec![true; self.mesh.triangles().len()];
        self.cut(&Cuts::of(&self.mesh, &all)?)
    }

    /// The part with its triangles cut.
    pub(super) fn cut(&self, cuts: &Cuts) -> Result<Self, Error> {
        let mut is_line = vec![false; 3 * self.mesh.triangles().len()];
        for &h in &self.lines {
            is_line[h] = true;
        }
        let inherits = |h: &usize| cuts.sides[*h].is_some_and(|side| is_line[side]);
        Ok(Self {
            mesh: cuts.of_mesh(&self.mesh)?,
            lines: (0..cuts.sides.len()).filter(inherits).collect(),
        })
    }

    /// The part with nearly equilateral triangles of this edge length (Botsch and Kobbelt, 2004); `None` where that fails or
    /// changes its topology.
    pub(super) fn remeshed(
        &self,
        edge: f64,
        crease: Option<f64>,
        run: On<'_>,
    ) -> Result<Option<Self>, Cancelled> {
        self.remeshed_with(edge, crease, remesh::Options::default(), run)
    }

    /// The same with other options; `edge` and `crease` replace theirs.
    pub(super) fn remeshed_with(
        &self,
        edge: f64,
        crease: Option<f64>,
        wanted: remesh::Options,
        run: On<'_>,
    ) -> Result<Option<Self>, Cancelled> {
        let wanted = remesh::Options {
            sizing: remesh::Sizing::Uniform {
                edge_length: Some(edge),
            },
            features: match crease {
                Some(degrees) => remesh::Features::Angle(degrees),
                None => remesh::Features::None,
            },
            ..wanted
        };
        let watched = Run::on(&Cpu).watched_by(run.monitor);
        let made = match remesh(self.mesh.clone(), None, &wanted, watched) {
            Ok(made) => made.mesh,
            Err(remesh::Error::Cancelled(cancelled)) => return Err(cancelled),
            Err(_) => return Ok(None),
        };
        let loops = |mesh: &TriMesh| Halfedges::of(mesh).map(|e| e.boundary_loops().len());
        let same = made.euler_characteristic() == self.mesh.euler_characteristic()
            && loops(&made) == loops(&self.mesh);
        if !same {
            return Ok(None);
        }
        Ok(Self::of(made, crease).ok())
    }

    /// Which vertices are ends, branches or corners of the lines: where the line turns by more than 45°.
    pub(super) fn corners(&self) -> Result<Vec<Option<bool>>, Error> {
        let edges = Halfedges::of(&self.mesh)?;
        let mut ways: Vec<Vec<u32>> = vec![Vec::new(); self.mesh.positions().len()];
        for &h in &self.lines {
            let h = HalfedgeId(h as u32);
            let (a, b) = (edges.from(h).0, edges.to(h).0);
            ways[a as usize].push(b);
            ways[b as usize].push(a);
        }
        let at = |v: u32| self.mesh.positions()[v as usize];
        Ok((0u32..)
            .zip(&mut ways)
            .map(|(v, ways)| {
                ways.sort_unstable();
                ways.dedup();
                match ways[..] {
                    [] => None,
                    [a, b] => {
                        let turn = (at(v) - at(a)).angle(&(at(b) - at(v)));
                        Some(turn > std::f64::consts::FRAC_PI_4)
                    }
                    _ => Some(true),
                }
            })
            .collect())
    }

    /// The lines as segments, each once.
    pub(super) fn segments(&self) -> Result<Vec<[Point3; 2]>, Error> {
        let edges = Halfedges::of(&self.mesh)?;
        let at = |v: VertexId| self.mesh.positions()[v.index()];
        Ok(self
            .lines
            .iter()
            .map(|&h| HalfedgeId(h as u32))
            .filter(|&h| edges.twin(h).is_none_or(|t| h < t))
            .map(|h| [at(edges.from(h)), at(edges.to(h))])
            .collect())
    }
}

/// Triangles cut into four, and their neighbours into two or three where they share sides with these, for any mesh with the
/// same connectivity.
pub(crate) struct Cuts {
    /// The ends of each edge that gets a vertex in its middle; the new vertices follow the old ones in this order.
    middles: Vec<[u32; 2]>,
    triangles: Vec<[u32; 3]>,
    /// Per new triangle, the old one that it is a piece of.
    pub(crate) parents: Vec<u32>,
    /// Per new half-edge, the old one that it is a piece of; `None` inside of a triangle.
    pub(crate) sides: Vec<Option<usize>>,
}

impl Cuts {
    /// What cutting these triangles into four makes of a mesh.
    pub(crate) fn of(mesh: &TriMesh, is_cut: &[bool]) -> Result<Self, Error> {
        let edges = Halfedges::of(mesh)?;
        let mut middle = vec![None; edges.len()];
        let mut middles = Vec::new();
        for h in edges.edges() {
            let twin = edges.twin(h);
            if !is_cut[h.index() / 3] && !twin.is_some_and(|t| is_cut[t.index() / 3]) {
                continue;
            }
            let number = Some((mesh.positions().len() + middles.len()) as u32);
            middle[h.index()] = number;
            if let Some(twin) = twin {
                middle[twin.index()] = number;
            }
            middles.push([edges.from(h).0, edges.to(h).0]);
        }
        let mut cuts = Self {
            middles,
            triangles: Vec::new(),
            parents: Vec::new(),
            sides: Vec::new(),
        };
        for (t, (corners, middle)) in mesh
            .triangles()
            .iter()
            .zip(middle.chunks_exact(3))
            .enumerate()
        {
            cuts.add(t, corners, [middle[0], middle[1], middle[2]]);
        }
        Ok(cuts)
    }

    /// The pieces of a triangle with these vertices in the middle of its sides.
    fn add(&mut self, t: usize, &corners: &[u32; 3], middle: [Option<u32>; 3]) {
        // So that what is cut comes first.
        let first = match middle {
            [Some(_), Some(_), Some(_)] | [_, None, None] | [Some(_), Some(_), None] => 0,
            [None, Some(_), _] => 1,
            [_, None, Some(_)] => 2,
        };
        let [ab, bc, ca] = [0, 1, 2].map(|k| Some(3 * t + (first + k) % 3));
        let [a, b, c] = [0, 1, 2].map(|k| corners[(first + k) % 3]);
        let mut piece = |corners, sides: [Option<usize>; 3]| {
            self.triangles.push(corners);
            self.parents.push(t as u32);
            self.sides.extend(sides);
        };
        match [0, 1, 2].map(|k| middle[(first + k) % 3]) {
            [Some(m), Some(n), Some(o)] => {
                piece([a, m, o], [ab, None, ca]);
                piece([b, n, m], [bc, None, ab]);
                piece([c, o, n], [ca, None, bc]);
                piece([m, n, o], [None; 3]);
            }
            [Some(m), Some(n), None] => {
                piece([m, b, n], [ab, bc, None]);
                piece([a, m, n], [ab, None, None]);
                piece([a, n, c], [None, bc, ca]);
            }
            [Some(m), None, None] => {
                piece([a, m, c], [ab, None, ca]);
                piece([m, b, c], [ab, bc, None]);
            }
            _ => piece([a, b, c], [ab, bc, ca]),
        }
    }

    /// A mesh of the old triangles with these cut.
    pub(crate) fn of_mesh(&self, mesh: &TriMesh) -> Result<TriMesh, Error> {
        let mut positions = mesh.positions().to_vec();
        positions.extend(self.middles.iter().map(|ends| {
            let [a, b] = ends.map(|v| mesh.positions()[v as usize]);
            geom_core::nalgebra::center(&a, &b)
        }));
        Ok(TriMesh::new(positions, self.triangles.clone())?)
    }

    /// Per new triangle the angle of its first side in its parent, from the first side of that: by how much angles are
    /// smaller in the new one.
    pub(crate) fn turns(&self, mesh: &TriMesh, cut: &TriMesh) -> Vec<f64> {
        let of = |(t, &parent): (usize, &u32)| {
            let normal = mesh.doubled_area_normal(parent as usize).normalize();
            let [old, new] = [mesh.corners(parent as usize), cut.corners(t)].map(|p| p[1] - p[0]);
            normal.dot(&old.cross(&new)).atan2(old.dot(&new))
        };
        self.parents.iter().enumerate().map(of).collect()
    }
}

/// An edge that is no line, but has both ends on one, would have to be part of it where the map has no corner between them:
/// such edges get a vertex in their middle.
fn cut_between(mesh: TriMesh, is_line: Vec<bool>) -> Result<(TriMesh, Vec<bool>), Error> {
    let edges = Halfedges::of(&mesh)?;
    let mut on_line = vec![false; mesh.positions().len()];
    for h in edges.iter().filter(|h| is_line[h.index()]) {
        (on_line[edges.from(h).index()], on_line[edges.to(h).index()]) = (true, true);
    }
    let between = |h: HalfedgeId| {
        !is_line[h.index()] && on_line[edges.from(h).index()] && on_line[edges.to(h).index()]
    };
    let mut middle = vec![None; edges.len()];
    let mut positions = mesh.positions().to_vec();
    for h in edges.edges().filter(|&h| between(h)) {
        let [a, b] = [edges.from(h), edges.to(h)].map(|v| positions[v.index()]);
        let number = Some(positions.len() as u32);
        middle[h.index()] = number;
        if let Some(twin) = edges.twin(h) {
            middle[twin.index()] = number;
        }
        positions.push(geom_core::nalgebra::center(&a, &b));
    }
    let (mut triangles, mut lines) = (Vec::new(), Vec::new());
    let cut = middle.chunks_exact(3).zip(is_line.chunks_exact(3));
    for (corners, (middle, line)) in mesh.triangles().iter().zip(cut) {
        // All corners of the triangle's rim, and which of the sides from them are lines.
        let mut rim: Vec<(u32, bool)> = Vec::with_capacity(6);
        for k in 0..3 {
            rim.push((corners[k], line[k]));
            rim.extend(middle[k].map(|m| (m, false)));
        }
        // Ears at old corners between two new ones, then a fan from a new corner, so that no side joins two old ones.
        let is_new = |v: u32| !corners.contains(&v);
        while let Some(k) = (0..rim.len()).find(|&k| {
            let n = rim.len();
            n > 3
                && !is_new(rim[k].0)
                && is_new(rim[(k + n - 1) % n].0)
                && is_new(rim[(k + 1) % n].0)
        }) {
            let n = rim.len();
            let before = (k + n - 1) % n;
            triangles.push([rim[before].0, rim[k].0, rim[(k + 1) % n].0]);
            lines.extend([rim[before].1, rim[k].1, false]);
            rim[before].1 = false;
            rim.remove(k);
        }
        let first = rim.iter().position(|r| is_new(r.0)).unwrap_or(0);
        rim.rotate_left(first);
        let last = rim.len() - 1;
        for k in 1..last {
            triangles.push([rim[0].0, rim[k].0, rim[k + 1].0]);
            let side = |k: usize, there: bool| there && rim[k].1;
            lines.extend([side(0, k == 1), rim[k].1, side(last, k + 1 == last)]);
        }
    }
    Ok((TriMesh::new(positions, triangles)?, lines))
}

/// A triangle with two lines would have to be flat in the map if they are one line there.
fn cut_corners(mesh: TriMesh, is_line: Vec<bool>) -> Result<(TriMesh, Vec<bool>), Error> {
    let (mut positions, triangles) = mesh.into_parts();
    let (mut out, mut lines) = (Vec::new(), Vec::new());
    for (&[a, b, c], is_line) in triangles.iter().zip(is_line.chunks_exact(3)) {
        if is_line.iter().filter(|&&l| l).count() < 2 {
            out.push([a, b, c]);
            lines.extend_from_slice(is_line);
            continue;
        }
        let sum = [a, b, c].iter().fold(geom_core::Vector3::zeros(), |s, &v| {
            s + positions[v as usize].coords
        });
        let centre = positions.len() as u32;
        positions.push(Point3::from(sum / 3.0));
        for (k, [from, to]) in [[a, b], [b, c], [c, a]].into_iter().enumerate() {
            out.push([from, to, centre]);
            lines.extend([is_line[k], false, false]);
        }
    }
    Ok((TriMesh::new(positions, out)?, lines))
}
