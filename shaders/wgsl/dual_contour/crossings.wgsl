// Signs of the corners of each finest cell of a block of 9 × 9 × 9 points: bit c is set if corner c
// (x + 2y + 4z) reaches the level. One workgroup per block, four cells along x per thread.

@group(0) @binding(0) var<storage, read> values: array<f32>; // 729 per block
@group(0) @binding(1) var<uniform> level: vec4<f32>; // x: the level
@group(0) @binding(2) var<storage, read_write> masks: array<u32>; // 128 per block, a byte per cell

fn sign(at: u32) -> u32 {
    return select(0u, 1u, values[at] >= level.x);
}

@compute @workgroup_size(128)
fn main(
    @builtin(workgroup_id) block: vec3<u32>,
    @builtin(local_invocation_index) slot: u32,
) {
    let x = 4u * (slot & 1u);
    let y = (slot >> 1u) & 7u;
    let z = slot >> 4u;
    var word = 0u;
    for (var i = 0u; i < 4u; i += 1u) {
        let at = block.x * 729u + (z * 9u + y) * 9u + x + i;
        let mask = sign(at) | (sign(at + 1u) << 1u)
            | (sign(at + 9u) << 2u) | (sign(at + 10u) << 3u)
            | (sign(at + 81u) << 4u) | (sign(at + 82u) << 5u)
            | (sign(at + 90u) << 6u) | (sign(at + 91u) << 7u);
        word |= mask << (8u * i);
    }
    masks[block.x * 128u + slot] = word;
}
