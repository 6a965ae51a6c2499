//! MRC/CCP4 maps (MRC2014, <https://doi.org/10.1016/j.jsb.2015.04.002>), as cryo-electron microscopy
//! and crystallography exchange them.
//!
//! A header of 1024 bytes, 256 words of four, then the values, columns fastest. The words that say where values lie:
//!
//! | words | name | meaning |
//! |---|---|---|
//! | 1–3 | NC, NR, NS | columns, rows, sections in the file |
//! | 4 | MODE | how a value is stored: [`Mode`] |
//! | 5–7 | NCSTART … | the first of each, in steps from the corner of the cell |
//! | 8–10 | MX, MY, MZ | steps along the edges of the cell |
//! | 11–16 | CELLA, CELLB | edges, Å, and angles, degrees, of the cell |
//! | 17–19 | MAPC, MAPR, MAPS | which axis of space columns, rows and sections follow |
//! | 20–22 | DMIN, DMAX, DMEAN | of the values |
//! | 24 | NSYMBT | bytes of an extended header between this one and the values |
//! | 50–52 | ORIGIN | the first point, Å |
//! | 53–54 | MAP, MACHST | `MAP `, and the byte order |
//!
//! Programs disagree about NSTART and ORIGIN, and about whether bytes have signs; what is done here is what most viewers do.
//!
//! The first point lies at ORIGIN if that is set, else at NSTART steps, as viewers of maps read it.
//! Lengths of the header are f32 and read as the shortest decimals that stand for them, so that
//! lattices with up to seven digits come back unchanged.
//!
//! ```
//! use geom_core::io::mrc;
//! use geom_core::{Lattice, LatticeValues, Point3, ScalarGrid};
//!
//! let lattice = Lattice { origin: Point3::new(-1.5, 0.0, 2.25), spacing: 0.75, counts: [3, 4, 5] };
//! let values = (0..60).map(|i| i as f32 / 7.0).collect();
//! let grid = ScalarGrid::new(lattice, values)?;
//! let mut bytes = Vec::new();
//! mrc::write(&mut bytes, &grid, mrc::Mode::Float32)?;
//! assert_eq!(bytes.len(), 1024 + 4 * 60);
//! assert_eq!(mrc::parse(&bytes)?.into_grid()?, grid);
//! // Whole numbers cannot hold sevenths.
//! assert!(mrc::write(&mut Vec::new(), &grid, mrc::Mode::Int16).is_err());
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

use std::io::Write;
use std::path::Path;

use half::f16;

use super::GridFile;
use crate::compute::parallel;
use crate::io::bytes::{Bytes, Scalar, put_all};
use crate::io::{Error, ErrorKind, read_bytes};
use crate::{LatticeValues, Point3, Vector3};

/// Bytes of the header.
const HEADER: usize = 1024;

/// How a value is stored.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Mode {
    /// Mode 0: whole numbers −128…127.
    Int8,
    /// Mode 1: whole numbers −32768…32767.
    Int16,
    /// Mode 2: as they are.
    #[default]
    Float32,
    /// Mode 6: whole numbers 0…65535.
    Uint16,
    /// Mode 12: rounded to 11 significant bits, below 65520.
    Float16,
}

impl Mode {
    /// The number in the header.
    ///
    /// Word 4, MODE.
    pub fn number(self) -> i32 {
        match self {
            Self::Int8 => 0,
            Self::Int16 => 1,
            Self::Float32 => 2,
            Self::Uint16 => 6,
            Self::Float16 => 12,
        }
    }

    /// Lowest and highest value that it can store.
    fn range(self) -> [f32; 2] {
        match self {
            Self::Int8 => [-128.0, 127.0],
            Self::Int16 => [-32_768.0, 32_767.0],
            Self::Float32 => [f32::MIN, f32::MAX],
            Self::Uint16 => [0.0, 65_535.0],
            // Anything from 65520 on would be rounded up to infinity.
            Self::Float16 => [(-65_520f32).next_up(), 65_520f32.next_down()],
        }
    }

    /// A whole number where the mode has whole numbers; NaN is in no range.
    fn holds(self, value: f32) -> bool {
        let [low, high] = self.range();
        let whole = matches!(self, Self::Int8 | Self::Int16 | Self::Uint16);
        low <= value && value <= high && (!whole || value.fract() == 0.0)
    }
}

/// Writes a grid to a file, whole or not at all.
pub fn save(
    path: impl AsRef<Path>,
    grid: &(impl LatticeValues + ?Sized),
    mode: Mode,
) -> Result<(), Error> {
    crate::io::save(path, |w| write(w, grid, mode))
}

/// Writes a grid, lowest byte first; refuses values that the mode cannot hold.
///
/// Statistics (lowest, highest, mean and standard deviation) are those of the values, summed by rows, so that a file
/// has the same bytes for any number of threads. Values are read several times.
///
/// # Errors
/// [`ErrorKind::Expected`] for a lattice without points and for the first value that the mode cannot hold, with its
/// lattice coordinates; [`ErrorKind::TooLarge`] for more than 2³¹ − 1 points along an axis.
pub fn write(
    w: &mut dyn Write,
    grid: &(impl LatticeValues + ?Sized),
    mode: Mode,
) -> Result<(), Error> {
    let lattice = grid.lattice();
    let [nx, ny, nz] = lattice.counts;
    let count = |n: usize| {
        let what = || ErrorKind::TooLarge(format!("{n} points along one axis of an MRC map"));
        i32::try_from(n).map_err(|_| what())
    };
    let counts = [count(nx)?, count(ny)?, count(nz)?];
    if lattice.is_empty() {
        return Err(
            ErrorKind::expected("a grid with points", format!("{nx} × {ny} × {nz}")).into(),
        );
    }
    // Sums by rows, whose bits do not depend on threads.
    let rows = ny * nz;
    let row = |r: usize| (0..nx).map(move |i| grid.at([i, r % ny, r / ny]));
    let n = lattice.len() as f64;
    let mean = parallel::sum(rows, |r| row(r).map(f64::from).sum()) / n;
    let variance = parallel::sum(rows, |r| {
        row(r).map(|v| (f64::from(v) - mean).powi(2)).sum()
    }) / n;
    let (mut low, mut high) = (f32::INFINITY, f32::NEG_INFINITY);
    for r in 0..rows {
        for (i, v) in row(r).enumerate() {
            (low, high) = (low.min(v), high.max(v));
            if !mode.holds(v) {
                let [low, high] = mode.range();
                let expected = format!("values {low}…{high} for mode {}", mode.number());
                let found = format!("{v} at {:?}", [i, r % ny, r / ny]);
                return Err(ErrorKind::expected(expected, found).into());
            }
        }
    }

    // The header, word for word as the format has it: points, mode, start, intervals, cell.
    let mut header = Vec::with_capacity(HEADER);
    let mut put = |words: &[i32]| words.iter().for_each(|i| i.put(&mut header));
    put(&counts);
    put(&[mode.number()]);
    put(&starts(lattice.origin, lattice.spacing));
    put(&counts);
    let mut put = |words: &[f32]| words.iter().for_each(|f| f.put(&mut header));
    put(&counts.map(|c| (f64::from(c) * lattice.spacing) as f32));
    put(&[90.0; 3]);
    let mut put = |words: &[i32]| words.iter().for_each(|i| i.put(&mut header));
    put(&[1, 2, 3]);
    let mut put = |words: &[f32]| words.iter().for_each(|f| f.put(&mut header));
    put(&[low, high, mean as f32]);
    // A volume; no extended header; version 2014.1.
    let mut put = |words: &[i32]| words.iter().for_each(|i| i.put(&mut header));
    put(&[1, 0]);
    put(&[0; 3]);
    put(&[20_141]);
    put(&[0; 21]);
    let o = lattice.origin;
    let mut put = |words: &[f32]| words.iter().for_each(|f| f.put(&mut header));
    put(&[o.x as f32, o.y as f32, o.z as f32]);
    header.extend_from_slice(b"MAP \x44\x44\0\0");
    (variance.sqrt() as f32).put(&mut header);
    1i32.put(&mut header);
    header.extend_from_slice(b"geom-core");
    // The rest of the labels is blank.
    header.resize(HEADER, b' ');
    w.write_all(&header)?;

    let values = (0..rows).flat_map(row);
    match mode {
        Mode::Int8 => put_all(w, values.map(|v| v as i8)),
        Mode::Int16 => put_all(w, values.map(|v| v as i16)),
        Mode::Float32 => put_all(w, values),
        Mode::Uint16 => put_all(w, values.map(|v| v as u16)),
        Mode::Float16 => put_all(w, values.map(|v| f16::from_f32(v).to_bits())),
    }
}

/// The origin in whole steps, for programs that do not know ORIGIN; 0 if it lies between steps.
fn starts(origin: Point3, spacing: f64) -> [i32; 3] {
    let steps = origin.coords / spacing;
    let whole = steps
        .iter()
        .all(|s| (s - s.round()).abs() < 1e-4 && s.abs() < f64::from(i32::MAX));
    match whole {
        true => [0, 1, 2].map(|k| steps[k].round() as i32),
        false => [0; 3],
    }
}

/// Reads a file.
pub fn read(path: impl AsRef<Path>) -> Result<GridFile, Error> {
    let path = path.as_ref();
    parse(&read_bytes(path)?).map_err(|e| e.in_file(path))
}

/// Reads a map from the bytes of a file: modes 0, 1, 2, 6 and 12, either byte order, any order of axes
/// and any cell.
///
/// The extended header is skipped, and the statistics of the header are not believed. Bytes have signs, as the standard
/// says, but not in files that IMOD stamps.
///
/// # Errors
/// [`ErrorKind::Truncated`] if header or values end early; [`ErrorKind::Expected`], with the place of the word in
/// bytes, for counts, axes, cell or mode that make no sense; [`ErrorKind::Unsupported`] for complex values;
/// [`ErrorKind::Grid`] for a value that is not finite.
pub fn parse(bytes: &[u8]) -> Result<GridFile, Error> {
    if bytes.is_empty() {
        return Err(ErrorKind::Empty.into());
    }
    let Some(raw) = bytes.get(..HEADER) else {
        return Err(ErrorKind::Truncated(format!("the header of {HEADER} bytes")).into());
    };
    let header = Header {
        raw,
        little: little_endian(raw)?,
    };
    let [columns, rows, sections] = header.integers(0);
    let counts = [columns, rows, sections].map(|n| usize::try_from(n).unwrap_or(0));
    if counts.contains(&0) {
        let found = format!("{columns} × {rows} × {sections}");
        return Err(ErrorKind::expected("positive counts at byte 0", found).into());
    }
    let axes = axes(header.integers(16))?;
    let (origin, steps) = frame(&header, axes)?;

    let extended = header.integer(23);
    let skipped = usize::try_from(extended).map_err(|_| {
        let expected = "the length of the extended header at byte 92";
        ErrorKind::expected(expected, extended.to_string())
    })?;
    let mut data = Bytes::new(&bytes[HEADER..], header.little);
    data.take(skipped, "the extended header")?;
    let points: u128 = counts.iter().map(|&n| n as u128).product();
    let n = usize::try_from(points).map_err(|_| ErrorKind::TooLarge(format!("{points} points")))?;
    let what = format!("{columns} × {rows} × {sections} values");
    let values = match header.integer(3) {
        0 if header.unsigned_bytes() => floats(data.many::<u8>(n, &what)?),
        0 => floats(data.many::<i8>(n, &what)?),
        1 => floats(data.many::<i16>(n, &what)?),
        2 => data.many::<f32>(n, &what)?,
        6 => floats(data.many::<u16>(n, &what)?),
        12 => data
            .many::<u16>(n, &what)?
            .into_iter()
            .map(|bits| f16::from_bits(bits).to_f32())
            .collect(),
        3 | 4 => {
            let what = "complex values (modes 3 and 4): transform the map to real space first";
            return Err(ErrorKind::Unsupported(what.to_owned()).into());
        }
        mode => {
            let expected = "mode 0, 1, 2, 6 or 12 at byte 12";
            return Err(ErrorKind::expected(expected, mode.to_string()).into());
        }
    };
    GridFile::new(origin, steps, counts, values)
}

/// All modes but 2 and 12 hold whole numbers that f32 has exactly.
fn floats<T: Into<f32>>(numbers: Vec<T>) -> Vec<f32> {
    numbers.into_iter().map(Into::into).collect()
}

/// The first 1024 bytes: 256 words of four.
struct Header<'a> {
    raw: &'a [u8],
    little: bool,
}

impl Header<'_> {
    /// Word `at`, from 0.
    fn integer(&self, at: usize) -> i32 {
        i32::get(&self.raw[4 * at..], self.little)
    }
    /// Three of them from word `at` on.
    fn integers(&self, at: usize) -> [i32; 3] {
        [at, at + 1, at + 2].map(|w| self.integer(w))
    }
    /// Three lengths or angles.
    fn lengths(&self, at: usize) -> [f64; 3] {
        [at, at + 1, at + 2].map(|w| decimal(f32::get(&self.raw[4 * w..], self.little)))
    }
    /// IMOD stamps its files, and in those bytes are unsigned unless a flag says otherwise.
    fn unsigned_bytes(&self) -> bool {
        const IMOD: i32 = 1_146_047_817;
        self.integer(38) == IMOD && self.integer(39) & 1 == 0
    }
}

/// The shortest decimal that stands for a number.
///
/// 1.06 as f32 is 1.059999942…; what was meant is 1.06, and what f32 gives back for it is the same.
fn decimal(x: f32) -> f64 {
    x.to_string().parse().unwrap_or(f64::from(x))
}

/// The machine stamp tells, unless the header makes sense only the other way round.
fn little_endian(raw: &[u8]) -> Result<bool, Error> {
    let sensible = |little: bool| {
        let header = Header { raw, little };
        let small = |n: i32, most: i32| (0..=most).contains(&n);
        small(header.integer(3), 127)
            && header.integers(16).iter().all(|&a| small(a, 3))
            && header.integers(0).iter().all(|&n| n > 0)
    };
    let stamped = raw[212] != 0x11;
    match (sensible(stamped), sensible(!stamped)) {
        (true, _) => Ok(stamped),
        (false, true) => Ok(!stamped),
        (false, false) => {
            let header = Header {
                raw,
                little: stamped,
            };
            let found = format!(
                "counts {:?}, mode {}, axes {:?}",
                header.integers(0),
                header.integer(3),
                header.integers(16)
            );
            Err(ErrorKind::expected("the header of an MRC map", found).into())
        }
    }
}

/// The axis of space that columns, rows and sections follow; 0 0 0 is an old way to say 1 2 3.
fn axes(map: [i32; 3]) -> Result<[usize; 3], Error> {
    let mut sorted = map;
    sorted.sort_unstable();
    match sorted {
        [0, 0, 0] => Ok([0, 1, 2]),
        [1, 2, 3] => Ok(map.map(|a| a as usize - 1)),
        _ => {
            let expected = "MAPC, MAPR, MAPS to be 1, 2, 3 in some order at byte 64";
            Err(ErrorKind::expected(expected, format!("{map:?}")).into())
        }
    }
}

/// The first point, and the steps of columns, rows and sections.
///
/// The cell is put as crystallographers do: a along x, b in the plane of x and y, c above it. Angles of 0 are those of
/// programs that leave them out, and mean 90°. A cell whose angles cannot meet is refused.
fn frame(header: &Header<'_>, axes: [usize; 3]) -> Result<(Point3, [Vector3; 3]), Error> {
    let intervals = header.integers(7);
    let cell = header.lengths(10);
    let angles = header.lengths(13);
    let sides = (0..3).all(|k| intervals[k] > 0 && cell[k].is_finite() && cell[k] > 0.0);
    if !sides {
        let expected =
            "a cell of positive lengths (byte 40) and intervals (byte 28): set the voxel size";
        return Err(ErrorKind::expected(expected, format!("{cell:?} Å, {intervals:?}")).into());
    }
    let lengths = step_lengths(cell, intervals);
    let right = angles.iter().all(|&a| a == 90.0 || a == 0.0);
    let directions = if right {
        [Vector3::x(), Vector3::y(), Vector3::z()]
    } else {
        // a along x, b in the xy plane.
        let [alpha, beta, gamma] = angles.map(f64::to_radians);
        let y = (alpha.cos() - beta.cos() * gamma.cos()) / gamma.sin();
        let z = 1.0 - beta.cos().powi(2) - y * y;
        let plausible = angles.iter().all(|a| (1.0..179.0).contains(a)) && z > 1e-6;
        if !plausible {
            let expected = "the angles of a cell in degrees at byte 52";
            return Err(ErrorKind::expected(expected, format!("{angles:?}")).into());
        }
        [
            Vector3::x(),
            Vector3::new(gamma.cos(), gamma.sin(), 0.0),
            Vector3::new(beta.cos(), y, z.sqrt()),
        ]
    };
    let steps = axes.map(|a| directions[a] * lengths[a]);
    let mut origin = Point3::from(header.lengths(49));
    if origin == Point3::origin() {
        let starts = header.integers(4);
        for k in 0..3 {
            origin += steps[k] * f64::from(starts[k]);
        }
    }
    Ok((origin, steps))
}

/// Cell lengths over intervals; one length for all if it explains the three.
fn step_lengths(cell: [f64; 3], intervals: [i32; 3]) -> [f64; 3] {
    let steps = [0, 1, 2].map(|k| cell[k] / f64::from(intervals[k]));
    let one = decimal(steps[0] as f32);
    let explains = (0..3).all(|k| (one * f64::from(intervals[k])) as f32 == cell[k] as f32);
    if explains { [one; 3] } else { steps }
}
