//! The bilateral normal filter, the rival of the flow on surfaces of flat parts.

use geom_core::compute::parallel;
use geom_core::options::require;
use geom_core::{Point3, TriMesh, Vector3};
use rayon::prelude::*;

use super::guard::hold_back;
use super::steps::{FlowReport, Smoothed};
use crate::Error;

/// Options of [`filter_normals`].
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct BilateralOptions {
    /// Rounds of the filter of the normals.
    pub normal_rounds: usize,
    /// Rounds of the vertices that follow them.
    pub vertex_rounds: usize,
    /// Difference of unit normals beyond which a face counts little.
    pub range: f64,
}

impl Default for BilateralOptions {
    fn default() -> Self {
        Self {
            normal_rounds: 15,
            vertex_rounds: 20,
            range: 0.3,
        }
    }
}

/// Normals of faces averaged over the faces around them, those nearby in place and direction most (Zheng, Fu,
/// Au and Tai, *Bilateral normal filtering for mesh denoising*, 2011, the local scheme); the vertices then follow
/// the normals (Sun, Rosin, Martin and Langbein, 2007).
///
/// # Errors
/// [`BilateralOptions::range`] not above 0, [`Error::NoExtent`] of a mesh without triangles.
pub fn filter_normals(
    mesh: &TriMesh,
    options: &BilateralOptions,
) -> Result<Smoothed<TriMesh>, Error> {
    let range = options.range;
    require(
        range > 0.0 && range.is_finite(),
        "range",
        range,
        "be above 0 and finite",
    )?;
    if mesh.triangles().is_empty() {
        return Err(Error::NoExtent);
    }
    let around = FacesAround::of(mesh);
    let normals = filtered(mesh, &around, options);
    let mut positions = mesh.positions().to_vec();
    let mut held_back = 0;
    for _ in 0..options.vertex_rounds {
        let mut moves: Vec<Vector3> = (0..positions.len())
            .into_par_iter()
            .map(|v| {
                let faces = around.of_vertex(v);
                let to_planes = faces.iter().map(|&f| {
                    let center = centroid(&positions, mesh.triangles()[f as usize]);
                    let n = normals[f as usize];
                    n * n.dot(&(center - positions[v]))
                });
                to_planes.sum::<Vector3>() / faces.len().max(1) as f64
            })
            .collect();
        held_back += hold_back(&positions, mesh.triangles(), &mut moves);
        positions.iter_mut().zip(&moves).for_each(|(p, m)| *p += m);
    }
    let smoothed = TriMesh::new(positions, mesh.triangles().to_vec())?;
    let squares = smoothed
        .positions()
        .iter()
        .zip(mesh.positions())
        .map(|(p, q)| (p - q).norm_squared());
    let (sum, most) = squares.fold((0.0, 0.0), |(s, m): (f64, f64), x| (s + x, m.max(x)));
    let report = FlowReport {
        steps: options.vertex_rounds,
        rms_displacement: (sum / mesh.positions().len().max(1) as f64).sqrt(),
        max_displacement: most.sqrt(),
        volume: [mesh.volume(), smoothed.volume()],
        held_back,
    };
    Ok(Smoothed {
        mesh: smoothed,
        report,
    })
}

fn filtered(mesh: &TriMesh, around: &FacesAround, options: &BilateralOptions) -> Vec<Vector3> {
    let count = mesh.triangles().len();
    let scaled: Vec<Vector3> = (0..count).map(|t| mesh.doubled_area_normal(t)).collect();
    let centers: Vec<Point3> = mesh
        .triangles()
        .iter()
        .map(|&t| centroid(mesh.positions(), t))
        .collect();
    let neighbors: Vec<Vec<u32>> = (0..count)
        .into_par_iter()
        .map(|t| {
            let mut faces: Vec<u32> = mesh.triangles()[t]
                .iter()
                .flat_map(|&v| around.of_vertex(v as usize))
                .copied()
                .filter(|&f| f as usize != t)
                .collect();
            faces.sort_unstable();
            faces.dedup();
            faces
        })
        .collect();
    let apart = |t: usize| {
        neighbors[t]
            .iter()
            .map(|&f| (centers[f as usize] - centers[t]).norm())
            .sum::<f64>()
    };
    let pairs: usize = neighbors.iter().map(Vec::len).sum();
    let reach = parallel::sum(count, apart) / pairs.max(1) as f64;
    let mut normals: Vec<Vector3> = scaled
        .iter()
        .map(|n| n.try_normalize(0.0).unwrap_or_else(Vector3::zeros))
        .collect();
    for _ in 0..options.normal_rounds {
        normals = (0..count)
            .into_par_iter()
            .map(|t| {
                let sum: Vector3 = neighbors[t]
                    .iter()
                    .map(|&f| {
                        let f = f as usize;
                        let near = (centers[f] - centers[t]).norm_squared() / (2.0 * reach * reach);
                        let alike = (normals[f] - normals[t]).norm_squared()
                            / (2.0 * options.range * options.range);
                        normals[f] * (scaled[f].norm() * (-near - alike).exp())
                    })
                    .sum();
                (sum + normals[t] * scaled[t].norm())
                    .try_normalize(0.0)
                    .unwrap_or(normals[t])
            })
            .collect();
    }
    normals
}

fn centroid(positions: &[Point3], triangle: [u32; 3]) -> Point3 {
    let sum: Vector3 = triangle.iter().map(|&v| positions[v as usize].coords).sum();
    Point3::from(sum / 3.0)
}

/// The triangles of each vertex.
struct FacesAround {
    starts: Vec<usize>,
    faces: Vec<u32>,
}

impl FacesAround {
    fn of(mesh: &TriMesh) -> Self {
        let mut counts = vec![0u32; mesh.positions().len()];
        for &v in mesh.triangles().as_flattened() {
            counts[v as usize] += 1;
        }
        let starts = parallel::starts_of(&counts);
        let mut next = starts.clone();
        let mut faces = vec![0; 3 * mesh.triangles().len()];
        for (corner, &v) in mesh.triangles().as_flattened().iter().enumerate() {
            faces[next[v as usize]] = (corner / 3) as u32;
            next[v as usize] += 1;
        }
        Self { starts, faces }
    }

    fn of_vertex(&self, v: usize) -> &[u32] {
        &self.faces[self.starts[v]..self.starts[v + 1]]
    }
}
