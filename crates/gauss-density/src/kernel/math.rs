//! Exponentials, logarithms and powers without a call or a branch, so that they become vector instructions:
//! `exp2` and `log2` in f32, `exp_all` and `ln_all` in f64.
//!
//! Clamps take the place of branches, so arguments that leave a function's range give a number all the same; the
//! callers see to it that such numbers do not count. None is given a NaN. What is inlined here is compiled once per
//! instruction set, by whoever calls `autovectorized`.

/// `2^x` within 2e-7, for x in [−126, 127]; clamped beyond.
#[inline(always)]
pub(crate) fn exp2(x: f32) -> f32 {
    let x = x.clamp(-126.0, 126.0);
    // Adding 1.5 · 2²³ rounds to the nearest integer.
    let shifted = x + 12_582_912.0;
    let whole = shifted - 12_582_912.0;
    let t = x - whole;
    // Taylor about 0 on [−½, ½]: the remainder is below 1.3e-8 · 1.5.
    let p = 1.525_273e-5f32;
    let p = p * t + 1.540_353e-4;
    let p = p * t + 1.333_355_8e-3;
    let p = p * t + 9.618_129e-3;
    let p = p * t + 5.550_411e-2;
    let p = p * t + 2.402_265e-1;
    let p = p * t + 6.931_472e-1;
    let p = p * t + 1.0;
    let exponent = (shifted.to_bits() as i32).wrapping_sub(0x4b40_0000) + 127;
    p * f32::from_bits((exponent as u32) << 23)
}

/// `log₂ x` for normal positive x, within 3e-7 absolute plus 2e-7 relative.
/// 0 gives about −127 instead of minus infinity.
#[inline(always)]
pub(crate) fn log2(x: f32) -> f32 {
    let bits = x.to_bits() as i32;
    // Mantissa in [√½, √2).
    let exponent = (bits - 0x3f35_04f3) >> 23;
    let m = f32::from_bits((bits - (exponent << 23)) as u32);
    // log2 m = 2/ln 2 · artanh((m − 1)/(m + 1)).
    let s = (m - 1.0) / (m + 1.0);
    let z = s * s;
    let p = 0.412_198_58_f32 * z * 0.777_777_8 + 0.412_198_58;
    let p = p * z + 0.577_078;
    let p = p * z + 0.961_796_7;
    let p = p * z + 2.885_39;
    exponent as f32 + s * p
}

/// Taylor's coefficients of `eᵗ`, the highest power first.
/// Up to `t¹³ / 13!`.
const EXPONENTIAL: [f64; 14] = [
    1.0 / 6_227_020_800.0,
    1.0 / 479_001_600.0,
    1.0 / 39_916_800.0,
    1.0 / 3_628_800.0,
    1.0 / 362_880.0,
    1.0 / 40_320.0,
    1.0 / 5_040.0,
    1.0 / 720.0,
    1.0 / 120.0,
    1.0 / 24.0,
    1.0 / 6.0,
    0.5,
    1.0,
    1.0,
];

/// Those of `2 artanh(√z) / √z`.
/// Of `ln m = 2 artanh s` with `s = (m − 1) / (m + 1)`, whose square is at most 0.03, so that eleven terms reach f64.
const ARTANH: [f64; 11] = [
    2.0 / 21.0,
    2.0 / 19.0,
    2.0 / 17.0,
    2.0 / 15.0,
    2.0 / 13.0,
    2.0 / 11.0,
    2.0 / 9.0,
    2.0 / 7.0,
    2.0 / 5.0,
    2.0 / 3.0,
    2.0,
];

/// Horner's scheme.
#[inline(always)]
fn polynomial<const N: usize>(coefficients: &[f64; N], x: f64) -> f64 {
    let (highest, others) = (coefficients[0], &coefficients[1..]);
    others.iter().fold(highest, |p, c| p * x + c)
}

/// `eˣ` within 4e-16 of itself, for each x; 0 below −700, clamped above 700.
#[inline(always)]
pub(crate) fn exp_all(values: &mut [f64]) {
    for v in values {
        let x = v.clamp(-700.0, 700.0);
        // Adding 1.5 · 2⁵² rounds to the nearest integer.
        let shifted = x * std::f64::consts::LOG2_E + 6_755_399_441_055_744.0;
        let whole = shifted - 6_755_399_441_055_744.0;
        // ln 2 in two parts, the first with trailing zeros.
        let t = x - whole * 0.693_147_180_369_123_8 - whole * 1.908_214_929_270_587_7e-10;
        // Taylor on |t| ≤ ln 2 / 2; the remainder is below 5e-18.
        let p = polynomial(&EXPONENTIAL, t);
        let power = f64::from_bits((shifted.to_bits() << 52).wrapping_add(1.0f64.to_bits()));
        *v = if *v < -700.0 { 0.0 } else { p * power };
    }
}

/// `ln x` within 1e-15, relative to itself or absolute, for each normal positive x.
#[inline(always)]
pub(crate) fn ln_all(values: &mut [f64]) {
    for v in values {
        let bits = v.to_bits();
        // Mantissa in [√½, √2).
        let above = bits.wrapping_sub(std::f64::consts::FRAC_1_SQRT_2.to_bits());
        let m = f64::from_bits(
            (above & ((1 << 52) - 1)).wrapping_add(std::f64::consts::FRAC_1_SQRT_2.to_bits()),
        );
        // The exponent as a number, without a conversion: 2⁵² + (exponent + 1024) has it in its lowest bits.
        let exponent = (above >> 52).wrapping_add(1024) & 2047;
        let exponent =
            f64::from_bits(exponent | 0x4330_0000_0000_0000) - (4_503_599_627_370_496.0 + 1024.0);
        // ln m = 2 artanh s; the remainder is below 1e-18.
        let s = (m - 1.0) / (m + 1.0);
        let z = s * s;
        let p = polynomial(&ARTANH, z);
        *v = exponent * std::f64::consts::LN_2 + p * s;
    }
}

/// Numbers to a power, fast for the powers that are common.
/// For numbers that are not negative.
#[inline(always)]
pub(crate) fn raise(values: &mut [f64], power: f64) {
    if power == 1.0 {
    } else if power == 0.5 {
        for v in values {
            *v = v.sqrt();
        }
    } else if power == 0.25 {
        for v in values {
            *v = v.sqrt().sqrt();
        }
    } else {
        for v in values {
            *v = v.powf(power);
        }
    }
}
