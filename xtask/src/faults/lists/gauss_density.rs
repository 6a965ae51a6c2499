//! Faults of `gauss-density`.

use super::Fault;

pub(super) const FAULTS: &[Fault] = &[
    Fault::wrong(
        "the root of a density is the density",
        "crates/gauss-density/src/sample/root.rs",
        "2.0 * density.max(0.0).sqrt() - 1.0",
        "density.max(0.0)",
    )
    .seen_by("laws::the_root_crosses_nearly_where_the_density_does"),
    Fault::wrong(
        "the cull spends 16 times what it may",
        "crates/gauss-density/src/kernel/cull.rs",
        "let ln_rho = budget.rho.ln();",
        "let ln_rho = (16.0 * budget.rho).ln();",
    )
    .seen_by("kernels::culls_never_break_their_bound"),
    Fault::wrong(
        "the level below which a sum does not matter, without the power",
        "crates/gauss-density/src/kernel/cull.rs",
        "theta: (ln_floor - ln_kept) / power,",
        "theta: ln_floor - ln_kept,",
    )
    .seen_by("kernels::culls_never_break_their_bound"),
    Fault::wrong(
        "the reach is taken before the powers",
        "crates/gauss-density/src/model/reach.rs",
        "worst = worst.max(t / low).max(t / high.min(1.0));",
        "worst = worst.max(t);",
    )
    .seen_by("laws::dense_values_are_within_the_cut_off"),
    Fault::wrong(
        "the radius of the fastest decay, not of the slowest",
        "crates/gauss-density/src/model/reach.rs",
        "(self.radius * self.radius + t.max(0.0) / self.decay).sqrt()",
        "(self.radius * self.radius + t.max(0.0) / self.fastest_decay).sqrt()",
    )
    .seen_by("kernels::culls_never_break_their_bound"),
    Fault::wrong(
        "an atom goes without another look after others went",
        "crates/gauss-density/src/atoms/eliminate.rs",
        "if self.changed[place.cell as usize] {",
        "if false && self.changed[place.cell as usize] {",
    )
    .seen_by("laws::elimination_keeps_its_bound_at_every_sample_recomputed_by_brute_force"),
    Fault::wrong(
        "the low pass without mirror frequencies",
        "crates/gauss-density/src/sample/low_pass.rs",
        "let wave = i.min(n - i) as f64 * unit(n);",
        "let wave = i as f64 * unit(n);",
    )
    .seen_by("laws::the_low_pass_filter_smooths_without_new_surfaces"),
    Fault::wrong(
        "the coarse cull of the point sampler spends 16 times what it may",
        "crates/gauss-density/src/sample/point.rs",
        "all.cull_into(&(&around).into(), eps / 4.0, floor, scratch, &mut coarse);",
        "all.cull_into(&(&around).into(), 16.0 * eps, floor, scratch, &mut coarse);",
    )
    .seen_by("bounds::a_crowd_costs_no_more_than_it_may_at_points"),
    Fault::wrong(
        "the lines that an atom reaches start one late",
        "crates/gauss-density/src/kernel/direct.rs",
        "lines.low[k] = ceil_to_side((x - reach[i]) * per_spacing + MIDDLE);",
        "lines.low[k] = ceil_to_side((x - reach[i]) * per_spacing + MIDDLE + 1.0);",
    )
    .seen_by("backends::cpu_follows_the_plain_density_far_from_the_origin"),
    Fault::wrong(
        "the interior is not capped: a solid body keeps every atom",
        "crates/gauss-density/src/atoms/samples.rs",
        "Some(_) => wanted.band[1],",
        "Some(_) => f64::INFINITY,",
    )
    .seen_by("laws::elimination_of_nothing_and_of_protected_atoms"),
    Fault::wrong(
        "the surface that grew counts as no error",
        "crates/gauss-density/src/sample/compare.rs",
        "let off = (1.0 - exact).abs() / exact;",
        "let off = (1.0 - exact).max(0.0) / exact;",
    )
    .seen_by("laws::the_error_on_the_new_surface_is_near_the_bound"),
    Fault::wrong(
        "cull.wgsl: the bracket of two atoms without what it bulges",
        "shaders/wgsl/gauss_density/cull.wgsl",
        "value += s * s / (-4.0 * bend);",
        "value += 0.0;",
    )
    .seen_by("backends::a_thousand_trees_are_within_their_bounds_on_wgpu"),
    Fault::wrong(
        "cull.wgsl: bounds of terms fall short",
        "shaders/wgsl/gauss_density/cull.wgsl",
        "state[i + shift] = vec4<f32>(up + slack, ln, 1.0, f32(i - base));",
        "state[i + shift] = vec4<f32>(up - 8.0, ln, 1.0, f32(i - base));",
    )
    .seen_by("backends::a_thousand_trees_are_within_their_bounds_on_wgpu"),
    Fault::wrong(
        "atom_errors.wgsl: the target's share is ignored",
        "shaders/wgsl/gauss_density/atom_errors.wgsl",
        "change = max(1.0 - exp2(left - full) / site.share, 0.0);",
        "change = max(1.0 - exp2(left - full), 0.0);",
    )
    .seen_by("backends::wgpu_follows_the_plain_errors_and_refit"),
    Fault::wrong(
        "the default sampler leaves out 8 times what it may",
        "crates/gauss-density/src/kernel/direct.rs",
        "self.exponent = (t * LOG2_E + 1e-3) as f32;",
        "self.exponent = (t * LOG2_E - 3.0) as f32;",
    )
    .seen_by("bounds::a_crowd_costs_no_more_than_it_may_on_the_cpu"),
    Fault::wrong(
        "boxes of bricks without the cell below, for the default sampler",
        "crates/gauss-density/src/kernel/direct.rs",
        "let of = (t - 4.5 * spacing).max(0.0);",
        "let of = (t - 3.5 * spacing).max(0.0);",
    )
    .seen_by("laws::the_band_is_that_of_brute_force"),
    Fault::wrong(
        "boxes of bricks without the cell below, for the others",
        "crates/gauss-density/src/kernel/boxes.rs",
        "low.map(|b| (b * BRICK) as i64 - 1),",
        "low.map(|b| (b * BRICK) as i64),",
    )
    .seen_by("bounds::both_ends_of_a_crossing_between_bricks_have_values_where_kernels_are_high"),
    Fault::poor(
        "the descent to blocks without the cell below",
        "crates/gauss-density/src/sample/blocks.rs",
        "let first = low.map(|b| (b * BLOCK * BRICK) as i64 - 1);",
        "let first = low.map(|b| (b * BLOCK * BRICK) as i64);",
    )
    .seen_by("bounds::both_ends_of_a_crossing_between_bricks_have_values_where_kernels_are_high"),
    Fault::wrong(
        "two atoms of unequal decays are compared as if their difference were straight",
        "crates/gauss-density/src/kernel/direct.rs",
        "most[lane] = own[lane] - others[lane] + swing[lane] * half + bend;",
        "most[lane] = own[lane] - others[lane] + swing[lane] * half + 0.0 * bend;",
    )
    .seen_by("kernels::no_difference_of_two_atoms_in_a_brick_is_above_its_bound"),
    Fault::wrong(
        "atoms that others outweigh may cost 16 times what they may",
        "crates/gauss-density/src/model/reach.rs",
        "let share = rho / (self.powers.len() as f64 * grown);",
        "let share = 16.0 * rho / (self.powers.len() as f64 * grown);",
    )
    .seen_by("bounds::a_crowd_costs_no_more_than_it_may_on_the_cpu"),
    Fault::wrong(
        "an interior brick is crossed from above only",
        "crates/gauss-density/src/sample/band.rs",
        "let below = (brick[axis] > 0).then(",
        "let below = false.then(",
    )
    .seen_by("samples::an_interior_brick_is_crossed_from_either_side_on_every_axis"),
    Fault::wrong(
        "crossings of z edges are no samples",
        "crates/gauss-density/src/atoms/samples.rs",
        "for axis in 0..3 {\n                let mut q = p;\n                q[axis] += 1;\n                let crosses",
        "for axis in 0..2 {\n                let mut q = p;\n                q[axis] += 1;\n                let crosses",
    )
    .seen_by("samples::every_crossing_of_a_lattice_edge_is_a_sample_on_every_axis"),
    Fault::wrong(
        "offsets for the device are subtracted in f32",
        "crates/gauss-density/src/wgpu/mod.rs",
        "let offset = model.centers()[a] - center;",
        "let offset = (model.centers()[a].cast::<f32>() - center.cast::<f32>()).cast::<f64>();",
    )
    .seen_by("backends::wgpu_follows_the_plain_density_far_from_the_origin"),
    Fault::wrong(
        "cull.wgsl spends 16 times what it may",
        "shaders/wgsl/gauss_density/cull.wgsl",
        "let budget = exp2(params.eps);",
        "let budget = 16.0 * exp2(params.eps);",
    )
    .seen_by("bounds::a_crowd_costs_no_more_than_it_may_on_wgpu"),
    Fault::wrong(
        "density.wgsl: a larger term forgets those before it",
        "shaders/wgsl/gauss_density/density.wgsl",
        "sum[0] = select(sum[0] + share, sum[0] * share + 1.0, rise > 0.0);",
        "sum[0] = select(sum[0] + share, 1.0, rise > 0.0);",
    )
    .seen_by("backends::wgpu_follows_the_plain_density"),
    Fault::wrong(
        "points.wgsl: low parts of places are dropped",
        "shaders/wgsl/gauss_density/points.wgsl",
        "(place.high - item.at.xyz) + (place.low - low[atom].xyz);",
        "place.high - item.at.xyz;",
    )
    .seen_by("backends::wgpu_follows_the_plain_points"),
    Fault::wrong(
        "points.wgsl: gradients pass levels without their powers",
        "shaders/wgsl/gauss_density/points.wgsl",
        "slope[l] * (power / sum[l]));",
        "slope[l] / sum[l]);",
    )
    .seen_by("backends::wgpu_follows_the_plain_points"),
    Fault::wrong(
        "settle.wgsl: atoms keep the decays that they had at the start",
        "shaders/wgsl/gauss_density/settle.wgsl",
        "vec4<f32>(at, atom.high.w);",
        "vec4<f32>(at, items[item].at.w);",
    )
    .seen_by("backends::a_trial_of_a_refit_sends_its_atoms_alone"),
    Fault::wrong(
        "gather.wgsl: the sums of runs before are lost",
        "shaders/wgsl/gauss_density/gather.wgsl",
        "var total = totals[id.x * 10u + p];",
        "var total = 0.0;",
    )
    .seen_by("gpu::cells_may_come_in_many_runs"),
    Fault::wrong(
        "elimination leaves holes between its samples",
        "crates/gauss-density/src/atoms/eliminate.rs",
        "(old.at(p) >= cap && new.at(p) < least)",
        "(old.at(p) >= cap && new.at(p) < 0.0 * least)",
    )
    .seen_by("laws::a_solid_body_opens_nowhere_between_its_samples"),
    Fault::poor(
        "the refit starts from the same step for every parameter",
        "crates/gauss-density/src/atoms/refit.rs",
        "let free = if start.is_protected(a) { 0.0 } else { sign };\n            std::array::from_fn(|p| at[p] + free * by[p])",
        "let free = if start.is_protected(a) { 0.0 } else { 0.5 * sign };\n            std::array::from_fn(|p| at[p] + free * by[p])",
    ),
];
