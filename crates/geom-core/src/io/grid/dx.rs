//! OpenDX grids as text, as programs for electrostatic potentials write and read them: a regular
//! lattice, the last axis fastest, one number per point.
//!
//! ```text
//! object 1 class gridpositions counts 3 4 5
//! origin -1.5 -2 -2.5
//! delta 1 0 0
//! delta 0 1 0
//! delta 0 0 1
//! object 2 class gridconnections counts 3 4 5
//! object 3 class array type double rank 0 items 60 data follows
//! 0.25 0.5 0.125
//! …
//! ```
//!
//! Lengths are Å; the unit of the values is that of whoever wrote them, kT/e for potentials of APBS.

use std::fmt::Write as _;
use std::io::Write;
use std::path::Path;

use crate::compute::parallel;

use super::GridFile;
use crate::io::text::Words;
use crate::io::{Error, ErrorKind, read_bytes};
use crate::{GridError, LatticeValues, Point3, Vector3};

/// Planes of values that are turned into text at once.
const PLANES: usize = 32;

/// Writes a grid to a file, whole or not at all.
pub fn save(path: impl AsRef<Path>, grid: &(impl LatticeValues + ?Sized)) -> Result<(), Error> {
    crate::io::save(path, |w| write(w, grid))
}

/// Writes a grid: three values per line, with as many digits as tell them apart.
///
/// Each value has at most nine digits, so that reading gives the same bits. A lattice without points is written, but is
/// no grid that [`parse`] takes. Planes are made into text in parallel, 32 at a time, so that memory holds no more than
/// those.
///
/// # Errors
/// Only what the writer gives.
pub fn write(w: &mut dyn Write, grid: &(impl LatticeValues + ?Sized)) -> Result<(), Error> {
    let lattice = grid.lattice();
    let ([nx, ny, nz], o, h) = (lattice.counts, lattice.origin, lattice.spacing);
    writeln!(w, "object 1 class gridpositions counts {nx} {ny} {nz}")?;
    writeln!(w, "origin {} {} {}", o.x, o.y, o.z)?;
    writeln!(w, "delta {h} 0 0\ndelta 0 {h} 0\ndelta 0 0 {h}")?;
    writeln!(w, "object 2 class gridconnections counts {nx} {ny} {nz}")?;
    let points = lattice.points();
    writeln!(
        w,
        "object 3 class array type float rank 0 items {points} data follows"
    )?;
    // Planes of x as text, a few at a time: formatting takes far longer than writing.
    let planes: Vec<usize> = (0..nx).collect();
    for some in planes.chunks(PLANES) {
        let texts: Vec<String> = parallel::map_each(some, |&i| {
            let mut text = String::with_capacity(ny * nz * 16);
            for j in 0..ny {
                for k in 0..nz {
                    let place = (i * ny + j) * nz + k;
                    let end = if place % 3 == 2 { '\n' } else { ' ' };
                    // Writing to memory cannot fail.
                    let _ = write!(text, "{:e}{end}", grid.at([i, j, k]));
                }
            }
            text
        });
        for text in texts {
            w.write_all(text.as_bytes())?;
        }
    }
    let end = if points.is_multiple_of(3) { "" } else { "\n" };
    writeln!(w, "{end}attribute \"dep\" string \"positions\"")?;
    writeln!(
        w,
        "object \"regular positions regular connections\" class field"
    )?;
    for (name, object) in [("positions", 1), ("connections", 2), ("data", 3)] {
        writeln!(w, "component \"{name}\" value {object}")?;
    }
    Ok(())
}

/// Reads a file.
pub fn read(path: impl AsRef<Path>) -> Result<GridFile, Error> {
    let path = path.as_ref();
    parse(&read_bytes(path)?).map_err(|e| e.in_file(path))
}

/// Does the text, after its comments, begin with an object?
pub(super) fn looks_like(bytes: &[u8]) -> bool {
    Words::new(bytes).next(true) == Some(b"object")
}

/// Reads a grid from the bytes of a file: one `gridpositions` with `origin` and three `delta`, and one
/// `array` of numbers as text. Values beyond f32 are refused.
///
/// Objects may come in any order, but values follow their array at once. The axes of the result are the file's last,
/// middle and first one, whatever they are called.
///
/// # Errors
/// With the line: [`ErrorKind::Expected`] for what is not of the format, [`ErrorKind::Unsupported`] for binary values
/// or a second array, [`ErrorKind::Truncated`] if fewer values follow than are announced. Without one:
/// [`ErrorKind::Truncated`] if a part is missing, [`ErrorKind::Grid`] if there are more or fewer values than points,
/// [`ErrorKind::Expected`] for steps that span no volume.
pub fn parse(bytes: &[u8]) -> Result<GridFile, Error> {
    let mut words = Words::new(bytes);
    let mut counts: Option<[usize; 3]> = None;
    let mut origin: Option<Point3> = None;
    let mut deltas: Vec<Vector3> = Vec::new();
    let mut values: Option<Vec<f32>> = None;
    if words.next(true).is_none() {
        return Err(ErrorKind::Empty.into());
    }
    words = Words::new(bytes);
    // Statement by statement, in any order; the values follow the array that announces them.
    while let Some(word) = words.next(true) {
        let line = words.line();
        match word {
            b"object" => {
                let rest = String::from_utf8_lossy(words.rest_of_line()).into_owned();
                let rest: Vec<&str> = rest.split_ascii_whitespace().collect();
                match after(&rest, "class").copied() {
                    Some("gridpositions") => counts = Some(three(&rest, line)?),
                    Some("gridconnections") => {
                        let cells = three(&rest, line)?;
                        if counts.is_some_and(|c| c != cells) {
                            let kind = ErrorKind::expected(
                                format!("connections between {counts:?} positions"),
                                format!("{cells:?}"),
                            );
                            return Err(Error::at_line(kind, line));
                        }
                    }
                    Some("array") => {
                        if values.is_some() {
                            let kind = ErrorKind::Unsupported("a second array of values".into());
                            return Err(Error::at_line(kind, line));
                        }
                        let items = items(&rest, line)?;
                        // A value takes at least two bytes.
                        if u128::from(items) * 2 > (bytes.len() - words.at()) as u128 + 1 {
                            let kind = ErrorKind::Truncated(format!("{items} values"));
                            return Err(Error::at_line(kind, line));
                        }
                        values = Some(array(&mut words, items as usize)?);
                    }
                    Some("field") => {}
                    _ => {
                        let expected = "class gridpositions, gridconnections, array or field";
                        let kind = ErrorKind::expected(expected, rest.join(" "));
                        return Err(Error::at_line(kind, line));
                    }
                }
            }
            // What places the lattice; attributes and components only tie objects together.
            b"origin" => origin = Some(vector(&mut words)?.into()),
            b"delta" => deltas.push(vector(&mut words)?),
            b"attribute" | b"component" => {
                words.rest_of_line();
            }
            other => {
                let expected = "object, origin, delta, attribute or component";
                let found = String::from_utf8_lossy(&other[..other.len().min(100)]);
                return Err(Error::at_line(ErrorKind::expected(expected, found), line));
            }
        }
    }
    let missing = |what: &str| Error::from(ErrorKind::Truncated(format!("a grid without {what}")));
    let [nx, ny, nz] = counts.ok_or_else(|| missing("gridpositions"))?;
    let origin = origin.ok_or_else(|| missing("origin"))?;
    let Ok([x, y, z]) = <[Vector3; 3]>::try_from(deltas) else {
        return Err(missing("three deltas"));
    };
    let values = values.ok_or_else(|| missing("an array of values"))?;
    // In the file z runs fastest, here x: axes are turned around, and so is the place of a fault.
    GridFile::new(origin, [z, y, x], [nz, ny, nx], values).map_err(|e| match e.kind {
        // In the order of the file.
        ErrorKind::Grid(GridError::NotFinite {
            index: [k, j, i],
            value,
        }) => GridError::NotFinite {
            index: [i, j, k],
            value,
        }
        .into(),
        _ => e,
    })
}

/// The word after a key.
///
/// `None` if the key is missing or the last word.
fn after<'a, 'b>(words: &'a [&'b str], key: &str) -> Option<&'a &'b str> {
    let at = words.iter().position(|w| *w == key)?;
    words.get(at + 1)
}

/// The three numbers after `counts`.
fn three(words: &[&str], line: usize) -> Result<[usize; 3], Error> {
    let at = words.iter().position(|w| *w == "counts").map(|k| k + 1);
    let numbers = at.and_then(|k| words.get(k..k + 3));
    let numbers = numbers.and_then(|n| {
        let n: Option<Vec<u32>> = n.iter().map(|w| w.parse().ok()).collect();
        n.filter(|n| n.iter().all(|&c| c > 0))
    });
    match numbers.as_deref() {
        Some(&[a, b, c]) => Ok([a as usize, b as usize, c as usize]),
        _ => {
            let kind = ErrorKind::expected("counts and three positive numbers", words.join(" "));
            Err(Error::at_line(kind, line))
        }
    }
}

/// How many numbers follow as text.
fn items(words: &[&str], line: usize) -> Result<u64, Error> {
    let wrong = |expected: &str, found: &str| {
        Err(Error::at_line(ErrorKind::expected(expected, found), line))
    };
    let quoted = after(words, "type").map_or("float", |w| w.trim_matches('"'));
    if !["float", "double", "int", "short", "byte"].contains(&quoted) {
        return wrong("type float, double, int, short or byte", quoted);
    }
    let rank = after(words, "rank").map_or("0", |w| *w);
    if rank != "0" {
        return wrong("numbers of rank 0", rank);
    }
    for binary in ["binary", "ieee", "lsb", "msb", "xdr"] {
        if words.contains(&binary) {
            let what = format!("{binary} values: only text is read in OpenDX grids; use MRC");
            return Err(Error::at_line(ErrorKind::Unsupported(what), line));
        }
    }
    if after(words, "data").copied() != Some("follows") {
        return wrong("data follows", &words.join(" "));
    }
    match after(words, "items").and_then(|w| w.parse::<u32>().ok()) {
        Some(n) if n > 0 => Ok(u64::from(n)),
        _ => wrong("items and their number", &words.join(" ")),
    }
}

/// What is beyond f32 would become infinite and is refused, with its place.
fn array(words: &mut Words<'_>, items: usize) -> Result<Vec<f32>, Error> {
    let mut values = Vec::with_capacity(items);
    for i in 0..items {
        let value: f32 = words.number("a value")?;
        if !value.is_finite() {
            let expected = format!("value {i} to be a finite f32");
            let kind = ErrorKind::expected(expected, value.to_string());
            return Err(Error::at_line(kind, words.line()));
        }
        values.push(value);
    }
    Ok(values)
}

/// Three numbers of `origin` or `delta`.
fn vector(words: &mut Words<'_>) -> Result<Vector3, Error> {
    let mut v = Vector3::zeros();
    for c in v.iter_mut() {
        *c = words.number("a length in Å")?;
    }
    Ok(v)
}
