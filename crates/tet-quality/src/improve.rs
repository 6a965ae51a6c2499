//! The schedule: smoothing and operations in passes, worst elements first.

use geom_core::mesh::VertexKind;
use geom_core::{ImplicitField, Run, TetMesh};
use rayon::prelude::*;

use crate::backend::QualityBackend;
use crate::contract::contraction;
use crate::input::prepare;
use crate::proposal::{Floor, Operation, Proposal, independent};
use crate::report::{QualityReport, report_of};
use crate::smooth::{SurfaceRules, corners_of, project, relax, relax_surface};
use crate::surface_field::Isosurface;
use crate::swap::{edge_removal, face_swap, surface_flip};
use crate::work::{Freedom, Work};
use crate::{Error, Options};

/// Share of the spacing that surface vertices may be off the isosurface before the rescue passes.
const NEAR: f64 = 0.02;
/// Rounds of the search per vertex and sweep.
const ROUNDS: u32 = 7;
/// Rounds of operations per pass: what is postponed because of its neighbours gets another chance.
const TOPOLOGY_ROUNDS: u32 = 4;

/// What happened in a pass.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Pass {
    /// Smallest objective after the pass: see [`quality`](crate::metrics::quality).
    pub worst: f64,
    /// Moves of vertices inside, on box faces and on plane boundaries.
    pub moved: usize,
    /// Moves of vertices on the isosurface.
    pub slid: usize,
    /// Moves of vertices back to the isosurface.
    pub projected: usize,
    /// Edges removed.
    pub edges_removed: usize,
    /// Faces swapped.
    pub faces_swapped: usize,
    /// Surface edges flipped.
    pub surface_flips: usize,
    /// Edges contracted.
    pub contracted: usize,
    /// Vertices inserted.
    pub inserted: usize,
}

impl Pass {
    fn changes(&self) -> usize {
        self.moved
            + self.slid
            + self.projected
            + self.edges_removed
            + self.faces_swapped
            + self.surface_flips
            + self.contracted
            + self.inserted
    }
}

/// What [`improve`] did.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Report {
    /// Name of the backend.
    pub backend: String,
    /// Quality of the input, its tetrahedra oriented alike.
    pub before: QualityReport,
    /// Quality of the result.
    pub after: QualityReport,
    /// Does every tetrahedron meet the goals?
    pub converged: bool,
    /// What each pass did.
    pub passes: Vec<Pass>,
    /// Tetrahedra of the input whose corners were reordered, because their neighbours said so.
    pub reoriented: usize,
    /// Vertices of the input around which the interface is not one disk; they stay where they are.
    pub junctions: Vec<u32>,
}

/// An improved mesh.
#[derive(Clone, Debug, PartialEq)]
pub struct Improved {
    /// The mesh. Unchanged vertices keep their order; removed ones leave no gap.
    pub mesh: TetMesh,
    /// What was done.
    pub report: Report,
}

/// Improves a tetrahedral mesh: smoothing, swaps, flips and contractions, until the
/// [`Goals`](crate::Goals) are met, nothing changes, or the passes are used up. No operation inverts
/// a tetrahedron or makes the worst of those it touches worse; regions and their interfaces keep
/// their topology; box faces stay plane and box edges straight.
///
/// `field` is the density whose level [`Options::level`] the surface vertices lie on.
pub fn improve<B: QualityBackend + ?Sized>(
    mesh: TetMesh,
    field: Option<&dyn ImplicitField>,
    options: &Options,
    run: Run<'_, B>,
) -> Result<Improved, Error> {
    options.check()?;
    let surface = field.map(|field| Isosurface {
        field,
        level: options.level,
    });
    let input = prepare(mesh, surface.as_ref())?;
    let mut state = State {
        work: input.work,
        surface,
        options,
        spacing: 0.0,
        marks: Vec::new(),
        stamp: 0,
    };
    state.spacing = options.spacing.unwrap_or_else(|| state.surface_spacing());
    let before = state.report(run)?;
    let inverted: Vec<u32> = state.work.below(f64::MIN_POSITIVE);
    if !inverted.is_empty() {
        let mut elements = inverted;
        elements.sort_unstable();
        return Err(Error::StillInverted { elements });
    }
    let mut passes = Vec::new();
    for pass in 0..options.passes {
        run.progress("improve", pass.into(), options.passes.into())?;
        if state.met() {
            break;
        }
        let done = state.pass(pass, run)?;
        passes.push(done);
        if done.changes() == 0 {
            break;
        }
    }
    run.progress("improve", options.passes.into(), options.passes.into())?;
    let after = state.report(run)?;
    let converged = state.met();
    Ok(Improved {
        mesh: state.work.finish(&input.unused),
        report: Report {
            backend: run.backend.name(),
            before,
            after,
            converged,
            passes,
            reoriented: input.reoriented,
            junctions: input.junctions,
        },
    })
}

struct State<'a> {
    work: Work,
    surface: Option<Isosurface<'a>>,
    options: &'a Options,
    spacing: f64,
    marks: Vec<u32>,
    stamp: u32,
}

impl State<'_> {
    /// Median length of the edges of the tetrahedra at surface vertices; of all edges without any.
    fn surface_spacing(&self) -> f64 {
        let lengths = |surface: bool| -> Vec<f64> {
            (0..self.work.tets.len())
                .into_par_iter()
                .flat_map_iter(|t| {
                    let tet = self.work.tets[t];
                    geom_core::mesh::EDGES.iter().filter_map(move |&[i, j]| {
                        let (a, b) = (tet[i] as usize, tet[j] as usize);
                        let both = [a, b]
                            .iter()
                            .all(|&v| self.work.kinds[v] == VertexKind::Surface);
                        (both || !surface).then(|| (self.work.x[a] - self.work.x[b]).norm())
                    })
                })
                .collect()
        };
        let mut all = lengths(true);
        if all.is_empty() {
            all = lengths(false);
        }
        if all.is_empty() {
            return 0.0;
        }
        let middle = all.len() / 2;
        *all.select_nth_unstable_by(middle, f64::total_cmp).1
    }

    fn report<B: QualityBackend + ?Sized>(&self, run: Run<'_, B>) -> Result<QualityReport, Error> {
        let tets: Vec<usize> = (0..self.work.tets.len())
            .filter(|&t| !self.work.is_empty_slot(t as u32))
            .collect();
        let mesh = TetMesh::with_kinds(
            self.work.x.clone(),
            tets.iter().map(|&t| self.work.tets[t]).collect(),
            tets.iter().map(|&t| self.work.regions[t]).collect(),
            self.work.kinds.clone(),
        )
        .expect("the operations keep the mesh valid");
        let measures = run.backend.measure(mesh.positions(), mesh.tets())?;
        Ok(report_of(&mesh, &measures))
    }

    /// The objective at which all goals are met.
    fn goal(&self) -> f64 {
        let g = &self.options.goals;
        g.min_dihedral
            .to_radians()
            .sin()
            .max((180.0 - g.max_dihedral).to_radians().sin())
            .max(crate::metrics::SHAPE_WEIGHT * g.joe_liu)
    }

    fn met(&self) -> bool {
        self.work.worst() >= self.goal()
    }

    fn pass<B: QualityBackend + ?Sized>(
        &mut self,
        number: u32,
        run: Run<'_, B>,
    ) -> Result<Pass, Error> {
        let mut done = Pass::default();
        let rescue = number >= 8;
        let wanted = 30f64.to_radians().sin();
        let wide = 1.1 * wanted;
        self.smooth(wide, rescue, &mut done, run)?;
        for round in 0..TOPOLOGY_ROUNDS {
            let changed = self.operate(wanted, number > 0, &mut done);
            if changed == 0 {
                break;
            }
            let _ = round;
        }
        self.smooth(wide, rescue, &mut done, run)?;
        if let Some(surface) = &self.surface {
            let near = NEAR * self.spacing;
            let all: Vec<u32> = (0..self.work.x.len() as u32)
                .filter(|&v| self.work.freedom[v as usize] == Freedom::Field)
                .collect();
            let goal = 1.1 * 20f64.to_radians().sin();
            done.projected += project(&mut self.work, &all, surface, near, goal);
            self.work.measure_all();
        }
        done.worst = self.work.worst();
        Ok(done)
    }

    fn smooth<B: QualityBackend + ?Sized>(
        &mut self,
        bound: f64,
        rescue: bool,
        done: &mut Pass,
        run: Run<'_, B>,
    ) -> Result<(), Error> {
        let bad = self.work.below(bound);
        let vertices = corners_of(&self.work, &bad);
        done.moved += relax(&mut self.work, &vertices, ROUNDS, None, run)?;
        if let Some(field) = &self.surface {
            let share = if rescue { self.options.deviation } else { NEAR };
            let rules = SurfaceRules {
                field,
                tolerance: share * self.spacing,
                rescue,
            };
            done.slid += relax_surface(&mut self.work, &vertices, &rules);
        }
        self.work.measure_all();
        Ok(())
    }

    /// One round of operations on the tetrahedra below `bound`: all are judged side by side, those
    /// that do not meet are carried out.
    fn operate(&mut self, bound: f64, contract: bool, done: &mut Pass) -> usize {
        let bad = self.work.below(bound);
        let state = &*self;
        let proposals: Vec<(u32, Proposal)> = bad
            .par_iter()
            .with_min_len(16)
            .filter_map(|&t| Some((t, state.best_for(t, contract)?)))
            .collect();
        self.marks.resize(self.work.x.len(), 0);
        self.stamp += 1;
        let (chosen, _) = independent(proposals, &mut self.marks, self.stamp);
        for proposal in &chosen {
            proposal.apply(&mut self.work);
            *match proposal.operation {
                Operation::EdgeRemoval => &mut done.edges_removed,
                Operation::FaceSwap => &mut done.faces_swapped,
                Operation::SurfaceFlip => &mut done.surface_flips,
                Operation::Contraction => &mut done.contracted,
                Operation::Insertion => &mut done.inserted,
            } += 1;
        }
        chosen.len()
    }

    /// The best operation that replaces a tetrahedron.
    fn best_for(&self, t: u32, contract: bool) -> Option<Proposal> {
        let (work, allow) = (&self.work, &self.options.operations);
        let tet = work.tets[t as usize];
        let field = self.surface.as_ref();
        let mut best: Option<Proposal> = None;
        let mut offer = |p: Option<Proposal>| {
            if let Some(p) = p
                && best.as_ref().is_none_or(|b| p.gain > b.gain)
            {
                best = Some(p);
            }
        };
        for [i, j] in geom_core::mesh::EDGES {
            let (a, b) = (tet[i], tet[j]);
            if allow.swap {
                offer(edge_removal(work, a, b, Floor::Old));
            }
            let both = [a, b]
                .iter()
                .all(|&v| work.freedom[v as usize] != Freedom::Free);
            if allow.flip && both {
                offer(surface_flip(
                    work,
                    a,
                    b,
                    field,
                    0.1 * self.spacing,
                    Floor::Old,
                ));
            }
        }
        if allow.swap {
            for k in 0..4 {
                offer(face_swap(work, t, k, Floor::Old));
            }
        }
        if allow.contract && contract {
            for i in 0..4 {
                for j in 0..4 {
                    if i != j {
                        offer(contraction(
                            work,
                            tet[i],
                            tet[j],
                            field,
                            0.15 * self.spacing,
                            Floor::Old,
                        ));
                    }
                }
            }
        }
        best
    }
}
