//! Counts of the larger data set beside the workspace, where there is one.

use std::collections::BTreeSet;
use std::path::Path;

use geom_core::Structure;
use geom_core::io::structure::{AltLocs, Format, ReadOptions, ReadReport, read};

/// Everything that stands in the file.
fn everything() -> ReadOptions {
    ReadOptions {
        altlocs: AltLocs::All,
        waters: true,
        ..Default::default()
    }
}

/// The number after `key=` in a manifest's column "validated".
fn promised(validated: &str, key: &str) -> Option<usize> {
    let (_, rest) = validated.split_once(&format!("{key}="))?;
    rest.split(' ').next()?.parse().ok()
}

fn chains(s: &Structure) -> usize {
    s.chains()
        .iter()
        .map(|c| c.name)
        .collect::<BTreeSet<_>>()
        .len()
}

#[test]
fn counts_of_the_manifests() {
    let mut checked = 0;
    for folder in ["pdb", "large", "pockets", "corresp"] {
        let Some(folder) = fixtures::shared_or_skip(folder) else {
            return;
        };
        let manifest = std::fs::read_to_string(folder.join("MANIFEST.tsv")).unwrap();
        for row in manifest.lines().skip(1) {
            let mut cells = row.split('\t');
            let (name, validated) = (cells.next().unwrap(), cells.nth(1).unwrap_or_default());
            if let Some(atoms) = promised(validated, "atoms(first model)") {
                check(&folder.join(name), validated, atoms);
                checked += 1;
            }
        }
    }
    assert!(checked > 50, "only {checked} files");
}

fn check(path: &Path, validated: &str, atoms: usize) {
    let file = path.display();
    let (s, report) = read_all(path);
    let dummies = report.membrane.map_or(0, |m| m.dummies);
    assert_eq!(s.atoms().len() + dummies, atoms, "{file}: atoms");
    assert_eq!(
        promised(validated, "models"),
        Some(report.models),
        "{file}: models"
    );
    let hydrogens = s.atoms().iter().filter(|a| a.element.0 == 1).count();
    assert_eq!(
        promised(validated, "H"),
        Some(hydrogens),
        "{file}: hydrogens"
    );
    let unnamed = usize::from(dummies > 0 && chains(&s) < promised(validated, "chains").unwrap());
    assert_eq!(
        promised(validated, "chains"),
        Some(chains(&s) + unnamed),
        "{file}: chains"
    );
    if report.format != Format::Pqr {
        let hetero = s.atoms().iter().filter(|a| a.hetero).count() + dummies;
        assert_eq!(
            promised(validated, "hetatm"),
            Some(hetero),
            "{file}: hetero atoms"
        );
    }
    assert_eq!(report.unknown_elements, 0, "{file}: elements");
}

fn read_all(path: &Path) -> (Structure, ReadReport) {
    let read = read(path, &everything()).unwrap_or_else(|e| panic!("{e}"));
    (read.structure, read.report)
}
