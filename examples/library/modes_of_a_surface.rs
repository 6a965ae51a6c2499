//! A surface in, its Laplace–Beltrami eigenvalues out. `cargo run --release --example modes_of_a_surface`

#![expect(clippy::print_stdout, reason = "the result")]

use geom_core::algebra::eigen::{Options, eigenpairs};
use geom_core::surface::laplace::{lumped_mass, stiffness};
use geom_core::{Cpu, Run, io};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let file = std::env::args().nth(1);
    let file = file.map_or_else(|| fixtures::path("spot.ply"), Into::into);
    let surface = io::mesh::read(file)?.mesh.into_triangles();

    let (stiffness, mass) = (stiffness(&surface)?, lumped_mass(&surface));
    let modes = eigenpairs(&stiffness, &mass, 8, &Options::default(), Run::on(&Cpu))?;

    for (k, value) in modes.values.iter().enumerate() {
        // Without a unit: the same for the same shape of any size.
        println!("λ{} · area = {:.3}", k + 1, value * surface.area());
    }
    Ok(())
}
