//! What must hold for all inputs.

use geom_core::{Cpu, ImplicitField, Run};
use tet_quality::testing::{ball_in_box, lattice, shaken};
use tet_quality::{Options, improve, quality_report};

#[test]
fn a_shaken_lattice_is_healed() {
    let mesh = shaken(lattice([8; 3], 1.0, |_| 1), 0.28, 7);
    assert!(quality_report(&mesh).all.min_dihedral.min < 1.0);
    let improved = improve(mesh, None, &Options::default(), Run::on(&Cpu)).unwrap();
    let after = &improved.report.after.all;
    assert_eq!(after.inverted, 0);
    assert!((after.volume - 512.0).abs() < 1e-9);
    assert!(after.min_dihedral.min >= 20.0 && improved.report.converged);
}

#[test]
fn a_ball_in_a_box_is_healed() {
    let (mesh, ball) = ball_in_box(12, 1.0, 4.3);
    let field: &dyn ImplicitField = &ball;
    let improved = improve(mesh, Some(field), &Options::default(), Run::on(&Cpu)).unwrap();
    let (before, after) = (&improved.report.before.all, &improved.report.after.all);
    assert_eq!(after.inverted, 0);
    assert!((after.volume - 1728.0).abs() < 1e-9);
    assert!(before.min_dihedral.min < 1.0 && after.min_dihedral.min >= 10.0);
    assert_eq!(improved.report.after, quality_report(&improved.mesh));
}
