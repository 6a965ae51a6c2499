//! The base tetrahedra of the complex, with a label at every corner.
//!
//! Where dual contouring moves the points of cells to the surface, stuffing leaves them in the middle and asks what
//! they belong to, so a cell's middle is one more sample: of the field if there is one, else the mean of the corners.

use geom_core::Point3;
use geom_core::compute::parallel;
use geom_core::mesh::{INTERIOR, Region};

use crate::AtBox;
use crate::complex::cube::corners_of;
use crate::complex::{Cell, Complex, Corner, Numbering, Vertex};
use crate::dual::{Probe, Sample};
use crate::octree::{corner_of, local};

/// A base tetrahedron and the labels of its corners.
#[derive(Clone, Copy)]
pub(super) struct BaseTet {
    pub(super) corners: [u32; 4],
    pub(super) labels: [Region; 4],
}

/// The complex with a label in the middle of each cell.
pub(super) struct Base<'a> {
    pub(super) complex: &'a Complex<'a>,
    pub(super) probe: &'a Probe<'a>,
    pub(super) numbering: Numbering<'a>,
    at_box: AtBox,
}

impl<'a> Base<'a> {
    /// Of a complex none of whose leaves is cut; all lattice points become vertices.
    pub(super) fn new(
        complex: &'a Complex<'a>,
        probe: &'a Probe<'a>,
        ghosts: &'a [(u32, u8)],
        at_box: AtBox,
    ) -> Self {
        Self {
            complex,
            probe,
            numbering: Numbering::new(complex, ghosts, |_| true),
            at_box,
        }
    }

    /// May the molecule meet the box?
    pub(super) fn is_clipped(&self) -> bool {
        self.at_box == AtBox::Clip
    }

    /// Where all vertices stand before they snap, in finest cells.
    pub(super) fn positions(&self) -> Vec<Point3> {
        let vertices: Vec<Vertex> = self.numbering.vertices().collect();
        parallel::map_each(&vertices, |v| match v {
            Vertex::Cell(cell) => self.complex.base_position(cell),
            Vertex::Corner(corner) => self.complex.corner_position(*corner),
        })
    }

    /// Position, label and value of a vertex.
    /// In finest cells; the value is on the side of the level that the label says.
    pub(super) fn sample(&self, vertex: Vertex) -> Sample {
        match vertex {
            Vertex::Cell(cell) => self.cell_sample(&cell),
            Vertex::Corner(Corner::Point(p)) => {
                let samples = self.complex.samples;
                Sample::at(samples, p, samples.label(p))
            }
            Vertex::Corner(Corner::Centre(_)) => unreachable!("stuffing cuts no leaf into parts"),
        }
    }

    /// The middle of a leaf, or of a face on the box, with its label and value. Where all corners have one
    /// label, so has the middle.
    fn cell_sample(&self, cell: &Cell) -> Sample {
        let samples = self.complex.samples;
        let x = self.complex.base_position(cell);
        let (id, face) = match *cell {
            Cell::Leaf(id) => (id, None),
            Cell::Ghost(id, half) => (id, Some(usize::from(half / 2))),
            Cell::Part(..) => unreachable!("stuffing cuts no leaf into parts"),
        };
        let leaf = self.complex.leaf(id);
        if leaf.log > 0 {
            // The middle is a lattice point; it has a value where a boundary is near.
            let p = [0, 1, 2].map(|k| x[k].round() as i32);
            let near = self.complex.is_interface(id);
            let label = samples.label(if near { p } else { leaf.origin() });
            let value = samples.value(p);
            return Sample { x, label, value };
        }
        let corners: Vec<[i32; 3]> = corners_of(face)
            .into_iter()
            .map(|c| [0, 1, 2].map(|k| leaf.origin()[k] + corner_of(c)[k]))
            .collect();
        let label = samples.label(corners[0]);
        let values = corners.iter().map(|&p| samples.value(p));
        let mean = values.sum::<f64>() / corners.len() as f64;
        if corners.iter().all(|&p| samples.label(p) == label) {
            let value = mean;
            return Sample { x, label, value };
        }
        let point = samples.domain.world(&x);
        let value = self.probe.value(&point).unwrap_or(mean);
        let label = samples.labels.at(value, &point);
        if label == INTERIOR && !self.is_clipped() && self.complex.is_on_box(id) {
            return self.off_box(x, &corners);
        }
        Sample { x, label, value }
    }

    /// The middle `x` of a leaf on the box, outside as its corner there: the surface stays off the box.
    fn off_box(&self, x: Point3, corners: &[[i32; 3]]) -> Sample {
        let samples = self.complex.samples;
        let on_box = |p: &&[i32; 3]| planes_of(&local(**p), self.complex.tree.cells) != 0;
        let p = *corners
            .iter()
            .find(on_box)
            .expect("a leaf on the box has a corner there");
        let (label, value) = (samples.label(p), samples.value(p));
        Sample { x, label, value }
    }

    /// Labels of leaves and ghosts, by vertex number.
    /// Only the middles of cells with an interface are asked for a value; others have the label of their corners.
    fn cell_labels(&self) -> Vec<Region> {
        let complex = self.complex;
        let label = |id: u32, cell: Cell| {
            if complex.is_interface(id) {
                self.cell_sample(&cell).label
            } else {
                complex.samples.label(complex.leaf(id).origin())
            }
        };
        let (leaves, ghosts) = (complex.tree.leaves.len(), self.numbering.ghosts());
        parallel::map(leaves + ghosts.len(), |i| match i.checked_sub(leaves) {
            None => label(i as u32, Cell::Leaf(i as u32)),
            Some(ghost) => {
                let (id, half) = ghosts[ghost];
                label(id, Cell::Ghost(id, half))
            }
        })
    }

    /// All base tetrahedra with the labels of their corners; of the leaves that touch a box of cells, if one is given.
    pub(super) fn tets(&self, within: Option<[[i32; 3]; 2]>) -> Vec<BaseTet> {
        let labels = self.cell_labels();
        parallel::flat_map(self.complex.tree.leaves.len(), |id| {
            let (id, mut tets) = (id as u32, Vec::new());
            if !self.complex.touches(id, within) {
                return tets;
            }
            self.complex.rings_of(
                id,
                |_, _| true,
                |ring| {
                    let [a, b] = [ring.a.0, ring.b.0].map(|c| self.numbering.corner(c));
                    for cells in ring.neighbours() {
                        let [c, d] = cells.map(|cell| self.numbering.cell(&cell));
                        let [lc, ld] = [c, d].map(|c| labels[c as usize]);
                        tets.push(BaseTet {
                            corners: [a, b, c, d],
                            labels: [ring.a.1, ring.b.1, lc, ld],
                        });
                    }
                },
            );
            tets
        })
    }
}

/// The planes of the box that hold a point: bit `2 · axis + side`.
pub(super) fn planes_of(p: &Point3, cells: [i32; 3]) -> u8 {
    (0..3).fold(0, |m, k| {
        m | u8::from(p[k] == 0.0) << (2 * k) | u8::from(p[k] == f64::from(cells[k])) << (2 * k + 1)
    })
}
