//! The search for the correspondence of two shapes, its verdict, and their joint modes (Sections 6.2–6.4).
//!
//! One search reads like this: candidates from features and rigid motions (`start`) are fitted shortly on 1,500 nodes,
//! one way and the other; the best, and maps that go on from it to a symmetric twin (`rivals`), are fitted on all
//! nodes; what is torn is mended (`torn`); and the verdict asks whether the score is that of right maps and no other
//! map comes near it. The score J is the same measure all along, so that maps of any origin can be compared.

mod embed;
mod joint;
mod rivals;
mod torn;

use geom_core::nalgebra::Matrix3;
use geom_core::options::require;
use geom_core::{Point3, Run, Vector3};

use crate::Error;
use crate::backend::{CorrespBackend, Kernels, Nearest, On, Rows};
use crate::fit::{self, Fit, LONG, SHORT, Schedule, Side, anneal, descend};
use crate::options::{Directions, MatchOptions, Refine, Start};
use crate::shape::{Map, VoxelShape};
use crate::start::{self, Boundary, Candidate, Judge, best_apart, distance};

pub use embed::Embedding;
#[cfg(feature = "testing")]
#[doc(hidden)]
pub use joint::links;
pub use joint::{JointModes, joint_modes};
use torn::Pieces;

/// Nodes on which candidates are fitted.
/// Well spread over the boundary: enough to tell maps apart, few enough to fit dozens.
const THINNED: usize = 1500;
/// Maps that are fitted on all nodes, of those that score at most this times the best.
const FITTED: usize = 3;
const NEAR_BEST: f64 = 1.15;
/// Spacings of two shapes may differ by this share.
const SPACINGS: f64 = 0.01;
/// Two maps that differ, the worse of which scores less than this times the better and this more (Å): which is right is
/// not known.
const AMBIGUOUS: (f64, f64) = (1.04, 0.05);
/// Maps whose images are farther apart than this on average are not variants of one, Å.
const ANOTHER: f64 = 8.0;
/// The share of nodes in pieces torn off above which a map is doubtful: right maps of 16 pairs of proteins tear off at
/// most 0.016 (a tail that folded away).
const TORN: f64 = 0.02;
/// How often pieces are hung back on.
const MENDED: usize = 3;
/// The share of nodes that another map takes elsewhere, farther than the last, if it is not a variant.
const ELSEWHERE: f64 = 0.15;
/// Neighbourhoods of the thesis's second step, Å.
const THESIS_RADIUS: f64 = 18.0;

/// How far a correspondence is to be trusted.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(rename_all = "lowercase"))]
pub enum Verdict {
    /// The score is that of right matches, no other map comes near it, and nothing is torn off.
    Good,
    /// The score is between those of right and of wrong matches, or another map scores as well, or pieces of a shape are
    /// torn from what they hang on, or the mirror image of a shape fits better.
    Doubtful,
    /// The score is that of wrong matches.
    Failed,
}

/// A map that was tried.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct CandidateReport {
    /// What it came from.
    pub name: String,
    /// Does it lead from the second shape to the first?
    pub backward: bool,
    /// The score by which it was chosen among its kind, Å.
    pub start: f64,
    /// J after a short fit, or as it is where none is asked for, Å.
    pub fitted: f64,
    /// How far its images are from those of the best one on average, Å; 0 for the best.
    pub apart: f64,
}

/// Which boundary node of the second shape belongs to which of the first, and the other way. Nodes are named by their
/// places in [`VoxelShape::boundary`].
#[derive(Clone, Debug, PartialEq)]
pub struct Correspondence {
    /// For each boundary node of the first shape one of the second.
    pub forward: Map,
    /// For each boundary node of the second shape one of the first.
    pub backward: Map,
    /// Where each boundary node of the first shape goes: near its partner, not on a lattice.
    pub images: Vec<Point3>,
    /// The rotation of each boundary node's neighbourhood.
    pub rotations: Vec<Matrix3<f64>>,
    /// How far each image is from its partner, in places and normals, of which one counts as 1 Å; large where the other
    /// shape has no such part.
    pub distances: Vec<f64>,
    /// The share of the second shape's boundary nodes that are partners of the first's.
    pub coverage: f64,
    /// J: root mean square distortion of neighbourhoods of 6 Å, and the mean distances both ways, Å (see
    /// [`MatchOptions::unit`]), of the way that was solved.
    pub score: f64,
    /// What that means.
    pub verdict: Verdict,
    /// Was the second shape fitted to the first, and the result turned round?
    pub turned: bool,
    /// Is one shape rather the mirror image of the other? The mirror image of the first was fitted shortly, too, and came
    /// clearly nearer. Not looked for from a given start.
    pub mirrored: bool,
    /// Modes of both shapes as one graph.
    pub modes: JointModes,
    /// The maps that were tried, the best first.
    pub candidates: Vec<CandidateReport>,
}

/// Which point became which.
///
/// Both shapes must have about the same spacing, Å. Their position and orientation do not matter, nor the order of their
/// nodes; a mirror image is not matched.
///
/// ```
/// use spectral_corresp::geom_core::{Cpu, Lattice, Point3, Run};
/// use spectral_corresp::{MatchOptions, ShapeOptions, Start, VoxelShape, correspond};
/// // An L of voxels, and the same turned by a quarter about z.
/// let flags = |turned: bool| -> Vec<bool> {
///     let inside = |i: usize, j: usize| (i < 5 || j < 5) && i < 13 && j < 20;
///     let at = |p: usize| [p % 20, p / 20 % 20];
///     (0..20 * 20 * 5).map(at).map(|[i, j]| if turned { inside(j, 19 - i) } else { inside(i, j) }).collect()
/// };
/// let lattice = Lattice { origin: Point3::origin(), spacing: 1.5, counts: [20, 20, 5] };
/// let options = ShapeOptions::default();
/// let a = VoxelShape::of_flags(&lattice, flags(false), &options, Run::on(&Cpu))?;
/// let b = VoxelShape::of_flags(&lattice, flags(true), &options, Run::on(&Cpu))?;
/// let asked = MatchOptions { start: Start::Rigid, ..MatchOptions::default() };
/// let found = correspond(&a, &b, &asked, Run::on(&Cpu))?;
/// // The far end of the long arm is found again.
/// let ends = a.boundary_points().iter().zip(&found.forward).filter(|(p, _)| p.y > 27.0);
/// let right = ends.clone().filter(|&(_, &q)| b.boundary_points()[q as usize].x < 6.0).count();
/// assert!(right * 10 > ends.count() * 9);
/// # Ok::<(), spectral_corresp::Error>(())
/// ```
pub fn correspond<B: CorrespBackend + ?Sized>(
    a: &VoxelShape,
    b: &VoxelShape,
    options: &MatchOptions,
    run: Run<'_, B>,
) -> Result<Correspondence, Error> {
    correspond_on(a, b, options, run.with(run.backend.as_corresp()))
}

/// A start that the caller gives is refined as it is, one way: no other map and no mirror image is looked for.
fn correspond_on(
    a: &VoxelShape,
    b: &VoxelShape,
    options: &MatchOptions,
    run: On<'_>,
) -> Result<Correspondence, Error> {
    options.check()?;
    check_spacings(a, b)?;
    check_memory(a, b, options)?;
    let (front, back) = boundaries(a, b, options, run)?;
    let given = given(a, b, &front, options)?;
    if let Some((name, images)) = given.images {
        let fit = refine(&front, &back, images, &given.anchors, options, run)?;
        let (fit, torn) = mended(&front, &back, fit, &given.anchors, options, run)?;
        let fitted = fit.score;
        let report = CandidateReport {
            name,
            backward: false,
            start: 0.0,
            fitted,
            apart: 0.0,
        };
        let anchored: Vec<u32> = given.anchors.iter().map(|a| a.0).collect();
        let found = Found {
            fit,
            score: fitted,
            turned: false,
            ambiguous: torn,
            mirrored: false,
            candidates: vec![report],
        };
        return finish(a, b, found, &anchored, options, run);
    }
    // One way, and the other where both are wanted.
    let sides = [(&front, &back), (&back, &front)];
    let mut searches = vec![search(&front, &back, options, run)?];
    let fits = options.refine == Refine::Annealed;
    if options.directions == Directions::Both && fits {
        searches.push(search(&back, &front, options, run)?);
    }
    let mut mirror = None;
    if fits {
        let best = usize::from(searches.len() > 1 && searches[1].least() < searches[0].least());
        let (from, to) = sides[best];
        let more = rivals::composed(&searches[best].tried[0], to, options, run)?;
        let more = tried(from, to, more, options, run)?;
        let known = std::mem::take(&mut searches[best].tried);
        searches[best] = Search::of(known.into_iter().chain(more).collect());
        mirror = Some(rivals::of_mirror_image(from, to, options, run)?);
    }
    // The best of both are fitted whole, since a short fit does not always tell.
    let all = searches.iter().enumerate();
    let mut ranked: Vec<(bool, &Tried)> = all
        .flat_map(|(way, s)| s.tried.iter().map(move |t| (way == 1, t)))
        .collect();
    ranked.sort_by(|a, b| a.1.score.total_cmp(&b.1.score));
    let least = ranked[0].1.score;
    let ambiguous = searches.iter().any(|s| s.is_ambiguous(least));
    let mirrored = mirror.is_some_and(|mirror| mirror < rivals::MIRRORED * least);
    // Not to be passed by, whatever it is: a score may be no number.
    let near_best = |rank: usize, t: &Tried| rank == 0 || t.score <= NEAR_BEST * least;
    let mut fitted: Vec<(bool, Fit)> = Vec::new();
    for (rank, &(backward, tried)) in ranked.iter().take(FITTED).enumerate() {
        if !near_best(rank, tried) {
            continue;
        }
        let (from, to) = sides[usize::from(backward)];
        fitted.push((backward, fit_whole(from, to, tried, options, run)?));
    }
    // The first of them is always there, and remains where scores are no numbers.
    let mut least = 0;
    for (k, (_, fit)) in fitted.iter().enumerate() {
        if fit.score < fitted[least].1.score {
            least = k;
        }
    }
    let rivalled = rivalled(&fitted, least, &back.side);
    let (turned, best) = fitted.swap_remove(least);
    let (from, to) = sides[usize::from(turned)];
    let (best, torn) = mended(from, to, best, &[], options, run)?;
    let ambiguous = ambiguous || rivalled || torn || mirrored;
    let candidates = ranked.iter().map(|&(backward, t)| CandidateReport {
        name: t.name.clone(),
        backward,
        start: t.start,
        fitted: t.score,
        apart: t.apart,
    });
    let candidates = candidates.collect();
    let score = best.score;
    let fit = if turned {
        turn_round(&front.side, &back.side, &best, options.seed, run)?
    } else {
        best
    };
    let found = Found {
        fit,
        score,
        turned,
        ambiguous,
        mirrored,
        candidates,
    };
    finish(a, b, found, &[], options, run)
}

/// Does another of the maps, fitted whole, score nearly as well as the best and take a good share of the nodes elsewhere?
fn rivalled(fitted: &[(bool, Fit)], best: usize, b: &Side) -> bool {
    // From the first shape to the second, whichever way was solved.
    let partners = |(turned, fit): &(bool, Fit)| match turned {
        false => fit.forward.clone(),
        true => fit.backward.clone(),
    };
    let (ours, score) = (partners(&fitted[best]), fitted[best].1.score);
    fitted.iter().enumerate().any(|(k, other)| {
        let near = k != best && other.1.score < AMBIGUOUS.0 * score + AMBIGUOUS.1;
        near && {
            let theirs = partners(other);
            let pairs = ours.iter().zip(&theirs);
            let apart = pairs.filter(|(m, n)| {
                let [p, q] = [m, n].map(|n| b.points[n.index as usize]);
                (p - q).norm() > ANOTHER
            });
            apart.count() as f64 > ELSEWHERE * ours.len() as f64
        }
    })
}

/// A map that tears a piece off is tried again with the piece hung back on, while that makes it better. Does it still
/// tear?
fn mended(
    a: &Boundary<'_>,
    b: &Boundary<'_>,
    mut fit: Fit,
    anchors: &[(u32, Point3)],
    options: &MatchOptions,
    run: On<'_>,
) -> Result<(Fit, bool), Error> {
    let spacing = a.shape.lattice().spacing / options.unit;
    for attempt in 0.. {
        let (pieces, torn) = pieces(a, b, &fit, spacing)?;
        // A map that fails anyway is not worth it, and the thesis's is left as it is.
        let over = attempt == MENDED || fit.score > options.verdict[1];
        if !torn || over || pieces.loose() == 0.0 || options.refine != Refine::Annealed {
            return Ok((fit, torn));
        }
        let images = pieces.hung_back(&a.side, &fit.images, spacing);
        let again = refine(a, b, images, anchors, options, run)?;
        if again.score >= fit.score {
            return Ok((fit, torn));
        }
        fit = again;
    }
    unreachable!("the last attempt returns")
}

/// The pieces of the first boundary under a fit, and whether either boundary is torn.
fn pieces(
    a: &Boundary<'_>,
    b: &Boundary<'_>,
    fit: &Fit,
    spacing: f64,
) -> Result<(Pieces, bool), Error> {
    // Partners, not images: those are drawn out smoothly where their partners are torn.
    let met = |partners: &[Nearest], other: &Side| -> Vec<Point3> {
        let place = |n: &Nearest| other.points[n.index as usize];
        partners.iter().map(place).collect()
    };
    let there = Pieces::of(&a.side, &met(&fit.forward, &b.side), spacing)?;
    let back = Pieces::of(&b.side, &met(&fit.backward, &a.side), spacing)?;
    let torn = there.loose().max(back.loose()) > TORN;
    Ok((there, torn))
}

/// What the search ends with.
struct Found {
    fit: Fit,
    /// J of the way that was solved.
    score: f64,
    turned: bool,
    /// Does another map score as well, or is there another reason for doubt?
    ambiguous: bool,
    /// Does the mirror image fit better?
    mirrored: bool,
    candidates: Vec<CandidateReport>,
}

/// The correspondence of a fit; `anchored` nodes were given.
fn finish(
    a: &VoxelShape,
    b: &VoxelShape,
    found: Found,
    anchored: &[u32],
    options: &MatchOptions,
    run: On<'_>,
) -> Result<Correspondence, Error> {
    let Found { fit, score, .. } = found;
    let forward = Map::new(a, b, indices(&fit.forward))?;
    let backward = Map::new(b, a, indices(&fit.backward))?;
    run.progress("joint modes", 0, 1)?;
    let modes = joint_modes(a, b, &forward, &backward, anchored, options, run)?;
    let mut hit = vec![false; b.boundary().len()];
    forward.iter().for_each(|&j| hit[j as usize] = true);
    let [good, failed] = options.verdict;
    let verdict = match score {
        s if s < good && !found.ambiguous => Verdict::Good,
        s if s <= failed => Verdict::Doubtful,
        _ => Verdict::Failed,
    };
    let scaled = |p: &Point3| Point3::from(p.coords * options.unit);
    Ok(Correspondence {
        images: fit.images.iter().map(scaled).collect(),
        distances: fit
            .forward
            .iter()
            .map(|n| n.distance * options.unit)
            .collect(),
        coverage: hit.iter().filter(|h| **h).count() as f64 / hit.len() as f64,
        rotations: fit.rotations,
        forward,
        backward,
        score,
        verdict,
        turned: found.turned,
        mirrored: found.mirrored,
        modes,
        candidates: found.candidates,
    })
}

/// About how many bytes [`correspond()`] takes beside the shapes: for the modes of both as one graph 1,600 per node, and
/// 2,500 per boundary node for neighbourhoods and fits. (Measured: 217 MB for two shapes of 50,000 nodes.)
pub fn expected_bytes(a: &VoxelShape, b: &VoxelShape) -> u64 {
    let of = |s: &VoxelShape| 1600 * s.nodes() as u64 + 2500 * s.boundary().len() as u64;
    of(a) + of(b)
}

/// Refuses what would take more than the caller allows, before any of it is taken.
fn check_memory(a: &VoxelShape, b: &VoxelShape, options: &MatchOptions) -> Result<(), Error> {
    let (bytes, limit) = (expected_bytes(a, b), options.max_memory);
    if bytes > limit {
        let nodes = a.nodes() + b.nodes();
        return Err(Error::Memory {
            nodes,
            bytes,
            limit,
        });
    }
    Ok(())
}

/// Refuses spacings that differ by more than 1 %.
fn check_spacings(a: &VoxelShape, b: &VoxelShape) -> Result<(), Error> {
    let (a, b) = (a.lattice().spacing, b.lattice().spacing);
    if (a - b).abs() > SPACINGS * a.max(b) {
        return Err(Error::SpacingMismatch { a, b });
    }
    Ok(())
}

/// What the search needs to know of both shapes.
fn boundaries<'a>(
    a: &'a VoxelShape,
    b: &'a VoxelShape,
    options: &MatchOptions,
    run: On<'_>,
) -> Result<(Boundary<'a>, Boundary<'a>), Error> {
    // In the search's unit, and bars over the range of both: else equal parts would fall into different ones.
    let diameters =
        |s: &VoxelShape| -> Vec<f64> { s.diameters().iter().map(|d| d / options.unit).collect() };
    let both = [diameters(a), diameters(b)];
    let all = || both.iter().flatten().copied();
    let range = [
        all().fold(f64::INFINITY, f64::min),
        all().fold(0.0, f64::max),
    ];
    // A neighbourhood of nobody has no histogram.
    let spacing = a.lattice().spacing / options.unit;
    let radius = options.histograms.radius;
    let must = "be larger than the spacing";
    require(radius > spacing, "histograms.radius", radius, must)?;
    let of = |shape: &'a VoxelShape, diameters: &[f64]| -> Result<Boundary<'a>, Error> {
        run.progress("shapes", 0, 2)?;
        let points = shape.boundary_points().iter();
        let side = Side {
            points: points
                .map(|p| Point3::from(p.coords / options.unit))
                .collect(),
            normals: shape.normals().to_vec(),
        };
        // Only what the start will ask for.
        let (histogram, modal) = match options.start {
            Start::Thesis | Start::Auto => (true, true),
            Start::Spectral => (false, true),
            Start::Rigid | Start::Anchors(_) | Start::Given(_) => (false, false),
        };
        let histograms = if histogram {
            start::histograms(
                shape,
                diameters,
                range,
                options.unit,
                &options.histograms,
                run,
            )?
        } else {
            Vec::new()
        };
        // Maps are of boundary nodes; modes see the whole shape.
        let (mut modes, mut values) = (Vec::new(), Vec::new());
        if modal {
            let found = shape.modes_on(options.modes, run)?;
            modes = found.vectors.iter().map(|m| shape.on_boundary(m)).collect();
            values = found.values;
        }
        Ok(Boundary {
            shape,
            spread: start::spread(&side.points, THINNED),
            side,
            histograms,
            modes,
            values,
        })
    };
    Ok((of(a, &both[0])?, of(b, &both[1])?))
}

/// What the caller knows of the map.
#[derive(Default)]
struct Given {
    /// Images of all nodes.
    images: Option<(String, Vec<Point3>)>,
    /// Nodes with places of their own.
    anchors: Vec<(u32, Point3)>,
}

/// Anchors lead all nodes by the rigid motion of the anchors; a given map leads each to its partner. Nothing for other
/// starts.
fn given(
    a: &VoxelShape,
    b: &VoxelShape,
    front: &Boundary<'_>,
    options: &MatchOptions,
) -> Result<Given, Error> {
    match &options.start {
        Start::Anchors(anchors) => {
            let (motion, anchors) = start::anchored(&front.side, anchors, options)?;
            let images = front.side.points.iter().map(|p| motion.of(p)).collect();
            Ok(Given {
                images: Some(("anchors".to_owned(), images)),
                anchors,
            })
        }
        Start::Given(map) => {
            let (found, expected) = (map.len(), a.boundary().len());
            if found != expected {
                return Err(Error::Length {
                    what: "partners in the given map",
                    found,
                    expected,
                });
            }
            let points = b.boundary_points();
            let image = |(node, &image): (usize, &u32)| match points.get(image as usize) {
                Some(p) => Ok(Point3::from(p.coords / options.unit)),
                None => Err(Error::Image {
                    node,
                    image: image as usize,
                    count: points.len(),
                }),
            };
            let images = map
                .iter()
                .enumerate()
                .map(image)
                .collect::<Result<_, _>>()?;
            Ok(Given {
                images: Some(("given".to_owned(), images)),
                anchors: Vec::new(),
            })
        }
        _ => Ok(Given::default()),
    }
}

/// The maps that were tried one way, the best first.
struct Search {
    tried: Vec<Tried>,
}

/// A map of the spread nodes after a short fit.
struct Tried {
    name: String,
    /// The score of the candidate.
    start: f64,
    /// J after the fit.
    score: f64,
    images: Vec<Point3>,
    /// Of the neighbourhoods.
    rotations: Vec<Matrix3<f64>>,
    /// How far the images are from those of the best.
    apart: f64,
}

impl Correspondence {
    /// Which boundary nodes of the first shape have no counterpart: those that are farther than `beyond` from their
    /// partners (see [`distances`](Self::distances)), as where a loop or a chain is missing in the second shape. 4 Å is a
    /// good limit for proteins.
    /// In the shapes' own unit, as the distances are.
    pub fn unmatched(&self, beyond: f64) -> Vec<bool> {
        self.distances.iter().map(|d| *d > beyond).collect()
    }

    /// Where each boundary node of the first shape goes on the second, not on its lattice: its image, but at most a spacing
    /// from its partner, where the second shape has no such part.
    pub fn places(&self, b: &VoxelShape) -> Vec<Point3> {
        let spacing = b.lattice().spacing;
        let place = |(x, &j): (&Point3, &u32)| {
            let partner = b.boundary_points()[j as usize];
            let offset = x - partner;
            // What was rounded off says nothing.
            if offset.norm() <= 1e-9 * spacing {
                return partner;
            }
            partner + offset * (spacing / offset.norm().max(spacing))
        };
        self.images.iter().zip(&self.forward).map(place).collect()
    }
}

impl Search {
    fn of(mut tried: Vec<Tried>) -> Self {
        tried.sort_by(|a, b| a.score.total_cmp(&b.score));
        if let Some(best) = tried.first().map(|t| t.images.clone()) {
            for one in &mut tried {
                one.apart = distance(&one.images, &best);
            }
        }
        Self { tried }
    }

    /// The least score.
    fn least(&self) -> f64 {
        self.tried.first().map_or(f64::INFINITY, |t| t.score)
    }

    /// Does quite another map than the best one of this way score as well as `least`, the best of both?
    fn is_ambiguous(&self, least: f64) -> bool {
        let most = AMBIGUOUS.0 * least + AMBIGUOUS.1;
        self.tried
            .iter()
            .any(|t| t.apart > ANOTHER && t.score < most)
    }
}

/// Tries the candidates of one way.
fn search(
    a: &Boundary<'_>,
    b: &Boundary<'_>,
    options: &MatchOptions,
    run: On<'_>,
) -> Result<Search, Error> {
    let candidates = candidates(a, b, options, run)?;
    Ok(Search::of(tried(a, b, candidates, options, run)?))
}

/// Candidates after a short fit.
fn tried(
    a: &Boundary<'_>,
    b: &Boundary<'_>,
    candidates: Vec<Candidate>,
    options: &MatchOptions,
    run: On<'_>,
) -> Result<Vec<Tried>, Error> {
    let (from, to) = (a.thinned(), b.thinned());
    // The thesis does not fit; its candidates are told apart by J as they are.
    let stages = match options.refine {
        Refine::Annealed => SHORT,
        _ => fit::JUDGE,
    };
    let schedule = Schedule::of(&from, stages, options.seed)?;
    let total = candidates.len() as u64;
    let mut out = Vec::with_capacity(candidates.len());
    for (done, candidate) in candidates.into_iter().enumerate() {
        run.progress("candidates", done as u64, total)?;
        let fit = anneal(&from, &to, candidate.images, &[], &schedule, run)?;
        out.push(Tried {
            name: candidate.name,
            start: candidate.score,
            score: fit.score,
            images: fit.images,
            rotations: fit.rotations,
            apart: 0.0,
        });
    }
    Ok(out)
}

/// All nodes follow those that were tried, and are fitted.
fn fit_whole(
    a: &Boundary<'_>,
    b: &Boundary<'_>,
    tried: &Tried,
    options: &MatchOptions,
    run: On<'_>,
) -> Result<Fit, Error> {
    let rest = a.thinned().points;
    let embedding = Embedding::new(&rest, &tried.images, &tried.rotations)?;
    let images = embedding.of(&a.side.points);
    refine(a, b, images, &[], options, run)
}

/// The maps to be tried.
fn candidates(
    a: &Boundary<'_>,
    b: &Boundary<'_>,
    options: &MatchOptions,
    run: On<'_>,
) -> Result<Vec<Candidate>, Error> {
    let judge = Judge::of(a, options.seed)?;
    let start = &options.start;
    let mut of_features = Vec::new();
    if matches!(start, Start::Thesis | Start::Auto) {
        let found = start::of_histograms(a, b, &options.histograms, &judge, run)?;
        of_features.extend(found);
    }
    if matches!(start, Start::Spectral | Start::Auto) {
        of_features.extend(start::of_modes(a, b, &judge, run)?);
    }
    let mut out = best_apart(of_features);
    if matches!(start, Start::Rigid | Start::Auto) {
        run.progress("motions", 0, 1)?;
        out.extend(best_apart(start::of_motions(a, b, options.seed)));
    }
    Ok(out)
}

/// The last fit, on all nodes; on the spread ones first where there are too many.
fn refine(
    a: &Boundary<'_>,
    b: &Boundary<'_>,
    images: Vec<Point3>,
    anchors: &[(u32, Point3)],
    options: &MatchOptions,
    run: On<'_>,
) -> Result<Fit, Error> {
    let seed = options.seed;
    let of_all = |stages| Schedule::of(&a.side, stages, seed);
    run.progress("fit", 0, 1)?;
    match options.refine {
        Refine::None => anneal(&a.side, &b.side, images, anchors, &of_all(fit::JUDGE)?, run),
        Refine::Thesis { tolerance, most } => {
            let images = thesis_links(a, b, images, options, run)?;
            let images = descend(
                &a.side,
                &b.side,
                images,
                THESIS_RADIUS,
                tolerance,
                most,
                seed,
                run,
            )?;
            anneal(&a.side, &b.side, images, anchors, &of_all(fit::JUDGE)?, run)
        }
        Refine::Annealed
            if a.side.points.len().max(b.side.points.len()) > options.control_nodes =>
        {
            let mut few = start::spread(&a.side.points, options.control_nodes);
            let anchored = anchors.iter().map(|(node, _)| *node);
            let missing: Vec<u32> = anchored.filter(|n| !few.contains(n)).collect();
            few.extend(missing);
            let others = start::spread(&b.side.points, options.control_nodes);
            let (from, to) = (a.side.some(&few), b.side.some(&others));
            let placed = few.iter().map(|&n| images[n as usize]).collect();
            let on_few = anchors.iter().filter_map(|&(node, place)| {
                let at = few.iter().position(|&f| f == node)?;
                Some((at as u32, place))
            });
            let on_few: Vec<(u32, Point3)> = on_few.collect();
            let fit = anneal(
                &from,
                &to,
                placed,
                &on_few,
                &Schedule::of(&from, LONG, seed)?,
                run,
            )?;
            let embedding = Embedding::new(&from.points, &fit.images, &fit.rotations)?;
            let images = embedding.of(&a.side.points);
            anneal(&a.side, &b.side, images, anchors, &of_all(fit::LAST)?, run)
        }
        Refine::Annealed => anneal(&a.side, &b.side, images, anchors, &of_all(LONG)?, run),
    }
}

/// The thesis's first step: joint modes from links between the images and their nearest nodes; each node goes to the one
/// with the nearest row of them.
fn thesis_links(
    a: &Boundary<'_>,
    b: &Boundary<'_>,
    images: Vec<Point3>,
    options: &MatchOptions,
    run: On<'_>,
) -> Result<Vec<Point3>, Error> {
    let schedule = Schedule::of(&a.side, fit::JUDGE, options.seed)?;
    let fit = anneal(&a.side, &b.side, images, &[], &schedule, run)?;
    let forward = Map::new(a.shape, b.shape, indices(&fit.forward))?;
    let backward = Map::new(b.shape, a.shape, indices(&fit.backward))?;
    let modes = joint_modes(a.shape, b.shape, &forward, &backward, &[], options, run)?;
    let rows = |shape: &VoxelShape, modes: &[Vec<f64>]| -> Vec<f64> {
        let row = |&n: &u32| modes.iter().map(move |m| m[n as usize]);
        shape.boundary().iter().flat_map(row).collect()
    };
    let (queries, targets) = (rows(a.shape, &modes.first), rows(b.shape, &modes.second));
    let width = modes.values.len();
    let rows = |values| Rows { values, width };
    let mut found = Vec::new();
    run.nearest(rows(&queries), rows(&targets), &mut found)?;
    Ok(found
        .iter()
        .map(|n| b.side.points[n.index as usize])
        .collect())
}

/// Which rows these are.
fn indices(near: &[Nearest]) -> Vec<u32> {
    near.iter().map(|n| n.index).collect()
}

/// A fit from `b` to `a` as one from `a` to `b`.
fn turn_round(a: &Side, b: &Side, fit: &Fit, seed: u64, run: On<'_>) -> Result<Fit, Error> {
    // The image of a node of `a` goes with the node of `b` whose image it met.
    let image = |(p, n): (&Point3, &Nearest)| {
        let j = n.index as usize;
        let offset: Vector3 = p - fit.images[j];
        b.points[j] + fit.rotations[j].transpose() * offset
    };
    let images: Vec<Point3> = a.points.iter().zip(&fit.backward).map(image).collect();
    anneal(a, b, images, &[], &Schedule::of(a, fit::JUDGE, seed)?, run)
}
