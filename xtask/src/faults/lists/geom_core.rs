//! Faults of `geom-core`.

use super::Fault;

pub(super) const FAULTS: &[Fault] = &[
    Fault::wrong(
        "what a subtree leaves is added to other columns",
        "crates/geom-core/src/algebra/cholesky/gram.rs",
        "rows[to as usize][lane] += row[from];",
        "rows[to as usize][lane] += row[lane];",
    )
    .seen_by("solver::energies_of_sparse_vectors_are_those_of_solves"),
    Fault::wrong(
        "a shift far below lets the blocks of a basis drift as far as the usual one",
        "crates/geom-core/src/algebra/eigen/lanczos.rs",
        "let alike = (usual / shift).abs().min(1.0);",
        "let alike = (usual / shift).abs().max(1.0).min(1.0);",
    )
    .seen_by("spectral::many_restarts_lose_no_orthogonality"),
    Fault::wrong(
        "a part is counted from the first of those that are held at a time",
        "crates/geom-core/src/algebra/eigen/mod.rs",
        "let index = batch * SIDE_BY_SIDE + i;",
        "let index = i;",
    )
    .seen_by("spectral::many_parts_give_what_each_gives_alone"),
    Fault::wrong(
        "vectors of a small part with a lumped mass are left scaled",
        "crates/geom-core/src/algebra/eigen/direct.rs",
        "row.iter_mut().for_each(|x| *x /= root);",
        "row.iter_mut().for_each(|x| *x *= root);",
    )
    .seen_by("spectral::many_parts_give_what_each_gives_alone"),
    Fault::wrong(
        "the shift is of the size of the largest weights",
        "crates/geom-core/src/algebra/eigen/shifting.rs",
        "let half = diagonal.len() / 2;",
        "let half = diagonal.len() - 1;",
    )
    .seen_by("spectral::weights_of_many_orders_take_no_restart"),
    Fault::wrong(
        "what a column with a negative pivot subtracts has the sign of one with a positive",
        "crates/geom-core/src/algebra/cholesky/multifrontal.rs",
        "let factor = simd.splat_f64s(sign * b[c]);",
        "let factor = simd.splat_f64s(sign * sign * b[c]);",
    )
    .seen_by("solver::signs_of_pivots"),
    Fault::wrong(
        "unknowns of negative pivots keep their sign between the two substitutions",
        "crates/geom-core/src/algebra/cholesky/mod.rs",
        "x[row as usize].iter_mut().for_each(|x| *x = -*x);",
        "x[row as usize].iter_mut().for_each(|x| *x = *x);",
    )
    .seen_by("solver::signs_of_pivots"),
    Fault::wrong(
        "what errors of solutions leave in residuals stays there",
        "crates/geom-core/src/algebra/eigen/lanczos.rs",
        "far.retain(|_| found.next().is_some_and(|r| r > allowed));",
        "far.retain(|_| found.next().is_none());",
    )
    .seen_by("spectral::the_middle_of_the_spectrum"),
    Fault::wrong(
        "Ritz values below the shift come in the order of those above it",
        "crates/geom-core/src/algebra/eigen/lanczos.rs",
        "row[..below].reverse();\n            row[below..].reverse();",
        "row.reverse();",
    )
    .seen_by("spectral::the_middle_of_the_spectrum"),
    Fault::wrong(
        "of the two newest blocks only one loses what rounding brought back",
        "crates/geom-core/src/algebra/eigen/basis.rs",
        "subtract_from_two([&mut newest.values, next],",
        "subtract_from_two([&mut newest.values, &mut next.to_vec()],",
    )
    .seen_by("spectral::many_restarts_lose_no_orthogonality"),
    Fault::wrong(
        "the first row that a column reaches in a subtree is left out",
        "crates/geom-core/src/algebra/cholesky/gram.rs",
        "first.min(task.own.len())",
        "(first + 1).min(task.own.len())",
    )
    .seen_by("solver::energies_of_sparse_vectors_are_those_of_solves"),
    Fault::wrong(
        "a factor in single precision keeps the columns before they are eliminated",
        "crates/geom-core/src/algebra/cholesky/multifrontal.rs",
        "fill(&mut columns)?;",
        "fill(&mut columns.clone())?;",
    )
    .seen_by("solver::a_factor_in_single_precision_is_close_and_symmetric"),
    Fault::wrong(
        "of alternate locations the least occupied is kept",
        "crates/geom-core/src/io/structure/keep.rs",
        ".fold(&sums[0], |b, s| if s.2 > b.2 { s } else { b });",
        ".fold(&sums[0], |b, s| if s.2 < b.2 { s } else { b });",
    ),
    Fault::wrong(
        "coordinates may be no numbers",
        "crates/geom-core/src/io/structure/record.rs",
        "value.is_finite().then_some(value)",
        "Some(value)",
    ),
    Fault::wrong(
        "products of operators are taken from the wrong side",
        "crates/geom-core/src/io/structure/assembly.rs",
        "list.iter().map(|t| outer.after(t)).collect()",
        "list.iter().map(|t| t.after(outer)).collect()",
    ),
    Fault::wrong(
        "an MRC map starts on the other side of the origin",
        "crates/geom-core/src/io/grid/mrc.rs",
        "origin += steps[k] * f64::from(starts[k]);",
        "origin -= steps[k] * f64::from(starts[k]);",
    ),
    Fault::wrong(
        "both planes of a membrane are the upper one",
        "crates/geom-core/src/io/structure/keep.rs",
        "lower: mean(&|z| z < middle),",
        "lower: mean(&|z| z >= middle),",
    ),
    Fault::wrong(
        "BIOMT rotations are transposed",
        "crates/geom-core/src/io/structure/pdb.rs",
        "self.operator.rotation[(index, column)] = *value;",
        "self.operator.rotation[(column, index)] = *value;",
    ),
    Fault::wrong(
        "low and high y of the box change their names",
        "crates/geom-core/src/io/view.rs",
        r#"["ymin", "ymax"], ["zmin", "zmax"]];"#,
        r#"["ymax", "ymin"], ["zmin", "zmax"]];"#,
    ),
    Fault::wrong(
        "a BIOMT operator that ends after its first row is no error",
        "crates/geom-core/src/io/structure/pdb.rs",
        "if reader.atoms > 0 && reader.rows != 0 {",
        "if reader.atoms > 0 && reader.rows == 2 {",
    ),
    Fault::wrong(
        "the rows of a BIOMT operator may bear several names",
        "crates/geom-core/src/io/structure/pdb.rs",
        "let follows = index == self.rows && (index == 0 || name == self.operator_name);",
        "let follows = index == self.rows;",
    ),
    Fault::poor(
        "the fit of curvatures counts all neighbours alike",
        "crates/geom-core/src/surface/curvature.rs",
        "let weight = 1.0 / (0.1 + d.norm_squared() / (scale * scale));",
        "let weight = 1.0;",
    ),
    Fault::wrong(
        "curvatures without the slope of the fitted surface",
        "crates/geom-core/src/surface/curvature.rs",
        "let first = Matrix2::new(1.0 + p * p, p * q, p * q, 1.0 + q * q);",
        "let first = Matrix2::new(1.0, p * q, p * q, 1.0);",
    ),
    Fault::wrong(
        "the Gaussian curvature of a boundary vertex as if it lay inside",
        "crates/geom-core/src/surface/curvature.rs",
        "TAU - PI * (edges - f64::from(n)) - angles[v]",
        "TAU - angles[v]",
    ),
    Fault::wrong(
        "the divergence of a field with the wrong sign",
        "crates/geom-core/src/surface/laplace/mod.rs",
        "hat_gradients(mesh, t).map(|g| -area * g.dot(&field[t]))",
        "hat_gradients(mesh, t).map(|g| area * g.dot(&field[t]))",
    ),
    Fault::wrong(
        "the consistent mass of a pair as of a corner",
        "crates/geom-core/src/surface/laplace/mod.rs",
        "let (pair, corner) = (areas[t] / 12.0, areas[t] / 6.0);",
        "let (pair, corner) = (areas[t] / 6.0, areas[t] / 6.0);",
    ),
    Fault::wrong(
        "distances by heat with an insulated border only",
        "crates/geom-core/src/surface/distance/heat.rs",
        "*u = f64::midpoint(*u, c);",
        "*u += 0.0 * c;",
    ),
    Fault::wrong(
        "memory of a device that is used again is not cleared",
        "crates/geom-core/src/compute/gpu/mod.rs",
        "|array, again| {\n            if again {",
        "|array, again| {\n            if again && array.bytes == 0 {",
    ),
    Fault::wrong(
        "of many ways to a level set, all start where the last one does",
        "crates/geom-core/src/field/project.rs",
        "take(&mut asked, &mut ended, i, walks[i].arrive(answer, guard));",
        "take(&mut asked, &mut ended, i, walks[i.min(7)].arrive(answer, guard));",
    ),
    Fault::wrong(
        "what a border knew before it is numbered again stays",
        "crates/geom-core/src/tiles/border.rs",
        "        border.links.clear();\n",
        "",
    )
    .seen_by("tiles::borders_can_be_numbered_again"),
    Fault::wrong(
        "nobody is told where the ghosts of others end at his vertices",
        "crates/geom-core/src/tiles/border.rs",
        "second[heard.tile as usize - first_tile].push([heard.vertex, heard.of]);",
        "second[heard.tile as usize - first_tile].extend((heard.of == u32::MAX).then_some([heard.vertex, heard.of]));",
    )
    .seen_by("tiles::two_layers_of_ghosts_are_all_that_is_two_elements_away"),
    Fault::wrong(
        "a border holds only what touches it",
        "crates/geom-core/src/tiles/border.rs",
        "first.flatten().for_each(|&v| near[v as usize] = true);",
        "first.flatten().for_each(|&v| near[v as usize] |= false);",
    )
    .seen_by("tiles::two_layers_of_ghosts_are_all_that_is_two_elements_away"),
    Fault::wrong(
        "vertices that go to two tiles are shared by none",
        "crates/geom-core/src/tiles/piece.rs",
        "shared[v] |= first[v] != usize::MAX && first[v] != tile;",
        "shared[v] |= first[v] != usize::MAX && first[v] == usize::MAX;",
    )
    .seen_by("tiles::borders_can_be_numbered_again"),
    Fault::wrong(
        "balls that overlap are patches of their own",
        "crates/geom-core/src/tiles/patches.rs",
        "patches.near(x, 2.0 * radius)",
        "patches.near(x, 0.5 * radius)",
    )
    .seen_by("tiles::patches_that_overlap_have_one_tile"),
    Fault::wrong(
        "what a rank sends to itself counts as sent",
        "crates/geom-core/src/tiles/exchange.rs",
        "to.iter().enumerate().filter(|(r, _)| *r != self.rank())",
        "to.iter().enumerate().filter(|(r, _)| *r < self.ranks())",
    )
    .seen_by("tiles::what_is_sent_to_others_is_counted"),
    Fault::wrong(
        "cells of shifted tiles are looked for where they would be without the shift",
        "crates/geom-core/src/tiles/partition.rs",
        "((c + self.shift) / self.root) as u32",
        "(c / self.root) as u32",
    )
    .seen_by("tiles::every_cell_has_one_tile_and_tiles_are_boxes"),
    Fault::wrong(
        "nodes of a part of MSH bear their numbers in the part",
        "crates/geom-core/src/io/mesh/msh_parts.rs",
        "map(|&v| tag(&part.points[v as usize]))",
        "map(|&v| u64::from(v) + 1)",
    )
    .seen_by("tiles::parts_of_msh_are_what_they_were"),
    Fault::wrong(
        "ghosts in a part of MSH belong to it",
        "crates/geom-core/src/io/mesh/msh_parts.rs",
        "if part.owners[c] != part.number {",
        "if part.owners[c] == u32::MAX {",
    )
    .seen_by("tiles::parts_of_msh_are_what_they_were"),
    Fault::wrong(
        "a part without cells lacks the groups of the others",
        "crates/geom-core/src/io/mesh/vtu.rs",
        "(!view.group_of.is_empty() || empty)",
        "(!view.group_of.is_empty() || (empty && tags.is_empty()))",
    )
    .seen_by("tiles::the_file_that_joins_parts_has_their_fields_and_names"),
    Fault::wrong(
        "a slab joins the molecule's wall to the outer boundary",
        "crates/geom-core/src/io/view.rs",
        "faces.iter().filter(|face| face.outside == OUTSIDE);",
        "faces.iter().filter(|face| face.outside <= OUTSIDE);",
    ),
    Fault::wrong(
        "named volumes lose their numbers",
        "crates/geom-core/src/io/mesh/mod.rs",
        "let is_free = (INTERIOR..OUTSIDE).contains(&tag) && !taken.contains(&tag);",
        "let is_free = (INTERIOR..OUTSIDE).contains(&tag) && taken.contains(&tag);",
    ),
    Fault::wrong(
        "a front does not take over what subtrees of other tasks left",
        "crates/geom-core/src/algebra/cholesky/multifrontal.rs",
        "works[forest.task_of[above]].waiting.push(triangle);",
        "works[forest.task_of[above]].waiting.clear();",
    )
    .seen_by("solver::many_tasks_with_the_same_bits"),
    Fault::wrong(
        "the slabs of a wide front do not change what is right of them",
        "crates/geom-core/src/algebra/cholesky/multifrontal.rs",
        "slab.take_off(behind, height, (to, 0));",
        "slab.take_off(&mut [], height, (to, 0));",
    )
    .seen_by("solver::wide_fronts"),
    Fault::wrong(
        "columns of a block beyond the eighth are those before them",
        "crates/geom-core/src/algebra/tall.rs",
        "let b = &b.values[row * n + j..row * n + j + width];",
        "let b = &b.values[row * n..row * n + width];",
    )
    .seen_by("spectral::any_width_of_a_block"),
    Fault::wrong(
        "corner_distortion.wgsl: the next side's derivative for both",
        "shaders/wgsl/geom_core/corner_distortion.wgsl",
        "out[2u * i + 1u] = vec4<f32>(first.z, second);",
        "out[2u * i + 1u] = vec4<f32>(first.z, first);",
    )
    .seen_by("flows::wgpu_follows_the_cpu"),
    Fault::wrong(
        "a flow may end below its start",
        "crates/geom-core/src/surface/flow/search.rs",
        "let first = if start_counts {",
        "let first = if !start_counts {",
    )
    .seen_by("flows::the_best_may_be_the_start"),
    Fault::wrong(
        "what a round has spoiled is kept",
        "crates/geom-core/src/surface/flow/rounds.rs",
        "by(elements, e, places) < before[e].min(goal);",
        "by(elements, e, places) < -before[e].min(goal);",
    )
    .seen_by("flows::no_round_spoils_an_element"),
    Fault::wrong(
        "vertices slide off tips",
        "crates/geom-core/src/surface/flow/rounds.rs",
        "const OFF: f64 = 0.25;",
        "const OFF: f64 = 25.0;",
    )
    .seen_by("flows::no_round_spoils_an_element"),
    Fault::wrong(
        "a search for the mean looks at the worst",
        "crates/geom-core/src/surface/flow/rounds.rs",
        "self.lift_with_care(how, Raise::Mean(held))",
        "self.lift_with_care(how, if held > 0.0 { Raise::Worst } else { Raise::Mean(held) })",
    )
    .seen_by("flows::a_search_for_the_mean_raises_it_and_holds_the_worst"),
    Fault::wrong(
        "the mean is raised at the cost of the worst",
        "crates/geom-core/src/surface/flow/search.rs",
        "Raise::Mean(held) => held.min(self.worth_now(v, Raise::Worst)),",
        "Raise::Mean(held) => -held,",
    )
    .seen_by("flows::a_search_for_the_mean_raises_it_and_holds_the_worst"),
    Fault::wrong(
        "vertices of many elements slide off tips",
        "crates/geom-core/src/surface/flow/rounds.rs",
        "const FARTHER_OFF: f64 = 0.4;",
        "const FARTHER_OFF: f64 = 40.0;",
    )
    .seen_by("flows::a_search_for_many_spoils_none"),
    Fault::wrong(
        "what a search before has reached stays reached",
        "crates/geom-core/src/surface/distance/mod.rs",
        "self.paths.distance[node] = f64::INFINITY;",
        "self.paths.distance[node] += 0.0;",
    )
    .seen_by("surfaces::shortest_paths_are_shortest"),
    Fault::wrong(
        "the rim of what flows apart is not held",
        "crates/geom-core/src/surface/flow/search.rs",
        "*freedom = Freedom::Fixed;",
        "let _ = freedom;",
    )
    .seen_by("flows::what_is_far_from_bad_elements_stays"),
    Fault::wrong(
        "the middle of a quad alone says how it lies",
        "crates/geom-core/src/surface/ground.rs",
        "let left = 4.0 * (4 - k) as f64;",
        "let left = -4.0 * (4 - k) as f64;",
    )
    .seen_by("flows::a_quad_lies_as_all_of_the_surface_under_it"),
    Fault::wrong(
        "what moves around a vertex leaves what is known of it",
        "crates/geom-core/src/surface/flow/search.rs",
        "seekers.known[w] = None;",
        "let _ = w;",
    )
    .seen_by("flows::a_search_lifts_the_worst"),
    Fault::wrong(
        "neighbours search for better places at once",
        "crates/geom-core/src/surface/flow/search.rs",
        "next[v as usize] = turn + 1;",
        "next[v as usize] = turn;",
    )
    .seen_by("flows::no_search_makes_the_worst_worse"),
    Fault::wrong(
        "loops that shall stay on their thread do not",
        "crates/geom-core/src/compute/parallel.rs",
        "let _back = Back(ALONE.replace(true));",
        "let _back = Back(ALONE.replace(false));",
    )
    .seen_by("compute::loops_alone_stay_on_their_thread"),
    Fault::wrong(
        "loops stay on their thread for ever",
        "crates/geom-core/src/compute/parallel.rs",
        "ALONE.set(self.0);",
        "ALONE.set(true);",
    )
    .seen_by("compute::loops_alone_stay_on_their_thread"),
    Fault::wrong(
        "boxes of triangles are rounded to the nearest",
        "crates/geom-core/src/search/bvh/boxes.rs",
        "near.next_down()",
        "near",
    )
    .seen_by("surfaces::rounding_of_boxes_hides_no_triangle"),
    Fault::wrong(
        "triplets are sorted in a block as if each piece were alone",
        "crates/geom-core/src/algebra/sparse.rs",
        "sorted.iter().flat_map(|piece| piece.of_block(block))",
        "sorted.iter().take(1).flat_map(|piece| piece.of_block(block))",
    )
    .seen_by("solver::triplets_of_many_pieces_are_added_in_their_order"),
    Fault::wrong(
        "rows with a column outside of the matrix are let through",
        "crates/geom-core/src/algebra/sparse.rs",
        "if column >= columns {\n                    return Some(Error::OutOfRange {",
        "if column > columns {\n                    return Some(Error::OutOfRange {",
    )
    .seen_by("solver::triplets_of_many_pieces_are_added_in_their_order"),
    Fault::wrong(
        "of triangles that touch the first that is met is named",
        "crates/geom-core/src/search/bvh/mod.rs",
        "d < best_squared || (d == best_squared && id < b)",
        "d < best_squared || (d == best_squared && id == b)",
    )
    .seen_by("surfaces::of_touching_triangles_the_tree_names_the_lowest"),
    Fault::wrong(
        "two triangles among some are no pair of theirs",
        "crates/geom-core/src/search/crossing.rs",
        "let once = s < t || !is_own;",
        "let once = !is_own;",
    )
    .seen_by("crossings::the_tree_finds_what_all_pairs_find"),
];
