//! Smoothing: every vertex moves to where the worst tetrahedron around it is best.
//!
//! The mean of the neighbours (Laplace) is cheap and inverts tetrahedra where a neighbourhood is not convex. Here a place is
//! judged by the worst tetrahedron that it makes, `max_x min_t q_t(x)`. Each q is smooth in x but the minimum has creases, along which
//! gradients of single tetrahedra zigzag; a compass needs none. It looks in some directions at a step's length, goes where it is
//! best, and shortens its step where nothing is better. Vertices of one colour share no tetrahedron, so that all of them search
//! at the same time on the same mesh, and the result does not depend on who is first.
//!
//! Where a vertex may go is its kind: an inner one anywhere, one of a surface with a field in the tangent plane and back onto
//! the level set by Newton steps, one of a box in its face or along its edge, others not at all.

use geom_core::compute::BackendError;
use geom_core::compute::parallel;
use geom_core::compute::random::SplitMix64;
use geom_core::field::{self, Tangent};
use geom_core::mesh::FACES;
use geom_core::{Point3, Vector3};
use rayon::prelude::*;

use crate::backend::{On, Relaxation, Slide};
use crate::boundary::field::{Isosurface, distance_within};
use crate::boundary::guard::GuardedMesh;
use crate::error::Error;
use crate::mesh::editable::{EditableMesh, Freedom, GAIN, NO_COLOUR};
use crate::smoothing::search::{Compass, Start, search_within};
use crate::smoothing::star::Star;

/// Rounds of the search for a surface vertex.
const SURFACE_ROUNDS: u32 = 5;
/// How far a surface vertex goes at once, in mean edge lengths: the tangent plane holds only near by.
const REACH: f64 = 0.5;
/// Longest step back to the isosurface, in mean edge lengths.
const PULL: f64 = 0.15;
/// Most steps to the foot point.
const FOOT_STEPS: u32 = 6;

/// The given vertices by colour: no two of a class share a tetrahedron.
/// Colours are those that the mesh keeps up: nothing is coloured anew for a sweep. Vertices without a colour stay.
fn classes(mesh: &EditableMesh, vertices: impl Iterator<Item = u32>) -> Vec<Vec<u32>> {
    let mut classes: Vec<Vec<u32>> = Vec::new();
    for v in vertices {
        let c = mesh.colours[v as usize];
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
pub(crate) fn corners_of(mesh: &EditableMesh, tets: &[u32]) -> Vec<u32> {
    let mut out: Vec<u32> = tets.iter().flat_map(|&t| mesh.tets[t as usize]).collect();
    out.par_sort_unstable();
    out.dedup();
    out
}

/// Some vertices and all that share a tetrahedron with one of them, sorted.
pub(crate) fn neighbourhood_of(mesh: &EditableMesh, vertices: &[u32]) -> Vec<u32> {
    let around = vertices.iter().flat_map(|&v| mesh.incidence.of(v));
    corners_of(mesh, &around.copied().collect::<Vec<u32>>())
}

/// Two unit vectors across a unit vector and each other; coordinate axes for a coordinate axis.
/// The second is the cross product of `n` and the first: with `n` as the third they are right-handed.
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
        Freedom::Field | Freedom::Curve(_) | Freedom::Fixed | Freedom::Held => None,
    }
}

/// Three orthogonal directions that depend on the seed only.
/// The last one is spread evenly over the sphere; the other two follow from it.
fn random_axes(seed: u64) -> [Vector3; 3] {
    let mut random = SplitMix64::new(seed);
    let mut number = || random.symmetric();
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
    mesh: &EditableMesh,
    positions: &'a [Point3],
    vertices: &[u32],
    rounds: u32,
    turn: Option<u64>,
) -> Relaxation<'a> {
    let movable = vertices
        .iter()
        .copied()
        .filter(|&v| axes_of(mesh.freedom[v as usize], None).is_some());
    let axes = |v: u32| {
        let turn = turn.map(|seed| seed ^ u64::from(v).wrapping_mul(0xd6e8_feb8_6659_fd93));
        axes_of(mesh.freedom[v as usize], turn).expect("only movable ones are here")
    };
    task_of(mesh, positions, classes(mesh, movable), rounds, axes)
}

/// The task of one sweep over classes of vertices, along given axes.
/// Faces are gathered side by side; everything is in the order of `classes`, so that the same mesh gives the same task.
fn task_of<'a>(
    mesh: &EditableMesh,
    positions: &'a [Point3],
    classes: Vec<Vec<u32>>,
    rounds: u32,
    axes: impl Fn(u32) -> [Vector3; 3],
) -> Relaxation<'a> {
    let vertices: Vec<u32> = classes.concat();
    let mut colours = Vec::with_capacity(classes.len());
    let mut start = 0;
    for class in &classes {
        colours.push(start..start + class.len());
        start += class.len();
    }
    let counts: Vec<u32> = vertices
        .iter()
        .map(|&v| mesh.incidence.of(v).len() as u32)
        .collect();
    let starts: Vec<u32> = parallel::starts_of(&counts)
        .into_iter()
        .map(|s| s as u32)
        .collect();
    let faces: Vec<[u32; 3]> = parallel::flat_map(vertices.len(), |i| {
        let v = vertices[i];
        let star = mesh.incidence.of(v).iter();
        star.map(move |&t| opposite(mesh, t, v))
    });
    Relaxation {
        positions,
        axes: vertices.iter().map(|&v| axes(v)).collect(),
        vertices,
        colours,
        starts,
        faces,
        slide: None,
        rounds,
    }
}

/// Moves vertices by one sweep of [`QualityBackend::relax`]; each displacement is tried in full, in
/// half and in a quarter, and dropped if the worst tetrahedron does not get better. Gives how many
/// moved.
///
/// A backend's displacement is a guess that may be wrong, in f32 or by another vertex of the sweep that was refused.
/// Each is judged in f64 against the mesh as it is then, colour by colour, so that no backend can lower the worst one
/// around a vertex.
///
/// # Errors
///
/// Those of the backend, and another number of displacements than vertices.
pub(crate) fn relax(
    guarded: &mut GuardedMesh,
    vertices: &[u32],
    rounds: u32,
    turn: Option<u64>,
    run: On<'_>,
) -> Result<usize, Error> {
    let task = task(&guarded.mesh, &guarded.mesh.x, vertices, rounds, turn);
    let moves = proposals(&task, run)?;
    let Relaxation {
        vertices,
        colours,
        starts,
        faces,
        ..
    } = task;
    let mut moved = Vec::new();
    for colour in colours {
        let mesh = &guarded.mesh;
        let accepted: Vec<Option<Point3>> =
            parallel::map_init(colour.len(), Star::default, |star, of_colour| {
                let i = colour.start + of_colour;
                let d = moves[i]?;
                star.load(&mesh.x, &faces[starts[i] as usize..starts[i + 1] as usize]);
                let x = mesh.x[vertices[i] as usize].coords;
                let best = star.value(&x);
                [1.0, 0.5, 0.25].into_iter().find_map(|share| {
                    let candidate = x + d * share;
                    star.value_above(&candidate, best + GAIN)
                        .map(|_| Point3::from(candidate))
                })
            });
        for (i, x) in colour.zip(accepted) {
            if x.is_some_and(|x| guarded.move_vertex(vertices[i], x)) {
                moved.push(vertices[i]);
            }
        }
    }
    guarded.mesh.refresh(&moved);
    Ok(moved.len())
}

/// The displacements that the backend proposes; `None` for what stays, or what it cannot tell.
fn proposals(task: &Relaxation<'_>, run: On<'_>) -> Result<Vec<Option<Vector3>>, Error> {
    let mut moves = Vec::new();
    run.backend.relax(task, &mut moves)?;
    let (found, of) = (moves.len(), task.vertices.len());
    BackendError::unless(found == of, &run.backend.name(), || {
        format!("{found} displacements for {of} vertices")
    })?;
    let told = |d: &Vector3| *d != Vector3::zeros() && d.iter().all(|c| c.is_finite());
    Ok(moves.into_iter().map(|d| Some(d).filter(told)).collect())
}

/// The face of `t` opposite its corner `v`, counter-clockwise from outside.
pub(crate) fn opposite(mesh: &EditableMesh, t: u32, v: u32) -> [u32; 3] {
    let tet = mesh.tets[t as usize];
    let k = tet.iter().position(|&u| u == v).expect("a corner");
    let [a, b, c] = FACES[k];
    [tet[a], tet[b], tet[c]]
}

/// Puts the star of a vertex in place of what was in `star`, whose memory is used again.
pub(crate) fn load(mesh: &EditableMesh, v: u32, star: &mut Star) {
    star.clear();
    for &t in mesh.incidence.of(v) {
        let [a, b, c] = opposite(mesh, t, v);
        star.push([mesh.x[a as usize], mesh.x[b as usize], mesh.x[c as usize]]);
    }
}

/// How surface vertices may move.
/// In usual passes the distance is held small by the tangent plane and the pull back; in the rescue a vertex has a
/// shell of twice `tolerance` to itself.
#[derive(Clone, Copy)]
pub(crate) struct SurfaceRules<'a> {
    pub(crate) field: Isosurface<'a>,
    /// Distance from the isosurface that is always allowed, Å.
    pub(crate) tolerance: f64,
    /// Search in all directions instead of the tangent plane.
    pub(crate) rescue: bool,
}

impl SurfaceRules<'_> {
    /// The rules for a vertex of this freedom.
    pub(crate) fn of(&self, freedom: Freedom) -> Self {
        let field = freedom.part_of(&self.field);
        Self { field, ..*self }
    }

    /// The directions of a search: two in the tangent plane, or the one along a curve, for the rescue the normal too.
    fn axes(&self, normal: &Vector3) -> [Vector3; 3] {
        let [s, t] = match self.field.plane {
            Some(plane) => [plane.normal.cross(normal), Vector3::zeros()],
            None if *normal == Vector3::zeros() => [Vector3::x(), Vector3::y()],
            None => across(normal),
        };
        let up = if self.rescue {
            *normal
        } else {
            Vector3::zeros()
        };
        [s, t, up]
    }
}

/// Moves surface vertices along the isosurface, colour by colour. Gives how many moved.
///
/// Backends that say [`slides`](crate::QualityBackend::slides) get the searches of all colours at once; in the rescue,
/// where the search leaves the tangent plane, the CPU does all.
pub(crate) fn relax_surface(
    guarded: &mut GuardedMesh,
    vertices: &[u32],
    rules: &SurfaceRules<'_>,
    run: On<'_>,
) -> Result<usize, Error> {
    guarded.mesh.know_tangents(vertices, &rules.field)?;
    if run.backend.slides() && !rules.rescue {
        return slide_together(guarded, vertices, rules, run);
    }
    let step = |guarded: &GuardedMesh, v: u32, star: &mut Star| {
        let mesh = &guarded.mesh;
        load(mesh, v, star);
        let rules = rules.of(mesh.freedom[v as usize]);
        let start = mesh.tangent(v, &rules.field);
        let may = |x: Point3| guarded.guard.allows_move(mesh, v, x);
        slide_from(start, surface_mean(mesh, v), star, &rules, may)
    };
    let put = GuardedMesh::move_on_surface;
    Ok(sweep(guarded, vertices, Freedom::on_field, step, put))
}

/// The same with searches of all colours by the backend, in the tangent planes; then, colour by colour, what it found
/// is pulled back to the isosurface, and goes if it is better still.
/// The backend takes all that it proposes as done. What is refused here leaves the displacements of later colours to be
/// judged next to other neighbours than they were sought for, and some are lost.
fn slide_together(
    guarded: &mut GuardedMesh,
    vertices: &[u32],
    rules: &SurfaceRules<'_>,
    run: On<'_>,
) -> Result<usize, Error> {
    let mesh = &guarded.mesh;
    let movable = vertices.iter().copied();
    let movable = movable.filter(|&v| mesh.freedom[v as usize].on_field());
    let axes = |v: u32| {
        let rules = rules.of(mesh.freedom[v as usize]);
        rules.axes(&mesh.tangent(v, &rules.field).normal())
    };
    let classes = classes(mesh, movable);
    let mut task = task_of(mesh, &mesh.x, classes, SURFACE_ROUNDS, axes);
    let mean = |&v: &u32| surface_mean(mesh, v).map(|mean| mean - mesh.x[v as usize]);
    task.slide = Some(Slide {
        means: parallel::map_each(&task.vertices, mean),
        reach: REACH,
    });
    let moves = proposals(&task, run)?;
    let (vertices, colours) = (task.vertices, task.colours);
    let mut moved = Vec::new();
    for colour in colours {
        let state = &*guarded;
        let found: Vec<Option<Tangent>> =
            parallel::map_init(colour.len(), Star::default, |star, of_colour| {
                let i = colour.start + of_colour;
                let (mesh, v, d) = (&state.mesh, vertices[i], moves[i]?);
                load(mesh, v, star);
                let rules = rules.of(mesh.freedom[v as usize]);
                let start = mesh.tangent(v, &rules.field);
                let slide = Slope::at(start, star, &rules);
                let may = |x: Point3| state.guard.allows_move(mesh, v, x);
                slide.settle(start.at.coords + d, star, &rules, may)
            });
        for (i, tangent) in colour.zip(found) {
            if tangent.is_some_and(|x| guarded.move_on_surface(vertices[i], x)) {
                moved.push(vertices[i]);
            }
        }
    }
    guarded.mesh.refresh(&moved);
    Ok(moved.len())
}

/// Moves surface vertices that are farther than `tolerance` toward the isosurface, or their curve on it, as far as the
/// tetrahedra stay `good` or the worst of them does not get worse. Gives how many moved.
pub(crate) fn project(
    guarded: &mut GuardedMesh,
    vertices: &[u32],
    field: &Isosurface<'_>,
    tolerance: f64,
    good: impl Fn([Point3; 4]) -> bool + Sync,
) -> Result<usize, Error> {
    guarded.mesh.know_tangents(vertices, field)?;
    let step = |guarded: &GuardedMesh, v: u32, star: &mut Star| {
        let mesh = &guarded.mesh;
        let field = &mesh.freedom[v as usize].part_of(field);
        let start = mesh.tangent(v, field);
        if field.reached(&start, tolerance) {
            return None;
        }
        load(mesh, v, star);
        let x = start.at;
        let foot = foot(start, star.mean_edge(&x.coords), field, tolerance)?.at;
        let floor = star.value(&x.coords) - GAIN;
        [1.0, 0.7, 0.4, 0.2, 0.1].into_iter().find_map(|share| {
            let candidate = x + (foot - x) * share;
            let may = star.all_good(&candidate.coords, floor, &good)
                && guarded.guard.allows_move(mesh, v, candidate);
            may.then_some(candidate)
        })
    };
    let put = GuardedMesh::move_vertex;
    Ok(sweep(guarded, vertices, Freedom::on_field, step, put))
}

/// The point of the isosurface, or of a curve on it, next to `start`, by short Newton steps; `None` if `start` is nearer
/// than `tolerance` or the steps lead nowhere.
/// What is farther than half an edge counts as half an edge away: there a first-order distance says little.
pub(crate) fn foot(
    start: Tangent,
    edge: f64,
    surface: &Isosurface<'_>,
    tolerance: f64,
) -> Option<Tangent> {
    if surface.reached(&start, tolerance) {
        return None;
    }
    let astray = surface.plane.filter(|plane| !plane.holds(&start.at));
    let from = astray.map_or(start, |plane| surface.tangent(&plane.foot(&start.at)));
    let way = field::Guard {
        steps: FOOT_STEPS,
        halvings: 0,
        longest: PULL * edge,
        reach: f64::INFINITY,
        near: 0.1 * tolerance,
    };
    let foot = field::project(from, &way, |x| Some(surface.tangent(&x))).best;
    let off = |tangent: &Tangent| distance_within(tangent, 0.5 * edge).abs();
    if astray.is_some() {
        // Where the isosurface is not met near by, into the plane at least.
        return Some(if off(&foot) <= tolerance { foot } else { from });
    }
    (off(&foot) < off(&from)).then_some(foot)
}

/// Moves those of `vertices` whose freedom is fit, colour by colour: `step` judges, `put` moves and
/// says whether it did. Gives how many moved.
///
/// Within a colour all are judged on the same mesh, side by side; then they move one after the other, because the
/// guard's account of a cavity must see each move before the next.
pub(crate) fn sweep<T: Send>(
    guarded: &mut GuardedMesh,
    vertices: &[u32],
    fit: impl Fn(Freedom) -> bool,
    step: impl Fn(&GuardedMesh, u32, &mut Star) -> Option<T> + Sync,
    put: impl Fn(&mut GuardedMesh, u32, T) -> bool,
) -> usize {
    let mesh = &guarded.mesh;
    let movable = vertices
        .iter()
        .copied()
        .filter(|&v| fit(mesh.freedom[v as usize]));
    let mut moved = Vec::new();
    for class in classes(mesh, movable) {
        let state = &*guarded;
        let positions: Vec<Option<T>> =
            parallel::map_each_init(&class, Star::default, |star, &v| step(state, v, star));
        for (v, x) in class.into_iter().zip(positions) {
            if x.is_some_and(|x| put(guarded, v, x)) {
                moved.push(v);
            }
        }
    }
    guarded.mesh.refresh(&moved);
    moved.len()
}

/// A better position for a surface vertex at `start`: near `mean`, or along the surface. The search
/// goes in the tangent plane, which needs no field; what it finds is pulled back to the isosurface,
/// and tried in full, in half and in a quarter, until it `may` go there.
/// `None` if it stays.
pub(crate) fn slide_from(
    start: Tangent,
    mean: Option<Point3>,
    star: &mut Star,
    rules: &SurfaceRules<'_>,
    may: impl Fn(Point3) -> bool,
) -> Option<Tangent> {
    let slope = Slope::at(start, star, rules);
    let found = slope.search(mean, star, rules);
    (found != start.at.coords)
        .then(|| slope.settle(found, star, rules, may))
        .flatten()
}

/// A surface vertex before it slides.
struct Slope {
    from: Vector3,
    normal: Vector3,
    /// Mean edge length around it.
    edge: f64,
    /// From the isosurface, and how far it may be.
    distance: f64,
    limit: f64,
    /// How far the field is from its level.
    height: f64,
    /// The value of the worst tetrahedron.
    value: f64,
}

impl Slope {
    /// A vertex that is farther off than the rules allow may stay as far, but go no farther.
    fn at(start: Tangent, star: &mut Star, rules: &SurfaceRules<'_>) -> Self {
        let from = start.at.coords;
        let edge = star.mean_edge(&from);
        let distance = distance_within(&start, 0.5 * edge);
        Self {
            from,
            normal: start.normal(),
            edge,
            distance,
            limit: rules.tolerance.max(distance.abs()),
            height: start.height.abs(),
            value: star.value(&from),
        }
    }

    /// The best place in the tangent plane.
    fn search(&self, mean: Option<Point3>, star: &mut Star, rules: &SurfaceRules<'_>) -> Vector3 {
        let reach = REACH * self.edge;
        // In the tangent plane the distance stays as it is, to first order.
        let within = |x: &Vector3| {
            let d = x - self.from;
            let off = (self.distance + self.normal.dot(&d)).abs();
            d.norm_squared() <= reach * reach && (!rules.rescue || off <= self.limit)
        };
        let mean = mean.map(|m| m.coords);
        let compass = Compass::along(&rules.axes(&self.normal));
        let start = Start {
            at: self.from,
            value: self.value,
        };
        search_within(star, start, mean, &compass, SURFACE_ROUNDS, within)
    }

    /// A place pulled back to the isosurface, if the vertex may go there and it is better still.
    fn settle(
        &self,
        found: Vector3,
        star: &mut Star,
        rules: &SurfaceRules<'_>,
        may: impl Fn(Point3) -> bool,
    ) -> Option<Tangent> {
        let better = self.value + GAIN;
        // At pinches, where the distance means little, a vertex that is far off may move freely.
        let most = PULL * self.edge;
        // Where the vertex must go back to the isosurface it goes all the way.
        let near = if rules.rescue {
            self.limit
        } else {
            0.25 * rules.tolerance
        };
        [1.0, 0.5, 0.25].into_iter().find_map(|share| {
            let candidate = self.from + (found - self.from) * share;
            star.value_above(&candidate, better)?;
            let mut tangent = rules.field.tangent(&candidate.into());
            for _ in 0..2 {
                if distance_within(&tangent, most).abs() <= near {
                    break;
                }
                // What is worse already on the way back is not worth asking the field again.
                let back = tangent.normal() * distance_within(&tangent, most);
                star.value_above(&(tangent.at.coords - back), better)?;
                tangent = rules.field.tangent(&(tangent.at - back));
            }
            // Where a plane hardly meets the isosurface, distances within it mean nothing.
            let strays = rules.field.plane.is_some()
                && tangent.height.abs() > self.height
                && tangent.distance().abs() > rules.tolerance;
            let may = distance_within(&tangent, most).abs() <= self.limit
                && !strays
                && star.value_above(&tangent.at.coords, better).is_some()
                && may(tangent.at);
            may.then_some(tangent)
        })
    }
}

/// The mean of the neighbours along the interface.
/// Each neighbour counts once per triangle; `None` where the star has no interface face.
fn surface_mean(mesh: &EditableMesh, v: u32) -> Option<Point3> {
    let mut sum = Vector3::zeros();
    let mut count = 0;
    for &t in mesh.incidence.of(v) {
        let tet = mesh.tets[t as usize];
        let region = mesh.regions[t as usize];
        // What moves freely lies inside a region.
        let inner = tet.map(|u| mesh.freedom[u as usize] == Freedom::Free);
        for k in 0..4 {
            if tet[k] == v || FACES[k].iter().any(|&i| inner[i]) {
                continue;
            }
            // Each interface face once: from its lower region, the boundary from inside.
            let other = mesh.region_beyond(t, k);
            if region < other {
                for u in FACES[k].map(|i| tet[i]).into_iter().filter(|&u| u != v) {
                    sum += mesh.x[u as usize].coords;
                    count += 1;
                }
            }
        }
    }
    (count > 0).then(|| Point3::from(sum / f64::from(count)))
}
