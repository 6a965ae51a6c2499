//! What came of all cases, for people.

use std::fmt::Write as _;

use serde_json::Value;

use super::{METHODS, REGIONS, Rows};
use crate::Outcome;

fn number(row: &Value, key: &str) -> f64 {
    row[key].as_f64().unwrap_or(f64::NAN)
}

fn word<'a>(row: &'a Value, key: &str) -> &'a str {
    row[key].as_str().unwrap_or_default()
}

fn list<'a>(row: &'a Value, key: &str) -> Vec<&'a str> {
    let items = row[key].as_array().into_iter().flatten();
    items.filter_map(Value::as_str).collect()
}

/// The largest or smallest of a figure; a case that died has none.
fn worst(rows: &[&Value], key: &str, f: fn(f64, f64) -> f64) -> f64 {
    rows.iter().map(|r| number(r, key)).fold(f64::NAN, f)
}

/// A case in a line.
pub(super) fn line(row: &Value) -> String {
    let mut out = word(row, "case").to_owned();
    if row["tets"].is_number() {
        out += &format!(
            ": {} tets, {:.1}°–{:.1}°, Joe–Liu {:.3}, edge ratio {:.2}, {} of {} far, topology {}, {:.1} + {:.1} s",
            row["tets"],
            number(row, "min_dihedral"),
            number(row, "max_dihedral"),
            number(row, "joe_liu"),
            number(row, "edge_ratio"),
            row["far_vertices"],
            row["surface_vertices"],
            row["topology"],
            number(row, "mesh_s"),
            number(row, "improve_s"),
        );
    }
    for (name, key) in [("BROKEN", "faults"), ("missed", "misses")] {
        let items = list(row, key);
        if !items.is_empty() {
            out += &format!("  {name}: {}", items.join("; "));
        }
    }
    out
}

/// Results by mesher and region: their worst figures.
fn by_region(rows: &[&Value]) -> String {
    let mut out = "\
| mesher | region | cases | tets | min dihedral | max dihedral | Joe–Liu | edge ratio | vertices within 0.1 h | below a target | broken |
|---|---|---|---|---|---|---|---|---|---|---|
"
    .to_owned();
    for (method, region) in METHODS.iter().flat_map(|m| REGIONS.map(|r| (m, r))) {
        let mut of = rows.to_vec();
        of.retain(|r| r["method"] == *method && r["region"] == region);
        if of.is_empty() {
            continue;
        }
        let on = of
            .iter()
            .map(|r| 1.0 - number(r, "far_vertices") / number(r, "surface_vertices"))
            .fold(f64::NAN, f64::min);
        let tets: u64 = of.iter().filter_map(|r| r["tets"].as_u64()).sum();
        let with = |key| of.iter().filter(|r| !list(r, key).is_empty()).count();
        out += &format!(
            "| {method} | {region} | {} | {:.1} M | {:.1}° | {:.1}° | {:.3} | {:.2} | {:.2} % | {} | {} |\n",
            of.len(),
            tets as f64 / 1e6,
            worst(&of, "min_dihedral", f64::min),
            worst(&of, "max_dihedral", f64::max),
            worst(&of, "joe_liu", f64::min),
            worst(&of, "edge_ratio", f64::max),
            100.0 * on,
            with("misses"),
            with("faults")
        );
    }
    out
}

/// The results that `keys` name, in their order.
fn chosen<'a>(keys: &[String], rows: &'a Rows) -> Vec<&'a Value> {
    keys.iter().filter_map(|k| rows.get(k)).collect()
}

/// How many are broken, below a target, and seen by the independent checker.
fn counts(rows: &[&Value]) -> [usize; 3] {
    let with = |key| rows.iter().filter(|r| !list(r, key).is_empty()).count();
    let checked = rows.iter().filter(|r| r["checked"] == true).count();
    [with("faults"), with("misses"), checked]
}

/// The worst figures by mesher and region, all that falls short, and an error if a mesh is broken.
pub(super) fn summary(keys: &[String], rows: &Rows) -> Outcome {
    let rows = chosen(keys, rows);
    println!("\n{}", by_region(&rows));
    for row in &rows {
        if !list(row, "faults").is_empty() || !list(row, "misses").is_empty() {
            println!("{}", line(row));
        }
    }
    let [broken, missed, checked] = counts(&rows);
    println!(
        "{} cases: {broken} broken, {missed} below a target; {checked} also seen by the independent checker",
        rows.len()
    );
    match broken {
        0 => Ok(()),
        _ => Err(format!("{broken} of {} meshes are broken", rows.len())),
    }
}

/// A page in Markdown: the summary, a line per structure and spacing, and all that falls short.
pub(super) fn page(keys: &[String], rows: &Rows, tets: u64) -> String {
    // The claim and the worst of all come first: who trusts them need not read on.
    let rows = chosen(keys, rows);
    let [broken, missed, checked] = counts(&rows);
    let mut out = format!(
        "\
# Every structure, meshed and audited

`cargo xtask sweep --tets {tets} --table` wrote this page. Each structure is meshed at two spacings by both meshers, inside, outside and on both sides, and improved, all at the default options. Before and after the improvement a mesh must have no crack, no edge or vertex that is not manifold and no inverted or flat tetrahedron; its boundary must be its surface, its volumes must sum to the box, and its components, tunnels and cavities must be those of the labels on the lattice, counted without a mesh. Its quality should reach: dihedral angles from 25° (stuffing) or 20° (dual contouring) to 155°, Joe–Liu 0.3, edge ratio 6, and 99.9 % of the surface vertices within 0.1 spacings of the isosurface.

{} cases: {broken} broken, {missed} below a target; an independent program measured {checked} of them and found the same. The worst of all:

{}
## By structure

The worst of the three regions; tets are those inside. Parts, tunnels and cavities depend on how a mesher joins the values of the lattice.

| structure | atoms | spacing, Å | stuffing: tets | angles | Joe–Liu | parts, tunnels, cavities | dual contouring: tets | angles | Joe–Liu | parts, tunnels, cavities |
|---|---|---|---|---|---|---|---|---|---|---|
",
        rows.len(),
        by_region(&rows)
    );
    // The cases of a structure at a spacing stand together; in the page also its spacings.
    let mut batches: Vec<&[&Value]> = rows
        .chunk_by(|a, b| a["structure"] == b["structure"] && a["spacing"] == b["spacing"])
        .collect();
    batches.sort_by_key(|batch| word(batch[0], "structure"));
    for batch in batches {
        let first = batch[0];
        let _ = write!(
            out,
            "| {} | {} | {}",
            word(first, "structure"),
            first["atoms"],
            first["spacing"]
        );
        for method in METHODS {
            let mut of = batch.to_vec();
            of.retain(|r| r["method"] == method);
            let inside = of.iter().find(|r| r["region"] == "interior");
            let topology = of.iter().find_map(|r| r["topology"].as_array());
            let topology: Vec<String> = topology
                .into_iter()
                .flatten()
                .map(Value::to_string)
                .collect();
            let _ = write!(
                out,
                " | {} | {:.1}°–{:.1}° | {:.2} | {}",
                inside.map_or(&Value::Null, |r| &r["tets"]),
                worst(&of, "min_dihedral", f64::min),
                worst(&of, "max_dihedral", f64::max),
                worst(&of, "joe_liu", f64::min),
                topology.join(", ")
            );
        }
        out += " |\n";
    }
    for (title, key) in [("Broken", "faults"), ("Below a target", "misses")] {
        out += &format!("\n## {title}\n\n");
        let mut of = rows.clone();
        of.retain(|r| !list(r, key).is_empty());
        if of.is_empty() {
            out += "None.\n";
            continue;
        }
        for row in of {
            out += &format!("* {}\n", line(row));
        }
    }
    out
}
