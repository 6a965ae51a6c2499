//! `cargo xtask spectra`: our eigenpairs beside those of SciPy on the same matrices, in one run: largest
//! difference of the eigenvalues and ratios of time; with `--large` also what large inputs cost.

use std::ops::ControlFlow;
use std::path::Path;
use std::sync::Mutex;
use std::time::Instant;

use gauss_density::{Levels, Model, sample};
use geom_core::algebra::eigen::{EigenPairs, Operator, Options, eigenpairs};
use geom_core::algebra::graph::{Laplacian, Neighbours, VoxelGraph};
use geom_core::algebra::{SparseMatrix, Symbolic};
use geom_core::io::structure::{ReadOptions, read};
use geom_core::surface::laplace::{self, Mass};
use geom_core::{Cpu, LatticeValues, Run, ScalarGrid, TriMesh};

use super::{number, python, text};
use crate::{Outcome, fixtures, root};

/// Relative difference of eigenvalues that is still agreement; the first value that is not zero lends
/// its size to the zeros.
const AGREE: f64 = 1e-8;

pub(crate) fn run(large: bool) -> Outcome {
    let python = match python::with(&["numpy", "scipy", "cvxopt"]) {
        Ok(python) => python,
        Err(_) => {
            println!("CHOLMOD (of cvxopt) cannot be installed: SciPy with SuperLU only");
            python::with(&["numpy", "scipy"])?
        }
    };
    println!("{} threads", rayon::current_num_threads());
    let mut worst: f64 = 0.0;
    match fixtures::shared("meshes") {
        Some(folder) => {
            let mut files: Vec<_> = std::fs::read_dir(&folder)
                .map_err(|e| format!("{}: {e}", folder.display()))?
                .filter_map(|entry| Some(entry.ok()?.path()))
                .filter(|path| path.extension().is_some_and(|e| e != "tsv"))
                .collect();
            files.sort();
            for path in files {
                let file = geom_core::io::mesh::read(&path).map_err(text)?;
                let name = path.file_name().unwrap_or_default().to_string_lossy();
                let mesh = file.mesh.into_triangles();
                worst = worst.max(compare(&name, &mesh, "superlu", &[0], &[40], &python)?);
            }
        }
        None => println!("the larger data set is not at hand: only the bundled structure"),
    }
    let mut sizes = vec![10_000, 17_500, 26_000, 50_000];
    if large {
        sizes.push(200_000);
    }
    for vertices in sizes {
        let mesh = protein_surface(vertices)?;
        // As SciPy comes, with a thread of its dense products on each core, and with one: threads that
        // wait count as CPU seconds.
        worst = worst.max(compare(
            "protein surface",
            &mesh,
            "superlu,cholmod",
            &[0, 1],
            &[10, 30, 100],
            &python,
        )?);
    }
    println!("largest difference of an eigenvalue, relative: {worst:.1e}");
    if large {
        for (vertices, count) in [(200_000, 50), (500_000, 100)] {
            let mesh = protein_surface(vertices)?;
            let (stiffness, mass) = operators(&mesh)?;
            cost("protein surface", (&stiffness).into(), &mass, count)?;
        }
        for nodes in [200_000, 1_000_000] {
            let laplacian = protein_voxels(nodes)?;
            let mass = laplacian.degree_mass();
            cost(
                "normalized 18-neighbour voxel graph",
                (&laplacian).into(),
                &mass,
                10,
            )?;
        }
    }
    if worst > AGREE {
        return Err(format!(
            "eigenvalues differ by {worst:.1e}, more than {AGREE:.0e}"
        ));
    }
    Ok(())
}

/// The plain operators, or the robust ones where a triangle has no area.
fn operators(mesh: &TriMesh) -> Result<(SparseMatrix, Mass), String> {
    match laplace::stiffness(mesh) {
        Ok(stiffness) => Ok((stiffness, laplace::lumped_mass(mesh))),
        Err(laplace::Error::Degenerate { .. }) => {
            let robust = laplace::robust(mesh).map_err(text)?;
            Ok((robust.stiffness, robust.mass))
        }
        Err(error) => Err(error.to_string()),
    }
}

/// Ours and SciPy's, for each count; the largest relative difference of an eigenvalue.
fn compare(
    name: &str,
    mesh: &TriMesh,
    solvers: &str,
    threads: &[usize],
    counts: &[usize],
    python: &Path,
) -> Result<f64, String> {
    let (stiffness, mass) = operators(mesh)?;
    let Mass::Lumped(masses) = &mass else {
        return Err("a lumped mass".into());
    };
    // By files: both sides solve the same bits, so what differs is the solver.
    let folder = root().join("target/spectra");
    write_pencil(&folder, &stiffness, masses)?;

    // K is singular: a shift below its zeros keeps the shifted matrix positive definite, as CHOLMOD wants.
    // The mean eigenvalue over the number of rows, below zero: of the size of the first ones.
    let trace: f64 = stiffness.diagonal().iter().sum();
    let shift = -trace / masses.iter().sum::<f64>() / masses.len() as f64;
    let script = root().join("xtask/src/lab/peers/eigsh.py");
    let mut answers = Vec::new();
    // A process per setting: NumPy reads the number of threads when it is loaded.
    for &threads in threads {
        let mut arguments = vec![
            folder.display().to_string(),
            shift.to_string(),
            solvers.to_owned(),
            threads.to_string(),
        ];
        arguments.extend(counts.iter().map(ToString::to_string));
        let answer = super::answer(python, &script, &arguments)?;
        let list = answer.as_array().ok_or("eigsh.py printed no list")?;
        answers.extend(list.iter().map(|a| (threads, a.clone())));
    }

    let mut worst: f64 = 0.0;
    for &count in counts {
        // The fastest of three, as of theirs.
        let mut runs = Vec::new();
        for _ in 0..3 {
            let start = (Instant::now(), cpu_seconds());
            let ours = solve((&stiffness).into(), &mass, count)?;
            runs.push((elapsed(start), ours));
        }
        runs.sort_by(|a, b| a.0.0.total_cmp(&b.0.0));
        let ((wall, cpu), ours) = runs.swap_remove(0);
        // Zeros have no size of their own to be relative to.
        let positive = ours.values.iter().copied().find(|&v| v > 0.0);
        let first = positive.unwrap_or(1.0);
        println!(
            "{name} · {} vertices, {} parts, {count} pairs: {wall:.2} s, {cpu:.2} CPU s, residuals ≤ {:.1e}",
            stiffness.rows(),
            ours.report.parts,
            largest(&ours.residuals),
        );
        split(&stiffness, masses, &mass, shift, count)?;
        for (threads, answer) in answers.iter().filter(|a| a.1["count"] == count) {
            let theirs = answer["values"]
                .as_array()
                .ok_or("eigsh.py printed no values")?;
            if theirs.len() != ours.values.len() {
                let (theirs, ours) = (theirs.len(), ours.values.len());
                return Err(format!("eigsh.py printed {theirs} values, not {ours}"));
            }
            let off = ours.values.iter().zip(theirs).map(|(&a, b)| {
                let b = b
                    .as_f64()
                    .ok_or("eigsh.py printed a value that is no number")?;
                Ok::<f64, String>((a - b).abs() / a.max(first))
            });
            let off = largest(&off.collect::<Result<Vec<_>, _>>()?);
            worst = worst.max(off);
            println!(
                "    SciPy with {}, {}: {:.2} s ({:.1}× ours), {:.2} CPU s ({:.1}× ours), largest difference {off:.1e}",
                answer["solver"].as_str().unwrap_or("?"),
                match threads {
                    0 => "its default threads",
                    _ => "one thread",
                },
                number(answer, "seconds")?,
                number(answer, "seconds")? / wall,
                number(answer, "cpu")?,
                number(answer, "cpu")? / cpu,
            );
        }
    }
    Ok(worst)
}

/// Right-hand sides of one pass over the factor, as many as a block of the default options has.
const PASS: usize = 8;

/// Where the time goes: order and shape of the factor, the factor, and one pass of solves by themselves, the rest by what
/// the solver tells of its stages. Prints wall milliseconds.
fn split(
    stiffness: &SparseMatrix,
    masses: &[f64],
    mass: &Mass,
    shift: f64,
    count: usize,
) -> Outcome {
    let shifted = stiffness
        .plus(-shift, &SparseMatrix::diagonal_of(masses))
        .map_err(text)?;
    let since = |start: Instant| start.elapsed().as_secs_f64() * 1e3;
    let start = Instant::now();
    let symbolic = Symbolic::of(&shifted).map_err(text)?;
    let analysis = since(start);
    let start = Instant::now();
    let factor = symbolic.factor(&shifted).map_err(text)?;
    let numeric = since(start);
    let mut block = vec![1.0; masses.len() * PASS];
    let mut pass = f64::INFINITY;
    for _ in 0..3 {
        let start = Instant::now();
        factor.solve_in_place(&mut block, PASS).map_err(text)?;
        pass = pass.min(since(start));
    }
    let stages = Mutex::new(Vec::new());
    let note = |stage: &'static str, done: u64, _: u64| {
        let mut stages = stages.lock().unwrap_or_else(|held| held.into_inner());
        stages.push((stage, done, Instant::now()));
        ControlFlow::Continue(())
    };
    let run = Run::on(&Cpu).watched_by(&note);
    let pairs = eigenpairs(stiffness, mass, count, &Options::default(), run).map_err(text)?;
    let end = Instant::now();
    let stages = stages.into_inner().unwrap_or_else(|held| held.into_inner());
    // Each connected part has a factor, then the iteration, then its vectors.
    let (mut iteration, mut vectors) = (0.0, 0.0);
    let mut ends = stages.iter().skip(1).map(|s| s.2).chain([end]);
    for &(stage, done, from) in &stages {
        let Some(to) = ends.next() else { break };
        let took = to.duration_since(from).as_secs_f64() * 1e3;
        match (stage, done) {
            ("vectors", _) => vectors += took,
            // The first step comes right after the factor.
            ("eigenpairs", _) | ("factor", 1) => iteration += took,
            _ => {}
        }
    }
    let solves = pairs.report.solves as f64 / PASS as f64 * pass;
    println!(
        "    order and shape {analysis:.1} ms, factor of {} entries {numeric:.1}, {} solves {solves:.1}, \
         the rest of the iteration {:.1}, vectors and residuals {vectors:.1}",
        symbolic.factor_entries(),
        pairs.report.solves,
        iteration - solves,
    );
    Ok(())
}

/// Stiffness (rows' starts, columns, values) and lumped masses in files that NumPy reads.
fn write_pencil(folder: &Path, stiffness: &SparseMatrix, masses: &[f64]) -> Outcome {
    fn bytes<const N: usize>(numbers: impl Iterator<Item = [u8; N]>) -> Vec<u8> {
        numbers.flatten().collect()
    }
    std::fs::create_dir_all(folder).map_err(text)?;
    let starts = stiffness.starts().iter().map(|&s| (s as u64).to_le_bytes());
    for (file, bytes) in [
        ("starts.u64", bytes(starts)),
        (
            "indices.u32",
            bytes(stiffness.indices().iter().map(|i| i.to_le_bytes())),
        ),
        (
            "values.f64",
            bytes(stiffness.values().iter().map(|v| v.to_le_bytes())),
        ),
        ("mass.f64", bytes(masses.iter().map(|m| m.to_le_bytes()))),
    ] {
        std::fs::write(folder.join(file), bytes).map_err(text)?;
    }
    Ok(())
}

fn solve(stiffness: Operator<'_>, mass: &Mass, count: usize) -> Result<EigenPairs, String> {
    let pairs =
        eigenpairs(stiffness, mass, count, &Options::default(), Run::on(&Cpu)).map_err(text)?;
    if !pairs.report.converged {
        return Err(format!("residuals up to {:.1e}", largest(&pairs.residuals)));
    }
    Ok(pairs)
}

/// What a large problem costs.
fn cost(name: &str, stiffness: Operator<'_>, mass: &Mass, count: usize) -> Outcome {
    let start = (Instant::now(), cpu_seconds());
    let pairs = solve(stiffness, mass, count)?;
    let (wall, cpu) = elapsed(start);
    println!(
        "{name} · {} rows, {} parts, {count} pairs: {wall:.1} s, {cpu:.1} CPU s, residuals ≤ {:.1e}, \
         {} factor entries, {} solves, peak memory so far {}",
        stiffness.rows(),
        pairs.report.parts,
        largest(&pairs.residuals),
        pairs.report.factor_entries,
        pairs.report.solves,
        peak_memory(),
    );
    Ok(())
}

fn density(spacing: f64) -> Result<ScalarGrid, String> {
    let structure = read(fixtures::path("1A8O.pdb"), &ReadOptions::default())
        .map_err(text)?
        .structure;
    let model = Model::uniform(&structure, &Levels::default()).map_err(text)?;
    let options = gauss_density::Options {
        spacing,
        max_memory: 4 << 30,
        ..gauss_density::Options::default()
    };
    let sampled = sample(&model, &options, Run::on(&Cpu)).map_err(text)?;
    Ok(sampled.grid)
}

/// The surface of a small protein with about so many vertices.
fn protein_surface(vertices: usize) -> Result<TriMesh, String> {
    let surface = |spacing: f64| {
        let grid = density(spacing)?;
        dual_contour::surface(
            &grid,
            None,
            &dual_contour::Options::default(),
            Run::on(&Cpu),
        )
        .map(|s| s.mesh)
        .map_err(text)
    };
    // Vertices grow with the square of the fineness.
    let coarse = surface(0.5)?;
    let share = coarse.positions().len() as f64 / vertices as f64;
    surface(0.5 * share.sqrt())
}

/// The normalized graph of the points inside of a small protein, about so many.
fn protein_voxels(nodes: usize) -> Result<Laplacian, String> {
    let inside =
        |grid: &ScalarGrid| -> Vec<bool> { grid.values().iter().map(|&v| v >= 1.0).collect() };
    let coarse = inside(&density(0.5)?).iter().filter(|&&i| i).count();
    let grid = density(0.5 * (coarse as f64 / nodes as f64).cbrt())?;
    let weights = [1.0, 2.0, 3.0].map(|d: f64| (-d).exp());
    let graph = VoxelGraph::new(
        grid.lattice().counts,
        &inside(&grid),
        Neighbours::Eighteen,
        weights,
    )
    .map_err(text)?;
    Ok(Laplacian::of_voxels(graph))
}

fn largest(values: &[f64]) -> f64 {
    values.iter().fold(0.0, |m, &v| if v <= m { m } else { v })
}

fn elapsed((wall, cpu): (Instant, f64)) -> (f64, f64) {
    (wall.elapsed().as_secs_f64(), cpu_seconds() - cpu)
}

/// Seconds of all threads, where the system says so (Linux), else NaN.
fn cpu_seconds() -> f64 {
    let ticks = || -> Option<f64> {
        let line = std::fs::read_to_string("/proc/self/stat").ok()?;
        let mut fields = line.rsplit(')').next()?.split_whitespace().skip(11);
        let user: f64 = fields.next()?.parse().ok()?;
        let system: f64 = fields.next()?.parse().ok()?;
        Some((user + system) / 100.0)
    };
    ticks().unwrap_or(f64::NAN)
}

/// Most memory that was in use, where the system says so (Linux).
fn peak_memory() -> String {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let peak = status.lines().find_map(|l| l.strip_prefix("VmHWM:"));
    peak.map_or_else(|| "unknown".into(), |p| p.trim().to_owned())
}
