// First derivatives of the refit's objective and the diagonal of its Gauss-Newton matrix, per atom of a cell
// (Eq. 3.13), one thread per atom of a cell.

const LN2: f32 = 0.6931471805599453;

@group(0) @binding(6) var<storage, read> density: array<f32>;
// Ten per slot: the derivatives for x, y, z, r, κ, then the diagonal.
@group(0) @binding(7) var<storage, read_write> sums: array<f32>;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= params.count { return; }
    let slot = slots[id.x];
    let atom = items[slot.item];
    let decay = atom.at.w * LN2;
    let radius_sq = atom.lift / atom.at.w;
    let radius = sqrt(radius_sq);
    var g: array<f32, 5>;
    var h: array<f32, 5>;
    for (var p = 0u; p < 5u; p += 1u) {
        g[p] = 0.0;
        h[p] = 0.0;
    }
    for (var s = slot.first; s < slot.end; s += 1u) {
        let site = sites[s];
        let shift = site.terms - ranges[site.row];
        // The derivative of ln G with respect to the logarithm of the kernel: powers and parts of sums.
        var part = 1.0;
        var child = slot.item;
        for (var l = 0u; l < params.depth; l += 1u) {
            let v = items[child].parent;
            let power = items[v].at.x;
            part *= power * exp2(terms[child + shift] - terms[v + shift] / power);
            child = v;
        }
        part *= exp2(terms[child + shift] - density[s]);
        let relative = exp2(density[s]) * site.inverse;
        let share = part * relative;
        let off = relative - 1.0;
        let d = site.at - atom.at.xyz;
        let pull = 2.0 * decay * share;
        var slopes = array<f32, 5>(pull * d.x, pull * d.y, pull * d.z, pull * radius,
            share * (radius_sq - dot(d, d)));
        for (var p = 0u; p < 5u; p += 1u) {
            g[p] += off * slopes[p];
            h[p] += slopes[p] * slopes[p];
        }
    }
    for (var p = 0u; p < 5u; p += 1u) {
        sums[id.x * 10u + p] = g[p];
        sums[id.x * 10u + 5u + p] = h[p];
    }
}
