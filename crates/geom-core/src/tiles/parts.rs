//! The connected surfaces of a body in tiles.
//!
//! In three steps: faces between a molecule's tetrahedra and anything else ([`surface`]), their parts within a tile
//! ([`Local::of`]), and these joined across tiles ([`closed`]), where only pairs of parts travel. Bodies have positive
//! volumes, cavities negative ones.

use bytemuck::{Pod, Zeroable};

use super::border::{Border, Ghost};
use super::exchange::{Deal, Exchange, Lost, exchanged, gathered};
use super::piece::Piece;
use crate::compute::sets::DisjointSets;
use crate::mesh::{FACES, INTERIOR};

/// The part of the body's surface in a tile: faces of its own tetrahedra of the molecule with no such tetrahedron beyond,
/// seen from outside.
///
/// A face counts if one tetrahedron of region [`INTERIOR`] has it and no second one has, be it of this tile or among
/// `ghosts`. `ids` are those of [`Border::ids`]. Triangles are numbers of the piece's vertices, in the order of the
/// global numbers of their faces; a face belongs to the tile of its tetrahedron, so that those of all tiles are the
/// surface, each once. By sorting, O(n log n).
pub fn surface(piece: &Piece, ids: &[u64], ghosts: &[Ghost]) -> Vec<[u32; 3]> {
    let ordered = |mut face: [u64; 3]| {
        face.sort_unstable();
        face
    };
    let own = piece.mesh.tets().iter().zip(piece.mesh.regions());
    let own = own.filter(|(_, region)| **region == INTERIOR);
    let mut faces: Vec<([u64; 3], Option<[u32; 3]>)> = own
        .flat_map(|(tet, _)| FACES.map(|f| f.map(|k| tet[k])))
        .map(|face| (ordered(face.map(|v| ids[v as usize])), Some(face)))
        .collect();
    let beyond = ghosts.iter().filter(|g| g.region == u16::from(INTERIOR));
    let beyond = beyond.flat_map(|g| FACES.map(|f| ordered(f.map(|k| g.ids[k]))));
    faces.extend(beyond.map(|face| (face, None)));
    faces.sort_unstable();
    let alone = faces.chunk_by(|a, b| a.0 == b.0).filter(|g| g.len() == 1);
    alone.filter_map(|group| group[0].1).collect()
}

/// A closed surface of the body.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct Closed {
    /// Volume that it encloses, Å³: of a cavity negative.
    /// By the divergence theorem over its triangles, hence true only of the whole surface and not of the part in a
    /// tile.
    pub volume: f64,
    /// Its triangles.
    pub triangles: u64,
}

/// The parts of a tile's surface, before they are joined with those of others.
///
/// All that has to be kept of a surface once a tile is put aside.
#[derive(Clone, Debug, Default)]
pub struct Local {
    /// What each has here.
    parts: Vec<Closed>,
    /// The part at each vertex of the border that is on the surface, ascending.
    at: Vec<(u32, u32)>,
}

impl Local {
    /// The parts of a tile's surface.
    ///
    /// `surface` is that of [`surface`]. Triangles that have a vertex in common are in one part, also where they touch
    /// in that vertex alone.
    pub fn of(piece: &Piece, border: &Border, surface: &[[u32; 3]]) -> Self {
        let positions = piece.mesh.positions();
        let mut sets = DisjointSets::new(positions.len());
        let mut on = vec![false; positions.len()];
        for t in surface {
            sets.join(t[0], t[1]);
            sets.join(t[0], t[2]);
            t.iter().for_each(|&v| on[v as usize] = true);
        }
        let mut number = vec![u32::MAX; positions.len()];
        let mut parts: Vec<Closed> = Vec::new();
        for t in surface {
            let root = sets.find(t[0]) as usize;
            if number[root] == u32::MAX {
                number[root] = parts.len() as u32;
                parts.push(Closed::zeroed());
            }
            let part = &mut parts[number[root] as usize];
            let [a, b, c] = t.map(|v| positions[v as usize].coords);
            part.volume += a.dot(&b.cross(&c)) / 6.0;
            part.triangles += 1;
        }
        let mut shared: Vec<u32> = border.links.iter().map(|l| l.vertex).collect();
        shared.dedup();
        let at = shared.into_iter().filter(|&v| on[v as usize]);
        let at = at.map(|v| (v, number[sets.find(v) as usize])).collect();
        Self { parts, at }
    }
}

/// A part of a surface that goes on at a vertex of another tile.
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct Meets {
    part: u64,
    tile: u32,
    vertex: u32,
}

/// The closed surfaces of all tiles, by the number of their first part; the same on every rank.
///
/// Sums are taken in the order of tiles, so that they have the same bits for any number of ranks. Each rank holds all
/// parts and all pairs for a moment; they are few next to triangles.
///
/// # Errors
/// [`Lost`], if another rank has ended.
pub fn closed(
    exchange: &(impl Exchange + ?Sized),
    deal: &Deal,
    borders: &[Border],
    locals: &[Local],
) -> Result<Vec<Closed>, Lost> {
    let own = locals.iter().map(|l| l.parts.len() as u64).sum();
    let (mut first, total) = exchange.scan(own)?;
    let firsts: Vec<u64> = locals
        .iter()
        .map(|local| {
            let own = first;
            first += local.parts.len() as u64;
            own
        })
        .collect();
    let part_at = |i: usize, v: u32| {
        let local: &Local = &locals[i];
        let at = local.at.binary_search_by_key(&v, |a| a.0).ok()?;
        Some(firsts[i] + u64::from(local.at[at].1))
    };
    let mut to = vec![Vec::new(); deal.ranks];
    for (i, border) in borders.iter().enumerate() {
        for link in border.links.iter().filter(|l| l.other < l.tile) {
            if let Some(part) = part_at(i, link.vertex) {
                to[deal.rank_of(link.other as usize)].push(Meets {
                    part,
                    tile: link.other,
                    vertex: link.theirs,
                });
            }
        }
    }
    let first_tile = deal.of(exchange.rank()).start;
    let mut pairs: Vec<[u64; 2]> = exchanged(exchange, &to)?
        .into_iter()
        .flatten()
        .filter_map(|m| Some([part_at(m.tile as usize - first_tile, m.vertex)?, m.part]))
        .collect();
    pairs.sort_unstable();
    pairs.dedup();
    let mut sets = crate::compute::sets::Sets::<usize>::new(total as usize);
    for [a, b] in gathered(exchange, &pairs)?.into_iter().flatten() {
        sets.join(a as usize, b as usize);
    }
    let own: Vec<Closed> = locals
        .iter()
        .flat_map(|l| l.parts.iter().copied())
        .collect();
    let all = gathered(exchange, &own)?.into_iter().flatten();
    let roots = sets.into_roots();
    let mut sums = vec![Closed::zeroed(); roots.len()];
    for (part, &root) in all.zip(&roots) {
        sums[root].volume += part.volume;
        sums[root].triangles += part.triangles;
    }
    Ok(sums.into_iter().filter(|part| part.triangles > 0).collect())
}
