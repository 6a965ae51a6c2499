//! Every backend follows the specification, and the comparison can fail.

use crate::common::*;
use dual_contour::backend::{
    BLOCK_CELLS, BLOCK_POINTS, CROSSINGS, ContourBackend, DUAL_VERTICES, MIN_MAX,
};
use dual_contour::geom_core::compute::BackendError;
use dual_contour::geom_core::{Agreement, Backend, Cpu, LatticeValues, Point3, Run};
use dual_contour::{Error, Method, specification, surface};
use proptest::prelude::*;
use proptest::test_runner::{Config, RngAlgorithm, TestRng, TestRunner};

/// The processor, and the GPU where there is one.
fn backends() -> Vec<Box<dyn ContourBackend>> {
    let mut all: Vec<Box<dyn ContourBackend>> = vec![Box::new(Cpu)];
    #[cfg(feature = "wgpu")]
    if let Some(gpu) = dual_contour::geom_core::testing::gpu_or_skip() {
        all.push(Box::new(gpu));
    }
    all
}

fn min_max(backend: &dyn ContourBackend, blocks: &[f32]) -> Vec<[f32; 2]> {
    // What is in the buffer before does not matter.
    let mut out = vec![[7.0; 2]; 5];
    backend.min_max(blocks, &mut out).unwrap();
    out
}

fn crossings(backend: &dyn ContourBackend, blocks: &[f32], level: f32) -> Vec<u8> {
    let mut out = vec![7; 5];
    backend.crossings(blocks, level, &mut out).unwrap();
    out
}

fn dual_vertices(backend: &dyn ContourBackend, cells: &[[f32; 8]]) -> Vec<[f32; 3]> {
    let mut out = vec![[7.0; 3]; 5];
    backend.dual_vertices(cells, 4, &mut out).unwrap();
    out
}

fn check<T: Copy + Into<f64>>(
    owed: Agreement,
    spec: &[T],
    found: &[T],
) -> Result<(), TestCaseError> {
    match owed.first_break(spec, found) {
        None => Ok(()),
        Some(broken) => Err(TestCaseError::fail(format!("{owed:?}: {broken:?}"))),
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

/// The same cases in every run.
fn runner() -> TestRunner {
    let config = Config {
        cases: 48,
        failure_persistence: None,
        ..Config::default()
    };
    TestRunner::new_with_rng(config, TestRng::deterministic_rng(RngAlgorithm::ChaCha))
}

fn spec_min_max(values: &[f32]) -> Vec<[f32; 2]> {
    let (blocks, _) = values.as_chunks::<BLOCK_POINTS>();
    blocks.iter().map(specification::min_max).collect()
}

fn spec_crossings(values: &[f32], level: f32) -> Vec<u8> {
    let (blocks, _) = values.as_chunks::<BLOCK_POINTS>();
    blocks
        .iter()
        .flat_map(|b| specification::crossings(b, level))
        .collect()
}

#[test]
fn min_max_is_exact() {
    for backend in backends() {
        runner()
            .run(&blocks(), |values| {
                let found = min_max(&*backend, &values);
                prop_assert_eq!(found.len(), values.len() / BLOCK_POINTS);
                let spec = spec_min_max(&values);
                check(MIN_MAX, spec.as_flattened(), found.as_flattened())
            })
            .unwrap();
    }
}

/// The lowest and the highest value at each of the places of a block, in blocks that follow each other: a kernel that
/// leaves one out, or steps wrongly from block to block, is seen.
#[test]
fn extremes_are_seen_wherever_they_stand() {
    let mut values = vec![0.5f32; BLOCK_POINTS * BLOCK_POINTS];
    for (place, block) in values.chunks_exact_mut(BLOCK_POINTS).enumerate() {
        block[place] = 3.0 + place as f32;
        block[(place + 400) % BLOCK_POINTS] = -1.0 - place as f32;
    }
    for backend in backends() {
        let found = min_max(&*backend, &values);
        assert_eq!(found.len(), BLOCK_POINTS);
        for (place, range) in found.into_iter().enumerate() {
            let expected = [-1.0 - place as f32, 3.0 + place as f32];
            assert_eq!(range, expected, "{} at {place}", backend.name());
        }
    }
}

#[test]
fn crossings_are_exact() {
    for backend in backends() {
        runner()
            .run(&(blocks(), -0.5f32..1.5), |(values, other)| {
                for level in [1.0, other] {
                    let found = crossings(&*backend, &values, level);
                    prop_assert_eq!(found.len(), values.len() / BLOCK_POINTS * BLOCK_CELLS);
                    check(CROSSINGS, &spec_crossings(&values, level), &found)?;
                }
                Ok(())
            })
            .unwrap();
    }
}

/// The specification itself, by hand.
#[test]
fn crossings_are_the_signs_of_the_corners() {
    let values: Vec<f32> = (0..BLOCK_POINTS).map(|i| (i * 37 % 11) as f32).collect();
    let masks = spec_crossings(&values, 5.0);
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
    for backend in backends() {
        runner()
            .run(&cells(), |cells| {
                let found: Vec<f64> = dual_vertices(&*backend, &cells)
                    .as_flattened()
                    .iter()
                    .map(|&x| f64::from(x))
                    .collect();
                let spec: Vec<[f64; 3]> = cells
                    .iter()
                    .map(|v| specification::dual_vertex(&v.map(f64::from), 4))
                    .collect();
                check(DUAL_VERTICES, spec.as_flattened(), &found)
            })
            .unwrap();
    }
}

#[test]
fn the_comparison_can_fail() {
    let values: Vec<f32> = (0..BLOCK_POINTS).map(|i| (i as f32 * 0.7).sin()).collect();
    let mut spoiled = values.clone();
    spoiled[300] = 9.0;
    let cell = [-1.0f32, 1.0, -1.1, 0.9, -0.8, 1.2, -1.0, 1.0];
    for backend in backends() {
        let found = min_max(&*backend, &spoiled);
        let spec = spec_min_max(&values);
        assert!(check(MIN_MAX, spec.as_flattened(), found.as_flattened()).is_err());
        let found = crossings(&*backend, &values, 0.31);
        assert!(check(CROSSINGS, &spec_crossings(&values, 0.3), &found).is_err());
        let found = dual_vertices(&*backend, &[cell.map(|v| v + 0.01)])[0].map(f64::from);
        let spec = specification::dual_vertex(&cell.map(f64::from), 4);
        assert!(check(DUAL_VERTICES, &spec, &found).is_err());
    }
}

#[test]
fn meshes_differ_by_the_bound_alone() {
    let grid = sample(&ball(Point3::new(0.1, 0.2, -0.1), 3.0), 4.0, 24);
    let Agreement::Bounded { absolute, .. } = DUAL_VERTICES else {
        panic!("a bound on places");
    };
    // The first is the processor itself, which ours is made on; each may be off by the bound.
    for backend in backends().iter().skip(1) {
        for method in METHODS {
            let options = by(method);
            let ours = surface(&grid, None, &options, Run::on(&Cpu)).unwrap();
            let theirs = surface(&grid, None, &options, Run::on(&**backend)).unwrap();
            assert_eq!(ours.mesh.triangles(), theirs.mesh.triangles());
            let reach = 2.0 * absolute * grid.lattice().spacing;
            for (a, b) in ours.mesh.positions().iter().zip(theirs.mesh.positions()) {
                assert!((a - b).amax() <= reach, "{a} {b}");
            }
        }
    }
}

/// What is wrong with the answers of a backend that else asks the processor, or why there are none.
struct Odd {
    ranges: fn(&mut Vec<[f32; 2]>) -> Result<(), Error>,
    masks: fn(&mut Vec<u8>) -> Result<(), Error>,
    points: fn(&mut Vec<[f32; 3]>) -> Result<(), Error>,
}

/// Nothing.
const PLAIN: Odd = Odd {
    ranges: |_| Ok(()),
    masks: |_| Ok(()),
    points: |_| Ok(()),
};

impl Backend for Odd {
    fn name(&self) -> String {
        "odd".to_owned()
    }
}

impl ContourBackend for Odd {
    fn blocks_per_call(&self) -> usize {
        0
    }
    fn min_max(&self, blocks: &[f32], out: &mut Vec<[f32; 2]>) -> Result<(), Error> {
        Cpu.min_max(blocks, out)?;
        (self.ranges)(out)
    }
    fn crossings(&self, blocks: &[f32], level: f32, out: &mut Vec<u8>) -> Result<(), Error> {
        Cpu.crossings(blocks, level, out)?;
        (self.masks)(out)
    }
    fn dual_vertices(
        &self,
        cells: &[[f32; 8]],
        steps: u32,
        out: &mut Vec<[f32; 3]>,
    ) -> Result<(), Error> {
        Cpu.dual_vertices(cells, steps, out)?;
        (self.points)(out)
    }
}

/// Whatever a backend from outside answers, the mesh is sound or the error typed.
#[test]
fn answers_that_make_no_sense_do_no_harm() {
    let grid = sample(&ball(Point3::origin(), 3.0), 4.0, 24);
    let options = by(Method::DualContour);
    let ours = surface(&grid, None, &options, Run::on(&Cpu)).unwrap();
    let same = surface(&grid, None, &options, Run::on(&PLAIN)).unwrap();
    assert_eq!(ours.mesh, same.mesh, "a wish for no blocks is one for one");
    let short = [
        Odd {
            ranges: |ranges| {
                ranges.clear();
                Ok(())
            },
            ..PLAIN
        },
        Odd {
            masks: |masks| {
                masks.truncate(1);
                Ok(())
            },
            ..PLAIN
        },
        Odd {
            points: |points| {
                points.truncate(1);
                Ok(())
            },
            ..PLAIN
        },
    ];
    for odd in short {
        let error = surface(&grid, None, &options, Run::on(&odd)).unwrap_err();
        assert!(matches!(error, Error::Backend(_)), "{error}");
        assert!(error.to_string().starts_with("odd gave"), "{error}");
    }
    let nowhere = [
        Odd {
            points: |points| {
                points.fill([f32::NAN; 3]);
                Ok(())
            },
            ..PLAIN
        },
        Odd {
            points: |points| {
                points.fill([f32::INFINITY; 3]);
                Ok(())
            },
            ..PLAIN
        },
        Odd {
            points: |points| {
                points.fill([-7.0; 3]);
                Ok(())
            },
            ..PLAIN
        },
    ];
    for odd in nowhere {
        let made = surface(&grid, None, &options, Run::on(&odd)).unwrap();
        // Points say which diagonal a face takes, and nothing else about the topology.
        assert_eq!(ours.mesh.triangles().len(), made.mesh.triangles().len());
        assert_eq!(faults(made.mesh.triangles()), Faults::default());
        for (a, b) in ours.mesh.positions().iter().zip(made.mesh.positions()) {
            assert!((a - b).amax() <= grid.lattice().spacing, "{a} {b}");
        }
    }
}

fn gone() -> Result<(), Error> {
    Err(BackendError::new("the device is gone").into())
}

/// What a backend fails of comes back to the caller, whatever it was asked.
#[test]
fn the_error_of_a_backend_is_the_callers() {
    let grid = sample(&ball(Point3::origin(), 3.0), 4.0, 24);
    let broken = [
        Odd {
            ranges: |_| gone(),
            ..PLAIN
        },
        Odd {
            masks: |_| gone(),
            ..PLAIN
        },
        Odd {
            points: |_| gone(),
            ..PLAIN
        },
    ];
    for odd in broken {
        let options = by(Method::DualContour);
        let error = surface(&grid, None, &options, Run::on(&odd)).unwrap_err();
        assert!(matches!(error, Error::Backend(_)));
        assert_eq!(error.to_string(), "the device is gone");
    }
}
