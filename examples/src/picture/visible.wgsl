// Writes the number of the nearest triangle into each pixel.

struct Corner {
    @location(0) place: vec3<f32>,
    @location(1) number: u32,
}

struct Seen {
    @builtin(position) place: vec4<f32>,
    @location(0) @interpolate(flat) number: u32,
}

@vertex
fn corner(in: Corner) -> Seen {
    return Seen(vec4(in.place, 1.0), in.number);
}

@fragment
fn pixel(in: Seen) -> @location(0) u32 {
    return in.number;
}
