//! The kernel on the GPU. It proposes; what is accepted is decided in f64 on the CPU.

use bytemuck::{Pod, Zeroable};
use geom_shaders::GEOM_CORE_CORNER_DISTORTION;

use super::backend::{Corner, CornerBackend, CornerDistortion};
use crate::compute::BackendError;
use crate::{Vector3, Wgpu};

/// Corners per dispatch: 48 bytes each on the way in and 32 on the way out, below the 128 MiB that an adapter has to offer by
/// WebGPU's defaults.
const CORNERS: usize = 1 << 20;

/// As the shader declares it: 16 bytes, as uniforms have to be.
#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct Parameters {
    count: u32,
    epsilon: f32,
    padding: [u32; 2],
}

impl CornerBackend for Wgpu {
    fn corner_distortion(
        &self,
        corners: &[Corner],
        epsilon: f64,
        out: &mut Vec<CornerDistortion>,
    ) -> Result<(), BackendError> {
        let gpu = self.gpu();
        out.clear();
        out.reserve(corners.len());
        for part in corners.chunks(CORNERS) {
            let narrow = |v: &Vector3| [v.x as f32, v.y as f32, v.z as f32, 0.0];
            let inputs = part
                .iter()
                .map(|c| [&c.sides[0], &c.sides[1], &c.normal].map(narrow));
            let inputs = gpu.upload("corners", &inputs.collect::<Vec<[[f32; 4]; 3]>>())?;
            let made = gpu.output::<[f32; 8]>("distortions", part.len())?;
            let parameters = Parameters {
                count: part.len() as u32,
                epsilon: epsilon as f32,
                padding: [0; 2],
            };
            let parameters = gpu.uniform("parameters", &parameters)?;
            let groups = part.len().div_ceil(64) as u32;
            gpu.dispatch(
                &GEOM_CORE_CORNER_DISTORTION,
                &[&inputs, &made, &parameters],
                [groups, 1, 1],
            )?;
            out.extend(gpu.download::<[f32; 8]>(&made)?.iter().map(|values| {
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
