//! Smoothing: every vertex moves to where the worst tetrahedron around it is best.

use geom_core::mesh::FACES;
use geom_core::{Point3, Run, Vector3};
use rayon::prelude::*;

use crate::Error;
use crate::backend::{QualityBackend, Relaxation};
use crate::boundary::field::{Isosurface, Tangent};
use crate::mesh::editable::{Freedom, NO_COLOUR, Work};
use crate::smoothing::search::{Compass, search_within};
use crate::smoothing::star::{GAIN, Ring};

/// Rounds of the search for a surface vertex.
const SURFACE_ROUNDS: u32 = 5;
/// How far a surface vertex goes at once, in mean edge lengths: the tangent plane holds only near by.
const REACH: f64 = 0.5;
/// Longest step back to the isosurface, in mean edge lengths.
const PULL: f64 = 0.15;
/// Most steps to the foot point.
const FOOT_STEPS: usize = 6;

/// The given vertices by colour: no two of a class share a tetrahedron.
fn classes(work: &Work, vertices: impl Iterator<Item = u32>) -> Vec<Vec<u32>> {
    let mut classes: Vec<Vec<u32>> = Vec::new();
    for v in vertices {
        let c = work.colours[v as usize];
        if c == NO_COLOUR {
            continue;
        }
        let c = usize::from(c);
        if classes.len() <= c {
            classes.resize(c + 1, Vec::new());
        }
        classes[c].push(v);
    }
    classes.retain(|c| !c.is_empty());
    classes
}

/// The corners of some tetrahedra, sorted.
pub(crate) fn corners_of(work: &Work, tets: &[u32]) -> Vec<u32> {
    let mut out: Vec<u32> = tets.iter().flat_map(|&t| work.tets[t as usize]).collect();
    out.par_sort_unstable();
    out.dedup();
    out
}

/// Two unit vectors across a unit vector and each other; coordinate axes for a coordinate axis.
pub(crate) fn across(n: &Vector3) -> [Vector3; 2] {
    let least = n.iamin();
    let u = Vector3::ith(least, 1.0);
    let u = (u - n * n.dot(&u)).normalize();
    [u, n.cross(&u)]
}

/// The directions in which a vertex may move without a field, if any; `turn` rotates those of a free
/// vertex at random.
pub(crate) fn axes_of(freedom: Freedom, turn: Option<u64>) -> Option<[Vector3; 3]> {
    let zero = Vector3::zeros();
    match freedom {
        Freedom::Free => Some(match turn {
            None => [Vector3::x(), Vector3::y(), Vector3::z()],
            Some(seed) => random_axes(seed),
        }),
        Freedom::Plane(n) => {
            let [u, v] = across(&n);
            Some([u, v, zero])
        }
        Freedom::Line(d) => Some([d, zero, zero]),
        Freedom::Field | Freedom::Fixed => None,
    }
}

/// Three orthogonal directions that depend on the seed only.
fn random_axes(seed: u64) -> [Vector3; 3] {
    let mut state = seed;
    let mut number = || {
        // SplitMix64.
        state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = state;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    };
    // A point in the unit ball, not too near its middle; some try succeeds.
    let axis = (0..64)
        .map(|_| Vector3::new(number(), number(), number()))
        .find(|d| (0.01..=1.0).contains(&d.norm_squared()))
        .map_or_else(Vector3::z, |d| d.normalize());
    let [u, v] = across(&axis);
    [u, v, axis]
}

/// The task of one sweep over those of `vertices` that may move without a field.
pub(crate) fn task<'a>(
    work: &Work,
    positions: &'a [Point3],
    vertices: &[u32],
    rounds: u32,
    turn: Option<u64>,
) -> Relaxation<'a> {
    let movable = vertices
        .iter()
        .copied()
        .filter(|&v| axes_of(work.freedom[v as usize], None).is_some());
    let classes = classes(work, movable);
    let vertices: Vec<u32> = classes.concat();
    let mut colours = Vec::with_capacity(classes.len());
    let mut start = 0;
    for class in &classes {
        colours.push(start..start + class.len());
        start += class.len();
    }
    let counts: Vec<u32> = vertices
        .iter()
        .map(|&v| work.rings.of(v).len() as u32)
        .collect();
    let starts: Vec<u32> = geom_core::parallel::starts_of(&counts)
        .into_iter()
        .map(|s| s as u32)
        .collect();
    let faces: Vec<[u32; 3]> = vertices
        .par_iter()
        .flat_map_iter(|&v| {
            let ring = work.rings.of(v).iter();
            ring.map(move |&t| opposite(work, t, v))
        })
        .collect();
    Relaxation {
        positions,
        axes: vertices
            .iter()
            .map(|&v| {
                let turn = turn.map(|seed| seed ^ u64::from(v).wrapping_mul(0xd6e8_feb8_6659_fd93));
                axes_of(work.freedom[v as usize], turn).expect("only movable ones are here")
            })
            .collect(),
        vertices,
        colours,
        starts,
        faces,
        rounds,
    }
}

/// Moves vertices by one sweep of [`QualityBackend::relax`]; each displacement is tried in full, in
/// half and in a quarter, and dropped if the worst tetrahedron does not get better. Gives how many
/// moved.
pub(crate) fn relax<B: QualityBackend + ?Sized>(
    work: &mut Work,
    vertices: &[u32],
    rounds: u32,
    turn: Option<u64>,
    run: Run<'_, B>,
) -> Result<usize, Error> {
    let task = task(work, &work.x, vertices, rounds, turn);
    let moves = run.backend.relax(&task)?;
    let Relaxation {
        vertices,
        colours,
        starts,
        faces,
        ..
    } = task;
    let mut moved = Vec::new();
    for colour in colours {
        let accepted: Vec<Option<Point3>> = colour
            .clone()
            .into_par_iter()
            .with_min_len(64)
            .map_init(Ring::default, |ring, i| {
                let d = moves[i];
                if d == Vector3::zeros() {
                    return None;
                }
                ring.load(&work.x, &faces[starts[i] as usize..starts[i + 1] as usize]);
                let x = work.x[vertices[i] as usize].coords;
                let best = ring.value(&x);
                [1.0, 0.5, 0.25].into_iter().find_map(|share| {
                    let candidate = x + d * share;
                    ring.value_above(&candidate, best + GAIN)
                        .map(|_| Point3::from(candidate))
                })
            })
            .collect();
        for (i, x) in colour.zip(accepted) {
            if x.is_some_and(|x| work.place(vertices[i], x)) {
                moved.push(vertices[i]);
            }
        }
    }
    work.refresh(&moved);
    Ok(moved.len())
}

/// The face of `t` opposite its corner `v`, counter-clockwise from outside.
pub(crate) fn opposite(work: &Work, t: u32, v: u32) -> [u32; 3] {
    let tet = work.tets[t as usize];
    let k = tet.iter().position(|&u| u == v).expect("a corner");
    let [a, b, c] = FACES[k];
    [tet[a], tet[b], tet[c]]
}

pub(crate) fn load(work: &Work, v: u32, ring: &mut Ring) {
    ring.clear();
    for &t in work.rings.of(v) {
        let [a, b, c] = opposite(work, t, v);
        ring.push([work.x[a as usize], work.x[b as usize], work.x[c as usize]]);
    }
}

/// How surface vertices may move.
pub(crate) struct SurfaceRules<'a> {
    pub(crate) field: &'a Isosurface<'a>,
    /// Distance from the isosurface that is always allowed, Å.
    pub(crate) tolerance: f64,
    /// Search in all directions instead of the tangent plane.
    pub(crate) rescue: bool,
}

/// Moves surface vertices along the isosurface, colour by colour. Gives how many moved.
pub(crate) fn relax_surface(work: &mut Work, vertices: &[u32], rules: &SurfaceRules<'_>) -> usize {
    work.know_tangents(vertices, rules.field);
    let step = |work: &Work, v: u32, ring: &mut Ring| {
        load(work, v, ring);
        let start = work.tangent(v, rules.field);
        let may = |x: Point3| work.gap_bears_move(v, x);
        slide_from(start, surface_mean(work, v), ring, rules, may)
    };
    sweep(work, vertices, on_field, step, Work::put)
}

/// Moves surface vertices that are farther than `tolerance` toward the isosurface, as far as the
/// tetrahedra stay `good` or the worst of them does not get worse. Gives how many moved.
pub(crate) fn project(
    work: &mut Work,
    vertices: &[u32],
    field: &Isosurface<'_>,
    tolerance: f64,
    good: impl Fn([Point3; 4]) -> bool + Sync,
) -> usize {
    work.know_tangents(vertices, field);
    let step = |work: &Work, v: u32, ring: &mut Ring| {
        let start = work.tangent(v, field);
        if start.distance.abs() <= tolerance {
            return None;
        }
        load(work, v, ring);
        let x = start.at;
        let foot = foot(start, ring.mean_edge(&x.coords), field, tolerance)?.at;
        let floor = ring.value(&x.coords) - GAIN;
        [1.0, 0.7, 0.4, 0.2, 0.1].into_iter().find_map(|share| {
            let candidate = x + (foot - x) * share;
            let may =
                ring.all_good(&candidate.coords, floor, &good) && work.gap_bears_move(v, candidate);
            may.then_some(candidate)
        })
    };
    sweep(work, vertices, on_field, step, Work::place)
}

/// The point of the isosurface next to `start`, by short Newton steps; `None` if `start` is nearer
/// than `tolerance` or the steps lead nowhere.
pub(crate) fn foot(
    start: Tangent,
    edge: f64,
    field: &Isosurface<'_>,
    tolerance: f64,
) -> Option<Tangent> {
    if start.distance.abs() <= tolerance {
        return None;
    }
    let mut foot = start;
    for _ in 0..FOOT_STEPS {
        foot = field.tangent(&(foot.at - foot.normal * foot.within(PULL * edge)));
        if foot.distance.abs() <= 0.1 * tolerance {
            break;
        }
    }
    (foot.within(0.5 * edge).abs() < start.within(0.5 * edge).abs()).then_some(foot)
}

fn on_field(freedom: Freedom) -> bool {
    freedom == Freedom::Field
}

/// Moves those of `vertices` whose freedom is fit, colour by colour: `step` judges, `put` moves and
/// says whether it did.
/// Gives how many moved.
pub(crate) fn sweep<T: Send>(
    work: &mut Work,
    vertices: &[u32],
    fit: impl Fn(Freedom) -> bool,
    step: impl Fn(&Work, u32, &mut Ring) -> Option<T> + Sync,
    put: impl Fn(&mut Work, u32, T) -> bool,
) -> usize {
    let movable = vertices
        .iter()
        .copied()
        .filter(|&v| fit(work.freedom[v as usize]));
    let mut moved = Vec::new();
    for class in classes(work, movable) {
        let positions: Vec<Option<T>> = class
            .par_iter()
            .with_min_len(16)
            .map_init(Ring::default, |ring, &v| step(work, v, ring))
            .collect();
        for (v, x) in class.into_iter().zip(positions) {
            if x.is_some_and(|x| put(work, v, x)) {
                moved.push(v);
            }
        }
    }
    work.refresh(&moved);
    moved.len()
}

/// A better position for a surface vertex at `start`: near `mean`, or along the surface. The search
/// goes in the tangent plane, which needs no field; what it finds is pulled back to the isosurface,
/// and tried in full, in half and in a quarter, until it `may` go there.
pub(crate) fn slide_from(
    start: Tangent,
    mean: Option<Point3>,
    ring: &mut Ring,
    rules: &SurfaceRules<'_>,
    may: impl Fn(Point3) -> bool,
) -> Option<Tangent> {
    let field = rules.field;
    let (from, normal) = (start.at.coords, start.normal);
    let edge = ring.mean_edge(&from);
    let distance = start.within(0.5 * edge);
    let limit = rules.tolerance.max(distance.abs());
    let best = ring.value(&from);
    let [s, t] = if normal == Vector3::zeros() {
        [Vector3::x(), Vector3::y()]
    } else {
        across(&normal)
    };
    let up = if rules.rescue {
        normal
    } else {
        Vector3::zeros()
    };
    let reach = REACH * edge;
    // In the tangent plane the distance stays as it is, to first order.
    let within = |x: &Vector3| {
        let d = x - from;
        d.norm_squared() <= reach * reach
            && (!rules.rescue || (distance + normal.dot(&d)).abs() <= limit)
    };
    let mean = mean.map(|m| m.coords);
    let compass = Compass::along(&[s, t, up]);
    let found = search_within(ring, (from, best), mean, &compass, SURFACE_ROUNDS, within);
    if found == from {
        return None;
    }
    // At pinches, where the distance means little, a vertex that is far off may move freely.
    let most = PULL * edge;
    // Where the vertex must go back to the isosurface it goes all the way.
    let near = if rules.rescue {
        limit
    } else {
        0.25 * rules.tolerance
    };
    [1.0, 0.5, 0.25].into_iter().find_map(|share| {
        let candidate = from + (found - from) * share;
        ring.value_above(&candidate, best + GAIN)?;
        let mut tangent = field.tangent(&candidate.into());
        for _ in 0..2 {
            if tangent.within(most).abs() <= near {
                break;
            }
            let back = tangent.normal * tangent.within(most);
            ring.value_above(&(tangent.at.coords - back), best + GAIN)?;
            tangent = field.tangent(&(tangent.at - back));
        }
        let better = tangent.within(most).abs() <= limit
            && ring.value_above(&tangent.at.coords, best + GAIN).is_some()
            && may(tangent.at);
        better.then_some(tangent)
    })
}

/// The mean of the neighbours along the interface.
fn surface_mean(work: &Work, v: u32) -> Option<Point3> {
    let mut sum = Vector3::zeros();
    let mut count = 0;
    for &t in work.rings.of(v) {
        let tet = work.tets[t as usize];
        let region = work.regions[t as usize];
        // What moves freely lies inside a region.
        let inner = tet.map(|u| work.freedom[u as usize] == Freedom::Free);
        for k in 0..4 {
            if tet[k] == v || FACES[k].iter().any(|&i| inner[i]) {
                continue;
            }
            // Each interface face once: from its lower region, the boundary from inside.
            let other = work.region_beyond(t, k);
            if region < other {
                for u in FACES[k].map(|i| tet[i]).into_iter().filter(|&u| u != v) {
                    sum += work.x[u as usize].coords;
                    count += 1;
                }
            }
        }
    }
    (count > 0).then(|| Point3::from(sum / f64::from(count)))
}
