//! The matrices of a Catmull–Clark surface, quad by quad.

use geom_core::compute::BackendError;
use geom_core::surface::laplace::Mass;
use geom_core::{Point3, Vector3};

use super::pattern::{Matrices, Pattern, components, packed};
use super::scale::UnitScale;
use crate::backend::{On, PatchMatrices, PatchTask};
use crate::catmull::{Corner, Patch, Surface, Tables};
use crate::forms::Conductor;
use crate::options::Quadrature;
use crate::{Error, SpectrumOptions};

/// The quads of a surface with the tables of their points, those that share a table together: the order of whatever is
/// computed quad by quad.
pub(crate) struct Quads {
    /// Quads of one table, and whether ghosts have to be folded back.
    groups: Vec<(Corner, bool, Vec<u32>)>,
    tables: Tables,
}

/// What is integrated over quads, in unit scale.
pub(crate) struct Integrand<'a> {
    pub(crate) positions: &'a [Point3],
    /// The value of the weight's fields per vertex; empty for 1 everywhere.
    pub(crate) factors: &'a [f64],
    pub(crate) conductor: Conductor,
    /// Is the mass wanted?
    pub(crate) mass: bool,
}

impl Quads {
    pub(crate) fn of(surface: &Surface, quadrature: Quadrature) -> Self {
        let kind = |q: &u32| {
            let patch = &surface.patches()[*q as usize];
            (patch.corner, patch.fold.is_some())
        };
        let mut order: Vec<u32> = (0..surface.patches().len() as u32).collect();
        order.sort_by_key(kind);
        let groups = order.chunk_by(|a, b| kind(a) == kind(b)).map(|quads| {
            let (corner, folded) = kind(&quads[0]);
            (corner, folded, quads.to_vec())
        });
        Self {
            groups: groups.collect(),
            tables: surface.tables(quadrature),
        }
    }

    /// The quads in this order.
    pub(crate) fn order(&self) -> impl Iterator<Item = u32> + '_ {
        self.groups.iter().flat_map(|(_, _, quads)| quads).copied()
    }

    /// The degrees of freedom of each quad, in this order.
    pub(crate) fn elements<'a>(&self, surface: &'a Surface) -> Vec<&'a [u32]> {
        let patches = surface.patches();
        self.order()
            .map(|q| patches[q as usize].ids.as_slice())
            .collect()
    }

    /// The number of points of the quadrature.
    fn points(&self) -> usize {
        let of_group = |(corner, _, quads): &(Corner, bool, Vec<u32>)| {
            self.tables.of_corner(*corner).weights.len() * quads.len()
        };
        self.groups.iter().map(of_group).sum()
    }

    /// Runs a kernel on the quads of each table, and what it gives through `gather`.
    fn each<T>(
        &self,
        surface: &Surface,
        integrand: &Integrand<'_>,
        kernel: impl Fn(&PatchTask<'_>) -> Result<T, Error>,
        mut gather: impl FnMut(T, usize, &mut dyn Iterator<Item = &Patch>, bool),
    ) -> Result<(), Error> {
        let least = least_area(surface, integrand.positions);
        for (corner, folded, quads) in &self.groups {
            let table = self.tables.of_corner(*corner);
            let mut patches = quads.iter().map(|&q| &surface.patches()[q as usize]);
            let mut points = Vec::with_capacity(quads.len() * table.ids);
            for patch in patches.clone() {
                if *folded {
                    points.extend(surface.points_of(patch, integrand.positions));
                } else {
                    let ids = patch.ids.iter();
                    points.extend(ids.map(|&v| integrand.positions[v as usize]));
                }
            }
            let factors: Vec<f64> = match integrand.factors {
                [] => Vec::new(),
                f => patches.clone().flat_map(|p| p.values_of(f)).collect(),
            };
            let task = PatchTask {
                functions: table.ids,
                weights: &table.weights,
                basis: &table.basis,
                points: &points,
                factors: &factors,
                conductor: integrand.conductor,
                least,
                mass: integrand.mass,
            };
            gather(kernel(&task)?, table.ids, &mut patches, *folded);
        }
        Ok(())
    }

    /// The matrices of all quads.
    ///
    /// # Errors
    /// [`Error::DegeneratePatch`], [`Error::Flat`], what the backend refuses.
    pub(crate) fn matrices(
        &self,
        surface: &Surface,
        integrand: &Integrand<'_>,
        run: On<'_>,
    ) -> Result<PatchMatrices, Error> {
        let mut all = PatchMatrices::default();
        let kernel = |task: &PatchTask<'_>| {
            let mut out = PatchMatrices::default();
            run.backend.patch_matrices(task, &mut out)?;
            let (found, of) = (out.skipped.len(), task.patches());
            BackendError::unless(found == of, &run.backend.name(), || {
                format!("matrices of {found} patches of {of}")
            })?;
            Ok(out)
        };
        self.each(surface, integrand, kernel, |out, n, patches, folded| {
            if !folded {
                return all.append(out);
            }
            for (k, patch) in patches.enumerate() {
                all.append(folded_matrices(&out, n, k, patch));
            }
        })?;
        let order: Vec<u32> = self.order().collect();
        check(&all, self.points(), &self.elements(surface), |e| {
            order[e] as usize
        })?;
        Ok(all)
    }

    /// The stiffness applied to the surface itself, per vertex.
    ///
    /// # Errors
    /// What the backend refuses.
    pub(crate) fn forces(
        &self,
        surface: &Surface,
        integrand: &Integrand<'_>,
        run: On<'_>,
    ) -> Result<Vec<Vector3>, Error> {
        let mut all = vec![Vector3::zeros(); integrand.positions.len()];
        let kernel = |task: &PatchTask<'_>| {
            let mut out = Vec::new();
            run.backend.patch_forces(task, &mut out)?;
            let (found, of) = (out.len(), task.points.len());
            BackendError::unless(found == of, &run.backend.name(), || {
                format!("{found} forces on {of} points")
            })?;
            Ok(out)
        };
        self.each(surface, integrand, kernel, |out, n, patches, _| {
            for (forces, patch) in out.chunks(n).zip(patches) {
                patch.give(forces, &mut all);
            }
        })?;
        Ok(all)
    }
}

/// Area elements below this count as none.
fn least_area(surface: &Surface, positions: &[Point3]) -> f64 {
    let quads = surface.control().quads();
    let corners = |q: &[u32; 4]| q.map(|v| positions[v as usize]);
    let area = |q: &[u32; 4]| {
        let [a, b, c, d] = corners(q);
        0.5 * (c - a).cross(&(d - b)).norm()
    };
    1e-9 * quads.iter().map(area).sum::<f64>() / quads.len().max(1) as f64
}

/// The matrices of patch `k` of a group with `n` points each, by the vertices instead of the points: `Fᵀ K F`.
fn folded_matrices(all: &PatchMatrices, n: usize, k: usize, patch: &Patch) -> PatchMatrices {
    let m = patch.ids.len();
    let fold = patch.fold.as_deref().unwrap_or_default();
    let size = n * (n + 1) / 2;
    let matrix = |values: &[f64]| {
        if values.is_empty() {
            return Vec::new();
        }
        let values = &values[k * size..(k + 1) * size];
        let mut out = vec![0.0; m * (m + 1) / 2];
        let mut row = vec![0.0; m];
        for i in 0..n {
            // Row i of K F.
            row.fill(0.0);
            for (j, fold) in fold.chunks(m).enumerate() {
                let value = values[packed(n, i, j)];
                row.iter_mut().zip(fold).for_each(|(r, f)| *r += value * f);
            }
            for (a, weight) in fold[i * m..(i + 1) * m].iter().enumerate() {
                let start = packed(m, a, a);
                let slots = out[start..start + m - a].iter_mut();
                slots.zip(&row[a..]).for_each(|(o, r)| *o += weight * r);
            }
        }
        out
    };
    let mut sums = vec![[0.0; 3]; m];
    for (of_point, fold) in all.sums[k * n..(k + 1) * n].iter().zip(fold.chunks(m)) {
        for (sums, weight) in sums.iter_mut().zip(fold) {
            (0..3).for_each(|c| sums[c] += weight * of_point[c]);
        }
    }
    PatchMatrices {
        stiffness: matrix(&all.stiffness),
        mass: matrix(&all.mass),
        sums,
        skipped: vec![all.skipped[k]],
    }
}

/// Refuses elements without area: more than one point of a hundred of `points`, or entries that are not finite. `name` is
/// the number of an element for the caller.
fn check<E: AsRef<[u32]>>(
    all: &PatchMatrices,
    points: usize,
    elements: &[E],
    name: impl Fn(usize) -> usize,
) -> Result<(), Error> {
    let skipped: usize = all.skipped.iter().map(|&s| s as usize).sum();
    if 100 * skipped > points {
        let first = all.skipped.iter().position(|&s| s > 0).unwrap_or(0);
        let quad = name(first);
        return Err(Error::DegeneratePatch { quad, skipped });
    }
    let mut rest = &all.stiffness[..];
    for (element, ids) in elements.iter().enumerate() {
        let m = ids.as_ref().len();
        let (own, others) = rest.split_at(m * (m + 1) / 2);
        if own.iter().any(|k| !k.is_finite()) {
            return Err(Error::Flat {
                element: name(element),
            });
        }
        rest = others;
    }
    Ok(())
}

/// The matrices of an operator on a surface.
pub(crate) fn matrices(
    surface: &Surface,
    conductor: &Conductor,
    factors: &[f64],
    options: &SpectrumOptions,
    run: On<'_>,
) -> Result<Matrices, Error> {
    let control = surface.control();
    let vertices = control.positions().len();
    let scale = UnitScale::of(&surface.limit_positions())?;
    let positions: Vec<Point3> = control.positions().iter().map(|p| scale.apply(p)).collect();
    let quads = Quads::of(surface, options.quadrature);
    let integrand = Integrand {
        positions: &positions,
        factors,
        conductor: *conductor,
        mass: true,
    };
    let all = quads.matrices(surface, &integrand, run)?;
    let components = components(vertices, control.quads());
    let elements = quads.elements(surface);
    gathered(vertices, &elements, &all, (scale.length, components))
}

/// The sums of elements, from the length of the unit and the component of each degree of freedom.
pub(crate) fn gathered<E: AsRef<[u32]> + Sync>(
    dofs: usize,
    elements: &[E],
    all: &PatchMatrices,
    (scale, components): (f64, Vec<u32>),
) -> Result<Matrices, Error> {
    let pattern = Pattern::of(dofs, elements)?;
    let mut sums = vec![[0.0; 3]; dofs];
    let ids = elements.iter().flat_map(|e| e.as_ref());
    for (&v, of_element) in ids.zip(&all.sums) {
        (0..3).for_each(|c| sums[v as usize][c] += of_element[c]);
    }
    let mean_of = |&[area, sum, _]: &[f64; 3]| if area > 0.0 { sum / area } else { sum };
    let gauss_of = |&[area, _, sum]: &[f64; 3]| if area > 0.0 { sum / area } else { sum };
    Ok(Matrices {
        stiffness: pattern.sum(&all.stiffness),
        mass: Mass::Consistent(pattern.sum(&all.mass)),
        areas: sums.iter().map(|s| s[0]).collect(),
        mean: sums.iter().map(mean_of).collect(),
        gauss: sums.iter().map(gauss_of).collect(),
        components,
        scale,
        skipped: all.skipped.iter().map(|&s| s as usize).sum(),
    })
}

/// Checked matrices of elements that each have tables of their own, `points` points in all.
pub(crate) fn joined<E: AsRef<[u32]>>(
    parts: Vec<PatchMatrices>,
    points: usize,
    elements: &[E],
) -> Result<PatchMatrices, Error> {
    let mut all = PatchMatrices::default();
    parts.into_iter().for_each(|part| all.append(part));
    check(&all, points, elements, |e| e)?;
    Ok(all)
}
