// The dual vertex of each cell, in units of the cell: the mean of the crossings of its edges, then
// regularized Newton steps onto the level set of the trilinear interpolant.

@group(0) @binding(0) var<storage, read> values: array<f32>; // 8 per cell, minus the level; corner x + 2y + 4z
@group(0) @binding(1) var<uniform> steps: vec4<u32>; // x: cells, y: Newton steps, z: cells per row of groups
@group(0) @binding(2) var<storage, read_write> points: array<f32>; // 3 per cell

const INSET = 0.01;
const REGULAR = 0.01;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    let cell = id.y * steps.z + id.x;
    if id.x >= steps.z || cell >= steps.x {
        return;
    }
    var v: array<f32, 8>;
    var low = values[8u * cell];
    var high = low;
    for (var i = 0u; i < 8u; i += 1u) {
        v[i] = values[8u * cell + i];
        low = min(low, v[i]);
        high = max(high, v[i]);
    }
    var sum = vec3(0.0);
    var n = 0.0;
    for (var axis = 0u; axis < 3u; axis += 1u) {
        for (var i = 0u; i < 8u; i += 1u) {
            let j = i | (1u << axis);
            if i != j && (v[i] >= 0.0) != (v[j] >= 0.0) {
                var p = vec3(f32(i & 1u), f32((i >> 1u) & 1u), f32(i >> 2u));
                p[axis] = v[i] / (v[i] - v[j]);
                sum += p;
                n += 1.0;
            }
        }
    }
    var x = vec3(0.5);
    if n > 0.0 {
        x = clamp(sum / n, vec3(INSET), vec3(1.0 - INSET));
    }
    let floor = REGULAR * (high - low) * (high - low);
    for (var step = 0u; step < steps.y; step += 1u) {
        let x00 = mix(v[0], v[1], x.x);
        let x10 = mix(v[2], v[3], x.x);
        let x01 = mix(v[4], v[5], x.x);
        let x11 = mix(v[6], v[7], x.x);
        let y0 = mix(x00, x10, x.y);
        let y1 = mix(x01, x11, x.y);
        let f = mix(y0, y1, x.z);
        let g = vec3(
            mix(mix(v[1] - v[0], v[3] - v[2], x.y), mix(v[5] - v[4], v[7] - v[6], x.y), x.z),
            mix(x10 - x00, x11 - x01, x.z),
            y1 - y0,
        );
        x = clamp(x - g * (f / (dot(g, g) + floor)), vec3(INSET), vec3(1.0 - INSET));
    }
    points[3u * cell] = x.x;
    points[3u * cell + 1u] = x.y;
    points[3u * cell + 2u] = x.z;
}
