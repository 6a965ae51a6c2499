//! Laws of what is not public; they stand in `src/inside`.

use geom_core::testing;

geom_core::laws! {
    tet_quality::inside;
    edge_removal_is_the_best_of_all_triangulations
    face_swap_undoes_the_removal_of_an_edge_of_three
    swaps_do_not_make_an_edge_twice
    a_split_edge_keeps_volume_and_boundary
    contraction_keeps_a_tetrahedron_bubble
    contraction_keeps_an_octahedron_bubble
    contraction_keeps_the_handle_of_a_torus
    contraction_keeps_the_topology_of_random_bodies
    operations_keep_what_they_must
    a_bubble_off_the_isosurface_belongs_to_it_if_its_regions_do
    what_the_isosurface_surrounds_belongs_to_it
    the_angle_is_the_arc_cosine
    neither_neighbours_nor_vectors_matter
    the_star_judges_like_the_definition
    candidates_are_judged_together_like_alone
    a_tetrahedron_all_of_whose_faces_are_boundary_does_not_vanish
    what_has_changed_is_searched_like_the_whole
}

/// None is written and forgotten here.
#[test]
fn every_law_is_run() {
    let sources = [
        include_str!("../src/inside/boundary.rs"),
        include_str!("../src/inside/links.rs"),
        include_str!("../src/inside/measures.rs"),
        include_str!("../src/inside/operations.rs"),
        include_str!("../src/inside/walls.rs"),
    ];
    let lines = sources.into_iter().flat_map(str::lines);
    let names = lines.filter_map(|line| line.strip_prefix("pub fn ")?.strip_suffix("() {"));
    testing::every_law_is_run(names, RUN);
}
