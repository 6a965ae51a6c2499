//! A mesh in tiles: VTK joins its parts, Gmsh opens them, and both find the mesh that we have merged.

use std::path::Path;

use geom_core::TetMesh;
use geom_core::io::mesh;
use geom_core::mesh::OUTSIDE;
use serde_json::Value;

use super::{Lab, integer, number, text};
use crate::{Outcome, fixtures};

/// How many tiles: some of them empty.
const TILES: &str = "11";

/// A mesh in tiles beside the merged one.
pub(super) fn tiles(lab: &mut Lab) -> Outcome {
    let out = lab.file("tiles");
    made(&out)?;
    let report = std::fs::read(out.join("report.json")).map_err(text)?;
    let report: Value = serde_json::from_slice(&report).map_err(text)?;
    let ours = Merged::read(&out.join("volume.vtu"))?;
    let theirs = lab.ask("tiles.py", &[out.display().to_string()])?;
    for file in ["pvtu", "msh"] {
        ours.compare(lab, file, &theirs[file])?;
    }
    let [vtk, gmsh] = ["pvtu", "msh"].map(|file| &theirs[file]);
    let lost = integer(vtk, "vertices without one owner")?;
    lab.same("tiles, pvtu: vertices without one owner", 0, lost);
    let misplaced = integer(&theirs, "misplaced")?;
    lab.same(
        "tiles, vtu: ghosts missing or in another layer",
        0,
        misplaced,
    );
    let nobody = integer(gmsh, "ghosts of nobody")?;
    lab.same("tiles, msh: ghosts of nobody", 0, nobody);
    let there = integer(gmsh, "ghosts")? > 0;
    lab.same("tiles, msh: there are ghosts", true, there);
    let tets = ours.tets.tets().len() as i64;
    let together = integer(gmsh, "opened together")?;
    lab.same("tiles, msh: opened together", tets, together);
    let told = report["tiles"]["tetrahedra"].as_i64().unwrap_or(0);
    lab.same("tiles: tetrahedra of the report", told, tets);
    Ok(())
}

/// Both sides of a protein's surface in tiles, in parts and merged, by our own program.
fn made(out: &Path) -> Outcome {
    let input = fixtures::path("1AJJ.pdb").display().to_string();
    let told = [
        &input,
        "--spacing",
        "0.8",
        "--both",
        "--improve",
        "--tiles",
        TILES,
        "--no-pictures",
    ];
    super::program("20_tiles", &told, out)
}

/// The merged mesh as our own reader has it, which the parts must add up to.
struct Merged {
    tets: TetMesh,
    /// The nearest atom of each vertex times its number: the order of vertices counts.
    atoms: i64,
    /// Faces between inside and outside.
    outside: i64,
    /// Groups by name, and how many cells each has.
    groups: Vec<(String, i64)>,
}

impl Merged {
    fn read(path: &Path) -> Result<Self, String> {
        let merged = mesh::read(path).map_err(text)?;
        let atoms = merged.point_fields.iter().find(|f| f.name == "atom");
        let atoms = atoms.ok_or("the merged mesh has no labels")?;
        let atoms = (1..).zip(atoms.values.to_f64());
        let of_faces = merged.faces.iter().map(|f| f.1);
        let group_of: Vec<u32> = merged.group_of.into_iter().chain(of_faces).collect();
        let cells = |g: u32| group_of.iter().filter(|&&of| of == g).count() as i64;
        let groups = (0..)
            .zip(merged.groups)
            .map(|(g, group)| (group.name, cells(g)));
        let mesh::AnyMesh::Tet(tets) = merged.mesh else {
            return Err("the merged mesh has no tetrahedra".to_owned());
        };
        let faces = tets.interfaces();
        Ok(Self {
            atoms: atoms.map(|(i, atom)| i * atom as i64).sum(),
            outside: faces.iter().filter(|f| f.outside == OUTSIDE).count() as i64,
            groups: groups.collect(),
            tets,
        })
    }

    /// The sums over the parts of a format, as another program read them.
    fn compare(&self, lab: &mut Lab, file: &str, theirs: &Value) -> Outcome {
        let what = |measure: &str| format!("tiles, {file}: {measure}");
        let tets = self.tets.tets().len() as i64;
        for (measure, ours) in [
            ("vertices", self.tets.positions().len() as i64),
            ("tetrahedra", tets),
            ("distinct tetrahedra", tets),
            ("boundary faces", self.outside),
            ("faces of three", 0),
            ("copies that differ", 0),
            ("atoms", self.atoms),
        ] {
            lab.same(&what(measure), ours, integer(theirs, measure)?);
        }
        for region in [0, 1] {
            let measure = what(&format!("volume of region {region}"));
            let volume = number(&theirs["volumes"], &region.to_string())?;
            lab.near(&measure, self.tets.region_volume(region), volume, 1e-11);
        }
        for (name, cells) in &self.groups {
            let measure = what(&format!("cells of {name}"));
            lab.same(&measure, *cells, integer(&theirs["groups"], name)?);
        }
        let named = theirs["groups"].as_object().map_or(0, serde_json::Map::len);
        lab.same(&what("groups"), self.groups.len(), named);
        Ok(())
    }
}
