//! Many copies of one model, held as one: capsids.

use geom_core::compute::parallel;
use geom_core::structure::Transform;
use geom_core::{Aabb, Lattice, Point3};

use crate::error::Error;
use crate::kernel::prepared::Prepared;
use crate::model::reach::Reach;
use crate::model::{Level, Model};
use crate::options::Options;

/// A model and where its copies stand. Nothing is copied until a part is asked for, so that an assembly of 10⁸ atoms
/// takes no more memory than one of its units.
///
/// ```
/// use gauss_density::geom_core::structure::Transform;
/// use gauss_density::geom_core::{Aabb, Point3, Vector3};
/// use gauss_density::{Copies, Cutoff, Model};
/// # fn main() -> Result<(), gauss_density::Error> {
/// let unit = Model::new(vec![Point3::origin()], vec![1.7], vec![1.0], vec![])?;
/// let moved = |x| Transform { translation: Vector3::new(x, 0.0, 0.0), ..Transform::identity() };
/// let copies = Copies::new(&unit, vec![moved(0.0), moved(100.0)])?;
/// assert_eq!(copies.atoms(), 2);
/// assert_eq!(copies.center_bounds().extent(), Vector3::new(100.0, 0.0, 0.0));
/// // The first copy does not matter around the second.
/// let region = Aabb::new(Point3::new(98.0, -2.0, -2.0), Point3::new(102.0, 2.0, 2.0));
/// let part = copies.part(&region, Cutoff::default())?.expect("an atom is there");
/// assert_eq!(part.atoms(), 1);
/// # Ok(())
/// # }
/// ```
#[derive(Clone, Debug)]
pub struct Copies {
    /// Its levels are only those that matter.
    unit: Model,
    places: Vec<Transform>,
    reach: Reach,
    /// Around the centres of the unit.
    bounds: Aabb,
}

impl Copies {
    /// Copies of a model at some places, at least one; each copy has nodes of its own.
    ///
    /// The order of the copies is that of `places`, and that of the atoms within one is the unit's: sums have the bits
    /// that one model of all atoms in this order would give. What [`Model::protect`] says is of no meaning here.
    ///
    /// # Errors
    /// [`Error::NoAtoms`] without a place.
    pub fn new(unit: &Model, places: Vec<Transform>) -> Result<Self, Error> {
        if places.is_empty() {
            return Err(Error::NoAtoms);
        }
        let unit = unit.compiled();
        let levels = unit.levels();
        let reach = Reach::new(&unit, levels).of_copies(&unit, levels, places.len());
        let bounds = unit.center_bounds();
        Ok(Self {
            unit,
            places,
            reach,
            bounds,
        })
    }

    /// Number of atoms of all copies.
    pub fn atoms(&self) -> u64 {
        self.unit.atoms() as u64 * self.places.len() as u64
    }

    /// Calls `f` with the centre of every atom, copy after copy.
    ///
    /// For what needs to see all atoms once and must not hold them: the counts by which tiles are made equally heavy,
    /// for one.
    pub fn for_each_center(&self, mut f: impl FnMut(&Point3)) {
        for place in &self.places {
            self.unit
                .centers()
                .iter()
                .for_each(|center| f(&place.apply(center)));
        }
    }

    /// The smallest box that holds the centres of all atoms.
    /// Goes over all atoms of all copies, side by side; a box that is turned with its copy would be too large.
    pub fn center_bounds(&self) -> Aabb {
        let boxes: Vec<Aabb> = parallel::map_each(&self.places, |place| {
            let moved = self.unit.centers().iter().map(|c| place.apply(c));
            moved.fold(Aabb::EMPTY, |mut all, x| {
                all.include(x);
                all
            })
        });
        boxes.iter().fold(Aabb::EMPTY, |mut all, own| {
            all.include(own.min);
            all.include(own.max);
            all
        })
    }

    /// The lattice that the options ask for: that on which [`sample_band`](crate::sample_band) samples all copies.
    ///
    /// # Errors
    /// An option out of range, and [`Error::GridTooLarge`] if an axis has more than 2³² − 1 points. Memory is not
    /// looked at: the lattice is only named here.
    pub fn lattice(&self, options: &Options) -> Result<Lattice, Error> {
        options.check()?;
        crate::sample::blocks::lattice_around(&self.reach, || self.center_bounds(), options)
    }

    /// The atoms within `reach` of a box, with the nodes above them, in the order of the whole; `None` if there are
    /// none.
    pub(crate) fn near(&self, region: &Aabb, reach: f64) -> Option<Model> {
        // A hair more, so that rounding leaves none out; those that do not matter are sorted out later.
        let squared = reach * reach * (1.0 + 1e-9) + 1e-9;
        let parts: Vec<(usize, Model)> = parallel::flat_map(self.places.len(), |i| {
            let place = &self.places[i];
            let middle = place.apply(&self.bounds.center());
            // Of any affine map: how far the corners of the box go.
            let half = place.rotation.abs() * self.bounds.extent() * 0.5;
            let around = Aabb::new(middle - half, middle + half);
            if crate::kernel::boxes::gap_squared(&around, region) > squared * (1.0 + 1e-6) {
                return None;
            }
            let is_near = |a: &u32| {
                let center = place.apply(&self.unit.centers()[*a as usize]);
                region.distance_squared(&center) <= squared
            };
            let atoms: Vec<u32> = (0..self.unit.atoms() as u32).filter(is_near).collect();
            (!atoms.is_empty()).then(|| (i, self.unit.subset(&atoms)))
        });
        let mut all = self.unit.emptied();
        for (place, part) in parts {
            all.append(&part, |center| self.places[place].apply(center));
        }
        (all.atoms() > 0).then_some(all)
    }

    pub(crate) fn reach(&self) -> &Reach {
        &self.reach
    }

    /// A part made ready, as the whole would be.
    pub(crate) fn prepared<'a>(&self, part: &'a Model) -> Prepared<'a> {
        let levels: Vec<Level> = part.levels().to_vec();
        Prepared::of_part(part, levels, self.reach.clone())
    }
}
