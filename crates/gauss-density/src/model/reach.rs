//! How far an atom can matter: one radius for the whole model, after the powers.
//!
//! A kernel falls like a Gaussian, so that far atoms matter nowhere; but a power below 1 lifts small values, `(10⁻⁸)^0.1 = 0.16`, and
//! how far is far depends on the powers, on how many terms a sum has and on how small a density still counts. Going down the tree,
//! a bound on what a node may lose becomes one on what each of its children may.

use crate::model::{Level, Model};

/// The largest number of children and the extreme powers of each level, and the extreme atoms.
/// Everything that is asked of it depends on these few numbers alone, so that a part of a model can be sampled with the
/// bounds of the whole, and then with the same bits. The price is that one strange node, a residue with a tiny power or
/// an atom with a tiny decay, widens the reach of all.
#[derive(Clone, Debug)]
pub(crate) struct Reach {
    /// The largest radius, Å.
    radius: f64,
    /// The smallest decay, Å⁻².
    decay: f64,
    /// The largest decay, Å⁻².
    fastest_decay: f64,
    /// The largest `κ r²`.
    highest_kernel: f64,
    /// `ln` of the largest number of children, lowest level first, and of the root's.
    children: Vec<f64>,
    /// Per level, lowest first: smallest and largest power.
    powers: Vec<(f64, f64)>,
}

impl Reach {
    pub(crate) fn new(model: &Model, levels: &[Level]) -> Self {
        let most_children = |level: &Level| {
            let most = level.first_child.windows(2).map(|w| w[1] - w[0]).max();
            f64::from(most.unwrap_or(1)).ln()
        };
        let mut children: Vec<f64> = levels.iter().map(most_children).collect();
        let top = levels.last().map_or(model.atoms(), Level::len);
        children.push((top as f64).ln());
        Self {
            radius: model.radii().iter().copied().fold(0.0, f64::max),
            decay: model.decays().iter().copied().fold(f64::INFINITY, f64::min),
            fastest_decay: model.decays().iter().copied().fold(0.0, f64::max),
            highest_kernel: model
                .radii()
                .iter()
                .zip(model.decays())
                .map(|(r, kappa)| kappa * r * r)
                .fold(0.0, f64::max),
            children,
            powers: levels
                .iter()
                .map(|level| {
                    let power =
                        |f: fn(f64, f64) -> f64, start| level.power.iter().copied().fold(start, f);
                    (power(f64::min, f64::INFINITY), power(f64::max, 0.0))
                })
                .collect(),
        }
    }

    /// The same for so many copies of the model side by side.
    pub(crate) fn of_copies(mut self, model: &Model, levels: &[Level], copies: usize) -> Self {
        let top = levels.last().map_or(model.atoms(), Level::len);
        if let Some(root) = self.children.last_mut() {
            *root = (top as f64 * copies as f64).ln();
        }
        self
    }

    /// The largest decay of an atom, Å⁻².
    pub(crate) fn fastest_decay(&self) -> f64 {
        self.fastest_decay
    }

    /// The logarithm of the highest kernel, `κ r²`.
    pub(crate) fn highest_kernel(&self) -> f64 {
        self.highest_kernel
    }

    /// No sum and no power of one, nor the density, has a larger logarithm than this.
    pub(crate) fn highest_sum(&self) -> f64 {
        let mut sum = self.highest_kernel_sum();
        let mut highest = sum;
        for (&(low, high), above) in self.powers.iter().zip(&self.children[1..]) {
            sum = (sum * low).max(sum * high) + above;
            highest = highest.max(sum);
        }
        highest
    }

    /// No sum of kernels has a larger logarithm than this.
    pub(crate) fn highest_kernel_sum(&self) -> f64 {
        self.highest_kernel + self.children[0]
    }

    /// The most that the powers below the topmost ones multiply a logarithm by; 0 if there are none.
    pub(crate) fn steepest_below_the_top(&self) -> f64 {
        let below = self.powers.split_last().map_or(&[][..], |(_, below)| below);
        let products = below.iter().scan(1.0, |product, &(_, high)| {
            *product *= high;
            Some(*product)
        });
        products.fold(0.0, f64::max)
    }

    /// Beyond this distance from every atom the density is below `floor`, Å.
    ///
    /// Going down from the root, a sum of `n` terms is below `s` when each is below `s / n`, and a power
    /// is below `s` when its base is below `s^(1/P)`.
    pub(crate) fn beyond(&self, floor: f64) -> f64 {
        let mut ln = floor.ln();
        for (&(low, high), above) in self.powers.iter().zip(&self.children[1..]).rev() {
            ln -= above;
            // The weaker demand of the two extreme powers is the larger base: take the smaller one.
            ln = (ln / low).min(ln / high);
        }
        ln -= self.children[0];
        self.radius_of(-ln)
    }

    /// Atoms farther than this from a point may be left out there: where the density reaches `floor`, it
    /// loses at most the share `eps` (Å).
    pub(crate) fn radius(&self, eps: f64, floor: f64) -> f64 {
        self.radius_of(self.exponent(eps, floor))
    }

    /// Atoms whose power distance `q` at a point is more than this may be left out there: where the density
    /// reaches `floor`, it loses at most the share `eps`.
    pub(crate) fn exponent(&self, eps: f64, floor: f64) -> f64 {
        self.exponent_among(&self.children, eps, floor)
    }

    /// The same for a part of the atoms: given `ln` of the largest number of children on each level, lowest
    /// first, and of the root's.
    ///
    /// A node may lose `λ + ρ D`; the root `eps floor / 2 + eps G / 2`, or `eps floor` if nothing needs a `ρ`. A sum of `n` terms passes `λ / n` and
    /// `ρ` on to each. A power `P ≤ 1` needs `λ^(1/P)` and `ρ` from its sum `S`, since
    /// `S^P − ((1 − ρ) S − λ)^P ≤ ρ S^P + λ^P`. A power above 1 needs `ρ λ^(1/P) / 2P` and `ρ / 2P`: either the
    /// absolute loss is below the share `ρ / 2P` of `S` too, or `S` is so small that its power is below `λ`.
    pub(crate) fn exponent_among(&self, children: &[f64], eps: f64, floor: f64) -> f64 {
        let sharpened = self.powers.iter().any(|&(_, high)| high > 1.0);
        let absolute = if sharpened { 0.5 * eps } else { eps };
        let (mut t, mut rho) = (-(absolute * floor).ln(), 0.5 * eps);
        for (&(low, high), above) in self.powers.iter().zip(&children[1..]).rev() {
            t += above;
            let mut worst = f64::NEG_INFINITY;
            if low <= 1.0 {
                worst = worst.max(t / low).max(t / high.min(1.0));
            }
            if high > 1.0 {
                let divided = (t / low.max(1.0)).max(t / high);
                worst = worst.max(divided + (2.0 * high / rho).ln());
                rho /= 2.0 * high;
            }
            t = worst;
        }
        t + children[0]
    }

    /// Per level, lowest first: atoms may be left out of a node's sum of this level while
    /// `w_a q_a − w_b q_b` is more than this, with any other atom `b` of the sum and `w` the product of the powers
    /// below the level; the density loses at most the share `rho`. Ends above the first level with a
    /// power above 1.
    ///
    /// With powers `P ≤ 1` the atoms left out take no more of a sum than they would be worth alone, since
    /// `(S + T)^P ≤ S^P + T^P`, and `n` terms below `exp(m)` are worth `n^P exp(P m)`. A share that a sum loses
    /// grows with powers above 1 on the way up, at most by their product.
    pub(crate) fn outweighed_among(&self, children: &[f64], rho: f64) -> impl Iterator<Item = f64> {
        let grown: f64 = self.powers.iter().map(|&(_, high)| high.max(1.0)).product();
        let share = rho / (self.powers.len() as f64 * grown);
        let gentle = self.powers.iter().take_while(|&&(_, high)| high <= 1.0);
        let levels = (gentle.count() + 1).min(self.powers.len());
        let mut worth = 0.0;
        (0..levels).map(move |l| {
            if l > 0 {
                worth *= self.powers[l - 1].1;
            }
            worth += children[l];
            worth - share.ln()
        })
    }

    /// Beyond this distance every bare kernel is below `eps` (Eq. 3.15), Å.
    #[cfg(feature = "thesis")]
    pub(crate) fn bare(&self, eps: f64) -> f64 {
        self.radius_of(-eps.ln())
    }

    /// The distance at which the widest kernel falls to `exp(−t)`.
    /// Largest radius and smallest decay may belong to different atoms: then it is farther than needed, and never
    /// nearer.
    fn radius_of(&self, t: f64) -> f64 {
        (self.radius * self.radius + t.max(0.0) / self.decay).sqrt()
    }
}
