//! What residue names say: which residues are parts of polymers.

use super::Name;

/// What a residue is part of.
///
/// Formats tell it in different ways (SEQRES, `_entity`, names); a residue made by hand is [`Polymer`](Self::Polymer)
/// unless said otherwise.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum ResidueKind {
    /// A protein or nucleic acid, modified residues such as MSE included.
    #[default]
    Polymer,
    /// A ligand, cofactor, lipid, glycan or anything else that is neither polymer, ion nor water.
    Ligand,
    /// A single atom that is not water.
    Ion,
    /// A water molecule.
    Water,
}

/// Also modified acids, and the caps of chains (`ACE`, `NME`), which belong to the polymer.
static AMINO_ACIDS: [u64; 74] = keys([
    "ALA", "ARG", "ASN", "ASP", "CYS", "GLN", "GLU", "GLY", "HIS", "ILE", "LEU", "LYS", "MET",
    "PHE", "PRO", "SER", "THR", "TRP", "TYR", "VAL", // the twenty
    "ASX", "GLX", "SEC", "PYL", "UNK", // ambiguous and rare
    "ASH", "CYM", "CYX", "CYSH", "GLH", "HID", "HIE", "HIP", "HSD", "HSE", "HSP", "HSC", "LSN",
    "LYN", "NLE", "DISU", "CALA", "NALA", // protonation states of force fields
    "MSE", "SEP", "TPO", "PTR", "CSO", "CSD", "CME", "CSS", "CAS", "OCS", "HYP", "MLY", "M3L",
    "MLZ", "ALY", "KCX", "PCA", "LLP", "CGU", "TYS", "FME", "CXM", "SAC", "DAL", "AIB", "ORN",
    "ACE", "NME", "NH2", "NMA", "FOR", // caps
]);

/// With the names of force fields for the ends of a chain (`DA5`, `DA3`) and the modified ones of transfer and
/// ribosomal RNA.
static NUCLEOTIDES: [u64; 68] = keys([
    "A", "C", "G", "U", "T", "I", "N", "DA", "DC", "DG", "DT", "DU", "DI", "DN", "RA", "RC", "RG",
    "RU", "ADE", "CYT", "GUA", "THY", "URA", "A3", "A5", "C3", "C5", "G3", "G5", "U3", "U5", "DA3",
    "DA5", "DC3", "DC5", "DG3", "DG5", "DT3", "DT5", "RA3", "RA5", "RC3", "RC5", "RG3", "RG5",
    "RU3", "RU5", "PSU", "5MU", "5MC", "2MG", "7MG", "M2G", "1MA", "H2U", "OMC", "OMG", "OMU",
    "YG", "4SU", "5BU", "MA6", "6MZ", "4OC", "UR3", "1MG", "2MA", "MIA",
]);

/// Is it an amino acid or nucleotide, also a modified or protonated one, or a cap of a chain?
pub(crate) fn is_polymer(residue: Name) -> bool {
    is_amino_acid(residue) || is_nucleotide(residue)
}

/// Caps are among them.
pub(crate) fn is_amino_acid(residue: Name) -> bool {
    listed(residue, &AMINO_ACIDS)
}

pub(crate) fn is_nucleotide(residue: Name) -> bool {
    listed(residue, &NUCLEOTIDES)
}

/// Asked for every atom of a file: names compare as integers, all of a list at once.
///
/// No search that ends early: a fold over 70 integers without a branch is a few vector instructions.
pub(crate) fn listed(residue: Name, list: &[u64]) -> bool {
    let key = u64::from_le_bytes(residue.0);
    list.iter().fold(false, |found, &k| found | (k == key))
}

/// Names as the integers that their bytes make.
pub(crate) const fn keys<const N: usize>(names: [&str; N]) -> [u64; N] {
    let mut keys = [0; N];
    let mut i = 0;
    while i < N {
        let name = names[i].as_bytes();
        let mut letter = 0;
        while letter < name.len() {
            keys[i] |= (name[letter] as u64) << (8 * letter);
            letter += 1;
        }
        i += 1;
    }
    keys
}
