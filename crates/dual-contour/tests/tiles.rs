//! Tiles make the mesh of the whole.

use std::collections::BTreeMap;

use dual_contour::geom_core::grid::lattice::Window;
use dual_contour::geom_core::tiles::piece::{digest, key};
use dual_contour::geom_core::tiles::{Piece, Tiles};
use dual_contour::geom_core::{Cpu, Lattice, LatticeValues, Point3, Run, ScalarGrid};
use dual_contour::{Extent, HALO, LARGEST, Method, Options, tile, volume};

/// Waves, and noise on one side, so that snapping has much to decide.
fn values() -> ScalarGrid {
    let lattice = Lattice {
        origin: Point3::new(-13.7, 4.1, 0.3),
        spacing: 0.37,
        counts: [97, 62, 71],
    };
    let mut state = 7u64;
    let values = (0..lattice.len()).map(|i| {
        state = state
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1);
        let random = (state >> 40) as f32 / (1u64 << 24) as f32 - 0.5;
        let p = lattice.coordinates(i);
        let on_box = (0..3).any(|k| p[k] == 0 || p[k] + 1 == lattice.counts[k]);
        let [x, y, z] = p.map(|c| c as f32 * 0.13);
        let waves = 1.0 + x.sin() * y.cos() + (0.6 * z).sin();
        let noise = if p[0] > 60 && p[1] < 30 {
            1.2 * random
        } else {
            0.0
        };
        if on_box { 0.0 } else { waves + noise }
    });
    ScalarGrid::new(lattice, values.collect()).unwrap()
}

fn options(region: Extent) -> Options {
    Options {
        method: Method::Stuffing,
        max_cell: LARGEST as f64 * 0.37,
        region,
        ..Options::default()
    }
}

/// The part of a grid in a window.
fn part(whole: &ScalarGrid, window: &Window) -> ScalarGrid {
    let lattice = window.lattice();
    let values = (0..lattice.len()).map(|i| {
        let p = lattice.coordinates(i);
        whole.at([0, 1, 2].map(|k| p[k] + window.low[k]))
    });
    ScalarGrid::new(lattice, values.collect()).unwrap()
}

fn meshed(values: &ScalarGrid, tiles: &Tiles, options: &Options) -> Vec<Piece> {
    (0..tiles.len())
        .filter_map(|t| {
            let own = tiles.cells_of(t);
            let window = Window::around(*values.lattice(), own[0], own[1], HALO);
            let grid = part(values, &window);
            (own[0] != own[1]).then(|| tile(&grid, &window, own, options, Run::on(&Cpu)).unwrap().0)
        })
        .collect()
}

#[test]
fn tiles_make_the_mesh_of_the_whole_bit_for_bit() {
    let values = values();
    for region in [Extent::Interior, Extent::Both] {
        let options = options(region);
        let whole = volume(&values, None, &options, Run::on(&Cpu)).unwrap().mesh;
        let cuts: &[(usize, usize)] = match region {
            Extent::Both => &[(16, 3)],
            _ => &[(16, 1), (32, 2), (16, 7)],
        };
        for &(root, count) in cuts {
            let tiles = Tiles::new(values.lattice().cells(), root, 0, count, |_| 1);
            let pieces = meshed(&values, &tiles, &options);
            let tets: usize = pieces.iter().map(|p| p.mesh.tets().len()).sum();
            assert_eq!(tets, whole.tets().len(), "{region:?}, {count} tiles");
            let sum = pieces.iter().map(Piece::digest).fold(0, u128::wrapping_add);
            assert_eq!(sum, digest(&whole), "{region:?}, {count} tiles");
            // Who has a vertex beside others knows that it may be shared.
            let mut pieces_with = BTreeMap::new();
            for (p, piece) in pieces.iter().enumerate() {
                for (v, x) in piece.mesh.positions().iter().enumerate() {
                    pieces_with
                        .entry(key(x))
                        .or_insert_with(Vec::new)
                        .push((p, v));
                }
            }
            for sharers in pieces_with.values().filter(|s| s.len() > 1) {
                assert!(sharers.iter().all(|&(p, v)| pieces[p].shared[v]));
            }
            // Kinds are those of the whole.
            let kinds: BTreeMap<_, _> = whole
                .positions()
                .iter()
                .zip(whole.kinds())
                .map(|(x, kind)| (key(x), *kind))
                .collect();
            for piece in &pieces {
                for (x, kind) in piece.mesh.positions().iter().zip(piece.mesh.kinds()) {
                    assert_eq!(kinds[&key(x)], *kind);
                }
            }
        }
    }
}

#[test]
fn what_reaches_far_is_refused_in_tiles() {
    let values = values();
    let window = Window::around(*values.lattice(), [0; 3], [96, 64, 72], HALO);
    let own = [[0; 3], values.lattice().cells()];
    let run = |options: &Options| tile(&values, &window, own, options, Run::on(&Cpu));
    let fine = options(Extent::Interior);
    assert!(run(&fine).is_ok());
    for (name, options) in [
        (
            "method",
            Options {
                method: Method::DualContour,
                ..fine.clone()
            },
        ),
        (
            "prune",
            Options {
                prune: 10,
                ..fine.clone()
            },
        ),
        (
            "max_cell",
            Options {
                max_cell: f64::INFINITY,
                ..fine.clone()
            },
        ),
        (
            "region",
            Options {
                region: Extent::Exterior,
                ..fine.clone()
            },
        ),
    ] {
        let error = run(&options).unwrap_err().to_string();
        assert!(error.contains(name), "{error}");
    }
    // A window without its halo, and a tile beside the blocks.
    let narrow = Window::around(*values.lattice(), [32, 0, 0], [64, 64, 72], 8);
    let grid = part(&values, &narrow);
    let own = [[32, 0, 0], [64, 61, 70]];
    assert!(tile(&grid, &narrow, own, &fine, Run::on(&Cpu)).is_err());
    let own = [[33, 0, 0], [64, 61, 70]];
    assert!(tile(&values, &window, own, &fine, Run::on(&Cpu)).is_err());
}
