//! PLY, the Stanford polygon file, binary or text: surfaces with colours and named values.
//!
//! Scalars are written as properties of their name, vectors as `name_x`, `name_y`, `name_z` and other
//! tuples as `name_0`, `name_1`, …; blanks in names become `_`. Groups are left out. Of a tetrahedral
//! mesh the surface is written.
//!
//! Types are kept, f32 and f64 too; i64 has no word in PLY. Read and written are both encodings; big-endian files are
//! read.

use std::io::Write;
use std::path::Path;

use ply_rs_bw::parser::{Parser, Reader};
use ply_rs_bw::ply::{ElementDef, PropertyAccess, PropertyAccessResult, PropertyType, ScalarType};

use crate::Point3;
use crate::io::bytes::Scalar;
use crate::io::view::{Cells, Field, Numbers, Values, View, block_of_rings};
use crate::io::{Encoding, Error, ErrorKind, read_bytes};

/// Writes a view to a file, whole or not at all.
pub fn save(path: impl AsRef<Path>, view: &View<'_>, encoding: Encoding) -> Result<(), Error> {
    crate::io::save(path, |w| write(w, view, encoding))
}

/// Writes a view.
///
/// Characters that PLY does not allow in names become `_`, and a digit in front gets one before it.
///
/// # Errors
/// [`ErrorKind::Unsupported`] for 64-bit integers, [`ErrorKind::Expected`] for names that are one after this, or that
/// PLY uses itself, and for parts of the view that do not fit each other.
pub fn write(w: &mut dyn Write, view: &View<'_>, encoding: Encoding) -> Result<(), Error> {
    view.check()?;
    let view = view.surface();
    let format = match encoding {
        Encoding::Binary => "binary_little_endian",
        Encoding::Ascii => "ascii",
    };
    writeln!(w, "ply\nformat {format} 1.0\ncomment lengths in angstrom")?;
    // Vertices: place, colour, fields by names that do not clash with those.
    writeln!(w, "element vertex {}", view.points.len())?;
    for axis in ["x", "y", "z"] {
        writeln!(w, "property double {axis}")?;
    }
    if view.colors.is_some() {
        for channel in ["red", "green", "blue", "alpha"] {
            writeln!(w, "property uchar {channel}")?;
        }
    }
    let own = ["x", "y", "z", "red", "green", "blue", "alpha"];
    properties(w, &view.point_fields, &own)?;
    writeln!(w, "element face {}", view.cells())?;
    // Some programs know lists of `int` only.
    let index = match i32::try_from(view.points.len()) {
        Ok(_) => "int",
        Err(_) => "uint",
    };
    // The shortest type that holds the number of corners.
    let largest = view
        .blocks
        .iter()
        .flat_map(Cells::iter)
        .map(<[u32]>::len)
        .max();
    let count = if largest.unwrap_or(0) < 256 {
        "uchar"
    } else {
        "int"
    };
    writeln!(w, "property list {count} {index} vertex_indices")?;
    properties(w, &view.cell_fields, &["vertex_indices", "vertex_index"])?;
    writeln!(w, "end_header")?;

    // Then the rows, in the order of the header.
    let mut row = Row::new(w, encoding);
    for (v, p) in view.points.iter().enumerate() {
        for c in p.iter() {
            row.put(*c);
        }
        if let Some(colors) = &view.colors {
            for c in colors[v] {
                row.put(c);
            }
        }
        row.put_fields(&view.point_fields, v);
        row.end()?;
    }
    for (cell, ring) in view.blocks.iter().flat_map(Cells::iter).enumerate() {
        if count == "uchar" {
            row.put(ring.len() as u8);
        } else {
            row.put(ring.len() as i32);
        }
        for &v in ring {
            row.put(v);
        }
        row.put_fields(&view.cell_fields, cell);
        row.end()?;
    }
    row.finish()
}

/// Fields as properties, one per component, in the letters that PLY allows; refuses names that then
/// equal each other or those `taken`.
fn properties(w: &mut dyn Write, fields: &[Field<'_>], taken: &[&str]) -> Result<(), Error> {
    let mut taken: Vec<String> = taken.iter().map(|&name| name.to_owned()).collect();
    for field in fields {
        let kind = match field.values.numbers {
            Numbers::F32(_) => "float",
            Numbers::F64(_) => "double",
            Numbers::U8(_) => "uchar",
            Numbers::U32(_) => "uint",
            Numbers::I32(_) => "int",
            Numbers::I64(_) => {
                let reason = format!(
                    "PLY has no 64-bit integers, as {} has: take VTU",
                    field.name
                );
                return Err(ErrorKind::Unsupported(reason).into());
            }
        };
        let allowed = |c: char| c.is_ascii_alphanumeric() || c == '_' || c == '-';
        let mut name = field.name.replace(|c| !allowed(c), "_");
        if !name.starts_with(|c: char| c.is_ascii_alphabetic() || c == '_') {
            name.insert(0, '_');
        }
        for k in 0..field.values.components {
            let property = match field.values.components {
                1 => name.clone(),
                3 => format!("{name}_{}", ["x", "y", "z"][k]),
                _ => format!("{name}_{k}"),
            };
            if taken.contains(&property) {
                let expected = "fields of different names, other than those of PLY itself";
                return Err(ErrorKind::expected(expected, property).into());
            }
            writeln!(w, "property {kind} {property}")?;
            taken.push(property);
        }
    }
    Ok(())
}

/// Rows of numbers, as bytes or words, gathered into large pieces.
struct Row<'w> {
    w: &'w mut dyn Write,
    encoding: Encoding,
    buffer: Vec<u8>,
    first: bool,
}

impl<'w> Row<'w> {
    fn new(w: &'w mut dyn Write, encoding: Encoding) -> Self {
        Self {
            w,
            encoding,
            buffer: Vec::with_capacity(1 << 16),
            first: true,
        }
    }
    /// A number of the current row.
    fn put<T: Scalar + std::fmt::Display>(&mut self, number: T) {
        match self.encoding {
            Encoding::Binary => number.put(&mut self.buffer),
            Encoding::Ascii => {
                let blank = if self.first { "" } else { " " };
                let _ = write!(self.buffer, "{blank}{number}");
                self.first = false;
            }
        }
    }
    /// The tuple of each field for point or cell `i`.
    fn put_fields(&mut self, fields: &[Field<'_>], i: usize) {
        for Field { values, .. } in fields {
            for at in i * values.components..(i + 1) * values.components {
                crate::io::view::each_type!(&values.numbers, n => self.put(n[at]));
            }
        }
    }
    /// The row is whole; rows are handed on in pieces of 32 KiB.
    fn end(&mut self) -> Result<(), Error> {
        if self.encoding == Encoding::Ascii {
            self.buffer.push(b'\n');
            self.first = true;
        }
        if self.buffer.len() > 1 << 15 {
            self.w.write_all(&self.buffer)?;
            self.buffer.clear();
        }
        Ok(())
    }
    /// Hands on the rest.
    fn finish(self) -> Result<(), Error> {
        Ok(self.w.write_all(&self.buffer)?)
    }
}

/// Reads a file.
pub fn read(path: impl AsRef<Path>) -> Result<View<'static>, Error> {
    let path = path.as_ref();
    parse(&read_bytes(path)?).map_err(|e| e.in_file(path))
}

/// Reads a view from the bytes of a file: the elements `vertex` and `face`. Three consecutive
/// properties `name_x`, `name_y`, `name_z` become one vector; other elements and other lists are
/// skipped.
///
/// Colours are `red`, `green`, `blue` and perhaps `alpha`, of bytes; of another type they stay fields. Normals (`nx`,
/// `ny`, `nz`) are three fields. Lists of corners are called `vertex_indices` or `vertex_index`; 16-bit and 8-bit
/// integers become 32-bit ones, but for unsigned bytes.
///
/// # Errors
/// [`ErrorKind::Truncated`] if rows are missing, [`ErrorKind::Expected`] for what is not PLY, for a file without
/// vertices or their places, and for a face of less than three corners; [`ErrorKind::Mesh`] for corners out of range
/// and coordinates that are not finite.
pub fn parse(bytes: &[u8]) -> Result<View<'static>, Error> {
    let mut reader = Reader::new(bytes);
    let parser = Parser::<Element>::new();
    let header = parser.read_header(&mut reader).map_err(foreign)?;
    let mut view = View::default();
    let mut vertices = false;
    for (name, element) in &header.elements {
        // A row has at least a byte, unless it has no property.
        if element.count > bytes.len() || element.properties.is_empty() && element.count > 0 {
            let what = format!("{} rows of {name}", element.count);
            return Err(ErrorKind::Truncated(what).into());
        }
        let rows = parser
            .read_payload_for_element(&mut reader, element, &header)
            .map_err(foreign)?;
        match name.as_str() {
            "vertex" => {
                vertices = true;
                view.point_fields = fields(element, &rows);
                let mut axis = |name: &str| {
                    let at = view.point_fields.iter().position(|f| f.name == name);
                    let at = at.ok_or_else(|| {
                        ErrorKind::expected(format!("a vertex property {name}"), "none")
                    })?;
                    Ok::<_, Error>(view.point_fields.remove(at).values.to_f64())
                };
                let (x, y, z) = (axis("x")?, axis("y")?, axis("z")?);
                view.points = (0..x.len())
                    .map(|i| Point3::new(x[i], y[i], z[i]))
                    .collect();
                view.colors = take_colors(&mut view.point_fields, x.len()).map(Into::into);
            }
            "face" => {
                let mut ends = Vec::with_capacity(rows.len());
                let mut corners = Vec::new();
                for (f, row) in rows.iter().enumerate() {
                    if row.ring.len() < 3 {
                        let expected = format!("at least 3 corners of face {f}");
                        return Err(
                            ErrorKind::expected(expected, row.ring.len().to_string()).into()
                        );
                    }
                    corners.extend_from_slice(&row.ring);
                    ends.push(corners.len() as u32);
                }
                view.cell_fields = fields(element, &rows);
                view.blocks = vec![block_of_rings(ends, corners)];
            }
            _ => {}
        }
    }
    if !vertices {
        return Err(ErrorKind::expected("an element vertex", "none").into());
    }
    view.checked()
}

/// Red, green, blue and perhaps alpha, if they are bytes.
fn take_colors(fields: &mut Vec<Field<'static>>, n: usize) -> Option<Vec<[u8; 4]>> {
    let mut colors = vec![[u8::MAX; 4]; n];
    let find = |fields: &[Field<'_>], name: &str| {
        fields
            .iter()
            .position(|f| f.name == name && matches!(f.values.numbers, Numbers::U8(_)))
    };
    for name in ["red", "green", "blue"] {
        find(fields, name)?;
    }
    for (k, name) in ["red", "green", "blue", "alpha"].into_iter().enumerate() {
        if let Some(at) = find(fields, name)
            && let Numbers::U8(channel) = fields.remove(at).values.numbers
        {
            for (color, &c) in colors.iter_mut().zip(channel.iter()) {
                color[k] = c;
            }
        }
    }
    Some(colors)
}

/// The scalar properties of an element, by name.
fn fields(element: &ElementDef, rows: &[Element]) -> Vec<Field<'static>> {
    let mut scalars: Vec<(&str, &ScalarType, usize)> = Vec::new();
    for (name, property) in &element.properties {
        if let PropertyType::Scalar(kind) = &property.data_type {
            scalars.push((name, kind, scalars.len()));
        }
    }
    let mut fields = Vec::new();
    let mut rest = scalars.as_slice();
    while let Some((&(name, kind, at), after)) = rest.split_first() {
        let stem = name.strip_suffix("_x");
        let is = |i: usize, axis: &str| {
            let next = after.get(i).filter(|n| n.1 == kind);
            next.and_then(|n| n.0.strip_suffix(axis)) == stem
        };
        let vector = stem.is_some() && is(0, "_y") && is(1, "_z");
        let components = if vector { 3 } else { 1 };
        let numbers = rows.iter().flat_map(|r| &r.scalars[at..at + components]);
        let numbers = match kind {
            ScalarType::Float => Numbers::F32(numbers.map(|&v| v as f32).collect()),
            ScalarType::Double => Numbers::F64(numbers.copied().collect()),
            ScalarType::UChar => Numbers::U8(numbers.map(|&v| v as u8).collect()),
            ScalarType::UInt | ScalarType::UShort => {
                Numbers::U32(numbers.map(|&v| v as u32).collect())
            }
            ScalarType::Int | ScalarType::Short | ScalarType::Char => {
                Numbers::I32(numbers.map(|&v| v as i32).collect())
            }
        };
        fields.push(Field {
            name: stem.filter(|_| vector).unwrap_or(name).to_owned(),
            values: Values {
                components,
                numbers,
            },
        });
        rest = &after[components - 1..];
    }
    fields
}

fn foreign(error: ply_rs_bw::parser::ParseError) -> Error {
    let kind = match error.kind() {
        std::io::ErrorKind::UnexpectedEof => ErrorKind::Truncated("the PLY data".to_owned()),
        // The crate's message spreads over lines, of which the last says why.
        _ => {
            let message = error.to_string();
            let last = message.lines().last().unwrap_or_default().trim();
            ErrorKind::expected("PLY data", last)
        }
    };
    match error.line() {
        Some(line) => Error::at_line(kind, line),
        None => kind.into(),
    }
}

/// A row of any element: its scalars in the order of the properties, and its corners.
struct Element {
    scalars: Vec<f64>,
    ring: Vec<u32>,
}

macro_rules! scalars {
    ($($set:ident: $t:ty),*) => {$(
        fn $set(&mut self, _: &str, value: $t) -> PropertyAccessResult {
            self.scalars.push(value.into());
            PropertyAccessResult::Set
        }
    )*};
}
macro_rules! lists {
    ($($set:ident: $t:ty),*) => {$(
        fn $set(&mut self, name: &str, values: Vec<$t>) -> PropertyAccessResult {
            if !matches!(name, "vertex_indices" | "vertex_index") {
                return PropertyAccessResult::Ignored;
            }
            // A negative corner is out of range, and is told so with all the others.
            let corner = |v| u32::try_from(v).unwrap_or(u32::MAX);
            self.ring = values.into_iter().map(corner).collect();
            PropertyAccessResult::Set
        }
    )*};
}

impl PropertyAccess for Element {
    fn new() -> Self {
        Self {
            scalars: Vec::new(),
            ring: Vec::new(),
        }
    }
    scalars! {
        set_char: i8, set_uchar: u8, set_short: i16, set_ushort: u16, set_int: i32, set_uint: u32,
        set_float: f32, set_double: f64
    }
    lists! {
        set_list_char: i8, set_list_uchar: u8, set_list_short: i16, set_list_ushort: u16,
        set_list_int: i32, set_list_uint: u32
    }
}
