//! Chapter 7 on real data: the Princeton models with their human segmentations, and structures with the
//! ligands that mark their pockets. The data lie beside the workspace; without them these tests say so.

use std::path::Path;

use geom_core::io::structure::{ReadOptions, read};
use geom_core::structure::{Element, ResidueKind};
use geom_core::{Point3, Structure};
use secondfund_ops::PocketOptions;
use secondfund_ops::pockets::{SiteScore, find, site_ranks};

/// What is put into crystals to make them grow, and sugars bound to the surface: no ligands.
const ADDITIVES: [&str; 20] = [
    "GOL", "EDO", "SO4", "PO4", "ACT", "DMS", "PEG", "DIO", "IMD", "BOG", "NAG", "MAN", "BMA",
    "FUC", "CAS", "ACE", "MES", "TRS", "CIT", "FMT",
];

/// The heavy atoms of each ligand of at least six.
fn ligands(structure: &Structure) -> Vec<Vec<Point3>> {
    (0..structure.residues().len())
        .filter(|&r| {
            let residue = structure.residues()[r];
            residue.kind == ResidueKind::Ligand && !ADDITIVES.contains(&residue.name.as_str())
        })
        .map(|r| {
            let atoms = &structure.atoms()[structure.residue_atoms(r)];
            let heavy = atoms.iter().filter(|a| a.element != Element::HYDROGEN);
            heavy.map(|a| a.position).collect::<Vec<_>>()
        })
        .filter(|atoms| atoms.len() >= 6)
        .collect()
}

fn entries(folder: &Path) -> Vec<(String, Structure)> {
    let mut files: Vec<_> = std::fs::read_dir(folder)
        .unwrap()
        .map(|e| e.unwrap().path())
        .filter(|p| p.extension().is_some_and(|e| e == "pdb" || e == "cif"))
        .collect();
    files.sort();
    files
        .iter()
        .map(|path| {
            let name = path.file_stem().unwrap().to_string_lossy().into_owned();
            (name, read(path, &ReadOptions::default()).unwrap().structure)
        })
        .collect()
}

/// The best rank over the ligands, and how many of them are within the first n + 2.
fn summary(scores: &[SiteScore]) -> (usize, usize) {
    let best = scores
        .iter()
        .filter_map(|s| s.rank_by_atom)
        .min()
        .unwrap_or(99);
    let found = scores
        .iter()
        .filter(|s| s.rank_by_atom.is_some_and(|r| r <= scores.len() + 2));
    (best, found.count())
}

#[test]
fn pockets_are_where_the_ligands_are() {
    let Some(folder) = fixtures::shared_or_skip("pockets") else {
        return;
    };
    let options = PocketOptions::default();
    let (mut first, mut third, mut all, mut sites, mut sites_found) = (0, 0, 0, 0, 0);
    for (name, structure) in entries(&folder) {
        let ligands = ligands(&structure);
        if ligands.is_empty() {
            continue;
        }
        let found = find(&structure, &options).unwrap();
        let scores = site_ranks(&found.pockets, &ligands);
        let (best, within) = summary(&scores);
        println!(
            "{name:6} {:5} atoms {} chains {} ligands: best rank {best}, {within} sites by n+2; ranks {:?}; candidates {}; chains {:?}",
            found.atoms,
            structure.chains().len(),
            ligands.len(),
            scores
                .iter()
                .map(|s| s.rank_by_atom.unwrap_or(0))
                .collect::<Vec<_>>(),
            found.candidates,
            found
                .pockets
                .iter()
                .take(4)
                .map(|p| p.chains.len())
                .collect::<Vec<_>>(),
        );
        all += 1;
        first += usize::from(best == 1);
        third += usize::from(best <= 3);
        sites += ligands.len();
        sites_found += within;
    }
    println!("top-1 {first}/{all}, top-3 {third}/{all}, sites within n+2 {sites_found}/{sites}");
    assert!(first as f64 >= 0.75 * all as f64 && third as f64 >= 0.85 * all as f64);
}
