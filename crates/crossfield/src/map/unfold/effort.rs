//! What unfolding may use: work that ends, and where earlier maps of the same field came out.

use std::cell::{Cell, RefCell};

/// How much work may still be done, in triangles times evaluations of their energy: what makes unfolding, and the ladder that
/// calls it, end in a time that the number of triangles bounds, on any machine after the same steps.
#[derive(Debug)]
pub(crate) struct Effort(Cell<u64>);

impl Effort {
    /// What a surface of so many triangles is worth: fifteen hundred evaluations, and as many of a thousand triangles.
    pub(crate) fn of(triangles: usize) -> Self {
        const EVALUATIONS: u64 = 1500;
        const FEW: u64 = 1_000;
        Self(Cell::new(EVALUATIONS * (triangles as u64 + FEW)))
    }

    /// So much.
    pub(crate) fn worth(amount: u64) -> Self {
        Self(Cell::new(amount))
    }

    /// Takes one of so many parts of what is left, so that something remains for another try.
    pub(crate) fn share(&self, parts: u64) -> Self {
        let share = self.0.get() / parts;
        self.0.set(self.0.get() - share);
        Self(Cell::new(share))
    }

    /// What was not spent of a share comes back.
    pub(crate) fn give_back(&self, share: &Self) {
        self.0.set(self.0.get() + share.0.take());
    }

    /// Takes from it; false if there was not as much.
    pub(crate) fn spend(&self, amount: usize) -> bool {
        let left = self.0.get().checked_sub(amount as u64);
        self.0.set(left.unwrap_or(0));
        left.is_some()
    }

    /// Nothing is worth doing any more.
    pub(crate) fn end(&self) {
        self.0.set(0);
    }

    /// What is left.
    pub(crate) fn left(&self) -> u64 {
        self.0.get()
    }

    /// Is nothing left?
    pub(crate) fn is_spent(&self) -> bool {
        self.left() == 0
    }
}

/// What the maps of one field leave to each other: where unfolding without integers has led, and work.
#[derive(Debug)]
pub(crate) struct Ends {
    /// What may be done for integers: an effort of its own, since an upright map is worth its integers however hard it was to
    /// unfold.
    pub(crate) integers: Effort,
    /// The unknowns of the last map that came out upright.
    pub(crate) upright: RefCell<Option<Vec<f64>>>,
    /// The last that did not, or where the next one starts.
    pub(crate) folded: RefCell<Option<Folded>>,
}

impl Ends {
    /// Of a field of so many triangles that has no map yet.
    pub(crate) fn of(triangles: usize) -> Self {
        Self {
            integers: Effort::of(triangles),
            upright: RefCell::default(),
            folded: RefCell::default(),
        }
    }

    /// Does the next map start from a folded one?
    pub(crate) fn is_folded(&self) -> bool {
        self.folded.borrow().is_some()
    }
}

/// A map without integers that stays folded.
#[derive(Clone, Debug)]
pub(crate) struct Folded {
    /// `[h_u ∇u; h_v ∇v]` of each triangle in the basis of the field's arm θ and the next one.
    pub(crate) jacobians: Vec<[[f64; 2]; 2]>,
    /// Vertices at a wrong angle or of triangles that are not upright.
    pub(crate) vertices: Vec<usize>,
}

/// What unfolding may use.
#[derive(Clone, Copy)]
pub(crate) struct Unfolding<'a> {
    pub(crate) effort: &'a Effort,
    /// Of the same field: what is upright at one spacing is so at any, and is where the next map starts.
    pub(crate) ends: &'a Ends,
    /// Up to so many integers are rounded by dense matrices, more of them region by region.
    pub(crate) most_dense: usize,
}

impl Unfolding<'_> {
    /// What a single map of so many triangles may use.
    pub(crate) fn alone(triangles: usize) -> (Effort, Ends) {
        (Effort::of(triangles), Ends::of(triangles))
    }
}
