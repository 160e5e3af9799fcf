//! Summaries of image rectangles, from a pyramid of nodes of 2 x 2, 4 x 4, ... pixels.

/// Maximum number of nodes along each axis that a query reads.
const MAX_ALONG: u64 = 4;

/// Nodes over pixels. A node's value joins the values of its pixels.
pub(super) struct Pyramid<N> {
    /// Number of columns and rows of pixels.
    size: [u64; 2],
    /// Nodes of 2 x 2 pixels, of 4 x 4 pixels, and so on, each level by rows.
    levels: Vec<Vec<N>>,
}

/// Returns the number of columns and rows of a level; level 0 are the pixels.
fn size_at(size: [u64; 2], level: usize) -> [u64; 2] {
    size.map(|along| along.div_ceil(1 << level))
}

/// Returns the number of nodes of an image with a number of columns and rows, saturating.
pub(super) fn nodes(size: [u64; 2]) -> u64 {
    let mut sum = 0u64;
    for level in 1.. {
        let [columns, rows] = size_at(size, level);
        sum = sum.saturating_add(columns.saturating_mul(rows));
        if columns.max(rows) <= 1 {
            break;
        }
    }
    sum
}

impl<N: Copy> Pyramid<N> {
    /// Builds the pyramid of an image.
    pub(super) fn new(size: [u64; 2], pixel: &dyn Fn(u64, u64) -> N, join: &dyn Fn(N, N) -> N) -> Pyramid<N> {
        let mut levels: Vec<Vec<N>> = Vec::new();
        for level in 1.. {
            let ([columns, rows], [below, rows_below]) = (size_at(size, level), size_at(size, level - 1));
            let at = |column: u64, row: u64| match levels.last() {
                Some(nodes) => nodes[(row * below + column) as usize],
                None => pixel(column, row),
            };
            let mut nodes = Vec::with_capacity((columns * rows) as usize);
            for row in 0..rows {
                for column in 0..columns {
                    let (left, top) = (2 * column, 2 * row);
                    let mut node = at(left, top);
                    for (across, down) in [(1, 0), (0, 1), (1, 1)] {
                        if left + across < below && top + down < rows_below {
                            node = join(node, at(left + across, top + down));
                        }
                    }
                    nodes.push(node);
                }
            }
            levels.push(nodes);
            if columns.max(rows) <= 1 {
                break;
            }
        }
        Pyramid { size, levels }
    }

    /// Returns a summary of a rectangle, from its first column and row to its last, or of a larger
    /// one. `join` must be idempotent, commutative and associative.
    pub(super) fn within(
        &self,
        [first, last]: [[u64; 2]; 2],
        pixel: &dyn Fn(u64, u64) -> N,
        join: &dyn Fn(N, N) -> N,
    ) -> N {
        // (The finest level with few nodes over the rectangle. Nodes at its border extend beyond
        // it, which makes bounds less tight, but never invalid.)
        let is_small =
            |level: &usize| (0..2).all(|axis| (last[axis] >> level) - (first[axis] >> level) < MAX_ALONG);
        let level = (0..=self.levels.len()).find(is_small).unwrap_or(self.levels.len());
        let columns = size_at(self.size, level)[0];
        let at = |column: u64, row: u64| match level {
            0 => pixel(column, row),
            _ => self.levels[level - 1][(row * columns + column) as usize],
        };
        let ([left, top], [right, bottom]) = (first.map(|at| at >> level), last.map(|at| at >> level));
        let mut found = at(left, top);
        for row in top..=bottom {
            for column in left..=right {
                found = join(found, at(column, row));
            }
        }
        found
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rectangles_have_what_their_pixels_have() {
        for size in [[1, 1], [5, 3], [17, 40], [64, 1]] {
            let pixel = |column: u64, row: u64| {
                let value = (column * 7919 + row * 104_729) % 1009;
                [value, value]
            };
            let join = |a: [u64; 2], b: [u64; 2]| [a[0].min(b[0]), a[1].max(b[1])];
            let pyramid = Pyramid::new(size, &pixel, &join);
            assert_eq!(nodes(size), pyramid.levels.iter().map(|nodes| nodes.len() as u64).sum::<u64>());
            for left in 0..size[0] {
                for right in left..size[0] {
                    let rectangle = [[left, 0], [right, size[1] - 1]];
                    let [least, most] = pyramid.within(rectangle, &pixel, &join);
                    let all = (left..=right).flat_map(|column| (0..size[1]).map(move |row| (column, row)));
                    let exact = all.map(|(column, row)| pixel(column, row)).reduce(join).unwrap();
                    assert!(least <= exact[0] && most >= exact[1]);
                    let is_small = right - left < MAX_ALONG && size[1] <= MAX_ALONG;
                    assert!(!is_small || [least, most] == exact);
                }
            }
        }
    }
}
