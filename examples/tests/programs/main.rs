//! Runs every program on small inputs: outputs, report, errors in one line, the same bytes for any
//! number of threads.

mod pictures;
mod sessions;
mod sphere;
mod words;

use std::collections::BTreeMap;
use std::io::Read as _;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use flate2::read::ZlibDecoder;
use geom_core::io::{self, mesh::AnyMesh};
use geom_core::mesh::{SurfaceAudit, VolumeAudit, shapes};
use geom_core::testing::gpu_or_skip;
use geom_core::{Point3, TriMesh, Vector3};
use serde_json::{Value, json};

/// A program of this package; `cargo test` builds them beside the tests. With `--test programs` alone they are those that were built
/// last, by `cargo pipeline` perhaps.
fn program(name: &str) -> Command {
    let tests = std::env::current_exe().expect("this test has a path");
    let folder = tests
        .ancestors()
        .nth(2)
        .expect("in target/<profile>/deps")
        .join("examples");
    let path = folder.join(format!("{name}{}", std::env::consts::EXE_SUFFIX));
    assert!(
        path.exists(),
        "no {}: run the whole suite, `cargo test -p biogeom-examples`",
        path.display()
    );
    Command::new(path)
}

fn run(name: &str, args: &[&str], out: &Path) -> Output {
    program(name)
        .args(args)
        .arg("--out")
        .arg(out)
        .output()
        .expect("the program starts")
}

/// The same without pictures, which take longer than most of what programs compute: for what other runs of a program draw.
fn undrawn_report_of(name: &str, args: &[&str], out: &Path) -> Value {
    report_of(name, &[args, &["--no-pictures"]].concat(), out)
}

/// Runs a program that must succeed, with the CPU renderer, and gives its report.
fn report_of(name: &str, args: &[&str], out: &Path) -> Value {
    let output = run(
        name,
        &[args, &["--renderer", "cpu", "--quiet"]].concat(),
        out,
    );
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{name} {args:?}: {errors}");
    let report: Value =
        serde_json::from_slice(&std::fs::read(out.join("report.json")).unwrap()).unwrap();
    for key in [
        "program",
        "version",
        "input",
        "options",
        "backend",
        "threads",
        "stages",
        "seconds",
        "peak_bytes",
        "outputs",
        "counts",
    ] {
        assert!(
            !report[key].is_null() || key == "peak_bytes",
            "{name}: the report lacks {key}"
        );
    }
    assert_eq!(report["program"], name);
    for stage in report["stages"].as_array().unwrap() {
        assert!(stage["name"].is_string() && stage["seconds"].as_f64().unwrap() >= 0.0);
        // Only where kernels ran is a stage credited to the device.
        let device = match stage["kernels"].is_object() {
            true => report["backend"].clone(),
            false => "cpu".into(),
        };
        assert_eq!(stage["backend"], device, "{name}: {stage}");
    }
    // Exactly the files it names, none empty, no staging folder.
    let mut named: Vec<String> = serde_json::from_value(report["outputs"].clone()).unwrap();
    named.sort();
    assert_eq!(
        named,
        contents(out).into_keys().collect::<Vec<_>>(),
        "{name}"
    );
    report
}

/// All files in a folder.
fn contents(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    std::fs::read_dir(folder)
        .unwrap()
        .map(|entry| {
            let entry = entry.unwrap();
            let bytes = std::fs::read(entry.path()).unwrap_or_default();
            assert!(!bytes.is_empty(), "{} is empty", entry.path().display());
            (entry.file_name().into_string().unwrap(), bytes)
        })
        .collect()
}

/// The outputs whose bytes do not depend on how long the run took.
fn lasting(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let mut files = contents(folder);
    for name in ["report.json", "index.html"] {
        assert!(files.remove(name).is_some(), "{name}");
    }
    files
}

/// An array of a page.
fn unpacked(value: &Value) -> Vec<u8> {
    let packed = STANDARD.decode(value.as_str().unwrap()).unwrap();
    let mut bytes = Vec::new();
    ZlibDecoder::new(&packed[..])
        .read_to_end(&mut bytes)
        .unwrap();
    bytes
}

/// Vertices and corners of a surface on a page.
fn shape_of(surface: &Value) -> (Vec<Point3>, Vec<u32>) {
    let mut place = [0u16; 3];
    let bound = |side: usize, k: usize| surface["bounds"][side][k].as_f64().unwrap();
    let positions = unpacked(&surface["positions"]);
    let positions = positions.chunks_exact(6).map(|step| {
        let mut x = Point3::origin();
        for k in 0..3 {
            place[k] = place[k].wrapping_add(u16::from_le_bytes([step[2 * k], step[2 * k + 1]]));
            let [low, high] = [bound(0, k), bound(1, k)];
            x[k] = low + f64::from(place[k]) / 65535.0 * (high - low);
        }
        x
    });
    let positions = positions.collect();
    let mut vertex = 0u32;
    let corners = unpacked(&surface["triangles"]);
    let corners = corners.chunks_exact(4).map(|step| {
        vertex = vertex.wrapping_add(u32::from_le_bytes(step.try_into().unwrap()));
        vertex
    });
    (positions, corners.collect())
}

/// What the page of a run shows.
fn page_of(folder: &Path) -> Value {
    let page = std::fs::read_to_string(folder.join("index.html")).unwrap();
    let start = r#"<script id="data" type="application/json">"#;
    let (_, data) = page.split_once(start).unwrap();
    serde_json::from_str(data.split_once("</script>").unwrap().0).unwrap()
}

fn fixture(name: &str) -> String {
    fixtures::path(name).to_str().unwrap().to_owned()
}

fn tets(path: PathBuf) -> geom_core::TetMesh {
    match io::mesh::read(&path).unwrap().mesh {
        AnyMesh::Tet(mesh) => mesh,
        other => panic!("{}: {other:?}", path.display()),
    }
}

fn assert_png(path: PathBuf) {
    let bytes = std::fs::read(&path).unwrap();
    let decoder = png::Decoder::new(std::io::Cursor::new(bytes));
    let mut reader = decoder.read_info().unwrap();
    let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
    reader.next_frame(&mut pixels).unwrap();
    // Not blank: pixels of many brightnesses.
    let mut seen = [false; 256];
    pixels.iter().for_each(|&p| seen[usize::from(p)] = true);
    assert!(
        seen.iter().filter(|&&s| s).count() > 60,
        "{} is nearly blank",
        path.display()
    );
}

#[test]
fn the_pipeline_gives_the_same_valid_mesh_for_any_number_of_threads() {
    let folder = tempfile::tempdir().unwrap();
    let input = fixture("1AJJ.pdb");
    let mut outputs = Vec::new();
    for threads in ["1", "3"] {
        let out = folder.path().join(threads);
        let report = report_of(
            "00_pipeline",
            &[&input, "--spacing", "1.4", "--threads", threads],
            &out,
        );
        assert_eq!(report["structure"]["atoms"], report["counts"]["atoms"]);
        assert!(
            report["quality"]["after"]["all"]["min_dihedral"]["min"]
                .as_f64()
                .unwrap()
                >= 10.0
        );
        assert_eq!(report["quality"]["after"]["all"]["inverted"], 0);
        assert!(report["quality"]["before"]["all"]["min_dihedral_histogram"].is_array());
        assert_eq!(report["surface"]["closed"], true);
        assert_eq!(report["surface"]["manifold"], true);
        assert_eq!(report["volume"]["valid"], true);
        // The page holds the report, and the surface in all its colours.
        let page = page_of(&out);
        assert_eq!(page["report"]["counts"], report["counts"]);
        assert_eq!(page["structure"]["format"], "pdb");
        let surface = &page["surfaces"][0];
        let ways: Vec<_> = surface["colorings"].as_array().unwrap().iter().collect();
        let named: Vec<_> = ways.iter().map(|w| w["name"].as_str().unwrap()).collect();
        assert_eq!(named, ["chain", "residue", "element", "mean curvature"]);
        let vertices = report["counts"]["surface_vertices"].as_u64().unwrap() as usize;
        let colored = |way: &Value| unpacked(&way["colors"]).len() == 3 * vertices;
        assert!(ways.iter().all(|way| colored(way)));
        let file = io::mesh::read(out.join("surface.ply"))
            .unwrap()
            .mesh
            .into_triangles();
        assert_eq!(shape_of(surface).1, file.triangles().as_flattened());
        for (shown, p) in shape_of(surface).0.iter().zip(file.positions()) {
            assert!((shown - p).norm() < 1e-3, "{shown} for {p}");
        }
        outputs.push(lasting(&out));
    }
    let names: Vec<_> = outputs[0].keys().map(String::as_str).collect();
    assert_eq!(
        names,
        [
            "quality.png",
            "surface.glb",
            "surface.ply",
            "surface.png",
            "view.cxc",
            "view.pml",
            "volume.msh",
            "volume.png",
            "volume.vtu"
        ]
    );
    for other in &outputs[1..] {
        for (name, bytes) in &outputs[0] {
            assert!(
                other[name] == *bytes,
                "{name} depends on the number of threads"
            );
        }
    }

    // The files say the same: a closed surface that is the boundary of the tetrahedra.
    let out = folder.path().join("1");
    let surface = io::mesh::read(out.join("surface.ply"))
        .unwrap()
        .mesh
        .into_triangles();
    assert!(SurfaceAudit::of(&surface).is_closed_manifold());
    for file in ["volume.vtu", "volume.msh"] {
        let mesh = tets(out.join(file));
        assert!(VolumeAudit::of(&mesh).is_valid(), "{file}");
        assert!(
            (mesh.volume() / surface.volume() - 1.0).abs() < 1e-5,
            "{file}"
        );
    }
    for picture in ["surface.png", "volume.png", "quality.png"] {
        assert_png(out.join(picture));
    }

    // Points know the atom that lies nearest, its residue and its chain.
    let atoms = io::structure::read(&input, &io::structure::ReadOptions::default()).unwrap();
    let atoms = atoms.structure;
    for file in ["surface.ply", "volume.vtu"] {
        let bytes = std::fs::read(out.join(file)).unwrap();
        let view = io::mesh::parse(&bytes, &file[file.len() - 3..]).unwrap();
        let [atom, residue, chain] = ["atom", "residue", "chain"]
            .map(|name| view.find_point_field(name).unwrap().values.to_f64());
        for (v, p) in view.points.iter().enumerate().step_by(97) {
            let distance = |a: usize| (atoms.atoms()[a].position - p).norm();
            let nearest =
                (0..atoms.atoms().len()).min_by(|&a, &b| distance(a).total_cmp(&distance(b)));
            let nearest = nearest.unwrap();
            assert!(
                distance(atom[v] as usize) <= distance(nearest) + 1e-4,
                "{file} {v}"
            );
            let of = (0..atoms.residues().len())
                .find(|&r| atoms.residue_atoms(r).contains(&(atom[v] as usize)));
            assert_eq!(f64::from(atoms.residues()[of.unwrap()].number), residue[v]);
            assert!((chain[v] as usize) < atoms.chains().len());
        }
    }

    // Every cell has its quality, a face that of the tetrahedron behind it.
    let bytes = std::fs::read(out.join("volume.vtu")).unwrap();
    let view = io::vtu::parse(&bytes).unwrap();
    let quality = view.find_cell_field("joe_liu").unwrap().values.to_f64();
    assert_eq!(quality.len(), view.cells());
    assert!(quality.iter().all(|q| *q > 0.0 && *q <= 1.0));
    let sides = view.sides();
    assert!(!sides.is_empty());
    for (face, [behind, before]) in sides {
        assert_eq!(quality[face as usize], quality[behind as usize]);
        assert_eq!(before, io::view::NO_CELL, "only the molecule is meshed");
    }
}

/// The pipeline takes all that the mesher takes: materials, an outer box, cells of a largest size, grids.
/// One call through all crates: each stage has its folder and its notes, and the page shows all of them.
#[test]
fn the_pipeline_goes_through_all_stages() {
    let folder = tempfile::tempdir().unwrap();
    let input = folder.path().join("one.pdb");
    std::fs::write(&input, ATOM).unwrap();
    let out = folder.path().join("all");
    let args = [input.to_str().unwrap(), "--no-pictures", "--stages", "all"];
    let output = run("00_pipeline", &args, &out);
    let said = String::from_utf8([output.stdout, output.stderr].concat()).unwrap();
    assert!(output.status.success(), "{said}");
    for file in [
        "volume.vtu",
        "density/density.mrc",
        "modes/modes.vtu",
        "quads/quads.obj",
        "tmesh/tmesh.json",
        "spline/surface.step",
        "segments/segments.seg",
        "pockets/pockets.csv",
    ] {
        assert!(out.join(file).exists(), "{file}: {said}");
    }
    let report = std::fs::read(out.join("report.json")).unwrap();
    let report: Value = serde_json::from_slice(&report).unwrap();
    assert_eq!(report["quads"]["scaled_jacobian"]["below_0_3"], 0);
    assert!(report["spline"]["error"]["rms"].as_f64().unwrap() < 0.01);
    assert!(
        said.contains("quads: ") && said.contains("spline: "),
        "{said}"
    );

    // Some of them, without tetrahedra, on one page; what does not fit together is said.
    let some = folder.path().join("some");
    let args = [
        args[0],
        "--spacing",
        "0.7",
        "--renderer",
        "cpu",
        "--stages",
        "surface,quads",
    ];
    assert!(run("00_pipeline", &args, &some).status.success());
    assert!(some.join("surface.ply").exists() && !some.join("volume.vtu").exists());
    let page = page_of(&some);
    let surfaces = page["surfaces"].as_array().unwrap();
    let names: Vec<_> = surfaces.iter().map(|s| &s["name"]).collect();
    assert_eq!(names, ["quads", "surface"]);
    assert_png(some.join("quads/quads.png"));
    let refused = |more: &[&str]| {
        let output = run(
            "00_pipeline",
            &[&args[..1], more].concat(),
            &folder.path().join("no"),
        );
        assert_eq!(output.status.code(), Some(1));
        String::from_utf8(output.stderr).unwrap()
    };
    let said = refused(&["--stages", "modes", "--membrane"]);
    assert!(said.contains("--membrane is for --stages tets"), "{said}");
}

#[test]
fn the_pipeline_improves_materials_and_maps() {
    let folder = tempfile::tempdir().unwrap();
    let (input, out) = (fixture("1AJJ.pdb"), folder.path().join("slab"));
    let asked = [
        "--region",
        "both",
        "--outer",
        "box:1.1",
        "--slab",
        "z:-4:4",
        "--max-cell",
        "8",
        "--select",
        "residue:4-15",
    ];
    let report = report_of(
        "00_pipeline",
        &[&[&input, "--spacing", "2"], &asked[..]].concat(),
        &out,
    );
    let mesh = tets(out.join("volume.vtu"));
    assert!(VolumeAudit::of(&mesh).is_valid());
    for region in 0..3 {
        assert!(mesh.regions().contains(&region), "{region}");
    }
    let smallest = |when: &str| {
        report["quality"][when]["all"]["min_dihedral"]["min"]
            .as_f64()
            .unwrap()
    };
    // Where three regions meet at sharp angles, elements cannot be better than the angles.
    assert!(smallest("after") > 10.0 && smallest("after") > smallest("before"));
    assert_eq!(report["quality"]["after"]["all"]["inverted"], 0);

    let maps = folder.path().join("maps");
    undrawn_report_of("01_density", &[&input, "--spacing", "2"], &maps);
    let map = maps.join("density.mrc");
    let out = folder.path().join("map");
    let args = [map.to_str().unwrap(), "--isovalue", "1"];
    undrawn_report_of("00_pipeline", &args, &out);
    let mesh = tets(out.join("volume.vtu"));
    assert!(VolumeAudit::of(&mesh).is_valid() && mesh.volume() > 1000.0);
    // Counted by lattice points the surface would enclose 7 % more.
    for (method, close) in [("dual-contour", 0.003), ("stuffing", 0.05)] {
        let volume = ["--enclosed-volume", "4000", "--method", method];
        let args = [&[map.to_str().unwrap()], &volume[..]].concat();
        let report = undrawn_report_of("02_surface", &args, &folder.path().join(method));
        let volume = report["surface"]["volume"].as_f64().unwrap();
        assert!((volume / 4000.0 - 1.0).abs() < close, "{volume}");
    }
}

#[test]
fn density_maps_come_back_as_surfaces() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("density");
    let input = fixture("1AJJ.pdb");
    let arguments = [&input, "--spacing", "1", "--dx", "--k-a"];
    let report = report_of("01_density", &arguments, &out);
    let shares: Vec<f64> = report["k_a"]
        .as_array()
        .unwrap()
        .iter()
        .map(|b| b["points"].as_f64().unwrap())
        .collect();
    assert_eq!(shares.len(), 4);
    assert!(
        shares
            .windows(2)
            .all(|w| 0.0 < w[0] && w[0] <= w[1] && w[1] < 1.0),
        "wider bands hold more: {shares:?}"
    );
    assert!(report["pairs"]["evaluated"].as_u64().unwrap() > 0);
    assert_png(out.join("slices.png"));
    // Neither is made unless it is asked for, nor are pictures.
    let bare = folder.path().join("bare");
    let report = report_of(
        "01_density",
        &[&input, "--spacing", "1", "--no-pictures"],
        &bare,
    );
    assert_eq!(
        report["outputs"],
        serde_json::json!(["density.mrc", "report.json"])
    );
    assert!(report["k_a"].is_null());

    let from_atoms = folder.path().join("surface");
    let direct = report_of("02_surface", &[&input, "--spacing", "1"], &from_atoms);
    for map in ["density.mrc", "density.dx"] {
        let from_map = folder.path().join(map);
        let grid = out.join(map);
        let again = undrawn_report_of(
            "02_surface",
            &[grid.to_str().unwrap(), "--isovalue", "1"],
            &from_map,
        );
        let [a, b] = [&direct, &again].map(|r| r["surface"]["volume"].as_f64().unwrap());
        // The same lattice, trilinear instead of analytic between its points.
        assert!((a / b - 1.0).abs() < 0.05, "{map}: {a} Å³ against {b} Å³");
        assert_eq!(again["surface"]["closed"], true);
    }
}

#[test]
fn stages_say_which_kernels_ran_where() {
    if gpu_or_skip().is_none() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("density");
    let input = fixture("1AJJ.pdb");
    let arguments = [&input, "--spacing", "1", "--backend", "wgpu"];
    let report = report_of("01_density", &arguments, &out);
    let stage = |report: &Value, name: &str| {
        let stages = report["stages"].as_array().unwrap().iter();
        let found = stages.clone().find(|s| s["name"] == name);
        found.unwrap_or_else(|| panic!("no {name}")).clone()
    };
    let density = stage(&report, "density");
    assert!(density["backend"].as_str().unwrap().starts_with("wgpu ("));
    let kernels = density["kernels"].as_object().unwrap();
    let names: Vec<&String> = kernels.keys().collect();
    let [compact, cull, sums] =
        ["compact", "cull", "density"].map(|k| format!("gauss_density_{k}"));
    assert_eq!(names, [&compact, &cull, &sums]);
    let of = |kernel: &str, what: &str| kernels[kernel][what].as_u64().unwrap();
    for name in names {
        assert!(of(name, "calls") > 0 && of(name, "workgroups") >= of(name, "calls"));
    }
    // Atoms go up for the first kernel; bricks of 512 values come down from the last.
    assert!(of(&cull, "bytes_up") > 32 * report["counts"]["kept"].as_u64().unwrap_or(1));
    assert!(of(&compact, "bytes_down") > 0 && of(&compact, "bytes_down") % 2048 == 0);
    // Reading is no kernel's work, nor are eigenfunctions of a surface, whatever was asked for.
    assert_eq!(stage(&report, "reading")["backend"], "cpu");
    assert_eq!(page_of(&out)["report"]["stages"], report["stages"]);
    let out = folder.path().join("modes");
    let arguments = [&fixture("spot.ply"), "--count", "3", "--backend", "wgpu"];
    let report = undrawn_report_of("06_modes", &arguments, &out);
    assert!(report["backend"].as_str().unwrap().starts_with("wgpu ("));
    for stage in report["stages"].as_array().unwrap() {
        assert_eq!(stage["backend"], "cpu", "{stage}");
    }
}

#[test]
fn fewer_atoms_keep_the_surface() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("reduced");
    let input = fixture("1AJJ.pdb");
    let args = [
        &input,
        "--spacing",
        "1",
        "--epsilon",
        "0.05",
        "--residue-power",
        "0.25",
        "--decay",
        "0.5",
    ];
    let report = report_of(
        "05_eliminate",
        &[&args[..], &["--refit", "--hollow"]].concat(),
        &out,
    );
    let table = &report["table"];
    let (all, left) = (
        table["N_A"].as_u64().unwrap(),
        table["N_R"].as_u64().unwrap(),
    );
    assert!(0 < left && left < all, "{left} of {all} atoms remain");
    assert!(report["elimination"]["worst_loss"].as_f64().unwrap() <= 0.05);
    assert!(table["e_G^M after refit"].is_f64());
    let objective = &report["refit"]["objective"];
    assert!(objective[1].as_f64() < objective[0].as_f64());
    assert_png(out.join("error.png"));
    let reduced = io::structure::read(out.join("reduced.pqr"), &Default::default()).unwrap();
    assert_eq!(reduced.structure.atoms().len() as u64, left);
    let lines = std::fs::read_to_string(out.join("reduced.csv")).unwrap();
    assert_eq!(lines.lines().count() as u64, left + 1);

    // Nothing to lose, and what is kept stays.
    let none = undrawn_report_of(
        "05_eliminate",
        &[&input, "--spacing", "1", "--epsilon", "0"],
        &folder.path().join("none"),
    );
    assert_eq!(none["table"]["N_R"], none["table"]["N_A"]);
    let kept = undrawn_report_of(
        "05_eliminate",
        &[&input, "--spacing", "1", "--keep-chains", "A"],
        &folder.path().join("kept"),
    );
    assert_eq!(kept["table"]["N_R"], kept["table"]["protected"]);
    for calm in [none, kept] {
        assert!(calm["advice"].is_null(), "{}", calm["advice"]);
    }
    // Where hardly an atom goes, what wider bounds would do is said; what is shown is what elimination has changed.
    let args = [&input, "--spacing", "1"];
    let usual = undrawn_report_of("05_eliminate", &args, &folder.path().join("usual"));
    let advice = usual["advice"]["warnings"][0].as_str().unwrap();
    assert!(advice.contains("0.2 lets "), "{advice}");
    let change = usual["errors"]["original"]["max"].as_f64().unwrap();
    assert!(0.0 < change && change < 0.02, "{change}");
}

#[test]
fn tetrahedra_inside_and_outside_conform_and_improve() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("tets");
    let input = fixture("1AJJ.pdb");
    let args = [
        &input,
        "--spacing",
        "2",
        "--region",
        "both",
        "--outer",
        "sphere:1.2",
        "--method",
        "lattice",
        "--slab",
        "z:-5:5",
    ];
    let report = report_of("03_tets", &args.map(|a| a as &str), &out);
    assert_eq!(report["volume"]["valid"], true);
    let mesh = tets(out.join("volume.vtu"));
    let mut regions: Vec<_> = mesh.regions().to_vec();
    regions.sort_unstable();
    regions.dedup();
    assert_eq!(regions, [0, 1, 2]);

    let better = folder.path().join("better");
    let input = out.join("volume.msh");
    let report = report_of(
        "04_improve",
        &[input.to_str().unwrap(), "--passes", "3"],
        &better,
    );
    let angle = |when: &str| {
        report["quality"][when]["all"]["min_dihedral"]["min"]
            .as_f64()
            .unwrap()
    };
    assert!(angle("after") >= angle("before"));
    let improved = tets(better.join("improved.vtu"));
    assert!(VolumeAudit::of(&improved).is_valid());
    assert!(
        (improved.volume() / mesh.volume() - 1.0).abs() < 1e-6,
        "the sphere stays"
    );
    let args = [
        input.to_str().unwrap(),
        "--passes",
        "3",
        "--deviation",
        "0.1",
    ];
    let slid = undrawn_report_of("04_improve", &args, &folder.path().join("slid"));
    let fit = &slid["quality"]["surface"];
    assert!(fit["vertices"].as_u64().unwrap() > 100, "{fit}");
    assert!(fit["largest"].as_f64().unwrap() < 0.5, "{fit}");
    assert!(
        slid["quality"]["after"]["all"]["volume"] != report["quality"]["after"]["all"]["volume"]
    );
}

#[test]
fn triangles_become_even() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("even");
    let report = report_of("04_improve", &[&fixture("spot.ply")], &out);
    let angle = |when: &str| report["quality"][when]["min_angle_deg"].as_f64().unwrap();
    assert!(angle("after") > 25.0 && angle("after") > angle("before"));
    assert_eq!(report["surface"]["closed"], true);
    for picture in ["before.png", "improved.png", "quality.png"] {
        assert_png(out.join(picture));
    }
    // What is meant for tetrahedra is refused.
    let input = fixture("spot.ply");
    let wrong = run(
        "04_improve",
        &[&input, "--passes", "3"],
        &folder.path().join("no"),
    );
    assert_eq!(wrong.status.code(), Some(1));
    assert!(!folder.path().join("no").exists());
}

#[test]
fn modes_of_a_mesh_and_of_a_structure() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("spot");
    let report = report_of("06_modes", &[&fixture("spot.ply"), "--count", "6"], &out);
    let values: Vec<f64> = serde_json::from_value(report["eigenvalues"].clone()).unwrap();
    assert_eq!(values.len(), 6);
    assert!(values[0].abs() < 1e-6 * values[1] && values.windows(2).all(|w| w[0] <= w[1]));
    let residuals: Vec<f64> = serde_json::from_value(report["residuals"].clone()).unwrap();
    assert!(residuals.iter().all(|&r| r < 1e-8), "{residuals:?}");
    assert!(out.join("mode_06.glb").exists());
    assert_png(out.join("modes.png"));
    assert_png(out.join("spectrum.png"));

    let out = folder.path().join("protein");
    let report = undrawn_report_of(
        "06_modes",
        &[&fixture("1AJJ.pdb"), "--spacing", "1.5", "--count", "3"],
        &out,
    );
    assert_eq!(report["eigenvalues"].as_array().unwrap().len(), 3);
}

#[test]
fn fields_and_quads_of_a_mesh_and_of_a_structure() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("field");
    let args = [
        &fixture("spot.ply"),
        "--guide",
        "modes:1,2",
        "--mode",
        "hard",
    ];
    let report = report_of("07_field", &args, &out);
    let field = &report["field"];
    assert!(field["guided"].as_u64().unwrap() > 20, "{field}");
    assert_eq!(report["counts"]["singularities"], field["singularities"]);
    assert_png(out.join("field.png"));
    assert!(out.join("field.vtu").exists());
    // The surface, two strokes of two triangles per cross on either side and the balls over it, in one file.
    let triangles = |path: &Path| match io::mesh::read(path).unwrap().mesh {
        AnyMesh::Tri(mesh) => mesh.triangles().len(),
        _ => panic!("{} is no triangle mesh", path.display()),
    };
    let surface = triangles(fixture("spot.ply").as_ref());
    let singularities = report["counts"]["singularities"].as_u64().unwrap() as usize;
    let balls = singularities * shapes::icosphere(1.0, 1).triangles().len();
    assert_eq!(
        triangles(&out.join("field.glb")),
        surface + 8 * surface + balls
    );

    let guided = folder.path().join("guided");
    let args = [
        &fixture("1AJJ.pdb"),
        "--spacing",
        "1.5",
        "--guide",
        "modes:1,2",
    ];
    let report = undrawn_report_of("07_field", &args, &guided);
    assert!(report["counts"]["singularities"].as_u64().unwrap() > 0);

    let out = folder.path().join("quads");
    let args = [&fixture("spot.ply"), "--quads", "1200"];
    let report = report_of("08_quads", &args, &out);
    let jacobian = &report["scaled_jacobian"];
    assert!(jacobian["min"].as_f64().unwrap() > 0.3, "{report}");
    assert!(jacobian["mean"].as_f64().unwrap() > 0.9, "{report}");
    assert_png(out.join("quads.png"));
    assert!(out.join("quads.vtu").exists() && out.join("quads.glb").exists());
    let quads = io::mesh::read(out.join("quads.obj")).unwrap().mesh;
    let AnyMesh::Quad(quads) = quads else {
        panic!("not all faces are quads")
    };
    let count = report["counts"]["quads"].as_u64().unwrap();
    assert_eq!(quads.quads().len() as u64, count);
    assert_eq!(
        report["surface"]["euler_characteristic"],
        quads.euler_characteristic()
    );
}

/// A protein's surface has tunnels that one or two quads would go around: its integers are chosen so that three do, and no
/// lines need to be laid closer.
#[test]
fn quads_go_around_the_tunnels_of_a_protein() {
    let folder = tempfile::tempdir().unwrap();
    let args = [&fixture("1AJJ.pdb"), "--spacing", "1"];
    let report = undrawn_report_of("08_quads", &args, &folder.path().join("quads"));
    let part = &report["parts"][0];
    assert_ne!(part["rung"], "split", "{part}");
    assert_eq!(part["closer"], 0, "{part}");
    assert!(part["map"]["respaced"].as_bool().unwrap(), "{part}");
    assert!(report["counts"]["irregular"].as_u64().unwrap() < 100);
    assert_eq!(report["scaled_jacobian"]["below_0_3"], 0);
}

#[test]
fn quads_are_narrow_where_a_field_is_steep() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("mode");
    let args = [&fixture("spot.ply"), "--quads", "1500"];
    let report = report_of("09_anisotropy", &args, &out);
    let made = &report["anisotropy"];
    let median = |k: usize| made["along_over_across"][k]["median"].as_f64().unwrap();
    // Nearly squares where it is flat, and the narrower the steeper it is.
    assert!(median(0) > 0.75 && median(1) < median(0), "{made}");
    assert!(median(2) < median(1) && median(3) < 0.5, "{made}");
    assert!(made["misalignment"]["percentile_95"].as_f64().unwrap() < 10.0);
    assert!(report["scaled_jacobian"]["min"].as_f64().unwrap() > 0.3);
    let quads = io::mesh::read(out.join("quads.vtu")).unwrap();
    let names: Vec<&str> = quads.cell_fields.iter().map(|f| f.name.as_str()).collect();
    assert_eq!(
        names,
        ["scaled_jacobian", "aspect_ratio", "along_over_across"]
    );
    assert_png(out.join("field.png"));
    assert_png(out.join("quads.png"));
    assert!(out.join("field.glb").exists() && out.join("quads.glb").exists());

    // A field of the mesh by its name, followed exactly, and the distance from a point on it.
    let named = folder.path().join("named");
    let field = out.join("field.vtu");
    let mesh = io::mesh::read(fixture("bob_small.ply"))
        .unwrap()
        .mesh
        .into_triangles();
    let height: Vec<f64> = mesh.positions().iter().map(|p| p.y).collect();
    let view = io::View::from(&mesh)
        .point_field("height", &height)
        .unwrap();
    io::mesh::save(&field, &view).unwrap();
    let field = field.to_string_lossy().into_owned();
    let args = [
        &field, "--field", "height", "--mode", "hard", "--adapt", "--quads", "600", "--ramp",
        "0.1,0.2",
    ];
    let report = undrawn_report_of("09_anisotropy", &args, &named);
    let misalignment = &report["anisotropy"]["misalignment"];
    assert!(
        misalignment["percentile_95"].as_f64().unwrap() < 1e-6,
        "{misalignment}"
    );
    let near = folder.path().join("near");
    let args = [
        &field,
        "--field",
        "distance:0,0,1",
        "--reach",
        "0.3",
        "--no-pictures",
    ];
    let report = report_of("09_anisotropy", &args, &near);
    assert!(report["counts"]["quads"].as_u64().unwrap() > 50);
}

#[test]
fn t_meshes_are_coarse_where_they_may_be() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("curved");
    let args = [
        &fixture("spot.ply"),
        "--quads",
        "4000",
        "--levels",
        "curvature",
    ];
    let report = report_of("10_tmesh", &args, &out);
    let counts = &report["counts"];
    let elements = counts["elements"].as_u64().unwrap();
    assert!(
        elements < 6 * counts["fine_quads"].as_u64().unwrap() / 10,
        "{counts}"
    );
    assert!(counts["t_junctions"].as_u64().unwrap() > 0);
    assert_eq!(report["valid"], true);
    let jacobian = &report["scaled_jacobian"];
    assert!(jacobian["min"].as_f64().unwrap() > 0.45, "{report}");
    assert_png(out.join("tmesh.png"));
    assert!(out.join("tmesh.glb").exists() && out.join("tmesh.obj").exists());
    let view = io::mesh::parse(&std::fs::read(out.join("tmesh.vtu")).unwrap(), "vtu").unwrap();
    assert_eq!(
        view.blocks.iter().map(|b| b.len() as u64).sum::<u64>(),
        elements
    );
    let record: tspline::mesh::Record =
        serde_json::from_slice(&std::fs::read(out.join("tmesh.json")).unwrap()).unwrap();
    let mesh = tspline::TMesh::try_from(record).unwrap();
    assert_eq!(mesh.elements().len() as u64, elements);
}

/// A plate and a fin on it meet in edges of three triangles: they are parted, and both have a rim to keep to.
#[test]
fn t_meshes_of_sheets_that_meet_are_made() {
    let folder = tempfile::tempdir().unwrap();
    let (side, middle) = (10u32, 5u32);
    let mut off = String::new();
    let mut faces = String::new();
    let places = |i: u32, j: u32| (side + 1) * j + i;
    // The fin's lowest row is the plate's middle one.
    let fin = |i: u32, j: u32| match j {
        0 => places(i, middle),
        _ => (side + 1) * (side + j) + i,
    };
    for (j, i) in (0..=side).flat_map(|j| (0..=side).map(move |i| (j, i))) {
        off += &format!("{i} {j} 0\n");
    }
    for (j, i) in (1..=side).flat_map(|j| (0..=side).map(move |i| (j, i))) {
        off += &format!("{i} {middle} {j}\n");
    }
    let mut count = 0;
    let sheets: [&dyn Fn(u32, u32) -> u32; 2] = [&places, &fin];
    for (sheet, j, i) in (0..2).flat_map(|s| (0..side * side).map(move |q| (s, q / side, q % side)))
    {
        let at = |di, dj| sheets[sheet](i + di, j + dj);
        let [a, b, c, d] = [at(0, 0), at(1, 0), at(1, 1), at(0, 1)];
        faces += &format!("3 {a} {b} {c}\n3 {a} {c} {d}\n");
        count += 2;
    }
    let vertices = off.lines().count();
    let input = folder.path().join("sheets.off");
    std::fs::write(&input, format!("OFF\n{vertices} {count} 0\n{off}{faces}")).unwrap();
    let out = folder.path().join("out");
    let args = [input.to_str().unwrap(), "--quads", "200", "--no-pictures"];
    let report = report_of("10_tmesh", &args, &out);
    assert!(
        report["repaired"]["nonmanifold_edges"].as_u64().unwrap() > 0,
        "{report}"
    );
    assert_eq!(report["valid"], true);
    assert!(report["scaled_jacobian"]["min"].as_f64().unwrap() > 0.45);
    // Each sheet keeps to its own rim, of which the line where they meet is a part.
    let report = report_of("11_tspline", &args, &folder.path().join("spline"));
    let error = report["error"]["hausdorff"].as_f64().unwrap();
    assert!(error < 0.05, "{error}");
}

#[test]
fn spline_surfaces_come_near_and_go_into_files() {
    let folder = tempfile::tempdir().unwrap();
    let mesh = fixture("spot.ply");
    let mut errors = Vec::new();
    for (basis, drawn) in [("hierarchical", &[][..]), ("rational", &["--no-pictures"])] {
        let out = folder.path().join(basis);
        let args = [
            &*mesh,
            "--quads=500",
            "--levels=curvature",
            "--basis",
            basis,
            "--files=vtu,step,glb,obj,bext,iga,json",
            "--eigenvalues=4",
            "--modes=3",
            "--operator=lbo",
        ];
        let report = report_of("11_tspline", &[&args, drawn].concat(), &out);
        // The same surface by its Bézier elements; the unit of length is its largest extent.
        let modes: Vec<f64> = serde_json::from_value(report["modes"]["values"].clone()).unwrap();
        let scale = report["modes"]["scale"].as_f64().unwrap();
        for (value, k) in modes.iter().zip(1..) {
            let other = report["eigenvalues"][k].as_f64().unwrap();
            assert!(
                (value / scale.powi(2) / other - 1.0).abs() < 1e-2,
                "{value} {other}"
            );
        }
        assert_eq!(out.join("modes.png").exists(), drawn.is_empty());
        errors.push(report["error"]["hausdorff"].as_f64().unwrap());
        assert!(report["independence"].as_f64().unwrap() > 1e-4, "{report}");
        assert!(report["eigenvalues"][1].as_f64().unwrap() > 0.1);
        assert_eq!(out.join("surface.png").exists(), drawn.is_empty());
        let text = |name: &str| std::fs::read_to_string(out.join(name)).unwrap();
        let patches = report["counts"]["patches"].as_u64().unwrap() as usize;
        let step = text("surface.step");
        assert_eq!(step.matches("ADVANCED_FACE").count(), patches);
        let iga = tspline::files::iga::read(&text("surface.iga")).unwrap();
        let bext = tspline::files::bext::read(&text("surface.bext")).unwrap();
        assert!(iga.nodes == bext.nodes);
        assert_eq!(iga.elements.len(), patches);
        let json: serde_json::Value = serde_json::from_str(&text("surface.json")).unwrap();
        let same: tspline::files::Exchange =
            serde_json::from_value(json["surface"].clone()).unwrap();
        // Serde reads JSON's numbers to the last bit but one.
        let near = |a: &f64, b: &f64| (a - b).abs() <= 1e-15 * a.abs();
        let numbers = same.nodes.iter().flatten().zip(iga.nodes.iter().flatten());
        assert!(same.elements.len() == patches && numbers.into_iter().all(|(a, b)| near(a, b)));
        assert!(text("surface.vtu").contains("RationalWeights"));
        let triangles = io::mesh::read(out.join("surface.obj")).unwrap().mesh;
        assert!(SurfaceAudit::of(&triangles.into_triangles()).is_closed_manifold());
        assert!(text("mass.mtx").starts_with("%%MatrixMarket"));
        assert!(
            std::fs::read(out.join("mass.npz"))
                .unwrap()
                .starts_with(b"PK")
        );
    }
    assert!(errors[0] < 0.1, "{errors:?}");
}

#[test]
fn suitable_t_splines_are_taken_where_they_cost_little() {
    let folder = tempfile::tempdir().unwrap();
    let input = fixture("spot.ply");
    let made = |name: &str, levels: &[&str]| {
        let out = folder.path().join(name);
        let args = [&input, "--basis=suitable", "--files=json", "--no-pictures"];
        report_of("11_tspline", &[&args[..], levels].concat(), &out)
    };
    // Without T-junctions nothing meets.
    let even = made("even", &["--quads=300"]);
    assert_eq!(even["basis"], "Suitable");
    assert!(even["advice"].is_null(), "{}", even["advice"]);
    // Corners of what is fine would make all fine.
    let stepped = made("stepped", &["--quads=4000", "--levels=curvature"]);
    assert_eq!(stepped["basis"], "Hierarchical");
    let said = stepped["advice"]["warnings"][0].as_str().unwrap();
    assert!(said.contains("extensions of T-junctions meet"), "{said}");
    assert!(stepped["counts"]["t_junctions"].as_u64().unwrap() > 0);
    // Nor have open surfaces such a basis.
    let path = folder.path().join("tube.ply");
    let (positions, mut triangles) = shapes::cylinder(2.0, 6.0, 24, 12).into_parts();
    let height = |v: u32| positions[v as usize].z;
    triangles.retain(|&[a, b, c]| height(a) != height(b) || height(b) != height(c));
    let tube = TriMesh::new(positions, triangles).unwrap();
    let (tube, _) = tube.without_unused();
    io::mesh::save(&path, &io::view::View::from(&tube)).unwrap();
    let args = [path.to_str().unwrap(), "--basis=suitable", "--files=json"];
    let open = undrawn_report_of("11_tspline", &args, &folder.path().join("open"));
    assert_eq!(open["basis"], "Hierarchical");
    let said = open["advice"]["warnings"][0].as_str().unwrap();
    assert!(said.contains("needs a closed surface"), "{said}");
}

#[test]
fn modes_are_those_of_the_largest_component() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("two.ply");
    let (mut positions, mut triangles) = shapes::icosphere(1.0, 2).into_parts();
    let large = shapes::icosphere(2.0, 3);
    let first = positions.len() as u32;
    let shift = Vector3::new(10.0, 0.0, 0.0);
    positions.extend(large.positions().iter().map(|p| p + shift));
    triangles.extend(large.triangles().iter().map(|t| t.map(|v| v + first)));
    let both = TriMesh::new(positions, triangles).unwrap();
    io::mesh::save(&path, &io::view::View::from(&both)).unwrap();
    let path = path.to_str().unwrap();
    let args = [path, "--count", "4", "--all-components"];
    let one = report_of("06_modes", &args[..3], &folder.path().join("one"));
    let all = undrawn_report_of("06_modes", &args, &folder.path().join("all"));
    assert_eq!(
        (&one["components"], &all["components"]),
        (&json!(2), &json!(2))
    );
    let values = |report: &Value| -> Vec<f64> {
        serde_json::from_value(report["eigenvalues"].clone()).unwrap()
    };
    // 2 / r² three times, after one zero or two.
    let (one, all) = (values(&one), values(&all));
    assert!(one[0].abs() < 1e-9 && one[1..].iter().all(|v| (v - 0.5).abs() < 0.01));
    assert!(
        all[1].abs() < 1e-9 && (all[2] - 0.5).abs() < 0.01,
        "{all:?}"
    );
}

#[test]
fn a_surface_falls_into_segments() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("parts");
    let report = report_of("15_segment", &[&fixture("spot.ply"), "--groups", "6"], &out);
    let labels = std::fs::read_to_string(out.join("segments.seg")).unwrap();
    let labels: Vec<usize> = labels.lines().map(|l| l.parse().unwrap()).collect();
    assert_eq!(labels.len(), 5856);
    let areas = report["segments"]["areas"].as_array().unwrap();
    assert!(areas.len() >= 2 && labels.iter().all(|&l| l < areas.len()));
    assert_eq!(report["segments"]["groups"], json!(6));
    assert!(out.join("segments.glb").exists());
    assert_png(out.join("segments.png"));
    assert_png(out.join("modes.png"));

    // Inside out it has the same parts, which the last lines say.
    let spot = io::mesh::read(fixture("spot.ply")).unwrap().mesh;
    let (positions, triangles) = spot.into_triangles().into_parts();
    let turned = triangles.into_iter().map(|[a, b, c]| [a, c, b]).collect();
    let turned = TriMesh::new(positions, turned).unwrap();
    let path = folder.path().join("turned.ply");
    io::mesh::save(&path, &io::view::View::from(&turned)).unwrap();
    let out = folder.path().join("turned");
    let args = [path.to_str().unwrap(), "--groups", "6"];
    let report = undrawn_report_of("15_segment", &args, &out);
    let said = report["advice"]["warnings"][0].as_str().unwrap();
    assert!(said.contains("inside out"), "{said}");
    let again = std::fs::read_to_string(out.join("segments.seg")).unwrap();
    let again: Vec<usize> = again.lines().map(|l| l.parse().unwrap()).collect();
    assert_eq!(again, labels);

    // Quads, as the control mesh of a limit surface; every input face has its label.
    let path = folder.path().join("box.obj");
    let quads = shapes::quad_sphere(1.0, 4);
    io::mesh::save(&path, &io::view::View::from(&quads)).unwrap();
    let out = folder.path().join("quads");
    let args = [path.to_str().unwrap(), "--groups", "3", "--operator", "lbo"];
    let report = report_of("15_segment", &args, &out);
    assert_eq!(report["surface"]["element"], json!("catmull-clark"));
    let labels = std::fs::read_to_string(out.join("segments.seg")).unwrap();
    assert_eq!(labels.lines().count(), 96);

    // So has every face of a mesh of triangles and quads.
    let text = std::fs::read_to_string(&path).unwrap();
    let cut = |(i, line): (usize, &str)| match line.split(' ').collect::<Vec<_>>()[..] {
        ["f", a, b, c, d] if i % 3 == 0 => format!("f {a} {b} {c}\nf {a} {c} {d}\n"),
        _ => format!("{line}\n"),
    };
    let mixed: String = text.lines().enumerate().map(cut).collect();
    let faces = mixed.lines().filter(|l| l.starts_with("f ")).count();
    assert_eq!(faces, 96 + 32);
    std::fs::write(&path, mixed).unwrap();
    let out = folder.path().join("mixed");
    let report = report_of("15_segment", &args, &out);
    assert_eq!(report["counts"]["faces"], json!(faces));
    let labels = std::fs::read_to_string(out.join("segments.seg")).unwrap();
    assert_eq!(labels.lines().count(), faces);
}

#[test]
fn the_pocket_of_a_protease_is_where_its_inhibitor_lies() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("pockets");
    let args = [&fixture("1hvr.pdb"), "--spacing", "1.5", "--most", "4"];
    let report = report_of("16_pockets", &args, &out);
    let table = std::fs::read_to_string(out.join("pockets.csv")).unwrap();
    // Fewer rows, but the same.
    let one = folder.path().join("one");
    undrawn_report_of("16_pockets", &[&args[..3], &["--most", "1"]].concat(), &one);
    let shorter = std::fs::read_to_string(one.join("pockets.csv")).unwrap();
    assert_eq!(shorter.lines().nth(1), table.lines().nth(1));
    assert_eq!(shorter.lines().count(), 2);
    let first: Vec<&str> = table.lines().nth(1).unwrap().split(',').collect();
    let center: Vec<f64> = first[2..5].iter().map(|x| x.parse().unwrap()).collect();
    let read = io::structure::read(fixture("1hvr.pdb"), &io::structure::ReadOptions::default());
    let structure = read.unwrap().structure;
    let inhibitor = (0..structure.residues().len())
        .find(|&r| structure.residues()[r].name.as_str() == "XK2")
        .unwrap();
    let away = structure.atoms()[structure.residue_atoms(inhibitor)]
        .iter()
        .map(|a| (a.position.coords - Vector3::from_column_slice(&center)).norm())
        .fold(f64::INFINITY, f64::min);
    assert!(away < 4.0, "{away} Å from the inhibitor");
    assert!(report["pockets"]["candidates"].as_u64().unwrap() >= 1);
    assert!(
        std::fs::read_to_string(out.join("pockets.pdb"))
            .unwrap()
            .contains("PKT P   1")
    );
    assert_png(out.join("pockets.png"));
    // Walls of closed cavities too: some sites are buried.
    let drawn = io::mesh::read(out.join("pockets.glb")).unwrap().mesh;
    let drawn = drawn.into_triangles().triangles().len();
    assert_eq!(json!(drawn), report["counts"]["surface_triangles"]);
    assert!(report["surface"]["parts"].as_u64() > Some(1), "cavities");
}

/// A known ligand is found by its distance and density, and a map by its values; the thesis's method goes through the
/// same files.
#[test]
fn pockets_are_scored_by_a_ligand_and_a_map() {
    let folder = tempfile::tempdir().unwrap();
    // A potential that is the x coordinate, around a part of the molecule.
    let lattice = geom_core::Lattice {
        origin: geom_core::Point3::new(-40.0, -10.0, -10.0),
        spacing: 2.0,
        counts: [60, 30, 40],
    };
    let values = (0..lattice.len()).map(|i| lattice.point(lattice.coordinates(i)).x as f32);
    let map = folder.path().join("x.dx");
    let grid = geom_core::ScalarGrid::new(lattice, values.collect()).unwrap();
    io::grid::save(&map, &grid).unwrap();
    let (out, input) = (folder.path().join("scored"), fixture("1hvr.pdb"));
    let common = [
        "--spacing",
        "1.5",
        "--most",
        "3",
        "--no-pictures",
        "--ligand",
        "name:XK2",
    ];
    let args = [
        &[&*input, "--potential", map.to_str().unwrap()],
        &common[..],
    ]
    .concat();
    let report = report_of("16_pockets", &args, &out);
    assert_eq!(report["ligand"]["rank_within_4_of_an_atom"], 1);
    assert_eq!(report["ligand"]["rank_of_highest_density"], 1);
    let table = std::fs::read_to_string(out.join("pockets.csv")).unwrap();
    let mut lines = table.lines().map(|l| l.split(',').collect::<Vec<_>>());
    let heads = lines.next().unwrap();
    let first = lines.next().unwrap();
    let cell = |name: &str| -> f64 {
        let column = heads.iter().position(|h| *h == name).unwrap();
        first[column].parse().unwrap()
    };
    assert!(cell("ligand_distance") < 4.0 && cell("ligand_density") > 0.01);
    // The mean of x is near the centre's.
    assert!((cell("potential") - cell("center_x")).abs() < 4.0);
    assert!(
        cell("potential_low") < cell("potential") && cell("potential") < cell("potential_high")
    );
    let points = std::fs::read_to_string(out.join("pockets.pdb")).unwrap();
    assert!(points.contains("  O   PKT P   1"));

    let out = folder.path().join("thesis");
    let args = [
        &[&*input, "--method", "thesis", "--groups", "12"],
        &common[..],
    ]
    .concat();
    let report = report_of("16_pockets", &args, &out);
    assert_eq!(report["pockets"]["method"], "thesis");
    let found = report["pockets"]["found"].as_array().unwrap();
    let table = std::fs::read_to_string(out.join("pockets.csv")).unwrap();
    assert_eq!(table.lines().count(), found.len() + 1);
}

#[test]
fn smoothing_keeps_the_volume_that_it_is_told_to_keep() {
    let folder = tempfile::tempdir().unwrap();
    for method in ["ggho", "mean-curvature"] {
        let out = folder.path().join(method);
        let args = [
            &fixture("spot.ply"),
            "--method",
            method,
            "--steps",
            "3",
            "--keep-volume",
        ];
        let report = report_of("17_smooth", &args, &out);
        let volume: Vec<f64> = serde_json::from_value(report["flow"]["volume"].clone()).unwrap();
        assert!((volume[1] / volume[0] - 1.0).abs() < 1e-3, "{volume:?}");
        assert!(report["flow"]["rms_displacement"].as_f64().unwrap() > 0.0);
        assert_png(out.join("smooth.png"));
    }
    for (method, option) in [
        ("bilateral", ["--range", "0.4"]),
        ("total-variation", ["--fidelity", "5"]),
    ] {
        let out = folder.path().join(method);
        let input = fixture("bob_small.ply");
        let args = [&[&*input, "--method", method], &option[..]].concat();
        let report = undrawn_report_of("17_smooth", &args, &out);
        assert!(report["flow"]["rms_displacement"].as_f64().unwrap() > 0.0);
        assert!(out.join("smooth.ply").exists());
    }
}

/// What a mesh says of its vertices and faces outlasts smoothing, on triangles and on quads.
#[test]
fn smoothing_keeps_fields_and_groups() {
    let folder = tempfile::tempdir().unwrap();
    let quads = shapes::quad_sphere(1.0, 4);
    let triangles = quads.clone().into_triangles();
    for (name, view) in [
        ("quads", io::view::View::from(&quads)),
        ("triangles", io::view::View::from(&triangles)),
    ] {
        let cells = view.cells();
        let height: Vec<f64> = view.points.iter().map(|p| p.z).collect();
        let label: Vec<i32> = (0..cells as i32).collect();
        let view = view.point_field("height", &height).unwrap();
        let mut view = view.cell_field("label", &label).unwrap();
        let group = |name: &str| io::view::Group {
            name: name.to_owned(),
            dimension: 2,
            tag: None,
        };
        view.groups = vec![group("inlet"), group("wall")];
        view.group_of = (0..cells as u32).map(|c| u32::from(c > 9)).collect();
        let (path, out) = (folder.path().join("labelled.vtu"), folder.path().join(name));
        io::mesh::save(&path, &view).unwrap();
        undrawn_report_of("17_smooth", &[path.to_str().unwrap()], &out);
        let [before, after] = [&path, &out.join("smooth.vtu")].map(|p| io::vtu::read(p).unwrap());
        assert_eq!(before.blocks, after.blocks);
        assert_ne!(before.points, after.points);
        assert_eq!(before.point_fields, after.point_fields);
        assert_eq!(before.cell_fields, after.cell_fields);
        assert_eq!(
            (&before.groups, &before.group_of),
            (&after.groups, &after.group_of)
        );
        assert!(after.find_cell_field("label").is_some() && after.groups.len() == 2);
    }
    let ply = io::mesh::read(folder.path().join("triangles/smooth.ply")).unwrap();
    let names = |fields: &[io::view::Field<'_>]| -> Vec<String> {
        fields.iter().map(|f| f.name.to_string()).collect()
    };
    assert!(names(&ply.point_fields).contains(&"height".to_owned()));
    assert!(names(&ply.cell_fields).contains(&"label".to_owned()));
}

/// What is not as asked for is said in the last lines, not in the report alone.
#[test]
fn quads_without_a_field_and_modes_that_are_inexact_are_warned_of() {
    let folder = tempfile::tempdir().unwrap();
    let said = |name: &str, args: &[&str]| {
        let out = folder.path().join(name);
        let output = run(name, &[args, &["--no-pictures"]].concat(), &out);
        let text = String::from_utf8([output.stdout, output.stderr].concat()).unwrap();
        (output.status.success(), text)
    };
    // A fin on a sphere: an edge of three triangles.
    let (mut positions, mut triangles) = shapes::icosphere(1.0, 3).into_parts();
    let [a, b, _] = triangles[0];
    positions.push(geom_core::Point3::new(0.0, 0.0, 2.0));
    triangles.push([a, b, positions.len() as u32 - 1]);
    let fin = geom_core::TriMesh::new(positions, triangles).unwrap();
    let path = folder.path().join("fin.ply");
    io::mesh::save(&path, &io::view::View::from(&fin)).unwrap();
    let path = path.to_str().unwrap().to_owned();
    let (done, text) = said("08_quads", &[&path, "--quads", "100"]);
    assert!(
        done && text.contains("warning: the surface had to be repaired: "),
        "{text}"
    );
    let (done, text) = said("06_modes", &[&fixture("spot.ply"), "--tolerance", "1e-17"]);
    assert!(
        done && text.contains("warning: the eigenpairs have not reached --tolerance"),
        "{text}"
    );
    let tiny = folder.path().join("tiny.off");
    let octahedron = shapes::icosphere(1.0, 0);
    io::mesh::save(&tiny, &io::view::View::from(&octahedron)).unwrap();
    let (done, text) = said("15_segment", &[tiny.to_str().unwrap()]);
    assert!(
        !done && text.contains("tiny.off: --operator parts takes 15 modes"),
        "{text}"
    );
}

#[test]
fn tiles_are_one_mesh_however_many_there_are() {
    let folder = tempfile::tempdir().unwrap();
    let input = fixture("1AJJ.pdb");
    let (mut found, mut least) = (Vec::new(), Vec::new());
    for (i, ways) in [
        &["--tiles", "1"][..],
        &["--tiles", "3", "--exchange", "threads", "--ranks", "2"],
        &["--tiles", "1", "--improve"],
        &["--tiles", "3", "--improve"],
        &[
            "--tiles",
            "3",
            "--improve",
            "--exchange",
            "threads",
            "--ranks",
            "2",
        ],
    ]
    .into_iter()
    .enumerate()
    {
        let out = folder.path().join(i.to_string());
        // One tile is drawn, as it is and improved.
        let drawn = ["--renderer", "cpu"];
        let drawn = if i % 2 == 0 && i < 3 {
            &drawn[..]
        } else {
            &["--no-pictures"]
        };
        let args = [&[&*input, "--spacing", "1.3", "--quiet"], drawn, ways].concat();
        let output = run("20_tiles", &args, &out);
        let errors = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success(), "{ways:?}: {errors}");
        let report: Value =
            serde_json::from_slice(&std::fs::read(out.join("report.json")).unwrap()).unwrap();
        assert_eq!(report["volume"]["valid"], true, "{ways:?}");
        assert_eq!(report["surface"]["closed"], true, "{ways:?}");
        let [bodies, cavities] =
            ["bodies", "cavities"].map(|k| report["tiles"][k].as_u64().unwrap());
        assert_eq!(report["surface"]["parts"], bodies + cavities);
        if ways.contains(&"--improve") {
            least.push(report["tiles"]["min_dihedral"].as_f64().unwrap());
            // No walls of different tiles have come through each other.
            let surface = geom_core::io::mesh::read(out.join("surface.ply")).unwrap();
            let surface = surface.mesh.into_triangles();
            assert_eq!(
                geom_core::search::crossing::crossing_pairs(&surface),
                [[0; 2]; 0]
            );
        }
        let joined = std::fs::read_to_string(out.join("volume.pvtu")).unwrap();
        for name in ["molecule|exterior", "atom", "residue", "chain", "group"] {
            assert!(joined.contains(&format!("Name=\"{name}\"")), "{name}");
        }
        let tiles = report["options"]["tiles"].as_u64().unwrap();
        for tile in 0..tiles {
            let part = format!("parts/part_{tile}.vtu");
            assert!(joined.contains(&part) && out.join(part).exists());
        }
        // Labels and names are those of the whole, in both kinds of parts.
        let whole = geom_core::io::vtu::read(out.join("volume.vtu")).unwrap();
        let atoms = whole.find_point_field("atom").unwrap().values.to_f64();
        let mut faces = 0;
        for tile in 0..tiles {
            let part = geom_core::io::vtu::read(out.join(format!("parts/part_{tile}.vtu")));
            let msh = geom_core::io::msh::read(out.join(format!("parts/volume_{}.msh", tile + 1)));
            let (part, msh) = (part.unwrap(), msh.unwrap());
            let ids = part
                .find_point_field("GlobalNodeIds")
                .unwrap()
                .values
                .to_f64();
            let labels = part.find_point_field("atom").unwrap().values.to_f64();
            for (id, label) in ids.iter().zip(&labels) {
                assert_eq!(*label, atoms[*id as usize], "{ways:?}, {tile}, {id}");
            }
            assert_eq!(
                (msh.points.len(), msh.cells()),
                (part.points.len(), part.cells())
            );
            let named = |view: &geom_core::io::View<'_>| {
                let at = view
                    .groups
                    .iter()
                    .position(|g| g.name == "molecule|exterior");
                let of = view.group_of.iter();
                at.map_or(0, |at| of.filter(|&&g| g as usize == at).count())
            };
            assert_eq!(named(&part), named(&msh), "{ways:?}, {tile}");
            faces += named(&part) as u64;
        }
        assert_eq!(report["tiles"]["triangles"], faces);
        let used = report["tiles"]["ranks"].as_array().unwrap();
        let of = |rank: &Value, key: &str| rank[key].as_u64().unwrap();
        assert_eq!(used.iter().map(|r| of(r, "tiles")).sum::<u64>(), tiles);
        assert!(used.iter().all(|r| of(r, "spilled_bytes") > 0));
        // Alone, nobody hears anything.
        assert!(
            used.iter()
                .all(|r| (of(r, "sent_bytes") > 0) == (used.len() > 1))
        );
        found.push(report["tiles"]["digest"].clone());
    }
    assert!(found.iter().all(|digest| *digest == found[0]), "{found:?}");
    // Improved, no worse than in one piece by more than 1°, and the same by any ranks.
    assert!(
        least
            .iter()
            .all(|angle| *angle > least[0] - 1.0 && *angle > 24.0),
        "{least:?}"
    );
    for tile in 0..3 {
        for part in [
            format!("part_{tile}.vtu"),
            format!("volume_{}.msh", tile + 1),
        ] {
            let [alone, ranks] = ["3", "4"].map(|run| {
                std::fs::read(folder.path().join(run).join("parts").join(&part)).unwrap()
            });
            assert!(alone == ranks, "{part}");
        }
    }
    // Too little memory is said before anything is allocated, and leaves nothing.
    let out = folder.path().join("little");
    let args = [
        &*input,
        "--spacing",
        "0.3",
        "--tiles",
        "1",
        "--max-memory",
        "1M",
    ];
    let output = run("20_tiles", &args, &out);
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(
        !output.status.success() && errors.contains("take more tiles"),
        "{errors}"
    );
    assert!(!out.exists());
}

/// A tube with closed ends, a rod and a cavity that go through all tiles, and stay what they are when they are improved.
#[test]
fn a_tube_through_all_tiles_keeps_its_cavity() {
    let folder = tempfile::tempdir().unwrap();
    let mut file = String::new();
    for ring in 0..48 {
        let ends = [0, 47].contains(&ring);
        for radius in [9.0, 7.4, 5.8, 4.2, 2.6, 1.0] {
            if radius < 9.0 && !ends {
                continue;
            }
            let count = (std::f64::consts::TAU * radius / 1.6) as u32;
            for k in 0..count.max(1) {
                let angle = std::f64::consts::TAU * f64::from(k) / f64::from(count.max(1));
                let (x, y) = (radius * angle.cos(), radius * angle.sin());
                let z = 1.6 * f64::from(ring);
                file += &format!(
                    "ATOM      1  C   ALA A   1    {x:8.3} {y:8.3} {z:8.3}  0.000 1.900\n"
                );
            }
        }
    }
    let input = folder.path().join("tube.pqr");
    std::fs::write(&input, file).unwrap();
    for method in ["stuffing", "dual-contour"] {
        let out = folder.path().join(method);
        let args = [
            input.to_str().unwrap(),
            "--spacing=1.3",
            "--tiles=5",
            "--improve",
            "--no-pictures",
            "--method",
            method,
        ];
        let output = run("20_tiles", &args, &out);
        let errors = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success(), "{errors}");
        let report = std::fs::read(out.join("report.json")).unwrap();
        let report: Value = serde_json::from_slice(&report).unwrap();
        let tiles = &report["tiles"];
        assert!(tiles["filled"].as_u64().unwrap() > 2, "{tiles}");
        assert_eq!([&tiles["bodies"], &tiles["cavities"]], [1, 1], "{method}");
        assert!(tiles["min_dihedral"].as_f64().unwrap() > 24.0, "{tiles}");
        assert_eq!(report["volume"]["valid"], true);
        assert_eq!(report["surface"]["closed"], true);
    }
}

#[test]
fn tiles_of_dual_contouring_are_one_mesh_too() {
    let folder = tempfile::tempdir().unwrap();
    let input = fixture("1AJJ.pdb");
    let made = |tiles: &str| {
        let out = folder.path().join(tiles);
        let ways = ["--method", "dual-contour", "--improve", "--no-pictures"];
        let args = [&[&*input, "--spacing", "1.3", "--tiles", tiles], &ways[..]].concat();
        let output = run("20_tiles", &args, &out);
        let errors = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success(), "{errors}");
        let report = std::fs::read(out.join("report.json")).unwrap();
        serde_json::from_slice::<Value>(&report).unwrap()
    };
    let [alone, three] = ["1", "3"].map(made);
    // Near to the density's own surface, though only its values on the lattice are asked for.
    let whole = undrawn_report_of(
        "02_surface",
        &[&input, "--spacing", "0.5"],
        &folder.path().join("whole"),
    );
    let volumes = [&alone["tiles"]["volume"], &whole["surface"]["volume"]];
    let volumes = volumes.map(|v| v.as_f64().unwrap());
    assert!((volumes[0] / volumes[1] - 1.0).abs() < 0.02, "{volumes:?}");
    assert_eq!(alone["tiles"]["digest"], three["tiles"]["digest"]);
    for report in [&alone, &three] {
        assert_eq!(report["volume"]["valid"], true);
        assert_eq!(report["surface"]["closed"], true);
        let least = report["tiles"]["min_dihedral"].as_f64().unwrap();
        assert!(least > 24.0, "{least}");
    }
}

#[test]
fn a_shape_is_morphed_into_itself_and_does_not_differ_from_it() {
    let folder = tempfile::tempdir().unwrap();
    let input = fixture("1AJJ.pdb");
    // Equal histograms find each node again: nothing is left to refine.
    let found = [
        "--spacing",
        "2",
        "--start",
        "thesis",
        "--refine",
        "none",
        "--forward-only",
    ];
    let out = folder.path().join("compared");
    let args = [&[&*input, &*input, "--truth-atoms"], &found[..]].concat();
    let report = report_of("14_compare", &args, &out);
    assert_eq!(report["correspondence"]["verdict"], "good");
    assert_eq!(report["comparison"]["coverage"], 1.0);
    assert!(report["comparison"]["distortions"]["max"].as_f64().unwrap() < 1e-3);
    assert!(report["truth"]["mean"].as_f64().unwrap() < 1e-6);
    assert_png(out.join("compare.png"));
    let out = folder.path().join("partners");
    let args = [&[&*input, &*input, "--modes", "2"], &found[..]].concat();
    let report = report_of("12_correspond", &args, &out);
    let table = std::fs::read_to_string(out.join("matches.csv")).unwrap();
    assert_eq!(
        table.lines().count() as u64,
        1 + report["first"]["boundary"].as_u64().unwrap()
    );
    let row: Vec<f64> = table
        .lines()
        .nth(1)
        .unwrap()
        .split(',')
        .map(|n| n.parse().unwrap())
        .collect();
    assert!(row[..3] == row[3..6] && row[6] < 1e-3, "{row:?}");
    assert_png(out.join("correspond.png"));
    assert_png(out.join("modes.png"));
    assert!(out.join("first.glb").exists() && out.join("second.glb").exists());
    let mut outputs = Vec::new();
    for (threads, drawn) in [("1", &[][..]), ("3", &["--no-pictures"])] {
        let out = folder.path().join(threads);
        let frames = [&*input; 3].join(",");
        let args = [
            &[
                &*input,
                &*input,
                "--times=0,0.4,1.2",
                "--truth-frames",
                &frames,
            ][..],
            &["--threads", threads],
            drawn,
            &found,
        ];
        let report = report_of("13_deform", &args.concat(), &out);
        for frame in report["frames"].as_array().unwrap() {
            assert!((frame["largest_stretch"].as_f64().unwrap() - 1.0).abs() < 1e-3);
            assert_eq!(frame["volume"], report["first"]["volume"]);
            assert!(frame["truth"]["epsilon"].as_f64().unwrap() < 0.05);
            assert!(frame["atoms_rmsd"].as_f64().unwrap() < 0.01);
        }
        let mut files = contents(&out);
        for picture in ["frames.png", "index.html"] {
            assert!(files.remove(picture).is_some() == drawn.is_empty());
        }
        files.remove("report.json");
        outputs.push(files);
    }
    assert!(outputs[0].len() == 8 && outputs[0] == outputs[1]);
    let args = [&*input, &*input, "--truth-frames", &*input];
    let refused = run("13_deform", &args, &folder.path().join("refused"));
    let says = String::from_utf8_lossy(&refused.stderr).into_owned();
    assert!(says.contains("1 --truth-frames for 4 --times"), "{says}");
}

/// Names of files are bytes; a report has what can be read of them.
#[cfg(target_os = "linux")]
#[test]
fn a_name_that_is_not_utf8_is_a_name() {
    use std::ffi::OsStr;
    use std::os::unix::ffi::OsStrExt;

    let folder = tempfile::tempdir().unwrap();
    let name = folder.path().join(OsStr::from_bytes(b"caf\xe9.pdb"));
    std::fs::write(&name, ATOM).unwrap();
    let out = folder.path().join(OsStr::from_bytes(b"out\xe9"));
    let mut density = program("01_density");
    density.arg(&name).args(["--quiet", "--no-pictures"]);
    let output = density.arg("--out").arg(&out).output().unwrap();
    assert!(
        output.status.success(),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
    let report = std::fs::read(out.join("report.json")).unwrap();
    let report: Value = serde_json::from_slice(&report).unwrap();
    let file = report["input"][0]["file"].as_str().unwrap();
    assert!(file.ends_with("caf\u{fffd}.pdb"), "{file}");
}

const ATOM: &str =
    "ATOM      1  CA  ALA A   1       0.000   0.000   0.000  1.00  0.00           C\n";

/// A gzip file may hold a thousand times its size: `--max-memory` bounds reading, too.
#[test]
fn what_unpacks_beyond_the_memory_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let packed = folder.path().join("long.pdb.gz");
    io::save(&packed, |w| {
        (0..200_000).try_for_each(|_| Ok(w.write_all(ATOM.as_bytes())?))
    })
    .unwrap();
    assert!(std::fs::metadata(&packed).unwrap().len() < 200_000);
    let args = [packed.to_str().unwrap(), "--max-memory", "10M"];
    let output = run("01_density", &args, &folder.path().join("out"));
    let errors = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{errors}");
    assert!(
        errors.contains("unpack to more than 10485760 bytes"),
        "{errors}"
    );
}

/// The folder of a run that was killed goes with the next run, that of a living one stays.
#[test]
fn many_inputs_each_have_their_folder_and_their_line() {
    let folder = tempfile::tempdir().unwrap();
    let (inputs, out) = (folder.path().join("in"), folder.path().join("out"));
    std::fs::create_dir_all(inputs.join("ab")).unwrap();
    for file in ["one.pdb", "two.pdb", "ab/three.pdb"] {
        std::fs::write(inputs.join(file), ATOM).unwrap();
    }
    std::fs::write(inputs.join("bad.pdb"), "ATOM nonsense\n").unwrap();
    std::fs::write(inputs.join("notes.txt"), "no structure").unwrap();
    let call = |more: &[&str]| {
        let args = [&[inputs.to_str().unwrap(), "--no-pictures"], more].concat();
        let output = run("02_surface", &args, &out);
        let said = [output.stdout, output.stderr].concat();
        (output.status.code(), String::from_utf8(said).unwrap())
    };
    let lines = |file: &str| -> Vec<Value> {
        let text = std::fs::read_to_string(out.join(file)).unwrap();
        text.lines()
            .map(|l| serde_json::from_str(l).unwrap())
            .collect()
    };

    // The first of two shards; its names in order: ab/three, bad, one, two.
    let (code, said) = call(&["--shard", "1/2"]);
    assert_eq!(code, Some(0), "{said}");
    let first = lines("results-1-of-2.jsonl");
    assert_eq!(first[0]["program"], "02_surface");
    let outcomes: Vec<_> = first[1..]
        .iter()
        .map(|l| (&l["name"], &l["outcome"]))
        .collect();
    let (begun, done) = (json!("begun"), json!("done"));
    let [three, one] = ["ab/three", "one"].map(|n| json!(n));
    assert_eq!(
        outcomes,
        [
            (&three, &begun),
            (&three, &done),
            (&one, &begun),
            (&one, &done)
        ]
    );
    assert!(first[2]["counts"]["surface_triangles"].as_u64().unwrap() > 100);
    assert!(out.join("ab/three/surface.ply").exists());

    // All: what is done stays, the bad one does not stop the others, and is not tried twice.
    for tried in [2, 0] {
        let (code, said) = call(&[]);
        assert_eq!(code, Some(3), "{said}");
        assert!(
            said.contains(&format!("{} done before", 4 - 1 - tried / 2)),
            "{said}"
        );
        assert!(said.contains("bad: ") && said.contains("line 1"), "{said}");
    }
    assert_eq!(lines("results.jsonl").len(), 1 + 2 + 2);
    assert!(out.join("two/surface.ply").exists() && !out.join("bad").exists());
    // Mended, and tried again; an input within which a run was killed counts as refused until then.
    std::fs::write(inputs.join("bad.pdb"), ATOM).unwrap();
    let killed = json!({"name": "one", "input": "one.pdb", "outcome": "begun"});
    let all = out.join("results.jsonl");
    let text = std::fs::read_to_string(&all).unwrap();
    std::fs::write(&all, format!("{text}{killed}\n")).unwrap();
    let (code, said) = call(&[]);
    assert!(
        code == Some(3) && said.contains("one: the run ended within this input"),
        "{said}"
    );
    let (code, said) = call(&["--retry"]);
    assert_eq!(code, Some(0), "{said}");

    // Other options need another folder.
    let (code, said) = call(&["--decay", "0.4"]);
    assert!(code == Some(1) && said.contains("other options"), "{said}");
    let output = run(
        "02_surface",
        &[inputs.join("one.pdb").to_str().unwrap(), "--retry"],
        &out,
    );
    assert_eq!(output.status.code(), Some(1));
}

#[test]
fn what_killed_runs_left_is_cleared() {
    let folder = tempfile::tempdir().unwrap();
    let input = folder.path().join("a.pdb");
    std::fs::write(&input, ATOM).unwrap();
    let out = folder.path().join("out");
    let [dead, alive] = ["dead", "alive"].map(|name| {
        let folder = out.join(format!(".unfinished-{name}"));
        std::fs::create_dir_all(&folder).unwrap();
        std::fs::write(folder.join("half.vtu"), "<").unwrap();
        let file = std::fs::File::create(folder.join(".alive")).unwrap();
        (folder, file)
    });
    alive.1.lock().unwrap();
    let output = run(
        "01_density",
        &[input.to_str().unwrap(), "--no-pictures"],
        &out,
    );
    assert!(output.status.success());
    assert!(!dead.0.exists() && alive.0.join("half.vtu").exists());
    let left = std::fs::read_dir(&out).unwrap().flatten();
    let hidden = left.filter(|e| e.file_name().as_encoded_bytes().starts_with(b"."));
    assert_eq!(hidden.count(), 1);
}

/// As the ranks of a job do: whoever makes the folder and has nothing for it takes it away, and the others go on.
#[test]
fn runs_that_begin_together_make_one_folder() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("a").join("b");
    let absent = folder.path().join("absent.pdb");
    let together: Vec<_> = (0..100)
        .map(|_| {
            let mut command = program("01_density");
            command.arg(&absent).arg("--quiet").arg("--out").arg(&out);
            let child = command.stderr(std::process::Stdio::piped()).spawn();
            child.expect("the program starts")
        })
        .collect();
    for child in together {
        let output = child.wait_with_output().unwrap();
        let said = String::from_utf8_lossy(&output.stderr);
        assert!(said.contains("absent.pdb"), "{said}");
    }
}

/// Ctrl-C and the end of a terminal end the work, and the exit code says which.
#[cfg(target_os = "linux")]
#[test]
fn a_signal_ends_the_work_and_leaves_nothing() {
    let folder = tempfile::tempdir().unwrap();
    for (signal, code) in [("HUP", 129), ("INT", 130), ("TERM", 143)] {
        let out = folder.path().join(signal);
        let mut command = program("00_pipeline");
        command
            .arg(fixture("1AJJ.pdb"))
            .args(["--spacing", "0.4", "--quiet", "--no-pictures"]);
        let child = command
            .arg("--out")
            .arg(&out)
            .stderr(std::process::Stdio::piped());
        let child = child.spawn().unwrap();
        // When it listens: the mask of the signals that it handles has the bit of SIGTERM, the last one.
        let listens = || {
            let status = std::fs::read_to_string(format!("/proc/{}/status", child.id())).unwrap();
            let mask = status
                .lines()
                .find_map(|l| l.strip_prefix("SigCgt:"))
                .unwrap();
            let mask = u64::from_str_radix(mask.trim(), 16).unwrap();
            [1, 2, 15].iter().all(|s| mask >> (s - 1) & 1 == 1)
        };
        while !listens() {
            std::thread::sleep(std::time::Duration::from_millis(5));
        }
        let number = format!("-{signal}");
        assert!(
            Command::new("kill")
                .args([&number, &child.id().to_string()])
                .status()
                .unwrap()
                .success()
        );
        let output = child.wait_with_output().unwrap();
        let errors = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(code), "{signal}: {errors}");
        assert!(!out.exists(), "{signal}");
    }
}

/// What a user should know stands at the end, without looking into the report.
#[test]
fn the_last_lines_say_what_matters() {
    let folder = tempfile::tempdir().unwrap();
    let input = folder.path().join("a.pqr");
    let atoms = "ATOM 1 C  ALA 1 0.0 0.0 0.0 0.1 1.7\nATOM 2 H  ALA 1 1.0 0.0 0.0 0.1 0.0\n";
    std::fs::write(&input, atoms).unwrap();
    let args = [input.to_str().unwrap(), "--no-pictures"];
    let output = run("00_pipeline", &args, &folder.path().join("out"));
    let text = String::from_utf8(output.stdout).unwrap();
    assert!(
        output.status.success(),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
    let lines: Vec<&str> = text.lines().collect();
    assert_eq!(lines[0], "2 atoms");
    assert!(
        lines[1].contains(" tetrahedra, ") && lines[1].contains("dihedral angles from "),
        "{text}"
    );
    assert!(
        lines[2].starts_with("warning: 1 atoms have radius 0"),
        "{text}"
    );
    assert!(lines.last().unwrap().contains(" files in "), "{text}");
}

#[test]
fn bad_input_is_one_line_and_leaves_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let file = |name: &str, content: &str| {
        let path = folder.path().join(name);
        std::fs::write(&path, content).unwrap();
        path.to_str().unwrap().to_owned()
    };
    let good = fixture("1AJJ.pdb");
    let empty = file("empty.pdb", "");
    let wrong = file("wrong.pdb", "This is a letter, not a structure.\n");
    let nan = file(
        "nan.pdb",
        "ATOM      1  CA  ALA A   1         NaN   0.000   0.000  1.00  0.00           C\n",
    );
    // Cut in the middle of a coordinate.
    let whole = std::fs::read_to_string(&good).unwrap();
    let atom = whole.rfind("\nATOM").unwrap() + 1;
    let cut = file("cut.pdb", &whole[..atom + 35]);
    let cut_line = format!("cut.pdb: line {}", whole[..atom].lines().count() + 1);
    let cif = std::fs::read_to_string(fixture("1A8O.cif")).unwrap();
    let cut_cif = file("cut.cif", &cif[..cif.rfind("\nATOM").unwrap() + 40]);
    let cut_gz = folder.path().join("cut.pdb.gz");
    io::save(&cut_gz, |w| Ok(w.write_all(whole.as_bytes())?)).unwrap();
    let packed = std::fs::read(&cut_gz).unwrap();
    std::fs::write(&cut_gz, &packed[..packed.len() / 2]).unwrap();
    let no_grid = file("a.mrc", "MAP?");
    let no_mesh = file("a.ply", "ply\nformat ascii 1.0\nelement vertex 3\n");
    let tetrahedron = file(
        "four.off",
        "OFF\n4 4 0\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n3 0 2 1\n3 0 1 3\n3 1 2 3\n3 2 0 3\n",
    );
    let cases: &[(&str, &[&str], &str)] = &[
        ("00_pipeline", &["absent.pdb"], "absent.pdb"),
        ("07_field", &["absent.ply"], "absent.ply"),
        ("08_quads", &[&no_mesh], "a.ply"),
        ("00_pipeline", &[&empty], "empty.pdb"),
        ("00_pipeline", &[&wrong], "wrong.pdb"),
        ("01_density", &[&nan], "line 1"),
        ("00_pipeline", &[&cut], &cut_line),
        ("00_pipeline", &[&cut_cif], "cut.cif"),
        (
            "00_pipeline",
            &[cut_gz.to_str().unwrap()],
            "cut.pdb.gz: the file ends in the middle of gzip data",
        ),
        ("00_pipeline", &[&good, "--select", "name:XYZ"], "atoms"),
        ("00_pipeline", &[&good, "--assembly", "99"], "99"),
        ("00_pipeline", &[&good, "--spacing", "-1"], "spacing"),
        (
            "01_density",
            &[&good, "--spacing", "0.001", "--max-memory", "100M"],
            "the limit is",
        ),
        ("02_surface", &[&no_grid, "--isovalue", "1"], "a.mrc"),
        (
            "03_tets",
            &[
                &good,
                "--spacing",
                "2",
                "--region",
                "both",
                "--outer",
                "box:0.5",
            ],
            "outer",
        ),
        ("03_tets", &[&good, "--cell", "0"], "error: --cell is 0"),
        ("04_improve", &[&no_mesh], "a.ply"),
        ("06_modes", &[&no_mesh], "a.ply"),
        (
            "06_modes",
            &[&tetrahedron, "--count", "5"],
            "has 4 eigenpairs",
        ),
    ];
    for (name, args, says) in cases {
        let out = folder.path().join("out/deep");
        let output = run(name, args, &out);
        let errors = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(1), "{name} {args:?}: {errors}");
        let lines: Vec<_> = errors.lines().collect();
        assert_eq!(lines.len(), 1, "{name} {args:?}: {errors}");
        assert!(
            errors.starts_with("error: ") && errors.contains(says),
            "{name} {args:?}: {errors}"
        );
        assert!(
            !folder.path().join("out").exists(),
            "{name} {args:?} leaves something"
        );
    }
    // Wrong options never start.
    for (name, args) in [
        ("00_pipeline", &["--region", "inside"][..]),
        ("00_pipeline", &["--threads", "0"]),
        ("00_pipeline", &["--max-memory", "much"]),
        ("03_tets", &["--zone", "0,0,0:0:0.1"]),
        ("10_tmesh", &["--levels", "chain:A=1,A=2"]),
    ] {
        let output = run(
            name,
            &[&[good.as_str()], args].concat(),
            &folder.path().join("out"),
        );
        assert_eq!(output.status.code(), Some(2), "{args:?}");
        assert!(!folder.path().join("out").exists());
    }
}

/// What would do nothing is refused, by its name.
#[test]
fn options_without_effect_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let lattice = geom_core::Lattice {
        origin: geom_core::Point3::origin(),
        spacing: 1.0,
        counts: [8, 8, 8],
    };
    let ball = |i| {
        4.5 - (lattice
            .point(lattice.coordinates(i))
            .coords
            .add_scalar(-3.5))
        .norm()
    };
    let values = (0..lattice.len()).map(|i| ball(i) as f32).collect();
    let grid = geom_core::ScalarGrid::new(lattice, values).unwrap();
    let map = folder.path().join("ball.mrc");
    io::grid::save(&map, &grid).unwrap();
    let (map, mesh, atoms) = (
        map.to_str().unwrap().to_owned(),
        fixture("spot.ply"),
        fixture("1AJJ.pdb"),
    );
    let cases: &[(&str, &[&str], &str)] = &[
        (
            "02_surface",
            &[&map, "--isovalue", "1", "--waters"],
            "--waters is for structures",
        ),
        (
            "03_tets",
            &[&map, "--isovalue", "1", "--decay", "1"],
            "--decay is for structures",
        ),
        (
            "06_modes",
            &[&mesh, "--residue-power", "1"],
            "--residue-power is for structures",
        ),
        (
            "06_modes",
            &[&mesh, "--isovalue", "1"],
            "--isovalue is for grids",
        ),
        ("02_surface", &[&atoms, "--isovalue", "1"], "--isovalue"),
        (
            "02_surface",
            &[&atoms, "--error-norm", "max"],
            "--error-norm needs --tolerance",
        ),
        (
            "02_surface",
            &[&map, "--isovalue", "1", "--finer", "A=0"],
            "--finer names atoms",
        ),
        (
            "00_pipeline",
            &[&atoms, "--region", "both", "--keep-apart"],
            "--keep-apart is for",
        ),
        (
            "00_pipeline",
            &[&atoms, "--stages", "density", "--prune", "5"],
            "--prune is for stages that mesh",
        ),
        (
            "00_pipeline",
            &[&atoms, "--stages", "pockets", "--color", "element"],
            "--color is for --stages surface and tets",
        ),
        ("00_pipeline", &[&mesh], "04_improve, 06 to 15"),
        ("07_field", &[&mesh, "--mode", "hard"], "--mode says how"),
        (
            "15_segment",
            &[&mesh, "--operator", "lbo", "--normal-rounds", "5"],
            "--normal-rounds changes nothing",
        ),
        ("15_segment", &[&mesh, "--detail=-0.1"], "--detail is -0.1"),
        (
            "12_correspond",
            &[&mesh, &mesh, "--truth-atoms"],
            "only structures know",
        ),
        ("10_tmesh", &[&atoms, "--levels", "height"], "it has none"),
        (
            "09_anisotropy",
            &[&mesh, "--reach", "2"],
            "--reach is for --field distance",
        ),
        (
            "09_anisotropy",
            &[&mesh, "--field", "charge"],
            "no scalar point field `charge`",
        ),
        (
            "09_anisotropy",
            &[&mesh, "--field", "distance:A"],
            "is for structures",
        ),
        (
            "09_anisotropy",
            &[&mesh, "--ratio", "0"],
            "error: --ratio is 0; it must",
        ),
        (
            "02_surface",
            &[&atoms, "--decay", "0"],
            "error: --decay is 0; it must",
        ),
        ("08_quads", &[&mesh, "--mode", "hard"], "--mode says how"),
        (
            "10_tmesh",
            &[&mesh, "--turn", "20"],
            "--turn is for --levels curvature",
        ),
        (
            "11_tspline",
            &[&mesh, "--tolerance", "0.1"],
            "--tolerance cuts elements",
        ),
        (
            "10_tmesh",
            &[&mesh, "--levels", "chain:A=1"],
            "is for structures",
        ),
        (
            "10_tmesh",
            &[&mesh, "--levels", "height"],
            "no point field `height`",
        ),
        (
            "10_tmesh",
            &[&mesh, "--raw", "--method", "triangles"],
            "--method says how",
        ),
        (
            "08_quads",
            &[&mesh, "--quads", "4000000000"],
            "--max-memory",
        ),
    ];
    for (name, args, says) in cases {
        let out = folder.path().join("out");
        let output = run(name, args, &out);
        let errors = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(1), "{name} {args:?}: {errors}");
        assert!(errors.contains(says), "{name} {args:?}: {errors}");
        assert!(!out.exists());
    }
    let out = folder.path().join("ball.mrc/below");
    let output = run("06_modes", &[&mesh, "--no-pictures"], &out);
    let errors = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(
        errors.contains("ball.mrc is a file, not a folder"),
        "{errors}"
    );
    // Without them the same inputs work.
    report_of(
        "02_surface",
        &[&map, "--isovalue", "1"],
        &folder.path().join("ball"),
    );
}

/// Materials of which nothing is meshed, files of another run, coordinates that begin with a minus.
#[test]
fn what_is_odd_is_said() {
    let folder = tempfile::tempdir().unwrap();
    let (input, out) = (fixture("1AJJ.pdb"), folder.path().join("out"));
    let said = |name: &str, args: &[&str]| {
        let coarse = ["--spacing", "2", "--select", "residue:4-9", "--no-pictures"];
        let output = run(name, &[&[&*input], args, &coarse].concat(), &out);
        let text = [output.stdout, output.stderr].concat();
        let text = String::from_utf8_lossy(&text).into_owned();
        (output.status.success(), text)
    };
    let far = ["--ball", "-900,-3.5,0:2"];
    let (ended, text) = said("03_tets", &far);
    assert!(!ended && text.contains("take --region both"), "{text}");
    assert!(!out.exists());
    let both = [&far[..], &["--region", "both"]].concat();
    let (ended, text) = said("03_tets", &both);
    let missing = "warning: region 2 has no tetrahedra";
    assert!(ended && text.contains(missing), "{text}");
    assert!(!text.contains("still there"), "{text}");
    let (ended, text) = said("02_surface", &[]);
    let stays = text.lines().find(|l| l.contains("still there"));
    assert!(
        ended && stays.is_some_and(|l| l.contains("volume.vtu")),
        "{text}"
    );
    assert!(stays.is_some_and(|l| !l.contains("surface.ply")), "{text}");
}

#[test]
fn every_program_explains_itself() {
    for name in [
        "00_pipeline",
        "01_density",
        "02_surface",
        "03_tets",
        "04_improve",
        "05_eliminate",
        "06_modes",
        "07_field",
        "08_quads",
        "09_anisotropy",
        "12_correspond",
        "13_deform",
        "14_compare",
        "15_segment",
        "16_pockets",
        "17_smooth",
        "20_tiles",
    ] {
        let output = program(name).arg("--help").output().unwrap();
        let text = String::from_utf8(output.stdout).unwrap();
        assert!(
            output.status.success() && text.contains("Examples:") && text.contains("Outputs:"),
            "{name}"
        );
        assert!(
            text.contains("--threads") && text.contains("--out <DIR>"),
            "{name}: {text}"
        );
    }
}
