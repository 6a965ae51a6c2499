// One sweep over the vertices of one colour, sixteen threads per vertex, each with a candidate: the neighbours' mean or
// a direction of the compass; the best of them, round by round. All is relative to the vertex where it started.

// `slides`: means are given; `reach`: how far from the start a vertex may go, in mean edges.
struct Batch { first: u32, count: u32, rounds: u32, offset: u32, slides: u32, reach: f32, pad0: u32, pad1: u32 }
// The tetrahedron (vertex, a, b, c): a, b, c relative to the vertex; n: doubled area normal of abc.
struct Face { a: vec4<f32>, b: vec4<f32>, c: vec4<f32>, n: vec4<f32> } // w: |bc|², |ca|², |ab|², |n|²

@group(0) @binding(0) var<uniform> batch: Batch;
// High and low parts per vertex: those that move first, in order, then their neighbours.
@group(0) @binding(1) var<storage, read> positions: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read_write> moved: array<vec4<f32>>; // per vertex
@group(0) @binding(3) var<storage, read> axes: array<vec4<f32>>; // three per vertex to move
@group(0) @binding(4) var<storage, read> starts: array<u32>;
@group(0) @binding(5) var<storage, read> faces: array<u32>; // three per face
@group(0) @binding(6) var<storage, read_write> scratch: array<Face>;
// Per vertex to move: the mean of its neighbours on the surface from where it is; w is 0 if there is none.
@group(0) @binding(7) var<storage, read> means: array<vec4<f32>>;

// Threads of a vertex.
const TEAM = 16u;
// Per thread: a sum of places with a length, or the value that its candidate reaches.
var<workgroup> sums: array<vec4<f32>, 64>;
var<workgroup> reached: array<f32, 64>;

const STEP = 0.25;
const SHRINK = 0.4;
const GAIN = 1e-6;

fn relative(v: u32, o: u32) -> vec3<f32> {
    let high = positions[2u * v].xyz - positions[2u * o].xyz;
    let low = positions[2u * v + 1u].xyz - positions[2u * o + 1u].xyz;
    return high + (low + (moved[v].xyz - moved[o].xyz));
}

// Signed square of the objective of one tetrahedron with its vertex at x.
fn value(f: Face, x: vec3<f32>) -> f32 {
    let a = f.a.xyz - x;
    let b = f.b.xyz - x;
    let c = f.c.xyz - x;
    let v6 = dot(f.n.xyz, a);
    let aa = dot(a, a);
    let bb = dot(b, b);
    let cc = dot(c, c);
    let sum = aa + bb + cc + f.a.w + f.b.w + f.c.w;
    let cube = sum * sum * sum;
    if v6 <= 0.0 {
        if cube > 0.0 { return -432.0 * v6 * v6 / cube; }
        return 0.0;
    }
    let u = cross(b, c);
    let v = cross(c, a);
    let w = cross(a, b);
    let na = dot(u, u);
    let nb = dot(v, v);
    let nc = dot(w, w);
    let inner = min(min(aa * na, bb * nb), cc * nc) * f.n.w;
    let outer = min(min(f.c.w * na * nb, f.a.w * nb * nc), f.b.w * nc * na);
    let product = na * nb * nc * f.n.w;
    if product <= 0.0 { return 0.0; }
    return v6 * v6 * min(min(inner, outer) / product, 1.2996 * 432.0 / cube);
}

fn worst(from_face: u32, to_face: u32, x: vec3<f32>, bound: f32) -> f32 {
    var low = 3.0e38;
    for (var i = from_face; i < to_face; i += 1u) {
        low = min(low, value(scratch[i], x));
        if low <= bound { return low; }
    }
    return low;
}

// The sum of what the threads of a team have put into `sums`.
fn team_sum(first: u32) -> vec4<f32> {
    var sum = vec4<f32>(0.0);
    for (var k = 0u; k < TEAM; k += 1u) { sum += sums[first + k]; }
    return sum;
}

// The compass of a vertex: along one of its axes or along all of them, the `wanted`-th counted from 1; 0 for none.
fn direction(wanted: u32, axis: array<vec3<f32>, 3>, dimensions: u32) -> vec3<f32> {
    var found = 0u;
    for (var k = 0u; k < 27u; k += 1u) {
        let s = vec3<f32>(f32(k % 3u) - 1.0, f32(k / 3u % 3u) - 1.0, f32(k / 9u) - 1.0);
        if (s.y != 0.0 && dimensions < 2u) || (s.z != 0.0 && dimensions < 3u) { continue; }
        let used = u32(s.x != 0.0) + u32(s.y != 0.0) + u32(s.z != 0.0);
        if used == 0u || (used != 1u && used != dimensions) { continue; }
        found += 1u;
        if found == wanted { return normalize(axis[0] * s.x + axis[1] * s.y + axis[2] * s.z); }
    }
    return vec3<f32>(0.0);
}

@compute @workgroup_size(64)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(local_invocation_index) me: u32,
) {
    let lane = me % TEAM;
    let team = me - lane;
    let number = 4u * group.x + me / TEAM;
    // A team without a vertex goes along, with no faces: all must meet at the barriers.
    let idle = number >= batch.count;
    let o = batch.first + select(number, 0u, idle);
    let from_face = starts[o] - batch.offset;
    let to_face = select(starts[o + 1u] - batch.offset, from_face, idle);

    // In units of a typical edge: f32 squares of products neither overflow nor vanish.
    var sum = vec4<f32>(0.0);
    for (var k = from_face + lane; k < to_face; k += TEAM) {
        let f = 3u * (k + batch.offset);
        for (var corner = 0u; corner < 3u; corner += 1u) {
            let d = relative(faces[f + corner], o);
            sum += vec4(d, length(d));
        }
    }
    sums[me] = sum;
    workgroupBarrier();
    let corners = max(f32(3u * (to_face - from_face)), 1.0);
    let total = team_sum(team) / corners;
    let unit = max(total.w, 1.0e-30);
    let still = total.w <= 0.0;
    var mean = total.xyz / unit;
    var has_mean = true;
    if batch.slides == 1u {
        mean = means[o].xyz / unit;
        has_mean = means[o].w > 0.0;
    }
    for (var k = from_face + lane; k < to_face; k += TEAM) {
        let f = 3u * (k + batch.offset);
        let a = relative(faces[f], o) / unit;
        let b = relative(faces[f + 1u], o) / unit;
        let c = relative(faces[f + 2u], o) / unit;
        let n = cross(b - a, c - a);
        scratch[k] = Face(vec4(a, dot(c - b, c - b)), vec4(b, dot(a - c, a - c)), vec4(c, dot(b - a, b - a)), vec4(n, dot(n, n)));
    }
    workgroupBarrier();
    storageBarrier();

    let axis = array<vec3<f32>, 3>(axes[3u * o].xyz, axes[3u * o + 1u].xyz, axes[3u * o + 2u].xyz);
    var dimensions = 0u;
    var to_mean = vec3<f32>(0.0);
    for (var k = 0u; k < 3u; k += 1u) {
        dimensions += u32(dot(axis[k], axis[k]) > 0.5);
        to_mean += axis[k] * dot(axis[k], mean);
    }
    // The first thread has the mean, once; each of the others a direction.
    let along = direction(lane, axis, dimensions);
    let has_direction = dot(along, along) > 0.5;
    var x = vec3<f32>(0.0);
    var best = worst(from_face, to_face, x, -3.0e38);
    var step = STEP;
    for (var round = 0u; round < batch.rounds; round += 1u) {
        let own = x + step * along;
        let candidate = select(own, to_mean, lane == 0u);
        var value_here = -3.0e38;
        let asked = has_direction || (lane == 0u && round == 0u && has_mean);
        if !still && asked && dot(candidate, candidate) <= batch.reach * batch.reach {
            value_here = worst(from_face, to_face, candidate, best + GAIN);
        }
        reached[me] = value_here;
        sums[me] = vec4(candidate, 0.0);
        workgroupBarrier();
        var better = false;
        for (var k = 0u; k < TEAM; k += 1u) {
            if reached[team + k] > best + GAIN {
                best = reached[team + k];
                x = sums[team + k].xyz;
                better = true;
            }
        }
        if !better { step = step * SHRINK; }
        workgroupBarrier();
    }
    if lane == 0u && !idle {
        moved[o] = vec4<f32>(moved[o].xyz + x * unit, 0.0);
    }
}
