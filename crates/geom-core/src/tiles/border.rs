//! Who shares which vertex, global numbers, and what lies beyond a border.
//!
//! Vertices are the same if their positions have the same bits ([`key`]), so that tiles need no numbers in common to
//! find out what they share: each says the keys of its border to the rank that a hash of the key names, which sees all
//! that have one and tells them of each other. That takes two exchanges, the numbers two more.

use std::ops::Range;

use bytemuck::{Pod, Zeroable};

use super::exchange::{Deal, Exchange, Lost, exchanged};
use super::piece::{Piece, key};
use crate::mesh::Region;
use crate::{Aabb, Point3};

/// A vertex of a tile that another tile has too.
///
/// Every pair of tiles with a vertex in common has two links for it, one told to each. A border has them sorted by
/// vertex, then by the other tile.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Pod, Zeroable)]
#[repr(C)]
pub struct Link {
    /// The tile that this is told to.
    pub tile: u32,
    /// The number of the vertex there.
    /// Into the positions of its piece's mesh.
    pub vertex: u32,
    /// The other tile.
    pub other: u32,
    /// The number of the vertex in the other.
    pub theirs: u32,
}

/// A tetrahedron of another tile that touches a vertex of this one, or one that does.
///
/// A copy, for what asks of the neighbourhood of a vertex; its owner alone may change it.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct Ghost {
    /// The tile that this is told to.
    pub tile: u32,
    /// Its owner.
    pub owner: u32,
    /// Its number there.
    pub element: u32,
    /// Its region.
    /// Wider than a [`Region`], since a record that is sent has no padding.
    pub region: u16,
    /// Its layer: 1 if it touches a vertex of the tile, 2 if only one of the first layer.
    pub layer: u16,
    /// Global numbers of its corners.
    /// In the order of the owner's mesh, so that orientation stays.
    pub ids: [u64; 4],
    /// Where they are, Å.
    pub corners: [[f64; 3]; 4],
}

/// What the rest of the work needs to know of a tile, once its piece is put aside: little more than its border.
#[derive(Clone, Debug, Default)]
pub struct Border {
    /// Vertices of the piece.
    pub vertices: usize,
    /// Tetrahedra of the piece.
    pub elements: usize,
    /// Around the piece, if it has vertices.
    /// `None` for a tile without elements.
    pub bounds: Option<Aabb>,
    /// Those that others may share, ascending.
    shared: Vec<(u32, [u64; 3])>,
    /// The tetrahedra that touch them, and those that touch these, ascending.
    tets: Vec<(u32, [u32; 4], Region)>,
    /// Where the corners of these are, ascending by number.
    positions: Vec<(u32, Point3)>,
    /// The vertices that others share, sorted.
    /// Empty until [`number`] has been called.
    pub links: Vec<Link>,
    /// The number of the first vertex that the tile owns.
    /// Global numbers follow the order of the vertices in the tile, so that the first one and those of others say all.
    first: u64,
    /// The global numbers of the vertices that others own, ascending by number in the tile.
    foreign: Vec<(u32, u64)>,
}

impl Border {
    /// The border of a piece.
    ///
    /// Not linked or numbered yet. `Border::default()` is that of a tile without elements. One pass over the elements,
    /// and memory for those that touch vertices which may be shared.
    pub fn of(piece: &Piece) -> Self {
        let mesh = &piece.mesh;
        let is_shared = |v: u32| piece.shared[v as usize];
        let mut near = piece.shared.clone();
        let touches = |tet: &&[u32; 4], of: &[bool]| tet.iter().any(|&v| of[v as usize]);
        let first = mesh.tets().iter().filter(|tet| touches(tet, &piece.shared));
        first.flatten().for_each(|&v| near[v as usize] = true);
        let each = (0..).zip(mesh.tets()).zip(mesh.regions());
        let tets: Vec<_> = each
            .filter(|((_, tet), _)| touches(tet, &near))
            .map(|((t, tet), region)| (t, *tet, *region))
            .collect();
        let mut used: Vec<u32> = tets.iter().flat_map(|t| t.1).collect();
        used.sort_unstable();
        used.dedup();
        let at = |v: u32| mesh.positions()[v as usize];
        let vertices = mesh.positions().len() as u32;
        let shared = (0..vertices).filter(|&v| is_shared(v));
        Self {
            vertices: mesh.positions().len(),
            elements: mesh.tets().len(),
            bounds: (!mesh.positions().is_empty()).then(|| mesh.bounds()),
            shared: shared.map(|v| (v, key(&at(v)))).collect(),
            tets,
            positions: used.into_iter().map(|v| (v, at(v))).collect(),
            ..Self::default()
        }
    }

    /// Where a corner of one of its tetrahedra is.
    fn place(&self, vertex: u32) -> [f64; 3] {
        let at = self.positions.binary_search_by_key(&vertex, |p| p.0);
        at.map_or([f64::NAN; 3], |i| self.positions[i].1.into())
    }

    /// The vertices that the tile owns: those that no lower tile has.
    ///
    /// Only links can tell, hence after these.
    fn owned(&self) -> u64 {
        (self.vertices - self.not_owned().count()) as u64
    }

    /// The vertices that lower tiles have, ascending.
    fn not_owned(&self) -> impl Iterator<Item = u32> {
        let shared = self.links.chunk_by(|a, b| a.vertex == b.vertex);
        let foreign = shared.filter(|links| links.iter().any(|l| l.other < l.tile));
        foreign.map(|links| links[0].vertex)
    }

    /// The global numbers of all vertices.
    ///
    /// One per vertex of the piece, in its order, below the number that [`number`] has given. Made anew with each call,
    /// since for most of a tile they need not be kept: O(vertices × log border). Without [`number`] they are those of a
    /// tile alone.
    pub fn ids(&self) -> Vec<u64> {
        let mut ids = vec![u64::MAX; self.vertices];
        for &(v, id) in &self.foreign {
            ids[v as usize] = id;
        }
        let foreign: Vec<u32> = self.not_owned().collect();
        let mut next = self.first;
        for (v, id) in ids.iter_mut().enumerate() {
            if foreign.binary_search(&(v as u32)).is_err() {
                *id = next;
                next += 1;
            }
        }
        ids
    }
}

/// The key of a vertex that may be shared, and whose it is.
///
/// Sorted by key first: claims of one vertex come together.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Pod, Zeroable)]
#[repr(C)]
struct Claim {
    key: [u64; 3],
    tile: u32,
    vertex: u32,
}

/// The global number of a vertex, for a tile that does not own it.
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct Named {
    id: u64,
    tile: u32,
    vertex: u32,
}

/// Finds out which vertices are shared, and numbers all: each belongs to the lowest tile that has it, and the vertices
/// of a tile follow those of the tiles before. `borders` are those of this rank's tiles. Gives how many vertices there
/// are in all.
///
/// `borders[i]` belongs to tile `deal.of(rank).start + i`. Numbers depend on the tiles alone: they are the same for any
/// number of ranks. May be called again after pieces have changed; what was found before is forgotten.
///
/// ```
/// use geom_core::Point3;
/// use geom_core::mesh::shapes;
/// use geom_core::tiles::border::{Border, number};
/// use geom_core::tiles::exchange::Deal;
/// use geom_core::tiles::{Piece, Solo};
/// // A ball in a box, dealt to two tiles: each vertex of the cut is counted once.
/// let mesh = shapes::ball_in_box(2.0, 4.0, 2);
/// let vertices = mesh.positions().len();
/// let whole = Piece { shared: vec![false; vertices], mesh };
/// let left = |corners: [Point3; 4]| usize::from(corners.iter().map(|x| x.x).sum::<f64>() < 0.0);
/// let mut borders: Vec<Border> = whole.dealt(left).values().map(Border::of).collect();
/// assert_eq!(number(&Solo, &Deal { tiles: 2, ranks: 1 }, &mut borders), Ok(vertices as u64));
/// assert!(borders[0].vertices + borders[1].vertices > vertices);
/// ```
///
/// # Errors
/// [`Lost`], if another rank has ended.
pub fn number(
    exchange: &(impl Exchange + ?Sized),
    deal: &Deal,
    borders: &mut [Border],
) -> Result<u64, Lost> {
    for border in &mut *borders {
        // What an earlier round has found, when the others had other vertices.
        border.links.clear();
        border.foreign.clear();
    }
    link(exchange, deal, borders)?;
    let own = borders.iter().map(Border::owned).sum();
    let (mut first, total) = exchange.scan(own)?;
    for border in borders.iter_mut() {
        border.first = first;
        first += border.owned();
    }
    // Owners tell the others.
    let mut to = vec![Vec::new(); deal.ranks];
    for border in borders.iter().filter(|border| !border.links.is_empty()) {
        let ids = border.ids();
        let foreign: Vec<u32> = border.not_owned().collect();
        let owned = |link: &&Link| foreign.binary_search(&link.vertex).is_err();
        for link in border.links.iter().filter(owned) {
            to[deal.rank_of(link.other as usize)].push(Named {
                id: ids[link.vertex as usize],
                tile: link.other,
                vertex: link.theirs,
            });
        }
    }
    let first_tile = deal.of(exchange.rank()).start;
    for named in exchanged(exchange, &to)?.into_iter().flatten() {
        let border = &mut borders[named.tile as usize - first_tile];
        border.foreign.push((named.vertex, named.id));
    }
    for border in borders {
        border.foreign.sort_unstable();
    }
    Ok(total)
}

/// Tells every tile which of its vertices other tiles have: all who may share a vertex say so to the rank that its key
/// falls to.
///
/// The hash is a multiplication by 2⁶⁴ over the golden ratio per coordinate (Fibonacci hashing), of which the high half
/// is taken. All ranks must agree on it; equal keys go to one rank, and that is all that is asked of it.
fn link(
    exchange: &(impl Exchange + ?Sized),
    deal: &Deal,
    borders: &mut [Border],
) -> Result<(), Lost> {
    let first_tile = deal.of(exchange.rank()).start;
    let mut to = vec![Vec::new(); deal.ranks];
    for (i, border) in borders.iter().enumerate() {
        for &(vertex, key) in &border.shared {
            let tile = (first_tile + i) as u32;
            let folded = key
                .iter()
                .fold(0u64, |h, k| (h ^ k).wrapping_mul(0x9e37_79b9_7f4a_7c15));
            to[(folded >> 32) as usize % deal.ranks].push(Claim { key, tile, vertex });
        }
    }
    let mut claims: Vec<Claim> = exchanged(exchange, &to)?.into_iter().flatten().collect();
    claims.sort_unstable();
    let mut to = vec![Vec::new(); deal.ranks];
    for group in claims.chunk_by(|a, b| a.key == b.key) {
        for own in group {
            for other in group.iter().filter(|other| other.tile != own.tile) {
                to[deal.rank_of(own.tile as usize)].push(Link {
                    tile: own.tile,
                    vertex: own.vertex,
                    other: other.tile,
                    theirs: other.vertex,
                });
            }
        }
    }
    for link in exchanged(exchange, &to)?.into_iter().flatten() {
        borders[link.tile as usize - first_tile].links.push(link);
    }
    for border in borders {
        border.links.sort_unstable();
    }
    Ok(())
}

/// Which ghosts are asked for.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Asked {
    /// How many layers, 1 or 2.
    pub layers: u16,
    /// For which tiles of each rank, counted from its first: a part at a time, where those of all would be too many.
    pub places: Range<usize>,
}

impl Asked {
    /// One layer around all tiles.
    pub const FIRST: Self = Self {
        layers: 1,
        places: 0..usize::MAX,
    };
}

/// A vertex that a layer of ghosts has in another tile than its tetrahedron.
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct Front {
    /// The tile that this is told to.
    tile: u32,
    /// The number of the vertex there.
    vertex: u32,
    /// Whose ghosts they are.
    of: u32,
}

/// The tetrahedra of other tiles that touch vertices of this rank's tiles, once they have numbers, and with a second layer
/// those that touch them; by tile, and there by their numbers.
///
/// Per tile of this rank that is asked for, in the order of `borders`; all ranks must ask for the same. An element that touches a
/// tile in several vertices is told once, in its lowest layer. A second layer takes an exchange more: a tile is told where the
/// first layer of another, in a third, ends at its vertices.
///
/// # Errors
/// [`Lost`], if another rank has ended.
pub fn ghosts(
    exchange: &(impl Exchange + ?Sized),
    deal: &Deal,
    borders: &[Border],
    asked: &Asked,
) -> Result<Vec<Vec<Ghost>>, Lost> {
    let own = deal.of(exchange.rank());
    let wanted = |tile: u32| {
        let first = deal.of(deal.rank_of(tile as usize)).start;
        asked.places.contains(&(tile as usize - first))
    };
    let fronts: Vec<Vec<[u32; 2]>> = borders
        .iter()
        .map(|border| {
            let links = border.links.iter().filter(|l| wanted(l.other));
            links.map(|l| [l.vertex, l.other]).collect()
        })
        .collect();
    let second = match asked.layers {
        0 | 1 => vec![Vec::new(); borders.len()],
        _ => second_fronts(exchange, deal, borders, &fronts)?,
    };
    let mut to = vec![Vec::new(); deal.ranks];
    for (i, (border, owner)) in borders.iter().zip(own.clone()).enumerate() {
        if fronts[i].is_empty() && second[i].is_empty() {
            continue;
        }
        let ids = border.ids();
        for (element, tet, region) in &border.tets {
            let first = met(&fronts[i], tet);
            let mut told: Vec<(u32, u16)> = first.iter().map(|&tile| (tile, 1)).collect();
            let beyond = met(&second[i], tet).into_iter();
            told.extend(beyond.filter(|t| !first.contains(t)).map(|tile| (tile, 2)));
            for (tile, layer) in told {
                to[deal.rank_of(tile as usize)].push(Ghost {
                    tile,
                    owner: owner as u32,
                    element: *element,
                    region: u16::from(*region),
                    layer,
                    ids: tet.map(|v| ids[v as usize]),
                    corners: tet.map(|v| border.place(v)),
                });
            }
        }
    }
    let first = own.start + asked.places.start.min(own.len());
    let end = own.start + asked.places.end.min(own.len());
    let mut out = vec![Vec::new(); end - first];
    for ghost in exchanged(exchange, &to)?.into_iter().flatten() {
        out[ghost.tile as usize - first].push(ghost);
    }
    for list in &mut out {
        list.sort_unstable_by_key(|ghost| ghost.ids);
    }
    Ok(out)
}

/// The other tiles that a front has at corners of a tetrahedron, ascending. A front is a list of vertices, each with a tile,
/// sorted.
fn met(front: &[[u32; 2]], tet: &[u32; 4]) -> Vec<u32> {
    let at = |&v: &u32| {
        let first = front.partition_point(|f| f[0] < v);
        let same = front[first..].iter().take_while(move |f| f[0] == v);
        same.map(|f| f[1])
    };
    let mut tiles: Vec<u32> = tet.iter().flat_map(at).collect();
    tiles.sort_unstable();
    tiles.dedup();
    tiles
}

/// Per border the vertices of other tiles' first layers, whose fronts are given, be these its own or of a third tile.
fn second_fronts(
    exchange: &(impl Exchange + ?Sized),
    deal: &Deal,
    borders: &[Border],
    fronts: &[Vec<[u32; 2]>],
) -> Result<Vec<Vec<[u32; 2]>>, Lost> {
    let mut second: Vec<Vec<[u32; 2]>> = vec![Vec::new(); borders.len()];
    let mut to = vec![Vec::new(); deal.ranks];
    for ((border, front), second) in borders.iter().zip(fronts).zip(&mut second) {
        for (_, tet, _) in &border.tets {
            for tile in met(front, tet) {
                second.extend(tet.map(|v| [v, tile]));
            }
        }
        second.sort_unstable();
        second.dedup();
        // What touches a vertex of the tile itself is of the first layer, and known to all who have it.
        second.retain(|f| front.binary_search(f).is_err());
        for &[vertex, of] in &*second {
            let first = border.links.partition_point(|l| l.vertex < vertex);
            let links = border.links[first..].iter();
            for link in links.take_while(|l| l.vertex == vertex) {
                to[deal.rank_of(link.other as usize)].push(Front {
                    tile: link.other,
                    vertex: link.theirs,
                    of,
                });
            }
        }
    }
    let first_tile = deal.of(exchange.rank()).start;
    for heard in exchanged(exchange, &to)?.into_iter().flatten() {
        second[heard.tile as usize - first_tile].push([heard.vertex, heard.of]);
    }
    for front in &mut second {
        front.sort_unstable();
        front.dedup();
    }
    Ok(second)
}
