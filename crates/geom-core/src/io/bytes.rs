//! Numbers as bytes: writers of whole arrays, and a reader that names what is cut off.
//!
//! The readers of MRC, VTU and binary MSH stand on [`Bytes`], their writers on [`put_all`]; those of GLB and PLY use
//! [`Scalar`] alone. Written is always the lowest byte first; read is either order, as the file says.

use std::io::Write;

use super::{Error, ErrorKind};

/// A number with a fixed width in bytes.
pub(super) trait Scalar: Copy + Default {
    /// Bytes per number.
    const WIDTH: usize;
    /// Appends the number, lowest byte first.
    fn put(self, to: &mut Vec<u8>);
    /// The number in the first bytes.
    /// Panics if there are fewer than [`Scalar::WIDTH`] bytes: callers take them first. `little`: the lowest byte comes
    /// first.
    fn get(from: &[u8], little: bool) -> Self;
}

macro_rules! scalars {
    ($($t:ty),*) => {$(
        impl Scalar for $t {
            const WIDTH: usize = size_of::<$t>();
            fn put(self, to: &mut Vec<u8>) {
                to.extend_from_slice(&self.to_le_bytes());
            }
            fn get(from: &[u8], little: bool) -> Self {
                let mut bytes = [0; Self::WIDTH];
                bytes.copy_from_slice(&from[..Self::WIDTH]);
                if little { Self::from_le_bytes(bytes) } else { Self::from_be_bytes(bytes) }
            }
        }
    )*};
}
scalars!(i8, u8, i16, u16, i32, u32, i64, u64, f32, f64);

/// Writes numbers, lowest byte first.
///
/// In pieces of 64 KiB, so that neither the whole array exists twice nor each number costs a call of a `dyn Write`.
pub(super) fn put_all<T: Scalar>(
    to: &mut dyn Write,
    numbers: impl IntoIterator<Item = T>,
) -> Result<(), Error> {
    const PIECE: usize = 1 << 16;
    let mut buffer = Vec::with_capacity(PIECE + 8);
    for number in numbers {
        number.put(&mut buffer);
        if buffer.len() >= PIECE {
            to.write_all(&buffer)?;
            buffer.clear();
        }
    }
    Ok(to.write_all(&buffer)?)
}

/// Reads a byte after another.
///
/// What is taken is borrowed from the file; nothing is copied before it is known to be there.
pub(super) struct Bytes<'a> {
    rest: &'a [u8],
    /// Lowest byte first?
    pub(super) little: bool,
}

impl<'a> Bytes<'a> {
    /// Stands before the first byte.
    pub(super) fn new(bytes: &'a [u8], little: bool) -> Self {
        Self {
            rest: bytes,
            little,
        }
    }
    /// What has not been taken yet.
    pub(super) fn rest(&self) -> &'a [u8] {
        self.rest
    }
    /// The next `n` bytes; `what` they are is named if they are not there.
    pub(super) fn take(&mut self, n: usize, what: &str) -> Result<&'a [u8], Error> {
        match self.rest.split_at_checked(n) {
            Some((taken, rest)) => {
                self.rest = rest;
                Ok(taken)
            }
            None => Err(ErrorKind::Truncated(what.to_owned()).into()),
        }
    }
    /// The next number; `what` it is is named if the bytes end in it.
    pub(super) fn one<T: Scalar>(&mut self, what: &str) -> Result<T, Error> {
        let little = self.little;
        Ok(T::get(self.take(T::WIDTH, what)?, little))
    }
    /// `n` numbers. Memory is taken only if the bytes are there.
    ///
    /// `n` is what a file says, so it may be anything: a product that overflows is [`ErrorKind::TooLarge`], and more
    /// numbers than bytes are [`ErrorKind::Truncated`].
    pub(super) fn many<T: Scalar>(&mut self, n: usize, what: &str) -> Result<Vec<T>, Error> {
        let little = self.little;
        let bytes = n
            .checked_mul(T::WIDTH)
            .ok_or_else(|| ErrorKind::TooLarge(format!("{n} numbers in {what}")))?;
        let bytes = self.take(bytes, what)?;
        Ok(bytes
            .chunks_exact(T::WIDTH)
            .map(|b| T::get(b, little))
            .collect())
    }
}
