//! Typed indices, and one value per element.

use std::fmt;
use std::marker::PhantomData;
use std::ops::{Index, IndexMut};

/// Most elements an index type can name: 2³² − 2, so that `u32::MAX` may mean "none".
pub const MAX_ELEMENTS: usize = u32::MAX as usize - 1;

/// An index of one kind of element.
pub trait Id: Copy + Eq + Ord {
    /// The id with this number. Numbers above [`MAX_ELEMENTS`] are a bug of the caller.
    fn new(index: usize) -> Self;
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
            fn new(index: usize) -> Self {
                Self(u32::try_from(index).expect("more than 2³² − 2 elements"))
            }
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
    /// A tetrahedron.
    CellId,
    /// An atom of a [`Structure`](crate::Structure).
    AtomId,
}

/// One value per element of one kind: a per-face array cannot be read with a vertex.
///
/// ```
/// use geom_core::{FaceId, Per};
/// let area: Per<FaceId, f64> = Per::from(vec![0.5, 1.5]);
/// assert_eq!(area[FaceId(1)], 1.5);
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Per<I, T> {
    values: Vec<T>,
    id: PhantomData<fn(I)>,
}

impl<I: Id, T> Per<I, T> {
    /// The number of elements.
    pub fn len(&self) -> usize {
        self.values.len()
    }
    /// Is there no element?
    pub fn is_empty(&self) -> bool {
        self.values.is_empty()
    }
    /// The values in index order.
    pub fn as_slice(&self) -> &[T] {
        &self.values
    }
    /// The values in index order.
    pub fn as_mut_slice(&mut self) -> &mut [T] {
        &mut self.values
    }
    /// Gives the vector away.
    pub fn into_vec(self) -> Vec<T> {
        self.values
    }
    /// Each id with its value, in index order.
    pub fn iter(&self) -> impl Iterator<Item = (I, &T)> {
        self.values.iter().enumerate().map(|(i, v)| (I::new(i), v))
    }
    /// The value of an element, or `None` beyond the last.
    pub fn get(&self, id: I) -> Option<&T> {
        self.values.get(id.index())
    }
}

impl<I: Id, T> From<Vec<T>> for Per<I, T> {
    fn from(values: Vec<T>) -> Self {
        Self {
            values,
            id: PhantomData,
        }
    }
}

impl<I: Id, T> Index<I> for Per<I, T> {
    type Output = T;
    fn index(&self, id: I) -> &T {
        &self.values[id.index()]
    }
}

impl<I: Id, T> IndexMut<I> for Per<I, T> {
    fn index_mut(&mut self, id: I) -> &mut T {
        &mut self.values[id.index()]
    }
}
