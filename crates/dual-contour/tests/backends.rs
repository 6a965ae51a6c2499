//! Every backend follows `Cpu`, and the comparison can fail.
#![cfg(feature = "wgpu")]

mod common;

use common::*;
use dual_contour::geom_core::testing::gpu_or_skip;
use dual_contour::geom_core::{Agreement, Cpu, LatticeValues, Point3, Run};
use dual_contour::{
    BLOCK_CELLS, BLOCK_POINTS, CROSSINGS, ContourBackend, DUAL_VERTICES, MIN_MAX, Method, Options,
    surface,
};
use proptest::prelude::*;
use proptest::test_runner::{Config, TestRunner};

fn check<T: Copy + Into<f64>>(owed: Agreement, cpu: &[T], gpu: &[T]) -> Result<(), TestCaseError> {
    match owed.first_break(cpu, gpu) {
        None => Ok(()),
        Some(found) => Err(TestCaseError::fail(format!("{owed:?}: {found:?}"))),
    }
}

/// Values of `n` blocks: smooth, noisy, or with many ties with the level.
fn blocks() -> impl Strategy<Value = Vec<f32>> {
    let value = prop_oneof![
        3 => -2.0f32..4.0,
        1 => Just(1.0f32),
        1 => prop_oneof![Just(1.0f32.next_up()), Just(1.0f32.next_down()), Just(0.0), Just(-0.0)],
    ];
    (1..4usize).prop_flat_map(move |n| prop::collection::vec(value.clone(), n * BLOCK_POINTS))
}

fn runner() -> TestRunner {
    TestRunner::new(Config {
        cases: 48,
        failure_persistence: None,
        ..Config::default()
    })
}

#[test]
fn min_max_is_exact() {
    let Some(gpu) = gpu_or_skip() else { return };
    runner()
        .run(&blocks(), |values| {
            let (ours, theirs) = (Cpu.min_max(&values).unwrap(), gpu.min_max(&values).unwrap());
            prop_assert_eq!(ours.len(), values.len() / BLOCK_POINTS);
            check(MIN_MAX, ours.as_flattened(), theirs.as_flattened())
        })
        .unwrap();
}

#[test]
fn crossings_are_exact() {
    let Some(gpu) = gpu_or_skip() else { return };
    runner()
        .run(&(blocks(), -0.5f32..1.5), |(values, other)| {
            for level in [1.0, other] {
                let ours = Cpu.crossings(&values, level).unwrap();
                let theirs = gpu.crossings(&values, level).unwrap();
                prop_assert_eq!(ours.len(), values.len() / BLOCK_POINTS * BLOCK_CELLS);
                check(CROSSINGS, &ours, &theirs)?;
            }
            Ok(())
        })
        .unwrap();
}

#[test]
fn crossings_are_the_signs_of_the_corners() {
    let values: Vec<f32> = (0..BLOCK_POINTS).map(|i| (i * 37 % 11) as f32).collect();
    let masks = Cpu.crossings(&values, 5.0).unwrap();
    for (cell, &mask) in masks.iter().enumerate() {
        let at = [cell % 8, cell / 8 % 8, cell / 64];
        for c in 0..8 {
            let p = [0, 1, 2].map(|k| at[k] + (c >> k & 1));
            let inside = values[(p[2] * 9 + p[1]) * 9 + p[0]] >= 5.0;
            assert_eq!(mask >> c & 1 == 1, inside, "corner {c} of cell {at:?}");
        }
    }
}

/// Corner values of a field that is not too far from linear, through the middle of the cell.
fn cells() -> impl Strategy<Value = Vec<[f32; 8]>> {
    let cell = (
        prop::array::uniform3(-1.0f32..1.0),
        prop::array::uniform8(-0.2f32..0.2),
        -0.4f32..0.4,
        0.01f32..50.0,
    )
        .prop_map(|(slope, bend, offset, scale)| {
            std::array::from_fn(|c| {
                let linear: f32 = (0..3).map(|k| slope[k] * ((c >> k & 1) as f32 - 0.5)).sum();
                scale * (linear + bend[c] + offset * slope[0])
            })
        });
    prop::collection::vec(cell, 1..300)
}

#[test]
fn dual_vertices_stay_within_their_bound() {
    let Some(gpu) = gpu_or_skip() else { return };
    runner()
        .run(&cells(), |cells| {
            let ours = Cpu.dual_vertices(&cells, 4).unwrap();
            let theirs = gpu.dual_vertices(&cells, 4).unwrap();
            check(DUAL_VERTICES, ours.as_flattened(), theirs.as_flattened())
        })
        .unwrap();
}

#[test]
fn the_comparison_can_fail() {
    let Some(gpu) = gpu_or_skip() else { return };
    let values: Vec<f32> = (0..BLOCK_POINTS).map(|i| (i as f32 * 0.7).sin()).collect();
    let mut spoiled = values.clone();
    spoiled[300] = 9.0;
    let (ours, theirs) = (
        Cpu.min_max(&values).unwrap(),
        gpu.min_max(&spoiled).unwrap(),
    );
    assert!(check(MIN_MAX, ours.as_flattened(), theirs.as_flattened()).is_err());
    let (ours, theirs) = (
        Cpu.crossings(&values, 0.3).unwrap(),
        gpu.crossings(&values, 0.31).unwrap(),
    );
    assert!(check(CROSSINGS, &ours, &theirs).is_err());
    let cell = [-1.0f32, 1.0, -1.1, 0.9, -0.8, 1.2, -1.0, 1.0];
    let (ours, theirs) = (
        Cpu.dual_vertices(&[cell], 4).unwrap(),
        gpu.dual_vertices(&[cell.map(|v| v + 0.01)], 4).unwrap(),
    );
    assert!(check(DUAL_VERTICES, ours.as_flattened(), theirs.as_flattened()).is_err());
}

#[test]
fn meshes_differ_by_the_bound_alone() {
    let Some(gpu) = gpu_or_skip() else { return };
    let grid = sample(&ball(Point3::new(0.1, 0.2, -0.1), 3.0), 4.0, 24);
    for method in [Method::DualContour, Method::Lattice] {
        let options = Options {
            method,
            ..Options::default()
        };
        let ours = surface(&grid, None, &options, Run::on(&Cpu)).unwrap();
        let theirs = surface(&grid, None, &options, Run::on(&gpu)).unwrap();
        assert_eq!(ours.mesh.triangles(), theirs.mesh.triangles());
        let reach = 2e-4 * grid.lattice().spacing;
        let pairs = ours.mesh.positions().iter().zip(theirs.mesh.positions());
        assert!(pairs.into_iter().all(|(a, b)| (a - b).norm() <= reach));
    }
}
