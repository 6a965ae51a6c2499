//! Folds that are opened place by place: what is around them moves, and all else stays.

use std::collections::{BTreeMap, BTreeSet};

use geom_core::compute::parallel;
use geom_core::compute::sets::DisjointSets;

use super::align::align;
use super::effort::Effort;
use super::scope::Scope;
use super::untangle::{Moves, untangle};
use super::{BAD, STUCK, Unfolder, Wanted};
use crate::Error;

/// Where a place starts to unfold from.
#[derive(Clone, Copy, PartialEq)]
enum Start {
    AsItIs,
    /// As far as it can be made monotone.
    Aligned,
    /// From the optimum of Eq. 4.10 there.
    Optimum,
}

impl Unfolder<'_> {
    /// Untangles what is around each of some [`places`](Self::places), with these triangles held upright.
    ///
    /// They share no triangle, so that they move side by side, each for as many evaluations as there are left for all of their
    /// triangles.
    pub(crate) fn unfold_places(
        &self,
        places: &[Vec<usize>],
        held: &[usize],
        w: &mut [f64],
    ) -> Result<(), Error> {
        let Self {
            system,
            frames,
            field,
            run,
            ..
        } = *self;
        let places = self.scopes(places);
        debug_assert!(are_apart(&places));
        let all: usize = places.iter().map(|scope| scope.faces.len()).sum();
        let each = self.effort.left() / all.max(1) as u64;
        let before = &*w;
        let moved = parallel::map_each(&places, |scope| {
            let worth = each * scope.faces.len() as u64;
            let effort = Effort::worth(worth);
            let unfolder = Unfolder {
                system,
                frames,
                field,
                effort: &effort,
                run,
            };
            let mut w = before.to_vec();
            unfolder.unfold_place(scope, held, &mut w)?;
            Ok::<_, Error>((scope.of(&w), worth - effort.left()))
        });
        for (scope, moved) in places.iter().zip(moved) {
            let (x, spent) = moved?;
            self.effort.spend(spent as usize);
            scope.put(&x, w);
        }
        Ok(())
    }

    /// What moves around each of some lists of vertices.
    fn scopes(&self, places: &[Vec<usize>]) -> Vec<Scope> {
        let (system, frames) = (self.system, self.frames);
        parallel::map_each(places, |vertices| {
            let mut is_near = vec![false; system.seams.copies()];
            for h in vertices.iter().flat_map(|&v| frames.around(v)) {
                is_near[system.cut.copy[h] as usize] = true;
            }
            Scope::of_copies(system, |copy| is_near[copy as usize])
        })
    }

    /// Untangles one of them: from where it is, and if some of it stays folded from where it is as monotone as it can be, and from the
    /// optimum of Eq. 4.10 there, since folds that hold each other are gone in that. What folds less is taken.
    fn unfold_place(&self, scope: &Scope, held: &[usize], w: &mut [f64]) -> Result<(), Error> {
        let Self { system, frames, .. } = *self;
        let Some(factor) = scope.factored(system)? else {
            return Ok(());
        };
        let corners_of = scope.faces.iter().flat_map(|&f| 3 * f..3 * f + 3);
        let mut moved: Vec<usize> = corners_of.map(|h| frames.from(h)).collect();
        moved.sort_unstable();
        moved.dedup();
        let (seams, cut) = (system.seams, system.cut);
        let count = |wanted: Wanted, w: &[f64]| {
            let corners = |f: usize| [0, 1, 2].map(|k| seams.copy(w, cut.copy[3 * f + k]));
            self.vertices(corners, &moved, wanted).len()
        };
        let moves = Moves {
            scope,
            bend: &|gradient: &[f64]| {
                let mut bent = gradient.to_vec();
                factor.solve_in_place(&mut bent, 1)?;
                Ok(bent)
            },
            held: held.to_vec(),
            effort: self.effort,
            is_lost: &|w: &[f64]| count(STUCK, w) > 0,
            may_fold: true,
        };
        let first = scope.of(w);
        let mut best = (count(BAD, w), first.clone());
        for start in [Start::AsItIs, Start::Aligned, Start::Optimum] {
            scope.put(&first, w);
            match start {
                Start::AsItIs => {}
                Start::Aligned => align(system, w, &moves, self.run)?,
                Start::Optimum => scope.relax(system, &factor, w)?,
            }
            untangle(system, w, &moves, self.run)?;
            let bad = count(BAD, w);
            // Something else is as good as what it was, for wider surroundings.
            if bad < best.0 || (start == Start::AsItIs && bad == best.0) {
                best = (bad, scope.of(w));
            }
            if bad == 0 {
                break;
            }
        }
        scope.put(&best.1, w);
        Ok(())
    }

    /// The surroundings of some vertices, so many rings wide, in their connected pieces, by their lowest vertices.
    pub(crate) fn places(&self, vertices: &[usize], rings: usize) -> Vec<Vec<usize>> {
        let near = self.frames.within(vertices, rings);
        let mut sets = DisjointSets::new(near.len());
        for [a, b] in self.frames.sides().filter(|&[a, b]| near[a] && near[b]) {
            sets.join(a as u32, b as u32);
        }
        let root = sets.into_roots();
        // By their lowest vertices, which name them.
        let mut places: BTreeMap<u32, Vec<usize>> = BTreeMap::new();
        for v in (0..near.len()).filter(|&v| near[v]) {
            places.entry(root[v]).or_default().push(v);
        }
        places.into_values().collect()
    }
}

/// Does no triangle move with two of them? Pieces have no vertex beside that of another, and coordinates on a line, which several
/// vertices share, are integers.
fn are_apart(scopes: &[Scope]) -> bool {
    let mut faces = scopes.iter().flat_map(|scope| &scope.faces);
    let mut seen = BTreeSet::new();
    faces.all(|face| seen.insert(face))
}
