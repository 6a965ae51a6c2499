//! Helpers for the tests of the whole house.
//!
//! [`cases`] makes generated tests repeatable, [`same_on_any_threads`] holds a verb to its promise about bits, and
//! `gpu_or_skip` lets a machine without an adapter pass the rest. [`faults`] spoils files. Under the feature `testing`.

pub mod faults;

/// The GPU, or `None` with a loud line when there is none. With the environment variable
/// `GEOM_REQUIRE_GPU` set, its absence is a failure: CI sets it.
#[cfg(feature = "wgpu")]
pub fn gpu_or_skip() -> Option<crate::Wgpu> {
    match crate::Wgpu::new() {
        Ok(gpu) => Some(gpu),
        Err(error) if std::env::var_os("GEOM_REQUIRE_GPU").is_some() => {
            panic!("GEOM_REQUIRE_GPU is set, but there is no GPU: {error}")
        }
        Err(error) => {
            skipped(&format!("no wgpu adapter ({error})"));
            None
        }
    }
}

/// Says on stderr that a test did nothing, and how many have in this program, so that the last such line has them all. It is
/// heard without `--nocapture`: what a test prints is held back, what it writes is not.
#[cfg(feature = "wgpu")]
fn skipped(why: &str) {
    use std::io::Write;
    use std::sync::atomic::{AtomicUsize, Ordering};
    static COUNT: AtomicUsize = AtomicUsize::new(0);
    let count = COUNT.fetch_add(1, Ordering::Relaxed) + 1;
    // Where nobody listens there is nobody to tell.
    let _ = writeln!(
        std::io::stderr(),
        "SKIPPED, not passed ({count} so far): {why}"
    );
}

/// So many cases of a property, the same every time: a gate must not depend on luck.
pub fn cases(number: u32) -> proptest::test_runner::Config {
    proptest::test_runner::Config {
        rng_seed: proptest::test_runner::RngSeed::Fixed(11),
        ..proptest::test_runner::Config::with_cases(number)
    }
}

/// Runs `f` on 1, 2 and 5 threads and asserts that the results are equal. The function runs once per pool, so that what
/// it computes from must not change in between.
///
/// # Panics
/// If a result differs from that of one thread. The values are not printed: they may be whole meshes.
pub fn same_on_any_threads<T: PartialEq + std::fmt::Debug + Send>(f: impl Fn() -> T + Sync) -> T {
    let on = |threads| {
        rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .expect("a thread pool")
            .install(&f)
    };
    let reference = on(1);
    for threads in [2, 5] {
        assert!(
            on(threads) == reference,
            "{threads} threads give another result than one"
        );
    }
    reference
}

/// Tests that run the laws of a crate that stand in its sources, by their names in `inside`, and `RUN`, these names.
///
/// ```ignore
/// geom_core::laws! { dual_contour::inside; diagonals_are_best fans_are_best }
/// ```
#[macro_export]
macro_rules! laws {
    ($crate_name:ident::inside; $($name:ident)*) => {
        $(
            #[test]
            fn $name() {
                $crate_name::inside::$name();
            }
        )*
        const RUN: &[&str] = &[$(stringify!($name)),*];
    };
}

/// Asserts that the laws of `laws!` are those that there are, so that none is forgotten.
///
/// # Panics
/// If a name is in one of the lists only, or oftener in one than in the other.
pub fn every_law_is_run<'a>(there: impl Iterator<Item = &'a str>, run: &[&'a str]) {
    let mut there = Vec::from_iter(there);
    let mut run = run.to_vec();
    there.sort_unstable();
    run.sort_unstable();
    assert_eq!(there, run);
}

/// The names that a source hands on with `pub use`: the last parts of paths, and single names with an underscore. Lines
/// of the head (`//!`) do not count. It is a reading by words, not by grammar: good for files that are lists of
/// `pub use`.
pub fn handed_on(source: &str) -> impl Iterator<Item = &str> {
    let lines = source.lines().filter(|line| !line.starts_with("//!"));
    let words =
        lines.flat_map(|line| line.split(|c: char| !(c.is_alphanumeric() || c == '_' || c == ':')));
    let names = words.filter_map(|word| match word.rsplit_once("::") {
        Some((_, name)) => Some(name),
        None if word.contains('_') => Some(word),
        None => None,
    });
    names.filter(|name| !name.is_empty())
}
