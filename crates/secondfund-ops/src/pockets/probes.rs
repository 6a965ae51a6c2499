//! Points that a small probe reaches and a large one does not cover: a second source of what belongs to a pocket.

use geom_core::compute::parallel;
use geom_core::compute::sets::DisjointSets;
use geom_core::search::nearest::PointTree;
use geom_core::{Point3, Structure, TriMesh};
use rayon::prelude::*;

use super::atoms::Atoms;
use super::measure::REACH;
use super::shell::lattice;
use super::sites::Pocket;
use crate::Error;
use crate::forms::{centroid, sorted_sides};
use crate::options::ProbeOptions;

/// The places where the centre of a small probe fits between the polymer's atoms, but which no large probe outside of
/// them covers (Kleywegt and Jones, *Detection, delineation, measurement and display of cavities*, 1994; Kawabata and
/// Go, 2007), Å. Hollows and closed cavities alike, unless the large probe fits into these, on a lattice along the
/// molecule's principal axes.
///
/// # Errors
/// Options out of range, [`Error::NoAtoms`].
pub fn between_probes(structure: &Structure, options: &ProbeOptions) -> Result<Vec<Point3>, Error> {
    options.check()?;
    let atoms = Atoms::of(structure)?;
    // Where the large probe fits, lattice points two steps farther out are enough to tell what it covers.
    let far = options.outer + 2.0 * options.spacing;
    let near = lattice(&atoms, [options.inner, far], options.spacing, |p, _| {
        (p.position, p.gap >= options.outer)
    });
    let centers: Vec<Point3> = near.iter().filter(|p| p.1).map(|p| p.0).collect();
    let tree = PointTree::of_positions(&centers)?;
    let uncovered = |p: &Point3| {
        let center = tree.nearest(&[p.x, p.y, p.z], 1);
        center.first().is_none_or(|c| c.distance > options.outer)
    };
    Ok(near
        .into_par_iter()
        .filter(|(p, outside)| !outside && uncovered(p))
        .map(|(p, _)| atoms.frame.leave(&p))
        .collect())
}

/// Points of pockets and whose they are.
/// Points of all pockets in one tree, those of the better ranks first.
struct Owned {
    tree: PointTree<3>,
    owners: Vec<u32>,
}

impl Owned {
    /// Of the pockets' own points, and of those of their hollows, if they are known.
    fn of(pockets: &[Pocket], hollows: &[Vec<Point3>]) -> Result<Self, Error> {
        let (mut points, mut owners) = (Vec::new(), Vec::new());
        for (pocket, i) in pockets.iter().zip(0..) {
            points.extend(&pocket.points);
            points.extend(hollows.get(i as usize).into_iter().flatten());
            owners.resize(points.len(), i);
        }
        let tree = PointTree::of_positions(&points)?;
        Ok(Self { tree, owners })
    }

    /// The pocket of the nearest point within `reach`; of equally near ones that of the better rank.
    fn nearest(&self, p: &Point3, reach: f64) -> Option<(u32, Point3)> {
        let nearest = self.tree.nearest(&[p.x, p.y, p.z], 1);
        let near = nearest.first().filter(|near| near.distance <= reach)?;
        let place = Point3::from(self.tree.points()[near.index as usize]);
        Some((self.owners[near.index as usize], place))
    }
}

/// The points that belong to each pocket: to that with the nearest point of its own, within reach.
/// A point that is one of a pocket's own is left out.
pub(super) fn shared_out(
    points: &[Point3],
    pockets: &[Pocket],
    reach: f64,
) -> Result<Vec<Vec<Point3>>, Error> {
    let own = Owned::of(pockets, &[])?;
    let mut shares = vec![Vec::new(); pockets.len()];
    for p in points {
        // On the same lattice some are the pocket's own.
        match own.nearest(p, reach) {
            Some((owner, point)) if point != *p => shares[owner as usize].push(*p),
            _ => {}
        }
    }
    Ok(shares)
}

/// Parts of an outline, and holes in it, of less than this share of its largest part's triangles are crumbs.
const CRUMB: f64 = 0.1;

/// The pocket of each triangle: that of the nearest of its points and of those of its hollow, in front of the triangle.
/// Parts that lie apart and are small belong to none, small holes to what is around them.
pub(super) fn triangles_at(
    surface: &TriMesh,
    pockets: &[Pocket],
    hollows: &[Vec<Point3>],
) -> Result<Vec<Option<u32>>, Error> {
    let all = Owned::of(pockets, hollows)?;
    let mut owners: Vec<Option<u32>> = parallel::map(surface.triangles().len(), |t| {
        let middle = centroid(surface.positions(), &surface.triangles()[t]);
        let (owner, point) = all.nearest(&middle, REACH)?;
        let in_front = surface.doubled_area_normal(t).dot(&(point - middle)) > 0.0;
        in_front.then_some(owner)
    });
    settle(surface, &mut owners, pockets.len());
    Ok(owners)
}

/// Gives up crumbs, and fills small holes within one outline.
/// Parts are connected over edges. What touches several outlines stays without an owner.
fn settle(surface: &TriMesh, owners: &mut [Option<u32>], pockets: usize) {
    let sides = sorted_sides(surface.triangles());
    let pairs = || {
        let meeting = sides.chunk_by(|a, b| a.0 == b.0).flat_map(|e| e.windows(2));
        meeting.map(|pair| [pair[0].1, pair[1].1])
    };
    let mut parts = DisjointSets::new(owners.len());
    for [f, g] in pairs() {
        if owners[f as usize] == owners[g as usize] {
            parts.join(f, g);
        }
    }
    let part_of = parts.into_roots();
    let mut sizes = vec![0u32; owners.len()];
    part_of.iter().for_each(|&part| sizes[part as usize] += 1);
    let mut largest = vec![0u32; pockets];
    for (owner, &part) in owners.iter().zip(&part_of) {
        if let Some(owner) = owner {
            let most = &mut largest[*owner as usize];
            *most = (*most).max(sizes[part as usize]);
        }
    }
    let is_crumb = |part: u32, owner: u32| {
        f64::from(sizes[part as usize]) < CRUMB * f64::from(largest[owner as usize])
    };
    // Which outlines surround each part of no owner: one, or several.
    let mut around: Vec<Vec<u32>> = vec![Vec::new(); owners.len()];
    for [f, g] in pairs().flat_map(|[f, g]| [[f, g], [g, f]]) {
        if let (None, Some(owner)) = (owners[f as usize], owners[g as usize]) {
            let known = &mut around[part_of[f as usize] as usize];
            if !known.contains(&owner) {
                known.push(owner);
            }
        }
    }
    for (owner, &part) in owners.iter_mut().zip(&part_of) {
        *owner = match (*owner, &around[part as usize][..]) {
            (Some(own), _) => (!is_crumb(part, own)).then_some(own),
            (None, &[one]) if is_crumb(part, one) => Some(one),
            (None, _) => None,
        };
    }
}
