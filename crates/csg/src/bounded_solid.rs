//! A solid and the box that it is built in. An infinite solid is clipped to the box.

use std::sync::Arc;

use crate::affine::Affine;
use crate::exact::MAX_FACETS;
use crate::expression::Instruction;
use crate::lowered::{Bounds, Instance, Lowered, has_volume, hull, is_finite};
use crate::model::{Csg, Primitive};
use crate::patches::FacetTree;
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

impl BoundedSolid {
    /// Makes the facets of all patches that points are tested against, within a distance in world
    /// coordinates.
    ///
    /// # Errors
    /// If there would be too many.
    pub(crate) fn facet_patches(&mut self, within: f64) -> Result<()> {
        let mut stretches = vec![0.0f64; self.primitives.len()];
        for instance in &self.lowered.instances {
            let stretch = &mut stretches[instance.primitive as usize];
            *stretch = stretch.max(instance.to_world.stretch());
        }
        for (primitive, stretch) in Arc::make_mut(&mut self.primitives).iter_mut().zip(stretches) {
            if let Shape::Patches { shell, facets } = &mut primitive.shape
                && stretch > 0.0
            {
                let within = within / stretch;
                let count = shell.facet_count(within);
                if count > MAX_FACETS {
                    let found = format!("cells so small that {} needs {count} facets", primitive.name());
                    return Err(Error::invalid("cells", found, "larger cells, for at most 1048576 facets"));
                }
                *facets = Arc::new(FacetTree::of(&shell.facets(within)));
            }
        }
        Ok(())
    }

    /// Returns the shells of patches: name, number of patches, and volume in world coordinates.
    pub(crate) fn shells(&self) -> impl Iterator<Item = (String, usize, f64)> {
        self.lowered.instances.iter().filter_map(|instance| {
            let primitive = &self.primitives[instance.primitive as usize];
            let Shape::Patches { shell, .. } = &primitive.shape else { return None };
            let volume = shell.volume * instance.to_world.determinant().abs();
            Some((primitive.name(), shell.len(), volume))
        })
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
