//! The kernel on the GPU. It proposes; what is accepted is decided in f64 on the CPU.

use bytemuck::{NoUninit, Pod, Zeroable};
use geom_shaders::{GEOM_CORE_CORNER_DISTORTION, Shader};

use super::backend::{Corner, CornerBackend, CornerDistortion};
use crate::compute::BackendError;
use crate::compute::gpu::{GpuContext, GpuError};
use crate::{Vector3, Wgpu};

/// Corners per dispatch: 48 bytes each on the way in and 32 on the way out, below the 128 MiB that an adapter has to offer by
/// WebGPU's defaults.
const CORNERS: usize = 1 << 20;

/// As the shaders declare it: 16 bytes, as uniforms have to be.
#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct Parameters {
    count: u32,
    epsilon: f32,
    padding: [u32; 2],
}

/// What a shader of regularized distortions makes of so many elements, 64 to a group: eight numbers each.
///
/// # Errors
/// If a buffer is too large for the adapter, or it has been lost.
pub fn distortions<T: NoUninit>(
    gpu: &GpuContext,
    shader: &Shader,
    inputs: &[T],
    count: usize,
    epsilon: f64,
) -> Result<Vec<[f32; 8]>, GpuError> {
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
    gpu.download(&out)
}

impl CornerBackend for Wgpu {
    fn corner_distortion(
        &self,
        corners: &[Corner],
        epsilon: f64,
        out: &mut Vec<CornerDistortion>,
    ) -> Result<(), BackendError> {
        out.clear();
        out.reserve(corners.len());
        for part in corners.chunks(CORNERS) {
            let narrow = |v: &Vector3| [v.x as f32, v.y as f32, v.z as f32, 0.0];
            let inputs: Vec<[[f32; 4]; 3]> = part
                .iter()
                .map(|c| [&c.sides[0], &c.sides[1], &c.normal].map(narrow))
                .collect();
            let shader = &GEOM_CORE_CORNER_DISTORTION;
            let made = distortions(self.gpu(), shader, &inputs, part.len(), epsilon)?;
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
