//! Files: the only module of the house, besides the programs, that opens them.
//!
//! Each format has a module with `parse` (from memory), `write` (to any writer) and the thin
//! `read(path)` and `save(path, …)`. Inputs may be gzip-compressed; outputs are if their name ends in
//! `.gz`. Saving writes beside the target and renames, so that no half-written file is left.
//!
//! - [`structure`]: atoms from PDB, mmCIF and PQR, with what is left out of them
//! - [`grid`]: values on a lattice from MRC maps and OpenDX grids
//! - [`mesh`]: surfaces and volumes in seven formats, all of which speak through one [`View`]
//!
//! What is read is not trusted. Counts are compared with the bytes that are there before anything is allocated for
//! them, indices must be in range, coordinates and the values of grids finite; whatever is wrong is an [`Error`] that
//! names file and line, and not a panic. A file is held in memory as a whole, so that reading takes its size (unpacked)
//! beside the result.

mod bytes;
pub mod grid;
pub mod mesh;
pub mod structure;
mod text;
pub mod view;

use std::fmt;
use std::io::{Read, Write};
use std::path::{Path, PathBuf};

pub use grid::{GridFile, dx, mrc};
pub use mesh::{AnyMesh, MeshFile, glb, msh, msh_parts, obj, off, ply, stl, vtu};
pub use structure::pqr;
pub use view::{Group, View};

use crate::{GridError, MeshError};

/// How numbers are written, in formats that allow both.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Encoding {
    /// Bytes, lowest first: small and exact.
    /// The default wherever there is a choice, which is in PLY and MSH.
    #[default]
    Binary,
    /// Decimal text, with as many digits as tell the numbers apart.
    /// Finite numbers have the same bits when they are read again; files are larger, and slower to write and to read.
    Ascii,
}

/// Why a file cannot be read or written: where, and what.
///
/// Prints as one line, `file: line 12: what is wrong`, of which each part is there only if it is known.
#[derive(Debug)]
pub struct Error {
    /// The file, if there is one.
    /// `None` for what was parsed from memory.
    pub file: Option<PathBuf>,
    /// The line, from 1, in a text format.
    /// `None` in a binary format, and where the fault is that of the whole: a count, a mesh, a missing part.
    pub line: Option<usize>,
    /// What is wrong.
    pub kind: ErrorKind,
}

/// What is wrong with a file.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ErrorKind {
    /// The system refuses.
    ///
    /// There is no such file, it may not be read or written, or the disk is full.
    #[error("{0}")]
    System(#[from] std::io::Error),
    /// The file holds nothing.
    ///
    /// Also said of gzip data that unpack to nothing, and of files of atoms that hold blanks alone.
    #[error("the file is empty")]
    Empty,
    /// The file ends too early.
    ///
    /// The text says what was cut off. Counts that promise more than the bytes left can hold are told so, too: such a
    /// file either was cut off or never was whole.
    #[error("the file ends in the middle of {0}")]
    Truncated(String),
    /// Something stands where something else should.
    #[error("expected {expected}, found {found:?}")]
    Expected {
        /// What should stand there.
        expected: String,
        /// What stands there, shortened.
        found: String,
    },
    /// The file is of a format, or uses a feature of it, that is not read here.
    ///
    /// The text says what to do instead where there is something, as to convert the file.
    #[error("{0}")]
    Unsupported(String),
    /// No atom is left.
    ///
    /// The text goes on behind these words: of which model, of which selection, or what was left out until none
    /// remained.
    #[error("no atoms{0}")]
    NoAtoms(String),
    /// A number of elements that no index can name or no memory can hold.
    ///
    /// Also a number beyond a limit that the caller has set.
    #[error("{0}")]
    TooLarge(String),
    /// The mesh in the file is not valid.
    #[error("{0}")]
    Mesh(#[from] MeshError),
    /// The grid in the file is not valid.
    #[error("{0}")]
    Grid(#[from] GridError),
}

impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some(file) = &self.file {
            write!(f, "{}: ", file.display())?;
        }
        if let Some(line) = self.line {
            write!(f, "line {line}: ")?;
        }
        self.kind.fmt(f)
    }
}

impl std::error::Error for Error {
    fn source(&self) -> Option<&(dyn std::error::Error + 'static)> {
        self.kind.source()
    }
}

impl<K: Into<ErrorKind>> From<K> for Error {
    fn from(kind: K) -> Self {
        Self {
            file: None,
            line: None,
            kind: kind.into(),
        }
    }
}

impl Error {
    /// At this line, from 1.
    pub fn at_line(kind: impl Into<ErrorKind>, line: usize) -> Self {
        Self {
            file: None,
            line: Some(line),
            kind: kind.into(),
        }
    }

    /// In this file.
    ///
    /// The last one told counts: a file that was named before is replaced.
    pub fn in_file(self, path: impl AsRef<Path>) -> Self {
        Self {
            file: Some(path.as_ref().to_owned()),
            ..self
        }
    }
}

impl ErrorKind {
    /// `expected`, but `found`; long findings are shortened.
    ///
    /// More than 60 characters of `found` become 59 and an ellipsis, so that a binary file does not fill the screen.
    pub fn expected(expected: impl Into<String>, found: impl AsRef<str>) -> Self {
        let mut found = found.as_ref().chars().take(61).collect::<String>();
        if found.chars().count() > 60 {
            found = found.chars().take(59).collect::<String>() + "…";
        }
        Self::Expected {
            expected: expected.into(),
            found,
        }
    }
}

/// The bytes of a file, decompressed if they are gzip (by content, not by name); more than
/// [`MAX_BYTES`] are refused.
///
/// # Errors
/// The same as those of [`read_bytes_up_to`].
pub fn read_bytes(path: impl AsRef<Path>) -> Result<Vec<u8>, Error> {
    read_bytes_up_to(path, MAX_BYTES)
}

/// [`read_bytes`] with a limit of one's own: a file that holds more, packed or not, is refused before
/// more than the limit is in memory.
///
/// For a moment both are held, the packed and the unpacked bytes, each up to the limit.
///
/// # Errors
/// All name the file. [`ErrorKind::System`] if it cannot be read, [`ErrorKind::TooLarge`] beyond the limit,
/// [`ErrorKind::Empty`] if nothing is in it, [`ErrorKind::Truncated`] if its gzip data end early, and
/// [`ErrorKind::Expected`] if they are damaged.
pub fn read_bytes_up_to(path: impl AsRef<Path>, max_bytes: u64) -> Result<Vec<u8>, Error> {
    let path = path.as_ref();
    let read = || -> Result<Vec<u8>, Error> {
        let mut raw = Vec::new();
        let file = std::fs::File::open(path)?;
        file.take(max_bytes.saturating_add(1))
            .read_to_end(&mut raw)?;
        if raw.len() as u64 > max_bytes {
            return Err(
                ErrorKind::TooLarge(format!("more than {max_bytes} bytes, the limit")).into(),
            );
        }
        let bytes = decompress_up_to(raw, max_bytes)?;
        if bytes.is_empty() {
            Err(ErrorKind::Empty.into())
        } else {
            Ok(bytes)
        }
    };
    read().map_err(|e| e.in_file(path))
}

/// Most bytes that a file may hold, unpacked, where the caller has no limit of its own: 8 GiB. Gzip data
/// can unpack to a thousand times their size.
pub const MAX_BYTES: u64 = 8 << 30;

/// The content of gzip data, all members, up to [`MAX_BYTES`]; other data as it is.
///
/// Gzip is known by its first two bytes, 1f 8b. Data of no bytes are no error.
///
/// # Errors
/// [`ErrorKind::TooLarge`], [`ErrorKind::Truncated`] and [`ErrorKind::Expected`], as those of [`read_bytes_up_to`].
pub fn decompress(raw: Vec<u8>) -> Result<Vec<u8>, Error> {
    decompress_up_to(raw, MAX_BYTES)
}

/// Stops one byte beyond the limit: what a few kilobytes of gzip unpack to never fills the memory. All members are
/// read, because block gzip (`bgzip`) and files that were appended to each other have many.
fn decompress_up_to(raw: Vec<u8>, limit: u64) -> Result<Vec<u8>, Error> {
    if !raw.starts_with(&[0x1f, 0x8b]) {
        return Ok(raw);
    }
    let mut bytes = Vec::new();
    let mut content =
        flate2::read::MultiGzDecoder::new(raw.as_slice()).take(limit.saturating_add(1));
    match content.read_to_end(&mut bytes) {
        Ok(_) if bytes.len() as u64 > limit => Err(ErrorKind::TooLarge(format!(
            "gzip data that unpack to more than {limit} bytes, the limit; unpack the file first"
        ))
        .into()),
        Ok(_) => Ok(bytes),
        Err(e) if e.kind() == std::io::ErrorKind::UnexpectedEof => {
            Err(ErrorKind::Truncated("gzip data".to_owned()).into())
        }
        Err(e) => Err(ErrorKind::expected("gzip data", e.to_string()).into()),
    }
}

/// Writes a file whole or not at all: into a temporary file beside it, then renamed. A name that ends
/// in `.gz` makes it gzip.
///
/// Who reads the target meanwhile sees the old file or the new one, never a part. If `write` fails, the temporary file
/// is removed and the old one stays. The name must lie in a folder that exists and may be written to; a symbolic link
/// is replaced, not followed. Nothing is flushed to the medium: after a crash of the machine the file may be lost.
///
/// # Errors
/// What `write` gives, and [`ErrorKind::System`] from making, filling or renaming the file; the file is named.
///
/// ```
/// use geom_core::io::{read_bytes, save};
/// let path = std::env::temp_dir().join(format!("four-bytes-{}.gz", std::process::id()));
/// save(&path, |w| Ok(w.write_all(b"GATC")?))?;
/// assert!(std::fs::read(&path)?.starts_with(&[0x1f, 0x8b]));
/// assert_eq!(read_bytes(&path)?, b"GATC");
/// # std::fs::remove_file(path)?;
/// # Ok::<(), geom_core::io::Error>(())
/// ```
pub fn save(
    path: impl AsRef<Path>,
    write: impl FnOnce(&mut dyn Write) -> Result<(), Error>,
) -> Result<(), Error> {
    let path = path.as_ref();
    let folder = match path.parent() {
        Some(p) if !p.as_os_str().is_empty() => p,
        _ => Path::new("."),
    };
    let save = || -> Result<(), Error> {
        let file = private_or_usual(path).tempfile_in(folder)?;
        let mut buffered = std::io::BufWriter::with_capacity(1 << 20, file);
        if path
            .extension()
            .is_some_and(|e| e.eq_ignore_ascii_case("gz"))
        {
            let mut gzip = flate2::write::GzEncoder::new(&mut buffered, Default::default());
            write(&mut gzip)?;
            gzip.finish()?;
        } else {
            write(&mut buffered)?;
        }
        let file = buffered.into_inner().map_err(|e| e.into_error())?;
        file.persist(path).map_err(|e| e.error)?;
        Ok(())
    };
    save().map_err(|e| if e.file.is_some() { e } else { e.in_file(path) })
}

/// The ending of a name in small letters, without `.gz`.
///
/// Empty if the name has no dot.
fn extension(path: &Path) -> String {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let name = name.to_ascii_lowercase();
    let name = name.strip_suffix(".gz").unwrap_or(&name);
    name.rsplit_once('.').map_or("", |(_, e)| e).to_owned()
}

/// Temporary files are private; a saved file has the rights of the one that it replaces, or those of any new file (all
/// that the user's mask leaves).
fn private_or_usual(path: &Path) -> tempfile::Builder<'static, 'static> {
    let mut builder = tempfile::Builder::new();
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        let replaced = std::fs::metadata(path).map(|m| m.permissions().mode() & 0o777);
        builder.permissions(std::fs::Permissions::from_mode(replaced.unwrap_or(0o666)));
    }
    let _ = path;
    builder
}
