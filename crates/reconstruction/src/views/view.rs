//! Views over cells: where a cell is in a picture, and whether it is seen to be empty.

use super::picture::Picture;
use super::text::ViewText;
use crate::linear::Linear;
use crate::source::{Block, Place};
use spinney_base::{Error, Result};

/// A picture, and where cells are in it.
pub(super) struct View {
    picture: Picture,
    /// Pixels from the left and upper edge of the picture.
    place: [Linear; 2],
    /// Depth, away from the viewer, in the picture's samples.
    depth: Linear,
}

impl View {
    /// Reads a view's picture, and lays it over the cells of a frame, so many along a side: see [`Picture::open`].
    pub(super) fn open(
        view: &ViewText,
        (frame, cells): (&[[f64; 4]; 3], f64),
        (left, reading): (&mut u64, u64),
    ) -> Result<View> {
        let picture = Picture::open(view, left, reading)?;
        let ViewText { axes: [right, up, towards], centre, pixel, scale, offset, .. } = view;
        // The product with a vector, less that of the centre, in units of a width.
        let along = |vector: &[f64; 3], width: f64, shift: f64| {
            let origin: f64 = (0..3).map(|axis| vector[axis] * centre[axis]).sum();
            Linear::new(vector.map(|part| part / width), shift - origin / width, frame, cells)
        };
        let half = picture.size.map(|pixels| pixels as f64 / 2.0);
        let place = [along(right, *pixel, half[0]), along(up, -*pixel, half[1])];
        let depth = along(towards, -scale.abs(), -offset / scale.abs());
        if !place.iter().chain([&depth]).all(Linear::is_finite) {
            let found = format!("centre {centre:?}, pixel {pixel}, scale {scale}, offset {offset}");
            let expected = "numbers by which places of cells can be computed";
            return Err(Error::invalid(&view.name, found, expected));
        }
        Ok(View { picture, place, depth })
    }

    pub(super) fn is_silhouette(&self) -> bool {
        self.picture.is_silhouette()
    }

    /// Verdict of the view on a block: that it is empty (`Void`), or that nothing in it is (`Full`).
    pub(super) fn place(&self, block: Block) -> Place {
        let (mut first, mut last) = ([0; 2], [0; 2]);
        let mut is_within = true;
        for (axis, linear) in self.place.iter().enumerate() {
            let ([least, most], size) = (linear.range(block), self.picture.size[axis]);
            if most < 0.0 || least >= size as f64 {
                return Place::Void;
            }
            is_within &= least >= 0.0 && most < size as f64;
            first[axis] = least.max(0.0) as u64;
            last[axis] = (most as u64).min(size - 1);
        }
        let [nearest, farthest] = self.depth.range(block);
        let [least, most] = self.picture.depths([first, last]).map(f64::from);
        if farthest < least {
            Place::Void
        } else if is_within && nearest >= most {
            Place::Full
        } else {
            Place::Mixed
        }
    }

    /// Whether the view leaves a place in cells.
    pub(super) fn leaves(&self, place: [f64; 3]) -> bool {
        let [column, row] = [0, 1].map(|axis| self.place[axis].at(place));
        let [columns, rows] = self.picture.size.map(|pixels| pixels as f64);
        let is_within = (0.0..columns).contains(&column) && (0.0..rows).contains(&row);
        is_within && self.depth.at(place) >= f64::from(self.picture.depth([column as u64, row as u64]))
    }
}
