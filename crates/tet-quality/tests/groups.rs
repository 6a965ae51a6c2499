//! Names, numbers and patches of a file's volume survive its improvement.

use std::collections::BTreeMap;

use geom_core::io::mesh::{AnyMesh, MeshFile, VolumeGroups, msh};
use geom_core::io::view::{Group, View};
use geom_core::{Cpu, Run, TetMesh};
use tet_quality::testing::{lattice, shaken};
use tet_quality::{Options, improve};

/// Two materials beside each other in a box; the sides across x are inlet and outlet.
fn written() -> Vec<u8> {
    let mesh = shaken(
        lattice([6, 4, 4], 1.0, |p| if p.x < 3.0 { 2 } else { 3 }),
        0.2,
        5,
    );
    let mut view = View::of_tets(&mesh, &[(2, "steel"), (3, "air")]);
    for group in &mut view.groups {
        group.tag = Some(match group.name.as_str() {
            "steel" => 7,
            "air" => 3,
            "box_xmin" => 9,
            "box_xmax" => 11,
            _ => continue,
        });
        match group.tag {
            Some(9) => group.name = "inlet".to_owned(),
            Some(11) => group.name = "outlet".to_owned(),
            _ => {}
        }
    }
    // The field of ours would say which region is which; another program's file has groups alone.
    view.cell_fields.clear();
    let mut file = Vec::new();
    msh::write(&mut file, &view, msh::Options::default()).unwrap();
    file
}

fn parsed(file: &[u8]) -> (MeshFile, VolumeGroups, TetMesh) {
    let file = MeshFile::try_from(msh::parse(file).unwrap()).unwrap();
    let groups = VolumeGroups::of(&file);
    let AnyMesh::Tet(mesh) = file.mesh.clone() else {
        panic!("tetrahedra");
    };
    (file, groups, mesh)
}

/// Dimension, number and measure (Å², Å³) of each group by name.
fn measures(view: &View<'_>) -> BTreeMap<String, (u8, Option<i32>, f64)> {
    let mut all: BTreeMap<String, (u8, Option<i32>, f64)> = BTreeMap::new();
    let cells = view.blocks.iter().flat_map(|b| b.iter());
    for (corners, &group) in cells.zip(view.group_of.iter()) {
        let Group {
            name,
            dimension,
            tag,
        } = &view.groups[group as usize];
        let x: Vec<_> = corners.iter().map(|&v| view.points[v as usize]).collect();
        let (u, v) = (x[1] - x[0], x[2] - x[0]);
        let size = match dimension {
            2 => 0.5 * u.cross(&v).norm(),
            _ => u.cross(&v).dot(&(x[3] - x[0])).abs() / 6.0,
        };
        all.entry(name.clone()).or_insert((*dimension, *tag, 0.0)).2 += size;
    }
    all
}

#[test]
fn groups_survive_an_improvement() {
    let (_, groups, mesh) = parsed(&written());
    let before = measures(&groups.view(&mesh));
    assert_eq!(before["steel"].1, Some(7));
    assert_eq!(before["air"].1, Some(3));
    assert_eq!((before["inlet"].0, before["inlet"].1), (2, Some(9)));
    assert!((before["outlet"].2 - 16.0).abs() < 1e-9);
    let improved = improve(mesh, None, &Options::default(), Run::on(&Cpu)).unwrap();
    assert!(
        improved.report.passes.iter().any(|p| p.moved > 0),
        "nothing was done"
    );
    let view = groups.view(&improved.mesh);
    let mut file = Vec::new();
    msh::write(&mut file, &view, msh::Options::default()).unwrap();
    let after = measures(&msh::parse(&file).unwrap());
    assert_eq!(
        before.keys().collect::<Vec<_>>(),
        after.keys().collect::<Vec<_>>()
    );
    for (name, (dimension, tag, size)) in &before {
        let found = &after[name];
        assert_eq!((found.0, found.1), (*dimension, *tag), "{name}");
        assert!(
            (found.2 - size).abs() < 1e-9 * size.max(1.0),
            "{name}: {size} {}",
            found.2
        );
    }
}

/// The same number for the same part, whichever parts there are.
#[test]
fn tags_do_not_depend_on_what_is_meshed() {
    let tags = |view: &View<'_>| -> BTreeMap<String, Option<i32>> {
        view.groups
            .iter()
            .map(|g| (g.name.clone(), g.tag))
            .collect()
    };
    let both = lattice([4; 3], 1.0, |p| u8::from(p.x < 2.0));
    let inside = lattice([4; 3], 1.0, |_| 1);
    let (both, inside) = (tags(&View::from(&both)), tags(&View::from(&inside)));
    assert_eq!(both["molecule"], Some(1));
    assert_eq!(both["exterior"], Some(256));
    assert_eq!(both["molecule|exterior"], Some(512));
    for (name, tag) in &inside {
        assert!(both.get(name).is_none_or(|t| t == tag), "{name}");
    }
}

/// A volume's entity names the surfaces that bound it.
#[test]
fn msh_tells_what_bounds_a_volume() {
    let file = String::from_utf8({
        let (_, groups, mesh) = parsed(&written());
        let mut file = Vec::new();
        let options = msh::Options {
            encoding: geom_core::io::Encoding::Ascii,
            ..msh::Options::default()
        };
        msh::write(&mut file, &groups.view(&mesh), options).unwrap();
        file
    })
    .unwrap();
    let entities = file.split("$Entities\n").nth(1).unwrap();
    let mut lines = entities.lines();
    let counts: Vec<usize> = lines
        .next()
        .unwrap()
        .split(' ')
        .map(|n| n.parse().unwrap())
        .collect();
    assert_eq!(counts[3], 2, "two volumes");
    for volume in lines.skip(counts[2]).take(2) {
        let words: Vec<&str> = volume.split(' ').collect();
        // Tag, six bounds, one physical tag, then the surfaces: one end, four sides in common, the interface.
        assert_eq!((words[7], words[9]), ("1", "6"), "{volume}");
        assert_eq!(words.len(), 16);
    }
}
