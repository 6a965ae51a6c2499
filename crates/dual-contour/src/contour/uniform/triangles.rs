//! The triangles around all edges whose ends differ.
//!
//! Nearly all stand among four whole cells: a quad, of which one of two diagonals is taken. Eight of these are judged
//! at a time. Edges beside cut cells are judged one by one, between the eights, so that the order of triangles is that
//! of the edges.

use geom_core::compute::parallel;
use geom_core::{Point3, TriMesh};

use super::batch::Batch;
use super::block::{Block, cell_at};
use super::cut_cells::CutCells;
use super::{Report, Sheet};
use crate::complex::collect::{ADDED, joined};
use crate::dual::{Probe, Sample};
use crate::kernel::BLOCK_CELLS;
use crate::kernel::{self, LANES, NO_FAN, Quads};
use crate::octree::{BLOCK, Samples};

/// Stored blocks per batch; batches are independent and joined in order.
const BATCH: usize = 16;

/// The triangles around all edges whose ends differ. Of the four cells around an edge, the one whose
/// lowest corner begins it emits.
/// Positions become Å here, in the end, since diagonals are judged in finest cells.
pub(super) fn emit(
    sheet: Sheet<'_>,
    probe: &Probe<'_>,
    cut: Option<&CutCells<'_>>,
    report: &mut Report,
) -> TriMesh {
    let batches: Vec<Batch> = parallel::map(sheet.blocks.len().div_ceil(BATCH), |batch| {
        let first = batch * BATCH;
        let blocks = &sheet.blocks[first..];
        batch_of(
            &sheet,
            probe,
            cut,
            first,
            &blocks[..blocks.len().min(BATCH)],
        )
    });

    // Vertices in order: cells, then parts, then added points, which each batch has numbered for itself.
    let first_added = (sheet.points.len() as u32) + cut.map_or(0, CutCells::len);
    let counts: Vec<u32> = batches.iter().map(|b| b.added.len() as u32).collect();
    let starts = parallel::starts_of(&counts);
    let (triangles, added): (Vec<_>, Vec<_>) =
        batches.into_iter().map(|b| (b.triangles, b.added)).unzip();
    let triangles = joined(triangles, |batch, t: [u32; 3]| {
        t.map(|v| {
            if v & ADDED == 0 {
                v
            } else {
                first_added + starts[batch] as u32 + (v & !ADDED)
            }
        })
    });
    let domain = sheet.samples.domain;
    let mut positions = sheet.points;
    parallel::for_each(&mut positions, |_, x| *x = domain.world(x));
    report.added_vertices = added.iter().map(Vec::len).sum();
    positions.reserve_exact(cut.map_or(0, |c| c.len() as usize) + report.added_vertices);
    if let Some(cut) = cut {
        positions.extend_from_slice(&cut.points(|x| domain.world(x)));
    }
    positions.extend(added.iter().flatten().map(|x| domain.world(x)));
    report.triangles = triangles.len();
    TriMesh::new(positions, triangles).expect("emitted triangles name emitted vertices")
}

/// The triangles of the edges that begin in some blocks, the first of them stored at `first`.
fn batch_of(
    sheet: &Sheet<'_>,
    probe: &Probe<'_>,
    cut: Option<&CutCells<'_>>,
    first: usize,
    blocks: &[Block],
) -> Batch {
    let samples = sheet.samples;
    let mut out = Batch::default();
    let carrying = blocks.iter().flat_map(|b| b.carrying);
    let count: u32 = carrying.map(u64::count_ones).sum();
    out.triangles.reserve_exact(2 * count as usize + 64);
    let mut waiting = Waiting::new();
    let mut around = Around::new();
    for (slot, block) in (first..).zip(blocks) {
        around.fill(sheet, slot);
        let masks = samples.masks_at(slot);
        for (word, &bits) in block.carrying.iter().enumerate() {
            let mut bits = bits;
            while bits != 0 {
                let bit = bits.trailing_zeros();
                bits &= bits - 1;
                let (mask, at) = CELLS[64 * word + bit as usize];
                let mask = masks[usize::from(mask)];
                let [x, y, z] = cell_at(word, bit);
                let low = [block.low[0] + x, block.low[1] + y, block.low[2] + z];
                // Edges among whole cells wait until there are as many as lanes.
                let whole = around.edges(usize::from(at), mask, |axis, ids| {
                    waiting.push(
                        &sheet.points,
                        Edge {
                            ids,
                            low,
                            axis,
                            inside: mask & 1 == 1,
                        },
                    );
                    if waiting.len == LANES {
                        waiting.flush(samples, probe, &mut out);
                    }
                });
                // Beside cut cells they do not; those that wait go first, which keeps the order.
                if !whole {
                    waiting.flush(samples, probe, &mut out);
                    let cut = cut.expect("cut cells are listed");
                    cut.emit(low, mask, |c| sheet.state(c), &sheet.points, &mut out);
                }
            }
        }
    }
    waiting.flush(samples, probe, &mut out);
    out
}

/// Cells per side of a block and the layer before it.
const AROUND: usize = BLOCK as usize + 1;

/// Where the cells of a block stand, in their order: among its masks, and in [`Around`].
static CELLS: [(u16, u16); BLOCK_CELLS] = {
    let mut out = [(0, 0); BLOCK_CELLS];
    let mut i = 0;
    while i < BLOCK_CELLS {
        let [x, y, z] = cell_at(i / 64, (i % 64) as u32);
        let [x, y, z] = [x as u16, y as u16, z as u16];
        let side = AROUND as u16;
        out[i] = (
            x | y << 3 | z << 6,
            (x + 1) + side * (y + 1) + side * side * (z + 1),
        );
        i += 1;
    }
    out
};

/// The last layer of each axis within a word.
const LAST: [u64; 3] = {
    let mut out = [0; 3];
    let mut bit = 0;
    while bit < 64 {
        let cell = cell_at(0, bit);
        let mut k = 0;
        while k < 3 {
            if cell[k] == 3 {
                out[k] |= 1 << bit;
            }
            k += 1;
        }
        bit += 1;
    }
    out
};

/// The numbers of the vertices in a block and in the layer before it, for many look-ups.
/// One table of 9³ numbers per thread and block instead of four searches per edge.
struct Around {
    /// [`NO_VERTEX`] where a cell is cut or does not carry the surface.
    ids: [u32; AROUND * AROUND * AROUND],
}

const NO_VERTEX: u32 = u32::MAX;

impl Around {
    fn new() -> Self {
        Self {
            ids: [NO_VERTEX; AROUND * AROUND * AROUND],
        }
    }

    /// From the block itself and the seven before it along the axes and diagonals, as far as these are stored.
    fn fill(&mut self, sheet: &Sheet<'_>, slot: usize) {
        self.ids.fill(NO_VERTEX);
        let low = sheet.blocks[slot].low;
        for before in 0..8usize {
            let beside = [0, 1, 2].map(|k| before >> k & 1);
            let cell = [0, 1, 2].map(|k| low[k] - beside[k] as i32);
            if cell.iter().any(|&c| c < 0) {
                continue;
            }
            let Some(slot) = sheet.samples.slot_of(cell) else {
                continue;
            };
            let block = &sheet.blocks[slot];
            let back = BLOCK as usize * (beside[0] + AROUND * (beside[1] + AROUND * beside[2]));
            let mut within = u64::MAX;
            (0..3)
                .filter(|&k| beside[k] == 1)
                .for_each(|k| within &= LAST[k]);
            for word in (0..8).filter(|word| word & before == before) {
                let mut bits = block.simple[word] & within;
                while bits != 0 {
                    let bit = bits.trailing_zeros();
                    bits &= bits - 1;
                    let at = usize::from(CELLS[64 * word + bit as usize].1) - back;
                    self.ids[at] = block.number(word, bit);
                }
            }
        }
    }

    /// The edges from the lowest corner of the cell at a place whose ends differ: axis and numbers of the
    /// cells around. `false`, and none, if a cut cell stands around one of them.
    #[inline]
    fn edges(&self, at: usize, mask: u8, mut f: impl FnMut(usize, [u32; 4])) -> bool {
        const STEP: [usize; 3] = [1, AROUND, AROUND * AROUND];
        let own = self.ids[at];
        if own == NO_VERTEX {
            return false;
        }
        // Which of the three other ends of the edges differ from the corner.
        let differ =
            (mask >> 1 & 1 | mask >> 1 & 2 | mask >> 2 & 4) ^ if mask & 1 == 1 { 7 } else { 0 };
        let mut found = [[0; 4]; 3];
        for axis in (0..3).filter(|axis| differ >> axis & 1 == 1) {
            let (u, v) = (STEP[(axis + 1) % 3], STEP[(axis + 2) % 3]);
            let ids = [
                self.ids[at - u - v],
                self.ids[at - v],
                own,
                self.ids[at - u],
            ];
            if ids.contains(&NO_VERTEX) {
                return false;
            }
            found[axis] = ids;
        }
        (0..3)
            .filter(|axis| differ >> axis & 1 == 1)
            .for_each(|axis| f(axis, found[axis]));
        true
    }
}

/// Edges that wait until there are enough of them.
/// Quads as the edge sees them: its lower end in the origin, its direction along the last coordinate.
struct Waiting {
    quads: Quads,
    edges: [Edge; LANES],
    len: usize,
}

#[derive(Clone, Copy, Default)]
struct Edge {
    ids: [u32; 4],
    low: [i32; 3],
    axis: usize,
    /// Is the lower end in the molecule?
    inside: bool,
}

impl Waiting {
    fn new() -> Self {
        Self {
            quads: [[[0.5; LANES]; 3]; 4],
            edges: [Edge::default(); LANES],
            len: 0,
        }
    }

    /// Takes an edge; there must be a lane left.
    fn push(&mut self, points: &[Point3], edge: Edge) {
        let axes = [(edge.axis + 1) % 3, (edge.axis + 2) % 3, edge.axis];
        for (quad, &id) in self.quads.iter_mut().zip(&edge.ids) {
            let x = &points[id as usize];
            for (row, k) in quad.iter_mut().zip(axes) {
                row[self.len] = x[k] - f64::from(edge.low[k]);
            }
        }
        self.edges[self.len] = edge;
        self.len += 1;
    }

    /// Emits the edges that wait.
    /// In the order in which they came; lanes that are not filled are judged too and not looked at.
    fn flush(&mut self, samples: &Samples<'_>, probe: &Probe<'_>, out: &mut Batch) {
        let starts = kernel::diagonals(&self.quads);
        for (edge, &start) in self.edges[..self.len].iter().zip(&starts) {
            let ids = edge.ids;
            if start == NO_FAN {
                let mut high = edge.low;
                high[edge.axis] += 1;
                let [p, q] = [edge.low, high].map(|p| Sample::at(samples, p, samples.label(p)));
                let x = out.add(probe.cut(&p, &q));
                (0..4).for_each(|i| out.push([x, ids[i], ids[(i + 1) % 4]], edge.inside));
            } else {
                let s = usize::from(start);
                out.push([ids[s], ids[s + 1], ids[s + 2]], edge.inside);
                out.push([ids[s], ids[s + 2], ids[(s + 3) % 4]], edge.inside);
            }
        }
        self.len = 0;
    }
}
