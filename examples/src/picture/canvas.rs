//! Images: pixels, text, colour bars, contact sheets. The only file that knows png; with `plot` the
//! only ones that know plotters.

use std::path::Path;
use std::sync::Once;

use geom_core::io;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

use super::color::mix;
use super::{ColorMap, Rgb, Scale};

/// An sRGB image, row by row from the top.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Image {
    pub(crate) width: usize,
    pub(crate) height: usize,
    pub(crate) rgb: Vec<u8>,
}

/// The family under which the embedded font is known.
pub(crate) const FONT: &str = "roboto";
/// Colour of text.
pub(crate) const INK: RGBColor = RGBColor(40, 44, 52);

/// Makes the embedded font known, once.
pub(crate) fn font() {
    static ONCE: Once = Once::new();
    ONCE.call_once(|| {
        let bytes = include_bytes!("../../assets/Roboto-subset.ttf");
        let registered = plotters::style::register_font(FONT, FontStyle::Normal, bytes);
        assert!(registered.is_ok(), "the embedded font is valid");
    });
}

/// Sub-pixels of text per pixel and axis.
const TEXT_FINE: usize = 4;

/// Where text stands relative to its place.
#[derive(Clone, Copy)]
pub enum Align {
    /// It begins there.
    Left,
    /// Its middle is there.
    Center,
}

impl Image {
    /// One colour everywhere.
    pub fn filled(width: usize, height: usize, color: Rgb) -> Self {
        let rgb = color.repeat(width * height);
        Self { width, height, rgb }
    }

    /// An image of its rows from the top.
    pub(crate) fn of_rows(width: usize, rows: impl Iterator<Item = Vec<u8>>) -> Self {
        let rgb: Vec<u8> = rows.flatten().collect();
        let height = rgb.len() / (3 * width).max(1);
        Self { width, height, rgb }
    }

    /// Pixels per row.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Rows.
    pub fn height(&self) -> usize {
        self.height
    }

    /// Red, green and blue of each pixel, row by row from the top.
    pub fn rgb(&self) -> &[u8] {
        &self.rgb
    }

    /// The colour of a pixel, from the top left.
    pub fn pixel(&self, x: usize, y: usize) -> Rgb {
        let at = 3 * (y * self.width + x);
        [self.rgb[at], self.rgb[at + 1], self.rgb[at + 2]]
    }

    pub(crate) fn set(&mut self, x: usize, y: usize, color: Rgb) {
        let at = 3 * (y * self.width + x);
        self.rgb[at..at + 3].copy_from_slice(&color);
    }

    /// Lays another image over this one; what stands out is cut off.
    pub(crate) fn paste(&mut self, other: &Self, left: usize, top: usize) {
        let width = other.width.min(self.width.saturating_sub(left));
        for y in 0..other.height.min(self.height.saturating_sub(top)) {
            let (to, from) = (3 * ((top + y) * self.width + left), 3 * y * other.width);
            self.rgb[to..to + 3 * width].copy_from_slice(&other.rgb[from..from + 3 * width]);
        }
    }

    /// Draws with plotters. Drawing into memory cannot fail.
    pub(crate) fn draw(
        &mut self,
        with: impl FnOnce(&DrawingArea<BitMapBackend<'_>, plotters::coord::Shift>),
    ) {
        font();
        let size = (self.width as u32, self.height as u32);
        let area = BitMapBackend::with_buffer(&mut self.rgb, size).into_drawing_area();
        with(&area);
        area.present().expect("memory is always there");
    }

    /// Writes one line, vertically centred at `y`.
    pub fn text(&mut self, text: &str, (x, y): (usize, usize), size: f64, align: Align) {
        // Drawn larger and averaged: letters then stand between pixels, not on them.
        let (wide, high) = (text.chars().count() * size as usize, 2 * size as usize);
        let mut mask = Self::filled(wide * TEXT_FINE, high * TEXT_FINE, [255; 3]);
        let (h, at) = match align {
            Align::Left => (HPos::Left, 0),
            Align::Center => (HPos::Center, wide / 2),
        };
        mask.draw(|area| {
            let style = (FONT, size * TEXT_FINE as f64)
                .into_font()
                .color(&BLACK)
                .pos(Pos::new(h, VPos::Center));
            let place = ((at * TEXT_FINE) as i32, (high * TEXT_FINE / 2) as i32);
            area.draw(&Text::new(text.to_owned(), place, style))
                .expect("memory is always there");
        });
        let mask = mask.reduced(TEXT_FINE);
        let ink = [INK.0, INK.1, INK.2];
        for my in 0..high {
            for mx in 0..wide {
                let cover = 1.0 - f64::from(mask.pixel(mx, my)[0]) / 255.0;
                let place = ((x + mx).checked_sub(at), (y + my).checked_sub(high / 2));
                if let (Some(px), Some(py)) = place
                    && cover > 0.0
                    && px < self.width
                    && py < self.height
                {
                    self.set(px, py, mix(self.pixel(px, py), ink, cover));
                }
            }
        }
    }

    /// Each block of `by × by` pixels averaged into one.
    pub(crate) fn reduced(&self, by: usize) -> Self {
        let mut out = Self::filled(self.width / by, self.height / by, [0; 3]);
        for y in 0..out.height {
            for x in 0..out.width {
                let mut sum = [0usize; 3];
                for (sx, sy) in (0..by * by).map(|i| (x * by + i % by, y * by + i / by)) {
                    let pixel = self.pixel(sx, sy);
                    for k in 0..3 {
                        sum[k] += usize::from(pixel[k]);
                    }
                }
                out.set(x, y, sum.map(|s| ((s + by * by / 2) / (by * by)) as u8));
            }
        }
        out
    }

    /// Draws a vertical colour bar whose left edge is at `left`, between rows `top` and `bottom`.
    pub(crate) fn color_bar(&mut self, scale: &Scale, left: usize, [top, bottom]: [usize; 2]) {
        let (thick, height) = (BAR_WIDTH * 2 / 11, bottom - top);
        for y in 0..height {
            let t = 1.0 - (y as f64 + 0.5) / height as f64;
            let color = scale.map.at(t);
            for x in 0..thick {
                self.set(left + x, top + y, color);
            }
        }
        for (value, text) in ticks(scale.low, scale.high) {
            let t = (value - scale.low) / (scale.high - scale.low);
            let y = bottom as f64 - t * height as f64;
            let y = (y.round() as usize).clamp(top, bottom - 1);
            for x in thick..thick + 6 {
                self.set(left + x, y, [INK.0, INK.1, INK.2]);
            }
            self.text(&text, (left + thick + 11, y), 20.0, Align::Left);
        }
        // The label above, so that it may be longer than the bar is wide.
        let half = scale.label.chars().count() * 9 / 2;
        let x = (left + thick / 2).min(self.width.saturating_sub(half + 6));
        self.text(
            &scale.label,
            (x, top.saturating_sub(22)),
            21.0,
            Align::Center,
        );
    }

    /// Draws colours with their names, one below the other, down to row `bottom`; gives the row that they begin at.
    /// What would not fit in half of the picture is counted.
    pub fn legend(&mut self, entries: &[(Rgb, String)], left: usize, bottom: usize) -> usize {
        const ROW: usize = 26;
        let most = (bottom / (2 * ROW)).max(2);
        let shown = if entries.len() > most {
            most - 1
        } else {
            entries.len()
        };
        let rows = shown + usize::from(shown < entries.len());
        let top = bottom.saturating_sub(rows * ROW);
        for (row, (color, name)) in entries[..shown].iter().enumerate() {
            let y = top + row * ROW + ROW / 2;
            for (x, y) in (0..18 * 18).map(|i| (left + i % 18, y + i / 18 - 9)) {
                self.set(x, y, *color);
            }
            self.text(name, (left + 25, y), 19.0, Align::Left);
        }
        if shown < entries.len() {
            let more = format!("and {} more", entries.len() - shown);
            let y = top + shown * ROW + ROW / 2;
            self.text(&more, (left, y), 19.0, Align::Left);
        }
        top
    }

    /// Writes a PNG, whole or not at all.
    pub fn save(&self, path: impl AsRef<Path>) -> Result<(), io::Error> {
        io::save(path, |w| {
            let system = |e: png::EncodingError| io::ErrorKind::System(e.into());
            let mut encoder = png::Encoder::new(w, self.width as u32, self.height as u32);
            encoder.set_color(png::ColorType::Rgb);
            encoder.set_depth(png::BitDepth::Eight);
            // A tenth of the time for a fifth more bytes.
            encoder.set_compression(png::Compression::Fast);
            let mut writer = encoder.write_header().map_err(system)?;
            writer.write_image_data(&self.rgb).map_err(system)?;
            writer.finish().map_err(system)?;
            Ok(())
        })
    }
}

/// Width that a colour bar with its numbers takes, in pixels.
pub(crate) const BAR_WIDTH: usize = 132;

/// Round values between two, and how to write them.
pub fn ticks(low: f64, high: f64) -> Vec<(f64, String)> {
    let range = high - low;
    if !(range > 0.0 && range.is_finite()) {
        return Vec::new();
    }
    let rough = range / 5.0;
    let power = 10f64.powf(rough.log10().floor());
    let step = power
        * [1.0, 2.0, 5.0, 10.0]
            .into_iter()
            .find(|m| m * power >= rough * 0.999)
            .unwrap_or(10.0);
    let digits = (-step.log10().floor()).max(0.0) as usize;
    let first = (low / step - 1e-9).ceil() as i64;
    let last = (high / step + 1e-9).floor() as i64;
    (first..=last)
        .map(|i| {
            let v = i as f64 * step;
            let text = if step < 1e-4 || high.abs().max(low.abs()) >= 1e6 {
                format!("{v:.1e}")
            } else {
                format!("{v:.digits$}")
            };
            // A true minus sign, as wide as the plus.
            (v, text.replace('-', "\u{2212}"))
        })
        .collect()
}

/// Images side by side with a title each, in cells as large as the largest.
pub fn sheet(images: &[(String, Image)], columns: usize) -> Image {
    let wide = images.iter().map(|(_, i)| i.width).max().unwrap_or(1);
    let high = images.iter().map(|(_, i)| i.height).max().unwrap_or(1);
    let (gap, title) = (10, 34);
    let columns = columns.clamp(1, images.len().max(1));
    let rows = images.len().div_ceil(columns);
    let (cell_w, cell_h) = (wide + gap, high + gap + title);
    let mut out = Image::filled(columns * cell_w + gap, rows * cell_h + gap, [255; 3]);
    for (i, (text, image)) in images.iter().enumerate() {
        let (x, y) = (gap + i % columns * cell_w, gap + i / columns * cell_h);
        out.paste(image, x + (wide - image.width) / 2, y + title);
        let middle = (x + wide / 2, y + title / 2 + 2);
        out.text(text, middle, 22.0, Align::Center);
    }
    out
}

/// A sheet of functions that are each coloured by [`Scale::symmetric`], with the colour bar that all share.
pub fn sheet_of_modes(images: &[(String, Image)], columns: usize) -> Image {
    let cells = sheet(images, columns);
    // The label is wider than the bar, and must not reach into the pictures.
    let left = cells.width + BAR_WIDTH / 2;
    let mut out = Image::filled(left + BAR_WIDTH, cells.height, [255; 3]);
    out.paste(&cells, 0, 0);
    let scale = Scale::new(ColorMap::CoolWarm, [-1.0, 1.0], "of the largest");
    let (top, bottom) = (cells.height / 7 + 20, cells.height - cells.height / 7);
    out.color_bar(&scale, left, [top, bottom.max(top + 1)]);
    out
}
