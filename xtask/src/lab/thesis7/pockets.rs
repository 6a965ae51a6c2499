//! Pockets.
use crate::Outcome;
pub(super) fn run() -> Outcome {
    Ok(())
}
