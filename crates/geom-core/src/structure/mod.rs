//! Molecular structures: atoms in hierarchy order, with residues, chains and domains as ranges.
//!
//! Four levels: a [`Structure`] has domains (models, copies of an assembly), these chains, these residues, these atoms.
//! Each level is an array, and what belongs to an element of the level above is a range of it, so that a loop over all
//! atoms is a loop over one slice. `io::structure` reads files into it; [`StructureBuilder`] makes one by hand;
//! [`Structure::select`] names parts of it.

use std::fmt;
use std::ops::Range;

use crate::compute::parallel;
use crate::id::MAX_ELEMENTS;
use crate::nalgebra::Matrix3;
use crate::{Aabb, Point3, Vector3};

mod radii;
pub(crate) mod residues;
mod select;

pub use radii::{residue_radius, united_radius};
pub use residues::ResidueKind;
pub use select::{SelectError, Selection, Selector};

/// A short ASCII name, stored inline: atom, residue, chain or alternate-location names.
///
/// Eight bytes, copied like an integer; ordered by its bytes, so that capital letters come before small ones. The
/// default is empty.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default)]
pub struct Name([u8; 8]);

impl Name {
    /// A name of at most eight bytes of printable ASCII; blanks around it are dropped.
    /// `None` if it is longer or holds anything else.
    ///
    /// Blanks inside are refused; no text at all is the empty name.
    pub fn new(text: &str) -> Option<Self> {
        Self::from_bytes(text.as_bytes())
    }

    /// As [`new`](Self::new), of bytes.
    ///
    /// Bytes behind the name are 0, hence equality of arrays is equality of names.
    pub(crate) fn from_bytes(text: &[u8]) -> Option<Self> {
        let text = text.trim_ascii();
        let mut bytes = [0; 8];
        if text.len() > bytes.len() || !text.iter().all(u8::is_ascii_graphic) {
            return None;
        }
        bytes[..text.len()].copy_from_slice(text);
        Some(Self(bytes))
    }

    /// The name as text; empty if there is none.
    pub fn as_str(&self) -> &str {
        let end = self.0.iter().position(|&b| b == 0).unwrap_or(self.0.len());
        std::str::from_utf8(&self.0[..end]).expect("names are ASCII")
    }

    /// Is there no name?
    pub fn is_empty(&self) -> bool {
        self.0[0] == 0
    }
}

impl fmt::Display for Name {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.as_str())
    }
}
impl fmt::Debug for Name {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:?}", self.as_str())
    }
}

/// A chemical element by atomic number; 0 is unknown.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default)]
pub struct Element(pub u8);

const SYMBOLS: [&str; 119] = [
    "X", "H", "He", "Li", "Be", "B", "C", "N", "O", "F", "Ne", "Na", "Mg", "Al", "Si", "P", "S",
    "Cl", "Ar", "K", "Ca", "Sc", "Ti", "V", "Cr", "Mn", "Fe", "Co", "Ni", "Cu", "Zn", "Ga", "Ge",
    "As", "Se", "Br", "Kr", "Rb", "Sr", "Y", "Zr", "Nb", "Mo", "Tc", "Ru", "Rh", "Pd", "Ag", "Cd",
    "In", "Sn", "Sb", "Te", "I", "Xe", "Cs", "Ba", "La", "Ce", "Pr", "Nd", "Pm", "Sm", "Eu", "Gd",
    "Tb", "Dy", "Ho", "Er", "Tm", "Yb", "Lu", "Hf", "Ta", "W", "Re", "Os", "Ir", "Pt", "Au", "Hg",
    "Tl", "Pb", "Bi", "Po", "At", "Rn", "Fr", "Ra", "Ac", "Th", "Pa", "U", "Np", "Pu", "Am", "Cm",
    "Bk", "Cf", "Es", "Fm", "Md", "No", "Lr", "Rf", "Db", "Sg", "Bh", "Hs", "Mt", "Ds", "Rg", "Cn",
    "Nh", "Fl", "Mc", "Lv", "Ts", "Og",
];

impl Element {
    /// Not known.
    pub const UNKNOWN: Self = Self(0);
    /// Hydrogen (deuterium and tritium too).
    pub const HYDROGEN: Self = Self(1);
    /// Carbon.
    pub const CARBON: Self = Self(6);
    /// Nitrogen.
    pub const NITROGEN: Self = Self(7);
    /// Oxygen.
    pub const OXYGEN: Self = Self(8);
    /// Phosphorus.
    pub const PHOSPHORUS: Self = Self(15);
    /// Sulfur.
    pub const SULFUR: Self = Self(16);

    /// The element with this symbol, in any case; `D` and `T` are hydrogen.
    ///
    /// `None` for what is no symbol, `X` among it. Blanks around are dropped.
    pub fn from_symbol(symbol: &str) -> Option<Self> {
        let symbol = symbol.trim();
        if symbol.eq_ignore_ascii_case("D") || symbol.eq_ignore_ascii_case("T") {
            return Some(Self::HYDROGEN);
        }
        let found = SYMBOLS[1..]
            .iter()
            .position(|s| s.eq_ignore_ascii_case(symbol))?;
        Some(Self(found as u8 + 1))
    }

    /// The symbol, `X` if unknown.
    ///
    /// Unknown are 0 and all above 118.
    pub fn symbol(self) -> &'static str {
        SYMBOLS.get(self.0 as usize).copied().unwrap_or("X")
    }

    /// Van der Waals radius, Å: Bondi 1964 (J. Phys. Chem. 68, 441), for hydrogen Rowland & Taylor 1996 (J. Phys. Chem.
    /// 100, 7384), for main-group elements up to bismuth that Bondi lacks Mantina et al. 2009 (J. Phys. Chem. A 113,
    /// 5806); 2.0 Å for all others, and carbon's where the element is unknown.
    pub fn vdw_radius(self) -> f64 {
        match self.0 {
            1 => 1.10,
            2 => 1.40,
            3 => 1.82,
            4 => 1.53,
            5 => 1.92,
            6 => 1.70,
            7 => 1.55,
            8 => 1.52,
            9 => 1.47,
            10 => 1.54,
            11 => 2.27,
            12 => 1.73,
            13 => 1.84,
            14 => 2.10,
            15 | 16 => 1.80,
            17 => 1.75,
            18 => 1.88,
            19 => 2.75,
            20 => 2.31,
            28 => 1.63,
            29 => 1.40,
            30 => 1.39,
            31 => 1.87,
            32 => 2.11,
            33 => 1.85,
            34 => 1.90,
            35 => 1.85,
            36 => 2.02,
            37 => 3.03,
            38 => 2.49,
            46 => 1.63,
            47 => 1.72,
            48 => 1.58,
            49 => 1.93,
            50 => 2.17,
            51 | 52 => 2.06,
            53 => 1.98,
            54 => 2.16,
            55 => 3.43,
            56 => 2.68,
            78 => 1.75,
            79 => 1.66,
            80 => 1.55,
            81 => 1.96,
            82 => 2.02,
            83 => 2.07,
            92 => 1.86,
            0 => 1.70,
            _ => 2.0,
        }
    }
}

impl fmt::Debug for Element {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.symbol())
    }
}

/// One atom.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Atom {
    /// Centre, Å.
    pub position: Point3,
    /// Radius, Å.
    /// What densities and surfaces are made of. Readers give 0 or more; by hand nothing is checked.
    pub radius: f64,
    /// Partial charge, in elementary charges; 0 when the file has none.
    /// Only PQR files have some.
    pub charge: f32,
    /// Isotropic displacement parameter (B factor), Å²; 0 when the file has none.
    pub b_factor: f32,
    /// Atom name, e.g. `CA`.
    pub name: Name,
    /// Chemical element.
    pub element: Element,
    /// Was it a `HETATM` record?
    /// What a residue is part of is told by [`Residue::kind`], not by this.
    pub hetero: bool,
}

/// One residue: a name and a place in the sequence. Its atoms: [`Structure::residue_atoms`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Residue {
    /// Residue name, e.g. `ALA`.
    pub name: Name,
    /// Sequence number as in the file.
    /// Neither dense nor ascending nor unique in a chain, and perhaps negative: a label, not an index.
    pub number: i32,
    /// Insertion code, or empty.
    pub insertion: Name,
    /// Polymer, ligand, ion or water.
    pub kind: ResidueKind,
}

/// One chain: its residues are [`Structure::chain_residues`].
/// Several chains may have one name: of each copy of an assembly, of each model.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Chain {
    /// Chain identifier as in the file (author's), possibly empty.
    pub name: Name,
}

/// One domain: a set of chains that belong together. Each model and each copy made by an assembly
/// operator is a domain of its own.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Domain {
    /// Model number of the file, from 1.
    pub model: u32,
    /// Number of the assembly copy, from 1.
    pub copy: u32,
}

/// A rigid motion (or any affine map) of a copy: x ↦ R x + t.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Transform {
    /// R.
    pub rotation: Matrix3<f64>,
    /// t, Å.
    pub translation: Vector3,
}

impl Default for Transform {
    fn default() -> Self {
        Self::identity()
    }
}

impl Transform {
    /// Leaves everything where it is.
    pub fn identity() -> Self {
        Self {
            rotation: Matrix3::identity(),
            translation: Vector3::zeros(),
        }
    }

    /// The image of a point.
    pub fn apply(&self, point: &Point3) -> Point3 {
        Point3::from(self.rotation * point.coords + self.translation)
    }

    /// First `inner`, then `self`.
    ///
    /// As maps, `self ∘ inner`: the operators `(1-60)(61-88)` of an assembly are composed in this way, the rightmost
    /// first.
    pub fn after(&self, inner: &Self) -> Self {
        Self {
            rotation: self.rotation * inner.rotation,
            translation: self.rotation * inner.translation + self.translation,
        }
    }
}

/// More atoms than an index can name or memory can hold.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{atoms} atoms are too many: {limit} can be held")]
pub struct TooManyAtoms {
    /// How many there would be.
    pub atoms: u128,
    /// How many there can be. Where memory was refused before that number was reached, the atoms of the structure that
    /// was to be copied.
    pub limit: u128,
}

/// Atoms in hierarchy order: the atoms of a residue, the residues of a chain and the chains of a
/// domain are contiguous.
///
/// ```
/// use geom_core::structure::{Structure, StructureBuilder, Atom, Element, Name};
/// use geom_core::Point3;
/// let mut builder = StructureBuilder::new();
/// builder.domain(1, 1);
/// builder.chain(Name::new("A").unwrap());
/// builder.residue(Name::new("GLY").unwrap(), 1, Name::default());
/// builder.atom(Atom {
///     position: Point3::origin(),
///     radius: 1.7,
///     charge: 0.0,
///     b_factor: 0.0,
///     name: Name::new("CA").unwrap(),
///     element: Element::CARBON,
///     hetero: false,
/// });
/// let structure: Structure = builder.build();
/// assert_eq!(structure.residue_atoms(0), 0..1);
/// ```
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Structure {
    /// Level by level; element i of a level has the elements `starts[i]..starts[i + 1]` of the next.
    atoms: Vec<Atom>,
    residues: Vec<Residue>,
    chains: Vec<Chain>,
    domains: Vec<Domain>,
    /// First atom per residue, and the number of atoms at the end.
    residue_starts: Vec<u32>,
    chain_starts: Vec<u32>,
    domain_starts: Vec<u32>,
}

impl Structure {
    /// Bare atoms, as centres and radii in Å: one residue of one chain, without names. The powers of all levels
    /// then change the density but not its surface at level 1.
    ///
    /// Panics beyond [`MAX_ELEMENTS`] atoms.
    ///
    /// ```
    /// use geom_core::{Point3, Structure};
    /// let water = [([0.0, 0.0, 0.0], 1.52), ([0.96, 0.0, 0.0], 1.2), ([-0.24, 0.93, 0.0], 1.2)];
    /// let structure = Structure::of_spheres(water.map(|(p, r)| (Point3::from(p), r)));
    /// assert_eq!(structure.atoms().len(), 3);
    /// ```
    pub fn of_spheres(spheres: impl IntoIterator<Item = (Point3, f64)>) -> Self {
        let mut builder = StructureBuilder::new();
        for (position, radius) in spheres {
            builder.atom(Atom {
                position,
                radius,
                charge: 0.0,
                b_factor: 0.0,
                name: Name::default(),
                element: Element::UNKNOWN,
                hetero: false,
            });
        }
        builder.build()
    }

    /// All atoms, in hierarchy order.
    pub fn atoms(&self) -> &[Atom] {
        &self.atoms
    }
    /// All residues, in hierarchy order.
    pub fn residues(&self) -> &[Residue] {
        &self.residues
    }
    /// All chains, in hierarchy order.
    pub fn chains(&self) -> &[Chain] {
        &self.chains
    }
    /// All domains.
    ///
    /// One in a file of one model that was read without an assembly.
    pub fn domains(&self) -> &[Domain] {
        &self.domains
    }
    /// The atoms of a residue.
    ///
    /// As indices into [`Structure::atoms`]. Panics if there is no such residue.
    pub fn residue_atoms(&self, residue: usize) -> Range<usize> {
        range(&self.residue_starts, residue)
    }
    /// The residues of a chain.
    ///
    /// As indices into [`Structure::residues`]. Panics if there is no such chain.
    pub fn chain_residues(&self, chain: usize) -> Range<usize> {
        range(&self.chain_starts, chain)
    }
    /// The chains of a domain.
    ///
    /// As indices into [`Structure::chains`]. Panics if there is no such domain.
    pub fn domain_chains(&self, domain: usize) -> Range<usize> {
        range(&self.domain_starts, domain)
    }
    /// First atom per residue and the number of atoms at the end: `residues().len() + 1` values.
    ///
    /// The residue of atom a is `starts.partition_point(|&s| s as usize <= a) - 1`, as no residue is empty. A structure
    /// made by `Default` has no value at all.
    pub fn residue_starts(&self) -> &[u32] {
        &self.residue_starts
    }
    /// First residue per chain and the number of residues at the end.
    pub fn chain_starts(&self) -> &[u32] {
        &self.chain_starts
    }
    /// First chain per domain and the number of chains at the end.
    pub fn domain_starts(&self) -> &[u32] {
        &self.domain_starts
    }
    /// The smallest box that holds all atom centres.
    ///
    /// [`Aabb::EMPTY`] without atoms. For the box around the balls inflate it by the largest radius.
    pub fn center_bounds(&self) -> Aabb {
        Aabb::of_points(self.atoms.iter().map(|a| &a.position))
    }
    /// The atoms, to change radii or positions in place.
    ///
    /// Their number and their places in the hierarchy stay.
    pub fn atoms_mut(&mut self) -> &mut [Atom] {
        &mut self.atoms
    }

    /// The residues of one kind alone.
    ///
    /// Chains and domains that lose all their residues go; see [`Structure::filter`].
    pub fn of_kind(&self, kind: ResidueKind) -> Self {
        let mut keep = vec![false; self.atoms.len()];
        for (r, residue) in self.residues.iter().enumerate() {
            keep[self.residue_atoms(r)].fill(residue.kind == kind);
        }
        self.filter(|atom| keep[atom])
    }

    /// The structure of those atoms for which `keep` says so, by index; parts that lose all their
    /// atoms are dropped.
    ///
    /// `keep` is asked once per atom, in order. Names, numbers and kinds stay as they are; indices of all levels
    /// change. O(n).
    pub fn filter(&self, mut keep: impl FnMut(usize) -> bool) -> Self {
        let mut builder = StructureBuilder::new();
        for (d, &domain) in self.domains.iter().enumerate() {
            builder.domain = Some(domain);
            for c in self.domain_chains(d) {
                builder.chain = Some(self.chains[c]);
                for r in self.chain_residues(c) {
                    builder.residue = Some(self.residues[r]);
                    for a in self.residue_atoms(r).filter(|&a| keep(a)) {
                        builder.atom(self.atoms[a]);
                    }
                }
            }
        }
        builder.build()
    }

    /// Copies of parts of the structure: copy k is `parts[copies[k].0]`, one flag per residue, moved
    /// by `copies[k].1`; each copy of each domain is a domain of its own.
    ///
    /// At most `limit` atoms; the number is known before anything is allocated. The result takes
    /// 56 bytes per atom and 24 per residue.
    ///
    /// Panics if a part has not one flag per residue or a copy names a part that does not exist.
    ///
    /// Copies have the order of `copies`, and the numbers 1, 2, … as [`Domain::copy`]; a part that has no residue gives
    /// none. B factors, charges and radii are those of the original. Names of chains repeat: copies are told apart by
    /// their domains.
    ///
    /// # Errors
    /// [`TooManyAtoms`] if there would be more than `limit`, or than [`MAX_ELEMENTS`], or than the memory has room for.
    pub fn copies(
        &self,
        parts: &[Vec<bool>],
        copies: &[(usize, Transform)],
        limit: usize,
    ) -> Result<Self, TooManyAtoms> {
        // Counted before anything is allocated: an assembly of a capsid may be large.
        let atoms_of = |part: &Vec<bool>| -> u128 {
            assert_eq!(part.len(), self.residues.len(), "one flag per residue");
            let kept = (0..part.len()).filter(|&r| part[r]);
            kept.map(|r| self.residue_atoms(r).len() as u128).sum()
        };
        let sizes: Vec<u128> = parts.iter().map(atoms_of).collect();
        let total: u128 = copies.iter().map(|&(part, _)| sizes[part]).sum();
        let refused = |limit: usize| TooManyAtoms {
            atoms: total,
            limit: limit as u128,
        };
        let limit = limit.min(MAX_ELEMENTS);
        if total > limit as u128 {
            return Err(refused(limit));
        }
        // Each part once, whatever the number of its copies.
        let part = |flags: &Vec<bool>| {
            let mut kept = vec![false; self.atoms.len()];
            for r in (0..flags.len()).filter(|&r| flags[r]) {
                kept[self.residue_atoms(r)].fill(true);
            }
            self.filter(|a| kept[a])
        };
        let parts: Vec<Structure> = parts.iter().map(part).collect();
        let mut whole = Structure::default();
        // Room for all, or the error that says how much was wanted.
        let count = |f: fn(&Structure) -> usize| copies.iter().map(|&(p, _)| f(&parts[p])).sum();
        let no_memory = |_| refused(self.atoms.len());
        whole
            .atoms
            .try_reserve_exact(total as usize)
            .map_err(no_memory)?;
        let residues: usize = count(|s| s.residues.len());
        whole
            .residues
            .try_reserve_exact(residues)
            .map_err(no_memory)?;
        whole
            .residue_starts
            .try_reserve_exact(residues + 1)
            .map_err(no_memory)?;
        let mut starts = Vec::with_capacity(copies.len());
        let mut atoms = 0;
        // Starts of the hierarchy, shifted by what stands before; a copy is a domain of its own.
        for (copy, &(part, _)) in copies.iter().enumerate() {
            starts.push(atoms);
            let one = &parts[part];
            let (c, r) = (whole.chains.len() as u32, whole.residues.len() as u32);
            let inner = |starts: &[u32]| starts[..starts.len() - 1].to_vec();
            whole
                .domain_starts
                .extend(inner(&one.domain_starts).iter().map(|s| s + c));
            whole
                .chain_starts
                .extend(inner(&one.chain_starts).iter().map(|s| s + r));
            let own = inner(&one.residue_starts);
            whole
                .residue_starts
                .extend(own.iter().map(|s| s + atoms as u32));
            whole.domains.extend(one.domains.iter().map(|d| Domain {
                copy: copy as u32 + 1,
                ..*d
            }));
            whole.chains.extend(&one.chains);
            whole.residues.extend(&one.residues);
            atoms += one.atoms.len();
        }
        // The atoms, moved, each from its place alone.
        whole.atoms = parallel::map(atoms, |i| {
            let copy = starts.partition_point(|&s| s <= i) - 1;
            let (part, transform) = &copies[copy];
            let mut atom = parts[*part].atoms[i - starts[copy]];
            atom.position = transform.apply(&atom.position);
            atom
        });
        // The ends of the last ranges.
        whole.residue_starts.push(whole.atoms.len() as u32);
        whole.chain_starts.push(whole.residues.len() as u32);
        whole.domain_starts.push(whole.chains.len() as u32);
        Ok(whole)
    }
}

/// The elements of the next level that belong to element i.
fn range(starts: &[u32], i: usize) -> Range<usize> {
    starts[i] as usize..starts[i + 1] as usize
}

/// Makes a [`Structure`] from atoms in file order: say where a domain, chain or residue begins, then
/// add its atoms. Parts without atoms are dropped.
///
/// A level that is begun without one below goes on with the name of the last one there: after `domain` alone the next
/// atom begins a chain and a residue of the same names as those before.
#[derive(Debug, Default)]
pub struct StructureBuilder {
    built: Structure,
    domain: Option<Domain>,
    chain: Option<Chain>,
    residue: Option<Residue>,
}

impl StructureBuilder {
    /// Without atoms yet.
    pub fn new() -> Self {
        Self::default()
    }

    /// The next atoms belong to a new domain.
    ///
    /// Both from 1. Nothing is made before its first atom comes.
    pub fn domain(&mut self, model: u32, copy: u32) {
        self.domain = Some(Domain { model, copy });
    }

    /// The next atoms belong to a new chain.
    pub fn chain(&mut self, name: Name) {
        self.chain = Some(Chain { name });
    }

    /// The next atoms belong to a new residue.
    ///
    /// It is a residue of a polymer; [`residue_of`](Self::residue_of) says otherwise.
    pub fn residue(&mut self, name: Name, number: i32, insertion: Name) {
        self.residue_of(Residue {
            name,
            number,
            insertion,
            kind: ResidueKind::Polymer,
        });
    }

    /// The next atoms belong to this new residue.
    pub fn residue_of(&mut self, residue: Residue) {
        self.residue = Some(residue);
    }

    /// Adds an atom to the current residue, chain and domain (unnamed ones if none was begun).
    ///
    /// Panics beyond [`MAX_ELEMENTS`] atoms.
    pub fn atom(&mut self, atom: Atom) {
        let s = &mut self.built;
        assert!(
            s.atoms.len() < MAX_ELEMENTS,
            "more atoms than an index can name"
        );
        if s.domains.is_empty() && self.domain.is_none() {
            self.domain = Some(Domain { model: 1, copy: 1 });
        }
        let new_domain = self.domain.take();
        if new_domain.is_some() || s.chains.is_empty() {
            self.chain = self.chain.or(s.chains.last().copied());
            self.chain.get_or_insert(Chain {
                name: Name::default(),
            });
        }
        let new_chain = self.chain.take();
        if new_chain.is_some() || s.residues.is_empty() {
            self.residue = self.residue.or(s.residues.last().copied());
            let unnamed = Residue {
                name: Name::default(),
                number: 0,
                insertion: Name::default(),
                kind: ResidueKind::Polymer,
            };
            self.residue.get_or_insert(unnamed);
        }
        if let Some(domain) = new_domain {
            s.domain_starts.push(s.chains.len() as u32);
            s.domains.push(domain);
        }
        if let Some(chain) = new_chain {
            s.chain_starts.push(s.residues.len() as u32);
            s.chains.push(chain);
        }
        if let Some(residue) = self.residue.take() {
            s.residue_starts.push(s.atoms.len() as u32);
            s.residues.push(residue);
        }
        s.atoms.push(atom);
    }

    /// Number of atoms so far.
    pub fn len(&self) -> usize {
        self.built.atoms.len()
    }

    /// Is there no atom yet?
    pub fn is_empty(&self) -> bool {
        self.built.atoms.is_empty()
    }

    /// The structure.
    ///
    /// Without atoms it has no element on any level, and each array of starts holds one 0.
    pub fn build(self) -> Structure {
        let mut s = self.built;
        s.residue_starts.push(s.atoms.len() as u32);
        s.chain_starts.push(s.residues.len() as u32);
        s.domain_starts.push(s.chains.len() as u32);
        s
    }
}
