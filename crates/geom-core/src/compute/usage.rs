//! What a device was asked to do: which kernels, how often, and what travelled for them.
//!
//! An array is charged to the first kernel that is handed it, and its way back to the last one: so the sum over all
//! kernels is what travelled for them, and none of it counts twice.

use std::collections::BTreeMap;

/// What a kernel was asked to do. Counts only grow; two of them can be subtracted by [`Usage::since`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct KernelUsage {
    /// Dispatches.
    pub calls: u64,
    /// Workgroups of all of them.
    pub workgroups: u64,
    /// Bytes that were copied to the device for it: arrays that it was the first to be handed.
    pub bytes_up: u64,
    /// Bytes that were copied back of arrays that it was the last to be handed.
    pub bytes_down: u64,
}

/// Kernels by name. Those of a time follow from what was counted at its start and at its end.
///
/// ```no_run
/// use geom_core::Wgpu;
/// let gpu = Wgpu::new()?;
/// let before = gpu.gpu().usage();
/// // … work …
/// for (kernel, used) in gpu.gpu().usage().since(&before).kernels() {
///     println!("{kernel}: {} calls, {} bytes up", used.calls, used.bytes_up);
/// }
/// # Ok::<(), geom_core::compute::gpu::GpuError>(())
/// ```
#[derive(Clone, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct Usage(BTreeMap<&'static str, KernelUsage>);

impl Usage {
    /// Each kernel with what it was asked to do, by name.
    pub fn kernels(&self) -> impl Iterator<Item = (&'static str, &KernelUsage)> {
        self.0.iter().map(|(name, used)| (*name, used))
    }

    /// Did no kernel run?
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// Of all kernels together.
    pub fn total(&self) -> KernelUsage {
        let mut sum = KernelUsage::default();
        for used in self.0.values() {
            sum.calls += used.calls;
            sum.workgroups += used.workgroups;
            sum.bytes_up += used.bytes_up;
            sum.bytes_down += used.bytes_down;
        }
        sum
    }

    /// What came after `earlier`, a count of the same device. Kernels that did nothing in between are left out.
    #[must_use]
    pub fn since(&self, earlier: &Self) -> Self {
        let newer = |(&name, now): (&&'static str, &KernelUsage)| {
            let before = earlier.0.get(name).copied().unwrap_or_default();
            let used = KernelUsage {
                calls: now.calls - before.calls,
                workgroups: now.workgroups - before.workgroups,
                bytes_up: now.bytes_up - before.bytes_up,
                bytes_down: now.bytes_down - before.bytes_down,
            };
            (used != KernelUsage::default()).then_some((name, used))
        };
        Self(self.0.iter().filter_map(newer).collect())
    }

    #[cfg(feature = "wgpu")]
    pub(super) fn of(&mut self, kernel: &'static str) -> &mut KernelUsage {
        self.0.entry(kernel).or_default()
    }
}
