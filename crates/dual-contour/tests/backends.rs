//! Every backend follows the specification, and the comparison can fail.

use crate::common::*;
use dual_contour::backend::{ContourBackend, DUAL_VERTICES};
use dual_contour::geom_core::compute::BackendError;
use dual_contour::geom_core::{
    Agreement, Backend, Cpu, FieldAtMany, ImplicitField, LatticeValues, Point3, Run, Vector3,
};
use dual_contour::{Error, Method, Options, Placement, specification, surface, volume};
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

/// The same cases in every run.
fn runner() -> TestRunner {
    let config = Config {
        cases: 48,
        failure_persistence: None,
        ..Config::default()
    };
    TestRunner::new_with_rng(config, TestRng::deterministic_rng(RngAlgorithm::ChaCha))
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
    let cell = [-1.0f32, 1.0, -1.1, 0.9, -0.8, 1.2, -1.0, 1.0];
    for backend in backends() {
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
    points: fn(&mut Vec<[f32; 3]>) -> Result<(), Error>,
}

/// Nothing.
const PLAIN: Odd = Odd { points: |_| Ok(()) };

impl Backend for Odd {
    fn name(&self) -> String {
        "odd".to_owned()
    }
}

impl ContourBackend for Odd {
    fn blocks_per_call(&self) -> usize {
        0
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
    let short = Odd {
        points: |points| {
            points.truncate(1);
            Ok(())
        },
    };
    let error = surface(&grid, None, &options, Run::on(&short)).unwrap_err();
    assert!(matches!(error, Error::Backend(_)), "{error}");
    assert!(error.to_string().starts_with("odd gave"), "{error}");
    let nowhere = [
        Odd {
            points: |points| {
                points.fill([f32::NAN; 3]);
                Ok(())
            },
        },
        Odd {
            points: |points| {
                points.fill([f32::INFINITY; 3]);
                Ok(())
            },
        },
        Odd {
            points: |points| {
                points.fill([-7.0; 3]);
                Ok(())
            },
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

/// What a backend fails of comes back to the caller.
#[test]
fn the_error_of_a_backend_is_the_callers() {
    let grid = sample(&ball(Point3::origin(), 3.0), 4.0, 24);
    let broken = Odd {
        points: |_| Err(BackendError::new("the device is gone").into()),
    };
    let options = by(Method::DualContour);
    let error = surface(&grid, None, &options, Run::on(&broken)).unwrap_err();
    assert!(matches!(error, Error::Backend(_)));
    assert_eq!(error.to_string(), "the device is gone");
}

/// A field that takes many points with one call, as on a device; counts the calls, and fails if it has been told to.
struct AtOnce<F> {
    field: F,
    calls: std::sync::atomic::AtomicUsize,
    gone: bool,
}

impl<F> AtOnce<F> {
    fn new(field: F, gone: bool) -> Self {
        let calls = Default::default();
        Self { field, calls, gone }
    }
}

impl<F: ImplicitField> ImplicitField for AtOnce<F> {
    fn value(&self, x: &Point3) -> f64 {
        self.field.value(x)
    }
    fn value_gradient(&self, x: &Point3) -> (f64, Vector3) {
        self.field.value_gradient(x)
    }
    fn at_many(&self) -> Option<&dyn FieldAtMany> {
        Some(self)
    }
}

impl<F: ImplicitField> FieldAtMany for AtOnce<F> {
    fn values_gradients(
        &self,
        points: &[Point3],
        out: &mut Vec<(f64, Vector3)>,
    ) -> Result<(), BackendError> {
        if self.gone {
            return Err(BackendError::new("the device is gone"));
        }
        self.calls
            .fetch_add(1, std::sync::atomic::Ordering::Relaxed);
        out.clear();
        out.extend(points.iter().map(|x| self.field.value_gradient(x)));
        Ok(())
    }
}

/// However many points a field takes at a time, the mesh is the same, bit for bit.
#[test]
fn fields_that_take_many_points_give_the_same_mesh() {
    let field = torus(2.3, 0.9);
    let grid = sample(&field, 4.0, 28);
    let mut calls = 0;
    for method in METHODS {
        for placement in [Placement::Mass, Placement::Newton, Placement::Qef] {
            for tolerance in [0.0, 0.05] {
                if tolerance > 0.0 && method == Method::Stuffing {
                    continue;
                }
                let options = Options {
                    method,
                    placement,
                    tolerance,
                    ..Options::default()
                };
                let many = AtOnce::new(&field, false);
                let run = Run::on(&Cpu);
                let one = volume(&grid, Some(&field), &options, run).unwrap();
                let all = volume(&grid, Some(&many), &options, run).unwrap();
                assert_eq!(one.mesh, all.mesh, "{options:?}");
                let one = surface(&grid, Some(&field), &options, run).unwrap();
                let all = surface(&grid, Some(&many), &options, run).unwrap();
                assert_eq!(one.mesh, all.mesh, "{options:?}");
                let asked = many.calls.into_inner();
                let asks = method == Method::Stuffing || placement == Placement::Newton;
                assert_eq!(asked > 0, asks, "{options:?}");
                assert!(asked < 60, "{asked} calls: {options:?}");
                calls += asked;
                if asks {
                    let gone = AtOnce::new(&field, true);
                    let error = surface(&grid, Some(&gone), &options, run).unwrap_err();
                    assert!(matches!(error, Error::Backend(_)), "{error}");
                    assert_eq!(error.to_string(), "the device is gone");
                }
            }
        }
    }
    assert!(calls > 0);
}
