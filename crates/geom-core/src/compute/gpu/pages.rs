//! Copies between arrays of the host and mapped memory of the device, by all threads where they are long: one thread writes and
//! reads a sixth of what the link carries, and the pages of a fresh array, which the system hands out when they are first
//! touched, take three times as long again.

use bytemuck::{NoUninit, Pod};
use rayon::prelude::*;

use super::wgpu::WriteOnly;
use crate::compute::parallel;

/// Bytes that are worth a thread of their own.
const PIECE: usize = 1 << 18;
/// Values that are converted before they are written: they stay in the first cache.
const ROW: usize = 256;

/// Writes an array as it is; what is left of the memory becomes zeros.
pub(super) fn write<T: NoUninit>(data: &[T], memory: WriteOnly<'_, [u8]>) {
    let bytes: &[u8] = bytemuck::cast_slice(data);
    in_pieces(memory, bytes.len(), &|from, mut piece| {
        piece.copy_from_slice(&bytes[from..][..piece.len()]);
    });
}

/// Writes `f(0)`, `f(1)`, …, `f(len - 1)`; what is left of the memory becomes zeros. Of an item that two pieces share `f` is
/// asked twice.
pub(super) fn write_each<T: NoUninit>(
    len: usize,
    f: impl Fn(usize) -> T + Sync,
    memory: WriteOnly<'_, [u8]>,
) {
    let size = size_of::<T>().max(1);
    in_pieces(memory, len * size_of::<T>(), &|from, mut piece| {
        let mut skip = from % size;
        let mut row = Vec::with_capacity(ROW);
        for first in (from / size..len).step_by(ROW) {
            if piece.is_empty() {
                break;
            }
            row.clear();
            row.extend((first..len.min(first + ROW)).map(&f));
            let bytes = &bytemuck::cast_slice::<T, u8>(&row)[skip..];
            let bytes = &bytes[..bytes.len().min(piece.len())];
            let mut place = piece.split_off(..bytes.len()).expect("no longer than it");
            place.copy_from_slice(bytes);
            skip = 0;
        }
    });
}

/// `f` of each piece of the first `bytes` of the memory and where it starts; zeros in the rest.
fn in_pieces(
    memory: WriteOnly<'_, [u8]>,
    bytes: usize,
    f: &(dyn Fn(usize, WriteOnly<'_, [u8]>) + Sync),
) {
    let (data, mut rest) = memory.split_at(bytes);
    rest.fill(0);
    let (whole, last) = data.into_chunks::<PIECE>();
    let mut pieces: Vec<_> = whole.into_iter().map(Some).collect();
    parallel::for_each(&mut pieces, |i, piece| {
        if let Some(piece) = piece.take() {
            f(i * PIECE, piece.into());
        }
    });
    if !last.is_empty() {
        f(bytes - last.len(), last);
    }
}

/// An array of its own.
pub(super) fn copied<T: Pod + Send + Sync>(content: &[T]) -> Vec<T> {
    if size_of_val(content) <= PIECE {
        return content.to_vec();
    }
    // Straight to where it belongs, so that all threads touch the pages first.
    let least = PIECE / size_of::<T>().max(1);
    let all = content.par_iter().with_min_len(least.max(1));
    all.copied().collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Lengths around one and several pieces, and elements that do not divide a piece.
    #[test]
    fn pieces_make_up_the_whole() {
        for len in [0, 1, 7, PIECE / 12, PIECE / 12 + 1, 5 * PIECE / 12 + 3] {
            let of = |i: usize| [i as u32, (i as u32).wrapping_mul(i as u32), !(i as u32)];
            let expected: Vec<[u32; 3]> = (0..len).map(of).collect();
            let mut memory = vec![0xAAu8; size_of_val(&expected[..]) + 5];
            write_each(len, of, WriteOnly::from_mut(memory.as_mut_slice()));
            let (data, rest) = memory.split_at(size_of_val(&expected[..]));
            assert!(data == bytemuck::cast_slice::<_, u8>(&expected));
            assert_eq!(rest, [0; 5]);

            let mut again = vec![0xAAu8; memory.len()];
            write(&expected, WriteOnly::from_mut(again.as_mut_slice()));
            assert!(again == memory);
            assert!(copied(&expected) == expected);
        }
    }
}
