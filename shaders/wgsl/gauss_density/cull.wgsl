// Which atoms matter in a brick, one workgroup per brick. Bounds are logarithms to base 2.
//
// A leaf's bound is the product, over the nodes on its way to the root, of bounds on the share of each
// child in its node's sum, times max(1, P) for each power passed: what the density loses at most, as a
// share, without the leaf. Dropped are as many leaves, from the smallest bound, as together stay below ε.

struct Params {
    depth: u32,
    // Half the side of a brick's box, Å.
    half: f32,
    // log2 of the floor, and of ε.
    floor: f32,
    eps: f32,
}

struct Brick {
    // Centre of the box from the block's centre, Å.
    center: vec3<f32>,
    // Start of the block's row in `ranges`: where atoms and the nodes of each level start, and the end.
    row: u32,
    // Where the brick's part of `state` and of `members` starts.
    state: u32,
    members: u32,
    pad0: u32,
    pad1: u32,
}

// For rounding, in every bound.
const SLACK: f32 = 0.01;
const RELATIVE_SLACK: f32 = 4.0e-6;
const THREADS: u32 = 64u;

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(2) var<storage, read> ranges: array<u32>;
@group(0) @binding(3) var<storage, read> bricks: array<Brick>;
// Per item: upper bound of its term in the box; its best leaf's term at the centre, weight, and place
// among the block's atoms.
@group(0) @binding(4) var<storage, read_write> state: array<vec4<f32>>;
// Per item: bound relative to the reference, and bound on the share of the density.
@group(0) @binding(5) var<storage, read_write> bounds: array<vec2<f32>>;
@group(0) @binding(6) var<storage, read_write> members: array<u32>;
// Per brick: number of members, and 1 unless nothing reaches the floor.
@group(0) @binding(7) var<storage, read_write> found: array<vec2<u32>>;

var<workgroup> part: array<vec4<f32>, THREADS>;
var<workgroup> part_sum: array<f32, THREADS>;
var<workgroup> root: vec4<f32>;
var<workgroup> reaches: u32;
var<workgroup> bins: array<atomic<u32>, 64>;
var<workgroup> threshold: f32;
var<workgroup> counts: array<u32, THREADS>;

fn everyone() {
    storageBarrier();
    workgroupBarrier();
}

// The larger of two candidates by y, the first on ties.
fn better(a: vec4<f32>, b: vec4<f32>) -> vec4<f32> {
    if b.y > a.y { return b; }
    return a;
}

// The maximum of w q_b - q_a over the box.
fn bracket(a: Item, b: Item, w: f32, center: vec3<f32>) -> f32 {
    let da = center - a.at.xyz;
    let db = center - b.at.xyz;
    let ka = a.at.w;
    let kb = w * b.at.w;
    let bend = kb - ka;
    let slope = abs(2.0 * (kb * db - ka * da));
    let qa = ka * dot(da, da) - a.lift;
    let qb = kb * dot(db, db) - w * b.lift;
    var value = qb - qa;
    for (var k = 0u; k < 3u; k += 1u) {
        let s = slope[k];
        if bend < 0.0 && s < -2.0 * bend * params.half {
            value += s * s / (-4.0 * bend);
        } else {
            value += (bend * params.half + s) * params.half;
        }
    }
    return value + SLACK + RELATIVE_SLACK * (abs(qa) + abs(qb) + w * b.lift + a.lift);
}

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) me: u32) {
    let brick = bricks[group.x];
    let depth = params.depth;
    let base = ranges[brick.row];
    let atoms_end = ranges[brick.row + 1u];
    // Item i of the block has its state at i + shift.
    let shift = brick.state - base;

    for (var i = base + me; i < atoms_end; i += THREADS) {
        let a = items[i];
        let d = brick.center - a.at.xyz;
        let gap = max(abs(d) - vec3<f32>(params.half), vec3<f32>(0.0));
        let ln = a.lift - a.at.w * dot(d, d);
        let up = a.lift - a.at.w * dot(gap, gap);
        let slack = SLACK + RELATIVE_SLACK * (abs(up) + a.lift);
        state[i + shift] = vec4<f32>(up + slack, ln, 1.0, f32(i - base));
    }
    everyone();
    for (var level = 0u; level < depth; level += 1u) {
        let end = ranges[brick.row + level + 2u];
        for (var v = ranges[brick.row + level + 1u] + me; v < end; v += THREADS) {
            let node = items[v];
            var best = state[node.first + shift];
            var top = best.x;
            var sum = 1.0;
            for (var c = node.first + 1u; c < node.end; c += 1u) {
                let child = state[c + shift];
                best = better(best, child);
                if child.x > top {
                    sum = sum * exp2(top - child.x) + 1.0;
                    top = child.x;
                } else {
                    sum += exp2(child.x - top);
                }
            }
            let power = node.at.x;
            state[v + shift] = vec4<f32>(power * (top + log2(sum)) + SLACK, power * best.y,
                power * best.z, best.w);
        }
        everyone();
    }

    // The root.
    let top_first = ranges[brick.row + depth];
    let top_end = ranges[brick.row + depth + 1u];
    var best = vec4<f32>(NOTHING, NOTHING, 0.0, 0.0);
    var sum = 0.0;
    var top = NOTHING;
    for (var c = top_first + me; c < top_end; c += THREADS) {
        let child = state[c + shift];
        best = better(best, child);
        if child.x > top {
            sum = sum * exp2(top - child.x) + 1.0;
            top = child.x;
        } else {
            sum += exp2(child.x - top);
        }
    }
    best.x = top;
    part[me] = best;
    part_sum[me] = sum;
    atomicStore(&bins[me], 0u);
    everyone();
    if me == 0u {
        var all = part[0];
        var total = part_sum[0];
        top = all.x;
        for (var t = 1u; t < THREADS; t += 1u) {
            let other = part[t];
            if other.x > top {
                total = total * exp2(top - other.x) + part_sum[t];
                top = other.x;
            } else if other.x > NOTHING {
                total += part_sum[t] * exp2(other.x - top);
            }
            all = better(all, other);
        }
        all.x = top + log2(max(total, 1.0)) + SLACK;
        root = all;
        reaches = select(0u, 1u, all.x >= params.floor);
    }
    if workgroupUniformLoad(&reaches) == 0u {
        if me == 0u { found[group.x] = vec2<u32>(0u, 0u); }
        return;
    }

    // From the root's children (step 0) down to the atoms (step `depth`).
    for (var step = 0u; step <= depth; step += 1u) {
        let level = depth - step;
        for (var a = base + me; a < atoms_end; a += THREADS) {
            // The ancestor at this level, and the powers on the way up to it.
            var c = a;
            var powers = 1.0;
            for (var l = 0u; l < level; l += 1u) {
                c = items[c].parent;
                powers *= items[c].at.x;
            }
            let v = items[c].parent;
            var reference = root;
            var weight = root.z;
            if v != ROOT {
                reference = state[v + shift];
                weight = reference.z / items[v].at.x;
            }
            let b = items[base + u32(reference.w)];
            bounds[a + shift].x = bracket(items[a], b, weight / powers, brick.center);
        }
        everyone();
        for (var l = 0u; l < level; l += 1u) {
            let end = ranges[brick.row + l + 2u];
            for (var v = ranges[brick.row + l + 1u] + me; v < end; v += THREADS) {
                let node = items[v];
                var most = NOTHING;
                for (var c = node.first; c < node.end; c += 1u) {
                    most = max(most, bounds[c + shift].x);
                }
                bounds[v + shift].x = node.at.x * (most + log2(f32(node.end - node.first))) + SLACK;
            }
            everyone();
        }
        let end = ranges[brick.row + level + 1u];
        for (var c = ranges[brick.row + level] + me; c < end; c += THREADS) {
            let v = items[c].parent;
            var share = min(bounds[c + shift].x, 0.0);
            if v == ROOT {
                // Only where the density reaches the floor.
                share = min(share, state[c + shift].x - params.floor);
            } else {
                share += bounds[v + shift].y + max(log2(items[v].at.x), 0.0);
            }
            bounds[c + shift].y = share;
        }
        everyone();
    }
    for (var a = base + me; a < atoms_end; a += THREADS) {
        let bin = u32(clamp(-bounds[a + shift].y, 0.0, 63.0));
        atomicAdd(&bins[bin], 1u);
    }
    everyone();
    if me == 0u {
        // Bounds in bin k are at most 2^-k.
        let budget = exp2(params.eps);
        var lost = 0.0;
        var k = 64u;
        loop {
            if k == 0u { break; }
            lost += f32(atomicLoad(&bins[k - 1u])) * exp2(-f32(k - 1u));
            if lost > budget { break; }
            k -= 1u;
        }
        threshold = -f32(k);
    }
    everyone();

    // Kept atoms in their order: each thread takes a run.
    let run = (atoms_end - base + THREADS - 1u) / THREADS;
    let first = min(base + me * run, atoms_end);
    let last = min(first + run, atoms_end);
    let limit = workgroupUniformLoad(&threshold);
    var kept = 0u;
    for (var a = first; a < last; a += 1u) {
        if bounds[a + shift].y > limit { kept += 1u; }
    }
    counts[me] = kept;
    everyone();
    var place = brick.members;
    for (var t = 0u; t < me; t += 1u) { place += counts[t]; }
    for (var a = first; a < last; a += 1u) {
        if bounds[a + shift].y > limit {
            members[place] = a;
            place += 1u;
        }
    }
    if me == THREADS - 1u { found[group.x] = vec2<u32>(place - brick.members, 1u); }
}
