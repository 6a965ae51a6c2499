//! The kernels on the GPU. A V-cycle runs there as a whole: only its input and its result travel.
//!
//! Rows of a block are padded to multiples of four, which a shader reads as vectors (`quads` of them per row). Matrices
//! are uploaded once per hierarchy, work space is made once per width; a cycle then uploads one block, dispatches some
//! dozens of kernels and downloads one block.

use std::sync::Mutex;

use bytemuck::{Pod, Zeroable};
use geom_shaders::{GEOM_CORE_PRODUCT, GEOM_CORE_SMOOTH, GEOM_CORE_STENCIL};

use super::Error;
use super::backend::{Cycle, SpectralBackend, check_block};
use super::multigrid::{CompressedRows, Level, Multigrid, RoundedOperator};
use crate::algebra::graph::VoxelGraph;
use crate::compute::gpu::{Batch, GpuBuffer, GpuContext};
use crate::{GpuError, Wgpu};

/// Two sizes and two factors, as each of the kernels has them. What the third and fourth mean differs: α as bits and β
/// of `product`, the first row and a factor of `stencil`, the two factors of `smooth`.
#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct Parameters {
    sizes: [u32; 2],
    third: u32,
    fourth: f32,
}

impl Parameters {
    fn new(rows: usize, quads: usize, third: f32, fourth: f32) -> Self {
        Self {
            sizes: [rows as u32, quads as u32],
            third: third.to_bits(),
            fourth,
        }
    }
}

impl SpectralBackend for Wgpu {
    fn prepare<'a>(&'a self, hierarchy: &'a Multigrid<'a>) -> Result<Box<dyn Cycle + 'a>, Error> {
        let gpu = self.gpu();
        let levels = hierarchy.levels().iter().map(|l| LevelOnGpu::of(gpu, l));
        Ok(Box::new(CycleOnGpu {
            gpu,
            rows: hierarchy.rows(),
            levels: levels.collect::<Result<_, GpuError>>()?,
            coarsest: Matrix::of(gpu, hierarchy.coarsest())?,
            nothing: gpu.output::<[f32; 4]>("nothing", 1)?,
            workspace: Mutex::new(None),
        }))
    }
}

/// Rows of four columns each, the last ones zero.
fn padded(block: &[f32], columns: usize) -> Vec<f32> {
    let width = columns.next_multiple_of(4);
    let mut out = vec![0.0; block.len() / columns.max(1) * width];
    if columns > 0 {
        for (to, from) in out.chunks_mut(width).zip(block.chunks(columns)) {
            to[..columns].copy_from_slice(from);
        }
    }
    out
}

/// The rows without what they were padded with.
fn trim(block: &[f32], columns: usize, out: &mut Vec<f32>) {
    out.clear();
    if columns > 0 {
        let rows = block.chunks(columns.next_multiple_of(4));
        out.extend(rows.flat_map(|row| &row[..columns]));
    }
}

/// Workgroups of 64 for so many threads, within the limit of each dimension. The shader folds both dimensions back into
/// one index and drops threads beyond the last.
fn groups(threads: usize) -> [u32; 3] {
    let groups = threads.div_ceil(64);
    let x = groups.min(32_768);
    [x as u32, groups.div_ceil(x.max(1)) as u32, 1]
}

/// [`CompressedRows`] on the device.
struct Matrix {
    rows: usize,
    starts: GpuBuffer,
    indices: GpuBuffer,
    values: GpuBuffer,
}

impl Matrix {
    fn of(gpu: &GpuContext, matrix: &CompressedRows) -> Result<Self, GpuError> {
        Ok(Self {
            rows: matrix.rows(),
            starts: gpu.upload("starts", &matrix.starts)?,
            indices: gpu.upload("indices", &matrix.indices)?,
            values: gpu.upload("values", &matrix.values)?,
        })
    }

    /// `out ← beta z + alpha A x`.
    fn apply(
        &self,
        batch: &mut Batch<'_>,
        quads: usize,
        [alpha, beta]: [f32; 2],
        x: &GpuBuffer,
        z: &GpuBuffer,
        out: &GpuBuffer,
    ) -> Result<(), GpuError> {
        let parameters = Parameters::new(self.rows, quads, alpha, beta);
        let parameters = batch.gpu().uniform("product", &parameters)?;
        batch.dispatch(
            &GEOM_CORE_PRODUCT,
            &[
                &self.starts,
                &self.indices,
                &self.values,
                x,
                z,
                out,
                &parameters,
            ],
            groups(self.rows * quads),
        )
    }
}

/// A [`VoxelGraph`] on the device; its nodes are rows `first..first + nodes` of the operator.
struct Stencil {
    nodes: usize,
    first: usize,
    places: GpuBuffer,
    node_at: GpuBuffer,
    stencil: GpuBuffer,
}

impl Stencil {
    fn of(gpu: &GpuContext, graph: &VoxelGraph, first: usize) -> Result<Self, GpuError> {
        #[repr(C)]
        #[derive(Clone, Copy, Pod, Zeroable)]
        struct Neighbour {
            offset: i32,
            weight: f32,
        }
        let tables = graph.tables();
        let stencil: Vec<Neighbour> = tables
            .stencil
            .into_iter()
            .map(|(offset, weight)| Neighbour { offset, weight })
            .collect();
        Ok(Self {
            nodes: graph.nodes(),
            first,
            places: gpu.upload("places", tables.places)?,
            node_at: gpu.upload("node_at", tables.node_at)?,
            stencil: gpu.upload("stencil", &stencil)?,
        })
    }
}

/// A matrix, minus the weights of graphs.
struct OnGpu {
    matrix: Matrix,
    stencils: Vec<Stencil>,
}

impl OnGpu {
    fn of(gpu: &GpuContext, operator: &RoundedOperator<'_>) -> Result<Self, GpuError> {
        let mut stencils = Vec::new();
        let mut first = 0;
        for graph in operator.graphs {
            stencils.push(Stencil::of(gpu, graph, first)?);
            first += graph.nodes();
        }
        Ok(Self {
            matrix: Matrix::of(gpu, &operator.matrix)?,
            stencils,
        })
    }

    /// `out ← beta z + alpha A x`. The matrix writes `out`, then each stencil takes α times its weights off its own
    /// rows.
    fn apply(
        &self,
        batch: &mut Batch<'_>,
        quads: usize,
        [alpha, beta]: [f32; 2],
        x: &GpuBuffer,
        z: &GpuBuffer,
        out: &GpuBuffer,
    ) -> Result<(), GpuError> {
        self.matrix.apply(batch, quads, [alpha, beta], x, z, out)?;
        for s in &self.stencils {
            let parameters = Parameters {
                sizes: [s.nodes as u32, quads as u32],
                third: s.first as u32,
                fourth: -alpha,
            };
            let parameters = batch.gpu().uniform("stencil", &parameters)?;
            batch.dispatch(
                &GEOM_CORE_STENCIL,
                &[&s.places, &s.node_at, &s.stencil, x, out, &parameters],
                groups(s.nodes * quads),
            )?;
        }
        Ok(())
    }
}

/// [`Level`] on the device; the few numbers of the smoother stay here.
struct LevelOnGpu {
    operator: OnGpu,
    inverse_diagonal: GpuBuffer,
    steps: Vec<[f32; 2]>,
    prolong: Matrix,
    restrict: Matrix,
}

impl LevelOnGpu {
    fn of(gpu: &GpuContext, level: &Level<'_>) -> Result<Self, GpuError> {
        Ok(Self {
            operator: OnGpu::of(gpu, &level.operator)?,
            inverse_diagonal: gpu.upload("inverse_diagonal", &level.inverse_diagonal)?,
            steps: level.steps.to_vec(),
            prolong: Matrix::of(gpu, &level.prolong)?,
            restrict: Matrix::of(gpu, &level.restrict)?,
        })
    }

    fn rows(&self) -> usize {
        self.operator.matrix.rows
    }

    /// Smooths x, from zero if it is fresh, else with its residual at hand. A fresh x needs no product in the first
    /// step: its residual is `b` itself, and a flag tells the kernel not to read x.
    fn smooth(
        &self,
        batch: &mut Batch<'_>,
        own: &Blocks,
        x: &GpuBuffer,
        b: &GpuBuffer,
        fresh: bool,
    ) -> Result<(), GpuError> {
        let quads = own.quads;
        for (k, &[first, second]) in self.steps.iter().enumerate() {
            let zero = fresh && k == 0;
            if k > 0 {
                self.operator
                    .apply(batch, quads, [-1.0, 1.0], x, b, &own.residual)?;
            }
            let parameters = Parameters::new(self.rows(), quads, first, second);
            let parameters = batch.gpu().uniform("smooth", &parameters)?;
            let flag = [u32::from(zero), 0, 0, 0];
            let flag = batch.gpu().uniform("fresh", &flag)?;
            let r = if zero { b } else { &own.residual };
            batch.dispatch(
                &GEOM_CORE_SMOOTH,
                &[&self.inverse_diagonal, r, &own.step, x, &parameters, &flag],
                groups(self.rows() * quads),
            )?;
        }
        Ok(())
    }
}

/// The blocks of one level: right-hand side of the next, iterates, residual, step.
struct Blocks {
    quads: usize,
    coarse: GpuBuffer,
    before: GpuBuffer,
    after: GpuBuffer,
    residual: GpuBuffer,
    step: GpuBuffer,
}

/// One [`Blocks`] per level and the result of the coarsest, for blocks of `quads` vectors of four.
struct Workspace {
    quads: usize,
    blocks: Vec<Blocks>,
    result: GpuBuffer,
}

/// `nothing` stands where a product has no summand: a binding may not be empty.
struct CycleOnGpu<'a> {
    gpu: &'a GpuContext,
    rows: usize,
    levels: Vec<LevelOnGpu>,
    coarsest: Matrix,
    nothing: GpuBuffer,
    /// For the last width.
    workspace: Mutex<Option<Workspace>>,
}

impl CycleOnGpu<'_> {
    /// All arrays of a cycle of this width.
    fn workspace(&self, quads: usize) -> Result<Workspace, GpuError> {
        let block = |what, rows: usize| self.gpu.output::<[f32; 4]>(what, rows * quads);
        let blocks = self.levels.iter().map(|level| {
            let rows = level.rows();
            Ok(Blocks {
                quads,
                coarse: block("coarse", level.restrict.rows)?,
                before: block("before", rows)?,
                after: block("after", rows)?,
                residual: block("residual", rows)?,
                step: block("step", rows)?,
            })
        });
        Ok(Workspace {
            quads,
            blocks: blocks.collect::<Result<_, GpuError>>()?,
            result: block("result", self.coarsest.rows)?,
        })
    }

    /// Approximates `A⁻¹ b` on a level; where the result lies.
    fn descend<'w>(
        &self,
        batch: &mut Batch<'_>,
        depth: usize,
        b: &GpuBuffer,
        work: &'w Workspace,
    ) -> Result<&'w GpuBuffer, GpuError> {
        let quads = work.quads;
        let Some(level) = self.levels.get(depth) else {
            self.coarsest
                .apply(batch, quads, [1.0, 0.0], b, &self.nothing, &work.result)?;
            return Ok(&work.result);
        };
        let own = &work.blocks[depth];
        let residual = &own.residual;
        level.smooth(batch, own, &own.before, b, true)?;
        level
            .operator
            .apply(batch, quads, [-1.0, 1.0], &own.before, b, residual)?;
        let (nothing, coarse) = (&self.nothing, &own.coarse);
        level
            .restrict
            .apply(batch, quads, [1.0, 0.0], residual, nothing, coarse)?;
        let correction = self.descend(batch, depth + 1, coarse, work)?;
        let (before, after) = (&own.before, &own.after);
        level
            .prolong
            .apply(batch, quads, [1.0, 1.0], correction, before, after)?;
        level
            .operator
            .apply(batch, quads, [-1.0, 1.0], after, b, residual)?;
        level.smooth(batch, own, after, b, false)?;
        Ok(after)
    }
}

impl Cycle for CycleOnGpu<'_> {
    fn run(&self, block: &[f32], columns: usize, out: &mut Vec<f32>) -> Result<(), Error> {
        check_block(self.rows, block.len(), columns)?;
        let quads = columns.div_ceil(4);
        let mut slot = self.workspace.lock().unwrap_or_else(|e| e.into_inner());
        let work = match slot.take().filter(|w| w.quads == quads) {
            Some(work) => work,
            None => self.workspace(quads)?,
        };
        let b = self.gpu.upload("block", &padded(block, columns))?;
        // Handed over at once: a cycle is some seventy short kernels.
        let cycle = |batch: &mut Batch<'_>| self.descend(batch, 0, &b, &work);
        let x = self.gpu.together::<_, GpuError>("cycle", cycle)?;
        self.gpu.read(x, |x: &[f32]| trim(x, columns, out))?;
        *slot = Some(work);
        Ok(())
    }
}
