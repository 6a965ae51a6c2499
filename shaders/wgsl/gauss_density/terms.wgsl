// The terms of a cell's tree at each of its points, one thread per point, as logarithms to base 2.

// Per site and item: log2 of its term.
@group(0) @binding(4) var<storage, read_write> terms: array<f32>;
// log2 of the density per site.
@group(0) @binding(5) var<storage, read_write> density: array<f32>;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= params.count { return; }
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
            terms[v + shift] = items[v].at.x * log_sum(items[v].first, items[v].end, shift, ROOT, NOTHING);
        }
    }
    let top_first = ranges[site.row + params.depth];
    let top_end = ranges[site.row + params.depth + 1u];
    density[id.x] = log_sum(top_first, top_end, shift, ROOT, NOTHING);
}
