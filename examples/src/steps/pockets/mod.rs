//! Pockets of a molecule: found, ranked, outlined and scored by what else is known.

mod files;
mod scores;

use std::path::{Path, PathBuf};

use gauss_density::{Levels, Model, PointSampler, sample_band};
use geom_core::structure::{ResidueKind, Selector};
use geom_core::{Structure, TriMesh};
use secondfund_ops::PocketOptions;
use secondfund_ops::options::{OutlineOptions, OutlineSource, PatchOptions};
use secondfund_ops::pockets::{Outline, Pocket, concave_patches, find, outline};
use serde_json::json;

use self::scores::{Ligand, Potential, Scores};
use crate::args::default_spacing;
use crate::{Failure, Session, products, scripts};

/// What is asked of the pockets.
pub struct Settings {
    /// How they are found.
    pub method: Method,
    /// Decay of an atom's kernel, 1/Å²: of the surface on which they are outlined; `None`: as the method has it.
    pub decay: Option<f64>,
    /// Distance of the lattice points of that surface, Å; `None`: by the number of atoms.
    pub spacing: Option<f64>,
    /// A known ligand, which is left out of the search: pockets are scored by its density.
    pub ligand: Option<Selector>,
    /// A map whose values in each pocket are wanted.
    pub potential: Option<PathBuf>,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            method: Method::Burial(PocketOptions::default(), OutlineSource::default()),
            decay: None,
            spacing: None,
            ligand: None,
            potential: None,
        }
    }
}

/// How pockets are found.
#[derive(Clone, Copy)]
pub enum Method {
    /// Where points of a shell are deepest; outlined from this source.
    Burial(PocketOptions, OutlineSource),
    /// Patches of negative mean curvature, as the thesis has it.
    Thesis(PatchOptions),
}

impl Method {
    /// Decay of the surfaces that it is made for, 1/Å².
    pub const fn decay(&self) -> f64 {
        match self {
            Self::Burial(..) => 0.5,
            Self::Thesis(_) => 0.15,
        }
    }
}

/// Pockets with their parts of the surface.
struct Found {
    pockets: Vec<Pocket>,
    outlines: Vec<Outline>,
}

/// Finds the pockets of a structure, outlines, scores and writes them.
pub fn run(
    session: &Session,
    structure: &Structure,
    input: &Path,
    settings: &Settings,
) -> Result<(), Failure> {
    let decay = settings.decay.unwrap_or(settings.method.decay());
    let (structure, ligand) = match &settings.ligand {
        Some(selector) => {
            let (rest, ligand) = Ligand::taken_from(structure, selector, decay)?;
            (rest, Some(ligand))
        }
        None => (structure.clone(), None),
    };
    let potential = settings.potential.as_ref();
    let potential = potential
        .map(|path| Potential::read(session, path))
        .transpose()?;
    let (surface, found) = match &settings.method {
        Method::Burial(options, source) => {
            by_burial(session, &structure, settings, (options, *source), decay)?
        }
        Method::Thesis(options) => {
            let surface = surface(session, &structure, settings, decay)?;
            let found = by_patches(session, &structure, &surface, ligand.as_ref(), options)?;
            (surface, found)
        }
    };
    let scores = session.stage("scores", || {
        Scores::of(&found, &surface, ligand.as_ref(), potential.as_ref())
    })?;
    let counts = json!({ "pockets": found.pockets.len() });
    session.note("counts", counts)?;
    scores.note(session)?;
    session.files(6, || {
        files::write_table(session, &structure, &found, &scores)?;
        files::write_points(session, &found)?;
        scripts::save(session, input, &["pockets"], &["pockets"])?;
        session.show_structure(input);
        files::write_surface(session, &surface, &found.outlines)
    })
}

fn by_burial(
    session: &Session,
    structure: &Structure,
    settings: &Settings,
    (options, source): (&PocketOptions, OutlineSource),
    decay: f64,
) -> Result<(TriMesh, Found), Failure> {
    // Neighbours share the surface between them: those beyond the most have theirs, too, so that the others' rows stay the same.
    let all = PocketOptions {
        most: usize::MAX,
        ..*options
    };
    let mut found = session.stage("pockets", || find(structure, &all))?;
    let surface = surface(session, structure, settings, decay)?;
    let outlining = OutlineOptions {
        radius: options.radius,
        source,
        ..OutlineOptions::default()
    };
    let on = session.on(session.device.operators());
    let mut outlines = session.stage("outlines", || {
        outline(&surface, structure, &found.pockets, &outlining, on)
    })?;
    outlines.truncate(options.most);
    found.pockets.truncate(options.most);
    session.note("counts", json!({ "atoms": found.atoms }))?;
    session.note(
        "pockets",
        json!({
            "method": "burial",
            "atoms_counted": found.atoms,
            "which_atoms": "heavy atoms of polymers",
            "shell_points": found.shell_points,
            "candidates": found.candidates,
            "found": listed(&found.pockets),
        }),
    )?;
    let pockets = found.pockets;
    Ok((surface, Found { pockets, outlines }))
}

fn by_patches(
    session: &Session,
    structure: &Structure,
    surface: &TriMesh,
    ligand: Option<&Ligand>,
    options: &PatchOptions,
) -> Result<Found, Failure> {
    let on = session.on(session.device.operators());
    let found = session.stage("patches", || -> Result<_, Failure> {
        let field = ligand
            .map(|ligand| ligand.on_surface(surface))
            .transpose()?;
        Ok(concave_patches(
            surface,
            structure,
            field.as_deref(),
            options,
            on,
        )?)
    })?;
    let (pockets, outlines): (Vec<_>, Vec<_>) = found.into_iter().unzip();
    let ranked_by = match ligand {
        Some(_) => "mean density of the ligand",
        None => "mean curvature, most concave first",
    };
    session.note(
        "pockets",
        json!({ "method": "thesis", "ranked_by": ranked_by, "found": listed(&pockets) }),
    )?;
    Ok(Found { pockets, outlines })
}

fn listed(pockets: &[Pocket]) -> Vec<serde_json::Value> {
    let one = |p: &Pocket| json!({ "rank": p.rank, "score": p.score, "center": p.center, "volume": p.volume });
    pockets.iter().map(one).collect()
}

/// The surface of the polymers alone, the walls of closed cavities with it: sites may be buried.
fn surface(
    session: &Session,
    structure: &Structure,
    settings: &Settings,
    decay: f64,
) -> Result<TriMesh, Failure> {
    let polymer = structure.of_kind(ResidueKind::Polymer);
    let levels = Levels {
        decay,
        ..Levels::default()
    };
    let model = Model::uniform(&polymer, &levels)?;
    let options = gauss_density::Options {
        spacing: settings
            .spacing
            .unwrap_or_else(|| default_spacing(polymer.atoms().len())),
        max_memory: session.memory(),
        ..Default::default()
    };
    let sampled = session.stage("density", || {
        sample_band(&model, &options, session.on(session.device.density()))
    })?;
    let field = PointSampler::new(&model, options.cutoff)?;
    let contour = dual_contour::Options {
        max_memory: session.memory(),
        ..Default::default()
    };
    let on = session.on(session.device.contour());
    let made = session.stage("surface", || {
        dual_contour::surface(&sampled.grid, Some(&field), &contour, on)
    })?;
    products::note_surface(session, &made.mesh)?;
    if made.mesh.triangles().is_empty() {
        return Err("the surface has no triangles".into());
    }
    Ok(made.mesh)
}
