//! How coarse each place may be: levels of fine quads from labels, curvature or any field.
//!
//! Level 0 keeps a fine quad, level *l* allows elements of 2^l × 2^l. What lies on another surface is carried to the
//! quads by [`Places`]; [`cleaned`] takes noise away, so that levels make few T-junctions.

use std::collections::VecDeque;

use geom_core::mesh::Halfedges;
use geom_core::options::require;
use geom_core::search::bvh::{Closest, TriangleTree};
use geom_core::surface::curvature;
use geom_core::{FaceId, HalfedgeId, Point3, QuadMesh, TriMesh, Vector3};

use crate::Error;
use crate::mesh::check_levels;
use crate::options::{CleanOptions, MAX_LEVEL};

/// Rings of neighbours to which curvature is fitted.
const RINGS: usize = 2;

/// Where the centres of quads lie on a surface.
pub struct Places<'a> {
    surface: &'a TriMesh,
    closest: Vec<Closest>,
}

impl<'a> Places<'a> {
    /// The points of a surface that are nearest to the centres of quads.
    ///
    /// # Errors
    /// [`Error::Tree`] for a surface without triangles.
    pub fn of(surface: &'a TriMesh, fine: &QuadMesh) -> Result<Self, Error> {
        let closest = TriangleTree::new(surface)?.closest_to_all(&centres(fine))?;
        Ok(Self { surface, closest })
    }

    /// Labels of the surface's triangles at the quads.
    ///
    /// # Errors
    /// [`Error::Count`] unless there is one per triangle.
    pub fn labels(&self, per_triangle: &[u32]) -> Result<Vec<u32>, Error> {
        one_each("labels", per_triangle.len(), self.surface.triangles().len())?;
        let of = |c: &Closest| per_triangle[c.triangle as usize];
        Ok(self.closest.iter().map(of).collect())
    }

    /// Values of the surface's vertices at the quads, linear between them.
    ///
    /// # Errors
    /// [`Error::Count`] unless there is one per vertex.
    pub fn values(&self, per_vertex: &[f64]) -> Result<Vec<f64>, Error> {
        one_each("values", per_vertex.len(), self.surface.positions().len())?;
        let of = |c: &Closest| {
            let corners = self.surface.triangles()[c.triangle as usize];
            (0..3)
                .map(|k| c.barycentric[k] * per_vertex[corners[k] as usize])
                .sum()
        };
        Ok(self.closest.iter().map(of).collect())
    }

    /// The larger principal curvature at the quads, without sign, Å⁻¹; 0 where it is unknown, as at rims.
    pub fn curvatures(&self) -> Vec<f64> {
        let largest = |c: &curvature::Principal| {
            let largest = c.max.abs().max(c.min.abs());
            if c.confidence > 0.0 { largest } else { 0.0 }
        };
        let principal = curvature::principal(self.surface, RINGS);
        let per_vertex: Vec<f64> = principal.iter().map(largest).collect();
        self.values(&per_vertex).expect("one per vertex")
    }
}

/// The centres of quads.
pub fn centres(fine: &QuadMesh) -> Vec<Point3> {
    let of = |q: usize| {
        let sum: Vector3 = fine.corners(q).iter().map(|p| p.coords).sum();
        Point3::from(sum / 4.0)
    };
    (0..fine.quads().len()).map(of).collect()
}

/// The highest level whose elements have sides of at most this length, Å, which may be infinite; at most `most`.
///
/// A side is the mean of the quad's four. NaN and lengths below a side give level 0, an infinite length `most`.
///
/// # Errors
/// [`Error::Count`] unless there is one length per quad.
pub fn by_side(fine: &QuadMesh, lengths: &[f64], most: u8) -> Result<Vec<u8>, Error> {
    one_each("lengths", lengths.len(), fine.quads().len())?;
    let of = |(q, &length): (usize, &f64)| {
        let p = fine.corners(q);
        let side = (0..4).map(|k| (p[(k + 1) % 4] - p[k]).norm()).sum::<f64>() / 4.0;
        let levels = (length / side).log2().floor();
        // NaN is no wish for coarseness.
        if levels > 0.0 {
            levels.min(f64::from(most.min(MAX_LEVEL))) as u8
        } else {
            0
        }
    };
    Ok(lengths.iter().enumerate().map(of).collect())
}

/// Levels by curvature: along the side of an element the surface turns by `angle` (radians) at most.
///
/// # Errors
/// [`Error::Count`] if the places are those of other quads; [`Error::Option`] unless the angle is positive.
pub fn by_curvature(
    fine: &QuadMesh,
    places: &Places<'_>,
    angle: f64,
    most: u8,
) -> Result<Vec<u8>, Error> {
    require(angle > 0.0, "angle", angle, "be positive, in radians")?;
    let lengths: Vec<f64> = places.curvatures().iter().map(|k| angle / k).collect();
    by_side(fine, &lengths, most)
}

/// Levels by a field, one value per quad: level 0 where it is largest, `most` where it is smallest, in equal steps between
/// the 5 % and the 95 % quantile. Where it is no number, and everywhere if it is constant, the level is 0.
pub fn by_field(values: &[f64], most: u8) -> Vec<u8> {
    let mut sorted: Vec<f64> = values.iter().copied().filter(|v| v.is_finite()).collect();
    sorted.sort_by(f64::total_cmp);
    let at = |share: f64| {
        let last = sorted.len().saturating_sub(1) as f64;
        sorted
            .get((last * share).round() as usize)
            .copied()
            .unwrap_or(0.0)
    };
    let (low, high) = (at(0.05), at(0.95));
    let most = most.min(MAX_LEVEL);
    let of = |&value: &f64| {
        let part = (high - value) / (high - low);
        let level = (part * f64::from(most + 1)).floor();
        if part.is_finite() && level > 0.0 {
            level.min(f64::from(most)) as u8
        } else {
            0
        }
    };
    values.iter().map(of).collect()
}

/// Levels without noise: each quad takes the level that most quads around it have, islands smaller than some elements of
/// their level take that of their surroundings, and a band of levels between lies where neighbours differ by more than
/// one.
///
/// # Errors
/// [`Error::Count`] unless there is one level per quad; [`Error::Level`], [`Error::Mesh`], [`Error::Option`].
pub fn cleaned(fine: &QuadMesh, levels: &[u8], options: &CleanOptions) -> Result<Vec<u8>, Error> {
    options.check()?;
    check_levels(fine, levels)?;
    let edges = Halfedges::of_quads(fine)?;
    let mut levels = levels.to_vec();
    for _ in 0..options.rounds {
        levels = majority(&edges, &levels);
    }
    let most = levels.iter().copied().max().unwrap_or(0);
    for level in 1..=most {
        let island = options.island.saturating_mul(1 << (2 * level));
        join_islands(&edges, &mut levels, island, |l| l >= level, level - 1);
        let island = options.island.saturating_mul(1 << (2 * (level - 1)));
        join_islands(&edges, &mut levels, island, |l| l < level, level);
    }
    for level in 0..most {
        band(&edges, &mut levels, level, options.band << (level + 1));
    }
    Ok(levels)
}

/// The quads beside a quad.
fn beside(edges: &Halfedges<4>, quad: u32) -> impl Iterator<Item = u32> + '_ {
    (0..4)
        .filter_map(move |k| edges.twin(edges.of_face(FaceId(quad), k)))
        .map(|h: HalfedgeId| edges.face(h).0)
}

/// The level that most of a quad and the quads around its corners have; its own among equals.
fn majority(edges: &Halfedges<4>, levels: &[u8]) -> Vec<u8> {
    let of = |q: u32| {
        let mut near: Vec<u32> = (0..4)
            .flat_map(|k| edges.around(edges.from(edges.of_face(FaceId(q), k))))
            .map(|h| edges.face(h).0)
            .collect();
        near.sort_unstable();
        near.dedup();
        let mut count = [0usize; MAX_LEVEL as usize + 1];
        for &n in &near {
            count[usize::from(levels[n as usize].min(MAX_LEVEL))] += 1;
        }
        let own = levels[q as usize].min(MAX_LEVEL);
        let best =
            (0..=MAX_LEVEL).max_by_key(|&l| (count[usize::from(l)], l == own, MAX_LEVEL - l));
        best.unwrap_or(own)
    };
    (0..levels.len() as u32).map(of).collect()
}

/// Connected sets of quads whose levels are such, of fewer than `least` quads, get another level.
fn join_islands(
    edges: &Halfedges<4>,
    levels: &mut [u8],
    least: u32,
    is_such: impl Fn(u8) -> bool,
    other: u8,
) {
    let mut seen = vec![false; levels.len()];
    for start in 0..levels.len() as u32 {
        if seen[start as usize] || !is_such(levels[start as usize]) {
            continue;
        }
        seen[start as usize] = true;
        let mut island = vec![start];
        let mut at = 0;
        while let Some(&q) = island.get(at) {
            at += 1;
            for n in beside(edges, q) {
                if !seen[n as usize] && is_such(levels[n as usize]) {
                    seen[n as usize] = true;
                    island.push(n);
                }
            }
        }
        // What is alone in its part of the surface is no island.
        let shore = island
            .iter()
            .any(|&q| beside(edges, q).any(|n| !is_such(levels[n as usize])));
        if island.len() < least as usize && shore {
            for q in island {
                levels[q as usize] = other;
            }
        }
    }
}

/// Within so many quads of those of a level or less, at most the next level.
fn band(edges: &Halfedges<4>, levels: &mut [u8], level: u8, width: u32) {
    let mut steps: Vec<u32> = levels
        .iter()
        .map(|&l| if l <= level { 0 } else { width + 1 })
        .collect();
    let starts = (0..levels.len() as u32).filter(|&q| steps[q as usize] == 0);
    let mut queue: VecDeque<u32> = starts.collect();
    while let Some(q) = queue.pop_front() {
        let next = steps[q as usize] + 1;
        for n in beside(edges, q) {
            if next <= width && steps[n as usize] > next {
                steps[n as usize] = next;
                levels[n as usize] = levels[n as usize].min(level + 1);
                queue.push_back(n);
            }
        }
    }
}

fn one_each(what: &'static str, found: usize, expected: usize) -> Result<(), Error> {
    if found == expected {
        Ok(())
    } else {
        Err(Error::Count {
            what,
            found,
            expected,
        })
    }
}
