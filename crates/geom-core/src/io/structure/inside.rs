//! How single words are read, for tests.

use std::collections::BTreeMap;
use std::rc::Rc;

use super::assembly::Operators;
use super::{mmcif, names, pdb};
use crate::io::Error;
use crate::structure::{Element, Name, Transform};

/// What an expression over named operators, as in line `line` of a file, stands for.
pub fn operators(
    text: &str,
    line: usize,
    named: BTreeMap<String, Transform>,
) -> Result<Vec<Transform>, Error> {
    let expression = Operators::Expression {
        text: text.to_owned(),
        line,
        named: Rc::new(named),
    };
    expression.transforms("1")
}

/// The words of an mmCIF file, without quotes, and the line in which each begins.
pub fn words(content: &[u8]) -> Result<Vec<(String, usize)>, Error> {
    mmcif::words(content)
}

/// A number of an mmCIF file, without its uncertainty.
pub fn measured(field: &[u8]) -> Option<f64> {
    mmcif::measured(field)
}

/// The element of an atom that has no element column.
pub fn element_of(name: Name, residue: Name, alone: bool, aligned: Option<u8>) -> Element {
    names::element_of(name, residue, alone, aligned)
}

/// The element of an element column.
pub fn element_in_file(symbol: &str) -> Option<Element> {
    names::element_in_file(symbol)
}

/// A residue number of four characters beyond 9999.
pub fn hybrid_36(field: &str) -> Option<i32> {
    pdb::hybrid_36(field)
}
