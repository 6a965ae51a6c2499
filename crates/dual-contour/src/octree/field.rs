//! A field as values on a lattice.

use geom_core::{Aabb, ImplicitField, Lattice, LatticeValues};

/// The values of a field at the points of a lattice, evaluated when they are asked for: a mesh of a
/// field that nobody has sampled. Where a density grid exists, pass that instead: its values are
/// read, not computed.
///
/// ```
/// use dual_contour::FieldSamples;
/// use dual_contour::geom_core::{Aabb, ImplicitField, LatticeValues, Point3, Vector3};
/// struct Slope;
/// impl ImplicitField for Slope {
///     fn value(&self, x: &Point3) -> f64 {
///         x.z
///     }
///     fn value_gradient(&self, x: &Point3) -> (f64, Vector3) {
///         (x.z, Vector3::z())
///     }
/// }
/// let bounds = Aabb::new(Point3::origin(), Point3::new(2.0, 2.0, 2.0));
/// let samples = FieldSamples::new(&Slope, &bounds, 0.5);
/// assert_eq!(samples.lattice().counts, [5, 5, 5]);
/// assert_eq!(samples.at([0, 0, 3]), 1.5);
/// ```
#[derive(Clone, Copy)]
pub struct FieldSamples<'a> {
    field: &'a dyn ImplicitField,
    lattice: Lattice,
}

impl<'a> FieldSamples<'a> {
    /// A lattice with this spacing (Å) that covers the box.
    ///
    /// The box counts as the sampled one: what the field does beyond it is not seen, and a surface that crosses it
    /// meets the box. The mesher asks for some points more than once, so a field that is expensive is better sampled
    /// first (`gauss_density::sample_band`). A spacing that makes no sense is refused by the verbs.
    pub fn new(field: &'a dyn ImplicitField, bounds: &Aabb, spacing: f64) -> Self {
        Self {
            field,
            lattice: Lattice::covering(bounds, spacing),
        }
    }
}

impl LatticeValues for FieldSamples<'_> {
    fn lattice(&self) -> &Lattice {
        &self.lattice
    }
    fn at(&self, point: [usize; 3]) -> f32 {
        self.field.value(&self.lattice.point(point)) as f32
    }
}
