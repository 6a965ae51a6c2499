//! One level of subdivision of a patch with a corner on the boundary of more than two quads.
//!
//! Control points by number, in the order `v; e₀…e_n; d₀…d_{n−1}; o₀…o₆`, with quad i of the corner = (v, e_i, d_i,
//! e_{i+1}); e₀ and e_n lie on the boundary. The patch is quad `place`, and its grid has `e_place` at (1, 0). Beyond a
//! boundary edge of the patch the grid goes on linearly, as the ghosts of regular boundaries do: the rules of subdivision
//! give the same there.

use super::net::{Level, OUTER, combine};

/// The matrices of a level.
pub(super) fn level(quads: usize, place: usize) -> Level {
    let fan = Fan { quads, place };
    let mut corner = fan.vertex_point();
    for j in 0..=quads {
        corner.extend(fan.spoke_point(j));
    }
    for j in 0..quads {
        corner.extend(fan.face_point(j));
    }
    Level::with(fan.ids(), corner, |place| fan.fine(place))
}

/// `quads` around the corner on the boundary, of which the patch is number `place`.
struct Fan {
    quads: usize,
    place: usize,
}

impl Fan {
    /// The number of control points: one more spoke than inside, since the fan does not close.
    fn ids(&self) -> usize {
        2 * self.quads + 9
    }

    /// The row of one control point itself.
    fn unit(&self, id: usize) -> Vec<f64> {
        let mut row = vec![0.0; self.ids()];
        row[id] = 1.0;
        row
    }

    /// The neighbour along spoke j, 0 to `quads`.
    fn e(&self, j: usize) -> Vec<f64> {
        self.unit(1 + j)
    }

    /// The vertex across quad j.
    fn d(&self, j: usize) -> Vec<f64> {
        self.unit(2 + self.quads + j)
    }

    /// The point as far beyond `a` as `b` is before it.
    fn beyond(a: Vec<f64>, b: Vec<f64>) -> Vec<f64> {
        combine(&[(2.0, a), (-1.0, b)])
    }

    /// The control point at a place of the patch's grid.
    fn at(&self, place: (i32, i32)) -> Vec<f64> {
        let i = self.place;
        let (first, last) = (i == 0, i + 1 == self.quads);
        match place {
            (0, 0) => self.unit(0),
            (1, 0) => self.e(i),
            (0, 1) => self.e(i + 1),
            (1, 1) => self.d(i),
            (0, -1) if first => Self::beyond(self.unit(0), self.e(1)),
            (1, -1) if first => Self::beyond(self.e(0), self.d(0)),
            (0, -1) => self.e(i - 1),
            (1, -1) => self.d(i - 1),
            (-1, 0) if last => Self::beyond(self.unit(0), self.e(i)),
            (-1, 1) if last => Self::beyond(self.e(i + 1), self.d(i)),
            (-1, 0) => self.e(i + 2),
            (-1, 1) => self.d(i + 1),
            _ => {
                let outer = OUTER.iter().position(|&o| o == place);
                let outer = outer.expect("a place of the net");
                self.unit(2 + 2 * self.quads + outer)
            }
        }
    }

    /// `(l + 6 V + r) / 8`.
    fn vertex_point(&self) -> Vec<f64> {
        combine(&[
            (0.125, self.e(0)),
            (0.75, self.unit(0)),
            (0.125, self.e(self.quads)),
        ])
    }

    /// The middle of quad j.
    fn face_point(&self, j: usize) -> Vec<f64> {
        let corners = [self.unit(0), self.e(j), self.d(j), self.e(j + 1)];
        combine(&corners.map(|c| (0.25, c)))
    }

    /// The middle of a boundary edge, the edge point of an inner one.
    fn spoke_point(&self, j: usize) -> Vec<f64> {
        if j == 0 || j == self.quads {
            return combine(&[(0.5, self.unit(0)), (0.5, self.e(j))]);
        }
        let parts = [
            self.unit(0),
            self.e(j),
            self.face_point(j - 1),
            self.face_point(j),
        ];
        combine(&parts.map(|p| (0.25, p)))
    }

    /// The control point of the next level at a place of the grid of half the spacing.
    fn fine(&self, (x, y): (i32, i32)) -> Vec<f64> {
        let i = self.place;
        match (x, y) {
            (0, 0) => return self.vertex_point(),
            (0, -1) if i == 0 => return Self::beyond(self.fine((0, 0)), self.fine((0, 1))),
            (0, -1) => return self.spoke_point(i - 1),
            (-1, 0) if i + 1 == self.quads => {
                return Self::beyond(self.fine((0, 0)), self.fine((1, 0)));
            }
            (-1, 0) => return self.spoke_point(i + 2),
            _ => {}
        }
        // Elsewhere the rules are those of uniform cubic B-splines along both axes.
        let mask = |k: i32| -> Vec<(i32, f64)> {
            let half = k.div_euclid(2);
            if k.rem_euclid(2) == 0 {
                vec![(half - 1, 0.125), (half, 0.75), (half + 1, 0.125)]
            } else {
                vec![(half, 0.5), (half + 1, 0.5)]
            }
        };
        let (along, across) = (mask(x), mask(y));
        let parts: Vec<(f64, Vec<f64>)> = across
            .iter()
            .flat_map(|&(b, w)| along.iter().map(move |&(a, u)| ((a, b), u * w)))
            .map(|(place, weight)| (weight, self.at(place)))
            .collect();
        combine(&parts)
    }
}
