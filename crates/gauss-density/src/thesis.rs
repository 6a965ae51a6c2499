//! The thesis's ways to find the atoms that matter (§3.2.3), for comparison with the tiles.

use geom_core::nearest::PointTree;
use geom_core::{Aabb, Cpu, ImplicitField, Lattice, Point3};
use rayon::prelude::*;

use crate::cpu;
use crate::error::Error;
use crate::kernel::plain;
use crate::kernel::prepared::Prepared;
use crate::options::{Cutoff, Options};
use crate::sample::point::PointSampler;

/// How the atoms that matter at a point are found.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(rename_all = "kebab-case"))]
pub enum Method {
    /// Not at all: every atom at every point, without cut-off. Slow, and the yardstick of speed.
    AllAtoms,
    /// The thesis's neighbouring search: from one point near the surface to its neighbours. Misses every
    /// other component and every cavity.
    SingleSeed,
    /// A k-d tree over the atoms, asked at every point.
    KdTree,
    /// A hierarchy of boxes over the nodes of the model, asked at every point.
    Bvh,
    /// Culled blocks and bricks of points that share their atoms. The others are for comparison.
    #[default]
    Tiles,
}

/// The search radius of a point.
pub(crate) fn radius(model: &Prepared<'_>, cutoff: Cutoff, floor: f64) -> f64 {
    match cutoff {
        Cutoff::AfterPowers(eps) => model.reach.radius(eps, floor),
        Cutoff::Bare(eps) => model.reach.bare(eps),
    }
}

/// The densities at all points of a lattice, and the number of pairs, without tiles.
pub(crate) fn everywhere(
    model: &Prepared<'_>,
    lattice: &Lattice,
    options: &Options,
    floor: f64,
) -> Result<(Vec<f32>, u64), Error> {
    match options.method {
        Method::AllAtoms => Ok(cpu::all_atoms(model, lattice)),
        Method::SingleSeed => single_seed(model, lattice, options),
        Method::KdTree => {
            let tree = PointTree::of_positions(model.model().centers())?;
            let r = radius(model, options.cutoff, floor);
            Ok(by_point(model, lattice, options.cutoff, |x, found| {
                let near = tree.within(&[x.x, x.y, x.z], r);
                found.extend(near.iter().map(|n| n.index));
                found.sort_unstable();
            }))
        }
        Method::Bvh => {
            let boxes = Boxes::new(model);
            let r = radius(model, options.cutoff, floor);
            Ok(by_point(model, lattice, options.cutoff, |x, found| {
                boxes.within(model, x, r, found);
            }))
        }
        Method::Tiles => Err(Error::Unsupported {
            what: "tiles are not a search by point".to_owned(),
            cure: "call sample",
        }),
    }
}

/// Point by point, with the atoms (ascending) that `find` gives.
fn by_point(
    model: &Prepared<'_>,
    lattice: &Lattice,
    cutoff: Cutoff,
    find: impl Fn(&Point3, &mut Vec<u32>) + Sync,
) -> (Vec<f32>, u64) {
    let [nx, ny, nz] = lattice.counts;
    let mut values = vec![0.0f32; nx * ny * nz];
    let pairs = values
        .par_chunks_mut(nx)
        .enumerate()
        .map(|(row, out)| {
            let (mut found, mut pairs) = (Vec::new(), 0);
            for (x, value) in out.iter_mut().enumerate() {
                let at = lattice.point([x, row % ny, row / ny]);
                found.clear();
                find(&at, &mut found);
                pairs += found.len() as u64;
                *value = density(model, cutoff, &found, &at);
            }
            pairs
        })
        .sum();
    (values, pairs)
}

fn density(model: &Prepared<'_>, cutoff: Cutoff, atoms: &[u32], x: &Point3) -> f32 {
    let counts = |&a: &u32| match cutoff {
        Cutoff::Bare(eps) => model.tree.ln_kernel(a as usize, x) >= eps.ln(),
        Cutoff::AfterPowers(_) => true,
    };
    let g = plain::value(&model.tree, atoms.iter().copied().filter(counts), x);
    (g as f32).min(f32::MAX)
}

/// A box around the centres below each node of each level; the levels that matter, and clusters of atoms.
struct Boxes {
    /// Lowest level first.
    levels: Vec<Vec<Aabb>>,
}

impl Boxes {
    fn new(model: &Prepared<'_>) -> Self {
        let levels = model.model().levels();
        let mut boxes: Vec<Vec<Aabb>> = Vec::with_capacity(levels.len());
        for level in levels {
            let of = |node: usize| match boxes.last() {
                None => Aabb::of_points(&model.model().centers()[level.children(node)]),
                Some(below) => below[level.children(node)]
                    .iter()
                    .fold(Aabb::EMPTY, |a, b| a.union(b)),
            };
            let own = (0..level.len()).map(of).collect();
            boxes.push(own);
        }
        Self { levels: boxes }
    }

    /// The atoms at most `r` from `x`, ascending.
    fn within(&self, model: &Prepared<'_>, x: &Point3, r: f64, found: &mut Vec<u32>) {
        match self.levels.len() {
            0 => {
                for a in 0..model.model().atoms() {
                    self.descend(model, 0, a, x, r * r, found);
                }
            }
            depth => {
                for node in 0..self.levels[depth - 1].len() {
                    self.descend(model, depth, node, x, r * r, found);
                }
            }
        }
    }

    fn descend(
        &self,
        model: &Prepared<'_>,
        depth: usize,
        node: usize,
        x: &Point3,
        squared: f64,
        found: &mut Vec<u32>,
    ) {
        let model_ = model.model();
        if depth == 0 {
            if (x - model_.centers()[node]).norm_squared() <= squared {
                found.push(node as u32);
            }
        } else if self.levels[depth - 1][node].distance_squared(x) <= squared {
            for child in model_.levels()[depth - 1].children(node) {
                self.descend(model, depth - 1, child, x, squared, found);
            }
        }
    }
}

/// The thesis's neighbouring search: the band point nearest to the box's low x side on its centre line, then
/// neighbours of band points while they lie in the band. What the band does not shut off from the box is
/// outside (0), the rest inside (`2 g_u`).
fn single_seed(
    model: &Prepared<'_>,
    lattice: &Lattice,
    options: &Options,
) -> Result<(Vec<f32>, u64), Error> {
    enum Near<'a> {
        Cells(Box<PointSampler<'a>>),
        Boxes(Boxes, f64),
    }
    let near = match options.cutoff {
        Cutoff::AfterPowers(_) => {
            Near::Cells(Box::new(PointSampler::new(model.model(), options.cutoff)?))
        }
        Cutoff::Bare(_) => Near::Boxes(Boxes::new(model), radius(model, options.cutoff, 1.0)),
    };
    let mut pairs = 0;
    let mut evaluate = |p: [usize; 3]| {
        let x = lattice.point(p);
        match &near {
            Near::Cells(sampler) => {
                pairs += sampler.members_near(&x) as u64;
                (sampler.value(&x) as f32).min(f32::MAX)
            }
            Near::Boxes(boxes, r) => {
                let mut found = Vec::new();
                boxes.within(model, &x, *r, &mut found);
                pairs += found.len() as u64;
                density(model, options.cutoff, &found, &x)
            }
        }
    };
    // Points next to the band are evaluated too, so that the surface has values on both sides.
    let [low, high] = options.band.map(|g| g as f32);
    let [nx, ny, nz] = lattice.counts;
    let mut values = vec![f32::NAN; nx * ny * nz];
    let mut open = Vec::new();
    let mut last = 0.0f32;
    for x in 0..nx {
        let p = [x, ny / 2, nz / 2];
        let g = evaluate(p);
        values[lattice.index(p)] = g;
        if (g > low && g < high) || (g >= 1.0) != (last >= 1.0) {
            open.push(p);
            break;
        }
        last = g;
    }
    let neighbours = |p: [usize; 3]| {
        (0..6).filter_map(move |i| {
            let (axis, up) = (i / 2, i % 2 == 1);
            let mut q = p;
            if up {
                q[axis] += 1;
            } else {
                q[axis] = q[axis].checked_sub(1)?;
            }
            (q[axis] < lattice.counts[axis]).then_some(q)
        })
    };
    while let Some(p) = open.pop() {
        for q in neighbours(p) {
            let at = lattice.index(q);
            if !values[at].is_nan() {
                continue;
            }
            let g = evaluate(q);
            values[at] = g;
            let own = values[lattice.index(p)];
            if (g > low && g < high) || (g >= 1.0) != (own >= 1.0) {
                open.push(q);
            }
        }
    }
    // Outside is what is reached from the box without crossing the band.
    let mut outside: Vec<[usize; 3]> = Vec::new();
    for i in 0..values.len() {
        let p = lattice.coordinates(i);
        let on_box = (0..3).any(|k| p[k] == 0 || p[k] + 1 == lattice.counts[k]);
        if on_box && values[i].is_nan() {
            values[i] = 0.0;
            outside.push(p);
            while let Some(p) = outside.pop() {
                for q in neighbours(p) {
                    let at = lattice.index(q);
                    if values[at].is_nan() {
                        values[at] = 0.0;
                        outside.push(q);
                    }
                }
            }
        }
    }
    for value in &mut values {
        if value.is_nan() {
            *value = 2.0 * high;
        }
    }
    Ok((values, pairs))
}

/// The comparison methods exist on the CPU only.
pub(crate) fn check_backend(method: Method, name: &str) -> Result<(), Error> {
    if method == Method::Tiles || name == geom_core::Backend::name(&Cpu) {
        return Ok(());
    }
    Err(Error::Unsupported {
        what: format!("method {method:?} does not run on {name}"),
        cure: "use method Tiles, or the CPU",
    })
}
