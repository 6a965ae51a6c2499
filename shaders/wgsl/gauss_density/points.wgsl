// The density and its gradient at any points, a thread per point, from the atoms that matter in the cell of space that
// each lies in. Sums are logarithms to base 2, so that nothing underflows before the powers.

// High and low parts of a coordinate from the middle of the model: differences stay sharp however large the model is.
struct Place {
    high: vec3<f32>,
    cell: u32,
    low: vec3<f32>,
    pad0: u32,
}

const LN2: f32 = 0.6931471805599453;
const LARGEST: f32 = 127.999;

// Low parts of the atoms' centres.
@group(0) @binding(2) var<storage, read> low: array<vec4<f32>>;
// Per cell: where its atoms start, and the end.
@group(0) @binding(3) var<storage, read> starts: array<u32>;
@group(0) @binding(4) var<storage, read> members: array<u32>;
@group(0) @binding(5) var<storage, read> places: array<Place>;
// Value and gradient per Å.
@group(0) @binding(6) var<storage, read_write> results: array<vec4<f32>>;

// The open sum of each level, relative to the largest term: log2 of that, the sum, and the sum of the terms times
// the gradients of their log2.
var<private> top: array<f32, 9>;
var<private> sum: array<f32, 9>;
var<private> slope: array<vec3<f32>, 9>;

fn add(level: u32, term: f32, gradient: vec3<f32>) {
    // One exponential, of whichever is the smaller.
    let rise = term - top[level];
    let share = exp2(-abs(rise));
    if rise > 0.0 {
        sum[level] = sum[level] * share + 1.0;
        slope[level] = slope[level] * share + gradient;
        top[level] = term;
    } else {
        sum[level] += share;
        slope[level] += gradient * share;
    }
}

fn close(level: u32) {
    top[level] = NOTHING;
    sum[level] = 0.0;
    slope[level] = vec3<f32>(0.0);
}

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= params.count { return; }
    let place = places[id.x];
    let depth = params.depth;
    for (var l = 0u; l <= depth; l += 1u) { close(l); }
    let end = starts[place.cell + 1u];
    for (var m = starts[place.cell]; m < end; m += 1u) {
        let atom = members[m];
        let item = items[atom];
        let d = (place.high - item.at.xyz) + (place.low - low[atom].xyz);
        add(0u, item.lift - item.at.w * dot(d, d), (-2.0 * item.at.w) * d);
        // The levels that end here go into those above.
        var node = item.parent;
        var next = ROOT;
        if m + 1u < end { next = items[members[m + 1u]].parent; }
        for (var l = 0u; l < depth; l += 1u) {
            if node == next { break; }
            let power = items[node].at.x;
            add(l + 1u, power * (top[l] + log2(sum[l])), slope[l] * (power / sum[l]));
            close(l);
            node = items[node].parent;
            if next != ROOT { next = items[next].parent; }
        }
    }
    var result = vec4<f32>(0.0);
    if sum[depth] > 0.0 {
        let value = exp2(min(top[depth] + log2(sum[depth]), LARGEST));
        result = vec4<f32>(value, slope[depth] * (value * LN2 / sum[depth]));
    }
    results[id.x] = result;
}
