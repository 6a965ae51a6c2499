//! Faults of `crossfield`.

use super::Fault;

pub(super) const FAULTS: &[Fault] = &[
    Fault::wrong(
        "quads are left where the worst is best",
        "crates/crossfield/src/quads/improve/mod.rs",
        "flow.lift_the_mean(&RISE, POLISH.goal)?;",
        "let _ = RISE.goal;",
    )
    .seen_by("laws::few_quads_are_good_in_the_mean"),
    Fault::wrong(
        "a field is carried back whatever becomes of its indices",
        "crates/crossfield/src/field/solve.rs",
        "if !(0..frames.edges().vertices()).all(kept) {",
        "if !(0..frames.edges().vertices()).all(|v| kept(v) || v > 0) {",
    )
    .seen_by("laws::no_field_is_carried_back_whose_indices_would_change"),
    Fault::wrong(
        "a walk along a rim turns back at its vertex for rounding",
        "crates/crossfield/src/map/integers/spread.rs",
        "true => angle.clamp(0.0, total),",
        "true => angle.rem_euclid(total),",
    )
    .seen_by("laws::round_holes_have_four_irregular_vertices_each"),
    Fault::wrong(
        "a walk along a rim ends at the first vertex of it",
        "crates/crossfield/src/map/integers/spread.rs",
        "const ASIDE: f64 = 1e-6;",
        "const ASIDE: f64 = -1.0;",
    )
    .seen_by("laws::round_holes_have_four_irregular_vertices_each"),
    Fault::wrong(
        "integers are refused for what unfolding has used",
        "crates/crossfield/src/map/parameterize/quantized.rs",
        "let effort = ends.integers.share(2);",
        "let effort = self.unfolding.effort.share(2);",
    )
    .seen_by("laws::too_many_integers_are_refused"),
    Fault::wrong(
        "no vertex of a rim without corners is pinned",
        "crates/crossfield/src/map/parameterize/quantized.rs",
        "let may_pin = self.system.seams.pinned.is_empty();",
        "let may_pin = false;",
    )
    .seen_by("laws::round_holes_have_four_irregular_vertices_each"),
    Fault::wrong(
        "sums of integers hang loosely on these",
        "crates/crossfield/src/map/system.rs",
        "const STIFF: f64 = (1u64 << 12) as f64;",
        "const STIFF: f64 = (1u64 << 2) as f64;",
    )
    .seen_by("laws::integers_know_what_the_reals_do"),
    Fault::wrong(
        "a row of the matrix is summed in the order of its coordinates",
        "crates/crossfield/src/map/system.rs",
        "        corners.sort_unstable();\n        for (f",
        "        for (f",
    )
    .seen_by("laws::integers_know_what_the_reals_do"),
    Fault::wrong(
        "of the closings that a value is in the first alone counts",
        "crates/crossfield/src/map/system.rs",
        "in hanging.in_closings.list(i) {",
        "in hanging.in_closings.list(i).iter().take(1) {",
    )
    .seen_by("laws::integers_know_what_the_reals_do"),
    Fault::wrong(
        "sides of a decimated map shall point backwards",
        "crates/crossfield/src/map/integers/spread.rs",
        "let mut side = exact[next(h)].clone();",
        "let mut side = exact[previous(h)].clone();",
    )
    .seen_by("laws::integers_know_what_the_reals_do"),
    Fault::wrong(
        "descent never asks again for moves that turned a triangle over",
        "crates/crossfield/src/map/integers/upright.rs",
        "self.changed[other as usize] = self.step;",
        "self.changed[other as usize] = 0;",
    )
    .seen_by("details::remembered_moves_are_still_forbidden"),
    Fault::wrong(
        "descent does not ask again for pairs whose second integer may move",
        "crates/crossfield/src/map/integers/upright.rs",
        "self.changed[*i].max(self.changed[*j])",
        "self.changed[*i].max(self.changed[*i])",
    )
    .seen_by("details::remembered_moves_are_still_forbidden"),
    Fault::wrong(
        "integers of singular vertices that have met move by ones and twos alone",
        "crates/crossfield/src/map/integers/mend.rs",
        "make(&joint.moves, z,",
        "make(&[], z,",
    )
    .seen_by("details::integers_of_a_point_move_together"),
    Fault::wrong(
        "maps start larger where the field's cones want them smaller",
        "crates/crossfield/src/map/conformal.rs",
        "SHARE * corners.sum::<f64>() / 3.0",
        "-SHARE * corners.sum::<f64>() / 3.0",
    )
    .seen_by("laws::maps_start_in_the_sizes_that_cones_ask_for"),
    Fault::wrong(
        "the sizes that maps start from are those of half the angles at corners",
        "crates/crossfield/src/map/conformal.rs",
        "excess[corners[k] as usize] += cross.atan2(dot);",
        "excess[corners[k] as usize] += cross.atan2(dot) / 2.0;",
    )
    .seen_by("laws::maps_start_in_the_sizes_that_cones_ask_for"),
    Fault::wrong(
        "the symmetric part of a Jacobian is taken for the antisymmetric one",
        "crates/crossfield/src/map/unfold/monotone.rs",
        "0.5 * (a + d - (a - d).hypot(b + c))",
        "0.5 * (a + d - (a - d).hypot(b - c))",
    )
    .seen_by("backends::monotone_maps_are_upright_and_convex"),
    Fault::wrong(
        "what a triangle falls short of monotone has half the slope by its turn",
        "crates/crossfield/src/map/unfold/monotone.rs",
        "[turned * q, -turned * p - short],",
        "[0.5 * turned * q, -turned * p - short],",
    )
    .seen_by("backends::monotone_maps_are_upright_and_convex"),
    Fault::wrong(
        "maps that fold stay as they are",
        "crates/crossfield/src/map/unfold/align.rs",
        "const ROUNDS: usize = 8;",
        "const ROUNDS: usize = 0;",
    )
    .seen_by("laws::maps_that_fold_become_monotone"),
    Fault::wrong(
        "integers cost nothing, however many",
        "crates/crossfield/src/map/integers/round.rs",
        "const OPERATIONS: usize = 8000;",
        "const OPERATIONS: usize = usize::MAX;",
    )
    .seen_by("laws::too_many_integers_are_refused"),
    Fault::wrong(
        "an integer that moves with others as well is not tied to them",
        "crates/crossfield/src/map/transition/mod.rs",
        "form.insert(v as u32, 1);",
        "form.insert(v as u32, 2);",
    )
    .seen_by("laws::integers_are_rounded_region_by_region"),
    Fault::wrong(
        "integers that are held move with the others",
        "crates/crossfield/src/map/system.rs",
        "moving.hold(&mut missing, 1);",
        "moving.hold(&mut [], 1);",
    )
    .seen_by("laws::integers_are_rounded_region_by_region"),
    Fault::wrong(
        "a region is rounded as if what is held pulled half as much",
        "crates/crossfield/src/map/system.rs",
        "held.iter().map(|held| held.unwrap_or(0.0))",
        "held.iter().map(|held| 0.5 * held.unwrap_or(0.0))",
    )
    .seen_by("laws::integers_are_rounded_region_by_region"),
    Fault::wrong(
        "what rounding holds is added to the inverse of the others",
        "crates/crossfield/src/map/integers/dense.rs",
        "strip.gemm(-1.0, held, &own, 1.0);",
        "strip.gemm(1.0, held, &own, 1.0);",
    )
    .seen_by("details::rounding_is_that_of_exact_minima"),
    Fault::wrong(
        "period jumps turn singularities the wrong way",
        "crates/crossfield/src/field/singularity.rs",
        "std::f64::consts::TAU).round() as i32 - jumps",
        "std::f64::consts::TAU).round() as i32 + jumps",
    )
    .seen_by("laws::indices_add_up_to_the_euler_characteristic"),
    Fault::wrong(
        "the index at a boundary counts its ends with one sign",
        "crates/crossfield/src/field/singularity.rs",
        "total -= off_side(frames, theta, incoming);",
        "total += off_side(frames, theta, incoming);",
    )
    .seen_by("laws::indices_of_any_field_on_a_plate_add_up_to_four"),
    Fault::wrong(
        "angles follow a connection of one sign on both sides of an edge",
        "crates/crossfield/src/field/parallel.rs",
        "*b += w * (known(j) - turn);",
        "*b += w * (known(j) + turn);",
    )
    .seen_by("laws::a_sphere_has_eight_corners"),
    Fault::wrong(
        "soft guides pull with a weight of one",
        "crates/crossfield/src/field/parallel.rs",
        "*b += weight * nearest_branch(angle, theta[face]);",
        "*b += nearest_branch(angle, theta[face]).min(weight * f64::INFINITY);",
    )
    .seen_by("laws::hard_guides_are_followed_exactly_and_soft_ones_the_more_the_heavier"),
    Fault::wrong(
        "near pairs of singularities cost no more than far ones",
        "crates/crossfield/src/field/descend.rs",
        "self.far * (NEAR * self.near / distance).max(1.0).powi(2)",
        "self.far * (0.0 * distance).max(1.0).powi(2)",
    )
    .seen_by("details::near_pairs_cost_more"),
    Fault::wrong(
        "crosses turn with the pieces of their triangles",
        "crates/crossfield/src/field/field.rs",
        ".map(|(&parent, turn)| self.theta[parent as usize] - turn)",
        ".map(|(&parent, turn)| self.theta[parent as usize] - 0.0 * turn)",
    )
    .seen_by("details::a_field_goes_on_in_the_pieces_of_its_triangles"),
    Fault::wrong(
        "a bubble may have fewer quads than a cube",
        "crates/crossfield/src/quads/rungs/mod.rs",
        "const FEWEST: f64 = 6.0;",
        "const FEWEST: f64 = 0.01;",
    )
    .seen_by("laws::a_bubble_smaller_than_a_quad_is_a_cube"),
    Fault::wrong(
        "quads of every part lie on the first",
        "crates/crossfield/src/quads/ladder.rs",
        "self.places.origins.extend(origins.into_iter().map(of));",
        "self.places.origins.extend(origins);",
    )
    .seen_by("laws::parts_that_nearly_touch_are_measured_by_themselves"),
    Fault::wrong(
        "steep modes count more, though they should not",
        "crates/crossfield/src/guidance/characteristic.rs",
        "Normalization::Normalized => 1.0 / mode.value.max(f64::MIN_POSITIVE).sqrt(),",
        "Normalization::Normalized => 1.0_f64.max(mode.value * 0.0),",
    )
    .seen_by("thesis::characteristic_values_are_fair_when_normalized"),
    Fault::wrong(
        "the modes before the smallest gap are chosen, not before the largest",
        "crates/crossfield/src/guidance/modes.rs",
        "ratio(a).total_cmp(&ratio(b)).then(b.cmp(&a))",
        "ratio(b).total_cmp(&ratio(a)).then(b.cmp(&a))",
    )
    .seen_by("details::modes_are_taken_up_to_the_widest_gap"),
    Fault::wrong(
        "coordinates turn by a quarter without the sign",
        "crates/crossfield/src/map/transition/mod.rs",
        "(1, 0) => (1, -1),",
        "(1, 0) => (1, 1),",
    )
    .seen_by("laws::a_bumpy_surface_becomes_seamless_quads"),
    Fault::wrong(
        "spacings along and across do not turn with the arms",
        "crates/crossfield/src/map/spacing.rs",
        "if comb.is_multiple_of(2) {",
        "if comb.is_multiple_of(1) {",
    )
    .seen_by("details::spacings_turn_with_the_arms"),
    Fault::wrong(
        "angles around singular vertices add up to the other sign's",
        "crates/crossfield/src/map/cones.rs",
        "let quarters = if frames.on_boundary(v) { 2 } else { 4 } - field.index[v];",
        "let quarters = if frames.on_boundary(v) { 2 } else { 4 } + field.index[v];",
    )
    .seen_by("backends::gpu::whole_quadrangulations_obey_the_same_laws"),
    Fault::wrong(
        "curvature flows three times as long",
        "crates/crossfield/src/field/smooth.rs",
        ".map(|(m, t)| m * FLOW_STEPS as f64 / t)",
        ".map(|(m, t)| m / t)",
    )
    .seen_by("laws::a_cube_becomes_the_cube_of_quads"),
    Fault::wrong(
        "as many quads as triangles where a third was wanted",
        "crates/crossfield/src/options.rs",
        "Self::Triangles => (3.0 * area / triangles as f64).sqrt(),",
        "Self::Triangles => (area / triangles as f64).sqrt(),",
    )
    .seen_by("laws::sizes_are_as_many_quads_as_they_say"),
    Fault::wrong(
        "distances are taken from the quads to the surface twice",
        "crates/crossfield/src/quads/quality.rs",
        "Ok([one(&halves, surface)?, one(surface, &halves)?])",
        "Ok([one(&halves, surface)?, one(&halves, surface)?])",
    )
    .seen_by("laws::distances_are_those_of_either_side"),
    Fault::wrong(
        "vertices of no quad count as irregular",
        "crates/crossfield/src/quads/quality.rs",
        "- self.interior.first().copied().unwrap_or(0)",
        "- 0 * self.interior.first().copied().unwrap_or(0)",
    )
    .seen_by("laws::vertices_of_no_quad_are_not_irregular"),
    Fault::wrong(
        "spacings along a gradient and across it are exchanged",
        "crates/crossfield/src/anisotropy/metric.rs",
        "[narrowed(ratio, cosine), narrowed(ratio, sine)]",
        "[narrowed(ratio, sine), narrowed(ratio, cosine)]",
    )
    .seen_by("anisotropy::spacings_of_crosses_are_those_of_the_metric"),
    Fault::wrong(
        "the spacing is Eq. 4.13 as printed",
        "crates/crossfield/src/anisotropy/metric.rs",
        "1.0 / (1.0 + (1.0 / (ratio * ratio) - 1.0) * cosine * cosine).sqrt()",
        "cosine.abs() * ratio + (1.0 - cosine.abs())",
    )
    .seen_by("details::spacings_have_their_closed_forms"),
    Fault::wrong(
        "crosses turn towards the gradient that is nearer",
        "crates/crossfield/src/anisotropy/adapt.rs",
        "if u[0].abs() < v[0].abs() { u } else { v };",
        "if u[0].abs() > v[0].abs() { u } else { v };",
    )
    .seen_by("details::crosses_turn_towards_the_worse_gradient"),
    Fault::wrong(
        "improvement makes squares of narrow quads",
        "crates/crossfield/src/quads/improve/elements.rs",
        "let ratio = ratio.clamp(narrowest, narrowest.recip());",
        "let ratio = ratio.clamp(1.0, narrowest.recip().min(1.0));",
    )
    .seen_by("details::narrow_quads_keep_their_proportions"),
    Fault::wrong(
        "chart_distortion.wgsl: the derivative without the regularization",
        "shaders/wgsl/crossfield/chart_distortion.wgsl",
        "let chi_slope = chi / root;",
        "let chi_slope = 1.0;",
    )
    .seen_by("backends::gpu::distortions_follow_cpu"),
    Fault::wrong(
        "the next map of a field starts anew",
        "crates/crossfield/src/map/parameterize/relaxed.rs",
        "last.filter(|w| self.unfolder().is_valid(w))",
        "last.filter(|w| !self.unfolder().is_valid(w))",
    )
    .seen_by("laws::the_next_map_of_a_field_starts_upright"),
    Fault::wrong(
        "an edge makes pairs of singularities again and again",
        "crates/crossfield/src/field/descend.rs",
        "|| !made.contains(&h)",
        "|| h < usize::MAX",
    )
    .seen_by("laws::no_pair_of_singularities_comes_and_goes"),
    Fault::wrong(
        "what is upright takes all steps to settle",
        "crates/crossfield/src/map/unfold/untangle.rs",
        "true => SETTLED / STEPS as f64,",
        "true => 0.0,",
    )
    .seen_by("laws::the_next_map_of_a_field_starts_upright"),
    Fault::wrong(
        "of what a place comes to, what folds more is taken",
        "crates/crossfield/src/map/unfold/places.rs",
        "if bad < best.0 ||",
        "if bad > best.0 ||",
    )
    .seen_by("laws::folded_places_are_no_business_of_each_other"),
    Fault::wrong(
        "a map that settles folds first",
        "crates/crossfield/src/map/unfold/untangle.rs",
        "false => LEAST,",
        "false => 3.0,",
    )
    .seen_by("laws::an_upright_map_settles_without_folding"),
    Fault::wrong(
        "bad quads are given up after two operations",
        "crates/crossfield/src/quads/improve/mend.rs",
        "const DEEPEST: usize = 4;",
        "const DEEPEST: usize = 1;",
    )
    .seen_by("mending::several_operations_mend_what_several_spoiled"),
    Fault::wrong(
        "what folds in many places is mended beside a decimated map",
        "crates/crossfield/src/map/parameterize/mod.rs",
        "const MENDABLE: usize = 500;",
        "const MENDABLE: usize = 1;",
    )
    .seen_by("laws::many_folds_beside_a_decimated_map_are_left"),
    Fault::wrong(
        "a star that turns too little is unfolded to the end",
        "crates/crossfield/src/map/unfold/untangle.rs",
        "if epsilon < FIRM && (moves.is_lost)",
        "if epsilon < 0.0 && (moves.is_lost)",
    )
    .seen_by("laws::a_star_that_turns_too_little_is_not_waited_for"),
    Fault::wrong(
        "quads that share two sides stay two",
        "crates/crossfield/src/quads/improve/change.rs",
        "if star.quads.len() == 2 {",
        "if star.quads.len() == 1 {",
    )
    .seen_by("mending::quads_that_share_two_sides_become_one"),
    Fault::wrong(
        "an edge turns one way only",
        "crates/crossfield/src/quads/improve/change.rs",
        "self.with(&[q, other], [[d, a, e, f], [f, b, c, d]]),",
        "self.with(&[q, other], [[c, d, a, e], [e, f, b, c]]),",
    )
    .seen_by("mending::edges_turn_both_ways"),
    Fault::wrong(
        "quads pay no more for irregular vertices than a field does",
        "crates/crossfield/src/options.rs",
        "singularity_penalty: 6.0 * field.singularity_penalty,",
        "singularity_penalty: field.singularity_penalty,",
    )
    .seen_by("laws::a_larger_penalty_leaves_fewer_irregular_vertices"),
    Fault::wrong(
        "a quad faces where the normals at its corners do, even if they disagree",
        "crates/geom-core/src/surface/ground.rs",
        "const AGREE: f64 = 0.5;",
        "const AGREE: f64 = 0.0;",
    )
    .seen_by("mending::the_end_of_a_rod_faces_outwards"),
];
