//! What is not written, and what is not read: halves, bombs, parts that do not fit.

use std::io::Write as _;

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD as BASE64;
use geom_core::io::mesh::{AnyMesh, MeshFile};
use geom_core::io::view::{Cells, Field, Group, Numbers, Values};
use geom_core::io::{
    Encoding, Error, ErrorKind, View, decompress, glb, msh, obj, off, ply, read_bytes,
    read_bytes_up_to, save, stl, vtu,
};
use geom_core::mesh::{MeshError, OUTSIDE};
use geom_core::{Point3, TetMesh};

#[test]
fn nothing_half_written_is_left() {
    let folder = tempfile::tempdir().unwrap();
    let target = folder.path().join("a.txt");
    let failed = save(&target, |w| {
        w.write_all(b"half")?;
        Err(ErrorKind::Empty.into())
    });
    assert!(failed.unwrap_err().to_string().contains("a.txt"));
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
    save(&target, |w| Ok(w.write_all(b"whole")?)).unwrap();
    assert_eq!(read_bytes(&target).unwrap(), b"whole");
    let packed = folder.path().join("a.txt.gz");
    save(&packed, |w| Ok(w.write_all(&[7; 10_000])?)).unwrap();
    assert!(std::fs::metadata(&packed).unwrap().len() < 100);
    assert_eq!(read_bytes(&packed).unwrap(), [7; 10_000]);
}

#[test]
fn truncated_gzip_is_named() {
    let mut encoder = flate2::write::GzEncoder::new(Vec::new(), Default::default());
    encoder.write_all(&[7; 10_000]).unwrap();
    let whole = encoder.finish().unwrap();
    assert_eq!(decompress(whole.clone()).unwrap(), vec![7; 10_000]);
    let cut = decompress(whole[..whole.len() / 2].to_vec()).unwrap_err();
    assert!(matches!(cut.kind, ErrorKind::Truncated(_)));
}

#[test]
fn gzip_that_unpacks_to_too_much_is_refused() {
    let mut encoder = flate2::write::GzEncoder::new(Vec::new(), Default::default());
    encoder.write_all(&[7; 10_000]).unwrap();
    let packed = encoder.finish().unwrap();
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("a.gz");
    std::fs::write(&file, &packed).unwrap();
    assert_eq!(read_bytes_up_to(&file, 10_000).unwrap(), [7; 10_000]);
    // Two members count together.
    let twice = [packed.clone(), packed.clone()].concat();
    for (data, limit) in [(packed, 9_999), (twice, 19_999)] {
        std::fs::write(&file, data).unwrap();
        let error = read_bytes_up_to(&file, limit).unwrap_err();
        assert!(matches!(error.kind, ErrorKind::TooLarge(_)));
        assert!(error.to_string().contains(&limit.to_string()), "{error}");
    }
}

/// With its line, as the file counts it.
#[test]
fn corners_that_no_vertex_has_are_named() {
    let vertices = "v 0 0 0\nv 1 0 0\nv 0 1 0\n";
    let late = format!("f 1 2 3\n{vertices}");
    assert_eq!(obj::parse(late.as_bytes()).unwrap().cells(), 1);
    let text = format!("{vertices}f 1 2 3\nf 1 9 2\nf 3 2 1\n");
    let error = obj::parse(text.as_bytes()).unwrap_err().to_string();
    assert!(
        error.contains("line 5") && error.contains("\"9\""),
        "{error}"
    );
    assert!(error.contains("at most 3"), "{error}");
    let text = "OFF\n3 2 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n3 0 3 1\n";
    let error = off::parse(text.as_bytes()).unwrap_err().to_string();
    assert!(
        error.contains("line 7") && error.contains("\"3\""),
        "{error}"
    );
    assert!(error.contains("below 3"), "{error}");
}

fn triangle() -> View<'static> {
    View {
        points: vec![
            Point3::origin(),
            Point3::new(1.0, 0.0, 0.0),
            Point3::new(0.0, 1.0, 0.0),
        ]
        .into(),
        blocks: vec![Cells::Triangles(vec![[0, 1, 2]].into())],
        ..View::default()
    }
}

type Writer = fn(&mut dyn std::io::Write, &View<'_>) -> Result<(), Error>;

/// Of every format.
const WRITERS: [Writer; 7] = [
    |w, view| ply::write(w, view, Encoding::default()),
    off::write,
    obj::write,
    stl::write,
    glb::write,
    vtu::write,
    |w, view| msh::write(w, view, msh::Options::default()),
];

/// Every field of a view is public: what was put together by hand is looked at before it is written.
#[test]
fn no_writer_takes_parts_that_do_not_fit() {
    let field = |components, numbers: Vec<f64>| Field {
        name: "height".to_owned(),
        values: Values {
            components,
            numbers: Numbers::F64(numbers.into()),
        },
    };
    let mut none: Vec<View<'_>> = vec![triangle(); 10];
    none[0].points.to_mut()[1].x = f64::NAN;
    none[1].blocks.push(Cells::Quads(vec![[0, 1, 2, 3]].into()));
    none[2].blocks.push(Cells::Polygons {
        ends: vec![3, 2].into(),
        corners: vec![0, 1, 2].into(),
    });
    none[3].point_fields.push(field(1, vec![1.0; 2]));
    none[4].point_fields.push(field(0, vec![1.0; 3]));
    none[5].point_fields.push(field(2, vec![1.0; 7]));
    none[6].cell_fields.push(field(1, vec![1.0; 2]));
    none[7].colors = Some(vec![[0; 4]; 2].into());
    none[8].group_of = vec![0, 0].into();
    none[9].cell_fields.push(field(0, vec![]));
    for write in WRITERS {
        write(&mut Vec::new(), &triangle()).unwrap();
        for (i, view) in none.iter().enumerate() {
            assert!(write(&mut Vec::new(), view).is_err(), "{i}");
        }
    }
    assert_eq!(none[4].point_fields[0].values.len(), 0);
    let partial = field(2, vec![1.0; 3]).values;
    assert!(triangle().cell_field("height", partial).is_err());
}

/// A field of the name under which groups are written stays a field.
#[test]
fn a_field_named_group_is_no_group() {
    let mut view = triangle().cell_field("group", vec![7u32]).unwrap();
    view.groups.push(Group {
        name: "top".to_owned(),
        dimension: 2,
        tag: Some(1),
    });
    view.group_of = vec![0].into();
    let mut file = Vec::new();
    vtu::write(&mut file, &view).unwrap();
    let back = vtu::parse(&file).unwrap();
    assert_eq!(
        (&back.groups, &back.group_of),
        (&view.groups, &view.group_of)
    );
    let values = &back.find_cell_field("group").unwrap().values;
    assert_eq!(values.to_f64(), [7.0]);
}

/// Sixty thousand zeros in a few bytes, which the header says to be four.
#[test]
fn vtu_blocks_that_unpack_to_too_much_are_refused() {
    let mut zlib = flate2::write::ZlibEncoder::new(Vec::new(), Default::default());
    zlib.write_all(&[0; 60_000]).unwrap();
    let block = zlib.finish().unwrap();
    let text = |size: u32| {
        let head: Vec<u8> = [1, size, 0, block.len() as u32]
            .iter()
            .flat_map(|n: &u32| n.to_le_bytes())
            .collect();
        let data = [BASE64.encode(head), BASE64.encode(&block)].concat();
        format!(
            "<VTKFile type=\"UnstructuredGrid\" version=\"0.1\" byte_order=\"LittleEndian\" \
             compressor=\"vtkZLibDataCompressor\"><UnstructuredGrid>\
             <Piece NumberOfPoints=\"5000\" NumberOfCells=\"0\"><Points>\
             <DataArray type=\"Float32\" NumberOfComponents=\"3\" format=\"binary\">{data}</DataArray>\
             </Points><Cells>\
             <DataArray type=\"Int32\" Name=\"connectivity\" format=\"ascii\"></DataArray>\
             <DataArray type=\"Int32\" Name=\"offsets\" format=\"ascii\"></DataArray>\
             <DataArray type=\"UInt8\" Name=\"types\" format=\"ascii\"></DataArray>\
             </Cells></Piece></UnstructuredGrid></VTKFile>"
        )
    };
    let read = |size| vtu::parse(text(size).as_bytes());
    assert_eq!(read(60_000).unwrap().points.len(), 5000);
    let error = read(4).unwrap_err();
    assert!(matches!(error.kind, ErrorKind::TooLarge(_)), "{error}");
}

/// 255 is outside: no tetrahedron has it, whatever type its number has and whatever its group is called.
#[test]
fn outside_is_no_region() {
    let tet = || View {
        points: [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
            .map(Point3::from)
            .to_vec()
            .into(),
        blocks: vec![Cells::Tets(vec![[0, 1, 2, 3]].into())],
        ..View::default()
    };
    for numbers in [
        Numbers::U8(vec![255].into()),
        Numbers::F64(vec![255.0].into()),
    ] {
        let mut view = tet();
        view.cell_fields.push(Field {
            name: "region".to_owned(),
            values: Values {
                components: 1,
                numbers,
            },
        });
        assert!(MeshFile::try_from(view).is_err());
    }
    let mut view = tet();
    view.groups = vec![Group {
        name: "region_255".to_owned(),
        dimension: 3,
        tag: None,
    }];
    view.group_of = vec![0].into();
    let AnyMesh::Tet(mesh) = MeshFile::try_from(view).unwrap().mesh else {
        panic!("a tetrahedron");
    };
    assert_ne!(mesh.regions()[0], OUTSIDE);
    let points = mesh.positions().to_vec();
    let refused = TetMesh::with_regions(points, mesh.tets().to_vec(), vec![OUTSIDE]);
    assert_eq!(refused, Err(MeshError::Outside { element: 0 }));
}

/// Polygons of three corners are faces, and not among the triangles that are asked for.
#[test]
fn only_triangles_are_taken_away() {
    let mut view = triangle();
    view.blocks.push(Cells::Polygons {
        ends: vec![3].into(),
        corners: vec![0, 1, 2].into(),
    });
    view.cell_fields.push(Field {
        name: "number".to_owned(),
        values: Values {
            components: 1,
            numbers: Numbers::F64(vec![1.0, 2.0].into()),
        },
    });
    let left = view.with_triangles(|_| false);
    assert_eq!(left.cells(), 1);
    assert_eq!(left.cell_fields[0].values.get(0, 0), 2.0);
}

#[cfg(unix)]
#[test]
fn files_keep_their_rights() {
    use std::os::unix::fs::PermissionsExt;
    let folder = tempfile::tempdir().unwrap();
    let (new, usual) = (folder.path().join("new"), folder.path().join("usual"));
    let mode = |path| std::fs::metadata(path).unwrap().permissions().mode() & 0o777;
    let write = |path| save(path, |w| Ok(w.write_all(b"x")?)).unwrap();
    write(&new);
    std::fs::write(&usual, b"x").unwrap();
    assert_eq!(mode(&new), mode(&usual), "those of any new file");
    std::fs::set_permissions(&new, std::fs::Permissions::from_mode(0o600)).unwrap();
    write(&new);
    assert_eq!(mode(&new), 0o600, "a private file stays so");
}
