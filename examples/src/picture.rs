//! Pictures without a window: meshes with light and colour, cuts through tetrahedra, slices of
//! grids, plots and contact sheets, as PNG.
//!
//! Which triangle is seen at a pixel is found by a rasterizer ([`Rasterizer`]): on the GPU, or on the
//! CPU where no adapter exists. Everything after that (light, colours, lines, labels) is one code.

mod canvas;
mod color;
mod cut;
mod plot;
mod raster_cpu;
mod raster_gpu;
mod scene;
mod shade;
mod slice;

pub use canvas::{Image, sheet, sheet_of_modes};
pub use color::{ColorMap, Rgb, Scale, mix, region_color, segment_color};
pub use cut::cut_tets;
pub use plot::{Bars, Curve, histogram, lines};
pub use scene::{Layer, Paint, Scene, View};
pub use slice::slice;

use geom_core::Wgpu;

/// Triangle number per pixel, row by row from the top; `u32::MAX` where there is none.
pub(crate) struct Visible {
    pub(crate) triangle: Vec<u32>,
}

/// A corner of a triangle in clip space: x right, y up, both in −1…1; z in 0…1, 0 nearest.
pub(crate) type Corner = [f32; 3];

/// Finds the triangle that is seen at each pixel.
pub enum Rasterizer {
    /// By a wgpu adapter.
    Gpu(Wgpu),
    /// By the CPU.
    Cpu,
}

/// Which rasterizer to take.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Renderer {
    /// The GPU if the kernels run on one, too, else the CPU.
    #[default]
    Auto,
    /// A wgpu adapter, hardware or software.
    Wgpu,
    /// The CPU.
    Cpu,
}

impl Rasterizer {
    /// The asked one. `gpu` is a device that is already open, if there is one.
    pub fn new(renderer: Renderer, gpu: Option<&Wgpu>) -> Result<Self, geom_core::GpuError> {
        match (renderer, gpu) {
            // A device that is not open yet takes longer to open than the picture to draw.
            (Renderer::Cpu, _) | (Renderer::Auto, None) => Ok(Self::Cpu),
            (Renderer::Auto, Some(gpu)) if gpu.gpu().is_software() => Ok(Self::Cpu),
            (_, Some(gpu)) => Ok(Self::Gpu(gpu.clone())),
            (Renderer::Wgpu, None) => Ok(Self::Gpu(Wgpu::new()?)),
        }
    }

    /// Its name for reports.
    pub fn name(&self) -> String {
        match self {
            Self::Gpu(gpu) => format!("wgpu ({})", gpu.gpu().adapter()),
            Self::Cpu => "cpu".to_owned(),
        }
    }

    pub(crate) fn visible(
        &self,
        triangles: &[[Corner; 3]],
        [width, height]: [usize; 2],
    ) -> Result<Visible, geom_core::GpuError> {
        match self {
            Self::Gpu(gpu) => raster_gpu::visible(gpu.gpu(), triangles, [width, height]),
            Self::Cpu => Ok(raster_cpu::visible(triangles, [width, height])),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use geom_core::mesh::shapes;

    #[test]
    fn both_rasterizers_see_the_same_triangles() {
        let Some(gpu) = gpu() else { return };
        let torus = shapes::torus(2.0, 0.7, 60, 30);
        let triangles: Vec<[Corner; 3]> = (0..torus.triangles().len())
            .map(|t| {
                torus.corners(t).map(|p| {
                    let clip = [p.x, p.y * 0.8 + p.z * 0.6, 1.5 - p.z * 0.4 + p.y * 0.3];
                    [clip[0] / 3.0, clip[1] / 3.0, clip[2] / 3.0].map(|c| c as f32)
                })
            })
            .collect();
        let size = [320, 240];
        let cpu = Rasterizer::Cpu.visible(&triangles, size).unwrap().triangle;
        let gpu = Rasterizer::Gpu(gpu)
            .visible(&triangles, size)
            .unwrap()
            .triangle;
        let covered = cpu.iter().filter(|&&t| t != u32::MAX).count();
        assert!(covered > 15_000, "the torus covers {covered} pixels");
        let differ = cpu.iter().zip(&gpu).filter(|(a, b)| a != b).count();
        // Pixels whose centre lies on an edge may fall to either side.
        assert!(
            differ * 200 < covered,
            "{differ} of {covered} pixels differ"
        );
    }

    fn gpu() -> Option<Wgpu> {
        geom_core::testing::gpu_or_skip()
    }
}
