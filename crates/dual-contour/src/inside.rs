//! Laws of what is not public; each stands beside what it is about. `tests/inside.rs` runs them.

pub use crate::contour::laws::{
    a_diagonal_that_two_edges_want_is_given_to_one, leaves_are_simple_as_a_flood_says,
    leaves_are_split_at_the_tolerance, parts_are_those_of_the_graph_of_the_complex,
};
pub use crate::contour::memory::laws::leaves_without_numbers_are_refused_whatever_the_memory;
pub use crate::contour::stuffing::cut::laws::stencils_fill_their_tetrahedron;
pub use crate::contour::stuffing::snap::laws::an_interface_that_would_pass_an_edge_twice_is_seen;
pub use crate::kernel::cells::laws::{
    dual_vertices_are_those_of_the_specification, extremes_are_seen_wherever_they_stand,
    ranges_and_signs_are_those_of_each_value,
};
pub use crate::kernel::edge_tets::laws::volumes_are_the_same_in_any_lane;
pub use crate::kernel::fan::laws::{
    diagonals_are_best, fans_are_best, fans_are_the_same_in_any_lane,
    the_regular_tetrahedron_has_seventy_degrees,
};
pub use crate::octree::domain::laws::a_point_is_deep_in_its_region_alone;
pub use crate::octree::points::laws::points_are_numbered_in_order;
pub use crate::octree::samples::prune::laws::more_nodes_than_numbers_are_refused;
pub use crate::octree::sizing::laws::{
    a_parabola_has_the_error_worked_out_by_hand, trilinear_fields_have_no_error,
};
pub use crate::octree::tree::laws::{
    large_leaves_are_balanced_too, the_tree_is_the_coarsest_balanced_one,
};
