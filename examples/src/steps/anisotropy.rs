//! Fields along whose gradients quads are narrow, how they are drawn, and what came of them.

use crossfield::Quadrangulation;
use crossfield::anisotropy::steepest;
use crossfield::quads::quality::ratio_along;
use geom_core::algebra::eigen::{self, eigenpairs};
use geom_core::search::bvh::TriangleTree;
use geom_core::search::nearest::PointTree;
use geom_core::structure::Selector;
use geom_core::surface::distance::{Heat, HeatOptions};
use geom_core::surface::{curvature, laplace};
use geom_core::{Point3, Structure, TriMesh, Vector3, io};
use io::view::Field;
use serde::Serialize;
use serde_json::json;

use crate::input::source::SourceArgs;
use crate::input::surface;
use crate::picture::{ColorMap, Scale, Scene, View};
use crate::{Failure, Session, crosses, products};

/// Where a field comes from.
#[derive(Clone, Debug, PartialEq)]
pub enum Source {
    /// An eigenfunction of the surface.
    Mode(usize),
    /// Its mean curvature.
    Curvature,
    /// How far a place is from a point, along the surface.
    Point([f64; 3]),
    /// How far it is from where selected atoms are the nearest.
    Atoms(Selector),
    /// A point field of a mesh.
    Named(String),
}

impl std::fmt::Display for Source {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Mode(number) => write!(f, "mode:{number}"),
            Self::Curvature => write!(f, "curvature"),
            Self::Point([x, y, z]) => write!(f, "distance:{x},{y},{z}"),
            Self::Atoms(selector) => write!(f, "distance:{selector}"),
            Self::Named(name) => write!(f, "{name}"),
        }
    }
}

impl Serialize for Source {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

/// `mode:1`, `curvature`, `distance:1,2,3`, `distance:name:HEM`, or the name of a field.
pub fn source(text: &str) -> Result<Source, String> {
    let distance = |from: &str| -> Result<Source, String> {
        let numbers: Vec<f64> = from.split(',').map_while(|x| x.parse().ok()).collect();
        match <[f64; 3]>::try_from(numbers) {
            Ok(point) if from.split(',').count() == 3 && point.iter().all(|x| x.is_finite()) => {
                Ok(Source::Point(point))
            }
            _ => match Selector::parse(from) {
                Ok(selector) => Ok(Source::Atoms(selector)),
                Err(error) => Err(format!("`{from}` is neither X,Y,Z nor a selector: {error}")),
            },
        }
    };
    match text.split_once(':') {
        Some(("mode", number)) => match number.parse() {
            Ok(number @ 1..=100) => Ok(Source::Mode(number)),
            _ => Err(format!("`{number}` is no mode number from 1 to 100")),
        },
        Some(("distance", from)) => distance(from),
        None if text == "curvature" => Ok(Source::Curvature),
        _ if !text.is_empty() => Ok(Source::Named(text.to_owned())),
        _ => Err("it must be mode:1, curvature, distance:… or the name of a field".into()),
    }
}

/// `0.3,0.9`.
pub fn ramp(text: &str) -> Result<[f64; 2], String> {
    let numbers: Option<Vec<f64>> = text.split(',').map(|x| x.parse().ok()).collect();
    let pair = numbers.and_then(|n| <[f64; 2]>::try_from(n).ok());
    pair.ok_or_else(|| format!("`{text}` is no pair of numbers as 0.3,0.9"))
}

/// The largest part of a surface, and what is known of it.
pub struct Input {
    /// The part.
    pub mesh: TriMesh,
    whole: TriMesh,
    fields: Vec<Field<'static>>,
    structure: Option<Structure>,
}

impl Input {
    /// Reads a mesh, or makes the surface of a structure or grid.
    pub fn read(args: &SourceArgs, session: &Session) -> Result<Self, Failure> {
        let surface::Known {
            mesh: whole,
            fields,
            structure,
        } = surface::read_all(args, session)?;
        let mut components = whole.components();
        if components.is_empty() {
            return Err("the surface has no triangle".into());
        }
        Ok(Self {
            mesh: components.swap_remove(0),
            whole,
            fields,
            structure,
        })
    }

    /// The field's values at the vertices of the part.
    pub fn values(
        &self,
        source: &Source,
        reach: Option<f64>,
        session: &Session,
    ) -> Result<Vec<f64>, Failure> {
        if !matches!(source, Source::Point(_) | Source::Atoms(_)) {
            session.refuse(&["reach"], "is for --field distance:…")?;
        }
        match source {
            Source::Mode(number) => self.mode(*number, session),
            Source::Curvature => {
                let principal = curvature::principal(&self.mesh, 2);
                Ok(principal.iter().map(curvature::Principal::mean).collect())
            }
            Source::Point(point) => {
                let at = TriangleTree::new(&self.mesh)?.closest(&Point3::from(*point));
                let corners = self.mesh.triangles()[at.triangle as usize];
                self.falling(&corners, reach)
            }
            Source::Atoms(selector) => self.falling(&self.near(selector)?, reach),
            Source::Named(name) => self.named(name),
        }
    }

    fn mode(&self, number: usize, session: &Session) -> Result<Vec<f64>, Failure> {
        let vertices = self.mesh.positions().len();
        if number >= vertices {
            return Err(format!("a surface of {vertices} vertices has no mode {number}").into());
        }
        let stiffness = laplace::stiffness(&self.mesh)?;
        let mass = laplace::lumped_mass(&self.mesh);
        let options = eigen::Options::default();
        let on = session.on(session.device.spectral());
        let mut pairs = eigenpairs(&stiffness, &mass, number + 1, &options, on)?;
        Ok(pairs.vectors.swap_remove(number))
    }

    /// A function whose slope is e^(−d / reach) at the distance d from some vertices.
    fn falling(&self, from: &[u32], reach: Option<f64>) -> Result<Vec<f64>, Failure> {
        let reach = reach.unwrap_or(0.1 * self.mesh.bounds().diagonal());
        if !(reach > 0.0 && reach.is_finite()) {
            return Err(format!("--reach {reach} must be above 0").into());
        }
        let distance = Heat::new(&self.mesh, &HeatOptions::default())?.from(from)?;
        Ok(distance
            .iter()
            .map(|d| -reach * (-d / reach).exp())
            .collect())
    }

    /// The vertices whose nearest atom is selected.
    fn near(&self, selector: &Selector) -> Result<Vec<u32>, Failure> {
        let Some(structure) = &self.structure else {
            let message = format!(
                "--field distance:{selector} is for structures, and the input has no atoms"
            );
            return Err(message.into());
        };
        let mut chosen = vec![false; structure.atoms().len()];
        for range in structure.select(selector)?.atom_ranges(structure) {
            chosen[range].fill(true);
        }
        let centers: Vec<Point3> = structure.atoms().iter().map(|a| a.position).collect();
        let queries: Vec<[f64; 3]> = self
            .mesh
            .positions()
            .iter()
            .map(|p| [p.x, p.y, p.z])
            .collect();
        let nearest = PointTree::of_positions(&centers)?.nearest_to_all(&queries, 1)?;
        let near: Vec<u32> = (0..)
            .zip(&nearest)
            .filter(|(_, n)| chosen[n[0].index as usize])
            .map(|(v, _)| v)
            .collect();
        if near.is_empty() {
            return Err(
                format!("no part of the surface is nearest to an atom of {selector}").into(),
            );
        }
        Ok(near)
    }

    /// A point field of the mesh, on the part.
    fn named(&self, name: &str) -> Result<Vec<f64>, Failure> {
        let scalar = |f: &&Field<'_>| {
            f.values.components == 1 && f.values.len() == self.whole.positions().len()
        };
        let Some(field) = self.fields.iter().filter(scalar).find(|f| f.name == name) else {
            let names: Vec<&str> = (self.fields.iter().filter(scalar))
                .map(|f| f.name.as_str())
                .collect();
            let there = match names[..] {
                [] => "it has none".to_owned(),
                _ => format!("it has {}", names.join(", ")),
            };
            return Err(format!("the mesh has no scalar point field `{name}`; {there}").into());
        };
        let values = field.values.to_f64();
        // Vertices of the part are vertices of the whole.
        let closest = TriangleTree::new(&self.whole)?.closest_to_all(self.mesh.positions())?;
        let at = |c: &geom_core::search::bvh::Closest| {
            let corners = self.whole.triangles()[c.triangle as usize];
            (0..3)
                .map(|k| c.barycentric[k] * values[corners[k] as usize])
                .sum()
        };
        Ok(closest.iter().map(at).collect())
    }
}

/// How quads lie to the gradient of a field.
pub struct Steep {
    /// Per quad its length along the gradient over that across; NaN without a gradient.
    pub ratios: Vec<f64>,
    /// Per quad |gradient| over the largest.
    steepness: Vec<f64>,
}

impl Steep {
    /// Of the quads of a surface with a field.
    pub fn of(mesh: &TriMesh, field: &[f64], made: &Quadrangulation) -> Result<Self, Failure> {
        let gradient = laplace::gradient(mesh, field)?;
        let most = steepest(mesh, &gradient);
        let at = |q: usize| gradient[made.origins[q] as usize];
        let quads = 0..made.mesh.quads().len();
        Ok(Self {
            ratios: quads
                .clone()
                .map(|q| ratio_along(&made.mesh.corners(q), &at(q)).unwrap_or(f64::NAN))
                .collect(),
            steepness: quads.map(|q| at(q).norm() / most).collect(),
        })
    }

    /// Notes it, and what the field and the map made of the gradient.
    pub fn note(&self, session: &Session, made: &Quadrangulation) -> Result<(), Failure> {
        let step = |[low, high]: [f64; 2]| {
            let within = self.steepness.iter().zip(&self.ratios);
            let mut ratios: Vec<f64> = within
                .filter(|(s, r)| **s > low && **s <= high && r.is_finite())
                .map(|(_, r)| *r)
                .collect();
            ratios.sort_by(f64::total_cmp);
            let median = ratios.get(ratios.len() / 2);
            json!({ "steeper_than": low, "quads": ratios.len(), "median": median })
        };
        let steps = [[0.0, 0.3], [0.3, 0.6], [0.6, 0.9], [0.9, f64::MAX]].map(step);
        let part = made.report.parts.first();
        let noted = json!({
            "aspect_ratio": made.report.aspect_ratio,
            "along_over_across": steps,
            "misalignment": part.and_then(|p| p.misalignment),
            "adapted": part.map(|p| p.adapted),
        });
        session.note("anisotropy", noted)
    }
}

/// Strokes drawn at most.
const STROKES: usize = 1500;

/// Writes the field as `field.ply`, `field.glb` and `field.png`.
pub fn save_field(
    session: &Session,
    mesh: &TriMesh,
    field: &[f64],
    name: &str,
) -> Result<(), Failure> {
    let (low, high) = field
        .iter()
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), &x| {
            (l.min(x), h.max(x))
        });
    let scale = Scale::new(ColorMap::Viridis, [low, high], name);
    let body = products::save_scalars(session, "field", mesh, field, &scale)?;
    let gradient = laplace::gradient(mesh, field)?;
    session.picture("field", || {
        let mut scene = Scene::new(
            vec![body, strokes(mesh, &gradient)],
            View::principal(mesh.positions()).turned(0.25, 0.2),
        );
        scene.scale = Some(scale);
        scene.caption = Some("strokes along the gradient, as long as that is steep".into());
        scene.draw(session.rasterizer()?, products::SIZE)
    })
}

/// Strokes along a gradient, in some triangles.
fn strokes(mesh: &TriMesh, gradient: &[Vector3]) -> crate::picture::Layer {
    let triangles = mesh.triangles().len();
    let every = triangles.div_ceil(STROKES);
    let spacing = (mesh.area() * every as f64 / triangles as f64).sqrt();
    let most = steepest(mesh, gradient);
    let segments = (0..triangles).step_by(every).map(|f| {
        let sum: Vector3 = mesh.corners(f).iter().map(|p| p.coords).sum();
        let centre = Point3::from(sum / 3.0);
        let half = gradient[f].cap_magnitude(most) * (0.6 * spacing / most);
        ([centre - half, centre + half], mesh.doubled_area_normal(f))
    });
    crosses::strips(segments, 0.1 * spacing)
}
