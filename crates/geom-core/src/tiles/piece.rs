//! The elements of a tile.
//!
//! A piece can be asked for its bytes (to be put aside or sent), dealt to other tiles, joined with others, and asked
//! for a digest by which meshes made in different tiles are compared.

use std::collections::{BTreeMap, HashMap};

use crate::mesh::{Region, TetMesh, VertexKind};
use crate::{MeshError, Point3};

/// The tetrahedra that a tile owns, and which of its vertices others may share. Two vertices of different tiles are one
/// if their positions have the same bits.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Piece {
    /// The tetrahedra.
    pub mesh: TetMesh,
    /// Per vertex: may a tetrahedron of another tile have it? (True where one has it.)
    /// As many as vertices. True too often costs time; false where another tile has the vertex tears the mesh.
    pub shared: Vec<bool>,
}

/// The bits of a position: the name of a vertex in all tiles.
///
/// Tiles compute the positions of their common vertices from the same samples by the same operations, so that these
/// have the same bits; no tolerance is needed, and none could be transitive.
pub fn key(x: &Point3) -> [u64; 3] {
    // One zero of the two.
    [x.x, x.y, x.z].map(|c| (c + 0.0).to_bits())
}

/// Why bytes are no piece.
///
/// Such bytes are of another program or machine, or were cut off.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum NoPiece {
    /// Too few bytes or too many.
    #[error("{found} bytes for a piece that takes {expected}")]
    Length {
        /// Bytes there are.
        found: usize,
        /// Bytes that its header announces.
        expected: usize,
    },
    /// No mesh.
    #[error(transparent)]
    Mesh(#[from] MeshError),
}

impl Piece {
    /// As bytes of this machine: vertices, tetrahedra, regions, kinds, shared or not.
    ///
    /// 16 + 26 n + 17 m bytes for n vertices and m tetrahedra, in the byte order of this machine: for its own disk, and
    /// for ranks on its like.
    pub fn to_bytes(&self) -> Vec<u8> {
        let mesh = &self.mesh;
        let counts = [mesh.positions().len() as u64, mesh.tets().len() as u64];
        let positions: Vec<[f64; 3]> = mesh.positions().iter().map(|p| (*p).into()).collect();
        let kinds = mesh.kinds().iter().map(code);
        let mut out = bytemuck::cast_slice(&counts).to_vec();
        out.extend_from_slice(bytemuck::cast_slice(&positions));
        out.extend_from_slice(bytemuck::cast_slice(mesh.tets()));
        out.extend_from_slice(mesh.regions());
        out.extend(kinds);
        out.extend(self.shared.iter().map(|&s| u8::from(s)));
        out
    }

    /// From such bytes.
    ///
    /// The same bits as before. An unknown kind of vertex is taken as [`VertexKind::Fixed`], which at worst holds it
    /// still.
    ///
    /// # Errors
    /// [`NoPiece::Length`] unless there are as many bytes as the first 16 announce, [`NoPiece::Mesh`] for corners out
    /// of range or repeated, and for positions that are not finite.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, NoPiece> {
        let wrong = |expected: usize| NoPiece::Length {
            found: bytes.len(),
            expected,
        };
        let (header, rest) = bytes.split_first_chunk::<16>().ok_or_else(|| wrong(16))?;
        let [n, m]: [u64; 2] = bytemuck::pod_read_unaligned(header);
        let (n, m) = (n as usize, m as usize);
        let expected = n.saturating_mul(26).saturating_add(m.saturating_mul(17));
        if rest.len() != expected {
            return Err(wrong(expected.saturating_add(16)));
        }
        let (positions, rest) = rest.split_at(24 * n);
        let (tets, rest) = rest.split_at(16 * m);
        let (regions, rest) = rest.split_at(m);
        let (kinds, shared) = rest.split_at(n);
        let positions: Vec<[f64; 3]> = bytemuck::pod_collect_to_vec(positions);
        let mesh = TetMesh::with_kinds(
            positions.into_iter().map(Point3::from).collect(),
            bytemuck::pod_collect_to_vec(tets),
            regions.to_vec(),
            kinds.iter().map(|&c| kind(c)).collect(),
        )?;
        Ok(Self {
            mesh,
            shared: shared.iter().map(|&s| s != 0).collect(),
        })
    }

    /// The tetrahedra by the tile that `tile` gives for their corners, ascending. A vertex that goes to several tiles, or
    /// may have been shared before, may be shared in each.
    ///
    /// Order is kept, of tetrahedra and of vertices; vertices that no tetrahedron has are dropped. Tiles without a
    /// tetrahedron do not occur.
    pub fn dealt(&self, tile: impl Fn([Point3; 4]) -> usize) -> BTreeMap<usize, Self> {
        let mesh = &self.mesh;
        let of: Vec<usize> = (0..mesh.tets().len())
            .map(|t| tile(mesh.corners(t)))
            .collect();
        let mut first = vec![usize::MAX; mesh.positions().len()];
        let mut shared = self.shared.clone();
        let mut tets: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
        for (t, (tet, &tile)) in mesh.tets().iter().zip(&of).enumerate() {
            tets.entry(tile).or_default().push(t);
            for v in tet.map(|v| v as usize) {
                shared[v] |= first[v] != usize::MAX && first[v] != tile;
                first[v] = tile;
            }
        }
        let part = |tets: Vec<usize>| {
            let used = tets.iter().flat_map(|&t| mesh.tets()[t]);
            let mut order: Vec<u32> = used.collect();
            order.sort_unstable();
            order.dedup();
            let number = |v: u32| order.partition_point(|&u| u < v) as u32;
            let pick = |v: &u32| *v as usize;
            let part = TetMesh::with_kinds(
                order.iter().map(|v| mesh.positions()[pick(v)]).collect(),
                tets.iter().map(|&t| mesh.tets()[t].map(number)).collect(),
                tets.iter().map(|&t| mesh.regions()[t]).collect(),
                order.iter().map(|v| mesh.kinds()[pick(v)]).collect(),
            );
            Self {
                mesh: part.expect("a part of a mesh names its own vertices"),
                shared: order.iter().map(|v| shared[pick(v)]).collect(),
            }
        };
        tets.into_iter()
            .map(|(tile, tets)| (tile, part(tets)))
            .collect()
    }

    /// Pieces as one: vertices of one place are one, in the order in which they first come.
    ///
    /// A vertex has the kind that its first piece says, and may be shared if any says so. Tetrahedra follow each other
    /// as the pieces do. The inverse of [`Piece::dealt`], but for the order.
    ///
    /// Panics if two corners of one tetrahedron have the same bits.
    pub fn joined(pieces: &[Self]) -> Self {
        let mut numbers: HashMap<[u64; 3], u32> = HashMap::new();
        let (mut positions, mut kinds, mut shared) = (Vec::new(), Vec::new(), Vec::new());
        let (mut tets, mut regions) = (Vec::new(), Vec::new());
        for piece in pieces {
            let (mesh, flags) = (&piece.mesh, &piece.shared);
            let own: Vec<u32> = (mesh.positions().iter().zip(mesh.kinds()).zip(flags))
                .map(|((x, kind), flag)| {
                    let number = *numbers.entry(key(x)).or_insert_with(|| {
                        positions.push(*x);
                        kinds.push(*kind);
                        shared.push(false);
                        positions.len() as u32 - 1
                    });
                    shared[number as usize] |= flag;
                    number
                })
                .collect();
            tets.extend(mesh.tets().iter().map(|t| t.map(|v| own[v as usize])));
            regions.extend_from_slice(mesh.regions());
        }
        let mesh = TetMesh::with_kinds(positions, tets, regions, kinds);
        Self {
            mesh: mesh.expect("joined tetrahedra name joined vertices"),
            shared,
        }
    }

    /// A number of the mesh as a set of tetrahedra, each with its region and the bits of its corners, in whatever order
    /// they come and in however many pieces: those of pieces are added, wrapping.
    ///
    /// Corners are sorted first, so that orientation does not count; kinds of vertices do not either. Two meshes that
    /// differ have one digest with a probability of 2⁻¹²⁸ if nobody means them to: it is no cryptographic sum.
    pub fn digest(&self) -> u128 {
        digest(&self.mesh)
    }
}

/// See [`Piece::digest`].
pub fn digest(mesh: &TetMesh) -> u128 {
    let one = |(tet, region): (&[u32; 4], &Region)| {
        let mut corners = tet.map(|v| key(&mesh.positions()[v as usize]));
        corners.sort_unstable();
        let half = |seed: u64| {
            let words = corners.as_flattened().iter();
            words.fold(mixed(seed ^ u64::from(*region)), |h, w| mixed(h ^ w))
        };
        u128::from(half(1)) << 64 | u128::from(half(1 << 32))
    };
    let each = mesh.tets().iter().zip(mesh.regions());
    each.map(one).fold(0, u128::wrapping_add)
}

/// The finalizer of SplitMix64 (Steele, Lea & Flood 2014), which spreads every bit over all.
fn mixed(mut z: u64) -> u64 {
    z = z.wrapping_add(0x9e37_79b9_7f4a_7c15);
    z = (z ^ z >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ z >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ z >> 31
}

/// Kind and axis in a byte.
fn code(kind: &VertexKind) -> u8 {
    match *kind {
        VertexKind::Interior => 0,
        VertexKind::Surface => 1,
        VertexKind::Fixed => 2,
        VertexKind::BoxFace { axis } => 4 + axis,
        VertexKind::BoxEdge { axis } => 8 + axis,
    }
}

/// The inverse of `code`.
fn kind(code: u8) -> VertexKind {
    let axis = code & 3;
    match code {
        0 => VertexKind::Interior,
        1 => VertexKind::Surface,
        4..=6 => VertexKind::BoxFace { axis },
        8..=10 => VertexKind::BoxEdge { axis },
        _ => VertexKind::Fixed,
    }
}
