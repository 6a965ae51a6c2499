//! What each pass aims at: first the many, then the worst, at the end whatever it takes.

/// The first passes work on all tetrahedra below [`WANTED`], the later ones on those below the goals.
const BROAD: u32 = 3;
/// From this pass on, directions are random and surface vertices may use the allowed deviation.
pub(super) const RESCUE: u32 = 6;
/// From this pass on, nothing is spared for the last ones.
pub(super) const LAST: u32 = 8;
/// Angle that the first passes aim at, degrees: they raise the many, not only the worst.
const WANTED: f64 = 30.0;
/// Objectives down to which the first passes bring surface vertices to the isosurface.
/// From pass to pass they rise: what an early projection spoils, later passes mend; what a late one spoils stays.
const FLOORS: [f64; 5] = [0.05, 0.1, 0.2, 0.25, 0.3];

/// The same for what comes before the first pass.
pub(super) const ROUGH: f64 = FLOORS[0];

/// What a pass aims at.
pub(super) struct PassSettings {
    pub(super) number: u32,
    /// Tetrahedra below this are worked on.
    pub(super) bound: f64,
    /// Vertices of tetrahedra below this are smoothed.
    pub(super) smooth: f64,
    /// Are edges contracted?
    pub(super) contract: bool,
    /// Are operations judged together with the smoothing that they need?
    pub(super) with_smoothing: bool,
    /// Is all done that can be done?
    pub(super) last: bool,
    /// Random directions; surface vertices may leave the isosurface by the allowed deviation.
    pub(super) rescue: bool,
    /// Objective down to which vertices go back to the isosurface: first the shape, then the quality.
    pub(super) floor: f64,
}

/// The pass after one in which nothing changed: the first that may do more, because another like it would change nothing
/// either. `None` if there is none.
pub(super) fn bolder_than(number: u32) -> Option<u32> {
    [RESCUE, LAST].into_iter().find(|&bolder| bolder > number)
}

impl PassSettings {
    /// Of a pass, where `target` is the objective at which all goals are met.
    pub(super) fn of(number: u32, target: f64) -> Self {
        let broad = number < BROAD;
        let bound = if broad {
            target.max(WANTED.to_radians().sin())
        } else {
            target
        };
        Self {
            number,
            bound,
            // Somewhat above, so that what has just been reached gets a reserve.
            smooth: if broad { 1.1 * bound } else { 1.02 * bound },
            contract: number > 0,
            with_smoothing: !broad,
            rescue: number >= RESCUE,
            last: number >= LAST,
            floor: FLOORS
                .get(number as usize)
                .map_or(target, |f: &f64| f.min(target)),
        }
    }
}
