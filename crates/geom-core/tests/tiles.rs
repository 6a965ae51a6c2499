//! Ranks, what they put aside, and instances of an assembly.

use geom_core::io::structure::{ReadOptions, read};
use geom_core::tiles::exchange::{exchanged, gathered};
use geom_core::tiles::{Exchange, Lost, Solo, Spill, Threads};

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
