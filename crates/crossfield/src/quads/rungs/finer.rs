//! A field on finer triangles around the few places where its map stays folded.
//!
//! Triangles that hold each other folded open where each is cut into four: the pieces are flat on their parents, so that the
//! field goes on in them as it is, with the same singular vertices, and unfolding goes on from the same map.

use geom_core::surface::laplace::EdgeWeights;

use super::super::parts::{Cuts, Part};
use super::super::smooth::Smooth;
use super::mapped::Mapping;
use crate::Error;
use crate::anisotropy::Metric;
use crate::field::CrossField;
use crate::map::{Ends, Folded};

/// How many rings around a vertex that is not right are cut.
const RINGS: usize = 2;
/// Where more than one vertex in so many is not right, another field is what helps.
const FEW: usize = 50;

/// The same field on finer triangles.
pub(super) struct Finer {
    part: Part,
    smooth: Smooth,
    field: CrossField,
    metric: Option<Metric>,
    start: Folded,
}

impl Finer {
    /// Of what has stayed folded; `None` where that is too much.
    pub(super) fn around(
        ground: &Mapping<'_>,
        folded: &Folded,
        weights: EdgeWeights,
    ) -> Result<Option<Self>, Error> {
        let Mapping {
            part,
            smooth,
            field,
            metric,
            ..
        } = ground;
        let mesh = &part.mesh;
        if FEW * folded.vertices.len() > mesh.positions().len() {
            return Ok(None);
        }
        let frames = &smooth.frames;
        let near = frames.within(&folded.vertices, RINGS);
        let is_cut = |corners: &[u32; 3]| corners.iter().any(|&v| near[v as usize]);
        let is_cut: Vec<bool> = mesh.triangles().iter().map(is_cut).collect();
        let cuts = Cuts::of(mesh, &is_cut)?;
        let (part, smooth) = (part.cut(&cuts)?, smooth.cut(&cuts, weights)?);
        let turns = cuts.turns(&ground.smooth.mesh, &smooth.mesh);
        let of_parent = |&parent: &u32| folded.jacobians[parent as usize];
        Ok(Some(Self {
            field: field.in_pieces(frames, &smooth.frames, &cuts.parents, &turns, &cuts.sides),
            metric: metric.map(|m| m.in_pieces(&cuts.parents, &turns)),
            start: Folded {
                jacobians: cuts.parents.iter().map(of_parent).collect(),
                vertices: Vec::new(),
            },
            part,
            smooth,
        }))
    }

    /// What its map is made of.
    pub(super) fn mapping(&self) -> Mapping<'_> {
        let ends = Ends::of(self.part.mesh.triangles().len());
        ends.folded.replace(Some(self.start.clone()));
        Mapping {
            part: &self.part,
            smooth: &self.smooth,
            field: &self.field,
            metric: self.metric.as_ref(),
            ends,
        }
    }
}
