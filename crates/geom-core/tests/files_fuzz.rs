//! Mutated files: every reader of meshes and grids takes 10,000 and more without a panic, and says in
//! one line what is wrong.

use std::panic::{AssertUnwindSafe, catch_unwind};

use geom_core::io::{
    Encoding, Error, GridFile, MeshFile, View, dx, glb, mrc, msh, obj, off, ply, stl, vtu,
};
use geom_core::mesh::shapes;
use geom_core::nalgebra::Point3;
use geom_core::testing::faults::{Random, spoilt};
use geom_core::{Lattice, QuadMesh, ScalarGrid};

/// Mutated inputs per reader.
const INPUTS: u64 = 20_000;

/// Runs a reader, and what users do next, on mutations of files that it reads.
fn survives(seeds: &[Vec<u8>], read: impl Fn(&[u8]) -> Result<(), Error>) {
    for (k, seed) in seeds.iter().enumerate() {
        assert!(read(seed).is_ok(), "seed {k} is sound");
    }
    let (mut sound, mut faulty) = (0, 0);
    for number in 0..INPUTS {
        let bytes = spoilt(&mut Random::new(number), seeds);
        match catch_unwind(AssertUnwindSafe(|| read(&bytes))) {
            Ok(Ok(())) => sound += 1,
            Ok(Err(error)) => {
                faulty += 1;
                let message = error.to_string();
                let one_line = !message.contains('\n') && !message.is_empty();
                assert!(
                    one_line && message.len() < 1000,
                    "input {number}: {message:?}"
                );
            }
            Err(_) => panic!("input {number}: {}", String::from_utf8_lossy(&bytes)),
        }
    }
    // The mutations are neither harmless nor hopeless.
    assert!(
        sound > INPUTS / 100 && faulty > INPUTS / 10,
        "{sound} sound, {faulty} faulty"
    );
}

fn mesh(parse: fn(&[u8]) -> Result<View<'static>, Error>) -> impl Fn(&[u8]) -> Result<(), Error> {
    move |bytes| {
        let view = parse(bytes)?;
        // What one reader gives, another format can hold, or refuses: it never writes a faulty file.
        let (mut vtu, mut ply, mut msh) = (Vec::new(), Vec::new(), Vec::new());
        if vtu::write(&mut vtu, &view).is_ok() {
            vtu::parse(&vtu).expect("a VTU file of ours");
        }
        if ply::write(&mut ply, &view, Encoding::Binary).is_ok() {
            ply::parse(&ply).expect("a PLY file of ours");
        }
        if msh::write(&mut msh, &view, msh::Options::default()).is_ok() {
            msh::parse(&msh).expect("an MSH file of ours");
        }
        MeshFile::try_from(view)?.mesh.into_triangles();
        Ok(())
    }
}

/// Views of triangles, quads and tetrahedra, written by `write`.
fn meshes(write: &dyn Fn(&mut Vec<u8>, &View<'_>)) -> Vec<Vec<u8>> {
    let sphere = shapes::icosphere(1.7, 0);
    let n = sphere.positions().len();
    let rich = View::from(&sphere)
        .point_field("normal", sphere.vertex_normals().as_slice())
        .unwrap()
        .point_field("chain", (0..n as u32).collect::<Vec<u32>>())
        .unwrap()
        .cell_field("patch", (0..20).collect::<Vec<u8>>())
        .unwrap()
        .colored(vec![[1, 2, 3, 255]; n])
        .unwrap();
    let plane = [[0., 0.], [1., 0.], [2., 0.], [0., 1.], [1., 1.], [2., 1.]];
    let plane = plane.map(|[x, y]| Point3::new(x, y, 0.5)).to_vec();
    let quads = QuadMesh::new(plane, vec![[0, 1, 4, 3], [1, 2, 5, 4]]).unwrap();
    let ball = shapes::ball_in_box(1.0, 2.0, 1);
    [rich, View::from(&quads), View::from(&ball)]
        .iter()
        .map(|view| {
            let mut bytes = Vec::new();
            write(&mut bytes, view);
            bytes
        })
        .collect()
}

#[test]
fn ply_reader_survives() {
    let mut seeds = Vec::new();
    for encoding in [Encoding::Binary, Encoding::Ascii] {
        seeds.extend(meshes(&|w, view| ply::write(w, view, encoding).unwrap()));
    }
    survives(&seeds, mesh(ply::parse));
}

#[test]
fn off_reader_survives() {
    survives(
        &meshes(&|w, view| off::write(w, view).unwrap()),
        mesh(off::parse),
    );
}

#[test]
fn obj_reader_survives() {
    let mut seeds = meshes(&|w, view| obj::write(w, view).unwrap());
    seeds.push(b"v 0 0 0\nv 1 0 0 # a\nv 0 1 0\nvt 0 0\nvn 0 0 1\nf -3/1/1 -2//1 -1/1\n".to_vec());
    survives(&seeds, mesh(obj::parse));
}

#[test]
fn stl_reader_survives() {
    let mut seeds = meshes(&|w, view| stl::write(w, view).unwrap());
    let text = "solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\n\
                vertex 0 1e0 0\nendloop\nendfacet\nendsolid a\n";
    seeds.push(text.into());
    survives(&seeds, mesh(stl::parse));
}

#[test]
fn glb_reader_survives() {
    survives(
        &meshes(&|w, view| glb::write(w, view).unwrap()),
        mesh(glb::parse),
    );
}

#[test]
fn vtu_reader_survives() {
    let mut seeds = meshes(&|w, view| vtu::write(w, view).unwrap());
    let text = r#"<VTKFile type="UnstructuredGrid"><UnstructuredGrid>
<Piece NumberOfPoints="4" NumberOfCells="1">
<PointData><DataArray type="Float64" Name="f" format="ascii">1 2 3 4</DataArray></PointData>
<Points><DataArray type="Float32" NumberOfComponents="3" format="ascii">
0 0 0 1 0 0 0 1 0 0 0 1</DataArray></Points>
<Cells><DataArray type="Int64" Name="connectivity" format="ascii">0 1 2 3</DataArray>
<DataArray type="Int64" Name="offsets" format="ascii">4</DataArray>
<DataArray type="UInt8" Name="types" format="ascii">10</DataArray></Cells>
</Piece></UnstructuredGrid></VTKFile>"#;
    seeds.push(text.into());
    survives(&seeds, mesh(vtu::parse));
}

#[test]
fn msh_reader_survives() {
    let mut seeds = Vec::new();
    for version in [msh::Version::V41, msh::Version::V22] {
        for encoding in [Encoding::Binary, Encoding::Ascii] {
            let options = msh::Options { version, encoding };
            seeds.extend(meshes(&|w, view| msh::write(w, view, options).unwrap()));
        }
    }
    survives(&seeds, mesh(msh::parse));
}

fn grid(parse: fn(&[u8]) -> Result<GridFile, Error>) -> impl Fn(&[u8]) -> Result<(), Error> {
    move |bytes| parse(bytes)?.into_grid().map(drop)
}

fn wave() -> ScalarGrid {
    let lattice = Lattice {
        origin: Point3::new(-1.0, 2.5, 0.0),
        spacing: 0.5,
        counts: [5, 4, 3],
    };
    let values = (0..lattice.len()).map(|i| (i as f32).sin().round() * 3.0);
    ScalarGrid::new(lattice, values.collect()).unwrap()
}

#[test]
fn mrc_reader_survives() {
    use mrc::Mode;
    let seeds = [Mode::Int8, Mode::Int16, Mode::Float32, Mode::Float16].map(|mode| {
        let mut bytes = Vec::new();
        mrc::write(&mut bytes, &wave(), mode).unwrap();
        // A header of mere blanks would hide most faults.
        bytes.drain(300..1000);
        bytes.splice(300..300, [0; 700]);
        bytes
    });
    survives(&seeds, grid(mrc::parse));
}

#[test]
fn dx_reader_survives() {
    let mut bytes = b"# a comment\n".to_vec();
    dx::write(&mut bytes, &wave()).unwrap();
    survives(&[bytes], grid(dx::parse));
}
