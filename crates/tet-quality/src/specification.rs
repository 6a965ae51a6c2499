//! The kernels as the equations read: plain f64, one tetrahedron and one vertex after the other. Slow, and
//! the measure of every backend, [`Cpu`](geom_core::Cpu) included.
//!
//! Nothing here is shared with the fast kernels but the six volumes and the constants of the search, so that a mistake
//! in one is seen by comparison with the other. Read these first: sines come from angles and angles from vectors across
//! an edge, as a textbook has them.

use geom_core::mesh::six_volume;
use geom_core::{Point3, Vector3};

use crate::backend::Relaxation;
use crate::measure::metrics::Measures;
use crate::mesh::editable::GAIN;
use crate::smoothing::search::{SHRINK, STEP};

/// The six edges, each with the two other corners.
const EDGES: [([usize; 2], [usize; 2]); 6] = [
    ([0, 1], [2, 3]),
    ([0, 2], [3, 1]),
    ([0, 3], [1, 2]),
    ([1, 2], [0, 3]),
    ([1, 3], [2, 0]),
    ([2, 3], [0, 1]),
];

/// Joe and Liu's `η = 12 (3 V)^(2/3) / Σ l²` raised to 3/2, with the volume's sign (thesis Eq. 3.16).
/// 1 for the regular tetrahedron; 0 where all four corners are one.
pub fn joe_liu(corners: [Point3; 4]) -> f64 {
    let volume = six_volume(corners) / 6.0;
    let squares = lengths(corners).map(|l| l * l);
    let sum: f64 = squares.iter().sum();
    if sum == 0.0 {
        return 0.0;
    }
    let eta = 12.0 * (3.0 * volume.abs()).powf(2.0 / 3.0) / sum;
    eta.powf(1.5).copysign(volume)
}

/// The dihedral angles at the six edges, degrees.
/// In the order of the edges 01, 02, 03, 12, 13, 23; 0…180 whatever the orientation.
pub fn dihedral_angles(p: [Point3; 4]) -> [f64; 6] {
    EDGES.map(|([i, j], [k, l])| {
        // The parts of the other two corners across the edge enclose the angle.
        let along = (p[j] - p[i]).normalize();
        let across = [k, l].map(|c| {
            let d = p[c] - p[i];
            d - along * along.dot(&d)
        });
        across[0].angle(&across[1]).to_degrees()
    })
}

fn lengths(p: [Point3; 4]) -> [f64; 6] {
    EDGES.map(|([i, j], _)| (p[j] - p[i]).norm())
}

/// The measures of one tetrahedron.
/// Of one that is not positive the angles are 0 and 180.
pub fn measures(corners: [Point3; 4]) -> Measures {
    let lengths = lengths(corners);
    let longest = lengths.into_iter().fold(0.0, f64::max);
    let shortest = lengths.into_iter().fold(f64::INFINITY, f64::min);
    let six_volume = six_volume(corners);
    let (min_dihedral, max_dihedral) = if six_volume > 0.0 {
        let angles = dihedral_angles(corners);
        (
            angles.into_iter().fold(180.0, f64::min),
            angles.into_iter().fold(0.0, f64::max),
        )
    } else {
        (0.0, 180.0)
    };
    Measures {
        six_volume,
        joe_liu: joe_liu(corners),
        edge_ratio: longest / shortest,
        min_dihedral,
        max_dihedral,
    }
}

/// What [`QualityBackend::measure`](crate::QualityBackend::measure) computes.
/// In order, one per tetrahedron. Panics if a corner is out of range.
pub fn measure(positions: &[Point3], tets: &[[u32; 4]]) -> Vec<Measures> {
    let corners = |tet: &[u32; 4]| tet.map(|v| positions[v as usize]);
    tets.iter().map(|tet| measures(corners(tet))).collect()
}

/// The objective of a tetrahedron: the smallest sine of a dihedral angle or 1.14 times Joe–Liu, which is
/// less; of one that is not positive its Joe–Liu measure.
/// Not smooth: it has creases where another edge becomes the worst.
pub fn objective(corners: [Point3; 4]) -> f64 {
    let shape = joe_liu(corners);
    if six_volume(corners) <= 0.0 {
        return shape;
    }
    let sines = dihedral_angles(corners).map(|a| a.to_radians().sin());
    sines.into_iter().fold(1.14 * shape, f64::min)
}

/// What [`QualityBackend::relax`](crate::QualityBackend::relax) proposes: colour by colour, each vertex
/// searches the compass of its axes for the place where the worst tetrahedron around it is best.
/// One displacement in Å per vertex of the task, in its order. On a tie another implementation may choose another place
/// that is equally good.
pub fn relax(task: &Relaxation<'_>) -> Vec<Vector3> {
    let mut x = task.positions.to_vec();
    // A colour reads what the ones before it have moved; its own vertices are no neighbours.
    for i in task.colours.iter().cloned().flatten() {
        let faces = &task.faces[task.starts[i] as usize..task.starts[i + 1] as usize];
        let star: Vec<[Point3; 3]> = faces.iter().map(|f| f.map(|v| x[v as usize])).collect();
        let v = task.vertices[i] as usize;
        let slide = task.slide.as_ref().map(|s| (s.means[i], s.reach));
        x[v] = search(x[v], &star, &task.axes[i], slide, task.rounds);
    }
    let displacement = |&v: &u32| x[v as usize] - task.positions[v as usize];
    task.vertices.iter().map(displacement).collect()
}

/// The signed square of the worst objective around a vertex at `x`: it orders like the objective.
fn value(x: Point3, star: &[[Point3; 3]]) -> f64 {
    star.iter()
        .map(|&[a, b, c]| objective([x, a, b, c]))
        .map(|q| q * q.abs())
        .fold(f64::INFINITY, f64::min)
}

/// The best position found by a compass search: each round tries the directions, the first one also the
/// neighbours' mean, and takes the best of what is better; when nothing is, steps become shorter.
///
/// Where vertices slide there may be another mean or none, and no place is farther than a reach.
fn search(
    start: Point3,
    star: &[[Point3; 3]],
    axes: &[Vector3; 3],
    slide: Option<(Option<Vector3>, f64)>,
    rounds: u32,
) -> Point3 {
    let corners = || star.iter().flatten();
    let count = corners().count() as f64;
    let edge = corners().map(|c| (c - start).norm()).sum::<f64>() / count;
    let mut step = STEP * edge;
    let towards_mean: Vector3 = corners().map(|c| c - start).sum::<Vector3>() / count;
    let (towards_mean, reach) = slide.map_or((Some(towards_mean), f64::INFINITY), |(d, reach)| {
        (d, reach * edge)
    });
    let mean = towards_mean.map(|d| start + axes.iter().map(|a| a * a.dot(&d)).sum::<Vector3>());
    let directions = compass(axes);
    let (mut x, mut best) = (start, value(start, star));
    for round in 0..rounds {
        let around = directions.iter().map(|d| x + d * step);
        let tries: Vec<Point3> = mean
            .filter(|_| round == 0)
            .into_iter()
            .chain(around)
            .filter(|place| (place - start).norm() <= reach)
            .collect();
        let mut better = false;
        for candidate in tries {
            let reached = value(candidate, star);
            if reached > best + GAIN {
                (x, best, better) = (candidate, reached, true);
            }
        }
        if !better {
            step *= SHRINK;
        }
    }
    x
}

/// The unit directions along each axis that is not zero, both ways, and along all of them together.
fn compass(axes: &[Vector3; 3]) -> Vec<Vector3> {
    let free: Vec<Vector3> = axes.iter().copied().filter(|a| a.norm() > 0.0).collect();
    let mut directions: Vec<Vector3> = free.iter().flat_map(|a| [*a, -a]).collect();
    if free.len() > 1 {
        for signs in 0..1u32 << free.len() {
            let sum: Vector3 = (0..free.len())
                .map(|k| {
                    if signs >> k & 1 == 0 {
                        free[k]
                    } else {
                        -free[k]
                    }
                })
                .sum();
            directions.push(sum.normalize());
        }
    }
    directions
}
