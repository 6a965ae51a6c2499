//! What to reach and by which means.

use geom_core::options::{OutOfRange, require};

use crate::measure::metrics::{Measures, SHAPE_WEIGHT};

/// What every tetrahedron should reach. The improvement works on what is worse, and stops when
/// nothing is.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Goals {
    /// Smallest dihedral angle, degrees.
    ///
    /// 20 by default, within 0…70: the regular tetrahedron has 70.53° at every edge, so that more cannot be asked of a
    /// mesh.
    pub min_dihedral: f64,
    /// Largest dihedral angle, degrees.
    ///
    /// 155 by default, within 75…180. Angles near 180° spoil the condition of a stiffness matrix even where no angle is
    /// small.
    pub max_dihedral: f64,
    /// Joe–Liu measure (thesis Eq. 3.16).
    ///
    /// 0.3 by default, within 0…1. It also sees needles, whose dihedral angles may all be fair.
    pub joe_liu: f64,
    /// Longest over shortest edge. It is judged, not worked on by itself: the improvement raises angles
    /// and the Joe–Liu measure, and [`joe_liu_for_edge_ratio`](Goals::joe_liu_for_edge_ratio) says which
    /// measure guarantees a ratio.
    pub edge_ratio: f64,
}

impl Goals {
    /// Does a tetrahedron reach them?
    ///
    /// A measure that is not a number meets nothing.
    pub fn met_by(&self, m: &Measures) -> bool {
        m.min_dihedral >= self.min_dihedral
            && m.max_dihedral <= self.max_dihedral
            && m.joe_liu >= self.joe_liu
            && m.edge_ratio <= self.edge_ratio
    }

    /// The Joe–Liu measure from which on no tetrahedron has a larger edge ratio than `r`: `2r / (1 + r²)`,
    /// which one with a short edge and a long one across it reaches when its other four edges are equal.
    pub fn joe_liu_for_edge_ratio(r: f64) -> f64 {
        2.0 * r / (1.0 + r * r)
    }

    /// The value of [`quality`](crate::measure::metrics::quality) from which on angles and Joe–Liu are met.
    ///
    /// Each goal alone would do with less; the largest of the three decides. With the defaults that is the largest
    /// angle: sin 25° = 0.423, at which every dihedral angle lies within 25°…155° and Joe–Liu is at least 0.37, so that
    /// no edge ratio is above 6 either.
    ///
    /// ```
    /// use tet_quality::Goals;
    /// let goals = Goals::default();
    /// assert!((goals.objective() - 25f64.to_radians().sin()).abs() < 1e-12);
    /// assert!(goals.reserve().joe_liu > Goals::joe_liu_for_edge_ratio(goals.edge_ratio));
    /// ```
    pub fn objective(&self) -> f64 {
        self.min_dihedral
            .to_radians()
            .sin()
            .max((180.0 - self.max_dihedral).to_radians().sin())
            .max(SHAPE_WEIGHT * self.joe_liu)
    }
}

impl Goals {
    /// Goals that are met where [`objective`](Goals::objective) is reached, which is somewhat more than these goals: what
    /// the passes aim at, as a demand.
    pub fn reserve(&self) -> Self {
        let objective = self.objective();
        let angle = objective.asin().to_degrees();
        Self {
            min_dihedral: angle,
            max_dihedral: 180.0 - angle,
            joe_liu: (objective / SHAPE_WEIGHT).min(1.0),
            ..*self
        }
    }
}

impl Default for Goals {
    fn default() -> Self {
        Self {
            min_dihedral: 20.0,
            max_dihedral: 155.0,
            joe_liu: 0.3,
            edge_ratio: 6.0,
        }
    }
}

/// How the vertices of the surface move. Without an implicit field a surface vertex slides only where
/// the surface around it is plane, or with [`SurfaceMotion::AlongInput`].
///
/// With held vertices only the first two are allowed: see [`improve_part`](crate::improve_part).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum SurfaceMotion {
    /// Not at all.
    Fixed,
    /// Along the isosurface, where that improves the tetrahedra.
    #[default]
    Tangential,
    /// The thesis's averaged mean curvature flow before the first pass: it removes noise of the
    /// surface and nearly keeps its volume; then as [`SurfaceMotion::Tangential`].
    AveragedMeanCurvature {
        /// Number of steps.
        /// 5 to 20 are usual, with a `step` of 0.05: many more round off what is no noise.
        steps: u32,
        /// Size of a step, in squares of the spacing.
        /// Above 0 and at most 0.25: an explicit step, which a larger one makes unstable.
        step: f64,
    },
    /// Without a field: along the boundaries and interfaces of the input, where that improves the
    /// tetrahedra. They count as smooth where their triangles turn by less than 40° around a vertex;
    /// sharper edges and corners stay. [`Options::deviation`] is the distance from the input's triangles.
    AlongInput,
}

/// Which topological operations may be used.
///
/// All are on by default. Without any, smoothing alone is left, which keeps numbers and connections of vertices and
/// gets stuck where connections are wrong.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Operations {
    /// Removal of interior edges (3-2, 4-4 and longer links) and its inverse for one face (2-3).
    /// It never changes a surface. Edges with more than 8 tetrahedra around them stay.
    pub swap: bool,
    /// Flips of surface edges: the surface changes within the allowed deviation.
    /// Without a field or [`SurfaceMotion::AlongInput`] only pairs of triangles in one plane flip, which keeps the
    /// shape exactly.
    pub flip: bool,
    /// Contraction of edges.
    /// The only one that takes vertices away: turn it off where each vertex must stay. From the second pass on, it is
    /// tried where nothing else helps or smoothing follows.
    pub contract: bool,
    /// Insertion of vertices.
    /// Edges are split, inner ones and those on the isosurface, in the later passes.
    pub insert: bool,
}

impl Default for Operations {
    fn default() -> Self {
        Self {
            swap: true,
            flip: true,
            contract: true,
            insert: true,
        }
    }
}

/// Options of [`improve`](crate::improve).
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Options {
    /// What every tetrahedron should reach.
    pub goals: Goals,
    /// The budget: most passes of smoothing and operations. With 0 the mesh is only oriented, untangled and flowed, where
    /// that is due. Walls that have to be parted take up to three more at a time.
    /// The first three work on all below 30° and bring most of the gain; from the seventh on search directions are
    /// random and surface vertices may use the whole deviation; from the ninth on the last few get the longest
    /// searches.
    pub passes: u32,
    /// Value of the implicit field on the surface.
    pub level: f64,
    /// The length against which deviations count, Å: the spacing of the lattice that the mesh came
    /// from. `None`: the median length of the edges at surface vertices.
    /// Where no vertex is of kind `Surface`, all edges count.
    pub spacing: Option<f64>,
    /// Largest distance of a surface vertex from the isosurface (or the input's), in spacings. Vertices that lie
    /// farther in the input come closer as far as the tetrahedra allow.
    /// Smaller is truer to the surface and leaves more tetrahedra below the goals where it is rough; 0.1 by default,
    /// within 0…1. One surface vertex in 2,000 may stay farther before another pass is made for it.
    pub deviation: f64,
    /// How surface vertices move.
    pub surface: SurfaceMotion,
    /// Which topological operations may be used.
    pub operations: Operations,
    /// Watch every step that it lets no more parts of the boundary pass through each other where the gap between them is
    /// not meshed. Without this, walls of gaps narrower than a spacing may do so, and are parted after the passes, which
    /// takes far less time. For meshes in which [`Crossings::after`](crate::Crossings::after) is not 0.
    pub keep_apart: bool,
    /// Try to turn inverted tetrahedra first.
    /// If off, any inverted or flat tetrahedron is [`Error::StillInverted`](crate::Error::StillInverted).
    pub untangle: bool,
    /// Seed of the random search directions of the last passes.
    /// The same seed, mesh and backend give the same bits; another one is worth a try for a last element that is left.
    pub seed: u64,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            goals: Goals::default(),
            passes: 14,
            level: 1.0,
            spacing: None,
            deviation: 0.1,
            surface: SurfaceMotion::default(),
            operations: Operations::default(),
            keep_apart: false,
            untangle: true,
            seed: 1,
        }
    }
}

impl Options {
    /// Refuses values out of range.
    ///
    /// # Errors
    ///
    /// [`OutOfRange`] with the path of the first field that is out of range (`goals.joe_liu`, `surface.step`, …), its
    /// value and its range. Values that are not numbers are out of every range.
    pub fn check(&self) -> Result<(), OutOfRange> {
        let g = &self.goals;
        require(
            (0.0..=70.0).contains(&g.min_dihedral),
            "goals.min_dihedral",
            g.min_dihedral,
            "be within 0…70 degrees",
        )?;
        require(
            (75.0..=180.0).contains(&g.max_dihedral),
            "goals.max_dihedral",
            g.max_dihedral,
            "be within 75…180 degrees",
        )?;
        require(
            (0.0..=1.0).contains(&g.joe_liu),
            "goals.joe_liu",
            g.joe_liu,
            "be within 0…1",
        )?;
        require(
            g.edge_ratio > 1.0,
            "goals.edge_ratio",
            g.edge_ratio,
            "be above 1",
        )?;
        require(self.level.is_finite(), "level", self.level, "be finite")?;
        if let Some(h) = self.spacing {
            let length = h > 0.0 && h.is_finite();
            require(length, "spacing", h, "be above 0 and finite")?;
        }
        require(
            (0.0..=1.0).contains(&self.deviation),
            "deviation",
            self.deviation,
            "be within 0…1 spacings",
        )?;
        if let SurfaceMotion::AveragedMeanCurvature { step, .. } = self.surface {
            let stable = step > 0.0 && step <= 0.25;
            require(stable, "surface.step", step, "be above 0 and at most 0.25")?;
        }
        Ok(())
    }
}
