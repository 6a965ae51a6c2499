// The nearest target of each query: a thread per query. Queries are stored column by column, so that the threads of a
// group read side by side; all of them read the same target.

struct Task {
    queries: u32,
    targets: u32,
    width: u32,
    unused: u32,
}

@group(0) @binding(0) var<uniform> task: Task;
@group(0) @binding(1) var<storage, read> queries: array<f32>;
@group(0) @binding(2) var<storage, read> targets: array<f32>;
@group(0) @binding(3) var<storage, read_write> nearest: array<u32>;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let i = id.y * groups.x * 64u + id.x;
    if i >= task.queries { return; }
    var best = 0u;
    var least = 3.0e38;
    for (var t = 0u; t < task.targets; t += 1u) {
        var square = 0.0;
        for (var c = 0u; c < task.width; c += 1u) {
            let d = queries[c * task.queries + i] - targets[t * task.width + c];
            square += d * d;
        }
        if square < least {
            least = square;
            best = t;
        }
    }
    nearest[i] = best;
}
