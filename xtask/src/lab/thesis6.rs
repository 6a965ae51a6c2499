//! `cargo xtask thesis 6`: correspondences of two poses of one molecule against where its atoms went. The second pose is
//! turned at random first, so that nothing is given but the shapes. The thesis shows such pairs without a measure; what
//! is asked for here are the errors of a prototype. Errors are those of partners, which lie on the lattice; beside them
//! those of the places between lattice points, and those of the one rigid motion that is nearest to the truth, which no
//! method without bending can beat.

use std::time::Instant;

use gauss_density::{Levels, Model, Options, sample};
use geom_core::compute::random::SplitMix64;
use geom_core::io::structure::{ReadOptions, read};
use geom_core::nalgebra::{Quaternion, UnitQuaternion};
use geom_core::search::nearest::PointTree;
use geom_core::{Cpu, Point3, Run, Structure};
use spectral_corresp::fit::superpose;
use spectral_corresp::{MatchOptions, ShapeOptions, Truth, TruthReport, VoxelShape, correspond};

use super::text;
use crate::Outcome;

/// Distance of lattice points, Å, and decay of the atoms' kernel, 1/Å².
const SPACING: f64 = 1.5;
const DECAY: f64 = 0.3;

/// The pairs, and the mean error that is asked for, Å.
const PAIRS: &[(&str, &str, &str, f64)] = &[
    (
        "AdK open → closed",
        "adk/adk_open.pdb",
        "adk/adk_closed.pdb",
        2.2,
    ),
    (
        "AdK closed → open",
        "adk/adk_closed.pdb",
        "adk/adk_open.pdb",
        3.0,
    ),
    (
        "1MAH free → bound",
        "bm5/1MAH_r_u.common.pdb",
        "bm5/1MAH_r_b.common.pdb",
        3.7,
    ),
    (
        "1JMO free → bound",
        "bm5/1JMO_r_u.common.pdb",
        "bm5/1JMO_r_b.common.pdb",
        3.7,
    ),
    (
        "2I9B free → bound",
        "bm5/2I9B_r_u.common.pdb",
        "bm5/2I9B_r_b.common.pdb",
        3.7,
    ),
    (
        "1IBR free → bound",
        "bm5/1IBR_r_u.common.pdb",
        "bm5/1IBR_r_b.common.pdb",
        3.7,
    ),
    (
        "1BKD free → bound",
        "bm5/1BKD_l_u.common.pdb",
        "bm5/1BKD_l_b.common.pdb",
        3.7,
    ),
];

pub(crate) fn run() -> Outcome {
    println!(
        "| pair | boundary nodes | J, Å | verdict | mean, Å | asked | median | floor | < 3 Å | < 5 Å | places: mean, Å | < 3 Å | rigid: mean, Å | < 3 Å | from | s |"
    );
    println!("|---|---|---|---|---|---|---|---|---|---|---|---|---|---|---|---|");
    for &(name, from, to, asked) in PAIRS {
        let (Some(a), Some(b)) = (structure(from)?, structure(to)?) else {
            continue;
        };
        let b = turned(b);
        let (first, second) = (shape(&a)?, shape(&b)?);
        let clock = Instant::now();
        let found =
            correspond(&first, &second, &MatchOptions::default(), Run::on(&Cpu)).map_err(text)?;
        let seconds = clock.elapsed().as_secs_f64();
        let points =
            |s: &Structure| -> Vec<Point3> { s.atoms().iter().map(|a| a.position).collect() };
        let radii: Vec<f64> = a.atoms().iter().map(|a| a.radius).collect();
        let truth = Truth::new(&points(&a), &radii, &points(&b)).map_err(text)?;
        let judged = truth.judge(&first, &second, &found.forward).map_err(text)?;
        let places = truth.judge_places(&first, &second, &found.places(&second));
        let places = places.map_err(text)?;
        let rigid = rigid(&truth, &first, &second)?;
        println!(
            "| {name} | {} → {} | {:.2} | {:?} | {:.2} | {asked} | {:.2} | {:.2} | {:.3} | {:.2} | {:.2} | {:.3} | {:.2} | {:.3} | {}{} | {seconds:.1} |",
            first.boundary().len(),
            second.boundary().len(),
            found.score,
            found.verdict,
            judged.mean,
            judged.median,
            judged.floor,
            judged.within_3,
            judged.within_5,
            places.mean,
            places.within_3,
            rigid.mean,
            rigid.within_3,
            found.candidates[0].name,
            if found.turned { ", turned round" } else { "" },
        );
    }
    Ok(())
}

/// How far the rigid motion nearest to the truth is from it, with the nearest nodes as partners.
fn rigid(truth: &Truth, first: &VoxelShape, second: &VoxelShape) -> Result<TruthReport, String> {
    let points = first.boundary_points().iter();
    let pairs: Vec<(Point3, Point3)> = points.map(|p| (*p, truth.image(p))).collect();
    let motion = superpose(&pairs);
    let there = PointTree::of_positions(second.boundary_points()).map_err(text)?;
    let nearest = |(p, _): &(Point3, Point3)| {
        let x = motion.of(p);
        there.nearest(&[x.x, x.y, x.z], 1).first().map(|n| n.index)
    };
    let partners: Vec<u32> = pairs.iter().filter_map(nearest).collect();
    truth.judge(first, second, &partners).map_err(text)
}

fn structure(file: &str) -> Result<Option<Structure>, String> {
    let Some(path) = fixtures::shared(&format!("corresp/{file}")) else {
        println!("  {file}: not at hand, row left out");
        return Ok(None);
    };
    let heavy = ReadOptions {
        hydrogens: false,
        ..ReadOptions::default()
    };
    Ok(Some(read(&path, &heavy).map_err(text)?.structure))
}

fn turned(mut structure: Structure) -> Structure {
    let mut random = SplitMix64::new(1);
    let mut draw = || random.symmetric();
    let q = Quaternion::new(draw(), draw(), draw(), draw());
    let rotation = UnitQuaternion::from_quaternion(q);
    for atom in structure.atoms_mut() {
        atom.position = rotation * atom.position;
    }
    structure
}

fn shape(structure: &Structure) -> Result<VoxelShape, String> {
    let levels = Levels {
        decay: DECAY,
        ..Levels::default()
    };
    let model = Model::uniform(structure, &levels).map_err(text)?;
    let options = Options {
        spacing: SPACING,
        ..Options::default()
    };
    let grid = sample(&model, &options, Run::on(&Cpu)).map_err(text)?.grid;
    VoxelShape::of_grid(&grid, 1.0, &ShapeOptions::default()).map_err(text)
}
