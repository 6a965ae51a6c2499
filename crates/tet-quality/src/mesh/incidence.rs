//! The tetrahedra around each vertex.
//!
//! A list per vertex would be a million small allocations. Here all lists are spans of one array, each with room for a
//! quarter and four more than it has at first; one that outgrows its room moves to the end and leaves its old place
//! unused. The order in a span tells nothing, but is the same in every run.

/// No vertex: the corners of an empty slot.
pub(crate) const NONE: u32 = u32::MAX;

/// The tetrahedra around each vertex, in one pool with room to grow.
/// Every tetrahedron that is not an empty slot stands exactly once in the spans of its four corners.
#[derive(Clone)]
pub(crate) struct Incidence {
    spans: Vec<Span>,
    pool: Vec<u32>,
}

/// `len` entries of `pool` from `start` on, of `room` that are its own.
#[derive(Clone, Copy, Default)]
struct Span {
    start: usize,
    len: u32,
    room: u32,
}

impl Incidence {
    /// Two passes over the tetrahedra: count, then fill, so that spans are in order of their numbers at first.
    pub(super) fn new(vertices: usize, tets: &[[u32; 4]]) -> Self {
        let mut counts = vec![0u32; vertices];
        for &v in tets.iter().flatten() {
            counts[v as usize] += 1;
        }
        let mut start = 0;
        let mut spans: Vec<Span> = counts
            .iter()
            .map(|&n| {
                let room = n + n / 4 + 4;
                let span = Span {
                    start,
                    len: 0,
                    room,
                };
                start += room as usize;
                span
            })
            .collect();
        let mut pool = vec![NONE; start];
        for (t, tet) in tets.iter().enumerate() {
            for &v in tet {
                let span = &mut spans[v as usize];
                pool[span.start + span.len as usize] = t as u32;
                span.len += 1;
            }
        }
        Self { spans, pool }
    }

    /// The tetrahedra around `v`; none of a vertex that has vanished.
    pub(crate) fn of(&self, v: u32) -> &[u32] {
        let s = self.spans[v as usize];
        &self.pool[s.start..s.start + s.len as usize]
    }

    /// Without room: the first tetrahedron moves it to the end of the pool.
    pub(super) fn add_vertex(&mut self) {
        self.spans.push(Span::default());
    }

    /// Doubles the room of a span that is full: a constant number of copies per tetrahedron on the whole.
    pub(super) fn push(&mut self, v: u32, t: u32) {
        let mut s = self.spans[v as usize];
        if s.len == s.room {
            let old = s.start..s.start + s.len as usize;
            s.start = self.pool.len();
            s.room = s.room * 2 + 8;
            self.pool.extend_from_within(old);
            self.pool.resize(s.start + s.room as usize, NONE);
        }
        self.pool[s.start + s.len as usize] = t;
        s.len += 1;
        self.spans[v as usize] = s;
    }

    /// The last entry takes the place of the one that goes. Panics if `t` is not there: then a change went past the
    /// gate.
    pub(super) fn remove(&mut self, v: u32, t: u32) {
        let s = &mut self.spans[v as usize];
        let ring = &mut self.pool[s.start..s.start + s.len as usize];
        let at = ring
            .iter()
            .position(|&r| r == t)
            .expect("a tetrahedron stands in the incidence of its corners");
        ring.swap_remove_last(at);
        s.len -= 1;
    }
}

trait SwapRemove {
    fn swap_remove_last(&mut self, at: usize);
}
impl SwapRemove for [u32] {
    fn swap_remove_last(&mut self, at: usize) {
        self.swap(at, self.len() - 1);
    }
}
