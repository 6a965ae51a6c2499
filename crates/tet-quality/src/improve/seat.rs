//! The way of vertices to the curves in which plane walls meet the isosurface.
//!
//! A mesher may have left them half a cell from there, some in an order along the curve that is no order on it, so that no
//! sweep brings all of them home: each goes as far as it can, then those that are left go with their neighbours, and the
//! smoothing of what is around makes room for the next round.

use super::passes::{NEAR, Passes, ROUNDS, to_foot};
use crate::backend::On;
use crate::boundary::guard::GuardedMesh;
use crate::error::Error;
use crate::measure::metrics::quality;
use crate::mesh::editable::EditableMesh;
use crate::operations::operate::round_of_projections;
use crate::outcome::Pass;
use crate::smoothing::smooth::{SurfaceRules, neighbourhood_of, project, relax, relax_surface};
use crate::smoothing::star::Star;

/// Most rounds.
const SEATINGS: u32 = 8;

impl Passes<'_> {
    /// Brings vertices of curves to them while tetrahedra keep the objective `floor`, or what their worst had. Gives how
    /// many moves it made.
    /// The plane comes first: where the isosurface does not meet it near by, as where it only touches, it is all there is.
    pub(super) fn seat(&mut self, floor: f64, run: On<'_>) -> Result<usize, Error> {
        let Some(field) = self.surface else {
            return Ok(0);
        };
        let rules = SurfaceRules {
            field,
            tolerance: NEAR * self.spacing,
            rescue: false,
        };
        let good = |corners| quality(corners) >= floor;
        let step = |guarded: &GuardedMesh, v: u32, star: &mut Star| {
            to_foot(guarded, v, &rules, good, star)
        };
        let mut done = Pass::default();
        for _ in 0..SEATINGS {
            let off = off_plane(&self.guarded.mesh);
            if off.is_empty() {
                break;
            }
            self.find_gaps(None);
            let before = done.projected;
            done.projected += project(&mut self.guarded, &off, &field, rules.tolerance, good)?;
            let left = off_plane(&self.guarded.mesh);
            round_of_projections(&mut self.guarded, &mut self.plain, &left, step, &mut done);
            if done.projected == before {
                break;
            }
            let around = neighbourhood_of(&self.guarded.mesh, &off);
            relax(&mut self.guarded, &around, ROUNDS, None, run)?;
            relax_surface(&mut self.guarded, &around, &rules, run)?;
        }
        Ok(done.projected)
    }
}

/// The vertices of curves that are not in their planes, by number.
fn off_plane(mesh: &EditableMesh) -> Vec<u32> {
    let vertices = 0..mesh.x.len() as u32;
    vertices
        .filter(|&v| {
            let plane = mesh.freedom[v as usize].plane();
            let off = plane.is_some_and(|plane| !plane.holds(&mesh.x[v as usize]));
            off && !mesh.incidence.of(v).is_empty()
        })
        .collect()
}
