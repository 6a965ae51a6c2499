//! Slices through fields on lattices.

use geom_core::compute::parallel;
use geom_core::{ImplicitField, Lattice, Point3, Vector3};

use super::canvas::{Align, BAR_WIDTH, ticks};
use super::{Image, Scale};

/// The plane through the middle of a lattice, seen along `axis` (0…2) at a share of the extent along
/// it, coloured by value, with the isoline at `level` in white over black and a bar of round length.
pub fn slice(
    field: &(impl ImplicitField + ?Sized),
    lattice: &Lattice,
    axis: usize,
    at: f64,
    level: f64,
    scale: &Scale,
    height: usize,
) -> Image {
    let axis = axis.min(2);
    let (bounds, extent) = (lattice.bounds(), lattice.bounds().extent());
    let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
    let per_length = height as f64 / extent[v].max(1e-9);
    let width = ((extent[u] * per_length).round() as usize).clamp(height / 4, 4 * height);
    let origin = bounds.min + Vector3::ith(axis, at * extent[axis]);
    let point = |x: f64, y: f64| -> Point3 {
        origin
            + Vector3::ith(u, x * extent[u] / width as f64)
            + Vector3::ith(v, extent[v] - y / per_length)
    };

    let mut plane = Image::filled(width, height, [255; 3]);
    parallel::for_chunks(&mut plane.rgb, 3 * width, |y, row| {
        for (x, pixel) in row.chunks_exact_mut(3).enumerate() {
            let (value, gradient) = field.value_gradient(&point(x as f64 + 0.5, y as f64 + 0.5));
            let mut color = scale.color(value);
            // Distance to the isoline in pixels, to first order.
            let slope = (gradient[u].hypot(gradient[v]) / per_length).max(1e-12);
            let off = (value - level).abs() / slope;
            for (half, shade) in [(2.2, 30.0), (1.1, 255.0)] {
                let cover = (half + 0.5 - off).clamp(0.0, 1.0);
                color = color.map(|c| (f64::from(c) * (1.0 - cover) + shade * cover).round() as u8);
            }
            pixel.copy_from_slice(&color);
        }
    });

    let (margin, top, foot) = (16, 64, 56);
    let mut image = Image::filled(
        width + margin + 24 + BAR_WIDTH,
        height + top + foot,
        [255; 3],
    );
    image.paste(&plane, margin, top);
    image.color_bar(scale, width + margin + 20, [top, top + height]);
    let names = ["x", "y", "z"];
    let title = format!("{} = {:.1} Å", names[axis], origin[axis]);
    image.text(&title, (margin + width / 2, top / 2), 24.0, Align::Center);
    // About a fifth of the width, of round length.
    if let Some((length, text)) = ticks(0.0, extent[u]).into_iter().nth(1) {
        let pixels = (length * width as f64 / extent[u]) as usize;
        for y in height + top + 22..height + top + 27 {
            for x in margin..(margin + pixels).min(margin + width) {
                image.set(x, y, [40, 44, 52]);
            }
        }
        image.text(
            &format!("{text} Å"),
            (margin + pixels + 12, height + top + 25),
            20.0,
            Align::Left,
        );
    }
    image
}
