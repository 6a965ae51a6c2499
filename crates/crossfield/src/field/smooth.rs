//! A copy of a surface without its bumps.
//!
//! A bump of the size of a quad turns the crosses around it by its curvature, and pairs of singularities there would be
//! closer to each other than integer points can be. After mean curvature flow for a time t, what is shorter than about
//! √t is gone; vertices and triangles stay the same ones, so that what is found on the smooth copy can be carried back
//! by number.

use geom_core::algebra::{SparseMatrix, Symbolic};
use geom_core::surface::laplace::{self, Mass};
use geom_core::{Point3, TriMesh};

use crate::Error;

/// Steps of mean curvature flow.
/// One implicit step of length t damps a wave of eigenvalue λ by 1 / (1 + λ t), three of a third of it by 1 / (1 + λ t
/// / 3)³, nearer to the flow's own e^{−λ t}.
const FLOW_STEPS: usize = 3;

/// What a surface's flows need: the same for every length of time.
pub(crate) struct Operators<'a> {
    pub(crate) mesh: &'a TriMesh,
    /// The cotangent Laplacian, positive semi-definite, of the surface as given.
    pub(crate) stiffness: SparseMatrix,
    /// The analysis of its pattern, which every flow's matrix has.
    pub(crate) symbolic: Symbolic,
    /// The lumped mass: the area of each vertex, Å².
    pub(crate) mass: Vec<f64>,
}

impl<'a> Operators<'a> {
    /// Assembles both.
    pub(crate) fn of(mesh: &'a TriMesh) -> Result<Self, Error> {
        let Mass::Lumped(mass) = laplace::lumped_mass(mesh) else {
            unreachable!("the lumped mass is lumped")
        };
        let stiffness = laplace::stiffness(mesh)?;
        Ok(Self {
            mesh,
            symbolic: Symbolic::of(&stiffness)?,
            stiffness,
            mass,
        })
    }
}

/// Mean curvature flow in implicit steps with the operator of the start (Desbrun et al., 1999), for a time of its own at each
/// vertex, above 0. Boundary vertices stay, and those that `held` names.
///
/// `times` are in Å². With an operator that does not follow the surface the flow is linear, so that one factorization
/// serves all steps and no triangle of the start can make it fail later; what shrinks to a thread is therefore not
/// torn. Triangles may become flat all the same: who wants frames of the result has to be ready for an error.
pub(crate) fn flowed(
    operators: &Operators<'_>,
    times: &[f64],
    held: impl Fn(usize) -> bool,
) -> Result<TriMesh, Error> {
    let Operators {
        mesh,
        stiffness,
        symbolic,
        mass,
    } = operators;
    let edges = geom_core::mesh::Halfedges::of(mesh)?;
    let vertices = mesh.positions().len();
    let stays: Vec<bool> = (0..vertices)
        .map(|v| {
            let id = geom_core::VertexId(v as u32);
            edges.out(id).is_none() || edges.on_boundary(id) || held(v)
        })
        .collect();
    // Divided by the length of a step.
    let inert: Vec<f64> = mass
        .iter()
        .zip(times)
        .map(|(m, t)| m * FLOW_STEPS as f64 / t)
        .collect();
    // Rows of vertices that stay become x = x; their columns go to the right-hand side.
    let matrix = stiffness.map(|i, j, k| match (i == j, stays[i] || stays[j]) {
        (true, true) => 1.0,
        (false, true) => 0.0,
        (true, false) => inert[i] + k,
        (false, false) => k,
    });
    let factor = symbolic.factor(&matrix)?;
    let mut block: Vec<f64> = mesh
        .positions()
        .iter()
        .flat_map(|p| p.coords.iter().copied())
        .collect();
    for _ in 0..FLOW_STEPS {
        let mut right = vec![0.0; block.len()];
        for i in 0..vertices {
            for c in 0..3 {
                right[3 * i + c] = if stays[i] {
                    block[3 * i + c]
                } else {
                    let pulled: f64 = stiffness
                        .row(i)
                        .filter(|&(j, _)| stays[j])
                        .map(|(j, k)| k * block[3 * j + c])
                        .sum();
                    inert[i] * block[3 * i + c] - pulled
                };
            }
        }
        factor.solve_in_place(&mut right, 3)?;
        block = right;
    }
    let positions = block
        .chunks_exact(3)
        .map(|p| Point3::new(p[0], p[1], p[2]))
        .collect();
    Ok(TriMesh::new(positions, mesh.triangles().to_vec())?)
}
