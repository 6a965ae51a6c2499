//! The best map without integers: the optimum, unfolded where it folds.

use geom_core::TriMesh;

use super::{Making, MapOptions, alone};
use crate::Error;
use crate::backend::On;
use crate::field::CrossField;
use crate::field::frames::Frames;
use crate::map::conformal;
use crate::map::spacing::{Chart, determinant};
use crate::map::system::Weighted;
use crate::map::unfold::Folded;

/// The best map with real numbers in place of integers: as the energy has it, folded or not, or unfolded.
pub(super) struct Optimum<'a> {
    pub(super) weighted: Weighted<'a>,
    pub(super) w: Vec<f64>,
    pub(super) corners: Vec<[[f64; 2]; 3]>,
}

impl<'a> Making<'a> {
    /// The optimum of Eq. 4.10 with real numbers in place of integers.
    ///
    /// One sparse factorization and a few substitutions.
    pub(super) fn optimum(&mut self) -> Result<Optimum<'a>, Error> {
        let weighted = self.system.weighted(&self.weights)?;
        let w = weighted.optimum()?;
        let corners = self.system.corners(&w);
        self.report.relaxed_energy = self.system.energy(&corners);
        self.report.relaxed_folded = self.faults(&corners).len();
        Ok(Optimum {
            weighted,
            w,
            corners,
        })
    }

    /// The optimum, unfolded where it folds: no rounding could mend that, and the integers of a folded map are wrong ones.
    ///
    /// From where the last map of the same field ended, if there was one, else from the optimum. What is still folded
    /// then is an error that no other spacing would mend; where it is so is left for those who have finer triangles.
    pub(super) fn relaxed(&mut self) -> Result<Optimum<'a>, Error> {
        let start = self.unfolding.ends.folded.take();
        let is_resumed = start.is_some();
        if let Some(Folded { jacobians, .. }) = start {
            // The optimum of what the last map is wanted to be is that map.
            self.system.wanted = self.combed(&jacobians);
        }
        let optimum = self.optimum()?;
        if is_resumed {
            self.system.wanted.fill([[1.0, 0.0], [0.0, 1.0]]);
            self.report.relaxed_energy = self.system.energy(&optimum.corners);
        }
        if self.report.relaxed_folded == 0 {
            return Ok(optimum);
        }
        let w = self.unfolded_optimum(optimum, is_resumed)?;
        let corners = self.system.corners(&w);
        let (triangles, cones) = self.unfolder().invalid(&corners);
        if triangles + cones > 0 {
            self.leave_folded(&corners);
            return Err(Error::Folded {
                triangles,
                cones,
                stage: "unfolding",
                relaxed: true,
            });
        }
        self.unfolding.ends.upright.replace(Some(w.clone()));
        // Rounding starts from here, and has to keep what unfolding has reached.
        self.want(&corners);
        Ok(Optimum {
            weighted: self.system.weighted(&self.weights)?,
            w,
            corners,
        })
    }

    /// Leaves a map that has stayed folded for those who have finer triangles.
    fn leave_folded(&self, corners: &[[[f64; 2]; 3]]) {
        let all = self.system.charts.iter().zip(corners);
        let jacobians: Vec<_> = all.map(|(chart, uv)| chart.jacobian(uv)).collect();
        self.unfolding.ends.folded.replace(Some(Folded {
            jacobians: self.combed(&jacobians),
            vertices: self.unfolder().bad(corners),
        }));
    }

    /// Jacobians in the basis of the chosen arms for those in the basis of the field's, or the other way around: quarter turns
    /// of both bases, of which two are none.
    fn combed(&self, jacobians: &[[[f64; 2]; 2]]) -> Vec<[[f64; 2]; 2]> {
        let of = |(&[[a, b], [c, d]], comb): (&[[f64; 2]; 2], &u8)| match comb % 2 {
            0 => [[a, b], [c, d]],
            _ => [[d, -c], [-b, a]],
        };
        jacobians
            .iter()
            .zip(&self.system.cut.comb)
            .map(of)
            .collect()
    }

    /// The unknowns of an unfolded map without integers that has as many quads as asked for. One that is resumed folds in few places.
    fn unfolded_optimum(
        &mut self,
        optimum: Optimum<'a>,
        is_resumed: bool,
    ) -> Result<Vec<f64>, Error> {
        let Optimum {
            mut weighted,
            mut w,
            ..
        } = optimum;
        // Unfolding place by place does without its factor, and the next ones are as large.
        weighted.forget_free();
        if is_resumed {
            self.unfolder().mended(&weighted, true, &mut w)?;
            return Ok(self.sized(w));
        }
        // A map upright at one spacing is so at any, and only has to settle.
        let last = self.unfolding.ends.upright.take().map(|w| self.sized(w));
        if let Some(mut last) = last.filter(|w| self.unfolder().is_valid(w)) {
            self.unfolder().settle(&weighted, true, &mut last)?;
            return Ok(self.sized(last));
        }
        // Where triangles may be of the sizes that the cones ask for, few fold.
        match self.conformal_optimum() {
            Ok(of_cones) => w = of_cones,
            // Needles may be beyond the digits of their cotangents.
            Err(Error::Matrix(_)) => {}
            Err(error) => return Err(error),
        }
        // A convex problem turns most of these upright, and the rest unfolds where it is.
        self.unfolder().align(&weighted, &mut w)?;
        if !self.is_mended(&weighted, true, &mut w)? {
            self.unfolder().untangled(&weighted, true, &mut w)?;
        }
        Ok(self.sized(w))
    }

    /// Unfolds place by place, for half of the effort that is left; is the map upright now?
    pub(super) fn is_mended(
        &self,
        weighted: &Weighted<'_>,
        with_integers: bool,
        w: &mut [f64],
    ) -> Result<bool, Error> {
        let reserve = self.unfolding.effort.share(2);
        let is_upright = self.unfolder().mended(weighted, with_integers, w);
        self.unfolding.effort.give_back(&reserve);
        is_upright
    }

    /// The optimum for triangles of the sizes that the field's cones ask for.
    fn conformal_optimum(&mut self) -> Result<Vec<f64>, Error> {
        let charts = self.system.charts;
        let scales = conformal::scales(charts, self.frames, self.field)?;
        // Errors count in what is wanted there.
        let weights = scales.iter().map(|s| (s * s).recip()).collect();
        let sizes = scales.iter().map(|&s| [[s, 0.0], [0.0, s]]).collect();
        let of_field = std::mem::replace(&mut self.system.wanted, sizes);
        let w = self.least_folded(weights);
        self.system.wanted = of_field;
        Ok(self.sized(w?))
    }

    /// The optimum with these weights, or with more of them around what folds, if less of it does then.
    fn least_folded(&self, mut weights: Vec<f64>) -> Result<Vec<f64>, Error> {
        const STIFFER: f64 = 4.0;
        let first = self.system.weighted(&weights)?.optimum()?;
        let bad = self.unfolder().bad(&self.system.corners(&first));
        if bad.is_empty() {
            return Ok(first);
        }
        let near = self.frames.within(&bad, 1);
        for (f, weight) in weights.iter_mut().enumerate() {
            if (3 * f..3 * f + 3).any(|h| near[self.frames.from(h)]) {
                *weight *= STIFFER;
            }
        }
        let second = self.system.weighted(&weights)?.optimum()?;
        let left = self.unfolder().bad(&self.system.corners(&second));
        Ok(if left.len() < bad.len() {
            second
        } else {
            first
        })
    }

    /// The same map at the size that has as many quads as asked for.
    fn sized(&self, mut w: Vec<f64>) -> Vec<f64> {
        let all = self.system.charts.iter().zip(self.system.corners(&w));
        let area: f64 = all
            .map(|(chart, uv)| chart.area * chart.determinant(&uv))
            .sum();
        if area > 0.0 {
            let scale = (self.system.charts.len() as f64 / area).sqrt();
            w.iter_mut().for_each(|w| *w *= scale);
        }
        w
    }

    /// Makes a map the optimum: its gradients are wanted in place of the field's, the more strictly the narrower it is.
    ///
    /// A second optimum with the old wishes would fold again. The weights are those under which the smaller singular
    /// value counts relative to itself: where lines are close together in the unfolded map, rounding has to leave them
    /// so.
    fn want(&mut self, corners: &[[[f64; 2]; 3]]) {
        const MOST: f64 = 100.0;
        for (f, uv) in corners.iter().enumerate() {
            let j = self.system.charts[f].jacobian(uv);
            self.system.wanted[f] = j;
            let [_, least] = singular_values(&j);
            self.weights[f] = (least * least).recip().clamp(1.0, MOST);
        }
    }
}

/// What the best map without integers is like, folded or not.
pub(crate) struct Relaxation {
    /// `[h_u ∇u; h_v ∇v]` of each triangle in the basis of the field's arms, up to quarter turns of both.
    pub(crate) jacobians: Vec<[[f64; 2]; 2]>,
    /// Triangles inverted, turned away from the field or at a wrong angle.
    pub(crate) faults: usize,
    /// Mean of `|J − 1|²` over the area.
    pub(crate) energy: f64,
}

/// The optimum of Eq. 4.10 with real numbers in place of integers.
pub(crate) fn relaxation(
    mesh: &TriMesh,
    frames: &Frames,
    field: &CrossField,
    options: &MapOptions,
    run: On<'_>,
) -> Result<Relaxation, Error> {
    alone(mesh, frames, field, options, run, |mut making| {
        let Optimum { corners, .. } = making.optimum()?;
        let of = |(chart, uv): (&Chart, &[[f64; 2]; 3])| chart.jacobian(uv);
        Ok(Relaxation {
            jacobians: making.system.charts.iter().zip(&corners).map(of).collect(),
            faults: making.report.relaxed_folded,
            energy: making.report.relaxed_energy,
        })
    })
}

/// The larger and the smaller.
/// Both are 0 or more, their product is |det J|.
fn singular_values(j: &[[f64; 2]; 2]) -> [f64; 2] {
    let sum = j.iter().flatten().map(|x| x * x).sum::<f64>();
    let determinant = determinant(j);
    let root = (sum * sum - 4.0 * determinant * determinant)
        .max(0.0)
        .sqrt();
    [
        ((sum + root) / 2.0).sqrt(),
        ((sum - root).max(0.0) / 2.0).sqrt(),
    ]
}
