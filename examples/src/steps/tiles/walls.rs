//! Walls of narrow gaps that belong to different tiles: neither sees the other while it is improved.

use bytemuck::{Pod, Zeroable};
use dual_contour::Extent;
use geom_core::search::crossing::crossing_pairs;
use geom_core::tiles::border::{Asked, Border, Ghost, ghosts, number};
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
    exchange: &dyn Exchange,
    deal: &Deal,
    borders: &mut [Border],
) -> Result<Vec<Bad>, Failure> {
    if plan.contour.region == Extent::Both {
        return Ok(Vec::new());
    }
    number(exchange, deal, borders)?;
    let beyond = ghosts(exchange, deal, borders, &Asked::FIRST)?;
    let around = places(exchange, deal, borders)?;
    let mut to = vec![Vec::new(); deal.ranks];
    let own = deal.of(exchange.rank());
    for ((tile, border), ghosts) in own.zip(&*borders).zip(&beyond) {
        for wall in walls_near_others(plan, (tile, border), ghosts, &around)? {
            to[deal.rank_of(wall.tile as usize)].push(wall);
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

/// The boxes around the surfaces of all tiles that have one.
fn places(
    exchange: &dyn Exchange,
    deal: &Deal,
    borders: &[Border],
) -> Result<Vec<(u64, Aabb)>, Failure> {
    let own = deal.of(exchange.rank()).zip(borders);
    let around = own.filter_map(|(tile, border)| {
        let bounds = border.bounds?;
        Some(Around {
            tile: tile as u64,
            low: bounds.min.into(),
            high: bounds.max.into(),
        })
    });
    let all: Vec<Around> = gathered(exchange, &around.collect::<Vec<_>>())?.concat();
    let boxed = |a: &Around| (a.tile, Aabb::new(a.low.into(), a.high.into()));
    Ok(all.iter().map(boxed).collect())
}

/// The triangles of a tile's surface that others may cross: each for all tiles whose box it meets, and for its own, which
/// has to know it beside what comes from there.
fn walls_near_others(
    plan: &Plan<'_>,
    (tile, border): (usize, &Border),
    ghosts: &[Ghost],
    around: &[(u64, Aabb)],
) -> Result<Vec<Wall>, Failure> {
    let Some(bounds) = border.bounds else {
        return Ok(Vec::new());
    };
    let met = |other: &&(u64, Aabb)| other.0 != tile as u64 && other.1.intersects(&bounds);
    let others: Vec<&(u64, Aabb)> = around.iter().filter(met).collect();
    if others.is_empty() {
        return Ok(Vec::new());
    }
    let mut walls = Vec::new();
    let (piece, ids) = (plan.piece(tile)?, border.ids());
    for triangle in surface(&piece, &ids, ghosts) {
        let corners = triangle.map(|v| piece.mesh.positions()[v as usize]);
        let boxed = Aabb::of_points(&corners);
        let near = others.iter().filter(|other| other.1.intersects(&boxed));
        let mut told: Vec<u64> = near.map(|other| other.0).collect();
        if told.is_empty() {
            continue;
        }
        told.push(tile as u64);
        walls.extend(told.into_iter().map(|tile| Wall {
            tile,
            ids: triangle.map(|v| ids[v as usize]),
            corners: corners.map(Into::into),
        }));
    }
    Ok(walls)
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
