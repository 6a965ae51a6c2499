//! Counts of the larger data set beside the workspace, where there is one.

use std::collections::BTreeSet;
use std::path::Path;

use geom_core::io::ErrorKind;
use geom_core::io::structure::{AltLocs, Format, ReadOptions, ReadReport, read};
use geom_core::structure::{Residue, ResidueKind, Selector};
use geom_core::{Point3, Structure, Vector3};

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
    let best = read(path, &ReadOptions::default()).unwrap_or_else(|e| panic!("{e}"));
    let alternate = promised(validated, "altloc").unwrap();
    assert_eq!(best.report.altlocs > 0, alternate > 0, "{file}: locations");
    assert!(best.report.altlocs <= alternate, "{file}: locations");
    // The lists count the operators of all assemblies.
    if let [name] = report.assemblies.as_slice() {
        let operators = promised(validated, "biomt").unwrap();
        let few = ReadOptions {
            assembly: Some(name.clone()),
            max_atoms: 200_000,
            ..everything()
        };
        match read(path, &few) {
            Ok(whole) => assert_eq!(whole.report.copies, operators, "{file}: operators"),
            Err(error) => assert!(matches!(error.kind, ErrorKind::TooLarge(_)), "{error}"),
        }
    }
}

/// What counts alone do not show.
#[test]
fn odd_files() {
    let Some(folder) = fixtures::shared_or_skip("pdb") else {
        return;
    };
    let (s, report) = read_all(&folder.join("2nwl_opm.pdb.gz"));
    let membrane = report.membrane.unwrap();
    assert_eq!(membrane.dummies, 2 * 2001);
    // The planes of the OPM database are symmetric.
    assert!((membrane.upper + membrane.lower).abs() < 1e-9 && membrane.upper > 10.0);
    assert!(s.residues().iter().all(|r| r.name.as_str() != "DUM"));

    let large = folder.with_file_name("large");
    let (s, _) = read_all(&large.join("4v8r_h36.pdb.gz"));
    assert!(s.chains().iter().any(|c| c.name.as_str().len() == 2));
    assert_eq!(
        s.residues()
            .iter()
            .filter(|r| r.name.as_str() == "MG")
            .count(),
        32
    );

    // Edited rRNA: thirteen nucleotides are numbered 189.
    let (s, _) = read_all(&large.join("30s_from_4v5a.cif.gz"));
    let numbered = |r: &&Residue| r.number == 189 && r.kind == ResidueKind::Polymer;
    let rna = s.chain_residues(0);
    assert_eq!(s.residues()[rna].iter().filter(numbered).count(), 13);

    // Cα atoms only: with residue radii the neighbours overlap.
    let (s, report) = read_all(&large.join("1xi4.pdb.gz"));
    assert_eq!(report.trace_chains, s.chains().len());
    assert!(s.atoms().iter().all(|a| a.radius > 1.9));

    // Operator numbers of four digits: the capsid has the size of a virus.
    let options = ReadOptions {
        assembly: Some("1".to_owned()),
        ..Default::default()
    };
    let few = ReadOptions {
        max_atoms: 1_000_000,
        ..options.clone()
    };
    let error = read(large.join("1m4x.pdb.gz"), &few).unwrap_err();
    assert!(
        error.to_string().contains("16284240 atoms are too many"),
        "{error}"
    );
    let one_atom = ReadOptions {
        select: Some(Selector::parse("A:25").unwrap()),
        ..options.clone()
    };
    let whole = read(large.join("1m4x.pdb.gz"), &one_atom).unwrap();
    assert_eq!(whole.report.copies, 1680);
    let size = whole.structure.center_bounds().extent().max();
    assert!((1500.0..2000.0).contains(&size), "{size} Å");

    // Sixty operators of an mmCIF file.
    let capsid = read(large.join("7cth.cif.gz"), &options).unwrap();
    assert_eq!(capsid.structure.domains().len(), 60);
}

fn read_all(path: &Path) -> (Structure, ReadReport) {
    let read = read(path, &everything()).unwrap_or_else(|e| panic!("{e}"));
    (read.structure, read.report)
}

/// Proteins and ligands of known binding sites: what is which, how many heavy atoms, and where.
#[test]
fn ligands_of_known_sites() {
    let Some(folder) = fixtures::shared_or_skip("pockets") else {
        return;
    };
    let table = std::fs::read_to_string(folder.join("ligands.tsv")).unwrap();
    let mut sites = 0;
    for row in table.lines().skip(1) {
        let cells: Vec<_> = row.split('\t').collect();
        let number = |column: usize| cells[column].parse::<f64>().unwrap();
        let site = format!("{}: {} {}{}", cells[0], cells[3], cells[4], cells[5]);
        let options = ReadOptions {
            hydrogens: false,
            // As the table, which has the first of two locations.
            altlocs: AltLocs::Label('A'),
            ..Default::default()
        };
        let s = read(folder.join(cells[0]), &options).unwrap().structure;
        let atoms_of = |selector: &str| -> Vec<Point3> {
            let selection = s.select(&Selector::parse(selector).unwrap()).unwrap();
            let atoms = selection.atom_ranges(&s).flat_map(|r| &s.atoms()[r]);
            atoms.map(|a| a.position).collect()
        };
        assert_eq!(atoms_of("polymer").len() as f64, number(1), "{site}");
        let ligand = format!("{}:{}/name:{}/ligand", cells[4], cells[5], cells[3]);
        let ligand = atoms_of(&ligand);
        assert_eq!(ligand.len() as f64, number(6), "{site}");
        let sum: Vector3 = ligand.iter().map(|p| p.coords).sum();
        let centroid = Vector3::new(number(7), number(8), number(9));
        let off = (sum / ligand.len() as f64 - centroid).norm();
        assert!(off < 0.05, "{site}: {off} Å");
        sites += 1;
    }
    assert!(sites > 50, "only {sites} sites");
}
