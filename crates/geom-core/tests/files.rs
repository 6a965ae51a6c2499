//! Mesh files: what is written is read back.

use std::collections::BTreeSet;

use geom_core::io::view::{Cells, NO_GROUP};
use geom_core::io::{
    AnyMesh, Encoding, Group, MeshFile, View, glb, mesh, msh, obj, off, ply, stl, vtu,
};
use geom_core::mesh::{BoundaryComparison, EXTERIOR, INTERIOR, SurfaceAudit, VolumeAudit, shapes};
use geom_core::{QuadMesh, TetMesh, TriMesh};

fn msh_options() -> Vec<msh::Options> {
    let mut all = Vec::new();
    for version in [msh::Version::V41, msh::Version::V22] {
        for encoding in [Encoding::Binary, Encoding::Ascii] {
            all.push(msh::Options { version, encoding });
        }
    }
    all
}

/// A surface with fields of all number types and colours.
fn rich(mesh: &TriMesh) -> View<'_> {
    let n = mesh.positions().len();
    let f = mesh.triangles().len();
    let colors: Vec<[u8; 4]> = (0..n).map(|i| [i as u8, 255 - i as u8, 7, 255]).collect();
    View::from(mesh)
        .point_field(
            "height",
            mesh.positions().iter().map(|p| p.z).collect::<Vec<f64>>(),
        )
        .unwrap()
        .point_field("normal", mesh.vertex_normals().as_slice())
        .unwrap()
        .point_field("chain", (0..n as u32).collect::<Vec<u32>>())
        .unwrap()
        .cell_field(
            "patch",
            (0..f).map(|i| (i % 200) as u8).collect::<Vec<u8>>(),
        )
        .unwrap()
        .cell_field("shift", (0..f).map(|i| 7 - i as i32).collect::<Vec<i32>>())
        .unwrap()
        .cell_field("size", (0..f).map(|i| i as f32 / 3.0).collect::<Vec<f32>>())
        .unwrap()
        .colored(colors)
        .unwrap()
}

#[test]
fn vtu_keeps_everything() {
    let torus = shapes::torus(5.0, 2.0, 12, 8);
    let view = rich(&torus);
    let mut file = Vec::new();
    vtu::write(&mut file, &view).unwrap();
    assert_eq!(vtu::parse(&file).unwrap(), view);

    let ball = shapes::ball(3.0, 3);
    let view = View::from(&ball);
    let mut file = Vec::new();
    vtu::write(&mut file, &view).unwrap();
    assert_eq!(vtu::parse(&file).unwrap(), view);
}

#[test]
fn ply_keeps_everything_but_groups() {
    let torus = shapes::torus(5.0, 2.0, 12, 8);
    let view = rich(&torus);
    for encoding in [Encoding::Binary, Encoding::Ascii] {
        let mut file = Vec::new();
        ply::write(&mut file, &view, encoding).unwrap();
        assert_eq!(ply::parse(&file).unwrap(), view, "{encoding:?}");
    }
}

/// Without a field `region` and without groups, regions are what another program's field says; numbers that are no regions are
/// counted from 2 on. They all became the molecule, and an improvement would have moved their interface.
#[test]
fn regions_of_other_programs_are_known() {
    let ball = shapes::ball_in_box(2.0, 4.0, 3);
    let read = |name: &str, of: [f64; 2]| {
        let mut view = View::from(&ball);
        view.cell_fields.clear();
        view.groups.clear();
        view.group_of = Vec::new().into();
        let regions = ball.regions().iter();
        let values: Vec<f64> = regions.map(|&r| of[usize::from(r)]).collect();
        let view = view.cell_field(name, values).unwrap();
        let mut file = Vec::new();
        vtu::write(&mut file, &view).unwrap();
        match MeshFile::try_from(vtu::parse(&file).unwrap()).unwrap().mesh {
            AnyMesh::Tet(mesh) => mesh,
            other => panic!("{other:?}"),
        }
    };
    for (name, of, wanted) in [
        ("gmsh:physical", [7.0, 12.0], [7, 12]),
        ("CellEntityIds", [0.0, 1.0], [0, 1]),
        ("medit:ref", [1000.0, -3.0], [3, 2]),
        ("Material", [3.5, 1.0], [INTERIOR, INTERIOR]),
        ("pressure", [7.0, 12.0], [INTERIOR, INTERIOR]),
    ] {
        let mesh = read(name, of);
        let regions = ball.regions().iter().map(|&r| wanted[usize::from(r)]);
        assert!(mesh.regions().iter().copied().eq(regions), "{name}");
    }
}

#[test]
fn msh_keeps_groups_and_numbers() {
    let ball = shapes::ball_in_box(2.0, 4.0, 3);
    let quality: Vec<f64> = (0..ball.tets().len())
        .map(|t| 1.0 / (1.0 + t as f64))
        .collect();
    let view = View::from(&ball)
        .point_field(
            "phi",
            ball.positions().iter().map(|p| p.x).collect::<Vec<f64>>(),
        )
        .unwrap()
        .cell_field("quality", &quality)
        .unwrap();
    for options in msh_options() {
        let mut file = Vec::new();
        msh::write(&mut file, &view, options).unwrap();
        let again = msh::parse(&file).unwrap();
        assert_eq!(again.points, view.points, "{options:?}");
        assert_eq!(again.point_fields, view.point_fields);
        // Cells are sorted by group, each with its values.
        let cells = |v: &View<'_>| {
            let values = |name: &str| v.find_cell_field(name).unwrap().values.to_f64();
            let (regions, qualities) = (values("region"), values("quality"));
            let corners = v.blocks.iter().flat_map(Cells::iter);
            let mut cells: Vec<_> = corners
                .zip(v.group_of.iter())
                .zip(regions.iter().zip(&qualities))
                .map(|((corners, &g), (region, quality))| {
                    assert_ne!(g, NO_GROUP);
                    let group = &v.groups[g as usize];
                    let group = (group.name.clone(), group.dimension);
                    (corners.to_vec(), group, region.to_bits(), quality.to_bits())
                })
                .collect();
            cells.sort_unstable();
            cells
        };
        assert_eq!(cells(&again), cells(&view), "{options:?}");
        let mut file = Vec::new();
        msh::write(&mut file, &again, options).unwrap();
        let third = msh::parse(&file).unwrap();
        assert_eq!(third.blocks, again.blocks, "sorted cells keep their order");
        assert_eq!(cells(&third), cells(&again));
        let MeshFile { mesh, faces, .. } = MeshFile::try_from(again).unwrap();
        let AnyMesh::Tet(mesh) = mesh else {
            panic!("tetrahedra are read as tetrahedra");
        };
        for region in [INTERIOR, EXTERIOR] {
            let of = |mesh: &TetMesh| mesh.region_volume(region);
            assert!((of(&mesh) - of(&ball)).abs() < 1e-9);
        }
        assert_eq!(faces.len(), ball.interfaces().len());
    }
}

#[test]
fn solvers_find_regions_and_boundaries_by_name() {
    let mesh = shapes::ball_in_box(2.0, 4.0, 3);
    let named = |mesh: &TetMesh| -> Vec<String> {
        let view = View::from(mesh);
        let mut names: Vec<String> = view.groups.iter().map(|g| g.name.clone()).collect();
        names.sort();
        names
    };
    let sides = [
        "box_xmax", "box_xmin", "box_ymax", "box_ymin", "box_zmax", "box_zmin",
    ];
    let mut all = sides.to_vec();
    all.extend(["exterior", "molecule", "molecule|exterior"]);
    assert_eq!(named(&mesh), all);
    // Sides lie where their names say.
    let (view, bounds) = (View::from(&mesh), mesh.bounds());
    let faces = view.blocks[1]
        .iter()
        .zip(&view.group_of[view.blocks[0].len()..]);
    for (corners, &group) in faces {
        let name = &view.groups[group as usize].name;
        let Some(side) = name.strip_prefix("box_") else {
            continue;
        };
        let axis = ["x", "y", "z"]
            .iter()
            .position(|a| side.starts_with(a))
            .unwrap();
        let place = if side.ends_with("min") {
            bounds.min
        } else {
            bounds.max
        };
        for &corner in corners {
            assert_eq!(view.points[corner as usize][axis], place[axis], "{name}");
        }
    }

    // The exterior alone keeps the name of the molecule's surface.
    let (positions, tets, regions, kinds) = mesh.into_parts();
    let outside: Vec<[u32; 4]> = tets
        .iter()
        .zip(&regions)
        .filter(|(_, r)| **r == EXTERIOR)
        .map(|(t, _)| *t)
        .collect();
    let n = outside.len();
    let outside = TetMesh::with_kinds(positions, outside, vec![EXTERIOR; n], kinds).unwrap();
    let mut all = sides.to_vec();
    all.extend(["exterior", "molecule|exterior"]);
    assert_eq!(named(&outside), all);

    assert_eq!(
        named(&shapes::ball(1.0, 2)),
        ["molecule", "molecule|exterior"]
    );

    // An outer boundary that is no box.
    let shell = shapes::shell(1.0, 3.0, 3);
    assert_eq!(named(&shell), ["exterior", "molecule|exterior", "outer"]);
    let view = View::from(&shell);
    let inner = view
        .groups
        .iter()
        .position(|g| g.name == "molecule|exterior");
    let faces = view.blocks[1]
        .iter()
        .zip(&view.group_of[view.blocks[0].len()..]);
    for (corners, &group) in faces {
        let radius = view.points[corners[0] as usize].coords.norm();
        assert_eq!(Some(group as usize) == inner, radius < 2.0);
    }
}

/// A slab from the molecule to the outer boundary parts the exterior from neither: the names are those that both have with the
/// molecule meshed.
#[test]
fn a_slab_leaves_the_outer_boundary_its_name() {
    let (positions, tets, _, kinds) = shapes::shell(1.0, 3.0, 4).into_parts();
    let slab = |t: &[u32; 4]| {
        let z: f64 = t.iter().map(|&v| positions[v as usize].z).sum();
        if (z / 4.0).abs() < 0.6 { 2 } else { EXTERIOR }
    };
    let regions = tets.iter().map(slab).collect();
    let mesh = TetMesh::with_kinds(positions, tets, regions, kinds).unwrap();
    let view = View::from(&mesh);
    let faces = view.blocks[1]
        .iter()
        .zip(&view.group_of[view.blocks[0].len()..]);
    let mut seen = BTreeSet::new();
    for (corners, &group) in faces {
        let group = &view.groups[group as usize];
        seen.insert((group.name.as_str(), group.tag.unwrap()));
        let radii = corners
            .iter()
            .map(|&v| view.points[v as usize].coords.norm());
        let (low, high) = radii.fold((9.0f64, 0.0f64), |(l, h), r| (l.min(r), h.max(r)));
        match group.name.as_str() {
            "outer" => assert!(low > 2.9),
            "molecule|exterior" | "region_2|molecule" => assert!(high < 1.1),
            _ => {}
        }
    }
    let names = [
        ("molecule|exterior", 512),
        ("outer", 263),
        ("region_2|exterior", 768),
        ("region_2|molecule", 769),
    ];
    assert_eq!(seen, names.into());
}

/// A mesh of other programs: its volumes have names and numbers, or numbers in a field that its patches have, too.
#[test]
fn numbers_of_volumes_and_patches_are_kept() {
    let mesh = shapes::ball(2.0, 2);
    let mut view = View::from(&mesh);
    view.cell_fields.clear();
    let (tets, faces) = (view.blocks[0].len(), view.blocks[1].len());
    let names = |view: &View<'_>| -> Vec<(String, Option<i32>)> {
        let groups = view.groups.iter().map(|g| (g.name.clone(), g.tag));
        groups.collect()
    };
    view.groups[0].name = "steel".to_owned();
    view.groups[0].tag = Some(7);
    let read = |view: &View<'_>| {
        let mut file = Vec::new();
        vtu::write(&mut file, view).unwrap();
        let read: MeshFile = vtu::parse(&file).unwrap().try_into().unwrap();
        let AnyMesh::Tet(mesh) = read.mesh.clone() else {
            panic!("tetrahedra are read as tetrahedra");
        };
        (read, mesh)
    };
    let (named, steel) = read(&view);
    assert_eq!(names(&view)[0], ("steel".to_owned(), Some(7)));
    assert!(steel.regions().iter().all(|&r| r == 7));
    assert_eq!(named.groups, view.groups);

    (view.groups, view.group_of) = (Vec::new(), Vec::new().into());
    let physical = |cell: usize| match cell.checked_sub(tets) {
        None => 7,
        Some(face) => [9, 11, 0][3 * face / faces],
    };
    let numbers: Vec<i32> = (0..tets + faces).map(physical).collect();
    let numbered = view.cell_field("gmsh:physical", numbers).unwrap();
    let (numbered, steel) = read(&numbered);
    assert!(steel.regions().iter().all(|&r| r == 7));
    let tags: Vec<_> = numbered
        .groups
        .iter()
        .map(|g| (g.dimension, g.tag))
        .collect();
    assert_eq!(tags, [(2, Some(9)), (2, Some(11))]);
    assert_eq!(numbered.groups[0].name, "physical 9");
    assert_eq!(numbered.faces.len(), faces);
    for (face, (_, group)) in numbered.faces.iter().enumerate() {
        let wanted = [0, 1, NO_GROUP][3 * face / faces];
        assert_eq!(*group, wanted);
    }
}

#[test]
fn a_bad_stl_triangle_is_named() {
    let facet = "facet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\n";
    let text = format!(
        "solid a\n{facet}{}endsolid a\n",
        facet.replacen("1 0 0", "1 zero 0", 1)
    );
    let error = stl::parse(text.as_bytes()).unwrap_err().to_string();
    assert!(error.contains("STL triangle 2"), "{error}");
}

#[test]
fn surface_formats_keep_what_they_can_hold() {
    let torus = shapes::torus(5.0, 2.0, 12, 8);
    let view = rich(&torus);
    let mut file = Vec::new();
    off::write(&mut file, &view).unwrap();
    let again = off::parse(&file).unwrap();
    assert_eq!((&again.points, &again.blocks), (&view.points, &view.blocks));
    assert_eq!(again.colors, view.colors);

    let mut file = Vec::new();
    obj::write(&mut file, &view).unwrap();
    let again = obj::parse(&file).unwrap();
    assert_eq!((&again.points, &again.blocks), (&view.points, &view.blocks));
    assert_eq!(again.colors, view.colors);

    let mut file = Vec::new();
    glb::write(&mut file, &view).unwrap();
    let again = glb::parse(&file).unwrap();
    assert_eq!((&again.blocks, &again.colors), (&view.blocks, &view.colors));
    for (a, b) in again.points.iter().zip(view.points.iter()) {
        assert!((a - b).norm() < 1e-6);
    }

    let mut file = Vec::new();
    stl::write(&mut file, &view).unwrap();
    assert_eq!(file.len(), 84 + 50 * torus.triangles().len());
    let MeshFile { mesh, .. } = stl::parse(&file).unwrap().try_into().unwrap();
    let AnyMesh::Tri(mesh) = mesh else {
        panic!("STL holds triangles");
    };
    let audit = SurfaceAudit::of(&mesh);
    assert!(audit.is_closed_manifold(), "{audit}");
    assert_eq!(audit.components[0].genus(), Some(1));
    assert!((mesh.volume() - torus.volume()).abs() < 1e-5 * torus.volume());
}

#[test]
fn a_tetrahedral_mesh_gives_its_surface_to_surface_formats() {
    let ball = shapes::ball(2.0, 3);
    let mut file = Vec::new();
    ply::write(&mut file, &View::from(&ball), Encoding::Binary).unwrap();
    let surface: MeshFile = ply::parse(&file).unwrap().try_into().unwrap();
    let AnyMesh::Tri(surface) = surface.mesh else {
        panic!("a surface");
    };
    assert!(BoundaryComparison::of(&ball, INTERIOR, &surface).is_equal());
}

/// Readers that look at a tag without its dimension, as meshio does in MSH 2.2, would take the surface of the molecule for the
/// exterior around it, and a side of the box for the molecule.
#[test]
fn no_face_has_the_tag_of_a_region() {
    let body = shapes::ball_in_box(2.0, 4.0, 2);
    let outside = shapes::shell(2.0, 4.0, 2);
    let bare = View {
        groups: View::of_tets(&body, &[])
            .groups
            .into_iter()
            .map(|group| Group { tag: None, ..group })
            .collect(),
        ..View::of_tets(&body, &[])
    };
    for view in [
        View::of_tets(&body, &[]),
        View::of_tets(&outside, &[]),
        bare,
    ] {
        let mut file = Vec::new();
        let options = msh::Options {
            version: msh::Version::V22,
            encoding: Encoding::Ascii,
        };
        msh::write(&mut file, &view, options).unwrap();
        let text = String::from_utf8(file).unwrap();
        let names = text
            .split("$PhysicalNames\n")
            .nth(1)
            .and_then(|rest| rest.split("$EndPhysicalNames").next())
            .unwrap();
        let tags: Vec<&str> = names
            .lines()
            .skip(1)
            .map(|line| line.split(' ').nth(1).unwrap())
            .collect();
        let different: BTreeSet<&str> = tags.iter().copied().collect();
        assert_eq!(tags.len(), view.groups.len());
        assert_eq!(different.len(), tags.len(), "{names}");
    }
}

#[test]
fn quads_and_polygons_are_kept_where_they_can_be() {
    let (positions, _) = shapes::torus(5.0, 2.0, 6, 4).into_parts();
    let at = |i: u32, j: u32| (i % 6) * 4 + j % 4;
    let quads: Vec<[u32; 4]> = (0..24)
        .map(|q| (q / 4, q % 4))
        .map(|(i, j)| [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)])
        .collect();
    let mesh = QuadMesh::new(positions, quads).unwrap();
    let view = View::from(&mesh);
    let folder = tempfile::tempdir().unwrap();
    for name in ["a.ply", "a.off", "a.obj", "a.vtu", "a.msh"] {
        let path = folder.path().join(name);
        mesh::save(&path, &view).unwrap();
        let again = mesh::read(&path).unwrap();
        assert_eq!(again.mesh, AnyMesh::Quad(mesh.clone()), "{name}");
    }
    for name in ["a.stl", "a.glb"] {
        let path = folder.path().join(name);
        mesh::save(&path, &view).unwrap();
        let triangles = mesh::read(&path).unwrap().mesh.into_triangles();
        assert!(SurfaceAudit::of(&triangles).is_closed_manifold(), "{name}");
    }

    let pentagon = View {
        blocks: vec![Cells::Polygons {
            ends: vec![5, 8].into(),
            corners: vec![0, 1, 2, 3, 4, 5, 6, 7].into(),
        }],
        ..view.clone()
    };
    for name in ["b.ply", "b.off", "b.obj", "b.vtu"] {
        let path = folder.path().join(name);
        mesh::save(&path, &pentagon).unwrap();
        let bytes = std::fs::read(&path).unwrap();
        let again = mesh::parse(&bytes, &name[2..]).unwrap();
        assert_eq!(again.blocks, pentagon.blocks, "{name}");
        let cut = MeshFile::try_from(again).unwrap();
        assert_eq!(cut.face_of, [0, 0, 0, 1], "{name}");
    }
    let refused = mesh::save(folder.path().join("b.msh"), &pentagon).unwrap_err();
    assert!(refused.to_string().contains("5 corners"), "{refused}");
    assert!(!folder.path().join("b.msh").exists());
}

#[test]
fn a_wrong_number_of_values_is_refused() {
    let sphere = shapes::icosphere(1.0, 1);
    let error = View::from(&sphere)
        .point_field("density", vec![1.0; 3])
        .unwrap_err();
    assert!(error.to_string().contains("density"), "{error}");
    assert!(View::from(&sphere).cell_field("q", vec![1u8; 3]).is_err());
    assert!(View::from(&sphere).colored(vec![[0; 4]; 3]).is_err());
}

#[test]
fn volumes_survive_a_walk_through_files() {
    let mesh = shapes::ball_in_box(2.0, 4.0, 3);
    let folder = tempfile::tempdir().unwrap();
    for name in ["a.vtu", "a.msh"] {
        let path = folder.path().join(name);
        mesh::save(&path, &View::from(&mesh)).unwrap();
        let AnyMesh::Tet(again) = mesh::read(&path).unwrap().mesh else {
            panic!("{name} holds tetrahedra");
        };
        let audit = VolumeAudit::of(&again);
        assert!(audit.is_valid(), "{name}: {audit}");
        assert_eq!(audit, VolumeAudit::of(&mesh), "{name}");
    }
}
