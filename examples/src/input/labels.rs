//! Which atom, residue and chain lie nearest to the points of a mesh, as fields of files and as colours.

use std::collections::BTreeSet;
use std::path::Path;

use clap::{Args, ValueEnum};
use geom_core::io::{self, view::View as Fields};
use geom_core::search::nearest::{NearestError, PointTree};
use geom_core::{Point3, Structure};
use serde::Serialize;

use crate::input::source::Source;
use crate::picture::{ColorMap, Rgb, Scale};
use crate::products::{Coloring, GOLD};

/// How a surface of atoms looks.
#[derive(Clone, Debug, Args, Serialize)]
#[command(next_help_heading = "Output")]
pub struct LabelArgs {
    /// Structures: what the nearest atom gives the surface its colour by
    #[arg(long, value_enum, default_value_t)]
    pub color: ColorBy,
}

/// The structure that a surface is around, its file, and how the surface is to look.
#[derive(Clone, Copy)]
pub struct Around<'a> {
    pub(crate) structure: &'a Structure,
    pub(crate) file: &'a Path,
    pub(crate) color: ColorBy,
}

impl LabelArgs {
    /// Of a source that is a structure.
    pub fn around<'a>(&self, source: &'a Source, file: &'a Path) -> Option<Around<'a>> {
        let around = |structure| Around {
            structure,
            file,
            color: self.color,
        };
        source.structure().map(around)
    }
}

/// What of the nearest atom gives the colour.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum ColorBy {
    /// Its chain; a single chain is golden
    #[default]
    Chain,
    /// The place of its residue in its chain, from dark blue over green to yellow
    Residue,
    /// Its element: carbon grey, nitrogen blue, oxygen red, sulfur yellow, phosphorus orange, others green
    Element,
}

/// The labels of some points.
pub struct Labels<'a> {
    structure: &'a Structure,
    /// Per point the place of the nearest atom in the structure, from 0.
    atom: Vec<u32>,
    /// Its residue's number in the file.
    residue: Vec<i32>,
    /// The place of its chain in the structure, from 0.
    chain: Vec<u32>,
    /// The place of its residue in the chain, 0 … 1.
    along: Vec<f64>,
}

impl<'a> Labels<'a> {
    /// The atoms nearest to some points, and what they belong to.
    pub fn of(structure: &'a Structure, points: &[Point3]) -> Result<Self, NearestError> {
        let centers: Vec<_> = structure.atoms().iter().map(|a| a.position).collect();
        let queries: Vec<[f64; 3]> = points.iter().map(|p| [p.x, p.y, p.z]).collect();
        let near = PointTree::of_positions(&centers)?.nearest_to_all(&queries, 1)?;
        let atom: Vec<u32> = near.iter().map(|n| n[0].index).collect();

        // Of each atom: the number of its residue, its chain, and how far along it lies.
        let mut owner = vec![(0, 0, 0.0); structure.atoms().len()];
        for chain in 0..structure.chains().len() {
            let residues = structure.chain_residues(chain);
            let last = (residues.len().max(2) - 1) as f64;
            for (place, residue) in residues.enumerate() {
                let number = structure.residues()[residue].number;
                let label = (number, chain as u32, place as f64 / last);
                owner[structure.residue_atoms(residue)].fill(label);
            }
        }
        let owners = || atom.iter().map(|&a| owner[a as usize]);
        Ok(Self {
            structure,
            residue: owners().map(|o| o.0).collect(),
            chain: owners().map(|o| o.1).collect(),
            along: owners().map(|o| o.2).collect(),
            atom,
        })
    }

    /// Per point the place of the nearest chain in the structure.
    pub fn chains(&self) -> &[u32] {
        &self.chain
    }

    /// Adds the fields `atom`, `residue` and `chain` to the points of a mesh.
    pub fn fields<'b>(&'b self, view: Fields<'b>) -> Result<Fields<'b>, io::Error> {
        view.point_field("atom", &self.atom)?
            .point_field("residue", &self.residue)?
            .point_field("chain", &self.chain)
    }

    /// One colour per point.
    fn colors(&self, by: ColorBy) -> Vec<Rgb> {
        match by {
            ColorBy::Chain if self.structure.chains().len() < 2 => vec![GOLD; self.chain.len()],
            ColorBy::Chain => self.chain.iter().map(|&c| chain_color(c)).collect(),
            ColorBy::Residue => {
                let color = |&t: &f64| ColorMap::Viridis.at(t);
                self.along.iter().map(color).collect()
            }
            ColorBy::Element => {
                let color =
                    |&a: &u32| element_color(self.structure.atoms()[a as usize].element.symbol());
                self.atom.iter().map(color).collect()
            }
        }
    }

    /// One colour per point, and what the colours stand for; a single chain is golden and needs no words.
    pub fn coloring(&self, by: ColorBy) -> Coloring {
        Coloring {
            colors: self.colors(by),
            scale: (by == ColorBy::Residue)
                .then(|| Scale::new(ColorMap::Viridis, [0.0, 1.0], "along the chain")),
            legend: match by {
                ColorBy::Chain if self.structure.chains().len() > 1 => self.legend_of_chains(),
                ColorBy::Element => self.legend_of_elements(),
                ColorBy::Chain | ColorBy::Residue => Vec::new(),
            },
        }
    }

    /// The chains that are nearest to some point. Copies of one in an assembly have its name and other colours.
    fn legend_of_chains(&self) -> Vec<(Rgb, String)> {
        let seen: BTreeSet<u32> = self.chain.iter().copied().collect();
        let entry = |c: u32| {
            let name = self.structure.chains()[c as usize].name.as_str();
            let shown = if name.trim().is_empty() { "?" } else { name };
            (chain_color(c), format!("chain {shown}"))
        };
        seen.into_iter().map(entry).collect()
    }

    /// The elements that are nearest to some point, those of one colour together.
    fn legend_of_elements(&self) -> Vec<(Rgb, String)> {
        let atoms = self.structure.atoms();
        let symbols = self
            .atom
            .iter()
            .map(|&a| atoms[a as usize].element.symbol());
        let mut entries: Vec<(Rgb, String)> = Vec::new();
        for symbol in symbols.collect::<BTreeSet<_>>() {
            let color = element_color(symbol);
            match entries.iter_mut().find(|e| e.0 == color) {
                Some((_, names)) => *names = format!("{names}, {symbol}"),
                None => entries.push((color, symbol.to_owned())),
            }
        }
        entries
    }
}

fn chain_color(chain: u32) -> Rgb {
    CHAINS[chain as usize % CHAINS.len()]
}

const CHAINS: [Rgb; 10] = [
    [114, 158, 206],
    [255, 176, 98],
    [124, 190, 120],
    [232, 124, 118],
    [172, 146, 202],
    [178, 138, 120],
    [232, 158, 204],
    [168, 168, 168],
    [206, 204, 108],
    [122, 204, 218],
];

/// Softened versions of the usual colours.
fn element_color(symbol: &str) -> Rgb {
    match symbol {
        "H" => [240, 240, 240],
        "C" => [176, 176, 176],
        "N" => [98, 128, 226],
        "O" => [226, 96, 88],
        "S" => [232, 208, 84],
        "P" => [240, 156, 70],
        _ => [110, 200, 120],
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use geom_core::structure::Element;

    #[test]
    fn the_nearest_atom_gives_the_labels() {
        let centers = [[0.0, 0.0, 0.0], [4.0, 0.0, 0.0]].map(|p| (Point3::from(p), 1.5));
        let structure = Structure::of_spheres(centers);
        let points = [[1.0, 1.0, 0.0], [3.0, 0.0, 1.0], [9.0, 0.0, 0.0]].map(Point3::from);
        let labels = Labels::of(&structure, &points).unwrap();
        assert_eq!(labels.atom, [0, 1, 1]);
        assert_eq!(labels.colors(ColorBy::Chain), [GOLD; 3]);
        assert_eq!(
            labels.colors(ColorBy::Element),
            [element_color(Element::UNKNOWN.symbol()); 3]
        );
        assert_eq!(labels.along, [0.0; 3]);
    }
}
