//! Atoms in, closed surface out. `cargo run --release --example surface_of_a_protein`

#![expect(clippy::print_stdout, reason = "the result")]

use gauss_density::{Levels, Model, Options, PointSampler, sample_band};
use geom_core::io::structure::{self, ReadOptions};
use geom_core::{Cpu, Run};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let file = std::env::args().nth(1);
    let file = file.map_or_else(|| fixtures::path("1AJJ.pdb"), Into::into);
    let atoms = structure::read(file, &ReadOptions::default())?.structure;

    let model = Model::uniform(&atoms, &Levels::default())?;
    let options = Options {
        spacing: 0.8,
        ..Options::default()
    };
    let density = sample_band(&model, &options, Run::on(&Cpu))?.grid;

    let exact = PointSampler::new(&model, options.cutoff)?;
    let contour = dual_contour::Options::default();
    let surface = dual_contour::surface(&density, Some(&exact), &contour, Run::on(&Cpu))?.mesh;

    println!(
        "{} triangles, {:.0} Å² around {:.0} Å³",
        surface.triangles().len(),
        surface.area(),
        surface.volume()
    );
    Ok(())
}
