// The matrices of triangles, one per thread: the shape operator from the change of the normals, the conductivity
// of an operator, the stiffness of linear functions. Positions and normals are pairs (high, low) of f32 whose sum
// is the f64 value, so that differences keep all digits.

struct Task {
    law: u32,       // 0 metric, 1 adjugate, 2 Gauss image, 3 generalized, 4 flow, 5 concave
    fields: u32,    // 1 where there are values of the weight's fields
    gauss: f32,     // coefficients of the exponent
    mean: f32,
    low: f32,       // bounds of the weight
    high: f32,
    regularization: f32,
    limit: f32,     // largest curvature; 0 for none
    sharpen: f32,   // β of the flow
    count: u32,
    pad0: u32,
    pad1: u32,
}

@group(0) @binding(0) var<uniform> task: Task;
@group(0) @binding(1) var<storage, read> positions: array<vec4<f32>>; // high, low per vertex
@group(0) @binding(2) var<storage, read> normals: array<vec4<f32>>;   // high, low per vertex
@group(0) @binding(3) var<storage, read> triangles: array<u32>;
@group(0) @binding(4) var<storage, read> factors: array<f32>;
@group(0) @binding(5) var<storage, read_write> matrices: array<vec4<f32>>; // three per triangle

fn edge(a: u32, b: u32) -> vec3<f32> {
    let high = positions[2u * b].xyz - positions[2u * a].xyz;
    return high + (positions[2u * b + 1u].xyz - positions[2u * a + 1u].xyz);
}

fn turn(a: u32, b: u32) -> vec3<f32> {
    let high = normals[2u * b].xyz - normals[2u * a].xyz;
    return high + (normals[2u * b + 1u].xyz - normals[2u * a + 1u].xyz);
}

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let i = id.y * groups.x * 64u + id.x;
    if i >= task.count { return; }
    let a = triangles[3u * i];
    let b = triangles[3u * i + 1u];
    let c = triangles[3u * i + 2u];
    let p = edge(a, b);
    let q = edge(a, c);
    let base = length(p);
    let x = p / max(base, 1e-30);
    let along = dot(q, x);
    let up = q - x * along;
    let above = length(up);
    let longest = max(max(base, length(q)), length(q - p));
    matrices[3u * i] = vec4<f32>(0.0);
    matrices[3u * i + 1u] = vec4<f32>(0.0);
    matrices[3u * i + 2u] = vec4<f32>(0.0);
    if !(above > 1e-12 * longest && base > 1e-12 * longest) { return; }
    let y = up / above;
    let n1 = turn(a, b) / base;
    let n2 = (turn(a, c) - n1 * along) / above;
    let shape = vec3<f32>(dot(x, n1), 0.5 * (dot(x, n2) + dot(y, n1)), dot(y, n2));
    var factor = 1.0;
    if task.fields == 1u { factor = (factors[a] + factors[b] + factors[c]) / 3.0; }
    let m = conductivity(shape, factor);
    let area = 0.5 * base * above;
    let gb = vec2<f32>(1.0 / base, -along / (base * above));
    let gc = vec2<f32>(0.0, 1.0 / above);
    let ga = -gb - gc;
    let fa = vec2<f32>(m.x * ga.x + m.y * ga.y, m.y * ga.x + m.z * ga.y) * area;
    let fb = vec2<f32>(m.x * gb.x + m.y * gb.y, m.y * gb.x + m.z * gb.y) * area;
    let fc = vec2<f32>(m.x * gc.x + m.y * gc.y, m.y * gc.x + m.z * gc.y) * area;
    matrices[3u * i] = vec4<f32>(dot(fa, ga), dot(fa, gb), dot(fa, gc), dot(fb, gb));
    matrices[3u * i + 1u] = vec4<f32>(dot(fb, gc), dot(fc, gc), area / 3.0, 0.5 * (shape.x + shape.z));
    matrices[3u * i + 2u] = vec4<f32>(determinant2(shape), 0.0, 0.0, 0.0);
}
