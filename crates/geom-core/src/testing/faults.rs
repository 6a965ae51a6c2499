//! Files with faults, for tests of readers. The same number makes the same faults.
//!
//! A test takes some good files as seeds, spoils them in ten thousands of ways by [`spoilt`] and asks of the reader
//! that it neither panics nor runs on. A case is named by its number alone, so that a failure is had again on any
//! machine.

use std::ops::Range;

use crate::compute::random::SplitMix64;

/// A stream of numbers for one case.
pub struct Random(SplitMix64);

impl Random {
    /// Of a case.
    pub fn new(case: u64) -> Self {
        // Mixed: streams from seeds that lie a step of the generator apart are the same but for their first number.
        Self(SplitMix64::new(SplitMix64::new(case).next_u64()))
    }

    /// Below `n`, 0 if that is 0.
    pub fn below(&mut self, n: usize) -> usize {
        self.0.below(n.max(1))
    }

    /// Any of them.
    ///
    /// # Panics
    /// If there are none.
    pub fn one_of<'a, T>(&mut self, of: &'a [T]) -> &'a T {
        &of[self.below(of.len())]
    }

    /// A short range of `0..n`. It starts anywhere and is 1 to 4, 16, 64 or `n` long, cut off at `n`: most faults are
    /// small, some are not. Empty for `n = 0`.
    pub fn range(&mut self, n: usize) -> Range<usize> {
        let start = self.below(n);
        let longest = *self.one_of(&[4, 16, 64, n]);
        start..(start + 1 + self.below(longest)).min(n)
    }

    /// In −1…1.
    pub fn symmetric(&mut self) -> f64 {
        self.0.symmetric()
    }
}

/// What counts and coordinates should never be. Each stands where a reader takes a number for granted: signs, the ends
/// of 32 and 64 bits and what lies beyond them, what is not finite, other bases, nothing at all, and quotes that are
/// not closed.
const WORDS: &[&str] = &[
    "-1",
    "0",
    "1",
    "2",
    "3",
    "7",
    "65536",
    "2147483647",
    "4294967295",
    "4294967296",
    "-2147483648",
    "18446744073709551615",
    "99999999999999999999",
    "nan",
    "inf",
    "-inf",
    "1e400",
    "1e-400",
    "1e38",
    "0x10",
    "",
    "1.5",
    "\"",
    "'",
    ";",
    "<",
    "é",
];

/// Numbers at the ends of what machines count. Small counts, the ends of 8 to 64 bits, and the patterns of infinity and
/// NaN in f32 and f64.
const ENDS: &[u64] = &[
    0,
    1,
    2,
    3,
    4,
    5,
    255,
    256,
    65_535,
    0x7fff_ffff,
    0x8000_0000,
    0xffff_ffff,
    0x1_0000_0000,
    0x7fff_ffff_ffff_ffff,
    u64::MAX,
    0x7f80_0000,
    0x7fc0_0000,
    0x7ff0_0000_0000_0000,
];

/// A file with one to four faults: bits, words, pieces cut out, doubled or taken from another seed. The result may be
/// empty, and may be a valid file all the same.
///
/// # Panics
/// If there is no seed.
pub fn spoilt(random: &mut Random, seeds: &[Vec<u8>]) -> Vec<u8> {
    let mut bytes = random.one_of(seeds).clone();
    for _ in 0..1 + random.below(4) {
        let n = bytes.len();
        if n == 0 {
            break;
        }
        // Half of the faults strike the beginning, where counts and keywords are.
        let place = if random.below(2) == 0 {
            random.below(n.min(200))
        } else {
            random.below(n)
        };
        match random.below(8) {
            0 => bytes[place] ^= 1 << random.below(8),
            1 => bytes[place] = random.below(256) as u8,
            2 if random.below(4) == 0 => bytes.truncate(place),
            2 => drop(bytes.drain(random.range(n))),
            3 => {
                let copy = bytes[random.range(n)].to_vec();
                bytes.splice(place..place, copy);
            }
            4 => {
                let other = random.one_of(seeds);
                let piece = other[random.range(other.len())].to_vec();
                bytes.splice(place..(place + piece.len()).min(n), piece);
            }
            5 | 6 => {
                let in_word = |b: &u8| !b.is_ascii_whitespace() && *b != b'"';
                let start = place + bytes[place..].iter().position(in_word).unwrap_or(0);
                let end = bytes[start..].iter().position(|b| !in_word(b));
                let end = end.map_or(n, |length| start + length);
                bytes.splice(start..end, random.one_of(WORDS).bytes());
            }
            _ => {
                let width = *random.one_of(&[1, 2, 4, 8]);
                let place = place / width * width;
                let word = random.one_of(ENDS);
                let word = match random.below(4) {
                    0 => word.to_be_bytes()[8 - width..].to_vec(),
                    _ => word.to_le_bytes()[..width].to_vec(),
                };
                for (to, from) in bytes[place..].iter_mut().zip(word) {
                    *to = from;
                }
            }
        }
    }
    bytes
}
