//! Division of a model's faces along another model's surface.

use super::{CombineReport, Origin, Request, combined};
use crate::ExactModel;
use spinney_base::io::Output;
use spinney_base::{Progress, Result, SetOperation};
use spinney_container::Codec;

/// Writes a model with its faces divided where another model's surface meets them: along the lines
/// of intersection, and around areas in which both surfaces coincide. These lines become edges. The
/// body does not change. Parts, attributes and face values are kept, and all fragments of a face
/// have its values. (Lines in which surfaces only touch divide no face.)
///
/// New vertices are exact, and grids and memory have the same limits, as in
/// [`combine`](super::combine()).
///
/// ```
/// use spinney::ExactModel;
/// use spinney::brep::Faces;
/// use spinney::raw::brep::divide_faces;
/// # use spinney::import::mesh::{ExactOptions, import_exact, open_all};
/// # use spinney::{Codec, Output};
/// # let directory = tempfile::tempdir().unwrap();
/// # let path = |name: &str| directory.path().join(name);
/// # let made = |name: &str, z: i32| -> spinney::Result<ExactModel> {
/// #     let [mesh, model] = ["off", "goblin"].map(|ending| path(name).with_extension(ending));
/// #     let points = format!("0 0 {z}\n8 0 {z}\n0 8 {z}\n0 0 {}\n", z + 8);
/// #     std::fs::write(&mesh, format!("OFF\n4 4 0\n{points}3 0 2 1\n3 0 1 3\n3 0 3 2\n3 1 2 3\n")).unwrap();
/// #     let mut options = ExactOptions::new();
/// #     options.snap = Some(1.0);
/// #     import_exact(open_all(&[mesh], 64 << 20)?, &options, Output::create(&model)?, &())?;
/// #     ExactModel::open(&model, &Default::default())
/// # };
/// // Two corners of cubes, one of them higher: its base divides three faces of the other one.
/// let (a, b) = (made("a", 0)?, made("b", 4)?);
/// let output = Output::create(&path("divided.goblin"))?;
/// let report = divide_faces(&a, &b, output, Codec::Plain, 64 << 20, &())?;
/// assert_eq!((report.before[0], report.after), (4, 7));
/// # Ok::<(), spinney::Error>(())
/// ```
///
/// # Errors
/// Those of [`combine`](super::combine()).
pub fn divide_faces(
    model: &ExactModel,
    by: &ExactModel,
    output: Output,
    codec: Codec,
    memory: u64,
    progress: &dyn Progress,
) -> Result<CombineReport> {
    let mut provenance = model.metadata().provenance.clone();
    provenance.push(format!("{} divided where {} meets it", model.path().display(), by.path().display()));
    let origin = Origin { formula: model.formula()?.unwrap_or_default(), provenance, tags: Vec::new() };
    let request = Request { origin: Some(&origin), keeps_cuts: true, ..Request::new(SetOperation::First) };
    combined(request, &[model, by], (output, codec), memory, progress)
}
