//! VTU: VTK's XML file for unstructured grids, read by ParaView, VTK and meshio.
//!
//! The file is a short text that says which arrays there are, followed by their bytes. `Points` has three numbers per point.
//! Cells are three arrays, as VTK keeps them: `connectivity`, the corners of all cells one after the other, `offsets`, where each
//! cell's corners end, and `types`, VTK's numbers of kinds (5 triangle, 7 polygon, 9 quad, 10 tetrahedron). Below `PointData`
//! and `CellData` stands an array per field.
//!
//! Written with appended raw data (little-endian, 64-bit sizes): points, cells, point and cell
//! fields by name; groups as the cell field `group` (the group's tag, 0 for none) and, per group, a pair
//! `(tag, dimension)` of that name in the field data. Colours become the point field `color`.
//! Read with ASCII, base64 or appended data, with or without zlib compression, in both byte orders.

use std::borrow::Cow;
use std::fmt::Write as _;
use std::io::{Read, Write};
use std::path::Path;

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD as BASE64;
use roxmltree::{Document, Node};

use crate::Point3;
use crate::io::bytes::{Bytes, Scalar, put_all};
use crate::io::text::Words;
use crate::io::view::{
    Cells, Field, Group, NO_GROUP, Numbers, Values, View, block_of_rings, each_type, one_each,
};
use crate::io::{Error, ErrorKind, MAX_BYTES, read_bytes};

const TRIANGLE: u8 = 5;
const POLYGON: u8 = 7;
const QUAD: u8 = 9;
const TETRA: u8 = 10;
const GROUP: &str = "group";
const COLOR: &str = "color";
/// The point field with the number that each vertex has among those of all parts of a mesh; VTK takes it as that.
pub const GLOBAL_IDS: &str = "GlobalNodeIds";
/// The point and cell field (u8) that marks copies of what another part owns: 1.
pub const GHOSTS: &str = "vtkGhostType";

fn global_ids() -> String {
    format!(" GlobalIds=\"{GLOBAL_IDS}\"")
}

/// Writes the file that joins some parts, `PVTU`: their names as seen from its folder, with the fields of `part`, which
/// all of them have, and with its groups. Copies of what another part owns are marked in a field [`GHOSTS`].
///
/// Nothing is said of points or cells: those are in the parts. `part` may be any of them, also one without cells.
///
/// # Errors
/// Those of [`crate::io::save`].
pub fn save_parts(path: impl AsRef<Path>, part: &View<'_>, names: &[String]) -> Result<(), Error> {
    crate::io::save(path, |w| {
        let mut text = String::from(
            "<?xml version=\"1.0\"?>\n<VTKFile type=\"PUnstructuredGrid\" version=\"1.0\" \
             byte_order=\"LittleEndian\" header_type=\"UInt64\">\n<PUnstructuredGrid GhostLevel=\"1\">\n\
             <PPoints>\n<PDataArray type=\"Float64\" Name=\"Points\" NumberOfComponents=\"3\"/>\n</PPoints>\n",
        );
        put_names(&mut text, part, &part.tags());
        let mut fields = |kind: &str, attributes: &str, fields: &[Field<'_>]| {
            let _ = writeln!(text, "<{kind}{attributes}>");
            for field in fields {
                let (of, name) = (
                    kind_and_bytes(&field.values.numbers).0,
                    escaped(&field.name),
                );
                let k = field.values.components;
                let _ = writeln!(
                    text,
                    "<PDataArray type=\"{of}\" Name=\"{name}\" NumberOfComponents=\"{k}\"/>"
                );
            }
            let _ = writeln!(text, "</{kind}>");
        };
        let ids = part.find_point_field(GLOBAL_IDS).map(|_| global_ids());
        fields("PPointData", &ids.unwrap_or_default(), &part.point_fields);
        let grouped = (!part.groups.is_empty()).then(|| Field {
            name: GROUP.to_owned(),
            values: Values {
                components: 1,
                numbers: Numbers::I32(Cow::default()),
            },
        });
        fields(
            "PCellData",
            "",
            &[&part.cell_fields[..], grouped.as_slice()].concat(),
        );
        for name in names {
            let _ = writeln!(text, "<Piece Source=\"{}\"/>", escaped(name));
        }
        text.push_str("</PUnstructuredGrid>\n</VTKFile>\n");
        Ok(w.write_all(text.as_bytes())?)
    })
}

/// Writes a view to a file, whole or not at all.
pub fn save(path: impl AsRef<Path>, view: &View<'_>) -> Result<(), Error> {
    crate::io::save(path, |w| write(w, view))
}

/// Writes a view.
///
/// Types of fields are kept. Corners are counted with 32 bits as long as these suffice. Of names, control characters
/// become blanks.
///
/// # Errors
/// [`ErrorKind::Expected`] and [`ErrorKind::Mesh`] if the parts of the view do not fit each other; else what the writer
/// gives.
pub fn write(w: &mut dyn Write, view: &View<'_>) -> Result<(), Error> {
    view.check()?;
    let cells = view.cells();
    let corners: usize = view
        .blocks
        .iter()
        .map(|b| b.iter().map(<[u32]>::len).sum::<usize>())
        .sum();
    // Every program reads 32-bit integers; 64 bits only where they are needed.
    let wide = corners.max(view.points.len()) > i32::MAX as usize;
    let (index, index_width) = if wide { ("Int64", 8) } else { ("Int32", 4) };

    let mut header = String::new();
    let mut offset = 0u64;
    // Arrays lie behind the header, one after the other, each after 8 bytes that say its length: the header is
    // written with the offsets that they will have.
    let mut array = |header: &mut String, kind: &str, name: &str, k: usize, bytes: usize| {
        let name = escaped(name);
        // One component is what is meant where none is told; told, some readers make columns of it.
        let components = match k {
            1 => String::new(),
            _ => format!(" NumberOfComponents=\"{k}\""),
        };
        let _ = writeln!(
            header,
            "<DataArray type=\"{kind}\" Name=\"{name}\"{components} \
             format=\"appended\" offset=\"{offset}\"/>"
        );
        offset += 8 + bytes as u64;
    };
    let tags = view.tags();
    let group_numbers = grouped(view, &tags);
    let colors: Option<Values<'_>> = view.colors.as_ref().map(|c| c.as_ref().into());
    let fields = |header: &mut String,
                  array: &mut dyn FnMut(&mut String, &str, &str, usize, usize),
                  fields: &[Field<'_>]| {
        for field in fields {
            let (kind, bytes) = kind_and_bytes(&field.values.numbers);
            array(header, kind, &field.name, field.values.components, bytes);
        }
    };

    header.push_str(
        "<?xml version=\"1.0\"?>\n<VTKFile type=\"UnstructuredGrid\" version=\"1.0\" \
         byte_order=\"LittleEndian\" header_type=\"UInt64\">\n<UnstructuredGrid>\n",
    );
    if group_numbers.is_some() {
        put_names(&mut header, view, &tags);
    }
    let _ = writeln!(
        header,
        "<Piece NumberOfPoints=\"{}\" NumberOfCells=\"{cells}\">\n<Points>",
        view.points.len()
    );
    // Points, cells, values per point and per cell, in this order; the arrays follow in the same.
    array(&mut header, "Float64", "Points", 3, 24 * view.points.len());
    header.push_str("</Points>\n<Cells>\n");
    array(&mut header, index, "connectivity", 1, index_width * corners);
    array(&mut header, index, "offsets", 1, index_width * cells);
    array(&mut header, "UInt8", "types", 1, cells);
    let ids = view.find_point_field(GLOBAL_IDS).map(|_| global_ids());
    let _ = writeln!(header, "</Cells>\n<PointData{}>", ids.unwrap_or_default());
    fields(&mut header, &mut array, &view.point_fields);
    if colors.is_some() {
        array(&mut header, "UInt8", COLOR, 4, 4 * view.points.len());
    }
    header.push_str("</PointData>\n<CellData>\n");
    fields(&mut header, &mut array, &view.cell_fields);
    if group_numbers.is_some() {
        array(&mut header, "Int32", GROUP, 1, 4 * cells);
    }
    header
        .push_str("</CellData>\n</Piece>\n</UnstructuredGrid>\n<AppendedData encoding=\"raw\">\n_");
    w.write_all(header.as_bytes())?;

    // What was announced, byte for byte.
    let points = view.points.iter().flat_map(|p| [p.x, p.y, p.z]);
    sized(w, 24 * view.points.len(), points)?;
    let connectivity = view.blocks.iter().flat_map(|b| b.iter().flatten().copied());
    let mut end = 0;
    let ends = view.blocks.iter().flat_map(Cells::iter).map(|ring| {
        end += ring.len() as u64;
        end
    });
    if wide {
        sized(w, 8 * corners, connectivity.map(i64::from))?;
        sized(w, 8 * cells, ends)?;
    } else {
        sized(w, 4 * corners, connectivity)?;
        sized(w, 4 * cells, ends.map(|e| e as u32))?;
    }
    // VTK's number of each kind of cell.
    let types = view.blocks.iter().flat_map(|b| {
        let kind = match b {
            Cells::Triangles(_) => TRIANGLE,
            Cells::Quads(_) => QUAD,
            Cells::Polygons { .. } => POLYGON,
            Cells::Tets(_) => TETRA,
        };
        std::iter::repeat_n(kind, b.len())
    });
    sized(w, cells, types)?;
    let put_values = |w: &mut dyn Write, values: &Values<'_>| {
        let (_, bytes) = kind_and_bytes(&values.numbers);
        each_type!(&values.numbers, n => sized(w, bytes, n.iter().copied()))
    };
    for field in &view.point_fields {
        put_values(w, &field.values)?;
    }
    if let Some(colors) = &colors {
        put_values(w, colors)?;
    }
    for field in &view.cell_fields {
        put_values(w, &field.values)?;
    }
    if let Some(numbers) = group_numbers {
        sized(w, 4 * cells, numbers)?;
    }
    w.write_all(b"\n</AppendedData>\n</VTKFile>\n")?;
    Ok(())
}

/// The tag of each cell's group, 0 for none; `None` if the view has no groups. One without cells may have some: a part
/// of a mesh, whose other parts have cells of them.
fn grouped<'v>(view: &'v View<'_>, tags: &'v [i32]) -> Option<impl Iterator<Item = u32> + 'v> {
    let tag = move |&g: &u32| tags.get(g as usize).map_or(0, |&tag| tag as u32);
    let empty = view.cells() == 0 && !view.groups.is_empty();
    (!view.group_of.is_empty() || empty).then(|| view.group_of.iter().map(tag))
}

/// The names of groups as field data.
fn put_names(header: &mut String, view: &View<'_>, tags: &[i32]) {
    if view.groups.is_empty() {
        return;
    }
    header.push_str("<FieldData>\n");
    for (tag, group) in tags.iter().zip(&view.groups) {
        // As text, because meshio does not look for field data in the appended part.
        let (name, dimension) = (escaped(&group.name), group.dimension);
        let _ = writeln!(
            header,
            "<DataArray type=\"Int32\" Name=\"{name}\" NumberOfComponents=\"1\" \
             NumberOfTuples=\"2\" format=\"ascii\">\n{tag} {dimension}\n</DataArray>"
        );
    }
    header.push_str("</FieldData>\n");
}

/// One appended array: its length in bytes, then the bytes.
fn sized<T: Scalar>(
    w: &mut dyn Write,
    bytes: usize,
    numbers: impl Iterator<Item = T>,
) -> Result<(), Error> {
    w.write_all(&(bytes as u64).to_le_bytes())?;
    put_all(w, numbers)
}

/// VTK's name of the type, and how much an array takes.
fn kind_and_bytes(numbers: &Numbers<'_>) -> (&'static str, usize) {
    match numbers {
        Numbers::F32(n) => ("Float32", 4 * n.len()),
        Numbers::F64(n) => ("Float64", 8 * n.len()),
        Numbers::U8(n) => ("UInt8", n.len()),
        Numbers::U32(n) => ("UInt32", 4 * n.len()),
        Numbers::I32(n) => ("Int32", 4 * n.len()),
        Numbers::I64(n) => ("Int64", 8 * n.len()),
    }
}

/// As XML wants an attribute.
fn escaped(name: &str) -> String {
    let mut out = String::with_capacity(name.len());
    for c in name.chars() {
        match c {
            '&' => out.push_str("&amp;"),
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            '"' => out.push_str("&quot;"),
            c if c.is_control() => out.push(' '),
            c => out.push(c),
        }
    }
    out
}

/// Reads a file.
pub fn read(path: impl AsRef<Path>) -> Result<View<'static>, Error> {
    let path = path.as_ref();
    parse(&read_bytes(path)?).map_err(|e| e.in_file(path))
}

/// Reads a view from the bytes of a file. Cells are triangles, quads, polygons and tetrahedra; a file
/// with others, or with more than one piece, is refused.
///
/// Runs of faces and of tetrahedra become blocks. Whole numbers of 8 and 16 bits (but for unsigned bytes) become i32,
/// those of 64 bits the narrowest of i32, u32, i64 and f64 that holds all of the array. Field data that are not ours
/// are passed over.
///
/// # Errors
/// With the line, where there is one: [`ErrorKind::Expected`] for what is no XML, no VTU, or an array that is not what
/// its element says. [`ErrorKind::Unsupported`] for several pieces, other cells, or another compressor;
/// [`ErrorKind::Truncated`] for arrays that end early; [`ErrorKind::Mesh`] for corners out of range and points that are
/// not finite.
pub fn parse(bytes: &[u8]) -> Result<View<'static>, Error> {
    let (xml, appended) = split_appended(bytes)?;
    let document = Document::parse(&xml).map_err(|e| {
        let kind = ErrorKind::expected("well-formed XML", e.to_string());
        Error::at_line(kind, e.pos().row as usize)
    })?;
    // What the arrays are: order and width of numbers, compressed or not.
    let file = document.root_element();
    if !file.has_tag_name("VTKFile") || file.attribute("type") != Some("UnstructuredGrid") {
        let found = file.attribute("type").unwrap_or(file.tag_name().name());
        return Err(ErrorKind::expected("a VTKFile of type UnstructuredGrid", found).into());
    }
    let reader = Arrays {
        document: &document,
        little: file.attribute("byte_order") != Some("BigEndian"),
        wide: file.attribute("header_type") == Some("UInt64"),
        compressed: match file.attribute("compressor") {
            None | Some("") => false,
            Some("vtkZLibDataCompressor") => true,
            Some(other) => {
                let what = format!("compression by {other} is not read; use vtkZLibDataCompressor");
                return Err(ErrorKind::Unsupported(what).into());
            }
        },
        appended,
    };
    // One piece of one grid is a mesh.
    let grid = child(&document, file, "UnstructuredGrid")?;
    let piece = child(&document, grid, "Piece")?;
    if grid.children().filter(|n| n.has_tag_name("Piece")).count() > 1 {
        let what = "a file of several pieces is not read; merge them first".to_owned();
        return Err(ErrorKind::Unsupported(what).into());
    }

    let point_array = child(&document, child(&document, piece, "Points")?, "DataArray")?;
    let points = reader.numbers(point_array)?;
    if points.components != 3 {
        let found = points.components.to_string();
        return Err(reader.at(point_array, ErrorKind::expected("3 components", found)));
    }
    let points: Vec<Point3> = (0..points.len())
        .map(|i| Point3::new(points.get(i, 0), points.get(i, 1), points.get(i, 2)))
        .collect();

    // Cells are three arrays: corners, where each cell's corners end, and VTK's kinds.
    let cells = child(&document, piece, "Cells")?;
    let named = |name: &str| {
        arrays(cells)
            .find(|n| n.attribute("Name") == Some(name))
            .ok_or_else(|| missing(&document, cells, name))
    };
    let connectivity = reader.indices(named("connectivity")?)?;
    let ends = reader.indices(named("offsets")?)?;
    let types = reader.indices(named("types")?)?;
    let blocks = blocks(&connectivity, &ends, &types)?;

    let mut view = View {
        points: points.into(),
        blocks,
        ..View::default()
    };
    // Values by name, whatever their type.
    let fields = |of: &str| -> Result<Vec<Field<'static>>, Error> {
        let of = piece.children().filter(|n| n.has_tag_name(of));
        of.flat_map(arrays)
            .map(|n| {
                let name = n.attribute("Name").unwrap_or("unnamed").to_owned();
                let values = reader.numbers(n)?;
                Ok(Field { name, values })
            })
            .collect()
    };
    view.point_fields = fields("PointData")?;
    view.cell_fields = fields("CellData")?;
    // A field of four bytes of our name is the colour, not a field.
    let is_color = |f: &Field<'_>| {
        let bytes = matches!(f.values.numbers, Numbers::U8(_));
        f.name == COLOR && bytes && f.values.components == 4
    };
    if let Some(at) = view.point_fields.iter().rposition(is_color)
        && let Numbers::U8(n) = view.point_fields.remove(at).values.numbers
    {
        let (colors, _) = n.as_chunks();
        view.colors = Some(colors.to_vec().into());
    }
    // Regions by name, and a last look at all numbers together.
    groups(&reader, grid, &mut view)?;
    view.checked()
}

/// The groups that [`write`] wrote, if the file has them.
fn groups(reader: &Arrays<'_, '_>, grid: Node<'_, '_>, view: &mut View<'_>) -> Result<(), Error> {
    // Ours comes last, after a user's field of that name.
    let Some(at) = view.cell_fields.iter().rposition(|f| f.name == GROUP) else {
        return Ok(());
    };
    let data = grid.children().filter(|n| n.has_tag_name("FieldData"));
    let mut groups: Vec<Group> = Vec::new();
    for array in data.flat_map(arrays) {
        // Field data of other programs may hold anything.
        if array.attribute("type") != Some("Int32") {
            continue;
        }
        let numbers = reader.numbers(array)?;
        if let (2, Numbers::I32(n)) = (numbers.len() * numbers.components, &numbers.numbers)
            && n[0] > 0
        {
            groups.push(Group {
                name: array.attribute("Name").unwrap_or("unnamed").to_owned(),
                dimension: n[1].clamp(0, 3) as u8,
                tag: Some(n[0]),
            });
        }
    }
    if groups.is_empty() {
        return Ok(());
    }
    let field = view.cell_fields.remove(at);
    one_each("one group for each cell", field.values.len(), view.cells())?;
    // Tags count for each dimension on its own.
    let blocks = view.blocks.iter();
    let dimensions = blocks.flat_map(|block| std::iter::repeat_n(block.dimension(), block.len()));
    let number_of = |(i, dimension): (usize, u8)| {
        let tag = field.values.get(i, 0);
        let is_it = |g: &Group| g.dimension == dimension && g.tag.map(f64::from) == Some(tag);
        groups.iter().position(is_it).map_or(NO_GROUP, |g| g as u32)
    };
    view.group_of = (0..field.values.len())
        .zip(dimensions)
        .map(number_of)
        .collect();
    view.groups = groups;
    Ok(())
}

/// The data arrays right below a node.
fn arrays<'a, 'i>(node: Node<'a, 'i>) -> impl Iterator<Item = Node<'a, 'i>> {
    node.children().filter(|n| n.has_tag_name("DataArray"))
}

/// The first child of this name.
fn child<'a, 'input>(
    document: &Document<'input>,
    node: Node<'a, 'input>,
    name: &str,
) -> Result<Node<'a, 'input>, Error> {
    let found = node.children().find(|n| n.has_tag_name(name));
    found.ok_or_else(|| missing(document, node, name))
}

/// In the line of the node that should have it.
fn missing(document: &Document<'_>, node: Node<'_, '_>, name: &str) -> Error {
    let line = document.text_pos_at(node.range().start).row as usize;
    let found = format!("<{}> without one", node.tag_name().name());
    Error::at_line(ErrorKind::expected(format!("<{name}>"), found), line)
}

/// Cells as blocks: runs of faces and runs of tetrahedra.
fn blocks(connectivity: &[u32], ends: &[u32], types: &[u32]) -> Result<Vec<Cells<'static>>, Error> {
    if ends.len() != types.len() {
        let expected = format!("{} offsets of cells", types.len());
        return Err(ErrorKind::expected(expected, ends.len().to_string()).into());
    }
    let mut blocks = Vec::new();
    let (mut rings, mut ring_ends) = (Vec::new(), Vec::new());
    let mut tets: Vec<[u32; 4]> = Vec::new();
    let mut start = 0;
    for (cell, (&end, &kind)) in ends.iter().zip(types).enumerate() {
        let corners = connectivity.get(start as usize..end as usize);
        let Some(corners) = corners else {
            let expected = format!("offset of cell {cell} in {start}…{}", connectivity.len());
            return Err(ErrorKind::expected(expected, end.to_string()).into());
        };
        start = end;
        let fits = match (u8::try_from(kind), corners.len()) {
            (Ok(TRIANGLE), n) => n == 3,
            (Ok(QUAD), n) | (Ok(TETRA), n) => n == 4,
            (Ok(POLYGON), n) => n >= 3,
            _ => {
                return Err(ErrorKind::Unsupported(format!(
                    "cell {cell} is of VTK type {kind}; only triangles (5), polygons (7), \
                     quads (9) and tetrahedra (10) are read"
                ))
                .into());
            }
        };
        if !fits {
            let expected = format!("corners of cell {cell} of VTK type {kind}");
            return Err(ErrorKind::expected(expected, corners.len().to_string()).into());
        }
        if kind == u32::from(TETRA) {
            if !ring_ends.is_empty() {
                blocks.push(block_of_rings(
                    std::mem::take(&mut ring_ends),
                    std::mem::take(&mut rings),
                ));
            }
            tets.push([corners[0], corners[1], corners[2], corners[3]]);
        } else {
            if !tets.is_empty() {
                blocks.push(Cells::Tets(std::mem::take(&mut tets).into()));
            }
            rings.extend_from_slice(corners);
            ring_ends.push(rings.len() as u32);
        }
    }
    if !ring_ends.is_empty() {
        blocks.push(block_of_rings(ring_ends, rings));
    }
    if !tets.is_empty() {
        blocks.push(Cells::Tets(tets.into()));
    }
    Ok(blocks)
}

/// The XML without its appended data, and these.
///
/// Raw data are no XML, so that the text is cut at the mark `_` that begins them and closed by hand. They are not
/// searched for an end: arrays have offsets and lengths.
fn split_appended(bytes: &[u8]) -> Result<(String, Appended<'_>), Error> {
    let text = |bytes: &[u8]| {
        let line = bytes.iter().filter(|&&b| b == b'\n').count();
        String::from_utf8(bytes.to_vec()).map_err(|e| {
            let valid = &bytes[..e.utf8_error().valid_up_to()];
            let here = line - bytes[valid.len()..].iter().filter(|&&b| b == b'\n').count();
            Error::at_line(ErrorKind::expected("text", "other bytes"), here + 1)
        })
    };
    let Some(tag) = position(bytes, b"<AppendedData") else {
        return Ok((text(bytes)?, Appended::None));
    };
    let truncated = || ErrorKind::Truncated("the appended data".to_owned());
    let after = tag + position(&bytes[tag..], b">").ok_or_else(truncated)? + 1;
    let start = after + position(&bytes[after..], b"_").ok_or_else(truncated)? + 1;
    let raw = position(&bytes[tag..after], b"base64").is_none();
    let data = &bytes[start..];
    let closing = "</AppendedData></VTKFile>";
    let xml = text(&bytes[..after])? + closing;
    let appended = if raw {
        Appended::Raw(data)
    } else {
        let end = position(data, b"<").unwrap_or(data.len());
        Appended::Base64(&data[..end])
    };
    Ok((xml, appended))
}

fn position(bytes: &[u8], what: &[u8]) -> Option<usize> {
    bytes.windows(what.len()).position(|w| w == what)
}

/// Data after the XML.
///
/// All without the mark in front.
#[derive(Clone, Copy)]
enum Appended<'a> {
    None,
    Raw(&'a [u8]),
    Base64(&'a [u8]),
}

/// Decodes data arrays.
struct Arrays<'d, 'a> {
    document: &'d Document<'d>,
    little: bool,
    /// Sizes have 64 bits, not 32.
    wide: bool,
    compressed: bool,
    appended: Appended<'a>,
}

impl Arrays<'_, '_> {
    fn at(&self, node: Node<'_, '_>, kind: impl Into<ErrorKind>) -> Error {
        let line = self.document.text_pos_at(node.range().start).row as usize;
        Error::at_line(kind, line)
    }

    /// The numbers of an array, in the nearest of our types.
    fn numbers(&self, node: Node<'_, '_>) -> Result<Values<'static>, Error> {
        let components = match node.attribute("NumberOfComponents") {
            None => 1,
            Some(k) => match k.parse() {
                Ok(k @ 1..=1024) => k,
                _ => {
                    let expected = "a number of components";
                    return Err(self.at(node, ErrorKind::expected(expected, k)));
                }
            },
        };
        let numbers = match node.attribute("type").unwrap_or_default() {
            "Float32" => Numbers::F32(self.decode::<f32>(node)?.into()),
            "Float64" => Numbers::F64(self.decode::<f64>(node)?.into()),
            "UInt8" => Numbers::U8(self.decode::<u8>(node)?.into()),
            "UInt32" => Numbers::U32(self.decode::<u32>(node)?.into()),
            "Int32" => Numbers::I32(self.decode::<i32>(node)?.into()),
            "Int8" => narrowed(self.decode::<i8>(node)?),
            "Int16" => narrowed(self.decode::<i16>(node)?),
            "UInt16" => narrowed(self.decode::<u16>(node)?),
            "Int64" => narrowed(self.decode::<i64>(node)?),
            "UInt64" => narrowed(self.decode::<u64>(node)?),
            other => {
                let expected = "a type such as Float64 or Int32";
                return Err(self.at(node, ErrorKind::expected(expected, other)));
            }
        };
        let len = each_type!(&numbers, n => n.len());
        if len % components != 0 {
            let expected = format!("a multiple of {components} numbers");
            return Err(self.at(node, ErrorKind::expected(expected, len.to_string())));
        }
        Ok(Values {
            components,
            numbers,
        })
    }

    /// An array of numbers that index something.
    fn indices(&self, node: Node<'_, '_>) -> Result<Vec<u32>, Error> {
        let values = self.numbers(node)?;
        let wrong = |n: String| self.at(node, ErrorKind::expected("an index", n));
        match values.numbers {
            Numbers::U32(n) => Ok(n.into_owned()),
            Numbers::U8(n) => Ok(n.iter().map(|&i| i.into()).collect()),
            Numbers::I32(n) => n
                .iter()
                .map(|&i| u32::try_from(i).map_err(|_| wrong(i.to_string())))
                .collect(),
            Numbers::I64(n) => Err(wrong(n.first().map_or(String::new(), i64::to_string))),
            Numbers::F64(n) => Err(wrong(n.first().map_or(String::new(), f64::to_string))),
            Numbers::F32(n) => Err(wrong(n.first().map_or(String::new(), f32::to_string))),
        }
    }

    /// In whichever of the four ways an array stands in the file. Errors have the line of its element, those of text
    /// the line of the word.
    fn decode<T: Scalar + std::str::FromStr>(&self, node: Node<'_, '_>) -> Result<Vec<T>, Error> {
        let here = |e: Error| {
            if e.line.is_some() {
                e
            } else {
                self.at(node, e.kind)
            }
        };
        let bytes = match node.attribute("format").unwrap_or("ascii") {
            "ascii" => {
                let line = self.document.text_pos_at(node.range().start).row as usize;
                let mut words = Words::new(node.text().unwrap_or_default().as_bytes());
                let mut numbers = Vec::new();
                while let Some(word) = words.next(false) {
                    let number = words.parsed(word, "a number").map_err(|e| Error {
                        line: e.line.map(|l| l + line - 1),
                        ..e
                    })?;
                    numbers.push(number);
                }
                return Ok(numbers);
            }
            "binary" => {
                let text = node.text().unwrap_or_default().as_bytes();
                self.unpack_base64(text).map_err(here)?
            }
            "appended" => {
                let offset = node.attribute("offset").unwrap_or_default();
                let from = offset.parse::<usize>().ok();
                let wrong = || self.at(node, ErrorKind::expected("an offset", offset));
                match self.appended {
                    Appended::None => {
                        let kind = ErrorKind::Truncated("the appended data".to_owned());
                        return Err(self.at(node, kind));
                    }
                    Appended::Raw(data) => {
                        let data = from.and_then(|f| data.get(f..)).ok_or_else(wrong)?;
                        self.unpack(data).map_err(here)?
                    }
                    Appended::Base64(data) => {
                        let data = from.and_then(|f| data.get(f..)).ok_or_else(wrong)?;
                        self.unpack_base64(data).map_err(here)?
                    }
                }
            }
            other => {
                let expected = "format ascii, binary or appended";
                return Err(self.at(node, ErrorKind::expected(expected, other)));
            }
        };
        if bytes.len() % T::WIDTH != 0 {
            let expected = format!("a multiple of {} bytes", T::WIDTH);
            return Err(self.at(node, ErrorKind::expected(expected, bytes.len().to_string())));
        }
        Ok(bytes
            .chunks_exact(T::WIDTH)
            .map(|b| T::get(b, self.little))
            .collect())
    }

    /// A length, in bytes, in front of an array or block.
    fn size(&self, bytes: &mut Bytes<'_>) -> Result<usize, Error> {
        let what = "the size of a data array";
        let size = if self.wide {
            bytes.one::<u64>(what)?
        } else {
            bytes.one::<u32>(what)?.into()
        };
        usize::try_from(size)
            .map_err(|_| ErrorKind::TooLarge(format!("a data array of {size} bytes")).into())
    }

    /// The data after their sizes.
    fn unpack(&self, data: &[u8]) -> Result<Vec<u8>, Error> {
        const WHAT: &str = "a data array";
        let mut bytes = Bytes::new(data, self.little);
        if !self.compressed {
            let size = self.size(&mut bytes)?;
            return Ok(bytes.take(size, WHAT)?.to_vec());
        }
        let sizes = self.block_sizes(&mut bytes)?;
        self.inflate(&sizes, bytes.rest())
    }

    /// Sizes of the compressed blocks, after their number and the size of a whole one and of the last one, unpacked.
    fn block_sizes(&self, bytes: &mut Bytes<'_>) -> Result<Blocks, Error> {
        let blocks = self.size(bytes)?;
        let unpacked = self.size(bytes)?.max(self.size(bytes)?);
        let width = if self.wide { 8 } else { 4 };
        if blocks > bytes.rest().len() / width {
            return Err(ErrorKind::Truncated("the sizes of compressed blocks".to_owned()).into());
        }
        let packed = (0..blocks).map(|_| self.size(bytes));
        Ok(Blocks {
            packed: packed.collect::<Result<_, _>>()?,
            unpacked,
        })
    }

    /// Blocks of zlib data, one after another.
    fn inflate(&self, blocks: &Blocks, data: &[u8]) -> Result<Vec<u8>, Error> {
        let mut data = Bytes::new(data, self.little);
        let mut out = Vec::new();
        // A few bytes can unpack to very many: no block has more than its file says, nor an array more than a file may.
        let most = (blocks.unpacked as u64).min(MAX_BYTES);
        for &size in &blocks.packed {
            let block = data.take(size, "a compressed block")?;
            let found = flate2::read::ZlibDecoder::new(block)
                .take(most + 1)
                .read_to_end(&mut out)
                .map_err(|e| ErrorKind::expected("zlib data", e.to_string()))?;
            if found as u64 > most || out.len() as u64 > MAX_BYTES {
                let what = format!("a compressed block of more than {most} bytes, the size of one");
                return Err(ErrorKind::TooLarge(what).into());
            }
        }
        Ok(out)
    }

    /// As [`Arrays::unpack`], from base64. Compressed data have their sizes in a part of their own.
    fn unpack_base64(&self, text: &[u8]) -> Result<Vec<u8>, Error> {
        // Appended arrays come with all that follow, of which only the first bytes are meant.
        let decode = |from: usize, bytes: usize| -> Result<Vec<u8>, Error> {
            let length = bytes.div_ceil(3).checked_mul(4);
            let length =
                length.filter(|n| from.checked_add(*n).is_some_and(|end| end <= text.len()));
            let length = length.ok_or_else(|| ErrorKind::Truncated("base64 data".to_owned()))?;
            let letters = text.iter().copied().filter(|b| !b.is_ascii_whitespace());
            let part: Vec<u8> = letters.skip(from).take(length).collect();
            if part.len() < length {
                return Err(ErrorKind::Truncated("base64 data".to_owned()).into());
            }
            let mut out = BASE64
                .decode(part)
                .map_err(|e| ErrorKind::expected("base64 data", e.to_string()))?;
            if out.len() < bytes {
                return Err(ErrorKind::Truncated("base64 data".to_owned()).into());
            }
            out.truncate(bytes);
            Ok(out)
        };
        let width = if self.wide { 8 } else { 4 };
        if !self.compressed {
            let head = decode(0, width)?;
            let size = self.size(&mut Bytes::new(&head, self.little))?;
            let whole = size
                .checked_add(width)
                .ok_or_else(|| ErrorKind::TooLarge(format!("a data array of {size} bytes")))?;
            return self.unpack(&decode(0, whole)?);
        }
        let head = decode(0, width)?;
        let blocks = self.size(&mut Bytes::new(&head, self.little))?;
        let head_size = blocks
            .checked_add(3)
            .and_then(|n| n.checked_mul(width))
            .ok_or_else(|| ErrorKind::TooLarge(format!("{blocks} compressed blocks")))?;
        let head = decode(0, head_size)?;
        let sizes = self.block_sizes(&mut Bytes::new(&head, self.little))?;
        let total = sizes
            .packed
            .iter()
            .try_fold(0usize, |sum, &s| sum.checked_add(s))
            .ok_or_else(|| ErrorKind::TooLarge("compressed blocks".to_owned()))?;
        self.inflate(&sizes, &decode(head_size.div_ceil(3) * 4, total)?)
    }
}

/// Blocks of zlib data.
struct Blocks {
    /// Their sizes in the file.
    packed: Vec<usize>,
    /// The most bytes that one of them unpacks to.
    unpacked: usize,
}

/// Integers as i32 if they fit, then as u32, then as i64, else as f64.
fn narrowed<T: Copy>(numbers: Vec<T>) -> Numbers<'static>
where
    i128: From<T>,
{
    let all = || numbers.iter().map(|&n| i128::from(n));
    if all().all(|n| i32::try_from(n).is_ok()) {
        Numbers::I32(all().map(|n| n as i32).collect())
    } else if all().all(|n| u32::try_from(n).is_ok()) {
        Numbers::U32(all().map(|n| n as u32).collect())
    } else if all().all(|n| i64::try_from(n).is_ok()) {
        Numbers::I64(all().map(|n| n as i64).collect())
    } else {
        Numbers::F64(all().map(|n| n as f64).collect())
    }
}
