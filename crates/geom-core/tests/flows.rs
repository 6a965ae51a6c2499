//! Corners of quads: their distortion on every backend, and where a flow takes them.

use std::f64::consts::TAU;
use std::ops::ControlFlow;

use geom_core::compute::BackendError;
use geom_core::compute::random::SplitMix64;
use geom_core::mesh::quality::{highest_jacobian, scaled_jacobian, upright_jacobian};
use geom_core::mesh::shapes;
use geom_core::nalgebra::center;
use geom_core::surface::flow::backend::CORNER_DISTORTION;
use geom_core::surface::flow::{
    Corner, CornerBackend, CornerDistortion, CornerObject, Descent, Elements, Flow, Ideal, Measure,
    Places, Search, Straightening, Vertices, Wedge, facing,
};
use geom_core::surface::ground::{Freedom, Ground};
use geom_core::testing::same_on_any_threads;
use geom_core::{Cancelled, Cpu, Point3, Run, TriMesh, Vector3};
use proptest::prelude::*;

fn corners() -> impl Strategy<Value = Vec<Corner>> {
    let vector = || [-1.0..1.0f64, -1.0..1.0f64, -0.2..0.2f64];
    prop::collection::vec((vector(), vector()), 1..60).prop_map(|all| {
        all.into_iter()
            .map(|(a, b)| Corner {
                sides: [
                    Vector3::x() + Vector3::from(a),
                    Vector3::y() + Vector3::from(b),
                ],
                normal: Vector3::new(0.1, -0.2, 1.0).normalize(),
            })
            .collect()
    })
}

fn ideals() -> impl Strategy<Value = Ideal> {
    let inverse = [0.7..1.5f64, -0.4..0.4f64, -0.4..0.4f64, 0.7..1.5f64];
    prop_oneof![
        [0.5..2.0f64, 0.5..2.0f64].prop_map(Ideal::Sides),
        inverse.prop_map(|[p, q, r, s]| Ideal::Inverse([[p, q], [r, s]])),
    ]
}

/// Energies and areas, and derivatives over the energy.
fn numbers(all: &[CornerDistortion]) -> Vec<f64> {
    let numbers = |d: &CornerDistortion| {
        let [a, b] = d.gradient.map(|g| g / d.energy);
        [d.energy, d.area, a.x, a.y, a.z, b.x, b.y, b.z]
    };
    all.iter().flat_map(numbers).collect()
}

fn on_cpu(corners: &[Corner], epsilon: f64) -> Vec<CornerDistortion> {
    let mut out = Vec::new();
    Cpu.corner_distortion(corners, epsilon, &mut out).unwrap();
    out
}

proptest! {
    #![proptest_config(geom_core::testing::cases(32))]

    #[test]
    fn cpu_is_the_specification(corners in corners()) {
        let of = |c: &Corner| CornerDistortion::of(&c.sides, &c.normal, 0.1);
        prop_assert_eq!(on_cpu(&corners, 0.1), corners.iter().map(of).collect::<Vec<_>>());
    }

    /// Derivatives by the edges are those of the energy, whatever the ideal.
    #[test]
    fn derivatives_follow_differences(corners in corners(), ideal in ideals(), at in 0usize..6) {
        const STEP: f64 = 1e-5;
        for corner in &corners {
            for epsilon in [0.0, 0.1] {
                let of = |by: f64| {
                    let mut edges = corner.sides;
                    edges[at / 3][at % 3] += by;
                    CornerDistortion::of(&ideal.sides(edges), &corner.normal, epsilon)
                };
                let here = of(0.0);
                if epsilon == 0.0 && here.area < 0.2 {
                    // Beyond the barrier.
                    continue;
                }
                // Of fourth order.
                let near = (of(STEP).energy - of(-STEP).energy) / (2.0 * STEP);
                let far = (of(2.0 * STEP).energy - of(-2.0 * STEP).energy) / (4.0 * STEP);
                let difference = 3.0 * (4.0 * near - far) / 3.0;
                let slope = ideal.by_edges(here.gradient, 3.0)[at / 3][at % 3];
                let size = here.energy * (1.0 + here.energy);
                prop_assert!((slope - difference).abs() < 1e-6 * size * (1.0 + size), "{} {}", slope, difference);
            }
        }
    }

    /// The comparison can fail: one altered value is found, at its place.
    #[test]
    fn a_wrong_value_is_caught(corners in corners(), place in any::<prop::sample::Index>()) {
        let reference = numbers(&on_cpu(&corners, 0.1));
        let (mut wrong, i) = (reference.clone(), place.index(reference.len()));
        wrong[i] = wrong[i] * 1.01 + 3e-3 * wrong[i].signum();
        let caught = CORNER_DISTORTION.first_break(&reference, &wrong);
        prop_assert_eq!(caught.map(|b| b.index), Some(i));
    }
}

proptest! {
    /// No normal makes a quad better than its corners allow, and one of its own side makes it as good as that.
    #[test]
    fn no_quad_is_better_than_its_corners_allow(
        corners in prop::array::uniform4([-1.0..1.0f64, -1.0..1.0, -1.0..1.0]),
        normal in [-1.0..1.0f64, -1.0..1.0, -1.0..1.0],
    ) {
        let (corners, normal) = (corners.map(Point3::from), Vector3::from(normal));
        let most = highest_jacobian(&corners);
        let both = [normal, -normal].map(|n| upright_jacobian(&corners, &n));
        prop_assert!(both.iter().all(|found| *found <= most), "{both:?} {most}");
        prop_assert_eq!(most, both[0].max(both[1]).max(0.0));
    }
}

#[test]
fn an_ideal_corner_has_distortion_one() {
    let triangle = Ideal::Inverse([[0.5, -1.0 / 6.0], [0.0, 1.0 / 3.0]]);
    let edges = [Vector3::new(2.0, 0.0, 0.0), Vector3::new(1.0, 3.0, 0.0)];
    let oblong = [Vector3::new(2.0, 0.0, 0.0), Vector3::new(0.0, 3.0, 0.0)];
    for (ideal, edges) in [(triangle, edges), (Ideal::Sides([2.0, 3.0]), oblong)] {
        let of = CornerDistortion::of(&ideal.sides(edges), &Vector3::z(), 0.0);
        assert!((of.energy - 1.0).abs() < 1e-15 && (of.area - 1.0).abs() < 1e-15);
        assert!(of.gradient.iter().all(|g| g.norm() < 1e-15));
    }
}

#[cfg(feature = "wgpu")]
#[test]
fn wgpu_follows_the_cpu() {
    let Some(gpu) = geom_core::testing::gpu_or_skip() else {
        return;
    };
    let config = geom_core::testing::cases(24);
    proptest!(config, |(corners in corners(), epsilon in 0.03..1.0f64)| {
        let mut candidate = Vec::new();
        gpu.corner_distortion(&corners, epsilon, &mut candidate).unwrap();
        let [reference, candidate] = [on_cpu(&corners, epsilon), candidate].map(|d| numbers(&d));
        prop_assert_eq!(CORNER_DISTORTION.first_break(&reference, &candidate), None);
    });
}

#[derive(Debug, PartialEq)]
enum Stop {
    Backend(BackendError),
    Cancelled,
}

impl From<BackendError> for Stop {
    fn from(error: BackendError) -> Self {
        Self::Backend(error)
    }
}

impl From<Cancelled> for Stop {
    fn from(_: Cancelled) -> Self {
        Self::Cancelled
    }
}

/// Unit squares of a plate in the plane z = 0.
struct Squares {
    quads: Vec<[u32; 4]>,
    around: Vec<Vec<u32>>,
    wedges: Vec<Wedge>,
}

const SIDE: u32 = 6;

impl Squares {
    fn new() -> Self {
        let at = |i: u32, j: u32| j * (SIDE + 1) + i;
        let cells = (0..SIDE).flat_map(|j| (0..SIDE).map(move |i| (i, j)));
        let quad = |(i, j)| [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
        let vertices = ((SIDE + 1) * (SIDE + 1)) as usize;
        Self::of(cells.map(quad).collect(), vertices)
    }

    fn of(quads: Vec<[u32; 4]>, vertices: usize) -> Self {
        let mut around = vec![Vec::new(); vertices];
        for (q, quad) in (0u32..).zip(&quads) {
            quad.iter().for_each(|&v| around[v as usize].push(q));
        }
        let of = |quad: &[u32; 4]| [0, 1, 2, 3].map(|k| Wedge::of_quad(quad, k, [1.0; 2]));
        Self {
            wedges: quads.iter().flat_map(of).collect(),
            quads,
            around,
        }
    }

    fn at(&self, q: usize, places: &Places<'_>) -> [Point3; 4] {
        self.quads[q].map(|v| places.position(v))
    }

    fn jacobian(&self, q: usize, places: &Places<'_>) -> f64 {
        scaled_jacobian(&self.at(q, places), &Vector3::z())
    }
}

impl Elements for Squares {
    type Error = Stop;
    type Rim = [u32; 4];

    fn count(&self) -> usize {
        self.quads.len()
    }
    fn rim(&self, q: usize) -> [u32; 4] {
        self.quads[q]
    }
    fn around(&self, v: usize) -> &[u32] {
        &self.around[v]
    }
    fn wedges(&self) -> &[Wedge] {
        &self.wedges
    }
    fn renew(&mut self, _: &[Point3]) {}
    fn part(&self, elements: &[usize], vertices: &[u32], positions: &[Point3]) -> Self {
        let place = |v| vertices.binary_search(&v).unwrap() as u32;
        let quads = elements.iter().map(|&q| self.quads[q].map(place));
        Self::of(quads.collect(), positions.len())
    }
    fn seen(&self, vertices: &Vertices<'_>) -> Vec<Vector3> {
        let places = Places::of(vertices);
        let of = |q| [facing(&self.at(q, &places), &Vector3::z()).unwrap(); 4];
        (0..self.quads.len()).flat_map(of).collect()
    }
    fn merit(&self, q: usize, places: &Places<'_>) -> f64 {
        upright_jacobian(&self.at(q, places), &Vector3::z())
    }
    fn scale(&self, _: usize) -> f64 {
        1.0
    }
}

const DESCENT: Descent = Descent {
    power: 1,
    steps: 400,
    first: 0.1,
    tolerance: 0.0,
    renew: false,
};
const SEARCH: Search<Squares> = Search {
    by: Squares::jacobian,
    goal: 0.9,
    rounds: 64,
    first: 0.5,
};
const STRAIGHTENING: Straightening<Squares> = Straightening {
    by: Squares::merit,
    descent: DESCENT,
    best: Squares::jacobian,
    start_counts: true,
    again: 3,
};

fn plane() -> TriMesh {
    let far = [[-9.0, -9.0], [19.0, -9.0], [19.0, 19.0], [-9.0, 19.0]];
    let positions = far.map(|[x, y]| Point3::new(x, y, 0.0)).to_vec();
    TriMesh::new(positions, vec![[0, 1, 2], [0, 2, 3]]).unwrap()
}

/// The plate with its inner vertices off their places by up to `noise` sides, and above the plane.
fn shaken<'a>(ground: &'a Ground<'a>, noise: f64) -> Vertices<'a> {
    let mut random = SplitMix64::new(3);
    let (mut positions, mut freedom) = (Vec::new(), Vec::new());
    for (j, i) in (0..=SIDE).flat_map(|j| (0..=SIDE).map(move |i| (j, i))) {
        let inner = (1..SIDE).contains(&i) && (1..SIDE).contains(&j);
        let mut off = || {
            if inner {
                noise * random.symmetric()
            } else {
                0.0
            }
        };
        positions.push(Point3::new(f64::from(i) + off(), f64::from(j) + off(), 0.3));
        positions.last_mut().unwrap().z *= off().abs();
        freedom.push(if inner {
            Freedom::Surface
        } else {
            Freedom::Fixed
        });
    }
    Vertices::new(positions, freedom, ground)
}

/// From where a vertex belongs.
fn off(v: u32, p: &Point3) -> f64 {
    let (i, j) = (v % (SIDE + 1), v / (SIDE + 1));
    (p - Point3::new(f64::from(i), f64::from(j), 0.0)).norm()
}

fn farthest(vertices: &Vertices<'_>) -> f64 {
    let all = (0..).zip(&vertices.positions);
    all.map(|(v, p)| off(v, p)).fold(0.0, f64::max)
}

/// Squares are what the sum is smallest for: from any start, also with inverted corners, it is found again.
#[test]
fn a_flow_finds_squares_again() {
    let plane = plane();
    let ground = Ground::new(&plane, Vec::new()).unwrap();
    for (noise, inverted) in [(0.3, false), (0.9, true)] {
        let run = Run::on(&Cpu).with(Cpu.as_corners());
        let mut flow = Flow::new(Squares::new(), shaken(&ground, noise), run);
        assert_eq!(flow.worst(Squares::jacobian) < 0.0, inverted);
        let before = flow.mean_distortion().unwrap();
        let mut last = f64::INFINITY;
        flow.descend(&DESCENT, |_| {
            last = 0.0;
            true
        })
        .unwrap();
        assert!(last == 0.0 && flow.mean_distortion().unwrap() < before);
        assert!(
            farthest(&flow.vertices) < 1e-3,
            "{}",
            farthest(&flow.vertices)
        );
    }
}

/// A plane with a tip, over a square of the plate, and its top.
fn tip() -> (TriMesh, Point3) {
    let (middle, high) = (f64::from(SIDE) / 2.0 + 0.35, 1.2);
    let foot = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]];
    let far = [[-9.0, -9.0], [9.0, -9.0], [9.0, 9.0], [-9.0, 9.0]];
    let flat = foot.into_iter().chain(far);
    let mut positions: Vec<Point3> = flat
        .map(|[x, y]| Point3::new(middle + x, middle + y, 0.0))
        .collect();
    let top = Point3::new(middle, middle, high);
    positions.push(top);
    let side = |k: u32| {
        let next = (k + 1) % 4;
        [[k, next, 8], [4 + k, 4 + next, next], [4 + k, next, k]]
    };
    let triangles = (0..4).flat_map(side).collect();
    (TriMesh::new(positions, triangles).unwrap(), top)
}

/// A flow in rounds leaves no element worse than it was and than a goal, nor farther from the surface; a flow alone does.
#[test]
fn no_round_spoils_an_element() {
    const GOAL: f64 = 0.9;
    let ((tip, top), plane) = (tip(), plane());
    let [flat, high] = [&plane, &tip].map(|surface| Ground::new(surface, Vec::new()).unwrap());
    let corner_moved = |vertices: &mut Vertices<'_>| {
        // What is wrong here cannot be mended, and the sum is lower if all around share it.
        vertices.positions[2] += Vector3::new(0.45, 0.7, 0.0);
    };
    let on_tip = |vertices: &mut Vertices<'_>| {
        // One that belongs beside it.
        vertices.positions[((SIDE + 1) * SIDE / 2 + SIDE / 2) as usize] = top;
    };
    assert_eq!(spoiled(&flat, &corner_moved, GOAL, true), [0, 0]);
    assert!(spoiled(&flat, &corner_moved, GOAL, false)[0] > 0);
    assert_eq!(spoiled(&high, &on_tip, GOAL, true), [0, 0]);
    assert!(spoiled(&high, &on_tip, GOAL, false)[1] > 0);
}

/// The scaled Jacobians, and how far the middle of each element is from the surface.
fn measured(flow: &Flow<'_, Squares>, ground: &Ground<'_>) -> (Vec<f64>, Vec<f64>) {
    let places = Places::of(&flow.vertices);
    let off = |q: usize| {
        let corners = flow.elements.at(q, &places).map(|p| p.coords);
        let middle = Point3::from(corners.iter().sum::<Vector3>() / 4.0);
        (ground.pulled(&middle, Freedom::Surface).0 - middle).norm()
    };
    let far = (0..flow.elements.count()).map(off).collect();
    (flow.values(Squares::jacobian), far)
}

/// How many elements a flow makes worse than they were and than a goal, and how many leave the surface, from starts near enough.
fn spoiled(
    ground: &Ground<'_>,
    start: &dyn Fn(&mut Vertices<'_>),
    goal: f64,
    in_rounds: bool,
) -> [usize; 2] {
    let mean = |values: &[f64]| values.iter().sum::<f64>() / values.len() as f64;
    let (mut found, mut starts) = ([0, 0], 0);
    for noise in 1..=20 {
        let mut vertices = shaken(ground, 0.01 * f64::from(noise));
        start(&mut vertices);
        let run = Run::on(&Cpu).with(Cpu.as_corners());
        let mut flow = Flow::new(Squares::new(), vertices, run);
        let (before, near) = measured(&flow, ground);
        let how = Descent {
            steps: 100,
            ..DESCENT
        };
        if in_rounds {
            flow.descend_in_rounds(&how, Squares::jacobian, goal)
                .unwrap();
        } else {
            flow.descend(&how, |_| true).unwrap();
        }
        let (after, far) = measured(&flow, ground);
        if mean(&after) >= mean(&before) + 0.05 {
            continue;
        }
        starts += 1;
        let pairs = before.iter().zip(&after);
        found[0] += pairs
            .filter(|(b, a)| **b > 0.0 && **a < b.min(goal))
            .count();
        let pairs = near.iter().zip(&far);
        found[1] += pairs.filter(|(n, f)| **f > n.max(0.25)).count();
    }
    assert!(starts > 5);
    found
}

/// Who puts other elements in place of the first ones goes down with them as if there had been no others.
#[test]
fn elements_may_change_between_descents() {
    let plane = plane();
    let ground = Ground::new(&plane, Vec::new()).unwrap();
    let run = Run::on(&Cpu).with(Cpu.as_corners());
    let how = Descent {
        steps: 5,
        ..DESCENT
    };
    let others = || {
        let quads = Squares::new().quads.into_iter().rev().skip(SIDE as usize);
        Squares::of(quads.collect(), ((SIDE + 1) * (SIDE + 1)) as usize)
    };
    let mut flow = Flow::new(Squares::new(), shaken(&ground, 0.3), run);
    flow.descend(&how, |_| true).unwrap();
    let mut fresh = Flow::new(others(), shaken(&ground, 0.3), run);
    fresh.vertices.put(flow.vertices.state());
    flow.elements = others();
    for flow in [&mut flow, &mut fresh] {
        assert_eq!(flow.descend(&how, |_| true).unwrap(), 5);
    }
    assert_eq!(flow.vertices.state(), fresh.vertices.state());
}

/// A vertex in the wrong place is lifted, by itself and with those around it; then there is nothing left to do.
#[test]
fn a_search_lifts_the_worst() {
    let plane = plane();
    let ground = Ground::new(&plane, Vec::new()).unwrap();
    let run = Run::on(&Cpu).with(Cpu.as_corners());
    let mut vertices = shaken(&ground, 0.0);
    let middle = (3 * (SIDE + 1) + 3) as usize;
    vertices.positions[middle] += Vector3::new(0.8, 0.5, 0.0);
    let mut flow = Flow::new(Squares::new(), vertices, run);
    assert!(flow.worst(Squares::jacobian) < 0.6);
    assert!((1..=9).contains(&flow.lift_the_worst(&SEARCH).unwrap()));
    assert!(flow.worst(Squares::jacobian) > 0.9);
    assert_eq!(flow.lift_the_worst(&SEARCH).unwrap(), 0);
}

/// After a search for the worst has ended, places that are better in the mean raise that of all, round after round, and no element
/// ends below both what is held and the worst that there was.
#[test]
fn a_search_for_the_mean_raises_it_and_holds_the_worst() {
    let plane = plane();
    let ground = Ground::new(&plane, Vec::new()).unwrap();
    let run = Run::on(&Cpu).with(Cpu.as_corners());
    let search = |rounds: usize| Search {
        goal: 1.0,
        rounds,
        ..SEARCH
    };
    let (mut gained, mut fell) = (Vec::new(), 0);
    for noise in 1..=20 {
        let found = [0.3, 1.0].map(|held| {
            let mut vertices = shaken(&ground, 0.01 * f64::from(noise));
            // One is held off its place, so that not all can be squares.
            let middle = ((SIDE + 1) * SIDE / 2 + SIDE / 2) as usize;
            vertices.positions[middle] += Vector3::new(0.5, 0.2, 0.0);
            vertices.freedom[middle] = Freedom::Fixed;
            let mut flow = Flow::new(Squares::new(), vertices, run);
            flow.lift_many(&search(64)).unwrap();
            let (start, worst) = (flow.mean(Squares::jacobian), flow.worst(Squares::merit));
            let mut mean = start;
            for _ in 0..12 {
                flow.lift_the_mean(&search(8), held).unwrap();
                let next = flow.mean(Squares::jacobian);
                assert!(next >= mean, "{noise}: {mean} {next}");
                mean = next;
                let now = flow.worst(Squares::merit);
                assert!(now >= worst.min(held), "{noise}: {worst} {now}");
            }
            (mean - start, flow.worst(Squares::merit) < worst)
        });
        gained.push(found[0].0);
        fell += usize::from(found[0].1);
    }
    assert!(gained.iter().all(|&g| g > 0.0003), "{gained:?}");
    assert!(fell > 15, "{fell}");
}

/// A search for nearly all elements raises their mean, and leaves none farther from the surface nor worse and bad; alone it takes
/// vertices off the tip.
#[test]
fn a_search_for_many_spoils_none() {
    let (tip, top) = tip();
    let ground = Ground::new(&tip, Vec::new()).unwrap();
    let many = Search {
        goal: 0.95,
        ..SEARCH
    };
    let (mut alone, mut taken) = (0, 0);
    for noise in 1..=20 {
        let found = [0, 1, 2].map(|how| {
            let mut vertices = shaken(&ground, 0.02 * f64::from(noise));
            vertices.positions[((SIDE + 1) * SIDE / 2 + SIDE / 2) as usize] = top;
            let run = Run::on(&Cpu).with(Cpu.as_corners());
            let mut flow = Flow::new(Squares::new(), vertices, run);
            let (before, near) = measured(&flow, &ground);
            match how {
                0 => flow.lift_the_worst(&many),
                1 => flow.lift_many(&many),
                _ => flow.lift_the_mean(&many, 0.6),
            }
            .unwrap();
            let (after, far) = measured(&flow, &ground);
            let sum = |values: &[f64]| values.iter().sum::<f64>();
            taken += usize::from(how > 0 && sum(&after) > sum(&before));
            let worse = before.iter().zip(&after).filter(|(b, a)| **a < b.min(0.6));
            let off = near.iter().zip(&far).filter(|(n, f)| **f > n.max(0.4));
            worse.count() + off.count()
        });
        alone += found[0];
        assert_eq!(found[1..], [0, 0], "noise {noise}");
    }
    assert!(alone > 0 && taken > 30, "{alone} {taken}");
}

/// Some vertices are put onto the surface as all are, and no others; one that is added is there.
#[test]
fn some_vertices_settle_alone() {
    let (tip, top) = tip();
    let ground = Ground::new(&tip, Vec::new()).unwrap();
    let mut vertices = shaken(&ground, 0.2);
    let before = vertices.state();
    let lifted = [8u32, 17, 24];
    for v in lifted {
        vertices.positions[v as usize] += Vector3::new(0.1, 0.2, 0.5);
    }
    vertices.settle_some(&lifted);
    for (v, (p, n)) in before.0.iter().zip(&before.1).enumerate() {
        let expected = match lifted.contains(&(v as u32)) {
            true => ground.pulled(&(p + Vector3::new(0.1, 0.2, 0.5)), vertices.freedom[v]),
            false => (*p, *n),
        };
        assert_eq!((vertices.positions[v], vertices.normals[v]), expected);
    }
    assert!(
        lifted
            .iter()
            .all(|&v| vertices.freedom[v as usize] == Freedom::Surface)
    );
    // On one surface, and on the second of two.
    let plane = plane();
    let grounds = [&tip, &plane].map(|surface| Ground::new(surface, Vec::new()).unwrap());
    let (positions, freedom) = (vertices.positions.clone(), vertices.freedom.clone());
    let on_two = Vertices::on_parts(positions, freedom, &grounds, Vec::new());
    let over = top + Vector3::new(0.3, 0.0, 1.0);
    for (mut vertices, part) in [(vertices, 0), (on_two, 1)] {
        let number = vertices.add(over, Freedom::Surface, part) as usize;
        assert_eq!(number, before.0.len());
        let expected = grounds[part as usize].pulled(&over, Freedom::Surface);
        assert_eq!(
            (vertices.positions[number], vertices.normals[number]),
            expected
        );
        let after = vertices.state();
        vertices.settle_some(&[number as u32, 8]);
        assert!((vertices.positions[number] - after.0[number]).norm() < 1e-12);
        assert!((vertices.positions[8] - after.0[8]).norm() < 1e-12);
    }
}

/// Vertices search at once only where none sees another: whatever moves, the worst around it becomes better, on any threads.
#[test]
fn no_search_makes_the_worst_worse() {
    let plane = plane();
    let ground = Ground::new(&plane, Vec::new()).unwrap();
    same_on_any_threads(|| {
        let run = Run::on(&Cpu).with(Cpu.as_corners());
        let mut flow = Flow::new(Squares::new(), shaken(&ground, 0.9), run);
        let once = Search {
            by: Squares::merit,
            rounds: 1,
            ..SEARCH
        };
        let (mut worst, mut moved) = (flow.worst(Squares::merit), 0);
        for _ in 0..20 {
            moved += flow.lift_the_worst(&once).unwrap();
            let after = flow.worst(Squares::merit);
            assert!(after >= worst, "{worst} became {after}");
            worst = after;
        }
        assert!(moved > 20, "{moved}");
        flow.vertices.positions
    });
}

/// What is bad together gets better together, and the vertices held for it are free again.
#[test]
fn bad_elements_are_made_straight() {
    let plane = plane();
    let ground = Ground::new(&plane, Vec::new()).unwrap();
    let made = || {
        let run = Run::on(&Cpu).with(Cpu.as_corners());
        let mut flow = Flow::new(Squares::new(), shaken(&ground, 0.9), run);
        let (before, free) = (flow.worst(Squares::merit), flow.vertices.freedom.clone());
        flow.straighten(&STRAIGHTENING, &SEARCH).unwrap();
        assert!(before < 0.6 && flow.worst(Squares::merit) > 0.8);
        assert_eq!(flow.vertices.freedom, free);
        flow.vertices.positions
    };
    same_on_any_threads(made);
}

/// Around bad elements a flow moves what is within three rings of them, and nothing else.
#[test]
fn what_is_far_from_bad_elements_stays() {
    let plane = plane();
    let ground = Ground::new(&plane, Vec::new()).unwrap();
    let mut vertices = shaken(&ground, 0.05);
    let at = |i: u32, j: u32| (j * (SIDE + 1) + i) as usize;
    vertices.positions[at(1, 1)] = Point3::new(0.2, 0.2, 0.0);
    let start = vertices.positions.clone();
    let run = Run::on(&Cpu).with(Cpu.as_corners());
    let mut flow = Flow::new(Squares::new(), vertices, run);
    let search = Search {
        goal: 0.6,
        ..SEARCH
    };
    flow.straighten(&STRAIGHTENING, &search).unwrap();
    assert!(flow.worst(Squares::merit) > 0.8);
    let moved = |i, j| flow.vertices.positions[at(i, j)] != start[at(i, j)];
    // Bad are the two squares beside that in the corner: three rings around one of them end at the fourth and the third.
    for (i, j) in (1..SIDE).flat_map(|i| (1..SIDE).map(move |j| (i, j))) {
        let near = i.max(j) <= 4 && i.min(j) <= 3;
        assert_eq!(moved(i, j), near, "{i}, {j}");
    }
}

/// With the start counted, a flow that makes the worst worse gives it back.
#[test]
fn the_best_may_be_the_start() {
    let plane = plane();
    let ground = Ground::new(&plane, Vec::new()).unwrap();
    let run = Run::on(&Cpu).with(Cpu.as_corners());
    let mut flow = Flow::new(Squares::new(), shaken(&ground, 0.3), run);
    let start = flow.vertices.state();
    // A measure by which all but the start is worse: how far the square in the middle is from its place.
    let farther: Measure<Squares> = |squares, q, places| match q as u32 {
        q if q == SIDE * SIDE / 2 + SIDE / 2 => {
            let off = squares.quads[q as usize].map(|v| off(v, &places.position(v)));
            off.into_iter().sum()
        }
        _ => f64::INFINITY,
    };
    let (value, state) = flow.best_of(&DESCENT, farther, true).unwrap();
    assert!(state == start && value > 0.1);
    let (value, state) = flow.best_of(&DESCENT, farther, false).unwrap();
    assert!(state != start && value < 0.1);
}

#[test]
fn a_watcher_stops_it() {
    let plane = plane();
    let ground = Ground::new(&plane, Vec::new()).unwrap();
    let stop = |_: &'static str, done: u64, _: u64| match done {
        0..2 => ControlFlow::Continue(()),
        _ => ControlFlow::Break(()),
    };
    let run = Run::on(&Cpu).watched_by(&stop).with(Cpu.as_corners());
    let mut flow = Flow::new(Squares::new(), shaken(&ground, 0.3), run);
    let mut steps = 0;
    let stopped = flow.descend(&DESCENT, |_| {
        steps += 1;
        true
    });
    assert_eq!((stopped, steps), (Err(Stop::Cancelled), 2));
}

/// A backend that leaves out the last.
struct Short;

impl geom_core::Backend for Short {
    fn name(&self) -> String {
        "short".into()
    }
}

impl CornerBackend for Short {
    fn corner_distortion(
        &self,
        corners: &[Corner],
        epsilon: f64,
        out: &mut Vec<CornerDistortion>,
    ) -> Result<(), BackendError> {
        Cpu.corner_distortion(&corners[1..], epsilon, out)
    }
}

proptest! {
    /// After a move from the surface the search is shorter, and finds the same; from elsewhere, too.
    #[test]
    fn a_start_on_the_surface_changes_nothing(
        to in prop::array::uniform3(-1.5..1.5f64),
        far in 0.0..1.0f64,
        lift in prop_oneof![Just(0.0), 0.0..0.2f64],
    ) {
        let torus = shapes::torus(1.0, 0.3, 24, 12);
        let line = [Point3::new(1.3, 0.0, 0.0), Point3::new(0.0, 1.3, 0.0)];
        let ground = Ground::new(&torus, vec![line]).unwrap();
        let to = Point3::from(to);
        let (on, normal) = ground.pulled(&Point3::new(0.9, 0.4, 0.2), Freedom::Surface);
        let start = on + normal * lift;
        let p = start + (to - start) * far;
        for freedom in [Freedom::Surface, Freedom::Line, Freedom::Fixed] {
            prop_assert_eq!(
                ground.pulled_from(&start, &p, freedom),
                ground.pulled(&p, freedom)
            );
        }
    }
}

#[test]
fn too_few_distortions_are_an_error() {
    let sphere = shapes::icosphere(9.0, 1);
    let ground = Ground::new(&sphere, Vec::new()).unwrap();
    let run = Run::on(&Short).with(Short.as_corners());
    let mut flow = Flow::new(Squares::new(), shaken(&ground, 0.0), run);
    let Err(Stop::Backend(error)) = flow.mean_distortion() else {
        panic!("no error");
    };
    assert_eq!(
        error.to_string(),
        "short gave 143 distortions for 144 corners"
    );
}

/// On which side quads lie on a ring about as thick as they are, and in it, is what the whole of Simpson's rule says: what is not
/// looked at cannot turn them over.
#[test]
fn a_quad_lies_as_all_of_the_surface_under_it() {
    let ring = shapes::torus(1.0, 0.12, 96, 16);
    let ground = Ground::new(&ring, Vec::new()).unwrap();
    let mut random = SplitMix64::new(5);
    let (mut right, mut turned) = (0, 0);
    for _ in 0..2000 {
        let (turn, size) = (TAU * random.unit(), 0.1 + 0.2 * random.unit());
        let middle = Vector3::new(turn.cos(), turn.sin(), 0.0);
        let mut noise = || Vector3::from_fn(|_, _| random.symmetric());
        let [p, q] = [noise(), noise()].map(|side| side * size);
        let corners =
            [-p - q, p - q, p + q, q - p].map(|d| Point3::from(middle + d + noise() * 0.05));
        let corners = corners.map(|c| ground.pulled(&c, Freedom::Surface).0);
        let at = |p: &Point3| ground.pulled(p, Freedom::Surface).1;
        let normals = corners.map(|c| at(&c));
        let own = (corners[2] - corners[0]).cross(&(corners[3] - corners[1]));
        let sum: Vector3 = normals.iter().sum();
        if sum.dot(&own).abs() >= 2.0 * own.norm() {
            continue;
        }
        let sides = [0, 1, 2, 3].map(|k| at(&center(&corners[k], &corners[(k + 1) % 4])));
        let all = corners.iter().map(|c| c.coords).sum::<Vector3>();
        let whole = sum + sides.iter().sum::<Vector3>() * 4.0 + at(&Point3::from(all / 4.0)) * 16.0;
        let is_right = whole.dot(&own) > 0.0;
        assert_eq!(
            ground.normal_over(&corners, &normals).dot(&own) > 0.0,
            is_right
        );
        *(if is_right { &mut right } else { &mut turned }) += 1;
    }
    assert!(right > 100 && turned > 100, "{right} {turned}");
}
