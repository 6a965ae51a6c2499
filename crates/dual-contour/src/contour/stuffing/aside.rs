//! Vertices step aside from boundaries of materials.
//!
//! A vertex that is close to a boundary but may not snap onto it, as where a third region is near, would else push the cuts
//! of its edges off, and a plane would come out dented by up to two fifths of a cell. The boundary of a material is known
//! everywhere, so here the vertex goes, deeper into its own region, until the cuts are far enough off it where they are.

use geom_core::mesh::six_volume;
use geom_core::{Point3, Vector3};

use super::near::{Near, kept_off_ends};
use crate::dual::{Probe, Sample, depth_gradient};
use crate::octree::exact;

/// How near to a vertex the cuts of materials may stay, as a share of what is too close for snapping.
pub(super) const ROOM: f64 = 0.75;
/// Steps to the side, as shares of the shortest edge that is cut.
const STEP: f64 = 0.05;
const STEPS: u32 = 8;
/// A tetrahedron keeps at least this share of its volume.
const LEAST_VOLUME: f64 = 0.35;

/// A vertex that has stepped aside, and the cuts of its edges from there.
pub(super) struct Aside {
    sample: Sample,
    cuts: Vec<(u32, f64)>,
}

impl Near {
    /// Does an edge cross the boundary of a material, and not the isosurface?
    pub(super) fn is_of_materials(&self, edge: u32) -> bool {
        let [a, b] = self.edges[edge as usize].map(|v| self.label(v));
        !Probe::on_level(a, b)
    }

    /// Where a vertex may go to be off the boundaries of materials: the nearest place of some at which their cuts have
    /// room, else that with the most room. `None` where no such cut is close, or nothing is better than to stay.
    pub(super) fn aside(&self, probe: &Probe<'_>, v: u32) -> Option<Aside> {
        let close: Vec<u32> = self
            .violated(v)
            .filter(|&(e, ratio)| ratio < ROOM && self.is_of_materials(e))
            .map(|(e, _)| e)
            .collect();
        let way = self
            .way_into_region(probe, v)
            .filter(|_| !close.is_empty())?;
        let lengths = close.iter().map(|&e| {
            let [a, b] = self.edges[e as usize].map(|v| self.samples[v as usize].x);
            (b - a).norm()
        });
        let step = STEP * lengths.fold(f64::INFINITY, f64::min);
        let mut most = self.room(v, &close, |e| self.cuts[e as usize]);
        let mut best = None;
        for k in 1..=STEPS {
            let Some(there) = self.at(probe, v, &(way * (step * f64::from(k)))) else {
                break;
            };
            let cut = |e: u32| there.cuts.iter().find(|c| c.0 == e).map_or(0.0, |c| c.1);
            let room = self.room(v, &close, cut);
            if room > most {
                (most, best) = (room, Some(there));
            }
            if most >= ROOM {
                break;
            }
        }
        best
    }

    pub(super) fn step_aside(&mut self, v: u32, aside: Aside) {
        self.samples[v as usize] = aside.sample;
        self.moved[v as usize] = true;
        for (e, cut) in aside.cuts {
            self.cuts[e as usize] = cut;
        }
    }

    /// The least distance of the cuts of some edges from `v`, relative to what is too close for snapping.
    fn room(&self, v: u32, edges: &[u32], cut: impl Fn(u32) -> f64) -> f64 {
        let ratio = |&e: &u32| self.turned(e, v, cut(e)) / self.limit(e);
        edges.iter().map(ratio).fold(f64::INFINITY, f64::min)
    }

    /// The unit vector away from the nearest boundary of the region of a vertex, within the planes of the box that it
    /// stands in; `None` in its edges and corners where they leave no such way.
    fn way_into_region(&self, probe: &Probe<'_>, v: u32) -> Option<Vector3> {
        let Sample { x, label, .. } = self.samples[v as usize];
        let (domain, labels) = (&probe.samples.domain, &probe.samples.labels);
        let depth = |x: &Point3| labels.depth(label, &domain.world(x)) / domain.spacing;
        let mut way = depth_gradient(depth, &x);
        for k in 0..3 {
            if self.planes[v as usize] >> (2 * k) & 3 != 0 {
                way[k] = 0.0;
            }
        }
        // With less than half of the rise that the way across the boundary has, it leads nowhere.
        way.try_normalize(0.5)
    }

    /// A vertex displaced, if it stays in its region and its tetrahedra keep their volume.
    fn at(&self, probe: &Probe<'_>, v: u32, by: &Vector3) -> Option<Aside> {
        let before = self.samples[v as usize];
        let x = before.x + by.map(exact);
        let (labels, point) = (&probe.samples.labels, probe.samples.domain.world(&x));
        let value = probe.value(&point).unwrap_or(before.value);
        let stays = labels.at(value, &point) == before.label;
        if !stays || !self.keeps_volumes(v, &x) {
            return None;
        }
        let sample = Sample { x, value, ..before };
        let edges = self.edges_at.list(v as usize);
        let cuts = edges.iter().map(|&e| self.cut_from(probe, e, v, sample));
        Some(Aside {
            sample,
            cuts: cuts.collect::<Option<_>>()?,
        })
    }

    /// The cut of an edge with its end `v` displaced. It comes no nearer to the other end than it is or may stay there,
    /// or is held there if it is the isosurface's; `None` where it is a material's.
    fn cut_from(&self, probe: &Probe<'_>, e: u32, v: u32, sample: Sample) -> Option<(u32, f64)> {
        let w = self.other(e, v);
        let ends = self.edges[e as usize].map(|u| match u == v {
            true => sample,
            false => self.samples[u as usize],
        });
        let [a, b] = &ends;
        let cut = kept_off_ends(probe.exact_crossing(a, b), a.label, b.label);
        let of_materials = self.is_of_materials(e);
        let least = self.limit(e) * if of_materials { ROOM } else { 1.0 };
        let least = least.min(self.from(e, w));
        if self.turned(e, w, cut) >= least {
            return Some((e, cut));
        }
        (!of_materials).then_some((e, self.turned(e, w, least)))
    }

    /// Do the tetrahedra around a vertex keep enough of their volume with it at `x`?
    pub(super) fn keeps_volumes(&self, v: u32, x: &Point3) -> bool {
        self.around.list(v as usize).iter().all(|&t| {
            let tet = self.tets[t as usize];
            let now = tet.map(|u| self.samples[u as usize].x);
            let then = std::array::from_fn(|k| if tet[k] == v { *x } else { now[k] });
            six_volume(then) >= LEAST_VOLUME * six_volume(now)
        })
    }

    /// Has a vertex of the tetrahedra around one stepped aside?
    pub(super) fn is_by_moved(&self, v: u32) -> bool {
        let tets = self.around.list(v as usize).iter();
        tets.flat_map(|&t| self.tets[t as usize])
            .any(|u| self.moved[u as usize])
    }
}
