//! What is drawn: rasterizers, scenes, cuts, slices, plots, colours and labels.

use biogeom_examples::input::labels::{ColorBy, Labels, element_color};
use biogeom_examples::picture::{
    Align, Bars, ColorMap, Corner, Curve, Image, Layer, Paint, Rasterizer, Rgb, Scale, Scene, View,
    cut_tets, histogram, lines, sheet, slice, ticks,
};
use biogeom_examples::products::GOLD;
use geom_core::mesh::shapes;
use geom_core::structure::{Element, Transform};
use geom_core::testing::{gpu_or_skip, same_on_any_threads};
use geom_core::{ImplicitField, Lattice, Point3, QuadMesh, Structure, TetMesh, Vector3};

#[test]
fn both_rasterizers_see_the_same_triangles() {
    let Some(gpu) = gpu_or_skip() else { return };
    let torus = shapes::torus(2.0, 0.7, 60, 30);
    let triangles: Vec<[Corner; 3]> = (0..torus.triangles().len())
        .map(|t| {
            torus.corners(t).map(|p| {
                let clip = [p.x, p.y * 0.8 + p.z * 0.6, 1.5 - p.z * 0.4 + p.y * 0.3];
                [clip[0] / 3.0, clip[1] / 3.0, clip[2] / 3.0].map(|c| c as f32)
            })
        })
        .collect();
    let size = [320, 240];
    let cpu = Rasterizer::Cpu.visible(&triangles, size).unwrap().triangle;
    let gpu = Rasterizer::Gpu(gpu)
        .visible(&triangles, size)
        .unwrap()
        .triangle;
    let covered = cpu.iter().filter(|&&t| t != u32::MAX).count();
    assert!(covered > 15_000, "the torus covers {covered} pixels");
    let differ = cpu.iter().zip(&gpu).filter(|(a, b)| a != b).count();
    // Pixels whose centre lies on an edge may fall to either side.
    assert!(
        differ * 200 < covered,
        "{differ} of {covered} pixels differ"
    );
}

fn sphere(paint: Paint) -> Scene {
    let mesh = shapes::icosphere(3.0, 3);
    let view = View::along_axes(mesh.positions());
    Scene::new(vec![Layer::surface(&mesh, paint)], view)
}

#[test]
fn a_sphere_fills_the_picture_and_is_lit_from_above_left() {
    let image = sphere(Paint::Plain([200, 200, 200]))
        .draw(&Rasterizer::Cpu, [200, 200])
        .unwrap();
    let sum = |x: usize, y: usize| image.pixel(x, y).iter().map(|&c| u32::from(c)).sum::<u32>();
    assert!(
        sum(60, 60) > sum(140, 150) + 60,
        "the light comes from above left"
    );
    assert!(sum(2, 2) > 740, "the background is nearly white");
    // 92 % of 200 pixels across.
    assert!(sum(100, 5) > 740 && sum(100, 12) < 740);
}

#[test]
fn painted_again_it_is_the_same_picture_in_another_colour() {
    let paints = [[200; 3], [90, 150, 200]].map(Paint::Plain);
    let drawn = sphere(Paint::Plain([1; 3]))
        .draw_each(&Rasterizer::Cpu, [120, 90], &paints)
        .unwrap();
    for (paint, image) in paints.into_iter().zip(drawn) {
        let alone = sphere(paint).draw(&Rasterizer::Cpu, [120, 90]).unwrap();
        assert!(image == alone);
    }
}

#[test]
fn pictures_do_not_depend_on_threads() {
    same_on_any_threads(|| {
        sphere(Paint::Plain([90, 150, 200]))
            .draw(&Rasterizer::Cpu, [120, 90])
            .unwrap()
    });
}

#[test]
fn views_are_right_handed() {
    let points = [
        Point3::origin(),
        Point3::new(1.0, 5.0, 2.0),
        Point3::new(0.0, 4.0, -3.0),
        Point3::new(9.0, 1.0, 0.5),
    ];
    for view in [
        View::principal(&points),
        View::along_axes(&points),
        View::principal(&points).turned(0.4, 0.3),
        View::principal(&[]),
    ] {
        assert!((view.right.cross(&view.up) - view.toward).norm() < 1e-12);
        assert!((view.toward.norm() - 1.0).abs() < 1e-12);
    }
    // One body, one of whose ends has most of the triangles: it is seen from the same side.
    let rod = |cuts: &[f64]| {
        let mut rings: Vec<f64> = [0.0, 9.0].iter().chain(cuts).copied().collect();
        rings.sort_by(f64::total_cmp);
        let corners = [[-1.0, -0.3], [1.0, -0.5], [1.0, 0.5], [-1.0, 0.7]];
        let at = |z: f64| corners.map(|[x, y]| Point3::new(x + 0.2 * z, y + 0.1 * z, z));
        let positions = rings.iter().flat_map(|&z| at(z)).collect();
        let quads = (1..rings.len() as u32).flat_map(|r| {
            (0..4).map(move |k| {
                let [a, b] = [k, (k + 1) % 4].map(|k| 4 * (r - 1) + k);
                [a, b, b + 4, a + 4]
            })
        });
        QuadMesh::new(positions, quads.collect())
            .unwrap()
            .into_triangles()
    };
    let (plain, cut) = (rod(&[]), rod(&[0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8]));
    let [a, b] = [&plain, &cut].map(View::of_surface);
    assert!((a.right - b.right).norm() + (a.up - b.up).norm() < 1e-9);
    let [a, b] = [&plain, &cut].map(|m| View::principal(m.positions()));
    assert!((a.right - b.right).norm() + (a.up - b.up).norm() > 1e-3);
    let turned = View::along_axes(&points).turned(0.0, 0.3);
    assert!(
        turned.toward.dot(&View::along_axes(&points).up) > 0.0,
        "the eye moved up"
    );
}

#[test]
fn a_cut_shows_the_tetrahedra_behind_the_plane() {
    // Two tetrahedra that share the face x = 0.
    let p = |x: f64, y: f64, z: f64| Point3::new(x, y, z);
    let positions = vec![
        p(0., 0., 0.),
        p(0., 1., 0.),
        p(0., 0., 1.),
        p(1., 0., 0.),
        p(-1., 0., 0.),
    ];
    let mesh = TetMesh::new(positions, vec![[0, 1, 2, 3], [0, 2, 1, 4]]).unwrap();
    let view = View::of(Vector3::y(), Vector3::z());
    assert!((view.toward - Vector3::x()).norm() < 1e-12);
    let layers = cut_tets(&mesh, &view, 0.5, &[[1; 3], [2; 3]], [9; 3]);
    assert_eq!(layers[0].faces.len(), 1, "the shared face is the cut");
    assert!(matches!(&layers[0].paint, Paint::Faces(c) if c[..] == [[2; 3]]));
    assert_eq!(layers[1].faces.len(), 3);
}

struct Ball;
impl ImplicitField for Ball {
    fn value(&self, x: &Point3) -> f64 {
        2.0 - x.coords.norm()
    }
    fn value_gradient(&self, x: &Point3) -> (f64, Vector3) {
        (self.value(x), -x.coords.normalize())
    }
}

#[test]
fn the_isoline_is_a_circle_of_the_right_radius() {
    let lattice = Lattice {
        origin: Point3::new(-2.0, -2.0, -2.0),
        spacing: 0.5,
        counts: [9, 9, 9],
    };
    let scale = Scale::new(ColorMap::Viridis, [0.0, 2.0], "value");
    let image = slice(&Ball, &lattice, 2, 0.5, 1.0, &scale, 400);
    // Level 1 lies at radius 1: a quarter of the width from the middle.
    let (cx, cy) = (16 + 200, 64 + 200);
    assert_eq!(image.pixel(cx + 99, cy), [255; 3]);
    assert_eq!(image.pixel(cx, cy - 100), [255; 3]);
    assert_ne!(image.pixel(cx + 90, cy), [255; 3]);
}

#[test]
fn a_histogram_shows_both_sets() {
    let a = Bars {
        name: "before",
        color: [200, 60, 40],
        counts: &[1, 5, 2, 0],
    };
    let b = Bars {
        name: "after",
        color: [40, 90, 200],
        counts: &[0, 0, 3, 9],
    };
    let image = histogram(&[a, b], [0.0, 80.0], "t", "angle / °", [600, 400]);
    let has = |test: fn(&[u8]) -> bool| image.rgb().chunks(3).filter(|p| test(p)).count();
    assert!(has(|p| p[0] > p[2].saturating_add(60)) > 1000, "red bars");
    assert!(has(|p| p[2] > p[0].saturating_add(60)) > 1000, "blue bars");
}

#[test]
fn curves_of_one_point_are_drawn() {
    let curve = Curve {
        name: "",
        color: [200, 0, 0],
        points: vec![(1.0, 3.0)],
    };
    let image = lines(&[curve], "t", ["k", "value"], [400, 300]);
    assert!(image.rgb().chunks(3).any(|p| p[0] > 150 && p[1] < 60));
}

#[test]
fn ticks_are_round_and_inside() {
    let texts = |low, high| {
        ticks(low, high)
            .into_iter()
            .map(|t| t.1)
            .collect::<Vec<_>>()
    };
    assert_eq!(texts(0.0, 1.0), ["0.0", "0.2", "0.4", "0.6", "0.8", "1.0"]);
    assert_eq!(
        texts(-1.0, 1.0),
        ["\u{2212}1.0", "\u{2212}0.5", "0.0", "0.5", "1.0"]
    );
    assert_eq!(texts(3.0, 172.0), ["50", "100", "150"]);
    assert!(texts(1.0, 1.0).is_empty());
}

#[test]
fn a_saved_image_reads_back_with_the_same_pixels() {
    let folder = tempfile::tempdir().unwrap();
    let mut image = Image::filled(40, 30, [255; 3]);
    image.text("Å", (20, 15), 24.0, Align::Center);
    assert!(image.rgb().iter().any(|&c| c < 100), "the text is there");
    let path = folder.path().join("a.png");
    image.save(&path).unwrap();
    let decoder = png::Decoder::new(std::io::BufReader::new(std::fs::File::open(path).unwrap()));
    let mut reader = decoder.read_info().unwrap();
    let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
    reader.next_frame(&mut pixels).unwrap();
    assert_eq!(pixels, image.rgb());
}

#[test]
fn a_legend_shows_what_fits_and_counts_the_rest() {
    let entries =
        |n: u8| -> Vec<(Rgb, String)> { (1..=n).map(|i| ([i; 3], i.to_string())).collect() };
    let mut image = Image::filled(200, 210, [255; 3]);
    let has = |image: &Image, c| image.rgb().chunks(3).filter(|p| **p == [c; 3]).count();
    assert_eq!(image.legend(&entries(3), 20, 200), 200 - 3 * 26);
    assert!([1, 2, 3].iter().all(|&c| has(&image, c) == 18 * 18));
    let mut image = Image::filled(200, 210, [255; 3]);
    assert_eq!(image.legend(&entries(9), 20, 200), 200 - 3 * 26);
    assert_eq!((has(&image, 2), has(&image, 3)), (18 * 18, 0));
}

#[test]
fn a_sheet_holds_all_images() {
    let cell = |c, width| (String::from("x"), Image::filled(width, 40, [c; 3]));
    let sheet = sheet(&[cell(10, 50), cell(20, 60), cell(30, 40)], 2);
    let has = |c| sheet.rgb().chunks(3).filter(|p| **p == [c; 3]).count();
    assert_eq!((has(10), has(20), has(30)), (2000, 2400, 1600));
}

#[test]
fn maps_start_and_end_with_their_published_colours() {
    assert_eq!(ColorMap::CoolWarm.at(0.0), [59, 76, 192]);
    assert_eq!(ColorMap::CoolWarm.at(0.5), [221, 221, 221]);
    assert_eq!(ColorMap::CoolWarm.at(9.0), [180, 4, 38]);
    assert_eq!(ColorMap::Viridis.at(0.0), [68, 1, 84]);
    assert_eq!(ColorMap::Viridis.at(f64::NAN), [128; 3]);
}

#[test]
fn a_symmetric_scale_has_grey_at_zero() {
    let scale = Scale::symmetric(&[-3.0, 1.0], "u");
    assert_eq!((scale.low, scale.high), (-3.0, 3.0));
    assert_eq!(scale.color(0.0), [221, 221, 221]);
}

#[test]
fn the_nearest_atom_gives_the_labels() {
    let centers = [[0.0, 0.0, 0.0], [4.0, 0.0, 0.0]].map(|p| (Point3::from(p), 1.5));
    let structure = Structure::of_spheres(centers);
    let points = [[1.0, 1.0, 0.0], [3.0, 0.0, 1.0], [9.0, 0.0, 0.0]].map(Point3::from);
    let labels = Labels::of(&structure, &points).unwrap();
    assert_eq!(labels.atoms(), [0, 1, 1]);
    assert_eq!(labels.colors(ColorBy::Chain), [GOLD; 3]);
    assert_eq!(
        labels.colors(ColorBy::Element),
        [element_color(Element::UNKNOWN.symbol()); 3]
    );
    assert_eq!(labels.along(), [0.0; 3]);
}

#[test]
fn of_copies_the_nearest_is_found_however_far_it_is() {
    let centers = [[0.0, 0.0, 0.0], [4.0, 0.0, 0.0]].map(|p| (Point3::from(p), 1.5));
    let structure = Structure::of_spheres(centers);
    let places = [0.0, 100.0, 200.0].map(|x| Transform {
        translation: Vector3::new(x, 0.0, 0.0),
        ..Transform::identity()
    });
    // One beside an atom, one farther from all than is looked at first, one between copies.
    let points = [[103.0, 1.0, 0.0], [201.0, 90.0, 30.0], [53.0, 0.0, 0.0]].map(Point3::from);
    let labels = Labels::of_copies(&structure, &places, &points).unwrap();
    assert_eq!(
        (labels.copies(), labels.atoms()),
        (&[1, 2, 1][..], &[1, 0, 0][..])
    );
    // One alone needs no number.
    let labels = Labels::of_copies(&structure, &places[..1], &points).unwrap();
    assert_eq!((labels.copies(), labels.atoms()), (&[][..], &[1, 1, 1][..]));
}
