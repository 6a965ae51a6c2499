//! Who shares which vertex, global numbers, and what lies beyond a border.
//!
//! Vertices are the same if their positions have the same bits ([`key`]), so that tiles need no numbers in common to
//! find out what they share: each says the keys of its border to the rank that a hash of the key names, which sees all
//! that have one and tells them of each other. That takes two exchanges, the numbers two more.

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

/// A tetrahedron of another tile that touches a vertex of this one.
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
    pub region: u32,
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
    /// The tetrahedra that touch them.
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
        let each = (0..).zip(mesh.tets()).zip(mesh.regions());
        let tets: Vec<_> = each
            .map(|((t, tet), region)| (t, *tet, *region))
            .filter(|(_, tet, _)| tet.iter().any(|&v| is_shared(v)))
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

/// The tetrahedra of other tiles that touch vertices of this rank's tiles, once they have numbers; by tile, and there by
/// their numbers.
///
/// Per tile of this rank, in the order of `borders`. An element that touches a tile in several vertices is told once.
///
/// # Errors
/// [`Lost`], if another rank has ended.
pub fn ghosts(
    exchange: &(impl Exchange + ?Sized),
    deal: &Deal,
    borders: &[Border],
) -> Result<Vec<Vec<Ghost>>, Lost> {
    let own = deal.of(exchange.rank());
    let mut to = vec![Vec::new(); deal.ranks];
    for (border, owner) in borders.iter().zip(own.clone()) {
        if border.links.is_empty() {
            continue;
        }
        let ids = border.ids();
        for (element, tet, region) in &border.tets {
            let place = |v: u32| {
                let at = border.positions.binary_search_by_key(&v, |p| p.0);
                at.map_or([f64::NAN; 3], |i| border.positions[i].1.into())
            };
            let mut tiles: Vec<u32> = tet
                .iter()
                .flat_map(|&v| {
                    let first = border.links.partition_point(|l| l.vertex < v);
                    let links = border.links[first..].iter();
                    links.take_while(move |l| l.vertex == v).map(|l| l.other)
                })
                .collect();
            tiles.sort_unstable();
            tiles.dedup();
            for tile in tiles {
                to[deal.rank_of(tile as usize)].push(Ghost {
                    tile,
                    owner: owner as u32,
                    element: *element,
                    region: u32::from(*region),
                    ids: tet.map(|v| ids[v as usize]),
                    corners: tet.map(place),
                });
            }
        }
    }
    let mut out = vec![Vec::new(); own.len()];
    for ghost in exchanged(exchange, &to)?.into_iter().flatten() {
        out[ghost.tile as usize - own.start].push(ghost);
    }
    for list in &mut out {
        list.sort_unstable_by_key(|ghost| ghost.ids);
    }
    Ok(out)
}
