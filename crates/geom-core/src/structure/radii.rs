//! Radii of atoms: by element, with the hydrogens they carry, or of whole residues.
//!
//! Which of them a file's atoms get is an option of its reader (`Radii`): elements where hydrogens are there, united
//! radii where they are not; and those of residues wherever one atom stands for each.

use super::{Element, Name, residues};

/// Radius of a heavy atom together with the hydrogens that it carries, Å: the ProtOr set of
/// Tsai, Taylor, Chothia & Gerstein 1999 (J. Mol. Biol. 290, 253) for amino acids, its atom types
/// for nucleotides, and its sp³ carbon, N, O and S elsewhere; Bondi's radius for other elements.
///
/// The types of Tsai et al. in Å: carbon 1.61 (trigonal), 1.76 (trigonal with a hydrogen) and 1.88 (tetrahedral),
/// nitrogen 1.64, oxygen 1.42 (carbonyl, carboxyl, phosphate) and 1.46 (hydroxyl, between two atoms, and in ligands),
/// sulfur 1.77. For structures without hydrogens; with them they would count twice.
pub fn united_radius(residue: Name, atom: Name, element: Element) -> f64 {
    let atom = atom.as_str();
    match element {
        Element::CARBON => match carbon(residue, atom) {
            Carbon::Trigonal => 1.61,
            Carbon::TrigonalH => 1.76,
            Carbon::Tetrahedral => 1.88,
        },
        Element::NITROGEN => 1.64,
        Element::OXYGEN => {
            let carries_or_bridges = match atom {
                "OG" | "OG1" | "OH" => residues::is_amino_acid(residue),
                "O2'" | "O3'" | "O4'" | "O5'" | "O2*" | "O3*" | "O4*" | "O5*" => true,
                _ => !residues::is_polymer(residue),
            };
            if carries_or_bridges { 1.46 } else { 1.42 }
        }
        Element::SULFUR => 1.77,
        other => other.vdw_radius(),
    }
}

/// The three types of carbon that the set tells apart.
enum Carbon {
    /// sp² without hydrogen.
    Trigonal,
    /// sp² with one hydrogen.
    TrigonalH,
    /// sp³.
    Tetrahedral,
}

/// By the atom names of the standard residues; the rings of histidine, phenylalanine, tyrosine and tryptophan, and the
/// bases, are where trigonal carbons are. Anything else is tetrahedral, hence a ligand's aromatic carbons are taken too
/// large.
fn carbon(residue: Name, atom: &str) -> Carbon {
    use Carbon::{Tetrahedral, Trigonal, TrigonalH};
    if residues::is_nucleotide(residue) {
        let base = residue.as_str().trim_start_matches('D');
        return match (atom, base.as_bytes().first()) {
            ("C2" | "C8", Some(b'A')) | ("C8", Some(b'G')) => TrigonalH,
            ("C5" | "C6", Some(b'C' | b'U')) | ("C6", Some(b'T')) => TrigonalH,
            ("C2" | "C4" | "C5" | "C6" | "C8", _) => Trigonal,
            _ => Tetrahedral,
        };
    }
    match (residue.as_str(), atom) {
        (_, "C") if residues::is_amino_acid(residue) => Trigonal,
        ("ASN" | "ASP" | "ASH", "CG") | ("GLN" | "GLU" | "GLH", "CD") => Trigonal,
        ("ARG", "CZ") | ("PHE", "CG") | ("TYR" | "PTR", "CG" | "CZ") => Trigonal,
        ("TRP", "CG" | "CD2" | "CE2") => Trigonal,
        ("PHE", "CD1" | "CD2" | "CE1" | "CE2" | "CZ") => TrigonalH,
        ("TYR" | "PTR", "CD1" | "CD2" | "CE1" | "CE2") => TrigonalH,
        ("TRP", "CD1" | "CE3" | "CZ2" | "CZ3" | "CH2") => TrigonalH,
        ("HIS" | "HID" | "HIE" | "HIP" | "HSD" | "HSE" | "HSP", "CG") => Trigonal,
        ("HIS" | "HID" | "HIE" | "HIP" | "HSD" | "HSE" | "HSP", "CD2" | "CE1") => TrigonalH,
        _ => Tetrahedral,
    }
}

/// Radius of the ball with the mean volume of a residue, Å, for models that keep one atom of each
/// (Cα or P): Zamyatnin 1972 (Prog. Biophys. Mol. Biol. 24, 107) for amino acids, Voss & Gerstein
/// 2005 (J. Mol. Biol. 346, 477) for nucleotides. Unknown residues get the mean.
pub fn residue_radius(residue: Name) -> f64 {
    let volume = match residue.as_str() {
        "ALA" => 88.6,
        "ARG" => 173.4,
        "ASN" => 114.1,
        "ASP" | "ASH" | "ASX" => 111.1,
        "CYS" | "CYX" | "CYM" => 108.5,
        "GLN" => 143.8,
        "GLU" | "GLH" | "GLX" => 138.4,
        "GLY" => 60.1,
        "HIS" | "HID" | "HIE" | "HIP" | "HSD" | "HSE" | "HSP" => 153.2,
        "ILE" | "LEU" => 166.7,
        "LYS" | "LYN" => 168.6,
        "MET" | "MSE" => 162.9,
        "PHE" => 189.9,
        "PRO" | "HYP" => 112.7,
        "SER" => 89.0,
        "THR" => 116.1,
        "TRP" => 227.8,
        "TYR" => 193.6,
        "VAL" => 140.0,
        "A" | "DA" | "RA" | "ADE" => 315.4,
        "C" | "DC" | "RC" | "CYT" => 291.3,
        "G" | "DG" | "RG" | "GUA" => 322.0,
        "U" | "T" | "DT" | "RU" | "URA" | "THY" => 286.3,
        _ if residues::is_nucleotide(residue) => 303.8,
        _ => 137.0,
    };
    (volume * 3.0 / (4.0 * std::f64::consts::PI)).cbrt()
}
