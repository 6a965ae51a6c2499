//! `cargo xtask ci`: what must hold before a change lands, cheapest first.

use std::process::Command;
use std::time::Instant;

use serde_json::Value;

use crate::{Outcome, arrows, call, fixtures};

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
            let features = features()?;
            let rest = [features.as_str(), "--", "-D", "warnings"];
            call("cargo", &[&all[..], &rest].concat(), &[])
        }),
        ("lints without a GPU", &|| {
            let mut arguments = vec!["clippy", "--no-default-features"];
            for package in arrows::LIBRARIES {
                arguments.extend(["--package", package]);
            }
            arguments.extend(["--", "-D", "warnings"]);
            call("cargo", &arguments, &[])
        }),
        ("documentation", &|| {
            let features = features()?;
            let all = ["doc", "--workspace", "--no-deps", "--features", &features];
            call("cargo", &all, deny)
        }),
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

/// A system MPI is at hand, with what building against it takes.
fn has_mpi() -> bool {
    let answers = |program: &str| {
        let asked = Command::new(program).arg("--version").output();
        asked.is_ok_and(|answer| answer.status.success())
    };
    ["mpicc", "mpirun"].into_iter().all(answers)
}

/// All features of all packages, for `--features`; those that need a system MPI only where there is one.
fn features() -> Result<String, String> {
    let arguments = ["metadata", "--no-deps", "--format-version", "1"];
    let told = Command::new("cargo").args(arguments).output();
    let told = told.map_err(|e| format!("cargo metadata: {e}"))?;
    let told: Value = serde_json::from_slice(&told.stdout).map_err(|e| e.to_string())?;
    let mpi = has_mpi();
    if !mpi {
        println!("no mpicc and mpirun here: the feature `mpi` is left out");
    }
    let packages = told["packages"].as_array().into_iter().flatten();
    let features = packages.flat_map(|package| {
        let name = package["name"].as_str().unwrap_or_default();
        let own = package["features"].as_object().into_iter().flatten();
        own.filter(move |(feature, _)| *feature != "mpi" || mpi)
            .map(move |(feature, _)| format!("{name}/{feature}"))
    });
    Ok(features.collect::<Vec<_>>().join(","))
}
