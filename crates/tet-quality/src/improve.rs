//! The schedule: smoothing and operations in passes, worst elements first.

use geom_core::mesh::VertexKind;
use geom_core::{ImplicitField, Run, TetMesh};
use rayon::prelude::*;

use crate::backend::QualityBackend;
use crate::boundary::field::Isosurface;
use crate::boundary::input::{free_again, prepare};
use crate::boundary::own::OwnSurface;
use crate::measure::metrics::quality;
use crate::measure::report::{QualityReport, report_of};
use crate::measure::unmet::{Exceptions, SurfaceFit, exceptions, surface_fit};
use crate::mesh::editable::{Freedom, NO_COLOUR, Work};
use crate::operations::operate::{Memory, Rules, best_climb, best_for, round_of_pushes, rounds};
use crate::operations::patch::{Effort, push};
use crate::operations::untangle::untangle;
use crate::smoothing::flow::flow;
use crate::smoothing::smooth::{
    SurfaceRules, corners_of, foot, load, project, relax, relax_surface,
};
use crate::smoothing::star::Ring;
use crate::{Error, Measures, Options, SurfaceMotion, measures};

/// Share of the spacing that surface vertices may be off the isosurface before the rescue passes.
const NEAR: f64 = 0.02;
/// Rounds of the search per vertex and sweep.
const ROUNDS: u32 = 7;
/// Most rounds of operations per pass: what is postponed because of its neighbours gets another chance.
const PLAIN_ROUNDS: u32 = 16;
/// The same with smoothing.
const CLIMB_ROUNDS: u32 = 16;
/// The first passes work on all tetrahedra below [`WANTED`], the later ones on those below the goals.
const BROAD: u32 = 3;
/// From this pass on, directions are random and surface vertices may use the allowed deviation.
const RESCUE: u32 = 6;
/// From this pass on, nothing is spared for the last ones.
const LAST: u32 = 8;
/// How many are few enough for that.
const FEW: usize = 100;
/// Angle that the first passes aim at, degrees: they raise the many, not only the worst.
const WANTED: f64 = 30.0;
/// Objectives down to which the first passes bring surface vertices to the isosurface.
const FLOORS: [f64; 5] = [0.05, 0.1, 0.2, 0.25, 0.3];
/// Share of the surface vertices that may stay farther from the isosurface than allowed.
const ENOUGH: f64 = 5e-4;
/// Most rounds of bringing surface vertices to the isosurface after the passes.
const SETTLE: u32 = 6;

/// What happened in a pass.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Pass {
    /// Smallest objective after the pass: see [`quality`](crate::measure::metrics::quality).
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
    /// Inverted and flat tetrahedra of the input that were untangled.
    pub untangled: usize,
    /// Moves of the averaged mean curvature flow.
    pub flowed: usize,
    /// Tetrahedra that do not meet the goals, and why.
    pub exceptions: Exceptions,
    /// How well the surface vertices lie on the isosurface.
    pub surface: SurfaceFit,
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
/// their topology; box faces stay plane and box edges straight; a cavity that is not meshed keeps at
/// least a quarter of its volume, so that its wall does not turn inside out. Walls of gaps that are
/// not meshed may cross unless [`Options::keep_apart`] is set.
///
/// `field` is the density whose level [`Options::level`] the surface vertices lie on. A mesh of which
/// nothing else is known can move along its own surfaces: [`SurfaceMotion::AlongInput`].
pub fn improve<B: QualityBackend + ?Sized>(
    mesh: TetMesh,
    field: Option<&dyn ImplicitField>,
    options: &Options,
    run: Run<'_, B>,
) -> Result<Improved, Error> {
    options.check()?;
    let along_input = options.surface == SurfaceMotion::AlongInput;
    if along_input && field.is_some() {
        return Err(Error::InvalidOption {
            option: "surface",
            value: "AlongInput".to_owned(),
            must: "Tangential where there is a field",
        });
    }
    let mut surface = field.map(|field| Isosurface {
        field,
        level: options.level,
        own: false,
    });
    let mut input = prepare(mesh, surface.as_ref())?;
    let own = along_input.then(|| OwnSurface::of(&input.work)).flatten();
    if let Some(own) = &own {
        surface = Some(Isosurface {
            field: own,
            level: 0.0,
            own: true,
        });
        free_again(&mut input.work, surface.as_ref())?;
    }
    let mut state = State::new(input.work, surface, options);
    if options.surface == SurfaceMotion::Fixed {
        state.fix_surface();
    }
    state.work.guard_walls();
    let before = state.report(run)?;
    let inverted = state.work.below(f64::MIN_POSITIVE).len();
    if inverted > 0 && options.untangle {
        state.look_across();
        untangle(&mut state.work, run)?;
    }
    let mut elements = state.work.below(f64::MIN_POSITIVE);
    if !elements.is_empty() {
        elements.sort_unstable();
        return Err(Error::StillInverted { elements });
    }
    let flowed = match options.surface {
        SurfaceMotion::AveragedMeanCurvature { steps, step } => {
            let work = &mut state.work;
            let moved = flow(work, &input.junctions, state.spacing, steps, step);
            free_again(work, state.surface.as_ref())?;
            moved
        }
        SurfaceMotion::Fixed | SurfaceMotion::Tangential | SurfaceMotion::AlongInput => 0,
    };
    let mut passes = Vec::new();
    let mut far = usize::MAX;
    for pass in 0..options.passes {
        run.progress("improve", pass.into(), options.passes.into())?;
        if state.met() && pass == 0 {
            break;
        }
        let mut done = state.pass(pass, run)?;
        let last = pass + 1 == options.passes || done.changes() == 0;
        let mut enough = last;
        // The reserve is worth the usual passes only.
        let met = state.met();
        if last || met || (pass >= LAST && state.goals_met()) {
            let allowed = ENOUGH * state.on_field() as f64;
            let mut left = usize::MAX;
            if met {
                left = state.settle(true, &mut done);
            }
            // A share of the vertices is not worth the reserve of all tetrahedra.
            if left as f64 > allowed {
                left = state.settle(false, &mut done);
            }
            enough |= left as f64 <= allowed || left >= far;
            far = left;
        }
        done.worst = state.work.worst();
        passes.push(done);
        if enough {
            break;
        }
    }
    run.progress("improve", options.passes.into(), options.passes.into())?;
    let after = state.report(run)?;
    let converged = after.all.tets == 0
        || options.goals.met_by(&Measures {
            six_volume: after.all.volume,
            joe_liu: after.all.joe_liu.min,
            edge_ratio: after.all.edge_ratio.max,
            min_dihedral: after.all.min_dihedral.min,
            max_dihedral: after.all.max_dihedral.max,
        });
    let exceptions = exceptions(&state.work, &options.goals, &input.junctions);
    let tolerance = options.deviation * state.spacing;
    let surface = surface_fit(&state.work, state.surface.as_ref(), tolerance);
    Ok(Improved {
        mesh: state.work.finish(),
        report: Report {
            backend: run.backend.name(),
            before,
            after,
            converged,
            passes,
            reoriented: input.reoriented,
            untangled: inverted,
            flowed,
            exceptions,
            surface,
            junctions: input.junctions,
        },
    })
}

/// What a pass aims at.
struct Aim {
    /// Tetrahedra below this are worked on.
    bound: f64,
    /// Vertices of tetrahedra below this are smoothed.
    smooth: f64,
    contract: bool,
    /// Operations are judged together with the smoothing that they need.
    climb: bool,
    /// All that can be done is done.
    last: bool,
    /// Random directions; surface vertices may leave the isosurface by the allowed deviation.
    rescue: bool,
    /// Objective down to which vertices go back to the isosurface: first the shape, then the quality.
    floor: f64,
}

impl Aim {
    fn of(pass: u32, target: f64) -> Self {
        let broad = pass < BROAD;
        let bound = if broad {
            target.max(WANTED.to_radians().sin())
        } else {
            target
        };
        Self {
            bound,
            smooth: if broad { 1.1 * bound } else { 1.02 * bound },
            contract: pass > 0,
            climb: !broad,
            rescue: pass >= RESCUE,
            last: pass >= LAST,
            floor: FLOORS
                .get(pass as usize)
                .map_or(target, |f: &f64| f.min(target)),
        }
    }
}

struct State<'a> {
    work: Work,
    surface: Option<Isosurface<'a>>,
    options: &'a Options,
    spacing: f64,
    /// The objective at which all goals are met.
    target: f64,
    plain: Memory,
    climbs: Memory,
    /// Has the memory of vain climbs been cleared for the last, larger effort?
    cleared: bool,
    /// Per vertex: when it was last smoothed.
    smoothed: Vec<u32>,
    /// When vertices were last brought back to the isosurface.
    projected: u32,
}

impl<'a> State<'a> {
    fn new(work: Work, surface: Option<Isosurface<'a>>, options: &'a Options) -> Self {
        let mut state = Self {
            work,
            surface,
            options,
            spacing: 0.0,
            target: options.goals.objective(),
            plain: Memory::default(),
            climbs: Memory::default(),
            cleared: false,
            smoothed: Vec::new(),
            projected: 0,
        };
        state.spacing = options.spacing.unwrap_or_else(|| state.surface_spacing());
        state
    }

    fn look_across(&mut self) {
        if self.options.keep_apart {
            self.work.look_across(self.spacing);
        }
    }

    /// The vertices of the isosurface stay where they are.
    fn fix_surface(&mut self) {
        for freedom in &mut self.work.freedom {
            if *freedom == Freedom::Field {
                *freedom = Freedom::Fixed;
            }
        }
    }

    /// Median length of the edges between surface vertices; of all edges without any.
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

    fn met(&self) -> bool {
        self.work.worst() >= self.target
    }

    /// Are the goals met, be it without the reserve that the passes aim at?
    fn goals_met(&self) -> bool {
        let work = &self.work;
        work.below(self.target).par_iter().all(|&t| {
            self.options
                .goals
                .met_by(&measures(work.corners(work.tets[t as usize])))
        })
    }

    fn pass<B: QualityBackend + ?Sized>(
        &mut self,
        number: u32,
        run: Run<'_, B>,
    ) -> Result<Pass, Error> {
        let mut done = Pass::default();
        self.look_across();
        let aim = Aim::of(number, self.target);
        self.smooth(number, &aim, &mut done, run)?;
        self.operate(&aim, &mut done);
        self.look_across();
        self.smooth(number, &aim, &mut done, run)?;
        self.project(&aim, &mut done);
        Ok(done)
    }

    fn tolerance(&self, aim: &Aim) -> f64 {
        let share = if aim.rescue {
            self.options.deviation.max(NEAR)
        } else {
            NEAR
        };
        share * self.spacing
    }

    fn smooth<B: QualityBackend + ?Sized>(
        &mut self,
        pass: u32,
        aim: &Aim,
        done: &mut Pass,
        run: Run<'_, B>,
    ) -> Result<(), Error> {
        let bad = self.work.below(aim.smooth);
        let now = self.work.tick();
        self.smoothed.resize(self.work.x.len(), 0);
        let mut vertices = corners_of(&self.work, &bad);
        // New directions are worth another try where nothing changed.
        if !aim.rescue {
            vertices.retain(|&v| self.work.changed[v as usize] > self.smoothed[v as usize]);
        }
        for &v in &vertices {
            self.smoothed[v as usize] = now - 1;
        }
        let turn = aim
            .rescue
            .then(|| self.options.seed.wrapping_add(u64::from(pass)));
        done.moved += relax(&mut self.work, &vertices, ROUNDS, turn, run)?;
        if let Some(field) = &self.surface {
            let rules = SurfaceRules {
                field,
                tolerance: self.tolerance(aim),
                rescue: aim.rescue,
            };
            done.slid += relax_surface(&mut self.work, &vertices, &rules);
        }
        Ok(())
    }

    fn operate(&mut self, aim: &Aim, done: &mut Pass) {
        let tolerance = self.tolerance(aim);
        let rules = Rules {
            allow: self.options.operations,
            contract: aim.contract,
            field: self.surface.as_ref(),
            spacing: self.spacing,
        };
        let surface = self.surface.as_ref().map(|field| SurfaceRules {
            field,
            tolerance,
            rescue: aim.rescue,
        });
        let (work, target) = (&mut self.work, self.target);
        let plain = |work: &Work, t, ring: &mut Ring| best_for(work, t, &rules, ring);
        let terms = (aim.bound, PLAIN_ROUNDS, false);
        rounds(work, &mut self.plain, terms, plain, done);
        if aim.climb {
            let left = work.below(target).len();
            let effort = &if aim.last && left <= FEW {
                if !self.cleared {
                    // What was tried in vain was tried with less.
                    self.climbs = Memory::default();
                    self.cleared = true;
                }
                Effort::LAST
            } else {
                Effort::USUAL
            };
            let with_smoothing = |work: &Work, t, ring: &mut Ring| {
                best_climb(work, t, &rules, surface.as_ref(), target, effort, ring)
            };
            let terms = (target, CLIMB_ROUNDS, true);
            rounds(work, &mut self.climbs, terms, with_smoothing, done);
        }
    }

    /// Brings surface vertices that have moved back to the isosurface, as far as the goals allow.
    fn project(&mut self, aim: &Aim, done: &mut Pass) {
        let Some(surface) = &self.surface else { return };
        let off: Vec<u32> = (0..self.work.x.len() as u32)
            .filter(|&v| {
                self.work.freedom[v as usize] == Freedom::Field
                    && self.work.changed[v as usize] > self.projected
            })
            .collect();
        self.projected = self.work.tick();
        let near = self.tolerance(aim);
        let floor = aim.floor;
        done.projected += project(&mut self.work, &off, surface, near, |corners| {
            quality(corners) >= floor
        });
    }

    /// Brings the surface vertices that are still farther from the isosurface than allowed to it as
    /// far as all tetrahedra meet the goals, with or without the reserve that the passes aim at. Gives
    /// how many are left.
    fn settle(&mut self, reserve: bool, done: &mut Pass) -> usize {
        let Some(surface) = &self.surface else {
            return 0;
        };
        let tolerance = self.options.deviation * self.spacing;
        let (goals, target) = (self.options.goals, self.target);
        let good =
            |corners| quality(corners) >= target || (!reserve && goals.met_by(&measures(corners)));
        let rules = SurfaceRules {
            field: surface,
            tolerance,
            rescue: true,
        };
        let far = |work: &Work, v: u32| {
            work.freedom[v as usize] == Freedom::Field
                && work.colours[v as usize] != NO_COLOUR
                && work.tangent(v, surface).distance.abs() > tolerance
        };
        let all: Vec<u32> = (0..self.work.x.len() as u32).collect();
        for _ in 0..SETTLE {
            self.work.know_tangents(&all, surface);
            let work = &self.work;
            let off: Vec<u32> = (0..work.x.len() as u32)
                .into_par_iter()
                .with_min_len(256)
                .filter(|&v| far(work, v))
                .collect();
            let before = done.projected;
            done.projected += project(&mut self.work, &off, surface, tolerance, good);
            let push_to_foot = |work: &Work, v: u32, ring: &mut Ring| {
                if !far(work, v) {
                    return None;
                }
                load(work, v, ring);
                let x = work.x[v as usize];
                let start = work.tangent(v, surface);
                let foot = foot(start, ring.mean_edge(&x.coords), surface, tolerance)?.at;
                [1.0, 0.6, 0.3].into_iter().find_map(|share| {
                    let to = x + (foot - x) * share;
                    push(work, v, to, &rules, good, ring).filter(|p| work.walls_bear(p))
                })
            };
            round_of_pushes(&mut self.work, &mut self.plain, &off, push_to_foot, done);
            if done.projected == before {
                return off.len();
            }
        }
        (0..self.work.x.len() as u32)
            .into_par_iter()
            .filter(|&v| far(&self.work, v))
            .count()
    }

    /// Number of vertices on the isosurface.
    fn on_field(&self) -> usize {
        let field = |f: &&Freedom| **f == Freedom::Field;
        self.work.freedom.iter().filter(field).count()
    }
}
