//! Scripts that open results beside the structure that they are of, in ChimeraX and in PyMOL.

use std::path::Path;

use geom_core::io;
use serde_json::json;

use crate::{Failure, Session};

/// PyMOL reads neither glTF nor PLY: the script does.
const PYMOL: &str = include_str!("../assets/view.pml");

/// Writes `view.cxc` and `view.pml`: the structure, and outputs of this run in its place. Surfaces are half seen
/// through.
pub fn save(
    session: &Session,
    structure: &Path,
    surfaces: &[&str],
    points: &[&str],
) -> Result<(), Failure> {
    let found = structure.canonicalize();
    let path = found.as_deref().unwrap_or(structure).to_string_lossy();
    io::save(session.output("view.cxc")?, |w| {
        writeln!(
            w,
            "# Opens the structure and what was made of it in ChimeraX."
        )?;
        writeln!(w, "open {}", quoted(&path))?;
        for name in surfaces {
            writeln!(w, "open {}", quoted(&format!("{name}.glb")))?;
        }
        for name in points {
            writeln!(w, "open {}", quoted(&format!("{name}.pdb")))?;
        }
        writeln!(w, "transparency 40 target s")?;
        Ok(writeln!(w, "view")?)
    })?;
    io::save(session.output("view.pml")?, |w| {
        // Strings of JSON are strings of Python.
        writeln!(w, "{PYMOL}cmd.load({})", json!(path))?;
        for name in surfaces {
            writeln!(w, "surface({})", json!(name))?;
        }
        for name in points {
            writeln!(
                w,
                "cmd.load(os.path.join(here, {}))",
                json!(format!("{name}.pdb"))
            )?;
        }
        Ok(writeln!(w, "cmd.orient()\npython end")?)
    })?;
    Ok(())
}

/// As ChimeraX quotes: between double quotes, with backslashes.
fn quoted(text: &str) -> String {
    format!("\"{}\"", text.replace('\\', "\\\\").replace('"', "\\\""))
}
