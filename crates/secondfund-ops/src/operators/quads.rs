//! The matrices of a Catmull–Clark surface, quad by quad.

use geom_core::Point3;
use geom_core::surface::laplace::Mass;
use rayon::prelude::*;

use super::element::UnitScale;
use super::pattern::{Matrices, Pattern, components, packed};
use crate::catmull::{Patch, Surface, Table, folded_rows, jet};
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
        let skipped: usize = all.iter().map(|m| m.skipped).sum();
        let points: usize = self
            .surface
            .patches()
            .iter()
            .map(|p| self.tables.of_corner(p.corner).weights.len())
            .sum();
        if 100 * skipped > points {
            let quad = all.iter().position(|m| m.skipped > 0).unwrap_or(0);
            return Err(Error::DegeneratePatch { quad, skipped });
        }
        match all
            .iter()
            .position(|m| m.stiffness.iter().any(|k| !k.is_finite()))
        {
            Some(element) => Err(Error::Flat { element }),
            None => Ok(()),
        }
    }

    fn matrix(&self, patch: &Patch, table: &Table) -> QuadMatrix {
        let m = patch.ids.len();
        let mut out = QuadMatrix {
            stiffness: vec![0.0; m * (m + 1) / 2],
            mass: vec![0.0; m * (m + 1) / 2],
            sums: [vec![0.0; m], vec![0.0; m], vec![0.0; m]],
            skipped: 0,
        };
        let points = self.surface.points_of(patch, &self.positions);
        for q in 0..table.weights.len() {
            let jet = jet(table.point(q), &points);
            let area = jet.area_normal().norm();
            // NaN, too.
            if area.is_nan() || area <= self.least {
                out.skipped += 1;
                continue;
            }
            let rows = folded_rows(patch, table, q);
            let (values, along, across) = (&rows[..m], &rows[m..2 * m], &rows[2 * m..3 * m]);
            let factor = match self.factors {
                [] => 1.0,
                f => values
                    .iter()
                    .zip(&patch.ids)
                    .map(|(n, &v)| n * f[v as usize])
                    .sum(),
            };
            let forms = jet.forms();
            let weight = table.weights[q] * area;
            let a = self.conductor.in_coordinates(&forms, factor) * weight;
            for i in 0..m {
                let flux = [
                    a.xx * along[i] + a.xy * across[i],
                    a.xy * along[i] + a.yy * across[i],
                ];
                let start = packed(m, i, i);
                let slots = start..start + m - i;
                for (l, slot) in out.stiffness[slots.clone()].iter_mut().enumerate() {
                    *slot += flux[0] * along[i + l] + flux[1] * across[i + l];
                }
                let value = weight * values[i];
                for (l, slot) in out.mass[slots].iter_mut().enumerate() {
                    *slot += value * values[i + l];
                }
                out.sums[0][i] += value;
                out.sums[1][i] += value * forms.mean();
                out.sums[2][i] += value * forms.gaussian();
            }
        }
        out
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
    let pattern = Pattern::of(vertices, surface.patches())?;
    let joined = |part: fn(&QuadMatrix) -> &Vec<f64>| -> Vec<f64> {
        all.iter().flat_map(part).copied().collect()
    };
    let [areas, mut mean, mut gauss] = vertex_sums(vertices, surface, &all);
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
        components: components(vertices, surface.control().quads()),
        scale: scale.length,
        skipped: all.iter().map(|m| m.skipped).sum(),
    })
}

/// The sums of the quads at the vertices, in the order of the quads.
pub(crate) fn vertex_sums(vertices: usize, surface: &Surface, all: &[QuadMatrix]) -> [Vec<f64>; 3] {
    let mut out = [
        vec![0.0; vertices],
        vec![0.0; vertices],
        vec![0.0; vertices],
    ];
    for (patch, matrix) in surface.patches().iter().zip(all) {
        for (out, sums) in out.iter_mut().zip(&matrix.sums) {
            for (&v, sum) in patch.ids.iter().zip(sums) {
                out[v as usize] += sum;
            }
        }
    }
    out
}
