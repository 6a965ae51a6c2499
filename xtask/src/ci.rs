//! `cargo xtask ci`: what must hold before a change lands, cheapest first.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::OnceLock;
use std::time::{Duration, Instant};

use serde_json::Value;

use crate::{Outcome, arrows, call, docs, fixtures, package, root, target};

/// Runs every step, prints how long each took, and stops at the first that fails.
pub(crate) fn run() -> Outcome {
    let deny: &[(&str, &str)] = &[("RUSTDOCFLAGS", "-D warnings")];
    let steps: &[(&str, &dyn Fn() -> Outcome)] = &[
        ("format", &|| {
            call("cargo", &["fmt", "--all", "--check"], &[])
        }),
        ("arrows", &arrows::run),
        ("fixtures", &fixtures::run),
        // The README's own test command.
        ("tests", &|| call("cargo", &["test", "--workspace"], &[])),
        ("lints", &|| {
            let all = ["clippy", "--workspace", "--all-targets", "--features"];
            let features = features(has_mpi())?;
            let rest = [features.as_str(), "--", "-D", "warnings"];
            call("cargo", &[&all[..], &rest].concat(), &[])?;
            // The build of `cargo pipeline`, which nothing else here asks for.
            let lightest = [
                "clippy",
                "--package",
                "biogeom-examples",
                "--no-default-features",
            ];
            let rest = ["--examples", "--", "-D", "warnings"];
            call("cargo", &[&lightest[..], &rest].concat(), &[])
        }),
        ("documentation", &|| {
            let features = features(has_mpi())?;
            // With one example what we use has the features that lints and tests have; else it would be checked anew.
            let what = ["--lib", "--bins", "--example", "01_density"];
            let all = ["doc", "--workspace", "--no-deps", "--features", &features];
            call("cargo", &[&all[..], &what].concat(), deny)
        }),
        // After the tests, which have built the programs.
        ("pages", &|| docs::run(&docs::Arguments { quick: true })),
        // Without a GPU's features, which no other step leaves out.
        ("packages", &|| {
            package::run(&package::Arguments { quick: true })
        }),
        ("ranks of MPI", &ranks),
    ];
    for (name, step) in steps {
        println!("── {name}");
        let start = Instant::now();
        step().map_err(|reason| format!("{name}: {reason}"))?;
        println!("── {name}: {:.0} s", start.elapsed().as_secs_f64());
    }
    println!("steps: {} passed, 0 failed", steps.len());
    Ok(())
}

/// Is a system MPI at hand, with all that building against it takes? Asked once.
fn has_mpi() -> bool {
    static FOUND: OnceLock<bool> = OnceLock::new();
    *FOUND.get_or_init(|| {
        // The binding's own build reads headers by libclang. What else it may lack the lints tell, as an error.
        let libclang = "[ -n \"${LIBCLANG_PATH:-}\" ] || ldconfig -p | grep -q libclang";
        let probes: [(&str, &[&str]); 3] = [
            ("mpicc", &["--version"]),
            ("mpirun", &["--oversubscribe", "-n", "2", "true"]),
            ("sh", &["-c", libclang]),
        ];
        let failed = probes.into_iter().find_map(|(program, arguments)| {
            let asked = as_root(Command::new(program).args(arguments)).output();
            let why = match asked {
                Ok(answer) if answer.status.success() => return None,
                Ok(answer) => String::from_utf8_lossy(&answer.stderr).into_owned(),
                Err(e) => e.to_string(),
            };
            Some((program, arguments, why))
        });
        if let Some((program, arguments, why)) = &failed {
            let (arguments, why) = (arguments.join(" "), why.lines().next().unwrap_or_default());
            println!(
                "SKIPPED: `{program} {arguments}` fails here ({why}), so nothing is built for MPI"
            );
        }
        failed.is_none()
    })
}

/// Containers run as root, which Open MPI refuses unless told.
fn as_root(command: &mut Command) -> &mut Command {
    command
        .env("OMPI_ALLOW_RUN_AS_ROOT", "1")
        .env("OMPI_ALLOW_RUN_AS_ROOT_CONFIRM", "1")
}

/// The mesh of a body in tiles is the same whether one process makes it or `mpirun` starts several.
fn ranks() -> Outcome {
    if !has_mpi() {
        println!("SKIPPED: there is no MPI to run anything by");
        return Ok(());
    }
    // All crates are built anew for the feature. Optimizing them takes longer than five small meshes do without.
    let ours = arrows::LIBRARIES.iter().chain(&["biogeom-examples"]);
    let plain = ours.map(|name| format!("profile.dev.package.{name}.opt-level=0"));
    let plain: Vec<String> = plain.collect();
    let mut build = vec!["build", "--workspace", "--example", "20_tiles"];
    build.extend(["--features", "biogeom-examples/mpi"]);
    plain.iter().for_each(|set| build.extend(["--config", set]));
    call("cargo", &build, &[])?;
    let target = target();
    let program = target.join("debug/examples/20_tiles");
    let input = root().join("fixtures/files/1AJJ.pdb");
    let digest = |ranks: Option<u32>| -> Result<String, String> {
        let out = target.join("ranks");
        let mut command = match ranks {
            None => Command::new(&program),
            Some(ranks) => {
                let mut command = Command::new("mpirun");
                let ranks = ranks.to_string();
                command
                    .args(["--oversubscribe", "-n", &ranks])
                    .arg(&program);
                command
            }
        };
        let exchange = if ranks.is_some() { "mpi" } else { "solo" };
        command.arg(&input).arg("--out").arg(&out);
        command.args(["--spacing", "1", "--tiles", "5", "--no-pictures"]);
        command.args(["--exchange", exchange]);
        let done = as_root(&mut command).output();
        let done = done.map_err(|e| e.to_string())?;
        if !done.status.success() {
            return Err(String::from_utf8_lossy(&done.stderr).into_owned());
        }
        let report = fs::read(out.join("report.json")).map_err(|e| e.to_string())?;
        let report: Value = serde_json::from_slice(&report).map_err(|e| e.to_string())?;
        Ok(report["tiles"]["digest"].to_string())
    };
    let alone = digest(None)?;
    for ranks in [1, 2, 3, 7] {
        let found = digest(Some(ranks))?;
        println!("{ranks} ranks: {found}");
        if found != alone {
            return Err(format!("{ranks} ranks make {found}, one process {alone}"));
        }
    }
    killed(&program, &input)
}

/// A rank that is killed in the middle of its work ends all of them, and nothing is left of what any has begun.
fn killed(program: &Path, input: &Path) -> Outcome {
    if !Path::new("/proc/self/task").exists() {
        println!("SKIPPED: this system does not tell who the ranks are, so none is killed");
        return Ok(());
    }
    // Fine enough to be killed in time; a machine on which all is done before is given more to do.
    for spacing in ["0.4", "0.25", "0.15"] {
        if is_killed(program, input, spacing)? {
            return Ok(());
        }
        println!("all ranks had ended at a spacing of {spacing} before one was killed");
    }
    Err("no rank could be killed while all of them worked".into())
}

/// The same at one spacing; `false` if the work was done before all ranks were seen at it.
fn is_killed(program: &Path, input: &Path, spacing: &str) -> Result<bool, String> {
    let out = target().join("killed");
    let mut command = Command::new("mpirun");
    command.args(["--oversubscribe", "-n", "3"]).arg(program);
    command.arg(input).arg("--out").arg(&out);
    command.args(["--spacing", spacing, "--tiles", "7", "--improve"]);
    command.args(["--exchange", "mpi", "--no-pictures", "--quiet"]);
    command.stdout(Stdio::null()).stderr(Stdio::piped());
    let mut parent = as_root(&mut command).spawn().map_err(|e| e.to_string())?;
    let inside = |folder: &Path| -> Vec<PathBuf> {
        let entries = fs::read_dir(folder).into_iter().flatten().flatten();
        entries.map(|e| e.path()).collect()
    };
    // Each rank puts its pieces aside in a folder of its own, within that of its outputs.
    let works = |rank: &PathBuf| inside(rank).iter().any(|f| !inside(f).is_empty());
    let begun = || inside(&out).iter().filter(|rank| works(rank)).count() == 3;
    // Those of each of its threads.
    let threads = PathBuf::from(format!("/proc/{}/task", parent.id()));
    // Ranks that wait for each other for ever are killed, too, and nothing hangs.
    let last = Instant::now() + Duration::from_secs(60);
    while Instant::now() < last && !begun() {
        if parent.try_wait().map_err(|e| e.to_string())?.is_some() {
            break;
        }
        std::thread::sleep(Duration::from_millis(20));
    }
    // None are left of a job that has ended, and the last may be ending now: how the job ends tells.
    let children = |thread: PathBuf| fs::read_to_string(thread.join("children"));
    let ranks = inside(&threads).into_iter().map(children);
    let ranks: String = ranks.filter_map(Result::ok).collect();
    if let Some(rank) = ranks.split_whitespace().last() {
        let killed = Command::new("kill").args(["-9", rank]).output();
        killed.map_err(|e| format!("kill: {e}"))?;
    }
    let ended = parent.wait_with_output().map_err(|e| e.to_string())?;
    if ended.status.success() {
        fs::remove_dir_all(&out).map_err(|e| e.to_string())?;
        return Ok(false);
    }
    let said = String::from_utf8_lossy(&ended.stderr);
    let left = inside(&out);
    match (said.contains("signal 9"), &left[..]) {
        (true, []) => Ok(true),
        _ => Err(format!(
            "a rank was killed; {}, left are {left:?}, and what was said is:\n{said}",
            ended.status
        )),
    }
}

/// All features of all packages, for `--features`; those that need a system MPI only with `mpi`.
fn features(mpi: bool) -> Result<String, String> {
    let arguments = ["metadata", "--no-deps", "--format-version", "1"];
    let told = Command::new("cargo").args(arguments).output();
    let told = told.map_err(|e| format!("cargo metadata: {e}"))?;
    let told: Value = serde_json::from_slice(&told.stdout).map_err(|e| e.to_string())?;
    let packages = told["packages"].as_array().into_iter().flatten();
    let features = packages.flat_map(|package| {
        let name = package["name"].as_str().unwrap_or_default();
        let own = package["features"].as_object().into_iter().flatten();
        own.filter(move |(feature, _)| *feature != "mpi" || mpi)
            .map(move |(feature, _)| format!("{name}/{feature}"))
    });
    Ok(features.collect::<Vec<_>>().join(","))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn features_are_all_that_this_machine_can_build() {
        for mpi in [true, false] {
            let features = features(mpi).expect("cargo tells");
            let has = |name: &str| features.split(',').any(|feature| feature == name);
            assert!(has("geom-core/wgpu") && has("gauss-density/thesis") && has("xtask/lab"));
            assert_eq!(has("geom-core/mpi"), mpi);
            assert_eq!(has("biogeom-examples/mpi"), mpi);
        }
    }
}
