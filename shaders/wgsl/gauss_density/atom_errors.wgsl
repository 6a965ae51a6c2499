// How much the density changes without an atom: squared relative changes summed over the points of a cell,
// one thread per atom of a cell (Eq. 3.9 squared, corrected).

struct Item {
    at: vec4<f32>,
    lift: f32,
    first: u32,
    end: u32,
    parent: u32,
}

struct Params {
    depth: u32,
    slots: u32,
    pad0: u32,
    pad1: u32,
}

struct Site {
    at: vec3<f32>,
    inverse: f32,
    share: f32,
    row: u32,
    terms: u32,
    pad0: u32,
}

struct Slot {
    // The atom's item, and the points of its cell.
    item: u32,
    first: u32,
    end: u32,
    pad0: u32,
}

const NOTHING: f32 = -3.0e38;

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> items: array<Item>;
@group(0) @binding(2) var<storage, read> ranges: array<u32>;
@group(0) @binding(3) var<storage, read> sites: array<Site>;
@group(0) @binding(4) var<storage, read> terms: array<f32>;
@group(0) @binding(5) var<storage, read> slots: array<Slot>;
@group(0) @binding(6) var<storage, read_write> errors: array<f32>;

// log2 of the sum of the terms of siblings, with one of them replaced; NOTHING for none.
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

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= params.slots { return; }
    let slot = slots[id.x];
    var total = 0.0;
    for (var s = slot.first; s < slot.end; s += 1u) {
        let site = sites[s];
        let shift = site.terms - ranges[site.row];
        // Sums are made anew without the atom, never by subtraction.
        var child = slot.item;
        var value = NOTHING;
        for (var l = 0u; l < params.depth; l += 1u) {
            let v = items[child].parent;
            value = log_sum(items[v].first, items[v].end, shift, child, value);
            if value != NOTHING { value *= items[v].at.x; }
            child = v;
        }
        let first = ranges[site.row + params.depth];
        let end = ranges[site.row + params.depth + 1u];
        let left = log_sum(first, end, shift, child, value);
        var change = 1.0;
        if left != NOTHING {
            // Both sums have the same rounding in what they share.
            let full = log_sum(first, end, shift, child, terms[child + shift]);
            change = max(1.0 - exp2(left - full) / site.share, 0.0);
        }
        total += change * change;
    }
    errors[id.x] = total;
}
