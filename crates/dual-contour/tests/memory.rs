//! What the mesher refuses for its size, against what it takes. One test: the peak is that of the process.
#![cfg(target_os = "linux")]

mod common;

use common::*;
use dual_contour::geom_core::{Cpu, Run};
use dual_contour::{Error, Extent, Method, Options, volume};

/// Memory of the process, bytes: `VmRSS` now, `VmHWM` the most that it has had.
fn memory(key: &str) -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap();
    let line = status.lines().find(|l| l.starts_with(key)).unwrap();
    1024 * line
        .split_whitespace()
        .nth(1)
        .unwrap()
        .parse::<u64>()
        .unwrap()
}

/// White noise is the worst case: half of the cells are ambiguous.
#[test]
fn the_memory_of_white_noise_is_known_within_a_factor_of_two() {
    let grid = noise(32, 0.4, 1, 3);
    // Dual contouring takes more, so that its peak shows after that of stuffing.
    for method in [Method::Stuffing, Method::DualContour] {
        let options = Options {
            region: Extent::Both,
            ..by(method)
        };
        let before = memory("VmRSS:");
        volume(&grid, None, &options, Run::on(&Cpu)).unwrap();
        let taken = memory("VmHWM:") - before;
        let allowed = |max_memory| {
            let options = Options {
                max_memory,
                ..options.clone()
            };
            volume(&grid, None, &options, Run::on(&Cpu))
        };
        match allowed(taken / 2) {
            Err(Error::TooLarge { bytes, .. }) => {
                assert!(
                    bytes < 2 * u128::from(taken),
                    "{bytes} for {taken} by {method:?}"
                );
            }
            other => panic!("{taken} bytes are taken by {method:?}, half allowed: {other:?}"),
        }
        assert!(allowed(2 * taken).is_ok(), "{taken} by {method:?}");
    }
}
