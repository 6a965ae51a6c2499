//! Laws of what is not public; each stands beside what it is about.

use geom_core::testing;

geom_core::laws! {
    dual_contour::inside;
    leaves_are_simple_as_a_flood_says
    parts_are_those_of_the_graph_of_the_complex
    a_diagonal_that_two_edges_want_is_given_to_one
    leaves_are_split_at_the_tolerance
    leaves_without_numbers_are_refused_whatever_the_memory
    stencils_fill_their_tetrahedron
    an_interface_that_would_pass_an_edge_twice_is_seen
    extremes_are_seen_wherever_they_stand
    ranges_and_signs_are_those_of_each_value
    dual_vertices_are_those_of_the_specification
    volumes_are_the_same_in_any_lane
    the_regular_tetrahedron_has_seventy_degrees
    diagonals_are_best
    fans_are_the_same_in_any_lane
    fans_are_best
    a_point_is_deep_in_its_region_alone
    points_are_numbered_in_order
    more_nodes_than_numbers_are_refused
    trilinear_fields_have_no_error
    a_parabola_has_the_error_worked_out_by_hand
    the_tree_is_the_coarsest_balanced_one
    large_leaves_are_balanced_too
}

/// None is handed out and forgotten here.
#[test]
fn every_law_is_run() {
    testing::every_law_is_run(testing::handed_on(include_str!("../src/inside.rs")), RUN);
}
