//! Laws of what is not public; each stands beside what it is about.

use geom_core::testing;

geom_core::laws! {
    secondfund_ops::inside;
    a_level_of_valence_four_is_the_b_spline
    subdominant_eigenvalues_are_the_known_ones
    patches_meet_without_a_gap_or_a_crease
    basis_functions_sum_to_one_and_their_derivatives_to_zero
    a_face_that_would_turn_over_is_held_back
    a_face_that_would_be_squeezed_is_held_back
    faces_that_would_come_through_others_are_held_back
    what_is_free_lies_in_a_plane_along_an_edge_and_nowhere_at_a_corner
    a_sphere_shrinks_at_the_speed_of_its_curvatures
    the_energy_of_a_step_that_does_not_sharpen_falls
    a_closed_cavity_has_its_volume_and_no_mouth
    a_tunnel_has_two_mouths
    a_bent_tunnel_is_deep_in_any_pose
    what_is_deep_is_asked_of_each_chain
    borders_go_to_creases
    neighbours_that_blur_are_joined
    necks_keep_parts_apart
}

/// None is handed out and forgotten here.
#[test]
fn every_law_is_run() {
    testing::every_law_is_run(testing::handed_on(include_str!("../src/inside.rs")), RUN);
}
