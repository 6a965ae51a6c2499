//! The integer conditions of seams, boundaries and sharp edges, solved exactly.
//!
//! Each vertex has two real coordinates in one chart, and each chain of the cut a translation of two integers; all copies of
//! the vertex along the cut are sums of these with coefficients 0, ±1. Going once around a node of the cut must lead back to
//! where one began, which is one linear equation with integer coefficients per node and coordinate; a kept line is one per
//! half-edge. Elimination in floating point would leave errors of 10⁻¹⁶ in the seams, and a line that passes at that distance
//! from a vertex ends nowhere. So every equation is solved for a variable whose coefficient is ±1; where there is none,
//! Euclid's algorithm on the coefficients, a change of variables of determinant 1, makes one. What is left is independent:
//! any reals and any integers give a map without gaps.
//!
//! The translation of a chain near the root of the cut is a sum over all singular vertices farther out. Coordinates are
//! written over such sums, not over their terms: each then hangs on what is near to it, and sparse matrices stay sparse. Where
//! there are thousands of integers, `basis` makes their moves local, too.

mod basis;

use std::collections::BTreeMap;

use geom_core::VertexId;
use geom_core::compute::lists::Lists;

use self::basis::followers;
use super::cut::Cut;
use crate::field::CrossField;
use crate::field::frames::{Frames, QUARTER};

/// A sum of variables with integer coefficients: by variable, none of them zero.
pub(crate) type Form = BTreeMap<u32, i64>;

/// The same of integers, where sums are added up many times: ascending, and no coefficient is zero.
pub(crate) type Sum = Vec<(u32, i64)>;

/// Integer sums of numbered terms, one per row.
#[derive(Clone, Debug)]
pub(crate) struct Rows {
    /// Where each row begins in the array below, and one more for the end.
    starts: Vec<usize>,
    /// Number and coefficient of each term; coefficients are never 0 and mostly ±1.
    terms: Vec<(u32, i32)>,
}

impl Rows {
    /// Of forms whose variables have these numbers.
    fn of<'a>(forms: impl Iterator<Item = &'a Form>, number: &[u32]) -> Self {
        let mut rows = Self {
            starts: vec![0],
            terms: Vec::new(),
        };
        for form in forms {
            rows.push(form, number, None);
        }
        rows
    }

    /// One more, less what it is the sum of.
    fn push(&mut self, form: &Form, number: &[u32], sum: Option<u32>) {
        let numbered = form.iter().map(|(&v, &c)| (number[v as usize], c as i32));
        self.terms.extend(numbered);
        self.terms.extend(sum.map(|sum| (sum, -1)));
        self.starts.push(self.terms.len());
    }

    pub(crate) fn len(&self) -> usize {
        self.starts.len() - 1
    }

    /// The terms of a row, with their coefficients.
    pub(crate) fn row(&self, row: usize) -> impl Iterator<Item = (usize, i32)> + '_ {
        let terms = &self.terms[self.starts[row]..self.starts[row + 1]];
        terms.iter().map(|&(k, c)| (k as usize, c))
    }
}

/// Both coordinates of every copy of every vertex as integer sums of a few *values*: first the independent real unknowns,
/// then the independent ones that must become integers, then sums of the latter, such as the translations of chains that
/// elimination has expressed by others. Whatever the unknowns are, all transitions
/// `(u, v)_right = R(−90° k) (u, v)_left + t` over the seams hold exactly, and kept lines are lines of
/// equal coordinate.
#[derive(Clone, Debug)]
pub(crate) struct Seams {
    /// Of values: row 2 · copy + component.
    rows: Rows,
    /// Number of real unknowns.
    pub(crate) reals: usize,
    /// Number of integer unknowns.
    pub(crate) integers: usize,
    /// Of integers: the values after the unknowns.
    sums: Rows,
    /// Of values: what vanishes if the sums are those of the integers. Unlike `sums` each hangs on what is near to it.
    pub(crate) closings: Rows,
    /// Vertices whose coordinates are integers though the field needs none there.
    pub(crate) pinned: Vec<usize>,
}

/// One vertex of each boundary on which the field has no corner: a decimated map needs a vertex on every boundary.
pub(crate) fn without_corners(frames: &Frames, field: &CrossField) -> Vec<usize> {
    let has_corner = |rim: &Vec<VertexId>| rim.iter().any(|v| field.index[v.0 as usize] != 0);
    let loops = frames.edges().boundary_loops().into_iter();
    loops
        .filter(|rim| !has_corner(rim))
        .map(|rim| rim[0].0 as usize)
        .collect()
}

impl Seams {
    /// Eliminates the conditions at the nodes of the cut, and on the half-edges that must be lines of equal
    /// coordinate.
    ///
    /// First the closings of nodes, the outermost before those nearer to the root of the cut, since each chain is to be
    /// eliminated at its outer end; then all lines, and only then that their coordinates are integers; at last the shift
    /// of the whole map. Which variables stay depends on this order, the maps that they describe do not.
    ///
    /// Up to so many integers are those that elimination leaves; more are paired, for their moves to be local.
    pub(crate) fn of(
        frames: &Frames,
        field: &CrossField,
        cut: &Cut,
        lines: &[usize],
        pinned: Vec<usize>,
        most_dense: usize,
    ) -> Self {
        let places = Places::of(frames, cut);
        let mut unknowns = Unknowns::of(frames, field, cut, &pinned);
        for closing in &places.closings {
            unknowns.impose(closing.clone());
        }
        let aligned = aligned_coordinates(frames, field, cut, lines);
        for &(h, component) in &aligned {
            let (a, b) = (cut.copy[h], cut.copy[crate::field::frames::next(h)]);
            let mut row = places.form(a, component);
            add(&mut row, &places.form(b, component), -1);
            unknowns.impose(row);
        }
        for &(h, component) in &aligned {
            unknowns.make_integer(&places.form(cut.copy[h], component));
        }
        for row in gauge(frames, field, cut, &places, &aligned, &pinned) {
            unknowns.impose(row);
        }
        let seams = unknowns.rows(&places, cut.vertex.len(), most_dense);
        Self { pinned, ..seams }
    }

    /// The terms of a coordinate: value and coefficient.
    /// Values from `reals` on are integers or sums of such.
    pub(crate) fn row(
        &self,
        copy: u32,
        component: usize,
    ) -> impl Iterator<Item = (usize, i32)> + '_ {
        self.rows.row(2 * copy as usize + component)
    }

    /// Per value that has a place, of so many, which coordinates of these copies hang on it, as `2 · number of the copy + component`,
    /// and how often.
    pub(crate) fn by_value(
        &self,
        copies: impl Iterator<Item = u32> + Clone,
        place: impl Fn(usize) -> Option<u32>,
        places: usize,
    ) -> Lists<(u32, i32)> {
        let place = &place;
        Lists::of(places, || {
            let coordinates = (0u32..).zip(copies.clone());
            let coordinates =
                coordinates.flat_map(|(at, copy)| [(2 * at, copy, 0), (2 * at + 1, copy, 1)]);
            coordinates.flat_map(move |(coordinate, copy, component)| {
                let row = self.row(copy, component);
                row.filter_map(move |(k, p)| Some((place(k)?, (coordinate, p))))
            })
        })
    }

    /// The coordinates of a copy, for these values.
    pub(crate) fn copy(&self, w: &[f64], copy: u32) -> [f64; 2] {
        [0, 1].map(|component| {
            let terms = self.row(copy, component);
            terms.map(|(k, c)| f64::from(c) * w[k]).sum()
        })
    }

    /// What a coordinate hangs on of integers and their sums, numbered from the first integer.
    pub(crate) fn integers_of(&self, copy: u32, component: usize) -> Sum {
        let terms = self.row(copy, component).filter(|t| t.0 >= self.reals);
        let terms = terms.map(|(k, c)| ((k - self.reals) as u32, c.into()));
        let mut sum: Sum = terms.collect();
        sum.sort_unstable();
        sum
    }

    /// The same with all sums written out.
    pub(crate) fn written_out(&self, sum: &Sum) -> Sum {
        let mut terms = Sum::new();
        for &(k, c) in sum {
            match (k as usize).checked_sub(self.integers) {
                None => terms.push((k, c)),
                Some(sum) => {
                    let row = self.sums.row(sum);
                    terms.extend(row.map(|(k, by)| (k as u32, c * i64::from(by))));
                }
            }
        }
        // Sums are of many terms, and most of those cancel.
        terms.sort_unstable_by_key(|t| t.0);
        let same = terms.chunk_by(|a, b| a.0 == b.0);
        let summed = same.map(|all| (all[0].0, all.iter().map(|t| t.1).sum()));
        summed.filter(|t| t.1 != 0).collect()
    }

    /// Number of copies.
    pub(crate) fn copies(&self) -> usize {
        self.rows.len() / 2
    }

    /// Number of independent unknowns, reals and integers.
    pub(crate) fn unknowns(&self) -> usize {
        self.reals + self.integers
    }

    /// Number of values: unknowns and sums.
    pub(crate) fn values(&self) -> usize {
        self.unknowns() + self.sums.len()
    }

    /// All values of which some integers leave no choice: these, and the sums of these alone.
    pub(crate) fn all_of(&self, integers: &[Option<f64>]) -> Vec<Option<f64>> {
        let mut all = vec![None; self.reals];
        all.extend_from_slice(integers);
        let sum = |row| {
            let mut terms = self.sums.row(row);
            terms.try_fold(0.0, |sum, (k, c)| Some(sum + f64::from(c) * integers[k]?))
        };
        all.extend((0..self.sums.len()).map(sum));
        all
    }

    /// Brings the sums up to date with the integers.
    pub(crate) fn add_up<T: Copy + std::iter::Sum + std::ops::Mul<Output = T> + From<i32>>(
        &self,
        values: &mut [T],
    ) {
        let (unknowns, sums) = values.split_at_mut(self.unknowns());
        let integers = &unknowns[self.reals..];
        for (row, sum) in sums.iter_mut().enumerate() {
            let terms = self.sums.row(row);
            *sum = terms.map(|(k, c)| T::from(c) * integers[k]).sum();
        }
    }

    /// Derivatives with respect to the unknowns for those with respect to all values: the transpose of [`add_up`](Self::add_up).
    pub(crate) fn fold(&self, slopes: &mut Vec<f64>) {
        let sums = slopes.split_off(self.unknowns());
        for (row, slope) in sums.into_iter().enumerate() {
            for (k, c) in self.sums.row(row) {
                slopes[self.reals + k] += f64::from(c) * slope;
            }
        }
    }
}

/// Half-edges that are lines of equal coordinate, and which: 0 for u, 1 for v.
///
/// The arm nearest to the half-edge decides: along the first or the third v is constant, along the others u. If the
/// field is not parallel to the half-edge, the map is bent until it is.
fn aligned_coordinates(
    frames: &Frames,
    field: &CrossField,
    cut: &Cut,
    lines: &[usize],
) -> Vec<(usize, usize)> {
    lines
        .iter()
        .map(|&h| {
            let arm = field.theta[h / 3] + QUARTER * f64::from(cut.comb[h / 3]);
            let quarters = ((frames.side_angle(h) - arm) / QUARTER).round() as i64;
            // Along the first arm, v stays the same.
            (h, 1 - quarters.rem_euclid(2) as usize)
        })
        .collect()
}

/// The map may be shifted: two coordinates are put to zero, where possible such as are integers anyway.
///
/// Without them the energy would not change with the shift, and the matrix of the system would be singular.
fn gauge(
    frames: &Frames,
    field: &CrossField,
    cut: &Cut,
    places: &Places,
    aligned: &[(usize, usize)],
    pinned: &[usize],
) -> Vec<Form> {
    let singular = field.singular_vertices(frames).next();
    let singular = singular.or(pinned.first().copied());
    if let Some(v) = singular {
        let copy = cut.copy[frames.around(v).next().expect("a used vertex")];
        return vec![places.form(copy, 0), places.form(copy, 1)];
    }
    [0, 1]
        .map(|component| {
            let on_line = aligned.iter().find(|a| a.1 == component);
            let copy = on_line.map_or(0, |&(h, _)| cut.copy[h]);
            places.form(copy, component)
        })
        .to_vec()
}

/// A copy of a vertex: the vertex, its quarter turns, and the chains between with theirs.
type PlacedCopy = (u32, u8, Vec<(u32, u8)>);

/// Where the copies of a vertex lie: `R(90° turn) base + Σ R(90° turn_c) t_c`.
struct Places {
    /// All of them.
    /// Of each copy of the cut, in its order.
    copies: Vec<PlacedCopy>,
    /// What must vanish so that a walk around a node ends where it began.
    /// Two per vertex of the cut inside of the surface, unless they hold anyway: where a chain passes through, what one
    /// side of it adds the other takes away.
    closings: Vec<Form>,
    /// Variables `2 v` and `2 v + 1` are the base of vertex v; those of chains follow after all vertices.
    vertices: u32,
}

impl Places {
    /// Walks around every vertex on the cut; others have one copy, which is their base.
    fn of(frames: &Frames, cut: &Cut) -> Self {
        let vertices = frames.edges().vertices() as u32;
        let mut places = Self {
            copies: cut.vertex.iter().map(|&v| (v, 0, Vec::new())).collect(),
            closings: Vec::new(),
            vertices,
        };
        // Nodes come leaves first; the others need no closing.
        let mut is_node = vec![false; vertices as usize];
        for &node in &cut.nodes {
            is_node[node as usize] = true;
            places.walk(frames, cut, node);
        }
        let mut on_cut = vec![false; vertices as usize];
        for h in (0..cut.is_cut.len()).filter(|&h| cut.is_cut[h]) {
            on_cut[frames.from(h)] = true;
        }
        for v in (0..vertices).filter(|&v| on_cut[v as usize] && !is_node[v as usize]) {
            places.walk(frames, cut, v);
        }
        places
    }

    /// Goes around a vertex counter-clockwise and composes the transitions.
    ///
    /// The first sector of the fan is the base. At each half-edge of the cut that is passed, all terms so far turn with
    /// the chart, and the translation of its chain is added; it stands before or behind the turn, as the chain runs
    /// along the half-edge or against it.
    fn walk(&mut self, frames: &Frames, cut: &Cut, vertex: u32) {
        let (mut turn, mut terms): (u8, Vec<(u32, u8)>) = (0, Vec::new());
        let fan = cut.fan(frames, vertex as usize);
        for &out in &fan {
            self.copies[cut.copy[out] as usize] = (vertex, turn, terms.clone());
            let h = crate::field::frames::previous(out);
            if !cut.is_cut[h] {
                continue;
            }
            let (chain, k) = (cut.chain[h], cut.turn[h]);
            if !cut.forward[h] {
                // x_left = R(k_c) (x_right − t): the turn of this half-edge is −k_c.
                terms.push((chain, 2));
            }
            // Coordinates turn by −k.
            let by = (4 - k) % 4;
            turn = (turn + by) % 4;
            for term in &mut terms {
                term.1 = (term.1 + by) % 4;
            }
            if cut.forward[h] {
                terms.push((chain, 0));
            }
        }
        if frames.on_boundary(vertex as usize) {
            return;
        }
        for component in [0, 1] {
            let mut row = self.expand((vertex, turn, &terms), component);
            add(&mut row, &self.expand((vertex, 0, &[]), component), -1);
            if !row.is_empty() {
                self.closings.push(row);
            }
        }
    }

    /// A coordinate of a copy over the variables: vertices first, then chains, two each.
    fn form(&self, copy: u32, component: usize) -> Form {
        let (vertex, turn, terms) = &self.copies[copy as usize];
        self.expand((*vertex, *turn, terms), component)
    }

    /// Writes one coordinate of such a place as a sum of variables: a turn exchanges components and changes signs.
    fn expand(&self, (vertex, turn, terms): (u32, u8, &[(u32, u8)]), component: usize) -> Form {
        let mut form = Form::new();
        let mut push = |variable: u32, turn: u8| {
            let (other, sign) = turned(turn, component);
            let one = Form::from([(2 * variable + other as u32, sign)]);
            add(&mut form, &one, 1);
        };
        push(vertex, turn);
        for &(chain, turn) in terms {
            push(self.vertices + chain, turn);
        }
        form
    }
}

/// Component of a vector after quarter turns to the left: which component it was, and its sign.
pub(crate) fn turned(turn: u8, component: usize) -> (usize, i64) {
    match (turn % 4, component) {
        (0, c) => (c, 1),
        (1, 0) => (1, -1),
        (1, _) => (0, 1),
        (2, c) => (c, -1),
        (_, 0) => (1, 1),
        (_, _) => (0, -1),
    }
}

/// `form += factor · other`.
fn add(form: &mut Form, other: &Form, factor: i64) {
    for (&variable, &c) in other {
        let entry = form.entry(variable).or_insert(0);
        *entry += factor * c;
        if *entry == 0 {
            form.remove(&variable);
        }
    }
}

/// Variables, some of which are expressed by others.
struct Unknowns {
    /// What each variable is expressed by; `None` for those that are free. Expressions may name variables that have
    /// been expressed since: [`Unknowns::resolved`] follows them.
    expression: Vec<Option<Form>>,
    /// Whether each must become an integer: those of chains and singular vertices from the start, others when a line
    /// says so.
    integer: Vec<bool>,
    /// Of variables that could be eliminated, the one of lowest rank is.
    rank: Vec<f64>,
    /// Sums of integer variables that vanish, each as near to home as it was imposed.
    closings: Vec<Form>,
}

/// An integer that is a sum of so few others is written as that sum, for what hangs on it.
const SHORT: usize = 4;

impl Unknowns {
    /// All variables free: two per vertex, two per chain.
    fn of(frames: &Frames, field: &CrossField, cut: &Cut, pinned: &[usize]) -> Self {
        let vertices = frames.edges().vertices();
        let variables = 2 * (vertices + cut.chains);
        let mut integer = vec![false; variables];
        let mut rank = vec![f64::INFINITY; variables];
        integer[2 * vertices..].fill(true);
        for v in field
            .singular_vertices(frames)
            .chain(pinned.iter().copied())
        {
            integer[2 * v] = true;
            integer[2 * v + 1] = true;
        }
        // A chain is eliminated at its outer end, so that few others depend on it.
        for h in (0..cut.is_cut.len()).filter(|&h| cut.is_cut[h]) {
            let near = cut.depth[frames.from(h)];
            for component in [0, 1] {
                let slot = &mut rank[2 * (vertices + cut.chain[h] as usize) + component];
                *slot = slot.min(near);
            }
        }
        Self {
            expression: vec![None; variables],
            integer,
            rank,
            closings: Vec::new(),
        }
    }

    /// A form over variables that are not eliminated.
    fn resolved(&self, form: Form) -> Form {
        self.expanded(form, |_, _| true)
    }

    /// A form over reals that are not eliminated and integers that may be, unless they are [`SHORT`].
    fn localized(&self, form: Form) -> Form {
        self.expanded(form, |v, expression| {
            !self.integer[v as usize] || expression.len() <= SHORT
        })
    }

    /// A form with some of the variables that are expressed by others written as that.
    /// It ends since no variable is ever expressed by itself: rows are resolved before one of their variables is
    /// eliminated.
    fn expanded(&self, mut form: Form, is_wanted: impl Fn(u32, &Form) -> bool) -> Form {
        let mut open: Vec<u32> = form.keys().copied().collect();
        while let Some(variable) = open.pop() {
            let expression = self.expression[variable as usize].as_ref();
            let Some(expression) = expression.filter(|e| is_wanted(variable, e)) else {
                continue;
            };
            if let Some(c) = form.remove(&variable) {
                add(&mut form, expression, c);
                open.extend(expression.keys());
            }
        }
        form
    }

    /// Makes `row = 0` true by eliminating one variable: a real one with coefficient ±1 if there is one, else an
    /// integer. Where no coefficient is ±1, Euclid's algorithm on the columns makes one: a change of integer variables
    /// of determinant 1.
    fn impose(&mut self, row: Form) {
        let local = self.localized(row);
        if let Some(real) = self.pivot(&local, false) {
            self.eliminate(real, local);
            return;
        }
        let mut row = self.resolved(local.clone());
        if row.is_empty() {
            return;
        }
        // 2 x = integers, for a line that meets itself turned: x must be an integer anyway.
        for &v in row.keys() {
            self.integer[v as usize] = true;
        }
        self.closings.push(local);
        loop {
            let divisor = row.values().fold(0, |g, &c| gcd(g, c.abs()));
            for c in row.values_mut() {
                *c /= divisor;
            }
            if let Some(integer) = self.pivot(&row, true) {
                self.eliminate(integer, row);
                return;
            }
            row = self.euclid(row);
        }
    }

    /// The variable with coefficient ±1 to eliminate; of reals the last, which is new on its line.
    fn pivot(&self, row: &Form, integer: bool) -> Option<u32> {
        let mut units = row
            .iter()
            .filter(|&(&v, &c)| c.abs() == 1 && self.integer[v as usize] == integer)
            .map(|(&v, _)| v);
        if integer {
            units.min_by(|&a, &b| {
                let rank = |v: u32| self.rank[v as usize];
                rank(a).total_cmp(&rank(b)).then(a.cmp(&b))
            })
        } else {
            units.next_back()
        }
    }

    /// The coefficient must be ±1, so that the others stay integers after the division.
    fn eliminate(&mut self, variable: u32, mut row: Form) {
        let sign = row.remove(&variable).expect("the pivot is in the row");
        for c in row.values_mut() {
            *c *= -sign;
        }
        self.expression[variable as usize] = Some(row);
    }

    /// `z_k = z' − Σ q_i z_i` for the smallest coefficient c_k, with q_i the rounded c_i / c_k.
    /// The rest of the row has coefficients of half the smallest one at most, besides that one: after finitely many
    /// steps one is ±1, as their greatest common divisor is 1.
    fn euclid(&mut self, row: Form) -> Form {
        let (&k, &least) = row.iter().min_by_key(|(_, c)| c.abs()).expect("not empty");
        let new = self.expression.len() as u32;
        let mut expression = Form::from([(new, 1)]);
        let mut rest = Form::from([(new, least)]);
        for (&v, &c) in row.iter().filter(|&(&v, _)| v != k) {
            let q = (c as f64 / least as f64).round() as i64;
            add(&mut expression, &Form::from([(v, 1)]), -q);
            add(&mut rest, &Form::from([(v, 1)]), c - q * least);
        }
        let mut closing = expression.clone();
        add(&mut closing, &Form::from([(k, 1)]), -1);
        self.closings.push(closing);
        self.expression[k as usize] = Some(expression);
        self.expression.push(None);
        self.integer.push(true);
        self.rank.push(f64::INFINITY);
        rest
    }

    /// A coordinate that is a sum of integers already needs nothing; one with a real left makes that one an integer.
    fn make_integer(&mut self, form: &Form) {
        for v in self.resolved(form.clone()).into_keys() {
            self.integer[v as usize] = true;
        }
    }

    /// Numbers the variables that are left, and those that are sums of them, and writes every coordinate over them.
    fn rows(&self, places: &Places, copies: usize, most_dense: usize) -> Seams {
        let forms: Vec<Form> = (0..2 * copies)
            .map(|row| self.localized(places.form((row / 2) as u32, row % 2)))
            .collect();
        let closings = self.closings.iter().cloned();
        let closings: Vec<Form> = closings
            .map(|row| self.localized(row))
            .filter(|row| !row.is_empty())
            .collect();
        let mut used = vec![false; self.expression.len()];
        for &v in forms.iter().chain(&closings).flat_map(Form::keys) {
            used[v as usize] = true;
        }
        let is_free = |v: usize| self.expression[v].is_none();
        let resolved = |v: usize| (v, self.resolved(Form::from([(v as u32, 1)])));
        let mut sums: Vec<(usize, Form)> = (0..used.len())
            .filter(|&v| used[v] && !is_free(v))
            .map(resolved)
            .collect();
        for &v in sums.iter().flat_map(|(_, form)| form.keys()) {
            used[v as usize] = true;
        }
        let free = |integer: bool| {
            let all = (0..used.len()).filter(|&v| used[v] && is_free(v));
            all.filter(move |&v| self.integer[v] == integer)
        };
        let reals: Vec<usize> = free(false).collect();
        let integers: Vec<usize> = free(true).collect();
        // If they are many, unknowns are pairs that move together; what moves with others as well is the sum of them.
        let followers = match integers.len() > most_dense {
            true => followers(&integers, &sums, &closings),
            false => BTreeMap::new(),
        };
        for (_, form) in &mut sums {
            for (variable, c) in form.clone() {
                if let Some(followers) = followers.get(&(variable as usize)) {
                    add(form, followers, c);
                }
            }
        }
        let mut number = vec![u32::MAX; used.len()];
        for (k, &v) in (0..).zip(reals.iter().chain(&integers)) {
            number[v] = k;
        }
        let unknown = number.clone();
        let followed = followers.len();
        sums.extend(followers.into_iter().map(|(v, mut form)| {
            form.insert(v as u32, 1);
            (v, form)
        }));
        for (k, &(v, _)) in ((reals.len() + integers.len()) as u32..).zip(&sums) {
            number[v] = k;
        }
        let mut closings = Rows::of(closings.iter(), &number);
        for (v, form) in &sums[sums.len() - followed..] {
            closings.push(form, &unknown, Some(number[*v]));
        }
        // Sums are of integers alone.
        let integer: Vec<u32> = unknown
            .iter()
            .map(|n| n.wrapping_sub(reals.len() as u32))
            .collect();
        Seams {
            rows: Rows::of(forms.iter(), &number),
            reals: reals.len(),
            integers: integers.len(),
            sums: Rows::of(sums.iter().map(|(_, form)| form), &integer),
            closings,
            pinned: Vec::new(),
        }
    }
}

fn gcd(a: i64, b: i64) -> i64 {
    if b == 0 { a } else { gcd(b, a % b) }
}
