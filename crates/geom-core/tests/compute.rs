//! What everything is computed with: numbers, sums, colours, comparisons, errors.

use std::error::Error as _;
use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};
use std::thread;

use geom_core::compute::BackendError;
use geom_core::compute::coloring::Coloring;
use geom_core::compute::parallel::{self, argmax, sorted_by_number, sum};
use geom_core::compute::random::SplitMix64;
use geom_core::options::OutOfRange;
use geom_core::testing::same_on_any_threads;
use geom_core::{Agreement, Cancelled};
use proptest::prelude::*;

#[test]
fn errors_of_backends_keep_what_they_were() {
    let error = BackendError::new(Cancelled);
    assert_eq!(error, BackendError::new("cancelled by the caller"));
    assert_eq!(error.downcast_ref(), Some(&Cancelled));
    assert!(error != BackendError::new("something else"));
    let outer = BackendError::new(Outer { source: error });
    assert_eq!(outer.to_string(), "outer");
    let source = outer.source().expect("its cause");
    assert_eq!(source.to_string(), "cancelled by the caller");
}

#[derive(Debug, thiserror::Error)]
#[error("outer")]
struct Outer {
    source: BackendError,
}

#[test]
fn a_comparison_can_fail() {
    let bound = Agreement::Bounded {
        relative: 1e-3,
        absolute: 1e-6,
    };
    assert_eq!(bound.first_break(&[1.0, 2.0], &[1.0005, 2.0]), None);
    assert_eq!(
        bound.first_break(&[1.0, 2.0], &[1.0, 2.1]).map(|b| b.index),
        Some(1)
    );
    assert_eq!(
        bound.first_break(&[1.0], &[1.0, 2.0]).map(|b| b.index),
        Some(1)
    );
    assert!(bound.first_break(&[1.0], &[f64::NAN]).is_some());
    assert_eq!(
        Agreement::Exact
            .first_break(&[1u32, 2], &[1, 3])
            .map(|b| b.index),
        Some(1)
    );
    assert_eq!(Agreement::Exact.first_break(&[0.0f32], &[-0.0f32]), None);
}

proptest! {
    #[test]
    fn neighbours_differ(links in prop::collection::vec((0..50u32, 0..50u32), 0..300)) {
        let mut ring = vec![Vec::new(); 50];
        for &(a, b) in links.iter().filter(|l| l.0 != l.1) {
            ring[a as usize].push(b);
            ring[b as usize].push(a);
        }
        let colors = Coloring::greedy(50, |v| ring[v as usize].iter().copied());
        for (v, neighbors) in ring.iter().enumerate() {
            let color = colors.color[v];
            prop_assert!(neighbors.iter().all(|&w| colors.color[w as usize] != color));
            prop_assert!((color as usize) <= neighbors.len());
            prop_assert!(colors.groups[color as usize].contains(&(v as u32)));
        }
        prop_assert_eq!(colors.groups.iter().map(Vec::len).sum::<usize>(), 50);
    }
}

#[test]
fn sums_do_not_depend_on_threads() {
    let f = |i: usize| ((i as f64) * 0.7).sin() / (1.0 + i as f64);
    let on = |threads| {
        rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .unwrap()
            .install(|| (sum(100_000, f).to_bits(), argmax(100_000, f)))
    };
    assert_eq!(on(1), on(2));
    assert_eq!(on(1), on(5));
}

#[test]
fn ties_go_to_the_lowest_index_and_nan_never_wins() {
    let v = [f64::NAN, 1.0, 3.0, 3.0, f64::NAN];
    assert_eq!(argmax(v.len(), |i| v[i]), Some((2, 3.0)));
    assert_eq!(argmax(0, |_| 0.0), None);
}

#[test]
fn groups_first_gives_the_same_order() {
    let mut random = SplitMix64::new(3);
    for (len, most) in [
        (0, 1),
        (1, 1),
        (1000, 1),
        (1000, 37),
        (1000, 3000),
        (50, 1 << 31),
    ] {
        let items: Vec<(u32, u32)> = (0..len)
            .map(|_| (random.below(most) as u32, random.below(5) as u32))
            .collect();
        let mut expected = items.clone();
        expected.sort_unstable();
        let sorted = sorted_by_number(len, |i| items[i], |item| item.0);
        assert_eq!(sorted, expected, "{len} below {most}");
    }
}

#[test]
fn the_numbers_are_those_of_the_paper() {
    // The reference implementation (Vigna, splitmix64.c) from the seed 1234567.
    let mut random = SplitMix64::new(1_234_567);
    let expected: [u64; 3] = [
        6_457_827_717_110_365_317,
        3_203_168_211_198_807_973,
        9_817_491_932_198_370_423,
    ];
    for (n, expected) in expected.into_iter().enumerate() {
        assert_eq!(SplitMix64::new(1_234_567).nth(n as u64), expected);
        assert_eq!(random.next_u64(), expected);
    }
    assert_eq!(SplitMix64::new(1_234_567).skip(3), random);
}

#[test]
fn numbers_fill_their_intervals_evenly() {
    let mut random = SplitMix64::new(3);
    let n = 20_000;
    let (mut unit, mut symmetric, mut tenths) = (0.0, 0.0, [0; 10]);
    for _ in 0..n {
        let (u, s) = (random.unit(), random.symmetric());
        assert!((0.0..1.0).contains(&u) && (-1.0..1.0).contains(&s));
        unit += u;
        symmetric += s;
        tenths[random.below(10)] += 1;
    }
    // Standard deviations of the means are 0.002 and 0.004; of the counts, 42.
    assert!((unit / f64::from(n) - 0.5).abs() < 0.01);
    assert!((symmetric / f64::from(n)).abs() < 0.02);
    assert!(tenths.iter().all(|&t: &i32| (t - 2000).abs() < 200));
}

#[test]
fn values_are_short() {
    let of = |value: f64| OutOfRange::new("option", value, "be otherwise").value;
    assert_eq!([of(0.25), of(f64::NAN)], ["0.25", "NaN"]);
    assert_eq!([of(1e-310), of(-1e200)], ["1e-310", "-1e200"]);
    let text = OutOfRange::new("option", "a path that is rather long", "be shorter");
    assert_eq!(text.value, "a path that is rather long");
}

/// Within `alone` loops run where they are called, and after it, also where that ended in a panic, on the pool's threads again.
#[test]
fn loops_alone_stay_on_their_thread() {
    let here = thread::current().id();
    let is_here = || {
        let mut seen = vec![false; 64];
        parallel::for_chunks(&mut seen, 3, |_, seen| {
            seen.fill(thread::current().id() == here);
        });
        seen.extend(parallel::map(64, |_| thread::current().id() == here));
        seen.push(parallel::inside(|| thread::current().id() == here));
        seen
    };
    assert!(is_here().iter().all(|here| !here));
    // One within another does not end the outer one.
    assert!(
        parallel::alone(|| [parallel::alone(is_here), is_here()].concat())
            .iter()
            .all(|&here| here)
    );
    assert!(std::panic::catch_unwind(|| parallel::alone(|| panic!("within"))).is_err());
    assert!(is_here().iter().all(|here| !here));
}

#[test]
fn loops_give_what_their_items_give_in_order() {
    for n in [0, 1, 2, 31, 32, 33, 1000] {
        let made = same_on_any_threads(|| {
            let squares = parallel::map(n, |i| i * i);
            let roots = parallel::map_each(&squares, |s| s.isqrt());
            let steps = parallel::flat_map(n, |i| 0..i % 3);
            let mut sums = roots.clone();
            parallel::for_chunks(&mut sums, 3, |k, chunk| {
                chunk.iter_mut().for_each(|x| *x += k)
            });
            let zeros = parallel::map_init(n, Vec::new, |work, i| {
                work.clear();
                work.resize(i % 5, i);
                work.len()
            });
            let same = parallel::map_each_init(&zeros, || 0, |_, &z| z);
            assert_eq!(zeros, same);
            let mut twice = roots.clone();
            parallel::for_each(&mut twice, |i, x| *x += i);
            parallel::for_each_init(&mut twice, Vec::new, |work, i, x| {
                work.push(i);
                *x += work.last().map_or(0, |last| last % 7);
            });
            assert!((0..n).all(|i| twice[i] == 2 * i + i % 7));
            (squares, roots, steps, sums, zeros)
        });
        assert_eq!(made.0, (0..n).map(|i| i * i).collect::<Vec<_>>());
        assert_eq!(made.1, (0..n).collect::<Vec<_>>());
        assert_eq!(made.2, (0..n).flat_map(|i| 0..i % 3).collect::<Vec<_>>());
        assert_eq!(made.3, (0..n).map(|i| i + i / 3).collect::<Vec<_>>());
        assert_eq!(made.4, (0..n).map(|i| i % 5).collect::<Vec<_>>());
    }
}

#[test]
fn loops_over_indices_see_each_once_and_searches_find_the_first() {
    for n in [0, 1, 2, 31, 32, 33, 1000] {
        let seen: Vec<AtomicUsize> = (0..n).map(|_| AtomicUsize::new(0)).collect();
        parallel::for_indices(n, |i| _ = seen[i].fetch_add(1, Relaxed));
        assert!(seen.iter().all(|times| times.load(Relaxed) == 1));
        for (least, every) in [(0, 1), (1, 1), (0, 7), (n / 2, 3), (n, 1)] {
            let fits = |i: usize| i >= least && (i - least).is_multiple_of(every);
            let found = same_on_any_threads(|| parallel::first(n, fits));
            assert_eq!(found, (0..n).find(|&i| fits(i)));
            assert_eq!(parallel::first(n, |i| i + 1 == n), n.checked_sub(1));
        }
    }
}
