//! Many inputs in one call: files, folders and lists; in shards for the schedulers of clusters, taken up again where a run
//! ended.
//!
//! Every input has its own folder of outputs, and a line in `results.jsonl`. What one input does wrong, the others do not
//! notice.

use std::collections::BTreeMap;
use std::fs::{File, OpenOptions};
use std::io::Write;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Component, Path, PathBuf};
use std::process::ExitCode;
use std::str::FromStr;
use std::time::Instant;

use clap::Parser;
use geom_core::{Cancelled, io};
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use crate::args::{Common, HasCommon};
use crate::input::source::extension;
use crate::products::grouped;
use crate::session::{self, Failure, Invocation, Session};

/// The exit code of a call in which inputs were refused, and all others done.
pub const SOME_REFUSED: u8 = 3;
/// What a list of inputs is called.
const LIST: &str = "list";
/// What is taken from folders.
const READ: [&str; 9] = [
    "pdb", "ent", "cif", "mmcif", "pqr", "mrc", "map", "ccp4", "dx",
];
/// How many of the refused inputs are named at the end.
const NAMED: usize = 10;

/// Which inputs, beside the first.
#[derive(Clone, Debug, Default, clap::Args)]
#[command(next_help_heading = "Many inputs")]
pub struct BatchArgs {
    /// More inputs. Each may also be a folder (all structures and grids in it and its folders) or NAME.list (a path per
    /// line, `#` begins a comment). Outputs go to DIR/NAME, a line per input to DIR/results.jsonl; inputs that have one
    /// are not done again
    #[arg(value_name = "INPUT")]
    pub more: Vec<PathBuf>,
    /// Do only the i-th of every n inputs, for n calls side by side
    #[arg(long, value_name = "I/N")]
    pub shard: Option<Shard>,
    /// Try again what was refused or failed before
    #[arg(long)]
    pub retry: bool,
}

/// One of so many parts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shard {
    /// Which, from 1.
    pub number: usize,
    /// Of how many.
    pub of: usize,
}

impl FromStr for Shard {
    type Err = String;
    fn from_str(text: &str) -> Result<Self, String> {
        let parts = text.split_once('/');
        let parts = parts.and_then(|(i, n)| Some((i.trim().parse().ok()?, n.trim().parse().ok()?)));
        match parts {
            Some((number, of)) if (1..=of).contains(&number) => Ok(Self { number, of }),
            _ => Err(format!("{text:?} is no shard like 1/8, 2/8, …, 8/8")),
        }
    }
}

/// Programs that take many inputs.
pub trait Batch: HasCommon + Clone {
    /// Which.
    fn batch(&self) -> &BatchArgs;
    /// The first input, and the arguments of all programs.
    fn parts_mut(&mut self) -> (&mut PathBuf, &mut Common);
}

/// Like [`session::run`], once for each input.
pub fn run_each<A>(
    program: &'static str,
    work: impl Fn(&A, &Session) -> Result<(), Failure> + Send + Sync,
) -> ExitCode
where
    A: Parser + Batch + Serialize + Sync,
{
    session::start::<A>(|call| {
        let [first] = &call.args.inputs()[..] else {
            unreachable!("programs of many inputs have one argument for the first");
        };
        let many = !call.args.batch().more.is_empty() || first.is_dir() || extension(first) == LIST;
        if many {
            return each(program, &call, &work);
        }
        if let Some(option) = call
            .given
            .iter()
            .find(|g| ["shard", "retry"].contains(&g.as_str()))
        {
            return Err(
                format!("--{option} is for many inputs: a folder, a list, several files").into(),
            );
        }
        call.run(program, &call.args, work)
            .map(|summary| (summary, ExitCode::SUCCESS))
    })
}

/// What became of an input: a line of the results.
#[derive(Clone, Debug, Serialize, Deserialize)]
struct Line {
    /// The folder of its outputs, which names it.
    name: String,
    input: String,
    #[serde(flatten)]
    outcome: Outcome,
}

#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(tag = "outcome", rename_all = "lowercase")]
enum Outcome {
    /// It has been begun. If no other line follows, the whole run ended in it.
    Begun,
    /// Its outputs are there; with the counts of its report.
    Done { seconds: f64, counts: Value },
    /// It cannot be done, as the error says.
    Refused { error: String },
    /// A fault of ours.
    Failed { error: String },
    /// The run was asked to stop: it will be begun again.
    Stopped,
}

/// Does all inputs of the shard that have not been done, and says what became of them.
fn each<A>(
    program: &'static str,
    call: &Invocation<A>,
    work: &(impl Fn(&A, &Session) -> Result<(), Failure> + Send + Sync),
) -> Result<(String, ExitCode), Failure>
where
    A: Batch + Serialize + Sync,
{
    let (args, batch) = (&call.args, call.args.batch());
    let common = args.common();
    let mut inputs = args.inputs();
    inputs.extend_from_slice(&batch.more);
    let entries = entries_of(&inputs, &common.out)?;
    let Shard { number, of } = batch.shard.unwrap_or(Shard { number: 1, of: 1 });
    let entries: Vec<_> = entries.into_iter().skip(number - 1).step_by(of).collect();

    std::fs::create_dir_all(&common.out).map_err(|e| io::Error::from(e).in_file(&common.out))?;
    let before = lines_in(&common.out, &options_of(args)?)?;
    let mut results = Results::open(&common.out, batch.shard, program, &options_of(args)?)?;
    let mut tally = Tally::default();
    for (count, (name, input)) in entries.iter().enumerate() {
        if settled(before.get(name), batch.retry, &mut tally, &mut results)? {
            continue;
        }
        results.add(name, input, Outcome::Begun)?;
        let outcome = one(program, call, work, (name, input))?;
        results.add(name, input, outcome.clone())?;
        let said = match outcome {
            Outcome::Done { seconds, .. } => {
                tally.done += 1;
                format!("{seconds:.1} s")
            }
            Outcome::Refused { error } | Outcome::Failed { error } => {
                tally.refuse(name, &error);
                format!("error: {error}")
            }
            // Asked to end: what comes next has not been begun.
            Outcome::Begun | Outcome::Stopped => return Err(Cancelled.into()),
        };
        if !common.quiet {
            let (number, all) = (count + 1, entries.len());
            let _ = writeln!(std::io::stderr(), "[{number}/{all}] {name}: {said}");
        }
    }
    let code = if tally.refused.is_empty() {
        0
    } else {
        SOME_REFUSED
    };
    Ok((tally.table(&results.path), ExitCode::from(code)))
}

/// Is nothing to be done for an input of which this was said last? Then it counts as that.
fn settled(
    last: Option<&Line>,
    retry: bool,
    tally: &mut Tally,
    results: &mut Results,
) -> Result<bool, Failure> {
    let Some(Line {
        name,
        input,
        outcome,
    }) = last
    else {
        return Ok(false);
    };
    match outcome {
        Outcome::Done { .. } => tally.before += 1,
        Outcome::Stopped => return Ok(false),
        _ if retry => return Ok(false),
        Outcome::Refused { error } | Outcome::Failed { error } => tally.refuse(name, error),
        Outcome::Begun => {
            let error = "the run ended within this input: out of memory, or killed".to_owned();
            tally.refuse(name, &error);
            results.add(name, Path::new(input), Outcome::Failed { error })?;
        }
    }
    Ok(true)
}

/// A run with one input.
fn one<A>(
    program: &'static str,
    call: &Invocation<A>,
    work: &(impl Fn(&A, &Session) -> Result<(), Failure> + Send + Sync),
    (name, input): (&str, &Path),
) -> Result<Outcome, Failure>
where
    A: Batch + Serialize + Sync,
{
    let mut args = call.args.clone();
    let (first, common) = args.parts_mut();
    *first = input.to_owned();
    common.out = common.out.join(name);
    common.quiet = true;
    let out = common.out.clone();
    let start = Instant::now();
    // A fault in one input must not cost the others.
    let ended = catch_unwind(AssertUnwindSafe(|| call.run(program, &args, work)));
    Ok(match ended {
        Ok(Ok(_)) => Outcome::Done {
            seconds: start.elapsed().as_secs_f64(),
            counts: counts_in(&out)?,
        },
        Ok(Err(_)) if call.stopped() => Outcome::Stopped,
        Ok(Err(failure)) => Outcome::Refused {
            error: session::one_line(&failure.to_string()),
        },
        Err(_) => Outcome::Failed {
            error: format!("{program} is at fault: please report this input"),
        },
    })
}

/// What became of how many.
#[derive(Default)]
struct Tally {
    done: usize,
    before: usize,
    refused: Vec<(String, String)>,
}

impl Tally {
    fn refuse(&mut self, name: &str, error: &str) {
        self.refused.push((name.to_owned(), error.to_owned()));
    }

    fn table(&self, path: &Path) -> String {
        let mut lines = vec![format!(
            "{:>8} done\n{:>8} done before\n{:>8} refused",
            grouped(self.done),
            grouped(self.before),
            grouped(self.refused.len())
        )];
        let named = self.refused.iter().take(NAMED);
        lines.extend(named.map(|(name, error)| format!("         {name}: {error}")));
        if self.refused.len() > NAMED {
            lines.push(format!("         and {} more", self.refused.len() - NAMED));
        }
        lines.push(format!("a line for each in {}", path.display()));
        lines.join("\n")
    }
}

/// The inputs by the names of their folders, in the order of the names; a folder's inputs keep their place in it. What lies in
/// `out` are results, not inputs.
pub fn entries_of(inputs: &[PathBuf], out: &Path) -> Result<Vec<(String, PathBuf)>, Failure> {
    let mut found: Vec<(PathBuf, PathBuf)> = Vec::new();
    for input in inputs {
        if input.is_dir() {
            walk(input, input, out.canonicalize().ok().as_deref(), &mut found)?;
        } else if extension(input) == LIST {
            let text =
                std::fs::read_to_string(input).map_err(|e| io::Error::from(e).in_file(input))?;
            let lines = text
                .lines()
                .map(|l| l.split('#').next().unwrap_or_default().trim());
            for line in lines.filter(|l| !l.is_empty()) {
                // Paths in a list are as seen from the list.
                let path = input.parent().unwrap_or(Path::new("")).join(line);
                found.push((PathBuf::from(path.file_name().unwrap_or_default()), path));
            }
        } else {
            found.push((
                PathBuf::from(input.file_name().unwrap_or_default()),
                input.clone(),
            ));
        }
    }
    let mut entries = BTreeMap::<String, Vec<(PathBuf, PathBuf)>>::new();
    for (place, path) in found {
        entries
            .entry(name_of(&place))
            .or_default()
            .push((place, path));
    }
    let mut named = BTreeMap::new();
    for (name, mut of_name) in entries {
        if of_name.len() == 1 {
            named.insert(name, of_name.remove(0).1);
            continue;
        }
        // 1abc.pdb and 1abc.cif keep their endings.
        for (place, path) in of_name {
            let name = place.to_string_lossy().into_owned();
            if let Some(other) = named.insert(name.clone(), path.clone()) {
                let (one, other) = (path.display(), other.display());
                let message = format!(
                    "{one} and {other} would both be called {name}: give the folder above them"
                );
                return Err(message.into());
            }
        }
    }
    if named.is_empty() {
        let all = inputs.iter().map(|i| i.display().to_string());
        let message = format!(
            "no structure or grid in {}",
            all.collect::<Vec<_>>().join(", ")
        );
        return Err(message.into());
    }
    Ok(named.into_iter().collect())
}

/// `1abc` of `1abc.pdb.gz`; in a folder `ab/1abc` of `ab/1abc.cif`.
fn name_of(place: &Path) -> String {
    let file = place.file_name().unwrap_or_default().to_string_lossy();
    let stem = file.strip_suffix(".gz").unwrap_or(&file);
    let stem = stem.rsplit_once('.').map_or(stem, |(stem, _)| stem);
    let folders = place.parent().unwrap_or(Path::new(""));
    let folders = folders
        .components()
        .filter(|c| matches!(c, Component::Normal(_)));
    let parts = folders.map(|c| c.as_os_str().to_string_lossy().into_owned());
    parts.chain([stem.to_owned()]).collect::<Vec<_>>().join("/")
}

/// All structures and grids in a folder, by their place in the topmost one. Links to folders are not followed.
fn walk(
    top: &Path,
    folder: &Path,
    but: Option<&Path>,
    found: &mut Vec<(PathBuf, PathBuf)>,
) -> Result<(), Failure> {
    let named = |e: std::io::Error| io::Error::from(e).in_file(folder);
    for entry in std::fs::read_dir(folder).map_err(named)? {
        let entry = entry.map_err(named)?;
        let path = entry.path();
        if entry.file_type().map_err(named)?.is_dir() {
            if but.is_none() || path.canonicalize().ok().as_deref() != but {
                walk(top, &path, but, found)?;
            }
        } else if READ.contains(&extension(&path).as_str()) {
            let place = path.strip_prefix(top).unwrap_or(&path).to_owned();
            found.push((place, path));
        }
    }
    Ok(())
}

/// The options on which results depend.
fn options_of(args: &impl Serialize) -> Result<Value, Failure> {
    fn without_inputs(value: &mut Value) {
        if let Value::Object(fields) = value {
            fields.remove("common");
            fields.remove("input");
            fields.values_mut().for_each(without_inputs);
        }
    }
    let mut options = serde_json::to_value(args)?;
    without_inputs(&mut options);
    Ok(options)
}

/// The counts in the report of a run.
fn counts_in(folder: &Path) -> Result<Value, Failure> {
    let report: Value = serde_json::from_slice(&std::fs::read(folder.join("report.json"))?)?;
    Ok(report["counts"].clone())
}

/// How files of results begin.
#[derive(Serialize, Deserialize)]
struct Head {
    program: String,
    version: String,
    options: Value,
}

/// The last line of each input in all results of a folder, which must have been made with these options.
fn lines_in(out: &Path, options: &Value) -> Result<BTreeMap<String, Line>, Failure> {
    let mut lines = BTreeMap::new();
    let mut files: Vec<PathBuf> = std::fs::read_dir(out)?
        .filter_map(|entry| Some(entry.ok()?.path()))
        .filter(|path| {
            let name = path.file_name().unwrap_or_default().to_string_lossy();
            name.starts_with("results") && name.ends_with(".jsonl")
        })
        .collect();
    files.sort();
    for path in files {
        let text = std::fs::read_to_string(&path)?;
        let mut all = text.lines();
        let head: Option<Head> = all.next().and_then(|l| serde_json::from_str(l).ok());
        if head.is_none_or(|head| head.options != *options) {
            let message = format!(
                "{} was made with other options: choose another folder",
                path.display()
            );
            return Err(message.into());
        }
        // A last line that was cut short is one that was not written.
        for line in all.filter_map(|l| serde_json::from_str::<Line>(l).ok()) {
            lines.insert(line.name.clone(), line);
        }
    }
    Ok(lines)
}

/// The file that lines are added to.
struct Results {
    path: PathBuf,
    file: File,
}

impl Results {
    fn open(
        out: &Path,
        shard: Option<Shard>,
        program: &str,
        options: &Value,
    ) -> Result<Self, Failure> {
        let name = shard.map_or_else(
            || "results.jsonl".to_owned(),
            |s| format!("results-{}-of-{}.jsonl", s.number, s.of),
        );
        let path = out.join(name);
        let named = |e: std::io::Error| io::Error::from(e).in_file(&path);
        let mut file = OpenOptions::new()
            .create(true)
            .append(true)
            .open(&path)
            .map_err(named)?;
        if file.metadata().map_err(named)?.len() == 0 {
            let head = Head {
                program: program.to_owned(),
                version: env!("CARGO_PKG_VERSION").to_owned(),
                options: options.clone(),
            };
            file.write_all(format!("{}\n", json!(head)).as_bytes())
                .map_err(named)?;
        }
        Ok(Self { path, file })
    }

    fn add(&mut self, name: &str, input: &Path, outcome: Outcome) -> Result<(), Failure> {
        let line = Line {
            name: name.to_owned(),
            input: input.to_string_lossy().into_owned(),
            outcome,
        };
        let line = format!("{}\n", serde_json::to_string(&line)?);
        let written = self.file.write_all(line.as_bytes());
        Ok(written.map_err(|e| io::Error::from(e).in_file(&self.path))?)
    }
}
