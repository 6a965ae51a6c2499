// Points in cells that share a tree, and the terms of its items at them, in `terms`.

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

// Per cell: where atoms and the nodes of each level start, and the end.
@group(0) @binding(2) var<storage, read> ranges: array<u32>;
@group(0) @binding(3) var<storage, read> sites: array<Site>;

// log2 of the sum of the terms of siblings, with one of them replaced (ROOT: none is); NOTHING for none.
fn log_sum(first: u32, end: u32, shift: u32, child: u32, value: f32) -> f32 {
    var top = NOTHING;
    for (var c = first; c < end; c += 1u) {
        top = max(top, select(terms[c + shift], value, c == child));
    }
    if top == NOTHING { return NOTHING; }
    var sum = 0.0;
    for (var c = first; c < end; c += 1u) {
        sum += exp2(select(terms[c + shift], value, c == child) - top);
    }
    return top + log2(sum);
}
