//! The verbs of every crate on the processor and on the device of this machine, on the same input, in one run.
//!
//! Times are those of whole verbs, with what travels to the device and back; which kernels ran, and how many bytes they
//! were sent and gave back, is counted by the device itself. Compilation of kernels is left out.

use crossfield::{CrossfieldBackend, quadrangulate};
use dual_contour::{ContourBackend, Method, volume};
use gauss_density::{
    Cutoff, DensityBackend, Elimination, Levels, Model, Options, PointSampler, Refit, eliminate,
    refit, sample, sample_band,
};
use geom_core::algebra::eigen::{self, eigenpairs};
use geom_core::algebra::graph::{Laplacian, Neighbours, VoxelGraph};
use geom_core::mesh::shapes;
use geom_core::surface::flow::Corner;
use geom_core::{Cpu, Point3, Run, Structure, TetMesh, Vector3, Wgpu};
use secondfund_ops::operators::assemble;
use secondfund_ops::{
    Element, Faces, FlowOptions, Groups, Normals, OperatorBackend, SegmentOptions, SpectrumOptions,
    segment, smooth_quads, spectrum,
};
use spectral_corresp::{CorrespBackend, MatchOptions, ShapeOptions, VoxelShape, correspond};
use tet_quality::testing::{lattice, relaxation, shaken};
use tet_quality::{QualityBackend, improve};
use tspline::{Basis, SplineBackend, Surface, TMesh, TMeshOptions};

use super::baseline::Figures;
use super::beside::{LARGE, load};
use super::best;
use crate::Outcome;

/// All kernels of the workspace.
trait Device:
    DensityBackend
    + ContourBackend
    + QualityBackend
    + CrossfieldBackend
    + SplineBackend
    + OperatorBackend
    + CorrespBackend
{
}

impl<B> Device for B where
    B: DensityBackend
        + ContourBackend
        + QualityBackend
        + CrossfieldBackend
        + SplineBackend
        + OperatorBackend
        + CorrespBackend
{
}

/// Compares all verbs that hand kernels to a backend and have `matching` in their name.
pub(super) fn run(figures: &mut Figures, matching: &str) -> Outcome {
    let gpu = Wgpu::new().map_err(|e| e.to_string())?;
    let kind = if gpu.gpu().is_software() {
        " (a program on the processor: its times say nothing)"
    } else {
        ""
    };
    println!(
        "verbs on {} threads and on {}{kind}; best of three",
        rayon::current_num_threads(),
        gpu.gpu().adapter()
    );
    let mut table = Table {
        gpu,
        figures,
        matching,
    };
    densities(&mut table)?;
    tetrahedra(&mut table)?;
    surfaces(&mut table)?;
    spectra(&mut table)
}

struct Table<'a> {
    gpu: Wgpu,
    matching: &'a str,
    figures: &'a mut Figures,
}

impl Table<'_> {
    /// A line: a verb on both, and what the device did for it in one run of three.
    fn row<E: std::fmt::Display>(
        &mut self,
        name: &str,
        verb: impl Fn(&dyn Device) -> Result<(), E>,
    ) -> Outcome {
        const RUNS: u64 = 3;
        if !name.contains(self.matching) {
            return Ok(());
        }
        let ((), cpu) = best(|| verb(&Cpu))?;
        // The first run compiles.
        verb(&self.gpu).map_err(|e| e.to_string())?;
        let before = self.gpu.gpu().usage();
        let ((), device) = best(|| verb(&self.gpu))?;
        let used = self.gpu.gpu().usage().since(&before);
        let kernels: Vec<String> = used
            .kernels()
            .map(|(name, used)| format!("{name} {}", used.calls / RUNS))
            .collect();
        let total = used.total();
        #[expect(clippy::cast_precision_loss, reason = "bytes for people")]
        let mega = |bytes: u64| (bytes / RUNS) as f64 * 1e-6;
        println!(
            "{name}: cpu {:.1} ms, device {:.1} ms, {:.2}×; {:.1} MB up, {:.1} MB down; {}",
            1e3 * cpu,
            1e3 * device,
            cpu / device,
            mega(total.bytes_up),
            mega(total.bytes_down),
            kernels.join(", "),
        );
        self.figures
            .ratio(format!("device beside the processor, {name}"), device / cpu);
        Ok(())
    }
}

/// A structure at powers of residues and chains.
fn model_of(
    structure: &Structure,
    [residue_power, chain_power]: [f64; 2],
) -> Result<Model, String> {
    let levels = Levels {
        residue_power,
        chain_power,
        ..Levels::default()
    };
    Model::uniform(structure, &levels).map_err(|e| e.to_string())
}

/// Bands of structures of the thesis's sizes, a dense lattice, elimination, refit, and points of a model.
fn densities(table: &mut Table<'_>) -> Outcome {
    // A software device would take minutes for each.
    let large = if table.gpu.gpu().is_software() {
        &LARGE[..0]
    } else {
        &LARGE[..]
    };
    for row in large {
        let Some(structure) = row.structure()? else {
            continue;
        };
        let model = model_of(&structure, row.powers)?;
        let options = row.options();
        table.row(&format!("band, {}", row.name), |b| {
            sample_band(&model, &options, Run::on(b)).map(drop)
        })?;
    }
    let Some(structure) = load("1hvr.pdb", None)? else {
        return Err("1hvr.pdb is bundled".into());
    };
    let model = model_of(&structure, [0.5, 1.0])?;
    let options = Options {
        spacing: 0.25,
        ..Options::default()
    };
    table.row("dense lattice, 1HVR at 0.25 Å", |b| {
        sample(&model, &options, Run::on(b)).map(drop)
    })?;
    let elimination = Elimination::default();
    table.row("elimination, 1HVR", |b| {
        eliminate(&model, &elimination, Run::on(b)).map(drop)
    })?;
    let fewer = eliminate(&model, &elimination, Run::on(&Cpu)).map_err(|e| e.to_string())?;
    let fit = Refit {
        iterations: 10,
        ..Refit::default()
    };
    table.row("refit, 10 steps, 1HVR", |b| {
        refit(&fewer.model, &model, &fit, Run::on(b)).map(drop)
    })
}

/// Tetrahedra of a protein by both meshers, their improvement, and the kernels of quality alone.
fn tetrahedra(table: &mut Table<'_>) -> Outcome {
    const SPACING: f64 = 0.5;
    let Some(structure) = load("1hvr.pdb", None)? else {
        return Err("1hvr.pdb is bundled".into());
    };
    let model = model_of(&structure, [0.5, 1.0])?;
    let density = Options {
        spacing: SPACING,
        ..Options::default()
    };
    let grid = sample(&model, &density, Run::on(&Cpu))
        .map_err(|e| e.to_string())?
        .grid;
    for method in [Method::Stuffing, Method::DualContour] {
        let options = dual_contour::Options {
            method,
            ..dual_contour::Options::default()
        };
        let meshed = |b: &dyn Device| -> Result<TetMesh, String> {
            let field = PointSampler::new(&model, Cutoff::default()).map_err(|e| e.to_string())?;
            let field = field.on(b).map_err(|e| e.to_string())?;
            let made = volume(&grid, Some(&field), &options, Run::on(b));
            made.map(|made| made.mesh).map_err(|e| e.to_string())
        };
        let mesh = meshed(&Cpu)?;
        let count = mesh.tets().len();
        table.row(&format!("{count} tetrahedra of 1HVR, {method:?}"), |b| {
            meshed(b).map(drop)
        })?;
        let quality = tet_quality::Options {
            spacing: Some(SPACING),
            ..tet_quality::Options::default()
        };
        table.row(
            &format!("improvement of {count} tetrahedra, {method:?}"),
            |b| {
                let field =
                    PointSampler::new(&model, Cutoff::default()).map_err(|e| e.to_string())?;
                let field = field.on(b).map_err(|e| e.to_string())?;
                improve(mesh.clone(), Some(&field), &quality, Run::on(b))
                    .map(drop)
                    .map_err(|e| e.to_string())
            },
        )?;
    }
    for side in [26, 55] {
        let mesh = shaken(lattice([side; 3], 1.0, |_| 1), 0.25, 1);
        let count = mesh.tets().len();
        table.row(&format!("measures of {count} tetrahedra"), |b| {
            b.measure(mesh.positions(), mesh.tets(), &mut Vec::new())
        })?;
        let task = relaxation(&mesh, 7);
        table.row(
            &format!("a sweep over the vertices of {count} tetrahedra"),
            |b| b.relax(&task, &mut Vec::new()),
        )?;
    }
    Ok(())
}

/// Quads, splines, matrices, groups and smoothing of tori.
fn surfaces(table: &mut Table<'_>) -> Outcome {
    let corners: Vec<Corner> = (0..1_000_000)
        .map(|i| {
            let off = f64::from(i % 997) / 997.0;
            Corner {
                sides: [
                    Vector3::new(1.0, 0.3 * off, 0.0),
                    Vector3::new(-0.5 * off, 1.0, 0.1),
                ],
                normal: Vector3::z(),
            }
        })
        .collect();
    table.row("distortion of 1,000,000 corners", |b| {
        b.corner_distortion(&corners, 0.0, &mut Vec::new())
    })?;
    let torus = shapes::torus(1.0, 0.4, 144, 70);
    table.row("quads of 20,160 triangles", |b| {
        quadrangulate(&torus, &crossfield::Options::default(), Run::on(b)).map(drop)
    })?;

    let fine = shapes::quad_torus(1.0, 0.4, 12 * 28, 8 * 28);
    let half = |q: usize| u8::from(fine.corners(q)[0].x > 0.0);
    let levels: Vec<u8> = (0..fine.quads().len()).map(half).collect();
    let mesh = TMesh::build(&fine, &levels, &TMeshOptions::default()).map_err(|e| e.to_string())?;
    let spline =
        Surface::new(mesh, Basis::Hierarchical, Run::on(&Cpu)).map_err(|e| e.to_string())?;
    let parameters: Vec<f64> = (0..8).map(|i| f64::from(i) / 7.0).collect();
    let samples = 64 * spline.patches().len();
    table.row(&format!("{samples} samples of a spline"), |b| {
        spline.sample(&parameters, Run::on(b)).map(drop)
    })?;

    let options = SpectrumOptions::default();
    let large = shapes::torus(1.0, 0.4, 500, 200);
    let normals = Normals::default();
    let element = Element::Triangles(&large, &normals);
    table.row("matrices of 200,000 triangles", |b| {
        assemble(&element, &options, Run::on(b)).map(drop)
    })?;
    let quads = shapes::quad_torus(1.0, 0.4, 500, 200);
    let limit = secondfund_ops::Surface::new(quads.clone()).map_err(|e| e.to_string())?;
    let element = Element::CatmullClark(&limit);
    table.row("matrices of 100,000 quads", |b| {
        assemble(&element, &options, Run::on(b)).map(drop)
    })?;
    let flow = FlowOptions {
        iterations: 3,
        ..FlowOptions::default()
    };
    table.row("3 steps of the flow of 100,000 quads", |b| {
        smooth_quads(&quads, &flow, Run::on(b)).map(drop)
    })?;
    let element = Element::Triangles(&torus, &normals);
    let modes = spectrum(&element, &options, Run::on(&Cpu)).map_err(|e| e.to_string())?;
    let faces = Faces::from(&torus);
    let asked = SegmentOptions {
        groups: Groups::DaviesBouldin { most: 12 },
        ..SegmentOptions::default()
    };
    table.row("2 to 12 groups of 20,160 triangles", |b| {
        segment(&modes, &faces, &asked, Run::on(b)).map(drop)
    })
}

/// Modes of voxels, and the correspondence of two shapes.
fn spectra(table: &mut Table<'_>) -> Outcome {
    let side: usize = 96;
    let middle = Point3::origin() + Vector3::from_element(0.5 * (side as f64 - 1.0));
    let radius = 0.48 * side as f64;
    let inside: Vec<bool> = (0..side.pow(3))
        .map(|at| {
            let place = [at % side, at / side % side, at / side / side].map(|v| v as f64);
            let away = Point3::from(place) - middle;
            away.component_mul(&Vector3::new(1.0, 1.05, 0.95)).norm() < radius
        })
        .collect();
    let weights = [1.0, 2.0, 3.0].map(|d: f64| (-d).exp());
    let graph = VoxelGraph::new([side; 3], &inside, Neighbours::Eighteen, weights)
        .map_err(|e| e.to_string())?;
    let laplacian = Laplacian::of_voxels(graph);
    let degrees = laplacian.degree_mass();
    table.row(&format!("10 modes of {} voxels", laplacian.nodes()), |b| {
        eigenpairs(
            &laplacian,
            &degrees,
            10,
            &eigen::Options::default(),
            Run::on(b),
        )
        .map(drop)
    })?;

    let shapes: Vec<VoxelShape> = ["1A8O.pdb", "1AJJ.pdb"]
        .into_iter()
        .map(|file| {
            let structure = load(file, None)?.ok_or_else(|| format!("{file} is bundled"))?;
            let levels = Levels {
                decay: 0.3,
                ..Levels::default()
            };
            let model = Model::uniform(&structure, &levels).map_err(|e| e.to_string())?;
            let options = Options::default();
            let sampled = sample(&model, &options, Run::on(&Cpu)).map_err(|e| e.to_string())?;
            VoxelShape::of_grid(&sampled.grid, 1.0, &ShapeOptions::default(), Run::on(&Cpu))
                .map_err(|e| e.to_string())
        })
        .collect::<Result<_, String>>()?;
    table.row("correspondence of 1A8O and 1AJJ", |b| {
        correspond(&shapes[0], &shapes[1], &MatchOptions::default(), Run::on(b)).map(drop)
    })
}
