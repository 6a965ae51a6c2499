//! What is not written, and what is not read: halves, bombs, parts that do not fit.

use std::io::Write as _;

use geom_core::Point3;
use geom_core::io::view::{Cells, Field, Group, Numbers, Values};
use geom_core::io::{
    Encoding, Error, ErrorKind, View, decompress, glb, msh, obj, off, ply, read_bytes,
    read_bytes_up_to, save, stl, vtu,
};

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
