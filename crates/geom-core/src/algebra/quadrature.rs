//! Where integrands are asked for their values.

/// Points and weights of Gauss's rule of `n` points over 0…1, which integrates polynomials of degree `2n − 1`, by Newton's
/// method on Legendre's polynomial.
///
/// ```
/// use geom_core::algebra::quadrature::gauss;
/// for (n, power) in (2..=8).flat_map(|n| (0..2 * n as i32).map(move |power| (n, power))) {
///     let sum: f64 = gauss(n).iter().map(|(x, w)| w * x.powi(power)).sum();
///     assert!((sum - 1.0 / f64::from(power + 1)).abs() < 1e-14);
/// }
/// ```
///
/// Points ascend, inside of the interval; weights are positive and sum to 1. None for `n = 0`.
pub fn gauss(n: usize) -> Vec<(f64, f64)> {
    let legendre = |x: f64| {
        let (mut p, mut before) = (1.0, 0.0);
        for k in 0..n {
            let k = k as f64;
            (p, before) = (((2.0 * k + 1.0) * x * p - k * before) / (k + 1.0), p);
        }
        (p, n as f64 * (before - x * p) / (1.0 - x * x))
    };
    let point = |i: usize| {
        let mut x = -(std::f64::consts::PI * (i as f64 + 0.75) / (n as f64 + 0.5)).cos();
        for _ in 0..40 {
            let (p, d) = legendre(x);
            x -= p / d;
        }
        let (_, d) = legendre(x);
        (0.5 * (1.0 + x), 1.0 / ((1.0 - x * x) * d * d))
    };
    (0..n).map(point).collect()
}
