//! Faults of `secondfund-ops`.

use super::Fault;

pub(super) const FAULTS: &[Fault] = &[
    Fault::wrong(
        "mean curvature counts the mixed entry once",
        "crates/secondfund-ops/src/forms/symmetric.rs",
        "0.5 * (g.yy * b.xx - 2.0 * g.xy * b.xy + g.xx * b.yy) / g.determinant()",
        "0.5 * (g.yy * b.xx - g.xy * b.xy + g.xx * b.yy) / g.determinant()",
    ),
    Fault::wrong(
        "the third form without the inverse of the first",
        "crates/secondfund-ops/src/forms/symmetric.rs",
        "self.second.around(self.first.inverse())",
        "self.second.around(self.first)",
    ),
    Fault::wrong(
        "curvatures have no limit",
        "crates/secondfund-ops/src/forms/symmetric.rs",
        "if largest > limit {",
        "if largest > limit && limit < 0.0 {",
    ),
    Fault::wrong(
        "the secondary Laplace operator takes its weight once",
        "crates/secondfund-ops/src/forms/conduct.rs",
        "(forms.third() + g * delta()).inverse() * (psi * psi)",
        "(forms.third() + g * delta()).inverse() * psi",
    ),
    Fault::wrong(
        "weights see mean curvature of the wrong sign",
        "crates/secondfund-ops/src/forms/weight.rs",
        "Weight::ExpMinusH => self.mean -= 1.0,",
        "Weight::ExpMinusH => self.mean += 1.0,",
    ),
    Fault::wrong(
        "normals are smoothed once at most",
        "crates/secondfund-ops/src/forms/triangles.rs",
        "for _ in 0..rounds {",
        "for _ in 0..rounds.min(1) {",
    ),
    Fault::wrong(
        "limit positions take the neighbours across quads for the vertex itself",
        "crates/secondfund-ops/src/catmull/limit.rs",
        "extended.add(edges.to(edges.next(h)).0, unit, &mut row);",
        "extended.add(v as u32, unit, &mut row);",
    ),
    Fault::wrong(
        "boundaries are subdivided as polygons",
        "crates/secondfund-ops/src/catmull/subdivide.rs",
        "return Point3::from((left + here * 6.0 + right) / 8.0);",
        "return Point3::from((left + here * 1e9 + right) / (1e9 + 2.0));",
    ),
    Fault::wrong(
        "Gaussian curvature of vertices is the mean one",
        "crates/secondfund-ops/src/operators/triangles.rs",
        "sums.gauss[v] += element.mass * element.gauss;",
        "sums.gauss[v] += element.mass * element.mean;",
    ),
    Fault::wrong(
        "quads: the consistent mass without the area",
        "crates/secondfund-ops/src/operators/quads.rs",
        "let value = weight * values[i];",
        "let value = table.weights[q] * values[i];",
    ),
    Fault::wrong(
        "modes count alike, whatever their eigenvalues",
        "crates/secondfund-ops/src/segment/embed.rs",
        "(1.0 / value.max(f64::MIN_POSITIVE).sqrt(), mode)",
        "(1.0 / value.max(f64::MIN_POSITIVE).sqrt().max(f64::INFINITY).min(1.0), mode)",
    ),
    Fault::wrong(
        "borders are wanted at no creases",
        "crates/secondfund-ops/src/segment/clean.rs",
        "time * link.length / apart.max(f64::MIN_POSITIVE) / (1.0 + crease * crease);",
        "time * link.length / apart.max(f64::MIN_POSITIVE) / (1.0 + 0.0 * crease);",
    ),
    Fault::wrong(
        "tiny patches stay",
        "crates/secondfund-ops/src/segment/clean.rs",
        "const TINY: f64 = 0.005;",
        "const TINY: f64 = 0.0;",
    ),
    Fault::wrong(
        "the Rand index counts pairs that are together once",
        "crates/secondfund-ops/src/segment/metrics.rs",
        "(sum(&self.of_first) + sum(&self.of_second) - 2.0 * together) / all",
        "(sum(&self.of_first) + sum(&self.of_second) - together) / all",
    ),
    Fault::wrong(
        "cut discrepancies in Å, not in radii",
        "crates/secondfund-ops/src/segment/metrics.rs",
        "sum / count as f64 / mean_radius(mesh)",
        "sum / count as f64 / mean_radius(mesh).powi(0)",
    ),
    Fault::wrong(
        "flows do not sharpen",
        "crates/secondfund-ops/src/flow/steps.rs",
        "sharpening.iter_mut().for_each(|x| *x *= options.sharpen);",
        "sharpening.iter_mut().for_each(|x| *x *= 0.0 * options.sharpen);",
    ),
    Fault::wrong(
        "rims move",
        "crates/secondfund-ops/src/flow/steps.rs",
        "if options.keep_rims {",
        "if options.keep_rims && rims.is_empty() {",
    ),
    Fault::wrong(
        "volumes are restored the wrong way",
        "crates/secondfund-ops/src/flow/steps.rs",
        "let along = missing / surface.area();",
        "let along = -missing / surface.area();",
    ),
    Fault::wrong(
        "the bilateral filter does not look at directions",
        "crates/secondfund-ops/src/flow/bilateral.rs",
        "normals[f] * (sheet.areas[f] * (-near - alike).exp())",
        "normals[f] * (sheet.areas[f] * (-near - 0.0 * alike).exp())",
    ),
    Fault::wrong(
        "total variation: no jump shrinks",
        "crates/secondfund-ops/src/flow/variation.rs",
        "shrunk(real + duals[h] / PENALTY, weight / PENALTY)",
        "shrunk(real + duals[h] / PENALTY, 0.0 * weight)",
    ),
    Fault::wrong(
        "total variation: every jump shrinks to nothing",
        "crates/secondfund-ops/src/flow/variation.rs",
        "shrunk(real + duals[h] / PENALTY, weight / PENALTY)",
        "shrunk(real + duals[h] / PENALTY, 1e9 * weight)",
    ),
    Fault::wrong(
        "filters move rims",
        "crates/secondfund-ops/src/flow/filter.rs",
        "if options.keep_rims {",
        "if options.keep_rims && positions.is_empty() {",
    ),
    Fault::wrong(
        "points nearer than the shell belong to it",
        "crates/secondfund-ops/src/pockets/shell.rs",
        "(gap > near).then(|| ShellPoint {",
        "(gap > near - 1.0).then(|| ShellPoint {",
    ),
    Fault::wrong(
        "pockets of all chains have one threshold",
        "crates/secondfund-ops/src/pockets/sites.rs",
        "if options.per_chain {",
        "if options.per_chain && chains == 1 {",
    ),
    Fault::wrong(
        "triangle_matrices.wgsl: sharpening is diffusing",
        "shaders/wgsl/secondfund_ops/triangle_matrices.wgsl",
        "return part(q, select(1.0, -1.0, task.law == 5u));",
        "return part(q, 1.0);",
    ),
    Fault::wrong(
        "triangle_matrices.wgsl: fields are not averaged",
        "shaders/wgsl/secondfund_ops/triangle_matrices.wgsl",
        "factor = (factors[a] + factors[b] + factors[c]) / 3.0;",
        "factor = factors[a];",
    ),
    Fault::wrong(
        "distances.wgsl: columns beyond a multiple of 16 do not count",
        "shaders/wgsl/secondfund_ops/distances.wgsl",
        "for (var start = 0u; start < task.width; start += 16u) {",
        "for (var start = 0u; start + 15u < task.width; start += 16u) {",
    ),
];
