//! No face turns over or folds, none is squeezed flat, and none comes through another: displacements are shortened until
//! none is.

use geom_core::search::crossing::CrossingWatch;
use geom_core::{Point3, Vector3};
use rayon::prelude::*;

use crate::Error;
use crate::forms::area_normal;

/// Most times that a displacement is halved; then its vertex stays.
const HALVINGS: u32 = 8;

/// What displacements may not do to a surface.
pub(crate) struct Guard<'a, const N: usize> {
    faces: &'a [[u32; N]],
    shape: Shape,
    apart: Option<Apart>,
}

/// What faces must not become.
#[derive(Clone, Copy)]
pub(crate) struct Shape {
    /// With corners narrower or flatter than an angle of this sine.
    least_sine: f64,
    /// May be folded against those around them.
    may_fold: bool,
}

impl Shape {
    /// Filters, whose steps are few: no corner narrower than so many degrees.
    pub(crate) fn wide(least_angle: f64) -> Self {
        Self {
            least_sine: least_angle.to_radians().sin(),
            may_fold: true,
        }
    }

    /// Flows: nor folded. Many small turns may do that, of which none is a right angle.
    pub(crate) fn unfolded(least_angle: f64) -> Self {
        Self {
            may_fold: false,
            ..Self::wide(least_angle)
        }
    }
}

/// Triangles that must not come through others.
struct Apart {
    watch: CrossingWatch,
    /// The pairs that crossed from the start.
    crossing: Vec<[u32; 2]>,
}

impl<'a, const N: usize> Guard<'a, N> {
    /// Faces keep this shape, and none turns over in a step; with `keep_apart`, none comes through others.
    pub(crate) fn of(
        positions: &[Point3],
        faces: &'a [[u32; N]],
        shape: Shape,
        keep_apart: bool,
    ) -> Result<Self, Error> {
        let apart = keep_apart.then(|| Apart::of(positions, faces));
        Ok(Self {
            faces,
            shape,
            apart: apart.transpose()?,
        })
    }

    /// Shortens displacements until they are allowed, and says how often one was.
    pub(crate) fn hold_back(
        &mut self,
        positions: &[Point3],
        moves: &mut [Vector3],
    ) -> Result<usize, Error> {
        self.hold(positions, moves, self.shape)
    }

    /// The same of an offset of the whole surface, which may narrow corners: it does so by little, and what stays behind would be a
    /// dent.
    pub(crate) fn hold_back_offset(
        &mut self,
        positions: &[Point3],
        moves: &mut [Vector3],
    ) -> Result<usize, Error> {
        let shape = Shape {
            least_sine: 0.0,
            ..self.shape
        };
        self.hold(positions, moves, shape)
    }

    fn hold(
        &mut self,
        positions: &[Point3],
        moves: &mut [Vector3],
        shape: Shape,
    ) -> Result<usize, Error> {
        let mut held = 0;
        loop {
            held += hold_back(positions, self.faces, moves, shape);
            let Some(apart) = &mut self.apart else {
                return Ok(held);
            };
            // What stops one pair may fold a face beside it, and so on: both until neither finds anything.
            match apart.stop(positions, moves)? {
                0 => return Ok(held),
                stopped => held += stopped,
            }
        }
    }
}

impl Apart {
    fn of<const N: usize>(positions: &[Point3], faces: &[[u32; N]]) -> Result<Self, Error> {
        let fan = |f: &[u32; N]| {
            let f = *f;
            (2..N).map(move |k| [f[0], f[k - 1], f[k]])
        };
        let triangles: Vec<[u32; 3]> = faces.iter().flat_map(fan).collect();
        let sides = faces
            .iter()
            .map(|f| positions[f[1] as usize] - positions[f[0] as usize]);
        let edge = sides.map(|d| d.norm()).sum::<f64>() / faces.len().max(1) as f64;
        // Steps are much shorter than an edge.
        let mut watch = CrossingWatch::new(triangles, 0.5 * edge);
        Ok(Self {
            crossing: watch.crossing_pairs(positions)?,
            watch,
        })
    }

    /// Stops the corners of triangles that would cross and did not from the start; how many moved. Where none moves,
    /// nothing new crosses: so this comes to an end.
    fn stop(&mut self, positions: &[Point3], moves: &mut [Vector3]) -> Result<usize, Error> {
        let moved: Vec<Point3> = positions.iter().zip(&*moves).map(|(p, m)| p + m).collect();
        let mut stopped = 0;
        for pair in self.watch.crossing_pairs(&moved)? {
            if self.crossing.binary_search(&pair).is_ok() {
                continue;
            }
            for v in pair
                .iter()
                .flat_map(|&t| self.watch.triangles()[t as usize])
            {
                let step = std::mem::take(&mut moves[v as usize]);
                stopped += usize::from(step != Vector3::zeros());
            }
        }
        Ok(stopped)
    }
}

/// Shortens displacements around faces whose corners would turn over (their normals turn by more than a
/// right angle) or that would lose their shape. Gives how many vertices it held back. In rounds, each of which looks at
/// all faces before any vertex is held back, so that the order of faces does not count.
fn hold_back<const N: usize>(
    positions: &[Point3],
    faces: &[[u32; N]],
    moves: &mut [Vector3],
    shape: Shape,
) -> usize {
    let folds = (!shape.may_fold).then(|| folded(positions, faces));
    let mut held = vec![0u32; positions.len()];
    let mut last = vec![0u32; positions.len()];
    for round in 1.. {
        let beside = match &folds {
            Some(before) => beside_new_folds(positions, faces, moves, before),
            None => Vec::new(),
        };
        let spoilt = faces.par_iter().with_min_len(1024).filter(|face| {
            face.iter().any(|&v| beside.get(v as usize) == Some(&true))
                || spoils(positions, face, moves, shape.least_sine)
        });
        let spoilt: Vec<&[u32; N]> = spoilt.collect();
        let mut any = false;
        for &v in spoilt.into_iter().flatten() {
            let v = v as usize;
            // Once a round, however many faces ask for it.
            if moves[v] == Vector3::zeros() || std::mem::replace(&mut last[v], round) == round {
                continue;
            }
            any = true;
            held[v] += 1;
            moves[v] = if held[v] > HALVINGS {
                Vector3::zeros()
            } else {
                moves[v] * 0.5
            };
        }
        if !any {
            break;
        }
    }
    held.iter().filter(|&&h| h > 0).count()
}

/// The corners of faces that would fold and were not folded `before`, as flags; nothing where none would. Whether a face
/// is folded depends on all the faces at its corners.
fn beside_new_folds<const N: usize>(
    positions: &[Point3],
    faces: &[[u32; N]],
    moves: &[Vector3],
    before: &[bool],
) -> Vec<bool> {
    let moved: Vec<Point3> = positions.iter().zip(moves).map(|(p, m)| p + m).collect();
    let folds = folded(&moved, faces).into_iter().zip(before);
    let new = faces
        .iter()
        .zip(folds)
        .filter(|(_, (now, was))| *now && !**was);
    let mut beside = Vec::new();
    for (face, _) in new {
        beside.resize(positions.len(), false);
        face.iter().for_each(|&v| beside[v as usize] = true);
    }
    beside
}

/// Which faces look against the mean of the unit normals at their corners.
fn folded<const N: usize>(positions: &[Point3], faces: &[[u32; N]]) -> Vec<bool> {
    let own = faces.par_iter().with_min_len(1024);
    let own: Vec<Vector3> = own.map(|f| area_normal(positions, f)).collect();
    let mut normals = vec![Vector3::zeros(); positions.len()];
    for (face, n) in faces.iter().zip(&own) {
        face.iter().for_each(|&v| normals[v as usize] += n);
    }
    let unit = |n: &mut Vector3| *n = n.try_normalize(0.0).unwrap_or_else(Vector3::zeros);
    normals.par_iter_mut().with_min_len(1024).for_each(unit);
    let against = |(face, n): (&[u32; N], Vector3)| {
        let around: Vector3 = face.iter().map(|&v| normals[v as usize]).sum();
        n.dot(&around) < 0.0
    };
    faces
        .par_iter()
        .with_min_len(1024)
        .zip(own)
        .map(against)
        .collect()
}

/// Does any corner of the face turn over, or become bad?
fn spoils<const N: usize>(
    positions: &[Point3],
    face: &[u32; N],
    moves: &[Vector3],
    least_sine: f64,
) -> bool {
    let old = face.map(|v| positions[v as usize]);
    let new = face.map(|v| positions[v as usize] + moves[v as usize]);
    let sides = |p: &[Point3; N], k: usize| (p[(k + 1) % N] - p[k], p[(k + N - 1) % N] - p[k]);
    (0..N).any(|k| {
        let ((a, b), (c, d)) = (sides(&old, k), sides(&new, k));
        let (before, after) = (a.cross(&b), c.cross(&d));
        if before.dot(&after) <= 0.0 && before != Vector3::zeros() {
            return true;
        }
        let sine = after.norm() / (c.norm() * d.norm());
        sine < least_sine && sine < before.norm() / (a.norm() * b.norm())
    })
}

/// What holds here, for the tests.
#[cfg(feature = "testing")]
#[expect(missing_docs, reason = "the names of the laws say it")]
pub(crate) mod laws {
    use super::*;

    pub fn a_face_that_would_turn_over_is_held_back() {
        let p = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]].map(Point3::from);
        let mut moves = [
            Vector3::zeros(),
            Vector3::zeros(),
            Vector3::new(0.0, -1.5, 0.0),
        ];
        assert_eq!(hold_back(&p, &[[0, 1, 2]], &mut moves, Shape::wide(0.0)), 1);
        assert!(moves[2].y > -1.0 && moves[2].y < 0.0);
    }

    /// What has a bad corner may get better, and nothing may get one.
    pub fn a_face_that_would_be_squeezed_is_held_back() {
        let p = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.5, 1.0, 0.0]].map(Point3::from);
        let moved = |y: f64| {
            let mut moves = [Vector3::zeros(); 3];
            moves[2].y = y;
            let held = hold_back(&p, &[[0, 1, 2]], &mut moves, Shape::wide(30.0));
            (held, 1.0 + moves[2].y)
        };
        let (held, height) = moved(-0.9);
        assert!(held == 1 && height / height.hypot(0.5) >= 0.5 && height < 1.0);
        assert_eq!(moved(-0.5), (0, 0.5), "45 degrees are enough");
        let flat = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.5, 0.1, 0.0]].map(Point3::from);
        let mut moves = [Vector3::zeros(); 3];
        moves[2].y = 0.05;
        assert_eq!(
            hold_back(&flat, &[[0, 1, 2]], &mut moves, Shape::wide(30.0)),
            0
        );
    }

    /// Two sheets that pass through each other stop where they would meet; what crossed from the start may go on.
    pub fn faces_that_would_come_through_others_are_held_back() {
        let sheet = |z: f64| [[0.0, 0.0, z], [1.0, 0.0, z], [0.0, 1.0, z]].map(Point3::from);
        let tip = [[0.2, 0.2, 0.1], [0.3, 0.2, 1.0], [0.2, 0.3, 1.0]].map(Point3::from);
        let faces = [[0, 1, 2], [3, 4, 5]];
        let mut moves = [Vector3::zeros(); 6];
        moves[3..].fill(Vector3::new(0.0, 0.0, -0.15));
        let positions = [sheet(0.0), tip].concat();
        let held = |positions: &[Point3], keep_apart: bool| {
            let mut guard = Guard::of(positions, &faces, Shape::unfolded(0.0), keep_apart).unwrap();
            let mut moves = moves;
            let held = guard.hold_back(positions, &mut moves).unwrap();
            (held, moves[3].z)
        };
        assert_eq!(held(&positions, true), (3, 0.0));
        assert_eq!(held(&positions, false), (0, -0.15));
        let crossing = [sheet(0.15), tip].concat();
        assert_eq!(held(&crossing, true), (0, -0.15));
        assert_eq!(held(&[sheet(-0.1), tip].concat(), true), (0, -0.15));
    }
}
