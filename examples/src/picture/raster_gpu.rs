//! The rasterizer on a wgpu adapter.

use geom_core::GpuError;
use geom_core::compute::gpu::{GpuContext, wgpu};

use super::{Corner, Visible};

/// Triangles per draw: 48 B each, far below any limit.
const BATCH: usize = 1 << 20;

#[repr(C)]
#[derive(Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
struct Vertex {
    place: Corner,
    number: u32,
}

pub(super) fn visible(
    gpu: &GpuContext,
    triangles: &[[Corner; 3]],
    [width, height]: [usize; 2],
) -> Result<Visible, GpuError> {
    let limit = gpu.limits().max_texture_dimension_2d as usize;
    if width > limit || height > limit {
        return Err(GpuError::Failed {
            during: "drawing".to_owned(),
            reason: format!("{width} × {height} pixels, the device allows {limit} per side"),
        });
    }
    gpu.watched("drawing", || {
        draw(gpu, triangles, [width as u32, height as u32])
    })?
}

fn failed(error: impl std::fmt::Display) -> GpuError {
    GpuError::Failed {
        during: "drawing".to_owned(),
        reason: error.to_string(),
    }
}

fn draw(
    gpu: &GpuContext,
    triangles: &[[Corner; 3]],
    [width, height]: [u32; 2],
) -> Result<Visible, GpuError> {
    let (device, queue) = (gpu.device(), gpu.queue());
    let texture = |format, usage| {
        device.create_texture(&wgpu::TextureDescriptor {
            label: Some("picture"),
            size: wgpu::Extent3d {
                width,
                height,
                depth_or_array_layers: 1,
            },
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format,
            usage: wgpu::TextureUsages::RENDER_ATTACHMENT | usage,
            view_formats: &[],
        })
    };
    let seen = texture(wgpu::TextureFormat::R32Uint, wgpu::TextureUsages::COPY_SRC);
    let depth = texture(
        wgpu::TextureFormat::Depth32Float,
        wgpu::TextureUsages::empty(),
    );
    let (seen_view, depth_view) = (
        seen.create_view(&Default::default()),
        depth.create_view(&Default::default()),
    );
    let pipeline = pipeline(device);
    let vertices = device.create_buffer(&wgpu::BufferDescriptor {
        label: Some("triangles"),
        size: (triangles.len().clamp(1, BATCH) * 3 * size_of::<Vertex>()) as u64,
        usage: wgpu::BufferUsages::VERTEX | wgpu::BufferUsages::COPY_DST,
        mapped_at_creation: false,
    });

    // At least one pass, which clears.
    let batches = triangles.len().div_ceil(BATCH).max(1);
    for b in 0..batches {
        let first = b * BATCH;
        let batch = &triangles[first..triangles.len().min(first + BATCH)];
        let corners: Vec<Vertex> = batch
            .iter()
            .zip(first as u32..)
            .flat_map(|(t, number)| t.map(|place| Vertex { place, number }))
            .collect();
        queue.write_buffer(&vertices, 0, bytemuck::cast_slice(&corners));
        let mut encoder = device.create_command_encoder(&Default::default());
        {
            // Number u32::MAX means nothing: 2³² − 1 is exact as f64.
            let nothing = wgpu::Color {
                r: f64::from(u32::MAX),
                g: 0.0,
                b: 0.0,
                a: 0.0,
            };
            let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
                label: Some("picture"),
                color_attachments: &[Some(wgpu::RenderPassColorAttachment {
                    view: &seen_view,
                    depth_slice: None,
                    resolve_target: None,
                    ops: wgpu::Operations {
                        load: if b == 0 {
                            wgpu::LoadOp::Clear(nothing)
                        } else {
                            wgpu::LoadOp::Load
                        },
                        store: wgpu::StoreOp::Store,
                    },
                })],
                depth_stencil_attachment: Some(wgpu::RenderPassDepthStencilAttachment {
                    view: &depth_view,
                    depth_ops: Some(wgpu::Operations {
                        load: if b == 0 {
                            wgpu::LoadOp::Clear(1.0)
                        } else {
                            wgpu::LoadOp::Load
                        },
                        store: wgpu::StoreOp::Store,
                    }),
                    stencil_ops: None,
                }),
                ..Default::default()
            });
            pass.set_pipeline(&pipeline);
            pass.set_vertex_buffer(0, vertices.slice(..));
            pass.draw(0..corners.len() as u32, 0..1);
        }
        queue.submit([encoder.finish()]);
    }
    read_back(gpu, &seen, [width, height])
}

fn pipeline(device: &wgpu::Device) -> wgpu::RenderPipeline {
    let shader = device.create_shader_module(wgpu::ShaderModuleDescriptor {
        label: Some("visible"),
        source: wgpu::ShaderSource::Wgsl(include_str!("visible.wgsl").into()),
    });
    device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
        label: Some("visible"),
        layout: None,
        vertex: wgpu::VertexState {
            module: &shader,
            entry_point: Some("corner"),
            compilation_options: Default::default(),
            buffers: &[Some(wgpu::VertexBufferLayout {
                array_stride: size_of::<Vertex>() as u64,
                step_mode: wgpu::VertexStepMode::Vertex,
                attributes: &wgpu::vertex_attr_array![0 => Float32x3, 1 => Uint32],
            })],
        },
        primitive: Default::default(),
        depth_stencil: Some(wgpu::DepthStencilState {
            format: wgpu::TextureFormat::Depth32Float,
            depth_write_enabled: Some(true),
            depth_compare: Some(wgpu::CompareFunction::LessEqual),
            stencil: Default::default(),
            bias: Default::default(),
        }),
        multisample: Default::default(),
        fragment: Some(wgpu::FragmentState {
            module: &shader,
            entry_point: Some("pixel"),
            compilation_options: Default::default(),
            targets: &[Some(wgpu::TextureFormat::R32Uint.into())],
        }),
        multiview_mask: None,
        cache: None,
    })
}

fn read_back(
    gpu: &GpuContext,
    seen: &wgpu::Texture,
    [width, height]: [u32; 2],
) -> Result<Visible, GpuError> {
    let (device, queue) = (gpu.device(), gpu.queue());
    let stride = (width * 4).next_multiple_of(wgpu::COPY_BYTES_PER_ROW_ALIGNMENT);
    let buffer = device.create_buffer(&wgpu::BufferDescriptor {
        label: Some("picture"),
        size: u64::from(stride) * u64::from(height),
        usage: wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ,
        mapped_at_creation: false,
    });
    let mut encoder = device.create_command_encoder(&Default::default());
    encoder.copy_texture_to_buffer(
        seen.as_image_copy(),
        wgpu::TexelCopyBufferInfo {
            buffer: &buffer,
            layout: wgpu::TexelCopyBufferLayout {
                offset: 0,
                bytes_per_row: Some(stride),
                rows_per_image: None,
            },
        },
        seen.size(),
    );
    queue.submit([encoder.finish()]);
    let (send, receive) = std::sync::mpsc::channel();
    buffer
        .slice(..)
        .map_async(wgpu::MapMode::Read, move |result| {
            // The receiver waits below, so it exists.
            let _ = send.send(result);
        });
    device
        .poll(wgpu::PollType::wait_indefinitely())
        .map_err(failed)?;
    receive.recv().map_err(failed)?.map_err(failed)?;
    let bytes = buffer.slice(..).get_mapped_range().map_err(failed)?;
    let mut triangle = Vec::with_capacity(width as usize * height as usize);
    for row in bytes.chunks_exact(stride as usize) {
        triangle.extend_from_slice(bytemuck::cast_slice::<u8, u32>(&row[..width as usize * 4]));
    }
    Ok(Visible { triangle })
}
