//! Where kernels run: the place that was asked for.

#[cfg(feature = "analysis")]
use crossfield::CrossfieldBackend;
use dual_contour::ContourBackend;
use gauss_density::DensityBackend;
#[cfg(feature = "wgpu")]
use geom_core::Wgpu;
#[cfg(feature = "analysis")]
use geom_core::algebra::eigen::SpectralBackend;
use geom_core::compute::usage::Usage;
use geom_core::{Backend, Cpu};
#[cfg(feature = "analysis")]
use secondfund_ops::OperatorBackend;
#[cfg(feature = "analysis")]
use spectral_corresp::CorrespBackend;
use tet_quality::QualityBackend;
#[cfg(feature = "analysis")]
use tspline::SplineBackend;

use crate::Failure;
use crate::args::BackendName;

/// A place where kernels run.
pub enum Device {
    /// The CPU.
    Cpu(Cpu),
    /// A GPU.
    #[cfg(feature = "wgpu")]
    Wgpu(Wgpu),
}

/// Something that all places do, each in its own way.
macro_rules! on {
    ($device:expr, $place:ident => $does:expr) => {
        match $device {
            Device::Cpu($place) => $does,
            #[cfg(feature = "wgpu")]
            Device::Wgpu($place) => $does,
        }
    };
}

impl Device {
    pub(crate) fn open(name: BackendName) -> Result<Self, Failure> {
        Ok(match name {
            BackendName::Cpu => Self::Cpu(Cpu),
            BackendName::Wgpu => Self::adapter()?,
            BackendName::Auto => match Self::adapter() {
                Ok(device) if device.is_hardware() => device,
                _ => Self::Cpu(Cpu),
            },
        })
    }

    /// A GPU, or what poses as one.
    #[cfg(feature = "wgpu")]
    pub(crate) fn adapter() -> Result<Self, Failure> {
        Ok(Self::Wgpu(Wgpu::new()?))
    }

    /// None in this build.
    #[cfg(not(feature = "wgpu"))]
    pub(crate) fn adapter() -> Result<Self, Failure> {
        Err(left_out("GPU", "wgpu"))
    }

    /// For densities.
    pub fn density(&self) -> &dyn DensityBackend {
        on!(self, place => place)
    }

    /// For meshing.
    pub fn contour(&self) -> &dyn ContourBackend {
        on!(self, place => place)
    }

    /// For improvement.
    pub fn quality(&self) -> &dyn QualityBackend {
        on!(self, place => place)
    }

    /// Its name for reports.
    pub fn name(&self) -> String {
        on!(self, place => place.name())
    }

    /// The kernels that ran on it so far; none on the CPU, which counts nothing.
    pub(crate) fn usage(&self) -> Usage {
        match self {
            Self::Cpu(_) => Usage::default(),
            #[cfg(feature = "wgpu")]
            Self::Wgpu(gpu) => gpu.gpu().usage(),
        }
    }

    /// Is it a GPU, or what poses as one?
    pub fn is_gpu(&self) -> bool {
        !matches!(self, Self::Cpu(_))
    }

    /// Is it a GPU in hardware?
    pub(crate) fn is_hardware(&self) -> bool {
        match self {
            Self::Cpu(_) => false,
            #[cfg(feature = "wgpu")]
            Self::Wgpu(gpu) => !gpu.gpu().is_software(),
        }
    }
}

/// For what follows from a surface.
#[cfg(feature = "analysis")]
impl Device {
    /// For eigenfunctions.
    pub fn spectral(&self) -> &dyn SpectralBackend {
        on!(self, place => place)
    }

    /// For quads.
    pub fn crossfield(&self) -> &dyn CrossfieldBackend {
        on!(self, place => place)
    }

    /// For operators of the second fundamental form.
    pub fn operators(&self) -> &dyn OperatorBackend {
        on!(self, place => place)
    }

    /// For correspondences.
    pub fn corresp(&self) -> &dyn CorrespBackend {
        on!(self, place => place)
    }

    /// For T-meshes and splines.
    pub fn spline(&self) -> &dyn SplineBackend {
        on!(self, place => place)
    }
}

/// What a program says that was built without a feature and is asked for what is in it.
pub fn left_out(what: &str, feature: &str) -> Failure {
    format!("this build has no {what} (feature {feature}): `cargo run --example` builds all, `cargo pipeline` leaves this out")
        .into()
}
