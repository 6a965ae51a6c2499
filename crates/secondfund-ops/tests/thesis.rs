//! Chapter 7 on real data: the Princeton models with their human segmentations, and structures with the
//! ligands that mark their pockets. The data lie beside the workspace; without them these tests say so.

#![expect(clippy::print_stdout, reason = "figures for people, with --nocapture")]

use std::io::Read;
use std::path::Path;

use gauss_density::Levels;
use geom_core::io::structure::{ReadOptions, read};
use geom_core::nalgebra::Rotation3;
use geom_core::structure::{Atom, Element, Name, ResidueKind, StructureBuilder};
use geom_core::{Cpu, ImplicitField, Point3, Run, Structure, TriMesh, Vector3};
use secondfund_ops::options::{OutlineOptions, OutlineSource, PatchOptions, ProbeOptions};
use secondfund_ops::pockets::{
    Outline, Pocket, SiteScore, between_probes, concave_patches, distance_to_ligand, field_in,
    find, outline, site_ranks,
};
use secondfund_ops::segment::metrics::difference;
use secondfund_ops::segment::{Parts, parts};
use secondfund_ops::testing::dimpled_ball;
use secondfund_ops::{
    Element as SurfaceElement, Error, Faces, Groups, Normals, Operator, PartOptions, PocketOptions,
    SegmentOptions, Segments, Spectrum, SpectrumOptions, Weight, segment, spectrum,
};

/// What is put into crystals to make them grow, and sugars bound to the surface: no ligands.
const ADDITIVES: [&str; 20] = [
    "GOL", "EDO", "SO4", "PO4", "ACT", "DMS", "PEG", "DIO", "IMD", "BOG", "NAG", "MAN", "BMA",
    "FUC", "CAS", "ACE", "MES", "TRS", "CIT", "FMT",
];

/// The heavy atoms of each ligand of at least six.
fn ligands(structure: &Structure) -> Vec<Vec<Point3>> {
    (0..structure.residues().len())
        .filter(|&r| {
            let residue = structure.residues()[r];
            residue.kind == ResidueKind::Ligand && !ADDITIVES.contains(&residue.name.as_str())
        })
        .map(|r| {
            let atoms = &structure.atoms()[structure.residue_atoms(r)];
            let heavy = atoms.iter().filter(|a| a.element != Element::HYDROGEN);
            heavy.map(|a| a.position).collect::<Vec<_>>()
        })
        .filter(|atoms| atoms.len() >= 6)
        .collect()
}

fn entries(folder: &Path) -> Vec<(String, Structure)> {
    let mut files: Vec<_> = std::fs::read_dir(folder)
        .unwrap()
        .map(|e| e.unwrap().path())
        .filter(|p| p.extension().is_some_and(|e| e == "pdb" || e == "cif"))
        .collect();
    files.sort();
    files
        .iter()
        .map(|path| {
            let name = path.file_stem().unwrap().to_string_lossy().into_owned();
            (name, read(path, &ReadOptions::default()).unwrap().structure)
        })
        .collect()
}

/// The best rank over the ligands, and how many of them are within the first n + 2.
fn summary(scores: &[SiteScore]) -> (usize, usize) {
    let best = scores
        .iter()
        .filter_map(|s| s.rank_by_atom)
        .min()
        .unwrap_or(99);
    let found = scores
        .iter()
        .filter(|s| s.rank_by_atom.is_some_and(|r| r <= scores.len() + 2));
    (best, found.count())
}

#[test]
fn pockets_are_where_the_ligands_are() {
    let Some(folder) = fixtures::shared_or_skip("pockets") else {
        return;
    };
    let options = PocketOptions::default();
    let (mut first, mut third, mut all, mut sites, mut sites_found) = (0, 0, 0, 0, 0);
    for (name, structure) in entries(&folder) {
        let ligands = ligands(&structure);
        if ligands.is_empty() {
            continue;
        }
        let found = find(&structure, &options).unwrap();
        let scores = site_ranks(&found.pockets, &ligands);
        let (best, within) = summary(&scores);
        println!(
            "{name:6} {:5} atoms {} chains {} ligands: best rank {best}, {within} sites by n+2; ranks {:?}; candidates {}; chains {:?}",
            found.atoms,
            structure.chains().len(),
            ligands.len(),
            scores
                .iter()
                .map(|s| s.rank_by_atom.unwrap_or(0))
                .collect::<Vec<_>>(),
            found.candidates,
            found
                .pockets
                .iter()
                .take(4)
                .map(|p| p.chains.len())
                .collect::<Vec<_>>(),
        );
        all += 1;
        first += usize::from(best == 1);
        third += usize::from(best <= 3);
        sites += ligands.len();
        sites_found += within;
    }
    println!("top-1 {first}/{all}, top-3 {third}/{all}, sites within n+2 {sites_found}/{sites}");
    assert!(first as f64 >= 0.75 * all as f64 && third as f64 >= 0.85 * all as f64);
}

/// The structure turned and moved.
fn turned(structure: &Structure, turn: &Rotation3<f64>, shift: Vector3) -> Structure {
    let mut moved = structure.clone();
    for atom in moved.atoms_mut() {
        atom.position = turn * atom.position + shift;
    }
    moved
}

#[test]
fn a_turned_molecule_has_the_same_pockets() {
    let path = fixtures::path("1hvr.pdb");
    let structure = read(&path, &ReadOptions::default()).unwrap().structure;
    let options = PocketOptions::default();
    let first = find(&structure, &options).unwrap();
    // The inhibitor XK2 lies in the first one.
    let ranks = site_ranks(&first.pockets, &ligands(&structure));
    assert_eq!(ranks[0].rank_by_atom, Some(1), "{ranks:?}");
    // A ligand without atoms is nowhere, not at the origin.
    let mut at_origin = first.pockets.clone();
    at_origin[0].center = Point3::origin();
    let nobody = &site_ranks(&at_origin, &[Vec::new()])[0];
    assert_eq!((nobody.rank_by_atom, nobody.rank_by_centroid), (None, None));
    for k in 0..10 {
        let turn = Rotation3::from_euler_angles(
            0.61 * f64::from(k),
            1.7 - 0.3 * f64::from(k),
            0.23 * f64::from(k * k),
        );
        let shift = Vector3::new(f64::from(k), -3.0, 40.0);
        let other = find(&turned(&structure, &turn, shift), &options).unwrap();
        for (p, q) in first.pockets.iter().zip(&other.pockets).take(3) {
            let apart = (turn * p.center + shift - q.center).norm();
            assert!(apart < 1.0, "{k}: pocket {} is {apart} Å away", p.rank);
        }
    }
}

/// The largest surface around the polymers, sampled at 1 Å.
pub(crate) fn molecular_surface(structure: &Structure) -> TriMesh {
    let polymer = structure.of_kind(ResidueKind::Polymer);
    let levels = Levels {
        decay: 0.5,
        ..Levels::default()
    };
    let model = gauss_density::Model::uniform(&polymer, &levels).unwrap();
    let sampling = gauss_density::Options {
        spacing: 1.0,
        ..Default::default()
    };
    let grid = gauss_density::sample(&model, &sampling, Run::on(&Cpu)).unwrap();
    let contour = dual_contour::Options::default();
    let made = dual_contour::surface(&grid.grid, None, &contour, Run::on(&Cpu)).unwrap();
    made.mesh.components().swap_remove(0)
}

/// The outlines of the best pockets: apart from each other, hollow, and where their points are.
#[test]
fn outlines_of_a_protease_are_apart_and_hollow() {
    let path = fixtures::path("1hvr.pdb");
    let structure = read(&path, &ReadOptions::default()).unwrap().structure;
    let surface = molecular_surface(&structure);
    let found = find(&structure, &PocketOptions::default()).unwrap().pockets;
    for source in [OutlineSource::default(), OutlineSource::Patches] {
        let options = OutlineOptions {
            source,
            ..OutlineOptions::default()
        };
        let outlines = outline(&surface, &structure, &found, &options, Run::on(&Cpu)).unwrap();
        apart_and_hollow(&surface, &found, &outlines);
        if source != OutlineSource::Patches {
            // Neither crumbs nor holes: each border is that of a mouth.
            let first = &outlines[0];
            let taken = |t: &usize| first.triangles.binary_search(&(*t as u32)).is_ok();
            for inside in [true, false] {
                let all = 0..surface.triangles().len();
                let some = all.filter(|t| taken(t) == inside);
                let triangles = some.map(|t| surface.triangles()[t]).collect();
                let part = TriMesh::new(surface.positions().to_vec(), triangles).unwrap();
                let sizes: Vec<usize> = part
                    .components()
                    .iter()
                    .map(|c| c.triangles().len())
                    .collect();
                let least = sizes.iter().min().unwrap();
                assert!(
                    10 * least >= first.triangles.len() || sizes.len() == 1,
                    "{sizes:?}"
                );
            }
        }
        let hollow = outlines.iter().any(|o| !o.hollow.is_empty());
        assert_eq!(hollow, source != OutlineSource::Patches);
    }
    let options = OutlineOptions {
        radius: f64::NAN,
        ..OutlineOptions::default()
    };
    assert!(options.check().is_err());
    let source = OutlineSource::Probes(ProbeOptions {
        reach: f64::NAN,
        ..ProbeOptions::default()
    });
    let options = OutlineOptions {
        source,
        ..OutlineOptions::default()
    };
    assert!(options.check().is_err());
}

fn apart_and_hollow(surface: &TriMesh, found: &[Pocket], outlines: &[Outline]) {
    let mut taken = vec![false; surface.triangles().len()];
    for o in outlines {
        for &f in &o.triangles {
            let twice = std::mem::replace(&mut taken[f as usize], true);
            assert!(!twice, "triangle {f} is in two outlines");
        }
    }
    // The active site, a tunnel under the flaps.
    let (first, points) = (&outlines[0], &found[0].points);
    println!(
        "{:?}",
        Outline {
            triangles: Vec::new(),
            hollow: Vec::new(),
            ..first.clone()
        }
    );
    assert!(first.mean_curvature < -0.02 && first.area > 100.0);
    assert!(first.depth > 3.0 && first.volume > 50.0 && first.mouth > 0.1 * first.area);
    let near = |f: &u32| {
        let [a, b, c] = surface.corners(*f as usize);
        let middle = Point3::from((a.coords + b.coords + c.coords) / 3.0);
        points.iter().any(|p| (p - middle).norm() < 8.0)
    };
    let share = first.triangles.iter().filter(|f| near(f)).count() as f64;
    assert!(share > 0.5 * first.triangles.len() as f64);
}

/// Two slabs of atoms with a slot between them that the small probe enters and the large one does not, and closed
/// cavities alike; the same points in every orientation.
#[test]
fn points_between_probes_fill_slots_and_cavities() {
    // The ball of 14 Å without a ball of 5.5 Å inside it, and without a slot of 8 Å from above.
    let hollow = |p: &Point3| {
        let cavity = (p - Point3::new(0.0, 0.0, -4.0)).norm() < 5.5;
        let slot = p.x.abs() < 4.0 && p.z > 5.0;
        cavity || slot
    };
    let body = ball_of_atoms(14.0);
    let carved = body.filter(|a| !hollow(&body.atoms()[a].position));
    let options = ProbeOptions {
        outer: 4.0,
        ..ProbeOptions::default()
    };
    let points = between_probes(&carved, &options).unwrap();
    let inside = points.iter().filter(|p| hollow(p)).count();
    assert!(
        inside as f64 > 0.9 * points.len() as f64,
        "{inside} of {}",
        points.len()
    );
    let cavity = |p: &&Point3| p.z < 1.0;
    assert!(points.iter().filter(cavity).count() > 10);
    assert!(
        points
            .iter()
            .filter(|p| p.z > 6.0 && p.x.abs() < 1.0)
            .count()
            > 20
    );
    assert!(points.iter().all(|p| p.coords.norm() < 14.5));
    // A convex body has none but what the lattice leaves of its curvature.
    let none = between_probes(&body, &options).unwrap();
    assert!(none.len() < points.len() / 20, "{}", none.len());
    let wrong = ProbeOptions {
        outer: 1.0,
        ..options
    };
    assert!(matches!(between_probes(&body, &wrong), Err(Error::Option(o)) if o.option == "outer"));
}

/// So many groups that a dimple is one without its rim.
fn fine_patches() -> PatchOptions {
    PatchOptions {
        modes: 6,
        groups: 24,
        regularization: 0.1,
        normal_rounds: 1,
        ..PatchOptions::default()
    }
}

/// The thesis's method on what it is made for: a ball with dimples, of which a field tells one.
#[test]
fn concave_patches_are_the_dimples() {
    let directions = [Vector3::x(), Vector3::y(), Vector3::new(-1.0, -1.0, 0.5)];
    let (positions, triangles) = dimpled_ball(4, &directions, 0.4, 0.45).into_parts();
    let scaled = positions.iter().map(|p| p * 14.0).collect();
    let ball = TriMesh::new(scaled, triangles).unwrap();
    let body = ball_of_atoms(14.0);
    let away = |p: &Point3, k: usize| directions[k].angle(&p.coords);
    let options = fine_patches();
    let found = |field: Option<&[f64]>| {
        concave_patches(&ball, &body, field, &options, Run::on(&Cpu)).unwrap()
    };
    let blind = found(None);
    assert!(blind.len() >= 2);
    for (pocket, outline) in &blind {
        assert_eq!(pocket.rank, outline.rank);
        assert!(outline.area > 0.0 && !pocket.residues.is_empty());
    }
    assert!(blind[0].1.mean_curvature < 0.0 && blind[0].0.score == -blind[0].1.mean_curvature);
    for k in 0..3 {
        let field: Vec<f64> = ball
            .positions()
            .iter()
            .map(|p| (-away(p, k)).exp())
            .collect();
        let first = &found(Some(&field))[0].0;
        assert!(away(&first.center, k) < 0.35, "{k}: {}", first.center);
    }
    let short = concave_patches(&ball, &body, Some(&[1.0]), &options, Run::on(&Cpu));
    assert!(matches!(short, Err(Error::Length { found: 1, .. })));
}

/// A linear field has its value at the middle as mean, and is unknown beyond its bounds.
#[test]
fn fields_are_averaged_over_points_and_outlines() {
    struct Along;
    impl ImplicitField for Along {
        fn value(&self, p: &Point3) -> f64 {
            2.0 * p.x
        }
        fn value_gradient(&self, p: &Point3) -> (f64, Vector3) {
            (self.value(p), Vector3::new(2.0, 0.0, 0.0))
        }
    }
    let body = ball_of_atoms(14.0);
    let directions = [Vector3::x(), Vector3::y(), Vector3::new(-1.0, -1.0, 0.5)];
    let (positions, triangles) = dimpled_ball(4, &directions, 0.4, 0.45).into_parts();
    let scaled = positions.iter().map(|p| p * 14.0).collect();
    let ball = TriMesh::new(scaled, triangles).unwrap();
    let found = concave_patches(&ball, &body, None, &fine_patches(), Run::on(&Cpu)).unwrap();
    let (pocket, outline) = &found[0];
    let score = field_in(pocket, outline, &ball, &Along, None);
    let mean =
        |points: &[Point3]| points.iter().map(|p| 2.0 * p.x).sum::<f64>() / points.len() as f64;
    assert!((score.points.unwrap() - mean(&pocket.points)).abs() < 1e-9);
    let [low, high] = score.range.unwrap();
    assert!(low < score.points.unwrap() && score.points.unwrap() < high);
    // By area, not by vertex.
    let (mut sum, mut area) = (0.0, 0.0);
    for &t in &outline.triangles {
        let part = ball.doubled_area_normal(t as usize).norm();
        sum += part * mean(&ball.corners(t as usize));
        area += part;
    }
    assert!((score.surface.unwrap() - sum / area).abs() < 1e-9);
    let elsewhere = geom_core::Aabb::new(Point3::new(90.0, 0.0, 0.0), Point3::new(91.0, 1.0, 1.0));
    let unknown = field_in(pocket, outline, &ball, &Along, Some(&elsewhere));
    assert_eq!(
        (unknown.points, unknown.range, unknown.surface),
        (None, None, None)
    );
}

/// Stray atoms far away cost nothing.
#[test]
fn stray_atoms_cost_nothing() {
    let path = fixtures::path("1AJJ.pdb");
    let structure = read(&path, &ReadOptions::default()).unwrap().structure;
    let options = PocketOptions {
        per_chain: false,
        ..PocketOptions::default()
    };
    let mut stray = structure.clone();
    let last = stray.atoms().len() - 1;
    stray.atoms_mut()[last].position = Point3::new(9e3, -9e3, 9e3);
    let found = find(&stray, &options).unwrap();
    let alone = find(&structure, &options).unwrap();
    // A shell of its own around the stray atom; the frame, and so the lattice, lies otherwise.
    let (a, b) = (alone.shell_points as f64, found.shell_points as f64);
    assert!((b / a - 1.0).abs() < 0.1, "{a} {b}");
}

/// Atoms on a lattice within a ball, so close together that it is convex.
fn ball_of_atoms(radius: f64) -> Structure {
    let mut builder = StructureBuilder::new();
    builder.domain(1, 1);
    builder.chain(Name::new("A").unwrap());
    builder.residue(Name::new("ALA").unwrap(), 1, Name::default());
    let steps = || (-15..=15).map(f64::from);
    for p in
        steps().flat_map(|x| steps().flat_map(move |y| steps().map(move |z| Point3::new(x, y, z))))
    {
        if p.coords.norm() <= radius {
            builder.atom(Atom {
                position: p,
                radius: 1.7,
                charge: 0.0,
                b_factor: 0.0,
                name: Name::new("C").unwrap(),
                element: Element::CARBON,
                hetero: false,
            });
        }
    }
    builder.build()
}

#[test]
fn a_ball_has_no_pocket_and_nothing_is_an_error() {
    let found = find(&ball_of_atoms(14.0), &PocketOptions::default()).unwrap();
    assert!(
        found.shell_points > 1000 && found.pockets.is_empty(),
        "{:?}",
        found.pockets.first()
    );
    let nothing = find(&Structure::default(), &PocketOptions::default());
    assert_eq!(nothing, Err(Error::NoAtoms));
    let ball = ball_of_atoms(6.0);
    let bad = |change: &dyn Fn(&mut geom_core::structure::Atom)| {
        let mut bad = ball.clone();
        change(&mut bad.atoms_mut()[3]);
        find(&bad, &PocketOptions::default())
    };
    for (found, wrong) in [
        (bad(&|a| a.position.y = f64::NAN), "y"),
        (bad(&|a| a.position.z = -1e8), "z"),
        (bad(&|a| a.radius = f64::INFINITY), "radius"),
        (bad(&|a| a.radius = -1.0), "radius"),
    ] {
        assert!(
            matches!(found, Err(Error::BadAtom { atom: 3, field, .. }) if field == wrong),
            "{found:?}"
        );
    }
    let wrong = PocketOptions {
        radius: 0.0,
        ..PocketOptions::default()
    };
    assert!(matches!(
        find(&ball_of_atoms(5.0), &wrong),
        Err(Error::Option(_))
    ));
}

#[test]
fn centres_are_measured_to_atoms_and_to_centroids() {
    let ligand = vec![Point3::new(0.0, 0.0, 0.0), Point3::new(6.0, 0.0, 0.0)];
    assert_eq!(
        distance_to_ligand(&Point3::new(6.0, 3.0, 0.0), &ligand),
        3.0
    );
    let path = fixtures::path("1hvr.pdb");
    let structure = read(&path, &ReadOptions::default()).unwrap().structure;
    let mut pockets = find(&structure, &PocketOptions::default()).unwrap().pockets;
    pockets.truncate(2);
    pockets[0].center = Point3::new(3.0, 13.0, 0.0);
    pockets[1].center = Point3::new(6.0, 3.9, 0.0);
    let [score] = site_ranks(&pockets, &[ligand])[..] else {
        unreachable!()
    };
    assert_eq!(
        (score.rank_by_atom, score.rank_by_centroid),
        (Some(2), Some(2))
    );
}

// ── the Princeton benchmark

struct Model {
    mesh: TriMesh,
    areas: Vec<f64>,
    humans: Vec<Vec<u32>>,
}

fn labels_of(path: &Path) -> Vec<u32> {
    let mut text = String::new();
    let file = std::fs::File::open(path).unwrap();
    flate2::read::GzDecoder::new(file)
        .read_to_string(&mut text)
        .unwrap();
    text.lines().filter_map(|l| l.trim().parse().ok()).collect()
}

fn model(folder: &Path, name: &str) -> Model {
    let read = geom_core::io::mesh::read(folder.join(format!("off/{name}.off.gz"))).unwrap();
    let mesh = read.mesh.into_triangles();
    let mut files: Vec<_> = std::fs::read_dir(folder.join("seg").join(name))
        .unwrap()
        .map(|e| e.unwrap().path())
        .collect();
    files.sort();
    Model {
        areas: (0..mesh.triangles().len())
            .map(|t| 0.5 * mesh.doubled_area_normal(t).norm())
            .collect(),
        humans: files.iter().map(|f| labels_of(f)).collect(),
        mesh,
    }
}

impl Model {
    /// The median of the humans' numbers of segments.
    fn groups(&self) -> usize {
        let mut counts: Vec<usize> = self
            .humans
            .iter()
            .map(|h| 1 + *h.iter().max().unwrap() as usize)
            .collect();
        counts.sort_unstable();
        counts[counts.len() / 2].max(2)
    }

    fn rand(&self, labels: &[u32]) -> f64 {
        let each = self
            .humans
            .iter()
            .map(|h| difference(labels, h, &self.areas).unwrap().rand);
        each.sum::<f64>() / self.humans.len() as f64
    }

    fn among_humans(&self) -> f64 {
        let (mut sum, mut pairs) = (0.0, 0.0);
        for (i, a) in self.humans.iter().enumerate() {
            for b in &self.humans[i + 1..] {
                sum += difference(a, b, &self.areas).unwrap().rand;
                pairs += 1.0;
            }
        }
        sum / f64::max(pairs, 1.0)
    }

    fn modes(&self, operator: Operator, count: usize) -> Spectrum {
        let normals = Normals::default();
        let options = SpectrumOptions {
            operator,
            modes: count,
            ..SpectrumOptions::default()
        };
        spectrum(
            &SurfaceElement::Triangles(&self.mesh, &normals),
            &options,
            Run::on(&Cpu),
        )
        .unwrap()
    }
}

impl Model {
    fn parts(&self, groups: Option<usize>, normals: &Normals) -> Parts {
        let element = SurfaceElement::Triangles(&self.mesh, normals);
        let options = PartOptions {
            groups,
            ..PartOptions::default()
        };
        parts(&element, &Faces::from(&self.mesh), &options, Run::on(&Cpu)).unwrap()
    }
}

fn cut(model: &Model, modes: &Spectrum, groups: Groups) -> Segments {
    let options = SegmentOptions {
        groups,
        ..SegmentOptions::default()
    };
    segment(modes, &Faces::from(&model.mesh), &options, Run::on(&Cpu)).unwrap()
}

/// Rand errors of a set of models with the number of parts given and sought; prints a table.
fn benchmark(names: &[&str]) -> Option<[f64; 5]> {
    let folder = fixtures::shared_or_skip("psb")?;
    let mut sums = [0.0; 5];
    for name in names {
        let model = model(&folder, name);
        let k = model.groups();
        let slo = model.modes(Operator::Slo(Weight::ExpK), 15);
        let lbo = model.modes(Operator::Lbo, k.clamp(3, 15));
        let given = cut(&model, &slo, Groups::Count(k));
        let other = cut(&model, &lbo, Groups::Count(k));
        let [asked, free] = [Some(k), None].map(|groups| model.parts(groups, &Normals::default()));
        let row = [
            model.among_humans(),
            model.rand(&given.labels),
            model.rand(&other.labels),
            model.rand(&asked.labels),
            model.rand(&free.labels),
        ];
        let found = free.sought;
        println!("{name:4} {k:2} groups: {row:.3?} with {found} sought");
        sums.iter_mut()
            .zip(row)
            .for_each(|(s, x)| *s += x / names.len() as f64);
    }
    println!("mean of humans, SLO, LBO, parts, sought: {sums:.3?}");
    Some(sums)
}

/// Five of the models of the notes' table, one per kind.
#[test]
fn parts_are_nearly_those_that_humans_see() {
    let Some([humans, slo, lbo, given, automatic]) = benchmark(&["61", "41", "1", "121", "301"])
    else {
        return;
    };
    assert!(slo <= 0.175 && slo < 0.7 * lbo && slo < 1.2 * humans);
    assert!(given < 1.05 * slo && given < 1.1 * humans, "{given}");
    assert!(automatic <= 0.12, "{automatic}");
}

/// Of a bust of many curls: without detail, what people call hair is hair.
#[test]
fn curls_are_no_parts() {
    let Some(folder) = fixtures::shared_or_skip("psb") else {
        return;
    };
    let model = model(&folder, "310");
    let plain = Normals::without_detail(&model.mesh, 3, Normals::DETAIL).unwrap();
    let rand = |normals| model.rand(&model.parts(Some(model.groups()), normals).labels);
    let (own, plain) = (rand(&Normals::default()), rand(&plain));
    println!("310: {own:.3} with the normals of the mesh, {plain:.3} without detail");
    assert!(plain < 0.19 && plain < own - 0.03, "{own} {plain}");
}
