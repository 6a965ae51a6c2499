//! Faults for meshes. The same number makes the same faults.

use geom_core::Point3;
use geom_core::testing::faults::Random;

/// A mesh of triangles, quads or tetrahedra: vertices and elements.
pub(super) type Mesh<const N: usize> = (Vec<Point3>, Vec<[u32; N]>);

/// A mesh with up to five faults: what is wrong with meshes that people have.
pub(super) fn mesh<const N: usize>(random: &mut Random, seeds: &[Mesh<N>]) -> Mesh<N> {
    let (mut points, mut elements) = random.one_of(seeds).clone();
    for _ in 0..random.below(6) {
        if points.is_empty() || elements.is_empty() {
            break;
        }
        if random.below(2) == 0 {
            disturb_points(random, &mut points);
        } else {
            disturb_elements(random, points.len(), &mut elements);
        }
        if random.below(12) == 0 {
            let (other, more) = random.one_of(seeds);
            let first = points.len() as u32;
            points.extend(other);
            elements.extend(more.iter().map(|e| e.map(|v| v + first)));
        }
    }
    (points, elements)
}

fn disturb_points(random: &mut Random, points: &mut Vec<Point3>) {
    let n = points.len();
    let v = random.below(n);
    let [x, y, z] = [random.symmetric(), random.symmetric(), random.symmetric()];
    match random.below(9) {
        // A spike, or a fold.
        0 | 1 => {
            let size = *random.one_of(&[1e-9, 1e-3, 0.1, 1.0, 100.0]);
            points[v] += geom_core::Vector3::new(x, y, z) * size;
        }
        // Two vertices at one place.
        2 => points[v] = points[random.below(n)],
        // A whole part of no height, or at one point.
        3 => random.range(n).for_each(|v| points[v].z = 0.0),
        4 => {
            let to = points[v];
            random.range(n).for_each(|v| points[v] = to);
        }
        5 => {
            let scale = *random.one_of(&[0.0, 1e-150, 1e-30, 1e-6, 1e6, 1e30, 1e150, -1.0]);
            points.iter_mut().for_each(|p| p.coords *= scale);
        }
        6 => {
            points[v][random.below(3)] =
                *random.one_of(&[0.0, -0.0, 1e18, 1e300, f64::MIN_POSITIVE, 5e-324])
        }
        // Vertices of no element.
        7 => points.push(Point3::new(x, y, z)),
        // Far from the origin.
        _ => {
            let far = *random.one_of(&[1e3, 1e8, 1e15]);
            points.iter_mut().for_each(|p| p.x += far);
        }
    }
}

fn disturb_elements<const N: usize>(random: &mut Random, n: usize, elements: &mut Vec<[u32; N]>) {
    let e = random.below(elements.len());
    let count = elements.len();
    match random.below(9) {
        // A hole.
        0 | 1 => drop(elements.drain(random.range(count))),
        // Few are left.
        2 if random.below(3) == 0 => elements.truncate(1 + random.below(8)),
        2 | 3 => elements.push(elements[e]),
        // Turned around.
        4 => elements[e].reverse(),
        5 => random.range(count).for_each(|e| elements[e].swap(0, 1)),
        // Onto any vertex: edges of three elements, or elements that name a vertex twice.
        6 => elements[e][random.below(N)] = random.below(n) as u32,
        7 => {
            let corners = std::array::from_fn(|_| random.below(n) as u32);
            elements.push(corners);
        }
        // Two vertices become one: what met at an edge or a point is pinched.
        _ => {
            let (from, to) = (elements[e][0], random.below(n) as u32);
            let corners = elements.iter_mut().flatten().filter(|v| **v == from);
            corners.for_each(|v| *v = to);
        }
    }
}
