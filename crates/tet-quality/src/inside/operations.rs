//! The operations on small cavities, exhaustively.

use std::f64::consts::TAU;

use geom_core::mesh::{Region, SurfaceAudit, VertexKind, VolumeAudit, six_volume};
use geom_core::{Point3, TetMesh};
use proptest::prelude::*;

use crate::mesh::editable::{EditableMesh, Freedom};
use crate::mesh::proposal::{Floor, Proposal};
use crate::operations::contract::contraction;
use crate::operations::insert::edge_split;
use crate::operations::swap::{edge_removal, face_swap, surface_flip};
use crate::smoothing::star::Star;
use crate::testing::{lattice, noise, shaken};

const ANY: Floor = Floor::Fixed(1e-6);

/// `n` tetrahedra around the edge from vertex 0 to vertex 1, its vertices at random radii and heights.
fn link_of_edge(n: usize, rise: f64, seed: u64) -> TetMesh {
    let mut noise = noise(seed);
    let mut x = vec![Point3::new(0.0, 0.0, -rise), Point3::new(0.0, 0.0, rise)];
    for i in 0..n {
        let angle = TAU * (i as f64 + 0.2 * noise()) / n as f64;
        let radius = 1.0 + 0.15 * noise();
        x.push(Point3::new(
            radius * angle.cos(),
            radius * angle.sin(),
            0.1 * noise(),
        ));
    }
    let tets = (0..n)
        .map(|i| [0, 1, 2 + i as u32, 2 + ((i + 1) % n) as u32])
        .collect();
    TetMesh::new(x, tets).unwrap()
}

fn volume(edited: &EditableMesh) -> f64 {
    let tets = edited
        .tets
        .iter()
        .filter(|t| t[0] != crate::mesh::incidence::NONE);
    tets.map(|&t| six_volume(edited.corners(t))).sum()
}

/// The faces of the outside, each turned to start at its lowest vertex.
fn outside(mesh: &TetMesh) -> Vec<[u32; 3]> {
    let mut faces: Vec<[u32; 3]> = mesh
        .interfaces()
        .iter()
        .map(|f| {
            let [a, b, c] = f.triangle;
            [[a, b, c], [b, c, a], [c, a, b]].into_iter().min().unwrap()
        })
        .collect();
    faces.sort_unstable();
    faces
}

/// All triangulations of the polygon `chain`, by brute force.
fn all_triangulations(chain: &[u32]) -> Vec<Vec<[u32; 3]>> {
    let n = chain.len();
    if n < 3 {
        return vec![Vec::new()];
    }
    (1..n - 1)
        .flat_map(|j| {
            let left = all_triangulations(&chain[..=j]);
            let right = all_triangulations(&chain[j..]);
            let middle = [chain[0], chain[j], chain[n - 1]];
            left.into_iter().flat_map(move |l| {
                let right = right.clone();
                right.into_iter().map(move |r| {
                    let mut all = vec![middle];
                    all.extend(&l);
                    all.extend(&r);
                    all
                })
            })
        })
        .collect()
}

pub fn edge_removal_is_the_best_of_all_triangulations() {
    for n in 3..=7 {
        for seed in 0..40 {
            let mesh = link_of_edge(n, 1.2, 100 * n as u64 + seed);
            let mut edited = EditableMesh::new(mesh.clone());
            let before = (volume(&edited), outside(&mesh));
            let old = edited.worst();
            let chain: Vec<u32> = (2..2 + n as u32).collect();
            let best = all_triangulations(&chain)
                .into_iter()
                .map(|triangles| {
                    triangles
                        .iter()
                        .flat_map(|&[u, v, w]| [[u, v, w, 1], [u, w, v, 0]])
                        .map(|tet| edited.quality_of(tet))
                        .fold(f64::INFINITY, f64::min)
                })
                .fold(f64::NEG_INFINITY, f64::max);
            let Some(proposal) = edge_removal(&edited, 0, 1, ANY) else {
                assert!(best <= 1e-6, "{n} around, seed {seed}: {best} was missed");
                continue;
            };
            assert_eq!(proposal.insert.len(), 2 * (n - 2));
            proposal.apply(&mut edited);
            assert!(
                (edited.worst() - best).abs() < 1e-15
                    && (proposal.gain - (best - old)).abs() < 1e-15
            );
            assert!((volume(&edited) - before.0).abs() <= 1e-13 * before.0);
            let after = edited.finish();
            assert_eq!(outside(&after), before.1);
            assert!(VolumeAudit::of(&after).is_valid());
        }
    }
}

pub fn face_swap_undoes_the_removal_of_an_edge_of_three() {
    for seed in 0..40 {
        let mesh = link_of_edge(3, 0.8, seed);
        let mut edited = EditableMesh::new(mesh.clone());
        let before = volume(&edited);
        edge_removal(&edited, 0, 1, ANY).unwrap().apply(&mut edited);
        let t = (0..3).find(|&t| !edited.is_empty_slot(t)).unwrap();
        let swap = (0..4).find_map(|k| face_swap(&edited, t, k, ANY)).unwrap();
        assert_eq!((swap.remove.len(), swap.insert.len()), (2, 3));
        swap.apply(&mut edited);
        assert!((volume(&edited) - before).abs() <= 1e-13 * before);
        assert!((edited.worst() - EditableMesh::new(mesh.clone()).worst()).abs() < 1e-15);
        assert_eq!(outside(&edited.finish()), outside(&mesh));
    }
}

/// Where elements overlap, as before they are untangled, the edge that a swap would make may be there already.
pub fn swaps_do_not_make_an_edge_twice() {
    // Two tetrahedra on a face, their far corners 3 and 4; a third one, through both, has these as an edge.
    let corners = [
        [1.0, 0.0, 0.0],
        [-0.5, 0.8, 0.0],
        [-0.5, -0.8, 0.0],
        [0.0, 0.0, 1.0],
        [0.0, 0.0, -1.0],
        [3.0, 0.5, 0.0],
        [3.0, -0.5, 0.0],
    ];
    let corners = corners.map(Point3::from).to_vec();
    let on_face = [[0, 1, 2, 3], [0, 2, 1, 4]];
    let across = [3, 4, 5, 6];
    for overlaps in [false, true] {
        let mut tets = on_face.to_vec();
        tets.extend(overlaps.then_some(across));
        let mesh = EditableMesh::new(TetMesh::new(corners.clone(), tets).unwrap());
        assert!(mesh.worst() > 0.0);
        let swap = (0..4).find_map(|k| face_swap(&mesh, 0, k, ANY));
        assert_eq!(swap.is_none(), overlaps);
    }
}

pub fn a_split_edge_keeps_volume_and_boundary() {
    for n in 3..=7 {
        let mesh = link_of_edge(n, 2.0, n as u64);
        let mut edited = EditableMesh::new(mesh);
        let before = volume(&edited);
        let split = edge_split(&edited, 0, 1, None, ANY, &mut Star::default()).unwrap();
        assert_eq!((split.remove.len(), split.insert.len()), (n, 2 * n));
        split.apply(&mut edited);
        assert!((volume(&edited) - before).abs() <= 1e-13 * before);
        assert!(VolumeAudit::of(&edited.finish()).is_valid());
    }
}

/// Region 1 in region 0, with vertices of the interface free to slide: what an isosurface has, and no
/// field to judge the shape.
fn labelled(n: usize, region: impl Fn(&Point3) -> Region) -> EditableMesh {
    let mesh = lattice([n; 3], 1.0, region);
    let mut edited = EditableMesh::new(mesh);
    for v in 0..edited.x.len() {
        edited.freedom[v] = match edited.kinds[v] {
            VertexKind::Interior => Freedom::Free,
            VertexKind::Surface => Freedom::Field,
            _ => Freedom::Fixed,
        };
    }
    edited
}

fn euler_and_faults(edited: EditableMesh) -> (Vec<i64>, bool) {
    let mesh = edited.finish();
    let audit = SurfaceAudit::of(&mesh.region_surface(1));
    let mut euler: Vec<i64> = audit
        .components
        .iter()
        .map(|c| c.euler_characteristic())
        .collect();
    euler.sort_unstable();
    (
        euler,
        audit.is_closed_manifold() && VolumeAudit::of(&mesh).is_valid(),
    )
}

/// Contracts whatever may be, in turn, down to almost flat elements: only topology says no.
fn contract_all(edited: &mut EditableMesh) -> usize {
    let mut count = 0;
    loop {
        let before = count;
        for t in 0..edited.tets.len() {
            for i in 0..4 {
                for j in 0..4 {
                    let tet = edited.tets[t];
                    if i == j || edited.is_empty_slot(t as u32) {
                        continue;
                    }
                    let proposal: Option<Proposal> =
                        contraction(edited, tet[i], tet[j], None, 0.0, Floor::Fixed(1e-9));
                    if let Some(p) = proposal {
                        p.apply(edited);
                        count += 1;
                    }
                }
            }
        }
        if count == before {
            return count;
        }
    }
}

pub fn contraction_keeps_a_tetrahedron_bubble() {
    let mut edited = labelled(4, |_| 0);
    let middle = edited
        .tets
        .iter()
        .position(|t| {
            t.iter()
                .all(|&v| edited.kinds[v as usize] == VertexKind::Interior)
        })
        .unwrap();
    edited.regions[middle] = 1;
    for v in edited.tets[middle] {
        edited.freedom[v as usize] = Freedom::Field;
    }
    let tet = edited.tets[middle];
    for i in 0..4 {
        for j in (0..4).filter(|&j| j != i) {
            assert!(contraction(&edited, tet[i], tet[j], None, 0.0, ANY).is_none());
        }
    }
    contract_all(&mut edited);
    assert_eq!(euler_and_faults(edited), (vec![2], true));
}

pub fn contraction_keeps_an_octahedron_bubble() {
    // All tetrahedra around one inner edge.
    let mut edited = labelled(4, |_| 0);
    let (a, b) = edited
        .tets
        .iter()
        .flat_map(|t| [(t[0], t[1]), (t[0], t[2]), (t[0], t[3])])
        .find(|&(a, b)| {
            let around: Vec<_> = edited
                .incidence
                .of(a)
                .iter()
                .filter(|&&t| edited.tets[t as usize].contains(&b))
                .collect();
            around.len() == 4
                && around.iter().all(|&&t| {
                    edited.tets[t as usize]
                        .iter()
                        .all(|&v| edited.kinds[v as usize] == VertexKind::Interior)
                })
        })
        .unwrap();
    let around: Vec<u32> = edited
        .incidence
        .of(a)
        .iter()
        .copied()
        .filter(|&t| edited.tets[t as usize].contains(&b))
        .collect();
    for &t in &around {
        edited.regions[t as usize] = 1;
        for v in edited.tets[t as usize] {
            edited.freedom[v as usize] = Freedom::Field;
        }
    }
    // The inner edge joins two opposite corners: contracting it would pinch the bubble.
    assert!(contraction(&edited, a, b, None, 0.0, ANY).is_none());
    assert!(contraction(&edited, b, a, None, 0.0, ANY).is_none());
    contract_all(&mut edited);
    assert_eq!(euler_and_faults(edited), (vec![2], true));
}

pub fn contraction_keeps_the_handle_of_a_torus() {
    let inside = |p: &Point3| {
        let ring = (p.x - 3.5).abs().max((p.y - 3.5).abs());
        Region::from((0.5..1.5).contains(&ring) && (p.z - 3.5).abs() < 0.5)
    };
    let mut edited = labelled(7, inside);
    assert_eq!(euler_and_faults(labelled(7, inside)), (vec![0], true));
    let count = contract_all(&mut edited);
    assert!(count > 20, "only {count} contractions");
    assert_eq!(euler_and_faults(edited), (vec![0], true));
}

pub fn contraction_keeps_the_topology_of_random_bodies() {
    proptest!(geom_core::testing::cases(24), |(seed in any::<u64>(), share in -0.6..0.6)| {
        let mut noise = noise(seed);
        // Cubes at random; those whose union is not a manifold are not meshes that we promise for.
        let cubes: Vec<bool> = (0..27).map(|_| noise() < share).collect();
        let inside = |p: &Point3| {
            let c = [p.x, p.y, p.z].map(|c| c.floor() as i64 - 1);
            let within = c.iter().all(|c| (0..3).contains(c));
            Region::from(within && cubes[(c[0] + 3 * c[1] + 9 * c[2]) as usize])
        };
        let before = euler_and_faults(labelled(5, inside));
        prop_assume!(before.1);
        let mut edited = labelled(5, inside);
        contract_all(&mut edited);
        prop_assert_eq!(euler_and_faults(edited), before);
    });
}

/// Operations on a shaken lattice: volume, boundary, orientation and the worst element hold.
pub fn operations_keep_what_they_must() {
    proptest!(geom_core::testing::cases(24), |(seed in any::<u64>(), pick in any::<prop::sample::Index>(), which in 0..4)| {
        let mesh = shaken(lattice([3; 3], 1.0, |p| Region::from(p.x > 1.0)), 0.2, seed);
        let input = crate::boundary::input::prepare(mesh.clone(), &[], None).unwrap();
        let mut edited = input.mesh;
        let before = volume(&edited);
        let area = |mesh: &TetMesh| SurfaceAudit::of(&mesh.region_surface(1)).area();
        let boundary = area(&mesh);
        let t = pick.index(edited.tets.len()) as u32;
        let tet = edited.tets[t as usize];
        let mut applied = 0;
        for i in 0..4 {
            for j in 0..4 {
                if i == j || edited.tets[t as usize] != tet {
                    continue;
                }
                let (a, b) = (tet[i], tet[j]);
                let proposal = match which {
                    0 => edge_removal(&edited, a, b, Floor::Old),
                    1 => face_swap(&edited, t, i, Floor::Old),
                    2 => surface_flip(&edited, a, b, None, 0.0, Floor::Old),
                    _ => contraction(&edited, a, b, None, 0.0, Floor::Old),
                };
                if let Some(p) = proposal {
                    let old = p.remove.iter().map(|&t| edited.q[t as usize]).fold(f64::INFINITY, f64::min);
                    p.apply(&mut edited);
                    let new = p.insert.iter().map(|i| edited.quality_of(i.corners)).fold(f64::INFINITY, f64::min);
                    prop_assert!(new > old);
                    applied += 1;
                }
            }
        }
        prop_assert!((volume(&edited) - before).abs() < 1e-12 * before);
        let after = edited.finish();
        prop_assert!(VolumeAudit::of(&after).is_valid());
        let area = area(&after);
        prop_assert!((area - boundary).abs() < 1e-12 * boundary, "after {applied} operations: {boundary}, {area}");
    });
}
