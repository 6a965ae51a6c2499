//! The truncated hierarchical basis on a T-mesh, as a recursion over levels (Wei, Zhang, Hughes and Scott 2015, for
//! the construction on Catmull–Clark meshes).
//!
//! A vertex of the mesh of a level is a function of the basis if no coarser element lies within its two rings;
//! otherwise it stands for the combination of vertices of the next coarser level that subdivision makes of it. An
//! element is then a patch over the vertices of its own level. No knots are inferred and no T-junctions extended: the
//! functions are not negative, sum to one, and are those of the finest level where nothing is coarse.

use geom_core::compute::parallel;
use geom_core::{Point3, Vector3, VertexId};

use super::extraction::{Extraction, Patch, Rows};
use super::stars::{Ghosts, Mask, Star};
use crate::mesh::Block;
use crate::{Error, TMesh};

const NONE: u32 = u32::MAX;

/// A vertex of a level as a combination of functions.
type Row = Vec<(u32, f64)>;

/// The extraction of the truncated hierarchical basis, and where its control points start.
///
/// One patch per element, as no element is cut. From the coarsest level down: the rows of a level need those of the
/// level above only.
///
/// # Errors
/// [`Error::Ring`] where the blocks of an element's level do not reach far enough around it.
pub(super) fn extraction(mesh: &TMesh) -> Result<Extraction, Error> {
    let mut levels = Levels::new(mesh);
    let top = mesh.elements().iter().map(|e| e.level).max();
    for level in (0..=top.unwrap_or(0)).rev() {
        levels.descend(level)?;
    }
    let patches = parallel::map(mesh.elements().len(), |e| levels.rows(e));
    let whole = mesh
        .elements()
        .iter()
        .enumerate()
        .map(|(e, element)| Patch {
            element: e as u32,
            from: [0, 0],
            to: [element.size, element.size],
        });
    Ok(Extraction::new(
        whole.collect(),
        patches,
        (levels.controls, levels.origins),
        false,
    ))
}

/// One level of the recursion: what each vertex stands for.
struct Level {
    /// Per number the row of the vertex and its star, or NONE.
    row: Vec<u32>,
    star: Vec<u32>,
}

/// What grows as the recursion descends.
struct Levels<'a> {
    mesh: &'a TMesh,
    ghosts: Ghosts<'a>,
    /// From level 0 on; filled from the coarsest.
    levels: Vec<Level>,
    /// Of the vertices of all levels that anything was asked of.
    rows: Vec<Row>,
    /// Of the corners of elements, level by level.
    stars: Vec<Star>,
    /// Where each function's control point starts.
    controls: Vec<Point3>,
    /// Per function its level and the number of its vertex.
    origins: Vec<(u8, u32)>,
    /// What subdivision of the level above makes of the vertices of the level at hand.
    masks: Vec<Option<Mask>>,
}

impl<'a> Levels<'a> {
    fn new(mesh: &'a TMesh) -> Self {
        let ghosts = Ghosts::new(mesh);
        let masks = vec![None; ghosts.len()];
        Self {
            mesh,
            ghosts,
            levels: Vec::new(),
            rows: Vec::new(),
            stars: Vec::new(),
            controls: Vec::new(),
            origins: Vec::new(),
            masks,
        }
    }

    /// Rows and stars of the vertices that shape the elements of a level, and the masks of the level below.
    fn descend(&mut self, level: u8) -> Result<(), Error> {
        let numbers = self.ghosts.len();
        let (mut places, mut found) = (vec![None; numbers], Vec::new());
        let mut own = Level {
            row: vec![NONE; numbers],
            star: vec![NONE; numbers],
        };
        let first = self.stars.len();
        for element in self.mesh.elements().iter().filter(|e| e.level == level) {
            for corner in element.corners {
                let vertex = self.mesh.fine_of_vertex(corner as usize);
                if own.star[vertex as usize] == NONE {
                    own.star[vertex as usize] = self.stars.len() as u32;
                    let star = self.ghosts.star(level, vertex, &mut found)?;
                    self.stars.push(star);
                }
            }
        }
        for (ghost, at) in found {
            places[ghost as usize].get_or_insert(at);
        }
        for s in first..self.stars.len() {
            let mut vertices = vec![self.stars[s].vertex];
            let ring = self.stars[s].sectors.iter();
            vertices.extend(ring.flat_map(|sector| [sector.along, sector.diagonal]));
            for v in vertices {
                if own.row[v as usize] == NONE {
                    own.row[v as usize] = self.rows.len() as u32;
                    let row = self.row(level, v, &places);
                    self.rows.push(row);
                }
            }
        }
        self.masks.iter_mut().for_each(|mask| *mask = None);
        if level > 0 {
            for star in &self.stars[first..] {
                for (v, mask) in star.masks() {
                    self.masks[v as usize].get_or_insert(mask);
                }
            }
        }
        // In the end level l lies in place l.
        self.levels.insert(0, own);
        Ok(())
    }

    /// The row of a vertex of the level at hand; the last finished level is the one above.
    ///
    /// A vertex without a mask is out of reach of coarser elements, and a new function; others are sums of rows of the
    /// level above. That is what truncation comes to: of a coarse function only what finer ones have not taken over.
    fn row(&mut self, level: u8, v: u32, places: &[Option<Point3>]) -> Row {
        let Some(mask) = &self.masks[v as usize] else {
            let number = self.controls.len() as u32;
            let at = self.ghosts.real(v).map(|f| self.mesh.fine().positions()[f]);
            self.origins.push((level, v));
            self.controls
                .push(at.or(places[v as usize]).unwrap_or_default());
            return vec![(number, 1.0)];
        };
        let coarse = &self.levels[0].row;
        let mut row: Row = mask
            .iter()
            .flat_map(|&(w, x)| {
                let row = &self.rows[coarse[w as usize] as usize];
                row.iter().map(move |&(f, y)| (f, x * y))
            })
            .collect();
        merge(&mut row);
        row
    }

    /// The Bézier coefficients of the functions on an element.
    ///
    /// Each of its 16 Bézier points is a combination of vertices of its level, each vertex one of functions.
    fn rows(&self, e: usize) -> Rows {
        let element = &self.mesh.elements()[e];
        let level = &self.levels[usize::from(element.level)];
        let sides = block_of(self.mesh, e).sides;
        let mut points: [Mask; 16] = Default::default();
        for (k, corner) in element.corners.iter().enumerate() {
            let vertex = self.mesh.fine_of_vertex(*corner as usize);
            let star = &self.stars[level.star[vertex as usize] as usize];
            let own = star.sectors.iter().position(|s| s.from == Some(sides[k]));
            let own = own.expect("an element is a block around its corners");
            corner_points(star, own, k, &mut points);
        }
        let mut rows = Rows::default();
        for (b, point) in points.iter().enumerate() {
            for &(v, x) in point {
                for &(f, y) in &self.rows[level.row[v as usize] as usize] {
                    rows.add(f, b, x * y);
                }
            }
        }
        rows.sorted()
    }
}

/// The block that an element is.
pub(super) fn block_of(mesh: &TMesh, element: usize) -> &Block {
    let level = mesh.elements()[element].level;
    let quad = mesh.fine_quads(element)[0] as usize;
    let block = mesh.block_of(level, quad).expect("an element is a block");
    &mesh.blocks(level)[block as usize]
}

/// The four Bézier points of a patch near its corner `k`, which is in block `own` of the star: the one within the
/// block, those on the two sides (means of those on both sides of them), and the corner (mean of all).
///
/// At a vertex of four blocks this is the uniform bicubic B-spline, twice differentiable across all sides. At an
/// extraordinary vertex the patches still meet without a gap, as each point is computed alike by all who share it;
/// their tangent planes agree but for the sides that end there, where they differ by an angle that falls with the size
/// of elements.
pub(super) fn corner_points(star: &Star, own: usize, k: usize, points: &mut [Mask; 16]) {
    // Corner, on the side that leaves it, inside, on the side that arrives.
    const PLACES: [[usize; 4]; 4] = [[0, 1, 5, 4], [3, 7, 6, 2], [15, 14, 10, 11], [12, 8, 9, 13]];
    let n = star.valence();
    let [corner, leaving, inside, arriving] = PLACES[k];
    let mean = |blocks: &[usize]| -> Mask {
        let share = 1.0 / blocks.len() as f64;
        let of_all = blocks.iter().flat_map(|&i| star.face_point(i));
        of_all.map(|(v, x)| (v, x * share)).collect()
    };
    points[inside] = mean(&[own]);
    points[leaving] = mean(&[own, (own + n - 1) % n]);
    points[arriving] = mean(&[own, (own + 1) % n]);
    points[corner] = mean(&(0..n).collect::<Vec<_>>());
}

/// The control points of the basis of a mesh that was cut, for the surface of the one before: its own where functions are
/// the same, those that subdivision makes elsewhere.
pub(super) fn carried(
    mesh: &TMesh,
    before: &Extraction,
    controls: &[Point3],
    after: &Extraction,
) -> Result<Vec<Point3>, Error> {
    let ghosts = Ghosts::new(mesh);
    let top = mesh.top_level();
    let mut carried = Carried {
        known: vec![vec![None; ghosts.len()]; usize::from(top) + 1],
        mesh,
        ghosts,
    };
    for (&(level, v), p) in before.origins.iter().zip(controls) {
        carried.known[usize::from(level)][v as usize] = Some(*p);
    }
    let each = after.origins.iter();
    each.map(|&(level, v)| carried.value(level, v)).collect()
}

struct Carried<'a> {
    mesh: &'a TMesh,
    ghosts: Ghosts<'a>,
    /// Per level and number the place of a vertex.
    known: Vec<Vec<Option<Point3>>>,
}

impl Carried<'_> {
    /// A value that was known or found before is not computed again, so that each is computed once.
    fn value(&mut self, level: u8, v: u32) -> Result<Point3, Error> {
        if let Some(p) = self.known[usize::from(level)][v as usize] {
            return Ok(p);
        }
        let mask = self.mask(level, v)?;
        let mut sum = Vector3::zeros();
        for (w, x) in mask {
            sum += self.value(level + 1, w)?.coords * x;
        }
        self.known[usize::from(level)][v as usize] = Some(Point3::from(sum));
        Ok(Point3::from(sum))
    }

    /// What subdivision makes a vertex of, found in the stars of the blocks around it.
    ///
    /// # Errors
    /// [`Error::Ring`] if no star of the level above holds the vertex.
    fn mask(&self, level: u8, v: u32) -> Result<Mask, Error> {
        let (edges, vertex) = (self.mesh.fine_edges(), self.ghosts.owner(v));
        let missing = Error::Ring { vertex, level };
        let above = level + 1;
        if above > self.mesh.top_level() {
            return Err(missing);
        }
        for h in edges.around(VertexId(vertex)) {
            let quad = edges.face(h).0 as usize;
            let Some(block) = self.mesh.block_of(above, quad) else {
                continue;
            };
            for corner in self.mesh.blocks(above)[block as usize].corners {
                let mut places = Vec::new();
                let Ok(star) = self.ghosts.star(above, corner, &mut places) else {
                    continue;
                };
                if let Some((_, mask)) = star.masks().into_iter().find(|(w, _)| *w == v) {
                    return Ok(mask);
                }
            }
        }
        Err(missing)
    }
}

/// Adds what belongs to the same function.
fn merge(row: &mut Row) {
    row.sort_by_key(|r| r.0);
    row.dedup_by(|next, kept| {
        let same = next.0 == kept.0;
        if same {
            kept.1 += next.1;
        }
        same
    });
}
