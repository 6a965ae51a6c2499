//! Table 3.5: the time of all steps and the quality of the meshes, on the structures at hand, in all modes that
//! the machine has, beside the thesis's rows of the same class.

use std::time::Instant;

use dual_contour::{ContourBackend, Extent, Method};
use gauss_density::{Cutoff, DensityBackend, Levels, Model, PointSampler};
use geom_core::io::structure::{ReadOptions, read};
use geom_core::{Cpu, Run, Structure, Wgpu};
use tet_quality::{Improved, QualityBackend};

use super::text;
use crate::{Outcome, fixtures};

/// Ours: a file of the larger data set, how it is read and meshed.
struct Case {
    name: &'static str,
    file: &'static str,
    assembly: Option<&'static str>,
    residue_power: f64,
    chain_power: f64,
    region: Extent,
    /// Å; chosen for about a million tetrahedra.
    spacing: f64,
    method: Method,
}

const CASES: [Case; 5] = [
    Case {
        name: "1SU4 (the protein of CERCA), exterior",
        file: "pdb/1su4.pdb",
        assembly: None,
        residue_power: 0.2,
        chain_power: 0.8,
        region: Extent::Exterior,
        spacing: 1.6,
        method: Method::DualContour,
    },
    Case {
        name: "1SU4, interior",
        file: "pdb/1su4.pdb",
        assembly: None,
        residue_power: 0.5,
        chain_power: 1.0,
        region: Extent::Interior,
        spacing: 1.0,
        method: Method::DualContour,
    },
    Case {
        name: "1SU4, interior",
        file: "pdb/1su4.pdb",
        assembly: None,
        residue_power: 0.5,
        chain_power: 1.0,
        region: Extent::Interior,
        spacing: 1.2,
        method: Method::Stuffing,
    },
    Case {
        name: "30S (class of 2W4U), interior",
        file: "large/30s_from_4v5a.cif.gz",
        assembly: None,
        residue_power: 0.25,
        chain_power: 0.5,
        region: Extent::Interior,
        spacing: 2.4,
        method: Method::DualContour,
    },
    Case {
        name: "2BUK assembly 1 (class of 2W4A), interior",
        file: "large/2buk.pdb",
        assembly: Some("1"),
        residue_power: 0.25,
        chain_power: 0.5,
        region: Extent::Interior,
        spacing: 3.0,
        method: Method::DualContour,
    },
];

struct Times {
    density: f64,
    mesh: f64,
    quality: f64,
}

pub(crate) fn run() -> Outcome {
    println!(
        "DM density map, MG mesh generation, QI quality improvement, seconds; thesis: CS / C-8 / GPU"
    );
    println!(
        "thesis 2W4U   (69 k atoms, 1.09 M tets): DM 188.6/37.8/4.8, MG 13.2/6.6/2.4, QI 157.8/35.8/6.3, 15.00°–165.25°, Joe–Liu 0.12, edge ratio 10.24"
    );
    println!(
        "thesis CERCA  (80 k atoms, 0.95 M tets): DM 165.1/38.4/11.7, MG 12.8/6.3/2.3, QI 163.5/37.7/7.2, 15.01°–167.25°, Joe–Liu 0.14, edge ratio 10.23"
    );
    println!(
        "thesis 2W4A   (0.19 M atoms, 1.33 M tets): DM 687.4/143.5/10.2, MG 12.9/6.7/2.4, QI 213.7/53.2/6.5, 15.10°–166.23°, Joe–Liu 0.11, edge ratio 10.98"
    );
    let gpu = match Wgpu::new() {
        Ok(gpu) => Some(gpu),
        Err(error) => {
            println!("no GPU mode on this machine: {error}");
            None
        }
    };
    let all = rayon::current_num_threads();
    for case in &CASES {
        let Some(path) = fixtures::shared(case.file) else {
            println!("{}: {} is not at hand, row left out", case.name, case.file);
            continue;
        };
        let options = ReadOptions {
            assembly: case.assembly.map(Into::into),
            ..ReadOptions::default()
        };
        let structure = read(&path, &options).map_err(text)?.structure;
        println!(
            "{}, {:?}, {} atoms, {} Å, P {} {}",
            case.name,
            case.method,
            structure.atoms().len(),
            case.spacing,
            case.residue_power,
            case.chain_power
        );
        // One thread is the thesis's CS; its mesh is what more threads must give again.
        let (first, improved) = on(1, || measure(case, &structure, &Cpu))?;
        line("1 thread", &first);
        if all > 1 {
            let (times, again) = measure(case, &structure, &Cpu)?;
            line(&format!("{all} threads"), &times);
            if again.mesh != improved.mesh {
                return Err(format!(
                    "{}: {all} threads give another mesh than one",
                    case.name
                ));
            }
        }
        // The GPU proposes in f32: its mesh may differ, only its time is told.
        if let Some(gpu) = &gpu {
            let (times, _) = measure(case, &structure, gpu)?;
            line(&geom_core::Backend::name(gpu), &times);
        }
        print_quality(&improved);
    }
    Ok(())
}

/// Before and after, and how well the surface is kept.
fn print_quality(improved: &Improved) {
    let report = &improved.report;
    let (b, a) = (&report.before.all, &report.after.all);
    println!(
        "  {} vertices, {} tetrahedra; dihedral {:.1}°–{:.1}° → {:.2}°–{:.2}°, Joe–Liu {:.3}, edge ratio {:.2}, goals {}",
        improved.mesh.positions().len(),
        a.tets,
        b.min_dihedral.min,
        b.max_dihedral.max,
        a.min_dihedral.min,
        a.max_dihedral.max,
        a.joe_liu.min,
        a.edge_ratio.max,
        if report.converged { "met" } else { "missed" }
    );
    let fit = &report.surface;
    println!(
        "  {} of {} surface vertices ({:.3} %) farther than 0.1 spacings from the isosurface; below the goals: {:?}",
        fit.far,
        fit.vertices,
        100.0 * fit.far as f64 / fit.vertices.max(1) as f64,
        report.unmet.counts
    );
}

fn on<T: Send>(threads: usize, f: impl FnOnce() -> T + Send) -> T {
    rayon::ThreadPoolBuilder::new()
        .num_threads(threads)
        .build()
        .expect("a thread pool")
        .install(f)
}

fn line(mode: &str, t: &Times) {
    println!(
        "  {mode:>10}: DM {:.2}, MG {:.2}, QI {:.2}, total {:.2}",
        t.density,
        t.mesh,
        t.quality,
        t.density + t.mesh + t.quality
    );
}

fn measure<B: DensityBackend + ContourBackend + QualityBackend>(
    case: &Case,
    structure: &Structure,
    backend: &B,
) -> Result<(Times, Improved), String> {
    let levels = Levels {
        residue_power: case.residue_power,
        chain_power: case.chain_power,
        ..Levels::default()
    };
    let model = Model::uniform(structure, &levels).map_err(text)?;
    let start = Instant::now();
    let density = gauss_density::Options {
        spacing: case.spacing,
        ..Default::default()
    };
    let grid = gauss_density::sample(&model, &density, Run::on(backend))
        .map_err(text)?
        .grid;
    let density = start.elapsed().as_secs_f64();
    let field = PointSampler::new(&model, Cutoff::default()).map_err(text)?;
    let field = field.on(backend).map_err(text)?;
    let start = Instant::now();
    let contour = dual_contour::Options {
        method: case.method,
        region: case.region,
        ..Default::default()
    };
    let mesh = dual_contour::volume(&grid, Some(&field), &contour, Run::on(backend))
        .map_err(text)?
        .mesh;
    let meshed = start.elapsed().as_secs_f64();
    let start = Instant::now();
    let options = tet_quality::Options {
        spacing: Some(case.spacing),
        ..Default::default()
    };
    let improved =
        tet_quality::improve(mesh, Some(&field), &options, Run::on(backend)).map_err(text)?;
    let times = Times {
        density,
        mesh: meshed,
        quality: start.elapsed().as_secs_f64(),
    };
    Ok((times, improved))
}
