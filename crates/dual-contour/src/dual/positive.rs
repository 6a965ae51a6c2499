//! Points go to their place only as far as all tetrahedra stay positive.

use geom_core::Point3;
use geom_core::mesh::six_volume;
use rayon::prelude::*;

use super::Duals;
use super::room::{LEAST_VOLUME, farthest};
use crate::complex::{Cell, Complex};

impl Duals {
    /// Lets points go from their base to their place only as far as every umbrella tetrahedron (an edge
    /// and two consecutive cells) stays positive. No harm can come from leaves of one size, nor from a
    /// leaf beside a larger one that stands at its base. The tetrahedra of all others are gathered
    /// once; then the points are placed, twice, colour by colour: no two of a colour share one.
    pub(super) fn keep_positive(&mut self, complex: &Complex<'_>) {
        let harmful =
            |id: u32| complex.is_split(id) || complex.leaf(id).log > 0 && self.rank(id).is_some();
        let mut owners: Vec<u32> = (0..complex.tree.leaves.len() as u32)
            .into_par_iter()
            .with_min_len(4096)
            .filter(|&id| harmful(id))
            .flat_map_iter(|id| {
                // Off the box, of leaves of one size that around an edge emits whose corner begins it.
                let leaf = complex.leaf(id);
                let beyond = leaf.log == 0 && !complex.is_on_box(id);
                let low = leaf.origin();
                complex.tree.touching(id).filter(move |&other| {
                    let o = complex.leaf(other).origin();
                    !beyond || (0..3).all(|k| o[k] >= low[k])
                })
            })
            .collect();
        if owners.is_empty() {
            return;
        }
        owners.par_sort_unstable();
        owners.dedup();
        struct Tet {
            a: Point3,
            b: Point3,
            cells: [Cell; 2],
            least: f64,
        }
        let risky = |c: &Cell, d: &Cell| match (c, d) {
            (Cell::Leaf(i), Cell::Leaf(j)) => {
                let (p, q) = (complex.leaf(*i).log, complex.leaf(*j).log);
                p > q && self.rank(*i).is_some() || q > p && self.rank(*j).is_some()
            }
            (Cell::Ghost(..), _) | (_, Cell::Ghost(..)) => false,
            _ => true,
        };
        let tets: Vec<Tet> = owners
            .into_par_iter()
            .with_min_len(256)
            .flat_map_iter(|id| {
                let mut tets = Vec::new();
                complex.rings_of(
                    id,
                    |_, _| true,
                    |ring| {
                        let n = ring.cells.len();
                        for i in 0..if ring.open { n - 1 } else { n } {
                            let cells = [ring.cells[i], ring.cells[(i + 1) % n]];
                            if risky(&cells[0], &cells[1]) {
                                let a = complex.corner_position(ring.a.0);
                                let b = complex.corner_position(ring.b.0);
                                let [c, d] = [0, 1].map(|k| complex.base_position(&cells[k]));
                                tets.push(Tet {
                                    a,
                                    b,
                                    cells,
                                    least: LEAST_VOLUME * six_volume([a, b, c, d]),
                                });
                            }
                        }
                    },
                );
                tets
            })
            .collect();
        // Tetrahedra per moved point, points by colour.
        let mut around: Vec<(u16, u32, u32)> = tets
            .par_iter()
            .enumerate()
            .with_min_len(1024)
            .flat_map_iter(|(i, t)| {
                let moved = t
                    .cells
                    .iter()
                    .filter_map(|c| Some((colour(complex, c), self.moved(c)?)));
                moved.map(move |(colour, m)| (colour, m as u32, i as u32))
            })
            .collect();
        around.par_sort_unstable();
        struct Free<'a> {
            moved: usize,
            base: Point3,
            target: Point3,
            share: f64,
            tets: &'a [(u16, u32, u32)],
        }
        let mut points: Vec<Free<'_>> = around
            .chunk_by(|x, y| x.1 == y.1)
            .map(|group| {
                let moved = group[0].1 as usize;
                let of = |c: &&Cell| self.moved(c) == Some(moved);
                let cell = tets[group[0].2 as usize].cells.iter().find(of);
                Free {
                    moved,
                    base: complex.base_position(cell.expect("one of the two has moved")),
                    target: *self.at_mut(moved),
                    share: 0.0,
                    tets: group,
                }
            })
            .filter(|p| p.target != p.base)
            .collect();
        for p in &points {
            *self.at_mut(p.moved) = p.base;
        }
        for _ in 0..2 {
            for group in points.chunk_by_mut(|x, y| x.tets[0].0 == y.tets[0].0) {
                group.par_iter_mut().with_min_len(8).for_each(|p| {
                    if p.share == 1.0 {
                        return;
                    }
                    let ends = [&p.base, &p.target];
                    p.share = farthest(p.share, ends, p.tets.len(), |i, x| {
                        let tet = &tets[p.tets[i].2 as usize];
                        let [c, d] = [0, 1].map(|k| {
                            let cell = &tet.cells[k];
                            if self.moved(cell) == Some(p.moved) {
                                *x
                            } else {
                                self.position(complex, cell)
                            }
                        });
                        six_volume([tet.a, tet.b, c, d]) - tet.least
                    });
                });
                for p in group {
                    *self.at_mut(p.moved) = p.base + (p.target - p.base) * p.share;
                }
            }
        }
        self.held = points
            .iter()
            .filter(|p| p.share < 1.0)
            .map(|p| (p.moved, (1.0 - p.share) * (p.target - p.base).norm()))
            .collect();
        self.held.sort_unstable_by_key(|held| held.0);
    }
}

/// A number that two cells with a common edge share only if they are one: leaves by size and parity,
/// parts by the parity of their leaf, then their place in it.
fn colour(complex: &Complex<'_>, cell: &Cell) -> u16 {
    let of = |id: u32| {
        let leaf = complex.leaf(id);
        let parity = (0..3)
            .map(|k| (leaf.origin()[k] >> leaf.log & 1) << k)
            .sum::<i32>();
        (parity as u16, u16::from(leaf.log))
    };
    match *cell {
        Cell::Leaf(id) | Cell::Ghost(id, _) => {
            let (parity, log) = of(id);
            8 * log + parity
        }
        Cell::Part(k, part) => {
            let (parity, _) = of(complex.split_leaves[k as usize]);
            8 * 32 + 12 * parity + u16::from(part)
        }
    }
}
