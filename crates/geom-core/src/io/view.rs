//! What every mesh format writes and reads: points, blocks of cells, named values and named groups.
//!
//! A writer takes a [`View`] of a mesh, which borrows the mesh's arrays; a reader gives one that owns its own, of which
//! `mesh::MeshFile` makes a mesh. The parts of a view are public, so that one can be put together by hand; writers and
//! readers check that they fit each other (one value per point, corners in range) before they go on.

use std::borrow::Cow;
use std::collections::HashSet;

use super::{Error, ErrorKind};
use crate::compute::sets::DisjointSets;
use crate::mesh::{
    EXTERIOR, FACES, INTERIOR, Interface, OUTSIDE, Region, VertexKind, is_even, sorted,
};
use crate::{Aabb, Point3, QuadMesh, TetMesh, TriMesh, Vector3};

/// No group: see [`View::groups`].
pub const NO_GROUP: u32 = u32::MAX;

/// No cell: see [`View::sides`].
pub const NO_CELL: u32 = u32::MAX;

/// A mesh as files see it. Writers take it whole and leave out only what their format cannot hold,
/// as each says; readers give it back with everything owned.
///
/// ```
/// use geom_core::io::{View, vtu};
/// use geom_core::mesh::shapes;
/// let sphere = shapes::icosphere(1.7, 2);
/// let height: Vec<f64> = sphere.positions().iter().map(|p| p.z).collect();
/// let view = View::from(&sphere).point_field("height", &height)?;
/// let mut file = Vec::new();
/// vtu::write(&mut file, &view)?;
/// # Ok::<(), geom_core::io::Error>(())
/// ```
///
/// What is refused, by every writer and after every reader: a point that is not finite, a corner that is no point,
/// fields, colours or `group_of` that are not as long as what they describe, and tuples that are not whole. Points that
/// no cell uses are not, and values may be NaN; a group that does not exist counts as [`NO_GROUP`].
#[derive(Clone, Debug, Default, PartialEq)]
pub struct View<'a> {
    /// Positions, Å.
    pub points: Cow<'a, [Point3]>,
    /// The cells. Fields and groups count them through all blocks.
    /// Cell `c` of the view is cell `c − n` of a block that has `n` cells in front of it.
    pub blocks: Vec<Cells<'a>>,
    /// Values per point.
    pub point_fields: Vec<Field<'a>>,
    /// Values per cell, all blocks in order.
    pub cell_fields: Vec<Field<'a>>,
    /// Red, green, blue and opacity per point.
    pub colors: Option<Cow<'a, [[u8; 4]]>>,
    /// Named groups of cells: regions of tetrahedra, parts of the boundary.
    /// One name may occur once per dimension.
    pub groups: Vec<Group>,
    /// The group of each cell, or [`NO_GROUP`]; empty if no cell has one.
    pub group_of: Cow<'a, [u32]>,
}

/// Cells of one kind, as corner indices.
///
/// Corners are indices into [`View::points`]; faces run counter-clockwise seen from outside, tetrahedra as those of
/// [`TetMesh`].
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum Cells<'a> {
    /// Triangles.
    Triangles(Cow<'a, [[u32; 3]]>),
    /// Quads.
    Quads(Cow<'a, [[u32; 4]]>),
    /// Polygons of any number of corners.
    Polygons {
        /// Where each polygon ends in `corners`.
        /// As many as polygons, rising; polygon i begins where i − 1 ends, the first one at 0.
        ends: Cow<'a, [u32]>,
        /// The corners of all polygons.
        corners: Cow<'a, [u32]>,
    },
    /// Tetrahedra.
    Tets(Cow<'a, [[u32; 4]]>),
}

impl Cells<'_> {
    /// Number of cells.
    pub fn len(&self) -> usize {
        match self {
            Self::Triangles(c) => c.len(),
            Self::Quads(c) => c.len(),
            Self::Polygons { ends, .. } => ends.len(),
            Self::Tets(c) => c.len(),
        }
    }
    /// Is there no cell?
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
    /// Dimension of a cell: 2 or 3.
    pub fn dimension(&self) -> u8 {
        match self {
            Self::Tets(_) => 3,
            _ => 2,
        }
    }
    /// The corners of a cell.
    ///
    /// Within this block. Panics if it has no such cell.
    pub fn corners(&self, cell: usize) -> &[u32] {
        match self {
            Self::Triangles(c) => &c[cell],
            Self::Quads(c) | Self::Tets(c) => &c[cell],
            Self::Polygons { ends, corners } => {
                let start = if cell == 0 { 0 } else { ends[cell - 1] };
                &corners[start as usize..ends[cell] as usize]
            }
        }
    }
    /// The corners of each cell.
    pub fn iter(&self) -> impl Iterator<Item = &[u32]> {
        (0..self.len()).map(|c| self.corners(c))
    }
    /// The same cells, without a copy.
    fn borrowed(&self) -> Cells<'_> {
        match self {
            Self::Triangles(c) => Cells::Triangles(c.as_ref().into()),
            Self::Quads(c) => Cells::Quads(c.as_ref().into()),
            Self::Tets(c) => Cells::Tets(c.as_ref().into()),
            Self::Polygons { ends, corners } => Cells::Polygons {
                ends: ends.as_ref().into(),
                corners: corners.as_ref().into(),
            },
        }
    }
    /// Does every cell have its corners, and are these among so many vertices? `first` is the number of the first
    /// cell.
    fn check(&self, first: usize, vertices: usize) -> Result<(), Error> {
        if let Self::Polygons { ends, corners } = self {
            let rises = ends.windows(2).all(|w| w[0] <= w[1]);
            let last = ends.last().map_or(0, |&end| end as usize);
            if !rises || last != corners.len() {
                let expected = format!("ends of polygons that rise to {}", corners.len());
                return Err(ErrorKind::expected(expected, format!("{last} as the last")).into());
            }
        }
        let bad = |&v: &u32| v as usize >= vertices;
        let Some(at) = self.all_corners().iter().position(bad) else {
            return Ok(());
        };
        let cell = match self {
            Self::Triangles(_) => at / 3,
            Self::Quads(_) | Self::Tets(_) => at / 4,
            Self::Polygons { ends, .. } => ends.partition_point(|&e| e as usize <= at),
        };
        Err(crate::MeshError::OutOfRange {
            element: first + cell,
            vertex: self.all_corners()[at],
            vertices,
        }
        .into())
    }
    /// Those of all cells, one after another.
    fn all_corners(&self) -> &[u32] {
        match self {
            Self::Triangles(c) => c.as_flattened(),
            Self::Quads(c) | Self::Tets(c) => c.as_flattened(),
            Self::Polygons { corners, .. } => corners,
        }
    }
}

/// Named values, one tuple per point or per cell.
///
/// Values of one name twice are two fields; some formats refuse them.
#[derive(Clone, Debug, PartialEq)]
pub struct Field<'a> {
    /// The name.
    /// Formats that allow fewer characters replace the others by `_`.
    pub name: String,
    /// The values.
    pub values: Values<'a>,
}

/// Scalars or tuples of one number type.
///
/// Slices and vectors of numbers, of arrays and of [`Vector3`] are turned into one by `into()`; only vectors of the
/// last are copied.
#[derive(Clone, Debug, PartialEq)]
pub struct Values<'a> {
    /// Numbers per tuple: 1 for scalars, 3 for vectors.
    /// At least 1.
    pub components: usize,
    /// The numbers, tuple after tuple.
    pub numbers: Numbers<'a>,
}

/// Numbers of one type.
///
/// Formats keep the type where they have it. What reads values takes [`Values::get`], whatever it is.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
#[expect(missing_docs, reason = "the names of the number types")]
pub enum Numbers<'a> {
    F32(Cow<'a, [f32]>),
    F64(Cow<'a, [f64]>),
    U8(Cow<'a, [u8]>),
    U32(Cow<'a, [u32]>),
    I32(Cow<'a, [i32]>),
    I64(Cow<'a, [i64]>),
}

/// Does the same with the numbers of each type.
macro_rules! each_type {
    ($numbers:expr, $n:ident => $body:expr) => {
        match $numbers {
            $crate::io::view::Numbers::F32($n) => $body,
            $crate::io::view::Numbers::F64($n) => $body,
            $crate::io::view::Numbers::U8($n) => $body,
            $crate::io::view::Numbers::U32($n) => $body,
            $crate::io::view::Numbers::I32($n) => $body,
            $crate::io::view::Numbers::I64($n) => $body,
        }
    };
}
pub(super) use each_type;

impl Values<'_> {
    /// Number of tuples.
    pub fn len(&self) -> usize {
        // Both are fields of the user's.
        self.numbers().checked_div(self.components).unwrap_or(0)
    }
    /// Is there no value?
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
    /// A number as f64: tuple `i`, component `k`.
    ///
    /// Exact but for i64 beyond 2⁵³. Panics beyond the last number.
    pub fn get(&self, i: usize, k: usize) -> f64 {
        let at = i * self.components + k;
        match &self.numbers {
            Numbers::F32(n) => n[at].into(),
            Numbers::F64(n) => n[at],
            Numbers::U8(n) => n[at].into(),
            Numbers::U32(n) => n[at].into(),
            Numbers::I32(n) => n[at].into(),
            Numbers::I64(n) => n[at] as f64,
        }
    }
    /// The scalars as f64; the first component of tuples.
    pub fn to_f64(&self) -> Vec<f64> {
        (0..self.len()).map(|i| self.get(i, 0)).collect()
    }

    /// How many there are, whatever the tuples.
    fn numbers(&self) -> usize {
        each_type!(&self.numbers, n => n.len())
    }

    /// The tuples of these numbers.
    ///
    /// Copied, in this order; a tuple may be asked for twice.
    fn select(&self, tuples: impl Iterator<Item = usize> + Clone) -> Values<'static> {
        let k = self.components;
        let places = tuples.flat_map(move |i| i * k..(i + 1) * k);
        let numbers = match &self.numbers {
            Numbers::F32(n) => Numbers::F32(places.map(|i| n[i]).collect()),
            Numbers::F64(n) => Numbers::F64(places.map(|i| n[i]).collect()),
            Numbers::U8(n) => Numbers::U8(places.map(|i| n[i]).collect()),
            Numbers::U32(n) => Numbers::U32(places.map(|i| n[i]).collect()),
            Numbers::I32(n) => Numbers::I32(places.map(|i| n[i]).collect()),
            Numbers::I64(n) => Numbers::I64(places.map(|i| n[i]).collect()),
        };
        Values {
            components: k,
            numbers,
        }
    }

    /// Longer by tuples that mean "no value": NaN, or the largest number of the type.
    fn padded(mut self, tuples: usize) -> Self {
        let len = tuples * self.components;
        match &mut self.numbers {
            Numbers::F32(n) => n.to_mut().resize(len, f32::NAN),
            Numbers::F64(n) => n.to_mut().resize(len, f64::NAN),
            Numbers::U8(n) => n.to_mut().resize(len, u8::MAX),
            Numbers::U32(n) => n.to_mut().resize(len, u32::MAX),
            Numbers::I32(n) => n.to_mut().resize(len, i32::MAX),
            Numbers::I64(n) => n.to_mut().resize(len, i64::MAX),
        }
        self
    }
}

macro_rules! values_from {
    ($($number:ident: $variant:ident),*) => {$(
        impl<'a> From<&'a [$number]> for Values<'a> {
            fn from(numbers: &'a [$number]) -> Self {
                Self { components: 1, numbers: Numbers::$variant(numbers.into()) }
            }
        }
        impl<'a> From<&'a Vec<$number>> for Values<'a> {
            fn from(numbers: &'a Vec<$number>) -> Self {
                numbers.as_slice().into()
            }
        }
        impl From<Vec<$number>> for Values<'_> {
            fn from(numbers: Vec<$number>) -> Self {
                Self { components: 1, numbers: Numbers::$variant(numbers.into()) }
            }
        }
        impl<'a, const N: usize> From<&'a [[$number; N]]> for Values<'a> {
            fn from(numbers: &'a [[$number; N]]) -> Self {
                Self { components: N, numbers: Numbers::$variant(numbers.as_flattened().into()) }
            }
        }
        impl<'a, const N: usize> From<&'a Vec<[$number; N]>> for Values<'a> {
            fn from(numbers: &'a Vec<[$number; N]>) -> Self {
                numbers.as_slice().into()
            }
        }
    )*};
}
values_from!(f32: F32, f64: F64, u8: U8, u32: U32, i32: I32, i64: I64);

impl From<&[Vector3]> for Values<'_> {
    fn from(vectors: &[Vector3]) -> Self {
        let numbers = vectors.iter().flat_map(|v| [v.x, v.y, v.z]).collect();
        Self {
            components: 3,
            numbers: Numbers::F64(numbers),
        }
    }
}
impl From<&Vec<Vector3>> for Values<'_> {
    fn from(vectors: &Vec<Vector3>) -> Self {
        vectors.as_slice().into()
    }
}

/// A named group of cells of one dimension.
///
/// Cells are told apart by [`View::group_of`]; a group may have none.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Group {
    /// The name.
    pub name: String,
    /// Dimension of its cells: 2 or 3.
    /// Tags count for each dimension on its own, as in MSH.
    pub dimension: u8,
    /// The number by which solvers know it among those of its dimension, above 0: MSH's physical tag. Without one, a
    /// writer that needs numbers gives it one that is free.
    pub tag: Option<i32>,
}

impl<'a> From<&'a TriMesh> for View<'a> {
    fn from(mesh: &'a TriMesh) -> Self {
        Self {
            points: mesh.positions().into(),
            blocks: vec![Cells::Triangles(mesh.triangles().into())],
            ..Self::default()
        }
    }
}

impl<'a> From<&'a QuadMesh> for View<'a> {
    fn from(mesh: &'a QuadMesh) -> Self {
        Self {
            points: mesh.positions().into(),
            blocks: vec![Cells::Quads(mesh.quads().into())],
            ..Self::default()
        }
    }
}

/// The tetrahedra in groups named by region, then the faces between regions and on the boundary in
/// groups named by what they part: see [`View::of_tets`].
impl<'a> From<&'a TetMesh> for View<'a> {
    fn from(mesh: &'a TetMesh) -> Self {
        Self::of_tets(mesh, &[])
    }
}

impl<'a> View<'a> {
    /// A tetrahedral mesh and its boundary, with names for solvers.
    ///
    /// Cells are the tetrahedra, then all faces between regions and on the outside, each pointing out
    /// of the region of higher number. Regions are named `exterior` (0), `molecule` (1) and
    /// `region_2` …, unless `names` says otherwise. Faces are named
    ///
    /// * `molecule|exterior`: between these regions, the higher number first; also the molecule's
    ///   surface if only one of the two is meshed. Likewise `region_2|molecule` without the molecule;
    /// * `box_xmin`, `box_xmax`, `box_ymin`, …: in the sides of the bounding box, as told by their
    ///   vertices' [`VertexKind`], whatever region lies there;
    /// * `outer`: the outer boundary, if it is no box, of the exterior and of materials that reach it;
    /// * `region_2|outside`: any other boundary, such as that of a mesh without an exterior.
    ///
    /// Their tags do not depend on which of them there are: a region's is its number, 256 for the exterior, whose
    /// number 0 stands for "none" in MSH; the sides of the box have 257 … 262 in the order above, `outer` has 263, and
    /// what parts region *a* from *b* has 256 (*a* + 1) + *b* (so `molecule|exterior` 512), where the outside counts as 255.
    /// No face has the tag of a region: some readers look at tags without their dimension.
    ///
    /// The cell field `region` has the region of each tetrahedron; for a face that of its inner side.
    ///
    /// Faces are found by sorting, O(n log n); points and tetrahedra are borrowed. A view of another mesh with the same
    /// regions has the same tags, so that a solver's settings stay valid.
    pub fn of_tets(mesh: &'a TetMesh, names: &[(Region, &str)]) -> Self {
        Self::of_tets_in(mesh, names, &mesh.bounds())
    }

    /// [`View::of_tets`] of a part of a mesh whose box is given: its sides are those of the whole.
    ///
    /// A tile that ends within the whole has faces there which are no boundary: [`View::with_triangles`] takes them
    /// out.
    pub fn of_tets_in(mesh: &'a TetMesh, names: &[(Region, &str)], bounds: &Aabb) -> Self {
        let interfaces = mesh.interfaces();
        let name = |region: Region| match names.iter().find(|(r, _)| *r == region) {
            Some((_, name)) => (*name).to_owned(),
            None => match region {
                EXTERIOR => "exterior".to_owned(),
                INTERIOR => "molecule".to_owned(),
                OUTSIDE => "outside".to_owned(),
                _ => format!("region_{region}"),
            },
        };

        // A group per region that there is, in ascending order.
        let mut present = [false; 256];
        for &r in mesh.regions() {
            present[usize::from(r)] = true;
        }
        let mut groups = Vec::new();
        let mut of_region = [NO_GROUP; 256];
        for r in (0..=u8::MAX).filter(|&r| present[usize::from(r)]) {
            of_region[usize::from(r)] = groups.len() as u32;
            groups.push(Group {
                name: name(r),
                dimension: 3,
                tag: Some(if r == EXTERIOR { 256 } else { r.into() }),
            });
        }
        let mut group_of: Vec<u32> = mesh
            .regions()
            .iter()
            .map(|&r| of_region[usize::from(r)])
            .collect();

        // A group per kind of interface: side of the box, or the two regions that meet there.
        let [molecule, exterior] = [INTERIOR, EXTERIOR].map(|r| present[usize::from(r)]);
        let outer = outer_faces(mesh, &interfaces, molecule);
        // The few kinds of faces, in the order in which they appear.
        let mut kinds = Vec::new();
        for (face, &outer) in interfaces.iter().zip(&outer) {
            let side = box_side(mesh, face, bounds);
            let kind = (face.inside, face.outside, side, outer);
            let known = kinds.iter().find(|(k, _)| *k == kind);
            let group = known.map(|&(_, group)| group).unwrap_or_else(|| {
                let parted = |a: Region, b: Region| {
                    let tag = 256 * (i32::from(a) + 1) + i32::from(b);
                    (format!("{}|{}", name(a), name(b)), tag)
                };
                let (name, tag) = match (side, face.inside, face.outside) {
                    (Some((side, number)), ..) => (format!("box_{side}"), 256 + number),
                    (None, INTERIOR, OUTSIDE) if !exterior => parted(INTERIOR, EXTERIOR),
                    (None, EXTERIOR, OUTSIDE) if !outer => parted(INTERIOR, EXTERIOR),
                    (None, material, OUTSIDE) if exterior && !molecule && !outer => {
                        parted(material, INTERIOR)
                    }
                    (None, inside, OUTSIDE) if exterior && inside != INTERIOR => {
                        ("outer".to_owned(), 263)
                    }
                    (None, inside, outside) => parted(inside, outside),
                };
                // Two kinds may share a name.
                let same = |g: &Group| g.dimension == 2 && g.name == name;
                let group = groups.iter().position(same).unwrap_or_else(|| {
                    let (dimension, tag) = (2, Some(tag));
                    groups.push(Group {
                        name,
                        dimension,
                        tag,
                    });
                    groups.len() - 1
                }) as u32;
                kinds.push((kind, group));
                group
            });
            group_of.push(group);
        }
        // Triangles have the region on their inner side.
        let mut region = mesh.regions().to_vec();
        region.extend(interfaces.iter().map(|face| face.inside));
        Self {
            points: mesh.positions().into(),
            blocks: vec![
                Cells::Tets(mesh.tets().into()),
                Cells::Triangles(interfaces.iter().map(|face| face.triangle).collect()),
            ],
            cell_fields: vec![Field {
                name: "region".to_owned(),
                values: region.into(),
            }],
            groups,
            group_of: group_of.into(),
            ..Self::default()
        }
    }

    /// Adds values per point; refuses another number of them than of points.
    ///
    /// # Errors
    /// [`ErrorKind::Expected`], with the name.
    pub fn point_field(mut self, name: &str, values: impl Into<Values<'a>>) -> Result<Self, Error> {
        let values = values.into();
        fits(name, "point", &values, self.points.len())?;
        self.point_fields.push(Field {
            name: name.to_owned(),
            values,
        });
        Ok(self)
    }

    /// Adds values per cell: as many as cells, or as cells of the first block (the tetrahedra of a
    /// [`TetMesh`]); the rest then has NaN, or the largest number of an integer type.
    ///
    /// # Errors
    /// [`ErrorKind::Expected`], with the name.
    pub fn cell_field(mut self, name: &str, values: impl Into<Values<'a>>) -> Result<Self, Error> {
        let mut values = values.into();
        let of_first = |b: &Cells<'_>| fits(name, "cell", &values, b.len()).is_ok();
        if self.blocks.first().is_some_and(of_first) {
            values = values.padded(self.cells());
        }
        fits(name, "cell", &values, self.cells())?;
        self.cell_fields.push(Field {
            name: name.to_owned(),
            values,
        });
        Ok(self)
    }

    /// Sets red, green, blue and opacity per point; refuses another number of them than of points.
    ///
    /// 0 to 255 each; opacity 255 is opaque. Formats without colours leave them out.
    ///
    /// # Errors
    /// [`ErrorKind::Expected`].
    pub fn colored(mut self, colors: impl Into<Cow<'a, [[u8; 4]]>>) -> Result<Self, Error> {
        let colors = colors.into();
        one_each("one colour for each point", colors.len(), self.points.len())?;
        self.colors = Some(colors);
        Ok(self)
    }

    /// The tag of each group: its own, or one that no other group has, whatever its dimension.
    ///
    /// Free ones are counted from 1, past all that are taken in any dimension.
    pub(super) fn tags(&self) -> Vec<i32> {
        let mut taken: HashSet<(u8, i32)> = HashSet::new();
        // Those that ask for a number get it, the first of several of a dimension that ask for one.
        let own: Vec<Option<i32>> = self
            .groups
            .iter()
            .map(|g| {
                g.tag
                    .filter(|&tag| tag > 0 && taken.insert((g.dimension, tag)))
            })
            .collect();
        let mut all: HashSet<i32> = taken.into_iter().map(|(_, tag)| tag).collect();
        let mut next = 1;
        let mut free = || {
            while !all.insert(next) {
                next += 1;
            }
            next
        };
        own.into_iter()
            .map(|own| own.unwrap_or_else(&mut free))
            .collect()
    }

    /// Number of cells in all blocks.
    pub fn cells(&self) -> usize {
        self.blocks.iter().map(Cells::len).sum()
    }

    /// The blocks of triangles, quads and polygons.
    pub fn faces(&self) -> impl Iterator<Item = &Cells<'a>> {
        self.blocks.iter().filter(|b| b.dimension() == 2)
    }

    /// Each triangle of a view with tetrahedra, and the tetrahedra behind and before it, all as numbers of cells;
    /// [`NO_CELL`] where there is none. A triangle points away from the one behind it.
    ///
    /// Polygons of more corners are not asked. A triangle with more than two tetrahedra keeps the last one on each
    /// side. O(n log n) in the triangles, and a look at each tetrahedron.
    pub fn sides(&self) -> Vec<(u32, [u32; 2])> {
        // The faces, and the points of which they are made: few tetrahedra have three of those in a face.
        let mut found = Vec::new();
        let mut faces: Vec<([u32; 3], usize, bool)> = Vec::new();
        let mut on_face = vec![false; self.points.len()];
        let mut first = 0;
        for block in &self.blocks {
            for (cell, corners) in (first..).zip(block.iter()) {
                let &[a, b, c] = corners else { continue };
                corners.iter().for_each(|&v| on_face[v as usize] = true);
                faces.push((sorted([a, b, c]), found.len(), is_even([a, b, c])));
                found.push((cell, [NO_CELL; 2]));
            }
            first += block.len() as u32;
        }
        faces.sort_unstable();
        first = 0;
        for block in &self.blocks {
            if let Cells::Tets(tets) = block {
                for (cell, corners) in (first..).zip(tets.iter()) {
                    for face in FACES.map(|face| face.map(|i| corners[i])) {
                        if !face.iter().all(|&v| on_face[v as usize]) {
                            continue;
                        }
                        let key = sorted(face);
                        let start = faces.partition_point(|f| f.0 < key);
                        for &(_, i, even) in faces[start..].iter().take_while(|f| f.0 == key) {
                            found[i].1[usize::from(even != is_even(face))] = cell;
                        }
                    }
                }
            }
            first += block.len() as u32;
        }
        found
    }

    /// The faces alone: for a mesh with tetrahedra, its boundary and interfaces, with their vertices,
    /// fields and groups; any other view as it is.
    ///
    /// Faces are those that the view lists: of tetrahedra without faces nothing is left ([`View::of_tets`] lists them).
    /// Points keep their order, those that no face uses are dropped; groups all stay.
    pub fn surface(&self) -> View<'_> {
        if self.blocks.iter().all(|b| b.dimension() == 2) {
            return self.clone_borrowed();
        }
        let mut number = vec![u32::MAX; self.points.len()];
        for &v in self.faces().flat_map(Cells::all_corners) {
            number[v as usize] = 0;
        }
        let kept: Vec<usize> = (0..number.len()).filter(|&v| number[v] == 0).collect();
        for (new, &old) in (0..).zip(&kept) {
            number[old] = new;
        }
        let renumbered = |v: u32| number[v as usize];
        let blocks = self.faces().map(|block| match block {
            Cells::Triangles(c) => Cells::Triangles(c.iter().map(|t| t.map(renumbered)).collect()),
            Cells::Quads(c) => Cells::Quads(c.iter().map(|q| q.map(renumbered)).collect()),
            Cells::Tets(c) => Cells::Tets(c.iter().map(|t| t.map(renumbered)).collect()),
            Cells::Polygons { ends, corners } => Cells::Polygons {
                ends: ends.as_ref().into(),
                corners: corners.iter().map(|&v| renumbered(v)).collect(),
            },
        });
        let mut cells = Vec::new();
        let mut start = 0;
        for block in &self.blocks {
            if block.dimension() == 2 {
                cells.extend(start..start + block.len());
            }
            start += block.len();
        }
        let at = |i: &usize| self.points[*i];
        let color_at = |colors: &Cow<'_, [[u8; 4]]>| kept.iter().map(|&v| colors[v]).collect();
        View {
            points: kept.iter().map(at).collect(),
            blocks: blocks.collect(),
            point_fields: self
                .point_fields
                .iter()
                .map(|field| Field {
                    name: field.name.clone(),
                    values: field.values.select(kept.iter().copied()),
                })
                .collect(),
            cell_fields: self.fields_of(&cells),
            colors: self.colors.as_ref().map(color_at),
            groups: self.groups.clone(),
            group_of: match self.group_of.is_empty() {
                true => Cow::default(),
                false => cells.iter().map(|&c| self.group_of[c]).collect(),
            },
        }
    }

    /// The same view, with arrays borrowed from this one.
    fn clone_borrowed(&self) -> View<'_> {
        fn fields<'b>(fields: &'b [Field<'_>]) -> Vec<Field<'b>> {
            let borrowed = |field: &'b Field<'_>| Field {
                name: field.name.clone(),
                values: Values {
                    components: field.values.components,
                    numbers: match &field.values.numbers {
                        Numbers::F32(n) => Numbers::F32(n.as_ref().into()),
                        Numbers::F64(n) => Numbers::F64(n.as_ref().into()),
                        Numbers::U8(n) => Numbers::U8(n.as_ref().into()),
                        Numbers::U32(n) => Numbers::U32(n.as_ref().into()),
                        Numbers::I32(n) => Numbers::I32(n.as_ref().into()),
                        Numbers::I64(n) => Numbers::I64(n.as_ref().into()),
                    },
                },
            };
            fields.iter().map(borrowed).collect()
        }
        View {
            points: self.points.as_ref().into(),
            blocks: self.blocks.iter().map(Cells::borrowed).collect(),
            point_fields: fields(&self.point_fields),
            cell_fields: fields(&self.cell_fields),
            colors: self.colors.as_ref().map(|c| c.as_ref().into()),
            groups: self.groups.clone(),
            group_of: self.group_of.as_ref().into(),
        }
    }

    /// All faces as triangles: quads and polygons as fans from their first corner.
    ///
    /// A fan covers a polygon that is convex, or at least seen whole from its first corner.
    pub fn triangles(&self) -> Vec<[u32; 3]> {
        self.faces()
            .flat_map(|block| block.iter().flat_map(fan))
            .collect()
    }

    /// Only some of the triangles: those for which `keep` says so, asked with the cells behind and before each, as
    /// [`View::sides`] tells them. Groups without a cell go.
    ///
    /// Other cells stay, and all points do.
    pub fn with_triangles(mut self, mut keep: impl FnMut([u32; 2]) -> bool) -> Self {
        let mut is_kept = vec![true; self.cells()];
        // Polygons of three corners have sides, too.
        let is_triangle = self.blocks.iter().flat_map(|block| {
            let is_triangle = matches!(block, Cells::Triangles(_));
            std::iter::repeat_n(is_triangle, block.len())
        });
        let is_triangle: Vec<bool> = is_triangle.collect();
        for (cell, sides) in self.sides() {
            let cell = cell as usize;
            is_kept[cell] = !is_triangle[cell] || keep(sides);
        }
        let cells: Vec<usize> = (0..is_kept.len()).filter(|&c| is_kept[c]).collect();
        self.cell_fields = self.fields_of(&cells);
        let mut first = 0;
        for block in &mut self.blocks {
            let end = first + block.len();
            if let Cells::Triangles(all) = block {
                let kept = all.iter().zip(&is_kept[first..end]).filter(|t| *t.1);
                *all = kept.map(|t| *t.0).collect();
            }
            first = end;
        }
        if self.group_of.is_empty() {
            return self;
        }
        let mut group_of: Vec<u32> = cells.iter().map(|&c| self.group_of[c]).collect();
        let mut number = vec![NO_GROUP; self.groups.len()];
        for &group in &group_of {
            if let Some(number) = number.get_mut(group as usize) {
                *number = 0;
            }
        }
        let mut groups = Vec::new();
        for (number, group) in number.iter_mut().zip(self.groups) {
            if *number == 0 {
                *number = groups.len() as u32;
                groups.push(group);
            }
        }
        for group in &mut group_of {
            *group = number.get(*group as usize).copied().unwrap_or(NO_GROUP);
        }
        self.groups = groups;
        self.group_of = group_of.into();
        self
    }

    /// The field with this name among those of the points.
    pub fn find_point_field(&self, name: &str) -> Option<&Field<'a>> {
        self.point_fields.iter().find(|f| f.name == name)
    }

    /// The field with this name among those of the cells.
    pub fn find_cell_field(&self, name: &str) -> Option<&Field<'a>> {
        self.cell_fields.iter().find(|f| f.name == name)
    }

    /// The fields of some of the cells, given by their numbers through all blocks.
    pub(super) fn fields_of(&self, cells: &[usize]) -> Vec<Field<'static>> {
        let select = |field: &Field| Field {
            name: field.name.clone(),
            values: field.values.select(cells.iter().copied()),
        };
        self.cell_fields.iter().map(select).collect()
    }

    /// Do the parts keep what they promise each other? Asked by readers of what a file says, by writers of what a user
    /// put together by hand.
    pub(super) fn check(&self) -> Result<(), Error> {
        let finite = |p: &Point3| p.iter().all(|c| c.is_finite());
        if let Some(vertex) = self.points.iter().position(|p| !finite(p)) {
            return Err(crate::MeshError::NotFinite { vertex }.into());
        }
        for field in &self.point_fields {
            fits(&field.name, "point", &field.values, self.points.len())?;
        }
        if let Some(colors) = &self.colors {
            one_each("one colour for each point", colors.len(), self.points.len())?;
        }
        let mut cells = 0;
        for block in &self.blocks {
            block.check(cells, self.points.len())?;
            cells += block.len();
        }
        for field in &self.cell_fields {
            fits(&field.name, "cell", &field.values, cells)?;
        }
        if !self.group_of.is_empty() {
            one_each("one group for each cell", self.group_of.len(), cells)?;
        }
        Ok(())
    }

    /// The view, once it is checked.
    pub(super) fn checked(self) -> Result<Self, Error> {
        self.check().map(|()| self)
    }
}

/// Are there whole tuples, one for each element?
///
/// An error says how many were wanted and how many there are.
fn fits(name: &str, of: &str, values: &Values<'_>, elements: usize) -> Result<(), Error> {
    let (numbers, k) = (values.numbers(), values.components);
    let what = format!("one value of \"{name}\" for each {of}");
    if k == 0 || !numbers.is_multiple_of(k) {
        let found = format!("{numbers} numbers in tuples of {k}");
        return Err(ErrorKind::expected(format!("{what}: {elements}"), found).into());
    }
    one_each(&what, values.len(), elements)
}

/// The error that all parts of a view have in common: `what` and a number, and the number found.
pub(super) fn one_each(what: &str, found: usize, elements: usize) -> Result<(), Error> {
    if found == elements {
        return Ok(());
    }
    Err(ErrorKind::expected(format!("{what}: {elements}"), found.to_string()).into())
}

/// A polygon as triangles around its first corner; none if it has less than three.
pub(super) fn fan(ring: &[u32]) -> impl Iterator<Item = [u32; 3]> {
    (1..ring.len().max(1) - 1).map(|k| [ring[0], ring[k], ring[k + 1]])
}

/// Polygons as the simplest block that holds them.
///
/// So that a file of polygons that are all triangles gives triangles. No polygons are no triangles.
pub(super) fn block_of_rings(ends: Vec<u32>, corners: Vec<u32>) -> Cells<'static> {
    let all = |n: u32| (1..).zip(&ends).all(|(i, &end)| end == n * i);
    if all(3) {
        let (triangles, _) = corners.as_chunks();
        Cells::Triangles(triangles.to_vec().into())
    } else if all(4) {
        let (quads, _) = corners.as_chunks();
        Cells::Quads(quads.to_vec().into())
    } else {
        Cells::Polygons {
            ends: ends.into(),
            corners: corners.into(),
        }
    }
}

/// The side of the bounding box in which a boundary face lies, and its number, if its vertices belong to the box.
///
/// A face belongs to a side if all three vertices lie in it, to within 10⁻⁹ of the box's diagonal, and none of them is
/// of the surface or the interior.
fn box_side(mesh: &TetMesh, face: &Interface, bounds: &Aabb) -> Option<(&'static str, i32)> {
    if face.outside != OUTSIDE {
        return None;
    }
    let corners = face.triangle.map(|v| v as usize);
    let on_box = corners
        .iter()
        .all(|&v| !matches!(mesh.kinds()[v], VertexKind::Interior | VertexKind::Surface));
    if !on_box {
        return None;
    }
    const SIDES: [[&str; 2]; 3] = [["xmin", "xmax"], ["ymin", "ymax"], ["zmin", "zmax"]];
    // Smoothing keeps these coordinates, but a last bit may be lost.
    let slack = 1e-9 * bounds.diagonal();
    for (axis, names) in SIDES.iter().enumerate() {
        let places = [bounds.min[axis], bounds.max[axis]];
        for ((side, place), tag) in names.iter().zip(places).zip(2 * axis as i32 + 1..) {
            let near = |&v: &usize| (mesh.positions()[v][axis] - place).abs() <= slack;
            if corners.iter().all(near) {
                return Some((side, tag));
            }
        }
    }
    None
}

/// Which boundary faces belong to the outer boundary rather than to the molecule's surface. With the molecule
/// meshed, all do; without it, those that connect to the bounding box along the boundary, or none if the box itself is
/// the outer boundary.
///
/// Without the molecule the boundary has two parts, that around the molecule and the outer one, and what tells them
/// apart is that the outer one reaches the bounding box. Materials join the two only by faces within the mesh.
fn outer_faces(mesh: &TetMesh, faces: &[Interface], molecule_meshed: bool) -> Vec<bool> {
    if molecule_meshed {
        return vec![true; faces.len()];
    }
    let bounds = mesh.bounds();
    if faces.iter().any(|f| box_side(mesh, f, &bounds).is_some()) {
        return vec![false; faces.len()];
    }
    let mut pieces = DisjointSets::new(mesh.positions().len());
    let boundary = || faces.iter().filter(|face| face.outside == OUTSIDE);
    for face in boundary() {
        let [a, b, c] = face.triangle;
        pieces.join(a, b);
        pieces.join(a, c);
    }
    let mut touches = vec![false; mesh.positions().len()];
    for v in boundary().flat_map(|face| face.triangle) {
        let p = mesh.positions()[v as usize];
        if (0..3).any(|k| p[k] == bounds.min[k] || p[k] == bounds.max[k]) {
            touches[pieces.find(v) as usize] = true;
        }
    }
    faces
        .iter()
        .map(|f| touches[pieces.find(f.triangle[0]) as usize])
        .collect()
}
