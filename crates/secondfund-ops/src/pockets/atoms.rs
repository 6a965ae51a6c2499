//! The atoms that make pockets, in a frame of their own, sorted into cells.
//!
//! Everything that finds pockets asks the same two questions, which atoms are within a distance and how far the nearest
//! one is; cells answer them in the time of the atoms near by. The frame makes answers the same however the molecule
//! lies in its file.

use geom_core::compute::parallel;
use geom_core::nalgebra::{Matrix3, SymmetricEigen};
use geom_core::structure::{Element, ResidueKind};
use geom_core::{Aabb, Point3, Structure, Vector3};

use crate::Error;

/// Side of the cells, Å.
const CELL: f64 = 5.0;
/// How far coordinates may lie from the origin, Å: cells have numbers of 32 bits.
const FARTHEST: f64 = 1e7;
/// The largest radius of an atom, Å: a bead of a coarse-grained model has less. Space is asked for as far around all of them.
const LARGEST: f64 = 20.0;

/// The heavy atoms of polymers: no ligands, ions, waters, hydrogens.
#[derive(Clone, Debug)]
pub(crate) struct Atoms {
    /// The atom's number in the structure.
    pub(crate) index: Vec<u32>,
    /// In the molecule's own frame, Å.
    pub(crate) positions: Vec<Point3>,
    pub(crate) radii: Vec<f64>,
    pub(crate) chain: Vec<u32>,
    pub(crate) frame: Frame,
    /// The largest radius.
    pub(crate) largest: f64,
    cells: Cells,
}

/// The principal axes of a molecule: what is computed in them does not depend on how it lies in space.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Frame {
    center: Point3,
    /// Rows are the axes.
    axes: Matrix3<f64>,
}

impl Frame {
    /// Centred, along the axes of inertia, each towards the side of the longer tail (the sign of the third
    /// moment); right-handed.
    ///
    /// Where two moments of inertia are equal, or a third moment is zero, an axis is any of several: a symmetric body
    /// has no orientation to be found.
    fn of(points: &[Point3]) -> Self {
        let n = points.len() as f64;
        let mean = points.iter().map(|p| p.coords).sum::<Vector3>() / n;
        let spread = points.iter().fold(Matrix3::zeros(), |s, p| {
            let d = p.coords - mean;
            s + d * d.transpose()
        });
        let eigen = SymmetricEigen::new(spread);
        let mut order = [0, 1, 2];
        order.sort_by(|&a, &b| eigen.eigenvalues[b].total_cmp(&eigen.eigenvalues[a]));
        let axis = |k: usize| -> Vector3 {
            let v: Vector3 = eigen.eigenvectors.column(order[k]).into();
            let tail: f64 = points
                .iter()
                .map(|p| v.dot(&(p.coords - mean)).powi(3))
                .sum();
            if tail < 0.0 { -v } else { v }
        };
        let (x, y) = (axis(0), axis(1));
        let z = x.cross(&y);
        Self {
            center: Point3::from(mean),
            axes: Matrix3::from_rows(&[x.transpose(), y.transpose(), z.transpose()]),
        }
    }

    /// From the coordinates of the file to those of the frame, Å.
    pub(crate) fn enter(&self, p: &Point3) -> Point3 {
        Point3::from(self.axes * (p - self.center))
    }

    /// Back: the rows of a rotation are orthonormal, so that its transpose is its inverse.
    pub(crate) fn leave(&self, p: &Point3) -> Point3 {
        self.center + self.axes.transpose() * p.coords
    }
}

/// A cube of side [`CELL`] by its place, ordered by z, then y, then x.
type Cell = [i32; 3];

/// The cell of a point.
fn cell_of(p: &Point3) -> Cell {
    [2, 1, 0].map(|axis| (p[axis] / CELL).floor() as i32)
}

/// Points sorted into cubes, of which only those that hold some are kept: a stray atom far away costs nothing.
#[derive(Clone, Debug)]
struct Cells {
    occupied: Vec<Cell>,
    /// Where the members of each begin.
    starts: Vec<usize>,
    members: Vec<u32>,
}

impl Cells {
    fn of(points: &[Point3]) -> Self {
        let mut placed: Vec<(Cell, u32)> = points.iter().map(cell_of).zip(0..).collect();
        placed.sort_unstable();
        let runs = placed.chunk_by(|a, b| a.0 == b.0);
        let (occupied, sizes): (Vec<Cell>, Vec<u32>) =
            runs.map(|run| (run[0].0, run.len() as u32)).unzip();
        Self {
            occupied,
            starts: parallel::starts_of(&sizes),
            members: placed.into_iter().map(|p| p.1).collect(),
        }
    }

    /// Calls `f` with every member of the cells that a ball meets.
    /// Some of them lie outside of the ball: the caller measures. Members come by cell, and within one by number.
    fn near(&self, p: &Point3, radius: f64, mut f: impl FnMut(u32)) {
        let reach = Vector3::repeat(radius);
        let (low, high) = (cell_of(&(p - reach)), cell_of(&(p + reach)));
        for z in low[0]..=high[0] {
            for y in low[1]..=high[1] {
                let first = self.occupied.partition_point(|c| *c < [z, y, low[2]]);
                let row = &self.occupied[first..];
                let count = row.iter().take_while(|c| **c <= [z, y, high[2]]).count();
                let members = self.starts[first]..self.starts[first + count];
                self.members[members].iter().for_each(|&m| f(m));
            }
        }
    }
}

impl Atoms {
    /// In the order of chains, residues and atoms of the structure.
    ///
    /// # Errors
    /// [`Error::NoAtoms`] if no residue is a polymer's, or all their atoms are hydrogens; [`Error::BadAtom`].
    pub(crate) fn of(structure: &Structure) -> Result<Self, Error> {
        for (atom, a) in structure.atoms().iter().enumerate() {
            let numbers = [
                ("x", a.position.x, -FARTHEST..=FARTHEST),
                ("y", a.position.y, -FARTHEST..=FARTHEST),
                ("z", a.position.z, -FARTHEST..=FARTHEST),
                ("radius", a.radius, 0.0..=LARGEST),
            ];
            let wrong = numbers.into_iter().find(|(_, x, range)| !range.contains(x));
            if let Some((field, value, _)) = wrong {
                return Err(Error::BadAtom { atom, field, value });
            }
        }
        let mut chosen: Vec<(u32, u32)> = Vec::new();
        for chain in 0..structure.chains().len() {
            for residue in structure.chain_residues(chain) {
                if structure.residues()[residue].kind != ResidueKind::Polymer {
                    continue;
                }
                let heavy = |&a: &usize| structure.atoms()[a].element != Element::HYDROGEN;
                let atoms = structure.residue_atoms(residue).filter(heavy);
                chosen.extend(atoms.map(|a| (a as u32, chain as u32)));
            }
        }
        if chosen.is_empty() {
            return Err(Error::NoAtoms);
        }
        let all: Vec<Point3> = chosen
            .iter()
            .map(|&(a, _)| structure.atoms()[a as usize].position)
            .collect();
        let frame = Frame::of(&all);
        let positions: Vec<Point3> = all.iter().map(|p| frame.enter(p)).collect();
        let radii: Vec<f64> = chosen
            .iter()
            .map(|&(a, _)| structure.atoms()[a as usize].radius)
            .collect();
        Ok(Self {
            cells: Cells::of(&positions),
            largest: radii.iter().copied().fold(0.0, f64::max),
            radii,
            index: chosen.iter().map(|c| c.0).collect(),
            chain: chosen.iter().map(|c| c.1).collect(),
            positions,
            frame,
        })
    }

    /// The boxes, ordered and apart, that together hold all points within `reach` of an atom's surface.
    pub(crate) fn boxes_within(&self, reach: f64) -> Vec<Aabb> {
        let n = ((reach + self.largest) / CELL).ceil() as i32;
        let around = |c: &Cell| {
            let c = *c;
            let along = move |k: usize| c[k].saturating_sub(n)..=c[k].saturating_add(n);
            along(0).flat_map(move |z| along(1).flat_map(move |y| along(2).map(move |x| [z, y, x])))
        };
        let mut cells: Vec<Cell> = self.cells.occupied.iter().flat_map(around).collect();
        cells.sort_unstable();
        cells.dedup();
        let corner = |[z, y, x]: Cell, d: i32| {
            Point3::from([x, y, z].map(|c| (f64::from(c) + f64::from(d)) * CELL))
        };
        cells
            .into_iter()
            .map(|c| Aabb::new(corner(c, 0), corner(c, 1)))
            .collect()
    }

    /// Calls `f` with each atom within `radius` of `p` and its squared distance.
    /// In the order of the cells, the same in every run.
    pub(crate) fn within(&self, p: &Point3, radius: f64, mut f: impl FnMut(u32, f64)) {
        let squared = radius * radius;
        self.cells.near(p, radius, |a| {
            let d = (self.positions[a as usize] - p).norm_squared();
            if d <= squared {
                f(a, d);
            }
        });
    }

    /// The atoms within `radius` of `p`, of the chain that has most of them in full, of the others `foreign` each.
    /// `counts` is scratch.
    pub(crate) fn burial(
        &self,
        p: &Point3,
        radius: f64,
        foreign: f64,
        counts: &mut Vec<(u32, u32)>,
    ) -> f64 {
        counts.clear();
        self.within(p, radius, |a, _| {
            let chain = self.chain[a as usize];
            match counts.iter_mut().find(|c| c.0 == chain) {
                Some(count) => count.1 += 1,
                None => counts.push((chain, 1)),
            }
        });
        let most = counts.iter().map(|c| c.1).max().unwrap_or(0);
        let all: u32 = counts.iter().map(|c| c.1).sum();
        f64::from(most) + foreign * f64::from(all - most)
    }

    /// The distance from `p` to the nearest atom's surface, at most `reach`, and that atom.
    /// Negative within an atom. Of equally near atoms the one with the lower number.
    pub(crate) fn gap(&self, p: &Point3, reach: f64) -> Option<(f64, u32)> {
        let mut best: Option<(f64, u32)> = None;
        self.within(p, reach + self.largest, |a, d| {
            let gap = d.sqrt() - self.radii[a as usize];
            if gap <= reach && best.is_none_or(|b| gap < b.0 || (gap == b.0 && a < b.1)) {
                best = Some((gap, a));
            }
        });
        best
    }
}
