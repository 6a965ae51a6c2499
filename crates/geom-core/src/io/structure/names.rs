//! What names in files say: kinds of residues, and elements of atoms without an element column.
//!
//! The lists hold the names that the wwPDB and the usual force fields use. A residue that none of them knows is what
//! its record says: a ligand (an ion, if it is one atom) in `HETATM` rows, a part of a polymer in `ATOM` rows, unless
//! the file tells otherwise (SEQRES, MODRES, `_entity`).

use crate::structure::residues::{is_polymer, keys, listed};
use crate::structure::{Element, Name};

static WATERS: [u64; 22] = keys([
    "HOH", "WAT", "H2O", "DOD", "D2O", "HHO", "OHH", "OH2", "TIP", "TIP2", "TIP3", "TIP4", "TIP5",
    "TP3", "TP4", "TP5", "T3P", "T4P", "SOL", "SPC", "SPCE", "TPW",
]);

/// Ions as force fields name them in `ATOM` records.
static IONS: [u64; 36] = keys([
    "SOD", "CLA", "POT", "CAL", "CES", "LIT", "RUB", "BAR", "CAD", "MG", "MG2", "ZN", "ZN2", "NA",
    "NA+", "CL", "CL-", "K", "K+", "CA", "CA2", "CS+", "LI+", "RB+", "MN", "FE", "FE2", "FE3",
    "IP", "IM", "CD", "CO", "CU", "HG", "NI", "SR",
]);

static LIPIDS: [u64; 28] = keys([
    "POPC", "POPE", "POPS", "POPG", "POPA", "DPPC", "DPPE", "DPPS", "DPPG", "DOPC", "DOPE", "DOPS",
    "DOPG", "DMPC", "DMPE", "DMPG", "DLPC", "DLPE", "DSPC", "DSPE", "CHL1", "CHOL", "POP", "DPP",
    "OLE", "PLM", "STE", "CLR",
]);

/// Crystallographic and of force fields.
pub(crate) fn is_water(residue: Name) -> bool {
    listed(residue, &WATERS)
}

/// Is it a lipid of the usual force fields?
pub(crate) fn is_lipid(residue: Name) -> bool {
    listed(residue, &LIPIDS)
}

/// Residue names of four letters, which reach into the column of two-character chains.
pub(crate) fn has_four_letters(residue: Name) -> bool {
    residue.as_str().len() == 4 && (is_polymer(residue) || is_water(residue) || is_lipid(residue))
}

pub(crate) fn is_ion(residue: Name) -> bool {
    listed(residue, &IONS)
}

/// Elements of two letters whose names are taken at their word even where names are not aligned and
/// the residue is unknown; `CA`, `CD`, `HG`, `NA` … are more often carbon, hydrogen or nitrogen.
const UNMISTAKABLE: &[&str] = &["BR", "CL", "CU", "FE", "MG", "MN", "SE", "SI", "ZN"];

/// The element that a file names; `X` is an atom that nobody knows. `None` if it names none.
pub(crate) fn element_in_file(symbol: &str) -> Option<Element> {
    match symbol.trim() {
        "X" | "x" => Some(Element::UNKNOWN),
        symbol => Element::from_symbol(symbol),
    }
}

/// The element of an atom that has no element column.
///
/// `aligned` is the column (0 or 1) of the name's first character where the file aligns names as
/// the PDB format says, so that a two-letter element starts at 0; `None` where it does not.
/// `alone`: the residue has no other atom.
///
/// The rules, first one first: in amino acids, nucleotides and water the first letter is the element, but for the
/// selenium of MSE and SEC; an atom alone is an ion, whose name is its element's; an aligned name has its element in
/// the first two columns, and one that begins in the second column has an element of one letter; an unaligned name is
/// that of one of nine elements that nothing else is called by, or else its first letter counts. Leading digits (`1HB`)
/// are passed over.
pub(crate) fn element_of(name: Name, residue: Name, alone: bool, aligned: Option<u8>) -> Element {
    let text = name.as_str().to_ascii_uppercase();
    let letters = text.trim_start_matches(|c: char| !c.is_ascii_alphabetic());
    let first = |n: usize| letters.get(..n).and_then(Element::from_symbol);
    let single = || first(1).unwrap_or(Element::UNKNOWN);
    if is_polymer(residue) || is_water(residue) {
        return match letters.get(..2) {
            Some("SE") if matches!(residue.as_str(), "MSE" | "SEC") => Element(34),
            _ => single(),
        };
    }
    if alone {
        // An ion: `ZN`, `CA`, `SOD`.
        return match text.as_str() {
            "SOD" => Element(11),
            "CLA" => Element(17),
            "POT" => Element(19),
            "CAL" => Element(20),
            "CES" => Element(55),
            "LIT" => Element(3),
            "RUB" => Element(37),
            "CAD" => Element(48),
            "BAR" => Element(56),
            "IOD" => Element(53),
            "UNK" => Element::UNKNOWN,
            _ => first(2).unwrap_or_else(single),
        };
    }
    let two = letters.get(..2).unwrap_or_default();
    let long_hydrogen = text.len() == 4 && text.starts_with('H');
    match aligned {
        Some(0) if text.starts_with(letters) && !long_hydrogen => first(2).unwrap_or_else(single),
        None if UNMISTAKABLE.contains(&two) => first(2).unwrap_or_else(single),
        _ => single(),
    }
}

/// Distinct names in order of first appearance; the last one is found at once.
#[derive(Debug, Default)]
pub(super) struct Names {
    names: Vec<Box<[u8]>>,
    sorted: std::collections::BTreeMap<Box<[u8]>, u32>,
    last: u32,
}

impl Names {
    /// The number of a name, new or known. Files name one chain many times in a row, so the last answer is tried first;
    /// any other takes O(log n).
    pub(super) fn index(&mut self, name: &[u8]) -> u32 {
        if self
            .names
            .get(self.last as usize)
            .is_some_and(|n| **n == *name)
        {
            return self.last;
        }
        self.last = match self.sorted.get(name) {
            Some(&index) => index,
            None => {
                let index = self.names.len() as u32;
                self.names.push(name.into());
                self.sorted.insert(name.into(), index);
                index
            }
        };
        self.last
    }

    /// The chain without a name behind so many `TER` records. Its entry is no text, so that it cannot
    /// be a name in the file.
    pub(super) fn unnamed(&mut self, segment: u32) -> u32 {
        let [a, b, c, d] = segment.to_le_bytes();
        self.index(&[0, a, b, c, d])
    }

    /// The name of this index.
    pub(super) fn name(&self, index: u32) -> &[u8] {
        &self.names[index as usize]
    }

    /// `None` for a name that has not come yet.
    pub(super) fn find(&self, name: &[u8]) -> Option<u32> {
        self.sorted.get(name).copied()
    }
}
