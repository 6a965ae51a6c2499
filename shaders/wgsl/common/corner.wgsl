// How far a corner is from a right angle between unit sides, and the derivatives: CornerDistortion of geom-core.

struct Distortion { energy: f32, area: f32, first: vec3<f32>, second: vec3<f32> }

fn corner_distortion(p: vec3<f32>, s: vec3<f32>, n: vec3<f32>, epsilon: f32) -> Distortion {
    let squared = epsilon * epsilon;
    let area = dot(n, cross(p, s));
    let root = sqrt(area * area + squared);
    // The sum loses its digits where the corner is inverted.
    var bottom = area + root;
    if area < 0.0 { bottom = squared / (root - area); }
    // Not finite numbers are no numbers in WGSL: an inverted corner without regularization is very bad.
    bottom = max(bottom, 1e-30);
    let slope = bottom / max(root, 1e-30);
    let top = dot(p, p) + dot(s, s);
    let along = top / bottom * (slope / bottom);
    return Distortion(
        top / bottom,
        area,
        p * (2.0 / bottom) - cross(s, n) * along,
        s * (2.0 / bottom) - cross(n, p) * along,
    );
}
