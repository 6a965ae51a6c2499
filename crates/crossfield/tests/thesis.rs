//! What chapter 4 of the thesis says.

use crossfield::field::Frames;
use crossfield::guidance::{Modes, Normalization, guides};
use crossfield::{FieldOptions, Guidance, cross_field};
use geom_core::mesh::shapes;
use geom_core::surface::laplace::{self, EdgeWeights};
use geom_core::{Cpu, Run, TriMesh, Vector3, algebra::eigen};

fn body() -> TriMesh {
    shapes::ellipsoid(Vector3::new(3.0, 1.2, 1.0), 4)
}

/// Eqs. 4.6–4.7: the guided triangles are those through which the two isocontours run.
#[test]
fn isocontours_lie_an_eighth_from_both_ends() {
    let mesh = body();
    let frames = Frames::of(&mesh, EdgeWeights::One).unwrap();
    let guidance = Guidance::Isocontours {
        modes: Modes::Numbers(vec![1]),
        inset: 0.125,
        weight: f64::INFINITY,
    };
    let made = guides(&mesh, &frames, &[guidance]).unwrap();
    let stiffness = laplace::stiffness(&mesh).unwrap();
    let mass = laplace::lumped_mass(&mesh);
    let options = eigen::Options::default();
    let pairs = eigen::eigenpairs(&stiffness, &mass, 2, &options, Run::on(&Cpu)).unwrap();
    let f = &pairs.vectors[1];
    let low = f.iter().copied().fold(f64::INFINITY, f64::min);
    let high = f.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let levels = [0.125, 0.875].map(|part| low + part * (high - low));
    let crossed = |face: usize| {
        let values = mesh.triangles()[face].map(|v| f[v as usize]);
        levels.iter().any(|&l| {
            let above = values.iter().filter(|&&x| x > l).count();
            above == 1 || above == 2
        })
    };
    let wanted: Vec<u32> = (0..mesh.triangles().len())
        .filter(|&f| crossed(f))
        .map(|f| f as u32)
        .collect();
    let named: Vec<u32> = made.iter().map(|g| g.face).collect();
    assert_eq!(named, wanted);
    // The field runs along the gradient there.
    let field = cross_field(&mesh, &made, &FieldOptions::default(), Run::on(&Cpu)).unwrap();
    let gradient = laplace::gradient(&mesh, f).unwrap();
    for guide in &made {
        let face = guide.face as usize;
        let along = gradient[face].normalize();
        let best = field
            .arms(&frames, face)
            .iter()
            .map(|a| a.dot(&along))
            .fold(0.0, f64::max);
        assert!(best > 1.0 - 1e-9, "{best}");
    }
}

/// Eq. 4.8 as printed prefers high modes, since ∫|∇F|² = λ; divided by √λ every mode has its share.
#[test]
fn characteristic_values_are_fair_when_normalized() {
    let mesh = body();
    let frames = Frames::of(&mesh, EdgeWeights::One).unwrap();
    let count = |normalization| {
        let guidance = Guidance::Characteristic {
            modes: Modes::Numbers((1..=6).collect()),
            normalization,
            weight: 1.0,
        };
        guides(&mesh, &frames, &[guidance]).unwrap().len()
    };
    assert!(count(Normalization::Normalized) > 50);
    assert!(count(Normalization::Raw) > 0);
    assert_ne!(count(Normalization::Raw), count(Normalization::Normalized));
}
