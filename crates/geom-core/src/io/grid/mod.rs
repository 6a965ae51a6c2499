//! Grids from files of any format: MRC/CCP4 maps and OpenDX grids.
//!
//! ```no_run
//! # fn main() -> Result<(), geom_core::io::Error> {
//! use geom_core::io::grid;
//! let map = grid::read("emd_1234.map.gz")?.into_grid()?;
//! grid::save("copy.dx", &map)?;
//! # Ok(()) }
//! ```
//!
//! Both formats give a [`GridFile`], whose axes may run anyhow; [`GridFile::into_grid`] makes of it what the rest of
//! the house takes: cubes along x, y and z, f32, x fastest. The file's bytes are in memory beside its values while it
//! is read.

pub mod dx;
pub mod mrc;

use std::path::Path;

use crate::compute::parallel;

use crate::io::{Error, ErrorKind, MAX_BYTES, extension, read_bytes_up_to};
use crate::{Aabb, GridError, Lattice, LatticeValues, Point3, ScalarGrid, Vector3};

/// What every grid must have.
const SPANNING: &str = "a finite origin and three steps that span a volume";
/// Largest departure from a cubic lattice that still counts as one, at the far end of an axis, in
/// steps: what the few digits of headers leave uncertain.
const CUBIC: f64 = 0.01;

/// A resampled grid may have this many times the points of the file.
const MAX_GROWTH: u128 = 64;

/// Values on the lattice of a file: `origin + i · steps[0] + j · steps[1] + k · steps[2]`, the first
/// axis fastest. Its cells are parallelepipeds along any directions;
/// [`into_grid`](GridFile::into_grid) makes them cubes along x, y and z.
#[derive(Clone, Debug, PartialEq)]
pub struct GridFile {
    origin: Point3,
    steps: [Vector3; 3],
    counts: [usize; 3],
    values: Vec<f32>,
}

impl GridFile {
    /// Values, as many as points; finite, on a lattice that spans a volume.
    ///
    /// Fails with [`GridError::Length`], with [`ErrorKind::Expected`] for steps that are flat (a volume below 10⁻⁶ of
    /// that of right angles), and with [`GridError::NotFinite`], whose index is along the axes given.
    pub(super) fn new(
        origin: Point3,
        steps: [Vector3; 3],
        counts: [usize; 3],
        values: Vec<f32>,
    ) -> Result<Self, Error> {
        let points = counts.iter().map(|&n| n as u128).product();
        if values.len() as u128 != points {
            let values = values.len();
            return Err(GridError::Length { values, points }.into());
        }
        let lengths = steps.map(|s| s.norm());
        let volume = steps[0].cross(&steps[1]).dot(&steps[2]).abs();
        let proper = volume > 1e-6 * lengths.iter().product::<f64>()
            && lengths.iter().all(|l| l.is_finite() && *l > 0.0)
            && origin.iter().all(|c| c.is_finite());
        if !proper {
            let found = format!(
                "origin {origin}, steps {}, {}, {} Å long",
                lengths[0], lengths[1], lengths[2]
            );
            return Err(ErrorKind::expected(SPANNING, found).into());
        }
        match values.iter().position(|v| !v.is_finite()) {
            None => Ok(Self {
                origin,
                steps,
                counts,
                values,
            }),
            Some(i) => {
                let [n0, n1, _] = counts;
                let index = [i % n0, i / n0 % n1, i / (n0 * n1)];
                let value = values[i];
                Err(GridError::NotFinite { index, value }.into())
            }
        }
    }

    /// Point (0, 0, 0), Å.
    pub fn origin(&self) -> Point3 {
        self.origin
    }
    /// From a point to its next along each axis, Å.
    pub fn steps(&self) -> [Vector3; 3] {
        self.steps
    }
    /// Points per axis.
    pub fn counts(&self) -> [usize; 3] {
        self.counts
    }
    /// The values, first axis fastest.
    pub fn values(&self) -> &[f32] {
        &self.values
    }

    /// Do the points form a lattice of cubes along x, y and z, in whatever order of axes? The far end
    /// of each axis may be off by a hundredth of a step.
    pub fn is_cubic(&self) -> bool {
        self.cubic().is_some()
    }

    /// Per axis of the file the axis of space that it follows; and the spacing.
    fn cubic(&self) -> Option<([usize; 3], f64)> {
        let axis = self.steps.map(|s| s.iamax());
        let mut seen = [false; 3];
        for k in axis {
            seen[k] = true;
        }
        // Equal steps keep their last bit.
        let lengths = [0, 1, 2].map(|k| self.steps[k][axis[k]].abs());
        let spacing = match lengths {
            [a, b, c] if a == b && b == c => a,
            [a, b, c] => (a + b + c) / 3.0,
        };
        let fits = (0..3).all(|k| {
            let mut ideal = Vector3::zeros();
            ideal[axis[k]] = spacing.copysign(self.steps[k][axis[k]]);
            (self.steps[k] - ideal).norm() * self.counts[k] as f64 <= CUBIC * spacing
        });
        (seen == [true; 3] && fits).then_some((axis, spacing))
    }

    /// A grid on a cubic lattice along x, y and z: the same values if the file
    /// [has one](GridFile::is_cubic); else [resampled](GridFile::resampled) at the shortest step.
    ///
    /// A lattice of cubes whose axes are turned or run backwards is put in order without interpolation: values keep
    /// their bits.
    ///
    /// # Errors
    /// Those of [`GridFile::resampled`], if it comes to that.
    pub fn into_grid(self) -> Result<ScalarGrid, Error> {
        let Some((axis, spacing)) = self.cubic() else {
            let lengths = self.steps.map(|s| s.norm());
            return self.resampled(lengths.into_iter().fold(f64::INFINITY, f64::min));
        };
        let mut origin = self.origin;
        let mut counts = [0; 3];
        for k in 0..3 {
            counts[axis[k]] = self.counts[k];
            if self.steps[k][axis[k]] < 0.0 {
                origin += self.steps[k] * (self.counts[k] - 1) as f64;
            }
        }
        let lattice = Lattice {
            origin,
            spacing,
            counts,
        };
        let forward = self.steps.iter().all(|s| s.amax() == s.max());
        if axis == [0, 1, 2] && forward {
            return Ok(ScalarGrid::new(lattice, self.values)?);
        }
        // How far a step along x, y, z goes in the file, and where it starts.
        let stride = [1, self.counts[0], self.counts[0] * self.counts[1]];
        let mut from = 0;
        let mut along = [0isize; 3];
        for k in 0..3 {
            along[axis[k]] = stride[k] as isize;
            if self.steps[k][axis[k]] < 0.0 {
                from += stride[k] * (self.counts[k] - 1);
                along[axis[k]] = -along[axis[k]];
            }
        }
        let mut values = vec![0.0; self.values.len()];
        let [nx, ny, _] = counts;
        parallel::for_chunks(&mut values, nx.max(1), |row, out| {
            let (j, k) = ((row % ny) as isize, (row / ny) as isize);
            let start = from as isize + j * along[1] + k * along[2];
            for (i, value) in out.iter_mut().enumerate() {
                *value = self.values[(start + i as isize * along[0]) as usize];
            }
        });
        Ok(ScalarGrid::new(lattice, values)?)
    }

    /// A grid on the cubic lattice of this spacing that covers the file's points, by trilinear
    /// interpolation between them; beyond the outermost points, in the corners of the box around a
    /// skew lattice, the value at the nearest point along the lattice's axes.
    ///
    /// A spacing above the steps leaves out what lies between points; nothing is averaged, so smooth a map before it is
    /// made coarser. O(points of the result), in parallel.
    ///
    /// # Errors
    /// [`GridError::Lattice`] for a spacing that is not positive and finite; [`ErrorKind::TooLarge`] beyond 64 times
    /// the points of the file, as a spacing in the wrong unit asks for; [`ErrorKind::Expected`] for steps so short or
    /// so long that their inverse does not exist in f64.
    pub fn resampled(&self, spacing: f64) -> Result<ScalarGrid, Error> {
        let last = self.counts.map(|n| n.saturating_sub(1) as f64);
        let corners: Vec<Point3> = (0..8)
            .map(|c| {
                let end = |k: usize| f64::from(c >> k & 1) * last[k];
                self.origin
                    + self.steps[0] * end(0)
                    + self.steps[1] * end(1)
                    + self.steps[2] * end(2)
            })
            .collect();
        if !(spacing.is_finite() && spacing > 0.0) {
            return Err(GridError::Lattice { spacing }.into());
        }
        let mut lattice = Lattice::covering(&Aabb::of_points(&corners), spacing);
        for k in 0..3 {
            // No further layer for the last digits of a length.
            let extent = Aabb::of_points(&corners).extent()[k] / spacing;
            if extent - extent.floor() < CUBIC {
                lattice.counts[k] = (extent as usize).saturating_add(1);
            }
        }
        if self.values.is_empty() || lattice.points() > MAX_GROWTH * self.values.len() as u128 {
            let kind = ErrorKind::TooLarge(format!(
                "{} points in cubes of {spacing} Å for the {} of the file: choose a larger spacing",
                lattice.points(),
                self.values.len()
            ));
            return Err(kind.into());
        }
        let to_axes = nalgebra::Matrix3::from_columns(&self.steps)
            .try_inverse()
            .ok_or_else(|| ErrorKind::expected(SPANNING, "steps too short or too long"))?;
        let mut values = vec![0.0; lattice.len()];
        let [nx, ny, _] = lattice.counts;
        parallel::for_chunks(&mut values, nx, |row, out| {
            for (i, value) in out.iter_mut().enumerate() {
                let p = lattice.point([i, row % ny, row / ny]);
                *value = self.between(to_axes * (p - self.origin)) as f32;
            }
        });
        Ok(ScalarGrid::new(lattice, values)?)
    }

    /// Trilinear interpolation at a place in steps from the origin.
    ///
    /// Corners of weight 0 are not added: at whole steps a value comes back with its bits.
    fn between(&self, local: Vector3) -> f64 {
        let mut base = [0; 3];
        let mut t = [0.0; 3];
        for k in 0..3 {
            let last = self.counts[k] - 1;
            let clamped = local[k].clamp(0.0, last as f64);
            base[k] = (clamped as usize).min(last.saturating_sub(1));
            t[k] = clamped - base[k] as f64;
        }
        let at = |[i, j, k]: [usize; 3]| {
            f64::from(self.values[(k * self.counts[1] + j) * self.counts[0] + i])
        };
        (0..8usize)
            .map(|c| {
                let bit = [c & 1, c >> 1 & 1, c >> 2];
                let weight: f64 = (0..3)
                    .map(|k| if bit[k] == 1 { t[k] } else { 1.0 - t[k] })
                    .product();
                let point = [0, 1, 2].map(|k| (base[k] + bit[k]).min(self.counts[k] - 1));
                if weight == 0.0 {
                    0.0
                } else {
                    weight * at(point)
                }
            })
            .sum()
    }
}

/// Reads a grid; the format is told by the content, or else by the name.
///
/// # Errors
/// Those of [`read_up_to`].
pub fn read(path: impl AsRef<Path>) -> Result<GridFile, Error> {
    read_up_to(path, MAX_BYTES)
}

/// [`read`] for a file of at most so many bytes, unpacked.
///
/// # Errors
/// All name the file: those of [`read_bytes_up_to`], and of [`parse`].
pub fn read_up_to(path: impl AsRef<Path>, max_bytes: u64) -> Result<GridFile, Error> {
    let path = path.as_ref();
    let bytes = read_bytes_up_to(path, max_bytes)?;
    parse(&bytes, &extension(path)).map_err(|e| e.in_file(path))
}

/// A grid from the bytes of a file of any format; `extension` (as `map`) decides where the content
/// does not.
///
/// MRC maps have `MAP` at byte 208; older ones have not, and need one of the endings `mrc`, `map`, `ccp4` or `rec`.
/// OpenDX grids begin with `object` after comments. Gzip is not unpacked here.
///
/// # Errors
/// [`ErrorKind::Empty`], [`ErrorKind::Unsupported`] if neither content nor extension tell, else those of the format's
/// reader.
pub fn parse(bytes: &[u8], extension: &str) -> Result<GridFile, Error> {
    if bytes.is_empty() {
        return Err(ErrorKind::Empty.into());
    }
    if bytes.get(208..211) == Some(b"MAP") {
        return mrc::parse(bytes);
    }
    match extension {
        "dx" => dx::parse(bytes),
        "mrc" | "map" | "ccp4" | "rec" => mrc::parse(bytes),
        _ => match dx::looks_like(bytes) {
            true => dx::parse(bytes),
            false => Err(unknown()),
        },
    }
}

/// Writes a grid to a file whole or not at all, in the format of the name's ending: `mrc`, `map` or
/// `ccp4` (f32), `dx`.
///
/// A sparse grid is written as a dense one. MRC keeps the values' bits and rounds lengths to f32; text keeps all.
///
/// # Errors
/// [`ErrorKind::Unsupported`] for any other ending; those of the format's writer and of [`crate::io::save`].
pub fn save(path: impl AsRef<Path>, grid: &(impl LatticeValues + ?Sized)) -> Result<(), Error> {
    let path = path.as_ref();
    match extension(path).as_str() {
        "mrc" | "map" | "ccp4" => mrc::save(path, grid, mrc::Mode::default()),
        "dx" => dx::save(path, grid),
        _ => Err(unknown().in_file(path)),
    }
}

fn unknown() -> Error {
    let what = "no grid format is known by this name; .mrc, .map, .ccp4 and .dx are";
    ErrorKind::Unsupported(what.to_owned()).into()
}
