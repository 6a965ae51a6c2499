// Bézier points of patches: a thread per point, which sums the functions of its patch.

struct Counts {
    items: u32,       // points
    parameters: u32,
    padding: vec2<u32>,
}

@group(0) @binding(0) var<uniform> counts: Counts;
@group(0) @binding(1) var<storage, read> starts: array<u32>;
@group(0) @binding(2) var<storage, read> functions: array<u32>;
@group(0) @binding(3) var<storage, read> coefficients: array<f32>;   // 16 per function of a patch
@group(0) @binding(4) var<storage, read> controls: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read_write> points: array<vec4<f32>>;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= counts.items { return; }
    let patch_number = id.x / 16u;
    let point = id.x % 16u;
    var sum = vec4<f32>(0.0);
    for (var k = starts[patch_number]; k < starts[patch_number + 1u]; k += 1u) {
        sum += coefficients[16u * k + point] * controls[functions[k]];
    }
    points[id.x] = sum;
}
