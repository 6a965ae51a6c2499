//! VTK's unstructured grids of Bézier quadrilaterals (cell type 77), which ParaView 5.10 and later draws as the curved
//! surface they are.
//!
//! Text throughout: numbers are as Rust writes them, which is the shortest text that is read as the same number.

use std::io::{self, Write};

use crate::Surface;
use crate::surface::POINTS;

/// VTK's order of the points of a bicubic cell: corners; the insides of sides 0, 1, 2 and 3 by ascending parameters; the
/// inside.
const ORDER: [usize; POINTS] = [0, 3, 15, 12, 1, 2, 7, 11, 13, 14, 4, 8, 5, 6, 9, 10];

/// Writes the patches of a surface, 16 points each, with values per element of its T-mesh.
///
/// Points are not shared between cells: those on either side of a T-junction have different ones. Besides `fields`,
/// which are repeated on all patches of an element, there are the cell arrays `level` and `element`.
///
/// # Errors
/// Those of `out`; invalid input for values that are not one per element.
pub fn write(out: &mut dyn Write, surface: &Surface, fields: &[(&str, &[f64])]) -> io::Result<()> {
    let elements = surface.mesh().elements().len();
    if let Some((name, values)) = fields.iter().find(|f| f.1.len() != elements) {
        let what = format!("{} values {name} for {elements} elements", values.len());
        return Err(io::Error::new(io::ErrorKind::InvalidInput, what));
    }
    let patches = surface.extraction().patches();
    let cells = patches.len();
    writeln!(
        out,
        "<?xml version=\"1.0\"?>\n\
         <VTKFile type=\"UnstructuredGrid\" version=\"2.2\" byte_order=\"LittleEndian\">\n\
         <UnstructuredGrid>\n<Piece NumberOfPoints=\"{}\" NumberOfCells=\"{cells}\">",
        POINTS * cells
    )?;
    let ordered = || surface.patches().iter().flat_map(|p| ORDER.map(|b| p[b]));
    writeln!(out, "<PointData RationalWeights=\"RationalWeights\">")?;
    array(
        out,
        "Float64",
        "RationalWeights",
        1,
        ordered().map(|p| p[3]),
    )?;
    writeln!(
        out,
        "</PointData>\n<CellData HigherOrderDegrees=\"HigherOrderDegrees\">"
    )?;
    let degrees = (0..cells).flat_map(|_| [3.0, 3.0, 0.0]);
    array(out, "Float64", "HigherOrderDegrees", 3, degrees)?;
    let level = |p: &crate::surface::Patch| surface.mesh().elements()[p.element as usize].level;
    let whole = |name: &str| format!("Name=\"{name}\" type=\"Int32\"");
    writeln!(out, "<DataArray {} format=\"ascii\">", whole("level"))?;
    whole_numbers(out, patches.iter().map(|p| level(p).into()))?;
    writeln!(out, "<DataArray {} format=\"ascii\">", whole("element"))?;
    whole_numbers(out, patches.iter().map(|p| p.element as usize))?;
    for (name, values) in fields {
        let of_patches = patches.iter().map(|p| values[p.element as usize]);
        array(out, "Float64", &escaped(name), 1, of_patches)?;
    }
    writeln!(out, "</CellData>\n<Points>")?;
    let places = ordered().flat_map(|[x, y, z, w]| [x / w, y / w, z / w]);
    array(out, "Float64", "Points", 3, places)?;
    writeln!(out, "</Points>\n<Cells>")?;
    writeln!(
        out,
        "<DataArray {} format=\"ascii\">",
        whole("connectivity")
    )?;
    whole_numbers(out, 0..POINTS * cells)?;
    writeln!(out, "<DataArray {} format=\"ascii\">", whole("offsets"))?;
    whole_numbers(out, (1..=cells).map(|c| POINTS * c))?;
    writeln!(
        out,
        "<DataArray Name=\"types\" type=\"UInt8\" format=\"ascii\">"
    )?;
    whole_numbers(out, (0..cells).map(|_| 77))?;
    writeln!(out, "</Cells>\n</Piece>\n</UnstructuredGrid>\n</VTKFile>")
}

/// A name as the value of an attribute.
fn escaped(name: &str) -> String {
    let replaced = |c: char| match c {
        '&' | '<' | '>' | '"' => format!("&#{};", u32::from(c)),
        c if c.is_control() => " ".to_owned(),
        c => c.to_string(),
    };
    name.chars().map(replaced).collect()
}

/// A `DataArray` of floating-point numbers, so many components each.
fn array(
    out: &mut dyn Write,
    kind: &str,
    name: &str,
    components: usize,
    values: impl Iterator<Item = f64>,
) -> io::Result<()> {
    let (head, count) = ("DataArray", "NumberOfComponents");
    writeln!(
        out,
        "<{head} Name=\"{name}\" type=\"{kind}\" {count}=\"{components}\" format=\"ascii\">"
    )?;
    for (i, x) in values.enumerate() {
        let end = if i % 12 == 11 { '\n' } else { ' ' };
        write!(out, "{x:e}{end}")?;
    }
    writeln!(out, "\n</{head}>")
}

/// The rest of a `DataArray` of integers.
fn whole_numbers(out: &mut dyn Write, values: impl Iterator<Item = usize>) -> io::Result<()> {
    for (i, x) in values.enumerate() {
        let end = if i % 20 == 19 { '\n' } else { ' ' };
        write!(out, "{x}{end}")?;
    }
    writeln!(out, "\n</DataArray>")
}
