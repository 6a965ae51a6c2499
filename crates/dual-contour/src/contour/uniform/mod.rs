//! The surface where all of its cells are finest: straight from the signs of the corners, without an
//! octree. Vertices, triangles, their order and their bits are those that the octree would give.
//!
//! Cells that are cut into tetrahedra, and what stands around them, are in [`cut_cells`].
//!
//! A surface needs the signs of one layer of cells alone: no leaves, no numbers of lattice points, no volume beside it.
//! The work is a walk over the stored blocks: which of their cells carry the surface (`block`), where their points are,
//! how far these may go beside cut cells (`clamp`), and the two triangles of each edge that changes sign (`triangles`).

use geom_core::compute::parallel;
use geom_core::{Point3, TriMesh};

use super::memory;
use super::report::Report;
use crate::Error;
use crate::backend::ContourBackend;
use crate::complex::simple_masks;
use crate::dual::{Probe, finest_points};
use crate::octree::{BLOCK, Samples};

mod batch;
mod block;
mod clamp;
mod cut_cells;
mod pattern;
mod triangles;

use block::{Block, bit_of, cells_of};
use cut_cells::{CellState, CutCells};

/// All cells that carry the surface, and their points.
struct Sheet<'a> {
    samples: &'a Samples<'a>,
    blocks: Vec<Block>,
    /// Points of the simple cells, in finest cells.
    points: Vec<Point3>,
}

impl Sheet<'_> {
    /// The cells that are cut, in order.
    fn cut_cells(&self) -> Vec<[i32; 3]> {
        self.blocks
            .iter()
            .filter(|b| b.carrying != b.simple)
            .flat_map(|b| {
                let cells: Vec<[i32; 3]> = cells_of(&b.cut()).collect();
                cells
                    .into_iter()
                    .map(|c| [0, 1, 2].map(|k| b.low[k] + c[k]))
            })
            .collect()
    }

    /// What stands at any cell.
    fn state(&self, cell: [i32; 3]) -> CellState {
        let cells = self.samples.domain.cells;
        if (0..3).any(|k| cell[k] < 0 || cell[k] >= cells[k]) {
            return CellState::Beyond;
        }
        let Some(slot) = self.samples.slot_of(cell) else {
            return CellState::Plain;
        };
        let block = &self.blocks[slot];
        let (word, bit) = bit_of(cell.map(|c| c & 7));
        let carrying = block.carrying[word];
        if carrying >> bit & 1 == 0 {
            return CellState::Plain;
        }
        block.vertex((word, bit)).map_or_else(
            || {
                let cut = block.cut();
                let before: u32 = cut[..word].iter().map(|w| w.count_ones()).sum();
                let below = cut[word] & ((1 << bit) - 1);
                CellState::Cut(block.first_cut + before + below.count_ones())
            },
            CellState::Whole,
        )
    }
}

/// The surface of plain labels that stays off the box, all cells finest.
///
/// # Errors
/// Too little memory or too few numbers for the cells that were counted, and what the backend or the field says.
pub(crate) fn surface(
    samples: &Samples<'_>,
    probe: &Probe<'_>,
    backend: &dyn ContourBackend,
    max_memory: u64,
    report: &mut Report,
) -> Result<TriMesh, Error> {
    let (blocks, vertices) = carrying_blocks(samples, report);
    memory::check_surface(
        report.surface_cells,
        report.split_cells,
        samples.stored_bytes(),
        max_memory,
    )?;
    let points = points_of(samples, probe, &blocks, vertices, backend)?;
    let mut sheet = Sheet {
        samples,
        blocks,
        points,
    };
    let cut = sheet.cut_cells();
    if cut.is_empty() {
        return Ok(triangles::emit(sheet, probe, None, report));
    }
    let mut points = std::mem::take(&mut sheet.points);
    let mut cut = CutCells::new(samples, probe, &cut, |cell| sheet.state(cell));
    report.clamped = clamp::clamp(&mut cut, &mut points);
    sheet.points = points;
    Ok(triangles::emit(sheet, probe, Some(&cut), report))
}

/// The stored blocks with what they carry, vertices and cut cells numbered; and how many vertices there are.
fn carrying_blocks(samples: &Samples<'_>, report: &mut Report) -> (Vec<Block>, usize) {
    let simple = simple_masks();
    let domain = samples.domain;
    let stored = samples.stored();
    let mut blocks: Vec<Block> = parallel::map(stored.len(), |slot| {
        let low = domain.block(stored[slot] as usize).map(|c| c * BLOCK);
        Block::new(low, samples.masks_at(slot), &simple)
    });
    let mut vertices = 0;
    for block in &mut blocks {
        for word in 0..8 {
            block.first[word] = vertices;
            vertices += block.simple[word].count_ones();
            report.surface_cells += block.carrying[word].count_ones() as usize;
        }
        block.first_cut = report.split_cells as u32;
        let cut = block.cut().map(u64::count_ones);
        report.split_cells += cut.iter().sum::<u32>() as usize;
    }
    report.leaves = report.surface_cells;
    (blocks, vertices as usize)
}

/// The points of all simple cells.
/// In the order of their numbers. A call gets as many blocks as the backend likes.
fn points_of(
    samples: &Samples<'_>,
    probe: &Probe<'_>,
    blocks: &[Block],
    vertices: usize,
    backend: &dyn ContourBackend,
) -> Result<Vec<Point3>, Error> {
    let mut points = vec![Point3::origin(); vertices];
    let mut rest = points.as_mut_slice();
    let per_call = backend.blocks_per_call().max(1);
    let mut calls = Vec::new();
    for (call, blocks) in blocks.chunks(per_call).enumerate() {
        let simple = blocks.iter().flat_map(|b| b.simple);
        let n: u32 = simple.map(u64::count_ones).sum();
        let (out, others) = std::mem::take(&mut rest).split_at_mut(n as usize);
        rest = others;
        calls.push((call * per_call, blocks, out, Ok(())));
    }
    parallel::for_each(&mut calls, |_, (first, blocks, out, done)| {
        let mut cells = Vec::with_capacity(out.len());
        for (slot, block) in (*first as u32..).zip(*blocks) {
            let place = |c: [i32; 3]| (slot, [0, 1, 2].map(|k| block.low[k] + c[k]));
            cells.extend(cells_of(&block.simple).map(place));
        }
        *done = finest_points(samples, probe, &cells, backend, out);
    });
    calls.into_iter().try_for_each(|(.., done)| done)?;
    Ok(points)
}
