//! Features as they come in, one after the other.

use std::path::Path;

use crate::attribute::{LineAttribute, LineValue};
use spinney_base::Result;
use spinney_crs::Crs;

/// A feature: lines, and a value for each attribute.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LineFeature {
    /// Its lines, each of two vertices or more, on the grid. There may be none.
    pub lines: Vec<Vec<[i32; 2]>>,
    /// The values of its attributes, in their order.
    pub values: Vec<LineValue>,
}

/// Description of features that come in.
#[derive(Clone, Debug)]
pub struct LineSchema {
    /// Their attributes.
    pub attributes: Vec<LineAttribute>,
    /// Units of the world that a step of the grid has.
    pub scale: f64,
    /// Place in the world of the grid's origin.
    pub offset: [f64; 2],
    /// Least and greatest vertex on the grid. Vertices beyond them are an error.
    pub bounds: [[i32; 2]; 2],
    /// The coordinate system, where known.
    pub crs: Option<Crs>,
    /// Number of features, where known.
    pub count: Option<u64>,
}

/// Features that come in.
pub trait LineSource {
    /// Description of the features.
    fn schema(&self) -> &LineSchema;

    /// The file that they come from, for messages.
    fn path(&self) -> &Path {
        Path::new("(memory)")
    }

    /// The next feature; `None` behind the last.
    ///
    /// # Errors
    /// If it cannot be read, or breaks the rules of its format.
    fn next(&mut self) -> Result<Option<LineFeature>>;
}

/// Features in memory.
#[derive(Clone, Debug)]
pub struct LinesInMemory {
    schema: LineSchema,
    features: std::vec::IntoIter<LineFeature>,
}

impl LinesInMemory {
    /// Features with these attributes, on a grid whose steps are units of the world.
    pub fn new(attributes: Vec<LineAttribute>, features: Vec<LineFeature>) -> LinesInMemory {
        let mut bounds: Option<[[i32; 2]; 2]> = None;
        for vertex in features.iter().flat_map(|feature| feature.lines.iter().flatten()) {
            let [least, most] = bounds.get_or_insert([*vertex; 2]);
            for axis in 0..2 {
                least[axis] = least[axis].min(vertex[axis]);
                most[axis] = most[axis].max(vertex[axis]);
            }
        }
        let schema = LineSchema {
            attributes,
            scale: 1.0,
            offset: [0.0; 2],
            bounds: bounds.unwrap_or([[0; 2]; 2]),
            crs: None,
            count: Some(features.len() as u64),
        };
        LinesInMemory { schema, features: features.into_iter() }
    }
}

impl LineSource for LinesInMemory {
    fn schema(&self) -> &LineSchema {
        &self.schema
    }

    fn next(&mut self) -> Result<Option<LineFeature>> {
        Ok(self.features.next())
    }
}
