//! Improvement of a mesh in tiles: each with its border held, again with borders elsewhere, and at last in patches around
//! what is still bad.

use gauss_density::PointSampler;
use geom_core::tiles::border::{Border, number};
use geom_core::tiles::exchange::{Deal, Exchange, gathered};
use geom_core::tiles::piece::key;
use geom_core::tiles::{Patches, Piece, Tiles};
use geom_core::{Cpu, ImplicitField, Point3};
use tet_quality::improve_part;
use tet_quality::measure::metrics::quality;

use super::walls::crossing;
use super::{Bad, Plan, spilled};
use crate::{Failure, Session};

/// Radii of the patches in the rounds at the end, in spacings: what could not be mended in one gets more room.
const RADII: [f64; 3] = [6.0, 8.0, 12.0];

/// Most passes of improvement while there are others to come: what is left after them mostly lies at a border.
const FIRST_PASSES: u32 = 8;

impl Plan<'_> {
    /// Improves the tiles of this rank in all passes. Gives their borders in the end.
    pub(super) fn improve(
        &self,
        options: &tet_quality::Options,
        mut borders: Vec<Border>,
        exchange: &dyn Exchange,
        deal: &Deal,
        session: &Session,
        step: &dyn Fn() -> Result<(), Failure>,
    ) -> Result<Vec<Border>, Failure> {
        let own = deal.of(exchange.rank());
        // A tile takes what the whole has as a reserve for its goal: what it gives away here, its neighbours cannot mend.
        let mut options = tet_quality::Options {
            goals: options.goals.reserve(),
            ..*options
        };
        let (mut bad, all) = (Vec::new(), options.passes);
        for number_of_pass in 0..=self.shifted.len() {
            if let Some(shifted) = number_of_pass.checked_sub(1) {
                borders = self.shift(exchange, deal, &self.shifted[shifted])?;
            }
            let is_last = number_of_pass == self.shifted.len();
            options.passes = if is_last { all } else { all.min(FIRST_PASSES) };
            number(exchange, deal, &mut borders)?;
            bad.clear();
            for (tile, border) in own.clone().zip(&mut borders) {
                *border = self.better(tile, border, &options, &mut bad, session)?;
                step()?;
            }
        }
        for radius in RADII {
            bad.extend(crossing(self, exchange, deal, &mut borders)?);
            let places: Vec<(Point3, u32)> = gathered(exchange, &bad)?
                .into_iter()
                .flatten()
                .map(|bad| (bad.place.into(), bad.tile as u32))
                .collect();
            if places.is_empty() {
                break;
            }
            let patches = Patches::new(&places, radius * self.lattice.spacing);
            borders = self.deal(exchange, deal, |from, corners| {
                patches.tile_of(&barycentre(corners)).unwrap_or(from)
            })?;
            number(exchange, deal, &mut borders)?;
            // Other directions than those that were tried in vain.
            options.seed = options.seed.wrapping_add(1);
            bad.clear();
            for (tile, border) in own.clone().zip(&mut borders) {
                if patches.has(tile) {
                    *border = self.better(tile, border, &options, &mut bad, session)?;
                }
            }
        }
        Ok(borders)
    }

    /// Improves a tile, whose vertices that others have stay where they are, and adds what is still bad.
    fn better(
        &self,
        tile: usize,
        border: &Border,
        options: &tet_quality::Options,
        bad: &mut Vec<Bad>,
        session: &Session,
    ) -> Result<Border, Failure> {
        let piece = self.piece(tile)?;
        if piece.mesh.tets().is_empty() {
            return Ok(Border::default());
        }
        let mut held = vec![false; piece.mesh.positions().len()];
        for link in &border.links {
            held[link.vertex as usize] = true;
        }
        let mut keys: Vec<[u64; 3]> = border
            .links
            .iter()
            .map(|l| key(&piece.mesh.positions()[l.vertex as usize]))
            .collect();
        keys.sort_unstable();
        let around = piece.mesh.bounds().inflated(4.0 * self.lattice.spacing);
        let atoms = self.copies.part(&around, self.density.cutoff)?;
        let field = atoms
            .as_ref()
            .map(|model| PointSampler::new(model, self.density.cutoff))
            .transpose()?;
        let field = field.as_ref().map(|f| f as &dyn ImplicitField);
        let mesh = improve_part(piece.mesh, &held, field, options, session.on(&Cpu))?.mesh;
        let target = options.goals.objective();
        let corners = (0..mesh.tets().len()).map(|t| mesh.corners(t));
        bad.extend(corners.filter(|c| quality(*c) < target).map(|c| Bad {
            place: barycentre(c).into(),
            tile: tile as u64,
        }));
        // Vertices that were held have kept their names.
        let is_held = |x: &Point3| keys.binary_search(&key(x)).is_ok();
        let shared = mesh.positions().iter().map(is_held).collect();
        let piece = Piece { mesh, shared };
        self.spill.put(&spilled(tile), &piece.to_bytes())?;
        Ok(Border::of(&piece))
    }

    /// Deals the tetrahedra to other tiles.
    fn shift(
        &self,
        exchange: &dyn Exchange,
        deal: &Deal,
        tiles: &Tiles,
    ) -> Result<Vec<Border>, Failure> {
        let (origin, spacing) = (self.lattice.origin, self.lattice.spacing);
        let of = |_: usize, corners: [Point3; 4]| tiles.of_tet(corners, &origin, spacing);
        self.deal(exchange, deal, of)
    }

    /// Deals the tetrahedra to the tiles that `tile` gives for the tile that each is in and its corners.
    fn deal(
        &self,
        exchange: &dyn Exchange,
        deal: &Deal,
        tile: impl Fn(usize, [Point3; 4]) -> usize,
    ) -> Result<Vec<Border>, Failure> {
        let rank = exchange.rank();
        // To tiles of this rank by disk, to others by messages: tile, length, bytes.
        let mut to = vec![Vec::new(); deal.ranks];
        let mut moved = Vec::new();
        // What a tile keeps as a whole stays where it is.
        let mut kept = vec![None; deal.of(rank).len()];
        for (from, kept) in deal.of(rank).zip(&mut kept) {
            let piece = self.piece(from)?;
            let parts = piece.dealt(|corners| tile(from, corners));
            if parts.keys().eq([&from]) {
                *kept = Some(Border::of(&piece));
                moved.push((from, spilled(from)));
                continue;
            }
            for (tile, part) in parts {
                let bytes = part.to_bytes();
                if deal.rank_of(tile) == rank {
                    let name = format!("moved_{from}_{tile}");
                    self.spill.put(&name, &bytes)?;
                    moved.push((tile, name));
                } else {
                    let to = &mut to[deal.rank_of(tile)];
                    to.extend_from_slice(bytemuck::cast_slice(&[tile as u64, bytes.len() as u64]));
                    to.extend_from_slice(&bytes);
                }
            }
        }
        let heard = exchange.all_to_all(to)?;
        let mut borders = Vec::new();
        for (tile, kept) in deal.of(rank).zip(kept) {
            let mut parts = Vec::new();
            // In the order of the tiles that they come from: lower ranks, this one, higher ones.
            for (other, said) in heard.iter().enumerate() {
                if other == rank {
                    for (_, name) in moved.iter().filter(|m| m.0 == tile) {
                        parts.push(Piece::from_bytes(&self.spill.get(name)?)?);
                        if *name != spilled(tile) {
                            self.spill.forget(name)?;
                        }
                    }
                }
                let mut rest = said.as_slice();
                while let Some((head, more)) = rest.split_first_chunk::<16>() {
                    let [to, bytes]: [u64; 2] = bytemuck::pod_read_unaligned(head);
                    let (own, others) = more
                        .split_at_checked(bytes as usize)
                        .ok_or("a message of tetrahedra has been cut off")?;
                    if to == tile as u64 {
                        parts.push(Piece::from_bytes(own)?);
                    }
                    rest = others;
                }
            }
            if let (Some(border), 1) = (kept, parts.len()) {
                borders.push(border);
                continue;
            }
            let piece = Piece::joined(&parts);
            borders.push(Border::of(&piece));
            self.spill.put(&spilled(tile), &piece.to_bytes())?;
        }
        Ok(borders)
    }
}

fn barycentre(corners: [Point3; 4]) -> Point3 {
    Point3::from(
        corners
            .map(|x| x.coords / 4.0)
            .iter()
            .sum::<geom_core::Vector3>(),
    )
}
