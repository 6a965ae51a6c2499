//! The tests of a crate, run until the first of them fails.

use std::collections::BTreeSet;
use std::fmt;
use std::io::{BufRead, BufReader};
use std::path::PathBuf;
use std::process::{Command, Stdio};
use std::sync::mpsc::{self, RecvTimeoutError};
use std::time::{Duration, Instant};

use serde_json::Value;

use super::copy::Copy;
use super::lists::Fault;
use crate::Outcome;

/// What became of a fault.
pub(super) enum Verdict {
    /// This test failed.
    Caught(String),
    /// The tests came to no end.
    Hung,
    /// The program died: a stack overflow, an abort.
    Died,
    /// Every test passed.
    Survived,
}

impl fmt::Display for Verdict {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Caught(test) => write!(f, "seen by {test}"),
            Self::Hung => f.write_str("seen: the tests come to no end"),
            Self::Died => f.write_str("seen: the tests die"),
            Self::Survived => f.write_str("SURVIVES"),
        }
    }
}

/// The tests of a crate: the program of its folder `tests`.
pub(super) struct Trial<'a> {
    copy: &'a Copy,
    name: &'static str,
    /// Most time for all of them.
    limit: Duration,
}

/// Most time for one test that has seen a fault before.
const WITNESS: Duration = Duration::from_secs(300);
/// Most time for all tests of a crate while nobody has timed them.
const ALL: Duration = Duration::from_secs(3600);

impl<'a> Trial<'a> {
    /// Runs what will be asked without a fault, which must pass: the witnesses, and all tests only if a fault has none.
    pub(super) fn start(
        copy: &'a Copy,
        name: &'static str,
        faults: &[&Fault],
    ) -> Result<Self, String> {
        let mut trial = Self {
            copy,
            name,
            limit: ALL,
        };
        let witnesses = faults.iter().filter_map(|fault| fault.witness);
        let asked = Vec::from_iter(witnesses.collect::<BTreeSet<&str>>());
        if !asked.is_empty() {
            trial.must_pass(&asked)?;
        }
        if faults.iter().any(|fault| fault.witness.is_none()) {
            let start = Instant::now();
            trial.must_pass(&[])?;
            trial.limit = 5 * start.elapsed() + Duration::from_secs(60);
        }
        Ok(trial)
    }

    fn must_pass(&self, only: &[&str]) -> Outcome {
        match self.run(only, self.limit)? {
            Verdict::Survived => Ok(()),
            verdict => Err(format!("{} without a fault: {verdict}", self.name)),
        }
    }

    /// What the tests say of a fault that is in place: its witness first, then all.
    pub(super) fn verdict(&self, fault: &Fault) -> Result<Verdict, String> {
        let seen = match fault.witness {
            Some(witness) => self.run(&[witness], WITNESS)?,
            None => Verdict::Survived,
        };
        match seen {
            Verdict::Survived => self.run(&[], self.limit),
            seen => Ok(seen),
        }
    }

    /// Runs the tests, or only those of these names, until the first failure.
    fn run(&self, only: &[&str], limit: Duration) -> Result<Verdict, String> {
        let program = self.build()?;
        let folder = self.copy.folder().join("crates").join(self.name);
        let mut tests = Command::new(program);
        if !only.is_empty() {
            tests.arg("--exact").args(only);
        }
        tests
            .current_dir(folder)
            .env("GEOM_REQUIRE_GPU", "1")
            // A failure that a property finds is not to be written down in the copy.
            .env("PROPTEST_FAILURE_PERSISTENCE", "off");
        first_failure(tests, limit, only.len())
    }

    /// Builds the tests; gives the program. The whole workspace is named, so that other crates are built with the features
    /// that they have everywhere.
    fn build(&self) -> Result<PathBuf, String> {
        let program = format!("{}-tests", self.name);
        let output = self
            .copy
            .cargo()
            .args(["test", "--no-run", "--quiet", "--message-format=json"])
            .args(["--workspace", "--test", &program])
            .stderr(Stdio::inherit())
            .output()
            .map_err(|e| format!("cannot run cargo: {e}"))?;
        let messages: Vec<Value> = String::from_utf8_lossy(&output.stdout)
            .lines()
            .filter_map(|line| serde_json::from_str(line).ok())
            .collect();
        if !output.status.success() {
            let rendered = messages
                .iter()
                .filter_map(|m| m["message"]["rendered"].as_str());
            let error = rendered
                .filter(|text| text.starts_with("error"))
                .collect::<String>();
            return Err(format!("the tests of {} do not build: {error}", self.name));
        }
        let built = messages.iter().rev().find_map(|m| m["executable"].as_str());
        built
            .map(PathBuf::from)
            .ok_or_else(|| format!("cargo built no tests of {}", self.name))
    }
}

/// Runs a test program until its first failure, or so long. Fewer tests than `least` are a mistake in their names.
fn first_failure(mut program: Command, limit: Duration, least: usize) -> Result<Verdict, String> {
    let failed = |e: std::io::Error| format!("cannot run the tests: {e}");
    let mut child = program
        .stdout(Stdio::piped())
        .stderr(Stdio::null())
        .spawn()
        .map_err(failed)?;
    let lines = BufReader::new(child.stdout.take().expect("piped")).lines();
    let (sender, receiver) = mpsc::channel();
    // Ends with the program, which closes the pipe.
    let reader = std::thread::spawn(move || {
        for line in lines.map_while(Result::ok) {
            if sender.send(line).is_err() {
                break;
            }
        }
    });
    let end = Instant::now() + limit;
    let mut passed = 0;
    let verdict = loop {
        match receiver.recv_timeout(end.saturating_duration_since(Instant::now())) {
            Ok(line) => {
                passed += usize::from(line.starts_with("test ") && line.ends_with(" ... ok"));
                if let Some(test) = failure(&line) {
                    break Some(Verdict::Caught(test.to_owned()));
                }
            }
            Err(RecvTimeoutError::Timeout) => break Some(Verdict::Hung),
            Err(RecvTimeoutError::Disconnected) => break None,
        }
    };
    if verdict.is_some() {
        // It may have ended by itself.
        let _ = child.kill();
    }
    let status = child.wait().map_err(failed)?;
    drop(receiver);
    let _ = reader.join();
    Ok(match verdict {
        Some(verdict) => verdict,
        None if status.success() && passed < least => {
            return Err(format!("{least} tests are named, {passed} are found"));
        }
        None if status.success() => Verdict::Survived,
        None => Verdict::Died,
    })
}

/// The test that a line of a test program says has failed.
fn failure(line: &str) -> Option<&str> {
    let test = line.strip_prefix("test ")?.strip_suffix(" ... FAILED")?;
    // A test that should panic says so after its name.
    Some(test.split(' ').next().unwrap_or(test))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_of_tests_are_read() {
        assert_eq!(failure("test laws::signs ... FAILED"), Some("laws::signs"));
        assert_eq!(
            failure("test laws::signs - should panic ... FAILED"),
            Some("laws::signs")
        );
        for line in [
            "test laws::signs ... ok",
            "test result: FAILED. 3 passed; 1 failed",
            "failures:",
        ] {
            assert_eq!(failure(line), None);
        }
    }

    #[cfg(unix)]
    #[test]
    fn programs_end_in_four_ways() {
        let verdict = |script: &str| {
            let mut shell = Command::new("sh");
            shell.args(["-c", script]);
            first_failure(shell, Duration::from_millis(1500), 0)
                .unwrap()
                .to_string()
        };
        assert_eq!(verdict("echo 'test a ... ok'"), "SURVIVES");
        assert_eq!(verdict("echo 'test a ... FAILED'; exit 1"), "seen by a");
        assert_eq!(verdict("exec sleep 30"), "seen: the tests come to no end");
        assert_eq!(verdict("kill -6 $$"), "seen: the tests die");
        let mut shell = Command::new("sh");
        shell.args(["-c", "echo 'test a ... ok'"]);
        let misspelt = first_failure(shell, Duration::from_secs(9), 2).err();
        assert_eq!(misspelt.unwrap(), "2 tests are named, 1 are found");
    }
}
