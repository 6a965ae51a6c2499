//! Somebody else's program: a protein's pockets and parts, and where its points go when it is turned.

use gauss_density::{Levels, Model, PointSampler, sample, sample_band};
use secondfund_ops::geom_core::io::structure::{self, ReadOptions};
use secondfund_ops::geom_core::{Cpu, Point3, Run, Structure, TriMesh};
use secondfund_ops::segment::parts;
use secondfund_ops::{Element, Faces, Normals, PartOptions, PocketOptions, pockets};
use spectral_corresp::{MatchOptions, ShapeOptions, Truth, Verdict, VoxelShape, correspond};

type Failure = Box<dyn std::error::Error>;

fn main() -> Result<(), Failure> {
    let file = std::env::args().nth(1).ok_or("a structure, please")?;
    let atoms = structure::read(&file, &ReadOptions::default())?.structure;

    let surface = surface(&atoms)?;
    let found = pockets::find(&atoms, &PocketOptions::default())?;
    let (normals, faces) = (Normals::OfMesh { rounds: 3 }, Faces::from(&surface));
    let element = Element::Triangles(&surface, &normals);
    let cut = parts(&element, &faces, &PartOptions::default(), Run::on(&Cpu))?;
    let (groups, triangles) = (cut.areas.len(), surface.triangles().len());
    println!(
        "{} pockets, {groups} parts of {triangles} triangles",
        found.pockets.len()
    );
    let first = found.pockets.first().ok_or("no pocket")?;
    if groups < 2 || first.residues.is_empty() {
        return Err("a protein has parts, and its pocket is lined by residues".into());
    }

    // A third of a turn about a diagonal, and a step.
    let moved = |p: &Point3| Point3::new(p.y + 5.0, p.z - 3.0, p.x);
    let mut turned = atoms.clone();
    for atom in turned.atoms_mut() {
        atom.position = moved(&atom.position);
    }
    let [here, there] = [shape(&atoms)?, shape(&turned)?];
    let matched = correspond(&here, &there, &MatchOptions::default(), Run::on(&Cpu))?;
    let places = |s: &Structure| s.atoms().iter().map(|a| a.position).collect::<Vec<_>>();
    let radii: Vec<f64> = atoms.atoms().iter().map(|a| a.radius).collect();
    let truth = Truth::new(&places(&atoms), &radii, &places(&turned))?;
    let judged = truth.judge(&here, &there, &matched.forward)?;
    println!(
        "{:?}, partners {:.2} Å from where they should be",
        matched.verdict, judged.mean
    );
    if matched.verdict != Verdict::Good || judged.mean > 1.5 {
        return Err("a protein that is only turned was not recognized".into());
    }
    Ok(())
}

/// The level set of the density, fine enough for pockets.
fn surface(atoms: &Structure) -> Result<TriMesh, Failure> {
    let model = Model::uniform(atoms, &Levels::default())?;
    let options = gauss_density::Options {
        spacing: 1.0,
        ..Default::default()
    };
    let density = sample_band(&model, &options, Run::on(&Cpu))?;
    let field = PointSampler::new(&model, options.cutoff)?;
    let asked = dual_contour::Options::default();
    Ok(dual_contour::surface(&density.grid, Some(&field), &asked, Run::on(&Cpu))?.mesh)
}

/// Lattice points inside, coarse enough that side chains do not matter.
fn shape(atoms: &Structure) -> Result<VoxelShape, Failure> {
    let model = Model::uniform(
        atoms,
        &Levels {
            decay: 0.3,
            ..Levels::default()
        },
    )?;
    let options = gauss_density::Options {
        spacing: 1.5,
        ..Default::default()
    };
    let density = sample(&model, &options, Run::on(&Cpu))?;
    Ok(VoxelShape::of_grid(
        &density.grid,
        1.0,
        &ShapeOptions::default(),
        Run::on(&Cpu),
    )?)
}
