//! The connected components of a surface, and which of them each vertex of a mesh on it is on.

use std::cmp::Reverse;
use std::collections::BTreeMap;

use geom_core::compute::sets::DisjointSets;
use geom_core::search::bvh::{Closest, TriangleTree};
use geom_core::surface::ground::Ground;
use geom_core::{QuadMesh, TriMesh};

use super::lines::Lines;
use crate::Error;

/// What vertices move on, component by component: where these touch, the nearest point of all may be that of another.
pub(super) struct Surface<'a> {
    pub(super) grounds: Vec<Ground<'a>>,
    /// All components one after the other, and where the triangles of each end; `None` for one.
    whole: Option<(TriangleTree, Vec<usize>)>,
}

fn joined(components: &[TriMesh]) -> Result<(TriangleTree, Vec<usize>), Error> {
    let (mut positions, mut triangles, mut ends) = (Vec::new(), Vec::new(), Vec::new());
    for part in components {
        let first = positions.len() as u32;
        positions.extend_from_slice(part.positions());
        triangles.extend(part.triangles().iter().map(|t| t.map(|v| v + first)));
        ends.push(triangles.len());
    }
    Ok((
        TriangleTree::new(&TriMesh::new(positions, triangles)?)?,
        ends,
    ))
}

impl<'a> Surface<'a> {
    /// With sharp edges of this many degrees, and the boundary if the mesh on it has one.
    pub(super) fn of(
        components: &'a [TriMesh],
        crease: Option<f64>,
        with_boundary: bool,
    ) -> Result<Self, Error> {
        let ground = |part: &'a TriMesh| {
            let lines = Lines::of(part, crease, with_boundary)?.all;
            Ok(Ground::new(part, lines)?)
        };
        let grounds: Result<Vec<Ground<'a>>, Error> = components.iter().map(ground).collect();
        let whole = match components {
            [_] => None,
            several => Some(joined(several)?),
        };
        Ok(Self {
            grounds: grounds?,
            whole,
        })
    }

    /// Which component each vertex of a mesh on it is on: the one that most vertices of its own connected part are nearest
    /// to.
    pub(super) fn parts(&self, mesh: &QuadMesh) -> Result<Vec<u32>, Error> {
        let positions = mesh.positions();
        let Some((tree, ends)) = &self.whole else {
            return Ok(vec![0; positions.len()]);
        };
        let mut sets = DisjointSets::new(positions.len());
        for quad in mesh.quads() {
            quad.windows(2).for_each(|side| sets.join(side[0], side[1]));
        }
        let root = sets.into_roots();
        let nearest = tree.closest_to_all(positions)?;
        let component = |c: &Closest| ends.partition_point(|&end| end <= c.triangle as usize);
        let mut votes: BTreeMap<u32, BTreeMap<usize, usize>> = BTreeMap::new();
        for (&root, closest) in root.iter().zip(&nearest) {
            let of_part = votes.entry(root).or_default();
            *of_part.entry(component(closest)).or_default() += 1;
        }
        let elected = |root: &u32| {
            let all = votes[root]
                .iter()
                .map(|(&part, &count)| (count, Reverse(part)));
            all.max().map_or(0, |(_, Reverse(part))| part as u32)
        };
        Ok(root.iter().map(elected).collect())
    }
}
