//! The kernel on the GPU. It proposes; what is accepted is decided in f64 on the CPU.
//!
//! One shader, a triangle per invocation, in f32. What cancels is subtracted before narrowing: sides in place of corners, so
//! that digits are those of the triangle and not of where it lies. Untangling takes energies and gradients from here, but
//! whether a triangle is upright it asks in f64.

use bytemuck::{Pod, Zeroable};
use geom_core::Wgpu;
use geom_core::shaders::CROSSFIELD_CHART_DISTORTION;

use crate::Error;
use crate::backend::{ChartDistortion, CrossfieldBackend};
use crate::map::Chart;

/// Triangles per dispatch.
/// Buffers of 17 numbers for each stay below the 128 MiB that an adapter has to offer by WebGPU's defaults.
const TRIANGLES: usize = 1 << 20;

/// As the shader declares it: 16 bytes, as uniforms have to be.
#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct Parameters {
    count: u32,
    epsilon: f32,
    padding: [u32; 2],
}

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
        let gpu = self.gpu();
        out.clear();
        out.reserve(charts.len());
        for (charts, corners) in charts.chunks(TRIANGLES).zip(corners.chunks(TRIANGLES)) {
            let inputs: Vec<f32> = charts
                .iter()
                .zip(corners)
                .flat_map(|(chart, uv)| packed(chart, uv))
                .collect();
            let inputs = gpu.upload("inputs", &inputs)?;
            let made = gpu.output::<[f32; 8]>("distortions", charts.len())?;
            let parameters = Parameters {
                count: charts.len() as u32,
                epsilon: epsilon as f32,
                padding: [0; 2],
            };
            let parameters = gpu.uniform("parameters", &parameters)?;
            gpu.dispatch(
                &CROSSFIELD_CHART_DISTORTION,
                &[&inputs, &made, &parameters],
                [charts.len().div_ceil(64) as u32, 1, 1],
            )?;
            out.extend(gpu.download::<[f32; 8]>(&made)?.iter().map(|values| {
                let [energy, a, b, c, d, e, f, _] = values.map(f64::from);
                ChartDistortion {
                    energy,
                    gradient: [[a, b], [c, d], [e, f]],
                }
            }));
        }
        Ok(())
    }
}
