// Nodes at rest and now, and who is near whom.

struct Task {
    nodes: u32,
    unused0: u32,
    unused1: u32,
    unused2: u32,
}

@group(0) @binding(0) var<uniform> task: Task;
@group(0) @binding(1) var<storage, read> rest: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> now: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read> starts: array<u32>; // nodes + 1
@group(0) @binding(4) var<storage, read> others: array<u32>;
