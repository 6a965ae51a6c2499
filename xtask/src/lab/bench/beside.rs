//! Density and surface beside programs of others, on the same input, in one run.

use std::path::Path;

use gauss_density::{Cutoff, Levels, Model, Options, Sampled, sample, sample_band, thesis};
use geom_core::io::structure::{ReadOptions, read};
use geom_core::structure::Transform;
use geom_core::{Aabb, Cpu, LatticeValues, Run, ScalarGrid, Structure, Vector3};

use super::baseline::Figures;
use super::best;
use crate::lab::{answer, number, python};
use crate::{Outcome, fixtures, root};

const CUT: f64 = 1e-4;

/// Compares on one small structure and, when they are at hand, larger ones: with a scatter of Gaussians and with VTK's flying
/// edges.
pub(super) fn kernels(figures: &mut Figures) -> Outcome {
    let python = python::with(&["numpy", "numba", "vtk"])?;
    let peers = root().join("xtask/src/lab/peers");
    let threads = rayon::current_num_threads();
    println!("kernels, one level, decay 1, cut {CUT:.0e}; best of three");
    let folder = root().join("target/bench-peers");
    std::fs::create_dir_all(&folder).map_err(|e| e.to_string())?;
    let mut beside = Beside {
        python: &python,
        peers: &peers,
        folder: &folder,
        threads,
        figures,
    };
    for input in &INPUTS {
        let Some(structure) = load(input.file, input.assembly)? else {
            continue;
        };
        let name = format!("{} at {} Å", input.file, input.spacing);
        let dense = beside.density(&name, &structure, input.spacing)?;
        if input.surface {
            beside.surface(&name, &dense)?;
        }
    }
    Ok(())
}

/// Compares structures of the thesis's size with brute force.
pub(super) fn large(figures: &mut Figures) -> Outcome {
    for row in &LARGE {
        if let Some((line, seconds)) = row.beside_brute_force()? {
            println!("brute force · {line}");
            figures.seconds(format!("band, {}", row.name), seconds);
        }
    }
    Ok(())
}

/// What others are called with.
struct Beside<'a> {
    python: &'a Path,
    peers: &'a Path,
    folder: &'a Path,
    threads: usize,
    figures: &'a mut Figures,
}

/// A structure that the scatter gets too, as one level.
struct Input {
    file: &'static str,
    assembly: Option<&'static str>,
    spacing: f64,
    /// Is the lattice small enough for surfaces of dense lattices?
    surface: bool,
}

/// Small and large, with few points per atom and with many; the last two are as large as those by which the
/// scatter was judged first (56 million points and 787 million).
const INPUTS: [Input; 6] = [
    Input {
        file: "1A8O.pdb",
        assembly: None,
        spacing: 0.25,
        surface: true,
    },
    Input {
        file: "pdb/1su4.pdb",
        assembly: None,
        spacing: 0.25,
        surface: true,
    },
    Input {
        file: "large/30s_from_4v5a.cif.gz",
        assembly: None,
        spacing: 0.8,
        surface: true,
    },
    Input {
        file: "large/30s_from_4v5a.cif.gz",
        assembly: None,
        spacing: 0.4,
        surface: true,
    },
    Input {
        file: "pockets/1afs.pdb",
        assembly: None,
        spacing: 0.204,
        surface: true,
    },
    Input {
        file: "large/2tmv.pdb",
        assembly: Some("1"),
        spacing: 0.174,
        surface: false,
    },
];

/// A bundled structure or one of the data folder; `None`, and a line that says so, if it is not at hand.
pub(super) fn load(file: &str, assembly: Option<&str>) -> Result<Option<Structure>, String> {
    let bundled = fixtures::folder().join(file);
    let found = if bundled.exists() {
        Some(bundled)
    } else {
        fixtures::shared(file)
    };
    let Some(path) = found else {
        println!("  {file}: not at hand, row left out");
        return Ok(None);
    };
    let options = ReadOptions {
        assembly: assembly.map(Into::into),
        ..ReadOptions::default()
    };
    let read = read(&path, &options).map_err(|e| e.to_string())?;
    Ok(Some(read.structure))
}

/// So many of a structure along x, y and z.
fn side_by_side(structure: &Structure, copies: [u32; 3]) -> Result<Structure, String> {
    let bounds = structure.center_bounds();
    // Atoms of neighbours touch, as in a crystal.
    let step = bounds.max - bounds.min + Vector3::from_element(4.0);
    let [nx, ny, nz] = copies;
    let place = |i: u32| [i % nx, i / nx % ny, i / (nx * ny)].map(f64::from);
    let moved = |i: u32| Transform {
        translation: step.component_mul(&Vector3::from(place(i))),
        ..Transform::identity()
    };
    let all = vec![vec![true; structure.residues().len()]];
    let copies: Vec<_> = (0..nx * ny * nz).map(|i| (0, moved(i))).collect();
    let copied = structure.copies(&all, &copies, usize::MAX);
    copied.map_err(|e| e.to_string())
}

/// A structure of the thesis's size, sampled as there, at ε = 1e-3.
pub(crate) struct Row {
    pub(crate) name: &'static str,
    pub(crate) file: &'static str,
    pub(crate) assembly: Option<&'static str>,
    /// How many of them stand side by side along x, y and z.
    pub(crate) copies: [u32; 3],
    pub(crate) spacing: f64,
    /// Of residues and chains.
    pub(crate) powers: [f64; 2],
    /// What the thesis has for the structure that this one stands for.
    pub(crate) thesis: &'static str,
}

/// From 2 thousand to 1 million atoms.
pub(crate) const LARGE: [Row; 6] = [
    Row {
        name: "1A63 itself",
        file: "pdb/1a63.pqr",
        assembly: None,
        copies: [1; 3],
        spacing: 0.25,
        powers: [0.5, 1.0],
        thesis: "CPU 1.50 s, GPU 0.35 s",
    },
    Row {
        name: "2TMV × 49 for 2W4U",
        file: "large/2tmv.pdb",
        assembly: Some("1"),
        copies: [1; 3],
        spacing: 0.52,
        powers: [0.5, 0.3],
        thesis: "CPU 37.8 s, GPU 4.8 s",
    },
    Row {
        name: "1AFS × 14 for 1GTP",
        file: "pockets/1afs.pdb",
        assembly: None,
        copies: [7, 2, 1],
        spacing: 0.25,
        powers: [0.5, 1.0],
        thesis: "CPU 162 s, GPU 11.3 s",
    },
    Row {
        name: "4V8R for 2W4A",
        file: "large/4v8r_h36.pdb.gz",
        assembly: None,
        copies: [1; 3],
        spacing: 0.45,
        powers: [0.2, 0.8],
        thesis: "CPU 143.5 s, GPU 10.2 s",
    },
    Row {
        name: "7CTH × 60 for 2KU2",
        file: "large/7cth.cif.gz",
        assembly: Some("1"),
        copies: [1; 3],
        spacing: 1.2,
        powers: [0.5, 1.0],
        thesis: "CPU 645 s, GPU 63 s",
    },
    Row {
        name: "7CTH × 60 for 1HTQ",
        file: "large/7cth.cif.gz",
        assembly: Some("1"),
        copies: [1; 3],
        spacing: 1.2,
        powers: [0.3, 0.8],
        thesis: "CPU 1,589 s, GPU 88 s",
    },
];

impl Row {
    /// All copies side by side; `None` if the structure is not at hand.
    pub(super) fn structure(&self) -> Result<Option<Structure>, String> {
        load(self.file, self.assembly)?
            .map(|one| side_by_side(&one, self.copies))
            .transpose()
    }

    /// How it is sampled.
    pub(super) fn options(&self) -> Options {
        Options {
            spacing: self.spacing,
            cutoff: Cutoff(1e-3),
            max_memory: 16 << 30,
            ..Options::default()
        }
    }

    /// Our band beside brute force with every lane, one exponential per pair, which is timed on a column
    /// of points through the middle and scaled; the band's seconds, too. `None` if the structure is not at hand.
    pub(crate) fn beside_brute_force(&self) -> Result<Option<(String, f64)>, String> {
        let Some(structure) = self.structure()? else {
            return Ok(None);
        };
        let levels = Levels {
            residue_power: self.powers[0],
            chain_power: self.powers[1],
            ..Levels::default()
        };
        let model = Model::uniform(&structure, &levels).map_err(|e| e.to_string())?;
        let options = self.options();
        let (band, seconds) = best(|| sample_band(&model, &options, Run::on(&Cpu)))?;
        let middle = model.center_bounds().center();
        let half = Vector3::new(3.4, 3.4, 31.4) * self.spacing;
        let column = Options {
            bounds: Some(Aabb::new(middle - half, middle + half)),
            ..options
        };
        let (part, part_s) = best(|| thesis::all_atoms(&model, &column))?;
        #[expect(clippy::cast_precision_loss, reason = "counts for people")]
        let (points, of) = (band.report.points as f64, part.report.points as f64);
        let brute = part_s * points / of;
        let line = format!(
            "{}: {} atoms, {:.0} M points, P {} / {}: band {seconds:.3} s; brute force {brute:.0} s ({of} points \
             timed), {:.0}×; thesis {}",
            self.name,
            model.atoms(),
            points * 1e-6,
            self.powers[0],
            self.powers[1],
            brute / seconds,
            self.thesis,
        );
        Ok(Some((line, seconds)))
    }
}

impl Beside<'_> {
    /// One level of Gaussians: our dense lattice and our band against the scatter.
    fn density(
        &mut self,
        name: &str,
        structure: &Structure,
        spacing: f64,
    ) -> Result<ScalarGrid, String> {
        // Powers of 1: the plain sum that the scatter computes.
        let levels = Levels {
            residue_power: 1.0,
            decay: 1.0,
            ..Levels::default()
        };
        let model = Model::uniform(structure, &levels).map_err(|e| e.to_string())?;
        let options = Options {
            spacing,
            max_memory: 16 << 30,
            ..Options::default()
        };
        let (dense, dense_s) = best(|| sample(&model, &options, Run::on(&Cpu)))?;
        let (_, band_s) = best(|| sample_band(&model, &options, Run::on(&Cpu)))?;
        let Sampled { grid, report } = dense;

        let seconds = self.scatter(structure, &grid)?;
        println!(
            "density · {} atoms, {} points: dense {dense_s:.3} s, band {band_s:.3} s; scatter {seconds:.3} s \
         ({:.1}× and {:.1}× ours)",
            structure.atoms().len(),
            report.points,
            seconds / dense_s,
            seconds / band_s,
        );
        self.figures.ratio(
            format!("dense density beside the scatter, {name}"),
            dense_s / seconds,
        );
        self.figures
            .ratio(format!("band beside the scatter, {name}"), band_s / seconds);
        Ok(grid)
    }

    /// Seconds of the scatter of others for the same lattice; an error if it computes another function.
    fn scatter(&self, structure: &Structure, grid: &ScalarGrid) -> Result<f64, String> {
        /// Both cut kernels off, at other places.
        const APART: f64 = 5e-3;
        let atoms = self.folder.join("atoms.f64");
        let bytes: Vec<u8> = structure
            .atoms()
            .iter()
            .flat_map(|a| [a.position.x, a.position.y, a.position.z, a.radius])
            .flat_map(f64::to_le_bytes)
            .collect();
        std::fs::write(&atoms, bytes).map_err(|e| e.to_string())?;
        let lattice = grid.lattice();
        let mut arguments = vec![atoms.display().to_string()];
        arguments.extend(lattice.counts.iter().map(ToString::to_string));
        arguments.extend(lattice.origin.iter().map(ToString::to_string));
        arguments.extend([lattice.spacing, 1.0, CUT].map(|v| v.to_string()));
        arguments.push(self.threads.to_string());
        let peer = answer(self.python, &self.peers.join("scatter.py"), &arguments)?;
        let total: f64 = grid.values().iter().map(|&v| f64::from(v)).sum();
        let apart = number(&peer, "sum")? / total - 1.0;
        if apart.abs() > APART {
            return Err(format!(
                "the scatter is another function: its sum is {apart:.1e} off"
            ));
        }
        number(&peer, "seconds")
    }

    /// The surface of the same dense lattice against flying edges, per triangle.
    fn surface(&mut self, name: &str, grid: &ScalarGrid) -> Outcome {
        let options = dual_contour::Options::default();
        let (ours, ours_s) = best(|| dual_contour::surface(grid, None, &options, Run::on(&Cpu)))?;
        let file = self.folder.join("density.f32");
        let bytes: Vec<u8> = grid.values().iter().flat_map(|v| v.to_le_bytes()).collect();
        std::fs::write(&file, bytes).map_err(|e| e.to_string())?;
        let mut arguments = vec![file.display().to_string()];
        arguments.extend(grid.lattice().counts.iter().map(ToString::to_string));
        arguments.extend(["1".to_string(), self.threads.to_string()]);
        let peer = answer(self.python, &self.peers.join("flying_edges.py"), &arguments)?;
        let (seconds, count) = (number(&peer, "seconds")?, number(&peer, "triangles")?);
        #[expect(clippy::cast_precision_loss, reason = "counts for people")]
        let triangles = ours.mesh.triangles().len() as f64;
        println!(
            "surface · ours {triangles} triangles in {ours_s:.3} s, flying edges {count} in {seconds:.3} s: \
         {:.2}× its time per triangle",
            (ours_s / triangles) / (seconds / count),
        );
        let ratio = (ours_s / triangles) / (seconds / count);
        self.figures.ratio(
            format!("surface beside flying edges, per triangle, {name}"),
            ratio,
        );
        Ok(())
    }
}
