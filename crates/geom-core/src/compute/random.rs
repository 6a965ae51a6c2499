//! A seeded generator: the same numbers on every machine and for any number of threads.
//!
//! Start vectors, jittered samples and tests take their numbers here, never from the system: a result that cannot be
//! had again cannot be checked. Good for sampling, not for secrets.

/// What the state of a [`SplitMix64`] grows by: 2⁶⁴ over the golden ratio, odd.
const STEP: u64 = 0x9e37_79b9_7f4a_7c15;

/// SplitMix64 (Steele, Lea and Flood, OOPSLA 2014): a counter, well mixed. Each of its numbers can be had
/// without those before it ([`SplitMix64::nth`]), so that loops over threads need no state.
///
/// ```
/// use geom_core::compute::random::SplitMix64;
/// let mut random = SplitMix64::new(7);
/// let third = random.nth(2);
/// let numbers = [(); 3].map(|()| random.next_u64());
/// assert_eq!(numbers[2], third);
/// assert!((-1.0..1.0).contains(&random.symmetric()));
/// ```
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SplitMix64 {
    state: u64,
}

impl SplitMix64 {
    /// The generator of a seed; any will do.
    pub fn new(seed: u64) -> Self {
        Self { state: seed }
    }

    /// 64 random bits.
    #[inline]
    pub fn next_u64(&mut self) -> u64 {
        self.state = self.state.wrapping_add(STEP);
        mixed(self.state)
    }

    /// What [`SplitMix64::next_u64`] gives after `n` others.
    #[inline]
    pub fn nth(&self, n: u64) -> u64 {
        mixed(
            self.state
                .wrapping_add(n.wrapping_add(1).wrapping_mul(STEP)),
        )
    }

    /// The generator `n` numbers on. Constant time: a counter is moved.
    #[must_use]
    pub fn skip(&self, n: u64) -> Self {
        Self::new(self.state.wrapping_add(n.wrapping_mul(STEP)))
    }

    /// A number in `[0, 1)`, a multiple of 2⁻⁵³.
    #[inline]
    pub fn unit(&mut self) -> f64 {
        (self.next_u64() >> 11) as f64 / (1u64 << 53) as f64
    }

    /// A number in `[−1, 1)`.
    #[inline]
    pub fn symmetric(&mut self) -> f64 {
        symmetric(self.next_u64())
    }

    /// A number below `n`. Panics if `n` is 0. The lower ones are a little likelier, by `n / 2⁶⁴`.
    #[inline]
    pub fn below(&mut self, n: usize) -> usize {
        (self.next_u64() % n as u64) as usize
    }
}

/// The number in `[−1, 1)` that 64 random bits stand for.
#[inline]
pub fn symmetric(bits: u64) -> f64 {
    (bits >> 11) as f64 / (1u64 << 52) as f64 - 1.0
}

fn mixed(mut z: u64) -> u64 {
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}
