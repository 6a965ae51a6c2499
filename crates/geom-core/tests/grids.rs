//! Grid files: what is written is read back, and what other programs write is understood.

use geom_core::io::{ErrorKind, GridFile, dx, grid, mrc};
use geom_core::nalgebra::{Point3, Vector3};
use geom_core::{Lattice, LatticeValues, ScalarGrid};
use proptest::prelude::*;

fn filled(lattice: Lattice, value: impl Fn(Point3<f64>) -> f64) -> ScalarGrid {
    let at = |i| value(lattice.point(lattice.coordinates(i))) as f32;
    ScalarGrid::new(lattice, (0..lattice.len()).map(at).collect()).unwrap()
}

fn small() -> ScalarGrid {
    let lattice = Lattice {
        origin: Point3::new(-12.345, 0.1, 7.0),
        spacing: 0.3,
        counts: [5, 4, 3],
    };
    filled(lattice, |p| (p.x * 3.1 + p.y * p.z).sin())
}

fn mrc_bytes(grid: &ScalarGrid, mode: mrc::Mode) -> Vec<u8> {
    let mut bytes = Vec::new();
    mrc::write(&mut bytes, grid, mode).unwrap();
    bytes
}

/// Lattices whose numbers have few digits, as people choose them.
fn grids() -> impl Strategy<Value = ScalarGrid> {
    let lattice = (
        [-90_000i32..90_000, -90_000i32..90_000, -90_000i32..90_000],
        1u32..9_999,
        [1usize..7, 1usize..7, 1usize..7],
    );
    lattice.prop_flat_map(|(origin, spacing, counts)| {
        let n = counts.iter().product::<usize>();
        let values =
            prop::collection::vec(any::<f32>().prop_filter("finite", |v| v.is_finite()), n);
        values.prop_map(move |values| {
            let origin = origin.map(|c| format!("{c}e-3").parse::<f64>().unwrap());
            let lattice = Lattice {
                origin: origin.into(),
                spacing: format!("{spacing}e-3").parse().unwrap(),
                counts,
            };
            ScalarGrid::new(lattice, values).unwrap()
        })
    })
}

proptest! {
    #![proptest_config(geom_core::testing::cases(256))]

    #[test]
    fn mrc_keeps_every_bit(grid in grids()) {
        let again = mrc::parse(&mrc_bytes(&grid, mrc::Mode::Float32)).unwrap();
        prop_assert_eq!(again.into_grid().unwrap(), grid);
    }

    #[test]
    fn dx_keeps_every_bit_of_any_lattice(
        grid in grids(),
        origin in [-1e4..1e4, -1e4..1e4, -1e4..1e4],
        spacing in 1e-3..1e3,
    ) {
        let (lattice, values) = grid.into_parts();
        let lattice = Lattice { origin: origin.into(), spacing, ..lattice };
        let grid = ScalarGrid::new(lattice, values).unwrap();
        let mut text = Vec::new();
        dx::write(&mut text, &grid).unwrap();
        prop_assert_eq!(dx::parse(&text).unwrap().into_grid().unwrap(), grid);
    }

    #[test]
    fn whole_numbers_survive_in_every_mode_that_holds_them(
        values in prop::collection::vec(-128i32..=65_535, 24),
    ) {
        let lattice = Lattice { origin: Point3::origin(), spacing: 1.5, counts: [4, 3, 2] };
        let grid = filled(lattice, |p| f64::from(values[lattice.index(
            [p.x, p.y, p.z].map(|c| (c / 1.5).round() as usize),
        )]));
        for (mode, range) in [
            (mrc::Mode::Int8, -128..=127),
            (mrc::Mode::Int16, -32_768..=32_767),
            (mrc::Mode::Uint16, 0..=65_535),
        ] {
            let mut bytes = Vec::new();
            let written = mrc::write(&mut bytes, &grid, mode);
            if values.iter().all(|v| range.contains(v)) {
                prop_assert_eq!(&mrc::parse(&bytes).unwrap().into_grid().unwrap(), &grid);
            } else {
                prop_assert!(written.is_err());
            }
        }
    }
}

#[test]
fn half_floats_are_rounded_to_nearest_and_refused_beyond_their_range() {
    let grid = small();
    let again = mrc::parse(&mrc_bytes(&grid, mrc::Mode::Float16)).unwrap();
    for (a, b) in grid.values().iter().zip(again.values()) {
        assert!((a - b).abs() <= a.abs() / 2048.0, "{a} {b}");
    }
    let (lattice, _) = grid.into_parts();
    let huge = filled(lattice, |_| 65_520.0);
    let refused = mrc::write(&mut Vec::new(), &huge, mrc::Mode::Float16).unwrap_err();
    assert!(refused.to_string().contains("[0, 0, 0]"), "{refused}");
    let largest = filled(lattice, |_| 65_519.0);
    let again = mrc::parse(&mrc_bytes(&largest, mrc::Mode::Float16)).unwrap();
    assert!(again.values().iter().all(|&v| v == 65_504.0));
}

#[test]
fn grids_survive_a_walk_through_files() {
    let folder = tempfile::tempdir().unwrap();
    let grid = small();
    for name in ["a.mrc", "a.map", "a.ccp4", "a.dx", "a.mrc.gz", "a.dx.gz"] {
        let path = folder.path().join(name);
        grid::save(&path, &grid).unwrap();
        assert_eq!(
            grid::read(&path).unwrap().into_grid().unwrap(),
            grid,
            "{name}"
        );
        let packed = std::fs::read(&path).unwrap().starts_with(&[0x1f, 0x8b]);
        assert_eq!(packed, name.ends_with(".gz"), "{name}");
        // The content tells the format, whatever the name.
        let other = folder.path().join("b");
        std::fs::rename(&path, &other).unwrap();
        assert_eq!(
            grid::read(&other).unwrap().into_grid().unwrap(),
            grid,
            "{name}"
        );
    }
    let refused = grid::save(folder.path().join("a.raw"), &grid).unwrap_err();
    assert!(refused.to_string().contains(".mrc"), "{refused}");
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
}

#[test]
fn bricks_that_do_not_fit_are_named() {
    use geom_core::GridError;
    use geom_core::grid::{Brick, BrickGrid};
    let lattice = Lattice {
        origin: Point3::origin(),
        spacing: 1.0,
        counts: [16, 8, 8],
    };
    let new = |kinds: &[Brick], bricks: usize| {
        BrickGrid::new(lattice, kinds, vec![0.0; 512 * bricks], 0.0, 2.0)
    };
    let both = [Brick::Stored(1), Brick::Stored(0)];
    assert!(new(&both, 2).is_ok());
    for (kinds, bricks) in [(&both[..1], 1), (&both[..], 1), (&both[..], 3)] {
        let error = new(kinds, bricks).unwrap_err();
        assert!(matches!(error, GridError::Bricks { .. }), "{error}");
    }
    // Twice the same number, and one beyond the last.
    for number in [1, 2, u32::MAX] {
        let error = new(&[Brick::Stored(1), Brick::Stored(number)], 2).unwrap_err();
        let named = GridError::BrickNumber {
            brick: 1,
            number,
            stored: 2,
        };
        assert_eq!(error, named);
    }
}

#[test]
fn sparse_grids_are_written_like_dense_ones() {
    use geom_core::grid::{Brick, BrickGrid};
    let lattice = Lattice {
        origin: Point3::origin(),
        spacing: 1.0,
        counts: [16, 8, 8],
    };
    let kinds = [Brick::Stored(0), Brick::Exterior];
    let values = (0..512).map(|v| v as f32).collect();
    let sparse = BrickGrid::new(lattice, &kinds, values, 0.25, 2.0).unwrap();
    let (mut a, mut b) = (Vec::new(), Vec::new());
    mrc::write(&mut a, &sparse, mrc::Mode::Float32).unwrap();
    mrc::write(&mut b, &sparse.to_dense(), mrc::Mode::Float32).unwrap();
    assert!(a == b);
}

/// A map as another program may write it.
struct Foreign {
    counts: [i32; 3],
    mode: i32,
    starts: [i32; 3],
    intervals: [i32; 3],
    cell: [f32; 3],
    angles: [f32; 3],
    axes: [i32; 3],
    origin: [f32; 3],
    extended: usize,
    imod: bool,
    big: bool,
    stamp: Option<u8>,
}

impl Default for Foreign {
    fn default() -> Self {
        Self {
            counts: [3, 2, 4],
            mode: 2,
            starts: [0; 3],
            intervals: [3, 2, 4],
            cell: [6.0, 4.0, 8.0],
            angles: [90.0; 3],
            axes: [1, 2, 3],
            origin: [0.0; 3],
            extended: 0,
            imod: false,
            big: false,
            stamp: None,
        }
    }
}

impl Foreign {
    /// The file; values are 0, 1, 2, … in the order of the file.
    fn bytes(&self) -> Vec<u8> {
        let mut raw = vec![0u8; 1024 + self.extended];
        let order = |mut b: [u8; 4]| {
            if self.big {
                b.reverse();
            }
            b
        };
        let mut put = |at: usize, words: [[u8; 4]; 3]| {
            for (k, w) in words.into_iter().enumerate() {
                raw[4 * (at + k)..][..4].copy_from_slice(&order(w));
            }
        };
        put(0, self.counts.map(i32::to_le_bytes));
        put(
            3,
            [self.mode, self.starts[0], self.starts[1]].map(i32::to_le_bytes),
        );
        put(
            6,
            [self.starts[2], self.intervals[0], self.intervals[1]].map(i32::to_le_bytes),
        );
        put(
            9,
            [
                self.intervals[2].to_le_bytes(),
                self.cell[0].to_le_bytes(),
                self.cell[1].to_le_bytes(),
            ],
        );
        put(
            12,
            [self.cell[2], self.angles[0], self.angles[1]].map(f32::to_le_bytes),
        );
        put(
            15,
            [
                self.angles[2].to_le_bytes(),
                self.axes[0].to_le_bytes(),
                self.axes[1].to_le_bytes(),
            ],
        );
        put(18, [self.axes[2].to_le_bytes(), [0; 4], [0; 4]]);
        put(23, [(self.extended as i32).to_le_bytes(), [0; 4], [0; 4]]);
        if self.imod {
            put(38, [1_146_047_817i32.to_le_bytes(), [0; 4], [0; 4]]);
        }
        put(49, self.origin.map(f32::to_le_bytes));
        raw[208..212].copy_from_slice(b"MAP ");
        raw[212] = self.stamp.unwrap_or(if self.big { 0x11 } else { 0x44 });
        let n = self.counts.iter().product::<i32>();
        for v in 0..n {
            let mut value = match self.mode {
                0 => vec![(v + 120) as u8],
                1 => ((v - 5) as i16).to_le_bytes().to_vec(),
                6 => ((v + 65_000) as u16).to_le_bytes().to_vec(),
                _ => (v as f32).to_le_bytes().to_vec(),
            };
            if self.big {
                value.reverse();
            }
            raw.extend(value);
        }
        raw
    }
    fn grid(&self) -> ScalarGrid {
        mrc::parse(&self.bytes()).unwrap().into_grid().unwrap()
    }
}

#[test]
fn maps_of_either_byte_order_and_any_mode_are_read() {
    let plain = Foreign::default().grid();
    assert_eq!(plain.lattice().spacing, 2.0);
    assert_eq!(plain.at([2, 1, 3]), 23.0);
    // A wrong machine stamp does not mislead.
    for stamp in [None, Some(0x44), Some(0)] {
        let big = Foreign {
            big: true,
            stamp,
            ..Foreign::default()
        };
        assert_eq!(big.grid(), plain);
    }
    let extended = Foreign {
        extended: 160,
        ..Foreign::default()
    };
    assert_eq!(extended.grid(), plain);
    for big in [false, true] {
        let of = |mode, imod| {
            Foreign {
                mode,
                imod,
                big,
                ..Foreign::default()
            }
            .grid()
        };
        let at = [1, 1, 2]; // value 16 of the file
        assert_eq!(of(0, false).at(at), -120.0);
        assert_eq!(of(0, true).at(at), 136.0);
        assert_eq!(of(1, false).at(at), 11.0);
        assert_eq!(of(6, false).at(at), 65_016.0);
    }
}

#[test]
fn columns_rows_and_sections_find_their_axes() {
    // Columns along z, rows along x, sections along y.
    let map = Foreign {
        axes: [3, 1, 2],
        starts: [10, -20, 30],
        intervals: [20, 40, 30],
        cell: [40.0, 80.0, 60.0],
        ..Foreign::default()
    };
    let grid = map.grid();
    assert_eq!(grid.lattice().counts, [2, 4, 3]);
    assert_eq!(grid.lattice().origin, Point3::new(-40.0, 60.0, 20.0));
    for (x, y, z) in [(0, 0, 0), (1, 3, 2), (1, 0, 2), (0, 2, 1)] {
        assert_eq!(grid.at([x, y, z]), (z + 3 * (x + 2 * y)) as f32);
    }
    // ORIGIN, if set, wins over NSTART.
    let placed = Foreign {
        origin: [1.5, -2.0, 0.1],
        ..map
    };
    assert_eq!(placed.grid().lattice().origin, Point3::new(1.5, -2.0, 0.1));
}

#[test]
fn cells_that_are_no_cubes_are_resampled() {
    let map = Foreign {
        counts: [9, 8, 7],
        intervals: [18, 8, 14],
        cell: [9.0, 8.0, 10.5],
        angles: [80.0, 95.0, 110.0],
        ..Foreign::default()
    };
    let file = mrc::parse(&map.bytes()).unwrap();
    assert!(!file.is_cubic());
    let [a, b, c] = file.steps();
    for (step, length) in [(a, 0.5), (b, 1.0), (c, 0.75)] {
        assert!((step.norm() - length).abs() < 1e-12);
    }
    for (pair, degrees) in [((b, c), 80.0f64), ((a, c), 95.0), ((a, b), 110.0)] {
        assert!((pair.0.angle(&pair.1).to_degrees() - degrees).abs() < 1e-9);
    }
    // The values 0, 1, 2, … are linear in the cell's coordinates, so they come back exactly inside.
    let to_axes = geom_core::nalgebra::Matrix3::from_columns(&[a, b, c])
        .try_inverse()
        .unwrap();
    let grid = file.into_grid().unwrap();
    assert_eq!(grid.lattice().spacing, 0.5);
    let mut inside = 0;
    for i in 0..grid.lattice().len() {
        let point = grid.lattice().coordinates(i);
        let local: Vector3<f64> = to_axes * grid.lattice().point(point).coords;
        if (0..3).all(|k| (0.0..=[8.0, 7.0, 6.0][k]).contains(&local[k])) {
            inside += 1;
            let expected = local[0] + 9.0 * (local[1] + 8.0 * local[2]);
            assert!((f64::from(grid.at(point)) - expected).abs() < 1e-4);
        }
    }
    assert!(inside > 900, "{inside}");
}

/// As APBS writes a potential.
const POTENTIAL: &str = "\
# Data from APBS 3.4.1
#
# POTENTIAL (kT/e)
#
object 1 class gridpositions counts 2 3 2
origin -1.500000e+00 2.000000e+00 3.250000e+01
delta 5.000000e-01 0.000000e+00 0.000000e+00
delta 0.000000e+00 5.000000e-01 0.000000e+00
delta 0.000000e+00 0.000000e+00 5.000000e-01
object 2 class gridconnections counts 2 3 2
object 3 class array type double rank 0 items 12 data follows
-1.000000e+00 1.000000e+00 2.000000e+00
3.000000e+00 4.000000e+00 5.000000e+00
6.000000e+00 7.000000e+00 8.000000e+00
9.000000e+00 1.000000e+01 1.100000e+01
attribute \"dep\" string \"positions\"
object \"regular positions regular connections\" class field
component \"positions\" value 1
component \"connections\" value 2
component \"data\" value 3
";

fn dx_of(text: &str) -> Result<GridFile, geom_core::io::Error> {
    dx::parse(text.as_bytes())
}

#[test]
fn potentials_are_read_last_axis_fastest() {
    let grid = dx_of(POTENTIAL).unwrap().into_grid().unwrap();
    let lattice = grid.lattice();
    assert_eq!(lattice.counts, [2, 3, 2]);
    assert_eq!(
        (lattice.spacing, lattice.origin),
        (0.5, Point3::new(-1.5, 2.0, 32.5))
    );
    assert_eq!(grid.at([0, 0, 0]), -1.0);
    assert_eq!(grid.at([1, 2, 0]), 10.0);
    assert_eq!(grid.at([0, 1, 1]), 3.0);
    // Quoted types, as other programs write them; axes that run backwards.
    let quoted = POTENTIAL.replace("type double", "type \"double\"");
    assert_eq!(dx_of(&quoted).unwrap().into_grid().unwrap(), grid);
    let mirrored = POTENTIAL.replace("delta 5.000000e-01", "delta -5.000000e-01");
    let mirrored = dx_of(&mirrored).unwrap().into_grid().unwrap();
    assert_eq!(mirrored.lattice().origin, Point3::new(-2.0, 2.0, 32.5));
    assert_eq!(mirrored.at([1, 0, 0]), -1.0);
    assert_eq!(mirrored.at([0, 2, 1]), 11.0);
}

#[test]
fn faults_of_grids_are_named_with_line_or_byte() {
    for (from, to, line, what) in [
        ("5.000000e+00", "1e60", 13, "value 5"),
        ("5.000000e+00", "five", 13, "five"),
        ("items 12", "items 4000000000", 11, "4000000000"),
        ("items 12", "items twelve", 11, "items"),
        ("counts 2 3 2\norigin", "counts 2 -3 2\norigin", 5, "counts"),
        (
            "counts 2 3 2\norigin",
            "counts 2 3 3\norigin",
            10,
            "connections",
        ),
        ("data follows", "ieee data follows", 11, "ieee"),
        ("rank 0", "rank 1 shape 3", 11, "rank 0"),
        ("type double", "type string", 11, "string"),
        ("origin", "orgin", 6, "orgin"),
        ("class field", "class group", 17, "class"),
        ("2.000000e+00 3.25", "two 3.25", 6, "two"),
    ] {
        let error = dx_of(&POTENTIAL.replacen(from, to, 1)).unwrap_err();
        assert_eq!(error.line, Some(line), "{from} → {to}: {error}");
        assert!(error.to_string().contains(what), "{error}");
    }
    let nothing = dx_of("").unwrap_err();
    assert!(matches!(nothing.kind, ErrorKind::Empty));
    for part in ["origin", "delta", "object 1"] {
        let lines = POTENTIAL.lines().filter(|l| !l.starts_with(part));
        let error = dx_of(&lines.collect::<Vec<_>>().join("\n")).unwrap_err();
        assert!(matches!(error.kind, ErrorKind::Truncated(_)), "{error}");
    }
    let flat = POTENTIAL.replacen("5.000000e-01", "0", 1);
    assert!(dx_of(&flat).unwrap_err().to_string().contains("volume"));
    let fewer = POTENTIAL.replacen("items 12", "items 11", 1);
    assert!(dx_of(&fewer).is_err(), "one value too many");

    let map = Foreign::default().bytes();
    let broken = |at: usize, word: i32| {
        let mut bytes = map.clone();
        bytes[at..at + 4].copy_from_slice(&word.to_le_bytes());
        mrc::parse(&bytes).unwrap_err().to_string()
    };
    for (at, word, what) in [
        (0, i32::MAX, "values"),
        (0, -3, "MRC map"),
        (12, 4, "complex"),
        (12, 101, "byte 12"),
        (28, 0, "byte 28"),
        (40, 0, "byte 40"),
        (52, 0x43b4_0000, "byte 52"),
        (64, 2, "byte 64"),
        (92, -1, "byte 92"),
        (92, 1 << 30, "extended header"),
        (1024 + 4 * 5, 0x7fc0_0000, "[2, 1, 0]"),
    ] {
        let error = broken(at, word);
        assert!(error.contains(what), "byte {at} = {word}: {error}");
    }
    for length in [1, 1000, 1024, map.len() - 1] {
        let error = mrc::parse(&map[..length]).unwrap_err();
        assert!(matches!(error.kind, ErrorKind::Truncated(_)), "{error}");
    }

    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("broken.map");
    for content in [&map[..1030], b"no map at all", b""] {
        std::fs::write(&path, content).unwrap();
        let error = grid::read(&path).unwrap_err();
        assert!(error.to_string().contains("broken.map"), "{error}");
    }
}
