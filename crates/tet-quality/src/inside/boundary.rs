//! Which vertices an isosurface holds.

use geom_core::mesh::{Region, VertexKind};
use geom_core::{ImplicitField, Point3, TetMesh, Vector3};

use crate::boundary::field::Isosurface;
use crate::boundary::input::{disks, prepare};
use crate::mesh::editable::Freedom;
use crate::testing::{Ball, ball_in_box, lattice, noise};

/// A ball of region 1 on its isosurface, and a small body far from any; how the vertices on the
/// surface of each may move, except for those where it touches itself.
fn ball_and_bubble(region: Region, pinned: bool) -> [Vec<Freedom>; 2] {
    let [center, middle] = [4.0, 12.5].map(|x| Point3::new(x, 4.0, 4.0));
    let ball = Ball {
        center,
        radius: 2.6,
    };
    let small = Ball {
        center: middle,
        radius: 1.7,
    };
    let mesh = lattice([16, 8, 8], 1.0, |x| {
        if ball.value(x) >= 1.0 {
            1
        } else if small.value(x) >= 1.0 {
            region
        } else {
            0
        }
    });
    let (mut x, tets, regions, mut kinds) = mesh.into_parts();
    let mut noise = noise(1);
    for (kind, x) in kinds.iter_mut().zip(&mut x) {
        if *kind != VertexKind::Surface {
            continue;
        }
        // No fan is plane.
        *x += Vector3::new(noise(), noise(), noise()) * 0.05;
        if pinned && (*x - middle).norm() < 3.0 {
            *kind = VertexKind::Fixed;
        }
    }
    let mesh = TetMesh::with_kinds(x, tets, regions, kinds).unwrap();
    let field = Isosurface {
        field: &ball,
        level: 1.0,
        own: false,
        plane: None,
    };
    let input = prepare(mesh, &[], Some(&field)).unwrap();
    let mesh = &input.mesh;
    let disks = disks(mesh).unwrap();
    [center, middle].map(|c| {
        disks
            .iter()
            .filter(|&&v| (mesh.x[v as usize] - c).norm() < 3.5)
            .map(|&v| mesh.freedom[v as usize])
            .collect()
    })
}

pub fn a_bubble_off_the_isosurface_belongs_to_it_if_its_regions_do() {
    for (region, pinned, belongs) in [(1, false, true), (2, false, false), (1, true, false)] {
        let [on, off] = ball_and_bubble(region, pinned);
        assert!(on.len() > 20 && off.len() > 10);
        assert!(on.iter().all(|f| *f == Freedom::Field));
        let expected = if belongs {
            Freedom::Field
        } else {
            Freedom::Fixed
        };
        assert!(off.iter().all(|f| *f == expected), "{region} {pinned}");
    }
}

/// A ball with a wide dent that its mesh knows nothing of.
struct Dented(Ball);

impl ImplicitField for Dented {
    fn value(&self, x: &Point3) -> f64 {
        self.value_gradient(x).0
    }
    fn value_gradient(&self, x: &Point3) -> (f64, Vector3) {
        let (value, gradient) = self.0.value_gradient(x);
        let d = x - (self.0.center + Vector3::z() * self.0.radius);
        let dent = 0.9 * (-d.norm_squared() / 16.0).exp();
        (value - dent, gradient + d * (dent / 8.0))
    }
}

pub fn what_the_isosurface_surrounds_belongs_to_it() {
    let (mesh, ball) = ball_in_box(12, 1.0, 4.6);
    let dented = Dented(ball);
    let field = Isosurface {
        field: &dented,
        level: 1.0,
        own: false,
        plane: None,
    };
    let on_ball = |v: &u32| mesh.kinds()[*v as usize] == VertexKind::Surface;
    let on_ball: Vec<u32> = (0..mesh.positions().len() as u32).filter(on_ball).collect();
    let far = on_ball.iter().filter(|&&v| {
        let x = &mesh.positions()[v as usize];
        !field.holds(v, x, 1.0).unwrap()
    });
    let far = far.count();
    assert!(far > 10 && 4 * far < on_ball.len(), "{far} in the dent");
    let input = prepare(mesh.clone(), &[], Some(&field)).unwrap();
    let mesh = &input.mesh;
    let all = disks(mesh).unwrap();
    let disks = on_ball.iter().filter(|v| all.contains(v));
    assert!(disks.clone().count() > 100);
    for &v in disks {
        assert_eq!(mesh.freedom[v as usize], Freedom::Field, "{v}");
    }
}
