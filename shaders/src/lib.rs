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

/// Every kernel.
pub const ALL: &[Shader] = &[];
