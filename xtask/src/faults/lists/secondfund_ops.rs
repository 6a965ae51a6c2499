//! Faults of `secondfund-ops`.

use super::Fault;

pub(super) const FAULTS: &[Fault] = &[
    Fault::wrong(
        "depths are distances from some corner",
        "crates/secondfund-ops/src/pockets/measure.rs",
        "let distance = |&v: &u32| mouths.closest(&at(v)).distance;",
        "let distance = |&v: &u32| (at(v) - at(triangles[0])).norm();",
    )
    .seen_by("inside::a_bent_tunnel_is_deep_in_any_pose"),
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
        "crates/secondfund-ops/src/operators/patch.rs",
        "batch.points.push((q, weight));",
        "batch.points.push((q, self.task.weights[q]));",
    ),
    Fault::wrong(
        "quads at rims: the rows of the matrix are not folded",
        "crates/secondfund-ops/src/operators/quads.rs",
        "let value = values[packed(n, i, j)];",
        "let value = values[packed(n, i, i)] * f64::from(i == j);",
    ),
    Fault::wrong(
        "quads at rims: the force on ghosts is lost",
        "crates/secondfund-ops/src/catmull/patches.rs",
        "vertices[v as usize] += x * *w;",
        "vertices[v as usize] += x * w.floor();",
    ),
    Fault::wrong(
        "patch_matrices.wgsl: only the last points count",
        "shaders/wgsl/secondfund_ops/patch_matrices.wgsl",
        "if first > 0u { stiffness += matrices[start + entry]; }",
        "",
    ),
    Fault::wrong(
        "patch_forces.wgsl: only the last points count",
        "shaders/wgsl/secondfund_ops/patch_forces.wgsl",
        "if first > 0u { sum += forces[own * n + k].xyz; }",
        "",
    ),
    Fault::wrong(
        "modes count alike, whatever their eigenvalues",
        "crates/secondfund-ops/src/segment/embed.rs",
        "(1.0 / value.max(f64::MIN_POSITIVE).sqrt(), mode)",
        "(1.0 / value.max(f64::MIN_POSITIVE).sqrt().max(f64::INFINITY).min(1.0), mode)",
    ),
    Fault::wrong(
        "detail is as large on thin bodies as on thick ones",
        "crates/secondfund-ops/src/forms/thickness.rs",
        "thickness(mesh)?.iter().map(|d| detail * d)",
        "thickness(mesh)?.iter().map(|d| detail * (d + 1.0))",
    ),
    Fault::wrong(
        "borders are wanted at no creases",
        "crates/secondfund-ops/src/segment/clean.rs",
        "time * link.length / apart.max(f64::MIN_POSITIVE) / (1.0 + crease * crease);",
        "time * link.length / apart.max(f64::MIN_POSITIVE) / (1.0 + 0.0 * crease);",
    ),
    Fault::wrong(
        "parts that blur into each other stay apart",
        "crates/secondfund-ops/src/segment/clean.rs",
        "let mut best = (1.0, None);",
        "let mut best = (90.0, None);",
    ),
    Fault::wrong(
        "parts are joined across a neck",
        "crates/secondfund-ops/src/segment/clean.rs",
        "(border / (TAU * area).sqrt()).min(1.0)",
        "(border / (TAU * area).sqrt()).max(1.0)",
    ),
    Fault::wrong(
        "parts that are no neighbours are joined",
        "crates/secondfund-ops/src/segment/clean.rs",
        "let b = parts[link.face as usize];",
        "let b = parts[faces.len() - 1 - link.face as usize];",
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
        "mesh.forces(positions, &conductor(options.sharpen))?;",
        "mesh.forces(positions, &conductor(0.0 * options.sharpen))?;",
    ),
    Fault::wrong(
        "flows keep their first matrix",
        "crates/secondfund-ops/src/flow/steps.rs",
        "filter(|_| self.age < refresh);",
        "filter(|_| refresh > 0);",
    )
    .seen_by("laws::one_matrix_serves_for_some_steps"),
    Fault::wrong(
        "flows fold faces",
        "crates/secondfund-ops/src/flow/guard.rs",
        "*now && !**was",
        "*now && !**was && before.is_empty()",
    )
    .seen_by("details::fifty_steps_fold_no_face"),
    Fault::wrong(
        "rims move",
        "crates/secondfund-ops/src/flow/steps.rs",
        "if options.keep_rims {",
        "if options.keep_rims && rims.is_empty() {",
    ),
    Fault::wrong(
        "volumes are restored the wrong way",
        "crates/secondfund-ops/src/flow/volume.rs",
        "let along = missing / (share * mesh.area());",
        "let along = -missing / (share * mesh.area());",
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
        "(gap > near).then(|| (place, of(&point, scratch)))",
        "(gap > near - 1.0).then(|| (place, of(&point, scratch)))",
    ),
    Fault::wrong(
        "pockets of all chains have one threshold",
        "crates/secondfund-ops/src/pockets/sites.rs",
        "if options.per_chain {",
        "if options.per_chain && chains == 1 {",
    ),
    Fault::wrong(
        "the large probe covers nothing",
        "crates/secondfund-ops/src/pockets/probes.rs",
        "center.first().is_none_or(|c| c.distance > options.outer)",
        "center.first().is_none_or(|c| c.distance > 0.0 * options.outer)",
    ),
    Fault::wrong(
        "outlines have no points between probes",
        "crates/secondfund-ops/src/pockets/probes.rs",
        "match own.nearest(p, reach) {",
        "match own.nearest(p, 0.0 * reach) {",
    ),
    Fault::wrong(
        "holes in outlines stay",
        "crates/secondfund-ops/src/pockets/probes.rs",
        "(None, &[one]) if is_crumb(part, one) => Some(one),",
        "(None, &[one]) if is_crumb(part, one) => Some(one).filter(|_| false),",
    ),
    Fault::wrong(
        "rational functions without their denominator's second derivative",
        "crates/secondfund-ops/src/operators/bezier.rs",
        "(nuu - 2.0 * ru * wu - r * wuu) / w,",
        "(nuu - 2.0 * ru * wu) / w,",
    ),
    Fault::wrong(
        "convex patches are pockets",
        "crates/secondfund-ops/src/pockets/literal.rs",
        ".map(|t| measured(0, surface, mean, t).mean_curvature < 0.0)",
        ".map(|t| measured(0, surface, mean, t).mean_curvature > 0.0)",
    ),
    Fault::wrong(
        "patches are ranked without the field",
        "crates/secondfund-ops/src/pockets/literal.rs",
        "Some(field) => mean_over(surface, outline, field),",
        "Some(field) => mean_over(surface, outline, field) * 0.0 - outline.mean_curvature,",
    ),
    Fault::wrong(
        "fields are averaged over triangles, not over area",
        "crates/secondfund-ops/src/pockets/literal.rs",
        "let part = surface.doubled_area_normal(f as usize).norm();",
        "let part = surface.doubled_area_normal(f as usize).norm().powi(0);",
    ),
    Fault::wrong(
        "fields are known beyond their bounds",
        "crates/secondfund-ops/src/pockets/score.rs",
        "bounds.is_none_or(|b| b.contains(p))",
        "bounds.is_none_or(|b| b.contains(p) || !b.is_empty())",
    ),
    Fault::wrong(
        "rims of many quads: beyond the boundary lies the boundary",
        "crates/secondfund-ops/src/catmull/rim.rs",
        "(1, -1) if first => Self::beyond(self.e(0), self.d(0)),",
        "(1, -1) if first => self.e(0),",
    ),
    Fault::wrong(
        "rims of many quads: the boundary is a polygon",
        "crates/secondfund-ops/src/catmull/limit.rs",
        "extended.add(v as u32, 4.0 / 6.0, &mut row);",
        "extended.add(v as u32, 5.0 / 6.0, &mut row);",
    ),
    Fault::wrong(
        "rims of many quads: ghosts on the other side",
        "crates/secondfund-ops/src/catmull/ghosts.rs",
        "let sides = [first, last].map(|h| mirrored(edges.to(h).0));",
        "let sides = [last, first].map(|h| mirrored(edges.to(h).0));",
    ),
    Fault::wrong(
        "conductivity.wgsl: what sharpens diffuses",
        "shaders/wgsl/common/conductivity.wgsl",
        "return part(q, 1.0) - task.sharpen * part(q, -1.0);",
        "return part(q, 1.0) + task.sharpen * part(q, -1.0);",
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
    Fault::wrong(
        "filters squeeze triangles",
        "crates/secondfund-ops/src/flow/guard.rs",
        "sine < least_sine && sine <",
        "sine < 0.0 && sine <",
    ),
    Fault::wrong(
        "flows squeeze triangles",
        "crates/secondfund-ops/src/flow/steps.rs",
        "Shape::unfolded(options.least_angle)",
        "Shape::unfolded(0.0 * options.least_angle)",
    )
    .seen_by("laws::flows_squeeze_no_triangles"),
    Fault::wrong(
        "narrow corners hold a volume back",
        "crates/secondfund-ops/src/flow/guard.rs",
        "            least_sine: 0.0,\n",
        "            least_sine: self.shape.least_sine,\n",
    )
    .seen_by("laws::narrow_corners_do_not_cost_volume_nor_unused_vertices_a_say"),
    Fault::wrong(
        "vertices spread across creases",
        "crates/secondfund-ops/src/flow/tangential.rs",
        "(1.0 - (curvature * edge / CREASE).powi(2)).max(0.0)",
        "(1.0 - (0.0 * curvature * edge / CREASE).powi(2)).max(0.0)",
    )
    .seen_by("laws::creases_outlast_mean_curvature_flow_and_volume_is_kept"),
    Fault::wrong(
        "vertices spread across edges",
        "crates/secondfund-ops/src/flow/sheet.rs",
        "const FREE: f64 = 0.05;",
        "const FREE: f64 = 5.0;",
    ),
    Fault::wrong(
        "filters let vertices spread nowhere",
        "crates/secondfund-ops/src/flow/filter.rs",
        "sheet.steps(&positions, faces, &normals, options.tangential);",
        "sheet.steps(&positions, faces, &normals, 0.0 * options.tangential);",
    ),
    Fault::wrong(
        "smoothing lets faces through",
        "crates/secondfund-ops/src/flow/guard.rs",
        "let step = std::mem::take(&mut moves[v as usize]);",
        "let step = moves[v as usize] * 0.0;",
    )
    .seen_by("laws::a_flow_that_sharpens_by_half_lets_nothing_come_through"),
];
