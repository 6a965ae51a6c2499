//! The interface around a vertex: a closed fan of triangles on a surface, three open ones where three regions meet.

use geom_core::compute::parallel;
use geom_core::mesh::{FACES, OUTSIDE, Region};

use crate::mesh::editable::EditableMesh;
use crate::mesh::incidence::NONE;

/// The interface faces around each vertex.
/// In one array, by vertex. Others are in the order in which the triangle is counter-clockwise seen from the higher
/// region.
pub(super) struct InterfaceFaces {
    starts: Vec<usize>,
    faces: Vec<InterfaceFace>,
}

#[derive(Clone, Copy)]
pub(super) struct InterfaceFace {
    /// The other two corners; the third is the vertex.
    pub(super) others: [u32; 2],
    pub(super) pair: [Region; 2],
}

impl InterfaceFaces {
    pub(super) fn new(mesh: &EditableMesh, beyond: &[[u32; 4]]) -> Self {
        let found: Vec<([u32; 3], [Region; 2])> = parallel::flat_map(mesh.tets.len(), |t| {
            (0..4).filter_map(move |k| {
                let o = beyond[t][k];
                let mine = mesh.regions[t];
                let theirs = if o == NONE {
                    OUTSIDE
                } else {
                    mesh.regions[o as usize]
                };
                // Each face once, from the side of the smaller region.
                (mine < theirs).then(|| (FACES[k].map(|i| mesh.tets[t][i]), [mine, theirs]))
            })
        });
        let mut counts = vec![0u32; mesh.x.len()];
        for &v in found.iter().flat_map(|f| &f.0) {
            counts[v as usize] += 1;
        }
        let starts = parallel::starts_of(&counts);
        let mut at = starts.clone();
        let blank = InterfaceFace {
            others: [NONE; 2],
            pair: [0; 2],
        };
        let mut faces = vec![blank; 3 * found.len()];
        for ([a, b, c], pair) in found {
            for (v, others) in [(a, [b, c]), (b, [c, a]), (c, [a, b])] {
                faces[at[v as usize]] = InterfaceFace { others, pair };
                at[v as usize] += 1;
            }
        }
        Self { starts, faces }
    }

    pub(super) fn of(&self, v: u32) -> &[InterfaceFace] {
        &self.faces[self.starts[v as usize]..self.starts[v as usize + 1]]
    }
}

/// Do the faces form one closed fan between the same two regions?
/// Walks from spoke to spoke: each must start exactly one face, and the walk must come back having met all of them.
pub(super) fn is_disk(fan: &[InterfaceFace]) -> bool {
    let Some(pair) = fan.first().map(|f| f.pair) else {
        return false;
    };
    let same = fan.iter().all(|f| f.pair == pair);
    let start = fan[0].others[0];
    let mut at = start;
    for step in 1..=fan.len() {
        let mut next = fan.iter().filter(|f| f.others[0] == at);
        let (Some(face), None) = (next.next(), next.next()) else {
            return false;
        };
        at = face.others[1];
        if at == start {
            return same && step == fan.len();
        }
    }
    false
}

/// The faces between two of three regions that meet along a curve through a vertex.
pub(super) struct Page {
    pub(super) pair: [Region; 2],
    /// The neighbours on the curve, ascending.
    ends: [u32; 2],
}

/// The three open fans around a vertex on a curve in which three regions meet; `None` for any other vertex.
/// Each runs from one neighbour on the curve to the other, and none meets another between.
pub(super) fn pages(fan: &[InterfaceFace]) -> Option<[Page; 3]> {
    let mut pairs: Vec<[Region; 2]> = fan.iter().map(|f| f.pair).collect();
    pairs.sort_unstable();
    pairs.dedup();
    let pairs: [_; 3] = pairs.try_into().ok()?;
    let [a, b, c] = pairs.map(|pair| page(fan, pair));
    let pages = [a?, b?, c?];
    pages
        .iter()
        .all(|page| page.ends == pages[0].ends)
        .then_some(pages)
}

/// The faces of one pair of regions, if they are one open fan.
fn page(fan: &[InterfaceFace], pair: [Region; 2]) -> Option<Page> {
    let own = || fan.iter().filter(|f| f.pair == pair);
    let mut starts = own().filter(|f| own().all(|g| g.others[1] != f.others[0]));
    let (first, None) = (starts.next()?, starts.next()) else {
        return None;
    };
    let [start, mut end] = first.others;
    for _ in 1..own().count() {
        let mut next = own().filter(|f| f.others[0] == end);
        let (face, None) = (next.next()?, next.next()) else {
            return None;
        };
        end = face.others[1];
    }
    let ends = [start.min(end), start.max(end)];
    Some(Page { pair, ends })
}
