//! Histograms and curves.

use plotters::prelude::*;

use super::Rgb;
use super::canvas::{FONT, INK, Image};

/// One set of bars of a histogram: a name, a colour and a share per bin.
pub struct Bars<'a> {
    /// For the legend.
    pub name: &'a str,
    /// Colour of the bars.
    pub color: Rgb,
    /// One number per bin.
    pub counts: &'a [u64],
}

/// One curve: a name, a colour and its points.
pub struct Curve<'a> {
    /// For the legend; empty for none.
    pub name: &'a str,
    /// Colour of line and points.
    pub color: Rgb,
    /// (x, y).
    pub points: Vec<(f64, f64)>,
}

/// Sub-pixels per pixel and axis.
const FINE: usize = 3;
const F: f64 = FINE as f64;
const N: i32 = FINE as i32;

const MEMORY: &str = "drawing into memory cannot fail";

fn rgb([r, g, b]: Rgb) -> RGBColor {
    RGBColor(r, g, b)
}

/// Histograms over the same bins from `low` to `high`, laid over each other, in percent of each set.
pub fn histogram(
    sets: &[Bars<'_>],
    [low, high]: [f64; 2],
    title: &str,
    label: &str,
    size: [usize; 2],
) -> Image {
    let percent = |set: &Bars<'_>| -> Vec<f64> {
        let total = set.counts.iter().sum::<u64>().max(1) as f64;
        set.counts
            .iter()
            .map(|&c| 100.0 * c as f64 / total)
            .collect()
    };
    let heights: Vec<Vec<f64>> = sets.iter().map(percent).collect();
    let highest = |skipped: usize| {
        let bars = heights.iter().flat_map(|h| &h[h.len() * skipped / 5..]);
        bars.fold(1.0, |m: f64, &h| m.max(h))
    };
    // The legend stands on the right, above the bars there.
    let top = (1.08 * highest(0)).max(1.2 * highest(4));
    chart(
        size,
        [title, label, "share / %"],
        [low, high],
        [0.0, top],
        true,
        |chart| {
            for (set, heights) in sets.iter().zip(&heights) {
                let width = (high - low) / heights.len().max(1) as f64;
                let color = rgb(set.color);
                let bars = heights.iter().enumerate().map(|(i, &h)| {
                    let x = low + i as f64 * width;
                    Rectangle::new([(x, 0.0), (x + width, h)], color.mix(0.42).filled())
                });
                chart.draw_series(bars).expect(MEMORY);
                // The outline of the steps.
                let mut outline = vec![(low, 0.0)];
                for (i, &h) in heights.iter().enumerate() {
                    let x = low + i as f64 * width;
                    outline.extend([(x, h), (x + width, h)]);
                }
                outline.push((high, 0.0));
                chart
                    .draw_series(LineSeries::new(
                        outline,
                        color.stroke_width(2 * FINE as u32),
                    ))
                    .expect(MEMORY)
                    .label(set.name)
                    .legend(move |(x, y)| {
                        Rectangle::new(
                            [(x, y - 6 * N), (x + 18 * N, y + 6 * N)],
                            color.mix(0.6).filled(),
                        )
                    });
            }
        },
    )
}

/// Curves with points.
pub fn lines(
    curves: &[Curve<'_>],
    title: &str,
    [x_label, y_label]: [&str; 2],
    size: [usize; 2],
) -> Image {
    let points = || curves.iter().flat_map(|c| &c.points);
    let range = |pick: fn(&(f64, f64)) -> f64| {
        let (low, high) = points()
            .map(pick)
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), v| {
                (a.min(v), b.max(v))
            });
        if low < high {
            [low, high]
        } else {
            [low - 1.0, low + 1.0]
        }
    };
    let (xs, mut ys) = (range(|p| p.0), range(|p| p.1));
    let air = 0.05 * (ys[1] - ys[0]);
    ys = [
        if ys[0] >= 0.0 && ys[0] < 5.0 * air {
            0.0
        } else {
            ys[0] - air
        },
        ys[1] + air,
    ];
    let named = curves.iter().any(|c| !c.name.is_empty());
    chart(size, [title, x_label, y_label], xs, ys, named, |chart| {
        for curve in curves {
            let color = rgb(curve.color);
            let series = chart
                .draw_series(LineSeries::new(
                    curve.points.iter().copied(),
                    color.stroke_width(2 * FINE as u32),
                ))
                .expect(MEMORY);
            if !curve.name.is_empty() {
                series.label(curve.name).legend(move |(x, y)| {
                    PathElement::new(
                        [(x, y), (x + 18 * N, y)],
                        color.stroke_width(3 * FINE as u32),
                    )
                });
            }
            let dots = curve
                .points
                .iter()
                .map(|&p| Circle::new(p, 4 * N, color.filled()));
            chart.draw_series(dots).expect(MEMORY);
        }
    })
}

/// With as many digits as a range calls for, and a true minus sign.
fn number(value: f64, range: f64) -> String {
    let digits = (1.0 - range.log10()).ceil().clamp(0.0, 9.0) as usize;
    format!("{:.digits$}", value + 0.0).replace('-', "\u{2212}")
}

type Chart<'a, 'b> = ChartContext<
    'a,
    BitMapBackend<'b>,
    Cartesian2d<plotters::coord::types::RangedCoordf64, plotters::coord::types::RangedCoordf64>,
>;

fn chart(
    [width, height]: [usize; 2],
    [title, x_label, y_label]: [&str; 3],
    [x0, x1]: [f64; 2],
    [y0, y1]: [f64; 2],
    legend: bool,
    draw: impl FnOnce(&mut Chart<'_, '_>),
) -> Image {
    let mut image = Image::filled(width * FINE, height * FINE, [255; 3]);
    image.draw(|area| {
        let font = |size: f64| (FONT, size * F).into_font().color(&INK);
        let mut chart = ChartBuilder::on(area)
            .caption(title, font(26.0))
            .margin(18 * N)
            .x_label_area_size(54 * N)
            .y_label_area_size(72 * N)
            .build_cartesian_2d(x0..x1, y0..y1)
            .expect(MEMORY);
        chart
            .configure_mesh()
            .x_desc(x_label)
            .y_desc(y_label)
            .x_labels(10)
            .y_labels(8)
            .x_label_formatter(&|v| number(*v, x1 - x0))
            .y_label_formatter(&|v| number(*v, y1 - y0))
            .set_all_tick_mark_size(5 * N)
            .label_style(font(18.0))
            .axis_desc_style(font(20.0))
            .axis_style(INK.mix(0.7).stroke_width(FINE as u32))
            .bold_line_style(INK.mix(0.12).stroke_width(FINE as u32))
            .light_line_style(TRANSPARENT)
            .draw()
            .expect(MEMORY);
        draw(&mut chart);
        if !legend {
            return;
        }
        chart
            .configure_series_labels()
            .background_style(WHITE.mix(0.85))
            .border_style(TRANSPARENT)
            .label_font(font(19.0))
            .legend_area_size(30 * N)
            .position(SeriesLabelPosition::UpperRight)
            .draw()
            .expect(MEMORY);
    });
    image.reduced(FINE)
}
