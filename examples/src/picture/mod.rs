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
#[cfg(feature = "wgpu")]
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

#[cfg(feature = "wgpu")]
use geom_core::Wgpu;

use crate::Failure;
use crate::device::Device;

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
    #[cfg(feature = "wgpu")]
    Gpu(Wgpu),
    /// By the CPU.
    Cpu,
}

/// Which rasterizer to take.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Renderer {
    /// The GPU if the kernels run on one, too, else the CPU.
    Auto,
    /// A wgpu adapter, hardware or software.
    Wgpu,
    /// The CPU.
    Cpu,
}

impl Rasterizer {
    /// The asked one; the device on which the kernels run is open already.
    pub fn new(renderer: Renderer, device: &Device) -> Result<Self, Failure> {
        Ok(match renderer {
            Renderer::Cpu => Self::Cpu,
            // A device that is not open yet takes longer to open than the picture to draw.
            Renderer::Auto if !device.is_hardware() => Self::Cpu,
            Renderer::Wgpu if !device.is_gpu() => Self::on(&Device::adapter()?),
            Renderer::Auto | Renderer::Wgpu => Self::on(device),
        })
    }

    fn on(device: &Device) -> Self {
        match device {
            Device::Cpu(_) => Self::Cpu,
            #[cfg(feature = "wgpu")]
            Device::Wgpu(gpu) => Self::Gpu(gpu.clone()),
        }
    }

    /// Its name for reports.
    pub fn name(&self) -> String {
        match self {
            #[cfg(feature = "wgpu")]
            Self::Gpu(gpu) => format!("wgpu ({})", gpu.gpu().adapter()),
            Self::Cpu => "cpu".to_owned(),
        }
    }

    /// The triangle at each pixel of a picture of this size.
    pub fn visible(
        &self,
        triangles: &[[Corner; 3]],
        [width, height]: [usize; 2],
    ) -> Result<Visible, Failure> {
        match self {
            #[cfg(feature = "wgpu")]
            Self::Gpu(gpu) => Ok(raster_gpu::visible(gpu.gpu(), triangles, [width, height])?),
            Self::Cpu => Ok(raster_cpu::visible(triangles, [width, height])),
        }
    }
}
