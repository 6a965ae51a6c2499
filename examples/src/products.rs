//! What several programs write: surfaces and volumes with their pictures and numbers.

use std::collections::BTreeMap;

use dual_contour::Material;
use geom_core::io::{
    self,
    view::{NO_CELL, View as Fields},
};
use geom_core::mesh::{SurfaceAudit, VolumeAudit};
use geom_core::search::crossing::crossing_pairs;
use geom_core::surface::curvature;
use geom_core::{Point3, Structure, TetMesh, TriMesh, mesh};
use serde_json::json;
use tet_quality::{Measures, Summary};

use crate::input::labels::{Around, ColorBy, Labels};
use crate::picture::{
    Bars, ColorMap, Image, Layer, Paint, Rgb, Scale, Scene, View, cut_tets, histogram, mix,
    region_color,
};
use crate::{Failure, Session, scripts};

/// Width and height of pictures, in pixels.
pub const SIZE: [usize; 2] = [1280, 960];
/// The colour of a surface without chains.
pub const GOLD: Rgb = [224, 172, 98];
const SKIN: Rgb = [222, 222, 224];

/// The colours of a surface, and what they stand for.
pub struct Coloring {
    /// One per vertex.
    pub colors: Vec<Rgb>,
    /// Where they follow a number.
    pub scale: Option<Scale>,
    /// Where they stand for things.
    pub legend: Vec<(Rgb, String)>,
}

impl Coloring {
    /// By values on the vertices.
    pub fn of_values(values: &[f64], scale: Scale) -> Self {
        Self {
            colors: scale.colors(values),
            scale: Some(scale),
            legend: Vec::new(),
        }
    }

    /// All golden.
    pub fn plain(mesh: &TriMesh) -> Self {
        Self {
            colors: vec![GOLD; mesh.positions().len()],
            scale: None,
            legend: Vec::new(),
        }
    }
}

/// Writes `NAME.ply`, `NAME.glb` and `NAME.png`. Of a surface around atoms, the nearest give the fields `atom`,
/// `residue` and `chain` of the PLY file, and the colour; scripts open it beside them.
pub fn save_surface(
    session: &Session,
    name: &str,
    mesh: &TriMesh,
    around: Option<Around<'_>>,
) -> Result<(), Failure> {
    let labels = around
        .map(|a| Labels::of(a.structure, mesh.positions()))
        .transpose()?;
    let mut view = Fields::from(mesh);
    let mut coloring = Coloring::plain(mesh);
    if let (Some(labels), Some(around)) = (&labels, around) {
        view = labels.fields(view)?;
        coloring = labels.coloring(around.color);
        scripts::save(session, around.file, &[name], &[])?;
        session.show_structure(around.file);
    }
    session.show(name, mesh, colorings(mesh, labels.as_ref()));
    side_by_side(
        || save_colored(session, name, view, &coloring.colors),
        || picture_of_surface(session, name, mesh, &coloring),
    )
}

/// The ways to look at a surface on the page of a run: what is nearest, and how it is curved.
pub fn colorings(mesh: &TriMesh, labels: Option<&Labels<'_>>) -> Vec<(String, Coloring)> {
    let mut ways = vec![];
    if let Some(labels) = labels {
        for (name, by) in [
            ("chain", ColorBy::Chain),
            ("residue", ColorBy::Residue),
            ("element", ColorBy::Element),
        ] {
            ways.push((name.to_owned(), labels.coloring(by)));
        }
    } else {
        ways.push(("plain".to_owned(), Coloring::plain(mesh)));
    }
    let curvature: Vec<f64> = curvature::principal(mesh, 2)
        .iter()
        .map(|k| k.mean())
        .collect();
    // A few vertices are curved far more than the rest: the scale ends where a tenth lies outside.
    let mut sizes: Vec<f64> = curvature.iter().map(|h| h.abs()).collect();
    sizes.sort_unstable_by(f64::total_cmp);
    let reach = sizes.get(sizes.len() * 9 / 10).copied().unwrap_or(1.0);
    let reach = if reach > 0.0 { reach } else { 1.0 };
    let scale = Scale::new(ColorMap::CoolWarm, [-reach, reach], "mean curvature / Å⁻¹");
    ways.push((
        "mean curvature".to_owned(),
        Coloring::of_values(&curvature, scale),
    ));
    ways
}

/// Does both at the same time.
pub fn side_by_side(
    one: impl FnOnce() -> Result<(), Failure> + Send,
    other: impl FnOnce() -> Result<(), Failure> + Send,
) -> Result<(), Failure> {
    let (one, other) = rayon::join(one, other);
    one.and(other)
}

/// Writes `NAME.png`: a surface with a colour per vertex.
pub fn picture_of_surface(
    session: &Session,
    name: &str,
    mesh: &TriMesh,
    coloring: &Coloring,
) -> Result<(), Failure> {
    session.picture(name, || {
        let view = View::of_surface(mesh).turned(0.25, 0.2);
        let paint = Paint::Vertices(coloring.colors.clone());
        let mut scene = Scene::new(vec![Layer::surface(mesh, paint)], view);
        scene.scale = coloring.scale.clone();
        scene.legend = coloring.legend.clone();
        scene.caption = Some(format!(
            "{} triangles · {} Å² around {} Å³",
            grouped(mesh.triangles().len()),
            grouped(mesh.area().round() as usize),
            grouped(mesh.volume().abs().round() as usize)
        ));
        scene.draw(session.rasterizer()?, SIZE)
    })
}

/// Writes `NAME.ply` and `NAME.glb`, coloured by values on the vertices; gives what to draw.
pub fn save_scalars(
    session: &Session,
    name: &str,
    mesh: &TriMesh,
    values: &[f64],
    scale: &Scale,
) -> Result<Layer, Failure> {
    let coloring = Coloring::of_values(values, scale.clone());
    let colors = coloring.colors.clone();
    session.show(name, mesh, vec![(scale.label.clone(), coloring)]);
    save_colored(session, name, Fields::from(mesh), &colors)?;
    let mut layer = Layer::surface(mesh, Paint::Vertices(colors));
    layer.edges = false;
    Ok(layer)
}

/// Writes all layers of a scene as `NAME.glb`, coloured as they are drawn.
pub fn save_scene(session: &Session, name: &str, scene: &Scene) -> Result<(), Failure> {
    let all = scene.merged();
    let mesh = TriMesh::new(all.positions, all.triangles)?;
    let view = Fields::from(&mesh).colored(rgba(&all.colors))?;
    Ok(io::mesh::save(
        session.output(format!("{name}.glb"))?,
        &view,
    )?)
}

fn save_colored(
    session: &Session,
    name: &str,
    view: Fields<'_>,
    colors: &[Rgb],
) -> Result<(), Failure> {
    let view = view.colored(rgba(colors))?;
    let save = |kind| {
        Ok(io::mesh::save(
            session.output(format!("{name}.{kind}"))?,
            &view,
        )?)
    };
    side_by_side(|| save("ply"), || save("glb"))
}

/// A whole number with its digits in groups of three.
pub fn grouped(number: usize) -> String {
    let digits = number.to_string();
    let mut text = String::new();
    for (i, digit) in digits.chars().enumerate() {
        if i > 0 && (digits.len() - i).is_multiple_of(3) {
            text.push(',');
        }
        text.push(digit);
    }
    text
}

/// A number with a few digits, however small it is.
pub fn brief(number: f64) -> String {
    if number == 0.0 || number.abs() >= 0.01 {
        format!("{number:.4}")
    } else {
        format!("{number:.2e}")
    }
}

/// Opaque colours.
pub fn rgba(colors: &[Rgb]) -> Vec<[u8; 4]> {
    colors.iter().map(|&[r, g, b]| [r, g, b, 255]).collect()
}

/// Notes the numbers and the audit of a surface in the report.
pub fn note_surface(session: &Session, mesh: &TriMesh) -> Result<(), Failure> {
    let audit = SurfaceAudit::of(mesh);
    let counts = json!({ "surface_vertices": mesh.positions().len(), "surface_triangles": mesh.triangles().len() });
    session.note("counts", counts)?;
    let numbers = json!({
        "area": mesh.area(),
        "volume": mesh.volume(),
        "closed": audit.boundary_edges.none(),
        "manifold": audit.is_manifold(),
        "parts": audit.components.len(),
        "euler_characteristic": audit.euler_characteristic(),
        "crossing_pairs": crossing_pairs(mesh).len(),
    });
    session.note("surface", numbers)
}

/// Notes the numbers and the audit of a volume in the report.
pub fn note_volume(session: &Session, mesh: &TetMesh) -> Result<(), Failure> {
    let audit = VolumeAudit::of(mesh);
    session.note(
        "counts",
        json!({ "vertices": mesh.positions().len(), "tetrahedra": mesh.tets().len() }),
    )?;
    let numbers = json!({
        "volume": mesh.volume(),
        "conforming": audit.is_conforming(),
        "positive": audit.is_positive(),
        "valid": audit.is_valid(),
    });
    session.note("volume", numbers)
}

/// Warns of materials of which nothing came into the mesh.
pub fn warn_of_missing(
    session: &Session,
    mesh: &TetMesh,
    materials: &[Material],
) -> Result<(), Failure> {
    let is_missing = |m: &&Material| !mesh.regions().contains(&m.region);
    let warning = |m: &Material| {
        format!(
            "region {} has no tetrahedra: its material lies outside of what is meshed, or is thinner than a cell",
            m.region
        )
    };
    let mut missing = materials.iter().filter(is_missing);
    missing.try_for_each(|material| session.warn(warning(material)))
}

/// Writes `NAME.vtu`, `NAME.msh` and `NAME.png`: regions, quality per tetrahedron, and a cut. `view` is the mesh with
/// the names of its groups; around atoms, the nearest give the fields `atom`, `residue` and `chain` of the points.
pub fn save_volume(
    session: &Session,
    name: &str,
    mesh: &TetMesh,
    view: Fields<'_>,
    structure: Option<&Structure>,
) -> Result<(), Failure> {
    let labels = structure
        .map(|s| Labels::of(s, mesh.positions()))
        .transpose()?;
    let mut measures = Vec::new();
    let device = session.device.quality();
    device.measure(mesh.positions(), mesh.tets(), &mut measures)?;
    let mut fields = with_quality(view.clone(), mesh, &measures)?;
    if let Some(labels) = &labels {
        fields = labels.fields(fields)?;
    }
    // Only VTU carries the fields: solvers that read MSH want names and elements.
    let vtu = || {
        Ok(io::mesh::save(
            session.output(format!("{name}.vtu"))?,
            &fields,
        )?)
    };
    let msh = || {
        let path = session.output(format!("{name}.msh"))?;
        Ok(io::mesh::save(path, &view)?)
    };
    let png = || session.picture(name, || draw_volume(session, mesh, &view, &measures));
    side_by_side(|| side_by_side(vtu, msh), png)
}

/// The quality of each tetrahedron as cell fields.
fn with_quality<'a>(
    view: Fields<'a>,
    mesh: &TetMesh,
    measures: &[Measures],
) -> Result<Fields<'a>, io::Error> {
    // A face shows the quality of the tetrahedron behind it, so that no cell is without.
    let sides = view.sides();
    let with_faces = |mut values: Vec<f32>| {
        let of_side = |&(_, [behind, before]): &(u32, [u32; 2])| {
            let tet = if behind == NO_CELL { before } else { behind };
            values.get(tet as usize).copied().unwrap_or(f32::NAN)
        };
        let faces: Vec<f32> = sides.iter().map(of_side).collect();
        values.extend(faces);
        values
    };
    let measured = |value: fn(&Measures) -> f64| {
        with_faces(measures.iter().map(|m| value(m) as f32).collect())
    };
    // What no backend measures is taken from the corners.
    let of_corners = |value: fn([Point3; 4]) -> f64| {
        let tets = 0..measures.len();
        with_faces(tets.map(|t| value(mesh.corners(t)) as f32).collect())
    };
    view.cell_field("min_dihedral", measured(|m| m.min_dihedral))?
        .cell_field("max_dihedral", measured(|m| m.max_dihedral))?
        .cell_field("joe_liu", measured(|m| m.joe_liu))?
        .cell_field("edge_ratio", measured(|m| m.edge_ratio))?
        .cell_field("radius_ratio", of_corners(tet_quality::radius_ratio))?
        .cell_field("aspect_ratio", of_corners(tet_quality::aspect_ratio))
}

/// Writes `NAME.png`: a cut through the mesh. Tetrahedra of the molecule are coloured by their smallest
/// dihedral angle; those of other regions have the region's colour, darker where that angle is small.
pub fn picture_of_volume(
    session: &Session,
    name: &str,
    mesh: &TetMesh,
    view: &Fields<'_>,
) -> Result<(), Failure> {
    session.picture(name, || {
        let mut measures = Vec::new();
        let device = session.device.quality();
        device.measure(mesh.positions(), mesh.tets(), &mut measures)?;
        draw_volume(session, mesh, view, &measures)
    })
}

/// The regions that have colours of their own, by the names of their groups.
fn legend_of_regions(mesh: &TetMesh, view: &Fields<'_>) -> Vec<(Rgb, String)> {
    let mut names = BTreeMap::new();
    for (&region, &group) in mesh.regions().iter().zip(view.group_of.iter()) {
        if region != mesh::INTERIOR && !names.contains_key(&region) {
            let named = view.groups.get(group as usize).map(|g| g.name.clone());
            names.insert(region, named.unwrap_or_else(|| format!("region {region}")));
        }
    }
    let entry = |(region, name)| (region_color(region), name);
    names.into_iter().map(entry).collect()
}

fn draw_volume(
    session: &Session,
    mesh: &TetMesh,
    view: &Fields<'_>,
    measures: &[Measures],
) -> Result<Image, Failure> {
    let scale = Scale::new(ColorMap::Viridis, [0.0, 70.0], "min dihedral / °");
    let colors: Vec<Rgb> = measures
        .iter()
        .zip(mesh.regions())
        .map(|(m, &region)| {
            if region == mesh::INTERIOR {
                return scale.color(m.min_dihedral);
            }
            // Other regions by their own colour, lighter the better.
            let own = region_color(region);
            let (dark, light) = (mix(own, [40, 44, 52], 0.45), mix(own, [255; 3], 0.45));
            mix(dark, light, (m.min_dihedral / scale.high).clamp(0.0, 1.0))
        })
        .collect();
    let boxed = mesh
        .kinds()
        .iter()
        .any(|k| matches!(k, mesh::VertexKind::BoxFace { .. }));
    let materials = mesh.regions().iter().any(|&r| r > mesh::INTERIOR);
    let front = if materials {
        View::upright()
    } else if boxed {
        View::along_axes(mesh.positions())
    } else {
        View::principal(mesh.positions())
    };
    let layers = cut_tets(mesh, &front, 0.5, &colors, SKIN);
    let mut scene = Scene::new(layers, front.turned(0.28, 0.24));
    scene.legend = legend_of_regions(mesh, view);
    let shown = if mesh.regions().contains(&mesh::INTERIOR) {
        // The bar is of the molecule's colours alone.
        scene.scale = Some(scale);
        "cut open"
    } else {
        "around the molecule, cut open; the lighter, the larger the least dihedral angle"
    };
    let tets = grouped(mesh.tets().len());
    scene.caption = Some(format!("{tets} tetrahedra, {shown}"));
    scene.draw(session.rasterizer()?, SIZE)
}

/// Writes `NAME.png`: smallest and largest dihedral angles before and after.
pub fn picture_of_quality(
    session: &Session,
    name: &str,
    before: &Summary,
    after: &Summary,
) -> Result<(), Failure> {
    let counts = |h: &[usize]| h.iter().map(|&c| c as u64).collect::<Vec<_>>();
    let both = |s: &Summary| {
        // Smallest and largest angles of a tetrahedron lie on either side of 70.5°: one plot holds both.
        counts(&s.min_dihedral_histogram)
            .iter()
            .zip(counts(&s.max_dihedral_histogram))
            .map(|(a, b)| a + b)
            .collect::<Vec<u64>>()
    };
    let title = format!(
        "{} tetrahedra: {:.1}° … {:.1}° before, {:.1}° … {:.1}° after",
        grouped(after.tets),
        before.min_dihedral.min,
        before.max_dihedral.max,
        after.min_dihedral.min,
        after.max_dihedral.max
    );
    let label = "smallest and largest dihedral angle per tetrahedron / °";
    let counts = [before, after].map(both);
    picture_of_change(session, name, &title, label, 180.0, &counts)
}

/// Writes `NAME.png`: how many elements have which angle, from 0 to `most` degrees, before and after.
pub fn picture_of_change(
    session: &Session,
    name: &str,
    title: &str,
    label: &str,
    most: f64,
    [before, after]: &[Vec<u64>; 2],
) -> Result<(), Failure> {
    let sets = [
        Bars {
            name: "before",
            color: [204, 96, 66],
            counts: before,
        },
        Bars {
            name: "after",
            color: [52, 102, 178],
            counts: after,
        },
    ];
    session.picture(name, || {
        Ok(histogram(&sets, [0.0, most], title, label, [1100, 680]))
    })
}

/// The surface of the molecule in a mesh of tetrahedra, pointing out of it, whether the molecule is
/// meshed or only what lies around it.
pub fn molecule_surface(mesh: &TetMesh) -> TriMesh {
    if mesh.regions().contains(&mesh::INTERIOR) {
        return mesh.region_surface(mesh::INTERIOR);
    }
    let view = Fields::from(mesh);
    let of_molecule = |group: u32| view.groups[group as usize].name == "molecule|exterior";
    let mut number = vec![u32::MAX; mesh.positions().len()];
    let (mut positions, mut triangles) = (Vec::new(), Vec::new());
    let faces = mesh.interfaces();
    for (face, &group) in faces.iter().zip(&view.group_of[mesh.tets().len()..]) {
        if of_molecule(group) {
            // Seen from the other side: out of the molecule, into the mesh.
            let [a, b, c] = face.triangle.map(|v| {
                let new = &mut number[v as usize];
                if *new == u32::MAX {
                    *new = positions.len() as u32;
                    positions.push(mesh.positions()[v as usize]);
                }
                *new
            });
            triangles.push([a, c, b]);
        }
    }
    TriMesh::new(positions, triangles).expect("faces of a valid mesh")
}
