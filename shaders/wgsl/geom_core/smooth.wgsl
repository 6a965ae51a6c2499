// A step of Chebyshev smoothing: d = first · d + second · r / diagonal, x = x + d; four columns of a row
// per thread.

struct Parameters { rows: u32, quads: u32, first: f32, second: f32 }

@group(0) @binding(0) var<storage, read> inverse_diagonal: array<f32>;
@group(0) @binding(1) var<storage, read> r: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read_write> d: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read_write> x: array<vec4<f32>>;
@group(0) @binding(4) var<uniform> p: Parameters;
@group(0) @binding(5) var<uniform> fresh: vec4<u32>; // x: 1 where x counts as zero

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let i = id.y * groups.x * 64u + id.x;
    if i >= p.rows * p.quads { return; }
    var step = (p.second * inverse_diagonal[i / p.quads]) * r[i];
    if p.first != 0.0 { step += p.first * d[i]; }
    d[i] = step;
    if fresh.x == 1u { x[i] = step; } else { x[i] += step; }
}
