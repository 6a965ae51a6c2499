//! Points go to their place only as far as all edge tetrahedra stay positive.
//!
//! At their *base*, the middle of the cell, all points give tetrahedra of positive volume; at their *place* on the surface
//! some may be inverted, where large cells meet small ones. The volume of a tetrahedron is linear in each of its corners. So
//! along the straight way of one point from base to place, the others held, each volume changes sign once at most, and how far
//! the point may go is the least of such shares. Points are taken in colours in which no two share a tetrahedron, so that
//! those of one colour move at the same time and the result is the same for any number of threads.
//!
//! (Gauss–Seidel in colours: each group sees where the ones before have gone.) All points first go back to their bases,
//! where every volume is positive, and no step makes one negative; so the result is valid after any number of rounds,
//! and rounds only bring points nearer to their places.

use geom_core::Point3;
use geom_core::compute::parallel;
use geom_core::mesh::six_volume;
use rayon::prelude::*;

use super::Duals;
use super::room::{LEAST_VOLUME, ROUNDS, farthest};
use crate::complex::{Cell, Complex};
use crate::octree::along;

/// An edge and two consecutive cells around it, at least one of which moves.
/// The least volume is the share [`LEAST_VOLUME`] of that with both points at their bases.
struct EdgeTet {
    a: Point3,
    b: Point3,
    cells: [Cell; 2],
    /// Six times the least volume.
    least: f64,
}

/// A moved point at a tetrahedron. In order: by the colour of the point, then by its place among the moved ones.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct MovedCorner {
    colour: u16,
    moved: u32,
    tet: u32,
}

/// A point on its way from base to target.
struct Free<'a> {
    moved: usize,
    base: Point3,
    target: Point3,
    /// How far it has come: 0 at the base, 1 at the target.
    share: f64,
    tets: &'a [MovedCorner],
}

/// Where a point has stopped, and how far from its place.
#[derive(Clone, Copy, Debug)]
pub(super) struct Clamped {
    pub(super) moved: usize,
    pub(super) shortfall: f64,
}

impl Duals {
    /// Lets points go from their base to their place only as far as every edge tetrahedron (an edge and two
    /// consecutive cells) stays positive, and lists those that are clamped. The tetrahedra that could fail are
    /// gathered once; then the points are placed, twice, colour by colour: no two of a colour share one, so
    /// those of a colour move at once.
    pub(super) fn keep_positive(&mut self, complex: &Complex<'_>) {
        let owners = self.owners_at_risk(complex);
        if owners.is_empty() {
            return;
        }
        let tets = self.tets_at_risk(complex, &owners);
        let corners = self.moved_corners(complex, &tets);
        let mut points = self.free_points(complex, &tets, &corners);
        for p in &points {
            *self.at_mut(p.moved) = p.base;
        }
        for _ in 0..ROUNDS {
            for group in points.chunk_by_mut(|x, y| x.tets[0].colour == y.tets[0].colour) {
                parallel::for_each(group, |_, p| {
                    if p.share < 1.0 {
                        p.share = self.farthest_share(complex, &tets, p);
                    }
                });
                for p in group {
                    *self.at_mut(p.moved) = along(p.base, p.target, p.share);
                }
            }
        }
        self.clamped = points
            .iter()
            .filter(|p| p.share < 1.0)
            .map(|p| Clamped {
                moved: p.moved,
                shortfall: (1.0 - p.share) * (p.target - p.base).norm(),
            })
            .collect();
        self.clamped.sort_unstable_by_key(|clamped| clamped.moved);
    }

    /// The leaves whose edges may have a tetrahedron that fails. No harm can come from leaves of one size, whose
    /// points stay in convex cells that share a face, nor from a leaf beside a larger one that stands at its
    /// base: what is left are edges at cut leaves and at moved leaves larger than the finest.
    fn owners_at_risk(&self, complex: &Complex<'_>) -> Vec<u32> {
        let harmful = |id: &u32| {
            complex.is_split(*id) || complex.leaf(*id).log > 0 && self.rank(*id).is_some()
        };
        let mut owners: Vec<u32> = parallel::flat_map(complex.tree.leaves.len(), |id| {
            Some(id as u32).filter(harmful).into_iter().flat_map(|id| {
                // Off the box, of leaves of one size that around an edge emits whose corner begins it.
                let leaf = complex.leaf(id);
                let finest = leaf.log == 0 && !complex.is_on_box(id);
                let low = leaf.origin();
                complex.tree.touching(id).filter(move |&other| {
                    let o = complex.leaf(other).origin();
                    !finest || (0..3).all(|k| o[k] >= low[k])
                })
            })
        });
        owners.par_sort_unstable();
        owners.dedup();
        owners
    }

    /// Can the tetrahedron of an edge with two cells fail?
    /// Between leaves of one size it cannot, nor where the larger one stays in its middle; with a part it may. Ghosts
    /// stay in their face.
    fn is_risky(&self, complex: &Complex<'_>, c: &Cell, d: &Cell) -> bool {
        match (c, d) {
            (Cell::Leaf(i), Cell::Leaf(j)) => {
                let (p, q) = (complex.leaf(*i).log, complex.leaf(*j).log);
                p > q && self.rank(*i).is_some() || q > p && self.rank(*j).is_some()
            }
            (Cell::Ghost(..), _) | (_, Cell::Ghost(..)) => false,
            _ => true,
        }
    }

    /// The tetrahedra that may fail around the edges of some leaves.
    fn tets_at_risk(&self, complex: &Complex<'_>, owners: &[u32]) -> Vec<EdgeTet> {
        parallel::flat_map(owners.len(), |i| {
            let (id, mut tets) = (owners[i], Vec::new());
            complex.rings_of(
                id,
                |_, _| true,
                |ring| {
                    for cells in ring.neighbours() {
                        if self.is_risky(complex, &cells[0], &cells[1]) {
                            let a = complex.corner_position(ring.a.0);
                            let b = complex.corner_position(ring.b.0);
                            let [c, d] = [0, 1].map(|k| complex.base_position(&cells[k]));
                            tets.push(EdgeTet {
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
    }

    /// The moved points of all tetrahedra: those of one point together, points by colour.
    fn moved_corners(&self, complex: &Complex<'_>, tets: &[EdgeTet]) -> Vec<MovedCorner> {
        let mut corners: Vec<MovedCorner> = parallel::flat_map(tets.len(), |i| {
            tets[i].cells.iter().filter_map(move |cell| {
                Some(MovedCorner {
                    colour: colour(complex, cell),
                    moved: self.moved(cell)? as u32,
                    tet: i as u32,
                })
            })
        });
        corners.par_sort_unstable();
        corners
    }

    /// The points that move at all, with base and target.
    fn free_points<'a>(
        &self,
        complex: &Complex<'_>,
        tets: &[EdgeTet],
        corners: &'a [MovedCorner],
    ) -> Vec<Free<'a>> {
        corners
            .chunk_by(|x, y| x.moved == y.moved)
            .map(|group| {
                let moved = group[0].moved as usize;
                let of = |c: &&Cell| self.moved(c) == Some(moved);
                let cell = tets[group[0].tet as usize].cells.iter().find(of);
                Free {
                    moved,
                    base: complex.base_position(cell.expect("one of the two has moved")),
                    target: *self.at(moved),
                    share: 0.0,
                    tets: group,
                }
            })
            .filter(|p| p.target != p.base)
            .collect()
    }

    /// How far a point may go with all others where they are.
    fn farthest_share(&self, complex: &Complex<'_>, tets: &[EdgeTet], p: &Free<'_>) -> f64 {
        let ends = [&p.base, &p.target];
        farthest(p.share, ends, p.tets.len(), |i, x| {
            let tet = &tets[p.tets[i].tet as usize];
            let [c, d] = [0, 1].map(|k| {
                let cell = &tet.cells[k];
                if self.moved(cell) == Some(p.moved) {
                    *x
                } else {
                    self.position(complex, cell)
                }
            });
            six_volume([tet.a, tet.b, c, d]) - tet.least
        })
    }
}

/// A number that two cells with a common edge share only if they are one: leaves by size and parity,
/// parts by the parity of their leaf, then their place in it.
/// Leaves of one size that touch differ in the parity of a coordinate; those of two sizes in the size.
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
