//! The tetrahedra around each vertex.

/// No vertex: the corners of an empty slot.
pub(crate) const NONE: u32 = u32::MAX;

/// The tetrahedra around each vertex, in one pool with room to grow.
#[derive(Clone)]
pub(crate) struct Incidence {
    spans: Vec<Span>,
    pool: Vec<u32>,
}

#[derive(Clone, Copy, Default)]
struct Span {
    start: usize,
    len: u32,
    room: u32,
}

impl Incidence {
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

    pub(crate) fn of(&self, v: u32) -> &[u32] {
        let s = self.spans[v as usize];
        &self.pool[s.start..s.start + s.len as usize]
    }

    pub(super) fn add_vertex(&mut self) {
        self.spans.push(Span::default());
    }

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
