//! Ranks, what they put aside, and instances of an assembly.

use std::collections::{BTreeMap, BTreeSet};

use geom_core::io::structure::{ReadOptions, read};
use geom_core::io::view::{Cells, NO_GROUP};
use geom_core::io::{View, msh, msh_parts, vtu};
use geom_core::mesh::{INTERIOR, VertexKind, shapes};
use geom_core::tiles::border::{Asked, Border, ghosts, number};
use geom_core::tiles::exchange::{Deal, exchanged, gathered};
use geom_core::tiles::piece::{NoPiece, key};
use geom_core::tiles::{Counted, Exchange, Lost, Patches, Piece, Solo, Spill, Threads, Tiles};
use geom_core::{Point3, TetMesh};

#[test]
fn everyone_hears_what_was_said_to_them() {
    for ranks in [1, 2, 3, 7] {
        let heard = Threads::run(ranks, |rank| {
            let own = rank.rank() as u64;
            let mut all = Vec::new();
            // Many turns, of unequal length.
            for turn in 0..50u64 {
                let to: Vec<Vec<u64>> = (0..ranks as u64)
                    .map(|r| vec![100 * own + r; ((own + r + turn) % 4) as usize])
                    .collect();
                all = exchanged(rank, &to)?;
                for (from, said) in all.iter().enumerate() {
                    let from = from as u64;
                    assert_eq!(
                        *said,
                        vec![100 * from + own; ((own + from + turn) % 4) as usize]
                    );
                }
            }
            assert_eq!(all.len(), ranks);
            let everyone = gathered(rank, &[own])?;
            assert!(everyone.concat().into_iter().eq(0..ranks as u64));
            rank.scan(own + 1)
        });
        for (r, scanned) in heard.into_iter().enumerate() {
            let r = r as u64;
            assert_eq!(
                scanned,
                Ok((r * (r + 1) / 2, (ranks * (ranks + 1) / 2) as u64))
            );
        }
    }
    assert_eq!(Solo.scan(5), Ok((0, 5)));
}

#[test]
fn a_rank_that_fails_ends_all() {
    // By an error, in the middle of an exchange of the others and before it.
    for turn in 0..3 {
        let ended = Threads::run(4, |rank| {
            for t in 0..3 {
                if rank.rank() == 2 && t == turn {
                    return Err("the disk is full".to_owned());
                }
                rank.scan(1).map_err(|lost| lost.to_string())?;
            }
            Ok(())
        });
        let lost = Lost::Rank { rank: 2 }.to_string();
        for (r, ended) in ended.into_iter().enumerate() {
            let expected = if r == 2 { "the disk is full" } else { &lost };
            assert_eq!(ended, Err(expected.to_owned()), "turn {turn}");
        }
    }
    // By a panic, which goes on in the caller.
    let panicked = std::panic::catch_unwind(|| {
        Threads::run(3, |rank| {
            assert!(rank.rank() != 1, "planted");
            rank.scan(1)
        })
    });
    assert!(panicked.is_err());
}

#[test]
fn what_was_put_aside_comes_back() {
    let folder = tempfile::tempdir().unwrap();
    let spill = Spill::into(folder.path());
    spill.put("tile 3", b"tetrahedra").unwrap();
    assert_eq!(spill.written(), 10);
    assert_eq!(spill.get("tile 3").unwrap(), b"tetrahedra");
    spill.forget("tile 3").unwrap();
    let error = spill.get("tile 3").unwrap_err().to_string();
    assert!(
        error.contains("tile 3") && error.contains("cannot be read"),
        "{error}"
    );
}

#[cfg(target_os = "linux")]
#[test]
fn a_full_disk_is_told_with_file_and_size() {
    let folder = tempfile::tempdir().unwrap();
    let spill = Spill::into(folder.path());
    std::os::unix::fs::symlink("/dev/full", spill.path("tile_0")).unwrap();
    let error = spill.put("tile_0", &[7; 1 << 16]).unwrap_err().to_string();
    for part in [
        "tile_0",
        "65536 bytes",
        "cannot be put aside",
        "No space left",
    ] {
        assert!(error.contains(part), "{error}");
    }
    assert!(!spill.path("tile_0").exists(), "nothing half-written stays");
}

#[test]
fn instances_are_the_copies() {
    let options = ReadOptions {
        assembly: Some("1".to_owned()),
        ..ReadOptions::default()
    };
    let path = fixtures::path("5e5z.pdb");
    let copied = read(&path, &options).unwrap();
    let instances = ReadOptions {
        instances: true,
        ..options
    };
    let held = read(&path, &instances).unwrap();
    assert_eq!(copied.places.len(), 1);
    assert_eq!(held.places.len(), copied.structure.domains().len());
    let unit = held.structure.atoms();
    let moved = (held.places.iter()).flat_map(|t| unit.iter().map(|a| t.apply(&a.position)));
    let positions = copied.structure.atoms().iter().map(|a| a.position);
    assert!(moved.eq(positions));
}

#[test]
fn what_is_sent_to_others_is_counted() {
    let sent = Threads::run(3, |rank| {
        let counted = Counted::new(rank);
        // To itself, nothing travels.
        counted.all_to_all(vec![vec![0; 10]; 3])?;
        counted.scan(1)?;
        Ok::<_, Lost>(counted.sent())
    });
    assert_eq!(sent, vec![Ok(2 * 10 + 2 * 8); 3]);
}

/// A ball in a box in three pieces along one axis.
fn pieces() -> (TetMesh, Vec<Piece>) {
    let mesh = shapes::ball_in_box(2.0, 4.0, 5);
    let shared = vec![false; mesh.positions().len()];
    let whole = Piece {
        mesh: mesh.clone(),
        shared,
    };
    let tile = |corners: [Point3; 4]| {
        let x = corners.iter().map(|p| p.x).sum::<f64>() / 4.0;
        usize::from(x > -0.7) + usize::from(x > 1.1)
    };
    let parts: BTreeMap<usize, Piece> = whole.dealt(tile);
    assert_eq!(parts.len(), 3);
    (mesh, parts.into_values().collect())
}

#[test]
fn borders_can_be_numbered_again() {
    let (mesh, pieces) = pieces();
    let deal = Deal { tiles: 3, ranks: 1 };
    let mut borders: Vec<Border> = pieces.iter().map(Border::of).collect();
    let mut found = Vec::new();
    for _ in 0..2 {
        let total = number(&Solo, &deal, &mut borders).unwrap();
        assert_eq!(total, mesh.positions().len() as u64);
        let ids: Vec<Vec<u64>> = borders.iter().map(Border::ids).collect();
        found.push((ids, ghosts(&Solo, &deal, &borders, &Asked::FIRST).unwrap()));
    }
    assert_eq!(found[0], found[1]);
    // One number per vertex of the whole; ghosts name their element.
    let mut places = BTreeMap::new();
    let (ids, beyond) = &found[0];
    for (piece, ids) in pieces.iter().zip(ids) {
        for (x, id) in piece.mesh.positions().iter().zip(ids) {
            assert_eq!(*places.entry(*id).or_insert(key(x)), key(x));
        }
    }
    assert_eq!(places.len(), mesh.positions().len());
    for ghost in beyond.iter().flatten() {
        let owner = &pieces[ghost.owner as usize].mesh;
        let own =
            owner.tets()[ghost.element as usize].map(|v| ids[ghost.owner as usize][v as usize]);
        assert_eq!(own, ghost.ids);
    }
    assert!(beyond.iter().all(|ghosts| !ghosts.is_empty()));
    // When a tile has lost its elements, the others know no more of it than if it had never had any.
    borders[0] = Border::default();
    let mut fresh: Vec<Border> = pieces.iter().map(Border::of).collect();
    fresh[0] = Border::default();
    for borders in [&mut borders, &mut fresh] {
        number(&Solo, &deal, borders).unwrap();
    }
    for (again, fresh) in borders.iter().zip(&fresh) {
        assert_eq!(again.links, fresh.links);
        assert_eq!(again.ids(), fresh.ids());
    }
}

/// Two layers around tiles, one of which is so thin that what lies beyond it is a second layer.
#[test]
fn two_layers_of_ghosts_are_all_that_is_two_elements_away() {
    let mesh = shapes::ball_in_box(2.0, 4.0, 5);
    let shared = vec![false; mesh.positions().len()];
    let whole = Piece { mesh, shared };
    let tile = |corners: [Point3; 4]| {
        let [x, y] = [0, 1].map(|k| corners.iter().map(|p| p[k]).sum::<f64>() / 4.0);
        usize::from(x > -0.4) + usize::from(x > 0.0) + 3 * usize::from(y > 0.3)
    };
    let pieces: Vec<Piece> = whole.dealt(tile).into_values().collect();
    assert_eq!(pieces.len(), 6);
    let program = |exchange: &dyn Exchange, step: usize| {
        let (tiles, ranks) = (pieces.len(), exchange.ranks());
        let deal = Deal { tiles, ranks };
        let own = deal.of(exchange.rank());
        let mut borders: Vec<Border> = pieces[own].iter().map(Border::of).collect();
        number(exchange, &deal, &mut borders)?;
        let mut found = Vec::new();
        for place in (0..tiles).step_by(step) {
            let asked = Asked {
                layers: 2,
                places: place..place + step,
            };
            found.extend(ghosts(exchange, &deal, &borders, &asked)?);
        }
        Ok::<_, Lost>((borders, found))
    };
    let (borders, found) = program(&Solo, 6).unwrap();
    let ids: Vec<Vec<u64>> = borders.iter().map(Border::ids).collect();
    let all: Vec<(usize, usize, [u64; 4])> = (pieces.iter().zip(&ids).enumerate())
        .flat_map(|(t, (piece, ids))| {
            let tets = piece.mesh.tets().iter().enumerate();
            tets.map(move |(e, tet)| (t, e, tet.map(|v| ids[v as usize])))
        })
        .collect();
    let mut beyond_others = 0;
    for (t, found) in found.iter().enumerate() {
        let mut near: BTreeSet<u64> = ids[t].iter().copied().collect();
        let mut expected = Vec::new();
        for layer in [1, 2] {
            let known: BTreeSet<[u64; 4]> = expected
                .iter()
                .map(|e: &(usize, usize, [u64; 4], u16)| e.2)
                .collect();
            let touches = |e: &&(usize, usize, [u64; 4])| {
                e.0 != t && !known.contains(&e.2) && e.2.iter().any(|v| near.contains(v))
            };
            let new: Vec<_> = all
                .iter()
                .filter(touches)
                .map(|e| (e.0, e.1, e.2, layer))
                .collect();
            near.extend(new.iter().flat_map(|e| e.2));
            expected.extend(new);
        }
        expected.sort_unstable_by_key(|e| e.2);
        let told = found
            .iter()
            .map(|g| (g.owner as usize, g.element as usize, g.ids, g.layer));
        assert!(told.eq(expected.iter().copied()), "tile {t}");
        let is_neighbour = |owner: u32| borders[t].links.iter().any(|l| l.other == owner);
        beyond_others += found.iter().filter(|g| !is_neighbour(g.owner)).count();
        // Where they are is what their owners say.
        for ghost in found {
            let owner = &pieces[ghost.owner as usize].mesh;
            let corners = owner.corners(ghost.element as usize).map(<[f64; 3]>::from);
            assert_eq!(ghost.corners, corners);
        }
    }
    assert!(beyond_others > 0, "no tile is thin");
    // The same in parts, and on ranks.
    for (ranks, step) in [(1, 1), (1, 4), (2, 1), (4, 2), (7, 1)] {
        let ended = Threads::run(ranks, |rank| program(rank, step));
        let again = ended.into_iter().flat_map(|e| e.unwrap().1);
        assert!(
            again.eq(found.iter().cloned()),
            "{ranks} ranks, {step} at once"
        );
    }
}

#[test]
fn patches_that_overlap_have_one_tile() {
    let line: Vec<(Point3, u32)> = (0..20)
        .rev()
        .map(|i| (Point3::new(f64::from(i), 0.0, 0.0), i as u32))
        .chain([(Point3::new(-40.0, 3.0, 0.0), 77)])
        .collect();
    for radius in [0.51, 0.9, 7.0] {
        let patches = Patches::new(&line, radius);
        // A chain belongs to the tile of its first, which is told first.
        for i in 0..200 {
            let x = Point3::new(f64::from(i) * 0.1, 0.4, 0.1);
            let near = line.iter().any(|(place, _)| (place - x).norm() <= radius);
            assert_eq!(patches.tile_of(&x), near.then_some(19), "{radius} {x}");
        }
        assert_eq!(patches.tile_of(&Point3::new(-40.0, 3.1, 0.2)), Some(77));
        assert!(patches.has(19) && patches.has(77) && !patches.has(3));
    }
    // Balls that do not reach each other stay apart.
    let apart = Patches::new(&line, 0.49);
    assert_eq!(apart.tile_of(&Point3::new(4.0, 0.2, 0.0)), Some(4));
    assert_eq!(apart.tile_of(&Point3::new(4.5, 0.0, 0.0)), None);
}

#[test]
fn parts_of_msh_are_what_they_were() {
    let (mesh, _) = pieces();
    let view = View::of_tets(&mesh, &[]);
    let height: Vec<f64> = mesh.positions().iter().map(|p| p.z).collect();
    let view = view.point_field("height", &height).unwrap();
    // Every third tetrahedron is a ghost; all have numbers with gaps.
    let tets = mesh.tets().len();
    let owners: Vec<u32> = (0..view.cells())
        .map(|c| if c < tets && c % 3 == 0 { 1 } else { 4 })
        .collect();
    let points: Vec<u64> = (0..view.points.len() as u64).map(|i| 7 * i + 3).collect();
    let cells: Vec<u64> = (0..view.cells() as u64).map(|i| 5 * i).collect();
    let part = msh_parts::Part {
        view: &view,
        number: 4,
        parts: 6,
        points: &points,
        cells: &cells,
        owners: &owners,
    };
    let mut file = Vec::new();
    msh_parts::write(&mut file, &part).unwrap();
    let again = msh::parse(&file).unwrap();
    assert_eq!(again.points, view.points);
    assert_eq!(again.blocks, view.blocks);
    assert_eq!(
        again.find_point_field("height").unwrap().values.to_f64(),
        height
    );
    let name = |view: &View<'_>, c: usize| match view.group_of[c] {
        NO_GROUP => None,
        group => Some(view.groups[group as usize].name.clone()),
    };
    for (c, owner) in owners.iter().enumerate() {
        let expected = (*owner == 4).then(|| name(&view, c)).flatten();
        assert_eq!(name(&again, c), expected, "cell {c}");
    }
    // One without cells, and what cannot be told.
    let empty = View::default();
    let none = msh_parts::Part {
        view: &empty,
        points: &[],
        cells: &[],
        owners: &[],
        ..part
    };
    let mut file = Vec::new();
    msh_parts::write(&mut file, &none).unwrap();
    assert_eq!(msh::parse(&file).unwrap().cells(), 0);
    let many = msh_parts::Part {
        parts: 1 << 20,
        ..part
    };
    let short = msh_parts::Part {
        points: &points[1..],
        ..part
    };
    let foreign = vec![0; view.cells()];
    let faces = msh_parts::Part {
        owners: &foreign,
        ..part
    };
    for (part, why) in [(many, "parts"), (short, "numbers"), (faces, "triangles")] {
        let error = msh_parts::write(&mut Vec::new(), &part)
            .unwrap_err()
            .to_string();
        assert!(error.contains(why), "{error}");
    }
}

#[test]
fn a_part_keeps_the_faces_that_are_its_own_and_the_sides_of_the_whole() {
    let (mesh, pieces) = pieces();
    let whole = View::of_tets(&mesh, &[]);
    let named = |view: &View<'_>| {
        let mut counts: BTreeMap<String, usize> = BTreeMap::new();
        for group in view.group_of.iter() {
            *counts
                .entry(view.groups[*group as usize].name.clone())
                .or_default() += 1;
        }
        counts
    };
    let mut sum: BTreeMap<String, usize> = BTreeMap::new();
    for piece in &pieces {
        // Without its neighbours a piece has faces where they would be: those are told by their sides.
        let part = &piece.mesh;
        let view = View::of_tets_in(part, &[], &mesh.bounds());
        let on_whole = |t: &[u32; 3]| {
            let at = |v: u32| key(&part.positions()[v as usize]);
            let mut corners = t.map(at);
            corners.sort_unstable();
            corners
        };
        let faces: std::collections::BTreeSet<_> = mesh
            .interfaces()
            .iter()
            .map(|f| {
                let mut corners = f.triangle.map(|v| key(&mesh.positions()[v as usize]));
                corners.sort_unstable();
                corners
            })
            .collect();
        let Cells::Triangles(triangles) = view.blocks[1].clone() else {
            panic!("faces are triangles");
        };
        let mut next = triangles.iter();
        let kept = view.with_triangles(|[behind, _]| {
            assert!((behind as usize) < part.tets().len());
            faces.contains(&on_whole(next.next().unwrap()))
        });
        assert_eq!(kept.group_of.len(), kept.cells());
        assert_eq!(kept.cell_fields[0].values.len(), kept.cells());
        let used: std::collections::BTreeSet<u32> = kept.group_of.iter().copied().collect();
        assert_eq!(used.len(), kept.groups.len(), "groups without cells go");
        for (name, count) in named(&kept) {
            *sum.entry(name).or_default() += count;
        }
    }
    let expected = named(&whole);
    // Where the two sides of a face lie in different pieces, here without ghosts, each sees the outside.
    let seen = ["molecule|outside", "outer"].map(|name| sum.remove(name).unwrap());
    assert!(seen[0] > 0 && seen[0] == seen[1]);
    *sum.get_mut("molecule|exterior").unwrap() += seen[0];
    assert_eq!(sum, expected);
    assert!(expected.contains_key("box_xmin") && expected.contains_key("box_zmax"));
    assert_eq!(
        mesh.regions().iter().filter(|r| **r == INTERIOR).count(),
        expected["molecule"]
    );
}

#[test]
fn the_file_that_joins_parts_has_their_fields_and_names() {
    let (mesh, _) = pieces();
    let mut empty = View::default()
        .cell_field("region", Vec::<u8>::new())
        .unwrap();
    empty.groups = View::of_tets(&mesh, &[]).groups;
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("all.pvtu");
    vtu::save_parts(&path, &empty, &["parts/a & b.vtu".to_owned()]).unwrap();
    let text = std::fs::read_to_string(&path).unwrap();
    for part in [
        "Name=\"region\"",
        "Name=\"group\"",
        "Name=\"molecule|exterior\"",
        "Source=\"parts/a &amp; b.vtu\"",
    ] {
        assert_eq!(text.matches(part).count(), 1, "{part} in {text}");
    }
    // A part without cells has the same arrays.
    let mut file = Vec::new();
    vtu::write(&mut file, &empty).unwrap();
    assert!(String::from_utf8_lossy(&file).contains("Name=\"group\""));
    let read = vtu::parse(&file).unwrap();
    assert_eq!(read.cells(), 0);
}

#[test]
fn every_tile_has_one_rank() {
    for (tiles, ranks) in [(1, 1), (7, 3), (3, 7), (64, 5), (12, 12)] {
        let deal = Deal { tiles, ranks };
        let mut seen = 0;
        for rank in 0..ranks {
            for tile in deal.of(rank) {
                assert_eq!(deal.rank_of(tile), rank, "{tile} of {tiles} on {ranks}");
                seen += 1;
            }
            assert!(deal.of(rank).len() <= deal.most());
        }
        assert_eq!(seen, tiles);
    }
}

#[test]
fn every_cell_has_one_tile_and_tiles_are_boxes() {
    for (cells, root, shift, count) in [
        ([9, 5, 3], 2, 0, 7),
        ([9, 5, 3], 2, 1, 7),
        ([16, 16, 16], 4, 2, 64),
        ([3, 3, 3], 8, 0, 5),
        ([1, 40, 1], 4, 3, 4),
    ] {
        let tiles = Tiles::new(cells, root, shift, count, |[x, y, z]| u64::from(x + y + z));
        assert_eq!(tiles.len(), count);
        let mut seen = 0;
        for tile in 0..count {
            let [low, high] = tiles.cells_of(tile);
            for z in low[2]..high[2] {
                for y in low[1]..high[1] {
                    for x in low[0]..high[0] {
                        assert_eq!(tiles.of_cell([x, y, z]), tile, "{cells:?}, {x} {y} {z}");
                        seen += 1;
                    }
                }
            }
        }
        assert_eq!(seen, cells.iter().product::<usize>());
    }
}

#[test]
fn the_heaviest_are_halved() {
    // All weight in one corner of 4 × 4 × 4 roots.
    let tiles = Tiles::new([32; 3], 8, 0, 7, |root| u64::from(root == [0; 3]));
    let [low, high] = tiles.cells_of(tiles.of_cell([0; 3]));
    assert_eq!((low, high), ([0; 3], [8; 3]));
}

#[test]
fn pieces_survive_their_bytes_and_nothing_else_does() {
    let positions = [
        [0.0; 3],
        [1.0, 0.0, 0.0],
        [0.0, 1.0, 0.0],
        [0.0, 0.0, 1.0],
        [1.0; 3],
    ];
    let kinds = vec![
        VertexKind::Interior,
        VertexKind::Surface,
        VertexKind::BoxFace { axis: 2 },
        VertexKind::BoxEdge { axis: 1 },
        VertexKind::Fixed,
    ];
    let mesh = TetMesh::with_kinds(
        positions.map(Point3::from).to_vec(),
        vec![[0, 1, 2, 3], [4, 3, 2, 1]],
        vec![INTERIOR, 7],
        kinds,
    )
    .unwrap();
    let shared = vec![true, false, false, true, true];
    let piece = Piece { mesh, shared };
    let bytes = piece.to_bytes();
    assert_eq!(Piece::from_bytes(&bytes).unwrap(), piece);
    for cut in [0, 15, 16, bytes.len() - 1] {
        assert!(matches!(
            Piece::from_bytes(&bytes[..cut]),
            Err(NoPiece::Length { .. })
        ));
    }
}
