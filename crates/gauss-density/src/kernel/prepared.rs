//! A model made ready: the levels that matter, and boxes around runs of atoms.
//!
//! The runs are what the search for atoms near a box goes by. Atoms that follow each other in a file mostly lie beside
//! each other, so runs of the model's own order make tight boxes, and whatever is found keeps that order without a
//! sort.

use geom_core::compute::parallel;
use geom_core::{Aabb, Point3};

use crate::kernel::boxes::gap_squared;
use crate::model::reach::Reach;
use crate::model::{Level, Model};

/// A model made ready for sampling, shared by the backends.
///
/// Made once per call of a verb, in one pass over atoms and nodes. It borrows the model and holds, besides, a copy of
/// the levels that matter, the node above each atom and node, and boxes around the atoms. Backends are handed it; from
/// outside it gives access to the model alone.
#[derive(Clone, Debug)]
pub struct Prepared<'a> {
    pub(crate) model: &'a Model,
    /// The levels that matter, lowest first: those whose powers are all 1 have merged with the next.
    pub(crate) levels: Vec<Level>,
    /// `parent[0]`: node on level 0 per atom; `parent[l]`: node on level `l` per node of level `l − 1`.
    pub(crate) parent: Vec<Vec<u32>>,
    pub(crate) reach: Reach,
    /// First atom per cluster (a run of atoms), and the number of atoms at the end.
    starts: Vec<u32>,
    /// Box around the centres of each cluster.
    boxes: Vec<Aabb>,
}

/// Atoms per cluster, at most, and the largest extent, Å.
/// A run that jumps, from one chain to the next or between scattered waters, ends where the box would become too large.
const CLUSTER: usize = 24;
const CLUSTER_EXTENT: f64 = 9.0;

impl<'a> Prepared<'a> {
    /// Prepares a model.
    /// Nothing is checked: a [`Model`] is in order by construction.
    pub fn new(model: &'a Model) -> Self {
        let levels = model.compiled_levels();
        let reach = Reach::new(model, &levels);
        Self::of_part(model, levels, reach)
    }

    /// A part of a model, whose levels and reach are those of the whole.
    pub(crate) fn of_part(model: &'a Model, levels: Vec<Level>, reach: Reach) -> Self {
        let parent = levels.iter().map(Level::parents).collect();
        let (mut starts, mut boxes) = (vec![0], Vec::new());
        let mut around = Aabb::EMPTY;
        for (i, center) in model.centers().iter().enumerate() {
            let mut grown = around;
            grown.include(*center);
            let run = i - *starts.last().expect("starts with 0") as usize;
            if run > 0 && (run == CLUSTER || grown.extent().max() > CLUSTER_EXTENT) {
                starts.push(i as u32);
                boxes.push(around);
                grown = Aabb::new(*center, *center);
            }
            around = grown;
        }
        starts.push(model.atoms() as u32);
        boxes.push(around);
        Self {
            model,
            levels,
            parent,
            reach,
            starts,
            boxes,
        }
    }

    /// The model.
    pub fn model(&self) -> &'a Model {
        self.model
    }

    /// `−q_a(x)`: the logarithm of the kernel of an atom.
    pub(crate) fn ln_kernel(&self, atom: usize, x: &Point3) -> f64 {
        let model = self.model;
        let r = model.radii()[atom];
        model.decays()[atom] * (r * r - (x - model.centers()[atom]).norm_squared())
    }

    /// How many levels end between two atoms: all up to the first that they share.
    /// Without a next atom all of them. It is what lets a tree be summed in one pass over its atoms, with one open sum
    /// per level.
    pub(crate) fn levels_that_end(&self, atom: u32, next: Option<u32>) -> usize {
        let Some(next) = next else {
            return self.levels.len();
        };
        let (mut a, mut b) = (atom, next);
        for (level, parent) in self.parent.iter().enumerate() {
            (a, b) = (parent[a as usize], parent[b as usize]);
            if a == b {
                return level;
            }
        }
        self.levels.len()
    }

    /// All clusters.
    pub(crate) fn clusters(&self) -> Vec<u32> {
        (0..self.boxes.len() as u32).collect()
    }

    /// The clusters among `of` with an atom that may lie within `reach` of the box.
    /// Side by side if there are many; the order stays.
    pub(crate) fn near(&self, of: &[u32], region: &Aabb, reach: f64) -> Vec<u32> {
        let squared = reach * reach;
        let is_near = |c: &u32| gap_squared(&self.boxes[*c as usize], region) <= squared;
        if of.len() > 100_000 {
            parallel::flat_map(of.len(), |i| Some(of[i]).filter(is_near))
        } else {
            of.iter().copied().filter(is_near).collect()
        }
    }

    /// The atoms of clusters that lie within `reach` of the box, ascending.
    pub(crate) fn atoms_near(&self, clusters: &[u32], region: &Aabb, reach: f64) -> Vec<u32> {
        let squared = reach * reach;
        let centers = self.model().centers();
        let near = |a: &u32| region.distance_squared(&centers[*a as usize]) <= squared;
        clusters
            .iter()
            .flat_map(|&c| self.starts[c as usize]..self.starts[c as usize + 1])
            .filter(near)
            .collect()
    }
}
