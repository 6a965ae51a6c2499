//! Outputs appear together or not at all, whatever ends a run.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use biogeom_examples::Failure;
use biogeom_examples::args::{Common, HasCommon};
use biogeom_examples::session::{heed_signals, run_with};
use clap::Parser;
use geom_core::{Cancelled, Cpu};
use serde::Serialize;
use serde_json::{Value, json};
use signal_hook::consts::SIGTERM;

#[derive(Parser, Serialize)]
struct Args {
    #[command(flatten)]
    common: Common,
}
impl HasCommon for Args {
    fn common(&self) -> &Common {
        &self.common
    }
    fn inputs(&self) -> Vec<PathBuf> {
        Vec::new()
    }
}

fn args(out: &Path) -> Args {
    Args::parse_from([
        "test",
        "--quiet",
        "--threads",
        "2",
        "--out",
        out.to_str().unwrap(),
    ])
}

#[test]
fn outputs_appear_together_with_a_report() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("a/b");
    let summary = run_with(
        "test",
        &args(&out),
        Vec::new(),
        Arc::default(),
        |_, session| {
            // Nothing is there before the first output: who is killed in between leaves nothing.
            assert!(!out.exists());
            session.stage("writing", || -> Result<(), Failure> {
                Ok(std::fs::write(session.output("x.txt")?, "x")?)
            })?;
            session.note("counts", json!({ "atoms": 3 }))?;
            session.note("counts", json!({ "triangles": 5 }))
        },
    );
    assert!(summary.unwrap().contains("x.txt"));
    let mut names: Vec<_> = std::fs::read_dir(&out)
        .unwrap()
        .map(|e| e.unwrap().file_name())
        .collect();
    names.sort();
    assert_eq!(names, ["index.html", "report.json", "x.txt"]);
    let report: Value =
        serde_json::from_slice(&std::fs::read(out.join("report.json")).unwrap()).unwrap();
    assert_eq!(report["counts"], json!({ "atoms": 3, "triangles": 5 }));
    assert_eq!(report["stages"][0]["name"], "writing");
    assert_eq!(report["backend"], "cpu");
    assert_eq!(report["threads"], 2);
    if cfg!(target_os = "linux") {
        assert!(report["peak_bytes"].as_u64().unwrap() > 1_000_000);
    }
}

#[test]
fn far_more_threads_than_cores_are_warned_of() {
    let folder = tempfile::tempdir().unwrap();
    let warnings = |threads: &str| -> Value {
        let out = folder.path().join(threads);
        let out = out.to_str().unwrap();
        let args = Args::parse_from(["test", "--quiet", "--threads", threads, "--out", out]);
        run_with("test", &args, Vec::new(), Arc::default(), |_, _| Ok(())).unwrap();
        let report = std::fs::read(Path::new(out).join("report.json")).unwrap();
        serde_json::from_slice::<Value>(&report).unwrap()["advice"]["warnings"].clone()
    };
    assert_eq!(warnings("1"), Value::Null);
    let cores = std::thread::available_parallelism().unwrap().get();
    let many = warnings("1024");
    let said = many[0].as_str().unwrap_or_default();
    assert_eq!(said.contains("--threads 1024"), 4 * cores < 1024, "{many}");
}

#[test]
fn a_failure_leaves_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("a/b");
    let failed = run_with(
        "test",
        &args(&out),
        Vec::new(),
        Arc::default(),
        |_, session| {
            std::fs::write(session.output("x.txt")?, "x")?;
            Err("no".into())
        },
    );
    assert_eq!(failed.unwrap_err().to_string(), "no");
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
    // A folder that was there before stays, with what is in it.
    std::fs::create_dir(folder.path().join("a")).unwrap();
    let kept = run_with(
        "test",
        &args(&folder.path().join("a")),
        Vec::new(),
        Arc::default(),
        |_, _| Err("no".into()),
    );
    assert!(kept.is_err() && folder.path().join("a").exists());
}

#[test]
fn a_signal_stops_the_work_and_leaves_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let stop = Arc::<AtomicBool>::default();
    heed_signals(&stop, &Arc::default()).unwrap();
    let stopped = run_with(
        "test",
        &args(&folder.path().join("a")),
        Vec::new(),
        stop,
        |_, session| {
            std::fs::write(session.output("x.txt")?, "x")?;
            let run = session.on(&Cpu);
            session.stage("before", || run.progress("before", 0, 1))?;
            signal_hook::low_level::raise(SIGTERM)?;
            assert!(run.progress("after", 0, 1).is_err());
            session.stage("after", || -> Result<(), Failure> {
                unreachable!("no stage begins once the work is to end")
            })
        },
    );
    assert!(stopped.unwrap_err().is::<Cancelled>());
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
}
