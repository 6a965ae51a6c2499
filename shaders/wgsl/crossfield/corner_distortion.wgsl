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
    let made = corner_distortion(next, previous, normal, p.epsilon);
    out[2u * i] = vec4<f32>(made.energy, made.area, made.first.xy);
    out[2u * i + 1u] = vec4<f32>(made.first.z, made.second);
}
