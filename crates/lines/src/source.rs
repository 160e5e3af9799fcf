//! Input features, as a stream.

use std::path::Path;

use crate::attribute::{LineAttribute, LineValue};
use crate::vertex_grid::VertexGrid;
use spinney_base::Result;
use spinney_base::space::Dimension;
use spinney_crs::Crs;

/// Feature: lines, and a value for each attribute.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LineFeature {
    /// Lines, each with at least two vertices, in grid coordinates; z is 0 in a tree of two axes.
    /// May be empty.
    pub lines: Vec<Vec<[i32; 3]>>,
    /// Values of the attributes, in the order of the schema.
    pub values: Vec<LineValue>,
}

/// Schema of a stream of features.
#[derive(Clone, Debug)]
pub struct LineSchema {
    /// Attributes of the features.
    pub attributes: Vec<LineAttribute>,
    /// Two or three axes.
    pub dimension: Dimension,
    /// Whether z has the unit of x and y.
    pub(crate) has_one_unit: bool,
    /// Size of a grid unit along each axis, in world units; equal along x and y, and along z, too,
    /// if that has their unit.
    pub scale: [f64; 3],
    /// World coordinates of the grid's origin.
    pub offset: [f64; 3],
    /// Minimum and maximum vertex in grid coordinates. Vertices outside are an error.
    pub bounds: [[i32; 3]; 2],
    /// Coordinate reference system, if known.
    pub crs: Option<Crs>,
    /// Number of features, if known.
    pub count: Option<u64>,
}

impl LineSchema {
    /// Creates the schema of features on a grid.
    pub fn new(grid: &VertexGrid, attributes: Vec<LineAttribute>, crs: Option<Crs>) -> LineSchema {
        LineSchema {
            attributes,
            dimension: grid.dimension(),
            has_one_unit: grid.has_one_unit(),
            scale: grid.scale(),
            offset: grid.offset(),
            bounds: grid.bounds(),
            crs,
            count: None,
        }
    }
}

/// Stream of features.
pub trait LineSource {
    /// Returns the schema of the features.
    fn schema(&self) -> &LineSchema;

    /// Returns the input file's path, for messages.
    fn path(&self) -> &Path {
        Path::new("(memory)")
    }

    /// Returns remarks on what is changed in or dropped from the features read so far.
    fn remarks(&self) -> Vec<String> {
        Vec::new()
    }

    /// Returns the next feature; `None` at the end.
    ///
    /// # Errors
    /// If it cannot be read, or violates its format.
    fn next(&mut self) -> Result<Option<LineFeature>>;
}

/// Features in memory.
#[derive(Clone, Debug)]
pub struct LinesInMemory {
    schema: LineSchema,
    features: std::vec::IntoIter<LineFeature>,
}

impl LinesInMemory {
    /// Creates a source of features on a grid whose unit is the world unit.
    pub fn new(
        dimension: Dimension,
        attributes: Vec<LineAttribute>,
        features: Vec<LineFeature>,
    ) -> LinesInMemory {
        let mut bounds: Option<[[i32; 3]; 2]> = None;
        for vertex in features.iter().flat_map(|feature| feature.lines.iter().flatten()) {
            let [least, most] = bounds.get_or_insert([*vertex; 2]);
            for axis in 0..3 {
                least[axis] = least[axis].min(vertex[axis]);
                most[axis] = most[axis].max(vertex[axis]);
            }
        }
        let schema = LineSchema {
            attributes,
            dimension,
            has_one_unit: true,
            scale: [1.0; 3],
            offset: [0.0; 3],
            bounds: bounds.unwrap_or([[0; 3]; 2]),
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
