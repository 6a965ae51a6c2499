//! The Laplace operator of a triangle mesh: cotangent stiffness, mass, gradient, divergence.
//!
//! Linear finite elements: with the hat function φᵢ of each vertex, `K[i][j] = ∫ ∇φᵢ · ∇φⱼ` and
//! `M[i][j] = ∫ φᵢ φⱼ`; K is positive semi-definite (K = −Δ) and its rows sum to zero. Eigenfunctions
//! of the surface solve `K f = λ M f` (Eqs. 4.2–4.4 with the mass that the thesis leaves out; see
//! "Reading the thesis").
//!
//! [`stiffness`] is the plain form: it refuses triangles without area, and obtuse ones give edges of
//! negative weight. [`robust()`] takes any triangles, also non-manifold ones, and has no such edges.
//!
//! Matrices have a row per vertex, the connection one per triangle; unused vertices have empty rows. Triangles are
//! summed in their order, so that the bits do not depend on threads. The sign is that of K = −Δ throughout: what
//! diffuses is `−K`.

mod connection;
mod robust;

pub(crate) use robust::Intrinsic;

use crate::compute::parallel;
use nalgebra::Complex;

pub use crate::algebra::Mass;

use crate::algebra::{self, SparseMatrix};
use crate::{MeshError, TriMesh, Vector3};

/// Why an operator cannot be made.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A triangle without area has no cotangents.
    #[error(
        "triangle {triangle} has no area (its height is below 1e-12 of its longest side); \
         use the robust operator or remove the triangle"
    )]
    Degenerate {
        /// The triangle.
        triangle: usize,
    },
    /// A value per vertex or per triangle is missing.
    #[error("{found} values, {expected} are needed: one per {element}")]
    Length {
        /// What carries a value.
        element: &'static str,
        /// Values given.
        found: usize,
        /// Values needed.
        expected: usize,
    },
    /// The form needs a manifold and an orientation.
    #[error(transparent)]
    Mesh(#[from] MeshError),
    /// The matrix is too large.
    #[error(transparent)]
    Matrix(#[from] algebra::Error),
}

/// Twice the area of a triangle, and per corner the dot product of the two sides that meet there. All that a linear
/// element needs; the longest side follows from two of the dot products.
#[derive(Clone, Copy)]
struct Shape {
    doubled_area: f64,
    dots: [f64; 3],
}

impl Shape {
    fn of(mesh: &TriMesh, triangle: usize) -> Self {
        let [a, b, c] = mesh.corners(triangle);
        Self {
            doubled_area: mesh.doubled_area_normal(triangle).norm(),
            dots: [
                (b - a).dot(&(c - a)),
                (c - b).dot(&(a - b)),
                (a - c).dot(&(b - c)),
            ],
        }
    }

    /// Half the cotangent at each corner: the weight of the opposite side.
    fn half_cotangents(&self) -> [f64; 3] {
        self.dots.map(|d| 0.5 * d / self.doubled_area)
    }

    /// Is it without area? Twice that is compared with the square of the longest side: a bound on height over side.
    fn is_degenerate(&self) -> bool {
        let [a, b, c] = self.dots;
        let longest = (a + b).max(b + c).max(c + a);
        // NaN (an overflow) is degenerate too.
        self.doubled_area.is_nan() || self.doubled_area <= 1e-12 * longest
    }
}

/// The stiffness of a triangle from half the cotangents at its corners.
fn element_stiffness([a, b, c]: [f64; 3]) -> [[f64; 3]; 3] {
    [[b + c, -c, -b], [-c, c + a, -a], [-b, -a, a + b]]
}

/// The cotangent stiffness matrix: `K[i][j] = −(cot α + cot β) / 2` for the two angles opposite the
/// side ij, and rows that sum to zero. Dimensionless. An edge of one or of more than two triangles has
/// as many terms as triangles, so borders get the natural (Neumann) condition; a vertex of no
/// triangle has an empty row.
///
/// ```
/// use geom_core::{mesh::shapes, surface::laplace};
/// let sphere = shapes::icosphere(1.0, 2);
/// let stiffness = laplace::stiffness(&sphere)?;
/// // A constant has no gradient.
/// let image = stiffness.multiply(&vec![1.0; sphere.positions().len()], 1);
/// assert!(image.iter().all(|x| x.abs() < 1e-12));
/// # Ok::<(), laplace::Error>(())
/// ```
///
/// # Errors
/// [`Error::Degenerate`] names the first triangle without area; [`Error::Matrix`] if there are too many entries.
pub fn stiffness(mesh: &TriMesh) -> Result<SparseMatrix, Error> {
    check_shapes(mesh)?;
    assemble(mesh.positions().len(), mesh.triangles(), |t| {
        element_stiffness(Shape::of(mesh, t).half_cotangents())
    })
}

/// The lumped mass: a third of the area of the triangles around each vertex, Å². Sums to the area.
///
/// ```
/// use geom_core::{algebra::Mass, mesh::shapes, surface::laplace};
/// let torus = shapes::torus(3.0, 1.0, 40, 16);
/// let Mass::Lumped(masses) = laplace::lumped_mass(&torus) else { unreachable!() };
/// assert!((masses.iter().sum::<f64>() - torus.area()).abs() < 1e-10);
/// ```
///
/// 0 at unused vertices and at those of triangles without area only: [`eigenpairs`](crate::algebra::eigen::eigenpairs)
/// leaves out the former, which have no stiffness either.
pub fn lumped_mass(mesh: &TriMesh) -> Mass {
    let areas = areas(mesh);
    Mass::Lumped(spread_areas(
        mesh.positions().len(),
        mesh.triangles(),
        &areas,
    ))
}

/// The consistent mass `∫ φᵢ φⱼ`, Å²: a sixth of a triangle's area per corner, a twelfth per pair.
/// Its rows sum to the lumped mass.
///
/// # Errors
/// Those of [`stiffness`], though a mass could be had of flat triangles too: what takes one matrix takes the other.
pub fn consistent_mass(mesh: &TriMesh) -> Result<Mass, Error> {
    check_shapes(mesh)?;
    let areas = areas(mesh);
    let matrix = assemble(mesh.positions().len(), mesh.triangles(), |t| {
        let (pair, corner) = (areas[t] / 12.0, areas[t] / 6.0);
        [
            [corner, pair, pair],
            [pair, corner, pair],
            [pair, pair, corner],
        ]
    })?;
    Ok(Mass::Consistent(matrix))
}

/// Stiffness and mass of the tufted cover: see [`robust()`].
///
/// Both matrices are of the vertices of the mesh and of the same size as the plain ones, so that they go in their
/// place.
#[derive(Clone, Debug, PartialEq)]
pub struct Robust {
    /// The stiffness, without edges of negative weight.
    pub stiffness: SparseMatrix,
    /// The lumped mass, Å².
    pub mass: Mass,
    /// What it took.
    pub report: RobustReport,
}

/// What it took to make the triangles fit for the operator.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct RobustReport {
    /// Flipped edges of the two sheets.
    pub flips: usize,
    /// Length added to every edge, Å: zero unless a triangle is nearly without height. Beside edges of this length the
    /// metric is no longer that of the mesh.
    pub added: f64,
}

/// The cotangent stiffness and the lumped mass of the tufted cover with Delaunay edges: for needles,
/// caps, triangles without area, edges of three and more triangles, and any orientation. Edges of
/// the mesh are flipped inside of the surface only; vertices and their functions stay. On a closed
/// mesh that is Delaunay it equals [`stiffness`] and [`lumped_mass`].
///
/// Sharp and Crane, "A Laplacian for Nonmanifold Triangle Meshes", 2020.
///
/// # Errors
/// [`Error::Degenerate`] only if all vertices coincide or a length overflows.
///
/// ```
/// use geom_core::{mesh::shapes, surface::laplace};
/// let sphere = shapes::icosphere(1.0, 2);
/// let robust = laplace::robust(&sphere)?;
/// assert_eq!(robust.report.added, 0.0);
/// assert_eq!(robust.stiffness.rows(), sphere.positions().len());
/// # Ok::<(), laplace::Error>(())
/// ```
///
/// It takes the time of sorting the edges and some passes of flips; the plain form is faster where it will do.
pub fn robust(mesh: &TriMesh) -> Result<Robust, Error> {
    robust::robust(mesh)
}

/// How much an edge counts in [`connection()`]. Which one does not matter on equilateral triangles, where both are the
/// same but for a common factor.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum EdgeWeights {
    /// One (Eq. 4.9).
    #[default]
    One,
    /// Three halves of the squared length over the area of its two triangles: the energy then does
    /// not depend on how the surface is cut into triangles.
    Shape,
}

/// The connection of a triangle to a neighbour. Only inner edges have one: nothing is carried over a boundary.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Transport {
    /// The two triangles.
    pub faces: [u32; 2],
    /// What is added to an angle in the frame of the first to get that of the parallel direction in
    /// the frame of the second, −π…π. The frame of a triangle begins with its first side.
    pub angle: f64,
    /// The weight of their edge.
    pub weight: f64,
}

/// The connection form of fields with one n-fold direction per triangle: see [`connection()`]. A triangle without
/// neighbours has an empty form, a zero on the diagonal.
#[derive(Clone, Debug, PartialEq)]
pub struct Connection {
    /// The inner edges, by their first half-edge.
    pub transports: Vec<Transport>,
    /// `zᴴ L z = Σ w |z_g − e^(i n κ) z_f|²`: Hermitian, positive semi-definite.
    pub matrix: SparseMatrix<Complex<f64>>,
    /// The area of each triangle, Å².
    pub areas: Vec<f64>,
}

/// The connection form of fields `z = e^(i n θ)`, n = `order` (4 for cross fields, 1 for vectors) with
/// θ in the frame of each triangle.
///
/// # Errors
/// [`Error::Mesh`] if the mesh is no oriented manifold, [`Error::Degenerate`].
///
/// The matrix is singular only where a parallel field exists, as on a plane or a cylinder; on a round sphere all its
/// eigenvalues are positive. The eigenvector of the smallest is the smoothest field.
pub fn connection(mesh: &TriMesh, order: u32, weights: EdgeWeights) -> Result<Connection, Error> {
    connection::connection(mesh, order, weights)
}

/// The gradient of a function with one value per vertex: one vector per triangle, in its plane. Zero
/// in triangles without area.
///
/// ```
/// use geom_core::{mesh::shapes, surface::laplace};
/// // Of the height, on the walls of a cylinder, the gradient is one up; on its ends it is zero.
/// let cylinder = shapes::cylinder(1.5, 4.0, 24, 6);
/// let height: Vec<f64> = cylinder.positions().iter().map(|p| p.z).collect();
/// let slopes = laplace::gradient(&cylinder, &height)?;
/// assert!(slopes.iter().all(|s| s.z.abs() < 1e-12 || (s.z - 1.0).abs() < 1e-12));
/// # Ok::<(), laplace::Error>(())
/// ```
///
/// In units of the function per Å.
///
/// # Errors
/// [`Error::Length`] unless there is one value per vertex.
pub fn gradient(mesh: &TriMesh, function: &[f64]) -> Result<Vec<Vector3>, Error> {
    check_length("vertex", function.len(), mesh.positions().len())?;
    Ok(parallel::map(mesh.triangles().len(), |t| {
        let hats = hat_gradients(mesh, t);
        (0..3)
            .map(|k| hats[k] * function[mesh.triangles()[t][k] as usize])
            .sum()
    }))
}

/// The divergence of a field with one vector per triangle, integrated around each vertex:
/// `−∫ X · ∇φᵢ`. Then `divergence(gradient(f)) = −K f`. Sums to zero.
///
/// ```
/// use geom_core::{mesh::shapes, surface::laplace};
/// let sphere = shapes::icosphere(1.0, 2);
/// let height: Vec<f64> = sphere.positions().iter().map(|p| p.z).collect();
/// let slopes = laplace::gradient(&sphere, &height)?;
/// let divergence = laplace::divergence(&sphere, &slopes)?;
/// let image = laplace::stiffness(&sphere)?.multiply(&height, 1);
/// assert!(divergence.iter().zip(&image).all(|(d, k)| (d + k).abs() < 1e-12));
/// # Ok::<(), laplace::Error>(())
/// ```
///
/// It is integrated over the surface, not divided by the mass: of directions without a unit it is in Å.
///
/// # Errors
/// [`Error::Length`] unless there is one vector per triangle.
pub fn divergence(mesh: &TriMesh, field: &[Vector3]) -> Result<Vec<f64>, Error> {
    check_length("triangle", field.len(), mesh.triangles().len())?;
    let corners = Corners::of(mesh.positions().len(), mesh.triangles());
    let terms: Vec<[f64; 3]> = parallel::map(mesh.triangles().len(), |t| {
        let area = 0.5 * mesh.doubled_area_normal(t).norm();
        hat_gradients(mesh, t).map(|g| -area * g.dot(&field[t]))
    });
    Ok(parallel::map(mesh.positions().len(), |v| {
        corners.around(v).map(|(t, k)| terms[t][k]).sum()
    }))
}

/// The gradients of the three hat functions of a triangle: `n × e / (2 A)` with the opposite side e. They sum to zero.
pub(crate) fn hat_gradients(mesh: &TriMesh, triangle: usize) -> [Vector3; 3] {
    if Shape::of(mesh, triangle).is_degenerate() {
        return [Vector3::zeros(); 3];
    }
    let [a, b, c] = mesh.corners(triangle);
    let normal = mesh.doubled_area_normal(triangle);
    let scaled = normal / normal.norm_squared();
    [c - b, a - c, b - a].map(|side| scaled.cross(&side))
}

fn areas(mesh: &TriMesh) -> Vec<f64> {
    parallel::map(mesh.triangles().len(), |t| {
        0.5 * mesh.doubled_area_normal(t).norm()
    })
}

/// A third of each triangle to each corner, gathered by the vertices: no two threads write to one place.
fn spread_areas(vertices: usize, triangles: &[[u32; 3]], areas: &[f64]) -> Vec<f64> {
    let corners = Corners::of(vertices, triangles);
    parallel::map(vertices, |v| {
        corners.around(v).map(|(t, _)| areas[t] / 3.0).sum()
    })
}

fn check_shapes(mesh: &TriMesh) -> Result<(), Error> {
    let is_degenerate = |t: usize| Shape::of(mesh, t).is_degenerate();
    match parallel::first(mesh.triangles().len(), is_degenerate) {
        Some(triangle) => Err(Error::Degenerate { triangle }),
        None => Ok(()),
    }
}

fn check_length(element: &'static str, found: usize, expected: usize) -> Result<(), Error> {
    if found != expected {
        return Err(Error::Length {
            element,
            found,
            expected,
        });
    }
    Ok(())
}

/// The triangle corners at each vertex, by ascending triangle. The transpose of the list of triangles, made in linear
/// time.
struct Corners {
    starts: Vec<usize>,
    corners: Vec<u32>,
}

impl Corners {
    fn of(vertices: usize, triangles: &[[u32; 3]]) -> Self {
        let mut counts = vec![0u32; vertices];
        for &v in triangles.as_flattened() {
            counts[v as usize] += 1;
        }
        let starts = parallel::starts_of(&counts);
        let mut next = starts.clone();
        let mut corners = vec![0; starts[vertices]];
        for (corner, &v) in triangles.as_flattened().iter().enumerate() {
            corners[next[v as usize]] = corner as u32;
            next[v as usize] += 1;
        }
        Self { starts, corners }
    }

    /// Triangle and corner.
    fn around(&self, vertex: usize) -> impl Iterator<Item = (usize, usize)> + '_ {
        self.corners[self.starts[vertex]..self.starts[vertex + 1]]
            .iter()
            .map(|&c| (c as usize / 3, c as usize % 3))
    }
}

/// Sums the 3 × 3 matrices of the triangles, in the order of the triangles. Each row gathers what is its own from the
/// corners at its vertex, in parallel.
fn assemble(
    vertices: usize,
    triangles: &[[u32; 3]],
    element: impl Fn(usize) -> [[f64; 3]; 3] + Send + Sync,
) -> Result<SparseMatrix, Error> {
    let elements: Vec<[[f64; 3]; 3]> = parallel::map(triangles.len(), element);
    let corners = Corners::of(vertices, triangles);
    Ok(SparseMatrix::from_rows(vertices, vertices, |v, out| {
        for (t, k) in corners.around(v) {
            out.extend((0..3).map(|l| (triangles[t][l], elements[t][k][l])));
        }
    })?)
}
