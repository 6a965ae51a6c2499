//! Density maps: MRC and OpenDX files of ours in mrcfile and GridDataFormats, and theirs in ours.

use geom_core::io::{grid, mrc};
use geom_core::{Lattice, LatticeValues, Point3, ScalarGrid};

use super::{Lab, number, text};
use crate::Outcome;

/// MRC and OpenDX: what others read in ours, and what we read in theirs.
pub(super) fn grids(lab: &mut Lab, density: &ScalarGrid) -> Outcome {
    // A plain lattice that f32 and a few digits can hold, and values of a molecule.
    let counts = density.lattice().counts;
    let lattice = Lattice {
        origin: Point3::new(-12.5, 7.25, 0.5),
        spacing: 0.75,
        counts,
    };
    let values = density.values().iter().map(|v| v.min(2.0)).collect();
    let ours = ScalarGrid::new(lattice, values).map_err(text)?;
    let (map, dx) = (lab.file("molecule.mrc"), lab.file("molecule.dx"));
    mrc::save(&map, &ours, mrc::Mode::Float32).map_err(text)?;
    grid::save(&dx, &ours).map_err(text)?;
    let paths = [&map, &dx, &lab.folder].map(|p| p.display().to_string());
    let theirs = lab.ask("grids.py", &paths)?;

    lab.same("molecule.mrc: valid", true, theirs["valid"] == true);
    // Weighted by place: exchanged axes leave a plain sum as it is.
    let weighted: f64 = (0..lattice.len())
        .map(|i| {
            let [x, y, z] = lattice.coordinates(i);
            f64::from(ours.at([x, y, z])) * (1 + x + 2 * y + 3 * z) as f64
        })
        .sum();
    // Frames pass through f32 (MRC) and printed digits (DX).
    for (file, prefix) in [("molecule.mrc", ""), ("molecule.dx", "dx ")] {
        for k in 0..3 {
            let axis = ["x", "y", "z"][k];
            let origin = theirs[format!("{prefix}origin")][k].as_f64();
            let spacing = theirs[format!("{prefix}spacing")][k].as_f64();
            let (Some(origin), Some(spacing)) = (origin, spacing) else {
                return Err(format!("a peer found no frame of {file}"));
            };
            lab.near(
                &format!("{file}: origin {axis}"),
                lattice.origin[k],
                origin,
                1e-6,
            );
            lab.near(
                &format!("{file}: spacing {axis}"),
                lattice.spacing,
                spacing,
                1e-6,
            );
        }
        let key = format!("{prefix}weighted");
        lab.near(
            &format!("{file}: Σ weighted values"),
            weighted,
            number(&theirs, &key)?,
            1e-12,
        );
    }
    // The mean stands in MRC's header, which others trust unread.
    let n = lattice.len() as f64;
    let mean = ours.values().iter().map(|&v| f64::from(v)).sum::<f64>() / n;
    lab.near("molecule.mrc: mean", mean, number(&theirs, "mean")?, 1e-6);

    // Their number types, packed and not: each must give the sum that they wrote.
    for file in theirs["written"].as_array().into_iter().flatten() {
        let name = file["name"].as_str().unwrap_or_default();
        let read = grid::read(lab.file(name)).map_err(text)?;
        let read = read.into_grid().map_err(text)?;
        let sum: f64 = read.values().iter().map(|&v| f64::from(v)).sum();
        lab.near(
            &format!("{name} of theirs: Σ values"),
            sum,
            number(file, "sum")?,
            1e-6,
        );
        // Headers hold f32.
        let placed = read.lattice().counts == counts
            && (read.lattice().origin - lattice.origin).norm() < 1e-4
            && (read.lattice().spacing - lattice.spacing).abs() < 1e-6;
        lab.same(&format!("{name} of theirs: the same lattice"), placed, true);
    }
    Ok(())
}
