//! The spacing that gives a number of tetrahedra.
//!
//! A secant search on the logarithms: the number goes as a power of 1/spacing, 2 where nearly all elements are at the
//! surface and 3 where cells have one size, and the power is learnt on the way. The meshes of the search are made for
//! their number alone.

use geom_core::options::OutOfRange;
use geom_core::{ImplicitField, LatticeValues};

use super::contour;
use super::setup::Purpose;
use crate::backend::On;
use crate::{Error, Options, Resolution};

/// Meshes that the search may make.
const ROUNDS: u64 = 12;

/// Options whose resolution is no number of tetrahedra: the spacing that gives about as many as asked
/// for, found by meshing at growing fineness.
pub(crate) fn resolved<V: LatticeValues + ?Sized>(
    values: &V,
    field: Option<&dyn ImplicitField>,
    options: &Options,
    run: On<'_>,
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
    for round in 0..ROUNDS {
        run.progress("resolution", round, ROUNDS)?;
        let count = match contour(values, field, &at(h), Purpose::Volume(options.region), run) {
            Ok(mesh) => mesh.report.tets as f64,
            Err(error) if h > 0.5 * own && sees_nothing(&error) => 0.0,
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
        // The secant through the last two counts, as powers of the spacing.
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
        _ => Err(Error::from(OutOfRange::new(
            "resolution",
            format!("{wanted} tetrahedra"),
            format!(
                "be a number that some spacing gives; give a spacing instead{}",
                best.map_or(String::new(), |(h, _)| format!(", e.g. {h:.3} Å"))
            ),
        ))),
    }
}

/// Were the cells too coarse to see a surface?
/// Then the search goes on with finer ones, unless these are already half of the lattice's own.
fn sees_nothing(error: &Error) -> bool {
    matches!(
        error,
        Error::NoSurface { .. }
            | Error::Option(OutOfRange {
                option: "resolution" | "prune",
                ..
            })
    )
}
