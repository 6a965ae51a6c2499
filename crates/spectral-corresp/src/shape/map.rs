//! Maps of boundary nodes that know where they lead.

use std::ops::Deref;
use std::slice::Iter;

use super::VoxelShape;
use crate::Error;

/// Which boundary node of one shape belongs to each one of another, by their places in
/// [`VoxelShape::boundary`].
///
/// A map knows from which shape to which it leads, so that it is refused where it is taken the wrong way round.
///
/// ```
/// use spectral_corresp::geom_core::{Cpu, Lattice, Point3, Run};
/// use spectral_corresp::{CompareOptions, Error, Map, ShapeOptions, VoxelShape, compare};
/// let bar = |counts: [usize; 3]| {
///     let lattice = Lattice { origin: Point3::origin(), spacing: 1.5, counts };
///     VoxelShape::of_flags(&lattice, vec![true; lattice.len()], &ShapeOptions::default(), Run::on(&Cpu))
/// };
/// let (a, b) = (bar([12, 6, 6])?, bar([14, 6, 6])?);
/// let there = Map::new(&a, &b, (0..a.boundary().len() as u32).collect())?;
/// let options = CompareOptions::default();
/// assert!(compare(&a, &b, &there, &options, Run::on(&Cpu)).is_ok());
/// assert_eq!(compare(&b, &a, &there, &options, Run::on(&Cpu)), Err(Error::Direction));
/// # Ok::<(), Error>(())
/// ```
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Map {
    /// Identities of both shapes.
    ends: [u64; 2],
    partners: Vec<u32>,
}

impl Map {
    /// From each boundary node of `from` to the boundary node of `to` that is named.
    pub fn new(from: &VoxelShape, to: &VoxelShape, partners: Vec<u32>) -> Result<Self, Error> {
        let (found, expected, count) = (partners.len(), from.points.len(), to.points.len());
        if found != expected {
            return Err(Error::Length {
                what: "partners",
                found,
                expected,
            });
        }
        if let Some(node) = partners.iter().position(|&p| p as usize >= count) {
            return Err(Error::Image {
                node,
                image: partners[node] as usize,
                count,
            });
        }
        Ok(Self {
            ends: [from.identity, to.identity],
            partners,
        })
    }

    /// The partner of each node.
    pub fn partners(&self) -> &[u32] {
        &self.partners
    }

    /// Does it lead from the one to the other?
    pub fn leads(&self, from: &VoxelShape, to: &VoxelShape) -> bool {
        self.ends == [from.identity, to.identity]
    }

    pub(crate) fn check(&self, from: &VoxelShape, to: &VoxelShape) -> Result<(), Error> {
        match self.leads(from, to) {
            true => Ok(()),
            false => Err(Error::Direction),
        }
    }
}

impl Deref for Map {
    type Target = [u32];

    fn deref(&self) -> &[u32] {
        &self.partners
    }
}

impl<'a> IntoIterator for &'a Map {
    type Item = &'a u32;
    type IntoIter = Iter<'a, u32>;

    fn into_iter(self) -> Iter<'a, u32> {
        self.partners.iter()
    }
}

impl VoxelShape {
    /// A number that shapes of other nodes have not (FNV-1a; Fowler, Noll and Vo, 1991).
    pub(super) fn identified(mut self) -> Self {
        let mut hash = 0xcbf2_9ce4_8422_2325u64;
        let mut take = |word: u64| hash = (hash ^ word).wrapping_mul(0x0000_0100_0000_01b3);
        let lattice = &self.lattice;
        let corner = self.position(0);
        let lengths = [lattice.spacing, corner.x, corner.y, corner.z];
        lengths.iter().for_each(|x| take(x.to_bits()));
        let places = self.graph.tables().places;
        places.iter().for_each(|&place| take(place.into()));
        self.identity = hash;
        self
    }
}
