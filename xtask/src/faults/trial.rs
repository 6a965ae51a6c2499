//! The tests of a crate, run until the first of them fails.

use std::fmt;
use std::io::{BufRead, BufReader};
use std::path::PathBuf;
use std::process::{Command, Stdio};
use std::sync::mpsc::{self, RecvTimeoutError};
use std::time::{Duration, Instant};

use serde_json::Value;

use super::copy::Copy;

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

/// The tests of a crate: the program of its folder `tests`, and those beside its code.
pub(super) struct Trial<'a> {
    copy: &'a Copy,
    name: &'static str,
    /// What they took without a fault.
    took: Duration,
}

/// Which tests of a crate.
#[derive(Clone, Copy)]
enum Tests {
    /// Its folder `tests`. The whole workspace is named, so that other crates are built with the features that they
    /// have everywhere.
    Folder,
    /// Those beside the code.
    Inside,
}

impl<'a> Trial<'a> {
    /// Runs the tests without a fault, which they must pass.
    pub(super) fn start(copy: &'a Copy, name: &'static str) -> Result<Self, String> {
        let mut trial = Self {
            copy,
            name,
            took: Duration::from_secs(3600),
        };
        let start = Instant::now();
        match trial.run(Tests::Folder)? {
            Verdict::Survived => {}
            verdict => return Err(format!("{name} without a fault: {verdict}")),
        }
        trial.took = start.elapsed();
        Ok(trial)
    }

    pub(super) fn seconds(&self) -> f64 {
        self.took.as_secs_f64()
    }

    /// What the tests say now: those beside the code are asked only where the others see nothing.
    pub(super) fn verdict(&self) -> Result<Verdict, String> {
        match self.run(Tests::Folder)? {
            Verdict::Survived => self.run(Tests::Inside),
            verdict => Ok(verdict),
        }
    }

    fn run(&self, tests: Tests) -> Result<Verdict, String> {
        let program = self.build(tests)?;
        let folder = self.copy.folder().join("crates").join(self.name);
        let mut tests = Command::new(program);
        tests
            .current_dir(folder)
            .env("GEOM_REQUIRE_GPU", "1")
            // A failure that a property finds is not to be written down in the copy.
            .env("PROPTEST_FAILURE_PERSISTENCE", "off");
        first_failure(tests, 5 * self.took + Duration::from_secs(60))
    }

    /// Builds the tests; gives the program.
    fn build(&self, tests: Tests) -> Result<PathBuf, String> {
        let program = format!("{}-tests", self.name);
        let which = match tests {
            Tests::Folder => vec!["--workspace", "--test", &program],
            Tests::Inside => vec!["--package", self.name, "--all-features", "--lib"],
        };
        let output = self
            .copy
            .cargo()
            .args(["test", "--no-run", "--quiet", "--message-format=json"])
            .args(which)
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

/// Runs a test program until its first failure, or so long.
fn first_failure(mut program: Command, limit: Duration) -> Result<Verdict, String> {
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
    let verdict = loop {
        match receiver.recv_timeout(end.saturating_duration_since(Instant::now())) {
            Ok(line) => {
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
            first_failure(shell, Duration::from_millis(1500))
                .unwrap()
                .to_string()
        };
        assert_eq!(verdict("echo 'test a ... ok'"), "SURVIVES");
        assert_eq!(verdict("echo 'test a ... FAILED'; exit 1"), "seen by a");
        assert_eq!(verdict("exec sleep 30"), "seen: the tests come to no end");
        assert_eq!(verdict("kill -6 $$"), "seen: the tests die");
    }
}
