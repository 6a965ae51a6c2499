//! Somebody else's program: a screened Poisson problem in a molecule and the water around it, on tetrahedra of
//! `dual-contour` and `tet-quality`, by linear finite elements and the sparse Cholesky factors of faer.
//!
//! −div(ε grad φ) + ε_w κ² [in water] φ = 4π Σ q δ, in kcal/mol/e with lengths in Å. In the molecule φ = G + u, with
//! Coulomb's G = Σ q/(ε_p r) and the reaction u of the water, which has no poles; in the water φ itself is sought. Where
//! the two meet, u = φ − G, and the flux of G is a load (Chern, Liu and Wang, 2003).

use dual_contour::geom_core::io::structure;
use dual_contour::geom_core::mesh::{EXTERIOR, INTERIOR, Interface, OUTSIDE, Region};
use dual_contour::geom_core::{Cpu, Point3, Run, Structure, TetMesh, Vector3};
use dual_contour::{Extent, Method, Outer};
use faer::prelude::Solve;
use faer::sparse::{SparseColMat, Triplet};
use faer::{Col, Side};
use gauss_density::{Levels, Model, PointSampler, sample_band};

type Failure = Box<dyn std::error::Error>;

/// kcal/mol Å/e².
const COULOMB: f64 = 332.063_71;
/// Permittivity of the molecule, and of water.
const MOLECULE: f64 = 2.0;
const WATER: f64 = 78.5;
/// 1/Å: a 1 M solution of a salt.
const KAPPA: f64 = 0.33;

#[derive(Clone, Copy)]
struct Charge {
    place: Point3,
    value: f64,
}

fn main() -> Result<(), Failure> {
    let file = std::env::args().nth(1).ok_or("a structure, please")?;
    sphere()?;
    protein(&file)
}

/// A charge in a ball of 3 Å, at its centre (Born's ion) and off it, against Kirkwood's closed form.
fn sphere() -> Result<(), Failure> {
    let radius = 3.0;
    let ball = Structure::of_spheres([(Point3::origin(), radius)]);
    let mut errors = Vec::new();
    for spacing in [0.75, 0.375] {
        let mesh = mesh(&ball, spacing, 1.0)?;
        for off in [0.0, 1.5] {
            let place = Point3::new(0.0, 0.6 * off, 0.8 * off);
            let charge = Charge { place, value: 1.0 };
            let found = reaction(&mesh, &[charge], radius)?[0];
            let known = kirkwood(radius, off);
            println!(
                "ball, {} tetrahedra, charge {off} Å off its centre: {found:.3}, closed form {known:.3} kcal/mol/e",
                mesh.tets().len()
            );
            errors.push((found / known - 1.0).abs());
        }
    }
    // The first two at the coarse spacing, the others at half of it.
    if errors[2] > 2e-4 || errors[3] > 1e-3 || errors[3] > 0.5 * errors[1] {
        return Err(format!("too far from the closed form: {errors:?}").into());
    }
    Ok(())
}

/// What the water gives to the energy of the charges of a protein's side chains.
fn protein(file: &str) -> Result<(), Failure> {
    let read = structure::read(file, &structure::ReadOptions::default())?.structure;
    let mesh = mesh(&read, 1.2, 1.0)?;
    let charges = side_chains(&read);
    let potential = reaction(&mesh, &charges, 0.0)?;
    let pairs = charges.iter().zip(potential);
    let energy: f64 = pairs.map(|(c, u)| 0.5 * c.value * u).sum();
    println!(
        "{file}, {} tetrahedra, {} charges: {energy:.0} kcal/mol from the water",
        mesh.tets().len(),
        charges.len()
    );
    // Each charge alone in a ball of 2 Å would have −0.5 · 332/2 · (1/2 − 1/78.5), and none more.
    let most = charges.len() as f64 * 0.25 * COULOMB * (1.0 / MOLECULE - 1.0 / WATER);
    if charges.is_empty() || energy >= 0.0 || energy < -10.0 * most {
        return Err(format!("that is no energy of solvation: {energy}").into());
    }
    Ok(())
}

/// Tetrahedra in the molecule and around it, up to a sphere.
fn mesh(structure: &Structure, spacing: f64, scale: f64) -> Result<TetMesh, Failure> {
    let model = Model::uniform(structure, &Levels::default())?;
    let options = gauss_density::Options {
        spacing,
        ..Default::default()
    };
    let density = sample_band(&model, &options, Run::on(&Cpu))?;
    let field = PointSampler::new(&model, options.cutoff)?;
    let asked = dual_contour::Options {
        method: Method::Stuffing,
        region: Extent::Both,
        outer: Outer::Sphere { scale },
        ..Default::default()
    };
    let meshed = dual_contour::volume(&density.grid, Some(&field), &asked, Run::on(&Cpu))?;
    let goals = tet_quality::Options::default();
    let improved = tet_quality::improve(meshed.mesh, Some(&field), &goals, Run::on(&Cpu))?;
    Ok(improved.mesh)
}

/// The reaction of the water at each charge; `radius` is that of a ball to which Debye and Hückel's potential at the
/// outer boundary belongs.
fn reaction(mesh: &TetMesh, charges: &[Charge], radius: f64) -> Result<Vec<f64>, Failure> {
    let known = outer_values(mesh, charges, radius);
    let (jump, flux) = interface(mesh, charges);
    let mut unknown = vec![None; known.len()];
    let free = (0..known.len()).filter(|v| known[*v].is_none());
    let mut count = 0;
    for v in free {
        unknown[v] = Some(count);
        count += 1;
    }
    let mut entries = Vec::new();
    let mut right = Col::<f64>::zeros(count);
    for (v, row) in unknown.iter().enumerate() {
        if let Some(row) = row {
            right[*row] -= flux[v];
        }
    }
    for (t, tet) in mesh.tets().iter().enumerate() {
        let matrix = element_matrix(&mesh.corners(t), mesh.regions()[t]);
        let inside = mesh.regions()[t] == INTERIOR;
        for (a, i) in tet.iter().enumerate() {
            let Some(row) = unknown[*i as usize] else {
                continue;
            };
            for (b, j) in tet.iter().enumerate() {
                let j = *j as usize;
                match (unknown[j], known[j]) {
                    (Some(column), _) => entries.push(Triplet::new(row, column, matrix[a][b])),
                    (None, value) => right[row] -= matrix[a][b] * value.unwrap_or(0.0),
                }
                if inside {
                    right[row] += matrix[a][b] * jump[j];
                }
            }
        }
    }
    let matrix = SparseColMat::<usize, f64>::try_new_from_triplets(count, count, &entries)
        .map_err(|e| format!("{e:?}"))?;
    let factor = matrix
        .sp_cholesky(Side::Lower)
        .map_err(|e| format!("{e:?}"))?;
    let solved = factor.solve(&right);
    // Charges lie in the molecule, where u is asked for.
    let at = |v: usize| unknown[v].map_or(0.0, |row| solved[row]) - jump[v];
    charges
        .iter()
        .map(|c| value_at(mesh, &c.place, &at))
        .collect()
}

/// Where molecule and water meet: per vertex Coulomb's potential, and what its flux through the faces adds to the
/// equations; 0 elsewhere.
fn interface(mesh: &TetMesh, charges: &[Charge]) -> (Vec<f64>, Vec<f64>) {
    let positions = mesh.positions();
    let mut jump = vec![0.0; positions.len()];
    let mut flux = jump.clone();
    let between = |f: &&Interface| f.inside == INTERIOR && f.outside == EXTERIOR;
    for face in mesh.interfaces().iter().filter(between) {
        let corners = face.triangle.map(|v| positions[v as usize]);
        let area = (corners[1] - corners[0]).cross(&(corners[2] - corners[0])) / 2.0;
        // The middles of the sides, exact for quadratics: two functions are ½ there, the third 0.
        for k in 0..3 {
            let middle = corners[k] + (corners[(k + 1) % 3] - corners[k]) / 2.0;
            let (_, slope) = coulomb(&middle, charges);
            let through = MOLECULE * slope.dot(&area) / 3.0;
            for end in [k, (k + 1) % 3] {
                flux[face.triangle[end] as usize] += through / 2.0;
            }
        }
        for (v, x) in face.triangle.iter().zip(&corners) {
            jump[*v as usize] = coulomb(x, charges).0;
        }
    }
    (jump, flux)
}

/// The screened potential at the vertices of the outer boundary.
fn outer_values(mesh: &TetMesh, charges: &[Charge], radius: f64) -> Vec<Option<f64>> {
    let mut values = vec![None; mesh.positions().len()];
    for face in mesh.interfaces().iter().filter(|f| f.outside == OUTSIDE) {
        for v in face.triangle {
            let x = mesh.positions()[v as usize];
            let each = charges.iter().map(|c| {
                let r = (x - c.place).norm();
                let screened = (-KAPPA * (r - radius)).exp() / (WATER * (1.0 + KAPPA * radius));
                COULOMB * c.value / r * screened
            });
            values[v as usize] = Some(each.sum());
        }
    }
    values
}

/// What one tetrahedron adds to the equations.
fn element_matrix(corners: &[Point3; 4], region: Region) -> [[f64; 4]; 4] {
    let (gradients, volume) = gradients(corners);
    let (permittivity, screening) = match region {
        INTERIOR => (MOLECULE, 0.0),
        _ => (WATER, WATER * KAPPA * KAPPA),
    };
    let entry = |a: usize, b: usize| {
        let mass = if a == b { 0.1 } else { 0.05 };
        volume * (permittivity * gradients[a].dot(&gradients[b]) + screening * mass)
    };
    std::array::from_fn(|a| std::array::from_fn(|b| entry(a, b)))
}

/// Coulomb's potential in the molecule's permittivity, and its gradient.
fn coulomb(x: &Point3, charges: &[Charge]) -> (f64, Vector3) {
    charges
        .iter()
        .fold((0.0, Vector3::zeros()), |(value, slope), c| {
            let away = x - c.place;
            let r = away.norm();
            let own = COULOMB * c.value / (MOLECULE * r);
            (value + own, slope - away * (own / (r * r)))
        })
}

/// Gradients of the four linear functions of a tetrahedron, and its volume.
fn gradients(corners: &[Point3; 4]) -> ([Vector3; 4], f64) {
    let [a, b, c] = [1, 2, 3].map(|k| corners[k] - corners[0]);
    let six = a.dot(&b.cross(&c));
    let others = [b.cross(&c) / six, c.cross(&a) / six, a.cross(&b) / six];
    let first = -(others[0] + others[1] + others[2]);
    ([first, others[0], others[1], others[2]], six / 6.0)
}

/// A linear function at a point.
fn value_at(mesh: &TetMesh, x: &Point3, at: &dyn Fn(usize) -> f64) -> Result<f64, Failure> {
    for (t, tet) in mesh.tets().iter().enumerate() {
        let corners = mesh.corners(t);
        let (gradients, _) = gradients(&corners);
        let others = [1, 2, 3].map(|k| gradients[k].dot(&(x - corners[0])));
        let weights = [
            1.0 - others.iter().sum::<f64>(),
            others[0],
            others[1],
            others[2],
        ];
        if weights.iter().all(|w| *w > -1e-9) {
            return Ok((0..4).map(|k| weights[k] * at(tet[k] as usize)).sum());
        }
    }
    Err(format!("no tetrahedron holds {x}").into())
}

/// The reaction at a unit charge `off` Å from the centre of a ball in a screened solvent (Kirkwood, 1934): the terms
/// `B_n r^n` inside and `A_n k_n(κr)` outside meet in potential and flux at the radius.
fn kirkwood(radius: f64, off: f64) -> f64 {
    let x = KAPPA * radius;
    // Modified spherical Bessel functions of the second kind, of order n − 1 and n.
    let (mut before, mut here) = ((-x).exp() / x, (-x).exp() / x);
    let mut sum = 0.0;
    for n in 0..60 {
        let order = f64::from(n);
        let slope = -x * before / here - (order + 1.0);
        let flux = WATER / MOLECULE * slope;
        sum += (off / radius).powi(2 * n) * (flux + order + 1.0) / (order - flux);
        (before, here) = (here, before + (2.0 * order + 1.0) / x * here);
    }
    COULOMB / (MOLECULE * radius) * sum
}

/// Unit charges of acids and bases, each at the atom in the middle of its group.
fn side_chains(structure: &Structure) -> Vec<Charge> {
    let groups = [
        ("ASP", "CG", -1.0),
        ("GLU", "CD", -1.0),
        ("LYS", "NZ", 1.0),
        ("ARG", "CZ", 1.0),
    ];
    let mut charges = Vec::new();
    for (r, residue) in structure.residues().iter().enumerate() {
        for atom in &structure.atoms()[structure.residue_atoms(r)] {
            let group = (residue.name.as_str(), atom.name.as_str());
            let found = groups.iter().find(|(a, b, _)| (*a, *b) == group);
            charges.extend(found.map(|g| Charge {
                place: atom.position,
                value: g.2,
            }));
        }
    }
    charges
}
