//! Every backend follows the plain f64 functions.

#![expect(clippy::print_stdout, reason = "figures for people, with --nocapture")]

use gauss_density::backend::{
    ATOM_ERRORS, BLOCK, Block, BlockValues, Job, Prepared, REFIT_SUMS, RefitSamples, RefitSums,
    SAMPLE_BLOCKS, SampleCell,
};
use gauss_density::specification::{self, nested_sum};
use gauss_density::testing::{globule, models, sample_cell};
use gauss_density::{
    Cutoff, DensityBackend, Elimination, Error, Levels, Model, Options, PointSampler, Refit,
    eliminate, refit, sample, sample_band,
};
use geom_core::grid::{BRICK, Brick};
use geom_core::{
    Aabb, Agreement, Cpu, ImplicitField, Lattice, LatticeValues, Point3, Run, Vector3,
};
use proptest::prelude::*;

#[cfg(feature = "wgpu")]
use gauss_density::backend::AT_POINTS;
#[cfg(feature = "wgpu")]
use geom_core::testing::gpu_or_skip;

/// The same cases every time: a gate must not depend on luck.
fn config(cases: u32) -> ProptestConfig {
    ProptestConfig {
        failure_persistence: None,
        rng_seed: proptest::test_runner::RngSeed::Fixed(0x0b10_9e03),
        ..ProptestConfig::with_cases(cases)
    }
}

/// A lattice of 2 × 2 × 1 bricks around the atoms' middle, as one block with all atoms.
fn block_of(model: &Model, spacing: f64) -> (Lattice, Block) {
    let middle = model.center_bounds().center();
    let low = Point3::new(
        middle.x - 8.0 * spacing,
        middle.y - 8.0 * spacing,
        middle.z - 4.0 * spacing,
    );
    let lattice = Lattice::covering(
        &Aabb::new(
            low,
            low + geom_core::Vector3::new(15.0, 15.0, 7.0) * (spacing * 0.999),
        ),
        spacing,
    );
    let block = Block {
        brick: [0; 3],
        bricks: lattice.counts.map(|n| n.div_ceil(BRICK).min(BLOCK)),
        mask: u64::MAX,
        atoms: (0..model.atoms() as u32).collect(),
    };
    (lattice, block)
}

/// How many values were compared, and the largest share of what is allowed that any was off by.
#[derive(Clone, Copy, Default)]
struct Compared {
    values: usize,
    worst: f64,
}

/// Checks the values of a block against the plain function: `(1 − ε) G ≤ G̃ ≤ G` with the agreement of the
/// kernel, and nothing exterior that reaches the floor. One point in `every` is looked at.
fn check_block(
    model: &Model,
    job: &Job,
    eps: f64,
    block: &Block,
    result: &BlockValues,
    every: usize,
) -> Result<Compared, TestCaseError> {
    let Agreement::Bounded { relative, absolute } = SAMPLE_BLOCKS else {
        unreachable!()
    };
    let mut compared = Compared::default();
    for i in 0..block.len() {
        let first = block.brick_at(i).map(|b| b * BRICK);
        for p in (i % every..BRICK.pow(3)).step_by(every) {
            let local = [p % BRICK, p / BRICK % BRICK, p / (BRICK * BRICK)];
            let x = job.lattice.point([0, 1, 2].map(|k| first[k] + local[k]));
            let exact = nested_sum(model, &x);
            match result.kinds[i] {
                Brick::Exterior => {
                    prop_assert!(exact < job.floor * (1.0 + relative), "{exact} outside")
                }
                Brick::Interior => prop_assert!(exact >= job.ceiling * (1.0 - relative)),
                Brick::Stored(s) => {
                    let got = f64::from(result.values[s as usize * BRICK.pow(3) + p]);
                    prop_assert!(
                        got <= exact * (1.0 + relative) + absolute,
                        "{got} above {exact}"
                    );
                    if exact >= job.floor && exact < 1e37 {
                        prop_assert!(
                            got >= exact * (1.0 - eps - relative) - absolute,
                            "{got} below {exact}"
                        );
                        compared.values += 1;
                        let of_lower = (exact - got) / (exact * (eps + relative) + absolute);
                        let of_upper = (got - exact) / (exact * relative + absolute);
                        compared.worst = compared.worst.max(of_lower).max(of_upper);
                    }
                }
            }
        }
    }
    Ok(compared)
}

/// The same model elsewhere.
fn moved(model: &Model, by: geom_core::Vector3) -> Model {
    changed(model, by, 1.0, 1.0)
}

/// A model with every centre moved, and all radii and decays by factors.
fn changed(model: &Model, by: geom_core::Vector3, radius: f64, decay: f64) -> Model {
    let level = |l: &gauss_density::Level| {
        let mut starts: Vec<u32> = (0..l.len()).map(|v| l.children(v).start as u32).collect();
        starts.push(l.children(l.len() - 1).end as u32);
        (starts, l.powers().to_vec())
    };
    Model::new(
        model.centers().iter().map(|x| x + by).collect(),
        model.radii().iter().map(|r| r * radius).collect(),
        model.decays().iter().map(|d| d * decay).collect(),
        model.levels().iter().map(level).collect(),
    )
    .unwrap()
}

fn follows_the_plain_density(backend: &dyn DensityBackend, cases: u32) {
    follows_the_plain_density_at(backend, geom_core::Vector3::zeros(), cases, 1);
}

fn follows_the_plain_density_at(
    backend: &dyn DensityBackend,
    place: geom_core::Vector3,
    cases: u32,
    every: usize,
) -> f64 {
    let strategy = (models(), 0.2..1.5f64, -5.0..-1.0f64, any::<bool>());
    let compared = std::cell::Cell::new(Compared::default());
    let config = config(cases);
    proptest!(config, |((model, spacing, ln_eps, band) in strategy)| {
        let model = moved(&model, place);
        let (lattice, block) = block_of(&model, spacing);
        let eps = 10f64.powf(ln_eps);
        let (floor, ceiling) = if band { (0.5, 2.0) } else { (1e-3, f64::INFINITY) };
        let job = Job { lattice, cutoff: Cutoff(eps), floor, ceiling };
        let prepared = Prepared::new(&model);
        // What a backend is given to use again must not matter.
        let mut result = vec![BlockValues { kinds: vec![Brick::Interior; 3], values: vec![7.0; 5], pairs: 9 }; 2];
        backend.sample_blocks(&prepared, &job, std::slice::from_ref(&block), &mut result).unwrap();
        prop_assert_eq!(result.len(), 1);
        let own = check_block(&model, &job, eps, &block, &result[0], every)?;
        let before = compared.get();
        let (values, worst) = (before.values + own.values, before.worst.max(own.worst));
        compared.set(Compared { values, worst });
    });
    let Compared { values, worst } = compared.get();
    let fewest = 100 * cases as usize / every;
    assert!(values > fewest, "{values} values compared");
    worst
}

/// Cells around the atoms, with a density of the original that the model has to reach.
fn cells_of(model: &Model, shift: f64) -> Vec<SampleCell> {
    let prepared = Prepared::new(model);
    (0..3)
        .map(|c| {
            let points = (0..20)
                .map(|i| {
                    let a = model.centers()[(7 * c + i) % model.atoms()];
                    let t = f64::from(i as u32) * 0.7 + c as f64;
                    a + geom_core::Vector3::new(t.sin(), t.cos(), (1.3 * t).sin()) * 1.8
                })
                .collect();
            let mut cell = sample_cell(&prepared, points);
            for (i, exact) in cell.exact.iter_mut().enumerate() {
                *exact *= 1.0 + shift * f64::from(i as u32 % 5);
            }
            for (i, (target, exact)) in cell.target.iter_mut().zip(&cell.exact).enumerate() {
                *target = if i % 4 == 0 { exact.min(1.1) } else { *exact };
            }
            cell
        })
        .collect()
}

/// Sums that need not be finite in f32 are no test of a kernel.
fn tame(model: &Model, cells: &[SampleCell]) -> bool {
    let top = |a: usize| model.decays()[a] * model.radii()[a].powi(2);
    (0..model.atoms()).all(|a| top(a) < 20.0)
        && cells
            .iter()
            .flat_map(|c| &c.exact)
            .all(|e| (1e-20..1e15).contains(e))
}

fn follows_the_plain_errors(backend: &dyn DensityBackend, cases: u32) {
    let config = config(cases);
    proptest!(config, |(model in models())| {
        let cells = cells_of(&model, 0.0);
        prop_assume!(tame(&model, &cells));
        let prepared = Prepared::new(&model);
        // What a backend is given to use again must not matter.
        let mut got = vec![3.0; 2];
        backend.atom_errors(&prepared, &cells, &mut got).unwrap();
        let plain = specification::atom_errors(&model, &cells);
        prop_assert_eq!(ATOM_ERRORS.first_break(&plain, &got), None);
    });
}

/// Sums per kind of parameter, relative to the largest of the kind.
fn normalized(sums: &RefitSums, by: &RefitSums) -> Vec<f64> {
    let mut all = vec![sums.objective / by.objective.max(1e-30)];
    for (own, scale) in [
        (&sums.gradient, &by.gradient),
        (&sums.curvature, &by.curvature),
    ] {
        for p in 0..5 {
            let largest = scale.iter().map(|s| s[p].abs()).fold(1e-30, f64::max);
            all.extend(own.iter().map(|s| s[p] / largest));
        }
    }
    all
}

fn follows_the_plain_refit(backend: &dyn DensityBackend, cases: u32) {
    let config = config(cases);
    proptest!(config, |(model in models())| {
        // The original is up to 40 % denser, so that there is something to fit.
        let cells = cells_of(&model, 0.1);
        prop_assume!(tame(&model, &cells));
        let prepared = Prepared::new(&model);
        let plain = specification::refit_sums(&model, &cells);
        let mut got = RefitSums { objective: 3.0, worst: 5.0, gradient: vec![[1.0; 5]; 40], ..RefitSums::default() };
        let mut samples = backend.refit_samples(&prepared, &cells).unwrap();
        samples.sums(&model, &mut got).unwrap();
        let (plain_, got) = (normalized(&plain, &plain), normalized(&got, &plain));
        prop_assert_eq!(REFIT_SUMS.first_break(&plain_, &got), None);
    });
}

#[test]
fn cpu_follows_the_plain_functions() {
    follows_the_plain_density(&Cpu, 200);
    follows_the_plain_errors(&Cpu, 200);
    follows_the_plain_refit(&Cpu, 200);
}

#[cfg(feature = "wgpu")]
#[test]
fn wgpu_follows_the_plain_density() {
    let Some(gpu) = gpu_or_skip() else { return };
    follows_the_plain_density(&gpu, 64);
}

/// B.12.3: many trees through the samplers that run by default.
#[test]
fn ten_thousand_trees_are_within_their_bounds_on_the_cpu() {
    let worst = follows_the_plain_density_at(&Cpu, geom_core::Vector3::zeros(), 10_000, 16);
    println!("worst share of the bound in 10,000 trees: {worst:.3}");
}

#[cfg(feature = "wgpu")]
#[test]
fn a_thousand_trees_are_within_their_bounds_on_wgpu() {
    let Some(gpu) = gpu_or_skip() else { return };
    let worst = follows_the_plain_density_at(&gpu, geom_core::Vector3::zeros(), 1000, 16);
    println!("worst share of the bound in 1,000 trees: {worst:.3}");
}

/// Where f32 resolves a thousandth of an Å: a crystal's copies, or a capsid.
const FAR: [f64; 3] = [10_000.0, -8000.0, 9000.0];

#[test]
fn cpu_follows_the_plain_density_far_from_the_origin() {
    follows_the_plain_density_at(&Cpu, FAR.into(), 40, 1);
}

#[cfg(feature = "wgpu")]
#[test]
fn wgpu_follows_the_plain_density_far_from_the_origin() {
    let Some(gpu) = gpu_or_skip() else { return };
    follows_the_plain_density_at(&gpu, FAR.into(), 24, 1);
}

#[cfg(feature = "wgpu")]
#[test]
fn wgpu_follows_the_plain_errors_and_refit() {
    let Some(gpu) = gpu_or_skip() else { return };
    follows_the_plain_errors(&gpu, 64);
    follows_the_plain_refit(&gpu, 64);
}

/// The samples stay where they are: the sums of a changed model are those of one that has just come, and a trial sends
/// its atoms and nothing else.
#[cfg(feature = "wgpu")]
#[test]
fn a_trial_of_a_refit_sends_its_atoms_alone() {
    let Some(gpu) = gpu_or_skip() else { return };
    proptest!(config(24), |((model, shift) in (models(), -0.2f64..0.2))| {
        let cells = cells_of(&model, 0.1);
        let moved = changed(&model, Vector3::repeat(shift), 1.0 + 0.2 * shift, 1.0 - shift);
        prop_assume!(tame(&moved, &cells));
        let prepared = Prepared::new(&model);
        let mut samples = gpu.refit_samples(&prepared, &cells).unwrap();
        let (mut first, mut got) = (RefitSums::default(), RefitSums::default());
        samples.sums(&model, &mut first).unwrap();
        let before = gpu.gpu().usage();
        samples.sums(&moved, &mut got).unwrap();
        let used = gpu.gpu().usage().since(&before).total();
        prop_assert_eq!(used.bytes_up, 32 * model.atoms() as u64);
        let points: usize = cells.iter().map(|c| c.points.len()).sum();
        prop_assert_eq!(used.bytes_down, (40 * model.atoms() + 4 * points) as u64);
        let plain = specification::refit_sums(&moved, &cells);
        let (plain_, got) = (normalized(&plain, &plain), normalized(&got, &plain));
        prop_assert_eq!(REFIT_SUMS.first_break(&plain_, &got), None);
    });
}

/// Many points with one call, near the atoms and far out, beside each alone; the whole at an offset.
#[cfg(feature = "wgpu")]
fn follows_the_plain_points(gpu: &dyn DensityBackend, offset: Vector3, cases: u32) -> f64 {
    let Agreement::Bounded { relative, absolute } = AT_POINTS else {
        panic!("a bound");
    };
    let worst = std::cell::Cell::new(0.0f64);
    let places = prop::collection::vec(prop::array::uniform3(-14.0..14.0f64), 1..200);
    proptest!(config(cases), |((model, places) in (models(), places))| {
        let model = moved(&model, offset);
        let sampler = PointSampler::new(&model, Cutoff(1e-6)).unwrap();
        let at_device = sampler.clone().on(gpu).unwrap();
        let many = at_device.at_many().expect("a device takes many");
        let mut points: Vec<Point3> = places.iter().map(|&x| Point3::from(x) + offset).collect();
        points.push(Point3::new(f64::NAN, 0.0, 0.0));
        points.push(Point3::new(1e200, 0.0, 0.0));
        let mut found = vec![(7.0, Vector3::zeros()); 3];
        many.values_gradients(&points, &mut found).unwrap();
        prop_assert_eq!(found.len(), points.len());
        for (x, (value, gradient)) in points.iter().zip(found) {
            let (plain, slope) = sampler.value_gradient(x);
            if plain > 1e30 {
                continue;
            }
            if plain.is_nan() {
                prop_assert!(value.is_nan());
                continue;
            }
            let value_off = (value - plain).abs() / (relative * plain + absolute);
            let allowed = relative * (slope.norm() + plain) + absolute;
            let slope_off = (gradient - slope).norm() / allowed;
            worst.set(worst.get().max(value_off).max(slope_off));
            prop_assert!(value_off <= 1.0, "{} for {} at {}", value, plain, x);
            prop_assert!(slope_off <= 1.0, "{} for {} at {}", gradient, slope, x);
        }
    });
    worst.get()
}

#[cfg(feature = "wgpu")]
#[test]
fn wgpu_follows_the_plain_points() {
    let Some(gpu) = gpu_or_skip() else { return };
    let near = follows_the_plain_points(&gpu, Vector3::zeros(), 200);
    let far = follows_the_plain_points(&gpu, FAR.into(), 60);
    println!("worst share of the bound: {near:.2} near the origin, {far:.2} far from it");
}

/// On a CPU points of a cell are summed side by side, few ones and those far out one at a time: the bits are the same.
#[test]
fn many_points_on_the_cpu_have_the_bits_of_one() {
    let places = prop::collection::vec(prop::array::uniform3(-14.0..14.0f64), 1..40);
    proptest!(config(60), |((model, places) in (models(), places))| {
        let sampler = PointSampler::new(&model, Cutoff::default()).unwrap();
        let mut points: Vec<Point3> = places.into_iter().map(Point3::from).collect();
        // A crowd as well, so that cells have more points than vectors have lanes, in an order that mixes them.
        let (from, to) = (model.centers()[0], points[0]);
        points.extend((0..200).map(|i| from + (to - from) * (f64::from(i * 37 % 200) / 200.0)));
        points.push(Point3::new(f64::NAN, 0.0, 0.0));
        points.push(Point3::new(1e200, 0.0, 0.0));
        let many = sampler.at_many().expect("a CPU takes many");
        let (mut both, mut values) = (Vec::new(), vec![7.0]);
        many.values_gradients(&points, &mut both).unwrap();
        many.values(&points, &mut values).unwrap();
        prop_assert_eq!([both.len(), values.len()], [points.len(); 2]);
        let bits = |(value, slope): (f64, Vector3)| [value, slope.x, slope.y, slope.z].map(f64::to_bits);
        for ((x, both), value) in points.iter().zip(both).zip(values) {
            prop_assert_eq!(bits(both), bits(sampler.value_gradient(x)), "at {}", x);
            prop_assert_eq!(value.to_bits(), sampler.value(x).to_bits(), "at {}", x);
        }
    });
}

/// What is wrong with the answers of a backend that else asks the processor.
#[derive(Clone, Copy)]
struct Odd {
    blocks: fn(&mut Vec<BlockValues>),
    errors: fn(&mut Vec<f64>),
    sums: fn(&mut RefitSums),
}

/// Nothing.
const PLAIN: Odd = Odd {
    blocks: |_| (),
    errors: |_| (),
    sums: |_| (),
};

impl geom_core::Backend for Odd {
    fn name(&self) -> String {
        "odd".to_owned()
    }
}

impl DensityBackend for Odd {
    fn sample_blocks(
        &self,
        model: &Prepared<'_>,
        job: &Job,
        blocks: &[Block],
        results: &mut Vec<BlockValues>,
    ) -> Result<(), Error> {
        Cpu.sample_blocks(model, job, blocks, results)?;
        (self.blocks)(results);
        Ok(())
    }
    fn atom_errors(
        &self,
        model: &Prepared<'_>,
        cells: &[SampleCell],
        errors: &mut Vec<f64>,
    ) -> Result<(), Error> {
        Cpu.atom_errors(model, cells, errors)?;
        (self.errors)(errors);
        Ok(())
    }
    fn refit_samples<'a>(
        &'a self,
        model: &Prepared<'_>,
        cells: &'a [SampleCell],
    ) -> Result<Box<dyn RefitSamples + 'a>, Error> {
        let samples = Cpu.refit_samples(model, cells)?;
        Ok(Box::new(OddSamples(samples, self.sums)))
    }
}

struct OddSamples<'a>(Box<dyn RefitSamples + 'a>, fn(&mut RefitSums));

impl RefitSamples for OddSamples<'_> {
    fn sums(&mut self, model: &Model, sums: &mut RefitSums) -> Result<(), Error> {
        self.0.sums(model, sums)?;
        (self.1)(sums);
        Ok(())
    }
}

/// Wrong in one place of each answer.
const WRONG: Odd = Odd {
    blocks: |results| {
        let values = results.iter_mut().flat_map(|r| r.values.iter_mut());
        values.for_each(|value| *value *= 1.001);
    },
    errors: |errors| errors[0] = errors[0] * 1.01 + 1e-5,
    sums: |sums| sums.gradient.iter_mut().for_each(|g| g[3] *= 1.01),
};

#[test]
#[should_panic(expected = "above")]
fn a_wrong_density_is_caught() {
    follows_the_plain_density(&WRONG, 20);
}

#[test]
#[should_panic(expected = "None")]
fn a_wrong_error_is_caught() {
    follows_the_plain_errors(&WRONG, 20);
}

#[test]
#[should_panic(expected = "None")]
fn a_wrong_derivative_is_caught() {
    follows_the_plain_refit(&WRONG, 20);
}

#[cfg(feature = "wgpu")]
#[test]
fn wgpu_samples_eliminates_and_refits_like_the_cpu() {
    let Some(gpu) = gpu_or_skip() else { return };
    let levels = Levels {
        residue_power: 0.25,
        chain_power: 0.8,
        decay: 0.5,
        ..Levels::default()
    };
    let model = Model::uniform(&globule(2, 10, 3), &levels).unwrap();
    let options = Options {
        spacing: 0.7,
        ..Options::default()
    };
    let dense = [
        sample(&model, &options, Run::on(&Cpu)).unwrap(),
        sample(&model, &options, Run::on(&gpu)).unwrap(),
    ];
    let band = sample_band(&model, &options, Run::on(&gpu)).unwrap();
    let lattice = *dense[0].grid.lattice();
    assert!(band.report.stored_points > 0 && dense[1].report.pairs > 0);
    for i in 0..lattice.len() {
        let [cpu, gpu] = [0, 1].map(|d| f64::from(dense[d].grid.values()[i]));
        if cpu >= 1e-3 {
            assert!((cpu - gpu).abs() <= 4e-4 * cpu, "{cpu} {gpu}");
        }
        let banded = f64::from(band.grid.at(lattice.coordinates(i)));
        if (cpu - 1.0).abs() > 4e-4 {
            assert_eq!(banded >= 1.0, cpu >= 1.0);
        }
    }
    let elimination = Elimination {
        epsilon: 0.05,
        spacing: 0.8,
        ..Elimination::default()
    };
    let cpu = eliminate(&model, &elimination, Run::on(&Cpu)).unwrap();
    let on_gpu = eliminate(&model, &elimination, Run::on(&gpu)).unwrap();
    assert!(on_gpu.report.worst_loss <= 0.05 && on_gpu.report.backend.starts_with("wgpu"));
    let (a, b) = (cpu.report.remaining as f64, on_gpu.report.remaining as f64);
    assert!(a < 140.0 && (a - b).abs() <= 0.05 * a, "{a} and {b} remain");
    let options = gauss_density::Refit {
        spacing: 0.8,
        iterations: 20,
        ..Default::default()
    };
    let fit = gauss_density::refit(&on_gpu.model, &model, &options, Run::on(&gpu)).unwrap();
    assert!(fit.report.objective[1] < 0.5 * fit.report.objective[0]);
}

#[cfg(feature = "wgpu")]
#[test]
fn trees_that_are_too_deep_for_the_kernels_are_refused() {
    let Some(gpu) = gpu_or_skip() else { return };
    let tree = vec![(vec![0, 1], vec![0.5]); 9];
    let model = Model::new(vec![Point3::origin()], vec![1.7], vec![1.0], tree).unwrap();
    let error = sample(&model, &Options::default(), Run::on(&gpu)).unwrap_err();
    assert!(error.to_string().contains("8 levels"), "{error}");
}

/// Whatever a backend from outside answers, the error is typed and names it.
#[test]
fn answers_that_make_no_sense_do_no_harm() {
    let model = Model::uniform(&globule(1, 6, 3), &Levels::default()).unwrap();
    let options = Options {
        spacing: 1.0,
        ..Options::default()
    };
    let elimination = Elimination {
        epsilon: 0.1,
        spacing: 1.0,
        ..Elimination::default()
    };
    let fit = Refit {
        spacing: 1.0,
        iterations: 5,
        ..Refit::default()
    };
    let reduced = eliminate(&model, &elimination, Run::on(&PLAIN)).unwrap();
    assert!(reduced.kept.len() < model.atoms());
    let blamed = |error: Error, what: &str| {
        assert!(matches!(error, Error::Backend(_)), "{error}");
        let text = error.to_string();
        assert!(
            text.starts_with("odd gave") && text.contains(what),
            "{text}"
        );
    };

    type Spoil = fn(&mut Vec<BlockValues>);
    let blocks: [(Spoil, &str); 6] = [
        (|r| r.clear(), "results"),
        (|r| r.push(BlockValues::default()), "results"),
        (|r| r[0].kinds.truncate(1), "kinds"),
        (
            |r| r.iter_mut().for_each(|r| r.kinds.push(Brick::Exterior)),
            "kinds",
        ),
        (
            |r| r.iter_mut().for_each(|r| r.values.truncate(100)),
            "values",
        ),
        (
            |r| r.iter_mut().for_each(|r| r.kinds.fill(Brick::Stored(1000))),
            "number 1000",
        ),
    ];
    for (blocks, what) in blocks {
        let odd = Odd { blocks, ..PLAIN };
        blamed(sample(&model, &options, Run::on(&odd)).unwrap_err(), what);
        blamed(
            sample_band(&model, &options, Run::on(&odd)).unwrap_err(),
            what,
        );
    }
    let odd = Odd {
        blocks: |r| r.iter_mut().for_each(|r| r.values.fill(f32::NAN)),
        ..PLAIN
    };
    assert!(sample(&model, &options, Run::on(&odd)).is_err());
    assert!(sample_band(&model, &options, Run::on(&odd)).is_err());

    let errors: [fn(&mut Vec<f64>); 2] = [|e| e.truncate(41), |e| e.push(0.0)];
    for errors in errors {
        let odd = Odd { errors, ..PLAIN };
        let error = eliminate(&model, &elimination, Run::on(&odd)).unwrap_err();
        blamed(error, "errors for 42 atoms");
    }
    // An order of trial like any other; the bound holds all the same.
    let odd = Odd {
        errors: |e| e.fill(f64::NAN),
        ..PLAIN
    };
    let done = eliminate(&model, &elimination, Run::on(&odd)).unwrap();
    assert!(done.report.worst_loss <= elimination.epsilon);

    type Sums = fn(&mut RefitSums);
    let sums: [(Sums, &str); 6] = [
        (|s| s.gradient.truncate(1), "gradients"),
        (|s| s.curvature.push([0.0; 5]), "curvatures"),
        (|s| s.objective = f64::NAN, "objective of NaN"),
        (|s| s.objective = f64::INFINITY, "objective of inf"),
        (|s| s.gradient[0][3] = f64::NAN, "derivatives"),
        (|s| s.curvature[0][0] = f64::INFINITY, "derivatives"),
    ];
    for (sums, what) in sums {
        let odd = Odd { sums, ..PLAIN };
        let error = refit(&reduced.model, &model, &fit, Run::on(&odd)).unwrap_err();
        blamed(error, what);
    }
}
