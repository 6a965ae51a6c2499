//! Faults of `spectral-corresp`.

use super::Fault;

pub(super) const FAULTS: &[Fault] = &[
    Fault::wrong(
        "nodes are drawn one way only",
        "crates/spectral-corresp/src/fit/annealed.rs",
        "for (n, y) in fit.backward.iter().zip(&b.points) {",
        "for (n, y) in fit.backward.iter().zip(&b.points).take(0) {",
    ),
    Fault::wrong(
        "the score without the way back",
        "crates/spectral-corresp/src/fit/annealed.rs",
        "fit.score = distortion + mean(&fit.forward) + mean(&fit.backward);",
        "fit.score = distortion + mean(&fit.forward);",
    ),
    Fault::wrong(
        "anchors do not pull",
        "crates/spectral-corresp/src/fit/annealed.rs",
        "pull[node as usize] = ANCHOR_PULL;",
        "pull[node as usize] = 0.0 * ANCHOR_PULL;",
    ),
    Fault::wrong(
        "a rigid motion moves centre onto centre before it turns",
        "crates/spectral-corresp/src/fit/rigid.rs",
        "shift: to - rotation * from,",
        "shift: to - from,",
    ),
    Fault::wrong(
        "distances count from one end of a run",
        "crates/spectral-corresp/src/shape/distance.rs",
        "*d = run.min(*d);",
        "*d = run;",
    ),
    Fault::wrong(
        "parabolas meet one step early",
        "crates/spectral-corresp/src/shape/distance.rs",
        "let meet = (u * u - v * v + height - g).div_euclid(2 * (u - v)) + 1;",
        "let meet = (u * u - v * v + height - g).div_euclid(2 * (u - v));",
    ),
    Fault::wrong(
        "a pair may be near for one of its points only",
        "crates/spectral-corresp/src/near.rs",
        "let (low, high) = (u64::from(i.min(j)), u64::from(i.max(j)));",
        "let (low, high) = (u64::from(i), u64::from(j));",
    ),
    Fault::wrong(
        "edges turn with one end",
        "crates/spectral-corresp/src/morph/solve.rs",
        "(rotations[i] + rotations[j]) * (rest[i] - rest[j]) * (0.5 * w)",
        "(rotations[i] + rotations[i]) * (rest[i] - rest[j]) * (0.5 * w)",
    ),
    Fault::wrong(
        "rotations of neighbourhoods without the weights of edges",
        "crates/spectral-corresp/src/morph/solve.rs",
        "(now[i] - now[j]) * (rest[i] - rest[j]).transpose() * w;",
        "(now[i] - now[j]) * (rest[i] - rest[j]).transpose() * (w / w);",
    ),
    Fault::wrong(
        "maps may be taken the wrong way round",
        "crates/spectral-corresp/src/shape/map.rs",
        "match self.leads(from, to) {",
        "match self.leads(from, to) || self.leads(to, from) {",
    ),
    Fault::wrong(
        "joint modes keep those in which the shapes move against each other",
        "crates/spectral-corresp/src/correspond/joint.rs",
        "if correlation < IN_PHASE {",
        "if correlation < -IN_PHASE * 4.0 {",
    ),
    Fault::wrong(
        "links join one way only",
        "crates/spectral-corresp/src/correspond/joint.rs",
        "there.chain(back).collect();",
        "there.chain(back.take(0)).collect();",
    ),
    Fault::wrong(
        "what the other shape does not meet makes no distance",
        "crates/spectral-corresp/src/compare.rs",
        "(self.distortions.mean + self.diameters.mean) / self.coverage.max(1e-3)",
        "(self.distortions.mean + self.diameters.mean) / self.coverage.max(1.0)",
    ),
    Fault::wrong(
        "points follow their atom without its turn",
        "crates/spectral-corresp/src/truth.rs",
        "self.atoms[1][atom] + self.rotations[atom] * offset",
        "self.atoms[1][atom] + offset",
    ),
    Fault::wrong(
        "points belong to the nearest centre, whatever the radii",
        "crates/spectral-corresp/src/truth.rs",
        "let height = largest * largest - r * r;",
        "let height = 0.0 * (largest * largest - r * r);",
    ),
    Fault::wrong(
        "nodes that follow others follow without their turn",
        "crates/spectral-corresp/src/correspond/embed.rs",
        "let there = self.rotations[k] * (p - self.rest[k]) + self.images[k].coords;",
        "let there = (p - self.rest[k]) + self.images[k].coords;",
    ),
    Fault::wrong(
        "histograms put a diameter into one bar whole",
        "crates/spectral-corresp/src/start/histograms.rs",
        "row[low + 1] += high;",
        "row[low] += high;",
    ),
    Fault::wrong(
        "nearest.wgsl: the last column does not count",
        "shaders/wgsl/spectral_corresp/nearest.wgsl",
        "for (var c = 0u; c < task.width; c += 1u) {",
        "for (var c = 0u; c + 1u < task.width; c += 1u) {",
    ),
    Fault::wrong(
        "rotations.wgsl: one entry has the wrong sign",
        "shaders/wgsl/spectral_corresp/rotations.wgsl",
        "a[0][2] = sz.x - sx.z;",
        "a[0][2] = sx.z - sz.x;",
    ),
    Fault::wrong(
        "sweep.wgsl: the pull is not divided by what it adds",
        "shaders/wgsl/spectral_corresp/sweep.wgsl",
        "moves[i] = vec4<f32>((own + to * pull) / (1.0 + pull), 0.0);",
        "moves[i] = vec4<f32>(own + to * pull, 0.0);",
    ),
];
