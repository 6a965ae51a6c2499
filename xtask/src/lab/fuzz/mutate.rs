//! Faults for files and meshes. The same number makes the same faults.

use std::ops::Range;

use geom_core::Point3;
use geom_core::compute::random::SplitMix64;

/// A stream of numbers for one case.
pub(super) struct Random(SplitMix64);

impl Random {
    pub(super) fn new(case: u64) -> Self {
        Self(SplitMix64::new(case.wrapping_mul(0x9e37_79b9_7f4a_7c15)))
    }

    /// Below `n`, 0 if that is 0.
    pub(super) fn below(&mut self, n: usize) -> usize {
        (self.0.next_u64() % n.max(1) as u64) as usize
    }

    pub(super) fn one_of<'a, T>(&mut self, of: &'a [T]) -> &'a T {
        &of[self.below(of.len())]
    }

    /// A short range of `0..n`.
    fn range(&mut self, n: usize) -> Range<usize> {
        let start = self.below(n);
        let longest = *self.one_of(&[4, 16, 64, n]);
        start..(start + 1 + self.below(longest)).min(n)
    }

    fn symmetric(&mut self) -> f64 {
        self.0.symmetric()
    }
}

/// What counts and coordinates should never be.
const WORDS: &[&str] = &[
    "-1",
    "0",
    "1",
    "2",
    "3",
    "65536",
    "2147483647",
    "4294967295",
    "4294967296",
    "-2147483648",
    "18446744073709551615",
    "99999999999999999999",
    "nan",
    "inf",
    "-inf",
    "1e400",
    "1e-400",
    "1e38",
    "0x10",
    "",
    "1.5",
    "\"",
    "'",
    ";",
    "<",
    "é",
];

/// Numbers at the ends of what machines count.
const ENDS: &[u64] = &[
    0,
    1,
    2,
    4,
    255,
    256,
    65_535,
    0x7fff_ffff,
    0x8000_0000,
    0xffff_ffff,
    0x1_0000_0000,
    u64::MAX,
    0x7fc0_0000,
    0x7f80_0000,
];

/// A file with one to four faults: bits, words, pieces cut out, doubled or taken from another seed.
pub(super) fn bytes(random: &mut Random, seeds: &[Vec<u8>]) -> Vec<u8> {
    let mut bytes = random.one_of(seeds).clone();
    for _ in 0..1 + random.below(4) {
        let n = bytes.len();
        if n == 0 {
            break;
        }
        // Half of the faults strike the beginning, where counts and keywords are.
        let place = if random.below(2) == 0 {
            random.below(n.min(200))
        } else {
            random.below(n)
        };
        match random.below(8) {
            0 => bytes[place] ^= 1 << random.below(8),
            1 => bytes[place] = random.below(256) as u8,
            2 if random.below(4) == 0 => bytes.truncate(place),
            2 => drop(bytes.drain(random.range(n))),
            3 => {
                let copy = bytes[random.range(n)].to_vec();
                bytes.splice(place..place, copy);
            }
            4 => {
                let other = random.one_of(seeds);
                let piece = other[random.range(other.len())].to_vec();
                bytes.splice(place..(place + piece.len()).min(n), piece);
            }
            5 | 6 => {
                let in_word = |b: &u8| !b.is_ascii_whitespace();
                let start = place + bytes[place..].iter().position(in_word).unwrap_or(0);
                let end = bytes[start..].iter().position(|b| !in_word(b));
                let end = end.map_or(n, |length| start + length);
                bytes.splice(start..end, random.one_of(WORDS).bytes());
            }
            _ => {
                let width = *random.one_of(&[1, 2, 4, 8]);
                let place = place / width * width;
                let word = random.one_of(ENDS).to_le_bytes();
                for (to, from) in bytes[place..].iter_mut().zip(&word[..width]) {
                    *to = *from;
                }
            }
        }
    }
    bytes
}

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
