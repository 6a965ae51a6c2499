//! Every backend follows the specification; the comparison can fail; threads do not matter.

use geom_core::testing::same_on_any_threads;
use geom_core::{Backend, Cpu, ImplicitField, Point3, Run, TetMesh, Vector3};
use proptest::prelude::*;
use tet_quality::backend::{MEASURE, RELAX, Relaxation, Slide};
use tet_quality::measure::metrics::quality;
use tet_quality::testing::{ball_in_box, lattice, relaxation, shaken};
use tet_quality::{Error, Measures, Options, QualityBackend, improve, specification};

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

/// What is compared of measures; volumes in units of `unit`³.
fn numbers(measures: &[Measures], unit: f64) -> Vec<f64> {
    measures
        .iter()
        .flat_map(|m| {
            let (low, high) = (m.min_dihedral / 180.0, m.max_dihedral / 180.0);
            let volume = m.six_volume / unit.powi(3);
            [m.joe_liu, m.edge_ratio, low, high, volume]
        })
        .collect()
}

fn measured(backend: &dyn QualityBackend, mesh: &TetMesh) -> Vec<Measures> {
    let mut out = Vec::new();
    backend
        .measure(mesh.positions(), mesh.tets(), &mut out)
        .unwrap();
    out
}

fn relaxed(backend: &dyn QualityBackend, task: &Relaxation<'_>) -> Vec<Vector3> {
    let mut out = Vec::new();
    backend.relax(task, &mut out).unwrap();
    out
}

/// A lattice with noise; up to 0.24 nothing is flat, where 0° and 180° hang on the last digit.
fn mesh(noise: f64, seed: u64, at: f64, unit: f64) -> TetMesh {
    let (mut positions, tets, regions, kinds) =
        shaken(lattice([4; 3], 1.0, |_| 1), noise, seed).into_parts();
    for x in &mut positions {
        *x = (*x + Vector3::repeat(at)) * unit;
    }
    TetMesh::with_kinds(positions, tets, regions, kinds).unwrap()
}

/// The first colour of a task and one round: what is reached then depends continuously on the input.
fn one_colour(mesh: &TetMesh) -> Relaxation<'_> {
    let mut task = relaxation(mesh, 1);
    task.colours.truncate(1);
    task.vertices.truncate(task.colours[0].end);
    task
}

/// The same in tangent planes, with means of every other vertex, and a reach that may hold vertices back.
fn sliding(mesh: &TetMesh, seed: u64, reach: f64) -> Relaxation<'_> {
    let mut task = one_colour(mesh);
    let mut random = geom_core::compute::random::SplitMix64::new(seed);
    for axes in &mut task.axes {
        let normal = Vector3::from([(); 3].map(|()| random.symmetric())).normalize();
        let u = normal.cross(&Vector3::ith(normal.iamin(), 1.0)).normalize();
        *axes = [u, normal.cross(&u), Vector3::zeros()];
    }
    let mut mean = |i: usize| {
        let d = Vector3::from([(); 3].map(|()| 0.3 * random.symmetric()));
        i.is_multiple_of(2).then_some(d)
    };
    let means = (0..task.vertices.len()).map(&mut mean).collect();
    task.slide = Some(Slide { means, reach });
    task
}

/// What is wrong with the answers of a backend that else asks the processor.
struct Odd {
    measures: fn(&mut Vec<Measures>),
    moves: fn(&mut Vec<Vector3>),
}

/// Nothing.
const PLAIN: Odd = Odd {
    measures: |_| (),
    moves: |_| (),
};

impl Backend for Odd {
    fn name(&self) -> String {
        "odd".to_owned()
    }
}

impl QualityBackend for Odd {
    fn measure(
        &self,
        x: &[Point3],
        tets: &[[u32; 4]],
        out: &mut Vec<Measures>,
    ) -> Result<(), Error> {
        Cpu.measure(x, tets, out)?;
        (self.measures)(out);
        Ok(())
    }
    fn relax(&self, task: &Relaxation<'_>, out: &mut Vec<Vector3>) -> Result<(), Error> {
        Cpu.relax(task, out)?;
        (self.moves)(out);
        Ok(())
    }
}

/// Displacements that are no numbers or absurd leave the mesh as good as it was.
#[test]
fn moves_that_make_no_sense_do_no_harm() {
    let (mesh, ball) = ball_in_box(8, 1.0, 2.7);
    let field: Option<&dyn ImplicitField> = Some(&ball);
    let options = Options::default();
    let absurd: [fn(&mut Vec<Vector3>); 3] = [
        |moves| moves.fill(Vector3::repeat(f64::NAN)),
        |moves| moves.fill(Vector3::repeat(f64::INFINITY)),
        |moves| moves.fill(Vector3::repeat(1e300)),
    ];
    for moves in absurd {
        let odd = Odd { moves, ..PLAIN };
        let made = improve(mesh.clone(), field, &options, Run::on(&odd)).unwrap();
        let finite = |x: &Point3| x.iter().all(|c| c.is_finite());
        assert!(made.mesh.positions().iter().all(finite));
        let (before, after) = (made.report.before.all, made.report.after.all);
        assert_eq!(after.inverted, 0);
        assert!(after.min_dihedral.min >= before.min_dihedral.min);
    }
}

/// Too few answers are an error that names the backend.
#[test]
fn missing_answers_are_an_error() {
    let few_measures = Odd {
        measures: |m| m.truncate(1),
        ..PLAIN
    };
    let few_moves = Odd {
        moves: Vec::clear,
        ..PLAIN
    };
    let (mesh, _) = ball_in_box(6, 1.0, 2.0);
    for (odd, what) in [(few_measures, "measures"), (few_moves, "displacements")] {
        let run = Run::on(&odd);
        let error = improve(mesh.clone(), None, &Options::default(), run).unwrap_err();
        let text = error.to_string();
        assert!(
            text.starts_with("odd gave") && text.contains(what),
            "{text}"
        );
    }
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

proptest! {
    #![proptest_config(geom_core::testing::cases(24))]

    /// The processor's vectors give what the equations say.
    #[test]
    fn measures_are_those_of_the_equations(
        p in prop::array::uniform4(prop::array::uniform3(-1.0..1.0f64)), unit in 1e-3..1e3,
    ) {
        let corners = p.map(|x| Point3::from(x) * unit);
        let expected = specification::measures(corners);
        prop_assume!(expected.joe_liu.abs() > 1e-3);
        let mesh = TetMesh::new(corners.to_vec(), vec![[0, 1, 2, 3]]).unwrap();
        let found = measured(&Cpu, &mesh);
        let pairs = numbers(&[expected], unit).into_iter().zip(numbers(&found, unit));
        for (expected, found) in pairs {
            prop_assert!((found - expected).abs() <= 1e-9 * expected.abs().max(1.0), "{expected} {found}");
        }
        prop_assert!((quality(corners) - specification::objective(corners)).abs() < 1e-9);
    }

    /// One vertex after the other, by the definition of the objective, ends where the sweep ends.
    #[test]
    fn a_sweep_reaches_what_the_equations_reach(noise in 0.0..0.3, seed: u64) {
        let mesh = mesh(noise, seed, 0.0, 1.0);
        let task = one_colour(&mesh);
        let reference = reached(&mesh, &task.vertices, &specification::relax(&task));
        let candidate = reached(&mesh, &task.vertices, &relaxed(&Cpu, &task));
        prop_assert_eq!(RELAX.first_break(&reference, &candidate), None);
    }

    /// And where vertices slide.
    #[test]
    fn a_slide_reaches_what_the_equations_reach(noise in 0.0..0.3, seed: u64, reach in 0.1..0.6) {
        let mesh = mesh(noise, seed, 0.0, 1.0);
        let task = sliding(&mesh, seed, reach);
        let reference = reached(&mesh, &task.vertices, &specification::relax(&task));
        let candidate = reached(&mesh, &task.vertices, &relaxed(&Cpu, &task));
        prop_assert_eq!(RELAX.first_break(&reference, &candidate), None);
    }

    /// The comparisons can fail: one altered value is found, at its place.
    #[test]
    fn a_wrong_value_is_caught(seed: u64, place in any::<prop::sample::Index>()) {
        let mesh = mesh(0.2, seed, 0.0, 1.0);
        let reference = numbers(&measured(&Cpu, &mesh), 1.0);
        let (mut wrong, i) = (reference.clone(), place.index(reference.len()));
        wrong[i] = wrong[i] * 1.001 + 3e-4;
        prop_assert_eq!(MEASURE.first_break(&reference, &wrong).map(|b| b.index), Some(i));
    }

    /// A displacement that leads elsewhere is found.
    #[test]
    fn a_wrong_move_is_caught(seed: u64, place in any::<prop::sample::Index>()) {
        let mesh = mesh(0.2, seed, 0.0, 1.0);
        let task = one_colour(&mesh);
        let mut moves = relaxed(&Cpu, &task);
        let reference = reached(&mesh, &task.vertices, &moves);
        let i = place.index(moves.len());
        moves[i] += task.axes[i][0] * 0.7;
        let wrong = reached(&mesh, &task.vertices, &moves);
        prop_assert_eq!(RELAX.first_break(&reference, &wrong).map(|b| b.index), Some(i));
    }
}

#[cfg(feature = "wgpu")]
mod gpu {
    use geom_core::testing::gpu_or_skip;
    use tet_quality::quality_report;

    use super::*;

    #[test]
    fn measure_follows_the_specification() {
        let Some(gpu) = gpu_or_skip() else { return };
        proptest!(geom_core::testing::cases(24), |(noise in 0.0..0.24, seed: u64, at in -1e3..1e3, unit in 1e-3..1e3)| {
            let mesh = mesh(noise, seed, at, unit);
            let reference = specification::measure(mesh.positions(), mesh.tets());
            let candidate = measured(&gpu, &mesh);
            prop_assert_eq!(MEASURE.first_break(&numbers(&reference, unit), &numbers(&candidate, unit)), None);
        });
    }

    #[test]
    fn relax_reaches_what_the_specification_reaches() {
        let Some(gpu) = gpu_or_skip() else { return };
        proptest!(geom_core::testing::cases(24), |(noise in 0.0..0.3, seed: u64)| {
            let mesh = mesh(noise, seed, 0.0, 1.0);
            let task = one_colour(&mesh);
            let reference = reached(&mesh, &task.vertices, &specification::relax(&task));
            let candidate = reached(&mesh, &task.vertices, &relaxed(&gpu, &task));
            prop_assert_eq!(RELAX.first_break(&reference, &candidate), None);
        });
    }

    #[test]
    fn slides_reach_what_the_specification_reaches() {
        let Some(gpu) = gpu_or_skip() else { return };
        proptest!(geom_core::testing::cases(48), |(noise in 0.0..0.3, seed: u64, reach in 0.1..0.6)| {
            let mesh = mesh(noise, seed, 0.0, 1.0);
            let task = sliding(&mesh, seed, reach);
            let reference = reached(&mesh, &task.vertices, &specification::relax(&task));
            let candidate = reached(&mesh, &task.vertices, &relaxed(&gpu, &task));
            prop_assert_eq!(RELAX.first_break(&reference, &candidate), None);
        });
    }

    /// Later colours go by what earlier ones have moved: nearly all vertices, ties apart, end where they do on the CPU.
    #[test]
    fn colours_see_what_those_before_them_moved() {
        let Some(gpu) = gpu_or_skip() else { return };
        for seed in 0..6 {
            let mesh = mesh(0.25, seed, 0.0, 1.0);
            let task = relaxation(&mesh, 1);
            assert!(task.colours.len() > 2);
            let (there, here) = (specification::relax(&task), relaxed(&gpu, &task));
            let same = there
                .iter()
                .zip(&here)
                .filter(|(a, b)| (*a - *b).norm() < 1e-3);
            let (same, all) = (same.count(), there.len());
            assert!(
                20 * same >= 19 * all,
                "{same} of {all} end at the same place"
            );
        }
    }

    /// Far from the first vertex, where single f32 coordinates have no digits left for the shapes.
    #[test]
    fn elements_of_a_large_mesh_are_seen_as_sharply_as_those_of_a_small_one() {
        let Some(gpu) = gpu_or_skip() else { return };
        for (seed, far) in [(1, 1e4), (2, 3e4), (3, 1e5)] {
            let (mut positions, tets, ..) = mesh(0.2, seed, 0.0, 1.0).into_parts();
            positions.insert(0, Point3::new(-far, far, 0.7 * far));
            let tets = tets.iter().map(|t| t.map(|v| v + 1)).collect();
            let mesh = TetMesh::new(positions, tets).unwrap();
            let reference = specification::measure(mesh.positions(), mesh.tets());
            let candidate = measured(&gpu, &mesh);
            let pair = [reference, candidate].map(|m| numbers(&m, 1.0));
            assert_eq!(MEASURE.first_break(&pair[0], &pair[1]), None, "{far}");
            let task = one_colour(&mesh);
            let reference = reached(&mesh, &task.vertices, &specification::relax(&task));
            let candidate = reached(&mesh, &task.vertices, &relaxed(&gpu, &task));
            assert_eq!(RELAX.first_break(&reference, &candidate), None, "{far}");
        }
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
}
