//! Distortion: how far the images of a neighbourhood are from a rotation of it, and fits that lower it.
//!
//! A map sends node i, at rest at `P_i`, to `X_i`. Its energy is that of Eq. 6.8 with the norm squared, over pairs of
//! nodes within a radius, and with proper rotations only, so that a mirror image is not free:
//! `E = Σ_i Σ_j w_ij |(X_i − X_j) − R_i (P_i − P_j)|²`, `R_i ∈ SO(3)`.

mod annealed;
mod rigid;
mod rows;
mod thesis;

use geom_core::compute::parallel;
use geom_core::nalgebra::{Matrix3, Matrix4, SymmetricEigen, Vector4};
use geom_core::{Point3, Vector3};

use crate::Error;
use crate::backend::{Kernels, On, RotationTask, Rows, SweepTask};

pub use crate::near::Neighbourhoods;
#[cfg(feature = "testing")]
#[doc(hidden)]
pub use annealed::annealed_in_one_stage;
pub(crate) use annealed::{Fit, JUDGE, LAST, LONG, SHORT, Schedule, Side, anneal};
pub use rigid::{Motion, superpose};
pub(crate) use rows::Flat;
pub(crate) use thesis::descend;

/// `S = Σ_j (X_i − X_j)(P_i − P_j)ᵀ` of a node.
/// The transpose of that of Eq. 6.9.
fn covariance(task: &RotationTask<'_>, i: usize) -> Matrix3<f64> {
    let (p, x) = (task.rest[i], task.now[i]);
    let mut s = [[0.0; 3]; 3];
    for &j in task.near.of(i) {
        let (e, d) = (p - task.rest[j as usize], x - task.now[j as usize]);
        for (row, d) in s.iter_mut().zip([d.x, d.y, d.z]) {
            row[0] += d * e.x;
            row[1] += d * e.y;
            row[2] += d * e.z;
        }
    }
    Matrix3::from_fn(|r, c| s[r][c])
}

/// The rotation of a node's neighbourhood; the identity without neighbours.
pub(crate) fn rotation(task: &RotationTask<'_>, i: usize) -> Matrix3<f64> {
    nearest_rotation(&covariance(task, i))
}

/// The proper rotation with the largest `tr(Rᵀ S)`.
///
/// It is the quaternion of the largest eigenvalue of a symmetric 4 × 4 matrix (Horn, *Closed-form solution of absolute
/// orientation using unit quaternions*, 1987), found by Newton's method from above on the characteristic polynomial
/// (Theobald, *Rapid calculation of RMSDs using a quaternion-based characteristic polynomial*, 2005). Where the
/// eigenvalue is nearly multiple (points on a line) any of its rotations will do, and a full decomposition gives one.
pub(crate) fn nearest_rotation(s: &Matrix3<f64>) -> Matrix3<f64> {
    let size = s.norm();
    if !(size > 0.0 && size.is_finite()) {
        return Matrix3::identity();
    }
    let s = s / size;
    let [xx, xy, xz] = [s[(0, 0)], s[(1, 0)], s[(2, 0)]];
    let [yx, yy, yz] = [s[(0, 1)], s[(1, 1)], s[(2, 1)]];
    let [zx, zy, zz] = [s[(0, 2)], s[(1, 2)], s[(2, 2)]];
    #[rustfmt::skip]
    let n = Matrix4::new(
        xx + yy + zz, yz - zy,      zx - xz,      xy - yx,
        yz - zy,      xx - yy - zz, xy + yx,      zx + xz,
        zx - xz,      xy + yx,      yy - xx - zz, yz + zy,
        xy - yx,      zx + xz,      yz + zy,      zz - xx - yy,
    );
    let q = largest_eigenvector(&n, &s).unwrap_or_else(|| {
        let all = SymmetricEigen::new(n);
        let largest = all.eigenvalues.imax();
        all.eigenvectors.column(largest).into_owned()
    });
    of_quaternion(&q)
}

/// The eigenvector of the largest eigenvalue of `n`, the matrix of `s` with Frobenius norm 1; none where it is too close
/// to the next one.
fn largest_eigenvector(n: &Matrix4<f64>, s: &Matrix3<f64>) -> Option<Vector4<f64>> {
    // λ⁴ − 2 |S|² λ² − 8 det(S) λ + det(N), from an upper bound of the largest root: √3 |S|.
    let first = n.row(0);
    let of_n = adjugate(n);
    let (c1, c0) = (
        -8.0 * s.determinant(),
        (0..4).map(|k| first[k] * of_n[(k, 0)]).sum::<f64>(),
    );
    let mut root = 3f64.sqrt();
    for _ in 0..50 {
        let squared = root * root;
        let value = (squared - 2.0) * squared + c1 * root + c0;
        let slope = 4.0 * (squared - 1.0) * root + c1;
        if slope <= 0.0 {
            return None;
        }
        let step = value / slope;
        root -= step;
        if step.abs() < 1e-14 {
            break;
        }
    }
    // A column of the adjugate of N − λ is the eigenvector; the longest is the safest.
    let adjugate = adjugate(&(n - Matrix4::identity() * root));
    let columns = (0..4).map(|c| adjugate.column(c).into_owned());
    let longest = columns.max_by(|a, b| a.norm_squared().total_cmp(&b.norm_squared()))?;
    // Its length is the product of the gaps to the other eigenvalues.
    (longest.norm() > 1e-5).then(|| longest.normalize())
}

/// The adjugate of a symmetric matrix, from the minors of its first and of its last two rows.
/// `adj(M) M = det(M) 1`: columns of that of a singular matrix lie in its kernel.
fn adjugate(m: &Matrix4<f64>) -> Matrix4<f64> {
    let minor =
        |r: usize, a: usize, b: usize| m[(r, a)] * m[(r + 1, b)] - m[(r + 1, a)] * m[(r, b)];
    const PAIRS: [(usize, usize); 6] = [(0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3)];
    let s = PAIRS.map(|(a, b)| minor(0, a, b));
    let c = PAIRS.map(|(a, b)| minor(2, a, b));
    let m = |r: usize, c: usize| m[(r, c)];
    #[rustfmt::skip]
    let out = Matrix4::new(
         m(1, 1) * c[5] - m(1, 2) * c[4] + m(1, 3) * c[3],
        -m(0, 1) * c[5] + m(0, 2) * c[4] - m(0, 3) * c[3],
         m(3, 1) * s[5] - m(3, 2) * s[4] + m(3, 3) * s[3],
        -m(2, 1) * s[5] + m(2, 2) * s[4] - m(2, 3) * s[3],

        -m(1, 0) * c[5] + m(1, 2) * c[2] - m(1, 3) * c[1],
         m(0, 0) * c[5] - m(0, 2) * c[2] + m(0, 3) * c[1],
        -m(3, 0) * s[5] + m(3, 2) * s[2] - m(3, 3) * s[1],
         m(2, 0) * s[5] - m(2, 2) * s[2] + m(2, 3) * s[1],

         m(1, 0) * c[4] - m(1, 1) * c[2] + m(1, 3) * c[0],
        -m(0, 0) * c[4] + m(0, 1) * c[2] - m(0, 3) * c[0],
         m(3, 0) * s[4] - m(3, 1) * s[2] + m(3, 3) * s[0],
        -m(2, 0) * s[4] + m(2, 1) * s[2] - m(2, 3) * s[0],

        -m(1, 0) * c[3] + m(1, 1) * c[1] - m(1, 2) * c[0],
         m(0, 0) * c[3] - m(0, 1) * c[1] + m(0, 2) * c[0],
        -m(3, 0) * s[3] + m(3, 1) * s[1] - m(3, 2) * s[0],
         m(2, 0) * s[3] - m(2, 1) * s[1] + m(2, 2) * s[0],
    );
    out
}

/// The rotation of a unit quaternion, real part first.
fn of_quaternion(q: &Vector4<f64>) -> Matrix3<f64> {
    let [w, x, y, z] = [q[0], q[1], q[2], q[3]];
    Matrix3::new(
        w * w + x * x - y * y - z * z,
        2.0 * (x * y - w * z),
        2.0 * (x * z + w * y),
        2.0 * (x * y + w * z),
        w * w - x * x + y * y - z * z,
        2.0 * (y * z - w * x),
        2.0 * (x * z - w * y),
        2.0 * (y * z + w * x),
        w * w - x * x - y * y + z * z,
    )
}

/// Where a step of Jacobi's method puts a node: the mean of where its neighbours want it, `X_j + ½ (R_i + R_j)(P_i −
/// P_j)`, and of its target.
/// Without neighbours it goes to its target, if it has a pull, or stays.
pub(crate) fn swept(task: &SweepTask<'_>, i: usize) -> Point3 {
    let shape = &task.shape;
    let (p, r) = (shape.rest[i], &task.rotations[i]);
    let near = shape.near.of(i);
    let pull = task.pull[i];
    if near.is_empty() {
        return if pull > 0.0 {
            task.targets[i]
        } else {
            shape.now[i]
        };
    }
    // R_i is the same for all.
    let (mut sum, mut turned) = ([0.0; 3], [0.0; 3]);
    for &j in near {
        let j = j as usize;
        let (x, q) = (&shape.now[j], &shape.rest[j]);
        let e = [p.x - q.x, p.y - q.y, p.z - q.z];
        let there = times(&task.rotations[j], e);
        for c in 0..3 {
            sum[c] += x[c] + 0.5 * there[c];
            turned[c] += e[c];
        }
    }
    let (turned, count) = (times(r, turned), near.len() as f64);
    let at = |c: usize| (sum[c] + 0.5 * turned[c]) / count;
    let target = &task.targets[i];
    Point3::from([0, 1, 2].map(|c| (at(c) + target[c] * pull) / (1.0 + pull)))
}

/// `R e`, spelled out: the innermost product of the fit.
#[inline(always)]
fn times(r: &Matrix3<f64>, e: [f64; 3]) -> [f64; 3] {
    [
        r.m11 * e[0] + r.m12 * e[1] + r.m13 * e[2],
        r.m21 * e[0] + r.m22 * e[1] + r.m23 * e[2],
        r.m31 * e[0] + r.m32 * e[1] + r.m33 * e[2],
    ]
}

/// The mean square distortion of each node's neighbourhood, Å².
/// 0 for a node without neighbours.
pub(crate) fn distortions(task: &RotationTask<'_>, rotations: &[Matrix3<f64>]) -> Vec<f64> {
    parallel::map(task.rest.len(), |i| {
        let (p, x, r) = (&task.rest[i], &task.now[i], &rotations[i]);
        let near = task.near.of(i);
        let mut sum = 0.0;
        for &j in near {
            let (q, y) = (&task.rest[j as usize], &task.now[j as usize]);
            let there = times(r, [p.x - q.x, p.y - q.y, p.z - q.z]);
            for c in 0..3 {
                let left = x[c] - y[c] - there[c];
                sum += left * left;
            }
        }
        sum / near.len().max(1) as f64
    })
}

/// The root of the mean over the nodes of their mean square distortions, Å: the score of a map.
pub(crate) fn score(task: &RotationTask<'_>, run: On<'_>) -> Result<f64, Error> {
    let mut rotations = Vec::new();
    run.rotations(task, &mut rotations)?;
    let squares = distortions(task, &rotations);
    let sum = parallel::sum(squares.len(), |i| squares[i]);
    Ok((sum / squares.len().max(1) as f64).sqrt())
}

/// Positions and normals as rows of six numbers: two nodes are near if their places are, and their normals (Lévy and
/// Bonneel, *Variational anisotropic surface meshing with Voronoi parallel linear enumeration*, 2012). A normal has
/// `length`, Å.
pub(crate) fn lifted(
    points: &[Point3],
    normals: impl Iterator<Item = Vector3>,
    length: f64,
) -> Vec<f64> {
    let rows = points.iter().zip(normals);
    rows.flat_map(|(p, n)| {
        let n = n * length;
        [p.x, p.y, p.z, n.x, n.y, n.z]
    })
    .collect()
}

/// How long a normal is in a row of six, Å: while maps are fitted (long, since on a smooth body normals tell where on it
/// a node is better than places do), in J and in the rigid search, and for partners, which are to lie where the images
/// do and only not on the other side of a sheet.
pub(crate) const FITTED: f64 = 7.0;
pub(crate) const SCORED: f64 = 3.0;
pub(crate) const PARTNERS: f64 = 1.0;

/// Rows of six numbers.
pub(crate) fn six(values: &[f64]) -> Rows<'_> {
    Rows { values, width: 6 }
}
