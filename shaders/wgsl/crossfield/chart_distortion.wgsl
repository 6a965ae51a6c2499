// How far the map of each triangle is from what is wanted, and the derivatives: one triangle per thread.

struct Parameters { count: u32, epsilon: f32 }

@group(0) @binding(0) var<storage, read> charts: array<f32>; // 17 per triangle: hats of u, of v, sides, area
@group(0) @binding(1) var<storage, read_write> out: array<vec4<f32>>; // two per triangle
@group(0) @binding(2) var<uniform> p: Parameters;

fn pair(at: u32) -> vec2<f32> { return vec2<f32>(charts[at], charts[at + 1u]); }

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let i = id.y * groups.x * 64u + id.x;
    if i >= p.count { return; }
    let at = 17u * i;
    // Coordinates of the second and third corner relative to the first: the hats add up to nothing.
    let second = pair(at + 12u);
    let third = pair(at + 14u);
    let area = charts[at + 16u];
    let row_u = second.x * pair(at + 2u) + third.x * pair(at + 4u);
    let row_v = second.y * pair(at + 8u) + third.y * pair(at + 10u);
    let determinant = row_u.x * row_v.y - row_u.y * row_v.x;
    let root = sqrt(p.epsilon * p.epsilon + determinant * determinant);
    // The sum loses its digits where the determinant is negative.
    var chi = 0.5 * (determinant + root);
    if determinant < 0.0 { chi = 0.5 * p.epsilon * p.epsilon / (root - determinant); }
    let chi_slope = chi / root;
    let squares = dot(row_u, row_u) + dot(row_v, row_v);
    let barrier = (squares + determinant * determinant + 1.0) / (2.0 * chi);
    let off_u = row_u - vec2<f32>(1.0, 0.0);
    let off_v = row_v - vec2<f32>(0.0, 1.0);
    let along = (determinant - barrier * chi_slope) / chi;
    let slope_u = area * (row_u / chi + along * vec2<f32>(row_v.y, -row_v.x) + 2.0 * off_u);
    let slope_v = area * (row_v / chi + along * vec2<f32>(-row_u.y, row_u.x) + 2.0 * off_v);
    let energy = area * (barrier + dot(off_u, off_u) + dot(off_v, off_v));
    out[2u * i] = vec4<f32>(
        energy,
        dot(slope_u, pair(at)), dot(slope_v, pair(at + 6u)), dot(slope_u, pair(at + 2u)),
    );
    out[2u * i + 1u] = vec4<f32>(
        dot(slope_v, pair(at + 8u)), dot(slope_u, pair(at + 4u)), dot(slope_v, pair(at + 10u)), 0.0,
    );
}
