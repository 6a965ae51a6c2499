//! MSH: Gmsh's mesh file, versions 4.1 and 2.2, for solvers.
//!
//! A file is a row of sections. Those that are written, and what stands in them:
//!
//! | section | 4.1 | 2.2 |
//! |---|---|---|
//! | `$MeshFormat` | version, 0 for text or 1 for bytes, size of a number | the same |
//! | `$PhysicalNames` | dimension, number and name of each group | the same |
//! | `$Entities` | one volume or surface per group, with the surfaces that bound each volume | (none) |
//! | `$Nodes` | points, numbered from 1 | the same |
//! | `$Elements` | cells by entity | cells, each with the numbers of its group and entity |
//! | `$NodeData`, `$ElementData` | a field: name, components, and values by number | the same |
//!
//! What reads 2.2 only (older solvers) finds the same mesh there, but finds which volume a surface
//! bounds only by looking at the corners.
//!
//! Groups are written as named physical groups of volumes and faces, fields as `NodeData` and
//! `ElementData`. Colours are left out. Cells are sorted by block and group, and numbered and given their
//! values in that order, because some readers count elements instead of looking at their tags. Points
//! and lines of a file are skipped when it is read.
//!
//! ```
//! use geom_core::io::{Encoding, View, msh};
//! use geom_core::mesh::shapes;
//!
//! // Two materials by name, as text for a solver that reads 2.2 only.
//! let mesh = shapes::ball_in_box(2.0, 4.0, 2);
//! let view = View::of_tets(&mesh, &[(0, "water"), (1, "protein")]);
//! let options = msh::Options { version: msh::Version::V22, encoding: Encoding::Ascii };
//! let mut bytes = Vec::new();
//! msh::write(&mut bytes, &view, options)?;
//! let text = String::from_utf8_lossy(&bytes);
//! assert!(text.starts_with("$MeshFormat\n2.2 0 8\n") && text.contains("\"protein\""));
//! let back = msh::parse(&bytes)?;
//! assert_eq!(back.points.len(), mesh.positions().len());
//! # Ok::<(), geom_core::io::Error>(())
//! ```

use std::io::Write;
use std::path::Path;

use crate::Point3;
use crate::io::bytes::{Bytes, Scalar, put_all};
use crate::io::text::Words;
use crate::io::view::{Cells, Field, Group, NO_CELL, NO_GROUP, Numbers, Values, View};
use crate::io::{Encoding, Error, ErrorKind, read_bytes};

/// A version of the format.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Version {
    /// 4.1, of Gmsh 4.
    #[default]
    V41,
    /// 2.2, which older solvers read.
    /// Which surface bounds which volume is not told there; groups and fields are.
    V22,
}

/// How to write.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Options {
    /// The version of the format.
    pub version: Version,
    /// Bytes or text.
    pub encoding: Encoding,
}

/// Writes a view to a file, whole or not at all.
pub fn save(path: impl AsRef<Path>, view: &View<'_>, options: Options) -> Result<(), Error> {
    crate::io::save(path, |w| write(w, view, options))
}

pub(super) const TRIANGLE: i32 = 2;
const QUAD: i32 = 3;
pub(super) const TETRA: i32 = 4;

/// A run of cells of one kind and one group, by their numbers.
///
/// A run is what 4.1 calls a block of elements.
struct Run {
    kind: i32,
    dimension: u8,
    /// Tag of the entity: number of the group + 1, or one more than groups.
    tag: i32,
    /// Tag of the physical group, 0 for none.
    physical: i32,
    group: u32,
    block: usize,
    /// Numbers in the block, and the number of the block's first cell.
    cells: Vec<u32>,
    first: usize,
    /// Number of the run's first cell in the file.
    start: usize,
}

/// Writes a view. Polygons with more than four corners are refused, as are fields of more than nine
/// components; fields of 2 or 4 … 8 are filled up with zeros to the next of 1, 3, 9.
///
/// Groups without a tag get one that is free. All entities have the bounding box of the whole. Cells without a group
/// belong to an entity of theirs, which has no physical group.
///
/// # Errors
/// [`ErrorKind::Unsupported`] for polygons and fields as above, [`ErrorKind::TooLarge`] beyond 2³¹ − 2 points or cells,
/// [`ErrorKind::Expected`] and [`ErrorKind::Mesh`] if the parts of the view do not fit each other.
pub fn write(w: &mut dyn Write, view: &View<'_>, options: Options) -> Result<(), Error> {
    view.check()?;
    let binary = options.encoding == Encoding::Binary;
    let (nodes, cells) = (view.points.len(), view.cells());
    let limit = i32::MAX as usize - 1;
    if nodes.max(cells) > limit {
        let what = format!(
            "{} elements; MSH counts them up to {limit}",
            nodes.max(cells)
        );
        return Err(ErrorKind::TooLarge(what).into());
    }
    let tags = view.tags();
    let runs = runs(view, &tags)?;
    let version = match options.version {
        Version::V41 => "4.1",
        Version::V22 => "2.2",
    };
    writeln!(w, "$MeshFormat\n{version} {} 8", i32::from(binary))?;
    if binary {
        w.write_all(&1i32.to_le_bytes())?;
        writeln!(w)?;
    }
    writeln!(w, "$EndMeshFormat")?;
    put_names(w, view, &tags)?;
    let mut out = Out { w, binary };
    match options.version {
        Version::V41 => write_41(&mut out, view, &runs)?,
        Version::V22 => write_22(&mut out, view, &runs)?,
    }
    for field in &view.point_fields {
        write_field(&mut out, "NodeData", field, (1..).zip(0..nodes))?;
    }
    for field in &view.cell_fields {
        let cells = runs.iter().flat_map(Run::numbers);
        write_field(&mut out, "ElementData", field, (1..).zip(cells))?;
    }
    Ok(())
}

/// The names of groups.
pub(super) fn put_names(w: &mut dyn Write, view: &View<'_>, tags: &[i32]) -> Result<(), Error> {
    if view.groups.is_empty() {
        return Ok(());
    }
    writeln!(w, "$PhysicalNames\n{}", view.groups.len())?;
    for (tag, group) in tags.iter().zip(&view.groups) {
        let name = group.name.replace(['"', '\n', '\r'], "'");
        writeln!(w, "{} {tag} \"{name}\"", group.dimension)?;
    }
    Ok(writeln!(w, "$EndPhysicalNames")?)
}

/// Numbers as bytes, or as words of a line.
pub(super) struct Out<'w> {
    pub(super) w: &'w mut dyn Write,
    pub(super) binary: bool,
}

impl Out<'_> {
    /// As text they stand in one line, parted by blanks; as bytes nothing parts them.
    pub(super) fn line<T: Scalar + std::fmt::Display>(
        &mut self,
        numbers: impl IntoIterator<Item = T>,
    ) -> Result<(), Error> {
        if self.binary {
            return put_all(self.w, numbers);
        }
        for (i, n) in numbers.into_iter().enumerate() {
            let blank = if i == 0 { "" } else { " " };
            write!(self.w, "{blank}{n}")?;
        }
        Ok(writeln!(self.w)?)
    }
    /// Integers of different widths, which only bytes tell apart.
    pub(super) fn mixed(&mut self, ints: &[i32], sizes: &[u64]) -> Result<(), Error> {
        if self.binary {
            put_all(self.w, ints.iter().copied())?;
            return put_all(self.w, sizes.iter().copied());
        }
        let words = ints.iter().map(i32::to_string);
        let words: Vec<_> = words.chain(sizes.iter().map(u64::to_string)).collect();
        Ok(writeln!(self.w, "{}", words.join(" "))?)
    }
    /// As bytes a section does not end with a line end by itself.
    pub(super) fn end(&mut self, section: &str) -> Result<(), Error> {
        let blank = if self.binary { "\n" } else { "" };
        Ok(writeln!(self.w, "{blank}$End{section}")?)
    }
}

impl Run {
    /// The view's numbers of its cells.
    fn numbers(&self) -> impl Iterator<Item = usize> {
        self.cells.iter().map(|&c| self.first + c as usize)
    }
}

/// Sorts the cells by block and group.
///
/// Within a block only, so that blocks stay in their order. The view's cells are not moved; runs list them.
fn runs(view: &View<'_>, tags: &[i32]) -> Result<Vec<Run>, Error> {
    let mut runs: Vec<Run> = Vec::new();
    let mut first = 0;
    for (block, cells) in view.blocks.iter().enumerate() {
        let new = runs.len();
        let mut last = new;
        for c in 0..cells.len() {
            let kind = match (cells, cells.corners(c).len()) {
                (Cells::Tets(_), _) => TETRA,
                (_, 3) => TRIANGLE,
                (_, 4) => QUAD,
                (_, n) => {
                    let what = format!("cell {} has {n} corners; MSH holds 3 or 4", first + c);
                    return Err(ErrorKind::Unsupported(what).into());
                }
            };
            let group = view.group_of.get(first + c).copied().unwrap_or(NO_GROUP);
            let same = |r: &Run| r.kind == kind && r.group == group;
            if !runs.get(last).is_some_and(same) {
                last = match runs[new..].iter().position(same) {
                    Some(at) => new + at,
                    None => {
                        let number = (group as usize).min(view.groups.len());
                        runs.push(Run {
                            kind,
                            dimension: cells.dimension(),
                            tag: number as i32 + 1,
                            physical: tags.get(number).copied().unwrap_or(0),
                            group,
                            block,
                            cells: Vec::new(),
                            first,
                            start: 0,
                        });
                        runs.len() - 1
                    }
                };
            }
            runs[last].cells.push(c as u32);
        }
        first += cells.len();
    }
    let mut start = 0;
    for run in &mut runs {
        run.start = start;
        start += run.cells.len();
    }
    Ok(runs)
}

/// The pairs of volume and surface entities of which the second bounds the first, in order.
fn sides(view: &View<'_>, runs: &[Run]) -> Vec<(i32, i32)> {
    let mut starts = vec![0];
    for block in &view.blocks {
        starts.push(starts[starts.len() - 1] + block.len());
    }
    let mut tag_of = vec![0; view.cells()];
    for run in runs {
        for &c in &run.cells {
            tag_of[starts[run.block] + c as usize] = run.tag;
        }
    }
    let mut found: Vec<(i32, i32)> = view
        .sides()
        .iter()
        .flat_map(|&(face, sides)| sides.map(|tet| (tet, face)))
        .filter(|&(tet, _)| tet != NO_CELL)
        .map(|(tet, face)| (tag_of[tet as usize], tag_of[face as usize]))
        .collect();
    found.sort_unstable();
    found.dedup();
    found
}

/// `$Entities`, `$Nodes` and `$Elements`. Tags of points and elements are 1, 2, … without gaps.
fn write_41(out: &mut Out<'_>, view: &View<'_>, runs: &[Run]) -> Result<(), Error> {
    let (nodes, cells) = (view.points.len() as u64, view.cells() as u64);
    let bounds = crate::Aabb::of_points(view.points.iter());
    // Each dimension and tag is an entity, which carries the physical group; their boxes are those of the whole.
    let mut entities: Vec<(u8, i32, i32)> = runs
        .iter()
        .map(|r| (r.dimension, r.tag, r.physical))
        .collect();
    entities.sort_unstable();
    entities.dedup();
    if entities.is_empty() {
        entities.push((2, 1, 0));
    }
    let sides = sides(view, runs);
    writeln!(out.w, "$Entities")?;
    let of = |d: u8| entities.iter().filter(|e| e.0 == d).count() as u64;
    out.line([0, 0, of(2), of(3)])?;
    for &(dimension, tag, physical) in &entities {
        let physical = if physical == 0 {
            vec![]
        } else {
            vec![physical]
        };
        // What bounds a surface, curves, is not told; what bounds a volume is.
        let bounding: Vec<i32> = sides
            .iter()
            .filter(|side| dimension == 3 && side.0 == tag)
            .map(|side| side.1)
            .collect();
        let b = [bounds.min, bounds.max].map(|p| [p.x, p.y, p.z]);
        if out.binary {
            out.line([tag])?;
            out.line(b.into_iter().flatten())?;
            out.line([physical.len() as u64])?;
            out.line(physical)?;
            out.line([bounding.len() as u64])?;
            out.line(bounding)?;
        } else {
            let b = b.as_flattened().iter().map(f64::to_string);
            let mut words = vec![tag.to_string()];
            words.extend(b);
            words.push(physical.len().to_string());
            words.extend(physical.iter().map(i32::to_string));
            words.push(bounding.len().to_string());
            words.extend(bounding.iter().map(i32::to_string));
            writeln!(out.w, "{}", words.join(" "))?;
        }
    }
    out.end("Entities")?;

    // All nodes belong to one block: which entity they lie on is of no use to readers.
    writeln!(out.w, "$Nodes")?;
    let (dimension, tag, _) = entities[entities.len() - 1];
    out.line([1, nodes, 1, nodes])?;
    out.mixed(&[dimension.into(), tag, 0], &[nodes])?;
    if out.binary {
        out.line(1..=nodes)?;
        out.line(view.points.iter().flat_map(|p| [p.x, p.y, p.z]))?;
    } else {
        for tag in 1..=nodes {
            out.line([tag])?;
        }
        for p in view.points.iter() {
            out.line([p.x, p.y, p.z])?;
        }
    }
    out.end("Nodes")?;

    // Elements in runs of one entity and kind; tags count from 1 through all of them.
    writeln!(out.w, "$Elements")?;
    out.line([runs.len() as u64, cells, 1, cells])?;
    for run in runs {
        let head = [run.dimension.into(), run.tag, run.kind];
        out.mixed(&head, &[run.cells.len() as u64])?;
        let element = |(tag, &c): (u64, &u32)| {
            let corners = view.blocks[run.block].corners(c as usize);
            std::iter::once(tag).chain(corners.iter().map(|&v| u64::from(v) + 1))
        };
        let mut tagged = (run.start as u64 + 1..).zip(&run.cells);
        if out.binary {
            out.line(tagged.flat_map(element))?;
        } else {
            tagged.try_for_each(|cell| out.line(element(cell)))?;
        }
    }
    out.end("Elements")
}

/// `$Nodes` and `$Elements`, where each element has two tags: physical group and entity.
fn write_22(out: &mut Out<'_>, view: &View<'_>, runs: &[Run]) -> Result<(), Error> {
    writeln!(out.w, "$Nodes\n{}", view.points.len())?;
    for (tag, p) in (1i32..).zip(view.points.iter()) {
        if out.binary {
            let mut bytes = [0; 28];
            bytes[..4].copy_from_slice(&tag.to_le_bytes());
            for k in 0..3 {
                bytes[4 + 8 * k..][..8].copy_from_slice(&p[k].to_le_bytes());
            }
            out.w.write_all(&bytes)?;
        } else {
            writeln!(out.w, "{tag} {} {} {}", p.x, p.y, p.z)?;
        }
    }
    out.end("Nodes")?;
    writeln!(out.w, "$Elements\n{}", view.cells())?;
    for run in runs {
        let physical = run.physical;
        let corners = |&c: &u32| {
            let corners = view.blocks[run.block].corners(c as usize);
            corners.iter().map(|&v| v as i32 + 1)
        };
        let mut tagged = (run.start as i32 + 1..).zip(&run.cells);
        if out.binary {
            out.line([run.kind, run.cells.len() as i32, 2])?;
            out.line(tagged.flat_map(|(tag, c)| {
                let head = [tag, physical, run.tag];
                head.into_iter().chain(corners(c))
            }))?;
        } else {
            tagged.try_for_each(|(tag, c)| {
                let head = [tag, run.kind, 2, physical, run.tag];
                out.line(head.into_iter().chain(corners(c)))
            })?;
        }
    }
    out.end("Elements")
}

/// The values of elements, each told by its tag and its place in the field.
pub(super) fn write_field(
    out: &mut Out<'_>,
    section: &str,
    field: &Field<'_>,
    elements: impl Iterator<Item = (i32, usize)>,
) -> Result<(), Error> {
    let values = &field.values;
    let Some(components) = [1, 3, 9].into_iter().find(|&n| n >= values.components) else {
        return Err(ErrorKind::Unsupported(format!(
            "field \"{}\" has {} components; MSH holds at most 9",
            field.name, values.components
        ))
        .into());
    };
    let name = field.name.replace(['"', '\n', '\r'], "'");
    writeln!(out.w, "${section}\n1\n\"{name}\"\n1\n0\n3\n0")?;
    writeln!(out.w, "{components}\n{}", values.len())?;
    let mut row = Vec::with_capacity(80);
    for (tag, i) in elements {
        let tuple = (0..components).map(|k| match k < values.components {
            true => values.get(i, k),
            false => 0.0,
        });
        if out.binary {
            row.clear();
            tag.put(&mut row);
            tuple.for_each(|v| v.put(&mut row));
            out.w.write_all(&row)?;
        } else {
            write!(out.w, "{tag}")?;
            for v in tuple {
                write!(out.w, " {v}")?;
            }
            writeln!(out.w)?;
        }
    }
    out.end(section)
}

/// Reads a file.
pub fn read(path: impl AsRef<Path>) -> Result<View<'static>, Error> {
    let path = path.as_ref();
    parse(&read_bytes(path)?).map_err(|e| e.in_file(path))
}

/// Reads a view from the bytes of a file of version 4.1 or 2.2, text or binary. Elements are points and
/// lines, which are skipped, triangles, quads and tetrahedra of first order. Of a part of a mesh, ghosts are elements
/// without a group.
///
/// Sections that are not listed above are skipped. Cells come in the order of their tags, a block per run of one kind;
/// of an entity with several physical groups the first one counts, and a group without a name is called `physical 7`.
/// Values that the file does not have for some points or cells are NaN, and all are f64.
///
/// # Errors
/// With the line: [`ErrorKind::Expected`] for what is not of the format or another version, [`ErrorKind::Unsupported`]
/// for other elements, those of higher order among them, and for numbers that are not of 8 bytes,
/// [`ErrorKind::Truncated`] for counts that the file cannot hold. [`ErrorKind::Expected`] if an element has a node that
/// does not exist.
pub fn parse(bytes: &[u8]) -> Result<View<'static>, Error> {
    let mut words = Words::new(bytes);
    let start = words.word("$MeshFormat")?;
    if start != b"$MeshFormat" {
        let found = String::from_utf8_lossy(&start[..start.len().min(100)]);
        return Err(Error::at_line(
            ErrorKind::expected("$MeshFormat", found),
            words.line(),
        ));
    }
    // The header is text in either form: version, text or bytes, size of a number.
    let version = words.word("the version")?;
    let version = match version {
        b"4.1" => Version::V41,
        b"2.2" | b"2" | b"2.1" | b"2.0" => Version::V22,
        other => {
            let kind =
                ErrorKind::expected("MSH version 2.2 or 4.1", String::from_utf8_lossy(other));
            return Err(Error::at_line(kind, words.line()));
        }
    };
    let binary = words.number::<u8>("0 for text or 1 for bytes")? != 0;
    let width: usize = words.number("the size of a number")?;
    if width != 8 {
        let what = format!("numbers of {width} bytes are not read; 8 bytes are");
        return Err(Error::at_line(ErrorKind::Unsupported(what), words.line()));
    }
    words.rest_of_line();
    let mut input = In {
        words,
        bytes,
        binary,
        little: true,
    };
    // After it a binary file holds the number one, which tells the order of bytes.
    if binary {
        let one = input.take(4, "the number one")?;
        input.little = match one {
            [1, 0, 0, 0] => true,
            [0, 0, 0, 1] => false,
            _ => return Err(input.wrong("the number one", &format!("{one:?}"))),
        };
    }
    input.end("MeshFormat")?;

    // Sections come in any order; those of no use are skipped by their end mark.
    let mut file = File::default();
    while let Some(section) = input.words.next(false) {
        input.words.rest_of_line();
        match section {
            b"$PhysicalNames" => file.physical_names(&mut input)?,
            b"$Entities" if version == Version::V41 => file.entities(&mut input, false)?,
            b"$PartitionedEntities" if version == Version::V41 => {
                file.entities(&mut input, true)?
            }
            b"$Nodes" if version == Version::V41 => file.nodes_41(&mut input)?,
            b"$Nodes" => file.nodes_22(&mut input)?,
            b"$Elements" if version == Version::V41 => file.elements_41(&mut input)?,
            b"$Elements" => file.elements_22(&mut input)?,
            b"$NodeData" => file.point_data.extend(input.data("NodeData")?),
            b"$ElementData" => file.cell_data.extend(input.data("ElementData")?),
            other if other.starts_with(b"$") => input.skip(other)?,
            other => return Err(input.wrong("a section", &String::from_utf8_lossy(other))),
        }
    }
    file.view()
}

/// The rest of the file.
///
/// One cursor for both forms: bytes begin right behind the line end of a section's head, text at the next word.
struct In<'a> {
    words: Words<'a>,
    bytes: &'a [u8],
    binary: bool,
    little: bool,
}

impl<'a> In<'a> {
    /// What stands in the current line is not what should.
    fn wrong(&self, expected: &str, found: &str) -> Error {
        Error::at_line(ErrorKind::expected(expected, found), self.words.line())
    }

    /// The next bytes, without a look at what they are.
    fn take(&mut self, n: usize, what: &str) -> Result<&'a [u8], Error> {
        let at = self.words.at();
        let taken = at.checked_add(n).and_then(|end| self.bytes.get(at..end));
        let taken = taken.ok_or_else(|| {
            Error::at_line(ErrorKind::Truncated(what.to_owned()), self.words.line())
        })?;
        self.words.advance(n);
        Ok(taken)
    }

    /// The next number: the next bytes, or the next word.
    fn number<T: Scalar + std::str::FromStr>(&mut self, what: &str) -> Result<T, Error> {
        if self.binary {
            let little = self.little;
            Ok(T::get(self.take(T::WIDTH, what)?, little))
        } else {
            self.words.number(what)
        }
    }

    /// `n` numbers: nothing is allocated before they are known to be there.
    fn numbers<T: Scalar + std::str::FromStr>(
        &mut self,
        n: usize,
        what: &str,
    ) -> Result<Vec<T>, Error> {
        if self.binary {
            let little = self.little;
            let bytes = self.take(n.saturating_mul(T::WIDTH), what)?;
            return Bytes::new(bytes, little).many(n, what);
        }
        (0..n).map(|_| self.words.number(what)).collect()
    }

    /// A count, which cannot exceed the bytes that are left.
    fn count(&mut self, what: &str) -> Result<usize, Error> {
        let n: u64 = self.number(what)?;
        self.plausible(n, what)
    }

    /// Whatever is counted takes a byte at least, so that a larger count is a lie, told before memory is taken for it.
    fn plausible(&self, n: u64, what: &str) -> Result<usize, Error> {
        let left = (self.bytes.len() - self.words.at()) as u64;
        if n > left {
            let what = format!("{what}, which says {n}");
            return Err(Error::at_line(
                ErrorKind::Truncated(what),
                self.words.line(),
            ));
        }
        Ok(n as usize)
    }

    fn end(&mut self, section: &str) -> Result<(), Error> {
        let end = self.words.word(&format!("section ${section}"))?;
        if end == format!("$End{section}").as_bytes() {
            Ok(())
        } else {
            let found = String::from_utf8_lossy(&end[..end.len().min(100)]).into_owned();
            Err(self.wrong(&format!("$End{section}"), &found))
        }
    }

    /// Skips a section that is not read.
    fn skip(&mut self, section: &[u8]) -> Result<(), Error> {
        let mut end = b"$End".to_vec();
        end.extend_from_slice(&section[1..]);
        let rest = &self.bytes[self.words.at()..];
        match rest.windows(end.len()).position(|w| w == end) {
            Some(n) => {
                self.words.skip_to(self.words.at() + n + end.len());
                Ok(())
            }
            None => {
                let section = &section[..section.len().min(60)];
                let what = format!(
                    "section {}",
                    String::from_utf8_lossy(section).escape_debug()
                );
                Err(Error::at_line(
                    ErrorKind::Truncated(what),
                    self.words.line(),
                ))
            }
        }
    }

    /// The rest of this line, or the next line if nothing is left of it, without quotation marks.
    fn quoted(&mut self) -> String {
        let line = self.words.rest_of_line().trim_ascii();
        let line = match line {
            b"" => self.words.rest_of_line().trim_ascii(),
            line => line,
        };
        let inner = line.strip_prefix(b"\"").unwrap_or(line);
        let inner = inner.strip_suffix(b"\"").unwrap_or(inner);
        String::from_utf8_lossy(inner).into_owned()
    }

    /// A section of values; `None` if it has no value.
    fn data(&mut self, section: &str) -> Result<Option<Data>, Error> {
        let mut name = "unnamed".to_owned();
        let strings: u64 = self.words.number("a number of strings")?;
        self.words.rest_of_line();
        for i in 0..self.plausible(strings, "strings")? {
            let text = self.quoted();
            if i == 0 {
                name = text;
            }
        }
        let reals: u64 = self.words.number("a number of reals")?;
        for _ in 0..self.plausible(reals, "reals")? {
            self.words.number::<f64>("a real")?;
        }
        let ints: u64 = self.words.number("a number of integers")?;
        let ints = (0..self.plausible(ints, "integers")?)
            .map(|_| self.words.number::<u32>("an integer"))
            .collect::<Result<Vec<_>, _>>()?;
        self.words.rest_of_line();
        let [_, components, entries, ..] = ints[..] else {
            return Err(self.wrong("3 integers", &ints.len().to_string()));
        };
        if !(1..=9).contains(&components) {
            return Err(self.wrong("a number of components", &components.to_string()));
        }
        let entries = self.plausible(entries.into(), "values")?;
        let mut data = Data {
            name,
            components: components as usize,
            tags: Vec::new(),
            values: Vec::new(),
        };
        for _ in 0..entries {
            data.tags.push(self.number::<u32>("a tag")?.into());
            for _ in 0..components {
                data.values.push(self.number("a value")?);
            }
        }
        self.end(section)?;
        Ok((entries > 0).then_some(data))
    }
}

/// Values of nodes or elements by tag.
struct Data {
    name: String,
    components: usize,
    tags: Vec<u64>,
    values: Vec<f64>,
}

impl Data {
    /// As a field of the elements with these tags; NaN where the file has no value.
    fn field(&self, places: &Places, elements: usize) -> Field<'static> {
        let k = self.components;
        let mut numbers = vec![f64::NAN; elements * k];
        for (tag, values) in self.tags.iter().zip(self.values.chunks_exact(k)) {
            if let Some(i) = places.of(*tag) {
                numbers[i as usize * k..][..k].copy_from_slice(values);
            }
        }
        Field {
            name: self.name.clone(),
            values: Values {
                components: k,
                numbers: Numbers::F64(numbers.into()),
            },
        }
    }
}

/// Where the element with a tag is.
struct Places(Vec<(u64, u32)>);

impl Places {
    fn new(tags: impl Iterator<Item = u64>) -> Self {
        let mut places: Vec<_> = tags.zip(0..).collect();
        if !places.is_sorted() {
            places.sort_unstable();
        }
        Self(places)
    }
    fn of(&self, tag: u64) -> Option<u32> {
        // Mostly the tags are 1, 2, 3, …
        if let Some(guess) = tag.checked_sub(1).and_then(|t| self.0.get(t as usize))
            && guess.0 == tag
        {
            return Some(guess.1);
        }
        let at = self.0.binary_search_by_key(&tag, |p| p.0).ok()?;
        Some(self.0[at].1)
    }
}

/// An element: its tag, number of corners, dimension, physical group, first corner in the list.
struct Element {
    tag: u64,
    kind: i32,
    physical: i32,
    corners: [u64; 4],
}

/// What a file holds, by tags.
#[derive(Default)]
struct File {
    /// Dimension, tag, name.
    names: Vec<(u8, i32, String)>,
    /// Dimension and tag of an entity, and its first physical group; sorted.
    physical_of: Vec<((u8, i32), i32)>,
    node_tags: Vec<u64>,
    points: Vec<Point3>,
    elements: Vec<Element>,
    point_data: Vec<Data>,
    cell_data: Vec<Data>,
}

/// Corners of an element type of first order, or `None` if it is not read.
fn corners_of(kind: i32) -> Option<usize> {
    match kind {
        15 => Some(1),
        1 => Some(2),
        TRIANGLE => Some(3),
        QUAD | TETRA => Some(4),
        _ => None,
    }
}

/// Of the types of `corners_of` alone; it is 2 for the rest.
fn dimension_of(kind: i32) -> u8 {
    match kind {
        15 => 0,
        1 => 1,
        TETRA => 3,
        _ => 2,
    }
}

impl File {
    fn physical_names(&mut self, input: &mut In<'_>) -> Result<(), Error> {
        let n: u64 = input.words.number("a number of names")?;
        for _ in 0..input.plausible(n, "names")? {
            let dimension = input.words.number("a dimension")?;
            let tag = input.words.number("a tag")?;
            let name = input.quoted();
            self.names.push((dimension, tag, name));
        }
        input.end("PhysicalNames")
    }

    /// Entities, or those of a part, which tell their parents and parts too.
    fn entities(&mut self, input: &mut In<'_>, partitioned: bool) -> Result<(), Error> {
        if partitioned {
            input.number::<u64>("a number of parts")?;
            let ghosts = input.count("a number of ghost entities")?;
            for _ in 0..ghosts {
                input.numbers::<i32>(2, "a ghost entity")?;
            }
        }
        let counts = [0u8, 1, 2, 3].map(|d| (d, input.count("a number of entities")));
        for (dimension, count) in counts {
            for _ in 0..count? {
                let tag: i32 = input.number("the tag of an entity")?;
                if partitioned {
                    input.numbers::<i32>(2, "the parent of an entity")?;
                    let parts = input.count("a number of parts")?;
                    input.numbers::<i32>(parts, "parts")?;
                }
                let bounds = if dimension == 0 { 3 } else { 6 };
                input.numbers::<f64>(bounds, "the bounds of an entity")?;
                let groups = input.count("a number of physical groups")?;
                let groups: Vec<i32> = input.numbers(groups, "physical groups")?;
                if dimension > 0 {
                    let parts = input.count("a number of bounding entities")?;
                    input.numbers::<i32>(parts, "bounding entities")?;
                }
                if let Some(&first) = groups.first() {
                    self.physical_of.push(((dimension, tag), first));
                }
            }
        }
        self.physical_of.sort_unstable();
        input.end(match partitioned {
            true => "PartitionedEntities",
            false => "Entities",
        })
    }

    /// In blocks by entity, tags first and coordinates after them; parametric coordinates are skipped.
    fn nodes_41(&mut self, input: &mut In<'_>) -> Result<(), Error> {
        let blocks = input.count("a number of node blocks")?;
        input.numbers::<u64>(3, "numbers of nodes")?;
        for _ in 0..blocks {
            let [dimension, _, parametric] = [(); 3].map(|()| input.number::<i32>("a node block"));
            let (dimension, parametric) = (dimension?, parametric?);
            let n = input.count("a number of nodes")?;
            self.node_tags.extend(input.numbers::<u64>(n, "node tags")?);
            let parameters = match parametric {
                0 => 0,
                _ => dimension.clamp(0, 3) as usize,
            };
            for _ in 0..n {
                let mut p = [0.0; 3];
                for c in &mut p {
                    *c = input.number("a coordinate")?;
                }
                for _ in 0..parameters {
                    input.number::<f64>("a parameter of a node")?;
                }
                self.points.push(Point3::from(p));
            }
        }
        input.end("Nodes")
    }

    /// One after another, each with its tag.
    fn nodes_22(&mut self, input: &mut In<'_>) -> Result<(), Error> {
        let n: u64 = input.words.number("a number of nodes")?;
        input.words.rest_of_line();
        for _ in 0..input.plausible(n, "nodes")? {
            self.node_tags
                .push(input.number::<u32>("a node's tag")?.into());
            let mut p = [0.0; 3];
            for c in &mut p {
                *c = input.number("a coordinate")?;
            }
            self.points.push(Point3::from(p));
        }
        input.end("Nodes")
    }

    /// In blocks by entity, which tells their physical group.
    fn elements_41(&mut self, input: &mut In<'_>) -> Result<(), Error> {
        let blocks = input.count("a number of element blocks")?;
        input.numbers::<u64>(3, "numbers of elements")?;
        for _ in 0..blocks {
            let [dimension, tag, kind] = [(); 3].map(|()| input.number::<i32>("an element block"));
            let (dimension, tag, kind) = (dimension?, tag?, kind?);
            let n = input.count("a number of elements")?;
            let corners = corners_of(kind).ok_or_else(|| unread(input, kind))?;
            let key = (dimension.clamp(0, 3) as u8, tag);
            let physical = match self.physical_of.binary_search_by_key(&key, |p| p.0) {
                Ok(at) => self.physical_of[at].1,
                Err(_) => 0,
            };
            for _ in 0..n {
                let tag = input.number("the tag of an element")?;
                self.element(input, tag, kind, physical, corners, |input| {
                    input.number::<u64>("a corner")
                })?;
            }
        }
        input.end("Elements")
    }

    /// Each with tags of its own, of which the first is its physical group.
    fn elements_22(&mut self, input: &mut In<'_>) -> Result<(), Error> {
        let n: u64 = input.words.number("a number of elements")?;
        input.words.rest_of_line();
        let total = input.plausible(n, "elements")?;
        let mut left = total;
        while left > 0 {
            // Binary elements come in runs with one header.
            let mut head = [0i32; 3];
            if input.binary {
                for h in &mut head {
                    *h = input.number("a run of elements")?;
                }
            }
            let run = if input.binary {
                head[1].max(1) as usize
            } else {
                1
            };
            if run > left {
                return Err(input.wrong(&format!("at most {left} elements"), &run.to_string()));
            }
            left -= run;
            for _ in 0..run {
                let tag: u32 = input.number("the tag of an element")?;
                let (kind, tags) = if input.binary {
                    (head[0], head[2])
                } else {
                    (
                        input.number("a type of elements")?,
                        input.number("a number of tags")?,
                    )
                };
                let tags = input.plausible(tags.max(0) as u64, "tags of an element")?;
                let tags: Vec<i32> = input.numbers(tags, "tags of an element")?;
                let physical = tags.first().copied().unwrap_or(0);
                let corners = corners_of(kind).ok_or_else(|| unread(input, kind))?;
                self.element(input, tag.into(), kind, physical, corners, |input| {
                    input.number::<u32>("a corner").map(u64::from)
                })?;
            }
        }
        input.end("Elements")
    }

    /// Reads the corners of one element, and keeps it unless it is a point or a line.
    fn element<'a>(
        &mut self,
        input: &mut In<'a>,
        tag: u64,
        kind: i32,
        physical: i32,
        corners: usize,
        next: impl Fn(&mut In<'a>) -> Result<u64, Error>,
    ) -> Result<(), Error> {
        let mut element = Element {
            tag,
            kind,
            physical,
            corners: [0; 4],
        };
        for c in &mut element.corners[..corners] {
            *c = next(input)?;
        }
        if dimension_of(kind) >= 2 {
            self.elements.push(element);
        }
        Ok(())
    }

    /// Points and cells in the order of their tags.
    fn view(mut self) -> Result<View<'static>, Error> {
        let nodes = Places::new(self.node_tags.iter().copied());
        // A stable order, because tags of a strange file may repeat.
        self.elements.sort_by_key(|e| e.tag);
        let mut blocks: Vec<Cells<'static>> = Vec::new();
        let mut groups: Vec<(u8, i32, Group)> = Vec::new();
        let mut group_of = Vec::with_capacity(self.elements.len());
        let elements = &self.elements;
        // A block per run of equal kinds; corners are named by tags, which need not be dense.
        for run in elements.chunk_by(|a, b| a.kind == b.kind) {
            let place = |element: &Element, k: usize| {
                let tag = element.corners[k];
                nodes.of(tag).ok_or_else(|| {
                    let what = format!("a node of element {}", element.tag);
                    Error::from(ErrorKind::expected(what, format!("tag {tag}")))
                })
            };
            let quads = || -> Result<Vec<[u32; 4]>, Error> {
                run.iter()
                    .map(|e| Ok([place(e, 0)?, place(e, 1)?, place(e, 2)?, place(e, 3)?]))
                    .collect()
            };
            blocks.push(match run[0].kind {
                TRIANGLE => Cells::Triangles(
                    run.iter()
                        .map(|e| Ok([place(e, 0)?, place(e, 1)?, place(e, 2)?]))
                        .collect::<Result<Vec<_>, Error>>()?
                        .into(),
                ),
                QUAD => Cells::Quads(quads()?.into()),
                _ => Cells::Tets(quads()?.into()),
            });
            // Groups in order of appearance; 0 is no group.
            let dimension = dimension_of(run[0].kind);
            for e in run {
                if e.physical == 0 {
                    group_of.push(NO_GROUP);
                    continue;
                }
                let known = groups
                    .iter()
                    .position(|g| (g.0, g.1) == (dimension, e.physical));
                group_of.push(known.unwrap_or_else(|| {
                    let named = self
                        .names
                        .iter()
                        .find(|n| (n.0, n.1) == (dimension, e.physical));
                    let name = match named {
                        Some((.., name)) => name.clone(),
                        None => format!("physical {}", e.physical),
                    };
                    let tag = Some(e.physical);
                    let group = Group {
                        name,
                        dimension,
                        tag,
                    };
                    groups.push((dimension, e.physical, group));
                    groups.len() - 1
                }) as u32);
            }
        }
        // Data are attached by tags, too.
        let cell_places = Places::new(self.elements.iter().map(|e| e.tag));
        let (points, cells) = (self.points.len(), self.elements.len());
        View {
            point_fields: self
                .point_data
                .iter()
                .map(|d| d.field(&nodes, points))
                .collect(),
            cell_fields: self
                .cell_data
                .iter()
                .map(|d| d.field(&cell_places, cells))
                .collect(),
            points: self.points.into(),
            blocks,
            group_of: if groups.is_empty() { vec![] } else { group_of }.into(),
            groups: groups.into_iter().map(|(.., group)| group).collect(),
            colors: None,
        }
        .checked()
    }
}

/// Elements of higher order have nodes in their edges, for which no cell of ours has a place.
fn unread(input: &In<'_>, kind: i32) -> Error {
    let what = format!(
        "elements of type {kind} are not read; points (15), lines (1), triangles (2), quads (3) and \
         tetrahedra (4) are"
    );
    Error::at_line(ErrorKind::Unsupported(what), input.words.line())
}
