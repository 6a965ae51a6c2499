//! Typed indices of the elements of a surface.
//!
//! A half-edge is not taken for a vertex where each has a type. The numbers are 32 bits wide, which halves the memory
//! of connectivity; arrays that go to kernels or come from files hold the bare `u32` and say in words what they count.

use std::fmt;

/// Most elements an index type can name: 2³² − 2, so that `u32::MAX` may mean "none".
pub const MAX_ELEMENTS: usize = u32::MAX as usize - 1;

/// An index of one kind of element. An id belongs to one mesh and says nothing of which: after elements were dropped or
/// renumbered, old ids mean others.
pub trait Id: Copy + Eq + Ord {
    /// The number of this id.
    fn index(self) -> usize;
}

macro_rules! ids {
    ($($(#[$doc:meta])* $name:ident),* $(,)?) => {$(
        $(#[$doc])*
        #[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default)]
        #[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
        pub struct $name(pub u32);

        impl Id for $name {
            fn index(self) -> usize {
                self.0 as usize
            }
        }
        impl fmt::Debug for $name {
            fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                write!(f, concat!(stringify!($name), "({})"), self.0)
            }
        }
        impl fmt::Display for $name {
            fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                self.0.fmt(f)
            }
        }
    )*};
}

ids! {
    /// A vertex of a mesh.
    VertexId,
    /// A triangle or quad of a mesh.
    FaceId,
    /// A half-edge: corner `k` of face `f` in an N-gon mesh is half-edge `N f + k`.
    HalfedgeId,
}
