//! MSH 4.1 of a mesh in parts, a file each, as Gmsh writes and reads them (`Mesh.PartitionSplitMeshFiles`).
//!
//! Nodes and elements bear the same tags in all files. A part has an entity of its own per group, whose parent is the
//! entity of that group in the whole; the elements of others that touch it belong to its ghost entity, and
//! `$GhostElements` says whose they are. Of the fields those of the points are written, as `NodeData`.

use std::io::Write;
use std::path::Path;

use super::msh::{Out, TETRA, TRIANGLE, put_names, write_field};
use crate::Aabb;
use crate::io::bytes::put_all;
use crate::io::view::{Cells, NO_GROUP, View};
use crate::io::{Error, ErrorKind};

/// A part of a mesh.
///
/// Points and cells have numbers of their own in the view, and numbers in the whole, which are those that are written,
/// plus 1.
#[derive(Clone, Copy, Debug)]
pub struct Part<'a> {
    /// Its tetrahedra and triangles, ghosts included.
    pub view: &'a View<'a>,
    /// Its number, from 0.
    pub number: u32,
    /// How many parts there are.
    pub parts: u32,
    /// The number of each point in the whole, from 0.
    pub points: &'a [u64],
    /// The number of each cell in the whole, from 0.
    pub cells: &'a [u64],
    /// The part that each cell belongs to: another one for ghosts, which are tetrahedra.
    /// As long as the cells.
    pub owners: &'a [u32],
}

/// Most parts: tags of entities are made of the number of the part and the tag of the group.
///
/// The tag of an entity is 2¹⁶ (part + 1) + tag of the group, in 31 bits.
pub const MOST: usize = (1 << 15) - 1;

/// Writes a part to a file, whole or not at all.
pub fn save(path: impl AsRef<Path>, part: &Part<'_>) -> Result<(), Error> {
    crate::io::save(path, |w| write(w, part))
}

/// An entity of the part: cells of one dimension and group, or its ghosts.
struct Entity {
    dimension: u8,
    tag: i32,
    /// Tag of the group and of the parent, 0 for none.
    physical: i32,
    /// By their places in the view.
    cells: Vec<usize>,
}

/// Writes a part, as bytes. Refuses quads and polygons, and more than 32,767 parts or tags of groups from 65,536 on.
///
/// Of the fields `GlobalNodeIds` and `vtkGhostType` are left out, for MSH says by tags and ghosts what they say.
///
/// # Errors
/// [`ErrorKind::Expected`] for numbers or owners that are not as many as points or cells, [`ErrorKind::TooLarge`] for
/// the limits above and for values of nodes beyond 2³¹ − 1, [`ErrorKind::Unsupported`] for other cells and for
/// triangles that another part owns.
pub fn write(w: &mut dyn Write, part: &Part<'_>) -> Result<(), Error> {
    let view = part.view;
    view.check()?;
    let tags = view.tags();
    check(part, &tags)?;
    let entities = entities(part, &tags)?;
    writeln!(w, "$MeshFormat\n4.1 1 8")?;
    w.write_all(&1i32.to_le_bytes())?;
    writeln!(w, "\n$EndMeshFormat")?;
    put_names(w, view, &tags)?;
    let mut out = Out { w, binary: true };
    put_entities(&mut out, part, &entities)?;
    put_nodes(&mut out, part, &entities)?;
    put_elements(&mut out, part, &entities)?;
    put_ghosts(&mut out, part, &entities)?;
    put_fields(&mut out, part)
}

/// Refuses numbers and owners that do not fit the mesh, and more parts or groups than tags tell apart.
fn check(part: &Part<'_>, tags: &[i32]) -> Result<(), Error> {
    let view = part.view;
    let told = [part.points.len(), part.cells.len(), part.owners.len()];
    if told != [view.points.len(), view.cells(), view.cells()] {
        let of = (view.points.len(), view.cells());
        let expected = format!(
            "numbers of {} points, numbers and owners of {} cells",
            of.0, of.1
        );
        return Err(ErrorKind::expected(expected, format!("{told:?}")).into());
    }
    let most = tags.iter().copied().max().unwrap_or(0);
    if part.parts as usize > MOST || most >= 1 << 16 {
        let what = format!("{} parts, groups up to {most}", part.parts);
        return Err(ErrorKind::TooLarge(what).into());
    }
    Ok(())
}

/// Numbers of nodes, elements and partitions begin at 1.
fn tag(number: &u64) -> u64 {
    number + 1
}

/// Lowest and highest tag, as heads of sections have them; 0 for none.
fn range(numbers: &[u64]) -> [u64; 2] {
    let (low, high) = (numbers.iter().min(), numbers.iter().max());
    [low, high].map(|n| n.map_or(0, tag))
}

/// The groups of the whole mesh, and this part's share of each; the ghosts come last.
fn put_entities(out: &mut Out<'_>, part: &Part<'_>, entities: &[Entity]) -> Result<(), Error> {
    let (own, ghosts) = entities.split_at(entities.len() - 1);
    let bounds = match part.view.points.is_empty() {
        true => [0.0; 6],
        false => {
            let Aabb { min, max } = Aabb::of_points(part.view.points.iter());
            [min.x, min.y, min.z, max.x, max.y, max.z]
        }
    };
    let of = |d: u8| own.iter().filter(|e| e.dimension == d).count() as u64;

    writeln!(out.w, "$Entities")?;
    out.line([0, 0, of(2), of(3)])?;
    for entity in own {
        out.line([entity.physical.max(1)])?;
        put_bounds_and_group(out, bounds, entity.physical)?;
    }
    out.end("Entities")?;
    let number = part.number as i32 + 1;
    writeln!(out.w, "$PartitionedEntities")?;
    out.line([u64::from(part.parts), 1])?;
    out.line([ghosts[0].tag, number])?;
    out.line([0, 0, of(2), of(3)])?;
    for entity in own {
        out.line([entity.tag, entity.dimension.into(), entity.physical.max(1)])?;
        out.line([1u64])?;
        out.line([number])?;
        put_bounds_and_group(out, bounds, entity.physical)?;
    }
    out.end("PartitionedEntities")
}

/// All nodes in one block, as those of the first volume.
fn put_nodes(out: &mut Out<'_>, part: &Part<'_>, entities: &[Entity]) -> Result<(), Error> {
    let (own, ghosts) = entities.split_at(entities.len() - 1);
    let home = own.iter().find(|e| e.dimension == 3).unwrap_or(&ghosts[0]);
    let nodes = part.view.points.len() as u64;
    writeln!(out.w, "$Nodes")?;
    let [low, high] = range(part.points);
    out.line([1, nodes, low, high])?;
    out.mixed(&[3, home.tag, 0], &[nodes])?;
    out.line(part.points.iter().map(tag))?;
    let coordinates = part.view.points.iter().flat_map(|p| [p.x, p.y, p.z]);
    out.line(coordinates)?;
    out.end("Nodes")
}

/// The triangles and tetrahedra of each entity, ghosts included.
fn put_elements(out: &mut Out<'_>, part: &Part<'_>, entities: &[Entity]) -> Result<(), Error> {
    let corners: Vec<&[u32]> = part.view.blocks.iter().flat_map(Cells::iter).collect();
    writeln!(out.w, "$Elements")?;
    let [low, high] = range(part.cells);
    out.line([entities.len() as u64, corners.len() as u64, low, high])?;
    for entity in entities {
        let kind = if entity.dimension == 2 {
            TRIANGLE
        } else {
            TETRA
        };
        let head = [entity.dimension.into(), entity.tag, kind];
        out.mixed(&head, &[entity.cells.len() as u64])?;
        out.line(entity.cells.iter().flat_map(|&c| {
            let nodes = corners[c].iter().map(|&v| tag(&part.points[v as usize]));
            std::iter::once(tag(&part.cells[c])).chain(nodes)
        }))?;
    }
    out.end("Elements")
}

/// Of each ghost the part that owns it, and that it is a ghost here.
fn put_ghosts(out: &mut Out<'_>, part: &Part<'_>, entities: &[Entity]) -> Result<(), Error> {
    let cells = entities.last().map_or(&[][..], |ghosts| &ghosts.cells);
    writeln!(out.w, "$GhostElements")?;
    out.line([cells.len() as u64])?;
    for &c in cells {
        out.line([tag(&part.cells[c])])?;
        out.line([part.owners[c] as i32 + 1])?;
        out.line([1u64])?;
        out.line([part.number as i32 + 1])?;
    }
    out.end("GhostElements")
}

/// The values of the points, but for those that tell their numbers.
fn put_fields(out: &mut Out<'_>, part: &Part<'_>) -> Result<(), Error> {
    let technical = [super::vtu::GLOBAL_IDS, super::vtu::GHOSTS];
    let fields = part.view.point_fields.iter();
    for field in fields.filter(|f| !technical.contains(&f.name.as_str())) {
        let last = part.points.iter().max().copied().unwrap_or(0);
        let fits = i32::try_from(last + 1);
        fits.map_err(|_| ErrorKind::TooLarge(format!("values of node {last} in MSH")))?;
        let tagged = part.points.iter().map(|&number| number as i32 + 1).zip(0..);
        write_field(out, "NodeData", field, tagged)?;
    }
    Ok(())
}

/// Box, physical group, and no bounding entities.
fn put_bounds_and_group(out: &mut Out<'_>, bounds: [f64; 6], physical: i32) -> Result<(), Error> {
    out.line(bounds)?;
    let groups: Vec<i32> = (physical != 0).then_some(physical).into_iter().collect();
    out.line([groups.len() as u64])?;
    put_all(out.w, groups)?;
    out.line([0u64])
}

/// Surfaces before volumes, each by their groups; the ghosts last, be there none.
fn entities(part: &Part<'_>, tags: &[i32]) -> Result<Vec<Entity>, Error> {
    let view = part.view;
    let base = (part.number as i32 + 1) << 16;
    let mut found: Vec<Entity> = Vec::new();
    let mut ghosts = Vec::new();
    let mut c = 0;
    for block in &view.blocks {
        let dimension = block.dimension();
        if !matches!(block, Cells::Triangles(_) | Cells::Tets(_)) && !block.is_empty() {
            let what = "parts with other cells than triangles and tetrahedra".to_owned();
            return Err(ErrorKind::Unsupported(what).into());
        }
        for _ in 0..block.len() {
            if part.owners[c] != part.number {
                if dimension != 3 {
                    let what = "triangles that another part owns".to_owned();
                    return Err(ErrorKind::Unsupported(what).into());
                }
                ghosts.push(c);
                c += 1;
                continue;
            }
            let group = view.group_of.get(c).copied().unwrap_or(NO_GROUP);
            let physical = tags.get(group as usize).copied().unwrap_or(0);
            let same = |e: &Entity| (e.dimension, e.physical) == (dimension, physical);
            let at = found.iter().position(same).unwrap_or_else(|| {
                found.push(Entity {
                    dimension,
                    tag: base + physical.max(1),
                    physical,
                    cells: Vec::new(),
                });
                found.len() - 1
            });
            found[at].cells.push(c);
            c += 1;
        }
    }
    found.sort_by_key(|e| (e.dimension, e.physical));
    found.push(Entity {
        dimension: 3,
        tag: base,
        physical: 0,
        cells: ghosts,
    });
    Ok(found)
}
