//! Faults of `dual-contour`.

use super::Fault;

pub(super) const FAULTS: &[Fault] = &[
    Fault::wrong(
        "a cell with two opposite corners inside counts as simple",
        "crates/dual-contour/src/complex/frame.rs",
        "connected(mask) && connected(!mask & 255)",
        "mask == 129 || connected(mask) && connected(!mask & 255)",
    )
    .seen_by("inside::leaves_are_simple_as_a_flood_says"),
    Fault::wrong(
        "of three labels only the first is asked whether it is simple",
        "crates/dual-contour/src/complex/frame.rs",
        "let labels = if n == 2 { &labels[..1] } else { &labels[..n] };",
        "let labels = if n == 2 { &labels[..1] } else { &labels[..n.min(1)] };",
    )
    .seen_by("laws::molecules_of_noise_in_materials_have_closed_surfaces"),
    Fault::wrong(
        "the middle of a cut cell has the value of its first corner",
        "crates/dual-contour/src/complex/split.rs",
        "let value = values.iter().sum::<f64>() / 8.0 + level;",
        "let value = values[0] + level;",
    )
    .seen_by("laws::ambiguous_faces_are_joined_by_the_sign_at_their_saddle"),
    Fault::wrong(
        "points of leaves go to their place whatever tetrahedra say",
        "crates/dual-contour/src/dual/room.rs",
        "if (0..n).all(|i| margin(i, target) > 0.0) {",
        "if (0..n).all(|i| margin(i, target) > f64::NEG_INFINITY) {",
    )
    .seen_by("laws::noise_on_large_leaves_is_manifold_too"),
    Fault::wrong(
        "points of cut cells go to their place whatever tetrahedra say",
        "crates/dual-contour/src/contour/uniform/pattern.rs",
        "margins.iter().all(|&s| s > 0.0)",
        "margins.iter().all(|&s| s >= f64::NEG_INFINITY)",
    )
    .seen_by("laws::random_signs_are_meshed"),
    Fault::wrong(
        "a vertex may snap though a tetrahedron then lies on the interface",
        "crates/dual-contour/src/contour/stuffing/snap.rs",
        "if triangle.iter().all(|&c| out.sign[c as usize] == 0) {",
        "if out.len == 0 && triangle.iter().all(|&c| out.sign[c as usize] == 0) {",
    )
    .seen_by("laws::white_noise_gives_manifold_conforming_meshes"),
    Fault::wrong(
        "a tetrahedron beyond a cut has the label of this side",
        "crates/dual-contour/src/contour/stuffing/cut.rs",
        "emit([P(m), C(p, m), P(y), P(z)], !side);",
        "emit([P(m), C(p, m), P(y), P(z)], side);",
    )
    .seen_by("laws::molecules_of_noise_in_materials_have_closed_surfaces"),
    Fault::wrong(
        "vertices do not step aside from boundaries of materials",
        "crates/dual-contour/src/contour/stuffing/snap.rs",
        "Decision::Stays(self.aside(probe, v))",
        "Decision::Stays(self.aside(probe, v).filter(|_| false))",
    )
    .seen_by("laws::planes_of_materials_are_plane"),
    Fault::wrong(
        "a point deep in a shape belongs to it though another comes first",
        "crates/dual-contour/src/octree/domain.rs",
        "held = held.max(depth.min(left));",
        "held = held.max(depth);",
    )
    .seen_by("inside::a_point_is_deep_in_its_region_alone"),
    Fault::wrong(
        "Newton steps without regularization",
        "crates/dual-contour/src/kernel/mod.rs",
        "pub(crate) const REGULAR: f64 = 0.01;",
        "pub(crate) const REGULAR: f64 = 0.0;",
    )
    .seen_by("backends::dual_vertices_stay_within_their_bound"),
    Fault::wrong(
        "the last value of a block is no extreme of it",
        "crates/dual-contour/src/kernel/cells.rs",
        "for (l, &v) in rest.iter().enumerate() {",
        "for (l, &v) in rest.iter().enumerate().take(8) {",
    )
    .seen_by("inside::extremes_are_seen_wherever_they_stand"),
    Fault::wrong(
        "a corner of cells is that beside it",
        "crates/dual-contour/src/kernel/cells.rs",
        "| corner(LAYER + ROW, 6, x)",
        "| corner(LAYER + ROW + 1, 6, x)",
    )
    .seen_by("inside::ranges_and_signs_are_those_of_each_value"),
    Fault::wrong(
        "fields on devices: edges have the root of the one before",
        "crates/dual-contour/src/dual/probe.rs",
        "let (a, b) = ends[on_level[i]];",
        "let (a, b) = ends[on_level[i.max(1) - 1]];",
    )
    .seen_by("backends::fields_that_take_many_points_give_the_same_mesh"),
    Fault::wrong(
        "fields on devices: gradients per Å are taken per cell",
        "crates/dual-contour/src/dual/probe.rs",
        "gradient: gradient * domain.spacing,",
        "gradient,",
    )
    .seen_by("backends::fields_that_take_many_points_give_the_same_mesh"),
    Fault::wrong(
        "dual_vertices.wgsl: Newton steps of twice the length",
        "shaders/wgsl/dual_contour/dual_vertices.wgsl",
        "x = clamp(x - g * (f / (dot(g, g) + floor)),",
        "x = clamp(x - 2.0 * g * (f / (dot(g, g) + floor)),",
    )
    .seen_by("backends::dual_vertices_stay_within_their_bound"),
    Fault::wrong(
        "no balance towards lower neighbours from 16 cells on",
        "crates/dual-contour/src/octree/tree.rs",
        "let low = [0, 1, 2].map(|k| ((at[k] - 1) >> 1).max(0));",
        "let low = [0, 1, 2].map(|k| (at[k] >> 1).max(0));",
    )
    .seen_by("inside::large_leaves_are_balanced_too"),
    Fault::wrong(
        "no balance towards lower neighbours of 8 cells",
        "crates/dual-contour/src/octree/tree.rs",
        "let low = [0, 1, 2].map(|k| (corner_of(g)[k] - 1) >> 1);",
        "let low = [0, 1, 2].map(|k| corner_of(g)[k] >> 1);",
    )
    .seen_by("inside::large_leaves_are_balanced_too"),
    Fault::wrong(
        "both halves of an edge of two larger leaves may have one diagonal",
        "crates/dual-contour/src/complex/rings.rs",
        "let upper = self.start[self.axis] >> self.log & 1 == 1;",
        "let upper = self.start[self.axis] >> self.log & 1 > 1;",
    )
    .seen_by("inside::a_diagonal_that_two_edges_want_is_given_to_one"),
    Fault::wrong(
        "ambiguous faces join the other pair",
        "crates/dual-contour/src/complex/split.rs",
        "return (saddle >= 0.0) != (v[0] >= 0.0);",
        "return (saddle >= 0.0) == (v[0] >= 0.0);",
    )
    .seen_by("laws::ambiguous_faces_are_joined_by_the_sign_at_their_saddle"),
    Fault::wrong(
        "vertices where three regions meet are held",
        "crates/dual-contour/src/complex/collect.rs",
        "(VertexKind::Interior, _) => VertexKind::Surface,",
        "(VertexKind::Interior, 2) => VertexKind::Surface,",
    )
    .seen_by("options::a_membrane_parts_the_exterior"),
    Fault::wrong(
        "an interface may pass an edge twice",
        "crates/dual-contour/src/contour/stuffing/snap.rs",
        ".all(|(i, sign)| self.arcs(i, sign) <= 1)",
        ".all(|(i, sign)| self.arcs(i, sign) <= 9)",
    )
    .seen_by("inside::an_interface_that_would_pass_an_edge_twice_is_seen")
    .seen_by("inside::an_interface_that_would_pass_an_edge_twice_is_seen"),
    Fault::wrong(
        "half the error counts where leaves are split",
        "crates/dual-contour/src/octree/sizing.rs",
        "return feature_error(&values, edge, self.options.error_norm) > tolerance;",
        "return 0.5 * feature_error(&values, edge, self.options.error_norm) > tolerance;",
    )
    .seen_by("inside::leaves_are_split_at_the_tolerance"),
    Fault::poor(
        "crossings of cut cells may lie in their corners",
        "crates/dual-contour/src/dual/probe.rs",
        "let t = off_ends(probe.crossing(a, b));",
        "let t = probe.crossing(a, b);",
    ),
    Fault::wrong(
        "points that are held at walls stand in one plane",
        "crates/dual-contour/src/dual/probe.rs",
        "const BULGE: f64 = 0.1;",
        "const BULGE: f64 = 0.0;",
    )
    .seen_by("laws::points_that_are_held_are_not_in_one_plane"),
    Fault::wrong(
        "crossings near the ends of their edges are all at one share of it",
        "crates/dual-contour/src/dual/probe.rs",
        "if t < END { 0.5 * (END + t) } else { t }",
        "t.max(END)",
    )
    .seen_by("laws::points_that_are_held_are_not_in_one_plane"),
    Fault::wrong(
        "snapped vertices stay on lines of the lattice",
        "crates/dual-contour/src/contour/stuffing/snap.rs",
        "const ASIDE: f64 = 1e-3;",
        "const ASIDE: f64 = 0.0;",
    )
    .seen_by("laws::points_that_are_held_are_not_in_one_plane"),
    Fault::wrong(
        "cuts that make room do so at one share of their edges",
        "crates/dual-contour/src/contour/stuffing/snap.rs",
        "let share = self.limit(e) * (1.0 + APART * ratio);",
        "let share = self.limit(e);",
    )
    .seen_by("laws::points_that_are_held_are_not_in_one_plane"),
    Fault::wrong(
        "a tile shares no vertex with others",
        "crates/dual-contour/src/contour/tile.rs",
        "tet.iter().for_each(|&v| shared[v as usize] = true);",
        "tet.iter().for_each(|&v| shared[v as usize] = false);",
    )
    .seen_by("tiles::a_rod_and_a_cavity_go_through_all_tiles_on_any_number_of_ranks"),
    Fault::wrong(
        "of a cavity in tiles the volume counts as a body's",
        "crates/geom-core/src/tiles/parts.rs",
        "part.volume += a.dot(&b.cross(&c)) / 6.0;",
        "part.volume += (a.dot(&b.cross(&c)) / 6.0).abs();",
    )
    .seen_by("tiles::a_rod_and_a_cavity_go_through_all_tiles_on_any_number_of_ranks"),
];
