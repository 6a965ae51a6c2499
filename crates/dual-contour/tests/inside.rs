//! Laws of what is not public; each stands beside what it is about.

use dual_contour::inside;

macro_rules! laws {
    ($($name:ident)*) => {
        $(
            #[test]
            fn $name() {
                inside::$name();
            }
        )*
        const RUN: &[&str] = &[$(stringify!($name)),*];
    };
}

laws! {
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
    let source = include_str!("../src/inside.rs");
    let words = source
        .lines()
        .filter(|line| !line.starts_with("//!"))
        .flat_map(|line| line.split(|c: char| !(c.is_alphanumeric() || c == '_' || c == ':')));
    // Paths lead to the laws; of a law alone its name is the last part.
    let names = words.filter_map(|word| match word.rsplit_once("::") {
        Some((_, name)) => Some(name),
        None if word.contains('_') => Some(word),
        None => None,
    });
    let mut names = Vec::from_iter(names.filter(|name| !name.is_empty()));
    let mut run = RUN.to_vec();
    names.sort_unstable();
    run.sort_unstable();
    assert_eq!(names, run);
}
