//! Where kernels run, how closely two backends must agree, and how one fails.

use std::error::Error;
use std::fmt;
use std::sync::Arc;

/// A place where kernels run. Each algorithm crate has a trait of its own above this one that names
/// its hot kernels; [`Cpu`] and `Wgpu` (feature `wgpu`) implement them all, and a caller's own type may.
///
/// Verbs take a backend by reference, in a [`Run`](crate::Run). What differs between two is where kernels run and the
/// last digits of what they give, within their [`Agreement`].
pub trait Backend: Send + Sync {
    /// A name for reports, e.g. `cpu` or `wgpu (llvmpipe)`.
    fn name(&self) -> String;
}

/// Declares a supertrait `$object` of a backend trait whose `$method` gives any backend as a trait object. A verb
/// takes backends of every type and hands the object on: what it does is compiled once, in its own crate, and not
/// again in each program for each type.
#[doc(hidden)]
#[macro_export]
macro_rules! backend_object {
    ($object:ident, $method:ident -> $backend:ident) => {
        #[doc(hidden)]
        pub trait $object {
            fn $method(&self) -> &(dyn $backend + '_);
        }
        impl<B: $backend> $object for B {
            fn $method(&self) -> &(dyn $backend + '_) {
                self
            }
        }
    };
}

/// The CPU: f64 where it matters, the caller's rayon pool. The specification. What it gives has the same bits for any
/// number of threads, which makes it the side that others are compared with.
#[derive(Clone, Copy, Debug, Default)]
pub struct Cpu;

impl Backend for Cpu {
    fn name(&self) -> String {
        "cpu".to_owned()
    }
}

/// Whatever a backend failed of: the one form in which the errors of the algorithms carry it, so that a backend
/// from outside has an error to return.
///
/// ```
/// use geom_core::compute::BackendError;
/// let error = BackendError::new(std::io::Error::other("the device is gone"));
/// assert_eq!(error.to_string(), "the device is gone");
/// assert!(error.downcast_ref::<std::io::Error>().is_some());
/// ```
#[derive(Clone)]
pub struct BackendError(Arc<dyn Error + Send + Sync>);

impl BackendError {
    /// Wraps the backend's own error, or a message. Cloning shares it.
    pub fn new(error: impl Into<Box<dyn Error + Send + Sync>>) -> Self {
        Self(error.into().into())
    }

    /// Nothing where the answer `holds` to its question, else the error that says what the backend of this name gave: one
    /// from outside may answer anything, and should be blamed before it becomes a panic or a silent gap further on.
    ///
    /// ```
    /// use geom_core::compute::BackendError;
    /// let (found, of) = (41, 42);
    /// let error = BackendError::unless(found == of, "mine", || format!("{found} values for {of} rows"));
    /// assert_eq!(error.unwrap_err().to_string(), "mine gave 41 values for 42 rows");
    /// ```
    ///
    /// # Errors
    /// The sentence "*backend* gave …" where `holds` is false; `gave` is only called then.
    pub fn unless(holds: bool, backend: &str, gave: impl FnOnce() -> String) -> Result<(), Self> {
        if holds {
            return Ok(());
        }
        Err(Self::new(format!("{backend} gave {}", gave())))
    }

    /// The backend's own error, if it is of this type.
    pub fn downcast_ref<E: Error + 'static>(&self) -> Option<&E> {
        self.0.downcast_ref()
    }
}

impl fmt::Debug for BackendError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Debug::fmt(&self.0, f)
    }
}

impl fmt::Display for BackendError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Display::fmt(&self.0, f)
    }
}

impl Error for BackendError {
    fn source(&self) -> Option<&(dyn Error + 'static)> {
        self.0.source()
    }
}

/// Errors are equal if they say the same.
impl PartialEq for BackendError {
    fn eq(&self, other: &Self) -> bool {
        self.to_string() == other.to_string()
    }
}

/// What a kernel of one backend owes to the specification; declared next to the trait that names
/// the kernel.
///
/// A bound comes with its reason: the format of the numbers, how many operations lie between input and result, what
/// cancels. Choose [`Agreement::Exact`] where decisions hang on the answer, since a sign that is nearly right is wrong.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Agreement {
    /// Equal bits: minima, counts, signs, indices. 0 and −0 are equal, too.
    Exact,
    /// `|candidate − reference| ≤ absolute + relative · |reference|`.
    Bounded {
        /// Share of the reference.
        relative: f64,
        /// In the unit of the values.
        absolute: f64,
    },
}

/// The first place where two arrays break their [`Agreement`]. Reference and candidate are widened to f64 where the
/// arrays are f32.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Break {
    /// Index of the value; the shorter length when the lengths differ.
    pub index: usize,
    /// What the specification gives (NaN beyond its end).
    pub reference: f64,
    /// What the other backend gives (NaN beyond its end).
    pub candidate: f64,
}

impl Agreement {
    /// The first value that breaks the agreement, or `None`. Values equal in bits always agree; a
    /// NaN agrees with nothing but NaN.
    pub fn first_break<T: Copy + Into<f64>>(
        &self,
        reference: &[T],
        candidate: &[T],
    ) -> Option<Break> {
        if reference.len() != candidate.len() {
            let index = reference.len().min(candidate.len());
            let at = |s: &[T]| s.get(index).map_or(f64::NAN, |&v| v.into());
            return Some(Break {
                index,
                reference: at(reference),
                candidate: at(candidate),
            });
        }
        reference
            .iter()
            .zip(candidate)
            .enumerate()
            .find_map(|(index, (&r, &c))| {
                let (r, c) = (r.into(), c.into());
                let agrees = r.to_bits() == c.to_bits()
                    || (r.is_nan() && c.is_nan())
                    || match *self {
                        Self::Exact => r == c,
                        Self::Bounded { relative, absolute } => {
                            (c - r).abs() <= absolute + relative * r.abs()
                        }
                    };
                (!agrees).then_some(Break {
                    index,
                    reference: r,
                    candidate: c,
                })
            })
    }
}
