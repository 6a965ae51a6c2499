//! Remeshes surfaces from files and the isosurfaces of structures, one row of a table each: vertices
//! and extreme angles before and after, triangles below 30°, mean radius ratio, vertices of nearly
//! regular valence, edges in units of those asked for, vertices with shorter ones, distances from
//! result to surface and back in mean edges of the input, Euler characteristic (`!` if the topology
//! changed), CPU time.
//!
//! ```sh
//! cargo run --release -p tet-quality --example remesh -- [--length X] [--tolerance X] \
//!     [--angle DEGREES] [--spacing X] [--exceptions] [--save FOLDER] FILE…
//! ```
//! `--length` and `--tolerance` (for sizing by curvature) are in mean edges of the input, the spacing
//! of the density is in Å.

#![expect(clippy::print_stdout, reason = "a program that prints a table")]

use std::path::Path;
use std::process::ExitCode;

use gauss_density::{Cutoff, Model, PointSampler};
use geom_core::io::{mesh, structure};
use geom_core::mesh::SurfaceAudit;
use geom_core::repair::{self, repair};
use geom_core::{Cpu, ImplicitField, Run, TriMesh};
use tet_quality::surface::{Features, Options, Sizing, TriangleReport, remesh};

type Failure = Box<dyn std::error::Error>;

struct Args {
    length: f64,
    tolerance: Option<f64>,
    angle: Option<f64>,
    spacing: f64,
    exceptions: bool,
    save: Option<String>,
    files: Vec<String>,
}

fn main() -> ExitCode {
    let mut args = Args {
        length: 1.0,
        tolerance: None,
        angle: None,
        spacing: 0.5,
        exceptions: false,
        save: None,
        files: Vec::new(),
    };
    let mut words = std::env::args().skip(1);
    while let Some(word) = words.next() {
        let mut number = || words.next().and_then(|w| w.parse().ok());
        let known = match word.as_str() {
            "--length" => number().map(|x| args.length = x),
            "--tolerance" => number().map(|x| args.tolerance = Some(x)),
            "--angle" => number().map(|x| args.angle = Some(x)),
            "--spacing" => number().map(|x| args.spacing = x),
            "--save" => words.next().map(|x| args.save = Some(x)),
            "--exceptions" => {
                args.exceptions = true;
                Some(())
            }
            _ => {
                args.files.push(word.clone());
                Some(())
            }
        };
        if known.is_none() {
            println!("{word} needs a value");
            return ExitCode::FAILURE;
        }
    }
    println!(
        "{:22} {:>8} {:>8} {:^11} {:^13} {:>5} {:>6} {:>6} {:^18} {:>7} {:>8} {:>8} {:>6} {:>7} {:>6}",
        "surface",
        "vertices",
        "after",
        "min angle",
        "max angle",
        "<30°",
        "ratio",
        "5 to 7",
        "edges 1% 99% fair",
        "shorter",
        "to it",
        "from it",
        "chi",
        "CPU s",
        "us/tri"
    );
    let mut failed = false;
    for file in &args.files {
        if let Err(error) = row(&args, file) {
            println!("{file}: {error}");
            failed = true;
        }
    }
    if failed {
        ExitCode::FAILURE
    } else {
        ExitCode::SUCCESS
    }
}

fn row(args: &Args, file: &str) -> Result<(), Failure> {
    let name = Path::new(file)
        .file_name()
        .unwrap_or_default()
        .to_string_lossy();
    let lower = name.to_lowercase();
    let atoms = [".pdb", ".cif", ".pqr"].iter().any(|e| lower.contains(e));
    if !atoms {
        let mesh = mesh::read(file)?.mesh.into_triangles();
        return measure(args, &name, mesh, None);
    }
    let structure = structure::read(file, &Default::default())?.structure;
    let model = Model::uniform(&structure, &Default::default())?;
    let density = gauss_density::Options {
        spacing: args.spacing,
        ..Default::default()
    };
    let grid = gauss_density::sample_band(&model, &density, Run::on(&Cpu))?.grid;
    let field = PointSampler::new(&model, Cutoff::default())?;
    let contour = dual_contour::Options::default();
    let made = dual_contour::surface(&grid, Some(&field), &contour, Run::on(&Cpu))?;
    measure(args, &name, made.mesh, Some(&field))
}

fn measure(
    args: &Args,
    name: &str,
    mesh: TriMesh,
    field: Option<&dyn ImplicitField>,
) -> Result<(), Failure> {
    let mean = TriangleReport::of(&mesh).mean_edge;
    let sizing = match args.tolerance {
        Some(tolerance) => Sizing::Curvature {
            tolerance: tolerance * mean,
            min_edge: 0.3 * args.length * mean,
            max_edge: 3.0 * args.length * mean,
            gradation: 0.3,
        },
        None => Sizing::Uniform {
            edge_length: Some(args.length * mean),
        },
    };
    let options = Options {
        sizing,
        features: args.angle.map_or(Features::None, Features::Angle),
        ..Options::default()
    };
    let input = mesh.clone();
    let start = cpu_seconds();
    let out = match remesh(mesh, field, &options, Run::on(&Cpu)) {
        Ok(out) => out,
        Err(error) => {
            println!("{name:22} {error}");
            let repaired = repair(input, &repair::Options::default())?.mesh;
            return measure(args, &format!("{name} repaired"), repaired, field);
        }
    };
    let seconds = cpu_seconds() - start;
    let report = &out.report;
    let (b, a) = (&report.before, &report.after);
    let audits = [SurfaceAudit::of(&input), SurfaceAudit::of(&out.mesh)];
    let topology = |audit: &SurfaceAudit| {
        let whole = audit.is_manifold();
        (whole, audit.euler_characteristic(), audit.components.len())
    };
    let same = topology(&audits[0]) == topology(&audits[1]);
    println!(
        "{name:22} {:8} {:8} {:4.1} > {:4.1} {:5.1} > {:5.1} {:5} {:6.3} {:5.1}% {:5.2} {:5.2} {:5.1}% {:6.1}% {:8.3} {:8.3} {:5}{} {:7.2} {:6.1} {}",
        b.vertices,
        a.vertices,
        b.min_angle_deg,
        a.min_angle_deg,
        b.max_angle_deg,
        a.max_angle_deg,
        report.exceptions.len(),
        a.mean_radius_ratio,
        100.0 * a.nearly_regular,
        report.lengths.percent_1,
        report.lengths.percent_99,
        100.0 * report.lengths.within,
        100.0 * report.shortened,
        report.inner_deviation.max / mean,
        report.reverse_deviation / mean,
        audits[1].euler_characteristic(),
        if same { ' ' } else { '!' },
        seconds,
        1e6 * seconds / a.triangles as f64,
        if report.converged {
            ""
        } else {
            "misses a goal"
        },
    );
    if args.exceptions {
        for e in &report.exceptions {
            let p = out.mesh.corners(e.triangle as usize)[0];
            println!("    {:4.1}° {:?} at {p:.3}", e.angle_deg, e.cause);
        }
    }
    if let Some(folder) = &args.save {
        let view = geom_core::io::View::from(&out.mesh);
        mesh::save(format!("{folder}/{name}.ply"), &view)?;
    }
    Ok(())
}

/// Of this process, all threads; 0 where the system does not say.
fn cpu_seconds() -> f64 {
    let Ok(text) = std::fs::read_to_string("/proc/self/stat") else {
        return 0.0;
    };
    let fields: Vec<&str> = text
        .rsplit_once(')')
        .map_or("", |p| p.1)
        .split_whitespace()
        .collect();
    let ticks = |i: usize| {
        fields
            .get(i)
            .and_then(|w| w.parse::<f64>().ok())
            .unwrap_or(0.0)
    };
    (ticks(11) + ticks(12)) / 100.0
}
