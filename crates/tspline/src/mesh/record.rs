//! A T-mesh as plain numbers: what is written to a file and read again.

use geom_core::mesh::Halfedges;
use geom_core::{Point3, QuadMesh};

use super::{Element, THalfedge, TMesh, balance, check_levels};
use crate::Error;
use crate::mesh::blocks::Forest;

/// The name of the format.
pub const FORMAT: &str = "tmesh/1";

/// A T-mesh as plain numbers, for JSON or any other format of serde. The fine mesh with its levels says all; what is
/// derived from it stands beside it, so that other programs need not know how, and is compared when it is read.
///
/// ```
/// use tspline::{TMesh, TMeshOptions, geom_core::mesh::shapes, mesh::Record};
/// let fine = shapes::quad_sphere(1.0, 8);
/// let mesh = TMesh::build(&fine, &[1; 384], &TMeshOptions::default())?;
/// assert_eq!(TMesh::try_from(Record::from(&mesh))?, mesh);
/// # Ok::<(), tspline::Error>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Record {
    /// [`FORMAT`].
    pub format: String,
    /// Vertices of the fine mesh, Å.
    pub fine_vertices: Vec<[f64; 3]>,
    /// Corners of the fine quads.
    pub fine_quads: Vec<[u32; 4]>,
    /// The level that each fine quad allows at most.
    pub allowed: Vec<u8>,
    /// The level of the element in which each fine quad lies.
    pub levels: Vec<u8>,
    /// The vertices of the T-mesh: their numbers in the fine mesh.
    pub vertices: Vec<u32>,
    /// Elements, whose corners count the vertices of the T-mesh.
    pub elements: Vec<Element>,
    /// Half-edges with their knot intervals.
    pub halfedges: Vec<THalfedge>,
}

impl From<&TMesh> for Record {
    fn from(mesh: &TMesh) -> Self {
        Self {
            format: FORMAT.to_owned(),
            fine_vertices: mesh
                .fine
                .positions()
                .iter()
                .map(|p| p.coords.into())
                .collect(),
            fine_quads: mesh.fine.quads().to_vec(),
            allowed: mesh.forest.allowed().to_vec(),
            levels: mesh.levels(),
            vertices: mesh.fine_of.clone(),
            elements: mesh.elements.clone(),
            halfedges: mesh.halfedges(),
        }
    }
}

impl TryFrom<Record> for TMesh {
    type Error = Error;

    /// # Errors
    /// [`Error::Record`] if the numbers contradict each other or break a rule of T-meshes; those of [`TMesh::build`].
    fn try_from(record: Record) -> Result<Self, Error> {
        if record.format != FORMAT {
            return Err(Error::Record { what: "format" });
        }
        let positions = record.fine_vertices.iter().map(|&p| Point3::from(p));
        let fine = QuadMesh::new(positions.collect(), record.fine_quads)?;
        check_levels(&fine, &record.allowed)?;
        check_levels(&fine, &record.levels)?;
        let edges = Halfedges::of_quads(&fine)?;
        let forest = Forest::new(&edges, &record.allowed);
        if !balance::is_cover(&edges, &forest, &record.levels) {
            return Err(Error::Record { what: "levels" });
        }
        let mesh = Self::of_levels(&fine, edges, forest, &record.levels);
        if mesh.fine_of != record.vertices {
            return Err(Error::Record { what: "vertices" });
        }
        if mesh.elements != record.elements {
            return Err(Error::Record { what: "elements" });
        }
        if mesh.halfedges() != record.halfedges {
            return Err(Error::Record { what: "halfedges" });
        }
        Ok(mesh)
    }
}
