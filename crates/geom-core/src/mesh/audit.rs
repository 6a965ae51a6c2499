//! Closed, manifold, oriented? Reports that name the elements.
