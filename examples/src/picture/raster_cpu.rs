//! The rasterizer on the CPU, strips of the picture side by side. The only file that knows euc.

use euc::rasterizer::{BackfaceCullingDisabled, Triangles};
use euc::{Interpolate, Pipeline, buffer::Buffer2d};
use geom_core::compute::parallel;

use super::{Corner, Visible};

/// Triangle numbers are the same at each corner.
#[derive(Clone)]
struct Number(u32);

impl Interpolate for Number {
    fn lerp2(a: Self, _: Self, _: f32, _: f32) -> Self {
        a
    }
    fn lerp3(a: Self, _: Self, _: Self, _: f32, _: f32, _: f32) -> Self {
        a
    }
}

struct Seen;

impl Pipeline for Seen {
    type Vertex = (Corner, u32);
    type VsOut = Number;
    type Pixel = u32;

    fn vert(&self, &([x, y, z], number): &Self::Vertex) -> ([f32; 4], Number) {
        ([x, y, z, 1.0], Number(number))
    }
    fn frag(&self, number: &Number) -> u32 {
        number.0
    }
}

/// Rows per strip; fixed, so that the picture does not depend on the threads.
const STRIP: usize = 128;
/// Triangles per draw.
const BATCH: usize = 1 << 14;

pub(super) fn visible(triangles: &[[Corner; 3]], [width, height]: [usize; 2]) -> Visible {
    let strips: Vec<Vec<u32>> = parallel::map(height.div_ceil(STRIP), |s| {
        let rows = (height - s * STRIP).min(STRIP);
        strip(triangles, [width, rows], |y| {
            // From the clip space of the picture to that of the strip.
            let row = (1.0 - y) / 2.0 * height as f32 - (s * STRIP) as f32;
            1.0 - 2.0 * row / rows as f32
        })
    });
    Visible {
        triangle: strips.concat(),
    }
}

/// What is seen in a strip of this size; `down` gives its y in clip space.
fn strip(triangles: &[[Corner; 3]], size: [usize; 2], down: impl Fn(f32) -> f32) -> Vec<u32> {
    let mut seen = Buffer2d::new(size, u32::MAX);
    let mut depth = Buffer2d::new(size, f32::INFINITY);
    let proper =
        |[a, b, c]: &[Corner; 3]| (b[0] - a[0]) * (c[1] - a[1]) != (b[1] - a[1]) * (c[0] - a[0]);
    let mut numbered = triangles
        .iter()
        .zip(0u32..)
        .map(|(t, number)| (t.map(|[x, y, z]| [x, down(y), z]), number))
        .filter(|(t, _)| t.iter().any(|c| c[1] >= -1.0) && t.iter().any(|c| c[1] <= 1.0))
        .filter(|(t, _)| proper(t))
        .peekable();
    let mut batch = Vec::with_capacity(3 * BATCH);
    while numbered.peek().is_some() {
        batch.clear();
        for (corners, number) in numbered.by_ref().take(BATCH) {
            batch.extend(corners.map(|corner| (corner, number)));
        }
        Seen.draw::<Triangles<'_, _, BackfaceCullingDisabled>, _>(
            &batch,
            &mut seen,
            Some(&mut depth),
        );
    }
    seen.as_ref().to_vec()
}
