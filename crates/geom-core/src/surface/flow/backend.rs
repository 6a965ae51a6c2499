//! The kernel of the flow: distortions of corners, wherever they are computed.

pub use crate::mesh::quality::CornerDistortion;

use crate::compute::{BackendError, parallel};
use crate::{Agreement, Backend, Cpu, Vector3};

/// Where the distortions of corners are computed.
pub trait CornerBackend: Backend + CornerObject {
    /// The distortion of each corner and its derivatives ([`CornerDistortion::of`]), in place of what was in `out`, whose memory is
    /// used again.
    ///
    /// # Errors
    /// Of the backend itself.
    fn corner_distortion(
        &self,
        corners: &[Corner],
        epsilon: f64,
        out: &mut Vec<CornerDistortion>,
    ) -> Result<(), BackendError>;
}

crate::backend_object!(CornerObject, as_corners -> CornerBackend);

/// A run on any of them.
pub type On<'a> = crate::Run<'a, dyn CornerBackend + 'a>;

/// A corner of a quad.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Corner {
    /// Its sides to the next corner and to the previous one, in units of their wanted lengths.
    pub sides: [Vector3; 2],
    /// Unit normal of the surface.
    pub normal: Vector3,
}

/// What a backend owes to [`CornerBackend::corner_distortion`], for energies, areas and derivatives over the energy: f32 with
/// differences taken before. The determinant of a nearly flat corner loses digits, which ε bounds: for ε ≥ 0.03.
pub const CORNER_DISTORTION: Agreement = Agreement::Bounded {
    relative: 1e-3,
    absolute: 1e-3,
};

impl CornerBackend for Cpu {
    /// In f64, one by one.
    fn corner_distortion(
        &self,
        corners: &[Corner],
        epsilon: f64,
        out: &mut Vec<CornerDistortion>,
    ) -> Result<(), BackendError> {
        out.resize(corners.len(), CornerDistortion::default());
        parallel::for_each(out, |c, out| {
            *out = CornerDistortion::of(&corners[c].sides, &corners[c].normal, epsilon);
        });
        Ok(())
    }
}
