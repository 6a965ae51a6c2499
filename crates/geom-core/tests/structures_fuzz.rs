//! Mutated structure files: every reader gives a structure or an error, never a panic.

use geom_core::Point3;
use geom_core::compute::random::SplitMix64;
use geom_core::io::pqr;
use geom_core::io::structure::{AltLocs, Format, Models, Radii, ReadOptions, parse, read};
use geom_core::structure::Selector;

/// A generator with a seed, so that a failing case has a number.
struct Random(SplitMix64);

impl Random {
    fn next(&mut self, below: usize) -> usize {
        self.0.below(below)
    }

    /// Bytes changed, cut, repeated, or replaced by something that has a meaning.
    fn mutate(&mut self, seed: &[u8]) -> Vec<u8> {
        const WORDS: &[&str] = &[
            "NaN",
            "-",
            "99999999999999999999",
            "loop_",
            "data_",
            "\n;",
            "'",
            "\"",
            "(1-",
            ")(",
            "?",
            "BIOMT1",
            "MODEL",
            "ENDMDL",
            "HETATM",
            "1e999",
            "\u{e9}",
            "\0",
            "\r\n",
            "-1",
            ",",
            "_atom_site.id",
            "REMARK 350",
            "REMARK   6 DOMAIN 1 ",
            "TER\n",
        ];
        let mut bytes = seed.to_vec();
        for _ in 0..1 + self.next(4) {
            let at = self.next(bytes.len() + 1);
            let end = (at + 1 + self.next(40)).min(bytes.len());
            let word = WORDS[self.next(WORDS.len())].bytes();
            match self.next(8) {
                0 => bytes.truncate(at),
                1 => drop(bytes.drain(at..end)),
                2 => {
                    let piece = bytes[at..end].to_vec();
                    let to = self.next(bytes.len() + 1);
                    bytes.splice(to..to, piece);
                }
                3 => drop(bytes.splice(at..at, word)),
                4 => drop(bytes.splice(at..(at + word.len()).min(bytes.len()), word)),
                _ if at < bytes.len() => bytes[at] = self.next(256) as u8,
                _ => {}
            }
        }
        bytes
    }
}

/// Some lines of a fixture.
fn lines(name: &str, keep: impl Fn(usize, &str) -> bool) -> Vec<u8> {
    let text = std::fs::read_to_string(fixtures::path(name)).unwrap();
    let lines = text.lines().enumerate().filter(|(i, l)| keep(*i, l));
    lines
        .flat_map(|(_, l)| [l, "\n"])
        .collect::<String>()
        .into_bytes()
}

fn is_atom(line: &str) -> bool {
    line.starts_with("ATOM ") || line.starts_with("HETATM")
}

/// All kinds of records of a PDB file, few of each.
fn pdb() -> Vec<u8> {
    let records = ["HEADER", "REMARK 350", "SEQRES", "MASTER", "END"];
    lines("5e5z.pdb", |i, l| {
        records.iter().any(|r| l.starts_with(r)) || (is_atom(l) && i % 4 == 0)
    })
}

/// The categories of an mmCIF file that are read, with every twentieth atom.
fn mmcif() -> Vec<u8> {
    let text = std::fs::read_to_string(fixtures::path("5i55.cif")).unwrap();
    let read = [
        "_atom_site.",
        "_pdbx_struct_assembly_gen.",
        "_pdbx_struct_oper_list.",
        "_entity.",
    ];
    let all: Vec<_> = text.lines().collect();
    let mut kept = vec![true];
    for category in all[1..].split_inclusive(|l| l.trim() == "#") {
        let wanted = category
            .iter()
            .any(|l| read.iter().any(|r| l.starts_with(r)));
        kept.extend(
            category
                .iter()
                .enumerate()
                .map(|(i, l)| wanted && (!is_atom(l) || i % 20 == 0)),
        );
    }
    lines("5i55.cif", |i, _| kept[i])
}

fn pqr() -> Vec<u8> {
    let structure = read(fixtures::path("5e5z.pdb"), &ReadOptions::default())
        .unwrap()
        .structure;
    let mut text = Vec::new();
    pqr::write(&structure, &mut text).unwrap();
    text.split_inclusive(|&b| b == b'\n')
        .take(15)
        .flatten()
        .copied()
        .collect()
}

fn survives(format: Format, seed: &[u8]) {
    let whole = parse(seed, format, &ReadOptions::default()).unwrap();
    assert!(
        whole.report.atoms >= 10,
        "{format}: a seed of {} atoms",
        whole.report.atoms
    );
    let mut accepted = 0;
    for case in 0..12_000u64 {
        let mut random = Random(SplitMix64::new(case));
        let input = random.mutate(seed);
        let options = ReadOptions {
            models: [Models::First, Models::All, Models::Number(1)][random.next(3)],
            altlocs: [AltLocs::Best, AltLocs::All, AltLocs::Label('B')][random.next(3)],
            radii: [Radii::File, Radii::Elements, Radii::United][random.next(3)],
            waters: random.next(2) == 0,
            assembly: (random.next(3) == 0).then(|| "1".to_owned()),
            max_atoms: 100_000,
            ..Default::default()
        };
        let detect = random.next(4) == 0;
        let outcome = std::panic::catch_unwind(|| {
            let format = if detect {
                Format::detect(&input, None)?
            } else {
                format
            };
            parse(&input, format, &options)
        });
        match outcome {
            Err(_) => panic!(
                "{format}, case {case}: {:?}",
                String::from_utf8_lossy(&input)
            ),
            Ok(Ok(read)) => {
                accepted += 1;
                let atoms = read.structure.atoms();
                let finite = |p: &Point3| p.iter().all(|x| x.is_finite());
                assert!(!atoms.is_empty(), "{format}, case {case}");
                assert!(atoms.iter().all(|a| finite(&a.position) && a.radius >= 0.0));
            }
            Ok(Err(error)) => assert!(!error.to_string().contains('\n'), "{error}"),
        }
    }
    // Mutations that are all refused, or all accepted, would test little.
    assert!(
        (300..11_700).contains(&accepted),
        "{format}: {accepted} accepted"
    );
}

#[test]
fn mutated_pdb_files() {
    survives(Format::Pdb, &pdb());
}

#[test]
fn mutated_mmcif_files() {
    survives(Format::Mmcif, &mmcif());
}

#[test]
fn mutated_pqr_files() {
    survives(Format::Pqr, &pqr());
}

/// What is understood is written as it would be read, and never selects beyond the structure.
#[test]
fn mutated_selectors() {
    let seed = "A,B:10-25,chain:copy,copy:2-3/name:ZN,model:1,domain:2,residue:-5--2,water/A";
    let structure = read(fixtures::path("5e5z.pdb"), &ReadOptions::default())
        .unwrap()
        .structure;
    let (mut understood, mut selected) = (0, 0);
    for case in 0..20_000 {
        let mut random = Random(SplitMix64::new(case));
        let from = random.next(seed.len());
        let input = random.mutate(&seed.as_bytes()[from..]);
        let Ok(selector) = Selector::parse(&String::from_utf8_lossy(&input)) else {
            continue;
        };
        understood += 1;
        let again = Selector::parse(&selector.to_string()).unwrap();
        assert_eq!(again, selector, "case {case}");
        if let Ok(selection) = structure.select(&selector) {
            selected += 1;
            assert_eq!(selection.residues().len(), structure.residues().len());
            assert!(selection.atom_ranges(&structure).all(|r| !r.is_empty()));
        }
    }
    assert!(
        understood > 1000 && selected > 10,
        "{understood}, {selected}"
    );
}
