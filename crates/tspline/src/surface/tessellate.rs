//! Triangles of a surface, without gaps: what lies on a seam is computed once.
//!
//! Vertices at corners of patches and along segments belong to all who meet there, and are evaluated by one of them.
//! Inside, a patch is a grid; between its grid and its rim, on which there are more vertices where smaller patches lie
//! beyond, is a band of triangles that takes up whatever number there is.

use geom_core::compute::parallel;
use geom_core::{Point3, Run, TriMesh, Vector3};
use rayon::prelude::*;

use super::seams::Seams;
use super::{Jet, Sample, Surface};
use crate::Error;
use crate::backend::{On, SplineBackend};
use geom_core::options::require;

/// Triangles of a surface.
#[derive(Clone, Debug, PartialEq)]
pub struct Tessellation {
    /// The triangles.
    pub mesh: TriMesh,
    /// The normal of the surface at each vertex.
    /// Unit vectors, outwards; at corners of patches the mean of all that meet there, along seams that of one.
    pub normals: Vec<Vector3>,
    /// The patch in which each triangle lies.
    pub patches: Vec<u32>,
    /// The parameters of its corners in that patch.
    pub parameters: Vec<[[f64; 2]; 3]>,
}

/// Most steps along a side.
const MOST_STEPS: u32 = 64;

/// Triangles of a surface: `steps` along each side of a patch, more where several patches meet it.
///
/// `2 steps²` triangles per patch whose sides are whole. [`Tessellation::mesh`] is closed where the surface is.
///
/// # Errors
/// [`Error::Option`] for steps outside of 2…64; [`Error::Mesh`] for more triangles than an index can count; those of
/// the backend.
///
/// ```
/// use tspline::geom_core::{Cpu, Run, mesh::{SurfaceAudit, shapes}};
/// use tspline::{Basis, Surface, TMesh, TMeshOptions, surface::tessellate::tessellate};
///
/// let quads = shapes::quad_torus(3.0, 1.0, 16, 8);
/// let mesh = TMesh::build(&quads, &vec![0; quads.quads().len()], &TMeshOptions::default())?;
/// let surface = Surface::new(mesh, Basis::default(), Run::on(&Cpu))?;
/// let made = tessellate(&surface, 4, Run::on(&Cpu))?;
/// assert!(SurfaceAudit::of(&made.mesh).is_closed_manifold());
/// assert_eq!(made.normals.len(), made.mesh.positions().len());
/// # Ok::<(), tspline::Error>(())
/// ```
pub fn tessellate<B: SplineBackend + ?Sized>(
    surface: &Surface,
    steps: u32,
    run: Run<'_, B>,
) -> Result<Tessellation, Error> {
    tessellate_on(
        surface,
        &Seams::of(surface),
        steps,
        run.with(run.backend.as_spline()),
    )
}

pub(crate) fn tessellate_on(
    surface: &Surface,
    seams: &Seams,
    steps: u32,
    run: On<'_>,
) -> Result<Tessellation, Error> {
    let within = (2..=MOST_STEPS).contains(&steps);
    require(within, "steps", steps, "lie within 2…64")?;
    let parts = Parts {
        surface,
        seams,
        steps: steps as usize,
    };
    // Refused before anything is made of it.
    let per = u128::from(steps) * u128::from(steps) * 2;
    let count = per * surface.patches().len() as u128;
    if count > u128::from(u32::MAX / 4) {
        let count = usize::try_from(count).unwrap_or(usize::MAX);
        return Err(geom_core::MeshError::TooMany { count }.into());
    }
    let (positions, normals) = parts.vertices(run)?;
    let triangles = parallel::map(surface.patches().len(), |p| parts.triangles(p));
    let mut out = Tessellation {
        mesh: TriMesh::default(),
        normals,
        patches: Vec::new(),
        parameters: Vec::new(),
    };
    let mut corners = Vec::new();
    for (patch, of_patch) in triangles.into_iter().enumerate() {
        for triangle in of_patch {
            corners.push(triangle.map(|v| v.0));
            out.parameters.push(triangle.map(|v| v.1));
            out.patches.push(patch as u32);
        }
    }
    out.mesh = TriMesh::new(positions, corners)?;
    Ok(out)
}

/// A vertex and its parameters in the patch at hand.
type Vertex = (u32, [f64; 2]);

struct Parts<'a> {
    surface: &'a Surface,
    seams: &'a Seams,
    steps: usize,
}

impl Parts<'_> {
    /// Numbers: corners first, then the insides of segments, then those of patches.
    /// The vertex after so many steps from the first end of a segment.
    fn on_segment(&self, segment: u32, step: usize) -> u32 {
        let inner = self.steps - 1;
        (self.seams.corners.len() + segment as usize * inner + step - 1) as u32
    }

    /// The vertex of a patch's grid, `1 ≤ i, j < steps`.
    fn in_patch(&self, patch: usize, i: usize, j: usize) -> u32 {
        let inner = self.steps - 1;
        let before = self.seams.corners.len() + self.seams.segments.len() * inner;
        (before + patch * inner * inner + (i - 1) + (j - 1) * inner) as u32
    }

    /// Corners and seams on the CPU, the insides, which are most of them, on the backend.
    fn vertices(&self, run: On<'_>) -> Result<(Vec<Point3>, Vec<Vector3>), Error> {
        let inner = self.steps - 1;
        let share = |i: usize| i as f64 / self.steps as f64;
        let mut positions = self.seams.positions(self.surface);
        let mut normals = vec![Vector3::zeros(); positions.len()];
        for (points, corners) in self.surface.patches().iter().zip(&self.seams.of_patch) {
            let at = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];
            for (&corner, at) in corners.iter().zip(at) {
                normals[corner as usize] += normal(points, at);
            }
        }
        let along: Vec<(Point3, Vector3)> = self
            .seams
            .segments
            .par_iter()
            .with_min_len(256)
            .flat_map_iter(|segment| {
                let points = &self.surface.patches()[segment.owner.patch as usize];
                (1..=inner).map(move |i| {
                    let at = segment.owner.at(share(i));
                    (Jet::of(points, at).point, normal(points, at))
                })
            })
            .collect();
        let parameters: Vec<f64> = (1..=inner).map(share).collect();
        let inside: Vec<Sample> = self.surface.sample_on(&parameters, run)?;
        positions.extend(along.iter().map(|v| v.0));
        positions.extend(inside.iter().map(|s| s.point));
        normals.extend(along.iter().map(|v| v.1));
        normals.extend(inside.iter().map(|s| s.normal));
        for n in &mut normals {
            *n = n.try_normalize(0.0).unwrap_or_else(Vector3::z);
        }
        Ok((positions, normals))
    }

    /// The grid first, then the bands along the four sides, counter-clockwise, each as far as the diagonals of its
    /// corners.
    fn triangles(&self, patch: usize) -> Vec<[Vertex; 3]> {
        let m = self.steps;
        let share = |i: usize| i as f64 / m as f64;
        let inside = |i: usize, j: usize| (self.in_patch(patch, i, j), [share(i), share(j)]);
        let mut out = Vec::with_capacity(2 * m * m);
        for j in 1..m - 1 {
            for i in 1..m - 1 {
                let [a, b] = [inside(i, j), inside(i + 1, j)];
                let [d, c] = [inside(i, j + 1), inside(i + 1, j + 1)];
                out.extend([[a, b, c], [a, c, d]]);
            }
        }
        for side in 0..4 {
            let inner: Vec<Vertex> = (1..m)
                .map(|i| match side {
                    0 => inside(i, 1),
                    1 => inside(m - 1, i),
                    2 => inside(m - i, m - 1),
                    _ => inside(1, m - i),
                })
                .collect();
            let (outer, shares) = self.outer(patch, side);
            let (mut o, mut i) = (0, 0);
            // Whichever goes on less far goes on.
            while o + 1 < outer.len() || i + 1 < inner.len() {
                let outwards =
                    i + 1 == inner.len() || (o + 1 < outer.len() && shares[o + 1] < share(i + 2));
                if outwards {
                    out.push([outer[o], outer[o + 1], inner[i]]);
                    o += 1;
                } else {
                    out.push([outer[o], inner[i + 1], inner[i]]);
                    i += 1;
                }
            }
        }
        out
    }

    /// The vertices along a side, and their shares of it.
    fn outer(&self, patch: usize, side: usize) -> (Vec<Vertex>, Vec<f64>) {
        let corner = |k: usize| self.seams.of_patch[patch][k % 4];
        let ends = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];
        let (mut out, mut shares) = (vec![(corner(side), ends[side])], vec![0.0]);
        let segments = self.seams.side(patch, side);
        for (n, &(number, forward)) in segments.iter().enumerate() {
            let segment = &self.seams.segments[number as usize];
            let seen = match (forward, segment.other) {
                (false, Some(other)) => other,
                _ => segment.owner,
            };
            // From the end at which this side begins.
            let mut push = |vertex: u32, step: usize| {
                let u = seen.range[0]
                    + (seen.range[1] - seen.range[0]) * step as f64 / self.steps as f64;
                shares.push(u);
                out.push((vertex, seen.at(step as f64 / self.steps as f64)));
            };
            for step in 1..self.steps {
                let step = if forward { step } else { self.steps - step };
                push(self.on_segment(number, step), step);
            }
            if n + 1 == segments.len() {
                out.push((corner(side + 1), ends[(side + 1) % 4]));
                shares.push(1.0);
            } else {
                push(
                    segment.ends[usize::from(forward)],
                    if forward { self.steps } else { 0 },
                );
            }
        }
        (out, shares)
    }
}

/// The normal of a patch, where it is degenerate that of a place a little inside.
fn normal(points: &super::PatchPoints, at: [f64; 2]) -> Vector3 {
    let inward = at.map(|x| x + 1e-3 * (0.5 - x));
    let found = Jet::of(points, at).normal();
    let found = found.or_else(|| Jet::of(points, inward).normal());
    found.unwrap_or_default()
}
