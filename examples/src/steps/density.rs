//! A density map and slices through it.

use geom_core::{LatticeValues, ScalarGrid, io};

use crate::picture::{ColorMap, Scale, sheet, slice};
use crate::{Failure, Session};

/// Writes `density.mrc`, `slices.png`, and `density.dx` if asked.
pub fn save(session: &Session, grid: &ScalarGrid, dx: bool) -> Result<(), Failure> {
    io::grid::save(session.output("density.mrc")?, grid)?;
    if dx {
        io::grid::save(session.output("density.dx")?, grid)?;
    }
    session.picture("slices", || {
        let scale = Scale::new(ColorMap::Viridis, [0.0, 2.0], "density G");
        let pictures: Vec<_> = [("along x", 0), ("along y", 1), ("along z", 2)]
            .map(|(title, axis)| {
                let picture = slice(grid, grid.lattice(), axis, 0.5, 1.0, &scale, 620);
                (title.to_owned(), picture)
            })
            .into();
        Ok(sheet(&pictures, 3))
    })
}
