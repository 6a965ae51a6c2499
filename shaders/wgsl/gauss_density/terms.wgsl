// The terms of a cell's tree at each of its points, one thread per point, as logarithms to base 2.

struct Item {
    // Atoms: offset from the cell's centre (Å), and κ log2 e. Nodes: x is the power.
    at: vec4<f32>,
    lift: f32,
    first: u32,
    end: u32,
    parent: u32,
}

struct Params {
    depth: u32,
    sites: u32,
    pad0: u32,
    pad1: u32,
}

struct Site {
    // From the cell's centre, Å.
    at: vec3<f32>,
    // 1 / G0, and the target as a share of G0.
    inverse: f32,
    share: f32,
    // The cell's row in `ranges`, and where the site's part of `terms` starts.
    row: u32,
    terms: u32,
    pad0: u32,
}

const NOTHING: f32 = -3.0e38;

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> items: array<Item>;
// Per cell: where atoms and the nodes of each level start, and the end.
@group(0) @binding(2) var<storage, read> ranges: array<u32>;
@group(0) @binding(3) var<storage, read> sites: array<Site>;
// Per site and item: log2 of its term.
@group(0) @binding(4) var<storage, read_write> terms: array<f32>;
// log2 of the density per site.
@group(0) @binding(5) var<storage, read_write> density: array<f32>;

// log2 of the sum of the terms of siblings.
fn log_sum(first: u32, end: u32, shift: u32) -> f32 {
    var top = NOTHING;
    for (var c = first; c < end; c += 1u) { top = max(top, terms[c + shift]); }
    var sum = 0.0;
    for (var c = first; c < end; c += 1u) { sum += exp2(terms[c + shift] - top); }
    return top + log2(sum);
}

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= params.sites { return; }
    let site = sites[id.x];
    let base = ranges[site.row];
    let shift = site.terms - base;
    for (var a = base; a < ranges[site.row + 1u]; a += 1u) {
        let d = site.at - items[a].at.xyz;
        terms[a + shift] = items[a].lift - items[a].at.w * dot(d, d);
    }
    for (var level = 0u; level < params.depth; level += 1u) {
        let end = ranges[site.row + level + 2u];
        for (var v = ranges[site.row + level + 1u]; v < end; v += 1u) {
            terms[v + shift] = items[v].at.x * log_sum(items[v].first, items[v].end, shift);
        }
    }
    let top_first = ranges[site.row + params.depth];
    density[id.x] = log_sum(top_first, ranges[site.row + params.depth + 1u], shift);
}
