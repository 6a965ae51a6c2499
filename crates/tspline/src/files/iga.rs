//! The text of tIGAr and of the T-spline plug-in for Rhino before it: `.iga`.
//!
//! ```text
//! type surface
//! nodeN 98
//! elemN 96
//! node x y z w            per node
//! belem 16 3 3            per element: functions, degrees
//! nodes                   from 0 on
//! coefficients            16 per function
//! ```

use std::io::{self, Write};

use super::bext::numbers_in_lines;
use super::words::Words;
use super::{Exchange, ExchangeElement};
use crate::Error;
use crate::surface::POINTS;

/// Writes a surface.
///
/// # Errors
/// Those of `out`.
pub fn write(out: &mut dyn Write, surface: &Exchange) -> io::Result<()> {
    let (nodes, elements) = (surface.nodes.len(), surface.elements.len());
    writeln!(out, "type surface\nnodeN {nodes}\nelemN {elements}")?;
    for node in &surface.nodes {
        write!(out, "node ")?;
        numbers_in_lines(out, node, 4)?;
    }
    for element in &surface.elements {
        writeln!(out, "belem {} 3 3", element.nodes.len())?;
        for node in &element.nodes {
            write!(out, "{node} ")?;
        }
        writeln!(out)?;
        for row in &element.rows {
            numbers_in_lines(out, row, POINTS)?;
        }
    }
    Ok(())
}

/// Reads a bicubic surface.
///
/// Other degrees than 3 are refused. Words may stand on any lines.
///
/// # Errors
/// [`Error::File`] with the line; [`Error::Count`] for nodes that do not exist.
pub fn read(text: &str) -> Result<Exchange, Error> {
    let mut words = Words::new(text);
    words.expect("type")?;
    words.expect("surface")?;
    words.expect("nodeN")?;
    let nodes: usize = words.read("the number of nodes")?;
    words.expect("elemN")?;
    let elements: usize = words.read("the number of elements")?;
    let mut out = Exchange::default();
    for _ in 0..nodes {
        words.expect("node")?;
        out.nodes.push(words.array("a coordinate or weight")?);
    }
    for _ in 0..elements {
        words.expect("belem")?;
        let count: usize = words.read("the number of functions")?;
        words.expect("3")?;
        words.expect("3")?;
        let mut element = ExchangeElement {
            nodes: words.several(count, "the number of a node")?,
            rows: Vec::new(),
        };
        for _ in 0..count {
            element.rows.push(words.array::<POINTS>("a coefficient")?);
        }
        out.elements.push(element);
    }
    out.check()?;
    Ok(out)
}
