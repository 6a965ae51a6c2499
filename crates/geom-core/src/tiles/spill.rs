//! Pieces on disk while others are worked on.
//!
//! Nothing is compressed or cached: the system's file cache does the latter as long as there is room. A disk that is
//! too full is an error of the piece that did not fit.

use std::fs::File;
use std::io::{Read, Write};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};

/// Why something could not be put aside or taken up again.
///
/// Prints what it was, how many bytes, where, and what the system says.
#[derive(Debug, thiserror::Error)]
#[error("{what} ({bytes} bytes) {way} {}: {source}", path.display())]
pub struct SpillError {
    what: String,
    bytes: usize,
    way: &'static str,
    path: PathBuf,
    source: std::io::Error,
}

/// A folder for what does not fit into memory. What lies in it is the caller's to remove.
///
/// May be used by several threads, for different names. Ranks need different folders, or different names.
#[derive(Debug)]
pub struct Spill {
    folder: PathBuf,
    written: AtomicU64,
}

impl Spill {
    /// Puts things into a folder that exists.
    ///
    /// Whether it exists is seen when something is put there.
    pub fn into(folder: impl Into<PathBuf>) -> Self {
        Self {
            folder: folder.into(),
            written: AtomicU64::new(0),
        }
    }

    /// Bytes that have been put aside so far.
    ///
    /// Also those of which nothing remains, because they were replaced or forgotten or did not fit.
    pub fn written(&self) -> u64 {
        self.written.load(Ordering::Relaxed)
    }

    /// Where something of this name is.
    ///
    /// Nothing is created. A name is one of a file, without folders.
    pub fn path(&self, name: &str) -> PathBuf {
        self.folder.join(name)
    }

    /// Puts something aside, in place of what had its name. Where the disk is full, nothing of it remains.
    ///
    /// # Errors
    /// If the file cannot be made or filled; the size told is that of `bytes`.
    pub fn put(&self, name: &str, bytes: &[u8]) -> Result<(), SpillError> {
        let path = self.path(name);
        let written = File::create(&path).and_then(|mut file| {
            file.write_all(bytes)?;
            file.flush()
        });
        self.written
            .fetch_add(bytes.len() as u64, Ordering::Relaxed);
        written.map_err(|source| {
            // Room for what may still be said; that it fails changes nothing.
            let _ = std::fs::remove_file(&path);
            error(name, bytes.len(), "cannot be put aside in", &path, source)
        })
    }

    /// Takes something up again.
    ///
    /// It stays where it is until [`Spill::forget`].
    ///
    /// # Errors
    /// If there is none, or it cannot be read; the size told is that of what could be.
    pub fn get(&self, name: &str) -> Result<Vec<u8>, SpillError> {
        let path = self.path(name);
        let mut bytes = Vec::new();
        let read = File::open(&path).and_then(|mut file| file.read_to_end(&mut bytes));
        match read {
            Ok(_) => Ok(bytes),
            Err(source) => Err(error(
                name,
                bytes.len(),
                "cannot be read from",
                &path,
                source,
            )),
        }
    }

    /// Forgets something.
    ///
    /// # Errors
    /// If there is none, or it cannot be removed.
    pub fn forget(&self, name: &str) -> Result<(), SpillError> {
        let path = self.path(name);
        std::fs::remove_file(&path)
            .map_err(|source| error(name, 0, "cannot be removed from", &path, source))
    }
}

fn error(
    what: &str,
    bytes: usize,
    way: &'static str,
    path: &Path,
    source: std::io::Error,
) -> SpillError {
    SpillError {
        what: what.to_owned(),
        bytes,
        way,
        path: path.to_owned(),
        source,
    }
}
