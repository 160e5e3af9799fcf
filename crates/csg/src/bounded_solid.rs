//! A solid and the box that it is built in. An infinite solid is clipped to the box.

use std::sync::Arc;

use crate::affine::Affine;
use crate::expression::Instruction;
use crate::lowered::{Bounds, Instance, Lowered, has_volume, hull, is_finite};
use crate::model::{Csg, Primitive};
use crate::shape::Shape;
use crate::syntax::At;
use spinney_base::{Error, Result};

/// A finite solid.
pub(crate) struct BoundedSolid {
    pub(crate) primitives: Arc<Vec<Primitive>>,
    pub(crate) lowered: Lowered,
    /// The box that contains it.
    pub(crate) bounds: Bounds,
    /// A box around `bounds` and all finite primitives.
    pub(crate) around: Bounds,
    /// A remark on where it was clipped.
    pub(crate) ends: Option<String>,
}

impl Csg {
    /// Returns the solid with its box.
    pub(crate) fn bounded(&self) -> Result<BoundedSolid> {
        let Csg { path, primitives, lowered, bounds, .. } = self;
        let (mut primitives, mut lowered) = (primitives.clone(), lowered.clone());
        let boxes = lowered.boxes(&primitives);
        let own = lowered.bounds(&boxes);
        let mut finite = boxes.iter().filter(|bounds| is_finite(bounds)).copied();
        let finite = finite.next().map(|first| finite.fold(first, |all, next| hull(&all, &next)));
        let is_endless = has_volume(&own) && !is_finite(&own);
        let text = |[min, max]: &Bounds| {
            format!("{}, {}, {} to {}, {}, {}", min[0], min[1], min[2], max[0], max[1], max[2])
        };
        let (bounds, clip, ends) = match (bounds, finite) {
            (Some(given), _) => (*given, true, Some(format!("at its bounds, {}", text(given)))),
            (None, Some(finite)) if is_endless => {
                let ends = format!(
                    "the solid is infinite, and is clipped to the box around its finite primitives, {}; the statement bounds(...) sets another one",
                    text(&finite)
                );
                (finite, true, Some(ends))
            }
            (None, None) if is_endless || !has_volume(&own) => {
                let found = "an infinite solid without a finite primitive";
                let advice = "set its bounds with bounds(x0,y0,z0, x1,y1,z1);";
                return Err(Error::unsupported(path, found, advice));
            }
            // (An empty solid gets the box around its primitives.)
            (None, finite) => (if has_volume(&own) { own } else { finite.unwrap_or(own) }, false, None),
        };
        if clip {
            lowered.clip(&mut primitives, bounds);
        }
        let around = finite.map_or(bounds, |finite| hull(&bounds, &finite));
        Ok(BoundedSolid { primitives: Arc::new(primitives), lowered, bounds, around, ends })
    }
}

impl Lowered {
    /// Clips the solid to a box.
    fn clip(&mut self, primitives: &mut Vec<Primitive>, [min, max]: Bounds) {
        let (number, primitive) = (self.instances.len() as u32, primitives.len() as u32);
        let (shape, map) = (Shape::Block { min, max }, Affine::IDENTITY);
        primitives.push(Primitive { shape, map, word: "bounds".into(), at: At { line: 0, column: 0 } });
        self.instances.push(Instance { primitive, to_world: map, to_local: map });
        let all = match self.instructions.last() {
            Some(Instruction::All(count)) => {
                let count = count + 1;
                self.instructions.pop();
                count
            }
            _ => 2,
        };
        self.instructions.extend([Instruction::Primitive(number, false), Instruction::All(all)]);
    }
}
