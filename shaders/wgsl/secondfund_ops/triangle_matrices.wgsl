// The matrices of triangles, one per thread: the shape operator from the change of the normals, the conductivity
// of an operator, the stiffness of linear functions. Positions and normals are pairs (high, low) of f32 whose sum
// is the f64 value, so that differences keep all digits.

struct Task {
    law: u32,       // 0 metric, 1 adjugate, 2 Gauss image, 3 generalized, 4 diffusing, 5 sharpening, 6 concave
    count: u32,
    fields: u32,    // 1 where factors hold one value per vertex
    unused: u32,
    gauss: f32,     // coefficients of the exponent
    mean: f32,
    low: f32,       // bounds of the weight
    high: f32,
    regularization: f32,
    limit: f32,     // largest curvature; 0 for none
    pad0: f32,
    pad1: f32,
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

// Symmetric matrices are (xx, xy, yy).

fn determinant2(s: vec3<f32>) -> f32 { return s.x * s.z - s.y * s.y; }
fn adjugate2(s: vec3<f32>) -> vec3<f32> { return vec3<f32>(s.z, -s.y, s.x); }

// The part with the positive eigenvalues, or that with the negative ones, sign turned.
fn part(s: vec3<f32>, sign: f32) -> vec3<f32> {
    let middle = 0.5 * (s.x + s.z);
    let half = 0.5 * (s.x - s.z);
    let reach = length(vec2<f32>(half, s.y));
    var d = vec2<f32>(half + reach, s.y);
    if half < 0.0 { d = vec2<f32>(s.y, reach - half); }
    let l = length(d);
    if l > 0.0 { d = d / l; } else { d = vec2<f32>(1.0, 0.0); }
    let a = max(sign * (middle + reach), 0.0);
    let b = max(sign * (middle - reach), 0.0);
    return vec3<f32>(d.x * d.x, d.x * d.y, d.y * d.y) * a + vec3<f32>(d.y * d.y, -d.x * d.y, d.x * d.x) * b;
}

fn psi(h: f32, k: f32, factor: f32) -> f32 {
    if task.gauss == 0.0 && task.mean == 0.0 && factor == 1.0 { return 1.0; }
    let exponent = clamp(task.gauss * k + task.mean * h, -50.0, 50.0);
    return clamp(exp(exponent) * factor, task.low, task.high);
}

// p² (S² + δ)⁻¹ with K = det S.
fn third_inverse(s: vec3<f32>, k: f32, delta: f32, p: f32) -> vec3<f32> {
    let third = vec3<f32>(s.x * s.x + s.y * s.y + delta, s.y * (s.x + s.z), s.y * s.y + s.z * s.z + delta);
    // (K² + ε² (κ₁² + κ₂²) + ε⁴): the determinant without cancellation.
    let d = k * k + delta * (s.x * s.x + 2.0 * s.y * s.y + s.z * s.z) + delta * delta;
    return adjugate2(third) * (p * p / d);
}

// In an orthonormal frame: g = 1.
fn conductivity(shape: vec3<f32>, factor: f32) -> vec3<f32> {
    var s = shape;
    if task.limit > 0.0 {
        let m = 0.5 * (s.x + s.z);
        let largest = abs(m) + length(vec2<f32>(0.5 * (s.x - s.z), s.y));
        if largest > task.limit { s = s * (task.limit / largest); }
    }
    let h = 0.5 * (s.x + s.z);
    let k = determinant2(s);
    let delta = task.regularization * task.regularization;
    switch task.law {
        case 0u: { return vec3<f32>(1.0, 0.0, 1.0); }
        case 1u: { return adjugate2(s); }
        case 2u: { return third_inverse(s, k, delta, psi(h, k, factor)); }
        // The negative part is of rank one unless both curvatures are negative: its determinant is 0 or K.
        case 6u: { return third_inverse(part(s, -1.0), select(0.0, k, h < 0.0 && k > 0.0), delta, psi(h, k, factor)); }
        case 3u: { return adjugate2(s) * (psi(h, k, factor) * k / (k * k + delta * delta)); }
        default: {
            let q = adjugate2(s) * (h * k / length(vec2<f32>(k, delta)));
            return part(q, select(1.0, -1.0, task.law == 5u));
        }
    }
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
