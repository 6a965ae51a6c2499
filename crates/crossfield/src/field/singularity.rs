//! Where a field turns: the index of each vertex, in quarters.

use super::frames::{Frames, QUARTER, modulo_quarter, previous};

/// Four times the index of every vertex: +1 for a vertex where three quads meet, −1 where five meet. On a
/// boundary, where the field is parallel to it, +1 is a convex corner.
///
/// Interior vertices count in integers, `4 I = 4 round((K − Σκ) / 2π) − Σp` over the half-edges that lead to the
/// vertex (Ray et al., *N-symmetry direction field design*, 2008), so the sum over a component is four
/// times its Euler characteristic, exactly.
///
/// `theta` counts at the boundary alone, where the angle between the field and the boundary closes the turn, and the
/// result is rounded: it means something if the field is nearly parallel to the boundary. Vertices without triangles
/// have 0.
pub fn indices(frames: &Frames, theta: &[f64], jump: &[i32]) -> Vec<i32> {
    (0..frames.edges().vertices())
        .map(|v| {
            if frames.edges().out(geom_core::VertexId(v as u32)).is_none() {
                0
            } else if frames.on_boundary(v) {
                boundary_index(frames, theta, jump, v)
            } else {
                interior_index(frames, jump, v)
            }
        })
        .collect()
}

/// The index of an interior vertex depends on the period jumps alone.
pub(crate) fn interior_index(frames: &Frames, jump: &[i32], v: usize) -> i32 {
    let (mut turn, mut jumps) = (0.0, 0);
    for out in frames.around(v) {
        let h = frames.twin(out).expect("an interior vertex");
        turn += frames.transport(h);
        jumps += jump[h];
    }
    4 * ((frames.defect(v) - turn) / std::f64::consts::TAU).round() as i32 - jumps
}

/// `4 I = (2/π) (K + Σδ + o(out) − o(in))`: o is the angle from the boundary to the nearest arm.
fn boundary_index(frames: &Frames, theta: &[f64], jump: &[i32], v: usize) -> i32 {
    let mut total = frames.defect(v);
    let mut last = 0;
    for (i, out) in frames.around(v).enumerate() {
        if i == 0 {
            total += off_side(frames, theta, out);
        } else {
            total += difference(
                frames,
                theta,
                jump,
                frames.twin(out).expect("inside of the fan"),
            );
        }
        last = out;
    }
    let incoming = super::frames::previous(last);
    total -= off_side(frames, theta, incoming);
    (total / QUARTER).round() as i32
}

/// δ = θ_j − θ_i − κ − (π/2) p: how far the field is from parallel across a half-edge.
pub(crate) fn difference(frames: &Frames, theta: &[f64], jump: &[i32], h: usize) -> f64 {
    let twin = frames.twin(h).expect("an interior edge");
    theta[twin / 3] - theta[h / 3] - frames.transport(h) - QUARTER * f64::from(jump[h])
}

/// The angle from a half-edge to the nearest arm of its triangle's cross.
fn off_side(frames: &Frames, theta: &[f64], h: usize) -> f64 {
    modulo_quarter(theta[h / 3] - frames.side_angle(h))
}

/// The lines of a field: sides of triangles to which hard guides make it parallel.
pub(super) struct Lines {
    /// Per half-edge.
    is_line: Vec<bool>,
    /// Vertices on lines or boundaries, whose indices are not for trade.
    held: Vec<bool>,
}

/// The triangles around a vertex from one line to the next.
pub(super) struct Sector {
    /// Its angle, radians.
    angle: f64,
    /// The half-edges between its triangles, counter-clockwise, all leading to the vertex.
    pub(super) inside: Vec<usize>,
}

impl Lines {
    /// Those of the half-edges `along`.
    pub(super) fn of(frames: &Frames, along: impl Iterator<Item = usize>) -> Self {
        let mut is_line = vec![false; frames.edges().len()];
        let mut held: Vec<bool> = (0..frames.edges().vertices())
            .map(|v| {
                let used = frames.edges().out(geom_core::VertexId(v as u32)).is_some();
                used && frames.on_boundary(v)
            })
            .collect();
        for h in along {
            is_line[h] = true;
            (held[frames.from(h)], held[frames.to(h)]) = (true, true);
            if let Some(twin) = frames.twin(h) {
                is_line[twin] = true;
            }
        }
        Self { is_line, held }
    }

    /// Is a vertex on a line or boundary?
    pub(super) fn hold(&self, vertex: usize) -> bool {
        self.held[vertex]
    }

    /// What the lines at a vertex leave between them; nothing next to a boundary that is no line.
    pub(super) fn sectors(&self, frames: &Frames, vertex: usize) -> Vec<Sector> {
        let mut fan: Vec<usize> = frames.around(vertex).collect();
        let open = frames.on_boundary(vertex);
        let Some(first) = fan.iter().position(|&h| self.is_line[h]) else {
            return Vec::new();
        };
        if !open {
            fan.rotate_left(first);
        }
        let mut sectors = Vec::new();
        let mut sector: Option<Sector> = None;
        for out in fan {
            if self.is_line[out] {
                sectors.extend(sector.take());
                sector = Some(Sector {
                    angle: 0.0,
                    inside: Vec::new(),
                });
            } else if let Some(sector) = &mut sector {
                sector.inside.extend(frames.twin(out));
            }
            if let Some(sector) = &mut sector {
                let back = frames.side_angle(previous(out)) + std::f64::consts::PI;
                sector.angle += (back - frames.side_angle(out)).rem_euclid(std::f64::consts::TAU);
            }
        }
        let closed = !open
            || frames
                .around(vertex)
                .last()
                .is_some_and(|h| self.is_line[previous(h)]);
        sectors.extend(sector.filter(|_| closed));
        sectors
    }
}

impl Sector {
    /// Quads that fit into its angle best; even into the sharpest one.
    pub(super) fn wanted(&self) -> i32 {
        ((self.angle / QUARTER).round() as i32).max(1)
    }

    /// Quads that a map of the field has there. Where two lines meet at less than half a right angle, the field takes them for
    /// one, and there are none.
    pub(super) fn quads(&self, frames: &Frames, theta: &[f64], jump: &[i32]) -> i32 {
        let inside = self.inside.iter();
        let turn: f64 = inside.map(|&h| difference(frames, theta, jump, h)).sum();
        ((self.angle - turn) / QUARTER).round() as i32
    }
}
