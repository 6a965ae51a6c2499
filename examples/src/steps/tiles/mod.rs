//! A body in tiles: each sampled and meshed alone, one after another, put aside, and numbered together.

use std::sync::atomic::{AtomicU64, Ordering};

use gauss_density::{Copies, RootDensity, sample_window};
use geom_core::grid::lattice::Window;
use geom_core::io::view::Group;
use geom_core::structure::Transform;
use geom_core::tiles::border::{Asked, Border, ghosts, number};
use geom_core::tiles::exchange::{Counted, Deal, Exchange, gathered};
use geom_core::tiles::parts::{Closed, closed};
use geom_core::tiles::{Piece, Spill, Tiles};
use geom_core::{Cpu, Lattice, Structure, TetMesh, Vector3};
use serde::Serialize;
use tet_quality::quality_report;

use self::output::Whole;
use crate::session::peak_bytes;
use crate::{Failure, Session};

mod better;
mod output;
#[cfg(feature = "mpi")]
pub mod remains;
mod walls;

/// Cells per side of a root cell: what tiles are put together of.
pub const ROOT: usize = 32;

/// How far the roots of the tiles of each further pass of improvement begin below the lattice, in cells: no border of one
/// pass is one of another.
const SHIFTS: [usize; 1] = [ROOT / 2];

/// For how many tiles of each rank ghosts are held at a time.
const AT_ONCE: usize = 8;

/// What is done in tiles.
pub struct Plan<'a> {
    /// The atoms.
    pub copies: &'a Copies,
    /// What their unit is called, for labels.
    pub structure: &'a Structure,
    /// Where the copies of the unit stand.
    pub places: &'a [Transform],
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
    /// What it took, by rank.
    pub ranks: Vec<Used>,
    /// The names of regions and boundaries.
    #[serde(skip)]
    pub groups: Vec<Group>,
}

/// What a rank has used.
#[derive(Clone, Copy, Debug, Default, Serialize, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub struct Used {
    /// Its tiles.
    pub tiles: u64,
    /// Bytes that it has sent to other ranks.
    pub sent_bytes: u64,
    /// Bytes that its process has put aside on disk.
    pub spilled_bytes: u64,
    /// The most memory that its process has held, bytes; 0 where the system does not tell.
    pub peak_bytes: u64,
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

/// A place that needs another look: a tetrahedron that is worse than the passes aim at, or walls that cross.
#[derive(Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
struct Bad {
    place: [f64; 3],
    tile: u64,
}

impl<'a> Plan<'a> {
    /// A plan for so many tiles, about equally full of atoms. Refuses what cannot fit into the memory of a tile before
    /// anything is allocated.
    pub fn new(
        copies: &'a Copies,
        (structure, places): (&'a Structure, &'a [Transform]),
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
            structure,
            places,
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
        exchange: &dyn Exchange,
        session: &Session,
        done: &AtomicU64,
    ) -> Result<Outcome, Failure> {
        let exchange = &Counted::new(exchange);
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
        // Each tile by itself; of what is made only its border stays in memory, the rest is put aside.
        let mut sums = Sums::default();
        let mut borders = Vec::with_capacity(own.len());
        for tile in own.clone() {
            borders.push(self.make(tile, session, &mut sums)?);
            step(session)?;
        }
        if let Some(options) = &self.improve {
            let step = || Ok(step(session)?);
            borders = self.improve(options, borders, exchange, &deal, session, &step)?;
        }
        // Numbers that hold for all ranks: shared vertices have one owner, and so one number.
        let vertices = number(exchange, &deal, &mut borders)?;
        let whole = Whole::of(exchange, vertices, &borders)?;
        let mut quality = Quality::default();
        let mut groups = Vec::new();
        let mut locals = Vec::with_capacity(own.len());
        // Ghosts of a few tiles of each rank at a time, which all ask for together.
        for first in (0..deal.most()).step_by(AT_ONCE) {
            let asked = Asked {
                layers: 2,
                places: first..first + AT_ONCE,
            };
            let beyond = ghosts(exchange, &deal, &borders, &asked)?;
            let tiles = own.clone().zip(&borders).skip(first).take(AT_ONCE);
            for ((tile, border), ghosts) in tiles.zip(&beyond) {
                let piece = self.piece(tile)?;
                quality.add(&piece.mesh);
                let local =
                    self.write(tile, &piece, border, ghosts, &whole, &mut groups, session)?;
                locals.push(local);
                sums.shared += border.links.chunk_by(|a, b| a.vertex == b.vertex).count() as u64;
                step(session)?;
            }
        }
        // What no rank knows alone: bodies and cavities through many tiles, and sums over the ranks.
        let parts = closed(exchange, &deal, &borders, &locals)?;
        let all = gathered(exchange, &[sums])?;
        let qualities = gathered(exchange, &[quality])?;
        let used = Used {
            tiles: own.len() as u64,
            sent_bytes: exchange.sent(),
            spilled_bytes: self.spill.written(),
            peak_bytes: peak_bytes().unwrap_or(0),
        };
        let used = gathered(exchange, &[used])?;
        let mut outcome = Outcome::of(vertices, &all.concat(), &qualities.concat(), &parts);
        outcome.ranks = used.concat();
        outcome.groups = output::all_groups(exchange, &groups)?;
        Ok(outcome)
    }

    /// What is done with each tile: made, improved, written.
    fn steps(&self) -> usize {
        let passes = self.improve.map_or(0, |_| 1 + self.shifted.len());
        2 + passes
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
        let (piece, _) =
            dual_contour::tile(&RootDensity(&grid), None, &window, own, &self.contour, run)?;
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

    /// A piece that has been put aside; empty if the tile has none.
    fn piece(&self, tile: usize) -> Result<Piece, Failure> {
        let name = spilled(tile);
        match self.spill.path(&name).exists() {
            true => Ok(Piece::from_bytes(&self.spill.get(&name)?)?),
            false => Ok(Piece::default()),
        }
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
            ranks: Vec::new(),
            groups: Vec::new(),
        }
    }
}
