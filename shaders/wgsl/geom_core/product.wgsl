// Sparse matrix times a block: out = beta · z + alpha · A x, four columns of a row per thread.

struct Parameters { rows: u32, quads: u32, alpha: f32, beta: f32 }

@group(0) @binding(0) var<storage, read> starts: array<u32>; // rows + 1
@group(0) @binding(1) var<storage, read> indices: array<u32>;
@group(0) @binding(2) var<storage, read> values: array<f32>;
@group(0) @binding(3) var<storage, read> x: array<vec4<f32>>; // quads per row
@group(0) @binding(4) var<storage, read> z: array<vec4<f32>>; // not read where beta is zero
@group(0) @binding(5) var<storage, read_write> out: array<vec4<f32>>;
@group(0) @binding(6) var<uniform> p: Parameters;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let i = id.y * groups.x * 64u + id.x;
    if i >= p.rows * p.quads { return; }
    let row = i / p.quads;
    let quad = i % p.quads;
    var sum = vec4<f32>();
    let end = starts[row + 1u];
    for (var at = starts[row]; at < end; at += 1u) {
        sum += values[at] * x[indices[at] * p.quads + quad];
    }
    sum *= p.alpha;
    if p.beta != 0.0 { sum += p.beta * z[i]; }
    out[i] = sum;
}
