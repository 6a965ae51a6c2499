//! `cargo xtask gallery`: the counterparts of the thesis's figures that the data at hand allow, by our own programs.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Instant;

use crate::{Outcome, fixtures, root, target};

/// What is drawn, and where to.
#[derive(clap::Args)]
pub(crate) struct Arguments {
    /// Folder of the pictures and of `index.html`
    #[arg(long, default_value = "out/gallery")]
    out: PathBuf,
    /// Only figures whose number begins so, as `7.` for a chapter
    #[arg(long, default_value = "")]
    only: String,
}

/// A counterpart: the number in the thesis, what is shown there, our program and its arguments, the picture it makes.
/// `@a|b` is the first of these files that is there, among the larger data or the fixtures.
struct Figure {
    number: &'static str,
    theirs: &'static str,
    program: &'static str,
    arguments: &'static str,
    picture: &'static str,
}

const fn figure(
    number: &'static str,
    theirs: &'static str,
    program: &'static str,
    arguments: &'static str,
    picture: &'static str,
) -> Figure {
    Figure {
        number,
        theirs,
        program,
        arguments,
        picture,
    }
}

const FIGURES: &[Figure] = &[
    figure(
        "3.1",
        "multi-scale model of 2W4U",
        "02_surface",
        "@pdb/1igy.pdb|1hvr.pdb --spacing 1.5 --color chain",
        "surface.png",
    ),
    figure(
        "3.3 a",
        "surface of 1J5E, two levels: powers of 1",
        "02_surface",
        "@1hvr.pdb --spacing 1 --residue-power 1 --color residue",
        "surface.png",
    ),
    figure(
        "3.3 b",
        "the same: small powers of residues",
        "02_surface",
        "@1hvr.pdb --spacing 1 --residue-power 0.1 --color residue",
        "surface.png",
    ),
    figure(
        "3.4",
        "resolution by domain of 2W4U",
        "01_density",
        "@1hvr.pdb --spacing 1 --residue-power 0.05 --chain-power 0.5",
        "slices.png",
    ),
    figure(
        "3.5",
        "surfaces of a protein of fewer atoms, 2O53",
        "05_eliminate",
        "@1A8O.pdb --spacing 0.8 --residue-power 0.25 --epsilon 0.1",
        "error.png",
    ),
    figure(
        "3.9",
        "eight proteins of Table 3.5",
        "02_surface",
        "@1A8O.pdb --spacing 0.7 --color chain",
        "surface.png",
    ),
    figure(
        "3.11",
        "two complexes of a signalling system",
        "03_tets",
        "@pdb/1su4.pdb|1hvr.pdb --spacing 1.5 --region interior",
        "surface.png",
    ),
    figure(
        "3.12",
        "three large proteins",
        "02_surface",
        "@large/2buk.pdb|5e5z.pdb --assembly 1 --spacing 2.4 --color residue",
        "surface.png",
    ),
    figure(
        "4.1",
        "eigenfunctions of the Hand",
        "06_modes",
        "@meshes/cgal_hand.off|spot.ply --count 8",
        "modes.png",
    ),
    figure(
        "4.3",
        "gradient of the 7th mode of the Eight",
        "07_field",
        "@meshes/dir_eight.off|bob_small.ply --guide modes:7",
        "field.png",
    ),
    figure(
        "4.4",
        "isocontours of several modes",
        "07_field",
        "@meshes/cgal_hand.off|spot.ply --guide modes:1,2,3,4",
        "field.png",
    ),
    figure(
        "4.2",
        "the field of the Hand by isocontours of two modes",
        "07_field",
        "@meshes/cgal_hand.off|spot.ply --guide modes:1,2",
        "field.png",
    ),
    figure(
        "4.6",
        "the same by characteristic values",
        "07_field",
        "@meshes/cgal_hand.off|spot.ply --guide characteristic:1,2",
        "field.png",
    ),
    figure(
        "4.7 c",
        "quads of the Hand, isocontours of six modes",
        "08_quads",
        "@meshes/cgal_hand.off|spot.ply --quads 1500 --guide modes:1,2,3,4,5,6 --mode hard",
        "quads.png",
    ),
    figure(
        "4.7 d",
        "the same, characteristic values",
        "08_quads",
        "@meshes/cgal_hand.off|spot.ply --quads 1500 --guide characteristic:1,2,3,4,5,6 --mode hard",
        "quads.png",
    ),
    figure(
        "4.8",
        "quads by the characteristic values of two modes",
        "08_quads",
        "@meshes/cgal_hand.off|spot.ply --quads 1500 --guide characteristic:1,2",
        "quads.png",
    ),
    figure(
        "4.9",
        "how strongly the guidance counts: softly",
        "08_quads",
        "@meshes/cgal_hand.off|spot.ply --quads 1500 --guide modes:1,2,3,4,5,6 --mode soft",
        "quads.png",
    ),
    figure(
        "4.10 a",
        "the gradient of the Bunny's first mode",
        "09_anisotropy",
        "@meshes/dir_bunny.off|spot.ply --quads 3000 --adapt",
        "field.png",
    ),
    figure(
        "4.10 f",
        "quads of the Bunny that are narrow along it",
        "09_anisotropy",
        "@meshes/dir_bunny.off|spot.ply --quads 3000 --adapt",
        "quads.png",
    ),
    figure(
        "4.11",
        "quads of the thin filament by different modes",
        "08_quads",
        "@1AJJ.pdb --spacing 1 --guide modes:1,2",
        "quads.png",
    ),
    figure(
        "4.11 g",
        "the same by principal curvatures",
        "08_quads",
        "@1AJJ.pdb --spacing 1 --guide curvature",
        "quads.png",
    ),
    figure(
        "4.12",
        "quads of 4KYT that are narrow along a mode's gradient",
        "09_anisotropy",
        "@pdb/1su4.pdb|1AJJ.pdb --spacing 2.5 --decay 0.1 --field mode:3 --quads 4000",
        "quads.png",
    ),
    figure(
        "5.1",
        "adaptive parameterization of 2W4U",
        "10_tmesh",
        "@1hvr.pdb --spacing 1.5 --residue-power 0.2 --levels chain:A=2,B=0",
        "tmesh.png",
    ),
    figure(
        "5.4",
        "an anisotropic T-mesh from a mode",
        "10_tmesh",
        "@spot.ply --quads 4000 --levels curvature",
        "tmesh.png",
    ),
    figure(
        "5.8",
        "multi-resolution spline surfaces",
        "11_tspline",
        "@spot.ply --quads 3000 --levels curvature",
        "surface.png",
    ),
    figure(
        "6.1",
        "first modes of two poses",
        "12_correspond",
        "@corresp/adk/adk_open.pdb|1A8O.pdb @corresp/adk/adk_closed.pdb|1A8O.cif",
        "modes.png",
    ),
    figure(
        "6.3",
        "correspondence of two poses, 2BPF and 2BPG",
        "12_correspond",
        "@corresp/adk/adk_open.pdb|1A8O.pdb @corresp/adk/adk_closed.pdb|1A8O.cif",
        "correspond.png",
    ),
    figure(
        "6.9",
        "the way from one pose to the other",
        "13_deform",
        "@corresp/adk/adk_open.pdb|1A8O.pdb @corresp/adk/adk_closed.pdb|1A8O.cif",
        "frames.png",
    ),
    figure(
        "6.11",
        "how much two shapes differ",
        "14_compare",
        "@corresp/adk/adk_open.pdb|1A8O.pdb @corresp/adk/adk_closed.pdb|1A8O.cif",
        "compare.png",
    ),
    figure(
        "7.1",
        "modes of the Elk by the secondary operator",
        "15_segment",
        "@meshes/vhacd_elk.off|spot.ply --operator slo",
        "modes.png",
    ),
    figure(
        "7.2",
        "segments of the Elk",
        "15_segment",
        "@meshes/vhacd_elk.off|spot.ply",
        "segments.png",
    ),
    figure(
        "7.5",
        "smoothing of the Moai",
        "17_smooth",
        "@meshes/moai.obj.gz|spot.ply",
        "smooth.png",
    ),
    figure(
        "7.7",
        "an enzyme's eigenfunctions and segments, 1BYH",
        "16_pockets",
        "@1hvr.pdb",
        "pockets.png",
    ),
    figure(
        "7.8",
        "another enzyme, 1C2B",
        "16_pockets",
        "@pockets/1eve.pdb|1A8O.pdb",
        "pockets.png",
    ),
];

/// Draws what is asked for. Runs that an earlier call has finished by the programs of today are not made again, so that
/// a gallery which was broken off goes on where it was.
pub(crate) fn run(arguments: &Arguments) -> Outcome {
    let build = ["build", "--quiet", "--workspace", "--examples"];
    crate::call("cargo", &build, &[])?;
    let out = root().join(&arguments.out);
    let work = out.join("work");
    fs::create_dir_all(&work).map_err(|e| format!("{}: {e}", work.display()))?;
    let mut failures = Vec::new();
    let chosen = FIGURES
        .iter()
        .filter(|f| f.number.starts_with(&arguments.only));
    for figure in chosen {
        let start = Instant::now();
        match draw(figure, &out, &work) {
            Ok(picture) => {
                let seconds = start.elapsed().as_secs_f64();
                println!("{}: {picture}, {seconds:.0} s", figure.number);
            }
            Err(why) => {
                println!("{}: FAILED", figure.number);
                failures.push(format!("{}: {why}", figure.number));
            }
        }
        write_page(&out)?;
    }
    if failures.is_empty() {
        Ok(())
    } else {
        Err(failures.join("\n"))
    }
}

/// The page of all figures that are drawn by now.
fn write_page(out: &Path) -> Outcome {
    let mut rows = String::new();
    for figure in FIGURES {
        let picture = picture(figure);
        if out.join(&picture).is_file() {
            let Figure { number, theirs, .. } = figure;
            let command = command(figure)?.1;
            rows += &format!(
                "<figure><img src=\"{picture}\" alt=\"\"><figcaption><b>{number}</b> There: {theirs}. \
                 Here:<br><code>{command}</code></figcaption></figure>\n"
            );
        }
    }
    fs::write(out.join("index.html"), format!("{HEAD}{rows}</main>\n")).map_err(|e| e.to_string())
}

const HEAD: &str = "<!doctype html><meta charset=\"utf-8\"><title>Figures</title>\n<style>body{font:16px sans-serif;margin:2em}\
main{display:grid;grid-template-columns:repeat(auto-fill,minmax(28em,1fr));gap:2em}figure{margin:0}img{width:100%}\
</style>\n<h1>Figures of the thesis, and ours</h1>\n<p>Atoms and models differ where theirs are not at hand: \
the command names ours.</p>\n<main>\n";

/// The name of a figure's picture.
fn picture(figure: &Figure) -> String {
    format!("{}.png", figure.number.replace(' ', ""))
}

/// Makes the picture of a figure, or takes that of an earlier run; its name.
fn draw(figure: &Figure, out: &Path, work: &Path) -> Result<String, String> {
    let (arguments, command) = command(figure)?;
    let program = target().join("debug/examples").join(figure.program);
    // Two figures of one run are made by one.
    let slug: String = command
        .chars()
        .map(|c| if c.is_ascii_alphanumeric() { c } else { '_' })
        .collect();
    let folder = work.join(&slug);
    if !is_newer(&folder, &program) {
        make(&program, &arguments, &folder).map_err(|why| format!("`{command}`: {why}"))?;
    }
    let picture = picture(figure);
    let from = folder.join(figure.picture);
    fs::copy(&from, out.join(&picture)).map_err(|e| format!("{}: {e}", from.display()))?;
    Ok(picture)
}

/// Runs a program. Its folder has this name only once it is whole.
fn make(program: &Path, arguments: &[String], folder: &Path) -> Outcome {
    let part = folder.with_extension("part");
    for old in [&part, folder] {
        if old.exists() {
            fs::remove_dir_all(old).map_err(|e| format!("{}: {e}", old.display()))?;
        }
    }
    let output = Command::new(program)
        .args(arguments)
        .args(["--quiet", "--out"])
        .arg(&part)
        .output()
        .map_err(|e| format!("{}: {e}", program.display()))?;
    if !output.status.success() {
        let told = String::from_utf8_lossy(&output.stderr);
        return Err(told.lines().last().unwrap_or_default().to_owned());
    }
    fs::rename(&part, folder).map_err(|e| format!("{}: {e}", folder.display()))
}

/// Was the one made after the other?
fn is_newer(made: &Path, than: &Path) -> bool {
    let time = |path: &Path| fs::metadata(path).and_then(|m| m.modified()).ok();
    matches!((time(made), time(than)), (Some(a), Some(b)) if a > b)
}

/// A figure's arguments with the files found, and its command as people would type it.
fn command(figure: &Figure) -> Result<(Vec<String>, String), String> {
    let (mut arguments, mut told) = (Vec::new(), vec![figure.program.to_owned()]);
    for word in figure.arguments.split(' ') {
        if let Some(files) = word.strip_prefix('@') {
            let found = input(files)?;
            let name = found.file_name().unwrap_or_default();
            told.push(name.to_string_lossy().into_owned());
            arguments.push(found.display().to_string());
        } else {
            told.push(word.to_owned());
            arguments.push(word.to_owned());
        }
    }
    Ok((arguments, told.join(" ")))
}

/// The first file of `a|b` that is there.
fn input(files: &str) -> Result<PathBuf, String> {
    let place = |name: &str| {
        let bundled = fixtures::path(name);
        if bundled.is_file() {
            Some(bundled)
        } else {
            fixtures::shared(name)
        }
    };
    files
        .split('|')
        .find_map(place)
        .ok_or_else(|| format!("none of {files} is here"))
}
