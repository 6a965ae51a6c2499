//! Tetrahedra are cut where labels change.
//!
//! With two labels there are few cases: one corner against three (a tetrahedron and a prism), two against two (two prisms),
//! and less where corners lie on the interface. Prisms are cut into three tetrahedra, their quads along the diagonal at the
//! vertex of the lowest number; the neighbour sees the same numbers and cuts the same way, without being asked. Three or four labels
//! meet in a point inside of the tetrahedron, and on each face with three labels in one of that face: where the boundary of
//! two materials meets the isosurface, if one of the labels is the molecule.

use geom_core::compute::parallel;
use geom_core::mesh::{FACES, INTERIOR, Region};
use geom_core::{Point3, Vector3};

use super::near::{NONE, Near};
use crate::dual::{Probe, Sample};
use crate::octree::along;

/// How near to a side of its face a point where three labels meet may go, as a share of the height.
const SIDE: f64 = 0.2;

/// Tetrahedra of one label each, and what stands at the vertices that were added.
pub(super) struct Cut {
    pub(super) tets: Vec<([u32; 4], Region)>,
    /// The labels that meet at each.
    pub(super) added: Vec<[Region; 4]>,
}

impl Near {
    /// Cuts all tetrahedra; adds the points of cuts, of faces and of cells where three labels meet.
    /// In the order of the tetrahedra. Edges, then faces, then cells add their points, each in sorted order, before any
    /// tetrahedron is cut: so that the cutting only reads.
    pub(super) fn cut(&self, probe: &Probe<'_>, positions: &mut Vec<Point3>) -> Cut {
        let mut added = Vec::new();
        let mut cutter = Cutter {
            near: self,
            probe,
            at: self.add_cuts(positions, &mut added),
            several: parallel::flat_map(self.tets.len(), |t| {
                Some(t as u32).filter(|&t| self.labels_of(t) > 2)
            }),
            faces: Vec::new(),
            first_face: 0,
            first_cell: 0,
        };
        cutter.add_faces(positions, &mut added);
        cutter.add_cells(positions, &mut added);
        let tets = parallel::flat_map(self.tets.len(), |t| {
            let t = t as u32;
            let mut out = Vec::with_capacity(6);
            match cutter.several.binary_search(&t) {
                Ok(i) => cutter.several(t, cutter.first_cell + i as u32, &mut out),
                Err(_) => cutter.two(t, &mut out),
            }
            out
        });
        Cut { tets, added }
    }

    /// Adds the cuts of edges whose ends are both off the interface, and lists their vertices.
    fn add_cuts(&self, positions: &mut Vec<Point3>, added: &mut Vec<[Region; 4]>) -> Vec<u32> {
        let mut at = vec![NONE; self.edges.len()];
        for (e, at) in at.iter_mut().enumerate() {
            let [a, b] = self.edges[e];
            if self.zero[a as usize].is_none() && self.zero[b as usize].is_none() {
                let [p, q] = [a, b].map(|v| self.samples[v as usize].x);
                *at = positions.len() as u32;
                positions.push(along(p, q, self.cuts[e]));
                let [p, q] = [a, b].map(|v| self.label(v));
                added.push([p, p, q, q]);
            }
        }
        at
    }
}

/// Of at least one.
fn mean(points: impl IntoIterator<Item = Point3>) -> Point3 {
    let (sum, n) = points
        .into_iter()
        .fold((Vector3::zeros(), 0.0), |(s, n), p| (s + p.coords, n + 1.0));
    Point3::from(sum / n)
}

/// From the middle of a triangle towards another of its points, as far as that stays off its sides.
fn off_sides(corners: [Point3; 3], middle: Point3, x: Point3) -> Point3 {
    let of = |x: &Point3| {
        let [a, b, c] = corners;
        let area = |a: &Point3, b: &Point3, c: &Point3| (b - a).cross(&(c - a)).norm();
        let all = area(&a, &b, &c);
        [area(x, &b, &c), area(&a, x, &c), area(&a, &b, x)].map(|part| part / all)
    };
    let share = of(&middle).into_iter().zip(of(&x)).map(|(from, to)| {
        if to >= SIDE {
            1.0
        } else {
            ((from - SIDE) / (from - to)).max(0.0)
        }
    });
    along(middle, x, share.fold(1.0, f64::min))
}

struct Cutter<'a> {
    near: &'a Near,
    probe: &'a Probe<'a>,
    /// Vertex of each cut edge.
    at: Vec<u32>,
    /// Tetrahedra with more than two labels, in order; from `first_cell` on each has a vertex inside.
    several: Vec<u32>,
    first_cell: u32,
    /// Faces with three labels, in order; from `first_face` on each has a vertex.
    faces: Vec<[u32; 3]>,
    first_face: u32,
}

/// A vertex within a tetrahedron: one of its corners, or the cut between two of them.
#[derive(Clone, Copy)]
enum Spot {
    /// By its place in the tetrahedron.
    Corner(usize),
    /// Of the edge between these two.
    Cut(usize, usize),
}

/// Twice the determinant of barycentric coordinates, up to a factor: positive if the four spots stand
/// as the corners of their tetrahedron do, wherever the cuts are.
/// It is made of whole numbers, as if each cut stood in the middle of its edge: moving cuts along their edges never
/// turns a piece over.
fn hand(spots: &[Spot; 4]) -> i32 {
    let rows = spots.map(|s| {
        let mut row = [0i32; 4];
        match s {
            Spot::Corner(i) => row[i] = 2,
            Spot::Cut(i, j) => (row[i], row[j]) = (1, 1),
        }
        row
    });
    let minor =
        |i: usize, j: usize, k: usize, l: usize| rows[i][k] * rows[j][l] - rows[i][l] * rows[j][k];
    minor(0, 1, 0, 1) * minor(2, 3, 2, 3) - minor(0, 1, 0, 2) * minor(2, 3, 1, 3)
        + minor(0, 1, 0, 3) * minor(2, 3, 1, 2)
        + minor(0, 1, 1, 2) * minor(2, 3, 0, 3)
        - minor(0, 1, 1, 3) * minor(2, 3, 0, 2)
        + minor(0, 1, 2, 3) * minor(2, 3, 0, 1)
}

/// Cuts a tetrahedron whose corners, in ascending order of their numbers, are `below` and `above` an
/// interface or `on` it. Quads are cut from the corner of the lowest number, so that neighbours agree.
/// `emit` gets each piece and whether it lies above. Orientation is left to [`hand`]. Two to six pieces come, as many
/// as cuts and quads need: at least one corner must lie on each side.
fn stencil(below: &[usize], above: &[usize], on: &[usize], mut emit: impl FnMut([Spot; 4], bool)) {
    use Spot::{Corner as P, Cut as C};
    // A single corner is cut off; what remains has one or two quads per further corner.
    let mut cut_off = |p: usize, rest: &[usize], side: bool| match (rest, on) {
        (&[m], &[y, z]) => {
            emit([P(p), C(p, m), P(y), P(z)], side);
            emit([P(m), C(p, m), P(y), P(z)], !side);
        }
        (&[m, n], &[z]) => {
            emit([P(p), C(p, m), C(p, n), P(z)], side);
            emit([P(m), C(p, m), C(p, n), P(z)], !side);
            emit([P(m), P(n), C(p, n), P(z)], !side);
        }
        (&[l, m, n], &[]) => {
            emit([P(p), C(p, l), C(p, m), C(p, n)], side);
            emit([P(l), C(p, l), C(p, m), C(p, n)], !side);
            emit([P(l), P(m), C(p, m), C(p, n)], !side);
            emit([P(l), P(m), P(n), C(p, n)], !side);
        }
        _ => unreachable!("a tetrahedron has four corners"),
    };
    match (below, above) {
        (&[p], rest) => cut_off(p, rest, false),
        (rest, &[p]) => cut_off(p, rest, true),
        (&[p, q], &[m, n]) => {
            for (p, q, m, n, side) in [(p, q, m, n, false), (m, n, p, q, true)] {
                emit([P(p), P(q), C(q, m), C(q, n)], side);
                // The quad of the interface has its diagonal from (p, n) to (q, m).
                emit([P(p), C(p, m), C(p, n), C(q, m)], side);
                emit([P(p), C(p, n), C(q, m), C(q, n)], side);
            }
        }
        _ => unreachable!("a tetrahedron has four corners"),
    }
}

impl Cutter<'_> {
    /// Adds points to faces with three labels, which two tetrahedra share.
    fn add_faces(&mut self, positions: &mut Vec<Point3>, added: &mut Vec<[Region; 4]>) {
        let near = self.near;
        self.faces = self
            .several
            .iter()
            .flat_map(|&t| FACES.map(|f| f.map(|k| near.tets[t as usize][k])))
            .filter(|f| {
                let [a, b, c] = f.map(|v| near.label(v));
                a != b && b != c && a != c
            })
            .map(|mut f| {
                f.sort_unstable();
                f
            })
            .collect();
        self.faces.sort_unstable();
        self.faces.dedup();
        self.first_face = positions.len() as u32;
        for &[a, b, c] in &self.faces {
            let ends = [[a, b], [b, c], [c, a]].map(|[a, b]| self.point(a, b));
            let ends = ends.map(|v| positions[v as usize]);
            let labels = [a, b, c].map(|v| near.label(v));
            let middle = mean(ends);
            let corners = [a, b, c].map(|v| near.samples[v as usize].x);
            positions.push(match self.junction(labels, ends) {
                Some(x) => off_sides(corners, middle, x),
                None => middle,
            });
            added.push([a, b, c, c].map(|v| near.label(v)));
        }
    }

    /// Where the boundary of two regions meets the isosurface in a face: the isosurface is the line between its two cuts,
    /// on which the boundary is found by bisection. Cuts in the order ab, bc, ca. `None` without the molecule, or where
    /// the ends of the line do not belong to the two regions.
    fn junction(&self, labels: [Region; 3], cuts: [Point3; 3]) -> Option<Point3> {
        let molecule = labels.iter().position(|&l| l == INTERIOR)?;
        let (next, last) = ((molecule + 1) % 3, (molecule + 2) % 3);
        let samples = self.probe.samples;
        let end = |x: Point3, label: Region| {
            let value = f64::NEG_INFINITY;
            let there = samples.labels.at(value, &samples.domain.world(&x));
            (there == label).then_some(Sample { x, label, value })
        };
        let a = end(cuts[molecule], labels[next])?;
        let b = end(cuts[last], labels[last])?;
        Some(along(a.x, b.x, self.probe.crossing(&a, &b)))
    }

    /// Adds points inside of tetrahedra with more than two labels: in the middle of those of its faces, of which at least
    /// two have three labels. Two that lie on a plane have it there too.
    fn add_cells(&mut self, positions: &mut Vec<Point3>, added: &mut Vec<[Region; 4]>) {
        let near = self.near;
        self.first_cell = positions.len() as u32;
        for &t in &self.several {
            let tet = near.tets[t as usize];
            let junctions = FACES.map(|f| f.map(|k| tet[k]));
            let junctions = junctions.iter().filter_map(|face| self.junction_at(face));
            positions.push(mean(junctions.map(|v| positions[v as usize])));
            added.push(tet.map(|v| near.label(v)));
        }
    }

    /// The vertex of a face, if it has three labels.
    fn junction_at(&self, face: &[u32; 3]) -> Option<u32> {
        let mut key = *face;
        key.sort_unstable();
        let found = self.faces.binary_search(&key).ok()?;
        Some(self.first_face + found as u32)
    }

    /// The vertex where the edge between two corners is cut.
    fn point(&self, a: u32, b: u32) -> u32 {
        self.at[self.near.edge(a, b) as usize]
    }

    /// Cuts a tetrahedron with one or two labels and any number of corners on their interface.
    /// With one label it comes as it is. A corner on the interface belongs to neither side.
    fn two(&self, t: u32, out: &mut Vec<([u32; 4], Region)>) {
        let near = self.near;
        let tet = near.tets[t as usize];
        let mut order = [0, 1, 2, 3];
        order.sort_unstable_by_key(|&k| tet[k]);
        let zero = |k: usize| near.zero[tet[k] as usize].is_some();
        let labels = || {
            order
                .iter()
                .filter(|&&k| !zero(k))
                .map(|&k| near.label(tet[k]))
        };
        let (Some(low), Some(high)) = (labels().min(), labels().max()) else {
            unreachable!("snapping leaves no tetrahedron on the interface as a whole");
        };
        if low == high {
            out.push((tet.map(|v| near.ids[v as usize]), low));
            return;
        }
        let of = |keep: &dyn Fn(usize) -> bool| -> Vec<usize> {
            order.iter().copied().filter(|&k| keep(k)).collect()
        };
        let below = of(&|k| !zero(k) && near.label(tet[k]) == low);
        let above = of(&|k| !zero(k) && near.label(tet[k]) == high);
        let on = of(&zero);
        stencil(&below, &above, &on, |mut spots, side| {
            if hand(&spots) < 0 {
                spots.swap(2, 3);
            }
            let ids = spots.map(|s| match s {
                Spot::Corner(k) => near.ids[tet[k] as usize],
                Spot::Cut(i, j) => self.point(tet[i], tet[j]),
            });
            out.push((ids, if side { high } else { low }));
        });
    }

    /// Cuts a tetrahedron with three or four labels, none of whose corners is on an interface: cones
    /// from a point inside over the pieces of its faces.
    /// Both tetrahedra at a face cut it the same way: a corner alone, or the three corners around the point of the
    /// face.
    fn several(&self, t: u32, apex: u32, out: &mut Vec<([u32; 4], Region)>) {
        let near = self.near;
        let tet = near.tets[t as usize];
        for f in FACES {
            let face = f.map(|k| tet[k]);
            let [la, lb, lc] = face.map(|v| near.label(v));
            let mut emit = |t: [u32; 3], label| out.push(([apex, t[0], t[1], t[2]], label));
            let id = |v: u32| near.ids[v as usize];
            if la == lb && lb == lc {
                emit(face.map(id), la);
            } else if la != lb && lb != lc && la != lc {
                let middle = self.junction_at(&face);
                let middle = middle.expect("its point has been added");
                for k in 0..3 {
                    let [a, b, c] = [0, 1, 2].map(|i| face[(k + i) % 3]);
                    let (next, last) = (self.point(a, b), self.point(c, a));
                    emit([id(a), next, middle], near.label(a));
                    emit([id(a), middle, last], near.label(a));
                }
            } else {
                // The corner alone, then the quad of the other two.
                let k = (0..3)
                    .find(|&k| {
                        let [a, b, c] = [0, 1, 2].map(|i| near.label(face[(k + i) % 3]));
                        a != b && a != c
                    })
                    .expect("one of three labels differs from the other two");
                let [p, m, n] = [0, 1, 2].map(|i| face[(k + i) % 3]);
                let (x, y) = (self.point(p, m), self.point(p, n));
                emit([id(p), x, y], near.label(p));
                if m < n {
                    emit([id(m), id(n), y], near.label(m));
                    emit([id(m), y, x], near.label(m));
                } else {
                    emit([id(n), y, x], near.label(n));
                    emit([id(n), x, id(m)], near.label(n));
                }
            }
        }
    }
}

/// What holds here, for the tests.
#[cfg(feature = "testing")]
pub(crate) mod laws {
    use super::*;
    use geom_core::mesh::six_volume;

    /// Every way in which corners can lie below, above and on an interface.
    pub fn stencils_fill_their_tetrahedron() {
        let corners = [[0., 0., 0.], [1., 0., 0.], [0., 1., 0.], [0., 0., 1.]].map(Point3::from);
        for code in 0..81 {
            let class: [usize; 4] = std::array::from_fn(|k| code / 3usize.pow(k as u32) % 3);
            let of = |c: usize| -> Vec<usize> { (0..4).filter(|&k| class[k] == c).collect() };
            let (below, above, on) = (of(0), of(1), of(2));
            if below.is_empty() || above.is_empty() {
                continue;
            }
            let (mut sum, mut n) = (0.0, 0);
            stencil(&below, &above, &on, |mut spots, side| {
                if hand(&spots) < 0 {
                    spots.swap(2, 3);
                }
                let points = spots.map(|s| match s {
                    Spot::Corner(k) => {
                        assert_ne!(class[k], usize::from(!side), "a corner on its own side");
                        corners[k]
                    }
                    Spot::Cut(i, j) => {
                        assert_eq!(class[i] + class[j], 1, "cuts part the two sides");
                        let (i, j) = if class[i] == 0 { (i, j) } else { (j, i) };
                        corners[i] + (corners[j] - corners[i]) * 0.3
                    }
                });
                let volume = six_volume(points);
                assert!(volume > 1e-6, "{class:?}: {volume}");
                sum += volume;
                n += 1;
            });
            assert!((sum - 1.0).abs() < 1e-14, "{class:?} fills {sum} of 1");
            assert_eq!(
                n,
                [2, 3, 4, 6][match (below.len(), above.len()) {
                    (1, 1) => 0,
                    (1, 2) | (2, 1) => 1,
                    (2, 2) => 3,
                    _ => 2,
                }]
            );
        }
    }
}
