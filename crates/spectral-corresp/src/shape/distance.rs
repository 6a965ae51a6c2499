//! Exact Euclidean distances on a lattice (Meijster, Roerdink and Hesselink, *A general algorithm for computing distance
//! transforms in linear time*, 2000): squares are integers, so nothing is rounded.
//!
//! The square of a distance in space is a sum over the axes, so that it is found axis by axis: first along x within
//! each row, then with the parabolas `(t − u)² + g(u)` along z and along y. Each point is read a fixed number of times,
//! whatever the distances are.

use geom_core::compute::parallel;

/// The square of the distance of each lattice point to the nearest one that is not `inside`, in spacings; what lies
/// beyond the lattice is outside. `counts` are points per axis, the first fastest.
pub(crate) fn squared_distances(counts: [usize; 3], inside: &[bool], rows: &mut Vec<u32>) {
    let [nx, ny, nz] = counts;
    // Along the first axis: how far to the nearest end of a run.
    rows.clear();
    rows.resize(inside.len(), 0);
    parallel::for_chunks(rows, nx.max(1), |at, row| {
        let inside = &inside[at * nx..][..row.len()];
        let mut run = 0;
        for (d, &inside) in row.iter_mut().zip(inside) {
            run = if inside { run + 1 } else { 0 };
            *d = run;
        }
        let mut run = 0;
        for (d, &inside) in row.iter_mut().zip(inside).rev() {
            run = if inside { run + 1 } else { 0 };
            *d = run.min(*d);
        }
    });
    for d in rows.iter_mut() {
        *d = d.saturating_mul(*d);
    }
    // Along the third axis, into columns of it: [y][x][z].
    let mut columns = vec![0u32; inside.len()];
    let mut lines: Vec<&mut [u32]> = columns.chunks_mut(nz.max(1)).collect();
    parallel::for_each_init(&mut lines, Envelope::default, |envelope, xy, out| {
        let line = |z: usize| rows[xy + nx * ny * z];
        envelope.lower(nz, line, out);
    });
    // Along the second axis, slab by slab, and back into the order of the lattice.
    parallel::for_chunks(rows, (nx * ny).max(1), |z, slab| {
        let (mut envelope, mut lowest) = (Envelope::default(), vec![0; ny]);
        for x in 0..nx {
            envelope.lower(ny, |y| columns[(x + nx * y) * nz + z], &mut lowest);
            for (y, &d) in lowest.iter().enumerate() {
                slab[x + nx * y] = d;
            }
        }
    });
}

/// The lower envelope of parabolas over a line.
#[derive(Default)]
struct Envelope {
    /// Vertices of the parabolas on the envelope, their heights, and from where on each is lowest.
    parabolas: Vec<(i64, i64, i64)>,
}

impl Envelope {
    /// `out[t] = min over u of (t − u)² + line(u)`, where `u` goes one beyond the line on both sides and `line` is 0
    /// there.
    /// Each parabola is put on once and taken off at most once. Where two meet, the later one counts: the values are
    /// the same.
    fn lower(&mut self, n: usize, line: impl Fn(usize) -> u32, out: &mut [u32]) {
        let (n, parabolas) = (n as i64, &mut self.parabolas);
        parabolas.clear();
        for u in -1..=n {
            let height = if u < 0 || u == n {
                0
            } else {
                i64::from(line(u as usize))
            };
            let mut from = -1;
            while let Some(&(v, g, start)) = parabolas.last() {
                // From where on the new one is at most as high as the last.
                let meet = (u * u - v * v + height - g).div_euclid(2 * (u - v)) + 1;
                if meet > start {
                    from = meet;
                    break;
                }
                parabolas.pop();
            }
            if from <= n {
                parabolas.push((u, height, from));
            }
        }
        let mut at = 0;
        for t in 0..n {
            while at + 1 < parabolas.len() && parabolas[at + 1].2 <= t {
                at += 1;
            }
            let (u, height, _) = parabolas[at];
            out[t as usize] = ((t - u) * (t - u) + height).min(u32::MAX.into()) as u32;
        }
    }
}
