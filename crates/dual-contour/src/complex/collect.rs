//! Lists of elements put together: joined in order, renumbered, and how their vertices may move.

use geom_core::Point3;
use geom_core::compute::parallel;
use geom_core::mesh::{OUTSIDE, Region, VertexKind};

/// Marks a vertex that a batch has added on an edge, by its number within the batch.
pub(crate) const ADDED: u32 = 1 << 31;

/// One list of all, in order; `f` sees the number of the list that an item comes from.
/// The lists are written side by side, each to its place, so that what batches have made in parallel has the order of
/// the batches.
pub(crate) fn joined<T: Copy + Default + Send + Sync>(
    lists: Vec<Vec<T>>,
    f: impl Fn(usize, T) -> T + Sync,
) -> Vec<T> {
    let mut out = vec![T::default(); lists.iter().map(Vec::len).sum()];
    let mut rest = out.as_mut_slice();
    let mut parts = Vec::with_capacity(lists.len());
    for list in lists {
        let (part, others) = std::mem::take(&mut rest).split_at_mut(list.len());
        rest = others;
        parts.push((part, list));
    }
    parallel::for_each(&mut parts, |i, (part, list)| {
        for (to, &from) in part.iter_mut().zip(list.iter()) {
            *to = f(i, from);
        }
    });
    out
}

/// A label as the mesh sees it: regions that are not kept are all the outside.
pub(crate) fn seen(label: Region, keep: impl Fn(Region) -> bool) -> Region {
    if keep(label) { label } else { OUTSIDE }
}

/// The number of different labels, up to three.
pub(crate) fn distinct(labels: impl IntoIterator<Item = Region>) -> u8 {
    let mut found = [0; 2];
    let mut n = 0;
    for l in labels {
        if !found[..n].contains(&l) {
            if n == 2 {
                return 3;
            }
            found[n] = l;
            n += 1;
        }
    }
    n as u8
}

/// How vertices may move: where they stand on the box, and how many labels meet there.
/// One label: as its place on the box says. Two and more, off the box: on the surface. On the box: not at all.
/// Positions of the box are exact, so they are compared without a tolerance.
pub(crate) fn kinds(positions: &[Point3], meeting: &[u8], cells: [i32; 3]) -> Vec<VertexKind> {
    let both = positions.len().min(meeting.len());
    parallel::map(both, |v| {
        match (box_kind(&positions[v], cells), meeting[v]) {
            (kind, 0 | 1) => kind,
            (VertexKind::Interior, _) => VertexKind::Surface,
            _ => VertexKind::Fixed,
        }
    })
}

/// How a vertex at `p` (finest cells) may move if the domain has `cells` cells.
fn box_kind(p: &Point3, cells: [i32; 3]) -> VertexKind {
    let on = [0, 1, 2].map(|k| p[k] == 0.0 || p[k] == f64::from(cells[k]));
    match on.iter().filter(|&&o| o).count() {
        0 => VertexKind::Interior,
        1 => VertexKind::BoxFace {
            axis: on.iter().position(|&o| o).expect("one axis") as u8,
        },
        2 => VertexKind::BoxEdge {
            axis: on.iter().position(|&o| !o).expect("one axis") as u8,
        },
        _ => VertexKind::Fixed,
    }
}

/// The vertices that elements use, in order; renumbers the elements in place.
/// Gives the old number of each vertex that is left.
pub(crate) fn compact<const N: usize>(vertices: usize, elements: &mut [[u32; N]]) -> Vec<u32> {
    let mut used = vec![false; vertices];
    for &v in elements.iter().flatten() {
        used[v as usize] = true;
    }
    let mut number = vec![u32::MAX; vertices];
    let mut kept = Vec::new();
    for (v, _) in used.iter().enumerate().filter(|(_, u)| **u) {
        number[v] = kept.len() as u32;
        kept.push(v as u32);
    }
    parallel::for_each(elements, |_, e| *e = e.map(|v| number[v as usize]));
    kept
}
