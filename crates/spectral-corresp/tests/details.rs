//! Single steps: links, neighbours, annealing, rotations, a distance.

use geom_core::algebra::graph::{Neighbours, VoxelGraph};
use geom_core::compute::random::SplitMix64;
use geom_core::nalgebra::Rotation3;
use geom_core::{Cpu, Lattice, Point3, Run, Vector3};
use spectral_corresp::compare::{CompareReport, Spread};
use spectral_corresp::correspond::links;
use spectral_corresp::fit::{Neighbourhoods, annealed_in_one_stage};
use spectral_corresp::morph::{distortion, rotations};
use spectral_corresp::{ShapeOptions, VoxelShape};

/// A shape that is a part of another is not it: what is not met makes the distance larger, in proportion.
#[test]
fn what_is_not_met_makes_a_distance() {
    let of = |mean| Spread {
        mean,
        ..Spread::default()
    };
    let report = |coverage| CompareReport {
        diameters: of(0.75),
        distortions: of(0.25),
        coverage,
    };
    let distances = [1.0, 0.5, 0.25].map(|coverage| report(coverage).distance());
    assert_eq!(distances, [1.0, 2.0, 4.0]);
    assert!(report(0.0).distance().is_finite());
}

/// Partners are linked whichever of the two maps knows of them, and once.
#[test]
fn links_come_from_both_maps() {
    let lattice = Lattice {
        origin: Point3::origin(),
        spacing: 1.0,
        counts: [4, 4, 4],
    };
    let options = ShapeOptions::default();
    let shape = VoxelShape::of_flags(&lattice, vec![true; 64], &options, Run::on(&Cpu)).unwrap();
    let n = shape.boundary().len() as u32;
    let (same, all_to_one): (Vec<u32>, Vec<u32>) = ((0..n).collect(), vec![0; n as usize]);
    let sorted = |pairs: Vec<(u32, u32)>| {
        let pairs = pairs
            .into_iter()
            .map(|(i, j)| (shape.boundary()[i as usize], shape.boundary()[j as usize]));
        let mut pairs: Vec<_> = pairs.collect();
        pairs.sort_unstable();
        pairs
    };
    let identity: Vec<(u32, u32)> = (0..n).map(|i| (i, i)).collect();
    assert_eq!(
        links(&shape, &shape, &same, &same),
        sorted(identity.clone())
    );
    // From the first: all to node 0. From the second: each to its own.
    let with = |one: fn(u32) -> (u32, u32)| {
        let more = (1..n).map(one);
        sorted(identity.iter().copied().chain(more).collect())
    };
    assert_eq!(links(&shape, &shape, &all_to_one, &same), with(|i| (i, 0)));
    assert_eq!(links(&shape, &shape, &same, &all_to_one), with(|j| (0, j)));
}

/// Of many pairs some are drawn, for both of their points: near as many as asked per node.
#[test]
fn pairs_belong_to_both_of_their_points() {
    let points: Vec<Point3> = (0..512)
        .map(|i| Point3::from([i % 8, i / 8 % 8, i / 64].map(f64::from)))
        .collect();
    let near = Neighbourhoods::within(&points, 4.0, 12, 5).unwrap();
    for i in 0..points.len() {
        for &j in near.of(i) {
            assert!(near.of(j as usize).contains(&(i as u32)), "{i} and {j}");
        }
    }
    let mean = near.others().len() as f64 / points.len() as f64;
    assert!((mean - 12.0).abs() < 4.0, "{mean}");
}

/// A plate, with a mast on its middle or without.
fn plate(mast: usize) -> Vec<Point3> {
    let flat = (0..81).map(|i| Point3::new(f64::from(i % 9), f64::from(i / 9), 0.0));
    let mast = (1..=mast).map(|z| Point3::new(4.0, 4.0, z as f64));
    flat.chain(mast).collect()
}

/// Where the nodes of a plate go on one with a mast, and the score.
fn fitted(radius: f64, rounds: usize) -> (Vec<Point3>, f64) {
    annealed_in_one_stage([&plate(0), &plate(4)], &[], (radius, rounds, 60)).unwrap()
}

/// What is there on the second shape alone draws nodes of the first, though each of these has met its like.
#[test]
fn nodes_are_drawn_both_ways() {
    let (images, _) = fitted(3.0, 10);
    let highest = images.iter().map(|x| x.z).fold(0.0, f64::max);
    assert!(highest > 0.1, "{highest}");
}

/// A node with a place of its own goes most of the way there, and takes its neighbours along.
#[test]
fn anchors_pull() {
    let plate = plate(0);
    let anchors = [(40, plate[40] + Vector3::z())];
    let (images, _) = annealed_in_one_stage([&plate; 2], &anchors, (2.0, 10, 60)).unwrap();
    let rise = |node: usize| images[node].z;
    assert!(
        rise(40) > 0.4 && rise(41) > 0.01,
        "{} {}",
        rise(40),
        rise(41)
    );
}

/// A map onto a part of the other shape costs the rest.
#[test]
fn what_is_not_met_counts() {
    let (_, score) = fitted(3.0, 0);
    // The mast is 1, 2, 3 and 4 Å away from the plate; all else fits.
    let missed = 10.0 / 85.0;
    assert!((score - missed).abs() < 1e-6, "{score} for {missed}");
}

/// The rotations are those of least distortion: no small turn of all of them lowers it, whatever edges weigh.
#[test]
fn rotations_have_the_least_distortion() {
    let weights = [1.0, 0.3, 0.02];
    let graph = VoxelGraph::new([4, 4, 4], &[true; 64], Neighbours::TwentySix, weights).unwrap();
    let mut random = SplitMix64::new(3);
    let mut shaken =
        |x: &Point3, by: f64| x + Vector3::from([(); 3].map(|()| by * random.symmetric()));
    let at = |i: usize| Point3::from(graph.point(i).map(|c| c as f64));
    let rest: Vec<Point3> = (0..graph.nodes()).map(at).collect();
    let now: Vec<Point3> = rest.iter().map(|x| shaken(x, 0.4)).collect();
    let best = rotations(&graph, &rest, &now);
    let least = distortion(&graph, &rest, &now, &best);
    for axis in 0..3 {
        for angle in [-0.03, 0.03] {
            let turn = Rotation3::from_scaled_axis(Vector3::ith(axis, angle));
            for node in 0..graph.nodes() {
                let mut turned = best.clone();
                turned[node] = turn * turned[node];
                let other = distortion(&graph, &rest, &now, &turned);
                assert!(other > least, "node {node}: {other} below {least}");
            }
        }
    }
}
