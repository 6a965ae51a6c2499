//! Control points by which a surface lies on another: least squares over the nearest points, again and again.
//!
//! Which point of a surface a control point should come near to depends on where the surface is. So two steps take turns: with the
//! surface held, each sample's parameters are those of its nearest point; with the parameters held, control points are the least
//! squares solution of a sparse system. A little bending energy of the change keeps the system regular where
//! samples leave control points undetermined; that of the surface itself would draw it inwards.

use geom_core::algebra::quadrature::gauss;
use geom_core::algebra::{self, Cholesky, SparseMatrix, iterate};
use geom_core::options::{OutOfRange, require};
use geom_core::search::bvh::TriangleTree;
use geom_core::{Point3, Run, TriMesh, VertexId};
use rayon::prelude::*;

use super::basis::Local;
use super::bezier::bernstein;
use super::inverse::Search;
use super::seams::Seams;
use super::{Jet, POINTS, Surface};
use crate::Error;
use crate::backend::{On, SplineBackend};

/// What a surface is fitted to.
pub trait Target: Sync {
    /// The nearest point.
    fn closest(&self, to: &Point3) -> Point3;
    /// The nearest point of its boundary, if it has one.
    fn closest_on_rim(&self, _to: &Point3) -> Option<Point3> {
        None
    }
    /// Points of it to which the surface must come, too, each with its share of the area, Å²: none if the nearest points
    /// of the surface's samples tell all.
    fn samples(&self) -> &[(Point3, f64)] {
        &[]
    }
}

/// A triangle mesh to fit to: its surface and its rim.
#[derive(Clone, Debug)]
pub struct MeshTarget {
    /// Of its triangles.
    tree: TriangleTree,
    /// Of its boundary edges; `None` for a closed mesh.
    rim: Option<TriangleTree>,
    /// Its vertices, each with a third of the area of the triangles around it.
    samples: Vec<(Point3, f64)>,
}

impl MeshTarget {
    /// Of a mesh.
    ///
    /// Edges are a boundary where one triangle has them; the mesh need not be a manifold otherwise.
    ///
    /// # Errors
    /// [`Error::Tree`] for a mesh of no triangles.
    pub fn new(mesh: &TriMesh) -> Result<Self, Error> {
        let tree = TriangleTree::new(mesh)?;
        // Edges of one triangle, as triangles without area, of which the tree makes segments.
        let mut edges: Vec<([u32; 2], [u32; 2])> = mesh
            .triangles()
            .iter()
            .flat_map(|&[a, b, c]| [[a, b], [b, c], [c, a]])
            .map(|[a, b]| ([a.min(b), a.max(b)], [a, b]))
            .collect();
        edges.par_sort_unstable();
        let single = edges.chunk_by(|a, b| a.0 == b.0).filter(|g| g.len() == 1);
        let points: Vec<Point3> = single
            .flat_map(|g| [g[0].1[0], g[0].1[1], g[0].1[1]])
            .map(|v| mesh.positions()[v as usize])
            .collect();
        let flat = (0..points.len() as u32 / 3).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]);
        let rim = TriMesh::new(points.clone(), flat.collect())?;
        let rim = (!points.is_empty()).then(|| TriangleTree::new(&rim));
        let mut samples: Vec<(Point3, f64)> = mesh.positions().iter().map(|p| (*p, 0.0)).collect();
        for (t, corners) in mesh.triangles().iter().enumerate() {
            let third = mesh.doubled_area_normal(t).norm() / 6.0;
            corners.iter().for_each(|&v| samples[v as usize].1 += third);
        }
        Ok(Self {
            samples,
            tree,
            rim: rim.transpose()?,
        })
    }

    /// Its tree.
    pub fn tree(&self) -> &TriangleTree {
        &self.tree
    }
}

impl Target for MeshTarget {
    fn closest(&self, to: &Point3) -> Point3 {
        self.tree.closest(to).point
    }
    fn closest_on_rim(&self, to: &Point3) -> Option<Point3> {
        self.rim.as_ref().map(|tree| tree.closest(to).point)
    }
    fn samples(&self) -> &[(Point3, f64)] {
        &self.samples
    }
}

/// Options of [`fit`].
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct FitOptions {
    /// Rounds of nearest points and least squares, 1…50.
    /// More bring the parameters nearer to those of the nearest points. The first round has the target's nearest points
    /// alone.
    pub rounds: u32,
    /// Gauss points per direction and patch, 2…8.
    /// 4 × 4 determine a bicubic patch, and cost four times as many nearest points as 2. Areas and weights are taken at
    /// these points, too.
    pub samples: usize,
    /// How much bending counts beside distance, 0…1. Where samples leave control points undetermined, what changes bends little
    /// whatever this is.
    /// Relative to the mean area of a patch. Larger ones even out noise of the target, and flatten what bulges.
    pub smoothing: f64,
}

impl Default for FitOptions {
    fn default() -> Self {
        Self {
            rounds: 5,
            samples: 4,
            smoothing: 0.0,
        }
    }
}

impl FitOptions {
    /// Refuses values out of range.
    pub fn check(&self) -> Result<(), OutOfRange> {
        let within = (1..=50).contains(&self.rounds);
        require(within, "rounds", self.rounds, "lie within 1…50")?;
        let within = (2..=8).contains(&self.samples);
        require(within, "samples", self.samples, "lie within 2…8")?;
        let share = (0.0..=1.0).contains(&self.smoothing);
        require(share, "smoothing", self.smoothing, "lie within 0…1")
    }
}

/// How much the bending of what a round changes counts beside distance: enough to keep the equations regular.
const CHANGE: f64 = 1e-6;
/// How much where a control point is counts beside the mean of what determines one, where nothing determines some.
const HOLD: f64 = 1e-9;

/// How a fit went.
#[derive(Clone, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct FitReport {
    /// Root of the mean squared distance of the samples from their nearest points before each round, Å, and after the
    /// last.
    pub rms: Vec<f64>,
}

/// Moves the control points of a surface so that it comes as near to the target as its basis allows: weighted least
/// squares over Gauss points of the surface with the nearest points of the target, and over samples of the target with
/// the nearest points of the surface, both taken anew in each round. The latter let it grow into what it does not reach.
///
/// A round is a nearest point for each sample, the assembly of a sparse matrix with a row per function, and a solve: by
/// the factor of the matrix without samples of the target, which is made once, and as a preconditioner serves all
/// rounds. Rounds are not checked for convergence: [`FitReport::rms`] shows how they went.
///
/// # Errors
/// [`Error::Option`], [`Error::Matrix`], those of the backend.
pub fn fit<B: SplineBackend + ?Sized>(
    surface: &mut Surface,
    target: &dyn Target,
    options: &FitOptions,
    run: Run<'_, B>,
) -> Result<FitReport, Error> {
    fit_on(surface, target, options, run.with(run.backend.as_spline()))
}

fn fit_on(
    surface: &mut Surface,
    target: &dyn Target,
    options: &FitOptions,
    run: On<'_>,
) -> Result<FitReport, Error> {
    options.check()?;
    let plan = Plan::new(surface, target, options, run)?;
    let free = plan.matrix(surface, &[])?;
    // At a rim that goes in steps functions may depend on each other: there control points are held a little to where they are.
    let (alone, factor, hold) = match Cholesky::of(&free) {
        Ok(factor) => (free, factor, 0.0),
        Err(algebra::Error::NotPositiveDefinite { .. }) => {
            let trace: f64 = free.diagonal().iter().sum();
            let hold = HOLD * trace / free.rows() as f64;
            let held = held(&free, hold);
            let factor = Cholesky::of(&held)?;
            (held, factor, hold)
        }
        Err(error) => return Err(error.into()),
    };
    let mut report = FitReport::default();
    for round in 0..options.rounds {
        run.progress("fit", round.into(), options.rounds.into())?;
        // At first the surface is to come near at all.
        let back = match round {
            0 => Vec::new(),
            _ => plan.back(surface, target)?,
        };
        let (mut right, rms) = plan.right_side(surface, target, &back, run)?;
        let now = surface.controls().iter().flat_map(|c| [c.x, c.y, c.z]);
        right.iter_mut().zip(now).for_each(|(r, c)| *r += hold * c);
        report.rms.push(rms);
        let refined = iterate::Options {
            tolerance: 1e-10,
            max_iterations: 400,
        };
        let found = if back.is_empty() {
            iterate::refine(&alone, &factor, &right, 3, &refined)?
        } else {
            // Of the same pattern and much like it.
            let matrix = held(&plan.matrix(surface, &back)?, hold);
            iterate::conjugate_gradients(&matrix, &factor, &right, 3, &refined)?
        };
        let controls = found
            .values
            .chunks_exact(3)
            .map(|p| Point3::new(p[0], p[1], p[2]));
        surface.set_controls(controls.collect(), run)?;
    }
    report
        .rms
        .push(plan.right_side(surface, target, &[], run)?.1);
    Ok(report)
}

/// A matrix with so much more on its diagonal.
fn held(matrix: &SparseMatrix, hold: f64) -> SparseMatrix {
    matrix.map(|i, j, a| if i == j { a + hold } else { a })
}

/// What stays the same in all rounds.
struct Plan {
    parameters: Vec<f64>,
    /// Bernstein polynomials per sample of a patch.
    /// In the order of samples: the first parameter runs fastest.
    table: Vec<[f64; POINTS]>,
    /// Weights of the samples, patch after patch: area.
    weights: Vec<f64>,
    /// Samples on the rim.
    /// Few of them, but of great weight, since nothing beyond a boundary holds it otherwise.
    rim: Vec<Place>,
    /// The matrices of the patches.
    /// Of samples, rim and bending together, in Bernstein polynomials: what the normal equations are without samples of
    /// the target.
    locals: Vec<Local>,
    /// The part of them that is for what a round changes.
    change: Local,
}

/// A single place on the surface: its patch, parameters, polynomials and weight, and where it goes, if that is known.
struct Place {
    patch: usize,
    at: [f64; 2],
    basis: [f64; POINTS],
    weight: f64,
    to: Option<Point3>,
}

impl Plan {
    /// Samples, weights and matrices of a surface as it lies before the fit; they stay as it moves, like the parameters
    /// of the samples.
    fn new(
        surface: &Surface,
        target: &dyn Target,
        options: &FitOptions,
        run: On<'_>,
    ) -> Result<Self, Error> {
        let rule = gauss(options.samples);
        let parameters: Vec<f64> = rule.iter().map(|r| r.0).collect();
        let samples = surface.sample_on(&parameters, run)?;
        let (mut table, mut shares) = (Vec::new(), Vec::new());
        for &(t, wt) in &rule {
            for &(s, ws) in &rule {
                table.push(tensor([s, t]));
                shares.push(ws * wt);
            }
        }
        let per = table.len();
        let weights: Vec<f64> = (samples.iter().enumerate())
            .map(|(i, sample)| sample.area * shares[i % per])
            .collect();
        let rim = rim_samples(surface, target, &rule);
        let mut locals: Vec<Local> = (weights.par_chunks(per))
            .enumerate()
            .with_min_len(64)
            .map(|(patch, weights)| {
                let mut local = [[0.0; POINTS]; POINTS];
                for (b, w) in table.iter().zip(weights) {
                    add_square(&mut local, &surface.functions_at(patch, b), *w);
                }
                local
            })
            .collect();
        for sample in &rim {
            add_square(&mut locals[sample.patch], &sample.basis, sample.weight);
        }
        // Bending by unit of area of parameters, over the mean patch.
        let mean = weights.iter().sum::<f64>() / locals.len().max(1) as f64;
        let bending = bending();
        for local in &mut locals {
            for (row, bend) in local.iter_mut().zip(&bending) {
                for (out, b) in row.iter_mut().zip(bend) {
                    *out += options.smoothing * mean * b;
                }
            }
        }
        let change = bending.map(|row| row.map(|b| CHANGE * mean * b));
        for (out, b) in locals.iter_mut().flatten().zip(change.iter().cycle()) {
            out.iter_mut().zip(b).for_each(|(out, b)| *out += b);
        }
        Ok(Self {
            parameters,
            table,
            weights,
            rim,
            locals,
            change,
        })
    }

    /// The normal equations, with those of some places more.
    fn matrix(&self, surface: &Surface, back: &[Place]) -> Result<SparseMatrix, Error> {
        let mut locals = self.locals.clone();
        for place in back {
            add_square(&mut locals[place.patch], &place.basis, place.weight);
        }
        Ok(surface.extraction().gram(&locals)?)
    }

    /// The places of the surface that are nearest to the samples of the target.
    fn back(&self, surface: &Surface, target: &dyn Target) -> Result<Vec<Place>, Error> {
        let samples = target.samples();
        if samples.is_empty() {
            return Ok(Vec::new());
        }
        let search = Search::new(surface)?;
        let places = samples.par_iter().with_min_len(64).map(|&(to, weight)| {
            let near = search.nearest(&to);
            let patch = near.patch as usize;
            Place {
                patch,
                at: near.at,
                basis: surface.functions_at(patch, &tensor(near.at)),
                weight,
                to: Some(to),
            }
        });
        Ok(places.collect())
    }

    /// The right-hand side for the nearest points of the surface as it is, and how far away they are.
    fn right_side(
        &self,
        surface: &Surface,
        target: &dyn Target,
        back: &[Place],
        run: On<'_>,
    ) -> Result<(Vec<f64>, f64), Error> {
        let samples = surface.sample_on(&self.parameters, run)?;
        let per = self.table.len();
        let parts: Vec<([[f64; 3]; POINTS], f64)> = samples
            .par_chunks(per)
            .zip(self.weights.par_chunks(per))
            .enumerate()
            .with_min_len(16)
            .map(|(patch, (samples, weights))| {
                let (mut local, mut squares) = ([[0.0; 3]; POINTS], 0.0);
                for ((sample, w), b) in samples.iter().zip(weights).zip(&self.table) {
                    let q = target.closest(&sample.point);
                    squares += w * (q - sample.point).norm_squared();
                    add_point(&mut local, &surface.functions_at(patch, b), *w, &q);
                }
                // Nothing bends if nothing changes.
                for (out, row) in local.iter_mut().zip(&self.change) {
                    for (point, b) in surface.patches()[patch].iter().zip(row) {
                        out.iter_mut().zip(point).for_each(|(o, c)| *o += b * c);
                    }
                }
                (local, squares)
            })
            .collect();
        let total: f64 = self.weights.iter().sum();
        let squares: f64 = parts.iter().map(|p| p.1).sum();
        let mut locals: Vec<_> = parts.into_iter().map(|p| p.0).collect();
        for place in self.rim.iter().chain(back) {
            let here = Jet::of(&surface.patches()[place.patch], place.at).point;
            let there = place.to.or_else(|| target.closest_on_rim(&here));
            let (b, w) = (&place.basis, place.weight);
            add_point(&mut locals[place.patch], b, w, &there.unwrap_or(here));
        }
        let right = surface.extraction().gather(&locals);
        Ok((right, (squares / total).sqrt()))
    }
}

/// The 16 polynomials of a patch at a place.
pub(crate) fn tensor([s, t]: [f64; 2]) -> [f64; POINTS] {
    let (a, b) = (bernstein(s)[0], bernstein(t)[0]);
    std::array::from_fn(|k| a[k % 4] * b[k / 4])
}

/// Adds `w b bᵀ`.
fn add_square(local: &mut Local, b: &[f64; POINTS], weight: f64) {
    for (row, x) in local.iter_mut().zip(b) {
        for (out, y) in row.iter_mut().zip(b) {
            *out += weight * x * y;
        }
    }
}

/// Adds `w b qᵀ`: what a sample of these polynomials that is to come to q has on the right-hand side.
fn add_point(local: &mut [[f64; 3]; POINTS], b: &[f64; POINTS], weight: f64, q: &Point3) {
    for (row, x) in local.iter_mut().zip(b) {
        for (out, c) in row.iter_mut().zip(q.iter()) {
            *out += weight * x * c;
        }
    }
}

/// `∫ f_ss g_ss + 2 f_st g_st + f_tt g_tt` of the 16 polynomials over the unit square.
fn bending() -> Local {
    let mut local = [[0.0; POINTS]; POINTS];
    for &(t, wt) in &gauss(4) {
        for &(s, ws) in &gauss(4) {
            let (a, b) = (bernstein(s), bernstein(t));
            for (i, j, factor) in [(2, 0, 1.0), (1, 1, 2.0), (0, 2, 1.0)] {
                let second: [f64; POINTS] = std::array::from_fn(|k| a[i][k % 4] * b[j][k / 4]);
                add_square(&mut local, &second, factor * ws * wt);
            }
        }
    }
    local
}

/// Gauss points along the boundary and its corners, weighted as if they stood for half a patch beyond it.
fn rim_samples(surface: &Surface, target: &dyn Target, rule: &[(f64, f64)]) -> Vec<Place> {
    let seams = Seams::of(surface);
    let edges = surface.mesh().fine_edges();
    let mut out = Vec::new();
    let mut sample = |patch: usize, at: [f64; 2], share: f64, corner| {
        let jet = Jet::of(&surface.patches()[patch], at);
        out.push(Place {
            patch,
            at,
            basis: surface.functions_at(patch, &tensor(at)),
            weight: share * jet.area_vector().norm(),
            to: corner,
        });
    };
    for segment in seams.segments.iter().filter(|s| s.other.is_none()) {
        let patch = segment.owner.patch as usize;
        for &(u, w) in rule {
            sample(patch, segment.owner.at(u), w, None);
        }
        let fine = seams.corners[segment.ends[0] as usize];
        if edges.around(VertexId(fine)).count() == 1 {
            let place = surface.mesh().fine().positions()[fine as usize];
            let place = target.closest_on_rim(&place).unwrap_or(place);
            sample(patch, segment.owner.at(0.0), 1.0, Some(place));
        }
    }
    out
}
