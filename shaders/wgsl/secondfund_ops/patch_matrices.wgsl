// The matrices of patches, a patch per group: first the surface at up to 64 points, a thread per point, then the entries
// of the upper halves, summed over these points, and so on with the next points.

@group(0) @binding(4) var<storage, read_write> matrices: array<f32>; // per patch stiffness, mass, sums, points left out

var<workgroup> conductivities: array<vec4<f32>, 64>; // with the weight
var<workgroup> curvatures: array<vec2<f32>, 64>;

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let own = group.x;
    let n = task.functions;
    let entries = n * (n + 1u) / 2u;
    let sums = select(entries, 2u * entries, task.mass == 1u);
    let start = own * (sums + 3u * n + 1u);
    var skipped = 0u;
    for (var first = 0u; first < task.points; first += 64u) {
        let count = min(64u, task.points - first);
        if lane < count {
            let point = at(own, first + lane);
            conductivities[lane] = vec4<f32>(point.conductivity, point.weight);
            curvatures[lane] = vec2<f32>(point.mean, point.gauss);
        }
        workgroupBarrier();
        // Entry (i, j) of the packed upper half, row after row.
        var i = 0u;
        var j = lane;
        for (var entry = lane; entry < entries; entry += 64u) {
            while j >= n {
                i += 1u;
                j = j - n + i;
            }
            var stiffness = 0.0;
            var mass = 0.0;
            for (var q = 0u; q < count; q += 1u) {
                let a = conductivities[q];
                if a.w == 0.0 { continue; }
                let row = (first + q) * 6u * n;
                let x = vec2<f32>(basis[row + n + i], basis[row + 2u * n + i]);
                let y = vec2<f32>(basis[row + n + j], basis[row + 2u * n + j]);
                stiffness += (a.x * x.x + a.y * x.y) * y.x + (a.y * x.x + a.z * x.y) * y.y;
                mass += a.w * basis[row + i] * basis[row + j];
            }
            if first > 0u { stiffness += matrices[start + entry]; }
            matrices[start + entry] = stiffness;
            if task.mass == 1u {
                if first > 0u { mass += matrices[start + entries + entry]; }
                matrices[start + entries + entry] = mass;
            }
            j += 64u;
        }
        for (var k = lane; k < n; k += 64u) {
            var sum = vec3<f32>(0.0);
            for (var q = 0u; q < count; q += 1u) {
                let weight = conductivities[q].w;
                if weight == 0.0 { continue; }
                sum += vec3<f32>(1.0, curvatures[q]) * (weight * basis[(first + q) * 6u * n + k]);
            }
            let slot = start + sums + 3u * k;
            if first > 0u { sum += vec3<f32>(matrices[slot], matrices[slot + 1u], matrices[slot + 2u]); }
            matrices[slot] = sum.x;
            matrices[slot + 1u] = sum.y;
            matrices[slot + 2u] = sum.z;
        }
        if lane == 0u {
            for (var q = 0u; q < count; q += 1u) {
                skipped += select(0u, 1u, conductivities[q].w == 0.0);
            }
        }
        workgroupBarrier();
    }
    if lane == 0u { matrices[start + sums + 3u * n] = f32(skipped); }
}
