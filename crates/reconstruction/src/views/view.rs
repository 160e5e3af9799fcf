//! Views over cells: projects cells into an image and decides whether they are shown to be empty.

use super::picture::Picture;
use super::text::ViewText;
use crate::linear::Linear;
use crate::source::{Block, Place};
use spinney_base::{Error, Result};

/// An image, and the projection of cells into it.
pub(super) struct View {
    picture: Picture,
    /// Column and row, in pixels from the left and upper edge of the image.
    place: [Linear; 2],
    /// Depth, away from the viewer, in units of samples.
    depth: Linear,
}

impl View {
    /// Reads a view's image and sets up the projection of the cells of a frame, with `cells` cells
    /// along a side. `left` and `reading` are memory limits: see [`Picture::open`].
    pub(super) fn open(
        view: &ViewText,
        (frame, cells): (&[[f64; 4]; 3], f64),
        (left, reading): (&mut u64, u64),
    ) -> Result<View> {
        let picture = Picture::open(view, left, reading)?;
        let ViewText { axes: [right, up, towards], centre, pixel, scale, offset, .. } = view;
        // Scalar product with a vector, relative to that of the centre, in units of `width`.
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

    /// Classifies a block: the view shows it to be empty (`Void`), or shows no cell in it to be
    /// empty (`Full`).
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

    /// Whether the view does not show a position, in cell coordinates, to be empty.
    pub(super) fn leaves(&self, place: [f64; 3]) -> bool {
        let [column, row] = [0, 1].map(|axis| self.place[axis].at(place));
        let [columns, rows] = self.picture.size.map(|pixels| pixels as f64);
        let is_within = (0.0..columns).contains(&column) && (0.0..rows).contains(&row);
        is_within && self.depth.at(place) >= f64::from(self.picture.depth([column as u64, row as u64]))
    }
}
