//! Structure files: the fixtures, what deviates from the formats, and bad input.

use std::io::Write;

use geom_core::io::structure::{
    AltLocs, Format, Models, Radii, ReadOptions, parse, read, write_models,
};
use geom_core::io::{ErrorKind, pqr};
use geom_core::structure::{Element, ResidueKind, Selector};
use geom_core::testing::same_on_any_threads;
use geom_core::{Point3, Structure, Vector3};

/// Everything that stands in the file.
fn everything() -> ReadOptions {
    ReadOptions {
        altlocs: AltLocs::All,
        waters: true,
        ..Default::default()
    }
}

fn options(change: impl FnOnce(&mut ReadOptions)) -> ReadOptions {
    let mut options = ReadOptions::default();
    change(&mut options);
    options
}

fn fixture(name: &str, options: &ReadOptions) -> Structure {
    read(fixtures::path(name), options).unwrap().structure
}

#[test]
fn counts_of_the_fixtures() {
    for (name, atoms, chains) in [
        ("1AJJ.pdb", 315, 1),
        ("1A8O.pdb", 644, 1),
        ("1A8O.cif", 644, 1),
        ("5e5z.pdb", 47, 1),
        ("1orc.pdb", 559, 1),
        ("5i55.cif", 218, 1),
        ("1hvr.pdb", 1890, 2),
    ] {
        let s = fixture(name, &everything());
        assert_eq!(
            (s.atoms().len(), s.chains().len()),
            (atoms, chains),
            "{name}"
        );
    }
}

#[test]
fn both_formats_of_an_entry_give_the_same_atoms() {
    let (pdb, cif) = (
        fixture("1A8O.pdb", &everything()),
        fixture("1A8O.cif", &everything()),
    );
    assert_eq!(pdb.atoms().len(), cif.atoms().len());
    for (a, b) in pdb.atoms().iter().zip(cif.atoms()) {
        assert_eq!(
            (a.name, a.element, a.position),
            (b.name, b.element, b.position)
        );
        assert_eq!((a.radius, a.b_factor), (b.radius, b.b_factor));
    }
    assert_eq!(pdb.residues(), cif.residues());
}

#[test]
fn kinds_of_residues() {
    let whole = fixture("1AJJ.pdb", &everything());
    let count = |s: &Structure, kind| {
        let of_kind = |r: &usize| s.residues()[*r].kind == kind;
        let atoms = (0..s.residues().len())
            .filter(of_kind)
            .map(|r| s.residue_atoms(r).len());
        atoms.sum::<usize>()
    };
    assert_eq!(count(&whole, ResidueKind::Ion), 1);
    assert_eq!(count(&whole, ResidueKind::Ligand), 5);
    assert_eq!(count(&whole, ResidueKind::Polymer), 279);
    let no_ligand = options(|o| (o.ligands, o.ions) = (false, false));
    assert_eq!(fixture("1AJJ.pdb", &no_ligand).atoms().len(), 279);
    // Selenomethionine is part of the chain in both formats.
    for name in ["1A8O.pdb", "1A8O.cif"] {
        let s = fixture(name, &no_ligand);
        assert_eq!(
            s.atoms()
                .iter()
                .filter(|a| a.element == Element(34))
                .count(),
            4,
            "{name}"
        );
        assert_eq!(count(&s, ResidueKind::Polymer), s.atoms().len());
    }
    let drug = options(|o| o.select = Some(Selector::parse("ligand").unwrap()));
    let read = read(fixtures::path("1hvr.pdb"), &drug).unwrap();
    assert!(
        read.structure
            .residues()
            .iter()
            .all(|r| r.name.as_str() == "XK2")
    );
    assert_eq!(read.report.unselected + read.report.atoms, 1890);
}

#[test]
fn one_location_of_each_atom() {
    for (name, options) in [
        ("1orc.pdb", options(|_| {})),
        ("5i55.cif", options(|_| {})),
        ("5i55.cif", options(|o| o.altlocs = AltLocs::Label('B'))),
    ] {
        let read = read(fixtures::path(name), &options).unwrap();
        assert!(read.report.altlocs > 0, "{name}");
        let s = read.structure;
        for r in 0..s.residues().len() {
            let mut names: Vec<_> = s.atoms()[s.residue_atoms(r)]
                .iter()
                .map(|a| a.name)
                .collect();
            names.sort();
            names.dedup();
            assert_eq!(
                names.len(),
                s.residue_atoms(r).len(),
                "{name}: {:?}",
                s.residues()[r]
            );
        }
    }
}

#[test]
fn assemblies_are_copies_in_domains() {
    let one = |o: &mut ReadOptions| o.assembly = Some("1".to_owned());
    let deposited = fixture("5e5z.pdb", &ReadOptions::default());
    let whole = fixture("5e5z.pdb", &options(one));
    let n = deposited.atoms().len();
    assert_eq!((whole.domains().len(), whole.atoms().len()), (10, 10 * n));
    assert_eq!(whole.domains()[9].copy, 10);
    // The first operator is the identity.
    assert_eq!(&whole.atoms()[..n], deposited.atoms());
    let pdb = fixture("1A8O.pdb", &options(one));
    let cif = fixture("1A8O.cif", &options(one));
    assert_eq!(
        pdb.atoms().len(),
        2 * fixture("1A8O.pdb", &options(|_| {})).atoms().len()
    );
    for (a, b) in pdb.atoms().iter().zip(cif.atoms()) {
        assert!((a.position - b.position).norm() < 1e-3, "{a:?} {b:?}");
    }
    // Operators are rigid: distances within a copy are those of the original.
    let m = pdb.atoms().len() / 2;
    let at = |i: usize| pdb.atoms()[i].position;
    for (i, j) in [(0, m - 1), (3, 100), (50, 400)] {
        let (original, copy) = ((at(i) - at(j)).norm(), (at(m + i) - at(m + j)).norm());
        assert!((original - copy).abs() < 1e-4);
    }
    let filament = fixture("5i55.cif", &options(one));
    assert_eq!(filament.domains().len(), 20);
}

#[test]
fn products_of_operators_are_counted_before_they_are_built() {
    let text = std::fs::read_to_string(fixtures::path("5i55.cif")).unwrap();
    let generator = "1,2,3,4,5,6,7,8,9,10,11,12,13,14,15,16,17,18,19,20";
    assert_eq!(text.matches(generator).count(), 1);
    let read = |expression: &str, change: &dyn Fn(&mut ReadOptions)| {
        let text = text.replace(generator, expression);
        let options = options(|o| {
            o.assembly = Some("1".to_owned());
            change(o);
        });
        parse(text.as_bytes(), Format::Mmcif, &options)
    };
    let plain = |_: &mut ReadOptions| {};
    let one = fixture("5i55.cif", &ReadOptions::default()).atoms().len();
    let pairs = read("(1-5)(1,5)", &plain).unwrap();
    // Operators 1 to 5 shift by 0 to 4 cells: two of the ten products are the same.
    assert_eq!(pairs.report.copies, 9);
    assert_eq!(pairs.structure.atoms().len(), 9 * one);
    let same = same_on_any_threads(|| read("(1-5)(1,5)", &plain).unwrap().structure);
    assert_eq!(same, pairs.structure);
    let error = read("(1-5)(1,5)", &|o| o.max_atoms = 9 * one - 1).unwrap_err();
    assert!(
        error
            .to_string()
            .starts_with(&format!("{} atoms are too many", 9 * one)),
        "{error}"
    );
    let error = read(&"(1-20)".repeat(30), &plain).unwrap_err();
    assert!(error.to_string().contains("copies: at most"), "{error}");
    let error = read("(1-21)", &plain).unwrap_err();
    assert!(
        error
            .to_string()
            .contains("operators 1 to 21 of assembly 1 among the 20"),
        "{error}"
    );
}

#[test]
fn parts_by_name() {
    let s = fixture("1A8O.pdb", &options(|o| o.assembly = Some("1".to_owned())));
    let count = |text: &str| -> usize {
        let selection = s.select(&Selector::parse(text).unwrap()).unwrap();
        selection.atom_ranges(&s).map(|r| r.len()).sum()
    };
    let all = s.atoms().len();
    assert_eq!(count("all"), all);
    assert_eq!(count("A"), all);
    assert_eq!(count("copy:2"), all / 2);
    assert_eq!(count("domain:1,copy:2"), all);
    assert_eq!(
        count("A:151"),
        count("A:151/copy:1") + count("A:151/copy:2")
    );
    assert_eq!(count("A:151-220"), all);
    assert_eq!(count("name:MSE"), 2 * 4 * 8);
    let error = s.select(&Selector::parse("A,Z").unwrap()).unwrap_err();
    assert_eq!(
        error.to_string(),
        "\"Z\" matches no atom; chains: A; domains: 2"
    );
    // A residue's name where a chain's would stand.
    let error = s.select(&Selector::parse("MSE").unwrap()).unwrap_err();
    assert_eq!(
        error.to_string(),
        "\"MSE\" matches no atom; name:MSE are 8 residues of that name"
    );
}

#[test]
fn pqr_files_are_read_as_they_are_written() {
    let s = fixture("1A8O.pdb", &options(|o| o.assembly = Some("1".to_owned())));
    let mut text = Vec::new();
    pqr::write(&s, &mut text).unwrap();
    let all = options(|o| o.models = Models::All);
    let again = parse(&text, Format::Pqr, &all).unwrap().structure;
    assert_eq!(again.domains(), s.domains());
    assert_eq!(again.chains(), s.chains());
    assert_eq!(again.residues(), s.residues());
    for (a, b) in again.atoms().iter().zip(s.atoms()) {
        assert_eq!((a.name, a.element, a.hetero), (b.name, b.element, b.hetero));
        assert!((a.position - b.position).abs().max() < 1e-4 && (a.radius - b.radius).abs() < 1e-4);
    }
    let mut twice = Vec::new();
    pqr::write(&again, &mut twice).unwrap();
    assert!(twice == text);
    // Both copies are of the first model.
    let first = parse(&text, Format::Pqr, &ReadOptions::default()).unwrap();
    assert_eq!(first.structure.atoms().len(), s.atoms().len());
}

#[test]
fn models_are_read_as_they_are_written() {
    let s = fixture("1A8O.pdb", &options(|o| o.assembly = Some("1".to_owned())));
    let (shift, mut moved) = (Vector3::new(1.0, -2.0, 3.5), s.clone());
    moved
        .atoms_mut()
        .iter_mut()
        .for_each(|a| a.position += shift);
    let mut text = Vec::new();
    write_models(&[s.clone(), moved], &mut text).unwrap();
    let all = options(|o| o.models = Models::All);
    let again = parse(&text, Format::Mmcif, &all).unwrap().structure;
    assert_eq!(again.domains().len(), 2);
    assert_eq!(again.residues().len(), 2 * s.residues().len());
    let count = s.atoms().len();
    for (model, by) in [(0, Vector3::zeros()), (1, shift)] {
        let of_model = &again.atoms()[model * count..(model + 1) * count];
        for (a, b) in of_model.iter().zip(s.atoms()) {
            assert_eq!((a.name, a.element, a.hetero), (b.name, b.element, b.hetero));
            assert!((a.position - b.position - by).abs().max() < 1e-3);
            assert!((a.b_factor - b.b_factor).abs() < 0.01);
        }
    }
    // Copies have names of their own; primes and blanks are no trouble.
    let names: Vec<String> = again.chains().iter().map(|c| c.name.to_string()).collect();
    assert!(
        names.contains(&"A".to_owned()) && names.contains(&"A-2".to_owned()),
        "{names:?}"
    );
    let odd = b"ATOM      1  O5'  DA B   7A      1.000   2.000   3.000  1.00  0.00           O\n";
    let odd = parse(odd, Format::Pdb, &ReadOptions::default())
        .unwrap()
        .structure;
    let mut text = Vec::new();
    write_models(std::slice::from_ref(&odd), &mut text).unwrap();
    let again = parse(&text, Format::Mmcif, &ReadOptions::default())
        .unwrap()
        .structure;
    assert_eq!(again.atoms()[0].name, odd.atoms()[0].name);
    assert_eq!(again.residues()[0], odd.residues()[0]);
}

/// The columns of PDB for all but charge and radius, and a charge whose dot stands where an occupancy has its own.
#[test]
fn pqr_in_columns_is_not_taken_for_pdb() {
    let pqr = b"ATOM      1  N   MET A   1      27.340  24.430   2.614  0.1592 1.8240\n";
    let pdb = b"ATOM      1  N   MET A   1      27.340  24.430   2.614  1.00  9.67\n";
    let bare = b"ATOM      1  N   MET A   1      27.340  24.430   2.614  1.00            N\n";
    let found = |text: &[u8]| Format::detect(text, None).unwrap();
    assert_eq!(found(pqr), Format::Pqr);
    assert_eq!(found(pdb), Format::Pdb);
    assert_eq!(found(bare), Format::Pdb);
}

#[test]
fn pqr_is_free_format() {
    let text = b"REMARK x\n\
        ATOM 1 N ASP 1 -1.5 2e1 3 -0.3 1.85\n\
        ATOM      2 HG11 VAL A 2A  4 5 6 0.1 0\n\
        HETATM    3 ZN ZN A1003 7.5 8 9 2.0 1.4\n\
        TER\nEND\n";
    let s = parse(text, Format::Pqr, &ReadOptions::default())
        .unwrap()
        .structure;
    let elements: Vec<_> = s.atoms().iter().map(|a| a.element.symbol()).collect();
    assert_eq!(elements, ["N", "H", "Zn"]);
    assert_eq!(s.atoms()[0].position, Point3::new(-1.5, 20.0, 3.0));
    assert_eq!((s.atoms()[0].charge, s.atoms()[0].radius), (-0.3, 1.85));
    assert_eq!(s.residues()[1].insertion.as_str(), "A");
    assert_eq!(s.residues()[2].number, 1003);
    assert_eq!(s.chains().len(), 2);
    let glued = b"ATOM 4 O SER B 3 -100.125-200.250-300.5 -0.8 1.4\n";
    let glued = parse(glued, Format::Pqr, &ReadOptions::default()).unwrap();
    let atom = glued.structure.atoms()[0];
    assert_eq!(atom.position, Point3::new(-100.125, -200.25, -300.5));
    assert_eq!((atom.charge, atom.radius), (-0.8, 1.4));
    let raised = parse(text, Format::Pqr, &options(|o| o.min_radius = 1.0)).unwrap();
    assert_eq!(
        (raised.report.raised_radii, raised.report.zero_radii),
        (1, 0)
    );
}

#[test]
fn models_of_a_file() {
    let row = |x: f64| {
        format!("ATOM      1  CA  ALA A   1    {x:8.3}   0.000   0.000  1.00  0.00           C\n")
    };
    let models = [row(1.0), row(2.0)];
    let text = format!(
        "MODEL        1\n{}ENDMDL\nMODEL        7\n{}ENDMDL\n",
        models[0], models[1]
    );
    let read = |models| {
        parse(
            text.as_bytes(),
            Format::Pdb,
            &options(|o| o.models = models),
        )
    };
    let first = read(Models::First).unwrap();
    assert_eq!((first.report.models, first.structure.atoms().len()), (2, 1));
    let all = read(Models::All).unwrap().structure;
    assert_eq!(all.domains()[1].model, 7);
    let seventh = read(Models::Number(7)).unwrap().structure;
    assert_eq!(seventh.atoms()[0].position.x, 2.0);
    let error = read(Models::Number(2)).unwrap_err().to_string();
    assert_eq!(error, "no atoms in model 2: the file has 2 models");
}

#[test]
fn interleaved_chains_are_regrouped_and_unnamed_ones_told_apart() {
    let row = |chain: &str, number: i32| {
        format!("ATOM      1  N   ALA {chain}{number:>4}       1.000   0.000   0.000  1.00  0.00\n")
    };
    let plain = ReadOptions::default();
    let text = [row("A", 1), row("B", 1), row("A", 2), row("B", 2)].concat();
    let s = parse(text.as_bytes(), Format::Pdb, &plain)
        .unwrap()
        .structure;
    assert_eq!((s.chains().len(), s.residues().len()), (2, 4));
    let text = [row(" ", 1), "TER\n".to_owned(), row(" ", 1)].concat();
    let s = parse(text.as_bytes(), Format::Pdb, &plain)
        .unwrap()
        .structure;
    assert_eq!((s.chains().len(), s.residues().len()), (2, 2));
    assert!(s.chains()[0].name.is_empty());
}

/// A row of the PDB format.
fn row(record: &str, name: &str, altloc: char, residue: &str, x: f64) -> String {
    format!(
        "{record:<6}    1 {name:<4}{altloc}{residue:>3} A   7    {x:8.3}   0.000   0.000  0.50  0.00\n"
    )
}

#[test]
fn residues_that_exclude_each_other_may_alternate_row_by_row() {
    let text: String = [" N  ", " CA ", " C  "]
        .iter()
        .flat_map(|name| {
            [("SER", 'A', 1.0), ("THR", 'B', 2.0)].map(|(r, l, x)| row("ATOM", name, l, r, x))
        })
        .collect();
    let read = |altlocs| {
        let options = options(|o| o.altlocs = altlocs);
        parse(text.as_bytes(), Format::Pdb, &options).unwrap()
    };
    let all = read(AltLocs::All).structure;
    assert_eq!((all.residues().len(), all.atoms().len()), (2, 6));
    assert_eq!(all.residue_atoms(1), 3..6);
    for (altlocs, name) in [(AltLocs::Best, "SER"), (AltLocs::Label('B'), "THR")] {
        let one = read(altlocs);
        assert_eq!((one.report.altlocs, one.structure.atoms().len()), (3, 3));
        assert_eq!(one.structure.residues()[0].name.as_str(), name);
    }
}

#[test]
fn residues_of_an_mmcif_file_are_told_apart_by_their_place_in_the_sequence() {
    let items = [
        "label_atom_id",
        "label_comp_id",
        "label_asym_id",
        "label_seq_id",
        "auth_seq_id",
        "Cartn_x",
        "Cartn_y",
        "Cartn_z",
    ];
    let mut text = "data_x\nloop_\n".to_owned();
    for item in items {
        text += &format!("_atom_site.{item}\n");
    }
    // Insertion codes are lost, as in rRNA entries that were edited.
    for (place, residue) in [(1, "C"), (2, "C"), (3, "G"), (4, "C")] {
        for name in ["P", "C1'"] {
            text += &format!("{name} {residue} A {place} 189 {place} 0 0\n");
        }
    }
    let s = parse(text.as_bytes(), Format::Mmcif, &ReadOptions::default())
        .unwrap()
        .structure;
    assert_eq!(s.residue_starts(), [0, 2, 4, 6, 8]);
    assert!(s.residues().iter().all(|r| r.number == 189));
}

#[test]
fn dummies_of_a_membrane_are_its_planes() {
    let dummy = |z: f64| format!("HETATM    1  N   DUM     1       0.000   0.000{z:8.3}\n");
    let text = [
        row("ATOM", " CA ", ' ', "ALA", 1.0),
        dummy(-14.2),
        dummy(14.8),
        dummy(-14.2),
    ]
    .concat();
    let read = parse(text.as_bytes(), Format::Pdb, &ReadOptions::default()).unwrap();
    assert_eq!(read.structure.atoms().len(), 1);
    let membrane = read.report.membrane.unwrap();
    assert_eq!(
        (membrane.lower, membrane.upper, membrane.dummies),
        (-14.2, 14.8, 3)
    );
    let error = parse(dummy(1.0).as_bytes(), Format::Pdb, &ReadOptions::default()).unwrap_err();
    assert!(
        error
            .to_string()
            .ends_with("left out are 1 membrane dummies"),
        "{error}"
    );
}

#[test]
fn compressed_files_and_marked_text_are_read_as_plain_ones() {
    let folder = tempfile::tempdir().unwrap();
    for (name, all) in [("1AJJ.pdb", 315), ("1A8O.cif", 644)] {
        let content = std::fs::read(fixtures::path(name)).unwrap();
        let plain = fixture(name, &everything());
        assert_eq!(plain.atoms().len(), all);
        let path = folder.path().join(format!("{name}.gz"));
        let mut encoder = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
        encoder.write_all(&content).unwrap();
        let packed = encoder.finish().unwrap();
        std::fs::write(&path, &packed).unwrap();
        assert_eq!(read(&path, &everything()).unwrap().structure, plain);
        std::fs::write(&path, &packed[..packed.len() / 2]).unwrap();
        let error = read(&path, &everything()).unwrap_err().to_string();
        assert!(
            error.ends_with("the file ends in the middle of gzip data"),
            "{error}"
        );
        let marked = [b"\xef\xbb\xbf", content.as_slice()].concat();
        let format = Format::detect(&marked, None).unwrap();
        assert_eq!(
            parse(&marked, format, &everything()).unwrap().structure,
            plain
        );
    }
}

/// Line ends of old programs of the Macintosh, alone or where a file was put together from several.
#[test]
fn lines_may_end_with_carriage_returns_alone() {
    let folder = tempfile::tempdir().unwrap();
    for name in ["1AJJ.pdb", "1A8O.cif"] {
        let text = std::fs::read_to_string(fixtures::path(name)).unwrap();
        let plain = fixture(name, &everything());
        let half = text.len() / 2;
        let mixed = text[..half].replace('\n', "\r") + &text[half..].replace('\n', "\r\n");
        for content in [text.replace('\n', "\r"), mixed] {
            let path = folder.path().join(name);
            std::fs::write(&path, content).unwrap();
            assert_eq!(read(&path, &everything()).unwrap().structure, plain);
        }
    }
}

#[test]
fn radii_that_are_none_are_noticed() {
    let pdb = std::fs::read(fixtures::path("1AJJ.pdb")).unwrap();
    let error = Format::detect(&pdb, Some("a.pqr".as_ref())).unwrap_err();
    assert!(error.to_string().contains("rename it to .pdb"), "{error}");
    let text = "ATOM 1 N ASP A 1 1.0 2.0 3.0 1.00 26.42\n";
    let read = parse(text.as_bytes(), Format::Pqr, &ReadOptions::default()).unwrap();
    assert!(read.report.warnings[0].starts_with("the largest radius is 26.42 Å"));
}

#[test]
fn radii_sets() {
    let elements = fixture("1AJJ.pdb", &options(|o| o.radii = Radii::Elements));
    assert!(
        elements
            .atoms()
            .iter()
            .all(|a| a.radius == a.element.vdw_radius())
    );
    let united = read(
        fixtures::path("1hvr.pdb"),
        &options(|o| o.radii = Radii::United),
    )
    .unwrap();
    assert_eq!(united.report.hydrogens, 330);
    let atoms = united.structure.atoms();
    let mean = atoms.iter().map(|a| a.radius).sum::<f64>() / atoms.len() as f64;
    assert!((1.6..1.8).contains(&mean));
}

#[test]
fn a_trace_gets_residue_radii() {
    let mut text = String::new();
    for i in 1..=5 {
        let x = 3.8 * f64::from(i);
        text += &format!("ATOM  {i:>5}  CA  ALA A{i:>4}    {x:8.3}   0.000   0.000  1.00  0.00\n");
    }
    let read = parse(text.as_bytes(), Format::Pdb, &ReadOptions::default()).unwrap();
    assert_eq!(read.report.trace_chains, 1);
    assert!(
        read.structure
            .atoms()
            .iter()
            .all(|a| (2.7..2.8).contains(&a.radius))
    );
}

#[test]
fn bad_input_names_file_and_line() {
    let folder = tempfile::tempdir().unwrap();
    let message = |name: &str, content: &[u8], options: &ReadOptions| {
        let path = folder.path().join(name);
        std::fs::write(&path, content).unwrap();
        let error = read(&path, options).unwrap_err().to_string();
        let (_, rest) = error
            .split_once(&format!("{name}: "))
            .expect("the file is named");
        assert!(!rest.contains('\n'), "{rest}");
        rest.to_owned()
    };
    let plain = ReadOptions::default();
    let contains = |name: &str, content: &[u8], part: &str| {
        let message = message(name, content, &plain);
        assert!(message.contains(part), "{message}");
    };
    contains("a.pdb", b"", "the file is empty");
    contains("a.cif", b" \n\n", "the file is empty");
    contains(
        "a.pdb",
        b"ply\nformat ascii 1.0\n",
        "no atoms in this PDB file, which begins with \"ply\"",
    );
    contains("a.xyz", b"3\nwater\n", "expected a PDB, mmCIF or PQR file");
    contains("a.bcif", &[0x83, 1, 2], "use the mmCIF file");
    let nan = b"REMARK\nATOM      1  CA  ALA A   1         NaN   0.000   0.000  1.00  0.00\n";
    contains("a.pdb", nan, "line 2: expected finite coordinates");
    contains(
        "a.pqr",
        b"ATOM 1 N ASP 1 1 2 inf 0 1\n",
        "line 1: expected x, y, z, charge",
    );
    contains(
        "a.pqr",
        b"ATOM 1 N ASP 1 1 2 3 0 -1\n",
        "line 1: expected a radius of 0 or more",
    );
    contains(
        "a.pqr",
        b"ATOM 1 N ASP 1 1 2 3\n",
        "line 1: expected ATOM, serial",
    );
    let water = b"HETATM    1  O   HOH A   1       0.000   0.000   0.000  1.00  0.00\n";
    contains(
        "a.pdb",
        water,
        "no atoms left of 1: left out are 1 water atoms (option waters)",
    );
    let cif = std::fs::read(fixtures::path("1A8O.cif")).unwrap();
    let text = String::from_utf8(cif.clone()).unwrap();
    let gone = text.replace("_atom_site.Cartn_z", "_atom_site.z");
    contains(
        "a.cif",
        gone.as_bytes(),
        "expected the item _atom_site.Cartn_z",
    );
    let broken = text.replacen(" 19.594 ", " x9.594 ", 1);
    contains(
        "a.cif",
        broken.as_bytes(),
        "expected a finite Cartn_x, found \"x9.594\"",
    );
    contains("a.cif", &cif[..70_000], "the file ends in the middle of");
    let pdb = std::fs::read(fixtures::path("1AJJ.pdb")).unwrap();
    for cut in 40_000..40_081 {
        contains("a.pdb", &pdb[..cut], "the file ends in the middle of");
    }
    // Whole rows, but not to the end.
    let rows = text.find("ATOM   300 ").unwrap();
    contains("a.cif", &cif[..rows], "(no line with # behind it)");
    // Programs that write little besides atoms may leave the end out.
    let few = "HEADER\nATOM      1  N   ALA A   1       1.000   0.000   0.000  1.00  0.00\n";
    let read_few = parse(few.as_bytes(), Format::Pdb, &plain).unwrap();
    assert!(read_few.report.warnings[0].ends_with("is it whole?"));
    contains(
        "a.pdb",
        few.replace("HEADER", "HEADER\nSEQRES   1 A    1  ALA")
            .as_bytes(),
        "line 3: the file ends in the middle of its atoms: an entry ends with END",
    );
    let pqr = "ATOM 1 N ASP 1 1 2 3 0 1.85\nATOM 2 CA ASP 1 1 2 3 0 1.";
    contains(
        "a.pqr",
        &pqr.as_bytes()[..pqr.len() - 5],
        "line 2: the file ends in the middle of an atom",
    );
    contains(
        "a.pqr",
        &pqr.as_bytes()[..30],
        "line 2: the file ends in the middle of an atom",
    );
    let absent = options(|o| o.assembly = Some("9".to_owned()));
    assert_eq!(
        message("a.pdb", &pdb, &absent),
        "expected an assembly (this file defines 1), found \"9\""
    );
    let few = options(|o| o.max_atoms = 300);
    assert!(message("a.pdb", &pdb, &few).starts_with("315 atoms are too many"));
    let few = options(|o| (o.max_atoms, o.assembly) = (1000, Some("1".to_owned())));
    let error = read(fixtures::path("1A8O.pdb"), &few).unwrap_err();
    assert!(matches!(error.kind, ErrorKind::TooLarge(_)), "{error}");
    let missing = read(folder.path().join("none.pdb"), &plain).unwrap_err();
    assert!(missing.to_string().contains("none.pdb: "), "{missing}");
}

/// An atom and the operators of an assembly, row by row.
fn assembly(rows: &[&str]) -> String {
    let mut file =
        "REMARK 350 BIOMOLECULE: 1\nREMARK 350 APPLY THE FOLLOWING TO CHAINS: A\n".to_owned();
    for row in rows {
        file += &format!("REMARK 350   {row}\n");
    }
    file + "ATOM      1  CA  ALA A   1       1.000   0.000   2.000  1.00 10.00           C  \nEND\n"
}

/// About a three-fold axis a rotation and its inverse differ.
#[test]
fn a_three_fold_axis_turns_counter_clockwise() {
    let identity = [
        "BIOMT1   1  1.000000  0.000000  0.000000        0.00000",
        "BIOMT2   1  0.000000  1.000000  0.000000        0.00000",
        "BIOMT3   1  0.000000  0.000000  1.000000        0.00000",
    ];
    let third = [
        "BIOMT1   2 -0.500000 -0.866025  0.000000        0.00000",
        "BIOMT2   2  0.866025 -0.500000  0.000000        0.00000",
        "BIOMT3   2  0.000000  0.000000  1.000000        5.00000",
    ];
    let asked = options(|o| o.assembly = Some("1".to_owned()));
    let file = assembly(&[identity, third].concat());
    let read = parse(file.as_bytes(), Format::Pdb, &asked).unwrap();
    let places: Vec<Point3> = read.structure.atoms().iter().map(|a| a.position).collect();
    let wanted = [Point3::new(1.0, 0.0, 2.0), Point3::new(-0.5, 0.866025, 7.0)];
    assert_eq!(places.len(), 2);
    for (place, wanted) in places.iter().zip(wanted) {
        assert!((place - wanted).norm() < 1e-12, "{place} for {wanted}");
    }
    // An operator has three rows of one name.
    let other = third[2].replace("BIOMT3   2", "BIOMT3   3");
    for rows in [
        &third[..1],
        &third[..2],
        &[third[0], third[2]],
        &[third[0], third[1], &other],
    ] {
        let file = assembly(&[&identity, rows].concat());
        let read = parse(file.as_bytes(), Format::Pdb, &asked);
        assert!(read.is_err(), "{rows:?}");
    }
}

/// Of alternate locations the most occupied stays, whichever label it bears and wherever it stands in the file.
#[test]
fn the_most_occupied_of_alternate_locations_is_kept() {
    for (occupancies, kept) in [([0.3, 0.7], 2.0), ([0.7, 0.3], 1.0), ([0.5, 0.5], 1.0)] {
        let row = |altloc: char, x: f64, occupancy: f64| {
            format!(
                "ATOM      1  CA {altloc}SER A   7    {x:8.3}   0.000   0.000  {occupancy:.2}  0.00\n"
            )
        };
        let text = row('A', 1.0, occupancies[0]) + &row('B', 2.0, occupancies[1]);
        let read = parse(text.as_bytes(), Format::Pdb, &ReadOptions::default()).unwrap();
        let xs: Vec<f64> = read
            .structure
            .atoms()
            .iter()
            .map(|a| a.position.x)
            .collect();
        assert_eq!(xs, [kept], "{occupancies:?}");
    }
}
