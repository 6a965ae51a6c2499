//! Every backend follows `Cpu`; the comparison can fail; threads do not matter.

use geom_core::testing::same_on_any_threads;
use geom_core::{Cpu, ImplicitField, Run};
use tet_quality::testing::ball_in_box;
use tet_quality::{Options, improve};

#[test]
fn threads_do_not_matter() {
    let (mesh, ball) = ball_in_box(10, 1.0, 3.3);
    let field: &dyn ImplicitField = &ball;
    let options = Options {
        passes: 9,
        ..Options::default()
    };
    same_on_any_threads(|| improve(mesh.clone(), Some(field), &options, Run::on(&Cpu)).unwrap());
}

#[cfg(feature = "wgpu")]
mod gpu {
    use geom_core::testing::gpu_or_skip;
    use geom_core::{Point3, TetMesh, Vector3};
    use proptest::prelude::*;
    use tet_quality::backend::{MEASURE, RELAX};
    use tet_quality::testing::{lattice, relaxation, shaken};
    use tet_quality::{Measures, QualityBackend, metrics::quality, quality_report};

    use super::*;

    fn numbers(measures: &[Measures]) -> Vec<f64> {
        measures
            .iter()
            .flat_map(|m| {
                let (low, high) = (m.min_dihedral / 180.0, m.max_dihedral / 180.0);
                [m.joe_liu, m.edge_ratio, low, high]
            })
            .collect()
    }

    /// Noise of up to 0.24: nothing is flat, where 0° and 180° hang on the last digit.
    fn mesh(noise: f64, seed: u64, at: f64, unit: f64) -> TetMesh {
        let (mut positions, tets, regions, kinds) =
            shaken(lattice([4; 3], 1.0, |_| 1), noise, seed).into_parts();
        for x in &mut positions {
            *x = (*x + Vector3::repeat(at)) * unit;
        }
        TetMesh::with_kinds(positions, tets, regions, kinds).unwrap()
    }

    /// The objective around each vertex of the task after its displacement.
    fn reached(mesh: &TetMesh, vertices: &[u32], moves: &[Vector3]) -> Vec<f64> {
        let mut positions: Vec<Point3> = mesh.positions().to_vec();
        for (&v, d) in vertices.iter().zip(moves) {
            positions[v as usize] += d;
        }
        let mut worst = vec![f64::INFINITY; positions.len()];
        for tet in mesh.tets() {
            let q = quality(tet.map(|v| positions[v as usize]));
            for &v in tet {
                worst[v as usize] = worst[v as usize].min(q);
            }
        }
        vertices.iter().map(|&v| worst[v as usize]).collect()
    }

    #[test]
    fn measure_follows_cpu() {
        let Some(gpu) = gpu_or_skip() else { return };
        proptest!(ProptestConfig::with_cases(24), |(noise in 0.0..0.24, seed: u64, at in -1e3..1e3, unit in 1e-3..1e3)| {
            let mesh = mesh(noise, seed, at, unit);
            let reference = Cpu.measure(mesh.positions(), mesh.tets()).unwrap();
            let candidate = gpu.measure(mesh.positions(), mesh.tets()).unwrap();
            prop_assert_eq!(MEASURE.first_break(&numbers(&reference), &numbers(&candidate)), None);
        });
    }

    #[test]
    fn relax_reaches_what_cpu_reaches() {
        let Some(gpu) = gpu_or_skip() else { return };
        proptest!(ProptestConfig::with_cases(24), |(noise in 0.0..0.3, seed: u64)| {
            let mesh = mesh(noise, seed, 0.0, 1.0);
            // One colour, one round: what is reached then depends continuously on the input.
            let mut task = relaxation(&mesh, 1);
            task.colours.truncate(1);
            task.vertices.truncate(task.colours[0].end);
            let reference = reached(&mesh, &task.vertices, &Cpu.relax(&task).unwrap());
            let candidate = reached(&mesh, &task.vertices, &gpu.relax(&task).unwrap());
            prop_assert_eq!(RELAX.first_break(&reference, &candidate), None);
        });
    }

    #[test]
    fn whole_improvements_obey_the_same_laws() {
        let Some(gpu) = gpu_or_skip() else { return };
        let (mesh, ball) = ball_in_box(10, 1.0, 3.3);
        let field: &dyn ImplicitField = &ball;
        let options = Options {
            passes: 3,
            ..Options::default()
        };
        let improved = improve(mesh, Some(field), &options, Run::on(&gpu)).unwrap();
        let (before, after) = (
            &improved.report.before.all,
            quality_report(&improved.mesh).all,
        );
        assert!(improved.report.backend.starts_with("wgpu"));
        assert_eq!(after.inverted, 0);
        assert!((after.volume - 1000.0).abs() < 1e-9);
        assert!(after.min_dihedral.min > before.min_dihedral.min);
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(32))]

        /// The comparisons can fail: one altered value is found, at its place.
        #[test]
        fn a_wrong_value_is_caught(seed: u64, place in any::<prop::sample::Index>()) {
            let mesh = mesh(0.2, seed, 0.0, 1.0);
            let reference = numbers(&Cpu.measure(mesh.positions(), mesh.tets()).unwrap());
            let (mut wrong, i) = (reference.clone(), place.index(reference.len()));
            wrong[i] = wrong[i] * 1.001 + 3e-4;
            prop_assert_eq!(MEASURE.first_break(&reference, &wrong).map(|b| b.index), Some(i));
        }

        /// A displacement that leads elsewhere is found.
        #[test]
        fn a_wrong_move_is_caught(seed: u64, place in any::<prop::sample::Index>()) {
            let mesh = mesh(0.2, seed, 0.0, 1.0);
            let mut task = relaxation(&mesh, 1);
            task.colours.truncate(1);
            task.vertices.truncate(task.colours[0].end);
            let mut moves = Cpu.relax(&task).unwrap();
            let reference = reached(&mesh, &task.vertices, &moves);
            let i = place.index(moves.len());
            moves[i] += task.axes[i][0] * 0.7;
            let wrong = reached(&mesh, &task.vertices, &moves);
            prop_assert_eq!(RELAX.first_break(&reference, &wrong).map(|b| b.index), Some(i));
        }
    }
}
