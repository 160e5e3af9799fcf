//! Array constructors that work element by element, for kernels.
//!
//! The standard library's functions of these names drop the finished elements if a closure panics.
//! Each closure therefore compiles to about ten functions. Kernels are compiled for many types, and
//! these functions were a seventh of the engine's code before optimization. Elements that are
//! `Copy` need no such cleanup.

/// Returns an array whose elements are computed from their indices.
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

/// Returns an array whose elements are computed from those of another array.
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
