//! From values and options to the complex: the steps that surface and volume share.

use geom_core::mesh::INTERIOR;
use geom_core::{Aabb, ImplicitField, Lattice, LatticeValues, Point3, Run};

use crate::backend::ContourBackend;
use crate::complex::{Complex, Outcome};
use crate::dual::{Duals, Probe};
use crate::octree::{BLOCK, Octree};
use crate::samples::{Domain, Labels, POINTS, Samples, Source};
use crate::sizing;
use crate::{AtBox, Error, Extent, Options, Outer, Report, Resolution, Shape};

/// Most finest cells per axis that a leaf's coordinates can name.
const MOST_CELLS: f64 = 65_000.0;

/// What a mesh is for.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum Purpose {
    Surface,
    Volume(Extent),
}

/// Values, labels and tree, ready for the complex.
pub(crate) struct Built {
    pub(crate) samples: Samples,
    pub(crate) tree: Octree,
    /// Is the box of the domain part of the mesh?
    pub(crate) boxed: bool,
}

pub(crate) fn build<V: LatticeValues + ?Sized, B: ContourBackend + ?Sized>(
    values: &V,
    field: Option<&dyn ImplicitField>,
    options: &Options,
    purpose: Purpose,
    run: Run<'_, B>,
) -> Result<Built, Error> {
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
        _ => lattice.spacing,
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
    let samples = Samples::new(&source, domain, labels)?;
    let plain_empty = samples.labels.materials.is_empty();
    if samples.stored() == 0 && plain_empty || !samples.crosses_level() {
        let (min, max) = samples.range;
        return Err(Error::NoSurface {
            level: options.level,
            min: f64::from(min),
            max: f64::from(max),
        });
    }
    run.progress("octree", 0, 1)?;
    let mut splits = sizing::splits(&samples, options);
    let mut tree = Octree::new(domain.cells, &splits);
    loop {
        let large = match Complex::build(&samples, &tree, |_, v| v) {
            Outcome::Ready(_) => break,
            Outcome::Split(large) => large,
        };
        for id in large {
            splits.split(domain.blocks, &tree.leaves[id as usize]);
        }
        tree = Octree::new(domain.cells, &splits);
    }
    let boxed = match purpose {
        Purpose::Surface | Purpose::Volume(Extent::Interior) => options.at_box == AtBox::Clip,
        Purpose::Volume(_) => true,
    };
    Ok(Built {
        samples,
        tree,
        boxed,
    })
}

/// The first side of the lattice with points inside, and how many.
fn touching<V: LatticeValues + ?Sized>(values: &V, level: f64) -> Option<(usize, u64)> {
    let counts = values.lattice().counts;
    (0..6).find_map(|side| {
        let (axis, high) = (side / 2, side % 2 == 1);
        let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
        let mut points = 0;
        for j in 0..counts[v] {
            for i in 0..counts[u] {
                let mut p = [0; 3];
                p[axis] = if high { counts[axis] - 1 } else { 0 };
                (p[u], p[v]) = (i, j);
                points += u64::from(f64::from(values.at(p)) >= level);
            }
        }
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
    let (cells, sphere): ([f64; 3], _) = match outer {
        Outer::Grid if clip => (own, None),
        Outer::Grid => {
            let pad = if touches { 2.0 } else { 0.0 };
            (own.map(|n| round(n + pad, block)), None)
        }
        Outer::Box { scale } => {
            let pad = if touches { 2.0 } else { 0.0 };
            // Whole groups of blocks, so that cells may grow towards the box.
            (
                own.map(|n| round((n * scale).max(n + pad), 4.0 * block)),
                None,
            )
        }
        Outer::Sphere { scale } => {
            let radius = 0.5 * scale * bounds.diagonal();
            let n = round(2.0 * radius / spacing + 2.0 * block, 4.0 * block);
            (
                [n; 3],
                Some(Shape::Sphere {
                    center: bounds.center(),
                    radius,
                }),
            )
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
    let shift = [0, 1, 2].map(|k| {
        let spare = cells[k] - own[k] as i32;
        if outer == Outer::Grid && !touches {
            0
        } else {
            spare / 2
        }
    });
    let origin = if aligned || outer == Outer::Grid && !touches {
        bounds.min - geom_core::Vector3::from(shift.map(f64::from)) * spacing
    } else {
        let half = geom_core::Vector3::from(cells.map(f64::from)) * (0.5 * spacing);
        bounds.center() - half
    };
    Ok((Domain::new(origin, spacing, cells), shift, sphere))
}

/// The value in the middle of a split leaf.
pub(crate) fn centre_value(
    field: Option<&dyn ImplicitField>,
    bounds: Aabb,
) -> impl Fn(&Point3, f64) -> f64 + Sync + '_ {
    move |x, mean| match field {
        Some(field) if bounds.contains(x) => field.value(x),
        _ => mean,
    }
}

/// Counts of the complex for the report.
pub(crate) fn describe(
    report: &mut Report,
    samples: &Samples,
    complex: &Complex<'_>,
    duals: &Duals,
) {
    let leaves = &complex.tree.leaves;
    report.spacing = samples.domain.spacing;
    report.leaves = leaves.iter().filter(|l| !l.void).count();
    report.surface_cells = (0..leaves.len() as u32)
        .filter(|&id| complex.is_interface(id))
        .count();
    report.split_cells = complex.splits.len();
    report.held_back = duals.reduced;
}

impl Samples {
    /// Are there points on both sides of the level?
    pub(crate) fn crosses_level(&self) -> bool {
        let inside = |v: f32| f64::from(v) >= self.labels.level;
        inside(self.range.1) && !inside(self.range.0)
    }
}

pub(crate) fn probe<'a>(
    samples: &'a Samples,
    field: Option<&'a dyn ImplicitField>,
    options: &Options,
) -> Probe<'a> {
    Probe {
        samples,
        field,
        placement: options.placement,
    }
}

/// Corners of the molecule count as vertices where the box cuts it.
pub(crate) fn caps(boxed: bool, region: u8) -> bool {
    boxed && region == INTERIOR
}
