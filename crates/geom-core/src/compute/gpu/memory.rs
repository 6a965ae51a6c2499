//! Memory of the device that is used again: arrays of a size are handed on to the next that asks for as much, since a
//! driver takes as long to find memory as many kernels to use it.
//!
//! Sizes are powers of two from 4 KiB to 64 MiB, so that arrays of nearly the same length take turns in the same
//! memory; larger ones are made and given back as asked for. But for the smallest, at most half of an array is thus
//! unused, and at most 256 MiB lie idle, 1 GiB on a card of its own: pages that a device may read cost half a
//! millisecond per MiB to make, measured.

use std::collections::HashMap;
use std::sync::{Arc, Mutex};

use super::locked;

/// Most bytes that lie idle, of either kind: in memory that others want, too, and on a card.
const IDLE: u64 = 256 << 20;
const IDLE_ON_A_CARD: u64 = 1 << 30;
/// Arrays of more than this are given back at once.
const LARGEST: u64 = 64 << 20;
/// What the smallest arrays take.
const SMALLEST: u64 = 1 << 12;

/// What arrays are for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) enum Kind {
    /// Handed to kernels.
    Storage,
    /// Read by the host.
    Staging,
}

impl Kind {
    fn usage(self) -> wgpu::BufferUsages {
        match self {
            Self::Storage => wgpu::BufferUsages::STORAGE
                .union(wgpu::BufferUsages::UNIFORM)
                .union(wgpu::BufferUsages::COPY_SRC)
                .union(wgpu::BufferUsages::COPY_DST),
            Self::Staging => wgpu::BufferUsages::COPY_DST.union(wgpu::BufferUsages::MAP_READ),
        }
    }
}

/// Arrays that nobody uses now, by kind and size. Held by the context and by all its arrays: memory may come back after
/// the context is gone.
pub(super) struct Pool {
    idle: Mutex<Idle>,
    most: u64,
}

#[derive(Default)]
struct Idle {
    arrays: HashMap<(Kind, u64), Vec<wgpu::Buffer>>,
    bytes: u64,
}

impl Pool {
    pub(super) fn of(device: wgpu::DeviceType) -> Self {
        let most = match device {
            wgpu::DeviceType::DiscreteGpu => IDLE_ON_A_CARD,
            _ => IDLE,
        };
        Self {
            idle: Mutex::default(),
            most,
        }
    }

    /// An array of at least so many bytes; whether somebody used it before, so that it holds what it held then. What is
    /// left from before is the caller's to overwrite or to clear.
    pub(super) fn take(
        self: &Arc<Self>,
        device: &wgpu::Device,
        kind: Kind,
        bytes: u64,
    ) -> (Memory, bool) {
        let size = if bytes > LARGEST {
            bytes
        } else {
            bytes.next_power_of_two().max(SMALLEST)
        };
        let mut idle = locked(&self.idle);
        let used = idle.arrays.get_mut(&(kind, size)).and_then(Vec::pop);
        if used.is_some() {
            idle.bytes -= size;
        }
        drop(idle);
        let again = used.is_some();
        let buffer = used.unwrap_or_else(|| {
            device.create_buffer(&wgpu::BufferDescriptor {
                label: None,
                size,
                usage: kind.usage(),
                mapped_at_creation: false,
            })
        });
        let pool = Arc::clone(self);
        let memory = Memory {
            buffer: Some(buffer),
            pool,
            kind,
            size,
        };
        (memory, again)
    }
}

/// An array of the device that goes back to where it came from. Dropping it is safe while kernels still read it: the
/// queue is in order, and what writes the memory next comes after them.
pub(super) struct Memory {
    /// `None` once it has gone.
    buffer: Option<wgpu::Buffer>,
    pool: Arc<Pool>,
    kind: Kind,
    size: u64,
}

impl Memory {
    pub(super) fn buffer(&self) -> &wgpu::Buffer {
        self.buffer.as_ref().expect("there until it is dropped")
    }
}

impl Drop for Memory {
    /// Back into the pool if there is room, else to the driver.
    fn drop(&mut self) {
        let mut idle = locked(&self.pool.idle);
        if self.size > LARGEST || idle.bytes + self.size > self.pool.most {
            return;
        }
        if let Some(buffer) = self.buffer.take() {
            idle.bytes += self.size;
            idle.arrays
                .entry((self.kind, self.size))
                .or_default()
                .push(buffer);
        }
    }
}
