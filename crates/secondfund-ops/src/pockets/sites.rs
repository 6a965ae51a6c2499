//! Candidates: connected sets of deep shell points, ranked by how deep and how many they are.
//!
//! A point counts with the square of its burial above a threshold, `(c − τ)²`: a few points very deep are worth as much as many that are
//! hardly so. τ is a percentile of each chain's own points, since a large protein is deeper everywhere than a small one.

use geom_core::compute::sets::DisjointSets;
use geom_core::{Point3, Structure, Vector3};

use super::atoms::Atoms;
use super::shell::{ShellPoint, shell};
use crate::Error;
use crate::options::PocketOptions;

/// A place where a ligand may bind.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct Pocket {
    /// From 1, by decreasing score.
    pub rank: usize,
    /// `Σ (c − τ)²` over its points, with the burial c and the threshold τ, in squared atoms.
    pub score: f64,
    /// Where its points, weighted in the same way, lie densest, Å.
    pub center: Point3,
    /// The largest burial of a point.
    pub burial: f64,
    /// The volume of its points, Å³: where centres of ligand atoms may lie.
    pub volume: f64,
    /// Its points, Å.
    pub points: Vec<Point3>,
    /// Numbers of the polymer atoms within 4 Å of the surface of a point, ascending.
    pub atoms: Vec<u32>,
    /// Numbers of their residues, ascending.
    pub residues: Vec<u32>,
    /// Numbers of their chains, ascending: several where it lies between chains.
    pub chains: Vec<u32>,
}

/// The pockets of a structure.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct Pockets {
    /// By rank.
    pub pockets: Vec<Pocket>,
    /// Heavy polymer atoms that were counted.
    pub atoms: usize,
    /// Points of the shell.
    pub shell_points: usize,
    /// Candidates before those beyond [`PocketOptions::most`] were dropped.
    pub candidates: usize,
}

/// How far from a point's ligand atom an atom lines the pocket, Å between centres less the radius.
const LINING: f64 = 4.0;

/// The pockets of a structure's polymers: all that is neither polymer nor heavy is left out, so that a ligand
/// in the file does not fill its own pocket. None on a convex body. The same in every orientation: the lattice
/// lies along the principal axes.
///
/// # Errors
/// Options out of range, [`Error::NoAtoms`], [`Error::BadAtom`].
pub fn find(structure: &Structure, options: &PocketOptions) -> Result<Pockets, Error> {
    options.check()?;
    let atoms = Atoms::of(structure)?;
    let points = shell(&atoms, options);
    let thresholds = thresholds(&points, structure.chains().len(), options);
    let deep: Vec<(ShellPoint, f64)> = points
        .iter()
        .map(|p| (*p, p.burial - thresholds[p.chain as usize]))
        .filter(|(_, excess)| *excess > 0.0)
        .collect();
    let mut found: Vec<Candidate> = clusters(&deep, options.spacing, options.link)
        .into_iter()
        .filter(|members| members.len() >= options.least_points)
        .map(|members| Candidate::of(&deep, members))
        .collect();
    found.sort_by(|a, b| b.score.total_cmp(&a.score).then(a.members.cmp(&b.members)));
    let candidates = found.len();
    found.truncate(options.most);
    let pockets = found.iter().enumerate();
    Ok(Pockets {
        pockets: pockets
            .map(|(i, c)| c.pocket(i + 1, &deep, &atoms, structure, options))
            .collect(),
        atoms: atoms.positions.len(),
        shell_points: points.len(),
        candidates,
    })
}

/// The burial that counts as deep: the percentile, and at least so much above the median. Of each chain's own
/// points, so that the clefts between chains do not hide the pockets within them.
fn thresholds(points: &[ShellPoint], chains: usize, options: &PocketOptions) -> Vec<f64> {
    let threshold = |mut burial: Vec<f64>| {
        burial.sort_by(f64::total_cmp);
        let at = |share: f64| {
            let place = (share * burial.len() as f64) as usize;
            burial
                .get(place.min(burial.len().saturating_sub(1)))
                .copied()
        };
        match (at(options.percentile), at(0.5)) {
            (Some(high), Some(median)) => high.max(options.prominence * median),
            _ => f64::INFINITY,
        }
    };
    if options.per_chain {
        let mut of_chain = vec![Vec::new(); chains];
        points
            .iter()
            .for_each(|p| of_chain[p.chain as usize].push(p.burial));
        of_chain.into_iter().map(threshold).collect()
    } else {
        vec![threshold(points.iter().map(|p| p.burial).collect()); chains]
    }
}

/// Single linkage: sets of points of which each is at most `link` from another one of its set, by their lowest
/// point.
fn clusters(deep: &[(ShellPoint, f64)], spacing: f64, link: f64) -> Vec<Vec<u32>> {
    let reach = (link / spacing).floor() as i32;
    let mut by_place: Vec<([i32; 3], u32)> = deep
        .iter()
        .enumerate()
        .map(|(i, (p, _))| (p.place, i as u32))
        .collect();
    by_place.sort_unstable();
    let mut sets = DisjointSets::new(deep.len());
    let steps = || -reach..=reach;
    let offsets: Vec<[i32; 3]> = steps()
        .flat_map(|x| steps().flat_map(move |y| steps().map(move |z| [x, y, z])))
        .filter(|d| d > &[0, 0, 0])
        .filter(|d| {
            let squared: i32 = d.iter().map(|c| c * c).sum();
            f64::from(squared).sqrt() * spacing <= link
        })
        .collect();
    for &(place, i) in &by_place {
        for d in &offsets {
            let other = [place[0] + d[0], place[1] + d[1], place[2] + d[2]];
            if let Ok(at) = by_place.binary_search_by(|e| e.0.cmp(&other)) {
                sets.join(i, by_place[at].1);
            }
        }
    }
    let roots = sets.into_roots();
    let mut members: Vec<Vec<u32>> = vec![Vec::new(); deep.len()];
    for (i, &root) in roots.iter().enumerate() {
        members[root as usize].push(i as u32);
    }
    members.retain(|m| !m.is_empty());
    members
}

/// Width σ of the kernel in which the points of a pocket are densest at its centre, Å.
/// Less follows single points, more goes to the mean.
const WIDTH: f64 = 4.0;
/// Most steps towards that place, and the length of the last, Å.
const SHIFTS: usize = 100;
const LAST_SHIFT: f64 = 1e-6;

/// The place where weighted points are densest: mean shift from the point of the highest density (Comaniciu and
/// Meer, *Mean shift*, 2002). The mean itself may lie in none of the parts of a long pocket.
fn densest(points: &[(Point3, f64)]) -> Point3 {
    let kernel = |p: &Point3, q: &Point3| (-(p - q).norm_squared() / (2.0 * WIDTH * WIDTH)).exp();
    let density = |at: &Point3| points.iter().map(|(p, w)| w * kernel(p, at)).sum::<f64>();
    let mut best = (f64::NEG_INFINITY, Point3::origin());
    for (p, _) in points {
        let d = density(p);
        if d > best.0 {
            best = (d, *p);
        }
    }
    let mut at = best.1;
    for _ in 0..SHIFTS {
        let (mut sum, mut total) = (Vector3::zeros(), 0.0);
        for (p, w) in points {
            let share = w * kernel(p, &at);
            sum += p.coords * share;
            total += share;
        }
        let next = Point3::from(sum / total);
        let length = (next - at).norm();
        at = next;
        if length < LAST_SHIFT {
            break;
        }
    }
    at
}

/// What lies around the points of a pocket.
pub(super) struct Lining {
    /// Numbers in the structure, ascending, as those of the residues and chains.
    pub(super) atoms: Vec<u32>,
    pub(super) residues: Vec<u32>,
    pub(super) chains: Vec<u32>,
}

impl Lining {
    /// Of points in the molecule's frame.
    pub(super) fn of(
        points: impl Iterator<Item = Point3>,
        atoms: &Atoms,
        structure: &Structure,
    ) -> Self {
        let mut lining: Vec<u32> = Vec::new();
        for p in points {
            atoms.within(&p, LINING + atoms.largest, |a, d| {
                if d.sqrt() - atoms.radii[a as usize] <= LINING {
                    lining.push(a);
                }
            });
        }
        let sorted = |mut all: Vec<u32>| {
            all.sort_unstable();
            all.dedup();
            all
        };
        let lining = sorted(lining);
        let residue = |a: &u32| structure.residue_starts().partition_point(|s| s <= a) as u32 - 1;
        let numbers: Vec<u32> = lining.iter().map(|&a| atoms.index[a as usize]).collect();
        Self {
            chains: sorted(lining.iter().map(|&a| atoms.chain[a as usize]).collect()),
            residues: sorted(numbers.iter().map(residue).collect()),
            atoms: numbers,
        }
    }
}

/// A set of points with its score.
struct Candidate {
    members: Vec<u32>,
    score: f64,
    center: Point3,
}

impl Candidate {
    fn of(deep: &[(ShellPoint, f64)], members: Vec<u32>) -> Self {
        let weighted: Vec<(Point3, f64)> = members
            .iter()
            .map(|&m| &deep[m as usize])
            .map(|(point, excess)| (point.position, excess * excess))
            .collect();
        Self {
            members,
            score: weighted.iter().map(|w| w.1).sum(),
            center: densest(&weighted),
        }
    }

    /// Everything back in the coordinates of the file.
    fn pocket(
        &self,
        rank: usize,
        deep: &[(ShellPoint, f64)],
        atoms: &Atoms,
        structure: &Structure,
        options: &PocketOptions,
    ) -> Pocket {
        let points = || self.members.iter().map(|&m| &deep[m as usize].0);
        let lining = Lining::of(points().map(|p| p.position), atoms, structure);
        Pocket {
            rank,
            score: self.score,
            center: atoms.frame.leave(&self.center),
            burial: points().map(|p| p.burial).fold(0.0, f64::max),
            volume: self.members.len() as f64 * options.spacing.powi(3),
            points: points().map(|p| atoms.frame.leave(&p.position)).collect(),
            atoms: lining.atoms,
            residues: lining.residues,
            chains: lining.chains,
        }
    }
}

/// What holds here, for the tests.
#[cfg(feature = "testing")]
pub(crate) mod laws {
    use super::*;

    fn points(chain: u32, depth: f64) -> impl Iterator<Item = ShellPoint> {
        (0..100).map(move |i| ShellPoint {
            place: [i, 0, 0],
            position: Point3::origin(),
            chain,
            burial: depth * f64::from(i),
        })
    }

    /// A shallow chain has its own depth beside a deep one, unless all are asked for together.
    pub fn what_is_deep_is_asked_of_each_chain() {
        let options = PocketOptions::default();
        let alone = |depth| thresholds(&points(0, depth).collect::<Vec<_>>(), 1, &options)[0];
        let both: Vec<ShellPoint> = points(0, 1.0).chain(points(1, 0.4)).collect();
        assert_eq!(thresholds(&both, 2, &options), [alone(1.0), alone(0.4)]);
        let together = PocketOptions {
            per_chain: false,
            ..options
        };
        let [a, b] = thresholds(&both, 2, &together)[..] else {
            panic!("two chains")
        };
        assert!(a == b && b > alone(0.4));
    }
}
