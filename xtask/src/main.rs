//! The project's own chores: `cargo xtask --help` lists them.

#![expect(
    clippy::print_stdout,
    clippy::print_stderr,
    reason = "a program that people run"
)]

mod arrows;
mod ci;
mod docs;
mod faults;
mod fixtures;
mod gallery;
mod lab;
mod package;

use std::process::{Command, ExitCode};

use clap::{Parser, Subcommand};

/// What a chore gives back: an error is one line for people.
type Outcome = Result<(), String>;

/// The project's own chores.
#[derive(Parser)]
#[command(name = "cargo xtask")]
struct Arguments {
    #[command(subcommand)]
    chore: Chore,
}

#[derive(Subcommand)]
enum Chore {
    /// Everything that must hold before a change lands, cheapest first: format, arrows, tests, lints,
    /// documentation, and the CPU-only build.
    Ci,
    /// The arrows between the crates are those of the architecture, and no others.
    Arrows,
    #[command(flatten)]
    Lab(lab::Chore),
    /// Plants faults in a copy of the workspace, one at a time, and says which of them the tests see. Fails where
    /// they see less than 95 % of those that change results.
    Faults(faults::Arguments),
    /// The bundled files are those that fixtures/README.md lists.
    Fixtures,
    /// Counterparts of the thesis's figures, drawn by our programs, on one page.
    Gallery(gallery::Arguments),
    /// What the pages name is there, and what they tell people to type works.
    Docs(docs::Arguments),
    /// The crates as others get them: packed, their licences checked, unpacked, each built from there with and without
    /// default features, and two programs of somebody else's built on them and run.
    Package(package::Arguments),
}

fn main() -> ExitCode {
    let outcome = match Arguments::parse().chore {
        Chore::Ci => ci::run(),
        Chore::Arrows => arrows::run(),
        Chore::Lab(chore) => lab::run(&chore),
        Chore::Faults(arguments) => faults::run(&arguments),
        Chore::Fixtures => fixtures::run(),
        Chore::Gallery(arguments) => gallery::run(&arguments),
        Chore::Docs(arguments) => docs::run(&arguments),
        Chore::Package(arguments) => package::run(&arguments),
    };
    match outcome {
        Ok(()) => ExitCode::SUCCESS,
        Err(reason) => {
            eprintln!("xtask: {reason}");
            ExitCode::FAILURE
        }
    }
}

/// Runs a program in the workspace root; an error unless it exits with 0.
fn call(program: &str, arguments: &[&str], environment: &[(&str, &str)]) -> Outcome {
    let line = format!("{program} {}", arguments.join(" "));
    let status = Command::new(program)
        .args(arguments)
        .envs(environment.iter().copied())
        .current_dir(root())
        .status()
        .map_err(|e| format!("cannot run {program}: {e}"))?;
    if status.success() {
        Ok(())
    } else {
        Err(format!("`{line}` failed: {status}"))
    }
}

/// What a program prints; an error unless it exits with 0.
#[cfg(feature = "lab")]
fn capture(program: &str, arguments: &[String]) -> Result<String, String> {
    let output = Command::new(program)
        .args(arguments)
        .stderr(std::process::Stdio::inherit())
        .output()
        .map_err(|e| format!("cannot run {program}: {e}"))?;
    if !output.status.success() {
        let line = format!("{program} {}", arguments.join(" "));
        return Err(format!("`{line}` failed: {}", output.status));
    }
    String::from_utf8(output.stdout).map_err(|_| format!("{program} printed no text"))
}

/// The workspace root.
fn root() -> &'static std::path::Path {
    std::path::Path::new(env!("CARGO_MANIFEST_DIR"))
        .parent()
        .expect("xtask lies in the workspace")
}

/// Where cargo builds.
fn target() -> std::path::PathBuf {
    let asked = std::env::var_os("CARGO_TARGET_DIR");
    root().join(asked.unwrap_or_else(|| "target".into()))
}
