//! Sparse matrices as SciPy's `.npz` (`scipy.sparse.load_npz`): compressed rows as NumPy arrays in a ZIP archive that packs
//! nothing, bit by bit what was computed.

use std::io::{self, Write};

use geom_core::algebra::SparseMatrix;

/// Writes a matrix, both halves of a symmetric one.
///
/// The whole archive is in memory once before it is written, 12 bytes per entry: sizes and checksums stand before
/// contents.
///
/// # Errors
/// Those of `out`; invalid input for 2²⁸ rows and entries or more: an archive holds 4 GB.
pub fn write(out: &mut dyn Write, matrix: &SparseMatrix) -> io::Result<()> {
    let entries = matrix.entries();
    // Of eight bytes each, and what precedes the directory is counted in 32 bits.
    if entries.saturating_add(matrix.rows()) >= 1 << 28 {
        let what = format!("{entries} entries are too many for npz");
        return Err(io::Error::new(io::ErrorKind::InvalidInput, what));
    }
    let starts = matrix.starts().iter().map(|&s| s as u32);
    let shape = [matrix.rows(), matrix.columns()].map(|n| (n as u64).to_le_bytes());
    let files = [
        ("format.npy", array("|S3", "()", b"csr".to_vec())),
        ("shape.npy", array("<i8", "(2,)", shape.concat())),
        (
            "indptr.npy",
            array("<i4", &format!("({},)", matrix.rows() + 1), bytes(starts)),
        ),
        (
            "indices.npy",
            array(
                "<i4",
                &format!("({entries},)"),
                bytes(matrix.indices().iter().copied()),
            ),
        ),
        (
            "data.npy",
            array(
                "<f8",
                &format!("({entries},)"),
                (matrix.values().iter())
                    .flat_map(|x| x.to_le_bytes())
                    .collect(),
            ),
        ),
    ];
    archive(out, &files)
}

/// Little-endian, as NumPy's `<i4`.
fn bytes(numbers: impl Iterator<Item = u32>) -> Vec<u8> {
    numbers.flat_map(u32::to_le_bytes).collect()
}

/// NumPy's format 1.0: a Python dictionary, padded so that the numbers begin at a multiple of 64 bytes.
/// `kind` and `shape` are as Python writes them; `numbers` are the bytes behind the head.
fn array(kind: &str, shape: &str, numbers: Vec<u8>) -> Vec<u8> {
    let mut head = format!("{{'descr': '{kind}', 'fortran_order': False, 'shape': {shape}, }}");
    let padding = (11 + head.len()).next_multiple_of(64) - 11 - head.len();
    head.extend(std::iter::repeat_n(' ', padding));
    head.push('\n');
    let mut out = b"\x93NUMPY\x01\x00".to_vec();
    out.extend((head.len() as u16).to_le_bytes());
    out.extend(head.into_bytes());
    out.extend(numbers);
    out
}

/// A ZIP archive of files as they are.
///
/// Each file with its local head, then the directory of all of them. Names are ASCII, and sizes fit in 32 bits, as the
/// caller has checked.
fn archive(out: &mut dyn Write, files: &[(&str, Vec<u8>)]) -> io::Result<()> {
    let (mut directory, mut at) = (Vec::new(), 0u32);
    for (name, content) in files {
        let size = (content.len() as u32).to_le_bytes();
        // Version 2.0, no flags, not packed, midnight of 1 January 1980.
        let mut about = vec![20, 0, 0, 0, 0, 0, 0, 0, 0x21, 0];
        about.extend(checksum(content).to_le_bytes());
        about.extend([size, size].concat());
        about.extend((name.len() as u16).to_le_bytes());
        about.extend([0, 0]);
        directory.extend(b"PK\x01\x02\x14\x00");
        directory.extend(&about);
        directory.extend([0; 10]);
        directory.extend(at.to_le_bytes());
        directory.extend(name.as_bytes());
        out.write_all(b"PK\x03\x04")?;
        for part in [&about[..], name.as_bytes(), content] {
            out.write_all(part)?;
        }
        at += (4 + about.len() + name.len() + content.len()) as u32;
    }
    out.write_all(&directory)?;
    let count = (files.len() as u16).to_le_bytes();
    out.write_all(b"PK\x05\x06\0\0\0\0")?;
    out.write_all(&[count, count].concat())?;
    out.write_all(&(directory.len() as u32).to_le_bytes())?;
    out.write_all(&at.to_le_bytes())?;
    out.write_all(&[0, 0])
}

/// The cyclic redundancy check of ZIP (ISO 3309, reflected).
fn checksum(bytes: &[u8]) -> u32 {
    let table: [u32; 256] = std::array::from_fn(|i| {
        (0..8).fold(i as u32, |c, _| {
            (c >> 1) ^ (0xEDB8_8320 & (c & 1).wrapping_neg())
        })
    });
    let step = |c: u32, &b: &u8| (c >> 8) ^ table[usize::from(c as u8 ^ b)];
    !bytes.iter().fold(!0, step)
}
