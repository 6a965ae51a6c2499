//! Words of files and of selections: numbers, quotes, elements, operators, ranges.

use std::collections::BTreeMap;

use geom_core::io::structure::{AltLocs, Format, ReadOptions, inside, parse};
use geom_core::io::{Error, ErrorKind};
use geom_core::nalgebra::Matrix3;
use geom_core::structure::{Element, Name, Transform};
use geom_core::{Point3, Structure, Vector3};

fn expression(text: &str) -> Result<Vec<Transform>, Error> {
    let quarter = Matrix3::new(0.0, -1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0);
    let mut named = BTreeMap::new();
    for n in 1..=3 {
        let translation = Vector3::new(f64::from(n), 0.0, 0.0);
        named.insert(
            n.to_string(),
            Transform {
                rotation: Matrix3::identity(),
                translation,
            },
        );
    }
    let turn = Transform {
        rotation: quarter,
        translation: Vector3::zeros(),
    };
    named.insert("P".to_owned(), turn);
    inside::operators(text, 7, named)
}

#[test]
fn expressions() {
    assert_eq!(expression("1").unwrap().len(), 1);
    assert_eq!(expression("1,3").unwrap().len(), 2);
    assert_eq!(expression("(1-3)").unwrap().len(), 3);
    assert_eq!(expression("(1-3)(1,2)").unwrap().len(), 6);
    assert_eq!(expression("(P)(1-3)").unwrap().len(), 3);
    // The right operator acts first: shift by 2 along x, then turn x to y.
    let first = expression("(P)(2)").unwrap()[0].apply(&Point3::origin());
    assert!((first - Point3::new(0.0, 2.0, 0.0)).norm() < 1e-15);
}

#[test]
fn wrong_expressions_name_their_line() {
    for text in [
        "",
        "()",
        "(1",
        "1)",
        "(1))(2",
        "9",
        "1-9",
        "1-4000000000",
        "3-1",
        "(1)(P)(",
    ] {
        let error = expression(text).unwrap_err();
        assert_eq!(error.line, Some(7), "{text}: {error}");
    }
    let many = "(1-3)".repeat(60);
    assert!(matches!(
        expression(&many).unwrap_err().kind,
        ErrorKind::TooLarge(_)
    ));
}

#[test]
fn words_and_quotes() {
    let text = b"data_x # comment\n_a 'b''s c' \"d e\"\n;text\nmore\n;\n. '.' O5'";
    let values = inside::words(text).unwrap();
    let expected = [
        ("data_x", 1),
        ("_a", 2),
        ("b''s c", 2),
        ("d e", 2),
        ("text\nmore", 3),
        ("", 6),
        (".", 6),
        ("O5'", 6),
    ];
    let expected: Vec<_> = expected.iter().map(|&(v, l)| (v.to_owned(), l)).collect();
    assert_eq!(values, expected);
}

#[test]
fn open_quotes_are_truncated() {
    for text in ["data_x _a 'b", "data_x\n;b\n", "data_x \"b\n"] {
        let error = parse(text.as_bytes(), Format::Mmcif, &ReadOptions::default()).unwrap_err();
        assert!(
            matches!(error.kind, ErrorKind::Truncated(_)),
            "{text}: {error}"
        );
    }
}

#[test]
fn ions_are_known_without_a_column_of_elements() {
    let mut text = "data_x\nloop_\n".to_owned();
    for item in
        "group_PDB label_atom_id label_comp_id label_asym_id label_seq_id Cartn_x Cartn_y Cartn_z"
            .split(' ')
    {
        text += &format!("_atom_site.{item}\n");
    }
    for (x, (atom, component)) in (0..).zip([
        ("CA", "ALA"),
        ("CA", "CA"),
        ("FE", "FE2"),
        ("CA", "CAF"),
        ("C1", "C1X"),
    ]) {
        text += &format!("HETATM {atom} {component} A {x} {}.0 0.0 0.0\n", 9 * x);
    }
    let made = parse(text.as_bytes(), Format::Mmcif, &ReadOptions::default()).unwrap();
    let symbols: Vec<&str> = made
        .structure
        .atoms()
        .iter()
        .map(|a| a.element.symbol())
        .collect();
    assert_eq!(symbols, ["C", "Ca", "Fe", "C", "C"]);
}

#[test]
fn uncertainties_are_left_out() {
    assert_eq!(inside::measured(b"1.5(3)"), Some(1.5));
    assert_eq!(inside::measured(b"-12.375(11)"), Some(-12.375));
    assert_eq!(inside::measured(b"7"), Some(7.0));
    for wrong in ["1.5(3", "1.5()", "1.5(x)", "(3)", "1.5(3)4"] {
        assert_eq!(inside::measured(wrong.as_bytes()), None, "{wrong}");
    }
}

#[test]
fn elements_from_names() {
    let element = |name: &str, residue: &str, alone: bool, aligned: Option<u8>| {
        let name = Name::new(name).unwrap();
        inside::element_of(name, Name::new(residue).unwrap(), alone, aligned).symbol()
    };
    // In residues of polymers the first letter decides, aligned or not.
    assert_eq!(element("CA", "ALA", false, None), "C");
    assert_eq!(element("HG11", "VAL", false, Some(0)), "H");
    assert_eq!(element("1HB", "ALA", false, Some(0)), "H");
    assert_eq!(element("SE", "MSE", false, Some(0)), "Se");
    assert_eq!(element("SD", "MET", false, Some(1)), "S");
    assert_eq!(element("O5'", "DA", false, Some(1)), "O");
    // Ions.
    assert_eq!(element("CA", "CA", true, None), "Ca");
    assert_eq!(element("SOD", "SOD", true, None), "Na");
    assert_eq!(element("K", "K", true, Some(1)), "K");
    assert_eq!(element("UNK", "UNX", true, None), "X");
    assert_eq!(inside::element_in_file(" X"), Some(Element::UNKNOWN));
    // Ligands: the alignment decides, and without it only unmistakable symbols are believed.
    assert_eq!(element("FE", "HEM", false, Some(0)), "Fe");
    assert_eq!(element("NA", "HEM", false, Some(1)), "N");
    assert_eq!(element("NA", "HEM", false, None), "N");
    assert_eq!(element("CL1", "LIG", false, None), "Cl");
    assert_eq!(element("HO21", "NAG", false, Some(0)), "H");
    assert_eq!(element("1H5", "LIG", false, Some(0)), "H");
    assert_eq!(element("*", "LIG", false, None), "X");
}

#[test]
fn hybrid_36_numbers() {
    assert_eq!(inside::hybrid_36("A000"), Some(10_000));
    assert_eq!(inside::hybrid_36("A001"), Some(10_001));
    assert_eq!(
        inside::hybrid_36("ZZZZ"),
        Some(10_000 + 26 * 36i32.pow(3) - 1)
    );
    assert_eq!(inside::hybrid_36("a000"), Some(10_000 + 26 * 36i32.pow(3)));
    for wrong in ["", "****", "Aa00", "1A00"] {
        assert_eq!(inside::hybrid_36(wrong), None);
    }
}

/// All that stands in rows of the PDB format.
fn rows(text: &str) -> Result<Structure, Error> {
    let options = ReadOptions {
        altlocs: AltLocs::All,
        waters: true,
        ..ReadOptions::default()
    };
    parse(text.as_bytes(), Format::Pdb, &options).map(|read| read.structure)
}

#[test]
fn rows_that_deviate() {
    let chain_of = |line: &str| {
        let found = rows(line).unwrap();
        let residue = found.residues()[0];
        let is_a = found.chains()[0].name.as_str() == "A";
        (residue.name, residue.number, is_a)
    };
    // Usual; two-character chain; four-letter residue; chain and five digits.
    let (name, number, a) = chain_of(
        "ATOM      1  CA  ALA A  10       1.000   2.000   3.000  1.00  0.00           C\n",
    );
    assert_eq!((name.as_str(), number, a), ("ALA", 10, true));
    let (name, _, a) = chain_of(
        "ATOM  A0000  CA  ALAAA  10       1.000   2.000   3.000  1.00  0.00           C\n",
    );
    assert_eq!((name.as_str(), a), ("ALA", false));
    let (name, _, a) = chain_of(
        "ATOM  186a0  OH2 TIP3A  10       1.000   2.000   3.000  1.00  0.00           O\n",
    );
    assert_eq!((name.as_str(), a), ("TIP3", true));
    let (name, number, a) = chain_of(
        "ATOM      1  C1  POPCA12345      1.000   2.000   3.000  1.00  0.00           C\n",
    );
    assert_eq!((name.as_str(), number, a), ("POPC", 12345, true));
    let (name, _, a) = chain_of(
        "HETATM    1 MG    MGA1  10       1.000   2.000   3.000  1.00  0.00          MG\n",
    );
    assert_eq!((name.as_str(), a), ("MG", false));
    // Hexadecimal residue numbers; blanks inside a name.
    let read =
        rows("ATOM  186a0  O 1 HOH A9c40       1.000   2.000   3.000  1.00  0.00           O\n");
    let read = read.unwrap();
    let (residue, atom) = (read.residues()[0], read.atoms()[0]);
    assert_eq!((residue.number, atom.name.as_str()), (40_000, "O1"));
    // A serial number of six digits shifts the row.
    let read =
        rows("ATOM  100000  CA  ALA A  10       1.000   2.000   3.000  1.00  7.00           C\n");
    let read = read.unwrap();
    let (residue, atom) = (read.residues()[0], read.atoms()[0]);
    assert_eq!(atom.position, Point3::new(1.0, 2.0, 3.0));
    assert_eq!(
        (residue.number, atom.b_factor, atom.name.as_str()),
        (10, 7.0, "CA")
    );
}

#[test]
fn a_cut_row_is_truncated() {
    let row = "ATOM      1  CA  ALA A  10       1.000   2.000   3.000  1.00  0.00           C";
    let two = format!("{row}\n{row}");
    assert_eq!(rows(&two).unwrap().atoms().len(), 2);
    for cut in [1, 10, 30, 75] {
        let error = rows(&two[..two.len() - cut]).unwrap_err();
        assert_eq!(error.line, Some(2));
        assert!(matches!(error.kind, ErrorKind::Truncated(_)), "{error}");
    }
}
