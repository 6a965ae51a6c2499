//! 11 — A spline surface on a T-mesh, for CAD and for analysis.

use std::path::PathBuf;
use std::process::ExitCode;

use biogeom_examples::args::{Common, HasCommon};
use biogeom_examples::input::tmesh::TMeshArgs;
use biogeom_examples::steps::spline::{self, Product};
use biogeom_examples::steps::spline_modes;
use biogeom_examples::{Failure, Session};
use clap::{Parser, ValueEnum};
use secondfund_ops::Operator;
use serde::Serialize;
use tspline::files::{market, npz};
use tspline::surface::fit::FitOptions;
use tspline::{Basis, Surface, analysis};

/// A spline surface: of a mesh, or of a structure's or grid's surface
#[derive(Parser, Serialize)]
#[command(version, allow_negative_numbers = true, after_help = EXAMPLES)]
struct Args {
    #[command(flatten)]
    mesh: TMeshArgs,
    /// Which functions carry the surface
    #[arg(long, value_enum, default_value_t)]
    basis: BasisName,
    /// Cut elements that are farther from the surface than this, Å, as long as they are not of the finest level
    #[arg(long, value_name = "DISTANCE")]
    tolerance: Option<f64>,
    /// How much bending counts beside distance
    #[arg(long, value_name = "SHARE", default_value_t = FitOptions::default().smoothing)]
    smoothing: f64,
    /// Rounds of nearest points and least squares
    #[arg(long, value_name = "N", default_value_t = FitOptions::default().rounds)]
    rounds: u32,
    /// Triangles along each side of a patch in the pictures and triangle meshes
    #[arg(long, value_name = "N", default_value_t = 4, value_parser = clap::value_parser!(u32).range(2..=64))]
    steps: u32,
    /// Eigenvalues of the Laplace–Beltrami operator on the surface to compute; writes its matrices
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=200))]
    eigenvalues: Option<u32>,
    /// Modes of an operator on the surface's own Bézier elements to draw
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=60))]
    modes: Option<u16>,
    /// That operator
    #[arg(long, value_enum, default_value_t)]
    operator: OperatorName,
    /// What to write
    #[arg(long, value_name = "FILES", value_enum, value_delimiter = ',', default_values_t = [Product::Vtu, Product::Step, Product::Glb])]
    files: Vec<Product>,
    #[command(flatten)]
    common: Common,
}

/// Names of [`Basis`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum, Serialize)]
#[serde(rename_all = "kebab-case")]
enum BasisName {
    /// Truncated hierarchical functions
    #[default]
    Hierarchical,
    /// Rational T-splines by local knots (the thesis's)
    Rational,
    /// The same where they need no division: on T-meshes that are analysis-suitable, or become so with few elements more;
    /// else hierarchical, with a warning
    Suitable,
}

/// Whose modes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum, Serialize)]
#[serde(rename_all = "kebab-case")]
enum OperatorName {
    /// Secondary Laplace operator with e^K: sees curvature
    #[default]
    Slo,
    /// Laplace–Beltrami: sees distances along the surface
    Lbo,
}

const EXAMPLES: &str = "\
Examples:
  11_tspline spot.ply --quads 4000 --out out
  11_tspline 1ajj.pdb --spacing 1 --levels curvature --tolerance 0.1 --out protein
  11_tspline quads.obj --basis rational --files step,bext,json --eigenvalues 10 --out out

Outputs: surface.vtu, surface.step, surface.glb and others as --files says; surface.png (distance from the input, sides
of elements, T-junctions, extraordinary vertices),
stiffness and mass as .mtx (Matrix Market) and .npz (SciPy) with --eigenvalues; modes.png with --modes; report.json with `basis` (the one that was taken), `counts`, `error` (`rms`, `hausdorff`, Å), `rounds`,
`independence` and `eigenvalues` (Å⁻²); `modes` (`values` where the largest extent is 1, `scale` in Å).";

impl HasCommon for Args {
    fn common(&self) -> &Common {
        &self.common
    }
    fn inputs(&self) -> Vec<PathBuf> {
        vec![self.mesh.input()]
    }
}

fn main() -> ExitCode {
    biogeom_examples::run("11_tspline", program)
}

fn program(args: &Args, session: &Session) -> Result<(), Failure> {
    let options = FitOptions {
        rounds: args.rounds,
        smoothing: args.smoothing,
        ..FitOptions::default()
    };
    options.check()?;
    if args.tolerance.is_some_and(|t| t.is_nan() || t <= 0.0) {
        return Err("--tolerance must be positive, Å".into());
    }
    if args.modes.is_none() {
        session.refuse(&["operator"], "is of --modes")?;
    }
    let made = args.mesh.make(session)?;
    if made.mesh.elements().iter().all(|e| e.level == 0) {
        let because = match args.mesh.has_levels() {
            true => "cuts elements of higher levels, and none have come of --levels here",
            false => "cuts elements of higher levels, and there are none; see --levels",
        };
        session.refuse(&["tolerance"], because)?;
    }
    let basis = match args.basis {
        BasisName::Hierarchical => Basis::Hierarchical,
        BasisName::Rational => Basis::Rational,
        BasisName::Suitable => Basis::Suitable,
    };
    let (input, asked) = (made.input, args.tolerance);
    let (adapted, triangles) = spline::fit(
        session,
        made.mesh,
        &input,
        (basis, asked, args.steps),
        &options,
    )?;
    let (surface, target) = (&adapted.surface, &input.surface);
    let matrices = match args.eigenvalues {
        None => None,
        Some(count) => Some(spectrum(session, surface, count as usize)?),
    };
    let operator = match args.operator {
        OperatorName::Slo => Operator::default(),
        OperatorName::Lbo => Operator::Lbo,
    };
    let modes = args.modes.map(|count| {
        let asked = (operator, count.into());
        spline_modes::find(session, surface, &triangles, asked)
    });
    let modes = modes.transpose()?;
    let count = args.files.len() as u64 + 1 + 4 * u64::from(matrices.is_some());
    let count = count + u64::from(modes.is_some());
    session.files(count, || {
        for &file in &args.files {
            spline::save(session, file, &adapted, &triangles, &input)?;
        }
        if let Some(matrices) = &matrices {
            for (name, matrix) in [("stiffness", &matrices.stiffness), ("mass", &matrices.mass)] {
                spline::write(session, &format!("{name}.mtx"), |out| {
                    market::write_symmetric(out, matrix)
                })?;
                spline::write(session, &format!("{name}.npz"), |out| {
                    npz::write(out, matrix)
                })?;
            }
        }
        if let Some(modes) = &modes {
            session.picture("modes", || {
                spline_modes::picture(session, &triangles.mesh, modes)
            })?;
        }
        session.picture("surface", || {
            spline::picture(session, &adapted, &triangles, target)
        })
    })
}

fn spectrum(
    session: &Session,
    surface: &Surface,
    count: usize,
) -> Result<analysis::Matrices, Failure> {
    let matrices = session.stage("matrices", || analysis::matrices(surface))?;
    let spectral = session.on(session.device.spectral());
    let pairs = session.stage("eigenvalues", || {
        analysis::eigenpairs(&matrices, count, spectral)
    })?;
    session.note("eigenvalues", &pairs.values)?;
    session.note("independence", analysis::independence(&matrices, spectral)?)?;
    Ok(matrices)
}
