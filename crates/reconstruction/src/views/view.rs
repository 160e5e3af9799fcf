//! Views over cells: projects cells into an image and decides whether they are shown to be empty.

use super::image::ViewImage;
use super::views_file::ViewDescription;
use crate::linear::Linear;
use crate::source::{Block, BlockState};
use spinney_base::{Error, Result};

/// An image, and the projection of cells into it.
pub(super) struct View {
    image: ViewImage,
    /// Column and row, in pixels from the left and upper edge of the image.
    projection: [Linear; 2],
    /// Depth, away from the viewer, in units of samples.
    depth: Linear,
}

impl View {
    /// Reads a view's image and sets up the projection of the cells of a frame, with `cells` cells
    /// along a side. `left` and `reading` are memory limits: see [`ViewImage::open`].
    pub(super) fn open(
        view: &ViewDescription,
        (frame, cells): (&[[f64; 4]; 3], f64),
        (left, reading): (&mut u64, u64),
    ) -> Result<View> {
        let image = ViewImage::open(view, left, reading)?;
        let ViewDescription { axes: [right, up, towards], centre, pixel, scale, offset, .. } = view;
        // Scalar product with a vector, relative to that of the centre, in units of `width`.
        let along = |vector: &[f64; 3], width: f64, shift: f64| {
            let origin: f64 = (0..3).map(|axis| vector[axis] * centre[axis]).sum();
            Linear::new(vector.map(|part| part / width), shift - origin / width, frame, cells)
        };
        let half = image.size.map(|pixels| pixels as f64 / 2.0);
        let projection = [along(right, *pixel, half[0]), along(up, -*pixel, half[1])];
        let depth = along(towards, -scale.abs(), -offset / scale.abs());
        if !projection.iter().chain([&depth]).all(Linear::is_finite) {
            let found = format!("centre {centre:?}, pixel {pixel}, scale {scale}, offset {offset}");
            let expected = "numbers with which positions of cells in the image are finite";
            return Err(Error::invalid(&view.name, found, expected));
        }
        Ok(View { image, projection, depth })
    }

    pub(super) fn is_silhouette(&self) -> bool {
        self.image.is_silhouette()
    }

    /// Classifies a block: the view shows it to be empty (`Void`), or shows no cell in it to be
    /// empty (`Full`).
    pub(super) fn classify(&self, block: Block) -> BlockState {
        let (mut first, mut last) = ([0; 2], [0; 2]);
        let mut is_within = true;
        for (axis, linear) in self.projection.iter().enumerate() {
            let ([least, most], size) = (linear.range(block), self.image.size[axis]);
            if most < 0.0 || least >= size as f64 {
                return BlockState::Void;
            }
            is_within &= least >= 0.0 && most < size as f64;
            first[axis] = least.max(0.0) as u64;
            last[axis] = (most as u64).min(size - 1);
        }
        let [nearest, farthest] = self.depth.range(block);
        let [least, most] = self.image.depths([first, last]).map(f64::from);
        if farthest < least {
            BlockState::Void
        } else if is_within && nearest >= most {
            BlockState::Full
        } else {
            BlockState::Mixed
        }
    }

    /// Whether the view does not show a position, in cell coordinates, to be empty.
    pub(super) fn leaves(&self, position: [f64; 3]) -> bool {
        let [column, row] = [0, 1].map(|axis| self.projection[axis].at(position));
        let [columns, rows] = self.image.size.map(|pixels| pixels as f64);
        let is_within = (0.0..columns).contains(&column) && (0.0..rows).contains(&row);
        is_within && self.depth.at(position) >= f64::from(self.image.depth([column as u64, row as u64]))
    }
}
