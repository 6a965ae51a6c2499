//! Colours: maps from values, and the colours of regions.

use geom_core::mesh::Region;

/// An sRGB colour.
pub type Rgb = [u8; 3];

/// From numbers to colours.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ColorMap {
    /// Dark blue over green to yellow, even to the eye.
    #[default]
    Viridis,
    /// Light yellow over orange to dark red, for errors: what is right is light.
    Heat,
    /// Blue over light grey to red, for values about a middle (Moreland 2009).
    CoolWarm,
}

/// Moreland's published "cool to warm" at equal steps.
const COOL_WARM: [Rgb; 9] = [
    [59, 76, 192],
    [98, 130, 234],
    [141, 176, 254],
    [184, 208, 249],
    [221, 221, 221],
    [245, 196, 173],
    [244, 154, 123],
    [222, 96, 77],
    [180, 4, 38],
];

impl ColorMap {
    /// The colour at `t` in 0…1; clamped, grey for NaN.
    pub fn at(self, t: f64) -> Rgb {
        if t.is_nan() {
            return [128; 3];
        }
        let t = t.clamp(0.0, 1.0);
        match self {
            Self::Viridis => {
                let c = colorous::VIRIDIS.eval_continuous(t);
                [c.r, c.g, c.b]
            }
            Self::Heat => {
                let c = colorous::YELLOW_ORANGE_RED.eval_continuous(t);
                [c.r, c.g, c.b]
            }
            Self::CoolWarm => {
                let x = t * (COOL_WARM.len() - 1) as f64;
                let i = (x as usize).min(COOL_WARM.len() - 2);
                mix(COOL_WARM[i], COOL_WARM[i + 1], x - i as f64)
            }
        }
    }
}

/// A colour between two: the first at 0, the second at 1.
pub fn mix(a: Rgb, b: Rgb, t: f64) -> Rgb {
    [0, 1, 2].map(|k| (f64::from(a[k]) * (1.0 - t) + f64::from(b[k]) * t).round() as u8)
}

/// Values with their colours: what a colour bar shows.
#[derive(Clone, Debug, PartialEq)]
pub struct Scale {
    /// The map.
    pub map: ColorMap,
    /// The value of the first colour.
    pub low: f64,
    /// The value of the last colour.
    pub high: f64,
    /// What is shown, with its unit.
    pub label: String,
}

impl Scale {
    /// From `low` to `high`.
    pub fn new(map: ColorMap, [low, high]: [f64; 2], label: impl Into<String>) -> Self {
        let label = label.into();
        Self {
            map,
            low,
            high,
            label,
        }
    }

    /// Equally far to both sides of zero, to the largest magnitude of the values.
    pub fn symmetric(values: &[f64], label: impl Into<String>) -> Self {
        let reach = values.iter().fold(0.0, |m: f64, v| m.max(v.abs()));
        let reach = if reach > 0.0 { reach } else { 1.0 };
        Self::new(ColorMap::CoolWarm, [-reach, reach], label)
    }

    /// The colour of a value.
    pub fn color(&self, value: f64) -> Rgb {
        let range = self.high - self.low;
        self.map.at(if range > 0.0 {
            (value - self.low) / range
        } else {
            0.5
        })
    }

    /// One colour per value.
    pub fn colors(&self, values: &[f64]) -> Vec<Rgb> {
        values.iter().map(|&v| self.color(v)).collect()
    }
}

/// The colour of a region of a mesh of tetrahedra: the molecule warm, the exterior cool.
pub fn region_color(region: Region) -> Rgb {
    const COLORS: [Rgb; 8] = [
        [158, 190, 214],
        [232, 170, 84],
        [142, 178, 112],
        [190, 130, 168],
        [112, 168, 164],
        [206, 120, 104],
        [150, 140, 190],
        [180, 160, 130],
    ];
    COLORS[usize::from(region) % COLORS.len()]
}

/// The colour of a segment: twelve hues, of neighbours in number far apart; further ones are darker.
pub fn segment_color(segment: u32) -> Rgb {
    const COLORS: [Rgb; 12] = [
        [166, 206, 227],
        [251, 154, 60],
        [124, 190, 120],
        [227, 90, 88],
        [177, 146, 214],
        [250, 220, 110],
        [70, 130, 190],
        [240, 160, 200],
        [60, 150, 120],
        [180, 130, 90],
        [150, 150, 150],
        [120, 210, 215],
    ];
    let (round, place) = (
        segment as usize / COLORS.len(),
        segment as usize % COLORS.len(),
    );
    mix(COLORS[place], [30, 30, 40], (0.22 * round as f64).min(0.66))
}
