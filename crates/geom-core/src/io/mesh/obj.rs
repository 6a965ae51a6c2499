//! OBJ, Wavefront's object file: surfaces with vertex colours and groups.
//!
//! Colours are written as three parts of 1 after a vertex's coordinates, as most programs read them.
//! Fields are left out. Of a tetrahedral mesh the surface is written.
//!
//! A statement per line: `v x y z [r g b]`, `f a b c …` with corners counted from 1, `g name` for all faces that
//! follow. Numbers have all digits, so that positions come back with their bits.

use std::io::Write;
use std::path::Path;

use crate::Point3;
use crate::io::text::parse as parse_number;
use crate::io::view::{Cells, Group, NO_GROUP, View, block_of_rings};
use crate::io::{Error, ErrorKind, read_bytes};

/// Writes a view to a file, whole or not at all.
pub fn save(path: impl AsRef<Path>, view: &View<'_>) -> Result<(), Error> {
    crate::io::save(path, |w| write(w, view))
}

/// Writes a view.
///
/// Blanks in names of groups become `_`. Opacity is left out.
///
/// # Errors
/// [`ErrorKind::Expected`] and [`ErrorKind::Mesh`] if the parts of the view do not fit each other; else what the writer
/// gives.
pub fn write(w: &mut dyn Write, view: &View<'_>) -> Result<(), Error> {
    view.check()?;
    let view = view.surface();
    writeln!(w, "# lengths in angstrom")?;
    for (v, p) in view.points.iter().enumerate() {
        write!(w, "v {} {} {}", p.x, p.y, p.z)?;
        if let Some(colors) = &view.colors {
            let [r, g, b, _] = colors[v].map(|c| f32::from(c) / 255.0);
            write!(w, " {r} {g} {b}")?;
        }
        writeln!(w)?;
    }
    let mut group = NO_GROUP;
    for (cell, ring) in view.blocks.iter().flat_map(Cells::iter).enumerate() {
        let of = view.group_of.get(cell).copied().unwrap_or(NO_GROUP);
        if of != group {
            let name = view.groups.get(of as usize).map_or("", |g| &g.name);
            writeln!(w, "g {}", name.replace(char::is_whitespace, "_"))?;
            group = of;
        }
        write!(w, "f")?;
        for v in ring {
            write!(w, " {}", v + 1)?;
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

/// Reads a view from the bytes of a file: `v`, `f` and `g` lines. Texture coordinates, normals,
/// materials, lines and points are skipped; curves and surfaces of higher order are refused.
///
/// Faces may be quads or polygons. A corner `a/b/c` is vertex `a`; −1 is the last vertex before the line. Groups of one
/// name are one.
///
/// # Errors
/// With the line: [`ErrorKind::Expected`] for a statement, number or corner that is none, and for the highest corner if there are
/// not so many vertices. [`ErrorKind::Expected`] for a file without vertices; [`ErrorKind::Mesh`] for coordinates that are not
/// finite.
pub fn parse(bytes: &[u8]) -> Result<View<'static>, Error> {
    let mut points: Vec<Point3> = Vec::new();
    let mut colors: Vec<[u8; 4]> = Vec::new();
    let (mut ends, mut corners) = (Vec::new(), Vec::new());
    // The highest corner and its line: vertices may follow the faces that name them.
    let mut highest = (0, 0);
    let mut groups: Vec<Group> = Vec::new();
    let mut group = NO_GROUP;
    let mut group_of = Vec::new();
    let mut lines = bytes.split(|&b| b == b'\n').enumerate();
    let mut joined = Vec::new();
    while let Some((i, mut line)) = lines.next() {
        // A backslash at the end joins the next line.
        joined.clear();
        while let Some(start) = line.trim_ascii_end().strip_suffix(b"\\") {
            joined.extend_from_slice(start);
            joined.push(b' ');
            line = lines.next().map_or(&[], |(_, next)| next);
        }
        if !joined.is_empty() {
            joined.extend_from_slice(line);
            line = &joined;
        }
        let line = line.split(|&b| b == b'#').next().unwrap_or_default();
        let mut words = line
            .split(u8::is_ascii_whitespace)
            .filter(|w| !w.is_empty());
        let wrong = |expected: &str, found: &[u8]| {
            let found = String::from_utf8_lossy(&found[..found.len().min(100)]);
            Error::at_line(ErrorKind::expected(expected, found), i + 1)
        };
        match words.next() {
            // A place, perhaps a weight or a colour behind it; anything longer is no vertex.
            Some(b"v") => {
                let mut numbers = [0.0; 7];
                let mut n = 0;
                for word in words {
                    let value: f64 =
                        parse_number(word).ok_or_else(|| wrong("a coordinate", word))?;
                    *numbers
                        .get_mut(n)
                        .ok_or_else(|| wrong("at most 7 numbers", line))? = value;
                    n += 1;
                }
                let [x, y, z, r, g, b, _] = numbers;
                if n < 3 {
                    return Err(wrong("three coordinates", line));
                }
                points.push(Point3::new(x, y, z));
                if n >= 6 {
                    let [r, g, b] = [r, g, b].map(|c| (c * 255.0).round() as u8);
                    colors.push([r, g, b, u8::MAX]);
                }
            }
            // Corners may name a texture and a normal after slashes, which are left out.
            Some(b"f") => {
                let start = corners.len();
                for word in words {
                    let vertex = word.split(|&b| b == b'/').next().unwrap_or_default();
                    let number: i64 =
                        parse_number(vertex).ok_or_else(|| wrong("a corner", word))?;
                    // Counted from 1, or back from the last vertex.
                    let vertex = match number {
                        1.. => Some(number - 1),
                        0 => None,
                        _ => number.checked_add(points.len() as i64),
                    };
                    let vertex = vertex.and_then(|v| u32::try_from(v).ok());
                    let vertex = vertex.ok_or_else(|| wrong("a corner", word))?;
                    if vertex >= highest.0 {
                        highest = (vertex, i + 1);
                    }
                    corners.push(vertex);
                }
                if corners.len() - start < 3 {
                    return Err(wrong("a face of at least 3 corners", line));
                }
                ends.push(corners.len() as u32);
                group_of.push(group);
            }
            // A group goes on until the next one; groups of one name are one.
            Some(b"g") => {
                let name = words.collect::<Vec<_>>().join(&b' ');
                let name = String::from_utf8_lossy(&name).into_owned();
                group = if name.is_empty() {
                    NO_GROUP
                } else {
                    let known = groups.iter().position(|g| g.name == name);
                    known.unwrap_or_else(|| {
                        groups.push(Group {
                            name,
                            dimension: 2,
                            tag: None,
                        });
                        groups.len() - 1
                    }) as u32
                };
            }
            Some(
                b"vt" | b"vn" | b"o" | b"s" | b"l" | b"p" | b"mtllib" | b"usemtl" | b"lod"
                | b"bevel" | b"c_interp" | b"d_interp" | b"shadow_obj" | b"trace_obj" | b"mg",
            )
            | None => {}
            Some(other) => return Err(wrong("an OBJ statement such as v or f", other)),
        }
    }
    // Colours count only where every vertex has one.
    if points.is_empty() {
        return Err(ErrorKind::expected("vertices (v lines)", "none").into());
    }
    if highest.0 as usize >= points.len() {
        let expected = format!(
            "a corner of at most {}, the number of vertices",
            points.len()
        );
        let kind = ErrorKind::expected(expected, (u64::from(highest.0) + 1).to_string());
        return Err(Error::at_line(kind, highest.1));
    }
    View {
        colors: (colors.len() == points.len()).then(|| colors.into()),
        points: points.into(),
        blocks: vec![block_of_rings(ends, corners)],
        group_of: if groups.is_empty() { vec![] } else { group_of }.into(),
        groups,
        ..View::default()
    }
    .checked()
}
