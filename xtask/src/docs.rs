//! `cargo xtask docs`: what the pages say is there, and what they tell people to type works.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use clap::Parser;

use crate::{Outcome, root, target};

/// How much is run.
#[derive(clap::Args)]
pub(crate) struct Arguments {
    /// Only what the gate has time for: benches are not run
    #[arg(long)]
    pub(crate) quick: bool,
}

pub(crate) fn run(arguments: &Arguments) -> Outcome {
    let pages = pages()?;
    let (mut files, mut wrong) = (0, Vec::new());
    for (page, text) in &pages {
        let named: BTreeSet<String> = named(text).collect();
        files += named.len();
        let absent = named.iter().filter(|name| !is_there(page, name));
        wrong.extend(absent.map(|name| format!("{}: there is no {name}", page.display())));
        wrong.extend(long(page, text));
    }
    if !wrong.is_empty() {
        return Err(wrong.join("\n"));
    }
    println!(
        "{} pages, which name {files} files and folders",
        pages.len()
    );

    let scratch = Scratch::new()?;
    let mut seen = BTreeSet::new();
    for (page, text) in &pages {
        // In order: a command may take what the one before it has made.
        for line in commands(text).filter(|line| seen.insert(line.clone())) {
            let outcome = scratch.obey(&line, arguments.quick);
            let told = outcome.map_err(|e| format!("{}: `{line}`: {e}", page.display()))?;
            println!("{told}: {line}");
        }
    }
    Ok(())
}

/// The pages that git knows or would take, by their place in the workspace.
fn pages() -> Result<Vec<(PathBuf, String)>, String> {
    let listed = Command::new("git")
        .args([
            "ls-files",
            "--cached",
            "--others",
            "--exclude-standard",
            "*.md",
        ])
        .current_dir(root())
        .output()
        .map_err(|e| format!("git: {e}"))?;
    let names = String::from_utf8_lossy(&listed.stdout);
    let read = |name: &str| {
        let text = fs::read_to_string(root().join(name)).map_err(|e| format!("{name}: {e}"))?;
        Ok((PathBuf::from(name), text))
    };
    names
        .lines()
        .filter(|name| root().join(name).is_file())
        .map(read)
        .collect()
}

/// A crate's own page is one that is read to its end.
fn long(page: &Path, text: &str) -> Option<String> {
    let of_crate = page.starts_with("crates") && page.ends_with("README.md");
    let lines = text.lines().count();
    (of_crate && lines > 120).then(|| format!("{}: {lines} lines, more than 120", page.display()))
}

/// The files and folders that a page names: targets of links, and code from the top of the workspace down to a file.
fn named(text: &str) -> impl Iterator<Item = String> {
    let links = text
        .split("](")
        .skip(1)
        .filter_map(|rest| rest.split(')').next());
    let links = links
        .filter(|link| !link.contains("://") && link.contains(['/', '.']) && !link.contains("::"));
    let links = links.map(|link| link.split('#').next().unwrap_or_default().to_owned());
    // `[name]: target`, to which links elsewhere on the page refer.
    let definitions = text.lines().filter_map(|line| {
        let (_, target) = line.strip_prefix('[')?.split_once("]: ")?;
        (!target.contains("://")).then(|| target.trim().to_owned())
    });
    let prose = text.split("```").step_by(2);
    let spans = prose.flat_map(|part| part.split('`').skip(1).step_by(2));
    let tops = [
        "crates/",
        "shaders/",
        "examples/",
        "benches/",
        "xtask/",
        "fixtures/",
        ".ci/",
    ];
    let whole = |span: &&str| {
        span.chars()
            .all(|c| c.is_ascii_alphanumeric() || "/._-".contains(c))
    };
    // `NAME` and `NN` stand for any.
    let any = |span: &str| {
        span.split(['/', '.', '_']).any(|part| {
            part.len() > 1 && part != "README" && part.chars().all(|c| c.is_ascii_uppercase())
        })
    };
    let spans = spans.filter(move |span| {
        tops.iter().any(|top| span.starts_with(top)) && whole(span) && !any(span)
    });
    let spans = spans.map(|span| format!("/{span}"));
    links
        .filter(|link| !link.is_empty())
        .chain(definitions)
        .chain(spans)
        .collect::<Vec<_>>()
        .into_iter()
}

/// Links are seen from their page, code from the top (with a `/` before it).
fn is_there(page: &Path, name: &str) -> bool {
    match name.strip_prefix('/') {
        Some(name) => root().join(name).exists(),
        None => root()
            .join(page)
            .parent()
            .is_some_and(|folder| folder.join(name).exists()),
    }
}

/// The commands of a page: the lines of its blocks of `sh`, without comments.
fn commands(text: &str) -> impl Iterator<Item = String> {
    let blocks = text.split("\n```sh\n").skip(1);
    let lines = blocks.flat_map(|rest| rest.split("\n```").next().unwrap_or_default().lines());
    let bare = lines.map(|line| {
        line.split(" #")
            .next()
            .unwrap_or_default()
            .trim()
            .to_owned()
    });
    bare.filter(|line| !line.is_empty())
        .collect::<Vec<_>>()
        .into_iter()
}

/// A folder with what the pages take as given.
struct Scratch {
    folder: PathBuf,
}

impl Scratch {
    fn new() -> Result<Self, String> {
        let folder = target().join("docs");
        let text = |e: std::io::Error| format!("{}: {e}", folder.display());
        if folder.exists() {
            fs::remove_dir_all(&folder).map_err(text)?;
        }
        let fixtures = root().join("fixtures/files");
        fs::create_dir_all(folder.join("fixtures/files")).map_err(text)?;
        fs::create_dir_all(folder.join("structures")).map_err(text)?;
        for entry in fs::read_dir(&fixtures).map_err(text)? {
            let entry = entry.map_err(text)?;
            fs::copy(
                entry.path(),
                folder.join("fixtures/files").join(entry.file_name()),
            )
            .map_err(text)?;
        }
        for name in ["1AJJ.pdb", "5e5z.pdb"] {
            fs::copy(fixtures.join(name), folder.join("structures").join(name)).map_err(text)?;
        }
        fs::write(folder.join("more.list"), "fixtures/files/1A8O.cif\n").map_err(text)?;
        Ok(Self { folder })
    }

    /// Runs a command, or says who else does.
    fn obey(&self, line: &str, quick: bool) -> Result<&'static str, String> {
        let words: Vec<&str> = line.split_whitespace().collect();
        match words[..] {
            ["cargo", "run", "--example", name, "--", ref rest @ ..] => self.program(name, rest),
            // Its lighter build is for who has nothing built yet; the gate's lints compile it.
            ["cargo", "pipeline", ref rest @ ..] if quick => self.program("00_pipeline", rest),
            ["cargo", "pipeline", ref rest @ ..] => {
                crate::call("cargo", &["pipeline", "--version"], &[])?;
                self.ended("00_pipeline", rest)
            }
            ["cargo", "xtask", ..] => {
                let chore = crate::Arguments::try_parse_from(&words[1..]);
                chore.map_err(|e| e.to_string().lines().next().unwrap_or_default().to_owned())?;
                Ok("a chore that is there")
            }
            ["cargo", "test", "--workspace"]
            | ["cargo", "build", "--example", _, "--features", "mpi"]
            | ["mpirun", ..] => Ok("run by the gate"),
            ["apt-get", "install", ..] => Ok("run by .ci/run"),
            ["cargo", "bench", ..] if quick => Ok("not run here"),
            ["cargo", "bench", ref rest @ ..] => {
                crate::call("cargo", &[&["bench"], rest].concat(), &[])?;
                Ok("ran")
            }
            _ => Err("nobody knows how to run this".into()),
        }
    }

    /// One of the programs, as the tests have built it.
    fn program(&self, name: &str, arguments: &[&str]) -> Result<&'static str, String> {
        let build = ["build", "--quiet", "--workspace", "--example", name];
        crate::call("cargo", &build, &[])?;
        self.ended(name, arguments)
    }

    /// What becomes of a program that was built last with these arguments. A file that is not bundled must be what it complains about: then it has
    /// understood its options, for a wrong one ends it otherwise.
    fn ended(&self, name: &str, arguments: &[&str]) -> Result<&'static str, String> {
        let output = Command::new(target().join("debug/examples").join(name))
            .args(arguments)
            .current_dir(&self.folder)
            .output()
            .map_err(|e| format!("cannot run it: {e}"))?;
        let told = String::from_utf8_lossy(&output.stderr);
        let last = told.lines().last().unwrap_or_default();
        let files = arguments
            .iter()
            .filter(|a| !a.starts_with('-') && a.contains('.'));
        let absent = files.clone().find(|file| !self.folder.join(file).exists());
        match (output.status.code(), absent) {
            (Some(0), _) => Ok("ran"),
            (Some(1 | 3), Some(file)) if told.contains(*file) => {
                Ok("understood, without its input")
            }
            (code, _) => Err(format!("ended with {code:?}: {last}")),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_pages_name_is_there() {
        let pages = pages().expect("git lists them");
        assert!(pages.len() > 12);
        for (page, text) in &pages {
            for name in named(text) {
                assert!(
                    is_there(page, &name),
                    "{}: there is no {name}",
                    page.display()
                );
            }
        }
    }

    /// A page shows its picture as a file beside it; the documentation of the crate, which has no files, as text. Both must be
    /// the same, and all pictures together no more than 3 MB.
    #[test]
    fn pictures_of_crates_are_in_their_documentation_too() {
        use base64::Engine as _;
        let folders = fs::read_dir(root().join("crates")).expect("the crates");
        let mut count = 0;
        for folder in folders.map(|f| f.expect("a crate").path()) {
            let at = folder.display();
            let page = fs::read_to_string(folder.join("README.md")).expect("a page");
            assert!(
                page.contains("][picture]\n"),
                "{at}: the page has no picture"
            );
            assert!(page.contains("\n[picture]: picture.png\n"), "{at}");
            let picture = fs::read(folder.join("picture.png")).expect("a picture");
            let text = fs::read_to_string(folder.join("picture.b64")).expect("the same as text");
            let encoded = base64::engine::general_purpose::STANDARD.encode(picture);
            assert_eq!(text.trim_end(), encoded, "{at}: another picture");
            let library = fs::read_to_string(folder.join("src/lib.rs")).expect("a library");
            assert!(library.contains("include_str!(\"../picture.b64\")"), "{at}");
            count += 1;
        }
        assert_eq!(count, 8);
        // Not what somebody's runs have left in a folder here.
        let listed = Command::new("git")
            .args(["ls-files", "*.png", "*.b64"])
            .current_dir(root())
            .output()
            .expect("git lists them");
        let names = String::from_utf8_lossy(&listed.stdout).into_owned();
        let sizes = names
            .lines()
            .filter_map(|name| fs::metadata(root().join(name)).ok());
        let bytes: u64 = sizes.map(|file| file.len()).sum();
        assert!((1..=3 << 20).contains(&bytes), "{bytes} bytes of pictures");
    }

    #[test]
    fn names_and_commands_are_found() {
        let text = "[e]: f.png\nSee [a](b/c.md#d) and `crates/x/y.rs`, not `io/NAME.rs`, [`x`](crate::y) or `crates/NAME/z`.\n```sh\ncargo a # why\n\nls\n```\n`xtask/src`";
        let names: Vec<_> = named(text).collect();
        assert_eq!(names, ["b/c.md", "f.png", "/crates/x/y.rs", "/xtask/src"]);
        assert_eq!(commands(text).collect::<Vec<_>>(), ["cargo a", "ls"]);
    }
}
