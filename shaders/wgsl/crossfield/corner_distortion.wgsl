// How far each corner of a quad is from a right angle, and the derivatives: one corner per thread.

struct Parameters { count: u32, epsilon: f32 }

@group(0) @binding(0) var<storage, read> corners: array<vec4<f32>>; // three per corner: next, previous, normal
@group(0) @binding(1) var<storage, read_write> out: array<vec4<f32>>; // two per corner
@group(0) @binding(2) var<uniform> p: Parameters;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let i = id.y * groups.x * 64u + id.x;
    if i >= p.count { return; }
    let next = corners[3u * i].xyz;
    let previous = corners[3u * i + 1u].xyz;
    let normal = corners[3u * i + 2u].xyz;
    let area = dot(normal, cross(next, previous));
    let root = sqrt(area * area + p.epsilon * p.epsilon);
    // The sum loses its digits where the corner is inverted.
    var bottom = area + root;
    if area < 0.0 { bottom = p.epsilon * p.epsilon / (root - area); }
    // Not finite numbers are no numbers in WGSL: an inverted corner without regularization is very bad.
    bottom = max(bottom, 1e-30);
    let slope = bottom / max(root, 1e-30);
    let top = dot(next, next) + dot(previous, previous);
    let along = top / bottom * (slope / bottom);
    let to_next = next * (2.0 / bottom) - cross(previous, normal) * along;
    let to_previous = previous * (2.0 / bottom) - cross(normal, next) * along;
    out[2u * i] = vec4<f32>(top / bottom, area, to_next.x, to_next.y);
    out[2u * i + 1u] = vec4<f32>(to_next.z, to_previous);
}
