//! Where a field comes from: the atoms of a structure.

use std::path::{Path, PathBuf};

use clap::Args;
use gauss_density::{Cutoff, Model, PointSampler, sample_band};
use geom_core::io::structure::Membrane;
use geom_core::{BrickGrid, Structure};
use serde::Serialize;

use crate::args::{DensityArgs, ReaderArgs};
use crate::{Failure, Session};

/// A structure, and how to make a field of it.
#[derive(Clone, Debug, Args, Serialize)]
pub struct SourceArgs {
    /// Structure: PDB, mmCIF or PQR, each also gzip-compressed
    pub input: PathBuf,
    /// The density of structures.
    #[command(flatten)]
    pub density: DensityArgs,
    /// How structures are read.
    #[command(flatten)]
    pub reader: ReaderArgs,
}

/// A field ready to be meshed.
pub struct Source {
    /// The structure that the field comes from.
    pub structure: Structure,
    /// Its model.
    pub model: Model,
    /// Values on a lattice, near the surface only.
    pub values: BrickGrid,
    /// The value on the surface.
    pub level: f64,
    /// The planes of a membrane, if the file marks one.
    pub membrane: Option<Membrane>,
    cutoff: Cutoff,
}

/// The extension of a file name, lower-case, before `.gz`.
pub fn extension(path: &Path) -> String {
    let name = path
        .file_name()
        .unwrap_or_default()
        .to_string_lossy()
        .to_ascii_lowercase();
    let stem = name.strip_suffix(".gz").unwrap_or(&name);
    stem.rsplit_once('.')
        .map(|(_, e)| e.to_owned())
        .unwrap_or_default()
}

impl SourceArgs {
    /// Reads a structure and samples its density, as stages of the session.
    pub fn read(&self, session: &Session) -> Result<Source, Failure> {
        let read = self.reader.read(session, &self.input)?;
        let (structure, membrane) = (read.structure, read.report.membrane);
        let model = Model::uniform(&structure, &self.density.model.levels())?;
        let options = self.density.options(&structure, session);
        let sampled = session.stage("density", || {
            sample_band(&model, &options, session.on(session.device.density()))
        })?;
        session.note("density", &sampled.report)?;
        session.note("spacing", options.spacing)?;
        Ok(Source {
            structure,
            model,
            values: sampled.grid,
            level: 1.0,
            membrane,
            cutoff: options.cutoff,
        })
    }
}

impl Source {
    /// The field between the lattice points.
    pub fn field(&self) -> Result<PointSampler<'_>, Failure> {
        Ok(PointSampler::new(&self.model, self.cutoff)?)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_extension_is_that_before_gz() {
        assert_eq!(extension(Path::new("a/B.PDB.gz")), "pdb");
        assert_eq!(extension(Path::new("emd_1234.map")), "map");
        assert_eq!(extension(Path::new("none")), "");
    }
}
