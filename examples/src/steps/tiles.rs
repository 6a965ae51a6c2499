//! A body in tiles: each sampled and meshed alone, one after another, put aside, and numbered together.

use std::sync::atomic::{AtomicU64, Ordering};

use gauss_density::{Copies, PointSampler, sample_window};
use geom_core::grid::lattice::Window;
use geom_core::io::{self, mesh::vtu};
use geom_core::tiles::border::{Border, Ghost, ghosts, number};
use geom_core::tiles::exchange::{Deal, Exchange, gathered};
use geom_core::tiles::parts::{Closed, Local, closed, surface};
use geom_core::tiles::piece::key;
use geom_core::tiles::{Piece, Spill, Tiles};
use geom_core::{Cpu, ImplicitField, Lattice, Point3, TetMesh, Vector3};
use serde::Serialize;
use tet_quality::{improve_part, quality_report};

use crate::{Failure, Session};

/// Cells per side of a root cell: what tiles are put together of.
pub const ROOT: usize = 32;

/// How far the roots of the tiles of each further pass of improvement begin below the lattice, in cells: no border of one
/// pass is one of another.
const SHIFTS: [usize; 1] = [ROOT / 2];

/// What is done in tiles.
pub struct Plan<'a> {
    /// The atoms.
    pub copies: &'a Copies,
    /// How they are sampled.
    pub density: gauss_density::Options,
    /// How the density is meshed.
    pub contour: dual_contour::Options,
    /// The lattice of all.
    pub lattice: Lattice,
    /// Which cells belong to which tile.
    pub tiles: Tiles,
    /// As many tiles whose borders lie elsewhere, one set for each further pass of improvement.
    shifted: Vec<Tiles>,
    /// What to improve by, if at all.
    pub improve: Option<tet_quality::Options>,
    /// Where pieces wait.
    pub spill: Spill,
}

/// What came of it, the same on every rank.
#[derive(Clone, Debug, Serialize)]
pub struct Outcome {
    /// Tiles with elements.
    pub filled: u64,
    /// Vertices of all tiles, each counted once.
    pub vertices: u64,
    /// Tetrahedra of all tiles.
    pub tetrahedra: u64,
    /// Triangles of the surface.
    pub triangles: u64,
    /// Volume of the molecule, Å³.
    pub volume: f64,
    /// Closed surfaces around bodies.
    pub bodies: usize,
    /// Closed surfaces around cavities.
    pub cavities: usize,
    /// Number of the mesh as a set of tetrahedra, before it is improved: the same for any number of tiles and ranks.
    pub digest: String,
    /// Smallest dihedral angle, degrees.
    pub min_dihedral: f64,
    /// Largest dihedral angle, degrees.
    pub max_dihedral: f64,
    /// Vertices that more than one tile has, counted per tile.
    pub shared: u64,
}

/// What a rank adds up over its tiles.
#[derive(Clone, Copy, Default, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
struct Sums {
    digest: [u64; 2],
    shared: u64,
}

/// What its tetrahedra are in the end.
#[derive(Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
struct Quality {
    tetrahedra: u64,
    filled: u64,
    min_dihedral: f64,
    max_dihedral: f64,
}

impl Default for Quality {
    fn default() -> Self {
        Self {
            tetrahedra: 0,
            filled: 0,
            min_dihedral: 180.0,
            max_dihedral: 0.0,
        }
    }
}

impl Quality {
    fn add(&mut self, mesh: &TetMesh) {
        if !mesh.tets().is_empty() {
            let all = quality_report(mesh).all;
            self.tetrahedra += mesh.tets().len() as u64;
            self.filled += 1;
            self.min_dihedral = self.min_dihedral.min(all.min_dihedral.min);
            self.max_dihedral = self.max_dihedral.max(all.max_dihedral.max);
        }
    }
}

impl<'a> Plan<'a> {
    /// A plan for so many tiles, about equally full of atoms. Refuses what cannot fit into the memory of a tile before
    /// anything is allocated.
    pub fn new(
        copies: &'a Copies,
        density: gauss_density::Options,
        contour: dual_contour::Options,
        improve: Option<tet_quality::Options>,
        count: usize,
        spill: Spill,
    ) -> Result<Self, Failure> {
        let lattice = copies.lattice(&density)?;
        let cells = lattice.cells();
        let atoms = Weights::of(copies, &lattice);
        let tiles = Tiles::new(cells, ROOT, 0, count, |root| atoms.at(root));
        let elsewhere = |shift: usize| Tiles::new(cells, ROOT, shift, count, |root| atoms.at(root));
        let shifted = SHIFTS.into_iter().map(elsewhere).collect();
        let plan = Self {
            copies,
            density,
            contour,
            lattice,
            tiles,
            shifted,
            improve,
            spill,
        };
        let needed = plan.estimate(&atoms);
        let limit = plan.contour.max_memory;
        if needed > limit {
            return Err(format!(
                "{count} tiles need about {needed} bytes at once, and {limit} are allowed: take more tiles, a larger \
                 spacing, or allow more memory"
            )
            .into());
        }
        Ok(plan)
    }

    /// About the bytes that a rank needs at once: the fullest tile with the cells near the atoms in its window, and the
    /// borders and ghosts of all. (Of the capsid 1M4X at 5 Å in 64 tiles 1.5 GB, and it took 1.7.)
    fn estimate(&self, atoms: &Weights) -> u64 {
        const OF_CELL: f64 = 400.0;
        const OF_BORDER_CELL: f64 = 3700.0;
        let h3 = self.lattice.spacing.powi(3);
        let cells = |root: [u32; 3]| {
            // An atom takes 20 Å³ of a protein, and its density as much again around.
            (atoms.at(root) as f64 * 40.0 / h3).min((ROOT * ROOT * ROOT) as f64)
        };
        let (mut most, mut border) = (0.0f64, 0.0);
        for tile in 0..self.tiles.len() {
            let [low, high] = self.tiles.cells_of(tile);
            if low == high {
                continue;
            }
            let window = Window::around(self.lattice, low, high, dual_contour::HALO);
            let last = [0, 1, 2].map(|k| window.low[k] + window.counts[k]);
            most = most.max(sum_of_roots(window.low, last, cells));
            // The share of its cells that touch a side which is not one of the lattice.
            let counts = self.lattice.cells();
            let share = (0..3).map(|k| {
                let sides = u8::from(low[k] > 0) + u8::from(high[k] < counts[k]);
                f64::from(sides) / (high[k] - low[k]) as f64
            });
            border += sum_of_roots(low, high, cells) * share.sum::<f64>();
        }
        (most * OF_CELL + border * OF_BORDER_CELL) as u64
    }

    /// All tiles, on this rank and the others.
    pub fn run(
        &self,
        exchange: &(impl Exchange + ?Sized),
        session: &Session,
        done: &AtomicU64,
    ) -> Result<Outcome, Failure> {
        let deal = Deal {
            tiles: self.tiles.len(),
            ranks: exchange.ranks(),
        };
        let own = deal.of(exchange.rank());
        let step = |session: &Session| {
            let of = (self.tiles.len() * self.steps()) as u64;
            let made = done.fetch_add(1, Ordering::Relaxed) + 1;
            session.on(&Cpu).progress("tiles", made, of)
        };
        let mut sums = Sums::default();
        let mut borders = Vec::with_capacity(own.len());
        for tile in own.clone() {
            borders.push(self.make(tile, session, &mut sums)?);
            step(session)?;
        }
        if let Some(options) = &self.improve {
            number(exchange, &deal, &mut borders)?;
            for (tile, border) in own.clone().zip(&borders) {
                self.better(tile, border, options, session)?;
                step(session)?;
            }
            for shifted in &self.shifted {
                borders = self.shift(exchange, &deal, shifted)?;
                number(exchange, &deal, &mut borders)?;
                for (tile, border) in own.clone().zip(&mut borders) {
                    *border = self.better(tile, border, options, session)?;
                    step(session)?;
                }
            }
        }
        let vertices = number(exchange, &deal, &mut borders)?;
        let beyond = ghosts(exchange, &deal, &borders)?;
        let mut quality = Quality::default();
        let mut locals = Vec::with_capacity(own.len());
        for ((tile, border), ghosts) in own.zip(&borders).zip(&beyond) {
            locals.push(self.write(tile, border, ghosts, &mut quality, session)?);
            sums.shared += border.links.chunk_by(|a, b| a.vertex == b.vertex).count() as u64;
            step(session)?;
        }
        let parts = closed(exchange, &deal, &borders, &locals)?;
        let all = gathered(exchange, &[sums])?;
        let qualities = gathered(exchange, &[quality])?;
        Ok(Outcome::of(
            vertices,
            &all.concat(),
            &qualities.concat(),
            &parts,
        ))
    }

    /// What is done with each tile: made, improved, written.
    fn steps(&self) -> usize {
        let passes = self.improve.map_or(0, |_| 1 + self.shifted.len());
        2 + passes
    }

    /// Improves a tile, whose vertices that others have stay where they are.
    fn better(
        &self,
        tile: usize,
        border: &Border,
        options: &tet_quality::Options,
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
        let made = improve_part(piece.mesh, &held, field, options, session.on(&Cpu))?;
        // Vertices that were held have kept their names.
        let is_held = |x: &Point3| keys.binary_search(&key(x)).is_ok();
        let shared = made.mesh.positions().iter().map(is_held).collect();
        let piece = Piece {
            mesh: made.mesh,
            shared,
        };
        self.spill.put(&spilled(tile), &piece.to_bytes())?;
        Ok(Border::of(&piece))
    }

    /// Deals the tetrahedra to other tiles.
    fn shift(
        &self,
        exchange: &(impl Exchange + ?Sized),
        deal: &Deal,
        tiles: &Tiles,
    ) -> Result<Vec<Border>, Failure> {
        let rank = exchange.rank();
        let (origin, spacing) = (self.lattice.origin, self.lattice.spacing);
        // To tiles of this rank by disk, to others by messages: tile, length, bytes.
        let mut to = vec![Vec::new(); deal.ranks];
        let mut moved = Vec::new();
        for from in deal.of(rank) {
            let parts = self
                .piece(from)?
                .dealt(|corners| tiles.of_tet(corners, &origin, spacing));
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
        for tile in deal.of(rank) {
            let mut parts = Vec::new();
            // In the order of the tiles that they come from: lower ranks, this one, higher ones.
            for (other, said) in heard.iter().enumerate() {
                if other == rank {
                    for (_, name) in moved.iter().filter(|m| m.0 == tile) {
                        parts.push(Piece::from_bytes(&self.spill.get(name)?)?);
                        self.spill.forget(name)?;
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
            let piece = Piece::joined(&parts);
            borders.push(Border::of(&piece));
            self.spill.put(&spilled(tile), &piece.to_bytes())?;
        }
        Ok(borders)
    }

    /// Samples and meshes a tile, and puts it aside.
    fn make(&self, tile: usize, session: &Session, sums: &mut Sums) -> Result<Border, Failure> {
        let own = self.tiles.cells_of(tile);
        if own[0] == own[1] {
            return Ok(Border::default());
        }
        let run = session.on(&Cpu);
        let window = Window::around(self.lattice, own[0], own[1], dual_contour::HALO);
        let grid = sample_window(self.copies, &self.density, &window, run)?;
        let (piece, _) = dual_contour::tile(&grid, &window, own, &self.contour, run)?;
        drop(grid);
        if piece.mesh.tets().is_empty() {
            return Ok(Border::default());
        }
        let sum = u128::from(sums.digest[0]) << 64 | u128::from(sums.digest[1]);
        let sum = sum.wrapping_add(piece.digest());
        sums.digest = [(sum >> 64) as u64, sum as u64];
        self.spill.put(&spilled(tile), &piece.to_bytes())?;
        Ok(Border::of(&piece))
    }

    /// Writes the part of a tile, once its vertices have numbers.
    fn write(
        &self,
        tile: usize,
        border: &Border,
        ghosts: &[Ghost],
        quality: &mut Quality,
        session: &Session,
    ) -> Result<Local, Failure> {
        let path = session.output(part_name(tile))?;
        let piece = self.piece(tile)?;
        quality.add(&piece.mesh);
        let ids = border.ids();
        let view = part(&piece, &ids, ghosts, border)?;
        io::mesh::vtu::save(path, &view)?;
        self.spill.put(&numbers(tile), bytemuck::cast_slice(&ids))?;
        let surface = surface(&piece, &ids, ghosts);
        Ok(Local::of(&piece, border, &surface))
    }

    /// A piece that has been put aside; empty if the tile has none.
    fn piece(&self, tile: usize) -> Result<Piece, Failure> {
        let name = spilled(tile);
        match self.spill.path(&name).exists() {
            true => Ok(Piece::from_bytes(&self.spill.get(&name)?)?),
            false => Ok(Piece::default()),
        }
    }

    /// Writes the file that joins the parts.
    pub fn join(&self, session: &Session) -> Result<(), Failure> {
        let names: Vec<String> = (0..self.tiles.len()).map(part_name).collect();
        let empty = part(&Piece::default(), &[], &[], &Border::default())?;
        Ok(vtu::save_parts(
            session.output("volume.pvtu")?,
            &empty,
            &names,
        )?)
    }

    /// The whole mesh in one memory, its vertices in the order of their numbers.
    pub fn merged(&self, outcome: &Outcome) -> Result<TetMesh, Failure> {
        let n = usize::try_from(outcome.vertices)?;
        let mut positions = vec![Point3::origin(); n];
        let mut kinds = vec![geom_core::mesh::VertexKind::Interior; n];
        let (mut tets, mut regions) = (Vec::new(), Vec::new());
        for tile in 0..self.tiles.len() {
            let piece = self.piece(tile)?;
            let ids: Vec<u64> = bytemuck::pod_collect_to_vec(&self.spill.get(&numbers(tile))?);
            let (own, corners, own_regions, own_kinds) = piece.mesh.into_parts();
            for ((x, kind), &id) in own.into_iter().zip(own_kinds).zip(&ids) {
                positions[id as usize] = x;
                kinds[id as usize] = kind;
            }
            tets.extend(corners.iter().map(|t| t.map(|v| ids[v as usize] as u32)));
            regions.extend(own_regions);
        }
        Ok(TetMesh::with_kinds(positions, tets, regions, kinds)?)
    }
}

/// Bytes that the whole mesh takes while it is merged and written.
pub fn merged_bytes(outcome: &Outcome) -> u64 {
    200 * (outcome.vertices + outcome.tetrahedra)
}

fn spilled(tile: usize) -> String {
    format!("tile_{tile}")
}

fn numbers(tile: usize) -> String {
    format!("numbers_{tile}")
}

fn part_name(tile: usize) -> String {
    format!("parts/part_{tile}.vtu")
}

/// A piece with its ghosts, as a part of a mesh.
fn part(
    piece: &Piece,
    ids: &[u64],
    ghosts: &[Ghost],
    border: &Border,
) -> Result<io::View<'static>, Failure> {
    let mut points = piece.mesh.positions().to_vec();
    let mut point_ids: Vec<i64> = ids.iter().map(|&id| id as i64).collect();
    let mut foreign = vec![0u8; points.len()];
    for links in border.links.chunk_by(|a, b| a.vertex == b.vertex) {
        foreign[links[0].vertex as usize] = u8::from(links.iter().any(|l| l.other < l.tile));
    }
    // Vertices that only ghosts have follow those of the piece.
    let mut known: Vec<(u64, u32)> = (0..).zip(ids).map(|(v, &id)| (id, v)).collect();
    known.sort_unstable();
    let is_known = |id: u64| known.binary_search_by_key(&id, |k| k.0);
    let mut more: Vec<(u64, [f64; 3])> = ghosts
        .iter()
        .flat_map(|g| g.ids.into_iter().zip(g.corners))
        .filter(|(id, _)| is_known(*id).is_err())
        .collect();
    more.sort_unstable_by_key(|m| m.0);
    more.dedup_by_key(|m| m.0);
    let first = points.len() as u32;
    points.extend(more.iter().map(|m| Point3::from(m.1)));
    point_ids.extend(more.iter().map(|m| m.0 as i64));
    foreign.resize(points.len(), 1);
    let place = |id: u64| match is_known(id) {
        Ok(at) => known[at].1,
        Err(_) => first + more.partition_point(|m| m.0 < id) as u32,
    };
    let mut tets = piece.mesh.tets().to_vec();
    let mut regions = piece.mesh.regions().to_vec();
    let mut ghost = vec![0u8; tets.len()];
    tets.extend(ghosts.iter().map(|g| g.ids.map(place)));
    regions.extend(ghosts.iter().map(|g| g.region as u8));
    ghost.resize(tets.len(), 1);
    let view = io::View {
        points: points.into(),
        blocks: vec![io::view::Cells::Tets(tets.into())],
        ..io::View::default()
    };
    Ok(view
        .point_field(vtu::GLOBAL_IDS, point_ids)?
        .point_field(vtu::GHOSTS, foreign)?
        .cell_field(vtu::GHOSTS, ghost)?
        .cell_field("region", regions)?)
}

/// A sum over the roots that hold some cells.
fn sum_of_roots(low: [usize; 3], high: [usize; 3], of: impl Fn([u32; 3]) -> f64) -> f64 {
    let range = |k: usize| (low[k] / ROOT) as u32..high[k].div_ceil(ROOT) as u32;
    let rows = range(2).flat_map(|z| range(1).map(move |y| [y, z]));
    rows.map(|[y, z]| range(0).map(|x| of([x, y, z])).sum::<f64>())
        .sum()
}

/// Atoms per root cell.
struct Weights {
    roots: [usize; 3],
    atoms: Vec<u32>,
}

impl Weights {
    fn of(copies: &Copies, lattice: &Lattice) -> Self {
        let roots = lattice.cells().map(|n| n.div_ceil(ROOT));
        let mut atoms = vec![0u32; roots.iter().product()];
        copies.for_each_center(|x| {
            let local: Vector3 = lattice.local(x) / ROOT as f64;
            let at = [0, 1, 2].map(|k| (local[k].max(0.0) as usize).min(roots[k] - 1));
            atoms[(at[2] * roots[1] + at[1]) * roots[0] + at[0]] += 1;
        });
        Self { roots, atoms }
    }

    fn at(&self, root: [u32; 3]) -> u64 {
        let at = root.map(|c| c as usize);
        let within = (0..3).all(|k| at[k] < self.roots[k]);
        let index = (at[2] * self.roots[1] + at[1]) * self.roots[0] + at[0];
        if within {
            u64::from(self.atoms[index])
        } else {
            0
        }
    }
}

impl Outcome {
    fn of(vertices: u64, all: &[Sums], qualities: &[Quality], parts: &[Closed]) -> Self {
        let digest = all.iter().fold(0u128, |sum, s| {
            sum.wrapping_add(u128::from(s.digest[0]) << 64 | u128::from(s.digest[1]))
        });
        Self {
            filled: qualities.iter().map(|q| q.filled).sum(),
            vertices,
            tetrahedra: qualities.iter().map(|q| q.tetrahedra).sum(),
            triangles: parts.iter().map(|p| p.triangles).sum(),
            volume: parts.iter().map(|p| p.volume).sum(),
            bodies: parts.iter().filter(|p| p.volume > 0.0).count(),
            cavities: parts.iter().filter(|p| p.volume <= 0.0).count(),
            digest: format!("{digest:032x}"),
            min_dihedral: qualities
                .iter()
                .map(|q| q.min_dihedral)
                .fold(180.0, f64::min),
            max_dihedral: qualities.iter().map(|q| q.max_dihedral).fold(0.0, f64::max),
            shared: all.iter().map(|s| s.shared).sum(),
        }
    }
}
