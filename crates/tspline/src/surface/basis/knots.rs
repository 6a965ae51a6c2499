//! Local knots of T-spline functions, in whole sides of fine quads, and their pieces as Bézier coefficients.

use geom_core::HalfedgeId;

use crate::TMesh;

/// The five knots of a cubic function along one direction, from its middle.
pub(super) type Knots = [i64; 5];

/// How far away the next two knots lie on the ray that leaves a vertex along a fine half-edge: where it meets a vertex
/// of the T-mesh or a side of an element across it (Sederberg, Zheng, Bakenov and Nasri 2003). Where it meets an
/// extraordinary vertex it ends, and the last interval is repeated.
pub(super) fn ahead(mesh: &TMesh, start: HalfedgeId) -> [i64; 2] {
    let edges = mesh.fine_edges();
    let element = |h: HalfedgeId| mesh.element_of(edges.face(h).0 as usize);
    let borders = |h: HalfedgeId| edges.twin(h).is_none_or(|g| element(g) != element(h));
    let (mut h, mut t) = (start, 0);
    let mut found = Vec::with_capacity(2);
    // Twice the largest element and more than once around the mesh: no ray is longer between two knots.
    for _ in 0..=2 * edges.faces() {
        t += 1;
        let end = edges.to(h).0;
        let right = edges.twin(h).map(|g| edges.previous(g));
        let across = borders(edges.next(h)) || right.is_none_or(borders);
        if across || mesh.vertex_of_fine(end).is_some() {
            found.push(t);
        }
        if mesh.is_extraordinary(end) && found.len() < 2 {
            let last = t - found[..found.len() - 1].last().copied().unwrap_or(0);
            found.push(t + last);
        }
        if found.len() == 2 {
            break;
        }
        match edges.twin(edges.next(h)) {
            Some(g) => h = edges.next(g),
            None => break,
        }
    }
    let first = found.first().copied().unwrap_or(t);
    [first, found.get(1).copied().unwrap_or(2 * first)]
}

/// The Bézier coefficients on `[x0, x1]` of the cubic B-spline of these knots, which must have none inside: its blossom
/// at (x0, x0, x0), (x0, x0, x1), (x0, x1, x1) and (x1, x1, x1).
///
/// ```
/// use tspline::surface::bezier_coefficients;
/// let near = |found: [f64; 4], wanted: [f64; 4]| found.iter().zip(wanted).all(|(a, b)| (a - b).abs() < 1e-15);
/// let (sixth, third) = (1.0 / 6.0, 1.0 / 3.0);
/// let uniform = [-2, -1, 0, 1, 2];
/// assert!(near(bezier_coefficients(&uniform, [-2, -1]), [0.0, 0.0, 0.0, sixth]));
/// assert!(near(bezier_coefficients(&uniform, [-1, 0]), [sixth, third, 2.0 * third, 2.0 * third]));
/// // Half of a piece ends where de Casteljau's scheme says.
/// let half = bezier_coefficients(&uniform.map(|k| 2 * k), [-2, -1]);
/// assert!((half[3] - 23.0 / 48.0).abs() < 1e-15);
/// ```
pub fn bezier_coefficients(knots: &[i64; 5], [x0, x1]: [i64; 2]) -> [f64; 4] {
    let t = knots.map(|k| k as f64);
    let (a, b) = (x0 as f64, x1 as f64);
    let ratio = |top: f64, bottom: f64| if bottom > 0.0 { top / bottom } else { 0.0 };
    [[a, a, a], [a, a, b], [a, b, b], [b, b, b]].map(|at| {
        let mut n: [f64; 4] =
            std::array::from_fn(|i| f64::from(knots[i] <= x0 && x1 <= knots[i + 1]));
        for (p, &x) in (1..).zip(&at) {
            for i in 0..4 - p {
                n[i] = ratio(x - t[i], t[i + p] - t[i]) * n[i]
                    + ratio(t[i + p + 1] - x, t[i + p + 1] - t[i + 1]) * n[i + 1];
            }
        }
        n[0]
    })
}
