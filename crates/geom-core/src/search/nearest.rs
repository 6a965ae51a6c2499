//! Nearest neighbours among points in 3 and in k dimensions. The only file that knows kiddo.
//!
//! Equal distances go to the lowest index, also where the cut after `count` falls between them.
//!
//! [`bvh`](super::bvh) answers the same of triangles. Trees here are built once and asked often; points do not move.

use std::num::NonZero;

use crate::compute::parallel;
use kiddo::leaf_strategies::FlatVec;
use kiddo::{Eytzinger, KdTree, SquaredEuclidean};

use crate::Point3;
use crate::id::MAX_ELEMENTS;

/// Why a [`PointTree`] cannot be made or asked. Of several points at fault the first is named.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum NearestError {
    /// A coordinate is NaN or infinite.
    #[error("point {point} has a coordinate that is not a finite number")]
    NotFinite {
        /// Which of the points or queries.
        point: usize,
    },
    /// More points than an index can name.
    #[error("{count} points, more than the {MAX_ELEMENTS} that an index can name")]
    TooMany {
        /// Number of points.
        count: usize,
    },
}

/// A point near a query.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Neighbor {
    /// Which point.
    pub index: u32,
    /// Its distance from the query, in the unit of the coordinates.
    pub distance: f64,
}

type Tree<const K: usize> = KdTree<f64, u32, Eytzinger, FlatVec<f64, u32, K, 32>, K, 32>;

/// Points in `K` dimensions, sorted for neighbour searches. Good for `K` up to about 10.
///
/// ```
/// use geom_core::search::nearest::PointTree;
/// let tree = PointTree::new(vec![[0.0, 0.0], [1.0, 0.0], [5.0, 5.0]])?;
/// let near = tree.nearest(&[0.9, 0.1], 2);
/// assert_eq!(near.iter().map(|n| n.index).collect::<Vec<_>>(), [1, 0]);
/// # Ok::<(), geom_core::search::nearest::NearestError>(())
/// ```
///
/// In more dimensions than that a search looks at most points, and comparing with all of them is as fast. The tree
/// keeps the points as they were given, beside its own copy: `16 K + 4` bytes or so per point.
pub struct PointTree<const K: usize> {
    points: Vec<[f64; K]>,
    tree: Option<Tree<K>>,
}

impl PointTree<3> {
    /// The tree of these positions.
    ///
    /// # Errors
    /// Those of [`PointTree::new`].
    pub fn of_positions(positions: &[Point3]) -> Result<Self, NearestError> {
        Self::new(positions.iter().map(|p| [p.x, p.y, p.z]).collect())
    }
}

impl<const K: usize> PointTree<K> {
    /// The tree of these points, which may coincide.
    ///
    /// # Errors
    /// [`NearestError::TooMany`] and [`NearestError::NotFinite`].
    pub fn new(points: Vec<[f64; K]>) -> Result<Self, NearestError> {
        if points.len() > MAX_ELEMENTS {
            return Err(NearestError::TooMany {
                count: points.len(),
            });
        }
        check(&points)?;
        // An empty tree is ours: kiddo need not know of it.
        let tree = (!points.is_empty())
            .then(|| Tree::new_from_slice(&points).expect("indices fit u32, and leaves may grow"));
        Ok(Self { points, tree })
    }

    /// The number of points.
    pub fn len(&self) -> usize {
        self.points.len()
    }

    /// Is there no point?
    pub fn is_empty(&self) -> bool {
        self.points.is_empty()
    }

    /// The points, in the order given.
    pub fn points(&self) -> &[[f64; K]] {
        &self.points
    }

    /// The `count` nearest points to `query`, nearest first; all when there are fewer. None when the
    /// query is not finite. A point of the tree is its own nearest neighbour, at distance 0, unless an equal one has a
    /// lower index.
    pub fn nearest(&self, query: &[f64; K], count: usize) -> Vec<Neighbor> {
        let (Some(tree), Some(wanted)) = (&self.tree, NonZero::new(count.min(self.len()))) else {
            return Vec::new();
        };
        if query.iter().any(|c| !c.is_finite()) {
            return Vec::new();
        }
        let wanted = wanted.get();
        let one_more = NonZero::new((wanted + 1).min(self.len())).expect("at least one point");
        let found = tree
            .query(query)
            .nearest_n::<SquaredEuclidean<f64>>(one_more)
            .execute();
        let mut found = self.sorted(query, found.iter().map(|r| r.item));
        // kiddo sums squares in its own order, so that it may prefer another of two equals.
        if found.len() > wanted {
            let (last, next) = (found[wanted - 1].0, found[wanted].0);
            if next <= last * (1.0 + 1e-12) {
                let all = tree
                    .query(query)
                    .within::<SquaredEuclidean<f64>>(next * (1.0 + 1e-12));
                found = self.sorted(query, all.unsorted().execute().iter().map(|r| r.item));
            }
        }
        found.truncate(wanted);
        neighbors(found)
    }

    /// All points at most `radius` from `query`, nearest first. Closed: a point at exactly `radius` belongs to them, by
    /// its squared distance. None for a negative radius or NaN.
    pub fn within(&self, query: &[f64; K], radius: f64) -> Vec<Neighbor> {
        let Some(tree) = &self.tree else {
            return Vec::new();
        };
        if query.iter().any(|c| !c.is_finite()) || radius.is_nan() || radius < 0.0 {
            return Vec::new();
        }
        let squared = radius * radius;
        let wide = (squared * (1.0 + 1e-12)).min(f64::MAX);
        let found = tree
            .query(query)
            .within::<SquaredEuclidean<f64>>(wide)
            .unsorted()
            .execute();
        let mut found = self.sorted(query, found.iter().map(|r| r.item));
        found.retain(|&(d, _)| d <= squared);
        neighbors(found)
    }

    /// The nearest points to each of the queries, in their order; parallel.
    ///
    /// # Errors
    /// [`NearestError::NotFinite`] names the first such query.
    pub fn nearest_to_all(
        &self,
        queries: &[[f64; K]],
        count: usize,
    ) -> Result<Vec<Vec<Neighbor>>, NearestError> {
        check(queries)?;
        Ok(parallel::map_each(queries, |q| self.nearest(q, count)))
    }

    /// Squared distances with indices, by distance and then by index.
    fn sorted(&self, query: &[f64; K], items: impl Iterator<Item = u32>) -> Vec<(f64, u32)> {
        let mut out: Vec<(f64, u32)> = items
            .map(|i| (distance_squared(query, &self.points[i as usize]), i))
            .collect();
        out.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        out
    }
}

fn check<const K: usize>(points: &[[f64; K]]) -> Result<(), NearestError> {
    match points.iter().position(|p| p.iter().any(|c| !c.is_finite())) {
        Some(point) => Err(NearestError::NotFinite { point }),
        None => Ok(()),
    }
}

fn distance_squared<const K: usize>(a: &[f64; K], b: &[f64; K]) -> f64 {
    a.iter().zip(b).map(|(x, y)| (x - y) * (x - y)).sum()
}

fn neighbors(found: Vec<(f64, u32)>) -> Vec<Neighbor> {
    found
        .into_iter()
        .map(|(d, index)| Neighbor {
            index,
            distance: d.sqrt(),
        })
        .collect()
}
