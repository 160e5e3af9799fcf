//! Euler operators in their text format, which build a body from nothing.

use super::model_file::ModelFile;
use super::{MeshFace, Model, ModelInfo};
use spinney_base::Result;
use spinney_brep::Attributes;
use spinney_brep::euler::{EulerText, TextLimits};

struct Euler {
    text: EulerText,
    info: ModelInfo,
}

pub(super) fn open(source: ModelFile, memory: u64) -> Result<Box<dyn Model>> {
    let path = source.path().to_path_buf();
    let mut text = EulerText::default();
    let limits = TextLimits { memory, path: path.clone() };
    text.apply(source.bytes(), &limits, &mut |_, _, _| {})?;
    if text.body().counts().vertices == 0 {
        return Err(source.no_vertices());
    }
    text.check_rings(&path)?;
    let mut bounds = [[f64::INFINITY; 3], [f64::NEG_INFINITY; 3]];
    text.each_face(&mut |points, _, _| {
        for point in points {
            for axis in 0..3 {
                bounds[0][axis] = bounds[0][axis].min(point[axis]);
                bounds[1][axis] = bounds[1][axis].max(point[axis]);
            }
        }
        Ok(())
    })?;
    let parts = if text.parts().is_empty() { vec!["mesh".into()] } else { text.parts().to_vec() };
    let info = ModelInfo {
        path,
        format: "Euler operators".into(),
        faces: Some(text.body().counts().faces),
        bounds,
        crs: None,
        unit: text.unit().map(Into::into),
        step: text.step(),
        parts,
        // (Its faces bound one body, with common edges.)
        is_grouped: true,
        is_z_up: false,
        attributes: Attributes::default(),
        is_coloured: false,
        bytes: source.bytes().len() as u64,
    };
    Ok(Box::new(Euler { text, info }))
}

impl Model for Euler {
    fn info(&self) -> &ModelInfo {
        &self.info
    }

    fn faces(&mut self, each: &mut dyn FnMut(&MeshFace<'_>) -> Result<()>) -> Result<()> {
        self.text.each_face(&mut |points, ring_ends, part| {
            each(&MeshFace { points, ring_ends, colours: &[], part, values: &[] })
        })
    }
}
