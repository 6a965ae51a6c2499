//! Where the octree is split: cells that carry a surface, by the feature-sensitive error (Zhang &
//! Bajaj 2005).
//!
//! How far is a level set from the one that a coarse cell would draw? The coarse cell knows its eight corners, and between
//! them the trilinear interpolant f. At the 19 other points of the half lattice (edges, faces, middle) the finer values F
//! are known as well. A difference in *value* means little where the function is steep and much where it is flat, so that it
//! is divided by the gradient, which makes it a length in Å:
//!
//! ```text
//! E = Σ |F − f| / |∇f|        over the 19 points
//! ```
//!
//! The cell is split while E is above the tolerance and it is larger than the finest. Where two sheets of the surface pass
//! through one cell the corners cannot tell them apart, whatever E says; such cells are found by their labels.

use geom_core::compute::parallel;
use geom_core::mesh::{INTERIOR, Region};
use geom_core::{Point3, Vector3};

use super::domain::local;
use super::samples::{SIDE, Samples};
use super::tree::{BLOCK, Splits};
use crate::{ErrorNorm, Options, Shape, Zone};

/// The feature-sensitive error of a cell from its values on the 3 × 3 × 3 half lattice: over the 19
/// points that are no corners, the difference to the trilinear interpolant of the corners over the
/// length of its gradient. `edge` is the cell's edge length; the result has its unit.
pub(crate) fn feature_error(values: &[f64; 27], edge: f64, norm: ErrorNorm) -> f64 {
    let corner = |i: usize| values[2 * (i & 1) + 6 * (i >> 1 & 1) + 18 * (i >> 2)];
    let (mut sum, mut most) = (0.0, 0.0f64);
    for (i, &value) in values.iter().enumerate() {
        let p = [i % 3, i / 3 % 3, i / 9];
        if p.iter().all(|&c| c != 1) {
            continue;
        }
        let t = p.map(|c| 0.5 * c as f64);
        let (mut f, mut g) = (0.0, Vector3::zeros());
        for c in 0..8 {
            let bit = [c & 1, c >> 1 & 1, c >> 2];
            let w = [0, 1, 2].map(|k| if bit[k] == 1 { t[k] } else { 1.0 - t[k] });
            let s = bit.map(|b| if b == 1 { 1.0 } else { -1.0 });
            let v = corner(c);
            f += v * w[0] * w[1] * w[2];
            g += v * Vector3::new(s[0] * w[1] * w[2], w[0] * s[1] * w[2], w[0] * w[1] * s[2]);
        }
        let term = (value - f).abs() * edge / g.norm().max(1e-12);
        sum += term;
        most = most.max(term);
    }
    match norm {
        ErrorNorm::Sum => sum,
        ErrorNorm::Max => most,
    }
}

/// What decides whether a cell is too large.
struct Judge<'a> {
    samples: &'a Samples<'a>,
    options: &'a Options,
    /// By the first coordinate of their centres, so that few of many are looked at.
    zones: Vec<Zone>,
    /// Their largest radius.
    widest: f64,
}

impl<'a> Judge<'a> {
    fn new(samples: &'a Samples<'a>, options: &'a Options) -> Self {
        let mut zones = options.zones.clone();
        zones.sort_by(|a, b| a.center.x.total_cmp(&b.center.x));
        Self {
            samples,
            options,
            widest: zones.iter().map(|z| z.radius).fold(0.0, f64::max),
            zones,
        }
    }

    /// The smallest tolerance of the whole and of the zones that come within `reach` of a point.
    /// A search in a sorted list, then a look at those whose x is near: thousands of zones, one per atom, cost little.
    fn tolerance(&self, centre: &Point3, reach: f64) -> f64 {
        let far = self.widest + reach;
        let first = self.zones.partition_point(|z| z.center.x < centre.x - far);
        self.zones[first..]
            .iter()
            .take_while(|z| z.center.x <= centre.x + far)
            .filter(|z| (z.center - centre).norm() <= z.radius + reach)
            .map(|z| z.tolerance)
            .fold(self.options.tolerance, f64::min)
    }

    /// Must the cell of this block be split? `low` is relative to the block.
    /// Not if all of its lattice points have one label, the inner ones included: what hides between the corners is
    /// seen.
    fn splits(
        &self,
        block: [i32; 3],
        values: &[f32],
        region: &impl Fn(usize) -> Region,
        low: [usize; 3],
        size: usize,
    ) -> bool {
        let at = |p: [usize; 3]| (p[2] * SIDE + p[1]) * SIDE + p[0];
        let first = region(at(low));
        let (mut mixed, mut inside, mut outside) = (false, false, false);
        for z in low[2]..=low[2] + size {
            for y in low[1]..=low[1] + size {
                for r in (at([low[0], y, z])..=at([low[0] + size, y, z])).map(region) {
                    mixed |= r != first;
                    inside |= r == INTERIOR;
                    outside |= r != INTERIOR;
                }
            }
        }
        if !mixed {
            return false;
        }
        let domain = &self.samples.domain;
        let spacing = domain.spacing;
        let origin = [0, 1, 2].map(|k| block[k] * BLOCK + low[k] as i32);
        let edge = size as f64 * spacing;
        if inside && outside {
            let centre = domain.world(&local(origin).map(|c| c + 0.5 * size as f64));
            let reach = 0.5 * 3f64.sqrt() * edge;
            let tolerance = self.tolerance(&centre, reach);
            if tolerance == 0.0 {
                return true;
            }
            let half = size / 2;
            let values: [f64; 27] = std::array::from_fn(|i| {
                let p = [i % 3, i / 3 % 3, i / 9];
                f64::from(values[at([0, 1, 2].map(|k| low[k] + half * p[k]))])
            });
            return feature_error(&values, edge, self.options.error_norm) > tolerance;
        }
        // Boundaries of materials: flat ones need no small cells.
        let limit = self.options.tolerance.max(0.1 * spacing);
        let labels = &self.samples.labels;
        labels
            .outer
            .iter()
            .chain(labels.materials.iter().map(|m| &m.shape))
            .any(|shape| shape_error(shape, &domain.point(origin), edge) > limit)
    }
}

/// How far the depth below a shape's boundary, interpolated from the corners of a cell, is off at its
/// other half-lattice points; 0 if the boundary is far.
fn shape_error(shape: &Shape, low: &Point3, edge: f64) -> f64 {
    if let Shape::Sphere { radius, .. } = shape {
        // The same everywhere, so that all leaves on it have one size.
        return 3.0 * edge * edge / (8.0 * radius);
    }
    let at = |t: [f64; 3]| shape.depth(&(low + Vector3::from(t) * edge));
    if at([0.5; 3]).abs() > edge {
        return 0.0;
    }
    let corners: [f64; 8] =
        std::array::from_fn(|c| at([c & 1, c >> 1 & 1, c >> 2].map(|b| b as f64)));
    (0..27)
        .map(|i| {
            let t = [i % 3, i / 3 % 3, i / 9].map(|c| 0.5 * c as f64);
            let guess: f64 = (0..8)
                .map(|c| {
                    let bit = [c & 1, c >> 1 & 1, c >> 2];
                    let w: f64 = (0..3)
                        .map(|k| if bit[k] == 1 { t[k] } else { 1.0 - t[k] })
                        .product();
                    w * corners[c]
                })
                .sum();
            (at(t) - guess).abs()
        })
        .fold(0.0, f64::max)
}

/// Which cells of size 2 and 4 of a block hold finest cells with corners on both sides.
/// As bits in the order of the tree: 64 cells of size 2, eight of size 4.
fn mixed(masks: &[u8]) -> (u64, u8) {
    let (mut two, mut four) = (0u64, 0u8);
    for (i, &mask) in masks.iter().enumerate() {
        if mask != 0 && mask != 255 {
            let p = [i & 7, i >> 3 & 7, i >> 6];
            let child = |shift: usize| {
                (p[0] >> shift & 1) | (p[1] >> shift & 1) << 1 | (p[2] >> shift & 1) << 2
            };
            two |= 1 << (8 * child(2) + child(1));
            four |= 1 << child(2);
        }
    }
    (two, four)
}

/// The cells that must be split because of what they hold.
/// Only stored blocks ask for anything, each for its own cells, top-down: a cell that need not be split ends the way
/// there. Balance is not looked at here.
pub(crate) fn splits(samples: &Samples<'_>, options: &Options) -> Splits {
    let domain = &samples.domain;
    let ratio = (options.max_cell / domain.spacing).max(1.0).log2();
    let largest = if ratio < 30.0 {
        (ratio + 1e-9) as u8
    } else {
        30
    };
    let mut out = Splits::none(domain.blocks, largest);
    let judge = Judge::new(samples, options);
    // Without tolerances all cells with a surface are finest, and signs alone tell them.
    let uniform = options.has_one_size();
    let found: Vec<(usize, u64, u8, bool)> = parallel::flat_map(domain.block_len(), |b| {
        let (values, regions) = (samples.values_of(b)?, samples.regions_of(b)?);
        let block = domain.block(b);
        if uniform && let Some(masks) = samples.masks_of(b) {
            let (two, four) = mixed(masks);
            return Some((b, two, four, four != 0));
        }
        let bits = |i: usize| [i & 1, i >> 1 & 1, i >> 2];
        let (mut two, mut four) = (0u64, 0u8);
        let eight = judge.splits(block, values, &regions, [0; 3], 8);
        for g in (0..8).filter(|_| eight) {
            let low = bits(g).map(|c| 4 * c);
            if judge.splits(block, values, &regions, low, 4) {
                four |= 1 << g;
                for c in 0..8 {
                    let low = [0, 1, 2].map(|k| low[k] + 2 * bits(c)[k]);
                    if judge.splits(block, values, &regions, low, 2) {
                        two |= 1 << (8 * g + c);
                    }
                }
            }
        }
        Some((b, two, four, eight))
    });
    for (b, two, four, eight) in found {
        out.two[b] = two;
        out.four[b] |= four;
        out.eight[b] |= eight;
        out.alone[b] = true;
    }
    out
}

/// What holds here, for the tests.
#[cfg(feature = "testing")]
#[expect(missing_docs, reason = "the names of the laws say it")]
pub(crate) mod laws {
    use super::*;

    /// On the half lattice of the unit cube.
    fn on_half_lattice(f: impl Fn(f64, f64, f64) -> f64) -> [f64; 27] {
        std::array::from_fn(|i| {
            let [x, y, z] = [i % 3, i / 3 % 3, i / 9].map(|c| 0.5 * c as f64);
            f(x, y, z)
        })
    }

    pub fn trilinear_fields_have_no_error() {
        let f = on_half_lattice(|x, y, z| 1.0 + 2.0 * x - y + 3.0 * x * y * z - y * z);
        assert!(feature_error(&f, 0.5, ErrorNorm::Sum) < 1e-14);
    }

    pub fn a_parabola_has_the_error_worked_out_by_hand() {
        // f = x²: the interpolant is x with gradient 1; 9 of the 19 points have x = 1/2, where the
        // difference is 1/4.
        let f = on_half_lattice(|x, _, _| x * x);
        assert!((feature_error(&f, 2.0, ErrorNorm::Sum) - 9.0 * 0.25 * 2.0).abs() < 1e-14);
        assert!((feature_error(&f, 2.0, ErrorNorm::Max) - 0.25 * 2.0).abs() < 1e-14);
    }
}
