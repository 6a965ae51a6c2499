//! GLB, binary glTF 2.0: surfaces with vertex colours, to look at in any viewer.
//!
//! One scene with one node with one mesh with one primitive of triangles, which is what every program shows; the material has two
//! sides, since surfaces may be open, and is not metallic, since colours would turn dark. glTF counts in metres, and most
//! viewers fit what they show into the window, so that lengths are left as they are: 1 Å is 1.
//!
//! Positions are in Å as f32, with normals; quads and polygons are cut into fans. Scalars and tuples of
//! up to four components per point become attributes `_NAME`; cell fields and groups are left out. Of a
//! tetrahedral mesh the surface is written.
//!
//! Written and read again, positions are rounded to f32 (on a molecule of 100 Å to about 10⁻⁵ Å) and colours the same;
//! normals and attributes of values are not read, nor are materials and textures.

use std::collections::BTreeMap;
use std::io::Write;
use std::path::Path;

use gltf::binary::{Glb, Header};
use gltf::json::accessor::{ComponentType, GenericComponentType, Type};
use gltf::json::buffer::Target;
use gltf::json::mesh::Semantic;
use gltf::json::validation::Checked::Valid;
use gltf::json::validation::USize64;
use gltf::json::{self, Index, Root};
use nalgebra::Matrix4;

use crate::io::bytes::Scalar;
use crate::io::view::{Cells, View};
use crate::io::{Error, ErrorKind, read_bytes};
use crate::{Point3, TriMesh};

/// Writes a view to a file, whole or not at all.
pub fn save(path: impl AsRef<Path>, view: &View<'_>) -> Result<(), Error> {
    crate::io::save(path, |w| write(w, view))
}

/// Writes a view. A view without a face is refused, because glTF cannot hold it.
///
/// Names of fields are in capital letters, with `_` for all but letters and digits. Values beyond f32 become infinite.
///
/// # Errors
/// [`ErrorKind::Expected`] for a view without a face, [`ErrorKind::TooLarge`] from 4 GB on, [`ErrorKind::Mesh`] for a
/// face with a repeated corner.
pub fn write(w: &mut dyn Write, view: &View<'_>) -> Result<(), Error> {
    view.check()?;
    let view = view.surface();
    let mesh = TriMesh::new(view.points.to_vec(), view.triangles())?;
    if mesh.triangles().is_empty() {
        return Err(ErrorKind::expected("at least one face for glTF", "none").into());
    }
    let mut out = Builder::default();
    let n = mesh.positions().len();
    let mut attributes = BTreeMap::new();
    let narrow = |p: &[f64]| [p[0] as f32, p[1] as f32, p[2] as f32];
    let points: Vec<[f32; 3]> = mesh
        .positions()
        .iter()
        .map(|p| narrow(p.coords.as_slice()))
        .collect();
    let positions = out.array(points.as_flattened(), n, Type::Vec3, Target::ArrayBuffer);
    // glTF wants the bounds of positions, in the numbers written.
    let bound = |pick: fn(f32, f32) -> f32| {
        let all = points.iter().copied();
        all.reduce(|a, b| [0, 1, 2].map(|k| pick(a[k], b[k])))
            .map(|b| json::Value::from(b.to_vec()))
    };
    let accessor = &mut out.root.accessors[positions.value()];
    (accessor.min, accessor.max) = (bound(f32::min), bound(f32::max));
    attributes.insert(Valid(Semantic::Positions), positions);
    let normals: Vec<[f32; 3]> = mesh
        .vertex_normals()
        .iter()
        // A vertex without a proper triangle still needs a unit vector.
        .map(|n| {
            if n.norm_squared() > 0.0 {
                narrow(n.as_slice())
            } else {
                [0.0, 0.0, 1.0]
            }
        })
        .collect();
    let normals = out.array(normals.as_flattened(), n, Type::Vec3, Target::ArrayBuffer);
    attributes.insert(Valid(Semantic::Normals), normals);
    if let Some(colors) = &view.colors {
        let colors = out.array(colors.as_flattened(), n, Type::Vec4, Target::ArrayBuffer);
        out.root.accessors[colors.value()].normalized = true;
        attributes.insert(Valid(Semantic::Colors(0)), colors);
    }
    for field in &view.point_fields {
        let k = field.values.components;
        let kind = match k {
            1 => Type::Scalar,
            2 => Type::Vec2,
            3 => Type::Vec3,
            4 => Type::Vec4,
            _ => continue,
        };
        let numbers: Vec<f32> = (0..n)
            .flat_map(|i| (0..k).map(move |c| (i, c)))
            .map(|(i, c)| field.values.get(i, c) as f32)
            .collect();
        let numbers = out.array(&numbers, n, kind, Target::ArrayBuffer);
        let name = field
            .name
            .to_uppercase()
            .replace(|c: char| !c.is_alphanumeric(), "_");
        // The crate adds the leading underscore.
        attributes.insert(Valid(Semantic::Extras(name)), numbers);
    }
    let indices = mesh.triangles().as_flattened();
    let indices = out.array(
        indices,
        indices.len(),
        Type::Scalar,
        Target::ElementArrayBuffer,
    );

    out.finish(w, attributes, indices)
}

/// Gathers arrays and the accessors that describe them.
#[derive(Default)]
struct Builder {
    root: Root,
    data: Vec<u8>,
}

/// A number type of glTF.
trait Component: Scalar {
    const TYPE: ComponentType;
}
impl Component for f32 {
    const TYPE: ComponentType = ComponentType::F32;
}
impl Component for u32 {
    const TYPE: ComponentType = ComponentType::U32;
}
impl Component for u8 {
    const TYPE: ComponentType = ComponentType::U8;
}

impl Builder {
    /// Adds `count` tuples; their bytes must be a multiple of 4.
    ///
    /// Bytes per tuple are a multiple of 4 for all that is written (f32, u32, four bytes of colour), so that each array
    /// begins at such a place, as glTF wants.
    fn array<T: Component>(
        &mut self,
        numbers: &[T],
        count: usize,
        kind: Type,
        target: Target,
    ) -> Index<json::Accessor> {
        let start = self.data.len();
        for &n in numbers {
            n.put(&mut self.data);
        }
        let view = self.root.push(json::buffer::View {
            buffer: Index::new(0),
            byte_length: USize64::from(self.data.len() - start),
            byte_offset: Some(USize64::from(start)),
            byte_stride: None,
            name: None,
            target: Some(Valid(target)),
            extensions: None,
            extras: Default::default(),
        });
        self.root.push(json::Accessor {
            buffer_view: Some(view),
            byte_offset: Some(USize64(0)),
            count: USize64::from(count),
            component_type: Valid(GenericComponentType(T::TYPE)),
            type_: Valid(kind),
            min: None,
            max: None,
            name: None,
            normalized: false,
            sparse: None,
            extensions: None,
            extras: Default::default(),
        })
    }

    /// Writes the file: the JSON that says what there is, and the bytes.
    fn finish(
        mut self,
        w: &mut dyn Write,
        attributes: BTreeMap<json::validation::Checked<Semantic>, Index<json::Accessor>>,
        indices: Index<json::Accessor>,
    ) -> Result<(), Error> {
        let root = &mut self.root;
        root.asset.generator = Some("biogeom".to_owned());
        root.push(json::Buffer {
            byte_length: USize64::from(self.data.len()),
            name: None,
            uri: None,
            extensions: None,
            extras: Default::default(),
        });
        // Both sides are shown, since surfaces may be open; not metallic, or colours would turn dark.
        let material = root.push(json::Material {
            double_sided: true,
            pbr_metallic_roughness: json::material::PbrMetallicRoughness {
                metallic_factor: json::material::StrengthFactor(0.0),
                roughness_factor: json::material::StrengthFactor(0.6),
                ..Default::default()
            },
            ..Default::default()
        });
        // One mesh of one primitive in one node of one scene: the least that every program shows.
        let mesh = root.push(json::Mesh {
            name: None,
            primitives: vec![json::mesh::Primitive {
                attributes,
                indices: Some(indices),
                material: Some(material),
                mode: Valid(json::mesh::Mode::Triangles),
                targets: None,
                extensions: None,
                extras: Default::default(),
            }],
            weights: None,
            extensions: None,
            extras: Default::default(),
        });
        let node = root.push(json::Node {
            mesh: Some(mesh),
            ..Default::default()
        });
        let scene = root.push(json::Scene {
            nodes: vec![node],
            name: None,
            extensions: None,
            extras: Default::default(),
        });
        root.scene = Some(scene);
        let json = json::serialize::to_vec(root).map_err(std::io::Error::from)?;
        // Header and two chunk heads of 12 + 8 + 8 bytes, and padding.
        let length = u32::try_from(28 + json.len() + 3 + self.data.len()).map_err(|_| {
            let what = format!("{} bytes of data; GLB holds 4 GB", self.data.len());
            Error::from(ErrorKind::TooLarge(what))
        })?;
        let glb = Glb {
            header: Header {
                magic: *b"glTF",
                version: 2,
                length,
            },
            json: json.into(),
            bin: Some(self.data.into()),
        };
        glb.to_writer(w).map_err(foreign)
    }
}

/// What the crate finds, in our words.
fn foreign(error: gltf::Error) -> Error {
    match error {
        gltf::Error::Io(e) => e.into(),
        gltf::Error::Binary(
            gltf::binary::Error::Length { .. } | gltf::binary::Error::ChunkLength { .. },
        ) => ErrorKind::Truncated("the GLB data".to_owned()).into(),
        other => ErrorKind::expected("binary glTF 2.0", other.to_string()).into(),
    }
}

/// Reads a file.
pub fn read(path: impl AsRef<Path>) -> Result<View<'static>, Error> {
    let path = path.as_ref();
    parse(&read_bytes(path)?).map_err(|e| e.in_file(path))
}

/// Reads a view from the bytes of a file: the triangles of all meshes of its scene, with the nodes'
/// transformations, one after another, and colours if all of them have some. Sparse accessors, data in
/// other files, and primitives other than triangles are refused.
///
/// The scene is the default one, or all where there is none. Vertices of several primitives are not joined.
///
/// # Errors
/// [`ErrorKind::Truncated`], [`ErrorKind::Unsupported`] for what is refused above, [`ErrorKind::Expected`] for what is
/// not glTF 2.0, for nodes that form no tree, and for indices out of range.
pub fn parse(bytes: &[u8]) -> Result<View<'static>, Error> {
    // The crate takes for granted that the stated length includes the header's 12 bytes.
    let stated = bytes.get(8..12).map(|n| u32::get(n, true));
    if let Some(stated) = stated.filter(|&n| n < 12) {
        let found = format!("{stated} bytes");
        return Err(ErrorKind::expected("the length of a GLB file", found).into());
    }
    let glb = Glb::from_slice(bytes).map_err(foreign)?;
    let root = gltf::json::Root::from_slice(&glb.json).map_err(|e| foreign(e.into()))?;
    check_positions(&root)?;
    let document = gltf::Document::from_json(root).map_err(foreign)?;
    let data = glb.bin.as_deref().unwrap_or_default();
    let mut pending: Vec<(gltf::Node<'_>, Matrix4<f64>)> = match document.default_scene() {
        Some(scene) => scene.nodes().collect::<Vec<_>>(),
        None => document.scenes().flat_map(|s| s.nodes()).collect(),
    }
    .into_iter()
    .map(|node| (node, Matrix4::identity()))
    .collect();
    pending.reverse();
    let mut seen = vec![false; document.nodes().len()];
    let mut parts = Parts::default();
    while let Some((node, parent)) = pending.pop() {
        // Nodes form trees; a loop would never end.
        if std::mem::replace(&mut seen[node.index()], true) {
            let found = format!("node {} twice", node.index());
            return Err(ErrorKind::expected("a tree of nodes", found).into());
        }
        let own = Matrix4::from_fn(|i, j| f64::from(node.transform().matrix()[j][i]));
        let whole = parent * own;
        for primitive in node.mesh().iter().flat_map(gltf::Mesh::primitives) {
            parts.add(&primitive, &whole, data)?;
        }
        let children: Vec<_> = node.children().map(|child| (child, whole)).collect();
        pending.extend(children.into_iter().rev());
    }
    let colors = parts.colors.filter(|c| c.len() == parts.points.len());
    View {
        points: parts.points.into(),
        blocks: vec![Cells::Triangles(parts.triangles.into())],
        colors: colors.map(Into::into),
        ..View::default()
    }
    .checked()
}

/// Positions that do not exist: the crate looks them up before it has checked that they do.
fn check_positions(root: &gltf::json::Root) -> Result<(), Error> {
    let key = gltf::json::validation::Checked::Valid(gltf::Semantic::Positions);
    for primitive in root.meshes.iter().flat_map(|m| &m.primitives) {
        let positions = primitive.attributes.get(&key).map(|i| i.value());
        if positions.is_some_and(|i| i >= root.accessors.len()) {
            let expected = format!("POSITION to be one of {} accessors", root.accessors.len());
            let found = format!("accessor {}", positions.unwrap_or_default());
            return Err(ErrorKind::expected(expected, found).into());
        }
    }
    Ok(())
}

/// What primitives give, one after another.
#[derive(Default)]
struct Parts {
    points: Vec<Point3>,
    triangles: Vec<[u32; 3]>,
    colors: Option<Vec<[u8; 4]>>,
}

impl Parts {
    /// One primitive, its points moved by `transform`.
    fn add(
        &mut self,
        primitive: &gltf::Primitive<'_>,
        transform: &Matrix4<f64>,
        data: &[u8],
    ) -> Result<(), Error> {
        if primitive.mode() != gltf::mesh::Mode::Triangles {
            let what = format!(
                "primitives of mode {:?}; only triangles are read",
                primitive.mode()
            );
            return Err(ErrorKind::Unsupported(what).into());
        }
        let Some(positions) = primitive.get(&gltf::Semantic::Positions) else {
            return Ok(());
        };
        // Places come in the node's own frame.
        let first = self.points.len() as u32;
        let positions = tuples(&positions, data)?;
        if positions.components != 3 {
            let found = format!("{} components", positions.components);
            return Err(ErrorKind::expected("positions of 3 components", found).into());
        }
        let (points, _) = positions.numbers.as_chunks::<3>();
        self.points.extend(points.iter().map(|p| {
            let p = transform * nalgebra::Vector4::new(p[0], p[1], p[2], 1.0);
            Point3::new(p.x, p.y, p.z)
        }));
        let n = points.len() as u32;
        // Without indices each three points are a triangle.
        let indices: Vec<u32> = match primitive.indices() {
            None => (0..n).collect(),
            Some(indices) => {
                let indices = tuples(&indices, data)?;
                indices.numbers.iter().map(|&i| i as u32).collect()
            }
        };
        if let Some(&vertex) = indices.iter().find(|&&i| i >= n) {
            let expected = format!("an index below {n}");
            return Err(ErrorKind::expected(expected, vertex.to_string()).into());
        }
        let (triangles, rest) = indices.as_chunks::<3>();
        if !rest.is_empty() {
            let found = indices.len().to_string();
            return Err(ErrorKind::expected("three indices per triangle", found).into());
        }
        self.triangles
            .extend(triangles.iter().map(|t| t.map(|i| first + i)));
        // Colours are floats in 0…1 or whole numbers up to the largest; alpha may be absent.
        if let Some(colors) = primitive.get(&gltf::Semantic::Colors(0)) {
            let full = match colors.data_type() {
                gltf::accessor::DataType::F32 => 1.0,
                gltf::accessor::DataType::U16 => f64::from(u16::MAX),
                _ => f64::from(u8::MAX),
            };
            let colors = tuples(&colors, data)?;
            let all = self.colors.get_or_insert_default();
            for tuple in colors.numbers.chunks_exact(colors.components) {
                let channel = |k: usize| match tuple.get(k) {
                    Some(c) => (c / full * 255.0).round() as u8,
                    None => u8::MAX,
                };
                all.push([0, 1, 2, 3].map(channel));
            }
        }
        Ok(())
    }
}

struct Tuples {
    components: usize,
    numbers: Vec<f64>,
}

/// The tuples of an accessor, as f64.
fn tuples(accessor: &gltf::Accessor<'_>, data: &[u8]) -> Result<Tuples, Error> {
    use gltf::accessor::DataType;
    let unsupported = |what: &str| {
        let what = format!("accessor {}: {what}", accessor.index());
        Error::from(ErrorKind::Unsupported(what))
    };
    if accessor.sparse().is_some() {
        return Err(unsupported("sparse data are not read"));
    }
    let view = accessor.view().ok_or_else(|| unsupported("without data"))?;
    if !matches!(view.buffer().source(), gltf::buffer::Source::Bin) {
        return Err(unsupported("data in another file are not read"));
    }
    let components = accessor.dimensions().multiplicity();
    let number: fn(&[u8]) -> f64 = match accessor.data_type() {
        DataType::I8 => |b| i8::get(b, true).into(),
        DataType::U8 => |b| u8::get(b, true).into(),
        DataType::I16 => |b| i16::get(b, true).into(),
        DataType::U16 => |b| u16::get(b, true).into(),
        DataType::U32 => |b| u32::get(b, true).into(),
        DataType::F32 => |b| f32::get(b, true).into(),
    };
    let width = accessor.data_type().size();
    let (tuple, count) = (width * components, accessor.count());
    let stride = view.stride().unwrap_or(tuple).max(tuple);
    let truncated = || {
        let what = format!("the data of accessor {}", accessor.index());
        Error::from(ErrorKind::Truncated(what))
    };
    let end = view.offset().checked_add(view.length());
    let bytes = end.and_then(|end| data.get(view.offset()..end));
    let bytes = bytes.and_then(|b| b.get(accessor.offset()..));
    let bytes = bytes.ok_or_else(truncated)?;
    let needed = match count {
        0 => Some(0),
        n => (n - 1)
            .checked_mul(stride)
            .and_then(|n| n.checked_add(tuple)),
    };
    if needed.is_none_or(|n| n > bytes.len()) {
        return Err(truncated());
    }
    let mut numbers = Vec::with_capacity(count * components);
    for i in 0..count {
        for k in 0..components {
            numbers.push(number(&bytes[i * stride + k * width..]));
        }
    }
    Ok(Tuples {
        components,
        numbers,
    })
}
