//! No face turns over, and none is squeezed flat: displacements are shortened until none is.

use geom_core::{Point3, Vector3};

/// Most times that a displacement is halved; then its vertex stays.
const HALVINGS: u32 = 8;

/// Shortens displacements around faces whose corners would turn over (their normals turn by more than a
/// right angle), or would be worse than they are and narrower or flatter than an angle of this sine. Gives how many
/// vertices it held back.
pub(crate) fn hold_back<const N: usize>(
    positions: &[Point3],
    faces: &[[u32; N]],
    moves: &mut [Vector3],
    least_sine: f64,
) -> usize {
    let mut held = vec![0u32; positions.len()];
    loop {
        let mut any = false;
        for face in faces {
            if !spoils(positions, face, moves, least_sine) {
                continue;
            }
            for &v in face {
                let v = v as usize;
                if moves[v] == Vector3::zeros() {
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
        }
        if !any {
            return held.iter().filter(|&&h| h > 0).count();
        }
    }
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_face_that_would_turn_over_is_held_back() {
        let p = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]].map(Point3::from);
        let mut moves = [
            Vector3::zeros(),
            Vector3::zeros(),
            Vector3::new(0.0, -1.5, 0.0),
        ];
        assert_eq!(hold_back(&p, &[[0, 1, 2]], &mut moves, 0.0), 1);
        assert!(moves[2].y > -1.0 && moves[2].y < 0.0);
    }

    /// What has a bad corner may get better, and nothing may get one.
    #[test]
    fn a_face_that_would_be_squeezed_is_held_back() {
        let p = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.5, 1.0, 0.0]].map(Point3::from);
        let moved = |y: f64| {
            let mut moves = [Vector3::zeros(); 3];
            moves[2].y = y;
            let held = hold_back(&p, &[[0, 1, 2]], &mut moves, 0.5);
            (held, 1.0 + moves[2].y)
        };
        let (held, height) = moved(-0.9);
        assert!(held == 1 && height / height.hypot(0.5) >= 0.5 && height < 1.0);
        assert_eq!(moved(-0.5), (0, 0.5), "45 degrees are enough");
        let flat = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.5, 0.1, 0.0]].map(Point3::from);
        let mut moves = [Vector3::zeros(); 3];
        moves[2].y = 0.05;
        assert_eq!(hold_back(&flat, &[[0, 1, 2]], &mut moves, 0.5), 0);
    }
}
