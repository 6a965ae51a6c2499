//! What a run writes: the table, the points, the coloured surface.

use geom_core::io::{self, view::View as Fields};
use geom_core::{Structure, TriMesh};
use secondfund_ops::pockets::Outline;

use super::Found;
use super::scores::Scores;
use crate::picture::{Layer, Paint, Rgb, Scene, View, segment_color};
use crate::products::{self, Coloring};
use crate::{Failure, Session};

pub(super) fn write_table(
    session: &Session,
    structure: &Structure,
    found: &Found,
    scores: &Scores,
) -> Result<(), Failure> {
    io::save(session.output("pockets.csv")?, |w| {
        writeln!(
            w,
            "rank,score,center_x,center_y,center_z,volume,area,depth,mouth,mean_curvature,{}residues",
            scores.heads()
        )?;
        for (i, (p, o)) in found.pockets.iter().zip(&found.outlines).enumerate() {
            let c = p.center;
            let residues: Vec<String> = p
                .residues
                .iter()
                .map(|&r| residue_name(structure, r))
                .collect();
            writeln!(
                w,
                "{},{},{:.3},{:.3},{:.3},{:.1},{:.1},{:.2},{:.1},{:.4},{}{}",
                p.rank,
                rounded(p.score),
                c.x,
                c.y,
                c.z,
                p.volume,
                o.area,
                o.depth,
                o.mouth,
                o.mean_curvature,
                scores.cells(i),
                residues.join(" ")
            )?;
        }
        Ok(())
    })?;
    Ok(())
}

/// To a tenth where that tells scores apart, as burial's; mean curvatures and densities are small.
fn rounded(score: f64) -> String {
    if score.abs() < 100.0 {
        format!("{score:.5}")
    } else {
        format!("{score:.1}")
    }
}

/// Chain, name and number, as `A:ASP25`.
fn residue_name(structure: &Structure, residue: u32) -> String {
    let r = structure.residues()[residue as usize];
    let chain = structure.chain_starts().partition_point(|&s| s <= residue) - 1;
    let chain = structure.chains()[chain].name;
    format!("{chain}:{}{}{}", r.name, r.number, r.insertion)
}

/// Carbons: a pocket's own points; oxygens: those between two probes.
pub(super) fn write_points(session: &Session, found: &Found) -> Result<(), Failure> {
    io::save(session.output("pockets.pdb")?, |w| {
        writeln!(
            w,
            "REMARK   Points of pockets: chain P, residue number = rank, B factor = rank; O: between two probes"
        )?;
        let points = found
            .pockets
            .iter()
            .zip(&found.outlines)
            .flat_map(|(p, o)| {
                let own = p.points.iter().map(move |x| (p.rank, 'C', x));
                own.chain(o.hollow.iter().map(move |x| (p.rank, 'O', x)))
            });
        for (serial, (rank, element, x)) in points.enumerate() {
            writeln!(
                w,
                "HETATM{:5}  {element}   PKT P{:4}    {:8.3}{:8.3}{:8.3}  1.00{:6.2}           {element}",
                (serial + 1) % 100_000,
                rank % 10_000,
                x.x,
                x.y,
                x.z,
                rank as f64
            )?;
        }
        Ok(writeln!(w, "END")?)
    })?;
    Ok(())
}

/// Best pockets are coloured last, so that they win where outlines overlap.
pub(super) fn write_surface(
    session: &Session,
    surface: &TriMesh,
    outlines: &[Outline],
) -> Result<(), Failure> {
    const PLAIN: Rgb = [226, 222, 214];
    let mut colors = vec![PLAIN; surface.triangles().len()];
    for outline in outlines.iter().take(SHOWN).rev() {
        for &t in &outline.triangles {
            colors[t as usize] = segment_color(outline.rank as u32);
        }
    }
    let mut of_vertices = vec![PLAIN; surface.positions().len()];
    for (corners, &color) in surface.triangles().iter().zip(&colors) {
        if color != PLAIN {
            corners
                .iter()
                .for_each(|&v| of_vertices[v as usize] = color);
        }
    }
    let fields = Fields::from(surface).colored(products::rgba(&of_vertices))?;
    let legend = outlines.iter().take(SHOWN);
    let legend = legend.map(|o| (segment_color(o.rank as u32), format!("pocket {}", o.rank)));
    let coloring = Coloring {
        colors: of_vertices.clone(),
        scale: None,
        legend: legend.collect(),
    };
    session.show("pockets", surface, vec![("pockets".to_owned(), coloring)]);
    io::mesh::save(session.output("pockets.glb")?, &fields)?;
    session.picture("pockets", || {
        let mut layer = Layer::surface(surface, Paint::Faces(colors));
        layer.edges = false;
        let mut scene = Scene::new(vec![layer], view_into(surface, outlines));
        scene.caption = Some(match outlines.len() {
            1 => "1 pocket".to_owned(),
            n if n <= SHOWN => format!("{n} pockets, all coloured; buried ones do not show"),
            n => format!("{n} pockets; the first {SHOWN} are coloured, buried ones do not show"),
        });
        scene.draw(session.rasterizer()?, products::SIZE)
    })
}

/// Pockets with a colour.
const SHOWN: usize = 5;

/// From the side to which the first pocket opens.
fn view_into(surface: &TriMesh, outlines: &[Outline]) -> View {
    let mut view = View::principal(surface.positions());
    let first = outlines.iter().find(|o| !o.triangles.is_empty());
    let normal = first.map(|o| {
        let sum: geom_core::Vector3 = o
            .triangles
            .iter()
            .map(|&t| surface.doubled_area_normal(t as usize))
            .sum();
        sum
    });
    if let Some(toward) = normal.and_then(|n| n.try_normalize(0.0)) {
        let up = (view.up - toward * view.up.dot(&toward)).try_normalize(1e-6);
        view.up = up.unwrap_or_else(|| toward.cross(&view.right).normalize());
        view.right = view.up.cross(&toward);
        view.toward = toward;
    }
    view
}
