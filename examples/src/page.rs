//! `index.html` of a run: its pictures, its numbers and its surfaces to turn with the mouse, in one file that needs
//! no network. The viewer is 3Dmol.js (Rego & Koes 2015, Bioinformatics 31, 1322).

use std::io::Write as _;
use std::path::Path;

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use flate2::Compression;
use flate2::write::ZlibEncoder;
use geom_core::io::{self, structure::Format};
use geom_core::{Aabb, Point3};
use serde::Serialize;
use serde_json::Value;

use crate::picture::{Rgb, Scale, Scene};
use crate::products::Coloring;

const PAGE: &str = include_str!("../assets/page.html");
const VIEWER: &str = include_str!("../assets/3Dmol-min.js");

/// Surfaces with more triangles than this are not put on the page: its file would take long to open.
const MOST_TRIANGLES: usize = 400_000;
/// Longest text of a structure on the page, in bytes.
const LONGEST_TEXT: u64 = 6 << 20;

/// The viewer unpacks it.
fn pack(bytes: &[u8]) -> String {
    let mut packed = ZlibEncoder::new(Vec::new(), Compression::default());
    let written = packed.write_all(bytes).and_then(|()| packed.finish());
    STANDARD.encode(written.expect("memory takes what is written"))
}

/// What a page shows in space.
#[derive(Default, Serialize)]
pub(crate) struct Page {
    surfaces: Vec<Surface>,
    structure: Option<Structure>,
}

/// Arrays are packed: little-endian, zlib, base64.
#[derive(Serialize)]
struct Surface {
    name: String,
    /// Opposite corners of the box around the vertices.
    bounds: [[f64; 3]; 2],
    /// Three u16 per vertex: how far it lies in the box, less what the vertex before has.
    positions: String,
    /// Three u32 per triangle: vertices, less the one before.
    triangles: String,
    colorings: Vec<NamedColoring>,
}

#[derive(Serialize)]
struct NamedColoring {
    name: String,
    /// Three bytes per vertex.
    colors: String,
    legend: Vec<(Rgb, String)>,
    scale: Option<ScaleBar>,
}

#[derive(Serialize)]
struct ScaleBar {
    label: String,
    low: f64,
    high: f64,
    colors: Vec<Rgb>,
}

impl From<&Scale> for ScaleBar {
    fn from(scale: &Scale) -> Self {
        const STEPS: usize = 16;
        Self {
            label: scale.label.clone(),
            low: scale.low,
            high: scale.high,
            colors: (0..=STEPS)
                .map(|i| scale.map.at(i as f64 / STEPS as f64))
                .collect(),
        }
    }
}

#[derive(Serialize)]
struct Structure {
    format: &'static str,
    text: String,
}

impl Page {
    /// Adds triangles in one or more colourings; nothing if they are too many.
    pub(crate) fn add(
        &mut self,
        name: &str,
        positions: &[Point3],
        triangles: &[[u32; 3]],
        colorings: Vec<(String, Coloring)>,
    ) {
        if triangles.len() > MOST_TRIANGLES || colorings.is_empty() {
            return;
        }
        let bounds = Aabb::of_points(positions);
        let bounds = [bounds.min, bounds.max].map(<[f64; 3]>::from);
        let within = |p: &Point3, k: usize| {
            let [low, high] = bounds.map(|corner| corner[k]);
            let share = (p[k] - low) / (high - low).max(f64::MIN_POSITIVE);
            (share * f64::from(u16::MAX)).round() as u16
        };
        let mut before = [0u16; 3];
        let places = positions.iter().flat_map(|p| {
            let place = [0, 1, 2].map(|k| within(p, k));
            let step = [0, 1, 2].map(|k| place[k].wrapping_sub(before[k]));
            before = place;
            step.map(u16::to_le_bytes).concat()
        });
        let mut before = 0u32;
        let corners = triangles.as_flattened().iter().flat_map(|&v| {
            let step = v.wrapping_sub(before);
            before = v;
            step.to_le_bytes()
        });
        let named = |(name, coloring): (String, Coloring)| NamedColoring {
            name,
            colors: pack(coloring.colors.as_flattened()),
            scale: coloring.scale.as_ref().map(ScaleBar::from),
            legend: coloring.legend,
        };
        self.surfaces.push(Surface {
            name: name.to_owned(),
            bounds,
            positions: pack(&Vec::from_iter(places)),
            triangles: pack(&Vec::from_iter(corners)),
            colorings: colorings.into_iter().map(named).collect(),
        });
    }

    /// Adds all layers of a scene as they are coloured.
    pub(crate) fn add_scene(&mut self, name: &str, scene: &Scene) {
        let all = scene.merged();
        let coloring = Coloring {
            colors: all.colors,
            scale: scene.scale.clone(),
            legend: scene.legend.clone(),
        };
        let way = scene.scale.as_ref().map_or("as drawn", |s| &s.label);
        self.add(
            name,
            &all.positions,
            &all.triangles,
            vec![(way.to_owned(), coloring)],
        );
    }

    /// Shows a structure inside the surfaces, as its file has it; nothing if that is long or not read.
    pub(crate) fn put_structure(&mut self, file: &Path) {
        let Ok(content) = io::read_bytes_up_to(file, LONGEST_TEXT) else {
            return;
        };
        let format = match Format::detect(&content, Some(file)) {
            Ok(Format::Pdb) => "pdb",
            Ok(Format::Mmcif) => "cif",
            Ok(Format::Pqr) => "pqr",
            Err(_) => return,
        };
        let text = String::from_utf8_lossy(&content).into_owned();
        self.structure = Some(Structure { format, text });
    }

    /// Writes the page of a run with this report, which ended with these words. Surfaces stand in the order of their
    /// names, whichever was made first, those of parts of the run (`part: surface`) behind the others.
    pub(crate) fn save(
        mut self,
        path: &Path,
        report: &Value,
        words: &[String],
    ) -> Result<(), io::Error> {
        let place = |s: &Surface| (s.name.contains(": "), s.name.clone());
        self.surfaces.sort_by_key(place);
        let data = serde_json::json!({
            "report": report,
            "words": words,
            "surfaces": self.surfaces,
            "structure": self.structure,
        });
        // Nothing in the data may end the element that holds it.
        let data = data.to_string().replace('<', "\\u003c");
        let (head, rest) = PAGE.split_once("@DATA@").expect("the page has its marks");
        let (middle, tail) = rest.split_once("@VIEWER@").expect("the page has its marks");
        io::save(path, |w| {
            for part in [head, &data, middle, VIEWER, tail] {
                w.write_all(part.as_bytes())?;
            }
            Ok(())
        })
    }
}
