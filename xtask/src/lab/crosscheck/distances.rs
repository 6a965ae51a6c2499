//! Distances along surfaces by the heat method, beside those of potpourri3d (geometry-central), and both beside paths that
//! it straightens.

use geom_core::TriMesh;
use geom_core::io::{View, mesh};
use geom_core::mesh::shapes;
use geom_core::surface::distance::{Heat, HeatOptions};

use super::{Lab, number, text};
use crate::{Outcome, fixtures};

/// Paths per surface; straightening one takes longer than all distances.
const PATHS: usize = 60;

/// The same mesh and time of heating for both, from the first vertex.
pub(super) fn distances(lab: &mut Lab, molecule: &TriMesh) -> Outcome {
    let spot = mesh::read(fixtures::path("spot.ply")).map_err(text)?;
    let mesh::AnyMesh::Tri(spot) = spot.mesh else {
        return Err("spot.ply: no triangles".to_owned());
    };
    let inputs = [
        ("sphere", shapes::icosphere(1.7, 4)),
        ("torus", shapes::torus(5.0, 2.0, 48, 24)),
        ("spot", spot),
        ("molecule", largest(molecule)?),
    ];
    for (name, surface) in &inputs {
        let options = HeatOptions::default();
        let heat = Heat::new(surface, &options).map_err(text)?;
        let ours = heat.from(&[0]).map_err(text)?;
        let file = lab.file(&format!("distances_{name}.ply"));
        mesh::save(&file, &View::from(surface)).map_err(text)?;
        let table = lab.file(&format!("distances_{name}.txt"));
        let lines: Vec<String> = ours.iter().map(f64::to_string).collect();
        std::fs::write(&table, lines.join("\n")).map_err(text)?;
        let [file, table] = [file, table].map(|p| p.display().to_string());
        let asked = [
            file,
            table,
            options.smoothing.to_string(),
            PATHS.to_string(),
        ];
        let theirs = lab.ask("distances.py", &asked)?;

        let mean = ours.iter().sum::<f64>() / ours.len() as f64;
        let what = |measure: &str| format!("{name}: heat distance, {measure}");
        lab.near(&what("mean"), mean, number(&theirs, "mean")?, 0.01);
        let apart = number(&theirs, "apart")?;
        lab.row(
            &what("mean difference"),
            "0",
            &format!("{:.2} %", 100.0 * apart),
            "1 % of the mean",
            apart < 0.01,
        );
        // Both are held against the same paths. Ours has another constant: at the source itself, where theirs is zero, the
        // heat method is least right.
        let [own, other] = ["our error", "their error"].map(|key| number(&theirs, key));
        let (own, other) = (own?, other?);
        let [shown, shown_b] = [own, other].map(|e| format!("{:.2} %", 100.0 * e));
        lab.row(
            &what("error against paths"),
            &shown,
            &shown_b,
            "1 % more at most",
            own < other + 0.01,
        );
    }
    Ok(())
}

/// The component with most triangles: a molecule may have cavities, to which no path leads.
fn largest(surface: &TriMesh) -> Result<TriMesh, String> {
    let parts = surface.components().into_iter();
    parts
        .max_by_key(|part| part.triangles().len())
        .ok_or_else(|| "the molecule has no surface".to_owned())
}
