//! Where edges cross interfaces, and the surface near a point.
//!
//! On an edge of the lattice the values change sign between the ends; where, is known to first order from the two values. With a
//! field at hand the crossing is sharpened on it, by a root search that never leaves the edge. Between materials there is no
//! level: their boundary is a shape, and the crossing is found by bisection of its depth.

use geom_core::compute::{BackendError, parallel};
use geom_core::field::{
    End, Guard, Precision, Projection, Tangent, crossing, crossings, in_batches, project,
    projections,
};
use geom_core::mesh::{INTERIOR, Region};
use geom_core::{FieldAtMany, ImplicitField, Point3, Vector3};

use crate::complex::cube::{APEX, MIDDLE};
use crate::complex::{Complex, Corner, Split};
use crate::kernel::INSET;
use crate::octree::{Samples, along, corner_of, exact, local};
use crate::{Options, Placement};

/// How near to a crossing of a field, as a share of the edge.
const CROSSING: Precision = Precision {
    place: 1e-4,
    value: 0.0,
};
/// How near to the surface a dual vertex goes by Newton steps, as a share of its cell; one more, to first order,
/// leaves less than a millionth.
const NEAR: f64 = 1e-3;
/// The cell itself holds the steps: they are clamped to it, taken as they are, and the best place is kept.
const NEWTON: Guard = Guard {
    steps: 10,
    halvings: 0,
    longest: f64::INFINITY,
    reach: f64::INFINITY,
    near: NEAR,
};

/// How far the walls that hold points are bulged, in halves of [`INSET`]: far beyond rounding, and nothing to be seen.
const BULGE: f64 = 0.1;
/// Crossings nearer than this to an end of their edge, as a share of it, are squeezed into the farther half of that.
const END: f64 = 0.02;
/// How near to the sides of its cell a dual vertex may go at which three regions meet, as a share of the cell.
const JUNCTION_INSET: f64 = 0.3;

/// A box-shaped cell: its lowest corner and its edge, in finest cells.
///
/// What is searched for in it is seen from that corner, and comes out as an [`exact`] number of cells: so the same
/// place is found wherever the domain begins.
#[derive(Clone, Copy)]
pub(super) struct Room {
    pub(super) low: [i32; 3],
    pub(super) size: f64,
}

impl Room {
    /// A point of the domain as seen from the lowest corner.
    pub(super) fn relative(&self, x: &Point3) -> Point3 {
        Point3::from(x - local(self.low))
    }

    /// A point of the cell among those of the domain.
    pub(super) fn in_domain(&self, x: &Point3) -> Point3 {
        local(self.low) + x.coords.map(exact)
    }

    /// A point of the isosurface, held off walls that are slightly bulged outwards; what is farther than two insets stays.
    /// Off plane walls, neighbours that are held would be exactly in one plane, and so would triangles between them: a
    /// surface to which programs without a rule for such ties say that it crosses itself. It is continuous, so that what
    /// differs by rounding does so afterwards.
    pub(super) fn off_bulged_walls(&self, x: Point3) -> Point3 {
        let inset = INSET * self.size;
        let x = self.clamp(x);
        let off_middle = x.coords.map(|c| (c / self.size - 0.5).powi(2));
        let held = |k: usize| {
            let bulge = BULGE * inset * (0.5 - (off_middle.sum() - off_middle[k]));
            let shift = |distance: f64| bulge * (2.0 - distance / inset).max(0.0);
            x[k] - shift(x[k]) + shift(self.size - x[k])
        };
        Point3::from([0, 1, 2].map(held))
    }

    /// The nearest point of the cell that is off its sides.
    fn clamp(&self, x: Point3) -> Point3 {
        let inset = INSET * self.size;
        x.map(|c| c.clamp(inset, self.size - inset))
    }

    /// The point farthest on the way from one point of the cell to another that is well off its sides: it may not move
    /// any more, whatever the shape of what stands on it.
    fn towards(&self, from: Point3, to: Point3) -> Point3 {
        let side = JUNCTION_INSET * self.size;
        let share = (0..3).map(|k| {
            let (low, high) = (from[k].min(side), from[k].max(self.size - side));
            let (a, b) = (from[k], to[k]);
            if b < low {
                (a - low) / (a - b)
            } else if b > high {
                (high - a) / (b - a)
            } else {
                1.0
            }
        });
        from + (to - from) * share.fold(1.0, f64::min)
    }

    /// How near is near enough is a share of the cell's size.
    fn guard(&self) -> Guard {
        Guard {
            near: NEAR * self.size,
            ..NEWTON
        }
    }

    /// The dual vertex at the end of a way to the surface.
    /// Near enough, one more step to first order; not near enough within the steps, the best point that was seen.
    fn end_of(&self, found: &Projection) -> Point3 {
        self.off_bulged_walls(if found.end == End::Near {
            found.best.foot()
        } else {
            found.best.at
        })
    }
}

/// Where the way to a dual vertex begins.
pub(super) enum Start {
    /// At its end.
    There(Point3),
    /// At a point from which Newton steps follow.
    From(Point3),
}

/// Finds where edges cross interfaces, and the surface near a point.
/// Without a field the surface is that of the values: linear on edges, trilinear in cells.
pub(crate) struct Probe<'a> {
    pub(crate) samples: &'a Samples<'a>,
    pub(crate) field: Option<&'a dyn ImplicitField>,
    pub(crate) placement: Placement,
}

/// A corner as crossings see it: position in finest cells, label, value.
#[derive(Clone, Copy)]
pub(crate) struct Sample {
    pub(crate) x: Point3,
    pub(crate) label: Region,
    pub(crate) value: f64,
}

impl Sample {
    /// A lattice point, labelled as the caller sees it.
    pub(crate) fn at(samples: &Samples<'_>, p: [i32; 3], label: Region) -> Self {
        Self {
            x: local(p),
            label,
            value: samples.value(p),
        }
    }
}

impl<'a> Probe<'a> {
    pub(crate) fn new(
        samples: &'a Samples<'a>,
        field: Option<&'a dyn ImplicitField>,
        options: &Options,
    ) -> Self {
        Self {
            samples,
            field,
            placement: options.placement,
        }
    }

    /// Is the interface between two labels the level set?
    pub(crate) fn on_level(p: Region, q: Region) -> bool {
        p == INTERIOR || q == INTERIOR
    }

    /// The parameter in `[0, 1]` where the label changes between two corners: linear on the values,
    /// by bisection on the shapes.
    /// From `a` to `b`; the middle where the values say nothing. Thirty bisections leave a billionth of the edge.
    pub(crate) fn crossing(&self, a: &Sample, b: &Sample) -> f64 {
        let level = self.samples.labels.level;
        if Self::on_level(a.label, b.label) {
            let t = (level - a.value) / (b.value - a.value);
            return if t.is_finite() {
                t.clamp(0.0, 1.0)
            } else {
                0.5
            };
        }
        let (mut low, mut high) = (0.0, 1.0);
        for _ in 0..30 {
            let t = 0.5 * (low + high);
            let x = self.samples.domain.world_from(&a.x, &((b.x - a.x) * t));
            if self.samples.labels.at(f64::NEG_INFINITY, &x) == a.label {
                low = t;
            } else {
                high = t;
            }
        }
        0.5 * (low + high)
    }

    /// Like [`Probe::crossing`], sharpened on the field if there is one.
    /// The lattice values say on which side the ends are, whatever the field has there.
    pub(crate) fn exact_crossing(&self, a: &Sample, b: &Sample) -> f64 {
        let Some(field) = self.field.filter(|_| Self::on_level(a.label, b.label)) else {
            return self.crossing(a, b);
        };
        let level = self.samples.labels.level;
        let ends = [a.value - level, b.value - level];
        crossing(ends, CROSSING, |t| {
            let x = self.samples.domain.world_from(&a.x, &((b.x - a.x) * t));
            field.value(&x) - level
        })
    }

    /// Where the label changes on each of some edges, as [`Probe::exact_crossing`] has it.
    /// One per edge, in order.
    ///
    /// # Errors
    /// What a field on a device says; single points cannot fail.
    pub(crate) fn exact_crossings(
        &self,
        ends: &[(&Sample, &Sample)],
    ) -> Result<Vec<f64>, BackendError> {
        match self.field.and_then(|field| field.at_many()) {
            Some(field) => in_batches(field, ends.len(), |some| {
                self.crossings_at_once(field, &ends[some])
            }),
            None => Ok(parallel::map_each(ends, |(a, b)| self.exact_crossing(a, b))),
        }
    }

    /// The same from a field that is asked for all edges at a time.
    fn crossings_at_once(
        &self,
        field: &dyn FieldAtMany,
        ends: &[(&Sample, &Sample)],
    ) -> Result<Vec<f64>, BackendError> {
        let (domain, level) = (&self.samples.domain, self.samples.labels.level);
        let mut found: Vec<f64> = ends.iter().map(|(a, b)| self.crossing(a, b)).collect();
        let on_level: Vec<usize> = (0..ends.len())
            .filter(|&i| Self::on_level(ends[i].0.label, ends[i].1.label))
            .collect();
        let heights = |&i: &usize| [ends[i].0.value - level, ends[i].1.value - level];
        let heights: Vec<[f64; 2]> = on_level.iter().map(heights).collect();
        let (mut points, mut answers) = (Vec::new(), Vec::new());
        let sharpened = crossings(&heights, CROSSING, |asked, values| {
            points.clear();
            points.extend(asked.iter().map(|&(i, t)| {
                let (a, b) = ends[on_level[i]];
                domain.world_from(&a.x, &((b.x - a.x) * t))
            }));
            field.values(&points, &mut answers)?;
            values.extend(answers.iter().map(|value| value - level));
            Ok::<(), BackendError>(())
        })?;
        for (&i, t) in on_level.iter().zip(sharpened) {
            found[i] = t;
        }
        Ok(found)
    }

    /// The point where an edge is cut, away from its ends.
    /// By a twentieth of the edge at least, so that no tetrahedron that it cuts is flat.
    pub(crate) fn cut(&self, a: &Sample, b: &Sample) -> Point3 {
        along(a.x, b.x, self.exact_crossing(a, b).clamp(0.05, 0.95))
    }

    /// The field at a point (Å) of the box of the given values, if there is one.
    pub(crate) fn value(&self, x: &Point3) -> Option<f64> {
        self.field
            .filter(|_| self.samples.bounds.contains(x))
            .map(|f| f.value(x))
    }

    /// The field against the level at a point of a cell, in finest cells; without a field that of the values.
    /// `None` without a field where the cell's block has no values.
    fn tangent(&self, cell: &Room, at: Point3) -> Option<Tangent> {
        let (domain, level) = (&self.samples.domain, self.samples.labels.level);
        let (value, gradient) = match self.field {
            Some(field) => {
                let x = domain.world_from(&local(cell.low), &at.coords);
                let (v, g) = field.value_gradient(&x);
                (v, g * domain.spacing)
            }
            None => self.samples.trilinear(cell.low, &at.coords)?,
        };
        Some(Tangent {
            at,
            height: value - level,
            gradient,
        })
    }

    /// The dual vertex of a box-shaped cell from its crossings; all of them as seen from its lowest corner.
    pub(super) fn place(&self, cell: &Room, crossings: &[(Point3, bool)]) -> Point3 {
        match self.start(cell, crossings) {
            Start::There(x) => x,
            Start::From(x) => self.sink(cell, x),
        }
    }

    /// Where the way to the dual vertex of a cell begins.
    pub(super) fn start(&self, cell: &Room, crossings: &[(Point3, bool)]) -> Start {
        let n = crossings.len() as f64;
        let all = crossings.iter().map(|c| c.0.coords);
        let mass = Point3::from(all.sum::<Vector3>() / n);
        if self.placement == Placement::Mass {
            Start::There(cell.off_bulged_walls(mass))
        } else if crossings.iter().all(|c| !c.1) {
            Start::There(self.wall(cell, mass))
        } else if crossings.iter().any(|c| !c.1) {
            let junction = self.junction(cell, mass, crossings);
            Start::There(junction.unwrap_or_else(|| cell.clamp(mass)))
        } else if self.placement == Placement::Qef {
            Start::There(cell.off_bulged_walls(self.nearest_to_planes(cell, &mass, crossings)))
        } else {
            Start::From(cell.clamp(mass))
        }
    }

    /// The nearest boundary of a material to a point of a cell, within it.
    /// Two steps along its normal: the first is exact for planes, balls and cylinders, off their edges.
    fn wall(&self, cell: &Room, from: Point3) -> Point3 {
        let (domain, labels) = (&self.samples.domain, &self.samples.labels);
        let world = |x: &Point3| domain.world_from(&local(cell.low), &x.coords);
        let label = labels.at(f64::NEG_INFINITY, &world(&from));
        let depth = |x: &Point3| labels.depth(label, &world(x)) / domain.spacing;
        let mut x = cell.clamp(from);
        for _ in 0..2 {
            let normal = depth_gradient(depth, &x).try_normalize(0.5);
            x = normal.map_or(x, |n| cell.clamp(x - n * depth(&x)));
        }
        x
    }

    /// Where the boundary of two materials meets the surface in a cell: by Newton steps of least length onto both. `None`
    /// where they hardly cross, or the surface is not known.
    fn junction(&self, cell: &Room, mass: Point3, crossings: &[(Point3, bool)]) -> Option<Point3> {
        const STEPS: usize = 4;
        /// Least squared sine between the two.
        const CROSSED: f64 = 0.04;
        let (domain, labels) = (&self.samples.domain, &self.samples.labels);
        let walls = crossings.iter().filter(|c| !c.1).map(|c| c.0.coords);
        let wall = Point3::from(walls.clone().sum::<Vector3>() / walls.count() as f64);
        let world = |x: &Point3| domain.world_from(&local(cell.low), &x.coords);
        let label = labels.at(f64::NEG_INFINITY, &world(&wall));
        let depth = |x: &Point3| labels.depth(label, &world(x)) / domain.spacing;
        let mut x = cell.clamp(mass);
        for _ in 0..STEPS {
            let level = self.tangent(cell, x)?;
            let n = level.gradient.try_normalize(1e-12)?;
            let w = depth_gradient(depth, &x).try_normalize(0.5)?;
            let across = [-level.height / level.gradient.norm(), -depth(&x)];
            let (cos, sin2) = (n.dot(&w), 1.0 - n.dot(&w).powi(2));
            if sin2 < CROSSED {
                return None;
            }
            let along_n = (across[0] - cos * across[1]) / sin2;
            let along_w = (across[1] - cos * across[0]) / sin2;
            x = cell.clamp(x + n * along_n + w * along_w);
        }
        Some(cell.towards(mass, x))
    }

    /// From a point of a cell to the surface, within the cell.
    pub(super) fn sink(&self, cell: &Room, from: Point3) -> Point3 {
        let look = |x: Point3| self.tangent(cell, cell.clamp(x));
        match look(from) {
            Some(start) => cell.end_of(&project(start, &cell.guard(), look)),
            None => from,
        }
    }

    /// The same for finest cells, each from a point of it, by a field that is asked for all of them at a time.
    pub(super) fn sink_at_once(
        &self,
        field: &dyn FieldAtMany,
        from: &[(Room, Point3)],
    ) -> Result<Vec<Point3>, BackendError> {
        let (domain, level) = (&self.samples.domain, self.samples.labels.level);
        let mut answers = Vec::new();
        let mut look = |points: &[(Room, Point3)]| {
            let world = points
                .iter()
                .map(|(cell, x)| domain.world_from(&local(cell.low), &x.coords));
            field.values_gradients(&world.collect::<Vec<_>>(), &mut answers)?;
            let tangents = points
                .iter()
                .zip(&answers)
                .map(|(&(_, at), &(value, gradient))| Tangent {
                    at,
                    height: value - level,
                    gradient: gradient * domain.spacing,
                });
            Ok::<Vec<Tangent>, BackendError>(tangents.collect())
        };
        let starts = look(from)?;
        let Some(guard) = from.first().map(|(cell, _)| cell.guard()) else {
            return Ok(Vec::new());
        };
        let found = projections(&starts, &guard, |asked, out| {
            let held = asked.iter().map(|&(i, x)| (from[i].0, from[i].0.clamp(x)));
            out.extend(look(&held.collect::<Vec<_>>())?.into_iter().map(Some));
            Ok::<(), BackendError>(())
        })?;
        let ends = from.iter().zip(&found);
        Ok(ends.map(|((cell, _), found)| cell.end_of(found)).collect())
    }

    /// Minimizes the squared distances to the tangent planes at the crossings, relative to the mass
    /// point; directions in which the planes say less than a tenth of the most are left out.
    /// Planes are taken at the linear crossings, moved onto the level set to first order. By the eigenvectors of the 3
    /// × 3 normal matrix, not by a matrix inverse: on a flat piece two of the three directions are undetermined, and
    /// the mean decides in these.
    fn nearest_to_planes(
        &self,
        cell: &Room,
        mass: &Point3,
        crossings: &[(Point3, bool)],
    ) -> Point3 {
        let mut normal_matrix = geom_core::nalgebra::Matrix3::zeros();
        let mut right = Vector3::zeros();
        for (x, _) in crossings {
            let Some(here) = self.tangent(cell, *x) else {
                continue;
            };
            let Some(n) = here.gradient.try_normalize(1e-12) else {
                continue;
            };
            let offset = n.dot(&(x - mass)) - here.height / here.gradient.norm();
            normal_matrix += n * n.transpose();
            right += n * offset;
        }
        let eigen = geom_core::nalgebra::SymmetricEigen::new(normal_matrix);
        let most = eigen.eigenvalues.max();
        if most <= 0.0 {
            return *mass;
        }
        let mut x = *mass;
        for k in 0..3 {
            // Eigenvalues are squares of the singular values.
            if eigen.eigenvalues[k] > 0.01 * most {
                let direction = eigen.eigenvectors.column(k).into_owned();
                x += direction * (direction.dot(&right) / eigen.eigenvalues[k]);
            }
        }
        x
    }
}

/// The gradient of a depth at a point, both in cells, by central differences: exact beside plane faces.
pub(crate) fn depth_gradient(depth: impl Fn(&Point3) -> f64, x: &Point3) -> Vector3 {
    const APART: f64 = 1e-4;
    Vector3::from_fn(|k, _| {
        let d = Vector3::ith(k, APART);
        (depth(&(x + d)) - depth(&(x - d))) / (2.0 * APART)
    })
}

/// Label, value and position of a corner.
pub(crate) fn sample_corner(complex: &Complex<'_>, corner: Corner, label: Region) -> Sample {
    match corner {
        Corner::Point(p) => Sample::at(complex.samples, p, label),
        Corner::Centre(k) => Sample {
            x: complex.corner_position(corner),
            label,
            value: complex.splits[k as usize].value,
        },
    }
}

/// The corners of a finest cell that is cut, and its middle.
pub(crate) fn cut_samples(
    samples: &Samples<'_>,
    o: [i32; 3],
    labels: &[Region; 8],
    split: &Split,
) -> [Sample; 9] {
    std::array::from_fn(|i| {
        if i == APEX {
            return Sample {
                x: MIDDLE + local(o).coords,
                label: split.label,
                value: split.value,
            };
        }
        let p = [0, 1, 2].map(|k| o[k] + corner_of(i)[k]);
        Sample::at(samples, p, labels[i])
    })
}

/// The mean of the crossings of a tetrahedron of a cut cell, away from its corners; `None` if it has
/// none.
pub(crate) fn part_point(
    probe: &Probe<'_>,
    split: &Split,
    corners: &[Sample; 9],
    part: usize,
) -> Option<Point3> {
    let [p, q, r] = split.triangle(part).map(|i| corners[i]);
    mean_of_crossings(probe, &[corners[APEX], p, q, r])
}

/// A crossing of the surface kept off the ends of its edge, so that no tetrahedron degenerates. Crossings that differ still
/// do: else those around one corner are in planes with each other (see [`Room::off_bulged_walls`]).
pub(crate) fn off_ends(crossing: f64) -> f64 {
    let off_first = |t: f64| if t < END { 0.5 * (END + t) } else { t };
    1.0 - off_first(1.0 - off_first(crossing))
}

/// Over all pairs of corners, which in a tetrahedron are its edges; each crossing off the ends of its edge. Seen from the
/// first corner, so that the mean does not depend on where the domain begins.
pub(super) fn mean_of_crossings(probe: &Probe<'_>, corners: &[Sample]) -> Option<Point3> {
    let first = corners.first()?.x;
    let (mut sum, mut n) = (Vector3::zeros(), 0.0);
    for (i, a) in corners.iter().enumerate() {
        for b in &corners[i + 1..] {
            if a.label != b.label {
                let t = off_ends(probe.crossing(a, b));
                sum += (a.x - first) + (b.x - a.x) * t;
                n += 1.0;
            }
        }
    }
    (n > 0.0).then(|| first + (sum / n).map(exact))
}
