//! The kernel on the GPU. It proposes; what is accepted is decided in f64 on the CPU.
//!
//! One shader, a triangle per invocation, in f32. What cancels is subtracted before narrowing: sides in place of corners, so
//! that digits are those of the triangle and not of where it lies. Untangling takes energies and gradients from here, but
//! whether a triangle is upright it asks in f64.

use geom_core::Wgpu;
use geom_core::shaders::CROSSFIELD_CHART_DISTORTION;
use geom_core::surface::flow::distortions;

use crate::Error;
use crate::backend::{ChartDistortion, CrossfieldBackend};
use crate::map::Chart;

/// Triangles per dispatch.
/// Buffers of 17 numbers for each stay below the 128 MiB that an adapter has to offer by WebGPU's defaults.
const TRIANGLES: usize = 1 << 20;

/// Hats of u, hats of v, two sides of the triangle in the map, area: differences are taken before narrowing.
fn packed(chart: &Chart, uv: &[[f64; 2]; 3]) -> [f32; 17] {
    let mut out = [0.0; 17];
    let hats = chart.along_u.iter().chain(&chart.along_v).flatten();
    let sides = [1, 2].map(|k| [uv[k][0] - uv[0][0], uv[k][1] - uv[0][1]]);
    let all = hats.chain(sides.as_flattened()).chain([&chart.area]);
    for (out, value) in out.iter_mut().zip(all) {
        *out = *value as f32;
    }
    out
}

impl CrossfieldBackend for Wgpu {
    fn chart_distortion(
        &self,
        charts: &[Chart],
        corners: &[[[f64; 2]; 3]],
        epsilon: f64,
        out: &mut Vec<ChartDistortion>,
    ) -> Result<(), Error> {
        out.clear();
        out.reserve(charts.len());
        for (charts, corners) in charts.chunks(TRIANGLES).zip(corners.chunks(TRIANGLES)) {
            let packed = |i: usize| packed(&charts[i], &corners[i]);
            let unpacked = |[energy, a, b, c, d, e, f, _]: [f64; 8]| ChartDistortion {
                energy,
                gradient: [[a, b], [c, d], [e, f]],
            };
            let (shader, count) = (&CROSSFIELD_CHART_DISTORTION, charts.len());
            distortions(self.gpu(), shader, count, packed, epsilon, unpacked, out)?;
        }
        Ok(())
    }
}
