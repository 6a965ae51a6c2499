//! Files for other programs. Lengths are in Å; coordinates and coefficients have 17 digits, so that what is read again
//! is what was written.
//!
//! - [`Exchange`]: nodes, and per patch its functions and their Bézier coefficients: what [`bext`] and [`iga`] hold, and
//!   JSON with feature `serde`
//! - [`vtu`]: Bézier cells for ParaView
//! - [`step`]: B-spline faces for CAD
//! - [`market`], [`npz`]: sparse matrices for solvers, as text and as NumPy arrays
//!
//! What is read again is what was written:
//!
//! ```
//! use tspline::files::{Exchange, iga};
//! use tspline::geom_core::{Cpu, Run, mesh::shapes};
//! use tspline::{Basis, Surface, TMesh, TMeshOptions};
//!
//! let quads = shapes::quad_sphere(1.0, 4);
//! let mesh = TMesh::build(&quads, &vec![0; quads.quads().len()], &TMeshOptions::default())?;
//! let surface = Surface::new(mesh, Basis::default(), Run::on(&Cpu))?;
//! let written = Exchange::from(&surface);
//! let mut text: Vec<u8> = Vec::new();
//! iga::write(&mut text, &written)?;
//! let read = iga::read(std::str::from_utf8(&text)?)?;
//! assert_eq!(read, written);
//! assert_eq!(read.elements.len(), 96);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

pub mod bext;
pub mod iga;
pub mod market;
pub mod npz;
pub mod step;
pub mod vtu;
mod words;

use crate::surface::{POINTS, PatchPoints};
use crate::{Error, Surface};

/// A surface as solvers exchange it: without its T-mesh.
#[derive(Clone, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Exchange {
    /// Control points: x, y, z and weight.
    /// x, y and z are not multiplied by the weight, which is above 0.
    pub nodes: Vec<[f64; 4]>,
    /// Bicubic patches.
    pub elements: Vec<ExchangeElement>,
}

/// A bicubic patch.
#[derive(Clone, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct ExchangeElement {
    /// Its nodes.
    pub nodes: Vec<u32>,
    /// The coefficients of the function of each node; `a + 4 b` as in [`POINTS`].
    pub rows: Vec<[f64; POINTS]>,
}

impl From<&Surface> for Exchange {
    fn from(surface: &Surface) -> Self {
        let extraction = surface.extraction();
        let element = |patch: usize| ExchangeElement {
            nodes: extraction.on(patch).to_vec(),
            rows: extraction.coefficients(patch).to_vec(),
        };
        Self {
            nodes: (surface.controls().iter())
                .map(|p| [p.x, p.y, p.z, 1.0])
                .collect(),
            elements: (0..extraction.patches().len()).map(element).collect(),
        }
    }
}

impl Exchange {
    /// Refuses what cannot be evaluated: nodes that do not exist or have no place or weight, numbers of rows that are not
    /// those of nodes.
    ///
    /// # Errors
    /// [`Error::NotFinite`], [`Error::Count`].
    pub fn check(&self) -> Result<(), Error> {
        let bad = |node: &[f64; 4]| node.iter().any(|x| !x.is_finite()) || node[3] <= 0.0;
        if let Some(control) = self.nodes.iter().position(bad) {
            return Err(Error::NotFinite { control });
        }
        for element in &self.elements {
            if element.rows.len() != element.nodes.len() {
                return Err(Error::Count {
                    what: "rows of an element",
                    found: element.rows.len(),
                    expected: element.nodes.len(),
                });
            }
            let bad = |&&n: &&u32| n as usize >= self.nodes.len();
            if let Some(&node) = element.nodes.iter().find(bad) {
                return Err(Error::Count {
                    what: "as the number of a node",
                    found: node as usize,
                    expected: self.nodes.len(),
                });
            }
        }
        Ok(())
    }

    /// The Bézier points of every patch.
    ///
    /// Homogeneous, as of a [`Surface`]: x w, y w, z w and w. So a surface that was read can be drawn without its
    /// T-mesh.
    ///
    /// # Errors
    /// As of [`check`](Self::check).
    pub fn patches(&self) -> Result<Vec<PatchPoints>, Error> {
        self.check()?;
        let points = |element: &ExchangeElement| {
            let mut points = [[0.0; 4]; POINTS];
            for (&n, row) in element.nodes.iter().zip(&element.rows) {
                let [x, y, z, w] = self.nodes[n as usize];
                for (out, c) in points.iter_mut().zip(row) {
                    for (out, x) in out.iter_mut().zip([x * w, y * w, z * w, w]) {
                        *out += c * x;
                    }
                }
            }
            points
        };
        Ok(self.elements.iter().map(points).collect())
    }
}
