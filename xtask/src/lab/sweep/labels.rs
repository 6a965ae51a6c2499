//! What the labels of a lattice say about the topology of the solid that they stand for: components,
//! tunnels and cavities, counted without any mesh.
//!
//! Labels sit on the corners of cubic cells and on the middles of some of them. Solid and rest are the
//! parts of a cell complex all of whose corners have the label. Both meshers promise the topology of
//! such a complex; which one is what [`Cells`] says.

use geom_core::compute::sets::DisjointSets;

/// How the cells between the corners are filled.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) enum Cells {
    /// Cubes. Those in which the corners of one label do not hang together by edges of the cube are
    /// cut into twelve tetrahedra about their middle; a face with equal labels at opposite corners is
    /// cut along the diagonal whose sign the saddle of the bilinear interpolant has.
    Cubes,
    /// The tetrahedra between an edge and the middles of two cells that share a face with this edge. A
    /// middle has the label of its corners where these agree.
    Centred,
}

/// Betti numbers of a solid that does not touch the box.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) struct Topology {
    pub(crate) components: i64,
    pub(crate) tunnels: i64,
    pub(crate) cavities: i64,
}

/// Values minus level on a lattice, x fastest; at least 0 is inside.
pub(crate) struct Lattice<'a> {
    pub(crate) counts: [usize; 3],
    pub(crate) values: &'a [f64],
    /// The same in the middle of the cell with this lowest corner.
    pub(crate) middle: &'a dyn Fn([usize; 3]) -> f64,
}

const AXES: [[usize; 3]; 3] = [[0, 1, 2], [1, 2, 0], [2, 0, 1]];

impl Lattice<'_> {
    fn index(&self, p: [usize; 3]) -> usize {
        p[0] + self.counts[0] * (p[1] + self.counts[1] * p[2])
    }

    /// The step of the index along an axis.
    fn step(&self, axis: usize) -> usize {
        self.counts[..axis].iter().product()
    }

    /// The corners of the cell at `i`, bit 0 of their number for x.
    fn corners(&self, i: usize) -> [usize; 8] {
        std::array::from_fn(|c| {
            i + (0..3)
                .filter(|k| c >> k & 1 == 1)
                .map(|k| self.step(k))
                .sum::<usize>()
        })
    }

    /// The corners of the face at `i` across `axis`, around it.
    fn face(&self, i: usize, axis: usize) -> [usize; 4] {
        let [_, u, v] = AXES[axis].map(|k| self.step(k));
        [i, i + u, i + u + v, i + v]
    }

    /// The corners 1 and 3 of a face are joined, not 0 and 2.
    fn joins_one_and_three(&self, face: [usize; 4]) -> bool {
        let [a, b, c, d] = face.map(|i| self.values[i]);
        let [ia, ib, ic, id] = [a, b, c, d].map(|v| v >= 0.0);
        if ia == ic && ib == id && ia != ib {
            return ((a * c - b * d) / (a + c - b - d) >= 0.0) == ib;
        }
        ia != ic && ib == id
    }

    /// Counts; an error where the solid touches the box, where a solid's complement has no outside.
    pub(crate) fn topology(&self, cells: Cells) -> Result<Topology, String> {
        let n = self.counts;
        let points = n.iter().product::<usize>();
        let inside: Vec<bool> = self.values.iter().map(|&v| v >= 0.0).collect();
        let on_box = |p: [usize; 3]| (0..3).any(|k| p[k] == 0 || p[k] + 1 == n[k]);
        // Middles, numbered as the lowest corner of their cell.
        let mut middle: Vec<Option<bool>> = vec![None; points];
        for p in all(n) {
            let i = self.index(p);
            if on_box(p) && inside[i] {
                return Err(format!("the solid touches the box at {p:?}"));
            }
            if (0..3).any(|k| p[k] + 1 == n[k]) {
                continue;
            }
            let corners = self.corners(i).map(|c| inside[c]);
            let mixed = corners.contains(&true) && corners.contains(&false);
            middle[i] = match cells {
                Cells::Cubes => (mixed && !is_simple(corners)).then(|| (self.middle)(p) >= 0.0),
                Cells::Centred if mixed => Some((self.middle)(p) >= 0.0),
                Cells::Centred => Some(corners[0]),
            };
        }
        // A corner has its own number, a middle that of its cell after all corners.
        let label = |v: usize| {
            if v < points {
                inside[v]
            } else {
                middle[v - points] == Some(true)
            }
        };
        let mut sets = DisjointSets::new(2 * points);
        // Elements of the solid, those of even dimension less those of odd.
        let mut euler = 0;
        let mut add = |corners: &[usize]| {
            let first = label(corners[0]);
            if corners.iter().any(|&c| label(c) != first) {
                return;
            }
            if let [a, b] = *corners {
                sets.join(a as u32, b as u32);
            }
            if first {
                let dimension = match corners.len() {
                    8 => 3,
                    n => n as i64 - 1,
                };
                euler += 1 - 2 * (dimension % 2);
            }
        };
        let mut square = 0;
        for p in all(n) {
            let i = self.index(p);
            add(&[i]);
            for [axis, u, v] in AXES {
                if p[axis] + 1 < n[axis] {
                    add(&[i, i + self.step(axis)]);
                }
                // The face across the axis, and the cells on both sides.
                if p[u] + 1 == n[u] || p[v] + 1 == n[v] {
                    continue;
                }
                let face = self.face(i, axis);
                let above = (p[axis] + 1 < n[axis]).then(|| middle[i]).flatten();
                let below = (p[axis] > 0).then(|| middle[i - self.step(axis)]).flatten();
                match cells {
                    Cells::Centred => {
                        let (Some(_), Some(_)) = (above, below) else {
                            continue;
                        };
                        let (c, d) = (points + i, points + i - self.step(axis));
                        add(&[c, d]);
                        for k in 0..4 {
                            add(&[face[k], c, d]);
                            add(&[face[k], face[(k + 1) % 4], c, d]);
                        }
                    }
                    Cells::Cubes if above.or(below).is_none() => {
                        // A square has four corners, as a tetrahedron, but dimension 2.
                        square += i64::from(face.iter().all(|&c| inside[c]));
                    }
                    Cells::Cubes => {
                        let [a, b, c, d] = if self.joins_one_and_three(face) {
                            [face[1], face[2], face[3], face[0]]
                        } else {
                            face
                        };
                        add(&[a, c]);
                        add(&[a, b, c]);
                        add(&[a, c, d]);
                        // The cells that are cut, with their middles as tips.
                        let tips = [above.map(|_| i), below.map(|_| i - self.step(axis))];
                        for tip in tips.into_iter().flatten().map(|cell| points + cell) {
                            add(&[a, c, tip]);
                            add(&[a, b, c, tip]);
                            add(&[a, c, d, tip]);
                        }
                    }
                }
            }
            if (0..3).any(|k| p[k] + 1 == n[k]) {
                continue;
            }
            let corners = self.corners(i);
            match middle[i] {
                None => add(&corners),
                Some(_) => {
                    add(&[points + i]);
                    for (k, &corner) in corners.iter().enumerate() {
                        add(&[corner, points + i]);
                        for bit in [1, 2, 4].into_iter().filter(|bit| k & bit == 0) {
                            add(&[corner, corners[k | bit], points + i]);
                        }
                    }
                }
            }
        }
        euler += square;
        let (mut components, mut rest) = (0, 0);
        for v in 0..2 * points {
            let exists = v < points || middle[v - points].is_some();
            if exists && sets.find(v as u32) == v as u32 {
                *if label(v) { &mut components } else { &mut rest } += 1;
            }
        }
        let cavities = rest - 1;
        Ok(Topology {
            components,
            tunnels: components + cavities - euler,
            cavities,
        })
    }
}

/// All points, x fastest.
fn all(n: [usize; 3]) -> impl Iterator<Item = [usize; 3]> {
    (0..n[2]).flat_map(move |z| (0..n[1]).flat_map(move |y| (0..n[0]).map(move |x| [x, y, z])))
}

/// Do the corners of each label hang together by edges of the cube?
fn is_simple(corners: [bool; 8]) -> bool {
    [true, false].into_iter().all(|label| {
        let Some(first) = (0..8).find(|&i| corners[i] == label) else {
            return true;
        };
        let mut reached = 1u8 << first;
        loop {
            let next = (0..8)
                .filter(|&i| corners[i] == label)
                .filter(|&i| [1, 2, 4].iter().any(|bit| reached >> (i ^ bit) & 1 == 1))
                .fold(reached, |set, i| set | 1 << i);
            if next == reached {
                return (0..8).all(|i| corners[i] != label || reached >> i & 1 == 1);
            }
            reached = next;
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    const N: usize = 24;

    fn count(f: impl Fn([f64; 3]) -> f64) -> [Topology; 2] {
        let at =
            |p: [usize; 3], shift: f64| f(p.map(|c| c as f64 + shift - 0.5 * (N as f64 - 1.0)));
        let values: Vec<f64> = all([N; 3]).map(|p| at(p, 0.0)).collect();
        let lattice = Lattice {
            counts: [N; 3],
            values: &values,
            middle: &|p| at(p, 0.5),
        };
        [Cells::Cubes, Cells::Centred].map(|cells| lattice.topology(cells).unwrap())
    }

    fn norm(v: &[f64]) -> f64 {
        v.iter().map(|c| c * c).sum::<f64>().sqrt()
    }

    fn betti(components: i64, tunnels: i64, cavities: i64) -> [Topology; 2] {
        [Topology {
            components,
            tunnels,
            cavities,
        }; 2]
    }

    #[test]
    fn solids_with_known_topology() {
        assert_eq!(count(|p| 7.3 - norm(&p)), betti(1, 0, 0));
        let shell = |p: [f64; 3]| 2.1 - (norm(&p) - 7.0).abs();
        assert_eq!(count(shell), betti(1, 0, 1));
        let torus = |p: [f64; 3]| 2.2 - norm(&[norm(&p[..2]) - 6.5, p[2]]);
        assert_eq!(count(torus), betti(1, 1, 0));
        let in_shell = |p: [f64; 3]| shell(p).max(2.4 - norm(&p));
        assert_eq!(count(in_shell), betti(2, 0, 1));
        // A hollow torus: a torus of two tunnels around a cavity.
        let hollow = |p: [f64; 3]| 1.1 - (norm(&[norm(&p[..2]) - 6.5, p[2]]) - 3.0).abs();
        assert_eq!(count(hollow), betti(1, 2, 1));
    }

    /// Two corners of a cube that touch only across its middle: joined if the middle is inside.
    #[test]
    fn the_middle_decides_where_corners_do_not() {
        let values: Vec<f64> = all([4; 3])
            .map(|p| match p {
                [1, 1, 1] | [2, 2, 2] => 1.0,
                _ => -1.0,
            })
            .collect();
        for (middle, components) in [(0.5, 1), (-0.5, 2)] {
            let at = |p: [usize; 3]| if p == [1; 3] { middle } else { -1.0 };
            let lattice = Lattice {
                counts: [4; 3],
                values: &values,
                middle: &at,
            };
            for cells in [Cells::Cubes, Cells::Centred] {
                let found = lattice.topology(cells).unwrap();
                let expected = Topology {
                    components,
                    tunnels: 0,
                    cavities: 0,
                };
                assert_eq!(found, expected, "{cells:?}");
            }
        }
        // Across a face the saddle decides.
        for (low, components) in [(-0.5, 1), (-2.0, 2)] {
            let values: Vec<f64> = all([4; 3])
                .map(|p| match p {
                    [1, 1, 1] | [2, 2, 1] => 1.0,
                    _ => low,
                })
                .collect();
            let lattice = Lattice {
                counts: [4; 3],
                values: &values,
                middle: &|_| -1.0,
            };
            let found = lattice.topology(Cells::Cubes).unwrap();
            assert_eq!((found.components, found.tunnels), (components, 0));
        }
    }

    #[test]
    fn a_solid_at_the_box_is_refused() {
        let lattice = Lattice {
            counts: [3; 3],
            values: &[1.0; 27],
            middle: &|_| 1.0,
        };
        assert!(lattice.topology(Cells::Cubes).is_err());
    }

    #[test]
    fn simple_cubes_are_those_of_the_marching_table() {
        let simple = (0..256)
            .filter(|mask| is_simple(std::array::from_fn(|i| mask >> i & 1 == 1)))
            .count();
        // 2 uniform, 8 + 8 of one corner, 12 + 12 of an edge, 24 + 24 of three along a face, 6 faces,
        // 8 corners with their three neighbours, 24 chains of four that are no face.
        assert_eq!(simple, 128);
    }
}
