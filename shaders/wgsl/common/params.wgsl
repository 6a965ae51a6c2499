// What most kernels of the density are told of their task.

struct Params {
    depth: u32,
    // Threads that have something to do.
    count: u32,
    pad0: u32,
    pad1: u32,
}

@group(0) @binding(0) var<uniform> params: Params;
