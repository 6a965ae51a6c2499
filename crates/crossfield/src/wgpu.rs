//! The kernels on the GPU. It proposes; what is accepted is decided in f64 on the CPU.
//!
//! Both kernels are one shader each, an element per invocation, in f32. What cancels is subtracted before narrowing:
//! sides in place of corners, so that digits are those of the triangle and not of where it lies. Untangling takes
//! energies and gradients from here, but whether a triangle is upright it asks in f64.

use bytemuck::{Pod, Zeroable};
use geom_core::shaders::{CROSSFIELD_CHART_DISTORTION, CROSSFIELD_CORNER_DISTORTION, Shader};
use geom_core::{Vector3, Wgpu};

use crate::Error;
use crate::backend::{ChartDistortion, Corner, CornerDistortion, CrossfieldBackend};
use crate::map::Chart;

/// Elements per dispatch.
/// Buffers of 17 numbers for each stay below the 128 MiB that an adapter has to offer by WebGPU's defaults.
const ELEMENTS: usize = 1 << 20;

/// As the shaders declare it: 16 bytes, as uniforms have to be.
#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct Parameters {
    count: u32,
    epsilon: f32,
    padding: [u32; 2],
}

/// Two `vec4` per element, from a buffer of inputs.
///
/// `count` is the number of elements, of which a group has 64. Each call waits for its result.
///
/// # Errors
/// [`Error::Backend`] if a buffer is too large for the adapter, or it has been lost.
fn dispatched<T: bytemuck::NoUninit>(
    gpu: &Wgpu,
    shader: &Shader,
    inputs: &[T],
    count: usize,
    epsilon: f64,
) -> Result<Vec<[f32; 8]>, Error> {
    let gpu = gpu.gpu();
    let inputs = gpu.upload("inputs", inputs)?;
    let out = gpu.output::<[f32; 8]>("distortions", count)?;
    let parameters = Parameters {
        count: count as u32,
        epsilon: epsilon as f32,
        padding: [0; 2],
    };
    let parameters = gpu.uniform("parameters", &parameters)?;
    let groups = count.div_ceil(64) as u32;
    gpu.dispatch(shader, &[&inputs, &out, &parameters], [groups, 1, 1])?;
    Ok(gpu.download::<[f32; 8]>(&out)?)
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
        out.clear();
        out.reserve(charts.len());
        for (charts, corners) in charts.chunks(ELEMENTS).zip(corners.chunks(ELEMENTS)) {
            let inputs: Vec<f32> = charts
                .iter()
                .zip(corners)
                .flat_map(|(chart, uv)| packed(chart, uv))
                .collect();
            let shader = &CROSSFIELD_CHART_DISTORTION;
            let made = dispatched(self, shader, &inputs, charts.len(), epsilon)?;
            out.extend(made.iter().map(|values| {
                let [energy, a, b, c, d, e, f, _] = values.map(f64::from);
                ChartDistortion {
                    energy,
                    gradient: [[a, b], [c, d], [e, f]],
                }
            }));
        }
        Ok(())
    }

    fn corner_distortion(
        &self,
        corners: &[Corner],
        epsilon: f64,
        out: &mut Vec<CornerDistortion>,
    ) -> Result<(), Error> {
        out.clear();
        out.reserve(corners.len());
        for part in corners.chunks(ELEMENTS) {
            let narrow = |v: &Vector3| [v.x as f32, v.y as f32, v.z as f32, 0.0];
            let inputs: Vec<[f32; 4]> = part
                .iter()
                .flat_map(|c| [&c.sides[0], &c.sides[1], &c.normal].map(narrow))
                .collect();
            let shader = &CROSSFIELD_CORNER_DISTORTION;
            let made = dispatched(self, shader, &inputs, part.len(), epsilon)?;
            out.extend(made.iter().map(|values| {
                let [energy, area, a, b, c, d, e, f] = values.map(f64::from);
                CornerDistortion {
                    energy,
                    area,
                    gradient: [Vector3::new(a, b, c), Vector3::new(d, e, f)],
                }
            }));
        }
        Ok(())
    }
}
