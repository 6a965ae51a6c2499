//! Faults of `tet-quality`.

use super::Fault;

pub(super) const FAULTS: &[Fault] = &[
    Fault::wrong(
        "an outer sphere is taken for a bubble",
        "crates/tet-quality/src/boundary/input.rs",
        "const BUBBLE: usize = 100;",
        "const BUBBLE: usize = 100_000;",
    ),
    Fault::wrong(
        "vertices where a plane meets the isosurface stay where the mesher left them",
        "crates/tet-quality/src/boundary/curves.rs",
        "*freedom = Freedom::Curve(plane);",
        "*freedom = Freedom::Plane(plane.normal);",
    )
    .seen_by("laws::vertices_where_a_plane_meets_the_isosurface_lie_on_both"),
    Fault::wrong(
        "within a plane the isosurface is sought across it",
        "crates/tet-quality/src/boundary/plane.rs",
        "let gradient = tangent.gradient - along;",
        "let gradient = tangent.gradient + along;",
    )
    .seen_by("thesis::membranes_end_on_the_molecule"),
    Fault::wrong(
        "the wings of a contracted edge may close a triangle",
        "crates/tet-quality/src/mesh/link.rs",
        "l.surface.binary_search(&[w, z]).is_err()",
        "l.surface.binary_search(&[w, z]).is_err() || w != z",
    ),
    Fault::wrong(
        "a face swap may make an edge that is there",
        "crates/tet-quality/src/operations/swap.rs",
        "if mesh.edge_exists(p, r) {",
        "if p == r && mesh.edge_exists(p, r) {",
    ),
    Fault::wrong(
        "cavities may be turned inside out",
        "crates/tet-quality/src/boundary/walls.rs",
        "rise.volume <= 0.0 || wall.volume + rise.volume <= wall.most",
        "rise.volume <= 0.0 || wall.volume + rise.volume <= wall.most.abs()",
    ),
    Fault::wrong(
        "what the boundary forbids is put down to other causes",
        "crates/tet-quality/src/measure/unmet.rs",
        "if forbidden(mesh, t, m, goals) {\n        Cause::Boundary",
        "if forbidden(mesh, t, m, goals) && junctions.len() == usize::MAX {\n        Cause::Boundary",
    ),
    Fault::wrong(
        "the flow goes to no curvature, not to the mean one",
        "crates/tet-quality/src/smoothing/flow.rs",
        "let bend = mean - curvature(&a, &n);",
        "let bend = 0.0 * mean - curvature(&a, &n);",
    ),
    Fault::wrong(
        "vertices in z faces of the box may leave them",
        "crates/tet-quality/src/boundary/input.rs",
        "VertexKind::BoxFace { axis: a } => Freedom::Plane(axis(a)),",
        "VertexKind::BoxFace { axis: a } => Freedom::Plane(axis(a.min(1))),",
    ),
    Fault::wrong(
        "projection may make tetrahedra worse",
        "crates/tet-quality/src/smoothing/smooth.rs",
        "let floor = star.value(&x.coords) - GAIN;",
        "let floor = star.value(&x.coords) - 1.0;",
    ),
    Fault::wrong(
        "flips may leave the isosurface",
        "crates/tet-quality/src/operations/swap.rs",
        "if field.is_some_and(|field| field.distance(&middle) > allowed) {",
        "if field.is_some_and(|field| field.distance(&middle) > 1e3 * allowed) {",
    ),
    Fault::wrong(
        "relax.wgsl: three of the six dihedral angles do not count",
        "shaders/wgsl/tet_quality/relax.wgsl",
        "return v6 * v6 * min(min(inner, outer) / product, 1.2996 * 432.0 / cube);",
        "return v6 * v6 * min(inner / product, 1.2996 * 432.0 / cube);",
    ),
    Fault::wrong(
        "relax.wgsl: the Joe–Liu measure has another weight",
        "shaders/wgsl/tet_quality/relax.wgsl",
        "min(min(inner, outer) / product, 1.2996 * 432.0 / cube);",
        "min(min(inner, outer) / product, 0.9 * 432.0 / cube);",
    ),
    Fault::wrong(
        "measure.wgsl: volumes are wrong by the scale",
        "shaders/wgsl/tet_quality/measure.wgsl",
        "volumes[i] = v6 * scale * scale * scale;",
        "volumes[i] = v6 * scale * scale;",
    ),
    Fault::wrong(
        "measure.wgsl: low words of positions are dropped",
        "shaders/wgsl/tet_quality/measure.wgsl",
        "return high + (positions[2u * b + 1u].xyz - positions[2u * a + 1u].xyz);",
        "return high;",
    ),
    Fault::wrong(
        "relax.wgsl: low words of positions are dropped",
        "shaders/wgsl/tet_quality/relax.wgsl",
        "return high + (low + (moved[v].xyz - moved[o].xyz));",
        "return high + (moved[v].xyz - moved[o].xyz);",
    ),
    Fault::wrong(
        "relax.wgsl: neighbours that have moved count where they were",
        "shaders/wgsl/tet_quality/relax.wgsl",
        "return high + (low + (moved[v].xyz - moved[o].xyz));",
        "return high + low;",
    ),
    Fault::wrong(
        "relax.wgsl: vertices of a surface try the mean of all",
        "shaders/wgsl/tet_quality/relax.wgsl",
        "if batch.slides == 1u {",
        "if batch.slides == 2u {",
    ),
    Fault::wrong(
        "relax.wgsl: the reach is not squared",
        "shaders/wgsl/tet_quality/relax.wgsl",
        "<= batch.reach * batch.reach {",
        "<= batch.reach {",
    ),
    Fault::wrong(
        "large angles are counted from 160 and 170 degrees on",
        "crates/tet-quality/src/measure/report.rs",
        "pub const HIGH_ANGLES: [f64; 2] = [155.0, 165.0];",
        "pub const HIGH_ANGLES: [f64; 2] = [160.0, 170.0];",
    ),
    Fault::wrong(
        "the ends of a contracted edge may have an opposite triangle in common",
        "crates/tet-quality/src/mesh/link.rs",
        "|| !common(&from.triangles, &to.triangles).is_empty()",
        "|| common(&from.triangles, &to.triangles).len() > 99",
    ),
    Fault::poor(
        "changes that gain least are made first",
        "crates/tet-quality/src/operations/operate.rs",
        "steps(b.1.gain).cmp(&steps(a.1.gain))",
        "steps(a.1.gain).cmp(&steps(b.1.gain))",
    ),
    Fault::poor(
        "relax.wgsl: steps shrink slowly",
        "shaders/wgsl/tet_quality/relax.wgsl",
        "const SHRINK = 0.4;",
        "const SHRINK = 0.8;",
    ),
    Fault::wrong(
        "walls part alone or not at all",
        "crates/tet-quality/src/improve/part.rs",
        "[How::Alone, How::WithNeighbours, How::ThroughOthers]",
        "[How::Alone; 3]",
    )
    .seen_by("thesis::neighbours_make_way_for_walls_that_part"),
    Fault::wrong(
        "two regions on one side of the isosurface may meet on it",
        "crates/tet-quality/src/boundary/input.rs",
        "a.is_none() || b.is_none() || a != b",
        "a.is_none() || b.is_none() || a.is_some()",
    )
    .seen_by("laws::a_plane_beside_the_isosurface_stays_plane"),
    Fault::wrong(
        "vertices that other parts share may be moved",
        "crates/tet-quality/src/boundary/input.rs",
        "        *freedom = Freedom::Held;\n",
        "        let _ = freedom;\n",
    )
    .seen_by("parts::parts_improved_alone_fit_together"),
    Fault::wrong(
        "the reserve of goals forgets their shape",
        "crates/tet-quality/src/options.rs",
        "joe_liu: (objective / SHAPE_WEIGHT).min(1.0),",
        "joe_liu: self.joe_liu,",
    )
    .seen_by("laws::the_reserve_is_what_the_passes_aim_at"),
    Fault::wrong(
        "what changes right after a search for crossings is not searched again",
        "crates/tet-quality/src/improve/crossed.rs",
        "mesh.changed[*v as usize] > self.at;",
        "mesh.changed[*v as usize] > self.at + 1;",
    )
    .seen_by("inside::what_has_changed_is_searched_like_the_whole"),
    Fault::wrong(
        "pairs that have not changed are forgotten",
        "crates/tet-quality/src/improve/crossed.rs",
        "(found, std::mem::take(&mut self.pairs))",
        "(found, Vec::<Pair>::new())",
    )
    .seen_by("inside::what_has_changed_is_searched_like_the_whole"),
];
