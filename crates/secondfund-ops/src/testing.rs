//! Shapes and tasks for tests and benches.
//!
//! Shapes whose parts, creases or hollows are known by their making, so that a test can ask for them.

use geom_core::compute::random::SplitMix64;
use geom_core::mesh::shapes;
use geom_core::search::bvh::TriangleTree;
use geom_core::{Point3, QuadMesh, TriMesh, Vector3};

/// A box of these half extents with its edges and corners rounded by `radius`, as `6 n²` quads.
/// Quads spread evenly over each side; their normals point outwards. Panics if `radius` is larger than a half extent.
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
/// Directions need not be unit vectors. A dimple is a Gaussian of the angle from its direction, in shares of the
/// radius.
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

/// Each triangle of a surface as three quads: inner vertices of valence 3, 4 and 5.
/// The vertices of the triangles come first, then the middles of their sides and of the triangles, as they are met.
pub fn halved(mesh: &TriMesh) -> QuadMesh {
    let mut positions = mesh.positions().to_vec();
    let mut middles = std::collections::BTreeMap::new();
    let mut quads = Vec::new();
    for (t, &corners) in mesh.triangles().iter().enumerate() {
        let [a, b, c] = corners;
        let mut sides = [[a, b], [b, c], [c, a]].map(|[p, q]| {
            let middle = *middles
                .entry([p.min(q), p.max(q)])
                .or_insert(positions.len() as u32);
            if middle as usize == positions.len() {
                let ends = [p, q].map(|v| mesh.positions()[v as usize].coords);
                positions.push(Point3::from((ends[0] + ends[1]) / 2.0));
            }
            middle
        });
        let center = positions.len() as u32;
        let sum: Vector3 = mesh.corners(t).iter().map(|p| p.coords).sum();
        positions.push(Point3::from(sum / 3.0));
        for corner in corners {
            quads.push([corner, sides[0], center, sides[2]]);
            sides.rotate_left(1);
        }
    }
    QuadMesh::new(positions, quads).expect("the corners of the triangles")
}

/// The mesh with each vertex moved by up to `amplitude` along each axis.
/// Each coordinate by a number within ±`amplitude` that depends on the seed only.
pub fn shaken(mesh: &TriMesh, amplitude: f64, seed: u64) -> TriMesh {
    let mut random = SplitMix64::new(seed);
    let positions = mesh.positions().iter().map(|p| {
        let mut noise = || amplitude * random.symmetric();
        p + Vector3::new(noise(), noise(), noise())
    });
    TriMesh::new(positions.collect(), mesh.triangles().to_vec()).expect("the same triangles")
}

/// The quads with each vertex moved in the same way.
pub fn shaken_quads(mesh: &QuadMesh, amplitude: f64, seed: u64) -> QuadMesh {
    let (positions, quads) = mesh.clone().into_parts();
    let points = TriMesh::new(positions, Vec::new()).expect("finite positions");
    let (positions, _) = shaken(&points, amplitude, seed).into_parts();
    QuadMesh::new(positions, quads).expect("the same quads")
}

/// How noisy the flat parts of a rounded box are, and how far its creases lie from where they were.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BoxErrors {
    /// Root mean square of the angles between the normals of its flat triangles and those of the clean box, degrees.
    pub flat: f64,
    /// Mean distance of the vertices of edges and corners from the clean surface, in mean edges.
    pub crease: f64,
}

/// The errors of a [`rounded_box`] as triangles, with the same triangles as the clean one.
/// Triangles count as flat where the clean normal is an axis; vertices belong to creases where they lie near two sides
/// at least.
pub fn box_errors(clean: &TriMesh, now: &TriMesh, half: [f64; 3], radius: f64) -> BoxErrors {
    let (mut squares, mut flat) = (0.0, 0usize);
    for t in 0..clean.triangles().len() {
        let n = clean.doubled_area_normal(t).normalize();
        if n.amax() > 1.0 - 1e-9 {
            squares += n.angle(&now.doubled_area_normal(t)).powi(2);
            flat += 1;
        }
    }
    let tree = TriangleTree::new(clean).expect("a valid mesh");
    let edge = 1.5 * (clean.area() / clean.triangles().len() as f64).sqrt();
    let distances: Vec<f64> = (0..clean.positions().len())
        .filter(|&v| {
            let p = clean.positions()[v];
            let near = |k: &usize| half[*k] - p[*k].abs() < 0.6 * radius;
            (0..3).filter(near).count() >= 2
        })
        .map(|v| tree.closest(&now.positions()[v]).distance / edge)
        .collect();
    BoxErrors {
        flat: (squares / flat as f64).sqrt().to_degrees(),
        crease: distances.iter().sum::<f64>() / distances.len() as f64,
    }
}
