//! The model: a tree of any depth over the atoms, with one power per node (Eqs. 3.1–3.6).
//!
//! An atom `a` has the kernel `g_a(x) = exp(−κ_a (|x − x_a|² − r_a²))`, which is 1 on the sphere of its
//! radius. A node `v` (residue, chain, domain, …) sums its children and raises the sum to its power:
//! `D_v = (Σ_c D_c)^P_v`. The density `G` is the sum over the topmost nodes, without a power.
//!
//! Everything here is plain data in f64. What sampling needs besides (parents, boxes of atoms, how far an atom matters)
//! is derived from it once per call and not kept, so a model may be changed freely between calls.

use std::ops::Range;

use geom_core::options::{OutOfRange, require};
use geom_core::structure::Selector;
use geom_core::{Aabb, Point3, Structure};

use crate::error::Error;

pub(crate) mod copies;
pub(crate) mod reach;

/// Powers and decay for a whole structure, or for the part that [`Model::emphasize`] selects.
///
/// A power below 1 blurs what lies below it, a power above 1 sharpens it; 1 leaves a plain sum.
///
/// What a power P does to a residue is seen at one atom alone: `g^P = exp(−P κ (d² − r²))` is still 1 on the sphere of its
/// radius, but falls P times as fast. Two atoms of that residue side by side have `(g₁ + g₂)^P`, which with a small P is
/// hardly more than one of them: their bumps merge, and the surface follows the residue instead of its atoms. Powers of
/// chains and domains do the same to residues and chains, so that a resolution can be given to each level and to each part
/// ([`Model::emphasize`]).
///
/// `decay` is the other knob: with κ = 1 Å⁻² the density of an atom falls to 1/e where `d² = r² + 1 Å²`, for a carbon at 1.97 Å
/// instead of 1.7 Å. Smaller values blur everything alike.
///
/// ```
/// use gauss_density::geom_core::{ImplicitField, Point3};
/// use gauss_density::{Cutoff, Model, PointSampler};
///
/// // One residue of two carbons, and a point in the dent between them.
/// let places = vec![Point3::new(-1.2, 0.0, 0.0), Point3::new(1.2, 0.0, 0.0)];
/// let dent = Point3::new(0.0, 1.6, 0.0);
/// let density = |power| -> Result<f64, gauss_density::Error> {
///     let residue = vec![(vec![0, 2], vec![power])];
///     let model = Model::new(places.clone(), vec![1.7; 2], vec![1.0; 2], residue)?;
///     Ok(PointSampler::new(&model, Cutoff::default())?.value(&dent))
/// };
/// // Two kernels of 0.33 each: outside by themselves, and still so, but nearer to 1, the smaller the power.
/// assert!((density(1.0)? - 2.0 * f64::exp(-(1.44 + 2.56 - 2.89))).abs() < 1e-6);
/// assert!(density(0.5)? > density(1.0)? && density(0.1)? > density(0.5)?);
/// # Ok::<(), gauss_density::Error>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Levels {
    /// `P_R` (Eq. 3.4).
    /// In `[0.001, 64]`, as all powers.
    pub residue_power: f64,
    /// `P_C` (Eq. 3.5).
    /// Below 1, residues of a chain merge as atoms of a residue do.
    pub chain_power: f64,
    /// `P_D` (Eq. 3.6). Of no effect on a structure of one domain but on the sharpness of its surface: that does not
    /// move, since `1^P = 1`.
    pub domain_power: f64,
    /// `κ`, Å⁻²: how fast an atom's kernel decays (Eq. 3.1).
    /// In `[1e-6, 1e6]`; 0.3 to 1 are usual. The surface of a single atom lies at its radius whatever `κ` is; between
    /// atoms a smaller one fills more.
    pub decay: f64,
}

impl Default for Levels {
    /// The thesis's usual setting: `P_R` = 0.5, `P_C` = 1, `P_D` = 1, `κ` = 1 Å⁻².
    fn default() -> Self {
        Self {
            residue_power: 0.5,
            chain_power: 1.0,
            domain_power: 1.0,
            decay: 1.0,
        }
    }
}

impl Levels {
    /// Is every field in its range?
    ///
    /// # Errors
    /// The first field that is not, with the range: powers in `[0.001, 64]`, the decay in `[1e-6, 1e6]` Å⁻². NaN is in
    /// no range.
    pub fn check(&self) -> Result<(), OutOfRange> {
        check_power("residue_power", self.residue_power)?;
        check_power("chain_power", self.chain_power)?;
        check_power("domain_power", self.domain_power)?;
        check_decay(self.decay)
    }
}

fn check_power(option: &'static str, value: f64) -> Result<(), OutOfRange> {
    require(
        (1e-3..=64.0).contains(&value),
        option,
        value,
        "be in [0.001, 64]",
    )
}

fn check_decay(value: f64) -> Result<(), OutOfRange> {
    let fine = (1e-6..=1e6).contains(&value);
    require(fine, "decay", value, "be in [1e-6, 1e6] Å⁻²")
}

/// One level of the tree: nodes with contiguous children on the level below.
///
/// Level 0 of a [`Model`] are its residues if it was made of a structure, and their children are atoms; each node has
/// at least one child, and each child exactly one node. (Eqs. 3.2 and 3.3 of the thesis as a partition.)
#[derive(Clone, Debug, PartialEq)]
pub struct Level {
    /// First child per node, and the number of children at the end.
    pub(crate) first_child: Vec<u32>,
    /// `P_v` per node.
    pub(crate) power: Vec<f64>,
}

impl Level {
    /// Number of nodes.
    pub fn len(&self) -> usize {
        self.power.len()
    }
    /// Has the level no nodes?
    pub fn is_empty(&self) -> bool {
        self.power.is_empty()
    }
    /// The children of a node, on the level below (atoms for the lowest level).
    ///
    /// # Panics
    /// If the level has no such node.
    pub fn children(&self, node: usize) -> Range<usize> {
        self.first_child[node] as usize..self.first_child[node + 1] as usize
    }
    /// The node above each child.
    pub(crate) fn parents(&self) -> Vec<u32> {
        let mut parents = vec![0; self.first_child[self.len()] as usize];
        for node in 0..self.len() {
            parents[self.children(node)].fill(node as u32);
        }
        parents
    }
    /// The power of each node.
    pub fn powers(&self) -> &[f64] {
        &self.power
    }
}

/// Atoms and the tree above them.
///
/// Atoms have the order of the structure, or of the lists that the model was made of, so that an index means the same
/// atom in both; nodes have the order of their atoms. With that order every sum is taken, which makes results
/// independent of threads. An atom takes 40 bytes, a node 12. Radii may be 0: such an atom has the kernel's height 1 at
/// its centre alone, and hardly a surface of its own ([`Model::raise_radii`] helps where a file has no radii of
/// hydrogens).
#[derive(Clone, Debug, PartialEq)]
pub struct Model {
    centers: Vec<Point3>,
    radii: Vec<f64>,
    decays: Vec<f64>,
    levels: Vec<Level>,
    /// Per atom, or empty when none is protected.
    protected: Vec<bool>,
}

impl Model {
    /// The tree of a structure (residues, chains, domains) with the same powers and decay everywhere.
    ///
    /// Three levels, even if there is one chain or one domain. Radii are those of the structure; waters and other small
    /// molecules are residues of their own, as far as the reader has left them in. Parts of their own are set
    /// afterwards, by [`Model::emphasize_selected`].
    ///
    /// # Errors
    /// A field of `levels` out of range; [`Error::NoAtoms`]; [`Error::BadAtom`] for the first coordinate or radius that
    /// is not a number in its range.
    pub fn uniform(structure: &Structure, levels: &Levels) -> Result<Self, Error> {
        levels.check()?;
        let level = |starts: &[u32], power: f64| Level {
            first_child: starts.to_vec(),
            power: vec![power; starts.len().saturating_sub(1)],
        };
        let tree = vec![
            level(structure.residue_starts(), levels.residue_power),
            level(structure.chain_starts(), levels.chain_power),
            level(structure.domain_starts(), levels.domain_power),
        ];
        let atoms = structure.atoms();
        Self::checked(
            atoms.iter().map(|a| a.position).collect(),
            atoms.iter().map(|a| a.radius).collect(),
            vec![levels.decay; atoms.len()],
            tree,
        )
    }

    /// A tree of any depth. `tree` goes from the lowest level to the topmost; each level has the first
    /// child per node (and the number of children at the end), and a power per node. With no level the
    /// density is the plain sum over the atoms. Radii are Å, decays Å⁻², one each per centre.
    ///
    /// ```
    /// use gauss_density::{Model, geom_core::Point3};
    /// // Five atoms in residues of two and three, both in one chain.
    /// let centers = (0..5).map(|i| Point3::new(1.5 * f64::from(i), 0.0, 0.0)).collect();
    /// let residues = (vec![0, 2, 5], vec![0.5, 0.5]);
    /// let chain = (vec![0, 2], vec![1.0]);
    /// let model = Model::new(centers, vec![1.7; 5], vec![1.0; 5], vec![residues, chain])?;
    /// assert_eq!(model.levels()[0].children(1), 2..5);
    /// # Ok::<(), gauss_density::Error>(())
    /// ```
    ///
    /// # Errors
    /// Names the first atom or level that makes no sense: arrays of different lengths, no atoms, a centre beyond ±10⁷ Å, a radius
    /// that is negative or above 10⁴ Å, a decay or power out of its range, a node without children or a child without a node.
    pub fn new(
        centers: Vec<Point3>,
        radii: Vec<f64>,
        decays: Vec<f64>,
        tree: Vec<(Vec<u32>, Vec<f64>)>,
    ) -> Result<Self, Error> {
        let atoms = centers.len();
        for (what, found) in [("radii", radii.len()), ("decays", decays.len())] {
            if found != atoms {
                return Err(Error::Length { what, found, atoms });
            }
        }
        let levels: Vec<Level> = tree
            .into_iter()
            .map(|(first_child, power)| Level { first_child, power })
            .collect();
        let mut below = atoms;
        for (number, level) in levels.iter().enumerate() {
            let starts = &level.first_child;
            let fault = if starts.len() != level.power.len() + 1 {
                Some("it has not one start more than powers")
            } else if starts[0] != 0 || starts[level.len()] as usize != below {
                Some("it does not begin with the first and end with the last of them")
            } else if starts.windows(2).any(|w| w[0] >= w[1]) {
                Some("a node is empty")
            } else {
                None
            };
            if let Some(fault) = fault {
                return Err(Error::BadTree {
                    level: number,
                    below,
                    fault,
                });
            }
            below = level.len();
            for &power in &level.power {
                check_power("power", power)?;
            }
        }
        Self::checked(centers, radii, decays, levels)
    }

    fn checked(
        centers: Vec<Point3>,
        radii: Vec<f64>,
        decays: Vec<f64>,
        levels: Vec<Level>,
    ) -> Result<Self, Error> {
        if centers.is_empty() {
            return Err(Error::NoAtoms);
        }
        if centers.len() > geom_core::id::MAX_ELEMENTS {
            return Err(Error::TooManyAtoms {
                atoms: centers.len(),
            });
        }
        for (atom, (center, &radius)) in centers.iter().zip(&radii).enumerate() {
            for (field, value) in [("x", center.x), ("y", center.y), ("z", center.z)] {
                if !(-1e7..=1e7).contains(&value) {
                    return Err(Error::BadAtom { atom, field, value });
                }
            }
            if !(0.0..=1e4).contains(&radius) {
                return Err(Error::BadAtom {
                    atom,
                    field: "radius",
                    value: radius,
                });
            }
        }
        for (atom, &value) in decays.iter().enumerate() {
            if check_decay(value).is_err() {
                let field = "decay";
                return Err(Error::BadAtom { atom, field, value });
            }
        }
        Ok(Self {
            centers,
            radii,
            decays,
            levels,
            protected: Vec::new(),
        })
    }

    /// Number of atoms.
    ///
    /// At least one.
    pub fn atoms(&self) -> usize {
        self.centers.len()
    }
    /// Centre per atom, Å.
    pub fn centers(&self) -> &[Point3] {
        &self.centers
    }
    /// Radius per atom, Å.
    pub fn radii(&self) -> &[f64] {
        &self.radii
    }
    /// Decay `κ` per atom, Å⁻².
    pub fn decays(&self) -> &[f64] {
        &self.decays
    }
    /// The levels of the tree, lowest first.
    /// All that were given are here, those of which every power is 1 included; sampling merges these with the level
    /// above.
    pub fn levels(&self) -> &[Level] {
        &self.levels
    }

    /// The smallest box that holds all atom centres.
    /// Radii are not in it, so the surface lies outside of it in general.
    pub fn center_bounds(&self) -> Aabb {
        Aabb::of_points(&self.centers)
    }

    /// Gives one node its own power. Level 0 is the lowest (residues).
    ///
    /// # Errors
    /// A power outside of `[0.001, 64]`, or [`Error::NoSuchNode`]; the model is then as it was.
    pub fn set_power(&mut self, level: usize, node: usize, power: f64) -> Result<(), Error> {
        check_power("power", power)?;
        let count = self.levels.len();
        let level = self.levels.get_mut(level).ok_or(Error::NoSuchNode {
            what: "level",
            index: level,
            count,
        })?;
        let count = level.len();
        *level.power.get_mut(node).ok_or(Error::NoSuchNode {
            what: "node",
            index: node,
            count,
        })? = power;
        Ok(())
    }

    /// Emphasizes a part of the structure (§5.2.1): its atoms get the decay, every node all of whose atoms
    /// are selected gets the power of its level in `levels`, and the atoms are protected from elimination
    /// and refit. Atoms may come in any order.
    ///
    /// The three powers go to the three lowest levels, whatever these stand for; higher levels keep theirs. A residue
    /// of which only some atoms are selected keeps its power, though its selected atoms get the decay. Nothing selected
    /// has no effect.
    ///
    /// # Errors
    /// A field of `levels` out of range, or [`Error::NoSuchNode`] for an atom that the model does not have; the model
    /// is then as it was.
    pub fn emphasize(
        &mut self,
        atoms: impl IntoIterator<Item = usize>,
        levels: &Levels,
    ) -> Result<(), Error> {
        levels.check()?;
        let mut selected = vec![false; self.atoms()];
        for atom in atoms {
            let count = selected.len();
            *selected.get_mut(atom).ok_or(Error::NoSuchNode {
                what: "atom",
                index: atom,
                count,
            })? = true;
        }
        self.protect_where(&selected);
        for (decay, _) in self.decays.iter_mut().zip(&selected).filter(|s| *s.1) {
            *decay = levels.decay;
        }
        let powers = [
            levels.residue_power,
            levels.chain_power,
            levels.domain_power,
        ];
        for (level, power) in self.levels.iter_mut().zip(powers) {
            let whole: Vec<bool> = (0..level.len())
                .map(|v| selected[level.children(v)].iter().all(|&s| s))
                .collect();
            for (own, _) in level.power.iter_mut().zip(&whole).filter(|w| *w.1) {
                *own = power;
            }
            selected = whole;
        }
        Ok(())
    }

    /// Emphasizes what a selector means in the structure that the model was made of: chains, residues,
    /// domains, copies of an assembly.
    ///
    /// ```
    /// use gauss_density::geom_core::io::structure::{ReadOptions, read};
    /// use gauss_density::geom_core::structure::Selector;
    /// use gauss_density::{Levels, Model};
    /// # fn main() -> Result<(), Box<dyn std::error::Error>> {
    /// let structure = read(fixtures::path("1hvr.pdb"), &ReadOptions::default())?.structure;
    /// // Everything in outline, chain B with every atom.
    /// let mut model = Model::uniform(&structure, &Levels { residue_power: 0.1, ..Levels::default() })?;
    /// let sharp = Levels { residue_power: 1.0, ..Levels::default() };
    /// model.emphasize_selected(&structure, &Selector::parse("chain:B")?, &sharp)?;
    /// let powers = model.levels()[0].powers();
    /// assert!(powers.contains(&0.1) && powers.contains(&1.0));
    /// # Ok(())
    /// # }
    /// ```
    ///
    /// # Errors
    /// [`Error::OtherStructure`] if the numbers of atoms differ, [`Error::Select`] for a selector that names what the
    /// structure does not have, and what [`Model::emphasize`] refuses.
    pub fn emphasize_selected(
        &mut self,
        structure: &Structure,
        selector: &Selector,
        levels: &Levels,
    ) -> Result<(), Error> {
        let atoms = self.selected(structure, selector)?;
        self.emphasize(atoms, levels)
    }

    /// The atoms that a selector means in the structure that the model was made of, ascending.
    ///
    /// # Errors
    /// [`Error::OtherStructure`] if the structure has another number of atoms than the model: more is not compared.
    /// [`Error::Select`] for a selector that names what it does not have.
    pub fn selected(
        &self,
        structure: &Structure,
        selector: &Selector,
    ) -> Result<Vec<usize>, Error> {
        if structure.atoms().len() != self.atoms() {
            return Err(Error::OtherStructure {
                atoms: structure.atoms().len(),
                model: self.atoms(),
            });
        }
        let selection = structure.select(selector)?;
        Ok(selection.atom_ranges(structure).flatten().collect())
    }

    /// Protects atoms: [`eliminate`](crate::eliminate) keeps them and [`refit`](crate::refit) does not move
    /// them.
    /// Protection only adds up: nothing takes it back. Its use is a part that must keep its atoms while the rest is
    /// thinned out.
    ///
    /// # Errors
    /// [`Error::NoSuchNode`] for an atom that the model does not have; the others are then not protected either.
    pub fn protect(&mut self, atoms: impl IntoIterator<Item = usize>) -> Result<(), Error> {
        let mut selected = vec![false; self.atoms()];
        for atom in atoms {
            let count = selected.len();
            *selected.get_mut(atom).ok_or(Error::NoSuchNode {
                what: "atom",
                index: atom,
                count,
            })? = true;
        }
        self.protect_where(&selected);
        Ok(())
    }

    fn protect_where(&mut self, selected: &[bool]) {
        self.protected.resize(selected.len(), false);
        for (own, &selected) in self.protected.iter_mut().zip(selected) {
            *own |= selected;
        }
    }

    /// Is the atom protected from elimination and refit?
    pub fn is_protected(&self, atom: usize) -> bool {
        self.protected.get(atom).copied().unwrap_or(false)
    }

    /// The model of some of the atoms (ascending, at least one), without the nodes that have none of them.
    /// Of as many levels as before, with the same powers and decays. One pass over the atoms and, in step with them,
    /// the nodes of each level.
    pub(crate) fn subset(&self, atoms: &[u32]) -> Self {
        let pick = |from: &[f64]| atoms.iter().map(|&a| from[a as usize]).collect();
        let mut below = atoms.to_vec();
        let mut levels = Vec::with_capacity(self.levels.len());
        for level in &self.levels {
            let (mut nodes, mut first_child, mut power) = (Vec::new(), Vec::new(), Vec::new());
            let mut node = 0;
            for (i, &child) in below.iter().enumerate() {
                while level.first_child[node + 1] <= child {
                    node += 1;
                }
                if nodes.last() != Some(&(node as u32)) {
                    nodes.push(node as u32);
                    first_child.push(i as u32);
                    power.push(level.power[node]);
                }
            }
            first_child.push(below.len() as u32);
            levels.push(Level { first_child, power });
            below = nodes;
        }
        Self {
            centers: atoms.iter().map(|&a| self.centers[a as usize]).collect(),
            radii: pick(&self.radii),
            decays: pick(&self.decays),
            levels,
            protected: match self.protected.is_empty() {
                true => Vec::new(),
                false => atoms
                    .iter()
                    .map(|&a| self.is_protected(a as usize))
                    .collect(),
            },
        }
    }

    /// The same tree over other atoms.
    pub(crate) fn with_atoms(
        &self,
        centers: Vec<Point3>,
        radii: Vec<f64>,
        decays: Vec<f64>,
    ) -> Self {
        Self {
            centers,
            radii,
            decays,
            levels: self.levels.clone(),
            protected: self.protected.clone(),
        }
    }

    /// The same with only the levels that matter.
    pub(crate) fn compiled(&self) -> Self {
        Self {
            levels: self.compiled_levels(),
            ..self.clone()
        }
    }

    /// Adds the atoms and nodes of another model of as many levels, after its own, moved.
    pub(crate) fn append(&mut self, other: &Self, place: impl Fn(&Point3) -> Point3) {
        let mut below = self.atoms() as u32;
        for (level, more) in self.levels.iter_mut().zip(&other.levels) {
            let nodes = level.len() as u32;
            let starts = more.first_child[1..].iter().map(|c| below + c);
            level.first_child.extend(starts);
            level.power.extend(&more.power);
            below = nodes;
        }
        self.centers.extend(other.centers.iter().map(place));
        self.radii.extend(&other.radii);
        self.decays.extend(&other.decays);
    }

    /// No atoms, in as many levels as this.
    pub(crate) fn emptied(&self) -> Self {
        let none = Level {
            first_child: vec![0],
            power: Vec::new(),
        };
        Self {
            centers: Vec::new(),
            radii: Vec::new(),
            decays: Vec::new(),
            levels: vec![none; self.levels.len()],
            protected: Vec::new(),
        }
    }

    /// Raises every radius below `min_radius` to it (some PQR files give hydrogens a radius of 0).
    ///
    /// # Errors
    /// A radius, Å, that is negative, above 10⁴ or not a number.
    pub fn raise_radii(&mut self, min_radius: f64) -> Result<(), Error> {
        let fine = (0.0..=1e4).contains(&min_radius);
        require(fine, "min_radius", min_radius, "be in [0, 10000] Å")?;
        for radius in &mut self.radii {
            *radius = radius.max(min_radius);
        }
        Ok(())
    }

    /// The levels that matter: a level whose powers are all 1 is a plain sum and merges with its parent.
    /// A power of 1 passes a sum on as it is, and sums of sums are sums, so the density is the same function; but its
    /// terms are then added in another order, which is why backends and specification are compared within a bound. Also
    /// at the top: a topmost level of ones leaves its children to the root.
    pub(crate) fn compiled_levels(&self) -> Vec<Level> {
        let mut kept: Vec<Level> = Vec::new();
        // Starts of the nodes of the level below, in units of the level kept last; `None`: the same.
        let mut merged: Option<Vec<u32>> = None;
        for level in &self.levels {
            let starts: Vec<u32> = match &merged {
                None => level.first_child.clone(),
                Some(below) => level
                    .first_child
                    .iter()
                    .map(|&c| below[c as usize])
                    .collect(),
            };
            if level.power.iter().all(|&p| p == 1.0) {
                merged = Some(starts);
            } else {
                kept.push(Level {
                    first_child: starts,
                    power: level.power.clone(),
                });
                merged = None;
            }
        }
        kept
    }
}

/// `∂G/∂(x, y, z, r, κ)` of an atom at a point, from its share `∂G/∂ ln g`. By `ln g = −κ (|x − x_a|² − r²)`: that of
/// the centre is `2 κ (x − x_a)`, of the radius `2 κ r`, of the decay `r² − |x − x_a|²`.
pub(crate) fn slopes(model: &Model, a: usize, x: &Point3, share: f64) -> [f64; 5] {
    let (decay, radius) = (model.decays()[a], model.radii()[a]);
    let d = x - model.centers()[a];
    let pull = 2.0 * decay * share;
    [
        pull * d.x,
        pull * d.y,
        pull * d.z,
        pull * radius,
        share * (radius * radius - d.norm_squared()),
    ]
}
