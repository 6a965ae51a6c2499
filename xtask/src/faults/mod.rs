//! `cargo xtask faults`: what the tests see. Faults are planted one at a time in a copy of the workspace, and the tests
//! of the crate that owes the broken promise are run on each.
//!
//! The copy lies beside other build outputs and is built in a target directory of its own, which stays warm. A fault
//! that every test passes is a promise that nobody holds us to.

mod copy;
mod lists;
mod trial;

use std::fs;

use copy::Copy;
use lists::{Fault, LISTS};
use trial::{Trial, Verdict};

use crate::{Outcome, root};

/// The share of the faults that change results that tests must see, per crate.
const WANTED: f64 = 0.95;

/// Which faults are planted.
#[derive(clap::Args)]
pub(crate) struct Arguments {
    /// Only those of this crate
    #[arg(long = "crate", value_name = "NAME", value_parser = LISTS.map(|(name, _)| name))]
    of: Option<String>,
    /// Only the one of this number in the list of its crate, or those whose words or file contain this
    #[arg(long, value_name = "N|TEXT")]
    only: Option<String>,
    /// List them, and check that each can still be planted
    #[arg(long)]
    list: bool,
}

impl Arguments {
    fn takes(&self, number: usize, fault: &Fault) -> bool {
        self.only
            .as_ref()
            .is_none_or(|only| match only.parse::<usize>() {
                Ok(n) => number == n,
                Err(_) => fault.breaks.contains(only) || fault.file.contains(only),
            })
    }

    /// Crates with the faults to plant, numbered from 1.
    fn chosen(&self) -> Vec<(&'static str, Vec<(usize, &'static Fault)>)> {
        let of = |name: &str| self.of.as_ref().is_none_or(|of| of == name);
        let lists = LISTS.iter().filter(|(name, _)| of(name));
        let chosen = lists.map(|&(name, faults)| {
            let numbered = faults.iter().enumerate().map(|(i, fault)| (i + 1, fault));
            (name, numbered.filter(|&(n, f)| self.takes(n, f)).collect())
        });
        chosen
            .filter(|(_, faults): &(_, Vec<_>)| !faults.is_empty())
            .collect()
    }
}

pub(crate) fn run(arguments: &Arguments) -> Outcome {
    check()?;
    let chosen = arguments.chosen();
    if chosen.is_empty() {
        return Err("no fault is called that: see --list".into());
    }
    if arguments.list {
        for (name, faults) in &chosen {
            for (number, fault) in faults {
                let taste = if fault.results { "" } else { " (results stay)" };
                println!("{name} {number}: {}{taste}: {}", fault.breaks, fault.file);
            }
        }
        return Ok(());
    }
    let copy = Copy::refreshed()?;
    let mut tallies = Vec::new();
    for (name, faults) in &chosen {
        tallies.push(run_crate(&copy, name, faults)?);
    }
    for tally in &tallies {
        println!("{}", tally.line());
    }
    match tallies.iter().filter(|t| t.share() < WANTED).count() {
        0 => Ok(()),
        n => Err(format!("the tests of {n} crates see too little")),
    }
}

/// Every fault can be planted; else all that cannot, a line each.
fn check() -> Outcome {
    let planted = |fault: &Fault| {
        let text = fs::read_to_string(root().join(fault.file));
        let text = text.map_err(|e| format!("{}: {e}", fault.file))?;
        fault.planted(&text).map(drop)
    };
    let all = LISTS.iter().flat_map(|(_, faults)| *faults);
    let failed: Vec<String> = all.filter_map(|fault| planted(fault).err()).collect();
    match failed.is_empty() {
        true => Ok(()),
        false => Err(failed.join("\n")),
    }
}

/// Plants the faults of a crate, one after the other.
fn run_crate(copy: &Copy, name: &'static str, faults: &[(usize, &Fault)]) -> Result<Tally, String> {
    let trial = Trial::start(copy, name, &Vec::from_iter(faults.iter().map(|f| f.1)))?;
    println!("{name}: passes without a fault");
    let mut tally = Tally::of(name);
    for (number, fault) in faults {
        let verdict = copy.with(fault, || trial.verdict(fault))?;
        println!("{name} {number}: {verdict}: {}", fault.breaks);
        tally.take(fault, &verdict);
    }
    Ok(tally)
}

/// How many faults of a crate were seen.
struct Tally {
    name: &'static str,
    /// All, and those that change results: seen, and planted.
    all: [usize; 2],
    results: [usize; 2],
}

impl Tally {
    fn of(name: &'static str) -> Self {
        Self {
            name,
            all: [0; 2],
            results: [0; 2],
        }
    }

    fn take(&mut self, fault: &Fault, verdict: &Verdict) {
        let seen = usize::from(!matches!(verdict, Verdict::Survived));
        let counts = [&mut self.all, &mut self.results];
        for [caught, planted] in counts.into_iter().take(1 + usize::from(fault.results)) {
            *caught += seen;
            *planted += 1;
        }
    }

    /// Of those that change results.
    fn share(&self) -> f64 {
        let [seen, planted] = self.results;
        seen as f64 / planted.max(1) as f64
    }

    fn line(&self) -> String {
        let percent = 100.0 * self.share();
        let ([seen, planted], [of_all, all]) = (self.results, self.all);
        let name = self.name;
        format!(
            "{name}: {seen} of {planted} that change results are seen ({percent:.0} %), {of_all} of all {all}"
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_fault_can_be_planted() {
        check().unwrap();
    }

    #[test]
    fn a_text_must_be_found_once() {
        let fault = Fault::wrong("a sign", "sum.rs", "a + b", "a - b");
        assert_eq!(fault.planted("c = a + b;").unwrap(), "c = a - b;");
        assert!(fault.planted("c = a - b;").unwrap_err().contains("0 times"));
        let twice = fault.planted("a + b + a + b").unwrap_err();
        assert!(twice.contains("2 times"), "{twice}");
        let nothing = Fault::wrong("nothing", "sum.rs", "a", "a");
        assert!(nothing.planted("a").is_err());
    }

    #[test]
    fn only_what_changes_results_counts_for_the_share() {
        let mut tally = Tally::of("x");
        let wrong = Fault::wrong("", "", "a", "b");
        let poor = Fault::poor("", "", "a", "b");
        tally.take(&wrong, &Verdict::Hung);
        tally.take(&poor, &Verdict::Survived);
        assert_eq!(tally.share(), 1.0);
        tally.take(&wrong, &Verdict::Survived);
        assert_eq!((tally.results, tally.all), ([1, 2], [1, 3]));
        assert!(tally.share() < WANTED);
    }
}
