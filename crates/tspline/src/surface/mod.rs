//! Spline surfaces on T-meshes.
//!
//! - [`Extraction`]: a [`Basis`] as Bézier coefficients; nothing else sees which basis it is
//! - [`suitable`](mod@suitable): T-meshes on which T-splines need no division
//! - [`Surface`]: control points, their Bézier patches, evaluation
//! - [`seams`]: where patches meet, [`tessellate`](mod@tessellate): triangles without gaps
//! - [`inverse`]: the nearest point of a surface, by its parameters
//! - [`fit`](mod@fit) to another surface, [`errors`]: how far both are apart, [`adapt`]: finer where that is too far

pub mod adapt;
pub(crate) mod basis;
pub mod bezier;
pub mod errors;
pub mod fit;
pub mod inverse;
pub mod seams;
pub mod tessellate;

pub(crate) use basis::Local;
pub use basis::{Basis, Extraction, POINTS, Patch, bezier_coefficients, suitable};
pub use bezier::{Jet, PatchPoints, Sample};

use geom_core::{Point3, Run};

use crate::backend::{On, PointsTask, SamplesTask, SplineBackend};
use crate::{Error, TMesh, TMeshOptions};

/// A spline surface: a T-mesh, the functions of a basis on it, and a control point for each.
///
/// ```
/// use tspline::geom_core::{Cpu, Run, mesh::shapes};
/// use tspline::{Basis, Surface, TMesh, TMeshOptions};
/// let quads = shapes::quad_sphere(1.0, 8);
/// let mesh = TMesh::build(&quads, &vec![0; quads.quads().len()], &TMeshOptions::default())?;
/// let surface = Surface::new(mesh, Basis::default(), Run::on(&Cpu))?;
/// let [mean, gauss] = surface.evaluate(27, [0.5, 0.5]).curvatures().expect("regular");
/// assert!((mean - 1.0).abs() < 0.1 && (gauss - 1.0).abs() < 0.2);
/// # Ok::<(), tspline::Error>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Surface {
    mesh: TMesh,
    basis: Basis,
    extraction: Extraction,
    controls: Vec<Point3>,
    points: Vec<PatchPoints>,
}

impl Surface {
    /// The surface of a basis on a T-mesh whose control points are the vertices: near them, but inside of what bulges.
    /// [`fit`](fit::fit) brings it to where it belongs.
    ///
    /// # Errors
    /// As of [`Extraction::of`].
    pub fn new<B: SplineBackend + ?Sized>(
        mesh: TMesh,
        basis: Basis,
        run: Run<'_, B>,
    ) -> Result<Self, Error> {
        let extraction = Extraction::of(&mesh, basis)?;
        let mut surface = Self {
            mesh,
            basis,
            controls: extraction.start_controls().to_vec(),
            extraction,
            points: Vec::new(),
        };
        surface.update(run.with(run.backend.as_spline()))?;
        Ok(surface)
    }

    /// Other control points, one per function.
    ///
    /// All Bézier points are computed anew. After an error of the count or of a number the surface is as before.
    ///
    /// # Errors
    /// [`Error::Count`], [`Error::NotFinite`].
    pub fn set_controls<B: SplineBackend + ?Sized>(
        &mut self,
        controls: Vec<Point3>,
        run: Run<'_, B>,
    ) -> Result<(), Error> {
        if controls.len() != self.controls.len() {
            return Err(Error::Count {
                what: "control points",
                found: controls.len(),
                expected: self.controls.len(),
            });
        }
        let bad = |p: &Point3| p.iter().any(|c| !c.is_finite());
        if let Some(control) = controls.iter().position(bad) {
            return Err(Error::NotFinite { control });
        }
        self.controls = controls;
        self.update(run.with(run.backend.as_spline()))
    }

    /// The same surface on a T-mesh with some elements cut into four: more freedom, and not a point moved, but where
    /// elements at an extraordinary vertex are cut: their patches are those of their level, and differ a little between
    /// levels.
    ///
    /// # Errors
    /// [`Error::NotNested`] for T-splines; as of [`TMesh::cut`].
    pub fn cut<B: SplineBackend + ?Sized>(
        &self,
        elements: &[usize],
        options: &TMeshOptions,
        run: Run<'_, B>,
    ) -> Result<Self, Error> {
        if self.basis != Basis::Hierarchical {
            return Err(Error::NotNested);
        }
        let mesh = self.mesh.cut(elements, options)?;
        let extraction = Extraction::of(&mesh, self.basis)?;
        let mut surface = Self {
            controls: self
                .extraction
                .carried(&self.mesh, &self.controls, &extraction)?,
            mesh,
            extraction,
            basis: self.basis,
            points: Vec::new(),
        };
        surface.update(run.with(run.backend.as_spline()))?;
        Ok(surface)
    }

    fn update(&mut self, run: On<'_>) -> Result<(), Error> {
        let task = PointsTask {
            extraction: &self.extraction,
            controls: &self.controls,
        };
        run.backend.bezier_points(&task, &mut self.points)?;
        let wanted = self.extraction.patches().len();
        geom_core::compute::BackendError::unless(
            self.points.len() == wanted,
            &run.backend.name(),
            || format!("points of {} patches for {wanted}", self.points.len()),
        )?;
        Ok(())
    }

    /// The T-mesh.
    pub fn mesh(&self) -> &TMesh {
        &self.mesh
    }
    /// The basis.
    pub fn basis(&self) -> Basis {
        self.basis
    }
    /// Its functions on the patches.
    pub fn extraction(&self) -> &Extraction {
        &self.extraction
    }
    /// The control points, Å.
    pub fn controls(&self) -> &[Point3] {
        &self.controls
    }
    /// The Bézier points of every patch.
    pub fn patches(&self) -> &[PatchPoints] {
        &self.points
    }

    /// The surface at `(s, t)` in 0…1 of an element, `s` along its side 0 and `t` along its side 3; derivatives by these.
    ///
    /// Where two patches of an element meet, the first one in their order answers. Parameters beyond 0…1 are not
    /// refused, and continue the polynomials of some patch.
    ///
    /// # Panics
    /// If there is no such element.
    pub fn evaluate(&self, element: usize, at: [f64; 2]) -> Jet {
        let size = self.mesh.elements()[element].size;
        let (patch, local) = self.extraction.locate(element, at, size);
        let mut jet = Jet::of(&self.points[patch], local);
        let extent = self.extraction.patches()[patch].size();
        let [a, b] = extent.map(|x| f64::from(size) / f64::from(x));
        jet.first = [jet.first[0] * a, jet.first[1] * b];
        jet.second = [
            jet.second[0] * (a * a),
            jet.second[1] * (a * b),
            jet.second[2] * (b * b),
        ];
        jet
    }

    /// Samples of all patches at all pairs of these parameters: `parameters.len()²` per patch, that along side 0 running
    /// fastest.
    ///
    /// Patch after patch, in the order of [`Surface::patches`]; parameters are those of patches, which may be smaller
    /// than elements.
    ///
    /// # Errors
    /// Those of the backend.
    pub fn sample<B: SplineBackend + ?Sized>(
        &self,
        parameters: &[f64],
        run: Run<'_, B>,
    ) -> Result<Vec<Sample>, Error> {
        let run = run.with(run.backend.as_spline());
        self.sample_on(parameters, run)
    }

    /// What the polynomials of a patch at a place are to its functions: themselves, or their quotients by the weight.
    pub(crate) fn functions_at(&self, patch: usize, basis: &[f64; POINTS]) -> [f64; POINTS] {
        if !self.extraction.is_rational() {
            return *basis;
        }
        let weight: f64 = self.points[patch]
            .iter()
            .zip(basis)
            .map(|(p, b)| p[3] * b)
            .sum();
        basis.map(|b| b / weight)
    }

    pub(crate) fn sample_on(&self, parameters: &[f64], run: On<'_>) -> Result<Vec<Sample>, Error> {
        let task = SamplesTask {
            patches: &self.points,
            parameters,
        };
        let mut samples = Vec::new();
        run.backend.bezier_samples(&task, &mut samples)?;
        let wanted = self.points.len() * parameters.len() * parameters.len();
        geom_core::compute::BackendError::unless(
            samples.len() == wanted,
            &run.backend.name(),
            || format!("{} samples for {wanted}", samples.len()),
        )?;
        Ok(samples)
    }
}
