//! Faces of any number of corners.

use geom_core::{Point3, Vector3};

/// The area of a polygon times its mean normal.
pub(crate) fn area_normal<const N: usize>(positions: &[Point3], face: &[u32; N]) -> Vector3 {
    let p = face.map(|v| positions[v as usize]);
    let fan = (1..N - 1).map(|k| (p[k] - p[0]).cross(&(p[k + 1] - p[0])));
    fan.sum::<Vector3>() * 0.5
}

/// The mean of its corners.
pub(crate) fn centroid<const N: usize>(positions: &[Point3], face: &[u32; N]) -> Point3 {
    let sum: Vector3 = face.iter().map(|&v| positions[v as usize].coords).sum();
    Point3::from(sum / N as f64)
}

/// Its sides, the smaller number first, with the number of the face: equal ones side by side.
pub(crate) fn sorted_sides<const N: usize>(faces: &[[u32; N]]) -> Vec<([u32; 2], u32)> {
    let mut sides: Vec<([u32; 2], u32)> = faces
        .iter()
        .zip(0..)
        .flat_map(|(c, f)| (0..N).map(move |k| (c[k], c[(k + 1) % N], f)))
        .map(|(a, b, f)| ([a.min(b), a.max(b)], f))
        .collect();
    sides.sort_unstable();
    sides
}
