//! From values and options to samples: where the mesh lies, what it may cost, and why there is none.
//!
//! What can go wrong is found here, before anything large is allocated: values on one side only (and why: the level, the groups that
//! were given away, or cells too coarse to see the body), a surface that meets the box, more cells than coordinates can name, more
//! memory than is granted. Each is an error that says what would help.

use geom_core::compute::parallel;
use geom_core::options::{OutOfRange, require};
use geom_core::{ImplicitField, Lattice, LatticeValues};

use super::report::Report;
use crate::backend::On;
use crate::octree::{BLOCK, Domain, Labels, Samples, Source};
use crate::{AtBox, Error, Extent, Options, Outer, Resolution, Shape};

/// Most finest cells per axis that a leaf's coordinates can name.
const MOST_CELLS: f64 = 65_000.0;

/// What a mesh is for.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum Purpose {
    Surface,
    Volume(Extent),
}

/// Values and labels as options and purpose ask for, and what has been counted.
///
/// # Errors
/// In this order: options out of range; a lattice without cells; too many cells, or too little memory for their blocks;
/// a surface that meets the box, where that is refused; an outer box or sphere where it is clipped; values that are not
/// finite; too little memory for what is near the surface; groups to prune that are too large; all on one side.
pub(crate) fn sampled<'a, V: LatticeValues + ?Sized>(
    values: &'a V,
    field: Option<&'a dyn ImplicitField>,
    options: &Options,
    purpose: Purpose,
    run: On<'_>,
) -> Result<(Samples<'a>, Report), Error> {
    options.check()?;
    let lattice = values.lattice();
    let spacing = lattice.spacing;
    let makes_sense = spacing > 0.0 && spacing.is_finite();
    let must = "be positive and finite; it is the lattice's, Å";
    require(makes_sense, "spacing", spacing, must)?;
    if lattice.counts.iter().any(|&n| n < 2) {
        return Err(Error::NoCells {
            counts: lattice.counts,
        });
    }
    // Values of the lattice itself are read; another spacing asks the field or interpolates.
    let spacing = match options.resolution {
        Resolution::Spacing(h) => h,
        Resolution::Lattice => lattice.spacing,
        Resolution::Tets(_) => unreachable!("resolved into a spacing before"),
    };
    check_size(own_cells(lattice, spacing, options.at_box), options)?;
    run.progress("sample", 0, 1)?;
    // A surface that would be cut off is refused before anything is read in full.
    let touching = touching(values, options.level, [[true; 2]; 3]);
    if let (AtBox::Refuse, Some((side, points))) = (options.at_box, touching) {
        return Err(Error::SurfaceTouchesBox { side, points });
    }
    let site = site(lattice, spacing, options, purpose, touching.is_some())?;
    let labels = Labels {
        level: options.level,
        materials: options.materials.clone(),
        outer: site.outer,
    };
    let outside = below(options.level);
    let source = if spacing == lattice.spacing {
        Source::Aligned {
            values,
            shift: site.shift,
            outside,
        }
    } else {
        Source::Resampled {
            values,
            field,
            outside,
        }
    };
    let mut report = Report {
        spacing,
        ..Report::default()
    };
    let mut samples = Samples::new(source, site.domain, labels, options.max_memory)?;
    if options.prune > 0 {
        let points: u64 = site.domain.cells.iter().map(|&n| n as u64 + 1).product();
        if u64::from(options.prune) > points {
            let must = format!("be at most {points}, all points there are");
            return Err(OutOfRange::new("prune", options.prune, must).into());
        }
        let pruned = samples.prune(options.prune, options.max_memory)?;
        (report.pruned_groups, report.pruned_points) = (pruned.groups, pruned.points);
    }
    if !samples.holds_both_sides() {
        return Err(no_surface(values, options, samples.range, spacing));
    }
    // Values stay as they are from here on, so signs can be kept.
    samples.find_crossings();
    Ok((samples, report))
}

/// Below the level by more than rounding can take away: what stands beyond the values.
pub(super) fn below(level: f64) -> f32 {
    (level - level.abs() - 1.0) as f32
}

/// Why all is on one side: the values, the small groups that were given away, or cells that see too little.
/// All values are read once more for it: an error may take its time, and names the range of all.
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
        let must = format!("leave a group on either side of level {level}; all of one are smaller");
        OutOfRange::new("prune", format!("{} points", options.prune), must).into()
    } else {
        let must = format!("be smaller to see a value on either side of level {level}");
        OutOfRange::new("resolution", format!("{spacing} Å"), must).into()
    }
}

/// The first of some sides of the lattice with points inside, and how many.
/// Sides are counted as in [`Error::SurfaceTouchesBox`]; only the six faces are read, row by row.
pub(super) fn touching<V: LatticeValues + ?Sized>(
    values: &V,
    level: f64,
    sides: [[bool; 2]; 3],
) -> Option<(usize, u64)> {
    let [nx, ny, nz] = values.lattice().counts;
    (0..6)
        .filter(|side| sides[side / 2][side % 2])
        .find_map(|side| {
            let (axis, high) = (side / 2, side % 2 == 1);
            // Rows along x in the face; the faces across x have one point of each.
            let (rows, start, len) = match axis {
                0 => (ny * nz, if high { nx - 1 } else { 0 }, 1),
                1 => (nz, 0, nx),
                _ => (ny, 0, nx),
            };
            let of_rows = parallel::map_init(
                rows,
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
            );
            let points: u64 = of_rows.iter().sum();
            (points > 0).then_some((side, points))
        })
}

/// Where a mesh lies.
/// Which finest cells there are, and how they lie to the values.
pub(super) struct Site {
    pub(super) domain: Domain,
    /// The point of the mesh lattice where that of the values begins, if both have one spacing.
    pub(super) shift: [i32; 3],
    /// The sphere where the mesh ends.
    pub(super) outer: Option<Shape>,
}

/// The mesh lattice around that of the values; `touches` says whether the surface meets the box of the values.
///
/// # Errors
/// An outer box or sphere where the surface is clipped; more cells than coordinates can name; too little memory for
/// their blocks.
pub(super) fn site(
    lattice: &Lattice,
    spacing: f64,
    options: &Options,
    purpose: Purpose,
    touches: bool,
) -> Result<Site, Error> {
    let bounds = lattice.bounds();
    let exterior = matches!(purpose, Purpose::Volume(Extent::Exterior | Extent::Both));
    let clip = options.at_box == AtBox::Clip;
    let outer = if exterior { options.outer } else { Outer::Grid };
    if clip && outer != Outer::Grid {
        let must =
            "be Outer::Grid where the surface is clipped, since the mesh ends there; or cap it";
        return Err(OutOfRange::new("outer", format!("{outer:?}"), must).into());
    }
    let own = own_cells(lattice, spacing, options.at_box);
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
    check_size(cells, options)?;
    let cells = cells.map(|n| n as i32);
    // In the middle of a larger box, by whole blocks.
    let shift = match outer {
        Outer::Grid => [pad as i32; 3],
        _ => [0, 1, 2].map(|k| {
            let half = (cells[k] - own[k] as i32) / 2;
            (half / BLOCK * BLOCK).max(pad as i32)
        }),
    };
    Ok(Site {
        domain: Domain::new(bounds.min, spacing, cells, shift),
        shift,
        outer: sphere,
    })
}

/// Cells along the box of the values, rounded so that a clipped mesh stays within it.
/// As f64, since a small spacing gives more than an integer holds.
fn own_cells(lattice: &Lattice, spacing: f64, at_box: AtBox) -> [f64; 3] {
    let extent = lattice.bounds().extent();
    [0, 1, 2].map(|k| {
        let n = extent[k] / spacing;
        if spacing == lattice.spacing {
            lattice.counts[k] as f64 - 1.0
        } else if at_box == AtBox::Clip {
            (n + 1e-9).floor().max(1.0)
        } else {
            (n - 1e-9).ceil().max(1.0)
        }
    })
}

/// Refuses lattices whose cells have no coordinates, or whose blocks alone need too much memory.
pub(super) fn check_size(cells: [f64; 3], options: &Options) -> Result<(), Error> {
    if cells.iter().any(|&n| n > MOST_CELLS) {
        let most = cells.iter().fold(0.0f64, |m, &n| m.max(n));
        let must = format!("give at most {MOST_CELLS}; take a larger spacing");
        let value = format!("{most} cells along an axis");
        // Cells that an outer box adds are no word on the cells of the surface.
        let option = match options.outer {
            Outer::Grid => "resolution",
            _ => "outer",
        };
        return Err(OutOfRange::new(option, value, must).into());
    }
    let block = f64::from(BLOCK);
    let blocks: u128 = cells.iter().map(|&n| (n / block).ceil() as u128).product();
    // Per block a node, marks of points, and requests; blocks that are stored count while they are read.
    let bytes = blocks * 120;
    if bytes > u128::from(options.max_memory) {
        return Err(refused("the octree", bytes, options.max_memory));
    }
    Ok(())
}

/// The error of what would need more memory than is allowed.
pub(super) fn refused(what: &'static str, bytes: impl Into<u128>, limit: u64) -> Error {
    Error::TooLarge {
        what,
        bytes: bytes.into(),
        limit: limit.into(),
        cure: "take a larger spacing or a smaller outer box, or allow more memory",
    }
}
