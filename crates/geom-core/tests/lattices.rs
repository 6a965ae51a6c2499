//! Values on a lattice, dense and in bricks.

use geom_core::grid::{BRICK, BRICK_POINTS, Brick, LatticeValues};
use geom_core::{Aabb, BrickGrid, GridError, ImplicitField, Lattice, Point3, ScalarGrid, Vector3};

#[test]
fn index_and_coordinates_are_inverse() {
    let lattice = Lattice {
        origin: Point3::new(-1.0, 2.0, 0.5),
        spacing: 0.5,
        counts: [3, 4, 5],
    };
    for i in 0..lattice.len() {
        assert_eq!(lattice.index(lattice.coordinates(i)), i);
    }
    assert_eq!(lattice.point([2, 3, 4]), Point3::new(0.0, 3.5, 2.5));
}

#[test]
fn covering_reaches_the_far_corner() {
    let bounds = Aabb::new(Point3::origin(), Point3::new(1.0, 1.1, 0.0));
    let lattice = Lattice::covering(&bounds, 0.5);
    assert_eq!(lattice.counts, [3, 4, 1]);
    assert!(lattice.bounds().max.y >= 1.1);
}

fn ramp() -> ScalarGrid {
    let lattice = Lattice {
        origin: Point3::new(1.0, 2.0, 3.0),
        spacing: 0.5,
        counts: [9, 10, 11],
    };
    let values = (0..lattice.len())
        .map(|i| {
            let p = lattice.point(lattice.coordinates(i));
            (2.0 * p.x - 3.0 * p.y + p.z) as f32
        })
        .collect();
    ScalarGrid::new(lattice, values).unwrap()
}

#[test]
fn a_level_encloses_the_volume_asked_for() {
    let (lattice, values) = ramp().into_parts();
    let shuffled = (0..values.len()).map(|i| (i * 389 % 990) as f32 - 300.0);
    let grid = ScalarGrid::new(lattice, shuffled.collect()).unwrap();
    for points in [0, 1, 100, 333, 989, 990] {
        let level = grid.level_enclosing(f64::from(points) * 0.125).unwrap();
        let inside = grid.values().iter().filter(|&&v| v >= level).count();
        assert_eq!(inside, points as usize);
    }
    assert_eq!(grid.level_enclosing(124.0), None);
    assert_eq!(grid.level_enclosing(f64::NAN), None);
}

#[test]
fn trilinear_reproduces_linear_fields() {
    let (value, gradient) = ramp().value_gradient(&Point3::new(1.7, 3.1, 4.9));
    assert!((value - (3.4 - 9.3 + 4.9)).abs() < 1e-5);
    assert!((gradient - Vector3::new(2.0, -3.0, 1.0)).norm() < 1e-5);
}

#[test]
fn bricks_hold_the_same_values_as_the_dense_grid() {
    let dense = ramp();
    let bricks = dense.lattice().counts.map(|n| n.div_ceil(BRICK));
    let n = bricks.iter().product::<usize>();
    let mut values = Vec::new();
    for b in 0..n {
        let corner = [
            b % bricks[0],
            b / bricks[0] % bricks[1],
            b / (bricks[0] * bricks[1]),
        ];
        for p in 0..BRICK_POINTS {
            let inside = [p % BRICK, p / BRICK % BRICK, p / (BRICK * BRICK)];
            let at = [0, 1, 2].map(|k| corner[k] * BRICK + inside[k]);
            let within = (0..3).all(|k| at[k] < dense.lattice().counts[k]);
            values.push(if within { dense.at(at) } else { 0.0 });
        }
    }
    let kinds: Vec<_> = (0..n as u32).map(Brick::Stored).collect();
    let sparse = BrickGrid::new(*dense.lattice(), &kinds, values, 0.0, 2.0).unwrap();
    assert_eq!(sparse.to_dense(), dense);
    let (mut ours, mut theirs) = ([0.0; 7], [0.0; 7]);
    sparse.read_row([2, 9, 4], &mut ours);
    dense.read_row([2, 9, 4], &mut theirs);
    assert_eq!(ours, theirs);
}

#[test]
fn boxes_without_stored_bricks_are_known_to_be_constant() {
    let lattice = Lattice {
        origin: Point3::origin(),
        spacing: 1.0,
        counts: [24, 8, 8],
    };
    let kinds = [Brick::Exterior, Brick::Interior, Brick::Stored(0)];
    let grid = BrickGrid::new(lattice, &kinds, vec![1.0; BRICK_POINTS], 0.0, 2.0).unwrap();
    assert_eq!(grid.constant([0, 0, 0], [7, 7, 7]), Some(0.0));
    assert_eq!(grid.constant([9, 1, 2], [12, 7, 7]), Some(2.0));
    assert_eq!(grid.constant([0, 0, 0], [8, 7, 7]), None);
    assert_eq!(grid.constant([17, 0, 0], [18, 7, 7]), None);
    let mut row = [0.0; 20];
    grid.read_row([3, 2, 2], &mut row);
    assert_eq!((row[4], row[5], row[12], row[13]), (0.0, 2.0, 2.0, 1.0));
}

#[test]
fn a_grid_without_points_has_the_value_0() {
    for counts in [[0, 0, 0], [3, 0, 2]] {
        let lattice = Lattice {
            origin: Point3::origin(),
            spacing: 1.0,
            counts,
        };
        let dense = ScalarGrid::new(lattice, vec![]).unwrap();
        let bricks = BrickGrid::new(lattice, &[], vec![], 0.0, 2.0).unwrap();
        let x = Point3::new(0.5, 0.0, 1.0);
        assert_eq!(dense.value(&x), 0.0);
        assert_eq!(bricks.value_gradient(&x), (0.0, Vector3::zeros()));
    }
}

#[test]
fn fill_values_are_finite() {
    let lattice = Lattice {
        origin: Point3::origin(),
        spacing: 1.0,
        counts: [8; 3],
    };
    for (exterior, interior) in [(f32::NAN, 2.0), (0.0, f32::INFINITY)] {
        let grid = BrickGrid::new(lattice, &[Brick::Exterior], vec![], exterior, interior);
        assert!(matches!(grid, Err(GridError::Fill { .. })));
    }
}

#[test]
fn values_that_are_not_finite_are_named() {
    let lattice = Lattice {
        origin: Point3::origin(),
        spacing: 1.0,
        counts: [2, 2, 2],
    };
    let mut values = vec![0.0; 8];
    values[6] = f32::INFINITY;
    assert_eq!(
        ScalarGrid::new(lattice, values),
        Err(GridError::NotFinite {
            index: [0, 1, 1],
            value: f32::INFINITY
        })
    );
}
