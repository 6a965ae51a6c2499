//! Assemblies: which chains are copied by which operators (`BIOMT`, `_pdbx_struct_assembly_gen`).

use std::collections::BTreeMap;

use super::names::Names;
use crate::io::{Error, ErrorKind};
use crate::structure::Transform;

/// One assembly of a file.
#[derive(Debug)]
pub(super) struct Assembly {
    pub(super) name: String,
    pub(super) generators: Vec<Generator>,
}

/// Some chains and the operators that copy them.
#[derive(Debug)]
pub(super) struct Generator {
    /// Names of the parts; `None` means all.
    pub(super) parts: Option<Vec<Vec<u8>>>,
    pub(super) operators: Operators,
}

#[derive(Debug)]
pub(super) enum Operators {
    /// As listed.
    List(Vec<Transform>),
    /// An expression over named operators, e.g. `(1-60)(61-88)`.
    Expression {
        text: String,
        line: usize,
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
fn bits(t: &Transform) -> [u64; 12] {
    let (r, v) = (&t.rotation, &t.translation);
    std::array::from_fn(|i| (if i < 9 { r[i] } else { v[i - 9] } + 0.0).to_bits())
}

impl Operators {
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

enum Item {
    One(String),
    Range(u64, u64),
}

/// `1,2,5-8` is one group; `(1-60)(61-88)` are two.
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
