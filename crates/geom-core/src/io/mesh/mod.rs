//! Meshes from files of any format.
//!
//! [`read`] tells the format by the content and gives a mesh of one of our kinds with everything else that the file says;
//! [`save`] writes what a [`View`] shows, in the format of the name's ending. What a format cannot hold is left out, and
//! nothing else:
//!
//! | ending | cells | numbers | values per point | per cell | colours | groups |
//! |---|---|---|---|---|---|---|
//! | [`ply`] | triangles, quads, polygons | f64, bytes | yes | yes | yes | |
//! | [`off`] | triangles, quads, polygons | text, all digits | | | yes | |
//! | [`obj`] | triangles, quads, polygons | text, all digits | | | yes | by name |
//! | [`stl`] | triangles | f32 | | | | |
//! | [`glb`] | triangles | f32 | as f32 | | yes | |
//! | [`vtu`] | all, tetrahedra too | f64, bytes | yes | yes | yes | by name |
//! | [`msh`] | triangles, quads, tetrahedra | f64, bytes | yes | yes | | by name |
//!
//! For a solver take MSH or VTU, which keep regions and boundaries by name; for pictures GLB; for further work PLY or VTU,
//! which keep every bit. Lengths are Å in all of them, since none has a word for the unit.
//!
//! A tetrahedral mesh in a format for surfaces becomes its surface. A mesh with values and a colour per vertex, there and back:
//!
//! ```
//! use geom_core::io::{View, mesh};
//! use geom_core::mesh::shapes;
//!
//! let sphere = shapes::icosphere(2.0, 2);
//! let heights: Vec<f64> = sphere.positions().iter().map(|p| p.z).collect();
//! let mut view = View::from(&sphere).point_field("height", &heights)?;
//! view.colors = Some(vec![[200, 60, 40, 255]; heights.len()].into());
//!
//! let file = std::env::temp_dir().join(format!("sphere-{}.ply", std::process::id()));
//! mesh::save(&file, &view)?;
//! let back = mesh::read(&file)?;
//! assert_eq!(back.mesh, mesh::AnyMesh::Tri(sphere.clone()));
//! assert_eq!(back.point_fields[0].values.to_f64(), heights);
//! # std::fs::remove_file(file)?;
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

pub mod glb;
#[cfg(feature = "search")]
mod groups;
pub mod msh;
pub mod msh_parts;
pub mod obj;
pub mod off;
pub mod ply;
pub mod stl;
pub mod vtu;

#[cfg(feature = "search")]
pub use groups::VolumeGroups;

use std::path::Path;

use crate::io::view::{Cells, Field, Group, NO_GROUP, View, fan};
use crate::io::{Encoding, Error, ErrorKind, MAX_BYTES, extension, read_bytes_up_to};
use crate::mesh::{EXTERIOR, INTERIOR, OUTSIDE, Region};
use crate::{QuadMesh, TetMesh, TriMesh};

/// A mesh of one of our kinds.
///
/// What a file becomes is told by its cells: see [`MeshFile`].
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum AnyMesh {
    /// Triangles.
    Tri(TriMesh),
    /// Quads.
    Quad(QuadMesh),
    /// Tetrahedra.
    Tet(TetMesh),
}

/// What a file holds, besides a mesh.
#[derive(Clone, Debug, PartialEq)]
pub struct MeshFile {
    /// The mesh.
    pub mesh: AnyMesh,
    /// Values per vertex.
    /// In the order of the file, with the number types of its arrays as far as there are such.
    pub point_fields: Vec<Field<'static>>,
    /// Values per triangle, quad or tetrahedron. A polygon that was cut into triangles has its value in each.
    pub cell_fields: Vec<Field<'static>>,
    /// Red, green, blue and opacity per vertex.
    pub colors: Option<Vec<[u8; 4]>>,
    /// Named groups.
    /// Also those of [`MeshFile::faces`].
    pub groups: Vec<Group>,
    /// The group of each triangle, quad or tetrahedron, or [`NO_GROUP`]; empty if none has one.
    pub group_of: Vec<u32>,
    /// With tetrahedra: triangles that the file has beside them, with their group.
    /// Boundaries and interfaces that have names, mostly; quads and polygons as fans.
    pub faces: Vec<([u32; 3], u32)>,
    /// The face of the file that each triangle is of, where larger polygons were cut; else empty.
    pub face_of: Vec<u32>,
}

/// Reads a mesh; the format is told by the content, or else by the name. See [`MeshFile`]'s
/// conversion from a [`View`] for what becomes of mixed cells.
///
/// ```no_run
/// use geom_core::io::{View, mesh};
/// let file = mesh::read("bunny.ply")?;
/// if let mesh::AnyMesh::Tri(surface) = &file.mesh {
///     mesh::save("bunny.vtu", &View::from(surface))?;
/// }
/// # Ok::<(), geom_core::io::Error>(())
/// ```
///
/// # Errors
/// Those of [`read_up_to`].
pub fn read(path: impl AsRef<Path>) -> Result<MeshFile, Error> {
    read_up_to(path, MAX_BYTES)
}

/// [`read`] for a file of at most so many bytes, unpacked.
///
/// # Errors
/// All name the file: those of [`read_bytes_up_to`], of [`parse`], [`ErrorKind::Mesh`] if the cells are no mesh (a
/// repeated corner, above all), and [`ErrorKind::Expected`] for values of a field `region` that are no regions.
pub fn read_up_to(path: impl AsRef<Path>, max_bytes: u64) -> Result<MeshFile, Error> {
    let path = path.as_ref();
    let bytes = read_bytes_up_to(path, max_bytes)?;
    let view = parse(&bytes, &extension(path));
    view.and_then(MeshFile::of_checked)
        .map_err(|e| e.in_file(path))
}

/// Writes a view to a file whole or not at all, in the format of the name's ending: `ply` (binary),
/// `off`, `obj`, `stl` (binary), `glb`, `vtu`, `msh` (4.1, binary).
///
/// Options of a format (text, versions) are those of its own `save`: [`ply::save`], [`msh::save`]. A name may end in
/// `.gz` after its ending.
///
/// # Errors
/// [`ErrorKind::Unsupported`] for any other ending; else those of the format's writer, and of [`crate::io::save`].
pub fn save(path: impl AsRef<Path>, view: &View<'_>) -> Result<(), Error> {
    let path = path.as_ref();
    match extension(path).as_str() {
        "ply" => ply::save(path, view, Encoding::default()),
        "off" => off::save(path, view),
        "obj" => obj::save(path, view),
        "stl" => stl::save(path, view),
        "glb" => glb::save(path, view),
        "vtu" => vtu::save(path, view),
        "msh" => msh::save(path, view, msh::Options::default()),
        _ => Err(unknown().in_file(path)),
    }
}

fn unknown() -> Error {
    let what =
        "no mesh format is known by this name; .ply, .off, .obj, .stl, .glb, .vtu and .msh are";
    ErrorKind::Unsupported(what.to_owned()).into()
}

/// A view from the bytes of a file of any format; `extension` (as `obj`) decides where the content
/// does not.
///
/// Content tells PLY, MSH, OFF with its first word, GLB and VTU; the rest needs the extension. Gzip is not unpacked
/// here.
///
/// # Errors
/// [`ErrorKind::Empty`], [`ErrorKind::Unsupported`] if neither tells, else those of the format's reader.
pub fn parse(bytes: &[u8], extension: &str) -> Result<View<'static>, Error> {
    if bytes.is_empty() {
        return Err(ErrorKind::Empty.into());
    }
    let text = bytes.trim_ascii_start();
    let first = text.split(u8::is_ascii_whitespace).next().unwrap_or(text);
    match first {
        b"ply" => ply::parse(bytes),
        b"$MeshFormat" => msh::parse(bytes),
        b"OFF" | b"COFF" | b"NOFF" | b"CNOFF" => off::parse(bytes),
        _ if bytes.starts_with(b"glTF") => glb::parse(bytes),
        _ if first.starts_with(b"<?xml") || first.starts_with(b"<VTKFile") => vtu::parse(bytes),
        _ => match extension {
            "ply" => ply::parse(bytes),
            "off" => off::parse(bytes),
            "obj" => obj::parse(bytes),
            "stl" => stl::parse(bytes),
            "glb" => glb::parse(bytes),
            "vtu" => vtu::parse(bytes),
            "msh" => msh::parse(bytes),
            _ => Err(unknown()),
        },
    }
}

/// Tetrahedra if there are any, with their regions from a cell field `region` or from the names of
/// their groups; else quads if all faces are; else triangles, larger polygons cut into fans.
/// Values of cells follow their cells.
impl TryFrom<View<'static>> for MeshFile {
    type Error = Error;

    fn try_from(view: View<'static>) -> Result<Self, Error> {
        Self::of_checked(view.checked()?)
    }
}

impl MeshFile {
    /// The same of a view that a reader has checked.
    ///
    /// Cells of lower dimension than the mesh's are no cells of it: faces beside tetrahedra go to `faces`.
    fn of_checked(mut view: View<'static>) -> Result<Self, Error> {
        number_patches(&mut view);
        let kind = |dimension: u8| {
            view.blocks
                .iter()
                .filter(move |b| b.dimension() == dimension)
        };
        // The highest dimension decides what the mesh is made of.
        let tets = kind(3).any(|b| !b.is_empty());
        let quads = kind(2).any(|b| !b.is_empty())
            && kind(2).all(|b| b.is_empty() || matches!(b, Cells::Quads(_)));
        let mut cells = Vec::new();
        let mut faces = Vec::new();
        let mut corners3: Vec<[u32; 3]> = Vec::new();
        let mut corners4: Vec<[u32; 4]> = Vec::new();
        let mut number = 0;
        for block in &view.blocks {
            for ring in block.iter() {
                let fan = fan(ring);
                if tets && block.dimension() == 2 {
                    let group = view.group_of.get(number).copied().unwrap_or(NO_GROUP);
                    faces.extend(fan.map(|t| (t, group)));
                } else if tets || quads {
                    corners4.push([ring[0], ring[1], ring[2], ring[3]]);
                    cells.push(number);
                } else {
                    for t in fan {
                        corners3.push(t);
                        cells.push(number);
                    }
                }
                number += 1;
            }
        }
        let cell_fields = view.fields_of(&cells);
        let group_of: Vec<u32> = match view.group_of.is_empty() {
            true => Vec::new(),
            false => cells.iter().map(|&c| view.group_of[c]).collect(),
        };
        // Several triangles of one face: larger polygons have been cut.
        let cut = !tets && !quads && cells.len() > number;
        let face_of = if cut {
            cells.iter().map(|&c| c as u32).collect()
        } else {
            Vec::new()
        };
        let points = view.points.into_owned();
        let mesh = if tets {
            let regions = regions(corners4.len(), &cell_fields, &view.groups, &group_of)?;
            AnyMesh::Tet(TetMesh::with_regions(points, corners4, regions)?)
        } else if quads {
            AnyMesh::Quad(QuadMesh::new(points, corners4)?)
        } else {
            AnyMesh::Tri(TriMesh::new(points, corners3)?)
        };
        Ok(Self {
            mesh,
            point_fields: view.point_fields,
            cell_fields,
            colors: view.colors.map(std::borrow::Cow::into_owned),
            groups: view.groups,
            group_of,
            faces,
            face_of,
        })
    }
}

/// What other programs call the field of a tetrahedron's region, in small letters: Gmsh and Medit by meshio, VMTK, OpenGeoSys,
/// MFEM, and whoever has a word of their own. The first that a file has counts.
const REGION_FIELDS: [&str; 10] = [
    "region",
    "gmsh:physical",
    "medit:ref",
    "cellentityids",
    "materialids",
    "materialid",
    "material",
    "attribute",
    "subdomain",
    "domain",
];

/// Those of them that number the faces of patches, too.
const PATCH_FIELDS: [&str; 3] = ["gmsh:physical", "medit:ref", "cellentityids"];

/// The patches of faces beside tetrahedra in a file without groups, by the numbers that another program gave to volumes and
/// faces alike ([`PATCH_FIELDS`]): `physical 9`, as in MSH. Numbers that are no tags make none.
fn number_patches(view: &mut View<'static>) {
    let is_volume = view.blocks.iter().any(|b| b.dimension() == 3);
    if !is_volume || !view.groups.is_empty() {
        return;
    }
    let Some(field) = first_named(&view.cell_fields, &PATCH_FIELDS) else {
        return;
    };
    let mut tag_of = Vec::new();
    let dimensions = view.blocks.iter();
    let dimensions = dimensions.flat_map(|b| std::iter::repeat_n(b.dimension(), b.len()));
    for (cell, dimension) in dimensions.enumerate() {
        let value = field.values.get(cell, 0);
        let tag = value as i32;
        let is_tag = f64::from(tag) == value && tag > 0;
        tag_of.push((dimension == 2 && is_tag).then_some(tag));
    }
    let mut tags: Vec<i32> = tag_of.iter().flatten().copied().collect();
    tags.sort_unstable();
    tags.dedup();
    view.groups = tags
        .iter()
        .map(|&tag| Group {
            name: format!("physical {tag}"),
            dimension: 2,
            tag: Some(tag),
        })
        .collect();
    let place = |tag: &Option<i32>| {
        let place = tag.and_then(|tag| tags.binary_search(&tag).ok());
        place.map_or(NO_GROUP, |place| place as u32)
    };
    if !tags.is_empty() {
        view.group_of = tag_of.iter().map(place).collect();
    }
}

/// The field of one number per cell that is called by the first of these names, in small letters, that any is called by.
fn first_named<'f, 'v>(fields: &'f [Field<'v>], names: &[&str]) -> Option<&'f Field<'v>> {
    names.iter().find_map(|name| {
        let is_it = |f: &&Field<'_>| f.name.to_lowercase() == *name && f.values.components == 1;
        fields.iter().find(is_it)
    })
}

/// The region of each tetrahedron: by our own field `region` if there is one, else by groups, else by another program's field
/// ([`REGION_FIELDS`]); else all are [`INTERIOR`].
fn regions(
    tets: usize,
    fields: &[Field<'_>],
    groups: &[Group],
    group_of: &[u32],
) -> Result<Vec<Region>, Error> {
    let region = fields
        .iter()
        .find(|f| f.name == "region" && f.values.components == 1);
    if let Some(field) = region {
        return (0..tets)
            .map(|t| {
                let value = field.values.get(t, 0);
                let region = value as Region;
                if f64::from(region) == value && region != OUTSIDE {
                    Ok(region)
                } else {
                    let expected = format!("a region 0…254 of tetrahedron {t}");
                    Err(ErrorKind::expected(expected, value.to_string()).into())
                }
            })
            .collect();
    }
    // Groups may be of patches alone.
    if group_of.iter().any(|&g| g != NO_GROUP) {
        let of_group = regions_of_groups(groups)?;
        let of = |&g: &u32| of_group.get(g as usize).copied().unwrap_or(INTERIOR);
        return Ok(group_of.iter().map(of).collect());
    }
    match first_named(fields, &REGION_FIELDS) {
        Some(field) => foreign_regions(tets, field),
        None => Ok(vec![INTERIOR; tets]),
    }
}

/// The region of each group: ours are known by name, others have the number of their tag if that is free, and the rest are
/// numbered from 2 on, as they come. What is said of patches is not asked for.
fn regions_of_groups(groups: &[Group]) -> Result<Vec<Region>, Error> {
    let by_name = |g: &Group| match (g.dimension, g.name.as_str()) {
        (3, "exterior") => Some(EXTERIOR),
        (3, "molecule") => Some(INTERIOR),
        (3, name) => name
            .strip_prefix("region_")
            .and_then(|n| n.parse().ok().filter(|&r| r != OUTSIDE)),
        _ => Some(INTERIOR),
    };
    let volumes = || groups.iter().filter(|g| g.dimension == 3);
    let mut taken: Vec<Region> = volumes().filter_map(by_name).collect();
    // Names come first, wherever they stand: a tag may be the number that a name says of another group.
    let mut by_tag = |g: &Group| {
        let tag = g.tag.and_then(|tag| Region::try_from(tag).ok())?;
        let is_free = (INTERIOR..OUTSIDE).contains(&tag) && !taken.contains(&tag);
        is_free.then(|| taken.push(tag))?;
        Some(tag)
    };
    let said = groups.iter().map(|g| by_name(g).or_else(|| by_tag(g)));
    let said: Vec<Option<Region>> = said.collect();
    // What nothing has said gets what is left.
    let mut free = (INTERIOR + 1..OUTSIDE).filter(|r| !taken.contains(r));
    let all = said.into_iter().map(|said| said.or_else(|| free.next()));
    all.collect::<Option<_>>().ok_or_else(|| {
        let volumes = volumes().count();
        let what = format!("{volumes} groups of tetrahedra; at most 253 can be told apart");
        ErrorKind::TooLarge(what).into()
    })
}

/// By whole numbers under another program's name: as they are, if all are regions; else numbered from 2 on in ascending
/// order. Other numbers are of something else, and all are [`INTERIOR`].
fn foreign_regions(tets: usize, field: &Field<'_>) -> Result<Vec<Region>, Error> {
    let values: Vec<f64> = (0..tets).map(|t| field.values.get(t, 0)).collect();
    if values.iter().any(|v| v.fract() != 0.0) {
        return Ok(vec![INTERIOR; tets]);
    }
    let mut distinct = values.clone();
    distinct.sort_unstable_by(f64::total_cmp);
    distinct.dedup();
    let is_region = |&v: &f64| (0.0..f64::from(OUTSIDE)).contains(&v);
    if distinct.iter().all(is_region) {
        return Ok(values.into_iter().map(|v| v as Region).collect());
    }
    let free: Vec<Region> = (INTERIOR + 1..OUTSIDE).collect();
    if distinct.len() > free.len() {
        let (found, name) = (distinct.len(), &field.name);
        let what = format!("{found} values of `{name}`; at most 253 regions can be told apart");
        return Err(ErrorKind::TooLarge(what).into());
    }
    let number = |v: f64| free[distinct.partition_point(|d| d.total_cmp(&v).is_lt())];
    Ok(values.into_iter().map(number).collect())
}

impl AnyMesh {
    /// The surface as triangles: quads cut along their first diagonal, tetrahedra replaced by the
    /// boundary of the molecule, or of the only region.
    ///
    /// For what works on surfaces and does not care where they come from. Fields and groups are not carried along.
    pub fn into_triangles(self) -> TriMesh {
        match self {
            Self::Tri(mesh) => mesh,
            Self::Quad(mesh) => mesh.into_triangles(),
            Self::Tet(mesh) => {
                let region = match mesh.regions().contains(&INTERIOR) {
                    true => INTERIOR,
                    false => mesh.regions().first().copied().unwrap_or(INTERIOR),
                };
                mesh.region_surface(region)
            }
        }
    }
}
