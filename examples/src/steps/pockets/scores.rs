//! Scores of pockets by what else is known: a ligand, a potential.

use std::path::Path;

use gauss_density::{Cutoff, Levels, Model, PointSampler};
use geom_core::io::grid;
use geom_core::structure::{Element, Selector};
use geom_core::{Aabb, ImplicitField, LatticeValues, Point3, ScalarGrid, Structure, TriMesh};
use secondfund_ops::pockets::{FieldScore, SiteScore, distance_to_ligand, field_in, site_ranks};
use serde_json::json;

use super::Found;
use crate::{Failure, Session};

/// A known ligand: its heavy atoms, and their density (Eq. 7.27).
pub(super) struct Ligand {
    atoms: Vec<Point3>,
    model: Model,
}

impl Ligand {
    /// The structure without the selected residues, and these: a chain may be the ligand, too.
    pub(super) fn taken_from(
        structure: &Structure,
        selector: &Selector,
        decay: f64,
    ) -> Result<(Structure, Self), Failure> {
        let selection = structure.select(selector)?;
        let mut chosen = vec![false; structure.atoms().len()];
        for range in selection.atom_ranges(structure) {
            chosen[range].fill(true);
        }
        let heavy = |a: usize| structure.atoms()[a].element != Element::HYDROGEN;
        let ligand = structure.filter(|a| chosen[a] && heavy(a));
        if ligand.atoms().is_empty() {
            return Err(format!("--ligand {selector} has no heavy atoms").into());
        }
        let levels = Levels {
            decay,
            ..Levels::default()
        };
        let of_ligand = Self {
            atoms: ligand.atoms().iter().map(|a| a.position).collect(),
            model: Model::uniform(&ligand, &levels)?,
        };
        Ok((structure.filter(|a| !chosen[a]), of_ligand))
    }

    fn density(&self) -> Result<PointSampler<'_>, Failure> {
        Ok(PointSampler::new(&self.model, Cutoff::default())?)
    }

    /// The density at the vertices of a surface.
    pub(super) fn on_surface(&self, surface: &TriMesh) -> Result<Vec<f64>, Failure> {
        let density = self.density()?;
        Ok(surface
            .positions()
            .iter()
            .map(|p| density.value(p))
            .collect())
    }
}

/// A map, in its own unit.
pub(super) struct Potential {
    grid: ScalarGrid,
    bounds: Aabb,
}

impl Potential {
    pub(super) fn read(session: &Session, path: &Path) -> Result<Self, Failure> {
        let grid = session.stage("map", || {
            grid::read_up_to(path, session.memory())?.into_grid()
        })?;
        let bounds = grid.lattice().bounds();
        Ok(Self { grid, bounds })
    }
}

/// The scores of all pockets, in their order.
pub(super) struct Scores {
    /// Distance of the centre from the ligand's nearest atom, Å, and its density in the pocket.
    ligand: Option<(Vec<(f64, FieldScore)>, SiteScore)>,
    potential: Option<Vec<FieldScore>>,
}

impl Scores {
    pub(super) fn of(
        found: &Found,
        surface: &TriMesh,
        ligand: Option<&Ligand>,
        potential: Option<&Potential>,
    ) -> Result<Self, Failure> {
        let pairs = || found.pockets.iter().zip(&found.outlines);
        let of_ligand = |ligand: &Ligand| -> Result<_, Failure> {
            let density = ligand.density()?;
            let rows = pairs().map(|(p, o)| {
                let away = distance_to_ligand(&p.center, &ligand.atoms);
                (away, field_in(p, o, surface, &density, None))
            });
            let ranks = site_ranks(&found.pockets, std::slice::from_ref(&ligand.atoms));
            Ok((rows.collect(), ranks[0]))
        };
        let of_map = |map: &Potential| {
            pairs()
                .map(|(p, o)| field_in(p, o, surface, &map.grid, Some(&map.bounds)))
                .collect()
        };
        Ok(Self {
            ligand: ligand.map(of_ligand).transpose()?,
            potential: potential.map(of_map),
        })
    }

    /// Names of the columns, each with a comma.
    pub(super) fn heads(&self) -> String {
        let mut heads = String::new();
        if self.ligand.is_some() {
            heads += "ligand_distance,ligand_density,";
        }
        if self.potential.is_some() {
            heads += "potential,potential_low,potential_high,potential_surface,";
        }
        heads
    }

    /// The cells of a pocket; empty where there is no value.
    pub(super) fn cells(&self, pocket: usize) -> String {
        let cell = |value: Option<f64>| value.map_or(String::new(), |v| format!("{v:.5}")) + ",";
        let mut cells = String::new();
        if let Some((rows, _)) = &self.ligand {
            let (away, density) = rows[pocket];
            cells += &(cell(Some(away)) + &cell(density.surface));
        }
        if let Some(rows) = &self.potential {
            let score = rows[pocket];
            let [low, high] = [0, 1].map(|k| score.range.map(|r| r[k]));
            for value in [score.points, low, high, score.surface] {
                cells += &cell(value);
            }
        }
        cells
    }

    pub(super) fn note(&self, session: &Session) -> Result<(), Failure> {
        if let Some((rows, ranks)) = &self.ligand {
            // The active site, as the thesis tells it: the pocket of the highest mean density.
            let highest = (0..rows.len())
                .filter_map(|i| Some((i, rows[i].1.surface?)))
                .max_by(|a, b| a.1.total_cmp(&b.1).then(b.0.cmp(&a.0)));
            let active = highest.filter(|h| h.1 > 0.0).map(|h| h.0 + 1);
            session.note(
                "ligand",
                json!({
                    "rank_within_4_of_an_atom": ranks.rank_by_atom,
                    "rank_within_12_of_the_centroid": ranks.rank_by_centroid,
                    "rank_of_highest_density": active,
                    "density": rows.iter().map(|r| r.1).collect::<Vec<_>>(),
                }),
            )?;
        }
        match &self.potential {
            Some(rows) => session.note("potential", json!({ "pockets": rows })),
            None => Ok(()),
        }
    }
}
