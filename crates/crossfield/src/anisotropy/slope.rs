//! The function on the connected parts of a surface, and on what they are remeshed to.
//!
//! Field and map work on triangles that are not those of the caller: repaired, split into parts, remeshed finer or
//! coarser. The function stays where it was given, on the parts of the repaired surface, and is asked at the nearest
//! point whenever a mesh needs it; so it is interpolated once from where it is known, however often triangles change.

use geom_core::TriMesh;
use geom_core::options::require;
use geom_core::search::bvh::TriangleTree;
use geom_core::surface::laplace::{self, EdgeWeights};

use super::{Anisotropy, Function, Metric};
use crate::Error;
use crate::field::Frames;
use crate::guidance;

/// The function on one connected part.
pub(crate) struct Slope<'a> {
    /// The part, on which the values are known.
    mesh: &'a TriMesh,
    /// Its triangles.
    tree: TriangleTree,
    /// One per vertex of it.
    values: Vec<f64>,
    /// The largest |∇F| that counts here.
    steepest: f64,
    options: &'a Anisotropy,
}

/// The function on all parts of a surface. `whole` is the surface after repair, `split` its parts with the triangles of each.
///
/// # Errors
/// [`Error::Option`] for another number of values than vertices of `surface`, or a function that is constant on every
/// part; [`Error::Eigen`] if an eigenfunction cannot be found.
pub(crate) fn slopes<'a>(
    options: &'a Anisotropy,
    surface: &TriMesh,
    whole: &TriMesh,
    split: &'a [(TriMesh, Vec<u32>)],
) -> Result<Vec<Slope<'a>>, Error> {
    let parts: Vec<Vec<f64>> = match &options.function {
        Function::Mode(number) => split
            .iter()
            .map(|(mesh, _)| guidance::eigenfunction(mesh, *number))
            .collect::<Result<_, _>>()?,
        Function::Values(values) => {
            let count = values.len();
            require(
                count == surface.positions().len(),
                "anisotropy.function",
                count,
                "have one value per vertex of the surface",
            )?;
            let values = carried(&TriangleTree::new(surface)?, surface, values, whole)?;
            split
                .iter()
                .map(|(mesh, faces)| restricted(whole, &values, mesh, faces))
                .collect()
        }
    };
    // A value per vertex has one steepest place, eigenfunctions of parts have one each.
    let mut steepest = Vec::with_capacity(parts.len());
    for ((mesh, _), values) in split.iter().zip(&parts) {
        let gradient = laplace::gradient(mesh, values)?;
        steepest.push(super::steepest(mesh, &gradient));
    }
    let varies = parts.iter().any(|f| f.iter().any(|&x| x != f[0]));
    require(varies, "anisotropy.function", "constant", "vary")?;
    if matches!(options.function, Function::Values(_)) {
        let most = steepest.iter().copied().fold(0.0, f64::max);
        steepest.fill(most);
    }
    split
        .iter()
        .zip(parts.into_iter().zip(steepest))
        .map(|((mesh, _), (values, steepest))| {
            Ok(Slope {
                mesh,
                tree: TriangleTree::new(mesh)?,
                values,
                steepest,
                options,
            })
        })
        .collect()
}

impl Slope<'_> {
    /// The metric on the same surface with other triangles.
    /// `frames` are those of that mesh.
    pub(crate) fn metric(&self, mesh: &TriMesh, frames: &Frames) -> Result<Metric, Error> {
        let values = carried(&self.tree, self.mesh, &self.values, mesh)?;
        Metric::of(mesh, frames, &values, self.steepest, self.options)
    }

    /// The area on which so many squares of side 1 would lie as there are quads that are 1 long and follow the gradient, Å².
    /// The larger, the more quads of one long side: `Σ A / r`.
    pub(crate) fn stretched_area(&self) -> Result<f64, Error> {
        let frames = Frames::of(self.mesh, EdgeWeights::One)?;
        let metric = Metric::of(
            self.mesh,
            &frames,
            &self.values,
            self.steepest,
            self.options,
        )?;
        let areas = frames.areas().iter().enumerate();
        Ok(areas.map(|(f, a)| a * metric.aligned_density(f)).sum())
    }

    /// What was asked for.
    pub(crate) fn options(&self) -> &Anisotropy {
        self.options
    }
}

/// Values at the vertices of a mesh: those of the nearest points of the surface that has them.
///
/// The same mesh keeps its values digit by digit. Between vertices values are linear.
pub(crate) fn carried(
    tree: &TriangleTree,
    from: &TriMesh,
    values: &[f64],
    to: &TriMesh,
) -> Result<Vec<f64>, Error> {
    if from.positions() == to.positions() {
        return Ok(values.to_vec());
    }
    let closest = tree.closest_to_all(to.positions())?;
    let at = |triangle: u32, weights: [f64; 3]| {
        let corners = from.triangles()[triangle as usize];
        let terms = weights.iter().zip(corners);
        terms.map(|(w, v)| w * values[v as usize]).sum()
    };
    Ok(closest
        .iter()
        .map(|c| at(c.triangle, c.barycentric))
        .collect())
}

/// Values on a part, whose triangles are these of the whole.
fn restricted(whole: &TriMesh, values: &[f64], part: &TriMesh, faces: &[u32]) -> Vec<f64> {
    let mut own = vec![0.0; part.positions().len()];
    for (corners, &face) in part.triangles().iter().zip(faces) {
        let there = whole.triangles()[face as usize];
        for (&v, u) in corners.iter().zip(there) {
            own[v as usize] = values[u as usize];
        }
    }
    own
}
