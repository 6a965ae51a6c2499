//! What the readers of the formats find: rows of atoms, names, numbers, models.
//!
//! Readers fill in [`Records`] and decide nothing; `keep` decides for all formats alike.

use super::Models;
use super::assembly::Assembly;
use super::names::Names;
use crate::structure::{Atom, Name, Residue};

/// By the first letters only: some programs write what follows without a blank.
pub(super) fn is_atom(line: &[u8]) -> bool {
    line.starts_with(b"ATOM") || line.starts_with(b"HETATM")
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
    /// A blank if the atom has one location.
    pub(super) altloc: u8,
    /// 1 where the file has none.
    pub(super) occupancy: f32,
}

impl Record {
    /// What the rows of a residue have in common, and those of residues that exclude each other.
    pub(super) fn place(&self) -> (u32, u32, i32, Name, i32) {
        let Residue {
            number, insertion, ..
        } = self.residue;
        (self.domain, self.chain, number, insertion, self.sequence)
    }

    /// What tells residues at one place apart.
    pub(super) fn identity(&self) -> (Name, u32) {
        (self.residue.name, self.part)
    }

    /// Rows of one residue have one place, name and part.
    pub(super) fn same_residue(&self, other: &Self) -> bool {
        self.place() == other.place() && self.identity() == other.identity()
    }
}

/// Everything that a reader of one format finds.
#[derive(Debug, Default)]
pub(super) struct Records {
    pub(super) records: Vec<Record>,
    /// As authors name them, which is what a user sees; `parts` are those names by which assemblies go.
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

/// A finite decimal number, blanks around it allowed.
///
/// A file of atoms has five numbers per row, mostly of few digits and without an exponent: those are read here, and
/// anything else by Rust's own parser, with the same bits. `None` for blanks, NaN and infinities.
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

/// Any decimal number, with an exponent too.
fn slow_number(field: &[u8]) -> Option<f64> {
    let value: f64 = std::str::from_utf8(field).ok()?.parse().ok()?;
    value.is_finite().then_some(value)
}

/// Is the model with this number, the n-th of the file (from 0), wanted?
///
/// Of several models with one number all are.
pub(super) fn wanted(models: Models, number: u32, nth: usize) -> bool {
    match models {
        Models::First => nth == 0,
        Models::All => true,
        Models::Number(n) => n == number,
    }
}

/// Follows `MODEL` records and their absence. Shared with PQR.
#[derive(Default)]
pub(super) struct ModelCounter {
    /// Models with atoms so far.
    pub(super) count: usize,
    number: Option<u32>,
    inside: bool,
    /// Are the atoms of the model wanted?
    keep: bool,
}

impl ModelCounter {
    /// The next atoms belong to another model.
    pub(super) fn next(&mut self, number: Option<u32>) {
        self.inside = false;
        self.number = number;
    }

    /// An atom: is it wanted, and is it the first of its model? Then its number.
    pub(super) fn atom(&mut self, models: Models) -> (bool, Option<u32>) {
        let mut first = None;
        if !self.inside {
            self.inside = true;
            let number = self.number.unwrap_or(self.count as u32 + 1);
            self.keep = wanted(models, number, self.count);
            self.count += 1;
            first = Some(number);
        }
        (self.keep, first)
    }
}
