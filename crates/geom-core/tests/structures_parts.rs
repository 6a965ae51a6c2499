//! Parts of structures, their names and radii.

use geom_core::Point3;
use geom_core::structure::{
    Atom, Element, Name, Selector, StructureBuilder, residue_radius, united_radius,
};

#[test]
fn atoms_are_56_bytes_or_less() {
    assert!(std::mem::size_of::<Atom>() <= 56);
}

#[test]
fn symbols_and_numbers_agree() {
    assert_eq!(Element::from_symbol("ca"), Some(Element(20)));
    assert_eq!(Element::from_symbol("D"), Some(Element::HYDROGEN));
    assert_eq!(Element::from_symbol("Og"), Some(Element(118)));
    assert_eq!(Element::from_symbol("Zz"), None);
    assert_eq!(Element(26).symbol(), "Fe");
}

fn anything() -> Atom {
    Atom {
        position: Point3::origin(),
        radius: 1.0,
        charge: 0.0,
        b_factor: 0.0,
        name: Name::default(),
        element: Element::UNKNOWN,
        hetero: false,
    }
}

#[test]
fn empty_parts_are_dropped() {
    let mut b = StructureBuilder::new();
    let atom = anything();
    b.domain(1, 1);
    b.chain(Name::new("A").unwrap());
    b.chain(Name::new("B").unwrap());
    b.residue(Name::new("GLY").unwrap(), 1, Name::default());
    b.residue(Name::new("ALA").unwrap(), 2, Name::default());
    b.atom(atom);
    b.atom(atom);
    b.residue(Name::new("SER").unwrap(), 3, Name::default());
    b.atom(atom);
    b.domain(2, 1);
    b.atom(atom);
    let s = b.build();
    assert_eq!(s.atoms().len(), 4);
    assert_eq!(s.residue_starts(), [0, 2, 3, 4]);
    assert_eq!(s.chain_starts(), [0, 2, 3]);
    assert_eq!(s.domain_starts(), [0, 1, 2]);
    assert_eq!(s.chains()[0].name.as_str(), "B");
    assert_eq!(s.domain_chains(1), 1..2);
}

#[test]
fn united_radii_follow_the_types() {
    let radius = |residue: &str, atom: &str, element| {
        united_radius(
            Name::new(residue).unwrap(),
            Name::new(atom).unwrap(),
            element,
        )
    };
    assert_eq!(radius("ALA", "CB", Element::CARBON), 1.88);
    assert_eq!(radius("ALA", "C", Element::CARBON), 1.61);
    assert_eq!(radius("PHE", "CZ", Element::CARBON), 1.76);
    assert_eq!(radius("TYR", "CZ", Element::CARBON), 1.61);
    assert_eq!(radius("SER", "OG", Element::OXYGEN), 1.46);
    assert_eq!(radius("DA", "C8", Element::CARBON), 1.76);
    assert_eq!(radius("DT", "C7", Element::CARBON), 1.88);
    assert_eq!(radius("ZN", "ZN", Element(30)), Element(30).vdw_radius());
}

#[test]
fn neighbouring_residues_of_a_trace_overlap() {
    // Cα atoms of neighbours are 3.8 Å apart.
    for residue in ["GLY", "ALA", "TRP", "UNK"] {
        assert!(residue_radius(Name::new(residue).unwrap()) > 1.9);
    }
}

/// Residues −9 … 30 of chain A that a range means.
fn in_range(range: &str) -> Option<Vec<i32>> {
    let selector = Selector::parse(&format!("A:{range}")).ok()?;
    let mut b = StructureBuilder::new();
    b.domain(1, 1);
    b.chain(Name::new("A").unwrap());
    for number in -9..=30 {
        b.residue(Name::new("GLY").unwrap(), number, Name::default());
        b.atom(anything());
    }
    let structure = b.build();
    let selection = structure.select(&selector).ok()?;
    let residues = structure.residues().iter().zip(selection.residues());
    let meant = residues.filter(|(_, meant)| **meant);
    Some(meant.map(|(residue, _)| residue.number).collect())
}

#[test]
fn ranges_with_signs() {
    let all = |first: i32, last: i32| Some((first..=last).collect::<Vec<_>>());
    assert_eq!(in_range("7"), all(7, 7));
    assert_eq!(in_range("-7"), all(-7, -7));
    assert_eq!(in_range("-5--2"), all(-5, -2));
    assert_eq!(in_range("-5-2"), all(-5, 2));
    assert_eq!(in_range("10-25"), all(10, 25));
    for wrong in ["", "-", "a", "5-", "25-10", "1-2-3", "9999999999"] {
        assert_eq!(in_range(wrong), None, "{wrong}");
    }
}

#[test]
fn selectors_are_written_as_they_are_read() {
    for text in [
        "A",
        "chain:all",
        "B:-3-4,water",
        "copy:2/A:5",
        "name:HEM,model:1-3",
        "chain:",
    ] {
        let selector = Selector::parse(text).unwrap();
        assert_eq!(selector.to_string(), text);
    }
    let words = Selector::parse("A,resname HEM").unwrap_err().to_string();
    assert!(
        words.contains("\"resname HEM\"") && words.contains("name:HEM"),
        "{words}"
    );
    for wrong in ["", "A,", "copy:-1", "B:x", "A-name-that-is-too-long"] {
        assert!(Selector::parse(wrong).is_err(), "{wrong}");
    }
}
