//! Arguments that several programs have, under the names of the crates' option fields.

use std::path::PathBuf;

use clap::{Args, ValueEnum};
use serde::Serialize;

use crate::picture::Renderer;

/// Where kernels run.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum BackendName {
    /// The CPU.
    #[default]
    Cpu,
    /// A GPU, through wgpu.
    Wgpu,
}

/// What every program asks.
#[derive(Clone, Debug, Args, Serialize)]
#[command(next_help_heading = "How to run")]
pub struct Common {
    /// Folder for all outputs, made if it is absent; a failed run leaves nothing there
    #[arg(long, short, value_name = "DIR")]
    pub out: PathBuf,
    /// Where kernels run; without an adapter `wgpu` is an error, never silently the CPU
    #[arg(long, value_enum, default_value_t)]
    pub backend: BackendName,
    /// Threads [default: one per core]; results do not depend on it
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub threads: Option<u16>,
    /// Most memory that grids may take, e.g. 500M or 4G [default: half of what is free]
    #[arg(long, value_name = "BYTES", value_parser = bytes)]
    pub max_memory: Option<u64>,
    /// What draws the pictures
    #[arg(long, value_enum, default_value_t)]
    pub renderer: Renderer,
    /// No progress bars and no summary
    #[arg(long, short)]
    pub quiet: bool,
}

impl Common {
    /// The memory limit in bytes: the asked one, else half of what is free now.
    pub fn memory(&self) -> u64 {
        self.max_memory.unwrap_or_else(|| {
            let mut system = sysinfo::System::new();
            system.refresh_memory();
            // In a container its own limit counts.
            let free = system
                .cgroup_limits()
                .map_or(u64::MAX, |limits| limits.free_memory);
            (system.available_memory().min(free) / 2).max(64 << 20)
        })
    }
}

/// Programs whose arguments hold the common ones.
pub trait HasCommon {
    /// The common arguments.
    fn common(&self) -> &Common;
    /// The input files.
    fn inputs(&self) -> Vec<PathBuf>;
}

/// Bytes with an optional unit: `K`, `M`, `G`, `T`, powers of 1024, with or without `B` or `iB`.
pub fn bytes(text: &str) -> Result<u64, String> {
    let bad = || format!("{text:?} is not a number of bytes like 500M or 4G");
    let lower = text.trim().to_ascii_lowercase();
    let bare = lower
        .strip_suffix("ib")
        .or(lower.strip_suffix('b'))
        .unwrap_or(&lower);
    let (number, shift) = match bare.chars().last() {
        Some('k') => (&bare[..bare.len() - 1], 10),
        Some('m') => (&bare[..bare.len() - 1], 20),
        Some('g') => (&bare[..bare.len() - 1], 30),
        Some('t') => (&bare[..bare.len() - 1], 40),
        _ => (bare, 0),
    };
    let value: f64 = number.trim().parse().map_err(|_| bad())?;
    let total =
        value * f64::from(1u32 << (shift % 32)) * if shift >= 32 { 4_294_967_296.0 } else { 1.0 };
    if (1.0..1e18).contains(&total) {
        Ok(total as u64)
    } else {
        Err(bad())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn memory_is_read_with_units() {
        assert_eq!(bytes("1000"), Ok(1000));
        assert_eq!(bytes("1.5k"), Ok(1536));
        assert_eq!(bytes("500M"), Ok(500 << 20));
        assert_eq!(bytes("4GiB"), Ok(4 << 30));
        assert_eq!(bytes("2 tb"), Ok(2 << 40));
        for bad in ["", "G", "-1G", "4X", "nan", "inf", "0"] {
            assert!(bytes(bad).is_err(), "{bad:?}");
        }
    }
}
