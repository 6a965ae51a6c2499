//! STL, the stereolithography file: bare triangles in f32.
//!
//! 80 bytes of no meaning, the number of triangles, then 50 bytes for each: its normal, three corners and two bytes of no
//! meaning. Nothing says which triangles are neighbours; it is found again by joining equal corners, which fails where two
//! vertices were different in f64 and are not in f32.
//!
//! Written as bytes, quads and polygons as fans; read as bytes or text, with vertices of the same
//! coordinates joined. Everything else is left out. Of a tetrahedral mesh the surface is written.

use std::io::{Cursor, Write};
use std::path::Path;

use rayon::prelude::*;
use stl_io::{Normal, Triangle, Vertex};

use crate::Point3;
use crate::io::view::{Cells, View};
use crate::io::{Error, ErrorKind, read_bytes};

/// Writes a view to a file, whole or not at all.
pub fn save(path: impl AsRef<Path>, view: &View<'_>) -> Result<(), Error> {
    crate::io::save(path, |w| write(w, view))
}

/// Writes a view.
///
/// Normals are those of the triangles, 0 for one without area. Points that no triangle uses are lost.
///
/// # Errors
/// [`ErrorKind::TooLarge`] from 2³² triangles on; [`ErrorKind::Expected`] and [`ErrorKind::Mesh`] if the parts of the
/// view do not fit each other.
pub fn write(mut w: &mut dyn Write, view: &View<'_>) -> Result<(), Error> {
    view.check()?;
    let triangles = view.triangles();
    if u32::try_from(triangles.len()).is_err() {
        let what = format!("{} triangles; STL counts with 32 bits", triangles.len());
        return Err(ErrorKind::TooLarge(what).into());
    }
    let triangles = triangles.iter().map(|corners| {
        let [a, b, c] = corners.map(|v| view.points[v as usize]);
        let normal = (b - a).cross(&(c - a));
        let normal = normal.try_normalize(0.0).unwrap_or(normal);
        Triangle {
            normal: Normal::new([normal.x as f32, normal.y as f32, normal.z as f32]),
            vertices: [a, b, c].map(|p| Vertex::new([p.x as f32, p.y as f32, p.z as f32])),
        }
    });
    Ok(stl_io::write_stl(&mut w, triangles)?)
}

/// Reads a file.
pub fn read(path: impl AsRef<Path>) -> Result<View<'static>, Error> {
    let path = path.as_ref();
    parse(&read_bytes(path)?).map_err(|e| e.in_file(path))
}

/// Bytes before the triangles, and per triangle.
const HEADER: usize = 84;
const TRIANGLE: usize = 50;

/// Reads a view from the bytes of a file. Triangles with two equal corners, which STL writers leave
/// behind, are dropped.
///
/// Vertices are joined by the bits of their coordinates, with one zero, and numbered in the order in which they come;
/// O(n log n), in parallel. Normals and attribute bytes are not looked at.
///
/// # Errors
/// [`ErrorKind::Truncated`] if triangles are missing, with how many bytes there should be; [`ErrorKind::Expected`] for
/// more bytes than the number of triangles says, and for words that are not of the format; [`ErrorKind::Mesh`] for
/// coordinates that are not finite.
pub fn parse(bytes: &[u8]) -> Result<View<'static>, Error> {
    // Binary files may begin with "solid", too; their length tells.
    let count = bytes.get(80..HEADER).map(|n| {
        let n = u32::from_le_bytes([n[0], n[1], n[2], n[3]]);
        HEADER as u64 + TRIANGLE as u64 * u64::from(n)
    });
    let binary = count == Some(bytes.len() as u64);
    if !binary && !bytes.trim_ascii_start().starts_with(b"solid") {
        return Err(match count {
            Some(expected) if expected > bytes.len() as u64 => {
                ErrorKind::Truncated(format!("{expected} bytes of STL triangles"))
            }
            Some(expected) => ErrorKind::expected(
                format!("{expected} bytes, as the number of triangles says"),
                bytes.len().to_string(),
            ),
            None => ErrorKind::Truncated("the STL header".to_owned()),
        }
        .into());
    }
    let foreign = |e: std::io::Error, triangles: usize| -> Error {
        let what = format!("STL triangle {}", triangles + 1);
        match e.kind() {
            std::io::ErrorKind::UnexpectedEof => ErrorKind::Truncated(what).into(),
            _ => ErrorKind::expected(what, e.to_string()).into(),
        }
    };
    let mut corners: Vec<[u32; 3]> = Vec::new();
    let mut read = |input: &[u8]| -> Result<(), Error> {
        let mut input = Cursor::new(input);
        for triangle in stl_io::create_stl_reader(&mut input).map_err(|e| foreign(e, 0))? {
            let vertices = triangle
                .map_err(|e| foreign(e, corners.len() / 3))?
                .vertices;
            // −0 and 0 are the same place.
            corners.extend(vertices.map(|v| v.0.map(|c| (c + 0.0).to_bits())));
        }
        Ok(())
    };
    // The reader goes by the first word; where that lies, it is blotted out.
    if binary && bytes.starts_with(b"solid") {
        let mut other_header = bytes.to_vec();
        other_header[..5].fill(b' ');
        read(&other_header)?;
    } else {
        read(bytes)?;
    }

    let mut order: Vec<([u32; 3], u32)> = corners.into_iter().zip(0..).collect();
    order.par_sort_unstable();
    // Vertices are numbered by their first appearance.
    let mut first = vec![0u32; order.len()];
    for same in order.chunk_by(|a, b| a.0 == b.0) {
        for &(_, corner) in same {
            first[corner as usize] = same[0].1;
        }
    }
    order.par_sort_unstable_by_key(|o| o.1);
    let mut number = vec![0u32; order.len()];
    let mut points = Vec::new();
    for (corner, &(bits, _)) in order.iter().enumerate() {
        if first[corner] as usize == corner {
            number[corner] = points.len() as u32;
            points.push(Point3::from(bits.map(|b| f64::from(f32::from_bits(b)))));
        }
    }
    let (triangles, _) = first.as_chunks::<3>();
    let triangles = triangles
        .iter()
        .map(|t| t.map(|corner| number[corner as usize]))
        .filter(|[a, b, c]| a != b && b != c && c != a)
        .collect();
    View {
        points: points.into(),
        blocks: vec![Cells::Triangles(triangles)],
        ..View::default()
    }
    .checked()
}
