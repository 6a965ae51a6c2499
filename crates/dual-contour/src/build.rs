//! From values and options to the complex: the steps that surface and volume share.

use geom_core::mesh::{INTERIOR, Region, VertexKind};
use geom_core::{ImplicitField, Lattice, LatticeValues, Point3, Run};
use rayon::prelude::*;

use crate::backend::ContourBackend;
use crate::complex::{Complex, Kinds};
use crate::dual::{Duals, Probe};
use crate::emit::{Emission, Emitter, Want, kinds};
use crate::octree::{BLOCK, Octree, Splits};
use crate::samples::{Domain, Labels, POINTS, Samples, Source};
use crate::{AtBox, Error, Extent, Method, Options, Outer, Report, Resolution, Shape};
use crate::{lattice, sizing};

/// Most finest cells per axis that a leaf's coordinates can name.
const MOST_CELLS: f64 = 65_000.0;

/// What a mesh is for.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum Purpose {
    Surface,
    Volume(Extent),
}

/// A mesh in the vertex numbers of its mesher, positions in finest cells.
#[derive(Default)]
pub(crate) struct Raw {
    pub(crate) positions: Vec<Point3>,
    pub(crate) kinds: Vec<VertexKind>,
    pub(crate) tets: Vec<[u32; 4]>,
    pub(crate) regions: Vec<Region>,
    /// The boundary of the molecule, seen from outside of it.
    pub(crate) triangles: Vec<[u32; 3]>,
    /// Vertices beside cells and corners.
    pub(crate) added: usize,
}

/// A mesh, where it lies, and how it came about.
pub(crate) struct Contour {
    pub(crate) raw: Raw,
    pub(crate) domain: Domain,
    pub(crate) report: Report,
}

/// Options whose resolution is no number of tetrahedra: the spacing that gives about as many as asked
/// for, found by meshing at growing fineness.
pub(crate) fn resolved<V: LatticeValues + ?Sized, B: ContourBackend + ?Sized>(
    values: &V,
    field: Option<&dyn ImplicitField>,
    options: &Options,
    run: Run<'_, B>,
) -> Result<Options, Error> {
    let Resolution::Tets(wanted) = options.resolution else {
        return Ok(options.clone());
    };
    options.check()?;
    let at = |h: f64| Options {
        resolution: Resolution::Spacing(h),
        ..options.clone()
    };
    let own = values.lattice().spacing;
    let volume: f64 = values.lattice().bounds().extent().iter().product();
    // Coarse enough for a first count that costs little; tetrahedra grow with a power of 1/h between
    // those of surface and volume.
    let mut h = (6.0 * volume / wanted as f64).cbrt().max(own * 1e-3);
    let mut last: Option<(f64, f64)> = None;
    let mut best: Option<(f64, f64)> = None;
    for round in 0..12 {
        run.progress("resolution", round, 12)?;
        let count = match contour(values, field, &at(h), Purpose::Volume(options.region), run) {
            Ok(mesh) => mesh.report.tets as f64,
            // Too coarse to see anything.
            Err(
                Error::NoSurface { .. }
                | Error::InvalidOption {
                    option: "resolution" | "prune",
                    ..
                },
            ) if h > 0.5 * own => 0.0,
            Err(error) => return Err(error),
        };
        if count == 0.0 {
            h *= 0.6;
            continue;
        }
        let miss = (count / wanted as f64).ln();
        if best.is_none_or(|(_, m)| miss.abs() < m) {
            best = Some((h, miss.abs()));
        }
        if miss.abs() < 0.1 {
            break;
        }
        let power = match last {
            Some((other, n)) if (other / h).ln().abs() > 1e-3 => {
                ((count / n).ln() / (other / h).ln()).clamp(1.5, 4.0)
            }
            _ => 2.5,
        };
        last = Some((h, count));
        h *= (miss / power).exp();
    }
    match best {
        Some((h, miss)) if miss < 0.2 => Ok(at(h)),
        _ => Err(Error::InvalidOption {
            option: "resolution",
            reason: format!(
                "no spacing gives about {wanted} tetrahedra; give a spacing instead{}",
                best.map_or(String::new(), |(h, _)| format!(", e.g. {h:.3} Å"))
            ),
        }),
    }
}

/// Values and labels as options and purpose ask for, and what has been counted.
pub(crate) fn sampled<'a, V: LatticeValues + ?Sized, B: ContourBackend + ?Sized>(
    values: &'a V,
    field: Option<&'a dyn ImplicitField>,
    options: &Options,
    purpose: Purpose,
    run: Run<'_, B>,
) -> Result<(Samples<'a>, Report), Error> {
    options.check()?;
    let lattice = values.lattice();
    if lattice.counts.iter().any(|&n| n < 2) {
        return Err(Error::NoCells {
            counts: lattice.counts,
        });
    }
    run.progress("sample", 0, 1)?;
    let touching = touching(values, options.level);
    if let (AtBox::Refuse, Some((side, points))) = (options.at_box, touching) {
        return Err(Error::SurfaceTouchesBox { side, points });
    }
    let spacing = match options.resolution {
        Resolution::Spacing(h) => h,
        Resolution::Lattice => lattice.spacing,
        Resolution::Tets(_) => unreachable!("resolved into a spacing before"),
    };
    let aligned = spacing == lattice.spacing;
    let outside = (options.level - options.level.abs() - 1.0) as f32;
    let (domain, shift, outer) = domain(lattice, spacing, options, purpose, touching.is_some())?;
    let labels = Labels {
        level: options.level,
        materials: options.materials.clone(),
        outer,
    };
    let source = if aligned {
        Source::Aligned {
            values,
            shift,
            outside,
        }
    } else {
        Source::Resampled {
            values,
            field,
            outside,
        }
    };
    let mut report = Report::default();
    let mut samples = Samples::new(source, domain, labels, run.backend)?;
    if options.prune > 0 {
        let points: u64 = domain.cells.iter().map(|&n| n as u64 + 1).product();
        if u64::from(options.prune) > points {
            return Err(Error::InvalidOption {
                option: "prune",
                reason: format!("{} points are more than all {points}", options.prune),
            });
        }
        (report.pruned_groups, report.pruned_points) = samples.prune(options.prune);
    }
    if !samples.holds_both_sides() {
        return Err(no_surface(values, options, samples.range, spacing));
    }
    samples.find_crossings(run.backend)?;
    report.spacing = samples.domain.spacing;
    Ok((samples, report))
}

/// Makes the mesh that options and purpose ask for.
pub(crate) fn contour<V: LatticeValues + ?Sized, B: ContourBackend + ?Sized>(
    values: &V,
    field: Option<&dyn ImplicitField>,
    options: &Options,
    purpose: Purpose,
    run: Run<'_, B>,
) -> Result<Contour, Error> {
    let (samples, report) = sampled(values, field, options, purpose, run)?;
    let probe = Probe::new(&samples, field, options);
    mesh(&samples, &probe, options, purpose, report, run)
}

/// Are all cells with a surface finest, with nothing but molecule and exterior, off the box?
pub(crate) fn is_uniform(options: &Options) -> bool {
    options.tolerance == 0.0
        && options.zones.is_empty()
        && options.materials.is_empty()
        && options.at_box != AtBox::Clip
        && options.method == Method::DualContour
}

/// How often leaves whose points would stick out are split: each time leaves about a twentieth of them,
/// and each time the octree is made again.
const SPIKE_ROUNDS: u32 = 4;

/// Makes the mesh of what has been sampled.
pub(crate) fn mesh<B: ContourBackend + ?Sized>(
    samples: &Samples<'_>,
    probe: &Probe<'_>,
    options: &Options,
    purpose: Purpose,
    mut report: Report,
    run: Run<'_, B>,
) -> Result<Contour, Error> {
    let boxed = match purpose {
        Purpose::Surface | Purpose::Volume(Extent::Interior) => options.at_box == AtBox::Clip,
        Purpose::Volume(_) => true,
    };
    let keep = |r| match purpose {
        Purpose::Surface => false,
        Purpose::Volume(extent) => extent.holds(r),
    };
    let stage = match purpose {
        Purpose::Surface => "triangles",
        Purpose::Volume(_) => "tetrahedra",
    };
    run.progress("octree", 0, 1)?;
    let mut splits = sizing::splits(samples, options);
    let mut before = None;
    let mut rounds = 0..SPIKE_ROUNDS;
    let raw = loop {
        let (tree, kinds) = match options.method {
            Method::DualContour => tree(samples, options, &mut splits),
            Method::Lattice => even_tree(samples, options, &mut splits),
        };
        let complex = Complex::new(samples, &tree, kinds);
        check_counts(&complex, purpose)?;
        report.leaves = tree.leaves.iter().filter(|l| !l.void).count();
        report.surface_cells = (0..tree.leaves.len() as u32)
            .filter(|&id| complex.is_interface(id))
            .count();
        if options.method == Method::Lattice {
            run.progress(stage, 0, 1)?;
            let (raw, counts) = lattice::mesh(&complex, probe, options.at_box == AtBox::Clip, keep);
            (report.snapped, report.held_back) = (counts.snapped, counts.refused);
            break raw;
        }
        run.progress("dual vertices", 0, 1)?;
        let duals = Duals::new(&complex, probe, boxed, before.as_ref(), run.backend)?;
        let spikes = duals.spikes(&complex);
        if !spikes.is_empty() && rounds.next().is_some() {
            for id in spikes {
                splits.split(samples.domain.blocks, complex.leaf(id));
            }
            drop(complex);
            before = Some((tree, duals));
            continue;
        }
        report.split_cells = complex.splits.len();
        report.held_back = duals.held_back();
        run.progress(stage, 0, 1)?;
        let emitter = Emitter::new(&complex, &duals, probe, |r| {
            keep(r) || boxed && r == INTERIOR
        });
        let emission = emitter.emit(&Want {
            tets: purpose != Purpose::Surface,
            region: keep,
        });
        break Raw::from_emission(&emitter, emission, keep);
    };
    report.added_vertices = raw.added;
    report.triangles = raw.triangles.len();
    report.tets = raw.tets.len();
    let domain = samples.domain;
    run.progress(stage, 1, 1)?;
    Ok(Contour {
        raw,
        domain,
        report,
    })
}

/// Why all is on one side: the values, the small groups that were given away, or cells that see too little.
fn no_surface<V: LatticeValues + ?Sized>(
    values: &V,
    options: &Options,
    seen: (f32, f32),
    spacing: f64,
) -> Error {
    let [nx, ny, nz] = values.lattice().counts;
    let mut row = vec![0.0; nx];
    let (mut min, mut max) = (f64::INFINITY, f64::NEG_INFINITY);
    for at in 0..ny * nz {
        values.read_row([0, at % ny, at / ny], &mut row);
        for &v in &row {
            (min, max) = (min.min(f64::from(v)), max.max(f64::from(v)));
        }
    }
    let level = options.level;
    let crossed = |min: f64, max: f64| min < level && level <= max;
    if !crossed(min, max) {
        Error::NoSurface { level, min, max }
    } else if crossed(f64::from(seen.0), f64::from(seen.1)) && options.prune > 0 {
        Error::InvalidOption {
            option: "prune",
            reason: format!(
                "every group on one side of level {level} has fewer than {} points",
                options.prune
            ),
        }
    } else {
        Error::InvalidOption {
            option: "resolution",
            reason: format!(
                "cells of {spacing} Å see no value on one side of level {level}; take smaller ones"
            ),
        }
    }
}

impl Raw {
    fn from_emission(
        emitter: &Emitter<'_>,
        emission: Emission,
        keep: impl Fn(Region) -> bool + Sync,
    ) -> Self {
        let positions = emitter.positions(&emission.added);
        let kinds = if emission.tets.is_empty() {
            Vec::new()
        } else {
            let meeting = emitter.meeting(emission.added.len(), keep);
            kinds(&positions, &meeting, emitter.complex.tree.cells)
        };
        Self {
            kinds,
            positions,
            tets: emission.tets,
            regions: emission.regions,
            triangles: emission.triangles,
            added: emission.added.len(),
        }
    }
}

/// Do labels follow from signs, and are all cells with a surface finest?
fn is_finest(samples: &Samples<'_>, options: &Options) -> bool {
    samples.labels.plain() && options.tolerance == 0.0 && options.zones.is_empty()
}

/// The octree with cells of one size around the surface, as snapping needs it.
fn even_tree(samples: &Samples<'_>, options: &Options, splits: &mut Splits) -> (Octree, Kinds) {
    let cells = samples.domain.cells;
    let finest = is_finest(samples, options);
    let tree = Octree::new(cells, splits);
    for id in Kinds::of(samples, &tree, finest).interfaces() {
        let leaf = &tree.leaves[id as usize];
        if leaf.log == 0 {
            splits.surround(cells, leaf.origin());
        }
    }
    let tree = Octree::new(cells, splits);
    let kinds = Kinds::of(samples, &tree, finest).unsplit();
    (tree, kinds)
}

/// The octree in which ambiguous cells are finest, and stand among finest ones.
fn tree(samples: &Samples<'_>, options: &Options, splits: &mut Splits) -> (Octree, Kinds) {
    let domain = samples.domain;
    let finest = is_finest(samples, options);
    let mut tree = Octree::new(domain.cells, splits);
    let mut kinds = Kinds::of(samples, &tree, finest);
    loop {
        let large = kinds.large(&tree);
        for &id in &large {
            splits.split(domain.blocks, &tree.leaves[id as usize]);
        }
        // Cut cells stand among finest ones, so that surfaces do not hang on what lies off them.
        let bare: Vec<u32> = kinds
            .cut(&tree)
            .into_par_iter()
            .filter(|&id| {
                tree.touching(id)
                    .any(|other| tree.leaves[other as usize].log > 0)
            })
            .collect();
        for &id in &bare {
            splits.surround(domain.cells, tree.leaves[id as usize].origin());
        }
        if large.is_empty() && bare.is_empty() {
            return (tree, kinds);
        }
        tree = Octree::new(domain.cells, splits);
        kinds = Kinds::of(samples, &tree, finest);
    }
}

/// Refuses what vertex and element numbers could not name: fewer than 24 tetrahedra per leaf and 4
/// vertices, with 4 more per surface leaf for cuts.
fn check_counts(complex: &Complex<'_>, purpose: Purpose) -> Result<(), Error> {
    let leaves = complex.tree.leaves.len() as u128;
    let elements = match purpose {
        Purpose::Surface => 12 * leaves,
        Purpose::Volume(_) => 24 * leaves,
    };
    let limit = u128::from(u32::MAX - 2);
    if elements > 4 * limit || 8 * leaves > limit {
        return Err(Error::TooLarge {
            what: "the mesh",
            bytes: elements * 17,
            limit: limit * 17,
            cure: "take a larger spacing",
        });
    }
    Ok(())
}

/// The first side of the lattice with points inside, and how many.
fn touching<V: LatticeValues + ?Sized>(values: &V, level: f64) -> Option<(usize, u64)> {
    let [nx, ny, nz] = values.lattice().counts;
    (0..6).find_map(|side| {
        let (axis, high) = (side / 2, side % 2 == 1);
        // Rows along x in the face; the faces across x have one point of each.
        let (rows, start, len) = match axis {
            0 => (ny * nz, if high { nx - 1 } else { 0 }, 1),
            1 => (nz, 0, nx),
            _ => (ny, 0, nx),
        };
        let points: u64 = (0..rows)
            .into_par_iter()
            .with_min_len(64)
            .map_init(
                || vec![0.0; len],
                |values_of_row, row| {
                    let from = match axis {
                        0 => [start, row % ny, row / ny],
                        1 => [start, if high { ny - 1 } else { 0 }, row],
                        _ => [start, row, if high { nz - 1 } else { 0 }],
                    };
                    values.read_row(from, values_of_row);
                    let inside = |v: &&f32| f64::from(**v) >= level;
                    values_of_row.iter().filter(inside).count() as u64
                },
            )
            .sum();
        (points > 0).then_some((side, points))
    })
}

/// The mesh lattice, the shift of the value lattice within it (aligned only), and the outer sphere.
fn domain(
    lattice: &Lattice,
    spacing: f64,
    options: &Options,
    purpose: Purpose,
    touches: bool,
) -> Result<(Domain, [i32; 3], Option<Shape>), Error> {
    let aligned = spacing == lattice.spacing;
    let bounds = lattice.bounds();
    let exterior = matches!(purpose, Purpose::Volume(Extent::Exterior | Extent::Both));
    let clip = options.at_box == AtBox::Clip;
    let outer = if exterior { options.outer } else { Outer::Grid };
    if clip && outer != Outer::Grid {
        return Err(Error::InvalidOption {
            option: "outer",
            reason: "clipping ends the mesh at the box of the lattice; take Outer::Grid, or cap the surface".to_owned(),
        });
    }
    // Cells of the value lattice's box, rounded so that a clipped mesh stays within it.
    let own = [0, 1, 2].map(|k| {
        let n = bounds.extent()[k] / spacing;
        if aligned {
            lattice.counts[k] as f64 - 1.0
        } else if clip {
            (n + 1e-9).floor().max(1.0)
        } else {
            (n - 1e-9).ceil().max(1.0)
        }
    });
    let round = |n: f64, to: f64| (n / to).ceil() * to;
    let block = f64::from(BLOCK);
    // Whole blocks below the lattice, so that leaves near the surface do not depend on where the mesh
    // ends; one at least if the surface is to close there.
    let pad = if touches && !clip { block } else { 0.0 };
    let (cells, sphere): ([f64; 3], _) = match outer {
        Outer::Grid if clip => (own, None),
        Outer::Grid => (own.map(|n| round(n + pad + pad.min(1.0), block)), None),
        Outer::Box { scale } => {
            // Whole groups of blocks, so that cells may grow towards the box.
            let enlarged = own.map(|n| round((n * scale).max(n + 2.0 * pad), 4.0 * block));
            (enlarged, None)
        }
        Outer::Sphere { scale } => {
            let radius = 0.5 * scale * bounds.diagonal();
            let n = round(2.0 * radius / spacing + 4.0 * block, 4.0 * block);
            let center = bounds.center();
            ([n; 3], Some(Shape::Sphere { center, radius }))
        }
    };
    if cells.iter().any(|&n| n > MOST_CELLS) {
        return Err(Error::InvalidOption {
            option: "resolution",
            reason: format!(
                "{} cells along an axis, more than {MOST_CELLS}; take a larger spacing",
                cells.iter().fold(0.0f64, |m, &n| m.max(n))
            ),
        });
    }
    let blocks: u128 = cells.iter().map(|&n| (n / block).ceil() as u128).product();
    // Per block a node, marks of points, and requests; stored blocks are checked by the surface they
    // carry, of the order of blocks^(2/3).
    let stored = (blocks as f64).powf(2.0 / 3.0) * 12.0;
    let bytes = blocks * 120 + (stored as u128) * (POINTS as u128) * 8;
    if bytes > u128::from(options.max_memory) {
        return Err(Error::TooLarge {
            what: "the octree",
            bytes,
            limit: options.max_memory.into(),
            cure: "take a larger spacing or a smaller outer box, or allow more memory",
        });
    }
    let cells = cells.map(|n| n as i32);
    let shift = match outer {
        Outer::Grid => [pad as i32; 3],
        _ => [0, 1, 2].map(|k| {
            let half = (cells[k] - own[k] as i32) / 2;
            (half / BLOCK * BLOCK).max(pad as i32)
        }),
    };
    let origin = bounds.min - geom_core::Vector3::from(shift.map(f64::from)) * spacing;
    Ok((Domain::new(origin, spacing, cells, shift), shift, sphere))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::octree::{BLOCK_LOG, Splits};
    use geom_core::mesh::{EXTERIOR, six_volume};
    use geom_core::sets::DisjointSets;
    use geom_core::{Cpu, ScalarGrid};
    use std::collections::{BTreeMap, BTreeSet};

    /// Number of sets among the members that are asked for.
    fn sets(groups: DisjointSets, member: impl Fn(usize) -> bool) -> usize {
        let roots = groups.into_roots();
        let mut found: Vec<u32> = (0..roots.len())
            .filter(|&i| member(i))
            .map(|i| roots[i])
            .collect();
        found.sort_unstable();
        found.dedup();
        found.len()
    }

    /// A lattice of `n` cells per axis whose points are inside at random, but none on the box.
    fn noise(n: usize, seed: u64, density: f64) -> ScalarGrid {
        let lattice = Lattice {
            origin: Point3::origin(),
            spacing: 1.0,
            counts: [n + 1; 3],
        };
        let mut state = seed;
        let values = (0..lattice.len())
            .map(|i| {
                state = state
                    .wrapping_mul(6_364_136_223_846_793_005)
                    .wrapping_add(1);
                let random = (state >> 33) as f64 / (1u64 << 31) as f64;
                let p = lattice.coordinates(i);
                let margin = p.iter().any(|&c| c == 0 || c == n);
                if random < density && !margin {
                    1.5
                } else {
                    1.0 - random as f32 - 0.1
                }
            })
            .collect();
        ScalarGrid::new(lattice, values).unwrap()
    }

    /// The samples of a grid with plain labels.
    fn plain(grid: &ScalarGrid) -> Samples<'_> {
        let options = Options::default();
        let purpose = Purpose::Volume(Extent::Both);
        let (domain, shift, outer) = domain(grid.lattice(), 1.0, &options, purpose, false).unwrap();
        let labels = Labels {
            level: 1.0,
            materials: Vec::new(),
            outer,
        };
        let source = Source::Aligned {
            values: grid,
            shift,
            outside: 0.0,
        };
        let mut samples = Samples::new(source, domain, labels, &Cpu).unwrap();
        samples.find_crossings(&Cpu).unwrap();
        samples
    }

    /// Leaves are simple if a flood along the edges of the complex reaches all of their corners of each
    /// label. Here the edges are found from all leaves, not from tables or neighbours.
    #[test]
    fn leaves_are_simple_as_a_flood_says() {
        let corner = |o: [i32; 3], s: i32, i: i32| [0, 1, 2].map(|k| o[k] + s * (i >> k & 1));
        // Simple and not, per size of the leaf.
        let mut seen = [[0; 2]; 4];
        for (seed, density) in [(1u64, 0.01), (2, 0.04), (3, 0.1), (4, 0.3), (5, 0.5)] {
            let grid = noise(32, seed, density);
            let samples = plain(&grid);
            let domain = samples.domain;
            let mut splits = Splits::none(domain.blocks, BLOCK_LOG);
            for (b, two) in splits.two.iter_mut().enumerate() {
                // A few cells of size 2, none in most blocks.
                if b % 9 == 0 {
                    *two = 1 << ((7 * b + 5 * seed as usize) % 64);
                }
            }
            let tree = Octree::new(domain.cells, &splits);
            let kinds = Kinds::of(&samples, &tree, false);
            let mut split = kinds.large(&tree);
            split.extend(kinds.cut(&tree));
            let interfaces: BTreeSet<u32> = kinds.interfaces().collect();

            let leaves = || tree.leaves.iter().filter(|leaf| !leaf.void);
            let points: BTreeSet<[i32; 3]> = leaves()
                .flat_map(|leaf| (0..8).map(|i| corner(leaf.origin(), leaf.size(), i)))
                .collect();
            let mut edges: BTreeMap<[i32; 3], Vec<[i32; 3]>> = BTreeMap::new();
            for leaf in leaves() {
                let (o, s) = (leaf.origin(), leaf.size());
                for (i, axis) in (0..8).flat_map(|i| (0..3).map(move |axis| (i, axis))) {
                    let (p, q) = (corner(o, s, i), corner(o, s, i ^ 1 << axis));
                    let between = |t: i32| [0, 1, 2].map(|k| p[k] + (q[k] - p[k]).signum() * t);
                    if (1..s).all(|t| !points.contains(&between(t))) {
                        edges.entry(p).or_default().push(q);
                    }
                }
            }
            for (id, leaf) in tree.leaves.iter().enumerate().filter(|(_, l)| !l.void) {
                let (o, s) = (leaf.origin(), leaf.size());
                let within = |p: &[i32; 3]| (0..3).all(|k| (o[k]..=o[k] + s).contains(&p[k]));
                let corners: Vec<[i32; 3]> = points.iter().filter(|p| within(p)).copied().collect();
                let groups = [true, false].map(|inside| {
                    let ours = |p: &[i32; 3]| (samples.label(*p) == INTERIOR) == inside;
                    let mut left: BTreeSet<[i32; 3]> =
                        corners.iter().filter(|p| ours(p)).copied().collect();
                    let mut groups = 0;
                    while let Some(first) = left.pop_first() {
                        groups += 1;
                        let mut front = vec![first];
                        while let Some(p) = front.pop() {
                            front.extend(edges[&p].iter().filter(|q| left.remove(*q)));
                        }
                    }
                    groups
                });
                let (mixed, simple) = (!groups.contains(&0), groups.iter().all(|&g| g <= 1));
                let id = id as u32;
                assert_eq!(interfaces.contains(&id), mixed, "{leaf:?}");
                assert_eq!(split.contains(&id), !simple, "{leaf:?}, {groups:?}");
                if mixed {
                    seen[usize::from(leaf.log)][usize::from(simple)] += 1;
                }
            }
        }
        assert!(
            seen.iter().flatten().all(|&n| n >= 5),
            "too few of a sort: {seen:?}"
        );
    }

    /// On random labels, ambiguous everywhere: the parts of each region are those of the corners with
    /// its label in the graph of the complex's edges.
    #[test]
    fn parts_are_those_of_the_graph_of_the_complex() {
        for (seed, density) in [(1u64, 0.2), (2, 0.35), (3, 0.6)] {
            let grid = noise(32, seed, density);
            let samples = plain(&grid);
            let options = Options::default();
            let mut splits = sizing::splits(&samples, &options);
            let (tree, kinds) = tree(&samples, &options, &mut splits);
            let complex = Complex::new(&samples, &tree, kinds);
            let probe = Probe {
                samples: &samples,
                field: None,
                placement: options.placement,
            };
            let duals = Duals::new(&complex, &probe, true, None, &Cpu).unwrap();
            let emitter = Emitter::new(&complex, &duals, &probe, |_| true);
            let emission = emitter.emit(&Want {
                tets: true,
                region: |_| true,
            });
            assert!(complex.splits.len() > 1000);
            let raw = Raw::from_emission(&emitter, emission, |_| true);
            assert!(
                raw.tets
                    .iter()
                    .all(|t| six_volume(t.map(|v| raw.positions[v as usize])) > 0.0)
            );
            for region in [INTERIOR, EXTERIOR] {
                let mut of_tets = DisjointSets::new(raw.positions.len());
                let mut used = vec![false; raw.positions.len()];
                for (t, _) in raw.tets.iter().zip(&raw.regions).filter(|t| *t.1 == region) {
                    t.iter().for_each(|&v| {
                        used[v as usize] = true;
                        of_tets.join(t[0], v);
                    });
                }
                let mut graph = DisjointSets::new(raw.positions.len());
                let mut corner = vec![false; raw.positions.len()];
                for id in 0..tree.leaves.len() as u32 {
                    complex.rings_of(
                        id,
                        |_, _| true,
                        |ring| {
                            let [a, b] =
                                [ring.a.0, ring.b.0].map(|c| emitter.numbering.corner(c) as usize);
                            corner[a] |= ring.a.1 == region;
                            corner[b] |= ring.b.1 == region;
                            if ring.a.1 == region && ring.b.1 == region {
                                graph.join(a as u32, b as u32);
                            }
                        },
                    );
                }
                let (ours, theirs) = (sets(of_tets, |v| used[v]), sets(graph, |v| corner[v]));
                assert_eq!(ours, theirs, "region {region} at density {density}");
                assert!(theirs > 1 || region == EXTERIOR || density > 0.3);
            }
        }
    }
}
