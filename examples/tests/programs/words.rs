//! What is read from the command line and from lists, and what is said.

use std::path::{Path, PathBuf};

use biogeom_examples::args::{
    ball, bytes, cuboid, cylinder, default_spacing, finer, outer, slab, zone,
};
use biogeom_examples::batch::{Shard, entries_of};
use biogeom_examples::crosses::guide;
use biogeom_examples::input::source::extension;
use biogeom_examples::input::{shapes, tmesh};
use biogeom_examples::products::grouped;
use biogeom_examples::steps::anisotropy::{Source, ramp, source};
use biogeom_examples::words;
use dual_contour::{Outer, Shape};
use geom_core::{Aabb, Point3};
use serde_json::{Map, json};

/// JSON has no infinity: what is `null` is infinite again.
#[test]
fn options_survive_json() {
    let options = dual_contour::Options::default();
    let text = serde_json::to_string(&options).unwrap();
    let again: dual_contour::Options = serde_json::from_str(&text).unwrap();
    assert_eq!(again, options);
    let typo = serde_json::from_str::<dual_contour::Options>(r#"{"toleranze": 3.0}"#);
    assert!(typo.unwrap_err().to_string().contains("toleranze"));

    let strokes = crossfield::Guidance::Strokes {
        strokes: vec![(Point3::origin(), geom_core::Vector3::x())],
        weight: f64::INFINITY,
    };
    let text = serde_json::to_string(&strokes).unwrap();
    let again: crossfield::Guidance = serde_json::from_str(&text).unwrap();
    assert_eq!(again, strokes);
}

#[test]
fn memory_is_read_with_units() {
    assert_eq!(bytes("1000"), Ok(1000));
    assert_eq!(bytes("1.5k"), Ok(1536));
    assert_eq!(bytes("500M"), Ok(500 << 20));
    assert_eq!(bytes("4GiB"), Ok(4 << 30));
    assert_eq!(bytes("2 tb"), Ok(2 << 40));
    for bad in ["", "G", "-1G", "4X", "nan", "inf", "0"] {
        assert!(bytes(bad).is_err(), "{bad:?}");
    }
}

#[test]
fn shapes_are_read() {
    assert_eq!(outer("box:1.5"), Ok(Outer::Box { scale: 1.5 }));
    assert_eq!(outer("grid"), Ok(Outer::Grid));
    assert!(outer("cone:2").is_err() && outer("box:x").is_err());
    assert!(matches!(
        slab("z:-15:15.5"),
        Ok(Shape::Slab {
            low: -15.0,
            high: 15.5,
            ..
        })
    ));
    assert!(slab("-15:15").is_err() && slab("z:1").is_err() && slab("z:2:-2").is_err());
    assert!(matches!(
        ball("1,2,3:4"),
        Ok(Shape::Sphere { radius: 4.0, .. })
    ));
    let low_to_high = Aabb::new(Point3::new(-1.0, 0.0, 2.0), Point3::new(1.0, 5.0, 3.0));
    assert_eq!(cuboid("1,0,3:-1,5,2"), Ok(Shape::Cuboid(low_to_high)));
    assert!(cuboid("1,0:-1,5,2").is_err() && zone("0,0,0:1").is_err());
    assert!(finer("A=thin").is_err() && finer("A").is_err());
    assert_eq!(finer("A,B:1-5=0.2").unwrap().tolerance, 0.2);
    let ball = zone("0,0,1:8:0.1").unwrap();
    assert_eq!(
        (ball.center.z, ball.radius, ball.tolerance),
        (1.0, 8.0, 0.1)
    );
    assert!(cylinder("0,0,0:0,0,9:2").is_ok() && cylinder("0,0:0,0,9:2").is_err());
}

#[test]
fn the_default_spacing_grows_with_the_structure() {
    assert_eq!(default_spacing(300), 0.5);
    assert_eq!(default_spacing(8_000), 1.0);
    assert_eq!(default_spacing(5_000_000), 1.6);
}

#[test]
fn shards_are_read() {
    assert_eq!("2/8".parse(), Ok(Shard { number: 2, of: 8 }));
    for bad in ["0/8", "9/8", "1", "1/0", "a/b", "-1/3"] {
        assert!(bad.parse::<Shard>().is_err(), "{bad}");
    }
}

#[test]
fn inputs_keep_their_place_and_their_ending_only_where_they_must() {
    let folder = tempfile::tempdir().unwrap();
    let top = folder.path();
    std::fs::create_dir(top.join("ab")).unwrap();
    // Results of a run before are no inputs.
    std::fs::create_dir_all(top.join("out/2xyz")).unwrap();
    std::fs::write(top.join("out/2xyz/density.mrc"), "x").unwrap();
    for file in ["ab/1abc.cif.gz", "2xyz.pdb", "2xyz.cif", "notes.txt"] {
        std::fs::write(top.join(file), "x").unwrap();
    }
    std::fs::write(
        top.join("some.list"),
        "# two\nab/1abc.cif.gz\n\n2xyz.pdb # the second\n",
    )
    .unwrap();
    let names = |inputs: &[&str]| -> Vec<String> {
        let inputs: Vec<PathBuf> = inputs.iter().map(|i| top.join(i)).collect();
        let entries = entries_of(&inputs, &top.join("out")).unwrap();
        assert!(entries.iter().all(|e| e.1.is_file()));
        entries.into_iter().map(|e| e.0).collect()
    };
    assert_eq!(names(&[""]), ["2xyz.cif", "2xyz.pdb", "ab/1abc"]);
    assert_eq!(names(&["some.list"]), ["1abc", "2xyz"]);
    assert_eq!(names(&["2xyz.pdb", "ab"]), ["1abc", "2xyz"]);
    let twice = [top.join("2xyz.pdb"), top.join("some.list")];
    assert!(
        entries_of(&twice, top)
            .unwrap_err()
            .to_string()
            .contains("2xyz.pdb")
    );
    std::fs::create_dir(top.join("empty")).unwrap();
    assert!(entries_of(&[top.join("empty")], top).is_err());
}

#[test]
fn the_extension_is_that_before_gz() {
    assert_eq!(extension(Path::new("a/B.PDB.gz")), "pdb");
    assert_eq!(extension(Path::new("emd_1234.map")), "map");
    assert_eq!(extension(Path::new("none")), "");
}

#[test]
fn levels_are_read_as_they_are_written() {
    for text in ["chain:A=2,B=0", "domain:1=0,2=3", "curvature", "charge"] {
        assert_eq!(tmesh::wanted(text).unwrap().to_string(), text);
    }
    for text in ["chain:A", "chain:A=9", "chain:", "domain:1", ""] {
        assert!(tmesh::wanted(text).is_err(), "{text}");
    }
}

#[test]
fn anchors_are_read() {
    let (a, b) = shapes::anchor("1,2,3= 4,-5,6.5").unwrap();
    assert_eq!((a.z, b.y, b.z), (3.0, -5.0, 6.5));
    assert!(shapes::anchor("1,2,3").is_err() && shapes::anchor("1,2=3,4,5").is_err());
}

#[test]
fn guides_are_read_as_they_are_written() {
    for text in [
        "none",
        "curvature",
        "modes:auto",
        "modes:1,2",
        "characteristic:3",
    ] {
        assert_eq!(guide(text).unwrap().to_string(), text);
    }
    for text in ["modes:0", "modes:", "modes:a", "contours", "curvature:1"] {
        assert!(guide(text).is_err(), "{text}");
    }
}

#[test]
fn fields_are_read_as_they_are_written() {
    for text in [
        "mode:3",
        "curvature",
        "distance:1,-2.5,3",
        "distance:name:XK2",
        "distance:A,B:10-25",
        "charge",
    ] {
        assert_eq!(source(text).unwrap().to_string(), text);
    }
    assert_eq!(source("distance:1,2,3"), Ok(Source::Point([1.0, 2.0, 3.0])));
    for text in ["mode:0", "mode:x", "distance:", "distance:B:ten", ""] {
        assert!(source(text).is_err(), "{text}");
    }
    assert_eq!(ramp("0.3,0.9"), Ok([0.3, 0.9]));
    assert!(ramp("0.3").is_err() && ramp("a,b").is_err());
}

#[test]
fn digits_stand_in_threes() {
    assert_eq!(grouped(7), "7");
    assert_eq!(grouped(270), "270");
    assert_eq!(grouped(1000), "1,000");
    assert_eq!(grouped(27_870_123), "27,870,123");
}

#[test]
fn what_matters_is_said() {
    let notes = json!({
        "structure": { "atoms": 1234, "waters": 56, "ions": 0, "zero_radii": 2, "warnings": ["odd"] },
        "counts": { "tetrahedra": 99_999, "surface_triangles": 7 },
        "quality": { "after": { "all": {
            "min_dihedral": { "min": 25.04 }, "max_dihedral": { "max": 141.0 }
        } } },
        "surface": { "crossing_pairs": 0 },
        "advice": { "warnings": ["wider bounds"] },
        "quads": { "counts": { "quads": 1200, "irregular": 8 } }
    });
    let said = words::lines(notes.as_object().unwrap());
    assert_eq!(said[0], "1,234 atoms; left out: 56 of waters");
    assert_eq!(
        said[1],
        "99,999 tetrahedra, 7 triangles of the surface, dihedral angles from 25.0° to 141.0°"
    );
    assert_eq!(said[2], "quads: 1,200 quads, 8 irregular vertices");
    assert!(said[3].starts_with("warning: 2 atoms have radius 0"));
    assert_eq!(said[4..], ["warning: odd", "warning: wider bounds"]);
    let compared = json!({
        "correspondence": { "verdict": "doubtful", "coverage": 0.984, "unmatched": 0.0556, "warnings": ["odd"] },
        "distance": 7.1194,
    });
    let said = words::lines(compared.as_object().unwrap());
    let told = "the correspondence is doubtful, coverage 0.98, 5.6 % without a match, distance of the shapes 7.1194";
    assert_eq!(said, [told, "warning: odd"]);
    assert!(words::lines(&Map::new()).is_empty());
}
