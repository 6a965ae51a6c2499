//! Independent integers whose moves are local.
//!
//! One singular vertex that moves alone takes with it all translations from there to the root of the cut: a move by one shears the map
//! along half of the surface. Where the next singular vertex on the way moves as well, by what undoes that, the rest stays as it is. Such
//! pairs are the unknowns: `z = T y`, a column of T having a one on the diagonal and ±1 at the partner's place. Partners are
//! always nearer to the root, so that T is triangular in some order and of determinant 1, and y are integers exactly where z
//! are. Rounding with all of the energy known is no better over y; moves that mend change a fourth as many triangles.

use std::collections::{BTreeMap, BTreeSet, VecDeque};

use geom_core::compute::parallel;

use super::Form;

/// Partners that are looked at per integer.
const MOST: usize = 24;
/// What a partner costs, in translations: the triangles around it move, too.
const PRICE: usize = 4;

/// Per integer that is a partner of others, what it is the sum of besides itself. All by variable.
pub(super) fn followers(
    integers: &[usize],
    sums: &[(usize, Form)],
    closings: &[Form],
) -> BTreeMap<usize, Form> {
    let mut followers: BTreeMap<usize, Form> = BTreeMap::new();
    let partners = partners(integers, sums, closings);
    for (&own, partner) in integers.iter().zip(partners) {
        if let Some((other, by)) = partner {
            let form = followers.entry(integers[other]).or_default();
            form.insert(own as u32, by);
        }
    }
    followers
}

/// Which integer moves along with each, and by how much for one of it. `sums` are over integers, `closings` over both.
fn partners(
    integers: &[usize],
    sums: &[(usize, Form)],
    closings: &[Form],
) -> Vec<Option<(usize, i64)>> {
    let mut place: BTreeMap<u32, usize> = BTreeMap::new();
    for (at, &variable) in integers.iter().enumerate() {
        place.insert(variable as u32, at);
    }
    // Which translations each integer takes with it.
    let mut columns: Vec<Vec<(u32, i64)>> = vec![Vec::new(); integers.len()];
    for (sum, (_, form)) in (0u32..).zip(sums) {
        for (variable, &c) in form {
            columns[place[variable]].push((sum, c));
        }
    }
    let near = Neighbours::of(closings);
    parallel::map(integers.len(), |at| {
        let own = &columns[at];
        let mut best = (own.len(), None);
        let is_inner = |&other: &usize| (columns[other].len(), other) < (own.len(), at);
        let others = near.around(integers[at] as u32, MOST, |v| place.get(&v).copied());
        for other in others.into_iter().filter(is_inner) {
            for by in [-1, 1] {
                let left = PRICE + left(own, &columns[other], by);
                if left < best.0 {
                    best = (left, Some((other, by)));
                }
            }
        }
        best.1
    })
}

/// How many translations an integer moves if another moves along, so many times as far.
fn left(own: &[(u32, i64)], other: &[(u32, i64)], by: i64) -> usize {
    let (mut a, mut b, mut left) = (0, 0, own.len() + other.len());
    while a < own.len() && b < other.len() {
        match own[a].0.cmp(&other[b].0) {
            std::cmp::Ordering::Less => a += 1,
            std::cmp::Ordering::Greater => b += 1,
            std::cmp::Ordering::Equal => {
                left -= 1 + usize::from(own[a].1 + by * other[b].1 == 0);
                (a, b) = (a + 1, b + 1);
            }
        }
    }
    left
}

/// Variables that have a closing in common.
struct Neighbours<'a> {
    closings: &'a [Form],
    /// Per variable, its closings.
    of: BTreeMap<u32, Vec<u32>>,
}

impl<'a> Neighbours<'a> {
    fn of(closings: &'a [Form]) -> Self {
        let mut of: BTreeMap<u32, Vec<u32>> = BTreeMap::new();
        for (row, closing) in (0..).zip(closings) {
            for &variable in closing.keys() {
                of.entry(variable).or_default().push(row);
            }
        }
        Self { closings, of }
    }

    /// Up to so many integers around one, the nearest first.
    fn around(
        &self,
        variable: u32,
        most: usize,
        integer: impl Fn(u32) -> Option<usize>,
    ) -> Vec<usize> {
        let mut seen = BTreeSet::from([variable]);
        let mut open = VecDeque::from([variable]);
        let mut found = Vec::new();
        while let Some(next) = open.pop_front() {
            for &row in self.of.get(&next).into_iter().flatten() {
                for &other in self.closings[row as usize].keys() {
                    if !seen.insert(other) {
                        continue;
                    }
                    found.extend(integer(other));
                    if found.len() >= most {
                        return found;
                    }
                    open.push_back(other);
                }
            }
        }
        found
    }
}
