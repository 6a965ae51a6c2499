//! Maps that the found one could be mistaken for: those of a mirror image, and the found one followed by a map of the other
//! shape onto itself.
//!
//! A symmetric body matches itself in several ways, and a search finds one of them. If the found map is hardly better than a map that
//! is known to be another, nobody can say which is meant: the verdict is then doubtful, whatever the distance.

use geom_core::{Point3, Vector3};

use super::embed::Embedding;
use super::{ANOTHER, Tried, candidates, search};
use crate::Error;
use crate::backend::On;
use crate::fit::Side;
use crate::options::MatchOptions;
use crate::start::{Boundary, Candidate, distance};

/// Where a map of the mirror image scores less than this times the best one, the shapes are mirror images of each other. (No
/// right pair of proteins that was tried is taken for that.)
pub(super) const MIRRORED: f64 = 0.9;

/// J of the best map of the mirror image of `a`, after a short fit.
pub(super) fn of_mirror_image(
    a: &Boundary<'_>,
    b: &Boundary<'_>,
    options: &MatchOptions,
    run: On<'_>,
) -> Result<f64, Error> {
    let mut image = a.clone();
    let Side { points, normals } = &mut image.side;
    points.iter_mut().for_each(|p: &mut Point3| p.x = -p.x);
    normals.iter_mut().for_each(|n: &mut Vector3| n.x = -n.x);
    Ok(search(&image, b, options, run)?.least())
}

/// A map followed by maps of the second shape onto itself, other than the identity. Where the shape is nearly symmetric, one
/// of those may be right, though nothing led to it directly.
pub(super) fn composed(
    found: &Tried,
    b: &Boundary<'_>,
    options: &MatchOptions,
    run: On<'_>,
) -> Result<Vec<Candidate>, Error> {
    let rest = b.thinned().points;
    let onto_itself = candidates(b, b, options, run)?.into_iter();
    onto_itself
        .filter(|c| distance(&c.images, &rest) > ANOTHER)
        .map(|c| {
            let embedding = Embedding::new(&rest, &c.images, &[])?;
            Ok(Candidate {
                name: format!("{}, and onto itself by {}", found.name, c.name),
                images: embedding.of(&found.images),
                score: c.score,
            })
        })
        .collect()
}
