//! From values and options to the complex: the steps that surface and volume share.
//!
//! The road of both verbs is `setup` (what is sampled, and whether it can be), `trees` (the octree that the method
//! needs), `memory` (what the mesh will take), then one of three meshers: `dual` over the complex, `stuffing` over the
//! same complex, or `uniform` for a surface of cells of one size. `resolution` goes down that road several times to
//! find a spacing; `tile` goes down it for a window. Each step that takes long tells the watcher, who may stop it
//! there.

use crate::complex::{Complex, Kinds};
use crate::dual::{Duals, Emitter, Ends, Probe, Want};
use crate::octree::{self, Domain, Octree, Samples};
use crate::{AtBox, Error, Extent, Method, Options};
use geom_core::mesh::{INTERIOR, Region};
use geom_core::{ImplicitField, LatticeValues};

pub(crate) mod memory;
mod raw;
mod report;
mod resolution;
mod setup;
pub(crate) mod stuffing;
mod surface;
mod tile;
mod trees;
mod uniform;
mod volume;

pub use report::Report;
pub use surface::{Surface, surface};
pub use tile::{HALO, LARGEST, tile};
pub use volume::{Volume, volume};

use crate::backend::On;
use raw::Raw;
use setup::{Purpose, sampled};

/// A mesh, where it lies, and how it came about.
pub(crate) struct Contour {
    /// Positions in finest cells.
    pub(crate) raw: Raw,
    pub(crate) domain: Domain,
    pub(crate) report: Report,
}

/// Makes the mesh that options and purpose ask for.
/// With a resolution that is a spacing already.
pub(crate) fn contour<V: LatticeValues + ?Sized>(
    values: &V,
    field: Option<&dyn ImplicitField>,
    options: &Options,
    purpose: Purpose,
    run: On<'_>,
) -> Result<Contour, Error> {
    let (samples, report) = sampled(values, field, options, purpose, run)?;
    let probe = Probe::new(&samples, field, options);
    mesh(&samples, &probe, options, purpose, report, run)
}

/// Are all cells with a surface finest, with nothing but molecule and exterior, off the box?
/// Then the signs of the values say all that an octree could, and the surface is made without one.
pub(crate) fn is_uniform(options: &Options) -> bool {
    options.has_one_size()
        && options.materials.is_empty()
        && options.at_box != AtBox::Clip
        && options.method == Method::DualContour
}

/// How often leaves whose points would stick out are split: each time leaves about a twentieth of them,
/// and each time the octree is made again.
/// Where all cells with an interface are finest there are none.
const SPIKE_ROUNDS: u32 = 4;

/// Makes the mesh of what has been sampled.
fn mesh(
    samples: &Samples<'_>,
    probe: &Probe<'_>,
    options: &Options,
    purpose: Purpose,
    mut report: Report,
    run: On<'_>,
) -> Result<Contour, Error> {
    let mesher = Mesher {
        samples,
        probe,
        options,
        purpose,
        near: None,
    };
    let raw = mesher.mesh(&mut report, run)?;
    report.added_vertices = raw.added;
    report.triangles = raw.triangles.len();
    report.tets = raw.tets.len();
    run.progress(mesher.stage(), 1, 1)?;
    Ok(Contour {
        raw,
        domain: samples.domain,
        report,
    })
}

/// What both methods read.
struct Mesher<'a> {
    samples: &'a Samples<'a>,
    probe: &'a Probe<'a>,
    options: &'a Options,
    purpose: Purpose,
    /// The finest cells `low..high` whose tetrahedra are wanted, with what they depend on; `None`: all.
    near: Option<[[i32; 3]; 2]>,
}

impl Mesher<'_> {
    /// What the watcher is told.
    fn stage(&self) -> &'static str {
        match self.purpose {
            Purpose::Surface => "triangles",
            Purpose::Volume(_) => "tetrahedra",
        }
    }

    /// Is a region meshed?
    fn keeps(&self, region: Region) -> bool {
        match self.purpose {
            Purpose::Surface => false,
            Purpose::Volume(extent) => extent.holds(region),
        }
    }

    /// A surface or an interior mesh stops short of the box, unless the box cuts it.
    /// Then no ghosts are made, and rings that are open are left out.
    fn ends(&self) -> Ends {
        match self.purpose {
            Purpose::Surface | Purpose::Volume(Extent::Interior)
                if self.options.at_box != AtBox::Clip =>
            {
                Ends::OffBox
            }
            _ => Ends::AtBox,
        }
    }

    /// By the method that was asked for.
    fn mesh(&self, report: &mut Report, run: On<'_>) -> Result<Raw, Error> {
        match self.options.method {
            Method::DualContour => self.dual_contour(report, run),
            Method::Stuffing => self.stuff(report, run),
        }
    }

    /// Dual contouring. The octree is made again while points of large leaves would stick out of the surface.
    /// Leaves that a round has not changed keep their points, so a later round costs little but the tree.
    fn dual_contour(&self, report: &mut Report, run: On<'_>) -> Result<Raw, Error> {
        let (samples, ends) = (self.samples, self.ends());
        run.progress("octree", 0, 1)?;
        let mut splits = octree::splits(samples, self.options);
        let mut before = None;
        let mut rounds = 0..SPIKE_ROUNDS;
        loop {
            let (tree, kinds) = trees::adapted(samples, self.options, &mut splits)?;
            let complex = self.complex(&tree, kinds, report)?;
            run.progress("dual vertices", 0, 1)?;
            let duals = Duals::new(&complex, self.probe, ends, before.as_ref(), run.backend)?;
            let spikes = duals.spikes(&complex);
            if spikes.is_empty() || rounds.next().is_none() {
                report.split_cells = complex.splits.len();
                report.clamped = duals.clamped();
                run.progress(self.stage(), 0, 1)?;
                return Ok(self.emit(&complex, &duals));
            }
            for id in spikes {
                splits.split(samples.domain.blocks, complex.leaf(id));
            }
            drop(complex);
            before = Some((tree, duals));
        }
    }

    /// Triangles and tetrahedra of placed dual vertices.
    fn emit(&self, complex: &Complex<'_>, duals: &Duals) -> Raw {
        let keep = |r| self.keeps(r);
        // Where the box closes the molecule, its lattice points there are corners of the surface.
        let corners = |r| keep(r) || self.ends() == Ends::AtBox && r == INTERIOR;
        let emitter = Emitter::new(complex, duals, self.probe, corners);
        let emission = emitter.emit(&Want {
            tets: self.purpose != Purpose::Surface,
            region: keep,
            near: self.near,
        });
        Raw::from_emission(&emitter, emission, keep)
    }

    /// Isosurface stuffing.
    /// It always reaches up to the box: what snaps shall not depend on what is wanted.
    fn stuff(&self, report: &mut Report, run: On<'_>) -> Result<Raw, Error> {
        run.progress("octree", 0, 1)?;
        let mut splits = octree::splits(self.samples, self.options);
        let (tree, kinds) = trees::even(self.samples, self.options, &mut splits)?;
        let complex = self.complex(&tree, kinds, report)?;
        run.progress(self.stage(), 0, 1)?;
        let keep = |r| self.keeps(r);
        let at_box = self.options.at_box;
        let (raw, counts) = stuffing::mesh(&complex, self.probe, at_box, self.near, keep)?;
        (report.snapped, report.clamped) = (counts.snapped, counts.clamped);
        Ok(raw)
    }

    /// The complex of an octree, its leaves counted.
    ///
    /// # Errors
    /// [`Error::TooLarge`], from the counts of leaves alone.
    fn complex<'a>(
        &'a self,
        tree: &'a Octree,
        kinds: Kinds,
        report: &mut Report,
    ) -> Result<Complex<'a>, Error> {
        memory::check_mesh(
            tree,
            &kinds,
            self.options.method,
            self.purpose,
            self.samples.stored_bytes(),
            self.options.max_memory,
        )?;
        let complex = Complex::new(self.samples, tree, kinds);
        report.leaves = tree.leaves.iter().filter(|l| !l.void).count();
        report.surface_cells = (0..tree.leaves.len() as u32)
            .filter(|&id| complex.is_interface(id))
            .count();
        Ok(complex)
    }
}

/// What holds here, for the tests.
#[cfg(feature = "testing")]
pub(crate) mod laws {
    use super::setup::site;
    use super::*;
    use crate::complex::{Cell, Corner, Interfaces};
    use crate::octree::{BLOCK_LOG, Labels, Source, Splits};
    use geom_core::compute::sets::DisjointSets;
    use geom_core::mesh::{EXTERIOR, six_volume};
    use geom_core::{Cpu, Lattice, Point3, ScalarGrid};
    use std::collections::{BTreeMap, BTreeSet};

    /// Number of sets among the members that are asked for.
    fn sets(groups: DisjointSets, member: impl Fn(usize) -> bool) -> usize {
        let roots = groups.into_roots();
        let mut found: Vec<u32> = (0..roots.len())
            .filter(|&i| member(i))
            .map(|i| roots[i])
            .collect();
        found.sort_unstable();
        found.dedup();
        found.len()
    }

    /// A lattice of `n` cells per axis whose points are inside at random, but none on the box.
    fn noise(n: usize, seed: u64, density: f64) -> ScalarGrid {
        let lattice = Lattice {
            origin: Point3::origin(),
            spacing: 1.0,
            counts: [n + 1; 3],
        };
        let mut state = seed;
        let values = (0..lattice.len())
            .map(|i| {
                state = state
                    .wrapping_mul(6_364_136_223_846_793_005)
                    .wrapping_add(1);
                let random = (state >> 33) as f64 / (1u64 << 31) as f64;
                let p = lattice.coordinates(i);
                let margin = p.iter().any(|&c| c == 0 || c == n);
                if random < density && !margin {
                    1.5
                } else {
                    1.0 - random as f32 - 0.1
                }
            })
            .collect();
        ScalarGrid::new(lattice, values).unwrap()
    }

    /// The samples of a grid with plain labels.
    fn plain(grid: &ScalarGrid) -> Samples<'_> {
        let options = Options::default();
        let purpose = Purpose::Volume(Extent::Both);
        let site = site(grid.lattice(), 1.0, &options, purpose, false).unwrap();
        let labels = Labels {
            level: 1.0,
            materials: Vec::new(),
            outer: site.outer,
        };
        let source = Source::Aligned {
            values: grid,
            shift: site.shift,
            outside: 0.0,
        };
        let mut samples = Samples::new(source, site.domain, labels, u64::MAX).unwrap();
        samples.find_crossings();
        samples
    }

    /// Leaves are simple if a flood along the edges of the complex reaches all of their corners of each
    /// label. Here the edges are found from all leaves, not from tables or neighbours.
    pub fn leaves_are_simple_as_a_flood_says() {
        let corner = |o: [i32; 3], s: i32, i: i32| [0, 1, 2].map(|k| o[k] + s * (i >> k & 1));
        // Simple and not, per size of the leaf.
        let mut seen = [[0; 2]; 4];
        for (seed, density) in [(1u64, 0.01), (2, 0.04), (3, 0.1), (4, 0.3), (5, 0.5)] {
            let grid = noise(32, seed, density);
            let samples = plain(&grid);
            let domain = samples.domain;
            let mut splits = Splits::none(domain.blocks, BLOCK_LOG);
            for (b, two) in splits.two.iter_mut().enumerate() {
                // A few cells of size 2, none in most blocks.
                if b % 9 == 0 {
                    *two = 1 << ((7 * b + 5 * seed as usize) % 64);
                }
            }
            let tree = Octree::new(domain.cells, &splits, u64::MAX).unwrap();
            let kinds = Kinds::of(&samples, &tree, Interfaces::OfAnySize);
            let mut split = kinds.large(&tree);
            split.extend(kinds.cut(&tree));
            let interfaces: BTreeSet<u32> = kinds.interfaces().collect();

            let leaves = || tree.leaves.iter().filter(|leaf| !leaf.void);
            let points: BTreeSet<[i32; 3]> = leaves()
                .flat_map(|leaf| (0..8).map(|i| corner(leaf.origin(), leaf.size(), i)))
                .collect();
            let mut edges: BTreeMap<[i32; 3], Vec<[i32; 3]>> = BTreeMap::new();
            for leaf in leaves() {
                let (o, s) = (leaf.origin(), leaf.size());
                for (i, axis) in (0..8).flat_map(|i| (0..3).map(move |axis| (i, axis))) {
                    let (p, q) = (corner(o, s, i), corner(o, s, i ^ 1 << axis));
                    let between = |t: i32| [0, 1, 2].map(|k| p[k] + (q[k] - p[k]).signum() * t);
                    if (1..s).all(|t| !points.contains(&between(t))) {
                        edges.entry(p).or_default().push(q);
                    }
                }
            }
            for (id, leaf) in tree.leaves.iter().enumerate().filter(|(_, l)| !l.void) {
                let (o, s) = (leaf.origin(), leaf.size());
                let within = |p: &[i32; 3]| (0..3).all(|k| (o[k]..=o[k] + s).contains(&p[k]));
                let corners: Vec<[i32; 3]> = points.iter().filter(|p| within(p)).copied().collect();
                let groups = [true, false].map(|inside| {
                    let ours = |p: &[i32; 3]| (samples.label(*p) == INTERIOR) == inside;
                    let mut left: BTreeSet<[i32; 3]> =
                        corners.iter().filter(|p| ours(p)).copied().collect();
                    let mut groups = 0;
                    while let Some(first) = left.pop_first() {
                        groups += 1;
                        let mut front = vec![first];
                        while let Some(p) = front.pop() {
                            front.extend(edges[&p].iter().filter(|q| left.remove(*q)));
                        }
                    }
                    groups
                });
                let (mixed, simple) = (!groups.contains(&0), groups.iter().all(|&g| g <= 1));
                let id = id as u32;
                assert_eq!(interfaces.contains(&id), mixed, "{leaf:?}");
                assert_eq!(split.contains(&id), !simple, "{leaf:?}, {groups:?}");
                if mixed {
                    seen[usize::from(leaf.log)][usize::from(simple)] += 1;
                }
            }
        }
        assert!(
            seen.iter().flatten().all(|&n| n >= 5),
            "too few of a sort: {seen:?}"
        );
    }

    /// On random labels, ambiguous everywhere: the parts of each region are those of the corners with
    /// its label in the graph of the complex's edges.
    pub fn parts_are_those_of_the_graph_of_the_complex() {
        for (seed, density) in [(1u64, 0.2), (2, 0.35), (3, 0.6)] {
            let grid = noise(32, seed, density);
            let samples = plain(&grid);
            let options = Options::default();
            let mut splits = octree::splits(&samples, &options);
            let (tree, kinds) = trees::adapted(&samples, &options, &mut splits).unwrap();
            let complex = Complex::new(&samples, &tree, kinds);
            let probe = Probe::new(&samples, None, &options);
            let duals = Duals::new(&complex, &probe, Ends::AtBox, None, &Cpu).unwrap();
            let emitter = Emitter::new(&complex, &duals, &probe, |_| true);
            let emission = emitter.emit(&Want {
                tets: true,
                region: |_| true,
                near: None,
            });
            assert!(complex.splits.len() > 1000);
            let raw = Raw::from_emission(&emitter, emission, |_| true);
            assert!(
                raw.tets
                    .iter()
                    .all(|t| six_volume(t.map(|v| raw.positions[v as usize])) > 0.0)
            );
            for region in [INTERIOR, EXTERIOR] {
                let mut of_tets = DisjointSets::new(raw.positions.len());
                let mut used = vec![false; raw.positions.len()];
                for (t, _) in raw.tets.iter().zip(&raw.regions).filter(|t| *t.1 == region) {
                    t.iter().for_each(|&v| {
                        used[v as usize] = true;
                        of_tets.join(t[0], v);
                    });
                }
                let mut graph = DisjointSets::new(raw.positions.len());
                let mut corner = vec![false; raw.positions.len()];
                for id in 0..tree.leaves.len() as u32 {
                    complex.rings_of(
                        id,
                        |_, _| true,
                        |ring| {
                            let [a, b] =
                                [ring.a.0, ring.b.0].map(|c| emitter.numbering.corner(c) as usize);
                            corner[a] |= ring.a.1 == region;
                            corner[b] |= ring.b.1 == region;
                            if ring.a.1 == region && ring.b.1 == region {
                                graph.join(a as u32, b as u32);
                            }
                        },
                    );
                }
                let (ours, theirs) = (sets(of_tets, |v| used[v]), sets(graph, |v| corner[v]));
                assert_eq!(ours, theirs, "region {region} at density {density}");
                assert!(theirs > 1 || region == EXTERIOR || density > 0.3);
            }
        }
    }

    /// Two leaves that face each other across both halves of an edge are joined by a diagonal from one half alone:
    /// else four triangles would meet in it.
    pub fn a_diagonal_that_two_edges_want_is_given_to_one() {
        let (mut wanted, mut free) = (0, 0);
        for seed in 1..6 {
            let grid = noise(32, seed, 0.3);
            let samples = plain(&grid);
            let mut splits = Splits::none(samples.domain.blocks, BLOCK_LOG);
            for (b, two) in splits.two.iter_mut().enumerate() {
                if b % 5 == 0 {
                    *two = 1 << ((11 * b + 3 * seed as usize) % 64);
                }
            }
            let tree = Octree::new(samples.domain.cells, &splits, u64::MAX).unwrap();
            let kinds = Kinds::of(&samples, &tree, Interfaces::OfAnySize).unsplit();
            let complex = Complex::new(&samples, &tree, kinds);
            // Per pair of leaves larger than an edge between them: whether the edge may join them.
            let mut may: BTreeMap<[Cell; 2], Vec<bool>> = BTreeMap::new();
            for id in 0..tree.leaves.len() as u32 {
                complex.rings_of(
                    id,
                    |_, _| true,
                    |ring| {
                        let (Corner::Point(a), Corner::Point(b)) = (ring.a.0, ring.b.0) else {
                            unreachable!("no leaf is split");
                        };
                        let length: i32 = (0..3).map(|k| b[k] - a[k]).sum();
                        let larger = |c: &Cell| match c {
                            Cell::Leaf(id) => complex.leaf(*id).size() > length,
                            _ => false,
                        };
                        if ring.open || ring.cells.len() != 4 {
                            assert_eq!(ring.reserved, None);
                            return;
                        }
                        for k in 0..2 {
                            let mut pair = [ring.cells[k], ring.cells[k + 2]];
                            pair.sort_unstable();
                            if pair.iter().all(larger) {
                                let is_free = ring.reserved != Some(k as u8);
                                may.entry(pair).or_default().push(is_free);
                            } else {
                                assert_ne!(ring.reserved, Some(k as u8));
                            }
                        }
                    },
                );
            }
            for edges in may.values() {
                assert!(edges.len() <= 2);
                let joined = edges.iter().filter(|free| **free).count();
                assert!(joined <= 1, "{joined} edges may join two leaves");
                wanted += usize::from(edges.len() == 2);
                free += joined;
            }
        }
        assert!(
            wanted > 20 && free > 20,
            "{wanted} diagonals wanted twice, {free} free"
        );
    }

    /// A leaf is split where its error is above the tolerance, and not below it.
    pub fn leaves_are_split_at_the_tolerance() {
        // A paraboloid whose level set passes the middle of the one block that there is.
        let lattice = Lattice {
            origin: Point3::origin(),
            spacing: 0.5,
            counts: [9; 3],
        };
        let value = |p: [usize; 3]| {
            let [x, y, z] = p.map(|c| 0.5 * c as f64 - 2.0);
            1.0 - z - 0.05 * (x * x + y * y)
        };
        let values = (0..lattice.len())
            .map(|i| value(lattice.coordinates(i)) as f32)
            .collect();
        let grid = ScalarGrid::new(lattice, values).unwrap();
        // By hand: the interpolant of the corners is 1 − z − 0.4, off by 0.2 per coordinate x and y that is in the
        // middle; its gradient has length 1. Of the 27 points of the half lattice 9 have x in the middle, 9 have y.
        let error = (9.0 + 9.0) * 0.2;
        for (share, expected) in [(1.01, false), (0.99, true), (0.6, true), (1.9, false)] {
            let options = Options {
                tolerance: share * error,
                at_box: AtBox::Clip,
                ..Options::default()
            };
            let site = site(&lattice, 0.5, &options, Purpose::Surface, true).unwrap();
            let labels = Labels {
                level: 1.0,
                materials: Vec::new(),
                outer: None,
            };
            let source = Source::Aligned {
                values: &grid,
                shift: site.shift,
                outside: 0.0,
            };
            let mut samples = Samples::new(source, site.domain, labels, u64::MAX).unwrap();
            samples.find_crossings();
            let splits = octree::splits(&samples, &options);
            assert_eq!(splits.eight, [expected], "at {share} of the error");
        }
    }
}
