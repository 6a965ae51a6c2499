//! Tetrahedra.

use std::collections::BTreeSet;

use geom_core::compute::sets::DisjointSets;
use geom_core::mesh::{EXTERIOR, INTERIOR, OUTSIDE, Region, VertexKind, six_volume};
use geom_core::options::OutOfRange;
use geom_core::{ImplicitField, LatticeValues, Point3, Run, TetMesh, TriMesh};

use super::report::Report;
use super::resolution::resolved;
use super::setup::Purpose;
use super::surface::surface_mesh;
use super::{Contour, contour};
use crate::backend::ContourBackend;
use crate::complex::collect::compact;
use crate::{Error, Extent, Options, Outer};

/// Tetrahedra, the surface of the molecule, and how they came about.
#[derive(Clone, Debug, PartialEq)]
pub struct Volume {
    /// Positive, conforming tetrahedra with a region each.
    pub mesh: TetMesh,
    /// The boundary of the molecule, with vertices of its own.
    pub surface: TriMesh,
    /// Regions given to parts of the exterior that do not connect with its largest, by decreasing
    /// volume ([`Options::separate_exterior`]).
    pub exterior_parts: Vec<Region>,
    /// Counts.
    pub report: Report,
}

impl Volume {
    /// Names of the regions for the writers of `geom_core::io`: `exterior`, `molecule`, and
    /// `exterior_2` … for separate parts. Other materials are the caller's to name.
    ///
    /// The exterior and the molecule are named whether they are meshed or not; parts count from 2, since the largest is
    /// the exterior itself.
    pub fn names(&self) -> Vec<(Region, String)> {
        let fixed = [(EXTERIOR, "exterior"), (INTERIOR, "molecule")];
        let parts = self.exterior_parts.iter().enumerate();
        fixed
            .into_iter()
            .map(|(r, name)| (r, name.to_owned()))
            .chain(parts.map(|(i, &r)| (r, format!("exterior_{}", i + 2))))
            .collect()
    }
}

/// Tetrahedra inside or outside of the molecule, or both, conforming across all interfaces; the surface is that of
/// [`surface`](crate::surface), and so is what runs on the backend.
///
/// The mesh says of each vertex how it may move ([`VertexKind`]): on the surface, or the curve in which several meet, in a
/// face or an edge of the box, or not at all where an interface meets the box. Whoever improves the mesh goes by that. While it is
/// made a tetrahedron takes some 60 bytes with [`Method::DualContour`](crate::Method), and several times as much near
/// the surface with [`Method::Stuffing`](crate::Method).
///
/// ```
/// use dual_contour::geom_core::{Aabb, Cpu, Run};
/// use dual_contour::{Extent, FieldSamples, Method, Options, volume};
/// # use dual_contour::geom_core::{ImplicitField, Point3, Vector3};
/// # struct Ball;
/// # impl ImplicitField for Ball {
/// #     fn value(&self, x: &Point3) -> f64 {
/// #         4.0 - x.coords.norm()
/// #     }
/// #     fn value_gradient(&self, x: &Point3) -> (f64, Vector3) {
/// #         (self.value(x), -x.coords.normalize())
/// #     }
/// # }
/// # fn main() -> Result<(), dual_contour::Error> {
/// // The field `Ball` has the value 1 on a sphere of radius 3 Å.
/// let bounds = Aabb::new(Point3::new(-4.0, -4.0, -4.0), Point3::new(4.0, 4.0, 4.0));
/// let values = FieldSamples::new(&Ball, &bounds, 0.5);
/// let options = Options {
///     method: Method::Stuffing,
///     region: Extent::Both,
///     ..Options::default()
/// };
/// let made = volume(&values, Some(&Ball), &options, Run::on(&Cpu))?;
/// let box_volume: f64 = made.mesh.bounds().extent().iter().product();
/// assert!((made.mesh.volume() / box_volume - 1.0).abs() < 1e-12, "the box is filled");
/// assert_eq!(made.surface.euler_characteristic(), 2);
/// # Ok(())
/// # }
/// ```
///
/// # Errors
///
/// Those of [`surface`](crate::surface); options of the exterior without an exterior, and more separate parts of it
/// than there are regions.
pub fn volume<V: LatticeValues + ?Sized, B: ContourBackend + ?Sized>(
    values: &V,
    field: Option<&dyn ImplicitField>,
    options: &Options,
    run: Run<'_, B>,
) -> Result<Volume, Error> {
    let run = run.with(run.backend.as_contour());
    let interior = options.region == Extent::Interior;
    let asked = [
        ("outer", options.outer != Outer::Grid),
        ("separate_exterior", options.separate_exterior),
        ("materials", !options.materials.is_empty()),
    ];
    if let Some((option, _)) = asked.iter().find(|(_, set)| *set && interior) {
        let must = "be left alone where the exterior is not meshed; or take the exterior or both as the region";
        return Err(OutOfRange::new(option, "set", must).into());
    }
    let options = resolved(values, field, options, run)?;
    let Contour {
        mut raw,
        domain,
        report,
    } = contour(
        values,
        field,
        &options,
        Purpose::Volume(options.region),
        run,
    )?;
    let surface = surface_mesh(&raw.positions, std::mem::take(&mut raw.triangles), &domain);
    let kept = compact(raw.positions.len(), &mut raw.tets);
    let kinds: Vec<VertexKind> = kept.iter().map(|&v| raw.kinds[v as usize]).collect();
    let positions: Vec<Point3> = kept
        .iter()
        .map(|&v| domain.world(&raw.positions[v as usize]))
        .collect();
    let exterior_parts = if options.separate_exterior {
        separate(&positions, &raw.tets, &mut raw.regions)?
    } else {
        Vec::new()
    };
    let mesh = TetMesh::with_kinds(positions, raw.tets, raw.regions, kinds)
        .expect("emitted tetrahedra name emitted vertices");
    Ok(Volume {
        mesh,
        surface,
        exterior_parts,
        report,
    })
}

/// Gives each connected part of the exterior but the largest a region of its own, the lowest that are
/// free. Returns the new regions, by decreasing volume of their parts.
/// Connected by vertices off all interfaces, not by faces: so two parts that touch in a vertex of an interface alone
/// stay two.
fn separate(
    positions: &[Point3],
    tets: &[[u32; 4]],
    regions: &mut [Region],
) -> Result<Vec<Region>, Error> {
    // Tetrahedra are connected by vertices that touch the exterior alone: every one has such a vertex,
    // and no two parts share one.
    let mut mixed = vec![false; positions.len()];
    for (tet, _) in tets.iter().zip(&*regions).filter(|(_, r)| **r != EXTERIOR) {
        tet.iter().for_each(|&v| mixed[v as usize] = true);
    }
    let exterior: Vec<usize> = (0..tets.len())
        .filter(|&t| regions[t] == EXTERIOR)
        .collect();
    let mut groups = DisjointSets::new(positions.len());
    for &t in &exterior {
        let mut free = tets[t].iter().filter(|&&v| !mixed[v as usize]);
        if let Some(&first) = free.next() {
            free.for_each(|&v| groups.join(first, v));
        }
    }
    let roots = groups.into_roots();
    let part = |t: usize| {
        let free = tets[t].iter().find(|&&v| !mixed[v as usize]);
        roots[*free.unwrap_or(&tets[t][0]) as usize]
    };
    let mut volumes = vec![0.0; positions.len()];
    for &t in &exterior {
        volumes[part(t) as usize] += six_volume(tets[t].map(|v| positions[v as usize]));
    }
    let mut parts: Vec<u32> = (0..positions.len() as u32)
        .filter(|&v| volumes[v as usize] > 0.0)
        .collect();
    parts.sort_by(|&a, &b| {
        volumes[b as usize]
            .total_cmp(&volumes[a as usize])
            .then(a.cmp(&b))
    });
    let taken: BTreeSet<Region> = regions.iter().copied().collect();
    let free: Vec<Region> = (INTERIOR + 1..OUTSIDE)
        .filter(|r| !taken.contains(r))
        .collect();
    let others = parts.get(1..).unwrap_or(&[]);
    if others.len() > free.len() {
        return Err(Error::TooManyParts {
            parts: parts.len(),
            regions: free.len() + 1,
        });
    }
    let mut region = vec![EXTERIOR; positions.len()];
    for (&root, &r) in others.iter().zip(&free) {
        region[root as usize] = r;
    }
    for &t in &exterior {
        regions[t] = region[part(t) as usize];
    }
    Ok(free[..others.len()].to_vec())
}
