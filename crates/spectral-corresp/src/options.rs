//! What is asked for.

use geom_core::Point3;
use geom_core::algebra::graph::Neighbours;
use geom_core::options::{OutOfRange, require};

/// Weights of the edges between lattice points (Eq. 6.1).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Weights {
    /// `exp(−(d/h)²)`, with the distance in spacings: the same on each lattice.
    #[default]
    Lattice,
    /// `exp(−d²)` with the distance in Å, as printed: neighbourhoods change with the spacing.
    Angstrom,
}

impl Weights {
    /// Across a face, an edge and a corner.
    pub(crate) fn of(self, spacing: f64) -> [f64; 3] {
        let unit = match self {
            Self::Lattice => 1.0,
            Self::Angstrom => spacing * spacing,
        };
        [1.0, 2.0, 3.0].map(|squared| (-squared * unit).exp())
    }
}

/// Which connected parts of a shape are kept. Parts are connected as the graph is.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Components {
    /// The one with most nodes; of several the first.
    #[default]
    Largest,
    /// All.
    All,
    /// Those with at least this share of the nodes of the largest.
    MinFraction(f64),
}

/// Options of a [`VoxelShape`](crate::VoxelShape).
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct ShapeOptions {
    /// Which lattice points are neighbours.
    /// 26 by default: modes then depend least on the direction of the lattice, and bridges of one point hold.
    pub neighbours: Neighbours,
    /// Weights of the edges.
    pub weights: Weights,
    /// Which parts are kept.
    pub components: Components,
    /// Fill what is outside but cannot be reached from the border of the lattice.
    /// Off by default: cavities have boundary nodes of their own.
    pub fill_cavities: bool,
    /// Most bytes that a shape may take while it is made: 22 per lattice point; of a mesh also 20 per row of points and 4 per
    /// triangle that a row may cross.
    /// 8 GiB by default.
    pub max_memory: u64,
}

impl Default for ShapeOptions {
    fn default() -> Self {
        Self {
            neighbours: Neighbours::TwentySix,
            weights: Weights::default(),
            components: Components::default(),
            fill_cavities: false,
            max_memory: 8 << 30,
        }
    }
}

impl ShapeOptions {
    /// Refuses values out of range.
    pub fn check(&self) -> Result<(), OutOfRange> {
        if let Components::MinFraction(share) = self.components {
            let within = share > 0.0 && share <= 1.0;
            require(within, "components", share, "be above 0 and at most 1")?;
        }
        require(self.max_memory > 0, "max_memory", 0, "be positive")
    }
}

/// Where the search starts.
#[derive(Clone, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Start {
    /// The thesis's: histograms of diameters and the first mode (Eq. 6.7), with both signs of the mode.
    Thesis,
    /// The first modes of each shape, with all signs.
    Spectral,
    /// Rotations of the whole, by trimmed ICP from many.
    Rigid,
    /// All of these; the best is taken.
    #[default]
    Auto,
    /// Points of the first shape and where they are in the second, Å: at least three, not on one line.
    Anchors(Vec<(Point3, Point3)>),
    /// The boundary node of the second shape for each one of the first, by their places in the lists of boundary
    /// nodes.
    Given(Vec<u32>),
}

/// How a start is made better.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Refine {
    /// Not at all.
    None,
    /// The thesis's two steps: joint modes, then the distortion of neighbourhoods (Eqs. 6.8–6.12), until it falls by
    /// less than `tolerance` in a step. Its minimum is a rigid motion: see "Reading the thesis".
    Thesis {
        /// Relative fall of the energy that ends it.
        tolerance: f64,
        /// Most steps.
        most: usize,
    },
    /// An annealed two-way fit: as rigid as possible over wide neighbourhoods first, then over narrow ones, with each
    /// shape's nodes drawn to the nearest of the other.
    #[default]
    Annealed,
}

/// The row of a boundary node in the thesis's start.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct HistogramOptions {
    /// Bars of the histogram of diameters.
    /// 10 by default, 2…24.
    pub bars: usize,
    /// Nodes at most this far away are counted, Å.
    /// 18 by default, and larger than the spacing.
    pub radius: f64,
    /// How much the first mode counts, in standard deviations of the histograms.
    /// 3 by default.
    pub mode: f64,
}

impl Default for HistogramOptions {
    fn default() -> Self {
        Self {
            bars: 10,
            radius: 18.0,
            mode: 3.0,
        }
    }
}

/// Which way is solved.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Directions {
    /// Both; the better one is taken, turned round if it leads from the second shape to the first. A pose in which
    /// parts touch is easier to reach than to leave.
    #[default]
    Both,
    /// From the first shape to the second.
    Forward,
}

/// Options of [`correspond`](crate::correspond()).
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct MatchOptions {
    /// Where the search starts.
    pub start: Start,
    /// How starts are made better.
    pub refine: Refine,
    /// Modes of each shape, of which the spectral start tries the first 1 to 5 and 8, and joint modes.
    /// 8 by default, 1…24.
    pub modes: usize,
    /// Rows of the thesis's start.
    pub histograms: HistogramOptions,
    /// The weight of a link between the shapes, over that of an edge across a face (Eq. 6.6).
    pub link: f64,
    /// Which way is solved.
    pub directions: Directions,
    /// Shapes of more boundary nodes than this are matched by this many of each first, well spread; the others
    /// follow.
    /// 8,000 by default, at least 200. Fewer are faster and follow the surface less closely before the last rounds, in
    /// which all nodes take part.
    pub control_nodes: usize,
    /// The length in the shapes' own unit that counts as 1 Å: all lengths of the method are those of proteins, and
    /// shapes of another size are measured by them.
    pub unit: f64,
    /// Scores J (Å) below the first are [`Verdict::Good`](crate::Verdict::Good), above the second
    /// [`Verdict::Failed`](crate::Verdict::Failed).
    pub verdict: [f64; 2],
    /// Most bytes that the search may take: see [`expected_bytes`](crate::correspond::expected_bytes).
    pub max_memory: u64,
    /// Seed of samples and rotations.
    pub seed: u64,
}

impl Default for MatchOptions {
    fn default() -> Self {
        Self {
            start: Start::default(),
            refine: Refine::default(),
            modes: 8,
            histograms: HistogramOptions::default(),
            link: 1.0,
            directions: Directions::default(),
            control_nodes: 8000,
            unit: 1.0,
            verdict: [4.0, 5.0],
            max_memory: 8 << 30,
            seed: 1,
        }
    }
}

impl MatchOptions {
    /// Refuses values out of range.
    pub fn check(&self) -> Result<(), OutOfRange> {
        let modes = self.modes;
        require((1..=24).contains(&modes), "modes", modes, "lie within 1…24")?;
        let positive = |option, value: f64| {
            let holds = value > 0.0 && value.is_finite();
            require(holds, option, value, "be positive and finite")
        };
        positive("link", self.link)?;
        positive("unit", self.unit)?;
        let [good, failed] = self.verdict;
        let in_order = good > 0.0 && good <= failed;
        let value = format!("{good}…{failed}");
        require(in_order, "verdict", value, "be positive and in order")?;
        require(self.max_memory > 0, "max_memory", 0, "be positive")?;
        positive("histograms.radius", self.histograms.radius)?;
        positive("histograms.mode", self.histograms.mode)?;
        let bars = self.histograms.bars;
        let within = (2..=24).contains(&bars);
        require(within, "histograms.bars", bars, "lie within 2…24")?;
        let control = self.control_nodes;
        require(control >= 200, "control_nodes", control, "be at least 200")?;
        if let Refine::Thesis { tolerance, most } = self.refine {
            let within = tolerance > 0.0 && tolerance < 1.0;
            require(within, "refine.tolerance", tolerance, "lie between 0 and 1")?;
            require(most > 0, "refine.most", most, "be at least 1")?;
        }
        Ok(())
    }
}

/// The nodes that a morph leads; the others follow them.
#[derive(Clone, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Landmarks {
    /// All boundary nodes.
    #[default]
    Boundary,
    /// The thesis's: extrema of a harmonic function (Eqs. 6.13–6.14).
    Harmonic {
        /// No two extrema of one kind are closer than this, Å.
        radius: f64,
    },
    /// Nodes of the first shape and where they are in the second, Å.
    Custom(Vec<(u32, Point3)>),
}

/// How landmarks go from one shape to the other.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Paths {
    /// Each node turns by a share of its rotation. A rigid motion is rigid at all times.
    #[default]
    Rotating,
    /// On straight lines (Eq. 6.15): what turns by θ is shorter by cos θ/2 half-way.
    Linear,
}

/// Options of a [`Morph`](crate::Morph).
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct MorphOptions {
    /// Which nodes are led.
    pub landmarks: Landmarks,
    /// How they go.
    pub paths: Paths,
    /// Frames are made of the second shape moved backwards, too; the last one is that shape.
    /// On by default. Off, the last frame is the first shape where it was led to, not the second shape itself.
    pub two_way: bool,
    /// Standard deviation of the low-pass of a frame, in spacings; 0 for none. Above 0.55 parts that are one lattice
    /// point thin vanish.
    /// 0.7 by default, 0…10.
    pub sigma: f64,
    /// Systems of more nodes than this are solved by conjugate gradients, not by a factor.
    /// 100,000 by default. A factor serves all frames; without one each frame is solved anew in little memory.
    pub direct_nodes: usize,
    /// Most bytes that a frame's lattice may take: 15 per point.
    pub max_memory: u64,
}

impl Default for MorphOptions {
    fn default() -> Self {
        Self {
            landmarks: Landmarks::default(),
            paths: Paths::default(),
            two_way: true,
            sigma: 0.7,
            direct_nodes: 100_000,
            max_memory: 8 << 30,
        }
    }
}

impl MorphOptions {
    /// Refuses values out of range.
    pub fn check(&self) -> Result<(), OutOfRange> {
        if let Landmarks::Harmonic { radius } = self.landmarks {
            let holds = radius > 0.0 && radius.is_finite();
            require(holds, "landmarks.radius", radius, "be positive and finite")?;
        }
        let sigma = self.sigma;
        require(
            (0.0..=10.0).contains(&sigma),
            "sigma",
            sigma,
            "lie within 0…10",
        )?;
        require(self.max_memory > 0, "max_memory", 0, "be positive")
    }
}

/// Options of [`compare`](crate::compare()).
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct CompareOptions {
    /// Neighbourhoods in which distortion is measured, Å.
    /// 18 by default.
    pub radius: f64,
    /// Pairs per node of them.
    /// 60 by default. More lower the noise of the sample.
    pub pairs: usize,
    /// Seed of the sample of pairs.
    pub seed: u64,
}

impl Default for CompareOptions {
    fn default() -> Self {
        Self {
            radius: 18.0,
            pairs: 60,
            seed: 1,
        }
    }
}

impl CompareOptions {
    /// Refuses values out of range.
    pub fn check(&self) -> Result<(), OutOfRange> {
        let radius = self.radius;
        let holds = radius > 0.0 && radius.is_finite();
        require(holds, "radius", radius, "be positive and finite")?;
        require(self.pairs > 0, "pairs", self.pairs, "be at least 1")
    }
}
