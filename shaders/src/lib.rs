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

/// Lowest and highest value per block of `dual-contour`.
pub const DUAL_CONTOUR_MIN_MAX: Shader = Shader {
    name: "dual_contour_min_max",
    source: include_str!("../wgsl/dual_contour/min_max.wgsl"),
    workgroup: [64, 1, 1],
};

/// Corner signs of all finest cells of a block of `dual-contour`.
pub const DUAL_CONTOUR_CROSSINGS: Shader = Shader {
    name: "dual_contour_crossings",
    source: include_str!("../wgsl/dual_contour/crossings.wgsl"),
    workgroup: [128, 1, 1],
};

/// Dual vertices of cells of `dual-contour`.
pub const DUAL_CONTOUR_DUAL_VERTICES: Shader = Shader {
    name: "dual_contour_dual_vertices",
    source: include_str!("../wgsl/dual_contour/dual_vertices.wgsl"),
    workgroup: [64, 1, 1],
};

/// Every kernel.
pub const ALL: &[Shader] = &[
    DUAL_CONTOUR_MIN_MAX,
    DUAL_CONTOUR_CROSSINGS,
    DUAL_CONTOUR_DUAL_VERTICES,
];
