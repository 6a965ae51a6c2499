//! Handles and necks that are one or two quads wide: there a side of a quad returns to its vertex, or two sides have the same
//! ends, and the quads are no mesh. The path around such a place, one or two sides long, is a sum of the map's integers; that
//! it be three sides long at least is a condition on them.

use std::collections::BTreeMap;

use super::extract::{Place, Port, Ports, Sites};
use super::trace::{Paper, Walker};
use crate::Error;
use crate::field::frames::{next, previous};
use crate::map::exact::{cross, minus};
use crate::map::{AtLeast, Narrow, Spread};

/// So many sides around are a mesh.
const ENOUGH: i64 = 3;

/// Where the quads of a decimated map, with 2^nested sides on each of its lines, are no mesh.
pub(super) fn narrow(spread: &Spread, nested: u8) -> Narrow {
    around(spread, nested).unwrap_or_default()
}

fn around(spread: &Spread, nested: u8) -> Result<Narrow, Error> {
    let paper = Paper {
        net: spread.net(),
        map: &spread.map,
        finer: u32::from(nested),
    };
    let sites = Sites::of(&paper);
    let ports = Ports::of(&paper, &sites);
    let partner = ports.connected(&paper, &sites)?;
    let mut sides: BTreeMap<[u32; 2], Vec<usize>> = BTreeMap::new();
    for (p, &q) in partner.iter().enumerate() {
        let ends = [p, q as usize].map(|p| ports.all[p].site);
        if ends[0] <= ends[1] {
            sides.entry(ends).or_default().push(p);
        }
    }
    let least = (ENOUGH + (1 << nested) - 1) >> nested;
    let paths = Paths {
        paper,
        sites: &sites,
        ports: &ports.all,
        partner: &partner,
    };
    let mut found = Narrow::default();
    for (ends, sides) in sides {
        let is_loop = ends[0] == ends[1];
        if !is_loop && sides.len() == 1 {
            continue;
        }
        found.anywhere = true;
        let others = if is_loop { &sides[..] } else { &sides[1..] };
        for &other in others {
            let path = if is_loop {
                paths.around_one(spread, other, least)
            } else {
                paths.around_two(spread, sides[0], other, least)
            };
            found.wider.extend(path);
        }
    }
    Ok(found)
}

/// Closed paths along sides.
struct Paths<'a> {
    paper: Paper<'a>,
    sites: &'a Sites,
    ports: &'a [Port],
    partner: &'a [u32],
}

impl Paths<'_> {
    /// Along a side that returns to its vertex.
    fn around_one(&self, spread: &Spread, p: usize, least: i64) -> Option<AtLeast> {
        [true, false].into_iter().find_map(|turn| {
            let mut crossed = Vec::new();
            let end = self.along(p, &mut crossed)?;
            self.about(self.ports[p].site, end, &self.ports[p], turn, &mut crossed)?;
            spread.longer(&crossed, self.corner(&self.ports[p]), least)
        })
    }

    /// Along one side and back along another one with the same ends.
    fn around_two(&self, spread: &Spread, p: usize, q: usize, least: i64) -> Option<AtLeast> {
        let back = self.partner[q] as usize;
        let turns = [[true, true], [false, false], [true, false], [false, true]];
        turns.into_iter().find_map(|[there, here]| {
            let mut crossed = Vec::new();
            let end = self.along(p, &mut crossed)?;
            self.about(
                self.ports[back].site,
                end,
                &self.ports[back],
                there,
                &mut crossed,
            )?;
            let end = self.along(back, &mut crossed)?;
            self.about(self.ports[p].site, end, &self.ports[p], here, &mut crossed)?;
            spread.longer(&crossed, self.corner(&self.ports[p]), least)
        })
    }

    /// Walks along a side.
    fn along(&self, p: usize, crossed: &mut Vec<usize>) -> Option<Walker> {
        let walker = self.ports[p].walker(self.paper.unit());
        self.paper.crossed(walker, crossed).ok().flatten()
    }

    /// The corner where a side begins, if its vertex is one of the map's.
    fn corner(&self, port: &Port) -> Option<usize> {
        match self.sites.places[port.site as usize] {
            Place::Vertex(_) => self.corner_at(port.face, port.at),
            _ => None,
        }
    }

    fn corner_at(&self, face: usize, at: [i64; 2]) -> Option<usize> {
        (3 * face..3 * face + 3).find(|h| self.paper.map.corners[face][h % 3] == at)
    }

    /// From where a walk has ended to where another one begins, both at one vertex, about it.
    fn about(
        &self,
        site: u32,
        end: Walker,
        port: &Port,
        counterclockwise: bool,
        crossed: &mut Vec<usize>,
    ) -> Option<()> {
        let net = self.paper.net;
        match self.sites.places[site as usize] {
            Place::Face(..) => Some(()),
            Place::Edge(..) => {
                if (end.face, end.target) == (port.face, port.at) {
                    return Some(());
                }
                let uv = &self.paper.map.corners[end.face];
                let over = (3 * end.face..3 * end.face + 3).find(|&h| {
                    let (a, b) = (uv[h % 3], uv[next(h) % 3]);
                    let twin = net.twin(h);
                    cross(minus(b, a), minus(end.target, a)) == 0
                        && twin.is_some_and(|t| {
                            t / 3 == port.face && self.paper.across(h, t, end.target) == port.at
                        })
                })?;
                crossed.push(over);
                Some(())
            }
            Place::Vertex(_) => {
                let first = self.corner_at(end.face, end.target)?;
                let wanted = self.corner_at(port.face, port.at)?;
                let mut corner = first;
                while corner != wanted {
                    let over = if counterclockwise {
                        previous(corner)
                    } else {
                        corner
                    };
                    let twin = net.twin(over)?;
                    crossed.push(over);
                    corner = if counterclockwise { twin } else { next(twin) };
                    if corner == first {
                        return None;
                    }
                }
                Some(())
            }
        }
    }
}
