//! Faults of `tspline`.

use super::Fault;

pub(super) const FAULTS: &[Fault] = &[
    Fault::wrong(
        "feet of a part of the mesh are taken for its vertices",
        "crates/tspline/src/quality/cells.rs",
        "(vertices.len() + feet.partition_point(|&f| f < n)) as u32",
        "feet.partition_point(|&f| f < n) as u32",
    )
    .seen_by("mesh::bad_elements_with_t_junctions_are_made_straight"),
    Fault::wrong(
        "B-splines grow where they should fall",
        "crates/tspline/src/surface/basis/knots.rs",
        "n[i] = ratio(x - t[i], t[i + p] - t[i]) * n[i]",
        "n[i] = ratio(t[i + p] - x, t[i + p] - t[i]) * n[i]",
    )
    .seen_by("surface::functions_are_a_partition_of_unity"),
    Fault::wrong(
        "the last interval before an extraordinary vertex is one, whatever it is",
        "crates/tspline/src/surface/basis/knots.rs",
        "found.push(t + last);",
        "found.push(t + last.min(1));",
    )
    .seen_by("surface::patches_meet_without_gaps_and_smoothly"),
    Fault::wrong(
        "the farther knot is twice as far as the nearer one",
        "crates/tspline/src/surface/basis/rational.rs",
        "|to: [i64; 2], back: [i64; 2]| [-back[1], -back[0], 0, to[0], to[1]];",
        "|to: [i64; 2], back: [i64; 2]| [-back[1], -back[0], 0, to[0], 2 * to[0]];",
    )
    .seen_by("details::coarse_elements_beside_fine_ones_are_cut_one_way"),
    Fault::wrong(
        "control points of T-splines start at vertices",
        "crates/tspline/src/surface/basis/rational.rs",
        "let thirds = first[axis] - first[axis + 2];",
        "let thirds = 0 * first[axis];",
    )
    .seen_by("surface::suitable_t_splines_hold_bicubics_and_others_miss_them"),
    Fault::wrong(
        "extensions of T-junctions go one edge on",
        "crates/tspline/src/surface/basis/suitable.rs",
        "for (ray, knots) in [(rays[0], 1), (rays[1], 0)] {",
        "for (ray, knots) in [(rays[0], 0), (rays[1], 0)] {",
    )
    .seen_by("surface::what_t_junctions_reach"),
    Fault::wrong(
        "extensions of T-junctions do not go back",
        "crates/tspline/src/surface/basis/suitable.rs",
        "for (ray, knots) in [(rays[0], 1), (rays[1], 0)] {",
        "for (ray, knots) in [(rays[0], 1)] {",
    )
    .seen_by("surface::suitable_t_splines_hold_bicubics_and_others_miss_them"),
    Fault::wrong(
        "half a turn exchanges the directions of knots",
        "crates/tspline/src/surface/basis/rational.rs",
        "2 => [against(x, tx), against(y, ty)],",
        "2 => [against(y, ty), against(x, tx)],",
    )
    .seen_by("surface::rational_is_the_same_where_nothing_is_coarse_and_worse_where_it_is"),
    Fault::wrong(
        "neighbours may differ by two levels",
        "crates/tspline/src/mesh/balance.rs",
        "if self.level[other as usize] > self.level[quad as usize] + 1 {",
        "if self.level[other as usize] > self.level[quad as usize] + 2 {",
    )
    .seen_by("mesh::any_levels_make_a_valid_t_mesh"),
    Fault::wrong(
        "elements around extraordinary vertices may differ by a level",
        "crates/tspline/src/mesh/balance.rs",
        "let coarser = |q: &u32| level(q) > finest;",
        "let coarser = |q: &u32| level(q) > finest + 1;",
    )
    .seen_by("mesh::any_levels_make_a_valid_t_mesh"),
    Fault::wrong(
        "vertices of every component move on the first",
        "crates/tspline/src/quality/components.rs",
        "all.max().map_or(0, |(_, Reverse(part))| part as u32)",
        "all.max().map_or(0, |(_, Reverse(part))| 0 * part as u32)",
    )
    .seen_by("mesh::parts_that_nearly_touch_keep_to_their_own_surface"),
    Fault::wrong(
        "elements are seen along the normals at their corners alone",
        "crates/tspline/src/quality/cells.rs",
        "ground.normal_over(at, normals)",
        "ground.normal_over(&[at[0]; 4], normals)",
    )
    .seen_by("mesh::elements_over_tips_are_seen_along_the_tip"),
    Fault::wrong(
        "levels are high where the field is",
        "crates/tspline/src/levels.rs",
        "let part = (high - value) / (high - low);",
        "let part = (value - low) / (high - low);",
    )
    .seen_by("mesh::levels_follow_sides_fields_and_curvature"),
    Fault::wrong(
        "concave curvature does not count",
        "crates/tspline/src/levels.rs",
        "let largest = c.max.abs().max(c.min.abs());",
        "let largest = c.max.max(0.0);",
    )
    .seen_by("details::curvature_counts_on_either_side"),
    Fault::wrong(
        "the mean of a load stays in",
        "crates/tspline/src/analysis/mod.rs",
        ".map(|x| x[0] - mean * x[1])",
        ".map(|x| x[0] - 0.0 * mean * x[1])",
    )
    .seen_by("details::the_mean_of_a_load_does_not_matter"),
    Fault::wrong(
        "solutions of Poisson's equation have any mean",
        "crates/tspline/src/analysis/mod.rs",
        "solution.iter_mut().for_each(|u| *u -= integral / area);",
        "solution.iter_mut().for_each(|u| *u -= 0.0 * integral / area);",
    )
    .seen_by("surface::poisson_on_the_sphere"),
    Fault::wrong(
        "STEP points are not divided by their weights",
        "crates/tspline/src/files/step.rs",
        "self.point([x / w, y / w, z / w]);",
        "self.point([x, y, z].map(|x| x + 0.0 * w));",
    )
    .seen_by("details::step_files_have_points_and_weights"),
    Fault::wrong(
        "elements twice as far as allowed are near enough",
        "crates/tspline/src/surface/adapt.rs",
        "let far = |e: &usize| of_elements[*e] > tolerance;",
        "let far = |e: &usize| of_elements[*e] > 2.0 * tolerance;",
    )
    .seen_by("details::no_element_is_farther_away_than_a_tolerance_that_is_reached"),
    Fault::wrong(
        "the larger distance is that of one way",
        "crates/tspline/src/surface/errors.rs",
        "hausdorff: to_mesh.max(from_mesh),",
        "hausdorff: to_mesh,",
    )
    .seen_by("details::what_lies_off_the_surface_counts"),
    Fault::wrong(
        "what of the mesh lies off the surface counts for no element",
        "crates/tspline/src/surface/errors.rs",
        "*worst = worst.max(near.distance);",
        "*worst = worst.max(0.0 * near.distance);",
    )
    .seen_by("details::what_lies_off_the_surface_counts"),
    Fault::wrong(
        "fits damp the bending of the surface, not of what changes",
        "crates/tspline/src/surface/fit.rs",
        "out.iter_mut().zip(point).for_each(|(o, c)| *o += b * c);",
        "out.iter_mut().zip(point).for_each(|(o, c)| *o += 0.0 * b * c);",
    )
    .seen_by("surface::what_is_where_it_should_be_stays"),
    Fault::wrong(
        "elements are left where the worst is best",
        "crates/tspline/src/quality/improve.rs",
        "lifted += flow.lift_the_mean(&rise, GOAL)?;",
        "let _ = (&rise, GOAL);",
    )
    .seen_by("mesh::better_elements_lie_on_the_surface_and_none_is_worse"),
    Fault::wrong(
        "elements too large for a surface are left",
        "crates/tspline/src/quality/improve.rs",
        "made.jacobians[*e] < options.least;",
        "made.jacobians[*e] < -2.0 * options.least.abs();",
    )
    .seen_by("mesh::elements_too_large_for_a_surface_are_cut"),
    Fault::wrong(
        "fits are never smoothed",
        "crates/tspline/src/surface/fit.rs",
        "*out += options.smoothing * mean * b;",
        "*out += 1e-6 * mean * b;",
    )
    .seen_by("details::smoothing_holds_a_fit_back"),
    Fault::wrong(
        "the surface does not come to samples of the mesh",
        "crates/tspline/src/surface/fit.rs",
        "0 => Vec::new(),",
        "_ if round < 99 => Vec::new(),",
    )
    .seen_by("details::a_fit_grows_into_what_it_does_not_reach"),
    Fault::wrong(
        "bezier_samples.wgsl: normals without the derivative of the weight",
        "shaders/wgsl/tspline/bezier_samples.wgsl",
        "cross((along_s.xyz - x * along_s.w) / h.w,",
        "cross(along_s.xyz / h.w,",
    )
    .seen_by("surface::the_gpu_agrees"),
    Fault::wrong(
        "bezier_points.wgsl: the last function of a patch is left out",
        "shaders/wgsl/tspline/bezier_points.wgsl",
        "k < starts[patch_number + 1u]; k += 1u",
        "k + 1u < starts[patch_number + 1u]; k += 1u",
    )
    .seen_by("surface::the_gpu_agrees"),
];
