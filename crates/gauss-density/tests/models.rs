//! Trees of atoms and their powers, and what they sum to.

use gauss_density::specification::nested_sum;
use gauss_density::{Error, Levels, Model, inside};
use geom_core::Point3;

#[test]
fn levels_of_power_one_merge() {
    let centers = vec![Point3::origin(); 6];
    let tree = |a: f64, b: f64, c: f64| {
        vec![
            (vec![0, 2, 3, 6], vec![a; 3]),
            (vec![0, 1, 3], vec![b; 2]),
            (vec![0, 2], vec![c]),
        ]
    };
    let model =
        |a, b, c| Model::new(centers.clone(), vec![1.0; 6], vec![1.0; 6], tree(a, b, c)).unwrap();
    assert!(inside::compiled_levels(&model(1.0, 1.0, 1.0)).is_empty());
    let levels = inside::compiled_levels(&model(1.0, 0.5, 1.0));
    assert_eq!(levels.len(), 1);
    assert_eq!(inside::first_child(&levels[0]), [0, 2, 6]);
    let levels = inside::compiled_levels(&model(0.5, 1.0, 0.3));
    assert_eq!(levels.len(), 2);
    assert_eq!(inside::first_child(&levels[1]), [0, 3]);
}

#[test]
fn emphasis_reaches_whole_nodes_only() {
    let tree = vec![
        (vec![0, 2, 3, 6], vec![0.5; 3]),
        (vec![0, 1, 3], vec![0.5; 2]),
    ];
    let mut model =
        Model::new(vec![Point3::origin(); 6], vec![1.0; 6], vec![1.0; 6], tree).unwrap();
    let strong = Levels {
        residue_power: 2.0,
        chain_power: 3.0,
        ..Levels::default()
    };
    model.emphasize([0, 1, 2], &strong).unwrap();
    assert_eq!(model.levels()[0].powers(), [2.0, 2.0, 0.5]);
    assert_eq!(model.levels()[1].powers(), [3.0, 0.5]);
    assert!(model.emphasize([6], &strong).is_err());
}

#[test]
fn one_power_is_set_and_what_does_not_exist_is_named() {
    let tree = vec![
        (vec![0, 2, 3, 6], vec![0.5; 3]),
        (vec![0, 1, 3], vec![0.5; 2]),
    ];
    let centers = vec![Point3::origin(); 6];
    let mut model = Model::new(centers, vec![1.0; 6], vec![1.0; 6], tree).unwrap();
    model.set_power(0, 2, 0.25).unwrap();
    model.set_power(1, 0, 3.0).unwrap();
    assert_eq!(model.levels()[0].powers(), [0.5, 0.5, 0.25]);
    assert_eq!(model.levels()[1].powers(), [3.0, 0.5]);
    let before = model.clone();
    let none = |what, index, count| Err(Error::NoSuchNode { what, index, count });
    assert_eq!(model.set_power(2, 0, 1.0), none("level", 2, 2));
    assert_eq!(model.set_power(1, 2, 1.0), none("node", 2, 2));
    for power in [0.0, f64::NAN, 65.0] {
        let error = model.set_power(0, 0, power).unwrap_err();
        assert!(matches!(error, Error::Option(out) if out.option == "power"));
    }
    assert_eq!(model, before);
}

#[test]
fn only_small_radii_are_raised() {
    let radii = vec![0.0, 1.0, 2.5];
    let mut model = Model::new(vec![Point3::origin(); 3], radii, vec![1.0; 3], vec![]).unwrap();
    model.raise_radii(1.2).unwrap();
    assert_eq!(model.radii(), [1.2, 1.2, 2.5]);
    for radius in [-1.0, f64::NAN, 2e4] {
        let error = model.raise_radii(radius).unwrap_err();
        assert!(matches!(error, Error::Option(out) if out.option == "min_radius"));
    }
    assert_eq!(model.radii(), [1.2, 1.2, 2.5]);
}

/// n coincident atoms that meet below a level: `d² = r² + ln n / (κ Π powers below)`.
#[test]
fn coincident_atoms_give_the_closed_form_at_every_level() {
    let (r, kappa, p) = (1.7, 0.8, [0.5, 0.3, 1.7]);
    for n in [2u32, 5, 40] {
        for meet in 0..=3usize {
            // On level l: one node for all below `meet` levels, else one node per atom.
            let tree = (0..3)
                .map(|l| {
                    if l < meet {
                        ((0..=n).collect(), vec![p[l]; n as usize])
                    } else if l == meet {
                        (vec![0, n], vec![p[l]])
                    } else {
                        (vec![0, 1], vec![p[l]])
                    }
                })
                .collect();
            let (centers, radii) = (vec![Point3::origin(); n as usize], vec![r; n as usize]);
            let model = Model::new(centers, radii, vec![kappa; n as usize], tree).unwrap();
            let below: f64 = p[..meet].iter().product();
            let d = (r * r + f64::from(n).ln() / (kappa * below)).sqrt();
            let g = nested_sum(&model, &Point3::new(d, 0.0, 0.0));
            assert!((g - 1.0).abs() < 1e-13, "{n} atoms, level {meet}: {g}");
        }
    }
}

#[test]
fn one_atom_is_a_sphere_of_its_radius_for_every_decay_and_power() {
    for kappa in [0.1, 1.0, 5.0] {
        for power in [0.05, 0.5, 1.0, 3.0] {
            let tree = vec![(vec![0, 1], vec![power]); 2];
            let model = Model::new(vec![Point3::origin()], vec![1.7], vec![kappa], tree).unwrap();
            let g = nested_sum(&model, &Point3::new(0.0, 1.7, 0.0));
            assert!((g - 1.0).abs() < 1e-14);
        }
    }
}
