//! Tiles make the mesh of the whole.

use std::collections::BTreeMap;

use dual_contour::geom_core::grid::lattice::Window;
use dual_contour::geom_core::tiles::border::{Asked, Border, ghosts, number};
use dual_contour::geom_core::tiles::exchange::Deal;
use dual_contour::geom_core::tiles::parts::{Closed, Local, closed, surface};
use dual_contour::geom_core::tiles::piece::{digest, key};
use dual_contour::geom_core::tiles::{Exchange, Lost, Piece, Solo, Threads, Tiles};
use dual_contour::geom_core::{
    Cpu, ImplicitField, Lattice, LatticeValues, Point3, Run, ScalarGrid, Vector3,
};
use dual_contour::{Extent, HALO, LARGEST, Method, Options, tile, volume};

/// Waves, and noise on one side, so that snapping has much to decide.
fn values() -> ScalarGrid {
    let lattice = Lattice {
        origin: Point3::new(-13.7, 4.1, 0.3),
        spacing: 0.37,
        counts: [97, 34, 31],
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
        let noise = if p[0] > 60 && p[1] < 20 {
            1.2 * random
        } else {
            0.0
        };
        if on_box { 0.0 } else { waves + noise }
    });
    ScalarGrid::new(lattice, values.collect()).unwrap()
}

const METHODS: [Method; 2] = [Method::Stuffing, Method::DualContour];

fn options(method: Method, region: Extent) -> Options {
    Options {
        method,
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

fn meshed_one(
    values: &ScalarGrid,
    field: Option<&dyn ImplicitField>,
    tiles: &Tiles,
    t: usize,
    options: &Options,
) -> Piece {
    let own = tiles.cells_of(t);
    if own[0] == own[1] {
        return Piece::default();
    }
    let window = Window::around(*values.lattice(), own[0], own[1], HALO);
    let grid = part(values, &window);
    let run = Run::on(&Cpu);
    tile(&grid, field, &window, own, options, run).unwrap().0
}

/// Compares the pieces of tiles with the mesh of the whole.
fn check(
    values: &ScalarGrid,
    field: Option<&dyn ImplicitField>,
    options: &Options,
    cuts: &[(usize, usize)],
) {
    let run = Run::on(&Cpu);
    let made = volume(values, field, options, run).unwrap();
    // Here points wait for each other.
    let waiting = options.method == Method::DualContour && field.is_none();
    assert!(!waiting || made.report.split_cells > 500 && made.report.clamped > 100);
    let whole = made.mesh;
    let digest_of_whole = digest(&whole);
    let places = whole.positions().iter().map(key);
    let kinds: BTreeMap<_, _> = places.zip(whole.kinds()).collect();
    for &(root, count) in cuts {
        let tiles = Tiles::new(values.lattice().cells(), root, 0, count, |_| 1);
        let pieces: Vec<Piece> = (0..tiles.len())
            .map(|t| meshed_one(values, field, &tiles, t, options))
            .collect();
        let told = format!("{:?}, {:?}, {count} tiles", options.method, options.region);
        let tets: usize = pieces.iter().map(|p| p.mesh.tets().len()).sum();
        assert_eq!(tets, whole.tets().len(), "{told}");
        let sum = pieces.iter().map(Piece::digest).fold(0, u128::wrapping_add);
        assert_eq!(sum, digest_of_whole, "{told}");
        let vertices = pieces.iter().enumerate().flat_map(|(p, piece)| {
            let places = piece.mesh.positions().iter().enumerate();
            places.map(move |(v, x)| (key(x), p, v))
        });
        let mut vertices: Vec<_> = vertices.collect();
        vertices.sort_unstable();
        for sharers in vertices.chunk_by(|a, b| a.0 == b.0) {
            // Kinds are those of the whole.
            let kind = kinds[&sharers[0].0];
            for &(_, p, v) in sharers {
                assert_eq!(*kind, pieces[p].mesh.kinds()[v]);
                // Who has a vertex beside others knows that it may be shared.
                assert!(sharers.len() == 1 || pieces[p].shared[v]);
            }
        }
    }
}

#[test]
fn tiles_make_the_mesh_of_the_whole_bit_for_bit() {
    let values = values();
    for method in METHODS {
        let cuts = [(32, 2), (16, 5)];
        check(&values, None, &options(method, Extent::Interior), &cuts);
        check(&values, None, &options(method, Extent::Both), &[(16, 3)]);
    }
}

/// Waves in space, above 1 inside; low on the box of the lattice.
struct Waves;

impl ImplicitField for Waves {
    fn value(&self, x: &Point3) -> f64 {
        self.value_gradient(x).0
    }
    fn value_gradient(&self, x: &Point3) -> (f64, Vector3) {
        let [p, q, r] = [0.41 * x.x, 0.37 * x.y, 0.53 * x.z];
        let value = p.sin() * q.cos() + r.sin() + 1.0 - 0.002 * x.coords.norm_squared();
        let gradient = Vector3::new(
            0.41 * p.cos() * q.cos(),
            -0.37 * p.sin() * q.sin(),
            0.53 * r.cos(),
        );
        (value, gradient - 0.004 * x.coords)
    }
}

/// Where vertices lie follows from places in space, which rounding must not move from tile to tile.
#[test]
fn tiles_on_a_field_make_the_mesh_of_the_whole_bit_for_bit() {
    let lattice = *values().lattice();
    let values = (0..lattice.len()).map(|i| {
        let p = lattice.coordinates(i);
        let on_box = (0..3).any(|k| p[k] == 0 || p[k] + 1 == lattice.counts[k]);
        let value = Waves.value(&lattice.point(p)) as f32;
        if on_box { 0.0 } else { value }
    });
    let values = ScalarGrid::new(lattice, values.collect()).unwrap();
    for method in METHODS {
        let options = options(method, Extent::Interior);
        check(&values, Some(&Waves), &options, &[(16, 3), (16, 5)]);
    }
}

#[test]
fn what_reaches_far_is_refused_in_tiles() {
    let values = values();
    let window = Window::around(*values.lattice(), [0; 3], [96, 48, 48], HALO);
    let own = [[0; 3], values.lattice().cells()];
    let run = |options: &Options| tile(&values, None, &window, own, options, Run::on(&Cpu));
    let fine = options(Method::Stuffing, Extent::Interior);
    assert!(run(&fine).is_ok());
    for (name, options) in [
        (
            "tolerance",
            Options {
                method: Method::DualContour,
                tolerance: 0.1,
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
    let narrow = Window::around(*values.lattice(), [32, 0, 0], [64, 48, 48], 8);
    let grid = part(&values, &narrow);
    let own = [[32, 0, 0], [64, 33, 30]];
    assert!(tile(&grid, None, &narrow, own, &fine, Run::on(&Cpu)).is_err());
    let own = [[33, 0, 0], [64, 33, 30]];
    assert!(tile(&values, None, &window, own, &fine, Run::on(&Cpu)).is_err());
}

/// A tube with closed ends: a rod through all tiles, and a cavity through all tiles in it.
fn tube() -> ScalarGrid {
    let lattice = Lattice {
        origin: Point3::new(3.0, -2.0, 1.0),
        spacing: 0.5,
        counts: [97, 27, 25],
    };
    let values = (0..lattice.len()).map(|i| {
        let [x, y, z] = lattice.coordinates(i).map(|c| c as f32);
        let r = ((y - 12.7).powi(2) + (z - 11.8).powi(2)).sqrt();
        let wall = |r0: f32, x0: f32, x1: f32| (r0 - r).min(x - x0).min(x1 - x);
        1.0 + 0.1 * wall(9.2, 5.3, 91.1).min(-wall(4.2, 12.4, 84.8))
    });
    ScalarGrid::new(lattice, values.collect()).unwrap()
}

/// What a rank knows in the end: its pieces with the numbers of their vertices, all vertices, and the closed surfaces.
type Ended = (Vec<(Piece, Vec<u64>)>, u64, Vec<Closed>);

fn program(
    exchange: &impl Exchange,
    tiles: &Tiles,
    values: &ScalarGrid,
    options: &Options,
) -> Result<Ended, Lost> {
    let deal = Deal {
        tiles: tiles.len(),
        ranks: exchange.ranks(),
    };
    let own = deal.of(exchange.rank());
    let pieces: Vec<Piece> = own
        .map(|t| meshed_one(values, None, tiles, t, options))
        .collect();
    let mut borders: Vec<Border> = pieces.iter().map(Border::of).collect();
    let total = number(exchange, &deal, &mut borders)?;
    let ghosts = ghosts(exchange, &deal, &borders, &Asked::FIRST)?;
    let locals: Vec<Local> = (pieces.iter().zip(&borders).zip(&ghosts))
        .map(|((piece, border), ghosts)| {
            let surface = surface(piece, &border.ids(), ghosts);
            Local::of(piece, border, &surface)
        })
        .collect();
    let parts = closed(exchange, &deal, &borders, &locals)?;
    let ids = borders.iter().map(Border::ids);
    Ok((pieces.into_iter().zip(ids).collect(), total, parts))
}

#[test]
fn a_rod_and_a_cavity_go_through_all_tiles_on_any_number_of_ranks() {
    let values = tube();
    // Tiles that hold nothing, and tiles that have no cells, among them.
    for (method, root, count, ranks) in [
        (Method::Stuffing, 32, 3, 2),
        (Method::DualContour, 32, 3, 2),
        (Method::Stuffing, 16, 7, 3),
        (Method::DualContour, 64, 7, 7),
    ] {
        let options = Options {
            max_cell: LARGEST as f64 * 0.5,
            ..options(method, Extent::Interior)
        };
        let whole = volume(&values, None, &options, Run::on(&Cpu)).unwrap();
        let tiles = Tiles::new(values.lattice().cells(), root, 0, count, |_| 1);
        let ended = Threads::run(ranks, |rank| program(rank, &tiles, &values, &options));
        let ended: Vec<Ended> = ended.into_iter().map(Result::unwrap).collect();
        let solo = program(&Solo, &tiles, &values, &options).unwrap();
        let told = format!("{method:?}, {count} tiles on {ranks} ranks");
        let pieces: Vec<&(Piece, Vec<u64>)> = ended.iter().flat_map(|e| &e.0).collect();
        assert!(
            pieces.iter().copied().eq(&solo.0),
            "{told}: alone they would be others"
        );
        let sum = pieces
            .iter()
            .map(|p| p.0.digest())
            .fold(0, u128::wrapping_add);
        assert_eq!(sum, digest(&whole.mesh), "{told}");
        // Every vertex has one number, and every number one vertex.
        let mut numbers = BTreeMap::new();
        for (piece, ids) in &pieces {
            for (x, id) in piece.mesh.positions().iter().zip(ids) {
                assert_eq!(*numbers.entry(key(x)).or_insert(*id), *id, "{told}");
            }
        }
        let mut found: Vec<u64> = numbers.into_values().collect();
        found.sort_unstable();
        assert!(
            found.into_iter().eq(0..whole.mesh.positions().len() as u64),
            "{told}"
        );
        for (_, total, parts) in &ended {
            assert_eq!(*total, whole.mesh.positions().len() as u64, "{told}");
            assert_eq!(parts.len(), 2, "{told}: one body and one cavity, {parts:?}");
            let triangles: u64 = parts.iter().map(|p| p.triangles).sum();
            assert_eq!(triangles, whole.surface.triangles().len() as u64, "{told}");
            let volume: f64 = parts.iter().map(|p| p.volume).sum();
            assert!(
                (volume / whole.surface.volume() - 1.0).abs() < 1e-9,
                "{told}"
            );
            assert_eq!(parts.iter().filter(|p| p.volume < 0.0).count(), 1, "{told}");
        }
    }
}
