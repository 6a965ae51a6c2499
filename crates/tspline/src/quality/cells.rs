//! Elements cut into quads without T-junctions, and the corners whose distortion is measured.

use std::borrow::Cow;

use geom_core::compute::parallel;
use geom_core::mesh::quality::{highest_jacobian, scaled_jacobian, upright_jacobian};
use geom_core::surface::flow::{Elements, Ideal, Places, Vertices, Wedge, barrier, facing, least};
use geom_core::{Point3, Vector3};

use crate::options::Method;
use crate::{Error, TMesh};

/// No side counts as shorter than this share of the mean one.
const SHORTEST: f64 = 1e-6;

/// Sides shorter than this share of their first length should become longer.
const SLENDER: f64 = 0.5;

/// Sides below this share of it are bad however straight their corners are.
const SHORT: f64 = 0.4;

/// A T-mesh as conforming quads: an element with a T-junction is cut from there to the opposite T-junction or, where
/// there is none, to the middle of the opposite side, its *foot* (Fig. 5.5b).
pub(crate) struct Cells {
    vertices: usize,
    /// Nodes beyond the vertices, each the mean of four earlier ones.
    feet: Vec<[u32; 4]>,
    /// Corners per quad.
    quads: Vec<[u32; 4]>,
    /// Lengths per quad that its sides should have: of the first and third, and of the others.
    sides: Vec<[f64; 2]>,
    /// Where the quads of each element begin.
    starts: Vec<u32>,
    /// The elements around each vertex.
    around: Vec<Vec<u32>>,
    /// Corners whose distortion is measured: of quads, or of triangles.
    wedges: Vec<Wedge>,
    method: Method,
    /// The mean area of the quads around each vertex.
    scale: Vec<f64>,
}

impl Cells {
    /// The quads of a mesh, with the proportions of their sides as they are at these positions.
    pub(crate) fn new(mesh: &TMesh, positions: &[Point3], method: Method) -> Self {
        let mut cells = Self {
            vertices: positions.len(),
            feet: Vec::new(),
            quads: Vec::new(),
            sides: Vec::new(),
            starts: vec![0],
            around: vec![Vec::new(); positions.len()],
            wedges: Vec::new(),
            method,
            scale: vec![0.0; positions.len()],
        };
        for e in 0..mesh.elements().len() {
            cells.cut(mesh, e);
            cells.starts.push(cells.quads.len() as u32);
            for side in 0..4 {
                // The last vertex is the first of the next side.
                let along = mesh.side(e, side);
                for &v in &along[..along.len() - 1] {
                    cells.around[v as usize].push(e as u32);
                }
            }
        }
        let nodes = cells.nodes(positions);
        cells.measure(&nodes);
        match method {
            Method::Corners => cells.right_angles(),
            Method::Triangles => cells.triangles(mesh, &nodes),
        }
        cells.scales(&nodes);
        cells
    }

    fn foot(&mut self, parents: [u32; 4]) -> u32 {
        self.feet.push(parents);
        (self.vertices + self.feet.len() - 1) as u32
    }

    fn cut(&mut self, mesh: &TMesh, e: usize) {
        let [a, b, c, d] = mesh.elements()[e].corners;
        let hung = [0, 1, 2, 3].map(|k| match mesh.side(e, k) {
            &[_, middle, _] => Some(middle),
            _ => None,
        });
        let corners = [a, b, c, d];
        let mut middle = |k: usize| {
            let (from, to) = (corners[k], corners[(k + 1) % 4]);
            hung[k].unwrap_or_else(|| self.foot([from, from, to, to]))
        };
        let along = [0, 1].map(|k| hung[k].is_some() || hung[k + 2].is_some());
        match along {
            [false, false] => self.quads.push(corners),
            [true, false] => {
                let [m, n] = [0, 2].map(&mut middle);
                self.quads.extend([[a, m, n, d], [m, b, c, n]]);
            }
            [false, true] => {
                let [m, n] = [1, 3].map(&mut middle);
                self.quads.extend([[a, b, m, n], [n, m, c, d]]);
            }
            [true, true] => {
                let m = [0, 1, 2, 3].map(&mut middle);
                let o = self.foot(m);
                let [m, n, p, q] = m;
                self.quads
                    .extend([[a, m, o, q], [m, b, n, o], [o, n, c, p], [q, o, p, d]]);
            }
        }
    }

    /// The first lengths of the sides of all quads: the mean of opposite ones.
    fn measure(&mut self, nodes: &[Point3]) {
        let sides = |quad: &[u32; 4]| {
            let p = quad.map(|n| nodes[n as usize]);
            let length = |k: usize| (p[(k + 1) % 4] - p[k]).norm();
            [length(0) + length(2), length(1) + length(3)].map(|s| 0.5 * s)
        };
        self.sides = self.quads.iter().map(sides).collect();
        // A quad without extent must not make the energy infinite.
        let all: f64 = self.sides.iter().flatten().sum();
        let least = SHORTEST * all / (2 * self.quads.len()).max(1) as f64;
        for sides in &mut self.sides {
            *sides = sides.map(|s| s.max(least));
        }
    }

    /// Right angles between sides whose lengths are in proportion as they were first (Eqs. 5.5–5.6).
    fn right_angles(&mut self) {
        for (quad, sides) in self.quads.iter().zip(&self.sides) {
            for k in 0..4 {
                let [next, previous] = [sides[k % 2], sides[(k + 1) % 2]];
                self.wedges.push(Wedge {
                    nodes: [quad[k], quad[(k + 1) % 4], quad[(k + 3) % 4]],
                    ideal: Ideal::Inverse([[1.0 / next, 0.0], [0.0, 1.0 / previous]]),
                });
            }
        }
    }

    /// The shortest side of the quads of an element, over its first length.
    fn shortest(&self, e: usize, places: &Places<'_>) -> f64 {
        let quads = self.starts[e] as usize..self.starts[e + 1] as usize;
        let of = |q: usize| {
            let p = self.quads[q].map(|n| self.node(n, places));
            let share = move |k: usize| (p[(k + 1) % 4] - p[k]).norm() / self.sides[q][k % 2];
            (0..4).map(share)
        };
        least(quads.flat_map(of))
    }

    /// The triangles into which an ideal square of the element's area falls: both ways in two, or a fan about a T-junction
    /// (Eqs. 5.8–5.9).
    fn triangles(&mut self, mesh: &TMesh, nodes: &[Point3]) {
        const SQUARE: [[f64; 2]; 4] = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];
        for (e, element) in mesh.elements().iter().enumerate() {
            let side = self.area(e, nodes).sqrt();
            let rim: Vec<(u32, [f64; 2])> = (0..4)
                .flat_map(|k| {
                    let along = mesh.side(e, k);
                    let [from, to] = [SQUARE[k], SQUARE[(k + 1) % 4]];
                    let parts = (along.len() - 1) as f64;
                    let at = move |i: usize| {
                        [0, 1].map(|c| side * (from[c] + (to[c] - from[c]) * i as f64 / parts))
                    };
                    along[..along.len() - 1]
                        .iter()
                        .enumerate()
                        .map(move |(i, &v)| (v, at(i)))
                })
                .collect();
            let n = rim.len();
            let apexes: Vec<[usize; 3]> = if n == 4 {
                (0..4).map(|k| [k, (k + 1) % 4, (k + 3) % 4]).collect()
            } else {
                let hung = (0..n).find(|&i| !element.corners.contains(&rim[i].0));
                let t = hung.expect("a T-junction");
                (1..n - 1)
                    .map(|i| [t, (t + i) % n, (t + i + 1) % n])
                    .collect()
            };
            for [o, a, b] in apexes {
                let edge = |i: usize| [0, 1].map(|c| rim[i].1[c] - rim[o].1[c]);
                let ([ax, ay], [bx, by]) = (edge(a), edge(b));
                let area = ax * by - ay * bx;
                self.wedges.push(Wedge {
                    nodes: [o, a, b].map(|i| rim[i].0),
                    ideal: Ideal::Inverse([[by / area, -bx / area], [-ay / area, ax / area]]),
                });
            }
        }
    }

    fn scales(&mut self, nodes: &[Point3]) {
        for v in 0..self.vertices {
            let quads = self.around[v].iter().map(|&e| {
                let parts = self.starts[e as usize + 1] - self.starts[e as usize];
                self.area(e as usize, nodes) / f64::from(parts)
            });
            let count = self.around[v].len().max(1);
            self.scale[v] = quads.sum::<f64>() / count as f64;
        }
    }

    fn area(&self, e: usize, nodes: &[Point3]) -> f64 {
        let of = |quad: &[u32; 4]| {
            let [a, b, c, d] = quad.map(|n| nodes[n as usize]);
            0.5 * (c - a).cross(&(d - b)).norm()
        };
        self.of_element(e).iter().map(of).sum()
    }

    /// The quads of an element.
    pub(crate) fn of_element(&self, e: usize) -> &[[u32; 4]] {
        &self.quads[self.starts[e] as usize..self.starts[e + 1] as usize]
    }

    /// The scaled Jacobian of an element.
    pub(crate) fn jacobian(&self, e: usize, places: &Places<'_>) -> f64 {
        self.on_surface(e, places, scaled_jacobian)
    }

    /// The same, rising also where the element lies on its back.
    pub(crate) fn upright_jacobian(&self, e: usize, places: &Places<'_>) -> f64 {
        self.on_surface(e, places, upright_jacobian)
    }

    /// The least of the quads of an element, each seen along the surface's normal over it.
    fn on_surface(
        &self,
        e: usize,
        places: &Places<'_>,
        of: impl Fn(&[Point3; 4], &Vector3) -> f64,
    ) -> f64 {
        let of = |quad: &[u32; 4]| {
            let at = quad.map(|n| self.node(n, places));
            let normals = quad.map(|n| self.normal(n, places));
            of(&at, &self.surface_normal(quad, &at, &normals, places))
        };
        least(self.of_element(e).iter().map(of))
    }

    /// The surface's normal over a quad, of any length: where those at its corners point anywhere, that of what lies under it.
    fn surface_normal(
        &self,
        quad: &[u32; 4],
        at: &[Point3; 4],
        normals: &[Vector3; 4],
        places: &Places<'_>,
    ) -> Vector3 {
        // Each part of an element has one of its corners.
        let vertex = quad.iter().find(|&&n| (n as usize) < self.vertices);
        let ground = places.ground(vertex.map_or(0, |&v| v));
        ground.normal_over(at, normals)
    }

    /// The unit normal of a node alone.
    fn normal(&self, n: u32, places: &Places<'_>) -> Vector3 {
        match (n as usize).checked_sub(self.vertices) {
            None => places.normal(n),
            Some(foot) => foot_normal(self.feet[foot].map(|p| self.normal(p, places))),
        }
    }

    /// Unit normals of all nodes.
    fn normals(&self, normals: &[Vector3]) -> Vec<Vector3> {
        let mut nodes = normals.to_vec();
        for foot in &self.feet {
            nodes.push(foot_normal(foot.map(|n| nodes[n as usize])));
        }
        nodes
    }

    /// A node alone.
    pub(crate) fn node(&self, n: u32, places: &Places<'_>) -> Point3 {
        match (n as usize).checked_sub(self.vertices) {
            None => places.position(n),
            Some(foot) => {
                let parents = self.feet[foot].iter();
                let parents = parents.map(|&p| self.node(p, places).coords);
                Point3::from(parents.sum::<Vector3>() / 4.0)
            }
        }
    }
}

/// That of the parents' sum; where they cancel, the first.
fn foot_normal(parents: [Vector3; 4]) -> Vector3 {
    let sum: Vector3 = parents.iter().sum();
    sum.try_normalize(1e-9).unwrap_or(parents[0])
}

impl Elements for Cells {
    type Error = Error;
    type Rim = Vec<u32>;

    fn count(&self) -> usize {
        self.starts.len() - 1
    }

    /// Ascending.
    fn rim(&self, e: usize) -> Vec<u32> {
        let mut rim: Vec<u32> = self.of_element(e).concat();
        rim.retain(|&n| (n as usize) < self.vertices);
        rim.sort_unstable();
        rim.dedup();
        rim
    }

    fn around(&self, v: usize) -> &[u32] {
        &self.around[v]
    }

    fn wedges(&self) -> &[Wedge] {
        &self.wedges
    }

    /// Right angles between sides of the lengths that they have at these places, but not much shorter than they were first.
    fn renew(&mut self, positions: &[Point3]) {
        let nodes = self.nodes(positions).into_owned();
        self.wedges.clear();
        for (quad, sides) in self.quads.iter().zip(&self.sides) {
            let at = quad.map(|n| nodes[n as usize]);
            let inverse = |k: usize| {
                let length = (at[(k + 1) % 4] - at[k]).norm();
                1.0 / length.max(SLENDER * sides[k % 2])
            };
            for k in 0..4 {
                self.wedges.push(Wedge {
                    nodes: [quad[k], quad[(k + 1) % 4], quad[(k + 3) % 4]],
                    ideal: Ideal::Inverse([[inverse(k), 0.0], [0.0, inverse((k + 3) % 4)]]),
                });
            }
        }
    }

    /// With its feet, each of which is of one element.
    fn part(&self, elements: &[usize], vertices: &[u32], positions: &[Point3]) -> Self {
        let mut feet: Vec<u32> = Vec::new();
        for &e in elements {
            feet.extend(self.of_element(e).as_flattened());
        }
        feet.retain(|&n| n as usize >= self.vertices);
        feet.sort_unstable();
        feet.dedup();
        let place = |n: u32| match (n as usize) < self.vertices {
            true => vertices.partition_point(|&v| v < n) as u32,
            false => (vertices.len() + feet.partition_point(|&f| f < n)) as u32,
        };
        let of_foot = |n: &u32| self.feet[*n as usize - self.vertices].map(place);
        let mut own = Self {
            vertices: vertices.len(),
            feet: feet.iter().map(of_foot).collect(),
            quads: Vec::new(),
            sides: Vec::new(),
            starts: vec![0],
            around: vec![Vec::new(); vertices.len()],
            wedges: Vec::new(),
            method: self.method,
            scale: vertices.iter().map(|&v| self.scale[v as usize]).collect(),
        };
        for (number, &e) in (0u32..).zip(elements) {
            let quads = self.starts[e] as usize..self.starts[e + 1] as usize;
            own.sides.extend_from_slice(&self.sides[quads.clone()]);
            (own.quads).extend(self.quads[quads].iter().map(|quad| quad.map(place)));
            own.starts.push(own.quads.len() as u32);
            for v in self.rim(e) {
                own.around[place(v) as usize].push(number);
            }
        }
        own.renew(positions);
        own
    }

    /// Triangles along the surface's normals at their vertices, corners along those of their quads.
    fn seen(&self, vertices: &Vertices<'_>) -> Vec<Vector3> {
        let normals = self.normals(&vertices.normals);
        if self.method == Method::Triangles {
            let of = |wedge: &Wedge| normals[wedge.nodes[0] as usize];
            return self.wedges.iter().map(of).collect();
        }
        let (nodes, places) = (self.nodes(&vertices.positions), Places::of(vertices));
        parallel::flat_map(self.quads.len(), |q| {
            let quad = &self.quads[q];
            let at = quad.map(|n| nodes[n as usize]);
            let normals = quad.map(|n| normals[n as usize]);
            let of_surface = self.surface_normal(quad, &at, &normals, &places);
            [facing(&at, &of_surface).unwrap_or(normals[0]); 4]
        })
    }

    /// Sines say nothing of lengths: a side shorter than [`SHORT`] counts as bad as it is short.
    fn merit(&self, e: usize, places: &Places<'_>) -> f64 {
        self.upright_jacobian(e, places)
            .min(self.shortest(e, places) / SHORT)
    }

    fn merit_at_most(&self, e: usize, places: &Places<'_>) -> f64 {
        let of = |quad: &[u32; 4]| highest_jacobian(&quad.map(|n| self.node(n, places)));
        least(self.of_element(e).iter().map(of)).min(self.shortest(e, places) / SHORT)
    }

    fn scale(&self, v: usize) -> f64 {
        self.scale[v]
    }

    fn nodes<'p>(&self, positions: &'p [Point3]) -> Cow<'p, [Point3]> {
        let mut nodes = Cow::Borrowed(positions);
        for foot in &self.feet {
            let sum: Vector3 = foot.iter().map(|&n| nodes[n as usize].coords).sum();
            nodes.to_mut().push(Point3::from(sum / 4.0));
        }
        nodes
    }

    fn to_vertices(&self, mut gradient: Vec<Vector3>) -> Vec<Vector3> {
        for (i, foot) in self.feet.iter().enumerate().rev() {
            let share = gradient[self.vertices + i] / 4.0;
            for &n in foot {
                gradient[n as usize] += share;
            }
        }
        gradient.truncate(self.vertices);
        gradient
    }

    fn epsilon(&self, smallest: f64) -> (f64, bool) {
        match self.method {
            // 2 δ of Eq. 5.9, never 0.
            Method::Triangles => ((-2.0 * smallest).max(2e-3), true),
            Method::Corners => barrier(smallest),
        }
    }
}
