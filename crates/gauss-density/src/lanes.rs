//! The processor's vector instructions: the one place that asks which there are.

use geom_core::lanes::{Arch, NullaryFnOnce};

/// Work that is worth the vector instructions. `run` and all that it calls on the way to its loops must be
/// `#[inline(always)]`, since only what is inlined is compiled for them (so a closure would not do).
pub(crate) trait Work<A> {
    type Output;
    fn run(of: A) -> Self::Output;
}

/// Does work with the instruction set at hand.
pub(crate) fn with_lanes<W: Work<A>, A>(of: A) -> W::Output {
    struct Task<W, A>(A, std::marker::PhantomData<W>);
    impl<A, W: Work<A>> NullaryFnOnce for Task<W, A> {
        type Output = W::Output;
        #[inline(always)]
        fn call(self) -> W::Output {
            W::run(self.0)
        }
    }
    Arch::new().dispatch(Task::<W, A>(of, std::marker::PhantomData))
}
