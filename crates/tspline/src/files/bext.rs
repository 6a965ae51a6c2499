//! BEXT 2.0, the text in which isogeometric programs exchange Bézier extraction. Read by our own reader; no other
//! program has been tried on it.
//!
//! ```text
//! B E X T 2.0
//! part  nodes  elements  vectors  weighted?
//! x y z w                                          per node
//! blocks of elements
//! 1  elements  nodes each  vectors each  3 3 0     per block; 1 is a quad of a surface
//! nodes; vectors                                   per element, from 1 on, ten per line
//! blocks of dense vectors, of sparse ones
//! vectors  16                                      per block
//! coefficients                                     five per line
//! ```

use std::collections::HashMap;
use std::io::{self, Write};

use super::words::Words;
use super::{Exchange, ExchangeElement};
use crate::Error;
use crate::surface::POINTS;

/// Writes a surface. Elements are sorted by their number of nodes; equal coefficient vectors are written once.
///
/// # Errors
/// Those of `out`.
pub fn write(out: &mut dyn Write, surface: &Exchange) -> io::Result<()> {
    let mut numbers: HashMap<[u64; POINTS], u32> = HashMap::new();
    let mut vectors: Vec<&[f64; POINTS]> = Vec::new();
    let mut of_elements = Vec::with_capacity(surface.elements.len());
    for element in &surface.elements {
        let number = |row| {
            *numbers.entry(bits(row)).or_insert_with(|| {
                vectors.push(row);
                vectors.len() as u32
            })
        };
        of_elements.push(element.rows.iter().map(number).collect::<Vec<u32>>());
    }
    let mut order: Vec<usize> = (0..surface.elements.len()).collect();
    order.sort_by_key(|&e| surface.elements[e].nodes.len());
    let blocks: Vec<&[usize]> = order
        .chunk_by(|&a, &b| surface.elements[a].nodes.len() == surface.elements[b].nodes.len())
        .collect();

    writeln!(out, "B E X T 2.0")?;
    let weighted = u32::from(surface.nodes.iter().any(|n| n[3] != 1.0));
    let (nodes, elements, count) = (surface.nodes.len(), order.len(), vectors.len());
    writeln!(out, "{:8}{nodes:8}{elements:8}{count:8}{weighted:8}", 1)?;
    for node in &surface.nodes {
        numbers_in_lines(out, node, 4)?;
    }
    writeln!(out, "{:8}", blocks.len())?;
    for block in &blocks {
        let each = surface.elements[block[0]].nodes.len();
        writeln!(
            out,
            "{:8}{:8}{each:8}{each:8}{:8}{:8}{:8}",
            1,
            block.len(),
            3,
            3,
            0
        )?;
        for &e in *block {
            let nodes: Vec<u32> = surface.elements[e].nodes.iter().map(|n| n + 1).collect();
            for ids in [&nodes, &of_elements[e]] {
                for line in ids.chunks(10) {
                    for id in line {
                        write!(out, "{id:8} ")?;
                    }
                    writeln!(out)?;
                }
            }
        }
    }
    writeln!(out, "{:8}{:8}", 1, 0)?;
    writeln!(out, "{count:8}{POINTS:8}")?;
    vectors
        .iter()
        .try_for_each(|v| numbers_in_lines(out, *v, 5))
}

fn bits(row: &[f64; POINTS]) -> [u64; POINTS] {
    row.map(f64::to_bits)
}

/// Numbers with all their digits, so many per line.
pub(super) fn numbers_in_lines(
    out: &mut dyn Write,
    numbers: &[f64],
    each: usize,
) -> io::Result<()> {
    for line in numbers.chunks(each) {
        for x in line {
            write!(out, "{x:24.16e} ")?;
        }
        writeln!(out)?;
    }
    Ok(())
}

/// Reads bicubic quads of a surface.
///
/// Blocks of any number of nodes, in any order; vectors may be shared or not. The part's number and whether points have
/// weights are not looked at: weights are always there. Memory grows with what the text holds, never with what it
/// promises.
///
/// # Errors
/// [`Error::File`] with the line; [`Error::Count`] for nodes that do not exist.
pub fn read(text: &str) -> Result<Exchange, Error> {
    let mut words = Words::new(text);
    for word in ["B", "E", "X", "T", "2.0"] {
        words.expect(word)?;
    }
    let [_, nodes, elements, _, _]: [usize; 5] = head(&mut words)?;
    let mut out = Exchange::default();
    for _ in 0..nodes {
        out.nodes.push(words.array("a coordinate or weight")?);
    }
    let blocks: usize = words.read("the number of blocks")?;
    let mut ids: Vec<Vec<usize>> = Vec::new();
    for _ in 0..blocks {
        let [kind, elements, nodes, vectors, p, q, r]: [usize; 7] = head(&mut words)?;
        if [kind, p, q, r] != [1, 3, 3, 0] || vectors != nodes {
            return Err(words.wrong("a block of bicubic quads (1 … 3 3 0)", "others"));
        }
        if nodes == 0 {
            return Err(words.wrong("a positive number of nodes", "0"));
        }
        for _ in 0..elements {
            let nodes: Vec<u32> = words.several(nodes, "the number of a node")?;
            if nodes.contains(&0) {
                return Err(words.wrong("the number of a node, from 1 on", "0"));
            }
            out.elements.push(ExchangeElement {
                nodes: nodes.into_iter().map(|n| n - 1).collect(),
                rows: Vec::new(),
            });
            ids.push(words.several(vectors, "the number of a vector")?);
        }
    }
    let [dense, sparse]: [usize; 2] = head(&mut words)?;
    if sparse != 0 {
        return Err(words.wrong("dense vectors only", "sparse ones"));
    }
    let mut vectors = Vec::new();
    for _ in 0..dense {
        let [count, length]: [usize; 2] = head(&mut words)?;
        if length != POINTS {
            return Err(words.wrong("vectors of 16 coefficients", "others"));
        }
        for _ in 0..count {
            vectors.push(words.array::<POINTS>("a coefficient")?);
        }
    }
    for (element, ids) in out.elements.iter_mut().zip(ids) {
        for id in ids {
            let vector = id.checked_sub(1).and_then(|i| vectors.get(i));
            let vector = vector.ok_or_else(|| words.wrong("the number of a vector", "another"))?;
            element.rows.push(*vector);
        }
    }
    if out.elements.len() != elements {
        return Err(words.wrong("as many elements as the first line says", "others"));
    }
    out.check()?;
    Ok(out)
}

/// So many counts.
fn head<const N: usize>(words: &mut Words<'_>) -> Result<[usize; N], Error> {
    let mut out = [0; N];
    for x in &mut out {
        *x = words.read("a count")?;
    }
    Ok(out)
}
