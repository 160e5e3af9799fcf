//! Default frequencies of symbols, for contexts without a stored table.
//!
//! They are averages over elevation rasters and photographs. They are part of the format (section
//! 39 of formats.md lists the same tables), so they must not change. Rows of sixteens are uniform.

use std::sync::LazyLock;

use crate::contexts::{Contexts, Kind};
use crate::lanes::Lane;
use crate::tables::{Entry, Frequencies, STATES, write_entries};

/// Residuals in the first plane, by the bits of the expected size. The last row is for all larger
/// sizes.
#[rustfmt::skip]
const FIRST: [Frequencies; 12] = [
    [241, 3, 2, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 10],
    [0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 256],
    [212, 23, 15, 2, 2, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 2],
    [179, 39, 24, 5, 6, 1, 1, 0, 0, 0, 0, 0, 0, 0, 0, 1],
    [132, 53, 41, 10, 11, 4, 3, 1, 0, 0, 0, 0, 0, 0, 0, 1],
    [94, 59, 48, 15, 20, 8, 7, 3, 1, 0, 0, 0, 0, 0, 0, 1],
    [66, 43, 37, 23, 32, 22, 18, 7, 5, 1, 1, 0, 0, 0, 0, 1],
    [41, 30, 27, 20, 35, 27, 32, 18, 14, 5, 4, 1, 1, 0, 0, 1],
    [22, 19, 19, 15, 27, 23, 37, 27, 31, 15, 11, 4, 3, 1, 0, 2],
    [22, 21, 19, 17, 30, 25, 37, 26, 28, 12, 9, 3, 2, 1, 2, 2],
    [22, 20, 19, 17, 31, 25, 37, 24, 27, 12, 10, 5, 4, 1, 1, 1],
    [18, 17, 17, 16, 29, 25, 38, 26, 29, 14, 13, 5, 4, 1, 1, 3],
];

/// Residuals in other planes, by the same.
#[rustfmt::skip]
const OTHERS: [Frequencies; 12] = [
    [255, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 1],
    [254, 1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 1],
    [252, 2, 1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 1],
    [244, 8, 3, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 1],
    [231, 16, 8, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 1],
    [162, 59, 29, 3, 2, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 1],
    [110, 73, 47, 12, 11, 2, 0, 0, 0, 0, 0, 0, 0, 0, 0, 1],
    [86, 63, 46, 22, 25, 8, 4, 1, 0, 0, 0, 0, 0, 0, 0, 1],
    [53, 45, 39, 27, 39, 23, 20, 6, 3, 0, 0, 0, 0, 0, 0, 1],
    [58, 49, 38, 29, 38, 20, 16, 5, 2, 0, 0, 0, 0, 0, 0, 1],
    [60, 51, 38, 29, 37, 19, 15, 4, 2, 0, 0, 0, 0, 0, 0, 1],
    [57, 51, 37, 29, 36, 21, 17, 5, 2, 0, 0, 0, 0, 0, 0, 1],
];

/// Sums: four sizes for each number of halves from -4 to 4.
#[rustfmt::skip]
const SUMS: [Frequencies; 36] = [
    [16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16],
    [16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16],
    [16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16],
    [65, 60, 49, 58, 13, 6, 3, 1, 0, 0, 0, 0, 0, 0, 0, 1],
    [16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16],
    [16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16],
    [0, 0, 0, 0, 0, 227, 0, 28, 0, 0, 0, 0, 0, 0, 0, 1],
    [57, 56, 37, 76, 7, 16, 1, 5, 0, 0, 0, 0, 0, 0, 0, 1],
    [16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16],
    [16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16],
    [2, 17, 0, 203, 0, 30, 0, 3, 0, 0, 0, 0, 0, 0, 0, 1],
    [50, 54, 29, 101, 5, 13, 1, 2, 0, 0, 0, 0, 0, 0, 0, 1],
    [16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16],
    [16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16],
    [23, 71, 1, 157, 0, 3, 0, 0, 0, 0, 0, 0, 0, 0, 0, 1],
    [59, 69, 28, 90, 4, 4, 1, 0, 0, 0, 0, 0, 0, 0, 0, 1],
    [255, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 1],
    [253, 1, 1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 1],
    [211, 22, 18, 3, 1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 1],
    [113, 53, 48, 32, 7, 1, 1, 0, 0, 0, 0, 0, 0, 0, 0, 1],
    [16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16],
    [16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16],
    [71, 3, 119, 0, 60, 0, 2, 0, 0, 0, 0, 0, 0, 0, 0, 1],
    [78, 34, 86, 24, 29, 0, 4, 0, 0, 0, 0, 0, 0, 0, 0, 1],
    [16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16],
    [16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16],
    [6, 4, 24, 0, 189, 0, 31, 0, 1, 0, 0, 0, 0, 0, 0, 1],
    [63, 34, 69, 26, 47, 0, 15, 0, 1, 0, 0, 0, 0, 0, 0, 1],
    [16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16],
    [16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16],
    [0, 8, 11, 0, 32, 0, 172, 0, 32, 0, 0, 0, 0, 0, 0, 1],
    [66, 39, 66, 30, 28, 1, 21, 0, 4, 0, 0, 0, 0, 0, 0, 1],
    [16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16],
    [16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16],
    [16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16, 16],
    [69, 49, 64, 38, 24, 1, 9, 0, 1, 0, 0, 0, 0, 0, 0, 1],
];

/// Whether any of eight samples is not as expected: in the first plane, in others, and of sums.
#[rustfmt::skip]
const FLATS: [Frequencies; 3] = [
    [254, 2, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0],
    [255, 1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0],
    [255, 1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0],
];

/// Returns the tables of all contexts.
fn tables_of<T: Lane>() -> Vec<Frequencies> {
    let last = FIRST.len() - 1;
    (0..Contexts::<T>::COUNT)
        .map(|context| match Contexts::<T>::kind(context) {
            Kind::Residual { is_first: true, size } => FIRST[size.min(last)],
            Kind::Residual { is_first: false, size } => OTHERS[size.min(last)],
            Kind::Sum { halves, size } => SUMS[4 * halves + size],
            Kind::Flat(number) => FLATS[number],
        })
        .collect()
}

/// Tables of all contexts, and their entries for a reader.
struct Defaults {
    tables: Vec<Frequencies>,
    entries: Vec<Entry>,
}

impl Defaults {
    fn of<T: Lane>() -> Defaults {
        let tables = tables_of::<T>();
        let mut entries = vec![0; tables.len() * STATES];
        for (context, entries) in entries.chunks_exact_mut(STATES).enumerate() {
            write_entries::<T>(&tables[context], context, entries);
        }
        Defaults { tables, entries }
    }

    fn get<T: Lane>() -> &'static Defaults {
        static NARROW: LazyLock<Defaults> = LazyLock::new(Defaults::of::<i16>);
        static MIDDLE: LazyLock<Defaults> = LazyLock::new(Defaults::of::<i32>);
        static WIDE: LazyLock<Defaults> = LazyLock::new(Defaults::of::<i64>);
        match T::BITS {
            16 => &NARROW,
            32 => &MIDDLE,
            _ => &WIDE,
        }
    }
}

/// Returns the default tables of all contexts.
pub(crate) fn tables<T: Lane>() -> &'static [Frequencies] {
    &Defaults::get::<T>().tables
}

/// Returns the entries of the default tables for a reader, context by context.
pub(crate) fn entries<T: Lane>() -> &'static [Entry] {
    &Defaults::get::<T>().entries
}
