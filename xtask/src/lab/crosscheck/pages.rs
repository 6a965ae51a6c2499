//! The page of a run in a browser: Chromium without a window runs its script, and must show the surface and the numbers of
//! the report.

use std::path::Path;
use std::process::Command;

use serde_json::Value;

use super::{Lab, text};
use crate::{Outcome, fixtures};

/// Names under which systems install it.
const BROWSERS: [&str; 3] = ["chromium", "chromium-browser", "google-chrome"];

/// The page of a structure, which has atoms to look at, and that of a mesh, which has none.
pub(super) fn pages(lab: &mut Lab) -> Outcome {
    let there = |name: &&str| Command::new(name).arg("--version").output().is_ok();
    let Some(browser) = BROWSERS.into_iter().find(there) else {
        println!("SKIPPED, not compared: no Chromium for the pages");
        return Ok(());
    };
    for (program, input) in [("02_surface", "1AJJ.pdb"), ("06_modes", "spot.ply")] {
        let out = lab.file(&format!("page_{program}"));
        let input = fixtures::path(input);
        super::program(program, &[&input.display().to_string()], &out)?;
        let report = std::fs::read(out.join("report.json")).map_err(text)?;
        let report: Value = serde_json::from_slice(&report).map_err(text)?;
        let page = shown(browser, &out.join("index.html"))?;
        lab.same(
            &format!("{program}: canvases"),
            1,
            page.matches("<canvas").count(),
        );
        let said = page.contains(r#"id="trouble" class="warning" hidden"#);
        lab.same(&format!("{program}: nothing to complain of"), true, said);
        for key in ["surface_vertices", "surface_triangles"] {
            let number = &report["counts"][key];
            let cell = format!("<th>{}</th><td>{number}</td>", key.replace('_', " "));
            lab.same(
                &format!("{program}: {key} in the table"),
                true,
                page.contains(&cell),
            );
        }
    }
    Ok(())
}

/// The page after its script has run, without the script and the data.
fn shown(browser: &str, page: &Path) -> Result<String, String> {
    let address = format!("file://{}", page.canonicalize().map_err(text)?.display());
    let asked = [
        "--headless",
        "--no-sandbox",
        "--enable-unsafe-swiftshader",
        "--virtual-time-budget=30000",
        "--dump-dom",
        &address,
    ];
    let output = Command::new(browser).args(asked).output().map_err(text)?;
    let dom = String::from_utf8_lossy(&output.stdout).into_owned();
    match dom.split_once("<script") {
        Some((body, _)) => Ok(body.to_owned()),
        None => Err(format!("{browser} shows nothing of {address}")),
    }
}
