//! The corners, faces and diagonals of a cube, and the twelve tetrahedra between its middle and the halves of
//! its faces.
//!
//! Corners have the numbers `x + 2y + 4z`, faces `2 · axis + side`, parts `2 · face + half`. Which of its two diagonals
//! cuts a face is a bit of six, so that all that follows from them can stand in tables of 64.

use std::sync::LazyLock;

use geom_core::Point3;

use crate::octree::{corner_of, local};

/// Quadrants about an axis: 0 (−,−), 1 (+,−), 2 (+,+), 3 (−,+).
pub(crate) const QUADRANT: [[i32; 2]; 4] = [[-1, -1], [0, -1], [0, 0], [-1, 0]];

/// The faces of the four cells around an axis towards the quadrants before and after theirs.
/// By quadrant, in their order counter-clockwise about the axis.
pub(crate) fn faces_beside(axis: usize) -> [[usize; 4]; 2] {
    let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
    let before = [2 * v + 1, 2 * u, 2 * v, 2 * u + 1];
    let after = [2 * u + 1, 2 * v + 1, 2 * u, 2 * v];
    [before, after]
}

/// The middle of the unit cube.
pub(crate) const MIDDLE: Point3 = Point3::new(0.5, 0.5, 0.5);

/// Number of the middle among the corners of a cut cell.
pub(crate) const APEX: usize = 8;

/// The corners of the unit cube and its middle.
pub(crate) const CORNERS: [Point3; 9] = {
    let mut out = [MIDDLE; 9];
    let mut i = 0;
    while i < APEX {
        out[i] = Point3::new((i & 1) as f64, (i >> 1 & 1) as f64, (i >> 2) as f64);
        i += 1;
    }
    out
};

/// The corners of face `2 · axis + side` of the unit cube, counter-clockwise about the axis.
pub(super) fn face_corners(face: usize) -> [usize; 4] {
    let (axis, side) = (face / 2, face % 2);
    let (u, v) = (1 << ((axis + 1) % 3), 1 << ((axis + 2) % 3));
    let low = side << axis;
    [low, low | u, low | u | v, low | v]
}

/// The corners of a face of a cube, or all.
pub(crate) fn corners_of(face: Option<usize>) -> Vec<usize> {
    match face {
        Some(face) => face_corners(face).to_vec(),
        None => (0..8).collect(),
    }
}

/// The corners of a half of a face, given the diagonals of a cell.
/// In the order of the face's corners, so counter-clockwise about the axis, not as seen from outside.
pub(crate) fn triangle_of(diagonals: u8, part: usize) -> [usize; 3] {
    let f = face_corners(part / 2);
    match (diagonals >> (part / 2) & 1, part % 2) {
        (0, 0) => [f[0], f[1], f[2]],
        (0, _) => [f[0], f[2], f[3]],
        (_, 0) => [f[0], f[1], f[3]],
        _ => [f[1], f[2], f[3]],
    }
}

/// The ends of the diagonal of a face.
pub(crate) fn diagonal_of(diagonals: u8, face: usize) -> [usize; 2] {
    let f = face_corners(face);
    if diagonals >> face & 1 == 0 {
        [f[0], f[2]]
    } else {
        [f[1], f[3]]
    }
}

/// The half of a face that has both corners.
/// Of a diagonal, which both halves have, the first.
pub(crate) fn half_of(diagonals: u8, face: usize, p: usize, q: usize) -> u8 {
    let t = triangle_of(diagonals, 2 * face);
    (2 * face + usize::from(!(t.contains(&p) && t.contains(&q)))) as u8
}

/// The parts around the edge from the middle of a cell to a corner, counter-clockwise about it.
fn parts_around(diagonals: u8, corner: usize) -> Vec<u8> {
    let axis = (local(corner_of(corner)) - MIDDLE).normalize();
    let u = axis.cross(&geom_core::Vector3::x()).normalize();
    let v = axis.cross(&u);
    let mut parts: Vec<(f64, u8)> = (0..12u8)
        .filter(|&part| triangle_of(diagonals, part as usize).contains(&corner))
        .map(|part| {
            let d = part_base(diagonals, [0; 3], part as usize) - MIDDLE;
            (d.dot(&v).atan2(d.dot(&u)), part)
        })
        .collect();
    parts.sort_by(|x, y| x.0.total_cmp(&y.0));
    parts.into_iter().map(|(_, part)| part).collect()
}

/// Where a part of the finest cell at `o` stands before it moves to the surface, in finest cells.
/// The mean of its four corners, the middle of the cell among them.
pub(crate) fn part_base(diagonals: u8, o: [i32; 3], part: usize) -> Point3 {
    let o = local(o).coords;
    let corners = triangle_of(diagonals, part).map(|i| local(corner_of(i)).coords + o);
    let sum = corners.iter().fold(MIDDLE.coords + o, |s, c| s + c);
    Point3::from(sum / 4.0)
}

/// [`parts_around`] the edge from the middle to each corner, by the six diagonals.
pub(crate) static AROUND: LazyLock<Vec<[Vec<u8>; 8]>> = LazyLock::new(|| {
    let corners = |diagonals| std::array::from_fn(|corner| parts_around(diagonals, corner));
    (0..64).map(corners).collect()
});
