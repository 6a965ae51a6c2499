//! `cargo xtask bench`: our density and surface beside programs of others, on the same input, in one
//! run. Times are the best of three and leave out start-up, reading and compilation on both sides.

use std::path::Path;
use std::time::Instant;

use gauss_density::{Levels, Model, Options, Sampled, sample, sample_band};
use geom_core::io::structure::{ReadOptions, read};
use geom_core::{Cpu, LatticeValues, Run, ScalarGrid, Structure};

use super::{answer, number, python};
use crate::{Outcome, root};

const CUT: f64 = 1e-4;

/// Compares on one small and, when it is at hand, one large structure.
pub(crate) fn run() -> Outcome {
    let python = python::with(&["numpy", "numba", "vtk"])?;
    let peers = root().join("xtask/src/lab/peers");
    let threads = rayon::current_num_threads();
    println!("{threads} threads, one level, decay 1, cut {CUT:.0e}; best of three");
    let mut inputs = vec![(fixtures::path("1A8O.pdb"), 0.25)];
    match fixtures::shared("large/30s_from_4v5a.cif.gz") {
        Some(path) => inputs.push((path, 0.8)),
        None => println!("the large structure is not at hand: only the bundled one"),
    }
    let folder = root().join("target/bench-peers");
    std::fs::create_dir_all(&folder).map_err(|e| e.to_string())?;
    for (path, spacing) in inputs {
        let structure = read(&path, &ReadOptions::default())
            .map_err(|e| e.to_string())?
            .structure;
        let dense = density(&structure, spacing, &folder, &python, &peers, threads)?;
        surface(&dense, &folder, &python, &peers, threads)?;
    }
    Ok(())
}

/// One level of Gaussians: our dense lattice and our band against the scatter.
fn density(
    structure: &Structure,
    spacing: f64,
    folder: &Path,
    python: &Path,
    peers: &Path,
    threads: usize,
) -> Result<ScalarGrid, String> {
    // Powers of 1: the plain sum that the scatter computes.
    let levels = Levels {
        residue_power: 1.0,
        decay: 1.0,
        ..Levels::default()
    };
    let model = Model::uniform(structure, &levels).map_err(|e| e.to_string())?;
    let options = Options {
        spacing,
        max_memory: 16 << 30,
        ..Options::default()
    };
    let (dense, dense_s) = best(|| sample(&model, &options, Run::on(&Cpu)))?;
    let (_, band_s) = best(|| sample_band(&model, &options, Run::on(&Cpu)))?;
    let Sampled { grid, report } = dense;

    let atoms = folder.join("atoms.f64");
    let bytes: Vec<u8> = structure
        .atoms()
        .iter()
        .flat_map(|a| [a.position.x, a.position.y, a.position.z, a.radius])
        .flat_map(f64::to_le_bytes)
        .collect();
    std::fs::write(&atoms, bytes).map_err(|e| e.to_string())?;
    let lattice = *grid.lattice();
    let mut arguments = vec![atoms.display().to_string()];
    arguments.extend(lattice.counts.iter().map(ToString::to_string));
    arguments.extend(lattice.origin.iter().map(ToString::to_string));
    arguments.extend([spacing, 1.0, CUT].map(|v| v.to_string()));
    arguments.push(threads.to_string());
    let peer = answer(python, &peers.join("scatter.py"), &arguments)?;
    let seconds = number(&peer, "seconds")?;
    let total: f64 = grid.values().iter().map(|&v| f64::from(v)).sum();
    let apart = number(&peer, "sum")? / total - 1.0;
    if apart.abs() > 5e-3 {
        return Err(format!(
            "the scatter is another function: its sum is {apart:.1e} off"
        ));
    }
    println!(
        "density · {} atoms, {} points: dense {dense_s:.3} s, band {band_s:.3} s; scatter {seconds:.3} s \
         ({:.1}× and {:.1}× ours; sums {apart:+.1e} apart)",
        structure.atoms().len(),
        report.points,
        seconds / dense_s,
        seconds / band_s,
    );
    Ok(grid)
}

/// The surface of the same dense lattice against flying edges, per triangle.
fn surface(
    grid: &ScalarGrid,
    folder: &Path,
    python: &Path,
    peers: &Path,
    threads: usize,
) -> Outcome {
    let options = dual_contour::Options::default();
    let (ours, ours_s) = best(|| dual_contour::surface(grid, None, &options, Run::on(&Cpu)))?;
    let file = folder.join("density.f32");
    let bytes: Vec<u8> = grid.values().iter().flat_map(|v| v.to_le_bytes()).collect();
    std::fs::write(&file, bytes).map_err(|e| e.to_string())?;
    let mut arguments = vec![file.display().to_string()];
    arguments.extend(grid.lattice().counts.iter().map(ToString::to_string));
    arguments.extend(["1".to_string(), threads.to_string()]);
    let peer = answer(python, &peers.join("flying_edges.py"), &arguments)?;
    let (seconds, count) = (number(&peer, "seconds")?, number(&peer, "triangles")?);
    #[expect(clippy::cast_precision_loss, reason = "counts for people")]
    let triangles = ours.mesh.triangles().len() as f64;
    println!(
        "surface · ours {triangles} triangles in {ours_s:.3} s, flying edges {count} in {seconds:.3} s: \
         {:.2}× its time per triangle",
        (ours_s / triangles) / (seconds / count),
    );
    Ok(())
}

/// The last result and the shortest of three times.
fn best<T, E: std::fmt::Display>(
    mut work: impl FnMut() -> Result<T, E>,
) -> Result<(T, f64), String> {
    let mut least = f64::INFINITY;
    let mut last = None;
    for _ in 0..3 {
        let start = Instant::now();
        last = Some(work().map_err(|e| e.to_string())?);
        least = least.min(start.elapsed().as_secs_f64());
    }
    Ok((last.expect("three rounds"), least))
}
