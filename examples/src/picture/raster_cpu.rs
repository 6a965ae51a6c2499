//! The rasterizer on the CPU. The only file that knows euc.

use euc::rasterizer::{BackfaceCullingDisabled, Triangles};
use euc::{Interpolate, Pipeline, buffer::Buffer2d};

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

pub(super) fn visible(triangles: &[[Corner; 3]], size: [usize; 2]) -> Visible {
    let mut seen = Buffer2d::new(size, u32::MAX);
    let mut depth = Buffer2d::new(size, f32::INFINITY);
    let proper =
        |[a, b, c]: &[Corner; 3]| (b[0] - a[0]) * (c[1] - a[1]) != (b[1] - a[1]) * (c[0] - a[0]);
    let mut batch = Vec::with_capacity(3 * BATCH);
    let mut numbered = triangles
        .iter()
        .zip(0u32..)
        .filter(|(t, _)| proper(t))
        .peekable();
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
    Visible {
        triangle: seen.as_ref().to_vec(),
    }
}

/// Triangles per draw.
const BATCH: usize = 1 << 16;
