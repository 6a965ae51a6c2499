//! What is fuzzed: every reader, and every verb that takes a mesh or a grid of somebody else's.

use std::fs;
use std::io::Write;
use std::sync::LazyLock;

use geom_core::io::structure::{self, Format, ReadOptions};
use geom_core::io::{
    Encoding, MeshFile, View, dx, glb, grid, mesh, mrc, msh, obj, off, ply, stl, vtu,
};
use geom_core::mesh::shapes;
use geom_core::surface::distance::{Graph, Heat, HeatOptions};
use geom_core::surface::remesh::{self, remesh};
use geom_core::surface::repair::{self, repair};
use geom_core::testing::faults::{Random, spoilt};
use geom_core::{Cpu, Lattice, Point3, QuadMesh, Run, ScalarGrid, TetMesh, TriMesh, Vector3};
use secondfund_ops::{
    Element, Faces, FilterOptions, FlowOptions, Groups, Normals, SegmentOptions, SpectrumOptions,
    flow, segment, smooth, smooth_quads, spectrum,
};
use spectral_corresp::{ShapeOptions, VoxelShape};
use tspline::files::{Exchange, bext, iga};
use tspline::mesh::Record;
use tspline::surface::fit::{FitOptions, MeshTarget, fit};
use tspline::{Basis, QualityOptions, TMesh, TMeshOptions};

use super::mutate::{self, Mesh};
use crate::fixtures;

/// What becomes of one input: it is taken, or refused for a reason in one line. Panics are finds.
pub(super) type Fate = Result<(), String>;

/// A target: its name, and what it does with the input of a case.
pub(super) type Target = (&'static str, fn(&mut Random) -> Fate);

/// All of them.
pub(super) const TARGETS: &[Target] = &[
    ("read_pdb", |r| {
        structures(r, &["1AJJ.pdb", "5e5z.pdb"], Format::Pdb)
    }),
    ("read_mmcif", |r| {
        structures(r, &["5i55.cif"], Format::Mmcif)
    }),
    ("read_pqr", read_pqr),
    ("read_ply", |r| {
        read_mesh(r, "ply", &|w, v| ply::write(w, v, Encoding::default()))
    }),
    ("read_off", |r| {
        read_mesh(r, "off", &|w, v| off::write(w, v))
    }),
    ("read_obj", |r| {
        read_mesh(r, "obj", &|w, v| obj::write(w, v))
    }),
    ("read_stl", |r| {
        read_mesh(r, "stl", &|w, v| stl::write(w, v))
    }),
    ("read_glb", |r| {
        read_mesh(r, "glb", &|w, v| glb::write(w, v))
    }),
    ("read_vtu", |r| {
        read_mesh(r, "vtu", &|w, v| vtu::write(w, v))
    }),
    ("read_msh", |r| {
        read_mesh(r, "msh", &|w, v| msh::write(w, v, msh::Options::default()))
    }),
    ("read_mrc", |r| read_grid(r, "mrc")),
    ("read_dx", |r| read_grid(r, "dx")),
    ("read_tmesh", read_tmesh),
    ("read_iga", |r| {
        read_spline(r, &|w, s| iga::write(w, s), &iga::read)
    }),
    ("read_bext", |r| {
        read_spline(r, &|w, s| bext::write(w, s), &bext::read)
    }),
    ("repair", |r| {
        told(repair(
            triangles(r)?,
            &repair::Options {
                fill: 20,
                ..Default::default()
            },
        ))
    }),
    ("remesh", remeshed),
    ("distances", distances),
    ("triangle_modes", triangle_modes),
    ("quad_modes", quad_modes),
    ("smooth", |r| {
        told(smooth(
            &triangles(r)?,
            1,
            &FlowOptions::default(),
            Run::on(&Cpu),
        ))
    }),
    ("smooth_quads", |r| {
        told(smooth_quads(
            &quads(r)?,
            &FlowOptions::default(),
            Run::on(&Cpu),
        ))
    }),
    ("filter_normals", |r| {
        told(flow::filter_normals(
            &triangles(r)?,
            &FilterOptions::default(),
            Run::on(&Cpu),
        ))
    }),
    ("filter_quad_normals", |r| {
        told(flow::filter_quad_normals(
            &quads(r)?,
            &FilterOptions::default(),
            Run::on(&Cpu),
        ))
    }),
    ("quadrangulate", quadrangulated),
    ("tspline", splined),
    ("voxels_of_mesh", voxels),
    ("contour", contour),
    ("improve", improve),
];

fn told<T, E: std::fmt::Display>(result: Result<T, E>) -> Fate {
    result.map(drop).map_err(|e| e.to_string())
}

fn structures(random: &mut Random, files: &[&str], format: Format) -> Fate {
    let seeds: Vec<_> = files
        .iter()
        .filter_map(|f| fs::read(fixtures::path(f)).ok())
        .collect();
    // A few records are as good as a whole file, and are read a hundred times as often.
    let pieces: Vec<_> = seeds
        .iter()
        .map(|s| s[..s.len().min(12_000)].to_vec())
        .chain(seeds.clone())
        .collect();
    told(structure::parse(
        &spoilt(random, &pieces),
        format,
        &ReadOptions::default(),
    ))
}

fn read_pqr(random: &mut Random) -> Fate {
    let seed = "REMARK 1 charges\nATOM 1 N ALA A 1 -0.677 -1.230 -0.491 -0.57 1.82\nATOM 2 CA ALA 2 -0.001 0.064 -0.491 0.03 \
                1.9\nHETATM 3 ZN ZN A 3 1.499 -0.110 -0.491 2.0 1.1\nTER\nEND\n";
    told(structure::parse(
        &spoilt(random, &[seed.into()]),
        Format::Pqr,
        &ReadOptions::default(),
    ))
}

/// Small bodies of triangles: closed, of genus 1, open, and an animal.
static TRIANGLES: LazyLock<Vec<Mesh<3>>> = LazyLock::new(|| {
    let shapes = [
        shapes::icosphere(1.0, 1),
        shapes::icosphere(3.0, 2),
        shapes::torus(3.0, 1.0, 14, 8),
        shapes::cylinder(1.0, 3.0, 10, 6),
        shapes::ellipsoid(Vector3::new(3.0, 1.0, 0.5), 2),
    ];
    let animal = mesh::read(fixtures::path("bob_small.ply")).map(|file| file.mesh.into_triangles());
    shapes
        .into_iter()
        .chain(animal)
        .map(TriMesh::into_parts)
        .collect()
});

static QUADS: LazyLock<Vec<Mesh<4>>> = LazyLock::new(|| {
    let shapes = [
        shapes::quad_sphere(1.0, 4),
        shapes::quad_sphere(2.0, 8),
        shapes::quad_torus(3.0, 1.0, 16, 8),
    ];
    shapes.into_iter().map(QuadMesh::into_parts).collect()
});

static TETS: LazyLock<Vec<Mesh<4>>> = LazyLock::new(|| {
    let shapes = [
        shapes::ball(1.0, 3),
        shapes::shell(1.0, 2.0, 2),
        shapes::box_tets(Vector3::new(1.0, 2.0, 3.0), [2, 3, 4]),
    ];
    shapes
        .map(|mesh| (mesh.positions().to_vec(), mesh.tets().to_vec()))
        .into()
});

fn triangles(random: &mut Random) -> Result<TriMesh, String> {
    let (points, elements) = mutate::mesh(random, &TRIANGLES);
    TriMesh::new(points, elements).map_err(|e| e.to_string())
}

fn quads(random: &mut Random) -> Result<QuadMesh, String> {
    let (points, elements) = mutate::mesh(random, &QUADS);
    QuadMesh::new(points, elements).map_err(|e| e.to_string())
}

type Writer<'a> = &'a dyn Fn(&mut Vec<u8>, &View<'_>) -> Result<(), geom_core::io::Error>;

fn read_mesh(random: &mut Random, extension: &str, write: Writer<'_>) -> Fate {
    let (ball, tets) = (shapes::icosphere(1.0, 1), shapes::ball(1.0, 2));
    let heights: Vec<f32> = ball.positions().iter().map(|p| p.z as f32).collect();
    let coloured = View::from(&ball)
        .point_field("height", &heights)
        .map_err(|e| e.to_string())?;
    let mut seeds = Vec::new();
    for view in [
        View::from(&ball),
        coloured,
        View::of_tets(&tets, &[(1, "molecule")]),
    ] {
        let mut bytes = Vec::new();
        write(&mut bytes, &view).map_err(|e| e.to_string())?;
        seeds.push(bytes);
    }
    let view = mesh::parse(&spoilt(random, &seeds), extension);
    told(view.and_then(MeshFile::try_from))
}

fn lattice(random: &mut Random) -> Result<ScalarGrid, String> {
    let sides = [2, 3, 9, 17];
    let counts = [0; 3].map(|_| *random.one_of(&sides));
    let lattice = Lattice {
        origin: Point3::new(-1.0, 0.0, 2.0),
        spacing: 0.5,
        counts,
    };
    let values = (0..counts.iter().product())
        .map(|_| *random.one_of(&[0.0f32, 0.5, 1.0, 1.0, 2.0, -1.0, 1e30, 1e-40]));
    ScalarGrid::new(lattice, values.collect()).map_err(|e| e.to_string())
}

fn read_grid(random: &mut Random, extension: &str) -> Fate {
    let grid = lattice(random)?;
    let mut seed = Vec::new();
    let written = match extension {
        "dx" => dx::write(&mut seed, &grid),
        _ => mrc::write(&mut seed, &grid, mrc::Mode::Float32),
    };
    written.map_err(|e| e.to_string())?;
    told(grid::parse(&spoilt(random, &[seed]), extension))
}

fn read_tmesh(random: &mut Random) -> Fate {
    let fine = shapes::quad_sphere(1.0, 4);
    let allowed = vec![1; fine.quads().len()];
    let mesh =
        TMesh::build(&fine, &allowed, &TMeshOptions::default()).map_err(|e| e.to_string())?;
    let seed = serde_json::to_vec(&Record::from(&mesh)).map_err(|e| e.to_string())?;
    let record = serde_json::from_slice::<Record>(&spoilt(random, &[seed]));
    told(TMesh::try_from(record.map_err(|e| e.to_string())?))
}

/// Spline surfaces of a sphere, whose text is as long as anybody's.
static SPLINE: LazyLock<Exchange> = LazyLock::new(|| {
    let fine = shapes::quad_sphere(1.0, 4);
    let allowed = vec![1; fine.quads().len()];
    let mesh = TMesh::build(&fine, &allowed, &TMeshOptions::default()).expect("a sphere");
    let surface = tspline::Surface::new(mesh, Basis::Rational, Run::on(&Cpu));
    Exchange::from(&surface.expect("a sphere"))
});

fn read_spline(
    random: &mut Random,
    write: &dyn Fn(&mut dyn Write, &Exchange) -> std::io::Result<()>,
    read: &dyn Fn(&str) -> Result<Exchange, tspline::Error>,
) -> Fate {
    let mut seed = Vec::new();
    write(&mut seed, &SPLINE).map_err(|e| e.to_string())?;
    let text = spoilt(random, &[seed]);
    told(read(&String::from_utf8_lossy(&text)).and_then(|s| s.patches()))
}

fn remeshed(random: &mut Random) -> Fate {
    let options = remesh::Options {
        max_triangles: 20_000,
        ..Default::default()
    };
    told(remesh(triangles(random)?, None, &options, Run::on(&Cpu)))
}

fn distances(random: &mut Random) -> Fate {
    let mesh = triangles(random)?;
    told(Graph::of_edges(&mesh))?;
    told(Heat::new(&mesh, &HeatOptions::default()).and_then(|heat| heat.from(&[0])))
}

/// The least that eigenpairs and segments take.
fn few() -> SpectrumOptions {
    SpectrumOptions {
        modes: 4,
        ..SpectrumOptions::default()
    }
}

fn triangle_modes(random: &mut Random) -> Fate {
    let mesh = triangles(random)?;
    let normals = Normals::OfMesh { rounds: 1 };
    let modes = spectrum(&Element::Triangles(&mesh, &normals), &few(), Run::on(&Cpu))
        .map_err(|e| e.to_string())?;
    let asked = SegmentOptions {
        groups: Groups::Count(3),
        ..SegmentOptions::default()
    };
    told(segment(&modes, &Faces::from(&mesh), &asked, Run::on(&Cpu)))
}

fn quad_modes(random: &mut Random) -> Fate {
    let surface = secondfund_ops::Surface::new(quads(random)?).map_err(|e| e.to_string())?;
    told(spectrum(
        &Element::CatmullClark(&surface),
        &few(),
        Run::on(&Cpu),
    ))
}

fn quadrangulated(random: &mut Random) -> Fate {
    let options = crossfield::Options {
        size: crossfield::Size::Quads(100),
        ..Default::default()
    };
    told(crossfield::quadrangulate(
        &triangles(random)?,
        &options,
        Run::on(&Cpu),
    ))
}

fn splined(random: &mut Random) -> Fate {
    let text = |e: tspline::Error| e.to_string();
    let fine = quads(random)?;
    let allowed = vec![random.below(3) as u8; fine.quads().len()];
    let mesh = TMesh::build(&fine, &allowed, &TMeshOptions::default()).map_err(text)?;
    let target = fine.into_triangles();
    let better =
        tspline::improve(mesh, &target, &QualityOptions::default(), Run::on(&Cpu)).map_err(text)?;
    let mut surface =
        tspline::Surface::new(better.mesh, Basis::default(), Run::on(&Cpu)).map_err(text)?;
    let target = MeshTarget::new(&target).map_err(text)?;
    told(fit(
        &mut surface,
        &target,
        &FitOptions::default(),
        Run::on(&Cpu),
    ))
}

fn voxels(random: &mut Random) -> Fate {
    let mesh = triangles(random)?;
    let spacing = mesh.bounds().diagonal() / 20.0;
    let options = ShapeOptions {
        max_memory: 1 << 28,
        ..ShapeOptions::default()
    };
    let shape =
        VoxelShape::of_mesh(&mesh, spacing, &options, Run::on(&Cpu)).map_err(|e| e.to_string())?;
    told(shape.modes(3, Run::on(&Cpu)))
}

fn contour(random: &mut Random) -> Fate {
    let grid = lattice(random)?;
    let options = dual_contour::Options {
        method: *random.one_of(&[
            dual_contour::Method::DualContour,
            dual_contour::Method::Stuffing,
        ]),
        at_box: *random.one_of(&[
            dual_contour::AtBox::Cap,
            dual_contour::AtBox::Clip,
            dual_contour::AtBox::Refuse,
        ]),
        region: *random.one_of(&[dual_contour::Extent::Both, dual_contour::Extent::Interior]),
        ..Default::default()
    };
    told(dual_contour::surface(&grid, None, &options, Run::on(&Cpu)))?;
    told(dual_contour::volume(&grid, None, &options, Run::on(&Cpu)))
}

fn improve(random: &mut Random) -> Fate {
    let (points, elements) = mutate::mesh(random, &TETS);
    let regions = (0..elements.len())
        .map(|t| 1 + (t % 5 == 0) as u8)
        .collect();
    let mesh = TetMesh::with_regions(points, elements, regions).map_err(|e| e.to_string())?;
    told(tet_quality::improve(
        mesh,
        None,
        &tet_quality::Options::default(),
        Run::on(&Cpu),
    ))
}
