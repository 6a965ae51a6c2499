//! Pockets of structures whose ligands are known and left out: ranks by our burial and by the thesis's own method, and how
//! much of each site the outlines hold, with and without points between two probes.

use std::path::Path;
use std::time::Instant;

use gauss_density::{Levels, Model, PointSampler};
use geom_core::io::structure::{ReadOptions, read};
use geom_core::search::nearest::PointTree;
use geom_core::structure::{Element, ResidueKind};
use geom_core::{Cpu, ImplicitField, Point3, Run, Structure, TriMesh};
use secondfund_ops::PocketOptions;
use secondfund_ops::options::{OutlineOptions, OutlineSource, PatchOptions};
use secondfund_ops::pockets::{
    Outline, Pocket, concave_patches, distance_to_ligand, find, outline, site_ranks,
};

use super::text;
use crate::{Outcome, fixtures};

/// What is put into crystals to make them grow, and sugars bound to the surface: no ligands.
const ADDITIVES: [&str; 20] = [
    "GOL", "EDO", "SO4", "PO4", "ACT", "DMS", "PEG", "DIO", "IMD", "BOG", "NAG", "MAN", "BMA",
    "FUC", "CAS", "ACE", "MES", "TRS", "CIT", "FMT",
];
/// Residues and triangles within this distance of a ligand's atom are its site, Å.
const CONTACT: f64 = 4.5;
/// Lattice of the surfaces, Å.
const SPACING: f64 = 1.2;
/// Decays of the surfaces: ours, and the thesis's, which is smooth.
const DECAY: f64 = 0.5;
const SMOOTH: f64 = 0.15;

/// The heavy atoms of each ligand of at least six, as residues.
fn ligands(structure: &Structure) -> Vec<usize> {
    let heavy = |r: usize| {
        let atoms = &structure.atoms()[structure.residue_atoms(r)];
        atoms
            .iter()
            .filter(|a| a.element != Element::HYDROGEN)
            .count()
    };
    (0..structure.residues().len())
        .filter(|&r| {
            let residue = structure.residues()[r];
            let additive = ADDITIVES.contains(&residue.name.as_str());
            residue.kind == ResidueKind::Ligand && !additive && heavy(r) >= 6
        })
        .collect()
}

fn atoms_of(structure: &Structure, residue: usize) -> Vec<Point3> {
    let atoms = &structure.atoms()[structure.residue_atoms(residue)];
    let heavy = atoms.iter().filter(|a| a.element != Element::HYDROGEN);
    heavy.map(|a| a.position).collect()
}

fn surface(structure: &Structure, decay: f64) -> Result<TriMesh, String> {
    let polymer = structure.of_kind(ResidueKind::Polymer);
    let levels = Levels {
        decay,
        ..Levels::default()
    };
    let model = Model::uniform(&polymer, &levels).map_err(text)?;
    let options = gauss_density::Options {
        spacing: SPACING,
        ..Default::default()
    };
    let sampled = gauss_density::sample_band(&model, &options, Run::on(&Cpu)).map_err(text)?;
    let contour = dual_contour::Options::default();
    let made = dual_contour::surface(&sampled.grid, None, &contour, Run::on(&Cpu)).map_err(text)?;
    let largest = made.mesh.components().into_iter().next();
    largest.ok_or_else(|| "no surface".to_owned())
}

/// The density of a ligand's atoms (Eq. 7.27) at the vertices of a surface.
fn density(
    structure: &Structure,
    residues: &[usize],
    surface: &TriMesh,
) -> Result<Vec<f64>, String> {
    let starts = structure.residue_starts();
    let of = |a: usize| starts.partition_point(|&s| s as usize <= a) - 1;
    let ligand = structure.filter(|a| residues.contains(&of(a)));
    let levels = Levels {
        decay: SMOOTH,
        ..Levels::default()
    };
    let model = Model::uniform(&ligand, &levels).map_err(text)?;
    let sampler = PointSampler::new(&model, gauss_density::Cutoff::default()).map_err(text)?;
    Ok(surface
        .positions()
        .iter()
        .map(|p| sampler.value(p))
        .collect())
}

/// Structures whose best rank is 1, and at most 3; sites within n + 2 by atoms, and by centroids.
#[derive(Clone, Copy, Debug, Default)]
struct Ranks {
    first: usize,
    third: usize,
    sites: usize,
    centroids: usize,
}

impl Ranks {
    fn add(&mut self, pockets: &[Pocket], ligands: &[Vec<Point3>]) {
        let scores = site_ranks(pockets, ligands);
        let best = scores.iter().filter_map(|s| s.rank_by_atom).min();
        self.first += usize::from(best == Some(1));
        self.third += usize::from(best.is_some_and(|r| r <= 3));
        let within = |rank: Option<usize>| rank.is_some_and(|r| r <= scores.len() + 2);
        self.sites += scores.iter().filter(|s| within(s.rank_by_atom)).count();
        self.centroids += scores.iter().filter(|s| within(s.rank_by_centroid)).count();
    }
}

/// Sums over sites that were found: the share of the site's residues that line the pocket, the share of those that line it
/// and belong to the site, and the same of the area of triangles.
#[derive(Clone, Copy, Debug, Default)]
struct Overlap {
    sites: f64,
    sums: [f64; 5],
}

impl Overlap {
    fn add(&mut self, residues: [f64; 2], areas: [f64; 3]) {
        self.sites += 1.0;
        let all = [residues[0], residues[1], areas[0], areas[1], areas[2]];
        self.sums.iter_mut().zip(all).for_each(|(s, x)| *s += x);
    }

    fn means(&self) -> String {
        let cells = self
            .sums
            .map(|s| format!("{:8.2}", s / self.sites.max(1.0)));
        cells.join(" ")
    }
}

/// Residues within [`CONTACT`] of points, of the polymer.
fn residues_near(
    structure: &Structure,
    points: &[Point3],
    reach: f64,
) -> Result<Vec<bool>, String> {
    let tree = PointTree::of_positions(points).map_err(text)?;
    let near = |r: usize| {
        structure.residues()[r].kind == ResidueKind::Polymer
            && structure.residue_atoms(r).any(|a| {
                let p = structure.atoms()[a].position;
                let found = tree.nearest(&[p.x, p.y, p.z], 1);
                found.first().is_some_and(|n| n.distance <= reach)
            })
    };
    Ok((0..structure.residues().len()).map(near).collect())
}

/// How much of the first outside of the second is missing: shares of both, and of their union, that both hold.
fn shares(site: &[bool], found: &[bool], weight: impl Fn(usize) -> f64) -> [f64; 3] {
    let sum = |keep: &dyn Fn(usize) -> bool| -> f64 {
        (0..site.len()).filter(|&i| keep(i)).map(&weight).sum()
    };
    let both = sum(&|i| site[i] && found[i]);
    let over = |all: f64| if all > 0.0 { both / all } else { 0.0 };
    [
        over(sum(&|i| site[i])),
        over(sum(&|i| found[i])),
        over(sum(&|i| site[i] || found[i])),
    ]
}

/// Adds what a pocket and its outline hold of a ligand's site.
fn overlap(
    structure: &Structure,
    surface: &TriMesh,
    ligand: &[Point3],
    (pocket, outline): (&Pocket, &Outline),
    to: &mut Overlap,
) -> Outcome {
    let site = residues_near(structure, ligand, CONTACT)?;
    let mut lining = vec![false; structure.residues().len()];
    pocket
        .residues
        .iter()
        .for_each(|&r| lining[r as usize] = true);
    let tree = PointTree::of_positions(ligand).map_err(text)?;
    let count = surface.triangles().len();
    let near = |t: usize| {
        let [a, b, c] = surface.corners(t).map(|p| p.coords);
        let p = (a + b + c) / 3.0;
        let found = tree.nearest(&[p.x, p.y, p.z], 1);
        found.first().is_some_and(|n| n.distance <= CONTACT)
    };
    let of_ligand: Vec<bool> = (0..count).map(near).collect();
    let mut outlined = vec![false; count];
    outline
        .triangles
        .iter()
        .for_each(|&t| outlined[t as usize] = true);
    let [recall, precision, _] = shares(&site, &lining, |_| 1.0);
    let areas = shares(&of_ligand, &outlined, |t| {
        surface.doubled_area_normal(t).norm()
    });
    to.add([recall, precision], areas);
    Ok(())
}

/// The thesis's own method.
#[derive(Clone, Copy, Debug, Default)]
struct Literal {
    /// The most concave patch first, and that with the highest density of the ligand.
    blind: Ranks,
    with_ligand: Ranks,
    /// Structures that have a patch of negative mean curvature.
    with_patches: usize,
}

#[derive(Default)]
struct Table {
    structures: usize,
    sites: usize,
    ours: Ranks,
    /// With two modes in four groups as printed, and with ten in forty.
    literal: [Literal; 2],
    overlaps: [Overlap; 2],
    seconds: [f64; 3],
}

impl Table {
    fn add(&mut self, structure: &Structure) -> Outcome {
        let residues = ligands(structure);
        if residues.is_empty() {
            return Ok(());
        }
        let known: Vec<Vec<Point3>> = residues.iter().map(|&r| atoms_of(structure, r)).collect();
        self.structures += 1;
        self.sites += known.len();
        let start = Instant::now();
        let found = find(structure, &PocketOptions::default())
            .map_err(text)?
            .pockets;
        self.seconds[0] += start.elapsed().as_secs_f64();
        self.ours.add(&found, &known);
        let skin = surface(structure, DECAY)?;
        for (source, (sums, seconds)) in [OutlineSource::Patches, OutlineSource::default()]
            .into_iter()
            .zip(self.overlaps.iter_mut().zip(&mut self.seconds[1..]))
        {
            let options = OutlineOptions {
                source,
                ..OutlineOptions::default()
            };
            let start = Instant::now();
            let outlines =
                outline(&skin, structure, &found, &options, Run::on(&Cpu)).map_err(text)?;
            *seconds += start.elapsed().as_secs_f64();
            for ligand in &known {
                let hit = |p: &&Pocket| distance_to_ligand(&p.center, ligand) <= 4.0;
                let Some(pocket) = found.iter().find(hit) else {
                    continue;
                };
                let pair = (pocket, &outlines[pocket.rank - 1]);
                overlap(structure, &skin, ligand, pair, sums)?;
            }
        }
        self.add_literal(structure, &residues, &known)
    }

    fn add_literal(
        &mut self,
        structure: &Structure,
        residues: &[usize],
        known: &[Vec<Point3>],
    ) -> Outcome {
        let smooth = surface(structure, SMOOTH)?;
        let field = density(structure, residues, &smooth)?;
        let patches =
            |options: PatchOptions, field: Option<&[f64]>| -> Result<Vec<Pocket>, String> {
                let found = concave_patches(&smooth, structure, field, &options, Run::on(&Cpu));
                Ok(found.map_err(text)?.into_iter().map(|p| p.0).collect())
            };
        let literal = PatchOptions::default();
        let fine = PatchOptions {
            modes: 10,
            groups: 40,
            ..literal
        };
        for (row, options) in self.literal.iter_mut().zip([literal, fine]) {
            let blind = patches(options, None)?;
            row.with_patches += usize::from(!blind.is_empty());
            row.blind.add(&blind, known);
            row.with_ligand.add(&patches(options, Some(&field))?, known);
        }
        Ok(())
    }

    fn print(&self) {
        let row = |name: &str, r: &Ranks| {
            println!(
                "{name:40} {:3}/{n} {:3}/{n} {:4}/{s} {:4}/{s}",
                r.first,
                r.third,
                r.sites,
                r.centroids,
                n = self.structures,
                s = self.sites
            );
        };
        println!(
            "{:40} {:>6} {:>6} {:>7} {:>7}",
            "", "top-1", "top-3", "n+2", "DCC 12"
        );
        row("burial", &self.ours);
        for (name, found) in ["2 modes, 4 groups", "10 modes, 40 groups"]
            .iter()
            .zip(&self.literal)
        {
            println!(
                "thesis, {name}: {} have a patch of negative mean curvature",
                found.with_patches
            );
            row("  the most concave first", &found.blind);
            row("  ranked by the ligand itself", &found.with_ligand);
        }
        println!(
            "Sites found, means of {}: shares of the site's residues that line the pocket and of those that are the site's;",
            self.overlaps[0].sites
        );
        println!(
            "of the site's area in the outline, of the outline's in the site, and of what either holds (Jaccard)"
        );
        for (name, (overlap, seconds)) in ["patches of e^-H", "points between two probes"]
            .iter()
            .zip(self.overlaps.iter().zip(&self.seconds[1..]))
        {
            println!("{name:40} {}   {seconds:.0} s", overlap.means());
        }
        println!("finding {:.1} s", self.seconds[0]);
    }
}

/// Prints the table.
pub(super) fn run() -> Outcome {
    let Some(folder) = fixtures::shared("pockets") else {
        println!("  pockets: not at hand");
        return Ok(());
    };
    println!(
        "Pockets where ligands are known: ranks within 4 Å of an atom, sites within n + 2, and within 12 Å of the centroid"
    );
    let mut table = Table::default();
    for path in super::sorted(&folder)? {
        let is = |kind: &str| path.extension().is_some_and(|e| e == kind);
        if is("pdb") || is("cif") {
            table.add(&structure(&path)?)?;
        }
    }
    table.print();
    Ok(())
}

fn structure(path: &Path) -> Result<Structure, String> {
    let read = read(path, &ReadOptions::default());
    Ok(read
        .map_err(|e| format!("{}: {e}", path.display()))?
        .structure)
}
