//! Molecular structures from PDB, mmCIF and PQR files, each also gzip-compressed.
//!
//! The readers of the formats only say what stands in a file; what is kept of it is decided here,
//! once for all formats.
//!
//! Files in use deviate from their formats, and are read nevertheless:
//!
//! * **PDB**: serial numbers beyond 99,999 (hybrid-36, hexadecimal, or shifting the row); chains of
//!   two characters, or none but segments or `TER`; columns 73–80 from before 1996; names without
//!   an element column, aligned or not (CHARMM); `BIOMT` operators numbered beyond 999; models
//!   without `MODEL`; chains and residues whose rows take turns.
//! * **mmCIF**: categories in any order, single items or loops, any number of data blocks (the first
//!   with atoms counts); author's names where there are any; products of operators as
//!   `(1-60)(61-88)`.
//! * **PQR**: free format, with or without chains, columns that touch.
//!
//! What cannot be read is an [`Error`] with file and line, also a file that was cut off: in the
//! middle of a row, a PDB entry with a sequence but without `END`, or an mmCIF file that marks the
//! ends of its categories with `#`, but not that of its atoms.
//!
//! ```
//! use geom_core::io::structure::{read, ReadOptions};
//! let options = ReadOptions { assembly: Some("1".into()), ..Default::default() };
//! let read = read(fixtures::path("5e5z.pdb"), &options)?;
//! assert_eq!(read.structure.domains().len(), 10);
//! assert_eq!(read.report.waters, 1);
//! # Ok::<(), geom_core::io::Error>(())
//! ```

use std::fmt;
use std::path::Path;

use super::assembly::{Assembly, Copies};
use super::{Error, ErrorKind, mmcif, names, pdb, pqr, read_bytes};
use crate::Structure;
use crate::id::MAX_ELEMENTS;
use crate::structure::{
    Atom, Element, Name, Residue, ResidueKind, Selector, StructureBuilder, residue_radius,
    united_radius,
};

/// What to keep of a file. The default: the first model, one location of each atom, everything but
/// water, as deposited (no assembly), with the file's own radii or those of the elements.
#[derive(Clone, Debug, PartialEq)]
pub struct ReadOptions {
    /// The format; by content and file name if `None`.
    pub format: Option<Format>,
    /// Which models: NMR entries hold many of the same molecule.
    pub models: Models,
    /// Which of an atom's alternate locations.
    pub altlocs: AltLocs,
    /// Keep hydrogens?
    pub hydrogens: bool,
    /// Keep water?
    pub waters: bool,
    /// Keep ions: residues of a single atom that are not water?
    pub ions: bool,
    /// Keep what is neither polymer, ion nor water: ligands, cofactors, lipids, glycans?
    pub ligands: bool,
    /// Keep only this part.
    pub select: Option<Selector>,
    /// Build this assembly, by its name in the file (PDB: number of the biomolecule).
    pub assembly: Option<String>,
    /// Where radii come from.
    pub radii: Radii,
    /// Smaller radii are raised to this, Å. Some PQR files give 0 to some hydrogens.
    pub min_radius: f64,
    /// More atoms than this are refused before they are allocated.
    pub max_atoms: usize,
}

impl Default for ReadOptions {
    fn default() -> Self {
        Self {
            format: None,
            models: Models::First,
            altlocs: AltLocs::Best,
            hydrogens: true,
            waters: false,
            ions: true,
            ligands: true,
            select: None,
            assembly: None,
            radii: Radii::File,
            min_radius: 0.0,
            max_atoms: MAX_ELEMENTS,
        }
    }
}

/// Which models of a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum Models {
    /// The first.
    #[default]
    First,
    /// All, each a domain of its own.
    All,
    /// The one with this number in the file.
    Number(u32),
}

impl std::str::FromStr for Models {
    type Err = String;
    /// `first`, `all` or a number.
    fn from_str(text: &str) -> Result<Self, String> {
        match text {
            "first" => Ok(Self::First),
            "all" => Ok(Self::All),
            number => number
                .parse()
                .map(Self::Number)
                .map_err(|_| format!("expected first, all or a model's number, found {text:?}")),
        }
    }
}

impl fmt::Display for Models {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::First => f.write_str("first"),
            Self::All => f.write_str("all"),
            Self::Number(n) => n.fmt(f),
        }
    }
}

/// Which of the alternate locations of a residue's atoms.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum AltLocs {
    /// Per residue the location with the largest summed occupancy, the first of equal ones; atoms
    /// that it lacks come from the location where they are most occupied.
    #[default]
    Best,
    /// The one with this label in residues that have it, the best elsewhere.
    Label(char),
    /// All, so that density counts more than once there.
    All,
}

/// Where radii come from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Radii {
    /// The file (PQR), or else as [`Elements`](Self::Elements).
    #[default]
    File,
    /// Van der Waals radii of the elements: [`Element::vdw_radius`].
    Elements,
    /// Heavy atoms with the hydrogens they carry: [`united_radius`]. Hydrogens are dropped.
    United,
}

/// The format of a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Format {
    /// Protein Data Bank format, columns.
    Pdb,
    /// Macromolecular Crystallographic Information File.
    Mmcif,
    /// PDB-like, whitespace-separated, with charge and radius.
    Pqr,
}

impl Format {
    /// The format of this content: mmCIF by its first word, PDB and PQR by the file's extension
    /// (before `.gz`) or, if it says nothing, by the first atom.
    pub fn detect(content: &[u8], file_name: Option<&Path>) -> Result<Self, Error> {
        let content = content.strip_prefix(BYTE_ORDER_MARK).unwrap_or(content);
        if mmcif::looks_like(content) {
            return Ok(Self::Mmcif);
        }
        let name = file_name.and_then(Path::file_name).unwrap_or_default();
        let name = name.to_string_lossy().to_ascii_lowercase();
        let stem = name.strip_suffix(".gz").unwrap_or(&name);
        match stem.rsplit_once('.').map(|(_, e)| e) {
            Some("pqr") if pdb::has_elements(content) => Err(ErrorKind::expected(
                "rows that end with charge and radius in a PQR file",
                "the columns of a PDB file (rename it to .pdb)",
            )
            .into()),
            Some("pqr") => Ok(Self::Pqr),
            Some("cif" | "mmcif") => Ok(Self::Mmcif),
            Some("bcif" | "mmtf" | "bcif2") => Err(ErrorKind::Unsupported(
                "binary structure files are not read: use the mmCIF file".into(),
            )
            .into()),
            Some("pdb" | "ent" | "pdb1") => Ok(Self::Pdb),
            _ => match pdb::looks_like(content) {
                Some(true) => Ok(Self::Pdb),
                Some(false) => Ok(Self::Pqr),
                None => Err(ErrorKind::expected(
                    "a PDB, mmCIF or PQR file",
                    String::from_utf8_lossy(content.split(|&b| b == b'\n').next().unwrap_or(b"")),
                )
                .into()),
            },
        }
    }
}

impl fmt::Display for Format {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Pdb => "PDB",
            Self::Mmcif => "mmCIF",
            Self::Pqr => "PQR",
        })
    }
}

/// A structure and what was done to get it.
#[derive(Clone, Debug, PartialEq)]
pub struct ReadStructure {
    /// The atoms.
    pub structure: Structure,
    /// What stood in the file and what was left out.
    pub report: ReadReport,
}

/// What stood in a file and what was left out of it.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct ReadReport {
    /// The format that was read.
    pub format: Format,
    /// Number of models in the file.
    pub models: usize,
    /// Atoms of the models read, before anything is left out.
    pub atoms_read: usize,
    /// Atoms of alternate locations left out.
    pub altlocs: usize,
    /// Hydrogens left out.
    pub hydrogens: usize,
    /// Water atoms left out.
    pub waters: usize,
    /// Ions left out.
    pub ions: usize,
    /// Atoms of ligands left out.
    pub ligands: usize,
    /// Atoms outside the selected part.
    pub unselected: usize,
    /// Atoms of the result.
    pub atoms: usize,
    /// Chains of which only one atom per residue is known (Cα, P) and got residue radii.
    pub trace_chains: usize,
    /// Atoms whose element is not known.
    pub unknown_elements: usize,
    /// Atoms whose radius was raised to `min_radius`.
    pub raised_radii: usize,
    /// Atoms of the result with radius 0.
    pub zero_radii: usize,
    /// The planes of a membrane, from dummy atoms of the file, which are left out.
    pub membrane: Option<Membrane>,
    /// The names of the assemblies that the file defines.
    pub assemblies: Vec<String>,
    /// Number of copies made for the assembly; 0 if none was asked for.
    pub copies: usize,
    /// Oddities that did not prevent reading.
    pub warnings: Vec<String>,
}

/// The boundaries of a membrane normal to z, marked by `DUM` atoms (as the OPM database does).
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct Membrane {
    /// z of the lower plane, Å.
    pub lower: f64,
    /// z of the upper plane, Å.
    pub upper: f64,
    /// Number of dummy atoms.
    pub dummies: usize,
}

/// Reads a file; gzip is recognized by content.
pub fn read(path: impl AsRef<Path>, options: &ReadOptions) -> Result<ReadStructure, Error> {
    let path = path.as_ref();
    let read = || {
        let content = read_bytes(path)?;
        let format = match options.format {
            Some(format) => format,
            None => Format::detect(&content, Some(path))?,
        };
        parse(&content, format, options)
    };
    read().map_err(|e: Error| if e.file.is_some() { e } else { e.in_file(path) })
}

/// Some editors begin UTF-8 files with it.
const BYTE_ORDER_MARK: &[u8] = b"\xef\xbb\xbf";

/// Reads a structure from memory.
pub fn parse(
    content: &[u8],
    format: Format,
    options: &ReadOptions,
) -> Result<ReadStructure, Error> {
    if !(options.min_radius >= 0.0 && options.min_radius.is_finite()) {
        let found = options.min_radius.to_string();
        return Err(ErrorKind::expected("a min_radius of 0 or more", found).into());
    }
    let content = content.strip_prefix(BYTE_ORDER_MARK).unwrap_or(content);
    if content.iter().all(u8::is_ascii_whitespace) {
        return Err(ErrorKind::Empty.into());
    }
    let records = match format {
        Format::Pdb => pdb::parse(content, options.models),
        Format::Mmcif => mmcif::parse(content, options.models),
        Format::Pqr => pqr::parse(content, options.models),
    }?;
    if records.models == 0 {
        let text = String::from_utf8_lossy(content.trim_ascii_start());
        let first: String = text
            .lines()
            .next()
            .unwrap_or_default()
            .chars()
            .take(40)
            .collect();
        let reason = format!(" in this {format} file, which begins with {first:?}");
        return Err(ErrorKind::NoAtoms(reason).into());
    }
    records.keep(format, options)
}

/// One atom as it stands in a file.
#[derive(Clone, Copy, Debug)]
pub(super) struct Record {
    pub(super) atom: Atom,
    pub(super) residue: Residue,
    /// Place in the entity's sequence (mmCIF), which tells residues apart whose numbers do not.
    pub(super) sequence: i32,
    /// Index into [`Records::chains`].
    pub(super) chain: u32,
    /// Index into [`Records::parts`]: what assembly generators name.
    pub(super) part: u32,
    /// Index of the domain: the model, and in PQR files of ours the copy.
    pub(super) domain: u32,
    pub(super) altloc: u8,
    pub(super) occupancy: f32,
}

impl Record {
    /// What the rows of a residue have in common, and those of residues that exclude each other.
    fn place(&self) -> (u32, u32, i32, Name, i32) {
        let Residue {
            number, insertion, ..
        } = self.residue;
        (self.domain, self.chain, number, insertion, self.sequence)
    }

    /// What tells residues at one place apart.
    fn identity(&self) -> (Name, u32) {
        (self.residue.name, self.part)
    }

    fn same_residue(&self, other: &Self) -> bool {
        self.place() == other.place() && self.identity() == other.identity()
    }
}

/// Everything that a reader of one format finds.
#[derive(Debug, Default)]
pub(super) struct Records {
    pub(super) records: Vec<Record>,
    pub(super) chains: Names,
    pub(super) parts: Names,
    /// Model and copy numbers.
    pub(super) domains: Vec<(u32, u32)>,
    /// Number of models in the file, read or not.
    pub(super) models: usize,
    pub(super) assemblies: Vec<Assembly>,
    /// Do the radii of the atoms come from the file?
    pub(super) has_radii: bool,
    pub(super) warnings: Vec<String>,
}

/// Distinct names in order of first appearance; the last one is found at once.
#[derive(Debug, Default)]
pub(super) struct Names {
    names: Vec<Box<[u8]>>,
    sorted: std::collections::BTreeMap<Box<[u8]>, u32>,
    last: u32,
}

impl Names {
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

    pub(super) fn find(&self, name: &[u8]) -> Option<u32> {
        self.sorted.get(name).copied()
    }
}

/// A finite decimal number, blanks around it allowed.
pub(super) fn number(field: &[u8]) -> Option<f64> {
    let field = field.trim_ascii();
    let (negative, digits) = match field {
        [b'-', rest @ ..] => (true, rest),
        [b'+', rest @ ..] => (false, rest),
        _ => (false, field),
    };
    // Up to 15 digits are exact in an f64, and so are small powers of ten: one rounding, as it
    // should be.
    let mut mantissa = 0u64;
    let mut decimals = None;
    for &b in digits {
        match b {
            b'0'..=b'9' => mantissa = mantissa.wrapping_mul(10) + u64::from(b - b'0'),
            b'.' if decimals.is_none() => decimals = Some(0),
            _ => return slow_number(field),
        }
        if b != b'.' {
            decimals = decimals.map(|d| d + 1);
        }
    }
    let decimals = decimals.unwrap_or(0);
    if digits.len() > 15 || digits.len() < 2 && !digits.first().is_some_and(u8::is_ascii_digit) {
        return slow_number(field);
    }
    let value = mantissa as f64 / POWERS[decimals];
    Some(if negative { -value } else { value })
}

const POWERS: [f64; 17] = [
    1e0, 1e1, 1e2, 1e3, 1e4, 1e5, 1e6, 1e7, 1e8, 1e9, 1e10, 1e11, 1e12, 1e13, 1e14, 1e15, 1e16,
];

fn slow_number(field: &[u8]) -> Option<f64> {
    let value: f64 = std::str::from_utf8(field).ok()?.parse().ok()?;
    value.is_finite().then_some(value)
}

/// Is the model with this number, the n-th of the file (from 0), wanted?
pub(super) fn wanted(models: Models, number: u32, nth: usize) -> bool {
    match models {
        Models::First => nth == 0,
        Models::All => true,
        Models::Number(n) => n == number,
    }
}

impl Records {
    /// What the options keep, as a structure.
    fn keep(mut self, format: Format, options: &ReadOptions) -> Result<ReadStructure, Error> {
        let mut report = ReadReport {
            format,
            models: self.models,
            atoms_read: self.records.len(),
            altlocs: 0,
            hydrogens: 0,
            waters: 0,
            ions: 0,
            ligands: 0,
            unselected: 0,
            atoms: 0,
            trace_chains: 0,
            unknown_elements: 0,
            raised_radii: 0,
            zero_radii: 0,
            membrane: None,
            assemblies: self.assemblies.iter().map(|a| a.name.clone()).collect(),
            copies: 0,
            warnings: std::mem::take(&mut self.warnings),
        };
        if self.records.is_empty() {
            let reason = format!(" in model {}: the file has {}", options.models, self.models);
            return Err(ErrorKind::NoAtoms(format!("{reason} models")).into());
        }
        if self.records.len() > options.max_atoms {
            return Err(too_large(self.records.len() as u128, options.max_atoms));
        }
        report.membrane = self.take_dummies();
        // Chains together: hetero atoms often stand behind all polymers.
        self.records.sort_by_key(|r| (r.domain, r.chain));
        self.untangle();
        self.classify();
        self.choose_locations(options.altlocs, &mut report);
        self.assign_radii(options, &mut report);
        self.drop_kinds(options, &mut report);
        if self.records.is_empty() {
            return Err(ErrorKind::NoAtoms(left_over(&report)).into());
        }
        let (mut structure, mut parts) = self.build();
        if let Some(selector) = &options.select {
            let selection = structure
                .select(selector)
                .map_err(|e| ErrorKind::NoAtoms(format!(" selected: {e}")))?;
            let mut kept = vec![false; structure.atoms().len()];
            for range in selection.atom_ranges(&structure) {
                kept[range].fill(true);
            }
            let flags = selection.residues();
            parts = (0..parts.len())
                .filter(|&r| flags[r])
                .map(|r| parts[r])
                .collect();
            let before = structure.atoms().len();
            structure = structure.filter(|a| kept[a]);
            report.unselected = before - structure.atoms().len();
        }
        if let Some(name) = &options.assembly {
            let Some(assembly) = self.assemblies.iter().find(|a| a.name == *name) else {
                let known = match report.assemblies.len() {
                    0 => "this file defines none".to_owned(),
                    _ => format!("this file defines {}", report.assemblies.join(", ")),
                };
                return Err(ErrorKind::expected(format!("an assembly ({known})"), name).into());
            };
            let Copies { sets, copies } = assembly.copies(&self.parts)?;
            report.copies = copies.len();
            let flags = |set: &Option<Vec<u32>>| {
                let has = |part| set.as_ref().is_none_or(|s| s.binary_search(part).is_ok());
                parts.iter().map(has).collect()
            };
            let sets: Vec<Vec<bool>> = sets.iter().map(flags).collect();
            structure = structure
                .copies(&sets, &copies, options.max_atoms)
                .map_err(|e| too_large(e.atoms, options.max_atoms))?;
            if structure.atoms().is_empty() {
                let reason = format!(" left: assembly {name} names none of the chains kept");
                return Err(ErrorKind::NoAtoms(reason).into());
            }
        }
        report.atoms = structure.atoms().len();
        report.zero_radii = structure.atoms().iter().filter(|a| a.radius == 0.0).count();
        let unknown = |a: &&Atom| a.element == Element::UNKNOWN;
        report.unknown_elements = structure.atoms().iter().filter(unknown).count();
        Ok(ReadStructure { structure, report })
    }

    /// Membrane dummies are no atoms: the planes they mark.
    fn take_dummies(&mut self) -> Option<Membrane> {
        let is_dummy = |r: &Record| r.atom.hetero && r.residue.name.as_str() == "DUM";
        let heights = |records: &[Record]| -> Vec<f64> {
            let dummies = records.iter().filter(|r| is_dummy(r));
            dummies.map(|r| r.atom.position.z).collect()
        };
        let z = heights(&self.records);
        if z.is_empty() {
            return None;
        }
        self.records.retain(|r| !is_dummy(r));
        let middle = z.iter().sum::<f64>() / z.len() as f64;
        let mean = |side: &dyn Fn(f64) -> bool| {
            let (sum, n) = z
                .iter()
                .filter(|&&z| side(z))
                .fold((0.0, 0), |(s, n), z| (s + z, n + 1));
            if n > 0 { sum / n as f64 } else { middle }
        };
        Some(Membrane {
            lower: mean(&|z| z < middle),
            upper: mean(&|z| z >= middle),
            dummies: z.len(),
        })
    }

    /// The ranges of records with the same key, which must stand together.
    fn groups<K: PartialEq>(&self, key: impl Fn(&Record) -> K) -> Vec<std::ops::Range<usize>> {
        let mut start = 0;
        self.records
            .chunk_by(|a, b| key(a) == key(b))
            .map(|group| {
                start += group.len();
                start - group.len()..start
            })
            .collect()
    }

    /// Residues that exclude each other may take turns row by row.
    fn untangle(&mut self) {
        for group in self.groups(Record::place) {
            let records = &mut self.records[group];
            if records.iter().all(|r| r.altloc == b' ') {
                continue;
            }
            let mut order = Vec::new();
            for r in records.iter() {
                if !order.contains(&r.identity()) {
                    order.push(r.identity());
                }
            }
            records.sort_by_key(|r| order.iter().position(|i| *i == r.identity()));
        }
    }

    /// The kind of each residue, beyond what the format says: water and ions by name and size.
    fn classify(&mut self) {
        for group in self.groups(|r| (r.place(), r.identity())) {
            let first = &self.records[group.start];
            let name = first.residue.name;
            let single = {
                let atom = first.atom.name;
                self.records[group.clone()]
                    .iter()
                    .all(|r| r.atom.name == atom)
            };
            let kind = match first.residue.kind {
                _ if names::is_water(name) => ResidueKind::Water,
                ResidueKind::Ligand if single => ResidueKind::Ion,
                ResidueKind::Polymer if single && names::is_ion(name) => ResidueKind::Ion,
                kind => kind,
            };
            for r in &mut self.records[group] {
                r.residue.kind = kind;
            }
        }
    }

    /// One location of each atom.
    fn choose_locations(&mut self, policy: AltLocs, report: &mut ReadReport) {
        if policy == AltLocs::All || self.records.iter().all(|r| r.altloc == b' ') {
            return;
        }
        let mut kept = vec![true; self.records.len()];
        // Residues that exclude each other share a place, not always the name.
        for group in self.groups(Record::place) {
            let records = &self.records[group.clone()];
            // Summed occupancies per label and residue name, labels in alphabetical order.
            let mut sums: Vec<(u8, Name, f64)> = Vec::new();
            for r in records.iter().filter(|r| r.altloc != b' ') {
                let known = sums
                    .iter_mut()
                    .find(|s| (s.0, s.1) == (r.altloc, r.residue.name));
                match known {
                    Some(s) => s.2 += f64::from(r.occupancy),
                    None => sums.push((r.altloc, r.residue.name, f64::from(r.occupancy))),
                }
            }
            if sums.is_empty() {
                continue;
            }
            sums.sort_by_key(|s| s.0);
            let asked = match policy {
                AltLocs::Label(label) => sums.iter().find(|s| char::from(s.0) == label),
                _ => None,
            };
            let best = sums[1..]
                .iter()
                .fold(&sums[0], |b, s| if s.2 > b.2 { s } else { b });
            let &(label, name, _) = asked.unwrap_or(best);
            for (i, r) in group.clone().zip(records) {
                let alternatives = || {
                    records.iter().enumerate().filter(|(_, o)| {
                        o.residue.name == name && o.atom.name == r.atom.name && o.altloc != b' '
                    })
                };
                kept[i] = match r.altloc {
                    // Atoms without a label belong to all locations of their residue.
                    b' ' => r.residue.name == name || !sums.iter().any(|s| s.1 == r.residue.name),
                    _ if r.residue.name != name => false,
                    own if own == label => {
                        // The same atom twice under one label: the first.
                        let first = alternatives().find(|(_, o)| o.altloc == label);
                        first.is_some_and(|(first, _)| group.start + first == i)
                    }
                    _ if alternatives().any(|(_, o)| o.altloc == label) => false,
                    _ => {
                        let most = alternatives()
                            .reduce(|b, o| if o.1.occupancy > b.1.occupancy { o } else { b });
                        most.is_some_and(|(most, _)| group.start + most == i)
                    }
                };
            }
        }
        report.altlocs = kept.iter().filter(|k| !**k).count();
        let mut next = kept.iter();
        self.records
            .retain(|_| *next.next().expect("one flag per record"));
    }

    fn assign_radii(&mut self, options: &ReadOptions, report: &mut ReadReport) {
        let from_file = options.radii == Radii::File && self.has_radii;
        if !from_file {
            for r in &mut self.records {
                r.atom.radius = match options.radii {
                    Radii::United => united_radius(r.residue.name, r.atom.name, r.atom.element),
                    _ => r.atom.element.vdw_radius(),
                };
            }
            report.trace_chains = self.inflate_traces();
        }
        for r in &mut self.records {
            if r.atom.radius < options.min_radius {
                r.atom.radius = options.min_radius;
                report.raised_radii += 1;
            }
        }
    }

    /// Where a chain has one atom per residue, that atom stands for the residue. Returns the number
    /// of such chains.
    fn inflate_traces(&mut self) -> usize {
        let mut traces = 0;
        for chain in self.groups(|r| (r.domain, r.chain)) {
            let polymer: Vec<_> = chain
                .filter(|&i| self.records[i].residue.kind == ResidueKind::Polymer)
                .collect();
            let mut alone = Vec::new();
            let mut count = 0;
            for residue in polymer.chunk_by(|&a, &b| self.records[a].same_residue(&self.records[b]))
            {
                count += 1;
                if let [i] = *residue {
                    let atom = &self.records[i].atom;
                    if matches!(
                        atom.name.as_str(),
                        "CA" | "P" | "C4'" | "C3'" | "C1'" | "BB"
                    ) {
                        alone.push(i);
                    }
                }
            }
            if count >= 3 && alone.len() * 10 >= count * 9 {
                traces += 1;
                for i in alone {
                    let r = &mut self.records[i];
                    r.atom.radius = residue_radius(r.residue.name);
                }
            }
        }
        traces
    }

    fn drop_kinds(&mut self, options: &ReadOptions, report: &mut ReadReport) {
        let hydrogens = options.hydrogens && options.radii != Radii::United;
        self.records.retain(|r| {
            let dropped = match r.residue.kind {
                ResidueKind::Water if !options.waters => &mut report.waters,
                ResidueKind::Ion if !options.ions => &mut report.ions,
                ResidueKind::Ligand if !options.ligands => &mut report.ligands,
                _ if !hydrogens && r.atom.element == Element::HYDROGEN => &mut report.hydrogens,
                _ => return true,
            };
            *dropped += 1;
            false
        });
    }

    /// The structure, and the part of each residue.
    fn build(&mut self) -> (Structure, Vec<u32>) {
        let mut builder = StructureBuilder::new();
        let mut parts = Vec::new();
        let mut before: Option<&Record> = None;
        for r in &self.records {
            let domain = before.is_none_or(|b| b.domain != r.domain);
            let chain = domain || before.is_none_or(|b| b.chain != r.chain);
            let residue = chain || before.is_none_or(|b| !b.same_residue(r));
            if domain {
                let (model, copy) = self.domains[r.domain as usize];
                builder.domain(model, copy);
            }
            if chain {
                let name = Name::from_bytes(&self.chains.names[r.chain as usize]);
                builder.chain(name.unwrap_or_default());
            }
            if residue {
                builder.residue_of(r.residue);
                parts.push(r.part);
            }
            builder.atom(r.atom);
            before = Some(r);
        }
        self.records = Vec::new();
        (builder.build(), parts)
    }
}

fn left_over(report: &ReadReport) -> String {
    let dropped = [
        (report.waters, "water atoms (option waters)"),
        (report.hydrogens, "hydrogens (option hydrogens)"),
        (report.ions, "ions (option ions)"),
        (report.ligands, "atoms of ligands (option ligands)"),
        (report.membrane.map_or(0, |m| m.dummies), "membrane dummies"),
    ];
    let dropped: Vec<_> = dropped
        .iter()
        .filter(|(n, _)| *n > 0)
        .map(|(n, what)| format!("{n} {what}"))
        .collect();
    format!(
        " left of {}: left out are {}",
        report.atoms_read,
        dropped.join(", ")
    )
}

fn too_large(atoms: u128, limit: usize) -> Error {
    let limit = limit.min(MAX_ELEMENTS);
    ErrorKind::TooLarge(format!(
        "{atoms} atoms are too many: at most {limit} are allowed here and fit in memory"
    ))
    .into()
}
