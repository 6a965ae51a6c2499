//! Surfaces for tests, and a look inside.
//!
//! With the feature `testing` only. The surfaces have known topology and directions, so that tests can tell what a
//! field on them must be; the functions below them open what the crate keeps to itself, for tests by closed forms.

use geom_core::compute::random::SplitMix64;
use geom_core::search::bvh::TriangleTree;
use geom_core::surface::ground::{Freedom, Ground};
use geom_core::surface::laplace::EdgeWeights;
use geom_core::{Cpu, Point3, QuadMesh, Run, TriMesh, Vector3};

use crate::backend::{ChartDistortion, CrossfieldObject};
use crate::field::{self, CrossField, Frames};
use crate::map::{Chart, MapOptions, Relaxation, Spacing};
pub use crate::map::{OfIntegers, Settled, Unfolded};
use crate::{Anisotropy, Error, anisotropy, guidance, quads};

/// A plate of `n × n` cells in the plane z = 0, a unit to a side, its inner vertices shaken by `noise` cells; cells for
/// which `hole` holds are missing.
///
/// The noise is the same in every run, and below 0.25 leaves all triangles upright. A disk; each hole inside of it adds a
/// boundary loop.
pub fn plate(n: u32, noise: f64, hole: impl Fn(u32, u32) -> bool) -> TriMesh {
    let mut random = SplitMix64::new(7);
    let cell = 1.0 / f64::from(n);
    let mut positions = Vec::new();
    for j in 0..=n {
        for i in 0..=n {
            let missing = |i: u32, j: u32| i >= n || j >= n || hole(i, j);
            let whole = i > 0 && j > 0 && (0..4).all(|k| !missing(i - k % 2, j - k / 2));
            let shake = if whole { noise * cell } else { 0.0 };
            let mut off = || shake * random.symmetric();
            let (x, y) = (f64::from(i) * cell + off(), f64::from(j) * cell + off());
            positions.push(Point3::new(x, y, 0.0));
        }
    }
    let at = |i: u32, j: u32| j * (n + 1) + i;
    let cells = (0..n).flat_map(|j| (0..n).map(move |i| (i, j)));
    let triangles = cells
        .filter(|&(i, j)| !hole(i, j))
        .flat_map(|(i, j)| {
            let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
            [[a, b, c], [a, c, d]]
        })
        .collect();
    without_unused(positions, triangles)
}

/// A tube about the z axis without ends: `around × along` cells.
///
/// Two boundary loops, flat quads halved; `around` is 3 or more.
pub fn tube(radius: f64, height: f64, around: u32, along: u32) -> TriMesh {
    let at = |i: u32, j: u32| j * around + i % around;
    let positions = (0..=along)
        .flat_map(|j| (0..around).map(move |i| (i, j)))
        .map(|(i, j)| {
            let angle = std::f64::consts::TAU * f64::from(i) / f64::from(around);
            let z = height * f64::from(j) / f64::from(along);
            Point3::new(radius * angle.cos(), radius * angle.sin(), z)
        })
        .collect();
    let triangles = (0..along)
        .flat_map(|j| (0..around).map(move |i| (i, j)))
        .flat_map(|(i, j)| {
            let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
            [[a, b, c], [a, c, d]]
        })
        .collect();
    TriMesh::new(positions, triangles).expect("a valid tube")
}

/// The surface of a box from the origin, each side of `n × n` cells.
///
/// Closed and outward, with `12 n²` triangles and `6 n² + 2` vertices.
pub fn cuboid(extent: Vector3, n: u32) -> TriMesh {
    let (mut positions, mut triangles) = (Vec::new(), Vec::new());
    let mut number = std::collections::BTreeMap::new();
    for axis in 0..3usize {
        for top in [false, true] {
            let mut vertex = |i: u32, j: u32| {
                let mut p = [0; 3];
                p[axis] = if top { n } else { 0 };
                p[(axis + 1) % 3] = i;
                p[(axis + 2) % 3] = j;
                *number.entry(p).or_insert_with(|| {
                    let part = [0, 1, 2].map(|c| f64::from(p[c]) / f64::from(n) * extent[c]);
                    positions.push(Point3::from(part));
                    positions.len() as u32 - 1
                })
            };
            for (i, j) in (0..n).flat_map(|i| (0..n).map(move |j| (i, j))) {
                let [a, b, c, d] =
                    [[0, 0], [1, 0], [1, 1], [0, 1]].map(|[x, y]| vertex(i + x, j + y));
                if top {
                    triangles.extend([[a, b, c], [a, c, d]]);
                } else {
                    triangles.extend([[a, c, b], [a, d, c]]);
                }
            }
        }
    }
    TriMesh::new(positions, triangles).expect("a valid box")
}

/// Renumbers, so that no vertex is left that cells with holes have lost.
fn without_unused(positions: Vec<Point3>, triangles: Vec<[u32; 3]>) -> TriMesh {
    let mut used: Vec<u32> = triangles.iter().flatten().copied().collect();
    used.sort_unstable();
    used.dedup();
    let place = |v: u32| used.partition_point(|&u| u < v) as u32;
    let kept = used.iter().map(|&v| positions[v as usize]).collect();
    let triangles = triangles.iter().map(|t| t.map(place)).collect();
    TriMesh::new(kept, triangles).expect("a valid plate")
}

/// The triangles that are left of a map of a field when all its regular vertices are taken out, before anything is an integer;
/// `None` if one of them cannot be, or a corner that stays is no integer.
pub fn decimated(
    mesh: &TriMesh,
    frames: &Frames,
    field: &CrossField,
    options: &MapOptions,
) -> Result<Option<usize>, Error> {
    let run = Run::on(&Cpu).with(Cpu.as_crossfield());
    crate::map::decimated(mesh, frames, field, options, run)
}

/// How many times as long as they are the sides of the triangles are wanted where a map of a field starts to unfold.
pub fn sizes(mesh: &TriMesh, frames: &Frames, field: &CrossField) -> Result<Vec<f64>, Error> {
    crate::map::sizes(mesh, frames, field)
}

/// The smallest eigenvalue of the symmetric part of a triangle's Jacobian, and what a map is charged for it.
pub fn monotone(chart: &Chart, uv: &[[f64; 2]; 3]) -> (f64, ChartDistortion) {
    crate::map::monotone(chart, uv)
}

/// How many triangles of the best map without integers are not monotone, and how many of what becomes of it.
pub fn aligned(
    mesh: &TriMesh,
    frames: &Frames,
    field: &CrossField,
    options: &MapOptions,
) -> Result<[usize; 2], Error> {
    let run = Run::on(&Cpu).with(Cpu.as_crossfield());
    crate::map::aligned(mesh, frames, field, options, run)
}

/// How much work the best map without integers costs to untangle as a whole, in evaluations of all triangles; `None` if it stays
/// folded.
pub fn untangling_cost(
    mesh: &TriMesh,
    frames: &Frames,
    field: &CrossField,
    options: &MapOptions,
) -> Result<Option<f64>, Error> {
    let run = Run::on(&Cpu).with(Cpu.as_crossfield());
    crate::map::untangling_cost(mesh, frames, field, options, run)
}

/// The best map without integers, unfolded within so many rings around what is folded, all places at once and one by one.
pub fn unfolded_places(
    rings: usize,
    mesh: &TriMesh,
    frames: &Frames,
    field: &CrossField,
    options: &MapOptions,
) -> Result<Unfolded, Error> {
    let run = Run::on(&Cpu).with(Cpu.as_crossfield());
    crate::map::unfolded_places(rings, mesh, frames, field, options, run)
}

/// A map with triangles that are barely upright after it has settled, for so many evaluations of each; `None` where there is none.
pub fn settled(
    evaluations: usize,
    mesh: &TriMesh,
    frames: &Frames,
    field: &CrossField,
    options: &MapOptions,
) -> Result<Option<Settled>, Error> {
    let run = Run::on(&Cpu).with(Cpu.as_crossfield());
    crate::map::settled(evaluations, mesh, frames, field, options, run)
}

/// What comes of a map that may cost so many evaluations of a triangle to unfold, and so many for its integers.
pub fn parameterized_within(
    evaluations: [u64; 2],
    mesh: &TriMesh,
    frames: &Frames,
    field: &CrossField,
    options: &MapOptions,
) -> Result<(), Error> {
    let run = Run::on(&Cpu).with(Cpu.as_crossfield());
    crate::map::parameterized_within(evaluations, mesh, frames, field, options, run)
}

/// [`parameterize`](crate::map::parameterize) as if more than so many integers were many: they are paired, and rounded region by region.
pub fn parameterized_by_regions(
    most_dense: usize,
    mesh: &TriMesh,
    frames: &Frames,
    field: &CrossField,
    options: &MapOptions,
) -> Result<crate::map::GridMap, Error> {
    let run = Run::on(&Cpu).with(Cpu.as_crossfield());
    crate::map::whole_map(mesh, frames, field, options, most_dense, run)
}

/// How much work maps of a field without integers cost to unfold, in evaluations of all triangles, one after the other; `None`
/// for one that stays folded.
pub fn unfolding_costs(
    mesh: &TriMesh,
    frames: &Frames,
    field: &CrossField,
    options: &[MapOptions],
) -> Result<Vec<Option<f64>>, Error> {
    let run = Run::on(&Cpu).with(Cpu.as_crossfield());
    crate::map::unfolding_costs(mesh, frames, field, options, run)
}

/// What is made of a field's integers, where its map does not fold.
pub fn of_integers(
    mesh: &TriMesh,
    frames: &Frames,
    field: &CrossField,
    options: &MapOptions,
) -> Result<OfIntegers, Error> {
    let run = Run::on(&Cpu).with(Cpu.as_crossfield());
    crate::map::of_integers(mesh, frames, field, options, run)
}

/// Turns the crosses of these triangles towards the gradients of a map, given as Jacobians; whether any moved.
pub fn turn(
    frames: &Frames,
    field: &mut CrossField,
    free: &[usize],
    jacobians: Vec<[[f64; 2]; 2]>,
    rate: f64,
) -> bool {
    let relaxed = Relaxation {
        jacobians,
        faults: 0,
        energy: 0.0,
    };
    anisotropy::turn(frames, field, free, &relaxed, rate)
}

/// The angle by which a cross turns, radians.
pub fn turned_by(jacobian: &[[f64; 2]; 2], rate: f64) -> f64 {
    anisotropy::turned_by(jacobian, rate)
}

/// The spacing, in units of that without a ratio, of lines whose normal has this cosine with the gradient.
pub fn narrowed(ratio: f64, cosine: f64) -> f64 {
    anisotropy::narrowed(ratio, cosine)
}

/// The ratio of sides where a function is so steep.
pub fn ratio_at(steepness: f64, options: &Anisotropy) -> f64 {
    anisotropy::ratio_at(steepness, options)
}

/// Values at the vertices of another mesh: those of the nearest points.
pub fn carried(
    tree: &TriangleTree,
    from: &TriMesh,
    values: &[f64],
    to: &TriMesh,
) -> Result<Vec<f64>, Error> {
    anisotropy::carried(tree, from, values, to)
}

/// Pairs of singularities nearer to each other than so many sides of a quad cost more.
pub const NEAR: f64 = field::NEAR;

/// What removing a pair of singularities so far apart may cost, where those far apart cost `far` and quads have a side `near`.
pub fn price(far: f64, near: f64, distance: f64) -> f64 {
    field::price(far, near, distance)
}

/// How many modes stand apart from those above.
pub fn standing_apart(values: &[f64]) -> usize {
    guidance::standing_apart(values)
}

/// Along the first arm after `comb` quarter turns, and along the second.
pub fn spacing_of_face(spacing: &Spacing, face: usize, comb: u8) -> [f64; 2] {
    spacing.of_face(face, comb)
}

/// A mesh with these triangles cut into four, its frames, and the field that goes on in the pieces.
pub fn in_pieces(
    mesh: &TriMesh,
    frames: &Frames,
    field: &CrossField,
    is_cut: &[bool],
) -> Result<(TriMesh, Frames, CrossField), Error> {
    let cuts = quads::Cuts::of(mesh, is_cut)?;
    let pieces = cuts.of_mesh(mesh)?;
    let after = Frames::of(&pieces, EdgeWeights::One)?;
    let turns = cuts.turns(mesh, &pieces);
    let field = field.in_pieces(frames, &after, &cuts.parents, &turns, &cuts.sides);
    Ok((pieces, after, field))
}

/// What the sides of a quad shall be long.
pub fn lengths(quad: &[Point3; 4], narrowest: f64) -> [f64; 2] {
    quads::lengths(quad, narrowest)
}

/// The inverse of a positive definite matrix, row after row, as rounding computes it.
pub fn inverse(matrix: &[f64], n: usize) -> Option<Vec<f64>> {
    crate::map::inverse(matrix, n)
}

/// The integers to which the minimum of `½ zᵀ S z − sᵀ z` is rounded one by one, for a positive definite S, row after row.
pub fn rounded(matrix: &[f64], right: &[f64]) -> Option<Vec<f64>> {
    crate::map::rounded(matrix, right)
}

/// Moves of one integer or two by one, from 0 on, that shall keep sums of integers with coefficients at −1 or above. `2 k` takes
/// one from integer `k`, `2 k + 1` adds one; twice the same integer is the first of both alone. Those are made that descent finds
/// to keep them. Per move what descent finds, which remembers what it has found before, and what the sums say.
pub fn guarded(count: usize, conditions: &[Sum], moves: &[[usize; 2]]) -> Vec<[bool; 2]> {
    crate::map::guarded(count, conditions, moves)
}

/// Integers by their numbers, with coefficients.
pub type Sum = Vec<(u32, i64)>;

/// Integers near `z` that turn triangles upright; `None` if none are found. Of each triangle the sides from its first corner to the second
/// and the third, as sums of integers, and what they are in the relaxed map.
pub fn mended(
    triangles: &[[[Sum; 2]; 2]],
    relaxed: &[[[f64; 2]; 2]],
    z: &[f64],
) -> Result<Option<Vec<f64>>, Error> {
    let run = Run::on(&Cpu).with(Cpu.as_crossfield());
    Ok(crate::map::mended(triangles, relaxed, z, run)?)
}

/// Vertices at better places on a surface, and other quads where no places are good.
pub fn improved(mesh: QuadMesh, surface: &TriMesh) -> Result<QuadMesh, Error> {
    let ground = Ground::new(surface, Vec::new())?;
    let freedom = vec![Freedom::Surface; mesh.positions().len()];
    let run = Run::on(&Cpu).with(Cpu.as_crossfield());
    quads::improve(mesh, 1.0, &ground, &freedom, run)
}

/// What one operation on a quad, or on one that touches it, may make of a mesh.
pub fn changes(mesh: &QuadMesh, quad: usize) -> Result<Vec<QuadMesh>, Error> {
    quads::changes(mesh, quad)
}
