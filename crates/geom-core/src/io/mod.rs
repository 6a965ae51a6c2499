//! Files: the only module of the house, besides the programs, that opens them.
//!
//! Each format has a module with `parse` (from memory), `write` (to any writer) and the thin
//! `read(path)` and `save(path, …)`. Inputs may be gzip-compressed; outputs are if their name ends in
//! `.gz`. Saving writes beside the target and renames, so that no half-written file is left.

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
    #[default]
    Binary,
    /// Decimal text, with as many digits as tell the numbers apart.
    Ascii,
}

/// Why a file cannot be read or written: where, and what.
#[derive(Debug)]
pub struct Error {
    /// The file, if there is one.
    pub file: Option<PathBuf>,
    /// The line, from 1, in a text format.
    pub line: Option<usize>,
    /// What is wrong.
    pub kind: ErrorKind,
}

/// What is wrong with a file.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ErrorKind {
    /// The system refuses.
    #[error("{0}")]
    System(#[from] std::io::Error),
    /// The file holds nothing.
    #[error("the file is empty")]
    Empty,
    /// The file ends too early.
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
    #[error("{0}")]
    Unsupported(String),
    /// No atom is left.
    #[error("no atoms{0}")]
    NoAtoms(String),
    /// A number of elements that no index can name or no memory can hold.
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
    pub fn in_file(self, path: impl AsRef<Path>) -> Self {
        Self {
            file: Some(path.as_ref().to_owned()),
            ..self
        }
    }
}

impl ErrorKind {
    /// `expected`, but `found`; long findings are shortened.
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
pub fn read_bytes(path: impl AsRef<Path>) -> Result<Vec<u8>, Error> {
    read_bytes_up_to(path, MAX_BYTES)
}

/// [`read_bytes`] with a limit of one's own: a file that holds more, packed or not, is refused before
/// more than the limit is in memory.
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
pub fn decompress(raw: Vec<u8>) -> Result<Vec<u8>, Error> {
    decompress_up_to(raw, MAX_BYTES)
}

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
        let file = tempfile::NamedTempFile::new_in(folder)?;
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
        let file = file.persist(path).map_err(|e| e.error)?;
        readable_by_all(&file)?;
        Ok(())
    };
    save().map_err(|e| if e.file.is_some() { e } else { e.in_file(path) })
}

/// The ending of a name in small letters, without `.gz`.
fn extension(path: &Path) -> String {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let name = name.to_ascii_lowercase();
    let name = name.strip_suffix(".gz").unwrap_or(&name);
    name.rsplit_once('.').map_or("", |(_, e)| e).to_owned()
}

/// Temporary files are private; a saved file has the usual rights.
fn readable_by_all(file: &std::fs::File) -> std::io::Result<()> {
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        file.set_permissions(std::fs::Permissions::from_mode(0o644))?;
    }
    let _ = file;
    Ok(())
}
