//! OFF, Geomview's object file, as text: surfaces with vertex colours (`COFF`).
//!
//! Fields and groups are left out. Of a tetrahedral mesh the surface is written.
//!
//! A first word, the numbers of vertices, faces and edges, a line per vertex, and a line per face that begins with its
//! number of corners, counted from 0. Binary OFF is not read.

use std::io::Write;
use std::path::Path;

use crate::Point3;
use crate::io::text::{Words, parse as parse_number};
use crate::io::view::{Cells, View, block_of_rings};
use crate::io::{Error, ErrorKind, read_bytes};

/// Writes a view to a file, whole or not at all.
pub fn save(path: impl AsRef<Path>, view: &View<'_>) -> Result<(), Error> {
    crate::io::save(path, |w| write(w, view))
}

/// Writes a view.
///
/// Edges are told to be 0, as readers do not look. Numbers have all digits.
///
/// # Errors
/// [`ErrorKind::Expected`] and [`ErrorKind::Mesh`] if the parts of the view do not fit each other; else what the writer
/// gives.
pub fn write(w: &mut dyn Write, view: &View<'_>) -> Result<(), Error> {
    view.check()?;
    let view = view.surface();
    let magic = if view.colors.is_some() { "COFF" } else { "OFF" };
    writeln!(w, "{magic}\n{} {} 0", view.points.len(), view.cells())?;
    for (v, p) in view.points.iter().enumerate() {
        write!(w, "{} {} {}", p.x, p.y, p.z)?;
        if let Some(colors) = &view.colors {
            let [r, g, b, a] = colors[v];
            write!(w, " {r} {g} {b} {a}")?;
        }
        writeln!(w)?;
    }
    for ring in view.blocks.iter().flat_map(Cells::iter) {
        write!(w, "{}", ring.len())?;
        for v in ring {
            write!(w, " {v}")?;
        }
        writeln!(w)?;
    }
    Ok(())
}

/// Reads a file.
pub fn read(path: impl AsRef<Path>) -> Result<View<'static>, Error> {
    let path = path.as_ref();
    parse(&read_bytes(path)?).map_err(|e| e.in_file(path))
}

/// Reads a view from the bytes of a file of kind `OFF`, `COFF`, `NOFF` or `CNOFF`, also without that
/// word. Normals and what follows the corners of a face are skipped.
///
/// Comments (`#`) are skipped. Colours of vertices are whole numbers to 255, or parts of 1 where they have a point.
///
/// # Errors
/// With the line: [`ErrorKind::Expected`] for a word that is no number, a face of less than three corners, a corner out of range,
/// a colour of less than three parts. [`ErrorKind::Truncated`] for more rows than the file can hold; [`ErrorKind::Mesh`] for
/// coordinates that are not finite.
pub fn parse(bytes: &[u8]) -> Result<View<'static>, Error> {
    let mut words = Words::new(bytes);
    let first = words.next(true).ok_or(ErrorKind::Empty)?;
    // The first word says what vertices carry; old files begin with the numbers at once.
    let (normals, colors, vertices) = match first {
        b"OFF" => (false, false, None),
        b"COFF" => (false, true, None),
        b"NOFF" => (true, false, None),
        b"CNOFF" => (true, true, None),
        other => match parse_number::<u64>(other) {
            Some(n) => (false, false, Some(n)),
            None => {
                let other = String::from_utf8_lossy(&other[..other.len().min(100)]);
                let kind = ErrorKind::expected("OFF, COFF, NOFF or CNOFF", other);
                return Err(Error::at_line(kind, words.line()));
            }
        },
    };
    let count = |words: &mut Words<'_>, what: &str| -> Result<u64, Error> {
        let word = words
            .next(true)
            .ok_or_else(|| Error::at_line(ErrorKind::Truncated(what.to_owned()), words.line()))?;
        words.parsed(word, what)
    };
    let vertices = match vertices {
        Some(n) => n,
        None => count(&mut words, "a number of vertices")?,
    };
    let faces = count(&mut words, "a number of faces")?;
    count(&mut words, "a number of edges")?;
    // A vertex takes at least six bytes, a face two.
    if u128::from(vertices) * 6 + u128::from(faces) * 2 > bytes.len() as u128 + 2 {
        let what = format!("{vertices} vertices and {faces} faces");
        return Err(ErrorKind::Truncated(what).into());
    }
    // Vertices: place, normal (left out), colour.
    let mut points = Vec::with_capacity(vertices as usize);
    let mut rgba = Vec::new();
    for _ in 0..vertices {
        let mut p = [0.0; 3];
        for c in &mut p {
            let what = "a coordinate";
            let word = words.next(true).ok_or_else(|| {
                Error::at_line(ErrorKind::Truncated(what.to_owned()), words.line())
            })?;
            *c = words.parsed(word, what)?;
        }
        points.push(Point3::from(p));
        if normals {
            for _ in 0..3 {
                words.number::<f64>("a normal")?;
            }
        }
        if colors {
            rgba.push(color(&mut words)?);
        }
    }
    // Faces; what stands behind the corners is left out.
    let (mut ends, mut corners) = (Vec::new(), Vec::new());
    for f in 0..faces {
        let what = "a number of corners";
        let n = count(&mut words, what)?;
        if n < 3 {
            let expected = format!("at least 3 corners of face {f}");
            let kind = ErrorKind::expected(expected, n.to_string());
            return Err(Error::at_line(kind, words.line()));
        }
        for _ in 0..n {
            let corner: u32 = words.number("a corner")?;
            if u64::from(corner) >= vertices {
                let expected = format!("a corner below {vertices}, the number of vertices");
                let kind = ErrorKind::expected(expected, corner.to_string());
                return Err(Error::at_line(kind, words.line()));
            }
            corners.push(corner);
        }
        ends.push(corners.len() as u32);
        words.rest_of_line();
    }
    View {
        points: points.into(),
        blocks: vec![block_of_rings(ends, corners)],
        colors: colors.then(|| rgba.into()),
        ..View::default()
    }
    .checked()
}

/// The rest of a vertex line: three or four numbers, bytes or parts of 1.
fn color(words: &mut Words<'_>) -> Result<[u8; 4], Error> {
    let line = words.line();
    let rest = words.rest_of_line();
    let wrong = || {
        let rest = String::from_utf8_lossy(&rest[..rest.len().min(100)]);
        Error::at_line(ErrorKind::expected("a colour", rest), line)
    };
    let mut color = [u8::MAX; 4];
    let mut n = 0;
    for word in rest
        .split(u8::is_ascii_whitespace)
        .filter(|w| !w.is_empty())
    {
        let value: f64 = parse_number(word).ok_or_else(wrong)?;
        let part = word.contains(&b'.');
        let value = if part { value * 255.0 } else { value };
        *color.get_mut(n).ok_or_else(wrong)? = value.round() as u8;
        n += 1;
    }
    if n < 3 { Err(wrong()) } else { Ok(color) }
}
