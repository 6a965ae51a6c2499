//! The matrices of a Catmull–Clark surface, quad by quad.

use geom_core::Point3;
use geom_core::surface::laplace::Mass;
use rayon::prelude::*;

use super::pattern::{Matrices, Pattern, components, packed};
use super::scale::UnitScale;
use crate::catmull::{Jet, Patch, Surface, Table, folded_rows, jet};
use crate::forms::Conductor;
use crate::{Error, SpectrumOptions};

/// What a quad adds.
pub(crate) struct QuadMatrix {
    /// Packed upper half of `∫ Nᵢ_a A^{ab} Nⱼ_b dA`.
    pub(crate) stiffness: Vec<f64>,
    /// Packed upper half of `∫ Nᵢ Nⱼ dA`.
    pub(crate) mass: Vec<f64>,
    /// `∫ Nᵢ dA`, `∫ Nᵢ H dA`, `∫ Nᵢ K dA`.
    pub(crate) sums: [Vec<f64>; 3],
    /// Points without area.
    pub(crate) skipped: usize,
}

/// Quads with the tables of their points, in unit scale.
pub(crate) struct Quads<'a> {
    pub(crate) surface: &'a Surface,
    pub(crate) positions: Vec<Point3>,
    pub(crate) factors: &'a [f64],
    pub(crate) conductor: Conductor,
    /// Area elements below this count as none.
    least: f64,
    tables: crate::catmull::Tables,
}

impl<'a> Quads<'a> {
    pub(crate) fn of(
        surface: &'a Surface,
        scale: &UnitScale,
        conductor: Conductor,
        factors: &'a [f64],
        quadrature: crate::options::Quadrature,
    ) -> Self {
        let control = surface.control();
        let mean =
            control.area() / (scale.length * scale.length * control.quads().len().max(1) as f64);
        Self {
            surface,
            positions: control.positions().iter().map(|p| scale.apply(p)).collect(),
            factors,
            conductor,
            least: 1e-9 * mean,
            tables: surface.tables(quadrature),
        }
    }

    /// The matrices of all quads.
    pub(crate) fn matrices(&self) -> Result<Vec<QuadMatrix>, Error> {
        let all: Vec<QuadMatrix> = self
            .surface
            .patches()
            .par_iter()
            .map(|patch| self.matrix(patch, self.tables.of_corner(patch.corner)))
            .collect();
        self.check(&all)?;
        Ok(all)
    }

    fn check(&self, all: &[QuadMatrix]) -> Result<(), Error> {
        check(all, self.points())
    }

    /// The number of points of the quadrature.
    fn points(&self) -> usize {
        let patches = self.surface.patches().iter();
        patches
            .map(|p| self.tables.of_corner(p.corner).weights.len())
            .sum()
    }

    fn matrix(&self, patch: &Patch, table: &Table) -> QuadMatrix {
        let mut out = QuadMatrix::empty(patch.ids.len());
        let points = self.surface.points_of(patch, &self.positions);
        for q in 0..table.weights.len() {
            let jet = jet(table.point(q), &points);
            let rows = folded_rows(patch, table, q);
            let point = (&jet, table.weights[q]);
            let operator = (&self.conductor, self.factors);
            out.add(&rows, &patch.ids, point, operator, self.least);
        }
        out
    }
}

fn check(all: &[QuadMatrix], points: usize) -> Result<(), Error> {
    let skipped: usize = all.iter().map(|m| m.skipped).sum();
    if 100 * skipped > points {
        let quad = all.iter().position(|m| m.skipped > 0).unwrap_or(0);
        return Err(Error::DegeneratePatch { quad, skipped });
    }
    let infinite = |m: &QuadMatrix| m.stiffness.iter().any(|k| !k.is_finite());
    match all.iter().position(infinite) {
        Some(element) => Err(Error::Flat { element }),
        None => Ok(()),
    }
}

impl QuadMatrix {
    /// Of no points yet, for this many degrees of freedom.
    pub(crate) fn empty(m: usize) -> Self {
        Self {
            stiffness: vec![0.0; m * (m + 1) / 2],
            mass: vec![0.0; m * (m + 1) / 2],
            sums: [vec![0.0; m], vec![0.0; m], vec![0.0; m]],
            skipped: 0,
        }
    }

    /// Adds a point of the quadrature: the rows of the basis, the degrees of freedom that they belong to, the surface
    /// there with the point's weight, the operator with the values of its weight's fields. Area elements of `least`
    /// and below count as none.
    pub(crate) fn add(
        &mut self,
        rows: &[f64],
        ids: &[u32],
        (jet, weight): (&Jet, f64),
        (conductor, factors): (&Conductor, &[f64]),
        least: f64,
    ) {
        let m = ids.len();
        let area = jet.area_normal().norm();
        // NaN, too.
        if area.is_nan() || area <= least {
            self.skipped += 1;
            return;
        }
        let (values, along, across) = (&rows[..m], &rows[m..2 * m], &rows[2 * m..3 * m]);
        let factor = match factors {
            [] => 1.0,
            f => values
                .iter()
                .zip(ids)
                .map(|(n, &v)| n * f[v as usize])
                .sum(),
        };
        let forms = jet.forms();
        let weight = weight * area;
        let a = conductor.in_coordinates(&forms, factor) * weight;
        for i in 0..m {
            let flux = [
                a.xx * along[i] + a.xy * across[i],
                a.xy * along[i] + a.yy * across[i],
            ];
            let start = packed(m, i, i);
            let slots = start..start + m - i;
            for (l, slot) in self.stiffness[slots.clone()].iter_mut().enumerate() {
                *slot += flux[0] * along[i + l] + flux[1] * across[i + l];
            }
            let value = weight * values[i];
            for (l, slot) in self.mass[slots].iter_mut().enumerate() {
                *slot += value * values[i + l];
            }
            self.sums[0][i] += value;
            self.sums[1][i] += value * forms.mean();
            self.sums[2][i] += value * forms.gaussian();
        }
    }
}

/// The matrices of an operator on a surface.
pub(crate) fn matrices(
    surface: &Surface,
    conductor: &Conductor,
    factors: &[f64],
    options: &SpectrumOptions,
) -> Result<Matrices, Error> {
    let vertices = surface.control().positions().len();
    let scale = UnitScale::of(&surface.limit_positions())?;
    let quads = Quads::of(surface, &scale, *conductor, factors, options.quadrature);
    let all = quads.matrices()?;
    let components = components(vertices, surface.control().quads());
    let known = (quads.points(), scale.length, components);
    gathered(vertices, surface.patches(), &all, known)
}

/// The sums of elements, from the number of their points, the length of the unit and the component of each degree of freedom.
///
/// # Errors
/// [`Error::DegeneratePatch`], [`Error::Flat`].
pub(crate) fn gathered<E: AsRef<[u32]> + Sync>(
    dofs: usize,
    elements: &[E],
    all: &[QuadMatrix],
    (points, scale, components): (usize, f64, Vec<u32>),
) -> Result<Matrices, Error> {
    check(all, points)?;
    let pattern = Pattern::of(dofs, elements)?;
    let joined = |part: fn(&QuadMatrix) -> &Vec<f64>| -> Vec<f64> {
        all.iter().flat_map(part).copied().collect()
    };
    // In the order of the elements.
    let mut sums = [vec![0.0; dofs], vec![0.0; dofs], vec![0.0; dofs]];
    for (element, matrix) in elements.iter().zip(all) {
        for (out, of_element) in sums.iter_mut().zip(&matrix.sums) {
            for (&v, sum) in element.as_ref().iter().zip(of_element) {
                out[v as usize] += sum;
            }
        }
    }
    let [areas, mut mean, mut gauss] = sums;
    for (v, &area) in areas.iter().enumerate() {
        if area > 0.0 {
            mean[v] /= area;
            gauss[v] /= area;
        }
    }
    Ok(Matrices {
        stiffness: pattern.sum(&joined(|m| &m.stiffness)),
        mass: Mass::Consistent(pattern.sum(&joined(|m| &m.mass))),
        areas,
        mean,
        gauss,
        components,
        scale,
        skipped: all.iter().map(|m| m.skipped).sum(),
    })
}
