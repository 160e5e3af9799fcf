//! Faces of the exact surface in a box.

use crate::face_set::FaceSet;
use crate::{ExactModel, Face, FaceBuffer, Faces, Grid, ModelNode, ModelNodeState};
use spinney_base::{Error, Result};

/// Faces of a model in a box, without values.
struct FacesInBox<'a> {
    model: &'a ExactModel,
    numbers: FaceSet,
    len: u64,
}

impl ExactModel {
    /// Finds the faces in a box of the world, by its minimum and maximum coordinates: all that have
    /// an area and a point in the box, and some whose own boxes touch it. Reads only nodes that
    /// meet the box and their faces, and holds a bit per face of the model.
    ///
    /// # Errors
    /// If the box is invalid, or if the file is corrupt or cannot be read.
    pub fn in_box(&self, corners: [[f64; 3]; 2]) -> Result<impl Faces + '_> {
        let [low, high] = corners.map(|corner| self.grid().to_grid(corner));
        check_box(corners)?;
        let touches = |min: [f64; 3], max: [f64; 3]| {
            (0..3).all(|axis| min[axis] <= high[axis] && max[axis] >= low[axis])
        };
        let mut found = FacesInBox { model: self, numbers: FaceSet::new(Faces::len(self)), len: 0 };
        let mut buffer = FaceBuffer::default();
        let mut pending: Vec<ModelNode<'_>> = vec![self.root()?];
        while let Some(node) = pending.pop() {
            let [min, max] = node.bounds(self.grid()).map(|corner| corner.map(|at| at as f64 / 2.0));
            if !touches(min, max) {
                continue;
            }
            if node.state() == ModelNodeState::Inner {
                pending.extend(self.children(&node)?.into_iter().flatten());
                continue;
            }
            for number in node.faces().filter(|number| !found.numbers.has(*number)).collect::<Vec<_>>() {
                self.face(number, &mut buffer)?;
                let (mut min, mut max) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
                for point in buffer.face().points {
                    for axis in 0..3 {
                        min[axis] = min[axis].min(point[axis].into());
                        max[axis] = max[axis].max(point[axis].into());
                    }
                }
                if touches(min, max) {
                    found.numbers.set(number, true);
                    found.len += 1;
                }
            }
        }
        Ok(found)
    }
}

/// Fails for a box without finite corners, or whose minimum is above its maximum.
pub(super) fn check_box([min, max]: [[f64; 3]; 2]) -> Result<()> {
    if (0..3).all(|axis| min[axis] <= max[axis]) {
        return Ok(());
    }
    let expected = "minimum coordinates, and maximum coordinates that are not smaller";
    Err(Error::invalid("box", format!("{min:?} to {max:?}"), expected))
}

impl Faces for FacesInBox<'_> {
    fn grid(&self) -> &Grid {
        self.model.grid()
    }

    fn parts(&self) -> &[String] {
        self.model.parts()
    }

    fn origin(&self) -> Option<&dyn Faces> {
        Some(self.model)
    }

    fn len(&self) -> u64 {
        self.len
    }

    fn each(&self, each: &mut dyn FnMut(&Face<'_>) -> Result<()>) -> Result<()> {
        let mut buffer = FaceBuffer::default();
        (0..).zip(self.numbers.numbers()).try_for_each(|(number, face)| {
            self.model.face(face.into(), &mut buffer)?;
            each(&Face { number, ..buffer.face() })
        })
    }
}
