//! Every backend follows the specification; the comparisons can fail; threads do not matter.

use geom_core::compute::random::SplitMix64;
use geom_core::io::structure::{ReadOptions, read};
use geom_core::mesh::shapes;
use geom_core::testing::same_on_any_threads;
use geom_core::{Cpu, QuadMesh, Run, TriMesh, Vector3};
use proptest::prelude::*;
use secondfund_ops::backend::{DISTANCES, OperatorBackend, TRIANGLE_MATRICES, TriangleTask};
use secondfund_ops::flow::filter_normals;
use secondfund_ops::forms::{Conductor, Law, TriangleMatrix};
use secondfund_ops::options::ProbeOptions;
use secondfund_ops::pockets::between_probes;
use secondfund_ops::specification;
use secondfund_ops::testing::shaken;
use secondfund_ops::{
    Element, Faces, FilterOptions, FlowOptions, Groups, NormalFilter, Normals, SegmentOptions,
    SpectrumOptions, Surface, segment, smooth, spectrum,
};

pub(crate) const LAWS: [Law; 6] = [
    Law::Metric,
    Law::Adjugate,
    Law::GaussImage,
    Law::Generalized,
    Law::Flow,
    Law::Concave,
];

pub(crate) fn conductor(law: Law, gauss: f64, limit: f64) -> Conductor {
    Conductor {
        law,
        gauss,
        mean: 0.5 * gauss,
        bounds: [0.5, 10.0],
        regularization: 0.7,
        limit,
        sharpen: 0.5 * gauss.abs(),
    }
}

/// A shaken torus with normals that are not quite its own.
fn body(seed: u64) -> (TriMesh, Vec<Vector3>, Vec<f64>) {
    let mesh = shaken(&shapes::torus(0.3, 0.15, 16, 9), 0.005, seed);
    let mut random = SplitMix64::new(seed ^ 77);
    let normals = mesh.vertex_normals();
    let normals = normals.iter().map(|n| {
        let noise = Vector3::new(random.symmetric(), random.symmetric(), random.symmetric());
        (n + noise * 0.1).normalize()
    });
    let normals = normals.collect();
    let factors = mesh.positions().iter().map(|p| 1.0 + p.x * p.x).collect();
    (mesh, normals, factors)
}

/// What f32 may add to a stiffness that is small because products of curvatures cancel: sixteen roundings of the largest,
/// the square of the curvature 1 / 0.15 of [`body`].
const ROUNDED: f64 = 16.0 * 44.4 / (1 << 24) as f64;

/// The values of each triangle over its largest one; what is below 1e-6 of a unit conductivity is nothing.
fn relative(matrices: &[TriangleMatrix]) -> Vec<f64> {
    matrices
        .iter()
        .flat_map(|m| {
            let largest = m.stiffness.iter().fold(1e-6f64, |s, k| s.max(k.abs()));
            m.stiffness.map(|k| k / largest)
        })
        .collect()
}

fn specified(task: &TriangleTask<'_>) -> Vec<TriangleMatrix> {
    let factor = |t: &[u32; 3]| match task.factors {
        [] => 1.0,
        f => t.map(|v| f[v as usize]).iter().sum::<f64>() / 3.0,
    };
    task.triangles
        .iter()
        .map(|t| {
            specification::triangle_matrix(
                t.map(|v| task.positions[v as usize]),
                t.map(|v| task.normals[v as usize]),
                factor(t),
                &task.conductor,
            )
        })
        .collect()
}

/// Runs a check on tasks of every law.
fn with_tasks(seed: u64, gauss: f64, limit: f64, mut check: impl FnMut(&TriangleTask<'_>)) {
    let (mesh, normals, factors) = body(seed);
    for law in LAWS {
        check(&TriangleTask {
            positions: mesh.positions(),
            normals: &normals,
            triangles: mesh.triangles(),
            factors: if seed.is_multiple_of(2) {
                &factors
            } else {
                &[]
            },
            conductor: conductor(law, gauss, limit),
        });
    }
}

fn agreement(backend: &dyn OperatorBackend, task: &TriangleTask<'_>) {
    let reference = specified(task);
    let mut out = vec![TriangleMatrix::default(); 3];
    backend.triangle_matrices(task, &mut out).unwrap();
    let found = TRIANGLE_MATRICES.first_break(&relative(&reference), &relative(&out));
    assert_eq!(found, None, "{:?}", task.conductor);
    for (r, o) in reference.iter().zip(&out) {
        let size = r.stiffness.iter().fold(0.0f64, |s, k| s.max(k.abs()));
        let other = o.stiffness.iter().fold(0.0f64, |s, k| s.max(k.abs()));
        assert!(
            (size - other).abs() <= 1e-3 * size + ROUNDED,
            "{size} {other} {:?}",
            task.conductor
        );
        assert!((r.mass / o.mass - 1.0).abs() < 1e-5);
        assert!((r.mean - o.mean).abs() < 1e-4 * (1.0 + r.mean.abs()));
        assert!((r.gauss - o.gauss).abs() < 1e-3 * (1.0 + r.gauss.abs() + r.mean * r.mean));
    }
}

fn rows(seed: u64, count: usize, width: usize) -> Vec<f32> {
    let mut random = SplitMix64::new(seed);
    (0..count * width)
        .map(|_| random.symmetric() as f32)
        .collect()
}

fn distances_agree(backend: &dyn OperatorBackend, rows: &[f32], width: usize) {
    let each: Vec<&[f32]> = rows.chunks(width).collect();
    let reference: Vec<f64> = each
        .iter()
        .flat_map(|a| each.iter().map(|b| specification::distance(a, b)))
        .collect();
    let mut out = vec![7.0f32; 5];
    backend.distances(rows, width, &mut out).unwrap();
    let out: Vec<f64> = out.iter().map(|&d| d.into()).collect();
    assert_eq!(DISTANCES.first_break(&reference, &out), None);
}

proptest! {
    #![proptest_config(geom_core::testing::cases(16))]

    #[test]
    fn the_cpu_follows_the_specification(seed: u64, gauss in -1.0..1.0, limit in prop_oneof![Just(f64::INFINITY), 3.0..30.0]) {
        with_tasks(seed, gauss, limit, |task| agreement(&Cpu, task));
    }

    #[test]
    fn distances_of_the_cpu_follow_the_specification(seed: u64, count in 1usize..60, width in 1usize..33) {
        distances_agree(&Cpu, &rows(seed, count, width), width);
    }

    /// The comparison can fail: one altered value is found, at its place.
    #[test]
    fn a_wrong_value_is_caught(seed: u64, place in any::<prop::sample::Index>()) {
        with_tasks(seed, 1.0, f64::INFINITY, |task| {
            let reference = relative(&specified(task));
            let (mut wrong, i) = (reference.clone(), place.index(reference.len()));
            wrong[i] += 1e-3;
            assert_eq!(TRIANGLE_MATRICES.first_break(&reference, &wrong).map(|b| b.index), Some(i));
        });
    }
}

#[test]
fn threads_do_not_matter() {
    let mesh = shaken(&shapes::torus(1.0, 0.4, 40, 20), 0.02, 3);
    let normals = Normals::default();
    same_on_any_threads(|| {
        let run = Run::on(&Cpu);
        let modes = spectrum(
            &Element::Triangles(&mesh, &normals),
            &SpectrumOptions::default(),
            run,
        )
        .unwrap();
        let asked = SegmentOptions {
            groups: Groups::Count(4),
            sample: 300,
            ..SegmentOptions::default()
        };
        let segments = segment(&modes, &Faces::from(&mesh), &asked, run).unwrap();
        let flow = FlowOptions {
            iterations: 2,
            ..FlowOptions::default()
        };
        let smoothed = smooth(&mesh, 1, &flow, run).unwrap();
        let filter = FilterOptions {
            filter: NormalFilter::TOTAL_VARIATION,
            ..FilterOptions::default()
        };
        let filtered = filter_normals(&mesh, &filter, run).unwrap();
        let quads = shapes::quad_sphere(1.0, 5).into_parts();
        let open = QuadMesh::new(quads.0, quads.1[1..].to_vec()).unwrap();
        let rims = Surface::new(open).unwrap();
        let of_rims = spectrum(
            &Element::CatmullClark(&rims),
            &SpectrumOptions::default(),
            run,
        );
        (
            (modes.values, modes.modes, segments, smoothed.mesh),
            (filtered.mesh, of_rims.unwrap().modes),
        )
    });
    let path = fixtures::path("1AJJ.pdb");
    let structure = read(&path, &ReadOptions::default()).unwrap().structure;
    same_on_any_threads(|| between_probes(&structure, &ProbeOptions::default()).unwrap());
}

#[cfg(feature = "wgpu")]
mod gpu {
    use geom_core::testing::gpu_or_skip;

    use super::*;

    #[test]
    fn triangles_follow_the_specification() {
        let Some(gpu) = gpu_or_skip() else { return };
        proptest!(geom_core::testing::cases(12), |(seed: u64, gauss in -1.0..1.0, limit in prop_oneof![Just(f64::INFINITY), 3.0..30.0])| {
            with_tasks(seed, gauss, limit, |task| agreement(&gpu, task));
        });
    }

    #[test]
    fn distances_follow_the_specification() {
        let Some(gpu) = gpu_or_skip() else { return };
        proptest!(geom_core::testing::cases(12), |(seed: u64, count in 1usize..60, width in 1usize..33)| {
            distances_agree(&gpu, &rows(seed, count, width), width);
        });
    }

    #[test]
    fn whole_segmentations_obey_the_same_laws() {
        let Some(gpu) = gpu_or_skip() else { return };
        let sphere = shapes::icosphere(1.0, 3);
        let normals = Normals::OfMesh { rounds: 0 };
        let modes = spectrum(
            &Element::Triangles(&sphere, &normals),
            &SpectrumOptions::default(),
            Run::on(&gpu),
        )
        .unwrap();
        let asked = SegmentOptions {
            groups: Groups::Count(5),
            sample: 300,
            ..SegmentOptions::default()
        };
        let segments = segment(&modes, &Faces::from(&sphere), &asked, Run::on(&gpu)).unwrap();
        assert!(segments.areas.len() >= 2);
        assert!((segments.areas.iter().sum::<f64>() - sphere.area()).abs() < 1e-9);
    }
}
