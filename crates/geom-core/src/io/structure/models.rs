//! Structures as the models of one mmCIF file: the frames of a morph, of a trajectory. PyMOL and ChimeraX play them.

use std::io::Write;
use std::path::Path;

use crate::io::{Error, save as save_file};
use crate::structure::{Atom, Residue, Structure};

/// Writes structures as models 1, 2, … of an mmCIF file, coordinates with three decimals, as archives have them. Copies of a
/// chain within a structure (of an assembly, of several models) are called `A-2`, `A-3`, …, as archives name them.
///
/// ```
/// use geom_core::io::structure::{self, Format, ReadOptions};
/// let text = b"ATOM      1  CA  ALA A   7       1.000   2.000   3.000  1.00  0.00           C\n";
/// let one = structure::parse(text, Format::Pdb, &ReadOptions::default())?.structure;
/// let mut file = Vec::new();
/// structure::write_models(&[one.clone(), one], &mut file)?;
/// let first = structure::parse(&file, Format::Mmcif, &ReadOptions::default())?.structure;
/// assert_eq!(first.atoms()[0].position.z, 3.0);
/// # Ok::<(), geom_core::io::Error>(())
/// ```
///
/// Kept are positions, names, numbers, insertion codes, elements and B factors (two decimals). Radii, charges and kinds
/// of residues are not: a reader assigns radii anew, and tells kinds by names. An element that is not known is `?`.
/// Structures may differ in their atoms.
///
/// # Errors
/// Only what the writer gives.
pub fn write_models(models: &[Structure], mut w: impl Write) -> Result<(), Error> {
    const ITEMS: [&str; 18] = [
        "group_PDB",
        "id",
        "type_symbol",
        "label_atom_id",
        "label_alt_id",
        "label_comp_id",
        "label_asym_id",
        "label_entity_id",
        "label_seq_id",
        "pdbx_PDB_ins_code",
        "Cartn_x",
        "Cartn_y",
        "Cartn_z",
        "occupancy",
        "B_iso_or_equiv",
        "auth_seq_id",
        "auth_asym_id",
        "pdbx_PDB_model_num",
    ];
    writeln!(w, "data_models\nloop_")?;
    for item in ITEMS {
        writeln!(w, "_atom_site.{item}")?;
    }
    let mut id = 0u64;
    for (structure, model) in models.iter().zip(1..) {
        for d in 0..structure.domains().len() {
            for c in structure.domain_chains(d) {
                let mut chain = structure.chains()[c].name.to_string();
                if d > 0 {
                    chain += &format!("-{}", d + 1);
                }
                let chain = quoted(&chain);
                for r in structure.chain_residues(c) {
                    let residue = &structure.residues()[r];
                    for atom in &structure.atoms()[structure.residue_atoms(r)] {
                        id += 1;
                        row(&mut w, id, atom, residue, &chain, model)?;
                    }
                }
            }
        }
    }
    Ok(writeln!(w, "#")?)
}

/// Saves structures as the models of an mmCIF file: see [`write_models`].
pub fn save_models(path: impl AsRef<Path>, models: &[Structure]) -> Result<(), Error> {
    save_file(path, |w| write_models(models, w))
}

/// Places of sequence (`label_seq_id`) are not known here and are `?`; every atom has one location and is fully
/// occupied.
fn row(
    w: &mut impl Write,
    id: u64,
    atom: &Atom,
    residue: &Residue,
    chain: &str,
    model: usize,
) -> Result<(), Error> {
    let group = if atom.hetero { "HETATM" } else { "ATOM" };
    let symbol = match atom.element.symbol() {
        "X" => "?",
        symbol => symbol,
    };
    let [name, of] = [atom.name, residue.name].map(|n| quoted(&n.to_string()));
    let (number, insertion) = (residue.number, quoted(&residue.insertion.to_string()));
    let p = atom.position;
    Ok(writeln!(
        w,
        "{group:<6} {id} {symbol} {name} . {of} {chain} ? {number} {insertion} {:.3} {:.3} {:.3} 1.00 {:.2} {number} {chain} {model}",
        p.x, p.y, p.z, atom.b_factor
    )?)
}

/// A value of a STAR file: `?` for none, in quotes where it would be read as something else.
fn quoted(text: &str) -> String {
    let special = text.starts_with(['_', '#', '$', '[', ']', ';', '.', '?'])
        || text.contains(['\'', '"', ' '])
        || ["loop_", "stop_", "data_", "save_", "global_"]
            .iter()
            .any(|word| text.to_ascii_lowercase().starts_with(word));
    match text {
        "" => "?".to_owned(),
        _ if !special => text.to_owned(),
        _ if text.contains('"') => format!("'{text}'"),
        _ => format!("\"{text}\""),
    }
}
