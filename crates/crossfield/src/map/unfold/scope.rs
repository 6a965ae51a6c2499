//! Parts of a map that move while the rest stays.

use geom_core::algebra::{Cholesky, SparseMatrix, Symbolic};

use crate::Error;
use crate::map::system::System;

/// Unknowns that move, and the triangles that move with them.
pub(crate) struct Scope {
    /// The unknowns, ascending.
    pub(super) unknowns: Vec<usize>,
    /// Are these all unknowns, integers as well? Then sums of integers follow.
    pub(super) moves_integers: bool,
    /// The triangles, ascending.
    pub(super) faces: Vec<usize>,
    /// The copies of vertices at their corners, ascending.
    pub(super) copies: Vec<u32>,
    /// Per triangle, which of these its corners are.
    pub(super) corners: Vec<[u32; 3]>,
}

impl Scope {
    /// All real unknowns, or all, integers as well.
    pub(super) fn whole(system: &System<'_>, integers: bool) -> Self {
        let seams = system.seams;
        let unknowns = if integers {
            seams.unknowns()
        } else {
            seams.reals
        };
        let copies = system.cut.copy.chunks_exact(3);
        Self {
            unknowns: (0..unknowns).collect(),
            moves_integers: integers,
            faces: (0..system.charts.len()).collect(),
            copies: (0..seams.copies() as u32).collect(),
            corners: copies.map(|c| [c[0], c[1], c[2]]).collect(),
        }
    }

    /// The real unknowns of some copies of vertices.
    pub(super) fn of_copies(system: &System<'_>, is_wanted: impl Fn(u32) -> bool) -> Self {
        let (cut, seams) = (system.cut, system.seams);
        let reals = |copy: u32| {
            let rows = [0, 1].into_iter().flat_map(move |c| seams.row(copy, c));
            rows.map(|(k, _)| k).filter(|&k| k < seams.reals)
        };
        let all = 0..seams.copies() as u32;
        let mut moves = vec![false; seams.reals];
        for copy in all.clone().filter(|&c| is_wanted(c)) {
            reals(copy).for_each(|k| moves[k] = true);
        }
        // A coordinate may move with that of another vertex.
        let is_moved: Vec<bool> = all.map(|c| reals(c).any(|k| moves[k])).collect();
        let of = |f: usize| [0, 1, 2].map(|k| cut.copy[3 * f + k]);
        let faces =
            (0..system.charts.len()).filter(|&f| of(f).iter().any(|&c| is_moved[c as usize]));
        let faces: Vec<usize> = faces.collect();
        let mut copies: Vec<u32> = faces.iter().flat_map(|&f| of(f)).collect();
        copies.sort_unstable();
        copies.dedup();
        let place = |c: u32| copies.partition_point(|&d| d < c) as u32;
        Self {
            corners: faces.iter().map(|&f| of(f).map(place)).collect(),
            unknowns: (0..seams.reals).filter(|&k| moves[k]).collect(),
            moves_integers: false,
            faces,
            copies,
        }
    }

    /// Per value, of so many, its place among those that move: unknowns, and their sums after them.
    pub(super) fn places(&self, values: usize) -> Vec<Option<u32>> {
        if self.moves_integers {
            return (0..values as u32).map(Some).collect();
        }
        let mut places = vec![None; values];
        for (place, &k) in (0..).zip(&self.unknowns) {
            places[k] = Some(place);
        }
        places
    }

    /// Its unknowns among all values.
    pub(super) fn of(&self, w: &[f64]) -> Vec<f64> {
        self.unknowns.iter().map(|&k| w[k]).collect()
    }

    /// Puts its unknowns among all values.
    pub(super) fn put(&self, x: &[f64], w: &mut [f64]) {
        for (&k, &x) in self.unknowns.iter().zip(x) {
            w[k] = x;
        }
    }

    /// Moves the unknowns to the minimum of the quadratic energy (Eq. 4.10) with all others held; `factor` is that of its matrix.
    pub(super) fn relax(
        &self,
        system: &System<'_>,
        factor: &Cholesky,
        w: &mut [f64],
    ) -> Result<(), Error> {
        let places = self.places(w.len());
        let mut slope = vec![0.0; self.unknowns.len()];
        for &f in &self.faces {
            let (chart, copies) = (
                &system.charts[f],
                [0, 1, 2].map(|k| system.cut.copy[3 * f + k]),
            );
            let j = chart.jacobian(&copies.map(|copy| system.seams.copy(w, copy)));
            let off = [[j[0][0] - 1.0, j[0][1]], [j[1][0], j[1][1] - 1.0]];
            for (component, along) in [chart.along_u, chart.along_v].iter().enumerate() {
                for (&copy, hat) in copies.iter().zip(along) {
                    let pull =
                        chart.area * (off[component][0] * hat[0] + off[component][1] * hat[1]);
                    for (k, p) in system.seams.row(copy, component) {
                        if let Some(place) = places[k] {
                            slope[place as usize] += f64::from(p) * pull;
                        }
                    }
                }
            }
        }
        factor.solve_in_place(&mut slope, 1)?;
        for (&k, step) in self.unknowns.iter().zip(&slope) {
            w[k] -= step;
        }
        Ok(())
    }

    /// The matrix of the quadratic energy (Eq. 4.10) over the unknowns, factored; `None` if none moves.
    pub(super) fn factored(&self, system: &System<'_>) -> Result<Option<Cholesky>, Error> {
        let count = self.unknowns.len();
        if count == 0 {
            return Ok(None);
        }
        let places = self.places(system.seams.values());
        let mut entries = Vec::new();
        for &f in &self.faces {
            system.stiffness(f, |k| places[k], &mut entries);
        }
        let matrix = SparseMatrix::from_triplets(count, count, &entries)?;
        Ok(Some(Symbolic::of(&matrix)?.factor(&matrix)?))
    }
}
