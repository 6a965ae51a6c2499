// The stiffness of patches applied to the surface itself, a patch per group: first the surface at up to 64 points, a thread
// per point, then a thread per function, and so on with the next points.

@group(0) @binding(4) var<storage, read_write> forces: array<vec4<f32>>; // per patch and function

var<workgroup> along: array<vec4<f32>, 64>;  // A^{1b} x_b, with the weight
var<workgroup> across: array<vec3<f32>, 64>; // A^{2b} x_b

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let own = group.x;
    let n = task.functions;
    for (var first = 0u; first < task.points; first += 64u) {
        let count = min(64u, task.points - first);
        if lane < count {
            let point = at(own, first + lane);
            let a = point.conductivity;
            along[lane] = vec4<f32>(point.u * a.x + point.v * a.y, point.weight);
            across[lane] = point.u * a.y + point.v * a.z;
        }
        workgroupBarrier();
        for (var k = lane; k < n; k += 64u) {
            var sum = vec3<f32>(0.0);
            for (var q = 0u; q < count; q += 1u) {
                if along[q].w == 0.0 { continue; }
                let row = (first + q) * 6u * n;
                sum += along[q].xyz * basis[row + n + k] + across[q] * basis[row + 2u * n + k];
            }
            if first > 0u { sum += forces[own * n + k].xyz; }
            forces[own * n + k] = vec4<f32>(sum, 0.0);
        }
        workgroupBarrier();
    }
}
