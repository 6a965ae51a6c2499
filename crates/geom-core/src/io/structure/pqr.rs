//! PQR: rows like those of the PDB format but separated by blanks, with charge and radius at the end.
//!
//! Programs for electrostatics in solution (PDB2PQR, APBS) exchange prepared molecules this way: hydrogens added, a charge in
//! units of e and a radius in Å for every atom from a force field. What a surface is made of is thus said by the file, and
//! [`Radii::File`](super::Radii::File) takes it.
//!
//! `ATOM serial name residue [chain] number x y z charge radius`
//!
//! Written files say where a domain (a model, or a copy of an assembly) begins in a remark that
//! other programs skip, so that reading them gives the same structure again.

use std::io::Write;
use std::path::Path;

use super::Models;
use super::names;
use super::record::{ModelCounter, Record, Records, is_atom, number, wanted};
use crate::io::{Error, ErrorKind, save as save_file};
use crate::structure::{Atom, Name, Residue, ResidueKind, residues};
use crate::{Point3, Structure};

/// Announces a domain in files that we write; then model and copy.
const DOMAIN: &str = "REMARK   6 DOMAIN";

/// No atom is larger; a B factor, which PDB files have in the place of the radius, is.
const LARGE_RADIUS: f64 = 6.0;

/// Most words that a row can have.
const MAX_WORDS: usize = 14;

/// Reads all atoms of the wanted models.
///
/// Rows are read by words, from their ends: the last five are numbers, and what precedes them names the atom. That is
/// how rows with and without a chain are told apart.
pub(super) fn parse(content: &[u8], models: Models) -> Result<Records, Error> {
    let mut found = Records {
        has_radii: true,
        ..Records::default()
    };
    let mut counter = ModelCounter::default();
    let mut domain = None;
    let mut numbers: Vec<u32> = Vec::new();
    let mut segment = 0;
    let mut width = 0;
    let mut lines = content.split(|&b| b == b'\n').enumerate().peekable();
    while let Some((i, line)) = lines.next() {
        let last = lines.peek().is_none();
        let line = line.trim_ascii_end();
        // A last row that is cut off, or shorter than those before, shows that the file was.
        let begun = !line.is_empty() && (b"ATOM".starts_with(line) || b"HETATM".starts_with(line));
        if last && (begun || (is_atom(line) && line.len() < width)) {
            let what = "an atom record (no end of line)".to_owned();
            return Err(Error::at_line(ErrorKind::Truncated(what), i + 1));
        }
        // Files of ours name model and copy in a remark before the atoms of each.
        if let Some(rest) = line.strip_prefix(DOMAIN.as_bytes()) {
            let mut words = words(rest).map(|w| std::str::from_utf8(w).ok()?.parse::<u32>().ok());
            domain = words.next().flatten().zip(words.next().flatten());
            if let Some((model, copy)) = domain {
                if numbers.last() != Some(&model) {
                    numbers.push(model);
                }
                if wanted(models, model, numbers.len() - 1) {
                    found.domains.push((model, copy));
                }
            }
            segment = 0;
        } else if is_atom(line) {
            // Other files have records of models, or none; each model is a domain.
            width = line.len();
            let keep = match domain {
                Some((model, _)) => wanted(models, model, numbers.len() - 1),
                None => {
                    let (keep, first) = counter.atom(models);
                    if let (true, Some(model)) = (keep, first) {
                        found.domains.push((model, 1));
                        segment = 0;
                    }
                    keep
                }
            };
            if keep {
                let record = atom(line, segment, &mut found);
                found
                    .records
                    .push(record.map_err(|kind| Error::at_line(kind, i + 1))?);
            }
        } else if line.starts_with(b"TER") {
            segment += 1;
        } else if line.starts_with(b"MODEL") {
            let number = words(&line[5..])
                .next()
                .and_then(|w| std::str::from_utf8(w).ok());
            counter.next(number.and_then(|n| n.parse().ok()));
        } else if line.starts_with(b"END") {
            counter.next(None);
        }
    }
    // Charge and radius are easily swapped, and no format says which is which.
    found.models = counter.count.max(numbers.len());
    let largest = found.records.iter().map(|r| r.atom.radius);
    let largest = largest.fold(0.0, f64::max);
    if largest > LARGE_RADIUS {
        found.warnings.push(format!(
            "the largest radius is {largest} Å: are the last two numbers of a row charge and radius?"
        ));
    }
    elements(&mut found.records);
    Ok(found)
}

fn words(line: &[u8]) -> impl Iterator<Item = &[u8]> {
    line.split(u8::is_ascii_whitespace)
        .filter(|w| !w.is_empty())
}

/// `segment`: how many `TER` came before in this domain, which separate chains that have no name.
///
/// Refuses fewer words than a row needs, numbers that are not finite, and a negative radius.
fn atom(line: &[u8], segment: u32, found: &mut Records) -> Result<Record, ErrorKind> {
    let wrong = |expected: &str| ErrorKind::expected(expected, String::from_utf8_lossy(line));
    let mut all: [&[u8]; MAX_WORDS] = [b""; MAX_WORDS];
    let mut count = 0;
    for word in words(line) {
        // Columns of eight characters touch from −100 on: `-12.345-123.456`.
        for number in split_glued(word) {
            if count < MAX_WORDS {
                all[count] = number;
                count += 1;
            }
        }
    }
    let mut fields = &all[..count];
    // Serial numbers may touch the record's name; some programs add a segment or element at the end.
    let touching = fields[0].len() > 6 || (fields[0].len() > 4 && line[0] == b'A');
    if let [rest @ .., last] = fields
        && rest.len() >= 10
        && last[0].is_ascii_alphabetic()
    {
        fields = rest;
    }
    let start = if touching { 1 } else { 2 };
    if fields.len() < start + 8 {
        return Err(wrong(
            "ATOM, serial, name, residue, [chain,] number, x, y, z, charge, radius",
        ));
    }
    // The last five are numbers; what stands before names the residue.
    let (identity, numbers) = fields[start..].split_at(fields.len() - start - 5);
    let mut values = [0.0; 5];
    for (value, field) in values.iter_mut().zip(numbers) {
        *value = number(field).ok_or_else(|| {
            let field = String::from_utf8_lossy(field);
            ErrorKind::expected("x, y, z, charge and radius, all finite", field)
        })?;
    }
    let [x, y, z, charge, radius] = values;
    if radius < 0.0 {
        return Err(ErrorKind::expected(
            "a radius of 0 or more",
            radius.to_string(),
        ));
    }
    let name =
        |field| Name::from_bytes(field).ok_or_else(|| wrong("names of at most eight characters"));
    // With or without a chain, glued to the number or not, and perhaps with an insertion code.
    let (chain, sequence, insertion): (&[u8], &[u8], &[u8]) = match *identity {
        [_, _, place] => glued(place),
        [_, _, chain, place] => (chain, place, b""),
        [_, _, chain, place, insertion] if insertion.len() == 1 => (chain, place, insertion),
        _ => return Err(wrong("name, residue, [chain,] number before x, y, z")),
    };
    let digits = sequence
        .iter()
        .rposition(u8::is_ascii_digit)
        .map_or(0, |i| i + 1);
    let parsed = std::str::from_utf8(&sequence[..digits])
        .ok()
        .and_then(|n| n.parse().ok());
    let Some(sequence_number) = parsed else {
        let found = String::from_utf8_lossy(sequence);
        return Err(ErrorKind::expected("a residue number", found));
    };
    // The insertion code may also stand behind the digits.
    let insertion = name(if insertion.is_empty() {
        &sequence[digits..]
    } else {
        insertion
    })?;
    let chain_name = name(chain)?;
    let residue = name(identity[1])?;
    Ok(Record {
        atom: Atom {
            position: Point3::new(x, y, z),
            radius,
            charge: charge as f32,
            b_factor: 0.0,
            name: name(identity[0])?,
            element: Default::default(),
            hetero: line[0] == b'H',
        },
        residue: Residue {
            name: residue,
            number: sequence_number,
            insertion,
            kind: match names::is_lipid(residue)
                || (line[0] == b'H' && !residues::is_polymer(residue))
            {
                true => ResidueKind::Ligand,
                false => ResidueKind::Polymer,
            },
        },
        sequence: 0,
        chain: match chain_name.is_empty() {
            true => found.chains.unnamed(segment),
            false => found.chains.index(chain),
        },
        part: found.parts.index(chain),
        domain: found.domains.len() as u32 - 1,
        altloc: b' ',
        occupancy: 1.0,
    })
}

/// Decimal numbers that only a sign separates, and any other word as it is.
fn split_glued(word: &[u8]) -> impl Iterator<Item = &[u8]> {
    let numbers = word.iter().all(|b| b.is_ascii_digit() || b".-".contains(b));
    let decimals = numbers && word.iter().filter(|b| **b == b'.').count() > 1;
    word.chunk_by(move |_, next| !decimals || *next != b'-')
}

/// A chain that touches the residue number: `A1000`; without a chain, just the number.
///
/// Chain, number, insertion code.
fn glued(place: &[u8]) -> (&[u8], &[u8], &[u8]) {
    match place {
        [chain, rest @ ..] if chain.is_ascii_alphabetic() && !rest.is_empty() => {
            (&place[..1], rest, b"")
        }
        _ => (b"", place, b""),
    }
}

/// Elements follow from the names, which PQR files do not align.
fn elements(records: &mut [Record]) {
    let place = |r: &Record| (r.domain, r.chain, r.residue.number, r.residue.name);
    for i in 0..records.len() {
        let r = &records[i];
        let neighbours = [i.checked_sub(1), Some(i + 1)];
        let mut neighbours = neighbours.iter().flatten().filter_map(|&n| records.get(n));
        let alone = neighbours.all(|n| place(n) != place(r));
        records[i].atom.element = names::element_of(r.atom.name, r.residue.name, alone, None);
    }
}

/// Writes a structure; positions, charges and radii with four decimals.
///
/// Read again with [`Models::All`] it has the same domains, chains and residues, but for chains of one name in one
/// domain, which become one. Positions, charges and radii are rounded to 10⁻⁴, B factors are gone, and elements follow
/// from names. An atom or a residue without a name is called `X`, since a field cannot be empty. Fields are separated
/// by blanks, so that long names and numbers shift a row but never touch.
///
/// # Errors
/// Only what the writer gives.
pub fn write(structure: &Structure, mut w: impl Write) -> Result<(), Error> {
    let mut serial = 0u64;
    for (d, domain) in structure.domains().iter().enumerate() {
        writeln!(w, "{DOMAIN} {} {}", domain.model, domain.copy)?;
        for c in structure.domain_chains(d) {
            let chain = structure.chains()[c].name;
            for r in structure.chain_residues(c) {
                let residue = structure.residues()[r];
                let place = format!("{}{}", residue.number, residue.insertion);
                for atom in &structure.atoms()[structure.residue_atoms(r)] {
                    serial += 1;
                    let record = if atom.hetero { "HETATM" } else { "ATOM" };
                    let p = atom.position;
                    writeln!(
                        w,
                        "{record:<6} {serial:>5} {:<4} {:<4} {chain:<1} {place:>5} {:>9.4} {:>9.4} \
                         {:>9.4} {:>8.4} {:>7.4}",
                        placeholder(&atom.name),
                        placeholder(&residue.name),
                        p.x,
                        p.y,
                        p.z,
                        atom.charge,
                        atom.radius
                    )?;
                }
            }
            writeln!(w, "TER")?;
        }
    }
    writeln!(w, "END")?;
    Ok(())
}

/// Fields of a row cannot be empty.
fn placeholder(name: &Name) -> &str {
    if name.is_empty() { "X" } else { name.as_str() }
}

/// Saves a structure as a PQR file.
///
/// Gzip-compressed if the name ends in `.gz`.
pub fn save(path: impl AsRef<Path>, structure: &Structure) -> Result<(), Error> {
    save_file(path, |w| write(structure, w))
}
