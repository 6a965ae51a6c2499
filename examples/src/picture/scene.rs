//! Meshes with light and colour: what to draw, from where, and the shading.

use std::sync::LazyLock;

use geom_core::{GpuError, Point3, TetMesh, TriMesh, Vector3, mesh, nalgebra};
use rayon::prelude::*;

use super::canvas::{Align, BAR_WIDTH};
use super::{Corner, Image, Rasterizer, Rgb, Scale};

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
        let n = points.len().max(1) as f64;
        let mean = points.iter().fold(Vector3::zeros(), |s, p| s + p.coords) / n;
        let covariance = points.iter().fold(nalgebra::Matrix3::zeros(), |s, p| {
            let d = p.coords - mean;
            s + d * d.transpose()
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

    fn of(right: Vector3, up: Vector3) -> Self {
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

/// What lies behind a plane of a tetrahedral mesh: whole tetrahedra, their cut faces coloured one by
/// one with `colors`, the boundary of the mesh plain. The plane is seen face-on by `view` and lies at
/// `depth` of the extent of the mesh (0 nearest to the eye, 1 farthest).
pub fn cut_tets(mesh: &TetMesh, view: &View, depth: f64, colors: &[Rgb], skin: Rgb) -> Vec<Layer> {
    let height = |p: &Point3| view.toward.dot(&p.coords);
    let (low, high) = mesh
        .positions()
        .iter()
        .map(height)
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), h| {
            (a.min(h), b.max(h))
        });
    let plane = high - depth * (high - low);
    let kept: Vec<u32> = (0..mesh.tets().len() as u32)
        .filter(|&t| mesh.corners(t as usize).iter().map(height).sum::<f64>() <= 4.0 * plane)
        .collect();
    // Faces of kept tetrahedra; those of only one kept tetrahedron are seen.
    let mut faces: Vec<([u32; 3], u32)> = kept
        .par_iter()
        .flat_map_iter(|&t| {
            (0..4u32).map(move |k| {
                let mut key = mesh::FACES[k as usize].map(|c| mesh.tets()[t as usize][c]);
                key.sort_unstable();
                (key, 4 * t + k)
            })
        })
        .collect();
    faces.par_sort_unstable();
    let mut seen: Vec<u32> = faces
        .chunk_by(|a, b| a.0 == b.0)
        .filter(|group| group.len() == 1)
        .map(|group| group[0].1)
        .collect();
    seen.sort_unstable();
    // Of those, the ones on the boundary of the whole mesh.
    let mut boundary: Vec<[u32; 3]> = mesh
        .interfaces()
        .iter()
        .filter(|f| f.outside == mesh::OUTSIDE)
        .map(|f| {
            let mut key = f.triangle;
            key.sort_unstable();
            key
        })
        .collect();
    boundary.sort_unstable();
    let (mut cut, mut cut_colors, mut hull) = (Vec::new(), Vec::new(), Vec::new());
    for slot in seen {
        let tet = (slot / 4) as usize;
        let face = mesh::FACES[(slot % 4) as usize].map(|c| mesh.tets()[tet][c]);
        let mut key = face;
        key.sort_unstable();
        if boundary.binary_search(&key).is_ok() {
            hull.push(face);
        } else {
            cut.push(face);
            cut_colors.push(colors[tet]);
        }
    }
    let layer = |faces, paint| Layer {
        positions: mesh.positions().to_vec(),
        faces,
        paint,
        normals: None,
        edges: true,
    };
    vec![
        layer(cut, Paint::Faces(cut_colors)),
        layer(hull, Paint::Plain(skin)),
    ]
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
    /// A line of text, drawn at the bottom.
    pub caption: Option<String>,
}

/// Sub-pixels per pixel and axis.
const FINE: usize = 3;

impl Scene {
    /// Layers seen from somewhere, without colour bar and caption.
    pub fn new(layers: Vec<Layer>, view: View) -> Self {
        Self {
            layers,
            view,
            scale: None,
            caption: None,
        }
    }

    /// Draws the scene so that it fills a picture of this size.
    pub fn draw(
        &self,
        rasterizer: &Rasterizer,
        [width, height]: [usize; 2],
    ) -> Result<Image, GpuError> {
        let bar = if self.scale.is_some() { BAR_WIDTH } else { 0 };
        let foot = if self.caption.is_some() { 44 } else { 0 };
        let room = [(width - bar) * FINE, (height - foot) * FINE];
        let size = [width * FINE, height * FINE];
        let frame = Frame::fit(&self.layers, &self.view, room, size);
        let seen = rasterizer.visible(&frame.triangles(), size)?.triangle;
        let mut image = frame.shade(&self.layers, &seen, [width, height]);
        if let Some(scale) = &self.scale {
            let (top, bottom) = (height / 7 + 20, height - height / 7);
            image.color_bar(scale, width - BAR_WIDTH, [top, bottom]);
        }
        if let Some(caption) = &self.caption {
            image.text(
                caption,
                ((width - bar) / 2, height - 26),
                22.0,
                Align::Center,
            );
        }
        Ok(image)
    }
}

/// All vertices in sub-pixels: x right, y down, z towards the eye.
struct Frame {
    places: Vec<Vec<[f32; 3]>>,
    /// Corners per triangle with its layer, and its number within that layer.
    faces: Vec<(u32, u32, [u32; 3])>,
    size: [usize; 2],
    /// Lowest and highest z.
    depth: [f32; 2],
    view: View,
}

impl Frame {
    fn fit(layers: &[Layer], view: &View, room: [usize; 2], size: [usize; 2]) -> Self {
        let axes = [view.right, -view.up, view.toward];
        let (mut low, mut high) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
        for layer in layers {
            for v in layer.faces.iter().flatten() {
                for k in 0..3 {
                    let c = axes[k].dot(&layer.positions[*v as usize].coords);
                    low[k] = low[k].min(c);
                    high[k] = high[k].max(c);
                }
            }
        }
        let extent = |k: usize| (high[k] - low[k]).max(1e-12);
        let per_length = 0.92 * (room[0] as f64 / extent(0)).min(room[1] as f64 / extent(1));
        let middle = [0, 1, 2].map(|k| 0.5 * (low[k] + high[k]));
        let center = [room[0] as f64 / 2.0, room[1] as f64 / 2.0, 0.0];
        let places = layers
            .iter()
            .map(|layer| {
                layer
                    .positions
                    .iter()
                    .map(|p| {
                        [0, 1, 2].map(|k| {
                            ((axes[k].dot(&p.coords) - middle[k]) * per_length + center[k]) as f32
                        })
                    })
                    .collect()
            })
            .collect();
        let faces = layers
            .iter()
            .zip(0..)
            .flat_map(|(layer, l)| layer.faces.iter().zip(0..).map(move |(&f, n)| (l, n, f)))
            .collect();
        let half = (0.5 * extent(2) * per_length) as f32;
        Self {
            places,
            faces,
            size,
            depth: [-half, half],
            view: *view,
        }
    }

    fn corners(&self, triangle: u32) -> [[f32; 3]; 3] {
        let (layer, _, face) = self.faces[triangle as usize];
        face.map(|v| self.places[layer as usize][v as usize])
    }

    /// In clip space.
    fn triangles(&self) -> Vec<[Corner; 3]> {
        let [w, h] = self.size.map(|n| n as f32);
        let [low, high] = self.depth;
        (0..self.faces.len() as u32)
            .into_par_iter()
            .map(|t| {
                self.corners(t).map(|[x, y, z]| {
                    let near = (high - z) / (high - low).max(1e-6);
                    [2.0 * x / w - 1.0, 1.0 - 2.0 * y / h, 0.001 + 0.998 * near]
                })
            })
            .collect()
    }

    fn shade(&self, layers: &[Layer], seen: &[u32], [width, height]: [usize; 2]) -> Image {
        let fine_width = self.size[0];
        let mut depth = vec![f32::NEG_INFINITY; seen.len()];
        depth
            .par_chunks_mut(fine_width)
            .enumerate()
            .for_each(|(y, row)| {
                for (x, z) in row.iter_mut().enumerate() {
                    let triangle = seen[y * fine_width + x];
                    if triangle != u32::MAX {
                        let c = self.corners(triangle);
                        let b = weights(&c, x, y);
                        *z = b[0] * c[0][2] + b[1] * c[1][2] + b[2] * c[2][2];
                    }
                }
            });
        let mut image = Image::filled(width, height, [255; 3]);
        image
            .rgb
            .par_chunks_mut(3 * width)
            .enumerate()
            .for_each(|(y, row)| {
                for (x, pixel) in row.chunks_exact_mut(3).enumerate() {
                    let mut light = [0.0f32; 3];
                    // The middle of the pixel stands for all of it that lies as deep.
                    let (mx, my) = (x * FINE + FINE / 2, y * FINE + FINE / 2);
                    let middle = my * fine_width + mx;
                    let open = (seen[middle] != u32::MAX).then(|| {
                        let flat = eye_normal(&self.corners(seen[middle]));
                        self.openness(flat, &depth, mx, my)
                    });
                    for sub in 0..FINE * FINE {
                        let (fx, fy) = (x * FINE + sub % FINE, y * FINE + sub / FINE);
                        let here = fy * fine_width + fx;
                        let part = if seen[here] == u32::MAX {
                            background(fy as f32 / self.size[1] as f32)
                        } else {
                            let near = (depth[here] - depth[middle]).abs() < 2.0 * FINE as f32;
                            let open = open.filter(|_| near);
                            self.lit(layers, seen[here], &depth, open, fx, fy)
                        };
                        for k in 0..3 {
                            light[k] += part[k] / (FINE * FINE) as f32;
                        }
                    }
                    for k in 0..3 {
                        pixel[k] = to_srgb(light[k]);
                    }
                }
            });
        image
    }

    /// Linear light that one sub-pixel sends to the eye; `open` is its openness, if known.
    fn lit(
        &self,
        layers: &[Layer],
        triangle: u32,
        depth: &[f32],
        open: Option<f32>,
        x: usize,
        y: usize,
    ) -> [f32; 3] {
        let (layer, number, face) = self.faces[triangle as usize];
        let layer = &layers[layer as usize];
        let corners = self.corners(triangle);
        let b = weights(&corners, x, y);

        let flat = eye_normal(&corners);
        let mut normal = flat;
        if let Some(normals) = &layer.normals {
            let n = face.iter().zip(b).fold(Vector3::zeros(), |s, (&v, w)| {
                s + normals[v as usize] * f64::from(w)
            });
            let n = [
                n.dot(&self.view.right),
                -n.dot(&self.view.up),
                n.dot(&self.view.toward),
            ];
            let n = unit(n.map(|c| c as f32));
            normal = if n[2] < 0.0 { n.map(|c| -c) } else { n };
        }
        let color = match &layer.paint {
            Paint::Plain(color) => color.map(to_linear),
            Paint::Faces(colors) => colors[number as usize].map(to_linear),
            Paint::Vertices(colors) => {
                let c = face.map(|v| colors[v as usize].map(to_linear));
                [0, 1, 2].map(|k| b[0] * c[0][k] + b[1] * c[1][k] + b[2] * c[2][k])
            }
        };

        let open = open.unwrap_or_else(|| self.openness(flat, depth, x, y));
        let [nx, ny, nz] = [normal[0], -normal[1], normal[2]];
        let toward = |l: [f32; 3]| {
            let l = unit(l);
            (nx * l[0] + ny * l[1] + nz * l[2]).max(0.0)
        };
        let sky = 0.75 + 0.25 * ny;
        let mut light = 0.46 * sky * open
            + 0.70 * toward([-0.45, 0.62, 0.75]) * (0.35 + 0.65 * open)
            + 0.20 * toward([0.80, -0.10, 0.55]) * open;
        // A soft dark rim separates what lies in front.
        light *= 0.72 + 0.28 * (nz / 0.4).min(1.0);
        let gleam = 0.09 * toward([-0.25, 0.36, 1.6]).powi(48) * open;
        let line = if layer.edges { edge(&corners, b) } else { 0.0 };
        let [low, high] = self.depth;
        let z = depth[y * self.size[0] + x];
        let haze = 0.22
            * ((high - z) / (high - low).max(1e-6))
                .clamp(0.0, 1.0)
                .powi(2);
        let air = background(y as f32 / self.size[1] as f32);
        [0, 1, 2].map(|k| {
            let lit = (color[k] * light * (1.0 - line) + gleam).min(1.0);
            lit + (air[k] - lit) * haze
        })
    }

    /// How much of the sky is seen from here: 1 in the open, less in grooves.
    fn openness(&self, normal: [f32; 3], depth: &[f32], x: usize, y: usize) -> f32 {
        const SAMPLES: usize = 24;
        let reach = 0.085 * self.size[1] as f32;
        let here = depth[y * self.size[0] + x];
        let turn = noise(x as u32, y as u32);
        let mut hidden = 0.0;
        for i in 0..SAMPLES {
            let t = (i as f32 + turn) / SAMPLES as f32;
            // Golden angle: samples fill the disk evenly; more of them near.
            let angle = std::f32::consts::TAU * (turn + 0.618_034 * i as f32);
            let r = 2.0 + reach * t * t;
            let (dx, dy) = (r * angle.cos(), r * angle.sin());
            let (sx, sy) = (x as f32 + dx, y as f32 + dy);
            if sx < 0.0 || sy < 0.0 || sx >= self.size[0] as f32 || sy >= self.size[1] as f32 {
                continue;
            }
            let z = depth[sy as usize * self.size[0] + sx as usize];
            if z == f32::NEG_INFINITY {
                continue;
            }
            let v = [dx, dy, z - here];
            let length = (v[0] * v[0] + v[1] * v[1] + v[2] * v[2]).sqrt();
            let above = (v[0] * normal[0] + v[1] * normal[1] + v[2] * normal[2]) / length;
            let near = 1.0 - (length / (1.6 * reach)).min(1.0);
            hidden += (above - 0.06).max(0.0) * near;
        }
        (1.0 - 1.9 * hidden / SAMPLES as f32).clamp(0.0, 1.0)
    }
}

/// Barycentric weights of the centre of a sub-pixel, clamped into the triangle.
fn weights(c: &[[f32; 3]; 3], x: usize, y: usize) -> [f32; 3] {
    let (x, y) = (x as f32 + 0.5, y as f32 + 0.5);
    let cross = |a: &[f32; 3], b: &[f32; 3]| (a[0] - x) * (b[1] - y) - (a[1] - y) * (b[0] - x);
    let w = [
        cross(&c[1], &c[2]),
        cross(&c[2], &c[0]),
        cross(&c[0], &c[1]),
    ];
    let area = w[0] + w[1] + w[2];
    if area.abs() < 1e-6 {
        return [1.0 / 3.0; 3];
    }
    let w = w.map(|v| (v / area).max(0.0));
    let sum = w[0] + w[1] + w[2];
    w.map(|v| v / sum)
}

/// Unit normal of a triangle on the side of the eye.
fn eye_normal([a, b, c]: &[[f32; 3]; 3]) -> [f32; 3] {
    let (u, v) = (
        [0, 1, 2].map(|k| b[k] - a[k]),
        [0, 1, 2].map(|k| c[k] - a[k]),
    );
    let n = [
        u[1] * v[2] - u[2] * v[1],
        u[2] * v[0] - u[0] * v[2],
        u[0] * v[1] - u[1] * v[0],
    ];
    let n = unit(n);
    if n[2] < 0.0 { n.map(|c| -c) } else { n }
}

fn unit(v: [f32; 3]) -> [f32; 3] {
    let length = (v[0] * v[0] + v[1] * v[1] + v[2] * v[2]).sqrt();
    if length > 0.0 {
        v.map(|c| c / length)
    } else {
        [0.0, 0.0, 1.0]
    }
}

/// How dark the nearest edge of the triangle is here: nothing for triangles too small to be seen.
fn edge(c: &[[f32; 3]; 3], b: [f32; 3]) -> f32 {
    let side = |i: usize, j: usize| (c[i][0] - c[j][0]).hypot(c[i][1] - c[j][1]);
    let sides = [side(1, 2), side(2, 0), side(0, 1)];
    let doubled = ((c[1][0] - c[0][0]) * (c[2][1] - c[0][1])
        - (c[1][1] - c[0][1]) * (c[2][0] - c[0][0]))
        .abs();
    let longest = sides[0].max(sides[1]).max(sides[2]).max(1e-6);
    let fine = FINE as f32;
    let size = (doubled.sqrt() / fine).min(longest / fine);
    let strength = 0.45 * ((size - 3.0) / 12.0).clamp(0.0, 1.0);
    let nearest = (0..3)
        .map(|k| b[k] * doubled / sides[k].max(1e-6))
        .fold(f32::INFINITY, f32::min);
    strength * (1.3 - nearest / (0.45 * fine)).clamp(0.0, 1.0)
}

/// White, a little darker towards the bottom.
fn background(t: f32) -> [f32; 3] {
    let shade = 1.0 - 0.10 * t * t;
    [shade * 0.985, shade * 0.99, shade]
}

/// A number in 0…1 that looks random but depends on the place alone.
fn noise(x: u32, y: u32) -> f32 {
    let mut h = x.wrapping_mul(0x9e37_79b1) ^ y.wrapping_mul(0x85eb_ca77);
    h = (h ^ (h >> 15)).wrapping_mul(0x2c1b_3c6d);
    h = (h ^ (h >> 12)).wrapping_mul(0x297a_2d39);
    (h >> 8) as f32 / (1 << 24) as f32
}

fn to_linear(c: u8) -> f32 {
    static LIGHT: LazyLock<[f32; 256]> = LazyLock::new(|| {
        std::array::from_fn(|c| {
            let c = c as f32 / 255.0;
            if c <= 0.04045 {
                c / 12.92
            } else {
                ((c + 0.055) / 1.055).powf(2.4)
            }
        })
    });
    LIGHT[usize::from(c)]
}

fn to_srgb(c: f32) -> u8 {
    let c = c.clamp(0.0, 1.0);
    let s = if c <= 0.003_130_8 {
        12.92 * c
    } else {
        1.055 * c.powf(1.0 / 2.4) - 0.055
    };
    (255.0 * s).round() as u8
}

#[cfg(test)]
mod tests {
    use super::*;
    use geom_core::mesh::shapes;

    fn sphere(paint: Paint) -> Scene {
        let mesh = shapes::icosphere(3.0, 3);
        let view = View::along_axes(mesh.positions());
        Scene::new(vec![Layer::surface(&mesh, paint)], view)
    }

    #[test]
    fn a_sphere_fills_the_picture_and_is_lit_from_above_left() {
        let image = sphere(Paint::Plain([200, 200, 200]))
            .draw(&Rasterizer::Cpu, [200, 200])
            .unwrap();
        let sum = |x: usize, y: usize| image.pixel(x, y).iter().map(|&c| u32::from(c)).sum::<u32>();
        assert!(
            sum(60, 60) > sum(140, 150) + 60,
            "the light comes from above left"
        );
        assert!(sum(2, 2) > 740, "the background is nearly white");
        // 92 % of 200 pixels across.
        assert!(sum(100, 5) > 740 && sum(100, 12) < 740);
    }

    #[test]
    fn pictures_do_not_depend_on_threads() {
        geom_core::testing::same_on_any_threads(|| {
            sphere(Paint::Plain([90, 150, 200]))
                .draw(&Rasterizer::Cpu, [120, 90])
                .unwrap()
        });
    }

    #[test]
    fn a_cut_shows_the_tetrahedra_behind_the_plane() {
        // Two tetrahedra that share the face x = 0.
        let p = |x: f64, y: f64, z: f64| Point3::new(x, y, z);
        let positions = vec![
            p(0., 0., 0.),
            p(0., 1., 0.),
            p(0., 0., 1.),
            p(1., 0., 0.),
            p(-1., 0., 0.),
        ];
        let mesh = TetMesh::new(positions, vec![[0, 1, 2, 3], [0, 2, 1, 4]]).unwrap();
        let view = View::of(Vector3::y(), Vector3::z());
        assert!((view.toward - Vector3::x()).norm() < 1e-12);
        let layers = cut_tets(&mesh, &view, 0.5, &[[1; 3], [2; 3]], [9; 3]);
        assert_eq!(layers[0].faces.len(), 1, "the shared face is the cut");
        assert!(matches!(&layers[0].paint, Paint::Faces(c) if c[..] == [[2; 3]]));
        assert_eq!(layers[1].faces.len(), 3);
    }

    #[test]
    fn views_are_right_handed() {
        let points = [
            Point3::origin(),
            Point3::new(1.0, 5.0, 2.0),
            Point3::new(0.0, 4.0, -3.0),
            Point3::new(9.0, 1.0, 0.5),
        ];
        for view in [
            View::principal(&points),
            View::along_axes(&points),
            View::principal(&points).turned(0.4, 0.3),
            View::principal(&[]),
        ] {
            assert!((view.right.cross(&view.up) - view.toward).norm() < 1e-12);
            assert!((view.toward.norm() - 1.0).abs() < 1e-12);
        }
        let turned = View::along_axes(&points).turned(0.0, 0.3);
        assert!(
            turned.toward.dot(&View::along_axes(&points).up) > 0.0,
            "the eye moved up"
        );
    }
}
