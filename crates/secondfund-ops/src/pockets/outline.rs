//! The part of a surface that a pocket is: patches of the secondary Laplace operator with Ψ = e^{−H}.
