//! What a part of a surface measures: area, curvature, mouths, depth, volume.

use std::collections::BTreeSet;

use geom_core::compute::sets::DisjointSets;
use geom_core::search::bvh::TriangleTree;
use geom_core::{Point3, TriMesh, Vector3};

/// How far from the surface a pocket's point may lie to speak for it, Å: a shell reaches 2.8 Å from the atoms, and the
/// surface may lie under that. Points deeper in a surface that has closed over them say nothing.
pub(super) const REACH: f64 = 4.5;
/// A border loop is a mouth of its own if its lid is this share of the largest one's.
/// Smaller ones are holes in the outline, from which no depth is measured.
const MOUTH: f64 = 0.1;

/// A pocket as a part of the surface.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct Outline {
    /// The pocket's rank.
    pub rank: usize,
    /// Triangles of the surface, ascending.
    pub triangles: Vec<u32>,
    /// Their area, Å².
    pub area: f64,
    /// Area-weighted mean curvature, Å⁻¹: negative where concave.
    pub mean_curvature: f64,
    /// Area of the mouths: of the fans over the border's loops, Å². A tunnel has two, a closed cavity none.
    pub mouth: f64,
    /// The largest distance of the patch from the nearest of its mouths, Å; 0 in a closed cavity.
    pub depth: f64,
    /// Volume between the patch and its mouths, Å³; of a closed cavity what its wall encloses. 0 where the patch bulges
    /// outward over its mouths more than it goes in.
    pub volume: f64,
    /// The points between two probes that belong to the pocket ([`OutlineSource::Probes`](crate::options::OutlineSource)), Å.
    pub hollow: Vec<Point3>,
}

/// A part of a surface with its measures, from the mean curvature of the vertices, Å⁻¹.
pub(super) fn measured(
    rank: usize,
    surface: &TriMesh,
    mean: &[f64],
    triangles: Vec<u32>,
) -> Outline {
    let (mut area, mut curved) = (0.0, 0.0);
    for &f in &triangles {
        let part = 0.5 * surface.doubled_area_normal(f as usize).norm();
        let corners = surface.triangles()[f as usize];
        area += part;
        curved += part * corners.map(|v| mean[v as usize]).iter().sum::<f64>() / 3.0;
    }
    let lids = Lid::all(surface, &triangles);
    Outline {
        rank,
        area,
        mean_curvature: if area > 0.0 { curved / area } else { 0.0 },
        mouth: lids.iter().fold(0.0, |sum, lid| sum + lid.normal.norm()),
        depth: depth(surface, &triangles, &lids),
        volume: volume(surface, &triangles, &lids),
        triangles,
        hollow: Vec::new(),
    }
}

/// The fan of triangles from the middle of a loop of a patch's border over its edges.
struct Lid {
    middle: Point3,
    /// Its area times its mean normal, out of the pocket.
    normal: Vector3,
    /// The loop's edges, as the patch's own triangles run along them.
    edges: Vec<[u32; 2]>,
}

impl Lid {
    /// One for each loop of the border: those of a tunnel's two ends face apart, and one over both would cancel.
    fn all(surface: &TriMesh, triangles: &[u32]) -> Vec<Self> {
        let mut sides: Vec<([u32; 2], [u32; 2])> = triangles
            .iter()
            .flat_map(|&f| {
                let [a, b, c] = surface.triangles()[f as usize];
                [[a, b], [b, c], [c, a]]
            })
            .map(|[a, b]| ([a.min(b), a.max(b)], [a, b]))
            .collect();
        sides.sort_unstable();
        let edges: Vec<[u32; 2]> = sides
            .chunk_by(|a, b| a.0 == b.0)
            .filter(|side| side.len() == 1)
            .map(|side| side[0].1)
            .collect();
        let mut joined = DisjointSets::new(surface.positions().len());
        for &[a, b] in &edges {
            joined.join(a, b);
        }
        let loop_of = joined.into_roots();
        let mut loops: Vec<(u32, [u32; 2])> =
            edges.iter().map(|e| (loop_of[e[0] as usize], *e)).collect();
        loops.sort_unstable();
        loops
            .chunk_by(|a, b| a.0 == b.0)
            .map(|edges| Self::of(surface, edges.iter().map(|e| e.1).collect()))
            .collect()
    }

    /// The middle is that of the edges, weighted by their lengths.
    fn of(surface: &TriMesh, edges: Vec<[u32; 2]>) -> Self {
        let at = |v: u32| surface.positions()[v as usize];
        let (mut sum, mut length) = (Vector3::zeros(), 0.0);
        for &[a, b] in &edges {
            let l = (at(b) - at(a)).norm();
            sum += (at(a).coords + at(b).coords) * (0.5 * l);
            length += l;
        }
        let middle = Point3::from(if length > 0.0 { sum / length } else { sum });
        // The patch runs along its border with itself on the left; seen from outside so does its lid.
        let fan = edges
            .iter()
            .map(|&[a, b]| (at(a) - middle).cross(&(at(b) - middle)) * 0.5);
        Self {
            middle,
            normal: fan.sum(),
            edges,
        }
    }
}

/// The largest distance of a corner from the nearest mouth, over which its fan is spread. 0 for a patch without a border.
///
/// Not the height under a mouth's plane: a tunnel that bends lies above the planes of its own mouths.
fn depth(surface: &TriMesh, triangles: &[u32], lids: &[Lid]) -> f64 {
    let largest = lids.iter().map(|lid| lid.normal.norm()).fold(0.0, f64::max);
    let at = |v: u32| surface.positions()[v as usize];
    let (mut positions, mut fans) = (Vec::new(), Vec::new());
    let is_mouth = |lid: &&Lid| lid.normal.norm() >= MOUTH * largest;
    for lid in lids.iter().filter(is_mouth) {
        for &[a, b] in &lid.edges {
            let first = positions.len() as u32;
            positions.extend([lid.middle, at(a), at(b)]);
            fans.push([first, first + 1, first + 2]);
        }
    }
    if fans.is_empty() {
        return 0.0;
    }
    let mouths = TriMesh::new(positions, fans).expect("corners of a valid mesh");
    let mouths = TriangleTree::new(&mouths).expect("triangles with finite corners");
    let corners = triangles
        .iter()
        .flat_map(|&f| surface.triangles()[f as usize]);
    let corners: BTreeSet<u32> = corners.collect();
    let distance = |&v: &u32| mouths.closest(&at(v)).distance;
    corners.iter().map(distance).fold(0.0, f64::max)
}

/// Enclosed by the lids, turned outwards, and the patch, turned inwards: what lies between them. Negative volumes,
/// of patches that bulge out, count as none. A patch without a border is the wall of a closed cavity.
fn volume(surface: &TriMesh, triangles: &[u32], lids: &[Lid]) -> f64 {
    // From a point nearby, where the tetrahedra are small.
    let of_patch = |&f: &u32| surface.corners(f as usize)[0];
    let o = match lids.first() {
        Some(lid) => lid.middle,
        None => triangles.first().map_or_else(Point3::origin, of_patch),
    };
    let six = |[a, b, c]: [Point3; 3]| (a - o).cross(&(b - o)).dot(&(c - o));
    let at = |v: u32| surface.positions()[v as usize];
    let fans = lids
        .iter()
        .flat_map(|lid| lid.edges.iter().map(|&[a, b]| [lid.middle, at(a), at(b)]));
    let lid: f64 = fans.map(six).sum();
    let patch: f64 = triangles
        .iter()
        .map(|&f| six(surface.corners(f as usize)))
        .sum();
    ((lid - patch) / 6.0).max(0.0)
}

/// What holds here, for the tests.
#[cfg(feature = "testing")]
pub(crate) mod laws {
    use std::f64::consts::PI;

    use geom_core::nalgebra::Rotation3;

    use super::*;

    /// The wall of a straight tunnel of radius 2 Å and length 10 Å, seen from inside.
    fn tunnel(around: u32, along: u32) -> TriMesh {
        let positions = (0..=along).flat_map(|j| {
            (0..around).map(move |i| {
                let angle = 2.0 * PI * f64::from(i) / f64::from(around);
                let z = 10.0 * f64::from(j) / f64::from(along);
                Point3::new(2.0 * angle.cos(), 2.0 * angle.sin(), z)
            })
        });
        let at = |i: u32, j: u32| j * around + i % around;
        let quads = (0..along).flat_map(|j| (0..around).map(move |i| (i, j)));
        let triangles = quads.flat_map(|(i, j)| {
            let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
            [[a, c, b], [a, d, c]]
        });
        TriMesh::new(positions.collect(), triangles.collect()).unwrap()
    }

    /// Two mouths, the middle farthest from both, and a cylinder's volume.
    pub fn a_tunnel_has_two_mouths() {
        let wall = tunnel(256, 40);
        let triangles: Vec<u32> = (0..wall.triangles().len() as u32).collect();
        let lids = Lid::all(&wall, &triangles);
        assert_eq!(lids.len(), 2);
        let disc = 4.0 * PI;
        let mouths: f64 = lids.iter().map(|lid| lid.normal.norm()).sum();
        assert!((mouths / (2.0 * disc) - 1.0).abs() < 1e-3, "{mouths}");
        assert!((depth(&wall, &triangles, &lids) - 5.0).abs() < 1e-9);
        let enclosed = volume(&wall, &triangles, &lids);
        assert!((enclosed / (10.0 * disc) - 1.0).abs() < 1e-3, "{enclosed}");
    }

    /// Three quarters of a ring: the middle lies above the planes of both mouths, and is deep all the same. So it is in any pose.
    pub fn a_bent_tunnel_is_deep_in_any_pose() {
        let straight = tunnel(64, 60);
        let (positions, triangles) = straight.into_parts();
        let bent = |p: &Point3| {
            let (sin, cos) = (1.5 * PI * p.z / 10.0).sin_cos();
            Point3::new((6.0 + p.x) * cos, (6.0 + p.x) * sin, p.y)
        };
        let wall: Vec<Point3> = positions.iter().map(bent).collect();
        let pose = Rotation3::from_euler_angles(0.3, -1.1, 2.0);
        let depths = [Rotation3::identity(), pose].map(|pose| {
            let wall = wall.iter().map(|p| pose * p).collect();
            let wall = TriMesh::new(wall, triangles.clone()).unwrap();
            let all: Vec<u32> = (0..triangles.len() as u32).collect();
            depth(&wall, &all, &Lid::all(&wall, &all))
        });
        // The middle's outermost corner from the innermost of a mouth.
        let half = 8.0 / 2.0_f64.sqrt();
        let expected = (4.0 + half).hypot(half);
        assert!((depths[0] - expected).abs() < 1e-9, "{depths:?}");
        assert!((depths[0] - depths[1]).abs() < 1e-9, "{depths:?}");
    }

    /// The wall of a round cavity, far from the origin: all of its volume, and no mouth. Seen from outside it is a body, no
    /// cavity.
    pub fn a_closed_cavity_has_its_volume_and_no_mouth() {
        let ball = geom_core::mesh::shapes::icosphere(3.0, 4);
        let place = Vector3::new(40.0, -70.0, 90.0);
        let positions: Vec<Point3> = ball.positions().iter().map(|p| p + place).collect();
        let inwards = ball.triangles().iter().map(|&[a, b, c]| [a, c, b]);
        let wall = TriMesh::new(positions.clone(), inwards.collect()).unwrap();
        let triangles: Vec<u32> = (0..wall.triangles().len() as u32).collect();
        let mean = vec![-1.0 / 3.0; positions.len()];
        let found = measured(1, &wall, &mean, triangles.clone());
        let exact = 36.0 * PI;
        assert!(
            (found.volume / exact - 1.0).abs() < 0.01,
            "{}",
            found.volume
        );
        assert!((found.area / exact - 1.0).abs() < 0.01, "{}", found.area);
        assert_eq!((found.mouth.to_bits(), found.depth), (0, 0.0));
        let body = TriMesh::new(positions, ball.triangles().to_vec()).unwrap();
        assert_eq!(measured(1, &body, &mean, triangles).volume, 0.0);
    }
}
