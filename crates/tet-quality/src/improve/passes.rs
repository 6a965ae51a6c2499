//! The schedule: smoothing and operations in passes, worst elements first.
//!
//! A pass smooths what is below its bound and then replaces, by operations, what smoothing alone does not lift; both keep to the
//! worst first, since the solver feels the worst element and not the mean. Early passes aim at many tetrahedra with short
//! searches, later ones at the few that miss the goals with longer ones, at the end whatever it takes. What was tried in vain is
//! not tried again until something around it has changed, which a clock per vertex tells. After the passes, surface vertices that
//! are still off the isosurface go there as far as the goals allow.

use geom_core::compute::BackendError;
use geom_core::compute::parallel;
use geom_core::mesh::{EDGES, VertexKind};
use geom_core::{Point3, TetMesh};

use super::crossed::Crossed;
use super::settings::{LAST, PassSettings, RESCUE, ROUGH, bolder_than};
use crate::backend::On;
use crate::boundary::field::Isosurface;
use crate::boundary::guard::GuardedMesh;
use crate::boundary::input::free_again;
use crate::error::Error;
use crate::measure::block::measures;
use crate::measure::metrics::quality;
use crate::measure::report::{QualityReport, report_of};
use crate::mesh::editable::{EditableMesh, Freedom, NO_COLOUR};
use crate::mesh::proposal::Proposal;
use crate::operations::operate::{
    Memory, Reserve, Rounds, Rules, best_for, best_hill_climb, round_of_projections, rounds,
};
use crate::operations::patch::{PatchSettings, project_with_neighbours};
use crate::operations::untangle::untangle;
use crate::options::{Options, SurfaceMotion};
use crate::outcome::Pass;
use crate::smoothing::flow::flow;
use crate::smoothing::smooth::{
    SurfaceRules, corners_of, foot, load, neighbourhood_of, project, relax, relax_surface,
};
use crate::smoothing::star::Star;

/// Share of the spacing that surface vertices may be off the isosurface before the rescue passes.
/// Far less than the deviation that is allowed by default: what a vertex may leave in the end is worth having as a
/// reserve then.
pub(super) const NEAR: f64 = 0.02;
/// Rounds of the search per vertex and sweep.
pub(super) const ROUNDS: u32 = 7;
/// Most rounds of operations per pass: what is postponed because of its neighbours gets another chance.
const PLAIN_ROUNDS: u32 = 16;
/// The same with smoothing.
const SMOOTHED_ROUNDS: u32 = 16;
/// How many tetrahedra are few enough to spare nothing for them.
const FEW: usize = 100;
/// Share of the surface vertices that may stay farther from the isosurface than allowed.
/// At pinches the isosurface cannot be reached at all, and passes for the sake of these would never end.
const ENOUGH: f64 = 5e-4;
/// Fewer vertices than one in so many may move for gaps to be looked for only near them.
const ONE_IN: usize = 100;
/// Most rounds of bringing surface vertices to the isosurface after the passes.
const SETTLE: u32 = 6;

/// What tetrahedra must keep when surface vertices go to the isosurface after the passes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Keep {
    /// The objective that the passes aim at, which is somewhat more than the goals.
    Reserve,
    /// The goals.
    Goals,
}

/// A mesh with what the passes know of it.
pub(super) struct Passes<'a> {
    pub(super) guarded: GuardedMesh,
    pub(super) surface: Option<Isosurface<'a>>,
    pub(super) options: &'a Options,
    pub(super) spacing: f64,
    /// The objective at which all goals are met.
    pub(super) target: f64,
    pub(super) plain: Memory,
    with_smoothing: Memory,
    /// Has the memory of vain tries with smoothing been cleared for the last, longer searches?
    cleared: bool,
    /// Per vertex: when it was last smoothed.
    smoothed: Vec<u32>,
    /// When vertices were last brought back to the isosurface.
    pub(super) projected: u32,
    /// Are the walls of gaps looked for, so that no step lets more of them cross?
    pub(super) watched: bool,
    /// What crossed when that was last looked for.
    pub(super) crossed: Crossed,
}

impl<'a> Passes<'a> {
    pub(super) fn new(
        mut mesh: EditableMesh,
        surface: Option<Isosurface<'a>>,
        options: &'a Options,
    ) -> Self {
        let spacing = options.spacing.unwrap_or_else(|| surface_spacing(&mesh));
        if options.surface == SurfaceMotion::Fixed {
            fix_surface(&mut mesh);
        }
        Self {
            guarded: GuardedMesh::new(mesh),
            surface,
            options,
            spacing,
            target: options.goals.objective(),
            plain: Memory::default(),
            with_smoothing: Memory::default(),
            cleared: false,
            smoothed: Vec::new(),
            projected: 0,
            watched: options.keep_apart,
            crossed: Crossed::default(),
        }
    }

    /// The largest distance from the isosurface that is allowed, Å.
    pub(super) fn deviation(&self) -> f64 {
        self.options.deviation * self.spacing
    }

    /// The quality of the mesh as it is.
    /// Empty slots are left out; vertices keep their numbers.
    ///
    /// # Errors
    ///
    /// That of the backend, and its answer for another number of tetrahedra than it was given.
    pub(super) fn quality(&self, run: On<'_>) -> Result<QualityReport, Error> {
        let mesh = &self.guarded.mesh;
        let tets: Vec<usize> = (0..mesh.tets.len())
            .filter(|&t| !mesh.is_empty_slot(t as u32))
            .collect();
        let mesh = TetMesh::with_kinds(
            mesh.x.clone(),
            tets.iter().map(|&t| mesh.tets[t]).collect(),
            tets.iter().map(|&t| mesh.regions[t]).collect(),
            mesh.kinds.clone(),
        )
        .expect("the operations keep the mesh valid");
        let mut measures = Vec::new();
        run.backend
            .measure(mesh.positions(), mesh.tets(), &mut measures)?;
        let (found, of) = (measures.len(), mesh.tets().len());
        BackendError::unless(found == of, &run.backend.name(), || {
            format!("{found} measures for {of} tetrahedra")
        })?;
        Ok(report_of(&mesh, &measures))
    }

    /// Untangles inverted tetrahedra if that is asked for. Gives how many there were.
    /// Elements are numbered as in the input then, because no operation has changed a slot yet.
    pub(super) fn untangle(&mut self, run: On<'_>) -> Result<usize, Error> {
        let inverted = self.guarded.mesh.below(f64::MIN_POSITIVE).len();
        if inverted > 0 && self.options.untangle {
            self.find_gaps(None);
            untangle(&mut self.guarded, run)?;
        }
        let mut elements = self.guarded.mesh.below(f64::MIN_POSITIVE);
        if !elements.is_empty() {
            elements.sort_unstable();
            return Err(Error::StillInverted { elements });
        }
        Ok(inverted)
    }

    /// The flow of the thesis if that is asked for. Gives how many moves it made.
    /// Plane parts are bent by it, so freedoms are found anew.
    pub(super) fn flow(&mut self, junctions: &[u32]) -> Result<usize, Error> {
        let SurfaceMotion::AveragedMeanCurvature { steps, step } = self.options.surface else {
            return Ok(0);
        };
        let moved = flow(&mut self.guarded, junctions, self.spacing, steps, step);
        free_again(&mut self.guarded.mesh, self.surface.as_ref())?;
        Ok(moved)
    }

    /// Passes until the goals are met, nothing changes or the budget is used up.
    ///
    /// The end is not the first pass that meets the goals: surface vertices must be at the isosurface too, and each
    /// attempt to bring them there may cost what was won. So a pass that meets the goals is followed by a settling, and
    /// passes go on while that still brings some vertices nearer.
    pub(super) fn run(&mut self, run: On<'_>) -> Result<Vec<Pass>, Error> {
        let budget = self.options.passes;
        let mut passes = Vec::new();
        let mut far = usize::MAX;
        let mut number = 0;
        // Far moves first: passes mend what they cost.
        let seated = if budget > 0 {
            self.seat(ROUGH, run)?
        } else {
            0
        };
        while number < budget {
            run.progress("improve", number.into(), budget.into())?;
            if number == 0 && self.met() {
                break;
            }
            let mut done = self.pass(number, run)?;
            if number == 0 {
                done.projected += seated;
            }
            let next = match done.changes() {
                0 => bolder_than(number),
                _ => Some(number + 1),
            };
            let last = next.is_none_or(|next| next >= budget);
            // The reserve is worth the usual passes only.
            let met = self.met();
            let mut enough = last;
            if last || met || (number >= LAST && self.goals_met()) {
                let allowed = ENOUGH * self.on_field() as f64;
                let keep = if met { Keep::Reserve } else { Keep::Goals };
                let left = self.settle_most(keep, allowed, &mut done)?;
                enough |= left as f64 <= allowed || left >= far;
                far = left;
            }
            done.worst = self.guarded.mesh.worst();
            passes.push(done);
            match next {
                Some(next) if !enough => number = next,
                _ => break,
            }
        }
        run.progress("improve", budget.into(), budget.into())?;
        Ok(passes)
    }

    /// Gaps are found anew before each sweep, since vertices have come nearer to each other meanwhile; free of cost
    /// where nobody watches. Only near some vertices that will move and their neighbours, if they are given and few.
    pub(super) fn find_gaps(&mut self, moving: Option<&[u32]>) {
        if !self.watched {
            return;
        }
        let mesh = &self.guarded.mesh;
        let few = moving.filter(|vertices| ONE_IN * vertices.len() < mesh.x.len());
        let near: Option<Vec<Point3>> = few.map(|vertices| {
            let around = neighbourhood_of(mesh, vertices);
            around.iter().map(|&v| mesh.x[v as usize]).collect()
        });
        self.guarded.find_gaps(self.spacing, near.as_deref());
    }

    /// [`find_gaps`](Self::find_gaps) for what a pass works on, and what it brings back to the isosurface. Operations may reach
    /// farther: where every step is to be watched, all gaps; while walls are parted, crossings are counted again afterwards.
    fn find_gaps_of(&mut self, settings: &PassSettings) {
        if !self.watched || self.options.keep_apart {
            return self.find_gaps(None);
        }
        let mesh = &self.guarded.mesh;
        let mut vertices = corners_of(mesh, &mesh.below(settings.smooth));
        vertices.extend(self.off_field());
        vertices.sort_unstable();
        vertices.dedup();
        self.find_gaps(Some(&vertices));
    }

    /// The objective is known of every tetrahedron at any time: one pass over an array.
    pub(super) fn met(&self) -> bool {
        self.guarded.mesh.worst() >= self.target
    }

    /// Are the goals met, be it without the reserve that the passes aim at?
    pub(super) fn goals_met(&self) -> bool {
        let mesh = &self.guarded.mesh;
        let below = mesh.below(self.target);
        let unmet = parallel::first(below.len(), |i| {
            let corners = mesh.corners(mesh.tets[below[i] as usize]);
            !self.options.goals.met_by(&measures(corners))
        });
        unmet.is_none()
    }

    /// One of the later passes again, for what has become worse since.
    /// Numbers go on from the rescue passes, so that each of them turns its search directions otherwise.
    pub(super) fn rescue(&mut self, number: u32, run: On<'_>) -> Result<Pass, Error> {
        let mut done = self.pass(RESCUE + number, run)?;
        done.worst = self.guarded.mesh.worst();
        Ok(done)
    }

    /// Brings surface vertices that lie too far from the isosurface back as far as the goals allow, with up to so many passes
    /// in between. Gives whether there were too many.
    pub(super) fn settle_again(
        &mut self,
        most: u32,
        passes: &mut Vec<Pass>,
        run: On<'_>,
    ) -> Result<bool, Error> {
        let allowed = (ENOUGH * self.on_field() as f64) as usize;
        if self.far()? <= allowed {
            return Ok(false);
        }
        for number in 0.. {
            let mut done = Pass::default();
            let left = self.settle(Keep::Goals, &mut done)?;
            done.worst = self.guarded.mesh.worst();
            passes.push(done);
            if number == most || left <= allowed {
                break;
            }
            passes.push(self.rescue(number, run)?);
        }
        Ok(true)
    }

    /// Takes the mesh as it was, when vertices had last been brought back at `projected` and these triangles crossed: its clock
    /// goes back, too. What was tried since was tried with another mesh.
    pub(super) fn go_back(&mut self, kept: GuardedMesh, projected: u32, crossed: Crossed) {
        (self.guarded, self.crossed) = (kept, crossed);
        (self.plain, self.with_smoothing) = (Memory::default(), Memory::default());
        self.smoothed.clear();
        self.projected = projected;
    }

    /// Smooth, operate, smooth, project: operations are for what smoothing does not lift, and leave cavities that are
    /// to be smoothed in turn. Gaps are looked for before either sweep.
    fn pass(&mut self, number: u32, run: On<'_>) -> Result<Pass, Error> {
        let mut done = Pass::default();
        let settings = PassSettings::of(number, self.target);
        self.find_gaps_of(&settings);
        self.smooth(&settings, &mut done, run)?;
        self.operate(&settings, &mut done);
        self.find_gaps_of(&settings);
        self.smooth(&settings, &mut done, run)?;
        self.project(&settings, &mut done)?;
        done.projected += self.seat(settings.floor, run)?;
        Ok(done)
    }

    /// Distance from the isosurface that a pass allows, Å.
    /// Early passes hold vertices near by, so that the last ones have something to give.
    fn tolerance(&self, settings: &PassSettings) -> f64 {
        let share = if settings.rescue {
            self.options.deviation.max(NEAR)
        } else {
            NEAR
        };
        share * self.spacing
    }

    /// Smooths what lies at bad tetrahedra.
    ///
    /// Vertices around which nothing has changed since their last turn are left out: the same search would end where it
    /// began.
    fn smooth(
        &mut self,
        settings: &PassSettings,
        done: &mut Pass,
        run: On<'_>,
    ) -> Result<(), Error> {
        let mesh = &mut self.guarded.mesh;
        let bad = mesh.below(settings.smooth);
        let now = mesh.tick();
        self.smoothed.resize(mesh.x.len(), 0);
        let mut vertices = corners_of(mesh, &bad);
        // New directions are worth another try where nothing changed.
        if !settings.rescue {
            vertices.retain(|&v| mesh.changed[v as usize] > self.smoothed[v as usize]);
        }
        for &v in &vertices {
            self.smoothed[v as usize] = now - 1;
        }
        let turn = settings
            .rescue
            .then(|| self.options.seed.wrapping_add(u64::from(settings.number)));
        done.moved += relax(&mut self.guarded, &vertices, ROUNDS, turn, run)?;
        if let Some(field) = self.surface {
            let rules = SurfaceRules {
                field,
                tolerance: self.tolerance(settings),
                rescue: settings.rescue,
            };
            done.slid += relax_surface(&mut self.guarded, &vertices, &rules, run)?;
        }
        Ok(())
    }

    /// Replaces bad tetrahedra: by operations alone, in later passes by operations with the smoothing
    /// that they need.
    ///
    /// The two kinds have a memory each, because what fails alone may succeed with smoothing. Alone they work on all
    /// below the bound of the pass, with smoothing, which costs far more, only on what misses the goals.
    fn operate(&mut self, settings: &PassSettings, done: &mut Pass) {
        let tolerance = self.tolerance(settings);
        let rules = Rules {
            allow: self.options.operations,
            contract: settings.contract,
            field: self.surface.as_ref(),
            spacing: self.spacing,
        };
        let alone = Rounds {
            bound: settings.bound,
            most: PLAIN_ROUNDS,
            reserve: Reserve::Corners,
        };
        let guarded = &mut self.guarded;
        let judge = |guarded: &GuardedMesh, t, star: &mut Star| best_for(guarded, t, &rules, star);
        rounds(guarded, &mut self.plain, alone, judge, done);
        if !settings.with_smoothing {
            return;
        }
        let target = self.target;
        let few = guarded.mesh.below(target).len() <= FEW;
        let search = if settings.last && few {
            if !self.cleared {
                // What was tried in vain was tried with less.
                self.with_smoothing = Memory::default();
                self.cleared = true;
            }
            &PatchSettings::LAST
        } else {
            &PatchSettings::USUAL
        };
        let surface = self.surface.map(|field| SurfaceRules {
            field,
            tolerance,
            rescue: settings.rescue,
        });
        let judge = |guarded: &GuardedMesh, t, star: &mut Star| {
            best_hill_climb(guarded, t, &rules, surface.as_ref(), target, search, star)
        };
        let smoothed = Rounds {
            bound: target,
            most: SMOOTHED_ROUNDS,
            reserve: Reserve::Neighbours,
        };
        rounds(guarded, &mut self.with_smoothing, smoothed, judge, done);
    }

    /// Surface vertices that may have left the isosurface since they were last brought back.
    fn off_field(&self) -> impl Iterator<Item = u32> {
        let mesh = &self.guarded.mesh;
        (0..mesh.x.len() as u32).filter(|&v| {
            mesh.freedom[v as usize].on_field() && mesh.changed[v as usize] > self.projected
        })
    }

    /// Brings surface vertices that have moved back to the isosurface, as far as the goals allow.
    fn project(&mut self, settings: &PassSettings, done: &mut Pass) -> Result<(), Error> {
        let near = self.tolerance(settings);
        let Some(surface) = &self.surface else {
            return Ok(());
        };
        let off: Vec<u32> = self.off_field().collect();
        self.projected = self.guarded.mesh.tick();
        let good = |corners| quality(corners) >= settings.floor;
        done.projected += project(&mut self.guarded, &off, surface, near, good)?;
        Ok(())
    }

    /// Brings surface vertices to the isosurface after a pass until so many are left as are allowed, if
    /// that can be. Gives how many are left.
    fn settle_most(&mut self, keep: Keep, allowed: f64, done: &mut Pass) -> Result<usize, Error> {
        let left = self.settle(keep, done)?;
        // A share of the vertices is not worth the reserve of all tetrahedra.
        if keep == Keep::Reserve && left as f64 > allowed {
            return self.settle(Keep::Goals, done);
        }
        Ok(left)
    }

    /// Brings the surface vertices that are still farther from the isosurface than allowed to it as
    /// far as all tetrahedra keep what they must. Gives how many are left.
    ///
    /// First each vertex by itself, then those that could not, with the smoothing of their neighbours; again until no
    /// vertex goes, since one that has gone makes room for the next.
    fn settle(&mut self, keep: Keep, done: &mut Pass) -> Result<usize, Error> {
        let tolerance = self.deviation();
        let Some(surface) = self.surface else {
            return Ok(0);
        };
        let (goals, target) = (self.options.goals, self.target);
        let good = |corners| {
            quality(corners) >= target || (keep == Keep::Goals && goals.met_by(&measures(corners)))
        };
        let rules = SurfaceRules {
            field: surface,
            tolerance,
            rescue: true,
        };
        let project_to_foot =
            |guarded: &GuardedMesh, v: u32, star: &mut Star| match is_far(&guarded.mesh, v, &rules)
            {
                true => to_foot(guarded, v, &rules, good, star),
                false => None,
            };
        let all: Vec<u32> = (0..self.guarded.mesh.x.len() as u32).collect();
        for _ in 0..SETTLE {
            self.guarded.mesh.know_tangents(&all, &surface)?;
            let off = far_vertices(&self.guarded.mesh, &rules);
            if off.is_empty() {
                return Ok(0);
            }
            self.find_gaps(Some(&off));
            // Alone where that does, else with their neighbours.
            let before = done.projected;
            done.projected += project(&mut self.guarded, &off, &surface, tolerance, good)?;
            let guarded = &mut self.guarded;
            round_of_projections(guarded, &mut self.plain, &off, project_to_foot, done);
            if done.projected == before {
                return Ok(off.len());
            }
        }
        Ok(far_vertices(&self.guarded.mesh, &rules).len())
    }

    /// How many surface vertices are farther from the isosurface than allowed.
    fn far(&mut self) -> Result<usize, Error> {
        let Some(field) = &self.surface else {
            return Ok(0);
        };
        let all: Vec<u32> = (0..self.guarded.mesh.x.len() as u32).collect();
        self.guarded.mesh.know_tangents(&all, field)?;
        let rules = SurfaceRules {
            field: *field,
            tolerance: self.deviation(),
            rescue: true,
        };
        Ok(far_vertices(&self.guarded.mesh, &rules).len())
    }

    /// Number of vertices on the isosurface.
    fn on_field(&self) -> usize {
        let field = |f: &&Freedom| **f == Freedom::Field;
        self.guarded.mesh.freedom.iter().filter(field).count()
    }
}

/// A vertex moved toward its foot on the isosurface together with its neighbours, as far as all tetrahedra are `good` or
/// none is worse than the worst one was.
pub(super) fn to_foot(
    guarded: &GuardedMesh,
    v: u32,
    rules: &SurfaceRules<'_>,
    good: impl Fn([Point3; 4]) -> bool,
    star: &mut Star,
) -> Option<Proposal> {
    let mesh = &guarded.mesh;
    load(mesh, v, star);
    let x = mesh.x[v as usize];
    let surface = &mesh.freedom[v as usize].part_of(&rules.field);
    let start = mesh.tangent(v, surface);
    let edge = star.mean_edge(&x.coords);
    let foot = foot(start, edge, surface, rules.tolerance)?.at;
    [1.0, 0.6, 0.3].into_iter().find_map(|share| {
        let to = x + (foot - x) * share;
        let found = project_with_neighbours(guarded, v, to, rules, &good, star);
        found.filter(|p| guarded.allows(p))
    })
}

/// The vertices of the isosurface stay where they are.
fn fix_surface(mesh: &mut EditableMesh) {
    for freedom in &mut mesh.freedom {
        if freedom.on_field() {
            *freedom = Freedom::Fixed;
        }
    }
}

/// Is the vertex one of the isosurface, and farther from it than the rules allow?
fn is_far(mesh: &EditableMesh, v: u32, rules: &SurfaceRules<'_>) -> bool {
    let freedom = mesh.freedom[v as usize];
    if !freedom.on_field() || mesh.colours[v as usize] == NO_COLOUR {
        return false;
    }
    let surface = freedom.part_of(&rules.field);
    !surface.reached(&mesh.tangent(v, &surface), rules.tolerance)
}

/// In order of their numbers, for any number of threads.
fn far_vertices(mesh: &EditableMesh, rules: &SurfaceRules<'_>) -> Vec<u32> {
    parallel::flat_map(mesh.x.len(), |v| {
        Some(v as u32).filter(|&v| is_far(mesh, v, rules))
    })
}

/// Median length of the edges between surface vertices; of all edges without any.
/// An edge counts once per tetrahedron around it. 0 for an empty mesh.
fn surface_spacing(mesh: &EditableMesh) -> f64 {
    let on_surface = |v: u32| mesh.kinds[v as usize] == VertexKind::Surface;
    let lengths = |fit: &(dyn Fn([u32; 2]) -> bool + Sync)| -> Vec<f64> {
        parallel::flat_map(mesh.tets.len(), |t| {
            let tet = mesh.tets[t];
            let edges = EDGES.iter().map(move |e| e.map(|i| tet[i]));
            edges
                .filter(|e| fit(*e))
                .map(|[a, b]| (mesh.x[a as usize] - mesh.x[b as usize]).norm())
        })
    };
    let mut all = lengths(&|ends| ends.into_iter().all(on_surface));
    if all.is_empty() {
        all = lengths(&|_| true);
    }
    if all.is_empty() {
        return 0.0;
    }
    let middle = all.len() / 2;
    *all.select_nth_unstable_by(middle, f64::total_cmp).1
}
