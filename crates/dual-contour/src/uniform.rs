//! The surface where all of its cells are finest: straight from the signs of the corners, without an
//! octree. Vertices, triangles, their order and their bits are those that the octree would give.
//!
//! Cells that are cut into tetrahedra are rare; they and the cells around them are left to a small
//! complex of their own.

use geom_core::mesh::INTERIOR;
use geom_core::{Point3, TriMesh};
use rayon::prelude::*;

use crate::backend::ContourBackend;
use crate::complex::{Cell, Complex, Corner, Kinds, simple_masks};
use crate::dual::{Duals, Probe, Sample, finest_points};
use crate::emit::{ADDED, Emission, Emitter, Want, joined, parts_of};
use crate::lanes::{self, LANES, Quads, widest};
use crate::octree::{BLOCK, NONE, Octree, Splits};
use crate::quality::NO_FAN;
use crate::samples::{Domain, Samples, local};
use crate::{Error, Report};

/// Stored blocks per batch; batches are independent and joined in order.
const BATCH: usize = 16;

/// The cells of a stored block that carry the surface, as bits in the order of the octree's leaves.
#[derive(Clone, Copy)]
struct Block {
    low: [i32; 3],
    carrying: [u64; 8],
    /// Those that are not cut into tetrahedra: each has a vertex.
    simple: [u64; 8],
    /// Number of the first vertex of each word.
    first: [u32; 8],
}

/// Word and bit of a cell within its block.
#[inline]
fn place([x, y, z]: [i32; 3]) -> (usize, u32) {
    let at = |shift: i32| (x >> shift & 1) | (y >> shift & 1) << 1 | (z >> shift & 1) << 2;
    (at(2) as usize, (at(1) << 3 | at(0)) as u32)
}

/// The inverse of [`place`].
#[inline]
fn cell_at(word: usize, bit: u32) -> [i32; 3] {
    let (g, c, i) = (word as i32, bit as i32 >> 3, bit as i32 & 7);
    [0, 1, 2].map(|k| (g >> k & 1) << 2 | (c >> k & 1) << 1 | (i >> k & 1))
}

impl Block {
    /// `masks` of all cells, x fastest.
    fn new(low: [i32; 3], masks: &[u8], simple: &[bool; 256]) -> Self {
        let mut out = Self {
            low,
            carrying: [0; 8],
            simple: [0; 8],
            first: [0; 8],
        };
        for (row, masks) in masks.chunks_exact(8).enumerate() {
            if masks.iter().all(|&m| m == 0) || masks.iter().all(|&m| m == 255) {
                continue;
            }
            for (x, &mask) in masks.iter().enumerate() {
                if mask != 0 && mask != 255 {
                    let (word, bit) = place([x as i32, (row & 7) as i32, (row >> 3) as i32]);
                    out.carrying[word] |= 1 << bit;
                    out.simple[word] |= u64::from(simple[usize::from(mask)]) << bit;
                }
            }
        }
        out
    }
}

/// The cells with a bit set, in order.
fn cells_of(words: &[u64; 8]) -> impl Iterator<Item = [i32; 3]> + '_ {
    words.iter().enumerate().flat_map(|(word, &bits)| {
        let mut bits = bits;
        std::iter::from_fn(move || {
            (bits != 0).then(|| {
                let bit = bits.trailing_zeros();
                bits &= bits - 1;
                cell_at(word, bit)
            })
        })
    })
}

/// All cells that carry the surface, and their points.
struct Sheet<'a> {
    samples: &'a Samples<'a>,
    blocks: Vec<Block>,
    /// Points of the simple cells, in finest cells.
    points: Vec<Point3>,
}

impl Sheet<'_> {
    /// The number of the vertex of a cell; `None` if the cell is cut.
    #[inline]
    fn vertex(&self, cell: [i32; 3]) -> Option<u32> {
        let slot = self
            .samples
            .slot_of(cell)
            .expect("cells with both signs are stored");
        let block = &self.blocks[slot];
        let (word, bit) = place(cell.map(|c| c & 7));
        let bits = block.simple[word];
        let below = bits & ((1 << bit) - 1);
        (bits >> bit & 1 == 1).then(|| block.first[word] + below.count_ones())
    }
}

/// What is left to the octree's own code.
struct Cut<'a> {
    emitter: Emitter<'a>,
    /// Parts of cut cells begin here in the numbers of the emitter.
    parts: u32,
}

/// The surface of plain labels that stays off the box, all cells finest.
pub(crate) fn surface<B: ContourBackend + ?Sized>(
    samples: &Samples<'_>,
    probe: &Probe<'_>,
    backend: &B,
    report: &mut Report,
) -> Result<TriMesh, Error> {
    let simple = simple_masks();
    let domain = samples.domain;
    let mut blocks: Vec<Block> = samples
        .stored()
        .par_iter()
        .enumerate()
        .with_min_len(64)
        .map(|(slot, &b)| {
            let low = domain.block(b as usize).map(|c| c * BLOCK);
            Block::new(low, samples.masks_at(slot), &simple)
        })
        .collect();
    let mut vertices = 0;
    for block in &mut blocks {
        for word in 0..8 {
            block.first[word] = vertices;
            vertices += block.simple[word].count_ones();
            report.surface_cells += block.carrying[word].count_ones() as usize;
        }
    }
    report.leaves = report.surface_cells;
    let cells: Vec<(u32, [i32; 3])> = joined(
        blocks
            .par_chunks(BATCH)
            .enumerate()
            .map(|(batch, blocks)| {
                let slots = (batch * BATCH) as u32..;
                let cells = |(slot, block): (u32, &Block)| {
                    let low = block.low;
                    cells_of(&block.simple)
                        .map(move |c| (slot, [0, 1, 2].map(|k| low[k] + c[k])))
                        .collect::<Vec<_>>()
                };
                slots.zip(blocks).flat_map(cells).collect()
            })
            .collect(),
        |_, c| c,
    );
    let points = finest_points(samples, probe, &cells, backend)?;
    drop(cells);
    let mut sheet = Sheet {
        samples,
        blocks,
        points,
    };

    let cut: Vec<[i32; 3]> = sheet
        .blocks
        .iter()
        .filter(|b| b.carrying != b.simple)
        .flat_map(|b| {
            let words: [u64; 8] = std::array::from_fn(|w| b.carrying[w] & !b.simple[w]);
            let cells: Vec<[i32; 3]> = cells_of(&words).collect();
            cells
                .into_iter()
                .map(|c| [0, 1, 2].map(|k| b.low[k] + c[k]))
        })
        .collect();
    if cut.is_empty() {
        return Ok(emit(sheet, probe, None, report));
    }
    let mut splits = Splits::none(domain.blocks, 30);
    cut.iter().for_each(|&c| splits.surround(domain.cells, c));
    let tree = Octree::new(domain.cells, &splits);
    let kinds = Kinds::of(samples, &tree, true);
    let complex = Complex::new(samples, &tree, kinds, |x, mean| {
        probe.value(x).unwrap_or(mean)
    });
    let duals = Duals::new(&complex, probe, false, backend)?;
    report.split_cells = complex.splits.len();
    report.held_back = duals.reduced;
    for id in 0..tree.leaves.len() as u32 {
        if let Some(rank) = duals.rank(id) {
            let vertex = sheet.vertex(complex.leaf(id).origin());
            sheet.points[vertex.expect("a simple cell") as usize] = duals.leaf(rank);
        }
    }
    let emitter = Emitter::new(&complex, &duals, probe, |_| false);
    let parts = parts_of(&emitter.numbering).start;
    Ok(emit(sheet, probe, Some(Cut { emitter, parts }), report))
}

/// Triangles of one batch. Numbers at and above that of all cells are parts of cut cells, those with
/// [`ADDED`] points of the batch itself.
#[derive(Default)]
struct Batch {
    triangles: Vec<[u32; 3]>,
    added: Vec<Point3>,
}

/// Edges that wait until there are enough of them.
struct Waiting {
    quads: Quads<LANES>,
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

    /// Emits the edges that wait.
    fn flush(&mut self, samples: &Samples<'_>, probe: &Probe<'_>, out: &mut Batch) {
        let starts = widest(
            #[inline(always)]
            || lanes::diagonals(&self.quads),
        );
        for (edge, &start) in self.edges[..self.len].iter().zip(&starts) {
            let ids = edge.ids;
            let mut push = |t: [u32; 3]| {
                let t = if edge.inside { t } else { [t[0], t[2], t[1]] };
                out.triangles.push(t);
            };
            if start == NO_FAN {
                let mut high = edge.low;
                high[edge.axis] += 1;
                let [p, q] = [edge.low, high].map(|p| Sample {
                    x: local(p),
                    label: samples.label(p),
                    value: samples.value(p),
                });
                let x = ADDED | out.added.len() as u32;
                out.added.push(probe.cut(&p, &q));
                (0..4).for_each(|i| push([x, ids[i], ids[(i + 1) % 4]]));
            } else {
                let s = usize::from(start);
                push([ids[s], ids[s + 1], ids[s + 2]]);
                push([ids[s], ids[s + 2], ids[(s + 3) % 4]]);
            }
        }
        self.len = 0;
    }
}

/// The triangles around all edges whose ends differ. Of the four cells around an edge, the one whose
/// lowest corner begins it emits.
fn emit(sheet: Sheet<'_>, probe: &Probe<'_>, cut: Option<Cut<'_>>, report: &mut Report) -> TriMesh {
    let Sheet { samples, .. } = sheet;
    let batches: Vec<Batch> = sheet
        .blocks
        .par_chunks(BATCH)
        .enumerate()
        .map(|(batch, blocks)| {
            let mut out = Batch::default();
            let count: u32 = blocks
                .iter()
                .flat_map(|b| b.carrying)
                .map(u64::count_ones)
                .sum();
            out.triangles.reserve_exact(2 * count as usize + 64);
            let mut waiting = Waiting::new();
            for (slot, block) in (batch * BATCH..).zip(blocks) {
                let masks = samples.masks_at(slot);
                for c in cells_of(&block.carrying) {
                    let mask = masks[(c[0] | c[1] << 3 | c[2] << 6) as usize];
                    let low = [0, 1, 2].map(|k| block.low[k] + c[k]);
                    let whole = sheet.edges(low, mask, |edge| {
                        let at = waiting.len;
                        let (u, v) = ((edge.axis + 1) % 3, (edge.axis + 2) % 3);
                        for (q, &id) in edge.ids.iter().enumerate() {
                            let x = &sheet.points[id as usize];
                            for (i, k) in [u, v, edge.axis].into_iter().enumerate() {
                                waiting.quads[q][i][at] = x[k] - f64::from(low[k]);
                            }
                        }
                        waiting.edges[at] = edge;
                        waiting.len += 1;
                        if waiting.len == LANES {
                            waiting.flush(samples, probe, &mut out);
                        }
                    });
                    if !whole {
                        waiting.flush(samples, probe, &mut out);
                        let cut = cut.as_ref().expect("cut cells have a complex");
                        cut.emit(&sheet, low, &mut out);
                    }
                }
            }
            waiting.flush(samples, probe, &mut out);
            out
        })
        .collect();

    // Cells, then the parts that are used, then added points.
    let cells = sheet.points.len() as u32;
    let mut parts: Vec<u32> = Vec::new();
    if cut.is_some() {
        for t in batches.iter().flat_map(|b| &b.triangles).flatten() {
            if *t >= cells && *t & ADDED == 0 {
                parts.push(*t);
            }
        }
        parts.sort_unstable();
        parts.dedup();
    }
    let counts: Vec<u32> = batches.iter().map(|b| b.added.len() as u32).collect();
    let starts = geom_core::parallel::starts_of(&counts);
    let first_added = cells + parts.len() as u32;
    let (triangles, added): (Vec<_>, Vec<_>) =
        batches.into_iter().map(|b| (b.triangles, b.added)).unzip();
    let triangles = joined(triangles, |batch, t: [u32; 3]| {
        t.map(|v| {
            if v < cells {
                v
            } else if v & ADDED != 0 {
                first_added + starts[batch] as u32 + (v & !ADDED)
            } else {
                cells + parts.binary_search(&v).expect("parts are listed") as u32
            }
        })
    });
    let domain: Domain = samples.domain;
    let mut positions = sheet.points;
    if let Some(cut) = &cut {
        let part = |v: &u32| cut.part(*v - cells);
        positions.extend(parts.iter().map(part));
    }
    positions.extend(added.into_iter().flatten());
    report.added_vertices = positions.len() - first_added as usize;
    positions
        .par_iter_mut()
        .with_min_len(4096)
        .for_each(|p| *p = domain.world(p));
    report.triangles = triangles.len();
    TriMesh::new(positions, triangles).expect("emitted triangles name emitted vertices")
}

impl Sheet<'_> {
    /// The edges from the lowest corner of a cell whose ends differ. `false`, and none, if a cut cell
    /// stands around one of them.
    #[inline]
    fn edges(&self, low: [i32; 3], mask: u8, mut f: impl FnMut(Edge)) -> bool {
        let inside = mask & 1 == 1;
        let mut edges = [Edge::default(); 3];
        let mut n = 0;
        let Some(own) = self.vertex(low) else {
            return false;
        };
        for axis in 0..3 {
            if (mask >> (1 << axis) & 1 == 1) == inside {
                continue;
            }
            let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
            let beside = |du: i32, dv: i32| {
                let mut c = low;
                c[u] -= du;
                c[v] -= dv;
                self.vertex(c)
            };
            let (Some(a), Some(b), Some(c)) = (beside(1, 1), beside(0, 1), beside(1, 0)) else {
                return false;
            };
            edges[n] = Edge {
                ids: [a, b, own, c],
                low,
                axis,
                inside,
            };
            n += 1;
        }
        edges[..n].iter().for_each(|&e| f(e));
        true
    }
}

impl Cut<'_> {
    /// The edges that a cell owns, by the code for any complex.
    fn emit(&self, sheet: &Sheet<'_>, cell: [i32; 3], out: &mut Batch) {
        let complex = self.emitter.complex;
        let (id, log) = complex.tree.find(cell);
        assert!(id != NONE && log == 0, "cells around cut ones are finest");
        let mut emission = Emission::default();
        let want = Want {
            tets: false,
            region: |_| false,
        };
        let asked = |p, q| (p == INTERIOR) != (q == INTERIOR);
        // Around a cell that is not cut itself the small complex may have larger ones; edges between it
        // and those belong to other cells.
        let owned = |corner| complex.is_split(id) || corner == Corner::Point(cell);
        complex.rings_of(id, asked, |ring| {
            if owned(ring.a.0) {
                self.emitter.ring(ring, &want, &mut emission);
            }
        });
        let before = out.added.len() as u32;
        out.added.append(&mut emission.added);
        out.triangles.extend(emission.triangles.iter().map(|t| {
            t.map(|v| {
                if v & ADDED != 0 {
                    v + before
                } else if v < self.parts {
                    let vertex = sheet.vertex(complex.leaf(v).origin());
                    vertex.expect("cut cells are named by their parts")
                } else {
                    sheet.points.len() as u32 + v - self.parts
                }
            })
        }));
    }

    /// The point of a part of a cut cell.
    fn part(&self, part: u32) -> Point3 {
        let cell = Cell::Part(part / 12, (part % 12) as u8);
        self.emitter.duals.position(self.emitter.complex, &cell)
    }
}
