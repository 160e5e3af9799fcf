//! Rasterization of features directly into quadtrees, without an intermediate raster. The edges of
//! shapes are clipped to nodes from the root down.

mod colours;
mod coverage;
mod edge;
mod load;
mod mask;
mod node_cache;
mod options;
mod plan;
mod shapes;
mod slivers;
mod source;
mod survey;
#[cfg(test)]
mod tests;
mod union;
mod values;

pub use self::options::{FeatureGrid, FeatureValue, LineWidth, Overlaps, RasterizeOptions};
pub use self::plan::{FeatureImport, FeatureTree, plan_features};
