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
//!
//! Of the parts, `record` has what a row of a file becomes; `pdb`, `mmcif` and [`pqr`] make rows of bytes; `keep` makes
//! a structure of rows, which is the place to look for why an atom is or is not there; `assembly` has the copies. Time
//! and memory are in proportion to the file, but for the copies of an assembly, which are in proportion to the result.

mod assembly;
#[cfg(feature = "testing")]
#[doc(hidden)]
pub mod inside;
mod keep;
mod mmcif;
mod models;
mod names;
mod pdb;
pub mod pqr;
mod record;

use std::borrow::Cow;
use std::fmt;
use std::path::Path;

pub use models::{save_models, write_models};

use crate::Structure;
use crate::id::MAX_ELEMENTS;
use crate::io::{Error, ErrorKind, MAX_BYTES, read_bytes_up_to};
use crate::structure::{Selector, Transform};

/// What to keep of a file. The default: the first model, one location of each atom, everything but water, as deposited
/// (no assembly), with the file's own radii or those of the elements.
///
/// They are obeyed in the order that the head of `keep.rs` gives: locations and radii first, then what is dropped by
/// kind, then the selection, then the assembly.
#[derive(Clone, Debug, PartialEq)]
pub struct ReadOptions {
    /// The format; by content and file name if `None`.
    /// Set it for content without a name, or with a name that lies.
    pub format: Option<Format>,
    /// Which models: NMR entries hold many of the same molecule.
    /// All of them as they are overlap: for one molecule in one conformation take the first.
    pub models: Models,
    /// Which of an atom's alternate locations.
    pub altlocs: AltLocs,
    /// Keep hydrogens?
    /// Without them take [`Radii::United`], or the atoms that carried them are too small. X-ray entries mostly have
    /// none.
    pub hydrogens: bool,
    /// Keep water?
    /// Those of crystals are a part of the surroundings for most purposes, hence not by default.
    pub waters: bool,
    /// Keep ions: residues of a single atom that are not water?
    pub ions: bool,
    /// Keep what is neither polymer, ion nor water: ligands, cofactors, lipids, glycans?
    /// A residue that SEQRES, MODRES (PDB) or `_entity` (mmCIF) tells to be of the polymer is none, whatever its
    /// records are called.
    pub ligands: bool,
    /// Keep only this part.
    /// The rest is counted in [`ReadReport::unselected`]. A selection is made of what the other options leave, before
    /// an assembly is copied, so that `copy:2` means none of its copies.
    pub select: Option<Selector>,
    /// Build this assembly, by its name in the file (PDB: number of the biomolecule).
    /// Each copy becomes a domain of its own.
    pub assembly: Option<String>,
    /// Keep the assembly as one copy and the places of all ([`ReadStructure::places`]), for what is too large to be copied.
    /// Nothing happens without an assembly. All copies must have the same chains, or the reader refuses.
    pub instances: bool,
    /// Where radii come from.
    pub radii: Radii,
    /// Smaller radii are raised to this, Å. Some PQR files give 0 to some hydrogens.
    /// 0 or more and finite; 0, the default, leaves all as they are.
    pub min_radius: f64,
    /// More atoms than this are refused before they are allocated.
    /// Asked twice: of the rows of the wanted models before anything is left out, and of the copies of an assembly
    /// (with `instances`, of the one that is held). More than [`MAX_ELEMENTS`] are never possible.
    pub max_atoms: usize,
    /// A file that holds more bytes, unpacked, is refused before they are in memory.
    pub max_bytes: u64,
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
            instances: false,
            radii: Radii::File,
            min_radius: 0.0,
            max_atoms: MAX_ELEMENTS,
            max_bytes: MAX_BYTES,
        }
    }
}

/// Which models of a file.
///
/// A file without records of models has one, number 1.
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
///
/// A chain of which one atom per residue is known (Cα, P) gets [`residue_radius`](crate::structure::residue_radius) in
/// place of any of these, unless radii come from the file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Radii {
    /// The file (PQR), or else as [`Elements`](Self::Elements).
    #[default]
    File,
    /// Van der Waals radii of the elements: [`Element::vdw_radius`](crate::structure::Element::vdw_radius).
    Elements,
    /// Heavy atoms with the hydrogens they carry: [`united_radius`](crate::structure::united_radius). Hydrogens are dropped.
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
    ///
    /// PDB and PQR share their records, hence the name decides between them where it can. Without one, a first atom
    /// with dots where PDB has them (columns 35, 43, 51 and 58) is one of PDB; a PQR file that keeps to these columns
    /// needs its name, or [`ReadOptions::format`].
    ///
    /// # Errors
    /// [`ErrorKind::Expected`] for content without atoms that is no mmCIF, if the name does not tell either, and for a
    /// `.pqr` file whose atoms have the elements of PDB; [`ErrorKind::Unsupported`] for BinaryCIF and MMTF (by the
    /// name).
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
    /// The atoms; with [`ReadOptions::instances`], those of one copy as it stands in the file.
    pub structure: Structure,
    /// Where the copies stand, in the order of the file; one alone that stays where it is, unless instances were asked
    /// for.
    /// To apply them is up to the caller: x ↦ R x + t for every atom of [`ReadStructure::structure`].
    pub places: Vec<Transform>,
    /// What stood in the file and what was left out.
    pub report: ReadReport,
}

/// What stood in a file and what was left out of it.
///
/// Each atom that is left out is counted once: by its location, else as water, ion, ligand or hydrogen, the first of
/// these that applies (a hydrogen of water is water), else as not selected.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct ReadReport {
    /// The format that was read.
    pub format: Format,
    /// Number of models in the file.
    /// Those that were not wanted are among them.
    pub models: usize,
    /// Atoms of the models read, before anything is left out.
    /// Membrane dummies are among them.
    pub atoms_read: usize,
    /// Atoms of alternate locations left out.
    /// Those of residues that share a place with another one (microheterogeneity) are among them.
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
    /// With copies all of these; with instances those of one.
    pub atoms: usize,
    /// Chains of which only one atom per residue is known (Cα, P) and got residue radii.
    /// 0 where radii come from the file.
    pub trace_chains: usize,
    /// Atoms whose element is not known.
    pub unknown_elements: usize,
    /// Atoms whose radius was raised to `min_radius`.
    /// Counted before kinds are dropped and copies made, so that atoms which were left out are among them.
    pub raised_radii: usize,
    /// Atoms of the result with radius 0.
    pub zero_radii: usize,
    /// The planes of a membrane, from dummy atoms of the file, which are left out.
    pub membrane: Option<Membrane>,
    /// The names of the assemblies that the file defines.
    pub assemblies: Vec<String>,
    /// Number of copies made for the assembly; 0 if none was asked for.
    /// Generators that use the same operator make one copy together.
    pub copies: usize,
    /// Oddities that did not prevent reading.
    /// Whole sentences, to be shown: a missing end, a count that differs, radii that look like B factors.
    pub warnings: Vec<String>,
}

/// The boundaries of a membrane normal to z, marked by `DUM` atoms (as the OPM database does).
///
/// Each plane is the mean height of the dummies on its side of their common mean; all at one height give two equal
/// planes.
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
///
/// # Errors
/// With file and, where there is one, line: those of [`read_bytes_up_to`] (its limit is [`ReadOptions::max_bytes`]), of
/// [`Format::detect`], and of [`parse`].
pub fn read(path: impl AsRef<Path>, options: &ReadOptions) -> Result<ReadStructure, Error> {
    let path = path.as_ref();
    let read = || {
        let content = read_bytes_up_to(path, options.max_bytes)?;
        let content = line_ends(&content);
        let format = match options.format {
            Some(format) => format,
            None => Format::detect(&content, Some(path))?,
        };
        parse(&content, format, options)
    };
    read().map_err(|e: Error| if e.file.is_some() { e } else { e.in_file(path) })
}

/// The content with line feeds at the ends of its lines, where old programs of the Macintosh have written carriage returns
/// alone: of such a file all would be one line.
fn line_ends(content: &[u8]) -> Cow<'_, [u8]> {
    let alone = |i: usize| content[i] == b'\r' && content.get(i + 1) != Some(&b'\n');
    if !content.contains(&b'\r') || !(0..content.len()).any(alone) {
        return Cow::Borrowed(content);
    }
    let ended = |i: usize| if alone(i) { b'\n' } else { content[i] };
    Cow::Owned((0..content.len()).map(ended).collect())
}

/// Some editors begin UTF-8 files with it.
const BYTE_ORDER_MARK: &[u8] = b"\xef\xbb\xbf";

/// Reads a structure from memory.
///
/// Of the format nothing is guessed; gzip is not unpacked here.
///
/// # Errors
/// - [`ErrorKind::Expected`]: a row that does not follow its format (with its line), a `min_radius` that is negative or
///   not finite, an assembly that the file does not define (the text lists those it does)
/// - [`ErrorKind::Truncated`]: a file that was cut off
/// - [`ErrorKind::NoAtoms`]: none of the wanted model, none selected, or none left by the options
/// - [`ErrorKind::TooLarge`]: more atoms than [`ReadOptions::max_atoms`], an assembly of more copies than any real one
/// - [`ErrorKind::Unsupported`]: instances of an assembly with unequal copies, a CIF with fractional coordinates
/// - [`ErrorKind::Empty`]: blanks alone
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
    let content = &*line_ends(content);
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
