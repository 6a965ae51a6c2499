//! Cut-offs where they cost most: many atoms at one place, each of which is just worth leaving out, lose as much as the
//! bounds allow. Random trees never do.

use gauss_density::specification::nested_sum;
use gauss_density::{Cutoff, DensityBackend, Model, Options, PointSampler, sample_band};
use geom_core::grid::Brick;
use geom_core::testing::gpu_or_skip;
use geom_core::{Aabb, Cpu, ImplicitField, LatticeValues, Point3, Run, Vector3};

/// What may be lost, and what rounding adds to it.
const EPS: f64 = 1e-2;
const ROUNDING: f64 = 3e-4;
/// Atoms of the crowd.
const CROWD: usize = 200;

/// An atom at the origin and a crowd without radii, all of one decay; below one node of a power, if there is one.
fn beside_a_crowd(radius: f64, decay: f64, crowd: Point3, power: Option<f64>) -> Model {
    let mut centers = vec![Point3::origin()];
    centers.extend([crowd; CROWD]);
    let mut radii = vec![radius];
    radii.extend([0.0; CROWD]);
    let tree = power.map(|p| (vec![0, 1 + CROWD as u32], vec![p]));
    let decays = vec![decay; 1 + CROWD];
    Model::new(centers, radii, decays, tree.into_iter().collect()).unwrap()
}

/// The largest share that a point of a grid of 16³ around `middle` loses, of those where the density reaches the floor.
fn worst_loss(model: &Model, middle: Point3, backend: &dyn DensityBackend) -> f64 {
    const SPACING: f64 = 0.1;
    let half = Vector3::repeat(7.5 * SPACING);
    let options = Options {
        spacing: SPACING,
        bounds: Some(Aabb::new(middle - half, middle + half)),
        band: [0.5, 1e5],
        cutoff: Cutoff(EPS),
        ..Options::default()
    };
    let grid = sample_band(model, &options, Run::on(backend)).unwrap().grid;
    let lattice = *grid.lattice();
    let loss = |i: usize| {
        let p = lattice.coordinates(i);
        let (exact, got) = (nested_sum(model, &lattice.point(p)), f64::from(grid.at(p)));
        assert!(got <= exact * (1.0 + ROUNDING), "{got} above {exact}");
        if exact >= 0.5 { 1.0 - got / exact } else { 0.0 }
    };
    (0..lattice.len()).map(loss).fold(0.0, f64::max)
}

/// Crowds ever farther away along an axis, until none of it matters.
fn check_crowds(backend: &dyn DensityBackend, steps: usize) {
    for axis in 0..3 {
        let along = Vector3::ith(axis, 1.0);
        let across = Vector3::ith((axis + 1) % 3, 1.0);
        let [mut absolute, mut relative] = [0.0f64; 2];
        for step in 0..steps {
            let share = step as f64 / steps as f64;
            // Near the floor, where an absolute loss counts.
            let middle = Point3::from(across * 1.66);
            let crowd = middle + along * (3.2 + 2.0 * share);
            let model = beside_a_crowd(1.5, 1.0, crowd, None);
            absolute = absolute.max(worst_loss(&model, middle, backend));
            // Far above it, where another atom of the node outweighs the crowd.
            let crowd = Point3::from(along * (1.5 + 2.0 * share));
            let model = beside_a_crowd(2.0, 1.0, crowd, Some(0.9));
            relative = relative.max(worst_loss(&model, Point3::origin(), backend));
        }
        for worst in [absolute, relative] {
            assert!(worst <= EPS + ROUNDING, "lost {worst}");
            // Something is left out at all.
            assert!(worst > 0.02 * EPS, "lost {worst} only");
        }
    }
}

#[test]
fn a_crowd_costs_no_more_than_it_may_on_the_cpu() {
    check_crowds(&Cpu, 80);
}

#[test]
fn a_crowd_costs_no_more_than_it_may_on_wgpu() {
    let Some(gpu) = gpu_or_skip() else { return };
    check_crowds(&gpu, 20);
}

/// The largest share that points lose along the way from the origin to a crowd.
fn worst_loss_towards(crowd: Vector3, decay: f64) -> f64 {
    let model = beside_a_crowd(2.0, decay, crowd.into(), None);
    let sampler = PointSampler::new(&model, Cutoff(EPS)).unwrap();
    let loss = |i: i32| {
        let x = Point3::from(crowd * (f64::from(i) / 200.0));
        let exact = nested_sum(&model, &x);
        if exact > 1e-9 {
            1.0 - sampler.value(&x) / exact
        } else {
            0.0
        }
    };
    (0..200).map(loss).fold(0.0, f64::max)
}

/// Cells are culled in groups: the crowd is left out of one as a whole where the corner of the group that is nearest to it
/// is the one that is farthest from the other atom.
#[test]
fn a_crowd_costs_no_more_than_it_may_at_points() {
    for (direction, decay) in [(Vector3::x(), 0.1), (Vector3::repeat(1.0), 0.03)] {
        let losses = (0..64).map(|step| {
            let crowd = direction * (12.0 + 0.25 * f64::from(step));
            worst_loss_towards(crowd, decay)
        });
        let worst = losses.fold(0.0, f64::max);
        assert!(worst <= EPS, "lost {worst}");
        assert!(worst > 0.02 * EPS, "lost {worst} only");
    }
}

/// A surface between the last layer of a brick and the first of the next, of an atom whose kernel is too high for the
/// sampler that sums kernels as they are: the outer brick is far below the floor, and yet needs its values.
#[test]
fn both_ends_of_a_crossing_between_bricks_have_values_where_kernels_are_high() {
    // Between two bricks of a block; and between two blocks, by a kernel so steep that it does not reach the second one.
    for (below, decay) in [(15, 1.0), (31, 20.0)] {
        for (axis, sign) in [0, 1, 2].into_iter().flat_map(|k| [(k, 1.0), (k, -1.0)]) {
            let mut center = Point3::new(12.0, 12.0, 12.0);
            center[axis] = below as f64 + 0.5 - 10.0 * sign;
            let model = Model::new(vec![center], vec![10.0], vec![decay], vec![]).unwrap();
            let options = Options {
                spacing: 1.0,
                bounds: Some(Aabb::new(Point3::origin(), Point3::from([63.0; 3]))),
                ..Options::default()
            };
            let grid = sample_band(&model, &options, Run::on(&Cpu)).unwrap().grid;
            let mut p = [12; 3];
            for layer in [below, below + 1] {
                p[axis] = layer;
                let brick = grid.brick(p.map(|c| c / 8));
                assert!(matches!(brick, Brick::Stored(_)), "no values at {p:?}");
            }
            // On one side of the surface.
            p[axis] = if sign > 0.0 { below + 1 } else { below };
            assert!(grid.at(p) < 1.0);
        }
    }
}
