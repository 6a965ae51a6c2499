// The proper rotation that takes each node's neighbourhood at rest nearest to where it is now: the eigenvector of the
// largest eigenvalue of Horn's symmetric 4 × 4 matrix, a unit quaternion, by Jacobi's method. One thread per node.

@group(0) @binding(5) var<storage, read_write> rotations: array<vec4<f32>>; // unit quaternions w, x, y, z

// Turns rows and columns p < q of a symmetric matrix so that their common entry is 0; v holds the eigenvectors.
fn turn(a: ptr<function, array<array<f32, 4>, 4>>, v: ptr<function, array<array<f32, 4>, 4>>, p: u32, q: u32) {
    let apq = (*a)[p][q];
    if abs(apq) < 1e-30 { return; }
    let theta = ((*a)[q][q] - (*a)[p][p]) / (2.0 * apq);
    var t = 1.0 / (abs(theta) + sqrt(theta * theta + 1.0));
    if theta < 0.0 { t = -t; }
    if abs(theta) > 1e15 { t = 0.0; }
    let c = inverseSqrt(t * t + 1.0);
    let s = t * c;
    for (var k = 0u; k < 4u; k += 1u) {
        let x = (*a)[k][p];
        let y = (*a)[k][q];
        (*a)[k][p] = c * x - s * y;
        (*a)[k][q] = s * x + c * y;
    }
    for (var k = 0u; k < 4u; k += 1u) {
        let x = (*a)[p][k];
        let y = (*a)[q][k];
        (*a)[p][k] = c * x - s * y;
        (*a)[q][k] = s * x + c * y;
        let w = (*v)[k][p];
        let z = (*v)[k][q];
        (*v)[k][p] = c * w - s * z;
        (*v)[k][q] = s * w + c * z;
    }
}

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let i = id.y * groups.x * 64u + id.x;
    if i >= task.nodes { return; }
    let p = rest[i].xyz;
    let x = now[i].xyz;
    // Columns of S = sum (x_i - x_j)(p_i - p_j)^T.
    var sx = vec3<f32>();
    var sy = vec3<f32>();
    var sz = vec3<f32>();
    for (var at = starts[i]; at < starts[i + 1u]; at += 1u) {
        let e = p - rest[others[at]].xyz;
        let d = x - now[others[at]].xyz;
        sx += d * e.x;
        sy += d * e.y;
        sz += d * e.z;
    }
    let size = sqrt(dot(sx, sx) + dot(sy, sy) + dot(sz, sz));
    if !(size > 0.0) {
        rotations[i] = vec4<f32>(1.0, 0.0, 0.0, 0.0);
        return;
    }
    sx /= size;
    sy /= size;
    sz /= size;
    // Row r of column c of S is how much of direction c at rest is along r now.
    var a: array<array<f32, 4>, 4>;
    a[0][0] = sx.x + sy.y + sz.z;
    a[1][1] = sx.x - sy.y - sz.z;
    a[2][2] = sy.y - sx.x - sz.z;
    a[3][3] = sz.z - sx.x - sy.y;
    a[0][1] = sy.z - sz.y;
    a[0][2] = sz.x - sx.z;
    a[0][3] = sx.y - sy.x;
    a[1][2] = sx.y + sy.x;
    a[1][3] = sz.x + sx.z;
    a[2][3] = sy.z + sz.y;
    var v: array<array<f32, 4>, 4>;
    for (var k = 0u; k < 4u; k += 1u) {
        for (var l = 0u; l < k; l += 1u) { a[k][l] = a[l][k]; }
        v[k][k] = 1.0;
    }
    for (var sweep = 0u; sweep < 6u; sweep += 1u) {
        for (var k = 0u; k < 3u; k += 1u) {
            for (var l = k + 1u; l < 4u; l += 1u) { turn(&a, &v, k, l); }
        }
    }
    var best = 0u;
    for (var k = 1u; k < 4u; k += 1u) {
        if a[k][k] > a[best][best] { best = k; }
    }
    rotations[i] = normalize(vec4<f32>(v[0][best], v[1][best], v[2][best], v[3][best]));
}
