//! What holds for spline surfaces.

use std::collections::{BTreeMap, BTreeSet};
use std::f64::consts::TAU;
use std::sync::OnceLock;

use geom_core::compute::random::SplitMix64;
use geom_core::mesh::{SurfaceAudit, shapes};
use geom_core::nalgebra::{DMatrix, DVector};
use geom_core::testing::same_on_any_threads;
use geom_core::{Cpu, Point3, QuadMesh, Run, Vector3};
use tspline::files::{Exchange, bext, iga, market, npz, step, vtu};
use tspline::surface::adapt::adapt;
use tspline::surface::bezier::bernstein;
use tspline::surface::errors::{errors, measures};
use tspline::surface::fit::{FitOptions, MeshTarget, Target, fit};
use tspline::surface::inverse::Search;
use tspline::surface::seams::Seams;
use tspline::surface::suitable::{GROWTH, meetings, suitable};
use tspline::surface::tessellate::tessellate;
use tspline::surface::{Jet, Sample, bezier_coefficients};
use tspline::{Basis, Error, Surface, TMesh, TMeshOptions, VertexKind, analysis};

fn cpu() -> Run<'static, Cpu> {
    Run::on(&Cpu)
}

struct Ball;
impl Target for Ball {
    fn closest(&self, to: &Point3) -> Point3 {
        Point3::from(to.coords.normalize())
    }
}

fn build(fine: &QuadMesh, basis: Basis, allowed: impl Fn(Point3) -> u8) -> Surface {
    let level = |q: &[u32; 4]| {
        let sum: Vector3 = q.iter().map(|&v| fine.positions()[v as usize].coords).sum();
        allowed(Point3::from(sum / 4.0))
    };
    let allowed: Vec<u8> = fine.quads().iter().map(level).collect();
    let mesh = TMesh::build(fine, &allowed, &TMeshOptions::default()).expect("a T-mesh");
    Surface::new(mesh, basis, cpu()).expect("a surface")
}

fn sphere(n: u32, basis: Basis, allowed: impl Fn(Point3) -> u8) -> Surface {
    let mut surface = build(&shapes::quad_sphere(1.0, n), basis, allowed);
    fit(&mut surface, &Ball, &FitOptions::default(), cpu()).expect("a fit");
    surface
}

/// A sphere of 16 × 16 elements per side of the cube, which several laws look at.
fn sphere_of_16() -> &'static Surface {
    static SPHERE: OnceLock<Surface> = OnceLock::new();
    SPHERE.get_or_init(|| sphere(16, Basis::Hierarchical, |_| 0))
}

/// A corner of the sphere is fine, with steps of levels that do not run along the quads.
fn oblique(p: Point3) -> u8 {
    let height = p.x + p.y + 0.3 * p.z;
    if height > 1.0 {
        0
    } else if height > 0.3 {
        1
    } else {
        2
    }
}

/// `n × m` unit quads in a plane, aslant.
fn plane(n: u32, m: u32) -> QuadMesh {
    let at = |i: u32, j: u32| {
        let (x, y) = (f64::from(i), f64::from(j));
        Point3::new(x + 0.2 * y, y, 0.5 * x - 0.1 * y)
    };
    let positions = (0..=m).flat_map(|j| (0..=n).map(move |i| at(i, j)));
    let corner = |i: u32, j: u32| i + j * (n + 1);
    let quads = (0..m).flat_map(|j| {
        (0..n).map(move |i| {
            [
                corner(i, j),
                corner(i + 1, j),
                corner(i + 1, j + 1),
                corner(i, j + 1),
            ]
        })
    });
    QuadMesh::new(positions.collect(), quads.collect()).expect("a plane")
}

/// `valence` quads around a vertex, each cut into `n × n`.
fn fan(valence: u32, times: u8) -> QuadMesh {
    let around = |k: f64, r: f64| {
        let angle = std::f64::consts::TAU * k / f64::from(valence);
        Point3::new(r * angle.cos(), r * angle.sin(), 0.1 * r * r)
    };
    let mut positions = vec![Point3::origin()];
    for k in 0..valence {
        positions.extend([around(k.into(), 1.0), around(f64::from(k) + 0.5, 1.4)]);
    }
    let quads = (0..valence).map(|k| [0, 1 + 2 * k, 2 + 2 * k, 1 + 2 * ((k + 1) % valence)]);
    let coarse = QuadMesh::new(positions, quads.collect()).expect("a fan");
    tspline::mesh::refined(&coarse, times).expect("refined")
}

/// Relative errors of the eigenvalues of degree 1, 2, 3 on the unit sphere.
fn spectrum(surface: &Surface) -> [f64; 3] {
    let matrices = analysis::matrices(surface).expect("matrices");
    let pairs = analysis::eigenpairs(&matrices, 16, cpu()).expect("pairs");
    [1, 2, 3].map(|l| {
        let exact = (l * (l + 1)) as f64;
        let of = &pairs.values[l * l..(l + 1) * (l + 1)];
        of.iter()
            .map(|v| (v / exact - 1.0).abs())
            .fold(0.0, f64::max)
    })
}

#[test]
fn eigenvalues_of_the_sphere_and_their_order() {
    let table = [
        (4, 98, [1.8e-5, 2.8e-4, 8.4e-4]),
        (8, 386, [1.4e-6, 3.1e-5, 6.9e-5]),
        (16, 1538, [8.7e-8, 3.7e-6, 8.1e-6]),
    ];
    let mut found = Vec::new();
    for (n, functions, errors) in table {
        let surface = match n {
            16 => sphere_of_16(),
            _ => &sphere(n, Basis::Hierarchical, |_| 0),
        };
        assert_eq!(surface.controls().len(), functions);
        let of = spectrum(surface);
        for (a, b) in of.iter().zip(errors) {
            assert!(*a < 1.5 * b, "{n}: {of:?}");
        }
        found.push(of);
    }
    for l in [1, 2] {
        let order = (found[1][l] / found[2][l]).log2();
        assert!(order > 2.8, "order {order}");
    }
    // What is finer never makes it worse: a cap, and a belt across the quads that is finer by two levels.
    let cap = sphere(16, Basis::Hierarchical, |p| u8::from(p.z + 0.4 * p.x < 0.6));
    let belt = sphere(32, Basis::Hierarchical, |p| {
        let off = ((p.x + p.y + 0.3 * p.z) / 1.446).abs();
        u8::from(off > 0.25) + u8::from(off > 0.1)
    });
    for of in [spectrum(&cap), spectrum(&belt)] {
        for (a, b) in of.iter().zip(found[1]) {
            assert!(*a <= b, "{of:?} against {:?}", found[1]);
        }
    }
    let matrices = analysis::matrices(&cap).expect("matrices");
    assert!(analysis::independence(&matrices, cpu()).expect("a number") > 1e-3);
}

#[test]
fn poisson_on_the_sphere() {
    let surface = sphere_of_16();
    let matrices = analysis::matrices(surface).expect("matrices");
    let harmonic = |p: &Point3| 3.0 * p.z * p.z - 1.0;
    let found = analysis::poisson(surface, &matrices, &|p| 6.0 * harmonic(p)).expect("solved");
    let (mut apart, mut size) = (0.0, 0.0);
    for e in 0..surface.mesh().elements().len() {
        let p = surface.evaluate(e, [0.4, 0.7]).point;
        let value = analysis::value(surface, &found, e, [0.4, 0.7]);
        apart += (value - harmonic(&p)).powi(2);
        size += harmonic(&p).powi(2);
    }
    let error = (apart / size).sqrt();
    assert!(error < 1e-4, "{error}");
}

/// Surfaces of all kinds: closed and open, of one level and of three, with vertices of 3…8 quads, and the smallest.
fn zoo() -> Vec<(&'static str, Surface)> {
    let h = Basis::Hierarchical;
    let mut zoo = vec![
        ("oblique", build(&shapes::quad_sphere(1.0, 24), h, oblique)),
        (
            "rational",
            build(&shapes::quad_sphere(1.0, 16), Basis::Rational, oblique),
        ),
        (
            "suitable",
            build(&shapes::quad_sphere(1.0, 16), Basis::Suitable, |p| {
                u8::from(p.x < 0.0)
            }),
        ),
        ("cube", build(&shapes::quad_sphere(1.0, 1), h, |_| 0)),
        (
            "cube, rational",
            build(&shapes::quad_sphere(1.0, 2), Basis::Rational, |_| 0),
        ),
        ("quad", build(&plane(1, 1), h, |_| 0)),
        ("strip", build(&plane(5, 1), h, |_| 0)),
        ("plane", build(&plane(20, 16), h, |p| u8::from(p.x > 6.0))),
    ];
    for valence in [3, 5, 8] {
        let coarse_outside = move |p: Point3| u8::from(p.coords.norm() > 0.9);
        zoo.push(("fan", build(&fan(valence, 0), h, |_| 0)));
        zoo.push(("fine fan", build(&fan(valence, 3), h, coarse_outside)));
    }
    zoo
}

#[test]
fn functions_are_a_partition_of_unity() {
    for (name, surface) in zoo() {
        let extraction = surface.extraction();
        let open = !surface.mesh().fine_edges().boundary_loops().is_empty();
        let mut met = vec![false; extraction.functions()];
        for patch in 0..extraction.patches().len() {
            let mut sums = [0.0; 16];
            for (&f, row) in extraction
                .on(patch)
                .iter()
                .zip(extraction.coefficients(patch))
            {
                met[f as usize] = true;
                assert!(row.iter().all(|&c| c >= 0.0), "{name}");
                sums.iter_mut().zip(row).for_each(|(s, c)| *s += c);
            }
            let weights = surface.patches()[patch].map(|p| p[3]);
            for (sum, weight) in sums.iter().zip(weights) {
                assert!(
                    (sum - weight).abs() < 1e-13 && (0.5..1.5).contains(&weight),
                    "{name} {sum}"
                );
            }
        }
        assert!(met.iter().all(|&m| m), "{name}: a function without support");
        // Functions beyond a boundary belong to it.
        let vertices = surface.mesh().positions().len();
        assert!(open || extraction.functions() <= vertices, "{name}");
    }
}

#[test]
fn patches_meet_without_gaps_and_smoothly() {
    for (name, surface) in zoo() {
        let seams = Seams::of(&surface);
        let mesh = surface.mesh();
        for segment in &seams.segments {
            let Some(other) = segment.other else { continue };
            let irregular = segment.ends.map(|c| {
                let fine = seams.corners[c as usize];
                let vertex = mesh.vertex_of_fine(fine);
                vertex
                    .is_some_and(|v| matches!(mesh.kind(v as usize), VertexKind::Extraordinary(_)))
                    || mesh.is_extraordinary(fine)
            });
            for share in [0.0, 0.3] {
                let [a, b] = [segment.owner, other]
                    .map(|s| Jet::of(&surface.patches()[s.patch as usize], s.at(share)));
                assert!((a.point - b.point).norm() < 1e-12, "{name}: a gap");
                if irregular == [false; 2] && !name.contains("rational") {
                    let (n, m) = (a.normal().expect("regular"), b.normal().expect("regular"));
                    let angle = n.cross(&m).norm().to_degrees();
                    assert!(angle < 1e-5, "{name}: a crease of {angle}°");
                }
            }
        }
        let triangles = tessellate(&surface, 3, cpu()).expect("triangles");
        let audit = SurfaceAudit::of(&triangles.mesh);
        let closed = seams.segments.iter().all(|s| s.other.is_some());
        assert_eq!(audit.is_closed_manifold(), closed, "{name}");
        let corners = triangles.parameters.iter().zip(triangles.mesh.triangles());
        for ((parameters, corners), &patch) in corners.zip(&triangles.patches) {
            for (at, &v) in parameters.iter().zip(corners) {
                let there = Jet::of(&surface.patches()[patch as usize], *at).point;
                let apart = (there - triangles.mesh.positions()[v as usize]).norm();
                assert!(apart < 1e-12, "{name}: {apart}");
            }
        }
    }
}

#[test]
fn creases_at_extraordinary_vertices_are_small_and_vanish() {
    for (n, largest) in [(4, 1.35), (8, 0.69), (16, 0.35)] {
        let surface = match n {
            16 => sphere_of_16(),
            _ => &sphere(n, Basis::Hierarchical, |_| 0),
        };
        let seams = Seams::of(surface);
        let mut worst: f64 = 0.0;
        for segment in &seams.segments {
            let sides = [Some(segment.owner), segment.other];
            let normals = sides.map(|s| {
                let s = s.expect("closed");
                Jet::of(&surface.patches()[s.patch as usize], s.at(0.0))
                    .normal()
                    .expect("regular")
            });
            worst = worst.max(normals[0].cross(&normals[1]).norm().asin().to_degrees());
        }
        assert!(worst < 1.5 * largest, "{n}: {worst}°");
    }
}

#[test]
fn planes_and_bicubics_are_reproduced() {
    let surface = build(&plane(32, 24), Basis::Hierarchical, |p| {
        u8::from(p.x > 9.0) + u8::from(p.x + p.y > 22.0)
    });
    let levels = surface.mesh().audit().levels;
    assert!(
        levels.len() == 3 && levels.iter().all(|&l| l > 0),
        "{levels:?}"
    );
    // Control points at the vertices: the plane itself, linear in the parameters.
    for (e, element) in surface.mesh().elements().iter().enumerate() {
        let corners = element
            .corners
            .map(|v| surface.mesh().positions()[v as usize]);
        let (s, t) = (0.3, 0.6);
        let wanted = corners[0] + (corners[1] - corners[0]) * s + (corners[3] - corners[0]) * t;
        let found = surface.evaluate(e, [s, t]).point;
        assert!((found - wanted).norm() < 1e-10, "{found} for {wanted}");
    }
    let mut random = SplitMix64::new(5);
    let c: [f64; 16] = std::array::from_fn(|_| 2.0 * random.unit() - 1.0);
    let bicubic = |p: &Point3| {
        // The parameters of the plane.
        let (x, y) = ((p.x - 0.2 * p.y) / 16.0 - 1.0, p.y / 12.0 - 1.0);
        (0..16)
            .map(|k| c[k] * x.powi(k as i32 % 4) * y.powi(k as i32 / 4))
            .sum::<f64>()
    };
    let matrices = analysis::matrices(&surface).expect("matrices");
    let found = analysis::projection(&surface, &matrices, &bicubic).expect("a projection");
    for e in 0..surface.mesh().elements().len() {
        let p = surface.evaluate(e, [0.9, 0.2]).point;
        let value = analysis::value(&surface, &found, e, [0.9, 0.2]);
        assert!(
            (value - bicubic(&p)).abs() < 1e-9,
            "{value} for {}",
            bicubic(&p)
        );
    }
}

/// How far the area per area of parameters of a cut surface is at most from that of the surface before, relatively: at the same
/// places, which are found by the vertices of the fine mesh.
fn area_apart(before: &Surface, after: &Surface) -> f64 {
    let (old, new) = (before.mesh(), after.mesh());
    let mut worst: f64 = 0.0;
    for (e, element) in new.elements().iter().enumerate() {
        let parent = old.element_of(new.fine_quads(e)[0] as usize) as usize;
        // Where its patches are those of its own level, they differ a little.
        let around = old.elements()[parent].corners;
        if around
            .iter()
            .any(|&v| old.is_extraordinary(old.fine_of_vertex(v as usize)))
        {
            continue;
        }
        let size = old.elements()[parent].size as usize;
        let grid = old.fine_vertices(parent);
        let place = |k: usize| {
            let fine = new.fine_of_vertex(element.corners[k] as usize);
            let at = grid
                .iter()
                .position(|&v| v == fine)
                .expect("a vertex of its parent");
            [at % (size + 1), at / (size + 1)].map(|x| x as f64 / size as f64)
        };
        let [a, b, d] = [place(0), place(1), place(3)];
        let (s, t) = (0.35, 0.6);
        let there = [0, 1].map(|k| a[k] + s * (b[k] - a[k]) + t * (d[k] - a[k]));
        let share = f64::from(element.size).powi(2) / (size as f64).powi(2);
        let [x, y] = [before.evaluate(parent, there), after.evaluate(e, [s, t])];
        let (x, y) = (x.area_vector() * share, y.area_vector());
        worst = worst.max((x - y).norm() / x.norm());
    }
    worst
}

#[test]
fn cutting_moves_nothing() {
    let closed = sphere(32, Basis::Hierarchical, oblique);
    let open = build(&plane(32, 24), Basis::Hierarchical, |p| {
        2 * u8::from(p.x > 9.0)
    });
    let mut random = SplitMix64::new(3);
    for mut surface in [closed, open] {
        let controls = surface.controls().iter();
        let shaken = controls.map(|p| p + Vector3::new(0.0, 0.0, 0.02 * random.unit()));
        surface
            .set_controls(shaken.collect(), cpu())
            .expect("finite");
        let elements = surface.mesh().elements();
        // Far from the extraordinary vertices.
        let far = |e: &usize| {
            let p = surface.evaluate(*e, [0.5, 0.5]).point;
            elements[*e].level > 0 && p.iter().any(|c| c.abs() > 0.95)
        };
        let coarse: Vec<usize> = (0..elements.len()).filter(far).step_by(3).collect();
        assert!(coarse.len() > 5);
        let finer = surface
            .cut(&coarse, &TMeshOptions::default(), cpu())
            .expect("cut");
        assert!(finer.mesh().elements().len() >= elements.len() + 3 * coarse.len());
        let (a, b) = (
            measures(&surface, cpu()).unwrap(),
            measures(&finer, cpu()).unwrap(),
        );
        assert!(area_apart(&surface, &finer) < 1e-10);
        // The area is no polynomial, and smaller patches are integrated better.
        assert!((a[0] / b[0] - 1.0).abs() < 1e-5, "{a:?} {b:?}");
        assert!(
            (a[1] - b[1]).abs() < 1e-12 * (1.0 + a[1].abs()),
            "{a:?} {b:?}"
        );
        let search = Search::new(&surface).expect("a tree");
        for e in (0..finer.mesh().elements().len()).step_by(5) {
            let near = search.nearest(&finer.evaluate(e, [0.3, 0.8]).point);
            assert!(near.distance < 4e-12, "moved by {}", near.distance);
        }
    }
    let rational = build(&shapes::quad_sphere(1.0, 4), Basis::Rational, |_| 0);
    assert_eq!(
        rational.cut(&[0], &TMeshOptions::default(), cpu()),
        Err(Error::NotNested)
    );
}

#[test]
fn rational_is_the_same_where_nothing_is_coarse_and_worse_where_it_is() {
    let [a, b] = [Basis::Hierarchical, Basis::Rational].map(|basis| sphere(8, basis, |_| 0));
    for (p, q) in a
        .patches()
        .iter()
        .flatten()
        .zip(b.patches().iter().flatten())
    {
        assert!((0..4).all(|k| (p[k] - q[k]).abs() < 1e-12), "{p:?} {q:?}");
    }
    let [a, b] = [Basis::Hierarchical, Basis::Rational]
        .map(|basis| sphere(16, basis, |p| u8::from(p.z + 0.4 * p.x < 0.6)));
    assert!(b.patches().len() > a.patches().len() && b.controls().len() > a.controls().len());
    let (of_a, of_b) = (spectrum(&a), spectrum(&b));
    assert!(of_b[0] > of_a[0] && of_b[0] < 1e-3, "{of_a:?} {of_b:?}");
    let weights = b.patches().iter().flatten().map(|p| (p[3] - 1.0).abs());
    // How far the plain sum of T-spline functions is from one.
    let defect = weights.fold(0.0, f64::max);
    assert!((0.05..0.4).contains(&defect), "{defect}");
}

/// Where all is regular, patches are those of uniform bicubic B-splines: each of the 4 × 4 functions has the tensor product of
/// the four pieces of the cubic one, and points are what de Boor's sum over control points says.
#[test]
fn regular_elements_carry_uniform_b_splines() {
    let knots = [-2, -1, 0, 1, 2];
    let pieces: Vec<[f64; 4]> = (0..4)
        .map(|k| bezier_coefficients(&knots, [1 - k, 2 - k]))
        .collect();
    let uniform = |t: f64| {
        let s = 1.0 - t;
        [
            s.powi(3) / 6.0,
            (3.0 * t.powi(3) - 6.0 * t * t + 4.0) / 6.0,
            (3.0 * s.powi(3) - 6.0 * s * s + 4.0) / 6.0,
            t.powi(3) / 6.0,
        ]
    };
    for basis in [Basis::Hierarchical, Basis::Rational, Basis::Suitable] {
        let wide = [12.0, 10.0];
        let (mesh, places) = torus(12, 10, |_, _| 0);
        let surface = Surface::new(mesh, basis, cpu()).unwrap();
        let (mesh, extraction) = (surface.mesh(), surface.extraction());
        for patch in (0..extraction.patches().len()).step_by(7) {
            // The rows, whatever their order, are the products of two pieces each.
            let mut expected: Vec<[f64; 16]> = (0..16)
                .map(|f| std::array::from_fn(|k| pieces[f % 4][k % 4] * pieces[f / 4][k / 4]))
                .collect();
            for row in extraction.coefficients(patch) {
                let same = |e: &[f64; 16]| e.iter().zip(row).all(|(a, b)| (a - b).abs() < 1e-14);
                let at = expected.iter().position(same).expect("a product of pieces");
                expected.swap_remove(at);
            }
            assert!(expected.is_empty(), "{basis:?}");
            // The sum over the vertices around the element, where the control points are.
            let element = extraction.patches()[patch].element as usize;
            let corner = mesh.elements()[element]
                .corners
                .map(|v| places[mesh.fine_of_vertex(v as usize) as usize]);
            let at = |i: f64, j: f64| {
                let along = |k: usize| {
                    let step = |from: usize| {
                        let by = corner[from][k] - corner[0][k];
                        if by.abs() > 1.5 { -by.signum() } else { by }
                    };
                    (corner[0][k] + i * step(1) + j * step(3)).rem_euclid(wide[k])
                };
                let place = [along(0), along(1)];
                let vertex = places.iter().position(|p| *p == place).expect("a vertex");
                mesh.fine().positions()[vertex].coords
            };
            let (s, t) = (0.3, 0.85);
            let mut wanted = Vector3::zeros();
            for (j, b) in uniform(t).into_iter().enumerate() {
                for (i, a) in uniform(s).into_iter().enumerate() {
                    wanted += at(i as f64 - 1.0, j as f64 - 1.0) * (a * b);
                }
            }
            let found = surface.evaluate(element, [s, t]).point.coords;
            assert!(
                (found - wanted).norm() < 1e-12,
                "{basis:?}: {found} for {wanted}"
            );
        }
    }
}

/// A T-mesh of a torus of so many fine quads, and where its fine vertices lie in them.
fn torus(n: u32, m: u32, level: impl Fn(f64, f64) -> u8) -> (TMesh, Vec<[f64; 2]>) {
    let fine = shapes::quad_torus(1.0, 0.4, n, m);
    let turned = |y: f64, x: f64, of: u32| {
        (y.atan2(x).rem_euclid(TAU) / TAU * f64::from(of)).round() % f64::from(of)
    };
    let place = |p: &Point3| {
        let across = p.x.hypot(p.y) - 1.0;
        [turned(p.y, p.x, n), turned(p.z, across, m)]
    };
    let places: Vec<[f64; 2]> = fine.positions().iter().map(place).collect();
    let allowed = fine.quads().iter().map(|q| {
        let at = |k: usize| {
            q.iter()
                .map(|&v| places[v as usize][k])
                .fold(f64::INFINITY, f64::min)
        };
        level(at(0), at(1))
    });
    let allowed: Vec<u8> = allowed.collect();
    (
        TMesh::build(&fine, &allowed, &TMeshOptions::default()).unwrap(),
        places,
    )
}

fn within(p: &[f64; 2], window: [[f64; 2]; 2]) -> bool {
    (0..2).all(|k| window[k][0] <= p[k] && p[k] <= window[k][1])
}

/// How far bicubics of the chart are from the functions on a part of a torus that is not wound around, at best: the largest
/// residual of least squares.
fn bicubics_missed(surface: &Surface, places: &[[f64; 2]], window: [[f64; 2]; 2]) -> f64 {
    let (mesh, extraction) = (surface.mesh(), surface.extraction());
    let within = |p: &[f64; 2]| within(p, window);
    let (mut rows, mut wanted) = (Vec::new(), Vec::new());
    let mut columns = BTreeMap::new();
    for (number, patch) in extraction.patches().iter().enumerate() {
        let vertices = mesh.fine_vertices(patch.element as usize);
        let size = mesh.elements()[patch.element as usize].size + 1;
        let at = |i: u32, j: u32| places[vertices[(i + size * j) as usize] as usize];
        let corner = at(patch.from[0], patch.from[1]);
        let ends = [
            at(patch.to[0], patch.from[1]),
            at(patch.from[0], patch.to[1]),
        ];
        if ![corner, ends[0], ends[1]].iter().all(within) {
            continue;
        }
        for i in 0..16 {
            let [s, t] = [f64::from(i % 4) / 3.0, f64::from(i / 4) / 3.0];
            let (a, b) = (bernstein(s)[0], bernstein(t)[0]);
            let basis: [f64; 16] = std::array::from_fn(|k| a[k % 4] * b[k / 4]);
            let points = &surface.patches()[number];
            let weight: f64 = points.iter().zip(basis).map(|(p, b)| p[3] * b).sum();
            let of = extraction
                .on(number)
                .iter()
                .zip(extraction.coefficients(number));
            rows.push(
                of.map(|(&f, row)| {
                    let next = columns.len();
                    let column = *columns.entry(f).or_insert(next);
                    let value: f64 = row.iter().zip(basis).map(|(c, b)| c * b).sum();
                    (column, value / weight)
                })
                .collect::<Vec<_>>(),
            );
            let along =
                |k: usize| corner[k] + s * (ends[0][k] - corner[k]) + t * (ends[1][k] - corner[k]);
            let half = |k: usize| {
                let middle = 0.5 * (window[k][0] + window[k][1]);
                (along(k) - middle) / (window[k][1] - middle)
            };
            let (x, y) = (half(0), half(1));
            wanted
                .push(x.powi(3) * y.powi(3) - 0.7 * x * x * y.powi(3) + 0.4 * x * y * y - x + 0.2);
        }
    }
    let mut matrix = DMatrix::zeros(rows.len(), columns.len());
    for (i, row) in rows.iter().enumerate() {
        for &(j, value) in row {
            matrix[(i, j)] = value;
        }
    }
    let wanted = DVector::from_vec(wanted);
    let found = matrix
        .clone()
        .svd(true, true)
        .solve(&wanted, 1e-12)
        .unwrap();
    (matrix * found - wanted).amax()
}

/// A band of a torus is fine: no extension meets another.
#[test]
fn suitable_t_splines_hold_bicubics_and_others_miss_them() {
    let rules = TMeshOptions::default();
    let window = [[4.0, 22.0], [4.0, 16.0]];
    let (mesh, places) = torus(32, 24, |x, _| u8::from(x > 11.5));
    assert_eq!(meetings(&mesh), 0);
    assert_eq!(suitable(mesh.clone(), 1.0, &rules).unwrap(), mesh);
    let [plain, divided] =
        [Basis::Suitable, Basis::Rational].map(|b| Surface::new(mesh.clone(), b, cpu()).unwrap());
    assert!(!plain.extraction().is_rational() && plain.mesh().audit().t_junctions > 0);
    // They sum to one without being divided.
    let weights = divided
        .patches()
        .iter()
        .flatten()
        .map(|p| (p[3] - 1.0).abs());
    assert!(weights.fold(0.0, f64::max) < 1e-14);
    let missed = bicubics_missed(&plain, &places, window);
    assert!(missed < 1e-10, "{missed}");
    // Control points at the means of knots carry what is linear: the torus laid flat, but for where it is wound around.
    let flat = places.iter().map(|p| Point3::new(p[0], p[1], p[0] - p[1]));
    let flat = QuadMesh::new(flat.collect(), mesh.fine().quads().to_vec()).unwrap();
    let flat = TMesh::build(&flat, &mesh.levels(), &rules).unwrap();
    let flat = Surface::new(flat, Basis::Suitable, cpu()).unwrap();
    let mut seen = [0; 2];
    for (e, element) in flat.mesh().elements().iter().enumerate() {
        let corners = element.corners.map(|v| flat.mesh().positions()[v as usize]);
        if corners.iter().any(|p| !within(&[p.x, p.y], window)) {
            continue;
        }
        let wanted = corners[0] + (corners[1] - corners[0]) * 0.3 + (corners[3] - corners[0]) * 0.8;
        let found = flat.evaluate(e, [0.3, 0.8]).point;
        assert!((found - wanted).norm() < 1e-10, "{found} for {wanted}");
        seen[usize::from(element.level)] += 1;
    }
    assert!(seen.iter().all(|&count| count > 10), "{seen:?}");
    // Corners of what is fine are not suitable: bicubics are missed by about a thousandth.
    let (mesh, places) = torus(32, 24, |x, y| u8::from(x > 11.5 || y > 7.5));
    let met = meetings(&mesh);
    assert!(met > 0);
    let before = mesh.elements().len();
    assert_eq!(
        Surface::new(mesh.clone(), Basis::Suitable, cpu()).err(),
        Some(Error::NotSuitable {
            meetings: met,
            elements: before,
            before
        })
    );
    let oblique = Surface::new(mesh.clone(), Basis::Rational, cpu()).unwrap();
    let missed = bicubics_missed(&oblique, &places, window);
    assert!((1e-4..1e-1).contains(&missed), "{missed}");
    // A step in the border of a band goes around as a whole.
    let (step, _) = torus(32, 24, |x, y| u8::from(x > 11.5 && !(x < 13.5 && y < 7.5)));
    let (even, _) = torus(32, 24, |x, _| u8::from(x > 13.5));
    assert!(meetings(&step) > 0);
    let made = suitable(step, GROWTH, &rules).unwrap();
    assert_eq!(made.levels(), even.levels());
    // Cut without end all are suitable; but that takes more than was allowed.
    let refused = suitable(mesh.clone(), GROWTH, &rules);
    assert!(
        matches!(refused, Err(Error::NotSuitable { meetings, .. }) if meetings == met),
        "{refused:?}"
    );
    let all = suitable(mesh, f64::INFINITY, &rules).unwrap();
    assert!(meetings(&all) == 0 && all.audit().is_valid());
}

/// Extensions, laid in the plane and found by the rectangles of elements: where those along both directions have a point in
/// common.
#[test]
fn what_t_junctions_reach() {
    let (n, m) = (48, 40);
    let (mesh, places) = torus(n, m, |x, y| {
        u8::from(x > 11.5 || y > 7.5) + u8::from(x > 25.5 && y > 19.5)
    });
    assert_eq!(mesh.audit().levels.len(), 3);
    let wide = [n, m].map(|k| k as i32);
    let rectangles: Vec<[[i32; 2]; 2]> = (0..mesh.elements().len())
        .map(|e| {
            let size = mesh.elements()[e].size as i32;
            let quad = mesh.fine_quads(e).iter().map(|&q| {
                mesh.fine().quads()[q as usize].map(|v| places[v as usize].map(|x| x as i32))
            });
            // The corner from which all others are less than the element away.
            let corners: Vec<[i32; 2]> = quad.flatten().collect();
            let low = [0, 1].map(|k| {
                let near = |a: i32| {
                    corners
                        .iter()
                        .all(|c| (c[k] - a).rem_euclid(wide[k]) <= size)
                };
                corners.iter().map(|c| c[k]).find(|&a| near(a)).unwrap()
            });
            [low, low.map(|x| x + size)]
        })
        .collect();
    // Where a point lies in a rectangle, and in none.
    let within = |p: [i32; 2], r: &[[i32; 2]; 2]| {
        let at = [0, 1].map(|k| (p[k] - r[0][k]).rem_euclid(wide[k]));
        let size = r[1][0] - r[0][0];
        at.iter().all(|&x| x <= size).then_some((at, size))
    };
    let around = |p: [i32; 2]| rectangles.iter().filter_map(move |r| within(p, r));
    let mut reached = [BTreeSet::new(), BTreeSet::new()];
    for v in (0..mesh.positions().len()).filter(|&v| mesh.kind(v) == VertexKind::TJunction) {
        let p = places[mesh.fine_of_vertex(v) as usize].map(|x| x as i32);
        // The element on whose side it lies has it in the middle of one.
        let (at, size) = around(p)
            .find(|(at, size)| (0..2).any(|k| (1..*size).contains(&at[k])))
            .unwrap();
        let axis = usize::from(at[0] > 0 && at[0] < size);
        let on = if at[axis] == 0 { 1 } else { -1 };
        for (step, mut knots) in [(on, 2), (-on, 1)] {
            let mut q = p;
            reached[axis].insert(q);
            while knots > 0 {
                q[axis] = (q[axis] + step).rem_euclid(wide[axis]);
                reached[axis].insert(q);
                knots -= i32::from(around(q).any(|(at, size)| [0, size].contains(&at[axis])));
            }
        }
    }
    let both = reached[0].intersection(&reached[1]).count();
    assert!(both > 20, "{both}");
    assert_eq!(meetings(&mesh), both);
}

#[test]
fn suitable_t_splines_on_spheres() {
    // Half of it is fine, along a line of quads.
    let fine = shapes::quad_sphere(1.0, 16);
    let half = |p: Point3| u8::from(p.x < -0.01);
    let level = |q: &[u32; 4]| {
        let sum: Vector3 = q.iter().map(|&v| fine.positions()[v as usize].coords).sum();
        half(Point3::from(sum / 4.0))
    };
    let levels: Vec<u8> = fine.quads().iter().map(level).collect();
    let mesh = TMesh::build(&fine, &levels, &TMeshOptions::default()).unwrap();
    let made = |basis| {
        let mut surface = Surface::new(mesh.clone(), basis, cpu()).unwrap();
        fit(&mut surface, &Ball, &FitOptions::default(), cpu()).unwrap();
        surface
    };
    let [suitable, hierarchical] = [Basis::Suitable, Basis::Hierarchical].map(made);
    let matrices = analysis::matrices(&suitable).unwrap();
    assert!(analysis::independence(&matrices, cpu()).unwrap() > 1e-3);
    let [a, b] = [&suitable, &hierarchical].map(spectrum);
    for (x, y) in a.iter().zip(b) {
        assert!(*x < 1.2 * y, "{a:?} {b:?}");
    }
    assert_eq!(
        suitable.cut(&[0], &TMeshOptions::default(), cpu()).err(),
        Some(Error::NotNested)
    );
    let open = build(&plane(4, 4), Basis::Hierarchical, |_| 0)
        .mesh()
        .clone();
    assert!(matches!(
        Surface::new(open, Basis::Suitable, cpu()),
        Err(Error::Open { .. })
    ));
}

#[test]
fn nearest_points_are_found_across_seams() {
    let surface = sphere(16, Basis::Hierarchical, |p| u8::from(p.z < 0.5));
    let search = Search::new(&surface).expect("a tree");
    for e in (0..surface.mesh().elements().len()).step_by(11) {
        for at in [[0.5, 0.2], [0.0, 0.7], [0.99, 0.01]] {
            let jet = surface.evaluate(e, at);
            let Some(normal) = jet.normal() else { continue };
            let found = search.nearest(&(jet.point + normal * 0.1));
            assert!((found.distance - 0.1).abs() < 1e-4, "{found:?}");
            let on = search.nearest(&jet.point);
            assert!(on.distance < 1e-12, "{on:?}");
        }
    }
}

#[test]
fn curvatures_of_the_sphere() {
    let surface = sphere_of_16();
    for (e, element) in surface.mesh().elements().iter().enumerate() {
        let [mean, gauss] = surface
            .evaluate(e, [0.5, 0.5])
            .curvatures()
            .expect("regular");
        let worst = (mean - 1.0).abs().max((gauss - 1.0).abs());
        // Bounded, but not continuous, at the extraordinary vertices.
        let kind = |&v: &u32| surface.mesh().kind(v as usize);
        let regular = element
            .corners
            .iter()
            .all(|v| kind(v) == VertexKind::Regular);
        assert!(worst < if regular { 0.05 } else { 0.3 }, "{worst}");
    }
}

#[test]
fn a_fit_reaches_its_tolerance() {
    let quads = shapes::quad_sphere(1.0, 16);
    let mesh = TMesh::build(
        &quads,
        &vec![2; quads.quads().len()],
        &TMeshOptions::default(),
    );
    let target = shapes::ellipsoid(Vector3::new(1.0, 0.8, 1.3), 4);
    let adapted = adapt(
        mesh.unwrap(),
        Basis::Hierarchical,
        &target,
        4e-3,
        &FitOptions::default(),
        cpu(),
    );
    let adapted = adapted.expect("a surface");
    assert!(adapted.reached, "{:?}", adapted.rounds);
    assert!(adapted.rounds.len() > 1 && adapted.errors.hausdorff <= 4e-3);
    // What is fine without need becomes coarse again.
    let (rules, fit) = (TMeshOptions::default(), FitOptions::default());
    let quads = shapes::quad_sphere(1.0, 8);
    let coarse = TMesh::build(&quads, &[1; 384], &rules).unwrap();
    let all: Vec<usize> = (0..coarse.elements().len()).collect();
    let fine = coarse.cut(&all, &rules).unwrap();
    assert_eq!(fine.merge(&[0, 1, 2], &rules).unwrap(), fine);
    let all: Vec<usize> = (0..fine.elements().len()).collect();
    assert_eq!(fine.merge(&all, &rules).unwrap(), coarse);
    assert!(fine.merge(&[all.len()], &rules).is_err());
    let back = adapt(fine, Basis::Hierarchical, &target, 0.03, &fit, cpu());
    let back = back.expect("a surface");
    let [before, after] = [&back.rounds[0], &back.rounds[1]];
    assert!(back.reached && after.pruned && after.functions < before.functions);
    assert!(back.surface.mesh().audit().is_valid() && back.errors.to_mesh <= 0.03);
    let [a, b] = [adapted.errors.volume, adapted.errors.mesh_volume].map(Option::unwrap);
    assert!((a / b - 1.0).abs() < 2e-3);
}

/// Every place is on it.
struct Everywhere;
impl Target for Everywhere {
    fn closest(&self, to: &Point3) -> Point3 {
        *to
    }
}

#[test]
fn what_is_where_it_should_be_stays() {
    // Bending of the surface itself would draw it inwards, more so the coarser it is.
    let before = sphere(8, Basis::Hierarchical, |p| u8::from(p.z > 0.0));
    let mut after = before.clone();
    let options = FitOptions {
        rounds: 1,
        ..FitOptions::default()
    };
    fit(&mut after, &Everywhere, &options, cpu()).expect("a fit");
    for (a, b) in before.controls().iter().zip(after.controls()) {
        assert!((a - b).norm() < 1e-9, "{a} {b}");
    }
}

#[test]
fn rims_are_met() {
    let dome = |mesh: QuadMesh, scale: f64| {
        let up = |p: &Point3| {
            let (x, y) = (scale * (p.x - 0.2 * p.y), scale * p.y);
            Point3::new(x, y, 0.03 * (x * x + y * y) + 0.1 * x * y)
        };
        let positions = mesh.positions().iter().map(up).collect();
        QuadMesh::new(positions, mesh.quads().to_vec()).expect("a dome")
    };
    let target = dome(plane(64, 48), 0.125).into_triangles();
    let mut surface = build(&dome(plane(16, 12), 0.5), Basis::Hierarchical, |p| {
        u8::from(p.x > 4.0)
    });
    assert!(surface.mesh().audit().levels.len() == 2);
    let near = MeshTarget::new(&target).expect("a target");
    fit(&mut surface, &near, &FitOptions::default(), cpu()).expect("a fit");
    let seams = Seams::of(&surface);
    for segment in seams.segments.iter().filter(|s| s.other.is_none()) {
        for share in [0.0, 0.5] {
            let owner = &segment.owner;
            let p = Jet::of(&surface.patches()[owner.patch as usize], owner.at(share)).point;
            let apart = (near.closest_on_rim(&p).expect("a rim") - p).norm();
            assert!(apart < 0.02, "{apart} Å from the rim of 20 Å");
        }
    }
    let (errors, _) = errors(&surface, &target, cpu()).expect("errors");
    assert!(errors.hausdorff < 0.02 && errors.rms < 2e-3, "{errors:?}");
}

/// Along a rim that goes in steps functions depend on each other: what nothing determines stays where it is.
#[test]
fn rims_may_go_in_steps() {
    let whole = plane(12, 12);
    let inside = |q: &&[u32; 4]| {
        let p = q.map(|v| whole.positions()[v as usize]);
        p.iter().all(|p| p.x + 0.8 * p.y <= 18.1)
            && !p
                .iter()
                .all(|p| (3.0..=6.0).contains(&p.x) && (3.0..=6.0).contains(&p.y))
    };
    let quads: Vec<[u32; 4]> = whole.quads().iter().filter(inside).copied().collect();
    let mut used: Vec<u32> = quads.as_flattened().to_vec();
    used.sort_unstable();
    used.dedup();
    let number = |v: u32| used.binary_search(&v).expect("used") as u32;
    let quads = quads.iter().map(|q| q.map(number)).collect();
    let positions = used.iter().map(|&v| whole.positions()[v as usize]);
    let stepped = QuadMesh::new(positions.collect(), quads).expect("a mesh");
    let target = stepped.clone().into_triangles();
    let near = MeshTarget::new(&target).expect("a target");
    let mut surface = build(&stepped, Basis::Hierarchical, |_| 0);
    fit(&mut surface, &near, &FitOptions::default(), cpu()).expect("a fit");
    let (errors, _) = errors(&surface, &target, cpu()).expect("errors");
    assert!(errors.hausdorff < 1e-4 && errors.rms < 1e-6, "{errors:?}");
}

fn text(write: impl FnOnce(&mut dyn std::io::Write) -> std::io::Result<()>) -> String {
    let mut out = Vec::new();
    write(&mut out).expect("memory");
    String::from_utf8(out).expect("text")
}

#[test]
fn files_are_read_as_they_were_written() {
    for basis in [Basis::Hierarchical, Basis::Rational] {
        let surface = sphere(16, basis, oblique);
        let exchange = Exchange::from(&surface);
        let again = iga::read(&text(|out| iga::write(out, &exchange))).expect("iga");
        assert!(again == exchange);
        assert_eq!(again.patches().unwrap().len(), surface.patches().len());
        // Elements come back sorted by their number of nodes.
        let again = bext::read(&text(|out| bext::write(out, &exchange))).expect("bext");
        let mut sorted = exchange.clone();
        sorted.elements.sort_by_key(|e| e.nodes.len());
        assert!(again == sorted);
        let zeros = vec![0.0; surface.mesh().elements().len()];
        let file = text(|out| vtu::write(out, &surface, &[("\"a\" < b", &zeros)]));
        assert!(file.contains("RationalWeights") && file.contains("77 77"));
        assert!(file.contains("Name=\"&#34;a&#34; &#60; b\""));
        let file = text(|out| step::write(out, &surface, "a 'sphere'"));
        assert_eq!(
            file.matches("ADVANCED_FACE").count(),
            surface.patches().len()
        );
        assert_eq!(
            file.matches("EDGE_CURVE(").count(),
            Seams::of(&surface).segments.len()
        );
        assert!(file.contains("CLOSED_SHELL"));
    }
    let surface = sphere(4, Basis::Hierarchical, |_| 0);
    let mass = analysis::matrices(&surface).expect("matrices").mass;
    let file = text(|out| market::write_symmetric(out, &mass));
    let entries = (mass.entries() + mass.rows()) / 2;
    assert_eq!(file.lines().nth(1), Some(&*format!("98 98 {entries}")));
    assert_eq!(file.lines().count(), entries + 2);
    let mut archive = Vec::new();
    npz::write(&mut archive, &mass).expect("written");
    let has = |bytes: &[u8]| archive.windows(bytes.len()).any(|w| w == bytes);
    assert!(archive.starts_with(b"PK\x03\x04") && has(b"data.npy\x93NUMPY"));
    let values: Vec<u8> = mass.values().iter().flat_map(|x| x.to_le_bytes()).collect();
    assert!(has(&values) && has(b"'descr': '<i4', 'fortran_order': False, 'shape': (99,)"));
}

#[test]
fn damaged_files_are_refused() {
    let surface = sphere(1, Basis::Hierarchical, |_| 0);
    let exchange = Exchange::from(&surface);
    let files = [
        text(|out| iga::write(out, &exchange)),
        text(|out| bext::write(out, &exchange)),
    ];
    let mut random = SplitMix64::new(1);
    for case in 0..400 {
        let mut words: Vec<&str> = files[case % 2].split_inclusive([' ', '\n']).collect();
        let at = (random.unit() * words.len() as f64) as usize;
        match case % 3 {
            0 => words.truncate(at),
            1 => words[at] = "4294967295 ",
            _ => words[at] = "x ",
        }
        let file: String = words.concat();
        // An error or another surface, but no panic.
        let _ = if case % 2 == 0 {
            iga::read(&file)
        } else {
            bext::read(&file)
        };
    }
    assert!(matches!(
        iga::read("type solid"),
        Err(Error::File { line: 1, .. })
    ));
    assert!(matches!(bext::read(""), Err(Error::File { .. })));
}

#[test]
fn what_cannot_be_is_refused() {
    let mut surface = build(&plane(2, 2), Basis::Hierarchical, |_| 0);
    assert!(matches!(
        surface.set_controls(Vec::new(), cpu()),
        Err(Error::Count { .. })
    ));
    let mut controls = surface.controls().to_vec();
    controls[3].y = f64::NAN;
    assert_eq!(
        surface.set_controls(controls, cpu()),
        Err(Error::NotFinite { control: 3 })
    );
    let mesh = surface.mesh().clone();
    assert!(matches!(
        Surface::new(mesh, Basis::Rational, cpu()),
        Err(Error::Open { .. })
    ));
    assert!(matches!(
        tessellate(&surface, 1, cpu()),
        Err(Error::Option(_))
    ));
    let options = FitOptions {
        rounds: 0,
        ..FitOptions::default()
    };
    assert!(matches!(
        fit(&mut surface, &Ball, &options, cpu()),
        Err(Error::Option(_))
    ));
}

#[test]
fn threads_change_nothing() {
    same_on_any_threads(|| {
        let surface = sphere(16, Basis::Hierarchical, oblique);
        let matrices = analysis::matrices(&surface).expect("matrices");
        (surface, matrices)
    });
    same_on_any_threads(|| build(&shapes::quad_sphere(1.0, 16), Basis::Rational, oblique));
}

#[test]
fn the_gpu_agrees() {
    use geom_core::compute::backend::Break;
    use tspline::backend::{BEZIER_POINTS, BEZIER_SAMPLES, PointsTask, SamplesTask, SplineBackend};
    let Some(gpu) = geom_core::testing::gpu_or_skip() else {
        return;
    };
    for basis in [Basis::Hierarchical, Basis::Rational] {
        let mut surface = sphere(16, basis, oblique);
        // Far from the origin, where f32 alone would see little.
        let far = surface
            .controls()
            .iter()
            .map(|p| p + Vector3::new(100.0, -50.0, 20.0));
        surface.set_controls(far.collect(), cpu()).expect("finite");
        let task = PointsTask {
            extraction: surface.extraction(),
            controls: surface.controls(),
        };
        let (mut a, mut b) = (Vec::new(), Vec::new());
        Cpu.bezier_points(&task, &mut a).expect("points");
        gpu.bezier_points(&task, &mut b).expect("points");
        let of = |p: &[f64; 4]| [p[0] / p[3], p[1] / p[3], p[2] / p[3], p[3]];
        let [a, b] = [a, b].map(|p| p.iter().flatten().flat_map(of).collect::<Vec<f64>>());
        let broken: Option<Break> = BEZIER_POINTS.first_break(&a, &b);
        assert_eq!(broken, None);

        let task = SamplesTask {
            patches: surface.patches(),
            parameters: &[0.0, 0.3, 0.5, 0.9, 1.0],
        };
        let (mut a, mut b) = (Vec::new(), Vec::new());
        Cpu.bezier_samples(&task, &mut a).expect("samples");
        gpu.bezier_samples(&task, &mut b).expect("samples");
        let (s, t) = (task.parameters[3], task.parameters[1]);
        for (points, samples) in task.patches.iter().zip(a.chunks_exact(25)) {
            let (jet, sample) = (Jet::of(points, [s, t]), &samples[3 + 5]);
            let apart =
                (jet.point - sample.point).norm() + (jet.area_vector().norm() - sample.area).abs();
            assert!(
                apart < 1e-12 && (jet.normal().unwrap() - sample.normal).norm() < 1e-11,
                "{apart}"
            );
        }
        // Over the extent of a patch, at most half of one.
        let of = |s: &Sample| {
            let p = s.point.coords / 0.5;
            [
                p.x,
                p.y,
                p.z,
                s.normal.x,
                s.normal.y,
                s.normal.z,
                s.area / 0.25,
            ]
        };
        let [a, b] = [a, b].map(|s| s.iter().flat_map(of).collect::<Vec<f64>>());
        assert_eq!(BEZIER_SAMPLES.first_break(&a, &b), None);
    }
}
