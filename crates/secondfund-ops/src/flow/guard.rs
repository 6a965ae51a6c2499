//! No face turns over: displacements are shortened until none does.

use geom_core::{Point3, Vector3};

/// Most times that a displacement is halved; then its vertex stays.
const HALVINGS: u32 = 8;

/// Shortens displacements around faces whose corners would turn over (their normals turn by more than a
/// right angle). Gives how many vertices it held back.
pub(crate) fn hold_back<const N: usize>(
    positions: &[Point3],
    faces: &[[u32; N]],
    moves: &mut [Vector3],
) -> usize {
    let mut held = vec![0u32; positions.len()];
    loop {
        let mut any = false;
        for face in faces {
            if !turns_over(positions, face, moves) {
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

/// Does any corner of the face turn over?
fn turns_over<const N: usize>(positions: &[Point3], face: &[u32; N], moves: &[Vector3]) -> bool {
    let old = face.map(|v| positions[v as usize]);
    let new = face.map(|v| positions[v as usize] + moves[v as usize]);
    let corner =
        |p: &[Point3; N], k: usize| (p[(k + 1) % N] - p[k]).cross(&(p[(k + N - 1) % N] - p[k]));
    (0..N).any(|k| {
        let before = corner(&old, k);
        before.dot(&corner(&new, k)) <= 0.0 && before != Vector3::zeros()
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
        assert_eq!(hold_back(&p, &[[0, 1, 2]], &mut moves), 1);
        assert!(moves[2].y > -1.0 && moves[2].y < 0.0);
    }
}
