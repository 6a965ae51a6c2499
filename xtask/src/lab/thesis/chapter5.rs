//! `cargo xtask thesis 5`, of which `5.1` and `5.2` are the last parts: T-meshes and the splines on them. The thesis's table 5.1 counts what no T-mesh can have (`V − F −
//! T/2` is not χ), so that only its scaled Jacobians and times can be compared with; of the splines it shows pictures. The
//! tables of the sphere stand beside those of a prototype, the error of adaptive meshes beside that of uniform ones.

use std::time::Instant;

use geom_core::io::structure::{ReadOptions, read};
use geom_core::mesh::shapes;
use geom_core::{Cpu, Point3, QuadMesh, Run, TriMesh, Vector3, io};
use tspline::surface::adapt::adapt;
use tspline::surface::fit::{FitOptions, Target, fit};
use tspline::{
    Basis, CleanOptions, Improved, Method, QualityOptions, Surface, TMesh, TMeshOptions, analysis,
    improve, levels,
};

use super::text;
use crate::{Outcome, fixtures};

fn cpu() -> Run<'static, Cpu> {
    Run::on(&Cpu)
}

/// Meshes of the larger data set.
const MESHES: &[&str] = &[
    "spot.ply",
    "bob_small.ply",
    "fox.ply",
    "sphere_small.ply",
    "dir_eight.off",
    "dir_torus.obj",
    "cgal_hand.off",
    "cgal_elk.off",
    "cgal_bones.off",
    "cgal_helmet.off",
    "cgal_fandisk.off",
    "dir_camelhead.off",
    "c3d_rocker-arm.obj",
    "dir_fertility.obj",
    "dir_bunny.off",
];

pub(crate) fn run() -> Outcome {
    sphere_unrefined()?;
    sphere_refined()?;
    poisson()?;
    convergence_on_a_protein()?;
    quality()?;
    adaptive_beside_uniform()
}

/// Table 5.1: the worst corners, before and after, by both distortions.
pub(crate) fn quality() -> Outcome {
    println!("Table 5.1: scaled Jacobians (least | 5 % | mean), levels 0 and 1 by curvature");
    println!(
        "thesis (unsigned): least 0.37–0.59 after 13–18 s for 12,000–42,000 vertices; asked: 0.30 always, median 0.45, 5 % quantile 0.85"
    );
    println!(
        "| surface | rung | elements | T-junctions | extraordinary | before | corners (Eqs. 5.5–5.7) | triangles (5.8–5.9) | quads s | quality s |"
    );
    println!("|---|---|---|---|---|---|---|---|---|---|");
    let mut least = Vec::new();
    for name in MESHES {
        let Some(path) = fixtures::shared(&format!("meshes/{name}")) else {
            println!("| {name} | not at hand |");
            continue;
        };
        let surface = io::mesh::read(&path).map_err(text)?.mesh.into_triangles();
        least.extend(quality_row(name, &surface)?);
    }
    for (name, spacing) in [("1AJJ.pdb", 1.5), ("1A8O.pdb", 1.5)] {
        let path = fixtures::path(name);
        least.extend(quality_row(name, &protein(&path, spacing)?)?);
    }
    least.sort_by(f64::total_cmp);
    if let Some(median) = least.get(least.len() / 2) {
        println!("median of the least: {median:.3}");
    }
    Ok(())
}

/// The least scaled Jacobian, if there is a T-mesh.
fn quality_row(name: &str, surface: &TriMesh) -> Result<Option<f64>, String> {
    let clock = Instant::now();
    let options = crossfield::Options {
        nested: 1,
        ..crossfield::Options::default()
    };
    let made = match crossfield::quadrangulate(surface, &options, cpu()) {
        Ok(made) => made,
        Err(error) => {
            println!("| {name} | {error} |");
            return Ok(None);
        }
    };
    let quads = clock.elapsed().as_secs_f64();
    let places = levels::Places::of(surface, &made.mesh).map_err(text)?;
    let wished = levels::by_curvature(&made.mesh, &places, 0.5, 1).map_err(text)?;
    let mesh = t_mesh(&made.mesh, &wished)?;
    let better = |method: Method| -> Result<Improved, String> {
        let options = QualityOptions {
            method,
            ..QualityOptions::default()
        };
        improve(mesh.clone(), surface, &options, cpu()).map_err(text)
    };
    let clock = Instant::now();
    let corners = better(Method::Corners)?.report;
    let seconds = clock.elapsed().as_secs_f64();
    let triangles = better(Method::Triangles)?.report;
    let audit = mesh.audit();
    let of = |j: &tspline::quality::JacobianSummary| {
        format!("{:.3} | {:.3} | {:.3}", j.min, j.percentile_5, j.mean).replace(" | ", " ")
    };
    println!(
        "| {name} | {:?} | {} | {} | {} | {} | {} | {} | {quads:.1} | {seconds:.1} |",
        made.report.rung(),
        audit.elements,
        audit.t_junctions,
        audit.extraordinary,
        of(&corners.before),
        of(&corners.after),
        of(&triangles.after),
    );
    Ok(Some(corners.after.min))
}

fn t_mesh(fine: &QuadMesh, wished: &[u8]) -> Result<TMesh, String> {
    let allowed = levels::cleaned(fine, wished, &CleanOptions::default()).map_err(text)?;
    TMesh::build(fine, &allowed, &TMeshOptions::default()).map_err(text)
}

struct Ball;
impl Target for Ball {
    fn closest(&self, to: &Point3) -> Point3 {
        Point3::from(to.coords.normalize())
    }
}

/// A unit sphere of `n × n` fine quads per side of a cube.
fn sphere(n: u32, basis: Basis, level: impl Fn(Point3) -> u8) -> Result<Surface, String> {
    let fine = shapes::quad_sphere(1.0, n);
    let middle = |q: usize| -> Point3 {
        let sum: Vector3 = fine.corners(q).iter().map(|p| p.coords).sum();
        Point3::from(sum / 4.0)
    };
    let allowed: Vec<u8> = (0..fine.quads().len()).map(|q| level(middle(q))).collect();
    let mesh = TMesh::build(&fine, &allowed, &TMeshOptions::default()).map_err(text)?;
    let mut surface = Surface::new(mesh, basis, cpu()).map_err(text)?;
    fit(&mut surface, &Ball, &FitOptions::default(), cpu()).map_err(text)?;
    Ok(surface)
}

/// Relative errors of the eigenvalues l (l + 1), l = 1, 2, 3.
fn spectrum(surface: &Surface) -> Result<[f64; 3], String> {
    let matrices = analysis::matrices(surface).map_err(text)?;
    let pairs = analysis::eigenpairs(&matrices, 16, cpu()).map_err(text)?;
    Ok([1, 2, 3].map(|l| {
        let exact = (l * (l + 1)) as f64;
        let of = pairs.values[l * l..(l + 1) * (l + 1)].iter();
        of.map(|v| (v / exact - 1.0).abs()).fold(0.0, f64::max)
    }))
}

/// Table C.5 of the design notes.
fn sphere_unrefined() -> Outcome {
    println!(
        "\nTable C.5: relative errors of the sphere's eigenvalues; n × n elements per side of a cube"
    );
    println!("| n | functions | ours l = 1 | l = 2 | l = 3 | prototype | orders |");
    println!("|---|---|---|---|---|---|---|");
    let prototype = [
        (4, [1.8e-5, 2.8e-4, 8.4e-4]),
        (8, [1.4e-6, 3.1e-5, 6.9e-5]),
        (16, [8.7e-8, 3.7e-6, 8.1e-6]),
        (32, [5.5e-9, 4.5e-7, 1.0e-6]),
    ];
    let mut last: Option<[f64; 3]> = None;
    for (n, theirs) in prototype {
        let surface = sphere(n, Basis::Hierarchical, |_| 0)?;
        let ours = spectrum(&surface)?;
        let orders = last.map(|l| [0, 1, 2].map(|k| format!("{:.1}", (l[k] / ours[k]).log2())));
        println!(
            "| {n} | {} | {:.1e} | {:.1e} | {:.1e} | {} | {} |",
            surface.controls().len(),
            ours[0],
            ours[1],
            ours[2],
            theirs.map(|e| format!("{e:.1e}")).join(" "),
            orders.map_or_else(String::new, |o| o.join(" ")),
        );
        last = Some(ours);
    }
    Ok(())
}

/// Levels by place.
type Part = fn(Point3) -> u8;

/// Table C.6: what local refinement does to the bases.
fn sphere_refined() -> Outcome {
    println!(
        "\nTable C.6: 8 × 8 elements per side, refined in a part: elements, functions, errors of l = 1 and 2"
    );
    println!("| refined | elements | hierarchical | prototype | rational | prototype |");
    println!("|---|---|---|---|---|---|");
    let cases: [(&str, u32, Part, [&str; 2]); 4] = [
        ("nothing", 8, |_| 0, ["386: 1.4e-6 3.1e-5"; 2]),
        (
            "a cap, once",
            16,
            |p| u8::from(p.z < 0.8),
            ["514: 3.9e-7 2.1e-5", "658: 1.4e-5 5.3e-5"],
        ),
        (
            "a cap, twice",
            32,
            |p| u8::from(p.z < 0.8) + u8::from(p.z < 0.92),
            ["624: 1.3e-6 2.6e-5", "770: 1.7e-5 6.7e-5"],
        ),
        (
            "an oblique belt, twice",
            32,
            |p| {
                let off = ((p.x + p.y + 0.3 * p.z) / 1.446).abs();
                u8::from(off > 0.25) + u8::from(off > 0.1)
            },
            ["1062: 1.6e-6 1.6e-5", "1742: 3.6e-5 1.1e-4"],
        ),
    ];
    for (name, n, level, prototype) in cases {
        let mut row = format!("| {name} ");
        for (k, basis) in [Basis::Hierarchical, Basis::Rational]
            .into_iter()
            .enumerate()
        {
            let surface = sphere(n, basis, level)?;
            let [one, two, _] = spectrum(&surface)?;
            if k == 0 {
                row += &format!("| {} ", surface.mesh().elements().len());
            }
            let count = surface.controls().len();
            row += &format!("| {count}: {one:.1e} {two:.1e} | {} ", prototype[k]);
        }
        println!("{row}|");
    }
    Ok(())
}

/// −Δu = 6 u for u = 3 z² − 1.
fn poisson() -> Outcome {
    println!(
        "\nPoisson's equation on the sphere, f = 6 (3 z² − 1): relative error in the mean of squares; asked: 1e-4 at n = 16"
    );
    let harmonic = |p: &Point3| 3.0 * p.z * p.z - 1.0;
    let mut last: Option<f64> = None;
    for n in [4, 8, 16, 32] {
        let surface = sphere(n, Basis::Hierarchical, |_| 0)?;
        let matrices = analysis::matrices(&surface).map_err(text)?;
        let found = analysis::poisson(&surface, &matrices, &|p| 6.0 * harmonic(p)).map_err(text)?;
        let (mut apart, mut size) = (0.0, 0.0);
        for e in 0..surface.mesh().elements().len() {
            for at in [[0.2, 0.3], [0.4, 0.7], [0.9, 0.6]] {
                let exact = harmonic(&surface.evaluate(e, at).point);
                apart += (analysis::value(&surface, &found, e, at) - exact).powi(2);
                size += exact * exact;
            }
        }
        let error = f64::sqrt(apart / size);
        let order = last.map_or_else(String::new, |l| {
            format!(", order {:.1}", (l / error).log2())
        });
        println!("  n = {n}: {error:.1e}{order}");
        last = Some(error);
    }
    Ok(())
}

fn protein(path: &std::path::Path, spacing: f64) -> Result<TriMesh, String> {
    let structure = read(path, &ReadOptions::default()).map_err(text)?.structure;
    // As smooth as the thesis's.
    let levels = gauss_density::Levels {
        decay: 0.3,
        ..Default::default()
    };
    let model = gauss_density::Model::uniform(&structure, &levels).map_err(text)?;
    let options = gauss_density::Options {
        spacing,
        ..Default::default()
    };
    let grid = gauss_density::sample(&model, &options, cpu())
        .map_err(text)?
        .grid;
    let surface = dual_contour::surface(&grid, None, &dual_contour::Options::default(), cpu());
    Ok(surface.map_err(text)?.mesh)
}

/// Quads of a protein in squares of 4 × 4 as far as possible.
fn nested(surface: &TriMesh, quads: usize) -> Result<QuadMesh, String> {
    let options = crossfield::Options {
        size: crossfield::Size::Quads(quads),
        nested: 2,
        ..crossfield::Options::default()
    };
    let made = crossfield::quadrangulate(surface, &options, cpu()).map_err(text)?;
    Ok(made.mesh)
}

/// Eigenvalues on one surface, that of the coarsest elements, which cutting does not move.
fn convergence_on_a_protein() -> Outcome {
    println!(
        "\nEigenvalues on 1AJJ's surface at 1.5 Å, whose elements are cut without moving it, against the finest"
    );
    let surface = protein(&fixtures::path("1AJJ.pdb"), 1.5)?;
    let fine = nested(&surface, 6_400)?;
    let mesh = t_mesh(&fine, &vec![2; fine.quads().len()])?;
    let options = FitOptions::default();
    let first = adapt(
        mesh,
        Basis::Hierarchical,
        &surface,
        f64::INFINITY,
        &options,
        cpu(),
    );
    let mut steps = vec![first.map_err(text)?.surface];
    while let Some(last) = steps.last() {
        let coarse = last.mesh().elements().iter().map(|e| e.level).max();
        let of = |e: &usize| Some(last.mesh().elements()[*e].level) == coarse;
        if coarse == Some(0) {
            break;
        }
        let all: Vec<usize> = (0..last.mesh().elements().len()).filter(of).collect();
        let next = last
            .cut(&all, &TMeshOptions::default(), cpu())
            .map_err(text)?;
        steps.push(next);
    }
    let mut values = Vec::new();
    for surface in &steps {
        let matrices = analysis::matrices(surface).map_err(text)?;
        values.push(
            analysis::eigenpairs(&matrices, 11, cpu())
                .map_err(text)?
                .values,
        );
    }
    let Some((finest, rest)) = values.split_last() else {
        return Ok(());
    };
    for (of, surface) in rest.iter().zip(&steps) {
        let apart = |k: usize| (of[k] / finest[k] - 1.0).abs();
        let worst = (1..=10).map(apart).fold(0.0, f64::max);
        println!(
            "  {} functions: first ten within {worst:.1e}",
            surface.controls().len()
        );
    }
    Ok(())
}

/// What is fitted with uniform and with adaptive elements.
struct Rivalry {
    file: &'static str,
    /// Of the triangles, Å: facets as large as elements would be the error that both are measured by.
    spacing: f64,
    /// Fine quads that adaptive elements are joined from.
    finest: usize,
    /// Numbers of quads of the uniform meshes.
    uniform: &'static [usize],
    /// What the adaptive ones are refined to, Å.
    tolerances: &'static [f64],
}

const RIVALRIES: [Rivalry; 2] = [
    Rivalry {
        file: "pdb/1ajj.pdb",
        spacing: 0.5,
        finest: 6400,
        uniform: &[200, 400, 800, 1600, 3200],
        tolerances: &[0.4, 0.2, 0.1],
    },
    Rivalry {
        file: "pdb/1su4.pdb",
        spacing: 1.5,
        finest: 64_000,
        uniform: &[2000, 4000, 8000, 16_000],
        tolerances: &[0.4, 0.2],
    },
];

/// How many functions a uniform mesh needs for the error of an adaptive one.
pub(crate) fn adaptive_beside_uniform() -> Outcome {
    println!(
        "\nAdaptive beside uniform; asked: at most a quarter of the functions at the same error"
    );
    println!("| surface | functions | rms, Å | Hausdorff, Å | s |");
    println!("|---|---|---|---|---|");
    for rivalry in RIVALRIES {
        match fixtures::shared(rivalry.file) {
            Some(path) => rivals(&rivalry, &protein(&path, rivalry.spacing)?)?,
            None => println!("| {} | not at hand |", rivalry.file),
        }
    }
    Ok(())
}

fn rivals(rivalry: &Rivalry, surface: &TriMesh) -> Outcome {
    let file = rivalry.file;
    for &quads in rivalry.uniform {
        let options = crossfield::Options {
            size: crossfield::Size::Quads(quads),
            ..crossfield::Options::default()
        };
        let made = crossfield::quadrangulate(surface, &options, cpu());
        let fine = made.map_err(text)?.mesh;
        let mesh = t_mesh(&fine, &vec![0; fine.quads().len()])?;
        // An infinite tolerance cuts nothing: the fit alone.
        fitted(
            &format!("{file}, uniform of {quads}"),
            mesh,
            surface,
            f64::INFINITY,
        )?;
    }
    // All as coarse as they may be; the error cuts them where it is large.
    let fine = nested(surface, rivalry.finest)?;
    let coarse = t_mesh(&fine, &vec![2; fine.quads().len()])?;
    for &tolerance in rivalry.tolerances {
        let name = format!("{file}, adaptive to {tolerance} Å");
        fitted(&name, coarse.clone(), surface, tolerance)?;
    }
    Ok(())
}

/// A row of the table.
fn fitted(name: &str, mesh: TMesh, surface: &TriMesh, tolerance: f64) -> Outcome {
    let clock = Instant::now();
    let options = FitOptions::default();
    let made = adapt(
        mesh,
        Basis::Hierarchical,
        surface,
        tolerance,
        &options,
        cpu(),
    );
    let made = made.map_err(text)?;
    println!(
        "| {name} | {} | {:.3} | {:.3} | {:.0} |",
        made.surface.controls().len(),
        made.errors.rms,
        made.errors.hausdorff,
        clock.elapsed().as_secs_f64()
    );
    Ok(())
}
