//! `index.html` of a run: its pictures, its numbers and its surfaces to turn with the mouse, in one file that needs
//! no network. The viewer is 3Dmol.js (Rego & Koes 2015, Bioinformatics 31, 1322).

use std::path::Path;

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use geom_core::Point3;
use geom_core::io::{self, structure::Format};
use serde::Serialize;
use serde_json::Value;

use crate::picture::{Paint, Rgb, Scale, Scene};
use crate::products::Coloring;

const PAGE: &str = include_str!("../assets/page.html");
const VIEWER: &str = include_str!("../assets/3Dmol-min.js");

/// Surfaces with more triangles than this are not put on the page: its file would take long to open.
const MOST_TRIANGLES: usize = 400_000;
/// Longest text of a structure on the page, in bytes.
const LONGEST_TEXT: u64 = 6 << 20;

/// What a page shows in space.
#[derive(Default, Serialize)]
pub(crate) struct Page {
    surfaces: Vec<Surface>,
    structure: Option<Structure>,
}

/// Arrays are in base64, little-endian.
#[derive(Serialize)]
struct Surface {
    name: String,
    /// Three f32 per vertex.
    positions: String,
    /// Three u32 per triangle.
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
        let narrow = |p: &Point3| [p.x as f32, p.y as f32, p.z as f32].map(f32::to_le_bytes);
        let positions: Vec<_> = positions.iter().map(narrow).collect();
        let corners = |t: &[u32; 3]| t.map(u32::to_le_bytes);
        let triangles: Vec<_> = triangles.iter().map(corners).collect();
        let encode = |bytes: &[[[u8; 4]; 3]]| STANDARD.encode(bytes.as_flattened().as_flattened());
        let named = |(name, coloring): (String, Coloring)| NamedColoring {
            name,
            colors: STANDARD.encode(coloring.colors.as_flattened()),
            scale: coloring.scale.as_ref().map(ScaleBar::from),
            legend: coloring.legend,
        };
        self.surfaces.push(Surface {
            name: name.to_owned(),
            positions: encode(&positions),
            triangles: encode(&triangles),
            colorings: colorings.into_iter().map(named).collect(),
        });
    }

    /// Adds all layers of a scene as they are coloured.
    pub(crate) fn add_scene(&mut self, name: &str, scene: &Scene) {
        let (mut positions, mut triangles, mut colors) = (Vec::new(), Vec::new(), Vec::new());
        for layer in &scene.layers {
            let first = positions.len() as u32;
            let corner = |v: u32| layer.positions[v as usize];
            match &layer.paint {
                // Each face has corners of its own, so that its colour ends with it.
                Paint::Faces(of_faces) => {
                    for (face, &color) in layer.faces.iter().zip(of_faces) {
                        let next = positions.len() as u32;
                        triangles.push([next, next + 1, next + 2]);
                        positions.extend(face.map(corner));
                        colors.extend([color; 3]);
                    }
                    continue;
                }
                Paint::Plain(color) => colors.extend(vec![*color; layer.positions.len()]),
                Paint::Vertices(of_vertices) => colors.extend(of_vertices),
            }
            positions.extend(&layer.positions);
            triangles.extend(layer.faces.iter().map(|f| f.map(|v| first + v)));
        }
        let coloring = Coloring {
            colors,
            scale: scene.scale.clone(),
            legend: scene.legend.clone(),
        };
        let way = scene.scale.as_ref().map_or("as drawn", |s| &s.label);
        self.add(
            name,
            &positions,
            &triangles,
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
