// The atoms of cells, one per thread, and the terms that were found at the points of their cells.

struct Slot {
    // The atom's item, and the points of its cell.
    item: u32,
    first: u32,
    end: u32,
    pad0: u32,
}

@group(0) @binding(4) var<storage, read> terms: array<f32>;
@group(0) @binding(5) var<storage, read> slots: array<Slot>;
