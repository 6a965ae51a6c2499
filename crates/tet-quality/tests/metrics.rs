//! Metrics of single tetrahedra against closed forms.

use geom_core::Point3;
use geom_core::mesh::six_volume;
use tet_quality::{aspect_ratio, inside, measures, radius_ratio};

fn p(x: f64, y: f64, z: f64) -> Point3 {
    Point3::new(x, y, z)
}

fn corner() -> [Point3; 4] {
    [
        p(0.0, 0.0, 0.0),
        p(1.0, 0.0, 0.0),
        p(0.0, 1.0, 0.0),
        p(0.0, 0.0, 1.0),
    ]
}

fn regular() -> [Point3; 4] {
    [
        p(1.0, 1.0, 1.0),
        p(-1.0, 1.0, -1.0),
        p(1.0, -1.0, -1.0),
        p(-1.0, -1.0, 1.0),
    ]
}

#[test]
fn the_regular_tetrahedron_is_perfect() {
    let m = measures(regular());
    let angle = (1.0f64 / 3.0).acos().to_degrees();
    assert!((m.joe_liu - 1.0).abs() < 1e-14);
    assert!((m.edge_ratio - 1.0).abs() < 1e-14);
    assert!((m.min_dihedral - angle).abs() < 1e-10);
    assert!((m.max_dihedral - angle).abs() < 1e-10);
    assert!((radius_ratio(regular()) - 1.0).abs() < 1e-14);
    assert!((aspect_ratio(regular()) - 1.5f64.sqrt()).abs() < 1e-14);
    assert!((inside::quality(regular()) - angle.to_radians().sin()).abs() < 1e-14);
}

#[test]
fn the_right_corner_has_its_closed_forms() {
    let m = measures(corner());
    // Three right angles at the axes, acos(1/√3) at the slanted face.
    assert!((m.max_dihedral - 90.0).abs() < 1e-10);
    assert!((m.min_dihedral - (1.0 / 3f64.sqrt()).acos().to_degrees()).abs() < 1e-10);
    assert!((m.edge_ratio - 2f64.sqrt()).abs() < 1e-14);
    assert!((m.joe_liu - inside::JOE_LIU / 27.0).abs() < 1e-14);
    assert!((m.six_volume - 1.0).abs() < 1e-14);
    // r = 1/(3 + √3), R = √3/2.
    let ratio = 3.0 / (3.0 + 3f64.sqrt()) / (3f64.sqrt() / 2.0);
    assert!((radius_ratio(corner()) - ratio).abs() < 1e-14);
}

/// One point four times has no shape, and its quality is 0, not a value that is no number.
#[test]
fn a_point_has_no_quality() {
    let m = measures([p(1.0, 2.0, 3.0); 4]);
    assert_eq!((m.joe_liu, m.six_volume), (0.0, 0.0));
    assert_eq!((m.min_dihedral, m.max_dihedral), (0.0, 180.0));
}

#[test]
fn slivers_inverted_and_degenerate_ones_have_their_signs() {
    let sliver = [
        p(0.0, 0.0, 0.0),
        p(1.0, 1.0, 0.0),
        p(1.0, 0.0, 1e-6),
        p(0.0, 1.0, 1e-6),
    ];
    let sliver = if six_volume(sliver) > 0.0 {
        sliver
    } else {
        [sliver[1], sliver[0], sliver[2], sliver[3]]
    };
    let m = measures(sliver);
    assert!(m.min_dihedral > 0.0 && m.min_dihedral < 1e-3 && m.max_dihedral > 179.99);
    let [a, b, c, d] = corner();
    let m = measures([b, a, c, d]);
    assert_eq!((m.min_dihedral, m.max_dihedral), (0.0, 180.0));
    assert!(m.joe_liu < 0.0 && inside::quality([b, a, c, d]) < 0.0);
    let m = measures([a, a, c, d]);
    assert!(m.joe_liu == 0.0 && m.edge_ratio.is_infinite());
    for flat in [[a; 4], [a, a, c, d], [a, b, c, p(0.5, 0.5, 0.0)]] {
        assert_eq!(inside::quality(flat), 0.0);
        assert_eq!(radius_ratio(flat), 0.0);
        assert!(aspect_ratio(flat).is_infinite());
    }
}

#[test]
fn units_do_not_matter() {
    for scale in [1e-60, 1e-3, 1.0, 1e60] {
        let scaled = corner().map(|c| c * scale);
        assert!((inside::quality(scaled) - inside::quality(corner())).abs() < 1e-12);
        assert!((measures(scaled).min_dihedral - measures(corner()).min_dihedral).abs() < 1e-9);
    }
}
