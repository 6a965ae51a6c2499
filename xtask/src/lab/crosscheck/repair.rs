//! The surfaces that `02_surface` makes without being told anything, in MeshFix (pymeshfix): there is nothing to repair.

use geom_core::io::mesh;

use super::{Lab, integer, number, text};
use crate::{Outcome, fixtures};

const STRUCTURES: [&str; 5] = ["1AJJ.pdb", "1A8O.cif", "1orc.pdb", "1hvr.pdb", "5e5z.pdb"];

/// No borders, no triangle that cuts another, and the same triangles with the same volume after its repair.
pub(super) fn repair(lab: &mut Lab) -> Outcome {
    let mut files = Vec::new();
    for structure in STRUCTURES {
        let out = lab.file(&format!("repair_{structure}"));
        let input = fixtures::path(structure);
        super::program(
            "02_surface",
            &[&input.display().to_string(), "--no-pictures"],
            &out,
        )?;
        files.push(out.join("surface.ply").display().to_string());
    }
    let answers = lab.ask("repair.py", &files)?;
    for ((structure, file), theirs) in STRUCTURES
        .iter()
        .zip(&files)
        .zip(answers.as_array().into_iter().flatten())
    {
        let mesh::AnyMesh::Tri(surface) = mesh::read(file).map_err(text)?.mesh else {
            return Err(format!("{file}: no triangles"));
        };
        let count = surface.triangles().len() as i64;
        let what = |measure: &str| format!("{structure}, MeshFix: {measure}");
        for (measure, ours) in [
            ("borders", 0),
            ("cut", 0),
            ("triangles", count),
            ("kept", count),
        ] {
            lab.same(&what(measure), ours, integer(theirs, measure)?);
        }
        lab.same(&what("clean"), true, theirs["clean"] == true);
        let volume = number(theirs, "volume")?;
        lab.near(&what("volume"), surface.volume(), volume, 1e-9);
    }
    Ok(())
}
