// Lowest and highest value of each block of 9 × 9 × 9 points: one workgroup per block.

@group(0) @binding(0) var<storage, read> values: array<f32>; // 729 per block
@group(0) @binding(1) var<storage, read_write> range: array<vec2<f32>>; // one per block

const POINTS = 729u;
var<workgroup> low: array<f32, 64>;
var<workgroup> high: array<f32, 64>;

@compute @workgroup_size(64)
fn main(
    @builtin(workgroup_id) block: vec3<u32>,
    @builtin(local_invocation_index) slot: u32,
) {
    let first = block.x * POINTS;
    var a = values[first + slot];
    var b = a;
    for (var i = slot + 64u; i < POINTS; i += 64u) {
        let v = values[first + i];
        a = min(a, v);
        b = max(b, v);
    }
    low[slot] = a;
    high[slot] = b;
    for (var half = 32u; half > 0u; half /= 2u) {
        workgroupBarrier();
        if slot < half {
            low[slot] = min(low[slot], low[slot + half]);
            high[slot] = max(high[slot], high[slot + half]);
        }
    }
    if slot == 0u {
        range[block.x] = vec2(low[0], high[0]);
    }
}
