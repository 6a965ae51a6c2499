// The density at the points of bricks, half a brick (8 x 8 x 4 points) per workgroup, from the members that
// `cull.wgsl` kept. Sums are logarithms to base 2, so that nothing underflows before the powers.

// Levels of the tree: given when the kernel is compiled, so that loops over them unroll and open sums stay in registers.
override DEPTH: u32 = 8u;

struct Params {
    spacing: f32,
    pad0: u32,
    pad1: u32,
    pad2: u32,
}

struct Brick {
    // The first point from the block's centre, Å.
    corner: vec3<f32>,
    // Its members.
    first: u32,
    count: u32,
    pad0: u32,
    pad1: u32,
    pad2: u32,
}

const CHUNK: u32 = 256u;
const LARGEST: f32 = 127.999;

@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(2) var<storage, read> members: array<u32>;
@group(0) @binding(3) var<storage, read> bricks: array<Brick>;
// 512 per brick.
@group(0) @binding(4) var<storage, read_write> values: array<f32>;
// The lowest value per half brick.
@group(0) @binding(5) var<storage, read_write> lowest: array<f32>;

var<workgroup> staged: array<vec4<f32>, CHUNK>;
// Lift, the node above, and the number of levels that end after the member.
var<workgroup> staged_lift: array<f32, CHUNK>;
var<workgroup> staged_parent: array<u32, CHUNK>;
var<workgroup> staged_ends: array<u32, CHUNK>;
var<workgroup> count: u32;
var<workgroup> part: array<f32, 256>;

@compute @workgroup_size(8, 8, 4)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(local_invocation_id) local: vec3<u32>,
    @builtin(local_invocation_index) me: u32,
) {
    let brick = bricks[group.x];
    if me == 0u { count = brick.count; }
    let n = workgroupUniformLoad(&count);
    let point = vec3<u32>(local.x, local.y, local.z + 4u * group.y);
    let x = brick.corner + vec3<f32>(point) * params.spacing;

    var top: array<f32, 9>;
    var sum: array<f32, 9>;
    for (var l = 0u; l <= DEPTH; l += 1u) {
        top[l] = NOTHING;
        sum[l] = 0.0;
    }
    for (var start = 0u; start < n; start += CHUNK) {
        let m = start + me;
        if m < n {
            let item = items[members[brick.first + m]];
            staged[me] = item.at;
            staged_lift[me] = item.lift;
            staged_parent[me] = item.parent;
            var ends = DEPTH;
            if m + 1u < n {
                var a = item.parent;
                var b = items[members[brick.first + m + 1u]].parent;
                ends = 0u;
                while ends < DEPTH && a != b {
                    a = items[a].parent;
                    b = items[b].parent;
                    ends += 1u;
                }
            }
            staged_ends[me] = ends;
        }
        workgroupBarrier();
        let here = min(CHUNK, n - start);
        for (var i = 0u; i < here; i += 1u) {
            let d = x - staged[i].xyz;
            let term = staged_lift[i] - staged[i].w * dot(d, d);
            // One exponential, of whichever is the smaller.
            let rise = term - top[0];
            let share = exp2(-abs(rise));
            sum[0] = select(sum[0] + share, sum[0] * share + 1.0, rise > 0.0);
            top[0] = max(top[0], term);
            var node = staged_parent[i];
            let ends = staged_ends[i];
            for (var l = 0u; l < DEPTH; l += 1u) {
                if l >= ends { break; }
                let own = items[node].at.x * (top[l] + log2(sum[l]));
                let rise = own - top[l + 1u];
                let share = exp2(-abs(rise));
                sum[l + 1u] = select(sum[l + 1u] + share, sum[l + 1u] * share + 1.0, rise > 0.0);
                top[l + 1u] = max(top[l + 1u], own);
                top[l] = NOTHING;
                sum[l] = 0.0;
                node = items[node].parent;
            }
        }
        workgroupBarrier();
    }
    var value = 0.0;
    if sum[DEPTH] > 0.0 { value = exp2(min(top[DEPTH] + log2(sum[DEPTH]), LARGEST)); }
    values[group.x * 512u + group.y * 256u + me] = value;
    part[me] = value;
    for (var width = 128u; width > 0u; width /= 2u) {
        workgroupBarrier();
        if me < width { part[me] = min(part[me], part[me + width]); }
    }
    if me == 0u { lowest[group.x * 2u + group.y] = part[0]; }
}
