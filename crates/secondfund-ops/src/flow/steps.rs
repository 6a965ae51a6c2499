//! The flow by an operator: `∂x/∂t = −M⁻¹ (K₊ − β K₋) x`, step by step.
//!
//! With `Q = H K / √(K² + δ²) adj(b) / det g` the stiffness of Q applied to the positions is the generalized
//! Giaquinta–Hildebrandt operator of them in weak form: normal and tangential part of Eq. 7.26 together, no
//! third derivatives. It is backward-parabolic where one curvature of a saddle exceeds twice the other, so Q is
//! split by the signs of its eigenvalues; the positive part is taken implicitly. The forces are those of the surface as it
//! is; the matrix that damps the step is only as accurate as stability asks, and serves for some steps
//! ([`FlowOptions::refresh`]), as the frozen Jacobian of Rosenbrock–W methods (Steihaug & Wolfbrandt, *An attempt to avoid
//! exact Jacobian and nonlinear equations in the numerical solution of stiff differential equations*, 1979).

use geom_core::algebra::{Jacobi, SparseMatrix, Symbolic, conjugate_gradients, iterate};
use geom_core::mesh::Halfedges;
use geom_core::{Point3, QuadMesh, Run, TriMesh, Vector3};

use super::guard::{Guard, Shape};
use super::tangential::relaxation;
use super::volume;
use crate::Error;
use crate::backend::{On, OperatorBackend};
use crate::catmull::{Surface, turned};
use crate::forms::{Conductor, Law, Neighbors, Normals, TriangleMatrix};
use crate::operators::{Integrand, Pattern, Quads, UnitScale, triangle_elements, vertex_normals};
use crate::options::{FlowOperator, FlowOptions, Quadrature};

/// No vertex moves farther in a step, in mean edges.
const FARTHEST: f64 = 0.25;
/// What conjugate gradients owe, relative to the right-hand side, and when the factor is cheaper.
const OWED: iterate::Options = iterate::Options {
    tolerance: 1e-7,
    max_iterations: 150,
};
/// Curvature times the mean edge above which a surface is not resolved.
const SHARPEST: f64 = 2.0;

/// A smoothed mesh.
#[derive(Clone, Debug)]
pub struct Smoothed<M> {
    /// The mesh: the same faces, other positions.
    pub mesh: M,
    /// What was done.
    pub report: FlowReport,
}

/// What a flow did.
#[derive(Clone, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct FlowReport {
    /// Steps.
    pub steps: usize,
    /// Root mean square of the distances from the first to the last positions, Å.
    pub rms_displacement: f64,
    /// The largest of them, Å.
    pub max_displacement: f64,
    /// Volume enclosed before and after, Å³; of an open surface it means nothing. Of quads that flow it is the limit
    /// surface's.
    pub volume: [f64; 2],
    /// How often a vertex was held back because a face would have turned over, or come through another.
    pub held_back: usize,
}

impl FlowReport {
    /// Displacements of the vertices.
    pub(super) fn measure(&mut self, first: &[Point3], last: &[Point3]) {
        let squares = last.iter().zip(first).map(|(p, q)| (p - q).norm_squared());
        let (sum, most) = squares.fold((0.0, 0.0), |(s, m): (f64, f64), x| (s + x, m.max(x)));
        self.rms_displacement = (sum / first.len().max(1) as f64).sqrt();
        self.max_displacement = most.sqrt();
    }
}

/// A mesh that flows: what differs between triangles and quads.
trait Flowing {
    /// Stiffness of a law and lumped mass in unit scale, for positions in unit scale.
    fn matrices(
        &self,
        positions: &[Point3],
        conductor: &Conductor,
    ) -> Result<(SparseMatrix, Vec<f64>), Error>;
    /// The stiffness of a law applied to the positions themselves.
    fn forces(&self, positions: &[Point3], conductor: &Conductor) -> Result<Vec<Vector3>, Error>;
    /// The surface as triangles.
    fn triangles(&self, positions: &[Point3]) -> Result<TriMesh, Error>;
    /// Neighbours along edges.
    fn ring(&self) -> &Neighbors;
}

struct Triangles<'a> {
    triangles: &'a [[u32; 3]],
    rounds: u32,
    pattern: Pattern,
    ring: Neighbors,
    run: On<'a>,
}

impl Flowing for Triangles<'_> {
    fn matrices(
        &self,
        positions: &[Point3],
        conductor: &Conductor,
    ) -> Result<(SparseMatrix, Vec<f64>), Error> {
        let mesh = self.triangles(positions)?;
        let normals = vertex_normals(
            &mesh,
            &Normals::OfMesh {
                rounds: self.rounds,
            },
        )?;
        let elements = triangle_elements(
            &mesh,
            &normals,
            &UnitScale::IDENTITY,
            conductor,
            &[],
            self.run,
        )?;
        let mut mass = vec![0.0; positions.len()];
        for (corners, element) in self.triangles.iter().zip(&elements) {
            corners
                .iter()
                .for_each(|&v| mass[v as usize] += element.mass);
        }
        let finite = |e: &TriangleMatrix| e.stiffness.map(|k| if k.is_finite() { k } else { 0.0 });
        let values: Vec<f64> = elements.iter().flat_map(finite).collect();
        Ok((self.pattern.sum(&values), mass))
    }

    fn forces(&self, positions: &[Point3], conductor: &Conductor) -> Result<Vec<Vector3>, Error> {
        let (matrix, _) = self.matrices(positions, conductor)?;
        Ok(vectors(&matrix.multiply(&flattened(positions), 3)))
    }

    fn triangles(&self, positions: &[Point3]) -> Result<TriMesh, Error> {
        Ok(TriMesh::new(positions.to_vec(), self.triangles.to_vec())?)
    }

    fn ring(&self) -> &Neighbors {
        &self.ring
    }
}

struct Patches<'a> {
    surface: Surface,
    quads: Quads,
    pattern: Pattern,
    ring: Neighbors,
    run: On<'a>,
}

impl<'a> Patches<'a> {
    fn of(surface: Surface, quadrature: Quadrature, run: On<'a>) -> Result<Self, Error> {
        let control = surface.control();
        let quads = Quads::of(&surface, quadrature);
        Ok(Self {
            pattern: Pattern::of(control.positions().len(), &quads.elements(&surface))?,
            ring: Neighbors::of_quads(control),
            quads,
            surface,
            run,
        })
    }
}

impl Flowing for Patches<'_> {
    fn matrices(
        &self,
        positions: &[Point3],
        conductor: &Conductor,
    ) -> Result<(SparseMatrix, Vec<f64>), Error> {
        let integrand = integrand(positions, conductor);
        let all = self.quads.matrices(&self.surface, &integrand, self.run)?;
        let mut mass = vec![0.0; positions.len()];
        let elements = self.quads.elements(&self.surface);
        for (&v, sums) in elements.into_iter().flatten().zip(&all.sums) {
            mass[v as usize] += sums[0];
        }
        Ok((self.pattern.sum(&all.stiffness), mass))
    }

    fn forces(&self, positions: &[Point3], conductor: &Conductor) -> Result<Vec<Vector3>, Error> {
        let integrand = integrand(positions, conductor);
        self.quads.forces(&self.surface, &integrand, self.run)
    }

    fn triangles(&self, positions: &[Point3]) -> Result<TriMesh, Error> {
        let quads = self.surface.control().quads().to_vec();
        Ok(QuadMesh::new(self.surface.limit_of(positions), quads)?.into_triangles())
    }

    fn ring(&self) -> &Neighbors {
        &self.ring
    }
}

/// The stiffness of a law alone.
fn integrand<'a>(positions: &'a [Point3], conductor: &Conductor) -> Integrand<'a> {
    Integrand {
        positions,
        factors: &[],
        conductor: *conductor,
        mass: false,
    }
}

/// Moves the vertices of a triangle mesh by the flow of an operator. Curvature from normals smoothed by
/// `rounds` rounds.
///
/// # Errors
/// Options out of range; [`Error::Open`] with [`FlowOptions::keep_volume`]; meshes that are not manifold.
pub fn smooth<B: OperatorBackend + ?Sized>(
    mesh: &TriMesh,
    rounds: u32,
    options: &FlowOptions,
    run: Run<'_, B>,
) -> Result<Smoothed<TriMesh>, Error> {
    smooth_on(mesh, rounds, options, run.with(run.backend.as_operators()))
}

fn smooth_on(
    mesh: &TriMesh,
    rounds: u32,
    options: &FlowOptions,
    run: On<'_>,
) -> Result<Smoothed<TriMesh>, Error> {
    options.check()?;
    let (used, numbers) = mesh.without_unused();
    if numbers.len() < mesh.positions().len() {
        // Vertices of no triangle stay where they are, and have no say.
        let Smoothed { mesh: done, report } = smooth_on(&used, rounds, options, run)?;
        let mut positions = mesh.positions().to_vec();
        for (&v, p) in numbers.iter().zip(done.positions()) {
            positions[v as usize] = *p;
        }
        let mesh = TriMesh::new(positions, mesh.triangles().to_vec())?;
        return Ok(Smoothed { mesh, report });
    }
    let edges = Halfedges::<3>::of(mesh)?;
    let flowing = Triangles {
        triangles: mesh.triangles(),
        rounds,
        pattern: Pattern::of(mesh.positions().len(), mesh.triangles())?,
        ring: Neighbors::of_triangles(mesh),
        run,
    };
    if options.keep_volume {
        volume::refuse_open(mesh.triangles())?;
    }
    let given = (mesh.positions(), mesh.triangles());
    let (positions, report) = flow(&flowing, given, &rims(&edges), options, run)?;
    let mesh = flowing.triangles(&positions)?;
    Ok(Smoothed { mesh, report })
}

/// Moves the control points of a quad mesh by the flow of an operator on its Catmull–Clark limit surface. Where
/// the mesh has to be refined once ([`Surface::refined`]), the refined one comes back.
///
/// # Errors
/// As [`smooth`] and [`Surface::new`].
pub fn smooth_quads<B: OperatorBackend + ?Sized>(
    mesh: &QuadMesh,
    options: &FlowOptions,
    run: Run<'_, B>,
) -> Result<Smoothed<QuadMesh>, Error> {
    smooth_quads_on(mesh, options, run.with(run.backend.as_operators()))
}

fn smooth_quads_on(
    mesh: &QuadMesh,
    options: &FlowOptions,
    run: On<'_>,
) -> Result<Smoothed<QuadMesh>, Error> {
    options.check()?;
    let surface = Surface::new(mesh.clone())?;
    let control = surface.control().clone();
    let edges = Halfedges::<4>::of_quads(&control)?;
    let flowing = Patches::of(surface, options.quadrature, run)?;
    if options.keep_volume {
        volume::refuse_open(control.quads())?;
    }
    let given = (control.positions(), control.quads());
    let (positions, mut report) = flow(&flowing, given, &rims(&edges), options, run)?;
    let mut mesh = QuadMesh::new(positions, control.quads().to_vec())?;
    // One that came inside out goes so.
    if flowing.surface.flipped() {
        mesh = turned(mesh)?;
        report.volume = report.volume.map(|v| -v);
    }
    Ok(Smoothed { mesh, report })
}

/// Which vertices lie on boundaries.
fn rims<const N: usize>(edges: &Halfedges<N>) -> Vec<bool> {
    (0..edges.vertices() as u32)
        .map(|v| edges.on_boundary(geom_core::VertexId(v)))
        .collect()
}

/// All steps; positions come and go in Å.
fn flow<F: Flowing, const N: usize>(
    mesh: &F,
    (start, faces): (&[Point3], &[[u32; N]]),
    rims: &[bool],
    options: &FlowOptions,
    run: On<'_>,
) -> Result<(Vec<Point3>, FlowReport), Error> {
    let scale = UnitScale::of(start)?;
    let mut positions: Vec<Point3> = start.iter().map(|p| scale.apply(p)).collect();
    let volume = mesh.triangles(&positions)?.volume();
    let shape = Shape::unfolded(options.least_angle);
    let mut guard = Guard::of(&positions, faces, shape, options.keep_apart)?;
    let mut implicit = Implicit::default();
    let mut report = FlowReport::default();
    for step in 0..options.iterations {
        run.progress("smoothing", step as u64, options.iterations as u64)?;
        let moves = displacements(mesh, &positions, options, &mut implicit)?;
        let Some(mut moves) = moves else { break };
        if options.keep_rims {
            hold(&mut moves, rims);
        }
        report.held_back += guard.hold_back(&positions, &mut moves)?;
        shift(&mut positions, &moves);
        if options.keep_volume {
            let surface = |x: &[Point3]| mesh.triangles(x);
            report.held_back += volume::restore(&mut positions, volume, surface, &mut guard)?;
        }
        report.steps += 1;
    }
    let cubed = scale.length.powi(3);
    report.volume = [volume * cubed, mesh.triangles(&positions)?.volume() * cubed];
    // What stayed is where it was to the last bit, so that it still fits what it was cut from.
    let back = positions.iter().zip(start).map(|(p, start)| {
        let stayed = *p == scale.apply(start);
        if stayed {
            *start
        } else {
            scale.undo(&p.coords)
        }
    });
    let last: Vec<Point3> = back.collect();
    report.measure(start, &last);
    Ok((last, report))
}

fn hold(moves: &mut [Vector3], rims: &[bool]) {
    for (m, &rim) in moves.iter_mut().zip(rims) {
        if rim {
            *m = Vector3::zeros();
        }
    }
}

fn shift(positions: &mut [Point3], moves: &[Vector3]) {
    positions.iter_mut().zip(moves).for_each(|(p, m)| *p += m);
}

/// What steps hand on to the next.
#[derive(Default)]
struct Implicit {
    frozen: Frozen,
    symbolic: Option<Symbolic>,
}

/// K₊ and the lumped mass of the surface as it was some steps ago.
#[derive(Default)]
struct Frozen {
    matrices: Option<(SparseMatrix, Vec<f64>)>,
    age: usize,
}

impl Frozen {
    /// Matrices that are younger than `refresh` steps.
    fn younger_than(
        &mut self,
        refresh: usize,
        make: impl FnOnce() -> Result<(SparseMatrix, Vec<f64>), Error>,
    ) -> Result<&(SparseMatrix, Vec<f64>), Error> {
        let known = self.matrices.take().filter(|_| self.age < refresh);
        let known = match known {
            Some(known) => known,
            None => {
                self.age = 0;
                make()?
            }
        };
        self.age += 1;
        Ok(self.matrices.insert(known))
    }
}

/// Where a step would bring the vertices; `None` where nothing moves.
fn displacements<F: Flowing>(
    mesh: &F,
    positions: &[Point3],
    options: &FlowOptions,
    implicit: &mut Implicit,
) -> Result<Option<Vec<Vector3>>, Error> {
    let edge = mean_edge(mesh.ring(), positions);
    let conductor = |sharpen| Conductor {
        law: match options.operator {
            FlowOperator::Lbo => Law::Metric,
            FlowOperator::Ggho => Law::Flow,
        },
        gauss: 0.0,
        mean: 0.0,
        bounds: [1.0, 1.0],
        regularization: options.delta.sqrt(),
        limit: SHARPEST / edge,
        sharpen,
    };
    let mut force = mesh.forces(positions, &conductor(options.sharpen))?;
    force.iter_mut().for_each(|f| *f = -*f);
    let diffusing = || mesh.matrices(positions, &conductor(0.0));
    let (forward, mass) = implicit.frozen.younger_than(options.refresh, diffusing)?;
    let fast = fast_speed(&force, mass);
    // Below this all motion is rounding.
    if fast * edge <= 1e-12 {
        return Ok(None);
    }
    let time = options.step * edge / fast;
    let moves = implicit_step(forward, mass, force, time, &mut implicit.symbolic)?;
    let relaxed = if options.tangential > 0.0 {
        relaxation(&mesh.triangles(positions)?, mesh.ring(), positions)
    } else {
        vec![Vector3::zeros(); positions.len()]
    };
    let most = FARTHEST * edge;
    let limited = |(d, along): (&Vector3, &Vector3)| {
        let d = d + along * options.tangential;
        let length = d.norm();
        if length > most {
            d * (most / length)
        } else {
            d
        }
    };
    Ok(Some(moves.iter().zip(&relaxed).map(limited).collect()))
}

/// The speed that one vertex of twenty exceeds.
fn fast_speed(force: &[Vector3], mass: &[f64]) -> f64 {
    let with_mass = force.iter().zip(mass).filter(|(_, m)| **m > 0.0);
    let mut speeds: Vec<f64> = with_mass.map(|(f, m)| f.norm() / m).collect();
    if speeds.is_empty() {
        return 0.0;
    }
    let at = speeds.len() * 95 / 100;
    *speeds.select_nth_unstable_by(at, f64::total_cmp).1
}

/// Implicit Euler: `(m + τ K₊) d = τ (β K₋ − K₊) x` for the displacement d.
fn implicit_step(
    forward: &SparseMatrix,
    mass: &[f64],
    force: Vec<Vector3>,
    time: f64,
    symbolic: &mut Option<Symbolic>,
) -> Result<Vec<Vector3>, Error> {
    let matrix = forward.map(|i, j, k| {
        time * k
            + if i == j {
                mass[i].max(f64::MIN_POSITIVE)
            } else {
                0.0
            }
    });
    let mut wanted: Vec<f64> = force.iter().flat_map(|f| [f.x, f.y, f.z]).collect();
    wanted.iter_mut().for_each(|f| *f *= time);
    let found = conjugate_gradients(&matrix, &Jacobi::of(&matrix)?, &wanted, 3, &OWED)?;
    if found.converged {
        return Ok(vectors(&found.values));
    }
    // A long step is far from the mass.
    let symbolic = match symbolic {
        Some(known) => known,
        None => symbolic.insert(Symbolic::of(&matrix)?),
    };
    symbolic.factor(&matrix)?.solve_in_place(&mut wanted, 3)?;
    Ok(vectors(&wanted))
}

fn flattened(positions: &[Point3]) -> Vec<f64> {
    positions.iter().flat_map(|p| [p.x, p.y, p.z]).collect()
}

fn vectors(flat: &[f64]) -> Vec<Vector3> {
    flat.chunks_exact(3)
        .map(|x| Vector3::new(x[0], x[1], x[2]))
        .collect()
}

fn mean_edge(ring: &Neighbors, positions: &[Point3]) -> f64 {
    let (mut sum, mut count) = (0.0, 0usize);
    for (v, p) in positions.iter().enumerate() {
        for &w in ring.of_vertex(v) {
            sum += (positions[w as usize] - p).norm();
            count += 1;
        }
    }
    sum / count.max(1) as f64
}

/// What holds here, for the tests.
#[cfg(feature = "testing")]
pub(crate) mod laws {
    use super::*;
    use crate::testing::shaken;
    use geom_core::mesh::shapes;

    /// A sphere of radius R moves inwards by `2 H K / √(K² + δ²) · |K|`: 16 for R = ½, on triangles and on quads.
    pub fn a_sphere_shrinks_at_the_speed_of_its_curvatures() {
        let run = Run::on(&geom_core::Cpu as &dyn OperatorBackend);
        let ball = shapes::icosphere(0.5, 4);
        let triangles = Triangles {
            triangles: ball.triangles(),
            rounds: 0,
            pattern: Pattern::of(ball.positions().len(), ball.triangles()).unwrap(),
            ring: Neighbors::of_triangles(&ball),
            run,
        };
        let surface = Surface::interpolating(&shapes::quad_sphere(0.5, 8)).unwrap();
        let control = surface.control().positions().to_vec();
        let quads = Patches::of(surface, Quadrature::default(), run).unwrap();
        let conductor = Conductor {
            law: Law::Flow,
            gauss: 0.0,
            mean: 0.0,
            bounds: [1.0, 1.0],
            regularization: FlowOptions::default().delta.sqrt(),
            limit: f64::INFINITY,
            sharpen: 0.5,
        };
        let of = |mesh: &dyn Flowing, positions: &[Point3]| -> Vec<f64> {
            let (_, mass) = mesh.matrices(positions, &conductor).unwrap();
            let force = mesh.forces(positions, &conductor).unwrap();
            let speed =
                |((f, m), p): ((&Vector3, &f64), &Point3)| f.dot(&p.coords) / m / p.coords.norm();
            force.iter().zip(&mass).zip(positions).map(speed).collect()
        };
        for speeds in [of(&triangles, ball.positions()), of(&quads, &control)] {
            let mean = speeds.iter().sum::<f64>() / speeds.len() as f64;
            assert!((mean / 16.0 - 1.0).abs() < 0.03, "{mean}");
            // Extraordinary vertices are off by a fifth.
            assert!(
                speeds.iter().all(|s| (12.0..19.0).contains(s)),
                "{speeds:?}"
            );
        }
    }

    /// Without its sharpening part a step is implicit Euler for Dirichlet's energy of the coordinates, at any length: the
    /// energy falls, by as much as the motion takes at least.
    pub fn the_energy_of_a_step_that_does_not_sharpen_falls() {
        let mesh = shaken(&shapes::torus(0.4, 0.1, 36, 18), 0.004, 3);
        let flowing = Triangles {
            triangles: mesh.triangles(),
            rounds: 1,
            pattern: Pattern::of(mesh.positions().len(), mesh.triangles()).unwrap(),
            ring: Neighbors::of_triangles(&mesh),
            run: Run::on(&geom_core::Cpu as &dyn OperatorBackend),
        };
        let positions = mesh.positions();
        let edge = mean_edge(&flowing.ring, positions);
        for step in [0.001, 0.02] {
            let options = FlowOptions {
                sharpen: 0.0,
                tangential: 0.0,
                step,
                ..FlowOptions::default()
            };
            let moves =
                displacements(&flowing, positions, &options, &mut Implicit::default()).unwrap();
            let moves = moves.unwrap();
            let farthest = moves.iter().map(|m| m.norm()).fold(0.0, f64::max);
            assert!(farthest > 0.0 && farthest < FARTHEST * edge, "none is cut");
            let conductor = Conductor {
                law: Law::Flow,
                gauss: 0.0,
                mean: 0.0,
                bounds: [1.0, 1.0],
                regularization: options.delta.sqrt(),
                limit: SHARPEST / edge,
                sharpen: 0.0,
            };
            let (stiffness, _) = flowing.matrices(positions, &conductor).unwrap();
            let energy = |share: f64| {
                let x = positions.iter().zip(&moves).flat_map(|(p, m)| {
                    let x = p + m * share;
                    [x.x, x.y, x.z]
                });
                let x: Vec<f64> = x.collect();
                let k = stiffness.multiply(&x, 3);
                x.iter().zip(&k).map(|(x, k)| x * k).sum::<f64>()
            };
            let [before, half, after] = [0.0, 0.5, 1.0].map(energy);
            assert!(after < half && half < before, "{before} {half} {after}");
            // ½ x'Kx' + |x' − x|²/2τ is least at x', so that the slope there is still downwards.
            assert!(energy(1.05) < after, "{after}");
        }
    }
}
