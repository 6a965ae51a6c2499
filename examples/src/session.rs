//! One run of a program: threads, backend, progress, outputs and `report.json`.

use std::fs::File;
use std::io::Write;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, OnceLock};
use std::time::{Duration, Instant};

use clap::parser::ValueSource;
use clap::{Arg, ArgMatches, Command, Parser};
use geom_core::compute::usage::Usage;
use geom_core::{Backend, Cancelled, Cpu, Monitor, Run, TriMesh, io};
use indicatif::{ProgressBar, ProgressStyle};
use serde::Serialize;
use serde_json::{Map, Value, json};
#[cfg(unix)]
use signal_hook::consts::SIGHUP;
use signal_hook::consts::{SIGINT, SIGTERM};
use signal_hook::flag;

use crate::args::{Common, HasCommon};
use crate::device::Device;
use crate::page::Page;
use crate::picture::{Image, Rasterizer, Scene};
use crate::products::Coloring;
use crate::words;

/// Why a program stops: said in one line.
pub type Failure = Box<dyn std::error::Error + Send + Sync>;

/// Parses the arguments, runs `work` on a pool of the asked threads, and moves the outputs to their
/// place. Failures become one line on stderr, exit code 1, and no output; a signal that ends the work is the
/// exit code, as shells count (130 for Ctrl-C).
pub fn run<A>(
    program: &'static str,
    work: impl FnOnce(&A, &Session) -> Result<(), Failure> + Send,
) -> ExitCode
where
    A: Parser + HasCommon + Serialize + Sync,
{
    start::<A>(|call| {
        let summary = call.run(program, &call.args, work)?;
        Ok((summary, ExitCode::SUCCESS))
    })
}

/// What a program was called with.
pub(crate) struct Invocation<A> {
    pub(crate) args: A,
    /// The options that the command line names.
    pub(crate) given: Vec<String>,
    stop: Arc<AtomicBool>,
}

impl<A: HasCommon + Serialize + Sync> Invocation<A> {
    /// Has the work been asked to stop?
    pub(crate) fn stopped(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }

    /// A run with these arguments. Gives what to say of it.
    pub(crate) fn run(
        &self,
        program: &'static str,
        args: &A,
        work: impl FnOnce(&A, &Session) -> Result<(), Failure> + Send,
    ) -> Result<String, Failure> {
        run_with(program, args, self.given.clone(), self.stop.clone(), work)
    }
}

/// Parses the arguments, heeds signals, and says what the work says, or why it failed.
pub(crate) fn start<A: Parser + HasCommon>(
    work: impl FnOnce(Invocation<A>) -> Result<(String, ExitCode), Failure>,
) -> ExitCode {
    let matches = A::command().get_matches();
    let args = A::from_arg_matches(&matches).unwrap_or_else(|e| e.exit());
    let quiet = args.common().quiet;
    let stop = Arc::<AtomicBool>::default();
    let signal = Arc::<AtomicUsize>::default();
    let done = heed_signals(&stop, &signal).and_then(|()| {
        work(Invocation {
            args,
            given: given(&matches),
            stop,
        })
    });
    match done {
        Ok((summary, code)) => {
            if !quiet {
                // A reader that has gone misses the words, not the files.
                let _ = writeln!(std::io::stdout(), "{summary}");
            }
            code
        }
        Err(failure) => {
            let words = with_flags(&failure.to_string(), &A::command());
            let _ = writeln!(std::io::stderr(), "error: {}", one_line(&words));
            match signal.load(Ordering::Relaxed) {
                0 => ExitCode::FAILURE,
                number => ExitCode::from(128 + number as u8),
            }
        }
    }
}

/// Ctrl-C, SIGTERM and the end of the terminal ask the work to stop, which leaves nothing behind; a second
/// one does not wait.
pub fn heed_signals(stop: &Arc<AtomicBool>, number: &Arc<AtomicUsize>) -> Result<(), Failure> {
    let heeded = [
        SIGINT,
        SIGTERM,
        #[cfg(unix)]
        SIGHUP,
    ];
    for signal in heeded {
        // The first registered is the first to act: it ends the program if the work was asked before.
        flag::register_conditional_shutdown(signal, 128 + signal, stop.clone())?;
        flag::register(signal, stop.clone())?;
        flag::register_usize(signal, number.clone(), signal as usize)?;
    }
    Ok(())
}

/// A message in the words of the program: the libraries name fields of their options, `option goals.joe_liu is 3`.
pub(crate) fn with_flags(text: &str, command: &Command) -> String {
    let named = |rest: &str| -> Option<(String, usize)> {
        let (field, value) = rest.split_once(" is ")?;
        let flag = field.rsplit('.').next()?.replace('_', "-");
        let flag = match flag.as_str() {
            "resolution" if value.contains("tetrahedra") => "tets",
            "resolution" => "cell",
            "features" => "keep-edges",
            "level" => "isovalue",
            "size" => "side",
            flag => flag,
        };
        let mut flags = command.get_arguments().filter_map(Arg::get_long);
        flags
            .any(|long| long == flag)
            .then(|| (flag.to_owned(), field.len()))
    };
    const BEFORE: &str = "option ";
    match text.split_once(BEFORE) {
        Some((before, rest)) => match named(rest) {
            Some((flag, length)) => format!("{before}--{flag}{}", &rest[length..]),
            None => text.to_owned(),
        },
        None => text.to_owned(),
    }
}

/// A message without line breaks.
pub(crate) fn one_line(text: &str) -> String {
    let lines = text.lines().map(str::trim).filter(|l| !l.is_empty());
    lines.collect::<Vec<&str>>().join("; ")
}

/// The options that the command line names, by the names of their fields.
fn given(matches: &ArgMatches) -> Vec<String> {
    let named =
        |id: &&clap::Id| matches.value_source(id.as_str()) == Some(ValueSource::CommandLine);
    matches
        .ids()
        .filter(named)
        .map(|id| id.to_string())
        .collect()
}

/// Threads for each core from which on they mostly wait.
const MANY: usize = 4;

/// One run with arguments that have been read, the names of those `given` on the command line, and a flag that stops it;
/// what it says when it is done.
pub fn run_with<A>(
    program: &'static str,
    args: &A,
    given: Vec<String>,
    stop: Arc<AtomicBool>,
    work: impl FnOnce(&A, &Session) -> Result<(), Failure> + Send,
) -> Result<String, Failure>
where
    A: HasCommon + Serialize + Sync,
{
    let common = args.common();
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let threads = common.threads.map_or(cores, usize::from);
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(threads)
        .build()?;
    let inputs: Vec<Value> = args
        .inputs()
        .iter()
        .map(|path| json!({ "file": path.to_string_lossy(), "bytes": std::fs::metadata(path).map(|m| m.len()).ok() }))
        .collect();
    let head = json!({
        "program": program,
        "version": env!("CARGO_PKG_VERSION"),
        "input": inputs,
        "options": args,
        "threads": threads,
    });
    let session = Session::open(common, given, stop, head)?;
    if threads > MANY * cores {
        session.warn(format!(
            "--threads {threads} wait for each other on {cores} cores; --threads {cores} gives the same in less time"
        ))?;
    }
    pool.install(|| work(args, &session))?;
    session.close()
}

/// The state of a run. Its methods take `&self`, so that it can be used within its own stages.
pub struct Session {
    /// Where kernels run.
    pub device: Device,
    common: Common,
    /// The options that the command line names.
    given: Vec<String>,
    /// Where outputs wait until all are written; made for the first of them.
    staging: OnceLock<Staging>,
    started: Instant,
    bars: Bars,
    rasterizer: OnceLock<Rasterizer>,
    page: Mutex<Page>,
    report: Mutex<Report>,
    /// Which part of the work is being done: see [`Session::part`].
    part: Mutex<Option<&'static str>>,
    /// Does another process write the report? See [`Session::follow`].
    follows: AtomicBool,
}

#[derive(Serialize)]
struct Report {
    #[serde(flatten)]
    head: Value,
    backend: String,
    renderer: Option<String>,
    #[serde(flatten)]
    notes: Map<String, Value>,
    stages: Vec<Stage>,
    seconds: f64,
    peak_bytes: Option<u64>,
    outputs: Vec<String>,
}

#[derive(Serialize)]
struct Stage {
    #[serde(skip_serializing_if = "Option::is_none")]
    part: Option<&'static str>,
    name: &'static str,
    seconds: f64,
    /// Where its kernels ran: `cpu` too where another was asked for, and none of its kernels had anything to do.
    backend: String,
    #[serde(skip_serializing_if = "Usage::is_empty")]
    kernels: Usage,
}

impl Session {
    fn open(
        common: &Common,
        given: Vec<String>,
        stop: Arc<AtomicBool>,
        head: Value,
    ) -> Result<Self, Failure> {
        let device = Device::open(common.backend)?;
        // A folder that cannot be written is an error now, not after hours.
        drop(Staging::open(&common.out)?);
        let report = Report {
            head,
            backend: device.name(),
            renderer: None,
            notes: Map::new(),
            stages: Vec::new(),
            seconds: 0.0,
            peak_bytes: None,
            outputs: Vec::new(),
        };
        Ok(Self {
            device,
            common: common.clone(),
            given,
            staging: OnceLock::new(),
            started: Instant::now(),
            bars: Bars::new(common.quiet, stop),
            rasterizer: OnceLock::new(),
            page: Mutex::default(),
            report: Mutex::new(report),
            part: Mutex::default(),
            follows: AtomicBool::new(false),
        })
    }

    fn report(&self) -> MutexGuard<'_, Report> {
        self.report.lock().unwrap_or_else(|e| e.into_inner())
    }

    /// Most bytes that grids may take.
    pub fn memory(&self) -> u64 {
        self.common.memory()
    }

    /// An error if the command line names one of these options, which would do nothing for this input:
    /// "--margin is for structures".
    pub fn refuse(&self, options: &[&str], because: &str) -> Result<(), Failure> {
        match self.given.iter().find(|g| options.contains(&g.as_str())) {
            Some(option) => Err(format!("--{} {because}", option.replace('_', "-")).into()),
            None => Ok(()),
        }
    }

    /// A run on a backend, watched by the session.
    pub fn on<'a, B: ?Sized>(&'a self, backend: &'a B) -> Run<'a, B> {
        Run::on(backend).watched_by(&self.bars)
    }

    /// Does a part of the work and notes how long it took, and which kernels ran where.
    pub fn stage<T, E: Into<Failure>>(
        &self,
        name: &'static str,
        work: impl FnOnce() -> Result<T, E>,
    ) -> Result<T, Failure> {
        if self.bars.stopped() {
            return Err(Cancelled.into());
        }
        self.bars.begin(name);
        let start = Instant::now();
        let before = self.device.usage();
        let result = work();
        let seconds = start.elapsed().as_secs_f64();
        self.bars.end(name, seconds);
        let kernels = self.device.usage().since(&before);
        let backend = match kernels.is_empty() {
            true => Cpu.name(),
            false => self.device.name(),
        };
        let part = self.current();
        self.report().stages.push(Stage {
            part,
            name,
            seconds,
            backend,
            kernels,
        });
        result.map_err(Into::into)
    }

    /// Does a part of the work that could be a run of its own: its outputs go to a folder of this name, its notes to an
    /// object of this name in `report.json`.
    pub fn part<T>(
        &self,
        name: &'static str,
        work: impl FnOnce() -> Result<T, Failure>,
    ) -> Result<T, Failure> {
        let before = self.enter(Some(name));
        let result = work();
        self.enter(before);
        result
    }

    fn enter(&self, part: Option<&'static str>) -> Option<&'static str> {
        std::mem::replace(
            &mut *self.part.lock().unwrap_or_else(|e| e.into_inner()),
            part,
        )
    }

    fn current(&self) -> Option<&'static str> {
        *self.part.lock().unwrap_or_else(|e| e.into_inner())
    }

    /// What the page calls what this part of the work shows.
    fn shown_as(&self, name: &str) -> String {
        match self.current() {
            Some(part) if part != name => format!("{part}: {name}"),
            _ => name.to_owned(),
        }
    }

    /// Puts a value into `report.json`. Objects of the same name are joined.
    pub fn note(&self, key: &str, value: impl Serialize) -> Result<(), Failure> {
        let value = serde_json::to_value(value)?;
        let part = self.current();
        let mut report = self.report();
        let notes = match part {
            None => &mut report.notes,
            Some(part) => {
                let of_part = report.notes.entry(part).or_insert_with(|| json!({}));
                of_part.as_object_mut().expect("parts are objects")
            }
        };
        match (notes.get_mut(key), value) {
            (Some(Value::Object(old)), Value::Object(new)) => old.extend(new),
            (_, value) => {
                notes.insert(key.to_owned(), value);
            }
        }
        Ok(())
    }

    /// Warns of something: in the report's `advice`, and in the last lines on the terminal.
    pub fn warn(&self, words: impl Into<String>) -> Result<(), Failure> {
        let key = "advice";
        let part = self.current();
        let earlier = {
            let notes = &self.report().notes;
            let advice = match part {
                None => notes.get(key),
                Some(part) => notes.get(part).and_then(|notes| notes.get(key)),
            };
            advice.and_then(|advice| advice["warnings"].as_array().cloned())
        };
        let mut warnings = earlier.unwrap_or_default();
        warnings.push(words.into().into());
        self.note(key, json!({ "warnings": warnings }))
    }

    /// Where to write an output of this name. It appears in the output folder when all are written.
    pub fn output(&self, name: impl Into<String>) -> Result<PathBuf, Failure> {
        let name = match self.current() {
            None => name.into(),
            Some(part) => format!("{part}/{}", name.into()),
        };
        self.bars.step();
        let mut report = self.report();
        if self.staging.get().is_none() {
            let staging = Staging::open(&self.common.out)?;
            // Nobody else sets it: the report is locked.
            let _ = self.staging.set(staging);
        }
        let staging = self.staging.get().expect("set above");
        let path = staging.folder.path().join(&name);
        if let Some(folder) = path.parent() {
            std::fs::create_dir_all(folder).map_err(|e| io::Error::from(e).in_file(folder))?;
        }
        if !report.outputs.contains(&name) {
            report.outputs.push(name);
        }
        Ok(path)
    }

    /// A folder for what does not fit into memory, on the disk of the outputs; it goes with the run, however that ends.
    pub fn scratch(&self) -> Result<tempfile::TempDir, Failure> {
        let first = self.output("report.json")?;
        let staging = first.parent().unwrap_or(&self.common.out);
        let named = |e: std::io::Error| io::Error::from(e).in_file(staging);
        Ok(tempfile::tempdir_in(staging).map_err(named)?)
    }

    /// Where outputs wait, and the topmost folder that had to be made for them: what is left if this process is killed.
    pub fn waiting(&self) -> Result<(PathBuf, Option<PathBuf>), Failure> {
        self.output("report.json")?;
        let staging = self.staging.get().expect("an output has been named");
        Ok((staging.folder.path().to_owned(), staging.made.clone()))
    }

    /// This process is one of several with the same outputs, and not the one that writes report and page.
    pub fn follow(&self) {
        self.follows.store(true, Ordering::Relaxed);
        self.report().outputs.retain(|name| name != "report.json");
    }

    /// Does the last part of the work, which writes this many outputs, with a bar that counts them.
    pub fn files<T>(
        &self,
        outputs: u64,
        work: impl FnOnce() -> Result<T, Failure>,
    ) -> Result<T, Failure> {
        self.stage("files and pictures", || {
            self.bars.length(outputs);
            work()
        })
    }

    /// Draws `NAME.png`, unless the command line wants no pictures.
    pub fn picture(
        &self,
        name: &str,
        draw: impl FnOnce() -> Result<Image, Failure>,
    ) -> Result<(), Failure> {
        if self.common.no_pictures {
            return Ok(());
        }
        Ok(draw()?.save(self.output(format!("{name}.png"))?)?)
    }

    /// Puts a surface on the page of the run, in one or more colourings with their names, unless the command line wants
    /// no pictures.
    pub fn show(&self, name: &str, mesh: &TriMesh, colorings: Vec<(String, Coloring)>) {
        if !self.common.no_pictures {
            let (positions, triangles) = (mesh.positions(), mesh.triangles());
            let name = self.shown_as(name);
            self.page().add(&name, positions, triangles, colorings);
        }
    }

    /// Puts on the page what a picture shows, to be turned.
    pub fn show_scene(&self, name: &str, scene: &Scene) {
        if !self.common.no_pictures {
            let name = self.shown_as(name);
            self.page().add_scene(&name, scene);
        }
    }

    /// Puts the structure of a file inside the surfaces of the page.
    pub fn show_structure(&self, file: &Path) {
        if !self.common.no_pictures {
            self.page().put_structure(file);
        }
    }

    fn page(&self) -> MutexGuard<'_, Page> {
        self.page.lock().unwrap_or_else(|e| e.into_inner())
    }

    /// What draws pictures; opened on first use.
    pub fn rasterizer(&self) -> Result<&Rasterizer, Failure> {
        if self.rasterizer.get().is_none() {
            // Locked until it is set, so that only one is opened.
            let mut report = self.report();
            if self.rasterizer.get().is_none() {
                let rasterizer = Rasterizer::new(self.common.renderer, &self.device)?;
                report.renderer = Some(rasterizer.name());
                let _ = self.rasterizer.set(rasterizer);
            }
        }
        Ok(self.rasterizer.get().expect("set above"))
    }

    /// Moves the outputs to their place, and leaves the rest to another process.
    fn publish_alone(mut self) -> Result<String, Failure> {
        let outputs = std::mem::take(&mut self.report().outputs);
        if let Some(staging) = self.staging.take() {
            staging.publish(&outputs)?;
        }
        Ok(format!("{} files beside those of rank 0", outputs.len()))
    }

    /// Writes `report.json` and `index.html`, and moves every output to its place.
    fn close(self) -> Result<String, Failure> {
        if self.bars.stopped() {
            return Err(Cancelled.into());
        }
        if self.follows.load(Ordering::Relaxed) {
            return self.publish_alone();
        }
        let path = self.output("report.json")?;
        let page = (!self.common.no_pictures)
            .then(|| self.output("index.html"))
            .transpose()?;
        let (outputs, mut lines) = {
            let mut report = self.report();
            report.seconds = self.started.elapsed().as_secs_f64();
            report.peak_bytes = peak_bytes();
            // Written side by side, in any order.
            report.outputs.sort();
            io::save(path, |w| {
                serde_json::to_writer_pretty(&mut *w, &*report)
                    .map_err(|e| io::ErrorKind::System(e.into()))?;
                Ok(w.write_all(b"\n")?)
            })?;
            let lines = words::lines(&report.notes);
            if let Some(path) = page {
                let shown = std::mem::take(&mut *self.page());
                shown.save(&path, &serde_json::to_value(&*report)?, &lines)?;
            }
            (report.outputs.clone(), lines)
        };
        let mut session = self;
        let earlier = outputs_of(&session.common.out.join("report.json"));
        if let Some(staging) = session.staging.take() {
            staging.publish(&outputs)?;
        }
        let seconds = session.started.elapsed().as_secs_f64();
        let (n, folder) = (outputs.len(), session.common.out.display());
        let stays =
            |name: &String| !outputs.contains(name) && session.common.out.join(name).exists();
        let left: Vec<String> = earlier.into_iter().filter(stays).collect();
        if !left.is_empty() {
            lines.push(format!(
                "warning: still there, of an earlier run in {folder}: {}",
                left.join(", ")
            ));
        }
        lines.push(format!(
            "{n} files in {folder} after {seconds:.1} s: {}",
            outputs.join(", ")
        ));
        Ok(lines.join("\n"))
    }
}

/// The outputs that a report names, if it is one.
fn outputs_of(report: &Path) -> Vec<String> {
    let read = std::fs::read(report).ok();
    let value = read.and_then(|bytes| serde_json::from_slice::<serde_json::Value>(&bytes).ok());
    let names = value.as_ref().and_then(|v| v["outputs"].as_array());
    let text = |name: &serde_json::Value| Some(name.as_str()?.to_owned());
    names.into_iter().flatten().filter_map(text).collect()
}

/// How the hidden folders are named, and the file in them that a living run locks.
const UNFINISHED: &str = ".unfinished-";
const ALIVE: &str = ".alive";

/// A hidden folder in the output folder. When it goes, the output folder goes, too, if it is empty and
/// we made it. What a run that was killed has left there, the next one clears away.
struct Staging {
    folder: tempfile::TempDir,
    /// Locked as long as this run lives: how another run knows that the folder is in use.
    _alive: File,
    out: PathBuf,
    /// The topmost folder that we had to make.
    made: Option<PathBuf>,
}

impl Staging {
    fn open(out: &Path) -> Result<Self, Failure> {
        let named = |e: std::io::Error| io::Error::from(io::ErrorKind::System(e)).in_file(out);
        let is_file = |folder: &&Path| folder.exists() && !folder.is_dir();
        if let Some(file) = out.ancestors().find(is_file) {
            let (out, file) = (out.display(), file.display());
            return Err(format!("--out {out}: {file} is a file, not a folder").into());
        }
        // Runs with one output folder that we all make, as the ranks of a job are, may take it away empty just
        // before ours is in it: then it is made again.
        let mut tries = 100;
        let (made, folder) = loop {
            match Self::folder_in(out) {
                Err(e) if e.kind() == std::io::ErrorKind::NotFound && tries > 0 => tries -= 1,
                ended => break ended.map_err(named)?,
            }
        };
        // It gets its name when it is locked, so that nobody finds it unlocked. Where the file system knows no
        // locks, it gets none, and a folder that a killed run leaves stays.
        let path = folder.path().join("unlocked");
        let alive = File::create(&path).map_err(named)?;
        if alive.try_lock().is_ok() {
            std::fs::rename(path, folder.path().join(ALIVE)).map_err(named)?;
        }
        Ok(Self {
            folder,
            _alive: alive,
            out: out.to_owned(),
            made,
        })
    }

    /// A new hidden folder in `out`, and the topmost folder that had to be made for it.
    fn folder_in(out: &Path) -> std::io::Result<(Option<PathBuf>, tempfile::TempDir)> {
        let absent = out
            .ancestors()
            .take_while(|a| !a.as_os_str().is_empty() && !a.exists())
            .last();
        let made = absent.map(Path::to_owned);
        std::fs::create_dir_all(out)?;
        Self::clear(out);
        let mut folder = tempfile::Builder::new();
        Ok((made, folder.prefix(UNFINISHED).tempdir_in(out)?))
    }

    /// Removes the folders of runs that have died, as well as that goes.
    fn clear(out: &Path) {
        for entry in std::fs::read_dir(out).into_iter().flatten().flatten() {
            let (name, path) = (entry.file_name(), entry.path());
            if name.as_encoded_bytes().starts_with(UNFINISHED.as_bytes())
                && File::open(path.join(ALIVE)).is_ok_and(|f| f.try_lock().is_ok())
            {
                let _ = std::fs::remove_dir_all(path);
            }
        }
    }

    /// Moves every output to its place.
    fn publish(mut self, outputs: &[String]) -> Result<(), Failure> {
        for name in outputs {
            let (from, to) = (self.folder.path().join(name), self.out.join(name));
            if let Some(folder) = to.parent() {
                std::fs::create_dir_all(folder).map_err(|e| io::Error::from(e).in_file(folder))?;
            }
            std::fs::rename(&from, &to).map_err(|e| io::Error::from(e).in_file(&to))?;
        }
        self.made = None;
        Ok(())
    }
}

impl Drop for Staging {
    fn drop(&mut self) {
        if let Some(made) = &self.made {
            let _ = std::fs::remove_dir_all(self.folder.path());
            let mut folder = Some(self.out.as_path());
            while let Some(f) = folder.filter(|f| f.starts_with(made)) {
                if std::fs::remove_dir(f).is_err() {
                    break;
                }
                folder = f.parent();
            }
        }
    }
}

/// Progress bars: one at a time, on a terminal only.
struct Bars {
    bar: Mutex<Option<(&'static str, ProgressBar)>>,
    quiet: bool,
    /// Set from outside when the work is to end.
    stop: Arc<AtomicBool>,
}

impl Bars {
    fn new(quiet: bool, stop: Arc<AtomicBool>) -> Self {
        Self {
            bar: Mutex::new(None),
            quiet,
            stop,
        }
    }

    fn stopped(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }

    fn lock(&self) -> MutexGuard<'_, Option<(&'static str, ProgressBar)>> {
        self.bar.lock().unwrap_or_else(|e| e.into_inner())
    }

    fn show(&self, name: &'static str, total: u64) -> ProgressBar {
        if self.quiet {
            return ProgressBar::hidden();
        }
        let style = "{prefix:>24} {bar:36.cyan/dim} {percent:>3} % {elapsed}";
        let bar = ProgressBar::new(total.max(1)).with_prefix(name);
        bar.set_style(
            ProgressStyle::with_template(style)
                .expect("a valid template")
                .progress_chars("━╸─"),
        );
        bar.enable_steady_tick(Duration::from_millis(200));
        bar
    }

    fn begin(&self, name: &'static str) {
        *self.lock() = Some((name, self.show(name, 1)));
    }

    /// How many steps the current bar has.
    fn length(&self, steps: u64) {
        if let Some((_, bar)) = &*self.lock() {
            bar.set_length(steps.max(1));
        }
    }

    /// One step more.
    fn step(&self) {
        if let Some((_, bar)) = &*self.lock() {
            bar.inc(1);
        }
    }

    fn end(&self, name: &'static str, seconds: f64) {
        if let Some((_, bar)) = self.lock().take() {
            bar.println(format!("{name:>24} {seconds:8.2} s"));
            bar.finish_and_clear();
        }
    }
}

impl Monitor for Bars {
    fn progress(&self, stage: &'static str, done: u64, total: u64) -> ControlFlow<()> {
        if self.stopped() {
            return ControlFlow::Break(());
        }
        let mut current = self.lock();
        match &*current {
            Some((name, bar)) if *name == stage => {
                bar.set_length(total.max(1));
                bar.set_position(done);
            }
            _ => {
                if let Some((_, bar)) = current.take() {
                    bar.finish_and_clear();
                }
                let bar = self.show(stage, total);
                bar.set_position(done);
                *current = Some((stage, bar));
            }
        }
        ControlFlow::Continue(())
    }
}

/// The most memory this process has held, in bytes, where the system tells (Linux).
pub(crate) fn peak_bytes() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find(|l| l.starts_with("VmHWM:"))?;
    let kilobytes: u64 = line.split_whitespace().nth(1)?.parse().ok()?;
    Some(kilobytes * 1024)
}
