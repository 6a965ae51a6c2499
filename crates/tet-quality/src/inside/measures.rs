//! Measures and the star of a vertex against their definitions.

use geom_core::{Point3, Vector3};
use proptest::prelude::*;

use crate::measure::block::{angle_of, measure};
use crate::measure::metrics::quality;
use crate::mesh::editable::GAIN;
use crate::smoothing::star::{Best, CANDIDATES, Candidates, Star, objective};
use crate::{Measures, measures};

pub fn the_angle_is_the_arc_cosine() {
    for k in -100_000..=100_000 {
        let c = f64::from(k) / 1e5;
        let found = angle_of(c * c.abs());
        // Where the cosine is flat the argument itself has fewer digits.
        let allowed = 2e-12 + 1e-13 / (1.0 - c * c).max(1e-15).sqrt();
        assert!((found - c.acos().to_degrees()).abs() < allowed, "{c}");
    }
    assert_eq!([1.0, -1.0].map(angle_of), [0.0, 180.0]);
}

/// Any count, so that the last block is full, empty or neither.
pub fn neither_neighbours_nor_vectors_matter() {
    proptest!(|(
        coordinates in proptest::collection::vec(-1.0..1.0f64, 12..12 * 150),
    )| {
        let x: Vec<Point3> = coordinates
            .chunks_exact(3)
            .map(Point3::from_slice)
            .collect();
        let count = x.len() as u32 / 4;
        let tets: Vec<[u32; 4]> = (0..count).map(|t| [0, 1, 2, 3].map(|k| 4 * t + k)).collect();
        let mut together = vec![Measures::default(); tets.len()];
        measure(&x, &tets, &mut together);
        for (tet, m) in tets.iter().zip(together) {
            prop_assert_eq!(measures(tet.map(|v| x[v as usize])), m);
        }
    });
}

fn point() -> impl Strategy<Value = Point3> {
    [-1.0..1.0, -1.0..1.0, -1.0..1.0].prop_map(Point3::from)
}

pub fn the_star_judges_like_the_definition() {
    proptest!(|(p in [point(), point(), point(), point()])| {
        let mut star = Star::default();
        star.push([p[1], p[2], p[3]]);
        let value = objective(star.value(&p[0].coords));
        prop_assert!((value - quality(p)).abs() < 1e-9);
    });
}

/// Whatever the width of the vectors: the best is that of one judged after the other.
pub fn candidates_are_judged_together_like_alone() {
    proptest!(|(
        corners in proptest::collection::vec(point(), 4..12),
        candidates in proptest::collection::vec(point(), 1..CANDIDATES),
    )| {
        let mut star = Star::default();
        for w in corners.windows(3) {
            star.push([w[0], w[1], w[2]]);
        }
        let start = Vector3::zeros();
        let (first, mut best) = (star.value(&start), star.value(&start));
        let mut tries = Candidates::none(&start);
        let mut chosen = None;
        for (i, x) in candidates.iter().enumerate() {
            tries.push(&x.coords);
            if let Some(value) = star.value_above(&x.coords, best + GAIN) {
                best = value;
                chosen = Some(Best { number: i, value });
            }
        }
        prop_assert_eq!(star.best_of(&tries, first), chosen);
    });
}
