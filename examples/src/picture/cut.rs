//! Tetrahedral meshes cut open.

use geom_core::compute::parallel;
use geom_core::{Point3, TetMesh, mesh};
use rayon::prelude::*;

use super::Rgb;
use super::scene::{Layer, Paint, View};

/// What lies behind a plane of a tetrahedral mesh: whole tetrahedra, their cut faces coloured one by
/// one with `colors`, the boundary of the mesh plain. The plane is seen face-on by `view` and lies at
/// `depth` of the extent of the mesh (0 nearest to the eye, 1 farthest).
pub fn cut_tets(mesh: &TetMesh, view: &View, depth: f64, colors: &[Rgb], skin: Rgb) -> Vec<Layer> {
    let height = |p: &Point3| view.toward.dot(&p.coords);
    let (low, high) = mesh
        .positions()
        .iter()
        .map(height)
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), h| {
            (a.min(h), b.max(h))
        });
    let plane = high - depth * (high - low);
    let kept: Vec<u32> = (0..mesh.tets().len() as u32)
        .filter(|&t| mesh.corners(t as usize).iter().map(height).sum::<f64>() <= 4.0 * plane)
        .collect();
    // Faces of kept tetrahedra; those of only one kept tetrahedron are seen.
    let mut faces: Vec<([u32; 3], u32)> = parallel::flat_map(kept.len(), |i| {
        let t = kept[i];
        (0..4u32).map(move |k| {
            let mut key = mesh::FACES[k as usize].map(|c| mesh.tets()[t as usize][c]);
            key.sort_unstable();
            (key, 4 * t + k)
        })
    });
    faces.par_sort_unstable();
    let mut seen: Vec<u32> = faces
        .chunk_by(|a, b| a.0 == b.0)
        .filter(|group| group.len() == 1)
        .map(|group| group[0].1)
        .collect();
    seen.sort_unstable();
    // Of those, the ones on the boundary of the whole mesh.
    let mut boundary: Vec<[u32; 3]> = mesh
        .interfaces()
        .iter()
        .filter(|f| f.outside == mesh::OUTSIDE)
        .map(|f| {
            let mut key = f.triangle;
            key.sort_unstable();
            key
        })
        .collect();
    boundary.sort_unstable();
    let (mut cut, mut cut_colors, mut hull) = (Vec::new(), Vec::new(), Vec::new());
    for slot in seen {
        let tet = (slot / 4) as usize;
        let face = mesh::FACES[(slot % 4) as usize].map(|c| mesh.tets()[tet][c]);
        let mut key = face;
        key.sort_unstable();
        if boundary.binary_search(&key).is_ok() {
            hull.push(face);
        } else {
            cut.push(face);
            cut_colors.push(colors[tet]);
        }
    }
    let layer = |faces, paint| Layer {
        positions: mesh.positions().to_vec(),
        faces,
        paint,
        normals: None,
        edges: true,
    };
    vec![
        layer(cut, Paint::Faces(cut_colors)),
        layer(hull, Paint::Plain(skin)),
    ]
}
