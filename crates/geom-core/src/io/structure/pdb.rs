//! The PDB format, read by columns, with the deviations that files in use have.
//!
//! | columns of `ATOM`, `HETATM` | hold |
//! |---|---|
//! | 7–11 | serial number: not read |
//! | 13–16 | atom name; an element of one letter stands in column 14 |
//! | 17 | alternate location |
//! | 18–20 | residue name |
//! | 22, or 21–22 | chain |
//! | 23–26, 27 | residue number and insertion code |
//! | 31–38, 39–46, 47–54 | x, y, z, Å |
//! | 55–60, 61–66 | occupancy and B factor, Å² |
//! | 73–76 | segment, or what old files have there |
//! | 77–78 | element |
//!
//! Beside atoms these records count: `MODEL` and `ENDMDL`; `TER`, `SEQRES` and `MODRES`, by which residues of the polymer are told
//! from ligands; `REMARK 350` with its `BIOMT` rows, the assemblies; `MASTER`, which promises a number of atoms; and
//! `END`, without which an entry may have been cut off.
//!
//! * Serial numbers are not read: beyond 99,999 they are hybrid-36, hexadecimal or shift the row.
//! * Residue numbers may be decimal with five digits, hybrid-36 or hexadecimal.
//! * Chains may have two characters (columns 21–22); without any, the segment (columns 73–76) or
//!   `TER` tells chains apart.
//! * Columns 73–80 may hold the entry's name and a line number (before 1996).
//! * Without an element column the element follows from atom and residue names, whether the names
//!   are aligned as the format says or not.
//! * `BIOMT` operators may have numbers of more than three digits.

use std::collections::BTreeSet;

use super::Models;
use super::assembly::{Assembly, Generator, Operators};
use super::names;
use super::record::{ModelCounter, Record, Records, is_atom, number};
use crate::io::{Error, ErrorKind};
use crate::structure::{Atom, Element, Name, Residue, ResidueKind, Transform, residues};
use crate::{Point3, Vector3};

/// Is this PDB (`Some(true)`) or PQR (`Some(false)`)? `None` if the content has no atoms.
///
/// Only the first atom is looked at. A PQR row that keeps to the columns of PDB for coordinates, and has its charge
/// right behind them with four decimals, has the dot of an occupancy, too; but where a B factor has its dot, the radius
/// has a digit.
pub(super) fn looks_like(content: &[u8]) -> Option<bool> {
    let lines = content.split(|&b| b == b'\n');
    let first = lines.map(<[u8]>::trim_ascii_end).find(|l| is_atom(l))?;
    let dots = [34, 42, 50].iter().all(|&c| first.get(c) == Some(&b'.'));
    let occupancy = first.get(57).is_none_or(|&b| b == b'.');
    let b_factor = first.get(63).is_none_or(|&b| b == b'.' || b == b' ');
    Some(dots && occupancy && b_factor && coordinates(first, 0).is_some())
}

/// Has the first atom occupancy, B factor and element in their columns, as only PDB files do?
pub(super) fn has_elements(content: &[u8]) -> bool {
    let mut lines = content.split(|&b| b == b'\n');
    lines.find(|l| is_atom(l)).is_some_and(|first| {
        let dots = [34, 42, 50, 57, 63]
            .iter()
            .all(|&c| first.get(c) == Some(&b'.'));
        dots && Element::from_symbol(text(first, 76, 78)).is_some()
    })
}

/// Reads all atoms of the wanted models and the assemblies.
///
/// Line by line; what only the whole file tells is told in the end. A file that ends right behind its atoms, without
/// `END` or any other record, is refused if it has a HEADER and a sequence, as entries of the archive do, which always
/// end with `END`; with a HEADER alone it is a warning.
pub(super) fn parse(content: &[u8], models: Models) -> Result<Records, Error> {
    let mut reader = Reader::default();
    let mut found = Records::default();
    let whole = content.ends_with(b"\n");
    let mut end = 0;
    let mut lines = content.split(|&b| b == b'\n').enumerate().peekable();
    while let Some((i, line)) = lines.next() {
        let line = line.strip_suffix(b"\r").unwrap_or(line);
        let last = lines.peek().is_none() && !whole;
        reader
            .line(line, last, models, &mut found)
            .map_err(|kind| Error::at_line(kind, i + 1))?;
        if !line.is_empty() {
            end = i + 1;
        }
    }
    if reader.header && reader.in_atoms && reader.models.count > 0 {
        // Entries of the archive have a sequence; what other programs write may lack END.
        if !reader.sequence.is_empty() {
            let rest = "its atoms: an entry ends with END (add it if the file is whole)";
            return Err(Error::at_line(ErrorKind::Truncated(rest.to_owned()), end));
        }
        let doubt = "the file has a HEADER, but no END: is it whole?";
        found.warnings.push(doubt.to_owned());
    }
    if reader.atoms > 0 && reader.rows != 0 {
        let what = "a BIOMT operator".to_owned();
        return Err(Error::at_line(ErrorKind::Truncated(what), end));
    }
    if let Some(promised) = reader.promised
        && reader.models.count == 1
        && promised != reader.atoms
    {
        let atoms = reader.atoms;
        found.warnings.push(format!(
            "MASTER promises {promised} atoms, the file has {atoms}"
        ));
    }
    found.models = reader.models.count;
    reader.finish(&mut found);
    Ok(found)
}

/// What the records before tell of the next ones.
#[derive(Default)]
struct Reader {
    models: ModelCounter,
    header: bool,
    /// Was the last record a coordinate record?
    in_atoms: bool,
    atoms: usize,
    promised: Option<usize>,
    /// Number of `TER` records in this model, which separate chains without a name.
    segment: u32,
    /// Bytes of the last atom's row: a last row that is shorter was cut off.
    width: usize,
    /// Names of residues in SEQRES, and in MODRES; both without chains, which suffices to tell polymers from ligands.
    sequence: BTreeSet<Name>,
    modified: BTreeSet<Name>,
    /// Records without an element and the column where their names begin.
    unresolved: Vec<(usize, u8)>,
    /// Rows of a BIOMT operator so far, and its number.
    rows: usize,
    operator: Transform,
    operator_name: Vec<u8>,
    /// Was the last row of REMARK 350 one of chains, which goes on with `AND CHAINS:`?
    chain_list: bool,
}

impl Reader {
    /// One row. `last`: it is the last one and has no line end, so that it may have been cut off.
    fn line(
        &mut self,
        line: &[u8],
        last: bool,
        models: Models,
        found: &mut Records,
    ) -> Result<(), ErrorKind> {
        if is_atom(line) {
            if last && (line.len() < 54 || line.len() < self.width) {
                return Err(ErrorKind::Truncated("an atom record".to_owned()));
            }
            self.width = line.len();
            self.atoms += 1;
            self.in_atoms = true;
            let (keep, first) = self.models.atom(models);
            if first.is_some() {
                self.segment = 0;
            }
            if !keep {
                return Ok(());
            }
            if let Some(number) = first {
                found.domains.push((number, 1));
            }
            return self.atom(line, found);
        }
        if last && !line.is_empty() && (b"ATOM".starts_with(line) || b"HETATM".starts_with(line)) {
            return Err(ErrorKind::Truncated("an atom record".to_owned()));
        }
        let is = |record: &[u8]| line.starts_with(record);
        let coordinates = is(b"ANISOU") || is(b"SIGATM") || is(b"SIGUIJ");
        self.in_atoms &= coordinates || line.trim_ascii().is_empty();
        if is(b"REMARK 350") {
            return self.biomolecule(line, found);
        }
        if is(b"MODEL ") {
            self.models.next(text(line, 6, line.len()).parse().ok());
        } else if is(b"ENDMDL") || line.trim_ascii_end() == b"END" {
            self.models.next(None);
        } else if is(b"TER") {
            self.segment += 1;
        } else if is(b"HEADER") {
            self.header = true;
        } else if is(b"SEQRES") {
            let names = text(line, 19, line.len()).split_whitespace();
            self.sequence.extend(names.filter_map(Name::new));
        } else if is(b"MODRES") {
            self.modified.extend(Name::new(text(line, 12, 15)));
        } else if is(b"MASTER") {
            self.promised = text(line, 50, 55).parse().ok();
        }
        Ok(())
    }

    /// A row of coordinates. Of names and numbers nothing is guessed that stands in its columns; elements without a
    /// column wait until the whole file is known.
    fn atom(&mut self, line: &[u8], found: &mut Records) -> Result<(), ErrorKind> {
        // Six-digit serial numbers push the rest of the row to the right.
        let shifted = line.get(34) != Some(&b'.') && line.get(35) == Some(&b'.');
        let s = usize::from(shifted && line.get(11).is_some_and(u8::is_ascii_digit));
        let Some([x, y, z]) = coordinates(line, s) else {
            return Err(ErrorKind::expected(
                "finite coordinates in columns 31–54",
                String::from_utf8_lossy(line.get(30..).unwrap_or(line).trim_ascii_end()),
            ));
        };
        let name = atom_name(&line[12 + s..16 + s])?;
        let (residue, chain) = residue_and_chain(line, s)?;
        let (number, insertion) = residue_number(line, s)?;
        let hetero = line[0] == b'H';
        let element = names::element_in_file(text(line, 76 + s, 78 + s));
        let segment = text(line, 72 + s, 76 + s);
        let card = text(line, 76 + s, 80 + s);
        let legacy = !card.is_empty() && card.bytes().all(|b| b.is_ascii_digit());
        let chain_index = if !chain.is_empty() {
            found.chains.index(chain.as_str().as_bytes())
        } else if !segment.is_empty() && !legacy {
            found.chains.index(segment.as_bytes())
        } else {
            found.chains.unnamed(self.segment)
        };
        if element.is_none() {
            let column = line[12 + s..].iter().position(|&b| b != b' ').unwrap_or(0);
            self.unresolved.push((found.records.len(), column as u8));
        }
        let optional = |from: usize, to: usize| number_in(line, from + s, to + s);
        found.records.push(Record {
            atom: Atom {
                position: Point3::new(x, y, z),
                radius: 0.0,
                charge: 0.0,
                b_factor: optional(60, 66).unwrap_or(0.0) as f32,
                name,
                element: element.unwrap_or_default(),
                hetero,
            },
            residue: Residue {
                name: residue,
                number,
                insertion,
                kind: ResidueKind::Polymer,
            },
            sequence: 0,
            chain: chain_index,
            part: found.parts.index(chain.as_str().as_bytes()),
            domain: found.domains.len() as u32 - 1,
            altloc: line[16 + s],
            occupancy: optional(54, 60).unwrap_or(1.0) as f32,
        });
        Ok(())
    }

    /// `REMARK 350`: assemblies, the chains of generators, and rows of operators.
    fn biomolecule(&mut self, line: &[u8], found: &mut Records) -> Result<(), ErrorKind> {
        let text = text(line, 10, line.len());
        let assemblies = &mut found.assemblies;
        // A new assembly begins; its chains and operators follow.
        if let Some((_, name)) = text.split_once("BIOMOLECULE:") {
            self.chain_list = false;
            assemblies.push(Assembly {
                name: name.trim().to_owned(),
                generators: Vec::new(),
            });
        } else if let Some((_, list)) = text.split_once("CHAINS:") {
            // A list of chains, perhaps over several rows, is the first half of a generator.
            let assembly = last_assembly(assemblies);
            if !(self.chain_list && text.starts_with("AND")) {
                assembly.generators.push(Generator {
                    parts: Some(Vec::new()),
                    operators: Operators::List(Vec::new()),
                });
            }
            self.chain_list = true;
            let parts = assembly
                .generators
                .last_mut()
                .and_then(|g| g.parts.as_mut());
            let names = list.split([',', ' ']).filter(|n| !n.is_empty());
            let names = names.map(|n| if n == "NULL" { "" } else { n });
            parts
                .into_iter()
                .for_each(|p| p.extend(names.clone().map(|n| n.as_bytes().to_vec())));
        } else if let Some(row) = text.strip_prefix("BIOMT") {
            self.chain_list = false;
            let wrong = || ErrorKind::expected("BIOMT, number, three factors and a shift", text);
            // `BIOMT1   1 …`, and with four digits `BIOMT11000 …`.
            let mut words = row.get(1..).ok_or_else(wrong)?.split_ascii_whitespace();
            let index = (row.as_bytes()[0].wrapping_sub(b'1')) as usize;
            let name = words.next().ok_or_else(wrong)?.as_bytes().to_vec();
            let mut values = [0.0; 4];
            for value in &mut values {
                *value = words
                    .next()
                    .and_then(|w| number(w.as_bytes()))
                    .ok_or_else(wrong)?;
            }
            // The three rows of an operator follow each other and bear one name.
            let follows = index == self.rows && (index == 0 || name == self.operator_name);
            if !follows || words.next().is_some() {
                return Err(wrong());
            }
            if index == 0 {
                self.operator = Transform::identity();
                self.operator_name = name;
            }
            for (column, value) in values[..3].iter().enumerate() {
                self.operator.rotation[(index, column)] = *value;
            }
            self.operator.translation += Vector3::ith(index, values[3]);
            self.rows = (index + 1) % 3;
            // With the third row it is whole, and belongs to the chains named last, or to all.
            if self.rows == 0 {
                let generators = &mut last_assembly(assemblies).generators;
                if generators.is_empty() {
                    generators.push(Generator {
                        parts: None,
                        operators: Operators::List(Vec::new()),
                    });
                }
                if let Some(Operators::List(list)) = generators.last_mut().map(|g| &mut g.operators)
                {
                    list.push(self.operator);
                }
            }
        }
        Ok(())
    }

    /// What only the whole file tells: elements without a column, and which hetero residues are
    /// part of a polymer.
    fn finish(self, found: &mut Records) {
        let records = &mut found.records;
        for r in records.iter_mut() {
            let name = r.residue.name;
            let in_polymer = if self.sequence.is_empty() {
                residues::is_polymer(name)
            } else {
                self.sequence.contains(&name)
            };
            let ligand = match r.atom.hetero {
                true => !in_polymer && !self.modified.contains(&name),
                false => names::is_lipid(name),
            };
            if ligand {
                r.residue.kind = ResidueKind::Ligand;
            }
        }
        // Names of one letter more than the element begin in the second column, `" CA "`.
        let mut begins = [0, 0];
        for &(i, column) in &self.unresolved {
            let name = records[i].atom.name.as_str();
            let letter = name.bytes().next().is_some_and(|b| b.is_ascii_alphabetic());
            let standard = residues::is_polymer(records[i].residue.name);
            if standard && letter && name.len() < 4 && column < 2 {
                begins[column as usize] += 1;
            }
        }
        let aligned = begins[0] <= begins[1];
        let place = |r: &Record| (r.domain, r.chain, r.residue.number, r.residue.name);
        for &(i, column) in &self.unresolved {
            let r = &records[i];
            let neighbours = [i.checked_sub(1), Some(i + 1)];
            let mut neighbours = neighbours.iter().flatten().filter_map(|&n| records.get(n));
            let alone = neighbours.all(|n| place(n) != place(r));
            let column = aligned.then_some(column);
            let element = names::element_of(r.atom.name, r.residue.name, alone, column);
            records[i].atom.element = element;
        }
    }
}

/// The assembly that a line belongs to; files without a `BIOMOLECULE` line have one named 1.
fn last_assembly(assemblies: &mut Vec<Assembly>) -> &mut Assembly {
    if assemblies.is_empty() {
        assemblies.push(Assembly {
            name: "1".to_owned(),
            generators: Vec::new(),
        });
    }
    assemblies.last_mut().expect("at least one")
}

/// `None` if one of the three is no finite number, or the row is too short. `shift`: columns by which the row is moved.
fn coordinates(line: &[u8], shift: usize) -> Option<[f64; 3]> {
    let field = |from: usize| number_in(line, from + shift, from + 8 + shift);
    // A row that ends inside the last field has lost digits.
    (line.len() >= 54 + shift).then_some(())?;
    Some([field(30)?, field(38)?, field(46)?])
}

/// Columns from 0, `from..to`; `None` if the field is blank, no number, or beyond the row.
fn number_in(line: &[u8], from: usize, to: usize) -> Option<f64> {
    number(line.get(from..to.min(line.len()))?)
}

/// A field as text without the blanks around it; empty beyond the end of the row or if it is not text.
fn text(line: &[u8], from: usize, to: usize) -> &str {
    let field = line.get(from..to.min(line.len())).unwrap_or_default();
    std::str::from_utf8(field.trim_ascii()).unwrap_or_default()
}

/// Columns from 0, `from..to`, which the row must have.
fn name(line: &[u8], from: usize, to: usize, expected: &str) -> Result<Name, ErrorKind> {
    let field = &line[from..to];
    Name::from_bytes(field)
        .ok_or_else(|| ErrorKind::expected(expected, String::from_utf8_lossy(field)))
}

/// Columns 13–16; some programs leave blanks inside a name.
fn atom_name(field: &[u8]) -> Result<Name, ErrorKind> {
    let whole = Name::from_bytes(field);
    let joined = || {
        let letters: Vec<u8> = field.iter().copied().filter(|b| *b != b' ').collect();
        Name::from_bytes(&letters)
    };
    whole.or_else(joined).ok_or_else(|| {
        let found = String::from_utf8_lossy(field);
        ErrorKind::expected("an atom name in columns 13–16", found)
    })
}

/// Columns 18–20 and 22; column 21 belongs to a name of four letters or a chain of two characters.
fn residue_and_chain(line: &[u8], s: usize) -> Result<(Name, Name), ErrorKind> {
    let residue = |to| name(line, 17 + s, to + s, "a residue name in columns 18–20");
    let chain = |from| name(line, from + s, 22 + s, "a chain in column 22");
    if line[20 + s] == b' ' {
        return Ok((residue(20)?, chain(21)?));
    }
    let short = residue(20)?;
    // `MG A` is no name: two characters of a chain.
    let long = residue(21).ok().filter(|long| {
        line[21 + s] == b' ' || (!residues::is_polymer(short) && names::has_four_letters(*long))
    });
    match long {
        Some(long) => Ok((long, chain(21)?)),
        None => Ok((short, chain(20)?)),
    }
}

/// Columns 23–26 and the insertion code in 27.
///
/// Beyond 9999 programs count on in four ways: into column 27, in hybrid-36, in hexadecimal digits, or from 0 again.
/// `A000` is 10,000 in the second and 40,960 in the third; it is read as the second, which is a standard. A blank field
/// is 0.
fn residue_number(line: &[u8], s: usize) -> Result<(i32, Name), ErrorKind> {
    let field = text(line, 22 + s, 26 + s);
    let insertion = line[26 + s];
    if insertion.is_ascii_digit()
        && field.len() == 4
        && let Ok(number) = text(line, 22 + s, 27 + s).parse()
    {
        return Ok((number, Name::default()));
    }
    let insertion = name(line, 26 + s, 27 + s, "an insertion code in column 27")?;
    let number = match field.parse() {
        Ok(number) => Some(number),
        Err(_) if field.is_empty() => Some(0),
        // Some programs count on in hexadecimal digits.
        Err(_) => hybrid_36(field).or_else(|| i32::from_str_radix(field, 16).ok()),
    };
    number
        .map(|n| (n, insertion))
        .ok_or_else(|| ErrorKind::expected("a residue number in columns 23–26", field))
}

/// Hybrid-36 numbers of four characters: `A000` is 10,000, `a000` follows `ZZZZ`.
///
/// After Grosse-Kunstleve (cctbx): digits of base 36 in one case, of which those that begin with a letter follow the
/// decimal numbers; `None` for decimal ones.
pub(super) fn hybrid_36(field: &str) -> Option<i32> {
    if field.len() != 4 {
        return None;
    }
    let upper = field
        .bytes()
        .all(|b| b.is_ascii_digit() || b.is_ascii_uppercase());
    let lower = field
        .bytes()
        .all(|b| b.is_ascii_digit() || b.is_ascii_lowercase());
    let value = i32::from_str_radix(field, 36).ok()?;
    match field.as_bytes()[0] {
        b'A'..=b'Z' if upper => Some(value - 10 * 36i32.pow(3) + 10_000),
        b'a'..=b'z' if lower => Some(value + 16 * 36i32.pow(3) + 10_000),
        _ => None,
    }
}
