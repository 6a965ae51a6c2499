//! Laws of T-meshes: whatever the levels, they are valid, nested and as coarse as their rules allow; better elements stay
//! on their surface.

use geom_core::mesh::{Halfedges, shapes};
use geom_core::testing::{cases, same_on_any_threads};
use geom_core::{Cpu, Point3, QuadMesh, Run, TriMesh, Vector3, VertexId};
use proptest::prelude::*;
use tspline::levels::{self, Places};
use tspline::mesh::{Record, refined};
use tspline::{
    CleanOptions, Error, Improved, Method, QualityOptions, TMesh, TMeshOptions, VertexKind, improve,
};

/// A flat plate of unit quads.
fn plate(along: u32, up: u32) -> QuadMesh {
    let at = |i: u32, j: u32| j * (along + 1) + i;
    let positions = (0..=up).flat_map(|j| (0..=along).map(move |i| (i, j)));
    let positions = positions.map(|(i, j)| Point3::new(i.into(), j.into(), 0.0));
    let quads = (0..up).flat_map(|j| (0..along).map(move |i| (i, j)));
    let quads = quads.map(|(i, j)| [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)]);
    QuadMesh::new(positions.collect(), quads.collect()).unwrap()
}

/// Spheres with eight vertices of three quads, tori, plates, and a plate with a hole.
fn shape(kind: usize, n: u32) -> QuadMesh {
    match kind {
        0 => shapes::quad_sphere(1.0, n),
        1 => shapes::quad_torus(1.0, 0.4, 3 * n, 2 * n),
        2 => plate(3 * n, 2 * n),
        _ => {
            let whole = plate(3 * n, 3 * n);
            let inside =
                |q: usize| [q as u32 % (3 * n), q as u32 / (3 * n)].map(|i| i / n) == [1, 1];
            let kept = whole
                .quads()
                .iter()
                .enumerate()
                .filter(|(q, _)| !inside(*q));
            let kept: Vec<[u32; 4]> = kept.map(|(_, quad)| *quad).collect();
            let mut used = vec![false; whole.positions().len()];
            for &v in kept.as_flattened() {
                used[v as usize] = true;
            }
            // Vertices without a quad go.
            let number = |v: u32| used[..v as usize].iter().filter(|u| **u).count() as u32;
            let positions = whole
                .positions()
                .iter()
                .zip(&used)
                .filter(|(_, u)| **u)
                .map(|(p, _)| *p);
            let quads = kept.iter().map(|q| q.map(number)).collect();
            QuadMesh::new(positions.collect(), quads).unwrap()
        }
    }
}

/// Levels by a plane: at most `most` on one side of it, `least` on the other.
fn split(fine: &QuadMesh, normal: [f64; 3], least: u8, most: u8) -> Vec<u8> {
    let side = |p: &Point3| p.x * normal[0] + p.y * normal[1] + p.z * normal[2];
    let centres = levels::centres(fine);
    let mean = centres.iter().map(side).sum::<f64>() / centres.len() as f64;
    centres
        .iter()
        .map(|c| if side(c) > mean { most } else { least })
        .collect()
}

fn build(fine: &QuadMesh, allowed: &[u8]) -> TMesh {
    TMesh::build(fine, allowed, &TMeshOptions::default()).unwrap()
}

fn improved(mesh: TMesh, surface: &TriMesh, method: Method) -> Improved {
    let options = QualityOptions {
        method,
        ..QualityOptions::default()
    };
    improve(mesh, surface, &options, Run::on(&Cpu)).unwrap()
}

proptest! {
    #![proptest_config(cases(48))]

    #[test]
    fn any_levels_make_a_valid_t_mesh(
        (kind, n) in (0usize..4, 3u32..11),
        normal in [-1.0..1.0f64, -1.0..1.0f64, -1.0..1.0f64],
        (least, most, rings) in (0u8..3, 0u8..5, 1u32..4),
    ) {
        let fine = shape(kind, n);
        let allowed = split(&fine, normal, least, most);
        let mesh = TMesh::build(&fine, &allowed, &TMeshOptions { rings }).unwrap();
        let audit = mesh.audit();
        prop_assert!(audit.is_valid(), "{audit:?}");
        // Each fine quad lies in one element, which it allows.
        let mut seen = vec![0; fine.quads().len()];
        for (e, element) in mesh.elements().iter().enumerate() {
            let size = element.size as usize;
            prop_assert_eq!(element.size, 1 << element.level);
            for &q in mesh.fine_quads(e) {
                seen[q as usize] += 1;
                prop_assert_eq!(mesh.element_of(q as usize), e as u32);
                prop_assert!(element.level <= allowed[q as usize]);
            }
            // Corners of the square of fine vertices are those of the element; its sides lie on the square's.
            let v = mesh.fine_vertices(e);
            prop_assert_eq!(v.len(), (size + 1) * (size + 1));
            let corners = [v[0], v[size], v[size * (size + 2)], v[size * (size + 1)]];
            prop_assert_eq!(corners.map(|v| mesh.vertex_of_fine(v).unwrap()), element.corners);
            let below: Vec<u32> = v[..=size].iter().filter_map(|&v| mesh.vertex_of_fine(v)).collect();
            prop_assert_eq!(&below[..], mesh.side(e, 0));
        }
        prop_assert!(seen.iter().all(|&s| s == 1));
        prop_assert!(one_level_around_extraordinary_vertices(&mesh, rings));
        let record = Record::from(&mesh);
        prop_assert!(TMesh::try_from(record).unwrap() == mesh);
    }

    #[test]
    fn nothing_is_finer_than_needed(n in 2u32..6, most in 1u8..4) {
        // Where all may be coarse and all fits together, all is.
        let fine = refined(&shapes::quad_sphere(1.0, n), most).unwrap();
        let mesh = build(&fine, &vec![most; fine.quads().len()]);
        prop_assert_eq!(mesh.elements().len(), (6 * n * n) as usize);
        prop_assert!(mesh.elements().iter().all(|e| e.level == most));
    }
}

/// The elements within so many rings of an extraordinary vertex are of one level.
fn one_level_around_extraordinary_vertices(mesh: &TMesh, rings: u32) -> bool {
    let touching = |v: u32| {
        let elements = 0..mesh.elements().len();
        elements.filter(move |&e| (0..4).any(|k| mesh.side(e, k).contains(&v)))
    };
    (0..mesh.positions().len() as u32).all(|v| {
        if !mesh.is_extraordinary(mesh.fine_of_vertex(v as usize)) {
            return true;
        }
        let mut found: Vec<usize> = touching(v).collect();
        for _ in 1..rings {
            let rim = found
                .iter()
                .flat_map(|&e| (0..4).flat_map(move |k| mesh.side(e, k)));
            let mut next: Vec<usize> = rim.flat_map(|&w| touching(w)).collect();
            next.sort_unstable();
            next.dedup();
            found = next;
        }
        let level = mesh.elements()[found[0]].level;
        found.iter().all(|&e| mesh.elements()[e].level == level)
    })
}

#[test]
fn a_plate_that_may_be_coarse_is_one_element() {
    let mesh = build(&plate(16, 16), &[4; 256]);
    assert_eq!(mesh.elements().len(), 1);
    assert_eq!((mesh.elements()[0].size, mesh.positions().len()), (16, 4));
    assert!((0..4).all(|v| mesh.kind(v) == VertexKind::Boundary));
}

#[test]
fn half_a_plate_has_a_t_junction_per_coarse_element_at_the_border() {
    let fine = plate(16, 16);
    let allowed: Vec<u8> = (0..256).map(|q| u8::from(q % 16 >= 8)).collect();
    let mesh = build(&fine, &allowed);
    let audit = mesh.audit();
    assert_eq!((audit.levels, audit.t_junctions), (vec![128, 32], 8));
    assert!(
        mesh.halfedges()
            .iter()
            .all(|h| [1, 2].contains(&h.interval))
    );
}

#[test]
fn levels_four_apart_leave_the_levels_between() {
    let fine = plate(64, 16);
    let allowed: Vec<u8> = (0..1024).map(|q| if q % 64 < 16 { 0 } else { 3 }).collect();
    let levels = build(&fine, &allowed).audit().levels;
    assert!(levels.iter().all(|&count| count > 0), "{levels:?}");
}

#[test]
fn extraordinary_vertices_an_odd_number_of_quads_apart_are_no_obstacle() {
    // Corners of the cube are 33 quads apart: no blocks of two fit everywhere, yet most do.
    let fine = shapes::quad_sphere(1.0, 33);
    let mesh = build(&fine, &vec![1; fine.quads().len()]);
    let audit = mesh.audit();
    assert!(audit.is_valid());
    let coarse = (4 * audit.levels[1]) as f64 / fine.quads().len() as f64;
    assert!(coarse > 0.5, "{coarse}");
}

#[test]
fn a_thin_tube_has_no_edge_twice() {
    let fine = shapes::quad_torus(1.0, 0.2, 32, 4);
    let mesh = build(&fine, &[4; 128]);
    assert!(mesh.audit().is_valid());
    let ends = mesh.halfedges();
    let mut pairs: Vec<[u32; 2]> = ends
        .iter()
        .map(|h| [h.from, ends[h.next as usize].from])
        .collect();
    let count = pairs.len();
    pairs.sort_unstable();
    pairs.dedup();
    assert_eq!(pairs.len(), count);
}

#[test]
fn records_survive_json_and_contradictions_are_refused() {
    let fine = shapes::quad_sphere(1.0, 8);
    let mesh = build(&fine, &split(&fine, [0.3, 0.2, 1.0], 0, 2));
    let text = serde_json::to_string(&Record::from(&mesh)).unwrap();
    let mut read: Record = serde_json::from_str(&text).unwrap();
    // The last bit is the reader's: serde_json rounds it right only with its feature `float_roundtrip`.
    for (read, p) in read.fine_vertices.iter_mut().zip(fine.positions()) {
        assert!((Point3::from(*read) - p).norm() < 1e-15);
        *read = p.coords.into();
    }
    assert!(TMesh::try_from(read.clone()).unwrap() == mesh);
    let refused = |change: fn(&mut Record), what: &'static str| {
        let mut record = read.clone();
        change(&mut record);
        assert_eq!(TMesh::try_from(record).err(), Some(Error::Record { what }));
    };
    refused(|r| r.format.push('0'), "format");
    refused(|r| r.levels.fill(3), "levels");
    refused(|r| r.vertices.reverse(), "vertices");
    refused(|r| r.elements.swap(0, 1), "elements");
    refused(|r| r.halfedges[3].interval += 1, "halfedges");
}

#[test]
fn bad_input_is_named() {
    let fine = plate(4, 4);
    let options = TMeshOptions::default();
    let of = |allowed: &[u8]| TMesh::build(&fine, allowed, &options).unwrap_err();
    assert_eq!(
        of(&[0; 15]).to_string(),
        "15 levels for 16; there must be one each"
    );
    assert_eq!(
        of(&[11; 16]).to_string(),
        "quad 0 allows level 11; the highest is 10"
    );
    let empty = TMesh::build(&QuadMesh::default(), &[], &options);
    assert_eq!(empty.err(), Some(Error::Empty));
    let fan = vec![[0, 1, 2, 3], [1, 0, 4, 5], [0, 1, 6, 7]];
    let positions = (0..8).map(|i| Point3::new(f64::from(i), 0.0, f64::from(i * i)));
    let fan = QuadMesh::new(positions.collect(), fan).unwrap();
    assert!(matches!(
        TMesh::build(&fan, &[0; 3], &options),
        Err(Error::Mesh(_))
    ));
    assert!(TMesh::build(&fine, &[0; 16], &TMeshOptions { rings: 0 }).is_err());
    let mesh = build(&fine, &[0; 16]);
    let none = TriMesh::default();
    assert!(
        improve(
            mesh.clone(),
            &none,
            &QualityOptions::default(),
            Run::on(&Cpu)
        )
        .is_err()
    );
    let mut moved = mesh.clone();
    assert!(moved.move_to(Vec::new(), |_, p| *p).is_err());
    assert!(
        moved
            .move_to(vec![Point3::new(f64::NAN, 0.0, 0.0); 25], |_, p| *p)
            .is_err()
    );
    assert!(moved == mesh);
}

#[test]
fn one_sided_quads_are_refused_and_parts_are_taken_together() {
    // A strip of eight quads whose ends are glued the wrong way around.
    let at = |i: u32, j: u32| {
        let turn = f64::from(i) / 8.0 * std::f64::consts::PI;
        let (across, out) = (f64::from(j) - 0.5, 3.0 + (f64::from(j) - 0.5) * turn.cos());
        Point3::new(
            out * (2.0 * turn).cos(),
            out * (2.0 * turn).sin(),
            across * turn.sin(),
        )
    };
    let positions: Vec<Point3> = (0..8).flat_map(|i| [at(i, 0), at(i, 1)]).collect();
    let mut quads: Vec<[u32; 4]> = (0..7)
        .map(|i| [2 * i, 2 * i + 2, 2 * i + 3, 2 * i + 1])
        .collect();
    quads.push([14, 1, 0, 15]);
    let moebius = QuadMesh::new(positions.clone(), quads.clone()).unwrap();
    let refused = TMesh::build(&moebius, &[0; 8], &TMeshOptions::default());
    assert!(matches!(refused, Err(Error::Mesh(_))), "{refused:?}");
    let mut nowhere = positions;
    nowhere[3].z = f64::NAN;
    assert!(QuadMesh::new(nowhere, quads).is_err());
    // A sphere and a torus beside it: both become coarse where they may, and the audit counts both.
    let (sphere, torus) = (
        shapes::quad_sphere(1.0, 8),
        shapes::quad_torus(1.0, 0.4, 24, 16),
    );
    let first = sphere.positions().len() as u32;
    let mut positions = sphere.positions().to_vec();
    positions.extend(torus.positions().iter().map(|p| p + Vector3::x() * 5.0));
    let mut quads = sphere.quads().to_vec();
    quads.extend(torus.quads().iter().map(|q| q.map(|v| first + v)));
    let both = QuadMesh::new(positions, quads).unwrap();
    let mesh = build(&both, &vec![1; both.quads().len()]);
    let audit = mesh.audit();
    assert!(audit.is_valid() && audit.doubled_euler == 4, "{audit:?}");
    let alone = [&sphere, &torus].map(|m| build(m, &vec![1; m.quads().len()]).elements().len());
    assert_eq!(mesh.elements().len(), alone[0] + alone[1]);
}

#[test]
fn levels_follow_sides_fields_and_curvature() {
    let fine = plate(4, 2);
    let lengths = [0.5, 1.0, 1.99, 2.0, 4.0, f64::INFINITY, f64::NAN, -1.0];
    assert_eq!(
        levels::by_side(&fine, &lengths, 2).unwrap(),
        [0, 0, 0, 1, 2, 2, 0, 0]
    );
    let field: Vec<f64> = (0..101).map(f64::from).collect();
    let by_field = levels::by_field(&field, 2);
    assert!(by_field.is_sorted_by(|a, b| a >= b));
    assert_eq!(
        [0, 1, 2].map(|l| by_field.iter().filter(|&&x| x == l).count()),
        [35, 30, 36]
    );
    assert_eq!(levels::by_field(&[1.0, 1.0, f64::NAN], 2), [0; 3]);
    // On a sphere of radius 2, elements that turn by 0.4 have sides of 0.8.
    let (fine, sphere) = (shapes::quad_sphere(2.0, 16), shapes::icosphere(2.0, 4));
    let places = Places::of(&sphere, &fine).unwrap();
    let turned = levels::by_curvature(&fine, &places, 0.45, 3).unwrap();
    assert_eq!(
        turned,
        levels::by_side(&fine, &vec![0.9; turned.len()], 3).unwrap()
    );
    let labels: Vec<u32> = (0..sphere.triangles().len() as u32).collect();
    assert!(places.labels(&labels[1..]).is_err());
    assert_eq!(places.labels(&labels).unwrap().len(), fine.quads().len());
}

#[test]
fn cleaning_drops_specks_and_lays_bands() {
    let fine = plate(40, 20);
    let mut wished: Vec<u8> = (0..800).map(|q| if q % 40 < 20 { 0 } else { 2 }).collect();
    wished[10 * 40 + 5] = 2;
    wished[10 * 40 + 30] = 0;
    let clean = levels::cleaned(&fine, &wished, &CleanOptions::default()).unwrap();
    for (q, &level) in clean.iter().enumerate() {
        // A band of two elements of level 1.
        let expected = match q % 40 {
            0..20 => 0,
            20..24 => 1,
            _ => 2,
        };
        assert_eq!(level, expected, "quad {q}");
    }
    let none = CleanOptions {
        rounds: 0,
        island: 0,
        band: 0,
    };
    assert_eq!(levels::cleaned(&fine, &wished, &none).unwrap(), wished);
    assert!(levels::cleaned(&fine, &wished[1..], &none).is_err());
}

/// A plate whose inner vertices are shaken by so much, and the flat triangles it lies on.
fn shaken_plate(n: u32, allowed: &[u8], noise: f64) -> (TMesh, TriMesh) {
    let flat = plate(n, n);
    let mut mesh = build(&flat, allowed);
    let mut random = geom_core::compute::random::SplitMix64::new(3);
    let moved = (0..mesh.positions().len()).map(|v| {
        let p = mesh.positions()[v];
        let by = if mesh.kind(v) == VertexKind::Boundary {
            0.0
        } else {
            noise
        };
        Point3::new(
            p.x + by * random.symmetric(),
            p.y + by * random.symmetric(),
            0.0,
        )
    });
    mesh.move_to(moved.collect(), |_, p| *p).unwrap();
    (mesh, flat.into_triangles())
}

#[test]
fn a_shaken_plate_becomes_even_again() {
    for method in [Method::Corners, Method::Triangles] {
        let allowed: Vec<u8> = (0..256).map(|q| u8::from(q % 16 >= 8)).collect();
        let (mesh, ground) = shaken_plate(16, &allowed, 0.3);
        let out = improved(mesh, &ground, method);
        let report = &out.report;
        assert!(report.before.min < 0.75, "{report:?}");
        assert!(
            report.after.min > 0.8 && report.after.mean > 0.96,
            "{report:?}"
        );
        assert!(report.distortion[1] < report.distortion[0]);
        // The rim stays on the rim, its corners where they are.
        let fine = out.mesh.fine();
        assert!((fine.area() - 256.0).abs() < 1e-9);
        let edges = Halfedges::of_quads(fine).unwrap();
        for (v, p) in fine.positions().iter().enumerate() {
            let on_side = |x: f64| x.abs() < 1e-12 || (x - 16.0).abs() < 1e-12;
            assert!(!edges.on_boundary(VertexId(v as u32)) || on_side(p.x) || on_side(p.y));
        }
    }
}

/// What two steps and one search leave bad goes down together, cut where it has T-junctions.
#[test]
fn bad_elements_with_t_junctions_are_made_straight() {
    let allowed: Vec<u8> = (0..256).map(|q| u8::from(q % 16 >= 8)).collect();
    let (mesh, ground) = shaken_plate(16, &allowed, 0.9);
    let options = QualityOptions {
        steps: 2,
        rounds: 1,
        least: -1.0,
        ..QualityOptions::default()
    };
    let report = improve(mesh, &ground, &options, Run::on(&Cpu))
        .unwrap()
        .report;
    assert!(
        report.before.min < -0.9 && report.after.min > 0.6,
        "{report:?}"
    );
}

#[test]
fn better_elements_lie_on_the_surface_and_none_is_worse() {
    let surface = shapes::ellipsoid([1.0, 0.7, 0.5].into(), 4);
    let fine = shapes::quad_sphere(1.0, 16);
    let mesh = build(&fine, &split(&fine, [0.0, 0.0, 1.0], 0, 1));
    let out = improved(mesh, &surface, Method::Corners);
    assert!(
        out.report.after.min >= out.report.before.min,
        "{:?}",
        out.report
    );
    assert!(
        out.report.after.min > 0.6 && out.report.after.percentile_5 > 0.95,
        "{:?}",
        out.report
    );
    assert_eq!(out.mesh.audit().doubled_euler, 4);
    let tree = geom_core::search::bvh::TriangleTree::new(&surface).unwrap();
    let closest = tree.closest_to_all(out.mesh.fine().positions()).unwrap();
    assert!(closest.iter().all(|c| c.distance < 1e-12));
}

/// The wall of a cavity nearly touches the outer one and faces the other way: what is nearest to a vertex may be of the other.
#[test]
fn parts_that_nearly_touch_keep_to_their_own_surface() {
    let facing_in = |p: &Point3| Point3::from(p.coords * 0.997);
    let outer = shapes::icosphere(1.0, 4);
    let first = outer.positions().len() as u32;
    let (mut positions, mut triangles) = outer.into_parts();
    positions.extend_from_within(..);
    positions[first as usize..]
        .iter_mut()
        .for_each(|p| *p = facing_in(p));
    let inner = triangles
        .iter()
        .map(|&[a, b, c]| [b, a, c].map(|v| v + first));
    triangles.extend(inner.collect::<Vec<_>>());
    let surface = TriMesh::new(positions, triangles).unwrap();
    // Quads that are pressed together towards the poles have far to go.
    let pressed = |p: &Point3| Point3::from(Vector3::new(p.x, p.y, p.z * 2.5).normalize());
    let sphere = shapes::quad_sphere(1.0, 8);
    let first = sphere.positions().len() as u32;
    let mut positions: Vec<Point3> = sphere.positions().iter().map(pressed).collect();
    positions.extend(positions.clone().iter().map(facing_in));
    let mut quads = sphere.quads().to_vec();
    let inner = |&[a, b, c, d]: &[u32; 4]| [a, d, c, b].map(|v| v + first);
    quads.extend(sphere.quads().iter().map(inner));
    let fine = QuadMesh::new(positions, quads).unwrap();
    // With T-junctions on both where the upper half is coarse alone.
    let above = |quad: &[u32; 4]| quad.iter().all(|&v| fine.positions()[v as usize].z > 0.0);
    let upper = fine.quads().iter().map(|q| u8::from(above(q)));
    for levels in [vec![1; fine.quads().len()], upper.collect()] {
        let out = improved(build(&fine, &levels), &surface, Method::Corners);
        assert!(out.report.after.min > 0.5, "{:?}", out.report);
        for (v, p) in out.mesh.fine().positions().iter().enumerate() {
            let radius = p.coords.norm();
            assert_eq!(radius > 0.998, v < first as usize, "{v} {radius}");
        }
    }
}

/// At the wide end of a rod that is one element, the surface's normals at its corners point sideways and a little back: what
/// lies under the element says how it lies.
#[test]
fn elements_over_tips_are_seen_along_the_tip() {
    let rod = shapes::cylinder(1.0, 20.0, 32, 200);
    let [low, high] = [rod.bounds().min.z + 0.3, rod.bounds().max.z - 0.3];
    let wide = |z: f64| 1.0 + 0.02 * z;
    let widened = |p: &Point3| Point3::new(p.x * wide(p.z), p.y * wide(p.z), p.z);
    let positions = rod.positions().iter().map(widened).collect();
    let rod = TriMesh::new(positions, rod.triangles().to_vec()).unwrap();
    let rings = 13;
    let at = |i: u32, k: u32| 4 * i + k % 4;
    let corner = |i: u32, [x, y]: [f64; 2]| {
        let z = low + (high - low) * f64::from(i) / f64::from(rings);
        widened(&Point3::new(x, y, z))
    };
    let ring = |i| [[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]].map(|at| corner(i, at));
    let sides = (0..rings).flat_map(|i| (0..4).map(move |k| (i, k)));
    let side = |(i, k)| [at(i, k), at(i, k + 1), at(i + 1, k + 1), at(i + 1, k)];
    let ends = [[3, 2, 1, 0], [0, 1, 2, 3].map(|k| at(rings, k))];
    let quads = sides.map(side).chain(ends).collect();
    let fine = QuadMesh::new((0..=rings).flat_map(ring).collect(), quads).unwrap();
    let mesh = build(&fine, &vec![0; fine.quads().len()]);
    let out = improved(mesh, &rod, Method::Corners);
    let [before, after] = [out.report.before.min, out.report.after.min];
    assert!(before > 0.9 && after > 0.6, "{before} {after}");
    assert_eq!(out.report.cut, 0);
}

/// A strip of 4 by 1 around the x-axis that turns by this angle from end to end, in `n × n` quads.
fn twisted(n: u32, angle: f64) -> QuadMesh {
    let flat = plate(n, n);
    let turned = |p: &Point3| {
        let (x, y) = (p.x / f64::from(n), p.y / f64::from(n) - 0.5);
        let (sine, cosine) = (angle * x).sin_cos();
        Point3::new(4.0 * x, y * cosine, y * sine)
    };
    let positions = flat.positions().iter().map(turned).collect();
    QuadMesh::new(positions, flat.quads().to_vec()).unwrap()
}

#[test]
fn elements_too_large_for_a_surface_are_cut() {
    let surface = twisted(64, 2.6).into_triangles();
    // One element, whose corners cannot move: of eight by eight quads, and of one.
    for (n, level) in [(8, 3), (1, 0)] {
        let fine = twisted(n, 2.6);
        let mesh = build(&fine, &vec![level; (n * n) as usize]);
        assert_eq!(mesh.elements().len(), 1);
        let whole = QualityOptions {
            least: -1.0,
            ..QualityOptions::default()
        };
        let left = improve(mesh.clone(), &surface, &whole, Run::on(&Cpu)).unwrap();
        assert_eq!((left.report.cut, left.jacobians.len()), (0, 1));
        assert!(left.report.after.min < 0.3, "{:?}", left.report);
        let out = improved(mesh, &surface, Method::Corners);
        assert!(out.report.cut > 0 && out.mesh.audit().is_valid());
        assert_eq!(out.jacobians.len(), out.mesh.elements().len());
        assert!(out.report.after.min > 0.3, "{:?}", out.report);
        // The rim of the finer quads is that of the surface.
        let area = out.mesh.fine().area() / surface.area();
        assert!(n == 1 || (area - 1.0).abs() < 0.01, "{area}");
    }
    let options = QualityOptions {
        least: 0.6,
        ..QualityOptions::default()
    };
    assert!(options.check().is_err());
}

#[test]
fn a_rim_thinner_than_elements_spoils_none() {
    // A disk whose two sides meet in an edge: at its vertices the surface's normals are those of either side.
    let surface = shapes::ellipsoid([1.0, 0.8, 0.02].into(), 5);
    let round = shapes::quad_sphere(1.0, 8);
    let turned = |p: &Point3| {
        // Corners of the cube look nowhere in particular.
        let p = geom_core::nalgebra::Rotation3::from_euler_angles(0.4, 0.7, 0.2) * p;
        Point3::new(p.x, 0.8 * p.y, 0.02 * p.z)
    };
    let positions = round.positions().iter().map(turned).collect();
    let fine = QuadMesh::new(positions, round.quads().to_vec()).unwrap();
    let out = improved(build(&fine, &[0; 384]), &surface, Method::Corners);
    // Seen along those normals the distortion rises, for corners that only look inverted.
    let report = &out.report;
    assert!(report.distortion[1] < 1.5, "{report:?}");
    assert!(report.after.min > 0.5, "{report:?}");
}

#[test]
fn sharp_edges_stay_sharp() {
    // A box of 8 × 8 quads per side; its inner vertices are shaken along the sides.
    let round = shapes::quad_sphere(1.0, 8);
    let cubed = |p: &Point3| {
        let largest = p.coords.amax();
        Point3::from(
            p.coords
                .map(|x| (x / largest).atan() * 8.0 / std::f64::consts::PI),
        )
    };
    let positions: Vec<Point3> = round.positions().iter().map(cubed).collect();
    let cube = QuadMesh::new(positions, round.quads().to_vec()).unwrap();
    let mut mesh = build(&cube, &[1; 384]);
    let on_side = |x: f64| (x.abs() - 2.0).abs() < 1e-9;
    let mut random = geom_core::compute::random::SplitMix64::new(5);
    let shaken = mesh.positions().iter().map(|p| {
        // Corners stay, vertices on edges slide, the others move on their side.
        Point3::from(p.coords.map(|x| {
            if on_side(x) {
                x
            } else {
                x + 0.2 * random.symmetric()
            }
        }))
    });
    mesh.move_to(shaken.collect(), |_, p| *p).unwrap();
    let options = QualityOptions {
        crease: Some(40.0),
        ..QualityOptions::default()
    };
    let ground = cube.clone().into_triangles();
    let out = improve(mesh, &ground, &options, Run::on(&Cpu)).unwrap();
    assert!(out.report.after.min > 0.95, "{:?}", out.report);
    let fine = out.mesh.fine();
    assert!((fine.volume() - 64.0).abs() < 1e-9 && (fine.area() - 96.0).abs() < 1e-9);
    let bad = QualityOptions {
        crease: Some(0.0),
        ..options
    };
    assert!(bad.check().is_err());
}

#[test]
fn long_elements_stay_long_unless_squares_are_wanted() {
    // Quads of 2π / 60 along and 0.8π / 8 around.
    let fine = shapes::quad_torus(1.0, 0.4, 60, 8);
    let surface = shapes::torus(1.0, 0.4, 120, 48);
    let ratio = |mesh: &TMesh| {
        let of = |q: usize| {
            let p = mesh.fine().corners(q);
            let length = |k: usize| (p[(k + 1) % 4] - p[k]).norm();
            (length(0) + length(2)) / (length(1) + length(3))
        };
        let all = (0..480).map(|q| of(q).ln().abs());
        (all.sum::<f64>() / 480.0).exp()
    };
    let mesh = build(&fine, &[0; 480]);
    let before = ratio(&mesh);
    let kept = ratio(&improved(mesh, &surface, Method::Corners).mesh);
    assert!((kept / before - 1.0).abs() < 0.2, "{before} {kept}");
}

#[test]
fn threads_do_not_matter() {
    let fine = shapes::quad_sphere(1.0, 12);
    let surface = shapes::icosphere(1.0, 3);
    same_on_any_threads(|| {
        let mesh = build(&fine, &split(&fine, [0.1, 0.2, 1.0], 0, 2));
        improved(mesh, &surface, Method::Corners)
    });
}
