//! Parts of a body: what segmentations by several operators and numbers of groups agree on.

use geom_core::Run;

use super::clean::{clean, join_blurred};
use super::consensus::consensus;
use super::embed::Rows;
use super::faces::Faces;
use super::run::{GroupChoice, Search, areas_of, check_vertices, label_faces, sought};
use crate::backend::{On, OperatorBackend};
use crate::operators::{Element, Spectrum, spectrum};
use crate::options::{LEAST_MODES, MOST_MODES, PartOptions, SEARCH_MODES};
use crate::{Error, SpectrumOptions};

/// Parts of a body.
#[derive(Clone, Debug)]
pub struct Parts {
    /// The part of each face, from 0 by decreasing area.
    pub labels: Vec<u32>,
    /// The area of each part, in the unit of the faces.
    pub areas: Vec<f64>,
    /// The number of groups with the best silhouette.
    pub sought: usize,
    /// The numbers of groups that each operator's modes were cut into.
    pub numbers: Vec<usize>,
    /// The numbers that were tried.
    pub choices: Vec<GroupChoice>,
    /// The modes of each operator.
    pub spectra: Vec<Spectrum>,
}

/// Numbers whose silhouette is at least this share of the largest are as good; the smallest is taken.
const NEARLY: f64 = 0.98;

/// The parts of a body: the modes of each operator are cut into the sought number of groups, one less and one more
/// (those around a wanted number, too), and the [`consensus`] of all is cut into connected parts with straight borders.
/// Neighbours that the operators do not tell apart, and between which there is no neck, are one part.
///
/// Triangles are best given [`Normals::without_detail`](crate::Normals::without_detail): curls of hair are no parts then.
///
/// # Errors
/// Those of [`spectrum`](crate::spectrum()) and [`segment`](crate::segment()).
///
/// ```
/// use secondfund_ops::geom_core::{Cpu, Run, io::mesh};
/// use secondfund_ops::{Element, Faces, Normals, PartOptions, segment};
///
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// let mesh::AnyMesh::Tri(surface) = mesh::read(fixtures::path("spot.ply"))?.mesh else {
///     unreachable!("spot is made of triangles");
/// };
/// let normals = Normals::without_detail(&surface, 3, Normals::DETAIL)?;
/// let element = Element::Triangles(&surface, &normals);
/// let asked = PartOptions::default();
/// let found = segment::parts(&element, &Faces::from(&surface), &asked, Run::on(&Cpu))?;
/// assert_eq!(found.labels.len(), surface.triangles().len());
/// assert!(found.areas.len() >= 2);
/// # Ok(())
/// # }
/// ```
pub fn parts<B: OperatorBackend + ?Sized>(
    element: &Element<'_>,
    faces: &Faces,
    options: &PartOptions,
    run: Run<'_, B>,
) -> Result<Parts, Error> {
    parts_on(
        element,
        faces,
        options,
        run.with(run.backend.as_operators()),
    )
}

fn parts_on(
    element: &Element<'_>,
    faces: &Faces,
    options: &PartOptions,
    run: On<'_>,
) -> Result<Parts, Error> {
    options.check()?;
    let spectra = options
        .operators
        .iter()
        .map(|operator| {
            let asked = SpectrumOptions {
                operator: operator.clone(),
                modes: MOST_MODES,
                regularization: options.regularization,
                ..SpectrumOptions::default()
            };
            spectrum(element, &asked, run)
        })
        .collect::<Result<Vec<_>, _>>()?;
    check_vertices(&spectra[0], faces)?;
    let search = searching(&spectra[0], SEARCH_MODES, options, run)?;
    let choices = search.choices(options.most, run)?;
    let sought = sought(&choices, NEARLY);
    let numbers = numbers(sought, options.groups);
    let mut labelings = Vec::with_capacity(spectra.len() * numbers.len());
    for modes in &spectra {
        for &groups in &numbers {
            run.progress(
                "segmentations",
                labelings.len() as u64,
                labelings.capacity() as u64,
            )?;
            let search = searching(modes, groups.clamp(LEAST_MODES, MOST_MODES), options, run)?;
            labelings.push(label_faces(faces, &search.rows, &search.medoids(groups)));
        }
    }
    let common = consensus(faces, &labelings)?;
    let labels = clean(faces, &common, spectra[0].scale, options.smooth)?;
    // As many parts as modes and one more can lie apart.
    let count = areas_of(faces, &labels).len().saturating_sub(1);
    let count = count.clamp(SEARCH_MODES, MOST_MODES);
    let rows: Vec<Rows> = spectra.iter().map(|modes| Rows::of(modes, count)).collect();
    let labels = join_blurred(faces, &rows, &labels);
    Ok(Parts {
        areas: areas_of(faces, &labels),
        labels,
        sought,
        numbers,
        choices,
        spectra,
    })
}

/// A search on as many modes as wanted, or as there are.
fn searching<'a>(
    spectrum: &'a Spectrum,
    modes: usize,
    options: &PartOptions,
    run: On<'_>,
) -> Result<Search<'a>, Error> {
    Search::of(
        spectrum,
        modes.min(spectrum.values.len()),
        options.segments(),
        run,
    )
}

/// The numbers around the sought one and around the wanted one. A sought number above the wanted one counts as it.
fn numbers(sought: usize, wanted: Option<usize>) -> Vec<usize> {
    let middle = wanted.map_or(sought, |w| w.min(sought));
    let mut numbers: Vec<usize> = [Some(middle), wanted]
        .into_iter()
        .flatten()
        .flat_map(|k| k.saturating_sub(1).max(2)..=k + 1)
        .collect();
    numbers.sort_unstable();
    numbers.dedup();
    numbers
}
