//! `cargo xtask thesis 6`: correspondences of two poses of one molecule against where its atoms went. The second pose is
//! turned at random first, so that nothing is given but the shapes. The thesis shows such pairs without a measure; what
//! is asked for here are the errors of a prototype. Errors are those of partners, which lie on the lattice; beside them
//! those of the places between lattice points, and those of the one rigid motion that is nearest to the truth, which no
//! method without bending can beat.

use std::time::Instant;

use gauss_density::{Cutoff, Levels, Model, Options, PointSampler, sample};
use geom_core::compute::random::SplitMix64;
use geom_core::io::structure::{ReadOptions, read};
use geom_core::nalgebra::{Quaternion, UnitQuaternion};
use geom_core::search::nearest::PointTree;
use geom_core::{Cpu, ImplicitField, Point3, Run, ScalarGrid, Structure};
use rayon::prelude::*;
use spectral_corresp::compare::{cycle_error, distances};
use spectral_corresp::correspond::{Embedding, expected_bytes};
use spectral_corresp::fit::superpose;
use spectral_corresp::{
    CompareOptions, Directions, Frame, Map, MatchOptions, Morph, MorphOptions, ShapeOptions, Truth,
    TruthReport, VoxelShape, correspond,
};

use super::text;
use crate::{Outcome, fixtures};

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

/// All tables of the chapter.
pub(crate) fn run() -> Outcome {
    pairs()?;
    morph()?;
    retrieval()?;
    growth()
}

/// Correspondences against where the atoms went.
pub(crate) fn pairs() -> Outcome {
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
    let partners = pairs.iter().filter_map(nearest).collect();
    let partners = Map::new(first, second, partners).map_err(text)?;
    truth.judge(first, second, &partners).map_err(text)
}

/// The frames of a simulated transition of adenylate kinase.
fn frames(numbers: &[&str]) -> Result<Option<Vec<Structure>>, String> {
    let file = |n: &&str| structure(&format!("adk/dims_{n}.pdb.gz"));
    numbers.iter().map(file).collect()
}

/// Root mean square distance of the same atoms, superposed, Å.
fn rmsd(a: &Structure, b: &Structure) -> f64 {
    let pairs: Vec<(Point3, Point3)> = points(a).into_iter().zip(points(b)).collect();
    let motion = superpose(&pairs);
    let squares: f64 = pairs
        .iter()
        .map(|(p, q)| (motion.of(p) - q).norm_squared())
        .sum();
    (squares / pairs.len().max(1) as f64).sqrt()
}

/// The way from one end of a transition to the other against the frames between.
pub(crate) fn morph() -> Outcome {
    const FRAMES: [&str; 10] = ["00", "10", "20", "30", "40", "50", "60", "70", "80", "97"];
    println!(
        "\nMorph of adenylate kinase; thesis's measure ε_V (Eq. 6.17) against frames of a simulation"
    );
    println!(
        "| progress | first shape unchanged | ours | volume | largest stretch | self-overlap | s |"
    );
    println!("|---|---|---|---|---|---|---|");
    let Some(mut frames) = frames(&FRAMES)? else {
        return Ok(());
    };
    // From the open end, whichever that is in the file.
    if let Some(open) = structure("adk/adk_open.pdb")?
        && frames
            .last()
            .is_some_and(|last| rmsd(last, &open) < rmsd(&frames[0], &open))
    {
        frames.reverse();
    }
    let (Some(from), Some(to)) = (frames.first(), frames.last()) else {
        return Ok(());
    };
    let (first, second) = (shape(from)?, shape(to)?);
    let run = Run::on(&Cpu);
    let found = correspond(&first, &second, &MatchOptions::default(), run).map_err(text)?;
    let morph = Morph::new(&first, &second, &found, &MorphOptions::default(), run).map_err(text)?;
    let still = morph.frame(0.0, run).map_err(text)?;
    for real in &frames[1..] {
        let (before, after) = (rmsd(from, real), rmsd(real, to));
        let t = before / (before + after);
        let model = model(real)?;
        let field = PointSampler::new(&model, Cutoff::default()).map_err(text)?;
        let bounds = model.center_bounds().inflated(8.0);
        let against = |frame: &Frame| {
            let inside = |p: &[Point3]| {
                Ok::<_, spectral_corresp::Error>(
                    p.par_iter().map(|p| field.value(p) >= 1.0).collect(),
                )
            };
            frame.overlap(&bounds, inside).map_err(text)
        };
        let clock = Instant::now();
        let frame = morph.frame(t, run).map_err(text)?;
        let seconds = clock.elapsed().as_secs_f64();
        println!(
            "| {t:.2} | {:.3} | {:.3} | {:.3} | {:.2} | {:.3} | {seconds:.2} |",
            against(&still)?.epsilon,
            against(&frame)?.epsilon,
            against(&frame)?.volume_ratio,
            frame.report.largest_stretch,
            frame.report.self_overlap,
        );
    }
    Ok(())
}

/// Distances of shapes of three molecules in several poses: are poses nearer to each other than molecules? And where nodes
/// end that are sent round through three poses.
pub(crate) fn retrieval() -> Outcome {
    const BODIES: [(&str, &str); 7] = [
        ("AdK", "adk/adk_open.pdb"),
        ("AdK", "adk/dims_50.pdb.gz"),
        ("AdK", "adk/adk_closed.pdb"),
        ("Ran", "bm5/1IBR_r_u.common.pdb"),
        ("Ran", "bm5/1IBR_r_b.common.pdb"),
        ("Ras", "bm5/1BKD_l_u.common.pdb"),
        ("Ras", "bm5/1BKD_l_b.common.pdb"),
    ];
    println!("\nRetrieval: distances of shapes, Å");
    let mut shapes = Vec::new();
    for (_, file) in BODIES {
        let Some(body) = structure(file)? else {
            return Ok(());
        };
        shapes.push(shape(&turned(body))?);
    }
    let shapes: Vec<&VoxelShape> = shapes.iter().collect();
    let n = shapes.len();
    // Maps both ways come from one search one way, which is enough to tell molecules apart.
    let options = MatchOptions {
        directions: Directions::Forward,
        ..MatchOptions::default()
    };
    let mut maps = vec![None; n * n];
    for i in 0..n {
        for j in i + 1..n {
            let run = Run::on(&Cpu);
            let found = correspond(shapes[i], shapes[j], &options, run).map_err(text)?;
            (maps[i * n + j], maps[j * n + i]) = (Some(found.forward), Some(found.backward));
        }
    }
    let options = CompareOptions::default();
    let map = |i: usize, j: usize| {
        maps[i * n + j]
            .clone()
            .ok_or(spectral_corresp::Error::Direction)
    };
    let all = distances(&shapes, map, &options, Run::on(&Cpu)).map_err(text)?;
    println!("| | {} |", BODIES.map(|b| b.0).join(" | "));
    println!("|---|{}", "---|".repeat(n));
    // The table, and whether the nearest other shape is a pose of the same molecule.
    let mut right = 0;
    for (i, row) in all.chunks(n).enumerate() {
        let numbers: Vec<String> = row.iter().map(|d| format!("{d:.2}")).collect();
        println!("| {} | {} |", BODIES[i].0, numbers.join(" | "));
        let others = (0..n).filter(|j| *j != i);
        let nearest = others.min_by(|&j, &k| row[j].total_cmp(&row[k]));
        right += usize::from(nearest.is_some_and(|j| BODIES[j].0 == BODIES[i].0));
    }
    println!("{right} of {n} are nearest to another pose of the same molecule");
    // Right maps lead back to where they began.
    let round: Vec<&Map> = [1, n + 2, 2 * n]
        .iter()
        .filter_map(|&k| maps[k].as_ref())
        .collect();
    let error = cycle_error(&shapes[..3], &round).map_err(text)?;
    println!(
        "round through the three poses of AdK: mean {:.2} Å, 95 % within {:.2} Å",
        error.mean, error.p95
    );
    Ok(())
}

/// Time and memory up to a million nodes.
pub(crate) fn growth() -> Outcome {
    const SPACINGS: [f64; 5] = [1.5, 1.0, 0.75, 0.55, 0.42];
    /// Control nodes of the embedded deformation.
    const CONTROL: usize = 8000;
    println!("\nGrowth: acetylcholinesterase at finer and finer spacings");
    println!(
        "| spacing, Å | nodes | boundary | shape, s | 10 modes, s | all nodes follow {CONTROL}, s | peak of all so far, bytes per node |"
    );
    println!("|---|---|---|---|---|---|---|");
    let Some(body) = structure("bm5/1MAH_r_u.common.pdb")? else {
        return Ok(());
    };
    for spacing in SPACINGS {
        let grid = density(&body, spacing)?;
        let mut clock = Instant::now();
        let mut lap = || {
            std::mem::replace(&mut clock, Instant::now())
                .elapsed()
                .as_secs_f64()
        };
        let shape = VoxelShape::of_grid(&grid, 1.0, &ShapeOptions::default(), Run::on(&Cpu))
            .map_err(text)?;
        let made = lap();
        shape.modes(10, Run::on(&Cpu)).map_err(text)?;
        let modes = lap();
        let step = shape.boundary().len().div_ceil(CONTROL);
        let control: Vec<Point3> = shape
            .boundary_points()
            .iter()
            .step_by(step)
            .copied()
            .collect();
        let nodes: Vec<Point3> = (0..shape.nodes()).map(|i| shape.position(i)).collect();
        Embedding::new(&control, &control, &[])
            .map_err(text)?
            .of(&nodes);
        let followed = lap();
        let peak = peak_bytes().map_or("–".to_owned(), |b| (b / shape.nodes()).to_string());
        println!(
            "| {spacing} | {} | {} | {made:.2} | {modes:.2} | {followed:.2} | {peak} |",
            shape.nodes(),
            shape.boundary().len(),
        );
    }
    let Some(other) = structure("bm5/1MAH_r_b.common.pdb")? else {
        return Ok(());
    };
    // About 50,000 nodes each.
    let [first, second] = [&body, &turned(other)].map(|s| {
        let grid = density(s, 1.2)?;
        VoxelShape::of_grid(&grid, 1.0, &ShapeOptions::default(), Run::on(&Cpu)).map_err(text)
    });
    let (first, second) = (first?, second?);
    let clock = Instant::now();
    let found = correspond(&first, &second, &MatchOptions::default(), Run::on(&Cpu));
    let found = found.map_err(text)?;
    println!(
        "match of {} and {} nodes: {:.1} s, J {:.2} Å, {:?}; {} bytes expected",
        first.nodes(),
        second.nodes(),
        clock.elapsed().as_secs_f64(),
        found.score,
        found.verdict,
        expected_bytes(&first, &second),
    );
    Ok(())
}

/// The most memory that this process has held, where the system says.
fn peak_bytes() -> Option<usize> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|l| l.strip_prefix("VmHWM:"))?;
    let kilobytes: usize = line.split_whitespace().next()?.parse().ok()?;
    Some(kilobytes * 1024)
}

fn points(structure: &Structure) -> Vec<Point3> {
    structure.atoms().iter().map(|a| a.position).collect()
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

fn model(structure: &Structure) -> Result<Model, String> {
    let levels = Levels {
        decay: DECAY,
        ..Levels::default()
    };
    Model::uniform(structure, &levels).map_err(text)
}

fn density(structure: &Structure, spacing: f64) -> Result<ScalarGrid, String> {
    let options = Options {
        spacing,
        ..Options::default()
    };
    let sampled = sample(&model(structure)?, &options, Run::on(&Cpu));
    Ok(sampled.map_err(text)?.grid)
}

fn shape(structure: &Structure) -> Result<VoxelShape, String> {
    let grid = density(structure, SPACING)?;
    VoxelShape::of_grid(&grid, 1.0, &ShapeOptions::default(), Run::on(&Cpu)).map_err(text)
}
