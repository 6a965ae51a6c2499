// How far each corner of a quad is from a right angle, and the derivatives, CornerDistortion of geom-core: one corner per thread.

struct Parameters { count: u32, epsilon: f32 }

@group(0) @binding(0) var<storage, read> corners: array<vec4<f32>>; // three per corner: next, previous, normal
@group(0) @binding(1) var<storage, read_write> out: array<vec4<f32>>; // two per corner
@group(0) @binding(2) var<uniform> parameters: Parameters;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let i = id.y * groups.x * 64u + id.x;
    if i >= parameters.count { return; }
    let p = corners[3u * i].xyz;
    let s = corners[3u * i + 1u].xyz;
    let n = corners[3u * i + 2u].xyz;
    let squared = parameters.epsilon * parameters.epsilon;
    let area = dot(n, cross(p, s));
    let root = sqrt(area * area + squared);
    // The sum loses its digits where the corner is inverted.
    var bottom = area + root;
    if area < 0.0 { bottom = squared / (root - area); }
    // Not finite numbers are no numbers in WGSL: an inverted corner without regularization is very bad.
    bottom = max(bottom, 1e-30);
    let slope = bottom / max(root, 1e-30);
    let top = dot(p, p) + dot(s, s);
    let along = top / bottom * (slope / bottom);
    let first = p * (2.0 / bottom) - cross(s, n) * along;
    let second = s * (2.0 / bottom) - cross(n, p) * along;
    out[2u * i] = vec4<f32>(top / bottom, area, first.xy);
    out[2u * i + 1u] = vec4<f32>(first.z, second);
}
