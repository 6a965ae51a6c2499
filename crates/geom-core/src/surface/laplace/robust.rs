//! Operators for any triangles: the tufted cover with Delaunay edges.
//!
//! Every triangle gets a front and a back, glued around each edge to a closed surface without
//! boundary, whatever the edge is in the input. Slivers are thickened by one small length on all
//! edges, and edges are flipped in the surface, not in space, until none is against Delaunay. The
//! weights of the edges are then never negative (Sharp and Crane, "A Laplacian for Nonmanifold
//! Triangle Meshes", 2020).
//!
//! No coordinates are needed after the first step: a triangle is three lengths, which is why a flipped edge may run
//! across a bend of the surface, and why the vertices stay where they are. Linear functions on the flipped triangles
//! have one value per vertex as before.

use super::{Error, Mass, Robust, RobustReport};
use crate::TriMesh;
use crate::algebra::SparseMatrix;
use crate::compute::parallel;

/// Smallest excess of two sides over the third, in mean edges of the mesh. Enough that cotangents stay far from
/// overflow, and small beside any triangle that means something.
const THICKNESS: f64 = 1e-5;
/// Sums of cotangents above this count as Delaunay: a square's diagonal flips no more.
const TIE: f64 = -1e-9;

/// A side of a triangle of the cover: `3 · face + k`, from corner `k` to corner `k + 1`.
type Side = u32;

/// The cover: closed, each side glued to one other. Two faces for each triangle of the mesh, the fronts first; three
/// numbers of each kind per face.
struct Cover {
    corners: Vec<u32>,
    lengths: Vec<f64>,
    twin: Vec<Side>,
}

/// The triangles of the cover, each with half its weight: two sheets make one surface.
///
/// What is integrated over it is integrated over both sheets, so weights and areas are halved once here and never
/// again.
#[derive(Clone, Debug)]
pub(crate) struct Intrinsic {
    /// Corners, vertices of the mesh.
    pub(crate) triangles: Vec<[u32; 3]>,
    /// Half the cotangent at each corner, halved.
    pub(crate) weights: Vec<[f64; 3]>,
    /// Areas, halved.
    pub(crate) areas: Vec<f64>,
    report: RobustReport,
}

impl Intrinsic {
    pub(crate) fn of(mesh: &TriMesh) -> Result<Self, Error> {
        let faces = mesh.triangles();
        if 2 * faces.len() > crate::id::MAX_ELEMENTS / 3 {
            return Err(crate::algebra::Error::TooLarge {
                rows: mesh.positions().len(),
                entries: 18 * faces.len() as u128,
            }
            .into());
        }
        let (lengths, added) = thickened(mesh)?;
        let mut cover = Cover::glue(faces, &lengths);
        let flips = cover.make_delaunay();
        let of_faces = parallel::map(2 * faces.len(), |f| {
            let sides = cover.sides(f as u32);
            let area = area_of(sides);
            (half_cotangents(sides, area).map(|c| 0.5 * c), 0.5 * area)
        });
        let (weights, areas) = of_faces.into_iter().unzip();
        Ok(Self {
            triangles: cover.corners.as_chunks::<3>().0.to_vec(),
            weights,
            areas,
            report: RobustReport { flips, added },
        })
    }

    /// The length of the side opposite to a corner. From `l² = 2 A (cot β + cot γ)` with the angles at its ends.
    pub(crate) fn length(&self, triangle: usize, corner: usize) -> f64 {
        let w = self.weights[triangle];
        let sum = w[(corner + 1) % 3] + w[(corner + 2) % 3];
        (16.0 * self.areas[triangle] * sum).max(0.0).sqrt()
    }

    /// Stiffness and lumped mass for so many vertices.
    pub(crate) fn operators(&self, vertices: usize) -> Result<(SparseMatrix, Vec<f64>), Error> {
        let element = |f: usize| super::element_stiffness(self.weights[f]);
        let stiffness = super::assemble(vertices, &self.triangles, element)?;
        let masses = super::spread_areas(vertices, &self.triangles, &self.areas);
        Ok((stiffness, masses))
    }
}

pub(super) fn robust(mesh: &TriMesh) -> Result<Robust, Error> {
    let surface = Intrinsic::of(mesh)?;
    let (stiffness, masses) = surface.operators(mesh.positions().len())?;
    Ok(Robust {
        stiffness,
        mass: Mass::Lumped(masses),
        report: surface.report,
    })
}

/// Three edge lengths per triangle (side `k` from corner `k`), and what was added to all of them so
/// that none is a needle or a cap of no height. Triangle inequalities hold with some excess afterwards, and ratios of
/// long edges hardly change (the mollification of that paper).
fn thickened(mesh: &TriMesh) -> Result<(Vec<f64>, f64), Error> {
    let mut lengths: Vec<f64> = parallel::flat_map(mesh.triangles().len(), |t| {
        let [a, b, c] = mesh.corners(t);
        [(b - a).norm(), (c - b).norm(), (a - c).norm()]
    });
    if let Some(at) = lengths.iter().position(|l| !l.is_finite()) {
        return Err(Error::Degenerate { triangle: at / 3 });
    }
    let mean = parallel::sum(lengths.len(), |i| lengths[i]) / lengths.len().max(1) as f64;
    if !lengths.is_empty() && (mean == 0.0 || !mean.is_finite()) {
        return Err(Error::Degenerate { triangle: 0 });
    }
    let floor = THICKNESS * mean;
    let added = lengths
        .as_chunks::<3>()
        .0
        .iter()
        .map(|&[a, b, c]| floor - (a + b - c).min(b + c - a).min(c + a - b))
        .fold(0.0, f64::max);
    lengths.iter_mut().for_each(|l| *l += added);
    Ok((lengths, added))
}

impl Cover {
    /// Around an edge of g triangles the 2 g sides are joined in a circle: the sheet of one triangle that runs up with
    /// the sheet of the next that runs down. With one triangle front joins back, with two that agree, the two fronts
    /// and the two backs. The order of the fan is that of the triangles' numbers; space does not come into it.
    fn glue(faces: &[[u32; 3]], lengths: &[f64]) -> Self {
        let count = faces.len();
        // Front of triangle t: face t, corners (a, b, c). Back: face count + t, corners (b, a, c), so
        // that its side k runs along the front's side FLIPPED[k].
        let mut corners = faces.as_flattened().to_vec();
        corners.extend(faces.iter().flat_map(|&[a, b, c]| [b, a, c]));
        let mut all = lengths.to_vec();
        all.extend(
            lengths
                .as_chunks::<3>()
                .0
                .iter()
                .flat_map(|&[ab, bc, ca]| [ab, ca, bc]),
        );
        let mut twin = vec![0; 6 * count];
        // Sides by edge, then by triangle: a group is the fan around an edge.
        let side = |s: usize| {
            let face = &faces[s / 3];
            let (a, b) = (face[s % 3], face[(s + 1) % 3]);
            (u64::from(a.min(b)) << 32 | u64::from(a.max(b)), s as u32)
        };
        let sides = parallel::sorted_by_number(3 * count, side, |side| (side.0 >> 32) as u32);
        for group in sides.chunk_by(|a, b| a.0 == b.0) {
            // Of front and back, one sheet runs up the edge and the other down.
            let sheet = |side: u32, up: bool| {
                let (t, k) = (side / 3, side % 3);
                let face = &faces[t as usize];
                if (face[k as usize] < face[(k as usize + 1) % 3]) == up {
                    side
                } else {
                    3 * (count as u32 + t) + [0, 2, 1][k as usize]
                }
            };
            for (i, &(_, side)) in group.iter().enumerate() {
                let next = group[(i + 1) % group.len()].1;
                let (up, down) = (sheet(side, true), sheet(next, false));
                twin[up as usize] = down;
                twin[down as usize] = up;
            }
        }
        Self {
            corners,
            lengths: all,
            twin,
        }
    }

    /// The side lengths of a face.
    fn sides(&self, face: u32) -> [f64; 3] {
        let at = 3 * face as usize;
        [self.lengths[at], self.lengths[at + 1], self.lengths[at + 2]]
    }

    /// The cotangent of the corner opposite to a side.
    fn cotangent(&self, side: Side) -> f64 {
        let sides = self.sides(side / 3);
        2.0 * half_cotangents(sides, area_of(sides))[OPPOSITE[side as usize % 3]]
    }

    /// Flips sides until all are Delaunay; how many it took. Lawson's flips, which end on every closed surface of
    /// lengths (Bobenko and Springborn, *A discrete Laplace–Beltrami operator for simplicial surfaces*, 2007): first
    /// in, first out, each side by the lower of its two numbers.
    fn make_delaunay(&mut self) -> usize {
        let mut queued = vec![false; self.twin.len()];
        let mut queue = std::collections::VecDeque::new();
        for side in 0..self.twin.len() as u32 {
            if side < self.twin[side as usize] {
                queued[side as usize] = true;
                queue.push_back(side);
            }
        }
        let mut flips = 0;
        while let Some(side) = queue.pop_front() {
            queued[side as usize] = false;
            let twin = self.twin[side as usize];
            if self.cotangent(side) + self.cotangent(twin) >= TIE || !self.flip(side) {
                continue;
            }
            flips += 1;
            // The new side is the first of both triangles.
            let (f, g) = (3 * (side / 3), 3 * (twin / 3));
            for s in [f + 1, f + 2, g + 1, g + 2] {
                let s = s.min(self.twin[s as usize]);
                if !queued[s as usize] {
                    queued[s as usize] = true;
                    queue.push_back(s);
                }
            }
        }
        flips
    }

    /// Replaces side ab of the triangles abc and bad by side cd. `false` for a side that has one
    /// triangle on both sides.
    fn flip(&mut self, side: Side) -> bool {
        let twin = self.twin[side as usize];
        if side / 3 == twin / 3 {
            return false;
        }
        let (ab, ba) = (side, twin);
        let (bc, ca) = (next(ab), next(next(ab)));
        let (ad, db) = (next(ba), next(next(ba)));
        let corner = |s: Side| self.corners[s as usize];
        let (a, b, c, d) = (corner(ab), corner(bc), corner(ca), corner(db));
        let length = |s: Side| self.lengths[s as usize];
        // Laid out in the plane: a at 0, b on the x axis, c above, d below.
        let x = |l: f64, own: f64, other: f64| (l * l + own * own - other * other) / (2.0 * l);
        let l = length(ab);
        let (cx, dx) = (x(l, length(ca), length(bc)), x(l, length(ad), length(db)));
        let cy = 2.0 * area_of(self.sides(ab / 3)) / l;
        let dy = 2.0 * area_of(self.sides(ba / 3)) / l;
        let crossed = (cx - dx).hypot(cy + dy);
        // Face of ab becomes (c, d, b), face of ba becomes (d, c, a).
        let outer = [
            (db, length(db)),
            (bc, length(bc)),
            (ca, length(ca)),
            (ad, length(ad)),
        ];
        let outside = outer.map(|(s, _)| self.twin[s as usize]);
        let f = 3 * (ab / 3);
        let g = 3 * (ba / 3);
        let new = [f + 1, f + 2, g + 1, g + 2];
        for (k, v) in [c, d, b].into_iter().enumerate() {
            self.corners[f as usize + k] = v;
        }
        for (k, v) in [d, c, a].into_iter().enumerate() {
            self.corners[g as usize + k] = v;
        }
        for (k, &s) in new.iter().enumerate() {
            self.lengths[s as usize] = outer[k].1;
        }
        self.lengths[f as usize] = crossed;
        self.lengths[g as usize] = crossed;
        self.twin[f as usize] = g;
        self.twin[g as usize] = f;
        for (k, &s) in new.iter().enumerate() {
            // The neighbour may be one of the four itself.
            let other = outer
                .iter()
                .position(|o| o.0 == outside[k])
                .map_or(outside[k], |at| new[at]);
            self.twin[s as usize] = other;
            self.twin[other as usize] = s;
        }
        true
    }
}

/// The corner opposite to side `k`.
const OPPOSITE: [usize; 3] = [2, 0, 1];

fn next(side: Side) -> Side {
    if side % 3 == 2 { side - 2 } else { side + 1 }
}

/// Kahan's stable form of Heron's formula. Side lengths are sorted so that no difference cancels: needles keep their
/// digits.
fn area_of(sides: [f64; 3]) -> f64 {
    let mut s = sides;
    s.sort_unstable_by(f64::total_cmp);
    let [c, b, a] = s;
    let product = (a + (b + c)) * (c - (a - b)) * (c + (a - b)) * (a + (b - c));
    0.25 * product.max(0.0).sqrt()
}

/// Half the cotangent at each corner, from the lengths of the sides `ab, bc, ca`.
fn half_cotangents([ab, bc, ca]: [f64; 3], area: f64) -> [f64; 3] {
    let at = |own: f64, other: f64, far: f64| {
        (own * own + other * other - far * far) / (8.0 * area.max(f64::MIN_POSITIVE))
    };
    [at(ab, ca, bc), at(ab, bc, ca), at(bc, ca, ab)]
}
