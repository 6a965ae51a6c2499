//! The walls of cavities, and walls that cross.

use geom_core::{ImplicitField, Point3, TetMesh, Vector3};

use crate::boundary::field::Isosurface;
use crate::boundary::guard::GuardedMesh;
use crate::boundary::input::prepare;
use crate::boundary::walls::CavityGuard;
use crate::improve::crossed::Crossed;
use crate::mesh::proposal::{Floor, NEW, Operation, VertexMove};
use crate::operations::contract::contraction;
use crate::operations::insert::edge_split;
use crate::operations::operate::apply_all;
use crate::operations::swap::surface_flip;
use crate::smoothing::star::Star;
use crate::testing::{lattice, noise};

/// The volumes of the walls of a ball with a cavity about this centre are those of the walls, after every change.
pub fn volumes_of_walls(mesh: TetMesh, field: &dyn ImplicitField, center: Point3) {
    let surface = Isosurface {
        field,
        level: 1.0,
        own: false,
        plane: None,
    };
    let mut guarded = GuardedMesh::new(prepare(mesh, &[], Some(&surface)).unwrap().mesh);
    assert_eq!(guarded.guard.walls.all.len(), 1);
    let exact = |guarded: &mut GuardedMesh| {
        let kept = guarded.guard.walls.all[0].volume;
        guarded.guard.walls = CavityGuard::of(&guarded.mesh);
        let [wall] = guarded.guard.walls.all.as_slice() else {
            panic!("{} walls", guarded.guard.walls.all.len());
        };
        assert!((wall.volume - kept).abs() < 1e-9, "{} {kept}", wall.volume);
        wall.volume
    };
    let any = Floor::Fixed(1e-6);
    let (mut noise, mut star) = (noise(1), Star::default());
    let (mut counts, mut marks) = ([0; 3], Vec::new());
    for turn in 0..400 {
        let (mesh, walls) = (&guarded.mesh, &guarded.guard.walls);
        let on_wall: Vec<u32> = (0..mesh.x.len() as u32)
            .filter(|&v| walls.at(v) == 0 && mesh.keeps(v))
            .collect();
        let mut pick = |n: usize| ((noise() + 1.0) * 0.5 * n as f64) as usize % n;
        let a = on_wall[pick(on_wall.len())];
        let tets = mesh.incidence.of(a);
        let b = mesh.tets[tets[pick(tets.len())] as usize][pick(4)];
        if a == b {
            continue;
        }
        let proposal = match turn % 3 {
            0 => contraction(mesh, a, b, None, 1.0, any),
            1 => edge_split(mesh, a, b, Some(&surface), any, &mut star),
            _ => surface_flip(mesh, a, b, Some(&surface), 1.0, any),
        };
        let Some(mut proposal) = proposal else {
            continue;
        };
        // Another vertex moves along.
        let along = proposal.insert[0].corners.into_iter().find(|&v| v != NEW);
        let vertex = along.expect("at most one corner is new");
        let shift = Vector3::new(noise(), noise(), noise()) * 0.05;
        let to = mesh.x[vertex as usize] + shift;
        proposal.moves = vec![VertexMove { vertex, to }];
        let kind = match proposal.operation {
            Operation::Contraction => 0,
            Operation::Insertion => 1,
            _ => 2,
        };
        let one = vec![(0, proposal)];
        counts[kind] += apply_all(&mut guarded, one, &mut marks, turn + 1).len();
        exact(&mut guarded);
    }
    assert!(counts.iter().all(|&n| n > 5), "{counts:?}");
    // Moves, and where they end.
    let labels = &guarded.guard.walls.labels;
    let v = labels.iter().position(|&wall| wall == 0).unwrap() as u32;
    let x = guarded.mesh.x[v as usize];
    assert!(guarded.move_vertex(v, x + Vector3::repeat(0.1)));
    let volume = exact(&mut guarded);
    assert!(guarded.move_vertex(v, x));
    guarded.guard.walls.all[0].most = 1.001 * volume;
    let outward = (x - center).normalize();
    assert!(!guarded.move_vertex(v, x - outward * 0.5) && guarded.mesh.x[v as usize] == x);
    assert!(guarded.move_vertex(v, x + outward * 0.5));
}

/// Pairs that cross come out alike whether the whole boundary is searched or what has changed since the last search: vertices
/// go through walls and back, and tetrahedra vanish.
pub fn what_has_changed_is_searched_like_the_whole() {
    let body = lattice([10; 3], 1.0, |_| 1);
    let mut mesh = prepare(body, &[], None).unwrap().mesh;
    let mut crossed = Crossed::default();
    assert!(crossed.search(&mut mesh).is_empty());
    let (mut noise, mut most, mut fewer) = (noise(7), 0, 0);
    let mut before = 0;
    for turn in 0..240 {
        let boundary = mesh.boundary_faces();
        let mut pick = |n: usize| ((noise() + 1.0) * 0.5 * n as f64) as usize % n;
        let v = boundary[pick(boundary.len())][pick(3)];
        if turn % 2 == 0 {
            mesh.tick();
        }
        if turn % 10 == 9 {
            let t = mesh.incidence.of(v)[0];
            mesh.remove(t);
        } else {
            let shift = Vector3::new(noise(), noise(), noise());
            mesh.set_position(v, mesh.x[v as usize] + shift);
        }
        if turn % 3 > 0 {
            let found = crossed.search(&mut mesh);
            assert_eq!(
                found,
                Crossed::default().search(&mut mesh.clone()),
                "{turn}"
            );
            most = most.max(found.len());
            fewer += usize::from(found.len() < before);
            before = found.len();
        }
    }
    assert!(most > 20 && fewer > 2, "{most} {fewer}");
}
