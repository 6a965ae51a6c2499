// Patches of a surface that share a basis: the surface at a point of the quadrature.

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
    functions: u32, // of a patch
    points: u32,    // of the quadrature
    patches: u32,
    mass: u32,      // 1 where the mass is wanted
    least: f32,     // area elements of this and below count as none
    pad0: f32,
    pad1: f32,
}

@group(0) @binding(0) var<uniform> task: Task;
@group(0) @binding(1) var<storage, read> basis: array<f32>;       // per point six rows: value, u, v, uu, uv, vv
@group(0) @binding(2) var<storage, read> weights: array<f32>;     // per point
@group(0) @binding(3) var<storage, read> places: array<vec4<f32>>; // per patch and function: from the middle, field

struct At {
    conductivity: vec3<f32>, // in coordinates, times the weight
    weight: f32,             // of the point, with its area; 0 without an area
    u: vec3<f32>,
    mean: f32,
    v: vec3<f32>,
    gauss: f32,
}

fn at(patch_index: u32, q: u32) -> At {
    let n = task.functions;
    let first = patch_index * n;
    let rows = q * 6u * n;
    var u = vec3<f32>(0.0);
    var v = vec3<f32>(0.0);
    var uu = vec3<f32>(0.0);
    var uv = vec3<f32>(0.0);
    var vv = vec3<f32>(0.0);
    var field = 0.0;
    for (var i = 0u; i < n; i += 1u) {
        let p = places[first + i];
        field += p.w * basis[rows + i];
        u += p.xyz * basis[rows + n + i];
        v += p.xyz * basis[rows + 2u * n + i];
        uu += p.xyz * basis[rows + 3u * n + i];
        uv += p.xyz * basis[rows + 4u * n + i];
        vv += p.xyz * basis[rows + 5u * n + i];
    }
    var out: At;
    out.u = u;
    out.v = v;
    let normal = cross(u, v);
    let area = length(normal);
    if !(area > task.least) { return out; }
    let outward = -normal / area;
    let b = vec3<f32>(dot(outward, uu), dot(outward, uv), dot(outward, vv));
    // g = Lᵀ L with the upper triangular L = [[l, m], [0, r]]; the rows of its inverse are (a, c) and (0, d).
    let l = length(u);
    let m = dot(u, v) / l;
    let r = area / l;
    let a = 1.0 / l;
    let c = -m / (l * r);
    let d = 1.0 / r;
    let shape = vec3<f32>(a * a * b.x, a * (c * b.x + d * b.y), c * (c * b.x + d * b.y) + d * (c * b.y + d * b.z));
    out.mean = 0.5 * (shape.x + shape.z);
    out.gauss = determinant2(shape);
    out.weight = weights[q] * area;
    let s = conductivity(shape, select(1.0, field, task.fields == 1u)) * out.weight;
    out.conductivity = vec3<f32>(a * (s.x * a + s.y * c) + c * (s.y * a + s.z * c), d * (s.y * a + s.z * c), d * s.z * d);
    return out;
}
