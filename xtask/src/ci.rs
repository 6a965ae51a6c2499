//! `cargo xtask ci`: what must hold before a change lands, cheapest first.

use std::time::Instant;

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
            let all = ["clippy", "--workspace", "--all-targets", "--all-features"];
            call(
                "cargo",
                &[&all[..], &["--", "-D", "warnings"]].concat(),
                &[],
            )
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
            call(
                "cargo",
                &["doc", "--workspace", "--no-deps", "--all-features"],
                deny,
            )
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
