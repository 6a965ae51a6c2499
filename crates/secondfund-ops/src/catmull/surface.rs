//! The limit surface of a quad mesh.

use geom_core::algebra::SparseMatrix;
use geom_core::compute::parallel;
use geom_core::mesh::Halfedges;
use geom_core::{Point3, QuadMesh, Vector3, VertexId};

use super::ghosts::Extended;
use super::limit::{interpolate, mask};
use super::patches::{Patch, has_two_odd_corners, patches};
use super::subdivide::subdivide;
use super::tables::{ROWS, Tables};
use crate::Error;
use crate::forms::{Forms, Symmetric};
use crate::options::Quadrature;

/// Quads at a boundary vertex up to which the surface has a tangent plane there.
const SMOOTH_RIM: usize = 3;

/// The limit surface of Catmull–Clark subdivision: bicubic, C² but for its extraordinary vertices, where it
/// is C¹. Open or closed, of any valence from 3 to 32; on boundaries from 1 to 32 quads meet at a vertex. Where more than
/// three do, the rules of subdivision give no tangent plane at the vertex itself (Biermann, Levin and Zorin,
/// *Piecewise smooth subdivision surfaces with normal control*, 2000): areas and integrals are right, curvatures near it
/// are not ([`Surface::rough_rims`]).
#[derive(Clone, Debug)]
pub struct Surface {
    control: QuadMesh,
    refined: bool,
    flipped: bool,
    patches: Vec<Patch>,
    mask: SparseMatrix,
}

/// A point of the surface with its derivatives by the parameters of its quad.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Jet {
    /// x, Å.
    pub position: Point3,
    /// `x_u`, `x_v`.
    pub first: [Vector3; 2],
    /// `x_uu`, `x_uv`, `x_vv`.
    pub second: [Vector3; 3],
}

impl Jet {
    /// `x_u × x_v`: the outward normal times the area element.
    #[inline]
    pub fn area_normal(&self) -> Vector3 {
        self.first[0].cross(&self.first[1])
    }

    /// The fundamental forms; entries are not finite where the surface has no tangent plane.
    #[inline]
    pub fn forms(&self) -> Forms {
        let [u, v] = self.first;
        let [uu, uv, vv] = self.second;
        let n = -self.area_normal().normalize();
        Forms {
            first: Symmetric::new(u.dot(&u), u.dot(&v), v.dot(&v)),
            second: Symmetric::new(n.dot(&uu), n.dot(&uv), n.dot(&vv)),
        }
    }
}

impl Surface {
    /// The limit surface of a control mesh. Refined once if a quad has two extraordinary corners; a closed
    /// mesh that encloses a negative volume is turned inside out.
    ///
    /// # Errors
    /// Meshes that are not manifold; [`Error::Valence`].
    pub fn new(control: QuadMesh) -> Result<Self, Error> {
        let edges = Halfedges::<4>::of_quads(&control)?;
        let closed = edges.iter().all(|h| edges.twin(h).is_some());
        let flipped = closed && control.volume() < 0.0;
        let mut control = if flipped { turned(control)? } else { control };
        let refined = has_two_odd_corners(&edges_of(&control)?, control.quads().len());
        if refined {
            control = subdivide(&control)?;
        }
        let extended = Extended::of(&control, &edges_of(&control)?);
        Ok(Self {
            patches: patches(&extended, control.quads().len())?,
            mask: mask(&extended)?,
            control,
            refined,
            flipped,
        })
    }

    /// The surface whose limit positions are the vertices of `samples`: of fourth order in the size of the
    /// quads away from extraordinary vertices.
    ///
    /// Between samples that are noisy the surface may bulge.
    ///
    /// # Errors
    /// As [`Surface::new`].
    pub fn interpolating(samples: &QuadMesh) -> Result<Self, Error> {
        let extended = Extended::of(samples, &edges_of(samples)?);
        let control = interpolate(&mask(&extended)?, samples.positions());
        Self::new(QuadMesh::new(control, samples.quads().to_vec())?)
    }

    /// The control mesh of the patches: that given, or once refined.
    /// Matrices and modes are by its vertices, not by those of the mesh that was given.
    pub fn control(&self) -> &QuadMesh {
        &self.control
    }

    /// Was the mesh refined? Then child k of the given quad q is quad `4 q + k`.
    pub fn refined(&self) -> bool {
        self.refined
    }

    /// Was the mesh turned inside out?
    pub fn flipped(&self) -> bool {
        self.flipped
    }

    /// The boundary vertices where more than three quads meet: there the surface has no tangent plane.
    pub fn rough_rims(&self) -> Vec<u32> {
        let edges = edges_of(&self.control).expect("the mesh of the patches");
        let rough = |v: &u32| {
            let v = VertexId(*v);
            edges.on_boundary(v) && edges.around(v).count() > SMOOTH_RIM
        };
        (0..self.control.positions().len() as u32)
            .filter(rough)
            .collect()
    }

    /// The limit positions of the control vertices.
    /// Per vertex of [`Surface::control`], Å. A vertex of no quad stays where it is.
    pub fn limit_positions(&self) -> Vec<Point3> {
        self.limit_of(self.control.positions())
    }

    /// The same for other control points.
    pub(crate) fn limit_of(&self, points: &[Point3]) -> Vec<Point3> {
        let block: Vec<f64> = points.iter().flat_map(|p| [p.x, p.y, p.z]).collect();
        let limit = self.mask.multiply(&block, 3);
        limit
            .chunks_exact(3)
            .map(|p| Point3::new(p[0], p[1], p[2]))
            .collect()
    }

    /// The quads of the control mesh at their limit positions.
    pub fn limit_mesh(&self) -> QuadMesh {
        QuadMesh::new(self.limit_positions(), self.control.quads().to_vec())
            .expect("the limit of a valid mesh is valid")
    }

    /// Functions given by their coefficients, at the limit positions of the vertices.
    pub(crate) fn limit_values(&self, coefficients: &[Vec<f64>]) -> Vec<Vec<f64>> {
        let limit = |c: &Vec<f64>| self.mask.multiply(c, 1);
        coefficients.iter().map(limit).collect()
    }

    pub(crate) fn patches(&self) -> &[Patch] {
        &self.patches
    }

    pub(crate) fn tables(&self, quadrature: Quadrature) -> Tables {
        Tables::of(self.patches.iter().map(|p| p.corner), quadrature)
    }

    /// The points of the quadrature of all quads with their weights, quad after quad: the weight times the
    /// length of [`Jet::area_normal`] is an area. The last corner at an extraordinary vertex is left out.
    ///
    /// # Errors
    /// A quadrature out of its range.
    pub fn jets(&self, quadrature: Quadrature) -> Result<Vec<(Jet, f64)>, Error> {
        quadrature.check()?;
        let tables = self.tables(quadrature);
        let of_patch = |patch: &Patch| -> Vec<(Jet, f64)> {
            let table = tables.of_corner(patch.corner);
            let points = self.points_of(patch, self.control.positions());
            (0..table.weights.len())
                .map(|q| (jet(table.point(q), &points), table.weights[q]))
                .collect()
        };
        let all: Vec<_> = parallel::map_each(&self.patches, of_patch);
        Ok(all.concat())
    }

    /// The control points of a patch's table.
    pub(crate) fn points_of(&self, patch: &Patch, positions: &[Point3]) -> Vec<Point3> {
        let real = patch.ids.iter().map(|&v| positions[v as usize]);
        match &patch.fold {
            None => real.collect(),
            Some(fold) => {
                let real: Vec<Vector3> = real.map(|p| p.coords).collect();
                let sum = |row: &[f64]| row.iter().zip(&real).map(|(w, x)| x * *w).sum::<Vector3>();
                fold.chunks(real.len())
                    .map(|row| Point3::from(sum(row)))
                    .collect()
            }
        }
    }
}

/// The point with these six rows of the basis.
pub(crate) fn jet(rows: &[f64], points: &[Point3]) -> Jet {
    let n = points.len();
    let sum = |k: usize| -> Vector3 {
        let row = &rows[k * n..(k + 1) * n];
        row.iter().zip(points).map(|(w, p)| p.coords * *w).sum()
    };
    let [x, u, v, uu, uv, vv]: [Vector3; ROWS] = std::array::from_fn(sum);
    Jet {
        position: Point3::from(x),
        first: [u, v],
        second: [uu, uv, vv],
    }
}

/// The half-edges of a mesh of quads.
fn edges_of(mesh: &QuadMesh) -> Result<Halfedges<4>, Error> {
    Ok(Halfedges::<4>::of_quads(mesh)?)
}

/// The same quads seen from the other side: each starts at the same corner and goes the other way.
pub(crate) fn turned(mesh: QuadMesh) -> Result<QuadMesh, Error> {
    let (positions, quads) = mesh.into_parts();
    let back = quads.iter().map(|&[a, b, c, d]| [a, d, c, b]);
    Ok(QuadMesh::new(positions, back.collect())?)
}

/// What holds here, for the tests.
#[cfg(feature = "testing")]
pub(crate) mod laws {
    use super::super::tables::Corner;
    use super::*;
    use crate::testing::{halved, shaken_quads};
    use geom_core::mesh::shapes;

    /// Points along the borders of a patch at multiples of an eighth, an extraordinary corner and what is next to it left
    /// out, with their normals.
    fn borders(surface: &Surface) -> Vec<Vec<(Point3, Vector3)>> {
        let rule: Vec<(f64, f64)> = (0..=8).map(|k| (f64::from(k) / 8.0, 1.0)).collect();
        let corners = surface.patches.iter().map(|p| p.corner);
        let tables = Tables::with_rule(corners, &rule, 2);
        let across = (0..9).flat_map(|j| (0..9).map(move |i| [i, j]));
        let square: Vec<[u32; 2]> = across.collect();
        // In sixteenths: the children of the first level, in steps of one, and those of the second.
        let place = |corner: Corner, q: usize| {
            let [i, j] = square[q % 81];
            let Corner::Inside(_) = corner else {
                return [4 * i, 4 * j];
            };
            let [right, up] = [[1, 0], [1, 1], [0, 1]][q / 81 % 3];
            let step = if q < 3 * 81 { 2 } else { 1 };
            [step * (i + 8 * right), step * (j + 8 * up)]
        };
        let of_patch = |patch: &Patch| {
            let (table, corner) = (tables.of_corner(patch.corner), patch.corner);
            let points = surface.points_of(patch, surface.control.positions());
            let wanted = |q: &usize| {
                let [u, v] = place(corner, *q);
                let on_border = [u, v].iter().any(|&x| x == 0 || x == 32);
                on_border && u % 4 == 0 && v % 4 == 0 && u.max(v) >= 8
            };
            let at = |q| {
                let jet = jet(table.point(q), &points);
                (jet.position, jet.area_normal().normalize())
            };
            (0..table.weights.len()).filter(wanted).map(at).collect()
        };
        surface.patches.iter().map(of_patch).collect()
    }

    /// Position and normal are those of the neighbour, across regular borders and those to extraordinary vertices.
    pub fn patches_meet_without_a_gap_or_a_crease() {
        let net = shaken_quads(&halved(&shapes::icosphere(1.0, 0)), 0.05, 7);
        let surface = Surface::new(net).unwrap();
        assert!(surface.refined());
        let all = borders(&surface);
        for (f, own) in all.iter().enumerate() {
            let others = all.iter().enumerate().filter(|&(g, _)| g != f);
            let others: Vec<&(Point3, Vector3)> = others.flat_map(|(_, o)| o).collect();
            assert!(own.len() >= 28, "patch {f}: {}", own.len());
            for (p, n) in own {
                let same = others.iter().filter(|(q, _)| (p - q).norm() < 1e-13);
                let turned: Vec<f64> = same.map(|(_, m)| (n - m).norm()).collect();
                assert!(!turned.is_empty(), "patch {f}: nothing meets {p}");
                assert!(turned.iter().all(|&t| t < 1e-11), "patch {f}: {turned:?}");
            }
        }
    }
}
