//! Segments of the Princeton benchmark (Chen, Golovinskiy and Funkhouser, 2009) beside those of
//! its people, by the Rand error averaged over them. Other operators go through the same steps as ours, with the median
//! number of the people's segments. The thesis gives one bust: 0.116 with its operator.

use std::io::Read;
use std::path::Path;
use std::time::Instant;

use geom_core::{Cpu, Run, TriMesh};
use secondfund_ops::segment::metrics::{cut_discrepancy, difference};
use secondfund_ops::segment::rivals::{concavity_aware, shape_diameter_mode};
use secondfund_ops::segment::{Segments, parts};
use secondfund_ops::{
    Element, Faces, Groups, Normals, Operator, PartOptions, SegmentOptions, Spectrum,
    SpectrumOptions, Weight, segment, spectrum,
};

use super::{sorted, text};
use crate::{Outcome, fixtures};

const COLUMNS: [&str; 8] = [
    "people",
    "LBO",
    "CL",
    "SDF",
    "SLO e^K",
    "SLO auto",
    "parts",
    "automatic",
];
/// Modes for up to this many groups.
const MODES: usize = 15;

/// A mesh of the benchmark with the segments of several people.
struct Model {
    mesh: TriMesh,
    faces: Faces,
    people: Vec<Vec<u32>>,
}

impl Model {
    fn read(folder: &Path, name: &str) -> Result<Self, String> {
        let file = folder.join(format!("off/{name}.off.gz"));
        let mesh = geom_core::io::mesh::read(file).map_err(text)?;
        let mesh = mesh.mesh.into_triangles();
        let people = sorted(&folder.join("seg").join(name))?
            .iter()
            .map(|path| labels(path))
            .collect::<Result<Vec<_>, _>>()?;
        Ok(Self {
            faces: Faces::from(&mesh),
            mesh,
            people,
        })
    }

    /// The median of the people's numbers of segments.
    fn groups(&self) -> usize {
        let count = |labels: &Vec<u32>| labels.iter().max().map_or(0, |&l| l as usize + 1);
        let mut counts: Vec<usize> = self.people.iter().map(count).collect();
        counts.sort_unstable();
        counts[counts.len() / 2].max(2)
    }

    fn rand(&self, labels: &[u32]) -> Result<f64, String> {
        let mut sum = 0.0;
        for person in &self.people {
            let found = difference(labels, person, self.faces.areas()).map_err(text)?;
            sum += found.rand / self.people.len() as f64;
        }
        Ok(sum)
    }

    fn among_people(&self) -> Result<f64, String> {
        let (mut sum, mut pairs) = (0.0, 0.0);
        for (i, a) in self.people.iter().enumerate() {
            for b in &self.people[i + 1..] {
                sum += difference(a, b, self.faces.areas()).map_err(text)?.rand;
                pairs += 1.0;
            }
        }
        Ok(sum / f64::max(pairs, 1.0))
    }

    /// The other measures, averaged over the people: Hamming, global and local consistency, cut discrepancy.
    fn others(&self, labels: &[u32]) -> Result<[f64; 4], String> {
        let mut sums = [0.0; 4];
        for person in &self.people {
            let d = difference(labels, person, self.faces.areas()).map_err(text)?;
            let cut = cut_discrepancy(&self.mesh, labels, person).map_err(text)?;
            let row = [
                d.hamming,
                d.global_consistency,
                d.local_consistency,
                cut.unwrap_or(0.0),
            ];
            add(&mut sums, &row, 1.0 / self.people.len() as f64);
        }
        Ok(sums)
    }

    fn cut(&self, modes: &Spectrum, groups: Groups) -> Result<Segments, String> {
        let options = SegmentOptions {
            groups,
            ..SegmentOptions::default()
        };
        segment(modes, &self.faces, &options, Run::on(&Cpu)).map_err(text)
    }

    /// The Rand errors of [`COLUMNS`], and the other measures of our parts with the number given and sought.
    fn row(&self) -> Result<([f64; 8], [[f64; 4]; 2]), String> {
        let normals = Normals::default();
        let element = Element::Triangles(&self.mesh, &normals);
        let modes = |operator| {
            let options = SpectrumOptions {
                operator,
                modes: MODES,
                ..SpectrumOptions::default()
            };
            spectrum(&element, &options, Run::on(&Cpu)).map_err(text)
        };
        let groups = self.groups();
        let given = Groups::Count(groups);
        let lbo = modes(Operator::Lbo)?;
        let slo = modes(Operator::Slo(Weight::ExpK))?;
        let aware = concavity_aware(&self.mesh, MODES, Run::on(&Cpu)).map_err(text)?;
        let diameter = shape_diameter_mode(&self.mesh, Run::on(&Cpu)).map_err(text)?;
        let plain = Normals::without_detail(&self.mesh, 3, Normals::DETAIL).map_err(text)?;
        let plain = Element::Triangles(&self.mesh, &plain);
        let own = |groups| {
            let options = PartOptions {
                groups,
                ..PartOptions::default()
            };
            parts(&plain, &self.faces, &options, Run::on(&Cpu)).map_err(text)
        };
        let (asked, free) = (own(Some(groups))?.labels, own(None)?.labels);
        let row = [
            self.among_people()?,
            self.rand(&self.cut(&lbo, given)?.labels)?,
            self.rand(&self.cut(&aware, given)?.labels)?,
            self.rand(&self.cut(&diameter, given)?.labels)?,
            self.rand(&self.cut(&slo, given)?.labels)?,
            self.rand(&self.cut(&slo, Groups::default())?.labels)?,
            self.rand(&asked)?,
            self.rand(&free)?,
        ];
        Ok((row, [self.others(&asked)?, self.others(&free)?]))
    }
}

/// Adds a share of a row.
fn add(sums: &mut [f64], row: &[f64], share: f64) {
    sums.iter_mut().zip(row).for_each(|(s, x)| *s += x * share);
}

/// One number per line, packed.
fn labels(path: &Path) -> Result<Vec<u32>, String> {
    let name = |e: &dyn std::fmt::Display| format!("{}: {e}", path.display());
    let file = std::fs::File::open(path).map_err(|e| name(&e))?;
    let mut lines = String::new();
    flate2::read::GzDecoder::new(file)
        .read_to_string(&mut lines)
        .map_err(|e| name(&e))?;
    lines
        .split_whitespace()
        .map(|l| l.parse().map_err(|e| name(&e)))
        .collect()
}

/// Prints the table.
pub(super) fn run() -> Outcome {
    let Some(folder) = fixtures::shared("psb") else {
        println!("  psb: not at hand");
        return Ok(());
    };
    println!(
        "Segments of the Princeton models, Rand error averaged over the people; CL: concavity-aware, SDF: shape diameter"
    );
    println!(
        "{:8} {:>2} {}",
        "model",
        "k",
        COLUMNS.map(|c| format!("{c:>9}")).join(" ")
    );
    let files = sorted(&folder.join("off"))?;
    let start = Instant::now();
    let (mut sums, mut others) = ([0.0; 8], [[0.0; 4]; 2]);
    for file in &files {
        let name = file.file_name().unwrap_or_default().to_string_lossy();
        let name = name.split('.').next().unwrap_or_default().to_owned();
        let model = Model::read(&folder, &name)?;
        let (row, more) = model.row()?;
        let cells = row.map(|x| format!("{x:9.3}")).join(" ");
        println!("{name:8} {:2} {cells}", model.groups());
        let share = 1.0 / files.len() as f64;
        add(&mut sums, &row, share);
        others
            .iter_mut()
            .zip(&more)
            .for_each(|(s, m)| add(s, m, share));
    }
    println!(
        "{:11} {}",
        "mean",
        sums.map(|x| format!("{x:9.3}")).join(" ")
    );
    for (name, [h, g, l, c]) in ["parts", "automatic"].iter().zip(others) {
        println!(
            "{name}: Hamming {h:.3}, consistency {g:.3} global, {l:.3} local, cut discrepancy {c:.3}"
        );
    }
    println!("{:.0} s", start.elapsed().as_secs_f64());
    Ok(())
}
