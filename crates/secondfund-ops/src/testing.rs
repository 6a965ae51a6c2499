//! Shapes and tasks for tests and benches.

use geom_core::compute::random::SplitMix64;
use geom_core::mesh::shapes;
use geom_core::{Point3, QuadMesh, TriMesh, Vector3};

/// A box of these half extents with its edges and corners rounded by `radius`, as `6 n²` quads.
pub fn rounded_box(half: [f64; 3], radius: f64, n: u32) -> QuadMesh {
    let (positions, quads) = shapes::quad_sphere(1.0, n).into_parts();
    let half = Vector3::from(half);
    let inner = half - Vector3::repeat(radius);
    let round = |p: &Point3| {
        // Even steps along the sides of the cube.
        let side = p.coords / p.coords.amax();
        let even = side.map(|c| c.atan() / std::f64::consts::FRAC_PI_4);
        let on_box = even.component_mul(&half);
        let core = on_box.zip_map(&inner, |x, m| x.clamp(-m, m));
        let away = (on_box - core)
            .try_normalize(0.0)
            .unwrap_or_else(Vector3::zeros);
        Point3::from(core + away * radius)
    };
    QuadMesh::new(positions.iter().map(round).collect(), quads).expect("a mapped sphere is valid")
}

/// The unit ball with a dimple of this depth and angular width (radians) in each of these directions.
pub fn dimpled_ball(levels: u32, directions: &[Vector3], depth: f64, width: f64) -> TriMesh {
    let (positions, triangles) = shapes::icosphere(1.0, levels).into_parts();
    let dent = |p: &Point3| {
        let sum: f64 = directions
            .iter()
            .map(|d| (-(d.normalize().angle(&p.coords) / width).powi(2)).exp())
            .sum();
        p * (1.0 - depth * sum)
    };
    TriMesh::new(positions.iter().map(dent).collect(), triangles).expect("a dented sphere is valid")
}

/// The mesh with each vertex moved by up to `amplitude` along each axis.
pub fn shaken(mesh: &TriMesh, amplitude: f64, seed: u64) -> TriMesh {
    let mut random = SplitMix64::new(seed);
    let positions = mesh.positions().iter().map(|p| {
        let mut noise = || amplitude * random.symmetric();
        p + Vector3::new(noise(), noise(), noise())
    });
    TriMesh::new(positions.collect(), mesh.triangles().to_vec()).expect("the same triangles")
}
