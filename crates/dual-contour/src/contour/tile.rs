//! Tetrahedra of a part of a lattice that is too large to be meshed at once.

use geom_core::grid::lattice::Window;
use geom_core::mesh::INTERIOR;
use geom_core::options::{OutOfRange, require};
use geom_core::tiles::Piece;
use geom_core::{ImplicitField, LatticeValues, Point3, Run, TetMesh, Vector3};

use super::Mesher;
use super::report::Report;
use super::setup::{Purpose, below, check_size, touching};
use crate::backend::ContourBackend;
use crate::complex::collect::compact;
use crate::dual::Probe;
use crate::octree::{BLOCK, Domain, Labels, Samples, Source};
use crate::{AtBox, Error, Extent, Options, Outer, Resolution};

/// Largest cells of a mesh in tiles, in finest ones: what bounds how far its elements depend on samples.
pub const LARGEST: usize = BLOCK as usize;

/// Cells around a tile that its elements may depend on: at most 23 with either method.
///
/// - *The octree.* A leaf that touches the tile is as large as its neighbours let it be: balance carries the size of a
///   finest cell 2 + 4 + 8 cells far, from leaves of 8 cells around the tile; one more where finest cells are wanted
///   around another.
/// - *Stuffing.* Snapping looks four vertices far, within that.
/// - *Dual contouring.* A point whose tetrahedron would be inverted stops where its neighbours let it, and these where theirs
///   did. Such tetrahedra stand at cut cells, which are finest like all around them, so each look is one cell far, and
///   a point waits only for those of earlier colours: for parts of cut cells of another parity at most 7 times in a
///   row, for a whole cell, which waits for parts alone, between the two rounds and before them. With the corners of the
///   last cell that is 2 · (7 + 1) + 2 + 1 from a point, which is within 3 cells of the tile that has its tetrahedron.
pub const HALO: usize = 3 * LARGEST;

/// The tetrahedra of a tile, the cells `own[0]..own[1]` of a lattice: of all that [`volume`](crate::volume) makes of the
/// whole with the same options and field, those whose barycentre lies in the tile, to the last bit. `values` are those
/// of a window of the lattice that holds the tile and [`HALO`] cells around it, as far as the lattice goes: see
/// [`Window::around`]. What surrounds the tile decides nothing beyond that, so tiles can be meshed in any order and place.
/// A field, if vertices shall lie on one, must answer with the same bits in all tiles.
///
/// A tile without elements is empty, not an error. Cells beyond the end of the lattice, up to the next whole block,
/// belong to the tile before them.
///
/// # Errors
///
/// Options by which elements depend on more than that: only the lattice of the values, without materials, tolerance,
/// pruning, cells of more than [`LARGEST`] spacings or an outer box; the interior or both sides. A tile or window
/// that does not begin and end with whole blocks of 8 cells. A surface that meets the end of the lattice; too much memory.
///
/// # Examples
///
/// A ball in two halves, each of which sees the values of its own half and of [`HALO`] cells around it:
///
/// ```
/// use dual_contour::geom_core::grid::lattice::Window;
/// use dual_contour::geom_core::{Cpu, Lattice, LatticeValues, Point3, Run, ScalarGrid};
/// use dual_contour::{HALO, LARGEST, Method, Options, tile, volume};
///
/// let lattice = Lattice { origin: Point3::new(-8.0, -8.0, -8.0), spacing: 0.5, counts: [33; 3] };
/// let density = |p: Point3| 7.0 - p.coords.norm() as f32;
/// let whole = ScalarGrid::new(lattice, (0..lattice.len()).map(|i| density(lattice.point(lattice.coordinates(i)))).collect())?;
/// let options = Options { method: Method::Stuffing, max_cell: 0.5 * LARGEST as f64, ..Options::default() };
///
/// let mut tets = 0;
/// for own in [[[0, 0, 0], [16, 32, 32]], [[16, 0, 0], [32, 32, 32]]] {
///     let window = Window::around(lattice, own[0], own[1], HALO);
///     let part = window.lattice();
///     let at = |i| whole.at([0, 1, 2].map(|k| part.coordinates(i)[k] + window.low[k]));
///     let values = ScalarGrid::new(part, (0..part.len()).map(at).collect())?;
///     let (piece, _) = tile(&values, None, &window, own, &options, Run::on(&Cpu))?;
///     tets += piece.mesh.tets().len();
/// }
/// assert_eq!(tets, volume(&whole, None, &options, Run::on(&Cpu))?.mesh.tets().len());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn tile<V: LatticeValues + ?Sized, B: ContourBackend + ?Sized>(
    values: &V,
    field: Option<&dyn ImplicitField>,
    window: &Window,
    own: [[usize; 3]; 2],
    options: &Options,
    run: Run<'_, B>,
) -> Result<(Piece, Report), Error> {
    let run = run.with(run.backend.as_contour());
    check(options, window)?;
    check_place(values, window, own)?;
    // Only where the lattice ends must the surface have closed.
    let ends = window.ends();
    if let Some((side, points)) = touching(values, options.level, ends) {
        return Err(Error::SurfaceTouchesBox { side, points });
    }
    let mut report = Report {
        spacing: window.whole.spacing,
        ..Report::default()
    };
    // The values of the window, as those of the whole stand in its cells.
    let domain = domain(window);
    check_size(domain.cells.map(f64::from), options)?;
    let source = Source::Aligned {
        values,
        shift: [0; 3],
        outside: below(options.level),
    };
    let labels = Labels {
        level: options.level,
        materials: Vec::new(),
        outer: None,
    };
    let mut samples = Samples::new(source, domain, labels, options.max_memory)?;
    // All is outside: nothing to mesh.
    if options.region == Extent::Interior && !samples.holds(INTERIOR) {
        return Ok((Piece::default(), report));
    }
    samples.find_crossings();
    // All tetrahedra that decide on those of the tile, or share vertices with them.
    let reach = LARGEST as i32;
    let near = [0, 1].map(|side| {
        [0, 1, 2].map(|k| {
            let at = own[side][k] as i32 - window.low[k] as i32;
            if side == 0 { at - reach } else { at + reach }
        })
    });
    let mesher = Mesher {
        samples: &samples,
        probe: &Probe::new(&samples, field, options),
        options,
        purpose: Purpose::Volume(options.region),
        near: Some(near),
    };
    let raw = mesher.mesh(&mut report, run)?;
    let places = raw.positions.iter().map(|p| domain.in_values(p)).collect();
    let all = Elements {
        places,
        tets: raw.tets,
    };
    let ((mut tets, regions), touched) = all.own(own, window, &raw.regions);
    // Vertices that only others use go.
    let used = compact(all.places.len(), &mut tets);
    let shared = used.iter().map(|&v| touched[v as usize]).collect();
    let positions = used
        .iter()
        .map(|&v| domain.world(&raw.positions[v as usize]));
    let kinds = used.iter().map(|&v| raw.kinds[v as usize]);
    report.tets = tets.len();
    let mesh = TetMesh::with_kinds(positions.collect(), tets, regions, kinds.collect())
        .expect("emitted tetrahedra name emitted vertices");
    Ok((Piece { mesh, shared }, report))
}

/// Refuses options by which elements would depend on what lies far.
/// Ranges first, by [`Options::check`]; then one field after the other that must be left alone.
fn check(options: &Options, window: &Window) -> Result<(), OutOfRange> {
    options.check()?;
    let largest = LARGEST as f64 * window.whole.spacing;
    let local = [
        ("resolution", options.resolution == Resolution::Lattice),
        ("materials", options.materials.is_empty()),
        ("prune", options.prune == 0),
        ("outer", options.outer == Outer::Grid),
        ("separate_exterior", !options.separate_exterior),
        ("at_box", options.at_box == AtBox::Refuse),
        ("zones", options.zones.is_empty()),
        ("tolerance", options.tolerance == 0.0),
        ("region", options.region != Extent::Exterior),
        ("max_cell", options.max_cell <= largest * (1.0 + 1e-9)),
    ];
    match local.iter().find(|(_, fine)| !fine) {
        None => Ok(()),
        Some(&(option, _)) => Err(OutOfRange::new(
            option,
            "this value",
            format!(
                "be left alone in tiles, which mesh on the lattice of the values, without materials, tolerance, pruning or \
                 an outer box, the interior or both sides, with a max_cell of at most {largest} Å"
            ),
        )),
    }
}

/// Refuses tiles and windows that are not made of blocks, or do not fit together.
/// Ends may stick out of whole blocks only where the lattice itself ends.
fn check_place<V: LatticeValues + ?Sized>(
    values: &V,
    window: &Window,
    own: [[usize; 3]; 2],
) -> Result<(), Error> {
    let counts = values.lattice().counts;
    if counts.iter().any(|&n| n < 2) {
        return Err(Error::NoCells { counts });
    }
    let cells = window.whole.cells();
    let needed = Window::around(window.whole, own[0], own[1], HALO);
    let fits = (0..3).all(|k| {
        let (end, of) = (
            needed.low[k] + needed.counts[k],
            window.low[k] + window.counts[k],
        );
        let whole = |c: usize| c.is_multiple_of(LARGEST);
        window.low[k] <= needed.low[k]
            && end <= of
            && whole(window.low[k])
            && (whole(of - 1) || of > cells[k])
            && whole(own[0][k])
            && (whole(own[1][k]) || own[1][k] >= cells[k])
            && counts[k] == window.counts[k]
    });
    let told = format!("{:?} + {:?} around {own:?}", window.low, window.counts);
    let must = "hold the tile and HALO cells around it, in whole blocks of 8 cells, with a value per point";
    Ok(require(fits, "window", told, must)?)
}

/// The finest cells of the window; to the next whole block where the lattice ends, as for a whole mesh.
fn domain(window: &Window) -> Domain {
    let ends = window.ends();
    let cells = [0, 1, 2].map(|k| {
        let n = window.counts[k] - 1;
        let n = if ends[k][1] {
            n.next_multiple_of(LARGEST)
        } else {
            n
        };
        n as i32
    });
    let whole = &window.whole;
    let anchor = window.low.map(|c| -(c as i32));
    Domain::new(whole.bounds().min, whole.spacing, cells, anchor)
}

/// Tetrahedra of a window.
struct Elements {
    /// Where vertices stand, in cells of the whole lattice.
    places: Vec<Point3>,
    tets: Vec<[u32; 4]>,
}

impl Elements {
    /// Tetrahedra and regions of a tile, and which vertices others touch.
    #[expect(clippy::type_complexity, reason = "two lists that belong together")]
    fn own(
        &self,
        [low, high]: [[usize; 3]; 2],
        window: &Window,
        regions: &[u8],
    ) -> ((Vec<[u32; 4]>, Vec<u8>), Vec<bool>) {
        let cells = window.whole.cells();
        // Four times the barycentre, which is exact; what is beyond the lattice belongs to its last tile.
        let is_own = |tet: &[u32; 4]| {
            let places = tet.iter().map(|&v| self.places[v as usize].coords);
            let sum: Vector3 = places.sum();
            (0..3).all(|k| {
                let last = high[k] >= cells[k];
                sum[k] >= 4.0 * low[k] as f64 && (last || sum[k] < 4.0 * high[k] as f64)
            })
        };
        let mut out = (Vec::new(), Vec::new());
        let mut shared = vec![false; self.places.len()];
        for (tet, &region) in self.tets.iter().zip(regions) {
            if is_own(tet) {
                out.0.push(*tet);
                out.1.push(region);
            } else {
                tet.iter().for_each(|&v| shared[v as usize] = true);
            }
        }
        (out, shared)
    }
}
