//! Guidance by directions that the caller gives.

use geom_core::search::bvh::TriangleTree;
use geom_core::{Point3, TriMesh, Vector3};

use crate::Error;
use crate::field::Frames;
use crate::field::{Guide, Toward};

/// Each stroke guides the triangle nearest to its point.
///
/// However far it is from it. The direction is projected to the plane of the triangle; one along its normal has no
/// direction there, and what rounding makes of it guides.
pub(super) fn guides(
    mesh: &TriMesh,
    frames: &Frames,
    strokes: &[(Point3, Vector3)],
    weight: f64,
) -> Result<Vec<Guide>, Error> {
    let tree = TriangleTree::new(mesh)?;
    let points: Vec<Point3> = strokes.iter().map(|s| s.0).collect();
    let closest = tree.closest_to_all(&points)?;
    Ok(closest
        .iter()
        .zip(strokes)
        .map(|(at, (_, direction))| Guide {
            face: at.triangle,
            toward: Toward::Angle(frames.angle(at.triangle as usize, direction)),
            weight,
        })
        .collect())
}
