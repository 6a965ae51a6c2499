//! Other quads where no places make them good.
//!
//! Where a tip, tunnel or sharp bend is as narrow as the quads, their connectivity may have no good places at all. Then each
//! operation of [`Patch::changes`] around the worst quad is tried on a copy of what lies near, whose vertices look for their best
//! places; the best one is taken if the worst quad there is better than before. Where no single one is enough, others follow after
//! the best of them, as a best-first search (Pearl, *Heuristics*, 1984).

use std::collections::BTreeSet;

use geom_core::compute::parallel;
use geom_core::mesh::Halfedges;
use geom_core::surface::flow::{CornerObject, Descent, Elements, Places, Search, Vertices, least};
use geom_core::surface::ground::Freedom;
use geom_core::{Cpu, QuadMesh, Run};

use super::change::Patch;
use super::elements::Quads;
use super::{DESCENT, Flow, SEARCH};
use crate::Error;

/// Quads below this call for others.
const LEAST: f64 = 0.35;
/// Above this, fewer irregular vertices are worth more.
const FINE: f64 = 0.5;
/// By so much the worst must become better.
const GAIN: f64 = 0.02;
/// Rings of quads around the worst one that may change, and if nothing helps there.
const RINGS: [usize; 2] = [3, 5];
/// Operations at most, of a mesh that is not large.
const MOST: usize = 32;
/// It is given up after so many places where no operation helps, likewise.
const STUCK: usize = 4;
/// From so many quads on a mesh is large, and both grow with it: it has more such places, and a map anew, which the quads that
/// stay bad would ask for, takes as long as hundreds of operations.
const LARGE: usize = 16_000;
/// With more bad quads than these and one in a hundred the map is to blame, and single operations change nothing.
const FEW: usize = 8;
/// Operations that make the vertices of a patch less regular by more than this are not tried.
const WORSE: usize = 4;
/// Where one operation is not enough, others follow after so many of the best,
const FOLLOWED: usize = 3;
/// so often in a place,
const DEEPEST: usize = 4;
/// and in all places together: each time takes as many times as long. A map anew for a few bad quads takes longer.
const DEEPER: usize = 24;
/// Rounds of work on single quads after which the best patches are chosen, and how many: that work is nearly all there is.
const GLANCE: usize = 6;
const CHOSEN: usize = 6;
/// Powers of the flow, and steps.
const POWERS: [(i32, usize); 2] = [(2, 10), (12, 30)];

/// A patch at its best places.
struct Tried {
    patch: Patch,
    /// Have others followed?
    is_followed: bool,
    /// The worst of its quads, and which.
    worst: (f64, usize),
    irregularity: usize,
}

impl Tried {
    fn of(flow: Flow<'_>, patch: &Patch) -> Self {
        let merits = flow.values(Quads::merit);
        let worst = least(merits.iter().copied());
        let which = merits.iter().position(|&m| m == worst).unwrap_or(0);
        let patch = Patch {
            positions: flow.vertices.positions,
            ..patch.clone()
        };
        Self {
            irregularity: patch.irregularity(),
            worst: (worst, which),
            is_followed: false,
            patch,
        }
    }

    /// The larger the better.
    fn rank(&self) -> (f64, i64, f64) {
        (
            self.worst.0.min(FINE),
            -(self.irregularity as i64),
            self.worst.0,
        )
    }
}

fn better(a: &Tried, b: &Tried) -> std::cmp::Ordering {
    let (a, b) = (a.rank(), b.rank());
    b.0.total_cmp(&a.0)
        .then(b.1.cmp(&a.1))
        .then(b.2.total_cmp(&a.2))
}

/// Puts others in place of quads that are bad.
pub(super) fn mended(flow: &mut Flow<'_>) -> Result<(), Error> {
    // Quads at places where nothing helps, and how many places these are.
    let mut stuck: BTreeSet<[u32; 4]> = BTreeSet::new();
    let (mut places, mut deeper, mut changed) = (0, DEEPER, false);
    let quads = flow.elements.quads.len().max(LARGE);
    let [most, enough] = [MOST, STUCK].map(|limit| limit * quads / LARGE);
    let mut jacobians = flow.values(Quads::jacobian);
    for step in 0..most {
        debug_assert!(
            jacobians == flow.values(Quads::jacobian),
            "others have moved"
        );
        let mut bad: Vec<usize> = (0..jacobians.len())
            .filter(|&q| jacobians[q] < LEAST)
            .collect();
        if bad.len() > FEW + jacobians.len() / 100 || places == enough {
            break;
        }
        bad.retain(|&q| !stuck.contains(&flow.elements.quads[q]));
        let worst = bad.into_iter();
        let Some(worst) = worst.min_by(|&a, &b| jacobians[a].total_cmp(&jacobians[b])) else {
            break;
        };
        flow.run.progress("other quads", step as u64, most as u64)?;
        match Place::mended(flow, worst, &mut deeper)? {
            Some((place, tried)) => {
                place.put(tried, flow, &mut jacobians);
                changed = true;
            }
            None => {
                // Its neighbours are no other place.
                let corners = flow.elements.quads[worst];
                let near = corners.map(|v| flow.elements.around(v as usize));
                let near = near.iter().flat_map(|quads| quads.iter());
                stuck.extend(near.map(|&q| flow.elements.quads[q as usize]));
                places += 1;
            }
        }
    }
    if changed {
        flow.lift_the_worst(&SEARCH)?;
    }
    Ok(())
}

/// The quads of a flow, without vertices that none of them has any more.
pub(super) fn taken(flow: &Flow<'_>) -> Result<QuadMesh, Error> {
    let used: Vec<usize> = (0..flow.vertices.positions.len())
        .filter(|&v| !flow.elements.around(v).is_empty())
        .collect();
    let mut number = vec![u32::MAX; flow.vertices.positions.len()];
    for (new, &v) in (0u32..).zip(&used) {
        number[v] = new;
    }
    let positions = used.iter().map(|&v| flow.vertices.positions[v]).collect();
    let quads = flow
        .elements
        .quads
        .iter()
        .map(|q| q.map(|v| number[v as usize]));
    Ok(QuadMesh::new(positions, quads.collect())?)
}

/// Some quads of a mesh around one.
struct Place {
    /// In the mesh, ascending.
    quads: Vec<u32>,
    /// Of the patch's vertices in the mesh, ascending.
    vertices: Vec<u32>,
    /// The quad in the middle, in the patch.
    middle: usize,
    patch: Patch,
}

impl Place {
    /// The one around a quad in which something helps, and what.
    fn mended(
        flow: &Flow<'_>,
        middle: usize,
        deeper: &mut usize,
    ) -> Result<Option<(Self, Tried)>, Error> {
        for rings in RINGS {
            let place = Self::around(flow, middle, rings);
            if let Some(tried) = place.best(flow, deeper)? {
                return Ok(Some((place, tried)));
            }
        }
        Ok(None)
    }

    fn around(flow: &Flow<'_>, middle: usize, rings: usize) -> Self {
        let mut quads = BTreeSet::from([middle as u32]);
        for _ in 0..rings {
            let rim: Vec<u32> = quads.iter().copied().collect();
            for q in rim {
                for v in flow.elements.quads[q as usize] {
                    quads.extend(flow.elements.around(v as usize));
                }
            }
        }
        let of_quad = |&q: &u32| flow.elements.quads[q as usize];
        let vertices: BTreeSet<u32> = quads.iter().flat_map(of_quad).collect();
        let vertices: Vec<u32> = vertices.into_iter().collect();
        let place = |v: u32| vertices.partition_point(|&u| u < v) as u32;
        let outside = |&v: &u32| {
            let around = flow.elements.around(v as usize).iter();
            around.filter(|q| !quads.contains(q)).count()
        };
        let outside: Vec<usize> = vertices.iter().map(outside).collect();
        let patch = Patch {
            quads: quads.iter().map(|q| of_quad(q).map(place)).collect(),
            positions: vertices
                .iter()
                .map(|&v| flow.vertices.positions[v as usize])
                .collect(),
            inner: outside.iter().map(|&n| n == 0).collect(),
            free: vertices
                .iter()
                .map(|&v| flow.vertices.freedom[v as usize] == Freedom::Surface)
                .collect(),
            outside,
        };
        let quads: Vec<u32> = quads.into_iter().collect();
        Self {
            middle: quads.partition_point(|&q| (q as usize) < middle),
            quads,
            vertices,
            patch,
        }
    }

    /// The best of what one operation makes of the patch, or of what several do where no one is enough and `deeper` is not spent;
    /// `None` if none helps. Of several the best so far is followed first.
    fn best(&self, flow: &Flow<'_>, deeper: &mut usize) -> Result<Option<Tried>, Error> {
        let places = Places::of(&flow.vertices);
        let merit = |&q: &u32| flow.elements.merit(q as usize, &places);
        let before = least(self.quads.iter().map(merit));
        let helps = |tried: &Tried| tried.worst.0 > before + GAIN && self.fits(&tried.patch, flow);
        let changes = |patch: &Patch, quad: usize| {
            let most = patch.irregularity() + WORSE;
            let mut made = patch.changes(quad);
            made.retain(|p| p.irregularity() <= most);
            made
        };
        let mut candidates = vec![self.patch.clone()];
        candidates.extend(changes(&self.patch, self.middle));
        let mut all = self.tried(candidates, flow)?;
        let enough = |all: &[Tried]| {
            all.iter()
                .find(|t| helps(t))
                .is_some_and(|t| t.worst.0 >= LEAST)
        };
        for _ in 0..DEEPEST {
            if enough(&all) || *deeper == 0 {
                break;
            }
            *deeper -= 1;
            let open = all.iter_mut().filter(|tried| !tried.is_followed);
            let next = open.take(FOLLOWED).flat_map(|tried| {
                tried.is_followed = true;
                changes(&tried.patch, tried.worst.1)
            });
            let next = next.collect();
            all.extend(self.tried(next, flow)?);
            all.sort_by(better);
        }
        Ok(all.into_iter().find(helps))
    }

    /// The patches that are best at a glance, at their best places, the best first. Each on one thread: there are many.
    fn tried(&self, patches: Vec<Patch>, flow: &Flow<'_>) -> Result<Vec<Tried>, Error> {
        let in_order = |made: Vec<Result<Tried, Error>>| -> Result<Vec<Tried>, Error> {
            let mut made = made.into_iter().collect::<Result<Vec<_>, _>>()?;
            made.sort_by(better);
            Ok(made)
        };
        let flowed = parallel::map_each(&patches, |patch| {
            parallel::alone(|| self.flowed(patch, flow))
        });
        let mut flowed = in_order(flowed)?;
        flowed.truncate(CHOSEN);
        in_order(parallel::map_each(&flowed, |tried| {
            parallel::alone(|| self.lifted(&tried.patch, flow))
        }))
    }

    /// A patch after a flow of all its vertices together, and a glance at its worst quads.
    fn flowed(&self, patch: &Patch, flow: &Flow<'_>) -> Result<Tried, Error> {
        let mut own = self.flow_of(patch, flow);
        let [first, last] = POWERS.map(|(power, steps)| Descent {
            power,
            steps,
            renew: true,
            ..DESCENT
        });
        own.descend(&first, |_| true)?;
        let best = own.best_of(&last, Quads::jacobian, true)?;
        own.vertices.put(best.1);
        own.lift_the_worst(&Search {
            rounds: GLANCE,
            ..SEARCH
        })?;
        Ok(Tried::of(own, patch))
    }

    /// A patch after its worst quads were worked on one by one.
    fn lifted(&self, patch: &Patch, flow: &Flow<'_>) -> Result<Tried, Error> {
        let mut own = self.flow_of(patch, flow);
        own.lift_the_worst(&SEARCH)?;
        Ok(Tried::of(own, patch))
    }

    /// A patch on its own, its rim held.
    fn flow_of<'g>(&self, patch: &Patch, flow: &Flow<'g>) -> Flow<'g> {
        let freedom = (0..patch.positions.len()).map(|v| match self.vertices.get(v) {
            _ if !patch.inner[v] => Freedom::Fixed,
            Some(&v) => flow.vertices.freedom[v as usize],
            None => Freedom::Surface,
        });
        let (positions, quads) = (patch.positions.clone(), patch.quads.clone());
        let quads = Quads::new(quads, &positions, flow.elements.narrowest);
        let vertices = Vertices::new(positions, freedom.collect(), flow.vertices.ground(0));
        // A patch is small: every backend would be the CPU but for its start.
        Flow::new(quads, vertices, Run::on(&Cpu).with(Cpu.as_corners()))
    }

    /// The mesh with another patch in place of this.
    fn quads_with(&self, patch: &Patch, flow: &Flow<'_>) -> Vec<[u32; 4]> {
        let number = |v: u32| match self.vertices.get(v as usize) {
            Some(&v) => v,
            None => (flow.vertices.positions.len() + v as usize - self.vertices.len()) as u32,
        };
        let kept = flow.elements.quads.iter().enumerate();
        let kept = kept.filter(|(q, _)| self.quads.binary_search(&(*q as u32)).is_err());
        let kept = kept.map(|(_, quad)| *quad);
        kept.chain(patch.quads.iter().map(|q| q.map(number)))
            .collect()
    }

    /// Is the mesh a manifold with the patch in it?
    fn fits(&self, patch: &Patch, flow: &Flow<'_>) -> bool {
        let mut positions = flow.vertices.positions.clone();
        positions.extend(&patch.positions[self.vertices.len()..]);
        let mesh = QuadMesh::new(positions, self.quads_with(patch, flow));
        mesh.is_ok_and(|mesh| Halfedges::of_quads(&mesh).is_ok())
    }

    /// Puts a patch in place of this, whose quads follow those that are kept; what is measured of each follows, too. Nothing
    /// around it moves.
    fn put(&self, tried: Tried, flow: &mut Flow<'_>, jacobians: &mut Vec<f64>) {
        let quads = self.quads_with(&tried.patch, flow);
        let vertices = &mut flow.vertices;
        let mut moved = Vec::new();
        for (v, &p) in tried.patch.positions.iter().enumerate() {
            match self.vertices.get(v) {
                Some(&v) if vertices.positions[v as usize] != p => {
                    vertices.positions[v as usize] = p;
                    moved.push(v);
                }
                Some(_) => {}
                None => {
                    vertices.add(p, Freedom::Surface, 0);
                }
            }
        }
        vertices.settle_some(&moved);
        flow.elements = Quads::new(quads, &vertices.positions, flow.elements.narrowest);
        let mut number = 0;
        jacobians.retain(|_| {
            number += 1;
            self.quads.binary_search(&(number - 1)).is_err()
        });
        let places = Places::of(&flow.vertices);
        let new = jacobians.len()..flow.elements.count();
        jacobians.extend(new.map(|q| flow.elements.jacobian(q, &places)));
    }
}

/// What the operations on a quad make of a whole mesh.
#[cfg(feature = "testing")]
pub(crate) fn changes(mesh: &QuadMesh, quad: usize) -> Result<Vec<QuadMesh>, Error> {
    let edges = Halfedges::of_quads(mesh)?;
    let vertices = (0..mesh.positions().len() as u32).map(geom_core::VertexId);
    let inner: Vec<bool> = vertices.map(|v| !edges.on_boundary(v)).collect();
    let patch = Patch {
        quads: mesh.quads().to_vec(),
        positions: mesh.positions().to_vec(),
        outside: vec![0; inner.len()],
        free: inner.clone(),
        inner,
    };
    let made = patch.changes(quad).into_iter();
    made.map(|p| Ok(QuadMesh::new(p.positions, p.quads)?))
        .collect()
}
