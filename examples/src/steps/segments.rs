//! Segments of a surface from the eigenfunctions of an operator.

use geom_core::io::{self, view::View as Fields};
use geom_core::{Point3, TriMesh};
use secondfund_ops::segment::{GroupChoice, parts};
use secondfund_ops::{
    Element, Faces, Normals, PartOptions, SegmentOptions, Spectrum, SpectrumOptions, Surface,
    segment, spectrum,
};
use serde_json::json;

use crate::picture::{Image, Layer, Paint, Rgb, Scale, Scene, View, segment_color, sheet_of_modes};
use crate::products::{self, Coloring};
use crate::{Failure, Session};

/// How a surface is cut.
pub enum Cut {
    /// Into what several operators agree on.
    Parts(PartOptions),
    /// By the modes of one operator, as many as the segments need.
    Modes(Box<(SpectrumOptions, SegmentOptions)>),
}

/// What is asked of the segments.
pub struct Settings {
    /// How the surface is cut.
    pub cut: Cut,
    /// Rounds of smoothing of a triangle mesh's normals.
    pub normal_rounds: u32,
    /// What is smaller than this share of the thickness of the body is left out of them.
    pub detail: f64,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            cut: Cut::Parts(PartOptions::default()),
            normal_rounds: 3,
            detail: Normals::DETAIL,
        }
    }
}

/// Labels of faces, and what they came from.
struct Found {
    spectrum: Spectrum,
    labels: Vec<u32>,
    areas: Vec<f64>,
    groups: usize,
    modes: usize,
    choices: Vec<GroupChoice>,
}

/// A surface with its segments, and the triangles to draw: those of a quad are two in a row.
pub struct Segmented {
    found: Found,
    /// Per face of the input.
    labels: Vec<u32>,
    shown: TriMesh,
    sides: usize,
}

/// The segments of a surface of triangles; `face_of` has the polygon that each is of, or nothing.
pub fn of_triangles(
    session: &Session,
    mesh: TriMesh,
    face_of: &[u32],
    asked: &Settings,
) -> Result<Segmented, Failure> {
    let rounds = asked.normal_rounds;
    let normals = if asked.detail == 0.0 {
        Normals::OfMesh { rounds }
    } else {
        session.stage("normals", || {
            Normals::without_detail(&mesh, rounds, asked.detail)
        })?
    };
    let found = solve(
        asked,
        session,
        Element::Triangles(&mesh, &normals),
        &Faces::from(&mesh),
    )?;
    let labels = if face_of.is_empty() {
        found.labels.clone()
    } else {
        let mut next = 0;
        let label = |polygon: &[u32]| {
            let first = next;
            next += polygon.len();
            most(&found.labels[first..next])
        };
        face_of.chunk_by(|a, b| a == b).map(label).collect()
    };
    Ok(Segmented {
        labels,
        found,
        shown: mesh,
        sides: 3,
    })
}

/// The segments of the limit surface of quads.
pub fn of_quads(
    session: &Session,
    surface: &Surface,
    asked: &Settings,
) -> Result<Segmented, Failure> {
    let limit = surface.limit_mesh();
    let found = solve(
        asked,
        session,
        Element::CatmullClark(surface),
        &Faces::from(&limit),
    )?;
    // Where it was refined, a quad of the input has the label that most of its children have.
    let step = if surface.refined() { 4 } else { 1 };
    let labels = found.labels.chunks(step).map(most).collect();
    Ok(Segmented {
        found,
        labels,
        shown: limit.into_triangles(),
        sides: 4,
    })
}

fn solve(
    asked: &Settings,
    session: &Session,
    element: Element<'_>,
    faces: &Faces,
) -> Result<Found, Failure> {
    let run = session.on(session.device.operators());
    match &asked.cut {
        Cut::Parts(options) => {
            let found = session.stage("parts", || parts(&element, faces, options, run))?;
            let mut spectra = found.spectra;
            let spectrum = spectra.swap_remove(0);
            Ok(Found {
                groups: options.groups.unwrap_or(found.sought),
                modes: spectrum.values.len(),
                spectrum,
                labels: found.labels,
                areas: found.areas,
                choices: found.choices,
            })
        }
        Cut::Modes(options) => {
            let (modes, segments) = &**options;
            let spectrum = session.stage("modes", || spectrum(&element, modes, run))?;
            let found = session.stage("segments", || segment(&spectrum, faces, segments, run))?;
            Ok(Found {
                spectrum,
                labels: found.labels,
                areas: found.areas,
                groups: found.groups,
                modes: found.modes,
                choices: found.choices,
            })
        }
    }
}

/// The label that occurs most; of several the lowest.
fn most(labels: &[u32]) -> u32 {
    let count = |l: u32| labels.iter().filter(|&&other| other == l).count();
    let ranked = labels.iter().map(|&l| (count(l), std::cmp::Reverse(l)));
    ranked.max().map_or(0, |(_, label)| label.0)
}

/// Notes the segments and writes them, with this many modes on the contact sheet.
pub fn finish(session: &Session, done: &Segmented, modes: usize) -> Result<(), Failure> {
    note(session, done)?;
    session.files(4, || write(session, done, modes))
}

fn note(session: &Session, done: &Segmented) -> Result<(), Failure> {
    let counts = json!({ "faces": done.labels.len(), "segments": done.found.areas.len() });
    session.note("counts", counts)?;
    session.note("eigenvalues", &done.found.spectrum.values)?;
    session.note("spectral", &done.found.spectrum.report)?;
    session.note("unit", done.found.spectrum.scale)?;
    session.note("skipped", done.found.spectrum.skipped)?;
    let segments = &done.found;
    session.note(
        "segments",
        json!({
            "count": segments.areas.len(),
            "areas": segments.areas,
            "groups": segments.groups,
            "modes": segments.modes,
            "choices": segments.choices,
        }),
    )
}

fn write(session: &Session, done: &Segmented, modes: usize) -> Result<(), Failure> {
    io::save(session.output("segments.seg")?, |w| {
        for label in &done.labels {
            writeln!(w, "{label}")?;
        }
        Ok(())
    })?;
    let per_face = if done.sides == 4 { 2 } else { 1 };
    let of_triangles: Vec<Rgb> = done
        .found
        .labels
        .iter()
        .flat_map(|&l| std::iter::repeat_n(segment_color(l), per_face))
        .collect();
    session.show(
        "segments",
        &done.shown,
        colorings(done, &of_triangles, modes),
    );
    let (split, colors) = split_faces(&done.shown, &of_triangles);
    io::mesh::save(
        session.output("segments.glb")?,
        &Fields::from(&split).colored(products::rgba(&colors))?,
    )?;
    let view = View::principal(done.shown.positions()).turned(0.25, 0.2);
    session.picture("segments", || {
        let mut layer = Layer::surface(&done.shown, Paint::Faces(of_triangles));
        layer.edges = false;
        let mut scene = Scene::new(vec![layer], view);
        let (count, groups) = (done.found.areas.len(), done.found.groups);
        scene.caption = Some(format!("{count} segments from {groups} groups"));
        scene.draw(session.rasterizer()?, products::SIZE)
    })?;
    session.picture("modes", || picture_of_modes(session, done, view, modes))
}

/// What the page shows: the segments and the modes. A vertex between segments has the colour of one of them.
fn colorings(done: &Segmented, of_triangles: &[Rgb], modes: usize) -> Vec<(String, Coloring)> {
    let mut colors = vec![[255; 3]; done.shown.positions().len()];
    for (corners, &color) in done.shown.triangles().iter().zip(of_triangles) {
        corners.iter().for_each(|&v| colors[v as usize] = color);
    }
    let labels = 0..done.found.areas.len() as u32;
    let named = |l: u32| (segment_color(l), format!("segment {l}"));
    let segments = Coloring {
        colors,
        scale: None,
        legend: labels.map(named).collect(),
    };
    let mode = |(i, mode): (usize, &Vec<f64>)| {
        let scale = Scale::symmetric(mode, "");
        (format!("mode {}", i + 1), Coloring::of_values(mode, scale))
    };
    let mut ways = vec![("segments".to_owned(), segments)];
    ways.extend(
        done.found
            .spectrum
            .modes
            .iter()
            .enumerate()
            .map(mode)
            .take(modes),
    );
    ways
}

fn picture_of_modes(
    session: &Session,
    done: &Segmented,
    view: View,
    modes: usize,
) -> Result<Image, Failure> {
    let spectrum = &done.found.spectrum;
    let shown = modes.min(spectrum.modes.len());
    contact_sheet(
        session,
        &done.shown,
        view,
        &spectrum.values,
        &spectrum.modes[..shown],
    )
}

/// The contact sheet of modes at the vertices of a mesh, with their eigenvalues.
pub fn contact_sheet(
    session: &Session,
    mesh: &TriMesh,
    view: View,
    values: &[f64],
    modes: &[Vec<f64>],
) -> Result<Image, Failure> {
    let paint = |mode: &Vec<f64>| Paint::Vertices(Scale::symmetric(mode, "").colors(mode));
    let paints: Vec<Paint> = modes.iter().map(paint).collect();
    let mut layer = Layer::surface(mesh, Paint::Plain(products::GOLD));
    layer.edges = false;
    let scene = Scene::new(vec![layer], view);
    let images = scene.draw_each(session.rasterizer()?, [420, 330], &paints)?;
    let title = |(i, value): (usize, &f64)| format!("{}: λ = {}", i + 1, products::brief(*value));
    let titles = values.iter().enumerate().map(title);
    Ok(sheet_of_modes(&titles.zip(images).collect::<Vec<_>>(), 4))
}

/// Triangles that share no vertices, so that each has its own colour at its corners.
fn split_faces(mesh: &TriMesh, of_triangles: &[Rgb]) -> (TriMesh, Vec<Rgb>) {
    let corners: Vec<Point3> = (0..mesh.triangles().len())
        .flat_map(|t| mesh.corners(t))
        .collect();
    let triangles = (0..mesh.triangles().len() as u32).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]);
    let colors = of_triangles.iter().flat_map(|&c| [c; 3]).collect();
    let split = TriMesh::new(corners, triangles.collect()).expect("the triangles of a valid mesh");
    (split, colors)
}
