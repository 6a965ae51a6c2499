//! A mesh in tiles: VTK joins its parts, Gmsh opens them, and both find the mesh that we have merged.

use geom_core::io::mesh;
use geom_core::mesh::OUTSIDE;
use serde_json::Value;

use super::{Lab, integer, number, text};
use crate::{Outcome, fixtures};

/// How many tiles: some of them empty.
const TILES: &str = "11";

/// A molecule in its box, improved, in parts.
pub(super) fn tiles(lab: &mut Lab) -> Outcome {
    let out = lab.file("tiles");
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
    super::program("20_tiles", &told, &out)?;
    let report = std::fs::read(out.join("report.json")).map_err(text)?;
    let report: Value = serde_json::from_slice(&report).map_err(text)?;
    let merged = mesh::read(out.join("volume.vtu")).map_err(text)?;
    let atoms = merged.point_fields.iter().find(|f| f.name == "atom");
    let atoms = atoms
        .ok_or("the merged mesh has no labels")?
        .values
        .to_f64();
    // By number of vertex: the order counts.
    let atoms = (1..).zip(&atoms).map(|(i, atom)| i * *atom as i64).sum();
    let (groups, group_of) = (merged.groups, merged.group_of);
    let faces = merged.faces;
    let mesh::AnyMesh::Tet(tets) = merged.mesh else {
        return Err("the merged mesh has no tetrahedra".to_owned());
    };
    let outside = tets.interfaces();
    let outside = outside.iter().filter(|f| f.outside == OUTSIDE).count() as i64;
    let of_faces = faces.iter().map(|f| f.1);
    let group_of: Vec<u32> = group_of.into_iter().chain(of_faces).collect();
    let theirs = lab.ask("tiles.py", &[out.display().to_string()])?;
    for file in ["pvtu", "msh"] {
        let theirs = &theirs[file];
        let what = |measure: &str| format!("tiles, {file}: {measure}");
        for (measure, ours) in [
            ("vertices", tets.positions().len() as i64),
            ("tetrahedra", tets.tets().len() as i64),
            ("distinct tetrahedra", tets.tets().len() as i64),
            ("boundary faces", outside),
            ("faces of three", 0),
            ("copies that differ", 0),
            ("atoms", atoms),
        ] {
            lab.same(&what(measure), ours, integer(theirs, measure)?);
        }
        for region in [0, 1] {
            let measure = what(&format!("volume of region {region}"));
            let theirs = number(&theirs["volumes"], &region.to_string())?;
            lab.near(&measure, tets.region_volume(region), theirs, 1e-11);
        }
        for (g, group) in (0..).zip(&groups) {
            let ours = group_of.iter().filter(|&&of| of == g).count() as i64;
            let theirs = integer(&theirs["groups"], &group.name)?;
            lab.same(&what(&format!("cells of {}", group.name)), ours, theirs);
        }
        let named = theirs["groups"].as_object().map_or(0, serde_json::Map::len);
        lab.same(&what("groups"), groups.len(), named);
    }
    let [vtk, gmsh] = ["pvtu", "msh"].map(|file| &theirs[file]);
    let lost = integer(vtk, "vertices without one owner")?;
    lab.same("tiles, pvtu: vertices without one owner", 0, lost);
    let nobody = integer(gmsh, "ghosts of nobody")?;
    lab.same("tiles, msh: ghosts of nobody", 0, nobody);
    let there = integer(gmsh, "ghosts")? > 0;
    lab.same("tiles, msh: there are ghosts", true, there);
    let together = integer(gmsh, "opened together")?;
    lab.same(
        "tiles, msh: opened together",
        tets.tets().len() as i64,
        together,
    );
    let told = report["tiles"]["tetrahedra"].as_i64().unwrap_or(0);
    lab.same(
        "tiles: tetrahedra of the report",
        told,
        tets.tets().len() as i64,
    );
    Ok(())
}
