// The sums of each atom from those of its slots, in their order, added to what other parts gave; a thread per atom.

@group(0) @binding(1) var<storage, read> starts: array<u32>;
@group(0) @binding(2) var<storage, read> slots: array<u32>;
// Ten per slot, and per atom.
@group(0) @binding(3) var<storage, read> sums: array<f32>;
@group(0) @binding(4) var<storage, read_write> totals: array<f32>;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= params.count { return; }
    for (var p = 0u; p < 10u; p += 1u) {
        var total = totals[id.x * 10u + p];
        for (var s = starts[id.x]; s < starts[id.x + 1u]; s += 1u) {
            total += sums[slots[s] * 10u + p];
        }
        totals[id.x * 10u + p] = total;
    }
}
