//! `cargo xtask bench`: what the programs take by their default options, stage by stage, and our kernels beside programs of
//! others, on the same input, in one run; and how all that compares with what was stored before.
//!
//! Times beside others are the best of three, and leave out start-up, reading and compilation on both sides.

#[cfg(any(test, feature = "lab"))]
#[cfg_attr(
    not(feature = "lab"),
    expect(dead_code, reason = "tested without the rest")
)]
mod baseline;
#[cfg(feature = "lab")]
pub(crate) mod beside;
#[cfg(feature = "lab")]
mod devices;
#[cfg(feature = "lab")]
mod programs;

use std::path::PathBuf;

#[cfg(feature = "lab")]
use self::baseline::Figures;

/// What is measured, and what it is compared with.
#[derive(clap::Args)]
pub(crate) struct Arguments {
    /// Only these: programs, kernels, large; devices (verbs on the GPU of this machine) only if it is named
    #[arg(long, value_name = "PART", value_delimiter = ',', default_values = &PARTS[..3], value_parser = PARTS)]
    only: Vec<String>,
    /// Of the verbs on devices only those whose name has this in it
    #[arg(
        long,
        value_name = "TEXT",
        default_value = "",
        hide_default_value = true
    )]
    matching: String,
    /// Runs of each program, of which the shortest counts
    #[arg(long, value_name = "N", default_value_t = 3, value_parser = clap::value_parser!(u32).range(1..))]
    runs: u32,
    /// What was stored before
    #[arg(long, value_name = "FILE", default_value = "benches/baseline.json")]
    baseline: PathBuf,
    /// Store the figures there: those of other parts stay, if they are of this machine
    #[arg(long)]
    save: bool,
    /// Fail where a ratio is worse than stored by more than this factor, or seconds are on the same machine
    #[arg(long, value_name = "FACTOR", default_value_t = 1.5)]
    tolerance: f64,
}

const PARTS: [&str; 4] = ["programs", "kernels", "large", "devices"];

/// Measures, compares, and stores if it is to.
#[cfg(feature = "lab")]
pub(crate) fn run(arguments: &Arguments) -> crate::Outcome {
    let mut figures = Figures::here();
    println!("{}", figures.machine());
    let asked = |part: &str| arguments.only.iter().any(|p| p == part);
    if asked("programs") {
        programs::run(&mut figures, arguments.runs)?;
    }
    if asked("kernels") {
        beside::kernels(&mut figures)?;
    }
    if asked("large") {
        beside::large(&mut figures)?;
    }
    if asked("devices") {
        devices::run(&mut figures, &arguments.matching)?;
    }
    let path = crate::root().join(&arguments.baseline);
    let stored = Figures::read(&path)?;
    let worse = match &stored {
        Some(stored) => figures.beside(stored, arguments.tolerance),
        None => {
            println!("nothing stored in {}", path.display());
            Vec::new()
        }
    };
    if arguments.save {
        if let Some(stored) = stored {
            figures.take_over(stored);
        }
        figures.save(&path)?;
        println!("stored in {}", path.display());
        return Ok(());
    }
    if worse.is_empty() {
        Ok(())
    } else {
        Err(format!("worse than stored: {}", worse.join("; ")))
    }
}

/// The last result and the shortest of three times.
#[cfg(feature = "lab")]
fn best<T, E: std::fmt::Display>(
    mut work: impl FnMut() -> Result<T, E>,
) -> Result<(T, f64), String> {
    let mut least = f64::INFINITY;
    let mut last = None;
    for _ in 0..3 {
        // Not two at once: they may be large.
        drop(last.take());
        let start = std::time::Instant::now();
        last = Some(work().map_err(|e| e.to_string())?);
        least = least.min(start.elapsed().as_secs_f64());
    }
    Ok((last.expect("three rounds"), least))
}
