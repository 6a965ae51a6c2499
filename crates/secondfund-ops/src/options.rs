//! What is asked for.
//!
//! Each struct has a `check`, which its verb calls before any work. `..Default::default()` fills in what a caller has
//! no opinion on. What is "in unit scale" counts in a scale in which the largest extent of the surface is 1, so that it
//! need not be changed from a ligand to a virus.

use geom_core::options::{OutOfRange, require};

use crate::forms::{Operator, Weight};

/// Options of [`spectrum`](crate::spectrum) and [`assemble`](crate::operators::assemble()).
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct SpectrumOptions {
    /// The operator.
    pub operator: Operator,
    /// Modes, the constants not counted.
    /// 10 by default. The surface must have more vertices than modes and connected components together
    /// ([`Error::TooManyModes`](crate::Error::TooManyModes)).
    pub modes: usize,
    /// ε: curvatures below it count as flat, in unit scale. Results depend little on it from 0.1 to 2.
    /// 0 is allowed where no principal curvature vanishes.
    ///
    /// 0.5 by default. The larger it is, the more the operator becomes the Laplace operator over ε², which sees
    /// distances and no curvature; the smaller, the fainter the bends that it tells from flat.
    pub regularization: f64,
    /// Smallest and largest Ψ.
    /// 0.5 and 10 by default. Equal ones make the weight constant.
    pub bounds: [f64; 2],
    /// How a quad of a Catmull–Clark surface is integrated.
    /// Triangles need none; Bézier elements take its `points` only.
    pub quadrature: Quadrature,
    /// Largest relative residual of an eigenpair.
    /// 1e-8 by default, between 0 and 1.
    pub tolerance: f64,
    /// Count the eigenvalues by the inertia of a factor, so that no copy of a multiple one is lost.
    /// Off by default: it costs another factor of a sparse matrix.
    pub verify: bool,
}

impl Default for SpectrumOptions {
    fn default() -> Self {
        Self {
            operator: Operator::default(),
            modes: 10,
            regularization: 0.5,
            bounds: [0.5, 10.0],
            quadrature: Quadrature::default(),
            tolerance: 1e-8,
            verify: false,
        }
    }
}

/// Quadrature over a quad of a Catmull–Clark surface.
///
/// A regular quad has `points²` of them, one with an extraordinary corner `3 · depth · points²`. What is left out at
/// the corner is `4^−depth` of the parameters of the quad: 0.02 % by default.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Quadrature {
    /// Gauss points per direction, 2…8.
    /// 4 by default: products of two bicubics are then exact in the parameters; forms are not polynomials, so that more
    /// may pay where curvature varies much within a quad.
    pub points: usize,
    /// Levels towards an extraordinary vertex, 1…12; the last corner of side 2^−depth is left out.
    /// 6 by default.
    pub depth: usize,
}

impl Default for Quadrature {
    fn default() -> Self {
        Self {
            points: 4,
            depth: 6,
        }
    }
}

impl SpectrumOptions {
    /// Refuses values out of range.
    pub fn check(&self) -> Result<(), OutOfRange> {
        let epsilon = self.regularization;
        let finite = epsilon >= 0.0 && epsilon.is_finite();
        require(
            finite,
            "regularization",
            epsilon,
            "be at least 0 and finite",
        )?;
        let [low, high] = self.bounds;
        let in_order = low > 0.0 && low <= high && high.is_finite();
        let value = format!("{low}…{high}");
        require(in_order, "bounds", value, "be positive and in order")?;
        require(self.modes > 0, "modes", 0, "be at least 1")?;
        let tolerance = self.tolerance;
        let within = tolerance > 0.0 && tolerance < 1.0;
        require(within, "tolerance", tolerance, "lie between 0 and 1")?;
        self.quadrature.check()
    }
}

impl Quadrature {
    pub(crate) fn check(&self) -> Result<(), OutOfRange> {
        let points = self.points;
        require(
            (2..=8).contains(&points),
            "quadrature.points",
            points,
            "lie within 2…8",
        )?;
        let depth = self.depth;
        require(
            (1..=12).contains(&depth),
            "quadrature.depth",
            depth,
            "lie within 1…12",
        )
    }
}

/// How many modes the rows take.
///
/// Low modes tell large parts apart, higher ones smaller parts.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Modes {
    /// As many as groups, at least 3 and at most 15; 8 while the number of groups is sought.
    #[default]
    Auto,
    /// This many.
    Count(usize),
    /// Up to the largest ratio of an eigenvalue to the one before, among the first 15.
    EigenGap,
}

/// How many groups there are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Groups {
    /// This many. Segments may be more: groups fall into connected patches.
    Count(usize),
    /// The number from 2 to `most` with the smallest index of Davies and Bouldin.
    /// Of centroids in the space of the modes, where they need not lie on the surface.
    DaviesBouldin {
        /// Largest number.
        most: usize,
    },
    /// The smallest number from 2 to `most` whose medoid silhouette is nearly (99 %) the largest.
    /// A silhouette that hardly rises any more is not worth another part.
    Silhouette {
        /// Largest number.
        most: usize,
    },
}

impl Default for Groups {
    fn default() -> Self {
        Self::Silhouette { most: 12 }
    }
}

/// Options of [`segment`](crate::segment()).
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct SegmentOptions {
    /// Modes in the rows.
    /// What it takes at most says [`SegmentOptions::modes_needed`]; where a spectrum has fewer, all of them are taken,
    /// but for [`Modes::Count`], which is then refused.
    pub modes: Modes,
    /// Groups of rows.
    pub groups: Groups,
    /// Vertices that are grouped, drawn by area; the others follow the nearest medoid. At most 8,000.
    /// 2,000 by default. Time and memory grow with its square: 4 bytes per pair.
    pub sample: usize,
    /// Starts of the search; the best is taken.
    /// 3 by default: each is a local search from random vertices.
    pub restarts: usize,
    /// Smooth the borders of the segments where no crease holds them.
    /// On by default. Off, borders run along the zigzag of the faces.
    pub smooth: bool,
    /// Seed of the sample and the starts.
    /// The same seed gives the same segments, for any number of threads.
    pub seed: u64,
}

impl Default for SegmentOptions {
    fn default() -> Self {
        Self {
            modes: Modes::default(),
            groups: Groups::default(),
            sample: 2000,
            restarts: 3,
            smooth: true,
            seed: 1,
        }
    }
}

/// Options of [`parts`](crate::segment::parts()).
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct PartOptions {
    /// Whose modes are cut; the first one's give the number of groups.
    /// Three by default: see the page of the crate. Each is as many votes as there are numbers of groups.
    pub operators: Vec<Operator>,
    /// About how many parts are wanted; sought if none are. The surface may have more, or fewer: neighbours that blur into each
    /// other where there is no neck are one.
    pub groups: Option<usize>,
    /// Largest number of groups that is tried.
    /// 15 by default.
    pub most: usize,
    /// ε of the operators.
    /// 0.5 by default, in unit scale.
    pub regularization: f64,
    /// Vertices that are grouped, drawn by area; the others follow the nearest medoid. At most 8,000.
    /// 1,000 by default, half of what one segmentation takes, because there are about nine of them.
    pub sample: usize,
    /// Starts of each search for medoids; the best is taken.
    pub restarts: usize,
    /// Straighten the borders of the parts where no crease holds them.
    pub smooth: bool,
    /// Seed of the sample and the starts.
    pub seed: u64,
}

impl Default for PartOptions {
    fn default() -> Self {
        Self {
            operators: vec![
                Operator::Concave(Weight::One),
                Operator::Concave(Weight::ExpK),
                Operator::Slo(Weight::ExpK),
            ],
            groups: None,
            most: 15,
            regularization: 0.5,
            sample: 1000,
            restarts: 2,
            smooth: true,
            seed: 1,
        }
    }
}

impl PartOptions {
    /// Refuses values out of range.
    pub fn check(&self) -> Result<(), OutOfRange> {
        let count = self.operators.len();
        require(count > 0, "operators", count, "be at least 1")?;
        require(self.most >= 2, "most", self.most, "be at least 2")?;
        for groups in [Some(self.most), self.groups].into_iter().flatten() {
            let groups = Groups::Count(groups);
            SegmentOptions {
                groups,
                ..self.segments()
            }
            .check()?;
        }
        Ok(())
    }

    /// How each operator's modes are cut.
    pub(crate) fn segments(&self) -> SegmentOptions {
        SegmentOptions {
            sample: self.sample,
            restarts: self.restarts,
            seed: self.seed,
            ..SegmentOptions::default()
        }
    }
}

/// Most vertices in the sample: their distances take 4 bytes per pair.
const MOST_SAMPLE: usize = 8000;
/// Modes where the number of groups is sought.
pub(crate) const SEARCH_MODES: usize = 8;

impl SegmentOptions {
    /// Refuses values out of range.
    pub fn check(&self) -> Result<(), OutOfRange> {
        let groups = match self.groups {
            Groups::Count(count) => count,
            Groups::DaviesBouldin { most } | Groups::Silhouette { most } => most,
        };
        let within = (2..=self.sample).contains(&groups);
        require(
            within,
            "groups",
            groups,
            "be at least 2 and at most the sample",
        )?;
        let must = "be at most 8000: distances of all pairs are kept, and more change nothing";
        require(self.sample <= MOST_SAMPLE, "sample", self.sample, must)?;
        require(self.modes != Modes::Count(0), "modes", 0, "be at least 1")?;
        require(self.restarts > 0, "restarts", 0, "be at least 1")
    }

    /// The modes that [`segment`](crate::segment()) takes at most, so that the spectrum has enough.
    ///
    /// ```
    /// use secondfund_ops::{Groups, SegmentOptions};
    /// let asked = SegmentOptions { groups: Groups::Count(6), ..SegmentOptions::default() };
    /// assert_eq!(asked.modes_needed(), 6);
    /// ```
    pub fn modes_needed(&self) -> usize {
        match (self.modes, self.groups) {
            (Modes::Count(count), _) => count,
            (Modes::EigenGap, _) => MOST_MODES + 1,
            (Modes::Auto, Groups::Count(count)) => count.clamp(LEAST_MODES, MOST_MODES),
            (Modes::Auto, Groups::DaviesBouldin { most } | Groups::Silhouette { most }) => {
                most.clamp(SEARCH_MODES, MOST_MODES)
            }
        }
    }
}

/// Fewest modes of [`Modes::Auto`].
pub(crate) const LEAST_MODES: usize = 3;
/// Most modes of [`Modes::Auto`] and [`Modes::EigenGap`].
pub(crate) const MOST_MODES: usize = 15;

/// Which operator moves the surface.
///
/// Mean curvature flow takes away noise and rounds every edge; the other shapes creases and takes away little noise.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum FlowOperator {
    /// Laplace–Beltrami: mean curvature flow.
    Lbo,
    /// The generalized Giaquinta–Hildebrandt operator (Eq. 7.26): flat parts and straight creases stay.
    #[default]
    Ggho,
}

/// Options of [`smooth`](crate::smooth) and [`smooth_quads`](crate::smooth_quads).
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct FlowOptions {
    /// The operator.
    pub operator: FlowOperator,
    /// Steps.
    /// 10 by default. Fewer are made where nothing moves any more.
    pub iterations: usize,
    /// In a step 95 % of the vertices move less than this share of a mean edge.
    /// 0.02 by default, within 1e-6…0.25. A step is implicit in its forward part, so that its size is a matter of
    /// accuracy.
    pub step: f64,
    /// δ of `H K / √(K² + δ²)`, in unit scale.
    /// 0.1 by default. Where the Gaussian curvature is far below it the flow hardly moves anything: flat and
    /// cylindrical parts stay.
    pub delta: f64,
    /// The share β of the backward part, which sharpens and amplifies noise: 0 for a well-posed flow, 1 for
    /// Eq. 7.26 as it stands.
    /// ½ by default.
    pub sharpen: f64,
    /// λ: the share of the way to the mean of its neighbours, weighted along the curvature lines (Eqs.
    /// 7.24–7.25), that a vertex goes in its tangent plane per step.
    /// 0.05 by default; 0 leaves vertices where the flow carries them. Those of a crease go along it only.
    pub tangential: f64,
    /// No corner of a face becomes narrower than this, or flatter than 180° less it, if it is not so from the start, in
    /// degrees below 60.
    /// 10 by default. Where that stops a vertex, the surface around it goes on; a volume that could not be kept otherwise goes
    /// before it.
    pub least_angle: f64,
    /// Keep the enclosed volume, of a closed surface.
    /// Off by default; an open surface is refused with [`Error::Open`](crate::Error::Open).
    pub keep_volume: bool,
    /// Keep the vertices of boundaries where they are.
    pub keep_rims: bool,
    /// Let no faces come through others, those of the control mesh where it has quads.
    /// Faces that cross in the input may go on crossing. It costs a look at the faces near by in each step.
    pub keep_apart: bool,
    /// How quads are integrated.
    pub quadrature: Quadrature,
    /// Steps for which one matrix of the implicit part serves, the forces being new in each: 1 for a new matrix in every
    /// step, which costs about twice as much and moves the surface in the same way.
    pub refresh: usize,
}

impl Default for FlowOptions {
    fn default() -> Self {
        Self {
            operator: FlowOperator::default(),
            iterations: 10,
            step: 0.02,
            delta: 0.1,
            sharpen: 0.5,
            tangential: 0.05,
            least_angle: 10.0,
            keep_volume: false,
            keep_rims: true,
            keep_apart: true,
            quadrature: Quadrature {
                points: 3,
                depth: 4,
            },
            refresh: 5,
        }
    }
}

impl FlowOptions {
    /// Refuses values out of range.
    pub fn check(&self) -> Result<(), OutOfRange> {
        let within = |option, value: f64, low: f64, high: f64, must| {
            require((low..=high).contains(&value), option, value, must)
        };
        within(
            "step",
            self.step,
            1e-6,
            0.25,
            "lie within 1e-6…0.25 mean edges",
        )?;
        within("delta", self.delta, 1e-9, 1e9, "lie within 1e-9…1e9")?;
        within("sharpen", self.sharpen, 0.0, 1.0, "lie within 0…1")?;
        within("tangential", self.tangential, 0.0, 1.0, "lie within 0…1")?;
        below_60(self.least_angle)?;
        require(self.refresh > 0, "refresh", 0, "be at least 1")?;
        self.quadrature.check()
    }
}

/// A triangle has a corner of at most 60 degrees.
fn below_60(least_angle: f64) -> Result<(), OutOfRange> {
    let below = (0.0..60.0).contains(&least_angle);
    require(
        below,
        "least_angle",
        least_angle,
        "be at least 0 and below 60",
    )
}

/// How the normals of faces are filtered.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum NormalFilter {
    /// Means over the faces around, those nearby in place and direction most.
    Bilateral {
        /// Rounds.
        rounds: usize,
        /// Difference of unit normals beyond which a face counts little.
        /// 0.3 is the difference of normals that are 17° apart. Larger ones round edges of that angle off; smaller ones
        /// take noise for edges.
        range: f64,
    },
    /// Least total variation: normals become constant on patches.
    TotalVariation {
        /// Most rounds; they end when the normals rest.
        rounds: usize,
        /// α: how firmly normals are held to those of the input, in 1 over mean edges. Lower values flatten coarser
        /// noise, and details with it.
        fidelity: f64,
    },
}

impl NormalFilter {
    /// The bilateral filter as it is by default.
    pub const BILATERAL: Self = Self::Bilateral {
        rounds: 15,
        range: 0.3,
    };
    /// The total-variation filter as it is by default.
    pub const TOTAL_VARIATION: Self = Self::TotalVariation {
        rounds: 100,
        fidelity: 10.0,
    };
}

/// Options of [`flow::filter_normals`](crate::flow::filter_normals).
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct FilterOptions {
    /// The filter of the normals.
    pub filter: NormalFilter,
    /// Rounds of the vertices that follow them.
    /// 20 by default. With 0 nothing moves: the normals are filtered for nothing.
    pub vertex_rounds: usize,
    /// The share of the way to the middle of its faces that a vertex goes per round where no normal pulls: in flat places
    /// and along edges.
    /// 0.1 by default. So faces keep their shapes.
    pub tangential: f64,
    /// No corner of a face becomes narrower than this, or flatter than 180° less it, if it is not so from the start, in
    /// degrees below 60.
    /// 10 by default.
    pub least_angle: f64,
    /// Keep the enclosed volume, of a closed surface.
    /// Off by default.
    pub keep_volume: bool,
    /// Keep the vertices of boundaries where they are.
    pub keep_rims: bool,
    /// Let no faces come through others.
    pub keep_apart: bool,
}

impl Default for FilterOptions {
    fn default() -> Self {
        Self {
            filter: NormalFilter::BILATERAL,
            vertex_rounds: 20,
            tangential: 0.1,
            least_angle: 10.0,
            keep_volume: false,
            keep_rims: true,
            keep_apart: true,
        }
    }
}

impl FilterOptions {
    /// Refuses values out of range.
    pub fn check(&self) -> Result<(), OutOfRange> {
        let positive = |option, value: f64| {
            let within = value > 0.0 && value.is_finite();
            require(within, option, value, "be above 0 and finite")
        };
        let along = self.tangential;
        let within = (0.0..=1.0).contains(&along);
        require(within, "tangential", along, "lie within 0…1")?;
        below_60(self.least_angle)?;
        match self.filter {
            NormalFilter::Bilateral { range, .. } => positive("range", range),
            NormalFilter::TotalVariation { fidelity, .. } => positive("fidelity", fidelity),
        }
    }
}

/// Options of [`pockets::find`](crate::pockets::find).
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct PocketOptions {
    /// Atoms within this distance of a point count as its burial, Å.
    /// 10 by default, within 4…30. A larger one sees larger valleys only.
    pub radius: f64,
    /// How much the atoms of other chains count than of the one that has most atoms around a point: below 1 the
    /// clefts between chains do not hide the pockets within them.
    /// ½ by default; 1 makes no difference between chains, 0 looks at one chain at a time.
    pub foreign: f64,
    /// Spacing of the points, Å.
    /// 1.2 by default, within 0.3…3. Time grows with its inverse cube.
    pub spacing: f64,
    /// Smallest and largest distance of a point from the nearest atom's surface, Å.
    /// 1.6 and 2.8 by default: where the centre of an atom in contact with the polymer may lie.
    pub shell: [f64; 2],
    /// The share of the points that are not deep enough.
    /// 0.95 by default. Less makes pockets larger and lets neighbours grow together.
    pub percentile: f64,
    /// Nor are points whose burial is less than this times the median: a convex body has no pockets.
    /// 1.3 by default; 0 lets the percentile alone decide, which finds pockets on a ball.
    pub prominence: f64,
    /// Take percentile and median of each chain's own points.
    /// On by default: a small chain beside a large one keeps its own pockets.
    pub per_chain: bool,
    /// Points at most this far apart belong together, Å.
    /// 1.8 by default: on a lattice of 1.2 Å the neighbours along the sides and the diagonals of its squares.
    pub link: f64,
    /// Fewer points are no pocket.
    /// 4 by default.
    pub least_points: usize,
    /// Most pockets.
    /// 20 by default. [`Pockets::candidates`](crate::pockets::Pockets::candidates) tells how many there were.
    pub most: usize,
}

impl Default for PocketOptions {
    fn default() -> Self {
        Self {
            radius: 10.0,
            foreign: 0.5,
            spacing: 1.2,
            shell: [1.6, 2.8],
            percentile: 0.95,
            prominence: 1.3,
            per_chain: true,
            link: 1.8,
            least_points: 4,
            most: 20,
        }
    }
}

impl PocketOptions {
    /// Refuses values out of range.
    pub fn check(&self) -> Result<(), OutOfRange> {
        let within = |option, value: f64, low: f64, high: f64, must| {
            require((low..=high).contains(&value), option, value, must)
        };
        check_burial(self.radius, self.foreign)?;
        within(
            "prominence",
            self.prominence,
            0.0,
            100.0,
            "lie within 0…100",
        )?;
        within("spacing", self.spacing, 0.3, 3.0, "lie within 0.3…3 Å")?;
        within(
            "percentile",
            self.percentile,
            0.0,
            0.999,
            "lie within 0…0.999",
        )?;
        within(
            "link",
            self.link,
            self.spacing,
            6.0,
            "lie within the spacing…6 Å",
        )?;
        let [near, far] = self.shell;
        let in_order = near >= 0.0 && near < far && far <= 10.0;
        let value = format!("{near}…{far}");
        require(in_order, "shell", value, "be in order and within 0…10 Å")?;
        require(self.most > 0, "most", 0, "be at least 1")
    }
}

/// Refuses a burial out of range.
/// Both what finds pockets and what outlines them count burial.
pub(crate) fn check_burial(radius: f64, foreign: f64) -> Result<(), OutOfRange> {
    let within = (4.0..=30.0).contains(&radius);
    require(within, "radius", radius, "lie within 4…30 Å")?;
    let within = (0.0..=1.0).contains(&foreign);
    require(within, "foreign", foreign, "lie within 0…1")
}

/// What tells which triangles of a surface belong to a pocket.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum OutlineSource {
    /// Those in front of which the pocket's points lie, and points near these that a small probe reaches and a large one
    /// does not cover.
    /// The default. Small holes in an outline are filled, crumbs beside it given up.
    Probes(ProbeOptions),
    /// Patches of the secondary Laplace operator with Ψ = e^{−H}, to which the pocket's points are nearest.
    /// Outlines are then as coarse as the patches.
    Patches,
}

impl Default for OutlineSource {
    fn default() -> Self {
        Self::Probes(ProbeOptions::default())
    }
}

/// Options of [`pockets::outline`](crate::pockets::outline()).
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct OutlineOptions {
    /// Of patches: modes of the secondary Laplace operator with Ψ = e^{−H}.
    pub modes: usize,
    /// Of patches: how many the surface is cut into.
    pub groups: usize,
    /// Of patches: ε of the operator.
    /// 2 by default, in unit scale.
    pub regularization: f64,
    /// Rounds of smoothing of the surface's normals, of which its curvature is taken.
    /// 20 by default. The surface itself is not moved.
    pub normal_rounds: u32,
    /// Of patches: how far above the surface its burial is taken, Å.
    /// 1.6 by default, within 0…10.
    pub probe: f64,
    /// Of patches: atoms within this distance count as burial, Å.
    pub radius: f64,
    /// Of patches: how much those of other chains than the one with most atoms there count: see [`PocketOptions::foreign`].
    pub foreign: f64,
    /// What tells which triangles belong to a pocket.
    pub source: OutlineSource,
}

impl Default for OutlineOptions {
    fn default() -> Self {
        Self {
            modes: 20,
            groups: 40,
            regularization: 2.0,
            normal_rounds: 20,
            probe: 1.6,
            radius: 10.0,
            foreign: 0.5,
            source: OutlineSource::default(),
        }
    }
}

impl OutlineOptions {
    /// Refuses values out of range.
    pub fn check(&self) -> Result<(), OutOfRange> {
        self.spectrum().check()?;
        self.segments().check()?;
        let probe = self.probe;
        let within = (0.0..=10.0).contains(&probe);
        require(within, "probe", probe, "lie within 0…10 Å")?;
        if let OutlineSource::Probes(probes) = &self.source {
            probes.check()?;
        }
        check_burial(self.radius, self.foreign)
    }

    /// The modes on which the patches are cut.
    pub(crate) fn spectrum(&self) -> SpectrumOptions {
        SpectrumOptions {
            operator: Operator::Slo(Weight::ExpMinusH),
            modes: self.modes,
            regularization: self.regularization,
            ..SpectrumOptions::default()
        }
    }

    /// How they are cut.
    pub(crate) fn segments(&self) -> SegmentOptions {
        SegmentOptions {
            modes: Modes::Count(self.modes),
            groups: Groups::Count(self.groups),
            restarts: 1,
            ..SegmentOptions::default()
        }
    }
}

/// Options of [`pockets::between_probes`](crate::pockets::between_probes).
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct ProbeOptions {
    /// Radius of the small probe, which reaches a point, Å.
    /// 1.4 by default, a water molecule; within 0…5.
    pub inner: f64,
    /// Radius of the large one, which does not cover it, Å.
    /// 3 by default, at most 20. The larger it is, the shallower the hollows that count.
    pub outer: f64,
    /// Spacing of the points, Å.
    /// 1.2 by default, within 0.3…3.
    pub spacing: f64,
    /// A point belongs to the pocket of the nearest pocket point, if that is within this distance, Å.
    /// 3 by default, within 0…20. Points farther from any pocket belong to none.
    pub reach: f64,
}

impl Default for ProbeOptions {
    fn default() -> Self {
        Self {
            inner: 1.4,
            outer: 3.0,
            spacing: 1.2,
            reach: 3.0,
        }
    }
}

impl ProbeOptions {
    /// Refuses values out of range.
    pub fn check(&self) -> Result<(), OutOfRange> {
        let within = |option, value: f64, low: f64, high: f64, must| {
            require((low..=high).contains(&value), option, value, must)
        };
        within("inner", self.inner, 0.0, 5.0, "lie within 0…5 Å")?;
        let must = "be larger than the inner one and at most 20 Å";
        require(self.outer > self.inner, "outer", self.outer, must)?;
        within("outer", self.outer, 0.0, 20.0, must)?;
        within("spacing", self.spacing, 0.3, 3.0, "lie within 0.3…3 Å")?;
        within("reach", self.reach, 0.0, 20.0, "lie within 0…20 Å")
    }
}

/// Options of [`pockets::concave_patches`](crate::pockets::concave_patches).
///
/// By default it cuts along two modes, then along four.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct PatchOptions {
    /// Modes of the secondary Laplace operator with Ψ = e^{−H} for the first cut; the second takes two more.
    pub modes: usize,
    /// Groups of the first cut; the second has one more for each concave patch.
    pub groups: usize,
    /// ε of the operator.
    pub regularization: f64,
    /// Rounds of smoothing of the surface's normals.
    pub normal_rounds: u32,
    /// How far above the surface a pocket's points lie, Å.
    pub probe: f64,
    /// Most pockets.
    pub most: usize,
}

impl Default for PatchOptions {
    fn default() -> Self {
        Self {
            modes: 2,
            groups: 4,
            regularization: 0.5,
            normal_rounds: 3,
            probe: 1.6,
            most: 20,
        }
    }
}

impl PatchOptions {
    /// Refuses values out of range.
    pub fn check(&self) -> Result<(), OutOfRange> {
        self.spectrum().check()?;
        self.segments(self.modes, self.groups).check()?;
        let within = (0.0..=10.0).contains(&self.probe);
        require(within, "probe", self.probe, "lie within 0…10 Å")?;
        require(self.most > 0, "most", 0, "be at least 1")
    }

    /// The modes of both cuts.
    pub(crate) fn spectrum(&self) -> SpectrumOptions {
        SpectrumOptions {
            operator: Operator::Slo(Weight::ExpMinusH),
            modes: self.modes + 2,
            regularization: self.regularization,
            ..SpectrumOptions::default()
        }
    }

    /// A cut.
    pub(crate) fn segments(&self, modes: usize, groups: usize) -> SegmentOptions {
        SegmentOptions {
            modes: Modes::Count(modes),
            groups: Groups::Count(groups),
            ..SegmentOptions::default()
        }
    }
}
