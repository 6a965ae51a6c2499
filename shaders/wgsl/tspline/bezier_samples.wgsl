// Points, normals and areas of bicubic Bézier patches: a thread per pair of parameters.

struct Counts {
    items: u32,       // samples
    parameters: u32,
    padding: vec2<u32>,
}

@group(0) @binding(0) var<uniform> counts: Counts;
@group(0) @binding(1) var<storage, read> points: array<vec4<f32>>;   // 16 per patch: (x w, y w, z w, w)
@group(0) @binding(2) var<storage, read> table: array<vec4<f32>>;    // per parameter polynomials, then slopes
@group(0) @binding(3) var<storage, read_write> samples: array<vec4<f32>>;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= counts.items { return; }
    let n = counts.parameters;
    let patch_number = id.x / (n * n);
    let s = id.x % n;
    let t = (id.x / n) % n;
    let values_s = table[2u * s];
    let slopes_s = table[2u * s + 1u];
    let values_t = table[2u * t];
    let slopes_t = table[2u * t + 1u];
    var h = vec4<f32>(0.0);
    var along_s = vec4<f32>(0.0);
    var along_t = vec4<f32>(0.0);
    for (var b = 0u; b < 4u; b += 1u) {
        let base = 16u * patch_number + 4u * b;
        let row = mat4x4<f32>(points[base], points[base + 1u], points[base + 2u], points[base + 3u]);
        let curve = row * values_s;
        h += values_t[b] * curve;
        along_t += slopes_t[b] * curve;
        along_s += values_t[b] * (row * slopes_s);
    }
    let x = h.xyz / h.w;
    let normal = cross((along_s.xyz - x * along_s.w) / h.w, (along_t.xyz - x * along_t.w) / h.w);
    let area = length(normal);
    samples[2u * id.x] = vec4<f32>(x, area);
    samples[2u * id.x + 1u] = vec4<f32>(select(vec3<f32>(0.0), normal / area, area > 0.0), 0.0);
}
