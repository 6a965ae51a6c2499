//! Isosurface stuffing (Labelle & Shewchuk 2007) of the base tetrahedra.
//!
//! Corners and cell points stay where they are and carry labels; base tetrahedra with more than one
//! label are cut where labels change along their edges. A vertex with a cut close by is snapped onto
//! it, which keeps angles away from 0° and 180°, but only where the interface stays a manifold.
//!
//! In this order: `base` makes the tetrahedra and labels, `near` gathers those that an interface may change, `snap`
//! moves vertices (with `aside`, beside materials), `cut` cuts. What lies farther off is passed on as it is, which is most of a mesh.

use std::sync::atomic::{AtomicBool, Ordering::Relaxed};

use geom_core::Point3;
use geom_core::compute::parallel;
use geom_core::compute::parallel::sorted_by_number;
use geom_core::mesh::{FACES, INTERIOR, Region};

use super::raw::Raw;
use crate::AtBox;
use crate::Error;
use crate::complex::Complex;
use crate::complex::collect::{distinct, kinds, seen};
use crate::dual::Probe;

mod aside;
mod base;
pub(crate) mod cut;
mod near;
pub(crate) mod snap;

use base::{Base, BaseTet, planes_of};
use cut::Cut;
use near::Near;

/// What the mesher did.
#[derive(Default)]
pub(super) struct Counts {
    /// Vertices snapped onto the interface.
    pub(super) snapped: usize,
    /// Vertices kept, because snapping would have pinched the interface; their cuts moved away.
    pub(super) clamped: usize,
}

/// Meshes by stuffing, always up to the box: what is snapped shall not depend on what is wanted. `keep` says
/// which regions are wanted; the molecule's surface comes in any case. Of leaves that do not touch the box of cells `within`, only
/// what others share comes.
pub(super) fn mesh(
    complex: &Complex<'_>,
    probe: &Probe<'_>,
    at_box: AtBox,
    within: Option<[[i32; 3]; 2]>,
    keep: impl Fn(Region) -> bool + Sync,
) -> Result<(Raw, Counts), Error> {
    let ghosts = complex.ghosts();
    let base = Base::new(complex, probe, &ghosts, at_box);
    // Where the box cuts the molecule, its pieces close the surface.
    let needed = |r: Region| keep(r) || base.is_clipped() && r == INTERIOR;
    let all = base.tets(within);
    let hot = may_change(&base, &all);
    let is_hot = |t: &BaseTet| t.corners.iter().any(|&v| hot[v as usize]);
    let kept = |fits: &(dyn Fn(&BaseTet) -> bool + Sync)| -> Vec<BaseTet> {
        parallel::flat_map(all.len(), |i| Some(all[i]).filter(fits))
    };
    let near = kept(&is_hot);
    let far = kept(&|t| needed(t.labels[0]) && !is_hot(t));
    drop(all);
    let mut positions = base.positions();
    let mut near = Near::new(&base, &near, &hot)?;
    let counts = near.snap(probe);
    for (sample, &id) in near.samples.iter().zip(&near.ids) {
        positions[id as usize] = sample.x;
    }
    let first = positions.len();
    let cut = near.cut(probe, &mut positions);
    let (meeting, on_surface) = labels_meeting(&near, &cut, first, &keep);
    let mut collector = Collector {
        out: Raw {
            kinds: kinds(&positions, &meeting, complex.tree.cells),
            added: cut.added.len(),
            ..Raw::default()
        },
        positions,
        cells: complex.tree.cells,
        on_surface,
        is_clipped: base.is_clipped(),
        faces: Vec::new(),
    };
    for t in far {
        collector.take_far(t.corners, t.labels[0], &keep);
    }
    for (corners, region) in cut.tets {
        collector.take_near(corners, region, &keep);
    }
    Ok((collector.finish(), counts))
}

/// Which vertices are in tetrahedra with more than one label: whatever touches them may change.
/// By vertex number. Only these can snap, so a tetrahedron without any of them keeps its corners and its place.
fn may_change(base: &Base<'_>, tets: &[BaseTet]) -> Vec<bool> {
    let hot: Vec<AtomicBool> = (0..base.numbering.len())
        .map(|_| AtomicBool::new(false))
        .collect();
    parallel::for_indices(tets.len(), |i| {
        let t = &tets[i];
        if t.labels.iter().any(|&l| l != t.labels[0]) {
            for &v in &t.corners {
                hot[v as usize].store(true, Relaxed);
            }
        }
    });
    hot.into_iter().map(AtomicBool::into_inner).collect()
}

/// How many labels meet at each vertex, as seen by the mesh, and which are on an interface: those snapped to one,
/// and all from number `first` on, which have been added.
fn labels_meeting(
    near: &Near,
    cut: &Cut,
    first: usize,
    keep: impl Fn(Region) -> bool,
) -> (Vec<u8>, Vec<bool>) {
    let mut on_surface = vec![false; first];
    let mut meeting = vec![1; first];
    for (zero, &id) in near.zero.iter().zip(&near.ids) {
        if let Some((a, b)) = zero {
            on_surface[id as usize] = true;
            meeting[id as usize] = distinct([*a, *b].map(|l| seen(l, &keep)));
        }
    }
    let added = cut.added.iter();
    meeting.extend(added.map(|labels| distinct(labels.iter().map(|&l| seen(l, &keep)))));
    on_surface.resize(first + cut.added.len(), true);
    (meeting, on_surface)
}

/// Collects tetrahedra, and the faces that may belong to the surface.
struct Collector {
    out: Raw,
    positions: Vec<Point3>,
    cells: [i32; 3],
    on_surface: Vec<bool>,
    is_clipped: bool,
    /// Corners in order, and as seen from outside.
    faces: Vec<([u32; 3], [u32; 3])>,
}

impl Collector {
    /// A tetrahedron that no interface has changed: only the box can close the surface there.
    fn take_far(&mut self, tet: [u32; 4], region: Region, keep: impl Fn(Region) -> bool) {
        if region == INTERIOR && self.is_clipped {
            self.take_faces(tet, |this, face| this.is_on_box(face));
        }
        self.push(tet, region, keep);
    }

    /// A tetrahedron at an interface.
    fn take_near(&mut self, tet: [u32; 4], region: Region, keep: impl Fn(Region) -> bool) {
        if region == INTERIOR {
            self.take_faces(tet, |this, face| {
                face.iter().all(|&v| this.on_surface[v as usize])
                    || this.is_clipped && this.is_on_box(face)
            });
        }
        self.push(tet, region, keep);
    }

    /// Takes those faces of a tetrahedron of the molecule that may be surface.
    fn take_faces(&mut self, tet: [u32; 4], may: impl Fn(&Self, [u32; 3]) -> bool) {
        for face in FACES.map(|f| f.map(|k| tet[k])) {
            if may(self, face) {
                let mut key = face;
                key.sort_unstable();
                self.faces.push((key, face));
            }
        }
    }

    /// Do all three corners lie in one plane of the box?
    fn is_on_box(&self, face: [u32; 3]) -> bool {
        let planes = |v: &u32| planes_of(&self.positions[*v as usize], self.cells);
        face.iter().fold(!0, |m, v| m & planes(v)) != 0
    }

    fn push(&mut self, tet: [u32; 4], region: Region, keep: impl Fn(Region) -> bool) {
        if keep(region) {
            self.out.tets.push(tet);
            self.out.regions.push(region);
        }
    }

    /// The surface are the faces of the molecule that no other tetrahedron of it has.
    /// A face between two of its tetrahedra comes twice and goes; sorted by corners, so that the order of triangles is
    /// that of vertices.
    fn finish(mut self) -> Raw {
        let faces = sorted_by_number(self.faces.len(), |i| self.faces[i], |face| face.0[0]);
        self.out.triangles = faces
            .chunk_by(|a, b| a.0 == b.0)
            .filter(|group| group.len() == 1)
            .map(|group| group[0].1)
            .collect();
        self.out.positions = self.positions;
        self.out
    }
}
