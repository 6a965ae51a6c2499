//! Laws of what is not public; each stands beside what it is about. `tests/inside.rs` runs them.

pub use crate::catmull::net::laws::subdominant_eigenvalues_are_the_known_ones;
pub use crate::catmull::surface::laws::patches_meet_without_a_gap_or_a_crease;
pub use crate::catmull::tables::laws::{
    a_level_of_valence_four_is_the_b_spline,
    basis_functions_sum_to_one_and_their_derivatives_to_zero,
};
pub use crate::flow::guard::laws::{
    a_face_that_would_be_squeezed_is_held_back, a_face_that_would_turn_over_is_held_back,
    faces_that_would_come_through_others_are_held_back,
};
pub use crate::flow::sheet::laws::what_is_free_lies_in_a_plane_along_an_edge_and_nowhere_at_a_corner;
pub use crate::flow::steps::laws::{
    a_sphere_shrinks_at_the_speed_of_its_curvatures,
    the_energy_of_a_step_that_does_not_sharpen_falls,
};
pub use crate::pockets::measure::laws::{
    a_bent_tunnel_is_deep_in_any_pose, a_closed_cavity_has_its_volume_and_no_mouth,
    a_tunnel_has_two_mouths,
};
pub use crate::pockets::sites::laws::what_is_deep_is_asked_of_each_chain;
pub use crate::segment::clean::laws::{
    borders_go_to_creases, necks_keep_parts_apart, neighbours_that_blur_are_joined,
};
