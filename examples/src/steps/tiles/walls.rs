//! Walls of narrow gaps that belong to different tiles: neither sees the other while it is improved.

use bytemuck::{Pod, Zeroable};
use dual_contour::Extent;
use geom_core::search::crossing::crossing_pairs;
use geom_core::tiles::border::{Border, ghosts, number};
use geom_core::tiles::exchange::{Deal, Exchange, exchanged, gathered};
use geom_core::tiles::parts::surface;
use geom_core::{Aabb, Point3, TriMesh};

use super::{Bad, Plan};
use crate::Failure;

/// A triangle of the surface that another tile may cross.
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct Wall {
    /// The tile that this is told to.
    tile: u64,
    ids: [u64; 3],
    corners: [[f64; 3]; 3],
}

/// The place around a tile.
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct Around {
    tile: u64,
    low: [f64; 3],
    high: [f64; 3],
}

/// Where the surfaces of this rank's tiles cross each other or those of others, as far as that happens where tiles meet.
/// Where both sides of the surface are meshed, they cannot.
pub(super) fn crossing(
    plan: &Plan<'_>,
    exchange: &(impl Exchange + ?Sized),
    deal: &Deal,
    borders: &mut [Border],
) -> Result<Vec<Bad>, Failure> {
    if plan.contour.region == Extent::Both {
        return Ok(Vec::new());
    }
    number(exchange, deal, borders)?;
    let beyond = ghosts(exchange, deal, borders)?;
    let own = deal.of(exchange.rank());
    let around = (own.clone()).zip(&*borders).filter_map(|(tile, border)| {
        let bounds = border.bounds?;
        Some(Around {
            tile: tile as u64,
            low: bounds.min.into(),
            high: bounds.max.into(),
        })
    });
    let around: Vec<Around> = gathered(exchange, &around.collect::<Vec<_>>())?.concat();
    let around: Vec<(u64, Aabb)> = around
        .iter()
        .map(|a| (a.tile, Aabb::new(a.low.into(), a.high.into())))
        .collect();

    // Each triangle to all tiles that may have one there, and to its own.
    let mut to = vec![Vec::new(); deal.ranks];
    for ((tile, border), ghosts) in own.clone().zip(&*borders).zip(&beyond) {
        let Some(bounds) = border.bounds else {
            continue;
        };
        let met = |other: &&(u64, Aabb)| other.0 != tile as u64 && other.1.intersects(&bounds);
        let others: Vec<&(u64, Aabb)> = around.iter().filter(met).collect();
        if others.is_empty() {
            continue;
        }
        let (piece, ids) = (plan.piece(tile)?, border.ids());
        for triangle in surface(&piece, &ids, ghosts) {
            let corners = triangle.map(|v| piece.mesh.positions()[v as usize]);
            let boxed = Aabb::of_points(&corners);
            let mut wall = Wall {
                tile: tile as u64,
                ids: triangle.map(|v| ids[v as usize]),
                corners: corners.map(Into::into),
            };
            let mut alone = true;
            for (other, _) in others.iter().filter(|other| other.1.intersects(&boxed)) {
                alone = false;
                wall.tile = *other;
                to[deal.rank_of(*other as usize)].push(wall);
            }
            if !alone {
                wall.tile = tile as u64;
                to[exchange.rank()].push(wall);
            }
        }
    }
    let mut walls: Vec<Wall> = exchanged(exchange, &to)?.concat();
    walls.sort_unstable_by_key(|wall| (wall.tile, wall.ids));
    let mut bad = Vec::new();
    for walls in walls.chunk_by(|a, b| a.tile == b.tile) {
        let mesh = joined(walls)?;
        bad.extend(crossing_pairs(&mesh).into_iter().map(|[t, _]| {
            let corners = walls[t as usize].corners.map(Point3::from);
            let place = corners
                .iter()
                .map(|x| x.coords / 3.0)
                .sum::<geom_core::Vector3>();
            Bad {
                place: place.into(),
                tile: walls[0].tile,
            }
        }));
    }
    Ok(bad)
}

/// Triangles that share the vertices of one number.
fn joined(walls: &[Wall]) -> Result<TriMesh, Failure> {
    let mut known: Vec<(u64, [f64; 3])> = walls
        .iter()
        .flat_map(|wall| wall.ids.into_iter().zip(wall.corners))
        .collect();
    known.sort_unstable_by_key(|k| k.0);
    known.dedup_by_key(|k| k.0);
    let place = |id: u64| known.partition_point(|k| k.0 < id) as u32;
    let triangles = walls.iter().map(|wall| wall.ids.map(place)).collect();
    let positions = known.iter().map(|k| Point3::from(k.1)).collect();
    Ok(TriMesh::new(positions, triangles)?)
}
