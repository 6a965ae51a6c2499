//! Low-pass filter of the bounded field (§5.2.1): smooth shapes between two resolutions. The only file
//! that knows the FFT crates.
//!
//! The density itself must not be filtered: it reaches 70 and more inside, and a filter rings in proportion,
//! which makes surfaces out of nothing. `φ = G / (1 + G)` is ½ where `G` is 1, and lies between 0 and 1.

use std::sync::Arc;

use geom_core::compute::parallel;
use geom_core::options::{OutOfRange, require};
use geom_core::{LatticeValues, ScalarGrid};
use realfft::RealFftPlanner;
use realfft::num_complex::Complex32;
use rustfft::{Fft, FftPlanner};

use crate::error::Error;

/// How the response falls around the cut-off frequency.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(rename_all = "kebab-case"))]
pub enum Shape {
    /// `2^(−(f / f_c)² / 2)`: no ringing.
    #[default]
    Gaussian,
    /// `1 / √(1 + (f / f_c)^8)`, fourth order.
    Butterworth,
    /// 1 up to `f_c`, 0 beyond: rings.
    Ideal,
}

/// How to filter.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct LowPass {
    /// `1 / f_c`: waves shorter than this are damped, Å.
    /// Between 0.001 and 10000. The larger, the smoother the shape; details much smaller than it vanish, and thin parts
    /// with them. Waves shorter than twice the spacing are not on the lattice anyhow.
    pub cutoff_length: f64,
    /// How the response falls.
    pub shape: Shape,
    /// Most bytes for the spectrum.
    pub max_memory: u64,
}

impl Default for LowPass {
    fn default() -> Self {
        Self {
            cutoff_length: 4.0,
            shape: Shape::default(),
            max_memory: 4 << 30,
        }
    }
}

impl LowPass {
    /// Is every field in its range?
    pub fn check(&self) -> Result<(), OutOfRange> {
        let l = self.cutoff_length;
        require(
            (1e-3..=1e4).contains(&l),
            "cutoff_length",
            l,
            "be in [0.001, 10000] Å",
        )
    }

    /// The response at a squared frequency, in units of the squared cut-off frequency.
    fn response(&self, squared: f64) -> f64 {
        match self.shape {
            Shape::Gaussian => (-0.5 * squared).exp2(),
            Shape::Butterworth => 1.0 / (1.0 + squared.powi(4)).sqrt(),
            Shape::Ideal => f64::from(u8::from(squared <= 1.0)),
        }
    }
}

/// `φ` above this would leave the range of densities.
const FULL: f32 = 0.9999;

/// Filters a dense density. The result is a density again: its surface is at 1, and a response of 1
/// everywhere would give the input. The input must hold true values (no constant fill) wherever it is within
/// two cut-off lengths of the surface, and its box should lie that far out too; beyond it counts as 0.
///
/// Negative values count as 0, infinite ones as very dense, and what would come back above 9999 is cut to that.
/// [`Shape::Ideal`] and [`Shape::Butterworth`] ring, so that values far outside may be slightly below 0.
///
/// Runs on the CPU, whatever the backend of the sampling was.
/// It takes `O(n log n)` for `n` points of the padded lattice, and 8 bytes for each of them at its peak, besides the
/// grid that comes out.
///
/// # Errors
/// A cut-off length out of its range, or [`Error::TooLargeToFilter`]. A grid without points comes back as it is.
///
/// ```
/// use gauss_density::{LowPass, Model, Options, low_pass, sample};
/// use geom_core::{Cpu, Point3, Run};
/// # fn main() -> Result<(), gauss_density::Error> {
/// let model = Model::new(vec![Point3::origin()], vec![3.0], vec![0.5], vec![])?;
/// let options = Options { spacing: 1.0, margin: Some(12.0), ..Options::default() };
/// let dense = sample(&model, &options, Run::on(&Cpu))?.grid;
/// let smooth = low_pass(&dense, &LowPass { cutoff_length: 4.0, ..LowPass::default() })?;
/// let inside = |values: &[f32]| values.iter().filter(|&&g| g >= 1.0).count();
/// assert!(inside(smooth.values()) > 0 && inside(smooth.values()) <= inside(dense.values()));
/// # Ok(())
/// # }
/// ```
pub fn low_pass(grid: &ScalarGrid, options: &LowPass) -> Result<ScalarGrid, Error> {
    options.check()?;
    let lattice = *grid.lattice();
    if lattice.is_empty() {
        return Ok(grid.clone());
    }
    let pad = (2.0 * options.cutoff_length / lattice.spacing).ceil();
    // As many as there are numbers for stand for more.
    let pad = pad.min(1e18) as u128;
    let sizes = lattice.counts.map(|n| good_size(n as u128 + pad));
    // The spectrum, its transpose, and the result.
    let [nx, ny, nz] = sizes;
    let spectrum = [ny, nz, 16]
        .into_iter()
        .fold(nx / 2 + 1, u128::saturating_mul);
    let bytes = spectrum.saturating_add(lattice.points().saturating_mul(4));
    if bytes > u128::from(options.max_memory) {
        return Err(Error::TooLargeToFilter {
            bytes,
            limit: options.max_memory,
        });
    }
    let [nx, ny, nz] = sizes.map(|n| n as usize);
    let half = nx / 2 + 1;
    // Padded by two cut-off lengths, since the transform is periodic: the far side must not blur into this one.
    let mut real = RealFftPlanner::<f32>::new();
    let (forward_x, inverse_x) = (real.plan_fft_forward(nx), real.plan_fft_inverse(nx));
    let mut complex = FftPlanner::<f32>::new();

    // Along x: [z][y][f].
    let [cx, cy, cz] = lattice.counts;
    let mut spectrum = vec![Complex32::ZERO; half * ny * nz];
    parallel::for_chunks(&mut spectrum[..half * ny * cz], half * ny, |z, plane| {
        let values = &grid.values()[z * cx * cy..][..cx * cy];
        let mut row = vec![0.0f32; nx];
        for (out, values) in plane.chunks_exact_mut(half).zip(values.chunks_exact(cx)) {
            row.fill(0.0);
            for (to, &g) in row.iter_mut().zip(values) {
                let g = g.max(0.0);
                *to = if g.is_finite() { g / (1.0 + g) } else { 1.0 };
            }
            forward_x
                .process(&mut row, out)
                .expect("lengths as planned");
        }
    });
    along_y(&mut spectrum, half, ny, &complex.plan_fft_forward(ny));

    // Along z, on the transpose [y][f][z], with the response in between.
    let mut transposed = vec![Complex32::ZERO; half * ny * nz];
    let (forward_z, inverse_z) = (complex.plan_fft_forward(nz), complex.plan_fft_inverse(nz));
    let unit = |n: usize| options.cutoff_length / (n as f64 * lattice.spacing);
    let squared = |i: usize, n: usize| {
        let wave = i.min(n - i) as f64 * unit(n);
        wave * wave
    };
    let norm = 1.0 / (nx as f64 * ny as f64 * nz as f64);
    parallel::for_chunks(&mut transposed, half * nz, |y, slab| {
        for (x, line) in slab.chunks_exact_mut(nz).enumerate() {
            for (z, value) in line.iter_mut().enumerate() {
                *value = spectrum[(z * ny + y) * half + x];
            }
            forward_z.process(line);
            for (z, value) in line.iter_mut().enumerate() {
                let at = squared(x, nx) + squared(y, ny) + squared(z, nz);
                *value *= (options.response(at) * norm) as f32;
            }
            inverse_z.process(line);
        }
    });
    parallel::for_chunks(&mut spectrum, half * ny, |z, plane| {
        for (y, row) in plane.chunks_exact_mut(half).enumerate() {
            for (x, value) in row.iter_mut().enumerate() {
                *value = transposed[(y * half + x) * nz + z];
            }
        }
    });
    drop(transposed);
    along_y(&mut spectrum, half, ny, &complex.plan_fft_inverse(ny));

    let mut values = vec![0.0f32; lattice.len()];
    let planes = spectrum.chunks_exact_mut(half * ny);
    let mut planes: Vec<_> = values.chunks_exact_mut(cx * cy).zip(planes).collect();
    parallel::for_each(&mut planes, |_, (out, plane)| {
        let mut row = vec![0.0f32; nx];
        for (out, waves) in out.chunks_exact_mut(cx).zip(plane.chunks_exact_mut(half)) {
            // The mean and the highest wave of a real line are real.
            waves[0].im = 0.0;
            if nx.is_multiple_of(2) {
                waves[half - 1].im = 0.0;
            }
            inverse_x
                .process(waves, &mut row)
                .expect("lengths as planned");
            for (to, &phi) in out.iter_mut().zip(&row) {
                let phi = phi.min(FULL);
                *to = phi / (1.0 - phi);
            }
        }
    });
    Ok(ScalarGrid::new(lattice, values)?)
}

/// Transforms every column of every plane in place.
fn along_y(spectrum: &mut [Complex32], half: usize, ny: usize, plan: &Arc<dyn Fft<f32>>) {
    parallel::for_chunks(spectrum, half * ny, |_, plane| {
        let mut column = vec![Complex32::ZERO; ny];
        for x in 0..half {
            for (y, value) in column.iter_mut().enumerate() {
                *value = plane[y * half + x];
            }
            plan.process(&mut column);
            for (y, value) in column.iter().enumerate() {
                plane[y * half + x] = *value;
            }
        }
    });
}

/// The smallest `2^a 3^b 5^c` that is at least `n`.
pub(crate) fn good_size(n: u128) -> u128 {
    let n = n.max(1);
    let mut best = n.next_power_of_two();
    let mut five = 1;
    while five < best {
        let mut odd = five;
        while odd < best {
            best = best.min(odd * n.div_ceil(odd).next_power_of_two());
            odd *= 3;
        }
        five *= 5;
    }
    best
}
