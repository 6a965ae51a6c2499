//! Scratch: whole runs over files named in CROSSFIELD_FILES.
use crossfield::{Options, Size, quadrangulate};
use geom_core::mesh::shapes;
use geom_core::{Cpu, Run, TriMesh, io};

fn show(name: &str, mesh: &TriMesh, options: &Options) {
    let start = std::time::Instant::now();
    match quadrangulate(mesh, options, Run::on(&Cpu)) {
        Ok(made) => {
            let r = &made.report;
            println!(
                "{name}: {} tri -> {} quads, rung {:?}, irregular {}, J min {:.3} mean {:.3} below {} chi {} {} parts {} in {:.2}s",
                mesh.triangles().len(), made.mesh.quads().len(), r.rung(), r.valences.irregular(),
                r.scaled_jacobian.min, r.scaled_jacobian.mean, r.scaled_jacobian.below_0_3,
                mesh.euler_characteristic(), made.mesh.euler_characteristic(), r.parts.len(), start.elapsed().as_secs_f64()
            );
            for p in &r.parts {
                for f in &p.failures { println!("   failed: {f}"); }
                println!("   {:?} {:?}", p.field, p.map);
            }
            if let Ok(dir) = std::env::var("CROSSFIELD_OUT") {
                let f = io::view::View::from(&made.mesh);
                io::mesh::save(format!("{dir}/{name}.obj"), &f).unwrap();
            }
        }
        Err(e) => println!("{name}: ERROR {e}"),
    }
}

#[test]
#[ignore]
fn whole() {
    let quads = std::env::var("CROSSFIELD_QUADS").ok().and_then(|s| s.parse().ok());
    let options = Options { size: quads.map_or(Size::Triangles, Size::Quads), ..Options::default() };
    if let Ok(files) = std::env::var("CROSSFIELD_FILES") {
        for f in files.split_whitespace() {
            let mesh = io::mesh::read(f).unwrap().mesh.into_triangles();
            let name = std::path::Path::new(f).file_stem().unwrap().to_string_lossy().to_string();
            show(&name, &mesh, &options);
        }
        return;
    }
    show("sphere", &shapes::icosphere(1.0, 4), &options);
    show("torus", &shapes::torus(1.0, 0.4, 60, 30), &options);
    show("spot", &io::mesh::read(fixtures::path("spot.ply")).unwrap().mesh.into_triangles(), &options);
    show("bob", &io::mesh::read(fixtures::path("bob_small.ply")).unwrap().mesh.into_triangles(), &options);
}
