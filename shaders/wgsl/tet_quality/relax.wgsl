// One sweep over the vertices of one colour, a vertex per thread: the best of the neighbours' mean
// and the compass directions, round by round. All is relative to the vertex where it started.

struct Batch { first: u32, count: u32, rounds: u32, offset: u32 }
// The tetrahedron (vertex, a, b, c): a, b, c relative to the vertex; n: doubled area normal of abc.
struct Face { a: vec4<f32>, b: vec4<f32>, c: vec4<f32>, n: vec4<f32> } // w: |bc|², |ca|², |ab|², |n|²

@group(0) @binding(0) var<uniform> batch: Batch;
@group(0) @binding(1) var<storage, read> positions: array<vec4<f32>>; // high, low per vertex
@group(0) @binding(2) var<storage, read_write> moved: array<vec4<f32>>; // per vertex
@group(0) @binding(3) var<storage, read> vertices: array<u32>;
@group(0) @binding(4) var<storage, read> axes: array<vec4<f32>>; // three per vertex to move
@group(0) @binding(5) var<storage, read> starts: array<u32>;
@group(0) @binding(6) var<storage, read> faces: array<u32>; // three per face
@group(0) @binding(7) var<storage, read_write> scratch: array<Face>;

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

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= batch.count { return; }
    let i = batch.first + id.x;
    let o = vertices[i];
    let from_face = starts[i] - batch.offset;
    let to_face = starts[i + 1u] - batch.offset;
    var mean = vec3<f32>(0.0);
    var length_sum = 0.0;
    // In units of a typical edge: f32 squares of products neither overflow nor vanish.
    var unit = 0.0;
    for (var k = from_face; k < to_face; k += 1u) {
        let f = 3u * (k + batch.offset);
        unit += length(relative(faces[f], o)) + length(relative(faces[f + 1u], o)) + length(relative(faces[f + 2u], o));
    }
    let corners = f32(3u * (to_face - from_face));
    unit = unit / corners;
    if unit <= 0.0 { return; }
    for (var k = from_face; k < to_face; k += 1u) {
        let f = 3u * (k + batch.offset);
        let a = relative(faces[f], o) / unit;
        let b = relative(faces[f + 1u], o) / unit;
        let c = relative(faces[f + 2u], o) / unit;
        let n = cross(b - a, c - a);
        scratch[k] = Face(vec4(a, dot(c - b, c - b)), vec4(b, dot(a - c, a - c)), vec4(c, dot(b - a, b - a)), vec4(n, dot(n, n)));
        mean += a + b + c;
    }
    mean = mean / corners;
    let ax = axes[3u * i].xyz;
    let ay = axes[3u * i + 1u].xyz;
    let az = axes[3u * i + 2u].xyz;
    let dimensions = u32(dot(ax, ax) > 0.5) + u32(dot(ay, ay) > 0.5) + u32(dot(az, az) > 0.5);
    var x = vec3<f32>(0.0);
    var best = worst(from_face, to_face, x, -3.0e38);
    var step = STEP;
    for (var round = 0u; round < batch.rounds; round += 1u) {
        var next = x;
        var better = false;
        if round == 0u {
            let candidate = ax * dot(ax, mean) + ay * dot(ay, mean) + az * dot(az, mean);
            let reached = worst(from_face, to_face, candidate, best + GAIN);
            if reached > best + GAIN { best = reached; next = candidate; better = true; }
        }
        // All 26 sign patterns; the compass has those with one axis, and those with all.
        for (var k = 0u; k < 27u; k += 1u) {
            let s = vec3<f32>(f32(k % 3u) - 1.0, f32(k / 3u % 3u) - 1.0, f32(k / 9u) - 1.0);
            if (s.y != 0.0 && dimensions < 2u) || (s.z != 0.0 && dimensions < 3u) { continue; }
            let used = u32(s.x != 0.0) + u32(s.y != 0.0) + u32(s.z != 0.0);
            if used == 0u || (used != 1u && used != dimensions) { continue; }
            let candidate = x + step * normalize(ax * s.x + ay * s.y + az * s.z);
            let reached = worst(from_face, to_face, candidate, best + GAIN);
            if reached > best + GAIN { best = reached; next = candidate; better = true; }
        }
        if better { x = next; } else { step = step * SHRINK; }
    }
    moved[o] = vec4<f32>(moved[o].xyz + x * unit, 0.0);
}
