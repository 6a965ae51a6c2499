//! Parts of a mesh that are improved alone still fit together.

use std::collections::BTreeMap;

use geom_core::mesh::VolumeAudit;
use geom_core::tiles::piece::key;
use geom_core::{Cpu, ImplicitField, Point3, Run, TetMesh};
use tet_quality::testing::ball_in_box;
use tet_quality::{Error, Options, SurfaceMotion, improve_part};

/// The tetrahedra of some part, with the vertices that they use.
fn part(mesh: &TetMesh, of: &[usize], wanted: usize) -> TetMesh {
    let mut numbers = BTreeMap::new();
    let (mut tets, mut regions) = (Vec::new(), Vec::new());
    for (t, tet) in mesh
        .tets()
        .iter()
        .enumerate()
        .filter(|(t, _)| of[*t] == wanted)
    {
        tets.push(tet.map(|v| {
            let next = numbers.len() as u32;
            *numbers.entry(v).or_insert(next)
        }));
        regions.push(mesh.regions()[t]);
    }
    let mut order: Vec<(u32, u32)> = numbers.into_iter().map(|(v, n)| (n, v)).collect();
    order.sort_unstable();
    let pick = |&(_, v): &(u32, u32)| v as usize;
    let positions = order.iter().map(|o| mesh.positions()[pick(o)]).collect();
    let kinds = order.iter().map(|o| mesh.kinds()[pick(o)]).collect();
    TetMesh::with_kinds(positions, tets, regions, kinds).unwrap()
}

/// The vertices of a part that another has.
fn shared(part: &TetMesh, others: &[TetMesh]) -> Vec<bool> {
    let theirs: Vec<_> = others
        .iter()
        .flat_map(|o| o.positions().iter().map(key))
        .collect();
    let theirs: std::collections::BTreeSet<_> = theirs.into_iter().collect();
    part.positions()
        .iter()
        .map(|x| theirs.contains(&key(x)))
        .collect()
}

/// Parts put together: vertices with the same bits are one.
fn joined(parts: &[TetMesh]) -> TetMesh {
    let mut numbers = BTreeMap::new();
    let (mut positions, mut tets, mut regions): (Vec<Point3>, Vec<_>, Vec<_>) = Default::default();
    for part in parts {
        for (tet, &region) in part.tets().iter().zip(part.regions()) {
            tets.push(tet.map(|v| {
                let x = part.positions()[v as usize];
                *numbers.entry(key(&x)).or_insert_with(|| {
                    positions.push(x);
                    positions.len() as u32 - 1
                })
            }));
            regions.push(region);
        }
    }
    TetMesh::with_regions(positions, tets, regions).unwrap()
}

#[test]
fn parts_improved_alone_fit_together() {
    // Cut along planes of the lattice, whose coplanar faces are tempting to flip, and along a slope.
    let cuts: [fn(&Point3) -> usize; 2] = [
        |x| usize::from(x.x > 0.3) + 2 * usize::from(x.y > -0.2),
        |x| usize::from(x.x + 0.7 * x.y - 0.4 * x.z > 0.1),
    ];
    for cut in cuts {
        let (mesh, ball) = ball_in_box(6, 1.0, 2.1);
        let field: &dyn ImplicitField = &ball;
        let middle = mesh.bounds().center();
        let of: Vec<usize> = (0..mesh.tets().len())
            .map(|t| {
                let sum = mesh
                    .corners(t)
                    .iter()
                    .fold(-4.0 * middle.coords, |s, x| s + x.coords);
                cut(&Point3::from(sum / 4.0))
            })
            .collect();
        let count = of.iter().max().unwrap() + 1;
        let parts: Vec<TetMesh> = (0..count).map(|p| part(&mesh, &of, p)).collect();
        let better: Vec<TetMesh> = (0..count)
            .map(|p| {
                let others: Vec<TetMesh> = (0..count)
                    .filter(|q| *q != p)
                    .map(|q| parts[q].clone())
                    .collect();
                let held = shared(&parts[p], &others);
                assert!(held.iter().any(|h| *h) && held.iter().any(|h| !*h));
                let run = Run::on(&Cpu);
                let made = improve_part(
                    parts[p].clone(),
                    &held,
                    Some(field),
                    &Options::default(),
                    run,
                );
                let made = made.unwrap();
                let changes: usize = made.report.passes.len();
                assert!(changes > 0, "nothing was tried");
                let stay: std::collections::BTreeSet<_> =
                    made.mesh.positions().iter().map(key).collect();
                let held = parts[p].positions().iter().zip(&held).filter(|h| *h.1);
                assert!(held.into_iter().all(|(x, _)| stay.contains(&key(x))));
                made.mesh
            })
            .collect();
        let whole = joined(&better);
        let audit = VolumeAudit::of(&whole);
        assert!(audit.is_conforming() && audit.is_positive() && audit.is_valid());
        assert!((whole.volume() / mesh.volume() - 1.0).abs() < 1e-9);
        assert_ne!(whole.tets().len(), 0);
        // Before and after, the boundary of the whole is that of the box: no gap has opened.
        let surface = |mesh: &TetMesh| {
            let faces = mesh.interfaces();
            let outer = faces
                .iter()
                .filter(|f| f.outside == geom_core::mesh::OUTSIDE);
            let area = |f: &geom_core::mesh::Interface| {
                let [a, b, c] = f.triangle.map(|v| mesh.positions()[v as usize]);
                0.5 * (b - a).cross(&(c - a)).norm()
            };
            outer.map(area).sum::<f64>()
        };
        assert!((surface(&whole) / surface(&mesh) - 1.0).abs() < 1e-9);
    }
}

#[test]
fn what_moves_held_vertices_is_refused() {
    let (mesh, _) = ball_in_box(6, 1.0, 2.1);
    let along = Options {
        surface: SurfaceMotion::AlongInput,
        ..Options::default()
    };
    let held = vec![true; mesh.positions().len()];
    let told = |held: &[bool], options: &Options| {
        let error: Error =
            improve_part(mesh.clone(), held, None, options, Run::on(&Cpu)).unwrap_err();
        error.to_string()
    };
    assert!(told(&held, &along).contains("surface"));
    assert!(told(&held[1..], &Options::default()).contains("held"));
}
