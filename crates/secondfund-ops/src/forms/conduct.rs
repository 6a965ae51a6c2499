//! The conductivity of each operator: the one place where an operator is a formula.
//!
//! Read a conductivity like that of a metal plate: where it is large f is kept from changing, since that would cost energy, and where
//! it is small f may jump. The secondary operator conducts with `Ψ² / κ²` in a principal direction. Flat faces are perfect
//! conductors (ε keeps that finite), creases are insulators across, and the eigenfunctions are nearly constant on what people see
//! as a part.

use super::symmetric::{Forms, Symmetric};

/// The formula of an operator's conductivity.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Law {
    /// `g⁻¹`: Laplace–Beltrami.
    Metric,
    /// `adj(b) / det g = K b⁻¹`: Giaquinta–Hildebrandt. Indefinite on saddles.
    Adjugate,
    /// `Ψ² (III + ε² g)⁻¹`: the secondary Laplace operator, regularized.
    GaussImage,
    /// `Ψ² (III₋ + ε² g)⁻¹` with the third form `III₋ = b₋ g⁻¹ b₋` of the negative part of b: the secondary Laplace
    /// operator of the concave directions.
    Concave,
    /// `Ψ K / (K² + δ²) adj(b) / det g`, which is `Ψ b⁻¹` regularized: the generalized
    /// Giaquinta–Hildebrandt operator.
    Generalized,
    /// `Q₊ − β Q₋`, the parts by sign of `Q = H K / √(K² + δ²) adj(b) / det g`, which is the same with `Ψ = H |K|` and
    /// moves the surface in the flow of Eq. 7.26. The positive part diffuses; the negative one, sign turned, sharpens,
    /// and amplifies noise. β is [`Conductor::sharpen`].
    Flow,
}

/// An operator ready to be evaluated: its law with the weight
/// `Ψ = clamp(exp(gauss · K + mean · H) · factor, bounds)`. All in unit scale (the largest extent of
/// the surface is 1).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Conductor {
    /// The formula.
    pub law: Law,
    /// Coefficient of K in the exponent.
    pub gauss: f64,
    /// Coefficient of H in the exponent.
    pub mean: f64,
    /// Smallest and largest Ψ.
    pub bounds: [f64; 2],
    /// ε of [`Law::GaussImage`] and [`Law::Concave`], √δ of the generalized laws.
    pub regularization: f64,
    /// Curvatures above this are scaled down to it; infinite for no such limit.
    pub limit: f64,
    /// β of [`Law::Flow`]: 0 for the part that diffuses alone, 1 for Q as it stands.
    pub sharpen: f64,
}

/// Larger exponents mean nothing: Ψ is bounded anyway.
const MOST_EXPONENT: f64 = 50.0;

impl Conductor {
    /// Ψ at a point, where `factor` is the value of the weight's fields.
    #[inline]
    pub fn psi(&self, forms: &Forms, factor: f64) -> f64 {
        if self.gauss == 0.0 && self.mean == 0.0 && factor == 1.0 {
            return 1.0;
        }
        let exponent = self.gauss * forms.gaussian() + self.mean * forms.mean();
        let bounded = exponent.clamp(-MOST_EXPONENT, MOST_EXPONENT);
        (bounded.exp() * factor).clamp(self.bounds[0], self.bounds[1])
    }

    /// The conductivity `A^{ab}`, of which the operator's form is `∫ f_a A^{ab} h_b dA`. Laws that take parts of a
    /// form by their sign need the forms in an orthonormal frame: see [`Conductor::in_coordinates`].
    #[inline]
    pub fn at(&self, forms: &Forms, factor: f64) -> Symmetric {
        let forms = &forms.capped(self.limit);
        let g = forms.first;
        let adjugate = || forms.second.adjugate() * (1.0 / g.determinant());
        let delta = || self.regularization * self.regularization;
        match self.law {
            Law::Metric => g.inverse(),
            Law::Adjugate => adjugate(),
            Law::GaussImage => {
                let psi = self.psi(forms, factor);
                (forms.third() + g * delta()).inverse() * (psi * psi)
            }
            Law::Concave => {
                let concave = forms.second.split().1;
                let third = concave.around(Symmetric::scaled_unit(1.0));
                let psi = self.psi(forms, factor);
                (third + g * delta()).inverse() * (psi * psi)
            }
            Law::Generalized => {
                let k = forms.gaussian();
                adjugate() * (self.psi(forms, factor) * k / (k * k + delta() * delta()))
            }
            Law::Flow => {
                let (diffusing, sharpening) = self.flow(forms).split();
                diffusing + sharpening * -self.sharpen
            }
        }
    }

    /// Like [`Conductor::at`] for forms in any coordinates: parts by sign are taken in an orthonormal frame.
    #[inline]
    pub fn in_coordinates(&self, forms: &Forms, factor: f64) -> Symmetric {
        match self.law {
            Law::Concave | Law::Flow => {
                let (forms, [first, second]) = forms.in_frame();
                let a = self.at(&forms, factor);
                a.pulled_back(first, second)
            }
            _ => self.at(forms, factor),
        }
    }

    /// `H K / √(K² + δ²) adj(b) / det g`. Its parts are those of a symmetric matrix, so the forms must be in
    /// an orthonormal frame: [`Forms::in_frame`].
    #[inline]
    fn flow(&self, forms: &Forms) -> Symmetric {
        let k = forms.gaussian();
        let delta = self.regularization * self.regularization;
        let scale = 1.0 / forms.first.determinant();
        forms.second.adjugate() * (scale * forms.mean() * k / (k * k + delta * delta).sqrt())
    }
}
