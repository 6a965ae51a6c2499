//! How thick a body is behind its surface, and normals that do not see what is small beside that.

use std::f64::consts::{PI, TAU};

use geom_core::algebra::{Cholesky, SparseMatrix};
use geom_core::compute::parallel;
use geom_core::options::require;
use geom_core::search::bvh::{Hit, TriangleTree};
use geom_core::{Point3, TriMesh, Vector3};

use super::triangles::{Normals, smoothed_normals};
use crate::Error;

/// Rays per triangle, as in the paper.
const RAYS: usize = 30;
/// For a smooth thickness fewer do, from about so many triangles, spread over this share of the root of the area: about
/// as far as such triangles are apart.
const FEW_RAYS: usize = 8;
const SAMPLE: usize = 5000;
const SPREAD: f64 = 0.02;
/// Cotangents beyond this count as it: more would only spoil the factor.
const STEEPEST: f64 = 100.0;
/// The largest angle of a ray from the inward normal.
const CONE: f64 = PI / 3.0;

/// The shape diameter of each triangle, in the unit of the mesh (Shapira, Shamir and Cohen-Or, *Consistent mesh
/// partitioning and skeletonisation using the shape diameter function*, 2008): rays in a cone of 120° against the
/// normal until they leave the body; of their lengths the mean, weighted by the inverse angle, of those within a
/// standard deviation of the median. 0 where no ray meets the other side.
///
/// # Errors
/// No triangles.
pub fn shape_diameter(mesh: &TriMesh) -> Result<Vec<f64>, Error> {
    diameters(mesh, 1, RAYS)
}

/// Of one triangle of every so many, by this many rays each; the others have 0.
fn diameters(mesh: &TriMesh, stride: usize, rays: usize) -> Result<Vec<f64>, Error> {
    let tree = TriangleTree::new(mesh).map_err(|_| Error::NoExtent)?;
    let of_one = |t: usize| match t % stride {
        0 => diameter(mesh, &tree, t, rays),
        _ => 0.0,
    };
    Ok(parallel::map(mesh.triangles().len(), of_one))
}

/// Of one triangle; 0 if it has no area.
fn diameter(mesh: &TriMesh, tree: &TriangleTree, triangle: usize, rays: usize) -> f64 {
    let [a, b, c] = mesh.corners(triangle);
    let center = Point3::from((a.coords + b.coords + c.coords) / 3.0);
    let Some(outwards) = mesh.doubled_area_normal(triangle).try_normalize(0.0) else {
        return 0.0;
    };
    // Off the surface, by less than anything that matters.
    let origin = center - outwards * (1e-4 * (b - a).norm());
    let leaves = |hit: &Hit| !hit.entering;
    let mut found: Vec<(f64, f64)> = cone(-outwards, rays)
        .filter_map(|(angle, ray)| {
            let hit = tree.first_hit(&origin, &ray).filter(leaves)?;
            Some((hit.time, 1.0 / angle))
        })
        .collect();
    found.sort_by(|x, y| x.0.total_cmp(&y.0));
    let Some(&(median, _)) = found.get(found.len() / 2) else {
        return 0.0;
    };
    let count = found.len() as f64;
    let mean = found.iter().map(|x| x.0).sum::<f64>() / count;
    let variance = found.iter().map(|x| (x.0 - mean).powi(2)).sum::<f64>() / count;
    let near = found
        .iter()
        .filter(|x| (x.0 - median).abs() <= variance.sqrt());
    let (sum, weights) = near.fold((0.0, 0.0), |(s, w), x| (s + x.0 * x.1, w + x.1));
    if weights > 0.0 { sum / weights } else { median }
}

/// Directions spread over the cone around an axis (a sunflower), with their angles from it.
fn cone(axis: Vector3, rays: usize) -> impl Iterator<Item = (f64, Vector3)> {
    let mut off = Vector3::zeros();
    off[axis.iamin()] = 1.0;
    let side = off.cross(&axis).normalize();
    let up = axis.cross(&side);
    let golden = TAU * (1.0 - 1.0 / 1.618_033_988_749_895);
    (0..rays).map(move |k| {
        let share = (k as f64 + 0.5) / rays as f64;
        let angle = (1.0 - share * (1.0 - CONE.cos())).acos();
        let (sin, cos) = (golden * k as f64).sin_cos();
        (
            angle,
            axis * angle.cos() + (side * cos + up * sin) * angle.sin(),
        )
    })
}

/// From triangles to vertices: the mean over the triangles around each, by area. Triangles without a value (0) have no say;
/// 0 where none has one.
pub(crate) fn at_vertices(mesh: &TriMesh, values: &[f64]) -> Vec<f64> {
    let mut sums = vec![(0.0, 0.0); mesh.positions().len()];
    for (t, corners) in mesh.triangles().iter().enumerate() {
        let area = mesh.doubled_area_normal(t).norm();
        for &v in corners.iter().filter(|_| values[t] > 0.0) {
            let (sum, weight) = &mut sums[v as usize];
            *sum += area * values[t];
            *weight += area;
        }
    }
    let mean = |(sum, weight): (f64, f64)| if weight > 0.0 { sum / weight } else { 0.0 };
    sums.into_iter().map(mean).collect()
}

impl Normals {
    /// The share of [`Normals::without_detail`] that parts are best told by.
    pub const DETAIL: f64 = 0.05;

    /// Normals of the mesh without its detail: those of [`Normals::OfMesh`] after `rounds`, diffused on the surface over the
    /// length `detail` · d, with the local [`shape_diameter`] d. What is small beside the thickness of the body is evened out:
    /// curls of hair on a head, not the fingers of a hand, which are as thin as they are narrow.
    ///
    /// One implicit step of diffusion, `(M + L) n = M n₀` with the weights of cotangents times the square of the length and
    /// none negative, so that no normal leaves the hull of the others; then unit length.
    ///
    /// # Errors
    /// No triangles; a `detail` that is negative or not finite.
    ///
    /// ```
    /// use secondfund_ops::{Normals, geom_core::mesh::shapes};
    /// let sphere = shapes::icosphere(1.0, 3);
    /// let Normals::Given(normals) = Normals::without_detail(&sphere, 3, Normals::DETAIL)? else { unreachable!() };
    /// let off = sphere.positions().iter().zip(&normals).map(|(p, n)| (p.coords - n).norm());
    /// assert!(off.fold(0.0, f64::max) < 0.02);
    /// # Ok::<(), secondfund_ops::Error>(())
    /// ```
    pub fn without_detail(mesh: &TriMesh, rounds: u32, detail: f64) -> Result<Self, Error> {
        let valid = detail.is_finite() && detail >= 0.0;
        require(valid, "detail", detail, "be 0 or more")?;
        let lengths: Vec<f64> = thickness(mesh)?.iter().map(|d| detail * d).collect();
        let normals = smoothed_normals(mesh, rounds);
        let mut even: Vec<f64> = normals.iter().flat_map(|n| [n.x, n.y, n.z]).collect();
        diffuse(mesh, |_| true, |t| mean_of(mesh, t, &lengths), &mut even, 3)?;
        let unit = |(row, old): (&[f64], &Vector3)| {
            Vector3::from_column_slice(row)
                .try_normalize(0.0)
                .unwrap_or(*old)
        };
        let rows = even.chunks(3).zip(&normals);
        Ok(Self::Given(rows.map(unit).collect()))
    }
}

/// The shape diameter at the vertices, of some triangles, spread over all; 0 on components of which no ray meets another side.
fn thickness(mesh: &TriMesh) -> Result<Vec<f64>, Error> {
    let stride = mesh.triangles().len().div_ceil(SAMPLE).max(1);
    let sample = diameters(mesh, stride, FEW_RAYS)?;
    let reach = SPREAD * mesh.area().sqrt();
    let mut values = at_vertices(mesh, &sample);
    diffuse(mesh, |t| sample[t] > 0.0, |_| reach, &mut values, 1)?;
    Ok(values)
}

/// The mean over the corners of a triangle.
fn mean_of(mesh: &TriMesh, triangle: usize, values: &[f64]) -> f64 {
    let corners = mesh.triangles()[triangle].iter();
    corners.map(|&v| values[v as usize]).sum::<f64>() / 3.0
}

/// One implicit step of diffusion over a length on each triangle, `(M + L) x = M x₀` of rows of so many values: what the
/// triangles that count have at their corners goes to all.
fn diffuse(
    mesh: &TriMesh,
    counts: impl Fn(usize) -> bool,
    length: impl Fn(usize) -> f64,
    values: &mut [f64],
    columns: usize,
) -> Result<(), Error> {
    let vertices = mesh.positions().len();
    let mut masses = vec![0.0; vertices];
    let mut entries = Vec::with_capacity(12 * mesh.triangles().len() + vertices);
    for (t, corners) in mesh.triangles().iter().enumerate() {
        let places = mesh.corners(t);
        let doubled = mesh.doubled_area_normal(t).norm();
        let square = length(t).powi(2);
        for i in 0..3 {
            let (j, k) = ((i + 1) % 3, (i + 2) % 3);
            if counts(t) {
                masses[corners[i] as usize] += doubled / 6.0;
            }
            let dot = (places[j] - places[i]).dot(&(places[k] - places[i]));
            let weight = 0.5 * square * (dot / doubled).clamp(0.0, STEEPEST);
            // A triangle of one point has none.
            if weight.is_finite() {
                let (a, b) = (corners[j], corners[k]);
                entries.extend([
                    (a, b, -weight),
                    (b, a, -weight),
                    (a, a, weight),
                    (b, b, weight),
                ]);
            }
        }
    }
    // Where nothing counts near or far, what stands there stays.
    let least = 1e-9 * mesh.area() / vertices.max(1) as f64;
    let masses = masses.into_iter().map(|m| m + least.max(f64::MIN_POSITIVE));
    let masses: Vec<f64> = masses.collect();
    entries.extend((0..vertices).map(|v| (v as u32, v as u32, masses[v])));
    let matrix = SparseMatrix::from_triplets(vertices, vertices, &entries)?;
    for (row, mass) in values.chunks_mut(columns).zip(&masses) {
        row.iter_mut().for_each(|x| *x *= mass);
    }
    Ok(Cholesky::<f64>::of(&matrix)?.solve_in_place(values, columns)?)
}
