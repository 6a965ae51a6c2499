//! Laws of what is not public; each stands beside what it is about.

use secondfund_ops::inside;

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
    a_level_of_valence_four_is_the_b_spline
    subdominant_eigenvalues_are_the_known_ones
    patches_meet_without_a_gap_or_a_crease
    basis_functions_sum_to_one_and_their_derivatives_to_zero
    a_face_that_would_turn_over_is_held_back
    a_face_that_would_be_squeezed_is_held_back
    faces_that_would_come_through_others_are_held_back
    what_is_free_lies_in_a_plane_along_an_edge_and_nowhere_at_a_corner
    the_energy_of_a_step_that_does_not_sharpen_falls
    a_tunnel_has_two_mouths
    what_is_deep_is_asked_of_each_chain
    borders_go_to_creases
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
