//! Batches of the GPU: what is too large for one goes in parts.

use gauss_density::backend::{Block, Job, Prepared};
use gauss_density::testing::{globule, sample_cell};
use gauss_density::{Cutoff, Levels, Model, inside};
use geom_core::grid::{BRICK, BRICK_POINTS};
use geom_core::shaders::GAUSS_DENSITY_CULL;
use geom_core::testing::gpu_or_skip;
use geom_core::{Aabb, Lattice, Vector3};

/// As many calls as the bytes ask for, and the same values.
#[test]
fn a_block_that_is_too_large_is_sampled_in_parts() {
    let Some(gpu) = gpu_or_skip() else { return };
    let levels = Levels {
        residue_power: 0.5,
        ..Levels::default()
    };
    let model = Model::uniform(&globule(1, 40, 5), &levels).unwrap();
    let prepared = Prepared::new(&model);
    let all = model.center_bounds();
    let bounds = Aabb::new(all.center(), all.max);
    let job = Job {
        lattice: Lattice::covering(&bounds, bounds.extent().max() / 28.0),
        cutoff: Cutoff::default(),
        floor: 0.5,
        ceiling: 2.0,
    };
    let block = Block {
        brick: [0; 3],
        bricks: job.lattice.counts.map(|n| n.div_ceil(BRICK).min(4)),
        mask: u64::MAX - 6,
        atoms: (0..model.atoms() as u32).collect(),
    };
    let sampled = |bytes: usize| {
        let before = gpu.gpu().usage();
        let blocks = [block.clone(), block.clone()];
        let results = inside::sample_within(bytes, &gpu, &prepared, &job, &blocks).unwrap();
        let used = gpu.gpu().usage().since(&before);
        let culls = used.kernels().find(|k| k.0 == GAUSS_DENSITY_CULL.name);
        (results, culls.unwrap().1.calls)
    };
    let (whole, calls) = sampled(inside::BATCH_BYTES);
    assert_eq!(calls, 1);
    assert!(whole[0].values.len() > 2 * BRICK_POINTS);
    let wanted = (0..block.len()).filter(|&i| block.wants(i)).count() as u64;
    for (bytes, expected) in [(inside::BATCH_BYTES / 1024, None), (1, Some(2 * wanted))] {
        let (parts, calls) = sampled(bytes);
        assert_eq!(parts, whole);
        assert!(
            calls > 2 && expected.is_none_or(|n| calls == n),
            "{calls} calls"
        );
    }
}

/// However many runs there are, an atom has the sums of all of its cells.
#[test]
fn cells_may_come_in_many_runs() {
    let Some(gpu) = gpu_or_skip() else { return };
    let model = Model::uniform(&globule(2, 10, 5), &Levels::default()).unwrap();
    let prepared = Prepared::new(&model);
    let points = |shift: f64| {
        let on = model.centers().iter().zip(model.radii());
        on.map(|(x, r)| x + Vector3::new(*r, shift, 0.1)).collect()
    };
    // Of something denser, so that there is something to fit.
    let cells = [0.0, 0.3, -0.4].map(|shift| {
        let mut cell = sample_cell(&prepared, points(shift));
        cell.exact.iter_mut().for_each(|g| *g *= 1.2);
        cell
    });
    let sums = |bytes: usize| inside::refit_sums(bytes, &gpu, &prepared, &cells).unwrap();
    assert_eq!(inside::runs(1, &cells), 3);
    assert_eq!(inside::runs(inside::BATCH_BYTES, &cells), 1);
    let (one, three) = (sums(inside::BATCH_BYTES), sums(1));
    assert_eq!(one.objective, three.objective);
    let largest = one.gradient.as_flattened().iter();
    let largest = largest.fold(0.0f64, |most, g| most.max(g.abs()));
    assert!(largest > 0.0);
    let pairs = one.gradient.iter().zip(&three.gradient);
    for (a, b) in pairs.flat_map(|(a, b)| a.iter().zip(b)) {
        assert!((a - b).abs() <= 1e-5 * largest, "{a} {b}");
    }
}
