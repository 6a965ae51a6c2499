//! `cargo xtask fuzz`: faulty files and meshes, as many as there is time for, for every reader and every verb.
//!
//! Each target runs in a process of its own, which says which case it begins; a case is a number from which its input is
//! made, so that one that fails is run again by `--target NAME --case N`. A panic, a message that is no line, more than
//! [`SECONDS`] or [`BYTES`] is a find. Each becomes a test by a name of its own where its crate's tests are.

mod mutate;
mod targets;

use std::collections::BTreeSet;
use std::fs;
use std::io::{BufRead, BufReader, Write};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::process::{Command, Stdio};
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};
use std::time::{Duration, Instant};

use geom_core::testing::faults::Random;
use targets::TARGETS;

use crate::Outcome;

/// What one case may take.
const SECONDS: u64 = 30;
/// What a process may hold.
const BYTES: u64 = 4 << 30;

/// How long, and what.
pub(crate) fn run(
    minutes: f64,
    target: Option<&str>,
    case: Option<u64>,
    child: Option<u64>,
) -> Outcome {
    if let Some(name) = target
        && !TARGETS.iter().any(|(own, _)| *own == name)
    {
        let names: Vec<_> = TARGETS.iter().map(|(name, _)| *name).collect();
        return Err(format!(
            "no target `{name}`; there are {}",
            names.join(", ")
        ));
    }
    let chosen = TARGETS
        .iter()
        .filter(|(name, _)| target.is_none_or(|t| t == *name));
    if let Some(case) = case {
        for (name, work) in chosen {
            println!("{name} {case}: {:?}", work(&mut Random::new(case)));
        }
        return Ok(());
    }
    if let Some(first) = child {
        return chosen
            .take(1)
            .try_for_each(|(_, work)| endless(*work, first));
    }
    let share = Duration::from_secs_f64(60.0 * minutes / chosen.clone().count() as f64);
    let mut finds = Vec::new();
    for (name, _) in chosen {
        finds.extend(hunt(name, share)?);
    }
    if finds.is_empty() {
        println!("nothing found");
        return Ok(());
    }
    Err(format!("{} finds:\n{}", finds.len(), finds.join("\n")))
}

/// What a process of a target tells: `begin N`, then `taken`, `refused` or `panic WHERE AND WHY`.
fn endless(work: fn(&mut Random) -> targets::Fate, first: u64) -> Outcome {
    std::panic::set_hook(Box::new(|info| {
        let text = info.to_string().replace('\n', " ");
        println!("panic {text}");
    }));
    let mut out = std::io::stdout();
    for case in first.. {
        println!("begin {case}");
        out.flush().map_err(|e| e.to_string())?;
        match catch_unwind(AssertUnwindSafe(|| work(&mut Random::new(case)))) {
            Ok(Ok(())) => println!("taken"),
            Ok(Err(reason)) if reason.is_empty() || reason.contains('\n') => {
                println!("panic the reason is no line: {reason:?}");
            }
            Ok(Err(_)) => println!("refused"),
            // The hook has said it.
            Err(_) => {}
        }
    }
    Ok(())
}

/// Runs a target for some time; a process that dies or is ended begins again behind its case.
fn hunt(name: &str, share: Duration) -> Result<Vec<String>, String> {
    let end = Instant::now() + share;
    let mut hunt = Hunt::default();
    while Instant::now() < end {
        let own = std::env::current_exe().map_err(|e| e.to_string())?;
        let mut child = Command::new(own)
            .args(["fuzz", "--target", name, "--child", &hunt.case.to_string()])
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .map_err(|e| e.to_string())?;
        let pipe = child.stdout.take().ok_or("a process without output")?;
        let (send, lines) = channel();
        let reader = std::thread::spawn(move || {
            let told = BufReader::new(pipe).lines().map_while(Result::ok);
            told.take_while(|line| send.send(line.clone()).is_ok())
                .count()
        });
        let died = hunt.watch(name, &lines, child.id(), end);
        // It may have ended on its own.
        let _ = child.kill();
        let _ = child.wait();
        drop(lines);
        let _ = reader.join();
        if let Some(why) = died {
            hunt.find(name, why);
            hunt.case += 1;
        }
    }
    let Hunt {
        taken,
        refused,
        finds,
        ..
    } = hunt;
    println!(
        "{name}: {taken} taken, {refused} refused, {} finds",
        finds.len()
    );
    Ok(finds)
}

/// What has become of a target's cases.
#[derive(Default)]
struct Hunt {
    case: u64,
    taken: u64,
    refused: u64,
    finds: Vec<String>,
    /// Where it panicked: the same place again is no news.
    places: BTreeSet<String>,
}

impl Hunt {
    /// Listens to a process until its time is over; why, if it has to be begun anew.
    fn watch(
        &mut self,
        name: &str,
        lines: &Receiver<String>,
        process: u32,
        end: Instant,
    ) -> Option<&'static str> {
        let mut begun = Instant::now();
        while Instant::now() < end {
            match lines.recv_timeout(Duration::from_millis(300)) {
                Ok(line) => match line.split_once(' ') {
                    Some(("begin", number)) => {
                        self.case = number.parse().unwrap_or(self.case);
                        begun = Instant::now();
                    }
                    Some(("panic", why)) => self.find(name, why),
                    _ if line == "taken" => self.taken += 1,
                    _ => self.refused += 1,
                },
                Err(RecvTimeoutError::Disconnected) => return Some("the process died"),
                Err(RecvTimeoutError::Timeout) => {}
            }
            if begun.elapsed() > Duration::from_secs(SECONDS) {
                return Some("too slow");
            }
            if resident(process) > BYTES {
                return Some("too much memory");
            }
        }
        None
    }

    fn find(&mut self, name: &str, why: &str) {
        let place = why.split(": ").next().unwrap_or(why).to_owned();
        if self.places.insert(place) || !why.starts_with("panicked at") {
            let find = format!("--target {name} --case {}: {why}", self.case);
            println!("{find}");
            self.finds.push(find);
        }
    }
}

/// Bytes that a process holds, where the system tells.
fn resident(process: u32) -> u64 {
    let status = fs::read_to_string(format!("/proc/{process}/status")).unwrap_or_default();
    let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:"));
    let kilobytes = line.and_then(|line| line.split_whitespace().next()?.parse::<u64>().ok());
    kilobytes.unwrap_or(0) * 1024
}
