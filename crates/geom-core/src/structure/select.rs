//! Parts of a structure by name: chains, residues, domains, copies, models, kinds.

use std::fmt;
use std::ops::Range;
use std::str::FromStr;

use super::{Name, ResidueKind, Structure};

/// Which part of a structure is meant.
///
/// Terms separated by commas are united; factors separated by slashes are intersected.
///
/// | factor | means |
/// |---|---|
/// | `A` or `chain:A` | the chain A, in all copies and models |
/// | `chain:`, `:10-25` | the chain without a name, residues of it |
/// | `B:10-25`, `B:7`, `B:-3-4` | residues of chain B by number, both ends included |
/// | `residue:10-25` | residues by number in all chains |
/// | `name:HEM` | residues by name |
/// | `copy:2`, `copy:2-5` | copies made by an assembly |
/// | `model:1` | models of the file |
/// | `domain:3` | domains by their place in the structure, from 1 |
/// | `polymer`, `ligand`, `ion`, `water` | residues by kind |
/// | `all` | everything |
///
/// ```
/// use geom_core::structure::Selector;
/// let selector: Selector = "A,B:10-25,copy:2/name:ZN".parse()?;
/// assert_eq!(selector.to_string(), "A,B:10-25,copy:2/name:ZN");
/// assert!(Selector::parse("B:ten").is_err());
/// # Ok::<(), geom_core::structure::SelectError>(())
/// ```
///
/// Blanks around terms and factors do not matter; names have no wildcards, and their letters count as they are. Numbers
/// of residues are those of the file, and one with an insertion code goes with its number. A chain called like a
/// keyword is `chain:all`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Selector {
    terms: Vec<Vec<Factor>>,
}

/// Ranges include both ends.
#[derive(Clone, Debug, PartialEq, Eq)]
enum Factor {
    All,
    Kind(ResidueKind),
    Chain(Name),
    ChainResidues(Name, i32, i32),
    Residues(i32, i32),
    ResidueName(Name),
    Copies(u32, u32),
    Models(u32, u32),
    Domains(u32, u32),
}

/// Why a selector cannot be understood or means nothing.
///
/// Each prints as one line that says what would have been right.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum SelectError {
    /// A factor that is not of the grammar.
    #[error("cannot read {found:?} in a selector: {expected}")]
    Syntax {
        /// The factor.
        found: String,
        /// What would be understood.
        expected: &'static str,
    },
    /// A term that matches no atom of the structure.
    #[error("{term:?} matches no atom; {present}")]
    NoMatch {
        /// The term.
        term: String,
        /// What there is.
        /// The chains and domains of the structure, or what was probably meant.
        present: String,
    },
}

impl Selector {
    /// Reads a selector; the grammar is above.
    ///
    /// # Errors
    /// [`SelectError::Syntax`] for the first factor that is none: an empty one, a range that falls, a name of more than
    /// eight characters, words of other programs (`resname HEM`), for which the text says how they are written here.
    pub fn parse(text: &str) -> Result<Self, SelectError> {
        let term = |t: &str| t.split('/').map(|f| factor(f.trim())).collect();
        Ok(Self {
            terms: text.split(',').map(term).collect::<Result<_, _>>()?,
        })
    }
}

impl FromStr for Selector {
    type Err = SelectError;
    fn from_str(text: &str) -> Result<Self, SelectError> {
        Self::parse(text)
    }
}

impl fmt::Display for Selector {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (i, term) in self.terms.iter().enumerate() {
            f.write_str(if i > 0 { "," } else { "" })?;
            write_term(term, f)?;
        }
        Ok(())
    }
}

fn write_term(term: &[Factor], f: &mut dyn fmt::Write) -> fmt::Result {
    for (i, factor) in term.iter().enumerate() {
        f.write_str(if i > 0 { "/" } else { "" })?;
        match factor {
            Factor::All => f.write_str("all")?,
            Factor::Kind(ResidueKind::Polymer) => f.write_str("polymer")?,
            Factor::Kind(ResidueKind::Ligand) => f.write_str("ligand")?,
            Factor::Kind(ResidueKind::Ion) => f.write_str("ion")?,
            Factor::Kind(ResidueKind::Water) => f.write_str("water")?,
            Factor::Chain(name) if name.is_empty() || KEYWORDS.contains(&name.as_str()) => {
                write!(f, "chain:{name}")?;
            }
            Factor::Chain(name) => write!(f, "{name}")?,
            Factor::ChainResidues(name, a, b) => write_range(f, &format!("{name}:"), a, b)?,
            Factor::Residues(a, b) => write_range(f, "residue:", a, b)?,
            Factor::ResidueName(name) => write!(f, "name:{name}")?,
            Factor::Copies(a, b) => write_range(f, "copy:", a, b)?,
            Factor::Models(a, b) => write_range(f, "model:", a, b)?,
            Factor::Domains(a, b) => write_range(f, "domain:", a, b)?,
        }
    }
    Ok(())
}

fn write_range<N: PartialEq + fmt::Display>(
    f: &mut dyn fmt::Write,
    key: &str,
    a: N,
    b: N,
) -> fmt::Result {
    if a == b {
        write!(f, "{key}{a}")
    } else {
        write!(f, "{key}{a}-{b}")
    }
}

const KEYWORDS: &[&str] = &["all", "polymer", "ligand", "ion", "water"];

/// A word before a colon is a key if it is one of six, else the name of a chain; hence residues of a chain called
/// `name` are `chain:name/residue:7`.
fn factor(text: &str) -> Result<Factor, SelectError> {
    let wrong = |expected| SelectError::Syntax {
        found: text.to_owned(),
        expected,
    };
    let name = |n: &str| {
        let found = Name::new(n).filter(|_| !n.contains(':'));
        found.ok_or_else(|| wrong("a name has at most eight characters and no colon"))
    };
    let numbers = |r: &str| range(r).ok_or_else(|| wrong("expected a number or a range as 10-25"));
    let counts = |r: &str| match range(r).map(|(a, b)| (u32::try_from(a), u32::try_from(b))) {
        Some((Ok(a), Ok(b))) => Ok((a, b)),
        _ => Err(wrong("expected a number or a range as 1-4")),
    };
    if text.contains(char::is_whitespace) && !text.contains(':') {
        // As in other programs' words: `resname HEM`, `chain A`.
        let ours = "write A for a chain, residue:10-25 or B:10-25 for residues, name:HEM for those of a name; \
            commas unite, slashes intersect";
        return Err(wrong(ours));
    }
    Ok(
        match text.split_once(':').map(|(k, v)| (k.trim(), v.trim())) {
            Some(("chain", n)) => Factor::Chain(name(n)?),
            Some(("residue", r)) => numbers(r).map(|(a, b)| Factor::Residues(a, b))?,
            Some(("name", n)) => Factor::ResidueName(name(n)?),
            Some(("copy", r)) => counts(r).map(|(a, b)| Factor::Copies(a, b))?,
            Some(("model", r)) => counts(r).map(|(a, b)| Factor::Models(a, b))?,
            Some(("domain", r)) => counts(r).map(|(a, b)| Factor::Domains(a, b))?,
            Some((chain, r)) => {
                let (a, b) = numbers(r)?;
                Factor::ChainResidues(name(chain)?, a, b)
            }
            None => match text {
                "all" => Factor::All,
                "polymer" => Factor::Kind(ResidueKind::Polymer),
                "ligand" => Factor::Kind(ResidueKind::Ligand),
                "ion" => Factor::Kind(ResidueKind::Ion),
                "water" => Factor::Kind(ResidueKind::Water),
                "" => return Err(wrong("expected a chain, e.g. A or B:10-25")),
                chain => Factor::Chain(name(chain)?),
            },
        },
    )
}

/// `10`, `10-25`, `-5--2`.
///
/// The hyphen that separates is the first one behind the first character, which may be a sign. `None` if the range
/// falls.
fn range(text: &str) -> Option<(i32, i32)> {
    let hyphen = text.get(1..)?.find('-').map(|i| i + 1);
    let (first, last) = match hyphen {
        Some(i) => (text[..i].parse().ok()?, text[i + 1..].parse().ok()?),
        None => {
            let one = text.parse().ok()?;
            (one, one)
        }
    };
    (first <= last).then_some((first, last))
}

/// The residues that a [`Selector`] means in one structure.
///
/// It belongs to the structure that it was made of; for another one the numbers of its residues mean nothing.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Selection {
    residues: Vec<bool>,
}

impl Selection {
    /// One flag per residue.
    ///
    /// As long as [`Structure::residues`], in its order. [`Structure::copies`] takes such flags as a part.
    pub fn residues(&self) -> &[bool] {
        &self.residues
    }

    /// Ranges of selected atoms, in order and as long as possible.
    ///
    /// Residues that follow each other give one range, also across chains. Ascending, disjoint, none of them empty.
    pub fn atom_ranges<'a>(
        &'a self,
        structure: &'a Structure,
    ) -> impl Iterator<Item = Range<usize>> + 'a {
        let mut next = 0;
        std::iter::from_fn(move || {
            let flags = &self.residues;
            let first = next + flags.get(next..)?.iter().position(|&r| r)?;
            let length = flags[first..].iter().position(|&r| !r);
            next = length.map_or(flags.len(), |n| first + n);
            Some(structure.residue_atoms(first).start..structure.residue_atoms(next - 1).end)
        })
    }
}

impl Structure {
    /// The residues that a selector means; an error names the first term that means none.
    ///
    /// A term must mean something, or a misspelt chain in a list would pass unseen. O(residues × factors).
    ///
    /// # Errors
    /// [`SelectError::NoMatch`], of a structure without atoms in any case.
    pub fn select(&self, selector: &Selector) -> Result<Selection, SelectError> {
        let mut residues = vec![false; self.residues().len()];
        for term in &selector.terms {
            let mut matched = false;
            for (d, domain) in self.domains().iter().enumerate() {
                for c in self.domain_chains(d) {
                    for r in self.chain_residues(c) {
                        let (chain, residue) = (self.chains()[c].name, &self.residues()[r]);
                        let within = |a: i32, b: i32| (a..=b).contains(&residue.number);
                        let fits = term.iter().all(|factor| match *factor {
                            Factor::All => true,
                            Factor::Kind(kind) => residue.kind == kind,
                            Factor::Chain(name) => chain == name,
                            Factor::ChainResidues(name, a, b) => chain == name && within(a, b),
                            Factor::Residues(a, b) => within(a, b),
                            Factor::ResidueName(name) => residue.name == name,
                            Factor::Copies(a, b) => (a..=b).contains(&domain.copy),
                            Factor::Models(a, b) => (a..=b).contains(&domain.model),
                            Factor::Domains(a, b) => (a..=b).contains(&(d as u32 + 1)),
                        });
                        residues[r] |= fits;
                        matched |= fits;
                    }
                }
            }
            if !matched {
                let mut text = String::new();
                let _ = write_term(term, &mut text);
                return Err(SelectError::NoMatch {
                    term: text,
                    present: self.meant(term).unwrap_or_else(|| self.inventory()),
                });
            }
        }
        Ok(Selection { residues })
    }

    /// A chain that does not exist, but has the name of a residue that does.
    ///
    /// Who writes `HEM` for heme has named a chain.
    fn meant(&self, term: &[Factor]) -> Option<String> {
        term.iter().find_map(|factor| {
            let Factor::Chain(name) = *factor else {
                return None;
            };
            let no_chain = self.chains().iter().all(|chain| chain.name != name);
            let residues = self.residues().iter().filter(|r| r.name == name).count();
            (no_chain && residues > 0)
                .then(|| format!("name:{name} are {residues} residues of that name"))
        })
    }

    /// What a selector can choose from, in one line.
    fn inventory(&self) -> String {
        let mut names: Vec<Name> = Vec::new();
        for chain in self.chains() {
            if !names.contains(&chain.name) && names.len() < 40 {
                names.push(chain.name);
            }
        }
        let list: Vec<_> = names
            .iter()
            .map(|name| match name.as_str() {
                "" => "chain: (no name)",
                name => name,
            })
            .collect();
        let domains = self.domains().len();
        format!("chains: {}; domains: {domains}", list.join(" "))
    }
}
