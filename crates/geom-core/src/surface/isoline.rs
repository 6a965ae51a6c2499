//! Lines of equal value of a vertex field on a triangle mesh.
//!
//! A line crosses triangles: within one it is straight, from the edge where values fall below the level to the one
//! where they rise above it. Lines are made of these segments by matching edges; no tree and no start points are
//! needed, and no line is missed.

use crate::compute::parallel;
use rayon::prelude::*;

use crate::{Point3, TriMesh};

/// Why isolines cannot be drawn.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum IsolineError {
    /// Not one value per vertex.
    #[error("{values} values for {vertices} vertices; there must be one per vertex")]
    Length {
        /// Number of values.
        values: usize,
        /// Number of vertices.
        vertices: usize,
    },
    /// A value is NaN or infinite.
    #[error("the value at vertex {vertex} is not a finite number")]
    NotFinite {
        /// The vertex.
        vertex: usize,
    },
    /// A level is NaN or infinite.
    #[error("level {level} is not a finite number")]
    Level {
        /// Which of the levels.
        level: usize,
    },
}

/// A line of equal value.
///
/// There are as many triangles as points in a closed line, one less in an open one.
#[derive(Clone, Debug, PartialEq)]
pub struct Isoline {
    /// The value.
    pub level: f64,
    /// Where it crosses edges, in order; larger values lie on its left, seen from outside. Points
    /// repeat where it passes through a vertex.
    pub points: Vec<Point3>,
    /// The triangles it runs through: number `i` between point `i` and the next.
    pub triangles: Vec<u32>,
    /// Does it return to its first point (which is not repeated)? Else it ends at a boundary, or
    /// where an edge has other than two equally oriented triangles.
    pub closed: bool,
}

impl Isoline {
    /// Length, Å.
    pub fn length(&self) -> f64 {
        let gap = |a: &Point3, b: &Point3| (b - a).norm();
        let open: f64 = self.points.windows(2).map(|w| gap(&w[0], &w[1])).sum();
        match (self.closed, &self.points[..]) {
            (true, [first, .., last]) => open + gap(last, first),
            _ => open,
        }
    }
}

/// Part of a line within one triangle, from the edge where values fall to where they rise.
struct Segment {
    triangle: u32,
    edges: [[u32; 2]; 2],
}

/// The isolines of a field with one value per vertex, linear on triangles, level by level and then by
/// lowest triangle. A vertex whose value equals the level counts as above it.
///
/// ```
/// use geom_core::mesh::shapes;
/// use geom_core::surface::isoline::isolines;
/// let sphere = shapes::icosphere(1.0, 4);
/// let height: Vec<f64> = sphere.positions().iter().map(|p| p.z).collect();
/// let lines = isolines(&sphere, &height, &[0.0, 0.6])?;
/// assert_eq!(lines.len(), 2);
/// assert!((lines[0].length() - std::f64::consts::TAU).abs() < 0.01);
/// assert!((lines[1].length() - 0.8 * std::f64::consts::TAU).abs() < 0.01);
/// # Ok::<(), geom_core::surface::isoline::IsolineError>(())
/// ```
///
/// A triangle all of whose values are at the level or above it has no line. Lines neither branch nor cross, also at
/// saddles, since values decide vertex by vertex. Levels are independent, in parallel; one given twice has its lines
/// twice.
///
/// # Errors
/// [`IsolineError::Length`], [`IsolineError::NotFinite`] and [`IsolineError::Level`], in this order, each for the first
/// at fault.
pub fn isolines(
    mesh: &TriMesh,
    values: &[f64],
    levels: &[f64],
) -> Result<Vec<Isoline>, IsolineError> {
    let vertices = mesh.positions().len();
    if values.len() != vertices {
        return Err(IsolineError::Length {
            values: values.len(),
            vertices,
        });
    }
    if let Some(vertex) = values.iter().position(|v| !v.is_finite()) {
        return Err(IsolineError::NotFinite { vertex });
    }
    if let Some(level) = levels.iter().position(|v| !v.is_finite()) {
        return Err(IsolineError::Level { level });
    }
    let lines: Vec<Vec<Isoline>> =
        parallel::map_each(levels, |&level| at_level(mesh, values, level));
    Ok(lines.into_iter().flatten().collect())
}

/// Segments are looked up by the edges where they start and end. A line goes on over an edge that exactly one segment
/// enters and exactly one leaves, which is so at inner edges of an oriented surface; elsewhere it ends.
fn at_level(mesh: &TriMesh, values: &[f64], level: f64) -> Vec<Isoline> {
    let above = |v: u32| values[v as usize] >= level;
    let triangles = mesh.triangles();
    let segments: Vec<Segment> = parallel::flat_map(triangles.len(), |t| {
        let c = triangles[t];
        let side = |k: usize| [c[k], c[(k + 1) % 3]];
        let falling = (0..3).map(side).find(|&[a, b]| above(a) && !above(b))?;
        let rising = (0..3).map(side).find(|&[a, b]| !above(a) && above(b))?;
        Some(Segment {
            triangle: t as u32,
            edges: [falling, rising],
        })
    });
    // Where each edge is entered and left: lines go on where that is once each.
    let sorted = |end: usize| {
        let mut keys: Vec<([u32; 2], u32)> = (0..)
            .zip(&segments)
            .map(|(i, s)| (key(s.edges[end]), i))
            .collect();
        keys.par_sort_unstable();
        keys
    };
    let (starts, ends) = (sorted(0), sorted(1));
    let only = |keys: &[([u32; 2], u32)], edge: [u32; 2]| {
        let first = keys.partition_point(|k| k.0 < key(edge));
        match keys[first..] {
            [(k, i), ref rest @ ..] if k == key(edge) && rest.first().is_none_or(|r| r.0 != k) => {
                Some(i)
            }
            _ => None,
        }
    };
    let follows = |i: u32| {
        let edge = segments[i as usize].edges[1];
        only(&ends, edge).and(only(&starts, edge))
    };
    let leads = |i: u32| {
        let edge = segments[i as usize].edges[0];
        only(&starts, edge).and(only(&ends, edge))
    };
    let crossing = |edge: [u32; 2]| {
        // From the lower vertex, so that both triangles find the same point.
        let [a, b] = key(edge);
        let (va, vb) = (values[a as usize], values[b as usize]);
        let (p, q) = (mesh.positions()[a as usize], mesh.positions()[b as usize]);
        // Halves, so that large values of either sign do not overflow.
        let t = (0.5 * level - 0.5 * va) / (0.5 * vb - 0.5 * va);
        p + (q - p) * t.clamp(0.0, 1.0)
    };
    let mut seen = vec![false; segments.len()];
    let mut lines = Vec::new();
    let mut walk = |first: u32, seen: &mut Vec<bool>| {
        let mut line = Isoline {
            level,
            points: Vec::new(),
            triangles: Vec::new(),
            closed: false,
        };
        let mut at = Some(first);
        while let Some(i) = at {
            if seen[i as usize] {
                line.closed = true;
                break;
            }
            seen[i as usize] = true;
            line.points.push(crossing(segments[i as usize].edges[0]));
            line.triangles.push(segments[i as usize].triangle);
            at = follows(i);
            if at.is_none() {
                line.points.push(crossing(segments[i as usize].edges[1]));
            }
        }
        lines.push(line);
    };
    // Open lines from their starts first, then what is left runs in circles.
    for open in [true, false] {
        for i in 0..segments.len() as u32 {
            if !seen[i as usize] && (!open || leads(i).is_none()) {
                walk(i, &mut seen);
            }
        }
    }
    lines.sort_by_key(|line| line.triangles.iter().copied().min());
    lines
}

fn key([a, b]: [u32; 2]) -> [u32; 2] {
    [a.min(b), a.max(b)]
}
