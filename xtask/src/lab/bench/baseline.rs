//! The figures of a run, and those that are stored.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use serde_json::{Value, json};

use crate::Outcome;

/// Seconds below this are noise.
const SHORT: f64 = 0.05;

/// A figure; the smaller the better.
#[derive(Clone, Copy)]
enum Figure {
    /// Of this machine.
    Seconds(f64),
    /// Our time over that of another program in the same run.
    Ratio(f64),
}

impl Figure {
    /// The kind, as it is stored, and the number.
    fn parts(self) -> (&'static str, f64) {
        match self {
            Self::Seconds(seconds) => ("seconds", seconds),
            Self::Ratio(ratio) => ("ratio", ratio),
        }
    }
}

/// What a run has measured, and where.
pub(super) struct Figures {
    machine: String,
    threads: usize,
    by_name: BTreeMap<String, Figure>,
}

impl Figures {
    /// None yet, on this machine.
    #[cfg(feature = "lab")]
    pub(super) fn here() -> Self {
        Self {
            machine: processor(),
            threads: rayon::current_num_threads(),
            by_name: BTreeMap::new(),
        }
    }

    /// The machine in a line. Programs and kernels run on the CPU here, as they do by default.
    pub(super) fn machine(&self) -> String {
        let Self {
            machine, threads, ..
        } = self;
        format!("{machine}, {threads} threads, backend cpu")
    }

    /// Seconds of a piece of work.
    pub(super) fn seconds(&mut self, name: impl Into<String>, seconds: f64) {
        self.by_name.insert(name.into(), Figure::Seconds(seconds));
    }

    /// Our seconds over another program's.
    pub(super) fn ratio(&mut self, name: impl Into<String>, ratio: f64) {
        self.by_name.insert(name.into(), Figure::Ratio(ratio));
    }

    /// Those of a file; `None` if there is no such file.
    pub(super) fn read(path: &Path) -> Result<Option<Self>, String> {
        let failed = |e: &dyn std::fmt::Display| format!("{}: {e}", path.display());
        let file = match fs::read_to_string(path) {
            Ok(file) => file,
            Err(e) if e.kind() == std::io::ErrorKind::NotFound => return Ok(None),
            Err(e) => return Err(failed(&e)),
        };
        let value: Value = serde_json::from_str(&file).map_err(|e| failed(&e))?;
        let named = |key: &str| value.get(key).ok_or_else(|| failed(&format!("no `{key}`")));
        let machine = named("machine")?.as_str().unwrap_or_default().to_owned();
        let threads = named("threads")?.as_u64().unwrap_or_default() as usize;
        let mut by_name = BTreeMap::new();
        for (name, figure) in named("figures")?.as_object().into_iter().flatten() {
            let of = |kind: &str| figure.get(kind).and_then(Value::as_f64);
            let figure = of("seconds").map(Figure::Seconds);
            let figure = figure.or_else(|| of("ratio").map(Figure::Ratio));
            let figure = figure.ok_or_else(|| failed(&format!("`{name}` is no figure")))?;
            by_name.insert(name.clone(), figure);
        }
        Ok(Some(Self {
            machine,
            threads,
            by_name,
        }))
    }

    /// Adds what was stored and is not measured now, if it is of this machine.
    pub(super) fn take_over(&mut self, stored: Self) {
        if self.is_of_the_same_machine(&stored) {
            for (name, figure) in stored.by_name {
                self.by_name.entry(name).or_insert(figure);
            }
        }
    }

    /// Writes them, then gives them their name.
    pub(super) fn save(&self, path: &Path) -> Outcome {
        let rounded = |x: f64| (x * 1000.0).round() / 1000.0;
        let figures = self.by_name.iter().map(|(name, figure)| {
            let (kind, number) = figure.parts();
            (name.clone(), json!({ kind: rounded(number) }))
        });
        let value = json!({
            "machine": self.machine,
            "threads": self.threads,
            "backend": "cpu",
            "figures": figures.collect::<serde_json::Map<_, _>>(),
        });
        let page = serde_json::to_string_pretty(&value).map_err(|e| e.to_string())?;
        let part = path.with_extension("part");
        fs::write(&part, page + "\n")
            .and_then(|()| fs::rename(&part, path))
            .map_err(|e| format!("{}: {e}", path.display()))
    }

    /// Prints each figure beside the stored one; those that are worse by more than the factor. Seconds of another machine say
    /// nothing, ratios do.
    pub(super) fn beside(&self, stored: &Self, tolerance: f64) -> Vec<String> {
        let same = self.is_of_the_same_machine(stored);
        println!("\nbeside what is stored of {}", stored.machine());
        println!("| figure | now | stored | now / stored |\n|---|---|---|---|");
        let mut worse = Vec::new();
        for (name, figure) in &self.by_name {
            let (kind, now) = figure.parts();
            let before = stored.by_name.get(name).map(|f| f.parts());
            let Some((_, before)) = before.filter(|(other, _)| *other == kind) else {
                println!("| {name} | {now:.3} | – | |");
                continue;
            };
            let change = now / before;
            let counts = match figure {
                Figure::Seconds(_) => same && now.max(before) >= SHORT,
                Figure::Ratio(_) => true,
            };
            let mark = if counts && change > tolerance {
                worse.push(format!("{name}, {change:.2}×"));
                " WORSE"
            } else {
                ""
            };
            println!("| {name}, {kind} | {now:.3} | {before:.3} | {change:.2}{mark} |");
        }
        worse
    }

    fn is_of_the_same_machine(&self, other: &Self) -> bool {
        self.machine == other.machine && self.threads == other.threads
    }
}

/// The processor's name where the system tells, else its kind.
#[cfg(feature = "lab")]
fn processor() -> String {
    let told = fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let named = told.lines().find_map(|line| {
        let (key, name) = line.split_once(':')?;
        (key.trim() == "model name").then(|| name.trim().to_owned())
    });
    named.unwrap_or_else(|| format!("{} {}", std::env::consts::ARCH, std::env::consts::OS))
}

#[cfg(test)]
mod tests {
    use super::Figures;

    fn figures(machine: &str, seconds: f64, ratio: f64) -> Figures {
        let mut figures = Figures {
            machine: machine.to_owned(),
            threads: 2,
            by_name: Default::default(),
        };
        figures.seconds("work", seconds);
        figures.ratio("work beside others", ratio);
        figures
    }

    #[test]
    fn what_is_worse_is_named_and_seconds_of_other_machines_are_not() {
        let stored = figures("one", 1.0, 0.5);
        assert!(figures("one", 1.4, 0.7).beside(&stored, 1.5).is_empty());
        let slower = figures("one", 1.6, 0.5).beside(&stored, 1.5);
        assert_eq!(slower, ["work, 1.60×"]);
        let elsewhere = figures("another", 9.0, 0.8).beside(&stored, 1.5);
        assert_eq!(elsewhere, ["work beside others, 1.60×"]);
    }

    #[test]
    fn figures_are_stored_and_read() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("baseline.json");
        assert!(Figures::read(&path).unwrap().is_none());
        figures("one", 1.25, 0.5).save(&path).unwrap();
        let read = Figures::read(&path).unwrap().unwrap();
        assert_eq!(read.machine(), "one, 2 threads, backend cpu");
        assert_eq!(read.by_name["work"].parts(), ("seconds", 1.25));
        assert_eq!(read.by_name["work beside others"].parts(), ("ratio", 0.5));
        std::fs::write(&path, "{}").unwrap();
        assert!(Figures::read(&path).is_err_and(|e| e.contains("no `machine`")));
    }
}
