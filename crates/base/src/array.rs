//! Arrays made element by element, for kernels.
//!
//! The standard library's functions of these names drop the elements made so far if a closure panics, so that each closure
//! compiles to about ten functions. In kernels, which are compiled for many types, these were a seventh of the engine's code
//! before optimization. Elements that are `Copy` need none of that.

/// An array of elements made from their indices.
#[inline]
pub fn from_fn<T: Copy + Default, const N: usize>(mut element: impl FnMut(usize) -> T) -> [T; N] {
    let mut array = [T::default(); N];
    let mut index = 0;
    while index < N {
        array[index] = element(index);
        index += 1;
    }
    array
}

/// An array of elements made from those of another one.
#[inline]
pub fn map<T: Copy, U: Copy + Default, const N: usize>(
    array: [T; N],
    mut element: impl FnMut(T) -> U,
) -> [U; N] {
    let mut mapped = [U::default(); N];
    let mut index = 0;
    while index < N {
        mapped[index] = element(array[index]);
        index += 1;
    }
    mapped
}
