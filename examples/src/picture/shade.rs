//! Light and colour: what each pixel of a scene sends to the eye, once it is known which triangle is
//! seen where.
//!
//! A pixel is the mean of 3 × 3 sub-pixels. Light is computed once for every triangle that a pixel
//! sees, not once for every sub-pixel, and once for all paintings of the same scene.

use std::array::from_fn;
use std::sync::LazyLock;

use geom_core::Vector3;
use geom_core::compute::parallel;

use super::scene::{Layer, Paint, View};
use super::{Corner, Image, Rgb};

/// Sub-pixels per pixel and axis.
pub(super) const FINE: usize = 3;

/// All vertices in sub-pixels: x right, y down, z towards the eye.
pub(super) struct Frame<'a> {
    layers: &'a [Layer],
    places: Vec<Vec<[f32; 3]>>,
    /// Corners per triangle with its layer, and its number within that layer.
    faces: Vec<(u32, u32, [u32; 3])>,
    size: [usize; 2],
    /// Lowest and highest z.
    depth: [f32; 2],
    view: View,
}

impl<'a> Frame<'a> {
    /// The layers as large as they fit into `room` of a picture of `size`, both in sub-pixels.
    pub(super) fn fit(
        layers: &'a [Layer],
        view: &View,
        room: [usize; 2],
        size: [usize; 2],
    ) -> Self {
        let axes = [view.right, -view.up, view.toward];
        let seen = |layer: &Layer| -> [[f64; 3]; 2] {
            let of_chunks = parallel::fold_chunks(layer.faces.len(), |chunk| {
                let corners = layer.faces[chunk].iter().flatten();
                corners
                    .map(|&v| axes.map(|a| a.dot(&layer.positions[v as usize].coords)))
                    .map(|c| [c, c])
                    .fold(NOTHING, both)
            });
            of_chunks.into_iter().fold(NOTHING, both)
        };
        let [low, high] = layers.iter().map(seen).fold(NOTHING, both);
        let extent = |k: usize| (high[k] - low[k]).max(1e-12);
        let per_length = 0.92 * (room[0] as f64 / extent(0)).min(room[1] as f64 / extent(1));
        let middle: [f64; 3] = from_fn(|k| 0.5 * (low[k] + high[k]));
        let center = [room[0] as f64 / 2.0, room[1] as f64 / 2.0, 0.0];
        let place = |p: &geom_core::Point3| -> [f32; 3] {
            from_fn(|k| ((axes[k].dot(&p.coords) - middle[k]) * per_length + center[k]) as f32)
        };
        let places = layers
            .iter()
            .map(|layer| parallel::map_each(&layer.positions, place))
            .collect();
        let faces = layers
            .iter()
            .zip(0..)
            .flat_map(|(layer, l)| layer.faces.iter().zip(0..).map(move |(&f, n)| (l, n, f)))
            .collect();
        let half = (0.5 * extent(2) * per_length) as f32;
        Self {
            layers,
            places,
            faces,
            size,
            depth: [-half, half],
            view: *view,
        }
    }

    fn corners(&self, triangle: u32) -> [[f32; 3]; 3] {
        let (layer, _, [a, b, c]) = &self.faces[triangle as usize];
        let places = &self.places[*layer as usize];
        [
            places[*a as usize],
            places[*b as usize],
            places[*c as usize],
        ]
    }

    /// In clip space.
    pub(super) fn triangles(&self) -> Vec<[Corner; 3]> {
        let [w, h] = self.size.map(|n| n as f32);
        let [low, high] = self.depth;
        parallel::map(self.faces.len(), |t| {
            self.corners(t as u32).map(|[x, y, z]| {
                let near = (high - z) / (high - low).max(1e-6);
                [2.0 * x / w - 1.0, 1.0 - 2.0 * y / h, 0.001 + 0.998 * near]
            })
        })
    }

    /// One picture per painting, which is a paint per layer; `seen` is the triangle per sub-pixel.
    pub(super) fn shade(&self, seen: &[u32], paintings: &[Vec<&Paint>]) -> Vec<Image> {
        let [width, height] = self.size.map(|n| n / FINE);
        let light = Light {
            frame: self,
            seen,
            depth: self.depths(seen, [width, height]),
        };
        let rows: Vec<Vec<u8>> = parallel::map(height, |y| light.row(y, width, paintings));
        let picture = |p: usize| {
            let row = |row: &Vec<u8>| row[3 * width * p..3 * width * (p + 1)].to_vec();
            Image::of_rows(width, rows.iter().map(row))
        };
        (0..paintings.len()).map(picture).collect()
    }

    /// The depth in the middle of every pixel; −∞ where nothing is seen there.
    fn depths(&self, seen: &[u32], [width, height]: [usize; 2]) -> Vec<f32> {
        parallel::map(width * height, |at| {
            let [x, y] = [at % width, at / width].map(|k| k * FINE + FINE / 2);
            match seen[y * self.size[0] + x] {
                u32::MAX => f32::NEG_INFINITY,
                triangle => {
                    let corners = self.corners(triangle);
                    depth(&corners, weights(&corners, x, y))
                }
            }
        })
    }
}

/// The depth of a triangle at a place in it.
fn depth(corners: &[[f32; 3]; 3], b: [f32; 3]) -> f32 {
    b[0] * corners[0][2] + b[1] * corners[1][2] + b[2] * corners[2][2]
}

/// The bounds of no point.
const NOTHING: [[f64; 3]; 2] = [[f64::INFINITY; 3], [f64::NEG_INFINITY; 3]];

/// The bounds of both.
fn both([al, ah]: [[f64; 3]; 2], [bl, bh]: [[f64; 3]; 2]) -> [[f64; 3]; 2] {
    [from_fn(|k| al[k].min(bl[k])), from_fn(|k| ah[k].max(bh[k]))]
}

/// What a triangle sends to the eye from one pixel, but for its colour.
struct Lit {
    triangle: u32,
    corners: [[f32; 3]; 3],
    /// Barycentric weights where the light was computed.
    weights: [f32; 3],
    light: f32,
    gleam: f32,
    /// Share of the air in front.
    haze: f32,
    edges: Option<Edges>,
}

/// What is known of a frame before colours.
struct Light<'a> {
    frame: &'a Frame<'a>,
    seen: &'a [u32],
    /// In the middle of every pixel.
    depth: Vec<f32>,
}

impl Light<'_> {
    /// A row of pixels of every painting, one painting after the other.
    fn row(&self, y: usize, width: usize, paintings: &[Vec<&Paint>]) -> Vec<u8> {
        let mut bytes = vec![0; 3 * width * paintings.len()];
        // What this pixel's triangles send, and their colour in each painting.
        let (mut lit, mut colors): (Vec<Lit>, Vec<[f32; 3]>) = (Vec::new(), Vec::new());
        let mut sums = vec![[0.0f32; 3]; paintings.len()];
        let air = |fy: usize| background(fy as f32 / self.frame.size[1] as f32);
        let of_air = (0..FINE * FINE).map(|sub| air(y * FINE + sub / FINE));
        let nothing = pixel(of_air.fold([0.0; 3], plus));
        for x in 0..width {
            if self.is_empty(x, y) {
                for p in 0..paintings.len() {
                    bytes[3 * (p * width + x)..][..3].copy_from_slice(&nothing);
                }
                continue;
            }
            lit.clear();
            colors.clear();
            sums.fill([0.0; 3]);
            // The middle of the pixel stands for all of it that lies as deep.
            let (mx, my) = (x * FINE + FINE / 2, y * FINE + FINE / 2);
            let middle = my * self.frame.size[0] + mx;
            let open = (self.seen[middle] != u32::MAX).then(|| {
                let flat = eye_normal(&self.frame.corners(self.seen[middle]));
                let depth = self.depth[y * width + x];
                (depth, self.openness(flat, [mx, my], depth))
            });
            for sub in 0..FINE * FINE {
                let (fx, fy) = (x * FINE + sub % FINE, y * FINE + sub / FINE);
                let here = fy * self.frame.size[0] + fx;
                let air = air(fy);
                let triangle = self.seen[here];
                if triangle == u32::MAX {
                    sums.iter_mut().for_each(|sum| *sum = plus(*sum, air));
                    continue;
                }
                let known = lit.iter().position(|l| l.triangle == triangle);
                let which = known.unwrap_or_else(|| {
                    let new = self.lit(triangle, open, [fx, fy]);
                    let of = |painting: &Vec<&Paint>| self.color(&new, painting);
                    colors.extend(paintings.iter().map(of));
                    lit.push(new);
                    lit.len() - 1
                });
                let of_it = &lit[which];
                let line = of_it
                    .edges
                    .as_ref()
                    .map_or(0.0, |edges| edges.darkness(weights(&of_it.corners, fx, fy)));
                let colors = &colors[which * paintings.len()..][..paintings.len()];
                for (sum, color) in sums.iter_mut().zip(colors) {
                    *sum = plus(*sum, of_it.to_eye(*color, line, air));
                }
            }
            for (p, sum) in sums.iter().enumerate() {
                bytes[3 * (p * width + x)..][..3].copy_from_slice(&pixel(*sum));
            }
        }
        bytes
    }

    /// Is there nothing in a pixel but air?
    fn is_empty(&self, x: usize, y: usize) -> bool {
        let start = |row: usize| (y * FINE + row) * self.frame.size[0] + x * FINE;
        (0..FINE).all(|row| self.seen[start(row)..][..FINE] == [u32::MAX; FINE])
    }

    /// The light that a triangle sends from a sub-pixel; `middle` is the depth and openness of its pixel, if something is there.
    fn lit(&self, triangle: u32, middle: Option<(f32, f32)>, [x, y]: [usize; 2]) -> Lit {
        let frame = self.frame;
        let (layer, _, face) = frame.faces[triangle as usize];
        let layer = &frame.layers[layer as usize];
        let corners = frame.corners(triangle);
        let b = weights(&corners, x, y);

        let flat = eye_normal(&corners);
        let normal = match &layer.normals {
            Some(normals) => frame.smooth_normal(normals, face, b),
            None => flat,
        };
        let z = depth(&corners, b);
        let open = match middle {
            Some((depth, open)) if (z - depth).abs() < 2.0 * FINE as f32 => open,
            _ => self.openness(flat, [x, y], z),
        };
        let [nx, ny, nz] = [normal[0], -normal[1], normal[2]];
        let toward = |l: [f32; 3]| {
            let l = unit(l);
            (nx * l[0] + ny * l[1] + nz * l[2]).max(0.0)
        };
        // A wide sky, a key light from above left, a weak one from the right.
        let sky = 0.75 + 0.25 * ny;
        let light = 0.46 * sky * open
            + 0.70 * toward([-0.45, 0.62, 0.75]) * (0.35 + 0.65 * open)
            + 0.20 * toward([0.80, -0.10, 0.55]) * open;
        // A soft dark rim separates what lies in front.
        let rim = 0.72 + 0.28 * (nz / 0.4).min(1.0);
        let [low, high] = frame.depth;
        let far = ((high - z) / (high - low).max(1e-6)).clamp(0.0, 1.0);
        Lit {
            triangle,
            weights: b,
            light: light * rim,
            gleam: 0.09 * toward([-0.25, 0.36, 1.6]).powi(48) * open,
            haze: 0.22 * far * far,
            edges: layer.edges.then(|| Edges::of(&corners)).flatten(),
            corners,
        }
    }

    /// The colour of a triangle in a painting, linear.
    fn color(&self, lit: &Lit, painting: &[&Paint]) -> [f32; 3] {
        let (layer, number, face) = self.frame.faces[lit.triangle as usize];
        match painting[layer as usize] {
            Paint::Plain(color) => linear(*color),
            Paint::Faces(colors) => linear(colors[number as usize]),
            Paint::Vertices(colors) => {
                let [c, d, e] = face.map(|v| linear(colors[v as usize]));
                let [u, v, w] = lit.weights;
                let channel = |k: usize| u * c[k] + v * d[k] + w * e[k];
                [channel(0), channel(1), channel(2)]
            }
        }
    }

    /// How much of the sky is seen from a sub-pixel of this depth: 1 in the open, less in grooves.
    ///
    /// What may hide it are the middles of pixels, which are few enough to be at hand; where nothing is seen, something so deep
    /// that it does not count, so that the loop over them needs no branches.
    fn openness(&self, normal: [f32; 3], [x, y]: [usize; 2], here: f32) -> f32 {
        const NOWHERE: f32 = -1e9;
        let [width, height] = self.frame.size.map(|n| n / FINE);
        let reach = 0.085 * self.frame.size[1] as f32;
        let turn = noise(x as u32, y as u32);
        let (sin, cos) = (std::f32::consts::TAU * turn).sin_cos();
        let [x, y] = [x as f32, y as f32];
        let pixel = |sub: f32| (sub / FINE as f32).floor() as i32;
        let middle = |p: i32| (p * FINE as i32 + FINE as i32 / 2) as f32;
        let mut toward = [[0.0f32; 3]; SAMPLES];
        for (i, (v, [c, s])) in toward.iter_mut().zip(&*SPIRAL).enumerate() {
            let t = (i as f32 + turn) / SAMPLES as f32;
            // More samples near than far.
            let r = 2.0 + reach * t * t;
            let px = pixel(x + r * (c * cos - s * sin));
            let py = pixel(y + r * (s * cos + c * sin));
            let is_inside = (px as u32) < width as u32 && (py as u32) < height as u32;
            let z = if is_inside {
                self.depth[py as usize * width + px as usize]
            } else {
                f32::NEG_INFINITY
            };
            *v = [middle(px) - x, middle(py) - y, (z - here).max(NOWHERE)];
        }
        let mut hidden = 0.0;
        for [dx, dy, dz] in toward {
            let above = dx * normal[0] + dy * normal[1] + dz * normal[2];
            let length = (dx * dx + dy * dy + dz * dz).sqrt();
            let near = 1.0 - (length / (1.6 * reach)).min(1.0);
            hidden += (above / length.max(1e-6) - 0.06).max(0.0) * near;
        }
        (1.0 - 1.9 * hidden / SAMPLES as f32).clamp(0.0, 1.0)
    }
}

/// How many directions the sky is looked at in.
const SAMPLES: usize = 24;

/// Directions a golden angle apart: samples along them fill the disk evenly.
static SPIRAL: LazyLock<[[f32; 2]; SAMPLES]> = LazyLock::new(|| {
    from_fn(|i| {
        let (sin, cos) = (std::f32::consts::TAU * 0.618_034 * i as f32).sin_cos();
        [cos, sin]
    })
});

impl Frame<'_> {
    /// The normal blended from those of the corners, in the frame of the picture, on the side of the eye.
    fn smooth_normal(&self, normals: &[Vector3], face: [u32; 3], b: [f32; 3]) -> [f32; 3] {
        let n = face.iter().zip(b).fold(Vector3::zeros(), |s, (&v, w)| {
            s + normals[v as usize] * f64::from(w)
        });
        let axes = [self.view.right, -self.view.up, self.view.toward];
        toward_eye(unit(axes.map(|a| n.dot(&a) as f32)))
    }
}

impl Lit {
    /// Linear light that reaches the eye; `line` is how dark an edge is here.
    fn to_eye(&self, color: [f32; 3], line: f32, air: [f32; 3]) -> [f32; 3] {
        let channel = |color: f32, air: f32| {
            let lit = (color * self.light * (1.0 - line) + self.gleam).min(1.0);
            lit + (air - lit) * self.haze
        };
        [
            channel(color[0], air[0]),
            channel(color[1], air[1]),
            channel(color[2], air[2]),
        ]
    }
}

/// The edges of a triangle that is large enough for them to be seen.
struct Edges {
    /// Heights over the edges, in sub-pixels.
    heights: [f32; 3],
    strength: f32,
}

impl Edges {
    fn of(c: &[[f32; 3]; 3]) -> Option<Self> {
        let side = |i: usize, j: usize| (c[i][0] - c[j][0]).hypot(c[i][1] - c[j][1]);
        let sides = [side(1, 2), side(2, 0), side(0, 1)];
        let doubled = ((c[1][0] - c[0][0]) * (c[2][1] - c[0][1])
            - (c[1][1] - c[0][1]) * (c[2][0] - c[0][0]))
            .abs();
        let longest = sides[0].max(sides[1]).max(sides[2]).max(1e-6);
        let size = doubled.sqrt().min(longest) / FINE as f32;
        let strength = 0.45 * ((size - 3.0) / 12.0).clamp(0.0, 1.0);
        (strength > 0.0).then(|| Self {
            heights: sides.map(|s| doubled / s.max(1e-6)),
            strength,
        })
    }

    /// How dark the nearest edge is at a place in the triangle.
    fn darkness(&self, b: [f32; 3]) -> f32 {
        let far = |k: usize| b[k] * self.heights[k];
        let nearest = far(0).min(far(1)).min(far(2));
        self.strength * (1.3 - nearest / (0.45 * FINE as f32)).clamp(0.0, 1.0)
    }
}

/// Barycentric weights of the centre of a sub-pixel, clamped into the triangle.
fn weights(c: &[[f32; 3]; 3], x: usize, y: usize) -> [f32; 3] {
    let (x, y) = (x as f32 + 0.5, y as f32 + 0.5);
    let cross = |a: &[f32; 3], b: &[f32; 3]| (a[0] - x) * (b[1] - y) - (a[1] - y) * (b[0] - x);
    let [u, v, w] = [
        cross(&c[1], &c[2]),
        cross(&c[2], &c[0]),
        cross(&c[0], &c[1]),
    ];
    let area = u + v + w;
    if area.abs() < 1e-6 {
        return [1.0 / 3.0; 3];
    }
    let [u, v, w] = [
        (u / area).max(0.0),
        (v / area).max(0.0),
        (w / area).max(0.0),
    ];
    let sum = u + v + w;
    [u / sum, v / sum, w / sum]
}

/// Unit normal of a triangle on the side of the eye.
fn eye_normal([a, b, c]: &[[f32; 3]; 3]) -> [f32; 3] {
    let u = [b[0] - a[0], b[1] - a[1], b[2] - a[2]];
    let v = [c[0] - a[0], c[1] - a[1], c[2] - a[2]];
    let n = [
        u[1] * v[2] - u[2] * v[1],
        u[2] * v[0] - u[0] * v[2],
        u[0] * v[1] - u[1] * v[0],
    ];
    toward_eye(unit(n))
}

fn toward_eye([x, y, z]: [f32; 3]) -> [f32; 3] {
    if z < 0.0 { [-x, -y, -z] } else { [x, y, z] }
}

fn unit([x, y, z]: [f32; 3]) -> [f32; 3] {
    let length = (x * x + y * y + z * z).sqrt();
    if length > 0.0 {
        [x / length, y / length, z / length]
    } else {
        [0.0, 0.0, 1.0]
    }
}

fn plus(a: [f32; 3], b: [f32; 3]) -> [f32; 3] {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}

/// The colour of a pixel from the light of all its sub-pixels.
fn pixel([r, g, b]: [f32; 3]) -> [u8; 3] {
    let channel = |sum: f32| to_srgb(sum / (FINE * FINE) as f32);
    [channel(r), channel(g), channel(b)]
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

fn linear(color: Rgb) -> [f32; 3] {
    static LIGHT: LazyLock<[f32; 256]> = LazyLock::new(|| {
        from_fn(|c| {
            let c = c as f32 / 255.0;
            if c <= 0.04045 {
                c / 12.92
            } else {
                ((c + 0.055) / 1.055).powf(2.4)
            }
        })
    });
    let light: &[f32; 256] = &LIGHT;
    let [r, g, b] = color.map(usize::from);
    [light[r], light[g], light[b]]
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
