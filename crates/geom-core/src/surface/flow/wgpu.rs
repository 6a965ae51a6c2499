//! The kernel on the GPU. It proposes; what is accepted is decided in f64 on the CPU.

use bytemuck::{NoUninit, Pod, Zeroable};
use geom_shaders::{GEOM_CORE_CORNER_DISTORTION, Shader};

use super::backend::{Corner, CornerBackend, CornerDistortion};
use crate::compute::gpu::{GpuContext, GpuError};
use crate::compute::{BackendError, parallel};
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

/// Adds what a shader of regularized distortions makes of so many elements, 64 to a group, to `out`: `packed` gives the
/// numbers of an element as the shader reads them, `unpacked` takes the eight that come back.
///
/// # Errors
/// If a buffer is too large for the adapter, or it has been lost.
pub fn distortions<T: NoUninit, R: Send>(
    gpu: &GpuContext,
    shader: &Shader,
    count: usize,
    packed: impl Fn(usize) -> T + Sync,
    epsilon: f64,
    unpacked: impl Fn([f64; 8]) -> R + Send + Sync,
    out: &mut Vec<R>,
) -> Result<(), GpuError> {
    let inputs = gpu.upload_each("inputs", count, packed)?;
    let made = gpu.output::<[f32; 8]>("distortions", count)?;
    let parameters = Parameters {
        count: count as u32,
        epsilon: epsilon as f32,
        padding: [0; 2],
    };
    let parameters = gpu.uniform("parameters", &parameters)?;
    let groups = count.div_ceil(64) as u32;
    gpu.dispatch(shader, &[&inputs, &made, &parameters], [groups, 1, 1])?;
    gpu.read(&made, |made: &[[f32; 8]]| {
        parallel::extend(out, count, |i| unpacked(made[i].map(f64::from)));
    })
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
            let packed = |i: usize| {
                let Corner { sides, normal } = &part[i];
                [&sides[0], &sides[1], normal].map(narrow)
            };
            let unpacked = |[energy, area, a, b, c, d, e, f]: [f64; 8]| CornerDistortion {
                energy,
                area,
                gradient: [Vector3::new(a, b, c), Vector3::new(d, e, f)],
            };
            let (shader, count) = (&GEOM_CORE_CORNER_DISTORTION, part.len());
            distortions(self.gpu(), shader, count, packed, epsilon, unpacked, out)?;
        }
        Ok(())
    }
}
