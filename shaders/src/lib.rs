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

// ── dual-contour

/// `dual-contour`: lowest and highest value per block.
pub const DUAL_CONTOUR_MIN_MAX: Shader = Shader {
    name: "dual_contour_min_max",
    source: include_str!("../wgsl/dual_contour/min_max.wgsl"),
    workgroup: [64, 1, 1],
};

/// `dual-contour`: corner signs of all finest cells of a block.
pub const DUAL_CONTOUR_CROSSINGS: Shader = Shader {
    name: "dual_contour_crossings",
    source: include_str!("../wgsl/dual_contour/crossings.wgsl"),
    workgroup: [128, 1, 1],
};

/// `dual-contour`: dual vertices of cells.
pub const DUAL_CONTOUR_DUAL_VERTICES: Shader = Shader {
    name: "dual_contour_dual_vertices",
    source: include_str!("../wgsl/dual_contour/dual_vertices.wgsl"),
    workgroup: [64, 1, 1],
};

// ── tet-quality

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
    DUAL_CONTOUR_MIN_MAX,
    DUAL_CONTOUR_CROSSINGS,
    DUAL_CONTOUR_DUAL_VERTICES,
    TET_QUALITY_MEASURE,
    TET_QUALITY_RELAX,
];
