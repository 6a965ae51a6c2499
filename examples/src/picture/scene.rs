//! Meshes with light and colour: what to draw, and from where.

use geom_core::{Point3, TriMesh, Vector3, nalgebra};

use super::canvas::{Align, BAR_WIDTH};
use super::shade::{FINE, Frame};
use super::{Image, Rasterizer, Rgb, Scale};
use crate::Failure;

/// How a layer is coloured.
#[derive(Clone, Debug)]
pub enum Paint {
    /// One colour.
    Plain(Rgb),
    /// One colour per vertex, blended across faces.
    Vertices(Vec<Rgb>),
    /// One colour per face.
    Faces(Vec<Rgb>),
}

/// Triangles of one manner.
#[derive(Clone, Debug)]
pub struct Layer {
    /// Vertex positions, Å.
    pub positions: Vec<Point3>,
    /// Corners per triangle.
    pub faces: Vec<[u32; 3]>,
    /// Colours.
    pub paint: Paint,
    /// Unit normals per vertex for smooth shading; flat shading without.
    pub normals: Option<Vec<Vector3>>,
    /// Draw the edges of the triangles where they are large enough to be seen.
    pub edges: bool,
}

impl Layer {
    /// A surface, shaded smoothly, with thin edges.
    pub fn surface(mesh: &TriMesh, paint: Paint) -> Self {
        Self {
            positions: mesh.positions().to_vec(),
            faces: mesh.triangles().to_vec(),
            paint,
            normals: Some(mesh.vertex_normals()),
            edges: true,
        }
    }
}

/// From where a scene is seen, without perspective: an orthonormal right-handed frame.
#[derive(Clone, Copy, Debug)]
pub struct View {
    /// To the right in the picture.
    pub right: Vector3,
    /// Upwards in the picture.
    pub up: Vector3,
    /// From the scene to the eye.
    pub toward: Vector3,
}

impl View {
    /// The widest extent of the points to the right, the least towards the eye.
    pub fn principal(points: &[Point3]) -> Self {
        let equal: Vec<(Point3, f64)> = points.iter().map(|&p| (p, 1.0)).collect();
        Self::of_weighted(&equal)
    }

    /// The same of a surface, whatever its triangles: before and after remeshing it is seen from one side.
    pub fn of_surface(mesh: &TriMesh) -> Self {
        // Midpoints of edges integrate what is quadratic.
        let middles = (0..mesh.triangles().len()).flat_map(|t| {
            let [a, b, c] = mesh.corners(t);
            let area = mesh.doubled_area_normal(t).norm();
            [(a, b), (b, c), (c, a)].map(|(p, q)| (nalgebra::center(&p, &q), area))
        });
        Self::of_weighted(&middles.collect::<Vec<_>>())
    }

    fn of_weighted(points: &[(Point3, f64)]) -> Self {
        let total = points.iter().map(|p| p.1).sum::<f64>();
        let n = if total > 0.0 { total } else { 1.0 };
        let sum = points
            .iter()
            .fold(Vector3::zeros(), |s, (p, w)| s + p.coords * *w);
        let mean = sum / n;
        let covariance = points.iter().fold(nalgebra::Matrix3::zeros(), |s, (p, w)| {
            let d = p.coords - mean;
            s + d * d.transpose() * *w
        }) / n;
        let eigen = covariance.symmetric_eigen();
        let mut order = [0, 1, 2];
        order.sort_by(|&a, &b| eigen.eigenvalues[b].total_cmp(&eigen.eigenvalues[a]));
        // The sign of an eigenvector means nothing: take the one along the axes.
        let axis = |k: usize| {
            let v: Vector3 = eigen.eigenvectors.column(order[k]).into();
            if v[v.iamax()] < 0.0 { -v } else { v }
        };
        Self::of(axis(0), axis(1))
    }

    /// Like [`View::principal`], but along the coordinate axes.
    pub fn along_axes(points: &[Point3]) -> Self {
        let extent = geom_core::Aabb::of_points(points).extent();
        let mut order = [0, 1, 2];
        order.sort_by(|&a, &b| extent[b].total_cmp(&extent[a]));
        let axis = |k: usize| Vector3::ith(order[k], 1.0);
        Self::of(axis(0), axis(1))
    }

    /// Along x, with z upwards: membranes lie level.
    pub fn upright() -> Self {
        Self::of(Vector3::y(), Vector3::z())
    }

    /// The eye where both show as they are said.
    pub fn of(right: Vector3, up: Vector3) -> Self {
        let right = right.try_normalize(0.0).unwrap_or_else(Vector3::x);
        let up = (up - right * up.dot(&right))
            .try_normalize(0.0)
            .unwrap_or_else(Vector3::y);
        let toward = right.cross(&up);
        Self { right, up, toward }
    }

    /// The eye moved to the right and up by angles, in radians.
    pub fn turned(&self, right: f64, up: f64) -> Self {
        let about_up =
            nalgebra::Rotation3::from_axis_angle(&nalgebra::Unit::new_normalize(self.up), right);
        let (r, t) = (about_up * self.right, about_up * self.toward);
        let about_right =
            nalgebra::Rotation3::from_axis_angle(&nalgebra::Unit::new_normalize(r), -up);
        Self {
            right: r,
            up: about_right * self.up,
            toward: about_right * t,
        }
    }
}

/// The layers of a scene put together.
pub(crate) struct Merged {
    /// Vertex positions, Å.
    pub(crate) positions: Vec<Point3>,
    /// Corners per triangle.
    pub(crate) triangles: Vec<[u32; 3]>,
    /// A colour per vertex.
    pub(crate) colors: Vec<Rgb>,
}

/// What a picture shows.
#[derive(Clone, Debug)]
pub struct Scene {
    /// All triangles.
    pub layers: Vec<Layer>,
    /// From where.
    pub view: View,
    /// What the colours mean: drawn at the right.
    pub scale: Option<Scale>,
    /// What single colours stand for: drawn at the right, below the scale.
    pub legend: Vec<(Rgb, String)>,
    /// A line of text, drawn at the bottom.
    pub caption: Option<String>,
}

impl Scene {
    /// Layers seen from somewhere, without colour bar, legend and caption.
    pub fn new(layers: Vec<Layer>, view: View) -> Self {
        Self {
            layers,
            view,
            scale: None,
            legend: Vec::new(),
            caption: None,
        }
    }

    /// All layers as one list of triangles with a colour per vertex.
    pub(crate) fn merged(&self) -> Merged {
        let (mut positions, mut triangles, mut colors) = (Vec::new(), Vec::new(), Vec::new());
        for layer in &self.layers {
            let first = positions.len() as u32;
            let corner = |v: u32| layer.positions[v as usize];
            match &layer.paint {
                // Each face has corners of its own, so that its colour ends with it.
                Paint::Faces(of_faces) => {
                    for (face, &color) in layer.faces.iter().zip(of_faces) {
                        let next = positions.len() as u32;
                        triangles.push([next, next + 1, next + 2]);
                        positions.extend(face.map(corner));
                        colors.extend([color; 3]);
                    }
                    continue;
                }
                Paint::Plain(color) => colors.extend(vec![*color; layer.positions.len()]),
                Paint::Vertices(of_vertices) => colors.extend(of_vertices),
            }
            positions.extend(&layer.positions);
            triangles.extend(layer.faces.iter().map(|f| f.map(|v| first + v)));
        }
        Merged {
            positions,
            triangles,
            colors,
        }
    }

    /// Draws the scene so that it fills a picture of this size.
    pub fn draw(&self, rasterizer: &Rasterizer, size: [usize; 2]) -> Result<Image, Failure> {
        let own: Vec<&Paint> = self.layers.iter().map(|l| &l.paint).collect();
        let mut images = self.paint(rasterizer, size, &[own])?;
        Ok(images.remove(0))
    }

    /// Draws the scene once for each paint, which its only layer wears instead of its own. What does not
    /// depend on colour is computed once.
    pub fn draw_each(
        &self,
        rasterizer: &Rasterizer,
        size: [usize; 2],
        paints: &[Paint],
    ) -> Result<Vec<Image>, Failure> {
        assert_eq!(self.layers.len(), 1, "a paint for the only layer");
        let paintings: Vec<_> = paints.iter().map(|p| vec![p]).collect();
        self.paint(rasterizer, size, &paintings)
    }

    fn paint(
        &self,
        rasterizer: &Rasterizer,
        [width, height]: [usize; 2],
        paintings: &[Vec<&Paint>],
    ) -> Result<Vec<Image>, Failure> {
        let explained = self.scale.is_some() || !self.legend.is_empty();
        let bar = if explained { BAR_WIDTH } else { 0 };
        let foot = if self.caption.is_some() { 44 } else { 0 };
        let room = [(width - bar) * FINE, (height - foot) * FINE];
        let size = [width * FINE, height * FINE];
        let frame = Frame::fit(&self.layers, &self.view, room, size);
        let seen = rasterizer.visible(&frame.triangles(), size)?.triangle;
        let mut images = frame.shade(&seen, paintings);
        for image in &mut images {
            // The legend stands at the bottom, the scale has what is left.
            let mut bottom = height - height / 7;
            if !self.legend.is_empty() {
                let top = image.legend(&self.legend, width - BAR_WIDTH, bottom);
                bottom = top.saturating_sub(24);
            }
            if let Some(scale) = &self.scale {
                let top = (height / 7 + 20).min(bottom.saturating_sub(1));
                image.color_bar(scale, width - BAR_WIDTH, [top, bottom]);
            }
            if let Some(caption) = &self.caption {
                let middle = ((width - bar) / 2, height - 26);
                image.text(caption, middle, 22.0, Align::Center);
            }
        }
        Ok(images)
    }
}
