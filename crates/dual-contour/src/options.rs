//! What to compute.
//!
//! The fields of [`Options`] are independent of each other but for those that [`Options::check`] and the verbs refuse
//! together: each such error names the field to change.

use geom_core::mesh::{EXTERIOR, INTERIOR, OUTSIDE, Region};
use geom_core::options::{OutOfRange, require};
use geom_core::{Aabb, Point3, Vector3};

/// What to mesh and how finely. The defaults mesh the molecule of a density whose surface has the
/// value 1 with cells of the lattice's own spacing at the surface.
///
/// A membrane of 30 Å across z with a ball of water in it, around whatever the molecule is; the numbers of regions arrive in
/// [`TetMesh::regions`](geom_core::TetMesh::regions):
///
/// ```
/// use dual_contour::geom_core::{Aabb, Cpu, Point3, Run, Vector3};
/// use dual_contour::{Extent, FieldSamples, Material, Options, Shape, volume};
/// # use dual_contour::geom_core::ImplicitField;
/// # struct Ball;
/// # impl ImplicitField for Ball {
/// #     fn value(&self, x: &Point3) -> f64 {
/// #         9.0 - x.coords.norm()
/// #     }
/// #     fn value_gradient(&self, x: &Point3) -> (f64, Vector3) {
/// #         (self.value(x), -x.coords.normalize())
/// #     }
/// # }
/// // The field `Ball` has the value 1 on a sphere of radius 8 Å.
/// let bounds = Aabb::new(Point3::from(Vector3::repeat(-24.0)), Point3::from(Vector3::repeat(24.0)));
/// let values = FieldSamples::new(&Ball, &bounds, 2.0);
/// let water = Shape::Sphere { center: Point3::new(16.0, 0.0, 0.0), radius: 5.0 };
/// let membrane = Shape::Slab { normal: Vector3::z(), low: -15.0, high: 15.0 };
/// let options = Options {
///     region: Extent::Both,
///     // Of two that hold a point the first counts: the water is cut out of the membrane.
///     materials: vec![
///         Material { region: 2, shape: water },
///         Material { region: 3, shape: membrane },
///     ],
///     ..Options::default()
/// };
/// let made = volume(&values, Some(&Ball), &options, Run::on(&Cpu))?;
/// for region in [0, 1, 2, 3] {
///     assert!(made.mesh.region_volume(region) > 0.0);
/// }
/// # Ok::<(), dual_contour::Error>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(default, deny_unknown_fields))]
pub struct Options {
    /// Isovalue c of `G(x) = c`; a point is inside if its value is at least this. Densities of this workspace have their surface
    /// at 1.
    /// Values below it in the box and everything beyond the box are outside.
    pub level: f64,
    /// Which mesher.
    pub method: Method,
    /// Size of the finest cells.
    pub resolution: Resolution,
    /// Cells at the surface are split while their feature-sensitive error (Å, Zhang & Bajaj 2005) is
    /// larger than this; 0 splits all of them down to the finest size.
    /// The error is a sum over 19 points of a cell, so it is several times the distance by which the surface is off. In
    /// a trial with a protein half a spacing left nearly the uniform mesh, 1.5 spacings some 70 % of its tetrahedra and
    /// 4 spacings a quarter, then with 99 % of the triangles within 0.4 spacings of the surface.
    pub tolerance: f64,
    /// How the 19 terms of the feature-sensitive error are put together.
    pub error_norm: ErrorNorm,
    /// Balls in which another tolerance holds, e.g. around the atoms of an emphasized chain. The
    /// smallest tolerance of all balls that a cell meets is taken.
    /// A ball can only refine: where its tolerance is larger than that of the whole, it does nothing.
    pub zones: Vec<Zone>,
    /// Largest cell, Å; infinite leaves the size away from the surface to the balance alone.
    /// Sizes are the finest cell times a power of two, so it is rounded down to one of these; below two finest cells
    /// all cells are finest, and what is meshed takes twelve tetrahedra for each of them.
    #[cfg_attr(
        feature = "serde",
        serde(deserialize_with = "geom_core::options::or_infinite")
    )]
    pub max_cell: f64,
    /// Where a dual vertex goes within its cell.
    pub placement: Placement,
    /// What happens where the surface meets the box of the lattice.
    pub at_box: AtBox,
    /// Materials other than the molecule (region 1), by decreasing priority: a point that is not
    /// inside of the molecule belongs to the first that holds it, else to the exterior (region 0).
    /// Refused where the exterior is not meshed.
    pub materials: Vec<Material>,
    /// Connected groups of fewer lattice points than this on one side of the level are given to the
    /// other side before meshing; 0 keeps all, and more than all points there are is an error.
    /// Densities whose atoms the lattice hardly resolves have specks and bubbles of a few points: 8 takes most of these
    /// away. What is given away is counted in the [`Report`](crate::Report).
    pub prune: u32,
    /// Volumes: which regions are meshed.
    /// The surface of the molecule is the same in any case.
    pub region: Extent,
    /// Volumes: where an exterior mesh ends.
    pub outer: Outer,
    /// Volumes: gives each connected part of the exterior but the largest a region number of its own
    /// (the lowest unused ones).
    /// A membrane parts the exterior into two, of which the smaller gets a number; a closed cavity is a part too.
    /// [`Volume::names`](crate::Volume::names) has their names.
    pub separate_exterior: bool,
    /// Largest estimated working memory, bytes. What would need more is [`Error::TooLarge`](crate::Error::TooLarge), with the
    /// estimate and what would help, before anything is allocated.
    /// The estimates are right within a factor of about two, and know nothing of the values that are given. 16 GiB by
    /// default.
    pub max_memory: u64,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            level: 1.0,
            method: Method::DualContour,
            resolution: Resolution::Lattice,
            tolerance: 0.0,
            error_norm: ErrorNorm::Sum,
            zones: Vec::new(),
            max_cell: f64::INFINITY,
            placement: Placement::Newton,
            at_box: AtBox::Refuse,
            materials: Vec::new(),
            prune: 0,
            region: Extent::Interior,
            outer: Outer::Grid,
            separate_exterior: false,
            max_memory: 16 << 30,
        }
    }
}

/// A mesher.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Method {
    /// Dual contouring on the octree (thesis 3.3): may adapt on the surface. A vertex per cell with a surface; raw dihedral
    /// angles come close to 0°, so a solver wants what `tet_quality::improve` makes of them.
    #[default]
    DualContour,
    /// Isosurface stuffing on the same complex (Labelle & Shewchuk 2007): uniform on the surface,
    /// better angles. Half as many elements again, with dihedral angles between 6° and 161° before any improvement.
    #[cfg_attr(feature = "serde", serde(alias = "Lattice"))]
    Stuffing,
}

/// Size of the finest cells.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Resolution {
    /// The spacing of the values: nothing is resampled.
    #[default]
    Lattice,
    /// This length, Å. Values come from the field if one is given, else from the lattice
    /// (trilinear).
    /// At most 1e100: finer than the lattice it shows what the field has between its points, coarser it saves elements,
    /// and may lose what is smaller than a cell, which is an error only if nothing is left.
    Spacing(f64),
    /// The length that gives about this many tetrahedra (within a fifth).
    /// At least 1000. It is found by meshing, up to twelve times, from coarse to fine: where a spacing is known it is
    /// better given. A number that no spacing gives is an error that names the nearest one found.
    Tets(u64),
}

/// How the terms of the feature-sensitive error are put together.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum ErrorNorm {
    /// Their sum, as published.
    #[default]
    Sum,
    /// The largest.
    /// At most the sum and at least a nineteenth of it, so that the same tolerance leaves larger cells; nearer to a
    /// distance between surfaces.
    Max,
}

/// A ball with a tolerance of its own.
///
/// ```
/// use dual_contour::geom_core::{Aabb, Cpu, Point3, Run};
/// use dual_contour::{FieldSamples, Options, Zone, surface};
/// # use dual_contour::geom_core::{ImplicitField, Vector3};
/// # struct Ball;
/// # impl ImplicitField for Ball {
/// #     fn value(&self, x: &Point3) -> f64 {
/// #         4.0 - x.coords.norm()
/// #     }
/// #     fn value_gradient(&self, x: &Point3) -> (f64, Vector3) {
/// #         (self.value(x), -x.coords.normalize())
/// #     }
/// # }
/// // The field `Ball` has the value 1 on a sphere of radius 3 Å.
/// let bounds = Aabb::new(Point3::new(-4.0, -4.0, -4.0), Point3::new(4.0, 4.0, 4.0));
/// let values = FieldSamples::new(&Ball, &bounds, 0.25);
/// let triangles = |zones: Vec<Zone>| -> Result<usize, dual_contour::Error> {
///     let options = Options { tolerance: 0.5, zones, ..Options::default() };
///     let made = surface(&values, Some(&Ball), &options, Run::on(&Cpu))?;
///     Ok(made.mesh.triangles().len())
/// };
/// // Cells at the pole keep the size of the lattice's.
/// let pole = Zone { center: Point3::new(0.0, 0.0, 3.0), radius: 1.0, tolerance: 0.0 };
/// assert!(triangles(vec![pole])? > triangles(Vec::new())?);
/// # Ok::<(), dual_contour::Error>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Zone {
    /// Centre.
    pub center: Point3,
    /// Radius, Å.
    pub radius: f64,
    /// Tolerance inside, Å.
    /// 0 makes cells there finest.
    pub tolerance: f64,
}

/// Where a dual vertex goes within its cell.
///
/// Points are compared by how far they are from the level set: with cells of size h on a surface of curvature radius r, the
/// mean of crossings is off by up to about h²/8r, and Newton steps take most of that away.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Placement {
    /// The mean of the points where edges cross the surface (thesis).
    /// Cheapest, always inside of the cell, and smooth: noise of the values hardly shows. Balls come out smaller than
    /// they are.
    Mass,
    /// From there onto the surface, by Newton steps along the gradient.
    /// On a field to a thousandth of a cell; on values alone finest cells take four steps. Boundaries of materials are
    /// known everywhere; where two meet on the molecule, onto both. In cut cells the mean stays.
    #[default]
    Newton,
    /// The point nearest to all tangent planes at the crossings: for surfaces with creases.
    /// (The quadratic error function of Ju, Losasso, Schaefer and Warren 2002.) Directions in which the planes hardly
    /// say anything keep the mean. For boxes and the like; on smooth surfaces it gives no more than Newton steps do.
    Qef,
}

/// What happens where the surface meets the box of the lattice.
///
/// A closed surface cannot leave the box. Either that is a mistake of whoever sampled the density, with too small a margin,
/// or a part of a larger body is wanted and its cut faces have to be closed somehow.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum AtBox {
    /// An error: the density was sampled in too small a box.
    /// [`Error::SurfaceTouchesBox`](crate::Error::SurfaceTouchesBox) has the side and the number of points.
    #[default]
    Refuse,
    /// All beyond the box is exterior: the surface closes within one cell of it.
    /// It may thus lie up to a cell outside of the box, and the mesh of an exterior reaches to whole blocks around it.
    Cap,
    /// The mesh ends at the planes of the box; the surface is closed by pieces of them.
    /// Vertices there are kept on the box ([`VertexKind`](geom_core::mesh::VertexKind)), so that parts meshed side by
    /// side still fit after an improvement that respects them. Not with an outer box or sphere.
    Clip,
}

/// Which regions of a volume are meshed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Extent {
    /// The molecule.
    #[default]
    Interior,
    /// All but the molecule.
    /// The exterior with its parts, and the materials.
    Exterior,
    /// Everything, conforming across the interfaces.
    Both,
}

impl Extent {
    /// Is a region meshed? Nothing, beyond the outer sphere, never is.
    pub(crate) fn holds(self, region: Region) -> bool {
        match self {
            Self::Interior => region == INTERIOR,
            Self::Exterior => region != INTERIOR && region != OUTSIDE,
            Self::Both => region != OUTSIDE,
        }
    }
}

/// Where an exterior mesh ends.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Outer {
    /// At the box of the lattice, enlarged to whole octree blocks.
    /// Of 8 finest cells each; with [`AtBox::Clip`] at the box itself.
    #[default]
    Grid,
    /// At a cuboid: the lattice's box, scaled about its middle by at least this factor (≥ 1).
    Box {
        /// Factor on the edge lengths.
        scale: f64,
    },
    /// At a sphere about the middle of the lattice's box; its radius is this factor (≥ 1) times half
    /// the diagonal of the box.
    Sphere {
        /// Factor on the radius.
        scale: f64,
    },
}

/// A material beside the molecule.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Material {
    /// Its region number: not 0, 1 or 255.
    /// Two materials may have the same.
    pub region: Region,
    /// The space it fills.
    pub shape: Shape,
}

/// A simple closed set of points.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Shape {
    /// Between two planes, e.g. a membrane.
    Slab {
        /// Direction across; need not have unit length.
        normal: Vector3,
        /// Lowest coordinate along the unit normal, Å.
        low: f64,
        /// Highest coordinate along the unit normal, Å.
        high: f64,
    },
    /// A finite cylinder.
    Cylinder {
        /// Middle of one end.
        start: Point3,
        /// Middle of the other end.
        end: Point3,
        /// Radius, Å.
        radius: f64,
    },
    /// A ball.
    Sphere {
        /// Centre.
        center: Point3,
        /// Radius, Å.
        radius: f64,
    },
    /// An axis-aligned box.
    Cuboid(Aabb),
}

impl Shape {
    /// Depth of a point below the boundary, Å; negative outside. Changes by at most the distance
    /// between two points (1-Lipschitz), and is exact near the faces.
    ///
    /// A point belongs to the shape where this is not negative. Beyond edges and corners of a box or cylinder it is
    /// less than the distance in magnitude. Not a number for shapes that [`Options::check`] refuses: a slab without a
    /// direction, a cylinder without a length.
    pub fn depth(&self, x: &Point3) -> f64 {
        match *self {
            Self::Slab { normal, low, high } => {
                let z = x.coords.dot(&normal) / normal.norm();
                (z - low).min(high - z)
            }
            Self::Cylinder { start, end, radius } => {
                let axis = end - start;
                let length = axis.norm();
                let along = (x - start).dot(&axis) / length;
                let across = ((x - start) - axis * (along / length)).norm();
                (radius - across).min(along).min(length - along)
            }
            Self::Sphere { center, radius } => radius - (x - center).norm(),
            Self::Cuboid(b) => (0..3)
                .map(|k| (x[k] - b.min[k]).min(b.max[k] - x[k]))
                .fold(f64::INFINITY, f64::min),
        }
    }

    /// Is it finite, and does it hold points?
    fn is_sound(&self) -> bool {
        match *self {
            Self::Slab { normal, low, high } => {
                normal.norm().is_normal() && low < high && low.is_finite() && high.is_finite()
            }
            Self::Cylinder { start, end, radius } => {
                (end - start).norm().is_normal() && radius > 0.0 && radius.is_finite()
            }
            Self::Sphere { center, radius } => {
                center.iter().all(|c| c.is_finite()) && radius > 0.0 && radius.is_finite()
            }
            Self::Cuboid(b) => {
                b.min.iter().chain(b.max.iter()).all(|c| c.is_finite())
                    && (0..3).all(|k| b.min[k] < b.max[k])
            }
        }
    }
}

impl Material {
    fn check(&self) -> Result<(), OutOfRange> {
        require(
            ![EXTERIOR, INTERIOR, OUTSIDE].contains(&self.region),
            "materials",
            format!("a material of region {}", self.region),
            "have a region of its own, 2 … 254",
        )?;
        require(
            self.shape.is_sound(),
            "materials",
            format!("{:?}", self.shape),
            "hold points and be finite",
        )
    }
}

impl Zone {
    fn check(&self) -> Result<(), OutOfRange> {
        let numbers = [self.radius, self.tolerance];
        let sound = numbers.iter().all(|&v| v >= 0.0 && v.is_finite())
            && self.center.iter().all(|c| c.is_finite());
        require(
            sound,
            "zones",
            format!("{self:?}"),
            "have no number that is negative or not finite",
        )
    }
}

impl Resolution {
    fn check(&self) -> Result<(), OutOfRange> {
        match *self {
            Self::Lattice => Ok(()),
            Self::Spacing(h) => {
                let value = format!("{h} Å");
                require(
                    h > 0.0 && h.is_finite(),
                    "resolution",
                    &value,
                    "be a positive length",
                )?;
                // The volume of a cell must be a number.
                require(h <= 1e100, "resolution", value, "be at most 1e100 Å")
            }
            Self::Tets(n) => require(
                n >= 1000,
                "resolution",
                format!("{n} tetrahedra"),
                "ask for 1000 or more",
            ),
        }
    }
}

impl Outer {
    fn check(&self) -> Result<(), OutOfRange> {
        match *self {
            Self::Grid => Ok(()),
            Self::Box { scale } | Self::Sphere { scale } => require(
                (1.0..=100.0).contains(&scale),
                "outer",
                format!("scaled by {scale}"),
                "have a scale between 1 and 100",
            ),
        }
    }
}

impl Options {
    /// Refuses options that make no sense, and names the field. The verbs do so first of all.
    ///
    /// What depends on the values too, a level that they do not reach or cells that are too many, is found by the
    /// verbs.
    ///
    /// # Errors
    /// The first field out of range: a level that is not finite; a negative or infinite tolerance, also of a zone; a
    /// `max_cell` or spacing that is not positive; less than 1000 tetrahedra; a material of region 0, 1 or 255, or
    /// whose shape is empty or infinite; an outer scale that is not between 1 and 100; a tolerance or zones with
    /// [`Method::Stuffing`].
    ///
    /// ```
    /// use dual_contour::{Options, Resolution};
    /// let options = Options {
    ///     resolution: Resolution::Spacing(-0.5),
    ///     ..Options::default()
    /// };
    /// let error = options.check().unwrap_err();
    /// assert_eq!(error.to_string(), "option resolution is -0.5 Å; it must be a positive length");
    /// ```
    pub fn check(&self) -> Result<(), OutOfRange> {
        require(
            self.level.is_finite(),
            "level",
            self.level,
            "be a finite number",
        )?;
        self.resolution.check()?;
        require(
            self.tolerance >= 0.0 && self.tolerance.is_finite(),
            "tolerance",
            format!("{} Å", self.tolerance),
            "be 0 or a positive length",
        )?;
        self.zones.iter().try_for_each(Zone::check)?;
        require(
            self.max_cell > 0.0,
            "max_cell",
            format!("{} Å", self.max_cell),
            "be a positive length",
        )?;
        self.materials.iter().try_for_each(Material::check)?;
        self.outer.check()?;
        require(
            self.method != Method::Stuffing || self.has_one_size(),
            "tolerance",
            format!("{} Å, with {} zones", self.tolerance, self.zones.len()),
            "be 0, without zones, for isosurface stuffing, whose cells at the surface have one size; or take Method::DualContour",
        )
    }

    /// Have all cells at the surface of the molecule the finest size?
    pub(crate) fn has_one_size(&self) -> bool {
        self.tolerance == 0.0 && self.zones.is_empty()
    }
}
