// How much of the nodes near each node falls into each bar. A workgroup per node: its threads share the nodes of the cubes
// around it, which stand in rows of up to three cubes, and add up whole numbers.

struct Task {
    nodes: u32,
    bars: u32,
    reach: u32,
    one: u32,
    // The corner of the first cube, and spacings along a cube.
    low: vec3<i32>,
    side: i32,
    // Cubes per axis.
    cubes: vec3<i32>,
    unused: u32,
}

@group(0) @binding(0) var<uniform> task: Task;
@group(0) @binding(1) var<storage, read> points: array<vec4<i32>>; // cube after cube; last where it falls among the bars
@group(0) @binding(2) var<storage, read> starts: array<u32>;       // of each cube
@group(0) @binding(3) var<storage, read_write> rows: array<u32>;

var<workgroup> bars: array<atomic<u32>, 24>;

@compute @workgroup_size(64)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) thread: u32,
) {
    let node = group.y * groups.x + group.x;
    if node >= task.nodes { return; }
    if thread < task.bars { atomicStore(&bars[thread], 0u); }
    workgroupBarrier();
    let p = points[node].xyz;
    let at = (p - task.low) / task.side;
    let first = max(at - 1, vec3<i32>());
    let last = min(at + 1, task.cubes - 1);
    for (var z = first.z; z <= last.z; z += 1) {
        for (var y = first.y; y <= last.y; y += 1) {
            let row = task.cubes.x * (y + task.cubes.y * z);
            let end = starts[row + last.x + 1];
            for (var n = starts[row + first.x] + thread; n < end; n += 64u) {
                let q = points[n];
                let d = vec3<u32>(abs(q.xyz - p));
                if d.x * d.x + d.y * d.y + d.z * d.z <= task.reach {
                    let place = u32(q.w);
                    let low = min(place / task.one, task.bars - 2u);
                    let high = place - low * task.one;
                    atomicAdd(&bars[low], task.one - high);
                    atomicAdd(&bars[low + 1u], high);
                }
            }
        }
    }
    workgroupBarrier();
    if thread < task.bars { rows[node * task.bars + thread] = atomicLoad(&bars[thread]); }
}
