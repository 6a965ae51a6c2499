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

/// The source of a kernel: WGSL has no includes, so what several share is put before it.
macro_rules! joined {
    ($($file:literal),+) => {
        concat!($(include_str!(concat!("../wgsl/", $file, ".wgsl")), "\n"),+)
    };
}

// ── geom-core

/// `geom-core`: sparse matrix times a block of vectors.
pub const GEOM_CORE_PRODUCT: Shader = Shader {
    name: "geom_core_product",
    source: joined!("geom_core/product"),
    workgroup: [64, 1, 1],
};

/// `geom-core`: a step of Chebyshev smoothing.
pub const GEOM_CORE_SMOOTH: Shader = Shader {
    name: "geom_core_smooth",
    source: joined!("geom_core/smooth"),
    workgroup: [64, 1, 1],
};

/// `geom-core`: weights of a voxel graph times a block of vectors.
pub const GEOM_CORE_STENCIL: Shader = Shader {
    name: "geom_core_stencil",
    source: joined!("geom_core/stencil"),
    workgroup: [64, 1, 1],
};

/// `geom-core`: distortion of the corners of quads.
pub const GEOM_CORE_CORNER_DISTORTION: Shader = Shader {
    name: "geom_core_corner_distortion",
    source: joined!("geom_core/corner_distortion"),
    workgroup: [64, 1, 1],
};

// ── dual-contour

/// `dual-contour`: dual vertices of cells.
pub const DUAL_CONTOUR_DUAL_VERTICES: Shader = Shader {
    name: "dual_contour_dual_vertices",
    source: joined!("dual_contour/dual_vertices"),
    workgroup: [64, 1, 1],
};

// ── gauss-density

/// `gauss-density`: which atoms matter in a brick.
pub const GAUSS_DENSITY_CULL: Shader = Shader {
    name: "gauss_density_cull",
    source: joined!("common/item", "common/tree", "gauss_density/cull"),
    workgroup: [64, 1, 1],
};

/// `gauss-density`: the density at the points of bricks.
pub const GAUSS_DENSITY_DENSITY: Shader = Shader {
    name: "gauss_density_density",
    source: joined!("common/item", "common/tree", "gauss_density/density"),
    workgroup: [8, 8, 4],
};

/// `gauss-density`: the values of chosen bricks.
pub const GAUSS_DENSITY_COMPACT: Shader = Shader {
    name: "gauss_density_compact",
    source: joined!("gauss_density/compact"),
    workgroup: [256, 1, 1],
};

/// `gauss-density`: the terms of the tree at points.
pub const GAUSS_DENSITY_TERMS: Shader = Shader {
    name: "gauss_density_terms",
    source: joined!(
        "common/item",
        "common/tree",
        "common/params",
        "common/sites",
        "gauss_density/terms"
    ),
    workgroup: [64, 1, 1],
};

/// `gauss-density`: squared changes of the density without each atom.
pub const GAUSS_DENSITY_ATOM_ERRORS: Shader = Shader {
    name: "gauss_density_atom_errors",
    source: joined!(
        "common/item",
        "common/tree",
        "common/params",
        "common/sites",
        "common/slots",
        "gauss_density/atom_errors"
    ),
    workgroup: [64, 1, 1],
};

/// `gauss-density`: derivatives of the refit's objective.
pub const GAUSS_DENSITY_REFIT_SUMS: Shader = Shader {
    name: "gauss_density_refit_sums",
    source: joined!(
        "common/item",
        "common/tree",
        "common/params",
        "common/sites",
        "common/slots",
        "gauss_density/refit_sums"
    ),
    workgroup: [64, 1, 1],
};

/// `gauss-density`: the atoms of a trial in the trees of cells.
pub const GAUSS_DENSITY_SETTLE: Shader = Shader {
    name: "gauss_density_settle",
    source: joined!("common/item", "common/params", "gauss_density/settle"),
    workgroup: [64, 1, 1],
};

/// `gauss-density`: the sums of atoms from those of their places in cells.
pub const GAUSS_DENSITY_GATHER: Shader = Shader {
    name: "gauss_density_gather",
    source: joined!("common/params", "gauss_density/gather"),
    workgroup: [64, 1, 1],
};

/// `gauss-density`: the density and its gradient at any points.
pub const GAUSS_DENSITY_POINTS: Shader = Shader {
    name: "gauss_density_points",
    source: joined!(
        "common/item",
        "common/tree",
        "common/params",
        "gauss_density/points"
    ),
    workgroup: [64, 1, 1],
};

// ── tet-quality

/// `tet-quality`: measures of tetrahedra.
pub const TET_QUALITY_MEASURE: Shader = Shader {
    name: "tet_quality_measure",
    source: joined!("tet_quality/measure"),
    workgroup: [64, 1, 1],
};

/// `tet-quality`: a sweep of smoothing over the vertices of a colour.
pub const TET_QUALITY_RELAX: Shader = Shader {
    name: "tet_quality_relax",
    source: joined!("tet_quality/relax"),
    workgroup: [64, 1, 1],
};

// ── crossfield

/// `crossfield`: distortion of the triangles of a map.
pub const CROSSFIELD_CHART_DISTORTION: Shader = Shader {
    name: "crossfield_chart_distortion",
    source: joined!("crossfield/chart_distortion"),
    workgroup: [64, 1, 1],
};

// ── secondfund-ops

/// `secondfund-ops`: the matrices of triangles.
pub const SECONDFUND_OPS_TRIANGLE_MATRICES: Shader = Shader {
    name: "secondfund_ops_triangle_matrices",
    source: joined!("common/conductivity", "secondfund_ops/triangle_matrices"),
    workgroup: [64, 1, 1],
};

/// `secondfund-ops`: the stiffness of patches applied to the surface itself.
pub const SECONDFUND_OPS_PATCH_FORCES: Shader = Shader {
    name: "secondfund_ops_patch_forces",
    source: joined!(
        "common/conductivity",
        "common/patch",
        "secondfund_ops/patch_forces"
    ),
    workgroup: [64, 1, 1],
};

/// `secondfund-ops`: the matrices of patches that share a basis.
pub const SECONDFUND_OPS_PATCH_MATRICES: Shader = Shader {
    name: "secondfund_ops_patch_matrices",
    source: joined!(
        "common/conductivity",
        "common/patch",
        "secondfund_ops/patch_matrices"
    ),
    workgroup: [64, 1, 1],
};

/// `secondfund-ops`: distances of all pairs of rows.
pub const SECONDFUND_OPS_DISTANCES: Shader = Shader {
    name: "secondfund_ops_distances",
    source: joined!("secondfund_ops/distances"),
    workgroup: [16, 16, 1],
};

// ── tspline

/// `tspline`: Bézier points of patches from control points.
pub const TSPLINE_BEZIER_POINTS: Shader = Shader {
    name: "tspline_bezier_points",
    source: joined!("tspline/bezier_points"),
    workgroup: [64, 1, 1],
};

/// `tspline`: points, normals and areas of patches.
pub const TSPLINE_BEZIER_SAMPLES: Shader = Shader {
    name: "tspline_bezier_samples",
    source: joined!("tspline/bezier_samples"),
    workgroup: [64, 1, 1],
};

// ── spectral-corresp

/// `spectral-corresp`: a pass of the exact distance transform.
pub const SPECTRAL_CORRESP_DISTANCES: Shader = Shader {
    name: "spectral_corresp_distances",
    source: joined!("spectral_corresp/distances"),
    workgroup: [64, 1, 1],
};

/// `spectral-corresp`: histograms of the nodes around each node.
pub const SPECTRAL_CORRESP_HISTOGRAMS: Shader = Shader {
    name: "spectral_corresp_histograms",
    source: joined!("spectral_corresp/histograms"),
    workgroup: [64, 1, 1],
};

/// `spectral-corresp`: the nearest row to each of others.
pub const SPECTRAL_CORRESP_NEAREST: Shader = Shader {
    name: "spectral_corresp_nearest",
    source: joined!("spectral_corresp/nearest"),
    workgroup: [64, 1, 1],
};

/// `spectral-corresp`: the rotation of each node's neighbourhood.
pub const SPECTRAL_CORRESP_ROTATIONS: Shader = Shader {
    name: "spectral_corresp_rotations",
    source: joined!("common/neighbourhoods", "spectral_corresp/rotations"),
    workgroup: [64, 1, 1],
};

/// `spectral-corresp`: a step of Jacobi's method for the distortion.
pub const SPECTRAL_CORRESP_SWEEP: Shader = Shader {
    name: "spectral_corresp_sweep",
    source: joined!("common/neighbourhoods", "spectral_corresp/sweep"),
    workgroup: [64, 1, 1],
};

/// Every kernel.
pub const ALL: &[Shader] = &[
    GEOM_CORE_PRODUCT,
    GEOM_CORE_SMOOTH,
    GEOM_CORE_STENCIL,
    GEOM_CORE_CORNER_DISTORTION,
    DUAL_CONTOUR_DUAL_VERTICES,
    GAUSS_DENSITY_CULL,
    GAUSS_DENSITY_DENSITY,
    GAUSS_DENSITY_COMPACT,
    GAUSS_DENSITY_TERMS,
    GAUSS_DENSITY_ATOM_ERRORS,
    GAUSS_DENSITY_REFIT_SUMS,
    GAUSS_DENSITY_SETTLE,
    GAUSS_DENSITY_GATHER,
    GAUSS_DENSITY_POINTS,
    TET_QUALITY_MEASURE,
    TET_QUALITY_RELAX,
    CROSSFIELD_CHART_DISTORTION,
    SECONDFUND_OPS_TRIANGLE_MATRICES,
    SECONDFUND_OPS_PATCH_MATRICES,
    SECONDFUND_OPS_PATCH_FORCES,
    SECONDFUND_OPS_DISTANCES,
    TSPLINE_BEZIER_POINTS,
    TSPLINE_BEZIER_SAMPLES,
    SPECTRAL_CORRESP_DISTANCES,
    SPECTRAL_CORRESP_HISTOGRAMS,
    SPECTRAL_CORRESP_NEAREST,
    SPECTRAL_CORRESP_ROTATIONS,
    SPECTRAL_CORRESP_SWEEP,
];
