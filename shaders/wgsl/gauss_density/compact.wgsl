// Copies the values of chosen bricks to the front, so that the others are not downloaded.

@group(0) @binding(0) var<storage, read> chosen: array<u32>;
@group(0) @binding(1) var<storage, read> values: array<f32>;
@group(0) @binding(2) var<storage, read_write> out: array<f32>;

@compute @workgroup_size(256)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) me: u32) {
    let source = chosen[group.x] * 512u;
    let to = group.x * 512u;
    out[to + me] = values[source + me];
    out[to + 256u + me] = values[source + 256u + me];
}
