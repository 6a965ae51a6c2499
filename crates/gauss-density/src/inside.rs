//! What the kernels and the sampling are made of, for tests.

use std::collections::BTreeMap;

use geom_core::grid::{BRICK_POINTS, Brick};
use geom_core::{Aabb, BrickGrid, Point3, Vector3};

use crate::atoms::samples::{self, Wanted};
use crate::backend::Prepared;
use crate::error::Error;
use crate::kernel::cull::{ActiveSet, Scratch};
use crate::kernel::{cull, direct, math, plain, point};
use crate::model::reach::Reach;
use crate::model::{Level, Model};
use crate::options::Cutoff;
use crate::sample::point::PointSampler;
use crate::sample::{band, low_pass};

#[cfg(feature = "wgpu")]
pub use crate::wgpu::inside::*;

/// The levels of a tree that matter.
pub fn compiled_levels(model: &Model) -> Vec<Level> {
    model.compiled_levels()
}

/// The first child of each node of a level, and the end of the last.
pub fn first_child(level: &Level) -> &[u32] {
    &level.first_child
}

/// A sampler that knows its way where the density is above a floor.
pub fn sampler_above<'a>(
    floor: f64,
    model: &'a Model,
    cutoff: Cutoff,
) -> Result<PointSampler<'a>, Error> {
    PointSampler::above(floor, model, cutoff)
}

/// A number to three digits, rounded up.
pub fn rounded_up(value: f64) -> f64 {
    crate::error::rounded_up(value)
}

/// `2^x`.
pub fn exp2(x: f32) -> f32 {
    math::exp2(x)
}

/// `log₂ x`.
pub fn log2(x: f32) -> f32 {
    math::log2(x)
}

/// `eˣ` of each.
pub fn exp_all(values: &mut [f64]) {
    math::exp_all(values);
}

/// `ln x` of each.
pub fn ln_all(values: &mut [f64]) {
    math::ln_all(values);
}

/// The density of these atoms as the recursion reads.
pub fn plain_value(tree: &Prepared<'_>, atoms: impl Iterator<Item = u32>, x: &Point3) -> f64 {
    plain::value(tree, atoms, x)
}

/// With its gradient, per Å.
pub fn plain_value_gradient(
    tree: &Prepared<'_>,
    atoms: impl Iterator<Item = u32>,
    x: &Point3,
) -> (f64, Vector3) {
    plain::value_gradient(tree, atoms, x)
}

/// The same, fast.
pub fn value(tree: &Prepared<'_>, atoms: &[u32], x: &Point3) -> f64 {
    point::value(tree, atoms, x)
}

/// With its gradient, per Å.
pub fn value_gradient(tree: &Prepared<'_>, atoms: &[u32], x: &Point3) -> (f64, Vector3) {
    point::value_gradient(tree, atoms, x)
}

/// An upper bound of `ln G` in a box, and the atoms that a cull leaves there.
pub fn culled(tree: &Prepared<'_>, cell: &Aabb, eps: f64, floor: f64) -> (f64, Vec<u32>) {
    let all: Vec<u32> = (0..tree.model.atoms() as u32).collect();
    let (mut kept, mut scratch) = (ActiveSet::default(), Scratch::default());
    let all = ActiveSet::gather(tree, &all);
    let up = all.cull_into(&cell.into(), eps, floor, &mut scratch, &mut kept);
    (up, kept.atom)
}

/// The single radius on the same footing, Å.
pub fn reach(tree: &Prepared<'_>, eps: f64, floor: f64) -> f64 {
    Reach::new(tree.model, &tree.levels).radius(eps, floor)
}

/// The most that the kernel of one atom exceeds that of another, with weight `w`, in a box, as logarithms.
pub fn bracket(tree: &Prepared<'_>, cell: &Aabb, atoms: [u32; 2], w: f64) -> f64 {
    cull::bracket(tree, cell, atoms, w)
}

/// The middles of eight bricks.
pub fn middles(spacing: f32) -> [[f32; 8]; 3] {
    direct::middles(spacing)
}

/// The most that one atom outweighs another by in each of eight bricks, from the place and decay of each and its exponent at
/// the middles.
pub fn most_beside(atoms: [([f32; 3], f32, [f32; 8]); 2], spacing: f32) -> [f32; 8] {
    direct::most_beside(atoms, spacing)
}

/// The interior bricks with a value below 1 beside them, as masks by block.
pub fn crossed(
    bricks: [usize; 3],
    kinds: Vec<Brick>,
    values: [f32; BRICK_POINTS],
) -> BTreeMap<[usize; 3], u64> {
    band::crossed(bricks, kinds, values)
}

/// The smallest length that a Fourier transform likes and that is at least `n`.
pub fn good_size(n: u128) -> u128 {
    low_pass::good_size(n)
}

/// Where the density is 1 on a lattice edge.
pub fn root_on_edge(
    sampler: &PointSampler<'_>,
    grid: &BrickGrid,
    p: [usize; 3],
    q: [usize; 3],
) -> Point3 {
    crate::sample::point::root_on_edge(sampler, grid, p, q)
}

/// The samples in a band of densities, by cell, with the roots between them.
pub fn samples(
    sampler: &PointSampler<'_>,
    grid: &BrickGrid,
    band: [f64; 2],
    eps: f64,
) -> Result<Vec<Vec<Point3>>, Error> {
    let wanted = Wanted {
        band,
        ends: false,
        interior: None,
        eps,
        max_memory: 1 << 30,
    };
    let cells = samples::collect(sampler, grid, &wanted)?;
    Ok(cells.into_iter().map(|cell| cell.points).collect())
}
