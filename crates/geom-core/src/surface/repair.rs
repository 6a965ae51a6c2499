//! Making any triangle mesh an oriented manifold, with a report of what that took.
//!
//! Files from elsewhere hold soups: corners that are equal but not the same, triangles without area, neighbours that run in
//! opposite directions, sheets that touch along an edge. Operators, half-edges and meshers want every edge to have one or two
//! triangles that agree on which side is out. What can be had by renumbering is done so, without moving anything; vertices
//! move only where they are merged. Things are done in the order of [`Report`]'s fields, since each needs those before:
//! neighbours are known only after merging, orientation only where edges have two triangles, holes only after orientation.
//!
//! What comes out satisfies [`Halfedges`] by construction. It is the surface of the input, not a better one:
//! intersections, bad angles and noise stay. [`remesh`](super::remesh) improves triangles, and a mesher of voxels or of
//! a level set makes new ones.

use std::collections::VecDeque;

use crate::compute::parallel;

use crate::compute::sets::DisjointSets;
use crate::mesh::Halfedges;
use crate::options::{OutOfRange, require};
use crate::search::bvh::TriangleTree;
use crate::search::nearest::PointTree;
use crate::{Point3, TriMesh, Vector3};

const NONE: u32 = u32::MAX;

/// What to repair.
///
/// The defaults close the cracks of files that list each triangle's corners anew, and leave everything that could be
/// meant as it is.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Options {
    /// Vertices at most this part of the bounding box's diagonal apart become one; 0 merges only
    /// equal ones, a negative number none. Keep it below the shortest edge that means something: triangles smaller than
    /// it collapse.
    pub merge: f64,
    /// Triangles whose height is at most this part of their longest edge have no area.
    pub flat: f64,
    /// Closed components are turned so that their normals point out of the solid: outward, inward
    /// for a component that lies in an odd number of others (a cavity). Components may touch but not
    /// intersect.
    pub outward: bool,
    /// Holes with at most this many edges are filled; 0 fills none. The work grows with the third
    /// power.
    pub fill: usize,
    /// Components of fewer triangles are dropped; 0 drops none.
    pub least_component: usize,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            merge: 1e-7,
            flat: 1e-9,
            outward: true,
            fill: 0,
            least_component: 0,
        }
    }
}

/// Why a mesh cannot be repaired. All else has a remedy that loses triangles at most, and is reported, not refused.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum RepairError {
    /// The surface has one side only, like a Möbius strip.
    #[error(
        "the surface has one side only: coming back to triangle {triangle} turns it around; \
         cut the surface there"
    )]
    OneSided {
        /// Where both sides meet.
        triangle: u32,
    },
    /// An option is out of its range.
    #[error(transparent)]
    Option(#[from] OutOfRange),
}

/// What was done, in this order.
///
/// All 0 but `open_loops` for a good mesh, which comes out as it went in.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Report {
    /// Vertices that became one with an earlier one.
    pub merged_vertices: usize,
    /// Triangles dropped because merging left them fewer than three corners.
    pub collapsed_triangles: usize,
    /// Triangles dropped because an earlier one has the same corners.
    pub duplicate_triangles: usize,
    /// Triangles without area that were given some by flipping their longest edge.
    pub flipped_triangles: usize,
    /// Triangles without area that were dropped.
    pub flat_triangles: usize,
    /// Edges of more than two triangles.
    pub nonmanifold_edges: usize,
    /// Triangles turned around so that neighbours agree.
    pub reversed_triangles: usize,
    /// Triangles dropped because they fit to no sheet of a non-manifold edge.
    pub trimmed_triangles: usize,
    /// Vertices added to part sheets and fans that met in one.
    pub split_vertices: usize,
    /// Holes filled.
    pub filled_holes: usize,
    /// Triangles added in them.
    pub fill_triangles: usize,
    /// Boundary loops that are left.
    pub open_loops: usize,
    /// Components dropped because they were small.
    pub dropped_components: usize,
    /// Closed components turned inside out.
    pub turned_components: usize,
    /// Vertices dropped because no triangle uses them (any more), merged ones not counted.
    pub unused_vertices: usize,
}

/// A repaired mesh.
#[derive(Clone, Debug, PartialEq)]
pub struct Repaired {
    /// An oriented manifold, perhaps with boundary, without unused vertices.
    pub mesh: TriMesh,
    /// What it took.
    pub report: Report,
}

/// An oriented manifold without flat triangles: the input as it is, bit by bit, or what [`repair`] makes of it, and what
/// that took. Nothing is filled and no component is turned; unused vertices are reason enough for repair, which may give
/// triangles other numbers.
///
/// ```
/// use geom_core::mesh::shapes;
/// use geom_core::surface::repair;
/// let good = shapes::icosphere(1.0, 1);
/// let (same, took) = repair::manifold(&good)?;
/// assert!(same == good && took.is_none());
/// # Ok::<(), repair::RepairError>(())
/// ```
///
/// # Errors
/// [`RepairError::OneSided`].
pub fn manifold(mesh: &TriMesh) -> Result<(TriMesh, Option<Report>), RepairError> {
    let is_flat = |t: usize| {
        let [a, b, c] = mesh.corners(t);
        let sides = [b - a, c - b, a - c].map(|s| s.norm_squared());
        let longest = sides.into_iter().fold(0.0, f64::max);
        mesh.doubled_area_normal(t).norm() <= 1e-9 * longest
    };
    let mut used = vec![false; mesh.positions().len()];
    for &v in mesh.triangles().as_flattened() {
        used[v as usize] = true;
    }
    let is_whole = used.iter().all(|&u| u) && !(0..mesh.triangles().len()).any(is_flat);
    if is_whole && Halfedges::of(mesh).is_ok() {
        return Ok((mesh.clone(), None));
    }
    let options = Options {
        outward: false,
        fill: 0,
        ..Options::default()
    };
    let repaired = repair(mesh.clone(), &options)?;
    Ok((repaired.mesh, Some(repaired.report)))
}

/// An oriented manifold as near to `mesh` as can be: merges equal vertices, drops or flips triangles
/// without area, parts sheets that meet in an edge and fans that meet in a vertex, orients
/// neighbours alike, fills holes, and drops small components. The order of vertices and triangles
/// stays; added ones come last.
///
/// ```
/// use geom_core::{Point3, TriMesh};
/// use geom_core::surface::repair;
/// // Two triangles of a strip, as an STL file has them: no vertex is shared, one is upside down.
/// let p = [[0., 0.], [1., 0.], [0., 1.], [1., 0.], [0., 1.], [1., 1.]];
/// let p = p.map(|[x, y]| Point3::new(x, y, 0.0)).to_vec();
/// let mesh = TriMesh::new(p, vec![[0, 1, 2], [3, 4, 5]]).unwrap();
/// let repaired = repair::repair(mesh.clone(), &repair::Options::default())?;
/// assert_eq!(repaired.mesh.triangles(), [[0, 1, 2], [1, 3, 2]]);
/// assert_eq!(repaired.report.merged_vertices, 2);
/// # Ok::<(), repair::RepairError>(())
/// ```
///
/// Nothing is certain of which side is out where a component is open: its larger part, by area, keeps its orientation.
/// The time is that of sorting edges and of a tree of points, plus the cube of the longest hole that is filled.
///
/// # Errors
/// [`RepairError::Option`] for `merge` or `flat` that are not finite or not below 1; [`RepairError::OneSided`].
pub fn repair(mesh: TriMesh, options: &Options) -> Result<Repaired, RepairError> {
    for (option, value) in [("merge", options.merge), ("flat", options.flat)] {
        let holds = value.is_finite() && value < 1.0;
        require(holds, option, value, "be a number below 1")?;
    }
    let tolerance = options.merge * mesh.bounds().diagonal().max(0.0);
    let (positions, triangles) = mesh.into_parts();
    let mut soup = Soup {
        positions,
        triangles,
        report: Report::default(),
    };
    if !soup.triangles.is_empty() {
        if options.merge >= 0.0 {
            soup.merge(tolerance);
        }
        soup.drop_duplicates();
        soup.flatten(options.flat);
        soup.orient()?;
        soup.part_sheets();
        soup.fill(options.fill);
        soup.components(options);
    }
    soup.compact();
    let mesh = TriMesh::new(soup.positions, soup.triangles).expect("parts of a valid mesh");
    Ok(Repaired {
        mesh,
        report: soup.report,
    })
}

/// The mesh while it is worked on, with what was done so far. Triangles have three different corners from `merge` on;
/// vertices may be unused until `compact`.
struct Soup {
    positions: Vec<Point3>,
    triangles: Vec<[u32; 3]>,
    report: Report,
}

/// A use of an edge: the sorted ends, the triangle, and the corner where it starts there.
type Side = ([u32; 2], u32, u8);

impl Soup {
    /// All uses of edges, sorted: those of one edge are a run, which `chunk_by` gives and `uses` finds. Made anew by
    /// each step that needs it.
    fn sides(&self) -> Vec<Side> {
        let mut sides: Vec<Side> = (0..)
            .zip(&self.triangles)
            .flat_map(|(t, c)| {
                (0..3).map(move |k| {
                    let (a, b) = (c[k], c[(k + 1) % 3]);
                    ([a.min(b), a.max(b)], t, k as u8)
                })
            })
            .collect();
        sides.sort_unstable();
        sides
    }

    fn corners(&self, t: u32) -> [Point3; 3] {
        self.triangles[t as usize].map(|v| self.positions[v as usize])
    }

    /// One vertex for those within the tolerance of each other, and triangles without those that lost a corner. −0 and
    /// 0 are one place.
    fn merge(&mut self, tolerance: f64) {
        let tree = PointTree::of_positions(&self.positions).expect("a mesh is finite");
        let mut used = vec![false; self.positions.len()];
        for &v in self.triangles.as_flattened() {
            used[v as usize] = true;
        }
        // Each joins the lowest vertex near it that stays itself, so that chains do not creep.
        let mut stands: Vec<u32> = Vec::with_capacity(self.positions.len());
        for (v, p) in (0..).zip(tree.points()) {
            let near = if used[v as usize] {
                tree.within(p, tolerance)
            } else {
                Vec::new()
            };
            let first = near
                .iter()
                .map(|n| n.index)
                .filter(|&w| w < v && used[w as usize] && stands[w as usize] == w)
                .min();
            self.report.merged_vertices += usize::from(first.is_some());
            stands.push(first.unwrap_or(v));
        }
        for v in self.triangles.as_flattened_mut() {
            *v = stands[*v as usize];
        }
        let before = self.triangles.len();
        self.triangles
            .retain(|[a, b, c]| a != b && b != c && c != a);
        self.report.collapsed_triangles += before - self.triangles.len();
    }

    /// Of triangles with the same three corners, in whatever order, the first stays: also of two that lie back to back.
    fn drop_duplicates(&mut self) {
        let mut keys: Vec<([u32; 3], u32)> = (0..)
            .zip(&self.triangles)
            .map(|(t, &c)| {
                let mut key = c;
                key.sort_unstable();
                (key, t)
            })
            .collect();
        keys.sort_unstable();
        let mut drop = vec![false; self.triangles.len()];
        for pair in keys.windows(2) {
            if pair[0].0 == pair[1].0 {
                drop[pair[1].1 as usize] = true;
            }
        }
        self.report.duplicate_triangles += self.retain(|t| !drop[t as usize]);
    }

    /// Keeps some triangles; how many went?
    fn retain(&mut self, keep: impl Fn(u32) -> bool) -> usize {
        let before = self.triangles.len();
        let mut t = 0;
        self.triangles.retain(|_| {
            t += 1;
            keep(t - 1)
        });
        before - self.triangles.len()
    }

    /// The corner opposite to the longest edge, if the triangle is flat.
    fn flat_corner(&self, corners: [u32; 3], flat: f64) -> Option<usize> {
        let [a, b, c] = corners.map(|v| self.positions[v as usize]);
        let edges = [(c - b).norm(), (a - c).norm(), (b - a).norm()];
        let k = (0..3).fold(0, |best, k| if edges[k] > edges[best] { k } else { best });
        let doubled = (b - a).cross(&(c - a)).norm();
        (doubled <= flat * edges[k] * edges[k]).then_some(k)
    }

    /// A triangle without area whose corners differ has one corner on its longest edge: flipped with
    /// the triangle beyond that edge both get some. Dropping it would open a crack there.
    fn flatten(&mut self, flat: f64) {
        // A chain of such triangles is worked off from its end, one each pass.
        for _ in 0..16 {
            let bad: Vec<u32> = (0..self.triangles.len() as u32)
                .filter(|&t| self.flat_corner(self.triangles[t as usize], flat).is_some())
                .collect();
            if bad.is_empty() {
                return;
            }
            let sides = self.sides();
            let mut touched = vec![false; self.triangles.len()];
            let mut flipped = 0;
            for t in bad {
                let corners = self.triangles[t as usize];
                // A flip may have given it area before its turn.
                let Some(k) = self.flat_corner(corners, flat) else {
                    continue;
                };
                let (a, b, c) = (corners[(k + 1) % 3], corners[(k + 2) % 3], corners[k]);
                let [(_, s, _), (_, u, _)] = *uses(&sides, a, b) else {
                    continue;
                };
                let other = if s == t { u } else { s };
                if touched[t as usize] || touched[other as usize] {
                    continue;
                }
                let there = self.triangles[other as usize];
                let d = *there
                    .iter()
                    .find(|&&v| v != a && v != b)
                    .expect("three corners");
                if c == d || !uses(&sides, c, d).is_empty() {
                    continue;
                }
                // The other triangle's sense, whatever this one's is.
                let j = there.iter().position(|&v| v == d).expect("its corner");
                let (from, to) = (there[(j + 1) % 3], there[(j + 2) % 3]);
                let new = [[d, from, c], [c, to, d]];
                if new.iter().any(|&n| self.flat_corner(n, flat).is_some()) {
                    continue;
                }
                self.triangles[other as usize] = new[0];
                self.triangles[t as usize] = new[1];
                touched[t as usize] = true;
                touched[other as usize] = true;
                flipped += 1;
            }
            self.report.flipped_triangles += flipped;
            if flipped == 0 {
                break;
            }
        }
        let bad: Vec<bool> = self
            .triangles
            .iter()
            .map(|&c| self.flat_corner(c, flat).is_some())
            .collect();
        self.report.flat_triangles += self.retain(|t| !bad[t as usize]);
    }

    /// Turns triangles so that neighbours across edges of two agree: patch by patch the way that
    /// turns less area.
    fn orient(&mut self) -> Result<(), RepairError> {
        let sides = self.sides();
        let n = self.triangles.len();
        let mut neighbors = vec![[(NONE, false); 3]; n];
        // Neighbours across edges of two triangles, and whether both run alike.
        for group in sides.chunk_by(|x, y| x.0 == y.0) {
            match *group {
                [(_, s, i), (_, t, j)] => {
                    let start = |t: u32, k: u8| self.triangles[t as usize][k as usize];
                    let alike = start(s, i) != start(t, j);
                    neighbors[s as usize][i as usize] = (t, alike);
                    neighbors[t as usize][j as usize] = (s, alike);
                }
                [_] => {}
                _ => self.report.nonmanifold_edges += 1,
            }
        }
        // From the lowest triangle of each patch outwards, breadth first: a triangle met again the other way round is on
        // a one-sided surface.
        let mut turned: Vec<Option<bool>> = vec![None; n];
        for first in 0..n as u32 {
            if turned[first as usize].is_some() {
                continue;
            }
            turned[first as usize] = Some(false);
            let mut patch = vec![first];
            let mut queue = VecDeque::from([first]);
            while let Some(t) = queue.pop_front() {
                let own = turned[t as usize].expect("queued when known");
                for (other, alike) in neighbors[t as usize] {
                    if other == NONE {
                        continue;
                    }
                    let wanted = if alike { own } else { !own };
                    match turned[other as usize] {
                        None => {
                            turned[other as usize] = Some(wanted);
                            patch.push(other);
                            queue.push_back(other);
                        }
                        Some(is) if is != wanted => {
                            return Err(RepairError::OneSided { triangle: other });
                        }
                        Some(_) => {}
                    }
                }
            }
            // The larger side, by area, is right: less is turned.
            let area = |turn: bool| -> f64 {
                patch
                    .iter()
                    .filter(|&&t| turned[t as usize] == Some(turn))
                    .map(|&t| {
                        let [a, b, c] = self.corners(t);
                        (b - a).cross(&(c - a)).norm()
                    })
                    .sum()
            };
            if area(true) > area(false) {
                for &t in &patch {
                    turned[t as usize] = turned[t as usize].map(|is| !is);
                }
            }
        }
        for (corners, turn) in self.triangles.iter_mut().zip(turned) {
            if turn == Some(true) {
                corners.swap(1, 2);
                self.report.reversed_triangles += 1;
            }
        }
        Ok(())
    }

    /// Gives every sheet at a non-manifold edge and every fan at a vertex vertices of its own.
    fn part_sheets(&mut self) {
        loop {
            let sides = self.sides();
            let mut twin = vec![NONE; 3 * self.triangles.len()];
            for group in sides.chunk_by(|x, y| x.0 == y.0) {
                for [g, h] in self.pairs(group) {
                    twin[g as usize] = h;
                    twin[h as usize] = g;
                }
            }
            // Corners are one vertex if turning around leads from one to the other.
            let mut sets = DisjointSets::new(3 * self.triangles.len());
            for (h, &g) in twin.iter().enumerate() {
                if g != NONE {
                    let (h, g) = (h as u32, g);
                    sets.join(h, next(g));
                    sets.join(next(h), g);
                }
            }
            let mut number = vec![NONE; 3 * self.triangles.len()];
            let mut taken = vec![false; self.positions.len()];
            let mut positions = self.positions.clone();
            let mut triangles = self.triangles.clone();
            for c in 0..3 * self.triangles.len() {
                let set = sets.find(c as u32) as usize;
                let v = triangles.as_flattened()[c];
                if number[set] == NONE {
                    number[set] = if std::mem::replace(&mut taken[v as usize], true) {
                        positions.push(self.positions[v as usize]);
                        positions.len() as u32 - 1
                    } else {
                        v
                    };
                }
                triangles.as_flattened_mut()[c] = number[set];
            }
            // Sheets that part at an edge may meet again behind its ends: then a triangle must go.
            let parted = Soup {
                positions,
                triangles,
                report: self.report,
            };
            let sides = parted.sides();
            let mut drop = vec![false; parted.triangles.len()];
            let mut any = false;
            for group in sides.chunk_by(|x, y| x.0 == y.0) {
                let fits = match *group {
                    [_] => true,
                    [(_, s, i), (_, t, j)] => {
                        twin[3 * s as usize + i as usize] == 3 * t + u32::from(j)
                    }
                    _ => false,
                };
                if !fits {
                    // Those without a partner, or else the last.
                    let lonely = group
                        .iter()
                        .rev()
                        .find(|&&(_, t, k)| twin[3 * t as usize + k as usize] == NONE);
                    let &(_, t, _) = lonely.unwrap_or(&group[group.len() - 1]);
                    drop[t as usize] = true;
                    any = true;
                }
            }
            if !any {
                self.report.split_vertices += parted.positions.len() - self.positions.len();
                (self.positions, self.triangles) = (parted.positions, parted.triangles);
                return;
            }
            self.report.trimmed_triangles += self.retain(|t| !drop[t as usize]);
        }
    }

    /// Which of the triangles at an edge go on into each other, as half-edges: the two of an ordinary
    /// edge; of more, those with the solid between them, so that solids that touch part.
    fn pairs(&self, group: &[Side]) -> Vec<[u32; 2]> {
        let halfedge = |&(_, t, k): &Side| 3 * t + u32::from(k);
        if let [g, h] = group {
            let start = |&(_, t, k): &Side| self.triangles[t as usize][k as usize];
            return if start(g) == start(h) {
                vec![]
            } else {
                vec![[halfedge(g), halfedge(h)]]
            };
        }
        if group.len() < 2 {
            return vec![];
        }
        let [low, high] = group[0].0.map(|v| self.positions[v as usize]);
        let Some(axis) = (high - low).try_normalize(0.0) else {
            return vec![];
        };
        let u = axis.cross(&Vector3::ith(axis.iamin(), 1.0)).normalize();
        let w = axis.cross(&u);
        // Around the edge, counter-clockwise seen from its high end.
        let mut around: Vec<(f64, u32, bool)> = group
            .iter()
            .map(|side| {
                let h = halfedge(side);
                let corners = self.triangles[side.1 as usize];
                let apex = self.positions[corners[(side.2 as usize + 2) % 3] as usize] - low;
                let along = corners[side.2 as usize] == side.0[0];
                (apex.dot(&w).atan2(apex.dot(&u)), h, along)
            })
            .collect();
        around.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        // Turning counter-clockwise, a solid begins at a triangle that runs against the edge and
        // ends at the next one if that runs along it.
        let n = around.len();
        let mut pairs = Vec::new();
        for i in 0..n {
            let (before, this) = (around[i], around[(i + 1) % n]);
            if !before.2 && this.2 {
                pairs.push([before.1, this.1]);
            }
        }
        pairs
    }

    /// Covers boundary loops of at most so many edges. Loops are found on the parted mesh, and new triangles come last.
    fn fill(&mut self, most: usize) {
        let edges = Halfedges::<3>::new(self.positions.len(), &self.triangles)
            .expect("sheets and fans are parted");
        let loops: Vec<Vec<u32>> = edges
            .boundary_loops()
            .into_iter()
            .map(|ring| ring.into_iter().map(|v| v.0).collect())
            .collect();
        let mut filled = Vec::new();
        if most >= 3 {
            let sides = self.sides();
            for ring in &loops {
                if ring.len() <= most
                    && let Some(new) = self.cover(ring, &sides)
                {
                    self.report.filled_holes += 1;
                    self.report.fill_triangles += new.len();
                    filled.extend(new);
                }
            }
        }
        self.report.open_loops = loops.len() - self.report.filled_holes;
        self.triangles.extend(filled);
    }

    /// The triangles of least area in a boundary loop (Barequet and Sharir, *Filling gaps in the
    /// boundary of a polyhedron*, 1995), without edges that the mesh has already. Dynamic programming over the polygons
    /// that a diagonal cuts off: `O(n³)` time, `O(n²)` memory. `None` where every cover would repeat an edge, or where
    /// the least one has a triangle without area or lies on one that is there.
    fn cover(&self, ring: &[u32], sides: &[Side]) -> Option<Vec<[u32; 3]>> {
        let n = ring.len();
        let p = |i: usize| self.positions[ring[i] as usize];
        let area = |i: usize, j: usize, k: usize| 0.5 * (p(j) - p(i)).cross(&(p(k) - p(i))).norm();
        let free = |i: usize, j: usize| {
            j == i + 1 || (i == 0 && j == n - 1) || uses(sides, ring[i], ring[j]).is_empty()
        };
        // least[i][j]: of the polygon i, i + 1, … j, and the corner behind the edge i–j.
        let mut least = vec![vec![(0.0, 0); n]; n];
        for span in 2..n {
            for i in 0..n - span {
                let j = i + span;
                least[i][j] = if free(i, j) {
                    (i + 1..j)
                        .map(|k| (least[i][k].0 + least[k][j].0 + area(i, k, j), k))
                        .fold((f64::INFINITY, 0), |a, b| if b.0 < a.0 { b } else { a })
                } else {
                    (f64::INFINITY, 0)
                };
            }
        }
        if !least[0][n - 1].0.is_finite() {
            return None;
        }
        let mut out = Vec::with_capacity(n - 2);
        let mut stack = vec![(0, n - 1)];
        while let Some((i, j)) = stack.pop() {
            if j - i < 2 {
                continue;
            }
            let k = least[i][j].1;
            // The loop has the surface on its left, the cover on its right.
            out.push([ring[j], ring[k], ring[i]]);
            stack.extend([(k, j), (i, k)]);
        }
        let unfit = |c: &[u32; 3]| {
            // A lone triangle's hole would be covered by its own back.
            let again = uses(sides, c[0], c[1])
                .iter()
                .any(|&(_, t, _)| self.triangles[t as usize].contains(&c[2]));
            again || self.flat_corner(*c, 0.0).is_some()
        };
        (!out.iter().any(unfit)).then_some(out)
    }

    /// Drops small components and turns closed ones out of the solid.
    fn components(&mut self, options: &Options) {
        let n = self.triangles.len();
        let mut sets = DisjointSets::new(self.positions.len());
        for &[a, b, c] in &self.triangles {
            sets.join(a, b);
            sets.join(b, c);
        }
        let mut number = vec![NONE; self.positions.len()];
        let mut members: Vec<Vec<u32>> = Vec::new();
        for t in 0..n as u32 {
            let root = sets.find(self.triangles[t as usize][0]) as usize;
            if number[root] == NONE {
                number[root] = members.len() as u32;
                members.push(Vec::new());
            }
            members[number[root] as usize].push(t);
        }
        let mut drop = vec![false; n];
        members.retain(|part| {
            let small = part.len() < options.least_component;
            if small {
                part.iter().for_each(|&t| drop[t as usize] = true);
                self.report.dropped_components += 1;
            }
            !small
        });
        if options.outward {
            self.turn_out(&members);
        }
        self.retain(|t| !drop[t as usize]);
    }

    /// Nesting decides: a closed component that lies in an odd number of others bounds a cavity of them. Its own volume
    /// says how it is turned now.
    fn turn_out(&mut self, members: &[Vec<u32>]) {
        let mut open = vec![false; self.triangles.len()];
        for group in self.sides().chunk_by(|x, y| x.0 == y.0) {
            if let [(_, t, _)] = *group {
                open[t as usize] = true;
            }
        }
        let closed: Vec<&Vec<u32>> = members
            .iter()
            .filter(|part| !part.iter().any(|&t| open[t as usize]))
            .collect();
        let solids: Vec<Solid> = closed.iter().map(|part| self.solid(part)).collect();
        let turn: Vec<bool> = parallel::map(closed.len(), |i| {
            let bounds = solids[i].tree.bounds();
            let inside = |j: usize| {
                let outer = solids[j].tree.bounds();
                let holds =
                    (0..3).all(|k| outer.min[k] <= bounds.min[k] && bounds.max[k] <= outer.max[k]);
                j != i && holds && self.lies_in(closed[i], &solids[j])
            };
            let cavity = (0..closed.len()).filter(|&j| inside(j)).count() % 2 == 1;
            let volume = solids[i].volume;
            if cavity { volume > 0.0 } else { volume < 0.0 }
        });
        let wrong: Vec<u32> = closed
            .iter()
            .zip(&turn)
            .filter(|(_, turn)| **turn)
            .flat_map(|(part, _)| part.iter().copied())
            .collect();
        self.report.turned_components += turn.iter().filter(|&&turn| turn).count();
        for t in wrong {
            self.triangles[t as usize].swap(1, 2);
        }
    }

    /// A component with its tree and its signed volume.
    fn solid(&self, part: &[u32]) -> Solid {
        let corners: Vec<Point3> = part.iter().flat_map(|&t| self.corners(t)).collect();
        let triangles = (0..part.len() as u32).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]);
        let mesh = TriMesh::new(corners, triangles.collect()).expect("parts of a valid mesh");
        Solid {
            tree: TriangleTree::new(&mesh).expect("a part has triangles"),
            volume: mesh.volume(),
        }
    }

    /// Does a closed component lie in another? Asked of the first of its triangles whose centre is
    /// clear of the other's surface, since solids may touch.
    fn lies_in(&self, part: &[u32], solid: &Solid) -> bool {
        let clear = 1e-6 * solid.tree.bounds().diagonal();
        let center = part
            .iter()
            .map(|&t| {
                let [a, b, c] = self.corners(t);
                a + ((b - a) + (c - a)) / 3.0
            })
            .find(|p| solid.tree.closest_within(p, clear).is_none());
        let Some(center) = center else { return false };
        // A direction that no made mesh has among its edges and faces.
        let direction = Vector3::new(0.453_621, 0.287_993, 0.843_389);
        solid
            .tree
            .first_hit(&center, &direction)
            .is_some_and(|hit| hit.entering != (solid.volume > 0.0))
    }

    /// Drops vertices that no triangle uses; the others keep their order.
    fn compact(&mut self) {
        let mut number = vec![NONE; self.positions.len()];
        for &v in self.triangles.as_flattened() {
            number[v as usize] = 0;
        }
        let mut count = 0;
        let mut positions = Vec::new();
        for (v, slot) in number.iter_mut().enumerate() {
            if *slot == 0 {
                *slot = count;
                count += 1;
                positions.push(self.positions[v]);
            }
        }
        let gone = self.positions.len() - positions.len();
        self.report.unused_vertices = gone - self.report.merged_vertices;
        for v in self.triangles.as_flattened_mut() {
            *v = number[*v as usize];
        }
        self.positions = positions;
    }
}

/// The half-edge after this one in its triangle.
fn next(h: u32) -> u32 {
    if h % 3 == 2 { h - 2 } else { h + 1 }
}

/// The triangles at an edge, by two searches in the sorted list; none if it is no edge.
fn uses(sides: &[Side], a: u32, b: u32) -> &[Side] {
    let key = [a.min(b), a.max(b)];
    let first = sides.partition_point(|s| s.0 < key);
    let count = sides[first..].partition_point(|s| s.0 == key);
    &sides[first..first + count]
}

/// A closed component, to be asked what lies in it.
struct Solid {
    tree: TriangleTree,
    volume: f64,
}
