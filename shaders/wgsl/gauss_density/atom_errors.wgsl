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

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> items: array<Item>;
@group(0) @binding(2) var<storage, read> ranges: array<u32>;
@group(0) @binding(3) var<storage, read> sites: array<Site>;
@group(0) @binding(4) var<storage, read> terms: array<vec2<f32>>;
@group(0) @binding(5) var<storage, read> slots: array<Slot>;
@group(0) @binding(6) var<storage, read_write> errors: array<f32>;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= params.slots { return; }
    let slot = slots[id.x];
    var total = 0.0;
    for (var s = slot.first; s < slot.end; s += 1u) {
        let site = sites[s];
        let shift = site.terms - ranges[site.row];
        var child = slot.item;
        var value = 0.0;
        for (var l = 0u; l < params.depth; l += 1u) {
            let v = items[child].parent;
            var sum = 0.0;
            for (var c = items[v].first; c < items[v].end; c += 1u) {
                sum += select(terms[c + shift].x, value, c == child);
            }
            value = 0.0;
            if sum > 0.0 { value = exp2(items[v].at.x * log2(sum)) * terms[v + shift].y; }
            child = v;
        }
        var left = 0.0;
        var full = 0.0;
        let end = ranges[site.row + params.depth + 1u];
        for (var c = ranges[site.row + params.depth]; c < end; c += 1u) {
            let own = terms[c + shift].x;
            full += own;
            left += select(own, value, c == child);
        }
        // Both sums have the same rounding in what they share.
        let change = max(1.0 - left / (full * site.share), 0.0);
        total += change * change;
    }
    errors[id.x] = total;
}
