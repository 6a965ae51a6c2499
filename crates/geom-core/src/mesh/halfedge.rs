//! Connectivity of triangles and quads as half-edges.
