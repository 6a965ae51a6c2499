//! Assemblies: which chains are copied by which operators (`BIOMT`, `_pdbx_struct_assembly_gen`).
//!
//! Readers fill in [`Assembly`] while they read and evaluate nothing; [`Assembly::copies`] does so when the assembly is
//! asked for, so that a file with a broken assembly can still be read as deposited.

use std::collections::BTreeMap;

use super::names::Names;
use crate::io::{Error, ErrorKind};
use crate::structure::Transform;

/// One assembly of a file.
#[derive(Debug)]
pub(super) struct Assembly {
    /// As the file has it; in PDB files the number of the biomolecule.
    pub(super) name: String,
    pub(super) generators: Vec<Generator>,
}

/// Some chains and the operators that copy them.
#[derive(Debug)]
pub(super) struct Generator {
    /// Names of the parts; `None` means all.
    pub(super) parts: Option<Vec<Vec<u8>>>,
    /// One copy of these parts for each of them.
    pub(super) operators: Operators,
}

/// Rigid motions, in the order in which copies are numbered.
#[derive(Debug)]
pub(super) enum Operators {
    /// As listed.
    List(Vec<Transform>),
    /// An expression over named operators, e.g. `(1-60)(61-88)`.
    Expression {
        text: String,
        /// Of the file, for errors.
        line: usize,
        /// Shared by all expressions of a file.
        named: std::rc::Rc<BTreeMap<String, Transform>>,
    },
}

/// The copies of an assembly.
pub(super) struct Copies {
    /// Sets of parts, sorted; `None` means all.
    pub(super) sets: Vec<Option<Vec<u32>>>,
    /// Per copy, its set and where it stands.
    pub(super) copies: Vec<(usize, Transform)>,
}

/// No file has more; keeps mutated expressions from filling memory.
const MAX_COPIES: u128 = 1 << 17;

impl Assembly {
    /// The copies in the order of the file. Generators that use the same operator contribute to the
    /// same copy.
    ///
    /// Equal sets of parts are kept once, however many copies have them: a capsid has 60 copies of one set. A name of
    /// which no atom was read is passed over.
    ///
    /// Fails if an expression cannot be evaluated: see [`Operators::transforms`].
    pub(super) fn copies(&self, names: &Names) -> Result<Copies, Error> {
        let mut transforms: Vec<Transform> = Vec::new();
        let mut parts_of: Vec<Option<Vec<u32>>> = Vec::new();
        let mut seen: BTreeMap<[u64; 12], usize> = BTreeMap::new();
        for generator in &self.generators {
            let parts = generator.parts.as_ref().map(|list| {
                let mut parts: Vec<u32> = list.iter().filter_map(|n| names.find(n)).collect();
                parts.sort_unstable();
                parts.dedup();
                parts
            });
            for transform in generator.operators.transforms(&self.name)? {
                let copy = *seen.entry(bits(&transform)).or_insert_with(|| {
                    transforms.push(transform);
                    parts_of.push(Some(Vec::new()));
                    transforms.len() - 1
                });
                match (&mut parts_of[copy], &parts) {
                    (Some(known), Some(more)) => {
                        known.extend(more);
                        known.sort_unstable();
                        known.dedup();
                    }
                    (known, _) => *known = None,
                }
            }
        }
        let mut sets: Vec<Option<Vec<u32>>> = Vec::new();
        let mut copies = Vec::with_capacity(parts_of.len());
        for (parts, transform) in parts_of.into_iter().zip(transforms) {
            let set = sets.iter().position(|s| *s == parts).unwrap_or_else(|| {
                sets.push(parts);
                sets.len() - 1
            });
            copies.push((set, transform));
        }
        Ok(Copies { sets, copies })
    }
}

/// Equal operators have equal bits, but for the sign of zeros.
/// Files write one operator several times in the same digits, so that no tolerance is needed.
fn bits(t: &Transform) -> [u64; 12] {
    let (r, v) = (&t.rotation, &t.translation);
    std::array::from_fn(|i| (if i < 9 { r[i] } else { v[i - 9] } + 0.0).to_bits())
}

impl Operators {
    /// The Cartesian product of the groups: of `(1-60)(61-88)` operators 61 to 88 first, then 1 to 60, 1680 in all;
    /// those with the same first factor follow each other.
    ///
    /// Refuses what is no expression, names that are not in the list, ranges longer than the list, and more than 2¹⁷
    /// products, all before anything of their length is allocated.
    pub(super) fn transforms(&self, assembly: &str) -> Result<Vec<Transform>, Error> {
        let (text, line, named) = match self {
            Self::List(list) => return Ok(list.clone()),
            Self::Expression { text, line, named } => (text, *line, named),
        };
        let wrong = |expected: String| Error::at_line(ErrorKind::expected(expected, text), line);
        let groups = groups(text).ok_or_else(|| {
            wrong(format!(
                "operators of assembly {assembly}, e.g. (1-60)(61-88)"
            ))
        })?;
        let mut lists = Vec::new();
        for group in groups {
            let mut list = Vec::new();
            for item in group {
                // A range has no more members than there are operators.
                let members = match item {
                    Item::One(name) => vec![name],
                    Item::Range(first, last) if last - first < named.len() as u64 => {
                        (first..=last).map(|n| n.to_string()).collect()
                    }
                    Item::Range(first, last) => {
                        let known = named.len();
                        return Err(wrong(format!(
                            "operators {first} to {last} of assembly {assembly} among the {known} \
                             of _pdbx_struct_oper_list"
                        )));
                    }
                };
                for name in members {
                    let operator = named.get(&name).ok_or_else(|| {
                        wrong(format!(
                            "operator {name} of assembly {assembly} in _pdbx_struct_oper_list"
                        ))
                    })?;
                    list.push(*operator);
                }
            }
            lists.push(list);
        }
        let count: u128 = lists
            .iter()
            .try_fold(1u128, |n, l| n.checked_mul(l.len() as u128))
            .unwrap_or(u128::MAX);
        if count > MAX_COPIES {
            let reason = format!("assembly {assembly} has {count} copies: at most {MAX_COPIES}");
            return Err(Error::at_line(ErrorKind::TooLarge(reason), line));
        }
        // The rightmost operator acts first; the leftmost counts slowest.
        let mut product = vec![Transform::identity()];
        for list in lists {
            let each =
                |outer: &Transform| -> Vec<_> { list.iter().map(|t| outer.after(t)).collect() };
            product = product.iter().flat_map(each).collect();
        }
        Ok(product)
    }
}

/// What stands between two commas.
enum Item {
    One(String),
    Range(u64, u64),
}

/// `1,2,5-8` is one group; `(1-60)(61-88)` are two.
///
/// `None` for anything else: text outside of brackets, brackets within brackets, nothing between two commas.
fn groups(text: &str) -> Option<Vec<Vec<Item>>> {
    let text: String = text.chars().filter(|c| !c.is_whitespace()).collect();
    let lists: Vec<&str> = if text.contains('(') {
        let inner = text.strip_prefix('(')?.strip_suffix(')')?;
        inner.split(")(").collect()
    } else {
        vec![&text]
    };
    lists
        .into_iter()
        .map(|l| l.split(',').map(item).collect())
        .collect()
}

/// A hyphen between whole numbers makes a range, any other one belongs to a name; a range that falls is none.
fn item(text: &str) -> Option<Item> {
    if text.is_empty() || text.contains(['(', ')']) {
        return None;
    }
    if let Some((first, last)) = text.split_once('-')
        && let (Ok(first), Ok(last)) = (first.parse(), last.parse())
    {
        return (first <= last).then_some(Item::Range(first, last));
    }
    Some(Item::One(text.to_owned()))
}
