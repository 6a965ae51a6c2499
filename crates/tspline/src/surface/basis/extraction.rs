//! Bézier extraction: what every basis comes down to, and all that evaluation, analysis, files and GPU see of it.

use geom_core::Point3;

/// Bernstein polynomials of a bicubic patch: `a + 4 b` belongs to degree `a` along side 0 and `b` along side 3.
pub const POINTS: usize = 16;

/// A piece of an element on which the surface is one bicubic Bézier patch.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Patch {
    /// Its element of the T-mesh.
    pub element: u32,
    /// Its lower corner in the element, in sides of fine quads along side 0 and along side 3.
    pub from: [u32; 2],
    /// Its upper corner.
    pub to: [u32; 2],
}

impl Patch {
    /// Its extent in sides of fine quads.
    pub fn size(&self) -> [u32; 2] {
        [self.to[0] - self.from[0], self.to[1] - self.from[1]]
    }
}

/// Which functions a patch carries, and their Bézier coefficients on it (Borden, Scott, Evans and Hughes 2011).
#[derive(Clone, Debug, PartialEq)]
pub struct Extraction {
    patches: Vec<Patch>,
    /// Where the patches of each element begin, and the end.
    first: Vec<u32>,
    starts: Vec<usize>,
    functions: Vec<u32>,
    coefficients: Vec<[f64; POINTS]>,
    controls: Vec<Point3>,
    /// Per function the level and the number of its vertex.
    pub(super) origins: Vec<(u8, u32)>,
    rational: bool,
}

impl Extraction {
    /// Of patches in the order of their elements, each with its rows.
    pub(super) fn new(
        patches: Vec<Patch>,
        rows: Vec<Rows>,
        (controls, origins): (Vec<Point3>, Vec<(u8, u32)>),
        rational: bool,
    ) -> Self {
        let elements = patches.last().map_or(0, |p| p.element + 1);
        let first = (0..=elements)
            .map(|e| patches.partition_point(|p| p.element < e) as u32)
            .collect();
        let mut starts = vec![0];
        let (mut functions, mut coefficients) = (Vec::new(), Vec::new());
        for (of, values) in rows.into_iter().map(|r| (r.functions, r.coefficients)) {
            functions.extend(of);
            coefficients.extend(values);
            starts.push(functions.len());
        }
        Self {
            patches,
            first,
            starts,
            functions,
            coefficients,
            controls,
            origins,
            rational,
        }
    }

    /// The patches, element by element.
    pub fn patches(&self) -> &[Patch] {
        &self.patches
    }
    /// The patches of an element.
    pub fn of_element(&self, element: usize) -> std::ops::Range<usize> {
        self.first[element] as usize..self.first[element + 1] as usize
    }
    /// The functions of the basis.
    pub fn functions(&self) -> usize {
        self.controls.len()
    }
    /// The functions of a patch that are not zero on it, ascending.
    pub fn on(&self, patch: usize) -> &[u32] {
        &self.functions[self.starts[patch]..self.starts[patch + 1]]
    }
    /// Their Bézier coefficients on it, in the same order.
    pub fn coefficients(&self, patch: usize) -> &[[f64; POINTS]] {
        &self.coefficients[self.starts[patch]..self.starts[patch + 1]]
    }
    /// Where each patch begins in [`all_functions`](Self::all_functions) and
    /// [`all_coefficients`](Self::all_coefficients), and the end.
    pub fn starts(&self) -> &[usize] {
        &self.starts
    }
    /// The functions of all patches, one after the other.
    pub fn all_functions(&self) -> &[u32] {
        &self.functions
    }
    /// Their coefficients.
    pub fn all_coefficients(&self) -> &[[f64; POINTS]] {
        &self.coefficients
    }
    /// Where control points start before anything is fitted: at the vertices to which the functions belong.
    pub fn start_controls(&self) -> &[Point3] {
        &self.controls
    }
    /// Must sums be divided by the sum of the functions (which is one otherwise)?
    pub fn is_rational(&self) -> bool {
        self.rational
    }
    /// The patch of an element at `(s, t)` in 0…1, and where in it; `size` is that of the element.
    pub fn locate(&self, element: usize, [s, t]: [f64; 2], size: u32) -> (usize, [f64; 2]) {
        let range = self.of_element(element);
        let at = [s, t].map(|x| x * f64::from(size));
        let within = |p: &Patch| (0..2).all(|k| at[k] <= f64::from(p.to[k]));
        // Patches ascend, so that the first whose upper corner is beyond the point holds it.
        let found = range.clone().find(|&p| within(&self.patches[p]));
        let patch = found.unwrap_or(range.end - 1);
        let p = &self.patches[patch];
        let local = |k: usize| (at[k] - f64::from(p.from[k])) / f64::from(p.size()[k]);
        (patch, [local(0), local(1)])
    }
}

/// The functions of a patch and their coefficients, as they are found.
#[derive(Clone, Debug, Default)]
pub(super) struct Rows {
    functions: Vec<u32>,
    coefficients: Vec<[f64; POINTS]>,
}

impl Rows {
    /// Adds to a coefficient of a function.
    pub(super) fn add(&mut self, function: u32, point: usize, value: f64) {
        self.row(function)[point] += value;
    }

    /// The coefficients of a function.
    pub(super) fn row(&mut self, function: u32) -> &mut [f64; POINTS] {
        let at = self.functions.iter().position(|&f| f == function);
        let at = at.unwrap_or_else(|| {
            self.functions.push(function);
            self.coefficients.push([0.0; POINTS]);
            self.functions.len() - 1
        });
        &mut self.coefficients[at]
    }

    /// In the order of the functions.
    pub(super) fn sorted(self) -> Self {
        let mut order: Vec<usize> = (0..self.functions.len()).collect();
        order.sort_unstable_by_key(|&i| self.functions[i]);
        Self {
            functions: order.iter().map(|&i| self.functions[i]).collect(),
            coefficients: order.iter().map(|&i| self.coefficients[i]).collect(),
        }
    }
}
