//! Sums of element matrices: the pattern once, values by fixed lists, so that nothing depends on
//! threads.

use geom_core::algebra::SparseMatrix;
use geom_core::compute::parallel;
use geom_core::compute::sets::DisjointSets;
use geom_core::surface::laplace::Mass;

use crate::Error;

/// Where the entries of element matrices go: a template whose values are the numbers of the entries, and
/// per entry the slots that it sums.
#[derive(Clone, Debug)]
pub(crate) struct Pattern {
    template: SparseMatrix,
    starts: Vec<usize>,
    slots: Vec<u32>,
}

/// The slot of a pair in the packed upper half of an `n × n` matrix, row after row.
pub(crate) fn packed(n: usize, i: usize, j: usize) -> usize {
    let (i, j) = (i.min(j), i.max(j));
    i * n - i * (i + 1) / 2 + j
}

impl Pattern {
    /// The pattern of elements with these degrees of freedom; the matrix of element e is the packed
    /// upper half, one after the other.
    pub(crate) fn of<E: AsRef<[u32]> + Sync>(dofs: usize, elements: &[E]) -> Result<Self, Error> {
        let sizes = elements.iter().map(|e| {
            let n = e.as_ref().len();
            (n * (n + 1) / 2) as u32
        });
        let first = parallel::starts_of(&sizes.collect::<Vec<_>>());
        let mut counts = vec![0u32; dofs];
        for &v in elements.iter().flat_map(AsRef::as_ref) {
            counts[v as usize] += 1;
        }
        let starts = parallel::starts_of(&counts);
        let mut next = starts.clone();
        let mut corners = vec![(0u32, 0u32); starts[dofs]];
        for (e, ids) in elements.iter().enumerate() {
            for (k, &v) in ids.as_ref().iter().enumerate() {
                corners[next[v as usize]] = (e as u32, k as u32);
                next[v as usize] += 1;
            }
        }
        let rows: Vec<Vec<(u32, u32)>> = parallel::map(dofs, |v| {
            let mut row = Vec::new();
            for &(e, k) in &corners[starts[v]..starts[v + 1]] {
                let ids = elements[e as usize].as_ref();
                row.extend(ids.iter().enumerate().map(|(l, &w)| {
                    let slot = first[e as usize] + packed(ids.len(), k as usize, l);
                    (w, slot as u32)
                }));
            }
            row.sort_unstable();
            row
        });
        Self::of_rows(dofs, &rows)
    }

    fn of_rows(dofs: usize, rows: &[Vec<(u32, u32)>]) -> Result<Self, Error> {
        let (mut entries, mut starts, mut slots) = (Vec::new(), vec![0], Vec::new());
        for (i, row) in rows.iter().enumerate() {
            for entry in row.chunk_by(|a, b| a.0 == b.0) {
                entries.push((i as u32, entry[0].0, entries.len() as f64));
                slots.extend(entry.iter().map(|e| e.1));
                starts.push(slots.len());
            }
        }
        Ok(Self {
            template: SparseMatrix::from_triplets(dofs, dofs, &entries)?,
            starts,
            slots,
        })
    }

    /// The sum of the elements with these packed values.
    pub(crate) fn sum(&self, values: &[f64]) -> SparseMatrix {
        self.template.map(|_, _, entry| {
            let entry = entry as usize;
            let slots = &self.slots[self.starts[entry]..self.starts[entry + 1]];
            slots.iter().map(|&s| values[s as usize]).sum()
        })
    }
}

/// The matrices of an operator, in unit scale.
#[derive(Clone, Debug)]
pub struct Matrices {
    /// `∫ Nᵢ_a A^{ab} Nⱼ_b dA`.
    pub stiffness: SparseMatrix,
    /// `∫ Nᵢ Nⱼ dA`, lumped on triangles.
    pub mass: Mass,
    /// The area around each vertex, of the whole area.
    pub areas: Vec<f64>,
    /// Mean curvature per vertex, area-weighted over the elements around it, in unit scale.
    pub mean: Vec<f64>,
    /// Gaussian curvature per vertex, in unit scale.
    pub gauss: Vec<f64>,
    /// The connected component of each vertex, by its lowest vertex.
    pub components: Vec<u32>,
    /// Å per unit of length.
    pub scale: f64,
    /// Triangles or quadrature points that were left out because they have no area.
    pub skipped: usize,
}

/// The lowest vertex of each vertex's component.
pub(crate) fn components<const N: usize>(vertices: usize, faces: &[[u32; N]]) -> Vec<u32> {
    let mut sets = DisjointSets::new(vertices);
    for face in faces {
        for pair in face.windows(2) {
            sets.join(pair[0], pair[1]);
        }
    }
    sets.into_roots()
}
