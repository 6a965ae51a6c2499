// How much the density changes without an atom: squared relative changes summed over the points of a cell,
// one thread per atom of a cell (Eq. 3.9 squared, corrected).

@group(0) @binding(6) var<storage, read_write> errors: array<f32>;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= params.count { return; }
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
