//! Loops and sums with the same bits for any number of threads.
//!
//! A sum of floating-point numbers depends on the order in which they are added, and threads finish in any order. So sums
//! are cut into fixed chunks ([`CHUNK`]), and what these give is added in their order. Loops that give a value per item
//! ([`map`] and those after it) are cut as the threads need it: there the cuts leave no trace.

use std::cell::Cell;
use std::ops::Range;
use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};
use std::sync::{Mutex, PoisonError};

use rayon::prelude::*;

/// Elements per chunk of a parallel sum. Part of the result: another number, other last bits. Large enough that handing
/// a chunk to a thread costs little beside it.
pub const CHUNK: usize = 4096;

/// Runs `f` on a thread of the pool, so that the loops in it start without handing work over to
/// another thread: worth it where they are many and short. Within [`alone`] it stays where it is.
pub fn inside<T: Send>(f: impl FnOnce() -> T + Send) -> T {
    if ALONE.get() {
        f()
    } else {
        rayon::scope(|_| f())
    }
}

thread_local! {
    /// Do loops on this thread stay there?
    static ALONE: Cell<bool> = const { Cell::new(false) };
}

/// Runs `f` with its loops on this thread alone. Other threads must be woken for each of them, which takes as long as some thousand
/// operations: where loops are shorter than that and many, or run in a loop of which each thread has a share anyway.
///
/// ```
/// use geom_core::compute::parallel;
/// assert_eq!(parallel::alone(|| parallel::sum(5, |i| i as f64)), 10.0);
/// ```
///
/// It gives what it gives with them, as all loops here do. [`extend`], sorts and the loops of other crates do not ask.
pub fn alone<T>(f: impl FnOnce() -> T) -> T {
    struct Back(bool);
    impl Drop for Back {
        fn drop(&mut self) {
            ALONE.set(self.0);
        }
    }
    let _back = Back(ALONE.replace(true));
    f()
}

/// `Σ f(i)` for `i < n`, over fixed chunks combined in order.
///
/// ```
/// assert_eq!(geom_core::compute::parallel::sum(5, |i| i as f64), 10.0);
/// ```
///
/// 0 for `n = 0`.
pub fn sum(n: usize, f: impl Fn(usize) -> f64 + Sync) -> f64 {
    fold_chunks(n, |range| range.map(&f).sum::<f64>())
        .into_iter()
        .sum()
}

/// The largest `f(i)` for `i < n`, and its lowest index; `None` for `n = 0`. NaN never wins.
pub fn argmax(n: usize, f: impl Fn(usize) -> f64 + Sync) -> Option<(usize, f64)> {
    fold_chunks(n, |range| {
        range.map(|i| (i, f(i))).fold(None, later_only_if_larger)
    })
    .into_iter()
    .flatten()
    .fold(None, later_only_if_larger)
}

/// Chunks are folded in order by the same rule as the items in them, so that of equal values the lowest index wins in
/// both.
fn later_only_if_larger(best: Option<(usize, f64)>, next: (usize, f64)) -> Option<(usize, f64)> {
    match best {
        Some(b) if next.1 > b.1 => Some(next),
        None if !next.1.is_nan() => Some(next),
        _ => best,
    }
}

/// One value per fixed chunk of `0..n`, in chunk order. `f` is called with ranges of [`CHUNK`] indices, the last one
/// shorter, and may add within a range in the order that it likes.
pub fn fold_chunks<T: Send>(n: usize, f: impl Fn(Range<usize>) -> T + Sync) -> Vec<T> {
    map(
        n.div_ceil(CHUNK),
        |c| f(c * CHUNK..((c + 1) * CHUNK).min(n)),
    )
}

/// `[f(0), f(1), …, f(n - 1)]`.
///
/// ```
/// assert_eq!(geom_core::compute::parallel::map(3, |i| i * i), [0, 1, 4]);
/// ```
pub fn map<T: Send>(n: usize, f: impl Fn(usize) -> T + Sync) -> Vec<T> {
    gather(n, &|piece| piece.map(&f).collect())
}

/// `f` of each item, in order.
pub fn map_each<S: Sync, T: Send>(items: &[S], f: impl Fn(&S) -> T + Sync) -> Vec<T> {
    gather(items.len(), &|piece| items[piece].iter().map(&f).collect())
}

/// [`map`] with something to work in, made once for a stretch of neighbours and not for each.
pub fn map_init<W, T: Send>(
    n: usize,
    init: impl Fn() -> W + Sync,
    f: impl Fn(&mut W, usize) -> T + Sync,
) -> Vec<T> {
    gather(n, &|piece| {
        let mut work = init();
        piece.map(|i| f(&mut work, i)).collect()
    })
}

/// [`map_each`] with something to work in, made once for a stretch of neighbours and not for each.
pub fn map_each_init<S: Sync, W, T: Send>(
    items: &[S],
    init: impl Fn() -> W + Sync,
    f: impl Fn(&mut W, &S) -> T + Sync,
) -> Vec<T> {
    gather(items.len(), &|piece| {
        let mut work = init();
        items[piece].iter().map(|s| f(&mut work, s)).collect()
    })
}

/// Adds `f(0)`, `f(1)`, …, `f(n - 1)` to a list, each straight to where it belongs. For long lists of what costs little to
/// make: there the pages of the memory, which the system hands out as they are first touched, cost more. (The
/// compiler pays for it at each place, as it does not for [`map`].)
///
/// ```
/// let mut list = vec![7];
/// geom_core::compute::parallel::extend(&mut list, 3, |i| i * i);
/// assert_eq!(list, [7, 0, 1, 4]);
/// ```
pub fn extend<T: Send>(list: &mut Vec<T>, n: usize, f: impl Fn(usize) -> T + Send + Sync) {
    /// Fewer are not worth a thread.
    const LEAST: usize = 1024;
    let all = (0..n).into_par_iter().with_min_len(LEAST);
    list.par_extend(all.map(f));
}

/// `f` of each piece of `size` values, the last one shorter, with its number.
///
/// # Panics
/// If `size` is 0.
pub fn for_chunks<T: Send>(values: &mut [T], size: usize, f: impl Fn(usize, &mut [T]) + Sync) {
    in_chunks(values, size, &f);
}

/// `f` of each value, with its index.
///
/// ```
/// let mut values = [5, 5, 5];
/// geom_core::compute::parallel::for_each(&mut values, |i, value| *value += i);
/// assert_eq!(values, [5, 6, 7]);
/// ```
///
/// Where each goes with something else, that is looked up by the index, or changes with it: [`for_each_pair`].
pub fn for_each<T: Send>(values: &mut [T], f: impl Fn(usize, &mut T) + Sync) {
    for_each_init(values, || (), |(), i, value| f(i, value));
}

/// [`for_each`] with something to work in, made once for a stretch of neighbours and not for each.
pub fn for_each_init<T: Send, W>(
    values: &mut [T],
    init: impl Fn() -> W + Sync,
    f: impl Fn(&mut W, usize, &mut T) + Sync,
) {
    let size = values.len().div_ceil(pieces_of(values.len()).max(1));
    in_chunks(values, size.max(1), &|piece, values| {
        let mut work = init();
        for (i, value) in (piece * size..).zip(values) {
            f(&mut work, i, value);
        }
    });
}

/// `f` of the values with the same index in two lists, which are of one length.
///
/// ```
/// let (mut sums, mut products) = ([1, 2], [1, 2]);
/// geom_core::compute::parallel::for_each_pair(&mut sums, &mut products, |i, s, p| (*s, *p) = (*s + i, *p * i));
/// assert_eq!((sums, products), ([1, 3], [0, 2]));
/// ```
///
/// # Panics
/// If their lengths differ.
pub fn for_each_pair<A: Send, B: Send>(
    first: &mut [A],
    second: &mut [B],
    f: impl Fn(usize, &mut A, &mut B) + Sync,
) {
    assert_eq!(first.len(), second.len(), "two lists of one length");
    let size = first.len().div_ceil(pieces_of(first.len()).max(1)).max(1);
    let mut chunks: Vec<_> = first
        .chunks_mut(size)
        .zip(second.chunks_mut(size))
        .collect();
    in_chunks(&mut chunks, 1, &|piece, chunks| {
        for (first, second) in chunks {
            let values = first.iter_mut().zip(second.iter_mut());
            for (i, (first, second)) in (piece * size..).zip(values) {
                f(i, first, second);
            }
        }
    });
}

/// `f` of each `i < n`, for what it does elsewhere: to atomics, to files.
pub fn for_indices(n: usize, f: impl Fn(usize) + Sync) {
    in_pieces(n, &|_, piece| piece.for_each(&f));
}

/// The lowest `i < n` with `f(i)`. Little is asked beyond it.
///
/// ```
/// assert_eq!(geom_core::compute::parallel::first(9, |i| i * i > 10), Some(4));
/// assert_eq!(geom_core::compute::parallel::first(3, |i| i * i > 10), None);
/// ```
pub fn first(n: usize, f: impl Fn(usize) -> bool + Sync) -> Option<usize> {
    let lowest = AtomicUsize::new(n);
    in_pieces(n, &|_, mut piece| {
        let found = piece.find(|&i| i >= lowest.load(Relaxed) || f(i));
        found.inspect(|&i| _ = lowest.fetch_min(i, Relaxed));
    });
    Some(lowest.into_inner()).filter(|&i| i < n)
}

/// Compiled once per type of value: see [`gather`].
fn in_chunks<T: Send>(values: &mut [T], size: usize, f: &(dyn Fn(usize, &mut [T]) + Sync)) {
    let chunks: Vec<Mutex<&mut [T]>> = values.chunks_mut(size).map(Mutex::new).collect();
    each(chunks.len(), &|number| {
        f(
            number,
            &mut chunks[number]
                .lock()
                .unwrap_or_else(PoisonError::into_inner),
        );
    });
}

/// What `f(0)`, `f(1)`, …, `f(n - 1)` give, one after the other.
///
/// ```
/// assert_eq!(geom_core::compute::parallel::flat_map(4, |i| 0..i), [0, 0, 1, 0, 1, 2]);
/// ```
pub fn flat_map<I: IntoIterator<Item: Send>>(
    n: usize,
    f: impl Fn(usize) -> I + Sync,
) -> Vec<I::Item> {
    gather(n, &|piece| piece.flat_map(&f).collect())
}

/// Pieces per thread of a loop: more even out what takes longer in one place than in another.
const PIECES: usize = 16;

/// Into how many pieces a loop over `n` is cut.
fn pieces_of(n: usize) -> usize {
    let most = if ALONE.get() {
        1
    } else {
        PIECES * rayon::current_num_threads()
    };
    n.min(most)
}

/// `f` of consecutive ranges that make up `0..n`, one after the other. How many ranges there are depends on the number of
/// threads, so what `f` gives must not depend on where it is cut.
///
/// The loops of the house go through here and through [`each`], by reference to `f`, because a parallel iterator of rayon
/// is five to seven thousand lines of code to the compiler wherever one stands, and this one stands in one place.
fn gather<T: Send>(n: usize, f: &(dyn Fn(Range<usize>) -> Vec<T> + Sync)) -> Vec<T> {
    let pieces = pieces_of(n);
    if pieces < 2 {
        return f(0..n);
    }
    let parts: Vec<Mutex<Vec<T>>> = (0..pieces).map(|_| Mutex::default()).collect();
    in_pieces(n, &|piece, range| {
        let made = f(range);
        *parts[piece].lock().unwrap_or_else(PoisonError::into_inner) = made;
    });
    let mut parts: Vec<Vec<T>> = parts
        .into_iter()
        .map(|part| part.into_inner().unwrap_or_else(PoisonError::into_inner))
        .collect();
    let mut all = Vec::with_capacity(parts.iter().map(Vec::len).sum());
    for part in &mut parts {
        all.append(&mut std::mem::take(part));
    }
    all
}

/// `f` of the pieces of `0..n` and their numbers, in any order.
fn in_pieces(n: usize, f: &(dyn Fn(usize, Range<usize>) + Sync)) {
    let pieces = pieces_of(n);
    // Products of a length and a number of pieces, rounded down: ranges whose lengths differ by one at most.
    let start = |piece: usize| (n as u128 * piece as u128 / pieces as u128) as usize;
    each(pieces, &|piece| f(piece, start(piece)..start(piece + 1)));
}

/// `f(i)` for `i < n`, in any order.
fn each(n: usize, f: &(dyn Fn(usize) + Sync)) {
    if n < 2 || ALONE.get() {
        (0..n).for_each(f);
    } else {
        (0..n).into_par_iter().for_each(f);
    }
}

/// Exclusive prefix sum: where each group starts, and the total at the end (`counts.len() + 1`
/// values).
pub fn starts_of(counts: &[u32]) -> Vec<usize> {
    let mut starts = Vec::with_capacity(counts.len() + 1);
    let mut total = 0;
    starts.push(0);
    for &c in counts {
        total += c as usize;
        starts.push(total);
    }
    starts
}

/// `item(i)` for `i < n`, sorted, where they have small numbers to sort by first: vertices' faces, edges by their lower end.
/// Each is put into the group of its number (a counting sort), then the groups are sorted, in parallel: more than twice as
/// fast as a parallel comparison sort on two cores.
///
/// `number` must not fall where the order of the items rises.
///
/// ```
/// let edges = [[2, 0], [0, 9], [2, 7], [0, 1]];
/// let sorted = geom_core::compute::parallel::sorted_by_number(4, |i| edges[i], |e| e[0]);
/// assert_eq!(sorted, [[0, 1], [0, 9], [2, 0], [2, 7]]);
/// ```
///
/// `item` is called up to three times for each `i` and must give the same each time: better an expression than a
/// search. Where the largest number is more than four times `n`, all items are sorted by comparison instead.
pub fn sorted_by_number<T: Ord + Copy + Send>(
    n: usize,
    item: impl Fn(usize) -> T,
    number: impl Fn(&T) -> u32 + Sync,
) -> Vec<T> {
    let Some(most) = (0..n).map(|i| number(&item(i))).max() else {
        return Vec::new();
    };
    // Few items with large numbers: counting them would take longer.
    if most as usize / 4 > n {
        let mut items: Vec<T> = (0..n).map(item).collect();
        items.par_sort_unstable();
        return items;
    }
    let mut counts = vec![0; most as usize + 1];
    for i in 0..n {
        counts[number(&item(i)) as usize] += 1;
    }
    let mut places = starts_of(&counts);
    let mut items = vec![item(0); n];
    for item in (0..n).map(item) {
        let place = &mut places[number(&item) as usize];
        items[*place] = item;
        *place += 1;
    }
    items
        .par_chunk_by_mut(|a, b| number(a) == number(b))
        .for_each(<[T]>::sort_unstable);
    items
}
