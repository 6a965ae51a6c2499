// First derivatives of the refit's objective and the diagonal of its Gauss-Newton matrix, per atom of a cell
// (Eq. 3.13), one thread per atom of a cell.

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
    item: u32,
    first: u32,
    end: u32,
    pad0: u32,
}

const LN2: f32 = 0.6931471805599453;

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> items: array<Item>;
@group(0) @binding(2) var<storage, read> ranges: array<u32>;
@group(0) @binding(3) var<storage, read> sites: array<Site>;
@group(0) @binding(4) var<storage, read> terms: array<f32>;
@group(0) @binding(5) var<storage, read> slots: array<Slot>;
@group(0) @binding(6) var<storage, read> density: array<f32>;
// Ten per slot: the derivatives for x, y, z, r, κ, then the diagonal.
@group(0) @binding(7) var<storage, read_write> sums: array<f32>;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= params.slots { return; }
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
