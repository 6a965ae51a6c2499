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

pub use canvas::{Align, Image, sheet, sheet_of_modes, ticks};
pub use color::{ColorMap, Rgb, Scale, mix, region_color, segment_color};
pub use cut::cut_tets;
pub use plot::{Bars, Curve, histogram, lines};
pub use scene::{Layer, Paint, Scene, View};
pub use slice::slice;

use geom_core::Wgpu;

/// Triangle number per pixel, row by row from the top; `u32::MAX` where there is none.
pub struct Visible {
    /// One per pixel.
    pub triangle: Vec<u32>,
}

/// A corner of a triangle in clip space: x right, y up, both in −1…1; z in 0…1, 0 nearest.
pub type Corner = [f32; 3];

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

    /// The triangle at each pixel of a picture of this size.
    pub fn visible(
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
