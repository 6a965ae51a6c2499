// Distances between all pairs of rows: a thread per pair, tiles of 16 × 16 pairs with their rows in workgroup
// memory, 16 columns at a time.

struct Task {
    rows: u32,
    width: u32,
    first: u32,  // row of the first thread
    unused: u32,
}

@group(0) @binding(0) var<uniform> task: Task;
@group(0) @binding(1) var<storage, read> rows: array<f32>;
@group(0) @binding(2) var<storage, read_write> distances: array<f32>;

var<workgroup> left: array<f32, 256>;
var<workgroup> right: array<f32, 256>;

@compute @workgroup_size(16, 16)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_id) local: vec3<u32>) {
    let i = task.first + group.y * 16u + local.y;
    let j = group.x * 16u + local.x;
    // The rows that this thread loads for all.
    let row = group.x * 16u + local.y;
    var sum = 0.0;
    for (var start = 0u; start < task.width; start += 16u) {
        let column = start + local.x;
        let slot = local.y * 16u + local.x;
        var a = 0.0;
        var b = 0.0;
        if column < task.width {
            if i < task.rows { a = rows[i * task.width + column]; }
            if row < task.rows { b = rows[row * task.width + column]; }
        }
        left[slot] = a;
        right[slot] = b;
        workgroupBarrier();
        for (var k = 0u; k < 16u; k += 1u) {
            let d = left[local.y * 16u + k] - right[local.x * 16u + k];
            sum += d * d;
        }
        workgroupBarrier();
    }
    if i < task.rows && j < task.rows {
        distances[(i - task.first) * task.rows + j] = sqrt(sum);
    }
}
