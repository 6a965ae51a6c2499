//! What a program says when it is done: of the numbers in `report.json`, those that its user would look up
//! first, and what should make him look twice.

use serde_json::{Map, Value};

use crate::products::{brief, grouped};

/// Atoms left out, elements and angles, one line each; then the warnings.
pub fn lines(notes: &Map<String, Value>) -> Vec<String> {
    let warned = warnings(notes).into_iter().map(|w| format!("warning: {w}"));
    // What a run of its own would say of a part.
    let parts = notes.iter().filter_map(|(part, of_part)| {
        let mut of_part = of_part.as_object()?.clone();
        // The surface is that of the whole run.
        of_part
            .get_mut("counts")?
            .as_object_mut()?
            .remove("surface_triangles");
        Some(format!("{part}: {}", elements(&of_part)?))
    });
    atoms(notes)
        .into_iter()
        .chain(elements(notes))
        .chain(parts)
        .chain(correspondence(notes))
        .chain(warned)
        .collect()
}

/// `2,345 atoms; left out: 120 of waters, 35 of other locations`.
fn atoms(notes: &Map<String, Value>) -> Option<String> {
    let read = notes.get("structure")?;
    let left_out: Vec<String> = [
        ("altlocs", "of other locations"),
        ("hydrogens", "hydrogens"),
        ("waters", "of waters"),
        ("ions", "of ions"),
        ("ligands", "of ligands"),
        ("unselected", "not selected"),
    ]
    .iter()
    .filter_map(|(key, what)| Some(format!("{} {what}", counted(&read[*key])?)))
    .collect();
    let atoms = if read["atoms"] == 1 { "atom" } else { "atoms" };
    let mut line = format!("{} {atoms}", counted(&read["atoms"])?);
    if !left_out.is_empty() {
        line += &format!("; left out: {}", left_out.join(", "));
    }
    Some(line)
}

/// `103,342 tetrahedra, 9,880 triangles of the surface, dihedral angles from 25.6° to 141.2°`.
fn elements(notes: &Map<String, Value>) -> Option<String> {
    let counts = notes.get("counts")?;
    let mut line: Vec<String> = [
        ("tetrahedra", "tetrahedra"),
        ("surface_triangles", "triangles of the surface"),
        ("triangles", "triangles"),
        ("quads", "quads"),
        ("irregular", "irregular vertices"),
        ("elements", "elements"),
        ("t_junctions", "T-junctions"),
        ("patches", "patches"),
        ("functions", "functions"),
        ("segments", "segments"),
        ("pockets", "pockets"),
        ("remaining_atoms", "atoms remain"),
    ]
    .iter()
    .filter_map(|(key, what)| Some(format!("{} {what}", counted(&counts[*key])?)))
    .collect();
    if line.is_empty() {
        return None;
    }
    let quality = notes.get("quality").unwrap_or(&Value::Null);
    let quality = quality.get("after").unwrap_or(quality);
    let angle = |key: &str, end: &str| quality["all"][key][end].as_f64();
    if let (Some(low), Some(high)) = (angle("min_dihedral", "min"), angle("max_dihedral", "max")) {
        line.push(format!("dihedral angles from {low:.1}° to {high:.1}°"));
    }
    if let Some(low) = quality["min_angle_deg"].as_f64() {
        line.push(format!("angles from {low:.1}°"));
    }
    if let Some(jacobian) = notes.get("scaled_jacobian")
        && let (Some(low), Some(mean)) = (jacobian["min"].as_f64(), jacobian["mean"].as_f64())
    {
        line.push(format!(
            "scaled Jacobian {} at least, {} in the mean",
            brief(low),
            brief(mean)
        ));
    }
    Some(line.join(", "))
}

/// `the correspondence is good, coverage 0.98, 0.0 % without a match, distance of the shapes 0.12`.
fn correspondence(notes: &Map<String, Value>) -> Option<String> {
    let found = notes.get("correspondence")?;
    let number = |key: &str| found[key].as_f64();
    let mut line = format!(
        "the correspondence is {}, coverage {:.2}, {:.1} % without a match",
        found["verdict"].as_str()?,
        number("coverage")?,
        100.0 * number("unmatched")?
    );
    if let Some(distance) = notes.get("distance").and_then(Value::as_f64) {
        line += &format!(", distance of the shapes {}", brief(distance));
    }
    Some(line)
}

fn warnings(notes: &Map<String, Value>) -> Vec<String> {
    let read = notes.get("structure").unwrap_or(&Value::Null);
    let odd = [
        (
            "zero_radii",
            "atoms have radius 0 and are hardly seen by the density; --min-radius or --radii elements gives them one",
        ),
        ("unknown_elements", "atoms are of unknown elements"),
        (
            "trace_chains",
            "chains are traces of one atom per residue, which got the residue's radius",
        ),
    ];
    let counts = odd
        .into_iter()
        .filter_map(|(key, what)| Some(format!("{} {what}", counted(&read[key])?)));
    let matched = notes.get("correspondence").unwrap_or(&Value::Null);
    let advice = notes.get("advice").unwrap_or(&Value::Null);
    let said = [read, matched, advice].into_iter();
    let said = said.flat_map(|of| of["warnings"].as_array().into_iter().flatten());
    let said = said.filter_map(|w| Some(w.as_str()?.to_owned()));
    let missed = notes.get("quality").and_then(missed);
    let surface = notes.get("surface").unwrap_or(&Value::Null);
    let crossings = counted(&surface["crossing_pairs"])
        .map(|n| format!("{n} pairs of triangles of the surface cross"));
    counts.chain(said).chain(missed).chain(crossings).collect()
}

/// How many tetrahedra an improvement has left short of its goals.
fn missed(quality: &Value) -> Option<String> {
    let counts = quality["unmet"]["counts"].as_array()?;
    let sum: u64 = counts.iter().filter_map(|cause| cause[1].as_u64()).sum();
    (sum > 0).then(|| {
        let sum = grouped(sum as usize);
        format!("{sum} tetrahedra do not meet the goals (quality.unmet in report.json says why)")
    })
}

/// A number of things, unless there are none.
fn counted(value: &Value) -> Option<String> {
    let number = value.as_u64().filter(|&n| n > 0)?;
    Some(grouped(number as usize))
}
