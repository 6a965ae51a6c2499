//! A GPU: device, queue and compiled pipelines, behind four verbs (`upload`, `output`, `dispatch`,
//! `download`), and a fifth, `together`, that hands over many dispatches at once. The only folder that knows wgpu.
//!
//! Memory is used again, calls of a batch are watched for errors together, and what goes up is copied once.
//!
//! A backend of a crate holds a [`Wgpu`], uploads what its kernel reads, makes an output, dispatches and downloads; the
//! driver's complaints come back as [`GpuError`] from whichever call made them, and nothing here panics for want of a
//! device. Every array is one binding, which limits it to [`GpuContext::max_buffer_bytes`]: longer ones are cut into
//! lots by the caller.

use std::collections::HashMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use bytemuck::{NoUninit, Pod};
use geom_shaders::Shader;
use memory::{Kind, Memory, Pool};

use crate::Backend;
use crate::compute::BackendError;
use crate::compute::usage::Usage;

mod memory;
mod pages;

pub use wgpu;

/// Longest wait for the device before it counts as hung.
const PATIENCE: Duration = Duration::from_secs(300);

/// Why the GPU cannot serve.
///
/// The first two say that there is no device, the next two that a request is beyond its limits; only
/// [`GpuError::Failed`] depends on the moment. There is no way back to a device that was lost: all later calls on its
/// context fail with the first reason that was given.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum GpuError {
    /// No adapter with compute shaders, or none of the asked name.
    #[error(
        "no GPU adapter with compute shaders{}; install a driver (a software one will do) or use the CPU backend",
        name.as_ref().map(|n| format!(" whose name contains {n:?}")).unwrap_or_default()
    )]
    NoAdapter {
        /// The name that was asked for.
        name: Option<String>,
    },
    /// The adapter refuses a device.
    #[error("{adapter} gives no device: {reason}")]
    NoDevice {
        /// Name of the adapter.
        adapter: String,
        /// What the driver says.
        reason: String,
    },
    /// A buffer is larger than the device allows.
    #[error("GPU buffer {label:?} needs {bytes} bytes, the device allows {limit}")]
    TooLarge {
        /// Name of the buffer.
        label: String,
        /// Its size.
        bytes: u64,
        /// The limit of the device.
        limit: u64,
    },
    /// A dispatch has more workgroups than the device allows.
    #[error("kernel {kernel} asks for {groups:?} workgroups, the device allows {limit} per axis")]
    TooManyGroups {
        /// Name of the kernel.
        kernel: &'static str,
        /// Workgroups asked for.
        groups: [u32; 3],
        /// The limit per axis.
        limit: u32,
    },
    /// The driver reports an error: out of memory, device lost, a kernel that is not valid.
    #[error("the GPU failed in {during}: {reason}")]
    Failed {
        /// What was being done.
        during: String,
        /// What the driver says.
        reason: String,
    },
}

impl From<GpuError> for BackendError {
    fn from(error: GpuError) -> Self {
        Self::new(error)
    }
}

/// A device, its queue, its limits and the pipelines compiled so far.
///
/// It may be shared by threads. Kernels run in the order in which they were handed over, whoever did that.
pub struct GpuContext {
    device: wgpu::Device,
    queue: wgpu::Queue,
    info: wgpu::AdapterInfo,
    limits: wgpu::Limits,
    /// By name of the kernel and its constants.
    pipelines: Mutex<HashMap<Specialized, Arc<wgpu::ComputePipeline>>>,
    pool: Arc<Pool>,
    usage: Mutex<Usage>,
    lost: Arc<Mutex<Option<String>>>,
}

/// A kernel by its name, and the numbers it was compiled for.
type Specialized = (&'static str, Vec<(&'static str, u32)>);

/// An array on the GPU.
///
/// It belongs to the context that made it, and its memory goes back to that one's pool when it is dropped. Kernels see
/// its length, of one element at least and rounded up to four bytes, not the length of the memory behind it.
pub struct GpuBuffer {
    memory: Arc<Memory>,
    /// What it holds, and what kernels see of it.
    bytes: u64,
    bound: u64,
    way: Mutex<Way>,
}

/// For whom an array travels.
#[derive(Clone, Copy)]
enum Way {
    /// Copied to the device for a kernel that is yet to come.
    Up,
    /// Made on the device, and handed to no kernel yet.
    Made,
    /// Handed to this kernel last.
    With(&'static str),
}

impl GpuContext {
    /// The best adapter at hand: discrete before integrated, virtual, other and software ones. The
    /// environment variable `WGPU_ADAPTER_NAME` asks for one whose name contains that text.
    ///
    /// # Errors
    /// [`GpuError::NoAdapter`] and [`GpuError::NoDevice`].
    pub fn new() -> Result<Self, GpuError> {
        let name = std::env::var("WGPU_ADAPTER_NAME")
            .ok()
            .filter(|n| !n.is_empty());
        let instance =
            wgpu::Instance::new(wgpu::InstanceDescriptor::new_without_display_handle_from_env());
        let mut adapters = pollster::block_on(instance.enumerate_adapters(wgpu::Backends::PRIMARY));
        // Of the adapters that compute, and bear the name asked for, the fastest kind first.
        adapters.retain(|a| {
            let fits = name
                .as_ref()
                .is_none_or(|n| a.get_info().name.to_lowercase().contains(&n.to_lowercase()));
            let compute = wgpu::DownlevelFlags::COMPUTE_SHADERS;
            fits && a.get_downlevel_capabilities().flags.contains(compute)
        });
        adapters.sort_by_key(|a| match a.get_info().device_type {
            wgpu::DeviceType::DiscreteGpu => 0,
            wgpu::DeviceType::IntegratedGpu => 1,
            wgpu::DeviceType::VirtualGpu => 2,
            wgpu::DeviceType::Other => 3,
            wgpu::DeviceType::Cpu => 4,
        });
        let adapter = adapters
            .into_iter()
            .next()
            .ok_or(GpuError::NoAdapter { name })?;
        let info = adapter.get_info();
        // The default limits stop at 128 MiB per binding; ask for all the adapter has.
        let limits = adapter.limits();
        let (device, queue) = pollster::block_on(adapter.request_device(&wgpu::DeviceDescriptor {
            label: Some("biogeom"),
            required_limits: limits.clone(),
            required_features: adapter.features()
                & (wgpu::Features::SUBGROUP | wgpu::Features::TIMESTAMP_QUERY),
            ..Default::default()
        }))
        .map_err(|e| GpuError::NoDevice {
            adapter: info.name.clone(),
            reason: e.to_string(),
        })?;

        // The default handlers panic; errors here are values.
        let lost = Arc::new(Mutex::new(None));
        let note = Arc::clone(&lost);
        device.on_uncaptured_error(Arc::new(move |error: wgpu::Error| {
            set_once(&note, error.to_string());
        }));
        let note = Arc::clone(&lost);
        device.set_device_lost_callback(move |reason, message| {
            if reason != wgpu::DeviceLostReason::Destroyed {
                set_once(&note, format!("device lost: {message}"));
            }
        });
        let pipelines = Mutex::new(HashMap::new());
        Ok(Self {
            device,
            queue,
            pool: Arc::new(Pool::of(info.device_type)),
            info,
            limits,
            pipelines,
            usage: Mutex::default(),
            lost,
        })
    }

    /// The kernels that ran so far, and what travelled for them. What programs draw is not counted.
    pub fn usage(&self) -> Usage {
        locked(&self.usage).clone()
    }

    /// Name of the adapter.
    pub fn adapter(&self) -> &str {
        &self.info.name
    }

    /// Is the adapter a program on the CPU?
    pub fn is_software(&self) -> bool {
        self.info.device_type == wgpu::DeviceType::Cpu
    }

    /// What the device allows.
    pub fn limits(&self) -> &wgpu::Limits {
        &self.limits
    }

    /// Largest array that one binding may hold, in bytes. The smaller of two limits of the device; WebGPU promises 128
    /// MiB.
    pub fn max_buffer_bytes(&self) -> u64 {
        self.limits
            .max_storage_buffer_binding_size
            .min(self.limits.max_buffer_size)
    }

    /// The device, for programs that draw.
    pub fn device(&self) -> &wgpu::Device {
        &self.device
    }

    /// The queue, for programs that draw.
    pub fn queue(&self) -> &wgpu::Queue {
        &self.queue
    }

    /// Copies an array to the GPU. An empty array becomes one zero element, since bindings may not
    /// be empty.
    ///
    /// # Errors
    /// [`GpuError::TooLarge`], and [`GpuError::Failed`] if the driver has no memory.
    pub fn upload<T: NoUninit>(&self, label: &str, data: &[T]) -> Result<GpuBuffer, GpuError> {
        self.written::<T>(label, data.len(), |memory| pages::write(data, memory))
    }

    /// Copies `f(0)`, `f(1)`, …, `f(len - 1)` to the GPU, without an array in between; many of them by all threads. `f` may
    /// be asked twice of a few.
    ///
    /// # Errors
    /// Those of [`GpuContext::upload`].
    pub fn upload_each<T: NoUninit>(
        &self,
        label: &str,
        len: usize,
        f: impl Fn(usize) -> T + Sync,
    ) -> Result<GpuBuffer, GpuError> {
        self.written::<T>(label, len, |memory| pages::write_each(len, f, memory))
    }

    /// An array of so many elements, written by `write` where the driver takes it from.
    fn written<T>(
        &self,
        label: &str,
        len: usize,
        write: impl FnOnce(wgpu::WriteOnly<'_, [u8]>),
    ) -> Result<GpuBuffer, GpuError> {
        let bytes = len.saturating_mul(size_of::<T>());
        self.array(label, bytes, size_of::<T>(), Way::Up, |array, _| {
            let bound = std::num::NonZero::new(array.bound).expect("an element at least");
            let view = self
                .queue
                .write_buffer_with(array.memory.buffer(), 0, bound);
            if let Some(mut view) = view {
                write(view.slice(..));
            }
        })
    }

    /// A small uniform: a struct of 16-byte aligned size. It is an array like the others, bound by its place among
    /// them.
    pub fn uniform<T: NoUninit>(&self, label: &str, value: &T) -> Result<GpuBuffer, GpuError> {
        self.upload(label, std::slice::from_ref(value))
    }

    /// An array of `len` zeros on the GPU. Memory that was used before is cleared on the device; nothing travels.
    ///
    /// # Errors
    /// Those of [`GpuContext::upload`].
    pub fn output<T: Pod>(&self, label: &str, len: usize) -> Result<GpuBuffer, GpuError> {
        let bytes = len.saturating_mul(size_of::<T>());
        self.array(label, bytes, size_of::<T>(), Way::Made, |array, again| {
            if again {
                let mut encoder = self.device.create_command_encoder(&Default::default());
                encoder.clear_buffer(array.memory.buffer(), 0, None);
                self.queue.submit([encoder.finish()]);
            }
        })
    }

    /// Memory for an array, filled by `fill`, which is told whether somebody used it before.
    fn array(
        &self,
        label: &str,
        bytes: usize,
        element: usize,
        way: Way,
        fill: impl FnOnce(&GpuBuffer, bool),
    ) -> Result<GpuBuffer, GpuError> {
        let (bytes, limit) = (bytes as u64, self.max_buffer_bytes());
        if bytes > limit {
            return Err(GpuError::TooLarge {
                label: label.to_owned(),
                bytes,
                limit,
            });
        }
        let bound = bytes.max(element as u64).next_multiple_of(4);
        self.watched(label, || {
            let (memory, again) = self.pool.take(&self.device, Kind::Storage, bound);
            let array = GpuBuffer {
                memory: Arc::new(memory),
                bytes,
                bound,
                way: Mutex::new(way),
            };
            fill(&array, again);
            array
        })
    }

    /// Runs a kernel over `groups` workgroups. The buffers stand in binding order of group 0. Each is a storage or a
    /// uniform binding, as the shader declares it; all that it uses must be given, and no others. With a 0 among the
    /// groups nothing runs, and nothing is counted.
    ///
    /// # Errors
    /// [`GpuError::TooManyGroups`] before anything is handed over, [`GpuError::Failed`] if the driver refuses kernel or
    /// bindings. What the kernel writes is known after [`GpuContext::download`] only.
    pub fn dispatch(
        &self,
        shader: &Shader,
        bindings: &[&GpuBuffer],
        groups: [u32; 3],
    ) -> Result<(), GpuError> {
        self.together(shader.name, |batch| {
            batch.dispatch(shader, bindings, groups)
        })
    }

    /// Hands several kernels to the device at once: one submission, watched as one. They run one after another; each
    /// sees what those before it wrote. Nothing runs if `record` fails. Worth it for chains of short kernels, since
    /// every submission waits for the driver's complaints.
    ///
    /// # Errors
    /// That of `record`, or those of [`GpuContext::dispatch`].
    pub fn together<T, E: From<GpuError>>(
        &self,
        during: &str,
        record: impl FnOnce(&mut Batch<'_>) -> Result<T, E>,
    ) -> Result<T, E> {
        let mut batch = Batch {
            gpu: self,
            calls: Vec::new(),
        };
        let result = record(&mut batch)?;
        batch.submit(during)?;
        Ok(result)
    }

    /// Counts a dispatch, and what was copied to the device for it.
    fn note(&self, kernel: &'static str, bindings: &[&GpuBuffer], groups: [u32; 3]) {
        let mut usage = locked(&self.usage);
        let used = usage.of(kernel);
        used.calls += 1;
        used.workgroups += groups.iter().map(|&g| u64::from(g)).product::<u64>();
        for buffer in bindings {
            let before = std::mem::replace(&mut *locked(&buffer.way), Way::With(kernel));
            if let Way::Up = before {
                used.bytes_up += buffer.bytes;
            }
        }
    }

    /// Copies an array back; waits for all work before it.
    ///
    /// # Errors
    /// [`GpuError::Failed`] when the device is lost or has not finished within five minutes.
    pub fn download<T: Pod + Send + Sync>(&self, buffer: &GpuBuffer) -> Result<Vec<T>, GpuError> {
        self.download_first(buffer, buffer.bytes as usize / size_of::<T>())
    }

    /// Copies the first elements of an array back, all of them if it has fewer. For outputs whose count is known only
    /// afterwards: the host pays for what it takes.
    ///
    /// # Errors
    /// Those of [`GpuContext::download`].
    pub fn download_first<T: Pod + Send + Sync>(
        &self,
        buffer: &GpuBuffer,
        len: usize,
    ) -> Result<Vec<T>, GpuError> {
        self.read_first(buffer, len, pages::copied)
    }

    /// Lets `f` read an array where the driver put it, without a copy of its own; waits for all work before it.
    ///
    /// # Errors
    /// Those of [`GpuContext::download`].
    pub fn read<T: Pod, R>(
        &self,
        buffer: &GpuBuffer,
        f: impl FnOnce(&[T]) -> R,
    ) -> Result<R, GpuError> {
        self.read_first(buffer, buffer.bytes as usize / size_of::<T>(), f)
    }

    fn read_first<T: Pod, R>(
        &self,
        buffer: &GpuBuffer,
        len: usize,
        f: impl FnOnce(&[T]) -> R,
    ) -> Result<R, GpuError> {
        let wanted = buffer.bytes.min((len * size_of::<T>()) as u64);
        if wanted == 0 {
            return Ok(f(&[]));
        }
        let bytes = wanted.next_multiple_of(4);
        let (staging, submission) = self.watched("download", || {
            let (staging, _) = self.pool.take(&self.device, Kind::Staging, bytes);
            let mut encoder = self.device.create_command_encoder(&Default::default());
            encoder.copy_buffer_to_buffer(buffer.memory.buffer(), 0, staging.buffer(), 0, bytes);
            (staging, self.queue.submit([encoder.finish()]))
        })?;
        let failed = |reason: String| GpuError::Failed {
            during: "download".to_owned(),
            reason,
        };
        let (sender, receiver) = std::sync::mpsc::channel();
        let mapped = staging.buffer().slice(..bytes);
        mapped.map_async(wgpu::MapMode::Read, move |outcome| {
            let _ = sender.send(outcome);
        });
        // Not for what other threads have handed over since.
        self.device
            .poll(wgpu::PollType::Wait {
                submission_index: Some(submission),
                timeout: Some(PATIENCE),
            })
            .map_err(|e| failed(e.to_string()))?;
        receiver
            .recv()
            .map_err(|e| failed(e.to_string()))?
            .map_err(|e| failed(e.to_string()))?;
        self.check_lost("download")?;
        let result = {
            let view = mapped
                .get_mapped_range()
                .map_err(|e| failed(e.to_string()))?;
            let content = &view[..wanted as usize];
            // As it is, where the driver maps at an address that suits the type.
            match bytemuck::try_cast_slice::<u8, T>(content) {
                Ok(content) => f(content),
                Err(_) => f(&bytemuck::pod_collect_to_vec::<u8, T>(content)),
            }
        };
        staging.buffer().unmap();
        if let Way::With(kernel) = *locked(&buffer.way) {
            locked(&self.usage).of(kernel).bytes_down += wanted;
        }
        Ok(result)
    }

    /// Compiled once per kernel and set of constants, and kept as long as the context: what the driver takes for that
    /// is paid on the first call.
    fn pipeline(
        &self,
        shader: &Shader,
        constants: &[(&'static str, u32)],
    ) -> Arc<wgpu::ComputePipeline> {
        let mut pipelines = locked(&self.pipelines);
        let key = (shader.name, constants.to_vec());
        let compiled = pipelines.entry(key).or_insert_with(|| {
            let module = self
                .device
                .create_shader_module(wgpu::ShaderModuleDescriptor {
                    label: Some(shader.name),
                    source: wgpu::ShaderSource::Wgsl(shader.source.into()),
                });
            let constants: Vec<(&str, f64)> =
                constants.iter().map(|&(n, v)| (n, v.into())).collect();
            Arc::new(
                self.device
                    .create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
                        label: Some(shader.name),
                        layout: None,
                        module: &module,
                        entry_point: Some("main"),
                        compilation_options: wgpu::PipelineCompilationOptions {
                            constants: &constants,
                            ..Default::default()
                        },
                        cache: None,
                    }),
            )
        });
        Arc::clone(compiled)
    }

    /// Does something on the device, and turns the driver's complaints into an error. For programs
    /// that use [`GpuContext::device`] themselves.
    ///
    /// # Errors
    /// [`GpuError::Failed`] with what the driver said first, during this call or since it was lost.
    pub fn watched<T>(&self, during: &str, work: impl FnOnce() -> T) -> Result<T, GpuError> {
        let scopes = [
            wgpu::ErrorFilter::Internal,
            wgpu::ErrorFilter::OutOfMemory,
            wgpu::ErrorFilter::Validation,
        ]
        .map(|filter| self.device.push_error_scope(filter));
        let result = work();
        let mut complaint = None;
        for scope in scopes.into_iter().rev() {
            complaint = complaint.or(pollster::block_on(scope.pop()));
        }
        match complaint {
            Some(error) => Err(GpuError::Failed {
                during: during.to_owned(),
                reason: error.to_string(),
            }),
            None => self.check_lost(during).map(|()| result),
        }
    }

    /// Errors that no scope caught, from any call before, are found here.
    fn check_lost(&self, during: &str) -> Result<(), GpuError> {
        match &*locked(&self.lost) {
            Some(reason) => Err(GpuError::Failed {
                during: during.to_owned(),
                reason: reason.clone(),
            }),
            None => Ok(()),
        }
    }
}

/// Kernels that are handed over together: see [`GpuContext::together`]. Recording hands nothing to the device: kernels
/// and arrays are noted and go there together at the end.
pub struct Batch<'a> {
    gpu: &'a GpuContext,
    calls: Vec<Call>,
}

/// A kernel with what it is to work on. The memory is held until it has been handed over: else it could be used again,
/// and written, before.
struct Call {
    shader: Shader,
    constants: Vec<(&'static str, u32)>,
    /// Arrays, and what the kernel sees of each.
    bindings: Vec<(Arc<Memory>, u64)>,
    groups: [u32; 3],
}

impl<'a> Batch<'a> {
    /// The device, for arrays of the kernels to come.
    pub fn gpu(&self) -> &'a GpuContext {
        self.gpu
    }

    /// Adds a kernel: see [`GpuContext::dispatch`].
    ///
    /// # Errors
    /// [`GpuError::TooManyGroups`].
    pub fn dispatch(
        &mut self,
        shader: &Shader,
        bindings: &[&GpuBuffer],
        groups: [u32; 3],
    ) -> Result<(), GpuError> {
        self.dispatch_for(shader, &[], bindings, groups)
    }

    /// Adds a kernel that is compiled for given values of its `override` constants.
    ///
    /// # Errors
    /// [`GpuError::TooManyGroups`].
    pub fn dispatch_for(
        &mut self,
        shader: &Shader,
        constants: &[(&'static str, u32)],
        bindings: &[&GpuBuffer],
        groups: [u32; 3],
    ) -> Result<(), GpuError> {
        let gpu = self.gpu;
        let limit = gpu.limits.max_compute_workgroups_per_dimension;
        if groups.iter().any(|&g| g > limit) {
            return Err(GpuError::TooManyGroups {
                kernel: shader.name,
                groups,
                limit,
            });
        }
        if groups.contains(&0) {
            return Ok(());
        }
        self.calls.push(Call {
            shader: *shader,
            constants: constants.to_vec(),
            bindings: bindings
                .iter()
                .map(|b| (Arc::clone(&b.memory), b.bound))
                .collect(),
            groups,
        });
        gpu.note(shader.name, bindings, groups);
        Ok(())
    }

    /// One encoder with a pass per kernel, so that the driver puts barriers between them; compiled pipelines are looked
    /// up under the same watch.
    fn submit(self, during: &str) -> Result<(), GpuError> {
        let gpu = self.gpu;
        if self.calls.is_empty() {
            return Ok(());
        }
        gpu.watched(during, || {
            let mut encoder = gpu.device.create_command_encoder(&Default::default());
            for call in &self.calls {
                let pipeline = gpu.pipeline(&call.shader, &call.constants);
                let entries: Vec<_> = (0..)
                    .zip(&call.bindings)
                    .map(|(binding, (memory, bound))| wgpu::BindGroupEntry {
                        binding,
                        resource: wgpu::BindingResource::Buffer(wgpu::BufferBinding {
                            buffer: memory.buffer(),
                            offset: 0,
                            // Kernels may ask for the length, and memory that is used again may be longer.
                            size: std::num::NonZero::new(*bound),
                        }),
                    })
                    .collect();
                let bindings = gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
                    label: Some(call.shader.name),
                    layout: &pipeline.get_bind_group_layout(0),
                    entries: &entries,
                });
                let mut pass = encoder.begin_compute_pass(&Default::default());
                pass.set_pipeline(&pipeline);
                pass.set_bind_group(0, &bindings, &[]);
                let [x, y, z] = call.groups;
                pass.dispatch_workgroups(x, y, z);
            }
            gpu.queue.submit([encoder.finish()]);
        })
    }
}

fn set_once(slot: &Mutex<Option<String>>, reason: String) {
    locked(slot).get_or_insert(reason);
}

/// Nothing that is locked here is left half done by a panic.
fn locked<T>(of: &Mutex<T>) -> MutexGuard<'_, T> {
    of.lock().unwrap_or_else(PoisonError::into_inner)
}

/// The GPU as a backend: a cheap handle to a [`GpuContext`]. Clones share device, pipelines and memory. All crates'
/// kernels run on the same one, so a program makes it once.
#[derive(Clone)]
pub struct Wgpu {
    context: Arc<GpuContext>,
}

impl Wgpu {
    /// The best adapter at hand; an error if there is none. There is no silent fallback.
    pub fn new() -> Result<Self, GpuError> {
        GpuContext::new().map(Self::from)
    }

    /// The device and its verbs.
    pub fn gpu(&self) -> &GpuContext {
        &self.context
    }
}

impl From<GpuContext> for Wgpu {
    fn from(context: GpuContext) -> Self {
        Self {
            context: Arc::new(context),
        }
    }
}

impl Backend for Wgpu {
    fn name(&self) -> String {
        format!("wgpu ({})", self.context.adapter())
    }
}
