//! Cross fields and quad meshes: their options on the command line, how they are drawn, and what is warned of.

use clap::ValueEnum;
use crossfield::field::Frames;
use crossfield::guidance::{Modes, Normalization};
use crossfield::quads::{Report, Rung};
use crossfield::{CrossField, Guidance};
use geom_core::mesh::shapes;
use geom_core::{Point3, TriMesh, Vector3};
use serde::Serialize;

use crate::picture::{Layer, Paint, Rgb};
use crate::{Failure, Session};

/// A vertex where three quads or fewer meet.
const POSITIVE: Rgb = [52, 102, 178];
/// A vertex where five quads or more meet.
const NEGATIVE: Rgb = [204, 66, 56];
const INK: Rgb = [40, 44, 52];
/// Crosses drawn at most.
const CROSSES: usize = 6000;

/// How strictly the guidance is followed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Mode {
    /// Exactly.
    Hard,
    /// As far as the field stays smooth.
    #[default]
    Soft,
}

/// What the field follows.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum Guide {
    /// Nothing but itself.
    #[default]
    None,
    /// Isocontours of these eigenfunctions, or of those that stand apart.
    Modes(Modes),
    /// Characteristic values of these.
    Characteristic(Modes),
    /// Principal curvature.
    Curvature,
}

impl std::fmt::Display for Guide {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let listed = |name: &str, modes: &Modes| match modes {
            Modes::Auto => format!("{name}:auto"),
            Modes::Numbers(n) => {
                let n: Vec<String> = n.iter().map(usize::to_string).collect();
                format!("{name}:{}", n.join(","))
            }
        };
        match self {
            Self::None => write!(f, "none"),
            Self::Curvature => write!(f, "curvature"),
            Self::Modes(modes) => write!(f, "{}", listed("modes", modes)),
            Self::Characteristic(modes) => write!(f, "{}", listed("characteristic", modes)),
        }
    }
}

impl Serialize for Guide {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

/// `none`, `curvature`, `modes:1,2`, `modes:auto`, `characteristic:1,2,3`, `characteristic:auto`.
pub fn guide(text: &str) -> Result<Guide, String> {
    let modes = |list: &str| -> Result<Modes, String> {
        if list == "auto" {
            return Ok(Modes::Auto);
        }
        let numbers: Result<Vec<usize>, _> = list.split(',').map(str::parse).collect();
        match numbers {
            Ok(numbers) if numbers.iter().all(|&n| (1..=100).contains(&n)) => {
                Ok(Modes::Numbers(numbers))
            }
            _ => Err(format!("`{list}` is no list of mode numbers from 1 to 100")),
        }
    };
    match text.split_once(':') {
        None if text == "none" => Ok(Guide::None),
        None if text == "curvature" => Ok(Guide::Curvature),
        None if text == "modes" => Ok(Guide::Modes(Modes::Auto)),
        Some(("modes", list)) => Ok(Guide::Modes(modes(list)?)),
        Some(("characteristic", list)) => Ok(Guide::Characteristic(modes(list)?)),
        _ => Err("it must be none, curvature, modes:1,2, modes:auto or characteristic:1,2".into()),
    }
}

impl Guide {
    /// For the library.
    pub fn guidance(&self, mode: Mode) -> Vec<Guidance> {
        let weight = match mode {
            Mode::Hard => f64::INFINITY,
            Mode::Soft => 1.0,
        };
        match self.clone() {
            Self::None => Vec::new(),
            Self::Curvature => vec![Guidance::Curvature {
                threshold: 0.8,
                weight,
            }],
            Self::Modes(modes) => vec![Guidance::Isocontours {
                modes,
                inset: 0.125,
                weight,
            }],
            Self::Characteristic(modes) => vec![Guidance::Characteristic {
                modes,
                normalization: Normalization::Normalized,
                weight,
            }],
        }
    }
}

/// An error where the command line says how strictly nothing is to be followed.
pub fn refuse_mode_alone(guide: &Guide, session: &Session) -> Result<(), Failure> {
    if *guide == Guide::None {
        session.refuse(
            &["mode"],
            "says how strictly --guide is followed, and there is none",
        )?;
    }
    Ok(())
}

/// A segment as a strip on either side of the surface: it may be inside out, or open and seen from behind.
fn strip(layer: &mut Layer, [a, b]: [Point3; 2], normal: &Vector3, width: f64) {
    let side = normal.cross(&(b - a)).normalize() * (0.5 * width);
    let lift = normal * (0.6 * width);
    for lift in [lift, -lift] {
        let first = layer.positions.len() as u32;
        layer
            .positions
            .extend([a - side, b - side, b + side, a + side].map(|p| p + lift));
        layer
            .faces
            .extend([[0, 1, 2], [0, 2, 3]].map(|t: [u32; 3]| t.map(|v| v + first)));
    }
}

fn plain(color: Rgb) -> Layer {
    Layer {
        positions: Vec::new(),
        faces: Vec::new(),
        paint: Paint::Plain(color),
        normals: None,
        edges: false,
    }
}

/// A cross per triangle, or per every so many of them.
pub fn crosses(mesh: &TriMesh, frames: &Frames, field: &CrossField) -> Layer {
    let mut layer = plain(INK);
    let every = mesh.triangles().len().div_ceil(CROSSES);
    let spacing = (mesh.area() * every as f64 / mesh.triangles().len() as f64).sqrt();
    for f in (0..mesh.triangles().len()).step_by(every) {
        let sum = mesh
            .corners(f)
            .iter()
            .fold(Vector3::zeros(), |s, p| s + p.coords);
        let centre = Point3::from(sum / 3.0);
        let normal = mesh.doubled_area_normal(f).normalize();
        let arms = field.arms(frames, f);
        for arm in &arms[..2] {
            let half = arm * (0.42 * spacing);
            strip(
                &mut layer,
                [centre - half, centre + half],
                &normal,
                0.08 * spacing,
            );
        }
    }
    layer
}

/// Balls at singular vertices, by sign.
pub fn balls(points: impl Iterator<Item = (Point3, bool)>, radius: f64) -> [Layer; 2] {
    let ball = shapes::icosphere(radius, 1);
    let mut layers = [plain(NEGATIVE), plain(POSITIVE)];
    for (at, positive) in points {
        let layer = &mut layers[usize::from(positive)];
        let first = layer.positions.len() as u32;
        layer
            .positions
            .extend(ball.positions().iter().map(|p| at + p.coords));
        layer
            .faces
            .extend(ball.triangles().iter().map(|t| t.map(|v| v + first)));
    }
    layers
}

/// Segments as strips on the surface, each with a normal of any length.
pub fn strips(segments: impl Iterator<Item = ([Point3; 2], Vector3)>, width: f64) -> Layer {
    let mut layer = plain(INK);
    for (ends, normal) in segments {
        let normal = normal.normalize();
        if ends[0] != ends[1] && normal.iter().all(|c| c.is_finite()) {
            strip(&mut layer, ends, &normal, width);
        }
    }
    layer
}

/// The sides of quads.
pub fn sides(mesh: &geom_core::QuadMesh) -> Layer {
    let normals = mesh.vertex_normals();
    let width = 0.05 * (mesh.area() / mesh.quads().len().max(1) as f64).sqrt();
    let sides = mesh.quads().iter().flat_map(|quad| {
        (0..4).map(|k| {
            let (a, b) = (quad[k] as usize, quad[(k + 1) % 4] as usize);
            let ends = [mesh.positions()[a], mesh.positions()[b]];
            (ends, normals[a] + normals[b])
        })
    });
    strips(sides, width)
}

/// Says in the last lines what of the quads is not as asked for.
pub fn warn(session: &Session, report: &Report) -> Result<(), Failure> {
    if let Some(repaired) = report.repaired {
        let counts = serde_json::to_value(repaired)?;
        let counts = counts.as_object().into_iter().flatten();
        let done = counts.filter(|(what, count)| {
            count.as_u64() > Some(0) && !["open_loops", "unused_vertices"].contains(&what.as_str())
        });
        let done: Vec<String> = done
            .map(|(what, count)| format!("{count} {}", what.replace('_', " ")))
            .collect();
        if !done.is_empty() {
            session.warn(format!(
                "the surface had to be repaired: {}",
                done.join(", ")
            ))?;
        }
    }
    let parts = &report.parts;
    let split: Vec<_> = parts.iter().filter(|p| p.rung == Rung::Split).collect();
    if let Some(first) = split.first() {
        let (some, all) = (split.len(), parts.len());
        let because = first.failures.first().map_or("", String::as_str);
        session.warn(format!(
            "{some} of {all} parts of the surface got no map, so that their quads follow no field: {because}"
        ))?;
    }
    let squares = parts.iter().filter(|p| p.squares).count();
    if squares > 0 {
        let all = parts.len();
        session.warn(format!(
            "the quads of {squares} of {all} parts are no narrower anywhere: all maps with narrow ones fold"
        ))?;
    }
    if report.scaled_jacobian.min <= 0.0 {
        session
            .warn("there are quads that face away from the surface (quads.vtu, scaled_jacobian)")?;
    }
    Ok(())
}
