//! What is written of a mesh in tiles: a part of each, the file that joins them, and the whole where it fits.

use geom_core::io::mesh::{msh_parts, vtu};
use geom_core::io::view::{Cells, Group, View};
use geom_core::mesh::VertexKind;
use geom_core::tiles::Piece;
use geom_core::tiles::border::{Border, Ghost};
use geom_core::tiles::exchange::{Exchange, Lost, gathered};
use geom_core::tiles::parts::{Local, surface};
use geom_core::{Aabb, Point3, TetMesh, Vector3};

use super::{Outcome, Plan, numbers};
use crate::input::labels::Labels;
use crate::{Failure, Session};

/// What a part has to know of the whole to number its elements.
pub(super) struct Whole {
    vertices: u64,
    /// The number of the first tetrahedron of each tile, and of all.
    first: Vec<u64>,
}

impl Whole {
    pub(super) fn of(
        exchange: &dyn Exchange,
        vertices: u64,
        borders: &[Border],
    ) -> Result<Self, Lost> {
        let own: Vec<u64> = borders.iter().map(|b| b.elements as u64).collect();
        let mut first = vec![0];
        for count in gathered(exchange, &own)?.concat() {
            first.push(first[first.len() - 1] + count);
        }
        Ok(Self { vertices, first })
    }

    fn tetrahedra(&self) -> u64 {
        self.first[self.first.len() - 1]
    }
}

/// A piece with its ghosts and what bounds it, and the numbers of its cells in the whole.
struct Part<'m> {
    view: View<'m>,
    cells: Vec<u64>,
    owners: Vec<u32>,
}

impl Plan<'_> {
    /// Writes the parts of a tile, once its vertices have numbers, and adds the groups that it has.
    #[expect(clippy::too_many_arguments, reason = "all that is known of a tile")]
    pub(super) fn write(
        &self,
        tile: usize,
        piece: &Piece,
        border: &Border,
        ghosts: &[Ghost],
        whole: &Whole,
        groups: &mut Vec<Group>,
        session: &Session,
    ) -> Result<Local, Failure> {
        let ids = border.ids();
        let (mesh, points) = with_ghosts(piece, &ids, ghosts)?;
        let mut part = self.part(tile, &mesh, &points, ghosts, border, whole)?;
        groups.extend(part.view.groups.iter().cloned());
        groups.sort_by_key(|g| (g.dimension, g.tag));
        groups.dedup();
        vtu::save(session.output(part_name(tile))?, &part.view)?;
        if self.writes_msh() {
            // Values of nodes have tags of 31 bits.
            if whole.vertices >= i32::MAX as u64 {
                part.view.point_fields.clear();
            }
            let number = |n: usize| n as u32;
            let msh = msh_parts::Part {
                view: &part.view,
                number: number(tile),
                parts: number(self.tiles.len()),
                points: &points,
                cells: &part.cells,
                owners: &part.owners,
            };
            // As Gmsh names and counts them.
            let name = format!("parts/volume_{}.msh", tile + 1);
            msh_parts::save(session.output(name)?, &msh)?;
        }
        self.spill.put(&numbers(tile), bytemuck::cast_slice(&ids))?;
        let surface = surface(piece, &ids, ghosts);
        Ok(Local::of(piece, border, &surface))
    }

    /// Are there few enough tiles for MSH?
    pub fn writes_msh(&self) -> bool {
        self.tiles.len() <= msh_parts::MOST
    }

    /// Writes the file that joins the parts.
    pub fn join(&self, outcome: &Outcome, session: &Session) -> Result<(), Failure> {
        let names: Vec<String> = (0..self.tiles.len()).map(part_name).collect();
        let whole = Whole {
            vertices: 0,
            first: vec![0; self.tiles.len() + 1],
        };
        let none = TetMesh::default();
        let mut empty = self.part(0, &none, &[], &[], &Border::default(), &whole)?;
        empty.view.groups.clone_from(&outcome.groups);
        let path = session.output("volume.pvtu")?;
        Ok(vtu::save_parts(path, &empty.view, &names)?)
    }

    /// The whole mesh in one memory, its vertices in the order of their numbers.
    pub fn merged(&self, outcome: &Outcome) -> Result<TetMesh, Failure> {
        let n = usize::try_from(outcome.vertices)?;
        let mut positions = vec![Point3::origin(); n];
        let mut kinds = vec![VertexKind::Interior; n];
        let (mut tets, mut regions) = (Vec::new(), Vec::new());
        for tile in 0..self.tiles.len() {
            let piece = self.piece(tile)?;
            let ids: Vec<u64> = bytemuck::pod_collect_to_vec(&self.spill.get(&numbers(tile))?);
            let (own, corners, own_regions, own_kinds) = piece.mesh.into_parts();
            for ((x, kind), &id) in own.into_iter().zip(own_kinds).zip(&ids) {
                positions[id as usize] = x;
                kinds[id as usize] = kind;
            }
            tets.extend(corners.iter().map(|t| t.map(|v| ids[v as usize] as u32)));
            regions.extend(own_regions);
        }
        Ok(TetMesh::with_kinds(positions, tets, regions, kinds)?)
    }

    /// The whole mesh with the names of its groups and its labels.
    pub fn view<'m>(&self, mesh: &'m TetMesh) -> Result<View<'m>, Failure> {
        let labels = Labels::of_copies(self.structure, self.places, mesh.positions())?;
        Ok(labels.into_fields(View::of_tets_in(mesh, &[], &self.sides()))?)
    }

    /// Where the exterior ends.
    fn sides(&self) -> Aabb {
        let cells = self
            .lattice
            .cells()
            .map(|n| n.next_multiple_of(dual_contour::LARGEST) as f64);
        let first = self.lattice.origin;
        Aabb::new(first, first + Vector3::from(cells) * self.lattice.spacing)
    }

    /// A piece with its ghosts and the numbers of its vertices, as a part of a mesh.
    fn part<'m>(
        &self,
        tile: usize,
        mesh: &'m TetMesh,
        points: &[u64],
        ghosts: &[Ghost],
        border: &Border,
        whole: &Whole,
    ) -> Result<Part<'m>, Failure> {
        let own = mesh.tets().len() - ghosts.len();
        // Of the faces that part regions, those behind which a tetrahedron of its own lies: each is in one part.
        let mut behind = Vec::new();
        let is_own = |[inner, _]: [u32; 2]| {
            let own = (inner as usize) < own;
            behind.extend(own.then_some(inner as usize));
            own
        };
        let mut view = View::of_tets_in(mesh, &[], &self.sides()).with_triangles(is_own);
        if view.groups.is_empty() {
            // Those who join parts want all to have the same fields: every mesh has a molecule.
            view.groups.push(Group {
                name: "molecule".to_owned(),
                dimension: 3,
                tag: Some(1),
            });
        }
        let labels = Labels::of_copies(self.structure, self.places, &view.points)?;
        let mut foreign = vec![0u8; mesh.positions().len()];
        for links in border.links.chunk_by(|a, b| a.vertex == b.vertex) {
            foreign[links[0].vertex as usize] = u8::from(links.iter().any(|l| l.other < l.tile));
        }
        foreign[border.vertices..].fill(1);
        let mut layers: Vec<u8> = vec![0; view.cells()];
        for (layer, ghost) in layers[own.min(view.cells())..].iter_mut().zip(ghosts) {
            *layer = ghost.layer as u8;
        }
        let is_ghost = (0..view.cells()).map(|c| (own..mesh.tets().len()).contains(&c));
        let is_ghost: Vec<u8> = is_ghost.map(u8::from).collect();
        let point_ids: Vec<i64> = points.iter().map(|&id| id as i64).collect();
        let first = whole.first[tile];
        let mut cells: Vec<u64> = (first..first + own as u64).collect();
        let of_owner = |g: &Ghost| whole.first[g.owner as usize] + u64::from(g.element);
        cells.extend(ghosts.iter().map(of_owner));
        let mut owners = vec![tile as u32; own];
        owners.extend(ghosts.iter().map(|g| g.owner));
        // A face by the tetrahedron behind it and the corner of that across.
        if let Some(Cells::Triangles(faces)) = view.blocks.get(1) {
            for (face, &tet) in faces.iter().zip(&behind) {
                let across = mesh.tets()[tet].iter().position(|v| !face.contains(v));
                let face = 4 * cells[tet] + across.unwrap_or(0) as u64;
                cells.push(whole.tetrahedra() + face);
                owners.push(tile as u32);
            }
        }
        let view = labels
            .into_fields(view)?
            .point_field(vtu::GLOBAL_IDS, point_ids)?
            .point_field(vtu::GHOSTS, foreign)?
            .cell_field(vtu::GHOSTS, is_ghost)?
            .cell_field("layer", layers)?
            .cell_field("owner", owners.clone())?;
        Ok(Part {
            view,
            cells,
            owners,
        })
    }
}

fn part_name(tile: usize) -> String {
    format!("parts/part_{tile}.vtu")
}

/// The mesh of a piece and, behind, its ghosts with the vertices that only they have; and the numbers of all vertices.
fn with_ghosts(
    piece: &Piece,
    ids: &[u64],
    ghosts: &[Ghost],
) -> Result<(TetMesh, Vec<u64>), Failure> {
    let mut known: Vec<(u64, u32)> = (0..).zip(ids).map(|(v, &id)| (id, v)).collect();
    known.sort_unstable();
    let is_known = |id: u64| known.binary_search_by_key(&id, |k| k.0);
    let mut more: Vec<(u64, [f64; 3])> = ghosts
        .iter()
        .flat_map(|g| g.ids.into_iter().zip(g.corners))
        .filter(|(id, _)| is_known(*id).is_err())
        .collect();
    more.sort_unstable_by_key(|m| m.0);
    more.dedup_by_key(|m| m.0);
    let first = ids.len() as u32;
    let place = |id: u64| match is_known(id) {
        Ok(at) => known[at].1,
        Err(_) => first + more.partition_point(|m| m.0 < id) as u32,
    };
    let (mut positions, mut tets, mut regions, mut kinds) = piece.mesh.clone().into_parts();
    positions.extend(more.iter().map(|m| Point3::from(m.1)));
    kinds.resize(positions.len(), VertexKind::Interior);
    tets.extend(ghosts.iter().map(|g| g.ids.map(place)));
    regions.extend(ghosts.iter().map(|g| g.region as u8));
    let mut numbers = ids.to_vec();
    numbers.extend(more.iter().map(|m| m.0));
    Ok((
        TetMesh::with_kinds(positions, tets, regions, kinds)?,
        numbers,
    ))
}

/// The groups of all ranks, by dimension and tag.
pub(super) fn all_groups(exchange: &dyn Exchange, own: &[Group]) -> Result<Vec<Group>, Failure> {
    let line = |g: &Group| format!("{} {} {}", g.dimension, g.tag.unwrap_or(0), g.name);
    let own: Vec<String> = own.iter().map(line).collect();
    let mut groups = Vec::new();
    for said in exchange.gather(own.join("\n").as_bytes())? {
        for line in String::from_utf8(said)?.lines() {
            let mut words = line.splitn(3, ' ');
            let mut next = || words.next().ok_or("a message of groups has been cut off");
            groups.push(Group {
                dimension: next()?.parse()?,
                tag: Some(next()?.parse()?),
                name: next()?.to_owned(),
            });
        }
    }
    groups.sort_by_key(|g| (g.dimension, g.tag));
    groups.dedup();
    Ok(groups)
}
