//! Queries of exact models: results are those of the surface itself, and not of cells.
//!
//! Predicates (whether a line meets a face, on which side of a face a point is) are exact, in
//! integers. Lengths and volumes are rounded, and each function documents its error.
//!
//! ```
//! use spinney::ExactModel;
//! use spinney::brep::{BoxLocation, MassProperties};
//! # use spinney::import::mesh::{ExactOptions, import_exact, open_all};
//! # use spinney::Output;
//! # let directory = tempfile::tempdir().unwrap();
//! # let [mesh, path] = ["tetrahedron.off", "tetrahedron.goblin"].map(|name| directory.path().join(name));
//! # let text = "OFF\n4 4 0\n0 0 0\n6 0 0\n0 6 0\n0 0 6\n3 0 2 1\n3 0 1 3\n3 0 3 2\n3 1 2 3\n";
//! # std::fs::write(&mesh, text).unwrap();
//! # import_exact(open_all(&[mesh], 64 << 20)?, &ExactOptions::new(), Output::create(&path)?, &())?;
//! // The corner of a cube.
//! let model = ExactModel::open(&path, &Default::default())?;
//! let mass = MassProperties::of(&model, &())?;
//! assert_eq!((mass.volume, mass.centre), (36.0, Some([1.5; 3])));
//! assert_eq!(model.signed_distance([1.0, 1.0, 0.5])?, -0.5);
//! let (hit, _) = model.ray([1.0, 1.0, 9.0], [0.0, 0.0, -1.0])?;
//! assert_eq!(hit.unwrap().point, [1.0, 1.0, 4.0]);
//! assert_eq!(model.locate_box([0.5; 3], [1.5; 3])?.0, BoxLocation::Inside);
//! # Ok::<(), spinney::Error>(())
//! ```

mod bounds;
mod cells;
mod clusters;
mod contains;
mod coverage;
mod distance;
mod faces_in_box;
mod line;
mod mass;
mod model_cache;
mod model_surface;
mod nearest;
mod parts;
mod plane;
mod ratio;
mod ray;
#[cfg(test)]
mod ray_tests;
mod region;
mod section;
mod simple_rings;
#[cfg(test)]
mod testing;
mod tolerance;
mod touching_points;
mod viewpoint;
mod visited;

pub use cells::CellCoverage;
pub use contains::Location;
pub use coverage::{Coverage, CoverageSums, Cube};
pub use distance::SurfacePoint;
pub use line::{Crossing, Line};
pub use mass::{MassProperties, MassSums};
pub use model_surface::{ModelSurface, SurfaceDetail};
pub use nearest::{Nearest, nearest_on_face};
pub use parts::PartMeasures;
pub(crate) use ratio::WideSum;
pub use ray::{Hit, ModelRays};
pub use region::BoxLocation;
pub use section::{CuttingPlane, SectionPolygon, SectionVisitor};
pub use viewpoint::Viewpoint;
pub use visited::Visited;
pub(crate) use visited::half_of;
