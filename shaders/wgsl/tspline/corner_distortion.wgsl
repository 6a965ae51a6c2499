// How far each corner of a mesh is from its ideal, and the derivatives: one corner per thread.

struct Parameters { count: u32, epsilon: f32 }
struct Corner { first: vec4<f32>, second: vec4<f32>, normal: vec4<f32>, rest: vec4<f32> }

@group(0) @binding(0) var<storage, read> corners: array<Corner>;
@group(0) @binding(1) var<storage, read_write> out: array<vec4<f32>>; // two per corner
@group(0) @binding(2) var<uniform> parameters: Parameters;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let i = id.y * groups.x * 64u + id.x;
    if i >= parameters.count { return; }
    let corner = corners[i];
    // Rows of the inverse of the ideal edges.
    let upper = vec2<f32>(corner.first.w, corner.second.w);
    let lower = vec2<f32>(corner.normal.w, corner.rest.x);
    let p = corner.first.xyz * upper.x + corner.second.xyz * lower.x;
    let s = corner.first.xyz * upper.y + corner.second.xyz * lower.y;
    let made = corner_distortion(p, s, corner.normal.xyz, parameters.epsilon);
    let first = made.first * upper.x + made.second * upper.y;
    let second = made.first * lower.x + made.second * lower.y;
    out[2u * i] = vec4<f32>(made.energy, made.area, first.xy);
    out[2u * i + 1u] = vec4<f32>(first.z, second);
}
