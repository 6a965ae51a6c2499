//! Which atom, residue and chain lie nearest to the points of a mesh, as fields of files and as colours.

use std::collections::BTreeSet;
use std::path::Path;

use clap::{Args, ValueEnum};
use geom_core::io::{self, view::View as Fields};
use geom_core::search::nearest::{NearestError, PointTree};
use geom_core::structure::Transform;
use geom_core::{Aabb, Point3, Structure};
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
    /// The place of its copy among those of an assembly, from 0; empty where there is one.
    copy: Vec<u32>,
}

impl<'a> Labels<'a> {
    /// Per point the place of the nearest atom in the structure, from 0.
    pub fn atoms(&self) -> &[u32] {
        &self.atom
    }

    /// Per point the place of its residue in the chain, 0 … 1.
    pub fn along(&self) -> &[f64] {
        &self.along
    }

    /// Per point the place of its copy among those of an assembly, from 0; empty where there is one.
    pub fn copies(&self) -> &[u32] {
        &self.copy
    }

    /// The atoms nearest to some points, and what they belong to.
    pub fn of(structure: &'a Structure, points: &[Point3]) -> Result<Self, NearestError> {
        let centers: Vec<_> = structure.atoms().iter().map(|a| a.position).collect();
        let queries: Vec<[f64; 3]> = points.iter().map(|p| [p.x, p.y, p.z]).collect();
        let near = PointTree::of_positions(&centers)?.nearest_to_all(&queries, 1)?;
        let atom: Vec<u32> = near.iter().map(|n| n[0].index).collect();
        Ok(Self::named(structure, atom, Vec::new()))
    }

    /// The same around copies of a structure at some places: the atom of the copy that lies nearest.
    pub fn of_copies(
        structure: &'a Structure,
        places: &[Transform],
        points: &[Point3],
    ) -> Result<Self, NearestError> {
        let near = nearest_copies(structure, places, points)?;
        let copy = match places {
            [_] => Vec::new(),
            _ => near.iter().map(|n| n[0]).collect(),
        };
        let atom = near.iter().map(|n| n[1]).collect();
        Ok(Self::named(structure, atom, copy))
    }

    /// What some atoms belong to.
    fn named(structure: &'a Structure, atom: Vec<u32>, copy: Vec<u32>) -> Self {
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
        Self {
            structure,
            residue: owners().map(|o| o.0).collect(),
            chain: owners().map(|o| o.1).collect(),
            along: owners().map(|o| o.2).collect(),
            atom,
            copy,
        }
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

    /// The same for good, with the field `copy` around an assembly.
    pub fn into_fields<'b>(self, view: Fields<'b>) -> Result<Fields<'b>, io::Error> {
        let mut view = view
            .point_field("atom", self.atom)?
            .point_field("residue", self.residue)?
            .point_field("chain", self.chain)?;
        if !self.copy.is_empty() {
            view = view.point_field("copy", self.copy)?;
        }
        Ok(view)
    }

    /// One colour per point.
    pub fn colors(&self, by: ColorBy) -> Vec<Rgb> {
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

/// Per point the copy and the atom nearest to it. Only atoms around the points are made, in as wide a box as it takes.
fn nearest_copies(
    structure: &Structure,
    places: &[Transform],
    points: &[Point3],
) -> Result<Vec<[u32; 2]>, NearestError> {
    let mut found = vec![[0, 0]; points.len()];
    let mut open: Vec<usize> = (0..points.len()).collect();
    let unit = Aabb::of_points(structure.atoms().iter().map(|a| &a.position));
    let all = structure.atoms().len() * places.len();
    let mut reach = FIRST_REACH;
    while !open.is_empty() && all > 0 {
        let region = Aabb::of_points(open.iter().map(|&i| &points[i])).inflated(reach);
        let (mut names, mut centers) = (Vec::new(), Vec::new());
        for (copy, place) in (0..).zip(places) {
            let middle = place.apply(&unit.center());
            // Of any affine map: how far the corners of the box go.
            let half = place.rotation.abs() * unit.extent() * 0.5;
            let apart = |k: usize| {
                middle[k] - half[k] > region.max[k] || middle[k] + half[k] < region.min[k]
            };
            if (0..3).any(apart) {
                continue;
            }
            for (atom, center) in
                (0..).zip(structure.atoms().iter().map(|a| place.apply(&a.position)))
            {
                if region.contains(&center) {
                    names.push([copy, atom]);
                    centers.push(center);
                }
            }
        }
        if !centers.is_empty() {
            let tree = PointTree::of_positions(&centers)?;
            let queries: Vec<[f64; 3]> = open.iter().map(|&i| points[i].into()).collect();
            let near = tree.nearest_to_all(&queries, 1)?;
            // What is farther than the box reaches beyond the points may have a nearer one outside.
            let is_sure = |distance: f64| distance <= reach || centers.len() == all;
            let mut left = Vec::new();
            let mut farthest = 0.0f64;
            for (near, i) in near.iter().zip(open) {
                found[i] = names[near[0].index as usize];
                if !is_sure(near[0].distance) {
                    left.push(i);
                    farthest = farthest.max(near[0].distance);
                }
            }
            open = left;
            // No nearer one lies beyond what has been found.
            reach = farthest;
        } else {
            reach *= 2.0;
        }
    }
    Ok(found)
}

/// How far around points atoms are looked for at first, Å.
const FIRST_REACH: f64 = 6.0;

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
pub fn element_color(symbol: &str) -> Rgb {
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
