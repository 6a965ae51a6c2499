#![doc = include_str!("../README.md")]

/// A compute kernel: WGSL with one entry point `main`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shader {
    /// Unique name, `<crate>_<kernel>`.
    pub name: &'static str,
    /// WGSL source.
    pub source: &'static str,
    /// Threads per workgroup, as in the source; at most 256 in all, which every device grants.
    pub workgroup: [u32; 3],
}

/// `geom-core`: sparse matrix times a block of vectors.
pub const GEOM_CORE_PRODUCT: Shader = Shader {
    name: "geom_core_product",
    source: include_str!("../wgsl/geom_core/product.wgsl"),
    workgroup: [64, 1, 1],
};
/// `geom-core`: a step of Chebyshev smoothing.
pub const GEOM_CORE_SMOOTH: Shader = Shader {
    name: "geom_core_smooth",
    source: include_str!("../wgsl/geom_core/smooth.wgsl"),
    workgroup: [64, 1, 1],
};
/// `geom-core`: weights of a voxel graph times a block of vectors.
pub const GEOM_CORE_STENCIL: Shader = Shader {
    name: "geom_core_stencil",
    source: include_str!("../wgsl/geom_core/stencil.wgsl"),
    workgroup: [64, 1, 1],
};
/// `tet-quality`: measures of tetrahedra.
pub const TET_QUALITY_MEASURE: Shader = Shader {
    name: "tet_quality_measure",
    source: include_str!("../wgsl/tet_quality/measure.wgsl"),
    workgroup: [64, 1, 1],
};
/// `tet-quality`: a sweep of smoothing over the vertices of a colour.
pub const TET_QUALITY_RELAX: Shader = Shader {
    name: "tet_quality_relax",
    source: include_str!("../wgsl/tet_quality/relax.wgsl"),
    workgroup: [64, 1, 1],
};

/// Every kernel.
pub const ALL: &[Shader] = &[
    GEOM_CORE_PRODUCT,
    GEOM_CORE_SMOOTH,
    GEOM_CORE_STENCIL,
    TET_QUALITY_MEASURE,
    TET_QUALITY_RELAX,
];
