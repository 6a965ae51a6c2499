// The conductivity of an operator in an orthonormal frame. `task` of the kernel has the fields law (0 metric, 1 adjugate,
// 2 Gauss image, 3 generalized, 4 flow, 5 concave), gauss and mean (coefficients of the exponent), low
// and high (bounds of the weight), regularization, limit (the largest curvature; 0 for none), and sharpen (β of the flow).

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
        case 5u: { return third_inverse(part(s, -1.0), select(0.0, k, h < 0.0 && k > 0.0), delta, psi(h, k, factor)); }
        case 3u: { return adjugate2(s) * (psi(h, k, factor) * k / (k * k + delta * delta)); }
        default: {
            let q = adjugate2(s) * (h * k / length(vec2<f32>(k, delta)));
            return part(q, 1.0) - task.sharpen * part(q, -1.0);
        }
    }
}
