// The second and third passes of an exact distance transform, and the first one if inside is FAR: along an axis, the least
// of the values there plus the squares of their steps; beyond the ends lies 0. A thread per point looks outwards until a step
// alone is longer than what it has, which is soon: no farther than the point is deep.

struct Task {
    points: u32,
    // Points along the axis, and how far the next one is in the array.
    count: u32,
    stride: u32,
    unused: u32,
}

@group(0) @binding(0) var<uniform> task: Task;
@group(0) @binding(1) var<storage, read> before: array<u32>;
@group(0) @binding(2) var<storage, read_write> squares: array<u32>;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let i = id.y * groups.x * 64u + id.x;
    if i >= task.points { return; }
    let t = (i / task.stride) % task.count;
    var best = before[i];
    for (var r = 1u; r * r < best; r += 1u) {
        var lower = 0u;
        if r <= t { lower = before[i - r * task.stride]; }
        var upper = 0u;
        if t + r < task.count { upper = before[i + r * task.stride]; }
        best = min(best, min(lower, upper) + r * r);
    }
    squares[i] = best;
}
